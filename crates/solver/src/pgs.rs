//! Projected Gauss-Seidel (PGS), matrix-free: the basic method.
//!
//! One sweep visits every contact once. A visit computes the current velocity of the contact, which
//! includes all other impulses. It changes the impulse so that the velocity becomes the target,
//! clamps it to the admissible range, and applies the change to the two bodies. The notes: "go
//! ahead and let the impulse for collision i be included as an other collision", with the per-body
//! sums kept as the velocities themselves. Cost: linear in the contacts.

use crate::body::{all_axes, along_normals, along_tangents};
use crate::contact::{RIGID, RIGID_APART, SOFT};
use crate::solution::{self, Goal, Solution};
use crate::{Contact, InverseMass, Manifold, Mobility, Real, System, Vector, Velocity};

/// Sweeps until the certificate is good enough.
///
/// Cost of an iteration: one sweep. Use: the first method to try, from the impulses of the previous
/// step. A stack of n needs about 2.8 n^2 sweeps, times the mass ratio if the heaviest body lies on
/// lighter ones.
pub fn solve<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    goal: &Goal,
) -> Solution {
    solution::iterate(system, goal, sweep)
}

impl<T: Real, const L: usize> Contact<T, L> {
    /// Visits the normal: gamma <- max(0, gamma - m_eff (v_n - t + epsilon gamma)). Clamps the
    /// accumulated impulse, and returns its change. `LAW` is that of
    /// [`excess`](Self::excess). \[N s\]
    #[inline(always)]
    fn visit_normal<const A: usize, const LAW: u8>(
        &mut self,
        twist: &Velocity<T, L, A>,
    ) -> Vector<T, L> {
        let w = self.excess::<LAW>(self.normal_velocity(twist));
        let mass = match LAW {
            RIGID_APART => {
                let rigid = self.effective_mass / (T::ONE - self.softness());
                (-self.target[0]).choose(rigid, self.effective_mass)
            }
            _ => self.effective_mass,
        };
        let impulse = (self.impulse[0] - mass * w).max(T::ZERO);
        let mut change = Vector::ZERO;
        change[0] = impulse - self.impulse[0];
        self.impulse[0] = impulse;
        change
    }

    /// Visits the friction, and returns the change of the impulse. \[N s\]
    #[inline(always)]
    fn visit_friction<const A: usize>(
        &mut self,
        friction: T,
        twist: &Velocity<T, L, A>,
    ) -> Vector<T, L> {
        let impulse = self.friction_step(friction, self.relative_velocity(twist));
        let change = impulse - self.impulse;
        self.impulse = impulse;
        change
    }
}

/// Runs one sweep towards the targets: every manifold once, in order, its normals before its
/// friction.
pub fn sweep<T: Real, const L: usize, const A: usize>(system: &mut System<T, L, A>) {
    visit_all::<T, L, A, SOFT, true>(system);
}

/// Runs one sweep with rigid contacts and without overlap repair. It removes the velocity from
/// repair and compliance after that has moved the bodies.
pub fn relax<T: Real, const L: usize, const A: usize>(system: &mut System<T, L, A>) {
    visit_all::<T, L, A, RIGID, true>(system);
}

/// Runs one [`sweep`] over the normals alone.
pub fn sweep_normals<T: Real, const L: usize, const A: usize>(system: &mut System<T, L, A>) {
    visit_all::<T, L, A, SOFT, false>(system);
}

/// Runs one [`sweep_normals`] with contacts that are open treated as rigid.
pub fn sweep_coming<T: Real, const L: usize, const A: usize>(system: &mut System<T, L, A>) {
    visit_all::<T, L, A, RIGID_APART, false>(system);
}

/// Visits the constraint of this index once, towards the targets: a manifold, or a joint after the
/// manifolds.
pub(crate) fn visit_constraint<T: Real, const L: usize, const A: usize>(
    system: &mut System<T, L, A>,
    index: usize,
) {
    match index.checked_sub(system.manifolds.len()) {
        None => visit_of::<T, L, A, SOFT, true>(system, index),
        Some(joint) => visit_joint::<T, L, A, false>(system, joint),
    }
}

fn visit_all<T: Real, const L: usize, const A: usize, const LAW: u8, const FRICTION: bool>(
    system: &mut System<T, L, A>,
) {
    for index in 0..system.manifolds.len() {
        visit_of::<T, L, A, LAW, FRICTION>(system, index);
    }
    for index in 0..system.joints.len() {
        match LAW {
            RIGID => visit_joint::<T, L, A, true>(system, index),
            _ => visit_joint::<T, L, A, false>(system, index),
        }
    }
}

