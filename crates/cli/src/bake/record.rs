//! Runs a simulation and records its steps.

use std::process;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use drystone::{Measure, SavedProblem, StepSettings};
use drystone_bake::audit::audit;
use drystone_bake::recording::joints::{JointFrame, JointLayout};
use drystone_bake::recording::journal::{Extras, FrameState, Step};
use drystone_bake::recording::{JointRecording, Recording, Velocities};
use drystone_bake::{AnyWorld, PairImpulses};
use drystone_scene::{Motion, Scene};

use super::journal::{BakeJournal, Kept};
use super::progress::Progress;
use crate::failure::Failure;

/// Speed of a body beyond which the simulation counts as diverged. \[m/s\]
const TOO_FAST: f64 = 1e6;

/// Initial speed beyond which a body is most often in other units. \[m/s\]
const PLAUSIBLE: f64 = 1e4;

/// Set when the user interrupts the bake.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Installs the signal handler. The first signal ends the simulation between two steps; a file that
/// is being written is completed first. A second signal ends the process at once. In either case
/// the bake can be resumed from its journal.
pub(super) fn listen() {
    let heard = || {
        if INTERRUPTED.swap(true, Ordering::SeqCst) {
            process::exit(130);
        }
    };
    // Without a handler a signal ends the process at once; nothing else is lost.
    let _ = ctrlc::set_handler(heard);
}

/// Record of a simulated scene.
pub(super) struct Bake {
    pub(super) recording: Recording,
    pub(super) settings: StepSettings,
    /// Measure of the initial state.
    pub(super) start: Measure,
    pub(super) steps: Vec<Step>,
    /// Joints at each frame.
    pub(super) joints: Vec<JointFrame>,
    /// Recorded data besides poses and joints.
    extras: Extras,
    /// Velocities at each frame, if they are recorded.
    pub(super) velocities: Velocities,
    /// Impulses of contacts at each frame, if they are recorded.
    pub(super) impulses: Vec<PairImpulses>,
    /// Problem of the step to be saved.
    pub(super) saved: Option<SavedProblem>,
}

/// Returns the dynamic body with the largest speed, the first of equal ones.
fn fastest(scene: &Scene, world: &AnyWorld) -> usize {
    let mut numbers = Vec::new();
    world.write_velocities(&mut numbers);
    let speed = |velocity: &[f32]| {
        let linear = velocity.iter().take(scene.dimension);
        linear.map(|x| f64::from(*x).powi(2)).sum::<f64>()
    };
    let each = numbers.chunks_exact(world.kind().velocity_numbers()).map(speed).enumerate();
    let is_dynamic = |body: usize| scene.bodies[body].motion == Motion::Dynamic;
    let own = each.filter(|(body, _)| is_dynamic(*body));
    own.reduce(|most, next| if next.1 > most.1 { next } else { most }).map_or(0, |(body, _)| body)
}

/// Length of a run, and the step to be saved.
#[derive(Clone, Copy)]
pub(super) struct Length {
    pub(super) steps: usize,
    /// Step whose problem is saved, from 1.
    pub(super) dump_step: Option<usize>,
}

impl Bake {
    /// Takes the steps that are not in the journal yet.
    pub(super) fn run(
        world: &mut AnyWorld,
        scene: &Scene,
        length: Length,
        journal: &mut BakeJournal,
        progress: &mut Progress,
    ) -> Result<Self, Failure> {
        let mut bake = Self::new(world, scene, length.steps, journal.extras())?;
        let taken = match journal.kept() {
            Some(kept) => bake.resume(world, length, journal, kept)?,
            None => {
                journal.begin(&bake.last_frame())?;
                0
            }
        };
        for step in taken + 1..=length.steps {
            progress.set(step - 1);
            if INTERRUPTED.load(Ordering::SeqCst) {
                return Err(journal.interrupted(bake.steps.len(), length.steps));
            }
            world.save_systems(length.dump_step == Some(step));
            if step <= bake.steps.len() {
                world.step_scene(scene, step - 1)?;
                journal.compare(step, &bake.steps[step - 1], world.state_hash())?;
            } else {
                bake.step(world, scene, journal)?;
            }
            if length.dump_step == Some(step) {
                bake.saved = world.saved().transpose().map_err(|error| {
                    Failure::Diverged(format!("the contacts of step {step}: {error}"))
                })?;
            }
        }
        progress.finish();
        Ok(bake)
    }

