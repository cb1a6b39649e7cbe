//! Tests of moving surfaces (belts), resistance to rolling and spinning, and damping: against
//! closed-form answers, and read from files.

use std::fs;
use std::path::PathBuf;

use drystone::Dimension;
use drystone::geometry::{Rigid2, Rigid3};
use drystone::recording::physics::Physics;
use drystone::recording::usda::Stage;
use drystone::scene::{self, Material, Motion, Read, Scene};
use drystone::{Body, BodyId, StepSettings, SurfaceMotion, World, build};
use drystone_solver::{Vector, Velocity};

use crate::common::{
    DT, GRAVITY, Rigid, Round, add_floor, assert_above, assert_below, assert_within, dynamic,
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
    motion: SurfaceMotion<L, A>,
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
    add_belt(&mut world, size.max(0.05), SurfaceMotion::linear(Vector(v(speed, 0.0, 0.0))));
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
        let motion = SurfaceMotion::linear(Vector([1.0, 0.0, 0.0]));
        belt.surface_velocity = Some(SurfaceMotion { local, ..motion });
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
fn a_turntable_that_stands_carries_round() {
    for of_shape in [false, true] {
        let mut world: World<Rigid3, 3, 3> = world_of(&StepSettings::quality());
        let omega = 1.5;
        let motion = SurfaceMotion::angular(Vector([0.0, omega, 0.0]));
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
        add_belt(&mut world, 1.0, SurfaceMotion::linear(Vector([belt, 0.0, 0.0])));
        let mut crawler =
            dynamic([0.0, 0.25, 0.0], Rigid3::cuboid([0.5, 0.25, 0.5]), &surface(0.5, 0.0));
        crawler.surface_velocity = Some(SurfaceMotion::linear(Vector([-1.0, 0.0, 0.0])));
        let id = world.add(crawler).unwrap();
        run(&mut world, 2.0);
        let speed = velocity(&world, id).linear[0];
        assert_below("speed", (speed - expected).abs(), 2e-3);
    }
}

/// A surface velocity of zero changes no bit.
#[test]
fn a_belt_that_stands_changes_nothing() {
    let poses = |motion: Option<f32>| {
        let mut world: World<Rigid3, 3, 3> = world_of(&StepSettings::quality());
        let belt = add_belt(&mut world, 1.0, SurfaceMotion::linear(Vector::ZERO));
        world
            .set_surface_velocity(
                belt,
                motion.map(|x| SurfaceMotion::linear(Vector([x, 0.0, 0.0]))),
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
    add_belt(&mut world, 1.0, SurfaceMotion::linear(Vector([1.0, 0.0, 0.0])));
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
fn what_lies_on_a_running_belt_does_not_sleep() {
    let mut settings = StepSettings::realtime();
    settings.sleep = 0.5;
    let mut world: World<Rigid3, 3, 3> = world_of(&settings);
    let belt = add_belt(&mut world, 1.0, SurfaceMotion::linear(Vector([1.0, 0.0, 0.0])));
    world.add(Body::new(Motion::Static, [1.0, 0.5, 0.0], Rigid3::cuboid([0.5, 0.5, 2.0]))).unwrap();
    let id = crate_on(&mut world, 0.5, &surface(0.5, 0.0));
    run(&mut world, 4.0);
    assert!(!world.is_sleeping(id), "on a running belt");
    assert_below("at the wall", velocity(&world, id).linear.length(), 1e-2);
    world.set_surface_velocity(belt, None).unwrap();
    run(&mut world, 3.0);
    assert!(world.is_sleeping(id), "on one that stands");
    world
        .set_surface_velocity(belt, Some(SurfaceMotion::linear(Vector([-1.0, 0.0, 0.0]))))
        .unwrap();
    run(&mut world, 1.0);
    assert_below("back again", velocity(&world, id).linear[0], -0.9);
}

/// Surface motion, resistance and damping give the same bits on two threads and after a checkpoint.
#[test]
fn threads_and_checkpoints_keep_the_bits() {
    let text = r#"
[[bodies]]
motion = "static"
surface_velocity = { linear = [0.3, 0, 0], angular = [0, 0.5, 0] }
shapes = [{ type = "box", half_extents = [5, 0.5, 5] }]
"#;
    let mut text = text.to_owned();
    for i in 0..30 {
        let at = [0.3 * f64::from(i % 5), 0.7 + 0.3 * f64::from(i / 5), 0.02 * f64::from(i)];
        text += &format!(
            "[[bodies]]\nposition = {at:?}\nlinear_damping = 0.1\nrolling_resistance = 0.002\n\
             spinning_resistance = 0.001\nshapes = [{{ type = \"sphere\", radius = 0.1 }}]\n"
        );
    }
    let scene = own(&text).scene;
    for settings in &presets() {
        let mut one = build(&scene, settings.clone()).unwrap();
        let mut two = build(&scene, settings.clone()).unwrap();
        two.set_threads(2);
        let mut resumed = build(&scene, settings.clone()).unwrap();
        for step in 0..60 {
            one.step(1.0 / 60.0).unwrap();
            two.step(1.0 / 60.0).unwrap();
            if step == 29 {
                resumed.restore(&one.checkpoint()).unwrap();
            } else if step > 29 {
                resumed.step(1.0 / 60.0).unwrap();
                assert_eq!(one.state_hash(), resumed.state_hash(), "step {step}");
            }
        }
        assert_eq!(one.state_hash(), two.state_hash());
    }
}

fn own(text: &str) -> Read {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.toml");
    fs::write(&file, text).unwrap();
    scene::read(&file).unwrap()
}

fn read_as(name: &str, text: &str) -> Read {
    let folder = tempfile::tempdir().unwrap();
    let file: PathBuf = folder.path().join(name);
    fs::write(&file, text).unwrap();
    scene::read(&file).unwrap()
}

const ALL: &str = r#"
[materials.rubber]
friction = 0.9
rolling_resistance = 0.0125
spinning_resistance = 0.003

[[bodies]]
name = "belt"
motion = "kinematic"
position = [0.1, 0.2, 0.3]
rotation = [0.1, 0.7, 0.1, 0.7]
surface_velocity = [1.1, 0.2, -0.3]
shapes = [
    { type = "box", half_extents = [2, 0.1, 1] },
    { type = "cylinder", radius = 0.1, half_height = 1, position = [2, 0, 0], rotation = [0.7071067811865476, 0, 0, 0.7071067811865476], surface_velocity = { angular = [0, 12.3, 0.1] } },
]

[[bodies]]
name = "table"
motion = "static"
surface_velocity = { linear = [0.1, 0, 0], angular = [0, 0.123456789, 0], local = false }
shapes = [{ type = "box", half_extents = [2, 0.1, 1] }]

[[bodies]]
name = "ball"
position = [0, 1, 0]
linear_damping = 0.123
angular_damping = 0.456
material = "rubber"
shapes = [{ type = "sphere", radius = 0.1 }]
"#;

/// Prints the surfaces, damping and shapes of a scene, with surface velocities in single precision
/// as simulated.
fn single(scene: &Scene) -> String {
    let of = |motion: &Option<scene::SurfaceVelocity>| {
        motion.as_ref().map(|of| {
            let single = |x: &[f64]| x.iter().map(|x| *x as f32).collect::<Vec<_>>();
            (single(&of.linear), single(&of.angular), of.local)
        })
    };
    let bodies: Vec<_> = scene
        .bodies
        .iter()
        .map(|body| {
            let shapes: Vec<_> = body
                .shapes
                .iter()
                .map(|shape| {
                    let of_surface = of(&shape.surface_velocity);
                    (shape.material.clone(), of_surface, shape.kind.clone())
                })
                .collect();
            let damping = [body.linear_damping, body.angular_damping];
            (body.name.clone(), damping, of(&body.surface_velocity), shapes)
        })
        .collect();
    format!("{bodies:#?}")
}

/// A scene written as glTF and as OpenUSD reads back with the same surfaces and damping, and with
/// the same bits after 30 steps.
#[test]
fn surfaces_and_damping_come_back_from_all_formats() {
    let read = own(ALL);
    assert!(read.warnings.is_empty(), "{:?}", read.warnings);
    let folder = tempfile::tempdir().unwrap();
    let stage = folder.path().join("scene.usda");
    Stage::new(&read.scene).unwrap().write(&stage).unwrap();
    let masses = build(&read.scene, StepSettings::quality()).unwrap().masses();
    let gltf = folder.path().join("scene.gltf");
    Physics::new(&read.scene, &masses).unwrap().write_gltf(&gltf).unwrap();
    for file in [stage, gltf] {
        let back = scene::read(&file).unwrap();
        assert!(back.warnings.is_empty(), "{:?}", back.warnings);
        assert_eq!(single(&read.scene), single(&back.scene), "{}", file.display());
        let hash = |scene: &Scene| {
            let mut simulation = build(scene, StepSettings::quality()).unwrap();
            (0..30).for_each(|_| drop(simulation.step(1.0 / 60.0).unwrap()));
            simulation.state_hash()
        };
        assert_eq!(hash(&read.scene), hash(&back.scene), "{}", file.display());
    }
}

fn warned(read: &Read, parts: &[&str]) -> bool {
    let said = |message: &str| parts.iter().all(|part| message.contains(part));
    read.warnings.iter().any(|warning| said(&warning.message))
}

/// Surface velocities, damping and disabled gravity in PhysX's schemas are read, in centimeters and
/// with z up. Attributes that are not read give a warning.
#[test]
fn stages_run_in_the_words_of_physx() {
    let text = r#"#usda 1.0
( defaultPrim = "World" metersPerUnit = 0.01 upAxis = "Z" )
def Xform "World" {
  def PhysicsScene "scene" { }
  def Cube "belt" ( prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "PhysxSurfaceVelocityAPI"] ) {
    double size = 10
    bool physics:kinematicEnabled = 1
    vector3f physxSurfaceVelocity:surfaceVelocity = (0, 100, 0)
    vector3f physxSurfaceVelocity:surfaceAngularVelocity = (0, 0, 90)
    bool physxSurfaceVelocity:surfaceVelocityLocalSpace = LOCAL
    float3 xformOp:rotateXYZ = (0, 0, 90)
    uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
  }
  def Sphere "ball" ( prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "PhysxRigidBodyAPI"] ) {
    double3 xformOp:translate = (0, 0, 500)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    float physxRigidBody:linearDamping = 0.25
    bool physxRigidBody:disableGravity = 1
    float physxRigidBody:maxLinearVelocity = 100
    int physxRigidBody:solverPositionIterationCount = 8
  }
}
"#;
    let local = read_as("local.usda", &text.replace("LOCAL", "1"));
    let [belt, ball] = local.scene.bodies.as_slice() else { panic!("{:?}", local.scene) };
    let motion = belt.surface_velocity.as_ref().unwrap();
    assert_eq!(motion.linear, [0.0, 1.0, 0.0]);
    assert_eq!(motion.angular[2] as f32, std::f32::consts::FRAC_PI_2);
    assert_eq!((ball.linear_damping, ball.angular_damping, ball.gravity_factor), (0.25, 0.05, 0.0));
    assert!(warned(&local, &["physxRigidBody:maxLinearVelocity is not read", "1 prim"]));
    assert!(warned(&local, &["another engine", "solverPositionIterationCount (1 prim)"]));
    let world = read_as("world.usda", &text.replace("LOCAL", "0"));
    let motion = world.scene.bodies[0].surface_velocity.as_ref().unwrap();
    // The stage's y axis is -z of the scene, its z axis is y.
    assert_eq!(motion.linear, [0.0, 0.0, -1.0]);
    assert!(motion.angular[1] > 1.5 && !motion.local);
}

/// Each attribute or schema that is not read gives one warning with its number of prims. Joints of
/// any type name give one, too.
#[test]
fn stages_are_told_what_is_not_read() {
    let body = |name: &str| {
        format!(
            r#"
  def Sphere "{name}" ( prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "PhysxForceAPI"] ) {{
    float physics:dragCoefficient = 1
    vector3f physxForce:force = (1, 0, 0)
    vector3f physxSurfaceVelocity:surfaceVelocity = (1, 0, 0)
    token visibility = "inherited"
  }}
"#
        )
    };
    let text = format!(
        "#usda 1.0\n( metersPerUnit = 1 upAxis = \"Y\" )\ndef Xform \"World\" {{\n  def PhysicsScene \"scene\" {{ }}\n\
         {}{}{}\n  def DistancePhysicsJoint \"rope\" {{ rel physics:body0 = </World/a> }}\n  \
         def PhysicsRevoluteJoint \"hinge\" {{ float physics:lowerLimit = 1 }}\n  \
         def PhysxPhysicsGearJoint \"gear\" {{ }}\n}}\n",
        body("a"),
        body("b"),
        body("c")
    );
    let read = read_as("strange.usda", &text);
    assert!(warned(&read, &["rope", "not simulated", "DistancePhysicsJoint is no type"]));
    assert!(warned(&read, &["hinge", "the joint is not simulated"]));
    assert!(warned(&read, &["gear", "not simulated", "PhysxPhysicsGearJoint"]));
    for name in ["physics:dragCoefficient", "physxForce:force", "PhysxForceAPI"] {
        assert!(warned(&read, &[name, "3 prims"]), "{name}: {:?}", read.warnings);
        let all = read.warnings.iter().filter(|of| of.message.contains(&format!("{name} ")));
        assert_eq!(all.count(), 1, "{name}");
    }
    assert!(warned(&read, &["surface velocity does not act without PhysxSurfaceVelocityAPI"]));
    assert!(!warned(&read, &["visibility"]) && !warned(&read, &["lowerLimit"]));
}

/// Each unknown property or extension of a glTF file gives one warning with its number of
/// occurrences. Known extensions of physics that are not simulated are named.
#[test]
fn gltf_is_told_what_is_not_read() {
    let node = r#"{ "extensions": {
        "KHR_physics_rigid_bodies": {
            "motion": { "mass": 1, "linearDamping": 0.5, "extensions": { "EXT_wind": {} } },
            "collider": { "geometry": { "shape": 0 } } },
        "OMI_physics_drag": { "drag": 1 } } }"#;
    let text = format!(
        r#"{{ "asset": {{ "version": "2.0" }}, "scene": 0, "scenes": [{{ "nodes": [0, 1] }}],
        "extensionsUsed": ["KHR_physics_rigid_bodies", "KHR_implicit_shapes", "OMI_physics_drag"],
        "extensions": {{ "KHR_implicit_shapes": {{ "shapes": [
            {{ "type": "sphere", "sphere": {{ "radius": 1, "roundness": 2 }} }}] }} }},
        "nodes": [{node}, {node}] }}"#
    );
    let read = read_as("strange.gltf", &text);
    for (what, times) in [
        ("'linearDamping' is not a property of motion", 2),
        ("the extension EXT_wind of motion", 2),
        ("the extension OMI_physics_drag of nodes", 2),
        ("'roundness' is not a property of sphere", 1),
    ] {
        let all: Vec<_> = read.warnings.iter().filter(|of| of.message.contains(what)).collect();
        assert_eq!(all.len(), 1, "{what}: {:?}", read.warnings);
        assert_eq!(all[0].message.contains("2 times"), times == 2, "{what}");
    }
    assert!(warned(&read, &["OMI_physics_drag is not simulated"]));
}

