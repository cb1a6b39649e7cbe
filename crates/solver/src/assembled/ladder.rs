//! [`solve`]: tries the cheapest method first, and the next one where it makes no progress.
//!
//! | | without friction | with friction, or with rows of joints |
//! |---|---|---|
//! | 1 | [`block_gauss_seidel`], as long as its rate predicts a quick end | the same |
//! | 2 | [`proximal`] | [`proximal`] |
//! | 3 | [`newton`] | [`block_gauss_seidel`], up to 20 000 sweeps |
//! | 4 | [`lemke`] | [`proximal`], from there |
//! | 5 | [`enumeration`] | |
//! | 6 | [`jam::find`]: a proof that there is no solution | |
//! | 7 | [`block_gauss_seidel`], to the end of the budget | |
//!
//! [`newton`], [`lemke`] and [`enumeration`] start by themselves, the others from the best iterate
//! so far. Only residuals, rates and sizes decide.

use std::time::{Duration, Instant};

use super::outcome::{Limits, Outcome, Progress, Sample, Status};
use super::{
    Problem, block_gauss_seidel, enumeration, interior_point, jam, lemke, newton, proximal,
};
use crate::real::ln;

/// Sweeps from which the rate of Gauss-Seidel is estimated.
const TRIAL: usize = 60;
/// Largest predicted number of sweeps that is preferred to a Newton step.
const WORTH: f64 = 120.0;
/// Largest number of pivots per contact for a proof of infeasibility.
const PIVOTS: usize = 50;

/// A method for problems given as matrices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MatrixMethod {
    /// [`block_gauss_seidel`]
    GaussSeidel,
    /// [`proximal`]
    Proximal,
    /// [`newton`]
    Newton,
    /// [`lemke`]
    Lemke,
    /// [`enumeration`]
    Enumeration,
    /// [`interior_point`]
    InteriorPoint,
}

impl MatrixMethod {
    /// All methods.
    pub const ALL: [Self; 6] = [
        Self::GaussSeidel,
        Self::Proximal,
        Self::Newton,
        Self::Lemke,
        Self::Enumeration,
        Self::InteriorPoint,
    ];

    /// Returns its name in lower case, with hyphens.
    pub fn name(self) -> &'static str {
        match self {
            Self::GaussSeidel => "gauss-seidel",
            Self::Proximal => "proximal",
            Self::Newton => "newton",
            Self::Lemke => "lemke",
            Self::Enumeration => "enumeration",
            Self::InteriorPoint => "interior-point",
        }
    }

    /// Runs this method alone.
    pub fn solve(self, problem: &Problem, warm: Option<&[f64]>, limits: &Limits) -> Outcome {
        let solve = match self {
            Self::GaussSeidel => block_gauss_seidel::solve,
            Self::Proximal => proximal::solve,
            Self::Newton => newton::solve,
            Self::Lemke => lemke::solve,
            Self::Enumeration => enumeration::solve,
            Self::InteriorPoint => interior_point::solve,
        };
        solve(problem, warm, limits)
    }
}

/// Result of the ladder.
#[derive(Clone, Debug)]
pub struct Solved {
    /// Method of the best iterate, or of the proof.
    pub method: MatrixMethod,
    /// Outcome with the best iterate; its iterations and history cover all methods.
    pub outcome: Outcome,
    /// Attempts in their order.
    pub attempts: Vec<Attempt>,
}

/// An attempt of the ladder with one method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attempt {
    /// Method of the attempt.
    pub method: MatrixMethod,
    /// Status at its end.
    pub status: Status,
    /// Its own iterations.
    pub iterations: usize,
    /// Its best residual. \[1\]
    pub residual: f64,
}

/// Solves a problem with the first method that succeeds. `limits.budget` applies to all methods
/// together and counts the iterations of each.
pub fn solve(problem: &Problem, warm: Option<&[f64]>, limits: &Limits) -> Solved {
    let mut ladder = Ladder::new(problem, warm, limits);
    ladder.climb();
    ladder.solved
}

struct Ladder<'a> {
    problem: &'a Problem,
    limits: &'a Limits,
    warm: Option<&'a [f64]>,
    started: Instant,
    solved: Solved,
}

impl<'a> Ladder<'a> {
    fn new(problem: &'a Problem, warm: Option<&'a [f64]>, limits: &'a Limits) -> Self {
        let started = Instant::now();
        let outcome = Progress::unmeasured(problem, limits).out_of_budget();
        let solved = Solved { method: MatrixMethod::GaussSeidel, outcome, attempts: Vec::new() };
        Self { problem, limits, warm, started, solved }
    }

