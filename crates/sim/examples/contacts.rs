//! Reports which bodies begin to touch, how hard, and which separate:
//! `cargo run --release -p drystone --example contacts`

use std::collections::BTreeMap;

use drystone::{Body, BodyId, InputError, Motion, StepSettings, Vector, Velocity, World3};
use parry3d::shape::SharedShape;

const STEP: f32 = 1.0 / 60.0;

fn main() -> Result<(), InputError> {
    let mut world = World3::new(StepSettings::realtime());
    world.gravity = [0.0, -9.81, 0.0].into();
    world.record_impulses(true);
    let mut names = BTreeMap::new();
    let mut add = |name, body| world.add(body).map(|id| names.insert(id, name));
    let box_of = |x, y, z| SharedShape::cuboid(x, y, z);
    add("floor", Body::new(Motion::Static, [0.0, -0.5, 0.0], box_of(5.0, 0.5, 5.0)))?;
    add("crate", Body::new(Motion::Dynamic, [0.0, 0.5, 0.0], box_of(0.5, 0.5, 0.5)))?;
    let mut ball = Body::new(Motion::Dynamic, [-0.3, 1.3, 0.0], SharedShape::ball(0.2));
    ball.velocity = Velocity { linear: Vector([1.0, 0.0, 0.0]), ..Velocity::ZERO };
    ball.colliders[0].material.restitution = 0.5;
    add("ball", ball)?;

    let mut before: BTreeMap<[BodyId; 2], f32> = BTreeMap::new();
    for step in 1..=150 {
        world.step(STEP)?;
        // Sleeping bodies touch as before.
        let mut now = BTreeMap::new();
        for touching in world.touching() {
            *now.entry(touching.bodies).or_default() += touching.impulse;
        }
        let name = |pair: &[BodyId; 2]| pair.map(|body| names[&body]).join(" and ");
        for (pair, impulse) in now.iter().filter(|(pair, _)| !before.contains_key(*pair)) {
            println!("step {step}: {} begin to touch, {impulse:.2} N s", name(pair));
        }
        for pair in before.keys().filter(|pair| !now.contains_key(*pair)) {
            println!("step {step}: {} let go", name(pair));
        }
        before = now;
    }
    Ok(())
}
