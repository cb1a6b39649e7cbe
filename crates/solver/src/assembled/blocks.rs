//! W as rows of square blocks, one row of blocks per contact, then one for up to D rows of joints.
//!
//! Rows of zeros fill up the last block.

use super::Problem;
use super::matrices::Matrix;
use crate::law::Interval;

pub(super) type Block<const D: usize> = [[f64; D]; D];

/// A sparse matrix of D x D blocks, stored by rows. It stores every diagonal block.
#[derive(Clone, Debug)]
pub(super) struct Blocks<const D: usize> {
    start: Vec<usize>,
    columns: Vec<usize>,
    values: Vec<Block<D>>,
    diagonal: Vec<usize>,
}

impl<const D: usize> Blocks<D> {
    /// Splits a square matrix into blocks.
    pub(super) fn new(matrix: &Matrix) -> Self {
        let n = matrix.nrows().div_ceil(D);
        let most = matrix.compute_nnz().min(n * n) + n;
        let (mut start, mut columns, mut values) =
            (Vec::with_capacity(n + 1), Vec::with_capacity(most), Vec::with_capacity(most));
        start.push(0);
        let mut diagonal = Vec::with_capacity(n);
        // Index of the block of each column; not of this row if it is below `first`.
        let mut place = vec![0; n];
        for i in 0..n {
            let (rows, first) = (D * i..matrix.nrows().min(D * (i + 1)), columns.len());
            let own = rows.clone().flat_map(|k| matrix.col_idx_of_row(k).map(|j| j / D));
            for j in own.chain([i]) {
                if place[j] < first || columns.get(place[j]) != Some(&j) {
                    place[j] = columns.len();
                    columns.push(j);
                }
            }
            columns[first..].sort_unstable();
            for (at, &j) in columns.iter().enumerate().skip(first) {
                place[j] = at;
            }
            diagonal.push(place[i]);
            values.resize(columns.len(), [[0.0; D]; D]);
            for k in rows {
                for (j, &x) in matrix.col_idx_of_row(k).zip(matrix.val_of_row(k)) {
                    values[place[j / D]][k % D][j % D] += x;
                }
            }
            start.push(columns.len());
        }
        Self { start, columns, values, diagonal }
    }

    pub(super) fn len(&self) -> usize {
        self.diagonal.len()
    }

    /// Returns the blocks of row i and their columns.
    pub(super) fn row(&self, i: usize) -> impl Iterator<Item = (usize, &Block<D>)> {
        let range = self.start[i]..self.start[i + 1];
        self.columns[range.clone()].iter().copied().zip(&self.values[range])
    }

    pub(super) fn diagonal(&self, i: usize) -> &Block<D> {
        &self.values[self.diagonal[i]]
    }

    /// Returns row i of the product with r.
    #[inline]
    pub(super) fn product(&self, i: usize, r: &[[f64; D]]) -> [f64; D] {
        let mut u = [0.0; D];
        for (j, block) in self.row(i) {
            for k in 0..D {
                for l in 0..D {
                    u[k] += block[k][l] * r[j][l];
                }
            }
        }
        u
    }

    /// Returns the mean of the diagonal entries.
    pub(super) fn mean_diagonal(&self) -> f64 {
        let n = self.len();
        let sum: f64 = (0..n).map(|i| (0..D).map(|k| self.diagonal(i)[k][k]).sum::<f64>()).sum();
        sum / ((D * n).max(1)) as f64
    }
}

/// Splits numbers into one array per block.
pub(super) fn split<const D: usize>(r: &[f64]) -> Vec<[f64; D]> {
    let number = |chunk: &[f64], k: usize| chunk.get(k).copied().unwrap_or(0.0);
    r.chunks(D).map(|chunk| std::array::from_fn(|k| number(chunk, k))).collect()
}

/// Returns the numbers of these unknowns without those that fill up the last block.
pub(super) fn joined<'a, const D: usize>(r: &'a [[f64; D]], problem: &Problem) -> &'a [f64] {
    &r.as_flattened()[..problem.unknowns()]
}

/// Returns the laws of the rows of joints in a block; none if it is a contact.
pub(super) fn laws<const D: usize>(problem: &Problem, block: usize) -> Option<&[Interval<f64>]> {
    let first = D * block.checked_sub(problem.contacts())?;
    let rows = problem.rows();
    Some(&rows[first..rows.len().min(first + D)])
}
