//! Helpers of the tests: worlds and shapes, random scenes, mutations of files.

use std::fs;
use std::time::Instant;

pub(crate) mod mutation;
pub(crate) mod scenes;
#[path = "../../../../sim/tests/suite/common/mod.rs"]
#[allow(dead_code)]
mod worlds;

pub(crate) use worlds::*;

/// Returns the CPU time of this thread for `work` where the system tells it, else the elapsed time.
/// \[s\]
pub(crate) fn worked(work: impl FnOnce()) -> f64 {
    let so_far = || -> Option<f64> {
        let text = fs::read_to_string("/proc/thread-self/schedstat").ok()?;
        Some(text.split_whitespace().next()?.parse::<f64>().ok()? * 1e-9)
    };
    let (clock, before) = (Instant::now(), so_far());
    work();
    match (before, so_far()) {
        (Some(from), Some(to)) => to - from,
        _ => clock.elapsed().as_secs_f64(),
    }
}
