//! Tests of the impulses between bodies and of the clouds of points made of them.

use std::path::Path;

use drystone::StepSettings;
use drystone_bake::recording::Recording;
use drystone_bake::recording::contacts::{ContactRecording, write_usda};
use drystone_bake::{AnyWorld, PairImpulses, Sampling, WorldKind, build};
use drystone_scene::{Body, Motion, Scene, ShapeKind};

const STEP: f64 = 1.0 / 60.0;
const GRAVITY: f64 = 9.81;

fn scene(kind: WorldKind, body: &str) -> Scene {
    let is_2d = kind.dimension() == 2;
    let cut = |text: &str| if is_2d { text.replace(", 0.0]", "]") } else { text.to_owned() };
    let text = format!(
        "dimension = {}\nbodies_as = \"{}\"\n[[bodies]]\nmotion = \"static\"\nshapes = [{{type = \
         \"halfspace\", normal = [0.0, 1.0, 0.0]}}]\n[[bodies]]\n{body}",
        kind.dimension(),
        if kind.has_particles() { "particles" } else { "rigid" },
    );
    drystone_bake::read_toml(Path::new("x.toml"), &cut(&text)).unwrap().scene
}

fn world(scene: &Scene) -> AnyWorld {
    let settings = StepSettings { sleep_delay: 0.0, ..StepSettings::certified() };
    let mut world = build(scene, settings).unwrap();
    world.record_impulses(true);
    world
}

fn sum(pairs: &PairImpulses) -> f64 {
    pairs.impulses.iter().map(|impulse| f64::from(*impulse)).sum()
}

/// In each step the ground pushes a body at rest by m g dt, below its center.
#[test]
fn a_body_at_rest_is_pushed_by_its_weight() {
    let sphere = "position = [0.3, 0.25, 0.0]\nshapes = [{type = \"sphere\", radius = 0.25}]";
    let cube = "position = [0.3, 0.25, 0.0]\nshapes = [{type = \"box\", half_extents = [0.25, 0.25, 0.0]}]";
    let cube_3d = cube.replace("0.25, 0.25, 0.0", "0.25, 0.25, 0.25");
    for (kind, body) in [
        (WorldKind::Rigid3, cube_3d.as_str()),
        (WorldKind::Rigid2, cube),
        (WorldKind::Rigid3, sphere),
        (WorldKind::Particles2, sphere),
        (WorldKind::Particles3, sphere),
    ] {
        let mut world = world(&scene(kind, body));
        let weight = world.masses()[1] * GRAVITY * STEP;
        for step in 0..120 {
            world.step(STEP).unwrap();
            let pairs = world.impulses();
            if step < 30 {
                continue;
            }
            let pushed = sum(&pairs);
            assert!((pushed / weight - 1.0).abs() < 1e-3, "{kind:?}: {pushed} of {weight} N s");
            assert_eq!((pairs.bodies.len(), pairs.points.len()), (1, kind.dimension()));
            let apart = [pairs.points[0] - 0.3, pairs.points[1]];
            assert!(apart.iter().all(|x| x.abs() < 1e-3), "{kind:?}: {:?}", pairs.points);
            let up = if pairs.bodies[0] == [1, 0] { 1.0 } else { -1.0 };
            assert!((pairs.normals[1] - up).abs() < 1e-5, "{kind:?}: {:?}", pairs.normals);
            assert!(pairs.speeds[0] < 1e-2, "{kind:?}: {:?}", pairs.speeds);
        }
    }
}