    /// Records the initial state and reserves memory for the steps.
    fn new(
        world: &mut AnyWorld,
        scene: &Scene,
        steps: usize,
        extras: Extras,
    ) -> Result<Self, Failure> {
        world.record_impulses(extras.contacts);
        let recording = Recording {
            dimension: scene.dimension,
            bodies: scene.bodies.len(),
            frame_time: scene.time_step,
            start: 0,
            poses: Vec::new(),
        };
        let settings = world.settings().clone();
        let start = world.measure();
        let joints = vec![JointFrame::of(world, scene)];
        let mut bake = Self {
            recording,
            settings,
            start,
            steps: Vec::new(),
            joints,
            extras,
            velocities: Velocities::default(),
            impulses: Vec::new(),
            saved: None,
        };
        bake.reserve(steps)?;
        world.write_poses(&mut bake.recording.poses);
        bake.record_extras(world);
        Ok(bake)
    }

    /// Takes over the frames of the journal, and returns the number of steps after which the
    /// simulation continues. It repeats the steps since the checkpoint, so that a different build
    /// or machine is noticed.
    fn resume(
        &mut self,
        world: &mut AnyWorld,
        length: Length,
        journal: &mut BakeJournal,
        mut kept: Kept,
    ) -> Result<usize, Failure> {
        kept.steps.truncate(length.steps);
        let frame = self.recording.poses.len();
        kept.poses.truncate((kept.steps.len() + 1) * frame);
        self.recording.poses.splice(.., kept.poses);
        kept.joints.truncate(kept.steps.len() + 1);
        self.joints.splice(.., kept.joints);
        kept.velocities.numbers.truncate((kept.steps.len() + 1) * self.velocities.numbers.len());
        self.velocities.numbers.splice(.., kept.velocities.numbers);
        kept.impulses.truncate(kept.steps.len() + 1);
        self.impulses.splice(.., kept.impulses);
        self.steps.append(&mut kept.steps);
        let (taken, dump) = (self.steps.len(), length.dump_step);
        if taken == length.steps && dump.is_none_or(|step| step > taken) {
            return Ok(taken);
        }
        let before = taken.min(dump.unwrap_or(usize::MAX));
        journal.restore(world, before)
    }

    fn reserve(&mut self, steps: usize) -> Result<(), Failure> {
        let Recording { bodies, dimension, .. } = self.recording;
        let numbers = |stride: usize| (bodies * stride).saturating_mul(steps + 1);
        let poses = numbers(self.recording.stride());
        let spins = if self.extras.velocities { numbers(Velocities::stride(dimension)) } else { 0 };
        let reserved = self.recording.poses.try_reserve_exact(poses);
        let reserved = reserved.and_then(|()| self.velocities.numbers.try_reserve_exact(spins));
        reserved.and_then(|()| self.steps.try_reserve_exact(steps)).map_err(|_| {
            let size = poses.saturating_add(spins) as f64 * 4e-9;
            Failure::File(format!(
                "{steps} steps of {} bodies need {size:.1} GB of memory, which the system \
                 refuses; simulate less with --duration or --steps",
                self.recording.bodies
            ))
        })
    }

    fn step(
        &mut self,
        world: &mut AnyWorld,
        scene: &Scene,
        journal: &mut BakeJournal,
    ) -> Result<(), Failure> {
        let clock = Instant::now();
        let report = world.step_scene(scene, self.steps.len())?;
        let time = clock.elapsed();
        let measure = world.measure();
        world.write_poses(&mut self.recording.poses);
        self.record_extras(world);
        let joints = JointFrame::of(world, scene);
        let step = Step { time, report, measure, state: world.state_hash() };
        if !(measure.finite && measure.fastest <= TOO_FAST) {
            self.steps.push(step);
            return Err(self.divergence(scene, world, &measure));
        }
        self.joints.push(joints);
        journal.write(&step, &self.last_frame(), world)?;
        self.steps.push(step);
        Ok(())
    }

