//! Takes steps of scenes as `drystone bake --steps N --threads 1` does, and prints the hash of the
//! state after each: what it prints as WebAssembly has to be what a bake reports.

use std::path::Path;
use std::process::ExitCode;

use drystone::StepSettings;
use drystone_bake::build;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let steps = arguments.next().and_then(|steps| steps.parse().ok());
    let Some(steps) = steps else {
        eprintln!("usage: golden STEPS SCENE...");
        return ExitCode::from(2);
    };
    for path in arguments {
        if let Err(error) = hashes(&path, steps) {
            eprintln!("{error}");
            return ExitCode::from(2);
        }
    }
    ExitCode::SUCCESS
}

fn hashes(path: &str, steps: usize) -> Result<(), Box<dyn std::error::Error>> {
    let scene = drystone_bake::read(Path::new(path))?.scene;
    let mut world = build(&scene, drystone_bake::settings(&scene, StepSettings::certified())?)?;
    for step in 1..=steps {
        world.step(scene.time_step).expect("a scene that was read");
        println!("{path} {step} {:016x}", world.state_hash());
    }
    Ok(())
}
