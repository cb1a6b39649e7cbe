//! Test whether the center of a shape passed through a surface between two frames.

use super::separation::ConvexSet;
use super::shape::{AuditMesh, CoreShape, ShapePose, SupportShape, loose};
use super::vector::{Vec3, cross, dot, minus, norm};

/// Returns true if the path of a point ends on the other side of a surface or leads through a
/// solid. Both ends are in the frame of the form, each at its own time.
pub(super) fn passes(form: &SupportShape, ends: [Vec3; 2]) -> bool {
    match &form.core {
        CoreShape::Mesh(mesh) => crossings(mesh, ends) % 2 == 1,
        CoreShape::Plane(normal) => {
            let [from, to] = ends.map(|end| dot(*normal, end));
            from >= 0.0 && to < 0.0
        }
        // A path that starts inside does not enter here.
        _ => enters(form, ends) && !enters(form, [ends[0]; 2]),
    }
}

/// Offset of a path against exact hits of vertices and edges, relative to its largest coordinate.
/// \[1\]
const ASIDE: Vec3 = [1.3e-9, 0.7e-9, 1.9e-9];

/// Counts the triangles that a segment crosses. A crossing of a shared edge counts once.
fn crossings(mesh: &AuditMesh, ends: [Vec3; 2]) -> usize {
    // The offset is negligible, and keeps the segment off vertices and edges.
    let size = ends.iter().flatten().fold(0.0f64, |size, x| size.max(x.abs()));
    let [from, to] = ends.map(|end| std::array::from_fn(|i| end[i] + size * ASIDE[i]));
    let low = std::array::from_fn(|i| from[i].min(to[i]));
    let high = std::array::from_fn(|i| from[i].max(to[i]));
    let around = loose(low, high);
    let near = mesh.tree.bvh().intersect_aabb(&around);
    near.filter(|&triangle| crosses(mesh, triangle, [from, to])).count()
}

fn crosses(mesh: &AuditMesh, triangle: u32, [from, to]: [Vec3; 2]) -> bool {
    let [a, b, c] = mesh.corners(triangle);
    let normal = cross(minus(b, a), minus(c, a));
    let side = |p: Vec3| dot(normal, minus(p, a)) >= 0.0;
    if side(from) == side(to) {
        return false;
    }
    // The side on which the segment passes an edge. The end points enter in a fixed order, so that
    // both triangles of the edge get the same answer, even for zero.
    let [i, j, k] = mesh.triangles[triangle as usize];
    let passes = |i: u32, j: u32| {
        let [p, q] = [i.min(j), i.max(j)].map(|i| mesh.points[i as usize]);
        let volume = dot(minus(to, from), cross(minus(p, from), minus(q, from)));
        (volume >= 0.0) == (i < j)
    };
    let first = passes(i, j);
    first == passes(j, k) && first == passes(k, i)
}

/// Returns true if a segment shares a point with a convex form.
fn enters(form: &SupportShape, ends: [Vec3; 2]) -> bool {
    let [from, to] = ends;
    let difference = ConvexSet {
        farthest: |n| {
            let end = if dot(from, n) < dot(to, n) { from } else { to };
            minus(form.farthest(n), end)
        },
        size: form.reach + norm(from).max(norm(to)),
    };
    difference.bounds(&[], -form.radius).high + form.radius > 0.0
}

/// Converts both ends of a path to the frame of the obstacle, which may move between the two times.
pub(super) fn seen(path: [Vec3; 2], poses: [&ShapePose; 2]) -> [Vec3; 2] {
    [poses[0].local_point(path[0]), poses[1].local_point(path[1])]
}

#[cfg(test)]
mod tests {
    use super::*;
    use drystone_scene::{Filter, Material, Rotation, Shape, ShapeKind};

    fn form(kind: ShapeKind) -> SupportShape {
        let shape = Shape {
            kind,
            position: vec![0.0; 3],
            rotation: Rotation::identity(3),
            material: Material::default(),
            surface_velocity: None,
            filter: Filter::default(),
        };
        SupportShape::new(&shape, 3).unwrap()
    }

    /// Makes a sheet of four triangles around the origin.
    fn sheet() -> SupportShape {
        let vertices = vec![
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 1.0],
            [-1.0, 0.0, 1.0],
            [-1.0, 0.0, -1.0],
            [1.0, 0.0, -1.0],
        ];
        let triangles = vec![[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4]];
        form(ShapeKind::Trimesh { vertices, triangles, decomposition: None, vertex_track: None })
    }

    #[test]
    fn a_path_through_a_sheet_is_found_at_corners_and_edges_too() {
        let sheet = sheet();
        for (x, z) in [(0.0, 0.0), (0.3, 0.3), (0.5, 0.1), (-0.2, 0.2), (0.999, 0.0)] {
            assert!(passes(&sheet, [[x, 1.0, z], [x, -1.0, z]]), "{x} {z}");
            assert!(passes(&sheet, [[x, -1e-3, z], [x + 1e-4, 1e-3, z]]), "{x} {z}");
            assert!(!passes(&sheet, [[x, 1.0, z], [x, 0.5, z]]), "{x} {z}");
        }
        assert!(!passes(&sheet, [[2.0, 1.0, 0.0], [2.0, -1.0, 0.0]]), "around it");
        assert!(!passes(&sheet, [[-3.0, 0.1, 0.0], [3.0, 0.1, 0.0]]), "along it");
    }

    #[test]
    fn a_path_through_a_solid_is_found_and_one_beside_it_is_not() {
        let wall = form(ShapeKind::Box { half_extents: vec![0.01, 1.0, 1.0] });
        assert!(passes(&wall, [[-0.5, 0.0, 0.0], [0.5, 0.1, 0.0]]));
        assert!(!passes(&wall, [[-0.5, 0.0, 0.0], [-0.011, 0.1, 0.0]]));
        assert!(!passes(&wall, [[-0.5, 1.1, 0.0], [0.5, 1.1, 0.0]]));
        assert!(!passes(&wall, [[0.0, 0.1, 0.0], [0.5, 0.1, 0.0]]), "it was inside");
        let ground = form(ShapeKind::Halfspace { normal: vec![0.0, 1.0, 0.0] });
        assert!(passes(&ground, [[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]]));
        assert!(!passes(&ground, [[0.0, -0.1, 0.0], [0.0, -0.2, 0.0]]));
    }
}
