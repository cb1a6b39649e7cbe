//! [`Source`]: the glTF that a scene was read from, kept for writing it again.

use std::path::PathBuf;

use serde_json::Value;

use crate::graph::math::{Mat3, Quat};
use crate::graph::transform::{Affine, Trs};

/// Data needed to write the glTF of a scene again with an animation added.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// Document as read.
    pub document: Value,
    /// Bytes of each buffer; `None` if the file names no source for them.
    pub buffers: Vec<Option<Vec<u8>>>,
    /// Folder that relative paths start from.
    pub folder: PathBuf,
    /// Node of each body of the scene, in the same order.
    pub bodies: Vec<BodyNode>,
}

impl Source {
    /// Returns the linear maps of the collider nodes of a body without their rotation, as three
    /// columns each. \[1\]
    pub fn scales(&self, body: usize) -> &[[[f64; 3]; 3]] {
        self.bodies.get(body).map_or(&[], |node| &node.scales)
    }

    /// Returns the node that a body of the scene moves.
    pub fn node(&self, body: usize) -> Option<usize> {
        self.bodies.get(body).map(|b| b.node)
    }
}

/// Node of a body, and the transforms that convert the body's pose to the node's local transform.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyNode {
    /// Index of the node.
    pub node: usize,
    /// True if the body can move.
    pub moves: bool,
    /// True if an animation of the file moves it.
    pub driven: bool,
    /// Number of ancestors of the node.
    pub depth: usize,
    /// Nearest body above that can move.
    pub carrier: Option<usize>,
    /// Map from the space of the node's parent to that of the carrier's node, or to the world.
    pub parent: Affine,
    /// Rotation of the node's parent relative to the carrier's node, or to the world.
    pub parent_turn: Quat,
    /// Local transform as read.
    pub local: Trs,
    /// Map from the node's space to the body's frame: the node's transform without its rotation.
    pub rest: Mat3,
    /// Map of the node of each collider without its rotation.
    pub scales: Vec<Mat3>,
}

impl BodyNode {
    /// Returns true if the keys of this node come from the recording.
    pub fn is_written(&self) -> bool {
        self.moves && !self.driven
    }
}
