//! Run of one method, or of the automatic choice, on a problem.

use std::str::FromStr;
use std::time::{Duration, Instant};

use drystone_solver::assembled::ladder::{self, Attempt, MatrixMethod, Solved};
use drystone_solver::assembled::{Limits, Outcome};

use super::read::Named;

/// A method, or the automatic choice by the ladder of methods.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Choice {
    Auto,
    Only(MatrixMethod),
}

impl Choice {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Only(method) => method.name(),
        }
    }

    fn solve(self, named: &Named, limits: &Limits) -> Solved {
        let (problem, warm) = (&named.problem, named.warm.as_deref());
        match self {
            Self::Auto => ladder::solve(problem, warm, limits),
            Self::Only(method) => {
                let outcome = method.solve(problem, warm, limits);
                let Outcome { status, iterations, residual, .. } = outcome;
                let attempts = vec![Attempt { method, status, iterations, residual }];
                Solved { method, outcome, attempts }
            }
        }
    }

    pub(super) fn all() -> impl Iterator<Item = Self> {
        [Self::Auto].into_iter().chain(MatrixMethod::ALL.map(Self::Only))
    }
}

impl FromStr for Choice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = || Self::all().map(Self::name).collect::<Vec<_>>().join(", ");
        Self::all()
            .find(|choice| choice.name() == text)
            .ok_or_else(|| format!("accepted: {}", names()))
    }
}

/// Solution of the problem by one choice.
pub(super) struct MethodRun {
    pub(super) choice: Choice,
    pub(super) solved: Solved,
    /// Time of the solve; the median if it was repeated.
    pub(super) time: Duration,
}

impl MethodRun {
    pub(super) fn new(named: &Named, choice: Choice, limits: &Limits, repeat: u32) -> Self {
        let mut times = Vec::new();
        loop {
            let start = Instant::now();
            let solved = choice.solve(named, limits);
            times.push(start.elapsed());
            if times.len() >= repeat as usize {
                times.sort_unstable();
                return Self { choice, solved, time: times[times.len() / 2] };
            }
        }
    }

    /// Adds the residuals of the interior-point method between its start and its end, from runs
    /// that end earlier: each of its iterations leads on from the last, whatever the budget.
    pub(super) fn with_history(mut self, named: &Named, limits: &Limits) -> Self {
        if self.choice == Choice::Only(MatrixMethod::InteriorPoint) {
            let history = &mut self.solved.outcome.history;
            let end = history.len().min(1);
            let between = (1..self.solved.outcome.iterations).filter_map(|budget| {
                let earlier = self.choice.solve(named, &Limits { budget, ..*limits }).outcome;
                earlier.history.last().copied().filter(|sample| sample.iteration == budget)
            });
            history.splice(end..end, between.collect::<Vec<_>>());
            // A run of fewer iterations takes no longer, unless another program held it up.
            let mut longer = Duration::MAX;
            for sample in history.iter_mut().rev() {
                sample.elapsed = sample.elapsed.min(longer);
                longer = sample.elapsed;
            }
        }
        self
    }

    pub(super) fn milliseconds(&self) -> f64 {
        self.time.as_secs_f64() * 1e3
    }
}
