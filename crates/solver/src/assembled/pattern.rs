//! Sparsity patterns of the matrices.
//!
//! Row i of J has two blocks. A has an entry (i, j) if contacts i and j share a movable body. A
//! body with n contacts fills n^2 entries; a body with one contact fills only a diagonal entry.

use super::matrices::Matrix;
use crate::{Scalar, System};

/// Draws a sparse matrix, one line per row: `#` for a stored entry, `.` for none.
pub fn pattern(matrix: &Matrix) -> String {
    let mut drawing = String::new();
    for row in 0..matrix.nrows() {
        let mut line = vec!['.'; matrix.ncols()];
        for column in matrix.col_idx_of_row(row) {
            line[column] = '#';
        }
        drawing.extend(line);
        drawing.push('\n');
    }
    drawing
}

/// Returns the contacts whose impulses act on a body, in the order of the manifolds.
pub fn contacts_of<T: Scalar, const L: usize, const A: usize>(
    system: &System<T, L, A>,
    body: u32,
) -> Vec<usize> {
    let touching = system.manifolds.iter().filter(|manifold| manifold.bodies.contains(&body));
    touching.flat_map(|manifold| manifold.points()).collect()
}
