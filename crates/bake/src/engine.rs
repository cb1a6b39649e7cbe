//! [`Drystone`], the engine that readers and writers of scenes ask, and readers that ask it.

use std::path::Path;

use drystone::StepSettings;
use drystone_scene::format::{read_json_with, read_toml_with};
use drystone_scene::{Engine, Hull, Read, SceneError, SettingFault, Shape, Solid, Weight};
use parry3d::math::Vector;
use serde_json::{Map, Value};

use crate::forms;
use crate::settings::merge;

/// Drystone as the [`Engine`] of scenes: its settings, masses and hulls.
#[derive(Clone, Copy, Debug, Default)]
pub struct Drystone;

impl Engine for Drystone {
    fn check_settings(&self, solver: &Map<String, Value>) -> Result<(), SettingFault> {
        merge(solver, StepSettings::default()).map(drop)
    }

    fn solid(&self, parts: &[(&Shape, Weight)]) -> Result<Solid, &'static str> {
        forms::compound(parts).ok_or("its colliders have no volume to have a mass")
    }

    fn hull(&self, points: &[[f32; 3]]) -> Option<Hull> {
        let points: Vec<Vector> = points.iter().map(|p| Vector::from(*p)).collect();
        let (vertices, triangles) = parry3d::transformation::try_convex_hull(&points).ok()?;
        Some(Hull { vertices: vertices.into_iter().map(|v| v.to_array()).collect(), triangles })
    }
}

/// Reads a scene from a file and checks its table `solver`
/// ([`drystone_scene::read_with`] with [`Drystone`]).
///
/// # Errors
/// Those of [`drystone_scene::read_with`].
pub fn read(path: &Path) -> Result<Read, SceneError> {
    drystone_scene::read_with(path, &Drystone)
}

/// Reads a scene from TOML and checks its table `solver`. `file` is used in messages only.
///
/// # Errors
/// Those of [`read_toml_with`].
pub fn read_toml(file: &Path, text: &str) -> Result<Read, SceneError> {
    read_toml_with(file, text, &Drystone)
}

/// Reads a scene from JSON and checks its table `solver`. `file` is used in messages only.
///
/// # Errors
/// Those of [`read_json_with`].
pub fn read_json(file: &Path, text: &str) -> Result<Read, SceneError> {
    read_json_with(file, text, &Drystone)
}
