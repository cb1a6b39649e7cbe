//! [`Scene`]: the description that a world is built from, whichever reader produced it.

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;

use crate::joint::Joint;
pub use crate::rotation::Rotation;
use crate::solid_mesh::DecompositionOptions;
use crate::vertex_track::VertexTrack;

/// A scene: its bodies, their initial state, and the length of the run.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Name of the scene.
    pub name: Option<String>,
    /// Number of dimensions: 2 or 3.
    pub dimension: usize,
    /// Acceleration of gravity. \[m/s^2\]
    pub gravity: Vec<f64>,
    /// Length of a time step. \[s\]
    pub time_step: f64,
    /// Speed and gravity over time, if they change.
    pub track: WorldTrack,
    /// Number of steps to run, if the scene specifies it.
    pub steps: Option<u32>,
    /// Whether bodies are rigid or particles. Particles never rotate.
    pub bodies_as: BodiesAs,
    /// Bodies; the index in this list is the body id in every output.
    pub bodies: Vec<Body>,
    /// Joints; the index in this list is the joint id in every output.
    pub joints: Vec<Joint>,
    /// The table `solver`: settings of the engine by name, each optional.
    pub solver: serde_json::Map<String, Value>,
}

impl Scene {
    /// Returns the time that a step simulates \[s\], and gravity in it \[m/s^2\]. Steps count from 0.
    pub fn terms_of(&self, step: usize) -> (f64, Vec<f64>) {
        if self.track.times.is_empty() {
            return (self.time_step, self.gravity.clone());
        }
        let (speed, gravity) = self.track.at((step + 1) as f64 * self.time_step);
        (speed * self.time_step, gravity)
    }

    /// Returns the longest time that a step may simulate. \[s\]
    pub fn longest_step(&self) -> f64 {
        self.time_step * self.track.speeds.iter().copied().reduce(f64::max).unwrap_or(1.0)
    }

    /// Returns the time that so many steps simulate together. \[s\]
    pub fn simulated(&self, steps: usize) -> f64 {
        if self.track.times.is_empty() {
            return steps as f64 * self.time_step;
        }
        (0..steps).map(|step| self.terms_of(step).0).sum()
    }

    /// Returns the names of all bodies; a body without a name is called `body 12` by its index.
    pub fn names(&self) -> Vec<String> {
        let name = |(i, body): (usize, &Body)| body.name.clone().unwrap_or(format!("body {i}"));
        self.bodies.iter().enumerate().map(name).collect()
    }

    /// Returns the body as messages call it: its name in quotes, or `body 12` by its index.
    pub fn name_of(&self, body: usize) -> String {
        let name = self.bodies.get(body).and_then(|body| body.name.as_ref());
        name.map_or_else(|| format!("body {body}"), |name| format!("'{name}'"))
    }

    /// Returns one name per joint; `joint 12` for a joint without a name.
    pub fn joint_names(&self) -> Vec<String> {
        let name = |(i, joint): (usize, &Joint)| joint.name.clone().unwrap_or(format!("joint {i}"));
        self.joints.iter().enumerate().map(name).collect()
    }

    /// Returns the joint as messages call it: its name in quotes, or `joint 12` by its index.
    pub fn joint_name_of(&self, joint: usize) -> String {
        let name = self.joints.get(joint).and_then(|joint| joint.name.as_ref());
        name.map_or_else(|| format!("joint {joint}"), |name| format!("'{name}'"))
    }
}

/// Kind of simulation of the bodies of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BodiesAs {
    /// They turn: (2,1) or (3,3).
    #[default]
    Rigid,
    /// Spheres without friction that never turn: (2,0) or (3,0).
    Particles,
}

