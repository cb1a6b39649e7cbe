//! Tests of seams between flush bodies: sliding and rolling bodies do not feel them, but a step
//! stops them.

use std::ops::Range;

use crate::common::*;
use drystone::geometry::{Geometry, Rigid2, Rigid3};
use drystone::{Body, Collider, Motion, StepSettings, World};
use drystone_solver::Vector;

/// The construction of a floor of slabs.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Floor {
    /// One body with a box for each slab.
    Boxes,
    /// One body with a hull for each slab.
    Hulls,
    /// One body with a closed triangle mesh for each slab.
    Meshes,
    /// One body with an open triangle mesh for the top of each slab.
    Sheets,
    /// A single body with the boxes of all slabs.
    Parts,
}

/// All constructions of separate bodies in `L` dimensions.
fn separate<const L: usize>() -> &'static [Floor] {
    let all = &[Floor::Boxes, Floor::Hulls, Floor::Meshes, Floor::Sheets];
    if L == 3 { all } else { &all[..2] }
}

/// A ride over seams.
#[derive(Clone, Copy, Debug)]
struct Ride {
    floor: Floor,
    supports: Motion,
    /// Half of the slider's size. \[m\]
    size: f32,
    /// Speed of the slider. \[m/s\]
    speed: f32,
    /// Steps per second. \[1/s\]
    rate: f32,
    realtime: bool,
    /// Height of the slabs from the first seam on above the others. \[m\]
    step: f32,
}

impl Ride {
    const PLAIN: Self = Self {
        floor: Floor::Boxes,
        supports: Motion::Static,
        size: 0.2,
        speed: 4.0,
        rate: 60.0,
        realtime: false,
        step: 0.0,
    };
}

/// The triangles of a box with these [`corners`]: first those of its top.
const BOX: [[u32; 3]; 12] = [
    [2, 6, 7],
    [2, 7, 3],
    [0, 1, 5],
    [0, 5, 4],
    [0, 2, 3],
    [0, 3, 1],
    [4, 5, 7],
    [4, 7, 6],
    [0, 4, 6],
    [0, 6, 2],
    [1, 3, 7],
    [1, 7, 5],
];

/// Returns the corners of a box.
fn corners<const L: usize>(half: [f32; L]) -> Vec<[f32; L]> {
    let corner =
        |bits: usize| std::array::from_fn(|i| if bits >> i & 1 == 1 { half[i] } else { -half[i] });
    (0..1 << L).map(corner).collect()
}

/// Returns the shape of a slab.
fn slab<G: Rigid<L, A>, const L: usize, const A: usize>(floor: Floor, half: [f32; L]) -> G::Shape {
    match floor {
        Floor::Boxes | Floor::Parts => G::cuboid(half),
        Floor::Hulls => G::hull(&corners(half)),
        Floor::Meshes => G::mesh(&corners(half), &BOX),
        Floor::Sheets => G::mesh(&corners(half), &BOX[..2]),
    }
}

/// A body that slides or rolls.
struct Slider<S> {
    shape: S,
    /// An angle or a quaternion, empty for none.
    rotation: &'static [f32],
    rolls: bool,
}

fn sliding<S>(shape: S) -> Slider<S> {
    Slider { shape, rotation: &[], rolls: false }
}

fn rolling<S>(shape: S) -> Slider<S> {
    Slider { rolls: true, ..sliding(shape) }
}

