//! Lemke's method: complementary pivoting, which ends at a solution or on an unbounded ray. There
//! is no error that falls on the way.
//!
//! Lemke 1965. Ties are broken lexicographically (Cottle, Pang and Stone 1992, section 4.9), so no
//! basis repeats and the method always ends. A pivot costs 4 n^2. Usually about n pivots are
//! needed, but there are problems of size n that take 2^n - 1 (Murty 1978).
//!
//! It solves every frictionless problem whose matrix is copositive-plus (all contacts among rigid
//! bodies) or a P-matrix, whatever its conditioning and with zeros on the diagonal; up to a few
//! hundred contacts.

use super::dense::Dense;
use super::outcome::{Limits, Outcome, Progress, Status};
use super::{Problem, jam};

/// Largest problem: the tableau has 2 n^2 numbers.
pub const MOST: usize = 2000;
/// Smallest pivot, relative to the largest entry of its column.
const SMALL: f64 = 1e-11;

/// The tableau w - M z - d z_0 = q in the current basis; z_0 is the artificial variable.
struct Tableau {
    n: usize,
    width: usize,
    rows: Vec<f64>,
    /// Variable of each row: w is 0..n, z is n..2n, z_0 is 2n.
    basis: Vec<usize>,
}

enum End {
    Solution,
    Ray(Vec<f64>),
    Budget,
}

/// Pivots to a solution, to a ray, or to the end of the budget.
///
/// A ray of a copositive-plus matrix proves that there is no solution (`Infeasible`); otherwise the
/// status is `Stalled`. Problems with friction or too many contacts are `BadInput`. `warm` is
/// returned if it is a solution, but the pivots do not start from it.
pub fn solve(problem: &Problem, warm: Option<&[f64]>, limits: &Limits) -> Outcome {
    let (mut progress, _) = Progress::new(problem, warm, limits);
    if problem.dimension() != 1 {
        return progress.end(Status::BadInput, "Lemke's method knows no friction");
    }
    if !problem.rows().is_empty() {
        return progress.end(Status::BadInput, "Lemke's method knows no rows of joints");
    }
    if problem.unknowns() > MOST {
        return progress.end(Status::BadInput, "too large for a dense tableau");
    }
    if progress.converged() {
        return progress.end(Status::Converged, "the start is a solution");
    }
    let mut tableau = Tableau::new(problem);
    let end = tableau.run(&mut progress);
    match end {
        End::Solution => {
            progress.record(&tableau.solution());
            if let Some(polished) = polish(problem, &tableau) {
                progress.record(&polished);
            }
            progress.end(Status::Stalled, "the pivots ended beside the solution, by rounding")
        }
        End::Budget => progress.out_of_budget(),
        End::Ray(ray) => {
            progress.record(&tableau.solution());
            match jam::proof(problem, ray) {
                Some(stress) => progress.infeasible(stress),
                None => progress.end(Status::Stalled, "the pivots ended on a ray"),
            }
        }
    }
}

impl Tableau {
    fn new(problem: &Problem) -> Self {
        let n = problem.unknowns();
        let width = 2 * n + 2;
        let mut rows = vec![0.0; n * width];
        for (i, row) in rows.chunks_exact_mut(width.max(1)).enumerate() {
            row[i] = 1.0;
            let matrix = problem.matrix();
            for (j, &m) in matrix.col_idx_of_row(i).zip(matrix.val_of_row(i)) {
                row[n + j] -= m;
            }
            row[2 * n] = -1.0;
            row[2 * n + 1] = problem.offset()[i];
        }
        Self { n, width, rows, basis: (0..n).collect() }
    }

    fn at(&self, row: usize, column: usize) -> f64 {
        self.rows[row * self.width + column]
    }

    fn run(&mut self, progress: &mut Progress<'_>) -> End {
        let n = self.n;
        let (rhs, artificial) = (2 * n + 1, 2 * n);
        if (0..n).all(|i| self.at(i, rhs) >= 0.0) {
            return End::Solution;
        }
        // z_0 enters with the smallest value that satisfies every row.
        let first = (0..n).min_by(|&i, &j| self.lexicographic(i, j, None));
        let Some(mut row) = first else {
            return End::Solution;
        };
        let mut entering = artificial;
        loop {
            if progress.spent() {
                return End::Budget;
            }
            let left = self.basis[row];
            self.pivot(row, entering);
            progress.iterations += 1;
            if n <= 64 || progress.iterations.is_multiple_of(16) {
                progress.record(&self.solution());
            }
            if left == artificial {
                return End::Solution;
            }
            // The complement of the variable that left enters.
            entering = if left < n { left + n } else { left - n };
            match self.leaving(entering) {
                Some(next) => row = next,
                None => return End::Ray(self.ray(entering)),
            }
        }
    }

