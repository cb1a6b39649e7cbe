//! Symmetric projected Gauss-Seidel: a sweep forward and a sweep back.
//!
//! Cost of an iteration: two sweeps. Use: where the order of the contacts must not show, as in
//! symmetric scenes, and for the first sweeps of [`newton`](crate::newton).

use crate::pgs::visit_constraint;
use crate::solution::{self, Goal, Solution};
use crate::{Real, System};

/// Visits every constraint once in order, then once in reverse.
pub fn sweep<T: Real, const L: usize, const A: usize>(system: &mut System<T, L, A>) {
    let count = system.manifolds.len() + system.joints.len();
    for index in (0..count).chain((0..count).rev()) {
        visit_constraint(system, index);
    }
}

/// Iterates until the certificate is good enough.
pub fn solve<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    goal: &Goal,
) -> Solution {
    solution::iterate(system, goal, sweep)
}
