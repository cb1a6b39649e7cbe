//! Reads a coordinate of a joint: its limits, springs, motors and friction.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::error::SceneError;
use crate::format::cursor::{FieldCursor, Number, Range, TableCursor};
use crate::format::tree::Tree;
use crate::joint::{Coordinate, Drive, JointAxis, Softness};

pub(crate) const AXIS_KEYS: &[&str] =
    &["limits", "limit_stiffness", "limit_damping", "spring", "motor", "drives", "friction"];
/// Keys of [`AXIS_KEYS`] that say how far a coordinate may go.
pub(super) const LIMIT_KEYS: &[&str] = &["limits", "limit_stiffness", "limit_damping"];
pub(crate) const SPRING_KEYS: &[&str] =
    &["stiffness", "damping", "frequency", "damping_ratio", "mode", "rest", "at_most"];
pub(crate) const MOTOR_KEYS: &[&str] = &[
    "velocity",
    "position",
    "stiffness",
    "damping",
    "frequency",
    "damping_ratio",
    "mode",
    "at_most",
];
pub(crate) const DRIVE_KEYS: &[&str] =
    &["position", "velocity", "stiffness", "damping", "mode", "at_most"];

/// Limits of a coordinate that is locked.
pub(crate) const LOCKED: [f64; 2] = [0.0, 0.0];

const STIFFNESS: Range = Range::new(0.0, 1e20, "N/m, or N m/rad");
const DAMPING: Range = Range::new(0.0, 1e20, "N s/m, or N m s/rad");
const RATE: Range = Range::new(-1e6, 1e6, "m/s, or rad/s");
pub(super) const LOAD: Range = Range::new(0.0, 1e20, "N, or N m").or_infinite();

/// Values of an axis that a table does not state.
#[derive(Clone, Copy, Default)]
pub(super) struct Defaults {
    /// Limits.
    pub(super) limits: Option<[f64; 2]>,
    /// Position at which a spring is relaxed. \[m, or rad\]
    pub(super) rest: f64,
}

/// Returns the coordinate without limits, drives and friction.
pub(super) fn free(coordinate: Coordinate) -> JointAxis {
    JointAxis { coordinate, limits: None, softness: None, drives: Vec::new(), friction: 0.0 }
}

/// Returns the coordinate with these limits, as stiff as the engine can.
pub(super) fn limited(coordinate: Coordinate, limits: [f64; 2]) -> JointAxis {
    JointAxis { limits: Some(limits), ..free(coordinate) }
}

