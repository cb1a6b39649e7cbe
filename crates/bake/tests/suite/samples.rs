//! Tests that public samples of physics in glTF and OpenUSD can be simulated.

use std::path::{Path, PathBuf};

use drystone::StepSettings;
use drystone_bake::{build, read};

fn scenes(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        let extension = path.extension().and_then(|extension| extension.to_str());
        if path.is_dir() {
            scenes(&path, files);
        } else if extension.is_some_and(|extension| ["gltf", "glb", "usda"].contains(&extension)) {
            files.push(path);
        }
    }
}

/// All public samples and tests of physics in glTF and OpenUSD that can be read stay finite for 40
/// steps at default settings.
#[test]
fn public_samples_bake_at_default_settings() {
    let Some(root) = std::env::var_os("DRYSTONE_DATA") else {
        eprintln!("skipped: DRYSTONE_DATA is not set");
        return;
    };
    let mut files = Vec::new();
    for folder in ["gltf/khr_physics/samples", "gltf/khr_physics/tests", "usd_physics"] {
        scenes(&Path::new(&root).join(folder), &mut files);
    }
    let mut ran = 0;
    for file in files {
        let Ok(scene) = read(&file) else { continue };
        let Ok(mut world) = build(&scene.scene, StepSettings::certified()) else { continue };
        ran += 1;
        for step in 0..40 {
            world.step(1.0 / 60.0).unwrap();
            let measure = world.measure();
            let finite = measure.finite && measure.kinetic_energy.is_finite();
            assert!(finite, "{}: step {step}", file.display());
        }
    }
    println!("{ran} samples");
    assert!(ran >= 12, "{ran} samples");
}
