//! Springs, as drives and as soft locks and limits: what they bear, and the time they keep.

use std::f64::consts::TAU;

use drystone::geometry::Rigid3;
use drystone::{Breaking, Coordinate, Drive, Joint, JointAxis, Material, Motion, Softness, World};

use super::*;

type World3 = World<Rigid3, 3, 3>;

/// Steps per second. \[1/s\]
const RATES: [f32; 3] = [24.0, 60.0, 240.0];

/// Ways to say that a spring pulls the height of a body to 0.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Drive,
    Lock,
    Limit,
}

/// Adds 2 kg to a world, on a vertical slider with a spring of this kind that begins at a height.
fn sprung(world: &mut World3, kind: Kind, [height, omega, zeta]: [f64; 3]) -> (BodyId, JointId) {
    let (mass, infinite) = (2.0, f64::INFINITY);
    let body = world.add(ghost([0.0, height, 0.0], inertia(mass, [0.1; 3]))).unwrap();
    let [stiffness, damping] = [mass * omega * omega, 2.0 * mass * zeta * omega];
    let soft = |limits| JointAxis {
        softness: Some(Softness { stiffness, damping }),
        ..JointAxis::limited(Coordinate::Linear(0), limits)
    };
    let axis = match kind {
        Kind::Drive => {
            let drives = vec![Drive::spring(0.0, stiffness, damping)];
            JointAxis { drives, ..JointAxis::free(Coordinate::Linear(0)) }
        }
        Kind::Lock => soft([0.0, 0.0]),
        Kind::Limit => soft([0.0, infinite]),
    };
    let upward = Rigid3::turned([0.0; 3], (TAU / 4.0) as f32);
    let slider = Joint::slider([Some(body), None]).along(axis);
    let joint = world.join(slider.in_bodies([upward, upward])).unwrap();
    (body, joint)
}

/// A weight on a spring hangs at m g / k, and has no velocity there, with any damping.
#[test]
fn weights_on_springs_stand_still() {
    for preset in Preset::both() {
        for (rate, kind) in RATES
            .into_iter()
            .flat_map(|rate| [Kind::Drive, Kind::Lock, Kind::Limit].map(|kind| (rate, kind)))
        {
            for (frequency, zeta) in [(1.0, 0.7), (1.0, 0.05), (5.0, 0.3), (5.0, 1.0), (50.0, 1.0)]
            {
                let mut world: World3 = preset.world();
                let omega = TAU * frequency;
                let sag = -ACCELERATION / (omega * omega);
                let (body, joint) = sprung(&mut world, kind, [sag, omega, zeta]);
                let mut fastest = 0.0f64;
                for step in 0..3 * rate as u32 {
                    world.step(1.0 / rate).unwrap();
                    if step > rate as u32 {
                        let speed = velocity(&world, body).linear.length();
                        fastest = fastest.max(f64::from(speed));
                    }
                }
                let name =
                    format!("{kind:?} of {frequency} Hz, {zeta}, at {rate} steps per second");
                preset.check(&format!("sag of {name}"), world.joint(joint).unwrap().values[0], sag);
                let weight = ACCELERATION * sag.abs();
                preset.below(&format!("speed of {name}"), fastest, 3e-3 * weight.sqrt());
            }
        }
    }
}

