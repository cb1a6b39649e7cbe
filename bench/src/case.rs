//! A scene with the number of steps to run: [`Case`].

use std::path::PathBuf;

use drystone_scene::{Motion, Scene};

/// A scene to run.
pub(crate) struct Case {
    pub(crate) name: String,
    /// File of the scene; `None` if it is made in code.
    pub(crate) file: Option<PathBuf>,
    pub(crate) scene: Scene,
    pub(crate) steps: usize,
    /// Distance from its initial position within which a body counts as standing, if the scene
    /// states it. \[m\]
    pub(crate) stand_tolerance: Option<f64>,
}

impl Case {
    /// Returns the length of a step. \[s\]
    pub(crate) fn dt(&self) -> f32 {
        self.scene.time_step as f32
    }

    /// Returns the number of dynamic bodies.
    pub(crate) fn dynamic_bodies(&self) -> usize {
        self.scene.bodies.iter().filter(|body| body.motion == Motion::Dynamic).count()
    }
}
