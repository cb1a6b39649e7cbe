//! Writes the glTF of a scene again, with the recording as an animation.

#![deny(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeSet;
use std::io::{self, Write};
use std::path::Path;

use serde_json::{Map, Value, json};

use super::Recording;
use super::animation::{Target, append_clip};
use super::pose::{Pose, pose_at};
use super::sampling::Sampling;
use drystone_scene::export::{GltfBuffer, Use, write_glb};
use drystone_scene::gltf::{BAKED, BodyNode, Source, contained};
use drystone_scene::graph::math::{self, Quat};
use drystone_scene::graph::transform::{Affine, Trs};
use drystone_scene::{Place, Warning, file};

/// Alignment of buffers, which suits every component type. \[byte\]
const ALIGNMENT: usize = 8;
/// Largest embedded image. \[byte\]
const LARGEST: u64 = 1 << 30;

/// Writes `recording` into the glTF that its scene was read from, as one `.glb`.
///
/// The file that `source` was read from stays unchanged. Static bodies get no keys. Neither do
/// bodies that an animation of the file moves, since the new clip repeats that animation. Returns
/// warnings about parts of the document that still need other files.
///
/// # Errors
///
/// If `recording` does not belong to `source` or is not finite, or the file cannot be written.
pub fn write(
    out: &mut dyn Write,
    source: &Source,
    recording: &Recording,
    options: &Sampling,
) -> io::Result<Vec<Warning>> {
    let (mut document, mut bin, warnings) = merge(source)?;
    add_clip(&mut document, &mut bin, source, recording, options)?;
    finish(&mut document, &mut bin)?;
    write_glb(out, &document, &bin)?;
    out.flush()?;
    Ok(warnings)
}

/// Adds the animation: the recording, and the other channels of the file's first animation.
fn add_clip(
    document: &mut Value,
    bin: &mut Vec<u8>,
    source: &Source,
    recording: &Recording,
    options: &Sampling,
) -> io::Result<()> {
    recording.must_have(source.bodies.len(), 3)?;
    let written: Vec<usize> =
        (0..source.bodies.len()).filter(|body| source.bodies[*body].is_written()).collect();
    let locals: Vec<_> =
        written.iter().map(|body| move |time, _| local(source, recording, *body, time)).collect();
    let mut targets = Vec::with_capacity(written.len());
    for (body, local) in written.iter().zip(&locals) {
        let node = &source.bodies[*body];
        let unit = unit(source, recording, *body)?;
        separate_matrix(document, node)?;
        targets.push(Target { node: node.node, body: *body, unit, local });
    }
    let mut gltf = GltfBuffer { document, bytes: bin, buffer: 0 };
    let clip = append_clip(&mut gltf, BAKED, recording, (&targets, &[]), options)?;
    let nodes = targets.iter().map(|target| target.node).collect();
    if repeat(&mut gltf, clip, &nodes) {
        play_first(gltf.document);
    }
    Ok(())
}

/// Moves the last animation to the front, since viewers and importers play the first. Other
/// animations follow. Leaves the order if an extension names animations by their indices.
fn play_first(document: &mut Value) {
    let uses = document.get("extensionsUsed").and_then(Value::as_array);
    let mut names = uses.into_iter().flatten().filter_map(Value::as_str);
    if names.any(|name| name == "KHR_interactivity") {
        return;
    }
    if let Some(animations) = document.get_mut("animations").and_then(Value::as_array_mut) {
        animations.rotate_right(1);
    }
}

/// Returns the length of a unit of the node's translation in the world. \[m\]
fn unit(source: &Source, recording: &Recording, body: usize) -> io::Result<f64> {
    if recording.frames() == 0 {
        return Ok(1.0);
    }
    let (above, _) = above(source, recording, body, 0.0);
    if math::inverse(above.linear).is_none() {
        let node = source.bodies[body].node;
        return Err(invalid(format!("a scale of 0 above node {node} hides its motion")));
    }
    Ok(above.linear.map(math::length).into_iter().fold(0.0, f64::max))
}

