//! Tests that the command states the truth: audits, certificates, and refusals.

use std::fs;
use std::path::Path;
use std::process::Stdio;

use serde_json::Value;

use crate::common::{Place, SCENE};

/// Bakes the scene and returns the report.
fn report(place: &Place, more: &[&str]) -> Value {
    let arguments = ["bake", "scene.toml", "--report", "r.json", "--threads", "1", "-q"];
    place.succeeds(&[&arguments[..], more].concat());
    serde_json::from_slice(&fs::read(place.path("r.json")).unwrap()).unwrap()
}

/// Bakes a scene and returns the summary.
fn summary(scene: &str) -> String {
    let place = Place::new(scene);
    place.succeeds(&["bake", "scene.toml", "-o", "out.poses", "--threads", "1"])
}

fn line<'t>(text: &'t str, title: &str) -> &'t str {
    let mut lines = text.lines();
    lines.find(|line| line.starts_with(title)).unwrap_or_else(|| panic!("no {title} in:\n{text}"))
}

/// A plate that is moved down onto a box, farther than there is room for.
const PRESSED: &str = r#"
duration = 1

[[bodies]]
name = "floor"
motion = "static"
shapes = [{ type = "halfspace", normal = [0, 1, 0] }]

[[bodies]]
name = "box"
position = [0, 0.5, 0]
shapes = [{ type = "box", half_extents = [0.5, 0.5, 0.5] }]

[[bodies]]
name = "plate"
motion = "kinematic"
position = [0, 1.1, 0]
shapes = [{ type = "box", half_extents = [1, 0.1, 1] }]
track = [{ time = 0.0, position = [0, 1.1, 0] }, { time = 1.0, position = [0, 0.8, 0] }]
"#;

#[test]
fn deep_overlaps_are_named_and_nothing_is_certified() {
    let text = summary(PRESSED);
    let note = text.lines().find(|line| line.contains("overlapped too deeply")).unwrap();
    assert!(note.contains("'box'") && note.contains("accepted: "), "{text}");
    assert!(line(&text, "audit").contains("bodies overlap or tunneled"), "{text}");
    assert!(!text.lines().any(|line| line.starts_with("certified")), "{text}");
    let report = report(&Place::new(PRESSED), &[]);
    let inside = &report["summary"]["audit"]["overlaps"];
    assert!(inside[0]["depth"].as_f64().unwrap() > 0.05, "{inside}");
}

#[test]
fn quiet_bakes_warn_of_what_the_audit_finds() {
    let place = Place::new(PRESSED);
    let output = place.run(&["bake", "scene.toml", "-o", "out.poses", "-q"]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("warning: scene.toml: overlapped too deeply"), "{said}");
    assert_eq!(output.status.code(), Some(0));
}

#[test]
fn example_scenes_are_clean() {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    for (name, steps) in [("arch.json", "60"), ("wall_2d.json", "60"), ("billiards.toml", "90")] {
        let scene = scenes.join(name);
        let place = Place::new("");
        let scene = scene.to_str().unwrap();
        for preset in [&[][..], &["--realtime"]] {
            let more = ["bake", scene, "-o", "out.poses", "--steps", steps];
            let text = place.succeeds(&[&more[..], preset].concat());
            assert!(!text.contains("bodies overlap or tunneled"), "{name}: {text}");
        }
    }
}

#[test]
fn without_contacts_nothing_is_certified() {
    for (scene, said) in [
        ("bodies = []\nsteps = 2\n", "nothing: no body moves by itself"),
        (
            "steps = 2\n[[bodies]]\nshapes = [{ type = \"sphere\", radius = 1 }]\n",
            "nothing: nothing touched",
        ),
    ] {
        let text = summary(scene);
        assert!(line(&text, "certified").contains(said), "{text}");
    }
}

#[test]
fn with_friction_the_summary_states_the_limits_of_the_bound() {
    let text = summary(SCENE);
    assert!(text.contains("friction for the slip at hand"), "{text}");
    let ice = SCENE.replace("[{ type", "[{ friction = 0.0, type");
    assert!(!summary(&ice).contains("slip"), "{}", summary(&ice));
}

#[test]
fn overlap_at_the_start_is_measured_before_the_first_step() {
    let scene = "gravity = [0, 0, 0]\nsteps = 5\n\
        [[bodies]]\nname = \"wall\"\nmotion = \"static\"\n\
        shapes = [{ type = \"box\", half_extents = [1, 1, 1] }]\n\
        [[bodies]]\nname = \"box\"\nposition = [0, 1.95, 0]\nlinear_velocity = [0, 3, 0]\n\
        shapes = [{ type = \"box\", half_extents = [1, 1, 1] }]\n";
    let text = summary(scene);
    assert!(text.contains("'wall' and 'box' overlap by 50.000 mm at the start"), "{text}");
}

