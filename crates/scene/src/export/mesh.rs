//! Triangle meshes of shapes for drawing, in two tones that make rotation visible.

use std::collections::HashMap;

use crate::description::ShapeKind;
use crate::engine::{Engine, Hull};

/// Half the thickness of 2D shapes. \[m\]
pub(super) const HALF_DEPTH: f64 = 0.25;
/// Half the side of a drawn plane. \[m\]
pub(super) const HALF_PLANE: f64 = 20.0;
/// Number of edges around a circle.
const SECTORS: usize = 24;
/// Number of edges from a pole to the equator.
const RINGS: usize = 8;

/// Triangles, counter-clockwise seen from outside.
#[derive(Default)]
pub(super) struct Mesh {
    pub(super) positions: Vec<[f32; 3]>,
    /// Unit normals. Without any, faces are shaded flat.
    pub(super) normals: Vec<[f32; 3]>,
    /// True if each vertex has the second tone. Without any, all vertices have the first.
    pub(super) tones: Vec<bool>,
    pub(super) indices: Vec<u32>,
}

type Point = [f64; 3];

impl Mesh {
    fn vertex(&mut self, position: Point, normal: Point, tone: bool) -> u32 {
        self.positions.push(position.map(|x| x as f32));
        self.normals.push(normalized(normal).map(|x| x as f32));
        self.tones.push(tone);
        self.positions.len() as u32 - 1
    }

    /// Adds a flat convex face.
    fn face(&mut self, corners: &[Point], tone: bool) {
        let normal = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
        let ids: Vec<u32> = corners.iter().map(|p| self.vertex(*p, normal, tone)).collect();
        for pair in ids[1..].windows(2) {
            self.indices.extend([ids[0], pair[0], pair[1]]);
        }
    }
}

/// Returns the mesh of a shape before scaling by [`scale_of`]: spheres of all sizes share one mesh,
/// and so do boxes.
pub(super) fn mesh_of(kind: &ShapeKind, dimension: usize, engine: &dyn Engine) -> Mesh {
    if dimension == 2 {
        return extrude(&outline(kind));
    }
    match kind {
        ShapeKind::Sphere { .. } => revolve(&[arc(1.0, 0.0, -1.0), arc(1.0, 0.0, 1.0)]),
        ShapeKind::Box { .. } => cube(),
        ShapeKind::Capsule { radius, half_height } => {
            let mut lower = arc(*radius, -half_height, -1.0);
            let mut upper = arc(*radius, *half_height, 1.0);
            if *half_height > 0.0 {
                lower.push(([*radius, 0.0], [1.0, 0.0]));
                upper.insert(0, ([*radius, 0.0], [1.0, 0.0]));
            }
            revolve(&[lower, upper])
        }
        ShapeKind::Cylinder { radius: r, half_height: h } => revolve(&[
            vec![([0.0, -h], [0.0, -1.0]), ([*r, -h], [0.0, -1.0])],
            vec![([*r, -h], [1.0, 0.0]), ([*r, 0.0], [1.0, 0.0])],
            vec![([*r, 0.0], [1.0, 0.0]), ([*r, *h], [1.0, 0.0])],
            vec![([*r, *h], [0.0, 1.0]), ([0.0, *h], [0.0, 1.0])],
        ]),
        ShapeKind::ConvexHull { points } => hull(points, engine),
        ShapeKind::Halfspace { normal } => plane([normal[0], normal[1], normal[2]]),
        ShapeKind::Trimesh { vertices, triangles, .. } => Mesh {
            positions: vertices.iter().map(|v| v.map(|x| x as f32)).collect(),
            indices: triangles.as_flattened().to_vec(),
            ..Mesh::default()
        },
    }
}

