//! [`Joint`]: what holds two bodies together, or a body to the world.
//!
//! A joint has a frame in each of its bodies. [Coordinates](Coordinate) say how the frame in a lies
//! relative to the frame in b. An [axis](JointAxis) is a coordinate that is locked, limited, driven
//! or braked; all others are free. Every kind of joint is a list of axes:
//!
//! | Joint | Locked | Free |
//! |---|---|---|
//! | [`fixed`](Joint::fixed) | all | |
//! | [`ball`](Joint::ball) | position | rotation |
//! | [`hinge`](Joint::hinge) | position, y and z of rotation | rotation about x |
//! | [`slider`](Joint::slider) | y and z, rotation | position along x |
//! | [`piston`](Joint::piston) | y and z, y and z of rotation | position along x, rotation about it |
//! | [`universal`](Joint::universal) | position, rotation about x | rotation about y and z |
//! | [`planar`](Joint::planar) | x, y and z of rotation | y and z, rotation about x |
//! | [`distance`](Joint::distance), [`rope`](Joint::rope), [`spring`](Joint::spring) | distance of two points | |

pub(crate) mod coordinates;
pub(crate) mod linkage;
pub(crate) mod places;
pub(crate) mod record;
pub(crate) mod repair;
pub(crate) mod rows;
pub(crate) mod springs;
pub(crate) mod taming;
pub(crate) mod tension;
pub(crate) mod turning;

use crate::geometry::Geometry;
use crate::ids::BodyId;

/// A joint between two bodies, or between a body and the world, to be added to a world
/// ([`World::join`](crate::World::join)).
#[derive(Clone, Debug)]
pub struct Joint<G: Geometry<L, A>, const L: usize, const A: usize> {
    /// Bodies a and b; the world if absent. They differ.
    pub bodies: [Option<BodyId>; 2],
    /// Frame of the joint in both bodies.
    pub frames: JointFrames<G::Pose>,
    /// Coordinates that are locked, limited, driven or braked. Each appears at most once.
    pub axes: Vec<JointAxis>,
    /// Loads at which the joint breaks.
    pub breaking: Breaking,
    /// True if shapes of the two bodies collide with each other.
    pub collide: bool,
    /// False if the joint does nothing.
    pub enabled: bool,
    /// Any number chosen by the caller.
    pub user_data: u128,
}

/// Frames of a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum JointFrames<P> {
    /// One frame of the world, as the bodies lie when they are joined.
    World(P),
    /// A frame in a and one in b, relative to their origins; of the world for an absent body.
    Bodies([P; 2]),
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
    /// Angle of rotation in the plane. It counts turns. \[rad\]
    Angle,
    /// Rotation about x: the twist of the swing-twist decomposition. It counts turns. \[rad\]
    Twist,
    /// Inclination of the x axis by rotation about axis 1 or 2 of frame b: 2 atan2(q_i, q_w) of the
    /// shortest rotation q that takes x to where it is. \[rad\]
    Swing(usize),
    /// Angle between the two x axes. \[rad\]
    Cone,
    /// Angle between the two x axes as a multiple of an ellipse, which has these half-angles about
    /// axes 1 and 2 of frame b. \[1\]
    EllipticCone([f64; 2]),
    /// Angle of the whole relative rotation. \[rad\]
    Rotation,
    /// Angle 0, 1 or 2 about x, y and z, where frame a turns about x, then y, then z of frame b:
    /// Cardan angles. Singular at 90 degrees of the middle one. \[rad\]
    Cardan(usize),
    /// Rotation of a about the x axis of its frame, plus `ratio` times that of b about its own,
    /// both since they were joined and in the world. \[rad\]
    Gear {
        /// Turns of a per turn of b, with the opposite sense. \[1\]
        ratio: f64,
    },
    /// Rotation of a about the x axis of its frame, times `radius`, plus the displacement of b
    /// along the x axis that its frame had at the start, both in the world and since
    /// they were joined. \[m\]
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
    /// Returns true if it is an angle. Its forces are torques.
    pub fn is_angle(&self) -> bool {
        !matches!(
            self,
            Self::Linear(_)
                | Self::Radial(_)
                | Self::Distance
                | Self::Rack { .. }
                | Self::Screw { .. }
                | Self::Pulley { .. }
        )
    }
}

impl Coordinate {
    /// Returns true if it is a length or an angle between directions, which is never below 0.
    pub(crate) fn is_unsigned(&self) -> bool {
        matches!(
            self,
            Self::Distance | Self::Radial(_) | Self::Cone | Self::EllipticCone(_) | Self::Rotation
        )
    }

