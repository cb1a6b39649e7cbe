//! [`Source`]: the glTF that a scene came from, kept to be written again.

use std::path::PathBuf;

use serde_json::Value;

use crate::scene::graph::math::{Mat3, Quat};
use crate::scene::graph::transform::{Affine, Trs};

/// What it takes to write the glTF of a scene again, with an animation added.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// The document as read.
    pub(crate) document: Value,
    /// Bytes of each buffer; none where the file does not say where they are.
    pub(crate) buffers: Vec<Option<Vec<u8>>>,
    /// Folder that relative paths start from.
    pub(crate) folder: PathBuf,
    /// The node of each body of the scene, in the same order.
    pub(crate) bodies: Vec<BodyNode>,
}

impl Source {
    /// The document as read.
    pub fn document(&self) -> &Value {
        &self.document
    }

    /// How the colliders of a body are scaled: what remains of the transforms of their nodes without
    /// rotation, as three columns. \[1\]
    pub fn scales(&self, body: usize) -> &[[[f64; 3]; 3]] {
        self.bodies.get(body).map_or(&[], |node| &node.scales)
    }

    /// The node that a body of the scene moves.
    pub fn node(&self, body: usize) -> Option<usize> {
        self.bodies.get(body).map(|b| b.node)
    }
}

/// The node of a body, and what turns the body's pose into the node's local transform.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct BodyNode {
    pub(crate) node: usize,
    /// Whether the body can move.
    pub(crate) moves: bool,
    /// Whether an animation of the file moves it.
    pub(crate) driven: bool,
    /// Number of ancestors of the node.
    pub(crate) depth: usize,
    /// The nearest body above that can move.
    pub(crate) carrier: Option<usize>,
    /// From the space of the node's parent to that of the carrier's node, or to the world.
    pub(crate) parent: Affine,
    /// Rotation of the node's parent in the carrier's node, or in the world.
    pub(crate) parent_turn: Quat,
    /// Local transform as read.
    pub(crate) local: Trs,
    /// From the node's space to the body's frame: the scale.
    pub(crate) rest: Mat3,
    /// The same of the node of each collider.
    pub(crate) scales: Vec<Mat3>,
}
