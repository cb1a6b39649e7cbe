//! Tests that all methods converge to the same velocities, and of the iterations that each needs.

use crate::common::{Random, Recipe, Scene, random_scene};
use drystone_solver::solution::{Goal, Solution, Status};
use drystone_solver::{System, Vector, apgd, newton, nncg, pgs, psor, symmetric};

type Tried<const L: usize, const A: usize> = fn(&mut System<f64, L, A>, &Goal) -> Solution;

fn methods<const L: usize, const A: usize>() -> Vec<(&'static str, Tried<L, A>)> {
    vec![
        ("pgs", pgs::solve),
        ("symmetric", symmetric::solve),
        ("psor", psor::solve),
        ("nncg", nncg::solve),
        ("apgd", apgd::solve),
        ("newton", newton::solve),
        #[cfg(feature = "assembled")]
        ("proximal", drystone_solver::proximal::solve),
    ]
}

fn agree<const L: usize, const A: usize>(seed: u64, friction: bool) {
    let random = &mut Random(seed);
    let recipe = Recipe {
        bodies: 2 + random.below(10),
        manifolds: 1 + random.below(16),
        points: 4,
        walls: true,
    };
    let mut system = random_scene::<L, A>(random, recipe).system;
    for manifold in &mut system.manifolds {
        manifold.friction = if friction { random.within(0.1, 0.5) } else { 0.0 };
    }
    for contact in &mut system.contacts {
        contact.impulse = Vector::ZERO;
    }
    system.prepare(0.1);
    let goal = Goal { tolerance: 1e-6, budget: 20_000 };
    let mut first: Option<System<f64, L, A>> = None;
    for (name, method) in methods::<L, A>() {
        let mut solved = system.clone();
        let solution = method(&mut solved, &goal);
        if solution.status != Status::Converged {
            // No method is guaranteed to converge with Coulomb friction.
            assert!(friction, "seed {seed} ({L},{A}) {name}: {:?}", solution.status);
            continue;
        }
        if let Some(first) = &first
            && !friction
        {
            for (v, w) in solved.velocities.iter().zip(&first.velocities) {
                assert!((v.linear - w.linear).length() < 1e-4, "seed {seed} ({L},{A}) {name}");
            }
        }
        assert!(solved.residual(false) < 1e-3, "{name}: {}", solved.residual(false));
        first.get_or_insert(solved);
    }
}

#[test]
fn all_methods_agree() {
    for seed in 0..150 {
        in_all_four!(agree, seed, false);
        in_all_four!(agree, seed, true);
    }
}

/// Returns a column of balls that fall onto a floor together at 1 m/s. The masses are listed from
/// the bottom up.
fn column(masses: &[f64], softness: f64) -> System<f64, 2, 0> {
    let mut scene = Scene::<2, 0>::new();
    let mut below = scene.wall();
    for (i, &mass) in masses.iter().enumerate() {
        let ball = scene.ball(Vector([0.0, i as f64]), mass);
        scene.system.velocities[ball as usize].linear = Vector([0.0, -1.0]);
        scene.push(ball, below, Vector([0.0, 1.0]));
        below = ball;
    }
    scene.system.prepare(softness);
    scene.system
}

/// Returns the iterations until the certificate bounds the velocity error by 1 mm/s. All velocities
/// are 1 m/s before.
fn iterations(system: &System<f64, 2, 0>, method: Tried<2, 0>) -> usize {
    let solution = method(&mut system.clone(), &Goal { tolerance: 1e-3, budget: 200_000 });
    assert_eq!(
        solution.status,
        Status::Converged,
        "{:?}",
        solution.history.iter().take(60).collect::<Vec<_>>()
    );
    solution.iterations()
}

#[test]
fn columns_from_cold() {
    let equal = column(&[1.0; 100], 1e-4);
    let mut masses = [1.0; 10];
    masses[9] = 1000.0;
    let heavy = column(&masses, 1e-4);
    for (name, method) in methods::<2, 0>() {
        let counts = [&equal, &heavy].map(|system| iterations(system, method));
        println!("{name}: {counts:?} iterations for 100 equal bodies, 1000 on 9 light ones");
        match name {
            "nncg" => assert!(counts[0] <= 480 && counts[1] <= 540, "{counts:?}"),
            "newton" => assert!(counts[0] <= 20 && counts[1] <= 20, "{counts:?}"),
            _ => {}
        }
    }
}
