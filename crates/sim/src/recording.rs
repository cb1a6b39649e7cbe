//! Poses over time, as they leave Drystone.

pub mod animation;
pub mod buffer;
mod color;
pub mod compare;
pub mod file;
pub mod glb;
pub mod gltf;
pub mod journal;
mod mesh;
pub mod npz;
pub mod physics;
pub mod pose;
pub mod poses;
pub mod sampling;
pub mod usda;

use std::io;

use crate::geometry::pose_numbers;
pub use file::write_whole;
pub use sampling::Sampling;

/// What a bake produced: the pose of every body at every frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// 2 or 3.
    pub dimension: usize,
    /// Bodies per frame.
    pub bodies: usize,
    /// Time between two frames. \[s\]
    pub frame_time: f64,
    /// frames x bodies x (3D: px py pz qx qy qz qw; 2D: px py angle); frame 0 is the initial
    /// state. \[m, rad\]
    pub poses: Vec<f32>,
}

impl Recording {
    /// Numbers per pose: 7 in 3D, 3 in 2D.
    pub fn stride(&self) -> usize {
        pose_numbers(self.dimension)
    }

    /// Number of frames, the initial state included.
    pub fn frames(&self) -> usize {
        if self.bodies == 0 { 0 } else { self.poses.len() / (self.bodies * self.stride()) }
    }

    /// That it has as many bodies as a scene, in as many dimensions.
    pub(crate) fn must_have(&self, bodies: usize, dimension: usize) -> io::Result<()> {
        if (self.bodies, self.dimension) == (bodies, dimension) {
            return Ok(());
        }
        let message = format!(
            "a recording of {} bodies in {}D is not of a scene with {bodies} in {dimension}D",
            self.bodies, self.dimension,
        );
        Err(io::Error::new(io::ErrorKind::InvalidInput, message))
    }

    /// The pose of a body at a frame.
    pub fn pose(&self, frame: usize, body: usize) -> &[f32] {
        let stride = self.stride();
        let start = (frame * self.bodies + body) * stride;
        &self.poses[start..start + stride]
    }
}
