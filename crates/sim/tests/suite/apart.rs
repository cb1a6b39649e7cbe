//! Tests of separated pairs: the gap that collision detection returns, and the contacts left out
//! because of it.

use parry3d::query::{ShapeDistance, distance};

use crate::common::*;
use drystone::geometry::{Geometry, Rigid2, Rigid3};
use drystone::{Motion, StepSettings, World};
use drystone_solver::Vector;

type Shape = <Rigid3 as Geometry<3, 3>>::Shape;

fn shapes() -> Vec<Shape> {
    let corners = [[0.5, 0.0, 0.0], [-0.3, 0.4, 0.1], [0.0, -0.4, 0.2], [0.1, 0.1, -0.5]];
    vec![
        Rigid3::ball(0.3),
        Rigid3::cuboid([0.5, 0.3, 0.2]),
        Rigid3::capsule(0.4, 0.2),
        Rigid3::hull(&corners),
        Rigid3::halfspace([0.0, 1.0, 0.0]),
    ]
}

/// Shapes without a contact are at least as far apart as the returned gap, by parry's distance
/// within 0.1 mm.
#[test]
fn gaps_bound_the_distance_of_shapes() {
    const PREDICTION: f32 = 0.02;
    let random = &mut Random(5);
    let (mut scratch, mut apart) = (<Rigid3 as Geometry<3, 3>>::Scratch::default(), 0);
    for _ in 0..20_000 {
        let mut pick = || shapes().swap_remove(random.between(0.0, 4.999) as usize);
        let (a, b) = (pick(), pick());
        let mut pose = || Rigid3::pose(random.vector(1.2).into(), &random.quaternion());
        let (pose_a, pose_b) = (pose(), pose());
        let Ok(ShapeDistance { distance, .. }) = distance(&pose_a, &*a.0, &pose_b, &*b.0) else {
            continue;
        };
        let (a, b) = (Rigid3::prepare(a), Rigid3::prepare(b));
        let mut touches = 0;
        let mut count = |_: &_| touches += 1;
        let gap = Rigid3::collide(
            (&a, &pose_a),
            (&b, &pose_b),
            PREDICTION,
            None,
            &mut scratch,
            &mut count,
        );
        if touches == 0 {
            apart += 1;
            assert!(gap <= distance + 1e-4, "{gap} m said, {distance} m apart");
        }
    }
    assert!(apart > 1000, "{apart}");
}

/// Rotates a bar on the spot toward a box, from which its end is far most of the time.
fn turning<G: Rigid<L, A>, const L: usize, const A: usize>() {
    let mut world = World::<G, L, A>::new(StepSettings::realtime());
    let rough = surface(0.5, 0.0);
    let mut bar = dynamic([0.0; L], G::cuboid(v(1.0, 0.05, 0.05)), &rough);
    bar.velocity.angular[A - 1] = 1.0;
    world.add(bar).unwrap();
    let other = world.add(dynamic(v(0.0, 0.9, 0.0), G::cuboid([0.1; L]), &rough)).unwrap();
    let mut touched = None;
    for step in 0..120 {
        if world.step(DT).unwrap().contacts > 0 {
            touched.get_or_insert(step);
        }
    }
    // A quarter turn, less the angles that the size of the other box and the prediction distance
    // take off.
    assert!(touched.is_some_and(|step| (70..95).contains(&step)), "{L}D: {touched:?}");
    assert!(velocity(&world, other).linear[0] < -0.1, "{L}D");
}

/// A rotating bar collides with a box that its end reaches after a quarter turn, in step 70 to 94.
/// It drives the box away at more than 0.1 m/s.
#[test]
fn a_rotating_bar_hits_boxes_beside_it() {
    turning::<Rigid2, 2, 1>();
    turning::<Rigid3, 3, 3>();
}

/// Puts a box above the end of a long rotating arm. It has a contact with the arm only if it does
/// not move along.
fn carried<G: Rigid<L, A>, const L: usize, const A: usize>() {
    for (along, near) in [(1.0, false), (0.0, true)] {
        let mut world = World::<G, L, A>::new(StepSettings::realtime());
        let rough = surface(0.5, 0.0);
        let mut arm = body(Motion::Kinematic, [0.0; L], G::cuboid(v(20.0, 0.1, 0.1)), &rough);
        arm.velocity.angular[A - 1] = 0.5;
        let place = v(19.0, 0.25, 0.0);
        let mut carried = dynamic(place, G::cuboid([0.1; L]), &rough);
        carried.velocity.linear = arm.velocity.at(Vector(place)) * along;
        carried.velocity.angular = arm.velocity.angular * along;
        world.add(arm).unwrap();
        world.add(carried).unwrap();
        assert_eq!(world.step(DT).unwrap().contacts > 0, near, "{L}D, {along}");
    }
}

/// A box that moves along with a rotating arm has no contact with it in the first step; one that
/// stands still does.
#[test]
fn bodies_that_rotate_together_are_not_near() {
    carried::<Rigid2, 2, 1>();
    carried::<Rigid3, 3, 3>();
}

/// Swings a bat at a ball; its end moves several times its thickness in a step.
fn swung<G: Rigid<L, A>, const L: usize, const A: usize>() {
    for settings in [StepSettings::realtime(), StepSettings::certified()] {
        for height in [0.3, 0.5, 0.7] {
            let mut world = World::<G, L, A>::new(settings.clone());
            let smooth = surface(0.0, 0.0);
            let shape = G::cuboid(v(2.0, 0.05, 0.05));
            let mut bat = body(Motion::Kinematic, [0.0; L], shape, &smooth);
            bat.velocity.angular[A - 1] = 15.0;
            world.add(bat).unwrap();
            let ball = world.add(dynamic(v(1.8, height, 0.0), G::ball(0.05), &smooth)).unwrap();
            for _ in 0..3 {
                world.step(DT).unwrap();
            }
            let up = velocity(&world, ball).linear[1];
            assert!(up > 15.0, "{L}D, {height} m: {up} m/s");
        }
    }
}

/// A bat whose end moves at 30 m/s does not tunnel through a ball: the ball leaves at more than 15
/// m/s.
#[test]
fn a_bat_hits_a_ball() {
    swung::<Rigid2, 2, 1>();
    swung::<Rigid3, 3, 3>();
}
