//! [`ThreadTuner`]: whether threads are worth what they cost, as measured.
//!
//! To hand a line of memory from one core to another takes as long as a few contacts on one machine and as long as a
//! hundred on another, so no number of contacts tells. Results do not depend on who works, so it may be tried out.

use std::time::Duration;

use drystone_solver::Clock;
use drystone_solver::thread_pool::ThreadPool;

/// Steps before the first trial: those that make room for everything.
const FIRST: u32 = 8;

/// Steps of a trial, alone and together by turns.
const TRIAL: u32 = 8;

/// Steps from a trial to the next, if it has changed anything, or there has come to be other work; each that has not
/// doubles them, up to the second. What was tried while other programs were busy does not hold for long.
const PERIODS: [u32; 2] = [32, 128];

/// So many times as many contacts, or as few, are other work: what was tried while all fell says nothing of how it
/// lies. \[1\]
const OTHER: usize = 2;

/// Fewer contacts than these are as many: one does them alone.
const FEW: usize = 256;

/// One works alone if that takes less than this part of the time. \[1\]
const FASTER: f64 = 0.95;

/// Whether steps are taken alone.
#[derive(Debug)]
pub(crate) struct ThreadTuner {
    /// Steps since the last trial began, and from that to the next.
    steps: u32,
    period: u32,
    /// Contacts when it ended, once there was one.
    contacts: Option<usize>,
    /// What a sweep has taken in each step of the trial, with all that belongs to it, together and alone by turns.
    /// \[s\]
    times: [f64; TRIAL as usize],
    alone: bool,
}

impl Default for ThreadTuner {
    fn default() -> Self {
        let [period, _] = PERIODS;
        let times = [0.0; TRIAL as usize];
        Self { steps: period - FIRST, period, contacts: None, times, alone: false }
    }
}

impl ThreadTuner {
    fn is_tried(&self) -> bool {
        self.steps < TRIAL
    }

    fn is_alone(&self) -> bool {
        if self.is_tried() { self.steps % 2 == 1 } else { self.alone }
    }

    /// Begins a step; returns the time, if it counts.
    pub(crate) fn start(&self, pool: &ThreadPool, clock: Clock) -> Option<Duration> {
        pool.rest(self.is_alone());
        if self.is_tried() && pool.threads() > 1 { clock.now() } else { None }
    }

    /// Ends a step of so many sweeps over so many contacts.
    pub(crate) fn stop(&mut self, time: Duration, sweeps: usize, contacts: usize) {
        self.took(time.as_secs_f64() / sweeps.max(1) as f64, contacts);
    }

    fn took(&mut self, time: f64, contacts: usize) {
        let tried = self.is_tried();
        if let Some(own) = self.times.get_mut(self.steps as usize) {
            *own = time;
        }
        self.steps += 1;
        let [soon, late] = PERIODS;
        if tried && !self.is_tried() {
            let alone = self.usual(1) < FASTER * self.usual(0);
            let changes = std::mem::replace(&mut self.alone, alone) != alone;
            self.period = if changes { soon } else { late.min(2 * self.period) };
            self.contacts = Some(contacts);
        }
        let is_other = |then: usize| {
            let [then, now] = [then, contacts].map(|of| of.max(FEW));
            now > OTHER * then || then > OTHER * now
        };
        if !self.is_tried() && self.contacts.is_some_and(is_other) {
            (self.steps, self.period) = (0, soon);
        } else if self.steps >= self.period {
            self.steps = 0;
        }
    }

    /// The upper median of every other time from that of a step of the trial on: what interrupts one step does not
    /// count, but a processor that is always busy with something else does. \[s\]
    fn usual(&self, first: usize) -> f64 {
        let mut times: [f64; TRIAL as usize / 2] =
            std::array::from_fn(|i| self.times[first + 2 * i]);
        times.sort_unstable_by(f64::total_cmp);
        times[times.len() / 2]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One works alone after the first trial in which that was faster, until one in which it was not; what
    /// interrupts single steps does not matter, what interrupts most steps together does.
    #[test]
    fn alone_where_that_is_faster() {
        let mut tuner = ThreadTuner::default();
        let [soon, late] = PERIODS;
        (0..FIRST).for_each(|_| tuner.took(9.0, 1000));
        let trials = [
            ([1.0, 1.1], 2 * soon),
            ([1.0, 0.8], soon),
            ([1.0, 0.98], soon),
            ([1.0, 1.2], 2 * soon),
            ([1.0, 1.3], late),
            ([1.0, 0.97], late),
        ];
        for (trial, ([together, alone], period)) in trials.into_iter().enumerate() {
            let expected = alone < FASTER * together;
            for step in 0..period {
                let own = tuner.is_alone();
                assert_eq!(tuner.is_tried(), step < TRIAL, "step {step} of trial {trial}");
                assert!(step < TRIAL || own == expected, "step {step} of trial {trial}");
                let interrupted = if step % 5 == 0 { 9.0 } else { 0.0 };
                tuner.took(if own { alone } else { together } + interrupted, 1000);
            }
        }
        for step in 0..TRIAL {
            let is_busy = step % 2 == 0 && step > 2;
            tuner.took(if is_busy { 3.0 } else { 1.0 }, 1000);
        }
        assert!(tuner.is_alone());
    }

    /// A trial comes early where there are twice as many contacts as at the last, or half as many; not before that
    /// has ended.
    #[test]
    fn other_work_is_tried_again() {
        let mut tuner = ThreadTuner::default();
        (0..FIRST + TRIAL).for_each(|_| tuner.took(1.0, 1000));
        for contacts in [2000, 500, 1000] {
            assert!(!tuner.is_tried());
            tuner.took(1.0, contacts);
            assert!(!tuner.is_tried(), "{contacts}");
        }
        for contacts in [2001, 1000, 0, 513] {
            assert!(!tuner.is_tried());
            tuner.took(1.0, contacts);
            for _ in 0..TRIAL {
                assert!(tuner.is_tried(), "{contacts}");
                tuner.took(1.0, contacts);
            }
        }
    }

    /// In a trial a pool rests in every other step, and only then is time taken.
    #[test]
    fn a_trial_is_alone_and_together_by_turns() {
        let (pool, mut tuner) = (ThreadPool::new(2), ThreadTuner::default());
        for step in 0..FIRST + TRIAL {
            let start = tuner.start(&pool, Clock::system());
            let alone = step >= FIRST && step % 2 == 1;
            assert_eq!(pool.is_useful(1000), !alone, "step {step}");
            assert_eq!(start.is_some(), step >= FIRST, "step {step}");
            tuner.stop(Clock::system().since(start), 8, 1000);
        }
    }
}