/// Returns the largest loss of speed, as a fraction of it, and the largest rise of the slider
/// \[m\].
fn ride<G: Rigid<L, A>, const L: usize, const A: usize>(
    ride: Ride,
    slider: Slider<G::Shape>,
) -> [f32; 2] {
    let Ride { floor, supports, size, speed, rate, realtime, step } = ride;
    let settings = if realtime { StepSettings::realtime() } else { StepSettings::certified() };
    let mut world = World::<G, L, A>::new(settings);
    world.gravity = Vector(v(0.0, -GRAVITY, 0.0));
    let Slider { shape, rotation, rolls } = slider;
    let material = surface(if rolls { 0.5 } else { 0.0 }, 0.0);
    let slab = 4.0 * size;
    let half: [f32; L] = v(0.5 * slab, size, 4.0 * size);
    let shape_of = || self::slab::<G, L, A>(floor, half);
    let place = |at: i32| -> [f32; L] {
        v(slab * (at as f32 + 0.5), if at >= 0 { step } else { 0.0 } - size, 0.0)
    };
    let mut parts: Vec<Collider<G, L, A>> = Vec::new();
    for at in -2..3 {
        let mut part: Collider<G, L, A> = Collider::new(shape_of());
        (part.material, part.pose) = (material.clone(), G::turned(place(at), 0.0));
        parts.push(part);
    }
    if floor == Floor::Parts {
        let mut whole: Body<G, L, A> = Body::new(supports, [0.0; L], shape_of());
        whole.colliders = parts;
        world.add(whole).unwrap();
    } else {
        for at in -2..3 {
            world.add(body(supports, place(at), shape_of(), &material)).unwrap();
        }
    }
    if supports == Motion::Dynamic {
        let below = G::halfspace(v(0.0, 1.0, 0.0));
        let place = v(0.0, -2.0 * size, 0.0);
        world.add(body(Motion::Static, place, below, &surface(1.0, 0.0))).unwrap();
    }
    let start = -1.6 * slab;
    let mut slider = moving(dynamic(v(start, size, 0.0), shape, &material), v(speed, 0.0, 0.0));
    slider.pose = G::pose(Vector(v(start, size, 0.0)), rotation);
    if rolls {
        slider.velocity.angular[A - 1] = -speed / size;
    }
    let slider = world.add(slider).unwrap();
    let (mut slowest, mut highest) = (speed, 0.0f32);
    let dt = 1.0 / rate;
    let steps = ((3.4 * slab / speed * rate) as usize).min(400);
    for _ in 0..steps {
        world.step(dt).unwrap();
        slowest = slowest.min(velocity(&world, slider).linear[0]);
        highest = highest.max(G::frame(&world.pose(slider).unwrap()).position[1] - size);
    }
    [1.0 - slowest / speed, highest]
}

fn check<G: Rigid<L, A>, const L: usize, const A: usize>(
    of: Ride,
    name: &str,
    slider: Slider<G::Shape>,
) {
    let [lost, rise] = ride::<G, L, A>(of, slider);
    let most = 1e-3;
    // A slow box that sags over a seam leans by a milliradian: gravity then takes a few mm/s of its
    // speed.
    assert!(
        lost < 0.01f32.max(0.006 / of.speed) && rise < most,
        "{L}D {name}: {lost} lost, {rise} m up: {of:?}"
    );
}

/// Checks a box, a hull, balls, a capsule, and in 3D cylinders, on this ride.
fn all<G: Rigid<L, A>, const L: usize, const A: usize>(of: Ride) {
    let Ride { size, .. } = of;
    check::<G, L, A>(of, "box", sliding(G::cuboid([size; L])));
    check::<G, L, A>(of, "hull", sliding(G::hull(&corners([size; L]))));
    check::<G, L, A>(of, "ball", rolling(G::ball(size)));
    check::<G, L, A>(of, "sliding ball", sliding(G::ball(size)));
    check::<G, L, A>(of, "capsule", sliding(G::capsule(0.5 * size, 0.5 * size)));
    if L == 3 {
        const QUARTER: f32 = std::f32::consts::FRAC_1_SQRT_2;
        let check = |name: &str, slider: Slider<parry3d::shape::SharedShape>| {
            check::<Rigid3, 3, 3>(of, name, slider);
        };
        let cylinder = || parry3d::shape::SharedShape::cylinder(size, size);
        let (along, across) = (&[0.0, 0.0, QUARTER, QUARTER], &[QUARTER, 0.0, 0.0, QUARTER]);
        check("cylinder upright", sliding(cylinder()));
        check("cylinder along", Slider { rotation: along, ..sliding(cylinder()) });
        check("cylinder across", Slider { rotation: across, ..sliding(cylinder()) });
        check("rolling cylinder", Slider { rotation: across, ..rolling(cylinder()) });
    }
}

/// Checks all shapes on this ride, on all constructions of separate bodies.
fn all_floors<G: Rigid<L, A>, const L: usize, const A: usize>(of: Ride) {
    for &floor in separate::<L>() {
        all::<G, L, A>(Ride { floor, ..of });
    }
}

