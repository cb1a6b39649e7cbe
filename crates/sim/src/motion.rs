//! Bodies in free motion: the start and the end of a substep.

use drystone_solver::team::Team;
use drystone_solver::{Vector, Velocity};

use crate::bodies::{Bodies, Came, PIECE, damped};
use crate::course::{Course, Terms};
use crate::geometry::{Geometry, Spin, TOGETHER};

/// Bodies of which those that precess are found before they turn.
const CHUNK: usize = 256;

/// Below this angle per substep \[rad\] a body's precession is left out: it would change the angular
/// velocity by less than this part of itself.
const SMALL_TURN: f32 = 1e-4;

impl<G: Geometry<L, A>, const L: usize, const A: usize> Course<'_, G, L, A> {
    /// v* = v + h (g + M^-1 f): the prospective velocities. In their stead it keeps what contacts gave to the
    /// velocities in the substep before, M^-1 J^T gamma: how these differ from the prospective ones of then.
    pub(crate) fn predict(&mut self, terms: &Terms<L>) {
        let Terms { gravity, h, .. } = *terms;
        let (first, (given, masses)) = (self.bodies().start, (self.given, self.masses));
        let (useful, share) = self.team.share(self.velocities.len(), PIECE);
        let parts = self.velocities.chunks_mut(share).zip(self.prospective.chunks_mut(share));
        self.team.for_each(useful, parts.enumerate(), |(part, (velocities, push))| {
            let numbers = first + share * part..;
            for (body, (velocity, push)) in numbers.zip(velocities.iter_mut().zip(push)) {
                *push = *velocity - *push;
                if !given.is_dynamic(body) {
                    continue;
                }
                let (mass, force) = (&masses[body], given.force(body));
                let before = *velocity;
                if mass.linear > 0.0 {
                    let fall = given.pull(body, gravity);
                    velocity.linear += (fall + force.linear * mass.linear) * h;
                }
                if force.angular != Vector::ZERO {
                    velocity.angular += (mass.angular * force.angular) * h;
                }
                if let Some(damping) = given.damping.get(body) {
                    *velocity += damped(*damping, &before, &(*velocity - before), h);
                }
            }
        });
    }

    /// v = v* + M^-1 J^T gamma of the substep before, which `predict` has kept; it keeps v* for it.
    ///
    /// J and M stay through all substeps, so bodies know what their contacts will give them.
    pub(crate) fn push(&mut self) {
        let (useful, share) = self.team.share(self.velocities.len(), PIECE);
        let parts = self.velocities.chunks_mut(share).zip(self.prospective.chunks_mut(share));
        self.team.for_each(useful, parts, |(velocities, push)| {
            for (velocity, push) in velocities.iter_mut().zip(push) {
                let prospective = *velocity;
                *velocity += *push;
                *push = prospective;
            }
        });
    }

    /// Displacement += h v. A body that precesses turns at once: its free motion keeps the angular
    /// momentum and, to second order in h, the energy. The others turn at the end of the step.
    pub(crate) fn advance(&mut self, terms: &Terms<L>) {
        let (first, given, h) = (self.bodies().start, self.given, terms.h);
        let (useful, share) = self.team.share(self.velocities.len(), PIECE);
        let moved = self.velocities.chunks_mut(share).zip(self.prospective.chunks_mut(share));
        let moved = moved.zip(self.displacements.chunks_mut(share));
        let placed = self.poses.chunks_mut(share).zip(self.turns.chunks_mut(share));
        self.team.for_each(useful, moved.zip(placed).enumerate(), |(part, (moved, placed))| {
            let ((velocities, prospective), displacements) = moved;
            let (poses, turns) = placed;
            let first = first + share * part;
            for start in (0..velocities.len()).step_by(CHUNK) {
                let own = start..velocities.len().min(start + CHUNK);
                let (mut precessing, mut count) = ([0_u16; CHUNK], 0);
                let moved = displacements[own.clone()].iter_mut().zip(&velocities[own.clone()]);
                let placed = turns[own.clone()].iter_mut().zip(&given.gyroscopic[first..][own]);
                for (body, ((displacement, velocity), (turned, kind))) in
                    (0..).zip(moved.zip(placed))
                {
                    let step = *velocity * h;
                    *displacement += step;
                    let turn = step.angular;
                    // In the plane nothing precesses.
                    if A == 3 && *kind && turn.dot(turn) > SMALL_TURN * SMALL_TURN {
                        *turned += turn;
                        precessing[count] = body;
                        count += 1;
                    }
                }
                for group in precessing[..count].chunks(TOGETHER) {
                    // The last stands where there is none.
                    let own = |index: usize| start + usize::from(group[index.min(group.len() - 1)]);
                    let spins: [_; TOGETHER] = std::array::from_fn(|index| {
                        let inertia = &given.inertia[first + own(index)];
                        let moments = [&inertia.moments, &inertia.inverse_moments];
                        let omega = velocities[own(index)].angular;
                        Spin { pose: poses[own(index)], moments, omega }
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
}

/// Moves the poses by what `advance` has summed up over the step.
pub(crate) fn arrive<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &mut Bodies<G, L, A>,
    team: &Team,
    displacements: &[Velocity<f32, L, A>],
) {
    let Bodies {
        poses, turns, frames, remainders, paths, came, strayed, reach, gyroscopic, ..
    } = bodies;
    let (useful, share) = team.share(displacements.len(), PIECE);
    let placed = poses.chunks_mut(share).zip(turns.chunks_mut(share));
    let exact = frames.chunks_mut(share).zip(remainders.chunks_mut(share));
    let sizes = reach.chunks(share).zip(gyroscopic.chunks(share));
    let went = paths
        .chunks_mut(share)
        .zip(came.chunks_mut(share))
        .zip(strayed.chunks_mut(share))
        .zip(sizes);
    let parts = displacements.chunks(share).zip(placed.zip(exact).zip(went));
    team.for_each(useful, parts, |(displacements, ((placed, exact), went))| {
        let placed = placed.0.iter_mut().zip(placed.1);
        let exact = exact.0.iter_mut().zip(exact.1);
        let (((paths, came), strayed), (reach, kinds)) = went;
        let went = paths.iter_mut().zip(came).zip(strayed).zip(reach.iter().zip(kinds));
        for (
            displacement,
            (((pose, turned), (frame, remainder)), (((path, came), strayed), (reach, kind))),
        ) in displacements.iter().zip(placed.zip(exact).zip(went))
        {
            if *displacement == Velocity::ZERO {
                *came = Came::NOWHERE;
                continue;
            }
            let by = displacement.linear + *remainder;
            // Displacements tell of blows within a substep, too.
            let turn = displacement.angular - std::mem::replace(turned, Vector::ZERO);
            let before = *frame;
            *pose = G::advance(pose, by, turn);
            *frame = G::frame(pose);
            *remainder = rounding(before.position, by, frame.position);
            // ||R - R'|| is at most this. What does not precess has turned but now.
            let far = if *kind {
                let axes = frame.axes.iter().zip(&before.axes);
                axes.fold(0.0, |sum, (now, then)| sum + (*now - *then).length())
            } else {
                turn.length()
            };
            *came = Came { linear: displacement.linear, turned: far * reach.core };
            let way = came.linear.length() + came.turned;
            *path += f64::from(way);
            *strayed += way;
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
