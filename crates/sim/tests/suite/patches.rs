//! Tests of contact patches: slender ones keep their width, and cylinders rest, stack and roll.

use crate::common::*;
use drystone::geometry::{Geometry, Rigid3};
use drystone::{Body, BodyId, Collider, Motion, StepSettings, World, World3};
use drystone_solver::Vector;
use parry3d::shape::SharedShape;

/// Rotation of the y axis onto z.
const LYING: [f32; 4] =
    [std::f32::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f32::consts::FRAC_1_SQRT_2];

fn with_gravity(settings: StepSettings) -> World3 {
    let mut world: World3 = World::new(settings);
    world.gravity = Vector([0.0, -GRAVITY, 0.0]);
    world
}

fn solid(position: [f32; 3], shape: SharedShape) -> Body<Rigid3, 3, 3> {
    dynamic::<Rigid3, 3, 3>(position, shape, &surface(0.5, 0.0))
}

/// Adds a floor with its top at 0 and this half size \[m\]: a half-space, a box, a hull or a mesh.
fn add_ground(world: &mut World3, kind: usize, size: f32) {
    let material = surface(0.5, 0.0);
    let corners = [-1.0f32, 1.0].map(|x| [-1.0f32, 1.0].map(|z| [x, z]));
    let hull: Vec<[f32; 3]> = corners
        .into_iter()
        .flatten()
        .flat_map(|[x, z]| [[x * size, 0.0, z * size], [x * size, -size, z * size]])
        .collect();
    let (shape, height) = match kind {
        0 => (Rigid3::halfspace([0.0, 1.0, 0.0]), 0.0),
        1 => (Rigid3::cuboid([size; 3]), -size),
        2 => (Rigid3::hull(&hull), 0.0),
        _ => (grid(3, 2.0 * size), 0.0),
    };
    world.add(body::<Rigid3, 3, 3>(Motion::Static, [0.0, height, 0.0], shape, &material)).unwrap();
}

fn moved(world: &World3, id: BodyId, from: [f32; 3]) -> f32 {
    (place(world, id) - Vector(from)).length()
}

/// Returns both presets, each with 24 and 60 steps per second.
fn with_rates() -> [(StepSettings, f32); 4] {
    let presets = [StepSettings::certified(), StepSettings::realtime()];
    let [certified, realtime] = presets;
    [(certified.clone(), 24.0), (certified, 60.0), (realtime.clone(), 24.0), (realtime, 60.0)]
}

fn run_at(world: &mut World3, seconds: f32, rate: f32) {
    for _ in 0..(seconds * rate) as usize {
        world.step(1.0 / rate).unwrap();
    }
}

/// Returns a body of several shapes.
fn compound(
    position: [f32; 3],
    parts: &[(SharedShape, <Rigid3 as Geometry<3, 3>>::Pose)],
) -> Body<Rigid3, 3, 3> {
    let mut body = solid(position, parts[0].0.clone());
    let first = body.colliders.pop().expect("a solid has a shape");
    body.colliders.extend(parts.iter().map(|(shape, pose)| Collider {
        shape: shape.clone(),
        pose: *pose,
        ..first.clone()
    }));
    body
}

fn place_of(world: &World3, id: BodyId) -> [f32; 3] {
    place(world, id).0
}

fn moved_aside(world: &World3, id: BodyId, from: [f32; 3]) -> f32 {
    let [x, _, z] = (place(world, id) - Vector(from)).0;
    x.hypot(z)
}

/// Panels, planks and cards of 1 cm to 10 m, on edge and lying, stand on half-spaces, boxes and
/// hulls. They move by less than 0.1 % of their size, or by 0.1 mm if small, and lean by less than
/// 1.5e-6 (1 - cosine).
#[test]
fn slender_patches_stand() {
    for size in [1e-2, 1.0, 10.0] {
        for half in [[0.01, 0.5, 0.5], [0.5, 0.005, 0.01], [0.5, 0.01, 0.004]] {
            let half = half.map(|x: f32| x * size);
            for kind in 0..3 {
                let mut world = with_gravity(StepSettings::quality());
                add_ground(&mut world, kind, 2.0 * size);
                let start = [0.0, half[1], 0.0];
                let id = world.add(solid(start, Rigid3::cuboid(half))).unwrap();
                run(&mut world, 1.0);
                let what = format!("{half:?} on floor {kind}");
                let leans = 1.0 - upright(&world, id);
                assert_below(&format!("{what}: 1 - cosine of the lean"), leans, 1.5e-6);
                assert_below(&what, moved(&world, id, start), 1e-3 * size.max(0.1));
            }
        }
    }
}

