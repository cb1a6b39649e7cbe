//! Sparse Cholesky factorization of symmetric block matrices with one row of blocks per body.
//!
//! [`Elimination`] has the order.

use crate::elimination::Elimination;
use crate::registers::with_best_registers;

/// A symmetric block matrix A; after [`factor`](Self::factor) its U of A = U^T U.
#[derive(Clone, Debug, Default)]
pub(crate) struct BlockMatrix {
    /// Rows of a block.
    size: usize,
    /// The caller's row that is eliminated at each step.
    order: Vec<u32>,
    /// The step at which each row of the caller is eliminated.
    place: Vec<u32>,
    /// Start of the blocks of each column, in elimination order; the first block is the diagonal
    /// one.
    starts: Vec<usize>,
    /// Row of each block, in elimination order.
    rows: Vec<u32>,
    /// The blocks, stored by rows: of each pair the one above the diagonal, so that all loops go along
    /// rows.
    values: Vec<f64>,
    scatter: Vec<u32>,
    /// Blocks of a column while it is eliminated, and a right-hand side in elimination order.
    column: Vec<f64>,
    ordered: Vec<f64>,
}

const ABSENT: u32 = u32::MAX;

impl BlockMatrix {
    /// Creates a zero matrix of `rows` by `rows` blocks of `size` by `size` numbers. It has room
    /// for the blocks of these pairs of rows and for the fill-in of the elimination.
    pub(crate) fn new(size: usize, rows: usize, pairs: impl Iterator<Item = [u32; 2]>) -> Self {
        let mut neighbors = vec![Vec::new(); rows];
        for [a, b] in pairs.filter(|[a, b]| a != b) {
            neighbors[a as usize].push(b);
            neighbors[b as usize].push(a);
        }
        let Elimination { order, place, later } = Elimination::of(neighbors);
        let (mut starts, mut entries) = (vec![0], Vec::new());
        for (step, later) in (0..).zip(later) {
            entries.push(step);
            entries.extend(later);
            starts.push(entries.len());
        }
        let values = vec![0.0; entries.len() * size * size];
        Self {
            size,
            order,
            place,
            starts,
            rows: entries,
            values,
            scatter: vec![ABSENT; rows],
            column: Vec::new(),
            ordered: Vec::new(),
        }
    }

    /// Returns the number of rows of a block.
    pub(crate) fn size(&self) -> usize {
        self.size
    }

    /// Returns the number of rows of blocks.
    pub(crate) fn len(&self) -> usize {
        self.order.len()
    }

    /// Returns the step at which a row is eliminated.
    pub(crate) fn place(&self, row: u32) -> usize {
        self.place[row as usize] as usize
    }

    /// Returns the index of the block that couples two places, `row` after `column`. Its rows are those
    /// of the earlier place, its columns those of the later.
    pub(crate) fn block_between(&self, row: usize, column: usize) -> Option<usize> {
        let range = self.starts[column]..self.starts[column + 1];
        let found = self.rows[range.clone()].binary_search(&(row as u32)).ok()?;
        Some(range.start + found)
    }

    /// Returns a block by its index.
    #[inline(always)]
    pub(crate) fn block<const N: usize>(&mut self, index: usize) -> &mut [[f64; N]; N] {
        let (rows, _) = self.values.as_chunks_mut::<N>();
        &mut rows.as_chunks_mut::<N>().0[index]
    }

    /// Returns the diagonal block at a place.
    #[inline(always)]
    pub(crate) fn diagonal<const N: usize>(&mut self, place: usize) -> &mut [[f64; N]; N] {
        self.block(self.starts[place])
    }

    /// Sets all entries to zero and discards the factors.
    pub(crate) fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Adds `entry(i, j)` to the block at row `a` and column `b`, and its transpose to the block at
    /// `b`, `a`. If `a` = `b` there is one block, and it is added once.
    pub(crate) fn add(&mut self, a: u32, b: u32, entry: impl Fn(usize, usize) -> f64) {
        let (p, q) = (self.place[a as usize], self.place[b as usize]);
        let (row, column, flipped) = if p >= q { (p, q, true) } else { (q, p, false) };
        let Some(index) = self.block_between(row as usize, column as usize) else { return };
        let n = self.size;
        let block = &mut self.values[index * n * n..][..n * n];
        for i in 0..n {
            for j in 0..n {
                block[i * n + j] += if flipped { entry(j, i) } else { entry(i, j) };
            }
        }
    }

    /// Factors the matrix into U^T U in place. Returns false if it is not positive definite.
    pub(crate) fn factor(&mut self) -> bool {
        with_best_registers(
            #[inline(always)]
            || match self.size {
                2 => self.factor_blocks::<2>(),
                3 => self.factor_blocks::<3>(),
                6 => self.factor_blocks::<6>(),
                _ => false,
            },
        )
    }

