//! Writes the glTF of a scene again, with the recording as an animation.

#![deny(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Write};
use std::path::Path;

use serde_json::{Map, Value, json};

use super::Recording;
use crate::scene::gltf::math::{self, Quat, Vec3};
use crate::scene::gltf::nodes::{Affine, Trs};
use crate::scene::gltf::{Source, container};
use crate::scene::{Place, Warning};

/// Name of the animation that is added.
const CLIP: &str = "Drystone";
/// How far a position between keys may be from the recording. \[m\]
const POSITION_SLACK: f64 = 1e-5;
/// How far a rotation between keys may be from the recording. \[rad\]
const TURN_SLACK: f64 = 1e-5;
/// Buffer data starts at multiples of this, which suits every component type.
const ALIGNMENT: usize = 8;

/// Local transforms of a node over time.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeTrack {
    /// The node of the document.
    pub node: usize,
    /// Ascending. \[s\]
    pub times: Vec<f32>,
    /// In the node's parent, one per time.
    pub translations: Vec<[f32; 3]>,
    /// In the node's parent, one per time, x y z w; without jumps of sign.
    pub rotations: Vec<[f32; 4]>,
    /// Length of a unit of the translations in the world. \[m\]
    pub unit: f64,
}

/// Writes `recording` into the glTF that its scene was read from, as one `.glb`.
///
/// The file that `source` was read from stays as it is. What comes back are warnings about parts
/// of the document that still need other files.
///
/// # Errors
///
/// Where `recording` does not belong to `source`, or the file cannot be written.
pub fn write(
    out: &mut impl Write,
    source: &Source,
    recording: &Recording,
) -> io::Result<Vec<Warning>> {
    let tracks = node_tracks(source, recording)?;
    let (mut document, mut bin, warnings) = merge(source)?;
    add_clip(&mut document, &mut bin, source, &tracks)?;
    write_glb(out, &document, &bin)?;
    Ok(warnings)
}

/// Turns the poses of the bodies into local transforms of their nodes.
///
/// Static bodies have no track, nor have bodies that an animation of the file moves: the clip
/// repeats that animation.
///
/// # Errors
///
/// Where `recording` has other bodies than `source`, or poses that are not finite.
pub fn node_tracks(source: &Source, recording: &Recording) -> io::Result<Vec<NodeTrack>> {
    let bodies = &source.bodies;
    if recording.dimension != 3 || recording.bodies != bodies.len() {
        return Err(invalid(format!(
            "a recording of {} bodies in {}D does not belong to a glTF with {} bodies",
            recording.bodies,
            recording.dimension,
            bodies.len()
        )));
    }
    if let Some(at) = recording.poses.iter().position(|x| !x.is_finite()) {
        let body = at / recording.stride() % recording.bodies.max(1);
        return Err(invalid(format!("the recording holds a pose of body {body} without a number")));
    }
    let mut order: Vec<usize> = (0..bodies.len()).collect();
    order.sort_by_key(|body| bodies[*body].depth);

    let mut tracks: Vec<Option<NodeTrack>> = bodies
        .iter()
        .map(|body| {
            (body.moves && !body.driven).then(|| NodeTrack {
                node: body.node,
                times: Vec::new(),
                translations: Vec::new(),
                rotations: Vec::new(),
                unit: 1.0,
            })
        })
        .collect();
    let mut worlds = vec![(Affine::IDENTITY, math::NO_TURN); bodies.len()];
    for frame in 0..recording.frames() {
        let time = (frame as f64 * recording.frame_time) as f32;
        for index in &order {
            let body = &bodies[*index];
            let (position, turn) = pose(recording, frame, *index);
            let (above, above_turn) = match body.carrier {
                Some(carrier) => {
                    let (world, turn) = worlds[carrier];
                    (world.after(&body.parent), math::quat_mul(turn, body.parent_turn))
                }
                None => (body.parent, body.parent_turn),
            };
            let mut world =
                Affine { linear: math::mul(math::rotation(turn), body.rest), shift: position };
            if let Some(track) = &mut tracks[*index] {
                let inverse = math::inverse(above.linear).ok_or_else(|| {
                    invalid(format!("a scale of 0 above node {} hides its motion", body.node))
                })?;
                let local = Trs {
                    translation: math::apply(inverse, math::sub(position, above.shift)),
                    rotation: math::quat_mul(math::conjugate(above_turn), turn),
                    scale: body.local.scale,
                };
                world = above.after(&local.affine());
                track.push(time, &local);
                if frame == 0 {
                    track.unit = above.linear.map(math::length).into_iter().fold(0.0, f64::max);
                }
            }
            worlds[*index] = (world, turn);
        }
    }
    Ok(tracks.into_iter().flatten().collect())
}

