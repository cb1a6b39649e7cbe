//! Free motion of bodies: prediction of velocities at the start of a substep, and motion at its
//! end.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use drystone_solver::kinematics;
use drystone_solver::thread_pool::ThreadPool;
use drystone_solver::{InverseMass, Repair, SymmetricMatrix, Vector, Velocity};

use crate::balance::Balance;
use crate::bodies::{
    Bodies, BodyParams, BodyView, GRAIN, Inertia, SearchMotion, SpinState, damped,
};
use crate::geometry::{Frame, Geometry, PRECESS_LANES, Precession, Spin};

/// Number of bodies per chunk. In each chunk, the precessing bodies are collected before they are
/// rotated.
const CHUNK: usize = 256;

/// Below this angle per substep \[rad\], a body precesses at the end of the part, not in each
/// substep. A quaternion of `f32` is too coarse for smaller rotations.
pub(crate) const SMALL_TURN: f32 = 1e-4;

/// Below this angle \[rad\] a body does not precess at the end of the part. Its angular velocity
/// would change by less than this fraction.
const LEAST_TURN: f32 = 1e-5;

/// Least acceleration for the weight of a mechanism, which it has without gravity. \[m/s^2\]
pub(crate) const LEAST_GRAVITY: f64 = 9.81;

/// Largest load of contacts on a body with joints, over its weight, whose constant part displaces
/// it. \[1\]
const MOST_BORNE: f32 = 20.0;

/// Largest rotation of such a body by the constant part in a substep. \[rad\]
pub(crate) const MOST_TURN: f32 = 0.02;

/// Parameters of the substeps of a part.
#[derive(Clone, Copy)]
pub(crate) struct SubstepParams<const L: usize> {
    /// Length of a substep. \[s\]
    pub(crate) h: f32,
    pub(crate) substeps: u32,
    /// Sweeps over all contacts per substep.
    pub(crate) iterations: u32,
    /// Acceleration of gravity. \[m/s^2\]
    pub(crate) gravity: Vector<f32, L>,
    pub(crate) repair: Repair<f32>,
    /// Softness of contacts: epsilon / (A_ii + epsilon). \[1\]
    pub(crate) softness: f32,
    /// Stretch of locks that carry the weight of their mechanism. \[m\]
    pub(crate) stretch: f32,
}

/// The bodies of a batch: slices of their state, and the constant properties of all bodies.
pub(crate) struct MovingBodies<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    /// Index of the first body.
    pub(crate) first: usize,
    pub(crate) velocities: &'a mut [Velocity<f32, L, A>],
    /// Prospective velocities v*: those without the contact impulses of the substep.
    pub(crate) prospective: &'a mut [Velocity<f32, L, A>],
    /// Displacements since the part began.
    pub(crate) displacements: &'a mut [Velocity<f32, L, A>],
    /// Velocities that springs and contacts give to bodies with joints in each substep, if there are joints.
    pub(crate) standing_gains: &'a mut [Velocity<f32, L, A>],
    /// Velocities, v*, displacements and gains by contacts at the start of the substep, if there are joints:
    /// it may be [taken back](Self::restore_start).
    pub(crate) start: [&'a mut [Velocity<f32, L, A>]; 4],
    /// Bodies of which [contacts and joints take turns](crate::joint_batch::JointBatch::mark_unsettled), if
    /// there are joints.
    pub(crate) unsettled: &'a mut [bool],
    /// M^-1 J^T gamma of the last warm start.
    pub(crate) contact_gains: &'a mut [Velocity<f32, L, A>],
    /// How contacts and joints balance.
    pub(crate) balances: &'a mut [Balance<L, A>],
    pub(crate) poses: &'a mut [G::Pose],
    pub(crate) spin_states: &'a mut [SpinState<A>],
    pub(crate) turned: &'a mut [bool],
    /// M^-1.
    pub(crate) masses: &'a mut [InverseMass<f32, L, A>],
    /// Properties of all bodies.
    pub(crate) properties: BodyParams<'a, L, A>,
    pub(crate) pool: &'a ThreadPool,
}

