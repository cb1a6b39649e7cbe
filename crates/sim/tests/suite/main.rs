//! Integration tests of the crate: mechanics, determinism, and the house.

mod allocation;
mod analytic;
mod apart;
mod common;
mod deforming;
mod determinism;
mod energy;
mod far;
mod flush;
mod house;
mod infinite;
mod jam;
mod joints;
mod meshes;
#[allow(unused)]
mod patches;
mod queries;
mod sleep;
mod spin;
mod squeeze;
#[cfg(feature = "serde")]
mod state;
mod surfaces;
mod world;
mod worst;
