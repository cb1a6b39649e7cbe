//! Shapes of the audit: support functions in `f64`, and the penetration depth of two shapes.

use parry3d::bounding_volume::Aabb;
use parry3d::math::{Pose, Vector};
use parry3d::query::epa::EPA;
use parry3d::query::gjk::{CsoPoint, GJKResult, VoronoiSimplex, closest_points};
use parry3d::shape::{SupportMap, TriMesh};
use parry3d::transformation::try_convex_hull;

use drystone_scene::{Rotation, Shape, ShapeKind};

pub(super) type Vec3 = [f64; 3];

/// Maximum number of face normals of a hull that are tried as separating directions.
const FACES: usize = 64;
/// Maximum number of triangles of a mesh that one shape is measured against.
const TRIANGLES: usize = 4096;
/// Relative margin of bounding boxes against rounding to `f32`. \[1\]
const LOOSE: f64 = 1e-6;

pub(super) fn add(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|i| a[i] + b[i])
}

pub(super) fn minus(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|i| a[i] - b[i])
}

pub(super) fn dot(a: Vec3, b: Vec3) -> f64 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

pub(super) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
}

pub(super) fn norm(v: Vec3) -> f64 {
    dot(v, v).sqrt()
}

fn scaled(v: Vec3, by: f64) -> Vec3 {
    v.map(|x| x * by)
}

fn unit(v: Vec3) -> Option<Vec3> {
    let length = norm(v);
    (length > 0.0).then(|| scaled(v, 1.0 / length))
}

/// Position and rotation; `axes` are the columns of the rotation matrix.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShapePose {
    /// World position. \[m\]
    pub(super) position: Vec3,
    pub(super) axes: [Vec3; 3],
}

impl ShapePose {
    /// Converts a position and a unit quaternion x, y, z, w.
    pub(super) fn new(position: Vec3, [x, y, z, w]: [f64; 4]) -> Self {
        let axes = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)],
            [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)],
            [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)],
        ];
        Self { position, axes }
    }

    /// Returns the pose of a shape in the frame of its body.
    fn of_shape(shape: &Shape) -> Self {
        let position = std::array::from_fn(|i| shape.position.get(i).copied().unwrap_or(0.0));
        let rotation = match shape.rotation {
            Rotation::Quaternion(q) => q,
            Rotation::Angle(angle) => [0.0, 0.0, libm::sin(angle / 2.0), libm::cos(angle / 2.0)],
        };
        Self::new(position, rotation)
    }

    pub(super) fn direction(&self, local: Vec3) -> Vec3 {
        std::array::from_fn(|i| (0..3).map(|k| self.axes[k][i] * local[k]).sum())
    }

    pub(super) fn point(&self, local: Vec3) -> Vec3 {
        add(self.position, self.direction(local))
    }

    pub(super) fn local_direction(&self, world: Vec3) -> Vec3 {
        self.axes.map(|axis| dot(axis, world))
    }

    pub(super) fn local_point(&self, world: Vec3) -> Vec3 {
        self.local_direction(minus(world, self.position))
    }

    /// Returns the world pose of `inner`, which is given in this frame.
    fn compose(&self, inner: &Self) -> Self {
        Self {
            position: self.point(inner.position),
            axes: inner.axes.map(|axis| self.direction(axis)),
        }
    }

    /// Returns this frame relative to another, in single precision.
    fn seen_from(&self, other: &Self) -> Pose {
        let axes = self.axes.map(|axis| other.local_direction(axis));
        let single = |v: Vec3| Vector::from(v.map(|x| x as f32));
        let rotation = parry3d::math::Rotation::from_mat3(&parry3d::math::Matrix::from_cols(
            single(axes[0]),
            single(axes[1]),
            single(axes[2]),
        ));
        Pose::from_parts(single(other.local_point(self.position)), rotation)
    }
}

/// Geometry of a form about its center, without the ball that is swept over it.
#[derive(Debug)]
pub(super) enum CoreShape {
    /// Convex hull of points.
    Points(Vec<Vec3>),
    /// Cylinder along y.
    Cylinder { radius: f64, half: f64 },
    /// Half-space behind a plane through the center; the normal points outward.
    Plane(Vec3),
    /// Triangle mesh.
    Mesh(Box<AuditMesh>),
}

