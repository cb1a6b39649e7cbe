//! Tests of worlds: conservation, resting contact, kinematic bodies, shapes and properties of
//! bodies.

use std::time::{Duration, Instant};

use crate::common::*;
use drystone::Dimension;
use drystone::geometry::{Geometry, Particles, Rigid2, Rigid3};
use drystone::{
    Body, BodyId, Collider, Filter, Inertia, InputError, Motion, Stage, StepSettings, World,
    World2, World3,
};
use drystone_solver::{SymmetricMatrix, Vector, Velocity};

// Conservation

/// Adds bodies on a loose grid, none of which overlap, with random velocities, spins and materials.
/// Returns each with its mass \[kg\].
fn scatter<G: Rigid<L, A>, const L: usize, const A: usize>(
    world: &mut World<G, L, A>,
    random: &mut Random,
    side: usize,
    floor: f32,
    speed: f32,
) -> Vec<(BodyId, f32)> {
    let mut out = Vec::new();
    for index in 0..side.pow(L as u32) {
        let cell = |axis: u32| (index / side.pow(axis) % side) as f32;
        let middle = 0.5 * (side - 1) as f32;
        let position = v(cell(0) - middle, cell(1) + floor, cell(2) - middle);
        let size = random.between(0.15, 0.25);
        let shape = if index % 2 == 0 { G::ball(size) } else { G::cuboid([size; L]) };
        let material =
            surface(f64::from(random.between(0.0, 1.0)), f64::from(random.between(0.0, 1.0)));
        let mass = G::mass(&shape, 1000.0).mass;
        let mut body = moving(dynamic(position, shape, &material), random.vector(speed));
        body.pose = G::turned(position, random.between(-1.0, 1.0));
        body.velocity.angular = Vector(random.vector(speed));
        out.push((world.add(body).unwrap(), mass));
    }
    out
}

fn momentum<G: Dimension<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
    bodies: &[(BodyId, f32)],
) -> Vector<f64, L> {
    let mut sum = Vector::ZERO;
    for (id, mass) in bodies {
        sum += velocity(world, *id).linear.map(f64::from) * f64::from(*mass);
    }
    sum
}

fn free_collisions<G: Rigid<L, A>, const L: usize, const A: usize>(seed: u64) {
    let mut world = weightless::<G, L, A>();
    let side = if L == 2 { 5 } else { 3 };
    let bodies = scatter(&mut world, &mut Random(seed), side, -1.0, 3.0);
    let total: f64 = bodies.iter().map(|(_, mass)| 3.0 * f64::from(*mass)).sum();
    let before = momentum(&world, &bodies);
    let start = energy(&world);
    let mut contacts = 0;
    for _ in 0..120 {
        contacts += world.step(DT).unwrap().contacts;
    }
    assert!(contacts > 20, "only {contacts} contacts");
    let change = (momentum(&world, &bodies) - before).length() / total;
    assert_below(&format!("{L}D, {seed}: change of the momentum"), change as f32, 1e-5);
    let kept = (energy(&world) / start) as f32;
    assert_below(&format!("{L}D, {seed}: energy, part of that before"), kept, 1.001);
}

/// In collisions without gravity the momentum changes by less than 1e-5 of 3 m/s times the total
/// mass. The energy ends below 1.001 times the initial one.
#[test]
fn free_collisions_keep_the_momentum() {
    for seed in 0..4 {
        free_collisions::<Rigid2, 2, 1>(seed);
        free_collisions::<Rigid3, 3, 3>(seed);
    }
}

fn piles<G: Rigid<L, A>, const L: usize, const A: usize>(seed: u64) {
    let mut random = Random(seed);
    let mut world = world::<G, L, A>();
    add_floor(&mut world, &surface(0.5, f64::from(random.between(0.0, 1.0))));
    scatter(&mut world, &mut random, if L == 2 { 5 } else { 3 }, 0.5, 3.0);
    let start = energy(&world);
    let mut most = f64::NEG_INFINITY;
    for _ in 0..300 {
        world.step(DT).unwrap();
        most = most.max(energy(&world) / start);
        assert!(world.measure().finite);
    }
    assert_below(&format!("{L}D, {seed}: most energy, part of the first"), most as f32, 1.001);
}

/// The energy of a pile never exceeds 1.001 times the initial one in 300 steps.
#[test]
fn a_pile_never_gains_energy() {
    for seed in 10..16 {
        piles::<Rigid2, 2, 1>(seed);
        piles::<Rigid3, 3, 3>(seed);
    }
}

/// Throws sixty bodies of all convex shapes, at up to 15 m/s along each axis, into a container with
/// walls 0.2 m thick.
fn container<G: Rigid<L, A>, const L: usize, const A: usize>(hull: &[[f32; L]]) {
    let material = surface(0.4, 0.3);
    let mut world = world::<G, L, A>();
    let mut random = Random(7);
    let (half, thin) = (3.0, 0.1);
    for axis in 0..L {
        for side in [-1.0, 1.0] {
            let mut position = [0.0; L];
            position[axis] = side * (half + thin);
            let mut size = [half + 2.0 * thin; L];
            size[axis] = thin;
            world.add(body(Motion::Static, position, G::cuboid(size), &material)).unwrap();
        }
    }
    let mut bodies = Vec::new();
    let side = if L == 2 { 8 } else { 4 };
    for index in 0..60 {
        let cell = |axis: u32| (index / usize::pow(side, axis) % side) as f32;
        let at = |axis: u32| (cell(axis) + 0.5) / side as f32 * 5.6 - 2.8;
        let position = v(at(0), at(1), at(2));
        let shape = match index % 4 {
            0 => G::ball(0.25),
            1 => G::cuboid([0.2; L]),
            2 => G::capsule(0.15, 0.12),
            _ => G::hull(hull),
        };
        let mut thrown = moving(dynamic(position, shape, &material), random.vector(15.0));
        thrown.pose = G::turned(position, random.between(-3.0, 3.0));
        thrown.velocity.angular = Vector(random.vector(10.0));
        bodies.push(world.add(thrown).unwrap());
    }
    let mut farthest = 0.0f32;
    for _ in 0..480 {
        world.step(DT).unwrap();
        for &id in &bodies {
            let at = place(&world, id);
            farthest = at.0.iter().fold(farthest, |far, x| far.max(x.abs()));
        }
    }
    assert_below(&format!("{L}D: farthest center [m]"), farthest, half - 0.05);
    // Balls keep rolling, hence the large bound.
    assert_below(&format!("{L}D: fastest at the end [m/s]"), world.measure().fastest as f32, 1.0);
    let deepest = world.measure().deepest_penetration as f32;
    assert_below(&format!("{L}D: deepest overlap at the end [m]"), deepest, 1e-3);
}

