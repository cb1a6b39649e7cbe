//! Writes a scene of Drystone's own format as a glTF with `KHR_physics_rigid_bodies` and
//! `KHR_implicit_shapes`. Reading it gives the same bodies.
//!
//! Data that these extensions cannot express goes into `extras.drystone`, which other programs
//! ignore:
//!
//! - gravity, time step and settings of the scene;
//! - the density of a body, valid as long as nobody changes the mass written with it;
//! - points of hulls and meshes that single precision rounds, valid as long as nobody moves them;
//! - velocities and planes with the bits that a rotation there and back would round;
//! - the geometric mean as a rule that combines friction or restitution;
//! - the fact that a compound body is static;
//! - damping, forces, the fact that a body starts asleep, surface velocities, and resistance to rolling and spinning;
//! - accuracy and number of pieces of a convex decomposition;
//! - coordinates, friction and loads of joints that limits and drives of axes cannot express.

use std::collections::HashMap;
use std::io;
use std::path::Path;

use serde_json::{Map, Value, json};

use super::buffer::{GltfBuffer, Use, write_glb};
use super::joint::description;
use super::mesh::hull_triangles;
use super::nodes::{Nodes, add_scene, is_centered, place};
use crate::description::{
    Body, Combine, Filter, Material, Motion, Rotation, Scene, Shape, ShapeKind, SurfaceVelocity,
};
use crate::engine::Engine;
use crate::graph::math::{self, Quat};
use crate::graph::seen_from;
use crate::joint::Joint;
use crate::whole::write_whole;
use crate::write::own_words;

/// A scene as a glTF document with its buffer.
#[derive(Clone, Debug, PartialEq)]
pub struct Physics {
    document: Value,
    bytes: Vec<u8>,
}

impl Physics {
    /// Converts a scene; `masses` are the masses of its bodies. \[kg\]
    ///
    /// # Errors
    /// If the scene contains something that a glTF cannot express. The message says what to do
    /// about it.
    pub fn new(scene: &Scene, masses: &[f64], engine: &dyn Engine) -> Result<Self, String> {
        if scene.dimension != 3 {
            return Err("is a scene in 2D; a glTF is in 3D".to_owned());
        }
        let generator = concat!("Drystone ", env!("CARGO_PKG_VERSION"));
        let mut document = json!({
            "asset": {"version": "2.0", "generator": generator},
            "extensionsUsed": ["KHR_implicit_shapes", "KHR_physics_rigid_bodies"],
        });
        let mut bytes = Vec::new();
        let gltf = GltfBuffer { document: &mut document, bytes: &mut bytes, buffer: 0 };
        let looks = Nodes::new(3, engine);
        let mut writer = Writer {
            gltf,
            looks,
            scene,
            engine,
            tables: UniqueLists::default(),
            meshes: HashMap::new(),
        };
        let bodies = scene.bodies.iter().enumerate();
        let nodes: Vec<_> = bodies
            .map(|(index, body)| {
                let mass = masses.get(index).copied().unwrap_or(f64::INFINITY);
                writer.body(index, body, mass)
            })
            .collect::<Result<_, _>>()?;
        let mut roots = nodes.clone();
        scene.joints.iter().for_each(|joint| writer.joint(joint, &nodes, &mut roots));
        let tables = writer.tables;
        document["extensions"] = tables.extensions();
        add_scene(&mut document, scene, &roots);
        let own: Value = serde_json::from_str(&own_words(scene)).unwrap_or_default();
        if own != json!({}) {
            document["extras"] = json!({ "drystone": own });
        }
        Ok(Self { document, bytes })
    }

    /// Writes the document as `.glb`.
    ///
    /// # Errors
    /// Those of [`write_whole`].
    pub fn write_glb(&self, path: &Path) -> io::Result<()> {
        write_whole(path, |out| write_glb(out, &self.document, &self.bytes))
    }

