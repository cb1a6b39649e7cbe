//! Drives, brakes, limits and locks under load: weights, each other, short ropes and fast rotors.

use drystone::geometry::{Rigid2, Rigid3};
use drystone::{Coordinate, Drive, Joint, JointAxis, JointId, World};

use super::*;

/// Returns a slider along y with 10 kg under gravity, which these drives and friction hold.
fn lift<G: Rigid<L, A>, const L: usize, const A: usize>(
    preset: &Preset,
    drives: Vec<Drive>,
    friction: f64,
) -> (World<G, L, A>, JointId) {
    let mut world: World<G, L, A> = preset.world();
    let body = world.add(ghost([0.0; 3], inertia(10.0, [1.0; 3]))).unwrap();
    let slider = Joint::slider([Some(body), None]).about(v(0.0, 1.0, 0.0));
    let axis = JointAxis { drives, friction, ..JointAxis::free(Coordinate::Linear(0)) };
    let joint = world.join(slider.along(axis)).unwrap();
    (world, joint)
}

/// Returns the way of the weight in four seconds.
fn lifted<G: Rigid<L, A>, const L: usize, const A: usize>(
    preset: &Preset,
    drives: Vec<Drive>,
    friction: f64,
) -> f64 {
    let (mut world, joint) = lift::<G, L, A>(preset, drives, friction);
    run(&mut world, 4.0);
    world.joint(joint).unwrap().values[0]
}

fn weights<G: Rigid<L, A>, const L: usize, const A: usize>(preset: &Preset) {
    const WEIGHT: f64 = 10.0 * ACCELERATION;
    let held = [
        ("a brake", vec![], 200.0),
        ("a motor", vec![Drive::velocity(0.0).at_most(200.0)], 0.0),
        ("a motor without a bound", vec![Drive::velocity(0.0)], 0.0),
    ];
    for (name, drives, friction) in held {
        let way = lifted::<G, L, A>(preset, drives, friction);
        preset.below(&format!("way of {name}"), way.abs(), 1e-4);
    }
    for most in [200.0, f64::INFINITY] {
        let motor = Drive::velocity(0.1).at_most(most);
        preset.check("a motor that lifts", lifted::<G, L, A>(preset, vec![motor], 0.0), 0.4);
    }
    let damper = Drive::spring(0.0, 0.0, 1e4);
    let sunk = lifted::<G, L, A>(preset, vec![damper], 0.0);
    preset.check("a damper sinks", sunk, -4.0 * WEIGHT / 1e4);
    for (stiffness, damping) in [(1e4, 1e3), (1e5, 2e3), (1e6, 1e4), (1e6, 1e5)] {
        let spring = Drive::spring(0.0, stiffness, damping);
        let sag = lifted::<G, L, A>(preset, vec![spring], 0.0);
        preset.check(&format!("sag at {stiffness} N/m"), sag, -WEIGHT / stiffness);
    }
}

/// Brakes and motors hold a weight and lift it, dampers let it sink, and springs bear it, as force over
/// stiffness says.
#[test]
fn drives_bear_weights() {
    for preset in Preset::both() {
        weights::<Rigid2, 2, 1>(&preset);
        weights::<Rigid3, 3, 3>(&preset);
    }
}

/// A servo about a level hinge bears 10 kg at 0.5 m, and so does a soft lock.
#[test]
fn a_servo_bears_an_arm() {
    for preset in Preset::both() {
        for (stiffness, damping) in [(1e5, 1e3), (1e6, 320.0), (1e5, 1e4)] {
            let mut world: World<Rigid3, 3, 3> = preset.world();
            let body = world.add(ghost([0.5, 0.0, 0.0], inertia(10.0, [0.1; 3]))).unwrap();
            let servo = Drive::spring(0.0, stiffness, damping);
            let hinge = Joint::hinge([Some(body), None]).about([0.0, 0.0, 1.0]).drive(servo);
            let hinge = world.join(hinge).unwrap();
            run(&mut world, 3.0);
            let angle = world.joint(hinge).unwrap().values.last().copied().unwrap();
            let expected = -5.0 * ACCELERATION / stiffness;
            preset.check(&format!("angle at {stiffness} N m"), angle, expected);
        }
    }
}

