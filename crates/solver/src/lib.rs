//! Systems of contacts: velocities, masses, contacts; no shapes, poses, files or clocks.

mod body;
mod contact;
pub mod pgs;
mod real;
pub mod restitution;
mod system;
mod vector;

pub use body::{InverseMass, Velocity};
pub use contact::{Contact, Manifold, contact_frame};
pub use real::{Real, Scalar};
pub use system::{Repair, System};
pub use vector::{SymmetricMatrix, Vector, moment, spin};