/// Returns the scale to apply to the mesh of a shape.
pub(super) fn scale_of(kind: &ShapeKind, dimension: usize) -> [f64; 3] {
    match kind {
        ShapeKind::Sphere { radius } if dimension == 2 => [*radius, *radius, 1.0],
        ShapeKind::Sphere { radius } => [*radius; 3],
        ShapeKind::Box { half_extents: h } => [h[0], h[1], if dimension == 2 { 1.0 } else { h[2] }],
        _ => [1.0; 3],
    }
}

/// Returns the key of a shape's mesh; shapes with equal keys share it.
pub(super) fn key_of(kind: &ShapeKind) -> Vec<u64> {
    let bits = |x: &[f64]| -> Vec<u64> { x.iter().map(|x| x.to_bits()).collect() };
    let (tag, mut key) = match kind {
        ShapeKind::Sphere { .. } => (0, vec![]),
        ShapeKind::Box { .. } => (1, vec![]),
        ShapeKind::Capsule { radius, half_height } => (2, bits(&[*radius, *half_height])),
        ShapeKind::Cylinder { radius, half_height } => (3, bits(&[*radius, *half_height])),
        ShapeKind::ConvexHull { points } => (4, points.iter().flat_map(|p| bits(p)).collect()),
        ShapeKind::Halfspace { normal } => (5, bits(normal)),
        ShapeKind::Trimesh { vertices, triangles, vertex_track, .. } => {
            let corners = triangles.as_flattened().iter().map(|i| u64::from(*i));
            let mut key: Vec<_> =
                bits(vertices.as_flattened()).into_iter().chain(corners).collect();
            if let Some(track) = vertex_track {
                key.extend(bits(&track.times));
                key.extend(track.points.iter().flat_map(|points| bits(points.as_flattened())));
            }
            (6, key)
        }
    };
    key.push(tag);
    key
}

/// A point of a profile and its normal, each as distance from the axis and height.
type Rim = ([f64; 2], [f64; 2]);

/// Returns a quarter circle about the axis at a height, given from bottom to top. It is the lower
/// quarter if `side` is -1, the upper one if it is 1.
fn arc(radius: f64, height: f64, side: f64) -> Vec<Rim> {
    let rim = |i: usize| {
        let part = i as f64 / RINGS as f64;
        let angle = std::f64::consts::FRAC_PI_2 * if side < 0.0 { part - 1.0 } else { part };
        let (mut cos, sin) = (libm::cos(angle), libm::sin(angle));
        if cos < 1e-9 {
            cos = 0.0;
        }
        ([radius * cos, height + radius * sin], [cos, sin])
    };
    (0..=RINGS).map(rim).collect()
}

/// Revolves profiles, given from bottom to top, about the y axis. Tones alternate by profile and by
/// quarter.
fn revolve(profiles: &[Vec<Rim>]) -> Mesh {
    let mut mesh = Mesh::default();
    for (p, profile) in profiles.iter().enumerate() {
        for quarter in 0..4 {
            revolve_patch(&mut mesh, profile, quarter, (p + quarter) % 2 == 1);
        }
    }
    mesh
}

fn revolve_patch(mesh: &mut Mesh, profile: &[Rim], quarter: usize, tone: bool) {
    let columns = SECTORS / 4;
    let turn = |[r, y]: [f64; 2], column: usize| {
        let part = (quarter * columns + column) as f64 / SECTORS as f64;
        let angle = std::f64::consts::TAU * part;
        [r * libm::cos(angle), y, -r * libm::sin(angle)]
    };
    let first = mesh.positions.len() as u32;
    for (point, normal) in profile {
        for column in 0..=columns {
            mesh.vertex(turn(*point, column), turn(*normal, column), tone);
        }
    }
    let row = columns as u32 + 1;
    for (i, pair) in profile.windows(2).enumerate() {
        for column in 0..columns as u32 {
            let a = first + i as u32 * row + column;
            let (b, c, d) = (a + 1, a + 1 + row, a + row);
            if pair[0].0[0] > 0.0 {
                mesh.indices.extend([a, b, c]);
            }
            if pair[1].0[0] > 0.0 {
                mesh.indices.extend([a, c, d]);
            }
        }
    }
}

