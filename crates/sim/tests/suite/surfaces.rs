//! Tests of moving surfaces (belts), resistance to rolling and spinning, and damping: against
//! closed-form answers, and read from files.

use drystone::Dimension;
use drystone::geometry::{Rigid2, Rigid3};
use drystone::{Body, BodyId, Material, Motion, StepSettings, SurfaceVelocity, World};
use drystone_solver::{Vector, Velocity};

use crate::common::{
    DT, GRAVITY, Rigid, RoundShapes, add_floor, assert_above, assert_below, assert_within, dynamic,
    place, run, surface, v, velocity,
};

fn presets() -> [StepSettings; 3] {
    [StepSettings::quality(), StepSettings::certified(), StepSettings::realtime()]
}

fn world_of<G: Dimension<L, A>, const L: usize, const A: usize>(
    settings: &StepSettings,
) -> World<G, L, A> {
    let mut world = World::new(settings.clone());
    world.gravity = Vector(v(0.0, -GRAVITY, 0.0));
    world
}

/// Adds a box as a floor with this surface motion, `size` thick and with its top at y = 0.
fn add_belt<G: Rigid<L, A>, const L: usize, const A: usize>(
    world: &mut World<G, L, A>,
    size: f32,
    motion: SurfaceVelocity<L, A>,
) -> BodyId {
    let shape = G::cuboid(v(200.0 * size, 0.5 * size, 200.0 * size));
    let mut belt = Body::new(Motion::Static, v(0.0, -0.5 * size, 0.0), shape);
    belt.surface_velocity = Some(motion);
    world.add(belt).unwrap()
}

fn crate_on<G: Rigid<L, A>, const L: usize, const A: usize>(
    world: &mut World<G, L, A>,
    size: f32,
    material: &Material,
) -> BodyId {
    let shape = G::cuboid([0.5 * size; L]);
    world.add(dynamic(v(0.0, 0.5 * size, 0.0), shape, material)).unwrap()
}

/// Puts a crate on a belt, which accelerates it at mu g to its own speed and then carries it: the
/// position is known.
fn rides<G: Rigid<L, A>, const L: usize, const A: usize>(size: f32, settings: &StepSettings) {
    let mut world: World<G, L, A> = world_of(settings);
    // The crate has the speed of the belt after a third of a second.
    let speed = 0.5 * GRAVITY / 3.0;
    add_belt(&mut world, size.max(0.05), SurfaceVelocity::linear(Vector(v(speed, 0.0, 0.0))));
    let id = crate_on(&mut world, size, &surface(0.5, 0.0));
    run(&mut world, 0.2);
    let sliding = velocity(&world, id).linear[0];
    assert_within("while it slides", sliding, 0.5 * GRAVITY * 0.2, 0.02);
    run(&mut world, 1.8);
    let last = velocity(&world, id);
    assert_within("with the belt", last.linear[0], speed, 1e-3);
    assert_below("beside it", last.linear.0[1..].iter().fold(0.0, |m, x| x.abs().max(m)), 1e-3);
    let expected = speed * 2.0 - speed * speed / GRAVITY;
    assert_within("how far", place(&world, id)[0], expected, 0.01);
    assert_below("off the belt", (place(&world, id)[1] - 0.5 * size).abs(), 0.02 * size.max(0.02));
}

/// A crate on a belt accelerates at mu g within 2 % and then moves with it within 0.1 %. This holds
/// in all presets and at sizes from 1 cm to 5 m.
#[test]
fn a_crate_gets_the_speed_of_the_belt() {
    for settings in &presets() {
        rides::<Rigid3, 3, 3>(0.5, settings);
        rides::<Rigid2, 2, 1>(0.5, settings);
    }
    for size in [0.01, 0.1, 5.0] {
        rides::<Rigid3, 3, 3>(size, &StepSettings::quality());
    }
}

