//! Poses over time of what animations move.

use super::super::description::{Rotation, Track};
use super::math::{self, Quat, Vec3};

/// Samples per second where keys alone do not give the poses between them.
const RATE: f64 = 60.0;
/// Longest stretch that is sampled. \[s\]
const LONGEST: f64 = 3600.0;

/// The times of a track: those of the keys where these are exact, and samples between them where
/// not. Else how long the keys take, and what is accepted. \[s\]
pub(in crate::scene) fn times(mut keys: Vec<f64>, exact: bool) -> Result<Vec<f64>, (f64, String)> {
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

/// A track of the poses at these times; of both quaternions of a rotation, the nearer to the last.
pub(in crate::scene) fn of(times: Vec<f64>, pose: impl Fn(f64) -> (Vec3, Quat)) -> Track {
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
