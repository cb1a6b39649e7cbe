//! Joints as scenes have them.

use schemars::JsonSchema;
use serde::{Serialize, Serializer};
use serde_json::Value;

use super::values::{RotationDocument, Unbounded};

/// A joint between two bodies, or between a body and the world. It has a frame in each; its type
/// says which coordinates of the one relative to the other are locked, and which are free. A world
/// direction or point is one at the start. Angles are in radians.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Joint")]
pub(crate) struct JointDocument {
    #[serde(flatten)]
    pub(crate) kind: JointKindDocument,
    /// Its name, unique among the joints of the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) name: Option<String>,
    /// One or two bodies, by name or index. The world is left out, or -1.
    #[schemars(length(min = 1, max = 2))]
    pub(crate) bodies: Vec<BodyReference>,
    /// Points of the joint in the frames of its bodies [m], in the world for the world; the
    /// directions stay those of the world at the start. Joints without `anchor` take the origins of
    /// their bodies if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 2, max = 2))]
    pub(crate) anchors: Option<Vec<Vec<f64>>>,
    /// Frames of the joint in its bodies, instead of all points and directions.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 2, max = 2))]
    pub(crate) frames: Option<Vec<FrameDocument>>,
    /// Loads at which it breaks; it never does if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) breaking: Option<BreakingDocument>,
    /// True if its bodies collide with each other; false if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) collide: Option<bool>,
    /// False if it does nothing; true if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) enabled: Option<bool>,
    /// Anything; ignored.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) extras: Option<Value>,
}

/// A body by name or index; -1 is the world.
#[derive(Serialize, JsonSchema)]
#[serde(untagged)]
pub(crate) enum BodyReference {
    Name(String),
    Index(i64),
}

