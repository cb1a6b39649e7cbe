//! Names of coordinates in scene files, and the tables of those that have parameters.

use super::axis::{AXIS_KEYS, Defaults, LOCKED, free, limited, read_axis, read_limits};
use super::setup::JointSetup;
use crate::error::SceneError;
use crate::format::cursor::{FieldCursor, Range, TableCursor};
use crate::format::setup::POSITION;
use crate::joint::{Coordinate, JointAxis};

/// Names of all coordinates, in the order of their rows in a joint that states none.
pub(crate) const NAMES: [&str; 21] = [
    "x",
    "y",
    "z",
    "radial_x",
    "radial_y",
    "radial_z",
    "distance",
    "angle",
    "twist",
    "swing_y",
    "swing_z",
    "cone",
    "elliptic_cone",
    "rotation",
    "angle_x",
    "angle_y",
    "angle_z",
    "gear",
    "rack",
    "screw",
    "pulley",
];

/// Keys common to the tables of all coordinates, followed by those of one.
macro_rules! keys {
    ($($key:literal),*) => {
        &[
            "limits",
            "limit_stiffness",
            "limit_damping",
            "spring",
            "motor",
            "drives",
            "friction",
            $($key),*
        ]
    };
}

/// Coordinates with parameters, and the keys of their tables.
pub(crate) const PARAMETRIC: [(&str, &[&str]); 5] = [
    ("elliptic_cone", keys!("half_angles")),
    ("gear", keys!("ratio")),
    ("rack", keys!("radius")),
    ("screw", keys!("pitch")),
    ("pulley", keys!("points", "ratio")),
];

const ANGLE: Range = Range::new(1e-6, std::f64::consts::PI, "rad");
const RATIO: Range = Range::new(-1e6, 1e6, "");
/// Weight of a side of a pulley.
const WEIGHT: Range = Range::new(0.0, 1e6, "");
const LENGTH: Range = Range::new(-1e6, 1e6, "m");

/// Returns the place of a coordinate in [`NAMES`].
pub(crate) fn rank(coordinate: Coordinate) -> usize {
    let name = coordinate.name();
    NAMES.iter().position(|other| *other == name).unwrap_or(NAMES.len())
}

/// Limits of a coordinate whose table states none.
pub(crate) fn default_limits(coordinate: Coordinate) -> Option<[f64; 2]> {
    match coordinate {
        Coordinate::EllipticCone(_) => Some([0.0, 1.0]),
        Coordinate::Gear { .. } | Coordinate::Rack { .. } | Coordinate::Screw { .. } => {
            Some(LOCKED)
        }
        _ => None,
    }
}

/// Reads a coordinate that a joint has under its name: limits, or a table. `None` if it is free.
pub(super) fn read_coordinate(
    field: &FieldCursor<'_>,
    name: &'static str,
    joint: &TableCursor<'_>,
    setup: &JointSetup<'_>,
) -> Result<Option<JointAxis>, SceneError> {
    if let Some(why) = absence(name, setup) {
        return Err(field.refuse(format_args!("nothing: {why}")));
    }
    let owner = joint.nested(name.to_owned());
    if let Some((_, keys)) = PARAMETRIC.iter().find(|(other, _)| *other == name) {
        let table = field.table(keys, &owner)?;
        let coordinate = read_parameters(&table, name, setup)?;
        let defaults = Defaults { limits: default_limits(coordinate), rest: 0.0 };
        let axis = read_axis(&table, AXIS_KEYS, coordinate, defaults)?;
        return Ok(Some(axis.unwrap_or(free(coordinate))));
    }
    let coordinate = plain(name);
    if !field.is_table() {
        let limits = read_limits(field, coordinate)?;
        return Ok(limits.map(|limits| limited(coordinate, limits)));
    }
    let table = field.table(AXIS_KEYS, &owner)?;
    let axis = read_axis(&table, AXIS_KEYS, coordinate, Defaults::default())?;
    Ok(Some(axis.unwrap_or(free(coordinate))))
}

/// Returns the coordinate without parameters that has this name.
fn plain(name: &str) -> Coordinate {
    match name {
        "x" => Coordinate::Linear(0),
        "y" => Coordinate::Linear(1),
        "z" => Coordinate::Linear(2),
        "radial_x" => Coordinate::Radial(0),
        "radial_y" => Coordinate::Radial(1),
        "radial_z" => Coordinate::Radial(2),
        "distance" => Coordinate::Distance,
        "angle" => Coordinate::Angle,
        "twist" => Coordinate::Twist,
        "swing_y" | "steering" => Coordinate::Swing(1),
        "swing_z" => Coordinate::Swing(2),
        "cone" => Coordinate::Cone,
        "angle_x" => Coordinate::Cardan(0),
        "angle_y" => Coordinate::Cardan(1),
        "angle_z" => Coordinate::Cardan(2),
        _ => Coordinate::Rotation,
    }
}

/// Reads the parameters of a coordinate from its own table, or from that of a joint of that type.
pub(super) fn read_parameters(
    table: &TableCursor<'_>,
    name: &str,
    setup: &JointSetup<'_>,
) -> Result<Coordinate, SceneError> {
    let number = |key, range: &Range| {
        let field = table.require(key, format_args!("a number {range}"))?;
        let value = field.real(range)?;
        if value == 0.0 {
            field.warn("couples nothing");
        }
        Ok(value)
    };
    Ok(match name {
        "elliptic_cone" => {
            let field = table.require("half_angles", format_args!("2 numbers {ANGLE}"))?;
            let angles = field.vector(2, &ANGLE)?;
            Coordinate::EllipticCone(angles.try_into().unwrap_or_default())
        }
        "gear" => Coordinate::Gear { ratio: number("ratio", &RATIO)? },
        "rack" => Coordinate::Rack { radius: number("radius", &LENGTH)? },
        "screw" => Coordinate::Screw { pitch: number("pitch", &LENGTH)? },
        _ => Coordinate::Pulley {
            points: read_points(table, setup)?,
            ratio: table.real_or("ratio", &WEIGHT, 1.0)?,
        },
    })
}

/// Reads the two points of a pulley; in 2D, their third component is 0.
fn read_points(
    table: &TableCursor<'_>,
    setup: &JointSetup<'_>,
) -> Result<[[f64; 3]; 2], SceneError> {
    let accepted = "two points of the world";
    let field = table.require("points", accepted)?;
    let items = field.items(accepted)?;
    let point = |item: FieldCursor<'_>| -> Result<[f64; 3], SceneError> {
        let mut point = item.vector(setup.dimension, &POSITION)?;
        point.resize(3, 0.0);
        Ok(point.try_into().unwrap_or_default())
    };
    let points: Vec<[f64; 3]> = items.map(point).collect::<Result<_, _>>()?;
    points.try_into().map_err(|_| field.refuse(accepted))
}

/// Returns why bodies of this kind lack a coordinate; `None` if they have it.
fn absence(name: &str, setup: &JointSetup<'_>) -> Option<&'static str> {
    let is_linear =
        matches!(name, "x" | "y" | "z" | "radial_x" | "radial_y" | "radial_z" | "distance");
    let is_flat = matches!(name, "x" | "y" | "distance" | "angle" | "gear" | "rack" | "pulley");
    match (setup.particles, setup.dimension) {
        (true, _) if !is_linear => Some("particles have no coordinates but linear ones"),
        (_, 2) if !is_flat => {
            Some("in 2D, the coordinates are x, y, distance, angle, gear, rack and pulley")
        }
        (_, 3) if name == "angle" => Some("in 3D, the angle of a hinge is twist"),
        _ => None,
    }
}
