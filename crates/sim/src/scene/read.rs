//! [`Read`]: what every reader hands over.

use super::description::Scene;
use super::error::Warning;
use super::gltf::source::Source;

/// What a reader makes of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Read {
    /// The scene.
    pub scene: Scene,
    /// What will not act, or acts differently than one may think.
    pub warnings: Vec<Warning>,
    /// For a glTF: what it takes to write it again with an animation.
    pub source: Option<Source>,
}