/// Bodies thrown into a container stay inside for 8 s. They end slower than 1 m/s, with overlaps
/// below 1 mm.
#[test]
fn nothing_escapes_a_container() {
    container::<Rigid2, 2, 1>(&[[-0.2, -0.15], [0.25, -0.1], [0.15, 0.2], [-0.1, 0.22]]);
    container::<Rigid3, 3, 3>(&[
        [-0.2, -0.15, -0.1],
        [0.25, -0.1, -0.2],
        [0.0, -0.1, 0.25],
        [0.05, 0.25, 0.0],
        [-0.15, 0.2, 0.1],
    ]);
}

// Resting contact

/// Adds a pyramid of boxes and a ball between two blocks in this order, and returns the positions
/// of all bodies after 5 s. `order(i)` is the body that is added as number i. \[m\]
fn settled<G: Rigid<L, A>, const L: usize, const A: usize>(
    order: impl Fn(usize) -> usize,
) -> Vec<Vector<f32, L>> {
    let material = surface(0.6, 0.0);
    let mut bodies = Vec::new();
    for row in 0..5 {
        for column in 0..5 - row {
            let position = v(2.0 + column as f32 + 0.5 * row as f32, 0.4 + 0.8 * row as f32, 0.0);
            bodies.push(dynamic(position, G::cuboid(v(0.45, 0.4, 0.4)), &material));
        }
    }
    for x in [-4.0, -1.0] {
        bodies.push(body(Motion::Static, v(x, 0.0, 0.0), G::cuboid(v(1.0, 0.3, 1.0)), &material));
    }
    bodies.push(dynamic(v(-2.5, 1.0, 0.0), G::ball(0.6), &material));
    bodies.push(body(Motion::Static, [0.0; L], G::halfspace(v(0.0, 1.0, 0.0)), &material));
    let mut world = world::<G, L, A>();
    let mut ids = vec![None; bodies.len()];
    let mut bodies: Vec<_> = bodies.into_iter().map(Some).collect();
    for i in 0..bodies.len() {
        let index = order(i);
        ids[index] = bodies[index].take().map(|body| world.add(body).unwrap());
    }
    run(&mut world, 5.0);
    ids.into_iter().map(|id| place(&world, id.unwrap())).collect()
}

fn permutation<G: Rigid<L, A>, const L: usize, const A: usize>() {
    let first = settled::<G, L, A>(|i| i);
    let count = first.len();
    // Backwards, and in steps of 7, which does not divide 19.
    for (name, other) in [
        ("backwards", settled::<G, L, A>(|i| count - 1 - i)),
        ("mixed", settled::<G, L, A>(|i| i * 7 % count)),
    ] {
        let apart = first.iter().zip(&other).map(|(p, q)| (*p - *q).length()).fold(0.0, f32::max);
        assert_below(&format!("{L}D: places of rest, {name} [m]"), apart, 1e-3);
    }
}

/// The resting positions after 5 s differ by less than 1 mm if the bodies are added in another
/// order.
#[test]
fn rest_does_not_depend_on_the_order_of_the_bodies() {
    permutation::<Rigid2, 2, 1>();
    permutation::<Rigid3, 3, 3>();
}

/// A wall of 210 boxes moves slower than 2 mm/s after 5 s in the real-time preset. With a
/// `stick_rate` of 20 1/s, or 8 % of a slip in each substep, it swayed by 3 cm/s and more forever.
#[test]
fn a_wall_comes_to_rest_with_the_realtime_preset() {
    let material = surface(0.5, 0.0);
    let mut world = World3::new(StepSettings { sleep_delay: 0.0, ..StepSettings::realtime() });
    world.gravity = Vector(v(0.0, -9.81, 0.0));
    world
        .add(body(Motion::Static, v(0.0, -1.0, 0.0), Rigid3::cuboid([50.0, 1.0, 50.0]), &material))
        .unwrap();
    for row in 0..20 {
        for column in 0..20 - row {
            let at = v(1.02 * (column as f32 + 0.5 * row as f32), 0.5 + row as f32, 0.0);
            world.add(dynamic(at, Rigid3::cuboid([0.5; 3]), &material)).unwrap();
        }
    }
    run(&mut world, 5.0);
    let speed = world.measure().fastest as f32;
    assert_below("speed of a wall after 5 s [m/s]", speed, 2e-3);
}

/// Stacks thirty boxes in the real-time preset and checks that none leans.
///
/// Impulses act where the boxes touched when the points were found. If they acted where the boxes
/// touch now, the tower would fall. It is one and a half times as high as can stand on contacts
/// that yield by 7 mm.
fn tower<G: Rigid<L, A>, const L: usize, const A: usize>() {
    let material = surface(0.5, 0.0);
    let mut world =
        World::<G, L, A>::new(StepSettings { sleep_delay: 0.0, ..StepSettings::realtime() });
    world.gravity = Vector(v(0.0, -9.81, 0.0));
    add_floor(&mut world, &material);
    let half = || G::cuboid([0.5; L]);
    let aside = |i: usize| 0.02 * (7.0 * i as f32).sin();
    let at = |i: usize| v(aside(i), 0.5 + i as f32, 0.0);
    let boxes: Vec<_> =
        (0..30).map(|i| world.add(dynamic(at(i), half(), &material)).unwrap()).collect();
    run(&mut world, 20.0);
    for (i, &own) in boxes.iter().enumerate() {
        let leans = (place(&world, own)[0] - aside(i)).abs();
        assert_below(&format!("{L}D: how far box {i} leans after 20 s [m]"), leans, 0.1);
    }
}

/// Thirty stacked boxes, each at most 2 cm off center, lean by less than 10 cm in 20 s.
#[test]
fn a_tower_stands_with_the_realtime_preset() {
    tower::<Rigid2, 2, 1>();
    tower::<Rigid3, 3, 3>();
}

