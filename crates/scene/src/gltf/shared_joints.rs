//! Limits and drives that the joints of nodes share.

use super::super::error::{SceneError, Warning};
use super::super::graph::{ENDLESS, STRONG, own_joint};
use super::super::joint::{Breaking, Drive, Joint, JointAxis, Softness};
use super::super::joint_limits::{AxisDrive, FAR, JointLimits, Limit, bounded};
use super::json::Cursor;
use super::unknown::warn_unknown;

/// Extension for joints beside `OMI_physics_body`.
pub(super) const OMI: &str = "OMI_physics_joint";

/// Coordinates and loads of joints.
pub(super) struct SharedJoint {
    pub(super) axes: Vec<JointAxis>,
    /// Axis of the frames of the file that is the x axis of the joint.
    pub(super) twist: usize,
    pub(super) breaking: Breaking,
    pub(super) enabled: bool,
}

/// Reads the description of a joint.
pub(super) fn read(
    joint: &Cursor<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<SharedJoint, SceneError> {
    warn_unknown(joint, &["name", "limits", "drives"], warnings);
    let mut all = JointLimits::default();
    for limit in joint.list("limits")? {
        all.limits.extend(read_limit(&limit, warnings)?);
    }
    for drive in joint.list("drives")? {
        all.drives.extend(read_drive(&drive, warnings)?);
    }
    let warn = |message: String| Warning { place: joint.place(), message };
    if let Some(own) = joint.own()? {
        let own_terms =
            own_joint(own.value).map_err(|(item, accepted)| own.fault(item, accepted))?;
        if JointLimits::of(&own_terms) == all {
            let Joint { axes, breaking, enabled, .. } = own_terms;
            return Ok(SharedJoint { axes, twist: 0, breaking, enabled });
        }
        let name = joint.name();
        warnings.push(warn(format!(
            "the limits and drives of {name} were changed after Drystone wrote them: they act, and \
             what else its extras say does not"
        )));
    }
    let read = all.coordinates();
    warnings.extend(read.notes.iter().map(|note| warn(format!("{}: {note}", joint.name()))));
    let (breaking, enabled) = (Breaking::default(), true);
    Ok(SharedJoint { axes: read.axes, twist: read.twist, breaking, enabled })
}

/// Reads a limit; `None` if it does not act.
fn read_limit(
    limit: &Cursor<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<Option<Limit>, SceneError> {
    const KEYS: [&str; 6] = ["linearAxes", "angularAxes", "min", "max", "stiffness", "damping"];
    warn_unknown(limit, &KEYS, warnings);
    let (list, is_angular) = match (limit.get("linearAxes")?, limit.get("angularAxes")?) {
        (Some(list), None) => (list, false),
        (None, Some(list)) => (list, true),
        _ => {
            return Err(limit.fault(
                "joint limit",
                "exactly one of 'linearAxes' and 'angularAxes' is accepted",
            ));
        }
    };
    let mut axes = [false; 3];
    for item in list.items()? {
        let index = item.index(3, "axes")?;
        if let Some(axis) = axes.get_mut(index) {
            *axis = true;
        }
    }
    let mut bound = |key: &str, none: f64| -> Result<f64, SceneError> {
        let Some(cursor) = limit.get(key)? else { return Ok(none) };
        let bound = cursor.number(f64::MAX)?;
        if bound.abs() <= FAR {
            return Ok(bound);
        }
        let message = format!("{key} {bound:e} is taken as unbounded");
        warnings.push(Warning { place: cursor.place(), message });
        Ok(bounded(bound))
    };
    let range = [bound("min", f64::NEG_INFINITY)?, bound("max", f64::INFINITY)?];
    let [low, high] = range;
    let several = axes.iter().filter(|limited| **limited).count() > 1;
    if low > high || low == f64::INFINITY || high == f64::NEG_INFINITY {
        let item = format!("joint limit with min {low} and max {high}");
        return Err(limit.fault(item, "a min of at most max is accepted"));
    }
    if several && high < 0.0 {
        let item = format!("joint limit of several axes with max {high}");
        return Err(limit.fault(item, "a max of at least 0 is accepted: it is of a distance"));
    }
    let damping = limit.get("damping")?.map(|of| of.within(0.0, STRONG)).transpose()?;
    let softness = match limit.get("stiffness")? {
        Some(of) => {
            Some(Softness { stiffness: of.within(0.0, STRONG)?, damping: damping.unwrap_or(0.0) })
        }
        None if damping.is_some_and(|damping| damping > 0.0) => {
            let message = "damping of a joint limit without stiffness does not act".to_owned();
            warnings.push(Warning { place: limit.place(), message });
            None
        }
        None => None,
    };
    if softness.is_some_and(|own| own.stiffness == 0.0 && own.damping == 0.0) {
        let message = "a joint limit with stiffness 0 and no damping does not act".to_owned();
        warnings.push(Warning { place: limit.place(), message });
        return Ok(None);
    }
    Ok(Some(Limit { is_angular, axes, range, softness }))
}

/// Reads a drive; `None` if its type or mode is unknown.
fn read_drive(
    drive: &Cursor<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<Option<AxisDrive>, SceneError> {
    const KEYS: [&str; 8] = [
        "type",
        "mode",
        "axis",
        "maxForce",
        "positionTarget",
        "velocityTarget",
        "stiffness",
        "damping",
    ];
    warn_unknown(drive, &KEYS, warnings);
    let axis = drive.require("axis")?.index(3, "axes")?;
    let mut choice = |key: &str, [no, yes]: [&str; 2]| -> Result<Option<bool>, SceneError> {
        let cursor = drive.require(key)?;
        let text = cursor.text()?;
        if text == no || text == yes {
            return Ok(Some(text == yes));
        }
        let message = format!("{key} '{text}' of a joint drive is unknown: it does not act");
        warnings.push(Warning { place: cursor.place(), message });
        Ok(None)
    };
    let is_angular = choice("type", ["linear", "angular"])?;
    let mode = choice("mode", ["force", "acceleration"])?;
    let target = |key: &str| -> Result<f64, SceneError> {
        drive.get(key)?.map_or(Ok(0.0), |cursor| cursor.number(FAR))
    };
    let mut strength = |key: &str, usual: f64, most: f64| -> Result<f64, SceneError> {
        let Some(cursor) = drive.get(key)? else { return Ok(usual) };
        let found = cursor.within(0.0, f64::MAX)?;
        if found <= STRONG {
            return Ok(found);
        }
        // Programs write the largest number of single precision for no bound.
        if most.is_finite() || found < ENDLESS {
            let taken = if most.is_finite() { "1e20" } else { "unbounded" };
            let message = format!("{key} {found:e} is taken as {taken}");
            warnings.push(Warning { place: cursor.place(), message });
        }
        Ok(most)
    };
    let own = Drive {
        position: target("positionTarget")?,
        velocity: target("velocityTarget")?,
        stiffness: strength("stiffness", 0.0, STRONG)?,
        damping: strength("damping", 0.0, STRONG)?,
        max_force: strength("maxForce", f64::INFINITY, f64::INFINITY)?,
        acceleration: mode == Some(true),
    };
    if own.stiffness == 0.0 && own.damping == 0.0 {
        let message = "a joint drive without stiffness and damping does not act".to_owned();
        warnings.push(Warning { place: drive.place(), message });
    }
    let (Some(is_angular), Some(_)) = (is_angular, mode) else { return Ok(None) };
    Ok(Some(AxisDrive { is_angular, axis, drive: own }))
}
