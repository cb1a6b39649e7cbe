//! The same system as matrices: J, M^-1, A = J M^-1 J^T and b, for study, tests and other solvers.
//! Feature `assembled`.
//!
//! [`pgs`](crate::pgs) never forms these matrices. They are here because the theory is written in
//! them, and because an independent computation is the best test of the matrix-free one: each sweep
//! of [`gauss_seidel`] over the rows of A gives the same impulses as
//! [`pgs::sweep_normals`](crate::pgs::sweep_normals).
//!
//! With k contacts, N bodies and D = L + A velocities per body:
//!
//! | | size | content of one block | from |
//! |---|---|---|---|
//! | v | D N | (v, omega) of a body | [`velocities`] |
//! | J | k x D N | (n, r_a x n) for body a, (-n, -r_b x n) for body b | [`jacobian`] |
//! | M^-1 | D N x D N | m^-1 on L diagonal entries, then W = I^-1 | [`inverse_mass`] |
//! | A | k x k | normal velocity i from a unit impulse j | [`system_matrix`] |
//! | E | k x k | epsilon on the diagonal | [`soften`] adds it to A |
//! | t, b | k | target velocities; b = t - J v | [`targets`], [`rhs`] |
//! | gamma | k | impulses | [`impulses`] |
//!
//! [`joint_jacobian`] has the rows of joints. A fixed body has an empty block of M^-1. So a wall has its columns in J (a moving wall pushes),
//! but couples no contacts in A.
//!
//! An [`Assembly`] is a whole system in this form: friction, compliance and rows of joints included.
//! It creates a [`Problem`], and stores the solution in the system.
//!
//! A [`Problem`] is any problem given as matrices, u = W r + q: contacts with or without friction,
//! then rows of joints with two targets and bounds. [`ladder::solve`] tries one method after the
//! other until the tolerance is reached, or reports why it is not.
//!
//! | method | with friction | rows of joints | use |
//! |---|---|---|---|
//! | [`block_gauss_seidel`] | yes | yes | first: cheap, and often sufficient |
//! | [`proximal`] | yes | yes | singular and ill-conditioned problems, to rounding |
//! | [`newton`] | no | no | general matrices |
//! | [`lemke`] | no | no | zero diagonals, any conditioning, some hundred contacts |
//! | [`enumeration`] | no | no | up to 16 contacts, any matrix |
//! | [`interior_point`] | convex model | yes | a reference |
//! | [`jam`] | no | no | proves that there is no solution |
//!
//! All numbers here are `f64`, converted before the first product, whatever the system's type.
//!
//! ```
//! use drystone_solver::assembled::{equality, gauss_seidel, rhs, system_matrix};
//! use drystone_solver::{
//!     ConstraintFrame, Contact, InverseMass, Manifold, System, Vector, Velocity, contact_frame,
//! };
//!
//! // Two balls of 1 kg meet, each at 1 m/s; the left one is body a, so n points to the left.
//! let mut system = System::<f64, 2, 0>::new();
//! let ball = InverseMass { linear: 1.0, ..InverseMass::FIXED };
//! let moving = |x| Velocity { linear: Vector([x, 0.0]), ..Velocity::ZERO };
//! let bodies = [system.add_body(moving(1.0), ball), system.add_body(moving(-1.0), ball)];
//! let axes = contact_frame(Vector([-1.0, 0.0]));
//! let frame = ConstraintFrame { axes, ..ConstraintFrame::default() };
//! let manifold = Manifold { bodies, frame, ..Manifold::default() };
//! system.add_manifold(manifold, &[Contact::default()]);
//!
//! let (a, b) = (system_matrix(&system), rhs(&system));
//! assert_eq!((a[(0, 0)], b[0]), (2.0, 2.0));
//! assert_eq!(equality::solve(&a, &b).unwrap().impulses[0], 1.0);
//! assert_eq!(gauss_seidel::solve(&a, &b, 1)[0], 1.0);
//! ```

mod assembly;
pub mod block_gauss_seidel;
mod block_lu;
mod blocks;
mod columns;
mod dense;
pub mod enumeration;
pub mod equality;
pub mod gauss_seidel;
pub mod interior_point;
pub mod jam;
pub mod ladder;
pub mod lemke;
mod local;
mod matrices;
pub mod newton;
mod outcome;
mod pattern;
mod problem;
pub mod proximal;

pub use assembly::{Assembly, JointRows};
pub use columns::{compliance, friction_impulses, impulses, rhs, targets, velocities};
pub use matrices::{
    Column, Matrix, friction_jacobian, inverse_mass, jacobian, joint_jacobian, soften,
    system_matrix,
};
pub use outcome::{Limits, Outcome, Sample, Status};
pub use pattern::{contacts_of, pattern};
pub use problem::{Bodies, Problem, ProblemError, from_entries};