/// Drops a ball of 5 mm from rest, at 24 steps per second. It lands in the first step.
fn drop_in_a_step<G: Rigid<L, A>, const L: usize, const A: usize>() {
    for bounce in [0.0, 1.0] {
        let material = surface(0.5, bounce);
        let mut world = world::<G, L, A>();
        add_floor(&mut world, &material);
        world.add(dynamic(v(0.0, 0.01, 0.0), G::ball(0.005), &material)).unwrap();
        let start = energy(&world);
        for step in 0..48 {
            world.step(1.0 / 24.0).unwrap();
            let (deepest, gain) = (world.measure().deepest_penetration, energy(&world) / start);
            assert!(deepest < 1e-4, "({L},{A}), bounce {bounce}, step {step}: {deepest} m");
            assert!(gain < 1.001, "({L},{A}), bounce {bounce}, step {step}: {gain} of the energy");
        }
    }
}

/// A ball of 5 mm that falls from rest overlaps the floor by less than 0.1 mm, and gains less than
/// 0.1 % of its energy. If the next contact search were planned by its speed alone, it would be
/// halfway into the floor before a contact is found.
#[test]
fn contacts_of_bodies_that_fall_from_rest_are_found_in_time() {
    drop_in_a_step::<Rigid2, 2, 1>();
    drop_in_a_step::<Rigid3, 3, 3>();
}

/// Lets a box hit another off center, without gravity, so that both move on together and rotate.
///
/// Reused points apply the two opposite impulses at positions as far apart as the bodies have moved
/// since the search. That is so little that linear and angular momentum are kept.
fn meeting<G: Rigid<L, A>, const L: usize, const A: usize>() {
    let material = surface(0.5, 0.0);
    for settings in [StepSettings::realtime(), StepSettings::certified()] {
        let mut world = World::<G, L, A>::new(settings);
        let still = world.add(dynamic([0.0; L], G::cuboid([0.5; L]), &material)).unwrap();
        let hits = dynamic(v(-1.2, 0.3, 0.0), G::cuboid([0.5; L]), &material);
        let hits = world.add(moving(hits, v(2.0, 0.5, 0.0))).unwrap();
        // Divided by the mass of a box.
        let spin = |world: &World<G, L, A>| {
            let own = [still, hits].map(|id| {
                let (at, velocity) = (place(world, id), velocity(world, id));
                let [x, y, vx, vy] = [at[0], at[1], velocity.linear[0], velocity.linear[1]];
                x * vy - y * vx + velocity.angular[A - 1] / 6.0
            });
            own[0] + own[1]
        };
        let before = spin(&world);
        run(&mut world, 1.0);
        assert!(velocity(&world, still).linear[0] > 0.5, "they have met");
        assert_within(&format!("{L}D: angular momentum"), spin(&world) / before, 1.0, 0.01);
    }
}

/// An off-center collision keeps the angular momentum within 1 %, in the real-time and in the
/// certified preset.
#[test]
fn colliding_bodies_keep_their_angular_momentum() {
    meeting::<Rigid2, 2, 1>();
    meeting::<Rigid3, 3, 3>();
}

/// Rolls a ball over a floor for 10 s. With contact points left behind at an earlier position, a
/// slowly rolling ball became ever faster.
fn rolling<G: Rigid<L, A>, const L: usize, const A: usize>() {
    let material = surface(0.5, 0.0);
    for speed in [0.003f32, 0.03, 0.3] {
        let mut world =
            World::<G, L, A>::new(StepSettings { sleep_delay: 0.0, ..StepSettings::realtime() });
        world.gravity = Vector(v(0.0, -9.81, 0.0));
        add_floor(&mut world, &material);
        let mut ball =
            moving(dynamic(v(0.0, 0.2, 0.0), G::ball(0.2), &material), v(speed, 0.0, 0.0));
        ball.velocity.angular[A - 1] = -speed / 0.2;
        let ball = world.add(ball).unwrap();
        run(&mut world, 10.0);
        let changed = (velocity(&world, ball).linear[0] / speed - 1.0).abs();
        assert_below(&format!("{L}D: change of a speed of {speed} m/s in 10 s [1]"), changed, 0.01);
    }
}

/// A ball that rolls at 3 mm/s, 3 cm/s or 0.3 m/s changes its speed by less than 1 % in 10 s.
#[test]
fn a_rolling_ball_keeps_its_speed() {
    rolling::<Rigid2, 2, 1>();
    rolling::<Rigid3, 3, 3>();
}

/// Contact points of a small box that slides over an edge end up less than 1/32 of its size plus
/// 0.1 mm beyond it. They are reused, but not for as long as those of a large box.
#[test]
fn points_of_small_bodies_are_reused_briefly() {
    let (size, smooth) = (0.04, surface(0.0, 0.0));
    let mut world =
        World::<Rigid2, 2, 1>::new(StepSettings { sleep_delay: 0.0, ..StepSettings::realtime() });
    world.gravity = Vector([0.0, -9.81]);
    world.add(body(Motion::Static, [-0.5, -0.5], Rigid2::cuboid([0.5; 2]), &smooth)).unwrap();
    let small = dynamic([-0.03, 0.5 * size], Rigid2::cuboid([0.5 * size; 2]), &smooth);
    let small = world.add(moving(small, [0.03, 0.0])).unwrap();
    let mut farthest = f32::NEG_INFINITY;
    // Until the center of the box is almost over the edge.
    for _ in 0..55 {
        let center = place(&world, small);
        world.step(DT).unwrap();
        let system = world.system();
        let manifold = &system.manifolds[0];
        for contact in &system.contacts {
            let point = center + manifold.frame.arms[1] + manifold.frame.to_world(contact.offset);
            farthest = farthest.max(point[0]);
        }
    }
    // Reused points move with the box.
    assert!(farthest > 1e-4, "not reused: {farthest} m beyond the edge");
    assert_below("beyond the edge [m]", farthest, size / 32.0 + 1e-4);
}

/// Returns the deepest overlap \[m\] and the highest speed \[m/s\] in a column after 3 s. The
/// column is shifted by `height` along each axis.
fn column_at(height: f32) -> [f64; 2] {
    let material = surface(0.5, 0.0);
    let mut world: World3 = world();
    let at = |y: f32| [height, height + y, height];
    world.add(body(Motion::Static, at(-0.5), Rigid3::cuboid([4.0, 0.5, 4.0]), &material)).unwrap();
    for i in 0..8 {
        world.add(dynamic(at(0.5 + i as f32), Rigid3::cuboid([0.5; 3]), &material)).unwrap();
    }
    run(&mut world, 3.0);
    let measure = world.measure();
    [measure.deepest_penetration, measure.fastest]
}

