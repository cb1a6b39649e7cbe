//! [`Mechanisms`]: all rows of the joints of connected bodies as one block.
//!
//! A chain of n bodies needs about n^2 sweeps, times the ratio of its masses. So all joints that
//! connect bodies are solved together. The velocities minimize P(v) of the
//! [`certificate`](crate::certificate) over the rows of the joints, while contacts keep their
//! impulses:
//!
//! ```text
//! H dv  = J^T r(v) - M (v - v*)     H = M + J^T (1 / epsilon) J over the rows inside their bounds
//! r     = clamp((t - J v) / epsilon, lo, hi)
//! ```
//!
//! H has one row of blocks per body. If the joints form a tree, the cost of its factor is in
//! proportion to the number of bodies; each loop adds fill. If no row has reached or left a bound
//! since the last visit, one solve is exact. So for contacts the mechanism is a constraint like any
//! other, visited once after a sweep. The factor is kept while J and the set of rows within their
//! bounds stay the same.
//!
//! A visit starts at velocities v_0 that include the impulses r_0 of the rows, so
//! M (v - v*) = M (v - v_0) + J^T r_0. The masses take part only in further steps of a visit.

use std::ops::Range;
use std::sync::Arc;

use crate::cholesky::BlockMatrix;
use crate::island::Islands;
use crate::law::{Interval, Law, SmoothLaw};
use crate::primal::{self, Projection};
use crate::registers::with_best_registers;
use crate::thread_pool::ThreadPool;
use crate::{Axis, InverseMass, Joint, Vector, Velocity};

/// Largest number of steps of a visit. Each takes rows to or from their bounds.
const MOST_STEPS: usize = 40;

/// Rows in a grain of work for a thread.
const GRAIN: usize = 16;

/// Joints, mechanism by mechanism, and what solves them. No two mechanisms share a body that moves, so
/// threads take one each.
#[derive(Clone, Debug, Default)]
pub struct Mechanisms<const L: usize, const A: usize> {
    /// The joints. Those of a mechanism follow each other.
    pub joints: Vec<Joint>,
    /// Their rows, in `f64`: velocities rounded to `f32` would change impulses of stiff rows.
    pub axes: Vec<Axis<f64, L, A>>,
    mechanisms: Vec<Mechanism<L, A>>,
    pool: Arc<ThreadPool>,
}

/// One of the [`Mechanisms`] for a thread, with its own rows.
#[derive(Debug)]
pub struct MechanismPart<'a, const L: usize, const A: usize> {
    /// The first body of its batch.
    first: usize,
    /// Its joints.
    pub joints: &'a [Joint],
    /// Their rows, joint by joint.
    pub axes: &'a mut [Axis<f64, L, A>],
    mechanism: &'a mut Mechanism<L, A>,
}

/// Place of a body that cannot move.
const FIXED: usize = usize::MAX;

/// Bodies connected by joints. Vectors over bodies have N = L + A numbers for each.
#[derive(Clone, Debug, Default)]
struct Mechanism<const L: usize, const A: usize> {
    /// Its joints.
    joints: Range<usize>,
    links: Vec<Link>,
    /// Its bodies, fixed ones included; and the first of those that move.
    bodies: Vec<u32>,
    first_body: usize,
    /// Row of blocks of each body, in the order of elimination, or [`FIXED`].
    places: Vec<usize>,
    /// M of each body, N rows each, with 1 for locked velocities; and the projection onto the free
    /// ones if there are locked ones.
    masses: Vec<f64>,
    free: Vec<Option<Projection>>,
    rows: Vec<Row>,
    /// J of each row: N numbers for each of its two bodies.
    jacobians: Vec<f64>,
    velocities: Vec<f64>,
    /// v_0.
    start: Vec<f64>,
    /// -gradient, then the step -H^-1 gradient, by place.
    step: Vec<f64>,
    hessian: BlockMatrix,
    /// J_a and J_b of the loaded rows of a joint, and 1 / epsilon.
    loaded: Vec<f64>,
    /// For each row: whether its impulse changes with the velocity in the factor of H.
    factored: Vec<bool>,
    has_factor: bool,
}

