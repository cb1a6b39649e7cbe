//! Tests of the crate's promises: the formulas of the notes, forms that must agree, and problems
//! with known answers.

#[macro_use]
mod common;

#[cfg(feature = "assembled")]
mod assembled_joints;
#[cfg(feature = "assembled")]
mod assembly;
mod certificate;
#[cfg(feature = "assembled")]
mod degenerate;
mod equivalence;
mod impact;
mod joints;
mod methods;
#[cfg(feature = "assembled")]
mod notes;
#[cfg(feature = "assembled")]
mod problems;
mod theorem;
mod thread_pool;