    /// Returns true if it counts turns.
    pub(crate) fn counts_turns(&self) -> bool {
        self.is_angle() || matches!(self, Self::Rack { .. } | Self::Screw { .. })
    }
}

/// A coordinate q that is locked, limited, driven or braked.
#[derive(Clone, Debug, PartialEq)]
pub struct JointAxis {
    /// The coordinate.
    pub coordinate: Coordinate,
    /// Least and largest q, which may be infinite; equal if q is locked. \[m, or rad\]
    pub limits: Option<[f64; 2]>,
    /// Stiffness and damping of the limits or the lock. If absent, they yield by the setting
    /// `stretch` under the weight of all bodies that joints connect.
    pub softness: Option<Softness>,
    /// Springs and motors.
    pub drives: Vec<Drive>,
    /// Largest force of dry friction. \[N, or N m\]
    pub friction: f64,
}

impl JointAxis {
    /// Describes a free coordinate.
    pub fn free(coordinate: Coordinate) -> Self {
        Self { coordinate, limits: None, softness: None, drives: Vec::new(), friction: 0.0 }
    }

    /// Describes a coordinate that keeps this value. \[m, or rad\]
    pub fn locked(coordinate: Coordinate, value: f64) -> Self {
        Self::limited(coordinate, [value; 2])
    }

    /// Describes a coordinate between limits. \[m, or rad\]
    pub fn limited(coordinate: Coordinate, limits: [f64; 2]) -> Self {
        Self { limits: Some(limits), ..Self::free(coordinate) }
    }

    /// Returns the value of a locked coordinate. A distance that is at most 0 is locked, too.
    pub(crate) fn lock(&self) -> Option<f64> {
        let [low, high] = self.limits?;
        let low = if self.coordinate.is_unsigned() { low.max(0.0) } else { low };
        (low >= high).then_some(low)
    }
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
    /// Infinite for a motor that keeps its velocity as far as its force allows. \[N s/m, or
    /// N m s/rad\]
    pub damping: f64,
    /// May be infinite. \[N, or N m\]
    pub max_force: f64,
    /// True if stiffness and damping are per unit of effective mass: accelerations.
    pub acceleration: bool,
}

impl Drive {
    const NONE: Self = Self {
        position: 0.0,
        velocity: 0.0,
        stiffness: 0.0,
        damping: 0.0,
        max_force: f64::INFINITY,
        acceleration: false,
    };

    /// Describes a motor that keeps a velocity \[m/s, or rad/s\].
    pub fn velocity(velocity: f64) -> Self {
        Self { velocity, damping: f64::INFINITY, ..Self::NONE }
    }

    /// Describes a spring towards a position \[m, or rad\] with a stiffness \[N/m, or N m/rad\] and
    /// a damping \[N s/m, or N m s/rad\].
    pub fn spring(position: f64, stiffness: f64, damping: f64) -> Self {
        Self { position, stiffness, damping, ..Self::NONE }
    }

    /// Describes a spring towards a position \[m, or rad\] that swings at this frequency \[Hz\]
    /// whatever it moves. A damping ratio of 1 is critical.
    pub fn frequency(position: f64, frequency: f64, damping_ratio: f64) -> Self {
        let omega = std::f64::consts::TAU * frequency;
        let (stiffness, damping) = (omega * omega, 2.0 * damping_ratio * omega);
        Self { position, stiffness, damping, acceleration: true, ..Self::NONE }
    }

    /// Bounds the force. \[N, or N m\]
    pub fn at_most(self, max_force: f64) -> Self {
        Self { max_force, ..self }
    }
}

/// Loads at which a joint breaks; infinite ones never break it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Breaking {
    /// Mean force over a step, or over 1/240 s of it. \[N\]
    pub force: f64,
    /// Mean torque over a step, or over 1/240 s of it. \[N m\]
    pub torque: f64,
    /// Length of the impulse in a step. \[N s\]
    pub impulse: f64,
}

impl Breaking {
    /// A joint that never breaks.
    pub const NEVER: Self =
        Self { force: f64::INFINITY, torque: f64::INFINITY, impulse: f64::INFINITY };
}

impl Default for Breaking {
    fn default() -> Self {
        Self::NEVER
    }
}

