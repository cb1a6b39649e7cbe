//! Writes a scene and its recording as OpenUSD text, for Houdini, Maya, Omniverse, Blender and
//! others.

use std::io;
use std::path::Path;

use super::parallel::each_of;
use super::pose::{dot, lerp, normalized, pose_at, slerp};
use super::sampling::{Track, sample_rate, sample_times, tracks};
use super::{JointRecording, Recording, Sampling};
use crate::engine::Drystone;
use drystone_scene::Scene;
use drystone_scene::export::usd::{PrimWriter, Prims, rounded, tuple, write_stage};

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
    recording.must_have(scene.bodies.len(), scene.dimension)?;
    must_have(joints, scene.joints.len())?;
    let times = sample_times(recording, options);
    let rate = rounded(sample_rate(recording, options));
    let codes: Vec<f64> = times.iter().map(|time| rounded(time * rate)).collect();
    let prims = Prims::new(scene, &Drystone);
    let bodies: Vec<PrimWriter> = each_of(scene.bodies.len(), |index| {
        let pose = |time| pose_at(recording, index, time);
        let mut prim = prims.body(index);
        if !times.is_empty() {
            let (positions, rotations) = tracks(&times, pose, mixed, options, index)?;
            move_prim(&mut prim, &codes, &positions, &rotations);
        }
        Ok(prim)
    })?;
    let mut world = prims.world();
    world.children.extend(bodies);
    if scene.dimension == 3 {
        let wrong = |why| io::Error::new(io::ErrorKind::InvalidInput, why);
        let mut scope = prims.joints().map_err(wrong)?;
        let scoped = scope.iter_mut().flat_map(|scope| &mut scope.children);
        for (prim, broken) in scoped.zip(&joints.broken) {
            let time = broken.map(|frame| frame as f64 * recording.frame_time);
            break_prim(prim, time.map(|time| rounded(time * rate)), codes.first().copied());
        }
        world.children.extend(scope);
    }
    let ends = [codes.first(), codes.last()].map(|code| code.copied().unwrap_or(0.0));
    write_stage(path, &world, ends, rate, rate)
}

/// Checks that the joints, if any are known, are as many as those of the scene.
fn must_have(joints: &JointRecording, count: usize) -> io::Result<()> {
    let own = joints.layout.names.len();
    if own == 0 || own == count {
        return Ok(());
    }
    let message = format!("a recording of {own} joints is not of a scene with {count}");
    Err(io::Error::new(io::ErrorKind::InvalidInput, message))
}

/// Switches the prim of a joint off at the time code at which it breaks, if it does.
fn break_prim(prim: &mut PrimWriter, broken: Option<f64>, first: Option<f64>) {
    let (Some(broken), Some(first)) = (broken, first) else { return };
    let whole = (first < broken).then(|| (first, "1".to_owned()));
    let samples = whole.into_iter().chain([(broken.max(first), "0".to_owned())]);
    prim.follow("bool physics:jointEnabled", samples, None);
}

/// Sets the pose of a prim from its recording: time samples, or a single value if it is constant.
fn move_prim(prim: &mut PrimWriter, codes: &[f64], positions: &Track<3>, rotations: &Track<4>) {
    // OpenUSD computes the angle from w alone. In single precision, w is 1 up to a milliradian.
    let turned = |q: [f32; 4]| {
        let [x, y, z, w] = normalized(q.map(f64::from)).map(|x| (x * 1e12).round() / 1e12);
        tuple(&[w, x, y, z])
    };
    follow(prim, "double3 xformOp:translate", codes, positions, |x| tuple(&x));
    follow(prim, "quatd xformOp:orient", codes, rotations, turned);
}

/// Gives an attribute the samples of a track, or its constant value.
fn follow<const N: usize>(
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
fn mixed(a: [f64; 4], b: [f64; 4], part: f64) -> [f64; 4] {
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
