//! Builds bodies from the motions and colliders of the nodes.

use std::collections::{BTreeMap, BTreeSet};

use super::super::description::{
    Body, Filter, Mass, Material, Motion, Rotation, Shape, ShapeKind, SurfaceVelocity, Track,
};
use super::super::error::{SceneError, Warning};
use super::super::graph::implicit::{self, Implicit, Placed};
use super::super::graph::math::{self, Quat, Vec3};
use super::super::graph::transform::Affine;
use super::super::graph::triangles::Triangles;
use super::super::graph::{FAR, FAST, HEAVY, LIGHT, seen_from, unique};
use super::animation::{self, Animation};
use super::json::Cursor;
use super::meshes::Meshes;
use super::nodes::{self, Node};
use super::shared_joints;
use super::source::BodyNode;
use super::tables::{self, Dialect, SharedObjects};
use super::unknown;
use crate::solid_mesh::DecompositionOptions;

/// Largest magnitude of the factor on gravity.
const MOST_GRAVITY: f64 = 1e6;
/// Largest coordinate of a force. \[N\]
const MOST_FORCE: f64 = 1e20;
/// Largest difference of an exact value from that of the extension, relative to it. \[1\]
const SLACK: f64 = 1e-6;
/// Largest damping rate. \[1/s\]
const STRONGEST: f64 = 1e6;

/// Motion of a node.
struct NodeMotion {
    motion: Motion,
    mass: Mass,
    linear: NodeVelocity,
    angular: NodeVelocity,
    gravity: f64,
    /// Linear and angular damping rates. \[1/s\]
    damping: [f64; 2],
    /// Constant force. \[N\]
    force: Vec3,
    start_asleep: bool,
}

/// Velocity in the space of a node, and in that of the scene as the own format states it.
struct NodeVelocity {
    stated: Vec3,
    exact: Option<Vec3>,
}

impl NodeVelocity {
    /// Returns the velocity in the space of the scene, where the rotation of the node is `turn`.
    /// The exact one counts unless somebody has changed the other, or the rotation.
    fn in_scene(&self, turn: Quat) -> Vec3 {
        if self.stated == [0.0; 3] {
            return self.stated;
        }
        let same = |exact: &Vec3| {
            let off = math::sub(math::turn(math::conjugate(turn), *exact), self.stated);
            math::length(off) <= SLACK * math::length(self.stated)
        };
        self.exact.filter(same).unwrap_or_else(|| math::turn(turn, self.stated))
    }
}

/// Source of a collider's geometry.
#[derive(Clone, Copy)]
enum Geometry {
    Shape(usize),
    Node(usize),
    Mesh(usize),
}

struct Collider<'a> {
    at: Cursor<'a>,
    geometry: Geometry,
    convex: bool,
    decomposition: Option<DecompositionOptions>,
    material: Material,
    runs: Option<SurfaceVelocity>,
    filter: Filter,
}

/// Physics properties of the nodes.
struct Properties<'a> {
    moving: BTreeMap<usize, NodeMotion>,
    colliders: BTreeMap<usize, Collider<'a>>,
}

/// Data that the bodies are built from.
pub(super) struct GltfBodies<'a> {
    pub(super) nodes: &'a [Node<'a>],
    pub(super) meshes: &'a Meshes<'a>,
    pub(super) tables: &'a SharedObjects,
    pub(super) animation: &'a Animation,
    pub(super) dialect: Dialect,
}

