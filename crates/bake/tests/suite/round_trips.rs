//! Scenes that are written as a glTF and as OpenUSD, and read back with the same bits.

#![allow(clippy::result_large_err)]

use std::fs;
use std::path::Path;

use drystone::StepSettings;
use drystone_bake::{Drystone, build, read, read_toml, settings};
use drystone_scene::export::gltf::Physics;
use drystone_scene::export::usd::StageWriter;
use drystone_scene::{Read, Scene, SceneError};

/// Random numbers by xorshift.
struct Random(u64);

impl Random {
    /// Returns a number between -1 and 1.
    fn signed(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn numbers(&mut self, count: usize) -> Vec<f64> {
        (0..count).map(|_| self.signed()).collect()
    }

    fn unit(&mut self, count: usize) -> Vec<f64> {
        let numbers = self.numbers(count);
        let length = numbers.iter().map(|x| x * x).sum::<f64>().sqrt();
        numbers.into_iter().map(|x| x / length).collect()
    }

    fn shape(&mut self, kind: usize) -> String {
        let size = |x: f64| 0.2 + 0.1 * x;
        let [a, b, c] = [(); 3].map(|()| size(self.signed()));
        let mut points = || -> Vec<Vec<f64>> { (0..4).map(|_| self.numbers(3)).collect() };
        let kind = match kind % 6 {
            0 => format!("type = \"sphere\", radius = {a}"),
            1 => format!("type = \"capsule\", radius = {a}, half_height = {b}"),
            2 => format!("type = \"box\", half_extents = [{a}, {b}, {c}]"),
            3 => format!("type = \"cylinder\", radius = {a}, half_height = {b}"),
            4 => format!("type = \"convex_hull\", points = {:?}", points()),
            _ => format!(
                "type = \"trimesh\", vertices = {:?}, triangles = [[0, 1, 2], [0, 3, 1], \
                 [1, 3, 2], [2, 3, 0]]",
                points()
            ),
        };
        let [place, spin] = [self.numbers(3), self.numbers(3)];
        format!(
            "{{ {kind}, position = {place:?}, rotation = {:?}, \
             surface_velocity = {{ linear = {place:?}, angular = {spin:?}, local = true }} }}",
            self.unit(4)
        )
    }

    /// Returns a scene of rotated bodies that move, on a tilted plane, with a joint.
    fn scene(&mut self, round: usize) -> Scene {
        let mut text = format!("gravity = {:?}\n", self.numbers(3));
        text += &format!(
            "[[bodies]]\nname = \"floor\"\nmotion = \"static\"\nrotation = {:?}\ndensity = 300\n\
             shapes = [{{ type = \"halfspace\", normal = {:?}, rotation = {:?} }}]\n",
            self.unit(4),
            self.unit(3),
            self.unit(4)
        );
        for body in 0..6 {
            let rotation = if body == 0 { vec![0.0, 0.0, 0.0, 1.0] } else { self.unit(4) };
            text += &format!(
                "[[bodies]]\nname = \"b{body}\"\nposition = {:?}\nrotation = {rotation:?}\n",
                self.numbers(3)
            );
            if body % 3 != 1 {
                text += &format!("linear_velocity = {:?}\n", self.numbers(3));
                text += &format!("angular_velocity = {:?}\n", self.numbers(3));
            }
            if body % 2 == 0 {
                let axes = self.unit(4);
                text +=
                    &format!("mass = 2\ninertia = [1.1, 1.2, 1.3]\ninertia_rotation = {axes:?}\n");
            }
            text += &format!("shapes = [{}]\n", self.shape(body + round));
        }
        text += &format!(
            "[[joints]]\ntype = \"hinge\"\nbodies = [\"b0\", \"b1\"]\nanchor = {:?}\naxis = {:?}\n\
             limits = [-0.3, 0.4]\nmotor = {{ velocity = 0.7, at_most = 3 }}\n",
            self.numbers(3),
            self.unit(3)
        );
        read_toml(Path::new("scene.toml"), &text).unwrap().scene
    }
}

/// Writes a scene to a file of this name and reads it back; `edit` changes the text in between.
fn back_by(scene: &Scene, name: &str, edit: impl Fn(String) -> String) -> Result<Read, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    if name.ends_with("usda") {
        StageWriter::new(scene, &Drystone).unwrap().write(&path).unwrap();
    } else {
        let settings = settings(scene, StepSettings::realtime()).unwrap();
        let masses = build(scene, settings).unwrap().masses();
        Physics::new(scene, &masses, &Drystone).unwrap().write_gltf(&path).unwrap();
    }
    fs::write(&path, edit(fs::read_to_string(&path).unwrap())).unwrap();
    read(&path)
}