/// Limits hold against motors of any strength, also those written as a damping without end.
#[test]
fn a_limit_is_stronger_than_a_motor() {
    for preset in Preset::both() {
        for drive in [
            Drive::velocity(2.0).at_most(1e6),
            Drive::velocity(20.0),
            Drive { velocity: 2.0, ..Drive::spring(0.0, 0.0, 1e12) },
            Drive::spring(2.0, 1e6, 1e3),
        ] {
            let mut world: World<Rigid3, 3, 3> = preset.weightless();
            let body = world.add(ghost([0.0; 3], block(1.0, [0.3, 0.1, 0.1]))).unwrap();
            let hinge = Joint::hinge([Some(body), None]).about([0.0, 0.0, 1.0]);
            let hinge = world.join(hinge.limits(-1.0..=1.0).drive(drive)).unwrap();
            let body = world.add(ghost([5.0, 0.0, 0.0], block(1.0, [0.3, 0.1, 0.1]))).unwrap();
            let slider = Joint::slider([Some(body), None]).at([5.0, 0.0, 0.0]);
            let slider = world.join(slider.limits(-1.0..=1.0).drive(drive)).unwrap();
            let mut beyond = [0.0f64; 2];
            for step in 0..300 {
                if step == 240 {
                    preset.below("beyond a limit at its impact", beyond[0].max(beyond[1]), 0.4);
                    beyond = [0.0; 2];
                }
                world.step(DT).unwrap();
                let values =
                    [world.joint(hinge).unwrap().values[5], world.joint(slider).unwrap().values[0]];
                beyond = [0, 1].map(|i: usize| beyond[i].max(values[i] - 1.0));
            }
            preset.below(&format!("angle beyond its limit, {drive:?}"), beyond[0], 0.01);
            preset.below(&format!("position beyond its limit, {drive:?}"), beyond[1], 0.01);
        }
    }
}

/// A ball joint with 1 kg bears 500 kN of a spring.
#[test]
fn a_joint_bears_any_load() {
    for preset in Preset::both() {
        for stiffness in [1e4, 1e5, 1e6] {
            let mut world: World<Rigid3, 3, 3> = preset.world();
            let body = world.add(ghost([0.0; 3], inertia(1.0, [0.1; 3]))).unwrap();
            let joint = world.join(Joint::ball([Some(body), None])).unwrap();
            let still = |x: f32| Rigid3::pose(Vector([x, 0.0, 0.0]), &[0.0, 0.0, 0.0, 1.0]);
            let spring = Joint::spring([Some(body), None], Drive::spring(0.5, stiffness, 100.0));
            world.join(spring.in_bodies([still(0.0), still(1.0)])).unwrap();
            run(&mut world, 3.0);
            let state = world.joint(joint).unwrap();
            preset.below(&format!("gap at {stiffness} N/m"), state.gap, 1e-4);
            preset.check("its load", state.force, (0.25 * stiffness * stiffness + 96.2).sqrt());
        }
    }
}

/// The axes of a universal joint stay at right angles while it turns over, as those of a gimbal do.
#[test]
fn a_gimbal_turns_over() {
    for preset in Preset::both() {
        for omega in [[1.0, 0.0, 3.0], [3.0, 0.0, 3.0], [0.3, 0.0, 5.0]] {
            let mut world: World<Rigid3, 3, 3> = preset.weightless();
            let body = world.add(ghost([0.0; 3], block(1.0, [0.3, 0.1, 0.2]))).unwrap();
            let velocity = Velocity { angular: Vector(omega), ..Velocity::ZERO };
            world.set_velocity(body, velocity).unwrap();
            let cross = JointAxis::locked(Coordinate::Swing(1), 0.0);
            world.join(Joint::ball([Some(body), None]).along(cross)).unwrap();
            let energy = |world: &World<Rigid3, 3, 3>| world.measure().kinetic_energy;
            world.step(DT).unwrap();
            let start = energy(&world);
            let (mut gap, mut most) = (0.0f64, 0.0f64);
            for _ in 0..360 {
                gap = gap.max(world.step(DT).unwrap().joint_gap[1]);
                most = most.max(energy(&world) / start);
            }
            preset.below(&format!("angle at {omega:?}"), gap, 2e-3);
            preset.below("energy", most, 1.0 + preset.energy);
        }
    }
}