fn pose(recording: &Recording, frame: usize, body: usize) -> (Vec3, Quat) {
    let pose = recording.pose(frame, body);
    let number = |i: usize| f64::from(pose[i]);
    let turn = [number(3), number(4), number(5), number(6)];
    ([number(0), number(1), number(2)], math::quat_unit(turn).unwrap_or(math::NO_TURN))
}

impl NodeTrack {
    fn push(&mut self, time: f32, local: &Trs) {
        let mut rotation = math::quat_unit(local.rotation).unwrap_or(math::NO_TURN);
        if let Some(last) = self.rotations.last()
            && math::quat_dot(last.map(f64::from), rotation) < 0.0
        {
            rotation = rotation.map(|x| -x);
        }
        self.times.push(time);
        self.translations.push(local.translation.map(|x| x as f32));
        self.rotations.push(rotation.map(|x| x as f32));
    }
}

fn invalid(message: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, message)
}

fn broken() -> io::Error {
    invalid("the glTF document does not have the form it was read with".into())
}

/// The document with one buffer, and the bytes of that buffer.
fn merge(source: &Source) -> io::Result<(Value, Vec<u8>, Vec<Warning>)> {
    let mut document = source.document.clone();
    let mut bin = Vec::new();
    let mut warnings = Vec::new();
    let root = document.as_object_mut().ok_or_else(broken)?;

    // Where each buffer begins in the one that replaces it, or its new index.
    let mut moved = Vec::new();
    let mut kept = vec![json!({ "byteLength": 0 })];
    let old = root.get("buffers").and_then(Value::as_array).cloned().unwrap_or_default();
    for (buffer, bytes) in old.into_iter().zip(&source.buffers) {
        match bytes {
            Some(bytes) => {
                align(&mut bin, 0);
                moved.push((0, bin.len()));
                bin.extend_from_slice(bytes);
            }
            None => {
                moved.push((kept.len(), 0));
                kept.push(buffer);
            }
        }
    }
    for view in root.get_mut("bufferViews").and_then(Value::as_array_mut).into_iter().flatten() {
        move_view(view, &moved).ok_or_else(broken)?;
        let extensions = view.get_mut("extensions").and_then(Value::as_object_mut);
        for extension in extensions.into_iter().flat_map(Map::values_mut) {
            // Compressed copies of a view name their buffer the same way.
            if extension.get("buffer").is_some() {
                move_view(extension, &moved).ok_or_else(broken)?;
            }
        }
    }
    root.insert("buffers".into(), Value::Array(kept));
    embed_images(root, &mut bin, &source.folder, &mut warnings)?;
    Ok((document, bin, warnings))
}

fn move_view(view: &mut Value, moved: &[(usize, usize)]) -> Option<()> {
    // Readers accept whole numbers written as floats.
    let whole = |value: &Value| value.as_u64().or_else(|| value.as_f64().map(|x| x as u64));
    let view = view.as_object_mut()?;
    let (buffer, begin) = *moved.get(usize::try_from(whole(view.get("buffer")?)?).ok()?)?;
    let offset = view.get("byteOffset").map_or(Some(0), whole)?;
    view.insert("buffer".into(), json!(buffer));
    let offset = offset.checked_add(begin as u64)?;
    if offset > 0 || view.contains_key("byteOffset") {
        view.insert("byteOffset".into(), json!(offset));
    }
    Some(())
}

