//! [`Problem`]: contacts and rows of joints given as a matrix, u = W r + q.

use std::fmt;
use std::ops::Range;

use faer::sparse::Triplet;

use super::dense::Dense;
use super::matrices::Matrix;
use crate::Vector;
use crate::law::{self, Interval, Law};

/// A contact problem in matrix form: find impulses r with
///
/// u = W r + q and, at each contact, K ∋ r ⊥ u + mu |u_t| n ∈ K*,
///
/// where K is the cone |r_t| <= mu r_n: Signorini's condition and Coulomb's law (de Saxce and Feng
/// 1998).
///
/// Contact i holds `dimension` consecutive rows: the normal first, then the tangents. With one row
/// each this is the linear complementarity problem 0 <= r ⊥ W r + q >= 0. W need not be
/// symmetric: gyroscopic terms and matrix games make it unsymmetric.
///
/// Rows of joints may follow the contacts, each with the law of an [`Interval`]: for any s > 0
///
/// r = clamp(max(0, r - s (u - t-)) + min(0, r - s (u - t+)), lo, hi).
///
/// With t- = t+ = 0 this is box complementarity: u >= 0 where r = lo, u <= 0 where r = hi, and
/// u = 0 between them.
#[derive(Clone, Debug)]
pub struct Problem {
    dimension: usize,
    friction: Vec<f64>,
    matrix: Matrix,
    offset: Vec<f64>,
    rows: Vec<Interval<f64>>,
    bodies: Option<Bodies>,
}

/// The bodies of a [`Problem`]: M v = f + H r and u = H^T v + w.
#[derive(Clone, Debug)]
pub struct Bodies {
    /// M, one diagonal block per body. \[kg, kg m^2\]
    pub mass: Matrix,
    /// H, which maps impulses to momenta; its transpose maps velocities to the contacts.
    pub directions: Matrix,
    /// f: the momentum of the bodies without contacts. \[N s, N m s\]
    pub momentum: Vec<f64>,
    /// w: the part of the contact velocities that does not depend on the bodies. \[m/s\]
    pub given: Vec<f64>,
}

/// Reason why input is not a valid [`Problem`].
#[derive(Clone, Debug, PartialEq)]
pub enum ProblemError {
    /// The number of rows per contact is not 1, 2 or 3.
    Dimension(usize),
    /// Wrong size: the name, the size, and the required size.
    Size(&'static str, usize, usize),
    /// An entry is not finite: the name and the index.
    NotFinite(&'static str, usize),
    /// The friction of a contact is negative.
    Friction(usize, f64),
    /// A row and column outside the matrix.
    Outside(usize, usize),
    /// A block of the mass matrix is singular: its first row.
    Mass(usize),
    /// The targets or the bounds of a row of a joint are not in order: its index.
    Law(usize),
}

impl fmt::Display for ProblemError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Dimension(d) => write!(f, "dimension is {d}; accepted: 1, 2, 3"),
            Self::Size(what, is, accepted) => {
                write!(f, "{what} has {is} entries; accepted: {accepted}")
            }
            Self::NotFinite(what, i) => write!(f, "{what}: entry {i} is no finite number"),
            Self::Friction(i, mu) => {
                write!(f, "the friction of contact {i} is {mu}; accepted: 0 or more")
            }
            Self::Outside(i, j) => write!(f, "the matrix has no entry ({i}, {j})"),
            Self::Law(i) => {
                write!(f, "the law of row {i}; accepted: t- <= t+, lo <= 0 and hi >= 0")
            }
            Self::Mass(row) => write!(f, "the mass matrix is singular in the block at row {row}"),
        }
    }
}

impl std::error::Error for ProblemError {}

pub(super) fn same(what: &'static str, is: usize, accepted: usize) -> Result<(), ProblemError> {
    if is == accepted { Ok(()) } else { Err(ProblemError::Size(what, is, accepted)) }
}

fn finite(what: &'static str, values: &[f64]) -> Result<(), ProblemError> {
    match values.iter().position(|x| !x.is_finite()) {
        Some(i) => Err(ProblemError::NotFinite(what, i)),
        None => Ok(()),
    }
}

/// Builds a matrix from (row, column, value); values at the same row and column add up.
///
/// # Errors
/// An entry is outside the matrix.
pub fn from_entries(
    rows: usize,
    columns: usize,
    entries: &[(usize, usize, f64)],
) -> Result<Matrix, ProblemError> {
    if let Some(&(i, j, _)) = entries.iter().find(|(i, j, _)| *i >= rows || *j >= columns) {
        return Err(ProblemError::Outside(i, j));
    }
    let triplets: Vec<_> = entries.iter().map(|&(i, j, x)| Triplet::new(i, j, x)).collect();
    let matrix = Matrix::try_new_from_triplets(rows, columns, &triplets);
    matrix.map_err(|_| ProblemError::Size("a matrix", entries.len(), usize::MAX))
}

