//! Scenes whose speed and gravity change: by formula, as a scene in slow motion, and from a checkpoint.

use std::path::Path;

use drystone::StepSettings;
use drystone_bake::{AnyWorld, build, read_json};
use drystone_scene::Scene;
use serde_json::{Value, json};

/// Length of a time step. \[s\]
const DT: f64 = 1.0 / 64.0;

fn scene(more: &Value) -> Scene {
    let mut document = json!({ "time_step": DT });
    let own = document.as_object_mut().unwrap();
    own.extend(more.as_object().unwrap().clone());
    read_json(Path::new("track.json"), &document.to_string()).unwrap().scene
}

fn start(scene: &Scene) -> AnyWorld {
    build(scene, StepSettings::certified()).unwrap()
}

fn ball(x: f64) -> Value {
    json!({ "position": [x, 5, 0], "shapes": [{ "type": "sphere", "radius": 0.1 }] })
}

fn place(world: &AnyWorld, body: usize) -> Vec<f32> {
    world.pose(world.body_at(body).unwrap()).unwrap()
}

/// A ball falls in slow motion that sets in, stops it and ends, and flies up at last. It moves through the
/// time that the steps simulate, and stands still where they simulate none.
#[test]
fn a_ball_falls_at_the_speed_of_its_world() {
    let scene = scene(&json!({
        "bodies": [ball(0.0)],
        "track": [{ "time": 0, "speed": 1 }, { "time": 0.5, "speed": 0 }, { "time": 0.75, "speed": 0 },
                  { "time": 1, "speed": 2 }, { "time": 1.25, "speed": 2, "gravity": [0, 20, 0] }],
    }));
    let mut world = start(&scene);
    let (mut time, mut speed, mut height) = (0.0, 0.0, 5.0);
    for step in 0..128 {
        let (dt, gravity) = scene.terms_of(step);
        height += dt * speed + 0.5 * gravity[1] * dt * dt;
        (time, speed) = (time + dt, speed + gravity[1] * dt);
        let before = place(&world, 0);
        world.step_scene(&scene, step).unwrap();
        let found = place(&world, 0);
        assert!(
            (f64::from(found[1]) - height).abs() < 2e-4,
            "step {step}: {} is {height}",
            found[1]
        );
        let stands = (32..=48).contains(&(step + 1));
        assert_eq!(before == found, stands, "step {step}");
        let clock = (step + 1) as f64 * DT;
        assert!((world.time() - clock).abs() < 1e-12, "{}", world.time());
    }
    // The mean speed of half a second to 0, of a quarter to 2, and of the rest.
    assert!((scene.simulated(128) - time).abs() < 1e-12 && (time - 2.5).abs() < 0.02, "{time}");
    assert!(speed > 10.0, "{speed} m/s");
}

/// Half of the speed is the same, to the last bit, as steps of half the length, also on a lift whose track
/// takes twice the time.
#[test]
fn half_of_the_speed_is_half_of_the_step() {
    let lift = |slow: f64| {
        json!({ "motion": "kinematic", "shapes": [{ "type": "box", "half_extents": [1, 0.25, 1] }],
                "position": [0, 4, 0],
                "track": [{ "time": 0, "position": [0, 4, 0] }, { "time": slow, "position": [0.5, 5, 0] }] })
    };
    let one =
        scene(&json!({ "bodies": [ball(0.0), lift(2.0)], "track": [{ "time": 0, "speed": 0.5 }] }));
    let other = scene(&json!({ "bodies": [ball(0.0), lift(1.0)], "time_step": 0.5 * DT }));
    let (mut slow, mut plain) = (start(&one), start(&other));
    for step in 0..200 {
        slow.step_scene(&one, step).unwrap();
        plain.step_scene(&other, step).unwrap();
        assert_eq!(slow.state_hash(), plain.state_hash(), "step {step}");
    }
    assert!(place(&slow, 0)[1] > 5.0, "the lift carries the ball");
}

/// Sleepers wake when gravity changes; a world that is restored takes the same steps.
#[test]
fn gravity_that_turns_lifts_what_rests() {
    let scene = scene(&json!({
        "solver": { "sleep_delay": 0.25 },
        "bodies": [ball(0.0), { "motion": "static", "position": [0, 4.8, 0],
                                "shapes": [{ "type": "box", "half_extents": [1, 0.1, 1] }] }],
        "track": [{ "time": 1.5 }, { "time": 1.515625, "gravity": [0, 3, 0] }],
    }));
    let settings = drystone_bake::settings(&scene, StepSettings::certified()).unwrap();
    let mut world = build(&scene, settings.clone()).unwrap();
    let mut checkpoint = None;
    for step in 0..128 {
        if step == 80 {
            assert!(world.is_sleeping(world.body_at(0).unwrap()), "it rests");
            checkpoint = Some(world.checkpoint());
        }
        world.step_scene(&scene, step).unwrap();
    }
    assert!(place(&world, 0)[1] > 5.2, "{:?}", place(&world, 0));
    let mut other = build(&scene, settings).unwrap();
    other.restore(&checkpoint.unwrap()).unwrap();
    (80..128).for_each(|step| _ = other.step_scene(&scene, step).unwrap());
    assert_eq!(world.state_hash(), other.state_hash());
}

/// Keys out of order, speeds out of range and numbers of another dimension are refused by their place.
#[test]
fn bad_keys_of_a_world_are_refused() {
    let refused = |track: Value| {
        let text = json!({ "bodies": [], "time_step": 0.1, "track": track }).to_string();
        read_json(Path::new("track.json"), &text).unwrap_err().to_string()
    };
    for (track, words) in [
        (json!([{ "speed": 1 }]), "time"),
        (json!([{ "time": 1 }, { "time": 1 }]), "above 1"),
        (json!([{ "time": 0, "speed": -1 }]), "from 0 to 10"),
        (json!([{ "time": 0, "speed": 11 }]), "from 0 to 10"),
        (json!([{ "time": 0, "gravity": [0, 1] }]), "gravity"),
        (json!([{ "time": 0, "sped": 1 }]), "speed"),
    ] {
        let found = refused(track);
        assert!(found.contains(words), "{found}");
    }
}
