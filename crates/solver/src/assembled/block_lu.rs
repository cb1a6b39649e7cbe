//! Sparse LU factorization of block matrices, with one block per pair of coupled contacts.
//!
//! Pivots stay within the diagonal blocks, so the structure of the factors is known in advance and
//! found once per problem ([`Structure`]). This is stable for positive definite matrices, and nearly
//! stable for those of [`proximal`](super::proximal), whose shift keeps the blocks away from zero;
//! refinement there removes rounding errors.

use super::blocks::{Block, Blocks};
use super::matrices::Matrix;
use crate::elimination::Elimination;

/// Where the blocks of L and U are.
pub(crate) struct Structure {
    /// Contact eliminated at each step; `place` is the inverse.
    order: Vec<u32>,
    place: Vec<u32>,
    lower: Rows,
    upper: Rows,
}

/// Columns of the blocks in each row.
struct Rows {
    start: Vec<usize>,
    columns: Vec<u32>,
}

impl Rows {
    fn new(rows: &[Vec<u32>]) -> Self {
        let mut start = vec![0];
        for row in rows {
            start.push(start[start.len() - 1] + row.len());
        }
        Self { start, columns: rows.concat() }
    }

    fn range(&self, i: usize) -> std::ops::Range<usize> {
        self.start[i]..self.start[i + 1]
    }

    fn columns(&self, i: usize) -> impl Iterator<Item = usize> {
        self.columns[self.range(i)].iter().map(|&column| column as usize)
    }
}

impl Structure {
    /// Finds the structure for all matrices of `size` x `size` blocks whose pattern is contained in that
    /// of this one.
    pub(crate) fn of(matrix: &Matrix, size: usize) -> Self {
        let mut near = vec![Vec::new(); matrix.nrows().div_ceil(size)];
        for row in 0..matrix.nrows() {
            for column in matrix.col_idx_of_row(row) {
                near[row / size].push((column / size) as u32);
                near[column / size].push((row / size) as u32);
            }
        }
        let Elimination { order, place, later } = Elimination::of_twins(near);
        let mut lower = vec![Vec::new(); order.len()];
        for (row, step) in later.iter().zip(0..) {
            row.iter().for_each(|&place| lower[place as usize].push(step));
        }
        Self { order, place, lower: Rows::new(&lower), upper: Rows::new(&later) }
    }

    /// Returns the number of products of blocks in a factorization.
    pub(crate) fn products(&self) -> f64 {
        (0..self.order.len()).map(|i| (self.upper.range(i).len() as f64).powi(2)).sum()
    }
}

/// P A P^T = L U, with the inverses of the diagonal blocks of U.
pub(super) struct BlockLu<'a, const D: usize> {
    structure: &'a Structure,
    lower: Vec<Block<D>>,
    upper: Vec<Block<D>>,
    inverse: Vec<Block<D>>,
    work: Vec<Block<D>>,
}

/// a <- a - b c
fn subtract_product<const D: usize>(a: &mut Block<D>, b: &Block<D>, c: &Block<D>) {
    for i in 0..D {
        for k in 0..D {
            let b_ik = b[i][k];
            for j in 0..D {
                a[i][j] -= b_ik * c[k][j];
            }
        }
    }
}

/// Returns a b.
fn product<const D: usize>(a: &Block<D>, b: &Block<D>) -> Block<D> {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..D).map(|k| a[i][k] * b[k][j]).sum()))
}

fn is_zero<const D: usize>(a: &Block<D>) -> bool {
    a.as_flattened().iter().all(|&x| x == 0.0)
}

/// x <- x - a y
fn subtract_applied<const D: usize>(x: &mut [f64; D], a: &Block<D>, y: &[f64; D]) {
    for i in 0..D {
        for j in 0..D {
            x[i] -= a[i][j] * y[j];
        }
    }
}

fn applied<const D: usize>(a: &Block<D>, y: &[f64; D]) -> [f64; D] {
    std::array::from_fn(|i| (0..D).map(|j| a[i][j] * y[j]).sum())
}

