//! Scenes from file to motion: read, checked, simulated, recorded and written.
//!
//! ```
//! use std::path::Path;
//!
//! use drystone::StepSettings;
//! use drystone_bake::{Recording, Sampling, build, check, read_toml, recording, settings};
//!
//! let text = r#"
//! bodies = [
//!     { motion = "static", shapes = [{ type = "halfspace", normal = [0, 1, 0] }] },
//!     { position = [0, 2, 0], shapes = [{ type = "sphere", radius = 0.5 }] },
//! ]
//! "#;
//! let read = read_toml(Path::new("ball.toml"), text)?;
//! let scene = &read.scene;
//! let settings = settings(scene, StepSettings::certified())?;
//! assert!(check::check(&read, &settings)?.is_empty());
//!
//! let mut simulation = build(scene, settings)?;
//! let mut bake = Recording::of(scene);
//! simulation.write_poses(&mut bake.poses);
//! for _ in 0..60 {
//!     let report = simulation.step(scene.time_step)?;
//!     assert!(report.certified.is_some_and(|of| of.error <= 1e-3)); // m/s
//!     simulation.write_poses(&mut bake.poses);
//! }
//! assert_eq!(bake.frames(), 61);
//! let folder = tempfile::tempdir()?;
//! recording::glb::write(&folder.path().join("ball.glb"), scene, &bake, &Sampling::default())?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | For | Look at |
//! |---|---|
//! | scenes from files | [`read`](fn@read), [`read_toml`], [`read_json`] |
//! | what will hurt in them | [`check::check`] |
//! | running scenes of any dimension | [`build`], [`Simulation`] |
//! | concave meshes as convex pieces | [`decompose`], [`Decompositions`] |
//! | motion to files | [`recording`] |
//! | a bake measured again | [`audit::audit`] |

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
