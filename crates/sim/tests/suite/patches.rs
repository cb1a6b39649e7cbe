//! Contact patches of any shape: slender ones keep their width, and cylinders rest, stack and roll.

use crate::common::*;
use drystone::geometry::{Geometry, Rigid3};
use drystone::scene::Motion;
use drystone::{Body, BodyId, StepSettings, World, World3};
use drystone_solver::Vector;
use parry3d::shape::SharedShape;

/// Turns the y axis onto z.
const LYING: [f32; 4] =
    [std::f32::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f32::consts::FRAC_1_SQRT_2];

fn with_gravity(settings: StepSettings) -> World3 {
    let mut world: World3 = World::new(settings);
    world.gravity = Vector([0.0, -GRAVITY, 0.0]);
    world
}

fn solid(position: [f32; 3], shape: SharedShape) -> Body<Rigid3, 3, 3> {
    dynamic::<Rigid3, 3, 3>(position, shape, &surface(0.5, 0.0))
}

/// A floor of each kind whose top is at 0, this large.
fn add_ground(world: &mut World3, kind: usize, size: f32) {
    let material = surface(0.5, 0.0);
    let corners = [-1.0f32, 1.0].map(|x| [-1.0f32, 1.0].map(|z| [x, z]));
    let hull: Vec<[f32; 3]> = corners
        .into_iter()
        .flatten()
        .flat_map(|[x, z]| [[x * size, 0.0, z * size], [x * size, -size, z * size]])
        .collect();
    let (shape, height) = match kind {
        0 => (Rigid3::halfspace([0.0, 1.0, 0.0]), 0.0),
        1 => (Rigid3::cuboid([size; 3]), -size),
        2 => (Rigid3::hull(&hull), 0.0),
        _ => (grid(3, 2.0 * size), 0.0),
    };
    world.add(body::<Rigid3, 3, 3>(Motion::Static, [0.0, height, 0.0], shape, &material));
}

fn moved(world: &World3, id: BodyId, from: [f32; 3]) -> f32 {
    (place(world, id) - Vector(from)).length()
}

/// Panels, planks and cards on edge and lying, on all floors, of all sizes.
#[test]
fn slender_patches_stand() {
    for size in [1e-2, 1.0, 10.0] {
        for half in [[0.01, 0.5, 0.5], [0.5, 0.005, 0.01], [0.5, 0.01, 0.004]] {
            let half = half.map(|x: f32| x * size);
            for kind in 0..3 {
                let mut world = with_gravity(StepSettings::quality());
                add_ground(&mut world, kind, 2.0 * size);
                let start = [0.0, half[1], 0.0];
                let id = world.add(solid(start, Rigid3::cuboid(half)));
                run(&mut world, 1.0);
                let what = format!("{half:?} on floor {kind}");
                let leans = 1.0 - upright(&world, id);
                assert_below(&format!("{what}: 1 - cosine of the lean"), leans, 1.5e-6);
                assert_below(&what, moved(&world, id, start), 1e-3 * size.max(0.1));
            }
        }
    }
}

/// Cylinders, standing and lying, stay where they are on all floors.
#[test]
fn cylinders_rest() {
    for settings in [StepSettings::certified(), StepSettings::realtime()] {
        for size in [0.1, 1.0, 10.0] {
            for [radius, half] in [[0.3, 0.6], [1.0, 0.1], [0.1, 3.0]] {
                let [radius, half] = [radius * size, half * size];
                for kind in 0..4 {
                    for lying in [false, true] {
                        let mut world = with_gravity(settings.clone());
                        add_ground(&mut world, kind, 10.0 * size);
                        let height = if lying { radius } else { half };
                        let start = [0.3 * size, height, 0.4 * size];
                        let mut can = solid(start, SharedShape::cylinder(half, radius));
                        if lying {
                            can.pose = Rigid3::pose(Vector(start), &LYING);
                        }
                        let id = world.add(can);
                        run(&mut world, 1.0);
                        let what = format!("{radius} by {half} on floor {kind}, lying: {lying}");
                        assert_below(&what, moved(&world, id, start), 1e-3 * size.max(0.2));
                    }
                }
            }
        }
    }
}

/// A wheel rolls on at its speed.
#[test]
fn a_wheel_keeps_its_speed() {
    for kind in 0..4 {
        let radius = 0.3;
        let mut world = with_gravity(StepSettings::quality());
        add_ground(&mut world, kind, 20.0);
        let start = [-5.0, radius, 0.0];
        let mut wheel = moving(solid(start, SharedShape::cylinder(0.1, radius)), [2.0, 0.0, 0.0]);
        wheel.pose = Rigid3::pose(Vector(start), &LYING);
        wheel.velocity.angular = Vector([0.0, 0.0, -2.0 / radius]);
        let id = world.add(wheel);
        run(&mut world, 3.0);
        assert_within("speed of a wheel", velocity(&world, id).linear[0], 2.0, 0.01);
    }
}
