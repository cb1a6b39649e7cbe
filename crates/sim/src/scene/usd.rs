//! OpenUSD with UsdPhysics, in text form (`.usda`).
//!
//! Read without a library: the layers of a stage are parsed, composed (sublayers, inherits, variants,
//! references, payloads, specializes) and searched for bodies and colliders. Nothing in a file is taken
//! on trust: depth, number and size of everything is bounded, files outside of the scene's folder are
//! refused, and an error names its place.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::arithmetic_side_effects
)]
// An error ends the reading of a file: its size does not matter.
#![allow(clippy::result_large_err)]

mod bodies;
mod compose;
mod files;
mod filters;
mod layer;
mod lexer;
mod mass;
mod motion;
mod parser;
mod prims;
mod shapes;
mod stage;
mod strangers;
mod surfaces;
mod tokens;
mod value;
mod xform;

use std::collections::BTreeSet;
use std::path::Path;

use self::files::Files;
use self::stage::Stage;
use super::description::Scene;
use super::error::{Place, SceneError, Warning};
use super::graph::math::{self, Vec3};
use super::graph::{FAST, own_words};
use super::read::Read;

/// Of free fall on earth. \[m/s^2\]
const EARTH: f64 = 9.81;

/// Reads a scene from a `.usda` file and all that it leads to.
///
/// # Errors
/// Where a file cannot be read, breaks the rules of USD or UsdPhysics, or describes no physics.
pub fn read(file: &Path) -> Result<Read, SceneError> {
    let mut warnings = Vec::new();
    let files = Files::read(file)?;
    let stage = Stage::new(&files, &mut warnings)?;
    let bodies = bodies::all(&stage, &mut warnings)?;
    let physical = |prim: &prims::Prim| {
        prim.kind == "PhysicsScene" || prim.schemas.iter().any(|name| name.starts_with("Physics"))
    };
    if !stage.prims.iter().any(physical) {
        return Err(SceneError {
            file: file.to_owned(),
            place: Place::File,
            item: "OpenUSD without physics".into(),
            value: String::new(),
            accepted: "apply PhysicsCollisionAPI to what collides and PhysicsRigidBodyAPI to what \
                       moves"
                .into(),
            unreadable: false,
        });
    }
    if bodies.is_empty() {
        warnings.push(Warning {
            place: Place::File,
            message: "no prim has a collider that acts: there is nothing to simulate".into(),
        });
    }
    let scene = Scene { bodies, ..physics(&stage, &mut warnings)? };
    // What is wrong with a material is told once, not for each that has it.
    let mut told = BTreeSet::new();
    warnings.retain(|warning| told.insert(warning.message.clone()));
    Ok(Read { scene, warnings, source: None })
}

/// Gravity, and what UsdPhysics has no word for: times and settings, as the own format writes them.
fn physics(stage: &Stage<'_>, warnings: &mut Vec<Warning>) -> Result<Scene, SceneError> {
    const OWN: &str = "drystone:scene";
    let mut scenes = stage.prims.iter().filter(|prim| prim.kind == "PhysicsScene");
    let Some(prim) = scenes.next() else {
        return own_words("{}").map_err(|(item, accepted)| stage.fault(&item, accepted));
    };
    if let Some(second) = scenes.next() {
        stage.warn(second, "only the first PhysicsScene acts", warnings);
    }
    let own = stage.word(prim, OWN)?;
    let mut scene = own_words(own.unwrap_or("{}"))
        .map_err(|(item, accepted)| stage.refuse(prim, OWN, &format!("{accepted} ({item})")))?;
    scene.name = prim.label.clone();
    let gravity = gravity(stage, prim)?;
    // Rounded to where it comes from, unless somebody changed it since.
    let written = <Vec3>::try_from(scene.gravity.as_slice()).unwrap_or(gravity);
    let off = math::length(math::sub(gravity, written));
    if own.is_none() || off > 1e-6 * math::length(written) {
        scene.gravity = gravity.into();
    }
    Ok(scene)
}

/// Acceleration of free fall in the scene. \[m/s^2\]
fn gravity(stage: &Stage<'_>, prim: &prims::Prim) -> Result<Vec3, SceneError> {
    const STRENGTH: &str = "physics:gravityMagnitude";
    let direction = stage.vector::<3>(prim, "physics:gravityDirection", FAST)?.unwrap_or_default();
    let strength = match stage.number(prim, STRENGTH, f64::NEG_INFINITY, FAST)? {
        // What is below zero asks for that of the earth.
        Some(strength) if strength >= 0.0 => strength * stage.units.meters,
        _ => EARTH,
    };
    Ok(match math::unit(direction) {
        None => [0.0, -strength, 0.0],
        // Without the rounding of a unit vector's length.
        Some(unit) => {
            let exact = (math::dot(direction, direction) - 1.0).abs() <= 8.0 * f64::EPSILON;
            stage.units.direction(math::scale(if exact { direction } else { unit }, strength))
        }
    })
}