/// A spring without damping begins at once: its body is at a cos(w t) with the speed -a w sin(w t), and
/// keeps its energy.
#[test]
fn springs_keep_time_and_energy() {
    for preset in Preset::both() {
        for (rate, kind) in
            RATES.into_iter().flat_map(|rate| [Kind::Drive, Kind::Lock].map(|kind| (rate, kind)))
        {
            for frequency in [0.5, 2.0] {
                let mut world: World3 = preset.weightless();
                let omega = TAU * frequency;
                let (body, joint) = sprung(&mut world, kind, [0.1, omega, 0.0]);
                let [mut late, mut off, mut energies] = [0.0, 0.0, 0.0f64];
                for step in 1..=5 * rate as u32 {
                    world.step(1.0 / rate).unwrap();
                    let phase = omega * f64::from(step) / f64::from(rate);
                    let (at, speed) =
                        (world.joint(joint).unwrap().values[0], velocity(&world, body).linear[1]);
                    let speed = f64::from(speed) / omega;
                    late = f64::max(late, (at - 0.1 * phase.cos()).abs());
                    off = f64::max(off, (speed + 0.1 * phase.sin()).abs());
                    energies = energies.max(((at * at + speed * speed) / 0.01 - 1.0).abs());
                }
                let name = format!("{kind:?} of {frequency} Hz at {rate} steps per second");
                preset.below(&format!("place of {name}"), late, 0.1 * preset.part);
                preset.below(&format!("speed of {name}"), off, 0.1 * preset.part);
                preset.below(&format!("energy of {name}"), energies, preset.energy);
            }
        }
    }
}

/// A soft limit without damping gives a body back the speed with which it came.
#[test]
fn soft_limits_give_back_what_they_took() {
    for preset in Preset::both() {
        for (rate, frequency) in
            RATES.into_iter().flat_map(|rate| [0.5, 1.0, 3.0].map(|frequency| (rate, frequency)))
        {
            let mut world: World3 = preset.weightless();
            let (body, _) = sprung(&mut world, Kind::Limit, [0.1, TAU * frequency, 0.0]);
            let down = Velocity { linear: Vector([0.0, -1.0, 0.0]), angular: Vector::ZERO };
            world.set_velocity(body, down).unwrap();
            (0..3 * rate as u32).for_each(|_| _ = world.step(1.0 / rate).unwrap());
            let speed = f64::from(velocity(&world, body).linear[1]);
            preset.check(&format!("back from {frequency} Hz at {rate} per second"), speed, 1.0);
        }
    }
}

/// A car on springs stands still on its wheels, and falls asleep in real time.
#[test]
fn sprung_cars_stand_and_sleep() {
    for preset in Preset::both() {
        for (frequency, mass) in [(1.2, 1200.0), (2.0, 1200.0), (5.0, 300.0), (15.0, 20.0)] {
            let settings = StepSettings { sleep_delay: 0.5, ..preset.settings.clone() };
            let mut world: World3 = World::new(settings);
            world.gravity = Vector([0.0, -GRAVITY, 0.0]);
            let rough = surface(0.8, 0.0);
            add_floor(&mut world, &rough);
            let chassis = dynamic([0.0, 0.7, 0.0], Rigid3::cuboid([2.0, 0.3, 0.8]), &rough);
            let chassis = world.add(weighing(chassis, mass)).unwrap();
            let sag = ACCELERATION / (TAU * frequency).powi(2);
            for (x, z) in [(1.3, 0.9), (1.3, -0.9), (-1.3, 0.9), (-1.3, -0.9)] {
                let wheel = dynamic([x, 0.3, z], Rigid3::ball(0.3), &rough);
                let wheel = world.add(weighing(wheel, 15.0)).unwrap();
                let turn = [0.0, -0.5f32.sqrt(), 0.0, 0.5f32.sqrt()];
                let frame = |at| Rigid3::pose(Vector(at), &turn);
                let up = sag.min(0.3) as f32;
                let suspension = Joint::wheel([Some(wheel), Some(chassis)], frequency, 0.5);
                let (own, omega) = (0.25 * f64::from(mass), TAU * frequency);
                let drives = vec![Drive::spring(0.0, own * omega * omega, own * omega)];
                let spring = JointAxis { drives, ..JointAxis::free(Coordinate::Linear(1)) };
                let frames = [frame([0.0; 3]), frame([x, -0.4 - up, z])];
                let brake = JointAxis { friction: 500.0, ..JointAxis::free(Coordinate::Twist) };
                world.join(suspension.in_bodies(frames).along(spring).along(brake)).unwrap();
            }
            let mut fastest = 0.0f64;
            for step in 0..480 {
                world.step(DT).unwrap();
                if step >= 300 {
                    let speed = velocity(&world, chassis).linear.length();
                    fastest = fastest.max(f64::from(speed));
                }
            }
            let name = format!("car of {mass} kg on {frequency} Hz");
            preset.below(&format!("speed of a {name}"), fastest, 1e-3);
            if preset.settings.tolerance == 0.0 {
                assert!(world.is_sleeping(chassis), "{name} is awake");
            }
        }
    }
}

