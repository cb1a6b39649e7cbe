//! Convex hulls with flat faces.

use std::collections::HashMap;
use std::ops::Range;

use drystone_solver::{SymmetricMatrix, Vector, moment};

use super::solid::{Corner, Polyhedron, Solid};
use super::{MassProperties, convex};

/// Largest distance of a corner from the plane of its face, as a fraction of the hull's largest
/// side. \[1\] Flat faces in files have rounding errors up to this. A larger tolerance would let
/// bodies on the face penetrate.
const FLAT: f32 = 1e-4;

/// Largest distance of a corner from the plane of its face, as a fraction of the hull's thickness.
/// \[1\] Faces of a thin hull are close to each other.
const FLAT_OF_THICKNESS: f32 = 1e-2;

/// Number of points that the search for the farthest point handles at once.
const BLOCK: usize = 8;

/// A convex hull as a [`Solid`].
#[derive(Clone, Debug)]
pub struct Hull {
    points: Vec<Vector<f32, 3>>,
    /// The points as a structure of arrays; the last block is filled up with the last point.
    blocks: Vec<[[f32; BLOCK]; 3]>,
    faces: Vec<HullFace>,
    /// Corners of all faces, face by face, counter-clockwise seen from outside.
    corners: Vec<u32>,
    edges: Vec<[u32; 2]>,
    /// Edges around all faces, face by face.
    sides: Vec<u32>,
    /// The two faces at each edge.
    flanks: Vec<[u32; 2]>,
}

#[derive(Clone, Debug)]
struct HullFace {
    normal: Vector<f32, 3>,
    /// The point of the hull that is farthest along the normal: no point is beyond the plane
    /// through it.
    outermost: Vector<f32, 3>,
    corners: Range<usize>,
    sides: Range<usize>,
}

impl Hull {
    /// Builds the hull of points \[m\]. Returns `None` if they span no volume, or less than single
    /// precision can resolve.
    pub(super) fn of(points: &[parry3d::math::Vector]) -> Option<Self> {
        let HullSurface { points, triangles } = HullSurface::around(points)?;
        let block = |some: &[Vector<f32, 3>]| {
            std::array::from_fn(|axis| std::array::from_fn(|i| some[i.min(some.len() - 1)][axis]))
        };
        let blocks = points.chunks(BLOCK).map(block).collect();
        let (faces, corners, edges, sides) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let flanks = Vec::new();
        let mut hull = Self { points, blocks, faces, corners, edges, sides, flanks };
        hull.join(&triangles);
        hull.find_sides();
        // A solid has at least four faces.
        let flat = |face: &HullFace| !face.normal.dot(face.normal).is_finite();
        (hull.faces.len() >= 4 && !hull.faces.iter().any(flat)).then_some(hull)
    }