/// Sliders lose less than 1 % of their speed and rise by less than 1 mm over seams of static and
/// kinematic slabs.
#[test]
fn seams_of_all_supports_cause_no_ghost_collisions() {
    for supports in [Motion::Static, Motion::Kinematic] {
        for realtime in [false, true] {
            let of = Ride { supports, realtime, ..Ride::PLAIN };
            all_floors::<Rigid2, 2, 1>(of);
            all_floors::<Rigid3, 3, 3>(of);
            all::<Rigid2, 2, 1>(Ride { floor: Floor::Parts, ..of });
            all::<Rigid3, 3, 3>(Ride { floor: Floor::Parts, ..of });
        }
    }
}

/// Sliders lose less than 1 % of their speed and rise by less than 1 mm over seams of dynamic
/// planks.
#[test]
fn seams_of_dynamic_planks_cause_no_ghost_collisions() {
    for (realtime, speed) in [(false, 1.0), (false, 4.0), (true, 4.0), (true, 16.0)] {
        let of = Ride { supports: Motion::Dynamic, realtime, speed, ..Ride::PLAIN };
        for floor in [Floor::Boxes, Floor::Hulls] {
            all::<Rigid3, 3, 3>(Ride { floor, ..of });
            all::<Rigid2, 2, 1>(Ride { floor, ..of });
        }
    }
}

/// Seams are not felt at 0.1 to 16 m/s and 24 to 240 steps per second. The loss is below 1 % or 6
/// mm/s, and the rise below 1 mm.
#[test]
fn seams_cause_no_ghost_collisions_at_any_speed_and_rate() {
    for speed in [0.1, 1.0, 16.0] {
        for rate in [24.0, 60.0, 240.0] {
            for realtime in [false, true] {
                let of = Ride { speed, rate, realtime, ..Ride::PLAIN };
                all_floors::<Rigid3, 3, 3>(of);
            }
        }
    }
}

/// Sliders of 4 cm to 8 m lose less than 1 % of their speed and rise by less than 1 mm over seams.
#[test]
fn seams_cause_no_ghost_collisions_at_any_size() {
    for size in [0.02, 0.05, 1.0, 4.0] {
        for realtime in [false, true] {
            let of = Ride { size, realtime, speed: 2.0, ..Ride::PLAIN };
            all_floors::<Rigid3, 3, 3>(of);
            all_floors::<Rigid2, 2, 1>(of);
        }
    }
}

/// A step of 5 mm takes more than half of the speed of a box of 10 cm or 1 m that runs against it.
#[test]
fn a_step_in_the_floor_stops_sliders() {
    for size in [0.05, 0.5] {
        for realtime in [false, true] {
            let of = Ride { size, speed: 2.0, realtime, step: 0.005, ..Ride::PLAIN };
            for &floor in [Floor::Parts].iter().chain(separate::<3>()) {
                let of = Ride { floor, ..of };
                let [lost, _] = ride::<Rigid3, 3, 3>(of, sliding(Rigid3::cuboid([size; 3])));
                assert!(lost > 0.5, "{lost} lost: {of:?}");
            }
            for floor in [Floor::Boxes, Floor::Hulls, Floor::Parts] {
                let of = Ride { floor, ..of };
                let [lost, _] = ride::<Rigid2, 2, 1>(of, sliding(Rigid2::cuboid([size; 2])));
                assert!(lost > 0.5, "2D: {lost} lost: {of:?}");
            }
        }
    }
}

