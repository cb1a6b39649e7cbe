//! Tests of scene files in Drystone's own format: refusals and their messages, warnings, and values
//! read.

use std::path::Path;

use drystone::{ImpactLaw, StepSettings};
use drystone_bake::{read, read_json, read_toml};
use drystone_scene::{Motion, Place, Rotation, Scene};
use proptest::prelude::*;

fn toml_error(text: &str) -> String {
    match read_toml(Path::new("s.toml"), text) {
        Ok(_) => "accepted".to_owned(),
        Err(error) => error.to_string(),
    }
}

fn json_error(text: &str) -> String {
    match read_json(Path::new("s.json"), text) {
        Ok(_) => "accepted".to_owned(),
        Err(error) => error.to_string(),
    }
}

/// Returns a scene of one ball with these lines in its table.
fn ball(lines: &str) -> String {
    format!(
        "[[bodies]]\nname = \"ball\"\n{lines}\n[[bodies.shapes]]\ntype = \"sphere\"\nradius = 0.5\n"
    )
}

/// Returns a scene of one body of this motion with this shape.
fn shape(motion: &str, shape: &str) -> String {
    format!("[[bodies]]\nname = \"b\"\nmotion = \"{motion}\"\nshapes = [{{ {shape} }}]\n")
}

/// Returns the scene with particles instead of rigid bodies.
fn particles(text: String) -> String {
    format!("bodies_as = \"particles\"\n{text}")
}

