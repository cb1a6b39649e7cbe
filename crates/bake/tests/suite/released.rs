//! Bodies that follow a track and are released, that sleep until something hits them, and that a
//! constant force pushes: by formula, and with the same bits from a checkpoint.

use std::path::Path;

use drystone::StepSettings;
use drystone_bake::{AnyWorld, BuildError, WorldKind};
use drystone_scene::{Body, Motion, Rotation, ShapeKind, Track};

const GRAVITY: f64 = 9.81;
const DT: f64 = 1.0 / 60.0;

const KINDS: [WorldKind; 4] =
    [WorldKind::Rigid2, WorldKind::Rigid3, WorldKind::Particles2, WorldKind::Particles3];

/// Numbers that begin with x and y; the others are 0.
fn flat(kind: WorldKind, x: f64, y: f64) -> Vec<f64> {
    let mut numbers = vec![x, y, 0.0];
    numbers.truncate(kind.dimension());
    numbers
}

fn world(kind: WorldKind, settings: StepSettings) -> AnyWorld {
    let mut world = AnyWorld::new(kind, settings);
    let down: Vec<f32> = flat(kind, 0.0, -GRAVITY).into_iter().map(|x| x as f32).collect();
    world.set_gravity(&down).unwrap();
    world
}

fn ball(kind: WorldKind, motion: Motion, [x, y]: [f64; 2], radius: f64) -> Body {
    let shape = ShapeKind::Sphere { radius };
    let mut body = match kind.dimension() {
        2 => Body::new(motion, [x, y], shape),
        _ => Body::new(motion, [x, y, 0.0], shape),
    };
    body.shapes.iter_mut().for_each(|shape| shape.material.friction = 0.0);
    body
}

fn floor(kind: WorldKind) -> Body {
    let normal = flat(kind, 0.0, 1.0);
    let shape = ShapeKind::Halfspace { normal };
    match kind.dimension() {
        2 => Body::new(Motion::Static, [0.0; 2], shape),
        _ => Body::new(Motion::Static, [0.0; 3], shape),
    }
}

/// Returns a track along these points, one each 0.1 s.
fn track(kind: WorldKind, points: &[[f64; 2]]) -> Track {
    Track {
        times: (0..points.len()).map(|i| 0.1 * i as f64).collect(),
        positions: points.iter().map(|&[x, y]| flat(kind, x, y)).collect(),
        rotations: vec![Rotation::identity(kind.dimension()); points.len()],
    }
}

fn height(world: &AnyWorld, index: usize) -> f64 {
    let id = world.body_at(index).unwrap();
    f64::from(world.pose(id).unwrap()[1])
}

fn along(world: &AnyWorld, index: usize) -> f64 {
    let id = world.body_at(index).unwrap();
    f64::from(world.pose(id).unwrap()[0])
}

fn run(world: &mut AnyWorld, steps: usize) {
    for _ in 0..steps {
        world.step(DT).unwrap();
    }
}

/// A body that a track throws upwards at 3 m/s and 4 m/s flies on along the parabola, and lands on the
/// floor that it was led over. Until its release nothing pushes it.
#[test]
fn a_thrown_body_flies_on() {
    for kind in KINDS {
        for settings in [StepSettings::certified(), StepSettings::realtime()] {
            let mut world = world(kind, settings);
            world.add(&floor(kind)).unwrap();
            let mut thrown = ball(kind, Motion::Dynamic, [0.0, 0.6], 0.5);
            thrown.track = track(kind, &[[0.0, 0.6], [0.3, 1.0], [0.6, 1.4]]);
            let thrown = world.add(&thrown).unwrap();
            // It would stop a body of the same mass.
            world.add(&ball(kind, Motion::Dynamic, [0.3, 2.3], 0.5)).unwrap();
            run(&mut world, 12);
            assert!((along(&world, 1) - 0.6).abs() < 1e-5, "{} m", along(&world, 1));
            assert!((height(&world, 1) - 1.4).abs() < 1e-5, "{} m", height(&world, 1));
            world.remove(world.body_at(2).unwrap());
            run(&mut world, 18);
            let time = 18.0 * DT;
            let expected = [0.6 + 3.0 * time, 1.4 + 4.0 * time - 0.5 * GRAVITY * time * time];
            let found = [along(&world, 1), height(&world, 1)];
            let off = (found[0] - expected[0]).hypot(found[1] - expected[1]);
            assert!(off < 2e-3, "{kind:?}: {found:?}, expected {expected:?}");
            run(&mut world, 120);
            assert!((height(&world, 1) - 0.5).abs() < 5e-3, "{} m", height(&world, 1));
            assert!(!world.is_sleeping(thrown) || along(&world, 1) > 1.0);
        }
    }
}

/// A track of one key releases its body at once, with the velocity of the body.
#[test]
fn one_key_releases_at_once() {
    let kind = WorldKind::Rigid3;
    let mut world = world(kind, StepSettings::certified());
    let mut body = ball(kind, Motion::Dynamic, [0.0, 5.0], 0.5);
    body.linear_velocity = vec![2.0, 0.0, 0.0];
    body.track = track(kind, &[[0.0, 5.0]]);
    world.add(&body).unwrap();
    run(&mut world, 30);
    let expected = [1.0, 5.0 - 0.5 * GRAVITY * 0.25];
    let found = [along(&world, 0), height(&world, 0)];
    assert!((found[0] - expected[0]).abs() < 1e-4 && (found[1] - expected[1]).abs() < 1e-3);
}

