//! Sixteen manifolds at a time: a [`System`](crate::System) packed into [`Lanes`](crate::lanes::Lanes), color by
//! color.
//!
//! The kernels are those of [`pgs`](crate::pgs), run on a number that is sixteen numbers. The
//! velocities of the bodies are gathered once per visit to a block and serve all its points.

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
