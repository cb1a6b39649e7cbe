//! Equation (2), A gamma = b, without a condition on the signs.
//!
//! Its solution describes contacts that could pull. It is the answer for systems in which every
//! contact ends up pushing; otherwise it is the starting point of the complementarity problem.
//!
//! A is only positive semidefinite. Redundant contacts make it singular, and there are some
//! whenever there are more contacts than velocities. If b is in the range of A, as with one
//! restitution for all contacts and no overlap repair, many impulses solve the equation. All have
//! the same J^T gamma and so the same velocities. If b is not in the range, none do.

use super::matrices::{Column, Matrix};

/// Result of [`solve`].
#[derive(Clone, Debug)]
pub struct Equality {
    /// Impulses of least norm among those with the smallest error. \[N s\]
    pub impulses: Column,
    /// Rank of A: k if the impulses are unique, less if A is singular.
    pub rank: usize,
    /// Norm of A gamma - b: zero up to rounding if the equation has a solution. \[m/s\]
    pub error: f64,
}

impl Equality {
    /// Returns true if A is singular, so that the impulses are one of many solutions, or none.
    pub fn is_singular(&self) -> bool {
        self.rank < self.impulses.nrows()
    }
}

/// Solves A gamma = b by least squares, with the singular values of A as a dense matrix. Values up
/// to k times the rounding of the largest count as zero.
///
/// Returns `None` if A has entries that are not finite.
pub fn solve(a: &Matrix, b: &Column) -> Option<Equality> {
    let k = b.nrows();
    let svd = a.to_dense().svd().ok()?;
    let values = svd.S().column_vector();
    let largest = (0..k).map(|i| values[i]).fold(0.0, f64::max);
    let smallest = largest * f64::EPSILON * k as f64;
    let mut along = svd.U().transpose() * b;
    let mut rank = 0;
    for i in 0..k {
        if values[i] > smallest {
            along[i] /= values[i];
            rank += 1;
        } else {
            along[i] = 0.0;
        }
    }
    let impulses = svd.V() * along;
    let error = (a * &impulses - b).norm_l2();
    Some(Equality { impulses, rank, error })
}
