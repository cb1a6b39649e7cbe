//! [`ThreadTuner`]: measures whether using all threads is faster than using one.
//!
//! Moving a cache line from one core to another takes as long as a few contacts on one machine, and
//! as long as a hundred on another. So no number of contacts decides. Results do not depend on the
//! number of threads, so both ways can be tried.

use std::time::Duration;

use drystone_solver::Clock;
use drystone_solver::thread_pool::ThreadPool;

/// Steps before the first trial: they allocate most memory.
const FIRST: u32 = 8;

/// Steps of a trial, with all threads and with one in turn.
const TRIAL: u32 = 8;

/// Steps from one trial to the next. The first number applies after a trial that has changed the
/// choice, and after the work has changed. Each other trial doubles it, up to the second number. A
/// trial that runs while other programs are busy is not valid for long.
const PERIODS: [u32; 2] = [32, 128];

/// The work has changed if the number of contacts has grown or shrunk by more than this factor. A
/// trial while bodies fall tells nothing about the heap they form. \[1\]
const OTHER: usize = 2;

/// Smaller numbers of contacts count as this number: one thread solves them alone.
const FEW: usize = 256;

/// One thread works alone if that takes less than this fraction of the time. \[1\]
const FASTER: f64 = 0.95;

/// The choice between one thread and all threads.
#[derive(Debug)]
pub(crate) struct ThreadTuner {
    /// Steps since the last trial began, and steps from that to the next trial.
    steps: u32,
    period: u32,
    /// Number of contacts at the end of the last trial; none before the first trial.
    contacts: Option<usize>,
    /// Duration of each step of the trial over its number of sweeps, with all threads and with one
    /// in turn. \[s\]
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

    /// Begins a step. Returns the time if the step is part of a trial.
    pub(crate) fn start(&self, pool: &ThreadPool, clock: Clock) -> Option<Duration> {
        pool.rest(self.is_alone());
        if self.is_tried() && pool.threads() > 1 { clock.now() } else { None }
    }

    /// Ends a step that did `sweeps` sweeps over `contacts` contacts in some `time`.
    pub(crate) fn stop(&mut self, time: Duration, sweeps: usize, contacts: usize) {
        self.record_time(time.as_secs_f64() / sweeps.max(1) as f64, contacts);
    }

    fn record_time(&mut self, time: f64, contacts: usize) {
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

    /// Returns the upper median of every second time, starting with step `first` of the trial. An
    /// interruption of a single step does not count, but a processor that is always busy with other
    /// work does. \[s\]
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

    /// One thread works alone after a trial in which that was faster, until one in which it was
    /// not. Interruptions of single steps do not matter, but interruptions of most steps with all
    /// threads do.
    #[test]
    fn one_thread_runs_where_it_is_faster() {
        let mut tuner = ThreadTuner::default();
        let [soon, late] = PERIODS;
        (0..FIRST).for_each(|_| tuner.record_time(9.0, 1000));
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
                tuner.record_time(if own { alone } else { together } + interrupted, 1000);
            }
        }
        for step in 0..TRIAL {
            let is_busy = step % 2 == 0 && step > 2;
            tuner.record_time(if is_busy { 3.0 } else { 1.0 }, 1000);
        }
        assert!(tuner.is_alone());
    }

    /// A trial starts early if there are more than twice as many contacts as at the last one, or
    /// less than half as many. It does not start before the last one has ended.
    #[test]
    fn other_work_starts_another_trial() {
        let mut tuner = ThreadTuner::default();
        (0..FIRST + TRIAL).for_each(|_| tuner.record_time(1.0, 1000));
        for contacts in [2000, 500, 1000] {
            assert!(!tuner.is_tried());
            tuner.record_time(1.0, contacts);
            assert!(!tuner.is_tried(), "{contacts}");
        }
        for contacts in [2001, 1000, 0, 513] {
            assert!(!tuner.is_tried());
            tuner.record_time(1.0, contacts);
            for _ in 0..TRIAL {
                assert!(tuner.is_tried(), "{contacts}");
                tuner.record_time(1.0, contacts);
            }
        }
    }

    /// In a trial, the pool rests in every other step. Time is taken only in a trial.
    #[test]
    fn a_trial_alternates_one_thread_and_all() {
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