/// A box or ball that slides over a chain of polygons, each rotated against the one before, follows
/// it. It loses less than 3 % of its energy. In a hollow it loses only its velocity into the next
/// polygon.
#[test]
fn a_chain_of_polygons_does_not_catch() {
    for angle in [-0.02f32, -0.002, 0.0, 0.002, 0.02, 0.05] {
        for round in [false, true] {
            for realtime in [false, true] {
                let mut world = World::<Rigid2, 2, 1>::new(if realtime {
                    StepSettings::realtime()
                } else {
                    StepSettings::certified()
                });
                world.gravity = Vector([0.0, -GRAVITY]);
                let smooth = surface(0.0, 0.0);
                let (mut at, mut slope) = ([-2.0f32, 0.0f32], -2.0 * angle);
                for _ in 0..8 {
                    let end = [at[0] + slope.cos(), at[1] + slope.sin()];
                    let points = [at, end, [end[0], -2.0], [at[0], -2.0]];
                    world
                        .add(body(Motion::Static, [0.0; 2], Rigid2::hull(&points), &smooth))
                        .unwrap();
                    (at, slope) = (end, slope + angle);
                }
                let (size, speed) = (0.1, 3.0);
                let shape = if round { Rigid2::ball(size) } else { Rigid2::cuboid([size; 2]) };
                let start = [-1.5, 0.5 * (-2.0 * angle).sin() + size / (2.0 * angle).cos()];
                let mut slider = moving(dynamic(start, shape, &smooth), [speed, 0.0]);
                slider.pose = Rigid2::turned(start, -2.0 * angle);
                let slope = -2.0 * angle;
                slider.velocity.linear = Vector([speed * slope.cos(), speed * slope.sin()]);
                let slider = world.add(slider).unwrap();
                let start = energy(&world);
                for _ in 0..100 {
                    world.step(DT).unwrap();
                }
                let weight = f64::from(0.5 * speed * speed) * 1000.0 * f64::from(size * size);
                let lost = (start - energy(&world))
                    / (weight * if round { std::f64::consts::PI } else { 4.0 });
                assert!(lost < 0.03, "{angle} rad, {realtime}, {round}: {lost} of the energy lost");
                let x = Rigid2::frame(&world.pose(slider).unwrap()).position[0];
                assert!(x > 3.0, "{angle} rad: stopped at {x} m");
            }
        }
    }
}

/// A box or ball that lands at a seam, with or without a bounce, keeps its speed along the floor
/// within 1 %.
#[test]
fn bodies_that_land_at_a_seam_keep_their_speed() {
    for restitution in [0.0, 0.5] {
        for tenth in 0..10 {
            for ball in [false, true] {
                let mut world = world::<Rigid3, 3, 3>();
                let smooth = surface(0.0, restitution);
                for at in [-1.0, 1.0] {
                    let slab = Rigid3::cuboid([1.0, 0.25, 1.0]);
                    world.add(body(Motion::Static, [at, -0.25, 0.0], slab, &smooth)).unwrap();
                }
                let shape = if ball { Rigid3::ball(0.2) } else { Rigid3::cuboid([0.2; 3]) };
                let start = [-0.35 + 0.03 * tenth as f32 - 0.4, 0.35, 0.0];
                let falling = moving(dynamic(start, shape, &smooth), [4.0, -2.0, 0.0]);
                let slider = world.add(falling).unwrap();
                run(&mut world, 0.3);
                let speed = velocity(&world, slider).linear[0];
                assert!((speed - 4.0).abs() < 0.04, "{restitution}, {tenth}, {ball}: {speed} m/s");
            }
        }
    }
}

/// A fall along a wall of two flush bodies.
#[derive(Clone, Copy, Debug)]
struct Fall {
    /// Motion of the bodies of the wall.
    wall: Motion,
    /// Their construction.
    shape: Floor,
    /// Half of the size of all bodies. \[m\]
    size: f32,
    /// Speed at the start. \[m/s\]
    speed: f32,
    /// Distance from the wall, as a fraction of the size. \[1\]
    beside: f32,
    /// Angle about z. \[rad\]
    tilt: f32,
    realtime: bool,
}

