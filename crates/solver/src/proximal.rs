//! Proximal-point method for exact Coulomb friction, on a [`System`] by way of its matrices.
//!
//! [`assembled::proximal`](crate::assembled::proximal) has the method and its references. This
//! module turns a system into a problem u = W r + q ([`Assembly`]), and copies the impulses back.
//! The requested residual is lowered until the certificate is good enough.
//!
//! Cost: W has a block for each pair of contacts on one body, and is factored several times. Use:
//! the last method of the ladder, where friction keeps Newton's shifts from converging.

use crate::System;
use crate::assembled::proximal;
use crate::assembled::{Assembly, Limits};
use crate::solution::{Goal, Solution, Status, Track};

/// Relative residuals to request, in this order.
const TOLERANCES: [f64; 4] = [1e-4, 1e-7, 1e-10, 1e-13];

/// Solves a system whose velocities are the prospective ones and whose impulses are a guess.
pub fn solve<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    goal: &Goal,
) -> Solution {
    solve_within(system, goal, f64::INFINITY)
}

/// [Solves](solve) a system if a factorization takes `most_products` of blocks at most. If not, the
/// guess stays.
pub(crate) fn solve_within<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    goal: &Goal,
    most_products: f64,
) -> Solution {
    let prospective = system.velocities.clone();
    let assembled = Assembly::of_system(system).and_then(|of| Ok((of.problem()?, of)));
    system.apply_impulses();
    let mut track = Track::start(system, &prospective, goal, TOLERANCES.len());
    let Ok((problem, assembly)) = assembled else {
        return track.end(system, Status::BadInput);
    };
    let structure = proximal::structure(&problem);
    if structure.products() > most_products {
        return track.end(system, Status::Stalled);
    }
    let mut warm = assembly.warm(&problem);
    for tolerance in TOLERANCES {
        if !track.goes_on() {
            break;
        }
        let limits = Limits { tolerance, budget: goal.budget };
        warm = proximal::solve_as(&structure, &problem, Some(&warm), &limits).impulses;
        assembly.give_back(&warm, system);
        system.velocities.clone_from(&prospective);
        system.apply_impulses();
        track.record(system);
    }
    let status = match track.status() {
        Status::Budget => Status::Stalled,
        status => status,
    };
    track.end(system, status)
}
