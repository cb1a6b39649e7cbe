//! Reads joints.

pub(crate) mod axis;
pub(crate) mod coordinate;
pub(crate) mod frames;
pub(super) mod setup;

use std::collections::BTreeSet;

use self::axis::{AXIS_KEYS, Defaults, LIMIT_KEYS, LOAD, LOCKED, MOTOR_KEYS, SPRING_KEYS};
use self::axis::{limited, read_axis, read_spring};
use self::coordinate::{NAMES, default_limits, rank, read_coordinate, read_parameters};
use self::frames::{apart, distance, read_frames, warn_of_arms, warn_of_distance, world_point};
use self::setup::JointSetup;
use super::cursor::{FieldCursor, Range, TableCursor, nearest_known};
use super::tree::{Tree, one_line};
use crate::description::Motion;
use crate::error::SceneError;
use crate::joint::Coordinate::{self, Angle, Distance, Linear, Swing, Twist};
use crate::joint::{Breaking, Joint, JointAxis, JointFrame};

/// Keys common to all joints, followed by those of one type.
macro_rules! keys {
    ($($key:literal),*) => {
        &[
            "type",
            "name",
            "bodies",
            "anchors",
            "frames",
            "breaking",
            "collide",
            "enabled",
            "extras",
            $($key),*
        ]
    };
}

/// Keys of joints with an axis whose motion along it, or about it, is limited, driven or braked.
macro_rules! axis_keys {
    ($($key:literal),*) => {
        keys!(
            "limits",
            "limit_stiffness",
            "limit_damping",
            "spring",
            "motor",
            "drives",
            "friction",
            $($key),*
        )
    };
}

/// Keys of joints of all coordinates.
macro_rules! general_keys {
    ($($key:literal),*) => {
        keys!(
            "anchor",
            "axis",
            "axis_y",
            "x",
            "y",
            "z",
            "radial_x",
            "radial_y",
            "radial_z",
            "distance",
            "angle",
            "twist",
            "swing_y",
            "swing_z",
            "cone",
            "elliptic_cone",
            "rotation",
            "angle_x",
            "angle_y",
            "angle_z",
            "gear",
            "rack",
            "screw",
            "pulley",
            "order"
            $(, $key)*
        )
    };
}

pub(crate) const JOINT_KEYS: [(&str, &[&str]); 17] = [
    ("fixed", keys!("anchor")),
    (
        "ball",
        keys!(
            "anchor",
            "axis",
            "axis_y",
            "twist",
            "swing_y",
            "swing_z",
            "cone",
            "elliptic_cone",
            "rotation"
        ),
    ),
    ("hinge", axis_keys!("anchor", "axis")),
    ("slider", axis_keys!("anchor", "axis")),
    ("piston", axis_keys!("anchor", "axis", "twist")),
    ("universal", keys!("anchor", "axes", "twist", "swing_z")),
    ("planar", keys!("anchor", "axis", "axis_y", "y", "z", "twist")),
    ("wheel", axis_keys!("anchor", "axis", "suspension", "steering")),
    ("point", keys!("anchor")),
    ("distance", keys!("length", "limits", "limit_stiffness", "limit_damping")),
    ("rope", keys!("length", "limit_stiffness", "limit_damping")),
    (
        "spring",
        keys!(
            "stiffness",
            "damping",
            "frequency",
            "damping_ratio",
            "mode",
            "rest",
            "at_most",
            "limits",
            "limit_stiffness",
            "limit_damping"
        ),
    ),
    ("general", general_keys!()),
    ("gear", axis_keys!("axis", "axes", "ratio")),
    ("rack", axis_keys!("axis", "axes", "radius")),
    ("screw", keys!("anchor", "axis", "pitch", "x", "twist")),
    (
        "pulley",
        keys!(
            "points",
            "ratio",
            "length",
            "limits",
            "limit_stiffness",
            "limit_damping",
            "friction"
        ),
    ),
];
const ANY_KEYS: &[&str] = general_keys!(
    "limits",
    "limit_stiffness",
    "limit_damping",
    "spring",
    "motor",
    "drives",
    "friction",
    "axes",
    "suspension",
    "steering",
    "length",
    "stiffness",
    "damping",
    "frequency",
    "damping_ratio",
    "mode",
    "rest",
    "at_most",
    "ratio",
    "radius",
    "pitch",
    "points"
);
pub(crate) const BREAKING_KEYS: &[&str] = &["force", "torque", "impulse"];