/// The bounce of a ball is in its step with m (v- + v+), whatever the number of searches for
/// contacts in it; also if the ball is far from the ground at the end of the step.
#[test]
fn a_bounce_has_its_impulse_in_its_step() {
    for (height, dt) in [(1.0, STEP), (20.0, STEP), (5.0, 0.1)] {
        let ball = format!(
            "position = [0.0, {:?}, 0.0]\nrestitution = 0.8\nshapes = [{{type = \"sphere\", radius \
             = 0.1}}]",
            height + 0.1
        );
        let mut scene = scene(WorldKind::Rigid3, &ball);
        scene.time_step = dt;
        let mut world = world(&scene);
        let mass = world.masses()[1];
        let ball = world.body_at(1).unwrap();
        let (fast, due) = ((2.0 * GRAVITY * height).sqrt(), (2.0 * height / GRAVITY).sqrt());
        let mut time = 0.0;
        loop {
            let before = f64::from(world.velocity(ball).unwrap()[1]);
            world.step(dt).unwrap();
            let pairs = world.impulses();
            if pairs.bodies.is_empty() {
                time += dt;
                assert!(time < 3.0, "it never bounces");
                continue;
            }
            let is_due = time < due + 1e-3 && due < time + dt + 1e-3;
            assert!(is_due, "{height} m: in {time} to {} s, not at {due} s", time + dt);
            let after = f64::from(world.velocity(ball).unwrap()[1]);
            let pushed = sum(&pairs);
            let gained = mass * (after - before + GRAVITY * dt);
            assert!((pushed / gained - 1.0).abs() < 1e-3, "{height} m: {pushed}, not {gained}");
            let bounce = mass * (1.0 + 0.8) * fast;
            assert!((pushed / bounce - 1.0).abs() < 5e-3, "{height} m: {pushed}, not {bounce}");
            assert!((f64::from(pairs.speeds[0]) + before).abs() < 1e-4, "{:?}", pairs.speeds);
            let [x, y, z] = pairs.points[..] else { panic!("one point") };
            assert!(x.abs() < 1e-4 && y.abs() < 2e-3 && z.abs() < 1e-4, "{:?}", pairs.points);
            break;
        }
    }
}

/// Recording impulses changes no bit of the motion.
#[test]
fn recording_changes_nothing() {
    let mut scene = scene(WorldKind::Rigid3, "shapes = [{type = \"sphere\", radius = 0.1}]");
    for i in 0..20 {
        let kind = ShapeKind::Box { half_extents: vec![0.1, 0.1, 0.1] };
        let place = [0.03 * f64::from(i % 3), 0.3 + 0.25 * f64::from(i), 0.02 * f64::from(i % 5)];
        scene.bodies.push(Body::new(Motion::Dynamic, place, kind));
    }
    for settings in [StepSettings::certified(), StepSettings::realtime()] {
        let hashes = [false, true].map(|recording| {
            let mut world = build(&scene, settings.clone()).unwrap();
            world.record_impulses(recording);
            (0..60).for_each(|_| drop(world.step(STEP).unwrap()));
            world.state_hash()
        });
        assert_eq!(hashes[0], hashes[1]);
    }
}

/// A stage of contacts has a sample per frame; at a lower rate, a frame has the contacts of all
/// steps since the frame before.
#[test]
fn frames_of_a_stage_have_the_contacts_of_their_steps() {
    let frames: Vec<_> = (0..=4)
        .map(|frame| PairImpulses {
            bodies: vec![[1, 0]; usize::from(frame > 0)],
            points: vec![frame as f32; 3 * usize::from(frame > 0)],
            normals: vec![0.0; 3 * usize::from(frame > 0)],
            impulses: vec![8.0; usize::from(frame > 0)],
            speeds: vec![0.5; usize::from(frame > 0)],
        })
        .collect();
    let contacts = ContactRecording { dimension: 3, frame_time: 0.1, start: 0, frames: &frames };
    let poses = vec![0.0; 5 * 7];
    let recording = Recording { dimension: 3, bodies: 1, frame_time: 0.1, start: 0, poses };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dust.usda");
    let text = |options: &Sampling| {
        write_usda(&path, &contacts, &recording, None, options).unwrap();
        std::fs::read_to_string(&path).unwrap()
    };
    let all = text(&Sampling::default());
    let points = "points.timeSamples = { 0: [], 1: [(1, 1, 1)], 2: [(2, 2, 2)], 3: [(3, 3, 3)], ";
    assert!(all.contains(points), "{all}");
    assert!(all.contains("widths.timeSamples = { 0: [], 1: [0.04], "), "{all}");
    assert!(all.contains("timeCodesPerSecond = 10\n") && all.contains("endTimeCode = 4\n"));
    let half = text(&Sampling { fps: Some(5.0), ..Sampling::default() });
    let points = "points.timeSamples = { 0: [], 1: [(1, 1, 1), (2, 2, 2)], 2: [(3, 3, 3), (4, ";
    assert!(half.contains(points), "{half}");
    assert!(half.contains("int[] primvars:bodyA.timeSamples = { 0: [], 1: [1, 1], "), "{half}");
}
