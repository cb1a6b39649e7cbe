//! Bodies in free motion: the start and the end of a substep.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use drystone_solver::kinematics;
use drystone_solver::thread_pool::ThreadPool;
use drystone_solver::{InverseMass, Repair, SymmetricMatrix, Vector, Velocity};

use crate::bodies::{
    Bodies, BodiesInMotion, BodyParams, GRAIN, Inertia, SearchMotion, SpinState, damped,
};
use crate::geometry::{Frame, Geometry, Precession, Spin, TOGETHER};

/// Bodies of which those that precess are found before they turn.
const CHUNK: usize = 256;

/// Below this angle per substep \[rad\] a body precesses at the end of the step. A quaternion of `f32` is too
/// coarse for smaller turns.
const SMALL_TURN: f32 = 1e-4;

/// Below this angle \[rad\] it does not: its angular velocity would change by less than this part of itself.
const LEAST_TURN: f32 = 1e-5;

/// What it takes to go through substeps.
#[derive(Clone, Copy)]
pub(crate) struct SubstepParams<const L: usize> {
    /// Length of a substep. \[s\]
    pub(crate) h: f32,
    pub(crate) substeps: u32,
    /// Sweeps over all contacts per substep.
    pub(crate) iterations: u32,
    /// \[m/s^2\]
    pub(crate) gravity: Vector<f32, L>,
    pub(crate) repair: Repair<f32>,
    /// epsilon over A_ii + epsilon of contacts. \[1\]
    pub(crate) softness: f32,
}

/// The bodies of a batch: slices of what they have, and what does not change.
pub(crate) struct MovingBodies<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    /// The number of the first.
    pub(crate) first: usize,
    pub(crate) velocities: &'a mut [Velocity<f32, L, A>],
    /// Those of the substep without the impulses of its contacts.
    pub(crate) prospective: &'a mut [Velocity<f32, L, A>],
    /// What each has moved since the part began.
    pub(crate) displacements: &'a mut [Velocity<f32, L, A>],
    /// What contacts gave it in the last warm start.
    pub(crate) pushes: &'a mut [Velocity<f32, L, A>],
    pub(crate) poses: &'a mut [G::Pose],
    pub(crate) turns: &'a mut [SpinState<A>],
    pub(crate) turned: &'a mut [bool],
    /// M^-1.
    pub(crate) masses: &'a mut [InverseMass<f32, L, A>],
    /// Of all bodies.
    pub(crate) given: BodyParams<'a, L, A>,
    pub(crate) pool: &'a ThreadPool,
}

