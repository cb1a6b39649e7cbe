//! Tests of bakes that are ended early and resumed.

use std::fs;
use std::time::{Duration, Instant};

use crate::common::{Place, SCENE, example};
use serde_json::Value;

/// Returns the journal with all steps before any output is written, and the outputs.
#[cfg(target_os = "linux")]
fn journal_and_outputs(
    place: &Place,
    scene: &str,
    more: &[&str],
) -> Option<(Vec<u8>, Vec<Vec<u8>>)> {
    let bake = bake(scene, more);
    let (_, failed) = crate::faults::failing(place, &bake, Some("rename"), 1)?;
    assert!(failed);
    let journal = fs::read(place.path("out.glb.journal")).unwrap();
    fs::remove_file(place.path("out.glb.journal")).unwrap();
    place.succeeds(&bake);
    assert!(!place.path("out.glb.journal").exists());
    Some((journal, outputs(place)))
}

/// Outputs in the order of their names.
const OUTPUTS: [&str; 6] = ["dust.npz", "dust.usda", "out.glb", "out.npz", "out.poses", "out.usda"];

fn bake<'a>(scene: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let flag = |name: &str| if name.starts_with("dust") { "--contacts" } else { "-o" };
    let outputs = OUTPUTS.into_iter().flat_map(|name| [flag(name), name]);
    ["bake", scene, "--steps", "40", "-q"]
        .into_iter()
        .chain(outputs)
        .chain(more.iter().copied())
        .collect()
}

fn outputs(place: &Place) -> Vec<Vec<u8>> {
    let take = |name| {
        let bytes = fs::read(place.path(name)).unwrap();
        fs::remove_file(place.path(name)).unwrap();
        bytes
    };
    OUTPUTS.into_iter().map(take).collect()
}