/// A column 1 km from the origin rests with the overlap of one at the origin, within 0.001 mm, and
/// is slower than 0.1 mm/s. Positions are rounded to 0.1 mm there, five times the overlap.
#[test]
fn rest_does_not_depend_on_where_it_is() {
    let ([near, _], [far, speed]) = (column_at(0.0), column_at(1024.0));
    println!("overlaps {near} and {far} m, speed {speed} m/s");
    assert!(near > 1e-6 && (far - near).abs() < 1e-6, "{near} and {far}");
    assert!(speed < 1e-4, "{speed}");
}

fn ten_minutes<G: Rigid<L, A>, const L: usize, const A: usize>() {
    let (sin, cos) = 20.0f32.to_radians().sin_cos();
    let material = surface(0.5, 0.0);
    let mut world = world::<G, L, A>();
    world.add(body(Motion::Static, [0.0; L], G::halfspace(v(-sin, cos, 0.0)), &material)).unwrap();
    let mut block = dynamic([0.0; L], G::cuboid([0.5; L]), &material);
    block.pose = G::turned(v(-0.5 * sin, 0.5 * cos, 0.0), 20.0f32.to_radians());
    let block = world.add(block).unwrap();
    run(&mut world, 1.0);
    let start = place(&world, block);
    run(&mut world, 600.0);
    let moved = (place(&world, block) - start).length();
    assert_below(&format!("{L}D: creep in 10 minutes [m]"), moved, 5e-5);
}

/// A box on a slope of 20 degrees with friction 0.5 creeps less than 0.05 mm in 10 minutes.
#[test]
fn a_box_on_a_slope_stays_for_ten_minutes() {
    ten_minutes::<Rigid2, 2, 1>();
    ten_minutes::<Rigid3, 3, 3>();
}

// Kinematic bodies

fn pushing<G: Rigid<L, A>, const L: usize, const A: usize>() {
    let material = surface(0.5, 0.0);
    let mut world = world::<G, L, A>();
    add_floor(&mut world, &material);
    let pusher = body(Motion::Kinematic, v(-2.0, 0.5, 0.0), G::cuboid([0.45; L]), &material);
    let pusher = world.add(moving(pusher, v(1.0, 0.0, 0.0))).unwrap();
    let heavy = dynamic(v(0.0, 0.5, 0.0), G::cuboid([0.5; L]), &material);
    let heavy = world.add(weighing(heavy, 1e5)).unwrap();
    for step in 1..=180 {
        world.step(DT).unwrap();
        let expected = -2.0 + step as f32 * DT;
        let at = place(&world, pusher);
        assert!((at[0] - expected).abs() < 1e-4, "{L}D: the pusher is at {at:?}");
        assert_eq!(at[1], 0.5, "{L}D: the pusher was pushed");
    }
    assert_within(&format!("{L}D: pushed to [m]"), place(&world, heavy)[0], 1.95, 0.005);
    let speed = velocity(&world, heavy).linear[0];
    assert_within(&format!("{L}D: speed of the pushed [m/s]"), speed, 1.0, 0.01);
}

/// A kinematic body is within 0.1 mm of its course, although it pushes a body of 100 t. It gives
/// that body its speed within 1 %.
#[test]
fn a_kinematic_body_pushes_and_is_never_pushed() {
    pushing::<Rigid2, 2, 1>();
    pushing::<Rigid3, 3, 3>();
}

fn carrying<G: Rigid<L, A>, const L: usize, const A: usize>() {
    let material = surface(0.5, 0.0);
    let mut world = world::<G, L, A>();
    let platform = body(Motion::Kinematic, [0.0; L], G::cuboid(v(2.0, 0.1, 2.0)), &material);
    let platform = world.add(platform).unwrap();
    let block = world.add(dynamic(v(0.3, 0.35, 0.0), G::cuboid([0.25; L]), &material)).unwrap();
    run(&mut world, 0.5);
    let start = place(&world, block);
    let mut worst = 0.0f32;
    for step in 1..=300 {
        // Accelerations up to 2 m/s^2, below mu g.
        let x = 0.5 * (1.0 - (2.0 * step as f32 * DT).cos());
        let target = G::pose(Vector(v(x, 0.0, 0.0)), &[]);
        world.move_to(platform, &target, DT).unwrap();
        world.step(DT).unwrap();
        let along = (place(&world, platform)[0] - x).abs();
        assert!(along < 1e-5, "{L}D: the platform is off by {along} m");
        let carried = place(&world, block) - start;
        worst = worst.max((carried - Vector(v(x, 0.0, 0.0))).length());
    }
    assert_below(&format!("{L}D: slip on a moving platform [m]"), worst, 2e-3);
}

/// A box on a platform that accelerates at up to 2 m/s^2, below mu g, slips by less than 2 mm.
#[test]
fn a_moving_platform_carries_by_friction() {
    carrying::<Rigid2, 2, 1>();
    carrying::<Rigid3, 3, 3>();
}

/// A box on a platform that rotates at 1 rad/s follows its circle within 1 cm for 2 rad.
#[test]
fn a_turning_platform_carries_a_box_around() {
    let material = surface(0.8, 0.0);
    let mut world: World3 = world();
    let mut disk = body(Motion::Kinematic, [0.0; 3], Rigid3::cuboid([3.0, 0.1, 3.0]), &material);
    disk.velocity.angular = Vector([0.0, 1.0, 0.0]);
    world.add(disk).unwrap();
    let mut block = dynamic([2.0, 0.35, 0.0], Rigid3::cuboid([0.25; 3]), &material);
    // The box starts with the velocity of the platform below it.
    block.velocity =
        Velocity { linear: Vector([0.0, 0.0, -2.0]), angular: Vector([0.0, 1.0, 0.0]) };
    let block = world.add(block).unwrap();
    run(&mut world, 2.0);
    let (sin, cos) = 2.0f32.sin_cos();
    let off = place(&world, block) - Vector([2.0 * cos, 0.35, -2.0 * sin]);
    assert_below("off the circle after 2 rad [m]", off.length(), 0.01);
}

// Shapes

