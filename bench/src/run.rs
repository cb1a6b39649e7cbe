//! Runs one scene in one engine and records times and poses.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::time::Instant;

use cpu_time::ProcessTime;

use crate::case::Case;
use crate::engines::{Engine, Refusal};

/// Interval between recorded poses, in steps.
const SAMPLE: usize = 20;

/// Record of one run of one engine.
pub(crate) struct Run {
    /// Time of each step: processor time, or wall time with more than one thread. \[ms\]
    pub(crate) times: Vec<f64>,
    /// Poses at intervals in the last quarter.
    pub(crate) samples: Vec<Vec<f32>>,
    /// Poses at the end.
    pub(crate) end: Vec<f32>,
}

impl Run {
    /// Returns a hash of the final poses that depends on every bit.
    pub(crate) fn fingerprint(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        self.end.iter().for_each(|x| x.to_bits().hash(&mut hasher));
        hasher.finish()
    }
}

/// Returns the first step of the last quarter.
pub(crate) fn settled(steps: usize) -> usize {
    steps - steps / 4
}

/// Runs a scene to its end.
///
/// # Errors
/// The engine fails in a step.
pub(crate) fn run<E: Engine + ?Sized>(
    case: &Case,
    engine: &mut E,
    threads: usize,
    mut after_step: impl FnMut(usize, &E),
) -> Result<Run, Refusal> {
    let mut times = Vec::with_capacity(case.steps);
    let mut samples = Vec::new();
    // Reading the processor time takes almost a microsecond, a tenth of the shortest steps.
    let asking = median((0..1000).map(|_| timed(threads, || ()).1).collect());
    for step in 0..case.steps {
        let (done, time) = timed(threads, || engine.step(case.dt()));
        done?;
        times.push((time - asking).max(0.0));
        after_step(step, engine);
        if step >= settled(case.steps) && (case.steps - 1 - step).is_multiple_of(SAMPLE) {
            samples.push(poses(engine));
        }
    }
    Ok(Run { times, samples, end: poses(engine) })
}

/// Returns the result of `work` and its time: processor time, or wall time with more than one
/// thread. \[ms\]
fn timed<T>(threads: usize, work: impl FnOnce() -> T) -> (T, f64) {
    // Processor time is that of the whole process, since an engine may use a thread of its own.
    let (clock, processor) = (Instant::now(), ProcessTime::now());
    let done = work();
    let time = if threads == 1 { processor.elapsed() } else { clock.elapsed() };
    (done, time.as_secs_f64() * 1e3)
}

fn poses<E: Engine + ?Sized>(engine: &E) -> Vec<f32> {
    let mut poses = Vec::new();
    engine.write_poses(&mut poses);
    poses
}

/// Returns the mean.
pub(crate) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Returns the median.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let half = values.len() / 2;
    if values.len() % 2 == 1 { values[half] } else { 0.5 * (values[half - 1] + values[half]) }
}

/// Returns the 10th percentile.
pub(crate) fn undisturbed(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 10]
}

/// Returns the mean time per step from step `from` on, using the median of each step over the
/// rounds. A disturbance thus counts only if it hits the same step in most rounds. \[ms\]
pub(crate) fn per_step(rounds: &[Vec<f64>], from: usize) -> f64 {
    let steps = rounds[0].len();
    let each: Vec<f64> = (from..steps)
        .map(|step| median(rounds.iter().map(|round| round[step]).collect()))
        .collect();
    mean(&each)
}
