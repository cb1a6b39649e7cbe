//! Scenes from file to motion: read, checked, simulated, recorded and written.
//!
//! ```
//! use std::path::Path;
//!
//! use drystone::StepSettings;
//! use drystone_bake::{Recording, Sampling, build, check, read_toml, recording, settings};
//!
//! let text = "bodies = [{ position = [0, 2, 0], shapes = [{ type = 'sphere', radius = 0.5 }] }]";
//! let read = read_toml(Path::new("ball.toml"), text)?;
//! let settings = settings(&read.scene, StepSettings::certified())?;
//! assert!(check::check(&read, &settings)?.is_empty());
//! let mut world = build(&read.scene, settings)?;
//! let mut bake = Recording::of(&read.scene);
//! world.write_poses(&mut bake.poses);
//! for _ in 0..60 {
//!     let report = world.step(read.scene.time_step)?;
//!     assert!(report.certified.is_some_and(|of| of.error <= 1e-3)); // m/s
//!     world.write_poses(&mut bake.poses);
//! }
//! let folder = tempfile::tempdir()?;
//! let file = folder.path().join("ball.glb");
//! recording::glb::write(&file, &read.scene, &bake, &Sampling::default())?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`AnyWorld`] runs any scene, and worlds made by hand, in 2D and 3D. [`read`](fn@read) opens
//! files, [`decompose`] makes convex pieces of meshes, [`audit::audit`] measures a bake again.
//! Features: `npz` (default, NumPy arrays), `threads` (default), `assembled` (saved systems as
//! matrices). Without threads it runs in a browser, on `wasm32-unknown-unknown`.

// At most one error is made per file, so its size does not matter.
#![allow(clippy::result_large_err)]

mod any_world;
pub mod audit;
pub mod check;
pub mod convert;
pub mod decomposition;
mod engine;
mod error;
mod forms;
mod input;
pub mod joints;
pub mod recording;
mod settings;
mod world_kind;

pub use any_world::{AnyCheckpoint, AnyWorld, PairImpulses, TouchingPairs, build, build_with};
pub use decomposition::{Decomposition, Decompositions, Deviation, decompose};
pub use engine::{Drystone, read, read_json, read_toml};
pub use error::BuildError;
pub use recording::{Recording, Sampling};
pub use settings::settings;
pub use world_kind::WorldKind;
