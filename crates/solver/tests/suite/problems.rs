//! Tests on problems given as matrices: problems with known solutions, agreement of the methods,
//! and collections of real problems.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::common::Random;
use drystone_solver::assembled::ladder::{self, MatrixMethod, Solved};
use drystone_solver::assembled::{
    Bodies, Limits, Matrix, Outcome, Problem, ProblemError, Status, block_gauss_seidel,
    enumeration, from_entries, interior_point, lemke, newton, proximal,
};
use serde_json::Value;

fn matrix(rows: &[Vec<f64>]) -> Matrix {
    let columns = rows.first().map_or(0, Vec::len);
    let entries: Vec<_> = (0..rows.len())
        .flat_map(|i| (0..columns).map(move |j| (i, j)))
        .map(|(i, j)| (i, j, rows[i][j]))
        .collect();
    from_entries(rows.len(), columns, &entries).unwrap()
}

fn lcp<const N: usize>(m: [[f64; N]; N], q: [f64; N]) -> Problem {
    let rows: Vec<Vec<f64>> = m.iter().map(|row| row.to_vec()).collect();
    Problem::complementarity(matrix(&rows), q.to_vec()).unwrap()
}

#[track_caller]
fn assert_near(x: &[f64], y: &[f64], tolerance: f64) {
    assert_eq!(x.len(), y.len());
    assert!(x.iter().zip(y).all(|(x, y)| (x - y).abs() <= tolerance), "{x:?} is not {y:?}");
}

/// Asserts what holds for every outcome, whatever the method and the problem.
#[track_caller]
fn assert_honest(problem: &Problem, outcome: &Outcome, limits: &Limits) {
    assert!(outcome.impulses.iter().all(|r| r.is_finite()));
    assert_eq!(outcome.impulses.len(), problem.unknowns());
    assert_eq!(outcome.residual, problem.residual(&outcome.impulses));
    assert_eq!(outcome.status == Status::Converged, outcome.residual <= limits.tolerance);
    assert_eq!(outcome.status == Status::Infeasible, outcome.certificate.is_some());
    assert!(outcome.history.is_sorted_by_key(|sample| sample.iteration));
}

/// Runs each method alone and checks that none misreports its outcome. Returns the methods that
/// converged.
fn solved_by(problem: &Problem) -> Vec<(MatrixMethod, Outcome)> {
    let limits = Limits { tolerance: 1e-11, budget: 20_000 };
    let run = |method: MatrixMethod| (method, method.solve(problem, None, &limits));
    let outcomes: Vec<_> = MatrixMethod::ALL.into_iter().map(run).collect();
    for (_, outcome) in &outcomes {
        assert_honest(problem, outcome, &limits);
    }
    outcomes.into_iter().filter(|(_, outcome)| outcome.status == Status::Converged).collect()
}

// ---------------------------------------------------------------------------------------------
// Problems with known solutions
// ---------------------------------------------------------------------------------------------

#[test]
fn ortiz_and_other_problems_with_answers() {
    // The diagonal is zero, so Gauss-Seidel must refuse the problem; other methods solve it.
    let zeros = lcp([[0.0, 2.0, -1.0], [-1.0, 0.0, 1.0], [2.0, -2.0, 0.0]], [-3.0, 6.0, -1.0]);
    let refused = block_gauss_seidel::solve(&zeros, None, &Limits::default());
    assert_eq!(refused.status, Status::BadInput);
    let found = solved_by(&zeros);
    assert!(found.iter().any(|(method, _)| *method == MatrixMethod::Lemke));
    for (method, outcome) in found {
        let z = &outcome.impulses;
        assert!(zeros.residual(z) < 1e-11, "{method:?}");
    }
    // The two contacts balance: impulses are determined only up to a multiple of (1, 1), but the
    // velocities are unique.
    let ray = lcp([[1.0, -1.0], [-1.0, 1.0]], [1.0, -1.0]);
    for (_, outcome) in solved_by(&ray) {
        assert_near(&ray.velocities(&outcome.impulses), &[0.0, 0.0], 1e-9);
    }
    // Degenerate: every z >= 0 with z_1 + z_2 = 1 is a solution.
    let twins = lcp([[1.0, 1.0], [1.0, 1.0]], [-1.0, -1.0]);
    let found = solved_by(&twins);
    assert!(found.len() >= 5, "{found:?}");
    for (_, outcome) in found {
        assert_near(&[outcome.impulses.iter().sum()], &[1.0], 1e-9);
    }
}

