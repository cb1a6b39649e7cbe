//! A recording as a glTF animation clip: linear keys, as few as a tolerance allows.

use std::collections::HashMap;
use std::io;

use rayon::prelude::*;
use serde_json::{Value, json};

use super::Recording;
use super::buffer::{GltfBuffer, Use, float_accessor, float_bytes};

/// How exactly a clip follows the recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlbOptions {
    /// Largest distance between the clip and a sample of the recording. \[m\]
    pub position_tolerance: f64,
    /// Largest angle between the clip and a sample of the recording. \[rad\]
    pub rotation_tolerance: f64,
    /// Samples per second; absent, or as many as there are frames: every recorded frame.
    /// \[1/s\]
    pub fps: Option<f64>,
}

impl Default for GlbOptions {
    fn default() -> Self {
        Self { position_tolerance: 1e-5, rotation_tolerance: 1e-5, fps: None }
    }
}

/// Where something is and how it is turned, in 3D whatever the dimension of its scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// \[m\]
    pub position: [f64; 3],
    /// Unit quaternion x, y, z, w.
    pub rotation: [f64; 4],
}

/// A node that follows a body.
#[derive(Clone, Copy)]
pub struct Target<'a> {
    /// Index of the node in the document.
    pub node: usize,
    /// Body in the recording.
    pub body: usize,
    /// Length of a unit of the node's translation in the world. \[m\]
    pub unit: f64,
    /// Translation and rotation of the node in its parent, from the time \[s\] and the pose of
    /// the body in the world. [`pose_at`] tells where other bodies are at that time.
    pub local: &'a (dyn Fn(f64, Pose) -> Pose + Sync),
}

/// The local pose of a node at the root that is its body.
pub fn as_body(_time: f64, pose: Pose) -> Pose {
    pose
}

