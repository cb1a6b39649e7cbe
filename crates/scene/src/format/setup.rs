//! [`Setup`]: data shared by all bodies of a scene while they are read.

use std::cell::RefCell;
use std::collections::BTreeMap;

use super::cursor::Range;
use super::surface::{SurfaceFields, Systems};

pub(super) const POSITION: Range = Range::new(-1e6, 1e6, "m");

/// Data outside a body's own table that decides how the table is read.
pub(super) struct Setup {
    pub(super) dimension: usize,
    pub(super) particles: bool,
    pub(super) materials: BTreeMap<String, SurfaceFields>,
    pub(super) systems: RefCell<Systems>,
}
