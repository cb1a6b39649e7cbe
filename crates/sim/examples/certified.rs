//! Takes certified steps and prints their reports:
//! `cargo run --release -p drystone --example certified`

use drystone::{Body, Motion, Stage, StepSettings, World3};
use parry3d::shape::SharedShape;

fn main() {
    // Every substep is solved until its velocities are within 0.1 mm/s of the exact ones.
    let settings = StepSettings { tolerance: 1e-4, ..StepSettings::certified() };
    let mut world = World3::new(settings);
    world.gravity = [0.0, -9.81, 0.0].into();
    world
        .add(Body::new(Motion::Static, [0.0, -0.5, 0.0], SharedShape::cuboid(5.0, 0.5, 5.0)))
        .unwrap();
    let block = || SharedShape::cuboid(0.5, 0.5, 0.5);
    for i in 0..10 {
        world.add(Body::new(Motion::Dynamic, [0.0, 0.5 + i as f32, 0.0], block())).unwrap();
    }
    // Ten boxes of one ton carry a box of fifty tons.
    let mut heavy = Body::new(Motion::Dynamic, [0.0, 10.5, 0.0], block());
    heavy.colliders[0].density = 5e4;
    let id = world.add(heavy).unwrap();

    world.time_stages(true);
    for step in 1..=120 {
        let report = world.step(1.0 / 60.0).unwrap();
        let Some(certified) = report.certified else { continue };
        for jam in &report.jams {
            println!("step {step}: jammed {:?}", jam.bodies);
        }
        if step % 30 == 0 {
            println!(
                "step {step}: within {:.4} mm/s in {} islands ({} missed it), {} iterations, {} contacts",
                certified.error * 1e3,
                certified.islands,
                certified.failed,
                certified.iterations,
                report.contacts,
            );
            let solving = report.stages[Stage::Solve as usize];
            println!("         {solving:?} of {:?} went to solving", report.time());
        }
    }
    let measure = world.measure();
    println!("deepest overlap {:.3} mm", measure.deepest_penetration * 1e3);
    println!("the heavy one is at {:.4} m", world.pose(id).map_or(0.0, |pose| pose.translation.y));
    assert!(measure.deepest_penetration < 1e-3);
}
