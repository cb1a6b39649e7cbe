//! Scenes with meshes whose vertices follow a track: read and written, built, baked, audited, and
//! resumed from a checkpoint.

use std::path::Path;

use drystone::StepSettings;
use drystone_bake::audit::audit;
use drystone_bake::check::{FindingKind, check};
use drystone_bake::recording::{self, JointRecording, Recording, Sampling};
use drystone_bake::{AnyCheckpoint, AnyWorld, BuildError, Drystone, WorldKind, build, read};
use drystone_scene::export::usd::StageWriter;
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

/// Returns what a stage of this text in centimeters with +z up says, which has 24 time codes per
/// second from 10 on.
fn stage(prims: &str) -> Read {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.usda");
    let head = "metersPerUnit = 0.01 upAxis = \"Z\" timeCodesPerSecond = 24 startTimeCode = 10";
    std::fs::write(&path, format!("#usda 1.0\n( {head} )\n{prims}")).unwrap();
    read(&path).unwrap_or_else(|error| panic!("{error}"))
}

/// Returns a square of 2 by 2 as a collider, with these attributes and samples of its points.
fn square(attributes: &str, samples: &str) -> String {
    format!(
        "def Mesh \"skin\" (prepend apiSchemas = [\"PhysicsCollisionAPI\"]) {{ {attributes}
        int[] faceVertexCounts = [4] int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points.timeSamples = {{ {samples} }} }}"
    )
}

/// A square at a height.
fn at(height: f64) -> String {
    format!("[(-1, -1, {height}), (1, -1, {height}), (1, 1, {height}), (-1, 1, {height})]")
}

/// Time samples of points become a track in the units of the scene, scaled with their prim: of a
/// collider alone and of one below a kinematic body. Equal samples are no deformation.
#[test]
fn samples_of_points_deform_a_mesh() {
    let samples = format!("-2: {}, 10: {}, 34: {}", at(0.0), at(1.0), at(3.0));
    let scaled = "float3 xformOp:scale = (100, 100, 200)
        uniform token[] xformOpOrder = [\"xformOp:scale\"]";
    let alone = square(scaled, &samples);
    let below = format!(
        "def Xform \"body\" (prepend apiSchemas = [\"PhysicsRigidBodyAPI\"]) {{
        bool physics:kinematicEnabled = 1 {alone} }}"
    );
    for (prims, motion) in [(&alone, Motion::Static), (&below, Motion::Kinematic)] {
        let Read { scene, warnings, .. } = stage(prims);
        assert_eq!(warnings, []);
        let body = &scene.bodies[0];
        assert_eq!(body.motion, motion);
        let ShapeKind::Trimesh { vertices, vertex_track: Some(track), .. } = &body.shapes[0].kind
        else {
            panic!("{body:?}")
        };
        assert_eq!(track.times, [-0.5, 0.0, 1.0]);
        assert_eq!(track.points[2][1], [1.0, -1.0, 6.0]);
        assert_eq!(vertices[1], [1.0, -1.0, 2.0], "at the start");
        assert_eq!(track.at(0.5)[3], [-1.0, 1.0, 4.0]);
        assert!(build(&scene, StepSettings::certified()).is_ok());
    }
    let Read { scene, warnings, .. } = stage(&square("", &format!("1: {0}, 2: {0}", at(1.0))));
    assert_eq!(warnings, []);
    assert!(scene.bodies[0].shapes[0].kind.vertex_track().is_none());
}

/// A mesh that cannot deform keeps its form, and triangles that lose their area touch nothing; each
/// with a warning.
#[test]
fn meshes_that_cannot_deform_are_named() {
    let bent = format!("0: [(-1, -1, 0), (1, -1, 1), (1, 1, 0), (-1, 1, 1)], 10: {}", at(3.0));
    let hull = "uniform token physics:approximation = \"boundingCube\"";
    let more = format!("0: {}, 10: [(0, 0, 0)]", at(0.0));
    let skin = "uniform token[] skel:blendShapes = [\"smile\"]";
    // The second triangle shrinks to a line.
    let closing = format!("0: {}, 10: [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (0, 0, 0)]", at(0.0));
    for (prims, expected, deforms) in [
        (square(hull, &bent), "a hull, box or ball stands for it", false),
        (square("", &more), "it has 4 points, and 1 at the time code 10", false),
        (
            square(skin, &format!("0: {}", at(0.0))),
            "does not follow a skeleton or blend shapes",
            false,
        ),
        (square("", &closing), "1 of 2 triangles have no area at some time", true),
    ] {
        let Read { scene, warnings, .. } = stage(&prims);
        let all: Vec<_> = warnings.iter().map(ToString::to_string).collect();
        assert!(all.iter().any(|warning| warning.contains(expected)), "{expected}: {all:?}");
        let shapes = scene.bodies.iter().flat_map(|body| &body.shapes);
        let found = shapes.filter_map(|shape| shape.kind.vertex_track()).count();
        assert_eq!(found, usize::from(deforms), "{expected}");
        assert!(build(&scene, StepSettings::certified()).is_ok(), "{expected}");
    }
}