impl<'a, G: Geometry<L, A>, const L: usize, const A: usize> MovingBodies<'a, G, L, A> {
    /// All bodies.
    pub(crate) fn new(
        bodies: &'a mut Bodies<G, L, A>,
        masses: &'a mut [InverseMass<f32, L, A>],
        [velocities, prospective, displacements, pushes]: [&'a mut [Velocity<f32, L, A>]; 4],
        pool: &'a ThreadPool,
    ) -> Self {
        let BodiesInMotion { given, poses, turns, turned } = bodies.in_motion();
        Self {
            first: 0,
            velocities,
            prospective,
            displacements,
            pushes,
            poses,
            turns,
            turned,
            masses,
            given,
            pool,
        }
    }

    /// The first `count` bodies, and the others.
    pub(crate) fn split_at(self, count: usize) -> (Self, Self) {
        let (velocities, later_velocities) = self.velocities.split_at_mut(count);
        let (prospective, later_prospective) = self.prospective.split_at_mut(count);
        let (displacements, later_displacements) = self.displacements.split_at_mut(count);
        let (pushes, later_pushes) = self.pushes.split_at_mut(count);
        let (poses, later_poses) = self.poses.split_at_mut(count);
        let (turns, later_turns) = self.turns.split_at_mut(count);
        let (turned, later_turned) = self.turned.split_at_mut(count);
        let (masses, later_masses) = self.masses.split_at_mut(count);
        let first = Self {
            velocities,
            prospective,
            displacements,
            pushes,
            poses,
            turns,
            turned,
            masses,
            ..self
        };
        let others = Self {
            first: self.first + count,
            velocities: later_velocities,
            prospective: later_prospective,
            displacements: later_displacements,
            pushes: later_pushes,
            poses: later_poses,
            turns: later_turns,
            turned: later_turned,
            masses: later_masses,
            ..self
        };
        (first, others)
    }

    /// v* = v + h (g + M^-1 f): the prospective velocities. In their stead it keeps what contacts gave to the
    /// velocities in the substep before, M^-1 J^T gamma: how these differ from the prospective ones of then.
    ///
    /// A substep moves bodies by h v at its end; under a steady force they come h (v_start + v) / 2. So
    /// displacements start at -h (v* - v) / 2: a body in free flight follows the parabola exactly, and
    /// contacts see where it comes.
    pub(crate) fn predict(&mut self, params: &SubstepParams<L>) {
        let SubstepParams { gravity, h, .. } = *params;
        let (first, given) = (self.first, self.given);
        let (useful, share) = self.pool.share(self.velocities.len(), GRAIN);
        let parts = self.velocities.chunks_mut(share).zip(self.prospective.chunks_mut(share));
        let parts = parts.zip(self.displacements.chunks_mut(share).zip(self.masses.chunks(share)));
        self.pool.for_each(useful, parts.enumerate(), |(part, ((velocities, push), others))| {
            let numbers = first + share * part..;
            let own = velocities.iter_mut().zip(push).zip(others.0.iter_mut().zip(others.1));
            for (body, ((velocity, push), (moved, mass))) in numbers.zip(own) {
                *push = *velocity - *push;
                if !given.is_dynamic(body) {
                    continue;
                }
                let force = given.force(body);
                let mut gain = Velocity::ZERO;
                if mass.linear > 0.0 {
                    let fall = given.pull(body, gravity);
                    gain.linear = (fall + force.linear * mass.linear) * h;
                }
                if force.angular != Vector::ZERO {
                    gain.angular = (mass.angular * force.angular) * h;
                }
                if let Some(damping) = given.damping.get(body) {
                    gain += damped(*damping, velocity, &gain, h);
                }
                *velocity += gain;
                *moved -= gain * (0.5 * h);
            }
        });
    }

    /// v = v* + M^-1 J^T gamma of the substep before, which `predict` has kept; it keeps v* for it.
    ///
    /// Where nothing turns, J and M stay, and bodies know what their contacts will give them.
    pub(crate) fn push(&mut self) {
        let (useful, share) = self.pool.share(self.velocities.len(), GRAIN);
        let parts = self.velocities.chunks_mut(share).zip(self.prospective.chunks_mut(share));
        self.pool.for_each(useful, parts, |(velocities, push)| {
            for (velocity, push) in velocities.iter_mut().zip(push) {
                let prospective = *velocity;
                *velocity += *push;
                *push = prospective;
            }
        });
    }

    /// Displacement -= h p / 2 with p = M^-1 J^T gamma, as far as contacts push steadily: what they gave
    /// in this substep's warm start and in the one before alike. What slides, rolls or rocks so moves to
    /// second order of h, too; a blow is no steady push. Returns whether anything turns
    /// ([`kinematics`](drystone_solver::kinematics)).
    pub(crate) fn lead(&mut self, params: &SubstepParams<L>) -> bool {
        let h = params.h;
        let (useful, share) = self.pool.share(self.velocities.len(), GRAIN);
        let moved = self.velocities.chunks(share).zip(self.prospective.chunks(share));
        let moved = moved.zip(self.displacements.chunks_mut(share));
        let turning = AtomicBool::new(false);
        self.pool.for_each(useful, moved.zip(self.pushes.chunks_mut(share)), |(moved, pushes)| {
            let ((velocities, prospective), displacements) = moved;
            let moved = velocities.iter().zip(prospective).zip(displacements);
            let mut any = false;
            for (((velocity, prospective), displacement), push) in moved.zip(pushes) {
                let now = *velocity - *prospective;
                let before = std::mem::replace(push, now);
                displacement.linear -= common(now.linear, before.linear) * (0.5 * h);
                displacement.angular -= common(now.angular, before.angular) * (0.5 * h);
                any |= turns(velocity.angular);
            }
            if any {
                turning.store(true, Ordering::Relaxed);
            }
        });
        turning.into_inner()
    }

    /// Displacement += h v. A body that precesses turns at once: its free motion keeps the angular
    /// momentum and, to second order in h, the energy. The others turn at the end of the step.
    pub(crate) fn advance(&mut self, params: &SubstepParams<L>) -> Advanced {
        let (given, h) = (self.given, params.h);
        let (useful, share) = self.pool.share(self.velocities.len(), GRAIN);
        let moved = self.velocities.chunks_mut(share).zip(self.prospective.chunks_mut(share));
        let moved = moved.zip(self.displacements.chunks_mut(share));
        let placed = self.poses.chunks_mut(share).zip(self.turns.chunks_mut(share));
        let placed = placed.zip(self.turned.chunks_mut(share).zip(self.masses.chunks_mut(share)));
        let firsts = (self.first..).step_by(share);
        let (any, fastest) = (AtomicBool::new(false), AtomicU32::new(0));
        self.pool.for_each(useful, firsts.zip(moved.zip(placed)), |(first, (moved, placed))| {
            let ((velocities, prospective), displacements) = moved;
            let ((poses, turns), (turned, masses)) = placed;
            let mut squared = 0.0_f32;
            for start in (0..velocities.len()).step_by(CHUNK) {
                let own = start..velocities.len().min(start + CHUNK);
                let mut bodies = Chunk::<G, L, A> {
                    first: first + start,
                    velocities: &mut velocities[own.clone()],
                    prospective: &mut prospective[own.clone()],
                    displacements: &mut displacements[own.clone()],
                    poses: &mut poses[own.clone()],
                    turns: &mut turns[own.clone()],
                    turned: &mut turned[own.clone()],
                    masses: &mut masses[own],
                    given,
                };
                let (mut precessing, mut count) = ([0; CHUNK], 0);
                let advanced = bodies.advance(h, &mut precessing, &mut count);
                squared = squared.max(advanced.fastest);
                if advanced.turned {
                    any.store(true, Ordering::Relaxed);
                }
                bodies.precess(h, &precessing[..count]);
            }
            // Numbers that are not negative are ordered as their bits are.
            fastest.fetch_max(squared.to_bits(), Ordering::Relaxed);
        });
        let fastest = f32::from_bits(fastest.into_inner()).sqrt();
        Advanced { turned: any.into_inner(), fastest }
    }
}

/// How fast bodies have moved in a substep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Advanced {
    /// Whether any turns faster than [`LEAST_SPIN`](kinematics::LEAST_SPIN).
    pub(crate) turned: bool,
    /// The largest root of v^2 + (omega r)^2, where r is the farthest that a turn moves a surface
    /// ([`Reach::core`]): surfaces approach each other at 2^(3/2) times this, at most. \[m/s\]
    ///
    /// [`Reach::core`]: crate::geometry::Reach::core
    pub(crate) fastest: f32,
}