/// Standing and lying cylinders move on all floors by less than 0.1 % of their size, or by 0.2 mm
/// if small.
#[test]
fn cylinders_rest() {
    for settings in [StepSettings::certified(), StepSettings::realtime()] {
        for size in [0.1, 1.0, 10.0] {
            for [radius, half] in [[0.3, 0.6], [1.0, 0.1], [0.1, 3.0]] {
                let [radius, half] = [radius * size, half * size];
                for kind in 0..4 {
                    for lying in [false, true] {
                        let mut world = with_gravity(settings.clone());
                        add_ground(&mut world, kind, 10.0 * size);
                        let height = if lying { radius } else { half };
                        let start = [0.3 * size, height, 0.4 * size];
                        let mut can = solid(start, SharedShape::cylinder(half, radius));
                        if lying {
                            can.pose = Rigid3::pose(Vector(start), &LYING);
                        }
                        let id = world.add(can).unwrap();
                        run(&mut world, 1.0);
                        let what = format!("{radius} by {half} on floor {kind}, lying: {lying}");
                        assert_below(&what, moved(&world, id, start), 1e-3 * size.max(0.2));
                    }
                }
            }
        }
    }
}

/// A needle of 3 mm that lies on a mesh moves by less than 0.5 % of its length in 2 s. Contact
/// points beside the line on which it rolls do not rotate it.
#[test]
fn needles_lie_on_meshes() {
    for (settings, rate) in with_rates() {
        for cells in [1, 20] {
            let mut world = with_gravity(settings.clone());
            let mesh = grid(cells, 0.03);
            let material = surface(0.5, 0.0);
            world.add(body::<Rigid3, 3, 3>(Motion::Static, [0.0; 3], mesh, &material)).unwrap();
            let (radius, half) = (5e-5, 1.5e-3);
            let start = [0.4 * radius, radius, 0.3 * radius];
            let mut needle = solid(start, SharedShape::cylinder(half, radius));
            needle.pose = Rigid3::pose(Vector(start), &LYING);
            let id = world.add(needle).unwrap();
            run_at(&mut world, 2.0, rate);
            let what = format!("a needle on {cells} cells at {rate} moved, of its length");
            assert_below(&what, moved(&world, id, start) / (2.0 * half), 5e-3);
        }
    }
}

/// Ten stacked coins of 2.4 to 240 mm move by less than 1/16 of their diameter in 2 s, at the
/// settings of the presets.
#[test]
fn coins_stay_stacked() {
    for (settings, rate) in with_rates() {
        for size in [0.1, 1.0, 10.0] {
            let (radius, half) = (0.012 * size, 0.001 * size);
            let mut world = with_gravity(settings.clone());
            add_ground(&mut world, 1, 0.1 * size);
            let coins: Vec<_> = (0..10)
                .map(|i| {
                    let aside = if i % 2 == 0 { 0.0 } else { 0.1 * radius };
                    let start = [aside, half * (2 * i + 1) as f32, 0.0];
                    (world.add(solid(start, SharedShape::cylinder(half, radius))).unwrap(), start)
                })
                .collect();
            run_at(&mut world, 2.0, rate);
            for (id, start) in coins {
                let what = format!("a coin of {size} at {rate} moved");
                assert_below(&what, moved(&world, id, start) / size, 1.5e-3);
            }
        }
    }
}