/// Triangles in `f64`, and the bounding volume hierarchy that finds them.
#[derive(Debug)]
pub(super) struct AuditMesh {
    pub(super) points: Vec<Vec3>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) tree: TriMesh,
}

impl AuditMesh {
    /// Converts a mesh to coordinates relative to `center`. Returns `None` if an index of a
    /// triangle is out of range.
    fn new(vertices: &[Vec3], triangles: &[[u32; 3]], center: Vec3) -> Option<Self> {
        let points: Vec<Vec3> = vertices.iter().map(|p| minus(*p, center)).collect();
        let single = points.iter().map(|p| Vector::from(p.map(|x| x as f32))).collect();
        let is_sound = |t: &[u32; 3]| t.iter().all(|&i| (i as usize) < points.len());
        if !triangles.iter().all(is_sound) {
            return None;
        }
        let tree = TriMesh::new(single, triangles.to_vec()).ok()?;
        Some(Self { points, triangles: triangles.to_vec(), tree })
    }

    pub(super) fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|i| self.points[i as usize])
    }
}

/// A shape: the Minkowski sum of its core and a ball.
#[derive(Debug)]
pub(super) struct SupportShape {
    pub(super) core: CoreShape,
    /// Radius of the ball. \[m\]
    radius: f64,
    /// Known face normals in the frame of the form, with either sign.
    faces: Vec<Vec3>,
    /// Pose of the form in the frame of its body.
    pose: ShapePose,
    /// Distance from its center to its farthest point; infinite for a half-space. \[m\]
    pub(super) reach: f64,
    /// Least width; infinite for a half-space or a mesh. \[m\]
    pub(super) thickness: f64,
}

impl SupportShape {
    /// Converts a shape of a scene. A box or hull in 2D becomes a prism about z = 0, too long to be
    /// separated along z. Returns `None` for a shape without points, a zero normal or a triangle
    /// index out of range.
    pub(super) fn new(shape: &Shape, dimension: usize) -> Option<Self> {
        let flat = dimension == 2;
        let mut pose = ShapePose::of_shape(shape);
        let mut faces = Vec::new();
        let (core, radius) = match &shape.kind {
            ShapeKind::Sphere { radius } => (CoreShape::Points(vec![[0.0; 3]]), *radius),
            ShapeKind::Capsule { radius, half_height: h } => {
                (CoreShape::Points(vec![[0.0, -h, 0.0], [0.0, *h, 0.0]]), *radius)
            }
            ShapeKind::Box { half_extents } => {
                let half = |i: usize| half_extents.get(i).copied();
                let (x, y) = (half(0)?, half(1)?);
                let z = if flat { 4.0 * (x + y) } else { half(2)? };
                faces = vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
                if !flat {
                    faces.push([0.0, 0.0, 1.0]);
                }
                let sides = [-1.0, 1.0];
                let corner =
                    |i: usize| [sides[i & 1] * x, sides[i >> 1 & 1] * y, sides[i >> 2] * z];
                (CoreShape::Points((0..8).map(corner).collect()), 0.0)
            }
            ShapeKind::Cylinder { radius, half_height } => {
                faces = vec![[0.0, 1.0, 0.0]];
                (CoreShape::Cylinder { radius: *radius, half: *half_height }, 0.0)
            }
            ShapeKind::ConvexHull { points } => {
                let mut all: Vec<Vec3> = points.iter().map(|p| at(p)).collect();
                let center = middle(&all)?;
                pose.position = pose.point(center);
                all.iter_mut().for_each(|p| *p = minus(*p, center));
                if flat {
                    let z = 4.0 * all.iter().map(|p| norm(*p)).fold(0.0, f64::max);
                    let ends = |p: &Vec3| [[p[0], p[1], -z], [p[0], p[1], z]];
                    all = all.iter().flat_map(ends).collect();
                }
                faces = hull_faces(&all);
                if flat {
                    faces.retain(|n| n[2].abs() < 0.5);
                }
                (CoreShape::Points(all), 0.0)
            }
            ShapeKind::Halfspace { normal } => (CoreShape::Plane(unit(at(normal))?), 0.0),
            ShapeKind::Trimesh { vertices, triangles, .. } => {
                let center = middle(vertices)?;
                pose.position = pose.point(center);
                (CoreShape::Mesh(Box::new(AuditMesh::new(vertices, triangles, center)?)), 0.0)
            }
        };
        let mut form =
            Self { core, radius, faces, pose, reach: f64::INFINITY, thickness: f64::INFINITY };
        (form.reach, form.thickness) = form.sizes(flat);
        Some(form)
    }

