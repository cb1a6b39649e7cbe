//! Reports of a step: times, counts, errors and energies.

use std::time::Duration;

use drystone_solver::Clock;
use drystone_solver::jam::Jam;
use drystone_solver::ladder::SolveReport;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

use crate::ledger::Ledger;

/// The stages of a step, in order. All repeat in each part of the step that has its own contact
/// search. Those from `Predict` to `Relax` repeat in each substep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Broad phase: pairs of overlapping boxes.
    Pairs,
    /// Narrow phase: contact manifolds.
    Manifolds,
    /// Arms, gaps and effective masses of contacts, packed into lanes.
    Rows,
    /// v* = v + h M^-1 f.
    Predict,
    /// Impacts with restitution.
    Impact,
    /// v += M^-1 J^T gamma with the impulses of the previous substep.
    WarmStart,
    /// Sweeps towards the targets, and stronger methods where certificates require them.
    Solve,
    /// Joints: their targets, the solution of each mechanism, and J after the motion.
    Joints,
    /// Certificates, and at the end the search for jams.
    Certify,
    /// Displacements grow by h v; at the end of a part, poses move by the displacements.
    Advance,
    /// Sweep that removes the velocity of overlap repair.
    Relax,
    /// Storage of gamma and slip for the next step.
    Remember,
}

impl Stage {
    /// All stages, in order.
    pub const ALL: [Self; 12] = [
        Self::Pairs,
        Self::Manifolds,
        Self::Rows,
        Self::Predict,
        Self::Impact,
        Self::WarmStart,
        Self::Solve,
        Self::Joints,
        Self::Certify,
        Self::Advance,
        Self::Relax,
        Self::Remember,
    ];

    /// Returns its name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pairs => "pairs",
            Self::Manifolds => "manifolds",
            Self::Rows => "rows",
            Self::Predict => "predict",
            Self::Impact => "impact",
            Self::WarmStart => "warm_start",
            Self::Solve => "solve",
            Self::Joints => "joints",
            Self::Certify => "certify",
            Self::Advance => "advance",
            Self::Relax => "relax",
            Self::Remember => "remember",
        }
    }
}

/// Report of [`World::step`](crate::World::step).
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct StepReport {
    /// Wall time of each stage, in the order of [`Stage::ALL`], summed over all substeps. Zero
    /// unless [`World::time_stages`](crate::World::time_stages) is on.
    pub stages: [Duration; Stage::ALL.len()],
    /// Number of pairs of shapes whose boxes overlap. This number and the next two are those of the
    /// last part of the step.
    pub pairs: usize,
    /// Number of manifolds.
    pub manifolds: usize,
    /// Number of contact points, including those that do not touch yet.
    pub contacts: usize,
    /// Number of sleeping bodies after the step.
    pub asleep: usize,
    /// Bodies, by slot, whose position or velocity is infinite or NaN. They touch nothing from then
    /// on; the other bodies go on. Remove such a body and add it again to repair it.
    pub not_finite: Vec<u32>,
    /// Number of substeps.
    pub substeps: u32,
    /// Number of passes over all contacts.
    pub sweeps: usize,
    /// Number of impacts with restitution.
    pub collisions: usize,
    /// Certified distance of the velocities that moved the bodies from the exact ones, all substeps
    /// together. `None` with neither a tolerance nor `certify`. If an island is beyond the tolerance,
    /// its `worst` body is one at the contact or joint with the largest residual.
    pub certified: Option<SolveReport>,
    /// Energy balance of the step. `None` unless the setting `ledger` is on.
    pub energy: Option<Ledger>,
    /// Contacts and joints whose targets no velocities can meet, in the last part of the step. Empty
    /// unless the setting `certify` is on. Bodies and joints are slots of the world. Contacts are
    /// those of [`World::system`](crate::World::system).
    pub jams: Vec<Jam>,
    /// Largest miss of a joint's locks and limits after the step: of positions \[m\] and of
    /// rotations \[rad\].
    pub joint_gap: [f64; 2],
    /// Joints that broke in the step.
    pub broken: Vec<BrokenJoint>,
}

/// A joint that broke in a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct BrokenJoint {
    /// Its slot.
    pub joint: u32,
    /// Force on a that broke it: its mean over the step, or over 1/240 s of it. \[N\]
    pub force: f64,
    /// Torque on a about the joint, over the same time. \[N m\]
    pub torque: f64,
}

