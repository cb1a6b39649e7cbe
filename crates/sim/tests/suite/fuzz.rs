//! Files that come from anywhere: read or refused, without a panic, in bounded time and memory.
//!
//! What once failed is kept in `tests/corpus` and tried first.

use std::path::{Path, PathBuf};

use crate::allocation::largest;
use crate::common::mutation::{fuzz, try_one};
use drystone::recording::{Recording, journal, npz, poses};
use drystone::scene::{self, format, to_json, to_toml};
use drystone::{StepSettings, build};
use serde_json::Value;

/// The largest piece of memory that reading may ask for, beyond a multiple of the input. \[byte\]
const ROOM: usize = 64 << 20;

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

/// A file of the scenes that come with the project.
fn example(name: &str) -> Vec<u8> {
    std::fs::read(folder("../../scenes").join(name)).unwrap()
}

/// Tries what once failed, then what fuzzing makes of the corpus.
fn run(kind: &str, corpus: &[Vec<u8>], json: bool, read: impl Fn(&[u8])) {
    let bounded = |input: &[u8]| {
        let most = largest(|| read(input));
        assert!(most <= ROOM + 64 * input.len(), "{most} bytes for {}", input.len());
    };
    let faults = folder("tests/corpus").join(kind);
    for entry in std::fs::read_dir(faults).into_iter().flatten() {
        let path = entry.unwrap().path();
        try_one(kind, &std::fs::read(&path).unwrap(), bounded);
    }
    fuzz(kind, corpus, json, bounded);
}

/// A way to read bytes as a file of this extension.
fn as_file(extension: &str, read: impl Fn(&Path)) -> impl Fn(&[u8]) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("input.{extension}"));
    move |input| {
        // Lives as long as this closure.
        let _ = &folder;
        std::fs::write(&path, input).unwrap();
        read(&path);
    }
}

/// What every scene of the own format must be good for.
fn use_own(scene: &scene::Scene) {
    let again = format::read_json(Path::new("again.json"), &to_json(scene));
    assert_eq!(again.map(|read| read.scene).as_ref(), Ok(scene));
    let again = format::read_toml(Path::new("again.toml"), &to_toml(scene));
    assert_eq!(again.map(|read| read.scene).as_ref(), Ok(scene));
    use_scene(scene);
}

/// What every scene that was read must be good for.
fn use_scene(scene: &scene::Scene) {
    // Written without a panic; of nothing but defaults, TOML is no text at all.
    drop([to_json(scene), to_toml(scene)]);
    if let Ok(settings) = scene.settings(StepSettings::realtime()) {
        drop(build(scene, settings));
    }
}

const SMALL: &str = r#"{
    "name": "small", "dimension": 3, "gravity": [0, -9.81, 0], "time_step": 0.01, "duration": 2,
    "solver": { "substeps": 4, "impact_law": "poisson" },
    "materials": { "stone": { "density": 2600, "friction": 0.6, "restitution_combine": "minimum" } },
    "bodies": [
        { "name": "floor", "motion": "static", "shapes": [{ "type": "halfspace", "normal": [0, 1, 0] }] },
        { "position": [0, 1, 0], "rotation": [0, 0, 0, 1], "material": "stone", "mass": "inf",
          "inertia": [1, 2, "inf"], "inertia_rotation": [0, 1, 0, 0], "center_of_mass": [0, 0.1, 0],
          "collision": { "systems": ["a"], "not_collides_with": ["b"] },
          "shapes": [
            { "type": "box", "half_extents": [0.1, 0.2, 0.3], "position": [0, 0.1, 0] },
            { "type": "capsule", "radius": 0.1, "half_height": 0.2, "friction": 0.1 },
            { "type": "cylinder", "radius": 0.1, "half_height": 0.2 },
            { "type": "convex_hull", "points": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]] }] },
        { "motion": "kinematic", "gravity_factor": 0.5,
          "track": [{ "time": 0, "position": [0, 0, 0] }, { "time": 1, "rotation": [0, 1, 0, 0] }],
          "shapes": [{ "type": "trimesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 0, 1]],
                       "triangles": [[0, 1, 2]] }] }
    ]
}"#;