/// Bodies that follow each other, [`CHUNK`] at most.
struct Chunk<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    /// The number of the first.
    first: usize,
    velocities: &'a mut [Velocity<f32, L, A>],
    prospective: &'a mut [Velocity<f32, L, A>],
    displacements: &'a mut [Velocity<f32, L, A>],
    poses: &'a mut [G::Pose],
    turns: &'a mut [SpinState<A>],
    turned: &'a mut [bool],
    masses: &'a mut [InverseMass<f32, L, A>],
    /// Of all bodies.
    given: BodyParams<'a, L, A>,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Chunk<'_, G, L, A> {
    /// Displacement += h v; lists the first `count` bodies that are `precessing`. Returns the square of the
    /// fastest speed.
    fn advance(&mut self, h: f32, precessing: &mut [u16; CHUNK], count: &mut usize) -> Advanced {
        let moved = self.displacements.iter_mut().zip(&*self.velocities);
        let spins = self.turns.iter_mut().zip(&mut *self.turned);
        let kinds = self.given.precession[self.first..].iter().zip(&self.given.reach[self.first..]);
        let mut advanced = Advanced { turned: false, fastest: 0.0 };
        for (body, ((moved, spin), (kind, reach))) in (0..).zip(moved.zip(spins).zip(kinds)) {
            let ((displacement, velocity), (spin, turned)) = (moved, spin);
            let step = *velocity * h;
            *displacement += step;
            let turn = step.angular;
            let turns = turns(velocity.angular);
            *turned |= turns;
            advanced.turned |= turns;
            let spinning = velocity.angular.dot(velocity.angular);
            // The reach of a half-space is infinite.
            let swing = if spinning > 0.0 { spinning * (reach.core * reach.core) } else { 0.0 };
            let squared = velocity.linear.dot(velocity.linear) + swing;
            advanced.fastest = advanced.fastest.max(squared);
            // In the plane nothing precesses.
            if A == 3 && kind.rate > 0.0 && turn.dot(turn) > SMALL_TURN * SMALL_TURN {
                spin.followed += turn;
                precessing[*count] = body;
                *count += 1;
            }
        }
        advanced
    }

    /// Turns these bodies freely for `h` \[s\].
    fn precess(&mut self, h: f32, precessing: &[u16]) {
        for group in precessing.chunks(TOGETHER) {
            // The last stands where there is none.
            let own = |index: usize| usize::from(group[index.min(group.len() - 1)]);
            let spins: [_; TOGETHER] = std::array::from_fn(|index| {
                let own = own(index);
                let inertia = &self.given.inertia[self.first + own];
                Spin {
                    pose: self.poses[own],
                    moments: [&inertia.moments, &inertia.inverse_moments],
                    precession: self.given.precession[self.first + own],
                    omega: self.velocities[own].angular,
                    remainder: self.turns[own].remainder,
                }
            });
            G::precess(&spins, group.len(), h, |index, pose, [omega, remainder]| {
                let own = own(index);
                // It is not from contacts.
                self.prospective[own].angular += omega - self.velocities[own].angular;
                self.velocities[own].angular = omega;
                self.turns[own].remainder = remainder;
                self.poses[own] = pose;
                let turn = omega * h;
                if turn.dot(turn) > kinematics::FAST_TURN * kinematics::FAST_TURN {
                    let moments = self.given.inertia[self.first + own].inverse_moments;
                    self.masses[own].angular = G::frame(&pose).tensor(moments);
                }
            });
        }
    }
}

