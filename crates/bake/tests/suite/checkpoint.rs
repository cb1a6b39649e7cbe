//! Tests that a world restored from a checkpoint repeats the steps of the original bit by bit.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use drystone::{CheckpointError, StepReport, StepSettings};
use drystone_bake::{AnyCheckpoint, AnyWorld, build};
use drystone_scene::Scene;

fn scenes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes")
}

fn read(name: &str) -> Scene {
    drystone_bake::read(&scenes().join(name)).unwrap().scene
}

fn start(scene: &Scene, preset: &StepSettings) -> AnyWorld {
    build(scene, drystone_bake::settings(scene, preset.clone()).unwrap()).unwrap()
}

fn restore(world: &mut AnyWorld, state: &[u8]) -> Result<(), CheckpointError> {
    world.restore(&AnyCheckpoint::from_bytes(state)?)
}

/// Returns the report of a step without its times.
fn timeless(mut report: StepReport) -> StepReport {
    report.stages = Default::default();
    if let Some(certified) = &mut report.certified {
        certified.certifying = Duration::ZERO;
    }
    report
}

/// Takes steps, and returns the hash, the report and the checkpoint after each.
fn steps(world: &mut AnyWorld, scene: &Scene, count: usize) -> Vec<(u64, StepReport, Vec<u8>)> {
    let one = |_| {
        let report = timeless(world.step(scene.time_step).unwrap());
        (world.state_hash(), report, world.checkpoint().to_bytes())
    };
    (0..count).map(one).collect()
}

/// Steps after which a checkpoint is taken.
const LEFT_AFTER: [usize; 5] = [0, 13, 30, 60, 150];
/// Steps compared after each checkpoint.
const FOLLOWED: usize = 12;

fn goes_on(name: &str, preset: &StepSettings) {
    let scene = read(name);
    let mut world = start(&scene, preset);
    let mut taken = 0;
    for left in LEFT_AFTER {
        steps(&mut world, &scene, left - taken);
        let checkpoint = world.checkpoint().to_bytes();
        let expected = steps(&mut world, &scene, FOLLOWED);
        let mut other = start(&scene, preset);
        // The other world runs on one or two threads and has taken other steps before.
        other.set_threads(left % 2 + 1);
        steps(&mut other, &scene, 3 * left % 40);
        restore(&mut other, &checkpoint).unwrap();
        assert!(
            other.checkpoint().to_bytes() == checkpoint,
            "{name} after {left} steps: the state itself"
        );
        let actual = steps(&mut other, &scene, FOLLOWED);
        for (step, (a, b)) in expected.iter().zip(&actual).enumerate() {
            assert!(a == b, "{name} after {left} steps: step {} is another", step + 1);
        }
        taken = left + FOLLOWED;
    }
}

/// Certified worlds repeat 12 steps after each checkpoint, with the same bits and reports, on one
/// and two threads.
#[test]
fn a_restored_certified_world_moves_with_the_same_bits() {
    for name in ["arch.json", "billiards.toml", "wall_2d.json", "workshop.gltf"] {
        goes_on(name, &StepSettings::certified());
    }
    let ledger = StepSettings { ledger: true, ..StepSettings::certified() };
    goes_on("card_house.toml", &ledger);
    for name in ["ragdoll.toml", "crane.json"] {
        goes_on(name, &StepSettings::certified());
    }
}

/// Worlds of the real-time and quality presets repeat 12 steps after each checkpoint, with the same
/// bits and reports, on one and two threads.
#[test]
fn a_restored_world_of_fixed_work_moves_with_the_same_bits() {
    for name in [
        "dominoes.json",
        "wall_2d.json",
        "particles.json",
        "stones.json",
        "glued_wall.json",
        "car.toml",
    ] {
        goes_on(name, &StepSettings { certify: true, ..StepSettings::realtime() });
    }
    goes_on("arch.json", &StepSettings::quality());
}

