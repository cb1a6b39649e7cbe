//! Progress of a bake: a bar on a terminal, or lines for other programs.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::arguments::BakeArguments;

/// Shortest time between two lines.
const INTERVAL: Duration = Duration::from_secs(1);

/// Shows which step a bake takes.
pub(super) enum Progress {
    /// A bar; nothing where standard error is not a terminal.
    Bar(ProgressBar),
    /// Lines on standard error.
    Lines(ProgressLines),
}

impl Progress {
    /// Prepares the progress of a bake of so many steps.
    pub(super) fn new(arguments: &BakeArguments, steps: u32) -> Self {
        if arguments.progress {
            return Self::Lines(ProgressLines { all: steps as usize, start: None, said: None });
        }
        if arguments.quiet {
            return Self::Bar(ProgressBar::hidden());
        }
        let style = "{bar:40} step {human_pos} of {human_len}, {eta} to go {msg}";
        let bar = ProgressBar::new(u64::from(steps));
        let style = ProgressStyle::with_template(style);
        Self::Bar(style.map_or(bar.clone(), |style| bar.with_style(style)))
    }

    /// Records that so many steps are done.
    pub(super) fn set(&mut self, done: usize) {
        match self {
            Self::Bar(bar) => bar.set_position(done as u64),
            Self::Lines(lines) => lines.set(done, Instant::now()),
        }
    }

    /// Removes the bar, or prints the last line.
    pub(super) fn finish(&mut self) {
        match self {
            Self::Bar(bar) => bar.finish_and_clear(),
            Self::Lines(lines) => eprintln!("{}", line(lines.all, lines.all, None)),
        }
    }
}

/// Lines such as `frame 12 of 240 (5 %), 31 s left`, at most one per second, and one at the end.
pub(super) struct ProgressLines {
    all: usize,
    /// Time and number of steps of the first call. A bake that is resumed begins with many.
    start: Option<(Instant, usize)>,
    /// Time of the last line.
    said: Option<Instant>,
}

impl ProgressLines {
    fn set(&mut self, done: usize, now: Instant) {
        let (start, first) = *self.start.get_or_insert((now, done));
        if self.said.is_some_and(|said| now.duration_since(said) < INTERVAL) {
            return;
        }
        self.said = Some(now);
        let left = left(done - first, self.all - done, now.duration_since(start));
        eprintln!("{}", line(done, self.all, left));
    }
}

/// Estimates the time for the steps that are left, from the time that those `taken` have needed.
fn left(taken: usize, left: usize, time: Duration) -> Option<Duration> {
    (taken > 0).then(|| time.mul_f64(left as f64 / taken as f64))
}

/// Returns a line of progress. Frame 0 is the initial state, so frame n is there after n steps.
fn line(done: usize, all: usize, left: Option<Duration>) -> String {
    let percent = (100 * done).checked_div(all).unwrap_or(100);
    let left = left.map_or_else(String::new, |left| format!(", {:.0} s left", left.as_secs_f64()));
    format!("frame {done} of {all} ({percent} %){left}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line has frames, percent and the estimate; without steps it is complete.
    #[test]
    fn lines_state_frames_percent_and_time() {
        let estimate = left(12, 228, Duration::from_millis(1500));
        assert_eq!(line(12, 240, estimate), "frame 12 of 240 (5 %), 28 s left");
        assert_eq!(line(0, 240, left(0, 240, Duration::ZERO)), "frame 0 of 240 (0 %)");
        assert_eq!(line(0, 0, None), "frame 0 of 0 (100 %)");
    }

    /// There is at most one line per second.
    #[test]
    fn lines_come_at_most_once_a_second() {
        let mut lines = ProgressLines { all: 9, start: None, said: None };
        let start = Instant::now();
        let mut said = Vec::new();
        for (done, milliseconds) in [0, 400, 999, 1000, 1900, 2100].into_iter().enumerate() {
            let before = lines.said;
            lines.set(done, start + Duration::from_millis(milliseconds));
            said.extend((lines.said != before).then_some(done));
        }
        assert_eq!(said, [0, 3, 5]);
    }
}