/// A scene that is refused, and its error message.
type BadScene = (String, &'static str);

/// Returns files and times that are refused, with their error messages.
fn bad_files_and_times() -> Vec<BadScene> {
    vec![
        (
            "gravity = [0, -9.81".into(),
            "s.toml:1:20: TOML syntax: unclosed array, expected `]`; the file must be valid \
             TOML",
        ),
        (
            "steps = 1\nsteps = 2".into(),
            "s.toml:2:1: TOML syntax: duplicate key; the file must be valid TOML",
        ),
        ("stepz = 1".into(), "s.toml:1:1: unknown key 'stepz'; the nearest known key is 'steps'"),
        ("dimension = 4".into(), "s.toml:1:13: dimension is 4; accepted: 2 or 3"),
        (
            "gravity = [0.0, -9.81]".into(),
            "s.toml:1:11: gravity is [0.0, -9.81]; accepted: 3 numbers from -1e6 to 1e6 m/s^2",
        ),
        (
            "time_step = 0.0".into(),
            "s.toml:1:13: time_step is 0.0; accepted: a number from 1e-6 to 1 s",
        ),
        (
            "time_step = 1e-300".into(),
            "s.toml:1:13: time_step is 1e-300; accepted: a number from 1e-6 to 1 s",
        ),
        (
            "steps = -1".into(),
            "s.toml:1:9: steps is -1; accepted: a whole number from 0 to 10000000",
        ),
        (
            "steps = 99999999999999999999".into(),
            "s.toml:1:9: steps is 99999999999999999999; accepted: a whole number from 0 to \
             10000000",
        ),
        (
            "steps = 10\nduration = 1.0".into(),
            "s.toml:2:12: duration is 1.0; accepted: either steps or duration, not both",
        ),
        (
            "duration = 1e12".into(),
            "s.toml:1:12: duration is 1000000000000.0; accepted: a number from 0 to 166666.67 \
             s",
        ),
        (
            "gravity = [0.0, 1e999, 0.0]".into(),
            "s.toml:1:17: TOML syntax: the number 1e999 is too large; the file must be valid \
             TOML",
        ),
    ]
}

/// Returns settings of steps and materials that are refused.
fn bad_settings() -> Vec<BadScene> {
    vec![
        (
            "[solver]\nsubstep = 4".into(),
            "s.toml:2:11: unknown key 'substep' of solver; the nearest known key is \
             'substeps'",
        ),
        (
            "[solver]\nsubsteps = 0".into(),
            "s.toml:2:12: substeps of solver is 0; accepted: a whole number from 1 to 1000",
        ),
        (
            "[solver]\nrepair = \"much\"".into(),
            "s.toml:2:10: repair of solver is \"much\"; accepted: a number from 0 to 1",
        ),
        (
            "[solver]\nimpact_law = \"hooke\"".into(),
            "s.toml:2:14: impact_law of solver is \"hooke\"; accepted: \"newton\", \"poisson\", \
             \"reflections\"",
        ),
        (
            "[solver]\nledger = 1".into(),
            "s.toml:2:10: ledger of solver is 1; accepted: true or false",
        ),
        (
            "[materials.ice]\nfriction = -1.0".into(),
            "s.toml:2:12: friction of material 'ice' is -1.0; accepted: a number from 0 to \
             1e6",
        ),
    ]
}

/// Returns masses, poses and surfaces of bodies that are refused.
fn bad_masses_and_poses() -> Vec<BadScene> {
    vec![
        (
            ball("frition = 0.3"),
            "s.toml:3:1: unknown key 'frition' of body 'ball'; the nearest known key is \
             'friction'",
        ),
        (
            ball("mass = \"heavy\""),
            "s.toml:3:8: mass of body 'ball' is \"heavy\"; accepted: a number from 1e-12 to \
             1e15 kg, or inf",
        ),
        (
            ball("mass = 0"),
            "s.toml:3:8: mass of body 'ball' is 0; accepted: a number from 1e-12 to 1e15 kg, \
             or inf",
        ),
        (
            ball("mass = 1.0\ndensity = 2.0"),
            "s.toml:3:8: mass of body 'ball' is 1.0; accepted: either mass or density, not \
             both",
        ),
        (
            ball("density = nan"),
            "s.toml:3:11: density of body 'ball' is nan; accepted: a number from 1e-12 to \
             1e15 kg/m^3 (3D), kg/m^2 (2D)",
        ),
        (
            ball("position = [0.0, inf, 0.0]"),
            "s.toml:3:12: position of body 'ball' is [0.0, inf, 0.0]; accepted: 3 numbers \
             from -1e6 to 1e6 m",
        ),
        (
            ball("position = [0.0, 1e7, 0.0]"),
            "s.toml:3:12: position of body 'ball' is [0.0, 10000000.0, 0.0]; accepted: 3 \
             numbers from -1e6 to 1e6 m",
        ),
        (
            ball("rotation = [0.0, 0.0, 0.0, 0.0]"),
            "s.toml:3:12: rotation of body 'ball' is [0.0, 0.0, 0.0, 0.0]; accepted: 4 \
             numbers that make a vector of length 1 (within 1e-3)",
        ),
        (
            ball("rotation = [0.0, 0.0, 0.0, 1.01]"),
            "s.toml:3:12: rotation of body 'ball' is [0.0, 0.0, 0.0, 1.01]; accepted: 4 \
             numbers that make a vector of length 1 (within 1e-3)",
        ),
        (
            ball("restitution = 1.5"),
            "s.toml:3:15: restitution of body 'ball' is 1.5; accepted: a number from 0 to 1",
        ),
        (
            ball("friction_combine = \"mean\""),
            "s.toml:3:20: friction_combine of body 'ball' is \"mean\"; accepted: \"average\", \
             \"minimum\", \"maximum\", \"multiply\", \"geometric_mean\"",
        ),
        (
            ball("motion = \"moving\""),
            "s.toml:3:10: motion of body 'ball' is \"moving\"; accepted: \"dynamic\", \
             \"static\", \"kinematic\"",
        ),
        (
            ball("motion = \"static\"\nmass = inf"),
            "s.toml:4:8: mass of body 'ball' is inf; accepted: inf for dynamic bodies only; \
             leave it out here",
        ),
    ]
}

/// Returns names, tracks and collision systems that are refused.
fn bad_references() -> Vec<BadScene> {
    vec![
        (
            ball("material = \"ise\""),
            "s.toml:3:12: material of body 'ball' is \"ise\"; accepted: the name of a \
             material; the scene has no materials",
        ),
        (
            format!("materials.ice.friction = 0.0\n{}", ball("material = \"ise\"")),
            "s.toml:4:12: material of body 'ball' is \"ise\"; accepted: the name of a \
             material; the nearest material is 'ice'",
        ),
        (
            format!("{0}{0}", ball("")),
            "s.toml:8:8: name of body 'ball' is \"ball\"; accepted: a name of its own: body 0 \
             has this one already",
        ),
        (
            ball("motion = \"static\"\ntrack = [{ time = 0.0 }]"),
            "s.toml:4:9: track of body 'ball' is [a table]; accepted: a track on a kinematic or \
             dynamic body only",
        ),
        (
            ball("motion = \"kinematic\"\nstart_asleep = true"),
            "s.toml:4:16: start_asleep of body 'ball' is true; accepted: true for dynamic bodies \
             without a track only",
        ),
        (
            ball("motion = \"kinematic\"\ntrack = [{ time = 1 }, { time = 1 }]"),
            "s.toml:4:33: time of key 1 of the track of body 'ball' is 1; accepted: times \
             that rise: above 1",
        ),
        (
            ball("collision = { collides_with = [], not_collides_with = [] }"),
            "s.toml:3:55: not_collides_with of collision of body 'ball' is []; accepted: \
             either collides_with or not_collides_with, not both",
        ),
        (
            ball("collision = { systems = [\"a\", \"7\"] }"),
            "s.toml:3:31: systems of collision of body 'ball' is \"7\"; accepted: either \
             names or numbers for all systems, not both",
        ),
        (
            ball("collision = { systems = [\"64\"] }"),
            "s.toml:3:26: systems of collision of body 'ball' is \"64\"; accepted: at most 64 \
             systems in a scene",
        ),
    ]
}

/// Returns shapes that are refused.
fn bad_shapes() -> Vec<BadScene> {
    vec![
        (
            "[[bodies]]".into(),
            "s.toml:1:1: shapes of body 0 is missing; accepted: at least one shape for a \
             dynamic body",
        ),
        (
            "[[bodies]]\nname = \"b\"\nshapes = []".into(),
            "s.toml:3:10: shapes of body 'b' is []; accepted: at least one shape for a \
             dynamic body",
        ),
        (
            shape("dynamic", "radius = 1.0"),
            "s.toml:4:11: type of shape 0 of body 'b' is missing; accepted: \"sphere\", \
             \"box\", \"capsule\", \"cylinder\", \"convex_hull\", \"halfspace\", \"trimesh\"",
        ),
        (
            shape("dynamic", "type = \"ball\""),
            "s.toml:4:20: type of shape 0 of body 'b' is \"ball\"; accepted: \"sphere\", \
             \"box\", \"capsule\", \"cylinder\", \"convex_hull\", \"halfspace\", \"trimesh\"",
        ),
        (
            shape("dynamic", "type = \"sphere\""),
            "s.toml:4:11: radius of shape 0 of body 'b' is missing; accepted: a number from \
             1e-5 to 1e6 m",
        ),
        (
            shape("dynamic", "type = \"sphere\", radius = 0"),
            "s.toml:4:39: radius of shape 0 of body 'b' is 0; accepted: a number from 1e-5 to \
             1e6 m",
        ),
        (
            shape("dynamic", "type = \"box\", radius = 1.0"),
            "s.toml:4:27: unknown key 'radius' of shape 0 of body 'b'; the nearest known key \
             is 'rotation'",
        ),
        (
            shape("dynamic", "type = \"box\", half_extents = [1.0, 1.0]"),
            "s.toml:4:42: half_extents of shape 0 of body 'b' is [1.0, 1.0]; accepted: 3 \
             numbers from 1e-5 to 1e6 m",
        ),
        (
            shape("dynamic", "type = \"capsule\", radius = 1.0, half_height = -1.0"),
            "s.toml:4:59: half_height of shape 0 of body 'b' is -1.0; accepted: a number from \
             0 to 1e6 m",
        ),
        (
            shape("dynamic", "type = \"halfspace\", normal = [0, 1, 0]"),
            "s.toml:4:20: type of shape 0 of body 'b' is \"halfspace\"; accepted: \
             \"halfspace\" on static and kinematic bodies only",
        ),
        (
            shape("static", "type = \"halfspace\", normal = [0, 2, 0]"),
            "s.toml:4:42: normal of shape 0 of body 'b' is [0, 2, 0]; accepted: 3 numbers \
             that make a vector of length 1 (within 1e-3)",
        ),
        (
            shape("dynamic", "type = \"convex_hull\", points = [[0, 0, 0], [1, 0, 0]]"),
            "s.toml:4:44: points of shape 0 of body 'b' is a list of 2; accepted: at least 4 \
             points that are not all in one plane",
        ),
        (
            shape(
                "dynamic",
                "type = \"convex_hull\", points = [[0,0,0], [1,0,0], [0,1,0], [1,1,0]]",
            ),
            "s.toml:4:44: points of shape 0 of body 'b' is a list of 4; accepted: at least 4 \
             points that are not all in one plane",
        ),
        (
            shape("static", "type = \"trimesh\", vertices = [[0,0,0]], triangles = [[0,1,2]]"),
            "s.toml:4:66: triangles of shape 0 of body 'b' is [0, 1, 2]; accepted: 3 indices \
             below 1, the number of vertices",
        ),
        (
            shape("static", "type = \"trimesh\", vertices = [], triangles = []"),
            "s.toml:4:58: triangles of shape 0 of body 'b' is []; accepted: at least one \
             triangle: a list of 3 indices of vertices, of which one has an area",
        ),
    ]
}

/// Returns particles and bodies in 2D that are refused.
fn bad_kinds() -> Vec<BadScene> {
    vec![
        (
            particles(ball("friction = 0.5")),
            "s.toml:2:1: friction of body 'ball' is 0.5; accepted: 0 for a particle, or leave \
             bodies_as = \"particles\" out",
        ),
        (
            particles(shape("static", "type = \"box\", half_extents = [1, 1, 1]")),
            "s.toml:2:1: type of shape 0 of body 'b' is \"box\"; accepted: \"sphere\" or \
             \"halfspace\" in a scene of particles, or leave bodies_as = \"particles\" out",
        ),
        (
            particles(shape("dynamic", "type = \"sphere\", radius = 1, position = [0, 1, 0]")),
            "s.toml:2:1: position of shape 0 of body 'b' is [0.0, 1.0, 0.0]; accepted: 0 for \
             a particle, or leave bodies_as = \"particles\" out",
        ),
        (
            format!("dimension = 2\n{}", shape("static", "type = \"trimesh\"")),
            "s.toml:5:20: type of shape 0 of body 'b' is \"trimesh\"; accepted: \"trimesh\" \
             in 3D only",
        ),
        (
            format!("dimension = 2\n{}", ball("rotation = [0.0, 0.0, 0.0, 1.0]")),
            "s.toml:4:12: rotation of body 'ball' is [0.0, 0.0, 0.0, 1.0]; accepted: a number \
             from -1e6 to 1e6 rad",
        ),
    ]
}

/// Returns JSON that is refused.
fn bad_json() -> Vec<BadScene> {
    vec![
        (
            "{\"steps\": 1, \"steps\": 2}".into(),
            "s.json:1:20: JSON syntax: duplicate key \"steps\"; the file must be valid JSON",
        ),
        (
            "{\"gravity\": [0, 1e999, 0]}".into(),
            "s.json:1:21: JSON syntax: number out of range; the file must be valid JSON",
        ),
        (
            "{\"gravity\": [0, NaN, 0]}".into(),
            "s.json:1:17: JSON syntax: expected value; the file must be valid JSON",
        ),
        (
            "{\n  \"größe\": \"größe\" 1}".into(),
            "s.json:2:20: JSON syntax: expected `,` or `}`; the file must be valid JSON",
        ),
        (
            "{\"bodies\": [{\"motion\": \"static\"}, {\"a/b\": 1}]}".into(),
            "s.json at /bodies/1/a~1b: unknown key 'a/b' of body 1; the nearest known key is \
             'name'",
        ),
        (
            "{\"bodies\": [{\"shapes\": [{\"type\": \"sphere\", \"radius\": null}]}]}".into(),
            "s.json at /bodies/0/shapes/0/radius: radius of shape 0 of body 0 is null; \
             accepted: a number from 1e-5 to 1e6 m",
        ),
    ]
}

/// Each bad scene is refused with exactly the expected message: place, item, value and what is
/// accepted.
#[test]
fn errors_name_place_item_value_and_what_is_accepted() {
    let mut wrong = Vec::new();
    let bad = [
        bad_files_and_times(),
        bad_settings(),
        bad_masses_and_poses(),
        bad_references(),
        bad_shapes(),
        bad_kinds(),
        bad_json(),
    ];
    for (text, message) in bad.into_iter().flatten() {
        let actual = if text.starts_with('{') { json_error(&text) } else { toml_error(&text) };
        if actual != message {
            wrong.push(actual);
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

fn warnings(text: &str) -> Vec<String> {
    let read = read_toml(Path::new("s.toml"), text).unwrap();
    read.warnings.iter().map(ToString::to_string).collect()
}

/// Keys that have no effect and implausible values give a warning.
#[test]
fn values_without_effect_give_warnings() {
    let expected = ["1:10: events are not supported yet: the scene runs without them"];
    assert_eq!(warnings("events = [1]\njoints = []"), expected);
    let still = ball("motion = \"static\"\nlinear_velocity = [0, 1, 0]");
    let expected = ["4:19: linear_velocity of body 'ball' does not act: the body is static"];
    assert_eq!(warnings(&still), expected);
    assert_eq!(warnings(&ball("inertia = [1.0, 1.0, 3.0]")).len(), 1);
    assert_eq!(warnings(&ball("inertia = [1.0, inf, 3.0]")).len(), 0);
    assert_eq!(warnings(&ball("position = [0, 20000, 0]")).len(), 1);
}

fn scene(text: &str) -> Scene {
    read_toml(Path::new("s.toml"), text).unwrap_or_else(|error| panic!("{error}")).scene
}

/// An empty TOML file is a scene of defaults without bodies; empty JSON is refused.
#[test]
fn an_empty_file_is_an_empty_scene() {
    let scene = scene("\u{feff}# nothing\r\n");
    assert_eq!((scene.dimension, scene.time_step), (3, 1.0 / 60.0));
    assert_eq!(scene.gravity, [0.0, -9.81, 0.0]);
    assert!(scene.bodies.is_empty());
    assert!(json_error("").starts_with("s.json:1:1: JSON syntax: "));
    assert_eq!(json_error("[]"), "s.json: the scene is []; accepted: a table");
}

/// The properties of a body override those of its material, and those of a shape override both.
#[test]
fn materials_are_overridden_by_bodies_and_shapes() {
    let scene = scene(
        "[materials.ice]\nfriction = 0.1\nrestitution = 0.2\ndensity = 900\n\
         [[bodies]]\nmaterial = \"ice\"\nrestitution = 0.3\n\
         [[bodies.shapes]]\ntype = \"sphere\"\nradius = 1\n\
         [[bodies.shapes]]\ntype = \"sphere\"\nradius = 1\nfriction = 0.4\n",
    );
    let body = &scene.bodies[0];
    assert_eq!(body.mass.density, Some(900.0));
    let [a, b] = [&body.shapes[0].material, &body.shapes[1].material];
    assert_eq!((a.friction, a.restitution), (0.1, 0.3));
    assert_eq!((b.friction, b.restitution), (0.4, 0.3));
}

/// A duration becomes the number of steps that covers it.
#[test]
fn duration_becomes_steps() {
    assert_eq!(scene("duration = 2.0").steps, Some(120));
    assert_eq!(scene("duration = 2.001").steps, Some(121));
    assert_eq!(scene("duration = 0.0").steps, Some(0));
}

/// A quaternion that is nearly of length 1 is normalized within 1e-15.
#[test]
fn nearly_unit_quaternions_are_made_unit() {
    let scene = scene(&ball("rotation = [0.0, 0.0, 0.6, 0.8004]"));
    let Rotation::Quaternion(q) = scene.bodies[0].rotation else { panic!("no quaternion") };
    assert!((q.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-15);
}

/// Collision systems become bits in their order of appearance.
#[test]
fn systems_become_bits_in_order_of_appearance() {
    let collision = "collision = { systems = [\"a\", \"b\"], not_collides_with = [\"b\"] }";
    let filter = scene(&ball(collision)).bodies[0].shapes[0].filter;
    assert_eq!((filter.systems, filter.collides_with), (0b11, !0b10));
    assert!(filter.collides_with_unnamed);
}

/// Settings of a scene override those of the preset.
#[test]
fn a_scene_has_its_own_settings() {
    let scene = scene("[solver]\nsubsteps = 7\nimpact_law = \"poisson\"");
    let settings = drystone_bake::settings(&scene, StepSettings::realtime()).unwrap();
    let impact_law = ImpactLaw::Poisson;
    // The stated number of substeps is also the largest one, even for small bodies.
    let [substeps, max_substeps] = [7, 7];
    let realtime = StepSettings::realtime();
    assert_eq!(settings, StepSettings { substeps, max_substeps, impact_law, ..realtime });
}

/// Infinite masses are read from TOML and JSON, and any extras are accepted.
#[test]
fn infinite_masses_and_extras_are_read() {
    let scene = scene(&ball("mass = inf\ninertia = [1.0, inf, 1.0]\nextras = { any = [1] }"));
    assert_eq!(scene.bodies[0].mass.mass, Some(f64::INFINITY));
    assert_eq!(scene.bodies[0].motion, Motion::Dynamic);
    let body = "{\"mass\": \"inf\", \"shapes\": [{\"type\": \"sphere\", \"radius\": 1}]}";
    let json = format!("{{\"bodies\": [{body}]}}");
    let scene = read_json(Path::new("s.json"), &json).unwrap().scene;
    assert_eq!(scene.bodies[0].mass.mass, Some(f64::INFINITY));
}

/// Nesting of 100 000 levels is a syntax error, not a stack overflow.
#[test]
fn deep_nesting_is_an_error() {
    let deep = 100_000;
    let dotted = vec!["a"; deep].join(".");
    for text in [
        format!("extras = {}{}", "[".repeat(deep), "]".repeat(deep)),
        format!("extras = {}1{}", "{a = ".repeat(deep), "}".repeat(deep)),
        format!("extras.{dotted} = 1"),
        format!("[extras.{dotted}]"),
    ] {
        assert!(toml_error(&text).contains("TOML syntax"));
    }
    for open in ["[", "{\"a\":"] {
        assert!(json_error(&format!("{{\"extras\": {}", open.repeat(deep))).contains("recursion"));
    }
}

/// Messages on texts of 1 MB are shorter than 500 bytes.
#[test]
fn long_texts_are_cut_in_messages() {
    let long = "x".repeat(1_000_000);
    for message in [
        toml_error(&format!("{long} = 1")),
        toml_error(&ball(&format!("motion = \"{long}\""))),
        toml_error(&format!("steps = 1{}", "0".repeat(1_000_000))),
        json_error(&format!("{{\"{long}\": 1, \"{long}\": 1}}")),
    ] {
        assert!(message.len() < 500 && message.contains("..."), "{}", message.len());
    }
}

/// A message has one line, even if a name has several.
#[test]
fn messages_have_one_line() {
    let name = "name = \"two\\nlines\"\nmass = 0";
    let text = format!("[[bodies]]\n{name}\nshapes = [{{type = \"sphere\", radius = 1}}]");
    assert_eq!(toml_error(&text).lines().count(), 1);
}

const SAMPLE: &str = "time_step = 0.01\r\n[materials.\"a b\"]\nfriction = 0.5\n\
    [[bodies]]\nname = \"ünï\"\nmotion = \"kinematic\"\ntrack = [{ time = 0 }, { time = 1.5e0 }]\n\
    shapes = [{ type = \"box\", half_extents = [1, 2, 3] }, { type = \"trimesh\", \
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], triangles = [[0, 1, 2]] }]\n\
    [solver]\nsubsteps = 3\n";

/// Every truncation of a TOML scene is read or refused without a panic, and every one of a JSON
/// scene is refused.
#[test]
fn every_truncation_is_read_or_refused() {
    let json = drystone_scene::to_json(&scene(SAMPLE));
    for (end, _) in SAMPLE.char_indices() {
        toml_error(&SAMPLE[..end]);
    }
    for (end, _) in json.trim_end().char_indices() {
        assert_ne!(json_error(&json[..end]), "accepted");
    }
}

proptest! {
    /// Any text of up to 200 characters is read or refused without a panic.
    #[test]
    fn any_text_is_read_or_refused(text in ".{0,200}") {
        let _ = (toml_error(&text), json_error(&text));
    }

    /// A scene with one changed character is read or refused without a panic.
    #[test]
    fn a_changed_letter_is_read_or_refused(at in 0..SAMPLE.len(), letter in any::<char>()) {
        if let (Some(before), Some(after)) = (SAMPLE.get(..at), SAMPLE.get(at + 1..)) {
            toml_error(&format!("{before}{letter}{after}"));
        }
    }
}

/// The extension of a file selects its reader. Unknown extensions, unreadable files, bytes that are
/// no UTF-8 and files over 1 GiB are refused.
#[test]
fn files_are_read_by_their_extension() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    for (name, text) in [("a.TOML", "steps = 3"), ("b.json", "{\"steps\": 3}")] {
        std::fs::write(path(name), text).unwrap();
        assert_eq!(read(&path(name)).unwrap().scene.steps, Some(3));
    }
    let error = read(&path("a.yaml")).unwrap_err();
    assert_eq!(error.accepted, "accepted: .toml, .json, .gltf, .glb, .usda");
    assert!(!error.unreadable);
    std::fs::create_dir(path("c.toml")).unwrap();
    for name in ["c.toml", "missing.json"] {
        assert!(read(&path(name)).unwrap_err().unreadable);
    }
    std::fs::write(path("d.toml"), b"name = \"\xff\"").unwrap();
    let error = read(&path("d.toml")).unwrap_err();
    assert_eq!((error.place, error.unreadable), (Place::Byte(8), false));
    std::fs::File::create(path("e.toml")).unwrap().set_len((1 << 30) + 1).unwrap();
    assert_eq!(read(&path("e.toml")).unwrap_err().value, "over 1 GiB");
}
