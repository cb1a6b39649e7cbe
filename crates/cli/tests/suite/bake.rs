//! Tests of `drystone bake` through the command line.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use crate::common::{Place, SCENE, example};
use drystone_bake::recording::{Recording, npz};
use serde_json::Value;

#[test]
fn a_bake_writes_what_was_asked_for() {
    let place = Place::new(SCENE);
    let arguments =
        ["bake", "scene.toml", "-o", "out.glb", "-o", "out.poses", "--report", "r.json"];
    let summary = place.succeeds(&arguments);
    assert_eq!(place.files(), ["out.glb", "out.poses", "r.json", "scene.toml"]);
    assert!(summary.contains("drop") && summary.contains("none was created"), "{summary}");
    assert_eq!(fs::metadata(place.path("out.poses")).unwrap().len(), 121 * 3 * 7 * 4);
    let glb = fs::read(place.path("out.glb")).unwrap();
    assert_eq!(&glb[..4], b"glTF");
    assert_eq!(u32::from_le_bytes(glb[8..12].try_into().unwrap()) as usize, glb.len());
    assert!((2_000..100_000).contains(&glb.len()), "{}", glb.len());
}

#[test]
fn a_tolerance_is_proven_in_every_step() {
    let place = Place::new(SCENE);
    let summary = place.succeeds(&["bake", "scene.toml", "--report", "r.json"]);
    assert!(summary.contains("all 120 steps within 1.000 mm/s of the exact"), "{summary}");
    for fixed in ["--realtime", "--tolerance=0mm/s"] {
        let summary = place.succeeds(&["bake", "scene.toml", "--report", "r.json", fixed]);
        assert!(summary.contains("the last substep of each step within"), "{fixed}: {summary}");
    }
    let tolerance = ["--tolerance", "0.5mm/s", "--duration", "1"];
    let arguments = ["bake", "scene.toml", "--report", "r.json"];
    let summary = place.succeeds(&[&arguments[..], &tolerance[..]].concat());
    assert!(summary.contains("all 60 steps within 0.500 mm/s of the exact"), "{summary}");
    let report: Value = serde_json::from_slice(&fs::read(place.path("r.json")).unwrap()).unwrap();
    let certified = &report["summary"]["certified"];
    assert_eq!(certified["steps"], 60);
    let worst = certified["worst"].as_f64().unwrap();
    assert!(worst > 0.0 && worst <= 5e-4, "{worst}");
    for wrong in ["1mm", "-1mm/s", "nan", "1km/s"] {
        let wrong = format!("--tolerance={wrong}");
        let message = place.fails(2, &["bake", "scene.toml", "--report", "r.json", &wrong]);
        assert!(message.contains("such as 1mm/s"), "{message}");
    }
}

/// The saved contacts of a step can be solved again: certified, and with the impulses that carry
/// the bodies on the floor.
#[test]
fn the_contacts_of_a_step_are_saved_and_solved() {
    let place = Place::new(SCENE);
    let run = ["bake", "scene.toml", "-o", "out.poses", "--duration", "2", "--dump-step", "110"];
    let summary = place.succeeds(&run);
    assert!(summary.contains("out.poses.step-110.json"), "{summary}");
    let dump = fs::read(place.path("out.poses.step-110.json")).unwrap();
    let dump: Value = serde_json::from_slice(&dump).unwrap();
    let (n, d) = (dump["nc"].as_u64().unwrap(), dump["dim"].as_u64().unwrap());
    assert!(n >= 4 && d == 3, "{n} contacts in {d}D");
    assert_eq!(dump["v_star"].as_array().unwrap().len(), 18);
    assert_eq!(dump["t"].as_array().unwrap().len() as u64, 3 * n);
    assert_eq!(dump["contacts"].as_array().unwrap().len() as u64, n);
    assert_eq!(dump["contacts"][0]["names"].as_array().unwrap().len(), 2);
    let substeps = f64::from(drystone::StepSettings::certified().substeps);
    assert!((dump["dt"].as_f64().unwrap() - 1.0 / 60.0 / substeps).abs() < 1e-9);
    for method in ["auto", "gauss-seidel", "proximal"] {
        let text = place.succeeds(&[
            "solve",
            "out.poses.step-110.json",
            "--method",
            method,
            "-o",
            "result.json",
        ]);
        assert!(text.contains("certificate  gap"), "{text}");
        let result: Value =
            serde_json::from_slice(&fs::read(place.path("result.json")).unwrap()).unwrap();
        assert!(result["certificate"]["gap"].as_f64().unwrap() < 1e-9, "{result}");
        let r = result["r"].as_array().unwrap();
        let (contacts, r) =
            (dump["contacts"].as_array().unwrap(), |i: usize| r[i].as_f64().unwrap());
        let on_floor = contacts
            .iter()
            .enumerate()
            .filter(|(_, of)| of["names"][1] == "floor" || of["names"][0] == "floor");
        // At rest the floor carries the weight; the bodies weigh 48 and 33.5 kg.
        let carried: f64 = on_floor.map(|(i, _)| r(3 * i)).sum();
        let weight = (48.0 + 1000.0 * 4.0 / 3.0 * std::f64::consts::PI * 0.008) * 9.81;
        let weight = weight / 60.0 / substeps;
        assert!((carried / weight - 1.0).abs() < 0.2, "{carried} N s, not {weight}");
    }
    let wrong = place.fails(2, &["bake", "scene.toml", "-o", "out.poses", "--dump-step", "500"]);
    assert!(wrong.contains("accepted: 1 to 120"), "{wrong}");
    let run = ["bake", "scene.toml", "--dump-step", "3", "--dump", "out.dat"];
    assert!(place.fails(2, &run).contains("accepted: .json, .hdf5"));
}

