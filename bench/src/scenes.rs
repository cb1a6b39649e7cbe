//! Selection of the scenes to run: files, folders, or scenes made in code.

use std::path::{Path, PathBuf};

use drystone_bake::read;

use crate::case::Case;
use crate::made::{self, made};
use crate::mechanisms::{self, mechanism};

/// Steps of a scene that states none.
const STEPS: usize = 600;

/// Returns the scenes of files and folders, or those made in code if there are no paths: without
/// joints, or with `joints`. If `names` are given, returns only scenes with one of these names.
///
/// # Errors
/// A file is no scene, or no scene has one of the names.
pub(crate) fn cases(
    paths: &[PathBuf],
    names: &[String],
    joints: bool,
) -> Result<Vec<Case>, String> {
    let make = |name: &str| made(name).or_else(|| mechanism(name));
    let mut cases: Vec<Case> = match (paths, names) {
        ([], []) if joints => mechanisms::NAMES.iter().filter_map(|name| make(name)).collect(),
        ([], []) => made::NAMES.iter().filter_map(|name| make(name)).collect(),
        ([], names) => names.iter().filter_map(|name| make(name)).collect(),
        _ => Vec::new(),
    };
    for path in paths {
        if path.is_dir() {
            for file in scene_files(path)? {
                cases.push(from_file(&file)?);
            }
        } else {
            cases.push(from_file(path)?);
        }
    }
    for name in names {
        if !cases.iter().any(|case| case.name == *name) {
            let known: Vec<&str> = match paths {
                [] => made::NAMES.into_iter().chain(mechanisms::NAMES).collect(),
                _ => cases.iter().map(|case| case.name.as_str()).collect(),
            };
            return Err(format!("there is no scene {name}; the scenes are: {}", known.join(", ")));
        }
    }
    cases.retain(|case| names.is_empty() || names.contains(&case.name));
    Ok(cases)
}

/// Returns the scene files of a folder, sorted by name.
fn scene_files(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let unreadable = |error| format!("{}: cannot be read: {error}", folder.display());
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let extension = path.extension().and_then(|name| name.to_str()).unwrap_or("");
        if ["json", "toml", "gltf", "glb"].contains(&extension) {
            files.push(path);
        }
    }
    files.sort();
    if files.is_empty() {
        return Err(format!("{}: has no .json, .toml, .gltf or .glb file", folder.display()));
    }
    Ok(files)
}

fn from_file(file: &Path) -> Result<Case, String> {
    let read = read(file).map_err(|error| error.to_string())?;
    let stem = file.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    Ok(Case {
        name: stem.unwrap_or_default(),
        file: Some(file.to_owned()),
        steps: read.scene.steps.map_or(STEPS, |steps| steps as usize),
        scene: read.scene,
        stand_tolerance: stand_tolerance(file),
    })
}

/// Reads `extras.stand_tolerance` of a scene, which the simulation ignores and tools may read.
/// \[m\]
fn stand_tolerance(file: &Path) -> Option<f64> {
    #[derive(serde::Deserialize)]
    struct File {
        extras: Extras,
    }
    #[derive(serde::Deserialize)]
    struct Extras {
        stand_tolerance: f64,
    }
    let text = std::fs::read_to_string(file).ok()?;
    let read: File = match file.extension()?.to_str()? {
        "json" => serde_json::from_str(&text).ok()?,
        "toml" => toml::from_str(&text).ok()?,
        _ => return None,
    };
    Some(read.extras.stand_tolerance)
}
