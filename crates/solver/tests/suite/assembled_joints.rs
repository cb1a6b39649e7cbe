//! Tests of rows of joints in matrices: the same velocities and residuals as in the bodies, the same
//! solutions, and refusals by the methods that know none.

use drystone_solver::assembled::ladder::{self, MatrixMethod};
use drystone_solver::assembled::{Assembly, Limits, Problem, ProblemError, Status, from_entries};
use drystone_solver::certificate::certify;
use drystone_solver::law::Interval;
use drystone_solver::solution::{self, Goal};
use drystone_solver::{System, newton, proximal};

use crate::common::{Random, assert_close};
use crate::joints::{apart, random_system};

const LIMITS: Limits = Limits { tolerance: 1e-11, budget: 100_000 };

/// The methods that take rows of joints.
const METHODS: [MatrixMethod; 3] =
    [MatrixMethod::GaussSeidel, MatrixMethod::Proximal, MatrixMethod::InteriorPoint];

/// The residual of the matrices is zero where that of the bodies is, and the gap is that of the
/// certificate.
fn matrices_agree<const L: usize, const A: usize>(seed: u64) {
    let system = random_system::<L, A>(seed);
    let assembly = Assembly::of_system(&system).unwrap();
    let problem = assembly.problem().unwrap();
    assert!(!problem.rows().is_empty(), "seed {seed}");
    let mut swept = system.clone();
    let random = &mut Random(seed);
    for axis in &mut swept.axes {
        let [lo, hi] = axis.law.bounds;
        axis.impulse = random.within(-1.0, 1.0).clamp(lo, hi);
    }
    for contact in &mut swept.contacts {
        contact.impulse[0] = random.within(0.0, 1.0);
    }
    let guess = Assembly::of_system(&swept).unwrap().warm(&problem);
    let prospective = swept.velocities.clone();
    swept.apply_impulses();
    let certificate = certify(&swept, &prospective);
    let gap = assembly.gap(&guess);
    assert!(certificate.duality_gap <= gap * (1.0 + 1e-9), "seed {seed} ({L},{A})");
    let (u, mut rows) = (problem.velocities(&guess), assembly.rows.axes.iter());
    let (_, u) = problem.split_rows(&u);
    for joint in &swept.joints {
        let [a, b] = joint.bodies.map(|body| swept.velocities[body as usize]);
        for axis in &swept.axes[joint.axes()] {
            if axis.effective_mass > 0.0 {
                let row = assembly.rows.axes.len() - rows.len();
                rows.next();
                let low = axis.law.targets.into_iter().find(|t| t.is_finite()).unwrap();
                let own = axis.velocity(&a, &b) - low + axis.law.compliance * axis.impulse;
                assert_close(u[row], own, 1e-10);
            }
        }
    }
    assert_eq!(rows.len(), 0);
}

/// All methods for matrices reach the velocities of Newton's method.
fn solutions_agree<const L: usize, const A: usize>(seed: u64) {
    let system = random_system::<L, A>(seed);
    let mut exact = system.clone();
    newton::solve(&mut exact, &Goal { tolerance: 1e-11, budget: 300 });
    let assembly = Assembly::of_system(&system).unwrap();
    let problem = assembly.problem().unwrap();
    let warm = assembly.warm(&problem);
    let by_ladder = ladder::solve(&problem, Some(&warm), &LIMITS).outcome;
    let alone = METHODS.map(|method| (method.name(), method.solve(&problem, Some(&warm), &LIMITS)));
    for (name, solved) in [("ladder", by_ladder)].into_iter().chain(alone) {
        // The interior-point method has a tolerance of its own.
        let is_interior = name == "interior-point";
        let (most, most_gap) = if is_interior { (1e-7, 1e-10) } else { (1e-11, 1e-12) };
        let residual = solved.residual;
        assert!(residual <= most, "seed {seed} ({L},{A}) {name}: {residual}");
        let mut by_matrices = system.clone();
        assembly.give_back(&solved.impulses, &mut by_matrices);
        by_matrices.apply_impulses();
        let error = apart(&system, &by_matrices.velocities, &exact.velocities);
        assert!(error < 1e-6, "seed {seed} ({L},{A}) {name}: {error} m/s");
        let gap = assembly.gap(&solved.impulses);
        assert!(gap <= most_gap, "seed {seed} ({L},{A}) {name}: {gap} J");
    }
}