/// Returns the pose of a body's node relative to its parent at a time \[s\].
fn local(source: &Source, recording: &Recording, body: usize, time: f64) -> Pose {
    let (above, above_turn) = above(source, recording, body, time);
    place(&above, above_turn, &pose_at(recording, body, time))
}

fn place(above: &Affine, above_turn: Quat, pose: &Pose) -> Pose {
    // A singular map gives no position: the clip refuses the NaN.
    let inverse = math::inverse(above.linear).unwrap_or([[f64::NAN; 3]; 3]);
    Pose {
        position: math::apply(inverse, math::sub(pose.position, above.shift)),
        rotation: math::quat_mul(math::conjugate(above_turn), pose.rotation),
    }
}

/// Returns the transform from the parent of a body's node to the world, and its rotation.
fn above(source: &Source, recording: &Recording, body: usize, time: f64) -> (Affine, Quat) {
    let mut carriers = Vec::new();
    let mut next = source.bodies[body].carrier;
    while let Some(carrier) = next {
        carriers.push(carrier);
        next = source.bodies[carrier].carrier;
    }
    let mut world = (Affine::IDENTITY, math::NO_TURN);
    let parent = |(world, turn): (Affine, Quat), body: &BodyNode| {
        (world.after(&body.parent), math::quat_mul(turn, body.parent_turn))
    };
    for carrier in carriers.into_iter().rev() {
        let node = &source.bodies[carrier];
        let (above, above_turn) = parent(world, node);
        let pose = pose_at(recording, carrier, time);
        let space = if node.is_written() {
            // The pose that the clip gives the node. Under a sheared ancestor, it differs from the
            // body's pose.
            let Pose { position, rotation } = place(&above, above_turn, &pose);
            let scale = node.local.scale;
            above.after(&Trs { translation: position, rotation, scale }.affine())
        } else {
            let linear = math::mul(math::rotation(pose.rotation), node.rest);
            Affine { linear, shift: pose.position }
        };
        world = (space, pose.rotation);
    }
    parent(world, &source.bodies[body])
}

/// Replaces the matrix of a node by translation, rotation and scale, as required for an animated
/// node.
fn separate_matrix(document: &mut Value, body: &BodyNode) -> io::Result<()> {
    let node = document.get_mut("nodes").and_then(|nodes| nodes.get_mut(body.node));
    let node = node.and_then(Value::as_object_mut).ok_or_else(broken)?;
    if node.remove("matrix").is_some() {
        node.insert("translation".into(), json!(body.local.translation));
        node.insert("rotation".into(), json!(body.local.rotation));
        node.insert("scale".into(), json!(body.local.scale));
    }
    Ok(())
}

/// Copies the channels of the file's first animation to the clip, except those of nodes whose pose
/// the clip already sets. Returns true if there is a clip then.
fn repeat(gltf: &mut GltfBuffer<'_>, clip: Option<usize>, written: &BTreeSet<usize>) -> bool {
    let animations = gltf.document.get("animations").and_then(Value::as_array);
    let is_theirs =
        |animation: &&Value| animation.get("name").and_then(Value::as_str) != Some(BAKED);
    let first = animations.and_then(|all| all.iter().find(is_theirs)).cloned();
    let Some(first) = first else { return clip.is_some() };
    let own = clip.and_then(|clip| gltf.document["animations"].get(clip));
    let list = |of: Option<&Value>, key: &str| {
        of.and_then(|of| of.get(key)).and_then(Value::as_array).cloned().unwrap_or_default()
    };
    let (mut channels, mut samplers) = (list(own, "channels"), list(own, "samplers"));
    let (theirs, sources) = (list(Some(&first), "channels"), list(Some(&first), "samplers"));
    let whole = |value: &Value| value.as_f64().map(|x| x as usize);
    for mut channel in theirs {
        let target = channel.get("target");
        let node = target.and_then(|t| t.get("node")).and_then(whole);
        let path = target.and_then(|t| t.get("path")).and_then(Value::as_str);
        let ours = node.is_some_and(|node| written.contains(&node))
            && matches!(path, Some("translation" | "rotation"));
        let sampler = channel.get("sampler").and_then(whole).and_then(|s| sources.get(s));
        let (false, Some(sampler)) = (ours, sampler) else { continue };
        channel["sampler"] = json!(samplers.len());
        samplers.push(sampler.clone());
        channels.push(channel);
    }
    if channels.is_empty() {
        return false;
    }
    let animation = json!({ "name": BAKED, "samplers": samplers, "channels": channels });
    match clip {
        Some(clip) => gltf.document["animations"][clip] = animation,
        None => _ = gltf.push("animations", animation),
    }
    true
}

