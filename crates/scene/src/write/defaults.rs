//! Values that differ from their defaults, bit by bit.

use crate::description::Rotation;
use crate::document::values::RotationDocument;

/// Compares bits, so that -0 differs from 0 and is written.
pub(super) fn same(a: &[f64], b: &[f64]) -> bool {
    a.iter().map(|x| x.to_bits()).eq(b.iter().map(|x| x.to_bits()))
}

pub(super) fn unless(vector: &[f64], default: &[f64]) -> Option<Vec<f64>> {
    (!same(vector, default)).then(|| vector.to_vec())
}

pub(super) fn number_unless(x: f64, default: f64) -> Option<f64> {
    (x.to_bits() != default.to_bits()).then_some(x)
}

pub(super) fn rotation_document(rotation: Rotation) -> RotationDocument {
    match rotation {
        Rotation::Angle(angle) => RotationDocument::Angle(angle),
        Rotation::Quaternion(quaternion) => RotationDocument::Quaternion(quaternion),
    }
}

pub(super) fn rotation_unless(rotation: Rotation, default: Rotation) -> Option<RotationDocument> {
    let equal = match (rotation, default) {
        (Rotation::Angle(a), Rotation::Angle(b)) => same(&[a], &[b]),
        (Rotation::Quaternion(a), Rotation::Quaternion(b)) => same(&a, &b),
        _ => false,
    };
    (!equal).then(|| rotation_document(rotation))
}
