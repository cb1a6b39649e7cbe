//! Integration tests of the crate: mechanics, files, and determinism.

mod allocation;
mod analytic;
mod apart;
mod audit;
mod checkpoint;
mod common;
mod decomposition;
mod determinism;
mod energy;
mod far;
mod field;
mod flush;
mod fuzz;
mod gltf;
mod gltf_physics;
mod guide;
mod house;
mod infinite;
mod jam;
mod meshes;
mod motion_fuzz;
#[allow(unused)]
mod patches;
mod relations;
mod scene;
mod sleep;
mod spin;
mod squeeze;
mod state;
mod surfaces;
mod usd;
mod world;
