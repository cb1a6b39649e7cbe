//! Findings about triangle meshes that do not collide as they look.

use std::collections::{BTreeMap, HashMap, HashSet};

use parry3d::math::{Pose, Vector};
use parry3d::query::intersection_test;
use parry3d::shape::{TriMesh, Triangle};

use super::{Finding, FindingKind};
use drystone_scene::{Scene, ShapeKind};

/// A mesh is meant to enclose a volume if its area vectors sum to less than this fraction of its
/// area. \[1\]
const ENCLOSES: f64 = 0.1;
/// Relative shrinkage of triangles, so that triangles that only touch do not intersect. \[1\]
const SHRINK: f32 = 1e-3;

type Vertex = [f64; 3];

/// Finds holes, meshes that are inside out, and intersecting triangles; at most one finding of each
/// kind per shape.
pub(super) fn meshes(scene: &Scene) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (index, body) in scene.bodies.iter().enumerate() {
        for shape in &body.shapes {
            let ShapeKind::Trimesh { vertices, triangles, .. } = &shape.kind else { continue };
            let mesh = WeldedMesh::new(vertices, triangles);
            let mut found = |kind, value: f64, limit: f64, what: String, advice: &str| {
                let what = format!("the mesh of {} {what}", scene.name_of(index));
                findings.push(Finding::of_body(index, kind, [value, limit], what, advice));
            };
            let [open, turned] = mesh.edges();
            if open > 0 && norm(mesh.leftover()) < ENCLOSES {
                let what = format!(
                    "has holes: {open} edges are not between two triangles; accepted: none"
                );
                let advice = "it collides from both sides, and keeps bodies inside that get in: \
                 close it, or use its convex hull";
                found(FindingKind::OpenMesh, open as f64, 0.0, what, advice);
            } else if open == 0 && turned == 0 && mesh.volume() < 0.0 {
                let volume = mesh.volume();
                let what =
                    format!("is inside out: its volume is {volume:.3e} m^3; accepted: above 0");
                let advice =
                    "it is a room, and keeps bodies inside; flip its triangles to make it a solid";
                found(FindingKind::InsideOutMesh, volume, 0.0, what, advice);
            }
            let crossing = mesh.crossings();
            if crossing > 0 {
                let what = format!(
                    "intersects itself: {crossing} pairs of triangles cross; accepted: none"
                );
                found(
                    FindingKind::CrossingMesh,
                    crossing as f64,
                    0.0,
                    what,
                    "unite its parts, or split it",
                );
            }
        }
    }
    findings
}

/// Triangles over distinct points.
struct WeldedMesh {
    points: Vec<Vertex>,
    triangles: Vec<[u32; 3]>,
}

impl WeldedMesh {
    /// Merges vertices at the same position. Drops triangles that lose a side, and copies of
    /// triangles, which double-sided meshes have.
    fn new(vertices: &[Vertex], triangles: &[[u32; 3]]) -> Self {
        let mut places = HashMap::new();
        let mut points = Vec::new();
        let mut merged = Vec::with_capacity(vertices.len());
        for vertex in vertices {
            // Adding 0.0 turns -0.0 into 0.0.
            let place = vertex.map(|x| (x + 0.0).to_bits());
            merged.push(*places.entry(place).or_insert_with(|| {
                points.push(*vertex);
                points.len() as u32 - 1
            }));
        }
        let corner = |i: u32| merged.get(i as usize).copied();
        let whole = |&[a, b, c]: &[u32; 3]| Some([corner(a)?, corner(b)?, corner(c)?]);
        let triangles = triangles.iter().filter_map(whole);
        let mut seen = HashSet::new();
        let fresh = |corners: &[u32; 3]| {
            let mut set = *corners;
            set.sort_unstable();
            set[0] != set[1] && set[1] != set[2] && seen.insert(set)
        };
        let triangles = triangles.filter(fresh).collect();
        Self { points, triangles }
    }

    fn corners(&self, triangle: &[u32; 3]) -> [Vertex; 3] {
        triangle.map(|i| self.points[i as usize])
    }

    /// Counts the edges that are not between two triangles, and the edges whose two triangles face
    /// opposite sides.
    fn edges(&self) -> [usize; 2] {
        // For each edge: number of traversals forward and backward.
        let mut passed: BTreeMap<[u32; 2], [usize; 2]> = BTreeMap::new();
        for &[a, b, c] in &self.triangles {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                let backwards = usize::from(from > to);
                passed.entry([from.min(to), from.max(to)]).or_default()[backwards] += 1;
            }
        }
        let open = passed.values().filter(|of| of[0] + of[1] != 2).count();
        let turned = passed.values().filter(|of| of[0] + of[1] == 2 && of[0] != of[1]).count();
        [open, turned]
    }

    /// Returns the sum of the area vectors divided by the area: zero for a closed surface, the unit
    /// normal for a flat one.
    fn leftover(&self) -> Vertex {
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for triangle in &self.triangles {
            let area = area(self.corners(triangle));
            sum = std::array::from_fn(|i| sum[i] + area[i]);
            total += norm(area);
        }
        sum.map(|x| if total > 0.0 { x / total } else { 0.0 })
    }

    /// Returns the signed volume. \[m^3\]
    fn volume(&self) -> f64 {
        let part = |triangle| {
            let corners = self.corners(triangle);
            (0..3).map(|i| corners[0][i] * area(corners)[i]).sum::<f64>() / 3.0
        };
        self.triangles.iter().map(part).sum()
    }

    /// Counts the pairs of triangles that intersect and share no corner.
    fn crossings(&self) -> usize {
        let single = |p: &Vertex| Vector::from(p.map(|x| x as f32));
        let points = self.points.iter().map(single).collect();
        let Ok(mesh) = TriMesh::new(points, self.triangles.clone()) else { return 0 };
        let shrunk = |triangle: &Triangle| {
            let center = (triangle.a + triangle.b + triangle.c) / 3.0;
            let towards = |p: Vector| p + (center - p) * SHRINK;
            Triangle::new(towards(triangle.a), towards(triangle.b), towards(triangle.c))
        };
        let place = Pose::IDENTITY;
        let crosses = |i: u32, j: u32| {
            let (one, other) = (self.triangles[i as usize], self.triangles[j as usize]);
            let (a, b) = (shrunk(&mesh.triangle(i)), shrunk(&mesh.triangle(j)));
            !one.iter().any(|corner| other.contains(corner))
                && intersection_test(&place, &a, &place, &b).is_ok_and(|of| of.intersecting)
        };
        let near = |i: u32| {
            let around = mesh.triangle(i).local_aabb();
            mesh.bvh().intersect_aabb(&around).filter(|&j| j > i && crosses(i, j)).count()
        };
        (0..self.triangles.len() as u32).map(near).sum()
    }
}

/// Returns the area vector of a triangle, which is normal to it. \[m^2\]
fn area([a, b, c]: [Vertex; 3]) -> Vertex {
    let [u, v]: [Vertex; 2] = [b, c].map(|p| std::array::from_fn(|i| p[i] - a[i]));
    let twice = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    twice.map(|x| 0.5 * x)
}

fn norm(v: Vertex) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}
