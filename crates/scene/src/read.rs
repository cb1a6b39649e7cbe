//! [`Read`]: the result of every reader.

use super::description::Scene;
use super::error::Warning;
use super::gltf::Source;
use super::usd::StageSource;

/// Result of reading a scene file.
#[derive(Clone, Debug, PartialEq)]
pub struct Read {
    /// The scene.
    pub scene: Scene,
    /// Parts of the file that have no effect, or another effect than one may expect.
    pub warnings: Vec<Warning>,
    /// For glTF: the data needed to write the file again with an animation.
    pub source: Option<Source>,
    /// For OpenUSD: the data needed to write a layer over the stage.
    pub stage: Option<StageSource>,
}
