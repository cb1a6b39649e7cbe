//! Rates at which frames, lines and inertias of joints turn. They set the number of substeps.

use drystone_solver::Vector;

use super::Coordinate;
use super::coordinates::{RowCoordinate, Turn, Vec3, cross};
use super::places::in_space;
use super::record::{JointRecord, WORLD};
use super::rows::{Role, RowPlan};
use crate::bodies::Bodies;
use crate::geometry::Geometry;

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
    pub(crate) omega: Vec3,
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

/// Returns the rate at which the line of a distance of a joint turns, with a speed across it of `more` than
/// that of the bodies. A rope that is slack has no line. \[rad/s, m/s\]
pub(crate) fn turn_of_line(record: &JointRecord, [a, b]: &[FrameMotion; 2], more: f64) -> f64 {
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
    record.rows.iter().map(rate).fold(0.0, f64::max)
}

/// Returns the rate at which the inertia of a body turns in space, over the inertia: 0 for a solid of
/// revolution that spins about its axis. \[rad/s\]
pub(crate) fn turn_of_inertia<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &Bodies<G, L, A>,
    body: usize,
) -> f64 {
    if A != 3 {
        return 0.0;
    }
    let tensor = G::frame(&bodies.poses[body]).tensor(bodies.inertia[body].inverse_moments);
    let of = |vector: Vec3| in_space(tensor * Vector(std::array::from_fn(|i| vector[i] as f32)));
    let omega = in_space(bodies.velocities[body].angular);
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
pub(crate) fn nutation<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &Bodies<G, L, A>,
    body: usize,
) -> f64 {
    if A != 3 {
        return 0.0;
    }
    let tensor = G::frame(&bodies.poses[body]).tensor(bodies.inertia[body].moments);
    let momentum = tensor * bodies.velocities[body].angular;
    let (squared, trace) = (momentum.dot(momentum), (0..A).map(|i| tensor.0[i][i]).sum::<f32>());
    if squared <= 0.0 {
        return 0.0;
    }
    let across = 0.5 * (trace - momentum.dot(tensor * momentum) / squared);
    f64::from(squared.sqrt() / across)
}
