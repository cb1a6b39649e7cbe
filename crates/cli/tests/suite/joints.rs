//! Tests of the rows of joints in saved steps, in `drystone solve` and in `drystone matrix`.

use std::fs;

use serde_json::{Value, json};

use crate::common::Place;

/// Two balls of 1 and 2 kg hang from the world. A block of 8 kg lies on the floor and holds a wheel
/// of 1 kg, whose motor has 0.01 N m.
const SCENE: &str = r#"
name = "hanging"
duration = 1
[[bodies]]
name = "floor"
motion = "static"
shapes = [{ type = "halfspace", normal = [0, 1, 0] }]
[[bodies]]
name = "upper"
mass = 1
position = [0, 3, 0]
shapes = [{ type = "sphere", radius = 0.1 }]
[[bodies]]
name = "lower"
mass = 2
position = [0, 2, 0]
shapes = [{ type = "sphere", radius = 0.1 }]
[[bodies]]
name = "block"
mass = 8
position = [2, 0.1, 0]
shapes = [{ type = "box", half_extents = [0.2, 0.1, 0.2] }]
[[bodies]]
name = "wheel"
mass = 1
position = [2, 1, 0]
shapes = [{ type = "sphere", radius = 0.1 }]
[[joints]]
type = "ball"
name = "hook"
bodies = ["upper"]
anchor = [0, 4, 0]
[[joints]]
type = "ball"
name = "ring"
bodies = ["lower", "upper"]
anchor = [0, 3, 0]
[[joints]]
type = "hinge"
name = "axle"
bodies = ["wheel", "block"]
anchor = [2, 1, 0]
axis = [0, 0, 1]
motor = { velocity = 3, at_most = 0.01 }
"#;

fn json_in(place: &Place, name: &str) -> Value {
    serde_json::from_slice(&fs::read(place.path(name)).unwrap()).unwrap()
}

