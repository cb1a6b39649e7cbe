//! Objects shared by nodes: shapes, materials, filters and joints of the document.

use std::collections::BTreeMap;

use super::super::description::{Combine, Filter, Material};
use super::super::error::{SceneError, Warning};
use super::super::graph::FAR;
use super::super::graph::implicit::Implicit;
use super::json::Cursor;
use super::shapes;
use super::shared_joints::{self, SharedJoint};
use super::unknown::warn_unknown;

/// The family of extensions that a file uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Dialect {
    Khronos,
    Omi,
}

impl Dialect {
    /// Returns the name of the extension for bodies, materials and filters.
    pub(super) fn bodies(self) -> &'static str {
        match self {
            Self::Khronos => "KHR_physics_rigid_bodies",
            Self::Omi => "OMI_physics_body",
        }
    }

    fn shapes(self) -> &'static str {
        match self {
            Self::Khronos => "KHR_implicit_shapes",
            Self::Omi => "OMI_physics_shape",
        }
    }

    /// Returns the dialect of a file; `None` if it has no physics.
    pub(super) fn find(root: &Cursor<'_>) -> Result<Option<Self>, SceneError> {
        for dialect in [Self::Khronos, Self::Omi] {
            for name in [dialect.bodies(), dialect.shapes()] {
                let used = root.list("extensionsUsed")?;
                if used.iter().any(|e| e.value.as_str() == Some(name))
                    || root.extension(name)?.is_some()
                {
                    return Ok(Some(dialect));
                }
            }
            for node in root.list("nodes")? {
                if node.extension(dialect.bodies())?.is_some() {
                    return Ok(Some(dialect));
                }
            }
        }
        Ok(None)
    }
}

/// The shared objects.
#[derive(Default)]
pub(super) struct SharedObjects {
    pub(super) shapes: Vec<Implicit>,
    pub(super) materials: Vec<Material>,
    pub(super) filters: Vec<Filter>,
    pub(super) joints: Vec<SharedJoint>,
    /// Joints of `OMI_physics_joint`.
    pub(super) omi_joints: Vec<SharedJoint>,
}

/// Surface of a collider without a material.
pub(super) const PLAIN: Material = Material {
    friction: 0.6,
    restitution: 0.0,
    rolling_resistance: 0.0,
    spinning_resistance: 0.0,
    friction_combine: Combine::Average,
    restitution_combine: Combine::Average,
};

pub(super) fn read(
    root: &Cursor<'_>,
    dialect: Dialect,
    meshes: usize,
    warnings: &mut Vec<Warning>,
) -> Result<SharedObjects, SceneError> {
    let mut tables = SharedObjects::default();
    if let Some(extension) = root.extension(shared_joints::OMI)? {
        warn_unknown(&extension, &["physicsJoints"], warnings);
        for joint in extension.list("physicsJoints")? {
            tables.omi_joints.push(shared_joints::read(&joint, warnings)?);
        }
    }
    if let Some(extension) = root.extension(dialect.shapes())? {
        warn_unknown(&extension, &["shapes"], warnings);
        let defaults = if dialect == Dialect::Omi { shapes::OMI } else { shapes::KHRONOS };
        for shape in extension.list("shapes")? {
            tables.shapes.push(shapes::read(&shape, defaults, meshes)?);
            warn_unknown_of_shape(&shape, warnings)?;
        }
    }
    let Some(extension) = root.extension(dialect.bodies())? else { return Ok(tables) };
    warn_unknown(&extension, &["physicsMaterials", "collisionFilters", "physicsJoints"], warnings);
    for (index, material) in extension.list("physicsMaterials")?.iter().enumerate() {
        tables.materials.push(read_material(material, index, warnings)?);
    }
    let mut systems = BTreeMap::new();
    for filter in extension.list("collisionFilters")? {
        tables.filters.push(read_filter(&filter, &mut systems, warnings)?);
    }
    for joint in extension.list("physicsJoints")? {
        tables.joints.push(shared_joints::read(&joint, warnings)?);
    }
    Ok(tables)
}

