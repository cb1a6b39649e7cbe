//! [`Case`]: a scene to run, and for how long.

use std::path::PathBuf;

use drystone::scene::{Motion, Scene};

/// A scene to run.
pub(crate) struct Case {
    pub(crate) name: String,
    /// Where it came from, if not from code.
    pub(crate) file: Option<PathBuf>,
    pub(crate) scene: Scene,
    pub(crate) steps: usize,
    /// How far a body may go and still stand, if the scene states it. \[m\]
    pub(crate) stand_tolerance: Option<f64>,
}

impl Case {
    /// Length of a step. \[s\]
    pub(crate) fn dt(&self) -> f32 {
        self.scene.time_step as f32
    }

    /// Bodies that can move.
    pub(crate) fn dynamic_bodies(&self) -> usize {
        self.scene.bodies.iter().filter(|body| body.motion == Motion::Dynamic).count()
    }
}
