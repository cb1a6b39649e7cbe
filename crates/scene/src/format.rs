//! Reader of Drystone's own scene format, in TOML and JSON.
//!
//! Both are parsed into the same tree (`tree`), and one walk over the tree builds the [`Scene`].
//! Every value is checked where it is read.
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects
    )
)]

pub(crate) mod body;
pub(super) mod cursor;
pub(crate) mod joint;
mod setup;
pub(super) mod shape;
pub(crate) mod surface;
mod tree;

use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use serde_json::Value;

use self::body::{read_body, read_time};
use self::cursor::{FieldCursor, Range, ReadContext, TableCursor};
use self::joint::read_joints;
use self::joint::setup::JointSetup;
use self::setup::Setup;
use self::surface::{SurfaceFields, Systems, read_surface};
use self::tree::{Text, Tree, TreeNode};
use super::description::{BodiesAs, Body, Motion, Scene, ShapeKind, WorldTrack};
use super::engine::{Engine, NoEngine, SettingFault};
use super::error::SceneError;
use super::read::Read;

pub use self::cursor::nearest_known;

pub(super) const SCENE_KEYS: &[&str] = &[
    "name",
    "dimension",
    "gravity",
    "time_step",
    "track",
    "steps",
    "duration",
    "bodies_as",
    "bodies",
    "materials",
    "solver",
    "joints",
    "events",
    "extras",
];

/// Longest time that a step simulates. \[s\]
const LONGEST_STEP: f64 = 1.0;
/// Accelerations of free fall that a scene may have.
const FALL: Range = Range::new(-1e6, 1e6, "m/s^2");
pub(super) const TIME_STEP: f64 = 1.0 / 60.0;
pub(super) const GRAVITY: f64 = -9.81;
const MAX_STEPS: u32 = 10_000_000;
const MAX_BODIES: usize = 10_000_000;

/// Reads a scene from TOML, without an engine: the table `solver` is not checked.
///
/// # Errors
/// Those of [`read_toml_with`].
pub fn read_toml(file: &Path, text: &str) -> Result<Read, SceneError> {
    read_toml_with(file, text, &NoEngine)
}

/// Reads a scene from JSON, without an engine: the table `solver` is not checked.
///
/// # Errors
/// Those of [`read_json_with`].
pub fn read_json(file: &Path, text: &str) -> Result<Read, SceneError> {
    read_json_with(file, text, &NoEngine)
}

/// Reads a scene from TOML.
///
/// `file` is used in messages only.
///
/// # Errors
/// The first fault in the text, with line and column.
pub fn read_toml_with(file: &Path, text: &str, engine: &dyn Engine) -> Result<Read, SceneError> {
    let text = Text::new(file, text);
    read_tree(text, &text.toml()?, false, engine)
}

/// Reads a scene from JSON.
///
/// `file` is used in messages only.
///
/// # Errors
/// The first fault in the text: a syntax error with line and column, any other with its JSON
/// pointer.
pub fn read_json_with(file: &Path, text: &str, engine: &dyn Engine) -> Result<Read, SceneError> {
    let text = Text::new(file, text);
    read_tree(text, &text.json()?, true, engine)
}

fn read_tree(
    text: Text<'_>,
    tree: &TreeNode<'_>,
    json: bool,
    engine: &dyn Engine,
) -> Result<Read, SceneError> {
    let walk = ReadContext { text, json, warnings: RefCell::default() };
    let scene = read_scene(&walk.root(tree, &""), engine)?;
    Ok(Read { scene, warnings: walk.warnings.into_inner(), source: None, stage: None })
}