fn json_in(place: &Place, name: &str) -> Value {
    serde_json::from_slice(&fs::read(place.path(name)).unwrap()).unwrap()
}

/// Solves a problem file without friction and returns the impulses.
fn impulses(place: &Place, file: &str) -> Vec<f64> {
    let text = place.succeeds(&["solve", file, "-o", "result.json"]);
    assert!(!text.contains("inf"), "{text}");
    let z = &json_in(place, "result.json")["z"];
    z.as_array().unwrap().iter().map(|z| z.as_f64().unwrap()).collect()
}

/// The notes' two pairs as equation (2): A gamma = -(1 + c_r) J v-, whenever they collide in a
/// step.
#[test]
fn the_impacts_of_a_step_are_saved_as_equation_2() {
    let scene = fs::read_to_string(example("notes/two_pairs.toml")).unwrap();
    for start in ["-0.4", "-0.386"] {
        let place = Place::new(&scene.replace("[-0.4, 0]", &format!("[{start}, 0]")));
        let dump = ["bake", "scene.toml", "--dump-step", "6", "--report", "r.json", "--dump"];
        place.succeeds(&[&dump[..], &["a.json", "--dump-impacts"]].concat());
        let impacts = json_in(&place, "a.json");
        for (gamma, by_hand) in impulses(&place, "a.json").iter().zip([2.25, 3.0]) {
            assert!((gamma - by_hand).abs() < 1e-6, "{gamma} N s from {start} m");
        }
        let numbers = |key: &str| -> Vec<f64> {
            impacts[key].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
        };
        let before = numbers("v_star");
        for (v, own) in before.iter().zip([2.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0]) {
            assert!((v - own).abs() < 1e-6, "{before:?}");
        }
        let targets = numbers("t");
        assert!((targets[0] - 1.0).abs() < 1e-6 && (targets[2] - 1.0).abs() < 1e-6, "{targets:?}");
        assert!((impacts["contacts"][0]["impact"].as_f64().unwrap() - 2.25).abs() < 1e-6);
        assert_eq!(impacts["contacts"][0]["restitution"], 0.5);
        // Without the flag the contacts after the impacts are saved, with a warning.
        let output = place.run(&[&dump[..], &["b.json"]].concat());
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(said.contains("2 of the contacts saved in step 6 bounced"), "{said}");
        assert!(json_in(&place, "b.json")["v_star"] != impacts["v_star"]);
    }
}

/// A ball that falls on a floor: the saved impact is the impulse of the simulation, but for the
/// velocity that gravity gives in the step.
#[test]
fn the_impact_on_a_floor_is_saved_and_the_floor_is_said_to_be_fixed() {
    let scene = r#"
duration = 1
[[bodies]]
name = "floor"
motion = "static"
restitution = 0.5
shapes = [{ type = "halfspace", normal = [0, 1, 0] }]
[[bodies]]
name = "ball"
position = [0, 1.2, 0]
restitution = 0.5
shapes = [{ type = "sphere", radius = 0.2 }]
"#;
    let place = Place::new(scene);
    let fall = (2.0f64 / 9.81).sqrt() * 60.0;
    let step = (fall.ceil() as u32).to_string();
    let dump = ["bake", "scene.toml", "--report", "r.json", "--dump-impacts", "--dump-step"];
    place.succeeds(&[&dump[..], &[&step, "--dump", "a.json"]].concat());
    let (impacts, report) = (json_in(&place, "a.json"), json_in(&place, "r.json"));
    let impact = impacts["contacts"][0]["impact"].as_f64().unwrap();
    let gamma = impulses(&place, "a.json");
    let gained = 1.5 * 9.81 / 60.0 / (1.5 * (2.0 * 9.81f64).sqrt());
    assert!(impact > 0.0 && (gamma[0] / impact - 1.0).abs() < gained, "{gamma:?}, not {impact}");
    let bodies = &impacts["bodies"];
    assert_eq!((&bodies[0]["name"], &bodies[0]["fixed"]), (&"floor".into(), &true.into()));
    assert_eq!((&bodies[1]["name"], &bodies[1]["fixed"]), (&"ball".into(), &false.into()));
    assert!(impacts["fixed_bodies"].as_str().unwrap().contains("M^-1 is 0 there"));
    for key in ["scene_hash", "version", "settings"] {
        assert!(!impacts[key].is_null() && impacts[key] == report[key], "{key}");
    }
    let output = place.run(&[&dump[..], &["3", "--dump", "c.json"]].concat());
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("no contact bounced in step 3"), "{said}");
}

#[test]
fn one_substep_is_not_plural_and_a_short_run_has_no_last_second() {
    let place = Place::new(SCENE);
    let one = ["bake", "scene.toml", "-o", "out.poses", "--steps", "1", "--substeps", "1"];
    let text = place.succeeds(&[&one[..], &["--threads", "1"]].concat());
    assert!(text.contains("1 step of ") && text.contains("; 1 substep, "), "{text}");
    assert!(text.contains("in the last 0.017 s") && !text.contains("last second"), "{text}");
}

