//! Systems of contacts: velocities, masses, contacts; no shapes, poses, files or clocks.

mod body;
pub mod color;
mod contact;
pub mod lanes;
pub mod pgs;
mod real;
pub mod restitution;
mod system;
mod vector;
pub mod wide;

pub use body::{InverseMass, Velocity};
pub use contact::{Contact, Manifold, contact_frame};
pub use real::{Real, Scalar};
pub use system::{Repair, System};
pub use vector::{SymmetricMatrix, Vector, moment, spin};