/// Returns a box of half size 1; each side is a checkerboard of four fields.
fn cube() -> Mesh {
    let mut mesh = Mesh::default();
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            // A cyclic order of axes, reversed on the far side, keeps faces counter-clockwise.
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let (u, v) = if side > 0.0 { (u, v) } else { (v, u) };
            for (a, b) in [(-1.0, -1.0), (-1.0, 0.0), (0.0, -1.0), (0.0, 0.0)] {
                let corner = |s: f64, t: f64| {
                    let mut point = [0.0; 3];
                    (point[axis], point[u], point[v]) = (side, a + s, b + t);
                    point
                };
                let tone = (a == b) != (side > 0.0);
                let corners =
                    [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
                mesh.face(&corners, tone);
            }
        }
    }
    mesh
}

fn hull(points: &[Vec<f64>], engine: &dyn Engine) -> Mesh {
    let single: Vec<_> = points.iter().map(|p| [p[0] as f32, p[1] as f32, p[2] as f32]).collect();
    let mut mesh = Mesh::default();
    let Some(Hull { vertices, triangles }) = engine.hull(&single) else {
        return bounding_box(points);
    };
    for triangle in triangles {
        let corners = triangle.map(|i| vertices[i as usize].map(f64::from));
        let normal = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
        // The tone depends on the direction only, so that the triangles of a flat face have one
        // tone.
        let octant = normalized(normal).iter().filter(|x| **x < -1e-3).count();
        if dot(normal, normal) > 0.0 {
            mesh.face(&corners, octant % 2 == 1);
        }
    }
    if mesh.indices.is_empty() { bounding_box(points) } else { mesh }
}

/// Returns the triangles of the hull of points, as indices of the points; `None` if it has no
/// volume.
pub(super) fn hull_triangles(points: &[[f32; 3]], engine: &dyn Engine) -> Option<Vec<u32>> {
    let Hull { vertices, triangles } = engine.hull(points)?;
    let bits = |p: [f32; 3]| p.map(f32::to_bits);
    let places: HashMap<_, _> =
        points.iter().enumerate().rev().map(|(place, p)| (bits(*p), place as u32)).collect();
    let corners = triangles.iter().flatten();
    corners.map(|corner| places.get(&bits(*vertices.get(*corner as usize)?)).copied()).collect()
}

/// Returns the box that replaces a hull too thin for single precision.
fn bounding_box(points: &[Vec<f64>]) -> Mesh {
    let bound = |pick: fn(f64, f64) -> f64| -> [f64; 3] {
        std::array::from_fn(|i| points.iter().map(|p| p[i]).reduce(pick).unwrap_or(0.0))
    };
    let (low, high) = (bound(f64::min), bound(f64::max));
    let mut mesh = cube();
    for position in &mut mesh.positions {
        *position = std::array::from_fn(|i| {
            let part = f64::from(position[i]) / 2.0;
            ((low[i] + high[i]) / 2.0 + (high[i] - low[i]) * part) as f32
        });
    }
    mesh
}

fn plane(normal: Point) -> Mesh {
    // An axis that is not close to the normal.
    let across = if normal[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] };
    let v = normalized(cross(normal, across));
    let u = cross(v, normal);
    let corner =
        |a: f64, b: f64| -> Point { std::array::from_fn(|i| HALF_PLANE * (a * u[i] + b * v[i])) };
    let mut mesh = Mesh::default();
    // u × v may point along the normal or against it; the face must look along it.
    let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    let up = dot(cross(sub(corners[1], corners[0]), sub(corners[2], corners[0])), normal);
    let flipped = [corners[0], corners[3], corners[2], corners[1]];
    mesh.face(if up > 0.0 { &corners } else { &flipped }, false);
    mesh
}