/// Rigid contacts whose targets are missed by rounding have no bound, and the summary says so.
#[test]
fn a_step_without_a_bound_is_said_to_have_none() {
    let scene = fs::read_to_string(example("notes/coupled.toml")).unwrap();
    let place = Place::new(&scene.replace("softness = 0.001", "softness = 0.0"));
    for preset in [&["--realtime"][..], &[]] {
        let bake = ["bake", "scene.toml", "-o", "out.poses"];
        let text = place.succeeds(&[&bake[..], preset].concat());
        assert!(text.contains("a bound in step") || text.contains("no bound in step"), "{text}");
        assert!(!text.contains("inf"), "{text}");
    }
}

/// A ball in a slot that is too narrow for it.
#[test]
fn a_jam_is_named() {
    let scene = r#"
name = "slot"
duration = 0.5
gravity = [0, 0, 0]

[[bodies]]
name = "left"
motion = "static"
position = [-0.19, 0, 0]
shapes = [{ type = "halfspace", normal = [1, 0, 0] }]

[[bodies]]
name = "right"
motion = "static"
position = [0.19, 0, 0]
shapes = [{ type = "halfspace", normal = [-1, 0, 0] }]

[[bodies]]
name = "ball"
shapes = [{ type = "sphere", radius = 0.2 }]
"#;
    let place = Place::new(scene);
    let summary = place.succeeds(&["bake", "scene.toml", "--report", "r.json"]);
    let said = "jammed from step 1: 'left', 'right', 'ball'; no velocities satisfy";
    assert!(summary.contains(said), "{summary}");
    let report: Value = serde_json::from_slice(&fs::read(place.path("r.json")).unwrap()).unwrap();
    assert_eq!(report["summary"]["jammed"], serde_json::json!({ "0": 1, "1": 1, "2": 1 }));
    let free = Place::new(SCENE);
    assert!(!free.succeeds(&["bake", "scene.toml", "--report", "r.json"]).contains("jammed"));
}

#[cfg(feature = "fclib")]
#[test]
fn the_contacts_of_a_step_are_saved_for_fclib() {
    let place = Place::new(SCENE);
    let run = ["bake", "scene.toml", "--steps", "110", "--dump-step", "110"];
    place.succeeds(&[&run[..], &["--dump", "a.json", "--dump", "a.hdf5"]].concat());
    let solved = ["a.json", "a.hdf5"].map(|file| {
        place.succeeds(&["solve", file, "-o", "result.json", "--tolerance", "1e-12"]);
        let result: Value =
            serde_json::from_slice(&fs::read(place.path("result.json")).unwrap()).unwrap();
        let u = result["u"].as_array().unwrap().iter().map(|u| u.as_f64().unwrap());
        u.collect::<Vec<f64>>()
    });
    assert!(!solved[0].is_empty() && solved[0].len() == solved[1].len());
    for (a, b) in solved[0].iter().zip(&solved[1]) {
        assert!((a - b).abs() < 1e-9, "{a} is not {b}");
    }
}

#[test]
fn a_report_has_every_step() {
    let place = Place::new(SCENE);
    place.succeeds(&["bake", "scene.toml", "--report", "r.json", "--threads", "2", "--quiet"]);
    let text = fs::read_to_string(place.path("r.json")).unwrap();
    let report: Value = serde_json::from_str(&text).unwrap();
    let keys: Vec<_> = report.as_object().unwrap().keys().map(String::as_str).collect();
    let expected = [
        "bodies",
        "per_step",
        "scene",
        "scene_hash",
        "settings",
        "steps",
        "summary",
        "threads",
        "version",
    ];
    assert_eq!(keys, expected);
    assert_eq!((&report["bodies"], &report["steps"]), (&3.into(), &120.into()));
    assert_eq!(report["threads"], 2);
    // Numbers are written in short form, not as the `f64` nearest to the `f32`.
    assert!(text.contains("\"prediction_distance\":0.02,"), "{}", report["settings"]);
    assert!(text.contains(&serde_json::to_string(&drystone::StepSettings::certified()).unwrap()));
    let steps = report["per_step"].as_array().unwrap();
    assert_eq!(steps.len(), 120);
    let keys: Vec<_> = steps[0].as_object().unwrap().keys().map(String::as_str).collect();
    let expected = [
        "asleep",
        "certificate",
        "contacts",
        "deepest_penetration",
        "kinetic_energy",
        "manifolds",
        "potential_energy",
        "residual",
        "stage_ms",
        "state",
        "step_ms",
        "substeps",
        "sweeps",
    ];
    assert_eq!(keys, expected);
    assert!(steps[119]["contacts"].as_u64().unwrap() > 0);
    let stages = |step: &Value| -> f64 {
        step["stage_ms"].as_object().unwrap().values().map(|time| time.as_f64().unwrap()).sum()
    };
    for (index, step) in steps.iter().enumerate() {
        let (all, step_ms) = (stages(step), step["step_ms"].as_f64().unwrap());
        assert!(0.0 < all && all <= step_ms, "step {index}: stages {all} ms of {step_ms}");
    }
    assert!(steps.iter().all(|step| step["certificate"].as_f64().unwrap() <= 1e-3));
}

