//! Poses in 3D: interpolation between frames, and distances.

use super::Recording;
use drystone_scene::Rotation;

/// Position and rotation in 3D, whatever the dimension of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Position. \[m\]
    pub position: [f64; 3],
    /// Unit quaternion x, y, z, w.
    pub rotation: [f64; 4],
}

/// Returns the pose of a body at a time \[s\], interpolated between frames and held at the ends.
///
/// # Panics
/// If the recording has no such body or no frame.
pub fn pose_at(recording: &Recording, body: usize, time: f64) -> Pose {
    let last = recording.frames() - 1;
    let frame = (time / recording.frame_time - recording.start as f64).clamp(0.0, last as f64);
    // Times of frames are products of the frame time, which may round to either side.
    let near = frame.round();
    if (frame - near).abs() < 1e-6 {
        return frame_pose(recording, near as usize, body);
    }
    let before = frame.floor() as usize;
    let a = frame_pose(recording, before, body);
    let b = frame_pose(recording, before + 1, body);
    let part = frame - before as f64;
    Pose {
        position: lerp(a.position, b.position, part),
        rotation: slerp(a.rotation, b.rotation, part),
    }
}

/// Returns the pose of a body in a frame.
pub(crate) fn frame_pose(recording: &Recording, frame: usize, body: usize) -> Pose {
    match *recording.pose(frame, body) {
        [x, y, angle] => pose_2d([x.into(), y.into()], angle.into()),
        [x, y, z, a, b, c, d] => Pose {
            position: [x, y, z].map(f64::from),
            rotation: normalized([a, b, c, d].map(f64::from)),
        },
        _ => unreachable!("a pose has 3 or 7 numbers"),
    }
}

/// Returns a pose in the plane z = 0.
fn pose_2d([x, y]: [f64; 2], angle: f64) -> Pose {
    Pose { position: [x, y, 0.0], rotation: Rotation::Angle(angle).quaternion() }
}

pub(super) fn lerp<const N: usize>(a: [f64; N], b: [f64; N], part: f64) -> [f64; N] {
    std::array::from_fn(|i| a[i] + (b[i] - a[i]) * part)
}

/// Interpolates rotations along the shorter arc, as glTF does.
pub(super) fn slerp(a: [f64; 4], b: [f64; 4], part: f64) -> [f64; 4] {
    let cos = dot(a, b);
    let b = if cos < 0.0 { b.map(|x| -x) } else { b };
    let arc = angle(a, b) / 2.0;
    // Below this, the sines cancel, and linear interpolation is exact to rounding.
    if arc < 1e-6 {
        return normalized(lerp(a, b, part));
    }
    let (u, v) = (libm::sin((1.0 - part) * arc), libm::sin(part * arc));
    normalized(std::array::from_fn(|i| u * a[i] + v * b[i]))
}

pub(super) fn normalized(q: [f64; 4]) -> [f64; 4] {
    let length = dot(q, q).sqrt();
    q.map(|x| x / length)
}

pub(super) fn dot<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
    (0..N).map(|i| a[i] * b[i]).sum()
}

pub(super) fn distance<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
    let d: [f64; N] = std::array::from_fn(|i| a[i] - b[i]);
    dot(d, d).sqrt()
}

/// Returns the angle between two rotations. It is computed from their chord, since a cosine does
/// not resolve small angles. \[rad\]
pub(super) fn angle(a: [f64; 4], b: [f64; 4]) -> f64 {
    let chord = distance(a, b).min(distance(a, b.map(|x| -x)));
    4.0 * libm::asin((chord / 2.0).min(1.0))
}
