//! Adds, changes, reads and removes the joints of a world.

use crate::balance::Balance;
use crate::body::Motion;
use crate::geometry::Geometry;
use crate::ids::{BodyId, JointId, put};
use crate::input::{self, InputError, JointFault};
use crate::joint::coordinates::{JointOrigin, Place, Vec3, gear_axis};
use crate::joint::places::place;
use crate::joint::record::{JointRecord, WORLD};
use crate::joint::rows::{self, RowState};
use crate::joint::{Breaking, Coordinate, Drive, Joint, JointAxis, JointFrames, JointState};
use crate::world::World;

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Adds a joint, and wakes its bodies.
    ///
    /// # Errors
    /// A body is unknown, both are the same, nothing can move, or an axis is not that of a joint
    /// in this dimension or out of its range. The world is then unchanged.
    pub fn join(&mut self, joint: Joint<G, L, A>) -> Result<JointId, InputError> {
        let bodies = self.joined_bodies(&joint)?;
        check_axes::<L, A>(&joint.axes)?;
        check_breaking(&joint.breaking)?;
        let frames = self.joint_frames(&joint, bodies)?;
        let places = bodies.map(|body| self.body_places().of(body));
        let rows = rows::plan(&joint.axes, L);
        let record = JointRecord {
            bodies,
            frames,
            origin: JointOrigin {
                start: [0, 1].map(|side: usize| places[side].of(&frames[side])),
                gear_axis: gear_axis(L),
            },
            states: vec![RowState::default(); rows.len()],
            turns: vec![[0.0; 2]; joint.axes.len()],
            rows,
            axes: joint.axes,
            breaking: joint.breaking,
            collide: joint.collide,
            enabled: joint.enabled,
            broken: false,
            user_data: joint.user_data,
            pulls: [0.0; 2],
            load: [[Vec3::ZERO; 2]; 2],
        };
        for body in bodies.into_iter().filter(|body| *body != WORLD) {
            self.bodies.balances[body as usize] = Balance::NEW;
        }
        let world = self.id();
        let joints = &mut self.solver.joints;
        let slot = joints.slots.take();
        put(&mut joints.records, slot, record);
        let id = JointId::new(&joints.slots, slot, world);
        joints.forget();
        self.definitions_changed();
        self.wake_joined(slot);
        self.pair_again(slot as u32);
        Ok(id)
    }

    /// Removes a joint, and wakes its bodies. Returns false if it is unknown.
    pub fn unjoin(&mut self, id: JointId) -> bool {
        let Some(slot) = self.joint_slot(id) else { return false };
        self.wake_joined(slot);
        self.drop_joint(slot);
        true
    }

    /// Returns the state of a joint, or `None` if it is unknown.
    pub fn joint(&self, id: JointId) -> Option<JointState> {
        let (slot, joints) = (self.joint_slot(id)?, &self.solver.joints);
        Some(joints.state(slot, &self.body_places(), joints.last_step))
    }

    /// Returns the axes of a joint, or `None` if it is unknown.
    pub fn joint_axes(&self, id: JointId) -> Option<&[JointAxis]> {
        let slot = self.joint_slot(id)?;
        Some(&self.solver.joints.records[slot].axes)
    }

    /// Replaces the axes of a joint: its limits, springs, motors and friction. Wakes its bodies.
    ///
    /// # Errors
    /// The joint is unknown, or an axis is out of its range.
    pub fn set_joint_axes(&mut self, id: JointId, axes: Vec<JointAxis>) -> Result<(), InputError> {
        let slot = self.joint_slot(id).ok_or(InputError::Joint(JointFault::Unknown))?;
        check_axes::<L, A>(&axes)?;
        let record = &mut self.solver.joints.records[slot];
        let turns = |axis: &JointAxis| {
            let before = record.axes.iter().position(|own| own.coordinate == axis.coordinate);
            before.map_or([0.0; 2], |index| record.turns[index])
        };
        record.turns = axes.iter().map(turns).collect();
        record.rows = rows::plan(&axes, L);
        record.states = vec![RowState::default(); record.rows.len()];
        record.axes = axes;
        self.solver.joints.forget();
        self.definitions_changed();
        self.wake_joined(slot);
        self.pair_again(slot as u32);
        Ok(())
    }

    /// Sets a spring or a motor, in place of all drives of the first axis that has any. If none
    /// has, it drives the first axis that is not locked. Wakes the bodies of the joint.
    ///
    /// # Errors
    /// The joint is unknown, all its axes are locked, or the drive is out of its range.
    pub fn drive(&mut self, id: JointId, drive: Drive) -> Result<(), InputError> {
        let unknown = InputError::Joint(JointFault::Unknown);
        let mut axes = self.joint_axes(id).ok_or(unknown)?.to_vec();
        let driven = axes.iter().position(|axis| !axis.drives.is_empty());
        let free = || axes.iter().position(|axis| axis.lock().is_none());
        let index = driven.or_else(free).ok_or(InputError::Joint(JointFault::Locked))?;
        axes[index].drives = vec![drive];
        self.set_joint_axes(id, axes)
    }

    /// Switches a joint on or off, and wakes its bodies. A broken joint is whole again.
    ///
    /// # Errors
    /// The joint is unknown.
    pub fn enable_joint(&mut self, id: JointId, enabled: bool) -> Result<(), InputError> {
        let slot = self.joint_slot(id).ok_or(InputError::Joint(JointFault::Unknown))?;
        let record = &mut self.solver.joints.records[slot];
        (record.enabled, record.broken) = (enabled, false);
        self.definitions_changed();
        self.wake_joined(slot);
        self.pair_again(slot as u32);
        Ok(())
    }

    /// Returns the joints in the order of their slots.
    pub fn joints(&self) -> impl Iterator<Item = JointId> + '_ {
        let joints = &self.solver.joints;
        joints.taken().map(|(slot, _)| JointId::new(&joints.slots, slot, self.id()))
    }

    /// Returns the [`Joint::user_data`] of a joint.
    pub fn joint_user_data(&self, id: JointId) -> Option<u128> {
        self.joint_slot(id).map(|slot| self.solver.joints.records[slot].user_data)
    }

    /// Returns the bodies of a joint; `None` for the world.
    pub fn bodies_of(&self, id: JointId) -> Option<[Option<BodyId>; 2]> {
        let record = &self.solver.joints.records[self.joint_slot(id)?];
        Some(record.bodies.map(|body| self.body_at(body as usize).filter(|_| body != WORLD)))
    }

    /// Returns the slots of the bodies of a joint to be added.
    fn joined_bodies(&self, joint: &Joint<G, L, A>) -> Result<[u32; 2], InputError> {
        let mut bodies = [WORLD; 2];
        for (slot, body) in bodies.iter_mut().zip(joint.bodies) {
            if let Some(body) = body {
                *slot = self.known(body)? as u32;
            }
        }
        if bodies[0] == bodies[1] && bodies[0] != WORLD {
            return Err(InputError::Joint(JointFault::SameBody));
        }
        let moves = |body: &u32| {
            *body != WORLD && self.bodies.motion[*body as usize] == Some(Motion::Dynamic)
        };
        if !bodies.iter().any(moves) {
            return Err(InputError::Joint(JointFault::NothingMoves));
        }
        Ok(bodies)
    }

    /// Returns the frames of a joint relative to the centers of mass of its bodies.
    fn joint_frames(
        &self,
        joint: &Joint<G, L, A>,
        bodies: [u32; 2],
    ) -> Result<[Place; 2], InputError> {
        let own = |side: usize, frame: &G::Pose| {
            let mut local = place::<G, L, A>(frame);
            if bodies[side] != WORLD {
                let center = self.bodies.inertia[bodies[side] as usize].center;
                (0..L).for_each(|i| local.position[i] -= f64::from(center[i]));
            }
            local
        };
        match &joint.frames {
            JointFrames::Bodies(frames) => {
                frames.iter().try_for_each(input::check_pose::<G, L, A>)?;
                Ok([own(0, &frames[0]), own(1, &frames[1])])
            }
            JointFrames::World(frame) => {
                input::check_pose::<G, L, A>(frame)?;
                let world = place::<G, L, A>(frame);
                Ok(bodies.map(|body| self.body_places().of(body).local(&world)))
            }
        }
    }
}