fn compounds<G: Rigid<L, A>, const L: usize, const A: usize>() {
    let material = surface(0.5, 0.0);
    let drop = |compound: bool| {
        let mut world = world::<G, L, A>();
        add_floor(&mut world, &material);
        let mut block = dynamic(v(0.0, 2.0, 0.0), G::cuboid(v(1.0, 0.5, 0.5)), &material);
        if compound {
            let half = G::cuboid([0.5; L]);
            block.colliders = [-0.5, 0.5]
                .map(|x| Collider {
                    pose: G::pose(Vector(v(x, 0.0, 0.0)), &[]),
                    material: material.clone(),
                    ..Collider::new(half.clone())
                })
                .into();
        }
        block.pose = G::turned(v(0.0, 2.0, 0.0), 0.3);
        let block = world.add(block).unwrap();
        let mut force = Velocity::ZERO;
        force.linear[0] = 1e4;
        force.angular = Vector(std::array::from_fn(|i| if i + 1 == A { 1e4 } else { 0.0 }));
        world.add_force(block, force).unwrap();
        world.step(DT).unwrap();
        let pushed = velocity(&world, block);
        run(&mut world, 4.0);
        (pushed, place(&world, block)[1], upright(&world, block))
    };
    let (one, two) = (drop(false), drop(true));
    let scale = one.0.angular.length() + one.0.linear.length();
    let apart = (one.0.linear - two.0.linear).length() + (one.0.angular - two.0.angular).length();
    assert_below(&format!("{L}D: one box against two halves"), apart / scale, 1e-5);
    for (name, (_, height, upright)) in [("one box", one), ("two halves", two)] {
        assert_within(&format!("{L}D: {name}: height of rest [m]"), height, 0.5, 1e-3);
        assert_within(&format!("{L}D: {name}: upright"), upright, 1.0, 1e-4);
    }
}

/// A box of two halves accelerates as a whole one within 1e-5. Both come to rest at the height of
/// 0.5 m within 0.1 %.
#[test]
fn a_compound_moves_as_one_body() {
    compounds::<Rigid2, 2, 1>();
    compounds::<Rigid3, 3, 3>();
}

/// Puts down a body of two equal cubes, the upper one shifted by `reach`.
fn center_of_mass<G: Rigid<L, A>, const L: usize, const A: usize>() {
    for (reach, stands) in [(0.9, true), (1.3, false)] {
        let material = surface(0.8, 0.0);
        let mut world = world::<G, L, A>();
        add_floor(&mut world, &material);
        // A cube of half width 0.5 m, and another on top of it, shifted by `reach`.
        let mut tee = dynamic(v(0.0, 0.5, 0.0), G::cuboid([0.5; L]), &material);
        tee.colliders.push(Collider {
            pose: G::pose(Vector(v(reach, 1.0, 0.0)), &[]),
            material: material.clone(),
            ..Collider::new(G::cuboid([0.5; L]))
        });
        let tee = world.add(tee).unwrap();
        run(&mut world, 3.0);
        let upright = upright(&world, tee);
        assert!((upright > 0.9999) == stands, "{L}D: reach {reach}: upright {upright}");
    }
}

/// A body of two equal cubes stands only while its center of mass is above the lower one: with the
/// upper one shifted by 0.9 m, but not by 1.3 m.
#[test]
fn a_compound_tips_about_its_own_center() {
    center_of_mass::<Rigid2, 2, 1>();
    center_of_mass::<Rigid3, 3, 3>();
}

/// Frictionless bodies do not feel the inner edges of a flat mesh. Within 4 s they leave the plane
/// by less than 1 mm, change velocity by less than 3 mm/s and spin below 0.01 rad/s.
#[test]
fn inner_edges_of_a_mesh_cause_no_ghost_collisions() {
    let smooth = surface(0.0, 0.0);
    let shapes = [
        ("box", Rigid3::cuboid([0.3, 0.2, 0.25]), 0.2),
        ("ball", Rigid3::ball(0.2), 0.2),
        ("capsule", Rigid3::capsule(0.3, 0.15), 0.15),
    ];
    for (name, shape, height) in shapes {
        let mut world: World3 = world();
        world.add(body(Motion::Static, [0.0; 3], grid(20, 20.0), &smooth)).unwrap();
        let mut slider = dynamic([-6.3, height, -1.7], shape, &smooth);
        if name == "capsule" {
            slider.pose = Rigid3::turned([-6.3, height, -1.7], std::f32::consts::FRAC_PI_2);
        }
        let slider = world.add(moving(slider, [3.0, 0.0, 0.7])).unwrap();
        let mut off = 0.0f32;
        for _ in 0..240 {
            world.step(DT).unwrap();
            off = off.max((place(&world, slider)[1] - height).abs());
        }
        let speed = velocity(&world, slider);
        assert_below(&format!("{name}: off the plane [m]"), off, 1e-3);
        let change = (speed.linear - Vector([3.0, 0.0, 0.7])).length();
        assert_below(&format!("{name}: change of the velocity [m/s]"), change, 3e-3);
        assert_below(&format!("{name}: spin [rad/s]"), speed.angular.length(), 1e-2);
    }
}

/// A ball that rolls over a flat mesh keeps its speed for 4 s within 0.2 %.
#[test]
fn a_ball_rolls_evenly_over_a_mesh() {
    let rough = surface(0.5, 0.0);
    let mut world: World3 = world();
    world.add(body(Motion::Static, [0.0; 3], grid(20, 20.0), &rough)).unwrap();
    let mut ball = dynamic([-6.3, 0.25, -1.7], Rigid3::ball(0.25), &rough);
    ball.velocity = Velocity { linear: Vector([2.0, 0.0, 0.0]), angular: Vector([0.0, 0.0, -8.0]) };
    let ball = world.add(ball).unwrap();
    run(&mut world, 4.0);
    assert_within("speed [m/s]", velocity(&world, ball).linear[0], 2.0, 2e-3);
    assert_within("way [m]", place(&world, ball)[0], 1.7, 2e-3);
}

// Properties of bodies

/// A ball rests on a slab if the filters of both accept the other, and falls through otherwise.
#[test]
fn filters_say_who_collides() {
    let material = surface(0.5, 0.0);
    let only =
        |systems, collides_with| Filter { systems, collides_with, collides_with_unnamed: false };
    // The filter of each must accept the other.
    let cases = [
        (only(1, 2), only(2, 1), true),
        (only(1, 2), only(2, 4), false),
        (only(1, 4), only(2, 1), false),
        (only(0, 2), only(2, 1), false),
        (Filter::default(), only(2, 1), false),
        (Filter::default(), Filter::default(), true),
    ];
    for (above, below, rests) in cases {
        let mut world: World2 = world();
        let mut slab = body(Motion::Static, [0.0, -0.5], Rigid2::cuboid([5.0, 0.5]), &material);
        slab.colliders[0].filter = below;
        world.add(slab).unwrap();
        let mut ball = dynamic([0.0, 1.0], Rigid2::ball(0.5), &material);
        ball.colliders[0].filter = above;
        let ball = world.add(ball).unwrap();
        run(&mut world, 2.0);
        let height = place(&world, ball)[1];
        assert!((height > 0.4) == rests, "{above:?} on {below:?}: {height} m");
    }
}