/// Types of joints. Scenes are written with the type "general", which can express all others.
#[derive(Serialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
#[allow(dead_code, reason = "the schema lists what a scene may say")]
pub(crate) enum JointKindDocument {
    /// Locks everything.
    Fixed {
        #[serde(flatten)]
        anchor: AnchorDocument,
    },
    /// Ball and socket: locks the position, and leaves the rotation free (3D).
    Ball {
        #[serde(flatten)]
        anchor: AnchorDocument,
        #[serde(flatten)]
        axes: AxesDocument,
        twist: Option<CoordinateDocument>,
        swing_y: Option<CoordinateDocument>,
        swing_z: Option<CoordinateDocument>,
        cone: Option<CoordinateDocument>,
        elliptic_cone: Option<EllipticConeDocument>,
        rotation: Option<CoordinateDocument>,
    },
    /// Lets the first body turn about an axis of the second. Limits, springs and motors are those
    /// of the angle, which counts turns.
    Hinge {
        #[serde(flatten)]
        anchor: AnchorDocument,
        #[serde(flatten)]
        axis: AxisDirectionDocument,
        #[serde(flatten)]
        angle: AxisDocument,
    },
    /// Lets the first body slide along an axis of the second. Limits, springs and motors are those
    /// of the position.
    Slider {
        #[serde(flatten)]
        anchor: AnchorDocument,
        #[serde(flatten)]
        axis: AxisDirectionDocument,
        #[serde(flatten)]
        position: AxisDocument,
    },
    /// A slider that also turns about its axis (3D).
    Piston {
        #[serde(flatten)]
        anchor: AnchorDocument,
        #[serde(flatten)]
        axis: AxisDirectionDocument,
        #[serde(flatten)]
        position: AxisDocument,
        /// Angle about the axis.
        twist: Option<CoordinateDocument>,
    },
    /// Universal joint: keeps an axis of the first body perpendicular to one of the second (3D).
    Universal {
        #[serde(flatten)]
        anchor: AnchorDocument,
        /// Directions of the axis of the first body and of that of the second in the world:
        /// perpendicular.
        #[schemars(length(min = 2, max = 2))]
        axes: Option<Vec<[f64; 3]>>,
        /// Angle about the axis of the first body.
        twist: Option<CoordinateDocument>,
        /// Angle about the axis of the second body.
        swing_z: Option<CoordinateDocument>,
    },
    /// Keeps the first body in a plane of the second, with normal `axis` (3D).
    Planar {
        #[serde(flatten)]
        anchor: AnchorDocument,
        #[serde(flatten)]
        axes: AxesDocument,
        y: Option<CoordinateDocument>,
        z: Option<CoordinateDocument>,
        /// Angle about the normal.
        twist: Option<CoordinateDocument>,
    },
    /// A wheel, the first body, on a vehicle, the second. Limits and spring are those of the
    /// suspension, motor, drives and friction those of the spin.
    Wheel {
        #[serde(flatten)]
        anchor: AnchorDocument,
        #[serde(flatten)]
        axis: AxisDirectionDocument,
        /// Direction of the suspension in the world: perpendicular to the axis.
        #[schemars(length(min = 2, max = 3))]
        suspension: Option<Vec<f64>>,
        #[serde(flatten)]
        travel: AxisDocument,
        /// Angle about the suspension (3D); locked if absent.
        steering: Option<CoordinateDocument>,
    },
    /// Locks the position of a particle.
    Point {
        #[serde(flatten)]
        anchor: AnchorDocument,
    },
    /// Keeps the distance of two points.
    Distance {
        #[serde(flatten)]
        length: LengthDocument,
        #[serde(flatten)]
        limit: LimitDocument,
    },
    /// Keeps two points from parting by more than a length.
    Rope {
        #[serde(flatten)]
        length: LengthDocument,
        #[serde(flatten)]
        softness: SoftnessDocument,
    },
    /// Spring between two points.
    Spring {
        #[serde(flatten)]
        spring: SpringDocument,
        #[serde(flatten)]
        limit: LimitDocument,
    },
    /// Any coordinates.
    General {
        #[serde(flatten)]
        coordinates: Box<GeneralDocument>,
    },
    /// Couples two rotations: angle of a plus `ratio` times that of b is constant, each about the x
    /// axis of its frame.
    Gear {
        #[serde(flatten)]
        axes: CouplingAxesDocument,
        /// Turns of the first body per turn of the second, in the opposite sense [1].
        ratio: f64,
        #[serde(flatten)]
        angle: AxisDocument,
    },
    /// Couples the rotation of the first body with the displacement of the second: angle times
    /// `radius`, plus displacement, is constant.
    Rack {
        #[serde(flatten)]
        axes: CouplingAxesDocument,
        /// Radius of the pinion [m].
        radius: f64,
        #[serde(flatten)]
        position: AxisDocument,
    },
    /// A nut, the first body, on a bolt, the second (3D).
    Screw {
        #[serde(flatten)]
        anchor: AnchorDocument,
        #[serde(flatten)]
        axis: AxisDirectionDocument,
        /// Advance per turn [m].
        pitch: f64,
        /// Position along the axis.
        x: Option<CoordinateDocument>,
        /// Angle about the axis.
        twist: Option<CoordinateDocument>,
    },
    /// A rope from the first body over two points of the world to the second.
    Pulley {
        #[serde(flatten)]
        points: PulleyPointsDocument,
        /// Length of the rope [m], that on the side of the second body times `ratio`; that at the
        /// start if absent.
        length: Option<f64>,
        #[serde(flatten)]
        limit: LimitDocument,
        /// Largest force of dry friction [N]; 0 if absent.
        friction: Option<f64>,
    },
}

/// Where a joint is.
#[derive(Serialize, JsonSchema, Default)]
pub(crate) struct AnchorDocument {
    /// Point of the joint in the world [m]; the origin of the first body if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 2, max = 3))]
    anchor: Option<Vec<f64>>,
}

/// Direction of a joint.
#[derive(Serialize, JsonSchema, Default)]
pub(crate) struct AxisDirectionDocument {
    /// Direction of the x axis of the joint in the world, of any length.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 2, max = 3))]
    axis: Option<Vec<f64>>,
}