type Checked = Result<(), InputError>;

fn fault(fault: JointFault) -> Checked {
    Err(InputError::Joint(fault))
}

/// Rejects axes that a joint of this dimension cannot have.
fn check_axes<const L: usize, const A: usize>(axes: &[JointAxis]) -> Checked {
    for (index, axis) in axes.iter().enumerate() {
        if !exists::<L, A>(&axis.coordinate) {
            return fault(JointFault::NoSuchCoordinate(axis.coordinate));
        }
        if axes[..index].iter().any(|other| other.coordinate == axis.coordinate) {
            return fault(JointFault::Twice(axis.coordinate));
        }
        if let Some([low, high]) = axis.limits {
            let ordered = low <= high && low < f64::INFINITY && high > f64::NEG_INFINITY;
            if !ordered {
                return fault(JointFault::Limits([low, high]));
            }
        }
        let most = [0.0, f64::MAX];
        input::within("the friction of a joint [N, or N m]", axis.friction, most)?;
        if let Some(softness) = axis.softness {
            input::within("the stiffness of a limit", softness.stiffness, most)?;
            input::within("the damping of a limit", softness.damping, most)?;
            let sum = softness.stiffness + softness.damping;
            input::within("stiffness and damping of a limit", sum, [f64::MIN_POSITIVE, f64::MAX])?;
        }
        for drive in &axis.drives {
            let any = [-f64::MAX, f64::MAX];
            input::within("the position of a drive [m, or rad]", drive.position, any)?;
            input::within("the velocity of a drive [m/s, or rad/s]", drive.velocity, any)?;
            input::within("the stiffness of a drive", drive.stiffness, most)?;
            input::within("the damping of a drive", drive.damping, [0.0, f64::INFINITY])?;
            input::within("the force of a drive", drive.max_force, [0.0, f64::INFINITY])?;
        }
    }
    Ok(())
}

