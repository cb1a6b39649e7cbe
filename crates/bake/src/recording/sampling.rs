//! Reduces poses over time to few samples with interpolation between them.

use std::io;

use super::Recording;
use super::pose::{Pose, angle, distance, dot, lerp, normalized};

/// Accuracy with which an animation follows the recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Largest distance between the animation and a sample of the recording. \[m\]
    pub position_tolerance: f64,
    /// Largest angle between the animation and a sample of the recording. \[rad\]
    pub rotation_tolerance: f64,
    /// Sampling rate; samples are at multiples of its period. Every recorded frame is a sample if
    /// the rate is absent or not below the frame rate. \[1/s\]
    pub fps: Option<f64>,
}

impl Sampling {
    /// Sets both tolerances, the angle in radians to the same number as the distance in meters. A
    /// point one meter from the body's center moves as far by either. \[m\]
    pub fn within(tolerance: f64) -> Self {
        Self { position_tolerance: tolerance, rotation_tolerance: tolerance, fps: None }
    }

    /// Returns the number of frames from one sample to the next; 1 if all frames are samples.
    pub fn stride(&self, frame_time: f64) -> f64 {
        let fewer = self.fps.filter(|fps| *fps > 0.0 && *fps * frame_time < 1.0);
        fewer.map_or(1.0, |fps| 1.0 / (fps * frame_time))
    }
}

impl Default for Sampling {
    fn default() -> Self {
        Self::within(1e-5)
    }
}

/// Rounding error accepted in a whole number of samples.
const WHOLE: f64 = 1e-6;

/// Returns the sampling rate. \[1/s\]
pub(super) fn sample_rate(recording: &Recording, options: &Sampling) -> f64 {
    1.0 / (options.stride(recording.frame_time) * recording.frame_time)
}

/// Returns the times of the samples in ascending order. \[s\]
pub(super) fn sample_times(recording: &Recording, options: &Sampling) -> Vec<f64> {
    let stride = options.stride(recording.frame_time);
    let Some(more) = recording.frames().checked_sub(1) else {
        return Vec::new();
    };
    if stride == 1.0 {
        return recording.times().collect();
    }
    let number = |frame: usize| frame as f64 / stride;
    let first = (number(recording.start) - WHOLE).ceil() as usize;
    let last = (number(recording.start + more) + WHOLE).floor() as usize;
    (first..=last).map(|sample| sample as f64 * stride * recording.frame_time).collect()
}

/// Samples kept of a track; none if it is constant.
pub(super) struct Track<const N: usize> {
    /// Value of the first sample.
    pub(super) first: Option<[f32; N]>,
    /// Indices of the kept samples.
    pub(super) kept: Vec<u32>,
    /// Values of the kept samples.
    pub(super) values: Vec<[f32; N]>,
}

/// Samples a pose over time and thins out positions and rotations. `mix` is the interpolation that
/// the reader of the file uses for rotations.
///
/// # Errors
/// If a pose is not finite. The message names `body`.
pub(super) fn tracks(
    times: &[f64],
    pose: impl Fn(f64) -> Pose,
    mix: fn([f64; 4], [f64; 4], f64) -> [f64; 4],
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
        thin(times, &rotations, |a, b, part, q| angle(mix(a, b, part), q) <= turn_by),
    ))
}

/// Keeps a sample only if the line between its kept neighbors would miss one in between.
///
/// `close(a, b, part, x)` tells whether the interpolation between a and b at that part is near x.
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

/// Returns a distant sample up to which a line from `from` fits. Strides double while they fit,
/// then the last one is bisected.
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