/// A journal may end in the middle of a record or between two: the resumed bake writes the same
/// files as an uninterrupted one.
#[cfg(target_os = "linux")]
#[test]
fn a_resumed_bake_gives_the_same_bytes() {
    for (scene, more) in [
        ("arch.json", &["--checkpoint", "0"][..]),
        ("wall_2d.json", &["--checkpoint", "0", "--realtime"]),
        ("particles.json", &["--checkpoint", "0", "--threads", "2"]),
        ("billiards.toml", &["--checkpoint", "0.001", "--ledger"]),
        ("workshop.gltf", &["--realtime"]),
        ("watt_linkage.toml", &["--checkpoint", "0"]),
    ] {
        let (place, scene) = (Place::new(""), example(scene));
        let Some((journal, expected)) = journal_and_outputs(&place, &scene, more) else { return };
        for part in [0, 10, 320, 500, 750, 999, 1000] {
            let cut = journal.len() * part / 1000;
            fs::write(place.path("out.glb.journal"), &journal[..cut]).unwrap();
            place.succeeds(&[&bake(&scene, more)[..], &["--resume"]].concat());
            assert_eq!(place.files(), [&OUTPUTS[..], &["scene.toml"]].concat(), "{scene}");
            assert!(outputs(&place) == expected, "{scene}, {part} thousandths");
        }
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_journal_of_another_bake_is_refused() {
    let place = Place::new(SCENE);
    let Some((journal, expected)) = journal_and_outputs(&place, "scene.toml", &[]) else { return };
    let path = place.path("out.glb.journal");
    fs::write(&path, &journal).unwrap();
    let asked = |code, scene, more: &[&str]| place.fails(code, &bake(scene, more));
    let message = asked(2, "scene.toml", &[]);
    assert!(
        message.contains("has 40 steps of this bake already; resume it with --resume"),
        "{message}"
    );
    let message = asked(2, "scene.toml", &["--resume", "--substeps", "9"]);
    assert!(message.contains("substeps 8, not 9"), "{message}");
    fs::write(place.path("other.toml"), SCENE.replace("1.2", "1.3")).unwrap();
    let message = asked(2, "other.toml", &["--resume"]);
    assert!(message.contains("of another scene, or of an earlier version"), "{message}");
    assert_eq!(fs::read(&path).unwrap(), journal, "nothing was done to it");

    // The journal of another scene is replaced if resuming is not requested.
    place.succeeds(&bake("other.toml", &[]));
    assert!(!path.exists() && outputs(&place) != expected);

    // A bake of fewer steps uses the journal and leaves it unchanged.
    fs::write(&path, &journal).unwrap();
    place.succeeds(&["bake", "scene.toml", "-o", "out.glb", "--steps", "7", "--resume"]);
    assert_eq!(fs::read(&path).unwrap(), journal);

    // A bake of more steps continues it.
    place.succeeds(&[
        "bake",
        "scene.toml",
        "-o",
        "out.glb",
        "-o",
        "a.poses",
        "--steps",
        "50",
        "--resume",
    ]);
    place.succeeds(&["bake", "scene.toml", "-o", "b.poses", "--steps", "50"]);
    assert_eq!(fs::read(place.path("a.poses")).unwrap(), fs::read(place.path("b.poses")).unwrap());

    fs::write(&path, "Dear diary").unwrap();
    for more in [&[][..], &["--resume"]] {
        assert!(asked(2, "scene.toml", more).contains("not a journal"));
    }
    assert_eq!(fs::read(&path).unwrap(), b"Dear diary");
}

/// A journal of a build or machine that computes other bits is noticed by the steps after the
/// checkpoint.
#[cfg(target_os = "linux")]
#[test]
fn different_bits_are_detected() {
    let place = Place::new(SCENE);
    let Some((journal, _)) = journal_and_outputs(&place, "scene.toml", &[]) else { return };
    let other = SCENE.replace("1.2", "1.3");
    fs::write(place.path("scene.toml"), &other).unwrap();
    let Some((mixed, _)) = journal_and_outputs(&place, "scene.toml", &[]) else { return };
    // The header of one journal and the frames of the other; both headers are equally long.
    let head =
        |bytes: &[u8]| 19 + 9 + u64::from_le_bytes(bytes[20..28].try_into().unwrap()) as usize + 8;
    assert_eq!(head(&journal), head(&mixed));
    let cut = mixed.len() / 2;
    let spliced = [&mixed[..head(&mixed)], &journal[head(&journal)..cut]].concat();
    fs::write(place.path("out.glb.journal"), spliced).unwrap();
    let message = place.fails(2, &bake("scene.toml", &["--resume"]));
    assert!(message.contains("step 1 differs from the journal"), "{message}");
}

/// The contact problem of a step in the journal is that of an uninterrupted bake.
#[cfg(target_os = "linux")]
#[test]
fn a_step_before_the_end_is_saved_too() {
    let place = Place::new(SCENE);
    let more = ["--checkpoint", "0"];
    let Some((journal, _)) = journal_and_outputs(&place, "scene.toml", &more) else { return };
    place.succeeds(&bake("scene.toml", &["--dump-step", "31", "--dump", "a.json"]));
    fs::write(place.path("out.glb.journal"), journal).unwrap();
    place.succeeds(&bake("scene.toml", &["--dump-step", "31", "--dump", "b.json", "--resume"]));
    assert!(fs::read(place.path("a.json")).unwrap() == fs::read(place.path("b.json")).unwrap());
}

#[cfg(unix)]
#[test]
fn an_interrupted_bake_prints_the_command_to_resume() {
    use std::process::{Command, Stdio};
    use std::thread::sleep;

    let place = Place::new(SCENE);
    let arguments = ["bake", "scene.toml", "-o", "it's.glb", "--report", "r.json", "--duration"];
    let long = [&arguments[..], &["10000"]].concat();
    let mut command = place.command(&long);
    let child = command.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    // Until it has taken steps, and at most a minute.
    let start = Instant::now();
    let size = || fs::metadata(place.path("it's.glb.journal")).map_or(0, |of| of.len());
    while size() < 100_000 && start.elapsed() < Duration::from_secs(60) {
        sleep(Duration::from_millis(10));
    }
    let id = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(130), "{message}");
    assert!(message.starts_with("drystone: interrupted after step "), "{message}");
    let way_on =
        r"drystone bake scene.toml -o 'it'\''s.glb' --report r.json --duration 10000 --resume";
    assert!(message.contains(way_on), "{message}");
    assert_eq!(place.files(), ["it's.glb.journal", "scene.toml"]);

    // All steps that were taken are in the journal, and are not repeated.
    let number = |after: &str| -> u32 {
        let rest = &message[message.find(after).unwrap() + after.len()..];
        rest.split(' ').next().unwrap().parse().unwrap()
    };
    let taken = number("after step ");
    let steps = taken.to_string();
    let on = [&arguments[..6], &["--resume", "--steps", &steps]].concat();
    place.succeeds(&on);
    let report: Value = serde_json::from_slice(&fs::read(place.path("r.json")).unwrap()).unwrap();
    assert_eq!(report["per_step"].as_array().unwrap().len(), taken as usize);
    assert_eq!(place.files(), ["it's.glb", "r.json", "scene.toml"]);
}

/// Kills bakes at random moments and resumes them; DRYSTONE_KILLS is the number of kills.
#[test]
fn killed_bakes_end_with_the_same_bytes() {
    let kills = std::env::var("DRYSTONE_KILLS").map_or(12, |kills| kills.parse().unwrap());
    let place = Place::new(SCENE);
    let whole =
        ["bake", "scene.toml", "-q", "--steps", "600", "-o", "whole.glb", "-o", "whole.npz"];
    let start = Instant::now();
    place.succeeds(&whole);
    let time = start.elapsed();
    let read = |name: &str| fs::read(place.path(name)).unwrap();
    let expected = [read("whole.glb"), read("whole.npz")];
    let bake = ["bake", "scene.toml", "-q", "--steps", "600", "-o", "out.glb", "-o", "out.npz"];
    let bake = [&bake[..], &["--resume", "--checkpoint", "0.01"]].concat();
    let (mut killed, mut ended) = (0, 0);
    let mut random = 1u64;
    while killed < kills || ended == 0 {
        random =
            random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let part = (random >> 40) as f64 / (1u64 << 24) as f64;
        let mut child = place.command(&bake).spawn().unwrap();
        std::thread::sleep(time.mul_f64(0.6 * part));
        let _ = child.kill();
        if child.wait().unwrap().success() {
            ended += 1;
            assert!([read("out.glb"), read("out.npz")] == expected, "after {killed} kills");
            fs::remove_file(place.path("out.glb")).unwrap();
            fs::remove_file(place.path("out.npz")).unwrap();
        } else {
            killed += 1;
        }
        if killed >= kills && ended == 0 {
            place.succeeds(&bake);
            ended += 1;
            assert!([read("out.glb"), read("out.npz")] == expected, "after {killed} kills");
        }
    }
    println!("killed {killed} times, {ended} bakes ended, each of {:.2} s", time.as_secs_f64());
}
