//! Tests of layers over the stage that a scene was read from.

use std::fs;
use std::path::Path;

use drystone::StepSettings;
use drystone_bake::recording::joints::JointFrame;
use drystone_bake::recording::joints::JointLayout;
use drystone_bake::recording::{JointRecording, Recording, Sampling, usd_layer};
use drystone_bake::{Drystone, build};
use drystone_scene::{Motion, Read, usd};

/// A stage in centimeters with +z up, from time code 101 on. It has bodies below an animated
/// parent, below another body, below a parent that distorts and in an instance; pivots, materials
/// and a joint that breaks.
const SHOT: &str = include_str!("../corpus/shot.usda");

/// Bakes a second of the stage in a folder, 24 frames per second.
fn baked(folder: &Path) -> (Read, Recording, JointRecording) {
    let path = folder.join("shot.usda");
    fs::write(&path, SHOT).unwrap();
    let mut read = usd::read(&path, &Drystone).unwrap();
    read.scene.time_step = 1.0 / 24.0;
    let mut world = build(&read.scene, StepSettings::realtime()).unwrap();
    let mut recording = Recording::of(&read.scene);
    world.write_poses(&mut recording.poses);
    let (mut frames, mut broken) = (vec![JointFrame::of(&world, &read.scene)], Vec::new());
    for _ in 0..24 {
        broken.push(world.step(read.scene.time_step).unwrap().broken);
        world.write_poses(&mut recording.poses);
        frames.push(JointFrame::of(&world, &read.scene));
    }
    let layout = JointLayout::of(&read.scene);
    let joints = JointRecording::new(layout, &frames, broken.iter().map(Vec::as_slice));
    (read, recording, joints)
}

/// A layer names the stage, keeps its conventions, and changes nothing but what moves.
#[test]
fn a_layer_has_opinions_about_what_moves_only() {
    let folder = tempfile::tempdir().unwrap();
    let (read, recording, joints) = baked(folder.path());
    assert_eq!(joints.broken, [Some(1)]);
    fs::create_dir(folder.path().join("out")).unwrap();
    let path = folder.path().join("out/layer.usda");
    let source = read.stage.as_ref().unwrap();
    let from = (&read.scene, source);
    let warnings =
        usd_layer::write(&path, from, &recording, &joints, &Sampling::default()).unwrap();
    assert_eq!(warnings.len(), 1);
    assert!(warnings[0].message.contains("</Copy>: it has bodies or joints"), "{warnings:?}");
    let text = fs::read_to_string(&path).unwrap();
    for part in [
        "subLayers = [\n        @../shot.usda@\n    ]",
        "metersPerUnit = 0.01\n    startTimeCode = 101",
        "endTimeCode = 125",
        "timeCodesPerSecond = 24\n    upAxis = \"Z\"",
        "defaultPrim = \"Set\"",
        "[\"!resetXformStack!\", \"xformOp:translate:drystone\", \"xformOp:orient:drystone\"]",
        "instanceable = false",
        "bool physics:jointEnabled.timeSamples = { 101: 1, 102: 0, }",
        "matrix4d xformOp:transform:drystone.timeSamples = { 101: ((",
        "double3 xformOp:scale:drystone = (0.5, 0.75, 0.25)",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let overs: Vec<_> = text.lines().filter_map(|line| line.trim().strip_prefix("over ")).collect();
    let names = ["Copy", "Brick", "Set", "Crate", "Free", "Nested", "Squashed", "Block", "Thread"];
    assert_eq!(overs, names.map(|name| format!("\"{name}\" (")));
    assert!(!text.contains("def ") && !text.contains("material"), "{text}");
    // The animation moves five bodies that the simulation has moved.
    assert_eq!(text.matches("bool physics:kinematicEnabled = 1\n").count(), 5, "{text}");
}

/// Read again, the layer gives the bodies of the stage, which follow the recorded poses: below
/// animated parents, below bodies and relative to the stage.
#[test]
fn a_layer_gives_the_recorded_poses() {
    let folder = tempfile::tempdir().unwrap();
    let (read, recording, joints) = baked(folder.path());
    let path = folder.path().join("layer.usda");
    let from = (&read.scene, read.stage.as_ref().unwrap());
    usd_layer::write(&path, from, &recording, &joints, &Sampling::within(0.0)).unwrap();
    let again = usd::read(&path, &Drystone).unwrap().scene;
    assert_eq!(again.names(), read.scene.names());
    let mut moved = 0;
    for (index, (body, old)) in again.bodies.iter().zip(&read.scene.bodies).enumerate() {
        assert_eq!(body.shapes.len(), old.shapes.len(), "{:?}", body.name);
        if old.motion == Motion::Static {
            continue;
        }
        assert_eq!(body.motion, Motion::Kinematic, "{:?}", body.name);
        // The reader splits a distorted transform into rotation and scale in another way.
        let is_distorted = body.name.as_deref() == Some("Block");
        for (frame, time) in recording.times().enumerate() {
            let (position, rotation) = body.track.at(time);
            let pose: Vec<_> = recording.pose(frame, index).iter().map(|x| f64::from(*x)).collect();
            let off = |a: &[f64], b: &[f64], sign: f64| {
                a.iter().zip(b).map(|(a, b)| (a - sign * b).powi(2)).sum::<f64>().sqrt()
            };
            let far = off(&position, &pose[..3], 1.0);
            assert!(far < 2e-6, "{:?}, frame {frame}: {far} m", body.name);
            let turn = rotation.quaternion();
            let off = off(&turn, &pose[3..], 1.0).min(off(&turn, &pose[3..], -1.0));
            assert!(is_distorted || 2.0 * off < 2e-6, "{:?}, frame {frame}: {off}", body.name);
        }
        moved += 1;
    }
    assert_eq!(moved, 6);
}

/// Recordings of other scenes are refused.
#[test]
fn a_recording_of_another_scene_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (read, recording, joints) = baked(folder.path());
    let path = folder.path().join("layer.usda");
    let from = (&read.scene, read.stage.as_ref().unwrap());
    let other = Recording { bodies: 1, ..recording };
    let error = usd_layer::write(&path, from, &other, &joints, &Sampling::default()).unwrap_err();
    assert!(error.to_string().contains("1 bodies in 3D is not of a scene with 7"), "{error}");
    assert!(!path.exists());
}