    fn climb(&mut self) {
        let promised = self.rung(MatrixMethod::GaussSeidel, TRIAL, true);
        if self.done() {
            return;
        }
        if let Some(sweeps) = promised
            && sweeps <= WORTH
        {
            self.rung(MatrixMethod::GaussSeidel, sweeps as usize + TRIAL, true);
        }
        if self.problem.dimension() == 1 && self.problem.rows().is_empty() {
            let n = self.problem.unknowns();
            let newton = n <= newton::MOST;
            self.next(MatrixMethod::Proximal, 100 + 2 * n, true);
            self.next_if(newton, MatrixMethod::Newton, 500, false);
            self.next_if(n <= lemke::MOST, MatrixMethod::Lemke, usize::MAX, false);
            self.next_if(n <= enumeration::MOST, MatrixMethod::Enumeration, usize::MAX, false);
            self.prove();
            self.next(MatrixMethod::GaussSeidel, usize::MAX, true);
        } else {
            self.next(MatrixMethod::Proximal, 2000, true);
            self.next(MatrixMethod::GaussSeidel, 20_000, true);
            self.next(MatrixMethod::Proximal, 2000, true);
        }
    }

    fn done(&self) -> bool {
        matches!(self.solved.outcome.status, Status::Converged | Status::Infeasible)
            || self.solved.outcome.iterations >= self.limits.budget
    }

    fn next_if(&mut self, fits: bool, method: MatrixMethod, budget: usize, warm: bool) {
        if fits {
            self.next(method, budget, warm);
        }
    }

    fn next(&mut self, method: MatrixMethod, budget: usize, warm: bool) {
        if !self.done() {
            self.rung(method, budget, warm);
        }
    }

    /// Runs a method, from the best iterate so far if `warm`, and keeps the better result. Returns
    /// the number of further iterations that its rate predicts.
    fn rung(&mut self, method: MatrixMethod, budget: usize, warm: bool) -> Option<f64> {
        let so_far = &self.solved.outcome;
        let left = self.limits.budget - so_far.iterations.min(self.limits.budget);
        let limits = Limits { budget: budget.min(left), ..*self.limits };
        let first = self.solved.attempts.is_empty();
        let start = if first { self.warm } else { Some(so_far.impulses.as_slice()) };
        let before = self.started.elapsed();
        let outcome = method.solve(self.problem, start.filter(|_| warm), &limits);
        let promised = promised(&outcome, self.limits.tolerance);
        self.keep(method, outcome, before);
        promised
    }

    /// Merges an outcome; `before` is the time at which its method started.
    fn keep(&mut self, method: MatrixMethod, outcome: Outcome, before: Duration) {
        let Outcome { status, iterations, residual, .. } = outcome;
        self.solved.attempts.push(Attempt { method, status, iterations, residual });
        let so_far = &mut self.solved.outcome;
        let done = so_far.iterations;
        let shifted = outcome.history.iter().map(|sample| Sample {
            iteration: done + sample.iteration,
            elapsed: before + sample.elapsed,
            ..*sample
        });
        so_far.history.extend(shifted);
        so_far.iterations += iterations;
        if status == Status::Infeasible || residual < so_far.residual {
            let history = std::mem::take(&mut so_far.history);
            let iterations = so_far.iterations;
            self.solved.outcome = Outcome { history, iterations, ..outcome };
            self.solved.method = method;
        } else if status != Status::BadInput {
            // The best iterate stays; the last method determines the status.
            (so_far.status, so_far.reason) = (status, outcome.reason);
        }
        if self.solved.outcome.status == Status::BadInput {
            self.solved.outcome.status = Status::Stalled;
        }
    }

    fn prove(&mut self) {
        if self.done() {
            return;
        }
        let n = self.problem.unknowns();
        if let Some(certificate) = jam::find(self.problem, PIVOTS * n) {
            let outcome = &mut self.solved.outcome;
            outcome.status = Status::Infeasible;
            outcome.reason = "a self-stress proves that there is no solution";
            outcome.certificate = Some(certificate);
        }
    }
}

/// Returns the number of further sweeps predicted from the rate of the last half.
fn promised(outcome: &Outcome, tolerance: f64) -> Option<f64> {
    let last = outcome.history.last()?;
    let half = outcome.history.iter().find(|s| 2 * s.iteration >= last.iteration)?;
    let sweeps = (last.iteration - half.iteration) as f64;
    let rate = ln(last.residual / half.residual) / sweeps;
    let more = ln(tolerance / last.residual) / rate;
    (outcome.status == Status::Budget && rate < 0.0 && more.is_finite()).then_some(more)
}
