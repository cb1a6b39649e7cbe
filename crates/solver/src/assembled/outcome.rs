//! Limits and outcome of every method.

use std::time::{Duration, Instant};

use super::Problem;
use super::jam::SelfStress;
pub use crate::solution::Status;

/// Stopping criteria of a method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// [`Problem::residual`] to reach. \[1\]
    pub tolerance: f64,
    /// Largest number of iterations, of the method's own kind.
    pub budget: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { tolerance: 1e-9, budget: 100_000 }
    }
}

/// Residual of a method at some iteration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Iterations done.
    pub iteration: usize,
    /// [`Problem::residual`] at that iteration. \[1\]
    pub residual: f64,
    /// Time since the start, including the evaluation of residuals. \[s\]
    pub elapsed: Duration,
}

/// Result of a method. Methods never panic, and never report convergence above the tolerance.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Status at the end.
    pub status: Status,
    /// Reason for the status, in a few words.
    pub reason: &'static str,
    /// r of the best iterate: finite, within the friction cones and bounds in every case. \[N s\]
    pub impulses: Vec<f64>,
    /// [`Problem::residual`] of `impulses`. \[1\]
    pub residual: f64,
    /// Iterations done: sweeps, pivots, Newton steps.
    pub iterations: usize,
    /// Residuals in the order of iterations.
    pub history: Vec<Sample>,
    /// Proof that there is no solution, if there is one.
    pub certificate: Option<SelfStress>,
}

/// Best iterate so far, and the history.
pub(super) struct Progress<'a> {
    pub(super) problem: &'a Problem,
    pub(super) limits: Limits,
    best: Vec<f64>,
    projected: Vec<f64>,
    residual: f64,
    history: Vec<Sample>,
    started: Instant,
    pub(super) iterations: usize,
}

impl<'a> Progress<'a> {
    /// Starts from `warm`, or from zero if that is `None` or invalid. Also returns the start.
    pub(super) fn new(
        problem: &'a Problem,
        warm: Option<&[f64]>,
        limits: &Limits,
    ) -> (Self, Vec<f64>) {
        let usable = |r: &&[f64]| r.len() == problem.unknowns() && r.iter().all(|x| x.is_finite());
        let zero = || vec![0.0; problem.unknowns()];
        let start = warm.filter(usable).map_or_else(zero, <[f64]>::to_vec);
        let mut progress = Self::unmeasured(problem, limits);
        progress.record(&start);
        (progress, start)
    }

    /// Starts from zero, whose residual is not yet evaluated.
    pub(super) fn unmeasured(problem: &'a Problem, limits: &Limits) -> Self {
        Self {
            problem,
            limits: *limits,
            best: vec![0.0; problem.unknowns()],
            projected: vec![0.0; problem.unknowns()],
            residual: f64::INFINITY,
            history: Vec::new(),
            started: Instant::now(),
            iterations: 0,
        }
    }

    /// Projects an iterate onto the cones and bounds, evaluates the residual, and keeps the best iterate.
    ///
    /// The residual alone bounds a violation of the cones only relative to q, which can be much
    /// larger than the impulses.
    pub(super) fn record(&mut self, r: &[f64]) -> f64 {
        self.projected.copy_from_slice(r);
        self.problem.project(&mut self.projected);
        let residual = self.problem.residual(&self.projected);
        let elapsed = self.started.elapsed();
        self.history.push(Sample { iteration: self.iterations, residual, elapsed });
        if residual < self.residual {
            self.residual = residual;
            self.best.copy_from_slice(&self.projected);
        }
        residual
    }

    pub(super) fn residual(&self) -> f64 {
        self.residual
    }

    pub(super) fn converged(&self) -> bool {
        self.residual <= self.limits.tolerance
    }

    pub(super) fn spent(&self) -> bool {
        self.iterations >= self.limits.budget
    }

    /// Builds the outcome. The status is `Converged` whenever the residual is within the tolerance.
    pub(super) fn end(self, status: Status, reason: &'static str) -> Outcome {
        let (status, reason) = match status {
            Status::Converged => (status, reason),
            _ if self.converged() => (Status::Converged, "within the tolerance"),
            _ => (status, reason),
        };
        Outcome {
            status,
            reason,
            impulses: self.best,
            residual: self.residual,
            iterations: self.iterations,
            history: self.history,
            certificate: None,
        }
    }

    pub(super) fn out_of_budget(self) -> Outcome {
        self.end(Status::Budget, "the iterations are used up")
    }

    pub(super) fn infeasible(self, certificate: SelfStress) -> Outcome {
        let outcome =
            self.end(Status::Infeasible, "a self-stress proves that there is no solution");
        let infeasible = outcome.status == Status::Infeasible;
        Outcome { certificate: Some(certificate).filter(|_| infeasible), ..outcome }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assembled::from_entries;

    #[test]
    fn what_is_kept_lies_within_the_cones() {
        // With a large q the residual hides a violation of the cone.
        let diagonal: Vec<_> = (0..3).map(|i| (i, i, 1e9)).collect();
        let matrix = from_entries(3, 3, &diagonal).unwrap();
        let problem = Problem::new(3, vec![0.5], matrix, vec![-1e9, 4e8, 0.0]).unwrap();
        let (mut progress, _) = Progress::new(&problem, None, &Limits::default());
        progress.record(&[1.0, -0.5 - 3.5e-6, 0.0]);
        let outcome = progress.out_of_budget();
        let [n, x, y] = outcome.impulses[..] else { panic!("three numbers") };
        assert!(n >= 0.0 && (x * x + y * y).sqrt() <= 0.5 * n * (1.0 + 1e-15), "{n} {x} {y}");
        assert_eq!(outcome.residual, problem.residual(&outcome.impulses));
    }
}
