//! Joints in the summary and the report of a bake.

use drystone_bake::recording::joints::{JointFrame, JointMiss};
use drystone_scene::Scene;
use serde::Serialize;

use super::record::Bake;
use super::words::counted;

/// Misses and breaks of the joints in a run.
#[derive(Serialize)]
pub(super) struct JointSummary {
    /// Number of joints.
    joints: usize,
    /// Largest distance by which a joint misses its locks and limits at any frame \[m\]; absent if
    /// none does.
    #[serde(skip_serializing_if = "Option::is_none")]
    gap: Option<Worst>,
    /// Largest angle by which a joint misses its locks and limits at any frame \[rad\]; absent if
    /// none does.
    #[serde(skip_serializing_if = "Option::is_none")]
    angle: Option<Worst>,
    /// Joints that broke, in order.
    broken: Vec<Broken>,
}

/// The joint that missed its locks and limits most.
#[derive(Serialize)]
struct Worst {
    joint: u32,
    name: String,
    /// Frame after which it did; 0 is the initial state.
    frame: usize,
    /// \[m\] or \[rad\]
    by: f64,
}

/// A joint that broke.
#[derive(Serialize)]
struct Broken {
    joint: u32,
    name: String,
    /// Step, counted from 1.
    step: usize,
    /// Time at the end of the step. \[s\]
    time: f64,
    /// Force that broke it: its mean over the step, or over 1/240 s of it. \[N\]
    force: f64,
    /// Torque over the same time. \[N m\]
    torque: f64,
}

/// Returns the largest misses of joints at a frame; `None` without joints.
pub(super) fn gap(frame: &JointFrame) -> Option<[f64; 2]> {
    let by = |miss: Option<JointMiss>| miss.map_or(0.0, |miss| miss.by);
    (!frame.loads.is_empty()).then(|| frame.worst.map(by))
}

impl JointSummary {
    /// Summarizes the joints of a run; `None` without joints.
    pub(super) fn new(scene: &Scene, bake: &Bake) -> Option<Self> {
        if scene.joints.is_empty() {
            return None;
        }
        let names = scene.joint_names();
        let name = |joint: u32| names.get(joint as usize).cloned().unwrap_or_default();
        let worst = |side: usize| {
            let misses = bake.joints.iter().map(|frame| frame.worst[side]).enumerate();
            let misses = misses.filter_map(|(frame, miss)| Some((frame, miss?)));
            let (frame, JointMiss { joint, by }) =
                misses.max_by(|a, b| a.1.by.total_cmp(&b.1.by))?;
            Some(Worst { joint, name: name(joint), frame, by })
        };
        let steps = bake.steps.iter().enumerate();
        let broken = steps.flat_map(|(step, of)| of.report.broken.iter().map(move |b| (step, b)));
        let broken = broken.map(|(step, of)| Broken {
            joint: of.joint,
            name: name(of.joint),
            step: step + 1,
            time: (step + 1) as f64 * scene.time_step,
            force: of.force,
            torque: of.torque,
        });
        let broken = broken.collect();
        Some(Self { joints: names.len(), gap: worst(0), angle: worst(1), broken })
    }

    /// Names the joints that missed their locks and limits most.
    pub(super) fn text(&self, scene: &Scene) -> String {
        let place = |of: &Worst| {
            let time = of.frame as f64 * scene.time_step;
            format!("{} at {time:.3} s", scene.joint_name_of(of.joint as usize))
        };
        let mut misses = Vec::new();
        if let Some(of) = &self.gap {
            misses.push(format!("{:.4} mm ({})", of.by * 1e3, place(of)));
        }
        if let Some(of) = &self.angle {
            misses.push(format!("{:.4} degrees ({})", of.by.to_degrees(), place(of)));
        }
        let off = match misses.as_slice() {
            [] => "none off its locks and limits".to_owned(),
            _ => format!("off their locks and limits by at most {}", misses.join(" and ")),
        };
        let broken = match self.broken.len() {
            0 => String::new(),
            count => format!("; {count} broke, see the notes"),
        };
        format!("{}, {off}{broken}", counted(self.joints, "joint"))
    }

    /// Lists the first `most` joints that broke, and counts the rest.
    pub(super) fn breaks(&self, scene: &Scene, most: usize) -> Option<String> {
        if self.broken.is_empty() {
            return None;
        }
        let one = |of: &Broken| {
            let name = scene.joint_name_of(of.joint as usize);
            format!("{name} at {:.3} s by {:.1} N and {:.2} N m", of.time, of.force, of.torque)
        };
        let list: Vec<_> = self.broken.iter().take(most).map(one).collect();
        let more = match self.broken.len().saturating_sub(most) {
            0 => String::new(),
            more => format!(", and {more} more"),
        };
        Some(format!("broke: {}{more}", list.join(", ")))
    }
}