/// Distances, cones and rotations that are locked to zero hold all of their directions.
#[test]
fn what_is_locked_to_zero_is_held() {
    for preset in Preset::both() {
        let distance = JointAxis::locked(Coordinate::Distance, 0.0);
        let rope = JointAxis::limited(Coordinate::Distance, [0.0, 0.0]);
        let cone = JointAxis::locked(Coordinate::Cone, 0.0);
        let rotation = JointAxis::locked(Coordinate::Rotation, 0.0);
        for (name, axes, is_pendulum) in [
            ("a distance", vec![distance.clone()], true),
            ("a rope", vec![rope], true),
            ("distance and cone", vec![distance.clone(), cone], false),
            ("distance and rotation", vec![distance, rotation], false),
        ] {
            let mut world: World<Rigid3, 3, 3> = preset.world();
            let body = world.add(ghost([0.5, 0.0, 0.0], inertia(1.0, [0.1; 3]))).unwrap();
            world.join(Joint::general([Some(body), None], axes)).unwrap();
            let start = world.measure();
            let start = start.kinetic_energy + start.potential_energy;
            let (mut gap, mut most, mut fall) = ([0.0f64; 2], 0.0f64, 0.0f32);
            for _ in 0..180 {
                let report = world.step(DT).unwrap();
                gap = [0, 1].map(|i: usize| gap[i].max(report.joint_gap[i]));
                let now = world.measure();
                most = most.max(now.kinetic_energy + now.potential_energy - start);
                fall = fall.max(-place(&world, body)[1]);
            }
            preset.below(&format!("gap of {name}"), gap[0], preset.gap);
            preset.below(&format!("angle of {name}"), gap[1], 1e-4);
            preset.below("energy", most, 0.01);
            // Only a point that alone is held lets the body swing.
            assert_eq!(is_pendulum, fall > 0.45, "{name} falls by {fall} m");
        }
    }
}

fn gear(preset: &Preset) {
    let mut world: World<Rigid2, 2, 1> = preset.weightless();
    let wheels =
        [0.0, 2.0].map(|x| world.add(ghost([x, 0.0, 0.0], inertia(1.0, [0.1; 3]))).unwrap());
    let hinges = [0, 1].map(|side: usize| {
        let at = [2.0 * side as f32, 0.0];
        world.join(Joint::hinge([Some(wheels[side]), None]).at(at)).unwrap()
    });
    let axis = JointAxis::locked(Coordinate::Gear { ratio: 2.0 }, 0.0);
    world.join(Joint::general(wheels.map(Some), vec![axis])).unwrap();
    world.set_velocity(wheels[0], in_plane([0.0; 2], 3.0)).unwrap();
    run(&mut world, 5.0);
    // The impulse p of the gear: 3 + p / I = w, 2 p / I = u, w + 2 u = 0.
    let [w, u] = hinges.map(|hinge| *world.joint(hinge).unwrap().speeds.last().unwrap());
    preset.check("speed of a wheel", w, 3.0 * 4.0 / 5.0);
    preset.check("speed of the other", u, -0.5 * w);
    let [q, p] = hinges.map(|hinge| *world.joint(hinge).unwrap().values.last().unwrap());
    preset.check("turns", p, -0.5 * q);
    assert!(q > 11.0);
}