/// A belt on a tilted body carries a crate uphill, along its surface, at 1 m/s within 0.2 %. With a
/// velocity in the frame of the world, only the component along the surface acts.
#[test]
fn a_belt_runs_in_the_frame_of_its_body_or_of_the_world() {
    let climbs = |local: bool| {
        let mut world: World<Rigid3, 3, 3> = world_of(&StepSettings::quality());
        let angle = 0.2_f32;
        let shape = Rigid3::cuboid([20.0, 0.5, 5.0]);
        let mut belt = Body::new(Motion::Static, [0.0; 3], shape);
        belt.pose = Rigid3::turned([0.0; 3], angle);
        belt.colliders[0].material = surface(1.0, 0.0);
        let motion = SurfaceVelocity::linear(Vector([1.0, 0.0, 0.0]));
        belt.surface_velocity = Some(SurfaceVelocity { local, ..motion });
        world.add(belt).unwrap();
        let mut load = dynamic([0.0; 3], Rigid3::cuboid([0.25; 3]), &surface(1.0, 0.0));
        let up = [-0.75 * angle.sin(), 0.75 * angle.cos(), 0.0];
        load.pose = Rigid3::turned(up, angle);
        let id = world.add(load).unwrap();
        run(&mut world, 2.0);
        let [x, y, z] = velocity(&world, id).linear.0;
        assert_below("across", z.abs(), 1e-3);
        [x, y, angle]
    };
    let [x, y, angle] = climbs(true);
    assert_within("along", x.hypot(y), 1.0, 2e-3);
    assert_within("uphill", y, angle.sin(), 0.01);
    let [x, y, angle] = climbs(false);
    assert_within("of the world's", x.hypot(y), angle.cos(), 2e-3);
}

/// A static table whose surface rotates carries a box around, with the motion given on its shape or
/// its body. After 4 s the radius is right within 4 % and the angle within 2 %.
#[test]
fn a_standing_turntable_with_a_surface_velocity_carries_bodies_around() {
    for of_shape in [false, true] {
        let mut world: World<Rigid3, 3, 3> = world_of(&StepSettings::quality());
        let omega = 1.5;
        let motion = SurfaceVelocity::angular(Vector([0.0, omega, 0.0]));
        let mut table =
            Body::new(Motion::Static, [3.0, -0.5, 1.0], Rigid3::cuboid([4.0, 0.5, 4.0]));
        if of_shape {
            table.colliders[0].surface_velocity = Some(motion);
        } else {
            table.surface_velocity = Some(motion);
        }
        world.add(table).unwrap();
        let material = surface(0.8, 0.0);
        let mut load = dynamic([4.0, 0.1, 1.0], Rigid3::cuboid([0.1; 3]), &material);
        load.velocity.linear = Vector([0.0, 0.0, -omega]);
        load.velocity.angular = Vector([0.0, omega, 0.0]);
        let id = world.add(load).unwrap();
        run(&mut world, 4.0);
        let [x, _, z] = place(&world, id).0;
        assert_within("radius", (x - 3.0).hypot(z - 1.0), 1.0, 0.04);
        let angle = f32::atan2(-(z - 1.0), x - 3.0).rem_euclid(std::f32::consts::TAU);
        assert_within("angle", angle, 4.0 * omega, 0.02);
        assert_within("turning", velocity(&world, id).angular[1], omega, 0.01);
    }
}

/// A body with a moving surface drives on a floor, and against a moving belt. Its speed is the sum
/// of both within 2 mm/s.
#[test]
fn both_surfaces_run() {
    for (belt, expected) in [(0.0, 1.0), (0.5, 1.5), (-1.0, 0.0)] {
        let mut world: World<Rigid3, 3, 3> = world_of(&StepSettings::quality());
        add_belt(&mut world, 1.0, SurfaceVelocity::linear(Vector([belt, 0.0, 0.0])));
        let mut crawler =
            dynamic([0.0, 0.25, 0.0], Rigid3::cuboid([0.5, 0.25, 0.5]), &surface(0.5, 0.0));
        crawler.surface_velocity = Some(SurfaceVelocity::linear(Vector([-1.0, 0.0, 0.0])));
        let id = world.add(crawler).unwrap();
        run(&mut world, 2.0);
        let speed = velocity(&world, id).linear[0];
        assert_below("speed", (speed - expected).abs(), 2e-3);
    }
}

