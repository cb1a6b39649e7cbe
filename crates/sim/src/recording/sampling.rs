//! Poses over time as few samples, between which others interpolate.

use std::io;

use super::Recording;
use super::pose::{Pose, angle, distance, dot, lerp, normalized, slerp};

/// How exactly an animation follows the recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Largest distance between the animation and a sample of the recording. \[m\]
    pub position_tolerance: f64,
    /// Largest angle between the animation and a sample of the recording. \[rad\]
    pub rotation_tolerance: f64,
    /// Samples per second; absent, or as many as there are frames: every recorded frame.
    /// \[1/s\]
    pub fps: Option<f64>,
}

impl Default for Sampling {
    fn default() -> Self {
        Self { position_tolerance: 1e-5, rotation_tolerance: 1e-5, fps: None }
    }
}

/// Samples per second, if they are fewer than frames.
fn fewer(recording: &Recording, options: &Sampling) -> Option<f64> {
    options.fps.filter(|fps| *fps > 0.0 && *fps * recording.frame_time < 1.0)
}

/// Samples per second; the last one may follow sooner. \[1/s\]
pub(super) fn sample_rate(recording: &Recording, options: &Sampling) -> f64 {
    fewer(recording, options).unwrap_or(1.0 / recording.frame_time)
}

/// Rising times of the samples: those of all frames, or of fewer and of the last. \[s\]
pub(super) fn sample_times(recording: &Recording, options: &Sampling) -> Vec<f64> {
    let Some(last) = recording.frames().checked_sub(1) else {
        return Vec::new();
    };
    let end = last as f64 * recording.frame_time;
    match fewer(recording, options) {
        None => (0..=last).map(|frame| frame as f64 * recording.frame_time).collect(),
        Some(fps) => {
            let whole = (end * fps + 1e-6).floor() as u64;
            let mut times: Vec<f64> = (0..=whole).map(|i| i as f64 / fps).collect();
            // The last frame is where things come to rest.
            if end - whole as f64 / fps > 1e-6 * recording.frame_time {
                times.push(end);
            }
            times
        }
    }
}

/// Kept samples and their values; none if the track is constant.
pub(super) struct Track<const N: usize> {
    /// The value of the first sample.
    pub(super) first: Option<[f32; N]>,
    /// Which samples are kept.
    pub(super) kept: Vec<u32>,
    /// Their values.
    pub(super) values: Vec<[f32; N]>,
}

/// What a pose over time comes to: positions and rotations at the times that are worth keeping.
///
/// # Errors
/// A pose is not finite; `body` is whose.
pub(super) fn tracks(
    times: &[f64],
    pose: impl Fn(f64) -> Pose,
    options: &Sampling,
    body: usize,
) -> io::Result<(Track<3>, Track<4>)> {
    let mut positions = Vec::with_capacity(times.len());
    let mut rotations: Vec<[f32; 4]> = Vec::with_capacity(times.len());
    for &time in times {
        let pose = pose(time);
        if pose.position.iter().chain(&pose.rotation).any(|x| !x.is_finite()) {
            let message = format!("the pose of body {body} at {time} s is not finite");
            return Err(io::Error::new(io::ErrorKind::InvalidData, message));
        }
        positions.push(pose.position.map(|x| x as f32));
        let before = rotations.last().map_or(pose.rotation, |q| q.map(f64::from));
        let sign = if dot(before, pose.rotation) < 0.0 { -1.0 } else { 1.0 };
        rotations.push(normalized(pose.rotation).map(|x| (sign * x) as f32));
    }
    let (move_by, turn_by) = (options.position_tolerance, options.rotation_tolerance);
    Ok((
        thin(times, &positions, |a, b, part, x| distance(lerp(a, b, part), x) <= move_by),
        thin(times, &rotations, |a, b, part, q| angle(slerp(a, b, part), q) <= turn_by),
    ))
}

/// Keeps a sample only if the line between its kept neighbors would miss one in between.
///
/// `close(a, b, part, x)` says whether the interpolation between a and b at that part is near x.
pub(super) fn thin<const N: usize>(
    times: &[f64],
    values: &[[f32; N]],
    close: impl Fn([f64; N], [f64; N], f64, [f64; N]) -> bool,
) -> Track<N> {
    let value = |i: usize| values[i].map(f64::from);
    let time = |i: usize| times[i];
    let fits = |a: usize, b: usize| {
        (a + 1..b).all(|i| {
            let part = (time(i) - time(a)) / (time(b) - time(a));
            close(value(a), value(b), part, value(i))
        })
    };
    let constant = (1..values.len()).all(|i| close(value(0), value(0), 0.0, value(i)));
    let mut kept = Vec::new();
    if !constant {
        kept.push(0);
        let mut from = 0;
        while from + 1 < values.len() {
            from = farthest(from, values.len() - 1, &fits);
            kept.push(from as u32);
        }
    }
    let first = values.first().copied();
    let values = kept.iter().map(|i| values[*i as usize]).collect();
    Track { first, kept, values }
}

/// A far sample up to which a line from this one fits: strides double while they fit, then the
/// last one is halved.
fn farthest(from: usize, last: usize, fits: &impl Fn(usize, usize) -> bool) -> usize {
    let mut good = from + 1;
    let mut bad = last + 1;
    let mut stride = 2;
    while good < last {
        let probe = (from + stride).min(last);
        if !fits(from, probe) {
            bad = probe;
            break;
        }
        good = probe;
        stride *= 2;
    }
    while good + 1 < bad && bad <= last {
        let probe = good.midpoint(bad);
        if fits(from, probe) { good = probe } else { bad = probe }
    }
    good
}
