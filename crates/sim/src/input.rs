//! [`InputError`]: values that a world rejects, and why.
//!
//! A number that is not finite would spread from contact to contact. Therefore bodies, settings,
//! forces and time steps are checked before anything is changed.

use std::fmt::{self, Display, Formatter};

use drystone_solver::{Vector, Velocity};

use crate::bodies::{Body, Inertia, SurfaceVelocity};
use crate::body::{Material, Motion};
use crate::geometry::{Bounds, Geometry};
use crate::joint::Coordinate;

/// Largest distance of a position from the origin along an axis, and largest extent of a
/// shape. \[m\]
const FAR: f64 = 1e9;

/// Largest speed \[m/s\] and angular velocity \[rad/s\].
const FAST: f64 = 1e12;

/// Largest mass, moment of inertia, force and torque, in SI units. The smallest mass is its
/// reciprocal.
const HEAVY: f64 = 1e18;

/// Longest time step. \[s\]
const LONG: f64 = 1e3;

/// A value that a world rejects. The world is then unchanged.
#[derive(Clone, Debug, PartialEq)]
pub enum InputError {
    /// No body of this world has the identifier: it was removed, or belongs to another world.
    UnknownBody,
    /// A number is out of its range, infinite or NaN.
    OutOfRange {
        /// Name of the number, with its unit.
        item: String,
        /// Its value.
        value: f64,
        /// Smallest and largest accepted value.
        accepted: [f64; 2],
    },
    /// A dynamic body has no inertia of its own, and its shapes have no mass: their density is 0,
    /// or they have no volume.
    NoMass,
    /// The shape has no contact detection: it would pass through everything.
    UnsupportedShape {
        /// Index of the collider in its body.
        collider: usize,
        /// Kind of the shape.
        shape: &'static str,
    },
    /// A joint cannot be what it is described to be.
    Joint(JointFault),
    /// The vertices of a mesh cannot be what they are asked to be.
    Mesh(MeshFault),
    /// The body is static or kinematic, or held: forces do not move it.
    NotDynamic,
    /// A static body has no velocity. Use [`World::set_pose`](crate::World::set_pose) to move it.
    Static,
}

/// Why the vertices of a mesh are rejected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MeshFault {
    /// No collider of this world has the identifier.
    Unknown,
    /// The shape of the collider is no triangle mesh.
    NotAMesh,
    /// The body of the mesh is not kinematic.
    NotKinematic,
    /// There are not as many numbers as the mesh has vertices.
    Vertices {
        /// Number of vertices of the mesh.
        expected: usize,
        /// Number of vertices given.
        found: usize,
    },
    /// A triangle has no area.
    FlatTriangle(usize),
}

impl Display for MeshFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => f.write_str(
                "the collider is not in this world: its body was removed, or is of another world",
            ),
            Self::NotAMesh => {
                f.write_str("the collider is no triangle mesh; accepted: a triangle mesh of 3D")
            }
            Self::NotKinematic => f.write_str(
                "the body of the mesh is not kinematic; accepted: a mesh of a kinematic body",
            ),
            Self::Vertices { expected, found } => {
                write!(f, "{found} vertices are given; accepted: {expected}, as the mesh has")
            }
            Self::FlatTriangle(triangle) => write!(
                f,
                "triangle {triangle} of the mesh has no area with these vertices; accepted: three \
                 corners that are not on one line"
            ),
        }
    }
}

/// Why a joint is rejected.
#[derive(Clone, Debug, PartialEq)]
pub enum JointFault {
    /// No joint of this world has the identifier.
    Unknown,
    /// Both bodies are the same.
    SameBody,
    /// Neither body is dynamic.
    NothingMoves,
    /// Joints of this dimension have no such coordinate, or its numbers are out of range.
    NoSuchCoordinate(Coordinate),
    /// Two axes have this coordinate.
    Twice(Coordinate),
    /// The lower limit is above the upper one, or NaN.
    Limits([f64; 2]),
    /// All axes are locked, so none can be driven.
    Locked,
}