/// A surface velocity of zero changes no bit.
#[test]
fn a_belt_with_zero_velocity_changes_nothing() {
    let poses = |motion: Option<f32>| {
        let mut world: World<Rigid3, 3, 3> = world_of(&StepSettings::quality());
        let belt = add_belt(&mut world, 1.0, SurfaceVelocity::linear(Vector::ZERO));
        world
            .set_surface_velocity(
                belt,
                motion.map(|x| SurfaceVelocity::linear(Vector([x, 0.0, 0.0]))),
            )
            .unwrap();
        let mut load = dynamic([0.0, 1.0, 0.0], Rigid3::cuboid([0.3; 3]), &surface(0.5, 0.0));
        load.velocity.angular = Vector([1.0, 2.0, 3.0]);
        world.add(load).unwrap();
        run(&mut world, 1.0);
        let mut poses = Vec::new();
        world.write_poses(&mut poses);
        poses
    };
    assert_eq!(poses(None), poses(Some(0.0)));
    assert_ne!(poses(None), poses(Some(0.5)));
}

/// Rolls a ball with rolling resistance, which slows it at rho g / (1.4 r), or a disk at rho g /
/// (1.5 r). It stays where it has come to rest.
fn slows<G: Rigid<L, A>, const L: usize, const A: usize>(
    radius: f32,
    share: f32,
    settings: &StepSettings,
) {
    let mut world: World<G, L, A> = world_of(settings);
    add_floor(&mut world, &surface(0.5, 0.0));
    let rho = 0.02 * radius;
    let material = Material { rolling_resistance: f64::from(rho), ..surface(0.5, 0.0) };
    let speed = (GRAVITY * radius).sqrt();
    let mut ball = dynamic(v(0.0, radius, 0.0), G::ball(radius), &material);
    ball.velocity.linear = Vector(v(speed, 0.0, 0.0));
    ball.velocity.angular[A - 1] = -speed / radius;
    let id = world.add(ball).unwrap();
    let slowing = rho * GRAVITY / (radius * share);
    let stop = speed / slowing;
    let dt = stop / 60.0;
    for _ in 0..30 {
        world.step(dt).unwrap();
    }
    assert_within("half as fast", velocity(&world, id).linear[0], 0.5 * speed, 0.02);
    for _ in 0..60 {
        world.step(dt).unwrap();
    }
    let rest = place(&world, id)[0];
    assert_within("how far", rest, 0.5 * speed * stop, 0.02);
    for _ in 0..60 {
        world.step(dt).unwrap();
    }
    assert_below("at rest", (place(&world, id)[0] - rest).abs(), 1e-4 * radius);
}

/// Rolling resistance stops a ball at the time and distance of the formula within 2 %. This holds
/// in all presets and at radii from 1 cm to 1 m.
#[test]
fn rolling_resistance_slows_at_the_rate_on_paper() {
    for settings in &presets() {
        slows::<Rigid3, 3, 3>(0.1, 1.4, settings);
        slows::<Rigid2, 2, 1>(0.1, 1.5, settings);
    }
    for radius in [0.01, 1.0] {
        slows::<Rigid3, 3, 3>(radius, 1.4, &StepSettings::quality());
    }
}

/// On a slope below atan(rho / r) a ball creeps by less than 3 % of its radius in 3 s. On a steeper
/// one it rolls at the remaining acceleration, the distance within 3 %.
#[test]
fn a_ball_stays_on_a_slight_slope() {
    for settings in &presets() {
        for (slope, rolls) in [(0.03_f32, false), (0.1, true)] {
            let mut world: World<Rigid3, 3, 3> = world_of(settings);
            let normal = [slope.sin(), slope.cos(), 0.0];
            let floor = Body::new(Motion::Static, [0.0; 3], Rigid3::halfspace(normal));
            world.add(floor).unwrap();
            let (radius, rho) = (0.1, 0.005);
            let material = Material { rolling_resistance: f64::from(rho), ..surface(0.5, 0.0) };
            let at = normal.map(|x| x * radius);
            let id = world.add(dynamic(at, Rigid3::ball(radius), &material)).unwrap();
            run(&mut world, 3.0);
            let gone = (place(&world, id) - Vector(at)).length();
            if rolls {
                let pull = GRAVITY * (slope.sin() - rho / radius * slope.cos()) / 1.4;
                assert_within("how far it rolls", gone, 0.5 * pull * 9.0, 0.03);
            } else {
                assert_below("how far it creeps", gone, 3e-2 * radius);
            }
        }
    }
}

