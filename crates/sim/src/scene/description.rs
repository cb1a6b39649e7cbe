//! [`Scene`]: what a world is built from, whoever wrote it.

use std::array::from_fn;

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;

use crate::decomposition::DecompositionOptions;

/// A scene: what is there, how it starts, how long it runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Its name.
    pub name: Option<String>,
    /// 2 or 3.
    pub dimension: usize,
    /// Acceleration of free fall. \[m/s^2\]
    pub gravity: Vec<f64>,
    /// Length of a step. \[s\]
    pub time_step: f64,
    /// Steps to run, if the scene says so.
    pub steps: Option<u32>,
    /// Whether bodies are rigid, or particles that never turn.
    pub bodies_as: BodiesAs,
    /// Index = body id in every output.
    pub bodies: Vec<Body>,
    /// The table `solver`: step settings under the names of [`StepSettings`](crate::StepSettings),
    /// each optional.
    pub solver: serde_json::Map<String, Value>,
}

impl Scene {
    /// The names of all bodies; `body 12` is one without.
    pub fn names(&self) -> Vec<String> {
        let name = |(i, body): (usize, &Body)| body.name.clone().unwrap_or(format!("body {i}"));
        self.bodies.iter().enumerate().map(name).collect()
    }

    /// What messages call a body: its name in quotes, or its index.
    pub fn name_of(&self, body: usize) -> String {
        let name = self.bodies.get(body).and_then(|body| body.name.as_ref());
        name.map_or_else(|| format!("body {body}"), |name| format!("'{name}'"))
    }
}

/// How the bodies of a scene are simulated.
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
    /// Its name, unique in the scene.
    pub name: Option<String>,
    /// What moves it.
    pub motion: Motion,
    /// Position of its origin. \[m\]
    pub position: Vec<f64>,
    /// Rotation about its origin.
    pub rotation: Rotation,
    /// Velocity of its center of mass. \[m/s\]
    pub linear_velocity: Vec<f64>,
    /// 3D: about world axes; 2D: one number. \[rad/s\]
    pub angular_velocity: Vec<f64>,
    /// Mass, and where it sits.
    pub mass: Mass,
    /// Part of the scene's gravity that acts on it. \[1\]
    pub gravity_factor: f64,
    /// Rate d at which its velocity decays: dv/dt = -d v. \[1/s\]
    pub linear_damping: f64,
    /// The same of its angular velocity. \[1/s\]
    pub angular_damping: f64,
    /// How its surface runs, about its origin; shapes may have it run otherwise.
    pub surface_velocity: Option<SurfaceVelocity>,
    /// One shape, or several that make a compound.
    pub shapes: Vec<Shape>,
    /// Prescribed poses of a kinematic body; empty: it moves at its velocities.
    pub track: Track,
}

/// What moves a body.
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

/// A rotation as written in a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rotation {
    /// 2D. \[rad\]
    Angle(f64),
    /// 3D: unit quaternion x, y, z, w.
    Quaternion([f64; 4]),
}

impl Rotation {
    /// None, in 2 or 3 dimensions.
    pub fn identity(dimension: usize) -> Self {
        if dimension == 3 { Self::Quaternion([0.0, 0.0, 0.0, 1.0]) } else { Self::Angle(0.0) }
    }

    /// The angle of the shorter way to `other`. \[rad\]
    pub fn angle_to(&self, other: &Self) -> f64 {
        match (self, other) {
            (Self::Quaternion(p), Self::Quaternion(q)) => {
                let dot: f64 = p.iter().zip(q).map(|(x, y)| x * y).sum();
                2.0 * libm::acos(dot.abs().min(1.0))
            }
            (Self::Angle(a), Self::Angle(b)) => (b - a).abs(),
            _ => 0.0,
        }
    }

    /// The rotation a part `t` (0..1) of the shorter way to `other`, at even speed.
    pub fn towards(&self, other: &Self, t: f64) -> Self {
        match (self, other) {
            (Self::Quaternion(p), Self::Quaternion(q)) => {
                let dot: f64 = p.iter().zip(q).map(|(x, y)| x * y).sum();
                let sign = if dot < 0.0 { -1.0 } else { 1.0 };
                let angle = libm::acos((dot * sign).min(1.0));
                let sine = libm::sin(angle);
                let (from, to) = if sine > 1e-6 {
                    (libm::sin((1.0 - t) * angle) / sine, libm::sin(t * angle) / sine)
                } else {
                    (1.0 - t, t)
                };
                let mixed: [f64; 4] = from_fn(|i| p[i] * from + q[i] * to * sign);
                let length = mixed.iter().map(|x| x * x).sum::<f64>().sqrt();
                Self::Quaternion(mixed.map(|x| x / length))
            }
            (Self::Angle(a), Self::Angle(b)) => Self::Angle(a + (b - a) * t),
            _ => *self,
        }
    }
}