#[test]
fn matrices_of_joints_and_bodies_agree() {
    for seed in 0..100 {
        in_all_four!(matrices_agree, seed);
    }
}

#[test]
fn matrices_of_joints_have_the_certified_solution() {
    for seed in 0..100 {
        in_all_four!(solutions_agree, seed);
    }
}

/// With friction the solution may not be unique: it is certified instead.
fn solved_with_friction<const L: usize, const A: usize>(seed: u64) {
    let mut system = random_system::<L, A>(seed);
    let random = &mut Random(seed);
    for manifold in &mut system.manifolds {
        manifold.friction = random.within(0.1, 0.6);
    }
    system.prepare(0.1);
    let prospective = system.velocities.clone();
    let solved = proximal::solve(&mut system, &Goal { tolerance: 1e-7, budget: 2000 });
    assert_eq!(solved.status, solution::Status::Converged, "seed {seed} ({L},{A}): {solved:?}");
    let certificate = certify(&system, &prospective);
    assert!(certificate.error() < 1e-7, "seed {seed} ({L},{A}): {certificate:?}");
    assert!(system.residual(false) < 1e-6, "seed {seed} ({L},{A})");
}

#[test]
fn joints_beside_friction_are_solved_and_certified() {
    for seed in 0..60 {
        in_all_four!(solved_with_friction, seed);
    }
}

/// Methods that know no rows of joints say so.
#[test]
fn methods_without_rows_of_joints_refuse_them() {
    let system = random_system::<3, 3>(5);
    let problem = Problem::of_system(&system).unwrap();
    for method in MatrixMethod::ALL.into_iter().filter(|method| !METHODS.contains(method)) {
        let refused = method.solve(&problem, None, &LIMITS);
        assert_eq!(refused.status, Status::BadInput, "{}", method.name());
        assert!(refused.reason.contains("joints"), "{}: {}", method.name(), refused.reason);
    }
}

/// A row between two targets, by hand: u = 2 r + q, with targets 0 and 1 and bounds -1 and 1.
#[test]
fn a_row_with_a_slack_has_five_pieces() {
    let law = Interval { targets: [0.0, 1.0], bounds: [-1.0, 1.0], compliance: 0.0 };
    for (q, r) in [(-4.0, 1.0), (-1.0, 0.5), (0.5, 0.0), (2.0, -0.5), (5.0, -1.0)] {
        let matrix = from_entries(1, 1, &[(0, 0, 2.0)]).unwrap();
        let problem = Problem::with_rows((1, vec![]), vec![law], matrix, vec![q]).unwrap();
        for method in METHODS {
            let solved = method.solve(&problem, None, &Limits { tolerance: 1e-9, ..LIMITS });
            assert_eq!(solved.status, Status::Converged, "{} at {q}", method.name());
            assert_close(solved.impulses[0], r, 1e-7);
        }
    }
}

/// Targets and bounds out of order are refused, and rows that nothing moves are left out.
#[test]
fn laws_out_of_order_are_refused() {
    for (targets, bounds) in [([1.0, 0.0], [-1.0, 1.0]), ([0.0; 2], [0.5, 1.0])] {
        let law = Interval { targets, bounds, compliance: 0.0 };
        let matrix = from_entries(1, 1, &[(0, 0, 1.0)]).unwrap();
        let error = Problem::with_rows((1, vec![]), vec![law], matrix, vec![0.0]).unwrap_err();
        assert_eq!(error, ProblemError::Law(0));
    }
    let mut system: System<f64, 3, 3> = random_system(5);
    let all = system.axes.len();
    system.axes[0].effective_mass = 0.0;
    assert_eq!(Assembly::of_system(&system).unwrap().rows.axes.len(), all - 1);
}
