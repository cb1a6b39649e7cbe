//! Scenes of bodies in contact: one description, whatever file it comes from.
//!
//! ```
//! use std::path::Path;
//!
//! use drystone_scene::{Body, Motion, ShapeKind, format::read_toml, to_json};
//!
//! let text = r#"
//! [[bodies]]
//! name = "ball"
//! position = [0, 2, 0]
//! shapes = [{ type = "sphere", radius = 0.5 }]
//! "#;
//! let mut scene = read_toml(Path::new("ball.toml"), text)?.scene;
//! let ground = ShapeKind::Halfspace { normal: vec![0.0, 1.0, 0.0] };
//! scene.bodies.push(Body::new(Motion::Static, [0.0; 3], ground));
//! assert!(to_json(&scene).contains("halfspace"));
//! # Ok::<(), drystone_scene::SceneError>(())
//! ```
//!
//! [`read`] takes a [`Scene`] from Drystone's own format (TOML, JSON), glTF 2.0 with physics, or
//! OpenUSD with UsdPhysics. [`to_toml`], [`to_json`] and [`export`] write it. SI units,
//! right-handed, +y up. Vectors have as many components as the scene has dimensions.
//!
//! Files are not trusted. A wrong value is refused with file, place, item, value and accepted range
//! ([`SceneError`]); input without effect is named ([`Warning`]). This crate knows no engine: what
//! depends on one, as settings and hulls, is asked of an [`Engine`], such as that of
//! `drystone-bake`. [`json_schema`] describes the own format.
//!
//! A new scene format is one module that produces a [`Read`], and one arm in [`read_with`]. A
//! writer of it is a module of [`export`].

// At most one error is made per file, so its size does not matter.
#![allow(clippy::result_large_err)]

mod description;
mod document;
mod engine;
mod error;
pub mod export;
pub mod file;
pub mod format;
pub mod gltf;
pub mod graph;
mod joint;
mod joint_limits;
mod read;
mod rotation;
pub mod schema;
pub mod solid_mesh;
mod solver;
pub mod usd;
mod vertex_track;
mod whole;
pub mod write;

use std::path::Path;

pub use vertex_track::{VertexTrack, VertexTrackFault};

pub use description::{
    BodiesAs, Body, Combine, Filter, Mass, Material, Motion, Rotation, Scene, Shape, ShapeKind,
    SurfaceVelocity, Track, WorldTrack,
};
pub use engine::{Engine, Hull, NoEngine, SettingFault, Solid, Weight};
pub use error::{Place, SceneError, Warning};
pub use file::open;
pub use format::shape::spans_space;
pub use joint::{Breaking, Coordinate, Drive, Joint, JointAxis, JointFrame, Softness};
pub use read::Read;

pub use schema::json_schema;
pub use solid_mesh::{DecompositionOptions, NotSolid, is_solid};
pub use whole::{sync_directory, write_whole};
pub use write::{to_json, to_toml};

/// Reads a scene from a file, without an engine: the table `solver` is not checked.
///
/// # Errors
/// Those of [`read_with`].
pub fn read(path: &Path) -> Result<Read, SceneError> {
    read_with(path, &NoEngine)
}

/// Reads a scene from a file. The extension is `.toml`, `.json`, `.gltf`, `.glb`, `.usda` or
/// `.usd`, in upper or lower case.
///
/// # Errors
/// [`SceneError::unreadable`] is set if the operating system does not provide the file. Otherwise
/// the error describes the first fault found in the file.
pub fn read_with(path: &Path, engine: &dyn Engine) -> Result<Read, SceneError> {
    let extension = path.extension().and_then(|name| name.to_str()).unwrap_or("");
    match extension.to_ascii_lowercase().as_str() {
        "toml" => format::read_toml_with(path, &file::read_text(path)?, engine),
        "json" => format::read_json_with(path, &file::read_text(path)?, engine),
        "gltf" | "glb" => gltf::read(path, engine),
        // `usd::read` refuses binary files and says how to convert them.
        "usda" | "usd" | "usdc" | "usdz" => usd::read(path, engine),
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