/// Takes images beside the document into the buffer; warns of those that stay outside.
fn embed_images(
    root: &mut Map<String, Value>,
    bin: &mut Vec<u8>,
    folder: &Path,
    warnings: &mut Vec<Warning>,
) -> io::Result<()> {
    let mut views = Vec::new();
    let first = root.get("bufferViews").and_then(Value::as_array).map_or(0, Vec::len);
    let images = root.get_mut("images").and_then(Value::as_array_mut);
    for (index, image) in images.into_iter().flatten().enumerate() {
        let Some(image) = image.as_object_mut() else { continue };
        let Some(uri) = image.get("uri").and_then(Value::as_str) else { continue };
        if uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:")) {
            continue;
        }
        let bytes = container::contained(uri, folder)
            .and_then(|path| fs::read(path).map_err(|error| error.to_string()));
        let kind = bytes.as_ref().ok().and_then(|bytes| image_type(bytes));
        let (Ok(bytes), Some(kind)) = (bytes, kind) else {
            warnings.push(Warning {
                place: Place::Pointer(format!("/images/{index}/uri")),
                message: format!(
                    "image '{uri}' is not part of the written file, which looks for it under this \
                     name"
                ),
            });
            continue;
        };
        image.remove("uri");
        image.insert("mimeType".into(), json!(kind));
        image.insert("bufferView".into(), json!(first + views.len()));
        views.push(append(bin, &bytes));
    }
    extend(root, "bufferViews", views)
}

fn image_type(bytes: &[u8]) -> Option<&'static str> {
    if bytes.starts_with(b"\x89PNG") {
        Some("image/png")
    } else if bytes.starts_with(b"\xff\xd8\xff") {
        Some("image/jpeg")
    } else if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
        Some("image/webp")
    } else if bytes.starts_with(b"\xabKTX 20\xbb") {
        Some("image/ktx2")
    } else {
        None
    }
}

/// Adds items to an array of the document, which may not exist yet.
fn extend(root: &mut Map<String, Value>, key: &str, items: Vec<Value>) -> io::Result<()> {
    if !items.is_empty() {
        let list = root.entry(key).or_insert_with(|| json!([]));
        list.as_array_mut().ok_or_else(broken)?.extend(items);
    }
    Ok(())
}

fn align(bytes: &mut Vec<u8>, fill: u8) {
    bytes.resize(bytes.len().next_multiple_of(ALIGNMENT), fill);
}

/// Appends data to the buffer; its view.
fn append(bin: &mut Vec<u8>, data: &[u8]) -> Value {
    align(bin, 0);
    let view = json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": data.len() });
    bin.extend_from_slice(data);
    view
}

