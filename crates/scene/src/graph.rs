//! Parts shared by the readers of scene graphs: transforms, shapes under scale, meshes, tracks,
//! names.
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects
    )
)]

pub(super) mod implicit;
pub mod math;
pub(super) mod track;
pub mod transform;
pub(super) mod triangles;

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::{Value, json};

use self::math::{Quat, Vec3};
use super::description::{Scene, SurfaceVelocity};
use super::engine::{Engine, NoEngine};
use super::format;
use super::joint::Joint;

/// Largest coordinate, size and scale. \[m\]
pub(super) const FAR: f64 = 1e9;
/// Smallest size of a shape. \[m\]
pub(super) const NEAR: f64 = 1e-9;
/// Largest velocity. \[m/s, rad/s\]
pub(super) const FAST: f64 = 1e9;
/// Largest mass and moment of inertia. \[kg, kg m^2\]
pub(super) const HEAVY: f64 = 1e18;
/// Largest stiffness, damping, force and torque of joints, as in the own format. \[SI\]
pub(super) const STRONG: f64 = 1e20;
/// Numbers from here on mean infinity: FLT_MAX of single precision, rounded by any program.
pub(super) const ENDLESS: f64 = 1e37;
/// Smallest mass and moment of inertia. \[kg, kg m^2\]
pub(super) const LIGHT: f64 = 1e-18;
/// Largest accepted deviation of a quaternion's length from 1; exporters round.
pub(super) const TURN_SLACK: f64 = 0.01;

/// Returns `name`, extended by `place` if another body already has it.
pub(super) fn unique(name: &str, place: &str, names: &mut BTreeSet<String>) -> String {
    let mut unique = name.to_owned();
    while !names.insert(unique.clone()) {
        unique = format!("{unique} ({place})");
    }
    unique
}

/// Converts a local surface velocity from axes rotated by `turn` to axes rotated by `other`.
pub(crate) fn seen_from(mut motion: SurfaceVelocity, turn: Quat, other: Quat) -> SurfaceVelocity {
    if motion.local && turn != other {
        let back = math::quat_mul(math::conjugate(other), turn);
        for vector in [&mut motion.linear, &mut motion.angular] {
            if let Ok(own) = Vec3::try_from(vector.as_slice()) {
                *vector = math::turn(back, own).into();
            }
        }
    }
    motion
}

/// Reads a scene without bodies from JSON of the own format: gravity, times and settings that other
/// formats cannot express. The error states the faulty item and what is accepted.
pub(super) fn own_words(text: &str, engine: &dyn Engine) -> Result<Scene, (String, String)> {
    match format::read_json_with(Path::new(""), text, engine) {
        Ok(read) if read.scene.dimension == 3 && read.scene.bodies.is_empty() => Ok(read.scene),
        Ok(_) => {
            let item = "a scene in other dimensions, or with bodies".to_owned();
            Err((item, "a scene of Drystone's own format in 3D, without bodies".to_owned()))
        }
        Err(error) => Err((format!("{} {}", error.item, error.value), error.accepted)),
    }
}

/// Reads a joint of the own format from an object without bodies and frames: what other formats
/// cannot express. The error states the faulty item and what is accepted.
pub(super) fn own_joint(own: &Value) -> Result<Joint, (String, String)> {
    let ball = json!({ "shapes": [{ "type": "sphere", "radius": 1.0 }] });
    let mut joint = own.clone();
    if let Some(joint) = joint.as_object_mut() {
        joint.insert("bodies".to_owned(), json!([0, 1]));
    }
    let text = json!({ "bodies": [ball, ball], "joints": [joint] }).to_string();
    let read = format::read_json_with(Path::new(""), &text, &NoEngine)
        .map_err(|error| (format!("{} {}", error.item, error.value), error.accepted))?;
    let missing = || ("a joint".to_owned(), "a joint of Drystone's own format".to_owned());
    read.scene.joints.into_iter().next().ok_or_else(missing)
}
