//! Limits and drives of a joint as `KHR_physics_rigid_bodies` describes them.

use serde_json::{Value, json};

use crate::joint::{Breaking, Joint};
use crate::joint_limits::{AxisDrive, JointCoordinates, JointLimits, Limit};
use crate::write::own_joint;

/// Returns the limits and drives of a joint. What they cannot express goes into
/// `extras.drystone`, which acts as long as nobody changes the limits and drives written with it.
pub(super) fn description(joint: &Joint) -> Value {
    let terms = JointLimits::of(joint);
    let mut out = json!({});
    for (key, list) in [
        ("limits", terms.limits.iter().map(limit).collect::<Vec<_>>()),
        ("drives", terms.drives.iter().map(drive).collect()),
    ] {
        if !list.is_empty() {
            out[key] = json!(list);
        }
    }
    let exact = JointCoordinates { axes: joint.axes.clone(), ..JointCoordinates::default() };
    let is_plain = joint.enabled && joint.breaking == Breaking::default();
    if !is_plain || terms.coordinates() != exact {
        out["extras"] = json!({ "drystone": own_joint(joint) });
    }
    out
}

fn limit(limit: &Limit) -> Value {
    let axes: Vec<_> = (0..3).filter(|axis| limit.axes[*axis]).collect();
    let mut out = json!({});
    out[if limit.is_angular { "angularAxes" } else { "linearAxes" }] = json!(axes);
    for (key, bound) in ["min", "max"].into_iter().zip(limit.range) {
        if bound.is_finite() {
            out[key] = json!(bound);
        }
    }
    if let Some(softness) = limit.softness {
        out["stiffness"] = json!(softness.stiffness);
        out["damping"] = json!(softness.damping);
    }
    out
}

/// Writes a target beside each strength, as the schema requires.
fn drive(drive: &AxisDrive) -> Value {
    let AxisDrive { is_angular, axis, drive } = drive;
    let mut out = json!({
        "type": if *is_angular { "angular" } else { "linear" },
        "mode": if drive.acceleration { "acceleration" } else { "force" },
        "axis": axis,
        "positionTarget": drive.position,
        "velocityTarget": drive.velocity,
        "stiffness": drive.stiffness,
        "damping": drive.damping,
    });
    if drive.max_force.is_finite() {
        out["maxForce"] = json!(drive.max_force);
    }
    out
}
