//! Projected Gauss-Seidel, matrix-free: the heart.
//!
//! One sweep visits every contact once. A visit asks what velocity the contact has now, every
//! other impulse included, changes its own impulse so that the velocity becomes the target, keeps
//! the impulse within what a contact can do, and passes the change on to its two bodies. The
//! notes: "go ahead and let the impulse for collision i be included as an other collision", with
//! the per-body sums kept as the velocities themselves. Cost: linear in the contacts.

use crate::body::{all_axes, along_normals, along_tangents};
use crate::contact::{RIGID, RIGID_APART, SOFT};
use crate::solution::{self, Goal, Solution};
use crate::{Contact, InverseMass, Manifold, Mobility, Real, System, Vector, Velocity};

/// Sweeps until the certificate is good enough. Cost of an iteration: one sweep. Place: the first
/// thing to try, from the impulses of the step before. Needs about 2.8 n^2 sweeps for a stack of
/// n, and as many times more as the heaviest body is heavier than those below.
pub fn solve<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    goal: &Goal,
) -> Solution {
    solution::iterate(system, goal, sweep)
}

impl<T: Real, const L: usize> Contact<T, L> {
    /// gamma <- max(0, gamma - m_eff (v_n - t + epsilon gamma)): the accumulated impulse is
    /// clamped, not its change, which is returned. `LAW` is that of [`excess`](Self::excess). \[N s\]
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

    /// Returns the change. \[N s\]
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

/// One sweep towards the targets: every contact once, in order, its normal before its friction.
pub fn sweep<T: Real, const L: usize, const A: usize>(system: &mut System<T, L, A>) {
    visit_all::<T, L, A, SOFT, true>(system);
}

/// One sweep that takes the velocity of overlap repair and compliance out again, once they have
/// moved the bodies: the same contacts, as rigid ones with no repair.
pub fn relax<T: Real, const L: usize, const A: usize>(system: &mut System<T, L, A>) {
    visit_all::<T, L, A, RIGID, true>(system);
}

/// [`sweep`] over the normals alone.
pub fn sweep_normals<T: Real, const L: usize, const A: usize>(system: &mut System<T, L, A>) {
    visit_all::<T, L, A, SOFT, false>(system);
}

/// [`sweep_normals`] with contacts that are apart as rigid ones.
pub fn sweep_coming<T: Real, const L: usize, const A: usize>(system: &mut System<T, L, A>) {
    visit_all::<T, L, A, RIGID_APART, false>(system);
}

/// One visit to the manifold of this index, towards the targets.
pub(crate) fn visit_manifold<T: Real, const L: usize, const A: usize>(
    system: &mut System<T, L, A>,
    index: usize,
) {
    visit_of::<T, L, A, SOFT, true>(system, index);
}

fn visit_all<T: Real, const L: usize, const A: usize, const LAW: u8, const FRICTION: bool>(
    system: &mut System<T, L, A>,
) {
    for index in 0..system.manifolds.len() {
        visit_of::<T, L, A, LAW, FRICTION>(system, index);
    }
}

fn visit_of<T: Real, const L: usize, const A: usize, const LAW: u8, const FRICTION: bool>(
    system: &mut System<T, L, A>,
    index: usize,
) {
    let manifold = system.manifolds[index];
    let masses = system.masses_of(&manifold);
    let [mut a, mut b] = system.velocities_of(&manifold);
    let points = &mut system.contacts[manifold.points()];
    let mobility = Mobility::of(&manifold, &masses);
    let (parts, center) = ((&manifold, &mobility, &masses), is_center(points));
    visit::<T, L, A, LAW, FRICTION>(parts, center, points, [&mut a, &mut b], || {});
    system.set_velocities(&manifold, [a, b]);
}

/// Whether these points of a manifold are its center: it feels no turning, and impulses there have no moment.
#[inline(always)]
pub(crate) fn is_center<T: Real, const L: usize>(points: &[Contact<T, L>]) -> bool {
    matches!(points, [only] if only.place == Vector::ZERO)
}

/// One visit to a manifold: the normals of its points, whatever is to be done `between`, then their friction. Told
/// whether they are its [center](is_center).
#[inline(always)]
pub(crate) fn visit<
    T: Real,
    const L: usize,
    const A: usize,
    const LAW: u8,
    const FRICTION: bool,
>(
    parts: Parts<'_, T, L, A>,
    center: bool,
    points: &mut [Contact<T, L>],
    velocities: [&mut Velocity<T, L, A>; 2],
    between: impl Fn(),
) {
    if center {
        visit_felt::<T, L, A, 0, LAW, FRICTION>(parts, points, velocities, between);
    } else {
        visit_felt::<T, L, A, A, LAW, FRICTION>(parts, points, velocities, between);
    }
}

/// The same of points that feel `B` components of turning ([`Manifold::twist_felt`]).
#[inline(always)]
fn visit_felt<
    T: Real,
    const L: usize,
    const A: usize,
    const B: usize,
    const LAW: u8,
    const FRICTION: bool,
>(
    (manifold, mobility, masses): Parts<'_, T, L, A>,
    points: &mut [Contact<T, L>],
    [a, b]: [&mut Velocity<T, L, A>; 2],
    between: impl Fn(),
) {
    let mut twist: Velocity<T, L, B> = manifold.twist_felt(a, b);
    let mut wrench = Velocity::ZERO;
    let (normals, all) = (&along_normals::<B>(), &all_axes::<L, B>());
    for contact in points.iter_mut() {
        let change = contact.visit_normal::<B, LAW>(&twist);
        // The response to a unit is known before the change is: less to wait for.
        let mut response = Velocity::NEG_ZERO;
        mobility.add(normals, &contact.unit_wrench(0), normals, &mut response);
        twist += response * change[0];
        contact.add_wrench(0..1, change, &mut wrench);
    }
    between();
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
    manifold.apply_of(if FRICTION { all } else { normals }, &wrench, masses, a, b);
}

/// A manifold, its mobility, and the inverse masses of its bodies.
pub(crate) type Parts<'a, T, const L: usize, const A: usize> =
    (&'a Manifold<T, L>, &'a Mobility<T, L, A>, &'a [InverseMass<T, L, A>; 2]);