/// Spinning resistance slows a ball about the vertical at sigma m g / I within 2 %, and does not
/// reverse it.
#[test]
fn spinning_resistance_slows_at_the_rate_on_paper() {
    let mut world: World<Rigid3, 3, 3> = world_of(&StepSettings::quality());
    add_floor(&mut world, &surface(0.5, 0.0));
    let (radius, sigma, spin) = (0.1, 0.001, 5.0);
    let material = Material { spinning_resistance: f64::from(sigma), ..surface(0.5, 0.0) };
    let mut ball = dynamic([0.0, radius, 0.0], Rigid3::ball(radius), &material);
    ball.velocity.angular = Vector([0.0, spin, 0.0]);
    let id = world.add(ball).unwrap();
    run(&mut world, 1.0);
    let slowing = sigma * GRAVITY / (0.4 * radius * radius);
    assert_within("spin", velocity(&world, id).angular[1], spin - slowing, 0.02);
    run(&mut world, 2.0);
    assert_below("at rest", velocity(&world, id).angular.length(), 1e-3);
}

/// Resistance only takes energy. A heap of balls with it keeps less than 2 % of the kinetic energy
/// of one without.
#[test]
fn resistance_takes_energy_only() {
    let left = |rolling: f64| {
        let mut settings = StepSettings::quality();
        settings.ledger = true;
        let mut world: World<Rigid3, 3, 3> = world_of(&settings);
        let material = Material {
            rolling_resistance: rolling,
            spinning_resistance: rolling,
            ..surface(0.5, 0.0)
        };
        add_floor(&mut world, &material);
        for i in 0..20 {
            let at = [0.13 * (i % 3) as f32, 0.2 + 0.25 * (i / 3) as f32, 0.11 * (i % 2) as f32];
            world.add(dynamic(at, Rigid3::ball(0.1), &material)).unwrap();
        }
        let mut friction = 0.0_f64;
        for _ in 0..240 {
            let ledger = world.step(DT).unwrap().energy.unwrap();
            friction += ledger.friction;
            let scale = 1e-4 * (ledger.gravity.abs() + ledger.contacts.abs() + 1.0);
            assert!(ledger.unexplained().abs() < scale, "{ledger:?}");
        }
        (world.measure().kinetic_energy, friction)
    };
    let ((free, _), (held, friction)) = (left(0.0), left(0.01));
    assert!(held < 0.02 * free, "{held} J of {free} J");
    assert!(friction < 0.0, "{friction} J");
}

/// The ledger books the work of a belt as `driven`, within 2 % of the kinetic energy plus the
/// losses.
#[test]
fn ledgers_know_belts_and_damping() {
    let mut settings = StepSettings::certified();
    settings.ledger = true;
    let mut world: World<Rigid3, 3, 3> = world_of(&settings);
    add_belt(&mut world, 1.0, SurfaceVelocity::linear(Vector([1.0, 0.0, 0.0])));
    let mut load = dynamic([0.0, 0.25, 0.0], Rigid3::cuboid([0.25; 3]), &surface(0.5, 0.0));
    load.damping = [0.5, 0.5];
    let id = world.add(load).unwrap();
    let mut sum = drystone::Ledger::default();
    for _ in 0..60 {
        let report = world.step(DT).unwrap();
        sum.join(&report.energy.unwrap());
        let certified = report.certified.unwrap();
        assert!(certified.error <= f64::from(settings.tolerance), "{certified:?}");
    }
    let mass = 0.125 * 1000.0;
    assert_within("speed", velocity(&world, id).linear[0], 1.0, 5e-3);
    // Half of the work of the belt becomes heat until the crate has its speed. Damping takes its
    // part all the time.
    let (gained, lost) = (sum.kinetic, -sum.friction - sum.damping);
    assert_within("gained", gained as f32, 0.5 * mass, 0.02);
    assert_within("brought", sum.driven as f32, (gained + lost) as f32, 0.02);
    assert!(sum.damping < -0.4 * f64::from(mass) * 0.5 && sum.friction < 0.0, "{sum:?}");
    assert!(sum.unexplained().abs() < 1e-2, "{sum:?}");
}

