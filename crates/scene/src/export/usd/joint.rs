//! Joints as prims of UsdPhysics.
//!
//! The type of the prim is the one whose locks the joint has. Limits and drives on further axes are
//! those of UsdPhysics as far as it has them. The rest goes into attributes of the namespace
//! `drystone:`, in SI units, which the guide for animators lists.
//!
//! Angles are written such that the reader gets the same bits. For about one in ten there is no such
//! number of degrees; an attribute in radians then follows.

use super::inverse;
use super::prim::{PrimWriter, list, quoted, space, tuple};
use crate::joint::{Coordinate, Drive, Joint, JointAxis};
use crate::usd::coordinates::{
    CONE, DISTANCE, ELLIPTIC, NAMES, ROT, TRANS, is_angle, is_shared, place_of,
};

/// Parent of the joints, below the root prim.
pub(super) const SCOPE: &str = "Joints";

const LOCKED: [f64; 2] = [0.0; 2];

/// Schemas of limits and drives, by the index of their coordinate.
const SCHEMAS: [(usize, [&str; 2]); 7] = [
    (0, ["PhysicsLimitAPI:transX", "PhysicsDriveAPI:transX"]),
    (1, ["PhysicsLimitAPI:transY", "PhysicsDriveAPI:transY"]),
    (2, ["PhysicsLimitAPI:transZ", "PhysicsDriveAPI:transZ"]),
    (DISTANCE, ["PhysicsLimitAPI:distance", "PhysicsDriveAPI:distance"]),
    (8, ["PhysicsLimitAPI:rotX", "PhysicsDriveAPI:rotX"]),
    (9, ["PhysicsLimitAPI:rotY", "PhysicsDriveAPI:rotY"]),
    (10, ["PhysicsLimitAPI:rotZ", "PhysicsDriveAPI:rotZ"]),
];

/// Types of joints.
#[derive(Clone, Copy, PartialEq)]
enum JointKind {
    Fixed,
    Revolute,
    Prismatic,
    Spherical,
    Distance,
    General,
}

impl JointKind {
    /// Returns the type whose locks the joint has.
    fn of(joint: &Joint) -> Self {
        let has = |place: usize| joint.axes.iter().any(|axis| place_of(&axis.coordinate) == place);
        let locked =
            |places: &[usize]| places.iter().all(|place| limits_of(joint, *place) == Some(LOCKED));
        let free = |places: &[usize]| !places.iter().any(|place| has(*place));
        if locked(&TRANS) && locked(&ROT) {
            Self::Fixed
        } else if locked(&TRANS) && locked(&[9, 10]) {
            Self::Revolute
        } else if locked(&[1, 2]) && locked(&ROT) {
            Self::Prismatic
        } else if locked(&TRANS) && free(&[9, 10]) && (free(&[8]) || cone(joint).is_some()) {
            Self::Spherical
        } else if free(&TRANS) && free(&ROT) && distance(joint).is_some() {
            Self::Distance
        } else {
            Self::General
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Fixed => "PhysicsFixedJoint",
            Self::Revolute => "PhysicsRevoluteJoint",
            Self::Prismatic => "PhysicsPrismaticJoint",
            Self::Spherical => "PhysicsSphericalJoint",
            Self::Distance => "PhysicsDistanceJoint",
            Self::General => "PhysicsJoint",
        }
    }

    /// Returns the coordinates that the type locks.
    fn locks(self) -> &'static [usize] {
        match self {
            Self::Fixed => &[0, 1, 2, 8, 9, 10],
            Self::Revolute => &[0, 1, 2, 9, 10],
            Self::Prismatic => &[1, 2, 8, 9, 10],
            Self::Spherical => &[0, 1, 2],
            Self::Distance | Self::General => &[],
        }
    }

    /// Returns the coordinate that the type leaves to a limit and a drive of its own, and the name
    /// of that drive.
    fn free(self) -> Option<(usize, &'static str, &'static str)> {
        match self {
            Self::Revolute => Some((8, "angular", "PhysicsDriveAPI:angular")),
            Self::Prismatic => Some((0, "linear", "PhysicsDriveAPI:linear")),
            _ => None,
        }
    }
}