/// Gears in the plane keep their ratio, and a pinion moves a rack.
#[test]
fn gears_turn_in_the_plane() {
    for preset in Preset::both() {
        gear(&preset);
        let mut world: World<Rigid2, 2, 1> = preset.weightless();
        let pinion = world.add(ghost([0.0; 3], inertia(1.0, [0.05; 3]))).unwrap();
        let rod = world.add(ghost([0.0, -0.1, 0.0], inertia(2.0, [0.1; 3]))).unwrap();
        let hinge = world.join(Joint::hinge([Some(pinion), None])).unwrap();
        let slider = world.join(Joint::slider([Some(rod), None]).at([0.0, -0.1])).unwrap();
        let axis = JointAxis::locked(Coordinate::Rack { radius: 0.1 }, 0.0);
        world.join(Joint::general([Some(pinion), Some(rod)], vec![axis])).unwrap();
        for _ in 0..180 {
            world.add_force(rod, in_plane([10.0, 0.0], 0.0)).unwrap();
            world.step(DT).unwrap();
        }
        let way = world.joint(slider).unwrap().values[0];
        preset.check("way of the rack", way, 0.5 * 1.42857 * 9.0);
        let turned = *world.joint(hinge).unwrap().values.last().unwrap();
        preset.check("angle of the pinion", turned, -way / 0.1);
    }
}

/// Returns the largest gap of the joints \[m, rad\], and the rise of the energy over its size.
fn worst(world: &mut World<Rigid3, 3, 3>, steps: usize) -> ([f64; 2], f64) {
    let energy = |world: &World<Rigid3, 3, 3>| {
        let now = world.measure();
        now.kinetic_energy + now.potential_energy
    };
    let (start, mut most, mut gap) = (energy(world), 0.0f64, [0.0f64; 2]);
    for _ in 0..steps {
        let report = world.step(DT).unwrap();
        gap = [0, 1].map(|i: usize| gap[i].max(report.joint_gap[i]));
        most = most.max(energy(world) - start);
    }
    (gap, most)
}

/// Three bars of 20 cm hang on each other by ropes that are much shorter, whose lines turn fast.
#[test]
fn bars_hang_on_short_ropes() {
    for preset in Preset::both() {
        for length in [0.05, 0.02, 0.01, 0.005] {
            let mut world: World<Rigid3, 3, 3> = preset.world();
            let pose = |x: f32| Rigid3::pose(Vector([x, 0.0, 0.0]), &[0.0, 0.0, 0.0, 1.0]);
            let mut above = None;
            for link in 0..3 {
                let x = 0.1 + (0.2 + length) * f64::from(link);
                let body = ghost([x, 0.0, 0.0], block(1.0, [0.1, 0.03, 0.03]));
                let body = world.add(body).unwrap();
                let from = if above.is_some() { 0.1 } else { -length as f32 };
                let rope = Joint::rope([Some(body), above], length);
                world.join(rope.in_bodies([pose(-0.1), pose(from)])).unwrap();
                above = Some(body);
            }
            let ([gap, _], most) = worst(&mut world, 240);
            preset.below(&format!("gap of ropes of {length} m"), gap, 1e-3);
            preset.below("energy", most, 0.02);
        }
    }
}

/// A bar spins on a hinge through its center, which nothing but its inertia moves.
#[test]
fn a_rotor_stays_on_its_axle() {
    for preset in Preset::both() {
        for speed in [50.0, 200.0, 500.0] {
            let mut world: World<Rigid3, 3, 3> = preset.world();
            let body = world.add(ghost([0.0; 3], block(2.0, [0.5, 0.1, 0.1]))).unwrap();
            let hinge = Joint::hinge([Some(body), None]).about([0.0, 0.0, 1.0]);
            let hinge = world.join(hinge).unwrap();
            world.set_velocity(body, in_plane([0.0; 2], speed)).unwrap();
            let start = world.measure().kinetic_energy;
            let ([_, angle], most) = worst(&mut world, 120);
            preset.below(&format!("angle at {speed} rad/s"), angle, 1e-3);
            preset.below("energy", most / start, preset.energy);
            let now = *world.joint(hinge).unwrap().speeds.last().unwrap();
            preset.check("its speed", now, speed);
        }
    }
}

