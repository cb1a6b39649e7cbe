//! [`Assembly`]: a [`System`] as matrices, which becomes a [`Problem`], and the way back.

use faer::{Mat, Side};

use super::problem::{coupled, product, same, transposed};
use super::{
    Matrix, Problem, ProblemError, friction_jacobian, from_entries, inverse_mass, velocities,
};
use crate::law::{Cone, Law};
use crate::{Scalar, System, Vector};

/// Eigenvalues of a block of M below this fraction of its largest count as zero. \[1\]
const ZERO: f64 = 1e-12;

/// Bodies and contacts of a [`System`] as matrices: find r with
///
/// v+ = v* + M^-1 J^T r, u = J v+ - t + E r, K ∋ r ⊥ u + mu |u_t| n ∈ K*,
///
/// where K is the [`Cone`] of each contact. So u of the [`Problem`] is the velocity of a
/// contact beyond its target, positive along the normal from b to a, and J^T is the H of FCLIB. u
/// includes the yield E r of soft contacts.
///
/// Contacts that nothing can move are left out; no method for a [`System`] changes them. The
/// collision impulses ([`Contact::impact`](crate::Contact::impact)), which also bear friction, are
/// not part of this form.
#[derive(Clone, Debug)]
pub struct Assembly {
    /// Rows per contact: the dimension of space.
    pub dimension: usize,
    /// M, zero for fixed bodies and along locked directions. \[kg, kg m^2\]
    pub mass: Matrix,
    /// J, which maps velocities to contacts: for each the normal first, then the tangents.
    pub jacobian: Matrix,
    /// v*: the velocities without contacts. \[m/s, rad/s\]
    pub velocities: Vec<f64>,
    /// t of each row. \[m/s\]
    pub targets: Vec<f64>,
    /// epsilon of each row, the diagonal of E. \[1/kg\]
    pub compliance: Vec<f64>,
    /// mu of each contact. \[1\]
    pub friction: Vec<f64>,
    /// gamma_0 of each row: the initial guess. \[N s\]
    pub guess: Vec<f64>,
    /// Index in the system of each contact.
    pub contacts: Vec<usize>,
}