fn limits_of(joint: &Joint, place: usize) -> Option<[f64; 2]> {
    joint.axes.iter().find(|axis| place_of(&axis.coordinate) == place)?.limits
}

/// Returns the half-angles of a cone about y and z that a ball joint can have. \[rad\]
fn cone(joint: &Joint) -> Option<[f64; 2]> {
    let is_angle = |angle: f64| angle > 0.0 && angle <= std::f64::consts::PI;
    let mut cones = joint.axes.iter().filter_map(|axis| match (axis.coordinate, axis.limits) {
        (Coordinate::Cone, Some([0.0, angle])) => Some([angle; 2]),
        (Coordinate::EllipticCone([y, z]), Some([0.0, 1.0])) if (y - z).abs() > 1e-9 => {
            Some([y, z])
        }
        (Coordinate::Cone | Coordinate::EllipticCone(_), _) => Some([f64::NAN; 2]),
        _ => None,
    });
    match (cones.next(), cones.next()) {
        (Some([y, z]), None) if is_angle(y) && is_angle(z) => Some([y, z]),
        _ => None,
    }
}

/// Returns the limits of a distance that a joint of distance can have. \[m\]
fn distance(joint: &Joint) -> Option<[f64; 2]> {
    let is_bound = |x: f64| x.is_infinite() || x >= 0.0;
    limits_of(joint, DISTANCE).filter(|[low, high]| {
        is_bound(*low) && is_bound(*high) && (low.is_finite() || high.is_finite())
    })
}

/// Returns the prim of a joint. `paths` are those of the bodies. The error says why it cannot be
/// written.
pub(super) fn prim(joint: &Joint, name: &str, paths: &[String]) -> Result<PrimWriter, String> {
    let kind = JointKind::of(joint);
    let mut prim = PrimWriter::new(kind.name(), name);
    match &joint.name {
        Some(own) if own == name => {}
        own => {
            let shown = quoted(own.as_deref().unwrap_or(""));
            prim.metadata.push(format!("displayName = {shown}"));
        }
    }
    // Limits and drives are of frame 1 relative to frame 0.
    for (side, end) in [(0, 1), (1, 0)] {
        if let Some(body) = joint.bodies[end] {
            prim.set(format!("rel physics:body{side}"), format!("<{}>", paths[body]));
        }
        let frame = &joint.frames[end];
        let [x, y, z, w] = frame.rotation.quaternion();
        prim.set(format!("point3f physics:localPos{side}"), tuple(&space(&frame.position)));
        prim.set(format!("quatf physics:localRot{side}"), tuple(&[w, x, y, z]));
    }
    if !joint.enabled {
        prim.set("bool physics:jointEnabled", 0);
    }
    if joint.collide {
        prim.set("bool physics:collisionEnabled", 1);
    }
    for (attribute, load) in [
        ("float physics:breakForce", joint.breaking.force),
        ("float physics:breakTorque", joint.breaking.torque),
        ("custom double drystone:breakImpulse", joint.breaking.impulse),
    ] {
        load.into_iter().for_each(|load| prim.set(attribute, load));
    }
    if matches!(kind, JointKind::Revolute | JointKind::Prismatic | JointKind::Spherical) {
        prim.set("uniform token physics:axis", "\"X\"");
    }
    axes(&mut prim, joint, kind)?;
    Ok(prim)
}