/// Bodies of a joint.
#[derive(Clone, Copy, Debug)]
struct Link {
    /// Indices in the mechanism.
    sides: [usize; 2],
    /// Their places.
    places: [usize; 2],
    /// Block of H that couples them, with the side of its rows, which is eliminated first; none if they
    /// are one body or if one is fixed.
    block: Option<(usize, usize)>,
}

/// A row of a joint during a visit.
#[derive(Clone, Copy, Debug)]
struct Row {
    law: Interval<f64>,
    /// u = J v, and its change by the step. \[m/s, or rad/s\]
    velocity: f64,
    change: f64,
    /// r(u), and the impulse before the visit. \[N s, or N m s\]
    response: f64,
    before: f64,
    piece: Piece,
}

/// The pieces of the response r(u) of a row, on each of which it is linear.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Piece {
    /// Nothing moves along the row, and its impulse stays.
    Idle,
    /// Between the targets.
    Slack,
    /// Towards the target t-, or t+.
    Low,
    High,
    /// At a bound.
    AtLeast,
    AtMost,
}

impl Row {
    const IDLE: Self = Self {
        law: Interval { targets: [0.0; 2], bounds: [0.0; 2], compliance: 0.0 },
        velocity: 0.0,
        change: 0.0,
        response: 0.0,
        before: 0.0,
        piece: Piece::Idle,
    };

    /// Takes the law and the impulse of an axis, and this velocity along it. Assumes that the row stays
    /// on the piece of this impulse.
    #[inline(always)]
    fn take<const L: usize, const A: usize>(&mut self, axis: &Axis<f64, L, A>, velocity: f64) {
        let law = primal::with_compliance(axis.law);
        let ([low, high], [least, most]) = (axis.law.targets, axis.law.bounds);
        let is_idle = axis.effective_mass <= 0.0 || law.is_none() || least == most;
        self.law = law.unwrap_or(axis.law);
        (self.before, self.velocity) = (axis.impulse, velocity);
        self.piece = if is_idle { Piece::Idle } else { self.piece_of(axis.impulse) };
        self.response = match self.piece {
            // A row that has broken bears nothing.
            Piece::Idle => axis.impulse.max(least).min(most),
            Piece::Slack => 0.0,
            Piece::Low => (low - velocity) / self.law.compliance,
            Piece::High => (high - velocity) / self.law.compliance,
            Piece::AtLeast => least,
            Piece::AtMost => most,
        };
    }

    /// Returns the piece on which the response is this impulse.
    #[inline(always)]
    fn piece_of(&self, impulse: f64) -> Piece {
        let ([low, high], [least, most]) = (self.law.targets, self.law.bounds);
        match () {
            () if impulse >= most && most > 0.0 => Piece::AtMost,
            () if impulse <= least && least < 0.0 => Piece::AtLeast,
            () if low == high || impulse > 0.0 && low.is_finite() => Piece::Low,
            () if impulse < 0.0 && high.is_finite() => Piece::High,
            () => Piece::Slack,
        }
    }

    /// Sets the velocity along the row, and with it the response.
    #[inline(always)]
    fn meet(&mut self, velocity: f64) {
        self.velocity = velocity;
        if self.piece != Piece::Idle {
            self.response = self.law.response(Vector([velocity]))[0];
            self.piece = self.piece_at(velocity);
        }
    }

    #[inline(always)]
    fn piece_at(&self, velocity: f64) -> Piece {
        let [low, high] = self.law.targets;
        let is_loaded = self.law.slope(Vector([velocity])).0[0][0] > 0.0;
        match () {
            () if self.piece == Piece::Idle => Piece::Idle,
            () if is_loaded && (velocity <= low || low == high) => Piece::Low,
            () if is_loaded => Piece::High,
            () if velocity < low => Piece::AtMost,
            () if velocity > high => Piece::AtLeast,
            () => Piece::Slack,
        }
    }

    /// Returns true if the impulse changes with the velocity.
    fn is_loaded(&self) -> bool {
        matches!(self.piece, Piece::Low | Piece::High)
    }
}

impl<const L: usize, const A: usize> Mechanisms<L, A> {
    /// Returns true if there are no joints.
    pub fn is_empty(&self) -> bool {
        self.joints.is_empty()
    }

