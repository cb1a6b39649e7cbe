//! Names of the coordinates of a joint on a stage.
//!
//! Those of UsdPhysics come from its schemas of limits and drives. The others exist in attributes of
//! the namespace `drystone:` only.

use crate::joint::Coordinate;

/// Names of all coordinates, in the order in which a joint of UsdPhysics lists them.
pub(crate) const NAMES: [&str; 21] = [
    "transX",
    "transY",
    "transZ",
    "radialX",
    "radialY",
    "radialZ",
    "distance",
    "angle",
    "rotX",
    "rotY",
    "rotZ",
    "cone",
    "ellipticCone",
    "rotation",
    "cardanX",
    "cardanY",
    "cardanZ",
    "gear",
    "rack",
    "screw",
    "pulley",
];

/// Index of `distance`.
pub(crate) const DISTANCE: usize = 6;
/// Index of `cone`.
pub(crate) const CONE: usize = 11;
/// Index of `ellipticCone`.
pub(crate) const ELLIPTIC: usize = 12;
/// Indices of `transX`, `transY` and `transZ`.
pub(crate) const TRANS: [usize; 3] = [0, 1, 2];
/// Indices of `rotX`, `rotY` and `rotZ`.
pub(crate) const ROT: [usize; 3] = [8, 9, 10];

/// Returns true if a limit or a drive of UsdPhysics may have this coordinate.
pub(crate) fn is_shared(place: usize) -> bool {
    matches!(place, 0..=2 | 6 | 8..=10)
}

/// Returns true if UsdPhysics states this coordinate in degrees.
pub(crate) fn is_angle(place: usize) -> bool {
    matches!(place, 8..=12)
}

/// Returns the index of a coordinate in [`NAMES`].
pub(crate) fn place_of(coordinate: &Coordinate) -> usize {
    match coordinate {
        Coordinate::Linear(0) => 0,
        Coordinate::Linear(1) => 1,
        Coordinate::Linear(_) => 2,
        Coordinate::Radial(0) => 3,
        Coordinate::Radial(1) => 4,
        Coordinate::Radial(_) => 5,
        Coordinate::Distance => 6,
        Coordinate::Angle => 7,
        Coordinate::Twist => 8,
        Coordinate::Swing(0 | 1) => 9,
        Coordinate::Swing(_) => 10,
        Coordinate::Cone => 11,
        Coordinate::EllipticCone(_) => 12,
        Coordinate::Rotation => 13,
        Coordinate::Cardan(0) => 14,
        Coordinate::Cardan(1) => 15,
        Coordinate::Cardan(_) => 16,
        Coordinate::Gear { .. } => 17,
        Coordinate::Rack { .. } => 18,
        Coordinate::Screw { .. } => 19,
        Coordinate::Pulley { .. } => 20,
    }
}

/// Returns the index of the coordinate whose axis comes `by` places later: z after y, x after z.
/// Coordinates without an axis stay.
pub(crate) fn shifted(place: usize, by: usize) -> usize {
    for trio in [TRANS, [3, 4, 5], ROT, [14, 15, 16]] {
        if let Some(axis) = trio.iter().position(|of| *of == place) {
            return trio.into_iter().cycle().skip(axis).nth(by).unwrap_or(place);
        }
    }
    place
}
