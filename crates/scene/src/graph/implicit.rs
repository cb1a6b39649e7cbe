//! Shapes given by their dimensions, under the scale of their node.

use std::f64::consts::TAU;

use super::super::description::{Motion, ShapeKind};
use super::NEAR;
use super::math::{self, Mat3, Vec3};

/// Points on each ring of a sampled round shape.
const RING: usize = 24;
/// Thickness of the plate that replaces a plane on a dynamic body, relative to its shorter side.
const SHEET: f64 = 0.01;
/// Half the size of a plane along an axis without a size, if the other axis has one. \[m\]
const ENDLESS: f64 = 1000.0;

/// A shape as described in the file.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Implicit {
    Sphere {
        radius: f64,
    },
    Box {
        size: Vec3,
    },
    Capsule {
        height: f64,
        top: f64,
        bottom: f64,
    },
    Cylinder {
        height: f64,
        top: f64,
        bottom: f64,
    },
    Plane {
        x: Option<f64>,
        z: Option<f64>,
        double: bool,
    },
    /// A mesh in the file, as referenced by an OMI shape.
    Mesh {
        mesh: usize,
        convex: bool,
    },
}

/// Result of applying the scale of a node to a shape.
pub(crate) enum Placed {
    /// The exact shape.
    Shape(ShapeKind),
    /// A substitute shape, and the reason for it.
    Instead(ShapeKind, String),
    /// No shape, and the reason.
    Nothing(String),
}

/// Linear part of a node's transform without its rotation.
struct Scale {
    /// The linear map: diagonal, unless scaled parents shear it.
    map: Mat3,
    /// Absolute scale along each axis. \[1\]
    size: Vec3,
    /// True if the map has no shear.
    straight: bool,
    /// True if bodies of revolution about y remain so.
    round: bool,
    /// True if the scale is uniform.
    even: bool,
}

impl Scale {
    /// Analyzes a map.
    ///
    /// # Errors
    /// If the map is zero or flattens its argument: the reason why no shape can exist.
    fn of(map: Mat3) -> Result<Self, &'static str> {
        let [[sx, yx, zx], [xy, sy, zy], [xz, yz, sz]] = map;
        let largest = map.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
        if largest == 0.0 {
            return Err("its node has scale 0, which disables it");
        }
        if math::determinant(map).abs() < NEAR.powi(3) {
            return Err("the scale of its node flattens it");
        }
        let shear = [yx, zx, xy, zy, xz, yz].iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let straight = shear <= 1e-6 * largest;
        let size = [sx, sy, sz].map(f64::abs);
        let same = |a: f64, b: f64| (a - b).abs() <= 1e-6 * largest;
        let round = straight && same(size[0], size[2]);
        Ok(Self { map, size, straight, round, even: round && same(size[0], size[1]) })
    }

    /// Returns the convex hull of scaled points that replaces a shape.
    fn hull(&self, points: Vec<Vec3>, why: &str) -> Placed {
        let moved = points.into_iter().map(|p| {
            // Without shear, a negative scale counts by its magnitude.
            Vec::from(if self.straight {
                math::apply(math::diagonal(self.size), p)
            } else {
                math::apply(self.map, p)
            })
        });
        Placed::Instead(ShapeKind::ConvexHull { points: moved.collect() }, why.into())
    }

    /// Returns the normal of the local plane y = 0 under the map.
    fn up(&self) -> Vec3 {
        const UP: Vec3 = [0.0, 1.0, 0.0];
        if self.straight {
            return UP;
        }
        let [[sx, yx, zx], [xy, sy, zy], [xz, yz, sz]] = self.map;
        let across = math::cross([xz, yz, sz], [sx, yx, zx]);
        let up = math::unit(across).unwrap_or(UP);
        if math::dot(up, [xy, sy, zy]) < 0.0 { math::scale(up, -1.0) } else { up }
    }
}

