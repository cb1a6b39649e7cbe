//! [`Mechanisms`]: all rows of the joints of connected bodies as one block.
//!
//! Sweeps over a chain of n bodies need some n^2 visits, times the ratio of the masses. So all joints
//! that connect bodies are solved together. The velocities minimize P(v) of the
//! [`certificate`](crate::certificate) over the rows of the joints, while contacts keep their
//! impulses:
//!
//! ```text
//! H dv  = J^T r(v) - M (v - v*)         H = M + J^T (1 / epsilon) J over the rows inside their bounds
//! r     = clamp((t - J v) / epsilon, lo, hi)
//! ```
//!
//! H has one row of blocks per body. Its factor costs as much as the number of bodies if the joints
//! form a tree, and the fill of each loop beyond. If no row reaches or leaves a bound, one solve is
//! exact: to contacts the mechanism is a constraint like any other, visited once per sweep. The
//! factor is kept while J and the rows within their bounds stay the same.

use std::ops::Range;

use crate::island::Islands;
use crate::primal::PrimalProblem;
use crate::{Axis, InverseMass, Joint, Velocity};

/// Largest number of steps of a visit. Each takes rows to or from their bounds.
const MOST_STEPS: usize = 40;

/// Joints, mechanism by mechanism, and what solves them.
#[derive(Clone, Debug, Default)]
pub struct Mechanisms<const L: usize, const A: usize> {
    /// The joints. Those of a mechanism follow each other.
    pub joints: Vec<Joint>,
    /// Their rows, in `f64`: velocities rounded to `f32` would change impulses of stiff rows.
    pub axes: Vec<Axis<f64, L, A>>,
    mechanisms: Vec<Mechanism<L, A>>,
}

/// Bodies connected by joints.
#[derive(Clone, Debug, Default)]
struct Mechanism<const L: usize, const A: usize> {
    /// Its joints.
    joints: Range<usize>,
    /// Its bodies, fixed ones included.
    bodies: Vec<u32>,
    /// The bodies of each joint as indices into `bodies`.
    sides: Vec<[usize; 2]>,
    problem: PrimalProblem<L, A>,
    velocities: Vec<Velocity<f64, L, A>>,
    inverse: Vec<InverseMass<f64, L, A>>,
    /// For each row: whether its impulse changes with the velocity, now and in the factor of H.
    loaded: Vec<bool>,
    factored: Vec<bool>,
    /// Compliances of the rows, now and in the factor of H.
    compliances: [Vec<f64>; 2],
    has_factor: bool,
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
    }

    /// Returns for each mechanism its joints and its bodies, fixed ones included.
    pub fn groups(&self) -> impl Iterator<Item = (Range<usize>, &[u32])> {
        self.mechanisms.iter().map(|own| (own.joints.clone(), own.bodies.as_slice()))
    }

    /// Takes the masses of the bodies, which turn. The rows must be filled in.
    pub fn renew(&mut self, masses: &[InverseMass<f32, L, A>]) {
        let Self { joints, axes, mechanisms } = self;
        for joint in joints.iter() {
            let own = &joint.bodies.map(|body| masses[body as usize].cast());
            axes[joint.axes()].iter_mut().for_each(|axis| axis.prepare(own));
        }
        for mechanism in mechanisms {
            mechanism.renew(masses);
        }
    }

    /// Visits every mechanism once: brings all rows of its joints to their targets together, from
    /// the present velocities, which include the impulses of the rows.
    pub fn solve(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        let Self { joints, axes, mechanisms } = self;
        for mechanism in mechanisms {
            mechanism.solve(&joints[mechanism.joints.clone()], axes, velocities);
        }
    }

    /// Adds the impulses of the rows to the velocities: v += M^-1 J^T gamma.
    pub fn apply(&self, velocities: &mut [Velocity<f32, L, A>], masses: &[InverseMass<f32, L, A>]) {
        for joint in &self.joints {
            let mut momenta = [Velocity::ZERO; 2];
            for axis in &self.axes[joint.axes()] {
                for (momentum, jacobian) in momenta.iter_mut().zip(&axis.jacobian) {
                    *momentum += *jacobian * axis.impulse;
                }
            }
            for (body, momentum) in joint.bodies.into_iter().zip(momenta) {
                let body = body as usize;
                let inverse: InverseMass<f64, L, A> = masses[body].cast();
                velocities[body] += inverse.velocity(&momentum).cast();
            }
        }
    }
}

impl<const L: usize, const A: usize> Mechanism<L, A> {
    /// Creates the mechanism of these joints. `inside` holds a number for each body, and returns as
    /// it came.
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
        let mut mechanism = Self { joints: range, bodies, sides, ..Self::default() };
        mechanism.renew(masses);
        mechanism.problem.connect(mechanism.sides.iter().copied());
        mechanism
    }

    fn renew(&mut self, masses: &[InverseMass<f32, L, A>]) {
        self.inverse.clear();
        self.inverse.extend(self.bodies.iter().map(|&body| masses[body as usize].cast()));
        self.problem.set_masses(self.inverse.iter().copied());
        self.has_factor = false;
    }

    fn solve(
        &mut self,
        joints: &[Joint],
        axes: &mut [Axis<f64, L, A>],
        velocities: &mut [Velocity<f32, L, A>],
    ) {
        self.load(joints, axes, velocities);
        let Self { bodies, problem, velocities: own, loaded, factored, has_factor, .. } = self;
        let [now, then] = &mut self.compliances;
        problem.compliances(now);
        *has_factor &= now == then;
        std::mem::swap(now, then);
        let mut is_full = false;
        for _ in 0..MOST_STEPS {
            problem.loaded_axes(own, loaded);
            let is_same = *has_factor && loaded == factored;
            if is_same && is_full {
                break;
            }
            if is_same {
                problem.reuse_factors(own);
            } else if !problem.factor(own) {
                *has_factor = false;
                return;
            }
            *has_factor = true;
            std::mem::swap(loaded, factored);
            is_full = problem.descend(own);
        }
        problem.answer_axes(own, axes);
        for (&body, own) in bodies.iter().zip(own) {
            velocities[body as usize] = own.cast();
        }
    }

    /// Copies the rows, and the velocities of the bodies with and without the impulses of the rows.
    fn load(
        &mut self,
        joints: &[Joint],
        axes: &[Axis<f64, L, A>],
        velocities: &[Velocity<f32, L, A>],
    ) {
        self.velocities.clear();
        let of = |&body: &u32| velocities[body as usize].cast::<f64>();
        self.velocities.extend(self.bodies.iter().map(of));
        let prospective = &mut self.problem.prospective;
        prospective.clone_from(&self.velocities);
        for (joint, sides) in joints.iter().zip(&self.sides) {
            for axis in &axes[joint.axes()] {
                for (&side, jacobian) in sides.iter().zip(&axis.jacobian) {
                    let momentum = *jacobian * axis.impulse;
                    prospective[side] -= self.inverse[side].velocity(&momentum);
                }
            }
        }
        self.problem.clear_axes();
        for (joint, &sides) in joints.iter().zip(&self.sides) {
            self.problem.add_axes(sides, joint.axes(), axes);
        }
    }
}