    /// Returns the order of these joints, given by their bodies, in which those of a mechanism
    /// follow each other.
    pub fn order(pairs: &[[u32; 2]], masses: &[InverseMass<f32, L, A>]) -> Vec<u32> {
        let mut islands = Islands::default();
        islands.join(masses, pairs.iter().copied());
        let mut order: Vec<u32> = (0..pairs.len() as u32).collect();
        order.sort_by_key(|&joint| islands.of_pair(pairs[joint as usize]));
        order
    }

    /// Prepares for joints of these bodies, in [order](Self::order).
    pub fn connect(&mut self, masses: &[InverseMass<f32, L, A>]) {
        let mut islands = Islands::default();
        islands.join(masses, self.joints.iter().map(|joint| joint.bodies));
        self.mechanisms.clear();
        let mut inside = vec![usize::MAX; masses.len()];
        let mut first = 0;
        let of = |joint: &Joint| islands.of_pair(joint.bodies);
        for joints in self.joints.chunk_by(|one, next| of(one) == of(next)) {
            let range = first..first + joints.len();
            first = range.end;
            self.mechanisms.push(Mechanism::of(joints, range, masses, &mut inside));
        }
        self.renew(masses);
    }

    /// Sets the thread pool that solves the mechanisms. Results do not depend on it.
    pub fn set_pool(&mut self, pool: Arc<ThreadPool>) {
        self.pool = pool;
    }

    /// Returns the bodies of one joint of each mechanism.
    pub fn pairs(&self) -> impl Iterator<Item = [u32; 2]> {
        self.mechanisms.iter().map(|of| self.joints[of.joints.start].bodies)
    }

    /// Returns all of them as one batch.
    pub fn batch(&mut self) -> MechanismBatch<'_, L, A> {
        let Self { joints, axes, mechanisms, pool } = self;
        MechanismBatch { first: 0, joints, axes, mechanisms, pool }
    }

    /// Takes the present masses of the bodies, and drops the factors of H. To be called after a
    /// change of masses, J or compliances.
    pub fn renew(&mut self, masses: &[InverseMass<f32, L, A>]) {
        self.batch().for_each(std::iter::repeat(()), |mut part, ()| part.renew(masses));
    }

    /// Visits every mechanism once: brings all rows of its joints to their targets together, from
    /// the present velocities, which include the impulses of the rows.
    pub fn solve(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.batch().solve_those(std::iter::repeat(true), velocities);
    }
}

/// Consecutive [`Mechanisms`], whose bodies are in a range of bodies. Velocities and masses are passed as
/// slices over this range. Bodies outside of it stand still.
#[derive(Debug)]
pub struct MechanismBatch<'a, const L: usize, const A: usize> {
    /// The first body of the range.
    first: usize,
    joints: &'a [Joint],
    axes: &'a mut [Axis<f64, L, A>],
    mechanisms: &'a mut [Mechanism<L, A>],
    pool: &'a ThreadPool,
}

impl<'a, const L: usize, const A: usize> MechanismBatch<'a, L, A> {
    /// Splits at a body: into the mechanisms of bodies before it, and the others.
    ///
    /// # Panics
    /// A mechanism has moving bodies on both sides.
    pub fn split_at(self, body: usize) -> (Self, Self) {
        let count = self.mechanisms.partition_point(|of| of.first_body < body);
        let (mechanisms, later_mechanisms) = self.mechanisms.split_at_mut(count);
        let end = mechanisms.last().map(|of| of.joints.end);
        let start = mechanisms.first().map(|of| of.joints.start);
        let joints = end.zip(start).map_or(0, |(end, start)| end - start);
        let (joints, later_joints) = self.joints.split_at(joints);
        let rows = joints.iter().map(|joint| joint.count as usize).sum();
        let (axes, later_axes) = self.axes.split_at_mut(rows);
        let first = Self { joints, axes, mechanisms, ..self };
        let others = Self {
            first: body,
            joints: later_joints,
            axes: later_axes,
            mechanisms: later_mechanisms,
            pool: self.pool,
        };
        (first, others)
    }

    /// Returns the number of joints between bodies of a range, which cuts no mechanism.
    pub fn count_in(&self, bodies: Range<usize>) -> usize {
        let [start, end] = [bodies.start, bodies.end].map(|body| {
            let next = self.mechanisms.partition_point(|of| of.first_body < body);
            next.checked_sub(1).map_or(0, |last| self.mechanisms[last].joints.end)
        });
        end.saturating_sub(start.max(self.mechanisms.first().map_or(0, |of| of.joints.start)))
    }