/// Applies a scale to a shape. `map` is the linear part of the node's transform without its
/// rotation: diagonal, unless scaled parents shear it.
pub(crate) fn place(shape: &Implicit, map: Mat3, motion: Motion) -> Placed {
    let scale = match Scale::of(map) {
        Ok(scale) => scale,
        Err(why) => return Placed::Nothing(why.into()),
    };
    let [ax, ay, az] = scale.size;
    let squeezed = "its scale is not even: a convex hull of sampled points stands for it";
    let pointed = "its radii differ: a convex hull of sampled points stands for it";
    match *shape {
        Implicit::Sphere { radius } if scale.even => {
            Placed::Shape(ShapeKind::Sphere { radius: radius * ax })
        }
        Implicit::Sphere { radius } => scale.hull(ball(radius, 0.0), squeezed),
        Implicit::Box { size: [x, y, z] } if scale.straight => {
            let half_extents = vec![x * ax / 2.0, y * ay / 2.0, z * az / 2.0];
            Placed::Shape(ShapeKind::Box { half_extents })
        }
        Implicit::Box { size: [x, y, z] } => {
            let signs = [-0.5, 0.5];
            let corners = signs.into_iter().flat_map(|i| {
                signs
                    .into_iter()
                    .flat_map(move |j| signs.into_iter().map(move |k| [x * i, y * j, z * k]))
            });
            scale.hull(corners.collect(), "scaled parents shear it: a convex hull stands for it")
        }
        Implicit::Capsule { height, top, bottom } => {
            let (radius, half) = (top.max(bottom), height / 2.0);
            if scale.even && top == bottom {
                let (radius, half_height) = (radius * ax, half * ay);
                return Placed::Shape(ShapeKind::Capsule { radius, half_height });
            }
            let mut points = ball(top, half);
            points.extend(ball(bottom, -half));
            scale.hull(points, if top == bottom { squeezed } else { pointed })
        }
        Implicit::Cylinder { height, top, bottom } => {
            let half = height / 2.0;
            if scale.round && top == bottom {
                let (radius, half_height) = (top * ax, half * ay);
                return Placed::Shape(ShapeKind::Cylinder { radius, half_height });
            }
            let mut points = ring(top, half);
            points.extend(ring(bottom, -half));
            scale.hull(points, if top == bottom { squeezed } else { pointed })
        }
        Implicit::Plane { x: None, z: None, double } => endless(&scale, double, motion),
        Implicit::Plane { x, z, double } => {
            let half = |side: Option<f64>, scale: f64| side.map_or(ENDLESS, |s| s * scale / 2.0);
            let halves = [half(x, ax), half(z, az)];
            if motion == Motion::Dynamic {
                return plate(halves);
            }
            let sheet = sheet(halves, double);
            if x.is_none() || z.is_none() {
                let why =
                    format!("the plane ends {ENDLESS} m from its middle where it has no size");
                Placed::Instead(sheet, why)
            } else if scale.straight {
                Placed::Shape(sheet)
            } else {
                let why = "scaled parents shear it, which this plane does not follow";
                Placed::Instead(sheet, why.into())
            }
        }
        Implicit::Mesh { .. } => Placed::Nothing("it is a mesh".into()),
    }
}

/// Returns an infinite plane as a half-space.
fn endless(scale: &Scale, double: bool, motion: Motion) -> Placed {
    if motion != Motion::Static {
        let why = "an endless plane acts on static bodies only: it is ignored";
        return Placed::Nothing(why.into());
    }
    let plane = ShapeKind::Halfspace { normal: scale.up().into() };
    if double {
        let why = "an endless plane acts on its upper side only, although doubleSided";
        Placed::Instead(plane, why.into())
    } else {
        Placed::Shape(plane)
    }
}

/// Returns a bounded plane as a mesh, by half its sizes along x and z.
fn sheet([hx, hz]: [f64; 2], double: bool) -> ShapeKind {
    let vertices = vec![[-hx, 0.0, -hz], [-hx, 0.0, hz], [hx, 0.0, hz], [hx, 0.0, -hz]];
    let mut triangles = vec![[0, 1, 2], [0, 2, 3]];
    if double {
        triangles.extend([[0, 2, 1], [0, 3, 2]]);
    }
    ShapeKind::Trimesh { vertices, triangles, decomposition: None, vertex_track: None }
}

/// Returns the plate that replaces such a plane on a dynamic body, which needs a volume.
fn plate([hx, hz]: [f64; 2]) -> Placed {
    let thick = SHEET * hx.min(hz) * 2.0;
    let points = [[hx, hz], [hx, -hz], [-hx, hz], [-hx, -hz]]
        .into_iter()
        .flat_map(|[x, z]| [vec![x, 0.0, z], vec![x, -thick, z]])
        .collect();
    Placed::Instead(
        ShapeKind::ConvexHull { points },
        format!("a plane on a moving body is a plate of thickness {thick} m below it"),
    )
}

fn ring(radius: f64, y: f64) -> Vec<Vec3> {
    if radius == 0.0 {
        return vec![[0.0, y, 0.0]];
    }
    (0..RING)
        .map(|i| {
            let (sin, cos) = libm::sincos(i as f64 / RING as f64 * TAU);
            [radius * cos, y, radius * sin]
        })
        .collect()
}

/// Points of a sphere about (0, y, 0): rings and both poles.
pub(crate) fn ball(radius: f64, y: f64) -> Vec<Vec3> {
    let rows = RING / 2;
    let mut points = Vec::new();
    for row in 0..=rows {
        let angle = row as f64 / rows as f64 * TAU / 2.0;
        let at = if row == 0 || row == rows { 0.0 } else { radius * libm::sin(angle) };
        points.extend(ring(at, y + radius * libm::cos(angle)));
    }
    points
}
