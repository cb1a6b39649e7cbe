//! Steps of scenes on `wasm32-unknown-unknown`: no files, no clock, no threads, no imports.

use std::cell::RefCell;
use std::error::Error;
use std::path::Path;

use drystone::StepSettings;
use drystone_bake::recording::{Recording, poses};
use drystone_bake::{build, read, read_json, read_toml, settings};

thread_local! {
    static TEXT: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

/// Returns the address of memory for a scene of `length` bytes.
#[unsafe(no_mangle)]
pub extern "C" fn reserve(length: usize) -> *mut u8 {
    TEXT.with_borrow_mut(|text| {
        text.clear();
        text.resize(length, 0);
        text.as_mut_ptr()
    })
}

/// Takes steps of the scene in that memory, and returns the hash of its state; 0 after an error.
#[unsafe(no_mangle)]
pub extern "C" fn hash(certified: bool, steps: u32) -> u64 {
    let text = TEXT.with_borrow(|text| String::from_utf8_lossy(text).into_owned());
    hash_of(&text, certified, steps).unwrap_or(0)
}

/// Returns true if files, which a browser has not, are errors and no panics.
#[unsafe(no_mangle)]
pub extern "C" fn refuses_files() -> bool {
    let motion =
        Recording { dimension: 3, bodies: 0, frame_time: 0.1, start: 0, poses: Vec::new() };
    let written = poses::write(Path::new("out.poses"), &motion);
    read(Path::new("scene.toml")).is_err() && written.is_err()
}

/// Takes steps of a scene in TOML or JSON, and returns the hash of its state.
///
/// # Errors
/// The scene is wrong, or the world refuses it.
pub fn hash_of(text: &str, certified: bool, steps: u32) -> Result<u64, Box<dyn Error>> {
    let read = if text.trim_start().starts_with('{') { read_json } else { read_toml };
    let scene = read(Path::new("scene"), text)?.scene;
    let preset = if certified { StepSettings::certified() } else { StepSettings::realtime() };
    let mut world = build(&scene, settings(&scene, preset)?)?;
    world.time_stages(true);
    // A browser has one thread, whatever is asked for.
    world.set_threads(2);
    for _ in 0..steps {
        world.step(scene.time_step)?;
    }
    // A world goes on from its checkpoint.
    let state = world.checkpoint();
    world.step(scene.time_step)?;
    world.restore(&state)?;
    Ok(world.state_hash())
}
