//! Sparse Cholesky factorization of symmetric block matrices with one row of blocks per body.
//!
//! Bodies are eliminated in minimum-degree order (Tinney and Walker 1967), so that a chain costs as
//! much as its length, and a wall not much more. Only indices decide the order: equal input gives
//! equal bits.

/// A symmetric block matrix; after [`factor`](Self::factor) its L L^T.
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
    /// The blocks, stored by rows.
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
        let mut neighbors: Vec<Vec<u32>> = vec![Vec::new(); rows];
        for [a, b] in pairs {
            neighbors[a as usize].push(b);
            neighbors[b as usize].push(a);
        }
        for (row, list) in neighbors.iter_mut().enumerate() {
            list.sort_unstable();
            list.dedup();
            list.retain(|&other| other as usize != row);
        }
        let (order, columns) = eliminate(neighbors);
        let mut place = vec![0; rows];
        for (when, &row) in order.iter().enumerate() {
            place[row as usize] = when as u32;
        }
        let (mut starts, mut entries) = (vec![0], Vec::new());
        for (when, column) in columns.iter().enumerate() {
            entries.push(when as u32);
            let first = entries.len();
            entries.extend(column.iter().map(|&row| place[row as usize]));
            entries[first..].sort_unstable();
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

    /// Returns the index of the block at two places, `row` after `column`.
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
        let (row, column, flipped) = if p >= q { (p, q, false) } else { (q, p, true) };
        let Some(index) = self.block_between(row as usize, column as usize) else { return };
        let n = self.size;
        let block = &mut self.values[index * n * n..][..n * n];
        for i in 0..n {
            for j in 0..n {
                block[i * n + j] += if flipped { entry(j, i) } else { entry(i, j) };
            }
        }
    }

    /// Factors the matrix into L L^T in place. Returns false if it is not positive definite.
    pub(crate) fn factor(&mut self) -> bool {
        match self.size {
            2 => self.factor_blocks::<2>(),
            3 => self.factor_blocks::<3>(),
            6 => self.factor_blocks::<6>(),
            _ => false,
        }
    }

    fn factor_blocks<const N: usize>(&mut self) -> bool {
        let (values, _) = self.values.as_chunks_mut::<N>();
        let (blocks, _) = values.as_chunks_mut::<N>();
        for column in 0..self.order.len() {
            let (first, end) = (self.starts[column], self.starts[column + 1]);
            if !factor_block(&mut blocks[first]) {
                return false;
            }
            let diagonal = blocks[first];
            for block in &mut blocks[first + 1..end] {
                solve_right(block, &diagonal);
            }
            self.column.clear();
            self.column.extend(blocks[first + 1..end].as_flattened().as_flattened());
            let (rows, _) = self.column.as_chunks::<N>();
            let (column_blocks, _) = rows.as_chunks::<N>();
            for (k, below) in column_blocks.iter().enumerate() {
                let target = self.rows[first + 1 + k] as usize;
                let range = self.starts[target]..self.starts[target + 1];
                for (at, &row) in range.clone().zip(&self.rows[range]) {
                    self.scatter[row as usize] = at as u32;
                }
                // Entries of a row of the product are then side by side, and computed together.
                let below = transposed(below);
                for (i, left) in column_blocks.iter().enumerate().skip(k) {
                    let at = self.scatter[self.rows[first + 1 + i] as usize] as usize;
                    subtract_product(&mut blocks[at], left, &below);
                }
            }
        }
        true
    }

    /// Solves L L^T x = b in place. `x` holds b, in the order of the caller's rows.
    pub(crate) fn solve(&mut self, x: &mut [f64]) {
        match self.size {
            2 => self.solve_blocks::<2>(x),
            3 => self.solve_blocks::<3>(x),
            6 => self.solve_blocks::<6>(x),
            _ => {}
        }
    }

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

    /// Solves L L^T y = b in place. `y` holds b, in the order of elimination.
    pub(crate) fn solve_in_order<const N: usize>(&self, y: &mut [[f64; N]]) {
        let (values, _) = self.values.as_chunks::<N>();
        let (blocks, _) = values.as_chunks::<N>();
        for column in 0..self.order.len() {
            let (first, end) = (self.starts[column], self.starts[column + 1]);
            let (diagonal, mut own) = (&blocks[first], y[column]);
            for i in 0..N {
                for j in 0..i {
                    own[i] -= diagonal[i][j] * own[j];
                }
                own[i] /= diagonal[i][i];
            }
            y[column] = own;
            for (block, &row) in blocks[first + 1..end].iter().zip(&self.rows[first + 1..end]) {
                let below = &mut y[row as usize];
                for i in 0..N {
                    for j in 0..N {
                        below[i] -= block[i][j] * own[j];
                    }
                }
            }
        }
        for column in (0..self.order.len()).rev() {
            let (first, end) = (self.starts[column], self.starts[column + 1]);
            let mut own = y[column];
            for (block, &row) in blocks[first + 1..end].iter().zip(&self.rows[first + 1..end]) {
                let below = &y[row as usize];
                for i in 0..N {
                    for j in 0..N {
                        own[j] -= block[i][j] * below[i];
                    }
                }
            }
            let diagonal = &blocks[first];
            for i in (0..N).rev() {
                for j in i + 1..N {
                    own[i] -= diagonal[j][i] * own[j];
                }
                own[i] /= diagonal[i][i];
            }
            y[column] = own;
        }
    }
}