/// Bodies that start asleep hang in the air and stand in a pile, until a thrown ball hits one: then
/// those that touch each other wake, and the lone one stays.
#[test]
fn sleepers_wake_when_they_are_hit() {
    for kind in KINDS {
        for settings in [StepSettings::certified(), StepSettings::realtime()] {
            let mut world = world(kind, settings);
            world.add(&floor(kind)).unwrap();
            for place in [[0.0, 1.5], [0.0, 2.49], [5.0, 3.0]] {
                let mut body = ball(kind, Motion::Dynamic, place, 0.5);
                body.start_asleep = true;
                world.add(&body).unwrap();
            }
            let mut thrown = ball(kind, Motion::Dynamic, [-3.0, 1.5], 0.3);
            thrown.linear_velocity = flat(kind, 6.0, 2.0);
            world.add(&thrown).unwrap();
            run(&mut world, 15);
            let heights = [1, 2, 3].map(|index| height(&world, index));
            assert_eq!(heights, [1.5, 2.49f32.into(), 3.0], "{kind:?}");
            run(&mut world, 120);
            for index in [1, 2] {
                let (height, along) = (height(&world, index), along(&world, index));
                assert!((height - 0.5).abs() < 5e-2 && along.abs() > 0.1, "{height} m, {along} m");
            }
            assert_eq!(height(&world, 3), 3.0);
        }
    }
}

/// Bodies of a scene that start asleep stay where they are, although joints hold them together and one
/// lies in the floor.
#[test]
fn joints_and_floors_of_a_scene_wake_no_sleepers() {
    let text = "gravity = [0, -9.81, 0]
        bodies = [{ name = 'a', position = [0, 0.19, 0], start_asleep = true, radius = 0.2 },
            { name = 'b', position = [1, 5, 0], start_asleep = true, radius = 0.2 },
            { motion = 'static', shapes = [{ type = 'halfspace', normal = [0, 1, 0] }] }]
        joints = [{ type = 'fixed', bodies = ['a', 'b'] }]";
    let text = text.replace("radius = 0.2", "shapes = [{ type = 'sphere', radius = 0.2 }]");
    let scene = drystone_scene::format::read_toml(Path::new("s.toml"), &text).unwrap().scene;
    let mut world = drystone_bake::build(&scene, StepSettings::certified()).unwrap();
    run(&mut world, 30);
    assert_eq!([0, 1].map(|index| height(&world, index)), [0.19f32.into(), 5.0]);
}

/// A constant force accelerates by F / m, and not while the body sleeps or follows a track.
#[test]
fn a_force_pushes_along() {
    for kind in KINDS {
        let mut world = world(kind, StepSettings::certified());
        for (x, asleep) in [(0.0, false), (20.0, true)] {
            let mut body = ball(kind, Motion::Dynamic, [x, 50.0], 0.5);
            body.mass.mass = Some(4.0);
            body.force = flat(kind, 8.0, 4.0 * GRAVITY);
            body.start_asleep = asleep;
            world.add(&body).unwrap();
        }
        run(&mut world, 60);
        assert!((along(&world, 0) - 1.0).abs() < 1e-4, "{} m", along(&world, 0));
        assert!((height(&world, 0) - 50.0).abs() < 1e-3, "{} m", height(&world, 0));
        assert_eq!(along(&world, 1), 20.0);
    }
}

/// From a checkpoint as bytes, taken before and after the release, the further steps are the same.
#[test]
fn a_checkpoint_knows_what_is_held() {
    let kind = WorldKind::Rigid3;
    let built = || -> Result<AnyWorld, BuildError> {
        let mut world = world(kind, StepSettings::certified());
        world.add(&floor(kind))?;
        let mut thrown = ball(kind, Motion::Dynamic, [0.0, 0.51], 0.5);
        thrown.track = track(kind, &[[0.0, 0.51], [0.4, 0.5], [0.9, 0.51]]);
        thrown.force = vec![0.0, 0.0, 50.0];
        world.add(&thrown)?;
        let mut waiting = ball(kind, Motion::Dynamic, [2.0, 0.5], 0.5);
        waiting.start_asleep = true;
        world.add(&waiting)?;
        Ok(world)
    };
    for steps in [5, 12, 13, 20] {
        let mut whole = built().unwrap();
        run(&mut whole, steps);
        let bytes = whole.checkpoint().to_bytes();
        let mut resumed = built().unwrap();
        resumed.restore(&drystone_bake::AnyCheckpoint::from_bytes(&bytes).unwrap()).unwrap();
        for _ in 0..40 {
            whole.step(DT).unwrap();
            resumed.step(DT).unwrap();
            assert_eq!(whole.state_hash(), resumed.state_hash(), "after {steps} steps");
        }
    }
}
