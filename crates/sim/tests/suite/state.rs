//! State that is whole: checkpoints over wakes, additions and removals; identifiers; sleepers and
//! what comes to them.

use drystone::geometry::{Geometry, Rigid3};
use drystone::{Body, BodyId, InputError, Joint, Motion, StepSettings, Vector, Velocity, World3};

use super::common::{Random, Rigid, RoundShapes};

const DT: f32 = 1.0 / 60.0;

fn floor(world: &mut World3) -> BodyId {
    world.add(Body::new(Motion::Static, [0.0, -0.5, 0.0], Rigid3::cuboid([9.0, 0.5, 9.0]))).unwrap()
}

fn cube(world: &mut World3, position: [f32; 3], half: f32) -> BodyId {
    world.add(Body::new(Motion::Dynamic, position, Rigid3::cuboid([half; 3]))).unwrap()
}

fn world() -> World3 {
    let mut world = World3::new(StepSettings::realtime());
    world.gravity = Vector([0.0, -9.81, 0.0]);
    world
}

/// Boxes of random sizes that have fallen onto a floor and each other, all asleep.
fn heap(seed: u64, count: usize) -> (World3, Vec<BodyId>) {
    let (mut world, mut random) = (world(), Random(seed));
    floor(&mut world);
    let ids = (0..count).map(|layer| {
        let [x, z] = [0, 1].map(|_| random.between(-0.6, 0.6));
        cube(&mut world, [x, 0.5 + 0.7 * layer as f32, z], random.between(0.1, 0.3))
    });
    let ids: Vec<BodyId> = ids.collect();
    for _ in 0..3000 {
        if ids.iter().all(|&id| world.is_sleeping(id)) {
            break;
        }
        world.step(DT).unwrap();
    }
    (world, ids)
}

fn poses(world: &World3) -> Vec<f32> {
    let mut out = Vec::new();
    world.write_poses(&mut out);
    out
}

/// The bits of a number of steps.
fn go_on(world: &mut World3, steps: usize) -> Vec<Vec<f32>> {
    (0..steps)
        .map(|_| {
            world.step(DT).unwrap();
            poses(world)
        })
        .collect()
}

/// A restored world takes the same bits, whichever sleeper is woken next, and in whatever way.
#[test]
fn bodies_that_wake_after_a_restore_move_with_the_same_bits() {
    for seed in 0..12 {
        let (mut world, ids) = heap(seed, 12);
        assert!(world.is_sleeping(ids[0]), "heap {seed} sleeps");
        let saved = world.checkpoint();
        let wake = |world: &mut World3, way: usize| {
            let id = ids[way % ids.len()];
            let push = Velocity { linear: Vector([2.0, 1.0, 0.0]), angular: Vector::ZERO };
            match way % 3 {
                0 => world.wake(id),
                1 => world.add_force(id, push * 3000.0).unwrap(),
                _ => world.set_velocity(id, push).unwrap(),
            }
        };
        for way in 0..6 {
            world.restore(&saved).unwrap();
            wake(&mut world, way);
            let first = go_on(&mut world, 40);
            let bytes = postcard::to_stdvec(&saved).unwrap();
            for from in [saved.clone(), postcard::from_bytes(&bytes).unwrap()] {
                world.restore(&from).unwrap();
                assert_eq!(world.checkpoint(), saved, "heap {seed}");
                wake(&mut world, way);
                assert!(go_on(&mut world, 40) == first, "heap {seed}, way {way}: other bits");
            }
        }
    }
}

/// A checkpoint between `remove` and `step` is as good as any other.
#[test]
fn a_checkpoint_after_a_removal_is_restored() {
    let (mut world, ids) = heap(3, 6);
    world.remove(ids[2]);
    let saved = world.checkpoint();
    let first = go_on(&mut world, 30);
    world.restore(&saved).unwrap();
    assert!(go_on(&mut world, 30) == first);
}