fn numbers(of: &Value) -> Vec<f64> {
    of.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

/// The saved rows have their joints, names and laws. Solved again, the locks bear half of the
/// weights, since the end of the substep bears the other half; the motor gives what it can.
#[test]
fn the_joints_of_a_step_are_saved_and_solved() {
    let place = Place::new(SCENE);
    place.succeeds(&["bake", "scene.toml", "--dump-step", "30", "--dump", "a.json"]);
    let saved = json_in(&place, "a.json");
    let rows = &saved["joint_rows"];
    let first = &rows["joints"][0];
    assert_eq!(first["name"], "hook");
    assert_eq!((&first["names"], &first["bodies"]), (&json!(["upper", null]), &json!([1, null])));
    assert_eq!((&first["rows"], rows["rows"].as_array().unwrap().len()), (&json!(3), 3 + 3 + 6));
    assert_eq!(rows["rows"][1], json!({ "coordinate": "y", "kind": "lock" }));
    assert_eq!(rows["bounds"][1], json!([null, null]));
    let kind = |kind: &str| {
        rows["rows"].as_array().unwrap().iter().position(|row| row["kind"] == kind).unwrap()
    };
    let (dt, motor) = (saved["dt"].as_f64().unwrap(), kind("drive"));
    let bound = 0.01 * dt;
    assert!((numbers(&rows["bounds"][motor])[1] / bound - 1.0).abs() < 1e-6, "{rows}");
    for method in ["auto", "gauss-seidel", "proximal", "interior-point"] {
        let solve = ["solve", "a.json", "--method", method, "-o", "result.json"];
        let text = place.succeeds(&solve);
        assert!(text.contains("and 12 rows of joints"), "{text}");
        let result = json_in(&place, "result.json");
        let certificate = &result["certificate"];
        assert!(certificate["gap"].as_f64().unwrap() < 1e-9, "{certificate}");
        assert!(certificate["row_miss"].as_f64().unwrap() < 1e-6, "{certificate}");
        let r = numbers(&result["r"]);
        let r = &r[r.len() - 12..];
        for (row, mass) in [(1, 3.0), (4, 2.0)] {
            let weight = mass * 9.81 * dt;
            assert!((r[row] / weight - 0.5).abs() < 0.02, "{r:?}, not {weight} / 2");
        }
        assert!((r[motor] / bound - 1.0).abs() < 1e-6, "{r:?}, not {bound}");
    }
    let refused = place.fails(2, &["solve", "a.json", "--method", "lemke"]);
    assert!(refused.contains("friction") || refused.contains("joints"), "{refused}");
}

/// Rows that do not fit together are refused, with their place in the file.
#[test]
fn wrong_rows_of_joints_are_refused() {
    let place = Place::new(SCENE);
    place.succeeds(&["bake", "scene.toml", "--dump-step", "1", "--dump", "a.json"]);
    let saved = json_in(&place, "a.json");
    let refused = |key: &str, value: Value| {
        let mut wrong = saved.clone();
        wrong["joint_rows"][key] = value;
        fs::write(place.path("b.json"), wrong.to_string()).unwrap();
        place.fails(2, &["solve", "b.json"])
    };
    assert!(refused("bounds", json!([[0, 1]])).contains("/joint_rows/bounds"));
    assert!(refused("eps", json!([0])).contains("/joint_rows/eps"));
    let mut targets = saved["joint_rows"]["t"].clone();
    targets[0] = json!([0]);
    assert!(refused("t", targets.clone()).contains("/joint_rows/t/0"));
    targets[0] = json!([1, 0]);
    assert!(refused("t", targets).contains("the law of row 0"));
}

/// Joints that a file leaves out are named, with their number.
#[test]
fn left_out_joints_are_named() {
    let place = Place::new(SCENE);
    let dump = ["bake", "scene.toml", "--dump-step", "2", "--dump"];
    let warned = |more: &[&str]| {
        let output = place.run(&[&dump[..], more].concat());
        String::from_utf8(output.stderr).unwrap()
    };
    assert!(!warned(&["a.json"]).contains("left out"));
    let names = "12 rows of 3 joints left out: 'hook', 'ring', 'axle'";
    let said = warned(&["b.json", "--dump-impacts"]);
    assert!(said.contains(names), "{said}");
    assert!(json_in(&place, "b.json")["joint_rows"].is_null());
    if cfg!(feature = "fclib") {
        let said = warned(&["c.hdf5"]);
        assert!(
            said.contains("FCLIB's format has contacts alone") && said.contains(names),
            "{said}"
        );
    }
}

/// The rows of joints have their names beside the contacts, and couple bodies that touch nothing.
#[test]
fn joints_are_drawn_beside_contacts() {
    let place = Place::new(SCENE);
    place.succeeds(&["matrix", "scene.toml", "--step", "30", "-o", "a.svg"]);
    let svg = fs::read_to_string(place.path("a.svg")).unwrap();
    assert!(svg.contains("4 contacts and 12 rows of joints"), "{svg}");
    for text in ["hook y  6", "ring y  9", "axle twist drive  14"] {
        assert!(svg.contains(&format!(">{text}</text>")), "{text}: {svg}");
    }
    // The hook has one body that moves, the ring and the axle have two.
    assert_eq!(svg.matches("stroke-dasharray").count(), 1 + 2 + 2, "{svg}");
    let hanging = SCENE.replace("position = [2, 0.1, 0]", "position = [2, 5, 0]");
    let place = Place::new(&hanging.replace("duration = 1", "duration = 1\ngravity = [0, 0, 0]"));
    place.succeeds(&["matrix", "scene.toml", "-o", "a.svg"]);
    let svg = fs::read_to_string(place.path("a.svg")).unwrap();
    assert!(svg.contains("0 contacts and 12 rows of joints"), "{svg}");
}

/// A loop of bars of 1, 1 and 3 m.
#[test]
fn bars_that_cannot_close_are_named() {
    let bar = |name: &str, x: f64, half: f64| {
        format!(
            "[[bodies]]\nname = \"{name}\"\nposition = [{x}, 0, 0]\n\
             shapes = [{{ type = \"box\", half_extents = [{half}, 0.05, 0.05] }}]\n"
        )
    };
    let joint = |name: &str, bodies: [&str; 2], [a, b]: [f64; 2]| {
        format!(
            "[[joints]]\ntype = \"ball\"\nname = \"{name}\"\nbodies = {bodies:?}\n\
             anchors = [[{a}, 0, 0], [{b}, 0, 0]]\n"
        )
    };
    let scene = [
        "duration = 0.2\ngravity = [0, 0, 0]\n".to_owned(),
        bar("one", 0.5, 0.5),
        bar("two", 1.5, 0.5),
        bar("long", 1.5, 1.5),
        joint("knee", ["one", "two"], [0.5, -0.5]),
        joint("left end", ["one", "long"], [-0.5, -1.5]),
        joint("right end", ["two", "long"], [0.5, 1.5]),
    ];
    let place = Place::new(&scene.concat());
    let text = place.succeeds(&["bake", "scene.toml", "--report", "r.json"]);
    let said = "jammed from step 1: 'one', 'two', 'long'; no velocities satisfy the targets of \
                their contacts and of joints 'knee', 'left end', 'right end'";
    assert!(text.contains(said), "{text}");
    let report = json_in(&place, "r.json");
    assert_eq!(report["summary"]["jammed_joints"], json!({ "0": 1, "1": 1, "2": 1 }));
}
