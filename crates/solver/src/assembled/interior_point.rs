//! Interior-point method, by the crate clarabel (Goulart and Chen 2024): the reference for problems
//! with a unique optimum.
//!
//! It minimizes 1/2 r^T W r + q^T r over the cones and bounds, for symmetric positive semidefinite W. Without
//! friction that is the complementarity problem. With friction it is the convex cone model
//! (Anitescu and Tasora 2010), in which a sliding contact also separates at mu |u_t|. Where
//! contacts slide it differs from Coulomb's law, but its optimal objective is unique and can be
//! compared. It takes 10 to 40 iterations, each with a sparse factorization.
//!
//! A row of a joint with two targets that differ is split in two: its positive part acts towards
//! t-, its negative part towards t+.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SecondOrderConeT, SupportedConeT,
    ZeroConeT,
};

use super::outcome::{Limits, Outcome, Progress, Status};
use super::problem::{largest, norm};
use super::{Problem, jam};
use crate::law::{self, Interval};

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
    let parts = parts(problem);
    let Constraints { matrix, limits: rhs, cones } = constraints(problem, &parts);
    let cost: Vec<f64> =
        parts.iter().map(|part| problem.offset()[part.unknown] - part.target).collect();
    let settings = DefaultSettings {
        verbose: false,
        max_iter: u32::try_from(limits.budget.min(200)).unwrap_or(200),
        tol_gap_abs: 1e-14,
        tol_gap_rel: 1e-12,
        tol_feas: 1e-12,
        ..DefaultSettings::default()
    };
    let solver =
        DefaultSolver::new(&upper(problem, &parts), &cost, &matrix, &rhs, &cones, settings);
    let Ok(mut solver) = solver else {
        return progress.end(Status::BadInput, "the interior-point method refused the problem");
    };
    solver.solve();
    progress.iterations = solver.solution.iterations as usize;
    let mut r = vec![0.0; n];
    for (part, x) in parts.iter().zip(&solver.solution.x) {
        r[part.unknown] += x;
    }
    if let Some(stress) = jam::proof(problem, r.clone()) {
        return progress.infeasible(stress);
    }
    problem.project(&mut r);
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

/// Returns 1/2 r^T W r + q^T r, less r t- or r t+ for rows of joints. \[J\]
pub fn objective(problem: &Problem, r: &[f64]) -> f64 {
    let u = problem.velocities(r);
    let cost: f64 =
        r.iter().zip(u.iter().zip(problem.offset())).map(|(r, (u, q))| 0.5 * r * (u + q)).sum();
    let gain = |(&r, law): (&f64, &Interval<f64>)| match r {
        r if r > 0.0 => r * law.targets[0],
        r if r < 0.0 => r * law.targets[1],
        _ => 0.0,
    };
    cost - problem.split_rows(r).1.iter().zip(problem.rows()).map(gain).sum::<f64>()
}

/// Returns |r - P_K(r - u)| / |q|: zero exactly at the optimum of the convex cone model.
pub fn convex_residual(problem: &Problem, r: &[f64]) -> f64 {
    let d = problem.dimension();
    let mut y = problem.velocities(r);
    let (r, r_rows) = problem.split_rows(r);
    let (contacts, rows) = y.split_at_mut(r.len());
    for ((y, &r), law) in rows.iter_mut().zip(r_rows).zip(problem.rows()) {
        *y = r - law.visit(1.0, *y, r);
    }
    for ((y, r), &mu) in contacts.chunks_exact_mut(d).zip(r.chunks_exact(d)).zip(problem.friction())
    {
        (0..d).for_each(|k| y[k] = r[k] - y[k]);
        law::project(y, mu);
        (0..d).for_each(|k| y[k] = r[k] - y[k]);
    }
    let size = norm(problem.offset());
    let error = if size > 0.0 { norm(&y) / size } else { norm(&y) };
    if error.is_finite() { error } else { f64::INFINITY }
}