impl<'a, G: Geometry<L, A>, const L: usize, const A: usize> MovingBodies<'a, G, L, A> {
    /// Returns all bodies.
    pub(crate) fn new(
        bodies: &'a mut Bodies<G, L, A>,
        [prospective, displacements, standing_gains]: [&'a mut [Velocity<f32, L, A>]; 3],
        (start, unsettled): ([&'a mut [Velocity<f32, L, A>]; 4], &'a mut [bool]),
        pool: &'a ThreadPool,
    ) -> Self {
        let own = bodies.in_motion();
        Self {
            first: 0,
            velocities: own.velocities,
            prospective,
            displacements,
            standing_gains,
            start,
            unsettled,
            contact_gains: own.contact_gains,
            balances: own.balances,
            poses: own.poses,
            spin_states: own.spin_states,
            turned: own.turned,
            masses: own.inverse_masses,
            properties: own.properties,
            pool,
        }
    }

    /// Splits into the first `count` bodies and the others.
    pub(crate) fn split_at(self, count: usize) -> (Self, Self) {
        let (velocities, later_velocities) = self.velocities.split_at_mut(count);
        let (prospective, later_prospective) = self.prospective.split_at_mut(count);
        let (displacements, later_displacements) = self.displacements.split_at_mut(count);
        let (contact_gains, later_gains) = self.contact_gains.split_at_mut(count);
        let (balances, later_balances) = self.balances.split_at_mut(count);
        let (poses, later_poses) = self.poses.split_at_mut(count);
        let (spin_states, later_spin_states) = self.spin_states.split_at_mut(count);
        let (turned, later_turned) = self.turned.split_at_mut(count);
        let (masses, later_masses) = self.masses.split_at_mut(count);
        let (standing_gains, later_standing_gains) = split_filled(self.standing_gains, count);
        let (unsettled, later_unsettled) = split_filled(self.unsettled, count);
        let mut later_start: [&mut [_]; 4] = Default::default();
        let mut start: [&mut [_]; 4] = Default::default();
        for (all, parts) in self.start.into_iter().zip(start.iter_mut().zip(&mut later_start)) {
            (*parts.0, *parts.1) = split_filled(all, count);
        }
        let first = Self {
            velocities,
            prospective,
            displacements,
            contact_gains,
            balances,
            poses,
            spin_states,
            turned,
            masses,
            standing_gains,
            start,
            unsettled,
            ..self
        };
        let others = Self {
            first: self.first + count,
            velocities: later_velocities,
            prospective: later_prospective,
            displacements: later_displacements,
            contact_gains: later_gains,
            balances: later_balances,
            poses: later_poses,
            spin_states: later_spin_states,
            turned: later_turned,
            masses: later_masses,
            standing_gains: later_standing_gains,
            start: later_start,
            unsettled: later_unsettled,
            ..self
        };
        (first, others)
    }

    /// Returns the bodies as joints see them.
    pub(crate) fn view(&self) -> BodyView<'_, G, L, A> {
        BodyView {
            first: self.first,
            poses: self.poses,
            velocities: self.velocities,
            masses: self.masses,
            spin_states: self.spin_states,
            displacements: self.displacements,
            properties: self.properties,
        }
    }

    /// Keeps what a substep changes before its bodies move.
    pub(crate) fn keep_start(&mut self) {
        let now = [&self.velocities, &self.prospective, &self.displacements, &self.contact_gains];
        for (start, now) in self.start.iter_mut().zip(now) {
            start.copy_from_slice(now);
        }
    }

    /// Takes back what a substep has changed.
    pub(crate) fn restore_start(&mut self) {
        let Self { velocities, prospective, displacements, contact_gains, .. } = self;
        let now = [velocities, prospective, displacements, contact_gains];
        for (start, now) in self.start.iter().zip(now) {
            now.copy_from_slice(start);
        }
    }

    /// Applies gravity and forces: v* = v + h (g + M^-1 f), with damping. Stores in `prospective`
    /// the contribution of contacts in the previous substep, M^-1 J^T gamma: the velocities minus
    /// the old prospective ones.
    ///
    /// A substep moves bodies by h v at its end. Under a constant force the displacement is
    /// h (v_start + v) / 2. Therefore displacements start at -h (v* - v) / 2. A body in free flight
    /// then follows its parabola exactly, and contacts see its true position.
    pub(crate) fn predict(&mut self, params: &SubstepParams<L>) {
        let SubstepParams { gravity, h, .. } = *params;
        let (first, properties) = (self.first, self.properties);
        let (useful, share) = self.pool.share(self.velocities.len(), GRAIN);
        let parts = self.velocities.chunks_mut(share).zip(self.prospective.chunks_mut(share));
        let parts = parts.zip(self.displacements.chunks_mut(share).zip(self.masses.chunks(share)));
        self.pool.for_each(
            useful,
            parts.enumerate(),
            |(part, ((velocities, contact_gain), others))| {
                let numbers = first + share * part..;
                let own =
                    velocities.iter_mut().zip(contact_gain).zip(others.0.iter_mut().zip(others.1));
                for (body, ((velocity, contact_gain), (moved, mass))) in numbers.zip(own) {
                    *contact_gain = *velocity - *contact_gain;
                    if !properties.is_dynamic(body) {
                        continue;
                    }
                    let force = properties.force(body);
                    let mut gain = Velocity::ZERO;
                    if mass.linear > 0.0 {
                        let fall = properties.gravity_on(body, gravity);
                        gain.linear = (fall + force.linear * mass.linear) * h;
                    }
                    if force.angular != Vector::ZERO {
                        gain.angular = (mass.angular * force.angular) * h;
                    }
                    if let Some(damping) = properties.damping.get(body) {
                        gain += damped(*damping, velocity, &gain, h);
                    }
                    *velocity += gain;
                    *moved -= gain * (0.5 * h);
                }
            },
        );
    }

    /// Computes v = v* + M^-1 J^T gamma of the previous substep, which `predict` has stored in
    /// `prospective`. Stores v* there instead.
    ///
    /// While nothing rotates, J and M are constant, so the contribution of contacts need not be
    /// recomputed.
    pub(crate) fn reapply_gains(&mut self) {
        let (useful, share) = self.pool.share(self.velocities.len(), GRAIN);
        let parts = self.velocities.chunks_mut(share).zip(self.prospective.chunks_mut(share));
        self.pool.for_each(useful, parts, |(velocities, contact_gain)| {
            for (velocity, contact_gain) in velocities.iter_mut().zip(contact_gain) {
                let prospective = *velocity;
                *velocity += *contact_gain;
                *contact_gain = prospective;
            }
        });
    }

    /// Subtracts h p / 2 from the displacements. p is the constant part of M^-1 J^T gamma: the part
    /// that the warm starts of this substep and of the previous one have in common. So sliding,
    /// rolling and rocking bodies move with second-order accuracy in h, too. An impact has no
    /// constant part. Of bodies with joints p is added to the gains by springs: joints take of it again
    /// what they [bear](crate::joint_batch::JointBatch::offset_displacements). If the solve is not `exact`,
    /// only what is [borne](borne) by bodies themselves, or by springs, is added. Returns true if any body
    /// rotates ([`kinematics`](drystone_solver::kinematics)).
    pub(crate) fn offset_displacements(&mut self, params: &SubstepParams<L>) -> bool {
        let SubstepParams { gravity, h, .. } = *params;
        let (first, properties) = (self.first, self.properties);
        let (useful, share) = self.pool.share(self.velocities.len(), GRAIN);
        let moved = self.velocities.chunks(share).zip(self.prospective.chunks(share));
        let moved = moved.zip(self.displacements.chunks_mut(share));
        let mut standing = self.standing_gains.chunks_mut(share);
        let gains = self.contact_gains.chunks_mut(share);
        let gains = gains.map(|own| (own, standing.next().unwrap_or_default()));
        let turning = AtomicBool::new(false);
        self.pool.for_each(
            useful,
            moved.zip(gains).enumerate(),
            |(part, (moved, (contact_gains, standing)))| {
                let ((velocities, prospective), displacements) = moved;
                let moved = velocities.iter().zip(prospective).zip(displacements);
                let (mut any, mut standing) = (false, standing.iter_mut());
                for (body, (((velocity, prospective), displacement), contact_gain)) in
                    (first + share * part..).zip(moved.zip(contact_gains))
                {
                    any |= needs_renewal(velocity.angular);
                    let now = *velocity - *prospective;
                    let before = std::mem::replace(contact_gain, now);
                    let constant = Velocity {
                        linear: common(now.linear, before.linear),
                        angular: common(now.angular, before.angular),
                    };
                    match standing.next() {
                        Some(standing) if properties.has_joint(body) => {
                            let weight = properties.gravity_on(body, gravity).length() * h;
                            let borne = || borne(&constant, standing, weight, h);
                            let exact = properties.is_exact(body);
                            *standing += constant * if exact { 1.0 } else { borne() };
                        }
                        _ => *displacement -= constant * (0.5 * h),
                    }
                }
                if any {
                    turning.store(true, Ordering::Relaxed);
                }
            },
        );
        turning.into_inner()
    }

    /// Displaces a body of a joint by its index in the batch, and leaves it its velocity.
    pub(crate) fn displace(&mut self, index: usize, by: Velocity<f32, L, A>) {
        self.displacements[index] += by;
        self.turned[index] = true;
        if A == 3 {
            self.spin_states[index].followed += by.angular;
            self.poses[index] = G::advance(&self.poses[index], Vector::ZERO, by.angular);
        }
    }

    /// Adds h v to the displacements. A body that precesses rotates at once: its free motion
    /// conserves the angular momentum and, to second order in h, the energy. The other bodies
    /// rotate at the end of the part.
    pub(crate) fn advance(&mut self, params: &SubstepParams<L>) -> Advanced {
        let (properties, h) = (self.properties, params.h);
        let (useful, share) = self.pool.share(self.velocities.len(), GRAIN);
        let moved = self.velocities.chunks_mut(share).zip(self.prospective.chunks_mut(share));
        let moved = moved.zip(self.displacements.chunks_mut(share));
        let placed = self.poses.chunks_mut(share).zip(self.spin_states.chunks_mut(share));
        let placed = placed.zip(self.turned.chunks_mut(share).zip(self.masses.chunks_mut(share)));
        let firsts = (self.first..).step_by(share);
        let (any, fastest) = (AtomicBool::new(false), AtomicU32::new(0));
        self.pool.for_each(useful, firsts.zip(moved.zip(placed)), |(first, (moved, placed))| {
            let ((velocities, prospective), displacements) = moved;
            let ((poses, spin_states), (turned, masses)) = placed;
            let mut squared = 0.0_f32;
            for start in (0..velocities.len()).step_by(CHUNK) {
                let own = start..velocities.len().min(start + CHUNK);
                let mut bodies = Chunk::<G, L, A> {
                    first: first + start,
                    velocities: &mut velocities[own.clone()],
                    prospective: &mut prospective[own.clone()],
                    displacements: &mut displacements[own.clone()],
                    poses: &mut poses[own.clone()],
                    spin_states: &mut spin_states[own.clone()],
                    turned: &mut turned[own.clone()],
                    masses: &mut masses[own],
                    properties,
                };
                let (mut precessing, mut count) = ([0; CHUNK], 0);
                let advanced = bodies.advance(h, &mut precessing, &mut count);
                squared = squared.max(advanced.fastest);
                if advanced.turned {
                    any.store(true, Ordering::Relaxed);
                }
                bodies.precess(h, &precessing[..count]);
            }
            // The bits of non-negative numbers have the same order as the numbers.
            fastest.fetch_max(squared.to_bits(), Ordering::Relaxed);
        });
        let fastest = f32::from_bits(fastest.into_inner()).sqrt();
        Advanced { turned: any.into_inner(), fastest }
    }
}

/// Returns the share of the constant gain of a substep of `h` \[s\] up to which contacts bear a body
/// itself, which would gain `weight` \[m/s\] by gravity alone, and what a `spring` gives it.
fn borne<const L: usize, const A: usize>(
    gain: &Velocity<f32, L, A>,
    spring: &Velocity<f32, L, A>,
    weight: f32,
    h: f32,
) -> f32 {
    let share = |own: f32, all: f32, most: f32| if all.min(own) > most { most / own } else { 1.0 };
    let all = *gain + *spring;
    let most = (MOST_BORNE * weight).max(spring.linear.length());
    let of_speed = share(gain.linear.length(), all.linear.length(), most);
    let most = (MOST_TURN / h).max(spring.angular.length());
    of_speed.min(share(gain.angular.length(), all.angular.length(), most))
}

/// Splits a slice that may be empty.
fn split_filled<T>(slice: &mut [T], count: usize) -> (&mut [T], &mut [T]) {
    slice.split_at_mut(count.min(slice.len()))
}

/// Speeds of the bodies in a substep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Advanced {
    /// True if any body rotates faster than [`LEAST_SPIN`](kinematics::LEAST_SPIN).
    pub(crate) turned: bool,
    /// Largest sqrt(v^2 + (omega r)^2) of any body, where r is the lever by which a rotation moves
    /// a surface ([`Reach::core`]). Surfaces approach each other at most 2^(3/2) times as
    /// fast. \[m/s\]
    ///
    /// [`Reach::core`]: crate::geometry::Reach::core
    pub(crate) fastest: f32,
}

