//! Infeasible problems: the proof, and a search for it.
//!
//! For contacts without friction, let y >= 0 with W^T y <= 0. Then y . u = (W^T y) . r + y . q <=
//! y . q for all r >= 0, while u >= 0 requires y . u >= 0. So if y . q < 0 no impulses stop all
//! approaching contacts: the problem is infeasible. By Farkas' lemma such a y exists for every
//! infeasible problem.
//!
//! For symmetric positive semidefinite W it follows that W y = 0. Then y is a self-stress: impulses
//! that balance each other, as in a body wedged between two converging walls.

use super::Problem;
use super::problem::largest;

/// Proof that no impulses solve a frictionless problem: y >= 0 with W^T y <= 0 and y . q < 0.
#[derive(Clone, Debug, PartialEq)]
pub struct SelfStress {
    /// y, scaled to a maximum of 1. The contacts with y > 0 jam. \[1\]
    pub weights: Vec<f64>,
    /// -y . q: weighted approach velocity of the jammed contacts. \[m/s\]
    pub approach: f64,
    /// Lower bound on the sum of impulses that would solve the problem: infinite if W^T y <= 0
    /// exactly, else approach / max (W^T y). \[N s\]
    pub least_sum: f64,
}

/// Largest (W^T y)_j, relative to sum_i |W_ij| y_i, that counts as rounding. \[1\]
const ROUNDING: f64 = 1e-10;

/// Scales y and returns it as a proof, if it is one up to rounding. `None` with rows of joints.
pub fn proof(problem: &Problem, mut y: Vec<f64>) -> Option<SelfStress> {
    if problem.dimension() != 1 || !problem.rows().is_empty() || y.iter().any(|y| !y.is_finite()) {
        return None;
    }
    // Entries that are tiny relative to the largest are rounding errors.
    let size = y.iter().fold(0.0f64, |largest, &y| largest.max(y));
    if size <= 0.0 {
        return None;
    }
    for y in &mut y {
        *y = if *y > 1e-12 * size { *y / size } else { 0.0 };
    }
    let matrix = problem.matrix();
    let (mut response, mut sizes) = (vec![0.0; y.len()], vec![0.0; y.len()]);
    for (i, &y) in y.iter().enumerate().filter(|(_, y)| **y > 0.0) {
        for (j, &w) in matrix.col_idx_of_row(i).zip(matrix.val_of_row(i)) {
            response[j] += w * y;
            sizes[j] += (w * y).abs();
        }
    }
    let terms = || y.iter().zip(problem.offset()).map(|(y, q)| y * q);
    let approach = -terms().sum::<f64>();
    let balanced = response.iter().zip(&sizes).all(|(w_y, size)| *w_y <= ROUNDING * size);
    let together = approach > ROUNDING * terms().map(f64::abs).sum::<f64>();
    let left = response.into_iter().fold(0.0, f64::max);
    let least_sum = if left > 0.0 { approach / left } else { f64::INFINITY };
    (balanced && together).then_some(SelfStress { weights: y, approach, least_sum })
}

/// Searches for a proof by linear programming: maximizes -y . q subject to W^T y <= 0, sum y <= 1,
/// y >= 0. Uses the simplex method with Bland's rule (1977), which always ends. It starts at y = 0,
/// so there is no first phase. `None` if the problem is feasible, or after `pivots`.
///
/// A pivot costs 2 n^2.
pub fn find(problem: &Problem, pivots: usize) -> Option<SelfStress> {
    let n = problem.unknowns();
    if problem.dimension() != 1 || !problem.rows().is_empty() || n == 0 {
        return None;
    }
    // Tableau in the nonbasic variables: the rows W^T y, the sum, then the objective.
    let width = n + 1;
    let mut rows = vec![0.0; (n + 2) * width];
    let scale = largest(problem.matrix().val()).max(f64::MIN_POSITIVE);
    for i in 0..n {
        let matrix = problem.matrix();
        for (j, &w) in matrix.col_idx_of_row(i).zip(matrix.val_of_row(i)) {
            rows[j * width + i] += w / scale;
        }
        rows[n * width + i] = 1.0;
    }
    rows[n * width + n] = 1.0;
    let q_scale = largest(problem.offset()).max(f64::MIN_POSITIVE);
    for (objective, q) in rows[(n + 1) * width..].iter_mut().zip(problem.offset()) {
        *objective = -q / q_scale;
    }
    // Variables: y are 0..n, slacks n..2n+1.
    let mut zero: Vec<usize> = (0..n).collect();
    let mut basic: Vec<usize> = (n..2 * n + 1).collect();
    let small = 1e-11;
    for _ in 0..pivots {
        let objective = &rows[(n + 1) * width..];
        let entering = (0..n).filter(|&j| objective[j] > small).min_by_key(|&j| zero[j]);
        let Some(column) = entering else {
            break;
        };
        let ratio = |i: usize| rows[i * width + n].max(0.0) / rows[i * width + column];
        let leaving = (0..=n)
            .filter(|&i| rows[i * width + column] > small)
            .min_by(|&i, &j| ratio(i).total_cmp(&ratio(j)).then(basic[i].cmp(&basic[j])));
        let pivot_row = leaving?;
        pivot(&mut rows, width, pivot_row, column);
        std::mem::swap(&mut basic[pivot_row], &mut zero[column]);
    }
    let mut y = vec![0.0; n];
    for (i, &variable) in basic.iter().enumerate() {
        if variable < n {
            y[variable] = rows[i * width + n];
        }
    }
    proof(problem, y)
}

/// Exchanges the basic variable of a row with the nonbasic one of a column.
fn pivot(rows: &mut [f64], width: usize, pivot_row: usize, column: usize) {
    let mut row: Vec<f64> = rows[pivot_row * width..(pivot_row + 1) * width].to_vec();
    let inverse = 1.0 / row[column];
    row[column] = 1.0;
    for x in &mut row {
        *x *= inverse;
    }
    for (i, other) in rows.chunks_exact_mut(width).enumerate() {
        if i == pivot_row {
            other.copy_from_slice(&row);
        } else if other[column] != 0.0 {
            let factor = std::mem::take(&mut other[column]);
            for (x, y) in other.iter_mut().zip(&row) {
                *x -= factor * y;
            }
        }
    }
}