/// Cottle, Pang and Stone, example 4.4.23: a two-person (bimatrix) game.
#[test]
fn a_game_that_ends_lemkes_method_on_a_ray() {
    let game = lcp(
        [
            [0.0, 0.0, 10.0, 20.0],
            [0.0, 0.0, 30.0, 15.0],
            [10.0, 20.0, 0.0, 0.0],
            [30.0, 15.0, 0.0, 0.0],
        ],
        [-1.0; 4],
    );
    let limits = Limits { tolerance: 1e-11, budget: 20_000 };
    let answer = [1.0 / 90.0, 2.0 / 45.0, 1.0 / 90.0, 2.0 / 45.0];
    let equilibria = enumeration::all(&game, 1e-11);
    assert!(equilibria.iter().any(|z| z.iter().zip(answer).all(|(z, a)| (z - a).abs() < 1e-12)));
    assert_eq!(equilibria.len(), 3);
    let solved = ladder::solve(&game, None, &limits);
    assert_honest(&game, &solved.outcome, &limits);
    assert_eq!(solved.outcome.status, Status::Converged);
}

#[test]
fn a_cycle_is_noticed_and_the_next_method_solves() {
    let cyclic = lcp([[1.0, 0.0, 2.0], [2.0, 1.0, 0.0], [0.0, 2.0, 1.0]], [-1.0; 3]);
    let limits = Limits::default();
    let circles = block_gauss_seidel::solve(&cyclic, None, &limits);
    assert_eq!(circles.status, Status::Stalled);
    assert!(circles.iterations < 200, "noticed after {} sweeps", circles.iterations);
    let solved = ladder::solve(&cyclic, None, &limits);
    assert_eq!(solved.outcome.status, Status::Converged);
    assert_ne!(solved.method, MatrixMethod::GaussSeidel);
    assert_near(&solved.outcome.impulses, &[1.0 / 3.0; 3], 1e-9);
}

#[test]
fn a_jam_is_proven() {
    // A body between two walls that move together: the impulses of Gauss-Seidel grow as (1, 2), (3,
    // 4), ...
    let jam = lcp([[1.0, -1.0], [-1.0, 1.0]], [-1.0, -1.0]);
    for method in [MatrixMethod::GaussSeidel, MatrixMethod::Lemke, MatrixMethod::InteriorPoint] {
        let outcome = method.solve(&jam, None, &Limits::default());
        assert_honest(&jam, &outcome, &Limits::default());
        assert_eq!(outcome.status, Status::Infeasible, "{method:?}");
        let stress = outcome.certificate.unwrap();
        assert_near(&stress.weights, &[1.0, 1.0], 1e-6);
        assert!((stress.approach - 2.0).abs() < 1e-5);
    }
    let solved = ladder::solve(&jam, None, &Limits::default());
    assert_eq!(solved.outcome.status, Status::Infeasible);
}

