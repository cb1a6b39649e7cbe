//! Simulates a stack of boxes with a fixed time step:
//! `cargo run --release -p drystone --example stack`

use drystone::{Body, Motion, StepSettings, World3};
use parry3d::shape::SharedShape;

const STEP: f32 = 1.0 / 60.0;

fn main() {
    let mut world = World3::new(StepSettings::realtime());
    world.gravity = [0.0, -9.81, 0.0].into();
    world
        .add(Body::new(Motion::Static, [0.0, -0.5, 0.0], SharedShape::cuboid(5.0, 0.5, 5.0)))
        .unwrap();
    let crates: Vec<_> = (0..5)
        .map(|i| {
            let position = [0.0, 0.5 + 1.1 * i as f32, 0.0];
            world
                .add(Body::new(Motion::Dynamic, position, SharedShape::cuboid(0.5, 0.5, 0.5)))
                .unwrap()
        })
        .collect();

    // A game draws frames at its own rate, while the world advances in steps of fixed length.
    let (mut behind, frame_time) = (0.0, 1.0 / 144.0);
    for frame in 0..3 * 144 {
        behind += frame_time;
        while behind >= STEP {
            world.step(STEP).unwrap();
            behind -= STEP;
        }
        if frame % 72 == 71 {
            let heights: Vec<_> = crates
                .iter()
                .filter_map(|&id| world.pose(id))
                .map(|pose| format!("{:.3}", pose.translation.y))
                .collect();
            println!("{:.1} s: {}", (frame + 1) as f32 * frame_time, heights.join("  "));
        }
    }
}