/// Consecutive bodies, [`CHUNK`] at most.
struct Chunk<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    /// Index of the first body.
    first: usize,
    velocities: &'a mut [Velocity<f32, L, A>],
    prospective: &'a mut [Velocity<f32, L, A>],
    displacements: &'a mut [Velocity<f32, L, A>],
    poses: &'a mut [G::Pose],
    spin_states: &'a mut [SpinState<A>],
    turned: &'a mut [bool],
    masses: &'a mut [InverseMass<f32, L, A>],
    /// Properties of all bodies.
    properties: BodyParams<'a, L, A>,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Chunk<'_, G, L, A> {
    /// Adds h v to the displacements, and collects the indices of the `count` bodies that are
    /// `precessing`. Returns the square of the largest speed in [`Advanced::fastest`].
    fn advance(&mut self, h: f32, precessing: &mut [u16; CHUNK], count: &mut usize) -> Advanced {
        let moved = self.displacements.iter_mut().zip(&*self.velocities);
        let spins = self.spin_states.iter_mut().zip(&mut *self.turned);
        let kinds = self.properties.precession[self.first..]
            .iter()
            .zip(&self.properties.reach[self.first..]);
        let mut advanced = Advanced { turned: false, fastest: 0.0 };
        for (body, ((moved, spin), (kind, reach))) in (0..).zip(moved.zip(spins).zip(kinds)) {
            let ((displacement, velocity), (spin, turned)) = (moved, spin);
            let step = *velocity * h;
            *displacement += step;
            let turn = step.angular;
            let is_turning = needs_renewal(velocity.angular);
            *turned |= is_turning;
            advanced.turned |= is_turning;
            let spinning = velocity.angular.dot(velocity.angular);
            // The reach of a half-space is infinite.
            let swing = if spinning > 0.0 { spinning * (reach.core * reach.core) } else { 0.0 };
            let squared = velocity.linear.dot(velocity.linear) + swing;
            advanced.fastest = advanced.fastest.max(squared);
            // There is no precession in 2D.
            if A == 3 && kind.rate > 0.0 && turn.dot(turn) > SMALL_TURN * SMALL_TURN {
                spin.followed += turn;
                precessing[*count] = body;
                *count += 1;
            } else if A == 3
                && self.properties.has_joint(self.first + usize::from(body))
                && turn.dot(turn) > SMALL_TURN * SMALL_TURN
            {
                spin.followed += turn;
                let pose = &mut self.poses[usize::from(body)];
                *pose = G::advance(pose, Vector::ZERO, turn);
            }
        }
        advanced
    }

    /// Rotates these bodies freely for `h` \[s\].
    fn precess(&mut self, h: f32, precessing: &[u16]) {
        for group in precessing.chunks(PRECESS_LANES) {
            // The last body fills the empty lanes.
            let own = |index: usize| usize::from(group[index.min(group.len() - 1)]);
            let spins: [_; PRECESS_LANES] = std::array::from_fn(|index| {
                let own = own(index);
                let inertia = &self.properties.inertia[self.first + own];
                Spin {
                    pose: self.poses[own],
                    moments: [&inertia.moments, &inertia.inverse_moments],
                    precession: self.properties.precession[self.first + own],
                    omega: self.velocities[own].angular,
                    remainder: self.spin_states[own].remainder,
                }
            });
            G::precess(&spins, group.len(), h, |index, pose, [omega, remainder]| {
                let own = own(index);
                // Precession does not count as an effect of contacts.
                self.prospective[own].angular += omega - self.velocities[own].angular;
                self.velocities[own].angular = omega;
                self.spin_states[own].remainder = remainder;
                self.poses[own] = pose;
                let turn = omega * h;
                if turn.dot(turn) > kinematics::FAST_TURN * kinematics::FAST_TURN {
                    let moments = self.properties.inertia[self.first + own].inverse_moments;
                    self.masses[own].angular = G::frame(&pose).tensor(moments);
                }
            });
        }
    }
}

