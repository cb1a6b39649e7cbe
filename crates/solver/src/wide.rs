//! Packed contact systems: a [`System`](crate::System) in [`Lanes`](crate::lanes::Lanes), sixteen
//! manifolds at a time, color by color.
//!
//! The kernels are those of [`pgs`](crate::pgs), run on a number type that holds sixteen numbers. A
//! visit to a block gathers the velocities of its bodies once, for all its points.

mod batch;
mod best;
mod block;
mod conjugate;
mod gather;
mod packed;
mod passes;
mod rows;
mod targets;
mod walk;

pub use batch::Batch;
pub use best::{Wide, WideBatch};
pub use packed::Packed;
pub use rows::{CachedImpulse, FAR, LaneSlots, ManifoldSource};
pub use targets::{Landing, MovedBodies};

pub use crate::color::Reuse;
