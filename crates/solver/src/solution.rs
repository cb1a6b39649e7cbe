//! Stopping criteria and results common to all methods.

use crate::certificate::{Certificate, CertificateScratch};
use crate::{System, Vector, Velocity};

/// Stopping criteria of a method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// Certified error to reach ([`Certificate::error`]). \[m/s\]
    pub tolerance: f64,
    /// Largest number of iterations. \[1\]
    pub budget: usize,
}

/// Status of a method at its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The error or the residual is within the tolerance.
    Converged,
    /// The iterations are used up.
    Budget,
    /// Further iterations would not help.
    Stalled,
    /// It is proven that there is no solution; only for problems given as matrices.
    Infeasible,
    /// A number is not finite, a mass or compliance is invalid, or the method does not apply to the
    /// problem.
    BadInput,
}

impl Status {
    /// Returns its name in lower case.
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

/// Result of a method. The system holds the best velocities and impulses found.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Status at the end.
    pub status: Status,
    /// Certificate of the velocities and impulses in the system.
    pub certificate: Certificate,
    /// Certified error before the first iteration and after each. \[m/s\]
    pub history: Vec<f64>,
}

impl Solution {
    /// Returns the number of iterations.
    pub fn iterations(&self) -> usize {
        self.history.len().saturating_sub(1)
    }
}

/// Iterations without a 10 % reduction of the error before a method with sweeps counts as stalled.
/// The limit is half of all iterations so far if that is more.
const PATIENCE: usize = 400;

/// History and best iterate of a method.
pub(crate) struct Track<const L: usize, const A: usize> {
    goal: Goal,
    patience: usize,
    history: Vec<f64>,
    /// Iterations since the last 10 % reduction of the error; `mark` is the error at that time.
    idle: usize,
    mark: f64,
    prospective: Vec<Velocity<f64, L, A>>,
    scratch: CertificateScratch<L, A>,
    best: Certificate,
    velocities: Vec<Velocity<f64, L, A>>,
    impulses: Vec<Vector<f64, L>>,
    of_axes: Vec<f64>,
}

impl<const L: usize, const A: usize> Track<L, A> {
    /// Starts from the velocities and impulses of the system.
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
            of_axes: system.axes.iter().map(|axis| axis.impulse).collect(),
        }
    }

    /// Records the system after an iteration, and returns its certificate.
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
            self.of_axes.clear();
            self.of_axes.extend(system.axes.iter().map(|axis| axis.impulse));
        }
        certificate
    }

    /// Returns the current status; `Budget` also while iterations are left.
    pub(crate) fn status(&self) -> Status {
        if self.best.error() <= self.goal.tolerance {
            Status::Converged
        } else if self.idle > self.patience.max(self.history.len() / 2) {
            Status::Stalled
        } else {
            Status::Budget
        }
    }

    /// Returns true if another iteration is due.
    pub(crate) fn goes_on(&self) -> bool {
        self.status() == Status::Budget && self.history.len() <= self.goal.budget
    }

    /// Copies the best iterate back to the system.
    pub(crate) fn end(self, system: &mut System<f64, L, A>, status: Status) -> Solution {
        system.velocities = self.velocities;
        for (contact, impulse) in system.contacts.iter_mut().zip(self.impulses) {
            contact.impulse = impulse;
        }
        for (axis, impulse) in system.axes.iter_mut().zip(self.of_axes) {
            axis.impulse = impulse;
        }
        Solution { status, certificate: self.best, history: self.history }
    }
}

/// Runs a method that repeats `iteration`, from the impulses in the system.
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