fn back(scene: &Scene, name: &str) -> Scene {
    let read = back_by(scene, name, |text| text).unwrap_or_else(|error| panic!("{name}: {error}"));
    assert_eq!(read.warnings, [], "{name}");
    read.scene
}

/// Poses, velocities, points and joints of random scenes come back to the bit, whatever rotations
/// and degrees the format makes of them.
#[test]
fn random_scenes_come_back_to_the_bit() {
    let mut random = Random(0x1234_5678_9abc_def1);
    for round in 0..30 {
        let scene = random.scene(round);
        for name in ["scene.gltf", "scene.usda"] {
            let there = back(&scene, name);
            for (a, b) in scene.bodies.iter().zip(&there.bodies) {
                assert_eq!(a, b, "{round} {name}");
            }
            assert_eq!(scene, there, "{round} {name}");
        }
    }
}

/// Every example scene that a format can hold comes back to the bit, signs of zeros included.
#[test]
fn example_scenes_come_back_to_the_bit() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    let mut count = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if !path.extension().is_some_and(|kind| kind == "toml" || kind == "json") {
            continue;
        }
        let scene = read(&path).unwrap().scene;
        if scene.dimension == 2 {
            continue;
        }
        let tracked = scene.bodies.iter().any(|body| !body.track.times.is_empty());
        for name in ["scene.gltf", "scene.usda"].into_iter().skip(usize::from(tracked)) {
            // Text tells -0 from 0.
            let there = back(&scene, name);
            assert_eq!(format!("{scene:?}"), format!("{there:?}"), "{} {name}", path.display());
        }
        count += 1;
    }
    assert!(count >= 9, "{count}");
}

/// A body that has no velocity gets none, not one of negative zeros.
#[test]
fn a_rotated_body_at_rest_has_plain_zeros() {
    let text = "[[bodies]]\nrotation = [0.6, 0, 0.8, 0]\nangular_velocity = [0, 0, 0.3]\n\
                shapes = [{ type = \"sphere\", radius = 1 }]\n";
    let scene = read_toml(Path::new("scene.toml"), text).unwrap().scene;
    let there = back(&scene, "scene.gltf");
    assert!(there.bodies[0].linear_velocity.iter().all(|x| x.is_sign_positive()), "{there:?}");
}

/// A velocity or a rotation that somebody edits counts, not the exact velocity beside it.
#[test]
fn edited_velocities_and_rotations_count() {
    let text = "[[bodies]]\nrotation = [0.1, 0.7, 0.1, 0.7]\nlinear_velocity = [0.1, 0.2, 0.3]\n\
                angular_velocity = [0.3, 0.7, 1.1]\nshapes = [{ type = \"sphere\", radius = 1 }]\n";
    let scene = read_toml(Path::new("scene.toml"), text).unwrap().scene;
    let edited = |name: &str, pointer: &str, value: serde_json::Value| {
        let edit = |text: String| {
            let mut document: serde_json::Value = serde_json::from_str(&text).unwrap();
            *document.pointer_mut(pointer).unwrap() = value.clone();
            document.to_string()
        };
        back_by(&scene, name, edit).unwrap().scene.bodies[0].clone()
    };
    let motion = "/nodes/1/extensions/KHR_physics_rigid_bodies/motion/linearVelocity";
    let body = edited("scene.gltf", motion, serde_json::json!([1.0, 0.0, 0.0]));
    let length = body.linear_velocity.iter().map(|x| x * x).sum::<f64>();
    assert!((length - 1.0).abs() < 1e-12, "{body:?}");
    let turn = serde_json::json!([0.0, 0.0, 1.0, 0.0]);
    let body = edited("scene.gltf", "/nodes/1/rotation", turn);
    let near = |x: f64, y: f64| (x - y).abs() < 1e-3;
    assert!(!near(body.linear_velocity[0], 0.1), "{body:?}");
    let edit = |text: String| {
        let lines =
            text.lines().map(|line| match line.trim().strip_prefix("vector3f physics:ang") {
                Some(_) => "vector3f physics:angularVelocity = (0, 0, 180)",
                None => line,
            });
        lines.collect::<Vec<_>>().join("\n")
    };
    let body = back_by(&scene, "scene.usda", edit).unwrap().scene.bodies[0].clone();
    assert_eq!(body.angular_velocity, [0.0, 0.0, std::f64::consts::PI]);
}

