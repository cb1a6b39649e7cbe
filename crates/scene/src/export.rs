//! Scenes in formats other than our own: as glTF with physics and as OpenUSD, and what recordings
//! of motion share with them.

mod buffer;
mod color;
pub mod gltf;
mod joint;
mod mesh;
mod nodes;
pub mod usd;

pub use buffer::{GltfBuffer, Use, float_accessor, float_bytes, write_glb};
pub use nodes::{DeformingNode, DrawnScene, Nodes, add_scene};