/// A removed body is gone, and its identifier never refers to the body that reuses its slot. The
/// box above it falls to rest at its height within 0.1 %.
#[test]
fn removed_bodies_are_gone_and_never_mistaken() {
    let material = surface(0.5, 0.0);
    let mut world: World3 = world();
    let floor = add_floor(&mut world, &material);
    let low = world.add(dynamic([0.0, 0.5, 0.0], Rigid3::cuboid([0.5; 3]), &material)).unwrap();
    let high = world.add(dynamic([0.0, 1.5, 0.0], Rigid3::cuboid([0.5; 3]), &material)).unwrap();
    run(&mut world, 1.0);
    assert!(world.remove(low));
    assert!(!world.remove(low), "removed twice");
    assert_eq!(world.pose(low), None);
    assert_eq!(world.velocity(low), None);
    let fast = Velocity { linear: Vector([9.0; 3]), angular: Vector::ZERO };
    assert_eq!(world.set_velocity(low, fast), Err(InputError::UnknownBody));
    run(&mut world, 2.0);
    assert_within("the upper box has come down [m]", place(&world, high)[1], 0.5, 1e-3);

    let again = world.add(dynamic([3.0, 0.5, 0.0], Rigid3::cuboid([0.5; 3]), &material)).unwrap();
    assert_eq!(again.index(), low.index(), "the slot is used again");
    assert_ne!(again, low);
    assert_eq!(world.pose(low), None, "the old name has come to life");
    assert!(!world.remove(low), "the old name removed the new body");
    let strong = Velocity { linear: Vector([1e9; 3]), angular: Vector::ZERO };
    assert_eq!(world.add_force(low, strong), Err(InputError::UnknownBody));
    run(&mut world, 1.0);
    assert_within("the new box [m]", place(&world, again)[1], 0.5, 1e-3);
    assert_below("way of the new box [m]", (place(&world, again)[0] - 3.0).abs(), 1e-3);

    assert!(world.remove(floor));
    run(&mut world, 1.0);
    assert_below("fallen without a floor [m]", place(&world, high)[1], -3.0);
    assert_eq!(world.len(), 3);
}

fn masses<G: RoundShapes<L, A>, const L: usize, const A: usize>() {
    let hard = surface(0.0, 1.0);
    let mut world = weightless::<G, L, A>();
    let light = dynamic(v(-1.5, 0.0, 0.0), G::ball(0.5), &hard);
    let light = world.add(moving(weighing(light, 1.0), v(4.0, 0.0, 0.0))).unwrap();
    let heavy = world.add(weighing(dynamic([0.0; L], G::ball(0.5), &hard), 3.0)).unwrap();
    run(&mut world, 0.5);
    // (m - M) / (m + M) and 2 m / (m + M) of the initial speed.
    let what = format!("({L},{A}): after an impact of 1 kg on 3 kg [m/s]");
    assert_within(&what, velocity(&world, light).linear[0], -2.0, 1e-5);
    assert_within(&what, velocity(&world, heavy).linear[0], 2.0, 1e-5);
}

/// An elastic impact of 1 kg on 3 kg gives the velocities of the formula within 1e-5.
#[test]
fn impacts_have_the_stated_masses() {
    masses::<Particles, 2, 0>();
    masses::<Particles, 3, 0>();
    masses::<Rigid2, 2, 1>();
    masses::<Rigid3, 3, 3>();
}

/// A body of infinite mass keeps its pose and velocity exactly, and one of infinite moments its
/// rotation.
#[test]
fn infinite_mass_and_inertia_are_not_moved() {
    let material = surface(0.5, 0.0);
    // Neither impacts nor gravity move a body of infinite mass.
    let mut world: World3 = world();
    let mut anvil = dynamic([0.0, 2.0, 0.0], Rigid3::cuboid([0.5; 3]), &material);
    anvil.inertia = Some(Inertia::FIXED);
    let anvil = world.add(anvil).unwrap();
    let ball = dynamic([0.3, 3.5, 0.1], Rigid3::ball(0.5), &material);
    world.add(moving(ball, [0.0, -20.0, 0.0])).unwrap();
    run(&mut world, 1.0);
    assert_eq!(place(&world, anvil).0, [0.0, 2.0, 0.0]);
    assert_eq!(velocity(&world, anvil), Velocity::ZERO);

    // A body of infinite moments that lands with its center beyond the edge stays level.
    let mut world: World3 = weightless();
    world.gravity = Vector([0.0, -GRAVITY, 0.0]);
    world.add(body(Motion::Static, [0.0; 3], Rigid3::cuboid([0.5; 3]), &material)).unwrap();
    let mut stiff = dynamic([0.8, 1.5, 0.0], Rigid3::cuboid([0.5; 3]), &material);
    stiff.inertia = Some(Inertia {
        mass: 1.0,
        center: Vector::ZERO,
        moments: SymmetricMatrix::ZERO,
        inverse_moments: SymmetricMatrix::ZERO,
    });
    let pose = |world: &World3, id| world.pose(id).unwrap();
    let stiff = world.add(stiff).unwrap();
    let before = pose(&world, stiff).rotation;
    run(&mut world, 2.0);
    assert_eq!(pose(&world, stiff).rotation, before);
    assert_within("height of rest [m]", place(&world, stiff)[1], 1.0, 1e-3);
}

fn gravity_factors<G: RoundShapes<L, A>, const L: usize, const A: usize>() {
    let mut world = world::<G, L, A>();
    let factors = [-1.0, 0.0, 0.5, 2.0];
    let bodies = factors.map(|factor| {
        let ball = dynamic(v(3.0 * factor, 0.0, 0.0), G::ball(0.5), &surface(0.5, 0.0));
        world.add(Body { gravity_factor: factor, ..ball }).unwrap()
    });
    run(&mut world, 1.0);
    for (factor, id) in factors.into_iter().zip(bodies) {
        let speed = velocity(&world, id).linear[1];
        assert_within(&format!("({L},{A}): {factor} g for 1 s"), speed, -GRAVITY * factor, 1e-4);
    }
}