/// Returns the outline of a 2D shape, counter-clockwise; disks and boxes have half size 1.
fn outline(kind: &ShapeKind) -> Vec<[f64; 2]> {
    match kind {
        ShapeKind::Sphere { .. } => half_circle(1.0, 0.0, 0.0)
            .into_iter()
            .take(SECTORS / 2)
            .chain(half_circle(1.0, 0.0, std::f64::consts::PI).into_iter().take(SECTORS / 2))
            .collect(),
        ShapeKind::Box { .. } => vec![[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]],
        ShapeKind::Capsule { radius, half_height } => {
            let mut points = half_circle(*radius, *half_height, 0.0);
            points.extend(half_circle(*radius, -half_height, std::f64::consts::PI));
            points.dedup();
            points
        }
        ShapeKind::ConvexHull { points } => {
            hull_outline(points.iter().map(|p| [p[0], p[1]]).collect())
        }
        ShapeKind::Halfspace { normal } => {
            let (x, y) = (normal[0], normal[1]);
            // A slab 1 m deep with the plane as its upper side.
            [[-HALF_PLANE, -1.0], [HALF_PLANE, -1.0], [HALF_PLANE, 0.0], [-HALF_PLANE, 0.0]]
                .map(|[a, b]| [a * y + b * x, b * y - a * x])
                .to_vec()
        }
        // These exist in 3D only.
        ShapeKind::Cylinder { .. } | ShapeKind::Trimesh { .. } => Vec::new(),
    }
}

fn half_circle(radius: f64, height: f64, start: f64) -> Vec<[f64; 2]> {
    let point = |i: usize| {
        let angle = start + std::f64::consts::TAU * i as f64 / SECTORS as f64;
        [radius * libm::cos(angle), height + radius * libm::sin(angle)]
    };
    (0..=SECTORS / 2).map(point).collect()
}

/// Returns the convex hull, by Andrew's monotone chain.
fn hull_outline(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    let half = |points: &mut dyn Iterator<Item = &[f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for &[x, y] in points {
            while let [.., a, b] = chain.as_slice()
                && (b[0] - a[0]) * (y - a[1]) <= (b[1] - a[1]) * (x - a[0])
            {
                chain.pop();
            }
            chain.push([x, y]);
        }
        chain.pop();
        chain
    };
    let mut chain = half(&mut points.iter());
    chain.extend(half(&mut points.iter().rev()));
    chain
}

/// Extrudes an outline along z; tones alternate by quarters of the outline.
fn extrude(outline: &[[f64; 2]]) -> Mesh {
    let mut mesh = Mesh::default();
    if outline.len() < 3 {
        return mesh;
    }
    let [cx, cy, _] = mean(outline.iter().map(|[x, y]| [*x, *y, 0.0]));
    for (i, [ax, ay]) in outline.iter().copied().enumerate() {
        let [bx, by] = outline[(i + 1) % outline.len()];
        let tone = (i * 4 / outline.len()) % 2 == 1;
        let d = HALF_DEPTH;
        mesh.face(&[[cx, cy, d], [ax, ay, d], [bx, by, d]], tone);
        mesh.face(&[[cx, cy, -d], [bx, by, -d], [ax, ay, -d]], tone);
        mesh.face(&[[ax, ay, -d], [bx, by, -d], [bx, by, d], [ax, ay, d]], tone);
    }
    mesh
}

fn mean(points: impl ExactSizeIterator<Item = Point>) -> Point {
    let count = points.len() as f64;
    points.fold([0.0; 3], |sum, p| std::array::from_fn(|i| sum[i] + p[i] / count))
}

fn sub(a: Point, b: Point) -> Point {
    std::array::from_fn(|i| a[i] - b[i])
}

