//! [`Assembly`]: a [`System`] as matrices, which becomes a [`Problem`], and the way back.

use faer::{Mat, Side};

use super::problem::{coupled, product, same, transposed};
use super::{
    Matrix, Problem, ProblemError, friction_jacobian, from_entries, inverse_mass, joint_jacobian,
    velocities,
};
use crate::law::{Cone, Interval, Law};
use crate::{Scalar, System, Vector};

/// Eigenvalues of a block of M below this fraction of its largest count as zero. \[1\]
const ZERO: f64 = 1e-12;

/// Bodies, contacts and rows of joints of a [`System`] as matrices: find r with
///
/// v+ = v* + M^-1 J^T r, u = J v+ - t + E r, K ∋ r ⊥ u + mu |u_t| n ∈ K*,
///
/// where K is the [`Cone`] of each contact. Rows of joints follow the contacts, each with the law
/// of an [`Interval`]. So u of the [`Problem`] is the velocity of a
/// contact beyond its target, positive along the normal from b to a, and J^T is the H of FCLIB. u
/// includes the yield E r of soft contacts.
///
/// Contacts and rows that nothing can move are left out; no method for a [`System`] changes them. The
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
    /// The rows of joints.
    pub rows: JointRows,
}

/// Rows of joints of an [`Assembly`].
#[derive(Clone, Debug)]
pub struct JointRows {
    /// J, which maps velocities to the rows: J_a in the columns of body a, J_b in those of b.
    pub jacobian: Matrix,
    /// Targets, bounds and compliance of each row.
    pub laws: Vec<Interval<f64>>,
    /// gamma_0 of each row: the initial guess. \[N s, N m s\]
    pub guess: Vec<f64>,
    /// Index in the system of each row.
    pub axes: Vec<usize>,
}

impl JointRows {
    /// No rows, for bodies with this number of velocities.
    ///
    /// # Errors
    /// The number is too large for a matrix.
    pub fn none(columns: usize) -> Result<Self, ProblemError> {
        let jacobian = from_entries(0, columns, &[])?;
        Ok(Self { jacobian, laws: Vec::new(), guess: Vec::new(), axes: Vec::new() })
    }

    fn of_system<T: Scalar, const L: usize, const A: usize>(
        system: &System<T, L, A>,
    ) -> Result<Self, ProblemError> {
        let moves = |row: &usize| system.axes[*row].effective_mass > T::ZERO;
        let axes: Vec<_> =
            system.joints.iter().flat_map(|joint| joint.axes()).filter(moves).collect();
        let jacobian = joint_jacobian(system);
        if let Some(i) = jacobian.val().iter().position(|x| !x.is_finite()) {
            return Err(ProblemError::NotFinite("J of the joints", i));
        }
        Ok(Self {
            jacobian: rows_of(&jacobian, axes.iter().copied())?,
            laws: axes.iter().map(|&row| system.axes[row].cast().law).collect(),
            guess: axes.iter().map(|&row| system.axes[row].impulse.to_f64()).collect(),
            axes,
        })
    }

    /// Returns the law of a row with a finite target at 0, for use in a [`Problem`], and that
    /// target.
    fn centered(law: &Interval<f64>) -> (Interval<f64>, f64) {
        let origin = law.targets.into_iter().find(|target| target.is_finite()).unwrap_or(0.0);
        (Interval { targets: law.targets.map(|target| target - origin), ..*law }, origin)
    }
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
            rows: JointRows::of_system(system)?,
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

    /// Returns the problem W = J M^-1 J^T + E, q = J v* - t; only the normals of contacts if none
    /// has friction. For a row of a joint t is a target of it that is finite.
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

