//! Tests of `drystone check`: it finds and names every trap, and finds nothing in good scenes.

use std::path::Path;

use crate::common::{Place, SCENE};
use serde_json::Value;

const FLOOR: &str = "[[bodies]]\nname = \"floor\"\nmotion = \"static\"\n\
                     shapes = [{ type = \"halfspace\", normal = [0, 1, 0] }]\n";

/// Makes a box with half size `half` at a position, with further keys `more`.
fn cube(name: &str, half: f64, position: [f64; 3], more: &str) -> String {
    format!(
        "[[bodies]]\nname = \"{name}\"\nposition = {position:?}\n{more}\n\
         shapes = [{{ type = \"box\", half_extents = [{half}, {half}, {half}] }}]\n"
    )
}

/// Returns the findings of a scene: kind, names of the bodies, and value.
fn findings(scene: &str) -> Vec<(String, Vec<String>, f64)> {
    let place = Place::new(scene);
    let output = place.run(&["check", "scene.toml", "--json"]);
    let text = String::from_utf8(output.stdout).unwrap();
    let document: Value = serde_json::from_str(&text).unwrap();
    let list = document["findings"].as_array().unwrap();
    assert_eq!(output.status.code(), Some(i32::from(!list.is_empty())));
    let strings = |of: &Value| -> Vec<String> {
        of.as_array().unwrap().iter().map(|name| name.as_str().unwrap().to_owned()).collect()
    };
    let kind = |of: &Value| of["kind"].as_str().unwrap().to_owned();
    let found = list
        .iter()
        .map(|of| (kind(of), strings(&of["names"]), of["value"].as_f64().unwrap_or(f64::NAN)));
    found.collect()
}

/// Returns the only finding of a scene.
fn one(scene: &str) -> (String, Vec<String>, f64) {
    let mut found = findings(scene);
    assert_eq!(found.len(), 1, "{found:?}");
    found.remove(0)
}

#[test]
fn example_scenes_are_quiet() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let is_scene = |file: &std::path::PathBuf| {
        file.extension().is_some_and(|of| of == "toml" || of == "json" || of == "gltf")
    };
    let place = Place::new("");
    let mut count = 0;
    for file in entries.filter(is_scene) {
        let text = place.run(&["check", file.to_str().unwrap()]).stdout;
        let text = String::from_utf8(text).unwrap();
        assert!(text.contains("nothing found"), "{text}");
        count += 1;
    }
    assert!(count >= 10);
}

/// Two boxes without gravity that do not touch, and this joint of theirs.
fn joined(more: &str, joint: &str) -> String {
    let bodies = cube("a", 0.5, [0.0; 3], "") + &cube("b", 0.5, [2.0, 0.0, 0.0], more);
    format!(
        "gravity = [0, 0, 0]\n{bodies}[[joints]]\nname = \"pin\"\nbodies = [\"b\", \"a\"]\n{joint}"
    )
}

#[test]
fn frames_apart_are_found_with_their_distance() {
    let ball =
        |x: f64| joined("", &format!("type = \"ball\"\nanchors = [[{x}, 0, 0], [1, 0, 0]]\n"));
    let (kind, names, gap) = one(&ball(-0.98));
    assert_eq!((kind.as_str(), names.as_slice()), ("joint_apart", &["b".into(), "a".into()][..]));
    assert!((gap - 0.02).abs() < 1e-5, "{gap}");
    let text = Place::new(&ball(-0.98)).run(&["check", "scene.toml"]).stdout;
    let text = String::from_utf8(text).unwrap();
    assert!(text.contains("the frames of joint 'pin' are 20.00 mm apart at the start"), "{text}");
    assert_eq!(findings(&ball(-1.00005)), []);
}

#[test]
fn frames_turned_against_each_other_are_found() {
    let fixed = |z: f64| {
        let w = (1.0 - z * z).sqrt();
        joined(
            "",
            &format!(
                "type = \"fixed\"\nframes = [{{ position = [-1, 0, 0] }}, {{ position = [1, 0, 0], \
                 rotation = [0, 0, {z}, {w}] }}]\n"
            ),
        )
    };
    let (kind, _, turn) = one(&fixed(0.05));
    assert_eq!(kind, "joint_turned");
    assert!((turn - 0.1).abs() < 1e-3, "{turn}");
    assert_eq!(findings(&fixed(0.0)), []);
}