    /// Returns their number.
    pub fn count(&self) -> usize {
        self.mechanisms.len()
    }

    /// Returns the joints.
    pub fn joints(&self) -> &'a [Joint] {
        self.joints
    }

    /// Works on each mechanism, with one of the `items` for each. Threads share the work.
    pub fn for_each<T: Send>(
        &mut self,
        items: impl Iterator<Item = T> + Send,
        work: impl Fn(MechanismPart<'_, L, A>, T) + Sync,
    ) {
        let pool = self.pool;
        let useful = self.mechanisms.len() > 1 && pool.is_useful(self.axes.len() / GRAIN);
        pool.for_each(useful, self.parts().zip(items), |(part, item)| work(part, item));
    }

    /// Returns each mechanism with its own rows.
    pub fn parts(&mut self) -> impl Iterator<Item = MechanismPart<'_, L, A>> + Send {
        let Self { first, joints, axes, mechanisms, .. } = self;
        let (first, mut joints, mut left) = (*first, *joints, &mut **axes);
        mechanisms.iter_mut().map(move |mechanism| {
            let (own, later) = joints.split_at(mechanism.joints.len());
            joints = later;
            let count = own.iter().map(|joint| joint.count as usize).sum();
            let (axes, later) = std::mem::take(&mut left).split_at_mut(count);
            left = later;
            MechanismPart { first, joints: own, axes, mechanism }
        })
    }

    /// [Visits](Mechanisms::solve) the mechanisms that are due.
    pub fn solve_those(
        &mut self,
        due: impl Iterator<Item = bool> + Clone + Send,
        velocities: &mut [Velocity<f32, L, A>],
    ) {
        let seen: &[Velocity<f32, L, A>] = velocities;
        self.for_each(due.clone(), |mut part, is_due| {
            if is_due {
                part.load(seen);
                part.solve();
            }
        });
        self.store(due, velocities);
    }

    /// Stores the velocities of the mechanisms that are due.
    pub fn store(&self, due: impl Iterator<Item = bool>, velocities: &mut [Velocity<f32, L, A>]) {
        for (mechanism, _) in self.mechanisms.iter().zip(due).filter(|(_, is_due)| *is_due) {
            for (index, &body) in mechanism.bodies.iter().enumerate() {
                if mechanism.places[index] != FIXED {
                    velocities[body as usize - self.first] = mechanism.velocity(index);
                }
            }
        }
    }

    /// Adds the impulses of the rows to the velocities: v += M^-1 J^T gamma.
    pub fn apply(&self, velocities: &mut [Velocity<f32, L, A>], masses: &[InverseMass<f32, L, A>]) {
        let mut left = &*self.axes;
        for joint in self.joints {
            let (axes, later) = left.split_at(joint.count as usize);
            left = later;
            let own = joint.bodies.map(|body| of_batch(masses, self.first, body));
            for (body, gain) in joint.bodies.into_iter().zip(gains(axes, own)) {
                if let Some(velocity) = velocities.get_mut((body as usize).wrapping_sub(self.first))
                {
                    *velocity += gain;
                }
            }
        }
    }
}

/// Returns an element of a slice over the bodies from `first` on; the default for other bodies.
#[inline(always)]
pub fn of_batch<T: Copy + Default>(slice: &[T], first: usize, body: u32) -> T {
    slice.get((body as usize).wrapping_sub(first)).copied().unwrap_or_default()
}