/// The first step of a fresh world that is restored, after every other step of every scene, is that
/// of the world which took all steps: no stage reads what an earlier step left in its memory.
#[test]
fn every_scene_goes_on_from_every_step() {
    for entry in fs::read_dir(scenes()).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let is_scene = [".json", ".toml", ".gltf"].iter().any(|ending| name.ends_with(ending));
        // Large piles take too long here.
        if !is_scene || ["stones.json", "tower.json"].contains(&name.as_str()) {
            continue;
        }
        let scene = read(&name);
        for preset in [StepSettings::realtime(), StepSettings::certified()] {
            let mut world = start(&scene, &preset);
            world.set_threads(1);
            for left in (2..60).step_by(2) {
                steps(&mut world, &scene, 1);
                let checkpoint = world.checkpoint().to_bytes();
                let expected = steps(&mut world, &scene, 1);
                let mut other = start(&scene, &preset);
                other.set_threads(1);
                restore(&mut other, &checkpoint).unwrap();
                let is_same = steps(&mut other, &scene, 1) == expected;
                assert!(is_same, "{name} after {} steps, {preset:?}", left - 1);
            }
        }
    }
}

/// A scene at rest, restored to an earlier checkpoint, repeats 100 steps bit by bit. Contacts of
/// the later state, which are still in the lanes, are not reused.
#[test]
fn a_restored_world_at_rest_keeps_the_same_bits() {
    let realtime = StepSettings { sleep_delay: 0.0, ..StepSettings::realtime() };
    for preset in [realtime, StepSettings::certified()] {
        let scene = read("arch.json");
        let mut world = start(&scene, &preset);
        steps(&mut world, &scene, 200);
        let checkpoint = world.checkpoint().to_bytes();
        let expected = steps(&mut world, &scene, 100);
        // This state is at rest, too, but differs a little.
        restore(&mut world, &checkpoint).unwrap();
        let actual = steps(&mut world, &scene, 100);
        let other = expected.iter().zip(&actual).position(|(a, b)| a != b);
        assert_eq!(other, None, "a step that is another");
        assert_ne!(expected[0].0, expected[99].0, "nothing moves at all");
    }
}

/// Checkpoints of another world, empty and truncated ones are refused, and the world stays as it
/// was.
#[test]
fn a_checkpoint_of_another_world_is_refused() {
    let (arch, wall) = (read("arch.json"), read("wall_2d.json"));
    let preset = StepSettings::realtime();
    let (mut one, mut other) = (start(&arch, &preset), start(&wall, &preset));
    steps(&mut one, &arch, 3);
    steps(&mut other, &wall, 3);
    let before = one.checkpoint().to_bytes();
    let error = restore(&mut one, &other.checkpoint().to_bytes()).unwrap_err();
    assert!(error.to_string().contains("of another world: poses need"), "{error}");
    assert!(restore(&mut one, &[]).unwrap_err().to_string().contains("is not a checkpoint"));
    for cut in (0..before.len()).step_by(97) {
        assert!(restore(&mut one, &before[..cut]).is_err(), "{cut} bytes");
    }
    assert_eq!(one.checkpoint().to_bytes(), before, "a world that refused is as it was");
}

/// A checkpoint with a damaged byte is refused or restored without a panic. A restored world can
/// take a step.
#[test]
fn a_damaged_checkpoint_makes_no_panic() {
    let scene = read("arch.json");
    let mut world = start(&scene, &StepSettings::realtime());
    steps(&mut world, &scene, 3);
    let whole = world.checkpoint().to_bytes();
    for place in (0..whole.len()).step_by(61) {
        let mut damaged = whole.clone();
        damaged[place] ^= 0x85;
        let mut other = start(&scene, &StepSettings::realtime());
        if restore(&mut other, &damaged).is_ok() {
            other.step(scene.time_step).unwrap();
        }
    }
}