#[test]
fn a_jump_is_named_by_check_and_bake() {
    let scene = "steps = 70\n[[bodies]]\nname = \"door\"\nmotion = \"kinematic\"\n\
        shapes = [{ type = \"box\", half_extents = [0.5, 1.0, 0.05] }]\n\
        track = [{ time = 0.0, position = [0, 1, 0] }, { time = 1.0, position = [0, 1, 0] }, \
        { time = 1.0001, position = [2, 1, 0] }, { time = 2.0, position = [2, 1, 0] }]\n";
    let place = Place::new(scene);
    let output = place.run(&["bake", "scene.toml", "-o", "out.poses", "-q"]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("'door' jumps by 2.00 m at 1.000 s"), "{said}");
    assert!(said.contains("120.0 m/s"), "{said}");
    assert_eq!(place.run(&["check", "scene.toml"]).status.code(), Some(1));
    // Keys at short intervals and constant speed are no jump.
    let keys: Vec<_> = (0..2000)
        .map(|i| {
            format!("{{ time = {}, position = [{}, 1, 0] }}", i as f64 * 1e-3, i as f64 * 2e-2)
        })
        .collect();
    let steady = format!("{}track = [{}]\n", scene.split("track").next().unwrap(), keys.join(", "));
    let output = Place::new(&steady).run(&["bake", "scene.toml", "-o", "out.poses", "-q"]);
    assert!(!String::from_utf8(output.stderr).unwrap().contains("jumps"));
}

#[test]
fn a_key_between_two_steps_is_named_by_check_and_bake() {
    let scene = |keys: &str| {
        format!(
            "time_step = 0.02\nsteps = 70\n[[bodies]]\nname = \"hammer\"\nmotion = \"kinematic\"\n\
             shapes = [{{ type = \"box\", half_extents = [0.5, 1.0, 0.05] }}]\ntrack = [{keys}]\n"
        )
    };
    let key = |time: f64, height: f64| format!("{{ time = {time}, position = [0, {height}, 0] }}");
    let named = |keys: &[String]| {
        let place = Place::new(&scene(&keys.join(", ")));
        let output = place.run(&["bake", "scene.toml", "-o", "out.poses", "-q"]);
        let said = String::from_utf8(output.stderr).unwrap();
        let found = String::from_utf8(place.run(&["check", "scene.toml"]).stdout).unwrap();
        assert_eq!(said.contains("that no step reaches"), found.contains("missed key"), "{said}");
        said
    };
    let said = named(&[key(1.0, 1.0), key(1.01, 0.5), key(1.02, 1.0)]);
    let expected = "'hammer' has a key at 1.0100 s that no step reaches, 500.00 mm off";
    assert!(said.contains(expected), "{said}");
    // Keys on the way, on steps, a tenth of a millimeter off, or not simulated are kept.
    for keys in [
        [key(1.0, 1.0), key(1.007, 0.9), key(1.02, 0.5)],
        [key(1.0, 1.0), key(1.02, 0.5), key(1.04, 1.0)],
        [key(1.0, 1.0), key(1.01, 0.9999), key(1.02, 1.0)],
        [key(1.4, 1.0), key(1.41, 0.5), key(1.42, 1.0)],
        [key(-0.02, 1.0), key(-0.01, 0.5), key(0.0, 1.0)],
    ] {
        assert!(!named(&keys).contains("no step"));
    }
}

#[test]
fn an_output_that_is_an_input_is_refused() {
    let place = Place::new(SCENE);
    let said = place.fails(2, &["convert", "scene.toml", "scene.toml"]);
    assert!(said.contains("the output is the input"), "{said}");
    assert_eq!(fs::read_to_string(place.path("scene.toml")).unwrap(), SCENE);
    place.succeeds(&["bake", "scene.toml", "-o", "a.npz", "--steps", "3", "-q"]);
    place.fails(2, &["convert", "a.npz", "a.npz"]);
    place.fails(2, &["convert", "a.npz", "scene.toml", "--scene", "scene.toml"]);
}

#[test]
fn a_read_only_output_is_refused_before_the_simulation() {
    let place = Place::new(SCENE);
    let path = place.path("out.poses");
    fs::write(&path, "mine").unwrap();
    let mut permissions = fs::metadata(&path).unwrap().permissions();
    permissions.set_readonly(true);
    fs::set_permissions(&path, permissions).unwrap();
    let said = place.fails(4, &["bake", "scene.toml", "-o", "out.poses"]);
    assert!(said.contains("out.poses: cannot be written: it is read-only"), "{said}");
    assert_eq!(fs::read(&path).unwrap(), b"mine");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_standard_output_is_a_failure() {
    let place = Place::new(SCENE);
    fs::write(place.path("p.json"), r#"{"q": [-1.0], "M": [[1.0]]}"#).unwrap();
    for arguments in [
        &["check", "scene.toml"][..],
        &["bake", "scene.toml", "-o", "out.poses", "--steps", "3"],
        &["schema"],
    ] {
        let full = fs::File::options().write(true).open("/dev/full").unwrap();
        let mut command = place.command(arguments);
        let status = command.stdout(Stdio::from(full)).stderr(Stdio::null()).status().unwrap();
        assert_eq!(status.code(), Some(4), "{arguments:?}");
    }
}

#[test]
fn poses_that_are_not_finite_blame_their_file() {
    let place = Place::new(SCENE);
    place.succeeds(&["bake", "scene.toml", "-o", "a.poses", "--steps", "3", "-q"]);
    let mut bytes = fs::read(place.path("a.poses")).unwrap();
    // Frame 2, the second body: three bodies of seven numbers each.
    let at = (2 * 3 + 1) * 7 * 4;
    bytes[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    fs::write(place.path("a.poses"), bytes).unwrap();
    let said = place.fails(2, &["convert", "a.poses", "a.glb", "--scene", "scene.toml"]);
    assert!(said.contains("a.poses: frame 2: the pose of 'box'"), "{said}");
}