    /// Makes faces of the triangles of the surface, joining coplanar ones.
    fn join(&mut self, triangles: &[[u32; 3]]) {
        let at = |corner: u32| self.points[corner as usize];
        let axes = [0, 1, 2].map(|axis| Vector(std::array::from_fn(|i| (i == axis) as u8 as f32)));
        let sides = axes.map(|axis| axis.dot(self.support(axis) - self.support(-axis)));
        let size = sides.into_iter().fold(0.0, f32::max);
        let near = (FLAT * size).min(FLAT_OF_THICKNESS * thickness(&self.points, triangles));
        let areas: Vec<_> = triangles.iter().map(|t| area(&t.map(at))).collect();
        let mut of_edge = HashMap::new();
        for (index, &[a, b, c]) in triangles.iter().enumerate() {
            of_edge.extend([[a, b], [b, c], [c, a]].map(|edge| (edge, index)));
        }
        // Start with the largest triangles. Slivers have no reliable plane, so they join larger
        // ones.
        let mut order: Vec<usize> = (0..triangles.len()).collect();
        order.sort_by(|&a, &b| areas[b].length().total_cmp(&areas[a].length()));
        let mut free = vec![true; triangles.len()];
        for seed in order {
            let length = areas[seed].length();
            let normal = areas[seed] * (1.0 / length);
            let plane = at(triangles[seed][0]);
            let out = |point: Vector<f32, 3>| normal.dot(point - plane);
            if !free[seed] || length <= 0.0 || out(self.support(normal)) > near {
                continue;
            }
            free[seed] = false;
            let mut around = triangles[seed].to_vec();
            let mut side = 0;
            while side < around.len() {
                let [from, to] = [around[side], around[(side + 1) % around.len()]];
                let beyond = of_edge.get(&[to, from]).copied().filter(|&beyond| {
                    let flat = triangles[beyond].iter().all(|&c| out(at(c)).abs() <= near);
                    free[beyond] && flat && areas[beyond].dot(normal) >= 0.0
                });
                if let Some(beyond) = beyond {
                    free[beyond] = false;
                    let apex = triangles[beyond].into_iter().filter(|&c| c != from && c != to);
                    around.splice(side + 1..side + 1, apex);
                } else {
                    side += 1;
                }
            }
            cut_spurs(&mut around);
            let area = area(&around.iter().map(|&c| at(c)).collect::<Vec<_>>());
            let normal = area * (1.0 / area.length());
            let outermost = self.support(normal);
            let start = self.corners.len();
            let ends = around.iter().zip(around.iter().cycle().skip(1));
            // Each edge occurs in two faces, in opposite directions.
            self.edges.extend(ends.filter(|(from, to)| from < to).map(|(&from, &to)| [from, to]));
            self.corners.extend(around);
            let corners = start..self.corners.len();
            self.faces.push(HullFace { normal, outermost, corners, sides: 0..0 });
        }
    }

    /// Finds the edges around each face, and the faces at each edge.
    fn find_sides(&mut self) {
        let numbers: HashMap<_, _> = self.edges.iter().copied().zip(0..).collect();
        self.flanks = vec![[u32::MAX; 2]; self.edges.len()];
        for (number, face) in self.faces.iter_mut().enumerate() {
            let around = &self.corners[face.corners.clone()];
            let ends = around.iter().zip(around.iter().cycle().skip(1));
            let start = self.sides.len();
            self.sides.extend(ends.filter_map(|(a, b)| numbers.get(&[*a.min(b), *a.max(b)])));
            face.sides = start..self.sides.len();
            for &side in &self.sides[face.sides.clone()] {
                let [first, second] = &mut self.flanks[side as usize];
                *second = number as u32;
                *first = (*first).min(number as u32);
            }
        }
    }
}

/// Error message for hulls without volume.
pub(crate) const NO_VOLUME: &str =
    "a hull of these points has no volume; give points that do not lie in one plane";
/// Error message for hulls that are too thin.
pub(crate) const TOO_THIN: &str = "a hull of these points is more than 10000 times as long as \
    thick, too slender for single precision; check for a distant point, or use a box or capsule";

/// A hull thinner than this fraction of its size is refused. \[1\]
const THINNEST: f32 = 1e-4;

/// A closed surface of triangles around a solid.
pub(crate) struct HullSurface {
    /// Vertices. \[m\]
    points: Vec<Vector<f32, 3>>,
    /// Counter-clockwise seen from outside.
    triangles: Vec<[u32; 3]>,
}

impl HullSurface {
    /// Builds the convex hull of points \[m\]. Returns `None` if they span no volume.
    fn around(points: &[parry3d::math::Vector]) -> Option<Self> {
        let all: Vec<Vector<f32, 3>> = points.iter().map(|p| Vector(p.to_array())).collect();
        let mut triangles = convex::hull(&all)?;
        // Keep the points that are corners, in their order.
        let mut numbers = vec![u32::MAX; all.len()];
        triangles.iter().flatten().for_each(|&corner| numbers[corner as usize] = 0);
        let mut points = Vec::new();
        for (number, point) in numbers.iter_mut().zip(all).filter(|(number, _)| **number == 0) {
            *number = points.len() as u32;
            points.push(point);
        }
        triangles.iter_mut().flatten().for_each(|corner| *corner = numbers[*corner as usize]);
        Some(Self { points, triangles })
    }

