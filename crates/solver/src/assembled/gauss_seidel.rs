//! Gauss-Seidel and projected Gauss-Seidel by the rows of A, as textbooks have them.
//!
//! For soft contacts, give them A + E ([`soften`](super::soften)).

use super::matrices::{Column, Matrix};

/// x_i = (b_i - sum_{j < i} a_ij x_j - sum_{j > i} a_ij x_j) / a_ii, written as a change of x_i:
/// equation i solved for unknown i, the others taken as known. A row with nothing on its diagonal,
/// a contact where nothing can move, keeps its x_i.
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

/// One sweep for A x = b: every row once, in order, each with the newest of the others.
pub fn sweep(a: &Matrix, b: &Column, x: &mut Column) {
    for i in 0..b.nrows() {
        x[i] = solve_row(a, b, x, i);
    }
}

/// One projected sweep for 0 <= gamma, A gamma - b >= 0, one of the two zero in each row: what a
/// row gives is brought back to the nearest value that a contact can have, max(0, gamma_i).
pub fn projected_sweep(a: &Matrix, b: &Column, gamma: &mut Column) {
    for i in 0..b.nrows() {
        gamma[i] = solve_row(a, b, gamma, i).max(0.0);
    }
}

/// gamma after this many projected sweeps from zero. \[N s\]
pub fn solve(a: &Matrix, b: &Column, sweeps: usize) -> Column {
    let mut gamma = Column::zeros(b.nrows());
    for _ in 0..sweeps {
        projected_sweep(a, b, &mut gamma);
    }
    gamma
}

/// w = A gamma - b: how much faster than its target each contact separates. \[m/s\]
pub fn residual(a: &Matrix, b: &Column, gamma: &Column) -> Column {
    a * gamma - b
}

/// The largest |min(A_ii gamma_i, w_i)|: how far gamma is from complementarity, zero exactly at a
/// solution. What [`System::residual`](crate::System::residual) measures along the normals. \[m/s\]
pub fn complementarity(a: &Matrix, b: &Column, gamma: &Column) -> f64 {
    let w = residual(a, b, gamma);
    let error = |i: usize| {
        let a_ii = a.get(i, i).copied().unwrap_or(0.0);
        if a_ii > 0.0 { (a_ii * gamma[i]).min(w[i]).abs() } else { 0.0 }
    };
    (0..b.nrows()).map(error).fold(0.0, f64::max)
}