/// A variable of the method: an unknown of a contact, or a row of a joint as far as it acts towards
/// one target.
struct Part {
    unknown: usize,
    /// Velocity towards which it acts. \[m/s, rad/s\]
    target: f64,
    bounds: [f64; 2],
}

/// Returns the variables: one for each unknown of a contact, then those of rows of joints.
fn parts(problem: &Problem) -> Vec<Part> {
    let first = problem.unknowns() - problem.rows().len();
    let free = |unknown| Part { unknown, target: 0.0, bounds: [f64::NEG_INFINITY, f64::INFINITY] };
    let mut parts: Vec<Part> = (0..first).map(free).collect();
    for (unknown, law) in (first..).zip(problem.rows()) {
        let ([low, high], [lo, hi]) = (law.targets, law.bounds);
        if low == high {
            parts.push(Part { unknown, target: low, bounds: [lo, hi] });
            continue;
        }
        for (target, bounds) in [(low, [0.0, hi]), (high, [lo, 0.0])] {
            if target.is_finite() {
                parts.push(Part { unknown, target, bounds });
            }
        }
    }
    parts
}

/// Returns the upper triangle of (W + W^T) / 2, for these variables.
fn upper(problem: &Problem, parts: &[Part]) -> CscMatrix<f64> {
    let mut of_unknown = vec![Vec::new(); problem.unknowns()];
    for (index, part) in parts.iter().enumerate() {
        of_unknown[part.unknown].push(index);
    }
    let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
    for (i, part) in parts.iter().enumerate() {
        let (matrix, row) = (problem.matrix(), part.unknown);
        for (column, &w) in matrix.col_idx_of_row(row).zip(matrix.val_of_row(row)) {
            for &j in &of_unknown[column] {
                rows.push(i.min(j));
                columns.push(i.max(j));
                values.push(if i == j { w } else { 0.5 * w });
            }
        }
    }
    CscMatrix::new_from_triplets(parts.len(), parts.len(), rows, columns, values)
}

/// Constraints s = limits - A x in cones.
struct Constraints {
    matrix: CscMatrix<f64>,
    limits: Vec<f64>,
    cones: Vec<SupportedConeT<f64>>,
}

/// Returns the constraints: (mu r_n, r_t) in a cone where there is friction, else r_n >= 0 and
/// r_t = 0; then the finite bounds of rows of joints.
fn constraints(problem: &Problem, parts: &[Part]) -> Constraints {
    let (n, d) = (problem.dimension() * problem.contacts(), problem.dimension());
    let mut entries: Vec<(usize, f64)> = (0..n).map(|i| (i, -1.0)).collect();
    let mut limits = vec![0.0; n];
    let mut cones = Vec::new();
    for (i, &mu) in problem.friction().iter().enumerate() {
        if d == 1 {
            continue;
        } else if mu > 0.0 {
            entries[d * i].1 = -mu;
            cones.push(SecondOrderConeT(d));
        } else {
            cones.extend([NonnegativeConeT(1), ZeroConeT(d - 1)]);
        }
    }
    if d == 1 && n > 0 {
        cones.push(NonnegativeConeT(n));
    }
    for (index, Part { bounds: [lo, hi], .. }) in parts.iter().enumerate().skip(n) {
        if lo == hi {
            entries.push((index, -1.0));
            limits.push(-lo);
            cones.push(ZeroConeT(1));
            continue;
        }
        for (sign, limit) in [(-1.0, -lo), (1.0, *hi)] {
            if limit.is_finite() {
                entries.push((index, sign));
                limits.push(limit);
                cones.push(NonnegativeConeT(1));
            }
        }
    }
    let rows = (0..entries.len()).collect();
    let (columns, values) = entries.into_iter().unzip();
    let matrix = CscMatrix::new_from_triplets(limits.len(), parts.len(), rows, columns, values);
    Constraints { matrix, limits, cones }
}