/// Types of joints in 2D.
const FLAT: [&str; 11] = [
    "fixed", "hinge", "slider", "wheel", "distance", "rope", "spring", "general", "gear", "rack",
    "pulley",
];
/// Types of joints of particles, in 2D and 3D.
const OF_PARTICLES: [&str; 5] = ["point", "distance", "rope", "spring", "general"];

const MAX_JOINTS: usize = 10_000_000;
const LENGTH: Range = Range::new(0.0, 1e6, "m");
/// Length up to which a part of the rope of a pulley has no direction. \[m\]
const SHORTEST: f64 = 1e-6;

/// Reads the joints of a scene.
pub(super) fn read_joints(
    scene: &TableCursor<'_>,
    setup: &JointSetup<'_>,
) -> Result<Vec<Joint>, SceneError> {
    let Some(list) = scene.get("joints") else {
        return Ok(Vec::new());
    };
    let items = list.items("a list of joints")?;
    if items.len() > MAX_JOINTS {
        let value = format!("a list of {}", items.len());
        return Err(list.refuse_value(value, format_args!("at most {MAX_JOINTS} joints")));
    }
    let mut names = BTreeSet::new();
    items.enumerate().map(|(i, item)| read_joint(&item, i, setup, &mut names)).collect()
}

fn read_joint(
    field: &FieldCursor<'_>,
    index: usize,
    setup: &JointSetup<'_>,
    names: &mut BTreeSet<String>,
) -> Result<Joint, SceneError> {
    let owner = match field.open(ANY_KEYS, &"")?.peek("name") {
        Some(name) => format!("joint '{}'", one_line(name)),
        None => format!("joint {index}"),
    };
    let open = field.open(ANY_KEYS, &owner)?;
    let kind = open.require("type", types(setup))?;
    let keys = kind.choice(&JOINT_KEYS).map_err(|_| kind.refuse(types(setup)))?;
    // Only now is the type known: a pitch on a hinge is an error.
    let table = &field.open(keys, &owner)?;
    table.check_keys(|key| owner_of(key, keys, setup))?;
    let kind = read_type(&kind, setup)?;
    let bodies = read_bodies(table, setup)?;
    let frames = read_frames(table, kind, bodies, setup)?;
    warn_of_distance(field, &owner, distance(bodies, &frames, setup));
    warn_of_arms(field, &owner, bodies, &frames, setup);
    let axes = read_axes(table, kind, Placed { bodies, frames: &frames }, setup)?;
    if axes.is_empty() {
        field.warn_of(&owner, "does not act: all its coordinates are free");
    }
    warn_of_sleep(field, &owner, bodies, &axes, setup);
    let flag = |key, default| table.get(key).map_or(Ok(default), |field| field.boolean());
    Ok(Joint {
        name: read_name(table, names)?,
        bodies,
        frames,
        axes,
        breaking: read_breaking(table)?,
        collide: flag("collide", false)?,
        enabled: flag("enabled", true)?,
    })
}

/// Returns where a key belongs that joints of this type do not have: to a table in the joint, or to
/// joints of other types.
fn owner_of(key: &str, keys: &[&str], setup: &JointSetup<'_>) -> Option<String> {
    const PARTS: [(&str, &[&str]); 3] =
        [("motor", MOTOR_KEYS), ("spring", SPRING_KEYS), ("breaking", BREAKING_KEYS)];
    let parts = PARTS.iter().filter(|(part, own)| keys.contains(part) && own.contains(&key));
    let parts: Vec<_> = parts.map(|(part, _)| format!("'{part}.{key}'")).collect();
    if !parts.is_empty() {
        return Some(format!("accepted: {}", parts.join(" or ")));
    }
    let others = JOINT_KEYS.iter().filter(|(name, _)| exists(name, setup));
    let others: Vec<_> = others
        .filter(|(_, own)| own.contains(&key))
        .map(|(name, _)| format!("\"{name}\""))
        .collect();
    (!others.is_empty()).then(|| format!("joints of type {} have this key", others.join(", ")))
}

/// Warns of a motor that runs between bodies that all start asleep.
fn warn_of_sleep(
    field: &FieldCursor<'_>,
    owner: &str,
    bodies: [Option<usize>; 2],
    axes: &[JointAxis],
    setup: &JointSetup<'_>,
) {
    let runs = axes.iter().flat_map(|axis| &axis.drives).any(|drive| drive.velocity != 0.0);
    let mut moving = bodies
        .into_iter()
        .filter_map(|body| setup.body(body))
        .filter(|body| body.motion != Motion::Static);
    if runs && moving.all(|body| body.start_asleep) {
        let what =
            "has a motor that does not act before something wakes its bodies, which start asleep";
        field.warn_of(owner, what);
    }
}

