//! Tests on the public test files for glTF physics, which are in the folder that the environment
//! variable DRYSTONE_DATA names. Without it they are skipped.

use std::path::PathBuf;

use crate::common::{GRAVITY, assert_within};
use drystone::StepSettings;
use drystone_bake::recording::Recording;
use drystone_bake::{build, read};
use drystone_scene::{Motion, Scene};
use serde_json::Value;

/// Steps per second. \[Hz\]
const RATE: usize = 60;

/// Returns the folder of the files, or None without DRYSTONE_DATA.
fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("DRYSTONE_DATA");
    if folder.is_none() {
        eprintln!("skipped: DRYSTONE_DATA is not set");
    }
    Some(PathBuf::from(folder?).join("gltf/khr_physics"))
}

/// A scene with its recorded run.
struct Run {
    scene: Scene,
    recording: Recording,
    /// Speed of the fastest body at the end. \[m/s\]
    fastest: f64,
}

impl Run {
    fn new(file: &str, seconds: usize) -> Option<Self> {
        let path = folder()?.join(file);
        let scene = read(&path).unwrap_or_else(|error| panic!("{error}")).scene;
        let mut world = build(&scene, StepSettings::quality()).unwrap();
        let mut recording = Recording {
            dimension: scene.dimension,
            bodies: scene.bodies.len(),
            frame_time: 1.0 / RATE as f64,
            start: 0,
            poses: Vec::new(),
        };
        world.write_poses(&mut recording.poses);
        for step in 0..seconds * RATE {
            world.step(recording.frame_time).unwrap();
            world.write_poses(&mut recording.poses);
            assert!(world.measure().finite, "{file}: not finite after {step} steps");
        }
        let fastest = world.measure().fastest;
        Some(Self { scene, recording, fastest })
    }

    /// Returns the dynamic bodies, from left (-x) to right.
    fn dynamic(&self) -> Vec<usize> {
        let bodies = &self.scene.bodies;
        let mut found: Vec<_> =
            (0..bodies.len()).filter(|&i| bodies[i].motion == Motion::Dynamic).collect();
        found.sort_by(|&i, &j| bodies[i].position[0].total_cmp(&bodies[j].position[0]));
        found
    }

    fn heights(&self, body: usize) -> Vec<f32> {
        (0..self.recording.frames()).map(|frame| self.recording.pose(frame, body)[1]).collect()
    }

    fn height(&self, seconds: f32, body: usize) -> f32 {
        self.recording.pose((seconds * RATE as f32) as usize, body)[1]
    }

    /// Returns the distance of a body from its start. \[m\]
    fn way(&self, seconds: f32, body: usize) -> f32 {
        let frame = (seconds * RATE as f32) as usize;
        let (start, now) = (self.recording.pose(0, body), self.recording.pose(frame, body));
        (0..3).map(|i| (now[i] - start[i]).powi(2)).sum::<f32>().sqrt()
    }

    fn lowest(&self) -> f32 {
        let lows = self.dynamic().into_iter().flat_map(|body| self.heights(body));
        lows.fold(f32::INFINITY, f32::min)
    }
}

/// Returns the files of EXPECTED.json under `prefix` whose flag `numeric_gate` is `gate`.
fn files(prefix: &str, gate: bool) -> Vec<String> {
    let Some(folder) = folder() else { return Vec::new() };
    let text = std::fs::read_to_string(folder.join("EXPECTED.json")).unwrap();
    let expected: Value = serde_json::from_str(&text).unwrap();
    let entries = expected.as_object().unwrap();
    let found: Vec<_> = entries
        .iter()
        .filter(|(file, entry)| file.starts_with(prefix) && entry["numeric_gate"] == gate)
        .map(|(file, _)| file.clone())
        .collect();
    assert!(!found.is_empty(), "no file under {prefix}");
    found
}

fn test_file(group: &str, number: &str) -> String {
    format!("tests/RigidBodies_{group}/RigidBodies_{group}_{number}.gltf")
}

/// The tests below cover all files that are meant as tests with numbers.
#[test]
fn every_file_with_numbers_is_tested() {
    if folder().is_none() {
        return;
    }
    let mut known = files("tests/RigidBodies_ColliderTypeMatrix", true);
    for (group, numbers) in [
        ("CollisionFilter", &["00", "01"][..]),
        ("Materials", &["00", "02"]),
        ("MotionProperties", &["04", "05", "07"]),
    ] {
        known.extend(numbers.iter().map(|number| test_file(group, number)));
    }
    known.sort();
    let mut all = files("", true);
    all.sort();
    assert_eq!(all, known);
}