/// Motors at their bound, and dry friction, push a slider as a constant force does: its place follows
/// x = v_0 t + a t^2 / 2 in steps of any length, and its velocity tells how it moves.
#[test]
fn bounded_forces_displace_as_they_push() {
    let motor = |sign: f64, force: f64| Some(Drive::velocity(1e3 * sign).at_most(force));
    // Motor, friction, force, velocity at the start.
    let cases = [
        (motor(1.0, 2.0), 0.0, 0.0, 0.0),
        (motor(-1.0, 2.0), 0.0, 0.0, 10.0),
        (motor(1.0, 2.0), 0.0, 3.0, 0.0),
        (motor(-1.0, 4.9), 0.0, 5.0, 0.0),
        (None, 5.0, 5.0, 0.1),
        (None, 2.0, 0.0, 10.0),
        (None, 4.0, 5.0, 1.0),
    ];
    for (preset, rate) in Preset::both()
        .into_iter()
        .flat_map(|preset| [24.0f64, 60.0].map(|rate| (preset.clone(), rate)))
    {
        for (drive, friction, force, speed) in cases {
            let mut world: World<Rigid3, 3, 3> = preset.weightless();
            let mut body = Body::new(Motion::Dynamic, [0.0; 3], Rigid3::ball(0.1));
            body.inertia = Some(inertia(1.0, [0.1; 3]));
            body.velocity.linear = Vector([speed as f32, 0.0, 0.0]);
            let id = world.add(body).unwrap();
            let mut joint = Joint::slider([Some(id), None]).at([0.0; 3]).about([1.0, 0.0, 0.0]);
            if let Some(drive) = drive {
                joint = joint.drive(drive);
            }
            world.join(joint.friction(friction)).unwrap();
            let steps = (2.0 * rate) as usize;
            let (mut path, mut before) = (0.0, speed);
            for _ in 0..steps {
                let push =
                    Velocity { linear: Vector([force as f32, 0.0, 0.0]), angular: Vector::ZERO };
                world.add_force(id, push).unwrap();
                world.step((1.0 / rate) as f32).unwrap();
                let now = f64::from(world.velocity(id).unwrap().linear[0]);
                path += 0.5 * (before + now) / rate;
                before = now;
            }
            let own = drive.map_or(-friction, |drive| drive.max_force * drive.velocity.signum());
            let (acceleration, time) = (force + own, steps as f64 / rate);
            let expected = speed * time + 0.5 * acceleration * time * time;
            let found = f64::from(place(&world, id)[0]);
            let what = format!("{drive:?}, {friction} N against {force} N at {rate} Hz");
            let scale = (speed * time).abs().max(expected.abs());
            preset.check_of(&format!("place: {what}"), found, expected, scale);
            preset.check_of(&format!("path of its velocities: {what}"), path, found, scale);
        }
    }
}

/// A damper lets a body sink at F / d, and its velocity says so; one that starts fast slows down as
/// v_0 exp(-d t / m).
#[test]
fn dampers_slow_down_as_their_velocity_says() {
    for (preset, rate) in Preset::both()
        .into_iter()
        .flat_map(|preset| [24.0f64, 60.0].map(|rate| (preset.clone(), rate)))
    {
        for (damping, force) in [2.0, 10.0, 50.0, 500.0]
            .into_iter()
            .flat_map(|damping| [(damping, 5.0), (damping, 0.0)])
        {
            let mut world: World<Rigid3, 3, 3> = preset.weightless();
            let start = if force > 0.0 { force / damping } else { 3.0 };
            let mut body = Body::new(Motion::Dynamic, [0.0; 3], Rigid3::ball(0.1));
            body.inertia = Some(inertia(1.0, [0.1; 3]));
            body.velocity.linear = Vector([start as f32, 0.0, 0.0]);
            let id = world.add(body).unwrap();
            let joint = Joint::slider([Some(id), None]).at([0.0; 3]).about([1.0, 0.0, 0.0]);
            world.join(joint.drive(Drive::spring(0.0, 0.0, damping))).unwrap();
            let steps = (2.0 * rate) as usize;
            let what = format!("{damping} N s/m against {force} N at {rate} Hz");
            for step in 0..steps {
                let push =
                    Velocity { linear: Vector([force as f32, 0.0, 0.0]), angular: Vector::ZERO };
                world.add_force(id, push).unwrap();
                world.step((1.0 / rate) as f32).unwrap();
                let time = (step + 1) as f64 / rate;
                let (speed, way) = if force > 0.0 {
                    (start, start * time)
                } else {
                    let left = (-damping * time).exp();
                    (start * left, start / damping * (1.0 - left))
                };
                let found = f64::from(world.velocity(id).unwrap().linear[0]);
                let what = format!("{what}, step {step}");
                // A body that stops within a substep may be off by a part of a fifth of its way in a step.
                let ends =
                    if force > 0.0 { 2.0 * start } else { start / damping + 0.2 * start / rate };
                // One that falls at its terminal speed moves before it has an impulse of its own; one that
                // stops within a substep stops a step later.
                let settled =
                    if force > 0.0 { step > steps / 4 } else { step > 1 || damping < 100.0 };
                preset.check_of(
                    &format!("speed: {what}"),
                    if settled { found } else { speed },
                    speed,
                    start,
                );
                preset.check_of(
                    &format!("way: {what}"),
                    f64::from(place(&world, id)[0]),
                    way,
                    ends,
                );
            }
        }
    }
}