/// Directions of a joint.
#[derive(Serialize, JsonSchema, Default)]
pub(crate) struct AxesDocument {
    /// Direction of the x axis of the joint in the world, of any length; x if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 2, max = 3))]
    axis: Option<Vec<f64>>,
    /// Direction of its y axis, made perpendicular to the first (3D).
    #[serde(skip_serializing_if = "Option::is_none")]
    axis_y: Option<[f64; 3]>,
}

/// Directions of a coupling.
#[derive(Serialize, JsonSchema)]
pub(crate) struct CouplingAxesDocument {
    /// Direction of the x axis of both frames in the world. In 2D, only a rack has one.
    axis: Option<Vec<f64>>,
    /// Directions of the x axes of the two frames in the world (3D).
    #[schemars(length(min = 2, max = 2))]
    axes: Option<Vec<[f64; 3]>>,
}

/// Length of a joint.
#[derive(Serialize, JsonSchema)]
pub(crate) struct LengthDocument {
    /// Distance of the points [m], at most; that at the start if absent.
    #[schemars(range(min = 0.0, max = 1e6))]
    length: Option<f64>,
}

/// A frame in a body, or in the world.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Frame")]
pub(crate) struct FrameDocument {
    /// Its origin [m]; that of the body if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 2, max = 3))]
    pub(crate) position: Option<Vec<f64>>,
    /// Rotation from its axes to those of the body; none if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) rotation: Option<RotationDocument>,
}

/// Loads at which a joint breaks.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Breaking")]
pub(crate) struct BreakingDocument {
    /// Mean force over a step [N].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) force: Option<Unbounded>,
    /// Mean torque over a step [N m].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) torque: Option<Unbounded>,
    /// Largest impulse in a step [N s].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) impulse: Option<Unbounded>,
}

/// A joint of any coordinates. Those that are absent are free.
#[derive(Serialize, JsonSchema, Default)]
pub(crate) struct GeneralDocument {
    #[serde(flatten)]
    pub(crate) anchor: AnchorDocument,
    #[serde(flatten)]
    pub(crate) axes: AxesDocument,
    /// Position along the x axis of the second frame [m].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) x: Option<CoordinateDocument>,
    /// Position along its y axis [m].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) y: Option<CoordinateDocument>,
    /// Position along its z axis [m].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) z: Option<CoordinateDocument>,
    /// Distance from its x axis [m].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) radial_x: Option<CoordinateDocument>,
    /// Distance from its y axis [m].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) radial_y: Option<CoordinateDocument>,
    /// Distance from its z axis [m].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) radial_z: Option<CoordinateDocument>,
    /// Distance of the two origins [m].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) distance: Option<CoordinateDocument>,
    /// Angle in 2D.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) angle: Option<CoordinateDocument>,
    /// Rotation about x: the twist of the swing-twist decomposition.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) twist: Option<CoordinateDocument>,
    /// Inclination of the x axis by rotation about y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) swing_y: Option<CoordinateDocument>,
    /// Inclination of the x axis by rotation about z.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) swing_z: Option<CoordinateDocument>,
    /// Angle between the two x axes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) cone: Option<CoordinateDocument>,
    /// Angle between the two x axes over the half-angle in its direction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) elliptic_cone: Option<EllipticConeDocument>,
    /// Angle of the whole rotation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) rotation: Option<CoordinateDocument>,
    /// Cardan angle about x, the first of the order x, y, z.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) angle_x: Option<CoordinateDocument>,
    /// Cardan angle about y, singular at 90 degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) angle_y: Option<CoordinateDocument>,
    /// Cardan angle about z.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) angle_z: Option<CoordinateDocument>,
    /// Rotation of a plus `ratio` times that of b.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) gear: Option<GearDocument>,
    /// Rotation of a times `radius` plus displacement of b.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) rack: Option<RackDocument>,
    /// Position along x minus `pitch` times the turns about it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) screw: Option<ScrewDocument>,
    /// Length of a rope over two points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) pulley: Option<PulleyDocument>,
    /// Order of the rows, as a list of all coordinates above; that of this list if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) order: Option<Vec<&'static str>>,
}

