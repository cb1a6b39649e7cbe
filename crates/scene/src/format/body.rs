//! Reads bodies, their mass properties and their tracks.

use std::collections::HashMap;

use super::cursor::{FieldCursor, Number, Range, SPIN, TableCursor, VELOCITY, nearest_known};
use super::setup::{POSITION, Setup};
use super::shape::read_shape;
use super::surface::{SurfaceFields, read_filter, read_surface, read_surface_velocity};
use super::tree::one_line;
use crate::description::{Body, Mass, Motion, Rotation, Shape, SurfaceVelocity, Track};
use crate::error::SceneError;

pub(crate) const BODY_KEYS: &[&str] = &[
    "name",
    "motion",
    "position",
    "rotation",
    "linear_velocity",
    "angular_velocity",
    "gravity_factor",
    "linear_damping",
    "angular_damping",
    "force",
    "start_asleep",
    "surface_velocity",
    "density",
    "mass",
    "center_of_mass",
    "inertia",
    "inertia_rotation",
    "material",
    "friction",
    "restitution",
    "rolling_resistance",
    "spinning_resistance",
    "friction_combine",
    "restitution_combine",
    "collision",
    "shapes",
    "track",
    "extras",
];
pub(crate) const KEY_KEYS: &[&str] = &["time", "position", "rotation"];

const DAMPING: Range = Range::new(0.0, 1e6, "1/s");
const FORCE: Range = Range::new(-1e20, 1e20, "N");
const MASS: Range = Range::new(1e-12, 1e15, "kg").or_infinite();
const INERTIA: Range = Range::new(1e-20, 1e20, "kg m^2").or_infinite();

/// Distance from the origin beyond which single precision is coarser than the contact tolerances.
/// \[m\]
const FAR: f64 = 1e4;

/// Returns the body as messages call it: `body 'ball'`, or `body 3` by its index.
pub(super) fn body_name(index: usize, name: Option<&str>) -> String {
    match name {
        Some(name) => format!("body '{}'", one_line(name)),
        None => format!("body {index}"),
    }
}

pub(super) fn read_body(
    field: &FieldCursor<'_>,
    index: usize,
    setup: &Setup,
    names: &mut HashMap<String, usize>,
) -> Result<Body, SceneError> {
    let owner = body_name(index, field.open(BODY_KEYS, &"")?.peek("name"));
    let table = &field.table(BODY_KEYS, &owner)?;
    let dimension = setup.dimension;
    let motion = table.get("motion").map_or(Ok(Motion::Dynamic), |field| {
        field.choice(&[
            ("dynamic", Motion::Dynamic),
            ("static", Motion::Static),
            ("kinematic", Motion::Kinematic),
        ])
    })?;
    let name = read_name(table, index, names)?;
    let position = table.vector_or("position", &POSITION, vec![0.0; dimension])?;
    let rotation = table
        .get("rotation")
        .map_or(Ok(Rotation::identity(dimension)), |field| field.rotation(dimension))?;
    let named = read_material(table, setup)?;
    let own = read_surface(table)?;
    let body = Body {
        name,
        motion,
        linear_velocity: table.vector_or("linear_velocity", &VELOCITY, vec![0.0; dimension])?,
        angular_velocity: read_spin(table, dimension)?,
        mass: read_mass(table, motion, dimension, own.density.or(named.density))?,
        gravity_factor: table.real_or("gravity_factor", &Range::new(-1e6, 1e6, ""), 1.0)?,
        linear_damping: table.real_or("linear_damping", &DAMPING, 0.0)?,
        angular_damping: table.real_or("angular_damping", &DAMPING, 0.0)?,
        force: table.vector_or("force", &FORCE, vec![0.0; dimension])?,
        start_asleep: read_start_asleep(table, motion)?,
        surface_velocity: read_surface_velocity(table, dimension)?,
        shapes: read_shapes(table, motion, setup, &own.over(&named))?,
        track: read_track(table, motion, dimension, &position, rotation)?,
        position,
        rotation,
    };
    warn_of_idle_values(table, &body);
    Ok(body)
}

