//! Solver for systems of bodies, contacts and joints: velocities, masses, contacts, rows of joints;
//! no shapes, poses or files. [`System`] states the problem in six equations.
//!
//! A ball of 2 kg falls on the floor for 0.01 s. The contact takes the velocity from it:
//!
//! ```
//! use drystone_solver::{ConstraintFrame, Contact, InverseMass, Manifold, Repair, System};
//! use drystone_solver::{Vector, Velocity, contact_frame, pgs};
//!
//! let mut system = System::<f64, 2, 0>::new();
//! let floor = system.add_body(Velocity::ZERO, InverseMass::FIXED);
//! let falling = Velocity { linear: Vector([0.0, -9.81 * 0.01]), ..Velocity::ZERO };
//! let ball = system.add_body(falling, InverseMass { linear: 0.5, ..InverseMass::FIXED });
//! let axes = contact_frame(Vector([0.0, 1.0])); // the normal, from the floor to the ball
//! let frame = ConstraintFrame { axes, ..ConstraintFrame::default() };
//! let manifold = Manifold { bodies: [ball, floor], frame, friction: 0.5, ..Manifold::default() };
//! system.add_manifold(manifold, &[Contact::default()]);
//! system.prepare(0.0); // effective masses; rigid
//! let (rate, slop, max_repair_speed) = (0.2, 0.005, 1.0);
//! let repair = Repair { dt: 0.01, rate, slop, max_repair_speed, stick_rate: 0.0 };
//! system.set_targets(&[Velocity::ZERO; 2], &repair);
//! while system.residual(false) > 1e-12 {
//!     pgs::sweep(&mut system);
//! }
//! assert!((system.contacts[0].impulse[0] - 2.0 * 9.81 * 0.01).abs() < 1e-9); // N s
//! ```
//!
//! Proven bounds are in [`certificate`], laws of constraints in [`law`], stronger methods in
//! [`ladder`], impacts in [`restitution`], sixteen contacts side by side in [`lanes`]. Rows of
//! joints are [`Axis`], all joints of connected bodies as one block [`mechanism::Mechanisms`].
//! Features: `threads` (default), `serde`, and `assembled`: systems as sparse matrices, and methods
//! for problems given as such.

pub mod apgd;
#[cfg(feature = "assembled")]
pub mod assembled;
mod body;
pub mod certificate;
mod cholesky;
mod clock;
mod constraint;
mod contact;
mod elimination;
pub mod island;
pub mod jam;
mod joint;
pub mod kinematics;
pub mod ladder;
pub mod lanes;
pub mod law;
pub mod mechanism;
pub mod newton;
pub mod nncg;
mod part;
pub mod pgs;
mod primal;
#[cfg(feature = "assembled")]
pub mod proximal;
pub mod psor;
mod real;
mod registers;
pub mod restitution;
pub mod solution;
mod surface;
pub mod symmetric;
mod system;
pub mod thread_pool;
mod vector;

pub use body::{InverseMass, Mass, Velocity};
pub use clock::Clock;
pub use constraint::{ConstraintFrame, Mobility, contact_frame};
pub use contact::{Contact, Manifold, Repair};
pub use joint::{Axis, Joint};
pub use real::{Cast, Real, Scalar};
pub use surface::SurfaceEffects;
pub use system::System;
pub use vector::{SymmetricMatrix, Vector, moment, spin};
