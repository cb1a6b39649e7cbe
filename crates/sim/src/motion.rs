//! Bodies in free motion: the start and the end of a substep.

use std::ops::Range;

use drystone_solver::team::Team;
use drystone_solver::{InverseMass, Vector, Velocity};

use crate::bodies::{Bodies, Inertia, PIECE};
use crate::geometry::{Geometry, Spin, TOGETHER};

/// Bodies of which those that precess are found before they turn.
const CHUNK: usize = 512;

/// Below this angle per substep \[rad\] a body's precession is left out: it would change the angular
/// velocity by less than this part of itself.
const SMALL_TURN: f32 = 1e-4;

/// v* = v + h (g + M^-1 f): the prospective velocities. `push` takes what contacts gave to the velocities
/// in the substep before, M^-1 J^T gamma: their difference from the prospective ones of that substep,
/// which it comes with. Of the bodies of a `batch`, as in what follows.
pub(crate) fn predict<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &Bodies<G, L, A>,
    batch: Range<usize>,
    masses: &[InverseMass<f32, L, A>],
    gravity: Vector<f32, L>,
    h: f32,
    team: &Team,
    [velocities, push]: [&mut [Velocity<f32, L, A>]; 2],
) {
    let (first, (useful, share)) = (batch.start, team.share(batch.len(), PIECE));
    let push = push[batch.clone()].chunks_mut(share);
    let parts = velocities[batch].chunks_mut(share).zip(push);
    team.for_each(useful, parts.enumerate(), |(part, (velocities, push))| {
        let numbers = first + share * part..;
        for (body, (velocity, push)) in numbers.zip(velocities.iter_mut().zip(push)) {
            *push = *velocity - *push;
            if !bodies.is_dynamic(body) {
                continue;
            }
            let (mass, force) = (&masses[body], bodies.force(body));
            if mass.linear > 0.0 {
                let fall = bodies.pull(body, gravity);
                velocity.linear += (fall + force.linear * mass.linear) * h;
            }
            if force.angular != Vector::ZERO {
                velocity.angular += (mass.angular * force.angular) * h;
            }
        }
    });
}

/// v = v* + M^-1 J^T gamma of the substep before, which `push` holds; it takes v* for it.
///
/// J and M stay through all substeps, so bodies know what their contacts will give them.
pub(crate) fn warm_start<const L: usize, const A: usize>(
    batch: Range<usize>,
    team: &Team,
    velocities: &mut [Velocity<f32, L, A>],
    push: &mut [Velocity<f32, L, A>],
) {
    let (useful, share) = team.share(batch.len(), PIECE);
    let push = push[batch.clone()].chunks_mut(share);
    let parts = velocities[batch].chunks_mut(share).zip(push);
    team.for_each(useful, parts, |(velocities, push)| {
        for (velocity, push) in velocities.iter_mut().zip(push) {
            let prospective = *velocity;
            *velocity += *push;
            *push = prospective;
        }
    });
}

/// Displacement += h v. A body that precesses turns at once: its free motion keeps the angular
/// momentum and, to second order in h, the energy. The others turn at the end of the step.
pub(crate) fn advance<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &mut Bodies<G, L, A>,
    batch: Range<usize>,
    h: f32,
    team: &Team,
    velocities: &mut [Velocity<f32, L, A>],
    prospective: &mut [Velocity<f32, L, A>],
    displacements: &mut [Velocity<f32, L, A>],
) {
    let Bodies { poses, turns, inertia, gyroscopic, .. } = bodies;
    let (first, (useful, share)) = (batch.start, team.share(batch.len(), PIECE));
    let prospective = prospective[batch.clone()].chunks_mut(share);
    let moved = velocities[batch.clone()].chunks_mut(share).zip(prospective);
    let moved = moved.zip(displacements[batch.clone()].chunks_mut(share));
    let placed = poses[batch.clone()].chunks_mut(share).zip(turns[batch].chunks_mut(share));
    team.for_each(useful, moved.zip(placed).enumerate(), |(part, (moved, placed))| {
        let ((velocities, prospective), displacements) = moved;
        let (poses, turns) = placed;
        let first = first + share * part;
        for start in (0..velocities.len()).step_by(CHUNK) {
            let own = start..velocities.len().min(start + CHUNK);
            let (mut precessing, mut count) = ([0; CHUNK], 0);
            let moved = displacements[own.clone()].iter_mut().zip(&velocities[own.clone()]);
            let kinds = gyroscopic[first..][own.clone()].iter();
            for (body, (((displacement, velocity), turned), kind)) in
                own.clone().zip(moved.zip(&mut turns[own]).zip(kinds))
            {
                *displacement += *velocity * h;
                let turn = velocity.angular * h;
                if *kind && turn.dot(turn) > SMALL_TURN * SMALL_TURN {
                    precessing[count] = body;
                    count += 1;
                } else {
                    *turned += turn;
                }
            }
            for group in precessing[..count].chunks(TOGETHER) {
                // The last stands where there is none.
                let own = |index: usize| group[index.min(group.len() - 1)];
                let spins: [_; TOGETHER] = std::array::from_fn(|index| {
                    let Inertia { moments, inverse_moments, .. } = &inertia[first + own(index)];
                    let moments = [moments, inverse_moments];
                    Spin { pose: poses[own(index)], moments, omega: velocities[own(index)].angular }
                });
                G::precess(&spins, group.len(), h, |index, pose, change| {
                    let own = own(index);
                    velocities[own].angular += change;
                    // It is not from contacts.
                    prospective[own].angular += change;
                    poses[own] = pose;
                });
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
    let Bodies { poses, turns, frames, remainders, paths, strayed, reach, gyroscopic, .. } = bodies;
    let (useful, share) = team.share(displacements.len(), PIECE);
    let placed = poses.chunks_mut(share).zip(turns.chunks_mut(share));
    let exact = frames.chunks_mut(share).zip(remainders.chunks_mut(share));
    let sizes = reach.chunks(share).zip(gyroscopic.chunks(share));
    let went = paths.chunks_mut(share).zip(strayed.chunks_mut(share)).zip(sizes);
    let parts = displacements.chunks(share).zip(placed.zip(exact).zip(went));
    team.for_each(useful, parts, |(displacements, ((placed, exact), went))| {
        let placed = placed.0.iter_mut().zip(placed.1);
        let exact = exact.0.iter_mut().zip(exact.1);
        let ((paths, strayed), (reach, kinds)) = went;
        let went = paths.iter_mut().zip(strayed).zip(reach.iter().zip(kinds));
        for (
            displacement,
            (((pose, turn), (frame, remainder)), ((path, strayed), (reach, kind))),
        ) in displacements.iter().zip(placed.zip(exact).zip(went))
        {
            if *displacement == Velocity::ZERO {
                continue;
            }
            let by = displacement.linear + *remainder;
            let turn = std::mem::replace(turn, Vector::ZERO);
            let before = *frame;
            *pose = G::advance(pose, by, turn);
            *frame = G::frame(pose);
            *remainder = rounding(before.position, by, frame.position);
            // ||R - R'|| is at most this. What does not precess has turned but now.
            let turned = if *kind {
                let axes = frame.axes.iter().zip(&before.axes);
                axes.fold(0.0, |sum, (now, then)| sum + (*now - *then).length())
            } else {
                turn.length()
            };
            let came = displacement.linear.length() + turned * reach;
            *path += f64::from(came);
            *strayed += came;
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