/// Rollback over spawns and removals: bodies come back with their identifiers, and those added
/// since are gone. Bytes hold no bodies, and are refused then.
#[test]
fn a_restore_brings_bodies_back_and_takes_later_ones_away() {
    for seed in 0..40 {
        let mut random = Random(1000 + seed);
        let mut world = world();
        floor(&mut world);
        let mut alive: Vec<BodyId> = Vec::new();
        let play = |world: &mut World3, alive: &mut Vec<BodyId>, calls: &[[f32; 3]]| {
            let mut bits = Vec::new();
            for &[kind, x, z] in calls {
                if kind < 0.5 || alive.is_empty() {
                    let at = [x, 1.5 + z, z];
                    alive.push(cube(world, at, 0.15 + 0.1 * kind));
                } else if kind < 0.75 {
                    let at = (kind * 1e6) as usize % alive.len();
                    let id = alive.remove(at);
                    assert!(world.remove(id) && !world.remove(id));
                }
                bits.extend(go_on(world, 3));
            }
            bits
        };
        let mut calls = || -> Vec<[f32; 3]> {
            (0..20)
                .map(|_| {
                    [random.between(0.0, 1.0), random.between(-0.5, 0.5), random.between(-0.5, 0.5)]
                })
                .collect()
        };
        play(&mut world, &mut alive, &calls());
        if seed % 2 == 0
            && let Some(id) = alive.pop()
        {
            world.remove(id);
        }
        let (saved, then, next) = (world.checkpoint(), alive.clone(), calls());
        let first = play(&mut world, &mut alive, &next);
        let bytes = postcard::to_stdvec(&saved).unwrap();
        let read: drystone::Checkpoint = postcard::from_bytes(&bytes).unwrap();
        let before = world.checkpoint();
        assert!(world.restore(&read).is_err(), "{seed}: bytes hold no bodies");
        assert_eq!(world.checkpoint(), before, "{seed}: refused, and as it was");
        world.restore(&saved).unwrap();
        assert_eq!(world.checkpoint(), saved);
        assert!(then.iter().all(|&id| world.pose(id).is_some()));
        let mut again = then;
        assert!(play(&mut world, &mut again, &next) == first, "{seed}: other bits");
        assert_eq!(again, alive, "{seed}: the same identifiers");
    }
}

/// Identifiers of removed bodies and of other worlds name nothing.
#[test]
fn stale_and_foreign_identifiers_name_nothing() {
    let (mut world, mut other) = (world(), world());
    let mut tagged = Body::new(Motion::Dynamic, [0.0, 1.0, 0.0], Rigid3::ball(0.2));
    tagged.user_data = 77;
    tagged.colliders[0].user_data = 78;
    let [own, foreign] = [&mut world, &mut other].map(|world| world.add(tagged.clone()).unwrap());
    let collider = world.colliders(own).next().unwrap();
    assert_eq!((world.user_data(own), world.collider_user_data(collider)), (Some(77), Some(78)));
    assert_eq!((world.body_of(collider), world.body_at(own.index())), (Some(own), Some(own)));
    assert!(world.pose(foreign).is_none() && !world.remove(foreign));
    assert_eq!(world.colliders(foreign).count(), 0);
    assert!(world.remove(own) && !world.remove(own));
    assert_eq!((world.pose(own), world.collider_user_data(collider)), (None, None));
    let next = world.add(tagged).unwrap();
    assert_eq!(next.index(), own.index());
    assert_eq!((world.pose(own), world.body_of(collider)), (None, None));
    assert_eq!(world.bodies().collect::<Vec<_>>(), [next]);
}

/// Bodies that are added and removed take no more memory than those present at once: slots of
/// bodies and shapes are reused.
#[test]
fn repeated_spawning_and_removal_takes_no_more_memory() {
    let mut world = world();
    floor(&mut world);
    let (mut alive, mut sizes) = (std::collections::VecDeque::new(), Vec::new());
    for spawn in 0..3000 {
        let at = [(spawn % 7) as f32 - 3.0, 3.0, (spawn % 5) as f32 - 2.0];
        alive.push_back(cube(&mut world, at, 0.2));
        if alive.len() > 40 {
            world.remove(alive.pop_front().unwrap());
        }
        if spawn % 3 == 0 {
            world.step(DT).unwrap();
        }
        if spawn % 1000 == 999 {
            let checkpoint = postcard::to_stdvec(&world.checkpoint()).unwrap().len();
            sizes.push((world.len(), checkpoint));
        }
    }
    assert!(sizes.iter().all(|(slots, _)| *slots <= 42), "{sizes:?}");
    assert!(sizes[2].1 < 2 * sizes[0].1, "{sizes:?}");
}