/// The pose of a body at a time \[s\], between frames and held at the ends.
///
/// # Panics
/// The recording has no such body or no frame.
pub fn pose_at(recording: &Recording, body: usize, time: f64) -> Pose {
    let last = recording.frames() - 1;
    let frame = (time / recording.frame_time).clamp(0.0, last as f64);
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

fn frame_pose(recording: &Recording, frame: usize, body: usize) -> Pose {
    match *recording.pose(frame, body) {
        [x, y, angle] => pose_2d([x.into(), y.into()], angle.into()),
        [x, y, z, a, b, c, d] => Pose {
            position: [x, y, z].map(f64::from),
            rotation: normalized([a, b, c, d].map(f64::from)),
        },
        _ => unreachable!("a pose has 3 or 7 numbers"),
    }
}

/// A pose in the plane z = 0.
pub(super) fn pose_2d([x, y]: [f64; 2], angle: f64) -> Pose {
    let (sin, cos) = (libm::sin(angle / 2.0), libm::cos(angle / 2.0));
    Pose { position: [x, y, 0.0], rotation: [0.0, 0.0, sin, cos] }
}

/// Appends a clip to a document and tells its index: none if nothing moves.
///
/// A node that moves or turns less than the tolerance gets no channel; its own translation and
/// rotation become those of the first frame, unless they are that already.
///
/// # Errors
/// A pose is not finite.
pub fn append_clip(
    gltf: &mut GltfBuffer<'_>,
    name: &str,
    recording: &Recording,
    targets: &[Target<'_>],
    options: &GlbOptions,
) -> io::Result<Option<usize>> {
    let times = sample_times(recording, options);
    let thinned: Vec<_> = targets
        .par_iter()
        .map(|target| thin_target(recording, target, &times, options))
        .collect::<io::Result<_>>()?;
    let mut clip = Clip::default();
    for (target, (positions, rotations)) in targets.iter().zip(&thinned) {
        clip.add(target.node, "translation", &times, positions);
        clip.add(target.node, "rotation", &times, rotations);
        let nodes = gltf.document.get_mut("nodes");
        if let Some(node) = nodes.and_then(|nodes| nodes.get_mut(target.node)) {
            let move_by = target.move_by(options);
            rest_at(node, "translation", [0.0; 3], positions, |a, b| distance(a, b) <= move_by);
            let turn_by = options.rotation_tolerance;
            let none = [0.0, 0.0, 0.0, 1.0];
            rest_at(node, "rotation", none, rotations, |a, b| angle(a, b) <= turn_by);
        }
    }
    Ok((!clip.channels.is_empty()).then(|| clip.append_to(gltf, name)))
}

impl Target<'_> {
    /// The position tolerance in units of the node's translation.
    fn move_by(&self, options: &GlbOptions) -> f64 {
        options.position_tolerance / if self.unit > 0.0 { self.unit } else { 1.0 }
    }
}

/// Gives a node without a channel the value of the first frame.
fn rest_at<const N: usize>(
    node: &mut Value,
    path: &str,
    default: [f64; N],
    track: &Track<N>,
    close: impl Fn([f64; N], [f64; N]) -> bool,
) {
    let Some(first) = track.first.filter(|_| track.kept.is_empty()) else { return };
    let own = node.get(path).map_or(default, |own| {
        std::array::from_fn(|i| own.get(i).and_then(Value::as_f64).unwrap_or(f64::NAN))
    });
    if !close(own, first.map(f64::from)) {
        node[path] = json!(first.map(f64::from).to_vec());
    }
}

/// Rising times of the samples, as the file holds them. \[s\]
fn sample_times(recording: &Recording, options: &GlbOptions) -> Vec<f32> {
    let Some(last) = recording.frames().checked_sub(1) else {
        return Vec::new();
    };
    let end = last as f64 * recording.frame_time;
    let fewer = |fps: &f64| *fps > 0.0 && *fps * recording.frame_time < 1.0;
    let exact: Vec<f64> = match options.fps.filter(fewer) {
        None => (0..=last).map(|frame| frame as f64 * recording.frame_time).collect(),
        Some(fps) => {
            let whole = (end * fps + 1e-6).floor() as u64;
            let mut times: Vec<f64> = (0..=whole).map(|i| i as f64 / fps).collect();
            // The last frame is where things come to rest.
            if end - whole as f64 / fps > 1e-6 * recording.frame_time {
                times.push(end);
            }
            times
        }
    };
    let mut times: Vec<f32> = exact.into_iter().map(|time| time as f32).collect();
    times.dedup();
    times
}

/// Kept samples and their values; none if the track is constant.
struct Track<const N: usize> {
    first: Option<[f32; N]>,
    kept: Vec<u32>,
    values: Vec<[f32; N]>,
}

fn thin_target(
    recording: &Recording,
    target: &Target<'_>,
    times: &[f32],
    options: &GlbOptions,
) -> io::Result<(Track<3>, Track<4>)> {
    let mut positions = Vec::with_capacity(times.len());
    let mut rotations: Vec<[f32; 4]> = Vec::with_capacity(times.len());
    for time in times {
        let time = f64::from(*time);
        let pose = (target.local)(time, pose_at(recording, target.body, time));
        if pose.position.iter().chain(&pose.rotation).any(|x| !x.is_finite()) {
            let message = format!("the pose of body {} at {time} s is not finite", target.body);
            return Err(io::Error::new(io::ErrorKind::InvalidData, message));
        }
        positions.push(pose.position.map(|x| x as f32));
        let before = rotations.last().map_or(pose.rotation, |q| q.map(f64::from));
        let sign = if dot(before, pose.rotation) < 0.0 { -1.0 } else { 1.0 };
        rotations.push(normalized(pose.rotation).map(|x| (sign * x) as f32));
    }
    let (move_by, turn_by) = (target.move_by(options), options.rotation_tolerance);
    Ok((
        thin(times, &positions, |a, b, part, x| distance(lerp(a, b, part), x) <= move_by),
        thin(times, &rotations, |a, b, part, q| angle(slerp(a, b, part), q) <= turn_by),
    ))
}

/// Keeps a sample only if the line between its kept neighbors would miss one in between.
///
/// `close(a, b, part, x)` says whether the interpolation between a and b at that part is near x.
fn thin<const N: usize>(
    times: &[f32],
    values: &[[f32; N]],
    close: impl Fn([f64; N], [f64; N], f64, [f64; N]) -> bool,
) -> Track<N> {
    let value = |i: usize| values[i].map(f64::from);
    let time = |i: usize| f64::from(times[i]);
    let fits = |a: usize, b: usize| {
        (a + 1..b).all(|i| {
            let part = (time(i) - time(a)) / (time(b) - time(a));
            close(value(a), value(b), part, value(i))
        })
    };
    let constant = (1..values.len()).all(|i| close(value(0), value(0), 0.0, value(i)));
    let mut kept = Vec::new();
    if !constant {
        kept.push(0);
        let mut from = 0;
        while from + 1 < values.len() {
            from = farthest(from, values.len() - 1, &fits);
            kept.push(from as u32);
        }
    }
    let first = values.first().copied();
    let values = kept.iter().map(|i| values[*i as usize]).collect();
    Track { first, kept, values }
}

/// A far sample up to which a line from this one fits: strides double while they fit, then the
/// last one is halved.
fn farthest(from: usize, last: usize, fits: &impl Fn(usize, usize) -> bool) -> usize {
    let mut good = from + 1;
    let mut bad = last + 1;
    let mut stride = 2;
    while good < last {
        let probe = (from + stride).min(last);
        if !fits(from, probe) {
            bad = probe;
            break;
        }
        good = probe;
        stride *= 2;
    }
    while good + 1 < bad && bad <= last {
        let probe = good.midpoint(bad);
        if fits(from, probe) { good = probe } else { bad = probe }
    }
    good
}

/// Samplers and channels; all data goes to one view.
#[derive(Default)]
struct Clip {
    data: Vec<u8>,
    /// Offset in the view is relative; the view is known only at the end.
    accessors: Vec<Value>,
    inputs: HashMap<Vec<u32>, usize>,
    samplers: Vec<Value>,
    channels: Vec<Value>,
}

impl Clip {
    fn add<const N: usize>(&mut self, node: usize, path: &str, times: &[f32], track: &Track<N>) {
        if track.kept.is_empty() {
            return;
        }
        let input = match self.inputs.get(&track.kept) {
            Some(input) => *input,
            None => {
                let keys: Vec<[f32; 1]> = track.kept.iter().map(|i| [times[*i as usize]]).collect();
                let input = self.store(&keys, true);
                self.inputs.insert(track.kept.clone(), input);
                input
            }
        };
        let output = self.store(&track.values, false);
        let sampler = self.samplers.len();
        self.samplers.push(json!({"input": input, "output": output, "interpolation": "LINEAR"}));
        self.channels.push(json!({"sampler": sampler, "target": {"node": node, "path": path}}));
    }

    fn store<const N: usize>(&mut self, values: &[[f32; N]], bounds: bool) -> usize {
        self.accessors.push(float_accessor(0, self.data.len(), values, bounds));
        self.data.extend(float_bytes(values));
        self.accessors.len() - 1
    }

    fn append_to(self, gltf: &mut GltfBuffer<'_>, name: &str) -> usize {
        let view = gltf.push_view(&self.data, Use::Data);
        let mut first = 0;
        for (i, mut accessor) in self.accessors.into_iter().enumerate() {
            accessor["bufferView"] = json!(view);
            let index = gltf.push("accessors", accessor);
            first = index - i;
        }
        let mut samplers = self.samplers;
        for sampler in &mut samplers {
            for end in ["input", "output"] {
                let index = sampler[end].as_u64().unwrap_or(0) as usize;
                sampler[end] = json!(first + index);
            }
        }
        let clip = json!({"name": name, "samplers": samplers, "channels": self.channels});
        gltf.push("animations", clip)
    }
}

fn lerp<const N: usize>(a: [f64; N], b: [f64; N], part: f64) -> [f64; N] {
    std::array::from_fn(|i| a[i] + (b[i] - a[i]) * part)
}

/// Along the shorter arc, as glTF interpolates rotations.
fn slerp(a: [f64; 4], b: [f64; 4], part: f64) -> [f64; 4] {
    let cos = dot(a, b);
    let b = if cos < 0.0 { b.map(|x| -x) } else { b };
    let arc = angle(a, b) / 2.0;
    // Below this, the sines cancel and a straight line is exact to rounding.
    if arc < 1e-6 {
        return normalized(lerp(a, b, part));
    }
    let (u, v) = (libm::sin((1.0 - part) * arc), libm::sin(part * arc));
    normalized(std::array::from_fn(|i| u * a[i] + v * b[i]))
}

fn normalized(q: [f64; 4]) -> [f64; 4] {
    let length = dot(q, q).sqrt();
    q.map(|x| x / length)
}

fn dot<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
    (0..N).map(|i| a[i] * b[i]).sum()
}

fn distance<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
    let d: [f64; N] = std::array::from_fn(|i| a[i] - b[i]);
    dot(d, d).sqrt()
}

/// Angle between two rotations; from their chord, since a cosine does not resolve small angles.
/// \[rad\]
fn angle(a: [f64; 4], b: [f64; 4]) -> f64 {
    let chord = distance(a, b).min(distance(a, b.map(|x| -x)));
    4.0 * libm::asin((chord / 2.0).min(1.0))
}

#[cfg(test)]
mod tests;
