//! Rates at which frames, lines and inertias of joints turn. They set the number of substeps.

use drystone_solver::Vector;

use super::Coordinate;
use super::coordinates::{RowCoordinate, Turn, Vec3, cross};
use super::places::in_space;
use super::record::{JointRecord, WORLD};
use super::rows::{Role, RowPlan, RowState};
use crate::bodies::BodyView;
use crate::geometry::Geometry;

/// Part of the length of a rope from which on it is taut. \[1\]
const TAUT: f64 = 0.9;

/// Part of the rotation of an arm in a substep that a rotation which is counted counts for: 0.1 rad of
/// an arm are 1.5 rad of it, and half a turn would be too much. \[1\]
const COUNTED: f64 = 1.0 / 15.0;

/// Part of the rotation of an arm in a substep that a nutation counts for. Joints act on a body at the ends
/// of substeps; in between a top nutates freely. With 1.1 rad of that it precesses 0.5 % too slowly. \[1\]
const NUTATING: f64 = 1.0 / 11.0;

/// Returns the greatest rate at which an arm, an axis or the line of a joint, or the inertia of a body
/// that it holds, turns within `dt` \[s\]; any that turns by `least` at most if none is greater. Bodies
/// outside of the batch have the rotations `there`. `gravity` is the length of its acceleration.
/// \[rad/s, rad, m/s^2\]
pub(crate) fn rate<G: Geometry<L, A>, const L: usize, const A: usize>(
    record: &JointRecord,
    at: &BodyView<'_, G, L, A>,
    there: [Turn; 2],
    [dt, least]: [f64; 2],
    gravity: f64,
) -> f64 {
    // An inertia turns at twice the rate of its body at most.
    let slow = 0.5 * least / dt;
    let turns = record.members().any(|body| f64::from(at.velocity(body).angular.length()) > slow);
    if !turns && !record.has_line() {
        return 0.0;
    }
    let mut fastest = 0.0f64;
    let holds = record.rows.iter().any(|row| row.turns_with_axis());
    let motions = [0, 1].map(|side: usize| FrameMotion::of(record, side, at, there[side]));
    for (motion, &body) in motions.iter().zip(&record.bodies) {
        fastest = fastest.max(motion.turn_of(motion.arm));
        if body == WORLD {
            continue;
        }
        if !(holds && record.bodies.contains(&WORLD)) {
            fastest = fastest.max(nutation(at, body) * NUTATING);
        }
        if holds {
            let axis = motion.turn.rotate(Vector([1.0, 0.0, 0.0]));
            fastest = fastest.max(motion.turn_of(axis));
            fastest = fastest.max(turn_of_inertia(at, body));
        }
    }
    fastest = fastest.max(turn_of_lines(record, &motions, gravity * dt));
    if record.axes.iter().any(|axis| axis.coordinate.counts_turns()) {
        let spin = (motions[0].omega - motions[1].omega).length();
        fastest = fastest.max(spin * COUNTED);
    }
    fastest
}

/// The frame of a joint in one of its bodies, and its motion.
struct FrameMotion {
    /// From the center of mass to the frame. \[m\]
    arm: Vec3,
    /// Rotation of the frame.
    turn: Turn,
    position: Vec3,
    velocity: Vec3,
    omega: Vec3,
}

impl FrameMotion {
    /// Returns the motion of the frame of a joint on a side, whose body has the rotation `there` if it is
    /// outside of the batch.
    fn of<G: Geometry<L, A>, const L: usize, const A: usize>(
        record: &JointRecord,
        side: usize,
        at: &BodyView<'_, G, L, A>,
        there: Turn,
    ) -> Self {
        let frame = &record.frames[side];
        let body = match record.bodies[side] {
            WORLD => {
                let (position, turn) = (frame.position, frame.turn);
                let [arm, velocity, omega] = [Vec3::ZERO; 3];
                return Self { arm, turn, position, velocity, omega };
            }
            body => body,
        };
        let turn = at.turn(body).unwrap_or(there);
        let (arm, velocity) = (turn.rotate(frame.position), at.velocity(body));
        let omega = in_space(velocity.angular);
        Self {
            arm,
            turn: turn.of(&frame.turn),
            position: in_space(at.properties.frames[body as usize].position) + arm,
            velocity: in_space(velocity.linear) + cross(omega, arm),
            omega,
        }
    }