/// Returns the deepest overlap during a fall \[m\], the largest speed across the wall \[m/s\], and
/// the largest error of the speed along it, as a fraction of that speed.
fn fall<G: Rigid<L, A>, const L: usize, const A: usize>(fall: Fall) -> [f32; 3] {
    let Fall { wall, shape, size, speed, beside, tilt, realtime } = fall;
    let settings = if realtime { StepSettings::realtime() } else { StepSettings::certified() };
    let mut world = World::<G, L, A>::new(settings);
    world.gravity = Vector(v(0.0, -GRAVITY, 0.0));
    let smooth = surface(0.0, 0.0);
    let half: [f32; L] = v(size, size, size);
    let block = || slab::<G, L, A>(shape, half);
    let ground = G::halfspace(v(0.0, 1.0, 0.0));
    world.add(body(Motion::Static, v(0.0, -size, 0.0), ground, &smooth)).unwrap();
    for at in [0.0, 2.0] {
        world.add(body(wall, v(-size, at * size, 0.0), block(), &smooth)).unwrap();
    }
    let start: [f32; L] = v(size * (1.0 + beside + tilt.abs()), 2.3 * size, 0.0);
    let own = if shape == Floor::Meshes { G::cuboid(half) } else { block() };
    let mut falling = moving(dynamic(start, own, &smooth), v(0.0, -speed, 0.0));
    falling.pose = G::turned(start, tilt);
    let falling = world.add(falling).unwrap();
    let (mut fallen, mut worst) = (0.0, [0.0f32; 3]);
    let speed_at = |fallen: f32| (speed * speed + 2.0 * GRAVITY * fallen).sqrt();
    // It does not reach the ground in the next step.
    while fallen + 1.1 * DT * (speed_at(fallen) + DT * GRAVITY) < (2.3 - 1.1 * tilt.abs()) * size {
        world.step(DT).unwrap();
        let linear = velocity(&world, falling).linear;
        fallen = start[1] - G::frame(&world.pose(falling).unwrap()).position[1];
        let error = (1.0 + linear[1] / speed_at(fallen)).abs();
        let own = [world.measure().deepest_penetration as f32, linear[0].abs(), error];
        worst = std::array::from_fn(|i| worst[i].max(own[i]));
    }
    worst
}

/// A body that falls along a wall of flush bodies, or close beside it, does not feel their seam. It
/// may lean towards its lower corner by any angle, and slightly the other way.
#[test]
fn bodies_fall_along_flush_walls() {
    const TILTS: [f32; 7] = [0.0, 1e-4, -1e-4, 1e-3, -1e-3, -1e-2, -0.1];
    let walls = [
        (Motion::Static, Floor::Boxes),
        (Motion::Static, Floor::Hulls),
        (Motion::Static, Floor::Meshes),
        (Motion::Dynamic, Floor::Boxes),
        (Motion::Dynamic, Floor::Hulls),
    ];
    for ((wall, shape), realtime) in walls.into_iter().flat_map(|of| [(of, false), (of, true)]) {
        for (size, speed, beside) in [0.05, 5.0]
            .into_iter()
            .flat_map(|size| [0.0, 1.0, 10.0].map(|speed| (size, speed)))
            .flat_map(|(size, speed)| [0.0, 1e-3, 1e-2, 0.1].map(|by| (size, speed, by)))
        {
            for tilt in TILTS {
                let of = Fall { wall, shape, size, speed, beside, tilt, realtime };
                check_fall(of, fall::<Rigid3, 3, 3>(of));
                if shape != Floor::Meshes {
                    check_fall(of, fall::<Rigid2, 2, 1>(of));
                }
            }
        }
    }
}

fn check_fall(of: Fall, [overlap, aside, error]: [f32; 3]) {
    assert!(overlap < 2e-3, "{of:?}: {overlap} m deep");
    assert!(aside < 0.02, "{of:?}: {aside} m/s aside");
    assert!(error < 1e-3, "{of:?}: {error} of the speed");
}

/// Returns the height of gentle hills. \[m\]
fn hills(x: f32, z: f32) -> f32 {
    let waves = [[2.1, -0.4, 0.3], [-0.9, 1.7, 2.0], [0.6, 2.8, 4.4], [-2.3, -1.1, 5.1]];
    waves.map(|[u, v, phase]| 0.005 * f32::sin(u * x + v * z + phase)).iter().sum()
}

