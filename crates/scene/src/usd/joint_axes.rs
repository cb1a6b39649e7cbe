//! Reads the axes of a joint: those that its type implies, limits and drives of UsdPhysics, and the
//! attributes of the namespace `drystone:`.
//!
//! UsdPhysics names axes of the frame of the joint. Here x is the axis of the joint, so the axes of
//! the frame are renamed in a cycle. Linear limits scale with the unit of length, forces with those
//! of length and mass. Angles are in degrees, and so are stiffness and damping: per degree.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

use super::super::error::{SceneError, Warning};
use super::super::graph::{ENDLESS, FAR, FAST, STRONG};
use super::coordinates::{
    CONE, DISTANCE, ELLIPTIC, NAMES, ROT, TRANS, is_angle, is_shared, shifted,
};
use super::layer::Value;
use super::prims::Prim;
use super::stage::Stage;
use crate::joint::{Coordinate, Drive, JointAxis, Softness};

/// Largest difference of an exact value from that of UsdPhysics, relative to it.
const SLACK: f64 = 1e-6;
/// Lists the names of all axes of a joint, in their order.
const ORDER: &str = "drystone:axes";
const LOCKED: [f64; 2] = [0.0; 2];
const FREE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// Axes of a joint by the index of their coordinate in [`NAMES`].
type Axes = BTreeMap<usize, JointAxis>;

/// A joint on a stage, which remembers what was read of it.
pub(super) struct JointPrim<'s> {
    pub(super) stage: &'s Stage<'s>,
    pub(super) prim: &'s Prim,
    read: RefCell<BTreeSet<String>>,
}

impl<'s> JointPrim<'s> {
    pub(super) fn new(stage: &'s Stage<'s>, prim: &'s Prim) -> Self {
        Self { stage, prim, read: RefCell::default() }
    }

    /// Marks a property or a schema as read and returns its name.
    pub(super) fn read<'n>(&self, name: &'n str) -> &'n str {
        self.read.borrow_mut().insert(name.to_owned());
        name
    }

    /// Returns the properties with a value, the relationships and the schemas that were not read.
    pub(super) fn unread(&self) -> Vec<String> {
        let read = self.read.borrow();
        let says = self
            .prim
            .properties
            .iter()
            .filter(|(_, property)| property.value().is_some() || !property.targets.is_empty());
        let names = says.map(|(name, _)| name).chain(&self.prim.schemas);
        names.filter(|name| !read.contains(*name)).cloned().collect()
    }

    pub(super) fn flag(&self, name: &str) -> Result<Option<bool>, SceneError> {
        self.stage.flag(self.prim, self.read(name))
    }

    fn has_schema(&self, name: &str) -> bool {
        self.prim.schemas.contains(self.read(name))
    }

    fn number(&self, name: &str, low: f64, high: f64) -> Result<Option<f64>, SceneError> {
        self.stage.number(self.prim, self.read(name), low, high)
    }

    /// Reads a number from `low`, of magnitude up to `most` or infinite.
    pub(super) fn endless(
        &self,
        name: &str,
        low: f64,
        most: f64,
    ) -> Result<Option<f64>, SceneError> {
        match self.number(name, low, f64::INFINITY)? {
            Some(x) if x.abs() >= ENDLESS => Ok(Some(f64::INFINITY.copysign(x))),
            Some(x) if x.abs() > most => {
                let least = low.max(-most);
                let accepted = format!("a number from {least:?} to {most:?}, or inf");
                Err(self.stage.refuse(self.prim, name, &accepted))
            }
            found => Ok(found),
        }
    }

    /// Reads a force or a torque, and converts it from its `unit`. Beyond 1e20 it is infinite.
    pub(super) fn load(
        &self,
        name: &str,
        unit: f64,
        warnings: &mut Vec<Warning>,
    ) -> Result<Option<f64>, SceneError> {
        let load = self.endless(name, 0.0, f64::MAX)?.map(|load| load * unit);
        Ok(load.map(|load| self.bounded(name, load, f64::INFINITY, warnings)))
    }

    /// Returns a strength in SI units, or `most` for a finite one beyond 1e20.
    fn bounded(&self, name: &str, strength: f64, most: f64, warnings: &mut Vec<Warning>) -> f64 {
        if strength <= STRONG || strength == most {
            return strength;
        }
        let taken = if most.is_finite() { format!("{most:e}") } else { "unbounded".to_owned() };
        self.stage.warn(self.prim, format!("{name} {strength:e} is taken as {taken}"), warnings);
        most
    }

    /// Reads a word out of a list, and returns its place in it; the first is the default.
    fn choice(&self, name: &str, words: &[&str]) -> Result<usize, SceneError> {
        let Some(word) = self.stage.word(self.prim, self.read(name))? else { return Ok(0) };
        let words_shown = || words.iter().map(|word| format!("{word:?}")).collect::<Vec<_>>();
        let found = words.iter().position(|known| *known == word);
        found.ok_or_else(|| self.stage.refuse(self.prim, name, &words_shown().join(", ")))
    }
}

