//! Report of a bake: values of each step, for other programs.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use drystone::{Stage, StepSettings};
use drystone_bake::recording::journal::{Header, Step};
use drystone_scene::write_whole;
use serde::Serialize;

use super::joints;
use super::record::Bake;
use super::summary::Summary;
use crate::failure::Failure;

/// Input of a report.
pub(super) struct ReportInput<'a> {
    pub(super) scene: &'a Path,
    pub(super) header: &'a Header,
    pub(super) threads: usize,
    pub(super) bake: &'a Bake,
    pub(super) summary: &'a Summary,
}

/// The report as it is written. It is serialized from these types, since a JSON value in between
/// would convert each `f32` to `f64` and write 0.019999999552965164 for 0.02.
#[derive(Serialize)]
struct Report<'a> {
    scene: String,
    /// Hash of the scene, which dumped problems and journals have too.
    scene_hash: &'a str,
    version: &'a str,
    settings: &'a StepSettings,
    threads: usize,
    bodies: usize,
    steps: usize,
    summary: &'a Summary,
    per_step: Vec<StepNumbers>,
}

#[derive(Serialize)]
struct StepNumbers {
    step_ms: f64,
    stage_ms: BTreeMap<&'static str, f64>,
    contacts: usize,
    manifolds: usize,
    asleep: usize,
    substeps: u32,
    sweeps: usize,
    /// Deepest penetration. \[m\]
    deepest_penetration: f64,
    /// Kinetic energy. \[J\]
    kinetic_energy: f64,
    /// Potential energy. \[J\]
    potential_energy: f64,
    /// Residual of the contacts. \[m/s\]
    residual: f64,
    /// Largest certified error of an island; absent if nothing was certified. \[m/s\]
    #[serde(skip_serializing_if = "Option::is_none")]
    certificate: Option<f64>,
    /// Hash of all poses and velocities after the step, in hexadecimal.
    state: String,
    /// Largest miss of a joint's locks and limits: of positions \[m\] and of rotations \[rad\].
    /// Absent without joints.
    #[serde(skip_serializing_if = "Option::is_none")]
    joint_gap: Option<[f64; 2]>,
    /// Indices of the joints that broke in the step; absent if none did.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    broken: Vec<u32>,
    /// Energy ledger by item; absent without a ledger. \[J\]
    #[serde(skip_serializing_if = "Option::is_none")]
    energy: Option<BTreeMap<&'static str, f64>>,
}

/// Writes a report as JSON.
pub(super) fn write(path: &Path, run: &ReportInput<'_>) -> Result<(), Failure> {
    // The first frame has no step.
    let gaps = run.bake.joints.iter().skip(1).map(joints::gap);
    let report = Report {
        scene: run.scene.display().to_string(),
        scene_hash: &run.header.scene,
        version: &run.header.version,
        settings: &run.header.settings,
        threads: run.threads,
        bodies: run.bake.recording.bodies,
        steps: run.bake.steps.len(),
        summary: run.summary,
        per_step: run.bake.steps.iter().zip(gaps).map(|(step, gap)| numbers(step, gap)).collect(),
    };
    write_whole(path, |out| {
        serde_json::to_writer(&mut *out, &report)?;
        out.write_all(b"\n")
    })
    .map_err(|error| Failure::cannot_write(path, &error))
}

fn numbers(step: &Step, joint_gap: Option<[f64; 2]>) -> StepNumbers {
    let milliseconds = |time: Duration| time.as_secs_f64() * 1e3;
    let stages = Stage::ALL.into_iter().zip(step.report.stages);
    StepNumbers {
        step_ms: milliseconds(step.time),
        stage_ms: stages.map(|(stage, time)| (stage.name(), milliseconds(time))).collect(),
        contacts: step.report.contacts,
        manifolds: step.report.manifolds,
        asleep: step.report.asleep,
        substeps: step.report.substeps,
        sweeps: step.report.sweeps,
        deepest_penetration: step.measure.deepest_penetration,
        kinetic_energy: step.measure.kinetic_energy,
        potential_energy: step.measure.potential_energy,
        residual: step.measure.residual,
        certificate: step.report.certified.map(|of| of.error),
        state: format!("{:016x}", step.state),
        joint_gap,
        broken: step.report.broken.iter().map(|of| of.joint).collect(),
        energy: step.report.energy.map(|ledger| {
            let sums = [("created", ledger.created()), ("unexplained", ledger.unexplained())];
            ledger.items().into_iter().chain(sums).collect()
        }),
    }
}