/// Writes the axes of a joint, and their order where the reader would find another.
fn axes(prim: &mut PrimWriter, joint: &Joint, kind: JointKind) -> Result<(), String> {
    let mut stated = kind.locks().to_vec();
    let mut order = Vec::new();
    for axis in &joint.axes {
        let place = place_of(&axis.coordinate);
        if order.contains(&place) {
            let what = "has two axes with the coordinate";
            return Err(format!("{what} {}, and a stage holds one of each", NAMES[place]));
        }
        order.push(place);
        let mut writer = AxisWriter { prim, joint, axis, place, kind };
        if writer.limits() | writer.drives() && !stated.contains(&place) {
            stated.push(place);
        }
        writer.own();
    }
    stated.sort_unstable();
    if stated != order || kind == JointKind::General {
        let names = order.iter().map(|place| format!("\"{}\"", NAMES[*place]));
        prim.set("custom token[] drystone:axes", list(names));
    }
    Ok(())
}

/// Writes an axis of a joint.
struct AxisWriter<'a> {
    prim: &'a mut PrimWriter,
    joint: &'a Joint,
    axis: &'a JointAxis,
    place: usize,
    kind: JointKind,
}

impl AxisWriter<'_> {
    fn name(&self) -> &'static str {
        NAMES[self.place]
    }

    /// Writes the limits. Returns true if attributes of UsdPhysics state any.
    fn limits(&mut self) -> bool {
        let Some([low, high]) = self.axis.limits else { return false };
        let place = self.place;
        if self.kind.locks().contains(&place) {
            return true;
        }
        let names = match self.kind {
            _ if self.kind.free().is_some_and(|(free, ..)| free == place) => {
                ["physics:lowerLimit", "physics:upperLimit"].map(str::to_owned)
            }
            JointKind::Distance if place == DISTANCE => {
                ["physics:minDistance", "physics:maxDistance"].map(str::to_owned)
            }
            JointKind::Spherical if matches!(place, CONE | ELLIPTIC) => return self.cone(),
            _ if is_shared(place) => {
                self.schema(0);
                ["low", "high"].map(|of| format!("limit:{}:physics:{of}", self.name()))
            }
            _ => {
                self.exact_limits();
                return false;
            }
        };
        if [low, high] == LOCKED && names[0].starts_with("limit:") {
            // Bounds in reverse order are UsdPhysics's sign of a lock.
            self.prim.set(format!("float {}", names[0]), 1);
            self.prim.set(format!("float {}", names[1]), -1);
            return true;
        }
        let mut exact = low.is_finite() || high.is_finite();
        for (name, bound) in names.iter().zip([low, high]) {
            if bound.is_finite() {
                exact &= self.position(name, bound);
            }
        }
        if !exact {
            self.exact_limits();
        }
        low.is_finite() || high.is_finite()
    }

    /// Writes a cone as half-angles of a ball joint, if it has that form.
    fn cone(&mut self) -> bool {
        let Some([y, z]) = cone(self.joint) else {
            self.exact_limits();
            return false;
        };
        let exact = self.position("physics:coneAngle0Limit", z)
            & self.position("physics:coneAngle1Limit", y);
        match self.axis.coordinate {
            _ if exact => {}
            Coordinate::EllipticCone(_) => self.half_angles(),
            _ => self.exact_limits(),
        }
        true
    }

    /// Writes a position, and returns true if the reader gets it without rounding. \[m, or rad\]
    fn position(&mut self, name: &str, position: f64) -> bool {
        let (written, exact) = match is_angle(self.place) {
            true => inverse(position, position.to_degrees(), f64::to_radians),
            false => (position, true),
        };
        self.prim.set(format!("float {name}"), written);
        exact
    }

    fn exact_limits(&mut self) {
        for (of, bound) in ["low", "high"].iter().zip(self.axis.limits.unwrap_or_default()) {
            self.prim.set(format!("custom double drystone:limit:{}:{of}", self.name()), bound);
        }
    }

    fn half_angles(&mut self) {
        if let Coordinate::EllipticCone(angles) = &self.axis.coordinate {
            self.prim.set("custom double2 drystone:ellipticCone:halfAngles", tuple(angles));
        }
    }

    /// Applies the schema of limits (0) or drives (1).
    fn schema(&mut self, which: usize) {
        let found = SCHEMAS.iter().find(|(place, _)| *place == self.place);
        self.prim.schemas.extend(found.map(|(_, schemas)| schemas[which]));
    }

    /// Writes the drives. Returns true if attributes of UsdPhysics state the first.
    fn drives(&mut self) -> bool {
        let Some((first, more)) = self.axis.drives.split_first() else { return false };
        let name = self.name();
        for (drive, number) in more.iter().zip(2..) {
            self.own_drive(&format!("drystone:drive{number}:{name}"), drive);
        }
        let free = self.kind.free().filter(|(place, ..)| *place == self.place);
        let prefix = match free {
            Some((_, token, schema)) => {
                self.prim.schemas.push(schema);
                token
            }
            None if is_shared(self.place) => {
                self.schema(1);
                name
            }
            None => {
                self.own_drive(&format!("drystone:drive:{name}"), first);
                return false;
            }
        };
        self.drive(&format!("drive:{prefix}:physics"), first);
        true
    }

    /// Writes a drive with the attributes of UsdPhysics, and exact values where these round.
    fn drive(&mut self, prefix: &str, drive: &Drive) {
        let turning = is_angle(self.place);
        if drive.acceleration {
            self.prim.set(format!("uniform token {prefix}:type"), "\"acceleration\"");
        }
        if drive.max_force.is_finite() {
            self.prim.set(format!("float {prefix}:maxForce"), drive.max_force);
        }
        type Conversion = fn(f64) -> f64;
        let [degrees, radians]: [Conversion; 2] = [f64::to_degrees, f64::to_radians];
        for (of, value, there, back) in [
            ("targetPosition", drive.position, degrees, radians),
            ("targetVelocity", drive.velocity, degrees, radians),
            ("stiffness", drive.stiffness, radians, degrees),
            ("damping", drive.damping, radians, degrees),
        ] {
            if value == 0.0 {
                continue;
            }
            let (written, exact) =
                if turning { inverse(value, there(value), back) } else { (value, true) };
            self.prim.set(format!("float {prefix}:{of}"), written);
            if !exact {
                let name = self.name();
                self.prim.set(format!("custom double drystone:drive:{name}:{of}"), value);
            }
        }
    }

    /// Writes a drive that UsdPhysics does not have.
    fn own_drive(&mut self, prefix: &str, drive: &Drive) {
        let kind = if drive.acceleration { "\"acceleration\"" } else { "\"force\"" };
        self.prim.set(format!("custom token {prefix}:type"), kind);
        for (of, value) in [
            ("maxForce", drive.max_force),
            ("targetPosition", drive.position),
            ("targetVelocity", drive.velocity),
            ("stiffness", drive.stiffness),
            ("damping", drive.damping),
        ] {
            self.prim.set(format!("custom double {prefix}:{of}"), value);
        }
    }

    /// Writes softness, friction and the parameters of the coordinate.
    fn own(&mut self) {
        let name = self.name();
        if let Some(softness) = &self.axis.softness {
            for (of, x) in [("stiffness", softness.stiffness), ("damping", softness.damping)] {
                self.prim.set(format!("custom double drystone:limit:{name}:{of}"), x);
            }
        }
        if self.axis.friction != 0.0 {
            let attribute = format!("custom double drystone:friction:{name}");
            self.prim.set(attribute, self.axis.friction);
        }
        let mut set = |of: &str, x: f64| self.prim.set(format!("custom double drystone:{of}"), x);
        match self.axis.coordinate {
            Coordinate::Gear { ratio } => set("gear:ratio", ratio),
            Coordinate::Rack { radius } => set("rack:radius", radius),
            Coordinate::Screw { pitch } => set("screw:pitch", pitch),
            Coordinate::Pulley { points, ratio } => {
                set("pulley:ratio", ratio);
                let points = list(points.iter().map(|point| tuple(point)));
                self.prim.set("custom double3[] drystone:pulley:points", points);
            }
            Coordinate::EllipticCone(_)
                if self.kind != JointKind::Spherical || cone(self.joint).is_none() =>
            {
                self.half_angles();
            }
            _ => {}
        }
    }
}