impl<const L: usize, const A: usize> MechanismPart<'_, L, A> {
    /// Returns for each joint the indices of its bodies in the mechanism.
    pub fn sides(&self) -> impl Iterator<Item = [usize; 2]> {
        self.mechanism.links.iter().map(|link| link.sides)
    }

    /// Returns its bodies, fixed ones included.
    pub fn bodies(&self) -> &[u32] {
        &self.mechanism.bodies
    }

    /// Adds the impulses of the rows to velocities of its [`bodies`](Self::bodies).
    pub fn apply(&self, velocities: &mut [Velocity<f32, L, A>], masses: &[InverseMass<f32, L, A>]) {
        let mut left = &*self.axes;
        for (joint, link) in self.joints.iter().zip(&self.mechanism.links) {
            let (axes, later) = left.split_at(joint.count as usize);
            left = later;
            let own = joint.bodies.map(|body| of_batch(masses, self.first, body));
            for (side, gain) in link.sides.into_iter().zip(gains(axes, own)) {
                velocities[side] += gain;
            }
        }
    }

    /// Takes the present masses of the bodies, and drops the factor of H.
    pub fn renew(&mut self, masses: &[InverseMass<f32, L, A>]) {
        let mut axes = self.axes.iter_mut();
        for joint in self.joints {
            let own = &joint.bodies.map(|body| of_batch(masses, self.first, body).cast());
            axes.by_ref().take(joint.count as usize).for_each(|axis| axis.prepare(own));
        }
        self.renew_prepared(masses);
    }

    /// [Renews](Self::renew) a mechanism whose rows have their effective masses.
    pub fn renew_prepared(&mut self, masses: &[InverseMass<f32, L, A>]) {
        self.mechanism.renew(self.axes, (self.first, masses));
    }

    /// Takes the velocities of the bodies.
    pub fn load(&mut self, velocities: &[Velocity<f32, L, A>]) {
        self.mechanism.take(self.first, velocities);
    }

    /// Returns true if its bodies have these velocities.
    pub fn has(&self, velocities: &[Velocity<f32, L, A>]) -> bool {
        let own = self.mechanism.bodies.iter().zip(&self.mechanism.places).enumerate();
        own.filter(|(_, (_, place))| **place != FIXED).all(|(index, (&body, _))| {
            of_batch(velocities, self.first, body) == self.velocity(index)
        })
    }

    /// Takes bodies that stand still.
    pub fn stop(&mut self) {
        self.mechanism.take(0, &[]);
    }

    /// Returns the velocity of a body of the mechanism.
    pub fn velocity(&self, index: usize) -> Velocity<f32, L, A> {
        self.mechanism.velocity(index)
    }

    /// Returns by how much the last visit has changed the velocity of a body of the mechanism.
    pub fn change(&self, index: usize) -> Velocity<f64, L, A> {
        let of = |numbers: &[f64]| Velocity::<f64, L, A> {
            linear: Vector(std::array::from_fn(|i| numbers[i])),
            angular: Vector(std::array::from_fn(|i| numbers[L + i])),
        };
        let own = index * (L + A)..(index + 1) * (L + A);
        of(&self.mechanism.velocities[own.clone()]) - of(&self.mechanism.start[own])
    }

    /// Visits the mechanism, from the velocities that it has.
    pub fn solve(&mut self) {
        let Self { joints, axes, mechanism, .. } = self;
        with_best_registers(
            #[inline(always)]
            || match L + A {
                2 => mechanism.solve::<2>(joints, axes),
                3 => mechanism.solve::<3>(joints, axes),
                _ => mechanism.solve::<6>(joints, axes),
            },
        );
    }
}

impl<const L: usize, const A: usize> Mechanism<L, A> {
    /// Creates the mechanism of these joints. `inside` is scratch with an entry for each body of
    /// the system, all of them `usize::MAX` before and after.
    fn of(
        joints: &[Joint],
        range: Range<usize>,
        masses: &[InverseMass<f32, L, A>],
        inside: &mut [usize],
    ) -> Self {
        let mut bodies = Vec::new();
        let mut admit = |body: u32| {
            let own = &mut inside[body as usize];
            if *own == usize::MAX {
                *own = bodies.len();
                bodies.push(body);
            }
            *own
        };
        let sides: Vec<_> = joints.iter().map(|joint| joint.bodies.map(&mut admit)).collect();
        bodies.iter().for_each(|&body| inside[body as usize] = usize::MAX);
        let mut count = 0;
        let rows = bodies.iter().map(|&body| {
            let moves = masses[body as usize] != InverseMass::FIXED;
            count += u32::from(moves);
            moves.then_some(count.wrapping_sub(1))
        });
        let rows: Vec<_> = rows.collect();
        let pairs = sides.iter().filter_map(|sides| {
            let [a, b] = sides.map(|side| rows[side]);
            Some([a?, b?])
        });
        let hessian = BlockMatrix::new(L + A, count as usize, pairs);
        let place = |side: usize| rows[side].map_or(FIXED, |row| hessian.place(row));
        let links = sides.iter().map(|&sides| {
            let places = sides.map(place);
            let [a, b] = places;
            let is_pair = a != b && a != FIXED && b != FIXED;
            let block = is_pair.then(|| hessian.block_between(a.max(b), a.min(b)));
            let rows_of = usize::from(b < a);
            Link { sides, places, block: block.flatten().map(|block| (block, rows_of)) }
        });
        let links = links.collect();
        let places: Vec<_> = (0..bodies.len()).map(place).collect();
        let moving = bodies.iter().zip(&places).filter(|(_, place)| **place != FIXED);
        let first_body = moving.map(|(body, _)| *body as usize).min().unwrap_or(0);
        Self { joints: range, links, bodies, first_body, places, hessian, ..Self::default() }
    }

