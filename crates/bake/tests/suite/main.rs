//! Integration tests of the crate: scenes, checks, bakes and recordings.

mod any_world;
mod audit;
mod breaking;
mod checkpoint;
mod common;
mod contacts;
mod decomposition;
mod deforming;
mod field;
mod fuzz;
mod gltf;
mod gltf_physics;
mod guide;
mod joint_samples;
mod motion_fuzz;
mod relations;
mod released;
mod round_trips;
mod samples;
mod scene;
mod settings;
mod surfaces;
mod usd;
mod usd_layer;
mod world_track;
