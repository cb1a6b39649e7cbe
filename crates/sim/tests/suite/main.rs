//! The promises of the crate: mechanics, files, and the same bits each time.

mod allocation;
mod analytic;
mod apart;
mod checkpoint;
mod common;
mod determinism;
mod energy;
mod fuzz;
mod gltf;
mod gltf_physics;
mod guide;
mod house;
mod jam;
mod patches;
mod scene;
mod sleep;
mod usd;
mod world;