/// Lists the types of joints in a scene of this kind, for messages.
fn types(setup: &JointSetup<'_>) -> String {
    let names = JOINT_KEYS.iter().map(|(name, _)| *name).filter(|name| exists(name, setup));
    names.map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ")
}

/// Returns true if a scene of this kind can have joints of this type.
fn exists(name: &str, setup: &JointSetup<'_>) -> bool {
    match (setup.particles, setup.dimension) {
        (true, _) => OF_PARTICLES.contains(&name),
        (false, 2) => FLAT.contains(&name),
        _ => name != "point",
    }
}

fn read_type<'a>(kind: &FieldCursor<'a>, setup: &JointSetup<'_>) -> Result<&'a str, SceneError> {
    let name = kind.text()?;
    if exists(name, setup) {
        return Ok(name);
    }
    let scenes = match (setup.particles, name) {
        (true, _) => "in a scene of particles",
        (false, "point") => "in a scene of rigid bodies",
        (false, _) => "in 2D",
    };
    Err(kind.refuse(format_args!("{} {scenes}", types(setup))))
}

fn read_name(
    table: &TableCursor<'_>,
    names: &mut BTreeSet<String>,
) -> Result<Option<String>, SceneError> {
    let Some(field) = table.get("name") else {
        return Ok(None);
    };
    let name = field.text()?.to_owned();
    if !names.insert(name.clone()) {
        return Err(field.refuse("a name of its own: another joint has this one already"));
    }
    Ok(Some(name))
}

/// Reads the bodies of a joint: one, which it joins to the world, or two.
fn read_bodies(
    table: &TableCursor<'_>,
    setup: &JointSetup<'_>,
) -> Result<[Option<usize>; 2], SceneError> {
    let accepted = "1 or 2 bodies by name or index; the world is left out, or -1";
    let field = table.require("bodies", accepted)?;
    let items = field.items(accepted)?;
    let bodies: Vec<_> =
        items.map(|item| read_body(&item, setup)).collect::<Result<_, SceneError>>()?;
    let pair = match *bodies.as_slice() {
        [a] => [a, None],
        [a, b] => [a, b],
        _ => return Err(field.refuse(accepted)),
    };
    if let [Some(a), Some(b)] = pair
        && a == b
    {
        return Err(field.refuse("2 bodies that differ"));
    }
    let moves = |body| setup.body(body).is_some_and(|body| body.motion == Motion::Dynamic);
    if !pair.into_iter().any(moves) {
        return Err(field.refuse("at least one dynamic body: a joint moves no others"));
    }
    Ok(pair)
}

fn read_body(item: &FieldCursor<'_>, setup: &JointSetup<'_>) -> Result<Option<usize>, SceneError> {
    let count = setup.bodies.len();
    match &item.node.value {
        Tree::Integer(-1) => Ok(None),
        Tree::Integer(index) => {
            let index = usize::try_from(*index).ok().filter(|index| *index < count);
            index.map(Some).ok_or_else(|| {
                item.refuse(format_args!("an index below {count}, the number of bodies"))
            })
        }
        Tree::Text(name) => setup.names.get(name.as_ref()).copied().map(Some).ok_or_else(|| {
            let known: Vec<_> = setup.names.keys().map(|name| one_line(name)).collect();
            if known.is_empty() {
                return item.refuse("the name of a body; no body of the scene has one");
            }
            let nearest = nearest_known(name, &known).replace("known key", "body");
            item.refuse(format_args!("the name of a body; {nearest}"))
        }),
        _ => Err(item.refuse("a body by name or index")),
    }
}

/// A joint in its bodies.
#[derive(Clone, Copy)]
struct Placed<'a> {
    bodies: [Option<usize>; 2],
    frames: &'a [JointFrame; 2],
}

/// Reads the rows of a joint, in the order of [`NAMES`] unless it states its own.
fn read_axes(
    table: &TableCursor<'_>,
    kind: &str,
    placed: Placed<'_>,
    setup: &JointSetup<'_>,
) -> Result<Vec<JointAxis>, SceneError> {
    let mut axes: Vec<_> =
        locked(kind, setup).iter().map(|coordinate| limited(*coordinate, LOCKED)).collect();
    axes.extend(read_own(table, kind, placed, setup)?);
    for name in NAMES {
        // The coordinates of couplings have the names of types, but other keys.
        if let Some(field) = if table.knows(name) { table.get(name) } else { None } {
            axes.extend(read_coordinate(&field, name, table, setup)?);
        }
    }
    axes.sort_by_key(|axis| rank(axis.coordinate));
    match if table.knows("order") { table.get("order") } else { None } {
        None => Ok(axes),
        Some(field) => order(axes, &field),
    }
}

