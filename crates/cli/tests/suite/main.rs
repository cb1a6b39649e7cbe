//! The command line as people use it.

mod bake;
mod check;
mod common;
mod matrix;
mod solve;
mod verify;