/// A body.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Name, unique in the scene.
    pub name: Option<String>,
    /// Whether forces, a prescribed motion or nothing moves the body.
    pub motion: Motion,
    /// Position of the body's origin. \[m\]
    pub position: Vec<f64>,
    /// Rotation about the body's origin.
    pub rotation: Rotation,
    /// Velocity of the center of mass. \[m/s\]
    pub linear_velocity: Vec<f64>,
    /// Angular velocity: a vector in world axes in 3D, one number in 2D. \[rad/s\]
    pub angular_velocity: Vec<f64>,
    /// Mass properties.
    pub mass: Mass,
    /// Factor on the scene's gravity for this body. \[1\]
    pub gravity_factor: f64,
    /// Damping rate d of the linear velocity: dv/dt = -d v. \[1/s\]
    pub linear_damping: f64,
    /// Damping rate d of the angular velocity: dω/dt = -d ω. \[1/s\]
    pub angular_damping: f64,
    /// Surface velocity about the body's origin; each shape may override it.
    pub surface_velocity: Option<SurfaceVelocity>,
    /// One shape, or several that form a compound.
    pub shapes: Vec<Shape>,
    /// Constant force on its center of mass. \[N\]
    pub force: Vec<f64>,
    /// True if a dynamic body sleeps at the start: nothing moves it until an awake body touches it.
    pub start_asleep: bool,
    /// Prescribed poses. A kinematic body without any moves at its velocities. A dynamic body follows
    /// them as a kinematic one until the last, and is released with the velocity that it has then.
    pub track: Track,
}

impl Body {
    /// Describes a body at rest at `position` \[m\], not rotated, with one shape. The position has
    /// as many components as the scene has dimensions.
    pub fn new<const D: usize>(motion: Motion, position: [f64; D], kind: ShapeKind) -> Self {
        Self {
            name: None,
            motion,
            position: position.to_vec(),
            rotation: Rotation::identity(D),
            linear_velocity: vec![0.0; D],
            angular_velocity: vec![0.0; if D == 3 { 3 } else { 1 }],
            mass: Mass::default(),
            gravity_factor: 1.0,
            linear_damping: 0.0,
            angular_damping: 0.0,
            surface_velocity: None,
            shapes: vec![Shape::new(kind, D)],
            force: vec![0.0; D],
            start_asleep: false,
            track: Track::default(),
        }
    }

    /// Describes a particle at rest at `position` \[m\]: a dynamic sphere of `radius` \[m\] without
    /// friction.
    pub fn particle<const D: usize>(position: [f64; D], radius: f64) -> Self {
        let mut body = Self::new(Motion::Dynamic, position, ShapeKind::Sphere { radius });
        body.shapes.iter_mut().for_each(|shape| shape.material.friction = 0.0);
        body
    }
}

/// Cause of the motion of a body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// Forces and contacts.
    #[default]
    Dynamic,
    /// Nothing.
    Static,
    /// Its velocities or its track: it pushes others and is never pushed.
    Kinematic,
}

/// Mass properties; absent ones are computed from the shapes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mass {
    /// Density: \[kg/m^3\] in 3D, \[kg/m^2\] in 2D; 1000 if neither it nor the mass is given.
    pub density: Option<f64>,
    /// Total mass, instead of a density. No force moves a body of infinite mass. \[kg\]
    pub mass: Option<f64>,
    /// Center of mass in the body's frame. \[m\]
    pub center: Option<Vec<f64>>,
    /// Principal moments of inertia: three in 3D, one in 2D. The body does not turn about an axis
    /// with an infinite moment. \[kg m^2\]
    pub inertia: Option<Vec<f64>>,
    /// Rotation from the principal axes to the body's frame (3D).
    pub inertia_rotation: Option<[f64; 4]>,
}

/// A shape on a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Geometry of the shape.
    pub kind: ShapeKind,
    /// Position in the body's frame. \[m\]
    pub position: Vec<f64>,
    /// Rotation in the body's frame.
    pub rotation: Rotation,
    /// Surface properties.
    pub material: Material,
    /// Surface velocity in the frame of the shape and about its origin; that of the body if absent.
    pub surface_velocity: Option<SurfaceVelocity>,
    /// Collision filter.
    pub filter: Filter,
}

