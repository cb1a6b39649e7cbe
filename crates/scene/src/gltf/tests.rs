use std::fs;
use std::path::PathBuf;

use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;
use crate::description::{Body, Motion, Rotation, ShapeKind};
use crate::engine::NoEngine;
use crate::export::gltf::Physics;
use crate::format::{read_json, read_toml};
use crate::joint::{Coordinate, Drive, Joint, JointAxis, Softness};
use crate::write::tests::{joints, quaternion};

/// Reads a glTF of two dynamic balls, 'a' below the node 'cart' and 'b', and an empty node 'hook'
/// at (0, 3, 0). Each has a child, whose index is one more: 'a' is node 1, 'b' 3, 'hook' 5.
fn read_with(parts: Value, joint: Value, limits: Value) -> Result<Read, SceneError> {
    let ball = |kind: &str| {
        json!({ "KHR_physics_rigid_bodies": {
            kind: {}, "collider": { "geometry": { "shape": 0 } } } })
    };
    let mut document = json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_implicit_shapes", "KHR_physics_rigid_bodies"],
        "extensions": {
            "KHR_implicit_shapes": { "shapes": [{ "type": "sphere", "sphere": {} }] },
            "KHR_physics_rigid_bodies": { "physicsJoints": [limits] },
        },
        "nodes": [
            { "name": "cart", "translation": [10, 0, 0], "children": [1] },
            { "name": "a", "translation": [1, 0, 0], "children": [2],
              "extensions": ball("motion") },
            { "name": "grip", "translation": [0, 0.5, 0] },
            { "name": "b", "scale": [2, 2, 2], "children": [4], "extensions": ball("motion") },
            { "translation": [0, 0.25, 0], "rotation": [0, 0, 0.6, 0.8] },
            { "name": "hook", "translation": [0, 3, 0], "children": [6] },
            { "translation": [1, 0, 0] },
        ],
    });
    document["nodes"][2]["extensions"] = json!({ "KHR_physics_rigid_bodies": { "joint": joint } });
    if let Some(parts) = parts.as_object() {
        parts.iter().for_each(|(pointer, value)| {
            *document.pointer_mut(pointer).unwrap() = value.clone();
        });
    }
    read_document(&document)
}

fn read_document(document: &Value) -> Result<Read, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.gltf");
    fs::write(&file, document.to_string()).unwrap();
    read(&file, &NoEngine)
}

fn lock() -> Value {
    json!({ "limits": [{ "linearAxes": [0, 1, 2], "min": 0, "max": 0 }] })
}

fn warned(read: &Read, part: &str) -> bool {
    read.warnings.iter().any(|warning| warning.message.contains(part))
}

/// The connected node is the first body: the file measures it in the frame of the other. Frames
/// take the scale of their bodies, and nothing else of it.
#[test]
fn nodes_become_frames_in_bodies() {
    let joint = json!({ "connectedNode": 4, "joint": 0, "enableCollision": true });
    let read = read_with(json!({}), joint, lock()).unwrap();
    assert!(read.warnings.is_empty(), "{:?}", read.warnings);
    let [joint] = read.scene.joints.as_slice() else { panic!("{:?}", read.scene.joints) };
    assert_eq!((joint.bodies, joint.name.as_deref()), ([Some(1), Some(0)], Some("grip")));
    let [b, a] = &joint.frames;
    assert_eq!(b.position, [0.0, 0.5, 0.0]);
    assert_eq!(b.rotation, Rotation::Quaternion([0.0, 0.0, 0.6, 0.8]));
    assert_eq!((&a.position[..], a.rotation), (&[0.0, 0.5, 0.0][..], Rotation::identity(3)));
    assert!(joint.collide && joint.enabled && joint.axes.len() == 3);
}

/// A node without a body is in the world, where its parents put it.
#[test]
fn nodes_without_a_body_are_in_the_world() {
    let read = read_with(json!({}), json!({ "connectedNode": 6, "joint": 0 }), lock()).unwrap();
    let joint = &read.scene.joints[0];
    assert_eq!((joint.bodies, joint.collide), ([None, Some(0)], false));
    assert_eq!(joint.frames[0].position, [1.0, 3.0, 0.0]);
}