/// Limits of a coordinate, or a table that also has springs, motors and friction.
#[derive(Serialize, JsonSchema)]
#[serde(untagged)]
#[schemars(rename = "Coordinate")]
pub(crate) enum CoordinateDocument {
    Word(Freedom),
    Limits([Limit; 2]),
    Table(Box<PlainAxisDocument>),
}

/// "locked": it stays 0. "free": nothing holds it.
#[derive(Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Freedom {
    Locked,
    Free,
}

/// Least and largest value, or a word.
#[derive(Serialize, JsonSchema)]
#[serde(untagged)]
#[schemars(rename = "Limits")]
pub(crate) enum LimitsDocument {
    Word(Freedom),
    Numbers([Limit; 2]),
}

/// A limit, which may be infinite; JSON has no number for infinity.
#[derive(JsonSchema)]
#[schemars(untagged)]
#[allow(dead_code, reason = "the schema shows both forms; writing chooses by value")]
pub(crate) enum Limit {
    Number(f64),
    Infinite(InfiniteLimit),
}

/// "inf" or "-inf".
#[derive(JsonSchema)]
#[allow(dead_code, reason = "as above")]
pub(crate) enum InfiniteLimit {
    #[schemars(rename = "inf")]
    Above,
    #[schemars(rename = "-inf")]
    Below,
}

impl Serialize for Limit {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Limit::Number(x) if x.is_finite() => serializer.serialize_f64(*x),
            Limit::Number(x) if *x < 0.0 => serializer.serialize_str("-inf"),
            _ => serializer.serialize_str("inf"),
        }
    }
}

/// A coordinate with limits, springs, motors and friction.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Axis")]
pub(crate) struct PlainAxisDocument {
    #[serde(flatten)]
    pub(crate) axis: AxisDocument,
}

/// Limits of a coordinate.
#[derive(Serialize, JsonSchema)]
pub(crate) struct LimitDocument {
    /// Least and largest value [m, or rad], each possibly infinite.
    #[serde(skip_serializing_if = "Option::is_none")]
    limits: Option<LimitsDocument>,
    #[serde(flatten)]
    softness: SoftnessDocument,
}

/// Softness of limits.
#[derive(Serialize, JsonSchema)]
pub(crate) struct SoftnessDocument {
    /// Stiffness of limits and locks [N/m, or N m/rad]; as stiff as the engine can if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1e20))]
    limit_stiffness: Option<f64>,
    /// Damping of limits and locks, beside a stiffness [N s/m, or N m s/rad]; 0 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1e20))]
    limit_damping: Option<f64>,
}

/// Limits, springs, motors and friction of a coordinate.
#[derive(Serialize, JsonSchema, Default)]
pub(crate) struct AxisDocument {
    /// Least and largest value [m, or rad], each possibly infinite.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) limits: Option<LimitsDocument>,
    /// Stiffness of limits and locks [N/m, or N m/rad]; as stiff as the engine can if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1e20))]
    pub(crate) limit_stiffness: Option<f64>,
    /// Damping of limits and locks, beside a stiffness [N s/m, or N m s/rad]; 0 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1e20))]
    pub(crate) limit_damping: Option<f64>,
    /// A spring.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) spring: Option<SpringTable>,
    /// A motor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) motor: Option<MotorDocument>,
    /// Further springs and motors, each number by itself.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schemars(default)]
    pub(crate) drives: Vec<DriveDocument>,
    /// Largest force of dry friction [N, or N m]; 0 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1e20))]
    pub(crate) friction: Option<f64>,
}

/// A spring: F = stiffness (rest - q) - damping dq/dt.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Spring")]
pub(crate) struct SpringTable {
    #[serde(flatten)]
    spring: SpringDocument,
}

/// A spring: F = stiffness (rest - q) - damping dq/dt.
#[derive(Serialize, JsonSchema)]
pub(crate) struct SpringDocument {
    #[serde(flatten)]
    stiffness: StiffnessDocument,
    /// Value at which it is relaxed [m, or rad]; 0 if absent, or the distance at the start.
    rest: Option<f64>,
    /// Largest force [N, or N m]; "inf" if absent.
    at_most: Option<Unbounded>,
}