/// Returns A^T.
pub(super) fn transposed(a: &Matrix) -> Result<Matrix, ProblemError> {
    let too_large = |_| ProblemError::Size("a matrix", a.nrows(), usize::MAX);
    a.transpose().to_row_major().map_err(too_large)
}

/// Returns A x.
pub(super) fn product(a: &Matrix, x: &[f64]) -> Vec<f64> {
    let row = |i| a.col_idx_of_row(i).zip(a.val_of_row(i)).map(|(j, a_ij)| a_ij * x[j]).sum();
    (0..a.nrows()).map(row).collect()
}

/// Returns A^T y.
pub(super) fn transposed_product(a: &Matrix, y: &[f64]) -> Vec<f64> {
    let mut x = vec![0.0; a.ncols()];
    for (i, &y_i) in y.iter().enumerate() {
        for (j, &a_ij) in a.col_idx_of_row(i).zip(a.val_of_row(i)) {
            x[j] += a_ij * y_i;
        }
    }
    x
}

pub(super) fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

pub(super) fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |largest, x| largest.max(x.abs()))
}

/// Replaces NaN by infinity.
fn or_infinite(residual: f64) -> f64 {
    if residual.is_finite() { residual } else { f64::INFINITY }
}

impl Problem {
    /// Creates a problem from contacts of `dimension` rows each, W and q. `friction` holds mu of
    /// each contact; with one row per contact it is not used and may be empty.
    ///
    /// # Errors
    /// Sizes do not fit, a number is not finite, or a friction is negative.
    pub fn new(
        dimension: usize,
        friction: Vec<f64>,
        matrix: Matrix,
        offset: Vec<f64>,
    ) -> Result<Self, ProblemError> {
        Self::with_rows((dimension, friction), Vec::new(), matrix, offset)
    }

    /// Creates a problem from contacts, given by their dimension and frictions as in
    /// [`Problem::new`], and rows of joints, given by their laws. W includes the compliance of the
    /// laws, and targets are measured from u = 0.
    ///
    /// # Errors
    /// Those of [`Problem::new`], or a law is not in order.
    pub fn with_rows(
        (dimension, friction): (usize, Vec<f64>),
        rows: Vec<Interval<f64>>,
        matrix: Matrix,
        offset: Vec<f64>,
    ) -> Result<Self, ProblemError> {
        if !(1..=3).contains(&dimension) {
            return Err(ProblemError::Dimension(dimension));
        }
        let contacts = offset.len().saturating_sub(rows.len()) / dimension;
        same("q", offset.len(), contacts * dimension + rows.len())?;
        same("W", matrix.nrows(), offset.len())?;
        same("a row of W", matrix.ncols(), offset.len())?;
        let friction = if dimension == 1 { vec![0.0; contacts] } else { friction };
        same("mu", friction.len(), contacts)?;
        finite("W", matrix.val())?;
        finite("q", &offset)?;
        finite("mu", &friction)?;
        if let Some(i) = friction.iter().position(|&mu| mu < 0.0) {
            return Err(ProblemError::Friction(i, friction[i]));
        }
        let in_order = |Interval { targets: [low, high], bounds: [lo, hi], .. }: &Interval<f64>| {
            low <= high && *lo <= 0.0 && *hi >= 0.0
        };
        if let Some(i) = rows.iter().position(|law| !in_order(law)) {
            return Err(ProblemError::Law(i));
        }
        let rows = rows.into_iter().map(|law| Interval { compliance: 0.0, ..law }).collect();
        Ok(Self { dimension, friction, matrix, offset, rows, bodies: None })
    }

    /// Creates the linear complementarity problem 0 <= z ⊥ M z + q >= 0.
    ///
    /// # Errors
    /// Those of [`Problem::new`].
    pub fn complementarity(matrix: Matrix, offset: Vec<f64>) -> Result<Self, ProblemError> {
        Self::new(1, Vec::new(), matrix, offset)
    }

    /// Creates the problem of these bodies: W = H^T M^-1 H and q = H^T M^-1 f + w. The cost
    /// includes the inverse of each block of M.
    ///
    /// # Errors
    /// Those of [`Problem::new`], or a block of M is singular.
    pub fn from_bodies(
        dimension: usize,
        friction: Vec<f64>,
        bodies: Bodies,
    ) -> Result<Self, ProblemError> {
        let (n, rows) = (bodies.mass.nrows(), bodies.given.len());
        same("a row of M", bodies.mass.ncols(), n)?;
        same("H", bodies.directions.nrows(), n)?;
        same("a row of H", bodies.directions.ncols(), rows)?;
        same("f", bodies.momentum.len(), n)?;
        finite("M", bodies.mass.val())?;
        finite("H", bodies.directions.val())?;
        finite("f", &bodies.momentum)?;
        finite("w", &bodies.given)?;
        let inverse = inverse_of_blocks(&bodies.mass)?;
        let transposed = transposed(&bodies.directions)?;
        let matrix = &transposed * (&inverse * &bodies.directions);
        let moved = product(&transposed, &product(&inverse, &bodies.momentum));
        let offset = moved.iter().zip(&bodies.given).map(|(u, w)| u + w).collect();
        let problem = Self::new(dimension, friction, matrix, offset)?;
        Ok(Self { bodies: Some(bodies), ..problem })
    }

