//! Shapes of the audit: support functions in `f64`, and the penetration depth of two shapes.

use parry3d::bounding_volume::Aabb;
use parry3d::math::Vector;
use parry3d::shape::TriMesh;
use parry3d::transformation::try_convex_hull;

use super::separation::ConvexSet;
use super::vector::{Vec3, add, cross, dot, minus, norm, scaled, unit};
use drystone_scene::{Rotation, Shape, ShapeKind};

/// Maximum number of face normals of a hull that are tried as separating directions.
const FACES: usize = 64;
/// Maximum number of triangles of a mesh that one shape is measured against.
const TRIANGLES: usize = 4096;
/// Relative margin of bounding boxes against rounding to `f32`. \[1\]
const LOOSE: f64 = 1e-6;

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
    pub(super) radius: f64,
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
    pub(super) fn farthest(&self, along: Vec3) -> Vec3 {
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

/// A form and its world pose.
pub(super) type PosedShape<'a> = (&'a SupportShape, &'a ShapePose);

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

/// Returns the penetration depth of two convex forms, an upper bound within 1e-10 of their size.
/// The difference of their cores holds their exact radii as an offset. All coordinates are relative
/// to the first form. \[m\]
fn overlap_convex(a: PosedShape<'_>, b: PosedShape<'_>) -> Option<f64> {
    let radius = a.0.radius + b.0.radius;
    let apart = minus(b.1.position, a.1.position);
    let core =
        |(form, pose): PosedShape<'_>, n| pose.direction(form.farthest(pose.local_direction(n)));
    let difference = ConvexSet {
        farthest: |n| minus(minus(core(a, n), core(b, scaled(n, -1.0))), apart),
        size: a.0.reach + b.0.reach + norm(apart),
    };
    let depth = difference.bounds(&guesses(a, b), -radius).high + radius;
    (depth.is_finite() && depth > 0.0).then_some(depth)
}

/// Returns likely directions of the least overlap: the line between the centers and the faces of
/// both forms. Each is given with both signs, since the forms may be deep in each other.
fn guesses(a: PosedShape<'_>, b: PosedShape<'_>) -> Vec<Vec3> {
    let mut lines: Vec<Vec3> = unit(minus(b.1.position, a.1.position)).into_iter().collect();
    for (form, pose) in [a, b] {
        lines.extend(form.faces.iter().map(|n| pose.direction(*n)));
    }
    lines.into_iter().flat_map(|n| [n, scaled(n, -1.0)]).collect()
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

    /// Random numbers by xorshift.
    struct Random(u64);

    impl Random {
        /// Returns a number between -1 and 1.
        fn signed(&mut self) -> f64 {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }

        fn direction(&mut self) -> Vec3 {
            loop {
                let v = [self.signed(), self.signed(), self.signed()];
                if let Some(n) = unit(v).filter(|_| norm(v) < 1.0) {
                    return n;
                }
            }
        }

        /// Returns a rotation: none, about y, by a right angle about x, or any.
        fn rotation(&mut self, kind: usize) -> [f64; 4] {
            let any = [self.signed(), self.signed(), self.signed(), self.signed()];
            let q = match kind % 4 {
                0 => FLAT,
                1 => [0.0, any[0], 0.0, any[3]],
                2 => [1.0, 0.0, 0.0, 1.0],
                _ => any,
            };
            let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
            q.map(|x| x / length)
        }

        fn shape(&mut self, kind: usize, size: f64) -> SupportShape {
            let mut length = || size * (0.55 + 0.45 * self.signed());
            form(
                match kind {
                    0 => ShapeKind::Sphere { radius: length() },
                    1 => ShapeKind::Capsule { radius: length(), half_height: length() },
                    2 => ShapeKind::Box { half_extents: (0..3).map(|_| length()).collect() },
                    3 => ShapeKind::Cylinder { radius: length(), half_height: length() },
                    _ => {
                        let mut point = || self.direction().map(|x| size * x).to_vec();
                        ShapeKind::ConvexHull { points: (0..8).map(|_| point()).collect() }
                    }
                },
                3,
            )
        }
    }

    /// Returns the overlap of two forms along a direction, an upper bound of their depth.
    fn along(a: PosedShape<'_>, b: PosedShape<'_>, n: Vec3) -> f64 {
        let reach = |(form, pose): PosedShape<'_>, n| form.support(pose.local_direction(n));
        reach(a, n) + reach(b, scaled(n, -1.0)) - dot(n, minus(b.1.position, a.1.position))
    }

    /// Returns the depth by search: the least overlap along random directions, then along ever
    /// closer ones around the best.
    fn searched(a: PosedShape<'_>, b: PosedShape<'_>, random: &mut Random) -> f64 {
        let (mut least, mut best, mut step) = (f64::INFINITY, [0.0; 3], 0.1);
        for round in 0..900 {
            let aside = random.direction();
            let near = unit(std::array::from_fn(|i| best[i] + step * aside[i]));
            let n = near.filter(|_| round >= 300).unwrap_or(aside);
            let found = along(a, b, n);
            if found < least {
                (least, best) = (found, n);
            } else if round >= 300 {
                step = f64::max(step * 0.97, 1e-7);
            }
        }
        least
    }

    /// Returns the depth of two overlapping polyhedra: the least overlap along the normals of all
    /// planes through three corners of one, or through an edge of each.
    fn by_planes(a: PosedShape<'_>, b: PosedShape<'_>) -> f64 {
        let corners = |(form, pose): PosedShape<'_>| match &form.core {
            CoreShape::Points(points) => points.iter().map(|p| pose.direction(*p)).collect(),
            _ => Vec::new(),
        };
        let [p, q] = [a, b].map(corners);
        let edges = |p: &[Vec3]| -> Vec<Vec3> {
            let to = |i: usize| (0..i).map(move |j| (i, j));
            (0..p.len()).flat_map(to).filter_map(|(i, j)| unit(minus(p[i], p[j]))).collect()
        };
        let [edges_a, edges_b] = [edges(&p), edges(&q)];
        let mut least = f64::INFINITY;
        for (first, second) in [(&edges_a, &edges_b), (&edges_a, &edges_a), (&edges_b, &edges_b)] {
            for (x, y) in first.iter().flat_map(|x| second.iter().map(move |y| (*x, *y))) {
                // A nearly parallel pair spans no plane.
                let normal = unit(cross(x, y)).filter(|_| norm(cross(x, y)) > 1e-9);
                for n in normal.into_iter().flat_map(|n| [n, scaled(n, -1.0)]) {
                    least = least.min(along(a, b, n));
                }
            }
        }
        least
    }

    /// Depths of all pairs of convex shapes, from 1 mm to 100 m and far from the origin: apart,
    /// touching, crossed and deep. None is larger than along any direction that a search finds, and
    /// those of polyhedra are exact.
    #[test]
    fn no_depth_is_invented_and_none_is_missed() {
        let mut random = Random(0x1234_5678_9abc_def1);
        let gaps = [0.0, 1e-9, -1e-9, 1e-6, -1e-6, 1e-4, -1e-4, 1e-2, -1e-2, 0.3, 2.0];
        let kinds = (0..5).flat_map(|a| (a..5).map(move |b| [a, b]));
        for (kinds, round) in kinds.flat_map(|kinds| (0..66).map(move |round| (kinds, round))) {
            let size = [1e-3, 1.0, 100.0][round % 3];
            let sizes = [size, size * [1.0, 1e-2, 30.0][round / 3 % 3]];
            let a = random.shape(kinds[0], sizes[0]);
            let b = random.shape(kinds[1], sizes[1]);
            let origin = if round % 5 == 0 { [3e3 * size, -2e3 * size, 0.0] } else { [0.0; 3] };
            let first = ShapePose::new(origin, random.rotation(round));
            let mut second = ShapePose::new(origin, random.rotation(round / 2));
            let n = if round % 2 == 0 { random.direction() } else { first.axes[round / 2 % 3] };
            // The overlap along n is `gap`, or more if they only touch elsewhere.
            let far = along((&a, &first), (&b, &second), n);
            let gap = gaps[round % gaps.len()] * sizes[0].min(sizes[1]);
            second.position = add(origin, scaled(n, f64::max(far - gap, 0.0)));
            let (x, y) = ((&a, &first), (&b, &second));
            let found = overlap(x, y).unwrap_or(0.0);
            let slack = 1e-9 * (sizes[0] + sizes[1]);
            let most = searched(x, y, &mut random);
            assert!(found <= f64::max(most, 0.0) + slack, "{kinds:?} {round}: {found}, {most}");
            if kinds.iter().all(|kind| [2, 4].contains(kind)) {
                let right = f64::max(by_planes(x, y), 0.0);
                assert!((found - right).abs() < slack, "{kinds:?} {round}: {found} for {right}");
            }
        }
    }

    /// Two capsules whose axes cross at a distance, and capsules that are end to end.
    #[test]
    fn depths_of_capsules_follow_from_the_distance_of_their_axes() {
        for size in [1e-3, 1.0, 100.0] {
            let capsule = form(ShapeKind::Capsule { radius: 0.05 * size, half_height: size }, 3);
            for depth in [1e-8, 1e-5, 1e-3, 0.05, 0.0999, 0.1 - 1e-9].map(|x| x * size) {
                let away = 0.1 * size - depth;
                let still = ShapePose::new([0.0; 3], FLAT);
                let half = std::f64::consts::FRAC_1_SQRT_2;
                for (place, rotation) in [
                    ([away, 0.1 * size, 0.0], [half, 0.0, 0.0, half]),
                    ([away, 0.7 * size, 0.0], [0.1f64.sqrt(), 0.0, 0.0, 0.9f64.sqrt()]),
                    ([away, 0.3 * size, 0.0], FLAT),
                    ([0.0, 2.0 * size + away, 0.0], FLAT),
                ] {
                    let pose = ShapePose::new(place, rotation);
                    let found = overlap((&capsule, &still), (&capsule, &pose)).unwrap();
                    assert!((found - depth).abs() < 1e-9 * size, "{size}: {found} for {depth}");
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