    #[inline(always)]
    pub(crate) fn factor_blocks<const N: usize>(&mut self) -> bool {
        let (values, _) = self.values.as_chunks_mut::<N>();
        let (blocks, _) = values.as_chunks_mut::<N>();
        for column in 0..self.order.len() {
            let (first, end) = (self.starts[column], self.starts[column + 1]);
            if !factor_block(&mut blocks[first]) {
                return false;
            }
            let diagonal = blocks[first];
            for block in &mut blocks[first + 1..end] {
                solve_left(&diagonal, block);
            }
            self.column.clear();
            self.column.extend(blocks[first + 1..end].as_flattened().as_flattened());
            let (rows, _) = self.column.as_chunks::<N>();
            let (column_blocks, _) = rows.as_chunks::<N>();
            for (k, left) in column_blocks.iter().enumerate() {
                let target = self.rows[first + 1 + k] as usize;
                let range = self.starts[target]..self.starts[target + 1];
                for (at, &row) in range.clone().zip(&self.rows[range]) {
                    self.scatter[row as usize] = at as u32;
                }
                for (i, right) in column_blocks.iter().enumerate().skip(k) {
                    let at = self.scatter[self.rows[first + 1 + i] as usize] as usize;
                    subtract_product(&mut blocks[at], left, right);
                }
            }
        }
        true
    }

    /// Solves A x = b in place. `x` holds b, in the order of the caller's rows.
    pub(crate) fn solve(&mut self, x: &mut [f64]) {
        with_best_registers(
            #[inline(always)]
            || match self.size {
                2 => self.solve_blocks::<2>(x),
                3 => self.solve_blocks::<3>(x),
                6 => self.solve_blocks::<6>(x),
                _ => {}
            },
        );
    }

    #[inline(always)]
    fn solve_blocks<const N: usize>(&mut self, x: &mut [f64]) {
        let mut ordered = std::mem::take(&mut self.ordered);
        ordered.clear();
        ordered.resize(x.len(), 0.0);
        let (x, _) = x.as_chunks_mut::<N>();
        let (y, _) = ordered.as_chunks_mut::<N>();
        for (y, &row) in y.iter_mut().zip(&self.order) {
            *y = x[row as usize];
        }
        self.solve_in_order(y);
        for (y, &row) in y.iter().zip(&self.order) {
            x[row as usize] = *y;
        }
        self.ordered = ordered;
    }

    /// Solves A y = b in place. `y` holds b, in the order of elimination.
    #[inline(always)]
    pub(crate) fn solve_in_order<const N: usize>(&self, y: &mut [[f64; N]]) {
        let (values, _) = self.values.as_chunks::<N>();
        let (blocks, _) = values.as_chunks::<N>();
        for column in 0..self.order.len() {
            let (first, end) = (self.starts[column], self.starts[column + 1]);
            let (diagonal, mut own) = (&blocks[first], y[column]);
            for i in 0..N {
                own[i] *= diagonal[i][i];
                for j in i + 1..N {
                    own[j] -= diagonal[i][j] * own[i];
                }
            }
            y[column] = own;
            for (block, &row) in blocks[first + 1..end].iter().zip(&self.rows[first + 1..end]) {
                let mut later = y[row as usize];
                for i in 0..N {
                    for j in 0..N {
                        later[j] -= block[i][j] * own[i];
                    }
                }
                y[row as usize] = later;
            }
        }
        for column in (0..self.order.len()).rev() {
            let (first, end) = (self.starts[column], self.starts[column + 1]);
            let mut own = y[column];
            for (block, &row) in blocks[first + 1..end].iter().zip(&self.rows[first + 1..end]) {
                let later = &y[row as usize];
                for i in 0..N {
                    for j in 0..N {
                        own[i] -= block[i][j] * later[j];
                    }
                }
            }
            let diagonal = &blocks[first];
            for i in (0..N).rev() {
                for j in i + 1..N {
                    own[i] -= diagonal[i][j] * own[j];
                }
                own[i] *= diagonal[i][i];
            }
            y[column] = own;
        }
    }
}

/// Factors a block into U^T U, with U in its upper triangle and the inverses of U's diagonal on its own. The
/// lower triangle is left as it is. Returns false if the block is not positive definite.
#[inline(always)]
fn factor_block<const N: usize>(a: &mut [[f64; N]; N]) -> bool {
    for j in 0..N {
        let pivot = a[j][j];
        if pivot <= 0.0 || pivot.is_nan() {
            return false;
        }
        let inverse = 1.0 / pivot.sqrt();
        let row = a[j].map(|entry| entry * inverse);
        for i in j + 1..N {
            for k in 0..N {
                a[i][k] -= row[i] * row[k];
            }
        }
        a[j] = row;
        a[j][j] = inverse;
    }
    true
}

/// a <- U^-T a.
#[inline(always)]
fn solve_left<const N: usize>(u: &[[f64; N]; N], a: &mut [[f64; N]; N]) {
    for i in 0..N {
        let row = a[i].map(|entry| entry * u[i][i]);
        a[i] = row;
        for k in i + 1..N {
            for j in 0..N {
                a[k][j] -= u[i][k] * row[j];
            }
        }
    }
}

/// c <- c - a^T b.
#[inline(always)]
fn subtract_product<const N: usize>(c: &mut [[f64; N]; N], a: &[[f64; N]; N], b: &[[f64; N]; N]) {
    for (i, c) in c.iter_mut().enumerate() {
        let mut sum = *c;
        for (a, b) in a.iter().zip(b) {
            for j in 0..N {
                sum[j] -= a[i] * b[j];
            }
        }
        *c = sum;
    }
}