#[test]
fn limits_beyond_which_a_joint_starts_are_found() {
    let hinge = |low: f64| {
        joined("", &format!("type = \"hinge\"\naxis = [0, 1, 0]\nlimits = [{low}, 1]\n"))
    };
    let (kind, names, by) = one(&hinge(0.25));
    assert_eq!((kind.as_str(), names.as_slice()), ("joint_limit", &["b".into(), "a".into()][..]));
    assert!((by - 0.25).abs() < 1e-6, "{by}");
    let text = Place::new(&hinge(0.25)).run(&["check", "scene.toml"]).stdout;
    let text = String::from_utf8(text).unwrap();
    assert!(text.contains("twist is 0.00 degrees; accepted: 14.32 degrees to 57.30"), "{text}");
    assert_eq!(findings(&hinge(0.0)), []);
    let rope = |length: f64| joined("", &format!("type = \"rope\"\nlength = {length}\n"));
    assert_eq!(one(&rope(1.5)).0, "joint_limit");
    assert_eq!(findings(&rope(2.0)), []);
}

#[test]
fn joints_of_bodies_that_cannot_move_are_found() {
    let joint = "type = \"hinge\"\naxis = [0, 1, 0]\n";
    let pair = |mass: &str| {
        let bodies =
            cube("a", 0.5, [0.0; 3], mass) + &cube("b", 0.5, [2.0, 0.0, 0.0], "mass = inf");
        format!("gravity = [0, 0, 0]\n{bodies}[[joints]]\nbodies = [\"b\", \"a\"]\n{joint}")
    };
    let (kind, _, value) = one(&pair("mass = inf"));
    assert_eq!(kind, "joint_idle");
    assert!(value.is_nan(), "{value}");
    assert_eq!(findings(&pair("mass = 1")), []);
}

#[test]
fn joints_between_heavy_and_light_are_found() {
    let pair =
        |mass: f64| joined(&format!("mass = {mass}"), "type = \"ball\"\nanchor = [1, 0, 0]\n");
    // The other one has 1000 kg.
    let (kind, _, ratio) = one(&pair(0.5));
    assert_eq!(kind, "joint_mass_ratio");
    assert!((ratio - 2000.0).abs() < 0.1, "{ratio}");
    assert_eq!(one(&pair(3e6)).0, "joint_mass_ratio");
    assert_eq!(findings(&pair(2.0)), []);
}

#[test]
fn cardan_angles_near_their_singularity_are_found() {
    let gimbal = |degrees: f64| {
        let (y, w) = (0.5 * degrees.to_radians()).sin_cos();
        let turned = format!("rotation = [0, {y}, 0, {w}]");
        joined(&turned, "type = \"general\"\nframes = [{}, {}]\nangle_z = [-1, 1]\n")
    };
    let (kind, _, angle) = one(&gimbal(85.0));
    assert_eq!(kind, "joint_singular");
    assert!((angle.to_degrees() - 85.0).abs() < 1e-3, "{angle}");
    assert_eq!(one(&gimbal(-88.0)).0, "joint_singular");
    assert_eq!(findings(&gimbal(60.0)), []);
}

#[test]
fn gears_in_a_housing_that_moves_are_found() {
    let gears = |held: &str| {
        let cubes: String = [("a", [0.0; 3]), ("b", [2.0, 0.0, 0.0]), ("housing", [4.0, 0.0, 0.0])]
            .map(|(name, at)| {
                cube(name, 0.5, at, if name == "housing" { held } else { "mass = 1" })
            })
            .concat();
        let hinge = |body: &str| {
            format!(
                "[[joints]]\ntype = \"hinge\"\nbodies = [\"{body}\", \"housing\"]\naxis = [0, 1, 0]\n"
            )
        };
        let gear =
            "[[joints]]\ntype = \"gear\"\nbodies = [\"a\", \"b\"]\naxis = [0, 1, 0]\nratio = 1\n";
        format!("gravity = [0, 0, 0]\n{cubes}{}{}{gear}", hinge("a"), hinge("b"))
    };
    assert_eq!(one(&gears("mass = 1")).0, "joint_housing");
    assert_eq!(findings(&gears("motion = \"static\"")), []);
    // A housing that another joint keeps from turning does not move the wheels.
    let welded = "[[joints]]\ntype = \"fixed\"\nbodies = [\"housing\"]\n";
    assert_eq!(findings(&(gears("mass = 1") + welded)), []);
    // A wheel that meshes with a second one is no housing.
    let arbor = |body: &str| {
        format!("[[joints]]\ntype = \"hinge\"\nbodies = [\"{body}\"]\naxis = [0, 1, 0]\n")
    };
    let mesh = |a: &str, b: &str| {
        format!(
            "[[joints]]\ntype = \"gear\"\nbodies = [\"{a}\", \"{b}\"]\naxis = [0, 1, 0]\nratio = 1\n"
        )
    };
    let wheels = ["a", "b", "c"];
    let cubes = |(i, name): (usize, &&str)| cube(name, 0.5, [2.0 * i as f64, 0.0, 0.0], "mass = 1");
    let train: String = wheels.iter().enumerate().map(cubes).chain(wheels.map(arbor)).collect();
    let train = format!("gravity = [0, 0, 0]\n{train}{}{}", mesh("a", "b"), mesh("b", "c"));
    assert_eq!(findings(&train), []);
}

