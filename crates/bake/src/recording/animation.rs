//! Writes a recording as a glTF animation clip: linear keys, as few as the tolerance allows.

use std::collections::HashMap;
use std::io;

use serde_json::{Value, json};

use super::Recording;
use super::parallel::each_of;
use super::pose::{Pose, angle, distance, pose_at, slerp};
use super::sampling::{Sampling, Track, sample_times, tracks};
use drystone_scene::export::{DeformingNode, GltfBuffer, Use, float_accessor, float_bytes};

/// A node that follows a body.
#[derive(Clone, Copy)]
pub struct Target<'a> {
    /// Index of the node in the document.
    pub node: usize,
    /// Index of the body in the recording.
    pub body: usize,
    /// Length of a unit of the node's translation in the world. \[m\]
    pub unit: f64,
    /// Function from the time \[s\] and the world pose of the body to the pose of the node relative
    /// to its parent. It may call [`pose_at`] for the poses of other bodies at that time.
    pub local: &'a (dyn Fn(f64, Pose) -> Pose + Sync),
}

/// Returns the local pose of a root node that represents the body itself.
pub fn as_body(_time: f64, pose: Pose) -> Pose {
    pose
}

/// Appends a clip to a document, in which nodes follow bodies and meshes deform, and returns its
/// index; `None` if nothing moves.
///
/// A node that moves or turns less than the tolerance gets no channel. Its own translation and
/// rotation are set to those of the first frame, unless they already agree.
///
/// # Errors
/// If a pose is not finite.
pub fn append_clip(
    gltf: &mut GltfBuffer<'_>,
    name: &str,
    recording: &Recording,
    (targets, deforming): (&[Target<'_>], &[DeformingNode]),
    options: &Sampling,
) -> io::Result<Option<usize>> {
    // In the precision of the file.
    let mut times: Vec<f32> =
        sample_times(recording, options).into_iter().map(|time| time as f32).collect();
    times.dedup();
    let exact: Vec<f64> = times.iter().map(|time| f64::from(*time)).collect();
    let thinned = each_of(targets.len(), |index| {
        let target = &targets[index];
        let pose = |time| (target.local)(time, pose_at(recording, target.body, time));
        let options = Sampling { position_tolerance: target.move_by(options), ..*options };
        tracks(&exact, pose, slerp, &options, target.body)
    })?;
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
    deforming.iter().for_each(|mesh| clip.deform(mesh));
    Ok((!clip.channels.is_empty()).then(|| clip.append_to(gltf, name)))
}

impl Target<'_> {
    /// Returns the position tolerance in units of the node's translation.
    fn move_by(&self, options: &Sampling) -> f64 {
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

/// Samplers and channels; all data goes to one buffer view.
#[derive(Default)]
struct Clip {
    data: Vec<u8>,
    /// Accessors into that view, whose index is set at the end.
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
        self.connect([input, output], node, path);
    }

    /// Takes a mesh from one of its morph targets to the next. At the first time all weights are 0.
    fn deform(&mut self, mesh: &DeformingNode) {
        let keys: Vec<[f32; 1]> = mesh.times.iter().map(|time| [*time as f32]).collect();
        if keys.len() < 2 {
            return;
        }
        let weight = |time: usize, target: usize| [f32::from(u8::from(time == target))];
        let targets = 1..keys.len();
        let weights: Vec<[f32; 1]> = (0..keys.len())
            .flat_map(|time| targets.clone().map(move |target| weight(time, target)))
            .collect();
        let ends = [self.store(&keys, true), self.store(&weights, false)];
        self.connect(ends, mesh.node, "weights");
    }

    /// Adds a channel from these accessors of times and values.
    fn connect(&mut self, [input, output]: [usize; 2], node: usize, path: &str) {
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

#[cfg(test)]
mod tests;