/// Adds the animation: `tracks`, and what the file's first animation moves besides.
fn add_clip(
    document: &mut Value,
    bin: &mut Vec<u8>,
    source: &Source,
    tracks: &[NodeTrack],
) -> io::Result<()> {
    let root = document.as_object_mut().ok_or_else(broken)?;
    let mut clip = Clip {
        views: root.get("bufferViews").and_then(Value::as_array).cloned().unwrap_or_default(),
        accessors: root.get("accessors").and_then(Value::as_array).cloned().unwrap_or_default(),
        samplers: Vec::new(),
        channels: Vec::new(),
    };
    let nodes = root.get_mut("nodes").and_then(Value::as_array_mut);
    let nodes = nodes.map(Vec::as_mut_slice).unwrap_or_default();
    for track in tracks {
        let node = nodes.get_mut(track.node).and_then(Value::as_object_mut).ok_or_else(broken)?;
        let body = source.bodies.iter().find(|b| b.node == track.node).ok_or_else(broken)?;
        let rest = &body.local;
        let slack = POSITION_SLACK / if track.unit > 0.0 { track.unit } else { 1.0 };
        let moves = thin(
            &track.times,
            &track.translations,
            slack,
            |a, b, t| {
                let [a, b] = [a, b].map(|v| v.map(f64::from));
                math::add(math::scale(a, 1.0 - t), math::scale(b, t))
            },
            |a, b| math::length(math::sub(a, b.map(f64::from))),
        );
        let turns = thin(
            &track.times,
            &track.rotations,
            TURN_SLACK,
            |a, b, t| math::slerp(a.map(f64::from), b.map(f64::from), t),
            |a, b| angle(a, b.map(f64::from)),
        );
        let start = rest.translation.map(|x| x as f32);
        let held = |keys: &[usize]| keys.len() < 2;
        let still = held(&moves)
            && track.translations.first().is_none_or(|first| {
                math::length(math::sub(first.map(f64::from), start.map(f64::from))) <= slack
            });
        let unturned = held(&turns)
            && track
                .rotations
                .first()
                .is_none_or(|first| angle(first.map(f64::from), rest.rotation) <= TURN_SLACK);
        if still && unturned {
            continue;
        }
        if node.remove("matrix").is_some() {
            // An animated node is given by translation, rotation and scale.
            node.insert("translation".into(), json!(rest.translation));
            node.insert("rotation".into(), json!(rest.rotation));
            node.insert("scale".into(), json!(rest.scale));
        }
        if !still {
            clip.channel(bin, track, "translation", &moves, |i| track.translations[i].to_vec());
        }
        if !unturned {
            clip.channel(bin, track, "rotation", &turns, |i| track.rotations[i].to_vec());
        }
    }
    let written: BTreeSet<usize> = tracks.iter().map(|t| t.node).collect();
    clip.repeat(root.get("animations").and_then(|a| a.get(0)), &written);
    if !clip.channels.is_empty() {
        root.insert("bufferViews".into(), Value::Array(clip.views));
        root.insert("accessors".into(), Value::Array(clip.accessors));
        let animation =
            json!({ "name": CLIP, "samplers": clip.samplers, "channels": clip.channels });
        extend(root, "animations", vec![animation])?;
    }
    // A document without data has no buffer, and empty arrays are not allowed. Buffers that stay
    // outside count from 1, so that there must be a buffer before them.
    let buffers = root.get_mut("buffers").and_then(Value::as_array_mut).ok_or_else(broken)?;
    if bin.is_empty() && buffers.len() == 1 {
        root.remove("buffers");
        return Ok(());
    }
    bin.resize(bin.len().max(1), 0);
    align(bin, 0);
    if let Some(buffer) = buffers.first_mut() {
        *buffer = json!({ "byteLength": bin.len() });
    }
    Ok(())
}

/// The parts of the animation as they come together.
struct Clip {
    views: Vec<Value>,
    accessors: Vec<Value>,
    samplers: Vec<Value>,
    channels: Vec<Value>,
}

impl Clip {
    /// Adds the keys of one property of a node.
    fn channel(
        &mut self,
        bin: &mut Vec<u8>,
        track: &NodeTrack,
        path: &str,
        keys: &[usize],
        value: impl Fn(usize) -> Vec<f32>,
    ) {
        let times: Vec<f32> = keys.iter().map(|key| track.times[*key]).collect();
        let (first, last) = (times.first().copied(), times.last().copied());
        let kind = if path == "rotation" { "VEC4" } else { "VEC3" };
        let input = self.accessor(bin, times, keys.len(), "SCALAR");
        if let Some(input) = self.accessors[input].as_object_mut() {
            input.insert("min".into(), json!([first]));
            input.insert("max".into(), json!([last]));
        }
        let values = keys.iter().flat_map(|key| value(*key)).collect();
        let output = self.accessor(bin, values, keys.len(), kind);
        self.channels.push(json!({
            "sampler": self.samplers.len(),
            "target": { "node": track.node, "path": path },
        }));
        self.samplers.push(json!({ "input": input, "output": output, "interpolation": "LINEAR" }));
    }

