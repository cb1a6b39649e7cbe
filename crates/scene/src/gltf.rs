//! Reader of glTF 2.0 with `KHR_physics_rigid_bodies` and `KHR_implicit_shapes`, or with the OMI
//! extensions.
//!
//! Files are not trusted: every index, length, path and number is checked before use, and every
//! error names its position.

#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects
    )
)]
// An error ends the reading of a file, so its size does not matter.
#![allow(clippy::result_large_err)]

mod accessors;
mod animation;
mod container;
mod glb;
mod joints;
mod json;
mod meshes;
mod nodes;
mod physics;
mod shapes;
mod shared_joints;
mod source;
mod tables;
mod unknown;

pub use animation::BAKED;
pub use container::contained;
pub use source::{BodyNode, Source};

use std::path::Path;

use self::accessors::Accessors;
use self::animation::Animation;
use self::joints::JointReader;
use self::json::Cursor;
use self::meshes::Meshes;
use self::physics::GltfBodies;
use self::tables::Dialect;
use super::description::Scene;
use super::engine::Engine;
use super::error::{Place, SceneError, Warning};
use super::graph::own_words;
use super::read::Read;

/// Reads a scene from a `.gltf` or `.glb` file.
///
/// # Errors
///
/// If the file cannot be read, breaks the rules of glTF or of the physics extensions, or describes
/// no physics.
pub fn read(file: &Path, engine: &dyn Engine) -> Result<Read, SceneError> {
    let mut warnings = Vec::new();
    let mut container = container::open(file, &mut warnings)?;
    let document = std::mem::take(&mut container.document);
    let root = Cursor::root(&document, file);
    check_head(&root, &mut warnings)?;

    let folder = file.parent().unwrap_or(Path::new("")).to_path_buf();
    let buffers = container::buffers(&root, &folder, &mut container)?;
    let accessors = Accessors::read(&root, &buffers)?;
    let meshes = Meshes::read(&root, &accessors)?;
    let nodes = nodes::read(&root, meshes.len(), &mut warnings)?;
    let animation = Animation::read(&root, &accessors, &nodes, &mut warnings)?;

    let Some(dialect) = Dialect::find(&root)? else {
        return Err(SceneError {
            file: file.to_path_buf(),
            place: Place::File,
            item: "glTF without physics".into(),
            value: String::new(),
            accepted: "give nodes a 'motion' and a 'collider' of the extension \
                       KHR_physics_rigid_bodies, with shapes of KHR_implicit_shapes"
                .into(),
            unreadable: false,
        });
    };
    if dialect == Dialect::Khronos
        && let Some(other) = root
            .list("extensionsUsed")?
            .iter()
            .find(|e| e.value.as_str() == Some(Dialect::Omi.bodies()))
    {
        warnings.push(Warning {
            place: other.place(),
            message: format!(
                "{} is ignored beside {}",
                Dialect::Omi.bodies(),
                Dialect::Khronos.bodies()
            ),
        });
    }
    let tables = tables::read(&root, dialect, meshes.len(), &mut warnings)?;
    let builder = GltfBodies {
        nodes: &nodes,
        meshes: &meshes,
        tables: &tables,
        animation: &animation,
        dialect,
    };
    let (bodies, body_nodes) = builder.bodies(&mut warnings)?;
    if bodies.is_empty() {
        warnings.push(Warning {
            place: Place::File,
            message: "no node of the scene has a collider that acts: there is nothing to simulate"
                .into(),
        });
    }
    let joints = JointReader {
        nodes: &nodes,
        tables: &tables,
        animation: &animation,
        dialect,
        bodies: &bodies,
        body_nodes: &body_nodes,
    };
    let joints = joints.read(&mut warnings)?;
    unknown::count_unknown(&mut warnings);
    let scene = Scene { name: scene_name(&root)?, bodies, joints, ..own(&root, engine)? };
    let source = Source { document, buffers, folder, bodies: body_nodes };
    Ok(Read { scene, warnings, source: Some(source), stage: None })
}

/// Reads settings that no extension can express from the extras of the document.
fn own(root: &Cursor<'_>, engine: &dyn Engine) -> Result<Scene, SceneError> {
    let own = root.own()?;
    let text = own.as_ref().map_or_else(|| "{}".to_owned(), |own| own.value.to_string());
    let at = own.as_ref().unwrap_or(root);
    own_words(&text, engine).map_err(|(item, accepted)| at.fault(item, accepted))
}

/// Checks version, required extensions, and that every extension is an object.
fn check_head(root: &Cursor<'_>, warnings: &mut Vec<Warning>) -> Result<(), SceneError> {
    let version = root.require("asset")?.require("version")?;
    let (major, minor) = version.text()?.split_once('.').unwrap_or_default();
    if major != "2" || minor.is_empty() || !minor.bytes().all(|c| c.is_ascii_digit()) {
        return Err(version.error("\"2.0\" is accepted"));
    }
    if let Some(least) = root.require("asset")?.get("minVersion")?
        && least.text()? != "2.0"
    {
        return Err(least.error("\"2.0\" is accepted"));
    }
    for extension in root.list("extensionsRequired")? {
        if !harmless(extension.text()?) {
            return Err(extension.error("a file that does not require this extension is accepted"));
        }
    }
    for extension in root.list("extensionsUsed")? {
        let name = extension.text()?;
        let physical = name.contains("physics") || name.contains("vehicle");
        if physical && !harmless(name) || name == "EXT_mesh_gpu_instancing" {
            warnings.push(Warning {
                place: extension.place(),
                message: format!("{name} is not simulated"),
            });
        }
    }
    if let Some(extensions) = root.get("extensions")? {
        for key in extensions.object()?.keys() {
            extensions.require(key)?.object()?;
        }
    }
    Ok(())
}

/// Returns true if a file that requires this extension can be simulated anyway.
fn harmless(extension: &str) -> bool {
    const KNOWN: [&str; 8] = [
        "KHR_implicit_shapes",
        "KHR_physics_rigid_bodies",
        "OMI_physics_body",
        "OMI_physics_shape",
        "OMI_physics_joint",
        "KHR_mesh_quantization",
        "KHR_lights_punctual",
        "KHR_xmp_json_ld",
    ];
    // Extensions that only change the appearance of surfaces.
    const LOOKS: [&str; 6] = [
        "KHR_materials_",
        "KHR_texture_",
        "EXT_texture_",
        "MSFT_texture_",
        "EXT_lights_",
        "ADOBE_materials_",
    ];
    KNOWN.contains(&extension) || LOOKS.iter().any(|prefix| extension.starts_with(prefix))
}

fn scene_name(root: &Cursor<'_>) -> Result<Option<String>, SceneError> {
    let scenes = root.list("scenes")?;
    let index = root.get("scene")?.map_or(Ok(0), |s| s.index(scenes.len(), "scenes"))?;
    let name = match scenes.get(index) {
        Some(scene) => scene.get("name")?,
        None => None,
    };
    Ok(name.map(|n| n.text()).transpose()?.map(String::from))
}

#[cfg(test)]
mod tests;
