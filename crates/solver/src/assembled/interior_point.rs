//! Interior-point method, by the crate clarabel (Goulart and Chen 2024): the reference for problems
//! with a unique optimum.
//!
//! It minimizes 1/2 r^T W r + q^T r over the cones, for symmetric positive semidefinite W. Without
//! friction that is the complementarity problem. With friction it is the convex cone model
//! (Anitescu and Tasora 2010), in which a sliding contact also separates at mu |u_t|. Where
//! contacts slide it differs from Coulomb's law, but its optimal objective is unique and can be
//! compared. It takes 10 to 40 iterations, each with a sparse factorization.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SecondOrderConeT, SupportedConeT,
    ZeroConeT,
};

use super::outcome::{Limits, Outcome, Progress, Status};
use super::problem::{largest, norm};
use super::{Problem, jam};
use crate::law;

/// Computes the optimum of the convex model, projected onto the cones. The status is `Converged`
/// only if it solves the [`Problem`] itself; with friction that happens if nothing slides. Uses the
/// symmetric part of W; a W far from symmetric is `BadInput`. `warm` has no effect on the
/// iterations.
pub fn solve(problem: &Problem, warm: Option<&[f64]>, limits: &Limits) -> Outcome {
    let (mut progress, _) = Progress::new(problem, warm, limits);
    let size = largest(problem.matrix().val());
    if problem.asymmetry() > 0.1 * size {
        return progress
            .end(Status::BadInput, "the interior-point method needs a symmetric matrix");
    }
    let n = problem.unknowns();
    if n == 0 {
        return progress.end(Status::Converged, "there is nothing to solve");
    }
    let (constraints, cones) = constraints(problem);
    let settings = DefaultSettings {
        verbose: false,
        max_iter: u32::try_from(limits.budget.min(200)).unwrap_or(200),
        tol_gap_abs: 1e-14,
        tol_gap_rel: 1e-12,
        tol_feas: 1e-12,
        ..DefaultSettings::default()
    };
    let solver = DefaultSolver::new(
        &upper(problem),
        problem.offset(),
        &constraints,
        &vec![0.0; constraints.m],
        &cones,
        settings,
    );
    let Ok(mut solver) = solver else {
        return progress.end(Status::BadInput, "the interior-point method refused the problem");
    };
    solver.solve();
    progress.iterations = solver.solution.iterations as usize;
    let mut r = solver.solution.x.clone();
    if let Some(stress) = jam::proof(problem, r.clone()) {
        return progress.infeasible(stress);
    }
    for (r, &mu) in r.chunks_exact_mut(problem.dimension()).zip(problem.friction()) {
        law::project(r, mu);
    }
    if r.iter().all(|r| r.is_finite()) {
        progress.record(&r);
    }
    let sliding = problem.dimension() > 1 && convex_residual(problem, &r) < progress.residual();
    let reason = if sliding {
        "the optimum of the convex cone model, in which sliding contacts lift"
    } else {
        "no optimum of this accuracy"
    };
    progress.end(Status::Stalled, reason)
}

/// Returns 1/2 r^T W r + q^T r. \[J\]
pub fn objective(problem: &Problem, r: &[f64]) -> f64 {
    let u = problem.velocities(r);
    r.iter().zip(u.iter().zip(problem.offset())).map(|(r, (u, q))| 0.5 * r * (u + q)).sum()
}

/// Returns |r - P_K(r - u)| / |q|: zero exactly at the optimum of the convex cone model.
pub fn convex_residual(problem: &Problem, r: &[f64]) -> f64 {
    let d = problem.dimension();
    let mut y = problem.velocities(r);
    for ((y, r), &mu) in y.chunks_exact_mut(d).zip(r.chunks_exact(d)).zip(problem.friction()) {
        (0..d).for_each(|k| y[k] = r[k] - y[k]);
        law::project(y, mu);
        (0..d).for_each(|k| y[k] = r[k] - y[k]);
    }
    let size = norm(problem.offset());
    let error = if size > 0.0 { norm(&y) / size } else { norm(&y) };
    if error.is_finite() { error } else { f64::INFINITY }
}

/// Returns the upper triangle of (W + W^T) / 2.
fn upper(problem: &Problem) -> CscMatrix<f64> {
    let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..problem.unknowns() {
        let matrix = problem.matrix();
        for (j, &w) in matrix.col_idx_of_row(i).zip(matrix.val_of_row(i)) {
            rows.push(i.min(j));
            columns.push(i.max(j));
            values.push(if i == j { w } else { 0.5 * w });
        }
    }
    CscMatrix::new_from_triplets(problem.unknowns(), problem.unknowns(), rows, columns, values)
}

/// Returns the constraints s = -A r in cones: (mu r_n, r_t) where there is friction, else r_n >= 0
/// and r_t = 0.
fn constraints(problem: &Problem) -> (CscMatrix<f64>, Vec<SupportedConeT<f64>>) {
    let (n, d) = (problem.unknowns(), problem.dimension());
    let mut values = vec![-1.0; n];
    let mut cones = Vec::new();
    for (i, &mu) in problem.friction().iter().enumerate() {
        if d == 1 {
            continue;
        } else if mu > 0.0 {
            values[d * i] = -mu;
            cones.push(SecondOrderConeT(d));
        } else {
            cones.extend([NonnegativeConeT(1), ZeroConeT(d - 1)]);
        }
    }
    if d == 1 {
        cones.push(NonnegativeConeT(n));
    }
    (CscMatrix::new(n, n, (0..=n).collect(), (0..n).collect(), values), cones)
}