/// Reads the axes of a joint, and returns with them which axis of its frame becomes x.
pub(super) fn read(
    joint: &JointPrim<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<(Vec<JointAxis>, usize), SceneError> {
    let listed = listed(joint)?;
    let first = match joint.prim.kind.as_str() {
        "PhysicsRevoluteJoint" | "PhysicsPrismaticJoint" | "PhysicsSphericalJoint" => {
            joint.choice("physics:axis", &["X", "Y", "Z"])?
        }
        "PhysicsJoint" if listed.is_none() => turning(joint)?,
        _ => 0,
    };
    let mut axes = of_type(joint)?;
    for (token, place) in tokens(joint, first) {
        limit(joint, &token, place, &mut axes, warnings)?;
        drive(joint, &token, place, &mut axes, warnings)?;
    }
    if listed.is_none() {
        doubts(joint, &axes, warnings);
    }
    let listed: Vec<usize> =
        listed.unwrap_or_default().iter().map(|at| renamed(*at, first)).collect();
    own(joint, first, &listed, &mut axes, warnings)?;
    let mut ordered: Vec<JointAxis> =
        listed.iter().filter_map(|place| axes.remove(place)).collect();
    ordered.extend(axes.into_values());
    Ok((ordered, first))
}

/// Returns the index of a coordinate after axis `first` of the frame became x.
fn renamed(place: usize, first: usize) -> usize {
    shifted(place, 3_usize.saturating_sub(first))
}

/// Returns the coordinates that the joint lists.
fn listed(joint: &JointPrim<'_>) -> Result<Option<Vec<usize>>, SceneError> {
    let words = match joint.stage.value(joint.prim, joint.read(ORDER)) {
        None => return Ok(None),
        Some(Value::Texts(words)) => words.as_slice(),
        Some(Value::Numbers(none)) if none.is_empty() => &[],
        Some(_) => return Err(joint.stage.refuse(joint.prim, ORDER, "a list of names")),
    };
    let place = |word: &String| NAMES.iter().position(|known| known == word);
    let places: Option<Vec<usize>> = words.iter().map(place).collect();
    let accepted = || format!("names out of {}", NAMES.join(", "));
    places.map(Some).ok_or_else(|| joint.stage.refuse(joint.prim, ORDER, &accepted()))
}

/// Returns the axis about which a general joint turns, if two of three are locked.
fn turning(joint: &JointPrim<'_>) -> Result<usize, SceneError> {
    let mut open = Vec::new();
    for (axis, name) in ["rotX", "rotY", "rotZ"].iter().enumerate() {
        let names = ["low", "high"].map(|of| format!("limit:{name}:physics:{of}"));
        if joint.has_schema(&format!("PhysicsLimitAPI:{name}")) {
            let [low, high] = pair(joint, &names, 8)?;
            if low >= high {
                continue;
            }
        }
        open.push(axis);
    }
    Ok(match open.as_slice() {
        [axis] => *axis,
        _ => 0,
    })
}

/// Returns names and indices of the coordinates whose limits and drives the joint may have.
fn tokens(joint: &JointPrim<'_>, first: usize) -> Vec<(String, usize)> {
    let shared = NAMES.iter().enumerate().filter(|(place, _)| is_shared(*place));
    let mut tokens: Vec<_> =
        shared.map(|(place, name)| ((*name).to_owned(), renamed(place, first))).collect();
    match joint.prim.kind.as_str() {
        "PhysicsRevoluteJoint" => tokens.push(("angular".to_owned(), 8)),
        "PhysicsPrismaticJoint" => tokens.push(("linear".to_owned(), 0)),
        _ => {}
    }
    tokens
}

/// Returns the coordinate of an index, if it has no parameters.
fn plain(place: usize) -> Option<Coordinate> {
    Some(match place {
        axis @ 0..=2 => Coordinate::Linear(axis),
        3 => Coordinate::Radial(0),
        4 => Coordinate::Radial(1),
        5 => Coordinate::Radial(2),
        DISTANCE => Coordinate::Distance,
        7 => Coordinate::Angle,
        8 => Coordinate::Twist,
        9 => Coordinate::Swing(1),
        10 => Coordinate::Swing(2),
        CONE => Coordinate::Cone,
        13 => Coordinate::Rotation,
        14 => Coordinate::Cardan(0),
        15 => Coordinate::Cardan(1),
        16 => Coordinate::Cardan(2),
        _ => return None,
    })
}

fn axis(coordinate: Coordinate) -> JointAxis {
    JointAxis { coordinate, limits: None, softness: None, drives: Vec::new(), friction: 0.0 }
}

/// Sets the limits of a coordinate without parameters.
fn set(axes: &mut Axes, place: usize, limits: Option<[f64; 2]>) {
    if let (Some(limits), Some(coordinate)) = (limits, plain(place)) {
        axes.entry(place).or_insert_with(|| axis(coordinate)).limits = Some(limits);
    }
}

/// Returns the locks and limits that the type of the joint states.
fn of_type(joint: &JointPrim<'_>) -> Result<Axes, SceneError> {
    let mut axes = Axes::new();
    let mut lock = |places: &[usize]| {
        places.iter().for_each(|place| set(&mut axes, *place, Some(LOCKED)));
    };
    let bounds = |place: usize| {
        let names = ["physics:lowerLimit", "physics:upperLimit"].map(str::to_owned);
        let [low, high] = pair(joint, &names, place)?;
        if low > high {
            let accepted = "at least physics:lowerLimit";
            return Err(joint.stage.refuse(joint.prim, "physics:upperLimit", accepted));
        }
        Ok(([low, high] != FREE).then_some([low, high]))
    };
    match joint.prim.kind.as_str() {
        "PhysicsFixedJoint" => lock(&[TRANS, ROT].concat()),
        "PhysicsRevoluteJoint" => {
            lock(&[0, 1, 2, 9, 10]);
            set(&mut axes, 8, bounds(8)?);
        }
        "PhysicsPrismaticJoint" => {
            lock(&[1, 2, 8, 9, 10]);
            set(&mut axes, 0, bounds(0)?);
        }
        "PhysicsSphericalJoint" => {
            lock(&TRANS);
            cone(joint, &mut axes)?;
        }
        "PhysicsDistanceJoint" => set(&mut axes, DISTANCE, distance(joint)?),
        _ => {}
    }
    Ok(axes)
}

/// Reads two limits in SI units; absent ones are infinite.
fn pair(joint: &JointPrim<'_>, names: &[String; 2], place: usize) -> Result<[f64; 2], SceneError> {
    let [low, high] = names;
    let number = |name: &String, default: f64| -> Result<f64, SceneError> {
        let found = joint.endless(name, f64::NEG_INFINITY, FAR)?;
        Ok(found.map_or(default, |x| measured(joint, place, x)))
    };
    let limits = [number(low, f64::NEG_INFINITY)?, number(high, f64::INFINITY)?];
    match limits {
        [low, high] if low <= high && (low == f64::INFINITY || high == f64::NEG_INFINITY) => {
            let name = if low == f64::INFINITY { &names[0] } else { &names[1] };
            Err(joint.stage.refuse(joint.prim, name, "limits that leave a finite value between"))
        }
        limits => Ok(limits),
    }
}

/// Converts a position of a coordinate from the units of the stage. \[m, or rad\]
fn measured(joint: &JointPrim<'_>, place: usize, x: f64) -> f64 {
    if is_angle(place) { x.to_radians() } else { x * joint.stage.units.meters }
}

/// Reads the limits of a distance; negative ones are none.
fn distance(joint: &JointPrim<'_>) -> Result<Option<[f64; 2]>, SceneError> {
    const FARTHEST: &str = "physics:maxDistance";
    let meters = joint.stage.units.meters;
    let number = |name: &str| -> Result<Option<f64>, SceneError> {
        let found = joint.endless(name, f64::NEG_INFINITY, FAR)?;
        Ok(found.filter(|x| (0.0..f64::INFINITY).contains(x)).map(|x| x * meters))
    };
    let (least, most) = (number("physics:minDistance")?, number(FARTHEST)?);
    if let (Some(least), Some(most)) = (least, most)
        && least > most
    {
        let accepted = "at least physics:minDistance, or -1 for no limit";
        return Err(joint.stage.refuse(joint.prim, FARTHEST, accepted));
    }
    let limits = [least.unwrap_or(f64::NEG_INFINITY), most.unwrap_or(f64::INFINITY)];
    Ok((limits != FREE).then_some(limits))
}

/// Reads the cone of a ball joint. The first angle inclines x towards y, by rotation about z; the
/// second one inclines it towards z, by rotation about y.
fn cone(joint: &JointPrim<'_>, axes: &mut Axes) -> Result<(), SceneError> {
    let angle = |name: &str| -> Result<Option<f64>, SceneError> {
        let found = joint.endless(name, f64::NEG_INFINITY, 180.0)?;
        Ok(found.filter(|x| (0.0..f64::INFINITY).contains(x)).map(f64::to_radians))
    };
    let about_z = angle("physics:coneAngle0Limit")?;
    let about_y = angle("physics:coneAngle1Limit")?;
    match (about_y, about_z) {
        (Some(y), Some(z)) if y == z && y > 0.0 => set(axes, CONE, Some([0.0, y])),
        (Some(y), Some(z)) if y > 0.0 && z > 0.0 => {
            let limits = Some([0.0, 1.0]);
            let ellipse = axis(Coordinate::EllipticCone([y, z]));
            axes.insert(ELLIPTIC, JointAxis { limits, ..ellipse });
        }
        _ => {
            for (place, angle) in [(9, about_y), (10, about_z)] {
                set(
                    axes,
                    place,
                    angle.map(|angle| if angle > 0.0 { [-angle, angle] } else { LOCKED }),
                );
            }
        }
    }
    Ok(())
}

/// Reads the limit of a coordinate, if its schema is applied.
fn limit(
    joint: &JointPrim<'_>,
    token: &str,
    place: usize,
    axes: &mut Axes,
    warnings: &mut Vec<Warning>,
) -> Result<(), SceneError> {
    let schema = format!("PhysicsLimitAPI:{token}");
    if !joint.has_schema(&schema) {
        return Ok(());
    }
    let names = ["low", "high"].map(|of| format!("limit:{token}:physics:{of}"));
    let [low, high] = pair(joint, &names, place)?;
    if axes.get(&place).is_some_and(|axis| axis.limits.is_some()) {
        let what = format!("{schema} does not act: another limit of the joint is of the same axis");
        joint.stage.warn(joint.prim, what, warnings);
        return Ok(());
    }
    let limits = if low > high { LOCKED } else { [low, high] };
    set(axes, place, (limits != FREE).then_some(limits));
    Ok(())
}

/// Reads the drive of a coordinate, if its schema is applied.
fn drive(
    joint: &JointPrim<'_>,
    token: &str,
    place: usize,
    axes: &mut Axes,
    warnings: &mut Vec<Warning>,
) -> Result<(), SceneError> {
    let Some(coordinate) = plain(place) else { return Ok(()) };
    if !joint.has_schema(&format!("PhysicsDriveAPI:{token}")) {
        return Ok(());
    }
    let units = joint.stage.units;
    let name = |of: &str| format!("drive:{token}:physics:{of}");
    let mut drive = raw_drive(joint, &name)?;
    let force = units.kilograms * units.meters;
    // The units of mass and length cancel in an acceleration.
    let [mass, moment] = match drive.acceleration {
        true => [1.0; 2],
        false => [units.kilograms, force * units.meters],
    };
    drive.position = measured(joint, place, drive.position);
    drive.velocity = measured(joint, place, drive.velocity);
    if is_angle(place) {
        // Per degree.
        drive.stiffness = drive.stiffness.to_degrees() * moment;
        drive.damping = drive.damping.to_degrees() * moment;
        drive.max_force *= force * units.meters;
    } else {
        drive.stiffness *= mass;
        drive.damping *= mass;
        drive.max_force *= force;
    }
    bound(joint, &name, &mut drive, warnings);
    axes.entry(place).or_insert_with(|| axis(coordinate)).drives.push(drive);
    Ok(())
}

/// Bounds the strengths of a drive in SI units by those of the own format.
fn bound(
    joint: &JointPrim<'_>,
    name: &dyn Fn(&str) -> String,
    drive: &mut Drive,
    warnings: &mut Vec<Warning>,
) {
    let most = if drive.damping.is_finite() { STRONG } else { f64::INFINITY };
    for (of, value, most) in [
        ("stiffness", &mut drive.stiffness, STRONG),
        ("damping", &mut drive.damping, most),
        ("maxForce", &mut drive.max_force, f64::INFINITY),
    ] {
        *value = joint.bounded(&name(of), *value, most, warnings);
    }
}

/// Reads a drive without conversion of units.
fn raw_drive(joint: &JointPrim<'_>, name: &dyn Fn(&str) -> String) -> Result<Drive, SceneError> {
    let number = |of: &str, low: f64, high: f64| -> Result<f64, SceneError> {
        Ok(joint.number(&name(of), low, high)?.unwrap_or(0.0))
    };
    let acceleration = joint.choice(&name("type"), &["force", "acceleration"])? == 1;
    Ok(Drive {
        position: number("targetPosition", -FAR, FAR)?,
        velocity: number("targetVelocity", -FAST, FAST)?,
        stiffness: number("stiffness", 0.0, f64::MAX)?,
        damping: joint.endless(&name("damping"), 0.0, f64::MAX)?.unwrap_or(0.0),
        max_force: joint.endless(&name("maxForce"), 0.0, f64::MAX)?.unwrap_or(f64::INFINITY),
        acceleration,
    })
}

/// Warns about rotations that UsdPhysics does not define, and limits that swings never reach.
fn doubts(joint: &JointPrim<'_>, axes: &Axes, warnings: &mut Vec<Warning>) {
    let turns = ROT.iter().filter_map(|place| axes.get(place));
    let is_wide = |axis: &&JointAxis| {
        !axis.drives.is_empty() || axis.limits.is_some_and(|[low, high]| low < high)
    };
    if turns.clone().filter(is_wide).count() > 1 {
        let what = "several rotations have limits or drives: rotX is taken as the twist about x, rotY \
                    and rotZ as the swings about y and z";
        joint.stage.warn(joint.prim, what, warnings);
    }
    let is_beyond = |x: &f64| x.is_finite() && x.abs() > std::f64::consts::PI * (1.0 + SLACK);
    let beyond = |axis: &JointAxis| axis.limits.is_some_and(|limits| limits.iter().any(is_beyond));
    if turns.skip_while(|axis| axis.coordinate == Coordinate::Twist).any(beyond) {
        let what = "a limit of a swing beyond 180 degrees does not act";
        joint.stage.warn(joint.prim, what, warnings);
    }
}

/// Reads the attributes of the namespace `drystone:`, in SI units: exact values where degrees round,
/// and what UsdPhysics cannot express.
fn own(
    joint: &JointPrim<'_>,
    first: usize,
    listed: &[usize],
    axes: &mut Axes,
    warnings: &mut Vec<Warning>,
) -> Result<(), SceneError> {
    for place in 0..NAMES.len() {
        let Some(token) = NAMES.get(shifted(place, first)) else { continue };
        let friction = joint.load(&format!("drystone:friction:{token}"), 1.0, warnings)?;
        let known = axes.contains_key(&place);
        if !known && friction.is_none() && !listed.contains(&place) {
            continue;
        }
        let coordinate = coordinate(joint, place, axes.get(&place))?;
        let axis = axes.entry(place).or_insert_with(|| axis(coordinate));
        axis.coordinate = coordinate;
        axis.friction = friction.unwrap_or(0.0).min(STRONG);
        let stated = known || is_shared(place);
        own_limits(joint, token, stated, axis)?;
        own_drives(joint, token, is_shared(place), axis, warnings)?;
    }
    Ok(())
}

/// Returns the coordinate of an index, with its parameters. `said` is what UsdPhysics says.
fn coordinate(
    joint: &JointPrim<'_>,
    place: usize,
    said: Option<&JointAxis>,
) -> Result<Coordinate, SceneError> {
    const ANGLES: &str = "drystone:ellipticCone:halfAngles";
    if let Some(coordinate) = plain(place) {
        return Ok(coordinate);
    }
    let (stage, prim) = (joint.stage, joint.prim);
    let need = |name: &str| -> Result<f64, SceneError> {
        let accepted = || stage.refuse(prim, name, &format!("a number from {:?} to {FAR:?}", -FAR));
        joint.number(name, -FAR, FAR)?.ok_or_else(accepted)
    };
    Ok(match place {
        ELLIPTIC => {
            let exact = stage.vector::<2>(prim, joint.read(ANGLES), std::f64::consts::TAU)?;
            match (exact, said.map(|axis| axis.coordinate)) {
                (Some([y, z]), Some(Coordinate::EllipticCone([a, b])))
                    if !(is_close(y, a) && is_close(z, b)) =>
                {
                    Coordinate::EllipticCone([a, b])
                }
                (Some(exact), _) => Coordinate::EllipticCone(exact),
                (None, Some(coordinate)) => coordinate,
                (None, None) => return Err(stage.refuse(prim, ANGLES, "two angles")),
            }
        }
        17 => Coordinate::Gear { ratio: need("drystone:gear:ratio")? },
        18 => Coordinate::Rack { radius: need("drystone:rack:radius")? },
        19 => Coordinate::Screw { pitch: need("drystone:screw:pitch")? },
        _ => {
            const POINTS: &str = "drystone:pulley:points";
            let points = stage.points(prim, joint.read(POINTS), FAR)?;
            let points = <[[f64; 3]; 2]>::try_from(points);
            let points = points.map_err(|_| stage.refuse(prim, POINTS, "two points"))?;
            Coordinate::Pulley { points, ratio: need("drystone:pulley:ratio")? }
        }
    })
}

/// Returns true if an exact value agrees with that of UsdPhysics: nobody has changed the latter.
fn is_close(exact: f64, said: f64) -> bool {
    exact == said || (exact - said).abs() <= SLACK * said.abs()
}

/// Reads limits and softness. Where UsdPhysics states limits, these only make them exact.
fn own_limits(
    joint: &JointPrim<'_>,
    token: &str,
    stated: bool,
    axis: &mut JointAxis,
) -> Result<(), SceneError> {
    let name = |of: &str| format!("drystone:limit:{token}:{of}");
    let bound = |of: &str| joint.endless(&name(of), f64::NEG_INFINITY, FAR);
    let (low, high) = (bound("low")?, bound("high")?);
    if low.is_some() || high.is_some() {
        let [a, b] = axis.limits.unwrap_or(FREE);
        let (low, high) = (low.unwrap_or(a), high.unwrap_or(b));
        if low > high {
            return Err(joint.stage.refuse(joint.prim, &name("high"), "at least the low limit"));
        }
        if !stated || is_close(low, a) && is_close(high, b) {
            axis.limits = Some([low, high]);
        }
    }
    let number = |of: &str| joint.number(&name(of), 0.0, STRONG);
    let (stiffness, damping) = (number("stiffness")?, number("damping")?);
    if stiffness.is_some() || damping.is_some() {
        axis.softness =
            Some(Softness { stiffness: stiffness.unwrap_or(0.0), damping: damping.unwrap_or(0.0) });
    }
    Ok(())
}

/// Reads further drives, and the exact values of that which UsdPhysics states.
fn own_drives(
    joint: &JointPrim<'_>,
    token: &str,
    shared: bool,
    axis: &mut JointAxis,
    warnings: &mut Vec<Warning>,
) -> Result<(), SceneError> {
    let is_there = |prefix: &str| joint.prim.properties.keys().any(|name| name.starts_with(prefix));
    let mut read = |prefix: &str| -> Result<Drive, SceneError> {
        let name = |of: &str| format!("{prefix}{of}");
        let mut drive = raw_drive(joint, &name)?;
        bound(joint, &name, &mut drive, warnings);
        Ok(drive)
    };
    let prefix = format!("drystone:drive:{token}:");
    match axis.drives.first_mut() {
        Some(said) => {
            for (of, value) in [
                ("targetPosition", &mut said.position),
                ("targetVelocity", &mut said.velocity),
                ("stiffness", &mut said.stiffness),
                ("damping", &mut said.damping),
            ] {
                let exact = joint.number(&format!("{prefix}{of}"), -STRONG, STRONG)?;
                *value = exact.filter(|exact| is_close(*exact, *value)).unwrap_or(*value);
            }
        }
        None if !shared && is_there(&prefix) => axis.drives.push(read(&prefix)?),
        None => {}
    }
    for number in 2_u32.. {
        let prefix = format!("drystone:drive{number}:{token}:");
        if !is_there(&prefix) {
            break;
        }
        axis.drives.push(read(&prefix)?);
    }
    Ok(())
}