/// Eliminates the rows, each time the one with the fewest remaining neighbors, and the lowest of
/// these. Its neighbors become neighbors of each other. Returns the order, and the neighbors of
/// each row at its elimination.
fn eliminate(mut neighbors: Vec<Vec<u32>>) -> (Vec<u32>, Vec<Vec<u32>>) {
    let count = neighbors.len();
    let mut queue: std::collections::BTreeSet<(usize, u32)> =
        neighbors.iter().enumerate().map(|(row, list)| (list.len(), row as u32)).collect();
    let (mut order, mut columns) = (Vec::with_capacity(count), Vec::with_capacity(count));
    let mut merged = Vec::new();
    while let Some((_, row)) = queue.pop_first() {
        let clique = std::mem::take(&mut neighbors[row as usize]);
        for &other in &clique {
            let list = &mut neighbors[other as usize];
            queue.remove(&(list.len(), other));
            merged.clear();
            merge(list, &clique, |each| each != row && each != other, &mut merged);
            std::mem::swap(list, &mut merged);
            queue.insert((list.len(), other));
        }
        order.push(row);
        columns.push(clique);
    }
    (order, columns)
}

/// Merges two sorted lists, and leaves out what `keep` rejects.
fn merge(a: &[u32], b: &[u32], keep: impl Fn(u32) -> bool, out: &mut Vec<u32>) {
    let (mut i, mut j) = (0, 0);
    while i < a.len() || j < b.len() {
        let next = match (a.get(i), b.get(j)) {
            (Some(&x), Some(&y)) => x.min(y),
            (Some(&x), None) => x,
            (None, Some(&y)) => y,
            (None, None) => break,
        };
        i += usize::from(a.get(i) == Some(&next));
        j += usize::from(b.get(j) == Some(&next));
        if keep(next) {
            out.push(next);
        }
    }
}

/// Factors a block into L L^T, with L in its lower triangle. Returns false if it is not positive
/// definite.
fn factor_block<const N: usize>(a: &mut [[f64; N]; N]) -> bool {
    for j in 0..N {
        let mut pivot = a[j][j];
        for k in 0..j {
            pivot -= a[j][k] * a[j][k];
        }
        if pivot <= 0.0 || pivot.is_nan() {
            return false;
        }
        a[j][j] = pivot.sqrt();
        for i in j + 1..N {
            let mut sum = a[i][j];
            for k in 0..j {
                sum -= a[i][k] * a[j][k];
            }
            a[i][j] = sum / a[j][j];
            a[j][i] = 0.0;
        }
    }
    true
}

/// a <- a L^-T.
fn solve_right<const N: usize>(a: &mut [[f64; N]; N], l: &[[f64; N]; N]) {
    for row in a {
        for j in 0..N {
            for k in 0..j {
                row[j] -= row[k] * l[j][k];
            }
            row[j] /= l[j][j];
        }
    }
}

fn transposed<const N: usize>(a: &[[f64; N]; N]) -> [[f64; N]; N] {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

/// c <- c - a b.
fn subtract_product<const N: usize>(c: &mut [[f64; N]; N], a: &[[f64; N]; N], b: &[[f64; N]; N]) {
    for (c, a) in c.iter_mut().zip(a) {
        let mut sum = [0.0; N];
        for (a, b) in a.iter().zip(b) {
            for j in 0..N {
                sum[j] += a * b[j];
            }
        }
        for j in 0..N {
            c[j] -= sum[j];
        }
    }
}