impl Assembly {
    /// Assembles a prepared system. Its velocities are the prospective ones; its impulses are a
    /// guess that is not yet applied to them.
    ///
    /// # Errors
    /// A number of the system is not finite.
    pub fn of_system<T: Scalar, const L: usize, const A: usize>(
        system: &System<T, L, A>,
    ) -> Result<Self, ProblemError> {
        if !system.joints.is_empty() {
            return Err(ProblemError::Joints);
        }
        let v = velocities(system);
        let mut assembly = Self {
            dimension: L,
            mass: pseudo_inverse(&inverse_mass(system), "M^-1")?,
            jacobian: friction_jacobian(system),
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
                if contact.effective_mass > T::ZERO {
                    let law = Cone::of(&manifold.cast(), &contact.cast());
                    assembly.add(i, &law, contact.impulse.cast());
                }
            }
        }
        let kept = assembly.contacts.iter().flat_map(|contact| L * contact..L * (contact + 1));
        assembly.jacobian = rows_of(&assembly.jacobian, kept)?;
        Ok(assembly)
    }

    fn add<const L: usize>(&mut self, contact: usize, law: &Cone<f64, L>, impulse: Vector<f64, L>) {
        self.contacts.push(contact);
        self.friction.push(law.friction);
        for row in 0..self.dimension {
            self.targets.push(law.target[row]);
            self.guess.push(impulse[row]);
            self.compliance.push(if row == 0 { law.normal } else { law.tangential });
        }
    }

    /// Returns the problem W = J M^-1 J^T + E, q = J v* - t; only its normal rows if no contact has
    /// friction.
    ///
    /// # Errors
    /// Sizes do not fit, or a number is not finite.
    pub fn problem(&self) -> Result<Problem, ProblemError> {
        let rough = self.friction.iter().any(|&mu| mu > 0.0);
        self.rows_as_problem(if rough { self.dimension } else { 1 })
    }

    /// Returns the problem with all rows, with or without friction.
    ///
    /// # Errors
    /// Those of [`Assembly::problem`].
    pub fn problem_in_space(&self) -> Result<Problem, ProblemError> {
        self.rows_as_problem(self.dimension)
    }

    /// Builds the problem from all rows, or from the normal row of each contact.
    fn rows_as_problem(&self, dimension: usize) -> Result<Problem, ProblemError> {
        self.check()?;
        let step = if dimension == 1 { self.dimension } else { 1 };
        let kept = (0..self.targets.len()).step_by(step);
        let jacobian = rows_of(&self.jacobian, kept.clone())?;
        let n = jacobian.nrows();
        let soft = kept.clone().enumerate().map(|(i, row)| (i, i, self.compliance[row]));
        let inverse = pseudo_inverse(&self.mass, "M")?;
        let rigid = &jacobian * (inverse * transposed(&jacobian)?);
        let matrix = rigid + from_entries(n, n, &soft.collect::<Vec<_>>())?;
        let free = product(&jacobian, &self.velocities);
        let offset = free.iter().zip(kept).map(|(u, row)| u - self.targets[row]).collect();
        Problem::new(dimension, self.friction.clone(), matrix, offset)
    }

    fn check(&self) -> Result<(), ProblemError> {
        if !(1..=3).contains(&self.dimension) {
            return Err(ProblemError::Dimension(self.dimension));
        }
        let (rows, columns) = (self.dimension * self.friction.len(), self.velocities.len());
        same("t", self.targets.len(), rows)?;
        same("eps", self.compliance.len(), rows)?;
        same("gamma_0", self.guess.len(), rows)?;
        same("J", self.jacobian.nrows(), rows)?;
        same("a row of J", self.jacobian.ncols(), columns)?;
        same("M", self.mass.nrows(), columns)?;
        same("a row of M", self.mass.ncols(), columns)
    }

    /// Returns the guess as impulses of the [`Problem`].
    pub fn warm(&self, problem: &Problem) -> Vec<f64> {
        let step = if problem.dimension() == 1 { self.dimension } else { 1 };
        self.guess.iter().copied().step_by(step).collect()
    }

    /// Returns G of the [`certificate`](crate::certificate) for the impulses r of the [`Problem`]
    /// and the velocities that they give. The error dv of these velocities has 1/2 dv . M dv <= G;
    /// with friction, for the current slip. G is infinite if a rigid contact (epsilon 0) misses its
    /// target. \[J\]
    pub fn gap(&self, r: &[f64]) -> f64 {
        let Ok(problem) = self.problem() else { return f64::INFINITY };
        match problem.dimension() {
            1 => self.losses::<1>(&problem, r),
            2 => self.losses::<2>(&problem, r),
            _ => self.losses::<3>(&problem, r),
        }
    }

    /// Returns the sum over the contacts of the loss of r against the response to the velocity.
    fn losses<const D: usize>(&self, problem: &Problem, r: &[f64]) -> f64 {
        let u = problem.velocities(r);
        let mut gap = 0.0;
        for (i, (u, r)) in u.chunks_exact(D).zip(r.chunks_exact(D)).enumerate() {
            let epsilon = &self.compliance[self.dimension * i..];
            let law = Cone::<f64, D> {
                friction: self.friction[i],
                impact: 0.0,
                normal: epsilon[0],
                tangential: epsilon[D - 1],
                target: Vector::ZERO,
                lowered: 0.0,
            };
            let r = law.clamp(Vector(std::array::from_fn(|k| r[k])));
            let u = Vector(std::array::from_fn(|k| u[k])) - law.soften(r);
            gap += law.shifted(u, r).loss(u, r);
        }
        if gap.is_nan() { f64::INFINITY } else { gap }
    }

    /// Stores the impulses r of the [`Problem`] in the contacts of the system. Velocities do not
    /// change; see [`System::apply_impulses`].
    pub fn give_back<T: Scalar, const L: usize, const A: usize>(
        &self,
        r: &[f64],
        system: &mut System<T, L, A>,
    ) {
        for contact in &mut system.contacts {
            contact.impulse = Vector::ZERO;
        }
        let d = r.len() / self.contacts.len().max(1);
        for (r, &contact) in r.chunks_exact(d.max(1)).zip(&self.contacts) {
            for (k, &r) in r.iter().enumerate() {
                system.contacts[contact].impulse[k] = T::from_f64(r);
            }
        }
    }
}

impl Problem {
    /// Creates the problem of a system: [`Assembly::of_system`], then [`Assembly::problem`].
    ///
    /// # Errors
    /// A number of the system is not finite.
    pub fn of_system<T: Scalar, const L: usize, const A: usize>(
        system: &System<T, L, A>,
    ) -> Result<Self, ProblemError> {
        Assembly::of_system(system)?.problem()
    }
}

/// Returns these rows of a matrix, in this order.
fn rows_of(matrix: &Matrix, kept: impl Iterator<Item = usize>) -> Result<Matrix, ProblemError> {
    let (mut entries, mut count) = (Vec::new(), 0);
    for row in kept {
        let values = matrix.col_idx_of_row(row).zip(matrix.val_of_row(row));
        entries.extend(values.map(|(column, &x)| (count, column, x)));
        count += 1;
    }
    from_entries(count, matrix.ncols(), &entries)
}

/// Returns the pseudo-inverse of a symmetric matrix (Moore and Penrose), block by block. `name` is
/// used in the error for an entry that is not finite.
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
