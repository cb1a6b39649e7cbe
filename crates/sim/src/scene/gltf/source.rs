//! [`Source`]: the glTF that a scene was read from, kept for writing it again.

use std::path::PathBuf;

use serde_json::Value;

use crate::scene::graph::math::{Mat3, Quat};
use crate::scene::graph::transform::{Affine, Trs};

/// Data needed to write the glTF of a scene again with an animation added.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// Document as read.
    pub(crate) document: Value,
    /// Bytes of each buffer; `None` if the file names no source for them.
    pub(crate) buffers: Vec<Option<Vec<u8>>>,
    /// Folder that relative paths start from.
    pub(crate) folder: PathBuf,
    /// Node of each body of the scene, in the same order.
    pub(crate) bodies: Vec<BodyNode>,
}

impl Source {
    /// Returns the document as read.
    pub fn document(&self) -> &Value {
        &self.document
    }

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
pub(crate) struct BodyNode {
    pub(crate) node: usize,
    /// Whether the body can move.
    pub(crate) moves: bool,
    /// Whether an animation of the file moves it.
    pub(crate) driven: bool,
    /// Number of ancestors of the node.
    pub(crate) depth: usize,
    /// Nearest body above that can move.
    pub(crate) carrier: Option<usize>,
    /// Map from the space of the node's parent to that of the carrier's node, or to the world.
    pub(crate) parent: Affine,
    /// Rotation of the node's parent relative to the carrier's node, or to the world.
    pub(crate) parent_turn: Quat,
    /// Local transform as read.
    pub(crate) local: Trs,
    /// Map from the node's space to the body's frame: the node's transform without its rotation.
    pub(crate) rest: Mat3,
    /// Map of the node of each collider without its rotation.
    pub(crate) scales: Vec<Mat3>,
}