/// A static body that the node is part of is joined, and so is the node of a body itself.
#[test]
fn static_colliders_are_bodies() {
    let collider = json!({ "KHR_physics_rigid_bodies": {
        "collider": { "geometry": { "shape": 0 } } } });
    let parts = json!({ "/nodes/3/extensions": collider });
    let joint = json!({ "connectedNode": 3, "joint": 0 });
    let read = read_with(parts, joint, lock()).unwrap();
    assert_eq!(read.scene.bodies[1].motion, Motion::Static);
    assert_eq!(read.scene.joints[0].bodies, [Some(1), Some(0)]);
}

/// A hinge about z turns about the x axis of its frames, and a drive of it is one of the twist.
#[test]
fn a_hinge_about_z_twists() {
    let limits = json!({
        "limits": [
            { "linearAxes": [0, 1, 2], "min": 0, "max": 0 },
            { "angularAxes": [0], "min": 0, "max": 0 },
            { "angularAxes": [1], "min": 0, "max": 0 },
            { "angularAxes": [2], "min": -1, "max": 7, "stiffness": 5, "damping": 2 },
        ],
        "drives": [{ "type": "angular", "mode": "acceleration", "axis": 2, "maxForce": 4,
                     "velocityTarget": -1.5, "damping": 3, "positionTarget": 0, "stiffness": 0 }],
    });
    let read = read_with(json!({}), json!({ "connectedNode": 4, "joint": 0 }), limits).unwrap();
    assert!(read.warnings.is_empty(), "{:?}", read.warnings);
    let joint = &read.scene.joints[0];
    let drive = Drive {
        position: 0.0,
        velocity: -1.5,
        stiffness: 0.0,
        damping: 3.0,
        max_force: 4.0,
        acceleration: true,
    };
    let twist = JointAxis {
        coordinate: Coordinate::Twist,
        limits: Some([-1.0, 7.0]),
        softness: Some(Softness { stiffness: 5.0, damping: 2.0 }),
        drives: vec![drive],
        friction: 0.0,
    };
    let found = joint.axes.iter().find(|axis| axis.coordinate == Coordinate::Twist);
    assert_eq!(found, Some(&twist));
    // The x axis of the frame is the z axis of the node, its y axis the x axis.
    assert_eq!(joint.frames[1].rotation, Rotation::Quaternion([-0.5, -0.5, -0.5, 0.5]));
    let Rotation::Quaternion(q) = joint.frames[1].rotation else { panic!("{joint:?}") };
    assert_eq!(crate::graph::math::turn(q, [1.0, 0.0, 0.0]), [0.0, 0.0, 1.0]);
    assert_eq!(crate::graph::math::turn(q, [0.0, 1.0, 0.0]), [1.0, 0.0, 0.0]);
}

