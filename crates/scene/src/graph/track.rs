//! Tracks of animated bodies.

use super::super::description::{Rotation, Track};
use super::math::{self, Quat, Vec3};

/// Sampling rate where the keys alone do not give the poses between them. \[1/s\]
const RATE: f64 = 60.0;
/// Longest animation that is sampled. \[s\]
const LONGEST: f64 = 3600.0;

/// Returns the times of a track: the keys, and unless `exact`, samples between them. The error is
/// the length of an animation that is too long to sample, and the accepted length. \[s\]
pub(crate) fn times(mut keys: Vec<f64>, exact: bool) -> Result<Vec<f64>, (f64, String)> {
    let first = keys.iter().copied().fold(f64::INFINITY, f64::min);
    let last = keys.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !exact && first < last {
        let length = last - first;
        if length > LONGEST {
            return Err((length, format!("up to {LONGEST} s are accepted")));
        }
        let samples = (length * RATE).floor() as usize;
        keys.extend((0..=samples).map(|i| first + i as f64 / RATE));
    }
    keys.sort_by(f64::total_cmp);
    keys.dedup();
    Ok(keys)
}

/// Returns the track of the poses at these times. Of the two quaternions of a rotation, it uses the
/// one nearer to the rotation before.
pub(crate) fn of(times: Vec<f64>, pose: impl Fn(f64) -> (Vec3, Quat)) -> Track {
    let mut track = Track::default();
    let mut held: Option<Quat> = None;
    for time in &times {
        let (position, rotation) = pose(*time);
        let rotation = match held {
            Some(last) if math::quat_dot(last, rotation) < 0.0 => rotation.map(|x| -x),
            _ => rotation,
        };
        held = Some(rotation);
        track.positions.push(position.into());
        track.rotations.push(Rotation::Quaternion(rotation));
    }
    track.times = times;
    track
}
