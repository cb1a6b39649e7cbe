//! Tests of the body that the report of an uncertified step names.

use crate::common::*;
use drystone::geometry::{Particles, Rigid2, Rigid3};
use drystone::{StepSettings, World};
use drystone_solver::Vector;

/// A row of touching balls rests on a floor. A ball of a thousand times their weight lies on the
/// last, and sweeps cannot solve those two within a step.
fn row<G: RoundShapes<L, A>, const L: usize, const A: usize>(settings: StepSettings) {
    let smooth = surface(0.0, 0.0);
    let mut world: World<G, L, A> = World::new(settings);
    world.gravity = Vector(v(0.0, -GRAVITY, 0.0));
    add_floor(&mut world, &smooth);
    for i in 0..6 {
        world.add(dynamic(v(i as f32, 0.5, 0.0), G::ball(0.5), &smooth)).unwrap();
    }
    let heavy = dynamic(v(5.0, 1.5, 0.0), G::ball(0.5), &smooth);
    world.add(weighing(heavy, 1e6)).unwrap();
    let certified = world.step(DT).unwrap().certified.unwrap();
    assert_eq!(certified.islands, 1, "({L},{A})");
    assert!(certified.error > 1e-3, "({L},{A}): {certified:?}");
    assert!(certified.worst.is_some_and(|body| body == 6 || body == 7), "({L},{A}): {certified:?}");
}

/// A report names a body at the contact that is not solved, not the first one of its island.
#[test]
fn the_body_at_fault_is_named() {
    let sweeps = StepSettings { certify: true, substeps: 1, ..StepSettings::realtime() };
    row::<Particles, 2, 0>(sweeps.clone());
    row::<Particles, 3, 0>(sweeps.clone());
    row::<Rigid2, 2, 1>(sweeps.clone());
    row::<Rigid3, 3, 3>(sweeps);
}
