//! Scenes with meshes whose vertices follow a track: read and written, built, baked, audited, and
//! resumed from a checkpoint.

use std::path::Path;

use drystone::StepSettings;
use drystone_bake::audit::audit;
use drystone_bake::check::{FindingKind, check};
use drystone_bake::recording::Recording;
use drystone_bake::{AnyCheckpoint, AnyWorld, BuildError, WorldKind, build};
use drystone_scene::format::{read_json, read_toml};
use drystone_scene::{
    Body, Motion, Read, Rotation, Scene, ShapeKind, Track, VertexTrack, to_json, to_toml,
};

/// Returns a square mesh of `n` times `n` squares in the plane y = 0, with the places of its
/// vertices at these times.
fn sheet(n: u32, times: &[f64], place: impl Fn([f64; 3], f64) -> [f64; 3]) -> ShapeKind {
    let at = |i: u32| 4.0 * (f64::from(i) / f64::from(n) - 0.5);
    let all = || (0..=n).flat_map(move |i| (0..=n).map(move |j| [at(i), 0.0, at(j)]));
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..n {
            let corner = i * (n + 1) + j;
            let (right, ahead) = (corner + n + 1, corner + 1);
            triangles.extend([[corner, ahead, right], [ahead, right + 1, right]]);
        }
    }
    let points = times.iter().map(|time| all().map(|vertex| place(vertex, *time)).collect());
    let track = VertexTrack { times: times.to_vec(), points: points.collect() };
    ShapeKind::Trimesh {
        vertices: all().collect(),
        triangles,
        decomposition: None,
        vertex_track: Some(track),
    }
}

/// Keys of a wave of 4 cm at 24 per second, for two seconds.
fn wave() -> ShapeKind {
    let times: Vec<f64> = (0..=48).map(|key| f64::from(key) / 24.0).collect();
    sheet(32, &times, |[x, _, z], time| [x, 0.04 * (3.0 * x - 4.0 * time).sin() * time, z])
}

fn scene(floor: ShapeKind) -> Scene {
    let text = "[[bodies]]\nname = \"box\"\nposition = [0, 0.1, 0]\nshapes = [{ type = \"box\", \
                half_extents = [0.2, 0.1, 0.2] }]\n[[bodies]]\nname = \"ball\"\nposition = [0.8, \
                0.15, 0.3]\nshapes = [{ type = \"sphere\", radius = 0.15 }]\n";
    let mut scene = read_toml(Path::new("s.toml"), text).unwrap().scene;
    let mut floor = Body::new(Motion::Static, [0.0; 3], floor);
    floor.name = Some("floor".to_owned());
    scene.bodies.insert(0, floor);
    scene
}

fn bake(scene: &Scene, world: &mut AnyWorld, steps: usize) -> (Recording, f64) {
    let mut recording = Recording {
        dimension: 3,
        bodies: scene.bodies.len(),
        frame_time: scene.time_step,
        start: 0,
        poses: Vec::new(),
    };
    world.write_poses(&mut recording.poses);
    let mut deepest = 0.0f64;
    for _ in 0..steps {
        let report = world.step(scene.time_step).unwrap();
        assert_eq!(report.certified.unwrap().failed, 0, "{report:?}");
        world.write_poses(&mut recording.poses);
        deepest = deepest.max(world.measure().deepest_penetration);
    }
    (recording, deepest)
}

/// A wave passes under a box and a ball: contacts and the audit measure less than 1 mm of overlap,
/// also after the wave has stopped.
#[test]
fn a_wave_is_baked_without_overlaps() {
    let scene = scene(wave());
    let settings = StepSettings::certified();
    let mut world = build(&scene, settings.clone()).unwrap();
    let (recording, deepest) = bake(&scene, &mut world, 150);
    assert!(deepest < 1e-3, "{deepest} m");
    let found = audit(&scene, &recording, &settings, &[]);
    assert!(found.is_clean() && found.frames > 50, "{found:?}");
    assert!(found.deepest.as_ref().is_none_or(|of| of.depth < 1e-3), "{found:?}");
    // The same poses over the mesh at rest are far inside of it, or above.
    let mut still = scene.clone();
    still.bodies[0].shapes[0].kind = sheet(32, &[0.0], |[x, _, z], _| [x, 0.08, z]);
    assert!(!audit(&still, &recording, &settings, &[]).is_clean());
}

/// A floor whose vertices rise carries bodies as one with a track does, within 0.1 mm.
#[test]
fn vertices_carry_as_a_track_does() {
    let rises = |[x, y, z]: [f64; 3], time: f64| [x, y + 0.8 * time, z];
    let deforming = scene(sheet(6, &[0.2, 1.2], |at, time| rises(at, time - 0.2)));
    let mut rigid = deforming.clone();
    rigid.bodies[0].motion = Motion::Kinematic;
    let ShapeKind::Trimesh { vertex_track, .. } = &mut rigid.bodies[0].shapes[0].kind else {
        panic!()
    };
    *vertex_track = None;
    rigid.bodies[0].track = Track {
        times: vec![0.2, 1.2],
        positions: vec![vec![0.0; 3], vec![0.0, 0.8, 0.0]],
        rotations: vec![Rotation::identity(3); 2],
    };
    let [mut a, mut b] =
        [&deforming, &rigid].map(|scene| build(scene, StepSettings::certified()).unwrap());
    for _ in 0..90 {
        a.step(1.0 / 60.0).unwrap();
        b.step(1.0 / 60.0).unwrap();
    }
    for slot in [1, 2] {
        let [p, q] = [&a, &b].map(|world| world.pose(world.body_at(slot).unwrap()).unwrap());
        for (x, y) in p.iter().zip(&q) {
            assert!((x - y).abs() < 1e-4, "{p:?}, {q:?}");
        }
        assert!(p[1] > 0.8, "{p:?}");
    }
}

