//! Placeholder until the glTF reader is merged, which replaces this file as a whole.

use std::path::Path;

use super::{Place, Read, SceneError};

/// Reads a scene from `.gltf` or `.glb`.
///
/// # Errors
/// Always.
pub fn read(file: &Path) -> Result<Read, SceneError> {
    Err(SceneError {
        file: file.to_owned(),
        place: Place::File,
        item: "glTF".to_owned(),
        value: "not supported yet".to_owned(),
        accepted: "accepted: .toml, .json".to_owned(),
        unreadable: false,
    })
}