impl GltfBodies<'_> {
    fn warn(&self, node: usize, what: impl std::fmt::Display, warnings: &mut Vec<Warning>) {
        if let Some(n) = self.nodes.get(node) {
            let message = format!("{}: {what}", n.label(node));
            warnings.push(Warning { place: n.cursor.place(), message });
        }
    }

    /// Returns the bodies of the scene and the nodes that they move.
    pub(super) fn bodies(
        &self,
        warnings: &mut Vec<Warning>,
    ) -> Result<(Vec<Body>, Vec<BodyNode>), SceneError> {
        let properties = self.properties(warnings)?;
        // Colliders by the node that carries them: the nearest one above with a motion, else the
        // collider's own node.
        let mut carried: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (node, _) in properties.moving.iter().filter(|(node, _)| self.present(**node)) {
            carried.insert(*node, Vec::new());
        }
        for node in properties.colliders.keys().filter(|node| self.present(**node)) {
            let mut up = Some(*node);
            while let Some(above) = up.filter(|above| !properties.moving.contains_key(above)) {
                up = self.nodes.get(above).and_then(|n| n.parent);
            }
            carried.entry(up.unwrap_or(*node)).or_default().push(*node);
        }
        let mut names = BTreeSet::new();
        let mut bodies = Vec::new();
        let mut body_nodes = Vec::new();
        for (node, colliders) in &carried {
            if let Some((body, body_node)) =
                self.body(*node, colliders, &properties, &mut names, warnings)?
            {
                bodies.push(body);
                body_nodes.push(body_node);
            }
        }
        self.link(&mut body_nodes);
        Ok((bodies, body_nodes))
    }

    fn present(&self, node: usize) -> bool {
        self.nodes.get(node).is_some_and(|n| n.present)
    }

    /// Sets the depth, the carrier (the nearest moving body above) and the parent transform of each
    /// body.
    fn link(&self, bodies: &mut [BodyNode]) {
        let moving: BTreeMap<usize, usize> = bodies
            .iter()
            .enumerate()
            .filter(|(_, body)| body.moves)
            .map(|(index, body)| (body.node, index))
            .collect();
        for body in bodies.iter_mut() {
            let mut above = self.nodes.get(body.node).and_then(|n| n.parent);
            while let Some(node) = above.and_then(|i| self.nodes.get(i)) {
                body.depth = body.depth.saturating_add(1);
                if body.carrier.is_none() {
                    body.carrier = above.and_then(|i| moving.get(&i)).copied();
                    if body.carrier.is_none() {
                        body.parent = node.matrix.after(&body.parent);
                        body.parent_turn = math::quat_mul(node.local.rotation, body.parent_turn);
                    }
                }
                above = node.parent;
            }
        }
    }

    fn body(
        &self,
        index: usize,
        colliders: &[usize],
        properties: &Properties<'_>,
        names: &mut BTreeSet<String>,
        warnings: &mut Vec<Warning>,
    ) -> Result<Option<(Body, BodyNode)>, SceneError> {
        let Some(node) = self.nodes.get(index) else { return Ok(None) };
        let moving = properties.moving.get(&index);
        let chain = animation::chain(self.nodes, index);
        let driven = chain.iter().any(|i| self.animation.moves(*i));
        let motion = match moving {
            _ if driven => Motion::Kinematic,
            Some(moving) => moving.motion,
            None => Motion::Static,
        };
        if driven && moving.is_some_and(|m| m.motion == Motion::Dynamic) {
            let what = "an animation of the file moves it: contacts do not";
            self.warn(index, what, warnings);
        }
        if driven && chain.iter().any(|i| *i != index && properties.moving.contains_key(i)) {
            let what = "its animation plays as if the body above it stayed where it starts";
            self.warn(index, what, warnings);
        }

        let shapes = self.shapes(index, node, colliders, properties, motion, warnings)?;
        if shapes.is_empty() {
            if moving.is_some() {
                let what = "it has a motion and no collider that acts: it is not simulated";
                self.warn(index, what, warnings);
            }
            return Ok(None);
        }

        let (turn, rest) = (node.turn, node.scale());
        let track =
            if driven { self.animation.track(self.nodes, index)? } else { Track::default() };
        let (position, rotation) = start(node, &track);
        if let Some(far) = track.positions.iter().flatten().find(|x| x.abs() > FAR) {
            return Err(node.cursor.fault(
                format!("animated position {far} of {}", node.label(index)),
                format!("coordinates up to {FAR:e} are accepted"),
            ));
        }
        let own = node.cursor.own()?;
        let mut body = Body {
            name: node
                .name
                .filter(|n| !n.is_empty())
                .map(|n| unique(n, &format!("node {index}"), names)),
            motion,
            position: position.into(),
            rotation: Rotation::Quaternion(rotation),
            linear_velocity: vec![0.0; 3],
            angular_velocity: vec![0.0; 3],
            mass: Mass::default(),
            gravity_factor: 1.0,
            linear_damping: 0.0,
            angular_damping: 0.0,
            force: vec![0.0; 3],
            start_asleep: false,
            surface_velocity: surface(own.as_ref())?,
            shapes,
            track,
        };
        if let Some(moving) = moving {
            body.mass = moving.mass.clone();
            if let Some(center) = &mut body.mass.center
                && let Ok(c) = Vec3::try_from(center.as_slice())
            {
                *center = math::apply(rest, c).into();
            }
            body.gravity_factor = moving.gravity;
            [body.linear_damping, body.angular_damping] = moving.damping;
            body.force = moving.force.into();
            body.start_asleep = moving.start_asleep && motion == Motion::Dynamic;
            if !driven && motion != Motion::Static {
                body.linear_velocity = moving.linear.in_scene(turn).into();
                body.angular_velocity = moving.angular.in_scene(turn).into();
            }
        }
        if motion != Motion::Dynamic
            && let Some(density) = own.map(|own| own.get("density")).transpose()?.flatten()
        {
            body.mass.density = Some(density.within(LIGHT, HEAVY)?);
        }
        let body_node = BodyNode {
            node: index,
            moves: motion != Motion::Static,
            driven,
            depth: 0,
            carrier: None,
            parent: Affine::IDENTITY,
            parent_turn: math::NO_TURN,
            local: node.local,
            rest,
            scales: colliders
                .iter()
                .filter_map(|at| self.nodes.get(*at))
                .map(Node::scale)
                .collect(),
        };
        Ok(Some((body, body_node)))
    }

    /// Returns the shapes of a body from those of its colliders that act.
    fn shapes(
        &self,
        index: usize,
        node: &Node<'_>,
        colliders: &[usize],
        properties: &Properties<'_>,
        motion: Motion,
        warnings: &mut Vec<Warning>,
    ) -> Result<Vec<Shape>, SceneError> {
        let mut shapes = Vec::new();
        for at in colliders {
            let mut between = Some(*at);
            while let Some(step) = between.filter(|step| *step != index) {
                if self.animation.moves(step) {
                    let what = "its animation inside of a body is not simulated: its collider \
                                keeps its place on the body";
                    self.warn(step, what, warnings);
                }
                between = self.nodes.get(step).and_then(|n| n.parent);
            }
            if let (Some(collider), Some(part)) =
                (properties.colliders.get(at), self.nodes.get(*at))
            {
                let place = self.seen_from((index, node), *at);
                shapes.extend(self.shape(*at, part, collider, place, motion, warnings)?);
            }
        }
        Ok(shapes)
    }

    /// Returns position and rotation of a node below a body, in the frame of the body.
    fn seen_from(&self, (top, body): (usize, &Node<'_>), index: usize) -> (Vec3, Quat) {
        let (mut place, mut turn) = (Affine::IDENTITY, math::NO_TURN);
        let mut at = index;
        // Composes local transforms only, so that values in the file come out unrounded.
        while let Some(node) = self.nodes.get(at).filter(|_| at != top) {
            place = node.matrix.after(&place);
            turn = math::quat_after(node.local.rotation, turn);
            let Some(parent) = node.parent else { break };
            at = parent;
        }
        let turn = math::quat_as_written(turn).unwrap_or(math::NO_TURN);
        (math::apply(body.scale(), place.shift), turn)
    }

    /// Returns the shape of a collider in the frame of its body; `None` if it does not act.
    fn shape(
        &self,
        index: usize,
        node: &Node<'_>,
        collider: &Collider<'_>,
        (position, turn): (Vec3, Quat),
        motion: Motion,
        warnings: &mut Vec<Warning>,
    ) -> Result<Option<Shape>, SceneError> {
        let map = node.scale();

        let decomposition = collider.decomposition;
        let mut solid = |triangles: Triangles, convex: bool| {
            let solid = triangles.solid(map, convex, decomposition, motion);
            solid.notes.into_iter().for_each(|note| self.warn(index, note, warnings));
            solid.kind
        };
        let kind = match collider.geometry {
            Geometry::Shape(shape) => match self.tables.shapes.get(shape) {
                Some(Implicit::Mesh { mesh, convex }) => {
                    solid(self.meshes.triangles(*mesh)?, *convex || collider.convex)
                }
                Some(shape) => match implicit::place(shape, map, motion) {
                    Placed::Shape(kind) => Some(kind),
                    Placed::Instead(kind, why) => {
                        self.warn(index, format!("collider: {why}"), warnings);
                        Some(kind)
                    }
                    Placed::Nothing(why) => {
                        self.warn(index, format!("no collider acts: {why}"), warnings);
                        None
                    }
                },
                None => None,
            },
            Geometry::Mesh(mesh) => solid(self.meshes.triangles(mesh)?, collider.convex),
            Geometry::Node(source) => {
                let (triangles, deformed) = self.meshes.below(self.nodes, source)?;
                if triangles.triangles.is_empty() {
                    return Err(collider.at.fault(
                        format!("geometry of {}, without triangles", node.label(index)),
                        "a node with a mesh, on it or below it, is accepted",
                    ));
                }
                let kind = solid(triangles, collider.convex);
                if deformed {
                    let what = "its collider leaves out the skin and the morph targets of the mesh";
                    self.warn(index, what, warnings);
                }
                kind
            }
        };
        let Some(mut kind) = kind else { return Ok(None) };
        set_exact_points(&collider.at, &mut kind)?;
        let (kind, own) = tilted(node, kind, turn)?;
        Ok(Some(Shape {
            kind,
            position: position.into(),
            rotation: Rotation::Quaternion(own),
            material: collider.material.clone(),
            surface_velocity: collider.runs.clone().map(|runs| seen_from(runs, turn, own)),
            filter: collider.filter,
        }))
    }

    /// Reads the physics properties of all nodes, even of those outside the scene.
    fn properties(&self, warnings: &mut Vec<Warning>) -> Result<Properties<'_>, SceneError> {
        let mut properties = Properties { moving: BTreeMap::new(), colliders: BTreeMap::new() };
        for (index, node) in self.nodes.iter().enumerate() {
            self.other_physics(node, warnings)?;
            let Some(physics) = node.cursor.extension(self.dialect.bodies())? else { continue };
            unknown::warn_unknown(&physics, &["motion", "collider", "trigger", "joint"], warnings);
            if let Some(motion) = physics.get("motion")? {
                let own = node.cursor.own()?;
                properties.moving.insert(index, self.motion(&motion, own.as_ref(), warnings)?);
            }
            if let Some(collider) = physics.get("collider")?
                && let Some(collider) = self.collider(collider, warnings)?
            {
                properties.colliders.insert(index, collider);
            }
            if let Some(trigger) = physics.get("trigger")? {
                self.trigger(&trigger, warnings)?;
                if node.present {
                    self.warn(index, "its trigger is not simulated: it makes no contact", warnings);
                }
            }
        }
        Ok(properties)
    }

    /// Warns of physics extensions on a node other than those of this dialect.
    fn other_physics(
        &self,
        node: &Node<'_>,
        warnings: &mut Vec<Warning>,
    ) -> Result<(), SceneError> {
        let Some(all) = node.cursor.get("extensions")? else { return Ok(()) };
        let read = [self.dialect.bodies(), shared_joints::OMI];
        for name in all.object()?.keys() {
            let physical = name.contains("physics") || name.contains("vehicle");
            if physical && !read.contains(&name.as_str()) && node.present {
                let message = format!("the extension {name} of nodes{}", unknown::IGNORED);
                warnings.push(Warning { place: node.cursor.place(), message });
            }
        }
        Ok(())
    }

    fn motion(
        &self,
        motion: &Cursor<'_>,
        own: Option<&Cursor<'_>>,
        warnings: &mut Vec<Warning>,
    ) -> Result<NodeMotion, SceneError> {
        const KEYS: [&str; 9] = [
            "isKinematic",
            "type",
            "mass",
            "centerOfMass",
            "inertiaDiagonal",
            "inertiaOrientation",
            "linearVelocity",
            "angularVelocity",
            "gravityFactor",
        ];
        unknown::warn_unknown(motion, &KEYS, warnings);
        let omi = self.dialect == Dialect::Omi;
        let kind = match motion.get("type")? {
            Some(kind) if omi => match kind.text()? {
                "static" => Motion::Static,
                "kinematic" => Motion::Kinematic,
                "dynamic" => Motion::Dynamic,
                _ => return Err(kind.error("static, kinematic or dynamic is accepted")),
            },
            _ => match motion.get("isKinematic")?.map(|k| k.boolean()).transpose()? {
                Some(true) if is(own, "motion", "static")? => Motion::Static,
                Some(true) => Motion::Kinematic,
                _ => Motion::Dynamic,
            },
        };
        // Zero stands for infinity, which JSON cannot express.
        let amount = |cursor: &Cursor<'_>| -> Result<f64, SceneError> {
            let number = cursor.within(0.0, HEAVY)?;
            if number == 0.0 {
                Ok(f64::INFINITY)
            } else if number < LIGHT {
                Err(cursor.error(format!("0 (infinity) or {LIGHT:e} to {HEAVY:e} is accepted")))
            } else {
                Ok(number)
            }
        };
        let mut mass = Mass::default();
        if let Some(cursor) = motion.get("mass")? {
            mass.mass = Some(amount(&cursor)?);
        } else if omi {
            mass.mass = Some(1.0);
        }
        if let Some(own) = own
            && let Some(written) = own.get("mass")?
            && Some(written.number(HEAVY)?) == mass.mass
        {
            // The density applies only as long as nobody has changed the mass.
            let density = own.get("density")?.map(|of| of.within(LIGHT, HEAVY)).transpose()?;
            mass = Mass { density, ..Mass::default() };
        }
        if let Some(center) = motion.get("centerOfMass")? {
            mass.center = Some(center.numbers::<3>(FAR)?.into());
        } else if omi {
            mass.center = Some(vec![0.0; 3]);
        }
        if let Some(inertia) = motion.get("inertiaDiagonal")? {
            let written = inertia.numbers::<3>(f64::MAX)?;
            let moments = inertia.items()?.iter().map(amount).collect::<Result<Vec<_>, _>>()?;
            // In OMI files, zero means the inertia of the shapes.
            if !(omi && written == [0.0; 3]) {
                mass.inertia = Some(moments);
            }
        }
        if let Some(turn) = motion.get("inertiaOrientation")? {
            let turn: Quat = nodes::unit_quaternion(&turn)?;
            mass.inertia_rotation = mass.inertia.is_some().then_some(turn);
        }
        let velocity = |key: &str| -> Result<NodeVelocity, SceneError> {
            let stated = motion.get(key)?.map_or(Ok([0.0; 3]), |v| v.numbers(FAST))?;
            let exact = own.map(|own| own.get(key)).transpose()?.flatten();
            Ok(NodeVelocity { stated, exact: exact.map(|v| v.numbers(FAST)).transpose()? })
        };
        Ok(NodeMotion {
            motion: kind,
            mass,
            linear: velocity("linearVelocity")?,
            angular: velocity("angularVelocity")?,
            gravity: motion.get("gravityFactor")?.map_or(Ok(1.0), |g| g.number(MOST_GRAVITY))?,
            damping: [damping(own, "linearDamping")?, damping(own, "angularDamping")?],
            force: force(own)?,
            start_asleep: starts_asleep(own)?,
        })
    }

    fn collider<'c>(
        &self,
        collider: Cursor<'c>,
        warnings: &mut Vec<Warning>,
    ) -> Result<Option<Collider<'c>>, SceneError> {
        const FORM: [&str; 4] = ["shape", "node", "mesh", "convexHull"];
        let geometry = match collider.get("geometry")? {
            Some(geometry) => {
                let known = ["geometry", "physicsMaterial", "collisionFilter"];
                unknown::warn_unknown(&collider, &known, warnings);
                unknown::warn_unknown(&geometry, &FORM, warnings);
                geometry
            }
            // An OMI collider without a shape refers to the colliders below it.
            None if self.dialect == Dialect::Omi && collider.get("shape")?.is_none() => {
                return Ok(None);
            }
            None => collider.clone(),
        };
        let form = self.geometry(&geometry)?;
        let material = match collider.get("physicsMaterial")? {
            Some(material) => {
                let index = material.index(self.tables.materials.len(), "physics materials")?;
                self.tables.materials.get(index).cloned()
            }
            None => None,
        };
        let filter = match collider.get("collisionFilter")? {
            Some(filter) => {
                let index = filter.index(self.tables.filters.len(), "collision filters")?;
                self.tables.filters.get(index).copied()
            }
            None => None,
        };
        Ok(Some(Collider {
            convex: geometry.get("convexHull")?.map_or(Ok(false), |c| c.boolean())?,
            geometry: form,
            decomposition: decomposition(&geometry)?,
            at: geometry,
            material: material.unwrap_or(tables::PLAIN),
            runs: surface(collider.own()?.as_ref())?,
            filter: filter.unwrap_or_default(),
        }))
    }

    fn geometry(&self, geometry: &Cursor<'_>) -> Result<Geometry, SceneError> {
        let shape = geometry.get("shape")?;
        let node = geometry.get("node")?;
        let mesh = geometry.get("mesh")?;
        Ok(match (shape, node, mesh) {
            (Some(shape), None, None) => {
                Geometry::Shape(shape.index(self.tables.shapes.len(), "shapes")?)
            }
            (None, Some(node), None) => Geometry::Node(node.index(self.nodes.len(), "nodes")?),
            (None, None, Some(mesh)) => Geometry::Mesh(mesh.index(self.meshes.len(), "meshes")?),
            _ => {
                return Err(geometry.fault(
                    geometry.name(),
                    "exactly one of 'shape', 'node' and 'mesh' is accepted",
                ));
            }
        })
    }

    /// Checks a trigger. Triggers are not simulated, but faults in them are errors.
    fn trigger(&self, trigger: &Cursor<'_>, warnings: &mut Vec<Warning>) -> Result<(), SceneError> {
        unknown::warn_unknown(
            trigger,
            &["geometry", "nodes", "shape", "collisionFilter"],
            warnings,
        );
        if let Some(filter) = trigger.get("collisionFilter")? {
            filter.index(self.tables.filters.len(), "collision filters")?;
        }
        match trigger.get("geometry")? {
            Some(geometry) => {
                self.geometry(&geometry)?;
            }
            None => {
                if let Some(shape) = trigger.get("shape")? {
                    shape.index(self.tables.shapes.len(), "shapes")?;
                }
            }
        }
        for part in trigger.list("nodes")? {
            let index = part.index(self.nodes.len(), "nodes")?;
            let extension =
                self.nodes.get(index).map(|n| n.cursor.extension(self.dialect.bodies()));
            let inner = extension.transpose()?.flatten().map(|e| e.get("trigger")).transpose()?;
            let simple = match inner.flatten() {
                Some(inner) => inner.get("nodes")?.is_none(),
                None => false,
            };
            if !simple {
                return Err(part.error("a node with a trigger that has a geometry is accepted"));
            }
        }
        Ok(())
    }
}

