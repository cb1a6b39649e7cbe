//! Reader of OpenUSD with UsdPhysics, in text form (`.usda`).
//!
//! It uses no USD library. It parses the layers of a stage and composes them: sublayers, inherits,
//! variants, references, payloads, specializes. Then it searches the stage for bodies and
//! colliders. Files are not trusted: depth, number and size of everything are bounded, and files
//! outside the scene's folder are refused. Every error names its position.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::arithmetic_side_effects
)]
// An error ends the reading of a file, so its size does not matter.
#![allow(clippy::result_large_err)]

mod bodies;
mod compose;
pub(crate) mod coordinates;
mod deforming;
mod files;
mod filters;
mod joint_axes;
mod joints;
mod layer;
mod layering;
mod lexer;
mod mass;
mod motion;
mod parser;
mod prims;
mod shapes;
mod source;
mod stage;
mod surfaces;
mod tokens;
mod transform;
mod units;
mod unsupported;
mod value;
mod xform;

use std::collections::BTreeSet;
use std::path::Path;

pub use source::{StageBody, StageSource};
pub use units::StageUnits;

use self::files::Files;
use self::stage::Stage;
use super::description::Scene;
use super::engine::Engine;
use super::error::{Place, SceneError, Warning};
use super::graph::math::{self, Vec3};
use super::graph::{FAST, own_words};
use super::read::Read;

/// Acceleration of gravity on earth. \[m/s^2\]
const EARTH: f64 = 9.81;

/// Reads a scene from a `.usda` file and all files that it refers to.
///
/// # Errors
/// If a file cannot be read, breaks the rules of USD or UsdPhysics, or describes no physics.
pub fn read(file: &Path, engine: &dyn Engine) -> Result<Read, SceneError> {
    let mut warnings = Vec::new();
    let files = Files::read(file)?;
    let stage = Stage::new(&files, engine, &mut warnings)?;
    let transforms = motion::Transforms::read(&stage)?;
    let (prims, bodies): (Vec<_>, Vec<_>) =
        bodies::all(&stage, &transforms, &mut warnings)?.into_iter().unzip();
    let joints = joints::all(&stage, &transforms, &prims, &mut warnings)?;
    unsupported::name(&stage, joints.unread, &mut warnings);
    let physical = |prim: &prims::Prim| {
        prim.kind == "PhysicsScene" || prim.schemas.iter().any(|name| name.starts_with("Physics"))
    };
    if !stage.prims.iter().any(physical) {
        return Err(SceneError {
            file: file.to_owned(),
            place: Place::File,
            item: "OpenUSD without physics".into(),
            value: String::new(),
            accepted: "apply PhysicsCollisionAPI to prims that collide and PhysicsRigidBodyAPI to \
             prims that move"
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
    let places: Vec<_> = prims.iter().copied().zip(&bodies).collect();
    let source = layering::source(file, &stage, &transforms, &places, &joints.prims);
    let scene = Scene { bodies, joints: joints.all, ..physics(&stage, &mut warnings)? };
    // A fault in a material is reported once, not for each collider that uses it.
    let mut told = BTreeSet::new();
    warnings.retain(|warning| told.insert(warning.message.clone()));
    Ok(Read { scene, warnings, source: None, stage: Some(source) })
}

/// Reads gravity, and the times and settings that UsdPhysics cannot express. A custom attribute
/// holds those in Drystone's own format.
fn physics(stage: &Stage<'_>, warnings: &mut Vec<Warning>) -> Result<Scene, SceneError> {
    const OWN: &str = "drystone:scene";
    let mut scenes = stage.prims.iter().filter(|prim| prim.kind == "PhysicsScene");
    let Some(prim) = scenes.next() else {
        return own_words("{}", stage.engine)
            .map_err(|(item, accepted)| stage.fault(&item, accepted));
    };
    if let Some(second) = scenes.next() {
        stage.warn(second, "only the first PhysicsScene acts", warnings);
    }
    let own = stage.word(prim, OWN)?;
    let mut scene = own_words(own.unwrap_or("{}"), stage.engine)
        .map_err(|(item, accepted)| stage.refuse(prim, OWN, &format!("{accepted} ({item})")))?;
    scene.name = prim.label.clone();
    let gravity = gravity(stage, prim)?;
    // The own format has gravity exactly. The rounded one of UsdPhysics replaces it only if
    // somebody changed it since.
    let written = <Vec3>::try_from(scene.gravity.as_slice()).unwrap_or(gravity);
    let off = math::length(math::sub(gravity, written));
    if own.is_none() || off > 1e-6 * math::length(written) {
        scene.gravity = gravity.into();
    }
    Ok(scene)
}

/// Returns the acceleration of gravity in the scene. \[m/s^2\]
fn gravity(stage: &Stage<'_>, prim: &prims::Prim) -> Result<Vec3, SceneError> {
    const STRENGTH: &str = "physics:gravityMagnitude";
    let direction = stage.vector::<3>(prim, "physics:gravityDirection", FAST)?.unwrap_or_default();
    let strength = match stage.number(prim, STRENGTH, f64::NEG_INFINITY, FAST)? {
        // A negative magnitude asks for the earth's gravity.
        Some(strength) if strength >= 0.0 => strength * stage.units.meters,
        _ => EARTH,
    };
    Ok(match math::unit(direction) {
        None => [0.0, -strength, 0.0],
        // A direction of length 1 up to rounding stays as written.
        Some(unit) => {
            let exact = (math::dot(direction, direction) - 1.0).abs() <= 8.0 * f64::EPSILON;
            stage.units.direction(math::scale(if exact { direction } else { unit }, strength))
        }
    })
}