/// Returns the inertia of a brick of 1 kg.
fn brick() -> Inertia<3, 3> {
    block(1.0, [0.3, 0.2, 0.1])
}

/// Returns energy of motion and weight, and the angular momentum about the origin. \[J, kg m^2/s\]
fn motion_of(world: &World3, parts: &[BodyId]) -> (f64, Vector<f64, 3>) {
    let cross = |a: Vector<f64, 3>, b: Vector<f64, 3>| {
        Vector([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
    };
    let mut spin = Vector::ZERO;
    for &part in parts {
        let (pose, inertia) = (world.pose(part).unwrap(), brick());
        let moved = velocity(world, part);
        let tensor = Rigid3::frame(&pose).tensor(inertia.moments);
        spin += (tensor * moved.angular).cast();
        let momentum = moved.linear.cast::<f64>() * f64::from(inertia.mass);
        spin += cross(Rigid3::frame(&pose).position.cast(), momentum);
    }
    (energy(world), spin)
}

/// Springs whose direction turns keep angular momentum, and energy but for what their stretch holds: two
/// bodies that circle on a spring, at their centers or off them, on a soft weld or on a slider.
#[test]
fn springs_that_turn_keep_momentum() {
    for preset in Preset::both() {
        for stiffness in [20.0, 200.0, 2000.0] {
            for kind in 0..4 {
                let mut world: World3 = preset.weightless();
                let turn = (stiffness / 40.0f64).sqrt().min(8.0);
                let parts = [-1.0, 1.0].map(|side| {
                    let mut body = ghost([side, 0.0, 0.0], brick());
                    body.velocity.linear = Vector([0.0, (side * turn) as f32, 0.0]);
                    body.velocity.angular = Vector([0.0, 0.0, turn as f32]);
                    world.add(body).unwrap()
                });
                let pair = parts.map(Some);
                let at = |x: f32, y: f32| Rigid3::turned([x, y, 0.0], 0.0);
                let spring = Drive::spring(1.8, stiffness, 0.0);
                let softness = Some(Softness { stiffness, damping: 0.0 });
                let joint = match kind {
                    0 => Joint::spring(pair, spring).in_bodies([at(0.0, 0.0), at(0.0, 0.0)]),
                    1 => Joint::spring(pair, spring).in_bodies([at(0.1, 0.1), at(0.0, -0.2)]),
                    2 => {
                        Joint::slider(pair).at([0.0; 3]).drive(Drive::spring(-0.1, stiffness, 0.0))
                    }
                    _ => {
                        let mut weld = Joint::fixed(pair).at([0.0; 3]);
                        weld.axes.iter_mut().for_each(|axis| axis.softness = softness);
                        weld
                    }
                };
                let (joint, rest) = (world.join(joint).unwrap(), [1.8, 1.8, -0.1, 0.0][kind]);
                let stored = |world: &World3| {
                    let values = world.joint(joint).unwrap().values;
                    let sprung = &values[..if kind == 3 { 6 } else { 1 }];
                    let squares = sprung.iter().map(|value| (value - rest) * (value - rest));
                    0.5 * stiffness * squares.sum::<f64>()
                };
                let (start, spin) = motion_of(&world, &parts);
                let start = start + stored(&world);
                let (mut most, mut off) = (0.0f64, 0.0f64);
                for _ in 0..1200 {
                    world.step(DT).unwrap();
                    let (now, own) = motion_of(&world, &parts);
                    most = most.max((now + stored(&world)) / start - 1.0);
                    off = off.max((own - spin).length() / spin.length());
                }
                let name = format!("kind {kind} of {stiffness} N/m");
                preset.below(&format!("momentum of {name}"), off, 1e-4);
                preset.below(&format!("energy from nothing of {name}"), most, 2e-3);
            }
        }
    }
}

/// A weight on a spring swings about a point for a minute, by as much at the end as at the start.
#[test]
fn a_weight_on_a_spring_swings_on() {
    for preset in Preset::both() {
        for stiffness in [100.0, 400.0, 1600.0] {
            let mut world: World3 = preset.world();
            let origin = Rigid3::turned([0.0; 3], 0.0);
            let length = 1.0 + ACCELERATION / stiffness;
            let angle = 0.2f64;
            let at = [length * angle.sin(), -length * angle.cos(), 0.0];
            let body = world.add(ghost(at, inertia(1.0, [0.01; 3]))).unwrap();
            let spring = Joint::spring([Some(body), None], Drive::spring(1.0, stiffness, 0.0));
            world.join(spring.in_bodies([origin, origin])).unwrap();
            let mut widest = [0.0f64; 2];
            for step in 0..3600 {
                world.step(DT).unwrap();
                let aside = f64::from(place(&world, body)[0].abs());
                match step {
                    0..300 => widest[0] = widest[0].max(aside),
                    3300.. => widest[1] = widest[1].max(aside),
                    _ => {}
                }
            }
            preset.check(&format!("swing at {stiffness} N/m"), widest[1], widest[0]);
        }
    }
}

/// A servo that presses on a limit of its hinge does not pull the hinge apart.
#[test]
fn servos_that_press_on_limits_stay() {
    for preset in Preset::both() {
        for (frequency, ratio) in
            [5.0, 10.0, 15.0, 30.0, 70.0].into_iter().flat_map(|own| [0.1, 0.7].map(|of| (own, of)))
        {
            let mut world: World3 = preset.world();
            let body = world.add(ghost([0.5, 0.0, 0.0], block(1.0, [0.5, 0.05, 0.05]))).unwrap();
            let servo = Drive::frequency(2.0, frequency, ratio);
            let hinge = Joint::hinge([Some(body), None]).about([0.0, 0.0, 1.0]).at([0.0; 3]);
            let hinge = world.join(hinge.limits(-0.5..=0.5).drive(servo)).unwrap();
            let mut gap = 0.0f64;
            for _ in 0..240 {
                world.step(DT).unwrap();
                gap = gap.max(world.joint(hinge).unwrap().gap);
            }
            let name = format!("servo of {frequency} Hz, {ratio}");
            preset.below(&format!("gap of a hinge with a {name}"), gap, 3e-3);
            let still = world.joint(hinge).unwrap().gap;
            preset.below(&format!("the same at rest, {name}"), still, 1e-4);
        }
    }
}

/// Springs of given frequencies about all angles of a limb let it come to rest: their stiffness does not depend
/// on where the limb is. With its present effective mass they drove each other up to 36 rad/s.
#[test]
fn limbs_on_springs_about_all_angles_come_to_rest() {
    let swings = [Coordinate::Swing(1), Coordinate::Swing(2), Coordinate::Twist];
    let cardan = [0, 1, 2].map(Coordinate::Cardan);
    for preset in Preset::both() {
        for (coordinates, length) in
            [swings, cardan].into_iter().flat_map(|of| [(of, 0.1), (of, 1.0)])
        {
            for (frequency, ratios, rate) in [
                (2.0, [0.1, 0.1, 0.1], 60.0f32),
                (5.0, [0.1, 0.1, 1.0], 60.0),
                (8.0, [0.1, 0.1, 0.1], 240.0),
                (8.0, [0.1, 0.1, 1.0], 60.0),
            ] {
                let mut world: World3 = preset.world();
                let across = length * length / 12.0;
                let arm = inertia(1.0, [0.04 * across, across, across]);
                let arm = world.add(ghost([0.5 * length, 0.0, 0.0], arm)).unwrap();
                let mut ball = Joint::ball([Some(arm), None]).at([0.0; 3]);
                for ((coordinate, ratio), rest) in
                    coordinates.into_iter().zip(ratios).zip([0.5, 0.5, -0.5])
                {
                    let mut axis = JointAxis::free(coordinate);
                    axis.drives.push(Drive::frequency(rest, frequency, ratio));
                    ball.axes.push(axis);
                }
                world.join(ball).unwrap();
                for _ in 0..(20.0 * rate) as usize {
                    world.step(1.0 / rate).unwrap();
                }
                let spin = f64::from(velocity(&world, arm).angular.length());
                let most = if preset.name == "bake" { 0.1 } else { 0.5 };
                let name = format!(
                    "{frequency} Hz about {:?} of {length} m, {ratios:?}, {rate} per second",
                    coordinates[0]
                );
                preset.below(&format!("spin of a limb on {name}"), spin, most);
            }
        }
    }
}

/// A weight pulled by a spring through a strong damper moves as fast as it is said to.
#[test]
fn bodies_in_strong_dampers_have_the_velocity_of_their_motion() {
    for preset in Preset::both() {
        for (rate, damping) in [24.0f32, 60.0, 240.0]
            .into_iter()
            .flat_map(|rate| [(rate, 30.0), (rate, 300.0), (rate, 3000.0)])
        {
            let mut world: World3 = preset.weightless();
            let body = world.add(ghost([0.0; 3], block(0.7, [0.06; 3]))).unwrap();
            let slider = Joint::slider([Some(body), None]).about([1.0, 0.0, 0.0]).at([0.0; 3]);
            world.join(slider.drive(Drive::spring(1.0, 70.0, damping))).unwrap();
            for _ in 0..rate as usize {
                world.step(1.0 / rate).unwrap();
            }
            let before = f64::from(place(&world, body)[0]);
            let said = f64::from(velocity(&world, body).linear[0]);
            world.step(1.0 / rate).unwrap();
            let then = f64::from(velocity(&world, body).linear[0]);
            let moved = (f64::from(place(&world, body)[0]) - before) * f64::from(rate);
            let name = format!("error of the velocity at {damping} N s/m, {rate} per second");
            let error = (0.5 * (said + then) / moved - 1.0).abs();
            preset.below(&name, error, if preset.name == "bake" { 0.02 } else { 0.04 });
        }
    }
}

/// A heavy body on a slider with a spring stands over a light plate on the floor.
#[test]
fn heavy_on_a_spring_over_light_stands() {
    let preset = Preset::bake();
    for (heavy, light) in [(1000.0, 1.0), (1000.0, 20.0), (10.0, 0.5)] {
        for frequency in [0.5, 1.0, 5.0] {
            let mut world: World3 = preset.world();
            let rough = surface(0.5, 0.0);
            add_floor(&mut world, &rough);
            let plate = dynamic([0.0, 0.05, 0.0], Rigid3::cuboid([0.5, 0.05, 0.5]), &rough);
            let plate = world.add(weighing(plate, light)).unwrap();
            let top = dynamic([0.0, 1.0, 0.0], Rigid3::cuboid([0.2, 0.2, 0.2]), &rough);
            let top = world.add(weighing(top, heavy)).unwrap();
            let (mass, omega) = (f64::from(heavy), TAU * frequency);
            let sag = ACCELERATION / (omega * omega);
            let spring = Drive::spring(sag.min(0.5), mass * omega * omega, mass * omega);
            let slider = Joint::slider([Some(top), Some(plate)]).about([0.0, 1.0, 0.0]);
            world.join(slider.at([0.0, 1.0, 0.0]).drive(spring)).unwrap();
            run(&mut world, 4.0);
            let name = format!("{heavy} kg on {frequency} Hz over {light} kg");
            let at = place(&world, top);
            preset.below(&format!("way aside of {name}"), f64::from(at[0].hypot(at[2])), 5e-3);
        }
    }
}

/// A net of 81 light balls between stretched springs, which no substep resolves, catches 2 kg. Nothing gets
/// faster than the fall lets it.
#[test]
fn a_sprung_net_catches_a_ball() {
    const SIDE: usize = 9;
    for preset in Preset::both() {
        let mut world: World3 = preset.world();
        let material = Material::default();
        let mut balls = Vec::new();
        for (i, j) in (0..SIDE).flat_map(|i| (0..SIDE).map(move |j| (i, j))) {
            let at = [0.12 * i as f32, 1.0, 0.12 * j as f32];
            let is_rim = [i, j].iter().any(|own| [0, SIDE - 1].contains(own));
            let mut ball = dynamic(at, Rigid3::ball(0.02), &material);
            ball.motion = if is_rim { Motion::Static } else { Motion::Dynamic };
            ball.colliders[0].density = 0.05 / (4.0 / 3.0 * std::f32::consts::PI * 0.02f32.powi(3));
            balls.push((world.add(ball).unwrap(), is_rim));
        }
        let pairs = (0..SIDE * SIDE).flat_map(|own| {
            let right = (own % SIDE + 1 < SIDE).then_some([own, own + 1]);
            [right, (own + SIDE < SIDE * SIDE).then_some([own, own + SIDE])]
        });
        let center = Rigid3::turned([0.0; 3], 0.0);
        for [a, b] in pairs.flatten().filter(|pair| !pair.iter().all(|&own| balls[own].1)) {
            let spring = Drive::spring(0.11, 2e4, 2.83);
            let joint = Joint::spring([a, b].map(|own| Some(balls[own].0)), spring);
            world.join(joint.in_bodies([center, center])).unwrap();
        }
        let mut load = dynamic([0.48, 1.6, 0.48], Rigid3::ball(0.25), &material);
        load.inertia = Some(inertia(2.0, [0.05; 3]));
        world.add(load).unwrap();
        let fall = 2.0 * ACCELERATION * (0.6 - 0.27);
        let mut most = 0.0f64;
        for _ in 0..90 {
            world.step(DT).unwrap();
            most = most.max(world.measure().kinetic_energy);
        }
        preset.below("kinetic energy of a net and its load", most, 1.05 * fall);
    }
}

/// A weight whose spring breaks at once falls as if it had never hung there.
#[test]
fn springs_that_break_give_nothing() {
    for preset in Preset::both() {
        for stiffness in [200.0, 1e3, 1e5] {
            let mut world: World3 = preset.world();
            let body = world.add(ghost([0.0, -2.0, 0.0], inertia(1.0, [0.1; 3]))).unwrap();
            let origin = Rigid3::turned([0.0; 3], 0.0);
            let spring = Joint::spring([Some(body), None], Drive::spring(1.0, stiffness, 1.0));
            let weak = Breaking { force: 1e-3 * stiffness, ..Breaking::NEVER };
            let spring = spring.in_bodies([origin, origin]).breaking(weak);
            let spring = world.join(spring).unwrap();
            run(&mut world, 0.5);
            assert!(world.joint(spring).unwrap().broken);
            let speed = f64::from(velocity(&world, body).linear[1]);
            preset.check(&format!("fall from {stiffness} N/m"), speed, -0.5 * ACCELERATION);
        }
    }
}

/// A spring without damping swings for ever, however short the substeps are.
#[test]
fn short_substeps_keep_the_energy_of_springs() {
    for preset in Preset::both() {
        for (substeps, kind) in [8, 64, 512]
            .into_iter()
            .flat_map(|own| [Kind::Drive, Kind::Lock].map(|kind| (own, kind)))
        {
            let mut settings = preset.settings.clone();
            (settings.substeps, settings.max_substeps) = (substeps, substeps);
            let mut world: World3 = Preset { settings, ..preset.clone() }.weightless();
            let (body, _) = sprung(&mut world, kind, [0.3, 4.0, 0.0]);
            let mut highest = 0.0f32;
            for step in 0..600 {
                world.step(DT).unwrap();
                let late = if step >= 480 { place(&world, body)[1] } else { 0.0 };
                highest = highest.max(late);
            }
            let of = format!("{kind:?}: height after 8 s of {substeps} substeps");
            preset.check_of(&of, f64::from(highest), 0.3, 0.6);
        }
    }
}
