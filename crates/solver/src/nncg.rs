//! Nonsmooth nonlinear conjugate gradients (Silcowitz-Hansen, Niebe and Erleben 2010): what a sweep
//! changes is taken for a gradient, and sweeps are continued along conjugate directions.
//!
//! With r' = sweep(r) the gradient is g = r - r'. If it has not grown, the next sweep starts from
//! r' + beta p with beta = |g|^2 / |g of before|^2 (Fletcher and Reeves) and p <- beta p - g; if it
//! has, from r' with p = 0. Sweeps project onto the cones again, so no step need be safe.
//!
//! Cost of an iteration: a symmetric sweep and a pass over the contacts. Place: stacks and mass
//! ratios, about 7 n iterations for n bodies in a chain, with no matrix at all. No proof: the best
//! iterate is kept.

use crate::solution::{self, Goal, Solution};
use crate::{Contact, Real, Scalar, System, Vector, symmetric};

/// Iterates until the certificate is good enough.
pub fn solve<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    goal: &Goal,
) -> Solution {
    let mut before: Vec<Vector<f64, L>> = Vec::new();
    let mut direction = vec![Vector::ZERO; system.contacts.len()];
    let mut size_before = f64::INFINITY;
    let mut beta = 0.0;
    solution::iterate(system, goal, |system| {
        if beta > 0.0 {
            push(system, &direction, beta);
        }
        before.clear();
        before.extend(system.contacts.iter().map(|contact| contact.impulse));
        symmetric::sweep(system);
        let changed = system.contacts.iter().zip(&before);
        beta = beta_of(
            changed.map(|(contact, before)| size(contact, *before)).sum(),
            &mut size_before,
        );
        for ((contact, before), p) in system.contacts.iter().zip(&before).zip(&mut direction) {
            *p = next_direction(contact, *before, *p, beta);
        }
    })
}

/// |g|^2 of a contact, in the metric of its effective mass, so that heavy and light bodies count
/// alike.
#[inline(always)]
pub(crate) fn size<T: Real, const L: usize>(contact: &Contact<T, L>, before: Vector<T, L>) -> T {
    let g = before - contact.impulse;
    contact.effective_mass.choose(g.dot(g) / contact.effective_mass, T::ZERO)
}

/// beta for gradients of this size and of the one `before`, which is renewed; 0 if it has grown.
pub(crate) fn beta_of<T: Scalar>(size: T, before: &mut T) -> T {
    let ratio = size / std::mem::replace(before, size);
    if ratio <= T::ONE { ratio } else { T::ZERO }
}

/// p <- beta p - g; 0 where beta is.
#[inline(always)]
pub(crate) fn next_direction<T: Real, const L: usize>(
    contact: &Contact<T, L>,
    before: Vector<T, L>,
    direction: Vector<T, L>,
    beta: T,
) -> Vector<T, L> {
    (direction * beta - (before - contact.impulse)).only_if(beta)
}

/// r <- r + beta p, with the velocities that go with it.
fn push<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    direction: &[Vector<f64, L>],
    beta: f64,
) {
    for manifold in 0..system.manifolds.len() {
        system.change(manifold, |index, contact| {
            let change = direction[index] * beta;
            contact.impulse += change;
            change
        });
    }
}