impl Display for JointFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => f.write_str(
                "the joint is not in this world: it was removed, or is of another world",
            ),
            Self::SameBody => f.write_str(
                "both bodies of the joint are the same; accepted: two bodies, or one and the world",
            ),
            Self::NothingMoves => f.write_str(
                "neither body of the joint is dynamic; accepted: at least one dynamic body",
            ),
            Self::NoSuchCoordinate(coordinate) => write!(
                f,
                "a joint of this world has no coordinate {coordinate:?}; accepted: Linear below the \
                 dimension, Distance, and Angle in the plane or the rotations of space"
            ),
            Self::Twice(coordinate) => {
                write!(f, "two axes of the joint are {coordinate:?}; accepted: one axis for each")
            }
            Self::Limits([low, high]) => write!(
                f,
                "the limits of the joint are {low} and {high}; accepted: a lower one up to the upper"
            ),
            Self::Locked => {
                f.write_str("all axes of the joint are locked; accepted: a drive on a free axis")
            }
        }
    }
}

impl Display for InputError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownBody => {
                f.write_str("the body is not in this world: it was removed, or is of another world")
            }
            Self::OutOfRange { item, value, accepted: [least, most] } => {
                write!(f, "{item} is {value}; accepted: ")?;
                match (*least, *most) {
                    (f64::MIN, f64::MAX) => f.write_str("a finite number"),
                    (f64::MIN_POSITIVE, f64::MAX) => f.write_str("a finite number above 0"),
                    (least, f64::MAX) => write!(f, "a finite number from {least}"),
                    (f64::MIN_POSITIVE, most) => write!(f, "above 0, to {most}"),
                    (least, most) => write!(f, "from {least} to {most}"),
                }
            }
            Self::NoMass => f.write_str(
                "the shapes of the dynamic body have no mass; \
                 accepted: a density above 0 and a shape with a volume, or an inertia of its own",
            ),
            Self::UnsupportedShape { collider, shape } => write!(
                f,
                "collider {collider} is a {shape}, which touches nothing; \
                 accepted: ball, box, capsule, cylinder, cone, convex hull, half-space, \
                 triangle mesh, one per collider"
            ),
            Self::Joint(fault) => write!(f, "{fault}"),
            Self::Mesh(fault) => write!(f, "{fault}"),
            Self::NotDynamic => {
                f.write_str("the body is not dynamic; accepted: a dynamic body that is not held")
            }
            Self::Static => f.write_str(
                "the body is static and has no velocity; \
                 accepted: a dynamic or kinematic body, or set_pose",
            ),
        }
    }
}

impl std::error::Error for InputError {}

type Checked = Result<(), InputError>;

/// Rejects a speed of a vertex that is too large. \[m/s\]
pub(crate) fn check_vertex_speed(speed: f32) -> Checked {
    within("the speed of a vertex [m/s]", f64::from(speed), [0.0, FAST])
}

/// Rejects a number outside of these bounds, or NaN.
pub(crate) fn within(item: impl Display, value: f64, [least, most]: [f64; 2]) -> Checked {
    if least <= value && value <= most {
        return Ok(());
    }
    Err(InputError::OutOfRange { item: item.to_string(), value, accepted: [least, most] })
}

fn all_within<const N: usize>(item: &str, of: &Vector<f32, N>, most: f64) -> Checked {
    of.0.iter().try_for_each(|&number| within(item, f64::from(number), [-most, most]))
}

/// Rejects a velocity that is too large.
pub(crate) fn check_velocity<const L: usize, const A: usize>(
    velocity: &Velocity<f32, L, A>,
) -> Checked {
    all_within("the velocity [m/s]", &velocity.linear, FAST)?;
    all_within("the angular velocity [rad/s]", &velocity.angular, FAST)
}

/// Rejects a force or torque that is too large.
pub(crate) fn check_force<const L: usize, const A: usize>(force: &Velocity<f32, L, A>) -> Checked {
    all_within("the force [N]", &force.linear, HEAVY)?;
    all_within("the torque [N m]", &force.angular, HEAVY)
}

/// Rejects negative damping.
pub(crate) fn check_damping(damping: [f32; 2]) -> Checked {
    damping.iter().try_for_each(|&rate| within("the damping [1/s]", f64::from(rate), [0.0, FAST]))
}

/// Rejects a negative or too long time step.
pub(crate) fn check_time(dt: f32) -> Checked {
    within("the time step [s]", f64::from(dt), [0.0, LONG])
}

/// Rejects gravity that is too large or not finite.
pub(crate) fn check_gravity<const L: usize>(gravity: &Vector<f32, L>) -> Checked {
    all_within("gravity [m/s^2]", gravity, FAST)
}

