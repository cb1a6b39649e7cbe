//! Tests that the error bound of the certificate holds, and that it is tight.

use crate::common::{Random, Recipe, random_scene};
use drystone_solver::certificate::{Certificate, certify};
use drystone_solver::solution::{Goal, Status};
use drystone_solver::{InverseMass, System, Velocity, ladder, newton, pgs};

/// About as accurate as `f64` allows.
const EXACT: Goal = Goal { tolerance: 1e-12, budget: 200 };

/// Returns a random system with prospective velocities, zero impulses and contacts of this
/// softness.
fn random_system<const L: usize, const A: usize>(
    random: &mut Random,
    friction: bool,
    softness: f64,
) -> System<f64, L, A> {
    let recipe = Recipe {
        bodies: 2 + random.below(12),
        manifolds: 1 + random.below(24),
        points: 4,
        walls: true,
    };
    let mut system = random_scene::<L, A>(random, recipe).system;
    for manifold in &mut system.manifolds {
        manifold.friction = if friction { random.within(0.1, 1.0) } else { 0.0 };
    }
    for contact in &mut system.contacts {
        contact.target[0] = random.within(-0.5, 0.5);
        contact.impulse = drystone_solver::Vector::ZERO;
    }
    system.prepare(softness);
    system
}

/// Returns sqrt((v - w) . M (v - w) / m), the quantity that the certificate bounds. \[m/s\]
fn apart<const L: usize, const A: usize>(
    system: &System<f64, L, A>,
    v: &[Velocity<f64, L, A>],
    w: &[Velocity<f64, L, A>],
) -> f64 {
    let (mut squared, mut mass) = (0.0, 0.0);
    for ((inverse, v), w) in system.masses.iter().zip(v).zip(w) {
        let own = inverse.mass();
        squared += own.squared(&(*v - *w));
        mass += own.linear;
    }
    (squared / mass).sqrt()
}

/// Returns whether no contact of the system has a body that can move.
fn is_trivial<const L: usize, const A: usize>(system: &System<f64, L, A>) -> bool {
    system.contacts.iter().all(|contact| contact.effective_mass == 0.0)
}

/// Ratios of the certified bound to the true error, one for each comparison.
struct Tightness {
    ratios: Vec<f64>,
}

fn bound_holds<const L: usize, const A: usize>(
    seed: u64,
    softness: f64,
    tightness: &mut Tightness,
) {
    let random = &mut Random(seed);
    let system = random_system::<L, A>(random, false, softness);
    if is_trivial(&system) {
        return;
    }
    let mut exact = system.clone();
    let solution = newton::solve(&mut exact, &EXACT);
    // The residual of the sweeps is another formula for the same law.
    let residual = exact.residual(false);
    assert!(residual < 1e-8, "seed {seed} ({L},{A}): {residual} after {solution:?}");
    let mut sweeping = system.clone();
    for _ in 0..40 {
        pgs::sweep(&mut sweeping);
        let certificate = certify(&sweeping, &system.velocities);
        let truth = apart(&system, &sweeping.velocities, &exact.velocities);
        holds(&certificate, truth, seed);
        if truth > 1e-6 {
            tightness.ratios.push(certificate.error() / truth);
        }
        // Perturbed velocities, which no longer agree with the impulses.
        let mut perturbed = sweeping.clone();
        for (velocity, mass) in perturbed.velocities.iter_mut().zip(&system.masses) {
            if *mass != InverseMass::FIXED {
                velocity.linear[0] += random.within(-3.0, 3.0) * truth;
            }
        }
        let truth = apart(&system, &perturbed.velocities, &exact.velocities);
        holds(&certify(&perturbed, &system.velocities), truth, seed);
    }
}

fn holds(certificate: &Certificate, truth: f64, seed: u64) {
    let promised = certificate.error();
    assert!(
        promised >= truth * (1.0 - 1e-6) - 1e-9,
        "seed {seed}: {promised} promised, {truth} true, by {certificate:?}"
    );
}

#[test]
fn the_bound_is_never_violated_and_tight() {
    for softness in [0.1, 0.01, 0.001] {
        let mut tightness = Tightness { ratios: Vec::new() };
        for seed in 0..300 {
            in_all_four!(bound_holds, seed, softness, &mut tightness);
        }
        let mut ratios = tightness.ratios;
        ratios.sort_by(f64::total_cmp);
        let at = |part: f64| ratios[((ratios.len() - 1) as f64 * part) as usize];
        println!(
            "softness {softness}: {} compared; bound over error {:.2} (median), {:.2} (99 %), {:.2} (largest)",
            ratios.len(),
            at(0.5),
            at(0.99),
            at(1.0)
        );
        assert!(ratios.len() > 1000);
        // The stiffer a contact, the more a small error of its impulse weighs, and the looser the
        // bound.
        if softness >= 0.1 {
            assert!(at(0.99) < 20.0);
        }
    }
}

/// With Coulomb friction, Newton's method with updated shifts converges to a point that satisfies
/// the law of the sweeps.
fn friction_is_solved<const L: usize, const A: usize>(seed: u64, failed: &mut usize) {
    let system = random_system::<L, A>(&mut Random(seed), true, 0.01);
    if is_trivial(&system) {
        return;
    }
    let mut solved = system.clone();
    let solution = newton::solve(&mut solved, &Goal { tolerance: 1e-7, budget: 200 });
    if solution.status != Status::Converged {
        *failed += 1;
        return;
    }
    assert!(solved.residual(false) < 1e-6, "seed {seed}: {}", solved.residual(false));
    assert!(solution.certificate.natural_residual < 1e-6);
    assert!(solution.certificate.cone < 1e-12);
}

#[test]
fn newton_solves_coulomb_friction() {
    let mut failed = 0;
    for seed in 0..250 {
        in_all_four!(friction_is_solved, seed, &mut failed);
    }
    println!("{failed} of 1000 systems did not converge");
    assert!(failed <= 40, "{failed} of 1000 systems did not converge");
}

/// The ladder of methods solves systems on which single methods fail.
fn ladder_solves<const L: usize, const A: usize>(seed: u64, failed: &mut usize) {
    let system = random_system::<L, A>(&mut Random(seed), true, 0.01);
    if is_trivial(&system) {
        return;
    }
    let mut solved = system.clone();
    let (solution, _) = ladder::solve(&mut solved, &Goal { tolerance: 1e-7, budget: 200 });
    let again = certify(&solved, &system.velocities);
    assert!(again.error() <= solution.certificate.error() * (1.0 + 1e-9) + 1e-12, "seed {seed}");
    if solution.status != Status::Converged {
        *failed += 1;
        return;
    }
    assert!(solved.residual(false) < 1e-6, "seed {seed}: {}", solved.residual(false));
}

#[test]
fn the_ladder_solves_coulomb_friction() {
    let mut failed = 0;
    for seed in 0..250 {
        in_all_four!(ladder_solves, seed, &mut failed);
    }
    println!("{failed} of 1000 systems did not converge");
    let most = if cfg!(feature = "assembled") { 5 } else { 40 };
    assert!(failed <= most, "{failed} of 1000 systems did not converge");
}