/// Returns true if J must be updated for this angular velocity. \[rad/s\]
fn needs_renewal<const A: usize>(omega: Vector<f32, A>) -> bool {
    omega.dot(omega) > kinematics::LEAST_SPIN * kinematics::LEAST_SPIN
}

/// Returns the part of a vector that it has in common with another: 0 to 1 times the vector.
fn common<const N: usize>(of: Vector<f32, N>, with: Vector<f32, N>) -> Vector<f32, N> {
    let (along, squared) = (of.dot(with), of.dot(of));
    if along > 0.0 && squared > 0.0 { of * (along / squared).min(1.0) } else { Vector::ZERO }
}

/// Moves the poses by the displacements that `advance` has summed up.
pub(crate) fn integrate_poses<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &mut Bodies<G, L, A>,
    pool: &ThreadPool,
    displacements: &[Velocity<f32, L, A>],
) {
    let Bodies {
        velocities,
        poses,
        spin_states,
        frames,
        position_remainders,
        path_lengths,
        since_search,
        moved_since_rebuild,
        reach,
        precession,
        inertia,
        ..
    } = bodies;
    let (useful, share) = pool.share(displacements.len(), GRAIN);
    let placed = poses.chunks_mut(share).zip(spin_states.chunks_mut(share));
    let exact = frames.chunks_mut(share).zip(position_remainders.chunks_mut(share));
    let sizes = reach.chunks(share).zip(precession.chunks(share)).zip(inertia.chunks(share));
    let went = path_lengths
        .chunks_mut(share)
        .zip(since_search.chunks_mut(share))
        .zip(moved_since_rebuild.chunks_mut(share))
        .zip(sizes);
    let moved = displacements.chunks(share).zip(velocities.chunks_mut(share));
    let parts = moved.zip(placed.zip(exact).zip(went));
    pool.for_each(useful, parts, |((displacements, velocities), ((placed, exact), went))| {
        let placed = placed.0.iter_mut().zip(placed.1);
        let exact = exact.0.iter_mut().zip(exact.1);
        let (((path_lengths, since_search), moved_since_rebuild), ((reach, kinds), inertia)) = went;
        let own = reach.iter().zip(kinds).zip(inertia);
        let went = path_lengths.iter_mut().zip(since_search).zip(moved_since_rebuild).zip(own);
        for (
            (displacement, velocity),
            (
                ((pose, spin_state), (frame, remainder)),
                (((path, since_search), moved_since_rebuild), ((reach, kind), inertia)),
            ),
        ) in displacements.iter().zip(velocities).zip(placed.zip(exact).zip(went))
        {
            if *displacement == Velocity::ZERO {
                *since_search = SearchMotion::NOWHERE;
                continue;
            }
            let exact = ExactPose { pose, spin_state, frame, remainder };
            let far = exact.integrate::<G>(displacement, velocity, (kind, inertia));
            *since_search = SearchMotion { linear: displacement.linear, turned: far * reach.core };
            let travel = since_search.linear.length() + since_search.turned;
            *path += f64::from(travel);
            *moved_since_rebuild += travel;
        }
    });
}

