//! Moves a kinematic body and applies forces: a lift carries a crate up, and wind blows it off:
//! `cargo run --release -p drystone --example forces`

use drystone::{Body, Motion, StepSettings, Vector, Velocity, World3};
use parry3d::math::{Pose, Vector as Point};
use parry3d::shape::SharedShape;

const STEP: f32 = 1.0 / 60.0;

fn main() {
    let mut world = World3::new(StepSettings::realtime());
    world.gravity = [0.0, -9.81, 0.0].into();
    world
        .add(Body::new(Motion::Static, [0.0, -0.5, 0.0], SharedShape::cuboid(9.0, 0.5, 9.0)))
        .unwrap();
    let plate = SharedShape::cuboid(1.0, 0.1, 1.0);
    let lift = world.add(Body::new(Motion::Kinematic, [0.0, 0.1, 0.0], plate)).unwrap();
    let mut load = Body::new(Motion::Dynamic, [0.0, 0.5, 0.0], SharedShape::cuboid(0.3, 0.3, 0.3));
    // A crate of 0.216 m^3 and 20 kg.
    load.colliders[0].density = 20.0 / 0.216;
    let load = world.add(load).unwrap();

    for step in 0..300 {
        let time = step as f32 * STEP;
        // The kinematic body reaches the given pose at the end of the step. It pushes others and is
        // never pushed.
        let height = 0.1 + (0.5 * (time + STEP)).min(1.5);
        world.move_to(lift, &Pose::from_translation(Point::new(0.0, height, 0.0)), STEP).unwrap();
        if time > 3.5 {
            // The force [N] acts during one step.
            world
                .add_force(load, Velocity { linear: Vector([150.0, 0.0, 0.0]), ..Velocity::ZERO })
                .unwrap();
        }
        world.step(STEP).unwrap();
        if step % 50 == 49
            && let (Some(pose), Some(velocity)) = (world.pose(load), world.velocity(load))
        {
            let at = pose.translation;
            println!("{time:.2} s: at ({:.2}, {:.2}) m", at.x, at.y);
            println!(
                "        {:.2} m/s along, {:.2} m/s up",
                velocity.linear[0], velocity.linear[1]
            );
        }
    }
}