/// Returns the largest speed of a beam and of a rod at its end that a drive has pressed on the floor for
/// 2 s.
fn press<G: Rigid<L, A>, const L: usize, const A: usize>(
    preset: &Preset,
    (size, angle): (f32, f32),
    drive: Drive,
) -> f64 {
    let mut world: World<G, L, A> = preset.world();
    let rough = surface(0.5, 0.0);
    let floor = G::halfspace(v(0.0, 1.0, 0.0));
    world.add(body(Motion::Static, [0.0; L], floor, &rough)).unwrap();
    let height = size * (angle.sin() + 0.08);
    let along = |way: f32| -> [f32; L] { v(way * angle.cos(), height - way * angle.sin(), 0.0) };
    let half = v(0.5 * size, 0.05 * size, 0.05 * size);
    let mut beam = weighing(dynamic([0.0; L], G::cuboid(half), &rough), 1.0);
    beam.pose = G::turned(along(0.5 * size), -angle);
    let beam = world.add(beam).unwrap();
    let end = along(size);
    let half = v(0.5 * size, 0.03 * size, 0.03 * size);
    let rod = dynamic(v(end[0] + 0.5 * size, end[1], 0.0), G::cuboid(half), &rough);
    let rod = world.add(weighing(rod, 1.0)).unwrap();
    let level = |hinge: Joint<G, L, A>| {
        if L == 3 { hinge.about(v(0.0, 0.0, 1.0)) } else { hinge }
    };
    let motor = Joint::hinge([Some(beam), None]).at(v(0.0, height, 0.0));
    world.join(level(motor.drive(drive))).unwrap();
    let hinge = Joint::hinge([Some(rod), Some(beam)]).at(end);
    world.join(level(hinge)).unwrap();
    run(&mut world, 2.0);
    let speed = |of| f64::from(velocity(&world, of).linear.length());
    speed(beam).max(speed(rod))
}

/// A motor at its bound or a spring that presses on the floor stands still, however strong it is. A beam of
/// 1 kg under 200 N m moved at 13 mm/s.
#[test]
fn drives_press_without_moving() {
    let preset = Preset::bake();
    for (size, angle) in [0.1, 0.3, 1.0].into_iter().flat_map(|size| [(size, 0.2), (size, 0.6)]) {
        // Force at the end, over the mass. [m/s^2]
        for force in [10.0, 60.0, 200.0, 600.0] {
            let torque = force * f64::from(size);
            for drive in [
                Drive::velocity(-2.0).at_most(torque),
                Drive::spring(-2.0, 0.5 * torque, 0.05 * torque),
            ] {
                let found = [
                    press::<Rigid2, 2, 1>(&preset, (size, angle), drive),
                    press::<Rigid3, 3, 3>(&preset, (size, angle), drive),
                ];
                let of = format!("speed of {size} m at {angle} rad under {drive:?}");
                for speed in found {
                    preset.below(&of, speed, 1e-3);
                }
            }
        }
    }
}