    /// Makes a triangle with coordinates relative to `center`.
    fn triangle(corners: [Vec3; 3], center: Vec3) -> Self {
        let points: Vec<Vec3> = corners.iter().map(|p| minus(*p, center)).collect();
        let normal = cross(minus(points[1], points[0]), minus(points[2], points[0]));
        Self {
            reach: points.iter().map(|p| norm(*p)).fold(0.0, f64::max),
            core: CoreShape::Points(points),
            radius: 0.0,
            faces: unit(normal).into_iter().collect(),
            pose: ShapePose::new([0.0; 3], [0.0, 0.0, 0.0, 1.0]),
            thickness: 0.0,
        }
    }

    /// Returns the world pose of the form if its body has the pose `body`.
    pub(super) fn placed(&self, body: &ShapePose) -> ShapePose {
        body.compose(&self.pose)
    }

    /// Returns the reach and the thickness; the thickness is the least width over the known face
    /// normals.
    fn sizes(&self, flat: bool) -> (f64, f64) {
        let planar = |p: &Vec3| if flat { libm::hypot(p[0], p[1]) } else { norm(*p) };
        let far = |points: &[Vec3]| points.iter().map(planar).fold(0.0, f64::max);
        let width = |n: &Vec3| self.support(*n) + self.support(scaled(*n, -1.0));
        match &self.core {
            CoreShape::Plane(_) => (f64::INFINITY, f64::INFINITY),
            CoreShape::Mesh(mesh) => (far(&mesh.points), f64::INFINITY),
            CoreShape::Cylinder { radius, half } => {
                (libm::hypot(*radius, *half), 2.0 * radius.min(*half))
            }
            CoreShape::Points(points) => {
                let narrow = self.faces.iter().map(width).reduce(f64::min);
                (far(points) + self.radius, narrow.unwrap_or(2.0 * self.radius))
            }
        }
    }

    /// Returns the support point of the core in the direction `along`, in the frame of the form.
    fn farthest(&self, along: Vec3) -> Vec3 {
        match &self.core {
            CoreShape::Points(points) => best(points, along),
            CoreShape::Mesh(mesh) => best(&mesh.points, along),
            CoreShape::Cylinder { radius, half } => {
                let across = libm::hypot(along[0], along[2]);
                let part = if across > 0.0 { radius / across } else { 0.0 };
                [along[0] * part, half.copysign(along[1]), along[2] * part]
            }
            CoreShape::Plane(_) => [0.0; 3],
        }
    }

    /// Returns the support map of the whole form, ball included.
    pub(super) fn mapped(&self) -> Mapped<'_> {
        Mapped { form: self, radius: self.radius }
    }

    /// Returns the support function in the direction of the unit vector `along`, in the frame of
    /// the form. \[m\]
    pub(super) fn support(&self, along: Vec3) -> f64 {
        dot(self.farthest(along), along) + self.radius
    }

    /// Returns the bounding box in the world, enlarged by the margin for `f32`; `None` for a
    /// half-space.
    pub(super) fn bounds(&self, pose: &ShapePose) -> Option<Aabb> {
        if matches!(self.core, CoreShape::Plane(_)) {
            return None;
        }
        let side = |axis: usize, sign: f64| {
            let local = std::array::from_fn(|k| sign * pose.axes[k][axis]);
            sign * self.support(local) + pose.position[axis]
        };
        Some(loose(std::array::from_fn(|i| side(i, -1.0)), std::array::from_fn(|i| side(i, 1.0))))
    }
}