/// Towers of six compounds stand like those of single boxes: open bricks, tables, and boxes cut in
/// four. They move aside by less than 1/30 of their width in 2 s.
#[test]
fn towers_of_compounds_stand() {
    let wall = |x: f32, z: f32| [0.3 - 0.25 * x.abs(), 0.15, 0.3 - 0.25 * z.abs()];
    let walls = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]].map(|[x, z]| {
        let half = wall(x, z);
        (half, [0.25 * x, -0.02, 0.25 * z])
    });
    let brick: Vec<_> = walls.into_iter().chain([([0.3, 0.02, 0.3], [0.0, 0.15, 0.0])]).collect();
    let legs = [-0.2, 0.2].map(|x| ([0.1, 0.15, 0.3], [x, -0.02, 0.0]));
    let table: Vec<_> = legs.into_iter().chain([([0.3, 0.02, 0.3], [0.0, 0.15, 0.0])]).collect();
    let quarter = |x: f32, z: f32| ([0.15, 0.17, 0.15], [0.15 * x, 0.0, 0.15 * z]);
    let quarters: Vec<_> =
        [-1.0, 1.0].into_iter().flat_map(|x| [-1.0, 1.0].map(|z| quarter(x, z))).collect();
    for (settings, rate) in with_rates() {
        for size in [0.01, 0.1, 1.0, 10.0] {
            for (kind, parts) in [&brick, &table, &quarters].into_iter().enumerate() {
                let mut world = with_gravity(settings.clone());
                add_ground(&mut world, 1, 4.0 * size);
                let place = |i: usize| [0.0, 0.17 * size * (2 * i + 1) as f32, 0.0];
                let parts = parts.iter().map(|(half, at)| {
                    let pose = Rigid3::pose(Vector(at.map(|x: f32| x * size)), &[]);
                    (Rigid3::cuboid(half.map(|x: f32| x * size)), pose)
                });
                let parts: Vec<_> = parts.collect();
                let ids: Vec<_> =
                    (0..6).map(|i| world.add(compound(place(i), &parts)).unwrap()).collect();
                let starts: Vec<_> = ids.iter().map(|&id| place_of(&world, id)).collect();
                run_at(&mut world, 2.0, rate);
                for (id, start) in ids.into_iter().zip(starts) {
                    let aside = moved_aside(&world, id, start);
                    let what = format!("kind {kind} of {size} at {rate}: moved aside");
                    assert_below(&what, aside / size, 0.02);
                }
            }
        }
    }
}

/// Returns the root mean square of the speeds in a heap of 150 boxes in a container, after 12 s in
/// the real-time preset. \[m/s\]
fn speed_in_a_heap(seed: u64) -> f32 {
    let mut world = with_gravity(StepSettings { sleep_delay: 0.0, ..StepSettings::realtime() });
    let material = surface(0.5, 0.0);
    add_ground(&mut world, 1, 3.0);
    for [x, z] in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]] {
        let half = [1.2 - 0.9 * f32::abs(x), 4.0, 1.2 - 0.9 * f32::abs(z)];
        let at = [1.2 * x, 4.0, 1.2 * z];
        world
            .add(body::<Rigid3, 3, 3>(Motion::Static, at, Rigid3::cuboid(half), &material))
            .unwrap();
    }
    let mut random = Random(seed);
    let boxes: Vec<_> = (0..150)
        .map(|i| {
            let at = |k: i32| 0.5 * (k as f32 - 1.0);
            let start = [at(i % 3), 0.5 + 0.5 * (i / 9) as f32, at(i / 3 % 3)];
            let half = [0.18, 0.22, 0.2].map(|x: f32| x + random.between(-0.03, 0.03));
            let mut own = solid(start, Rigid3::cuboid(half));
            let turn = Vector(random.vector(1.0));
            own.pose = Rigid3::advance(&own.pose, Vector::ZERO, turn);
            world.add(own).unwrap()
        })
        .collect();
    run_at(&mut world, 12.0, 60.0);
    let speeds = boxes.iter().map(|&id| {
        let linear = velocity(&world, id).linear;
        linear.dot(linear)
    });
    (speeds.sum::<f32>() / boxes.len() as f32).sqrt()
}

/// Heaps come to rest in the real-time preset, because no contact keeps changing its axis. In four of
/// five heaps the speed is below 0.5 mm/s.
#[test]
fn heaps_come_to_rest() {
    let mut speeds = [5, 6, 7, 8, 9].map(speed_in_a_heap);
    speeds.sort_by(f32::total_cmp);
    assert_below("speed in four of five heaps, m/s", speeds[3], 5e-4);
}

/// A wheel that rolls at 2 m/s keeps its speed for 3 s within 1 %, on all floors.
#[test]
fn a_wheel_keeps_its_speed() {
    for kind in 0..4 {
        let radius = 0.3;
        let mut world = with_gravity(StepSettings::quality());
        add_ground(&mut world, kind, 20.0);
        let start = [-5.0, radius, 0.0];
        let mut wheel = moving(solid(start, SharedShape::cylinder(0.1, radius)), [2.0, 0.0, 0.0]);
        wheel.pose = Rigid3::pose(Vector(start), &LYING);
        wheel.velocity.angular = Vector([0.0, 0.0, -2.0 / radius]);
        let id = world.add(wheel).unwrap();
        run(&mut world, 3.0);
        assert_within("speed of a wheel", velocity(&world, id).linear[0], 2.0, 0.01);
    }
}