/// Energy that bodies gain after they have lost more is reported: a ball wakes a plate that overlaps
/// the floor, and repair lifts both.
#[test]
fn a_rise_of_energy_after_a_fall_is_reported() {
    let place = Place::new(
        r#"
        duration = 1.0
        [[bodies]]
        name = "floor"
        motion = "static"
        shapes = [{ type = "halfspace", normal = [0, 1, 0] }]
        [[bodies]]
        name = "plate"
        mass = 10
        start_asleep = true
        position = [0, 0.05, 0]
        shapes = [{ type = "box", half_extents = [0.5, 0.1, 0.5] }]
        [[bodies]]
        name = "ball"
        mass = 20
        position = [0, 1.5, 0]
        shapes = [{ type = "sphere", radius = 0.1 }]
        "#,
    );
    let summary = place.succeeds(&["bake", "scene.toml", "--report", "r.json"]);
    assert!(summary.contains("energy was created"), "{summary}");
    let report: Value = serde_json::from_slice(&fs::read(place.path("r.json")).unwrap()).unwrap();
    let of = |key: &str| report["summary"][key].as_f64().unwrap();
    assert!(of("energy_end") < of("energy_start"), "it falls");
    // Both weigh 30 kg, and rise by 5 cm or less.
    let rise = of("energy_rise");
    assert!(rise > of("energy_tolerance") && rise < 30.0 * 9.81 * 0.05, "{rise} J");
    // The ball falls for more than half a second.
    assert!(report["summary"]["energy_risen"]["step"].as_u64().unwrap() > 30, "{summary}");
}

#[test]
fn a_ledger_has_every_step() {
    let place = Place::new(SCENE);
    let summary = place.succeeds(&["bake", "scene.toml", "--report", "r.json", "--ledger"]);
    assert!(summary.contains("none was created"), "{summary}");
    let report: Value = serde_json::from_slice(&fs::read(place.path("r.json")).unwrap()).unwrap();
    let steps = report["per_step"].as_array().unwrap();
    let sum = |item: &str| -> f64 {
        steps.iter().map(|step| step["energy"][item].as_f64().unwrap()).sum()
    };
    let change = report["summary"]["energy_end"].as_f64().unwrap()
        - report["summary"]["energy_start"].as_f64().unwrap();
    assert!((sum("kinetic") + sum("potential") - change).abs() < 1e-6 * change.abs());
    assert!(sum("unexplained").abs() < 1e-5 * change.abs());
    let friction = report["summary"]["ledger"]["items"]["friction"].as_f64().unwrap();
    assert!((friction - sum("friction")).abs() < 1e-9 * change.abs());
}

/// A box that starts deep in the floor is lifted out, and contacts create the energy for that.
#[test]
fn created_energy_is_reported_with_its_step() {
    let buried = "[[bodies]]\nmotion = \"static\"\nshapes = [{ type = \"halfspace\", \
                  normal = [0, 1, 0] }]\n[[bodies]]\nposition = [0, 0.45, 0]\n\
                  shapes = [{ type = \"box\", half_extents = [0.5, 0.5, 0.5] }]\n";
    let place = Place::new(buried);
    let arguments = ["bake", "scene.toml", "--report", "r.json", "--ledger", "--duration", "1"];
    let summary = place.succeeds(&arguments);
    assert!(summary.contains("contacts created") && summary.contains(" in step "), "{summary}");
    let report: Value = serde_json::from_slice(&fs::read(place.path("r.json")).unwrap()).unwrap();
    assert_eq!(report["summary"]["energy_created"], true);
    // 1000 kg are lifted by up to 5 cm.
    let created = report["summary"]["ledger"]["created"].as_f64().unwrap();
    assert!((300.0..600.0).contains(&created), "{created} J");
}

#[test]
fn runs_are_the_same_to_the_last_bit() {
    let place = Place::new(SCENE);
    for (run, threads) in [("a", "1"), ("b", "1"), ("c", "2")] {
        let outputs = [format!("{run}.glb"), format!("{run}.poses")];
        let summary = place.succeeds(&[
            "bake",
            "scene.toml",
            "-o",
            &outputs[0],
            "-o",
            &outputs[1],
            "--threads",
            threads,
            "-q",
        ]);
        assert_eq!(summary, "");
    }
    let read = |name: &str| fs::read(place.path(name)).unwrap();
    for format in ["glb", "poses"] {
        let first = read(&format!("a.{format}"));
        assert!(first == read(&format!("b.{format}")), "{format} of two runs");
        assert!(first == read(&format!("c.{format}")), "{format} of one and two threads");
    }
}

#[test]
fn flags_come_before_the_scene_and_the_scene_before_presets() {
    let place = Place::new(
        &format!("{SCENE}\n[solver]\nslop = 0.001\n")
            .replace("name = \"drop\"", "name = \"drop\"\ntime_step = 0.01"),
    );
    let flags = ["--realtime", "--substeps", "7", "--iterations", "2", "--duration", "0.5"];
    let mut arguments = vec!["bake", "scene.toml", "-o", "a.poses", "--report", "r.json"];
    arguments.extend(flags);
    place.succeeds(&arguments);
    let report: Value = serde_json::from_slice(&fs::read(place.path("r.json")).unwrap()).unwrap();
    assert_eq!(report["steps"], 50);
    let settings = &report["settings"];
    assert_eq!((&settings["substeps"], &settings["iterations"]), (&7.into(), &2.into()));
    assert!((settings["slop"].as_f64().unwrap() - 0.001).abs() < 1e-9);
    assert!(settings["reuse_distance"].as_f64().unwrap() > 0.0, "of the preset for games");
    let summary = place.succeeds(&["bake", "scene.toml", "-o", "a.poses", "--steps", "0"]);
    assert!(summary.contains("0 steps"));
    assert_eq!(fs::metadata(place.path("a.poses")).unwrap().len(), 3 * 7 * 4);
}

