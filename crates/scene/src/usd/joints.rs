//! Joints of UsdPhysics.
//!
//! Body 1 is body a of the joint, and body 0 is body b: limits and drives are of frame 1 relative to
//! frame 0, as in PhysX. A body may be named by any prim below it. Local positions scale with the
//! prim that is named; the transform of the joint's own prim has no meaning. A prim that is no body
//! stands for the world.

use std::collections::{BTreeMap, BTreeSet};

use super::super::error::{SceneError, Warning};
use super::super::graph::math::{self, Quat, Vec3};
use super::super::graph::transform::Affine;
use super::super::graph::{ENDLESS, FAR, TURN_SLACK, unique};
use super::joint_axes::{self, JointPrim};
use super::motion::Transforms;
use super::prims::Prim;
use super::stage::Stage;
use super::transform::Pose;
use crate::description::Rotation;
use crate::joint::{Breaking, Joint, JointFrame};

/// Joint types of UsdPhysics.
const KINDS: [&str; 6] = [
    "PhysicsJoint",
    "PhysicsDistanceJoint",
    "PhysicsFixedJoint",
    "PhysicsPrismaticJoint",
    "PhysicsRevoluteJoint",
    "PhysicsSphericalJoint",
];

/// Rotations that take x to axis x, y or z of a frame, y to the next one and z to the last.
const TURNS: [Quat; 3] = [math::NO_TURN, [0.5, 0.5, 0.5, 0.5], [-0.5, -0.5, -0.5, 0.5]];

/// Returns true if a prim is a joint of UsdPhysics.
pub(super) fn is_known(prim: &Prim) -> bool {
    KINDS.contains(&prim.kind.as_str())
}

/// The joints of a stage.
pub(super) struct UsdJoints {
    pub(super) all: Vec<Joint>,
    /// Index of the prim of each joint.
    pub(super) prims: Vec<usize>,
    /// Properties and schemas of joints that were not read, with the indices of the prims.
    pub(super) unread: Vec<(usize, String)>,
}

/// Reads all joints. `prims` are those of the bodies of the scene.
pub(super) fn all(
    stage: &Stage<'_>,
    transforms: &Transforms,
    prims: &[usize],
    warnings: &mut Vec<Warning>,
) -> Result<UsdJoints, SceneError> {
    let bodies = prims.iter().enumerate().map(|(body, prim)| (*prim, body)).collect();
    let reader = JointReader { stage, transforms, bodies };
    let mut names = BTreeSet::new();
    let mut joints = UsdJoints { all: Vec::new(), prims: Vec::new(), unread: Vec::new() };
    for (index, prim) in stage.prims.iter().enumerate().filter(|(_, prim)| is_known(prim)) {
        let own = JointPrim::new(stage, prim);
        if let Some(joint) = reader.joint(&own, &mut names, warnings)? {
            joints.all.push(joint);
            joints.prims.push(index);
        }
        joints.unread.extend(own.unread().into_iter().map(|name| (index, name)));
    }
    Ok(joints)
}

/// A body of a joint, the world if absent, and the frame in it.
type JointEnd = (Option<usize>, JointFrame);

struct JointReader<'s> {
    stage: &'s Stage<'s>,
    transforms: &'s Transforms,
    /// Bodies of the scene by their prims.
    bodies: BTreeMap<usize, usize>,
}

