//! Particles and rigid bodies with contact, in 2D and 3D.

mod bodies;
mod broad_phase;
mod cache;
mod certifier;
pub mod check;
pub mod geometry;
mod ledger;
mod motion;
mod narrow_phase;
pub mod recording;
mod report;
mod rows;
mod saved;
pub mod scene;
mod settings;
mod simulation;
mod world;

pub use bodies::{Body, BodyId, Collider, Inertia};
pub use drystone_solver::jam::Jam;
pub use drystone_solver::ladder::{Outcome, Rung};
pub use drystone_solver::restitution::ImpactLaw;
pub use ledger::Ledger;
pub use report::{Measure, Nearby, Stage, StepReport};
pub use saved::SavedSystem;
#[cfg(feature = "assembled")]
pub use saved::{SavedContact, SavedProblem};
pub use settings::StepSettings;
pub use simulation::{BuildError, Simulation, build};
pub use world::{Checkpoint, CheckpointError, World};

/// Rigid bodies in the plane.
pub type World2 = World<geometry::Rigid2, 2, 1>;
/// Rigid bodies in space.
pub type World3 = World<geometry::Rigid3, 3, 3>;
/// Particles in the plane.
pub type ParticleWorld2 = World<geometry::Spheres, 2, 0>;
/// Particles in space.
pub type ParticleWorld3 = World<geometry::Spheres, 3, 0>;