/// Joints that cannot act are named; faults in them are errors with their position.
#[test]
fn joints_that_cannot_act_are_named() {
    let to = |node: usize| json!({ "connectedNode": node, "joint": 0 });
    let error = read_with(json!({}), to(1), lock()).unwrap_err().to_string();
    let expected = "at /nodes/2/extensions/KHR_physics_rigid_bodies/joint: joint of node 'grip', \
                    whose nodes belong to the same body; nodes of two bodies";
    assert!(error.contains(expected), "{error}");
    let still = json!({ "/nodes/1/extensions/KHR_physics_rigid_bodies/motion":
                        { "isKinematic": true } });
    let read = read_with(still, to(6), lock()).unwrap();
    assert!(read.scene.joints.is_empty() && warned(&read, "neither of its nodes"));
    let ghost = json!({ "/nodes/3/extensions/KHR_physics_rigid_bodies": { "motion": {} } });
    let read = read_with(ghost, to(4), lock()).unwrap();
    assert!(read.scene.joints.is_empty() && warned(&read, "node 'b' has a motion and no collider"));
    let read = read_with(json!({}), to(4), json!({})).unwrap();
    assert!(read.scene.joints.len() == 1 && warned(&read, "limits and drives nothing"));
    for (limit, part) in [
        (json!({ "linearAxes": [0], "min": 2, "max": 1 }), "min 2 and max 1"),
        (json!({ "linearAxes": [3] }), "0..2 is accepted"),
        (json!({ "linearAxes": [0], "angularAxes": [0] }), "exactly one of"),
        (json!({ "linearAxes": [0, 1], "max": -1 }), "a max of at least 0"),
        (json!({ "linearAxes": [0], "stiffness": -1 }), "stiffness is -1"),
    ] {
        let error = read_with(json!({}), to(4), json!({ "limits": [limit] })).unwrap_err();
        assert!(error.to_string().contains(part), "{error}");
    }
    let odd = json!({
        "limits": [{ "linearAxes": [0], "min": 0, "max": 3.4e38, "damping": 1 }],
        "drives": [
            { "type": "linear", "mode": "magic", "axis": 0, "damping": 1 },
            { "type": "linear", "mode": "force", "axis": 0, "positionTarget": 1 },
        ],
    });
    let read = read_with(json!({}), to(4), odd).unwrap();
    for part in ["unbounded", "without stiffness does not act", "'magic'", "seeks no position"] {
        assert!(warned(&read, part), "{part}: {:?}", read.warnings);
    }
    assert_eq!(read.scene.joints[0].axes[0].limits, Some([0.0, f64::INFINITY]));
    let limp = json!({ "angularAxes": [1], "min": -1, "max": 2, "stiffness": 0 });
    let hard = json!({ "linearAxes": [0], "min": 0, "max": 1 });
    let read = read_with(json!({}), to(4), json!({ "limits": [hard, limp] })).unwrap();
    assert!(warned(&read, "stiffness 0 and no damping"), "{:?}", read.warnings);
    assert_eq!(read.scene.joints[0].axes.len(), 1);
}

/// Joints of the OMI extension have the same members.
#[test]
fn omi_joints_are_read() {
    let body = |kind: &str| {
        json!({ "OMI_physics_body": {
            "motion": { "type": kind }, "collider": { "shape": 0 } } })
    };
    let mut document = json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["OMI_physics_body", "OMI_physics_joint", "OMI_physics_shape"],
        "extensionsRequired": ["OMI_physics_joint"],
        "extensions": {
            "OMI_physics_shape": { "shapes": [{ "type": "sphere" }] },
            "OMI_physics_joint": { "physicsJoints": [lock()] },
        },
        "nodes": [
            { "extensions": body("dynamic") },
            { "translation": [0, 1, 0], "extensions": body("static") },
        ],
    });
    document["nodes"][0]["extensions"]["OMI_physics_joint"] =
        json!({ "connectedNode": 1, "joint": 0 });
    let read = read_document(&document).unwrap();
    assert!(read.warnings.is_empty(), "{:?}", read.warnings);
    assert_eq!(read.scene.joints[0].bodies, [Some(1), Some(0)]);
    assert_eq!(read.scene.joints[0].axes.len(), 3);
}

/// Returns a scene of three balls and a floor.
fn balls(turns: [[f64; 4]; 3], motion: Motion) -> Vec<Body> {
    let mut bodies: Vec<_> = turns
        .into_iter()
        .zip([Motion::Dynamic, motion, Motion::Dynamic])
        .enumerate()
        .map(|(i, (turn, motion))| Body {
            rotation: Rotation::Quaternion(turn),
            ..Body::new(motion, [i as f64, 1.0, 0.0], ShapeKind::Sphere { radius: 0.5 })
        })
        .collect();
    let floor = ShapeKind::Halfspace { normal: vec![0.0, 1.0, 0.0] };
    bodies.push(Body::new(Motion::Static, [0.0; 3], floor));
    bodies
}

fn with_joints() -> impl Strategy<Value = Scene> {
    let motions = prop::sample::select(vec![Motion::Dynamic, Motion::Kinematic, Motion::Static]);
    ([quaternion(), quaternion(), quaternion()], motions).prop_flat_map(|(turns, motion)| {
        let bodies = balls(turns, motion);
        joints(3, &bodies).prop_map(move |joints| {
            let empty = read_json(Path::new("s.json"), "{}").unwrap().scene;
            // A node without a name has none, whatever its joint is called.
            let name = |name: Option<String>| name.filter(|name| !name.is_empty());
            let joints = joints.into_iter().map(|of| Joint { name: name(of.name.clone()), ..of });
            Scene { bodies: bodies.clone(), joints: joints.collect(), ..empty }
        })
    })
}