    /// Writes the document as `.gltf`, with the buffer in base64.
    ///
    /// # Errors
    /// Those of [`write_whole`].
    pub fn write_gltf(&self, path: &Path) -> io::Result<()> {
        use base64::prelude::{BASE64_STANDARD, Engine as _};
        let mut document = self.document.clone();
        if let Some(buffer) = document.pointer_mut("/buffers/0") {
            let data = BASE64_STANDARD.encode(&self.bytes);
            buffer["uri"] = json!(format!("data:application/octet-stream;base64,{data}"));
        }
        write_whole(path, |out| {
            serde_json::to_writer_pretty(&mut *out, &document)?;
            out.write_all(b"\n")
        })
    }
}

/// Lists shared by bodies, each item once.
#[derive(Default)]
struct UniqueLists {
    shapes: UniqueList,
    materials: UniqueList,
    filters: UniqueList,
    joints: UniqueList,
}

#[derive(Default)]
struct UniqueList {
    items: Vec<Value>,
    /// Index of each item, by its text.
    places: HashMap<String, usize>,
}

impl UniqueList {
    fn place(&mut self, item: Value) -> usize {
        *self.places.entry(item.to_string()).or_insert_with(|| {
            self.items.push(item);
            self.items.len() - 1
        })
    }
}

impl UniqueLists {
    fn extensions(self) -> Value {
        let mut bodies = Map::new();
        for (key, table) in [
            ("physicsMaterials", self.materials),
            ("collisionFilters", self.filters),
            ("physicsJoints", self.joints),
        ] {
            // glTF does not allow empty lists.
            if !table.items.is_empty() {
                bodies.insert(key.to_owned(), json!(table.items));
            }
        }
        let mut extensions = json!({ "KHR_physics_rigid_bodies": bodies });
        if !self.shapes.items.is_empty() {
            extensions["KHR_implicit_shapes"] = json!({ "shapes": self.shapes.items });
        }
        extensions
    }
}

struct Writer<'a> {
    gltf: GltfBuffer<'a>,
    /// Nodes and meshes for drawing.
    looks: Nodes<'a>,
    scene: &'a Scene,
    engine: &'a dyn Engine,
    tables: UniqueLists,
    /// Collision meshes, by their triangles.
    meshes: HashMap<String, usize>,
}