    /// Takes the masses of the bodies, and J.
    fn renew(
        &mut self,
        axes: &[Axis<f64, L, A>],
        (first, masses): (usize, &[InverseMass<f32, L, A>]),
    ) {
        self.masses.clear();
        self.free.clear();
        for &body in &self.bodies {
            let inverse: InverseMass<f64, L, A> = of_batch(masses, first, body).cast();
            let mass = inverse.mass();
            let free = primal::projection(&mass, &inverse);
            for i in 0..L + A {
                for j in 0..L + A {
                    self.masses.push(primal::mass_entry(&mass, free.as_ref(), i, j));
                }
            }
            self.free.push(free);
        }
        self.jacobians.clear();
        for axis in axes {
            for Velocity { linear, angular } in &axis.jacobian {
                self.jacobians.extend_from_slice(&linear.0);
                self.jacobians.extend_from_slice(&angular.0);
            }
        }
        self.rows.resize(self.jacobians.len() / (2 * (L + A)), Row::IDLE);
        self.has_factor = false;
    }

    /// Takes the velocities of the bodies.
    fn take(&mut self, first: usize, velocities: &[Velocity<f32, L, A>]) {
        self.velocities.clear();
        for &body in &self.bodies {
            let Velocity { linear, angular } = of_batch(velocities, first, body);
            self.velocities.extend(linear.0.iter().chain(&angular.0).map(|own| f64::from(*own)));
        }
    }

    fn velocity(&self, index: usize) -> Velocity<f32, L, A> {
        let own = &self.velocities[index * (L + A)..][..L + A];
        Velocity {
            linear: Vector(std::array::from_fn(|i| own[i] as f32)),
            angular: Vector(std::array::from_fn(|i| own[L + i] as f32)),
        }
    }

    /// Brings the rows to their targets. N = L + A.
    #[inline(always)]
    fn solve<const N: usize>(&mut self, joints: &[Joint], axes: &mut [Axis<f64, L, A>]) {
        self.load::<N>(joints, axes);
        for step in 0..MOST_STEPS {
            let mut rows = self.rows.iter().zip(&self.factored);
            let is_same = self.has_factor && rows.all(|(row, was)| row.is_loaded() == *was);
            if !is_same && !self.factor::<N>(joints) {
                return;
            }
            self.find_step::<N>(joints, step == 0);
            if self.descend::<N>(joints, step == 0) {
                break;
            }
        }
        for (axis, row) in axes.iter_mut().zip(&self.rows) {
            axis.impulse = row.response;
        }
        // The world has them in single precision, whether or not another visit comes between.
        self.velocities.iter_mut().for_each(|own| *own = f64::from(*own as f32));
    }

    /// Takes the laws and impulses of the rows. Drops the factor if a compliance has changed.
    #[inline(always)]
    fn load<const N: usize>(&mut self, joints: &[Joint], axes: &[Axis<f64, L, A>]) {
        self.start.clone_from(&self.velocities);
        let (own, _) = self.velocities.as_chunks::<N>();
        let (jacobians, _) = self.jacobians.as_chunks::<N>();
        let mut all = axes.iter().zip(&mut self.rows).zip(jacobians.chunks_exact(2));
        for (joint, link) in joints.iter().zip(&self.links) {
            let [a, b] = link.sides.map(|side| &own[side]);
            for ((axis, row), jacobian) in all.by_ref().take(joint.count as usize) {
                let compliance = row.law.compliance;
                row.take(axis, dot(&jacobian[0], a) + dot(&jacobian[1], b));
                self.has_factor &= row.law.compliance == compliance;
            }
        }
    }

