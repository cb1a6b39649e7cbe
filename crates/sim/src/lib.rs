//! Particles and rigid bodies with contact, in 2D and 3D.

pub mod recording;
pub mod scene;
mod settings;

pub use settings::StepSettings;