impl Writer<'_> {
    /// Adds a body and returns the index of its node.
    fn body(&mut self, index: usize, body: &Body, mass: f64) -> Result<usize, String> {
        let wrong = |what: &str| Err(format!("{} {what}", self.scene.name_of(index)));
        if body.shapes.is_empty() {
            return wrong("has no shape, and a glTF has no bodies without");
        }
        if !body.track.times.is_empty() {
            return wrong(
                "follows a track, whose keys a glTF would round; bake the scene for an animation",
            );
        }
        if body.shapes.iter().any(|shape| shape.kind.vertex_track().is_some()) {
            return wrong("has a vertex_track, which a glTF cannot have; write .toml or .json");
        }
        // As the reader expects: colliders on the node of the body, or on nodes below it.
        let mut node = json!({});
        place(&mut node, &body.position, body.rotation);
        if let Some(name) = &body.name {
            node["name"] = json!(name);
        }
        let mut physics = json!({});
        let mut children = Vec::new();
        let alone = matches!(body.shapes.as_slice(), [shape] if is_centered(shape));
        for shape in &body.shapes {
            let (collider, turn) = self.collider(index, body, shape)?;
            let looks = self.looks.add_centered(&mut self.gltf, shape, index, body.motion);
            if alone && turn == math::NO_TURN {
                physics["collider"] = collider;
                children.push(looks);
                continue;
            }
            let mut child = json!({
                "children": [looks],
                "extensions": {"KHR_physics_rigid_bodies": {"collider": collider}},
            });
            let own = rotation(shape.rotation);
            if let ShapeKind::Halfspace { normal } = &shape.kind {
                let plane = json!({ "normal": normal, "rotation": own });
                child["extras"] = json!({ "drystone": { "plane": plane } });
            }
            let turn = math::quat_after(own, turn);
            place(&mut child, &shape.position, Rotation::Quaternion(turn));
            children.push(self.gltf.push("nodes", child));
        }
        node["children"] = json!(children);
        let mut own = Map::new();
        if body.motion != Motion::Static || physics.get("collider").is_none() {
            physics["motion"] = motion(body, mass, &mut own);
        }
        if let (Some(density), false) = (body.mass.density, body.motion == Motion::Dynamic) {
            own.insert("density".to_owned(), json!(density));
        }
        if let Some(motion) = &body.surface_velocity {
            own.insert("surfaceVelocity".to_owned(), surface(motion));
        }
        node["extensions"] = json!({ "KHR_physics_rigid_bodies": physics });
        if !own.is_empty() {
            node["extras"] = json!({ "drystone": own });
        }
        Ok(self.gltf.push("nodes", node))
    }

    /// Adds a joint between bodies with these nodes. Its frames are nodes below them, or roots.
    fn joint(&mut self, joint: &Joint, nodes: &[usize], roots: &mut Vec<usize>) {
        let mut connected = None;
        // The extension measures the connected node in the frame of the node with the joint.
        for (body, frame) in joint.bodies.into_iter().zip(&joint.frames) {
            let mut node = json!({});
            place(&mut node, &frame.position, frame.rotation);
            if let Some(other) = connected {
                let shared = self.tables.joints.place(description(joint));
                let mut own = json!({ "connectedNode": other, "joint": shared });
                if joint.collide {
                    own["enableCollision"] = json!(true);
                }
                if let Some(name) = &joint.name {
                    node["name"] = json!(name);
                }
                node["extensions"] = json!({ "KHR_physics_rigid_bodies": { "joint": own } });
            }
            let index = self.gltf.push("nodes", node);
            match body.and_then(|body| nodes.get(body)) {
                Some(node) => self.gltf.adopt(*node, index),
                None => roots.push(index),
            }
            connected = Some(index);
        }
    }

    /// Returns the collider of a shape, and an additional rotation for its node.
    fn collider(
        &mut self,
        index: usize,
        body: &Body,
        shape: &Shape,
    ) -> Result<(Value, Quat), String> {
        let turn = self.plane_turn(index, body, shape)?;
        let geometry = match implicit_shape(&shape.kind) {
            Some(implicit) => json!({ "shape": self.tables.shapes.place(implicit) }),
            None => self.mesh_geometry(index, &shape.kind)?,
        };
        let mut collider = json!({
            "geometry": geometry,
            "physicsMaterial": self.tables.materials.place(material(&shape.material)),
        });
        if shape.filter != Filter::default() {
            collider["collisionFilter"] = json!(self.tables.filters.place(filter(&shape.filter)));
        }
        if let Some(motion) = &shape.surface_velocity {
            let own = rotation(shape.rotation);
            let motion = if turn == math::NO_TURN {
                motion.clone()
            } else {
                seen_from(motion.clone(), own, math::quat_mul(own, turn))
            };
            collider["extras"] = json!({ "drystone": { "surfaceVelocity": surface(&motion) } });
        }
        Ok((collider, turn))
    }

    /// Returns the rotation that takes the y axis, the normal of planes in a glTF, to the normal of
    /// a half-space; none for other shapes. Half-spaces must be static.
    fn plane_turn(&self, index: usize, body: &Body, shape: &Shape) -> Result<Quat, String> {
        let ShapeKind::Halfspace { normal } = &shape.kind else { return Ok(math::NO_TURN) };
        if body.motion != Motion::Static {
            let name = self.scene.name_of(index);
            return Err(format!(
                "{name} moves a half-space, and endless planes of a glTF stand still"
            ));
        }
        let normal = <[f64; 3]>::try_from(normal.as_slice()).ok();
        let normal = normal.filter(|normal| *normal != [0.0, 1.0, 0.0]);
        Ok(normal.map_or(math::NO_TURN, math::from_up))
    }

    /// Returns the geometry of a hull or a mesh.
    fn mesh_geometry(&mut self, index: usize, kind: &ShapeKind) -> Result<Value, String> {
        let hull = matches!(kind, ShapeKind::ConvexHull { .. });
        let mut geometry = json!({ "mesh": self.mesh(index, kind)?, "convexHull": hull });
        let mut own = Map::new();
        if let ShapeKind::Trimesh { decomposition: Some(options), .. } = kind {
            own.insert("decomposition".to_owned(), json!(options));
        }
        let points: Vec<&[f64]> = match kind {
            ShapeKind::ConvexHull { points } => points.iter().map(Vec::as_slice).collect(),
            ShapeKind::Trimesh { vertices, .. } => {
                vertices.iter().map(<[f64; 3]>::as_slice).collect()
            }
            _ => Vec::new(),
        };
        if points.iter().copied().flatten().any(|x| f64::from(*x as f32) != *x) {
            own.insert("points".to_owned(), json!(points));
        }
        if !own.is_empty() {
            geometry["extras"] = json!({ "drystone": own });
        }
        Ok(geometry)
    }

    /// Adds the collision mesh of a hull or a mesh, with its points in their order, and returns its
    /// index.
    fn mesh(&mut self, index: usize, kind: &ShapeKind) -> Result<usize, String> {
        let single = |point: &[f64]| -> [f32; 3] {
            std::array::from_fn(|i| point.get(i).copied().unwrap_or(0.0) as f32)
        };
        let (points, triangles): (Vec<[f32; 3]>, Vec<u32>) = match kind {
            ShapeKind::Trimesh { vertices, triangles, .. } => {
                let points = vertices.iter().map(|vertex| single(vertex)).collect();
                (points, triangles.as_flattened().to_vec())
            }
            ShapeKind::ConvexHull { points } => {
                let points: Vec<_> = points.iter().map(|point| single(point)).collect();
                let triangles = hull_triangles(&points, self.engine).ok_or_else(|| {
                    format!("{} has a hull without triangles", self.scene.name_of(index))
                })?;
                (points, triangles)
            }
            _ => return Err(format!("{} has no mesh", self.scene.name_of(index))),
        };
        let key = format!("{points:?}{triangles:?}");
        if let Some(mesh) = self.meshes.get(&key) {
            return Ok(*mesh);
        }
        let positions = self.gltf.push_floats(&points, Use::Vertices, true);
        let indices = self.gltf.push_indices(&triangles);
        let primitive = json!({"attributes": {"POSITION": positions}, "indices": indices});
        let mesh = self.gltf.push("meshes", json!({ "primitives": [primitive] }));
        self.meshes.insert(key, mesh);
        Ok(mesh)
    }
}

