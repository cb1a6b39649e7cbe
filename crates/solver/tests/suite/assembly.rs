//! Tests that a system and its matrices agree on contact velocities, residuals and solutions.

use crate::common::{Random, Recipe, assert_all_close, assert_close, random_scene};
use drystone_solver::assembled::{Assembly, Limits, Problem, ProblemError, Status, ladder};
use drystone_solver::certificate::certify;
use drystone_solver::{
    ConstraintFrame, Contact, InverseMass, Manifold, SymmetricMatrix, System, Vector, Velocity,
    contact_frame,
};

/// Returns soft contacts between random bodies, one of which cannot rotate, and contacts with two
/// walls. One of the walls moves and touches the other.
fn any_system<const L: usize, const A: usize>(seed: u64, friction: bool) -> System<f64, L, A> {
    let random = &mut Random(seed);
    let recipe = Recipe {
        bodies: 2 + random.below(6),
        manifolds: 1 + random.below(10),
        points: 3,
        walls: true,
    };
    let mut scene = random_scene::<L, A>(random, recipe);
    let walls = [scene.wall(), scene.wall()];
    scene.system.velocities[walls[0] as usize].linear = random.vector();
    let below = scene.system.manifolds[0].bodies[0];
    let normal = if A == 0 { scene.system.manifolds[0].frame.axes[0] } else { random.unit() };
    scene.push(walls[0], walls[1], normal);
    scene.push(below, walls[0], normal);
    let mut system = scene.system;
    system.masses[below as usize].angular = SymmetricMatrix::ZERO;
    for manifold in &mut system.manifolds {
        manifold.friction = if friction { random.within(0.1, 0.6) } else { 0.0 };
    }
    system.prepare(0.1);
    for manifold in &system.manifolds {
        for contact in &mut system.contacts[manifold.points()] {
            contact.target = random.vector();
            contact.impulse = random.vector::<L>() * (0.5 * manifold.friction);
            contact.impulse[0] = random.within(0.9, 1.5);
        }
    }
    system
}

/// Returns the largest natural residual of a contact, computed from the impulses `r` and velocities
/// `u` of the matrix problem. It covers the normal condition and the change of friction by a
/// projected step against the slip. \[m/s\]
fn natural_residual<const L: usize, const A: usize>(
    system: &System<f64, L, A>,
    assembly: &Assembly,
    r: &[f64],
    u: &[f64],
) -> f64 {
    let d = r.len() / assembly.contacts.len();
    let mut worst = 0.0f64;
    for (place, &i) in assembly.contacts.iter().enumerate() {
        let rows = d * place..d * (place + 1);
        let (r, u, contact) = (&r[rows.clone()], &u[rows], &system.contacts[i]);
        worst = worst.max((r[0] / contact.effective_mass).min(u[0]).abs());
        let mass = contact.tangential_mass;
        let step: Vec<f64> = (1..d).map(|k| r[k] - mass * u[k]).collect();
        let length = step.iter().map(|x| x * x).sum::<f64>().sqrt();
        let part = (assembly.friction[place] * r[0] / length).min(1.0);
        let miss = (1..d).map(|k| (part * step[k - 1] - r[k]).powi(2)).sum::<f64>().sqrt();
        worst = worst.max(miss / mass);
    }
    worst
}

