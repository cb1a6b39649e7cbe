//! Fuzz tests of all readers: any file is read or refused without a panic, in bounded time and
//! memory.
//!
//! Inputs that once failed are kept in `tests/corpus` and tried first.

use std::path::{Path, PathBuf};

use crate::common::counting::largest;
use crate::common::mutation::{fuzz, try_one};
use drystone::StepSettings;
use drystone_bake::recording::joints::{AxisName, JointFrame, JointLayout};
use drystone_bake::recording::{JointRecording, Recording, Velocities, journal, npz, poses};
use drystone_bake::{PairImpulses, build};
use drystone_scene::{to_json, to_toml};
use serde_json::Value;

/// Largest allocation that reading may make, beyond 64 times the input. \[byte\]
const ROOM: usize = 64 << 20;

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

/// Returns the contents of an example scene of the project.
fn example(name: &str) -> Vec<u8> {
    std::fs::read(folder("../../scenes").join(name)).unwrap()
}

/// Tries the inputs that once failed, then mutations of the corpus. No read may panic, take longer
/// than 20 s or allocate more than `ROOM` plus 64 times the input at once.
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

/// Returns a function that writes bytes to a file with this extension and reads it.
fn as_file(extension: &str, read: impl Fn(&Path)) -> impl Fn(&[u8]) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("input.{extension}"));
    move |input| {
        // Keeps the folder alive as long as the closure.
        let _ = &folder;
        std::fs::write(&path, input).unwrap();
        read(&path);
    }
}

/// Asserts that a scene of Drystone's own format survives writing and reading, then calls
/// [`use_scene`].
fn use_own(scene: &drystone_scene::Scene) {
    let again = drystone_bake::read_json(Path::new("again.json"), &to_json(scene));
    assert_eq!(again.map(|read| read.scene).as_ref(), Ok(scene));
    let again = drystone_bake::read_toml(Path::new("again.toml"), &to_toml(scene));
    assert_eq!(again.map(|read| read.scene).as_ref(), Ok(scene));
    use_scene(scene);
}

/// Writes and builds a scene, which must not panic.
fn use_scene(scene: &drystone_scene::Scene) {
    // Writing must not panic. The TOML text of a scene of defaults is empty.
    drop([to_json(scene), to_toml(scene)]);
    if let Ok(settings) = drystone_bake::settings(scene, StepSettings::realtime()) {
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
    ],
    "joints": [
        { "type": "hinge", "name": "door", "bodies": [1, "floor"], "anchor": [0, 1, 0],
          "axis": [0, 1, 0], "limits": [-1, "inf"], "spring": { "frequency": 2, "rest": 1 },
          "motor": { "velocity": 2, "at_most": 3 }, "breaking": { "force": 5 } },
        { "type": "general", "bodies": [-1, 1], "frames": [{ "position": [0, 1, 0] }, {}],
          "x": "locked", "y": [0, 1], "order": ["pulley", "x", "y", "elliptic_cone"],
          "elliptic_cone": { "half_angles": [0.1, 0.2], "limit_stiffness": 2 },
          "pulley": { "points": [[0, 1, 0], [1, 0, 0]], "drives": [{ "damping": "inf" }] } },
        { "type": "rope", "bodies": [1, 2], "anchors": [[0, 1, 0], [0, 0, 1]], "collide": true }
    ]
}"#;

const FLAT: &str = "dimension = 2\nsteps = 5\nbodies_as = \"particles\"\n[[bodies]]\nrotation = 0.5\n\
                    linear_velocity = [1, 2]\nshapes = [{type = \"sphere\", radius = 0.5}]\n";

/// Mutated JSON scenes are read or refused within the bounds of [`run`]. A scene that is read
/// survives writing and reading.
#[test]
fn scenes_as_json() {
    let wall = String::from_utf8(example("wall_2d.json")).unwrap();
    let corpus = [SMALL.into(), wall.into_bytes()];
    run("json", &corpus, true, |input| {
        let Ok(text) = std::str::from_utf8(input) else { return };
        if let Ok(read) = drystone_bake::read_json(Path::new("input.json"), text) {
            use_own(&read.scene);
        }
    });
}

