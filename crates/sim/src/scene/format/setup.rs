//! [`Setup`]: what the bodies of a scene have in common while they are read.

use std::cell::RefCell;
use std::collections::BTreeMap;

use super::surface::{Surface, Systems};
use super::walk::Range;

pub(super) const POSITION: Range = Range::new(-1e6, 1e6, "m");

/// What a body's meaning depends on besides its own table.
pub(super) struct Setup {
    pub(super) dimension: usize,
    pub(super) particles: bool,
    pub(super) materials: BTreeMap<String, Surface>,
    pub(super) systems: RefCell<Systems>,
}