#[test]
fn islands_sleep_with_the_realtime_preset_unless_turned_off() {
    // Without rolling resistance the ball rolls on.
    let resisting = SCENE.replace("radius = 0.2 }]", "radius = 0.2 }]\nrolling_resistance = 0.005");
    let place = Place::new(&resisting);
    let asleep = |flags: &[&str]| {
        let bake = ["bake", "scene.toml", "-o", "a.poses", "--report", "r.json", "--duration", "8"];
        let summary = place.succeeds(&[&bake[..], flags].concat());
        let report = fs::read(place.path("r.json")).unwrap();
        let report: Value = serde_json::from_slice(&report).unwrap();
        let last = report["per_step"].as_array().unwrap().last().unwrap();
        (last["asleep"].as_u64().unwrap(), last["contacts"].as_u64().unwrap(), summary)
    };
    let (sleepers, _, summary) = asleep(&["--realtime"]);
    assert!(sleepers > 0, "{summary}");
    assert!(summary.contains("at the end, and ha"), "{summary}");
    for flags in [&["--realtime", "--sleep", "0"][..], &[]] {
        let (sleepers, contacts, summary) = asleep(flags);
        assert!(sleepers == 0 && contacts > 0, "{flags:?}: {sleepers}, {contacts}");
        assert!(!summary.contains("sleep"), "{summary}");
    }
}

#[test]
fn fewer_frames_make_a_smaller_clip() {
    let place = Place::new(SCENE);
    place.succeeds(&["bake", "scene.toml", "-o", "all.glb", "-o", "all.poses", "-q"]);
    let fewer = ["bake", "scene.toml", "-o", "few.glb", "-o", "few.poses", "-q", "--fps", "12"];
    place.succeeds(&fewer);
    let size = |name: &str| fs::metadata(place.path(name)).unwrap().len();
    assert!(size("few.glb") < size("all.glb"));
    assert_eq!(size("few.poses"), size("all.poses"));
    for (tolerance, smaller) in [("0.01mm", false), ("0.1m", true)] {
        let keys = ["-o", "keys.glb", "--key-tolerance", tolerance, "-q"];
        place.succeeds(&[&["bake", "scene.toml"], &keys[..]].concat());
        assert_eq!(size("keys.glb") < size("all.glb"), smaller, "{tolerance}");
    }
    for wrong in ["-1mm", "nan", "1km", "2000"] {
        let wrong = format!("--key-tolerance={wrong}");
        let message = place.fails(2, &["bake", "scene.toml", "-o", "keys.glb", &wrong]);
        assert!(message.contains("accepted: a length from 0 to 1000 m"), "{message}");
    }
}

/// Returns the first and the last time of the keys of a `.glb`. \[s\]
fn ends(glb: &[u8]) -> [f64; 2] {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let document: Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    let samplers = document["animations"][0]["samplers"].as_array().unwrap();
    let inputs = samplers.iter().map(|sampler| sampler["input"].as_u64().unwrap() as usize);
    let ends: Vec<_> = inputs
        .map(|input| {
            let accessor = &document["accessors"][input];
            ["min", "max"].map(|end| accessor[end][0].as_f64().unwrap())
        })
        .collect();
    let first = ends.iter().map(|ends| ends[0]).fold(f64::INFINITY, f64::min);
    [first, ends.iter().map(|ends| ends[1]).fold(0.0, f64::max)]
}

/// Frames selected in a bake equal those selected from its arrays afterwards.
#[test]
fn selected_frames_equal_those_of_the_whole_bake() {
    let place = Place::new(SCENE);
    place.succeeds(&["bake", "scene.toml", "-o", "all.npz", "-o", "all.poses", "-q"]);
    let read = |name: &str| fs::read(place.path(name)).unwrap();
    let arrays = |name: &str| npz::read(&place.path(name)).unwrap().recording;
    let whole = arrays("all.npz");
    let outputs = ["glb", "usda", "npz", "poses"];
    for (cut, steps, codes) in [
        (&["--frames", "30..60"][..], 30..=60, [30, 60]),
        (&["--frames=6..12", "--fps", "12"], 30..=60, [6, 12]),
        // Frames between steps.
        (&["--frames", "1..3", "--fps=24"], 2..=8, [1, 3]),
        (&["--frames", "0..120", "--fps=60"], 0..=120, [0, 120]),
    ] {
        let mut bake = [&["bake", "scene.toml", "-q"], cut].concat();
        let names = outputs.map(|form| format!("some.{form}"));
        names.iter().for_each(|name| bake.extend(["-o", name]));
        place.succeeds(&bake);
        let some = arrays("some.npz");
        // The frame time is derived from a late frame, and may differ in its last bit.
        assert!((some.frame_time / whole.frame_time - 1.0).abs() < 1e-15, "{cut:?}");
        let some = Recording { frame_time: whole.frame_time, ..some };
        assert!(some == whole.piece(steps.clone()), "{cut:?}");
        let numbers = 4 * 3 * 7;
        let expected = &read("all.poses")[numbers * steps.start()..numbers * (steps.end() + 1)];
        assert!(read("some.poses") == expected, "{cut:?}");
        let stage = fs::read_to_string(place.path("some.usda")).unwrap();
        let [first, last] = codes.map(|code| code.to_string());
        assert!(stage.contains(&format!("startTimeCode = {first}\n")), "{cut:?}");
        assert!(stage.contains(&format!("endTimeCode = {last}\n")), "{cut:?}");
        let rate = if steps.start() == &2 { 24.0 } else { 60.0 / (steps.end() / codes[1]) as f64 };
        let times = ends(&read("some.glb")).map(|time| (time * rate * 1e4).round() / 1e4);
        assert_eq!(times, codes.map(|code| code as f64), "{cut:?}");
        for form in outputs {
            let (name, from) = (format!("again.{form}"), format!("some.{form}"));
            for input in ["all.npz", "all.poses"] {
                let convert = ["convert", input, &name, "--scene", "scene.toml"];
                place.succeeds(&[&convert[..], cut].concat());
                if form == "npz" {
                    assert!(arrays(&name) == arrays(&from), "{input}: {cut:?}");
                } else {
                    assert!(read(&name) == read(&from), "{input} to {form}: {cut:?}");
                }
            }
        }
        // A selection remembers its first frame.
        let rate: Vec<_> = cut.iter().filter(|word| word.contains("fps")).collect();
        if rate.is_empty() {
            place.succeeds(&["convert", "some.npz", "piece.glb", "--scene", "scene.toml"]);
            assert!(read("piece.glb") == read("some.glb"));
        }
    }
}

