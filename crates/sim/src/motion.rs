//! Bodies in free motion: the start and the end of a substep.

use drystone_solver::team::Team;
use drystone_solver::{InverseMass, Vector, Velocity};

use crate::bodies::Bodies;
use crate::geometry::{Frame, Geometry};

/// Bodies that a thread takes at once.
pub(crate) const CHUNK: usize = 512;

/// Below this angle per substep \[rad\] a body's precession is left out: it would change the angular
/// velocity by less than this part of itself.
const SMALL_TURN: f32 = 1e-4;

/// v* = v + h (g + M^-1 f): the prospective velocities.
pub(crate) fn predict<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &Bodies<G, L, A>,
    masses: &[InverseMass<f32, L, A>],
    gravity: Vector<f32, L>,
    h: f32,
    team: &Team,
    velocities: &mut [Velocity<f32, L, A>],
) {
    let useful = velocities.len() > 2 * CHUNK;
    team.for_each(useful, velocities.chunks_mut(CHUNK).enumerate(), |(chunk, velocities)| {
        for (body, velocity) in (CHUNK * chunk..).zip(velocities) {
            let (mass, force) = (&masses[body], &bodies.forces[body]);
            if bodies.is_dynamic(body) && mass.linear > 0.0 {
                let fall = bodies.pull(body, gravity);
                velocity.linear += (fall + force.linear * mass.linear) * h;
                velocity.angular += (mass.angular * force.angular) * h;
            } else if bodies.is_dynamic(body) {
                velocity.angular += (mass.angular * force.angular) * h;
            }
        }
    });
}

/// Displacement += h v. A body that precesses turns at once: its free motion keeps the angular
/// momentum and, to second order in h, the energy. The others turn at the end of the step.
pub(crate) fn advance<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &mut Bodies<G, L, A>,
    h: f32,
    team: &Team,
    velocities: &mut [Velocity<f32, L, A>],
    displacements: &mut [Velocity<f32, L, A>],
) {
    let Bodies { poses, turns, inertia, gyroscopic, .. } = bodies;
    let useful = velocities.len() > 2 * CHUNK;
    let moved = velocities.chunks_mut(CHUNK).zip(displacements.chunks_mut(CHUNK));
    let placed = poses.chunks_mut(CHUNK).zip(turns.chunks_mut(CHUNK));
    team.for_each(useful, moved.zip(placed).enumerate(), |(chunk, (moved, placed))| {
        let moved = moved.0.iter_mut().zip(moved.1);
        let placed = placed.0.iter_mut().zip(placed.1);
        for (body, ((velocity, displacement), (pose, turned))) in
            (CHUNK * chunk..).zip(moved.zip(placed))
        {
            *displacement += *velocity * h;
            let turn = velocity.angular * h;
            let squared = turn.dot(turn);
            if gyroscopic[body] && squared > SMALL_TURN * SMALL_TURN {
                // omega(t) = W(q(t)) L with L constant; the rotation follows omega at mid-step.
                let inertia = &inertia[body];
                let frame = G::frame(pose);
                let momentum = frame.turned(inertia.moments, velocity.angular);
                let omega = |frame: &Frame<L>| frame.turned(inertia.inverse_moments, momentum);
                let middle = G::advance(pose, Vector::ZERO, turn * 0.5);
                let turn = omega(&G::frame(&middle)) * h;
                let end = G::advance(pose, Vector::ZERO, turn);
                // A difference, so that the rounding of I I^-1 does not add up from step to step.
                velocity.angular += omega(&G::frame(&end)) - omega(&frame);
                *pose = end;
            } else {
                *turned += turn;
            }
        }
    });
}

/// Moves the poses by what `advance` has summed up over the step.
pub(crate) fn arrive<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &mut Bodies<G, L, A>,
    team: &Team,
    displacements: &[Velocity<f32, L, A>],
) {
    let Bodies { poses, turns, frames, remainders, .. } = bodies;
    let placed = poses.chunks_mut(CHUNK).zip(turns.chunks_mut(CHUNK));
    let exact = frames.chunks_mut(CHUNK).zip(remainders.chunks_mut(CHUNK));
    let parts = displacements.chunks(CHUNK).zip(placed.zip(exact));
    team.for_each(displacements.len() > 2 * CHUNK, parts, |(displacements, (placed, exact))| {
        let placed = placed.0.iter_mut().zip(placed.1);
        let exact = exact.0.iter_mut().zip(exact.1);
        for (displacement, ((pose, turn), (frame, remainder))) in
            displacements.iter().zip(placed.zip(exact))
        {
            if *displacement == Velocity::ZERO {
                continue;
            }
            let by = displacement.linear + *remainder;
            let from = frame.position;
            *pose = G::advance(pose, by, std::mem::replace(turn, Vector::ZERO));
            *frame = G::frame(pose);
            *remainder = rounding(from, by, frame.position);
        }
    });
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
