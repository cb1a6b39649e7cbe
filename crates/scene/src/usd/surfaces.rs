//! Physics materials and their binding to colliders.

use super::super::description::{Combine, Material};
use super::super::error::{SceneError, Warning};
use super::prims::Prim;
use super::stage::Stage;
use crate::format::surface::COMBINE;
use crate::graph::HEAVY;

/// Largest coefficient of friction.
const ROUGHEST: f64 = 1e6;
/// Largest rolling or spinning resistance. \[m\]
const LONGEST: f64 = 1e6;

/// Contents of a material.
pub(super) struct UsdMaterial {
    pub(super) material: Material,
    /// Density. \[kg/m^3\]
    pub(super) density: Option<f64>,
}

/// Reads the surface of a collider. Its material is the nearest one bound for physics, else the
/// nearest bound for all purposes.
pub(super) fn of(
    stage: &Stage<'_>,
    collider: usize,
    warnings: &mut Vec<Warning>,
) -> Result<Option<UsdMaterial>, SceneError> {
    let bound = ["material:binding:physics", "material:binding"].into_iter().find_map(|purpose| {
        stage.up(collider).find_map(|(_, prim)| stage.targets(prim, purpose).first())
    });
    let found = bound.and_then(|path| stage.find(path));
    match found.and_then(|index| stage.prim(index)) {
        Some(prim) if prim.schemas.contains("PhysicsMaterialAPI") => {
            read(stage, prim, warnings).map(Some)
        }
        _ => Ok(None),
    }
}

fn read(
    stage: &Stage<'_>,
    prim: &Prim,
    warnings: &mut Vec<Warning>,
) -> Result<UsdMaterial, SceneError> {
    let number = |name: &str, most: f64| stage.number(prim, name, 0.0, most);
    let fixed = number("physics:staticFriction", ROUGHEST)?;
    let sliding = number("physics:dynamicFriction", ROUGHEST)?;
    if let (Some(fixed), Some(sliding)) = (fixed, sliding)
        && (fixed - sliding).abs() > 1e-6
    {
        let what = format!(
            "staticFriction {fixed} and dynamicFriction {sliding}: {sliding} acts, at rest and \
             sliding"
        );
        stage.warn(prim, what, warnings);
    }
    let mut restitution = number("physics:restitution", ROUGHEST)?.unwrap_or(0.0);
    if restitution > 1.0 {
        stage.warn(prim, format!("restitution {restitution} is taken as 1"), warnings);
        restitution = 1.0;
    }
    let combine = |name: &str, default: Combine| -> Result<Combine, SceneError> {
        let Some(word) = stage.word(prim, name)? else { return Ok(default) };
        let found = COMBINE.iter().find(|(known, _)| *known == word);
        found.map(|(_, combine)| *combine).ok_or_else(|| {
            let known = COMBINE.map(|(known, _)| format!("\"{known}\"")).join(", ");
            stage.refuse(prim, name, &known)
        })
    };
    let default = Material::default();
    let material = Material {
        // An absent coefficient is 0, the default of the schema.
        friction: sliding.or(fixed).unwrap_or(0.0),
        restitution,
        rolling_resistance: number("drystone:rollingResistance", LONGEST)?.unwrap_or(0.0),
        spinning_resistance: number("drystone:spinningResistance", LONGEST)?.unwrap_or(0.0),
        friction_combine: combine("drystone:frictionCombine", default.friction_combine)?,
        restitution_combine: combine("drystone:restitutionCombine", default.restitution_combine)?,
    };
    let density = number("physics:density", HEAVY)?.filter(|density| *density > 0.0);
    Ok(UsdMaterial { material, density: density.map(|density| density * stage.units.density()) })
}
