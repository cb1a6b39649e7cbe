//! Bodies in free motion: the start and the end of a substep.

use drystone_solver::{InverseMass, Vector, Velocity};

use crate::bodies::Bodies;
use crate::geometry::{Frame, Geometry};

/// Below this angle per substep \[rad\] a body's precession is left out: it would change the angular
/// velocity by less than this part of itself.
const SMALL_TURN: f32 = 1e-4;

/// v* = v + h (g + M^-1 f): the prospective velocities.
pub(crate) fn predict<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &Bodies<G, L, A>,
    masses: &[InverseMass<f32, L, A>],
    gravity: Vector<f32, L>,
    h: f32,
    velocities: &mut [Velocity<f32, L, A>],
) {
    for (body, velocity) in velocities.iter_mut().enumerate() {
        if bodies.is_dynamic(body) && masses[body].linear > 0.0 {
            let force = &bodies.forces[body];
            let fall = bodies.pull(body, gravity);
            velocity.linear += (fall + force.linear * masses[body].linear) * h;
            velocity.angular += (masses[body].angular * force.angular) * h;
        } else if bodies.is_dynamic(body) {
            velocity.angular += (masses[body].angular * bodies.forces[body].angular) * h;
        }
    }
}

/// Displacement += h v. A body that precesses turns at once: its free motion keeps the angular
/// momentum and, to second order in h, the energy. The others turn at the end of the step.
pub(crate) fn advance<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &mut Bodies<G, L, A>,
    h: f32,
    velocities: &mut [Velocity<f32, L, A>],
    displacements: &mut [Velocity<f32, L, A>],
) {
    for (body, velocity) in velocities.iter_mut().enumerate() {
        displacements[body] += *velocity * h;
        let turn = velocity.angular * h;
        let squared = turn.dot(turn);
        let pose = &bodies.poses[body];
        if bodies.gyroscopic[body] && squared > SMALL_TURN * SMALL_TURN {
            // omega(t) = W(q(t)) L with L constant; the rotation follows omega at mid-step.
            let inertia = &bodies.inertia[body];
            let frame = G::frame(pose);
            let momentum = frame.turned(inertia.moments, velocity.angular);
            let omega = |frame: &Frame<L>| frame.turned(inertia.inverse_moments, momentum);
            let middle = G::advance(pose, Vector::ZERO, turn * 0.5);
            let turn = omega(&G::frame(&middle)) * h;
            let end = G::advance(pose, Vector::ZERO, turn);
            // A difference, so that the rounding of I I^-1 does not add up from step to step.
            velocity.angular += omega(&G::frame(&end)) - omega(&frame);
            bodies.poses[body] = end;
        } else {
            bodies.turns[body] += turn;
        }
    }
}

/// Moves the poses by what `advance` has summed up over the step.
pub(crate) fn arrive<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &mut Bodies<G, L, A>,
    displacements: &[Velocity<f32, L, A>],
) {
    for (body, displacement) in displacements.iter().enumerate() {
        if *displacement == Velocity::ZERO {
            continue;
        }
        let turn = std::mem::replace(&mut bodies.turns[body], Vector::ZERO);
        let by = displacement.linear + bodies.remainders[body];
        let from = bodies.frames[body].position;
        bodies.poses[body] = G::advance(&bodies.poses[body], by, turn);
        bodies.frames[body] = G::frame(&bodies.poses[body]);
        bodies.remainders[body] = rounding(from, by, bodies.frames[body].position);
    }
}

/// a + b - sum, exactly, where `sum` is a + b rounded (Knuth, The Art of Computer Programming 2,
/// 4.2.2).
fn rounding<const L: usize>(
    a: Vector<f32, L>,
    b: Vector<f32, L>,
    sum: Vector<f32, L>,
) -> Vector<f32, L> {
    let own = sum - a;
    (a - (sum - own)) + (b - own)
}
