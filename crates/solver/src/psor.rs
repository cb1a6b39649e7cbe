//! Projected successive over-relaxation (PSOR): sweeps whose changes are enlarged by a factor
//! omega, which is found during the iterations.
//!
//! Gauss-Seidel reduces the error at a rate rho per sweep. If A is like that of a chain, the best
//! factor is then (Young 1954)
//!
//! omega = 2 / (1 + sqrt(1 - rho)).
//!
//! rho is measured by the certificates; if the error grows, omega is moved halfway back to 1.
//!
//! Cost of an iteration: one sweep. Use: regular stacks, where the best factor would need about 3 n
//! sweeps for n bodies. The measured factor is smaller, since the first sweeps of a column reduce
//! the error faster than later ones. It takes half as many sweeps as PGS
//! (`tests/suite/methods.rs`).

use crate::law::{Cone, Law};
use crate::pgs::visit_constraint;
use crate::solution::{self, Goal, Solution};
use crate::{System, Vector, certificate};

/// Plain sweeps before the rate is measured, and sweeps between changes of the factor.
const TRIAL: usize = 1 << ROOTS;
/// Number of square roots that make the root of order [`TRIAL`], with the same bits on every
/// platform.
const ROOTS: u32 = 3;

/// Iterates until the certificate is good enough.
pub fn solve<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    goal: &Goal,
) -> Solution {
    let prospective = system.velocities.clone();
    let mut omega = 1.0;
    let (mut sweeps, mut mark) = (0, f64::INFINITY);
    let mut old = Vec::new();
    solution::iterate(system, goal, |system| {
        sweep(system, omega, &mut old);
        sweeps += 1;
        if sweeps % TRIAL == 0 {
            let error = certificate::certify(system, &prospective).error();
            let rate = (0..ROOTS).fold(error / mark, |rate, _| rate.sqrt());
            if rate >= 1.0 {
                omega = 1.0 + 0.5 * (omega - 1.0);
            } else if omega == 1.0 && mark.is_finite() {
                omega = 2.0 / (1.0 + (1.0 - rate).sqrt());
            } else if rate > omega - 1.0 {
                // Slower than the best factor would be: omega is still too small.
                omega += 0.25 * (2.0 - omega);
            }
            mark = error;
        }
    })
}

/// Runs one sweep in which the impulses of each manifold change by `omega` times the change of a
/// visit, and those of joints by the visit itself.
fn sweep<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    omega: f64,
    old: &mut Vec<Vector<f64, L>>,
) {
    for index in 0..system.manifolds.len() {
        let manifold = system.manifolds[index];
        old.clear();
        old.extend(system.contacts[manifold.points()].iter().map(|contact| contact.impulse));
        visit_constraint(system, index);
        if omega == 1.0 {
            continue;
        }
        let first = manifold.first as usize;
        system.change(index, |point, contact| {
            let before = contact.impulse;
            if contact.effective_mass > 0.0 {
                let over = old[point - first] + (before - old[point - first]) * omega;
                contact.impulse = Cone::of(&manifold, contact).clamp(over);
            }
            contact.impulse - before
        });
    }
    let manifolds = system.manifolds.len();
    for joint in 0..system.joints.len() {
        visit_constraint(system, manifolds + joint);
    }
}
