//! Reads surface properties and collision systems.

use std::cell::RefCell;
use std::collections::BTreeMap;

use super::cursor::{FieldCursor, Range, SPIN, TableCursor, VELOCITY};
use super::tree::one_line;
use crate::description::{Combine, Filter, Material, SurfaceVelocity};
use crate::error::SceneError;

pub(crate) const MATERIAL_KEYS: &[&str] = &[
    "density",
    "friction",
    "restitution",
    "rolling_resistance",
    "spinning_resistance",
    "friction_combine",
    "restitution_combine",
];
pub(crate) const SURFACE_VELOCITY_KEYS: &[&str] = &["linear", "angular", "local"];
pub(crate) const COLLISION_KEYS: &[&str] = &["systems", "collides_with", "not_collides_with"];

const DENSITY: Range = Range::new(1e-12, 1e15, "kg/m^3 (3D), kg/m^2 (2D)");

pub(crate) const COMBINE: [(&str, Combine); 5] = [
    ("average", Combine::Average),
    ("minimum", Combine::Minimum),
    ("maximum", Combine::Maximum),
    ("multiply", Combine::Multiply),
    ("geometric_mean", Combine::GeometricMean),
];

/// Surface properties stated by a material, a body or a shape.
#[derive(Clone, Default)]
pub(super) struct SurfaceFields {
    pub(super) density: Option<f64>,
    friction: Option<f64>,
    restitution: Option<f64>,
    rolling: Option<f64>,
    spinning: Option<f64>,
    friction_combine: Option<Combine>,
    restitution_combine: Option<Combine>,
}

impl SurfaceFields {
    /// Returns `self` with absent values taken from `other`.
    pub(super) fn over(&self, other: &SurfaceFields) -> SurfaceFields {
        SurfaceFields {
            density: self.density.or(other.density),
            friction: self.friction.or(other.friction),
            restitution: self.restitution.or(other.restitution),
            rolling: self.rolling.or(other.rolling),
            spinning: self.spinning.or(other.spinning),
            friction_combine: self.friction_combine.or(other.friction_combine),
            restitution_combine: self.restitution_combine.or(other.restitution_combine),
        }
    }

    pub(super) fn material(&self, particles: bool) -> Material {
        let default = default_material(particles);
        Material {
            friction: self.friction.unwrap_or(default.friction),
            restitution: self.restitution.unwrap_or(default.restitution),
            rolling_resistance: self.rolling.unwrap_or(default.rolling_resistance),
            spinning_resistance: self.spinning.unwrap_or(default.spinning_resistance),
            friction_combine: self.friction_combine.unwrap_or(default.friction_combine),
            restitution_combine: self.restitution_combine.unwrap_or(default.restitution_combine),
        }
    }
}

/// Returns the surface properties that apply where a scene states none.
pub(crate) fn default_material(particles: bool) -> Material {
    let material = Material::default();
    if particles { Material { friction: 0.0, ..material } } else { material }
}

pub(super) fn read_surface(table: &TableCursor<'_>) -> Result<SurfaceFields, SceneError> {
    let density = if table.knows("density") { table.get("density") } else { None };
    let combine = |key| table.get(key).map(|field| field.choice(&COMBINE)).transpose();
    let number =
        |key, max| table.get(key).map(|field| field.real(&Range::new(0.0, max, ""))).transpose();
    let length =
        |key| table.get(key).map(|field| field.real(&Range::new(0.0, 1e6, "m"))).transpose();
    Ok(SurfaceFields {
        density: density.map(|field| field.real(&DENSITY)).transpose()?,
        friction: number("friction", 1e6)?,
        restitution: number("restitution", 1.0)?,
        rolling: length("rolling_resistance")?,
        spinning: length("spinning_resistance")?,
        friction_combine: combine("friction_combine")?,
        restitution_combine: combine("restitution_combine")?,
    })
}

/// Reads the surface velocity of a body or shape: a linear velocity, or a table.
pub(super) fn read_surface_velocity(
    owner: &TableCursor<'_>,
    dimension: usize,
) -> Result<Option<SurfaceVelocity>, SceneError> {
    let Some(field) = owner.get("surface_velocity") else { return Ok(None) };
    let still = vec![0.0; if dimension == 3 { 3 } else { 1 }];
    if !field.is_table() {
        let linear = field.vector(dimension, &VELOCITY)?;
        return Ok(Some(SurfaceVelocity { linear, angular: still, local: true }));
    }
    let name = owner.nested("surface_velocity".to_owned());
    let table = field.table(SURFACE_VELOCITY_KEYS, &name)?;
    let angular = match table.get("angular") {
        Some(field) if dimension == 2 => vec![field.real(&SPIN)?],
        _ => table.vector_or("angular", &SPIN, still)?,
    };
    Ok(Some(SurfaceVelocity {
        linear: table.vector_or("linear", &VELOCITY, vec![0.0; dimension])?,
        angular,
        local: table.get("local").map_or(Ok(true), |field| field.boolean())?,
    }))
}

/// Collision systems by name. They are numbered in order of appearance. A scene that names them "0"
/// to "63" chooses the numbers itself.
#[derive(Default)]
pub(super) struct Systems {
    bits: BTreeMap<String, u32>,
    numbered: Option<bool>,
}

impl Systems {
    fn bit(&mut self, field: &FieldCursor<'_>) -> Result<u64, SceneError> {
        let name = field.text()?;
        let number = name.parse::<u32>().ok().filter(|number| number.to_string() == name);
        if *self.numbered.get_or_insert(number.is_some()) != number.is_some() {
            return Err(field.refuse("either names or numbers for all systems, not both"));
        }
        let next = self.bits.len() as u32;
        let bit = number.or(self.bits.get(name).copied()).unwrap_or(next);
        if bit >= 64 {
            let value = format!("\"{}\"", one_line(name));
            return Err(field.refuse_value(value, "at most 64 systems in a scene"));
        }
        self.bits.insert(name.to_owned(), bit);
        Ok(1 << bit)
    }
}

pub(super) fn read_filter(
    field: &FieldCursor<'_>,
    owner: &TableCursor<'_>,
    names: &RefCell<Systems>,
) -> Result<Filter, SceneError> {
    let owner = owner.nested("collision".to_owned());
    let table = field.table(COLLISION_KEYS, &owner)?;
    let mask = |field: &FieldCursor<'_>| {
        let items = field.items("a list of names of systems")?;
        items.map(|item| names.borrow_mut().bit(&item)).try_fold(0, |m, b| Ok(m | b?))
    };
    let systems = table.get("systems").map_or(Ok(0), |field| mask(&field))?;
    let filter = Filter { systems, ..Filter::default() };
    match (table.get("collides_with"), table.get("not_collides_with")) {
        (None, None) => Ok(filter),
        (Some(list), None) => {
            Ok(Filter { collides_with: mask(&list)?, collides_with_unnamed: false, ..filter })
        }
        (None, Some(list)) => Ok(Filter { collides_with: !mask(&list)?, ..filter }),
        (Some(_), Some(list)) => {
            Err(list.refuse("either collides_with or not_collides_with, not both"))
        }
    }
}
