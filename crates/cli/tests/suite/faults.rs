//! Tests with a failing disk: each call that changes a file fails once. Earlier bakes stay, the
//! message is clear, and the bake can be resumed when there is room again.
#![cfg(target_os = "linux")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use crate::common::{Place, SCENE};

/// Builds the library that makes calls fail; `None` without a C compiler.
fn library() -> Option<&'static Path> {
    static LIBRARY: OnceLock<Option<PathBuf>> = OnceLock::new();
    let build = || {
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/suite/faults.c");
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("faults.so");
        let mut compiler = Command::new("cc");
        compiler.args(["-shared", "-fPIC", "-O1", "-o"]).arg(&path).arg(source);
        let built = compiler.status().is_ok_and(|status| status.success());
        if !built {
            println!("SKIPPED: a disk that fails needs a C compiler");
        }
        built.then_some(path)
    };
    LIBRARY.get_or_init(build).as_deref()
}

/// Runs `drystone` with call number `at` failing, counting all calls or those of one name. Also
/// returns whether a call failed.
pub(crate) fn failing(
    place: &Place,
    arguments: &[&str],
    call: Option<&str>,
    at: usize,
) -> Option<(Output, bool)> {
    let mark = place.path("failed");
    let mut command = place.command(arguments);
    command.env("LD_PRELOAD", library()?).env("FAILED", &mark).env("FAIL_AT", at.to_string());
    if let Some(call) = call {
        command.env("FAIL_CALL", call);
    }
    let output = command.output().unwrap();
    Some((output, fs::remove_file(mark).is_ok()))
}

const BAKE: [&str; 12] = [
    "bake",
    "scene.toml",
    "-o",
    "out.glb",
    "-o",
    "out.npz",
    "--report",
    "r.json",
    "--steps",
    "4",
    "--checkpoint",
    "0",
];
const OUTPUTS: [&str; 2] = ["out.glb", "out.npz"];

#[test]
fn a_failed_call_keeps_the_last_bake_and_can_be_resumed() {
    let place = Place::new(SCENE);
    place.succeeds(&BAKE);
    let expected = OUTPUTS.map(|name| fs::read(place.path(name)).unwrap());
    let mut failures = 0;
    for at in 1.. {
        for name in OUTPUTS.iter().chain(&["r.json"]) {
            fs::write(place.path(name), "before").unwrap();
        }
        let Some((output, failed)) = failing(&place, &BAKE, None, at) else { return };
        let message = String::from_utf8(output.stderr).unwrap();
        for (name, whole) in OUTPUTS.iter().zip(&expected) {
            let found = fs::read(place.path(name)).unwrap();
            let done = output.status.success();
            assert!(found == *whole || !done && found == b"before", "call {at}: {name}: {message}");
        }
        if !failed {
            assert!(output.status.success(), "{message}");
            break;
        }
        failures += 1;
        if output.status.success() {
            // The folder could not be synced, or the journal not deleted.
            let _ = fs::remove_file(place.path("out.glb.journal"));
            continue;
        }
        assert_eq!(output.status.code(), Some(4), "call {at}: {message}");
        assert!(message.contains("cannot be written: "), "call {at}: {message}");
        assert_eq!(message.lines().count(), 1, "call {at}: {message}");
        let again = place.run(&[&BAKE[..], &["--resume"]].concat());
        assert!(again.status.success(), "call {at}: {again:?}");
        for (name, whole) in OUTPUTS.iter().zip(&expected) {
            assert!(fs::read(place.path(name)).unwrap() == *whole, "call {at}: {name} is resumed");
        }
    }
    println!("{failures} calls failed, one after the other");
    assert!(failures > 25, "{failures}");
}

/// The message names the full file, and the command that resumes the bake.
#[test]
fn a_full_disk_is_reported_with_the_command_to_resume() {
    let place = Place::new(SCENE);
    let Some((output, failed)) = failing(&place, &BAKE, Some("write"), 4) else { return };
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(failed && output.status.code() == Some(4), "{message}");
    let said = "drystone: out.glb.journal: cannot be written: No space left on device";
    assert!(message.starts_with(said), "{message}");
    assert!(message.contains("resume with: drystone bake scene.toml -o out.glb"), "{message}");
    assert!(message.trim_end().ends_with("--resume"), "{message}");
}
