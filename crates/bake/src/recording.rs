//! Recordings (poses over time) and the file formats to which they are written.

pub mod animation;
mod clock;
pub mod compare;
pub mod contacts;
pub mod glb;
pub mod gltf;
pub mod joints;
pub mod journal;
#[cfg(feature = "npz")]
pub mod npz;
mod parallel;
pub mod pose;
pub mod poses;
pub mod sampling;
mod usd_instances;
pub mod usd_layer;
pub mod usda;
mod velocities;

use std::io;
use std::ops::RangeInclusive;

use drystone::geometry::pose_numbers;
use drystone_scene::Scene;
pub use joints::JointRecording;
pub use sampling::Sampling;
pub use velocities::Velocities;

/// Accepted times between two frames. \[s\]
const APART: RangeInclusive<f64> = 1e-9..=1e6;

/// Result of a bake: the pose of every body at every frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Number of dimensions: 2 or 3.
    pub dimension: usize,
    /// Number of bodies per frame.
    pub bodies: usize,
    /// Time between two frames. \[s\]
    pub frame_time: f64,
    /// Number of the first frame; frame 0 is the initial state.
    pub start: usize,
    /// Poses by frame, body and number: px py pz qx qy qz qw in 3D, px py angle in 2D. \[m, rad\]
    pub poses: Vec<f32>,
}

/// A recording with the names of its bodies, its joints and its velocities.
#[derive(Clone, Debug, PartialEq)]
pub struct Named {
    /// The poses.
    pub recording: Recording,
    /// One name per body.
    pub names: Vec<String>,
    /// The joints, as far as the file has them.
    pub joints: JointRecording,
    /// Velocities of the bodies, as far as the file has them.
    pub velocities: Velocities,
}

impl Recording {
    /// Returns a recording of a scene without frames, one of which follows each of its time steps.
    pub fn of(scene: &Scene) -> Self {
        Self {
            dimension: scene.dimension,
            bodies: scene.bodies.len(),
            frame_time: scene.time_step,
            start: 0,
            poses: Vec::new(),
        }
    }

    /// Returns the number of floats per pose: 7 in 3D, 3 in 2D.
    pub fn stride(&self) -> usize {
        pose_numbers(self.dimension)
    }

    /// Returns the number of frames; the initial state counts as one.
    pub fn frames(&self) -> usize {
        if self.bodies == 0 { 0 } else { self.poses.len() / (self.bodies * self.stride()) }
    }

    /// Returns the times of the frames. \[s\]
    pub fn times(&self) -> impl ExactSizeIterator<Item = f64> {
        let (start, frame_time) = (self.start, self.frame_time);
        (0..self.frames()).map(move |frame| start.saturating_add(frame) as f64 * frame_time)
    }

    /// Returns a range of frames, by number; they keep their times.
    ///
    /// # Panics
    /// If the recording lacks one of these frames.
    #[must_use]
    pub fn piece(&self, frames: RangeInclusive<usize>) -> Self {
        let (first, last) = frames.into_inner();
        let number = |frame: usize| (frame - self.start) * self.bodies * self.stride();
        let poses = self.poses[number(first)..number(last + 1)].to_vec();
        Self { start: first, poses, ..*self }
    }

    /// Checks that the recording has these numbers of bodies and dimensions, and an accepted frame
    /// time.
    pub(crate) fn must_have(&self, bodies: usize, dimension: usize) -> io::Result<()> {
        let message = if (self.bodies, self.dimension) != (bodies, dimension) {
            format!(
                "a recording of {} bodies in {}D is not of a scene with {bodies} in {dimension}D",
                self.bodies, self.dimension,
            )
        } else if !APART.contains(&self.frame_time) {
            let [low, high] = [APART.start(), APART.end()];
            let accepted = format!("accepted: {low:e} to {high:e} s");
            format!("the frames of a recording are {} s apart; {accepted}", self.frame_time)
        } else {
            return Ok(());
        };
        Err(io::Error::new(io::ErrorKind::InvalidInput, message))
    }

    /// Returns the number of the first frame, and the body in it, whose pose is not finite.
    pub fn first_not_finite(&self) -> Option<(usize, usize)> {
        let place = self.poses.iter().position(|x| !x.is_finite())? / self.stride();
        Some((self.start + place / self.bodies, place % self.bodies))
    }

    /// Returns the pose of a body at a frame, counted from the first frame of the recording.
    pub fn pose(&self, frame: usize, body: usize) -> &[f32] {
        let stride = self.stride();
        let start = (frame * self.bodies + body) * stride;
        &self.poses[start..start + stride]
    }
}
