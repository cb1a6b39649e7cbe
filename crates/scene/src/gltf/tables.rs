//! Objects shared by nodes: shapes, materials, filters and joints of the document.

use std::collections::BTreeMap;

use super::super::description::{Combine, Filter, Material};
use super::super::error::{SceneError, Warning};
use super::super::graph::FAR;
use super::super::graph::implicit::Implicit;
use super::json::Cursor;
use super::shapes;

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
pub(super) struct SharedObjects {
    pub(super) shapes: Vec<Implicit>,
    pub(super) materials: Vec<Material>,
    pub(super) filters: Vec<Filter>,
    pub(super) joints: usize,
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
    let mut tables =
        SharedObjects { shapes: Vec::new(), materials: Vec::new(), filters: Vec::new(), joints: 0 };
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
        check_joint(&joint, warnings)?;
        tables.joints = tables.joints.saturating_add(1);
    }
    Ok(tables)
}

/// Warns of unknown properties and extensions of an object.
pub(super) fn warn_unknown(cursor: &Cursor<'_>, known: &[&str], warnings: &mut Vec<Warning>) {
    for key in cursor.unknown(known) {
        warnings.push(Warning {
            place: cursor.place(),
            message: format!("'{key}' is not a property of {}{IGNORED}", kind_of(cursor)),
        });
    }
    // Extensions inside an extension.
    if let Some(inner) = cursor.value.get("extensions").and_then(|inner| inner.as_object()) {
        for name in inner.keys() {
            let message = format!("the extension {name} of {}{IGNORED}", kind_of(cursor));
            warnings.push(Warning { place: cursor.place(), message });
        }
    }
}

/// End of every warning about an unknown property or extension.
pub(super) const IGNORED: &str = " here: it is ignored";

/// Returns the name of an object without its index in a list.
fn kind_of(cursor: &Cursor<'_>) -> String {
    let name = cursor.name();
    name.split_once('[').map_or(name.clone(), |(list, _)| list.to_owned())
}

/// Keeps each warning about an unknown property once, and appends its number of occurrences.
pub(super) fn count_unknown(warnings: &mut Vec<Warning>) {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    warnings.retain(|warning| {
        if !warning.message.ends_with(IGNORED) {
            return true;
        }
        let count = counts.entry(warning.message.clone()).or_insert(0);
        *count = count.saturating_add(1);
        *count == 1
    });
    for warning in warnings {
        if let Some(count) = counts.get(&warning.message).filter(|count| **count > 1) {
            warning.message.push_str(&format!(" ({count} times)"));
        }
    }
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

/// Checks a joint. Joints are not simulated, but faults in them are errors.
fn check_joint(joint: &Cursor<'_>, warnings: &mut Vec<Warning>) -> Result<(), SceneError> {
    warn_unknown(joint, &["name", "limits", "drives"], warnings);
    let positive = |cursor: &Cursor<'_>, keys: &[&str]| -> Result<(), SceneError> {
        for key in keys {
            if let Some(number) = cursor.get(key)? {
                number.within(0.0, f64::MAX)?;
            }
        }
        Ok(())
    };
    for limit in joint.list("limits")? {
        const KEYS: [&str; 6] = ["linearAxes", "angularAxes", "min", "max", "stiffness", "damping"];
        warn_unknown(&limit, &KEYS, warnings);
        let (linear, angular) = (limit.get("linearAxes")?, limit.get("angularAxes")?);
        let axes = match (linear, angular) {
            (Some(axes), None) | (None, Some(axes)) => axes,
            _ => {
                return Err(limit.fault(
                    "joint limit",
                    "exactly one of 'linearAxes' and 'angularAxes' is accepted",
                ));
            }
        };
        for axis in axes.items()? {
            axis.index(3, "axes")?;
        }
        positive(&limit, &["stiffness", "damping"])?;
        for key in ["min", "max"] {
            limit.get(key)?.map(|c| c.number(f64::MAX)).transpose()?;
        }
    }
    for drive in joint.list("drives")? {
        const KEYS: [&str; 8] = [
            "type",
            "mode",
            "axis",
            "maxForce",
            "positionTarget",
            "velocityTarget",
            "stiffness",
            "damping",
        ];
        warn_unknown(&drive, &KEYS, warnings);
        drive.require("axis")?.index(3, "axes")?;
        drive.require("type")?.text()?;
        drive.require("mode")?.text()?;
        positive(&drive, &["maxForce", "stiffness", "damping"])?;
        for key in ["positionTarget", "velocityTarget"] {
            drive.get(key)?.map(|c| c.number(f64::MAX)).transpose()?;
        }
    }
    Ok(())
}
