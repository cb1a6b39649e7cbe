//! Gauss-Seidel and projected Gauss-Seidel on the rows of A, in textbook form.
//!
//! For soft contacts use A + E ([`soften`](super::soften)).

use super::matrices::{Column, Matrix};

/// Solves equation i for unknown i, the others fixed, written as a change of x_i:
///
/// x_i = (b_i - sum_{j < i} a_ij x_j - sum_{j > i} a_ij x_j) / a_ii.
///
/// A row without a diagonal entry, a contact where nothing can move, keeps its x_i.
pub fn solve_row(a: &Matrix, b: &Column, x: &Column, i: usize) -> f64 {
    let (mut a_ii, mut a_x) = (0.0, 0.0);
    for (j, &a_ij) in a.col_idx_of_row(i).zip(a.val_of_row(i)) {
        a_x += a_ij * x[j];
        if j == i {
            a_ii += a_ij;
        }
    }
    if a_ii > 0.0 { x[i] + (b[i] - a_x) / a_ii } else { x[i] }
}

/// Runs one sweep for A x = b: every row once, in order, each with the newest values of the others.
pub fn sweep(a: &Matrix, b: &Column, x: &mut Column) {
    for i in 0..b.nrows() {
        x[i] = solve_row(a, b, x, i);
    }
}

/// Runs one projected sweep for 0 <= gamma ⊥ A gamma - b >= 0. The result of each row is
/// projected to the nearest valid value, max(0, gamma_i).
pub fn projected_sweep(a: &Matrix, b: &Column, gamma: &mut Column) {
    for i in 0..b.nrows() {
        gamma[i] = solve_row(a, b, gamma, i).max(0.0);
    }
}

/// Returns gamma after this many projected sweeps from zero. \[N s\]
pub fn solve(a: &Matrix, b: &Column, sweeps: usize) -> Column {
    let mut gamma = Column::zeros(b.nrows());
    for _ in 0..sweeps {
        projected_sweep(a, b, &mut gamma);
    }
    gamma
}

/// Returns w = A gamma - b: the separation velocity of each contact beyond its target. \[m/s\]
pub fn residual(a: &Matrix, b: &Column, gamma: &Column) -> Column {
    a * gamma - b
}

/// Returns the largest |min(A_ii gamma_i, w_i)|, which is zero exactly at a solution. It equals the
/// normal part of [`System::residual`](crate::System::residual). \[m/s\]
pub fn complementarity(a: &Matrix, b: &Column, gamma: &Column) -> f64 {
    let w = residual(a, b, gamma);
    let error = |i: usize| {
        let a_ii = a.get(i, i).copied().unwrap_or(0.0);
        if a_ii > 0.0 { (a_ii * gamma[i]).min(w[i]).abs() } else { 0.0 }
    };
    (0..b.nrows()).map(error).fold(0.0, f64::max)
}