/// Makes a box that contains both corners even after rounding to `f32`.
pub(super) fn loose(low: Vec3, high: Vec3) -> Aabb {
    let slack = |i: usize| LOOSE * (low[i].abs() + high[i].abs()) + f64::from(f32::MIN_POSITIVE);
    let min = std::array::from_fn::<f32, 3, _>(|i| (low[i] - slack(i)) as f32);
    let max = std::array::from_fn::<f32, 3, _>(|i| (high[i] + slack(i)) as f32);
    Aabb::new(Vector::from(min), Vector::from(max))
}

fn at(numbers: &[f64]) -> Vec3 {
    std::array::from_fn(|i| numbers.get(i).copied().unwrap_or(0.0))
}

fn middle(points: &[Vec3]) -> Option<Vec3> {
    let count = points.len() as f64;
    let sum = points.iter().copied().reduce(add)?;
    Some(scaled(sum, 1.0 / count))
}

fn best(points: &[Vec3], along: Vec3) -> Vec3 {
    let (mut found, mut most) = ([0.0; 3], f64::NEG_INFINITY);
    for point in points {
        let far = dot(*point, along);
        if far > most {
            (found, most) = (*point, far);
        }
    }
    found
}

/// Returns the normals of the largest faces of a hull.
fn hull_faces(points: &[Vec3]) -> Vec<Vec3> {
    let single: Vec<_> = points.iter().map(|p| Vector::from(p.map(|x| x as f32))).collect();
    let Ok((corners, triangles)) = try_convex_hull(&single) else { return Vec::new() };
    let corner = |i: u32| corners[i as usize].to_array().map(f64::from);
    let mut areas: Vec<(f64, Vec3)> = Vec::new();
    for triangle in &triangles {
        let [a, b, c] = triangle.map(corner);
        let area = cross(minus(b, a), minus(c, a));
        let Some(normal) = unit(area) else { continue };
        // Triangles of one face have the same normal.
        match areas.iter_mut().find(|known| dot(known.1, normal) > 1.0 - 1e-9) {
            Some(known) => known.0 += norm(area),
            None => areas.push((norm(area), normal)),
        }
    }
    areas.sort_by(|a, b| b.0.total_cmp(&a.0));
    areas.into_iter().take(FACES).map(|(_, normal)| normal).collect()
}

/// Support map of a form for parry's GJK and EPA, with or without the ball around its core.
pub(super) struct Mapped<'a> {
    form: &'a SupportShape,
    radius: f64,
}

impl SupportMap for Mapped<'_> {
    fn local_support_point(&self, dir: Vector) -> Vector {
        let along = dir.to_array().map(f64::from);
        let mut point = self.form.farthest(along);
        if self.radius > 0.0
            && let Some(along) = unit(along)
        {
            point = add(point, scaled(along, self.radius));
        }
        Vector::from(point.map(|x| x as f32))
    }
}

/// A form and its world pose.
pub(super) type PosedShape<'a> = (&'a SupportShape, &'a ShapePose);

/// Returns the translation along the unit vector `n`, which points from a to b, that separates two
/// forms: an upper bound of their penetration depth. \[m\]
fn overlap_along(a: PosedShape<'_>, b: PosedShape<'_>, n: Vec3) -> f64 {
    let reach =
        a.0.support(a.1.local_direction(n)) + b.0.support(scaled(b.1.local_direction(n), -1.0));
    reach - dot(n, minus(b.1.position, a.1.position))
}

/// Returns the penetration depth of two forms. Returns `None` if they are disjoint, and for pairs
/// that are not measured: two meshes or two half-spaces. \[m\]
pub(super) fn overlap(a: PosedShape<'_>, b: PosedShape<'_>) -> Option<f64> {
    match (&a.0.core, &b.0.core) {
        (CoreShape::Plane(_), CoreShape::Plane(_)) | (CoreShape::Mesh(_), CoreShape::Mesh(_)) => {
            None
        }
        (CoreShape::Plane(normal), _) => overlap_plane(a.1, *normal, b),
        (_, CoreShape::Plane(normal)) => overlap_plane(b.1, *normal, a),
        (CoreShape::Mesh(mesh), _) => overlap_mesh(mesh, a.1, b),
        (_, CoreShape::Mesh(mesh)) => overlap_mesh(mesh, b.1, a),
        _ => overlap_convex(a, b),
    }
    .filter(|depth| *depth > 0.0)
}

