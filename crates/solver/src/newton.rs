//! Newton's method in the velocities of the bodies: few iterations, each with a sparse
//! factorization.
//!
//! Minimizes P(v) of the [`certificate`](crate::certificate). The gradient is
//!
//! M (v - v*) - J^T r(v),
//!
//! with the [response](crate::law::Law::response) r of the contacts and rows of joints to the
//! velocities. The second derivative H = M + J^T (dr/dy) J has one row of blocks per body, whatever
//! the number of contacts. The line search along -H^-1 gradient lowers P in every step, and near the
//! minimum convergence is quadratic.
//!
//! Coulomb's law: the shift mu |slip| is frozen while P is minimized. It is updated whenever the
//! error of the frozen problem is below that of the shift (De Saxce and Feng 1998).
//!
//! Cost of an iteration: linear in the contacts, plus the Cholesky factorization of H, which is
//! linear for chains and stacks, about bodies^1.5 for walls, and bodies^2 for deep piles. Use:
//! stacks and heavy bodies on light ones, where sweeps need thousands of iterations.
//!
//! References: Castro, Permenter and Han 2022 (soft contact as unconstrained convex minimization);
//! Todorov 2014 (the same in MuJoCo).

use crate::primal::PrimalProblem;
use crate::solution::{Goal, Solution, Status, Track};
use crate::{System, symmetric};

/// Iterations without a 10 % reduction of the error before the method counts as stalled.
const PATIENCE: usize = 12;

/// Symmetric sweeps before the first iteration.
const SWEEPS: usize = 3;

/// Solves a system whose velocities are the prospective ones and whose impulses are a guess. On
/// return it holds the best velocities and impulses found.
pub fn solve<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    goal: &Goal,
) -> Solution {
    let prospective = system.velocities.clone();
    system.apply_impulses();
    // A Newton step changes only contacts that already press, so without these sweeps an impact
    // would advance by one contact per iteration.
    for _ in 0..SWEEPS {
        symmetric::sweep(system);
    }
    let mut track = Track::start(system, &prospective, goal, PATIENCE);
    let Some(mut problem) = PrimalProblem::new(system, prospective) else {
        return track.end(system, Status::BadInput);
    };
    problem.renew_shifts(system);
    while track.goes_on() {
        if !problem.factor(&system.velocities) {
            return track.end(system, Status::BadInput);
        }
        problem.descend(&mut system.velocities);
        problem.answer(system);
        let certificate = track.record(system);
        // The rest of G is the error of the shift.
        if certificate.defect < 0.1 * certificate.duality_gap {
            problem.renew_shifts(system);
        }
    }
    let status = track.status();
    track.end(system, status)
}