fn read_scene(field: &FieldCursor<'_>, engine: &dyn Engine) -> Result<Scene, SceneError> {
    let table = field.table(SCENE_KEYS, &"")?;
    let dimension = match table.get("dimension") {
        None => 3,
        Some(field) => match field.whole(3) {
            Ok(dimension @ 2..) => dimension as usize,
            _ => return Err(field.refuse("2 or 3")),
        },
    };
    let mut gravity = vec![0.0; dimension];
    gravity.iter_mut().skip(1).take(1).for_each(|y| *y = GRAVITY);
    let time_step = table.real_or("time_step", &Range::new(1e-6, LONGEST_STEP, "s"), TIME_STEP)?;
    let bodies_as = match table.get("bodies_as") {
        None => BodiesAs::Rigid,
        Some(field) => {
            field.choice(&[("rigid", BodiesAs::Rigid), ("particles", BodiesAs::Particles)])?
        }
    };
    if let Some(field) = table.get("events").filter(|field| !field.is_empty()) {
        field.warn("are not supported yet: the scene runs without them");
    }
    let bodies = read_bodies(&table, dimension, bodies_as)?;
    let particles = bodies_as == BodiesAs::Particles;
    let joints = read_joints(&table, &JointSetup::new(dimension, particles, &bodies))?;
    let gravity = table.vector_or("gravity", &FALL, gravity)?;
    Ok(Scene {
        name: table.get("name").map(|name| name.text().map(str::to_owned)).transpose()?,
        dimension,
        track: read_world_track(&table, time_step, &gravity)?,
        gravity,
        time_step,
        steps: read_steps(&table, time_step)?,
        bodies_as,
        bodies,
        joints,
        solver: match table.get("solver") {
            None => serde_json::Map::new(),
            Some(field) => read_solver(&field, engine)?,
        },
    })
}

fn read_world_track(
    table: &TableCursor<'_>,
    time_step: f64,
    gravity: &[f64],
) -> Result<WorldTrack, SceneError> {
    let mut track = WorldTrack::default();
    let Some(field) = table.get("track") else {
        return Ok(track);
    };
    // A step is at most as long as that of a scene without speeds.
    let speeds = Range::new(0.0, (LONGEST_STEP / time_step).min(1000.0), "1");
    for (i, item) in field.items("a list of keys")?.enumerate() {
        let owner = table.nested(format!("key {i} of the track"));
        let key = item.table(&["time", "speed", "gravity"], &owner)?;
        track.times.push(read_time(&key, track.times.last())?);
        track.speeds.push(key.real_or("speed", &speeds, 1.0)?);
        track.gravities.push(key.vector_or("gravity", &FALL, gravity.to_vec())?);
    }
    Ok(track)
}

fn read_steps(table: &TableCursor<'_>, time_step: f64) -> Result<Option<u32>, SceneError> {
    let Some(duration) = table.get("duration") else {
        return table.get("steps").map(|steps| steps.whole(MAX_STEPS)).transpose();
    };
    if table.get("steps").is_some() {
        return Err(duration.refuse("either steps or duration, not both"));
    }
    let longest = f64::from(MAX_STEPS) * time_step;
    let seconds = duration.real(&Range::new(0.0, longest, "s"))?;
    // Without the margin, rounding of the quotient would add a step to whole durations.
    let steps = (seconds / time_step * (1.0 - 1e-9)).ceil();
    Ok(Some(steps as u32))
}

fn read_bodies(
    table: &TableCursor<'_>,
    dimension: usize,
    bodies_as: BodiesAs,
) -> Result<Vec<Body>, SceneError> {
    let setup = Setup {
        dimension,
        particles: bodies_as == BodiesAs::Particles,
        materials: read_materials(table)?,
        systems: RefCell::new(Systems::default()),
    };
    let Some(list) = table.get("bodies") else {
        return Ok(Vec::new());
    };
    let items = list.items("a list of bodies")?;
    if items.len() > MAX_BODIES {
        let value = format!("a list of {}", items.len());
        return Err(list.refuse_value(value, format_args!("at most {MAX_BODIES} bodies")));
    }
    let mut names = HashMap::new();
    let mut bodies = Vec::with_capacity(items.len());
    for (index, item) in items.enumerate() {
        let body = read_body(&item, index, &setup, &mut names)?;
        if setup.particles {
            check_particle(&item, index, &body)?;
        }
        bodies.push(body);
    }
    Ok(bodies)
}

