//! [`Pace`]: whether threads are worth what they cost, as measured.
//!
//! To hand a line of memory from one core to another takes as long as a few contacts on one machine and as long as a
//! hundred on another, so no number of contacts tells. Results do not depend on who works, so it may be tried out.

use std::time::{Duration, Instant};

use drystone_solver::team::Team;

/// Steps before the first trial: those that make room for everything.
const FIRST: u32 = 8;

/// Steps of a trial, alone and together by turns.
const TRIAL: u32 = 8;

/// Steps from trial to trial.
const PERIOD: u32 = 128;

/// One works alone if that takes less than this part of the time. \[1\]
const FASTER: f64 = 0.95;

/// Whether steps are taken alone.
#[derive(Debug)]
pub(crate) struct Pace {
    steps: u32,
    /// The least that a sweep has taken in this trial, with all that belongs to it, together and alone. \[s\]
    least: [f64; 2],
    alone: bool,
}

impl Default for Pace {
    fn default() -> Self {
        Self { steps: 0, least: [f64::INFINITY; 2], alone: false }
    }
}

impl Pace {
    fn is_tried(&self) -> bool {
        self.steps >= FIRST && (self.steps - FIRST) % PERIOD < TRIAL
    }

    fn is_alone(&self) -> bool {
        if self.is_tried() { self.steps % 2 == 1 } else { self.alone }
    }

    /// Begins a step; returns the time, if it counts.
    pub(crate) fn start(&self, team: &Team) -> Option<Instant> {
        team.rest(self.is_alone());
        (self.is_tried() && team.members() > 1).then(Instant::now)
    }

    /// Ends a step of so many sweeps.
    pub(crate) fn stop(&mut self, start: Option<Instant>, sweeps: usize) {
        let time = start.map_or(Duration::ZERO, |start| start.elapsed());
        self.took(time.as_secs_f64() / sweeps.max(1) as f64);
    }

    fn took(&mut self, time: f64) {
        if self.is_tried() {
            let least = &mut self.least[usize::from(self.is_alone())];
            *least = least.min(time);
        }
        let tried = self.is_tried();
        self.steps = self.steps.wrapping_add(1);
        if tried && !self.is_tried() {
            let [together, alone] = std::mem::replace(&mut self.least, [f64::INFINITY; 2]);
            self.alone = alone < FASTER * together;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One works alone after the first trial in which that was faster, until one in which it was not; what
    /// interrupts single steps does not matter.
    #[test]
    fn alone_where_that_is_faster() {
        let mut pace = Pace::default();
        let times = [[1.0, 1.1], [1.0, 0.8], [1.0, 0.98]];
        (0..FIRST).for_each(|_| pace.took(9.0));
        for (trial, [together, alone]) in times.into_iter().enumerate() {
            let expected = alone < FASTER * together;
            for step in 0..PERIOD {
                let own = pace.is_alone();
                assert!(step < TRIAL || own == expected, "step {step} of trial {trial}");
                let interrupted = if step % 5 == 0 { 9.0 } else { 0.0 };
                pace.took(if own { alone } else { together } + interrupted);
            }
        }
    }

    /// In a trial a team rests in every other step, and only then is time taken.
    #[test]
    fn a_trial_is_alone_and_together_by_turns() {
        let (team, mut pace) = (Team::new(2), Pace::default());
        for step in 0..FIRST + TRIAL {
            let start = pace.start(&team);
            let alone = step >= FIRST && step % 2 == 1;
            assert_eq!(team.is_useful(1000), !alone, "step {step}");
            assert_eq!(start.is_some(), step >= FIRST, "step {step}");
            pace.stop(start, 8);
        }
    }
}
