//! Knocks over a row of dominoes with a ball, in 2D:
//! `cargo run --release -p drystone --example plane`

use drystone::{Body, Motion, StepSettings, Vector, Velocity, World2};
use parry2d::shape::SharedShape;

fn main() {
    let mut world = World2::new(StepSettings::realtime());
    world.gravity = [0.0, -9.81].into();
    let floor = SharedShape::halfspace(parry2d::math::Vector::Y);
    world.add(Body::new(Motion::Static, [0.0, 0.0], floor)).unwrap();
    let dominoes: Vec<_> = (0..20)
        .map(|i| {
            let shape = SharedShape::cuboid(0.01, 0.1);
            world.add(Body::new(Motion::Dynamic, [0.08 * i as f32, 0.1], shape)).unwrap()
        })
        .collect();
    let mut ball = Body::new(Motion::Dynamic, [-0.3, 0.15], SharedShape::ball(0.05));
    ball.velocity = Velocity { linear: Vector([2.0, 0.0]), ..Velocity::ZERO };
    ball.colliders[0].material.restitution = 0.3;
    world.add(ball).unwrap();

    for step in 1..=180 {
        world.step(1.0 / 60.0).unwrap();
        if step % 20 == 0 {
            let mut numbers = Vec::new();
            world.write_poses(&mut numbers);
            // Poses are x, y and angle, in the order in which the bodies were added.
            let angle = |id: &drystone::BodyId| numbers[3 * id.index() + 2];
            let fallen = dominoes.iter().filter(|id| angle(id).abs() > 0.5).count();
            println!("{:.2} s: {fallen} of {} have fallen", step as f32 / 60.0, dominoes.len());
        }
    }
}