/// Reads the surface velocity, which no extension can express, from extras.
fn surface(own: Option<&Cursor<'_>>) -> Result<Option<SurfaceVelocity>, SceneError> {
    let Some(of) = own.map(|own| own.get("surfaceVelocity")).transpose()?.flatten() else {
        return Ok(None);
    };
    let vector = |key: &str| -> Result<Vec<f64>, SceneError> {
        Ok(of.get(key)?.map_or(Ok([0.0; 3]), |v| v.numbers(FAST))?.into())
    };
    let local = of.get("local")?.map_or(Ok(true), |local| local.boolean())?;
    Ok(Some(SurfaceVelocity { linear: vector("linear")?, angular: vector("angular")?, local }))
}

/// Reads a damping rate, which no extension can express, from extras. \[1/s\]
fn damping(own: Option<&Cursor<'_>>, key: &str) -> Result<f64, SceneError> {
    let of = own.map(|own| own.get(key)).transpose()?.flatten();
    of.map_or(Ok(0.0), |of| of.within(0.0, STRONGEST))
}

/// Reads a constant force, which no extension can express, from extras. \[N\]
fn force(own: Option<&Cursor<'_>>) -> Result<Vec3, SceneError> {
    let of = own.map(|own| own.get("force")).transpose()?.flatten();
    of.map_or(Ok([0.0; 3]), |of| of.numbers(MOST_FORCE))
}

