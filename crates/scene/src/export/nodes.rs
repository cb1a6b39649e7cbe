//! Nodes, meshes and materials of a glTF in which a scene is drawn.

use std::collections::HashMap;

use serde_json::{Value, json};

use super::buffer::{GltfBuffer, Use};
use super::color::{STATIC, color_of, linear};
use super::mesh::{key_of, mesh_of, scale_of};
use crate::description::{Body, Motion, Rotation, Scene, Shape};
use crate::engine::Engine;
use crate::vertex_track::VertexTrack;

/// Makes these nodes the roots of the one scene of a document.
pub fn add_scene(document: &mut Value, scene: &Scene, roots: &[usize]) {
    let mut root = json!({});
    if let Some(name) = &scene.name {
        root["name"] = json!(name);
    }
    if !roots.is_empty() {
        root["nodes"] = json!(roots);
    }
    document["scene"] = json!(0);
    document["scenes"] = json!([root]);
}

/// Objects shared by nodes.
pub struct Nodes<'e> {
    dimension: usize,
    engine: &'e dyn Engine,
    /// Attributes and indices by shape.
    primitives: HashMap<Vec<u64>, Value>,
    /// Materials by color.
    materials: HashMap<u32, usize>,
    /// Meshes by shape and color.
    meshes: HashMap<(Vec<u64>, u32), usize>,
    /// Start and end of the animation. \[s\]
    span: [f64; 2],
    deforming: Vec<DeformingNode>,
}

/// Nodes of a scene.
pub struct DrawnScene {
    /// Node of each body.
    pub bodies: Vec<usize>,
    /// Nodes with meshes that deform.
    pub deforming: Vec<DeformingNode>,
}

/// A node whose mesh has a morph target for each time but the first. At a time the weight of its
/// target is 1, and between two times both weights change along straight lines.
pub struct DeformingNode {
    /// Index of the node.
    pub node: usize,
    /// The times. \[s\]
    pub times: Vec<f64>,
}

impl<'e> Nodes<'e> {
    /// Returns no objects, of a scene with this number of dimensions.
    pub fn new(dimension: usize, engine: &'e dyn Engine) -> Self {
        let (primitives, materials, meshes, span, deforming) = Default::default();
        Self { dimension, engine, primitives, materials, meshes, span, deforming }
    }

    /// Adds all bodies, for an animation in this `span` of time. \[s\]
    pub fn add(mut self, gltf: &mut GltfBuffer<'_>, scene: &Scene, span: [f64; 2]) -> DrawnScene {
        self.span = span;
        let bodies = scene.bodies.iter().enumerate();
        let bodies = bodies.map(|(index, body)| self.add_body(gltf, index, body)).collect();
        DrawnScene { bodies, deforming: self.deforming }
    }

    fn add_body(&mut self, gltf: &mut GltfBuffer<'_>, index: usize, body: &Body) -> usize {
        let name = body.name.clone().unwrap_or_else(|| format!("body {index}"));
        let mut node = json!({"name": name});
        place(&mut node, &body.position, body.rotation);
        let color = color_of(index, body.motion);
        match body.shapes.as_slice() {
            [] => {}
            [shape] if is_centered(shape) => self.set_mesh(gltf, &mut node, shape, color),
            shapes => {
                let children: Vec<_> =
                    shapes.iter().map(|shape| self.add_shape(gltf, shape, color)).collect();
                node["children"] = json!(children);
            }
        }
        let node = gltf.push("nodes", node);
        if let [shape] = body.shapes.as_slice()
            && is_centered(shape)
        {
            self.note(node, shape);
        }
        node
    }

    /// Notes a node if its mesh deforms.
    fn note(&mut self, node: usize, shape: &Shape) {
        if let Some(track) = shape.kind.vertex_track() {
            self.deforming.push(DeformingNode { node, times: self.of_file(track).times });
        }
    }

    /// Returns a track during the animation. Its times differ in single precision.
    fn of_file(&self, track: &VertexTrack) -> VertexTrack {
        let mut track = track.between(self.span);
        let mut last = f32::NEG_INFINITY;
        let ascends = |time: &f64| std::mem::replace(&mut last, *time as f32) < *time as f32;
        let kept: Vec<bool> = track.times.iter().map(ascends).collect();
        let mut keys = kept.iter();
        track.times.retain(|_| keys.next() == Some(&true));
        let mut keys = kept.iter();
        track.points.retain(|_| keys.next() == Some(&true));
        track
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
        self.set_mesh(gltf, &mut node, shape, color_of(body, motion));
        gltf.push("nodes", node)
    }

    fn add_shape(&mut self, gltf: &mut GltfBuffer<'_>, shape: &Shape, color: u32) -> usize {
        let mut node = json!({});
        place(&mut node, &shape.position, shape.rotation);
        self.set_mesh(gltf, &mut node, shape, color);
        let node = gltf.push("nodes", node);
        self.note(node, shape);
        node
    }

    /// Gives a node the mesh of a shape.
    fn set_mesh(&mut self, gltf: &mut GltfBuffer<'_>, node: &mut Value, shape: &Shape, color: u32) {
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
                let mut mesh = json!({"primitives": [primitive]});
                if let Some(targets) = primitive["targets"].as_array() {
                    mesh["weights"] = json!(vec![0.0; targets.len()]);
                }
                let mesh = gltf.push("meshes", mesh);
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
        let mut mesh = mesh_of(&shape.kind, self.dimension, self.engine);
        let mut targets = Vec::new();
        if let Some(track) = shape.kind.vertex_track() {
            let mut keys = self.of_file(track).points.into_iter();
            let single = |points: Vec<[f64; 3]>| -> Vec<[f32; 3]> {
                points.into_iter().map(|point| point.map(|x| x as f32)).collect()
            };
            mesh.positions = keys.next().map(single).unwrap_or_default();
            for moved in keys.map(single) {
                let moved = moved.iter().zip(&mesh.positions);
                let moved: Vec<[f32; 3]> =
                    moved.map(|(to, from)| std::array::from_fn(|i| to[i] - from[i])).collect();
                targets.push(json!({"POSITION": gltf.push_floats(&moved, Use::Vertices, true)}));
            }
        }
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
        let mut primitive = json!({"attributes": attributes, "indices": indices});
        if !targets.is_empty() {
            primitive["targets"] = json!(targets);
        }
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
    let position = match position {
        [x, y] => &[*x, *y, 0.0],
        position => position,
    };
    let rotation = rotation.quaternion();
    if position.iter().any(|x| *x != 0.0) {
        node["translation"] = json!(position);
    }
    if rotation != [0.0, 0.0, 0.0, 1.0] {
        node["rotation"] = json!(rotation);
    }
}
