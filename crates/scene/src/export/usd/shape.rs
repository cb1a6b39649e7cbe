//! Shapes as prims of UsdGeom with colliders.

use std::fmt::Display;

use super::super::color::{color_of, linear};
use super::super::mesh::{self, mesh_of, scale_of};
use super::prim::{PrimWriter, list, space, tuple};
use crate::description::{Motion, Rotation, Shape, ShapeKind, SurfaceVelocity};
use crate::engine::Engine;
use crate::graph::math::{from_up, quat_mul};
use crate::graph::seen_from;

/// Thickness of 2D shapes. \[m\]
pub(super) const THICKNESS: f64 = 2.0 * mesh::HALF_DEPTH;

/// Properties that the look of a shape depends on besides its form.
pub(super) struct Look<'a> {
    pub(super) dimension: usize,
    /// Index of the body.
    pub(super) body: usize,
    pub(super) motion: Motion,
    pub(super) engine: &'a dyn Engine,
}

/// Returns the prim of shape `number` of a body.
pub(super) fn prim(look: &Look<'_>, shape: &Shape, number: usize) -> PrimWriter {
    let name = format!("Shape_{number}");
    let Look { dimension, body, motion, .. } = *look;
    let (position, mut rotation) = (space(&shape.position), shape.rotation.quaternion());
    let mut scale = [1.0; 3];
    let mut prim = match &shape.kind {
        kind if dimension == 2 => {
            scale = scale_of(kind, dimension);
            faces(&name, kind, look)
        }
        ShapeKind::Sphere { radius } => {
            let mut prim = PrimWriter::new("Sphere", name);
            prim.set("double radius", radius);
            prim.set("float3[] extent", extent([*radius; 3]));
            prim
        }
        ShapeKind::Box { half_extents } => {
            scale = space(half_extents);
            let mut prim = PrimWriter::new("Cube", name);
            prim.set("double size", 2);
            prim.set("float3[] extent", extent([1.0; 3]));
            prim
        }
        ShapeKind::Capsule { radius, half_height } => {
            round("Capsule", name, *radius, *half_height, half_height + radius)
        }
        ShapeKind::Cylinder { radius, half_height } => {
            round("Cylinder", name, *radius, *half_height, *half_height)
        }
        ShapeKind::Halfspace { normal } => {
            rotation = quat_mul(rotation, from_up(space(normal)));
            let half = mesh::HALF_PLANE;
            let mut prim = PrimWriter::new("Plane", name);
            prim.set("uniform token axis", "\"Y\"");
            prim.set("bool doubleSided", 1);
            prim.set("double length", 2.0 * half);
            prim.set("double width", 2.0 * half);
            prim.set("float3[] extent", extent([half, 0.0, half]));
            prim
        }
        kind => faces(&name, kind, look),
    };
    if let (ShapeKind::Trimesh { decomposition, .. }, Motion::Dynamic) = (&shape.kind, motion) {
        prim.set("uniform token physics:approximation", "\"convexDecomposition\"");
        if let Some(options) = decomposition {
            prim.set("custom double drystone:accuracy", options.accuracy);
            prim.set("custom int drystone:pieces", options.pieces);
        }
    }
    prim.schemas.insert(0, "PhysicsCollisionAPI");
    prim.set(
        "color3f[] primvars:displayColor",
        list([tuple(&linear(color_of(body, motion)))].iter()),
    );
    prim.place(position, rotation, scale);
    prim
}

/// Returns a surface velocity in the frame of the prim, which differs from that of the shape for
/// planes.
pub(super) fn seen_from_prim(motion: &SurfaceVelocity, shape: &Shape) -> SurfaceVelocity {
    let own = shape.rotation.quaternion();
    match (&shape.kind, shape.rotation) {
        (ShapeKind::Halfspace { normal }, Rotation::Quaternion(_)) => {
            seen_from(motion.clone(), own, quat_mul(own, from_up(space(normal))))
        }
        _ => motion.clone(),
    }
}

/// Returns a capsule or a cylinder along y.
fn round(
    kind: &'static str,
    name: String,
    radius: f64,
    half_height: f64,
    reach: f64,
) -> PrimWriter {
    let mut prim = PrimWriter::new(kind, name);
    prim.set("uniform token axis", "\"Y\"");
    prim.set("double height", 2.0 * half_height);
    prim.set("double radius", radius);
    prim.set("float3[] extent", extent([radius, reach, radius]));
    prim
}

/// Returns a mesh. Hulls and 2D shapes collide as the convex hulls of their points.
fn faces(name: &str, kind: &ShapeKind, look: &Look<'_>) -> PrimWriter {
    let mesh = mesh_of(kind, look.dimension, look.engine);
    let hull = !matches!(kind, ShapeKind::Trimesh { .. });
    let mut prim = PrimWriter::new("Mesh", name);
    prim.schemas.push("PhysicsMeshCollisionAPI");
    prim.set(
        "uniform token physics:approximation",
        if hull { "\"convexHull\"" } else { "\"none\"" },
    );
    prim.set("uniform token subdivisionScheme", "\"none\"");
    prim.set("bool doubleSided", i32::from(!hull));
    prim.set("int[] faceVertexCounts", list(mesh.indices.chunks_exact(3).map(|_| 3)));
    prim.set("int[] faceVertexIndices", list(mesh.indices.iter()));
    prim.set("point3f[] points", list(mesh.positions.iter().map(|point| tuple(point))));
    prim.set("float3[] extent", extent_of(&mesh.positions));
    prim
}

/// Gives a mesh its points by time code.
pub fn deform<T: Copy + Default + PartialOrd + Display>(
    prim: &mut PrimWriter,
    samples: impl Iterator<Item = (f64, Vec<[T; 3]>)>,
) {
    let texts = samples.map(|(code, points)| {
        let extent = (code, extent_of(&points));
        (extent, (code, list(points.iter().map(|point| tuple(point)))))
    });
    let (extents, points): (Vec<_>, Vec<_>) = texts.unzip();
    prim.follow("float3[] extent", extents.into_iter(), None);
    prim.follow("point3f[] points", points.into_iter(), None);
}

/// Returns the least and the greatest coordinates of some points.
fn extent_of<T: Copy + Default + PartialOrd + Display>(points: &[[T; 3]]) -> String {
    let bound = |is_beyond: fn(&T, &T) -> bool| -> [T; 3] {
        let pick = |a, b| if is_beyond(&b, &a) { b } else { a };
        std::array::from_fn(|i| points.iter().map(|p| p[i]).reduce(pick).unwrap_or_default())
    };
    list([tuple(&bound(T::lt)), tuple(&bound(T::gt))].iter())
}

fn extent(half: [f64; 3]) -> String {
    list([tuple(&half.map(|x| -x)), tuple(&half)].iter())
}