/// An angular velocity is worth a renewed J. \[rad/s\]
fn turns<const A: usize>(omega: Vector<f32, A>) -> bool {
    omega.dot(omega) > kinematics::LEAST_SPIN * kinematics::LEAST_SPIN
}

/// The part of one vector that another has in common with it: 0 to 1 times the first.
fn common<const N: usize>(of: Vector<f32, N>, with: Vector<f32, N>) -> Vector<f32, N> {
    let (along, squared) = (of.dot(with), of.dot(of));
    if along > 0.0 && squared > 0.0 { of * (along / squared).min(1.0) } else { Vector::ZERO }
}

/// Moves the poses by what `advance` has summed up over the step.
pub(crate) fn arrive<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &mut Bodies<G, L, A>,
    pool: &ThreadPool,
    displacements: &[Velocity<f32, L, A>],
    velocities: &mut [Velocity<f32, L, A>],
) {
    let Bodies {
        poses,
        turns,
        frames,
        remainders,
        paths,
        since_search,
        moved_since_rebuild,
        reach,
        precession,
        inertia,
        ..
    } = bodies;
    let (useful, share) = pool.share(displacements.len(), GRAIN);
    let placed = poses.chunks_mut(share).zip(turns.chunks_mut(share));
    let exact = frames.chunks_mut(share).zip(remainders.chunks_mut(share));
    let sizes = reach.chunks(share).zip(precession.chunks(share)).zip(inertia.chunks(share));
    let went = paths
        .chunks_mut(share)
        .zip(since_search.chunks_mut(share))
        .zip(moved_since_rebuild.chunks_mut(share))
        .zip(sizes);
    let moved = displacements.chunks(share).zip(velocities.chunks_mut(share));
    let parts = moved.zip(placed.zip(exact).zip(went));
    pool.for_each(useful, parts, |((displacements, velocities), ((placed, exact), went))| {
        let placed = placed.0.iter_mut().zip(placed.1);
        let exact = exact.0.iter_mut().zip(exact.1);
        let (((paths, since_search), moved_since_rebuild), ((reach, kinds), inertia)) = went;
        let own = reach.iter().zip(kinds).zip(inertia);
        let went = paths.iter_mut().zip(since_search).zip(moved_since_rebuild).zip(own);
        for (
            (displacement, velocity),
            (
                ((pose, turned), (frame, remainder)),
                (((path, since_search), moved_since_rebuild), ((reach, kind), inertia)),
            ),
        ) in displacements.iter().zip(velocities).zip(placed.zip(exact).zip(went))
        {
            if *displacement == Velocity::ZERO {
                *since_search = SearchMotion::NOWHERE;
                continue;
            }
            let by = displacement.linear + *remainder;
            // Displacements tell of blows within a substep, too.
            let turn = displacement.angular - std::mem::replace(&mut turned.followed, Vector::ZERO);
            let struck = std::mem::take(&mut turned.struck);
            let before = *frame;
            if kind.rate > 0.0 && turn.dot(turn) > LEAST_TURN * LEAST_TURN {
                let omega = &mut velocity.angular;
                let spin = (omega, turned, kind);
                *pose = precess_late::<G, L, A>(pose, by, turn, struck, spin, inertia);
            } else {
                *pose = G::advance(pose, by, turn);
            }
            *frame = G::frame(pose);
            *remainder = rounding(before.position, by, frame.position);
            // ||R - R'|| is at most this. What does not precess has turned but now.
            let far = if kind.rate > 0.0 {
                let axes = frame.axes.iter().zip(&before.axes);
                axes.fold(0.0, |sum, (now, then)| sum + (*now - *then).length())
            } else {
                turn.length()
            };
            *since_search = SearchMotion { linear: displacement.linear, turned: far * reach.core };
            let way = since_search.linear.length() + since_search.turned;
            *path += f64::from(way);
            *moved_since_rebuild += way;
        }
    });
}