/// A static or kinematic body that appears in a sleeper, or is put there, wakes it; elsewhere it
/// wakes nobody.
#[test]
fn a_body_added_to_a_sleeping_pile_wakes_it() {
    for motion in [Motion::Static, Motion::Kinematic] {
        for put in [false, true] {
            let mut world = world();
            floor(&mut world);
            let crates = [0.0, 4.0].map(|x| cube(&mut world, [x, 0.5, 0.0], 0.5));
            let wedge = Body::new(motion, [8.0, 5.0, 0.0], Rigid3::cuboid([0.5; 3]));
            let there = put.then(|| world.add(wedge.clone()).unwrap());
            (0..300).for_each(|_| drop(world.step(DT).unwrap()));
            assert_eq!(crates.map(|id| world.is_sleeping(id)), [true; 2]);
            let at = Rigid3::pose(Vector([0.4, 0.8, 0.0]), &[]);
            match there {
                Some(id) => world.set_pose(id, &at).unwrap(),
                None => drop(world.add(Body { pose: at, ..wedge }).unwrap()),
            }
            world.step(DT).unwrap();
            assert_eq!(crates.map(|id| world.is_sleeping(id)), [false, true], "{motion:?}, {put}");
            let before = world.pose(crates[0]).unwrap();
            (0..60).for_each(|_| drop(world.step(DT).unwrap()));
            assert_ne!(world.pose(crates[0]).unwrap(), before, "it is pushed out");
        }
    }
}

/// A crate that is held carries another below it on a rod, and both fall as one once it is released.
/// Only dynamic bodies are held or put to sleep.
#[test]
fn a_held_body_carries_what_it_is_joined_to() {
    let mut world = world();
    let floor = floor(&mut world);
    let held = cube(&mut world, [0.0, 8.0, 0.0], 0.5);
    let below = cube(&mut world, [0.0, 6.0, 0.0], 0.5);
    world.join(Joint::fixed([Some(held), Some(below)])).unwrap();
    let height = |world: &World3, id| Rigid3::frame(&world.pose(id).unwrap()).position[1];
    world.hold(held, true).unwrap();
    assert_eq!(world.put_to_sleep(held), Err(InputError::NotDynamic));
    let up = Velocity { linear: Vector([0.0, 1.0, 0.0]), angular: Vector::ZERO };
    world.set_velocity(held, up).unwrap();
    (0..60).for_each(|_| drop(world.step(DT).unwrap()));
    for (id, expected) in [(held, 9.0), (below, 7.0)] {
        assert!((height(&world, id) - expected).abs() < 1e-3, "{} m", height(&world, id));
    }
    world.hold(held, false).unwrap();
    (0..30).for_each(|_| drop(world.step(DT).unwrap()));
    let fallen = 0.5 - 0.5 * 9.81 * 0.25;
    for (id, from) in [(held, 9.0), (below, 7.0)] {
        let off = height(&world, id) - from - fallen;
        assert!(off.abs() < 2e-3, "off by {off} m");
    }
    assert_eq!(world.hold(floor, true), Err(InputError::NotDynamic));
    assert_eq!(world.put_to_sleep(floor), Err(InputError::NotDynamic));
}

/// A static body has no velocity, whoever asks. Moved elsewhere, it carries the bodies there, and
/// nothing where it was.
#[test]
fn static_bodies_have_poses_and_no_velocities() {
    let mut world = world();
    let floor = floor(&mut world);
    let rider = cube(&mut world, [0.0, 0.5, 0.0], 0.5);
    let pose = world.pose(floor);
    let there = Rigid3::pose(Vector([3.0, -0.5, 0.0]), &[]);
    assert_eq!(world.move_to(floor, &there, DT), Err(InputError::Static));
    let velocity = Velocity { linear: Vector([1.0; 3]), angular: Vector::ZERO };
    assert_eq!(world.set_velocity(floor, velocity), Err(InputError::Static));
    (0..300).for_each(|_| drop(world.step(DT).unwrap()));
    assert_eq!((world.pose(floor), world.velocity(floor)), (pose, Some(Velocity::ZERO)));
    assert!(world.is_sleeping(rider));
    // Lowered by a meter, and far to the side: the crate falls that far.
    world.set_pose(floor, &Rigid3::pose(Vector([5.0, -1.5, 0.0]), &[])).unwrap();
    (0..300).for_each(|_| drop(world.step(DT).unwrap()));
    let height = Rigid3::frame(&world.pose(rider).unwrap()).position[1];
    assert!((height + 0.5).abs() < 0.01, "{height} m");
    // A sleeping crate is put beside it, onto the floor, and both stay.
    world.set_pose(rider, &Rigid3::pose(Vector([3.0, -0.4, 2.0]), &[])).unwrap();
    (0..300).for_each(|_| drop(world.step(DT).unwrap()));
    let at = Rigid3::frame(&world.pose(rider).unwrap()).position;
    assert!((at[1] + 0.5).abs() < 0.01 && (at[0] - 3.0).abs() < 0.01, "{at:?}");
}