#[test]
fn missing_frames_are_refused_before_the_simulation() {
    let place = Place::new(&SCENE.replace("duration = 2", "duration = 10000"));
    let refused =
        |more: &[&str]| place.fails(2, &[&["bake", "scene.toml", "-o", "a.glb"], more].concat());
    let beyond = refused(&["--frames", "7..600001"]);
    assert!(
        beyond.contains("--frames is 7..600001; accepted: frames from 0 to 600000"),
        "{beyond}"
    );
    let beyond = refused(&["--frames", "7..9", "--fps", "24", "--steps", "10"]);
    assert!(beyond.contains("--frames is 7..9; accepted: frames from 0 to 4"), "{beyond}");
    for wrong in ["9..7", "7", "7..", "-1..3", "a..b", "7...9"] {
        let message = refused(&[&format!("--frames={wrong}")]);
        assert!(message.contains("accepted: two whole numbers, such as 24..96"), "{message}");
    }
    assert_eq!(place.files(), ["scene.toml"]);
}

#[test]
fn a_wrong_scene_is_refused_with_its_place() {
    let place = Place::new(&SCENE.replace("radius = 0.2", "radius = -0.2"));
    let message = place.fails(2, &["bake", "scene.toml", "-o", "out.glb"]);
    assert!(message.starts_with("drystone: scene.toml:"), "{message}");
    for part in ["radius of shape 0 of body 'ball'", "-0.2", "1e-5"] {
        assert!(message.contains(part), "{part}: {message}");
    }
    assert_eq!(message.lines().count(), 1);
    assert_eq!(place.files(), ["scene.toml"]);
}

#[test]
fn wrong_usage_is_refused_before_the_simulation() {
    // So long that a test would be noticed if it waited for the simulation.
    let place = Place::new(&SCENE.replace("duration = 2", "duration = 100000"));
    fs::copy(place.path("scene.toml"), place.path("copy.glb")).unwrap();
    let bake = |more: &[&str], code| place.fails(code, &[&["bake", "scene.toml"], more].concat());
    bake(&[], 2);
    bake(&["-o", "a.glb", "--substeps", "0"], 2);
    bake(&["-o", "a.glb", "--fps", "nan"], 2);
    bake(&["-o", "a.glb", "--duration", "1", "--steps", "1"], 2);
    bake(&["-o", "a.glb", "--wings"], 2);
    assert!(bake(&["-o", "a.fbx"], 2).contains("\".fbx\"; accepted: .glb, .npz, .poses, .usda"));
    assert!(bake(&["-o", "a.glb", "--report", "r.txt"], 2).contains(".json"));
    assert!(bake(&["-o", "a.glb", "-o", "./a.glb"], 2).contains("twice"));
    let itself = place.fails(2, &["bake", "copy.glb", "-o", "./copy.glb"]);
    assert!(itself.contains("the scene itself"), "{itself}");
    assert!(bake(&["-o", "scene.toml/a.glb"], 4).contains("scene.toml/a.glb: cannot be written"));
    assert!(bake(&["-o", "a.glb", "--report", "scene.toml/r.json"], 4).contains("scene.toml"));
    fs::create_dir(place.path("folder.glb")).unwrap();
    assert!(bake(&["-o", "folder.glb"], 4).contains("a folder is in its place"));
    assert!(place.fails(4, &["bake", "gone.toml", "-o", "a.glb"]).contains("gone.toml"));
    assert_eq!(place.files(), ["copy.glb", "folder.glb", "scene.toml"]);
}