#[test]
fn an_overlap_has_its_bodies_and_its_depth() {
    let scene = format!("{FLOOR}{}", cube("box", 0.5, [0.0, 0.45, 0.0], ""));
    let (kind, names, depth) = one(&scene);
    assert_eq!((kind.as_str(), names.as_slice()), ("overlap", &["floor".into(), "box".into()][..]));
    assert!((depth - 0.05).abs() < 1e-5, "{depth}");
    let text = Place::new(&scene).run(&["check", "scene.toml"]).stdout;
    let text = String::from_utf8(text).unwrap();
    let said =
        "overlap           'floor' and 'box' overlap by 50.00 mm at the start; accepted: up to";
    assert!(
        text.starts_with(said) && text.ends_with("scene.toml: 1 finding among 2 bodies\n"),
        "{text}"
    );
    assert_eq!(findings(&format!("{FLOOR}{}", cube("box", 0.5, [0.0, 0.49995, 0.0], ""))), []);
}

#[test]
fn a_body_between_walls_too_near_is_wedged() {
    let wall = |name: &str, x: f64, nx: f64| {
        format!(
            "[[bodies]]\nname = \"{name}\"\nmotion = \"static\"\nposition = [{x}, 0, 0]\n\
             shapes = [{{ type = \"halfspace\", normal = [{nx}, 0, 0] }}]\n"
        )
    };
    let walls = wall("left", -0.19, 1.0) + &wall("right", 0.19, -1.0);
    let found = findings(&format!("{walls}{}", cube("box", 0.2, [0.0; 3], "")));
    let kinds: Vec<_> = found.iter().map(|(kind, ..)| kind.as_str()).collect();
    assert_eq!(kinds, ["overlap", "overlap", "wedged"]);
    assert_eq!(found[2].1, ["left", "right", "box"]);
}

#[test]
fn heavy_on_light_is_found_and_light_on_heavy_is_not() {
    let pair = |below: f64, above: f64| {
        let low = cube("low", 0.5, [0.0, 0.5, 0.0], &format!("mass = {below}"));
        let high = cube("high", 0.5, [0.0, 1.5, 0.0], &format!("mass = {above}"));
        format!("{FLOOR}{low}{high}")
    };
    let (kind, names, ratio) = one(&pair(1.0, 5e6));
    assert_eq!(
        (kind.as_str(), names.as_slice()),
        ("mass_ratio", &["high".into(), "low".into()][..])
    );
    assert!((ratio / 5e6 - 1.0).abs() < 1e-5, "{ratio}");
    assert_eq!(findings(&pair(5e6, 1.0)), []);
    assert_eq!(findings(&pair(1.0, 900.0)), []);
    // Four substeps of one sweep carry a smaller mass ratio.
    let place = Place::new(&pair(1.0, 900.0));
    let text = place.run(&["check", "scene.toml", "--realtime"]).stdout;
    let text = String::from_utf8(text).unwrap();
    assert!(text.contains("'high' is 900 times as heavy as 'low'"), "{text}");
}

#[test]
fn a_stack_on_ice_is_found() {
    let stack = |friction: &str| {
        let low = cube("low", 0.5, [0.0, 0.5, 0.0], friction);
        format!("{FLOOR}{low}{}", cube("high", 0.5, [0.0, 1.5, 0.0], ""))
    };
    // The upper box has friction, but it combines with that of the lower one to zero.
    let (kind, names, friction) = one(&stack("friction = 0.0"));
    assert_eq!(kind, "frictionless");
    assert_eq!((names, friction), (vec!["low".into(), "floor".into(), "high".into()], 0.0));
    assert_eq!(findings(&stack("")), []);
    assert_eq!(
        findings(&format!("{FLOOR}{}", cube("low", 0.5, [0.0, 0.5, 0.0], "friction = 0.0"))),
        []
    );
}

