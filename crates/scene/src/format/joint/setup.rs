//! [`JointSetup`]: data shared by all joints of a scene while they are read.

use std::collections::BTreeMap;

use crate::description::Body;
use crate::format::tree::one_line;

/// Bodies that joints refer to.
pub(crate) struct JointSetup<'a> {
    pub(crate) dimension: usize,
    pub(crate) particles: bool,
    pub(crate) bodies: &'a [Body],
    /// Index of each body that has a name.
    pub(crate) names: BTreeMap<&'a str, usize>,
}

impl<'a> JointSetup<'a> {
    pub(crate) fn new(dimension: usize, particles: bool, bodies: &'a [Body]) -> Self {
        let name = |(i, body): (usize, &'a Body)| Some((body.name.as_deref()?, i));
        let names = bodies.iter().enumerate().filter_map(name).collect();
        Self { dimension, particles, bodies, names }
    }

    /// Returns the name of a body in messages.
    pub(super) fn name_of(&self, index: usize) -> String {
        match self.body(Some(index)).and_then(|body| body.name.as_deref()) {
            Some(name) => format!("body '{}'", one_line(name)),
            None => format!("body {index}"),
        }
    }

    /// Returns the body; `None` for the world.
    pub(super) fn body(&self, index: Option<usize>) -> Option<&'a Body> {
        self.bodies.get(index?)
    }
}