impl Shape {
    /// Describes a shape at the origin of its body, not rotated, with the default material.
    pub fn new(kind: ShapeKind, dimension: usize) -> Self {
        Self {
            kind,
            position: vec![0.0; dimension],
            rotation: Rotation::identity(dimension),
            material: Material::default(),
            surface_velocity: None,
            filter: Filter::default(),
        }
    }
}

/// The form of a shape.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum ShapeKind {
    /// Sphere (2D: disk).
    Sphere {
        /// \[m\]
        radius: f64,
    },
    /// Box.
    Box {
        /// Half of its size along each axis. \[m\]
        half_extents: Vec<f64>,
    },
    /// Capsule along local y.
    Capsule {
        /// \[m\]
        radius: f64,
        /// Half the length of its segment. \[m\]
        half_height: f64,
    },
    /// Cylinder along local y (3D).
    Cylinder {
        /// \[m\]
        radius: f64,
        /// Half of its height. \[m\]
        half_height: f64,
    },
    /// Hull of points.
    ConvexHull {
        /// Points. \[m\]
        points: Vec<Vec<f64>>,
    },
    /// Half-space behind a plane through the local origin; not on dynamic bodies.
    Halfspace {
        /// Outward unit normal.
        normal: Vec<f64>,
    },
    /// Triangles, counter-clockwise seen from outside (3D). On a dynamic body the mesh is closed,
    /// and collides as convex pieces.
    Trimesh {
        /// Points. \[m\]
        vertices: Vec<[f64; 3]>,
        /// Indices of three vertices each.
        triangles: Vec<[u32; 3]>,
        /// Accuracy of the pieces that replace the mesh, on a dynamic body; the default if absent.
        #[serde(skip_serializing_if = "Option::is_none")]
        decomposition: Option<DecompositionOptions>,
        /// Places of the vertices over time, on a static or kinematic body; they stay if absent.
        #[serde(skip_serializing_if = "Option::is_none")]
        vertex_track: Option<VertexTrack>,
    },
}

impl ShapeKind {
    /// Returns the places of the vertices over time, of a mesh that has them.
    pub fn vertex_track(&self) -> Option<&VertexTrack> {
        match self {
            Self::Trimesh { vertex_track, .. } => vertex_track.as_ref(),
            _ => None,
        }
    }
}

/// Velocity of a surface relative to its body, as of a belt or a turntable: v = linear + angular ×
/// r.
///
/// A contact uses the part of v that is tangential to it: friction drives the other body towards
/// it. The normal part has no effect, and neither has a surface velocity without friction.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceVelocity {
    /// Linear part. \[m/s\]
    pub linear: Vec<f64>,
    /// Angular part: three numbers in 3D, one in 2D. \[rad/s\]
    pub angular: Vec<f64>,
    /// True if the axes are those of the body or shape and turn with it; false if they are the
    /// world's.
    pub local: bool,
}

impl SurfaceVelocity {
    /// Whether any component differs from zero.
    pub fn runs(&self) -> bool {
        self.linear.iter().chain(&self.angular).any(|x| *x != 0.0)
    }
}

/// Surface properties of a shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Coulomb friction coefficient. \[1\]
    pub friction: f64,
    /// Coefficient of restitution, 0..1. \[1\]
    pub restitution: f64,
    /// Rolling resistance: the largest distance by which the normal force may act ahead of the
    /// contact. A rolling ball of radius r decelerates as on an upward slope of this length over r.
    /// A contact takes the larger value of its two surfaces. \[m\]
    pub rolling_resistance: f64,
    /// Resistance to spinning about the normal: the largest moment divided by the normal force. A
    /// contact takes the larger value of its two surfaces. \[m\]
    pub spinning_resistance: f64,
    /// Rule that combines the friction of two surfaces.
    pub friction_combine: Combine,
    /// Rule that combines the restitution of two surfaces.
    pub restitution_combine: Combine,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            friction: 0.5,
            restitution: 0.0,
            rolling_resistance: 0.0,
            spinning_resistance: 0.0,
            friction_combine: Combine::GeometricMean,
            restitution_combine: Combine::Maximum,
        }
    }
}