fn written(scene: &Scene) -> Read {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.gltf");
    Physics::new(scene, &[1.0; 4], &NoEngine).unwrap().write_gltf(&file).unwrap();
    read(&file, &NoEngine).unwrap_or_else(|error| panic!("{error}"))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn joints_come_back_with_the_same_bits(scene in with_joints()) {
        let read = written(&scene);
        let motions = |scene: &Scene| -> Vec<_> {
            scene.bodies.iter().map(|body| body.motion).collect()
        };
        assert_eq!(motions(&scene), motions(&read.scene));
        assert_eq!(scene.joints, read.scene.joints);
    }
}

/// A force, and the fact that a body starts asleep, come back from extras.
#[test]
fn forces_and_sleep_come_back() {
    let mut bodies = balls([[0.0, 0.0, 0.0, 1.0]; 3], Motion::Dynamic);
    bodies[0].force = vec![0.1, -2.0, 1e5];
    bodies[2].start_asleep = true;
    let empty = read_json(Path::new("s.json"), "{}").unwrap().scene;
    let read = written(&Scene { bodies: bodies.clone(), ..empty });
    let of = |bodies: &[Body]| -> Vec<_> {
        bodies.iter().map(|body| (body.force.clone(), body.start_asleep)).collect()
    };
    assert_eq!(of(&read.scene.bodies), of(&bodies));
}

/// Types that limits and drives express need no extras. Other values go into extras, which do not
/// act once the limits have been changed.
#[test]
fn extras_hold_what_limits_cannot_say() {
    let description = |lines: &str| {
        let text = format!(
            "[[bodies]]\nshapes = [{{ type = \"sphere\", radius = 1 }}]\n\
             [[joints]]\nbodies = [0]\n{lines}\n"
        );
        let scene = read_toml(Path::new("s.toml"), &text).unwrap().scene;
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.gltf");
        Physics::new(&scene, &[1.0], &NoEngine).unwrap().write_gltf(&file).unwrap();
        let text = fs::read_to_string(&file).unwrap();
        let document: Value = serde_json::from_str(&text).unwrap();
        let pointer = "/extensions/KHR_physics_rigid_bodies/physicsJoints/0";
        (document.pointer(pointer).unwrap().clone(), document, scene)
    };
    for plain in [
        "type = \"fixed\"",
        "type = \"ball\"\ncone = [0, 0.5]",
        "type = \"hinge\"\naxis = [0, 1, 0]",
        "type = \"slider\"\naxis = [0, 1, 0]\nlimits = [0, 2]",
        "type = \"hinge\"\naxis = [0, 1, 0]\nspring = { stiffness = 3, at_most = 4 }",
        "type = \"general\"\nradial_z = [0, 2]\ny = [0.5, inf]\nrotation = [0, 1]",
    ] {
        let (own, _, _) = description(plain);
        assert_eq!(own.get("extras"), None, "{plain}: {own}");
    }
    for lines in [
        "type = \"hinge\"\naxis = [0, 1, 0]\nfriction = 2",
        "type = \"hinge\"\naxis = [0, 1, 0]\nmotor = { velocity = 3, at_most = 4 }",
        "type = \"fixed\"\nbreaking = { force = 4 }",
        "type = \"fixed\"\nenabled = false",
        "type = \"screw\"\naxis = [0, 1, 0]\npitch = 1",
    ] {
        let (own, mut document, scene) = description(lines);
        assert!(own.get("extras").is_some(), "{lines}: {own}");
        assert_eq!(read_document(&document).unwrap().scene.joints, scene.joints, "{lines}");
        let pointer = "/extensions/KHR_physics_rigid_bodies/physicsJoints/0/limits";
        if let Some(limits) = document.pointer_mut(pointer) {
            limits[0]["max"] = json!(3.5);
            let read = read_document(&document).unwrap();
            assert!(warned(&read, "were changed after Drystone wrote them"));
            assert_ne!(read.scene.joints, scene.joints);
        }
    }
}