/// Rejects a surface velocity that is too large.
pub(crate) fn check_surface<const L: usize, const A: usize>(
    motion: Option<&SurfaceVelocity<L, A>>,
) -> Checked {
    motion.map_or(Ok(()), |&SurfaceVelocity { linear, angular, .. }| {
        check_velocity(&Velocity { linear, angular })
    })
}

/// Rejects a pose that is too far from the origin, or whose rotation is invalid.
pub(crate) fn check_pose<G: Geometry<L, A>, const L: usize, const A: usize>(
    pose: &G::Pose,
) -> Checked {
    let frame = G::frame(pose);
    all_within("the position [m]", &frame.position, FAR)?;
    frame.axes.iter().try_for_each(|axis| {
        within("the length of the rotation", f64::from(axis.dot(*axis)).sqrt(), [0.99, 1.01])
    })
}

/// Rejects a point that is too far from the origin.
pub(crate) fn check_point<const L: usize>(point: &Vector<f32, L>) -> Checked {
    all_within("the point [m]", point, FAR)
}

/// Rejects a box with a NaN.
pub(crate) fn check_box<const L: usize>(bounds: &Bounds<L>) -> Checked {
    all_within("a corner of the box [m]", &bounds.min, f64::INFINITY)?;
    all_within("a corner of the box [m]", &bounds.max, f64::INFINITY)
}

/// Rejects a ray from too far away, without a direction or of a negative length. Returns the length
/// of the direction.
pub(crate) fn check_ray<const L: usize>(
    origin: &Vector<f32, L>,
    direction: &Vector<f32, L>,
    max_distance: f32,
) -> Result<f64, InputError> {
    all_within("the origin of the ray [m]", origin, FAR)?;
    let direction: Vector<f64, L> = direction.cast();
    let length = direction.length();
    within("the length of the direction", length, [1.0 / HEAVY, HEAVY])?;
    within("the largest distance [m]", f64::from(max_distance), [0.0, f64::INFINITY])?;
    Ok(length)
}

fn check_inertia<const L: usize, const A: usize>(inertia: &Inertia<L, A>) -> Checked {
    // A body of infinite mass is moved by no force.
    if inertia.mass != f32::INFINITY {
        within("the mass [kg]", f64::from(inertia.mass), [1.0 / HEAVY, HEAVY])?;
    }
    all_within("the center of mass [m]", &inertia.center, FAR)?;
    for (moments, inverse) in inertia.moments.0.iter().zip(&inertia.inverse_moments.0) {
        all_within("the moments of inertia [kg m^2]", moments, HEAVY * 1e12)?;
        all_within("the inverse moments of inertia [1/(kg m^2)]", inverse, f64::from(f32::MAX))?;
    }
    Ok(())
}

fn check_material(material: &Material) -> Checked {
    within("the friction [1]", material.friction, [0.0, FAST])?;
    within("the restitution [1]", material.restitution, [0.0, 1.0])?;
    within("the rolling resistance [m]", material.rolling_resistance, [0.0, FAR])?;
    within("the spinning resistance [m]", material.spinning_resistance, [0.0, FAR])
}

/// Rejects a body with a value out of range. `inertia` is its own, or that of its shapes.
pub(crate) fn check_body<G: Geometry<L, A>, const L: usize, const A: usize>(
    body: &Body<G, L, A>,
    inertia: &Inertia<L, A>,
) -> Checked {
    check_pose::<G, L, A>(&body.pose)?;
    check_velocity(&body.velocity)?;
    check_damping(body.damping)?;
    check_surface(body.surface_velocity.as_ref())?;
    within("the gravity factor [1]", f64::from(body.gravity_factor), [-FAST, FAST])?;
    for (index, collider) in body.colliders.iter().enumerate() {
        check_pose::<G, L, A>(&collider.pose)?;
        check_surface(collider.surface_velocity.as_ref())?;
        check_material(&collider.material)?;
        within("the density", f64::from(collider.density), [0.0, HEAVY])?;
        if let Some(shape) = G::unsupported(&collider.shape) {
            return Err(InputError::UnsupportedShape { collider: index, shape });
        }
        if let Some(extent) = G::extent(&collider.shape) {
            let item = format!("the size of collider {index} [m]");
            within(item, f64::from(extent), [f64::from(f32::MIN_POSITIVE), FAR])?;
        }
    }
    if body.motion == Motion::Dynamic {
        if body.inertia.is_none() && inertia.mass == 0.0 {
            return Err(InputError::NoMass);
        }
        check_inertia(inertia)?;
    }
    Ok(())
}