    /// Returns the rate at which a vector of the body turns. \[rad/s\]
    fn turn_of(&self, vector: Vec3) -> f64 {
        let length = vector.length();
        if length > 0.0 { cross(self.omega, vector).length() / length } else { 0.0 }
    }
}

/// Returns the rate at which the lines of a joint turn: those of lengths, with a speed across them of `more` than
/// that of the bodies, and those of angles between directions. A rope that is slack has no line, nor has an
/// angle within its limits. \[rad/s, m/s\]
fn turn_of_lines(record: &JointRecord, [a, b]: &[FrameMotion; 2], more: f64) -> f64 {
    let rate = |(plan, state): (&RowPlan, &RowState)| {
        if !plan.has_line() {
            return 0.0;
        }
        let most = match plan.role {
            Role::Lock(value, _) => value,
            Role::Limit([_, most], _) => most,
            Role::Drive(_) | Role::Friction(_) => return 0.0,
        };
        let apart = a.position - b.position;
        let (line, velocity, more) = match plan.coordinate {
            RowCoordinate::Of(Coordinate::Distance) => (apart, a.velocity - b.velocity, more),
            RowCoordinate::Of(Coordinate::Radial(axis)) => {
                let mut along = Vec3::ZERO;
                along[axis] = 1.0;
                let along = b.turn.rotate(along);
                (apart - along * along.dot(apart), a.velocity - b.velocity, more)
            }
            RowCoordinate::Of(Coordinate::Rotation) => {
                (a.turn.of(&b.turn.inverse()).vector(), a.omega - b.omega, 0.0)
            }
            _ => {
                let [to, from] = [a, b].map(|own| own.turn.rotate(Vector([1.0, 0.0, 0.0])));
                (cross(from, to), cross(from, cross(a.omega - b.omega, to)), 0.0)
            }
        };
        let length = line.length();
        let value = if plan.coordinate.is_angle() { state.value } else { length };
        if length <= 0.0 || value < TAUT * most {
            return 0.0;
        }
        (cross(line, velocity).length() / length + more) / length
    };
    record.rows.iter().zip(&record.states).map(rate).fold(0.0, f64::max)
}

/// Returns the rate at which the inertia of a body turns in space, over the inertia: 0 for a solid of
/// revolution that spins about its axis. \[rad/s\]
fn turn_of_inertia<G: Geometry<L, A>, const L: usize, const A: usize>(
    at: &BodyView<'_, G, L, A>,
    body: u32,
) -> f64 {
    let Some(index) = at.index(body).filter(|_| A == 3) else { return 0.0 };
    let moments = at.properties.inertia[body as usize].inverse_moments;
    let tensor = G::frame(&at.poses[index]).tensor(moments);
    let of = |vector: Vec3| in_space(tensor * Vector(std::array::from_fn(|i| vector[i] as f32)));
    let omega = in_space(at.velocity(body).angular);
    let (mut change, mut size) = (0.0, 0.0);
    for axis in 0..3 {
        let unit = Vector(std::array::from_fn(|i| f64::from(u8::from(i == axis))));
        let column: Vec3 = of(unit);
        // The derivative of R W R^T: omega x W - W omega x.
        let own = cross(omega, column) - of(cross(omega, unit));
        change += own.dot(own);
        size += column.dot(column);
    }
    if size > 0.0 { (change / size).sqrt() } else { 0.0 }
}

/// Returns the rate at which a body nutates if no torque acts on it: L over the mean of its moments of
/// inertia across L. \[rad/s\]
fn nutation<G: Geometry<L, A>, const L: usize, const A: usize>(
    at: &BodyView<'_, G, L, A>,
    body: u32,
) -> f64 {
    let Some(index) = at.index(body).filter(|_| A == 3) else { return 0.0 };
    let moments = at.properties.inertia[body as usize].moments;
    let tensor = G::frame(&at.poses[index]).tensor(moments);
    let momentum = tensor * at.velocity(body).angular;
    let (squared, trace) = (momentum.dot(momentum), (0..A).map(|i| tensor.0[i][i]).sum::<f32>());
    if squared <= 0.0 {
        return 0.0;
    }
    let across = 0.5 * (trace - momentum.dot(tensor * momentum) / squared);
    f64::from(squared.sqrt() / across)
}