/// Returns the inverse, or `None` if the block is singular.
fn inverted<const D: usize>(mut a: Block<D>) -> Option<Block<D>> {
    let mut x: Block<D> = [[0.0; D]; D];
    for i in 0..D {
        x[i][i] = 1.0;
    }
    for k in 0..D {
        let size = |i: usize| a[i][k].abs();
        let pivot = (k..D).fold(k, |best, i| if size(i) > size(best) { i } else { best });
        if size(pivot) <= f64::MIN_POSITIVE {
            return None;
        }
        a.swap(pivot, k);
        x.swap(pivot, k);
        let inverse = 1.0 / a[k][k];
        for j in 0..D {
            a[k][j] *= inverse;
            x[k][j] *= inverse;
        }
        for i in (0..D).filter(|&i| i != k) {
            let factor = a[i][k];
            for j in 0..D {
                a[i][j] -= factor * a[k][j];
                x[i][j] -= factor * x[k][j];
            }
        }
    }
    x.as_flattened().iter().all(|x| x.is_finite()).then_some(x)
}

impl<'a, const D: usize> BlockLu<'a, D> {
    /// Creates room for matrices of this structure.
    pub(super) fn new(structure: &'a Structure) -> Self {
        let zeros = |count: usize| vec![[[0.0; D]; D]; count];
        let n = structure.order.len();
        Self {
            structure,
            lower: zeros(structure.lower.columns.len()),
            upper: zeros(structure.upper.columns.len()),
            inverse: zeros(n),
            work: zeros(n),
        }
    }

    /// Factors the matrix whose rows are C_i W_i + E_i, where W_i is row i of `blocks`. The columns
    /// of `absent` contacts count as zero, and their own rows have C_i = 0; they cost nothing.
    /// `None` if a diagonal block is singular.
    pub(super) fn factor(
        &mut self,
        blocks: &Blocks<D>,
        rows: &[(Block<D>, Block<D>)],
        absent: &[bool],
    ) -> Option<()> {
        let Structure { order, place, lower: in_lower, upper: in_upper } = self.structure;
        for (i, &contact) in order.iter().enumerate() {
            let contact = contact as usize;
            let (lower, upper) = (in_lower.range(i), in_upper.range(i));
            let (by, plus) = &rows[contact];
            if absent[contact] {
                self.lower[lower].fill([[0.0; D]; D]);
                self.upper[upper].fill([[0.0; D]; D]);
                self.inverse[i] = inverted(*plus)?;
                continue;
            }
            for j in in_lower.columns(i).chain(in_upper.columns(i)) {
                self.work[j] = [[0.0; D]; D];
            }
            self.work[i] = *plus;
            let negative = by.map(|row| row.map(|x| -x));
            for (j, block) in blocks.row(contact).filter(|&(j, _)| !absent[j]) {
                subtract_product(&mut self.work[place[j] as usize], &negative, block);
            }
            for (l, k) in lower.zip(in_lower.columns(i)) {
                let mut factor = [[0.0; D]; D];
                if !is_zero(&self.work[k]) {
                    factor = product(&self.work[k], &self.inverse[k]);
                    for (u, j) in in_upper.range(k).zip(in_upper.columns(k)) {
                        if !absent[order[j] as usize] {
                            subtract_product(&mut self.work[j], &factor, &self.upper[u]);
                        }
                    }
                }
                self.lower[l] = factor;
            }
            for (u, j) in upper.zip(in_upper.columns(i)) {
                self.upper[u] = self.work[j];
            }
            self.inverse[i] = inverted(self.work[i])?;
        }
        Some(())
    }

    /// x <- A^-1 x.
    pub(super) fn solve(&self, x: &mut [[f64; D]]) {
        let Structure { order, lower, upper, .. } = self.structure;
        let mut y: Vec<[f64; D]> = order.iter().map(|&v| x[v as usize]).collect();
        for i in 0..order.len() {
            let mut sum = y[i];
            for (l, j) in lower.range(i).zip(lower.columns(i)) {
                subtract_applied(&mut sum, &self.lower[l], &y[j]);
            }
            y[i] = sum;
        }
        for i in (0..order.len()).rev() {
            let mut sum = y[i];
            for (u, j) in upper.range(i).zip(upper.columns(i)) {
                subtract_applied(&mut sum, &self.upper[u], &y[j]);
            }
            y[i] = applied(&self.inverse[i], &sum);
        }
        for (&v, y) in order.iter().zip(y) {
            x[v as usize] = y;
        }
    }
}
