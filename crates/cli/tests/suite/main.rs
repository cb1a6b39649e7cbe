//! The command line as people use it.

mod bake;
mod check;
mod common;
mod convert;
mod faults;
mod matrix;
mod resume;
mod solve;
mod verify;
mod words;
