//! Projected successive over-relaxation: sweeps that go further than each contact asks for, by a
//! factor that is found on the way.
//!
//! Gauss-Seidel lowers the error by a rate rho per sweep; then the best factor is
//! omega = 2 / (1 + sqrt(1 - rho)) (Young 1954), if A is like that of a chain. rho is measured from
//! the certificates; where a factor makes the error grow, it is drawn back towards 1.
//!
//! Cost of an iteration: one sweep. Place: regular stacks, where the best factor would need about
//! 3 n sweeps for n bodies. The factor that is found is smaller, since the first sweeps of a column
//! lower the error faster than the last: half of what plain sweeps need (`tests/suite/methods.rs`).

use crate::cone::Law;
use crate::pgs::visit_manifold;
use crate::solution::{self, Goal, Solution};
use crate::{System, Vector, certificate};

/// Plain sweeps before the rate is taken, and sweeps between changes of the factor.
const TRIAL: usize = 8;

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
            let rate = (error / mark).powf(1.0 / TRIAL as f64);
            if rate >= 1.0 {
                omega = 1.0 + 0.5 * (omega - 1.0);
            } else if omega == 1.0 && mark.is_finite() {
                omega = 2.0 / (1.0 + (1.0 - rate).sqrt());
            } else if rate > omega - 1.0 {
                // Slower than the factor should be: not far enough yet.
                omega += 0.25 * (2.0 - omega);
            }
            mark = error;
        }
    })
}

/// One sweep; each manifold's impulses change by `omega` times what a visit would change.
fn sweep<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    omega: f64,
    old: &mut Vec<Vector<f64, L>>,
) {
    for index in 0..system.manifolds.len() {
        let manifold = system.manifolds[index];
        old.clear();
        old.extend(system.contacts[manifold.points()].iter().map(|contact| contact.impulse));
        visit_manifold(system, index);
        if omega == 1.0 {
            continue;
        }
        let first = manifold.first as usize;
        system.change(index, |point, contact| {
            let before = contact.impulse;
            if contact.effective_mass > 0.0 {
                let over = old[point - first] + (before - old[point - first]) * omega;
                contact.impulse = Law::of(&manifold, contact).clamp(over);
            }
            contact.impulse - before
        });
    }
}
