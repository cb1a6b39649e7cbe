//! The report: numbers of each step, for other programs.

use std::path::Path;

use drystone::recording::write_whole;
use drystone::{Stage, StepSettings};
use serde_json::{Map, Value, json};

use super::{Bake, Step, Summary};
use crate::failure::Failure;

/// What a report is about.
pub(super) struct Run<'a> {
    pub(super) scene: &'a Path,
    pub(super) settings: &'a StepSettings,
    pub(super) threads: usize,
    pub(super) bake: &'a Bake,
    pub(super) summary: &'a Summary,
}

/// Writes a report as JSON.
pub(super) fn write(path: &Path, run: &Run<'_>) -> Result<(), Failure> {
    let report = json!({
        "scene": run.scene.display().to_string(),
        "version": env!("CARGO_PKG_VERSION"),
        "settings": run.settings,
        "threads": run.threads,
        "bodies": run.bake.recording.bodies,
        "steps": run.bake.steps.len(),
        "summary": run.summary,
        "per_step": run.bake.steps.iter().map(step).collect::<Vec<_>>(),
    });
    write_whole(path, |out| {
        serde_json::to_writer(&mut *out, &report)?;
        out.write_all(b"\n")
    })
    .map_err(|error| Failure::cannot_write(path, &error))
}

fn step(step: &Step) -> Value {
    let milliseconds = |time: std::time::Duration| time.as_secs_f64() * 1e3;
    let stages = Stage::ALL.into_iter().zip(step.report.stages);
    let stage_ms: Map<String, Value> =
        stages.map(|(stage, time)| (stage.name().into(), json!(milliseconds(time)))).collect();
    json!({
        "step_ms": milliseconds(step.time),
        "stage_ms": stage_ms,
        "contacts": step.report.contacts,
        "manifolds": step.report.manifolds,
        "sweeps": step.report.sweeps,
        "deepest_penetration": step.measure.deepest_penetration,
        "kinetic_energy": step.measure.kinetic_energy,
        "potential_energy": step.measure.potential_energy,
        "residual": step.measure.residual,
    })
}
