//! [`Assembly`]: a [`System`] as matrices, from which a [`Problem`] is made, and the way back.

use faer::{Mat, Side};

use super::problem::{coupled, product, transposed};
use super::{
    Matrix, Problem, ProblemError, friction_jacobian, from_entries, inverse_mass, jacobian,
    velocities,
};
use crate::cone::Law;
use crate::{Scalar, System, Vector};

/// Eigenvalues of a block of M below this part of its largest are zero. \[1\]
const ZERO: f64 = 1e-12;

/// Bodies and contacts of a [`System`] as matrices: find r with
///
/// v+ = v* + M^-1 J^T r, u = J v+ - t + E r, K ∋ r ⊥ u + mu |u_t| n ∈ K*,
///
/// the law that [`cone`](crate::cone) states for one contact. So u of the [`Problem`] is by how much
/// a contact separates faster than its target, positive along the normal from b to a, and J^T is the
/// H of FCLIB. What the soft contacts give way, E r, is part of u.
///
/// Contacts at which nothing can move are left out, as all methods over a [`System`] leave them
/// alone. The impulses of collisions ([`Contact::impact`](crate::Contact::impact)) that friction may
/// lean on besides are not part of this form.
#[derive(Clone, Debug)]
pub struct Assembly {
    /// Rows of a contact: 1 if none has friction, else the dimension of space.
    pub dimension: usize,
    /// M, zero for what nothing can move, and along what is locked. \[kg, kg m^2\]
    pub mass: Matrix,
    /// J, from velocities to contacts: for each the normal first, then the tangents.
    pub jacobian: Matrix,
    /// v*: what the velocities are without contacts. \[m/s, rad/s\]
    pub velocities: Vec<f64>,
    /// t of each row. \[m/s\]
    pub targets: Vec<f64>,
    /// epsilon of each row, the diagonal of E. \[1/kg\]
    pub compliance: Vec<f64>,
    /// mu of each contact. \[1\]
    pub friction: Vec<f64>,
    /// gamma_0 of each row: a guess. \[N s\]
    pub guess: Vec<f64>,
    /// Which contact of the system each contact is.
    pub contacts: Vec<usize>,
}

impl Assembly {
    /// Of a prepared system whose velocities are the prospective ones and whose impulses are a guess
    /// that is not yet applied to them.
    ///
    /// # Errors
    /// A number of the system is not finite.
    pub fn of_system<T: Scalar, const L: usize, const A: usize>(
        system: &System<T, L, A>,
    ) -> Result<Self, ProblemError> {
        let rough = system.manifolds.iter().any(|manifold| manifold.friction > T::ZERO);
        let dimension = if rough { L } else { 1 };
        let all = if rough { friction_jacobian(system) } else { jacobian(system) };
        let mass = pseudo_inverse(&inverse_mass(system), "M^-1")?;
        let v = velocities(system);
        let mut assembly = Self {
            dimension,
            mass,
            jacobian: all,
            velocities: (0..v.nrows()).map(|i| v[i]).collect(),
            targets: Vec::new(),
            compliance: Vec::new(),
            friction: Vec::new(),
            guess: Vec::new(),
            contacts: Vec::new(),
        };
        for manifold in &system.manifolds {
            for i in manifold.points() {
                let contact = &system.contacts[i];
                if let Some(law) = Law::of(manifold, contact) {
                    assembly.add(i, &law, contact.target.cast(), contact.impulse.cast());
                }
            }
        }
        assembly.keep_rows()?;
        Ok(assembly)
    }

    fn add<const L: usize>(
        &mut self,
        contact: usize,
        law: &Law,
        target: Vector<f64, L>,
        impulse: Vector<f64, L>,
    ) {
        self.contacts.push(contact);
        self.friction.push(law.friction);
        for row in 0..self.dimension {
            self.targets.push(target[row]);
            self.guess.push(impulse[row]);
            self.compliance.push(if row == 0 { law.normal } else { law.tangential });
        }
    }

