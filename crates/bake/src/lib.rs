//! Scenes from file to motion.

// At most one error is made per file, so its size does not matter.
#![allow(clippy::result_large_err)]

pub mod audit;
pub mod check;
pub mod convert;
pub mod decomposition;
mod engine;
mod error;
mod forms;
pub mod recording;
mod settings;
mod simulation;

pub use decomposition::{Decomposition, Decompositions, Deviation, decompose};
pub use engine::{Drystone, read, read_json, read_toml};
pub use error::BuildError;
pub use recording::{Recording, Sampling};
pub use settings::settings;
pub use simulation::{Simulation, build, build_with};
