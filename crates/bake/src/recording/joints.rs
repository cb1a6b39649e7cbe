//! [`JointRecording`]: values and loads of joints over time, beside the poses of a
//! [`Recording`](super::Recording).
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects
    )
)]

use std::ops::RangeInclusive;

use drystone::{BrokenJoint, JointState};
use drystone_scene::Scene;
use serde::{Deserialize, Serialize};

use crate::any_world::AnyWorld;

/// Numbers per joint and frame in [`JointRecording::loads`].
pub(super) const LOADS: usize = 2;

/// Names of the joints of a scene and of their axes.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct JointLayout {
    /// One name per joint.
    pub names: Vec<String>,
    /// Axes of all joints, joint by joint.
    pub axes: Vec<AxisName>,
}

/// An axis of a joint.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AxisName {
    /// Index of the joint.
    pub joint: u32,
    /// Name of the coordinate, as in scenes.
    pub coordinate: String,
}

impl JointLayout {
    /// Returns the layout of the joints of a scene.
    pub fn of(scene: &Scene) -> Self {
        let axes = scene.joints.iter().zip(0..).flat_map(|(joint, index)| {
            let coordinates = joint.axes.iter().map(|axis| axis.coordinate.name().to_owned());
            coordinates.map(move |coordinate| AxisName { joint: index, coordinate })
        });
        Self { names: scene.joint_names(), axes: axes.collect() }
    }

    /// Returns true if there are no joints.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }
}

/// Joints at one frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointFrame {
    /// Value of the coordinate of each axis, joint by joint. \[m, or rad\]
    pub values: Vec<f32>,
    /// Lengths of the mean force on body a and of its torque about the joint, in the step that led
    /// to the frame; joint by joint. \[N, N m\]
    pub loads: Vec<f32>,
    /// Joints that miss their locks and limits most: by a position \[m\], and by a rotation
    /// \[rad\]. `None` if no joint misses any.
    pub worst: [Option<JointMiss>; 2],
}

/// A joint that misses a lock or a limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointMiss {
    /// Index of the joint.
    pub joint: u32,
    /// Distance \[m\] or angle \[rad\].
    pub by: f64,
}

impl JointFrame {
    /// Returns the joints of a world, which was built from this scene.
    pub fn of(world: &AnyWorld, scene: &Scene) -> Self {
        let mut frame = Self::default();
        if scene.joints.is_empty() {
            return frame;
        }
        for ((id, joint), index) in world.joints().into_iter().zip(&scene.joints).zip(0..) {
            let Some(state) = world.joint(id) else { continue };
            frame.add(&state, index, joint.enabled && !state.broken);
        }
        frame
    }

    /// Adds the state of a joint. One that does not act misses nothing.
    fn add(&mut self, state: &JointState, joint: u32, acts: bool) {
        self.values.extend(state.values.iter().map(|value| *value as f32));
        self.loads.extend([state.force, state.torque].map(|load| load as f32));
        for (worst, by) in self.worst.iter_mut().zip([state.gap, state.angle]) {
            let known = worst.map_or(0.0, |miss| miss.by);
            if acts && by > known {
                *worst = Some(JointMiss { joint, by });
            }
        }
    }

    /// Returns true if it is a frame of these joints.
    pub(super) fn fits(&self, layout: &JointLayout) -> bool {
        let worst = self.worst.iter().flatten();
        self.values.len() == layout.axes.len()
            && self.loads.len() == layout.names.len().saturating_mul(LOADS)
            && worst.into_iter().all(|miss| (miss.joint as usize) < layout.names.len())
    }
}

/// Joints over time: those of a recording, frame by frame. Empty if the scene has none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointRecording {
    /// Names of joints and axes.
    pub layout: JointLayout,
    /// Value of each axis, by frame. \[m, or rad\]
    pub values: Vec<f32>,
    /// Mean force and torque of each joint in the step that led to a frame, by frame; 0 in that of
    /// the initial state. \[N, N m\]
    pub loads: Vec<f32>,
    /// First frame in which each joint is broken; `None` if it never breaks.
    pub broken: Vec<Option<usize>>,
}

impl JointRecording {
    /// Returns the recording of these frames from frame 0 on, and of the joints that each step
    /// between them broke.
    pub fn new<'a>(
        layout: JointLayout,
        frames: &[JointFrame],
        broken: impl Iterator<Item = &'a [BrokenJoint]>,
    ) -> Self {
        if layout.is_empty() {
            return Self::default();
        }
        let mut first = vec![None; layout.names.len()];
        for (step, broken) in broken.enumerate() {
            for joint in broken {
                if let Some(frame) = first.get_mut(joint.joint as usize) {
                    frame.get_or_insert(step.saturating_add(1));
                }
            }
        }
        Self {
            layout,
            values: frames.iter().flat_map(|frame| &frame.values).copied().collect(),
            loads: frames.iter().flat_map(|frame| &frame.loads).copied().collect(),
            broken: first,
        }
    }

    /// Returns the frames at these places, counted from the first frame, whose number is `start`. A
    /// joint that breaks after them is whole.
    #[must_use]
    pub fn piece(&self, places: RangeInclusive<usize>, start: usize) -> Self {
        let cut = |numbers: &[f32], stride: usize| {
            let end = places.end().saturating_add(1).saturating_mul(stride);
            let numbers = numbers.get(places.start().saturating_mul(stride)..end);
            numbers.unwrap_or_default().to_vec()
        };
        let last = start.saturating_add(*places.end());
        Self {
            values: cut(&self.values, self.layout.axes.len()),
            loads: cut(&self.loads, self.layout.names.len().saturating_mul(LOADS)),
            broken: self.broken.iter().map(|at| at.filter(|frame| *frame <= last)).collect(),
            layout: self.layout.clone(),
        }
    }
}
