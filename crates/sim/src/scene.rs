//! A scene as people and programs write it, and its formats.
//!
//! [`Scene`] is the one description that every reader produces and every world is built from.
//! SI units, right-handed, +y up. Vectors have as many components as the scene has dimensions.

// An error is made once per file: its size does not matter.
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

/// Reads a scene from a file: `.toml`, `.json`, `.gltf`, `.glb`, `.usda` or `.usd`, in upper or lower
/// case.
///
/// # Errors
/// [`SceneError::unreadable`] if the operating system does not give the file; otherwise what is
/// wrong in it.
pub fn read(path: &Path) -> Result<Read, SceneError> {
    let extension = path.extension().and_then(|name| name.to_str()).unwrap_or("");
    match extension.to_ascii_lowercase().as_str() {
        "toml" => format::read_toml(path, &file::read_text(path)?),
        "json" => format::read_json(path, &file::read_text(path)?),
        "gltf" | "glb" => gltf::read(path),
        // Binary ones are refused there, with what to do.
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
