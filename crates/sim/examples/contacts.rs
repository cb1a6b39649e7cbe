//! Reports which bodies begin to touch, with which impulse, and which separate:
//! `cargo run --release -p drystone --example contacts`

use std::collections::BTreeMap;

use drystone::{Body, Motion, StepSettings, Vector, Velocity, World3};
use parry3d::shape::SharedShape;

const STEP: f32 = 1.0 / 60.0;

/// Returns the normal impulse of each pair of bodies that push each other in the last substep. \[N
/// s\]
fn pushing(world: &World3) -> BTreeMap<[u32; 2], f32> {
    let system = world.system();
    let mut pushes = BTreeMap::new();
    for manifold in &system.manifolds {
        let points = &system.contacts[manifold.points()];
        let push: f32 = points.iter().map(|contact| contact.impulse[0]).sum();
        if push > 0.0 {
            let [a, b] = manifold.bodies;
            *pushes.entry([a.min(b), a.max(b)]).or_default() += push;
        }
    }
    pushes
}

fn main() {
    let mut world = World3::new(StepSettings::realtime());
    world.gravity = [0.0, -9.81, 0.0].into();
    let mut names = Vec::new();
    let mut add = |name, body| {
        // Manifolds refer to bodies by the indices of their ids.
        assert_eq!(world.add(body).unwrap().index(), names.len());
        names.push(name);
    };
    let box_of = |x, y, z| SharedShape::cuboid(x, y, z);
    add("floor", Body::new(Motion::Static, [0.0, -0.5, 0.0], box_of(5.0, 0.5, 5.0)));
    add("crate", Body::new(Motion::Dynamic, [0.0, 0.5, 0.0], box_of(0.5, 0.5, 0.5)));
    let mut ball = Body::new(Motion::Dynamic, [-0.3, 1.3, 0.0], SharedShape::ball(0.2));
    ball.velocity = Velocity { linear: Vector([1.0, 0.0, 0.0]), ..Velocity::ZERO };
    add("ball", ball);

    let mut before = BTreeMap::new();
    for step in 1..=150 {
        world.step(STEP).unwrap();
        let now = pushing(&world);
        let name = |pair: &[u32; 2]| pair.map(|body| names[body as usize]).join(" and ");
        for (pair, push) in now.iter().filter(|(pair, _)| !before.contains_key(*pair)) {
            println!("step {step}: {} begin to touch, {push:.2} N s", name(pair));
        }
        for pair in before.keys().filter(|pair| !now.contains_key(*pair)) {
            println!("step {step}: {} let go", name(pair));
        }
        before = now;
    }
}