/// From a checkpoint as bytes, before, in and after the motion, the further steps are the same.
#[test]
fn a_checkpoint_is_resumed_with_the_vertices_of_its_time() {
    let scene = scene(wave());
    let built = || build(&scene, StepSettings::certified()).unwrap();
    for steps in [0, 17, 130] {
        let mut whole = built();
        (0..steps).for_each(|_| _ = whole.step(scene.time_step).unwrap());
        let checkpoint = whole.checkpoint();
        let bytes = checkpoint.to_bytes();
        let mut resumed = built();
        resumed.restore(&AnyCheckpoint::from_bytes(&bytes).unwrap()).unwrap();
        let mut hashes = Vec::new();
        for _ in 0..20 {
            whole.step(scene.time_step).unwrap();
            resumed.step(scene.time_step).unwrap();
            hashes.push(whole.state_hash());
            assert_eq!(hashes.last(), Some(&resumed.state_hash()), "after {steps} steps");
        }
        whole.restore(&checkpoint).unwrap();
        for hash in hashes {
            whole.step(scene.time_step).unwrap();
            assert_eq!(whole.state_hash(), hash, "after {steps} steps, in memory");
        }
    }
}

/// Scenes with vertex tracks come back from TOML and JSON as they were.
#[test]
fn tracks_of_vertices_are_written_and_read() {
    let scene = scene(sheet(2, &[0.0, 0.5], |[x, y, z], time| [x, y + time, z]));
    let path = Path::new("s");
    assert_eq!(read_toml(path, &to_toml(&scene)).unwrap().scene, scene);
    assert_eq!(read_json(path, &to_json(&scene)).unwrap().scene, scene);
}

/// Wrong tracks are refused by name: by the reader, and by worlds built by hand.
#[test]
fn wrong_tracks_are_refused() {
    let text = |motion: &str, track: &str| {
        format!(
            "[[bodies]]\nmotion = \"{motion}\"\n[[bodies.shapes]]\ntype = \"trimesh\"\nvertices = \
             [[0, 0, 0], [1, 0, 0], [0, 0, 1]]\ntriangles = [[0, 2, 1]]\nvertex_track = {{ {track} \
             }}\n"
        )
    };
    let error = |motion, track: &str| {
        read_toml(Path::new("s.toml"), &text(motion, track)).unwrap_err().to_string()
    };
    const REST: &str = "[[0, 0, 0], [1, 0, 0], [0, 0, 1]]";
    for (track, expected) in [
        (format!("times = [0, 0], points = [{REST}, {REST}]"), "has 0 as time 1"),
        (format!("times = [0, 1], points = [{REST}]"), "has 2 times and 1 lists"),
        ("times = [0], points = [[[0, 0, 0]]]".to_owned(), "has 1 points at time 0"),
        (
            format!("times = [0, 1], points = [{REST}, [[0, 0, 0], [1, 0, 0], [0, 0, -1]]]"),
            "triangle 0 without area at 0.5 s",
        ),
        (format!("times = [0], points = [{REST}], speed = 1"), "speed"),
    ] {
        let found = error("static", &track);
        assert!(found.contains(expected) && found.contains("vertex_track"), "{found}");
    }
    let good = format!("times = [0], points = [{REST}]");
    assert!(error("dynamic", &good).contains("closed mesh"), "{}", error("dynamic", &good));
    assert!(read_toml(Path::new("s.toml"), &text("kinematic", &good)).is_ok());
    let mut world = AnyWorld::new(WorldKind::Rigid3, StepSettings::certified());
    let add = |world: &mut AnyWorld, times: &[f64]| {
        let floor = sheet(2, times, |at, _| at);
        world.add(&Body::new(Motion::Static, [0.0; 3], floor)).map(|_| ())
    };
    let refused = add(&mut world, &[1.0, 0.0]).unwrap_err();
    assert!(matches!(refused, BuildError::Shape { shape: 0, .. }), "{refused}");
    assert_eq!(add(&mut world, &[0.0, 1.0]), Ok(()));
}

/// Vertices that move farther between two searches than a body is thick are a finding.
#[test]
fn vertices_that_are_too_fast_are_found() {
    let found = |height: f64| {
        let scene = scene(sheet(2, &[0.0, 1.0], |[x, y, z], time| [x, y + height * time, z]));
        let read = Read { scene, warnings: Vec::new(), source: None, stage: None };
        let findings = check(&read, &StepSettings::certified()).unwrap();
        findings.into_iter().filter(|of| of.kind == FindingKind::TooFast).collect::<Vec<_>>()
    };
    assert!(found(1.0).is_empty());
    let fast = found(1e4);
    assert!(fast.iter().any(|of| of.bodies[0] == 0 && of.what.contains("a vertex of")), "{fast:?}");
}
