//! Writes a scene and its recording as OpenUSD text, for Houdini, Maya, Omniverse, Blender and
//! others.

use std::io;
use std::path::Path;

use super::clock::Clock;
use super::parallel::each_of;
use super::pose::{dot, lerp, normalized, pose_at, slerp};
use super::sampling::{Track, tracks};
use super::usd_instances::Groups;
use super::{JointRecording, Recording, Sampling};
use crate::engine::Drystone;
use drystone_scene::export::usd::{PrimWriter, Prims, StageHead, deform, tuple, write_stage};
use drystone_scene::{Body, Scene};

/// Form of the bodies in a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BodiesAsPrims {
    /// Each is a prim with the schemas of UsdPhysics.
    Each,
    /// Moving bodies of equal shapes without joints are instances of one prototype, which has no
    /// physics.
    Instances,
}

/// Writes a scene as a stage with the schemas of UsdPhysics: an `Xform` per body, moved by time
/// samples, with its shapes below it. Time code 0 is the initial state.
///
/// Units are meters and kilograms, with +y up. 2D scenes lie in the plane z = 0, 0.5 m thick, and
/// without their joints. A name that is no valid prim name becomes the display name. The attribute
/// `jointEnabled` of a joint that breaks has time samples. `joints` may be empty if unknown.
///
/// # Errors
/// If the recording has other bodies or joints or is not finite, or the file cannot be written. An
/// existing file then stays unchanged.
pub fn write(
    path: &Path,
    scene: &Scene,
    recording: &Recording,
    joints: &JointRecording,
    options: &Sampling,
) -> io::Result<()> {
    write_as(path, (scene, BodiesAsPrims::Each), recording, joints, options)
}

/// Writes a scene as [`write`](fn@write) does, with bodies as prims or as instances.
///
/// # Errors
/// Those of [`write`](fn@write).
pub fn write_as(
    path: &Path,
    (scene, form): (&Scene, BodiesAsPrims),
    recording: &Recording,
    joints: &JointRecording,
    options: &Sampling,
) -> io::Result<()> {
    recording.must_have(scene.bodies.len(), scene.dimension)?;
    joints_must_fit(joints, scene.joints.len())?;
    let clock = Clock::new(recording, None, options);
    let (times, codes) = (&clock.times, clock.codes());
    let prims = Prims::new(scene, &Drystone);
    let groups = match form {
        BodiesAsPrims::Instances if !times.is_empty() => Some(Groups::of(scene)),
        _ => None,
    };
    let is_alone = |body: &usize| groups.as_ref().is_none_or(|groups| !groups.have(*body));
    let alone: Vec<usize> = (0..scene.bodies.len()).filter(is_alone).collect();
    let bodies: Vec<PrimWriter> = each_of(alone.len(), |place| {
        let index = alone[place];
        let pose = |time| pose_at(recording, index, time);
        let mut prim = prims.body(index);
        if !times.is_empty() {
            let (positions, rotations) = tracks(times, pose, mixed, options, index)?;
            move_prim(&mut prim, &codes, &positions, &rotations);
            deform_shapes(&mut prim, &scene.bodies[index], &clock);
        }
        Ok(prim)
    })?;
    let mut world = prims.world();
    world.children.extend(bodies);
    if let Some(groups) = &groups {
        world.children.extend(groups.prims(&prims, recording, &clock)?);
    }
    if scene.dimension == 3 {
        let wrong = |why| io::Error::new(io::ErrorKind::InvalidInput, why);
        let mut scope = prims.joints().map_err(wrong)?;
        let scoped = scope.iter_mut().flat_map(|scope| &mut scope.children);
        for (prim, broken) in scoped.zip(&joints.broken) {
            let time = broken.map(|frame| frame as f64 * recording.frame_time);
            break_prim(prim, time.map(|time| clock.code(time)), codes.first().copied());
        }
        world.children.extend(scope);
    }
    let (frames, codes) = (clock.rate, clock.rate);
    let head = StageHead { ends: clock.ends(), frames, codes, ..StageHead::default() };
    write_stage(path, &head, &[world])
}

