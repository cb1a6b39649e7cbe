//! Writes a scene of Drystone's own format and its recording as one `.glb`.

use std::io;
use std::path::Path;

use serde_json::{Value, json};

use super::Recording;
use super::animation::{Target, append_clip, as_body};
use super::sampling::{Sampling, sample_times};
use crate::engine::Drystone;
use drystone_scene::export::{GltfBuffer, Nodes, add_scene, write_glb};
use drystone_scene::{Motion, Scene, write_whole};

/// Writes a scene with a mesh per shape and a node per body, and its recording as an animation.
///
/// Nodes have the names of their bodies, or `body 12` without a name. 2D scenes are 0.5 m thick and
/// lie in the plane z = 0. Meshes that deform have a morph target for each time of their track.
///
/// # Errors
/// If the recording has other bodies or is not finite, or the file cannot be written. An existing
/// file then stays unchanged.
pub fn write(
    path: &Path,
    scene: &Scene,
    recording: &Recording,
    options: &Sampling,
) -> io::Result<()> {
    let (document, bytes) = build(scene, recording, options)?;
    write_whole(path, |out| write_glb(out, &document, &bytes))
}

fn build(scene: &Scene, recording: &Recording, options: &Sampling) -> io::Result<(Value, Vec<u8>)> {
    recording.must_have(scene.bodies.len(), scene.dimension)?;
    let generator = concat!("Drystone ", env!("CARGO_PKG_VERSION"));
    let mut document = json!({"asset": {"version": "2.0", "generator": generator}});
    let mut bytes = Vec::new();
    let mut gltf = GltfBuffer { document: &mut document, bytes: &mut bytes, buffer: 0 };
    let times = sample_times(recording, options);
    let span = [times.first(), times.last()].map(|time| time.copied().unwrap_or_default());
    let drawn = Nodes::new(scene.dimension, &Drystone).add(&mut gltf, scene, span);
    let targets: Vec<_> = (drawn.bodies.iter().enumerate())
        .filter(|(body, _)| scene.bodies[*body].motion != Motion::Static)
        .map(|(body, node)| Target { node: *node, body, unit: 1.0, local: &as_body })
        .collect();
    let moving = (targets.as_slice(), drawn.deforming.as_slice());
    append_clip(&mut gltf, "simulation", recording, moving, options)?;
    add_scene(&mut document, scene, &drawn.bodies);
    Ok((document, bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use drystone_scene::Rotation;
    use drystone_scene::format::read_toml;

    fn still(scene: &Scene, frames: usize) -> Recording {
        let mut poses = Vec::new();
        for body in &scene.bodies {
            poses.extend(body.position.iter().map(|x| *x as f32));
            match body.rotation {
                Rotation::Angle(angle) => poses.push(angle as f32),
                Rotation::Quaternion(q) => poses.extend(q.map(|x| x as f32)),
            }
        }
        let (dimension, bodies) = (scene.dimension, scene.bodies.len());
        Recording {
            dimension,
            bodies,
            frame_time: 1.0 / 60.0,
            start: 0,
            poses: poses.repeat(frames),
        }
    }

    fn scene(text: &str) -> Scene {
        read_toml(Path::new("test.toml"), text).unwrap().scene
    }

    #[test]
    fn spheres_of_all_sizes_share_one_mesh() {
        let body = |r: f64| format!("{{shapes = [{{type = \"sphere\", radius = {r}}}]}}");
        let list: Vec<_> = (1..=20).map(|i| body(f64::from(i))).collect();
        let scene = scene(&format!("bodies = [{}]", list.join(",")));
        let (document, _) = build(&scene, &still(&scene, 2), &Sampling::default()).unwrap();
        assert_eq!(document["accessors"].as_array().unwrap().len(), 4);
        assert_eq!(document["meshes"].as_array().unwrap().len(), 10);
        assert_eq!(document["nodes"][19]["scale"], json!([20.0, 20.0, 20.0]));
        assert_eq!(document["nodes"][19]["name"], "body 19");
        assert_eq!(document.get("animations"), None);
    }

    #[test]
    fn an_empty_scene_has_no_empty_lists() {
        let scene = scene("");
        let (document, bytes) = build(&scene, &still(&scene, 0), &Sampling::default()).unwrap();
        assert_eq!(document["scenes"], json!([{}]));
        assert!(bytes.is_empty() && document.get("buffers").is_none());
    }

    #[test]
    fn a_recording_of_another_scene_is_refused() {
        let (one, none) = (scene("bodies = [{motion = \"static\"}]"), scene(""));
        let path = Path::new("never.glb");
        assert!(write(path, &one, &still(&none, 1), &Sampling::default()).is_err());
    }
}
