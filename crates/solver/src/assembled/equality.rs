//! Equation (2) as it stands, A gamma = b with no condition on the signs.
//!
//! This is what contacts would do if they could pull. It answers for systems in which every
//! contact ends up pushing; otherwise it is where the complementarity problem starts from.
//!
//! A is only positive semidefinite: redundant contacts (always with more contacts than velocities)
//! make it singular. If b is in its range, as with one restitution for all contacts and no overlap
//! repair, impulses exist, many of them, all with the same J^T gamma and so the same velocities.
//! If b is not, there are none.

use super::matrices::{Column, Matrix};

/// What [`solve`] found.
#[derive(Clone, Debug)]
pub struct Equality {
    /// The impulses of least length among those with the least error. \[N s\]
    pub impulses: Column,
    /// The rank of A: k if the impulses are the only ones, less if A is singular.
    pub rank: usize,
    /// The length of A gamma - b: zero but for rounding if the equation has a solution. \[m/s\]
    pub error: f64,
}

impl Equality {
    /// Whether A is singular, so that the impulses are one answer of many, or no answer at all.
    pub fn is_singular(&self) -> bool {
        self.rank < self.impulses.nrows()
    }
}

/// Solves A gamma = b by least squares, from the singular values of A taken as a dense matrix.
/// Those below k times the rounding of the largest count as zero.
///
/// `None` if A has entries that are not finite.
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
