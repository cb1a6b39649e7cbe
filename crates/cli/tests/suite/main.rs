//! Tests of the command line.

mod bake;
mod check;
mod common;
mod convert;
mod decompose;
mod faults;
mod joints;
mod matrix;
mod resume;
mod solve;
mod verify;
mod words;