/// Mass properties; what is absent follows from the shapes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mass {
    /// 3D \[kg/m^3\], 2D \[kg/m^2\]; absent: 1000.
    pub density: Option<f64>,
    /// Total mass, instead of a density; infinity: no push moves it. \[kg\]
    pub mass: Option<f64>,
    /// Center of mass in the body's frame. \[m\]
    pub center: Option<Vec<f64>>,
    /// Principal moments of inertia (3D: three, 2D: one); infinity: it does not turn about that
    /// axis. \[kg m^2\]
    pub inertia: Option<Vec<f64>>,
    /// Rotation from the principal axes to the body's frame (3D).
    pub inertia_rotation: Option<[f64; 4]>,
}

/// A shape on a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Its form.
    pub kind: ShapeKind,
    /// Position in the body's frame. \[m\]
    pub position: Vec<f64>,
    /// Rotation in the body's frame.
    pub rotation: Rotation,
    /// What its surface is like.
    pub material: Material,
    /// How its surface runs, in the frame of the shape and about its origin; absent: as that of the body.
    pub surface_velocity: Option<SurfaceVelocity>,
    /// What it collides with.
    pub filter: Filter,
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
    /// Everything behind a plane through the local origin; not on dynamic bodies.
    Halfspace {
        /// Outward unit normal.
        normal: Vec<f64>,
    },
    /// Triangles, counter-clockwise seen from outside (3D). On a dynamic body the mesh is closed, and collides as
    /// convex pieces.
    Trimesh {
        /// Points. \[m\]
        vertices: Vec<[f64; 3]>,
        /// Indices of three vertices each.
        triangles: Vec<[u32; 3]>,
        /// How closely the pieces follow the mesh, on a dynamic body; the default if absent.
        #[serde(skip_serializing_if = "Option::is_none")]
        decomposition: Option<DecompositionOptions>,
    },
}

/// How a surface runs against its body, as a belt or a turntable does: v = linear + angular x r.
///
/// Contacts see what of it lies along them: friction drives the other body to it. It neither lifts nor
/// presses, and without friction does nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceVelocity {
    /// \[m/s\]
    pub linear: Vec<f64>,
    /// 3D: three numbers; 2D: one. \[rad/s\]
    pub angular: Vec<f64>,
    /// Whether its axes are those of the body or shape, and turn with it; else those of the world.
    pub local: bool,
}

impl SurfaceVelocity {
    /// Whether it runs at all.
    pub fn runs(&self) -> bool {
        self.linear.iter().chain(&self.angular).any(|x| *x != 0.0)
    }
}

/// A surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Coulomb coefficient. \[1\]
    pub friction: f64,
    /// Restitution, 0..1. \[1\]
    pub restitution: f64,
    /// Resistance to rolling: how far ahead of the contact the supporting force may act. It slows a ball of radius
    /// r as a slope of this over r would. Of two surfaces the larger counts. \[m\]
    pub rolling_resistance: f64,
    /// Resistance to spinning about the normal: the largest moment, over the normal force. Of two surfaces the
    /// larger counts. \[m\]
    pub spinning_resistance: f64,
    /// How the frictions of two surfaces combine.
    pub friction_combine: Combine,
    /// How the restitutions of two surfaces combine.
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

/// How two coefficients combine. When two surfaces differ, the earlier in this list decides.
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

impl Combine {
    /// The coefficient of two surfaces with coefficients `x` and `y`.
    pub fn of(a: Self, b: Self, x: f64, y: f64) -> f64 {
        match a.min(b) {
            Self::Average => 0.5 * (x + y),
            Self::Minimum => x.min(y),
            Self::Maximum => x.max(y),
            Self::Multiply => x * y,
            Self::GeometricMean => (x * y).sqrt(),
        }
    }
}

/// Which others a shape collides with: systems are bits; two shapes collide when each accepts a
/// system of the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Filter {
    /// Systems that it is in; none: it belongs to no named system.
    pub systems: u64,
    /// Systems that it collides with.
    pub collides_with: u64,
    /// Whether it collides with shapes in none of the named systems.
    pub collides_with_unnamed: bool,
}

impl Filter {
    /// Whether both accept each other.
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

/// Poses over time, for kinematic bodies; linear between keys, clamped at the ends.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track {
    /// Ascending. \[s\]
    pub times: Vec<f64>,
    /// Positions of the body's origin, one per time. \[m\]
    pub positions: Vec<Vec<f64>>,
    /// Rotations, one per time.
    pub rotations: Vec<Rotation>,
}

impl Track {
    /// Position and rotation at `time` \[s\]: linear between keys, held before the first and after
    /// the last.
    pub fn at(&self, time: f64) -> (Vec<f64>, Rotation) {
        let after = self.times.partition_point(|&key| key <= time);
        let i = after.saturating_sub(1);
        let j = after.min(self.times.len() - 1);
        let span = self.times[j] - self.times[i];
        let t = if span > 0.0 { (time - self.times[i]) / span } else { 0.0 };
        let position = self.positions[i]
            .iter()
            .zip(&self.positions[j])
            .map(|(p, q)| p + (q - p) * t)
            .collect();
        (position, self.rotations[i].towards(&self.rotations[j], t))
    }
}
