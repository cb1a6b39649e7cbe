//! Tests of `drystone convert`: other formats keep the bodies and the motion.

use std::fs;

use crate::common::{Place, SCENE, example};

/// Returns the motion of the first ten steps.
fn motion(place: &Place, scene: &str) -> Vec<u8> {
    place.succeeds(&["bake", scene, "-o", "out.poses", "--steps", "10", "-q", "--realtime"]);
    fs::read(place.path("out.poses")).unwrap()
}

#[test]
fn scenes_come_back_from_a_gltf_with_the_same_bits() {
    for name in [
        "arch.json",
        "billiards.toml",
        "card_house.toml",
        "dominoes.json",
        "particles.json",
        "pyramid.json",
        "stones.json",
    ] {
        let (place, scene) = (Place::new(""), example(name));
        let expected = motion(&place, &scene);
        place.succeeds(&["convert", &scene, "there.glb"]);
        assert!(motion(&place, "there.glb") == expected, "{name} as .glb");
        place.succeeds(&["convert", "there.glb", "back.toml"]);
        assert!(motion(&place, "back.toml") == expected, "{name} and back as .toml");
        place.succeeds(&["convert", "back.toml", "again.gltf"]);
        assert!(motion(&place, "again.gltf") == expected, "{name} again, as .gltf");
        // Settings and times are kept.
        place.succeeds(&["convert", &scene, "own.toml"]);
        let head = |file: &str| {
            let text = fs::read_to_string(place.path(file)).unwrap();
            text.split("[[bodies]]").next().unwrap().to_owned()
        };
        assert_eq!(head("own.toml"), head("back.toml"), "{name}");
    }
}

#[test]
fn scenes_come_back_from_openusd_with_the_same_bits() {
    for name in ["arch.json", "tower.json", "particles.json", "workshop.gltf"] {
        let (place, scene) = (Place::new(""), example(name));
        let expected = motion(&place, &scene);
        place.succeeds(&["convert", &scene, "there.usda"]);
        assert!(motion(&place, "there.usda") == expected, "{name} as .usda");
        place.succeeds(&["convert", "there.usda", "back.toml"]);
        assert!(motion(&place, "back.toml") == expected, "{name} and back as .toml");
        // The same file again, to the last byte.
        place.succeeds(&["convert", "back.toml", "again.usda"]);
        let read = |file: &str| fs::read(place.path(file)).unwrap();
        assert!(read("again.usda") == read("there.usda"), "{name} again");
    }
    let place = Place::new("");
    let refused = place.fails(2, &["convert", &example("wall_2d.json"), "out.usda"]);
    assert!(refused.contains("is a scene in 2D; a stage is in 3D"), "{refused}");
    fs::write(place.path("x.usdc"), "PXR-USDC\0\0").unwrap();
    let refused = place.fails(2, &["check", "x.usdc"]);
    assert!(refused.contains("usdcat IN -o OUT.usda"), "{refused}");
}

/// A round trip keeps compounds, tilted half-spaces, filters, masses and moments, and velocities of
/// rotated bodies. Differences are within the rounding of a rotation there and back.
#[test]
fn all_data_of_a_scene_comes_back() {
    let scene = r#"
gravity = [0, -1.6, 0]
[[bodies]]
name = "floor"
motion = "static"
shapes = [{ type = "halfspace", normal = [0, 1, 0] }, { type = "halfspace", normal = [0.6, 0.8, 0], position = [-4, 0, 0] }]
collision = { systems = ["floor"] }
[[bodies]]
position = [0, 2, 0]
rotation = [0.5, 0.5, 0.5, 0.5]
mass = 12
inertia = [1, 2, "inf"]
center_of_mass = [0, 0.1, 0]
linear_velocity = [1, 2, 3]
angular_velocity = [3, 2, 1]
friction_combine = "minimum"
shapes = [
  { type = "capsule", radius = 0.1, half_height = 0.3, position = [0.1, 0.2, 0.3], rotation = [0, 0.6, 0, 0.8] },
  { type = "cylinder", radius = 0.2, half_height = 0.1 },
]
[[bodies]]
name = "ghost"
position = [0, 3, 0]
gravity_factor = 0.5
density = 300
restitution = 0.5
collision = { not_collides_with = ["floor"] }
shapes = [{ type = "box", half_extents = [0.1, 0.2, 0.3] }]
[[bodies]]
motion = "kinematic"
position = [3, 3, 0]
angular_velocity = [0, 1, 0]
shapes = [{ type = "trimesh", vertices = [[0, 0, 0], [1, 0, 0], [0, 0, 1]], triangles = [[0, 2, 1]] }]
"#;
    let place = Place::new(scene);
    place.succeeds(&["convert", "scene.toml", "there.gltf"]);
    place.succeeds(&["convert", "there.gltf", "back.toml"]);
    let numbers = |bytes: Vec<u8>| -> Vec<f32> {
        bytes.chunks_exact(4).map(|x| f32::from_le_bytes(x.try_into().unwrap())).collect()
    };
    let [expected, there, back] =
        ["scene.toml", "there.gltf", "back.toml"].map(|scene| numbers(motion(&place, scene)));
    assert_eq!(there, back);
    assert_eq!(expected.len(), there.len());
    for (i, (a, b)) in expected.iter().zip(&there).enumerate() {
        assert!((a - b).abs() < 1e-5, "number {i}: {a} is not {b}");
    }
}