/// A scene with a mesh that deforms comes back from a stage, and so does that of its bake.
#[test]
fn tracks_of_vertices_come_back_from_a_stage() {
    let mut scene = scene(wave());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.usda");
    StageWriter::new(&scene, &Drystone).unwrap().write(&path).unwrap();
    let Read { scene: there, warnings, .. } = read(&path).unwrap();
    assert_eq!((&there, &warnings), (&scene, &Vec::new()));

    let mut world = build(&scene, StepSettings::certified()).unwrap();
    let (recording, _) = bake(&scene, &mut world, 30);
    let joints = JointRecording::default();
    recording::usda::write(&path, &scene, &recording, &joints, &Sampling::default()).unwrap();
    let baked = read(&path).unwrap().scene;
    let of = |scene: &Scene| scene.bodies[0].shapes[0].kind.vertex_track().unwrap().clone();
    let (own, baked) = (of(&scene), of(&baked));
    for (a, b) in own.times.iter().zip(&baked.times) {
        assert!((a - b).abs() < 1e-9, "{a} s, {b} s");
    }
    for (a, b) in own.points.iter().flatten().zip(baked.points.iter().flatten()) {
        assert!((0..3).all(|i| (a[i] - b[i]).abs() < 1e-6), "{a:?}, {b:?}");
    }
    assert_eq!(own.points.len(), baked.points.len());

    // A layer over a stage leaves its points alone, and instances its mesh.
    scene.bodies[0].motion = Motion::Kinematic;
    scene.bodies.push(scene.bodies[0].clone());
    let mut world = build(&scene, StepSettings::certified()).unwrap();
    let (recording, _) = bake(&scene, &mut world, 2);
    let form = recording::usda::BodiesAsPrims::Instances;
    recording::usda::write_as(&path, (&scene, form), &recording, &joints, &Sampling::default())
        .unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert_eq!(text.matches("point3f[] points.timeSamples").count(), 2);
}

/// In a `.glb` the morph targets with their weights give the points of the track at any time, also
/// between its keys and where the animation begins between two.
#[test]
fn morph_targets_are_the_track() {
    let scene = scene(wave());
    let mut world = build(&scene, StepSettings::certified()).unwrap();
    let (mut recording, _) = bake(&scene, &mut world, 60);
    let path = tempfile::tempdir().unwrap().keep().join("s.glb");
    for start in [0, 7] {
        recording.poses.drain(..start * scene.bodies.len() * 7);
        recording.start = start;
        recording::glb::write(&path, &scene, &recording, &Sampling::default()).unwrap();
        let gltf::Gltf { document, blob } = gltf::Gltf::open(&path).unwrap();
        let bytes = blob.unwrap();
        let clip = document.animations().next().unwrap();
        let weights = |channel: &gltf::animation::Channel<'_>| {
            channel.target().property() == gltf::animation::Property::MorphTargetWeights
        };
        let channel = clip.channels().find(weights).unwrap();
        let data = |_: gltf::Buffer<'_>| Some(bytes.as_slice());
        let reader = channel.reader(data);
        let times: Vec<f32> = reader.read_inputs().unwrap().collect();
        let Some(gltf::animation::util::ReadOutputs::MorphTargetWeights(outputs)) =
            reader.read_outputs()
        else {
            panic!()
        };
        let outputs: Vec<f32> = outputs.into_f32().collect();
        let mesh = channel.target().node().mesh().unwrap();
        let primitive = mesh.primitives().next().unwrap();
        let reader = primitive.reader(data);
        let rest: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
        let targets: Vec<Vec<[f32; 3]>> =
            reader.read_morph_targets().map(|(points, ..)| points.unwrap().collect()).collect();
        assert_eq!(outputs.len(), times.len() * targets.len());
        assert_eq!(mesh.weights().unwrap().len(), targets.len());
        assert!((f64::from(times[0]) - start as f64 / 60.0).abs() < 1e-6);
        let track = scene.bodies[0].shapes[0].kind.vertex_track().unwrap();
        for time in [0.0, 0.13, 0.5, 0.777, 1.0].map(|part| times[0] + part * (1.0 - times[0])) {
            let after = times.partition_point(|key| *key <= time).clamp(1, times.len() - 1);
            let part = (time - times[after - 1]) / (times[after] - times[after - 1]);
            let at = |key: usize, target: usize| outputs[key * targets.len() + target];
            let exact = track.at(f64::from(time));
            for (vertex, exact) in exact.iter().enumerate() {
                let mut point = rest[vertex];
                for (number, target) in targets.iter().enumerate() {
                    let [from, to] = [after - 1, after].map(|key| at(key, number));
                    let weight = from + part * (to - from);
                    (0..3).for_each(|i| point[i] += weight * target[vertex][i]);
                }
                let off = (0..3).any(|i| (f64::from(point[i]) - exact[i]).abs() > 1e-5);
                assert!(!off, "{point:?}, {exact:?} at {time} s");
            }
        }
    }
}
