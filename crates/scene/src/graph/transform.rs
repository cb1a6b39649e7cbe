//! Transforms of nodes relative to their parents.

use super::math::{self, Mat3, Quat, Vec3};

/// An affine map: a linear map and a translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    /// Linear map.
    pub linear: Mat3,
    /// Translation.
    pub shift: Vec3,
}

impl Affine {
    /// Identity.
    pub const IDENTITY: Self = Self { linear: math::IDENTITY, shift: [0.0; 3] };

    /// Returns `self` after `inner`.
    #[must_use]
    pub fn after(&self, inner: &Self) -> Self {
        Self {
            linear: math::mul(self.linear, inner.linear),
            shift: math::add(math::apply(self.linear, inner.shift), self.shift),
        }
    }

    /// Maps a point.
    pub fn point(&self, p: Vec3) -> Vec3 {
        math::add(math::apply(self.linear, p), self.shift)
    }
}

/// Translation, rotation and scale of a node relative to its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trs {
    /// Translation.
    pub translation: Vec3,
    /// Rotation.
    pub rotation: Quat,
    /// Scale factors along the rotated axes.
    pub scale: Vec3,
}

impl Trs {
    /// Returns the map of the node's space to that of its parent.
    pub fn affine(&self) -> Affine {
        let linear = math::mul(math::rotation(self.rotation), math::diagonal(self.scale));
        Affine { linear, shift: self.translation }
    }
}

/// Splits a linear map into rotation and scale, and returns the shear left over relative to the
/// largest scale. `None` if an axis collapses.
pub fn split(linear: Mat3) -> Option<(Quat, Vec3, f64)> {
    let [x, y, z] = linear;
    let mut sizes = [math::length(x), math::length(y), math::length(z)];
    let ux = math::unit(x)?;
    let uy = math::unit(math::sub(y, math::scale(ux, math::dot(ux, y))))?;
    let uz = math::cross(ux, uy);
    let mirrored = math::determinant(linear) < 0.0;
    if math::dot(uz, z) == 0.0 {
        return None;
    }
    let mut axes = [ux, uy, uz];
    if mirrored {
        // One axis takes the reflection, so that the rotation stays proper.
        sizes[0] = -sizes[0];
        axes = [math::scale(ux, -1.0), uy, math::scale(uz, -1.0)];
    }
    let exact = math::mul(axes, math::diagonal(sizes));
    let largest = sizes.iter().fold(0.0_f64, |most, s| most.max(s.abs()));
    let off = exact.iter().flatten().zip(linear.iter().flatten());
    let shear = off.fold(0.0_f64, |most, (a, b)| most.max((a - b).abs())) / largest;
    Some((math::from_rotation(axes), sizes, shear))
}