impl StepReport {
    /// Adds the outcome of solving or examining a substep, and charges its time.
    pub(crate) fn join(&mut self, outcome: &SolveReport, clock: &mut StageTimer) {
        clock.lap(Stage::Solve);
        if clock.last.is_some() {
            clock.stages[Stage::Solve as usize] -= outcome.certifying;
            clock.stages[Stage::Certify as usize] += outcome.certifying;
        }
        self.certified.get_or_insert_default().join(outcome);
    }

    /// Returns the wall time of all stages.
    pub fn time(&self) -> Duration {
        self.stages.iter().sum()
    }
}

/// Measurements by [`World::measure`](crate::World::measure) after a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Measure {
    /// 1/2 v^T M v of the dynamic bodies, held ones included. \[J\]
    pub kinetic_energy: f64,
    /// -m g . x of the same bodies. \[J\]
    pub potential_energy: f64,
    /// Deepest overlap of any contact. \[m\]
    pub deepest_penetration: f64,
    /// Largest velocity error of any contact with respect to its contact law. \[m/s\]
    pub residual: f64,
    /// Largest speed of a dynamic body. \[m/s\]
    pub fastest: f64,
    /// True if every position and velocity is finite.
    pub finite: bool,
}

/// Two bodies with contact points. The points may be speculative or touch.
#[derive(Clone, Debug, PartialEq)]
pub struct Nearby {
    /// Bodies a and b.
    pub bodies: [usize; 2],
    /// Unit normal, from b towards a.
    pub normal: Vec<f64>,
    /// Smallest gap of its points, negative for an overlap. \[m\]
    pub gap: f64,
    /// Coulomb friction coefficient of the pair. \[1\]
    pub friction: f64,
}

/// Contact points of the last substep, one entry per point
/// ([`World::contact_points`](crate::World::contact_points)).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ContactPoints {
    /// Bodies a and b, as slots.
    pub bodies: Vec<[u32; 2]>,
    /// World positions: two or three numbers each. \[m\]
    pub points: Vec<f32>,
    /// Contact frames: the unit normal from b towards a, then the tangents. Four or nine numbers
    /// each.
    pub frames: Vec<f32>,
    /// Impulses of the last substep along the axes of the frame, without those of impacts. Two or
    /// three numbers each. \[N s\]
    pub impulses: Vec<f32>,
    /// Distances between the surfaces, negative where they overlap. \[m\]
    pub gaps: Vec<f32>,
    /// Coulomb friction coefficients. \[1\]
    pub friction: Vec<f32>,
}

/// Timer that charges time to stages.
#[derive(Clone)]
pub(crate) struct StageTimer {
    clock: Clock,
    /// End of the last lap; `None` if no times are measured.
    last: Option<Duration>,
    pub(crate) stages: [Duration; Stage::ALL.len()],
}

impl StageTimer {
    pub(crate) fn start(clock: Clock) -> Self {
        Self { clock, last: clock.now(), stages: Default::default() }
    }

    /// Returns a timer for a worker. It starts now, if this one runs.
    pub(crate) fn another(&self) -> Self {
        Self::start(self.clock)
    }

    /// Charges the time since the last lap to `stage`.
    pub(crate) fn lap(&mut self, stage: Stage) {
        if self.last.is_some() {
            self.stages[stage as usize] += self.clock.since(self.last);
            self.last = self.clock.now();
        }
    }

    /// Adds the times that another timer has charged.
    pub(crate) fn join(&mut self, other: &Self) {
        for (own, other) in self.stages.iter_mut().zip(&other.stages) {
            *own += *other;
        }
    }

    /// Charges the time since the last lap to stages, in proportion to the times charged by
    /// `others`, which ran in parallel.
    pub(crate) fn lap_as(&mut self, others: &Self) {
        let all = others.stages.iter().sum::<Duration>();
        let passed = self.clock.since(self.last).as_secs_f64();
        self.last = self.clock.now();
        for (own, other) in self.stages.iter_mut().zip(&others.stages) {
            if !other.is_zero() {
                *own += other.mul_f64(passed / all.as_secs_f64());
            }
        }
    }
}