fn read_name(
    table: &TableCursor<'_>,
    index: usize,
    names: &mut HashMap<String, usize>,
) -> Result<Option<String>, SceneError> {
    let Some(field) = table.get("name") else {
        return Ok(None);
    };
    let name = field.text()?.to_owned();
    match names.insert(name.clone(), index) {
        None => Ok(Some(name)),
        Some(other) => {
            Err(field.refuse(format_args!("a name of its own: body {other} has this one already")))
        }
    }
}

fn read_spin(table: &TableCursor<'_>, dimension: usize) -> Result<Vec<f64>, SceneError> {
    match table.get("angular_velocity") {
        Some(field) if dimension == 2 => Ok(vec![field.real(&SPIN)?]),
        _ => table.vector_or(
            "angular_velocity",
            &SPIN,
            vec![0.0; if dimension == 3 { 3 } else { 1 }],
        ),
    }
}

fn read_material(table: &TableCursor<'_>, setup: &Setup) -> Result<SurfaceFields, SceneError> {
    let Some(field) = table.get("material") else {
        return Ok(SurfaceFields::default());
    };
    let name = field.text()?;
    setup.materials.get(name).cloned().ok_or_else(|| {
        let known: Vec<_> = setup.materials.keys().map(|name| one_line(name)).collect();
        if known.is_empty() {
            return field.refuse("the name of a material; the scene has no materials");
        }
        let nearest = nearest_known(name, &known).replace("known key", "material");
        field.refuse(format_args!("the name of a material; {nearest}"))
    })
}

fn read_mass(
    table: &TableCursor<'_>,
    motion: Motion,
    dimension: usize,
    density: Option<f64>,
) -> Result<Mass, SceneError> {
    let mass = table.get("mass");
    if let (Some(field), Some(_)) = (mass, table.get("density")) {
        return Err(field.refuse("either mass or density, not both"));
    }
    let total = mass.map(|field| field.real(&MASS)).transpose()?;
    if let (Some(field), Some(f64::INFINITY), false) = (mass, total, motion == Motion::Dynamic) {
        return Err(field.refuse("inf for dynamic bodies only; leave it out here"));
    }
    let center = table.get("center_of_mass");
    let axes = table.get("inertia_rotation");
    if let (Some(field), true) = (axes, dimension == 2) {
        return Err(field.refuse("nothing: in 2D, inertia is one number"));
    }
    Ok(Mass {
        density: if total.is_some() { None } else { density },
        mass: total,
        center: center.map(|field| field.vector(dimension, &POSITION)).transpose()?,
        inertia: read_inertia(table, dimension)?,
        inertia_rotation: axes.map(|field| field.quaternion()).transpose()?,
    })
}

fn read_inertia(table: &TableCursor<'_>, dimension: usize) -> Result<Option<Vec<f64>>, SceneError> {
    let Some(field) = table.get("inertia") else {
        return Ok(None);
    };
    if dimension == 2 {
        return Ok(Some(vec![field.real(&INERTIA)?]));
    }
    let inertia = field.vector(3, &INERTIA)?;
    let largest = inertia.iter().copied().fold(0.0, f64::max);
    let sum: f64 = inertia.iter().sum();
    if largest.is_finite() && largest > (sum - largest) * (1.0 + 1e-6) {
        field.warn("is impossible: one moment exceeds the sum of the others");
    }
    Ok(Some(inertia))
}

fn read_shapes(
    table: &TableCursor<'_>,
    motion: Motion,
    setup: &Setup,
    surface: &SurfaceFields,
) -> Result<Vec<Shape>, SceneError> {
    let filter =
        table.get("collision").map(|f| read_filter(&f, table, &setup.systems)).transpose()?;
    let read = |field: &FieldCursor<'_>| {
        let items = field.items("a list of shapes")?.enumerate();
        let read = |(i, item): (usize, FieldCursor<'_>)| {
            read_shape(&item, i, table, motion, setup, surface, filter.unwrap_or_default())
        };
        items.map(read).collect::<Result<Vec<_>, _>>()
    };
    match table.get("shapes") {
        None if motion == Motion::Dynamic => table.require("shapes", NEEDS_SHAPE).map(|_| vec![]),
        None => Ok(Vec::new()),
        Some(field) if motion == Motion::Dynamic && field.is_empty() => {
            Err(field.refuse(NEEDS_SHAPE))
        }
        Some(field) => read(&field),
    }
}

