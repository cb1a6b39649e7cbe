//! Sparse LU factorization of block matrices, with one block per pair of coupled contacts.
//!
//! Pivots stay within the diagonal blocks, so the structure of the factors is known in advance and
//! found once per problem. Contacts are eliminated in minimum-degree order (Tinney and Walker
//! 1967). This is stable for positive definite matrices. It is nearly stable for those of
//! [`proximal`](super::proximal), whose shift keeps the blocks away from zero; refinement there
//! removes rounding errors.

use super::blocks::{Block, Blocks};

/// P A P^T = L U, with the inverses of the diagonal blocks of U.
pub(super) struct BlockLu<const D: usize> {
    /// Contact eliminated at each step; `place` is the inverse.
    order: Vec<usize>,
    place: Vec<usize>,
    lower: Rows<D>,
    upper: Rows<D>,
    inverse: Vec<Block<D>>,
    work: Vec<Block<D>>,
}

struct Rows<const D: usize> {
    start: Vec<usize>,
    columns: Vec<usize>,
    values: Vec<Block<D>>,
}

impl<const D: usize> Rows<D> {
    fn new(rows: &[Vec<usize>]) -> Self {
        let mut start = vec![0];
        for row in rows {
            start.push(start[start.len() - 1] + row.len());
        }
        let columns = rows.concat();
        let values = vec![[[0.0; D]; D]; columns.len()];
        Self { start, columns, values }
    }

    fn range(&self, i: usize) -> std::ops::Range<usize> {
        self.start[i]..self.start[i + 1]
    }
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

impl<const D: usize> BlockLu<D> {
    /// Finds the structure for all matrices whose pattern is contained in that of `blocks`.
    pub(super) fn new(blocks: &Blocks<D>) -> Self {
        let n = blocks.len();
        let mut near: Vec<Vec<usize>> = vec![Vec::new(); n];
        for i in 0..n {
            for (j, _) in blocks.row(i).filter(|&(j, _)| j != i) {
                near[i].push(j);
                near[j].push(i);
            }
        }
        for row in &mut near {
            row.sort_unstable();
            row.dedup();
        }
        let mut left = vec![true; n];
        let (mut order, mut later) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for _ in 0..n {
            let rest = (0..n).filter(|&i| left[i]);
            let Some(v) = rest.min_by_key(|&i| near[i].len()) else {
                break;
            };
            left[v] = false;
            let around = std::mem::take(&mut near[v]);
            for &i in &around {
                let mut merged = Vec::with_capacity(near[i].len() + around.len());
                merge(&near[i], &around, &mut merged);
                merged.retain(|&j| j != i && j != v);
                near[i] = merged;
            }
            order.push(v);
            later.push(around);
        }
        let mut place = vec![0; n];
        for (k, &v) in order.iter().enumerate() {
            place[v] = k;
        }
        let mut lower = vec![Vec::new(); n];
        for (k, row) in later.iter_mut().enumerate() {
            for v in row.iter_mut() {
                *v = place[*v];
                lower[*v].push(k);
            }
            row.sort_unstable();
        }
        Self {
            order,
            place,
            lower: Rows::new(&lower),
            upper: Rows::new(&later),
            inverse: vec![[[0.0; D]; D]; n],
            work: vec![[[0.0; D]; D]; n],
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
        for i in 0..self.order.len() {
            let contact = self.order[i];
            let (lower, upper) = (self.lower.range(i), self.upper.range(i));
            let (by, plus) = &rows[contact];
            if absent[contact] {
                self.lower.values[lower].fill([[0.0; D]; D]);
                self.upper.values[upper].fill([[0.0; D]; D]);
                self.inverse[i] = inverted(*plus)?;
                continue;
            }
            let near = self.lower.columns[lower.clone()].iter();
            for &j in near.chain(&self.upper.columns[upper.clone()]) {
                self.work[j] = [[0.0; D]; D];
            }
            self.work[i] = *plus;
            let negative = by.map(|row| row.map(|x| -x));
            for (j, block) in blocks.row(contact).filter(|&(j, _)| !absent[j]) {
                subtract_product(&mut self.work[self.place[j]], &negative, block);
            }
            for l in lower {
                let k = self.lower.columns[l];
                let mut factor = [[0.0; D]; D];
                if !is_zero(&self.work[k]) {
                    factor = product(&self.work[k], &self.inverse[k]);
                    for u in self.upper.range(k) {
                        let (j, value) = (self.upper.columns[u], &self.upper.values[u]);
                        if !absent[self.order[j]] {
                            subtract_product(&mut self.work[j], &factor, value);
                        }
                    }
                }
                self.lower.values[l] = factor;
            }
            for u in upper {
                self.upper.values[u] = self.work[self.upper.columns[u]];
            }
            self.inverse[i] = inverted(self.work[i])?;
        }
        Some(())
    }

    /// x <- A^-1 x.
    pub(super) fn solve(&self, x: &mut [[f64; D]]) {
        let n = self.order.len();
        let mut y: Vec<[f64; D]> = self.order.iter().map(|&v| x[v]).collect();
        for i in 0..n {
            let mut sum = y[i];
            for l in self.lower.range(i) {
                subtract_applied(&mut sum, &self.lower.values[l], &y[self.lower.columns[l]]);
            }
            y[i] = sum;
        }
        for i in (0..n).rev() {
            let mut sum = y[i];
            for u in self.upper.range(i) {
                subtract_applied(&mut sum, &self.upper.values[u], &y[self.upper.columns[u]]);
            }
            y[i] = applied(&self.inverse[i], &sum);
        }
        for (&v, y) in self.order.iter().zip(y) {
            x[v] = y;
        }
    }
}

/// Merges two sorted lists without duplicates.
fn merge(a: &[usize], b: &[usize], merged: &mut Vec<usize>) {
    let (mut i, mut j) = (0, 0);
    while i < a.len() || j < b.len() {
        let (x, y) = (a.get(i).copied(), b.get(j).copied());
        let next = match (x, y) {
            (Some(x), Some(y)) => x.min(y),
            (Some(x), None) => x,
            (None, Some(y)) => y,
            (None, None) => break,
        };
        i += usize::from(x == Some(next));
        j += usize::from(y == Some(next));
        merged.push(next);
    }
}
