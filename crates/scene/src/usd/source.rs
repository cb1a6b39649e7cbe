//! [`StageSource`]: what is needed to write a layer over the stage that a scene was read from.

use std::path::PathBuf;

use super::transform::{Pose, Transform};
use super::units::StageUnits;
use crate::graph::math::Mat3;
use crate::graph::transform::Affine;

/// The stage that a scene was read from.
#[derive(Clone, Debug, PartialEq)]
pub struct StageSource {
    /// Root layer.
    pub file: PathBuf,
    /// All layers, also those that are referenced.
    pub layers: Vec<PathBuf>,
    /// Units and conventions.
    pub units: StageUnits,
    /// True if the stage states its time codes per second.
    pub has_rate: bool,
    /// Name of the default prim, if there is one.
    pub default_prim: Option<String>,
    /// Prims of the bodies of the scene.
    pub bodies: Vec<StageBody>,
    /// Paths of the prims of the joints of the scene.
    pub joints: Vec<String>,
    /// Paths of instances that contain bodies or joints. Nothing below an instance can be changed.
    pub instances: Vec<String>,
}

/// Prim of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct StageBody {
    /// Path of the prim.
    pub path: String,
    /// True if the stage itself does not move the prim as the simulation does.
    pub is_written: bool,
    /// True if the transform of the prim is relative to the stage, not to its parent.
    pub reset: bool,
    /// Nearest body above the prim that is written, if the prim's transform depends on it.
    pub carrier: Option<usize>,
    /// Linear map of the prim's space to the stage, without rotation.
    pub rest: Mat3,
    /// Transforms of the prims between this one and its carrier or the stage, upwards.
    pub(super) above: Vec<Transform>,
}

impl StageBody {
    /// Returns the map from the prim's parent to its carrier, or to the stage without one.
    pub fn above(&self, code: f64) -> Affine {
        let poses = self.above.iter().map(|own| own.at(Some(code)));
        poses.fold(Pose::REST, |pose, own| own.after(&pose)).map
    }
}
