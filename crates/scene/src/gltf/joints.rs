//! Builds joints from the nodes that have one.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;

use super::super::description::{Body, Motion, Rotation};
use super::super::error::{SceneError, Warning};
use super::super::graph::math;
use super::super::graph::transform::Affine;
use super::super::graph::unique;
use super::super::joint::{Joint, JointFrame};
use super::animation::{self, Animation};
use super::json::Cursor;
use super::nodes::Node;
use super::shared_joints::{OMI, SharedJoint};
use super::source::BodyNode;
use super::tables::{Dialect, SharedObjects};
use super::unknown::warn_unknown;

/// Data that the joints are built from.
pub(super) struct JointReader<'a> {
    pub(super) nodes: &'a [Node<'a>],
    pub(super) tables: &'a SharedObjects,
    pub(super) animation: &'a Animation,
    pub(super) dialect: Dialect,
    pub(super) bodies: &'a [Body],
    pub(super) body_nodes: &'a [BodyNode],
}

/// A joint of a node.
struct NodeJoint<'a> {
    at: Cursor<'a>,
    node: usize,
    connected: usize,
    shared: &'a SharedJoint,
    collide: bool,
}

/// Body that a node belongs to.
enum Holder {
    World,
    Body(usize),
    /// Node whose motion is not simulated.
    Nothing(usize),
}

/// Body of each node that has one, and the nodes that have a motion.
struct Holders {
    bodies: BTreeMap<usize, usize>,
    moving: BTreeSet<usize>,
}