fn overlap_plane(plane: &ShapePose, normal: Vec3, (form, pose): PosedShape<'_>) -> Option<f64> {
    let n = plane.direction(normal);
    let lowest = dot(n, minus(pose.position, plane.position))
        - form.support(scaled(pose.local_direction(n), -1.0));
    Some(-lowest)
}

fn overlap_mesh(mesh: &AuditMesh, pose: &ShapePose, b: PosedShape<'_>) -> Option<f64> {
    // All further coordinates are in the frame of the mesh.
    let seen = ShapePose {
        position: pose.local_point(b.1.position),
        axes: b.1.axes.map(|axis| pose.local_direction(axis)),
    };
    let around = b.0.bounds(&seen)?;
    let near = mesh.tree.bvh().intersect_aabb(&around).take(TRIANGLES);
    let depth = |triangle| {
        let corners = mesh.corners(triangle);
        // Coordinates relative to the center of the other form are small.
        let form = SupportShape::triangle(corners, seen.position);
        let at =
            ShapePose { position: seen.position, ..ShapePose::new([0.0; 3], [0.0, 0.0, 0.0, 1.0]) };
        overlap_convex((&form, &at), (b.0, &seen))
    };
    near.filter_map(depth).reduce(f64::max)
}

/// Returns the penetration depth of two convex forms, the minimum over several directions. GJK
/// gives a direction if the cores are disjoint, EPA if they overlap. Further directions are the
/// face normals and the line between the centers. The overlap along each direction is an upper
/// bound of the depth, and is evaluated in `f64`.
fn overlap_convex(a: PosedShape<'_>, b: PosedShape<'_>) -> Option<f64> {
    let pose = b.1.seen_from(a.1);
    let radius = a.0.radius + b.0.radius;
    let [core_a, core_b] = [a.0, b.0].map(|form| Mapped { form, radius: 0.0 });
    let mut simplex = VoronoiSimplex::new();
    let start = if pose.translation.length_squared() > 0.0 { pose.translation } else { Vector::X };
    simplex.reset(CsoPoint::from_shapes(&pose, &core_a, &core_b, start));
    let near = radius as f32 * (1.0 + 1e-3) + f32::MIN_POSITIVE;
    let along = |n: Vector| {
        let n = unit(n.to_array().map(f64::from))?;
        Some(overlap_along(a, b, a.1.direction(n)))
    };
    let found = closest_points(&pose, &core_a, &core_b, near, true, &mut simplex);
    let mut least = match found {
        GJKResult::ClosestPoints(_, _, n) => along(n),
        GJKResult::NoIntersection(n) => along(n),
        _ => {
            let [round_a, round_b] = [a.0, b.0].map(SupportShape::mapped);
            let mut epa = EPA::new();
            // Without radii, EPA can start from the simplex of the cores.
            if radius > 0.0 {
                simplex.reset(CsoPoint::from_shapes(&pose, &round_a, &round_b, start));
                closest_points(&pose, &round_a, &round_b, near, true, &mut simplex);
            }
            let points = epa.closest_points(&pose, &round_a, &round_b, &simplex);
            points.and_then(|(_, _, n)| along(n))
        }
    }
    .unwrap_or(f64::INFINITY);
    if least <= 0.0 {
        return None;
    }
    let mut consider = |n: Vec3| {
        for n in [n, scaled(n, -1.0)] {
            least = least.min(overlap_along(a, b, n));
        }
    };
    for (form, pose) in [a, b] {
        form.faces.iter().for_each(|n| consider(pose.direction(*n)));
    }
    unit(minus(b.1.position, a.1.position)).into_iter().for_each(&mut consider);
    least.is_finite().then_some(least)
}

#[cfg(test)]
mod tests {
    use super::*;
    use drystone_scene::{Filter, Material};