/// Visits the rows of a joint once, one after the other.
fn visit_joint<T: Real, const L: usize, const A: usize, const RELAX: bool>(
    system: &mut System<T, L, A>,
    index: usize,
) {
    let System { velocities, masses, joints, axes, .. } = system;
    let [a, b] = joints[index].bodies.map(|body| body as usize);
    let masses = &[masses[a], masses[b]];
    for axis in &mut axes[joints[index].axes()] {
        let change = axis.visit::<RELAX>(axis.velocity(&velocities[a], &velocities[b]));
        let [to_a, to_b] = axis.response(masses);
        velocities[a] += to_a * change;
        velocities[b] += to_b * change;
    }
}

fn visit_of<T: Real, const L: usize, const A: usize, const LAW: u8, const FRICTION: bool>(
    system: &mut System<T, L, A>,
    index: usize,
) {
    let System { velocities, masses, manifolds, contacts, .. } = system;
    let manifold = &manifolds[index];
    let points = &mut contacts[manifold.points()];
    let masses = &manifold.bodies.map(|body| masses[body as usize]);
    let parts = (manifold, &Mobility::of(&manifold.frame, masses), masses);
    let bodies = &mut PairOf { velocities, bodies: manifold.bodies };
    if is_center(points) {
        visit::<T, L, A, 0, LAW, FRICTION>(parts, points, bodies);
    } else {
        visit::<T, L, A, A, LAW, FRICTION>(parts, points, bodies);
    }
}

/// The bodies of a manifold in the velocities of a system.
struct PairOf<'a, T: Real, const L: usize, const A: usize> {
    velocities: &'a mut [Velocity<T, L, A>],
    bodies: [u32; 2],
}

impl<T: Real, const L: usize, const A: usize> BodyPair<T, L, A> for PairOf<'_, T, L, A> {
    fn velocities(&self) -> [Velocity<T, L, A>; 2] {
        self.bodies.map(|body| self.velocities[body as usize])
    }

    fn set_velocities(&mut self, velocities: [Velocity<T, L, A>; 2]) {
        for (body, velocity) in self.bodies.into_iter().zip(velocities) {
            self.velocities[body as usize] = velocity;
        }
    }
}

/// Returns true if the only point of a manifold is at its center. Rotation does not change its
/// velocity, and its impulses have no moment.
#[inline(always)]
pub(crate) fn is_center<T: Real, const L: usize>(points: &[Contact<T, L>]) -> bool {
    matches!(points, [only] if only.offset == Vector::ZERO)
}

/// The two bodies of a visit.
pub(crate) trait BodyPair<T: Real, const L: usize, const A: usize> {
    /// Returns the velocities of a and b, at the start of the visit.
    fn velocities(&self) -> [Velocity<T, L, A>; 2];

    /// Is called between the normals and the friction.
    fn between(&self) {}

    /// Sets the velocities, at the end of the visit.
    fn set_velocities(&mut self, velocities: [Velocity<T, L, A>; 2]);
}

/// Visits a manifold once: the normals of its points, then their friction. The points depend on `B`
/// components of rotation: 0 if [`is_center`] holds, otherwise `A` ([`ConstraintFrame::twist_felt`]).
#[inline(always)]
pub(crate) fn visit<
    T: Real,
    const L: usize,
    const A: usize,
    const B: usize,
    const LAW: u8,
    const FRICTION: bool,
>(
    (manifold, mobility, masses): Parts<'_, T, L, A>,
    points: &mut [Contact<T, L>],
    bodies: &mut impl BodyPair<T, L, A>,
) {
    let [mut a, mut b] = bodies.velocities();
    let mut twist: Velocity<T, L, B> = manifold.frame.twist_felt(&a, &b);
    let mut wrench = Velocity::ZERO;
    let (normals, all) = (&along_normals::<B>(), &all_axes::<L, B>());
    for contact in points.iter_mut() {
        let change = contact.visit_normal::<B, LAW>(&twist);
        // The response to a unit impulse does not depend on the change, so it can be computed in
        // parallel.
        let mut response = Velocity::NEG_ZERO;
        mobility.add(normals, &contact.unit_wrench(0), normals, &mut response);
        twist += response * change[0];
        contact.add_wrench(0..1, change, &mut wrench);
    }
    bodies.between();
    if FRICTION {
        let tangents = &along_tangents::<L, B>();
        mobility.add(normals, &wrench, tangents, &mut twist);
        for contact in points.iter_mut() {
            let change = contact.visit_friction(manifold.friction, &twist);
            let mut own = Velocity::NEG_ZERO;
            contact.add_wrench(1..L, change, &mut own);
            mobility.add(tangents, &own, tangents, &mut twist);
            contact.add_wrench(1..L, change, &mut wrench);
        }
    }
    manifold.frame.apply_of(if FRICTION { all } else { normals }, &wrench, masses, &mut a, &mut b);
    bodies.set_velocities([a, b]);
}

/// A manifold, its mobility, and the inverse masses of its bodies.
pub(crate) type Parts<'a, T, const L: usize, const A: usize> =
    (&'a Manifold<T, L>, &'a Mobility<T, L, A>, &'a [InverseMass<T, L, A>; 2]);