/// Warns of unknown members of a shape.
fn warn_unknown_of_shape(
    shape: &Cursor<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<(), SceneError> {
    let kind = shape.require("type")?.text()?;
    warn_unknown(shape, &["name", "type", kind], warnings);
    let known: &[&str] = match kind {
        "sphere" => &["radius"],
        "box" => &["size"],
        "capsule" | "cylinder" => &["height", "radiusTop", "radiusBottom"],
        "plane" => &["sizeX", "sizeZ", "doubleSided"],
        _ => &["mesh"],
    };
    if let Some(own) = shape.get(kind)? {
        warn_unknown(&own, known, warnings);
    }
    Ok(())
}

fn read_material(
    cursor: &Cursor<'_>,
    index: usize,
    warnings: &mut Vec<Warning>,
) -> Result<Material, SceneError> {
    const KEYS: [&str; 6] = [
        "name",
        "staticFriction",
        "dynamicFriction",
        "restitution",
        "frictionCombine",
        "restitutionCombine",
    ];
    warn_unknown(cursor, &KEYS, warnings);
    let coefficient = |key: &str| -> Result<Option<f64>, SceneError> {
        cursor.get(key)?.map(|c| c.within(0.0, FAR)).transpose()
    };
    let name = match cursor.get("name")? {
        Some(name) => format!("physics material '{}'", name.text()?),
        None => format!("physics material {index}"),
    };
    let (fixed, sliding) = (coefficient("staticFriction")?, coefficient("dynamicFriction")?);
    if let (Some(fixed), Some(sliding)) = (fixed, sliding)
        && (fixed - sliding).abs() > 1e-6
    {
        warnings.push(Warning {
            place: cursor.place(),
            message: format!(
                "{name} has staticFriction {fixed} and dynamicFriction {sliding}: {sliding} acts, \
                 at rest and sliding"
            ),
        });
    }
    let mut restitution = coefficient("restitution")?.unwrap_or(0.0);
    if restitution > 1.0 {
        warnings.push(Warning {
            place: cursor.require("restitution")?.place(),
            message: format!("restitution {restitution} of {name} is taken as 1"),
        });
        restitution = 1.0;
    }
    let own = cursor.own()?;
    let mut combine = |key: &str| -> Result<Combine, SceneError> {
        let exact = own.as_ref().map(|own| own.get(key)).transpose()?.flatten();
        let geometric = exact.is_some_and(|exact| exact.value == "geometric_mean");
        let Some(cursor) = cursor.get(key)? else { return Ok(Combine::Average) };
        Ok(match cursor.text()? {
            // The exporter writes the geometric mean as average, the nearest rule of the extension.
            "average" if geometric => Combine::GeometricMean,
            "average" => Combine::Average,
            "minimum" => Combine::Minimum,
            "maximum" => Combine::Maximum,
            "multiply" => Combine::Multiply,
            other => {
                warnings.push(Warning {
                    place: cursor.place(),
                    message: format!("{key} '{other}' of {name} is unknown: 'average' acts"),
                });
                Combine::Average
            }
        })
    };
    let resistance = |key: &str| -> Result<f64, SceneError> {
        let of = own.as_ref().map(|own| own.get(key)).transpose()?.flatten();
        of.map_or(Ok(0.0), |of| of.within(0.0, FAR))
    };
    Ok(Material {
        friction: sliding.or(fixed).unwrap_or(PLAIN.friction),
        restitution,
        rolling_resistance: resistance("rollingResistance")?,
        spinning_resistance: resistance("spinningResistance")?,
        friction_combine: combine("frictionCombine")?,
        restitution_combine: combine("restitutionCombine")?,
    })
}

fn read_filter(
    cursor: &Cursor<'_>,
    systems: &mut BTreeMap<String, u32>,
    warnings: &mut Vec<Warning>,
) -> Result<Filter, SceneError> {
    const ONLY: &str = "collideWithSystems";
    const NOT: &str = "notCollideWithSystems";
    warn_unknown(cursor, &["name", "collisionSystems", ONLY, NOT], warnings);
    let mut bits = |key: &str| -> Result<Option<u64>, SceneError> {
        let Some(list) = cursor.get(key)? else { return Ok(None) };
        let mut bits = 0_u64;
        for name in list.items()? {
            let next = u32::try_from(systems.len()).unwrap_or(u32::MAX);
            let bit = *systems.entry(name.text()?.to_string()).or_insert(next);
            let mask = 1_u64.checked_shl(bit);
            bits |= mask.ok_or_else(|| name.error("up to 64 different systems are accepted"))?;
        }
        Ok(Some(bits))
    };
    let own = bits("collisionSystems")?;
    let (only, not) = (bits(ONLY)?, bits(NOT)?);
    let (collides_with, unnamed) = match (only, not) {
        (Some(_), Some(_)) => {
            return Err(cursor.fault(
                format!("collision filter with both {ONLY} and {NOT}"),
                "one of them is accepted",
            ));
        }
        (Some(only), None) => (only, false),
        (None, not) => (!not.unwrap_or(0), true),
    };
    Ok(Filter { systems: own.unwrap_or(0), collides_with, collides_with_unnamed: unnamed })
}