/// Waking a body costs its group, not the world: of 4000 sleepers apart each wake takes less than a
/// step takes.
#[test]
fn removed_sleepers_wake_their_neighbors_alone() {
    let mut world = world();
    floor(&mut world);
    let pairs: Vec<[BodyId; 2]> = (0..30)
        .map(|i| {
            let at = [i as f32 * 0.5 - 7.5, 0.1, 0.0];
            [cube(&mut world, at, 0.1), cube(&mut world, [at[0], 0.3, 0.0], 0.1)]
        })
        .collect();
    (0..200).for_each(|_| drop(world.step(DT).unwrap()));
    assert!(pairs.iter().flatten().all(|&id| world.is_sleeping(id)));
    world.remove(pairs[7][0]);
    let awake = |world: &World3| {
        let awake = pairs
            .iter()
            .flatten()
            .filter(|&&id| world.pose(id).is_some() && !world.is_sleeping(id));
        awake.copied().collect::<Vec<_>>()
    };
    assert_eq!(awake(&world), [pairs[7][1]]);
    let report = world.step(DT).unwrap();
    assert_eq!(report.asleep, 58);
    world.wake(pairs[3][1]);
    assert_eq!(awake(&world), [pairs[3][0], pairs[3][1], pairs[7][1]]);
}

/// Bad values are refused at the door, by name, and the world is as it was.
#[test]
fn bad_values_are_refused_and_change_nothing() {
    let (mut world, ids) = heap(5, 8);
    let before = world.checkpoint();
    let good = Body::new(Motion::Dynamic, [0.0, 9.0, 0.0], Rigid3::cuboid([0.2; 3]));
    let mut refused = |what: &str, change: &dyn Fn(&mut Body<Rigid3, 3, 3>)| {
        let mut body = good.clone();
        change(&mut body);
        let error = world.add(body).expect_err(what).to_string();
        assert!(error.contains(what) && error.contains("accepted: "), "{what}: {error}");
    };
    for wrong in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e20] {
        refused("position", &|body| body.pose = Rigid3::pose(Vector([0.0, wrong, 0.0]), &[]));
        refused("velocity", &|body| body.velocity.linear[1] = wrong);
        refused("angular velocity", &|body| body.velocity.angular[2] = wrong);
        refused("damping", &|body| body.damping[1] = wrong);
        refused("gravity factor", &|body| body.gravity_factor = wrong);
        refused("density", &|body| body.colliders[0].density = wrong);
        refused("friction", &|body| body.colliders[0].material.friction = wrong.into());
        refused("size of collider 0", &|body| body.colliders[0].shape = Rigid3::ball(wrong));
    }
    refused("rotation", &|body| body.pose = Rigid3::pose(Vector([0.0; 3]), &[0.0; 4]));
    refused("rotation", &|body| body.pose = Rigid3::pose(Vector([0.0; 3]), &[f32::NAN; 4]));
    refused("size of collider 0", &|body| body.colliders[0].shape = Rigid3::ball(-0.5));
    refused("size of collider 0", &|body| body.colliders[0].shape = Rigid3::ball(0.0));
    refused("size of collider 0", &|body| body.colliders[0].shape = Rigid3::cuboid([-0.5; 3]));
    refused("no mass", &|body| body.colliders[0].shape = Rigid3::cuboid([0.5, 0.0, 0.5]));
    refused("no mass", &|body| body.colliders[0].density = 0.0);
    refused("no mass", &|body| body.colliders.clear());
    refused("no mass", &|body| body.colliders[0].shape = Rigid3::halfspace([0.0, 1.0, 0.0]));
    refused("restitution", &|body| body.colliders[0].material.restitution = 5.0);
    for mass in [0.0, -1.0, f32::NAN] {
        refused("mass", &|body| {
            body.inertia = Some(drystone::Inertia { mass, ..drystone::Inertia::FIXED });
        });
    }
    let cube = || (parry3d::math::Pose::IDENTITY, Rigid3::cuboid([0.5; 3]));
    let compound = parry3d::shape::SharedShape::compound(vec![cube()]);
    refused("compound", &|body| body.colliders[0].shape = compound.clone());

    for wrong in [f32::NAN, f32::INFINITY, 3e38] {
        let velocity = Velocity { linear: Vector([wrong, 0.0, 0.0]), angular: Vector::ZERO };
        assert!(world.set_velocity(ids[0], velocity).is_err(), "{wrong}");
        assert!(world.add_force(ids[0], velocity).is_err(), "{wrong}");
        assert!(world.set_damping(ids[0], [wrong, 0.0]).is_err(), "{wrong}");
        let pose = Rigid3::pose(Vector([wrong, 0.0, 0.0]), &[]);
        assert!(world.set_pose(ids[0], &pose).is_err(), "{wrong}");
        assert!(world.move_to(ids[0], &pose, DT).is_err(), "{wrong}");
        assert!(world.step(wrong).is_err(), "{wrong}");
        world.gravity[0] = wrong;
        assert!(world.step(DT).is_err(), "{wrong}");
        world.gravity[0] = 0.0;
    }
    let near = Rigid3::pose(Vector([0.0, 1.0, 0.0]), &[]);
    assert!(world.move_to(ids[0], &near, 0.0).is_err(), "a way in no time");
    assert!(world.step(-DT).is_err());
    for change in [
        |settings: &mut StepSettings| settings.substeps = 0,
        |settings: &mut StepSettings| settings.softness = 1.0,
        |settings: &mut StepSettings| settings.prediction_distance = -1.0,
        |settings: &mut StepSettings| settings.slop = f32::NAN,
    ] {
        let settings = world.settings.clone();
        change(&mut world.settings);
        let error = world.step(DT).unwrap_err().to_string();
        assert!(error.contains("the setting "), "{error}");
        world.settings = settings;
    }
    assert_eq!(world.checkpoint(), before, "a world that refused is as it was");
    world.step(0.0).unwrap();
    assert_eq!(poses(&world), {
        let mut other = world;
        other.restore(&before).unwrap();
        poses(&other)
    });
}