const FLAT: &str = "dimension = 2\nsteps = 5\nbodies_as = \"particles\"\n[[bodies]]\nrotation = 0.5\n\
                    linear_velocity = [1, 2]\nshapes = [{type = \"sphere\", radius = 0.5}]\n";

#[test]
fn scenes_as_json() {
    let wall = String::from_utf8(example("wall_2d.json")).unwrap();
    let corpus = [SMALL.into(), wall.into_bytes()];
    run("json", &corpus, true, |input| {
        let Ok(text) = std::str::from_utf8(input) else { return };
        if let Ok(read) = format::read_json(Path::new("input.json"), text) {
            use_own(&read.scene);
        }
    });
}

#[test]
fn scenes_as_toml() {
    let small = format::read_json(Path::new("small.json"), SMALL).unwrap().scene;
    let corpus = [to_toml(&small).into_bytes(), FLAT.into(), example("billiards.toml")];
    run("toml", &corpus, false, |input| {
        let Ok(text) = std::str::from_utf8(input) else { return };
        if let Ok(read) = format::read_toml(Path::new("input.toml"), text) {
            use_own(&read.scene);
        }
    });
}

/// A glTF with all that the reader knows.
fn document() -> Value {
    serde_json::from_str(include_str!("../corpus/seed.gltf")).unwrap()
}

fn read_any(path: &Path) {
    if let Ok(read) = scene::read(path) {
        use_scene(&read.scene);
    }
}

#[test]
fn gltf_documents() {
    let corpus = [serde_json::to_vec(&document()).unwrap()];
    run("gltf", &corpus, true, as_file("gltf", read_any));
}

#[test]
fn glb_containers() {
    let mut glb = Vec::new();
    let mut document = document();
    let buffer: Vec<u8> = (0..200u8).collect();
    document["buffers"][0].as_object_mut().unwrap().remove("uri");
    drystone::recording::buffer::write_glb(&mut glb, &document, &buffer).unwrap();
    run("glb", &[glb], false, as_file("glb", read_any));
}

#[test]
fn stages_as_usda() {
    let corpus = [include_bytes!("../corpus/seed.usda").to_vec()];
    run("usda", &corpus, false, as_file("usda", read_any));
}

fn recording() -> Recording {
    let poses = (0..3 * 2 * 7).map(|i| i as f32 / 3.0).collect();
    Recording { dimension: 3, bodies: 2, frame_time: 0.5, start: 0, poses }
}

fn written(write: impl Fn(&Path)) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("seed");
    write(&path);
    std::fs::read(path).unwrap()
}

#[test]
fn arrays_of_poses() {
    let names = ["ball".to_owned(), "Würfel 2".to_owned()];
    let seed = written(|path| npz::write(path, &recording(), &names, &[0, 4, 5]).unwrap());
    let read = |path: &Path| {
        if let Ok(named) = npz::read(path) {
            assert_eq!(named.names.len(), named.recording.bodies);
            let frames = named.recording.frames();
            assert!(frames == 0 || !named.recording.pose(frames - 1, 0).is_empty());
        }
    };
    run("npz", &[seed], false, as_file("npz", read));
}

#[test]
fn raw_poses() {
    let seed = written(|path| poses::write(path, &recording()).unwrap());
    let read = |path: &Path| {
        for (dimension, bodies) in [(3, 2), (2, 3), (3, 0), (2, usize::MAX)] {
            let _ = poses::read(path, dimension, bodies, 0.1);
        }
    };
    run("poses", &[seed], false, as_file("poses", read));
}

#[test]
fn journals() {
    let small = format::read_json(Path::new("small.json"), SMALL).unwrap().scene;
    let seed = written(|path| {
        let header = journal::Header::new(&small, &StepSettings::certified());
        let mut journal = journal::Journal::create(path, &header).unwrap();
        journal.frame(None, &[0.5; 21]).unwrap();
        journal.checkpoint(&[7; 30]).unwrap();
    });
    let read = |path: &Path| {
        if let Ok(contents) = journal::read(path) {
            assert_eq!(contents.header.names.len(), contents.recording.bodies);
        }
    };
    run("journal", &[seed], false, as_file("journal", read));
}
