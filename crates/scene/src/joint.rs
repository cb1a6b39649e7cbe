//! [`Joint`]: what holds two bodies together, or a body to the world.
//!
//! A joint has a frame in each of its bodies. [Coordinates](Coordinate) say how the frame in a lies
//! relative to the frame in b. An [axis](JointAxis) of the joint is a coordinate that is locked,
//! limited, driven or braked; all other coordinates are free.

use crate::rotation::Rotation;

/// A joint between two bodies, or between a body and the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name, unique among the joints of the scene.
    pub name: Option<String>,
    /// Bodies a and b, as indices into the bodies of the scene; the world if absent. They differ.
    pub bodies: [Option<usize>; 2],
    /// Frame of the joint in a and in b; in the world where the body is absent.
    pub frames: [JointFrame; 2],
    /// Coordinates that are locked, limited, driven or braked. Each appears at most once.
    pub axes: Vec<JointAxis>,
    /// Loads at which the joint breaks.
    pub breaking: Breaking,
    /// True if the shapes of the two bodies collide with each other.
    pub collide: bool,
    /// False if the joint does nothing.
    pub enabled: bool,
}

/// A frame of a joint.
#[derive(Clone, Debug, PartialEq)]
pub struct JointFrame {
    /// Position of its origin in the frame of the body. \[m\]
    pub position: Vec<f64>,
    /// Rotation from its axes to those of the body.
    pub rotation: Rotation,
}

/// A coordinate of frame a relative to frame b.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coordinate {
    /// Position along axis 0, 1 or 2 of frame b. \[m\]
    Linear(usize),
    /// Distance from the line through the origin of frame b along its axis 0, 1 or 2. \[m\]
    Radial(usize),
    /// Distance of the two origins. \[m\]
    Distance,
    /// Angle of rotation in the plane. \[rad\]
    Angle,
    /// Rotation about x: the twist of the swing-twist decomposition. It counts turns. \[rad\]
    Twist,
    /// Inclination of the x axis by rotation about axis 1 or 2 of frame b: 2 atan2(q_i, q_w) of the
    /// shortest rotation q that takes x to where it is. \[rad\]
    Swing(usize),
    /// Angle between the two x axes. \[rad\]
    Cone,
    /// Angle between the two x axes, as a multiple of the limit in its direction: an ellipse with
    /// these half-angles about axes 1 and 2 of frame b. \[1\]
    EllipticCone([f64; 2]),
    /// Angle of the whole relative rotation. \[rad\]
    Rotation,
    /// Angle 0, 1 or 2 about x, y and z, where frame a turns about x, then y, then z of frame b:
    /// Cardan angles. Singular at 90 degrees of the middle one. \[rad\]
    Cardan(usize),
    /// Rotation of a about the x axis of its frame, plus `ratio` times that of b about its own,
    /// both since the start and in the world. \[rad\]
    Gear {
        /// Turns of a per turn of b, with the opposite sense. \[1\]
        ratio: f64,
    },
    /// Rotation of a about the x axis of its frame, times `radius`, plus the displacement of b
    /// along the x axis that its frame had at the start, both in the world and since
    /// then. \[m\]
    Rack {
        /// Radius of the pinion. \[m\]
        radius: f64,
    },
    /// Position along x minus `pitch` times the turns about it. \[m\]
    Screw {
        /// Advance per turn. \[m\]
        pitch: f64,
    },
    /// Distance of the origin of frame a from a point of the world, plus `ratio` times that of
    /// frame b from another. \[m\]
    Pulley {
        /// The two points. \[m\]
        points: [[f64; 3]; 2],
        /// Factor of the distance on the side of b. \[1\]
        ratio: f64,
    },
}

impl Coordinate {
    /// Returns its name, which is its key in scenes.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Linear(0) => "x",
            Self::Linear(1) => "y",
            Self::Linear(_) => "z",
            Self::Radial(0) => "radial_x",
            Self::Radial(1) => "radial_y",
            Self::Radial(_) => "radial_z",
            Self::Distance => "distance",
            Self::Angle => "angle",
            Self::Twist => "twist",
            Self::Swing(1) => "swing_y",
            Self::Swing(_) => "swing_z",
            Self::Cone => "cone",
            Self::EllipticCone(_) => "elliptic_cone",
            Self::Rotation => "rotation",
            Self::Cardan(0) => "angle_x",
            Self::Cardan(1) => "angle_y",
            Self::Cardan(_) => "angle_z",
            Self::Gear { .. } => "gear",
            Self::Rack { .. } => "rack",
            Self::Screw { .. } => "screw",
            Self::Pulley { .. } => "pulley",
        }
    }
}

/// A coordinate that is locked, limited, driven or braked.
#[derive(Clone, Debug, PartialEq)]
pub struct JointAxis {
    /// The coordinate q.
    pub coordinate: Coordinate,
    /// Least and largest q, which may be infinite; equal if q is locked.
    pub limits: Option<[f64; 2]>,
    /// Stiffness and damping of the limits or the lock. If absent, the setting `stretch` says how
    /// far they yield.
    pub softness: Option<Softness>,
    /// Springs and motors.
    pub drives: Vec<Drive>,
    /// Largest force of dry friction. \[N, or N m\]
    pub friction: f64,
}

/// A soft limit: F = -stiffness (q - limit) - damping dq/dt beyond it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Softness {
    /// \[N/m, or N m/rad\]
    pub stiffness: f64,
    /// \[N s/m, or N m s/rad\]
    pub damping: f64,
}

/// A spring or a motor: F = stiffness (position - q) + damping (velocity - dq/dt), at most
/// `max_force`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// \[m, or rad\]
    pub position: f64,
    /// \[m/s, or rad/s\]
    pub velocity: f64,
    /// \[N/m, or N m/rad\]
    pub stiffness: f64,
    /// Infinite for a motor that keeps its velocity as far as its force allows.
    /// \[N s/m, or N m s/rad\]
    pub damping: f64,
    /// May be infinite. \[N, or N m\]
    pub max_force: f64,
    /// True if stiffness and damping are per unit of effective mass: accelerations.
    pub acceleration: bool,
}

/// Loads at which a joint breaks; absent ones never break it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Breaking {
    /// Mean force over a step. \[N\]
    pub force: Option<f64>,
    /// Mean torque over a step. \[N m\]
    pub torque: Option<f64>,
    /// Length of the impulse in a step. \[N s\]
    pub impulse: Option<f64>,
}