impl JointReader<'_> {
    fn joint(
        &self,
        own: &JointPrim<'_>,
        names: &mut BTreeSet<String>,
        warnings: &mut Vec<Warning>,
    ) -> Result<Option<Joint>, SceneError> {
        let (stage, prim) = (self.stage, own.prim);
        let (axes, first) = joint_axes::read(own, warnings)?;
        let breaking = breaking(own, warnings)?;
        let enabled = own.flag("physics:jointEnabled")? != Some(false);
        let collide = own.flag("physics:collisionEnabled")? == Some(true);
        // Bodies never form a tree here, so that it does not matter which joints would close loops.
        own.read("physics:excludeFromArticulation");
        let ends = [self.end(own, 1, first, warnings)?, self.end(own, 0, first, warnings)?];
        let [Some(a), Some(b)] = ends else { return Ok(None) };
        match (a.0, b.0) {
            (None, None) => {
                let what = "the joint is left out: both of its bodies are the world";
                stage.warn(prim, what, warnings);
                return Ok(None);
            }
            (Some(one), Some(other)) if one == other => {
                let of = |side| stage.targets(prim, side).first().cloned().unwrap_or_default();
                let value = format!(
                    "<{}>, as is physics:body0 <{}>",
                    of("physics:body1"),
                    of("physics:body0")
                );
                let accepted = "accepted: prims of two bodies, or none for the world; these are of \
                                one body";
                return Err(stage.wrong(prim, "physics:body1", value, accepted));
            }
            _ => {}
        }
        let sampled = prim.properties.iter().find(|(_, property)| {
            property.samples.as_ref().is_some_and(|samples| samples.len() > 1)
        });
        if let Some((name, _)) = sampled {
            stage.warn(prim, format!("{name} changes with time: its first value acts"), warnings);
        }
        let name = prim.label.as_deref().unwrap_or(&prim.name);
        let name = (!name.is_empty()).then(|| unique(name, &prim.path, names));
        let (bodies, frames) = ([a.0, b.0], [a.1, b.1]);
        Ok(Some(Joint { name, bodies, frames, axes, breaking, collide, enabled }))
    }

    /// Reads the body and the frame at one side of a joint. `None`, with a warning, if the body is
    /// not there.
    fn end(
        &self,
        own: &JointPrim<'_>,
        side: usize,
        first: usize,
        warnings: &mut Vec<Warning>,
    ) -> Result<Option<JointEnd>, SceneError> {
        let (stage, prim) = (self.stage, own.prim);
        let name = format!("physics:body{side}");
        let targets = stage.targets(prim, own.read(&name));
        let frame = self.frame(own, side)?;
        let end = match targets.first() {
            None => Some(self.in_world(frame)),
            Some(path) => self.on_prim(own, (&name, path), frame, warnings)?,
        };
        if targets.len() > 1 {
            stage.warn(prim, format!("{name}: only the first of its prims counts"), warnings);
        }
        Ok(end.map(|(body, position, rotation)| {
            let rotation = match (rotation, TURNS.get(first).copied().unwrap_or(math::NO_TURN)) {
                (turn, math::NO_TURN) | (math::NO_TURN, turn) => turn,
                (rotation, turn) => math::quat_mul(rotation, turn),
            };
            let rotation = Rotation::Quaternion(rotation);
            (body, JointFrame { position: position.into(), rotation })
        }))
    }

    /// Returns a frame of the stage as one of the world.
    fn in_world(&self, pose: Pose) -> (Option<usize>, Vec3, Quat) {
        let units = self.stage.units;
        (None, units.length(pose.map.shift), units.turn(pose.turn))
    }

    /// Returns the body of the prim that a relationship of the joint names, and the frame in it.
    fn on_prim(
        &self,
        own: &JointPrim<'_>,
        (name, path): (&str, &str),
        frame: Pose,
        warnings: &mut Vec<Warning>,
    ) -> Result<Option<(Option<usize>, Vec3, Quat)>, SceneError> {
        let (stage, prim) = (self.stage, own.prim);
        let Some(named) = stage.find(path) else {
            let what = format!("the joint is left out: {name} <{path}> does not exist");
            stage.warn(prim, what, warnings);
            return Ok(None);
        };
        let pose = self.transforms.of(named);
        if math::determinant(pose.map.linear) < 0.0 {
            let accepted = "accepted: a prim whose scale does not mirror";
            return Err(stage.wrong(prim, name, format!("<{path}>"), accepted));
        }
        let is_rigid = |above: &Prim| above.schemas.contains("PhysicsRigidBodyAPI");
        let mut above = stage.up(named);
        let found = above.find(|(at, above)| is_rigid(above) || self.bodies.contains_key(at));
        let Some((index, body)) = found else {
            if self.transforms.driven(stage, named) {
                let what = format!("{name} <{path}> is no body: its animation does not move it");
                stage.warn(prim, what, warnings);
            }
            return Ok(Some(self.in_world(pose.after(&frame))));
        };
        let Some(number) = self.bodies.get(&index) else {
            let what = format!("the joint is left out: its body <{}> is not simulated", body.path);
            stage.warn(prim, what, warnings);
            return Ok(None);
        };
        let (place, turn) = self.transforms.seen_from(stage, (named, frame), index);
        let scale = self.transforms.scale(stage, index);
        let place = if scale == math::IDENTITY { place } else { math::apply(scale, place) };
        Ok(Some((Some(*number), place, turn)))
    }

    /// Reads the frame at one side, relative to the prim that the joint names.
    fn frame(&self, own: &JointPrim<'_>, side: usize) -> Result<Pose, SceneError> {
        let (stage, prim) = (self.stage, own.prim);
        let [place, turn] = ["Pos", "Rot"].map(|of| format!("physics:local{of}{side}"));
        let shift = stage.vector::<3>(prim, own.read(&place), FAR)?.unwrap_or_default();
        let written = stage.vector::<4>(prim, own.read(&turn), FAR)?;
        let [w, x, y, z] = written.unwrap_or([1.0, 0.0, 0.0, 0.0]);
        let length = math::quat_dot([x, y, z, w], [x, y, z, w]).sqrt();
        let unit = math::quat_as_written([x, y, z, w]);
        match unit.filter(|_| (length - 1.0).abs() <= TURN_SLACK) {
            Some(unit) => {
                let turned = Pose::turned(unit);
                Ok(Pose { map: Affine { shift, ..turned.map }, ..turned })
            }
            None => Err(stage.refuse(prim, &turn, "a quaternion (w, x, y, z) of length 1")),
        }
    }
}

/// Reads the loads at which a joint breaks. Infinite ones never break it; they are the default of
/// UsdPhysics, and kept beside a finite one only.
fn breaking(own: &JointPrim<'_>, warnings: &mut Vec<Warning>) -> Result<Breaking, SceneError> {
    let units = own.stage.units;
    let newton = units.kilograms * units.meters;
    let mut load = |name: &str, unit: f64| -> Result<Option<f64>, SceneError> {
        let stated = own.stage.number(own.prim, name, 0.0, f64::INFINITY)?;
        let load = own.load(name, unit, warnings)?;
        // Other programs write FLT_MAX for no threshold.
        Ok(load.filter(|_| !stated.is_some_and(|load| (ENDLESS..f64::INFINITY).contains(&load))))
    };
    let force = load("physics:breakForce", newton)?;
    let torque = load("physics:breakTorque", newton * units.meters)?;
    let impulse = load("drystone:breakImpulse", 1.0)?;
    let breaks = [force, torque, impulse].into_iter().flatten().any(f64::is_finite);
    Ok(if breaks { Breaking { force, torque, impulse } } else { Breaking::default() })
}

#[cfg(test)]
mod tests;