    fn accessor(&mut self, bin: &mut Vec<u8>, data: Vec<f32>, count: usize, kind: &str) -> usize {
        let bytes: Vec<u8> = data.into_iter().flat_map(f32::to_le_bytes).collect();
        self.views.push(append(bin, &bytes));
        let view = self.views.len() - 1;
        self.accessors.push(json!({
            "bufferView": view, "componentType": 5126, "count": count, "type": kind,
        }));
        self.accessors.len() - 1
    }

    /// Takes over the channels of another animation, but for the nodes that have poses here.
    fn repeat(&mut self, animation: Option<&Value>, written: &BTreeSet<usize>) {
        let Some(animation) = animation else { return };
        let list = |key: &str| animation.get(key).and_then(Value::as_array);
        let (Some(channels), Some(samplers)) = (list("channels"), list("samplers")) else {
            return;
        };
        let whole = |value: &Value| value.as_f64().map(|x| x as usize);
        for channel in channels {
            let target = channel.get("target");
            let node = target.and_then(|t| t.get("node")).and_then(whole);
            let path = target.and_then(|t| t.get("path")).and_then(Value::as_str);
            let ours = node.is_some_and(|node| written.contains(&node))
                && matches!(path, Some("translation" | "rotation"));
            let sampler = channel.get("sampler").and_then(whole).and_then(|s| samplers.get(s));
            let (false, Some(sampler)) = (ours, sampler) else { continue };
            let mut channel = channel.clone();
            if let Some(channel) = channel.as_object_mut() {
                channel.insert("sampler".into(), json!(self.samplers.len()));
            }
            self.samplers.push(sampler.clone());
            self.channels.push(channel);
        }
    }
}

fn angle(a: Quat, b: Quat) -> f64 {
    let off = math::quat_mul(math::conjugate(a), b);
    2.0 * math::length([off[0], off[1], off[2]]).atan2(off[3].abs())
}

/// Keys that must stay so that what is between them is off by no more than `slack`; a single key
/// where all are the same.
fn thin<T: Copy, E>(
    times: &[f32],
    values: &[T],
    slack: f64,
    between: impl Fn(T, T, f64) -> E,
    distance: impl Fn(E, T) -> f64,
) -> Vec<usize> {
    let Some(end) = values.len().checked_sub(1) else { return Vec::new() };
    let good = |from: usize, to: usize| {
        let span = f64::from(times[to]) - f64::from(times[from]);
        (from + 1..to).all(|i| {
            let t = (f64::from(times[i]) - f64::from(times[from])) / span;
            distance(between(values[from], values[to], t), values[i]) <= slack
        })
    };
    if (0..=end).all(|i| distance(between(values[0], values[0], 0.0), values[i]) <= slack) {
        return vec![0];
    }
    let mut keys = vec![0];
    let mut from = 0;
    while from < end {
        // Doubling steps, then halving them, finds a long stretch without trying every length.
        let mut reach = 1;
        while from + reach * 2 <= end && good(from, from + reach * 2) {
            reach *= 2;
        }
        let mut step = reach;
        while step > 0 {
            if from + reach + step <= end && good(from, from + reach + step) {
                reach += step;
            }
            step /= 2;
        }
        from += reach;
        keys.push(from);
    }
    keys
}

fn write_glb(out: &mut impl Write, document: &Value, bin: &[u8]) -> io::Result<()> {
    let mut text = serde_json::to_vec(document)?;
    align(&mut text, b' ');
    let chunk = if bin.is_empty() { 0 } else { 8 + bin.len() };
    let total = 12 + 8 + text.len() + chunk;
    let length = |n: usize| {
        u32::try_from(n).map_err(|_| invalid("a GLB cannot hold more than 4 GiB".into()))
    };
    out.write_all(b"glTF")?;
    out.write_all(&2_u32.to_le_bytes())?;
    out.write_all(&length(total)?.to_le_bytes())?;
    out.write_all(&length(text.len())?.to_le_bytes())?;
    out.write_all(b"JSON")?;
    out.write_all(&text)?;
    if !bin.is_empty() {
        out.write_all(&length(bin.len())?.to_le_bytes())?;
        out.write_all(b"BIN\0")?;
        out.write_all(bin)?;
    }
    out.flush()
}