/// Endless files and pipes without a writer are refused.
#[cfg(unix)]
#[test]
fn only_regular_files_are_read() {
    let place = Place::new(SCENE);
    let refused = |arguments: &[&str]| {
        let start = Instant::now();
        let message = place.fails(4, arguments);
        assert!(message.contains("Not a regular file"), "{message}");
        assert_eq!(message.lines().count(), 1, "{message}");
        // An endless file would hang.
        assert!(start.elapsed() < Duration::from_secs(50), "{:?}: {arguments:?}", start.elapsed());
    };
    for form in ["toml", "json", "gltf", "glb", "usda", "npz", "poses", "journal"] {
        let (endless, pipe) = (format!("endless.{form}"), format!("pipe.{form}"));
        std::os::unix::fs::symlink("/dev/zero", place.path(&endless)).unwrap();
        let made = Command::new("mkfifo").arg(place.path(&pipe)).status();
        assert!(made.is_ok_and(|status| status.success()), "mkfifo");
        for name in [&endless, &pipe] {
            if form == "npz" || form == "poses" || form == "journal" {
                refused(&["verify", name, name]);
                refused(&["convert", name, "out.npz", "--scene", "scene.toml"]);
            } else {
                refused(&["check", name]);
            }
        }
    }
    refused(&["solve", "endless.json"]);
}

#[test]
fn divergence_names_step_and_body() {
    let runaway = "position = [0.1, 1.2, 0]\nlinear_velocity = [1e6, 1e6, 0]";
    let place = Place::new(&SCENE.replace("position = [0.1, 1.2, 0]", runaway));
    let message = place.fails(3, &["bake", "scene.toml", "-o", "out.glb"]);
    assert!(message.contains("step 1 ") && message.contains("'ball'"), "{message}");
    assert_eq!(place.files(), ["scene.toml"]);
}

