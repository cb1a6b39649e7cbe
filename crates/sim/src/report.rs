//! What a step says of itself.

use std::time::Duration;

use drystone_solver::Clock;
use drystone_solver::jam::Jam;
use drystone_solver::ladder::SolveReport;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

use crate::ledger::Ledger;

/// The stages of a step, in order. All repeat in each part of the step that has its own contacts,
/// those from `Predict` to `Relax` in each substep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Boxes that overlap: the broad phase.
    Pairs,
    /// Shapes that touch: the narrow phase.
    Manifolds,
    /// Anchors, gaps and effective masses of each contact; packing.
    Rows,
    /// v* = v + h M^-1 f.
    Predict,
    /// Collisions that bounce.
    Bounce,
    /// Target velocities from gaps, and v += M^-1 J^T gamma of the step before.
    WarmStart,
    /// Sweeps towards the targets, and stronger methods where certificates ask for them.
    Solve,
    /// Certificates; at the end, the search for jams.
    Certify,
    /// Displacements grow by h v; at the end, poses move by them.
    Advance,
    /// A sweep that takes the velocity of overlap repair out again.
    Relax,
    /// gamma and slip for the next step.
    Remember,
}

impl Stage {
    /// All of them, in order.
    pub const ALL: [Self; 11] = [
        Self::Pairs,
        Self::Manifolds,
        Self::Rows,
        Self::Predict,
        Self::Bounce,
        Self::WarmStart,
        Self::Solve,
        Self::Certify,
        Self::Advance,
        Self::Relax,
        Self::Remember,
    ];

    /// Its name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pairs => "pairs",
            Self::Manifolds => "manifolds",
            Self::Rows => "rows",
            Self::Predict => "predict",
            Self::Bounce => "bounce",
            Self::WarmStart => "warm_start",
            Self::Solve => "solve",
            Self::Certify => "certify",
            Self::Advance => "advance",
            Self::Relax => "relax",
            Self::Remember => "remember",
        }
    }
}

/// What [`World::step`](crate::World::step) did.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct StepReport {
    /// Wall time of each stage, in the order of [`Stage::ALL`]; all substeps together. Zero unless asked for
    /// ([`World::time_stages`](crate::World::time_stages)).
    pub stages: [Duration; Stage::ALL.len()],
    /// Pairs of shapes whose boxes overlap, in the last part of the step, as are the next two.
    pub pairs: usize,
    /// Manifolds.
    pub manifolds: usize,
    /// Contact points, those that do not touch yet included.
    pub contacts: usize,
    /// Bodies that sleep after it.
    pub asleep: usize,
    /// Bodies, by slot, whose position or velocity is no longer a finite number. They touch nothing from then on;
    /// the others go on. Removing them and adding them again makes them sound.
    pub not_finite: Vec<u32>,
    /// Substeps that it took.
    pub substeps: u32,
    /// Passes over all contacts.
    pub sweeps: usize,
    /// Collisions that bounced.
    pub collisions: usize,
    /// How far the velocities that moved the bodies can be from the exact ones, all substeps together;
    /// `None` with neither a tolerance nor `certify`.
    pub certified: Option<SolveReport>,
    /// Where the energy of the step came from and went; `None` unless the settings ask for it.
    pub energy: Option<Ledger>,
    /// Contacts whose targets no velocities can meet, in the last part of the step; none unless the
    /// settings ask for certificates. Bodies are slots of the world; contacts those of
    /// [`World::system`](crate::World::system).
    pub jams: Vec<Jam>,
}

impl StepReport {
    /// Takes in what solving or examining a substep has come to, and its time.
    pub(crate) fn join(&mut self, outcome: &SolveReport, clock: &mut StageTimer) {
        clock.lap(Stage::Solve);
        if clock.last.is_some() {
            clock.stages[Stage::Solve as usize] -= outcome.certifying;
            clock.stages[Stage::Certify as usize] += outcome.certifying;
        }
        self.certified.get_or_insert_default().join(outcome);
    }

    /// Wall time of all stages.
    pub fn time(&self) -> Duration {
        self.stages.iter().sum()
    }
}

/// What [`World::measure`](crate::World::measure) finds after a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Measure {
    /// 1/2 v^T M v. \[J\]
    pub kinetic_energy: f64,
    /// -m g . x. \[J\]
    pub potential_energy: f64,
    /// Deepest overlap of any contact. \[m\]
    pub deepest_penetration: f64,
    /// Largest velocity error of any contact against its law. \[m/s\]
    pub residual: f64,
    /// Fastest body. \[m/s\]
    pub fastest: f64,
    /// Whether every position and velocity is a finite number.
    pub finite: bool,
}

/// Two bodies with points of contact, made ahead or touching.
#[derive(Clone, Debug, PartialEq)]
pub struct Nearby {
    /// a and b.
    pub bodies: [usize; 2],
    /// Unit normal, from b towards a.
    pub normal: Vec<f64>,
    /// The least distance of its points, negative where they overlap. \[m\]
    pub gap: f64,
    /// Coulomb coefficient of the pair. \[1\]
    pub friction: f64,
}

/// Charges time to stages.
#[derive(Clone)]
pub(crate) struct StageTimer {
    clock: Clock,
    /// When the last lap ended; none where nobody asks for times.
    last: Option<Duration>,
    pub(crate) stages: [Duration; Stage::ALL.len()],
}

impl StageTimer {
    pub(crate) fn start(clock: Clock) -> Self {
        Self { clock, last: clock.now(), stages: Default::default() }
    }

    /// One for a member of a pool, which starts now, if this one runs.
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

    /// Takes in what another one has charged.
    pub(crate) fn join(&mut self, other: &Self) {
        for (own, other) in self.stages.iter_mut().zip(&other.stages) {
            *own += *other;
        }
    }

    /// Charges the time since the last lap to stages as `others` have charged it, who worked side by side.
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
