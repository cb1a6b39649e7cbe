//! Contact systems in SIMD lanes: [`LaneSystem`], a [`System`](crate::System) of `f32` packed sixteen
//! manifolds at a time, color by color.
//!
//! The kernels are those of [`pgs`](crate::pgs), run on a number type that holds sixteen numbers
//! ([`Lanes`]). A visit to a block gathers the velocities of its bodies once, for all its points.
//! There is one storage. [`Instructions`] are chosen when a system is made, and passes over it view
//! its numbers in the registers of these instructions.
//!
//! Unsafe code of this crate is confined to the modules `number`, `avx2`, `view`, `block` and `sweep`
//! here, to `registers`, and to [`thread_pool`](crate::thread_pool).

#[cfg(target_arch = "x86_64")]
mod avx2;
mod batch;
mod block;
pub mod coloring;
mod conjugate;
mod motion;
mod number;
mod partition;
mod passes;
mod sweep;
mod system;
mod view;

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;
pub use batch::LaneBatch;
pub use block::{CachedImpulse, FAR, LaneSlots, ManifoldSource};
pub use coloring::Reuse;
pub use motion::{Landing, Lead, MovedBodies};
pub(crate) use number::lanes_of;
pub use number::{Doubles, GatherLanes, KernelLanes, LaneArray, Lanes, PART, Portable, Row, WIDTH};
pub use passes::Instructions;
pub use system::LaneSystem;