/// Damping slows a body by exp(-d t) within 1e-4, at any step. With gravity the speed tends to g /
/// d within 4e-4.
#[test]
fn damping_is_exponential_at_any_step() {
    for steps in [24, 60, 240] {
        let mut world: World<Rigid3, 3, 3> = World::new(StepSettings::quality());
        let mut ball = dynamic([0.0; 3], Rigid3::ball(0.1), &surface(0.5, 0.0));
        ball.damping = [0.7, 1.3];
        ball.velocity.linear = Vector([2.0, 0.0, 0.0]);
        ball.velocity.angular = Vector([0.0, 3.0, 0.0]);
        let id = world.add(ball).unwrap();
        for _ in 0..2 * steps {
            world.step(1.0 / steps as f32).unwrap();
        }
        let Velocity { linear, angular } = velocity(&world, id);
        assert_within("velocity", linear[0], 2.0 * (-1.4_f32).exp(), 1e-4);
        assert_within("spin", angular[1], 3.0 * (-2.6_f32).exp(), 1e-4);
        world.gravity = Vector([0.0, -GRAVITY, 0.0]);
        for _ in 0..30 * steps {
            world.step(1.0 / steps as f32).unwrap();
        }
        // This close to the limit, damping in a substep is half a rounding of the velocity and
        // stops acting.
        assert_within("falling", velocity(&world, id).linear[1], -GRAVITY / 0.7, 4e-4);
    }
}

/// A crate that a belt pushes against a wall stays awake while the belt moves, and sleeps when it
/// stands. A belt that moves again wakes it.
#[test]
fn bodies_on_a_running_belt_do_not_sleep() {
    let mut settings = StepSettings::realtime();
    settings.sleep_delay = 0.5;
    let mut world: World<Rigid3, 3, 3> = world_of(&settings);
    let belt = add_belt(&mut world, 1.0, SurfaceVelocity::linear(Vector([1.0, 0.0, 0.0])));
    world.add(Body::new(Motion::Static, [1.0, 0.5, 0.0], Rigid3::cuboid([0.5, 0.5, 2.0]))).unwrap();
    let id = crate_on(&mut world, 0.5, &surface(0.5, 0.0));
    run(&mut world, 4.0);
    assert!(!world.is_sleeping(id), "on a running belt");
    assert_below("at the wall", velocity(&world, id).linear.length(), 1e-2);
    world.set_surface_velocity(belt, None).unwrap();
    run(&mut world, 3.0);
    assert!(world.is_sleeping(id), "on one that stands");
    world
        .set_surface_velocity(belt, Some(SurfaceVelocity::linear(Vector([-1.0, 0.0, 0.0]))))
        .unwrap();
    run(&mut world, 1.0);
    assert_below("back again", velocity(&world, id).linear[0], -0.9);
}

/// Static rollers in 2D whose surfaces rotate carry a plank at the speed of their rims, 1 m/s,
/// within 1 %.
#[test]
fn a_standing_roller_with_a_surface_velocity_moves_bodies_on_it() {
    let mut world: World<Rigid2, 2, 1> = world_of(&StepSettings::quality());
    for x in [-1.0, 0.0, 1.0, 2.0, 3.0] {
        let mut roller = Body::new(Motion::Static, [x, -0.2], Rigid2::ball(0.2));
        roller.surface_velocity = Some(SurfaceVelocity::angular(Vector([-5.0])));
        world.add(roller).unwrap();
    }
    let plank = dynamic([0.0, 0.1], Rigid2::cuboid([1.6, 0.1]), &surface(0.5, 0.0));
    let id = world.add(plank).unwrap();
    run(&mut world, 1.0);
    assert_within("speed", velocity(&world, id).linear[0], 1.0, 0.01);
    assert_above("on top", place(&world, id)[1], 0.09);
}