    /// Returns the rows per contact: 1 without friction, else the dimension of space.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Returns the number of contacts.
    pub fn contacts(&self) -> usize {
        self.friction.len()
    }

    /// Returns the laws of the rows of joints, which follow the contacts. Their compliance is in W.
    pub fn rows(&self) -> &[Interval<f64>] {
        &self.rows
    }

    /// Returns the number of unknowns: `dimension` times `contacts`, and one for each row of a
    /// joint.
    pub fn unknowns(&self) -> usize {
        self.offset.len()
    }

    /// Splits numbers of the unknowns into those of contacts and those of rows of joints.
    pub fn split_rows<'a>(&self, r: &'a [f64]) -> (&'a [f64], &'a [f64]) {
        r.split_at(r.len().saturating_sub(self.rows.len()))
    }

    /// Projects impulses onto the friction cones and between the bounds of the rows.
    pub fn project(&self, r: &mut [f64]) {
        let (contacts, rows) = r.split_at_mut(self.offset.len() - self.rows.len());
        for (impulse, &friction) in contacts.chunks_exact_mut(self.dimension).zip(&self.friction) {
            law::project(impulse, friction);
        }
        for (impulse, law) in rows.iter_mut().zip(&self.rows) {
            *impulse = law.clamp(Vector([*impulse]))[0];
        }
    }

    /// Returns mu of each contact. \[1\]
    pub fn friction(&self) -> &[f64] {
        &self.friction
    }

    /// Returns W, the M of a linear complementarity problem. \[1/kg\]
    pub fn matrix(&self) -> &Matrix {
        &self.matrix
    }

    /// Returns q: the velocities u without impulses. \[m/s\]
    pub fn offset(&self) -> &[f64] {
        &self.offset
    }

    /// Returns the bodies, if known.
    pub fn bodies(&self) -> Option<&Bodies> {
        self.bodies.as_ref()
    }

    /// Returns u = W r + q. \[m/s\]
    pub fn velocities(&self, r: &[f64]) -> Vec<f64> {
        let mut u = product(&self.matrix, r);
        for (u, q) in u.iter_mut().zip(&self.offset) {
            *u += q;
        }
        u
    }

    /// Returns the largest |W_ij - W_ji|.
    pub fn asymmetry(&self) -> f64 {
        let mut worst = 0.0f64;
        for i in 0..self.unknowns() {
            for (j, &w_ij) in self.matrix.col_idx_of_row(i).zip(self.matrix.val_of_row(i)) {
                let w_ji = self.matrix.get(j, i).copied().unwrap_or(0.0);
                worst = worst.max((w_ij - w_ji).abs());
            }
        }
        worst
    }

    /// Returns the relative residual of r: zero exactly at a solution.
    ///
    /// With friction it is [`Problem::natural_map`], without [`Problem::complementarity_error`].
    /// NaN counts as infinite.
    pub fn residual(&self, r: &[f64]) -> f64 {
        if self.dimension == 1 { self.complementarity_error(r) } else { self.natural_map(r) }
    }

    /// Returns |r - P_K(r - (u + mu |u_t| n))| / |q|, the natural map with a step of one (kg), as
    /// measured by FCLIB and Siconos (Acary, Bremond and Huber 2018). For rows of joints it is the
    /// change of r by a visit with that step. It is not divided if q is zero.
    pub fn natural_map(&self, r: &[f64]) -> f64 {
        let size = norm(&self.offset);
        let error = norm(&self.natural(r, |_| 1.0));
        or_infinite(if size > 0.0 { error / size } else { error })
    }

    /// Returns the natural map relative to |r|, with the step 1 / (mean diagonal entry of W) for
    /// each contact. It does not depend on units. It is not divided if r is zero.
    pub fn scaled_natural_map(&self, r: &[f64]) -> f64 {
        let step = |rows: Range<usize>| {
            let count = rows.len() as f64;
            let sum: f64 = rows.map(|i| self.matrix.get(i, i).copied().unwrap_or(0.0)).sum::<f64>();
            if sum > 0.0 { count / sum } else { 1.0 }
        };
        let (error, size) = (norm(&self.natural(r, step)), norm(r));
        or_infinite(if size > 0.0 { error / size } else { error })
    }

    /// Returns r - P_K(r - step (u + mu |u_t| n)), where `step` returns that of some unknowns.
    fn natural(&self, r: &[f64], step: impl Fn(Range<usize>) -> f64) -> Vec<f64> {
        let d = self.dimension;
        let mut velocities = self.velocities(r);
        let first = self.offset.len() - self.rows.len();
        let (contacts, rows) = velocities.split_at_mut(first);
        for (i, (y, &r)) in rows.iter_mut().zip(&r[first..]).enumerate() {
            *y = r - self.rows[i].visit(step(first + i..first + i + 1), *y, r);
        }
        for (i, (y, r)) in contacts.chunks_exact_mut(d).zip(r.chunks_exact(d)).enumerate() {
            let slip = norm(&y[1..]);
            y[0] += self.friction[i] * slip;
            let step = step(d * i..d * (i + 1));
            for k in 0..d {
                y[k] = r[k] - step * y[k];
            }
            law::project(y, self.friction[i]);
            for k in 0..d {
                y[k] = r[k] - y[k];
            }
        }
        velocities
    }

    /// Returns the largest |min(z_i, s w_i)| with w = M z + q and s = 1 / max |M|, relative to s
    /// max |q|. It does not depend on units, and leaves friction out.
    ///
    /// Rounding of the products M z is subtracted: some [`f64::EPSILON`] times max |z|, which
    /// matters with mass ratios from 1e5. That allowance is limited, so that diverging impulses
    /// never look like a solution.
    pub fn complementarity_error(&self, z: &[f64]) -> f64 {
        let size = largest(self.matrix.val());
        let s = if size > 0.0 { 1.0 / size } else { 1.0 };
        let (pushed, error) = (s * largest(&self.offset), self.natural_error(z, s));
        if pushed == 0.0 {
            return error;
        }
        let rounding = 4.0 * f64::EPSILON * (largest(z) / pushed).min(1e12);
        or_infinite((error / pushed - rounding).max(0.0))
    }

    /// Returns the largest |min(z_i, s w_i)|, with w = M z + q; for rows of joints the largest
    /// change of z by a visit with the step s.
    pub fn natural_error(&self, z: &[f64], s: f64) -> f64 {
        let w = self.velocities(z);
        let first = self.offset.len() - self.rows.len();
        let error = z.iter().zip(&w).enumerate().fold(0.0f64, |worst, (i, (&z, &w))| {
            let error = match i.checked_sub(first) {
                None => z.min(s * w).abs(),
                Some(row) => (z - self.rows[row].visit(s, w, z)).abs(),
            };
            // `max` would drop NaN.
            if error >= worst || error.is_nan() || worst.is_nan() { error } else { worst }
        });
        or_infinite(error)
    }
}