fn surface(motion: &SurfaceVelocity) -> Value {
    json!({ "linear": motion.linear, "angular": motion.angular, "local": motion.local })
}

/// Returns the implicit shape of a kind; none for hulls and meshes.
fn implicit_shape(kind: &ShapeKind) -> Option<Value> {
    let implicit = |kind: &str, own: Value| Some(json!({ "type": kind, kind: own }));
    let round = |radius: f64, half_height: f64| {
        let height = 2.0 * half_height;
        json!({ "height": height, "radiusTop": radius, "radiusBottom": radius })
    };
    match kind {
        ShapeKind::Sphere { radius } => implicit("sphere", json!({ "radius": radius })),
        ShapeKind::Box { half_extents } => {
            let size: Vec<_> = half_extents.iter().map(|half| 2.0 * half).collect();
            implicit("box", json!({ "size": size }))
        }
        // The reader does not accept a capsule without height.
        ShapeKind::Capsule { radius, half_height } if *half_height > 0.0 => {
            implicit("capsule", round(*radius, *half_height))
        }
        ShapeKind::Capsule { radius, .. } => implicit("sphere", json!({ "radius": radius })),
        ShapeKind::Cylinder { radius, half_height } => {
            implicit("cylinder", round(*radius, *half_height))
        }
        ShapeKind::Halfspace { .. } => implicit("plane", json!({})),
        ShapeKind::ConvexHull { .. } | ShapeKind::Trimesh { .. } => None,
    }
}

fn rotation(rotation: Rotation) -> Quat {
    match rotation {
        Rotation::Quaternion(q) => q,
        Rotation::Angle(_) => math::NO_TURN,
    }
}

