//! The promises of the crate: mechanics, files, and the same bits each time.

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
#[allow(unused)]
mod flush;
mod fuzz;
mod gltf;
mod gltf_physics;
mod guide;
mod house;
#[allow(unused)]
mod infinite;
mod jam;
#[allow(unused)]
mod meshes;
mod motion_fuzz;
#[allow(unused)]
mod patches;
mod relations;
mod scene;
mod sleep;
#[allow(unused)]
mod spin;
#[allow(unused)]
mod squeeze;
#[allow(unused)]
mod surfaces;
mod usd;
mod world;