/// Stiffness and damping, or frequency and damping ratio.
#[derive(Serialize, JsonSchema)]
pub(crate) struct StiffnessDocument {
    /// Stiffness [N/m, or N m/rad]; 0 if absent.
    #[schemars(range(min = 0.0, max = 1e20))]
    stiffness: Option<f64>,
    /// Damping [N s/m, or N m s/rad]; 0 if absent. A motor with a velocity alone keeps it if
    /// absent.
    damping: Option<Unbounded>,
    /// Frequency of oscillations [Hz], instead of a stiffness.
    #[schemars(range(min = 0.0, max = 1e6))]
    frequency: Option<f64>,
    /// Damping over critical damping, beside a frequency [1]; 0 if absent.
    #[schemars(range(min = 0.0, max = 1e6))]
    damping_ratio: Option<f64>,
    /// "acceleration" if stiffness and damping are per unit of effective mass; "force" if absent.
    mode: Option<Mode>,
}

/// A motor that seeks a velocity, or a position beside a stiffness or a frequency.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Motor")]
pub(crate) struct MotorDocument {
    /// Velocity [m/s, or rad/s]; 0 if absent.
    velocity: Option<f64>,
    /// Position [m, or rad].
    position: Option<f64>,
    #[serde(flatten)]
    stiffness: StiffnessDocument,
    /// Largest force [N, or N m]; "inf" if absent.
    at_most: Option<Unbounded>,
}

/// A drive: F = stiffness (position - q) + damping (velocity - dq/dt).
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Drive")]
pub(crate) struct DriveDocument {
    /// [m, or rad]; 0 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) position: Option<f64>,
    /// [m/s, or rad/s]; 0 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) velocity: Option<f64>,
    /// [N/m, or N m/rad]; 0 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) stiffness: Option<f64>,
    /// [N s/m, or N m s/rad]; 0 if absent. With "inf" it keeps its velocity as far as its force
    /// allows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) damping: Option<Unbounded>,
    /// "acceleration" if stiffness and damping are per unit of effective mass; "force" if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) mode: Option<Mode>,
    /// Largest force [N, or N m]; "inf" if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) at_most: Option<Unbounded>,
}

/// Unit of stiffness and damping: those of a force, or of an acceleration.
#[derive(Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[allow(dead_code, reason = "the schema lists what a scene may say")]
pub(crate) enum Mode {
    Force,
    Acceleration,
}

/// An elliptic cone; limits [0, 1] if absent.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "EllipticCone")]
pub(crate) struct EllipticConeDocument {
    /// Half-angles about y and z.
    pub(crate) half_angles: [f64; 2],
    #[serde(flatten)]
    pub(crate) axis: AxisDocument,
}

/// A gear; locked if it has no limits.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Gear")]
pub(crate) struct GearDocument {
    /// Turns of a per turn of b, in the opposite sense [1].
    pub(crate) ratio: f64,
    #[serde(flatten)]
    pub(crate) axis: AxisDocument,
}

/// A rack; locked if it has no limits.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Rack")]
pub(crate) struct RackDocument {
    /// Radius of the pinion [m].
    pub(crate) radius: f64,
    #[serde(flatten)]
    pub(crate) axis: AxisDocument,
}

/// A screw; locked if it has no limits.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Screw")]
pub(crate) struct ScrewDocument {
    /// Advance per turn [m].
    pub(crate) pitch: f64,
    #[serde(flatten)]
    pub(crate) axis: AxisDocument,
}

/// A rope over two points; its limits are those of its length [m].
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Pulley")]
pub(crate) struct PulleyDocument {
    #[serde(flatten)]
    pub(crate) points: PulleyPointsDocument,
    #[serde(flatten)]
    pub(crate) axis: AxisDocument,
}

/// Points of a pulley.
#[derive(Serialize, JsonSchema)]
pub(crate) struct PulleyPointsDocument {
    /// Points of the world [m] that the rope runs over, on the side of each body.
    #[schemars(length(min = 2, max = 2))]
    pub(crate) points: Vec<Vec<f64>>,
    /// Weight of the rope on the side of the second body [1]; 1 if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) ratio: Option<f64>,
}