/// Every shape rests on every other one for 5 s without falling through. It ends slower than 0.05
/// m/s, or 0.3 m/s where it rocks.
#[test]
fn every_shape_rests_on_every_other() {
    let mut failed = Vec::new();
    for file in files_or_none("tests/RigidBodies_ColliderTypeMatrix") {
        let Some(run) = Run::new(&file, 5) else { return };
        let lowest = run.lowest();
        println!("{file}: lowest {lowest} m, fastest at the end {} m/s", run.fastest);
        let number = &file[file.len() - 7..file.len() - 5];
        // The lowest height allowed: in these files bodies have their base on a plane at 0 or at
        // -0.5.
        let floor = match number {
            "09" | "34" => -1.5e-3,
            "10" | "11" => -0.5 - 1e-3,
            _ => 0.0,
        };
        // Tetrahedra on the tops of spheres and capsules keep rocking, as they should without
        // losses.
        let calm = if ["05", "16", "17"].contains(&number) { 0.3 } else { 0.05 };
        if !(lowest > floor && run.fastest < calm) {
            failed.push(format!("{file}: lowest {lowest} m, at the end {} m/s", run.fastest));
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

fn files_or_none(prefix: &str) -> Vec<String> {
    if folder().is_some() { files(prefix, true) } else { Vec::new() }
}

/// A sphere rests at 1 m within 0.1 %, and a filtered one falls through the floor.
#[test]
fn filtered_spheres_fall_through() {
    for number in ["00", "01"] {
        let Some(run) = Run::new(&test_file("CollisionFilter", number), 2) else { return };
        let [left, right] = run.dynamic()[..] else { panic!("two spheres expected") };
        assert_within(&format!("{number}: left rests at [m]"), run.height(2.0, left), 1.0, 1e-3);
        let fallen = run.height(2.0, right);
        assert!(fallen < -10.0, "{number}: right is at {fallen} m");
    }
}

/// Combined restitutions give the first apexes of the formula within 0.5 %.
#[test]
fn restitutions_combine() {
    let Some(run) = Run::new(&test_file("Materials", "00"), 3) else { return };
    let bodies = run.dynamic();
    let apexes: Vec<f32> = bodies
        .iter()
        .map(|&body| {
            let heights = run.heights(body);
            let fall = heights.windows(2).take_while(|pair| pair[1] <= pair[0]).count();
            let rise = heights[fall..].windows(2).take_while(|pair| pair[1] >= pair[0]).count();
            heights[fall + rise]
        })
        .collect();
    // e = 0.25 and 0.75, after a fall of 4 m; bodies at rest are at 1 m.
    assert_within("left: first apex [m]", apexes[0], 1.25, 0.005);
    assert_within("right: first apex [m]", apexes[1], 3.25, 0.005);
}

/// A box with a combined friction of 0.3 accelerates by the formula within 2 %. Another one creeps
/// by less than 2 cm in 2 s.
#[test]
fn frictions_combine() {
    let Some(run) = Run::new(&test_file("Materials", "02"), 2) else { return };
    let [left, right] = run.dynamic()[..] else { panic!("two boxes expected") };
    // mu = 0.3 on a slope of 45 degrees.
    let acceleration = GRAVITY * 0.5f32.sqrt() * (1.0 - 0.3);
    let slid = run.way(1.0, left);
    assert_within("left: acceleration [m/s^2]", 2.0 * slid, acceleration, 0.02);
    let crept = run.way(2.0, right);
    println!("right: creep in 2 s: {crept} m");
    assert!(crept < 0.02, "right has moved {crept} m");
}

/// An angular velocity in the frame of its node gives a rotation of 1 rad about the world's x axis
/// within 1e-4 rad.
#[test]
fn angular_velocity_is_given_in_the_frame_of_the_node() {
    let Some(run) = Run::new(&test_file("MotionProperties", "04"), 1) else { return };
    let [body] = run.dynamic()[..] else { panic!("one body expected") };
    let [first, last] = [0, RATE].map(|frame| {
        let pose = run.recording.pose(frame, body);
        parry3d::math::Rotation::from_xyzw(pose[3], pose[4], pose[5], pose[6])
    });
    // One radian about the world's x axis.
    let turn = (last * first.inverse()).to_scaled_axis();
    println!("turned by {turn} rad in 1 s");
    for (turned, expected) in turn.to_array().into_iter().zip([1.0, 0.0, 0.0]) {
        assert!((turned - expected).abs() < 1e-4, "turned by {turn} rad");
    }
}

/// A kinematic body inside a static one does not move at all.
#[test]
fn a_kinematic_body_stays_inside_a_static_one() {
    let Some(run) = Run::new(&test_file("MotionProperties", "05"), 2) else { return };
    for body in 0..run.recording.bodies {
        for frame in 0..run.recording.frames() {
            assert_eq!(run.recording.pose(frame, body), run.recording.pose(0, body));
        }
    }
}

/// A body with inertia 0, that is infinite, does not rotate at all, and rests at 1 m within 0.1 %.
#[test]
fn inertia_of_zero_is_infinite() {
    let Some(run) = Run::new(&test_file("MotionProperties", "07"), 5) else { return };
    let [body] = run.dynamic()[..] else { panic!("one body expected") };
    for frame in 0..run.recording.frames() {
        assert_eq!(run.recording.pose(frame, body)[3..], [0.0, 0.0, 0.0, 1.0], "frame {frame}");
    }
    assert_within("height of rest [m]", run.height(5.0, body), 1.0, 1e-3);
    assert!(run.fastest < 1e-3, "moves at {} m/s", run.fastest);
}

/// Samples run for 10 s with finite values, and no body falls through a floor that lies under all
/// of them.
#[test]
fn samples_run_without_falling_through_the_floor() {
    let files = if folder().is_some() { files("samples/", false) } else { Vec::new() };
    for file in files {
        let Some(run) = Run::new(&file, 10) else { return };
        println!("{file}: lowest {} m, fastest {} m/s", run.lowest(), run.fastest);
        // In these a floor lies under all bodies; in others bodies slide or roll off an edge.
        if ["Materials_Restitution", "MotionProperties", "Triggers"]
            .iter()
            .any(|n| file.contains(n))
        {
            assert!(run.lowest() > 0.0, "{file}: a body is at {} m", run.lowest());
        }
    }
}