#[test]
fn bodies_that_may_tunnel_are_found() {
    let ball = |speed: f64| {
        format!(
            "gravity = [0, 0, 0]\n[[bodies]]\nname = \"ball\"\nlinear_velocity = [{speed}, 0, 0]\n\
             shapes = [{{ type = \"sphere\", radius = 0.1 }}]\n\
             [[bodies]]\nname = \"sheet\"\nmotion = \"static\"\nposition = [5, 0, 0]\n\
             shapes = [{{ type = \"box\", half_extents = [0.001, 1, 1] }}]\n"
        )
    };
    let (kind, names, travel) = one(&ball(6.0));
    assert_eq!(
        (kind.as_str(), names.as_slice()),
        ("too_fast", &["ball".into(), "sheet".into()][..])
    );
    assert!((travel - 6.0 / 60.0 / 32.0).abs() < 1e-6, "{travel}");
    assert_eq!(findings(&ball(3.0)), []);
    let high = |height: f64| {
        ball(0.0)
            .replace("gravity = [0, 0, 0]\n", "")
            .replace("name = \"ball\"", &format!("name = \"ball\"\nposition = [0, {height}, 0]"))
    };
    assert_eq!(one(&high(10.0)).0, "too_fast");
    assert_eq!(findings(&high(0.5)), []);
}

#[test]
fn millimeters_read_as_meters_are_found() {
    let (kind, names, size) = one(&format!("{FLOOR}{}", cube("box", 600.0, [0.0, 600.0, 0.0], "")));
    assert_eq!((kind.as_str(), names[0].as_str(), size), ("too_large", "box", 1200.0));
    let thin = format!("{FLOOR}{}", cube("chip", 0.0004, [0.0, 0.0004, 0.0], ""));
    assert_eq!(one(&thin).0, "too_small");
    let far = format!("{FLOOR}{}", cube("box", 0.5, [2000.0, 0.5, 0.0], ""));
    let (kind, _, distance) = one(&far);
    assert!(kind == "too_far" && (distance - 2000.0).abs() < 0.01);
}

/// Checks a box of a glTF with a scaled node.
fn scaled(scale: [f64; 3]) -> Vec<(String, f64)> {
    let place = Place::new("");
    let text = format!(
        r#"{{"asset": {{"version": "2.0"}},
        "extensionsUsed": ["KHR_implicit_shapes", "KHR_physics_rigid_bodies"],
        "extensions": {{"KHR_implicit_shapes": {{"shapes": [{{"type": "box"}}]}}}},
        "nodes": [{{"name": "box", "scale": {scale:?}, "extensions": {{"KHR_physics_rigid_bodies":
            {{"motion": {{}}, "collider": {{"geometry": {{"shape": 0}}}}}}}}}}]}}"#
    );
    std::fs::write(place.path("scene.gltf"), text).unwrap();
    let output = place.run(&["check", "scene.gltf", "--json"]);
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    let one = |of: &Value| {
        assert_eq!(of["names"][0], "box");
        (of["kind"].as_str().unwrap().to_owned(), of["value"].as_f64().unwrap())
    };
    document["findings"].as_array().unwrap().iter().map(one).collect()
}

#[test]
fn negative_and_uneven_scales_are_found() {
    assert_eq!(scaled([1.0, 1.0, 1.0]), []);
    assert_eq!(scaled([0.5, 0.5, 0.5]), []);
    assert_eq!(scaled([1.0, 2.0, 0.5]), [("uneven_scale".to_owned(), 4.0)]);
    assert_eq!(scaled([1.0, -1.0, 1.0]), [("negative_scale".to_owned(), -1.0)]);
    let both = scaled([-2.0, 1.0, 1.0]);
    assert_eq!(both, [("negative_scale".to_owned(), -2.0), ("uneven_scale".to_owned(), 2.0)]);
}

/// Checks a unit cube of outward triangles after a change.
fn mesh(
    change: impl Fn(&mut Vec<[u32; 3]>, &mut Vec<[f64; 3]>),
) -> Vec<(String, Vec<String>, f64)> {
    let corner = |i: u32| [0, 1, 2].map(|axis| f64::from(i >> axis & 1));
    let mut vertices: Vec<_> = (0..8).map(corner).collect();
    let sides =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    let mut triangles: Vec<_> = sides.into_iter().flat_map(halves).collect();
    change(&mut triangles, &mut vertices);
    findings(&format!(
        "[[bodies]]\nname = \"mesh\"\nmotion = \"static\"\n\
         shapes = [{{ type = \"trimesh\", vertices = {vertices:?}, triangles = {triangles:?} }}]\n"
    ))
}