/// Returns the coordinates that joints of this type lock.
fn locked(kind: &str, setup: &JointSetup<'_>) -> &'static [Coordinate] {
    match (kind, setup.dimension) {
        ("fixed", 2) => &[Linear(0), Linear(1), Angle],
        ("hinge" | "point", 2) => &[Linear(0), Linear(1)],
        ("slider", 2) => &[Linear(1), Angle],
        ("wheel", 2) => &[Linear(0)],
        ("fixed", _) => &[Linear(0), Linear(1), Linear(2), Twist, Swing(1), Swing(2)],
        ("ball" | "point", _) => &[Linear(0), Linear(1), Linear(2)],
        ("hinge", _) => &[Linear(0), Linear(1), Linear(2), Swing(1), Swing(2)],
        ("slider", _) => &[Linear(1), Linear(2), Twist, Swing(1), Swing(2)],
        ("piston" | "screw", _) => &[Linear(1), Linear(2), Swing(1), Swing(2)],
        ("universal", _) => &[Linear(0), Linear(1), Linear(2), Swing(1)],
        ("planar", _) => &[Linear(0), Swing(1), Swing(2)],
        ("wheel", _) => &[Linear(0), Linear(2), Swing(2)],
        _ => &[],
    }
}

/// Reads the coordinates whose limits, springs and motors are keys of the joint itself.
fn read_own(
    table: &TableCursor<'_>,
    kind: &str,
    placed: Placed<'_>,
    setup: &JointSetup<'_>,
) -> Result<Vec<JointAxis>, SceneError> {
    let none = Defaults::default();
    let turn = if setup.dimension == 2 { Angle } else { Twist };
    let own = |keys, coordinate, defaults| read_axis(table, keys, coordinate, defaults);
    let axis = match kind {
        "hinge" => own(AXIS_KEYS, turn, none)?,
        "slider" | "piston" => own(AXIS_KEYS, Linear(0), none)?,
        "wheel" => return read_wheel(table, turn, setup),
        "distance" | "rope" | "spring" => Some(read_length(table, kind, placed, setup)?),
        "gear" | "rack" | "screw" => {
            let coordinate = read_parameters(table, kind, setup)?;
            let keys = if kind == "screw" { &[] } else { AXIS_KEYS };
            own(keys, coordinate, Defaults { limits: default_limits(coordinate), ..none })?
        }
        "pulley" => Some(read_pulley(table, placed, setup)?),
        _ => None,
    };
    if matches!(kind, "gear" | "rack" | "pulley") && placed.bodies.contains(&None) {
        let bodies = table.require("bodies", "2 bodies")?;
        return Err(bodies.refuse(format_args!("2 bodies for a joint of type \"{kind}\"")));
    }
    Ok(axis.into_iter().collect())
}

/// Reads suspension, spin and steering of a wheel.
fn read_wheel(
    table: &TableCursor<'_>,
    turn: Coordinate,
    setup: &JointSetup<'_>,
) -> Result<Vec<JointAxis>, SceneError> {
    const SPRUNG: &[&str] = &["limits", "limit_stiffness", "limit_damping", "spring"];
    const SPUN: &[&str] = &["motor", "drives", "friction"];
    let mut axes = Vec::new();
    axes.extend(read_axis(table, SPRUNG, Linear(1), Defaults::default())?);
    axes.extend(read_axis(table, SPUN, turn, Defaults::default())?);
    match (table.get("steering"), setup.dimension) {
        (Some(field), 2) => return Err(field.refuse("nothing in 2D")),
        (Some(field), _) => axes.extend(read_coordinate(&field, "steering", table, setup)?),
        (None, 2) => {}
        (None, _) => axes.push(limited(Swing(1), LOCKED)),
    }
    Ok(axes)
}

/// Reads a joint of two points whose distance is locked, limited or sprung.
fn read_length(
    table: &TableCursor<'_>,
    kind: &str,
    placed: Placed<'_>,
    setup: &JointSetup<'_>,
) -> Result<JointAxis, SceneError> {
    let start = distance(placed.bodies, placed.frames, setup);
    if kind == "spring" {
        require_length(table, "rest", start)?;
        let defaults = Defaults { limits: None, rest: start };
        let axis = read_axis(table, LIMIT_KEYS, Distance, defaults)?;
        let drive = read_spring(table, Distance, start)?;
        let axis = axis.unwrap_or(axis::free(Distance));
        return Ok(JointAxis { drives: vec![drive], ..axis });
    }
    let length = table.get("length");
    let limits = if table.knows("limits") { table.get("limits") } else { None };
    if let (Some(field), Some(_)) = (length, limits) {
        return Err(field.refuse("either length or limits, not both"));
    }
    if limits.is_none() {
        require_length(table, "length", if start == 0.0 { f64::INFINITY } else { start })?;
    }
    let length = length.map_or(Ok(start), |field| field.real(&LENGTH))?;
    let least = if kind == "rope" { 0.0 } else { length };
    let keys = if kind == "rope" { SOFT_KEYS } else { LIMIT_KEYS };
    let defaults = Defaults { limits: Some([least, length]), rest: 0.0 };
    let axis = read_axis(table, keys, Distance, defaults)?;
    Ok(axis.unwrap_or(axis::free(Distance)))
}

/// Refuses a joint without a length if the one at the start is not accepted.
fn require_length(
    table: &TableCursor<'_>,
    key: &'static str,
    start: f64,
) -> Result<(), SceneError> {
    if start > LENGTH.max {
        let why = format_args!("a number {LENGTH}, since the length at the start is 0 or larger");
        table.require(key, why)?;
    }
    Ok(())
}

/// Keys of a limit that the type of a joint gives.
const SOFT_KEYS: &[&str] = &["limit_stiffness", "limit_damping"];

/// Reads a rope over two points of the world, as long as it is at the start unless the joint says
/// otherwise.
fn read_pulley(
    table: &TableCursor<'_>,
    placed: Placed<'_>,
    setup: &JointSetup<'_>,
) -> Result<JointAxis, SceneError> {
    const KEYS: &[&str] = &["limits", "limit_stiffness", "limit_damping", "friction"];
    let coordinate = read_parameters(table, "pulley", setup)?;
    let Coordinate::Pulley { points: [p, q], ratio } = coordinate else {
        return Ok(axis::free(coordinate));
    };
    let ([a, b], [i, j]) = (placed.frames, placed.bodies);
    let parts = [apart(&world_point(i, a, setup), &p), apart(&world_point(j, b, setup), &q)];
    let start = parts[0] + ratio * parts[1];
    if let (Some(points), true) = (table.get("points"), parts.iter().any(|part| *part < SHORTEST)) {
        points.warn("put one on the anchor of its body, where the rope has no direction");
    }
    let (length, limits) = (table.get("length"), table.get("limits"));
    if let (Some(field), Some(_)) = (length, limits) {
        return Err(field.refuse("either length or limits, not both"));
    }
    if limits.is_none() {
        require_length(table, "length", start)?;
    }
    let length = length.map_or(Ok(start), |field| field.real(&LENGTH))?;
    let defaults = Defaults { limits: Some([0.0, length]), rest: 0.0 };
    let axis = read_axis(table, KEYS, coordinate, defaults)?;
    Ok(axis.unwrap_or(axis::free(coordinate)))
}

/// Sorts rows by a list of the names of their coordinates.
fn order(mut axes: Vec<JointAxis>, field: &FieldCursor<'_>) -> Result<Vec<JointAxis>, SceneError> {
    let names: Vec<_> = axes.iter().map(|axis| axis.coordinate.name()).collect();
    let accepted = format!("the coordinates of the joint, each once: {}", names.join(", "));
    let mut sorted = Vec::with_capacity(axes.len());
    for item in field.items(&accepted)? {
        let name = item.text().map_err(|_| field.refuse(&accepted))?;
        let place = axes.iter().position(|axis| axis.coordinate.name() == name);
        sorted.push(axes.remove(place.ok_or_else(|| item.refuse(&accepted))?));
    }
    if axes.is_empty() { Ok(sorted) } else { Err(field.refuse(accepted)) }
}

fn read_breaking(table: &TableCursor<'_>) -> Result<Breaking, SceneError> {
    let Some(field) = table.get("breaking") else {
        return Ok(Breaking::default());
    };
    let owner = table.nested("breaking".to_owned());
    let loads = field.table(BREAKING_KEYS, &owner)?;
    let load = |key, unit| -> Result<Option<f64>, SceneError> {
        let Some(field) = loads.get(key) else { return Ok(None) };
        let load = field.real(&Range { unit, ..LOAD })?;
        if load == 0.0 {
            field.warn("is 0: any load breaks the joint");
        }
        Ok(Some(load))
    };
    let force = load("force", "N")?;
    let torque = load("torque", "N m")?;
    let impulse = load("impulse", "N s")?;
    if ![force, torque, impulse].into_iter().flatten().any(f64::is_finite) {
        field.warn("does not act: it has no finite force, torque or impulse");
    }
    Ok(Breaking { force, torque, impulse })
}

#[cfg(test)]
mod tests;
