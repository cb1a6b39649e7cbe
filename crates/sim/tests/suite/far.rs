//! Tests that a body that touches nothing changes no bit of the motion of others.

use crate::common::*;
use drystone::geometry::{Geometry, Rigid3};
use drystone::{Motion, StepSettings, World3};
use drystone_solver::Vector;

/// Drops boxes, balls and hulls onto a floor, with these further bodies far away. Returns the bits
/// of the poses and velocities after 50 steps.
fn falling(
    settings: &StepSettings,
    floor: parry3d::shape::SharedShape,
    tilt: f32,
    far: &[Far],
) -> Vec<u32> {
    let material = surface(0.5, 0.3);
    let mut world: World3 = world();
    world.settings = settings.clone();
    let mut ground = body(Motion::Static, [0.0; 3], floor, &material);
    ground.pose = Rigid3::turned([0.0, -0.5, 0.0], tilt);
    world.add(ground).unwrap();
    let mut random = Random(11);
    let mut ids = Vec::new();
    for i in 0..12 {
        let points: Vec<[f32; 3]> = (0..12).map(|_| random.vector(0.1)).collect();
        let shape = match i % 3 {
            0 => Rigid3::hull(&points),
            1 => Rigid3::cuboid([0.1, 0.06, 0.08]),
            _ => Rigid3::ball(0.08),
        };
        let place = [0.13 * (i % 4) as f32, 0.3 + 0.2 * (i / 4) as f32, 0.05 * i as f32];
        let mut own = dynamic(place, shape, &material);
        own.velocity.angular = Vector(random.vector(5.0));
        ids.push(world.add(own).unwrap());
    }
    for &Far { place, velocity } in far {
        world.add(moving(dynamic(place, Rigid3::ball(0.1), &material), velocity)).unwrap();
    }
    for _ in 0..50 {
        world.step(DT).unwrap();
    }
    let bits = |id| {
        let velocity = world.velocity(id).unwrap();
        let mut numbers = Vec::new();
        Rigid3::write(&world.pose(id).unwrap(), &mut numbers);
        numbers.extend(velocity.linear.0.into_iter().chain(velocity.angular.0));
        numbers.into_iter().map(f32::to_bits)
    };
    ids.into_iter().flat_map(bits).collect()
}

#[derive(Clone, Copy)]
struct Far {
    place: [f32; 3],
    velocity: [f32; 3],
}

/// Far bodies, fast and slow, change no bit of bodies that fall onto half-spaces and boxes, level
/// and tilted, in all three presets.
#[test]
fn a_far_body_changes_no_bit() {
    let fast = Far { place: [200.0, 60.0, 0.0], velocity: [50.0, 0.0, 0.0] };
    let rising = Far { place: [-30.0, 40.0, 5.0], velocity: [0.0, 9.0, 0.3] };
    let slow = Far { place: [9.0, 30.0, -7.0], velocity: [0.0; 3] };
    for settings in [StepSettings::quality(), StepSettings::certified(), StepSettings::realtime()] {
        for tilt in [0.0, -0.3] {
            for floor in [Rigid3::halfspace([0.0, 1.0, 0.0]), Rigid3::cuboid([300.0, 0.5, 300.0])] {
                let alone = falling(&settings, floor.clone(), tilt, &[]);
                for far in [&[fast][..], &[fast, rising, slow]] {
                    assert!(falling(&settings, floor.clone(), tilt, far) == alone, "tilt {tilt}");
                }
            }
        }
    }
}