/// Reads limits, springs, motors and friction from those keys of a table that are `wanted`. `None`
/// if it states none, and there are no default limits either.
pub(super) fn read_axis(
    table: &TableCursor<'_>,
    wanted: &[&'static str],
    coordinate: Coordinate,
    defaults: Defaults,
) -> Result<Option<JointAxis>, SceneError> {
    let get = |key| if wanted.contains(&key) { table.get(key) } else { None };
    if wanted.iter().all(|key| table.get(key).is_none()) {
        return Ok(defaults.limits.map(|limits| limited(coordinate, limits)));
    }
    let limits = match get("limits") {
        None => defaults.limits,
        Some(field) => read_limits(&field, coordinate)?,
    };
    let mut drives = Vec::new();
    if let Some(field) = get("spring") {
        let owner = table.nested("the spring".to_owned());
        drives.push(read_spring(&field.table(SPRING_KEYS, &owner)?, coordinate, defaults.rest)?);
    }
    if let Some(field) = get("motor") {
        let owner = table.nested("the motor".to_owned());
        drives.push(read_motor(&field.table(MOTOR_KEYS, &owner)?, coordinate)?);
    }
    if let Some(field) = get("drives") {
        for (i, item) in field.items("a list of drives")?.enumerate() {
            let owner = table.nested(format!("drive {i}"));
            drives.push(read_drive(&item.table(DRIVE_KEYS, &owner)?, coordinate)?);
        }
    }
    let friction = Range { infinite: false, ..LOAD };
    Ok(Some(JointAxis {
        coordinate,
        limits,
        softness: read_softness(get("limit_stiffness"), get("limit_damping"), limits.is_some())?,
        drives,
        friction: get("friction").map_or(Ok(0.0), |field| field.real(&friction))?,
    }))
}

/// Reads limits: `"locked"`, `"free"`, or the least and the largest value.
pub(super) fn read_limits(
    field: &FieldCursor<'_>,
    coordinate: Coordinate,
) -> Result<Option<[f64; 2]>, SceneError> {
    let range = position_range(coordinate).or_infinite();
    let refuse = || {
        let lowest = if is_unsigned(coordinate) { ", the second at least 0" } else { "" };
        field.refuse(format_args!(
            "\"locked\", \"free\", or the least and the largest value, 2 numbers {range}{lowest}"
        ))
    };
    match &field.node.value {
        Tree::Text(text) if text == "locked" => return Ok(Some(LOCKED)),
        Tree::Text(text) if text == "free" => return Ok(None),
        _ => {}
    }
    let numbers = field.vector(2, &range).map_err(|_| refuse())?;
    let &[low, high] = numbers.as_slice() else { return Err(refuse()) };
    let is_empty = low > high || low == f64::INFINITY || high == f64::NEG_INFINITY;
    if is_empty || (is_unsigned(coordinate) && high < 0.0) {
        return Err(refuse());
    }
    warn_of_reach(field, coordinate, [low, high]);
    Ok(Some([low, high]))
}

/// Warns of angles beyond those that the coordinate can have: mostly, they are in degrees.
fn warn_of_reach(field: &FieldCursor<'_>, coordinate: Coordinate, limits: [f64; 2]) {
    let reach = match coordinate {
        Coordinate::Cardan(1) => FRAC_PI_2,
        Coordinate::Swing(_) | Coordinate::Cone | Coordinate::Rotation | Coordinate::Cardan(_) => {
            PI
        }
        Coordinate::Twist | Coordinate::Angle => return warn_of_degrees(field, limits),
        _ => return,
    };
    if limits.iter().any(|x| x.is_finite() && x.abs() > reach + 1e-6) {
        field.warn(format_args!(
            "has a limit beyond the largest value of this angle, {} rad; angles are in radians",
            Number(reach)
        ));
    }
}

/// Warns of limits beyond two turns that are whole multiples of five: mostly, they are in degrees.
fn warn_of_degrees(field: &FieldCursor<'_>, limits: [f64; 2]) {
    let mut finite = limits.iter().filter(|x| x.is_finite());
    let farthest = limits.iter().filter(|x| x.is_finite()).fold(0.0f64, |far, x| far.max(x.abs()));
    if farthest > 2.0 * TAU && finite.all(|x| x % 5.0 == 0.0) {
        field.warn(format_args!(
            "reach {} rad, which is {:.0} turns and looks like degrees; angles are in radians",
            Number(farthest),
            farthest / TAU
        ));
    }
}

fn read_softness(
    stiffness: Option<FieldCursor<'_>>,
    damping: Option<FieldCursor<'_>>,
    has_limits: bool,
) -> Result<Option<Softness>, SceneError> {
    let Some(stiffness) = stiffness else {
        return match damping {
            None => Ok(None),
            Some(field) => Err(field.refuse("nothing without limit_stiffness")),
        };
    };
    if !has_limits {
        stiffness.warn("does not act: there are no limits");
    }
    Ok(Some(Softness {
        stiffness: stiffness.real(&STIFFNESS)?,
        damping: damping.map_or(Ok(0.0), |field| field.real(&DAMPING))?,
    }))
}

/// Reads a spring from a table that knows [`SPRING_KEYS`].
pub(super) fn read_spring(
    table: &TableCursor<'_>,
    coordinate: Coordinate,
    rest: f64,
) -> Result<Drive, SceneError> {
    if ["stiffness", "damping", "frequency"].iter().all(|key| table.get(key).is_none()) {
        table.require("stiffness", format_args!("a number {STIFFNESS}; or a frequency"))?;
    }
    Ok(Drive {
        position: table.real_or("rest", &position_range(coordinate), rest)?,
        velocity: 0.0,
        max_force: table.real_or("at_most", &LOAD, f64::INFINITY)?,
        ..read_stiffness(table, 0.0)?
    })
}

/// Reads a motor that seeks a velocity, a position, or both.
fn read_motor(table: &TableCursor<'_>, coordinate: Coordinate) -> Result<Drive, SceneError> {
    let position = table.get("position");
    if let Some(position) = position {
        if ["stiffness", "frequency"].iter().all(|key| table.get(key).is_none()) {
            return Err(position.refuse("a position beside a stiffness or a frequency"));
        }
    } else {
        table.require("velocity", format_args!("a number {RATE}; or a position"))?;
    }
    let damping = if position.is_some() { 0.0 } else { f64::INFINITY };
    let range = position_range(coordinate);
    Ok(Drive {
        position: position.map_or(Ok(0.0), |field| field.real(&range))?,
        velocity: table.real_or("velocity", &RATE, 0.0)?,
        max_force: table.real_or("at_most", &LOAD, f64::INFINITY)?,
        ..read_stiffness(table, damping)?
    })
}

/// Reads a drive: each number of its law.
fn read_drive(table: &TableCursor<'_>, coordinate: Coordinate) -> Result<Drive, SceneError> {
    Ok(Drive {
        position: table.real_or("position", &position_range(coordinate), 0.0)?,
        velocity: table.real_or("velocity", &RATE, 0.0)?,
        max_force: table.real_or("at_most", &LOAD, f64::INFINITY)?,
        stiffness: table.real_or("stiffness", &STIFFNESS, 0.0)?,
        damping: table.real_or("damping", &DAMPING.or_infinite(), 0.0)?,
        acceleration: read_mode(table)?,
    })
}

/// Reads stiffness and damping, or frequency f and damping ratio zeta of an oscillator: per unit of
/// mass a stiffness of (2 pi f)^2 and a damping of 4 pi zeta f. The rest of the drive is zero.
fn read_stiffness(table: &TableCursor<'_>, damping: f64) -> Result<Drive, SceneError> {
    let drive = Drive {
        position: 0.0,
        velocity: 0.0,
        stiffness: 0.0,
        damping,
        max_force: 0.0,
        acceleration: false,
    };
    let ratio = table.get("damping_ratio");
    let Some(frequency) = table.get("frequency") else {
        if let Some(field) = ratio {
            return Err(field.refuse("a ratio beside a frequency; beside a stiffness, damping"));
        }
        return Ok(Drive {
            stiffness: table.real_or("stiffness", &STIFFNESS, 0.0)?,
            damping: table.real_or("damping", &DAMPING.or_infinite(), damping)?,
            acceleration: read_mode(table)?,
            ..drive
        });
    };
    for key in ["stiffness", "damping", "mode"] {
        if let Some(field) = table.get(key) {
            let accepted = "either frequency and damping_ratio, or stiffness, damping and mode";
            return Err(field.refuse(accepted));
        }
    }
    let rate = TAU * frequency.real(&Range::new(0.0, 1e6, "Hz"))?;
    let ratio = ratio.map_or(Ok(0.0), |field| field.real(&Range::new(0.0, 1e6, "")))?;
    let (stiffness, damping) = (rate * rate, 2.0 * ratio * rate);
    Ok(Drive { stiffness, damping, acceleration: true, ..drive })
}

fn read_mode(table: &TableCursor<'_>) -> Result<bool, SceneError> {
    let modes = [("force", false), ("acceleration", true)];
    table.get("mode").map_or(Ok(false), |field| field.choice(&modes))
}

/// Returns true for coordinates that are never negative.
fn is_unsigned(coordinate: Coordinate) -> bool {
    use Coordinate::{Cone, Distance, EllipticCone, Pulley, Radial, Rotation};
    matches!(coordinate, Radial(_) | Distance | Cone | EllipticCone(_) | Rotation | Pulley { .. })
}

fn position_range(coordinate: Coordinate) -> Range {
    use Coordinate::{Distance, EllipticCone, Linear, Pulley, Rack, Radial, Screw};
    let unit = match coordinate {
        Linear(_) | Radial(_) | Distance | Rack { .. } | Screw { .. } | Pulley { .. } => "m",
        EllipticCone(_) => "",
        _ => "rad",
    };
    Range::new(-1e6, 1e6, unit)
}