impl JointReader<'_> {
    fn warn(&self, node: usize, what: impl Display, warnings: &mut Vec<Warning>) {
        if let Some(n) = self.nodes.get(node) {
            let message = format!("{}: {what}", n.label(node));
            warnings.push(Warning { place: n.cursor.place(), message });
        }
    }

    /// Reads the joints of all nodes, and returns those of the scene.
    pub(super) fn read(&self, warnings: &mut Vec<Warning>) -> Result<Vec<Joint>, SceneError> {
        let mut moving = BTreeSet::new();
        let mut found = Vec::new();
        for (index, node) in self.nodes.iter().enumerate() {
            let physics = node.cursor.extension(self.dialect.bodies())?;
            let member = |key| physics.as_ref().map_or(Ok(None), |physics| physics.get(key));
            if member("motion")?.is_some() {
                moving.insert(index);
            }
            let own = member("joint")?;
            let omi = node.cursor.extension(OMI)?;
            if own.is_some() && omi.is_some() && node.present {
                let other = self.dialect.bodies();
                self.warn(index, format!("its {OMI} is ignored beside {other}"), warnings);
            }
            let list = if own.is_some() { &self.tables.joints } else { &self.tables.omi_joints };
            if let Some(at) = own.or(omi) {
                found.extend(self.node_joint(index, at, list, warnings)?);
            }
        }
        let bodies = self.body_nodes.iter().enumerate().map(|(body, of)| (of.node, body));
        let holders = Holders { bodies: bodies.collect(), moving };
        let mut names = BTreeSet::new();
        let mut joints = Vec::new();
        for joint in &found {
            joints.extend(self.joint(joint, &holders, &mut names, warnings)?);
        }
        Ok(joints)
    }

    fn node_joint<'c>(
        &self,
        node: usize,
        at: Cursor<'c>,
        list: &'c [SharedJoint],
        warnings: &mut Vec<Warning>,
    ) -> Result<Option<NodeJoint<'c>>, SceneError> {
        warn_unknown(&at, &["connectedNode", "joint", "enableCollision"], warnings);
        let shared = list.get(at.require("joint")?.index(list.len(), "physics joints")?);
        let connected = at.require("connectedNode")?.index(self.nodes.len(), "nodes")?;
        let collide = at.get("enableCollision")?.map_or(Ok(false), |of| of.boolean())?;
        Ok(shared.map(|shared| NodeJoint { at, node, connected, shared, collide }))
    }

    /// Builds a joint; `None` if it cannot act.
    ///
    /// Its first body is that of the connected node: the extension measures the position of the
    /// connected node in the frame of the node with the joint.
    fn joint(
        &self,
        joint: &NodeJoint<'_>,
        holders: &Holders,
        names: &mut BTreeSet<String>,
        warnings: &mut Vec<Warning>,
    ) -> Result<Option<Joint>, SceneError> {
        let Some(node) = self.nodes.get(joint.node).filter(|node| node.present) else {
            return Ok(None);
        };
        let bodies = match self.joined(joint, holders)? {
            Ok(bodies) => bodies,
            Err(why) => {
                let what = format!("its joint is not simulated: {why}");
                self.warn(joint.node, what, warnings);
                return Ok(None);
            }
        };
        let shared = joint.shared;
        let mut frame = |body: Option<usize>, end: usize| {
            let top = body.and_then(|body| self.body_nodes.get(body)).map(|of| of.node);
            let chain = animation::chain(self.nodes, end);
            if top.is_none() && chain.iter().any(|i| self.animation.moves(*i)) {
                let what = "an animation moves it: its joint keeps its place in the world";
                self.warn(end, what, warnings);
            }
            self.frame(top, end, shared.twist)
        };
        let [a, b] = bodies;
        let frames = [frame(a, joint.connected), frame(b, joint.node)];
        if shared.axes.is_empty() {
            self.warn(joint.node, "its joint does not act: it limits and drives nothing", warnings);
        }
        let name = node.name.filter(|name| !name.is_empty());
        Ok(Some(Joint {
            name: name.map(|name| unique(name, &format!("node {}", joint.node), names)),
            bodies,
            frames,
            axes: shared.axes.clone(),
            breaking: shared.breaking,
            collide: joint.collide,
            enabled: shared.enabled,
        }))
    }

    /// Returns the bodies of the connected node and of the node itself, or why the joint cannot
    /// act.
    ///
    /// # Errors
    /// If both are the same body.
    fn joined(
        &self,
        joint: &NodeJoint<'_>,
        holders: &Holders,
    ) -> Result<Result<[Option<usize>; 2], String>, SceneError> {
        if !self.nodes.get(joint.connected).is_some_and(|node| node.present) {
            return Ok(Err("its connectedNode is not in the scene".to_owned()));
        }
        let label = |node: usize| self.nodes.get(node).map_or(String::new(), |n| n.label(node));
        let mut bodies = [None; 2];
        for (body, end) in bodies.iter_mut().zip([joint.connected, joint.node]) {
            *body = match self.holder(end, holders) {
                Holder::World => None,
                Holder::Body(index) => Some(index),
                Holder::Nothing(node) => {
                    let why = format!("{} has a motion and no collider that acts", label(node));
                    return Ok(Err(why));
                }
            };
        }
        let [a, b] = bodies;
        if a.is_some() && a == b {
            return Err(joint.at.fault(
                format!("joint of {}, whose nodes belong to the same body", label(joint.node)),
                "nodes of two bodies, or of a body and the world, are accepted",
            ));
        }
        let motion = |body: Option<usize>| Some(self.bodies.get(body?)?.motion);
        if !bodies.into_iter().any(|body| motion(body) == Some(Motion::Dynamic)) {
            return Ok(Err("neither of its nodes belongs to a dynamic body".to_owned()));
        }
        Ok(Ok(bodies))
    }

    /// Returns the body that a node belongs to: that of the nearest node above with a motion, else
    /// the static one that it is part of, else the world.
    fn holder(&self, node: usize, holders: &Holders) -> Holder {
        let chain = animation::chain(self.nodes, node);
        let mut up = chain.iter().rev();
        if let Some(moving) = up.clone().find(|i| holders.moving.contains(i)) {
            let body = holders.bodies.get(moving);
            return body.map_or(Holder::Nothing(*moving), |body| Holder::Body(*body));
        }
        up.find_map(|i| holders.bodies.get(i)).map_or(Holder::World, |body| Holder::Body(*body))
    }

    /// Returns the frame of a node in that of the body with the node `top`, or in the world. Its x
    /// axis is the axis `twist` of the node.
    fn frame(&self, top: Option<usize>, index: usize, twist: usize) -> JointFrame {
        let (mut place, mut turn) = (Affine::IDENTITY, math::NO_TURN);
        let mut next = Some(index).filter(|at| Some(*at) != top);
        // Composes local transforms only, so that values in the file come out unrounded.
        while let Some(node) = next.and_then(|at| self.nodes.get(at)) {
            place = node.matrix.after(&place);
            turn = math::quat_after(node.local.rotation, turn);
            next = node.parent.filter(|at| Some(*at) != top);
        }
        // Cyclic exchanges of the axes: their quaternions are exact.
        turn = match twist {
            1 => math::quat_mul(turn, [0.5, 0.5, 0.5, 0.5]),
            2 => math::quat_mul(turn, [-0.5, -0.5, -0.5, 0.5]),
            _ => turn,
        };
        let position = match top.and_then(|top| self.nodes.get(top)) {
            Some(body) => math::apply(body.scale(), place.shift),
            None => place.shift,
        };
        let rotation = Rotation::Quaternion(math::quat_as_written(turn).unwrap_or(math::NO_TURN));
        JointFrame { position: position.into(), rotation }
    }
}
