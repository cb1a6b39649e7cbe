//! Surfaces as materials of UsdPhysics, with own attributes for the rules by which two of them
//! combine.

use std::collections::HashMap;

use super::prim::PrimWriter;
use crate::description::{Combine, Material, Scene};
use crate::format::surface::COMBINE;

/// Parent of the materials, below the root prim.
pub(super) const SCOPE: &str = "Materials";

/// Bits of friction, restitution and resistances, and the combination rules.
type MaterialKey = ([u64; 4], [Combine; 2]);

/// The distinct surfaces of a scene.
pub(super) struct Materials<'a> {
    all: Vec<&'a Material>,
    places: HashMap<MaterialKey, usize>,
}

impl<'a> Materials<'a> {
    pub(super) fn of(scene: &'a Scene) -> Self {
        let mut out = Self { all: Vec::new(), places: HashMap::new() };
        for shape in scene.bodies.iter().flat_map(|body| &body.shapes) {
            out.places.entry(key(&shape.material)).or_insert_with(|| {
                out.all.push(&shape.material);
                out.all.len() - 1
            });
        }
        out
    }

    /// Returns the prim with all materials; `None` if there are no shapes.
    pub(super) fn prim(&self) -> Option<PrimWriter> {
        let mut scope = PrimWriter::new("Scope", SCOPE);
        scope.children = self.all.iter().enumerate().map(|(i, of)| prim(i, of)).collect();
        (!scope.children.is_empty()).then_some(scope)
    }

    /// Binds a shape to its material.
    pub(super) fn bind(&self, shape: &mut PrimWriter, material: &Material) {
        let Some(place) = self.places.get(&key(material)) else { return };
        shape.schemas.push("MaterialBindingAPI");
        let path = format!("</World/{SCOPE}/{}>", name(*place));
        shape.set("rel material:binding:physics", path);
    }
}

fn key(material: &Material) -> MaterialKey {
    let combine = [material.friction_combine, material.restitution_combine];
    let Material { friction, restitution, rolling_resistance, spinning_resistance, .. } = *material;
    let numbers = [friction, restitution, rolling_resistance, spinning_resistance];
    (numbers.map(f64::to_bits), combine)
}

fn name(place: usize) -> String {
    format!("Surface_{place}")
}

fn prim(place: usize, material: &Material) -> PrimWriter {
    let mut prim = PrimWriter::new("Material", name(place));
    prim.schemas.push("PhysicsMaterialAPI");
    prim.set("float physics:dynamicFriction", material.friction);
    prim.set("float physics:restitution", material.restitution);
    prim.set("float physics:staticFriction", material.friction);
    for (key, of) in
        [("rolling", material.rolling_resistance), ("spinning", material.spinning_resistance)]
    {
        if of != 0.0 {
            prim.set(format!("custom double drystone:{key}Resistance"), of);
        }
    }
    let default = Material::default();
    for (key, of, usual) in [
        ("friction", material.friction_combine, default.friction_combine),
        ("restitution", material.restitution_combine, default.restitution_combine),
    ] {
        if let Some((word, _)) = COMBINE.iter().find(|(_, combine)| of != usual && *combine == of) {
            prim.set(format!("custom token drystone:{key}Combine"), format!("\"{word}\""));
        }
    }
    prim
}
