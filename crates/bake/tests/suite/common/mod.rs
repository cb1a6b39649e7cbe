//! Helpers of the tests: worlds and shapes, random scenes, mutations of files.

pub(crate) mod mutation;
pub(crate) mod scenes;
#[path = "../../../../sim/tests/suite/common/mod.rs"]
#[allow(dead_code)]
mod worlds;

pub(crate) use worlds::*;
