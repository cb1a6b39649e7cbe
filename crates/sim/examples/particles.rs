//! Lets three hundred particles fall into a funnel:
//! `cargo run --release -p drystone --example particles`

use drystone::geometry::particles::SphereShape;
use drystone::{Body, Motion, ParticleWorld2, StepSettings, Vector};

fn main() {
    let mut world = ParticleWorld2::new(StepSettings::quality());
    world.gravity = [0.0, -9.81].into();
    // Each slope is a half-space. Its normal points outward.
    for normal in [[0.8, 0.6], [-0.8, 0.6]] {
        let shape = SphereShape::Halfspace { normal: Vector(normal) };
        world.add(Body::new(Motion::Static, [0.0, 0.0], shape)).unwrap();
    }
    let grains: Vec<_> = (0..300)
        .map(|i| {
            let (row, column) = (i / 15, i % 15);
            let shift = 0.005 * (row % 2) as f32;
            let position = [0.021 * (column as f32 - 7.0) + shift, 0.3 + 0.021 * row as f32];
            world
                .add(Body::new(Motion::Dynamic, position, SphereShape::Sphere { radius: 0.01 }))
                .unwrap()
        })
        .collect();
    for second in 1..=4 {
        let mut contacts = 0;
        for _ in 0..60 {
            contacts = world.step(1.0 / 60.0).unwrap().contacts;
        }
        let heights = grains.iter().filter_map(|&id| world.pose(id)).map(|place| place[1]);
        println!(
            "{second} s: {contacts} contacts, highest {:.3} m, deepest overlap {:.2} mm",
            heights.fold(0.0, f32::max),
            world.measure().deepest_penetration * 1e3,
        );
    }
}