    /// Sums and factors H. Returns false if it is not positive definite, which happens only with
    /// numbers that are not finite.
    #[inline(always)]
    fn factor<const N: usize>(&mut self, joints: &[Joint]) -> bool {
        let Self { hessian, masses, free, places, rows, links, jacobians, loaded, .. } = self;
        let (jacobians, _) = jacobians.as_chunks::<N>();
        let (masses, _) = masses.as_chunks::<N>();
        hessian.clear();
        for (mass, &place) in masses.chunks_exact(N).zip(&*places) {
            if place != FIXED {
                hessian.diagonal::<N>(place).copy_from_slice(mass);
            }
        }
        let mut rows_left = rows.iter().zip(jacobians.chunks_exact(2));
        for (joint, link) in joints.iter().zip(&*links) {
            let [p, q] = link.block.map_or([0, 1], |(_, rows)| [rows, 1 - rows]);
            loaded.clear();
            let of_joint = rows_left.by_ref().take(joint.count as usize);
            for (row, jacobian) in of_joint.filter(|(row, _)| row.is_loaded()) {
                for side in [p, q] {
                    match &free[link.sides[side]] {
                        None => loaded.extend(jacobian[side]),
                        Some(free) => loaded.extend(projected(free, &jacobian[side])),
                    }
                }
                loaded.push(1.0 / row.law.compliance);
            }
            let blocks = products::<N>(loaded);
            for (side, block) in [(p, &blocks[0]), (q, &blocks[2])] {
                if link.places[side] != FIXED {
                    add(hessian.diagonal::<N>(link.places[side]), block);
                }
            }
            if let Some((index, _)) = link.block {
                add(hessian.block::<N>(index), &blocks[1]);
            }
        }
        self.factored.clear();
        self.factored.extend(rows.iter().map(Row::is_loaded));
        self.has_factor = hessian.factor_blocks::<N>();
        self.has_factor
    }

    /// Finds the step -H^-1 gradient, with `is_start` at v_0.
    #[inline(always)]
    fn find_step<const N: usize>(&mut self, joints: &[Joint], is_start: bool) {
        let Self { step, places, masses, free, links, rows, jacobians, hessian, .. } = self;
        step.clear();
        step.resize(hessian.len() * N, 0.0);
        let (step, _) = step.as_chunks_mut::<N>();
        let (jacobians, _) = jacobians.as_chunks::<N>();
        let mut rows = rows.iter().zip(jacobians.chunks_exact(2));
        for (joint, link) in joints.iter().zip(links) {
            let mut momenta = [[0.0; N]; 2];
            for (row, jacobian) in rows.by_ref().take(joint.count as usize) {
                let impulse = row.response - row.before;
                for (momentum, jacobian) in momenta.iter_mut().zip(jacobian) {
                    (0..N).for_each(|i| momentum[i] += jacobian[i] * impulse);
                }
            }
            for (momentum, &place) in momenta.iter().zip(&link.places) {
                if place != FIXED {
                    (0..N).for_each(|i| step[place][i] += momentum[i]);
                }
            }
        }
        let (masses, _) = masses.as_chunks::<N>();
        let (now, _) = self.velocities.as_chunks::<N>();
        let (start, _) = self.start.as_chunks::<N>();
        for (body, &place) in places.iter().enumerate().filter(|(_, place)| **place != FIXED) {
            if !is_start {
                let moved = std::array::from_fn(|i| now[body][i] - start[body][i]);
                for (own, mass) in step[place].iter_mut().zip(&masses[body * N..]) {
                    *own -= dot(mass, &moved);
                }
            }
            if let Some(free) = &free[body] {
                step[place] = projected(free, &step[place]);
            }
        }
        hessian.solve_in_order::<N>(step);
    }

