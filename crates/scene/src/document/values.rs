//! Rotations and numbers that may be infinite, as scenes have them.

use schemars::JsonSchema;
use serde::{Serialize, Serializer};

/// 3D: unit quaternion x, y, z, w. 2D: angle [rad].
#[derive(Serialize, JsonSchema)]
#[serde(untagged)]
#[schemars(rename = "Rotation")]
pub(crate) enum RotationDocument {
    Angle(f64),
    Quaternion([f64; 4]),
}

/// A number that may be infinite, which JSON has no number for.
#[derive(JsonSchema)]
#[schemars(untagged)]
#[allow(dead_code, reason = "the schema shows both forms; writing chooses by value")]
pub(crate) enum Unbounded {
    Number(f64),
    Infinite(Infinite),
}

/// The text "inf".
#[derive(JsonSchema)]
#[schemars(rename_all = "snake_case")]
#[allow(dead_code, reason = "as above")]
pub(crate) enum Infinite {
    Inf,
}

impl Serialize for Unbounded {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Unbounded::Number(x) if x.is_finite() => serializer.serialize_f64(*x),
            _ => serializer.serialize_str("inf"),
        }
    }
}
