//! [`Engine`]: services that readers and writers need of the engine that simulates a scene.

use serde_json::{Map, Value};

use super::description::Shape;

/// An engine that simulates scenes. It knows its settings, and measures shapes.
///
/// Each method has a default, that of [`NoEngine`].
pub trait Engine: Sync {
    /// Checks the table `solver` of a scene.
    ///
    /// # Errors
    /// The first setting that does not exist or is out of range.
    fn check_settings(&self, _solver: &Map<String, Value>) -> Result<(), SettingFault> {
        Ok(())
    }

    /// Adds up the masses of the shapes of a 3D body.
    ///
    /// # Errors
    /// Why there is no mass, as the rest of a sentence about the body.
    fn solid(&self, _parts: &[(&Shape, Weight)]) -> Result<Solid, &'static str> {
        Err("its colliders differ in mass or density, which no engine adds up")
    }

    /// Returns the convex hull of points in single precision; `None` if it has no volume.
    fn hull(&self, _points: &[[f32; 3]]) -> Option<Hull> {
        None
    }
}

/// No engine: any settings are accepted, and no shape is measured.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoEngine;

impl Engine for NoEngine {}

/// Refusal of a setting.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SettingFault {
    /// Name of the setting.
    pub key: String,
    /// True if no setting has this name.
    pub unknown: bool,
    /// Accepted values, or advice.
    pub accepted: String,
}

impl SettingFault {
    /// Returns the setting as messages call it.
    pub fn item(&self) -> String {
        if self.unknown {
            format!("unknown key '{}' of solver", self.key)
        } else {
            format!("{} of solver", self.key)
        }
    }
}

/// Mass of a shape, stated directly or by a density.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Weight {
    /// Density. \[kg/m^3\]
    Density(f64),
    /// Mass. \[kg\]
    Mass(f64),
}

/// Mass properties of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solid {
    /// Mass. \[kg\]
    pub mass: f64,
    /// Center of mass in the body's frame. \[m\]
    pub center: [f64; 3],
    /// Inertia about the center. \[kg m^2\]
    pub inertia: [[f64; 3]; 3],
}

/// Convex hull of points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hull {
    /// Corners, each one of the points. \[m\]
    pub vertices: Vec<[f32; 3]>,
    /// Triangles, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}