/// Pose of a body, and the position_remainders of rounding and precession.
struct ExactPose<'a, P, const L: usize, const A: usize> {
    pose: &'a mut P,
    spin_state: &'a mut SpinState<A>,
    frame: &'a mut Frame<L>,
    remainder: &'a mut Vector<f32, L>,
}

impl<P, const L: usize, const A: usize> ExactPose<'_, P, L, A> {
    /// Moves a body by a displacement. Returns an upper bound of the change of its rotation matrix.
    fn integrate<G: Geometry<L, A, Pose = P>>(
        self,
        displacement: &Velocity<f32, L, A>,
        velocity: &mut Velocity<f32, L, A>,
        (kind, inertia): (&Precession, &Inertia<L, A>),
    ) -> f32 {
        let Self { pose, spin_state, frame, remainder } = self;
        let by = displacement.linear + *remainder;
        // Displacements include corrections for impacts within a substep.
        let turn = displacement.angular - std::mem::replace(&mut spin_state.followed, Vector::ZERO);
        let had_impact = std::mem::take(&mut spin_state.had_impact);
        let before = *frame;
        if kind.rate > 0.0 && turn.dot(turn) > LEAST_TURN * LEAST_TURN {
            let spin = (&mut velocity.angular, spin_state, kind);
            *pose = precess_late::<G, L, A>(pose, by, turn, had_impact, spin, inertia);
        } else {
            *pose = G::advance(pose, by, turn);
        }
        *frame = G::frame(pose);
        *remainder = rounding(before.position, by, frame.position);
        // A body that does not precess has rotated by `turn` only.
        if kind.rate > 0.0 {
            let axes = frame.axes.iter().zip(&before.axes);
            axes.fold(0.0, |sum, (now, then)| sum + (*now - *then).length())
        } else {
            turn.length()
        }
    }
}

