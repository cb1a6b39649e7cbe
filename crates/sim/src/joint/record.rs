//! [`JointRecord`]: a joint of a world.

use drystone_solver::{Axis, Velocity};

use super::coordinates::{JointPlaces, Place, RowCoordinate, Turn, Vec3, cross};
use super::places::in_space;
use super::rows::{Role, RowPlan};
use super::{Breaking, Coordinate, JointAxis};
use crate::bodies::Bodies;
use crate::geometry::Geometry;

/// Marks the world in the place of a body.
pub(crate) const WORLD: u32 = u32::MAX;

/// A joint of a world.
#[derive(Clone, Debug)]
pub(crate) struct JointRecord {
    /// Slots of the bodies, or [`WORLD`].
    pub(crate) bodies: [u32; 2],
    /// Frames relative to the centers of mass, or in the world.
    pub(crate) frames: [Place; 2],
    /// Frames in the world when the bodies were joined.
    pub(crate) start: [Place; 2],
    /// Axis of the frames about which gears and pinions turn: x, or z in the plane.
    pub(crate) gear_axis: Vec3,
    pub(crate) axes: Vec<JointAxis>,
    pub(crate) rows: Vec<RowPlan>,
    pub(crate) states: Vec<RowState>,
    /// By axis: the angles of its coordinate with their turns. \[rad\]
    pub(crate) turns: Vec<[f64; 2]>,
    pub(crate) breaking: Breaking,
    pub(crate) collide: bool,
    pub(crate) enabled: bool,
    pub(crate) broken: bool,
    pub(crate) user_data: u128,
    /// (r . gamma)+ of both bodies in the last substep ([`tension`]). \[N m s\]
    pub(crate) pulls: [f64; 2],
    /// Impulse on a and its moment about the joint in this step, or in the last one.
    /// \[N s, N m s\]
    pub(crate) load: [Vec3; 2],
}

/// State of a row between substeps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct RowState {
    /// q, with its turns. \[m, or rad\]
    pub(crate) value: f64,
    /// Impulses of the last solve and of the sweep that relaxed it. \[N s, or N m s\]
    pub(crate) solved: f64,
    pub(crate) relaxed: f64,
    /// Impulse of the solve before the last. \[N s, or N m s\]
    pub(crate) solved_before: f64,
}

/// Part of the length of a rope from which on it is taut. \[1\]
const TAUT: f64 = 0.9;

/// The frame of a joint in one of its bodies, and its motion.
pub(crate) struct FrameMotion {
    /// From the center of mass to the frame. \[m\]
    pub(crate) arm: Vec3,
    /// Rotation of the frame.
    pub(crate) turn: Turn,
    position: Vec3,
    velocity: Vec3,
    omega: Vec3,
}

impl FrameMotion {
    /// Returns the motion of the frame of a joint on a side.
    pub(crate) fn of<G: Geometry<L, A>, const L: usize, const A: usize>(
        record: &JointRecord,
        side: usize,
        bodies: &Bodies<G, L, A>,
    ) -> Self {
        let frame = &record.frames[side];
        let body = match record.bodies[side] {
            WORLD => {
                let (position, turn) = (frame.position, frame.turn);
                let [arm, velocity, omega] = [Vec3::ZERO; 3];
                return Self { arm, turn, position, velocity, omega };
            }
            body => body as usize,
        };
        let turn = Turn::normalized(G::rotation(&bodies.poses[body]));
        let (arm, velocity) = (turn.rotate(frame.position), &bodies.velocities[body]);
        let omega = in_space(velocity.angular);
        Self {
            arm,
            turn: turn.of(&frame.turn),
            position: in_space(bodies.frames[body].position) + arm,
            velocity: in_space(velocity.linear) + cross(omega, arm),
            omega,
        }
    }

    /// Returns the rate at which a vector of the body turns. \[rad/s\]
    pub(crate) fn turn_of(&self, vector: Vec3) -> f64 {
        let length = vector.length();
        if length > 0.0 { cross(self.omega, vector).length() / length } else { 0.0 }
    }
}

impl RowState {
    /// Returns the impulse of the last solve, as far as it is at most twice that of the one before.
    /// The impulse of an impact does not last. \[N s, or N m s\]
    pub(crate) fn lasting(&self) -> f64 {
        let most = 2.0 * self.solved_before.abs();
        self.solved.clamp(-most, most)
    }
}

impl JointRecord {
    /// Returns its places, where `of` returns those of its bodies.
    pub(crate) fn places(&self, of: impl Fn(u32) -> Place) -> JointPlaces {
        self.places_at(self.bodies.map(of))
    }