/// State of a joint at the end of a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointState {
    /// Value of the coordinate of each axis, in the order of [`Joint::axes`]. \[m, or rad\]
    pub values: Vec<f64>,
    /// Rate of change of each value. \[m/s, or rad/s\]
    pub speeds: Vec<f64>,
    /// Length of the mean force on a in the last step; 0 if the joint slept. \[N\]
    pub force: f64,
    /// Length of the mean torque on a about the joint in the last step; 0 if the joint slept.
    /// \[N m\]
    pub torque: f64,
    /// Largest distance by which a position misses its lock or its limits. \[m\]
    pub gap: f64,
    /// Largest angle by which a rotation misses its lock or its limits. \[rad\]
    pub angle: f64,
    /// True if the joint has broken.
    pub broken: bool,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Joint<G, L, A> {
    /// Describes a joint with these axes, at the origin of the world until
    /// [`at`](Self::at) says where.
    pub fn general(bodies: [Option<BodyId>; 2], axes: Vec<JointAxis>) -> Self {
        Self {
            bodies,
            frames: JointFrames::World(G::pose(
                drystone_solver::Vector::ZERO,
                &[0.0, 0.0, 0.0, 1.0][..if A == 3 { 4 } else { 0 }],
            )),
            axes,
            breaking: Breaking::NEVER,
            collide: false,
            enabled: true,
            user_data: 0,
        }
    }

    /// Holds two bodies together.
    pub fn fixed(bodies: [Option<BodyId>; 2]) -> Self {
        Self::general(bodies, [positions::<L>(0), rotations::<A>(0)].concat())
    }

    /// Holds two points together: C = x_a - x_b = 0.
    pub fn ball(bodies: [Option<BodyId>; 2]) -> Self {
        Self::general(bodies, positions::<L>(0))
    }

    /// Leaves only rotation about the x axis, or rotation in the plane.
    pub fn hinge(bodies: [Option<BodyId>; 2]) -> Self {
        let mut axes = [positions::<L>(0), rotations::<A>(1)].concat();
        axes.extend(turn::<A>());
        Self::general(bodies, axes)
    }

    /// Leaves only motion along the x axis.
    pub fn slider(bodies: [Option<BodyId>; 2]) -> Self {
        let free = JointAxis::free(Coordinate::Linear(0));
        Self::general(bodies, [vec![free], positions::<L>(1), rotations::<A>(0)].concat())
    }

    /// Leaves motion along the x axis and rotation about it.
    pub fn piston(bodies: [Option<BodyId>; 2]) -> Self {
        let free = JointAxis::free(Coordinate::Linear(0));
        let mut axes = [vec![free], positions::<L>(1), rotations::<A>(1)].concat();
        axes.extend(turn::<A>());
        Self::general(bodies, axes)
    }

    /// Leaves rotation about two axes: it does not twist.
    pub fn universal(bodies: [Option<BodyId>; 2]) -> Self {
        let mut axes = positions::<L>(0);
        axes.extend(turn::<A>().map(|axis| JointAxis { limits: Some([0.0; 2]), ..axis }));
        Self::general(bodies, axes)
    }

    /// Leaves motion in the plane of y and z, and rotation about x.
    pub fn planar(bodies: [Option<BodyId>; 2]) -> Self {
        let lock = JointAxis::locked(Coordinate::Linear(0), 0.0);
        let mut axes = [vec![lock], rotations::<A>(1)].concat();
        axes.extend(turn::<A>());
        Self::general(bodies, axes)
    }

    /// Holds a wheel: it spins about x, and a spring of this frequency \[Hz\] and damping ratio
    /// carries it along y.
    pub fn wheel(bodies: [Option<BodyId>; 2], frequency: f64, damping_ratio: f64) -> Self {
        let spring = Drive::frequency(0.0, frequency, damping_ratio);
        let mut axes = positions::<L>(0);
        axes[1] = JointAxis { drives: vec![spring], ..JointAxis::free(Coordinate::Linear(1)) };
        axes.extend(rotations::<A>(1));
        axes.extend(turn::<A>());
        Self::general(bodies, axes)
    }

    /// Keeps the origins of the frames at a distance. \[m\]
    pub fn distance(bodies: [Option<BodyId>; 2], length: f64) -> Self {
        Self::general(bodies, vec![JointAxis::locked(Coordinate::Distance, length)])
    }

    /// Keeps the origins of the frames within a distance. \[m\]
    pub fn rope(bodies: [Option<BodyId>; 2], length: f64) -> Self {
        Self::general(bodies, vec![JointAxis::limited(Coordinate::Distance, [0.0, length])])
    }

    /// Pulls the origins of the frames to a distance: the position of the drive. \[m\]
    pub fn spring(bodies: [Option<BodyId>; 2], drive: Drive) -> Self {
        let drives = vec![drive];
        Self::general(bodies, vec![JointAxis { drives, ..JointAxis::free(Coordinate::Distance) }])
    }

    /// Sets the frames in the bodies, or in the world for an absent body.
    pub fn in_bodies(self, frames: [G::Pose; 2]) -> Self {
        Self { frames: JointFrames::Bodies(frames), ..self }
    }

    /// Sets the frame of the joint in the world, as the bodies lie when they are joined.
    pub fn in_world(self, frame: G::Pose) -> Self {
        Self { frames: JointFrames::World(frame), ..self }
    }

    /// Sets the position of the joint in the world. It has no effect after
    /// [`in_bodies`](Self::in_bodies). \[m\]
    pub fn at(self, anchor: [f32; L]) -> Self {
        let JointFrames::World(frame) = self.frames else { return self };
        let by = drystone_solver::Vector(anchor) - G::frame(&frame).position;
        self.in_world(G::advance(&frame, by, drystone_solver::Vector::ZERO))
    }

    /// Sets the direction of the x axis in the world. It has no effect after
    /// [`in_bodies`](Self::in_bodies).
    pub fn about(self, axis: [f32; L]) -> Self {
        let JointFrames::World(frame) = self.frames else { return self };
        self.in_world(G::pose(G::frame(&frame).position, &coordinates::towards::<L, A>(axis)))
    }

    /// Limits the first axis that is not locked: of a hinge the angle, of a slider and a piston the
    /// position, of a wheel its suspension, of a ball the angle of the whole rotation. For other axes
    /// see [`along`](Self::along). \[m, or rad\]
    pub fn limits(mut self, range: std::ops::RangeInclusive<f64>) -> Self {
        self.own().limits = Some([*range.start(), *range.end()]);
        self
    }

    /// Adds a spring or a motor to the axis that [`limits`](Self::limits) limits.
    pub fn drive(mut self, drive: Drive) -> Self {
        self.own().drives.push(drive);
        self
    }

    /// Sets the dry friction of the axis that [`limits`](Self::limits) limits. \[N, or N m\]
    pub fn friction(mut self, friction: f64) -> Self {
        self.own().friction = friction;
        self
    }

    /// Sets the loads at which the joint breaks.
    pub fn breaking(self, breaking: Breaking) -> Self {
        Self { breaking, ..self }
    }

    /// Lets the shapes of the two bodies collide with each other.
    pub fn colliding(self) -> Self {
        Self { collide: true, ..self }
    }

    /// Replaces the axis of a coordinate, or adds it.
    pub fn along(mut self, axis: JointAxis) -> Self {
        match self.axes.iter_mut().find(|own| own.coordinate == axis.coordinate) {
            Some(own) => *own = axis,
            None => self.axes.push(axis),
        }
        self
    }

    /// Returns the first axis that is not locked. A joint without one gets the whole rotation, or
    /// between particles the distance.
    fn own(&mut self) -> &mut JointAxis {
        let found = self.axes.iter().position(|axis| axis.lock().is_none());
        let index = found.unwrap_or_else(|| {
            let free = match A {
                0 => Coordinate::Distance,
                1 => Coordinate::Angle,
                _ => Coordinate::Rotation,
            };
            self.axes.push(JointAxis::free(free));
            self.axes.len() - 1
        });
        &mut self.axes[index]
    }
}

/// Returns locks of the positions from axis `first` on.
fn positions<const L: usize>(first: usize) -> Vec<JointAxis> {
    (first..L).map(|axis| JointAxis::locked(Coordinate::Linear(axis), 0.0)).collect()
}

/// Returns locks of the rotations from axis `first` on.
fn rotations<const A: usize>(first: usize) -> Vec<JointAxis> {
    let of = |axis| match (A, axis) {
        (1, 0) => Some(Coordinate::Angle),
        (3, 0) => Some(Coordinate::Twist),
        (3, _) => Some(Coordinate::Swing(axis)),
        _ => None,
    };
    (first..A).filter_map(of).map(|coordinate| JointAxis::locked(coordinate, 0.0)).collect()
}

/// Returns the free rotation about x, or in the plane.
fn turn<const A: usize>() -> Option<JointAxis> {
    match A {
        1 => Some(JointAxis::free(Coordinate::Angle)),
        3 => Some(JointAxis::free(Coordinate::Twist)),
        _ => None,
    }
}