    /// Returns mass, center of mass and inertia of the enclosed solid. They are sums over the
    /// tetrahedra from one point to each triangle. (parry converts the inertia to principal axes
    /// and back, with sines that differ between machines.)
    fn mass(&self, density: f32) -> MassProperties<3, 3> {
        let Self { points, triangles } = self;
        let at =
            |corner: u32| -> Vector<f64, 3> { Vector((points[corner as usize].0).map(f64::from)) };
        let origin = at(0);
        let (mut volume, mut first, mut second) = (0.0, Vector::ZERO, [[0.0; 3]; 3]);
        for corners in triangles {
            let [a, b, c] = corners.map(|corner| at(corner) - origin);
            let area: Vector<f64, 3> = moment(b, c);
            let (own, sum) = (a.dot(area) / 6.0, a + b + c);
            volume += own;
            first += sum * (own / 4.0);
            for i in 0..3 {
                for j in 0..3 {
                    let squares = a[i] * a[j] + b[i] * b[j] + c[i] * c[j];
                    second[i][j] += own / 20.0 * (squares + sum[i] * sum[j]);
                }
            }
        }
        if volume <= 0.0 {
            return MassProperties::ZERO;
        }
        let (center, density) = (first * (1.0 / volume), f64::from(density));
        let about = |i: usize, j: usize| second[i][j] - volume * center[i] * center[j];
        let trace = about(0, 0) + about(1, 1) + about(2, 2);
        let mut inertia = SymmetricMatrix::ZERO;
        for i in 0..3 {
            for j in 0..3 {
                let diagonal = if i == j { trace } else { 0.0 };
                inertia.0[i][j] = (density * (diagonal - about(i, j))) as f32;
            }
        }
        MassProperties {
            mass: (density * volume) as f32,
            center: Vector((origin + center).0.map(|x| x as f32)),
            inertia,
        }
    }
}

/// Returns the convex hull of points \[m\] as a shape.
///
/// # Errors
/// Fails if the hull has no volume or is too thin.
pub fn shape(
    points: &[parry3d::math::Vector],
) -> Result<parry3d::shape::SharedShape, &'static str> {
    use parry3d::shape::SharedShape;
    let surface = HullSurface::around(points).ok_or(NO_VOLUME)?;
    let bounds = surface.points.iter().fold([surface.points[0]; 2], |[low, high], point| {
        let both = |of: Vector<f32, 3>, choose: fn(f32, f32) -> f32| {
            Vector(std::array::from_fn(|i| choose(of[i], point[i])))
        };
        [both(low, f32::min), both(high, f32::max)]
    });
    if thickness(&surface.points, &surface.triangles) < THINNEST * (bounds[1] - bounds[0]).length()
    {
        return Err(TOO_THIN);
    }
    let corners: Vec<parry3d::math::Vector> =
        surface.points.iter().map(|point| point.0.into()).collect();
    SharedShape::convex_mesh(corners.clone(), &surface.triangles)
        .or_else(|| SharedShape::convex_hull(&corners))
        .filter(|_| surface.mass(1.0).mass > 0.0)
        .ok_or(NO_VOLUME)
}

/// Returns three times the volume over the surface. \[m\] For a ball or cube it is half of the
/// thickness, for a plate 1.5 times the thickness.
fn thickness(points: &[Vector<f32, 3>], triangles: &[[u32; 3]]) -> f32 {
    let at = |corner: u32| -> Vector<f64, 3> {
        let arm = points[corner as usize] - points[0];
        Vector(arm.0.map(f64::from))
    };
    let (mut volume, mut surface) = (0.0, 0.0);
    for corners in triangles {
        let [a, b, c] = corners.map(at);
        let area: Vector<f64, 3> = moment(b - a, c - a);
        volume += a.dot(area) / 6.0;
        surface += 0.5 * area.length();
    }
    if surface > 0.0 { (3.0 * volume / surface) as f32 } else { 0.0 }
}