/// Rule that combines two coefficients. When two surfaces differ, the earlier in this list decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Combine {
    /// (a + b) / 2.
    Average,
    /// min(a, b).
    Minimum,
    /// max(a, b).
    Maximum,
    /// a b.
    Multiply,
    /// sqrt(a b): the default for friction.
    GeometricMean,
}

/// Collision filter of a shape. Each named system is a bit. Two shapes collide if each accepts a
/// system of the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Filter {
    /// Systems that the shape belongs to; 0 if it belongs to no named system.
    pub systems: u64,
    /// Systems that the shape collides with.
    pub collides_with: u64,
    /// Whether the shape collides with shapes that belong to no named system.
    pub collides_with_unnamed: bool,
}

impl Filter {
    /// Whether both shapes accept each other.
    pub fn collides(&self, other: &Self) -> bool {
        self.accepts(other) && other.accepts(self)
    }

    fn accepts(&self, other: &Self) -> bool {
        if other.systems == 0 {
            self.collides_with_unnamed
        } else {
            self.collides_with & other.systems != 0
        }
    }
}

impl Default for Filter {
    fn default() -> Self {
        Self { systems: 0, collides_with: u64::MAX, collides_with_unnamed: true }
    }
}

/// Speed and gravity of a world over time: interpolated between keys, constant before the first and
/// after the last. A step has those at its end.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WorldTrack {
    /// Times in ascending order. \[s\]
    pub times: Vec<f64>,
    /// Time that is simulated over that of the scene, one per time: 0.1 is slow motion, at 0 all stands
    /// still. \[1\]
    pub speeds: Vec<f64>,
    /// Accelerations of free fall, one per time. \[m/s^2\]
    pub gravities: Vec<Vec<f64>>,
}

impl WorldTrack {
    /// Returns the speed and gravity at `time` \[s\]. \[1, m/s^2\]
    ///
    /// # Panics
    /// If the track has no keys.
    pub fn at(&self, time: f64) -> (f64, Vec<f64>) {
        let ([i, j], t) = between(&self.times, time);
        let mix = |a: f64, b: f64| a + (b - a) * t;
        let gravities = self.gravities[i].iter().zip(&self.gravities[j]);
        (mix(self.speeds[i], self.speeds[j]), gravities.map(|(a, b)| mix(*a, *b)).collect())
    }
}

/// Returns the keys between which a time is, and its place between them from 0 to 1.
fn between(times: &[f64], time: f64) -> ([usize; 2], f64) {
    let after = times.partition_point(|&key| key <= time);
    let (i, j) = (after.saturating_sub(1), after.min(times.len() - 1));
    let span = times[j] - times[i];
    ([i, j], if span > 0.0 { (time - times[i]) / span } else { 0.0 })
}

/// Poses over time of a body: interpolated between keys, constant before the first and
/// after the last.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track {
    /// Times in ascending order. \[s\]
    pub times: Vec<f64>,
    /// Positions of the body's origin, one per time. \[m\]
    pub positions: Vec<Vec<f64>>,
    /// Rotations, one per time.
    pub rotations: Vec<Rotation>,
}

impl Track {
    /// Returns position and rotation at `time` \[s\]: interpolated between keys, held before the
    /// first and after the last.
    ///
    /// # Panics
    /// If the track has no keys.
    pub fn at(&self, time: f64) -> (Vec<f64>, Rotation) {
        let ([i, j], t) = between(&self.times, time);
        let position = self.positions[i]
            .iter()
            .zip(&self.positions[j])
            .map(|(p, q)| p + (q - p) * t)
            .collect();
        (position, self.rotations[i].towards(&self.rotations[j], t))
    }
}