/// Every joint of the public files is read or named.
#[test]
fn public_files_keep_their_joints() {
    let Some(root) = std::env::var_os("DRYSTONE_DATA") else {
        return eprintln!("skipped: DRYSTONE_DATA is not set");
    };
    let mut counts = Vec::new();
    let mut folders = vec![PathBuf::from(root).join("gltf/khr_physics")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|of| of == "gltf") {
                let document: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
                let nodes = document["nodes"].as_array().cloned().unwrap_or_default();
                let has = |node: &&Value| {
                    node.pointer("/extensions/KHR_physics_rigid_bodies/joint").is_some()
                };
                let all = nodes.iter().filter(has).count();
                let read = read(&path, &NoEngine).unwrap_or_else(|error| panic!("{error}"));
                let skipped = |of: &&Warning| {
                    let is_of_joint = of.message.contains("its joint is not simulated");
                    is_of_joint && of.message.contains("a motion and no collider")
                };
                let skipped = read.warnings.iter().filter(skipped).count();
                assert_eq!(all, read.scene.joints.len() + skipped, "{}", path.display());
                if all > 0 {
                    counts.push((all, skipped, path));
                }
            }
        }
    }
    let all: usize = counts.iter().map(|(all, ..)| all).sum();
    let skipped: usize = counts.iter().map(|(_, skipped, _)| skipped).sum();
    // Five nodes of the robot have a motion, a joint, and no collider.
    assert_eq!((all, skipped), (39, 5), "{counts:?}");
}

/// The public tests of joints have the coordinates that their names say, and are where their limits
/// want them.
#[test]
fn public_tests_of_joints_have_their_coordinates() {
    use Coordinate::{Distance, Linear, Swing, Twist};
    let Some(root) = std::env::var_os("DRYSTONE_DATA") else {
        return eprintln!("skipped: DRYSTONE_DATA is not set");
    };
    let folder = PathBuf::from(root).join("gltf/khr_physics/tests/RigidBodies_Joint");
    let joint = |number: usize| {
        let file = folder.join(format!("RigidBodies_Joint_{number:02}.gltf"));
        let read = read(&file, &NoEngine).unwrap_or_else(|error| panic!("{error}"));
        assert!(read.warnings.is_empty(), "{:?}", read.warnings);
        let [joint] = read.scene.joints.as_slice() else { panic!("{:?}", read.scene.joints) };
        (joint.clone(), read.scene)
    };
    let [x, y, z] = [0, 1, 2].map(|axis| (Linear(axis), [0.0; 2]));
    let [twist, swing_y, swing_z] =
        [Twist, Swing(1), Swing(2)].map(|coordinate| (coordinate, [0.0; 2]));
    let hinge = vec![x, y, z, swing_y, swing_z];
    let slider = vec![x, (Linear(1), [-2.0, 2.0]), z, twist, swing_y, swing_z];
    let crank = vec![(Linear(0), [1.0; 2]), y, z, swing_y, swing_z];
    for (number, expected) in [
        (0, vec![x, y, z, twist, swing_y, swing_z]),
        (2, hinge.clone()),
        (3, hinge),
        (5, slider.clone()),
        (6, slider.clone()),
        (7, vec![(Distance, [0.0, 1.0])]),
        (8, crank.clone()),
        (9, crank),
        (10, slider),
    ] {
        let (joint, _) = joint(number);
        let limits = |axis: &JointAxis| Some((axis.coordinate, axis.limits?));
        assert_eq!(joint.axes.iter().filter_map(limits).collect::<Vec<_>>(), expected, "{number}");
        assert_eq!(joint.collide, number == 6);
        let drives: usize = joint.axes.iter().map(|axis| axis.drives.len()).sum();
        assert_eq!(drives, usize::from(number >= 9));
    }
    // The bodies are not turned: the first frame is at 1 along x of the second.
    let (joint, scene) = joint(8);
    let place = |i: usize| {
        let body = joint.bodies[i].map_or(0.0, |body| scene.bodies[body].position[0]);
        body + joint.frames[i].position[0]
    };
    assert_eq!(place(0) - place(1), 1.0);
}