/// Joints of the own format with strengths up to its limit of 1e20, infinite ones included.
#[test]
fn strong_joints_come_back() {
    let hinge = "type = \"hinge\"\nanchor = [0.5, 0, 0]\naxis = [0, 0, 1]\n";
    for own in [
        "motor = { velocity = 1, at_most = 1e19 }",
        "spring = { stiffness = 1e19 }",
        "spring = { stiffness = 1e20, damping = 1e20 }",
        "friction = 1e19",
        "breaking = { force = 1e19, torque = 1e20, impulse = 1e19 }",
        "breaking = { force = \"inf\", torque = 3 }",
        "limits = [0, 1]\nlimit_stiffness = 1e19\nlimit_damping = 1e20",
    ] {
        let ball = |name: &str, x: f64| {
            format!(
                "[[bodies]]\nname = \"{name}\"\nposition = [{x}, 0, 0]\n\
                 shapes = [{{ type = \"sphere\", radius = 0.1 }}]\n"
            )
        };
        let bodies = ball("a", 0.0) + &ball("b", 1.0);
        let text = format!("{bodies}[[joints]]\nbodies = [\"a\", \"b\"]\n{hinge}{own}\n");
        let scene = read_toml(Path::new("scene.toml"), &text).unwrap().scene;
        for name in ["scene.gltf", "scene.usda"] {
            assert_eq!(scene, back(&scene, name), "{own} {name}");
        }
    }
}

/// Strengths that no joint of the own format has are read as infinite or as the largest, with a
/// warning. The largest number of single precision means infinity to all programs.
#[test]
fn huge_strengths_of_other_programs_are_bounded() {
    let text = "[[bodies]]\nname = \"a\"\nshapes = [{ type = \"sphere\", radius = 0.1 }]\n\
                [[joints]]\nname = \"j\"\nbodies = [\"a\"]\ntype = \"hinge\"\naxis = [0, 0, 1]\n\
                motor = { velocity = 1, at_most = 777 }\nspring = { stiffness = 3, damping = 2 }\n";
    let scene = read_toml(Path::new("scene.toml"), text).unwrap().scene;
    for name in ["scene.gltf", "scene.usda"] {
        for (huge, told) in [("1e+30", true), ("3.4028235e+38", false)] {
            let edit = |text: String| {
                let lines = text.lines().map(|line| match line.contains("maxForce") {
                    true => line.replace("777.0", huge).replace("777", huge),
                    false => line.to_owned(),
                });
                lines.collect::<Vec<_>>().join("\n")
            };
            let read = back_by(&scene, name, edit).unwrap_or_else(|error| panic!("{error}"));
            let mut drives = read.scene.joints[0].axes.iter().flat_map(|axis| &axis.drives);
            let motor = drives.find(|drive| drive.velocity != 0.0).unwrap();
            assert!(motor.max_force.is_infinite(), "{read:?}");
            let told_so = read.warnings.iter().any(|of| of.message.contains("unbounded"));
            assert_eq!(told_so, told, "{name} {huge} {:?}", read.warnings);
        }
    }
}
