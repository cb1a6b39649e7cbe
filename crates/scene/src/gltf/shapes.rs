//! Reads implicit shapes.

use super::super::error::SceneError;
use super::super::graph::implicit::Implicit;
use super::super::graph::{FAR, NEAR};
use super::json::Cursor;

/// Defaults that differ between the extensions.
#[derive(Clone, Copy)]
pub(super) struct Defaults {
    pub(super) capsule: (f64, f64),
    pub(super) cylinder: (f64, f64),
    pub(super) meshes: bool,
}

pub(super) const KHRONOS: Defaults =
    Defaults { capsule: (0.5, 0.25), cylinder: (0.5, 0.25), meshes: false };
pub(super) const OMI: Defaults =
    Defaults { capsule: (1.0, 0.5), cylinder: (2.0, 0.5), meshes: true };

/// Reads a shape of `KHR_implicit_shapes` or `OMI_physics_shape`.
pub(super) fn read(
    shape: &Cursor<'_>,
    defaults: Defaults,
    meshes: usize,
) -> Result<Implicit, SceneError> {
    const TYPES: [&str; 7] = ["box", "sphere", "capsule", "cylinder", "plane", "convex", "trimesh"];
    let kind_cursor = shape.require("type")?;
    let kind = kind_cursor.text()?;
    let known = if defaults.meshes { &TYPES[..] } else { TYPES.get(..5).unwrap_or_default() };
    if !known.contains(&kind) {
        return Err(kind_cursor.error(format!("one of {} is accepted", known.join(", "))));
    }
    for other in TYPES.iter().filter(|other| **other != kind) {
        if let Some(other) = shape.get(other)? {
            return Err(other.fault(
                format!("'{}' in a shape of type {kind}", other.name()),
                format!("only '{kind}' is accepted"),
            ));
        }
    }
    let own = shape.get(kind)?;
    let size = |key: &str, default: f64, low: f64| -> Result<f64, SceneError> {
        match own.as_ref().map(|o| o.get(key)).transpose()?.flatten() {
            Some(cursor) => cursor.within(low, FAR),
            None => Ok(default),
        }
    };
    let tapered = |(height, radius): (f64, f64)| -> Result<(f64, f64, f64), SceneError> {
        let h = size("height", height, NEAR)?;
        let (top, bottom) = (size("radiusTop", radius, 0.0)?, size("radiusBottom", radius, 0.0)?);
        if top.max(bottom) < NEAR {
            let at = own.as_ref().unwrap_or(shape);
            return Err(at.fault(
                format!("radiusTop and radiusBottom of the {kind}, both {top:?}"),
                format!("one of them must be at least {NEAR:e}"),
            ));
        }
        Ok((h, top, bottom))
    };
    Ok(match kind {
        "sphere" => Implicit::Sphere { radius: size("radius", 0.5, NEAR)? },
        "box" => {
            let mut extents = [1.0; 3];
            if let Some(at) = own.as_ref().map(|o| o.get("size")).transpose()?.flatten() {
                extents = at.numbers(FAR)?;
                for item in at.items()? {
                    item.within(NEAR, FAR)?;
                }
            }
            Implicit::Box { size: extents }
        }
        "capsule" => {
            let (height, top, bottom) = tapered(defaults.capsule)?;
            Implicit::Capsule { height, top, bottom }
        }
        "cylinder" => {
            let (height, top, bottom) = tapered(defaults.cylinder)?;
            Implicit::Cylinder { height, top, bottom }
        }
        "plane" => {
            let side = |key: &str| -> Result<Option<f64>, SceneError> {
                let cursor = own.as_ref().map(|o| o.get(key)).transpose()?.flatten();
                cursor.map(|c| c.within(NEAR, FAR)).transpose()
            };
            let double = own.as_ref().map(|o| o.get("doubleSided")).transpose()?.flatten();
            let double = double.map_or(Ok(false), |d| d.boolean())?;
            Implicit::Plane { x: side("sizeX")?, z: side("sizeZ")?, double }
        }
        _ => {
            let own = shape.require(kind)?;
            let mesh = own.require("mesh")?.index(meshes, "meshes")?;
            Implicit::Mesh { mesh, convex: kind == "convex" }
        }
    })
}