fn dot(a: Point, b: Point) -> f64 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn normalized(a: Point) -> Point {
    let length = dot(a, a).sqrt();
    if length > 0.0 { a.map(|x| x / length) } else { [0.0, 1.0, 0.0] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An engine whose hulls are those of the first four points, one corner of a cube.
    struct Tetrahedron;

    impl Engine for Tetrahedron {
        fn hull(&self, points: &[[f32; 3]]) -> Option<Hull> {
            let triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
            Some(Hull { vertices: points[..4].to_vec(), triangles })
        }
    }

    fn double(x: [f32; 3]) -> Point {
        x.map(f64::from)
    }

    /// Returns the volume: one sixth of the sum of triple products.
    fn volume(mesh: &Mesh) -> f64 {
        let corner = |i: &u32| double(mesh.positions[*i as usize]);
        let triangles = mesh.indices.chunks(3);
        let parts = triangles.map(|t| dot(corner(&t[0]), cross(corner(&t[1]), corner(&t[2]))));
        parts.sum::<f64>() / 6.0
    }

    fn normals_look_outwards(mesh: &Mesh) -> bool {
        mesh.indices.chunks(3).all(|t| {
            let [a, b, c] = [t[0], t[1], t[2]].map(|i| double(mesh.positions[i as usize]));
            let face = cross(sub(b, a), sub(c, a));
            t.iter().all(|i| dot(face, double(mesh.normals[*i as usize])) > 0.0)
        })
    }

    fn check(kind: ShapeKind, dimension: usize, exact: f64) {
        let mesh = mesh_of(&kind, dimension, &Tetrahedron);
        assert!(normals_look_outwards(&mesh), "{kind:?}");
        let ratio = volume(&mesh) / exact;
        assert!((0.95..1.000001).contains(&ratio), "{kind:?}: {ratio}");
        assert!(mesh.tones.contains(&true) && mesh.tones.contains(&false));
    }

    #[test]
    fn solids_have_their_volume_and_look_outwards() {
        use std::f64::consts::PI;
        let points = |corners: &[[f64; 3]]| corners.iter().map(|p| p.to_vec()).collect();
        let (radius, half_height) = (0.5, 2.0);
        check(ShapeKind::Sphere { radius }, 3, 4.0 / 3.0 * PI);
        check(ShapeKind::Box { half_extents: vec![1.0; 3] }, 3, 8.0);
        check(ShapeKind::Capsule { radius, half_height }, 3, PI + PI / 6.0);
        check(ShapeKind::Capsule { radius, half_height: 0.0 }, 3, PI / 6.0);
        check(ShapeKind::Cylinder { radius, half_height }, 3, PI);
        let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.2; 3]];
        check(ShapeKind::ConvexHull { points: points(&corners) }, 3, 1.0 / 6.0);
    }

    #[test]
    fn flat_shapes_have_their_area_and_look_outwards() {
        use std::f64::consts::PI;
        let depth = 2.0 * HALF_DEPTH;
        let (radius, half_height) = (0.5, 2.0);
        check(ShapeKind::Sphere { radius }, 2, PI * depth);
        check(ShapeKind::Box { half_extents: vec![1.0; 2] }, 2, 4.0 * depth);
        check(ShapeKind::Capsule { radius, half_height }, 2, (4.0 + PI / 4.0) * depth);
        check(ShapeKind::Capsule { radius, half_height: 0.0 }, 2, PI / 4.0 * depth);
        let points = [[0.0, 0.0], [2.0, 0.0], [1.0, 0.5], [0.0, 2.0]].map(|p| p.to_vec()).to_vec();
        check(ShapeKind::ConvexHull { points }, 2, 2.0 * depth);
        check(ShapeKind::Halfspace { normal: vec![0.6, 0.8] }, 2, 40.0 * depth);
    }

    #[test]
    fn planes_look_along_their_normal() {
        for normal in [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.6, -0.8]] {
            let mesh = plane(normal);
            assert!(normals_look_outwards(&mesh));
            assert!(mesh.normals.iter().all(|n| dot(double(*n), normal) > 0.999));
            assert!(mesh.positions.iter().all(|p| dot(double(*p), normal).abs() < 1e-5));
        }
    }
}