/// Returns the pose of a body that has been moved `by` \[m\] and has the rotation `turn` \[rad\]
/// left. The part of `turn` along the angular velocity is a free rotation with precession; the rest
/// is from impacts and forces within the step. It rotates the body, and with it its inertia, at
/// once: a body that `had_impact` keeps its energy then.
#[inline(never)]
fn precess_late<G: Geometry<L, A>, const L: usize, const A: usize>(
    pose: &G::Pose,
    by: Vector<f32, L>,
    turn: Vector<f32, A>,
    had_impact: bool,
    (omega, spin_state, precession): (&mut Vector<f32, A>, &mut SpinState<A>, &Precession),
    inertia: &Inertia<L, A>,
) -> G::Pose {
    let squared = omega.dot(*omega);
    let time = if squared > 0.0 { (turn.dot(*omega) / squared).max(0.0) } else { 0.0 };
    let rest = turn - *omega * time;
    let mut end = G::advance(pose, by, rest);
    if had_impact {
        *omega = turned_at_once(&G::frame(pose), &G::frame(&end), *omega, inertia);
    }
    let Inertia { moments, inverse_moments, .. } = inertia;
    let spin = Spin {
        pose: end,
        moments: [moments, inverse_moments],
        precession: *precession,
        omega: *omega,
        remainder: spin_state.remainder,
    };
    G::precess(&[spin; PRECESS_LANES], 1, time, |_, pose, [own, remainder]| {
        (end, *omega, spin_state.remainder) = (pose, own, remainder);
    });
    end
}

/// Returns the angular velocity \[rad/s\] of a body whose frame rotates at once. It keeps the
/// energy of the body, and the direction of its angular momentum.
///
/// With the old angular velocity the energy would change, by 10 % after an impact on a slender
/// body.
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

/// Returns a + b - sum exactly, where `sum` is a + b rounded (Knuth, The Art of Computer
/// Programming 2, 4.2.2).
fn rounding<const L: usize>(
    a: Vector<f32, L>,
    b: Vector<f32, L>,
    sum: Vector<f32, L>,
) -> Vector<f32, L> {
    let own = sum - a;
    (a - (sum - own)) + (b - own)
}