    /// Returns its places, where its bodies are at these.
    pub(crate) fn places_at(&self, [a, b]: [Place; 2]) -> JointPlaces {
        let frames = [a.of(&self.frames[0]), b.of(&self.frames[1])];
        JointPlaces::new(frames, self.start, [a.position, b.position])
            .with_gears_about(self.gear_axis)
    }

    /// Counts the turns of axes without rows.
    pub(crate) fn count_turns(&self, places: &JointPlaces, turns: &mut [[f64; 2]]) {
        for (index, axis) in self.axes.iter().enumerate() {
            let has_row = || self.rows.iter().any(|row| row.axis == index);
            if axis.coordinate.counts_turns() && !has_row() {
                let found = places.read(&RowCoordinate::Of(axis.coordinate));
                turns[index] = found.turned(&self.turns[index]).1;
            }
        }
    }

    /// Returns by how much its positions \[m\] and rotations \[rad\] miss their locks and limits.
    pub(crate) fn misses(&self, places: &JointPlaces) -> [f64; 2] {
        let mut out = [0.0f64; 2];
        let mut apart = 0.0;
        for plan in &self.rows {
            let found = places.read(&plan.coordinate);
            let miss = plan.role.miss(found.turned(&self.turns[plan.axis]).0);
            match plan.coordinate {
                // Positions along three axes make one distance.
                RowCoordinate::Of(Coordinate::Linear(_)) => apart += miss * miss,
                RowCoordinate::Of(of) if !of.is_angle() => out[0] = out[0].max(miss),
                _ => out[1] = out[1].max(miss),
            }
        }
        [out[0].max(apart.sqrt()), out[1]]
    }

    /// Returns an impulse on it and its moment in a step of `dt` \[s\] over those that break it. \[1\]
    pub(crate) fn strain(&self, [pull, turn]: [Vec3; 2], dt: f64) -> f64 {
        let Breaking { force, torque, impulse } = self.breaking;
        let pull = (pull.length() / (force * dt)).max(pull.length() / impulse);
        pull.max(turn.length() / (torque * dt))
    }

    /// Returns the rate at which the line of a distance turns, with a speed across it of `more` than
    /// that of the bodies. A rope that is slack has no line. \[rad/s, m/s\]
    pub(crate) fn turn_of_line(&self, [a, b]: &[FrameMotion; 2], more: f64) -> f64 {
        let rate = |plan: &RowPlan| {
            let apart = a.position - b.position;
            let (line, shortest) = match (plan.coordinate, plan.role) {
                (RowCoordinate::Of(of), Role::Lock(length, None)) => (of, length),
                (RowCoordinate::Of(of), Role::Limit([_, most], None)) => (of, most),
                _ => return 0.0,
            };
            let line = match line {
                Coordinate::Distance => apart,
                Coordinate::Radial(axis) => {
                    let mut along = Vec3::ZERO;
                    along[axis] = 1.0;
                    let along = b.turn.rotate(along);
                    apart - along * along.dot(apart)
                }
                _ => return 0.0,
            };
            let length = line.length();
            if length <= 0.0 || length < TAUT * shortest {
                return 0.0;
            }
            (cross(line, a.velocity - b.velocity).length() / length + more) / length
        };
        self.rows.iter().map(rate).fold(0.0, f64::max)
    }

    /// Adds to its load in this step.
    pub(crate) fn bear(&mut self, load: [Vec3; 2]) {
        self.load.iter_mut().zip(load).for_each(|(sum, own)| *sum += own);
    }

    /// Returns its load by these impulses of its rows, at these arms from the centers of mass of its
    /// bodies. \[N s, N m s\]
    pub(crate) fn load_by<const L: usize, const A: usize>(
        &self,
        axes: &[Axis<f64, L, A>],
        impulses: impl Iterator<Item = f64>,
        arms: &[Vec3; 2],
    ) -> [Vec3; 2] {
        let [mut pull, mut turn] = [Vec3::ZERO; 2];
        for (axis, impulse) in axes.iter().zip(impulses) {
            let Velocity { linear, angular } = axis.jacobian[0] * impulse;
            (0..L).for_each(|i| pull[i] += linear[i]);
            (0..A).for_each(|i| turn[if A == 1 { 2 } else { i }] += angular[i]);
        }
        let side = self.first_side();
        let sign = if side == 1 { -1.0 } else { 1.0 };
        [pull * sign, (turn - cross(arms[side], pull)) * sign]
    }

    /// Returns the side of its first body: 1 if a is the world.
    pub(crate) fn first_side(&self) -> usize {
        usize::from(self.bodies[0] == WORLD)
    }

    /// Returns its bodies, without the world.
    pub(crate) fn members(&self) -> impl Iterator<Item = u32> + '_ {
        self.bodies.iter().copied().filter(|body| *body != WORLD)
    }
}
