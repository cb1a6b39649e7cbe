//! What every method is asked, and what it answers.

use crate::certificate::{Certificate, CertificateScratch};
use crate::{System, Vector, Velocity};

/// When a method stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// Certified error to reach ([`Certificate::error`]). \[m/s\]
    pub tolerance: f64,
    /// Iterations at most. \[1\]
    pub budget: usize,
}

/// How a method ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// What was asked for is reached: the error or the residual is within the tolerance.
    Converged,
    /// The iterations are used up.
    Budget,
    /// More iterations would not help.
    Stalled,
    /// It is proven that there is no solution; of problems given as matrices alone.
    Infeasible,
    /// A number of the system is not finite, its masses or compliances make no sense, or the method
    /// is not for such problems.
    BadInput,
}

impl Status {
    /// The word for it, in lower case.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::Budget => "budget",
            Self::Stalled => "stalled",
            Self::Infeasible => "infeasible",
            Self::BadInput => "bad input",
        }
    }
}

/// The end of a method. The system holds the best velocities and impulses that it met.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// How it ended.
    pub status: Status,
    /// Of the velocities and impulses in the system.
    pub certificate: Certificate,
    /// Certified error before the first iteration and after each. \[m/s\]
    pub history: Vec<f64>,
}

impl Solution {
    /// Iterations made.
    pub fn iterations(&self) -> usize {
        self.history.len().saturating_sub(1)
    }
}

/// Iterations that may pass without lowering the error by a tenth, for methods that sweep: as many
/// as were made before that, but at least this number.
const PATIENCE: usize = 400;

/// What a method keeps of its iterations.
pub(crate) struct Track<const L: usize, const A: usize> {
    goal: Goal,
    patience: usize,
    history: Vec<f64>,
    /// Iterations since the error was last lowered by a tenth, and what it was then.
    idle: usize,
    mark: f64,
    prospective: Vec<Velocity<f64, L, A>>,
    scratch: CertificateScratch<L, A>,
    best: Certificate,
    velocities: Vec<Velocity<f64, L, A>>,
    impulses: Vec<Vector<f64, L>>,
}

impl<const L: usize, const A: usize> Track<L, A> {
    /// From the velocities and impulses of the system.
    pub(crate) fn start(
        system: &System<f64, L, A>,
        prospective: &[Velocity<f64, L, A>],
        goal: &Goal,
        patience: usize,
    ) -> Self {
        let mut scratch = CertificateScratch::default();
        scratch.set_masses(system);
        let best = scratch.certify(system, prospective);
        Self {
            goal: *goal,
            patience,
            history: vec![best.error()],
            idle: 0,
            mark: best.error(),
            prospective: prospective.to_vec(),
            scratch,
            best,
            velocities: system.velocities.clone(),
            impulses: impulses(system).collect(),
        }
    }

    /// After an iteration: its certificate.
    pub(crate) fn record(&mut self, system: &System<f64, L, A>) -> Certificate {
        let certificate = self.scratch.certify(system, &self.prospective);
        let error = certificate.error();
        self.history.push(error);
        self.idle += 1;
        if error < 0.9 * self.mark || (error.is_finite() && !self.mark.is_finite()) {
            (self.idle, self.mark) = (0, error);
        }
        if error < self.best.error() {
            self.best = certificate;
            self.velocities.clone_from(&system.velocities);
            self.impulses.clear();
            self.impulses.extend(impulses(system));
        }
        certificate
    }

    /// How it stands; `Budget` also while iterations are left.
    pub(crate) fn status(&self) -> Status {
        if self.best.error() <= self.goal.tolerance {
            Status::Converged
        } else if self.idle > self.patience.max(self.history.len() / 2) {
            Status::Stalled
        } else {
            Status::Budget
        }
    }

    /// Whether another iteration is due.
    pub(crate) fn goes_on(&self) -> bool {
        self.status() == Status::Budget && self.history.len() <= self.goal.budget
    }

    /// Gives the best iterate back to the system.
    pub(crate) fn end(self, system: &mut System<f64, L, A>, status: Status) -> Solution {
        system.velocities = self.velocities;
        for (contact, impulse) in system.contacts.iter_mut().zip(self.impulses) {
            contact.impulse = impulse;
        }
        Solution { status, certificate: self.best, history: self.history }
    }
}

/// A method all of whose iterations are `iteration`, from the impulses that the system holds.
pub(crate) fn iterate<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    goal: &Goal,
    mut iteration: impl FnMut(&mut System<f64, L, A>),
) -> Solution {
    let prospective = system.velocities.clone();
    system.apply_impulses();
    let mut track = Track::start(system, &prospective, goal, PATIENCE);
    while track.goes_on() {
        iteration(system);
        track.record(system);
    }
    let status = track.status();
    track.end(system, status)
}

fn impulses<const L: usize, const A: usize>(
    system: &System<f64, L, A>,
) -> impl Iterator<Item = Vector<f64, L>> {
    system.contacts.iter().map(|contact| contact.impulse)
}
