//! Springs, as drives and as soft locks and limits: what they bear, and the time they keep.

use std::f64::consts::TAU;

use drystone::geometry::Rigid3;
use drystone::{Coordinate, Drive, Joint, JointAxis, Softness, World};

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
