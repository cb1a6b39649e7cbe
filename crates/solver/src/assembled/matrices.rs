//! The matrices J, M^-1, A and A + E.

use faer::sparse::Triplet;

use crate::{Manifold, Scalar, System, Vector, moment};

/// A sparse matrix stored by rows.
pub type Matrix = faer::sparse::SparseRowMat<usize, f64>;

/// A dense column vector.
pub type Column = faer::Col<f64>;

type Entry = Triplet<usize, usize, f64>;

/// Builds a matrix from entries. Their indices count contacts, bodies and coordinates of one
/// system, so none is outside.
fn matrix(rows: usize, columns: usize, entries: &[Entry]) -> Matrix {
    Matrix::try_new_from_triplets(rows, columns, entries).expect("entries within the matrix")
}

/// Adds the part of a row of J that belongs to one body: `sign` (n, r x n).
fn block<const L: usize, const A: usize>(
    row: usize,
    body: u32,
    sign: f64,
    anchor: Vector<f64, L>,
    direction: Vector<f64, L>,
    entries: &mut Vec<Entry>,
) {
    let column = (L + A) * body as usize;
    let angular: Vector<f64, A> = moment(anchor, direction);
    let values = direction.0.into_iter().chain(angular.0);
    entries.extend(values.enumerate().map(|(i, x)| Entry::new(row, column + i, sign * x)));
}

/// Returns rows for the first `directions` vectors of the frame of each contact.
fn rows<T: Scalar, const L: usize, const A: usize>(
    system: &System<T, L, A>,
    directions: usize,
) -> Matrix {
    let mut entries = Vec::new();
    for manifold in &system.manifolds {
        let manifold: Manifold<f64, L> = manifold.cast();
        let [a, b] = manifold.bodies;
        for i in manifold.points() {
            let [anchor_a, anchor_b] = manifold.frame.anchors(system.contacts[i].offset.cast());
            for (j, &direction) in manifold.frame.axes[..directions].iter().enumerate() {
                let row = directions * i + j;
                block::<L, A>(row, a, 1.0, anchor_a, direction, &mut entries);
                block::<L, A>(row, b, -1.0, anchor_b, direction, &mut entries);
            }
        }
    }
    let width = (L + A) * system.velocities.len();
    matrix(directions * system.contacts.len(), width, &entries)
}

/// Returns J, k x (L + A) N, which maps velocities of bodies to normal velocities: v_n = J v.
///
/// Row i has (n, r_a x n) in the columns of body a of contact i, (-n, -r_b x n) in those of body b,
/// and zeros elsewhere.
pub fn jacobian<T: Scalar, const L: usize, const A: usize>(system: &System<T, L, A>) -> Matrix {
    rows(system, 1)
}

/// Returns the Jacobian of contacts with friction, k L x (L + A) N: L rows per contact, along its
/// normal and its tangents.
pub fn friction_jacobian<T: Scalar, const L: usize, const A: usize>(
    system: &System<T, L, A>,
) -> Matrix {
    rows(system, L)
}

/// Returns the Jacobian of the rows of joints, one for each of [`System::axes`]: J_a in the columns of
/// body a, J_b in those of body b. The columns of a joint to the world, which has its body twice,
/// add up.
pub fn joint_jacobian<T: Scalar, const L: usize, const A: usize>(
    system: &System<T, L, A>,
) -> Matrix {
    let mut entries = Vec::new();
    for joint in &system.joints {
        for row in joint.axes() {
            for (body, jacobian) in joint.bodies.into_iter().zip(&system.axes[row].jacobian) {
                let column = (L + A) * body as usize;
                let values = jacobian.linear.0.into_iter().chain(jacobian.angular.0);
                let nonzero = values.enumerate().filter(|(_, x)| *x != T::ZERO);
                entries.extend(nonzero.map(|(i, x)| Entry::new(row, column + i, x.to_f64())));
            }
        }
    }
    matrix(system.axes.len(), (L + A) * system.velocities.len(), &entries)
}

/// Returns M^-1, block diagonal: for each body m^-1 on L diagonal entries, then its A x A inverse
/// inertia in world axes. A fixed body has no entries.
pub fn inverse_mass<T: Scalar, const L: usize, const A: usize>(system: &System<T, L, A>) -> Matrix {
    let width = L + A;
    let mut entries = Vec::new();
    for (body, mass) in system.masses.iter().enumerate() {
        let (first, linear) = (width * body, mass.linear.to_f64());
        if linear != 0.0 {
            entries.extend((0..L).map(|i| Entry::new(first + i, first + i, linear)));
        }
        let angular = mass.angular.0.map(|row| row.map(T::to_f64));
        if angular.iter().flat_map(|row| row.0).any(|x| x != 0.0) {
            for i in 0..A {
                let row = first + L + i;
                entries.extend((0..A).map(|j| Entry::new(row, first + L + j, angular[i][j])));
            }
        }
    }
    matrix(width * system.masses.len(), width * system.masses.len(), &entries)
}

/// Returns A = J M^-1 J^T, k x k: the normal velocity of contact i from a unit impulse at contact
/// j. It is symmetric and positive semidefinite, and without compliance; A_ii = 1 / m_eff of a
/// rigid contact.
pub fn system_matrix<T: Scalar, const L: usize, const A: usize>(
    system: &System<T, L, A>,
) -> Matrix {
    let jacobian = jacobian(system);
    let transposed = jacobian.transpose().to_row_major().expect("as large as J");
    &jacobian * (inverse_mass(system) * transposed)
}

/// Returns A + E, the matrix of soft contacts: positive definite if every epsilon is positive.
pub fn soften(a: &Matrix, compliance: &Column) -> Matrix {
    let k = compliance.nrows();
    let diagonal: Vec<_> = (0..k).map(|i| Entry::new(i, i, compliance[i])).collect();
    a + matrix(k, k, &diagonal)
}