/// Gravity accelerates each body by its factor, within 1e-4.
#[test]
fn gravity_acts_by_its_factor() {
    gravity_factors::<Particles, 2, 0>();
    gravity_factors::<Particles, 3, 0>();
    gravity_factors::<Rigid2, 2, 1>();
    gravity_factors::<Rigid3, 3, 3>();
}

/// The contact of a hull with a floor contains the lowest corner of the hull, whichever faces point
/// down: the deepest gap is the true one within 1 %.
#[test]
fn the_lowest_corner_of_a_hull_touches() {
    let floor = |kind| match kind {
        0 => (Rigid3::halfspace([0.0, 1.0, 0.0]), 0.0),
        _ => (Rigid3::cuboid([9.0, 1.0, 9.0]), -1.0),
    };
    let mut random = Random(5);
    for round in 0..400 {
        let mut flat = || random.between(-0.3f32, 0.3);
        let points: Vec<[f32; 3]> = (0..12).map(|_| [flat(), flat() * 0.3, flat()]).collect();
        let turn = Vector([flat(), flat(), flat()]) * 9.0;
        let (hull, (floor, height)) = (Rigid3::hull(&points), floor(round % 2));
        let upright = Rigid3::pose(Vector::ZERO, &[]);
        let turned = Rigid3::advance(&upright, Vector::ZERO, turn);
        let lowest = Rigid3::bounds(&hull, &turned).min[1];
        // 1 mm deep, so that the top of a box-shaped floor is the axis of least overlap.
        let pose = Rigid3::advance(&turned, Vector([0.0, -lowest - 0.001, 0.0]), Vector::ZERO);
        let base = Rigid3::pose(Vector([0.0, height, 0.0]), &[]);
        let mut deepest = f32::INFINITY;
        let mut memory = Default::default();
        let [hull, floor] = [hull, floor].map(Rigid3::prepare);
        Rigid3::collide((&hull, &pose), (&floor, &base), 0.01, None, &mut memory, &mut |touch| {
            assert!(touch.normal[1] > 0.999, "round {round}: {:?}", touch.normal);
            deepest = touch.points.iter().map(|point| point.gap).fold(deepest, f32::min);
        });
        assert_within(&format!("round {round}: deepest gap [m]"), deepest, -0.001, 0.01);
    }
}

/// Contact points of two stacked boxes lie within 1 mm of both. This holds even if edges are almost
/// coplanar, so that rounding dominates their crossing.
#[test]
fn points_of_contact_lie_on_both_boxes() {
    let half = [0.2, 0.15, 0.12];
    let lower = Rigid3::pose(Vector::ZERO, &[]);
    let mut memory = Default::default();
    let mut random = Random(7);
    for round in 0..20_000 {
        let slight = 10f32.powf(random.between(-6.0, -1.0));
        let mut aside = || random.between(-slight, slight);
        let turn = Vector([aside(), aside(), aside()]);
        let over = Vector([aside(), 2.0 * half[1] + 1e-3 * aside(), aside()]);
        let upper = Rigid3::advance(&lower, over, turn);
        let shape = Rigid3::prepare(Rigid3::cuboid(half));
        Rigid3::collide(
            (&shape, &upper),
            (&shape, &lower),
            0.01,
            None,
            &mut memory,
            &mut |touch| {
                for point in &touch.points {
                    for (place, pose) in [(point.on_a, &upper), (point.on_b, &lower)] {
                        let local = Rigid3::frame(pose).local_point(place);
                        for i in 0..3 {
                            let outside = local[i].abs() - half[i];
                            assert_below(&format!("round {round}: outside [m]"), outside, 1e-3);
                        }
                    }
                }
            },
        );
    }
}

/// Boxes that fall onto each other at 5 m/s overlap by less than 12 mm in the mean of four runs.
/// Contacts are searched again while the boxes rotate and push each other.
#[test]
fn falling_boxes_penetrate_less_than_12_mm() {
    falling_boxes(drystone::StepSettings::quality());
    falling_boxes(drystone::StepSettings::certified());
}

/// Asserts the bound on the mean of four runs, because the deepest overlap of one run is random.
fn falling_boxes(settings: drystone::StepSettings) {
    let deepest = [11, 12, 13, 14].map(|seed| deepest_of_rain(seed, settings.clone()));
    println!("deepest overlaps {deepest:?} m");
    assert_below("deepest overlap [m]", deepest.iter().sum::<f64>() as f32 / 4.0, 0.012);
}

fn deepest_of_rain(seed: u64, settings: drystone::StepSettings) -> f64 {
    let material = surface(0.5, 0.0);
    let mut world: World3 = world();
    world.settings = settings;
    add_floor(&mut world, &material);
    let mut random = Random(seed);
    for i in 0..60 {
        let mut aside = || random.between(-0.3f32, 0.3);
        let turn = Vector([aside(), aside(), aside()]) * 9.0;
        let upright = Rigid3::pose(Vector([aside(), 1.0 + 0.56 * i as f32, aside()]), &[]);
        let mut block = dynamic([0.0; 3], Rigid3::cuboid([0.2, 0.15, 0.12]), &material);
        block.pose = Rigid3::advance(&upright, Vector::ZERO, turn);
        block.velocity.linear = Vector([0.0, -5.0, 0.0]);
        world.add(block).unwrap();
    }
    let mut deepest = 0.0f64;
    for _ in 0..240 {
        world.step(DT).unwrap();
        deepest = deepest.max(world.measure().deepest_penetration);
    }
    deepest
}

/// Steps for `seconds` with a tolerance of 1 mm/s and asserts that every step is within it. Returns
/// the deepest overlap at the end. \[m\]
fn certified(world: &mut World3, seconds: f32) -> f32 {
    world.settings.tolerance = 1e-3;
    world.settings.substeps = 8;
    for step in 0..(seconds / DT) as usize {
        let outcome = world.step(DT).unwrap().certified.expect("a tolerance is set");
        assert_eq!(outcome.failed, 0, "step {step}: {outcome:?}");
        assert!(outcome.error <= 1e-3, "step {step}: {outcome:?}");
    }
    world.measure().deepest_penetration as f32
}