/// In Drystone's own format, wrong values of surfaces and damping are refused with what is
/// accepted. Values without effect give a warning.
#[test]
fn surfaces_in_the_own_format() {
    let refused = |line: &str| {
        let text = format!("[[bodies]]\n{line}\nshapes = [{{ type = \"sphere\", radius = 1 }}]\n");
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.toml");
        fs::write(&file, text).unwrap();
        scene::read(&file).unwrap_err().to_string()
    };
    assert!(refused("surface_velocity = [1, 2]").contains("3 numbers"));
    assert!(refused("surface_velocity = { lineal = [1, 2, 3] }").contains("'linear'"));
    assert!(refused("surface_velocity = { local = 1 }").contains("true or false"));
    assert!(refused("linear_damping = -1").contains("linear_damping"));
    assert!(refused("rolling_resistance = -1").contains("rolling_resistance"));
    let idle = own("[[bodies]]\nmotion = \"static\"\nlinear_damping = 1\nfriction = 0\n\
         surface_velocity = [1, 0, 0]\nshapes = [{ type = \"sphere\", radius = 1 }]\n");
    assert!(warned(&idle, &["linear_damping", "does not act"]));
    assert!(warned(&idle, &["surface_velocity", "does not act"]));
    let flat = own("dimension = 2\n[[bodies]]\nmotion = \"static\"\n\
         surface_velocity = { angular = 2 }\nshapes = [{ type = \"sphere\", radius = 1 }]\n");
    assert_eq!(flat.scene.bodies[0].surface_velocity.as_ref().unwrap().angular, [2.0]);
}

/// Static rollers in 2D whose surfaces rotate carry a plank at the speed of their rims, 1 m/s,
/// within 1 %.
#[test]
fn a_roller_that_stands_moves_what_lies_on_it() {
    let mut world: World<Rigid2, 2, 1> = world_of(&StepSettings::quality());
    for x in [-1.0, 0.0, 1.0, 2.0, 3.0] {
        let mut roller = Body::new(Motion::Static, [x, -0.2], Rigid2::ball(0.2));
        roller.surface_velocity = Some(SurfaceMotion::angular(Vector([-5.0])));
        world.add(roller).unwrap();
    }
    let plank = dynamic([0.0, 0.1], Rigid2::cuboid([1.6, 0.1]), &surface(0.5, 0.0));
    let id = world.add(plank).unwrap();
    run(&mut world, 1.0);
    assert_within("speed", velocity(&world, id).linear[0], 1.0, 0.01);
    assert_above("on top", place(&world, id)[1], 0.09);
}
