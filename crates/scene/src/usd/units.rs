//! [`StageUnits`]: units, axes and time codes of a stage.

use crate::graph::math::{self, Quat, Vec3};

/// Rotation from z-up to y-up: by -90° about x.
const Z_TO_Y: Quat = [-std::f64::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2];

/// Units and conventions of a stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageUnits {
    /// Unit of length. \[m\]
    pub meters: f64,
    /// Unit of mass. \[kg\]
    pub kilograms: f64,
    /// True if z points up, false if y does.
    pub z_up: bool,
    /// Time codes per second. \[1/s\]
    pub rate: f64,
    /// The time code at which the simulation starts.
    pub start: f64,
}

impl StageUnits {
    /// Meters and kilograms with +y up, as in scenes; 24 time codes per second, from 0.
    pub const METERS: Self =
        Self { meters: 1.0, kilograms: 1.0, z_up: false, rate: 24.0, start: 0.0 };

    /// Converts a position of the scene to the stage.
    pub fn to_stage(&self, position: Vec3) -> Vec3 {
        let turned = self.direction_to_stage(position);
        if self.meters == 1.0 { turned } else { turned.map(|x| x / self.meters) }
    }

    /// Converts a direction of the scene to the stage.
    pub fn direction_to_stage(&self, [x, y, z]: Vec3) -> Vec3 {
        if self.z_up { [x, -z, y] } else { [x, y, z] }
    }

    /// Converts a rotation of the scene to the stage.
    pub fn turn_to_stage(&self, turn: Quat) -> Quat {
        if self.z_up { math::quat_mul(math::conjugate(Z_TO_Y), turn) } else { turn }
    }

    /// Converts a direction of the stage to the scene, where y is up.
    pub(super) fn direction(&self, [x, y, z]: Vec3) -> Vec3 {
        if self.z_up { [x, z, -y] } else { [x, y, z] }
    }

    /// Converts a position or a velocity.
    pub(super) fn length(&self, vector: Vec3) -> Vec3 {
        let turned = self.direction(vector);
        if self.meters == 1.0 { turned } else { math::scale(turned, self.meters) }
    }

    pub(super) fn turn(&self, turn: Quat) -> Quat {
        if self.z_up { math::quat_mul(Z_TO_Y, turn) } else { turn }
    }

    /// Unit of density. \[kg/m^3\]
    pub(super) fn density(&self) -> f64 {
        self.kilograms / self.meters.powi(3)
    }

    /// Converts a time code to a time from the start of the simulation. \[s\]
    pub(super) fn seconds(&self, code: f64) -> f64 {
        (code - self.start) / self.rate
    }
}