/// Murty 1978: M has 1 on the diagonal and 2 below it, and q = -1. The solution is z = (1, 0, ...,
/// 0).
#[test]
fn lemkes_method_takes_exponentially_many_pivots_where_it_must() {
    for n in 3..=9usize {
        let entry = |i: usize, j: usize| match i.cmp(&j) {
            std::cmp::Ordering::Equal => 1.0,
            std::cmp::Ordering::Greater => 2.0,
            std::cmp::Ordering::Less => 0.0,
        };
        let rows: Vec<Vec<f64>> = (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect();
        let q = (0..n).map(|_| -1.0).collect();
        let problem = Problem::complementarity(matrix(&rows), q).unwrap();
        let outcome = lemke::solve(&problem, None, &Limits::default());
        assert_eq!(outcome.status, Status::Converged);
        println!("n = {n}: {} pivots", outcome.iterations);
        let mut answer = vec![0.0; n];
        answer[0] = 1.0;
        assert_near(&outcome.impulses, &answer, 1e-12);
        let sweeps = block_gauss_seidel::solve(&problem, None, &Limits::default());
        assert_eq!((sweeps.status, sweeps.iterations), (Status::Converged, 1));
    }
}

/// A pushed box on a plane sticks inside the friction cone, slides on its boundary, or lifts off.
#[test]
fn coulombs_law_at_one_contact() {
    let w = matrix(&[vec![2.0, 0.0, 0.0], vec![0.0, 2.0, 0.0], vec![0.0, 0.0, 2.0]]);
    let limits = Limits { tolerance: 1e-12, budget: 1000 };
    for (q, r) in [
        ([-2.0, 0.6, 0.8], [1.0, -0.3, -0.4]),
        ([-2.0, 3.0, 4.0], [1.0, -0.6 * 0.6, -0.6 * 0.8]),
        ([1.0, 3.0, 4.0], [0.0, 0.0, 0.0]),
    ] {
        let problem = Problem::new(3, vec![0.6], w.clone(), q.to_vec()).unwrap();
        for method in [MatrixMethod::GaussSeidel, MatrixMethod::Proximal] {
            let outcome = method.solve(&problem, None, &limits);
            assert_honest(&problem, &outcome, &limits);
            assert_near(&outcome.impulses, &r, 1e-11);
        }
    }
}

// ---------------------------------------------------------------------------------------------
// Properties
// ---------------------------------------------------------------------------------------------

/// Returns a feasible problem whose matrix is positive semidefinite: G G^T with G of `rank`
/// columns, plus `shift` on the diagonal.
fn random_semidefinite(random: &mut Random, n: usize, rank: usize, shift: f64) -> Problem {
    let g: Vec<Vec<f64>> =
        (0..n).map(|_| (0..rank).map(|_| random.within(-1.0, 1.0)).collect()).collect();
    let dot = |i: usize, j: usize| g[i].iter().zip(&g[j]).map(|(a, b)| a * b).sum::<f64>();
    let entry = |i, j| dot(i, j) + if i == j { shift } else { 0.0 };
    let rows: Vec<Vec<f64>> = (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect();
    // q = u - M r with u >= 0, r >= 0, so that (r, u) is feasible.
    let r: Vec<f64> = (0..n).map(|_| random.within(-1.0, 1.0).max(0.0)).collect();
    let u: Vec<f64> = (0..n).map(|_| random.within(-1.0, 1.0).max(0.0)).collect();
    let push = |i: usize| (0..n).map(|j| rows[i][j] * r[j]).sum::<f64>();
    let q = (0..n).map(|i| u[i] - push(i)).collect();
    Problem::complementarity(matrix(&rows), q).unwrap()
}

#[test]
fn all_methods_agree_on_the_velocities() {
    let limits = Limits { tolerance: 1e-10, budget: 1_000_000 };
    for seed in 0..60 {
        let random = &mut Random(seed);
        let n = 1 + random.below(9);
        let rank = 1 + random.below(n + 2);
        let shift = [0.0, 1e-3, 1.0][random.below(3)];
        let problem = random_semidefinite(random, n, rank, shift);
        let reference = ladder::solve(&problem, None, &limits);
        assert_eq!(reference.outcome.status, Status::Converged, "seed {seed}");
        let u = problem.velocities(&reference.outcome.impulses);
        for method in MatrixMethod::ALL {
            let outcome = method.solve(&problem, None, &limits);
            assert_honest(&problem, &outcome, &limits);
            // The interior-point method stops slightly inside the cone, so the tolerance is wide. A
            // method that stalls reports it.
            if outcome.status == Status::Converged {
                assert_near(&problem.velocities(&outcome.impulses), &u, 1e-4);
            }
            if matches!(method, MatrixMethod::Lemke | MatrixMethod::Proximal) {
                assert_eq!(outcome.status, Status::Converged, "seed {seed}, {method:?}");
            }
        }
    }
}

/// A P-matrix gives one solution for every q. These matrices are a positive diagonal plus a
/// skew-symmetric matrix.
#[test]
fn all_methods_agree_on_unsymmetric_matrices() {
    let limits = Limits { tolerance: 1e-11, budget: 50_000 };
    for seed in 0..60 {
        let random = &mut Random(1000 + seed);
        let n = 2 + random.below(8);
        let mut rows = vec![vec![0.0; n]; n];
        for i in 0..n {
            rows[i][i] = random.within(0.05, 1.0);
            for j in 0..i {
                let x = random.within(-1.0, 1.0);
                (rows[i][j], rows[j][i]) = (x, -x);
            }
        }
        let q: Vec<f64> = (0..n).map(|_| random.within(-1.0, 0.5)).collect();
        let problem = Problem::complementarity(matrix(&rows), q).unwrap();
        let answer = enumeration::solve(&problem, None, &limits);
        assert_eq!(answer.status, Status::Converged, "seed {seed}");
        assert_eq!(enumeration::all(&problem, 1e-11).len(), 1);
        for solve in [lemke::solve, newton::solve, proximal::solve] {
            let outcome = solve(&problem, None, &limits);
            assert_honest(&problem, &outcome, &limits);
            if outcome.status == Status::Converged {
                assert_near(&outcome.impulses, &answer.impulses, 1e-8);
            }
        }
        let solved = ladder::solve(&problem, None, &limits);
        assert_near(&solved.outcome.impulses, &answer.impulses, 1e-8);
    }
}

#[test]
fn no_matrix_makes_a_method_lie_or_panic() {
    let limits = Limits { tolerance: 1e-9, budget: 2000 };
    let (mut solved, mut proven) = (0, 0);
    for seed in 0..300 {
        let random = &mut Random(77_000 + seed);
        let n = 1 + random.below(6);
        let mut entry = || match random.below(5) {
            0 => 0.0,
            1 => random.within(-1.0, 1.0) * 1e9,
            2 => random.below(5) as f64 - 2.0,
            _ => random.within(-1.0, 1.0),
        };
        let rows: Vec<Vec<f64>> = (0..n).map(|_| (0..n).map(|_| entry()).collect()).collect();
        let q: Vec<f64> = (0..n).map(|_| entry()).collect();
        let problem = Problem::complementarity(matrix(&rows), q.clone()).unwrap();
        for method in MatrixMethod::ALL {
            assert_honest(&problem, &method.solve(&problem, None, &limits), &limits);
        }
        let Solved { outcome, .. } = ladder::solve(&problem, None, &limits);
        assert_honest(&problem, &outcome, &limits);
        solved += u32::from(outcome.status == Status::Converged);
        if let Some(stress) = outcome.certificate {
            proven += 1;
            // The problem has no solution, so enumeration must not find one either.
            assert!(enumeration::all(&problem, 1e-10).is_empty(), "seed {seed}");
            assert!(stress.approach > 0.0 && stress.weights.iter().all(|&y| y >= 0.0));
        }
    }
    println!("{solved} solved, {proven} proven contradictory, of 300");
    assert!(solved > 150 && proven > 30);
}

#[test]
fn friction_over_random_bodies_is_solved_by_both_methods() {
    let limits = Limits { tolerance: 1e-10, budget: 20_000 };
    for seed in 0..40 {
        let random = &mut Random(500 + seed);
        let (contacts, dofs) = (1 + random.below(8), 6 + random.below(12));
        let h: Vec<Vec<f64>> = (0..dofs)
            .map(|_| (0..3 * contacts).map(|_| random.within(-1.0, 1.0)).collect())
            .collect();
        let mass: Vec<Vec<f64>> = (0..dofs)
            .map(|i| (0..dofs).map(|j| if i == j { 1.0 + i as f64 } else { 0.0 }).collect())
            .collect();
        let bodies = Bodies {
            mass: matrix(&mass),
            directions: matrix(&h),
            momentum: (0..dofs).map(|_| random.within(-1.0, 1.0)).collect(),
            given: vec![0.0; 3 * contacts],
        };
        let friction = (0..contacts).map(|_| random.within(0.0, 1.0)).collect();
        let problem = Problem::from_bodies(3, friction, bodies).unwrap();
        let solved = ladder::solve(&problem, None, &limits);
        assert_honest(&problem, &solved.outcome, &limits);
        assert_eq!(solved.outcome.status, Status::Converged, "seed {seed}");
        // u = H^T v + w with M v = f + H r.
        let bodies = problem.bodies().unwrap();
        let v = bodies.velocities(&solved.outcome.impulses).unwrap();
        let u: Vec<f64> =
            (0..3 * contacts).map(|j| (0..dofs).map(|i| h[i][j] * v[i]).sum()).collect();
        assert_near(&u, &problem.velocities(&solved.outcome.impulses), 1e-10);
        // Friction never adds energy.
        for (r, u) in solved.outcome.impulses.chunks(3).zip(u.chunks(3)) {
            assert!(r[1] * u[1] + r[2] * u[2] <= 1e-9);
        }
    }
}

#[test]
fn bad_numbers_are_refused() {
    let one = || matrix(&[vec![1.0]]);
    let refused = |dimension, friction: &[f64], matrix, q: &[f64]| {
        Problem::new(dimension, friction.to_vec(), matrix, q.to_vec()).unwrap_err()
    };
    assert_eq!(refused(4, &[], one(), &[1.0]), ProblemError::Dimension(4));
    assert_eq!(refused(3, &[0.1], one(), &[1.0]), ProblemError::Size("q", 1, 0));
    assert_eq!(refused(1, &[], one(), &[f64::NAN]), ProblemError::NotFinite("q", 0));
    let two = || matrix(&[vec![1.0, 0.0], vec![0.0, 1.0]]);
    assert_eq!(refused(2, &[-0.5], two(), &[1.0, 1.0]), ProblemError::Friction(0, -0.5));
    assert_eq!(refused(2, &[], two(), &[1.0, 1.0]), ProblemError::Size("mu", 0, 1));
    // An invalid warm start is ignored.
    let problem = lcp([[2.0]], [-1.0]);
    for warm in [vec![f64::NAN], vec![1.0; 3]] {
        let outcome = block_gauss_seidel::solve(&problem, Some(&warm), &Limits::default());
        assert_near(&outcome.impulses, &[0.5], 1e-12);
    }
}

// ---------------------------------------------------------------------------------------------
// Collections
// ---------------------------------------------------------------------------------------------

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn indices(value: &Value) -> Vec<usize> {
    value.as_array().unwrap().iter().map(|x| x.as_u64().unwrap() as usize).collect()
}

fn sparse(value: &Value) -> Matrix {
    let size = |name: &str| value[name].as_u64().unwrap() as usize;
    let (starts, rows) = (indices(&value["colptr"]), indices(&value["rowidx"]));
    let values = numbers(&value["values"]);
    let entries: Vec<_> = (0..size("cols"))
        .flat_map(|j| (starts[j]..starts[j + 1]).map(move |k| (j, k)))
        .map(|(j, k)| (rows[k], j, values[k]))
        .collect();
    from_entries(size("rows"), size("cols"), &entries).unwrap()
}

fn files(folder: &Path) -> BTreeMap<String, Value> {
    let paths: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    let name = |path: &Path| path.file_stem().unwrap().to_string_lossy().into_owned();
    let read = |path: &Path| serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    paths.iter().map(|path| (name(path), read(path))).collect()
}

fn data(folder: &str) -> Option<PathBuf> {
    let Some(root) = std::env::var_os("DRYSTONE_DATA") else {
        eprintln!("skipped: DRYSTONE_DATA is not set");
        return None;
    };
    Some(Path::new(&root).join(folder))
}

/// Returns the result of the ladder and the shortest of three run times. \[ms\]
fn timed(problem: &Problem, limits: &Limits) -> (Solved, f64) {
    let once = || {
        let start = Instant::now();
        let solved = ladder::solve(problem, None, limits);
        (solved, start.elapsed().as_secs_f64() * 1e3)
    };
    let runs = [once(), once(), once()];
    let shortest = runs.iter().fold(f64::INFINITY, |shortest, run| shortest.min(run.1));
    let [first, second, _] = runs;
    // Every run must give the same bits.
    assert_eq!(first.0.outcome.impulses, second.0.outcome.impulses);
    (first.0, shortest)
}

fn line(name: &str, problem: &Problem, solved: &Solved, ms: f64) {
    let Outcome { status, residual, iterations, .. } = solved.outcome;
    let (size, method, status) = (problem.unknowns(), solved.method.name(), status.name());
    println!(
        "{name:42} {size:4} {method:14} {status:10} {residual:9.1e} {iterations:6} {ms:9.2} ms"
    );
}

#[test]
fn collected_complementarity_problems() {
    let Some(root) = data("lcp") else {
        return;
    };
    let limits = Limits { tolerance: 1e-10, ..Limits::default() };
    let (mut solved_count, mut infeasible) = (0, 0);
    for (name, json) in files(&root.join("json")) {
        let rows: Vec<Vec<f64>> = json["M_rows"].as_array().unwrap().iter().map(numbers).collect();
        let q = numbers(&json["q"]);
        let largest = rows.iter().flatten().fold(0.0f64, |largest, m| largest.max(m.abs()));
        let scale = q.iter().fold(1.0f64, |largest, q| largest.max(q.abs()));
        let problem = Problem::complementarity(matrix(&rows), q).unwrap();
        let (solved, ms) = timed(&problem, &limits);
        line(&name, &problem, &solved, ms);
        assert_honest(&problem, &solved.outcome, &limits);
        if json["linear_feasible"] == false {
            assert_eq!(solved.outcome.status, Status::Infeasible, "{name}");
            infeasible += 1;
            continue;
        }
        assert_eq!(solved.outcome.status, Status::Converged, "{name}");
        let z = &solved.outcome.impulses;
        let size = z.iter().fold(0.0f64, |largest, z| largest.max(z.abs()));
        assert!(problem.natural_error(z, 1.0) <= 1e-9 * scale.max(size * largest), "{name}");
        solved_count += 1;
    }
    assert_eq!((solved_count, infeasible), (25, 3));
}

#[test]
fn collected_contacts_without_friction() {
    let Some(root) = data("lcp") else {
        return;
    };
    let limits = Limits { tolerance: 1e-10, ..Limits::default() };
    let mut count = 0;
    for (name, json) in files(&root.join("from_contact")) {
        let problem = Problem::complementarity(sparse(&json["M"]), numbers(&json["q"])).unwrap();
        let (solved, ms) = timed(&problem, &limits);
        line(&name, &problem, &solved, ms);
        assert_honest(&problem, &solved.outcome, &limits);
        assert_eq!(solved.outcome.status, Status::Converged, "{name}");
        let objective = interior_point::objective(&problem, &solved.outcome.impulses);
        let reference = json["reference"]["objective_half_zMz_plus_qz"].as_f64().unwrap();
        let error = (objective - reference).abs();
        assert!(error <= 1e-6 * reference.abs(), "{name}: {objective} is not {reference}");
        count += 1;
    }
    assert_eq!(count, 20);
}

#[test]
fn collected_contacts_with_friction() {
    let Some(root) = data("contact_problems") else {
        return;
    };
    let limits = Limits { tolerance: 1e-9, ..Limits::default() };
    let mut wrong = Vec::new();
    let mut count = 0;
    for (name, json) in files(&root.join("json")) {
        let dimension = json["dim"].as_u64().unwrap() as usize;
        let problem =
            Problem::new(dimension, numbers(&json["mu"]), sparse(&json["W"]), numbers(&json["q"]));
        let problem = problem.unwrap();
        let (solved, ms) = timed(&problem, &limits);
        line(&name, &problem, &solved, ms);
        assert_honest(&problem, &solved.outcome, &limits);
        if problem.natural_map(&solved.outcome.impulses) > 1e-8 {
            wrong.push(name);
        }
        count += 1;
    }
    assert_eq!(count, 21);
    assert!(wrong.is_empty(), "{wrong:?}");
}