    /// Moves the velocities along the step, as far as P falls; at the start by all of it, because most
    /// rows stay on their pieces. Returns true if all responses are linear along the step: then P is
    /// a parabola, and the step ends at its minimum.
    #[inline(always)]
    fn descend<const N: usize>(&mut self, joints: &[Joint], is_start: bool) -> bool {
        let Self { step, links, rows, jacobians, .. } = self;
        let (step, _) = step.as_chunks::<N>();
        let (jacobians, _) = jacobians.as_chunks::<N>();
        let (mut changing, mut jacobians) = (rows.iter_mut(), jacobians.chunks_exact(2));
        let mut is_linear = true;
        for (joint, link) in joints.iter().zip(&*links) {
            let along = link.places.map(|place| step.get(place).unwrap_or(&[0.0; N]));
            for _ in 0..joint.count {
                let (Some(row), Some(jacobian)) = (changing.next(), jacobians.next()) else {
                    break;
                };
                row.change = dot(&jacobian[0], along[0]) + dot(&jacobian[1], along[1]);
                is_linear &= row.piece_at(row.velocity + row.change) == row.piece;
            }
        }
        let length = if is_linear || is_start { 1.0 } else { self.search::<N>() };
        let (step, _) = self.step.as_chunks::<N>();
        let (now, _) = self.velocities.as_chunks_mut::<N>();
        for (own, place) in now.iter_mut().zip(&*self.places) {
            if let Some(step) = step.get(*place) {
                (0..N).for_each(|i| own[i] += step[i] * length);
            }
        }
        self.rows.iter_mut().for_each(|row| row.meet(row.velocity + row.change * length));
        is_linear
    }

    /// Returns the length of the step at which P stops falling.
    #[inline(always)]
    fn search<const N: usize>(&self) -> f64 {
        let (step, _) = self.step.as_chunks::<N>();
        let (masses, _) = self.masses.as_chunks::<N>();
        let (now, _) = self.velocities.as_chunks::<N>();
        let (start, _) = self.start.as_chunks::<N>();
        let (mut constant, mut linear) = (0.0, 0.0);
        for (body, &place) in self.places.iter().enumerate() {
            let Some(along) = step.get(place) else { continue };
            let moved = std::array::from_fn(|i| now[body][i] - start[body][i]);
            for (mass, own) in masses[body * N..].iter().zip(along) {
                constant += own * dot(mass, &moved);
                linear += own * dot(mass, along);
            }
        }
        let rows = &self.rows;
        primal::length_of_step(|length| {
            let work = rows.iter().map(|row| {
                let mut then = *row;
                then.meet(row.velocity + row.change * length);
                (then.response - row.before) * row.change
            });
            constant + linear * length - work.sum::<f64>()
        })
    }
}

/// Returns M^-1 J^T gamma of the rows of a joint for each of its bodies, of these masses.
fn gains<const L: usize, const A: usize>(
    axes: &[Axis<f64, L, A>],
    masses: [InverseMass<f32, L, A>; 2],
) -> [Velocity<f32, L, A>; 2] {
    let mut momenta = [Velocity::ZERO; 2];
    for axis in axes {
        for (momentum, jacobian) in momenta.iter_mut().zip(&axis.jacobian) {
            *momentum += *jacobian * axis.impulse;
        }
    }
    [0, 1].map(|side: usize| masses[side].cast::<f64>().velocity(&momenta[side]).cast())
}

#[inline(always)]
fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    let mut sum = 0.0;
    for i in 0..N {
        sum += a[i] * b[i];
    }
    sum
}

/// Returns the sums of p^T s p, p^T s q and q^T s q over rows p, q and stiffnesses s, which follow each
/// other.
#[inline(always)]
fn products<const N: usize>(rows: &[f64]) -> [[[f64; N]; N]; 3] {
    let mut blocks = [[[0.0; N]; N]; 3];
    let [of_p, across, of_q] = &mut blocks;
    for i in 0..N {
        let mut sums = [[0.0; N]; 3];
        for row in rows.chunks_exact(2 * N + 1) {
            let (pq, _) = row.as_chunks::<N>();
            let (p, q, stiffness) = (&pq[0], &pq[1], row[2 * N]);
            let (from_p, from_q) = (p[i] * stiffness, q[i] * stiffness);
            for j in 0..N {
                sums[0][j] += from_p * p[j];
                sums[1][j] += from_p * q[j];
                sums[2][j] += from_q * q[j];
            }
        }
        [of_p[i], across[i], of_q[i]] = sums;
    }
    blocks
}

#[inline(always)]
fn add<const N: usize>(sum: &mut [[f64; N]; N], block: &[[f64; N]; N]) {
    for i in 0..N {
        for j in 0..N {
            sum[i][j] += block[i][j];
        }
    }
}

/// Returns the free part of a row of J, or of a momentum.
fn projected<const N: usize>(free: &Projection, of: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|j| (0..N).map(|k| of[k] * free[k][j]).sum())
}
