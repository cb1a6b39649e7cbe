//! Nonsmooth nonlinear conjugate gradients, NNCG (Silcowitz-Hansen, Niebe and Erleben 2010). The
//! change of the impulses in a sweep serves as a gradient, and sweeps continue along conjugate
//! directions.
//!
//! With r' = sweep(r) the gradient is g = r - r'. If |g| has not grown, the next sweep starts from
//! r' + beta p with beta = |g|^2 / |g_before|^2 (Fletcher and Reeves) and p <- beta p - g. If it
//! has grown, it starts from r' with p = 0. Each sweep projects onto the cones again, so an
//! extrapolated start outside them does no harm.
//!
//! The paper's sweep is symmetric, forward and back, as conjugate gradients require of a
//! preconditioner. One forward sweep needs a few more iterations, each of half the cost. The
//! velocities that go with p need no pass over the contacts: w = M^-1 J^T p is kept per body, since
//! a sweep changes the body's velocity by -M^-1 J^T g.
//!
//! Cost of an iteration: a sweep and a pass over the bodies. Use: stacks and mass ratios; about 4 n
//! iterations for n bodies in a chain, without a matrix. Convergence is not proven: the best
//! iterate is kept.

use crate::pgs::sweep;
use crate::solution::{self, Goal, Solution};
use crate::{Contact, Real, Scalar, System, Vector, Velocity};

/// Iterates until the certificate is good enough.
pub fn solve<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    goal: &Goal,
) -> Solution {
    let (mut before, mut moved_before) = (Vec::new(), Vec::new());
    let mut before_axes: Vec<f64> = Vec::new();
    let mut direction = vec![Vector::ZERO; system.contacts.len()];
    let mut direction_axes = vec![0.0; system.axes.len()];
    let mut ways = vec![Velocity::ZERO; system.velocities.len()];
    let mut size_before = f64::INFINITY;
    let mut beta = 0.0;
    solution::iterate(system, goal, |system| {
        for (contact, p) in system.contacts.iter_mut().zip(&direction) {
            contact.impulse += *p * beta;
        }
        for (axis, p) in system.axes.iter_mut().zip(&direction_axes) {
            axis.impulse += *p * beta;
        }
        for (velocity, w) in system.velocities.iter_mut().zip(&ways) {
            *velocity += *w * beta;
        }
        before.clear();
        before.extend(system.contacts.iter().map(|contact| contact.impulse));
        before_axes.clear();
        before_axes.extend(system.axes.iter().map(|axis| axis.impulse));
        moved_before.clone_from(&system.velocities);
        sweep(system);
        let changed = system.contacts.iter().zip(&before);
        let size: f64 = changed.map(|(contact, before)| size(contact, *before)).sum();
        let changed = system.axes.iter().zip(&before_axes);
        let size_axes = changed.map(|(axis, before)| match axis.effective_mass {
            mass if mass > 0.0 => (before - axis.impulse).powi(2) / mass,
            _ => 0.0,
        });
        beta = beta_of(size + size_axes.sum::<f64>(), &mut size_before);
        for ((contact, before), p) in system.contacts.iter().zip(&before).zip(&mut direction) {
            *p = next_direction(contact, *before, *p, beta);
        }
        for ((axis, before), p) in system.axes.iter().zip(&before_axes).zip(&mut direction_axes) {
            *p = next_row_direction(axis.impulse, *before, *p, beta);
        }
        for ((velocity, before), w) in system.velocities.iter().zip(&moved_before).zip(&mut ways) {
            *w = next_way(velocity, before, w, beta);
        }
    })
}

/// Returns |g|^2 of a contact in the metric of its effective mass, so that heavy and light bodies
/// count alike.
#[inline(always)]
pub(crate) fn size<T: Real, const L: usize>(contact: &Contact<T, L>, before: Vector<T, L>) -> T {
    let g = before - contact.impulse;
    contact.effective_mass.choose(g.dot(g) / contact.effective_mass, T::ZERO)
}

/// Returns beta for a gradient of this size after one of size `before`, which is updated; 0 if it
/// has grown.
pub(crate) fn beta_of<T: Scalar>(size: T, before: &mut T) -> T {
    let ratio = size / std::mem::replace(before, size);
    if ratio <= T::ONE { ratio } else { T::ZERO }
}

/// Returns p <- beta p - g; 0 if beta is 0.
#[inline(always)]
pub(crate) fn next_direction<T: Real, const L: usize>(
    contact: &Contact<T, L>,
    before: Vector<T, L>,
    direction: Vector<T, L>,
    beta: T,
) -> Vector<T, L> {
    (direction * beta - (before - contact.impulse)).only_if(beta)
}

/// Returns p <- beta p - g of a row of a joint; 0 if beta is 0.
#[inline(always)]
pub(crate) fn next_row_direction(impulse: f64, before: f64, direction: f64, beta: f64) -> f64 {
    if beta > 0.0 { direction * beta - (before - impulse) } else { 0.0 }
}

/// Returns w <- beta w + v' - v of a body, whose velocity was `before` ahead of the sweep; 0 if
/// beta is 0.
#[inline(always)]
pub(crate) fn next_way<T: Scalar, const L: usize, const A: usize>(
    velocity: &Velocity<T, L, A>,
    before: &Velocity<T, L, A>,
    way: &Velocity<T, L, A>,
    beta: T,
) -> Velocity<T, L, A> {
    if beta > T::ZERO { *way * beta + (*velocity - *before) } else { Velocity::ZERO }
}
