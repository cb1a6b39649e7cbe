//! [`BuildError`]: why a scene is not simulated.

use drystone::InputError;

/// Error: a world cannot be built from a scene.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BuildError {
    /// A shape does not exist in the scene's dimension, or has no volume.
    #[error("shape {shape} of {body}: {reason}")]
    Shape {
        /// Name of the body, or its index.
        body: String,
        /// Index of the shape.
        shape: usize,
        /// The problem, and the accepted values.
        reason: &'static str,
    },
    /// The world refuses a body.
    #[error("{body}: {error}")]
    Body {
        /// Name of the body, or its index.
        body: String,
        /// The problem, and the accepted values.
        error: InputError,
    },
    /// The world refuses a joint.
    #[error("{joint}: {error}")]
    Joint {
        /// Name of the joint, or its index.
        joint: String,
        /// The problem, and the accepted values.
        error: InputError,
    },
    /// The world refuses a step.
    #[error("{0}")]
    Step(#[from] InputError),
}