#[test]
fn warnings_are_printed_once_and_stop_nothing() {
    let place = Place::new(&SCENE.replace("motion = \"static\"", "motion = \"static\"\nmass = 1"));
    let output = place.run(&["bake", "scene.toml", "-o", "out.poses"]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(message.matches("warning: scene.toml").count(), 1, "{message}");
}

#[test]
fn help_names_existing_scenes() {
    let help = Place::new("").succeeds(&["bake", "--help"]);
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let scenes: Vec<_> =
        help.split_whitespace().filter(|word| word.starts_with("scenes/")).collect();
    assert!(scenes.len() > 2, "{help}");
    for scene in scenes {
        assert!(root.join(scene).is_file(), "{scene}");
    }
}

#[test]
fn the_schema_is_json() {
    let text = Place::new("").succeeds(&["schema"]);
    let schema: Value = serde_json::from_str(&text).unwrap();
    assert!(schema["$defs"]["Body"].is_object());
}

#[test]
fn a_gltf_comes_back_with_a_clip() {
    let place = Place::new("");
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/workshop.gltf");
    let scene = scene.to_str().unwrap();
    place.succeeds(&["bake", scene, "-o", "out.glb", "--steps", "30", "--fps", "24"]);
    let glb = fs::read(place.path("out.glb")).unwrap();
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let document: Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    let clips = document["animations"].as_array().unwrap();
    assert_eq!(clips[0]["name"], "Drystone");
    assert!(document["extensions"]["KHR_physics_rigid_bodies"].is_object());
}

/// A ball on a rope that breaks, below one that holds, and a hinge with a motor.
const JOINTED: &str = r#"
duration = 0.5

[[bodies]]
name = "held"
mass = 1
shapes = [{ type = "sphere", radius = 0.1 }]

[[bodies]]
name = "lost"
mass = 2
position = [0, -1, 0]
shapes = [{ type = "sphere", radius = 0.1 }]

[[bodies]]
name = "fan"
position = [3, 0, 0]
shapes = [{ type = "box", half_extents = [0.5, 0.1, 0.1] }]

[[joints]]
type = "ball"
name = "hook"
bodies = ["held"]

[[joints]]
type = "distance"
name = "thread"
bodies = ["lost", "held"]
breaking = { force = 15 }

[[joints]]
type = "hinge"
name = "axle"
bodies = ["fan"]
axis = [0, 0, 1]
motor = { velocity = 3, at_most = 1e5 }
"#;

/// The summary, the report, the arrays and the stage say how joints moved, and which broke when by
/// which force. A bake that is resumed says the same.
#[test]
fn joints_are_reported_and_recorded() {
    let place = Place::new(JOINTED);
    let outputs =
        ["bake", "scene.toml", "-o", "a.npz", "-o", "a.usda", "--report", "a.json", "--threads=1"];
    let text = place.succeeds(&outputs);
    let line = |title: &str| text.lines().find(|line| line.starts_with(title)).unwrap();
    let said = line("joints");
    assert!(said.contains("3 joints, off their locks and limits by at most 0.0"), "{said}");
    assert!(said.ends_with("; 1 broke, see the notes"), "{said}");
    assert!(text.contains("broke: 'thread' at 0.017 s by 19.6 N and 0.00 N m"), "{text}");
    let report: Value = serde_json::from_slice(&fs::read(place.path("a.json")).unwrap()).unwrap();
    let broken = &report["summary"]["joints"]["broken"];
    assert_eq!(broken.as_array().unwrap().len(), 1, "{broken}");
    assert_eq!((&broken[0]["name"], &broken[0]["step"]), (&"thread".into(), &1.into()));
    assert!((broken[0]["force"].as_f64().unwrap() / (2.0 * 9.81) - 1.0).abs() < 1e-3, "{broken}");
    let first = &report["per_step"][0];
    assert_eq!(first["broken"], serde_json::json!([1]), "{first}");
    assert!(first["joint_gap"][0].as_f64().unwrap() < 1e-4, "{first}");
    assert!(report["per_step"][1].get("broken").is_none());

    let joints = npz::read(&place.path("a.npz")).unwrap().joints;
    assert_eq!(joints.layout.names, ["hook", "thread", "axle"]);
    assert_eq!(joints.broken, [None, Some(1), None]);
    let names: Vec<_> = joints.layout.axes.iter().map(|axis| &axis.coordinate[..]).collect();
    assert_eq!(names, ["x", "y", "z", "distance", "x", "y", "z", "twist", "swing_y", "swing_z"]);
    let turn = |frame: usize| joints.values[frame * names.len() + 7];
    assert_eq!(turn(0), 0.0);
    assert!((turn(30) - 1.5).abs() < 0.06, "{}", turn(30));
    let force = |frame: usize, joint: usize| joints.loads[2 * (3 * frame + joint)];
    // Locks creep by their compliance: 3 kg at 0.086 mm/s, which a step of 1/60 s has not borne.
    let borne = 3.0 * (9.81 - 0.086e-3 * 60.0);
    assert!((force(1, 0) - borne).abs() < 0.01, "{}", force(1, 0));
    assert!((force(20, 0) - 9.81).abs() < 0.01 && force(20, 1) == 0.0);

    let stage = fs::read_to_string(place.path("a.usda")).unwrap();
    let sampled = "bool physics:jointEnabled.timeSamples = { 0: 1, 1: 0, }";
    assert_eq!(stage.matches("jointEnabled").count(), 1, "{stage}");
    assert!(stage.contains(sampled), "{stage}");
    // From frame 2 on the thread is broken all the time.
    let convert = ["convert", "a.npz", "b.usda", "--scene", "scene.toml", "--frames", "2..9"];
    place.succeeds(&convert);
    let stage = fs::read_to_string(place.path("b.usda")).unwrap();
    assert!(stage.contains("bool physics:jointEnabled.timeSamples = { 2: 0, }"), "{stage}");
    place.succeeds(&["convert", "a.npz", "b.npz", "--frames", "2..9"]);
    let piece = npz::read(&place.path("b.npz")).unwrap().joints;
    assert_eq!(piece, joints.piece(2..=9, 0));
}

/// Arrays of scenes without joints have no joints, and neither has their summary.
#[test]
fn scenes_without_joints_say_nothing_of_them() {
    let place = Place::new(SCENE);
    let text = place.succeeds(&["bake", "scene.toml", "-o", "a.npz", "--report", "a.json"]);
    assert!(!text.lines().any(|line| line.starts_with("joints")), "{text}");
    assert!(npz::read(&place.path("a.npz")).unwrap().joints.layout.is_empty());
    let report = fs::read_to_string(place.path("a.json")).unwrap();
    assert!(!report.contains("joint_gap"), "{report}");
}

/// With --progress a bake prints lines to standard error, where that is no terminal, and also if it
/// is quiet: the first and the last at least.
#[test]
fn progress_is_printed_as_lines() {
    let place = Place::new(SCENE);
    let run = |more: &[&str]| {
        let arguments = [&["bake", "scene.toml", "-o", "out.poses"], more].concat();
        let output = place.run(&arguments);
        assert!(output.status.success(), "{more:?}");
        String::from_utf8(output.stderr).unwrap()
    };
    for quiet in [&["--progress"][..], &["--progress", "--quiet"]] {
        let text = run(quiet);
        let lines: Vec<&str> = text.lines().filter(|line| line.starts_with("frame ")).collect();
        assert_eq!(lines.first(), Some(&"frame 0 of 120 (0 %)"), "{text}");
        assert_eq!(lines.last(), Some(&"frame 120 of 120 (100 %)"), "{text}");
        let between = lines[1..lines.len() - 1].iter();
        assert!(between.clone().all(|line| line.ends_with(" s left")), "{text}");
    }
    assert_eq!(run(&[]), "");
}

/// A body that a track throws brings energy, which is not said to be created: without a ledger
/// nothing is said, and with one the contacts have created none.
#[test]
fn energy_of_tracks_is_not_created() {
    let thrown = "[[bodies]]\nname = 'thrown'\nposition = [-1, 0.4, 0]\nshapes = [{ type = \
        'sphere', radius = 0.2 }]\ntrack = [{ time = 0.0, position = [-1, 0.4, 0] }, { time = 0.2, \
        position = [-0.2, 0.6, 0] }]\n";
    let place = Place::new(&format!("{SCENE}\n{thrown}"));
    let summary = place.succeeds(&["bake", "scene.toml", "-o", "out.poses"]);
    assert!(summary.contains("; bodies on tracks may add to it"), "{summary}");
    assert!(!summary.contains("energy was created"), "{summary}");
    let ledger = ["bake", "scene.toml", "--report", "r.json", "--ledger"];
    let summary = place.succeeds(&ledger);
    assert!(summary.contains("none was created"), "{summary}");
    let report: Value = serde_json::from_slice(&fs::read(place.path("r.json")).unwrap()).unwrap();
    let summary = &report["summary"];
    let items = &summary["ledger"]["items"];
    let of = |name: &str| items[name].as_f64().unwrap();
    // 1/2 m v^2 = 285 J at 4.1 m/s, without m g h of 66 J and what others gain.
    assert!(of("driven") > 300.0, "{items}");
    let change = of("kinetic") + of("potential");
    let energy = |name: &str| summary[name].as_f64().unwrap();
    let measured = energy("energy_end") - energy("energy_start");
    assert!((change - measured).abs() < 1e-2, "{change} J, {measured} J");
}
