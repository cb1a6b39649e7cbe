//! The promises of the crate: formulas, forms that agree, answers that are known.

#[macro_use]
mod common;

#[cfg(feature = "assembled")]
mod assembly;
mod certificate;
#[cfg(feature = "assembled")]
mod degenerate;
mod equivalence;
mod impact;
mod methods;
#[cfg(feature = "assembled")]
mod notes;
#[cfg(feature = "assembled")]
mod problems;
mod thread_pool;
