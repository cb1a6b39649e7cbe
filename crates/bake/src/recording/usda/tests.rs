use super::*;
use drystone_scene::format::read_toml;

/// Writes a stage in which each body moves by 1 m along x and turns by 45° about z per frame.
fn stage(text: &str, frames: usize, options: &Sampling) -> String {
    let scene = read_toml(Path::new("test.toml"), text).unwrap().scene;
    let (dimension, bodies) = (scene.dimension, scene.bodies.len());
    let half = std::f32::consts::FRAC_PI_8;
    let pose = |frame: usize| match dimension {
        2 => vec![frame as f32, 0.0, 2.0 * half * frame as f32],
        _ => {
            let (sin, cos) = (half * frame as f32).sin_cos();
            vec![frame as f32, 0.0, 0.0, 0.0, 0.0, sin, cos]
        }
    };
    let poses = (0..frames).flat_map(|frame| pose(frame).repeat(bodies)).collect();
    let recording = Recording { dimension, bodies, frame_time: 0.01, start: 0, poses };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.usda");
    write(&path, &scene, &recording, &JointRecording::default(), options).unwrap();
    std::fs::read_to_string(path).unwrap()
}

const BALL: &str = "bodies = [{shapes = [{type = \"sphere\", radius = 0.5}]}]";

#[test]
fn samples_are_those_that_a_straight_line_does_not_give() {
    let text = stage(BALL, 3, &Sampling::default());
    assert!(text.contains("timeCodesPerSecond = 100\n") && text.contains("endTimeCode = 2\n"));
    // Translation and rotation are uniform.
    assert!(
        text.contains("xformOp:translate.timeSamples = { 0: (0, 0, 0), 2: (2, 0, 0), }"),
        "{text}"
    );
    assert!(text.contains("xformOp:orient.timeSamples = { 0: (1, 0, 0, 0), 2: ("), "{text}");
    let fewer = Sampling { fps: Some(50.0), ..Sampling::default() };
    let text = stage(BALL, 3, &fewer);
    assert!(text.contains("timeCodesPerSecond = 50\n") && text.contains("endTimeCode = 1\n"));
}

#[test]
fn samples_are_kept_where_openusd_mixes_rotations_coarsely() {
    let scene = read_toml(Path::new("test.toml"), &format!("dimension = 2\n{BALL}")).unwrap().scene;
    let kept = |angles: [f32; 3]| {
        let poses = angles.iter().flat_map(|angle| [0.0, 0.0, *angle]).collect();
        let recording = Recording { dimension: 2, bodies: 1, frame_time: 0.01, start: 0, poses };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.usda");
        write(&path, &scene, &recording, &JointRecording::default(), &Sampling::default()).unwrap();
        let text = std::fs::read_to_string(path).unwrap();
        let samples = text.lines().find(|line| line.contains("orient.timeSamples")).unwrap();
        samples.matches(": (").count()
    };
    // All are uniform. Linear interpolation would give the middle one, if OpenUSD did not take w =
    // 1 - 1e-6 for 2.8 mrad.
    assert_eq!(kept([-3e-3, -1e-3, 1e-3]), 3);
    assert_eq!(kept([0.5 - 2e-3, 0.5, 0.5 + 2e-3]), 2);
    assert_eq!(kept([-0.2, 0.0, 0.2]), 2);
}

/// Bodies of equal shapes are instances, by their indices; another one stays a prim.
#[test]
fn equal_bodies_are_instances_of_a_prototype() {
    let ball = "{shapes = [{type = \"sphere\", radius = 0.5}]}";
    let text = format!("bodies = [{ball}, {}, {ball}]", ball.replace("0.5", "0.25"));
    let scene = read_toml(Path::new("test.toml"), &text).unwrap().scene;
    let pose = |x: f32| [x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let poses = [0.0, 1.0, 2.0, 0.5, 1.0, 3.0].into_iter().flat_map(pose).collect();
    let recording = Recording { dimension: 3, bodies: 3, frame_time: 0.01, start: 0, poses };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.usda");
    let (joints, options) = (JointRecording::default(), Sampling::default());
    write_as(&path, (&scene, BodiesAsPrims::Instances), &recording, &joints, &options).unwrap();
    let text = std::fs::read_to_string(path).unwrap();
    for part in [
        "def PointInstancer \"Instances_0\" (",
        "int64[] ids = [0, 2]",
        "int[] protoIndices = [0, 0]",
        "rel prototypes = </World/Instances_0/Prototypes/Shape>",
        "positions.timeSamples = { 0: [(0, 0, 0), (2, 0, 0)], 1: [(0.5, 0, 0), (3, 0, 0)], }",
        "quatf[] orientationsf = [(1, 0, 0, 0), (1, 0, 0, 0)]",
        "double radius = 0.5",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert_eq!(text.matches("double radius").count(), 2, "{text}");
    assert_eq!(text.matches("PhysicsRigidBodyAPI").count(), 1, "{text}");
}

#[test]
fn a_body_at_rest_has_no_samples_and_no_frames_need_none() {
    for frames in [0, 1] {
        let text = stage(BALL, frames, &Sampling::default());
        assert!(!text.contains("timeSamples"), "{text}");
        assert!(text.contains("double3 xformOp:translate = (0, 0, 0)"), "{text}");
    }
}

#[test]
fn names_are_identifiers_of_their_own() {
    let named = |name: &str| format!("{{name = {name:?}, motion = \"static\"}}");
    let names = ["Würfel 1", "W_rfel_1", "2nd", "PhysicsScene", "a\"b"];
    let list: Vec<_> = names.iter().map(|name| named(name)).collect();
    let text = stage(
        &format!("bodies = [{}, {{motion = \"static\"}}]", list.join(",")),
        0,
        &Sampling::default(),
    );
    let prims: Vec<_> =
        text.lines().filter_map(|line| line.strip_prefix("    def Xform ")).collect();
    let expected = ["W_rfel_1", "W_rfel_1_1", "_2nd", "PhysicsScene_3", "a_b", "body_5"];
    assert_eq!(prims, expected.map(|name| format!("\"{name}\" (")));
    assert!(
        text.contains("displayName = \"Würfel 1\"") && text.contains("displayName = \"a\\\"b\"")
    );
}

#[test]
fn planes_look_along_their_normal() {
    for normal in [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.6, -0.8]] {
        let [a, b, c, d] = drystone_scene::graph::math::from_up(normal);
        let up = [2.0 * (a * b - c * d), 1.0 - 2.0 * (a * a + c * c), 2.0 * (b * c + a * d)];
        for (x, y) in up.iter().zip(normal) {
            assert!((x - y).abs() < 1e-12, "{up:?} is not {normal:?}");
        }
    }
}

#[test]
fn surfaces_are_materials_of_physics() {
    let ball = |friction: f64| {
        format!("{{friction = {friction}, shapes = [{{type = \"sphere\", radius = 0.5}}]}}")
    };
    let bodies = [0.5, 0.25, 0.5].map(ball).join(",");
    let text = stage(&format!("bodies = [{bodies}]"), 0, &Sampling::default());
    assert_eq!(text.matches("def Material ").count(), 2, "{text}");
    assert_eq!(text.matches("float physics:staticFriction = 0.25\n").count(), 1, "{text}");
    let bound = "rel material:binding:physics = </World/Materials/Surface_0>\n";
    assert_eq!(text.matches(bound).count(), 2, "{text}");
    assert!(text.contains("\"PhysicsCollisionAPI\", \"MaterialBindingAPI\""), "{text}");
}