const NEEDS_SHAPE: &str = "at least one shape for a dynamic body";

fn read_track(
    table: &TableCursor<'_>,
    motion: Motion,
    dimension: usize,
    position: &[f64],
    rotation: Rotation,
) -> Result<Track, SceneError> {
    let mut track = Track::default();
    let Some(field) = table.get("track") else {
        return Ok(track);
    };
    if motion == Motion::Static {
        return Err(field.refuse("a track on a kinematic or dynamic body only"));
    }
    for (i, item) in field.items("a list of keys")?.enumerate() {
        let owner = table.nested(format!("key {i} of the track"));
        let key = item.table(KEY_KEYS, &owner)?;
        track.times.push(read_time(&key, track.times.last())?);
        track.positions.push(key.vector_or("position", &POSITION, position.to_vec())?);
        let turned = key.get("rotation").map(|field| field.rotation(dimension)).transpose()?;
        track.rotations.push(turned.unwrap_or(rotation));
    }
    Ok(track)
}

/// Reads the time of a key, after the `last` one. \[s\]
pub(super) fn read_time(key: &TableCursor<'_>, last: Option<&f64>) -> Result<f64, SceneError> {
    let time = key.require("time", "a number of seconds")?;
    let seconds = time.real(&Range::new(-1e9, 1e9, "s"))?;
    match last.filter(|last| seconds <= **last) {
        Some(last) => Err(time.refuse(format_args!("times that rise: above {}", Number(*last)))),
        None => Ok(seconds),
    }
}

fn read_start_asleep(table: &TableCursor<'_>, motion: Motion) -> Result<bool, SceneError> {
    let Some(field) = table.get("start_asleep") else {
        return Ok(false);
    };
    let asleep = field.boolean()?;
    if asleep && (motion != Motion::Dynamic || table.get("track").is_some()) {
        return Err(field.refuse("true for dynamic bodies without a track only"));
    }
    Ok(asleep)
}

fn warn_of_idle_values(table: &TableCursor<'_>, body: &Body) {
    let warn = |key: &'static str, what: &str| {
        if let Some(field) = table.get(key) {
            field.warn(what);
        }
    };
    let moves = |x: &[f64]| x.iter().any(|x| *x != 0.0);
    let idle = match body.motion {
        Motion::Dynamic if body.start_asleep => Some("does not act: the body starts asleep"),
        Motion::Dynamic if body.track.times.len() < 2 => None,
        Motion::Static => Some("does not act: the body is static"),
        Motion::Kinematic if body.track.times.is_empty() => None,
        Motion::Dynamic | Motion::Kinematic => Some("does not act: the body follows its track"),
    };
    if let Some(why) = idle {
        if moves(&body.linear_velocity) {
            warn("linear_velocity", why);
        }
        if moves(&body.angular_velocity) {
            warn("angular_velocity", why);
        }
    }
    if body.motion != Motion::Dynamic {
        let mass = ["mass", "density", "center_of_mass", "inertia", "inertia_rotation"];
        for key in mass.into_iter().chain(["linear_damping", "angular_damping", "force"]) {
            warn(key, "does not act: the body is not dynamic");
        }
    }
    let runs = body.surface_velocity.as_ref().is_some_and(SurfaceVelocity::runs);
    let mut shapes = body.shapes.iter();
    if runs && shapes.all(|of| of.surface_velocity.is_some() || of.material.friction == 0.0) {
        warn("surface_velocity", "does not act: no shape of the body has it and friction");
    }
    if body.position.iter().any(|x| x.abs() > FAR) {
        warn(
            "position",
            "is more than 10 km from the origin, where single precision is coarser than 1 mm",
        );
    }
}
