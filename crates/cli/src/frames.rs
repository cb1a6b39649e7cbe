//! Selection of the frames of a motion to write, and the tolerance of its keys.

use std::borrow::Cow;
use std::ops::RangeInclusive;

use drystone_bake::recording::usda::BodiesAsPrims;
use drystone_bake::recording::{JointRecording, Recording, Sampling, Velocities};
use drystone_scene::Read;

use crate::failure::Failure;
use crate::quantity::{length, real};

/// Rounding error accepted in a whole number of frames. \[1\]
const WHOLE: f64 = 1e-6;

/// Options that select the frames and keys to write.
#[derive(clap::Args)]
pub(crate) struct FrameOptions {
    /// Write so many frames per second to .glb and .usda; the time step stays the scene's [default:
    /// one per step]
    #[arg(long, value_name = "N", value_parser = real(0.001..=100_000.0))]
    fps: Option<f64>,

    /// Write these frames only, both included, such as 24..96. Frame 0 is the initial state. With
    /// --fps, frames are counted at that rate, else one per step. Frames keep their times, as in
    /// Blender: the clip of 24..96 begins at frame 24 [default: all]
    #[arg(long, value_name = "FIRST..LAST", value_parser = range)]
    frames: Option<RangeInclusive<usize>>,

    /// Allow positions in .glb and .usda to deviate so far from the bake; a larger deviation saves
    /// keys. Rotations may deviate by as many radians as the length has meters. That moves points a
    /// meter from the center of a body by the same length again [default: 0.01mm]
    #[arg(long, value_name = "LENGTH", value_parser = tolerance)]
    key_tolerance: Option<f64>,

    /// Write .usda as a stage of its own even if the scene is OpenUSD: bodies and the shapes that
    /// collide, without materials and textures. Else it is a layer over the scene's stage, which
    /// has to stay where it is relative to the layer
    #[arg(long)]
    new_stage: bool,

    /// Write moving bodies of equal shapes to .usda as instances of one prototype, a PointInstancer
    /// for each shape, without physics; bodies with joints stay prims. An OpenUSD scene needs
    /// --new-stage with it
    #[arg(long)]
    instances: bool,
}

/// A motion to write.
pub(crate) struct OutputMotion<'a> {
    pub(crate) recording: Cow<'a, Recording>,
    /// Name of each body.
    pub(crate) names: &'a [String],
    /// Number of contact points in the step that led to each frame; empty if unknown.
    pub(crate) contacts: &'a [u32],
    /// Joints, as far as they are known.
    pub(crate) joints: Cow<'a, JointRecording>,
    /// Velocities, as far as they are known.
    pub(crate) velocities: Cow<'a, Velocities>,
}

impl FrameOptions {
    /// Whether any of the options is given.
    pub(crate) fn is_asked(&self) -> bool {
        let keys = self.fps.is_some() || self.frames.is_some() || self.key_tolerance.is_some();
        keys || self.new_stage || self.instances
    }

    /// True if .usda is to be a stage of its own, whatever the scene is.
    pub(crate) fn new_stage(&self) -> bool {
        self.new_stage
    }

    /// Returns how .usda holds bodies.
    pub(crate) fn bodies_as_prims(&self) -> BodiesAsPrims {
        if self.instances { BodiesAsPrims::Instances } else { BodiesAsPrims::Each }
    }

    /// Refuses options that do not fit the scene.
    pub(crate) fn check(&self, read: &Read) -> Result<(), Failure> {
        if self.instances && !self.new_stage && read.stage.is_some() {
            return Err(Failure::Input(
                "--instances: a layer over the stage of the scene keeps its prims; accepted: with \
                 --new-stage, or another scene"
                    .to_owned(),
            ));
        }
        Ok(())
    }

    /// Returns the sampling of the motion.
    pub(crate) fn sampling(&self) -> Sampling {
        let close = self.key_tolerance.map_or_else(Sampling::default, Sampling::within);
        Sampling { fps: self.fps, ..close }
    }

    /// Returns the steps of a bake, `time_step` \[s\] apart, that the requested frames need.
    /// Refuses frames that the bake does not have.
    pub(crate) fn steps(
        &self,
        bake: RangeInclusive<usize>,
        time_step: f64,
    ) -> Result<RangeInclusive<usize>, Failure> {
        let Some(frames) = &self.frames else { return Ok(bake) };
        let stride = self.sampling().stride(time_step);
        let begin = (*bake.start() as f64 / stride - WHOLE).ceil() as usize;
        let end = (*bake.end() as f64 / stride + WHOLE).floor() as usize;
        let (first, last) = (*frames.start(), *frames.end());
        if first < begin || last > end {
            return Err(Failure::Input(format!(
                "--frames is {first}..{last}; accepted: frames from {begin} to {end}"
            )));
        }
        // A frame between two steps needs both.
        let from = (first as f64 * stride + WHOLE).floor() as usize;
        let to = (last as f64 * stride - WHOLE).ceil() as usize;
        Ok(from.max(*bake.start())..=to.min(*bake.end()))
    }

    /// Returns the requested part of a bake.
    pub(crate) fn motion<'a>(&self, whole: OutputMotion<'a>) -> Result<OutputMotion<'a>, Failure> {
        let recording = &whole.recording;
        let start = recording.start;
        let (Some(more), Some(_)) = (recording.frames().checked_sub(1), &self.frames) else {
            return Ok(whole);
        };
        let steps = self.steps(start..=start + more, recording.frame_time)?;
        let places = steps.start() - start..=steps.end() - start;
        let frame = recording.bodies * Velocities::stride(recording.dimension);
        Ok(OutputMotion {
            contacts: whole.contacts.get(places.clone()).unwrap_or_default(),
            velocities: Cow::Owned(whole.velocities.piece(&places, frame)),
            joints: Cow::Owned(whole.joints.piece(places, start)),
            recording: Cow::Owned(recording.piece(steps)),
            names: whole.names,
        })
    }
}

/// Parses the first and the last of a range of frames.
fn range(text: &str) -> Result<RangeInclusive<usize>, String> {
    let whole = |text: &str| text.trim().parse().ok();
    let ends = text.split_once("..").and_then(|(a, b)| Some((whole(a)?, whole(b)?)));
    ends.filter(|(first, last)| first <= last).map(|(first, last)| first..=last).ok_or_else(|| {
        "accepted: two whole numbers, such as 24..96, the second at least the first".to_owned()
    })
}

/// Parses the tolerance of keys. \[m\]
fn tolerance(text: &str) -> Result<f64, String> {
    let accepted = "accepted: a length from 0 to 1000 m, such as 0.1mm or 0.0001m";
    length(text).filter(|x| (0.0..=1e3).contains(x)).ok_or_else(|| accepted.to_owned())
}
