//! Running a simulation and keeping what happens.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use drystone::recording::Recording;
use drystone::scene::{Motion, Scene};
use drystone::{Measure, SavedProblem, Simulation, StepReport, StepSettings};
use indicatif::ProgressBar;

use super::INTERRUPTED;
use crate::failure::Failure;

/// A body faster than this has left the realm of the meaningful. \[m/s\]
const TOO_FAST: f64 = 1e6;

/// A step that was taken.
pub(super) struct Step {
    /// Wall time of the library's step alone.
    pub(super) time: Duration,
    pub(super) report: StepReport,
    pub(super) measure: Measure,
    /// [`Simulation::state_hash`] after it.
    pub(super) state: u64,
}

/// A run of a scene.
pub(super) struct Bake {
    pub(super) recording: Recording,
    pub(super) settings: StepSettings,
    /// Before the first step.
    pub(super) start: Measure,
    pub(super) steps: Vec<Step>,
    /// The contact problem of the step that was to be saved.
    pub(super) saved: Option<SavedProblem>,
}

impl Bake {
    /// Takes `steps` steps, and saves the contact problem of one, counted from 1.
    pub(super) fn run(
        simulation: &mut dyn Simulation,
        scene: &Scene,
        steps: u32,
        dump_step: Option<u32>,
        bar: ProgressBar,
    ) -> Result<Self, Failure> {
        let recording = Recording {
            dimension: scene.dimension,
            bodies: scene.bodies.len(),
            frame_time: scene.time_step,
            poses: Vec::new(),
        };
        let settings = simulation.settings().clone();
        let start = simulation.measure();
        let mut bake = Self { recording, settings, start, steps: Vec::new(), saved: None };
        bake.reserve(steps)?;
        simulation.write_poses(&mut bake.recording.poses);
        for step in 1..=steps {
            if INTERRUPTED.load(Ordering::SeqCst) {
                return Err(Failure::Interrupted);
            }
            simulation.save_systems(dump_step == Some(step));
            bake.step(simulation, scene)?;
            if dump_step == Some(step) {
                bake.saved = simulation.saved().transpose().map_err(|error| {
                    Failure::Diverged(format!("the contacts of step {step}: {error}"))
                })?;
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        Ok(bake)
    }

    fn reserve(&mut self, steps: u32) -> Result<(), Failure> {
        let frame = self.recording.bodies * self.recording.stride();
        let numbers = frame.saturating_mul(steps as usize + 1);
        let reserved = self.recording.poses.try_reserve_exact(numbers);
        let reserved = reserved.and_then(|()| self.steps.try_reserve_exact(steps as usize));
        reserved.map_err(|_| {
            let size = numbers as f64 * 4e-9;
            Failure::File(format!(
                "{steps} steps of {} bodies need {size:.1} GB of memory, which cannot be had; \
                 simulate less with --duration or --steps",
                self.recording.bodies
            ))
        })
    }

    fn step(&mut self, simulation: &mut dyn Simulation, scene: &Scene) -> Result<(), Failure> {
        let clock = Instant::now();
        let report = simulation.step(scene.time_step);
        let time = clock.elapsed();
        let measure = simulation.measure();
        simulation.write_poses(&mut self.recording.poses);
        let state = simulation.state_hash();
        self.steps.push(Step { time, report, measure, state });
        if measure.finite && measure.fastest <= TOO_FAST {
            return Ok(());
        }
        Err(self.divergence(scene, &measure))
    }

    /// Points of contact in the step that led to each frame; none to the first.
    pub(super) fn contacts(&self) -> Vec<u32> {
        let steps = self.steps.iter().map(|step| step.report.contacts as u32);
        std::iter::once(0).chain(steps).collect()
    }

    fn divergence(&self, scene: &Scene, measure: &Measure) -> Failure {
        let body = self.moved_most(scene, 1).map_or(0, |(body, _)| body);
        let what = if measure.finite {
            format!("moves at {:.3e} m/s", measure.fastest)
        } else {
            "has a position or velocity that is not finite".to_owned()
        };
        Failure::Diverged(format!(
            "the simulation diverged in step {} ({:.3} s): {} {what}; accepted: up to {TOO_FAST:e} \
             m/s. Look for huge velocities or overlaps at the start, or try more --substeps",
            self.steps.len(),
            self.steps.len() as f64 * scene.time_step,
            scene.name_of(body),
        ))
    }

    /// The dynamic body that moved most in the last `frames` frames, and how far \[m\]; without
    /// a number, it moved infinitely far.
    pub(super) fn moved_most(&self, scene: &Scene, frames: usize) -> Option<(usize, f64)> {
        let last = self.recording.frames().checked_sub(1)?;
        let first = last.saturating_sub(frames);
        (0..self.recording.bodies)
            .filter(|body| scene.bodies[*body].motion == Motion::Dynamic)
            .map(|body| (body, self.distance(first, last, body)))
            .reduce(|most, next| if next.1 > most.1 { next } else { most })
    }

    fn distance(&self, first: usize, last: usize, body: usize) -> f64 {
        let [from, to] = [first, last].map(|frame| self.recording.pose(frame, body));
        if to.iter().any(|x| !x.is_finite()) {
            return f64::INFINITY;
        }
        let apart = from.iter().zip(to).take(self.recording.dimension);
        apart.map(|(x, y)| (f64::from(*y) - f64::from(*x)).powi(2)).sum::<f64>().sqrt()
    }
}
