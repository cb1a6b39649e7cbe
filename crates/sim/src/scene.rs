//! Scene descriptions and the file formats that hold them.
//!
//! Every reader produces a [`Scene`], and every world is built from one. SI units, right-handed, +y
//! up. Vectors have as many components as the scene has dimensions.

// At most one error is made per file, so its size does not matter.
#![allow(clippy::result_large_err)]

pub(crate) mod description;
mod document;
mod error;
pub(crate) mod file;
pub mod format;
pub mod gltf;
pub(crate) mod graph;
mod read;
pub mod schema;
mod settings;
pub mod usd;
pub mod write;

use std::path::Path;

pub use description::{
    BodiesAs, Body, Combine, Filter, Mass, Material, Motion, Rotation, Scene, Shape, ShapeKind,
    SurfaceVelocity, Track,
};
pub use error::{Place, SceneError, Warning};
pub use file::open;
pub use read::Read;
pub use schema::json_schema;
pub use write::{to_json, to_toml};

/// Reads a scene from a file. The extension is `.toml`, `.json`, `.gltf`, `.glb`, `.usda` or
/// `.usd`, in upper or lower case.
///
/// # Errors
/// [`SceneError::unreadable`] is set if the operating system does not provide the file. Otherwise
/// the error describes the first fault found in the file.
pub fn read(path: &Path) -> Result<Read, SceneError> {
    let extension = path.extension().and_then(|name| name.to_str()).unwrap_or("");
    match extension.to_ascii_lowercase().as_str() {
        "toml" => format::read_toml(path, &file::read_text(path)?),
        "json" => format::read_json(path, &file::read_text(path)?),
        "gltf" | "glb" => gltf::read(path),
        // `usd::read` refuses binary files and says how to convert them.
        "usda" | "usd" | "usdc" | "usdz" => usd::read(path),
        other => Err(SceneError {
            file: path.to_owned(),
            place: Place::File,
            item: "the format".to_owned(),
            value: if other.is_empty() { "not named".to_owned() } else { format!("\".{other}\"") },
            accepted: "accepted: .toml, .json, .gltf, .glb, .usda".to_owned(),
            unreadable: false,
        }),
    }
}