/// Reads from extras whether a body sleeps at the start, which no extension can express.
fn starts_asleep(own: Option<&Cursor<'_>>) -> Result<bool, SceneError> {
    let of = own.map(|own| own.get("startAsleep")).transpose()?.flatten();
    of.map_or(Ok(false), |of| of.boolean())
}

/// Restores the exact normal and rotation of a half-space exported from the own format, unless
/// somebody turned it since.
fn tilted(node: &Node<'_>, kind: ShapeKind, turn: Quat) -> Result<(ShapeKind, Quat), SceneError> {
    let own = node.cursor.own()?;
    let plane = own.as_ref().map(|own| own.get("plane")).transpose()?.flatten();
    if let (ShapeKind::Halfspace { .. }, Some(plane)) = (&kind, plane) {
        let normal: Vec3 = plane.require("normal")?.numbers(2.0)?;
        let rotation: Quat = plane.require("rotation")?.numbers(2.0)?;
        let stated = math::quat_mul(rotation, math::from_up(normal));
        if stated.iter().zip(turn).all(|(a, b)| (a - b).abs() <= SLACK) {
            return Ok((ShapeKind::Halfspace { normal: normal.into() }, rotation));
        }
    }
    Ok((kind, turn))
}

/// Replaces the points of a hull or a mesh by those of the own format, unless somebody moved them.
fn set_exact_points(geometry: &Cursor<'_>, kind: &mut ShapeKind) -> Result<(), SceneError> {
    let own = geometry.own()?;
    let Some(list) = own.as_ref().map(|own| own.get("points")).transpose()?.flatten() else {
        return Ok(());
    };
    let exact: Vec<Vec3> =
        list.items()?.iter().map(|point| point.numbers(FAR)).collect::<Result<_, _>>()?;
    let same = |stated: &[f64], exact: &Vec3| {
        stated.iter().zip(exact).all(|(a, b)| *a == f64::from(*b as f32))
    };
    match kind {
        ShapeKind::ConvexHull { points }
            if points.len() == exact.len()
                && points.iter().zip(&exact).all(|(a, b)| same(a, b)) =>
        {
            *points = exact.into_iter().map(Vec::from).collect();
        }
        ShapeKind::Trimesh { vertices, .. }
            if vertices.len() == exact.len()
                && vertices.iter().zip(&exact).all(|(a, b)| same(a, b)) =>
        {
            *vertices = exact;
        }
        _ => {}
    }
    Ok(())
}

