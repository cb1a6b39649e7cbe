//! The scene format as types: scenes are written from them, and the JSON Schema is generated from
//! them.

pub(super) mod joint;
pub(super) mod values;

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Map, Value};

use self::joint::JointDocument;
use self::values::{RotationDocument, Unbounded};
use super::description::{BodiesAs, Combine, Motion, ShapeKind};

/// A scene for Drystone. SI units, right-handed, +y up.
#[derive(Serialize, JsonSchema, Default)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Drystone scene")]
pub(super) struct SceneDocument {
    /// Its name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) name: Option<String>,
    /// 2 or 3; 3 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 2, max = 3))]
    pub(super) dimension: Option<usize>,
    /// Acceleration of free fall [m/s^2]; (0, -9.81, 0) if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 2, max = 3))]
    pub(super) gravity: Option<Vec<f64>>,
    /// Time step [s]; 1/60 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1e-6, max = 1.0))]
    pub(super) time_step: Option<f64>,
    /// Keys of speed and gravity, if they change.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schemars(default)]
    pub(super) track: Vec<WorldKeyDocument>,
    /// Number of steps to run.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 10_000_000))]
    pub(super) steps: Option<u32>,
    /// Time to run [s], instead of a number of steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) duration: Option<f64>,
    /// Kind of the bodies; "rigid" if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) bodies_as: Option<BodiesAs>,
    /// Settings of a step in place of the defaults.
    #[serde(skip_serializing_if = "Map::is_empty")]
    #[schemars(default)]
    #[schemars(with = "crate::solver::StepSettings")]
    pub(super) solver: Map<String, Value>,
    /// Surfaces by name, for bodies to refer to.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(default)]
    pub(super) materials: BTreeMap<String, MaterialDocument>,
    /// The bodies; the index in this list is the number of a body in every output.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schemars(default)]
    pub(super) bodies: Vec<BodyDocument>,
    /// The joints; the index in this list is the number of a joint in every output.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schemars(default)]
    pub(super) joints: Vec<JointDocument>,
    /// Not supported yet.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) events: Option<Value>,
    /// Anything; ignored.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) extras: Option<Value>,
}

/// Speed and gravity at a time. They are interpolated between keys, and held before the first and after
/// the last. A step has those at its end.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "WorldKey")]
pub(super) struct WorldKeyDocument {
    /// Time [s]; above that of the key before.
    pub(super) time: f64,
    /// Time that is simulated over that of the scene [1]: 0.1 is slow motion, at 0 all stands still; 1 if
    /// absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub(super) speed: Option<f64>,
    /// Acceleration of free fall [m/s^2]; that of the scene if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 2, max = 3))]
    pub(super) gravity: Option<Vec<f64>>,
}

/// Material of the inside of bodies.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Material")]
pub(super) struct MaterialDocument {
    /// Density [kg/m^3], in 2D [kg/m^2].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) density: Option<f64>,
    #[serde(flatten)]
    pub(super) surface: SurfaceDocument,
}

/// Properties of a surface.
#[derive(Serialize, JsonSchema, Default)]
#[schemars(rename = "Surface")]
pub(super) struct SurfaceDocument {
    /// Coulomb friction coefficient [1]; 0.5 if absent, 0 in a scene of particles.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub(super) friction: Option<f64>,
    /// Coefficient of restitution [1], 0 to 1; 0 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub(super) restitution: Option<f64>,
    /// Rolling resistance [m]: the largest distance by which the normal force may act ahead of the
    /// contact; 0 if absent. A contact takes the larger value of its two surfaces.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub(super) rolling_resistance: Option<f64>,
    /// Spinning resistance [m]: the largest moment about the normal, divided by the normal force; 0
    /// if absent. A contact takes the larger value of its two surfaces.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub(super) spinning_resistance: Option<f64>,
    /// Rule that combines the frictions of two surfaces; "geometric_mean" if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) friction_combine: Option<Combine>,
    /// Rule that combines the restitutions of two surfaces; "maximum" if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) restitution_combine: Option<Combine>,
}