    /// Leaves only the rows of `contacts` in J.
    fn keep_rows(&mut self) -> Result<(), ProblemError> {
        let (d, all) = (self.dimension, &self.jacobian);
        let mut entries = Vec::new();
        for (place, contact) in self.contacts.iter().enumerate() {
            for k in 0..d {
                let row = d * contact + k;
                let values = all.col_idx_of_row(row).zip(all.val_of_row(row));
                entries.extend(values.map(|(column, &x)| (d * place + k, column, x)));
            }
        }
        self.jacobian = from_entries(d * self.contacts.len(), all.ncols(), &entries)?;
        Ok(())
    }

    /// W = J M^-1 J^T + E and q = J v* - t.
    ///
    /// # Errors
    /// Sizes do not fit, or a number is not finite.
    pub fn problem(&self) -> Result<Problem, ProblemError> {
        let (rows, columns) = (self.targets.len(), self.velocities.len());
        let size = |what, is, accepted| {
            if is == accepted { Ok(()) } else { Err(ProblemError::Size(what, is, accepted)) }
        };
        size("J", self.jacobian.nrows(), rows)?;
        size("a row of J", self.jacobian.ncols(), columns)?;
        size("M", self.mass.nrows(), columns)?;
        size("a row of M", self.mass.ncols(), columns)?;
        size("eps", self.compliance.len(), rows)?;
        let inverse = pseudo_inverse(&self.mass, "M")?;
        let soft: Vec<_> = self.compliance.iter().enumerate().map(|(i, &e)| (i, i, e)).collect();
        let rigid = &self.jacobian * (inverse * transposed(&self.jacobian)?);
        let matrix = rigid + from_entries(rows, rows, &soft)?;
        let free = product(&self.jacobian, &self.velocities);
        let offset = free.iter().zip(&self.targets).map(|(u, t)| u - t).collect();
        Problem::new(self.dimension, self.friction.clone(), matrix, offset)
    }

    /// Gives the impulses r of the [`Problem`] to the contacts of the system; not to its velocities,
    /// for which there is [`System::apply_impulses`].
    pub fn give_back<T: Scalar, const L: usize, const A: usize>(
        &self,
        r: &[f64],
        system: &mut System<T, L, A>,
    ) {
        for contact in &mut system.contacts {
            contact.impulse = Vector::ZERO;
        }
        for (r, &contact) in r.chunks_exact(self.dimension).zip(&self.contacts) {
            for (k, &r) in r.iter().enumerate() {
                system.contacts[contact].impulse[k] = T::from_f64(r);
            }
        }
    }
}

impl Problem {
    /// The problem of a system: [`Assembly::of_system`], [`Assembly::problem`].
    ///
    /// # Errors
    /// A number of the system is not finite.
    pub fn of_system<T: Scalar, const L: usize, const A: usize>(
        system: &System<T, L, A>,
    ) -> Result<Self, ProblemError> {
        Assembly::of_system(system)?.problem()
    }
}

/// The inverse of a symmetric matrix on what it does not map to zero (Moore and Penrose), block by
/// block. Its name is for the error: an entry is not finite.
fn pseudo_inverse(matrix: &Matrix, name: &'static str) -> Result<Matrix, ProblemError> {
    if let Some(i) = matrix.val().iter().position(|x| !x.is_finite()) {
        return Err(ProblemError::NotFinite(name, i));
    }
    let mut entries = Vec::new();
    for rows in coupled(matrix) {
        let entry = |i: usize, j: usize| matrix.get(rows[i], rows[j]).copied().unwrap_or(0.0);
        if rows.len() == 1 {
            if entry(0, 0) != 0.0 {
                entries.push((rows[0], rows[0], 1.0 / entry(0, 0)));
            }
            continue;
        }
        let block = Mat::from_fn(rows.len(), rows.len(), entry);
        let eigen = block.self_adjoint_eigen(Side::Lower);
        let eigen = eigen.map_err(|_| ProblemError::Mass(rows[0]))?;
        let (values, axes) = (eigen.S().column_vector(), eigen.U());
        let largest = (0..rows.len()).map(|k| values[k]).fold(0.0, f64::max);
        for (i, &row) in rows.iter().enumerate() {
            for (j, &column) in rows.iter().enumerate() {
                let part = |k: usize| axes[(i, k)] * axes[(j, k)] / values[k];
                let kept = (0..rows.len()).filter(|&k| values[k] > ZERO * largest);
                entries.push((row, column, kept.map(part).sum()));
            }
        }
    }
    from_entries(matrix.nrows(), matrix.ncols(), &entries)
}
