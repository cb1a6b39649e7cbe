//! A scene in Drystone.

use ::drystone::{StepReport, StepSettings};
use drystone_bake::{AnyWorld, BuildError};
use drystone_scene::Scene;

use super::{Effort, Engine, Refusal};

/// A scene in Drystone.
pub(crate) struct Drystone {
    world: AnyWorld,
    pub(crate) report: StepReport,
}

impl Drystone {
    /// Builds the scene.
    ///
    /// # Errors
    /// Drystone does not support a shape.
    pub(crate) fn new(
        scene: &Scene,
        settings: StepSettings,
        threads: usize,
    ) -> Result<Self, Refusal> {
        // No body sleeps in any engine.
        let settings = StepSettings { sleep_delay: 0.0, ..settings };
        let mut world = drystone_bake::build(scene, settings).map_err(|error| match error {
            BuildError::Shape { body, reason, .. } => Refusal::new(body, reason),
            BuildError::Body { body, error } => Refusal::new(body, error.to_string()),
            BuildError::Joint { joint, error } => Refusal::new(joint, error.to_string()),
            BuildError::Step(error) => Refusal::new("settings", error.to_string()),
        })?;
        world.set_threads(threads);
        Ok(Self { world, report: StepReport::default() })
    }

    /// Makes the reports contain the time of each stage.
    pub(crate) fn timed(mut self) -> Self {
        self.world.time_stages(true);
        self
    }
}

/// Returns the settings for an effort. The scene's own `solver` settings are ignored, since all
/// engines run with their own.
pub(super) fn settings(effort: Effort) -> StepSettings {
    match effort {
        Effort::Default => StepSettings::realtime(),
        Effort::Substeps(substeps) => {
            StepSettings { substeps, max_substeps: substeps, ..StepSettings::realtime() }
        }
        Effort::Sag(sag) => StepSettings { sag: 1e-3 * sag, ..StepSettings::certified() },
    }
}

impl Engine for Drystone {
    fn step(&mut self, dt: f32) -> Result<(), Refusal> {
        self.report =
            self.world.step(dt.into()).map_err(|error| Refusal::new("step", error.to_string()))?;
        Ok(())
    }

    fn write_poses(&self, out: &mut Vec<f32>) {
        self.world.write_poses(out);
    }
}
