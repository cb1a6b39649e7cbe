//! Writes a scene of Drystone's own format and its recording as one `.glb`.

use std::collections::HashMap;
use std::io;
use std::path::Path;

use serde_json::{Value, json};

use super::Recording;
use super::animation::{Target, append_clip, as_body};
use super::buffer::{GltfBuffer, Use, write_glb};
use super::color::{STATIC, color_of, linear};
use super::file::write_whole;
use super::mesh::{key_of, mesh_of, scale_of};
use super::pose::pose_2d;
use super::sampling::Sampling;
use crate::scene::{Body, Motion, Rotation, Scene, Shape};

/// Writes a scene with a mesh per shape and a node per body, and its recording as an animation.
///
/// Nodes have the names of their bodies, or `body 12` without a name. 2D scenes are 0.5 m thick and
/// lie in the plane z = 0.
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
    let roots = Nodes::new(scene.dimension).add(&mut gltf, scene);
    let targets: Vec<_> = (roots.iter().enumerate())
        .filter(|(body, _)| scene.bodies[*body].motion != Motion::Static)
        .map(|(body, node)| Target { node: *node, body, unit: 1.0, local: &as_body })
        .collect();
    append_clip(&mut gltf, "simulation", recording, &targets, options)?;
    let mut root = json!({});
    if let Some(name) = &scene.name {
        root["name"] = json!(name);
    }
    if !roots.is_empty() {
        root["nodes"] = json!(roots);
    }
    document["scene"] = json!(0);
    document["scenes"] = json!([root]);
    Ok((document, bytes))
}

/// Objects shared by nodes.
#[derive(Default)]
pub(super) struct Nodes {
    dimension: usize,
    /// Attributes and indices by shape.
    primitives: HashMap<Vec<u64>, Value>,
    /// Materials by color.
    materials: HashMap<u32, usize>,
    /// Meshes by shape and color.
    meshes: HashMap<(Vec<u64>, u32), usize>,
}

impl Nodes {
    pub(super) fn new(dimension: usize) -> Self {
        Self { dimension, ..Self::default() }
    }

    /// Adds all bodies and returns their nodes.
    fn add(mut self, gltf: &mut GltfBuffer<'_>, scene: &Scene) -> Vec<usize> {
        let bodies = scene.bodies.iter().enumerate();
        bodies.map(|(index, body)| self.add_body(gltf, index, body)).collect()
    }

    fn add_body(&mut self, gltf: &mut GltfBuffer<'_>, index: usize, body: &Body) -> usize {
        let name = body.name.clone().unwrap_or_else(|| format!("body {index}"));
        let mut node = json!({"name": name});
        place(&mut node, &body.position, body.rotation);
        let color = color_of(index, body.motion);
        match body.shapes.as_slice() {
            [] => {}
            [shape] if is_centered(shape) => self.dress(gltf, &mut node, shape, color),
            shapes => {
                let children: Vec<_> =
                    shapes.iter().map(|shape| self.add_shape(gltf, shape, color)).collect();
                node["children"] = json!(children);
            }
        }
        gltf.push("nodes", node)
    }

    /// Adds a shape at the origin of its parent.
    pub(super) fn add_centered(
        &mut self,
        gltf: &mut GltfBuffer<'_>,
        shape: &Shape,
        body: usize,
        motion: Motion,
    ) -> usize {
        let mut node = json!({});
        self.dress(gltf, &mut node, shape, color_of(body, motion));
        gltf.push("nodes", node)
    }

    fn add_shape(&mut self, gltf: &mut GltfBuffer<'_>, shape: &Shape, color: u32) -> usize {
        let mut node = json!({});
        place(&mut node, &shape.position, shape.rotation);
        self.dress(gltf, &mut node, shape, color);
        gltf.push("nodes", node)
    }

    /// Gives a node the mesh of a shape.
    fn dress(&mut self, gltf: &mut GltfBuffer<'_>, node: &mut Value, shape: &Shape, color: u32) {
        let scale = scale_of(&shape.kind, self.dimension);
        if scale != [1.0; 3] {
            node["scale"] = json!(scale);
        }
        let key = (key_of(&shape.kind), color);
        let mesh = match self.meshes.get(&key) {
            Some(mesh) => *mesh,
            None => {
                let mut primitive = self.primitive(gltf, shape, &key.0);
                primitive["material"] = json!(self.material(gltf, color));
                let mesh = gltf.push("meshes", json!({"primitives": [primitive]}));
                self.meshes.insert(key, mesh);
                mesh
            }
        };
        node["mesh"] = json!(mesh);
    }

    fn primitive(&mut self, gltf: &mut GltfBuffer<'_>, shape: &Shape, key: &[u64]) -> Value {
        if let Some(primitive) = self.primitives.get(key) {
            return primitive.clone();
        }
        let mesh = mesh_of(&shape.kind, self.dimension);
        let mut attributes = json!({});
        attributes["POSITION"] = json!(gltf.push_floats(&mesh.positions, Use::Vertices, true));
        if !mesh.normals.is_empty() {
            attributes["NORMAL"] = json!(gltf.push_floats(&mesh.normals, Use::Vertices, false));
        }
        if mesh.tones.contains(&true) {
            let colors: Vec<_> = mesh.tones.iter().map(|second| tone(*second)).collect();
            attributes["COLOR_0"] = json!(gltf.push_colors(&colors));
        }
        let indices = gltf.push_indices(&mesh.indices);
        let primitive = json!({"attributes": attributes, "indices": indices});
        self.primitives.insert(key.to_vec(), primitive.clone());
        primitive
    }

    fn material(&mut self, gltf: &mut GltfBuffer<'_>, color: u32) -> usize {
        if let Some(material) = self.materials.get(&color) {
            return *material;
        }
        let [r, g, b] = linear(color);
        let mut material = json!({
            "pbrMetallicRoughness": {
                "baseColorFactor": [r, g, b, 1.0],
                "metallicFactor": 0.0,
                "roughnessFactor": 0.7,
            },
        });
        if color == STATIC {
            material["doubleSided"] = json!(true);
        }
        let index = gltf.push("materials", material);
        self.materials.insert(color, index);
        index
    }
}

pub(super) fn is_centered(shape: &Shape) -> bool {
    let straight = match shape.rotation {
        Rotation::Angle(angle) => angle == 0.0,
        Rotation::Quaternion(q) => q == [0.0, 0.0, 0.0, 1.0],
    };
    straight && shape.position.iter().all(|x| *x == 0.0)
}

fn tone(second: bool) -> [u8; 4] {
    if second { [140, 140, 140, 255] } else { [255; 4] }
}

/// Sets translation and rotation, unless they are the defaults of a node.
pub(super) fn place(node: &mut Value, position: &[f64], rotation: Rotation) {
    let (position, rotation) = match (position, rotation) {
        ([x, y], Rotation::Angle(angle)) => {
            let pose = pose_2d([*x, *y], angle);
            (pose.position.to_vec(), pose.rotation)
        }
        (position, Rotation::Quaternion(q)) => (position.to_vec(), q),
        (position, Rotation::Angle(_)) => (position.to_vec(), [0.0, 0.0, 0.0, 1.0]),
    };
    if position.iter().any(|x| *x != 0.0) {
        node["translation"] = json!(position);
    }
    if rotation != [0.0, 0.0, 0.0, 1.0] {
        node["rotation"] = json!(rotation);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::format::read_toml;

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