/// A body.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Body")]
pub(super) struct BodyDocument {
    /// Its name, unique in the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) name: Option<String>,
    /// Kind of motion; "dynamic" if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) motion: Option<Motion>,
    /// Position [m]; the origin if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 2, max = 3))]
    pub(super) position: Option<Vec<f64>>,
    /// 3D: unit quaternion x, y, z, w. 2D: angle [rad].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) rotation: Option<RotationDocument>,
    /// Velocity of the center of mass [m/s]; 0 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 2, max = 3))]
    pub(super) linear_velocity: Option<Vec<f64>>,
    /// Angular velocity [rad/s], in 3D about world axes, in 2D a number; 0 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) angular_velocity: Option<SpinDocument>,
    /// Factor of the gravity that acts on it [1]; 1 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) gravity_factor: Option<f64>,
    /// Rate at which its velocity decays [1/s]; 0 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub(super) linear_damping: Option<f64>,
    /// Rate at which its angular velocity decays [1/s]; 0 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub(super) angular_damping: Option<f64>,
    /// Constant force on its center of mass [N]; 0 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 2, max = 3))]
    pub(super) force: Option<Vec<f64>>,
    /// True if a dynamic body sleeps until an awake body touches it; false if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) start_asleep: Option<bool>,
    /// Velocity of its surface, such as of a conveyor belt, in the body's frame and about its
    /// origin; 0 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) surface_velocity: Option<SurfaceVelocityDocument>,
    /// Density [kg/m^3], in 2D [kg/m^2]; 1000 if there is no mass either.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) density: Option<f64>,
    /// Mass [kg] instead of a density, or "inf".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) mass: Option<Unbounded>,
    /// Center of mass in the body's frame [m]; follows from the shapes if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 2, max = 3))]
    pub(super) center_of_mass: Option<Vec<f64>>,
    /// Principal moments of inertia [kg m^2], in 2D a number, each possibly "inf"; follow from
    /// the shapes if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) inertia: Option<InertiaDocument>,
    /// Unit quaternion from the principal axes to the body's frame (3D).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) inertia_rotation: Option<[f64; 4]>,
    /// Name of a material of the scene; single values may be overridden here.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) material: Option<String>,
    #[serde(flatten)]
    pub(super) surface: SurfaceDocument,
    /// Collision filter; it collides with everything if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) collision: Option<CollisionDocument>,
    /// One shape, or several that make a compound.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schemars(default)]
    pub(super) shapes: Vec<ShapeDocument>,
    /// Prescribed poses; linear in between, held at the ends. A dynamic body follows them until the
    /// last, and is released with the velocity that it has then.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schemars(default)]
    pub(super) track: Vec<KeyDocument>,
    /// Anything; ignored.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) extras: Option<Value>,
}

/// 3D: about world axes [rad/s]. 2D: a number [rad/s].
#[derive(Serialize, JsonSchema)]
#[serde(untagged)]
#[schemars(rename = "Spin")]
pub(super) enum SpinDocument {
    Number(f64),
    Vector(Vec<f64>),
}

/// A linear velocity [m/s], or a table.
#[derive(Serialize, JsonSchema)]
#[serde(untagged)]
#[schemars(rename = "SurfaceVelocity")]
pub(super) enum SurfaceVelocityDocument {
    Linear(Vec<f64>),
    Table(SurfaceMotionDocument),
}

/// Velocity of a surface: linear + angular x r, with r from the origin of the body or shape.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "SurfaceMotion")]
pub(super) struct SurfaceMotionDocument {
    /// [m/s]; 0 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 2, max = 3))]
    pub(super) linear: Option<Vec<f64>>,
    /// [rad/s], in 2D a number; 0 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) angular: Option<SpinDocument>,
    /// True if its axes are those of the body or shape, and turn with it; false if they are those
    /// of the world. True if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) local: Option<bool>,
}

/// 3D: three principal moments [kg m^2]. 2D: one number [kg m^2].
#[derive(Serialize, JsonSchema)]
#[serde(untagged)]
#[schemars(rename = "Inertia")]
pub(super) enum InertiaDocument {
    Number(Unbounded),
    Principal(Vec<Unbounded>),
}

/// Systems by name, which shapes belong to and collide with.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Collision")]
pub(super) struct CollisionDocument {
    /// Systems that it is in.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schemars(default)]
    pub(super) systems: Vec<String>,
    /// It collides with these only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) collides_with: Option<Vec<String>>,
    /// It collides with all but these.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) not_collides_with: Option<Vec<String>>,
}

/// A pose at a time.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Key")]
pub(super) struct KeyDocument {
    /// Time [s]; above that of the key before.
    pub(super) time: f64,
    /// Position [m]; that of the body if absent.
    pub(super) position: Option<Vec<f64>>,
    /// Rotation; that of the body if absent.
    pub(super) rotation: Option<RotationDocument>,
}

/// A shape on a body.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Shape")]
pub(super) struct ShapeDocument {
    #[serde(flatten)]
    pub(super) kind: ShapeKind,
    /// Position in the body's frame [m]; its origin if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 2, max = 3))]
    pub(super) position: Option<Vec<f64>>,
    /// Rotation in the body's frame; none if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) rotation: Option<RotationDocument>,
    #[serde(flatten)]
    pub(super) surface: SurfaceDocument,
    /// Velocity of its surface, in the frame of the shape and about its origin, instead of that of
    /// the body.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) surface_velocity: Option<SurfaceVelocityDocument>,
    /// Collision filter, instead of that of the body.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) collision: Option<CollisionDocument>,
    /// Anything; ignored.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) extras: Option<Value>,
}