    /// Records velocities and impulses at a frame, if they are to be recorded.
    fn record_extras(&mut self, world: &AnyWorld) {
        if self.extras.velocities {
            world.write_velocities(&mut self.velocities.numbers);
        }
        if self.extras.contacts {
            self.impulses.push(world.impulses());
        }
    }

    /// Returns the state at the last frame.
    fn last_frame(&self) -> FrameState<'_> {
        static NONE: PairImpulses = PairImpulses::NONE;
        let Recording { bodies, dimension, poses, .. } = &self.recording;
        let last = |numbers: &[f32], stride: usize| numbers.len().saturating_sub(bodies * stride);
        let numbers = &self.velocities.numbers;
        FrameState {
            poses: &poses[last(poses, self.recording.stride())..],
            joints: &self.joints[self.joints.len() - 1],
            velocities: &numbers[last(numbers, Velocities::stride(*dimension))..],
            contacts: self.impulses.last().unwrap_or(&NONE),
        }
    }

    /// Returns the number of contact points in the step that led to each frame; 0 for the first.
    pub(super) fn contacts(&self) -> Vec<u32> {
        let steps = self.steps.iter().map(|step| step.report.contacts as u32);
        std::iter::once(0).chain(steps).collect()
    }

    /// Returns the joints over time.
    pub(super) fn joint_recording(&self, scene: &Scene) -> JointRecording {
        let broken = self.steps.iter().map(|step| step.report.broken.as_slice());
        JointRecording::new(JointLayout::of(scene), &self.joints, broken)
    }

    fn divergence(&self, scene: &Scene, world: &AnyWorld, measure: &Measure) -> Failure {
        let broken = self.steps.last().and_then(|step| step.report.not_finite.first());
        let body = broken.map_or_else(|| fastest(scene, world), |&body| body as usize);
        let what = if measure.finite {
            format!("moves at {:.3e} m/s", measure.fastest)
        } else {
            "has a position or velocity that is not finite".to_owned()
        };
        Failure::Diverged(format!(
            "the simulation diverged in step {} ({:.3} s): {} {what}; accepted: up to {TOO_FAST:e} \
             m/s. {}",
            self.steps.len(),
            self.steps.len() as f64 * scene.time_step,
            scene.name_of(body),
            self.advice(scene, body),
        ))
    }

    /// Returns the most likely remedy for divergence in this scene.
    fn advice(&self, scene: &Scene, body: usize) -> String {
        let speed = scene
            .bodies
            .get(body)
            .map_or(0.0, |body| body.linear_velocity.iter().map(|x| x * x).sum::<f64>().sqrt());
        if speed > PLAUSIBLE {
            return format!("It starts at {speed:.3e} m/s: velocities are in m/s and rad/s");
        }
        let first = self.recording.piece(0..=0);
        let overlap = audit(scene, &first, &self.settings, &[]).start;
        if let Some(of) = overlap.filter(|of| of.depth > of.accepted - of.depth) {
            let [a, b] = of.bodies.map(|body| scene.name_of(body));
            let depth = of.depth * 1e3;
            return format!("{a} and {b} overlap by {depth:.3} mm at the start: move them apart");
        }
        if self.settings.tolerance <= 0.0 {
            return "Bake without --realtime, or with --tolerance 1mm/s, so that each substep is \
             solved"
                .to_owned();
        }
        let finer = scene.time_step / 4.0;
        format!("Set time_step to {finer:.1e} s, and run `drystone check`")
    }

    /// Returns the dynamic body with the largest displacement over the last `frames` frames, and
    /// that displacement \[m\]. It is infinite if a pose is not finite.
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