/// Rejects loads that are negative or NaN.
fn check_breaking(breaking: &Breaking) -> Checked {
    let any = [0.0, f64::INFINITY];
    input::within("the force that breaks a joint [N]", breaking.force, any)?;
    input::within("the torque that breaks a joint [N m]", breaking.torque, any)?;
    input::within("the impulse that breaks a joint [N s]", breaking.impulse, any)
}

/// Returns true if joints of this dimension have the coordinate.
fn exists<const L: usize, const A: usize>(coordinate: &Coordinate) -> bool {
    match coordinate {
        Coordinate::Linear(axis) => *axis < L,
        Coordinate::Radial(axis) => *axis < L && L == 3,
        Coordinate::Distance => true,
        Coordinate::Pulley { points, ratio } => {
            ratio.is_finite() && points.iter().flatten().all(|own| own.is_finite())
        }
        Coordinate::Angle => A == 1,
        Coordinate::Swing(axis) => A == 3 && (1..3).contains(axis),
        Coordinate::Cardan(axis) => A == 3 && *axis < 3,
        Coordinate::EllipticCone(angles) => {
            A == 3 && angles.iter().all(|angle| *angle > 0.0 && angle.is_finite())
        }
        Coordinate::Gear { ratio } => A > 0 && ratio.is_finite(),
        Coordinate::Rack { radius } => A > 0 && radius.is_finite(),
        Coordinate::Twist | Coordinate::Cone | Coordinate::Rotation | Coordinate::Screw { .. } => {
            A == 3
        }
    }
}