fn matrices_agree<const L: usize, const A: usize>(seed: u64, friction: bool) {
    let mut system = any_system::<L, A>(seed, friction);
    let assembly = Assembly::of_system(&system).unwrap();
    let problem = assembly.problem().unwrap();
    let d = problem.dimension();
    assert_eq!(d, if friction { L } else { 1 });
    assert_eq!(assembly.contacts.len() + 1, system.contacts.len(), "the walls' own is left out");
    let warm = assembly.warm(&problem);
    let u = problem.velocities(&warm);

    let prospective = system.velocities.clone();
    system.apply_impulses();
    let mut expected = Vec::new();
    for manifold in &system.manifolds {
        let [a, b] = system.velocities_of(manifold);
        for contact in &system.contacts[manifold.points()] {
            if contact.effective_mass > 0.0 {
                let mut w =
                    contact.relative_velocity(&manifold.frame.twist(&a, &b)) - contact.target;
                w[0] += contact.compliance * contact.impulse[0];
                for k in 1..L {
                    w[k] += contact.tangential_compliance * contact.impulse[k];
                }
                expected.extend_from_slice(&w.0[..d]);
            }
        }
    }
    assert_all_close(u.iter().copied(), expected, 1e-10);
    let (residual, gap) = (certify(&system, &prospective).natural_residual, assembly.gap(&warm));
    // The certificate searches a line of impulses that starts here, and along it the gap only
    // falls.
    assert!(
        certify(&system, &prospective).duality_gap <= gap * (1.0 + 1e-9),
        "seed {seed} ({L},{A})"
    );
    assert_close(natural_residual(&system, &assembly, &warm, &u), residual, 1e-10);
}

fn solved_from_matrices<const L: usize, const A: usize>(seed: u64, friction: bool) {
    let mut system = any_system::<L, A>(seed, friction);
    let assembly = Assembly::of_system(&system).unwrap();
    let problem = assembly.problem().unwrap();
    let limits = Limits { tolerance: 1e-10, ..Limits::default() };
    let solved = ladder::solve(&problem, Some(&assembly.warm(&problem)), &limits).outcome;
    assert_eq!(solved.status, Status::Converged, "seed {seed} ({L},{A}): {}", solved.residual);
    let prospective = system.velocities.clone();
    assembly.give_back(&solved.impulses, &mut system);
    system.apply_impulses();
    let certificate = certify(&system, &prospective);
    assert!(certificate.error() < 1e-7, "seed {seed} ({L},{A}): {certificate:?}");
    let gap = assembly.gap(&solved.impulses);
    assert!(gap <= 1e-12, "seed {seed} ({L},{A}): {gap}");
    assert!(certificate.natural_residual < 1e-7, "seed {seed} ({L},{A}): {certificate:?}");
}

#[test]
fn matrices_and_bodies_agree() {
    for seed in 0..100 {
        for friction in [false, true] {
            in_all_four!(matrices_agree, seed, friction);
        }
    }
}

#[test]
fn a_solution_by_matrices_is_certified() {
    for seed in 0..60 {
        for friction in [false, true] {
            in_all_four!(solved_from_matrices, seed, friction);
        }
    }
}

/// A body that can rotate only about one axis, which is parallel to no world axis.
#[test]
fn locked_axes_stay_locked() {
    let (axis, n) = (Vector([0.6, 0.0, 0.8]), Vector([0.0, 1.0, 0.0]));
    let mut angular = SymmetricMatrix::ZERO;
    for i in 0..3 {
        for j in 0..3 {
            angular.0[i][j] = 5.0 * axis[i] * axis[j];
        }
    }
    let mut system = System::<f64, 3, 3>::new();
    let body = system.add_body(Velocity::ZERO, InverseMass { linear: 2.0, angular });
    let floor = system.add_body(Velocity::ZERO, InverseMass::FIXED);
    let manifold = Manifold {
        bodies: [body, floor],
        frame: ConstraintFrame {
            axes: contact_frame(n),
            arms: [Vector([1.0, 0.0, 0.0]), Vector::ZERO],
        },
        ..Manifold::default()
    };
    system.add_manifold(manifold, &[Contact::default()]);
    system.prepare(0.0);
    let problem = Problem::of_system(&system).unwrap();
    // r x n = (0, 0, 1), whose component along the axis is 0.8.
    assert_close(problem.matrix()[(0, 0)], 2.0 + 5.0 * 0.8 * 0.8, 1e-12);
}

#[test]
fn nan_is_refused() {
    let mut system = any_system::<2, 1>(1, true);
    system.velocities[0].linear[0] = f64::NAN;
    let error = Problem::of_system(&system).unwrap_err();
    assert!(matches!(error, ProblemError::NotFinite(..)), "{error}");
    let mut system = any_system::<2, 1>(1, true);
    system.masses[0].linear = f64::INFINITY;
    assert!(Problem::of_system(&system).is_err());
}