    const FLAT: [f64; 4] = [0.0, 0.0, 0.0, 1.0];

    fn form(kind: ShapeKind, dimension: usize) -> SupportShape {
        let shape = Shape {
            kind,
            position: vec![0.0; dimension],
            rotation: Rotation::identity(dimension),
            material: Material::default(),
            surface_velocity: None,
            filter: Filter::default(),
        };
        SupportShape::new(&shape, dimension).unwrap()
    }

    fn depth(a: &SupportShape, b: &SupportShape, apart: Vec3) -> f64 {
        let body = ShapePose::new([0.0; 3], FLAT);
        let other = ShapePose::new(apart, FLAT);
        overlap((a, &a.placed(&body)), (b, &b.placed(&other))).unwrap_or(0.0)
    }

    fn cube(half: f64, dimension: usize) -> SupportShape {
        form(ShapeKind::Box { half_extents: vec![half; dimension] }, dimension)
    }

    fn hull(half: f64) -> SupportShape {
        let corner = |i: u32| (0..3).map(move |axis| if i >> axis & 1 == 1 { half } else { -half });
        form(ShapeKind::ConvexHull { points: (0..8).map(|i| corner(i).collect()).collect() }, 3)
    }

    #[test]
    fn depths_equal_the_formulas_at_all_sizes() {
        for size in [1e-3, 1.0, 1e3] {
            let ball = form(ShapeKind::Sphere { radius: size }, 3);
            let capsule = form(ShapeKind::Capsule { radius: size, half_height: size }, 3);
            let can = form(ShapeKind::Cylinder { radius: size, half_height: size }, 3);
            let (cube, hull) = (cube(size, 3), hull(size));
            for (a, b, touching) in [
                (&ball, &ball, 2.0),
                (&cube, &cube, 2.0),
                (&hull, &cube, 2.0),
                (&hull, &hull, 2.0),
                (&ball, &hull, 2.0),
                (&capsule, &cube, 3.0),
                (&can, &hull, 2.0),
                (&can, &can, 2.0),
            ] {
                for part in [-0.1, 1e-4, 0.02, 0.3] {
                    let apart = (touching - part) * size;
                    let found = depth(a, b, [0.0, apart, 0.0]) / size;
                    let right = f64::max(part, 0.0);
                    assert!((found - right).abs() < 2e-6, "{size}: {found} for {right}");
                }
            }
        }
    }

    #[test]
    fn shapes_of_the_plane_do_not_part_along_z() {
        let points = vec![vec![-1.0, -1.0], vec![1.0, -1.0], vec![0.0, 1.0]];
        let triangle = form(ShapeKind::ConvexHull { points }, 2);
        let square = cube(1.0, 2);
        let found = depth(&square, &square, [0.0, 0.3, 0.0]);
        assert!((found - 1.7).abs() < 1e-6, "{found}");
        let found = depth(&square, &triangle, [0.0, 1.95, 0.0]);
        assert!((found - 0.05).abs() < 1e-6, "{found}");
        assert!((square.thickness - 2.0).abs() < 1e-12 && square.reach < 1.5);
    }

    #[test]
    fn a_mesh_and_a_plane_are_measured_from_their_surface() {
        let vertices = vec![[-2.0, 0.0, -2.0], [2.0, 0.0, -2.0], [2.0, 0.0, 2.0], [-2.0, 0.0, 2.0]];
        let triangles = vec![[0, 2, 1], [0, 3, 2]];
        let sheet = form(
            ShapeKind::Trimesh { vertices, triangles, decomposition: None, vertex_track: None },
            3,
        );
        let plane = form(ShapeKind::Halfspace { normal: vec![0.0, 1.0, 0.0] }, 3);
        for floor in [&sheet, &plane] {
            for (thing, half) in [(cube(0.1, 3), 0.1), (hull(0.2), 0.2)] {
                let found = depth(floor, &thing, [0.3, half - 0.01, 0.2]);
                assert!((found - 0.01).abs() < 1e-6, "{found}");
                assert!(depth(floor, &thing, [0.3, half + 0.01, 0.2]) == 0.0);
            }
        }
    }
}
