//! Triangle meshes.

use std::collections::HashSet;

use super::super::description::{Motion, ShapeKind};
use super::math::{self, Mat3, Vec3};
use super::transform::Affine;
use crate::solid_mesh::{DecompositionOptions, is_solid};

/// Triangles, counter-clockwise seen from outside.
#[derive(Clone, Debug, Default)]
pub(crate) struct Triangles {
    pub(crate) vertices: Vec<Vec3>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl Triangles {
    /// Appends other triangles, transformed by `map`. A reflection reverses their orientation.
    /// Returns `None` if an index overflows.
    pub(crate) fn append(&mut self, other: &Self, map: &Affine) -> Option<()> {
        let base = u32::try_from(self.vertices.len()).ok()?;
        let flip = math::determinant(map.linear) < 0.0;
        self.vertices.extend(other.vertices.iter().map(|v| map.point(*v)));
        for [a, b, c] in &other.triangles {
            let [a, b, c] = [a.checked_add(base)?, b.checked_add(base)?, c.checked_add(base)?];
            self.triangles.push(if flip { [a, c, b] } else { [a, b, c] });
        }
        Some(())
    }

    /// Returns the triangles transformed by `map`.
    pub(crate) fn moved(&self, map: &Affine) -> Self {
        let mut moved = Self::default();
        // No index overflows in an empty mesh.
        let _ = moved.append(self, map);
        moved
    }

    /// Returns the points without duplicates, in their order.
    pub(crate) fn points(&self) -> Vec<Vec<f64>> {
        let mut seen = HashSet::new();
        // Adding zero turns -0 into 0.
        let new = |point: &&Vec3| seen.insert(point.map(|x| (x + 0.0).to_bits()));
        self.vertices.iter().filter(new).map(|point| point.to_vec()).collect()
    }
}

/// Collision shape of a mesh.
pub(crate) struct MeshCollider {
    /// The shape; `None` if no collider acts.
    pub(crate) kind: Option<ShapeKind>,
    /// Deviations from the file.
    pub(crate) notes: Vec<String>,
}

impl Triangles {
    /// Returns the shape of the triangles under the scale of their node. A dynamic body needs a
    /// volume: if the mesh encloses none, its convex hull is used.
    pub(crate) fn solid(
        &self,
        map: Mat3,
        convex: bool,
        decomposition: Option<DecompositionOptions>,
        motion: Motion,
    ) -> MeshCollider {
        let nothing = |why: &str| MeshCollider { kind: None, notes: vec![why.to_owned()] };
        if map.iter().flatten().all(|x| *x == 0.0) {
            return nothing("no collider acts: its node has scale 0, which disables it");
        }
        let moved = self.moved(&Affine { linear: map, shift: [0.0; 3] });
        if moved.triangles.is_empty() {
            return nothing("no collider acts: its mesh has no triangles");
        }
        let mut notes = Vec::new();
        let dynamic = motion == Motion::Dynamic;
        let unsolid =
            is_solid(&moved.vertices, &moved.triangles).err().filter(|_| dynamic && !convex);
        if convex || unsolid.is_some() {
            let flat = flat(&moved.vertices);
            if dynamic && flat {
                return nothing(
                    "no collider acts: its mesh is flat, and a moving body needs a volume",
                );
            }
            if let Some(why) = unsolid {
                notes.push(format!(
                    "collider: a convex hull stands for the mesh of a moving body, whose hollows are \
                     filled: {why}"
                ));
            }
            if !flat {
                return MeshCollider {
                    kind: Some(ShapeKind::ConvexHull { points: moved.points() }),
                    notes,
                };
            }
            notes.push("collider: its mesh is flat and stays a mesh".to_owned());
        }
        let Triangles { vertices, triangles } = moved;
        let kind = ShapeKind::Trimesh { vertices, triangles, decomposition, vertex_track: None };
        MeshCollider { kind: Some(kind), notes }
    }
}

/// Returns true if all points lie in a plane, within 1e-6 of their extent.
fn flat(points: &[Vec3]) -> bool {
    let farthest = |measure: &dyn Fn(Vec3) -> f64| {
        points.iter().copied().max_by(|a, b| measure(*a).total_cmp(&measure(*b)))
    };
    let Some(origin) = points.first().copied() else { return true };
    let from = |p: Vec3| math::sub(p, origin);
    let Some(a) = farthest(&|p| math::length(from(p))).map(from) else { return true };
    let Some(b) = farthest(&|p| math::length(math::cross(a, from(p)))).map(from) else {
        return true;
    };
    let Some(normal) = math::unit(math::cross(a, b)) else { return true };
    let height = points.iter().fold(0.0_f64, |most, p| most.max(math::dot(normal, from(*p)).abs()));
    height <= 1e-6 * math::length(a)
}