fn read_materials(table: &TableCursor<'_>) -> Result<BTreeMap<String, SurfaceFields>, SceneError> {
    let Some(field) = table.get("materials") else {
        return Ok(BTreeMap::new());
    };
    let read = |(name, field): (&str, FieldCursor<'_>)| {
        let owner = format!("material '{name}'");
        let surface = read_surface(&field.table(surface::MATERIAL_KEYS, &owner)?)?;
        Ok((name.to_owned(), surface))
    };
    field.named()?.map(read).collect()
}

/// Checks that a dynamic body is a single sphere about its position that has neither friction nor
/// angular velocity. The shapes of other bodies must be spheres and half-spaces.
fn check_particle(field: &FieldCursor<'_>, index: usize, body: &Body) -> Result<(), SceneError> {
    let owner = body::body_name(index, body.name.as_deref());
    let refuse = |what: &str, value: String, accepted: &str| {
        let item = format!("{what} of {owner}");
        let help = "or leave bodies_as = \"particles\" out";
        Err(SceneError { item, ..field.refuse_value(value, format_args!("{accepted}, {help}")) })
    };
    if body.motion != Motion::Dynamic {
        let odd = body.shapes.iter().enumerate().find(|(_, shape)| !fits_particles(&shape.kind));
        return odd.map_or(Ok(()), |(i, shape)| {
            let accepted = "\"sphere\" or \"halfspace\" in a scene of particles";
            refuse(&format!("type of shape {i}"), type_of(&shape.kind), accepted)
        });
    }
    let [shape] = body.shapes.as_slice() else {
        let value = format!("a list of {}", body.shapes.len());
        return refuse("shapes", value, "a single sphere for a particle");
    };
    if !matches!(shape.kind, ShapeKind::Sphere { .. }) {
        return refuse("type of shape 0", type_of(&shape.kind), "\"sphere\" for a particle");
    }
    if shape.position.iter().any(|x| *x != 0.0) {
        let value = format!("{:?}", shape.position);
        return refuse("position of shape 0", value, "0 for a particle");
    }
    if shape.material.friction != 0.0 {
        return refuse("friction", shape.material.friction.to_string(), "0 for a particle");
    }
    if body.angular_velocity.iter().any(|x| *x != 0.0) {
        let value = format!("{:?}", body.angular_velocity);
        return refuse("angular_velocity", value, "0 for a particle");
    }
    Ok(())
}

/// Returns true if particles can collide with this kind of shape.
fn fits_particles(kind: &ShapeKind) -> bool {
    matches!(kind, ShapeKind::Sphere { .. } | ShapeKind::Halfspace { .. })
}

fn type_of(kind: &ShapeKind) -> String {
    format!("\"{}\"", shape::type_name(kind))
}

fn read_solver(
    field: &FieldCursor<'_>,
    engine: &dyn Engine,
) -> Result<serde_json::Map<String, Value>, SceneError> {
    let mut solver = serde_json::Map::new();
    for (name, entry) in field.named()? {
        let value = match &entry.node.value {
            Tree::Bool(value) => Value::from(*value),
            Tree::Integer(value) => i64::try_from(*value).map(Value::from).unwrap_or(Value::Null),
            Tree::Float(value) => Value::from(*value),
            Tree::Text(text) => Value::from(text.as_ref()),
            _ => Value::Null,
        };
        solver.insert(name.to_owned(), value);
    }
    match engine.check_settings(&solver) {
        Ok(()) => Ok(solver),
        Err(fault) => Err(refuse_setting(field, fault)),
    }
}

fn refuse_setting(field: &FieldCursor<'_>, fault: SettingFault) -> SceneError {
    let entry = field.named().ok().and_then(|mut entries| entries.find(|(k, _)| *k == fault.key));
    match entry {
        Some((_, entry)) => SceneError {
            item: fault.item(),
            value: if fault.unknown { String::new() } else { entry.node.value.to_string() },
            accepted: fault.accepted,
            ..entry.refuse("")
        },
        None => field.refuse(fault.accepted),
    }
}