#[test]
fn meshes_with_holes_inside_out_or_crossing_are_found() {
    assert_eq!(mesh(|_, _| ()), []);
    let kinds = |found: Vec<(String, Vec<String>, f64)>| -> Vec<(String, f64)> {
        found.into_iter().map(|(kind, _, value)| (kind, value)).collect()
    };
    // With a sixth of a side missing, the cube has a hole. Without a whole side it is an open box.
    let hole = |triangles: &mut Vec<[u32; 3]>, vertices: &mut Vec<[f64; 3]>| {
        let [a, b, c] = triangles.remove(0);
        let middle =
            [0, 1, 2].map(|i| [a, b, c].map(|v| vertices[v as usize][i]).iter().sum::<f64>() / 3.0);
        vertices.push(middle);
        triangles.extend([[a, b, 8], [b, c, 8]]);
    };
    assert_eq!(kinds(mesh(hole)), [("open_mesh".into(), 3.0)]);
    assert_eq!(mesh(|triangles, _| drop(triangles.drain(..2))), []);
    let flip = |triangle: &mut [u32; 3]| triangle.swap(0, 1);
    let inside_out = kinds(mesh(|all, _| all.iter_mut().for_each(flip)));
    assert!(inside_out.len() == 1 && inside_out[0].0 == "inside_out_mesh", "{inside_out:?}");
    assert!((inside_out[0].1 + 1.0).abs() < 1e-12);
    // A mesh with one flipped triangle is not inside out, and copies of triangles are ignored.
    assert_eq!(mesh(|all, _| flip(&mut all[4])), []);
    assert_eq!(mesh(|all, _| all.extend_from_within(..)), []);
    // A wall inside makes two rooms: four edges have three triangles.
    let wall = |all: &mut Vec<[u32; 3]>, _: &mut Vec<[f64; 3]>| all.extend([[0, 1, 7], [0, 6, 7]]);
    assert_eq!(kinds(mesh(wall)), [("open_mesh".into(), 4.0)]);
    // A floor has two sides and may face either way.
    let floor = |looks: [u32; 3]| {
        mesh(move |triangles, vertices| {
            *vertices = vec![[0.0, 0.0, 0.0], [0.0, 0.0, 9.0], [9.0, 0.0, 0.0]];
            *triangles = vec![looks];
        })
    };
    assert_eq!(floor([0, 2, 1]), []);
    assert_eq!(floor([0, 1, 2]), []);
    // A second cube, half a side further along the diagonal.
    let twice = |triangles: &mut Vec<[u32; 3]>, vertices: &mut Vec<[f64; 3]>| {
        vertices.extend(vertices.clone().iter().map(|v| v.map(|x| x + 0.5)));
        triangles.extend(triangles.clone().iter().map(|t| t.map(|i| i + 8)));
    };
    let found = kinds(mesh(twice));
    assert!(found.len() == 1 && found[0].0 == "crossing_mesh" && found[0].1 >= 6.0, "{found:?}");
}

#[test]
fn surfaces_that_never_rest_or_never_bounce_are_found() {
    let ball = |material: &str| {
        format!(
            "[materials]\nfloor = {{ restitution = 0.0 }}\nball = {{ {material} }}\n\
             {FLOOR}material = \"floor\"\n[[bodies]]\nname = \"ball\"\nmaterial = \"ball\"\n\
             position = [0, 2, 0]\nshapes = [{{ type = \"sphere\", radius = 0.5 }}]\n"
        )
    };
    // By default the larger restitution acts.
    let (kind, names, restitution) = one(&ball("restitution = 1.0"));
    assert_eq!((kind.as_str(), restitution), ("lossless_bounce", 1.0));
    assert_eq!(names, ["floor", "ball"]);
    assert_eq!(findings(&ball("restitution = 0.9")), []);
    let (kind, names, restitution) =
        one(&ball("restitution = 0.9, restitution_combine = \"minimum\""));
    assert_eq!((kind.as_str(), names[0].as_str(), restitution), ("idle_bounce", "ball", 0.9));
}

#[test]
fn data_that_the_reader_leaves_out_is_found() {
    let scene = SCENE.replace("motion = \"static\"", "motion = \"static\"\nmass = 1");
    assert_eq!(one(&scene).0, "left_out");
    let message = Place::new("").fails(4, &["check", "gone.toml"]);
    assert!(message.contains("gone.toml"), "{message}");
}