/// Mutated TOML scenes are read or refused within the bounds of [`run`]. A scene that is read
/// survives writing and reading.
#[test]
fn scenes_as_toml() {
    let small = drystone_bake::read_json(Path::new("small.json"), SMALL).unwrap().scene;
    let corpus = [to_toml(&small).into_bytes(), FLAT.into(), example("billiards.toml")];
    run("toml", &corpus, false, |input| {
        let Ok(text) = std::str::from_utf8(input) else { return };
        if let Ok(read) = drystone_bake::read_toml(Path::new("input.toml"), text) {
            use_own(&read.scene);
        }
    });
}

/// Returns a glTF document with all that the reader knows.
fn document() -> Value {
    serde_json::from_str(include_str!("../corpus/seed.gltf")).unwrap()
}

fn read_any(path: &Path) {
    if let Ok(read) = drystone_bake::read(path) {
        use_scene(&read.scene);
    }
}

/// Mutated glTF documents are read or refused within the bounds of [`run`].
#[test]
fn gltf_documents() {
    let corpus = [serde_json::to_vec(&document()).unwrap()];
    run("gltf", &corpus, true, as_file("gltf", read_any));
}

/// Mutated GLB files are read or refused within the bounds of [`run`].
#[test]
fn glb_containers() {
    let mut glb = Vec::new();
    let mut document = document();
    let buffer: Vec<u8> = (0..200u8).collect();
    document["buffers"][0].as_object_mut().unwrap().remove("uri");
    drystone_scene::export::write_glb(&mut glb, &document, &buffer).unwrap();
    run("glb", &[glb], false, as_file("glb", read_any));
}

/// Mutated OpenUSD stages are read or refused within the bounds of [`run`].
#[test]
fn stages_as_usda() {
    let corpus = [include_bytes!("../corpus/seed.usda").to_vec()];
    run("usda", &corpus, false, as_file("usda", read_any));
}

fn recording() -> Recording {
    let poses = (0..3 * 2 * 7).map(|i| i as f32 / 3.0).collect();
    Recording { dimension: 3, bodies: 2, frame_time: 0.5, start: 0, poses }
}

fn joints() -> JointRecording {
    let axes = vec![AxisName { joint: 0, coordinate: "twist".to_owned() }];
    let layout = JointLayout { names: vec!["hinge".to_owned()], axes };
    let (values, loads) = (vec![0.5; 3], vec![0.25; 6]);
    JointRecording { layout, values, loads, broken: vec![Some(2)] }
}

fn written(write: impl Fn(&Path)) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("seed");
    write(&path);
    std::fs::read(path).unwrap()
}

/// Mutated NPZ recordings are read or refused within the bounds of [`run`]. Their names and poses
/// are as many as their bodies.
#[test]
fn arrays_of_poses() {
    let names = ["ball".to_owned(), "Würfel 2".to_owned()];
    let (recording, joints) = (recording(), joints());
    let velocities = Velocities { numbers: vec![0.25; 3 * 2 * 6] };
    let arrays = npz::Arrays {
        recording: &recording,
        velocities: &velocities,
        names: &names,
        contacts: &[0, 4, 5],
        joints: &joints,
    };
    let seed = written(|path| npz::write(path, &arrays).unwrap());
    let read = |path: &Path| {
        if let Ok(named) = npz::read(path) {
            assert_eq!(named.names.len(), named.recording.bodies);
            let frames = named.recording.frames();
            assert!(frames == 0 || !named.recording.pose(frames - 1, 0).is_empty());
        }
    };
    run("npz", &[seed], false, as_file("npz", read));
}

/// Mutated raw poses are read or refused within the bounds of [`run`], whatever the stated number
/// of bodies.
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

/// Mutated journals are read or refused within the bounds of [`run`], with as many names as bodies.
#[test]
fn journals() {
    let small = drystone_bake::read_json(Path::new("small.json"), SMALL).unwrap().scene;
    let seed = written(|path| {
        let header = journal::Header::new(&small, &StepSettings::certified());
        let mut journal = journal::Journal::create(path, &header).unwrap();
        let state = journal::FrameState {
            poses: &[0.5; 21],
            joints: &JointFrame::default(),
            velocities: &[],
            contacts: &PairImpulses::NONE,
        };
        journal.frame(None, &state).unwrap();
        journal.checkpoint(&[7; 30]).unwrap();
    });
    let read = |path: &Path| {
        if let Ok(contents) = journal::read(path) {
            assert_eq!(contents.header.names.len(), contents.recording.bodies);
        }
    };
    run("journal", &[seed], false, as_file("journal", read));
}