/// Returns hills over the cells `x` and `z` of 1/3 m as a triangle mesh, with a floor and side
/// walls if it is closed.
fn tile(x: Range<i32>, z: Range<i32>, closed: bool) -> parry3d::shape::SharedShape {
    let (rows, columns) = (x.clone().count() as u32 + 1, z.clone().count() as u32 + 1);
    let place = |i: i32, j: i32| [i as f32 / 3.0, j as f32 / 3.0];
    let ground = (x.start..=x.end).flat_map(|i| (z.start..=z.end).map(move |j| place(i, j)));
    let mut vertices: Vec<[f32; 3]> = ground.map(|[x, z]| [x, hills(x, z), z]).collect();
    let mut triangles = Vec::new();
    for (i, j) in (0..rows - 1).flat_map(|i| (0..columns - 1).map(move |j| (i, j))) {
        let a = i * columns + j;
        triangles.extend([[a, a + 1, a + columns], [a + 1, a + columns + 1, a + columns]]);
    }
    if closed {
        let below = vertices.len() as u32;
        vertices.extend(vertices.clone().iter().map(|[x, _, z]| [*x, -2.0, *z]));
        let floor = triangles.iter().map(|[a, b, c]| [a + below, c + below, b + below]);
        let floor: Vec<_> = floor.collect();
        triangles.extend(floor);
        let rim = (0..rows).map(|i| i * columns);
        let rim = rim.chain((1..columns).map(|j| (rows - 1) * columns + j));
        let rim = rim.chain((0..rows - 1).rev().map(|i| i * columns + columns - 1));
        let rim: Vec<_> = rim.chain((1..columns - 1).rev()).collect();
        for (at, &a) in rim.iter().enumerate() {
            let b = rim[(at + 1) % rim.len()];
            triangles.extend([[a, b, b + below], [a, b + below, a + below]]);
        }
    }
    Rigid3::mesh(&vertices, &triangles)
}

/// Returns the energy per mass of a body that slides over hills of `pieces` by `pieces` bodies.
/// \[J/kg\]
fn slide(pieces: i32, closed: bool, slider: &Body<Rigid3, 3, 3>, realtime: bool) -> f32 {
    let settings = if realtime { StepSettings::realtime() } else { StepSettings::certified() };
    let mut world = World::<Rigid3, 3, 3>::new(settings);
    world.gravity = Vector([0.0, -GRAVITY, 0.0]);
    let cells = 24 / pieces;
    let range = |at: i32| at * cells - 12..(at + 1) * cells - 12;
    for (x, z) in (0..pieces).flat_map(|x| (0..pieces).map(move |z| (x, z))) {
        let tile = tile(range(x), range(z), closed);
        world.add(body(Motion::Static, [0.0; 3], tile, &surface(0.0, 0.0))).unwrap();
    }
    let speed = slider.velocity.linear.length();
    let slider = world.add(slider.clone()).unwrap();
    run(&mut world, (5.0 / speed).min(1.5));
    let linear = velocity(&world, slider).linear;
    let height = Rigid3::frame(&world.pose(slider).unwrap()).position[1];
    0.5 * linear.dot(linear) + GRAVITY * height
}

/// A body without friction keeps as much energy on hills of 16 flush meshes as on one mesh.
#[test]
fn tiles_of_terrain_are_as_smooth_as_one_mesh() {
    let cylinder = parry3d::shape::SharedShape::cylinder(0.12, 0.12);
    let shapes = [
        ("box", Rigid3::cuboid([0.15, 0.1, 0.15]), 0.1),
        ("ball", Rigid3::ball(0.15), 0.15),
        ("capsule", Rigid3::capsule(0.15, 0.1), 0.25),
        ("cylinder", cylinder, 0.12),
    ];
    for (name, shape, low) in shapes {
        for (closed, realtime) in [(false, false), (false, true), (true, false), (true, true)] {
            for (speed, angle) in [0.5, 2.0, 8.0].iter().flat_map(|&v| [(v, 0.03f32), (v, 0.6)]) {
                let at = [-2.7, low + 0.02, -1.3];
                let along = [speed * angle.cos(), 0.0, speed * angle.sin()];
                let slider = moving(dynamic(at, shape.clone(), &surface(0.0, 0.0)), along);
                let [one, tiles] = [1, 4].map(|pieces| slide(pieces, closed, &slider, realtime));
                let kept = tiles / one;
                assert!(
                    kept > 0.95,
                    "{name} at {speed} m/s, {angle} rad, closed: {closed}, real time: {realtime}: \
                     {kept} of {one} J/kg"
                );
            }
        }
    }
}