/// Gives the meshes of a body that deform their points by time code.
fn deform_shapes(prim: &mut PrimWriter, body: &Body, clock: &Clock) {
    for (prim, shape) in prim.children.iter_mut().zip(&body.shapes) {
        let Some(track) = shape.kind.vertex_track() else { continue };
        let keys = track.times.iter().zip(&track.points);
        let single = |point: &[f64; 3]| point.map(|x| x as f32);
        deform(prim, keys.map(|(time, at)| (clock.code(*time), at.iter().map(single).collect())));
    }
}

/// Checks that the joints, if any are known, are as many as those of the scene.
pub(super) fn joints_must_fit(joints: &JointRecording, count: usize) -> io::Result<()> {
    let own = joints.layout.names.len();
    if own == 0 || own == count {
        return Ok(());
    }
    let message = format!("a recording of {own} joints is not of a scene with {count}");
    Err(io::Error::new(io::ErrorKind::InvalidInput, message))
}

/// Switches the prim of a joint off at the time code at which it breaks, if it does.
pub(super) fn break_prim(prim: &mut PrimWriter, broken: Option<f64>, first: Option<f64>) {
    let (Some(broken), Some(first)) = (broken, first) else { return };
    let whole = (first < broken).then(|| (first, "1".to_owned()));
    let samples = whole.into_iter().chain([(broken.max(first), "0".to_owned())]);
    prim.follow("bool physics:jointEnabled", samples, None);
}

/// Sets the pose of a prim from its recording: time samples, or a single value if it is constant.
fn move_prim(prim: &mut PrimWriter, codes: &[f64], positions: &Track<3>, rotations: &Track<4>) {
    follow(prim, "double3 xformOp:translate", codes, positions, |x| tuple(&x));
    follow(prim, "quatd xformOp:orient", codes, rotations, turned);
}

/// Formats a rotation. OpenUSD computes its angle from w alone. In single precision, w is 1 up to
/// a milliradian.
pub(super) fn turned(rotation: [f32; 4]) -> String {
    let [x, y, z, w] = normalized(rotation.map(f64::from)).map(|x| (x * 1e12).round() / 1e12);
    tuple(&[w, x, y, z])
}

/// Gives an attribute the samples of a track, or its constant value.
pub(super) fn follow<const N: usize>(
    prim: &mut PrimWriter,
    attribute: &str,
    codes: &[f64],
    track: &Track<N>,
    text: impl Fn([f32; N]) -> String,
) {
    let code = |sample: &u32| codes.get(*sample as usize).copied().unwrap_or(0.0);
    let samples = track.kept.iter().zip(&track.values);
    let samples = samples.map(|(sample, value)| (code(sample), text(*value)));
    prim.follow(attribute, samples, track.first.map(&text));
}

/// Interpolates rotations as OpenUSD does: near ones along a straight line without normalization,
/// with the angle computed from w alone. Near the identity, w differs from 1 only to second order.
/// The error there is up to half the angle between the two rotations (`GfSlerp`,
/// `GfRotation::SetQuat`).
pub(super) fn mixed(a: [f64; 4], b: [f64; 4], part: f64) -> [f64; 4] {
    const NEAR: f64 = 1e-5;
    let (a, b) = (normalized(a), normalized(b));
    if 1.0 - dot(a, b) > NEAR {
        return slerp(a, b, part);
    }
    let [x, y, z, w] = lerp(a, b, part);
    let sine = (1.0 - w * w).max(0.0).sqrt();
    let length = dot([x, y, z], [x, y, z]).sqrt();
    let long = if length > 0.0 { sine / length } else { 0.0 };
    [x * long, y * long, z * long, w]
}

#[cfg(test)]
mod tests;