    /// Builds the problem from all rows, or from the normal row of each contact and the rows of
    /// joints.
    fn rows_as_problem(&self, dimension: usize) -> Result<Problem, ProblemError> {
        self.check()?;
        let step = if dimension == 1 { self.dimension } else { 1 };
        let kept = (0..self.targets.len()).step_by(step);
        let jacobian = below(&self.jacobian, kept.clone(), &self.rows.jacobian)?;
        let (laws, origins): (Vec<_>, Vec<_>) =
            self.rows.laws.iter().map(JointRows::centered).unzip();
        let n = jacobian.nrows();
        let soft = kept.clone().map(|row| self.compliance[row]);
        let soft = soft.chain(laws.iter().map(|law| law.compliance));
        let soft = soft.enumerate().map(|(i, epsilon)| (i, i, epsilon));
        let inverse = pseudo_inverse(&self.mass, "M")?;
        let rigid = &jacobian * (inverse * transposed(&jacobian)?);
        let matrix = rigid + from_entries(n, n, &soft.collect::<Vec<_>>())?;
        let free = product(&jacobian, &self.velocities);
        let targets = kept.map(|row| self.targets[row]).chain(origins);
        let offset = free.iter().zip(targets).map(|(u, target)| u - target).collect();
        Problem::with_rows((dimension, self.friction.clone()), laws, matrix, offset)
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
        let joint_rows = self.rows.laws.len();
        same("J of the joints", self.rows.jacobian.nrows(), joint_rows)?;
        same("a row of J of the joints", self.rows.jacobian.ncols(), columns)?;
        same("gamma_0 of the joints", self.rows.guess.len(), joint_rows)?;
        same("M", self.mass.nrows(), columns)?;
        same("a row of M", self.mass.ncols(), columns)
    }

    /// Returns the guess as impulses of the [`Problem`].
    pub fn warm(&self, problem: &Problem) -> Vec<f64> {
        let step = if problem.dimension() == 1 { self.dimension } else { 1 };
        self.guess.iter().step_by(step).chain(&self.rows.guess).copied().collect()
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

    /// Returns the sum over contacts and rows of the loss of r against the response to the velocity.
    fn losses<const D: usize>(&self, problem: &Problem, r: &[f64]) -> f64 {
        let u = problem.velocities(r);
        let ((u, u_rows), (r, r_rows)) = (problem.split_rows(&u), problem.split_rows(r));
        let mut gap = 0.0;
        for ((u, r), law) in u_rows.iter().zip(r_rows).zip(&self.rows.laws) {
            let (law, _) = JointRows::centered(law);
            let r = law.clamp(Vector([*r]));
            gap += law.loss(Vector([*u]) - law.soften(r), r);
        }
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

    /// Stores the impulses r of the [`Problem`] in the contacts and axes of the system. Velocities do
    /// not change; see [`System::apply_impulses`].
    pub fn give_back<T: Scalar, const L: usize, const A: usize>(
        &self,
        r: &[f64],
        system: &mut System<T, L, A>,
    ) {
        for contact in &mut system.contacts {
            contact.impulse = Vector::ZERO;
        }
        for axis in &mut system.axes {
            axis.impulse = T::ZERO;
        }
        let (r, rows) = r.split_at(r.len() - self.rows.axes.len());
        for (&r, &axis) in rows.iter().zip(&self.rows.axes) {
            system.axes[axis].impulse = T::from_f64(r);
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

/// Returns these rows of a matrix, and all rows of another below them.
fn below(
    above: &Matrix,
    kept: impl Iterator<Item = usize>,
    below: &Matrix,
) -> Result<Matrix, ProblemError> {
    let (mut entries, mut count) = (Vec::new(), 0);
    for (matrix, row) in kept.map(|row| (above, row)).chain((0..below.nrows()).map(|i| (below, i)))
    {
        let values = matrix.col_idx_of_row(row).zip(matrix.val_of_row(row));
        entries.extend(values.map(|(column, &x)| (count, column, x)));
        count += 1;
    }
    from_entries(count, above.ncols(), &entries)
}

/// Returns these rows of a matrix, in this order.
fn rows_of(matrix: &Matrix, kept: impl Iterator<Item = usize>) -> Result<Matrix, ProblemError> {
    below(matrix, kept, &from_entries(0, matrix.ncols(), &[])?)
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
