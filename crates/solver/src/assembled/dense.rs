//! Small dense matrices: LU factorization with partial pivoting. The order of operations is fixed,
//! so results do not depend on the number of threads.

/// A square matrix, stored by rows.
#[derive(Clone, Debug)]
pub(super) struct Dense {
    n: usize,
    values: Vec<f64>,
}

/// P A = L U.
pub(super) struct Factors {
    lu: Dense,
    order: Vec<usize>,
}

impl Dense {
    pub(super) fn from_fn(n: usize, value: impl Fn(usize, usize) -> f64) -> Self {
        let values = (0..n * n).map(|k| value(k / n, k % n)).collect();
        Self { n, values }
    }

    pub(super) fn row(&self, i: usize) -> &[f64] {
        &self.values[self.n * i..self.n * (i + 1)]
    }

    pub(super) fn row_mut(&mut self, i: usize) -> &mut [f64] {
        &mut self.values[self.n * i..self.n * (i + 1)]
    }

    /// Factors the matrix; `None` if it is singular up to rounding. Costs 2/3 n^3.
    pub(super) fn factor(mut self) -> Option<Factors> {
        let n = self.n;
        let scale = self.values.iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
        let mut order: Vec<usize> = (0..n).collect();
        for k in 0..n {
            let size = |i: usize| self.values[n * i + k].abs();
            let pivot = (k..n).fold(k, |best, i| if size(i) > size(best) { i } else { best });
            let largest = size(pivot);
            if !largest.is_finite() || largest <= f64::EPSILON * n as f64 * scale {
                return None;
            }
            if pivot != k {
                order.swap(pivot, k);
                let (upper, lower) = self.values.split_at_mut(n * pivot);
                upper[n * k..n * (k + 1)].swap_with_slice(&mut lower[..n]);
            }
            let (done, below) = self.values.split_at_mut(n * (k + 1));
            let row_k = &done[n * k..];
            for row in below.chunks_exact_mut(n) {
                let factor = row[k] / row_k[k];
                row[k] = factor;
                if factor != 0.0 {
                    for (x, y) in row[k + 1..].iter_mut().zip(&row_k[k + 1..]) {
                        *x -= factor * y;
                    }
                }
            }
        }
        Some(Factors { lu: self, order })
    }
}

impl Factors {
    /// x <- A^-1 x.
    pub(super) fn solve(&self, x: &mut [f64]) {
        let n = self.lu.n;
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut y: Vec<f64> = self.order.iter().map(|&i| x[i]).collect();
        for i in 1..n {
            y[i] -= dot(&self.lu.row(i)[..i], &y[..i]);
        }
        for i in (0..n).rev() {
            let row = self.lu.row(i);
            y[i] = (y[i] - dot(&row[i + 1..], &y[i + 1..])) / row[i];
        }
        x.copy_from_slice(&y);
    }
}