/// Returns the motion of a body; data that glTF cannot express is added to `own`.
fn motion(body: &Body, mass: f64, own: &mut Map<String, Value>) -> Value {
    let mut out = json!({});
    if body.motion != Motion::Dynamic {
        out["isKinematic"] = json!(true);
    }
    if body.motion == Motion::Static {
        own.insert("motion".to_owned(), json!("static"));
        return out;
    }
    // Zero stands for infinity.
    let finite = |x: f64| if x.is_finite() { x } else { 0.0 };
    let Motion::Dynamic = body.motion else {
        set_velocities(&mut out, body, own);
        return out;
    };
    match body.mass.mass {
        Some(mass) => out["mass"] = json!(finite(mass)),
        None if mass.is_finite() && mass > 0.0 => {
            out["mass"] = json!(mass);
            own.insert("mass".to_owned(), json!(mass));
            if let Some(density) = body.mass.density {
                own.insert("density".to_owned(), json!(density));
            }
        }
        None => {}
    }
    if let Some(center) = &body.mass.center {
        out["centerOfMass"] = json!(center);
    }
    if let Some(moments) = &body.mass.inertia {
        out["inertiaDiagonal"] = moments.iter().map(|moment| finite(*moment)).collect();
    }
    if let Some(turn) = body.mass.inertia_rotation {
        out["inertiaOrientation"] = json!(turn);
    }
    for (key, rate) in
        [("linearDamping", body.linear_damping), ("angularDamping", body.angular_damping)]
    {
        if rate != 0.0 {
            own.insert(key.to_owned(), json!(rate));
        }
    }
    if body.force.iter().any(|x| *x != 0.0) {
        own.insert("force".to_owned(), json!(body.force));
    }
    if body.start_asleep {
        own.insert("startAsleep".to_owned(), json!(true));
    }
    if body.gravity_factor != 1.0 {
        out["gravityFactor"] = json!(body.gravity_factor);
    }
    set_velocities(&mut out, body, own);
    out
}

/// Writes the velocities in the space of the node. Those that would not come back with the same
/// bits are added to `own`.
fn set_velocities(out: &mut Value, body: &Body, own: &mut Map<String, Value>) {
    let turn = rotation(body.rotation);
    for (key, velocity) in
        [("linearVelocity", &body.linear_velocity), ("angularVelocity", &body.angular_velocity)]
    {
        if let Ok(velocity) = <[f64; 3]>::try_from(velocity.as_slice())
            && velocity != [0.0; 3]
        {
            let stated = if turn == math::NO_TURN {
                velocity
            } else {
                math::turn(math::conjugate(turn), velocity)
            };
            out[key] = json!(stated);
            if math::turn(turn, stated) != velocity {
                own.insert(key.to_owned(), json!(velocity));
            }
        }
    }
}

fn material(material: &Material) -> Value {
    let combine = |combine: Combine| match combine {
        Combine::Minimum => "minimum",
        Combine::Maximum => "maximum",
        Combine::Multiply => "multiply",
        // The rule nearest to the geometric mean: equal for equal surfaces.
        Combine::Average | Combine::GeometricMean => "average",
    };
    let mut out = json!({
        "staticFriction": material.friction,
        "dynamicFriction": material.friction,
        "restitution": material.restitution,
        "frictionCombine": combine(material.friction_combine),
        "restitutionCombine": combine(material.restitution_combine),
    });
    let mut own = Map::new();
    for (key, of) in [
        ("frictionCombine", material.friction_combine),
        ("restitutionCombine", material.restitution_combine),
    ] {
        if of == Combine::GeometricMean {
            own.insert(key.to_owned(), json!("geometric_mean"));
        }
    }
    for (key, of) in [
        ("rollingResistance", material.rolling_resistance),
        ("spinningResistance", material.spinning_resistance),
    ] {
        if of != 0.0 {
            own.insert(key.to_owned(), json!(of));
        }
    }
    if !own.is_empty() {
        out["extras"] = json!({ "drystone": own });
    }
    out
}

/// Names each system by its number.
fn filter(filter: &Filter) -> Value {
    let names = |mask: u64| -> Vec<String> {
        (0..64).filter(|bit| mask & (1 << bit) != 0).map(|bit: u32| bit.to_string()).collect()
    };
    let mut out = json!({});
    if filter.systems != 0 {
        out["collisionSystems"] = json!(names(filter.systems));
    }
    if !filter.collides_with_unnamed {
        out["collideWithSystems"] = json!(names(filter.collides_with));
    } else if filter.collides_with != u64::MAX {
        out["notCollideWithSystems"] = json!(names(!filter.collides_with));
    }
    out
}