/// A box 1000 times heavier than each of the nine below it: the overlap is below 0.1 mm after 3 s,
/// and every step is within 1 mm/s. Sweeps alone would need thousands of iterations.
#[test]
fn heavy_on_light_is_solved_to_a_tolerance() {
    let material = surface(0.5, 0.0);
    let mut world: World3 = world();
    add_floor(&mut world, &material);
    let mut boxes = Vec::new();
    for i in 0..10 {
        let mut block = dynamic([0.0, 0.5 + i as f32, 0.0], Rigid3::cuboid([0.5; 3]), &material);
        if i == 9 {
            block.colliders[0].density *= 1000.0;
        }
        boxes.push(world.add(block).unwrap());
    }
    let deepest = certified(&mut world, 3.0);
    assert_below("deepest overlap [m]", deepest, 1e-4);
    for (i, &block) in boxes.iter().enumerate() {
        let off = place(&world, block) - Vector([0.0, 0.5 + i as f32, 0.0]);
        assert_below(&format!("box {i} off its place [m]"), off.length(), 2e-3);
    }
}

/// Returns a world of thirty boxes of random orientation above a floor.
fn heap(restitution: f64) -> World3 {
    let material = surface(0.5, restitution);
    let mut world: World3 = world();
    add_floor(&mut world, &material);
    let mut random = Random(3);
    for i in 0..30 {
        let mut aside = || random.between(-0.4f32, 0.4);
        let turn = Vector([aside(), aside(), aside()]) * 5.0;
        let upright = Rigid3::pose(Vector([aside(), 0.5 + 0.4 * i as f32, aside()]), &[]);
        let mut block = dynamic([0.0; 3], Rigid3::cuboid([0.2, 0.15, 0.12]), &material);
        block.pose = Rigid3::advance(&upright, Vector::ZERO, turn);
        world.add(block).unwrap();
    }
    world
}

/// A falling heap of boxes that bounce and slide is solved within 1 mm/s in every step of 3 s.
#[test]
fn a_falling_heap_is_solved_to_a_tolerance() {
    certified(&mut heap(0.3), 3.0);
}

/// While a heap falls, iterations end at a fraction of its speed, and the largest error is 0.5 to 1
/// mm/s. When all bodies are slower than 1 cm/s, it is at most 0.5 mm/s.
#[test]
fn fast_islands_are_solved_to_a_fraction_of_their_speed() {
    let mut world = heap(0.0);
    (world.settings.tolerance, world.settings.substeps) = (1e-3, 8);
    let mut worst = [0.0f64; 2];
    for _ in 0..360 {
        let slow = world.measure().fastest < 0.01;
        let outcome = world.step(DT).unwrap().certified.expect("a tolerance is set");
        let worst = &mut worst[usize::from(slow)];
        *worst = worst.max(outcome.error);
    }
    let [moving, resting] = worst;
    assert!(moving > 5e-4 && moving <= 1e-3, "moving: {moving} m/s");
    assert!(resting > 0.0 && resting <= 5e-4, "slower than 1 cm/s: {resting} m/s");
}

/// A heap at rest begins each substep with its solution, so one iteration certifies it: eight for a
/// step. A step of the falling heap takes more than 64.
#[test]
fn bodies_at_rest_are_certified_at_once() {
    let mut world = heap(0.0);
    world.settings = StepSettings::certified();
    let mut iterations = || world.step(DT).unwrap().certified.unwrap().iterations;
    let first: usize = (0..60).map(|_| iterations()).max().unwrap();
    assert!(first > 8 * 8, "{first} iterations in eight substeps, while it falls");
    (0..420).for_each(|_| assert!(iterations() >= 8));
    (0..20).for_each(|step| assert_eq!(iterations(), 8, "{step} steps later"));
}

/// A stack of ten bricks that has been pushed comes to rest. At the aim of moving islands, the error
/// left by each substep kept it swaying by 0.08 mm, at 1.3 mm/s.
#[test]
fn a_pushed_stack_stops_swaying() {
    let material = surface(0.8, 0.0);
    let mut world = World3::new(StepSettings::certified());
    world.gravity = Vector([0.0, -9.81, 0.0]);
    add_floor(&mut world, &material);
    for height in (0..10).map(|level| 0.1 + 0.2 * level as f32) {
        let brick = dynamic([0.0, height, 0.0], Rigid3::cuboid([0.2, 0.1, 0.1]), &material);
        world.add(moving(brick, [0.0, 0.0, 0.01 * height])).unwrap();
    }
    run(&mut world, 3.0);
    for step in 0..30 {
        world.step(DT).unwrap();
        let fastest = world.measure().fastest;
        assert!(fastest < 3e-4, "{fastest} m/s after 3 s and {step} steps");
    }
}

/// An island of infinite masses has no root mean square by mass. The solver gives it up in fewer
/// than 8000 iterations per step.
#[test]
fn islands_of_infinite_mass_are_given_up() {
    let material = surface(0.5, 0.0);
    let mut world = World3::new(StepSettings::certified());
    world.gravity = Vector([0.0, -9.81, 0.0]);
    add_floor(&mut world, &material);
    let mut wheel = dynamic([0.0, 0.45, 0.0], Rigid3::cuboid([0.5; 3]), &material);
    let moments = SymmetricMatrix(std::array::from_fn(|i| {
        Vector(std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }))
    }));
    wheel.inertia = Some(Inertia { moments, inverse_moments: moments, ..Inertia::FIXED });
    wheel.velocity.angular = Vector([0.0, 3.0, 0.5]);
    world.add(wheel).unwrap();
    for step in 0..10 {
        let outcome = world.step(DT).unwrap().certified.unwrap();
        assert!(outcome.iterations < 8 * 1000, "step {step}: {outcome:?}");
    }
    assert!(world.measure().finite);
}

/// Stages of a step are timed only on request. Their sum is then at most the time of the step.
#[test]
fn stages_are_timed_on_request() {
    let material = surface(0.5, 0.0);
    let mut world = World3::new(StepSettings::certified());
    world.gravity = Vector([0.0, -9.81, 0.0]);
    add_floor(&mut world, &material);
    world.add(dynamic([0.0, 0.5, 0.0], Rigid3::cuboid([0.5; 3]), &material)).unwrap();
    assert_eq!(world.step(DT).unwrap().time(), Duration::ZERO);
    world.time_stages(true);
    let start = Instant::now();
    let report = world.step(DT).unwrap();
    assert!(report.time() <= start.elapsed());
    for stage in [Stage::Manifolds, Stage::Solve, Stage::Certify, Stage::Advance] {
        assert!(report.stages[stage as usize] > Duration::ZERO, "{}", stage.name());
    }
}
