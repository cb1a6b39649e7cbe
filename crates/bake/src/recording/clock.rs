//! [`Clock`]: times of the samples of a stage, and their time codes.

use super::sampling::{sample_rate, sample_times};
use super::{Recording, Sampling};
use drystone_scene::export::usd::rounded;
use drystone_scene::usd::StageSource;

/// Times of samples, and their time codes.
///
/// A stage that states its time codes per second keeps them, so that its own animation keeps its
/// frames. Otherwise each sample has a whole time code.
pub(super) struct Clock {
    /// Times from the start of the simulation. \[s\]
    pub(super) times: Vec<f64>,
    /// Time codes per second. \[1/s\]
    pub(super) rate: f64,
    /// Time code at the start of the simulation.
    start: f64,
}

impl Clock {
    pub(super) fn new(
        recording: &Recording,
        source: Option<&StageSource>,
        options: &Sampling,
    ) -> Self {
        let times = sample_times(recording, options);
        let own = rounded(sample_rate(recording, options));
        let Some(source) = source else { return Self { times, rate: own, start: 0.0 } };
        let rate = if source.has_rate { source.units.rate } else { own };
        // OpenUSD scales the time codes of a sublayer to the rate of the layer above.
        Self { times, rate, start: source.units.start * rate / source.units.rate }
    }

    /// Returns the time code of a time \[s\].
    pub(super) fn code(&self, time: f64) -> f64 {
        rounded(self.start + time * self.rate)
    }

    /// Returns the time codes of all samples.
    pub(super) fn codes(&self) -> Vec<f64> {
        self.times.iter().map(|time| self.code(*time)).collect()
    }

    /// Returns the first and the last time code; those of the start without samples.
    pub(super) fn ends(&self) -> [f64; 2] {
        let ends = [self.times.first(), self.times.last()];
        ends.map(|time| self.code(time.copied().unwrap_or(0.0)))
    }
}
