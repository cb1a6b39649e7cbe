//! Bakes a scene file:
//! `cargo run --release -p drystone-bake --example bake -- scenes/arch.json out/arch.glb`

use std::error::Error;
use std::path::PathBuf;

use drystone::StepSettings;
use drystone_bake::check;
use drystone_bake::recording::{self, Recording, Sampling};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let file = arguments.next().unwrap_or_else(|| "scenes/arch.json".into());
    let output = arguments.next().unwrap_or_else(|| "out/arch.glb".into());
    let read = drystone_bake::read(&file)?;
    let scene = &read.scene;
    let settings = drystone_bake::settings(scene, StepSettings::certified())?;
    for finding in check::check(&read, &settings)? {
        println!("beware: {}; {}", finding.what, finding.advice);
    }

    let mut world = drystone_bake::build(scene, settings)?;
    let mut recording = Recording::of(scene);
    world.write_poses(&mut recording.poses);
    let (mut error, mut deepest) = (0.0f64, 0.0f64);
    for _ in 0..scene.steps.unwrap_or(600) {
        let report = world.step(scene.time_step).unwrap();
        error = error.max(report.certified.map_or(0.0, |of| of.error));
        deepest = deepest.max(world.measure().deepest_penetration);
        world.write_poses(&mut recording.poses);
    }
    println!("{} frames of {} bodies", recording.frames(), recording.bodies);
    println!("within {:.3} mm/s, deepest overlap {:.3} mm", error * 1e3, deepest * 1e3);

    if let Some(folder) = output.parent() {
        std::fs::create_dir_all(folder)?;
    }
    match &read.source {
        None => recording::glb::write(&output, scene, &recording, &Sampling::default())?,
        // A glTF scene is written as the same document with an animation added.
        Some(source) => drystone_scene::write_whole(&output, |out| {
            recording::gltf::write(out, source, &recording, &Sampling::default()).map(drop)
        })?,
    }
    println!("wrote {}", output.display());
    Ok(())
}