impl Bodies {
    /// Returns v = M^-1 (f + H r). \[m/s, rad/s\]
    ///
    /// # Errors
    /// A block of M is singular.
    pub fn velocities(&self, r: &[f64]) -> Result<Vec<f64>, ProblemError> {
        let mut momentum = product(&self.directions, r);
        for (p, f) in momentum.iter_mut().zip(&self.momentum) {
            *p += f;
        }
        Ok(product(&inverse_of_blocks(&self.mass)?, &momentum))
    }
}

/// Returns the inverse of a matrix that is block-diagonal after a reordering of its rows.
fn inverse_of_blocks(matrix: &Matrix) -> Result<Matrix, ProblemError> {
    let mut entries = Vec::new();
    for rows in coupled(matrix) {
        let block =
            Dense::from_fn(rows.len(), |i, j| matrix.get(rows[i], rows[j]).copied().unwrap_or(0.0));
        let lu = block.factor().ok_or(ProblemError::Mass(rows[0]))?;
        for (j, &column) in rows.iter().enumerate() {
            let mut x = vec![0.0; rows.len()];
            x[j] = 1.0;
            lu.solve(&mut x);
            entries.extend(rows.iter().zip(x).map(|(&i, x)| (i, column, x)));
        }
    }
    let n = matrix.nrows();
    from_entries(n, n, &entries)
}

/// Returns the sets of rows that entries of a square matrix couple, each set in ascending order.
pub(super) fn coupled(matrix: &Matrix) -> Vec<Vec<usize>> {
    fn root(parent: &mut [usize], mut i: usize) -> usize {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    }
    let n = matrix.nrows();
    let mut parent: Vec<usize> = (0..n).collect();
    for i in 0..n {
        for j in matrix.col_idx_of_row(i) {
            let (a, b) = (root(&mut parent, i), root(&mut parent, j));
            parent[a.max(b)] = a.min(b);
        }
    }
    let mut sets = vec![Vec::new(); n];
    for i in 0..n {
        sets[root(&mut parent, i)].push(i);
    }
    sets.retain(|set| !set.is_empty());
    sets
}