/// Reads the accuracy and number of convex pieces for a mesh from the extras of its geometry.
fn decomposition(geometry: &Cursor<'_>) -> Result<Option<DecompositionOptions>, SceneError> {
    let own = geometry.own()?;
    let own = own.as_ref().map(|own| own.get("decomposition")).transpose()?.flatten();
    let Some(own) = own else { return Ok(None) };
    let default = DecompositionOptions::default();
    let [low, high] = DecompositionOptions::ACCURACY;
    let [fewest, most] = DecompositionOptions::PIECES.map(f64::from);
    let accuracy = own.get("accuracy")?.map(|number| number.within(low, high)).transpose()?;
    let pieces = own.get("pieces")?.map(|number| number.within(fewest, most)).transpose()?;
    Ok(Some(DecompositionOptions {
        accuracy: accuracy.unwrap_or(default.accuracy),
        pieces: pieces.map_or(default.pieces, |count| count as u32),
    }))
}

/// Returns true if a member of an object is this text.
fn is(object: Option<&Cursor<'_>>, key: &str, text: &str) -> Result<bool, SceneError> {
    let member = object.map(|object| object.get(key)).transpose()?.flatten();
    Ok(member.is_some_and(|member| member.value == text))
}

/// Returns the initial pose of a body: the first pose of its track, else that of its node.
fn start(node: &Node<'_>, track: &Track) -> (Vec3, Quat) {
    if let (Some(position), Some(Rotation::Quaternion(turn))) =
        (track.positions.first(), track.rotations.first())
        && let Ok(position) = Vec3::try_from(position.as_slice())
    {
        return (position, *turn);
    }
    (node.world.shift, node.turn)
}