/// Contacts of a step: a crate at rest is pushed by its weight, asleep it still touches, and every
/// bounce of a ball is seen with its whole impulse, also where contacts are searched for several
/// times in a step.
#[test]
fn touching_bodies_are_reported_with_the_impulse_of_the_whole_step() {
    for gravity in [9.81_f32, 30.0] {
        let mut world = world();
        world.gravity = Vector([0.0, -gravity, 0.0]);
        world.record_impulses(true);
        let floor = floor(&mut world);
        let crate_id = cube(&mut world, [3.0, 0.5, 0.0], 0.5);
        let mut ball = Body::new(Motion::Dynamic, [0.0, 2.0, 0.0], Rigid3::ball(0.1));
        ball.colliders[0].material.restitution = 0.9;
        let mass = 1000.0 * 4.0 / 3.0 * std::f32::consts::PI * 0.001;
        let ball = world.add(ball).unwrap();
        let (mut bounces, mut slept) = (0, false);
        for step in 0..200 {
            let falling = world.velocity(ball).unwrap().linear[1];
            world.step(DT).unwrap();
            let rising = world.velocity(ball).unwrap().linear[1];
            let of = |id: BodyId| world.touching().find(|of| of.bodies.contains(&id));
            let pushed = of(ball).map_or(0.0, |of| of.impulse);
            let gained = mass * (rising - falling + gravity * DT);
            assert!((pushed - gained).abs() < 0.02 * gained.abs() + 1e-3, "{pushed}, {gained}");
            let push = world.impulses().find(|of| of.bodies.contains(&ball));
            assert_eq!(push.map_or(0.0, |of| of.impulse), pushed);
            if let Some(push) = push.filter(|_| pushed > mass) {
                assert!((push.speed + falling).abs() < 1e-4, "{push:?}, {falling}");
                assert!((push.normal[1].abs() - 1.0).abs() < 1e-3, "{push:?}");
                assert!(push.point.length() < 2e-3, "{push:?}");
            }
            bounces += u32::from(pushed > mass);
            let stands = of(crate_id).expect("the crate stands");
            assert_eq!(stands.bodies.map(|id| id == crate_id || id == floor), [true; 2]);
            assert!((stands.normal[1].abs() - 1.0).abs() < 1e-3 && stands.point[1].abs() < 0.01);
            slept |= world.is_sleeping(crate_id);
            let weight = 1000.0 * gravity * DT;
            let is_still = step > 20 && stands.impulse > 0.0;
            assert!(!is_still || (stands.impulse / weight - 1.0).abs() < 0.05, "{stands:?}");
        }
        assert!(bounces >= 3 && slept, "{bounces} bounces, asleep: {slept}");
    }
}