/// The pose of a body that is moved `by` \[m\] and has a `turn` \[rad\] left, of which its angular velocity is along
/// some part: so far it turns freely.
///
/// The rest is from impacts and forces within the step. It turns the body, and with that its inertia, at once: one
/// that was `struck` keeps its energy then.
#[inline(never)]
fn precess_late<G: Geometry<L, A>, const L: usize, const A: usize>(
    pose: &G::Pose,
    by: Vector<f32, L>,
    turn: Vector<f32, A>,
    struck: bool,
    (omega, turned, precession): (&mut Vector<f32, A>, &mut SpinState<A>, &Precession),
    inertia: &Inertia<L, A>,
) -> G::Pose {
    let squared = omega.dot(*omega);
    let time = if squared > 0.0 { (turn.dot(*omega) / squared).max(0.0) } else { 0.0 };
    let rest = turn - *omega * time;
    let mut end = G::advance(pose, by, rest);
    if struck {
        *omega = turned_at_once(&G::frame(pose), &G::frame(&end), *omega, inertia);
    }
    let Inertia { moments, inverse_moments, .. } = inertia;
    let spin = Spin {
        pose: end,
        moments: [moments, inverse_moments],
        precession: *precession,
        omega: *omega,
        remainder: turned.remainder,
    };
    G::precess(&[spin; TOGETHER], 1, time, |_, pose, [own, remainder]| {
        (end, *omega, turned.remainder) = (pose, own, remainder);
    });
    end
}

/// The angular velocity \[rad/s\] of a body whose frame turns in no time: it keeps the direction of its angular
/// momentum, and its energy.
///
/// With the angular velocity of before, the energy would be another: 10 % more after an impact on a slender body.
fn turned_at_once<const L: usize, const A: usize>(
    from: &Frame<L>,
    to: &Frame<L>,
    omega: Vector<f32, A>,
    Inertia { moments, inverse_moments, .. }: &Inertia<L, A>,
) -> Vector<f32, A> {
    let moments: SymmetricMatrix<f64, A> = moments.cast();
    let before: Vector<f64, A> = from.local_turning(omega).cast();
    let momentum = from.turning((moments * before).cast());
    let after = inverse_moments.cast::<f64>() * to.local_turning(momentum).cast();
    let [energy, found] = [before, after].map(|omega| omega.dot(moments * omega));
    if energy > 0.0 && found > 0.0 {
        to.turning((after * (energy / found).sqrt()).cast())
    } else {
        omega
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