#[test]
fn a_gltf_is_converted_to_the_own_format() {
    let (place, scene) = (Place::new(""), example("workshop.gltf"));
    let expected = motion(&place, &scene);
    for file in ["own.toml", "own.json"] {
        place.succeeds(&["convert", &scene, file]);
        assert!(motion(&place, file) == expected, "{file}");
    }
}

#[test]
fn scenes_that_a_gltf_cannot_hold_are_refused() {
    let place = Place::new("[[bodies]]\nname = \"nothing\"\nmotion = \"static\"\n");
    let refused = |scene: &str, out: &str| place.fails(2, &["convert", scene, out]);
    assert!(refused("scene.toml", "out.glb").contains("'nothing' has no shape"));
    assert!(refused(&example("wall_2d.json"), "out.glb").contains("is a scene in 2D"));
    assert!(refused(&example("tower.json"), "out.glb").contains("follows a track"));
    assert!(refused(&example("workshop.gltf"), "out.glb").contains("is a glTF already"));
    let wrong = refused("scene.toml", "out.obj");
    assert!(wrong.contains("\".obj\"; accepted: .toml, .json, .gltf, .glb, .usda"), "{wrong}");
    assert_eq!(place.files(), ["scene.toml"]);
}

#[test]
fn a_bake_is_converted_to_all_formats() {
    let place = Place::new(SCENE);
    let outputs = ["-o", "a.poses", "-o", "a.npz", "-o", "a.glb", "-o", "a.usda"];
    place.succeeds(&[&["bake", "scene.toml", "--steps", "9", "-q"], &outputs[..]].concat());
    let read = |name: &str| fs::read(place.path(name)).unwrap();
    for out in ["b.poses", "b.glb", "b.usda"] {
        for from in ["a.npz", "a.poses"] {
            place.succeeds(&["convert", from, out, "--scene", "scene.toml"]);
            assert!(read(out) == read(&format!("a{}", &out[1..])), "{from} to {out}");
        }
    }
    place.succeeds(&["convert", "a.poses", "c.npz", "--scene", "scene.toml"]);
    assert!(place.succeeds(&["convert", "c.npz", "c.poses"]).contains("c.poses"));
    assert!(read("c.poses") == read("a.poses"));
    // A single frame does not tell the time between frames.
    place.succeeds(&["bake", "scene.toml", "--steps", "0", "-o", "one.npz", "-o", "one.glb", "-q"]);
    place.succeeds(&["convert", "one.npz", "again.glb", "--scene", "scene.toml"]);
    place.succeeds(&["convert", "one.npz", "again.usda", "--scene", "scene.toml"]);
    assert!(read("again.glb") == read("one.glb"));
    let beyond = place.fails(2, &["convert", "a.npz", "d.npz", "--frames", "3..10"]);
    assert!(beyond.contains("--frames is 3..10; accepted: frames from 0 to 9"), "{beyond}");
    let scene = place.fails(2, &["convert", "scene.toml", "d.json", "--frames", "3..10"]);
    assert!(scene.contains("scene.toml: is a scene; accepted with --fps"), "{scene}");
    for (from, out) in [("a.poses", "d.npz"), ("a.npz", "d.glb")] {
        assert!(place.fails(2, &["convert", from, out]).contains("scene"), "{from}");
    }
}

/// The frames of an unfinished bake can be converted.
#[cfg(target_os = "linux")]
#[test]
fn a_journal_is_converted_to_a_bake() {
    let place = Place::new(SCENE);
    let bake = ["bake", "scene.toml", "-o", "a.poses", "--steps", "9", "-q"];
    if crate::faults::failing(&place, &bake, Some("rename"), 1).is_none() {
        return;
    }
    place.succeeds(&["convert", "a.poses.journal", "b.poses"]);
    place.succeeds(&["convert", "a.poses.journal", "b.npz"]);
    place.succeeds(&["convert", "a.poses.journal", "b.glb", "--scene", "scene.toml"]);
    place.succeeds(&[&bake[..], &["--resume"]].concat());
    assert!(fs::read(place.path("a.poses")).unwrap() == fs::read(place.path("b.poses")).unwrap());
    let same = place.succeeds(&["verify", "a.poses", "b.poses"]);
    assert!(same.starts_with("same"), "{same}");
}
