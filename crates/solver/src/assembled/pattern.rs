//! Which entries of the matrices there are.
//!
//! Row i of J has two blocks. A has an entry (i, j) where contacts i and j share a body that can
//! move: a body with n contacts fills n^2 entries, one with a single contact only a diagonal one.

use super::matrices::Matrix;
use crate::{Scalar, System};

/// A drawing of a sparse matrix: `#` for a stored entry, `.` for none, a line for each row.
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

/// The contacts of a body, in order: those whose impulses move it.
pub fn contacts_of<T: Scalar, const L: usize, const A: usize>(
    system: &System<T, L, A>,
    body: u32,
) -> Vec<usize> {
    let touching = system.manifolds.iter().filter(|manifold| manifold.bodies.contains(&body));
    touching.flat_map(|manifold| manifold.points()).collect()
}