    /// Returns the row of the ratio test: the first that limits the entering variable. The row of
    /// z_0 is preferred on ties.
    fn leaving(&self, column: usize) -> Option<usize> {
        let n = self.n;
        let largest = (0..n).fold(0.0f64, |largest, i| largest.max(self.at(i, column).abs()));
        let hinders = |&i: &usize| self.at(i, column) > SMALL * largest;
        let least =
            (0..n).filter(hinders).min_by(|&i, &j| self.lexicographic(i, j, Some(column)))?;
        let ratio = |i: usize| self.at(i, 2 * n + 1).max(0.0) / self.at(i, column);
        let artificial = (0..n).find(|&i| self.basis[i] == 2 * n).filter(hinders);
        Some(artificial.filter(|&i| ratio(i) <= ratio(least)).unwrap_or(least))
    }

    /// Compares two rows, each divided by its entry of a column, lexicographically: right-hand side
    /// first, then B^-1.
    fn lexicographic(&self, i: usize, j: usize, column: Option<usize>) -> std::cmp::Ordering {
        let by = |row: usize| column.map_or(1.0, |column| self.at(row, column));
        let (by_i, by_j) = (by(i), by(j));
        let order = |k: usize| (self.at(i, k) / by_i).total_cmp(&(self.at(j, k) / by_j));
        let rest = (0..self.n).map(order).find(|order| order.is_ne());
        order(2 * self.n + 1).then(rest.unwrap_or(std::cmp::Ordering::Equal))
    }

    fn pivot(&mut self, row: usize, column: usize) {
        let (start, width) = (row * self.width, self.width);
        let mut pivot_row = self.rows[start..start + width].to_vec();
        let inverse = 1.0 / pivot_row[column];
        for x in &mut pivot_row {
            *x *= inverse;
        }
        for (i, other) in self.rows.chunks_exact_mut(width).enumerate() {
            if i == row {
                other.copy_from_slice(&pivot_row);
                continue;
            }
            let factor = other[column];
            if factor != 0.0 {
                for (x, y) in other.iter_mut().zip(&pivot_row) {
                    *x -= factor * y;
                }
                other[column] = 0.0;
            }
        }
        self.basis[row] = column;
    }

    /// Returns z, without z_0.
    fn solution(&self) -> Vec<f64> {
        let n = self.n;
        let mut z = vec![0.0; n];
        for (i, &variable) in self.basis.iter().enumerate() {
            if (n..2 * n).contains(&variable) {
                z[variable - n] = self.at(i, 2 * n + 1).max(0.0);
            }
        }
        z
    }

    /// Returns the direction of z as the entering variable grows without bound.
    fn ray(&self, entering: usize) -> Vec<f64> {
        let n = self.n;
        let mut z = vec![0.0; n];
        for (i, &variable) in self.basis.iter().enumerate() {
            if (n..2 * n).contains(&variable) {
                z[variable - n] = -self.at(i, entering);
            }
        }
        if (n..2 * n).contains(&entering) {
            z[entering - n] = 1.0;
        }
        z
    }
}

/// Solves for the last basis with the original matrix, which removes the rounding errors of the
/// pivots.
fn polish(problem: &Problem, tableau: &Tableau) -> Option<Vec<f64>> {
    let n = tableau.n;
    let pushing: Vec<usize> =
        tableau.basis.iter().filter(|v| (n..2 * n).contains(v)).map(|v| v - n).collect();
    solve_pushing(problem, pushing)
}

/// Returns z with M z + q = 0 at the contacts that push, and z = 0 at the others. `None` if M is
/// singular there.
pub(super) fn solve_pushing(problem: &Problem, mut pushing: Vec<usize>) -> Option<Vec<f64>> {
    pushing.sort_unstable();
    let mut place = vec![usize::MAX; problem.unknowns()];
    for (k, &i) in pushing.iter().enumerate() {
        place[i] = k;
    }
    let mut part = Dense::from_fn(pushing.len(), |_, _| 0.0);
    for (k, &i) in pushing.iter().enumerate() {
        let matrix = problem.matrix();
        for (j, &m) in matrix.col_idx_of_row(i).zip(matrix.val_of_row(i)) {
            if place[j] != usize::MAX {
                part.row_mut(k)[place[j]] += m;
            }
        }
    }
    let mut x: Vec<f64> = pushing.iter().map(|&i| -problem.offset()[i]).collect();
    part.factor()?.solve(&mut x);
    let mut z = vec![0.0; problem.unknowns()];
    for (&i, x) in pushing.iter().zip(x) {
        z[i] = x.max(0.0);
    }
    Some(z)
}