/// Sets the length of the buffer, or removes it: a document without data has no buffer.
fn finish(document: &mut Value, bin: &mut Vec<u8>) -> io::Result<()> {
    let root = document.as_object_mut().ok_or_else(broken)?;
    let buffers = root.get_mut("buffers").and_then(Value::as_array_mut).ok_or_else(broken)?;
    if bin.is_empty() && buffers.len() == 1 {
        root.remove("buffers");
        return Ok(());
    }
    // External buffers have indices from 1, so that there must be a buffer 0.
    bin.resize(bin.len().max(1), 0);
    if let Some(buffer) = buffers.first_mut() {
        *buffer = json!({ "byteLength": bin.len() });
    }
    Ok(())
}

fn invalid(message: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, message)
}

fn broken() -> io::Error {
    invalid("the glTF document does not have the form it was read with".into())
}

/// Returns the document with its data in one buffer, the bytes of that buffer, and warnings.
fn merge(source: &Source) -> io::Result<(Value, Vec<u8>, Vec<Warning>)> {
    let mut document = source.document.clone();
    let mut bin = Vec::new();
    let mut warnings = Vec::new();
    let root = document.as_object_mut().ok_or_else(broken)?;

    // Offset of each buffer in buffer 0, or its new index if it stays external.
    let mut moved = Vec::new();
    let mut kept = vec![json!({ "byteLength": 0 })];
    let old = root.get("buffers").and_then(Value::as_array).cloned().unwrap_or_default();
    for (buffer, bytes) in old.into_iter().zip(&source.buffers) {
        match bytes {
            Some(bytes) => {
                bin.resize(bin.len().next_multiple_of(ALIGNMENT), 0);
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
            // Compressed copies of a view refer to their buffer in the same way.
            if extension.get("buffer").is_some() {
                move_view(extension, &moved).ok_or_else(broken)?;
            }
        }
    }
    root.insert("buffers".into(), Value::Array(kept));
    embed_images(&mut document, &mut bin, &source.folder, &mut warnings)?;
    Ok((document, bin, warnings))
}

fn move_view(view: &mut Value, moved: &[(usize, usize)]) -> Option<()> {
    // Whole numbers may be written as floats.
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

/// Moves images from files beside the document into the buffer; warns of those that stay external.
fn embed_images(
    document: &mut Value,
    bin: &mut Vec<u8>,
    folder: &Path,
    warnings: &mut Vec<Warning>,
) -> io::Result<()> {
    let Some(mut images) = document.get_mut("images").map(Value::take) else { return Ok(()) };
    for (index, image) in images.as_array_mut().into_iter().flatten().enumerate() {
        let Some(image) = image.as_object_mut() else { continue };
        let Some(uri) = image.get("uri").and_then(Value::as_str) else { continue };
        if uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:")) {
            continue;
        }
        let bytes = contained(uri, folder)
            .and_then(|path| file::read_bytes(&path, LARGEST).map_err(|error| error.to_string()))
            .and_then(|bytes| bytes.ok_or_else(|| "it is too large".to_owned()));
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
        let mut gltf = GltfBuffer { document, bytes: bin, buffer: 0 };
        image.insert("bufferView".into(), json!(gltf.push_view(&bytes, Use::Data)));
    }
    document["images"] = images;
    Ok(())
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