/// Returns mass, center of mass and inertia of the hull of points \[m\].
pub(super) fn mass(points: &[parry3d::math::Vector], density: f32) -> MassProperties<3, 3> {
    HullSurface::around(points).map_or(MassProperties::ZERO, |surface| surface.mass(density))
}

/// Returns mass, center of mass and inertia of the solid within a closed surface of triangles,
/// which are counter-clockwise seen from outside.
pub fn mass_within(
    points: &[parry3d::math::Vector],
    triangles: &[[u32; 3]],
    density: f32,
) -> MassProperties<3, 3> {
    let points = points.iter().map(|point| Vector(point.to_array())).collect();
    HullSurface { points, triangles: triangles.to_vec() }.mass(density)
}

/// Returns the normal of a polygon, of twice its area in length.
fn area(corners: &[Vector<f32, 3>]) -> Vector<f32, 3> {
    let mut area = Vector::ZERO;
    for pair in corners.windows(2) {
        area += moment(pair[0] - corners[0], pair[1] - corners[0]);
    }
    area
}

/// Removes spurs, which go along an edge and back, from a closed polygon. Joining all triangles
/// around a point leaves them.
fn cut_spurs(around: &mut Vec<u32>) {
    let mut at = 0;
    while around.len() > 3 && at < around.len() {
        if around[at] == around[(at + 2) % around.len()] {
            around.rotate_left(at);
            around.drain(1..3);
            at = 0;
        } else {
            at += 1;
        }
    }
}

impl Solid<3> for Hull {
    fn support(&self, direction: Vector<f32, 3>) -> Vector<f32, 3> {
        let mut most = [f32::NEG_INFINITY; BLOCK];
        let mut block_of = [0u32; BLOCK];
        for (index, [x, y, z]) in self.blocks.iter().enumerate() {
            for i in 0..BLOCK {
                let along = x[i] * direction[0] + y[i] * direction[1] + z[i] * direction[2];
                let better = along > most[i];
                most[i] = if better { along } else { most[i] };
                block_of[i] = if better { index as u32 } else { block_of[i] };
            }
        }
        let mut best = 0;
        for i in 1..BLOCK {
            if most[i] > most[best] || most[i] == most[best] && block_of[i] < block_of[best] {
                best = i;
            }
        }
        let [x, y, z] = &self.blocks[block_of[best] as usize];
        Vector([x[best], y[best], z[best]])
    }

    fn faces(&self) -> usize {
        self.faces.len()
    }

    fn face(&self, index: usize) -> (Vector<f32, 3>, Vector<f32, 3>) {
        let face = &self.faces[index];
        (face.normal, face.outermost)
    }

    fn edges(&self) -> usize {
        self.edges.len()
    }

    fn edge(&self, index: usize) -> [Vector<f32, 3>; 2] {
        self.edges[index].map(|end| self.points[end as usize])
    }

    fn around(&self, face: usize) -> impl Iterator<Item = usize> {
        self.sides[self.faces[face].sides.clone()].iter().map(|&edge| edge as usize)
    }

    fn corners(&self, face: usize, out: &mut Vec<Corner<3>>) {
        for &corner in &self.corners[self.faces[face].corners.clone()] {
            out.push(Corner::new(self.points[corner as usize], corner));
        }
    }
}

impl Polyhedron for Hull {
    fn vertices(&self, out: &mut Vec<Vector<f32, 3>>) {
        out.extend_from_slice(&self.points);
    }

    fn ends(&self, edge: usize) -> [usize; 2] {
        self.edges[edge].map(|end| end as usize)
    }

    fn flanks(&self, edge: usize) -> [usize; 2] {
        self.flanks[edge].map(|face| face as usize)
    }
}

#[cfg(test)]
mod tests;
