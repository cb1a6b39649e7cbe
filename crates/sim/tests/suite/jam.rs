//! Tests that jams are reported, and mere pressure is not.

use crate::common::*;
use drystone::Dimension;
use drystone::geometry::{Geometry, Particles, Rigid2, Rigid3};
use drystone::{BodyId, Drive, Joint, Motion, StepReport, World, World3};
use drystone_solver::Vector;

/// Takes steps, after each of which all values are finite. Returns the bodies that were jammed in
/// any step.
fn jammed<G: Dimension<L, A>, const L: usize, const A: usize>(
    world: &mut World<G, L, A>,
    steps: usize,
) -> Vec<u32> {
    world.settings.certify = true;
    let mut bodies = Vec::new();
    for step in 0..steps {
        let StepReport { jams, .. } = world.step(DT).unwrap();
        assert!(world.measure().finite, "step {step}");
        for jam in jams {
            assert!(jam.missing > 0.0 && jam.least_change > 100.0 * jam.missing, "{jam:?}");
            for &contact in &jam.contacts {
                assert!((contact as usize) < world.system().contacts.len());
            }
            bodies.extend(jam.bodies);
        }
    }
    bodies.sort_unstable();
    bodies.dedup();
    bodies
}

fn indices(ids: &[BodyId]) -> Vec<u32> {
    ids.iter().map(|id| id.index() as u32).collect()
}

/// Puts a box between walls that converge at 0.4 m/s each, and another one beside them.
fn between_walls<G: Rigid<L, A>, const L: usize, const A: usize>(tolerance: f32) {
    let material = surface(0.3, 0.0);
    let mut world = world::<G, L, A>();
    world.settings.tolerance = tolerance;
    add_floor(&mut world, &material);
    let walls = [-1.0, 1.0].map(|side: f32| {
        let wall = body(Motion::Kinematic, v(1.1 * side, 0.8, 0.0), G::cuboid([0.5; L]), &material);
        world.add(moving(wall, v(-0.4 * side, 0.0, 0.0))).unwrap()
    });
    let wedged = world.add(dynamic(v(0.0, 0.5, 0.0), G::cuboid([0.5; L]), &material)).unwrap();
    let free = world.add(dynamic(v(5.0, 0.5, 0.0), G::cuboid([0.5; L]), &material)).unwrap();
    let named = jammed(&mut world, 40);
    for id in walls.into_iter().chain([wedged]) {
        assert!(named.contains(&(id.index() as u32)), "{L}D: {named:?}");
    }
    assert!(!named.contains(&(free.index() as u32)), "{L}D: {named:?}");
    // In the least-squares solution neither wall wins.
    let speed = velocity(&world, wedged).linear.length();
    assert_below(&format!("{L}D: speed between the walls [m/s]"), speed, 0.4);
}

/// A box between converging walls is reported as jammed with both of them, and a box beside them is
/// not. It moves slower than 0.4 m/s.
#[test]
fn a_box_between_converging_walls() {
    for tolerance in [0.0, 1e-3] {
        between_walls::<Rigid2, 2, 1>(tolerance);
        between_walls::<Rigid3, 3, 3>(tolerance);
    }
}

/// The search for jams is part of the certificate: a step without one does not search and reports
/// none.
#[test]
fn no_jam_is_reported_without_certificates() {
    let material = surface(0.3, 0.0);
    let mut world: World3 = world();
    for side in [-1.0, 1.0] {
        let wall = Rigid3::cuboid([0.5; 3]);
        let wall = body(Motion::Kinematic, [0.9 * side, 0.0, 0.0], wall, &material);
        world.add(moving(wall, [-0.4 * side, 0.0, 0.0])).unwrap();
    }
    world.add(dynamic([0.0; 3], Rigid3::cuboid([0.5; 3]), &material)).unwrap();
    assert_eq!(world.step(DT).unwrap().jams, []);
    world.settings.certify = true;
    assert_ne!(world.step(DT).unwrap().jams, []);
}

/// Presses a ball into a groove by a lid that comes down.
fn wedge<G: Rigid<L, A>, const L: usize, const A: usize>() {
    let material = surface(0.2, 0.0);
    let mut world = world::<G, L, A>();
    let slope = std::f32::consts::FRAC_1_SQRT_2;
    let sides = [-1.0, 1.0].map(|side: f32| {
        let shape = G::halfspace(v(-side * slope, slope, 0.0));
        world.add(body(Motion::Static, [0.0; L], shape, &material)).unwrap()
    });
    let ball = world.add(dynamic(v(0.0, 0.5, 0.0), G::ball(0.3), &material)).unwrap();
    let lid = body(Motion::Kinematic, v(0.0, 1.5, 0.0), G::cuboid([0.4; L]), &material);
    let lid = world.add(moving(lid, v(0.0, -0.5, 0.0))).unwrap();
    assert_eq!(jammed(&mut world, 20), Vec::<u32>::new(), "{L}D: the lid is not there yet");
    assert_eq!(jammed(&mut world, 40), indices(&[sides[0], sides[1], ball, lid]), "{L}D");
}

/// A ball pressed into a groove is reported as jammed with both sides and the lid, but not before
/// the lid arrives.
#[test]
fn a_ball_pressed_into_a_groove() {
    wedge::<Rigid2, 2, 1>();
    wedge::<Rigid3, 3, 3>();
}

/// Puts a particle into a slot narrower than itself, so that both sides push it out.
fn slot<const L: usize>()
where
    Particles: RoundShapes<L, 0>,
{
    let material = surface(0.0, 0.0);
    let mut world = weightless::<Particles, L, 0>();
    let sides = [-1.0, 1.0].map(|side: f32| {
        let shape = <Particles as RoundShapes<L, 0>>::halfspace(v(-side, 0.0, 0.0));
        world.add(body(Motion::Static, v(0.095 * side, 0.0, 0.0), shape, &material)).unwrap()
    });
    let particle = Particles::ball(0.1);
    let particle = world.add(dynamic([0.0; L], particle, &material)).unwrap();
    assert_eq!(jammed(&mut world, 10), indices(&[sides[0], sides[1], particle]), "{L}D");
    let speed = velocity(&world, particle).linear.length();
    assert_below(&format!("{L}D: speed in the slot [m/s]"), speed, 1e-3);
}

/// A particle that two sides push against each other is reported as jammed with them, and moves
/// slower than 1 mm/s.
#[test]
fn a_particle_between_contradictory_targets() {
    slot::<2>();
    slot::<3>();
}

/// A pile of sixty bodies that fall and lean on each other and on static walls is not reported as
/// jammed in 5 s.
#[test]
fn a_pile_is_not_jammed() {
    let material = surface(0.5, 0.2);
    let mut world: World3 = world();
    add_floor(&mut world, &material);
    for (x, z) in [(-1.0f32, 0.0f32), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)] {
        let wall = Rigid3::halfspace([-x, 0.0, -z]);
        world.add(body(Motion::Static, [0.7 * x, 0.0, 0.7 * z], wall, &material)).unwrap();
    }
    let mut random = Random(5);
    for i in 0..60 {
        let mut aside = || random.between(-0.3f32, 0.3);
        let turn = Vector([aside(), aside(), aside()]) * 9.0;
        let upright = Rigid3::pose(Vector([aside(), 0.5 + 0.4 * i as f32, aside()]), &[]);
        let mut block = dynamic([0.0; 3], Rigid3::cuboid([0.2, 0.15, 0.12]), &material);
        block.pose = Rigid3::advance(&upright, Vector::ZERO, turn);
        world.add(block).unwrap();
    }
    assert_eq!(jammed(&mut world, 300), Vec::<u32>::new());
}

/// A column with a body 1000 times heavier on top, far more than sweeps carry, is not reported as
/// jammed in 2 s.
#[test]
fn a_loaded_stack_is_not_jammed() {
    let material = surface(0.5, 0.0);
    let mut world: World3 = world();
    add_floor(&mut world, &material);
    for i in 0..10 {
        let mut block = dynamic([0.0, 0.5 + i as f32, 0.0], Rigid3::cuboid([0.5; 3]), &material);
        if i == 9 {
            block.colliders[0].density *= 1000.0;
        }
        world.add(block).unwrap();
    }
    assert_eq!(jammed(&mut world, 120), Vec::<u32>::new());
}

/// Boxes that overlap side by side at the start are not reported as jammed: there is room to
/// separate.
#[test]
fn overlap_at_the_start_is_not_a_jam() {
    let material = surface(0.5, 0.0);
    let mut world: World3 = world();
    add_floor(&mut world, &material);
    for i in 0..5 {
        let x = 0.9 * i as f32;
        world.add(dynamic([x, 0.5, 0.0], Rigid3::cuboid([0.5; 3]), &material)).unwrap();
    }
    assert_eq!(jammed(&mut world, 60), Vec::<u32>::new());
}

/// Joins two bodies at points of both, given in their frames along x.
fn joined_at<G: Rigid<L, A>, const L: usize, const A: usize>(
    bodies: [BodyId; 2],
    points: [f32; 2],
) -> Joint<G, L, A> {
    let pose = |x: f32| G::pose(Vector(v(x, 0.0, 0.0)), &[]);
    Joint::ball(bodies.map(Some)).in_bodies(points.map(pose))
}

/// Closes a loop of bars of 1, 1 and 3 m, which is drawn together beside a free pendulum.
fn open_loop<G: Rigid<L, A>, const L: usize, const A: usize>(tolerance: f32) {
    let material = surface(0.3, 0.0);
    let mut world = weightless::<G, L, A>();
    world.settings.tolerance = tolerance;
    let mut bar = |x: f32, length: f32| {
        let shape = G::cuboid(v(0.5 * length, 0.05, 0.05));
        world.add(dynamic(v(x, 0.0, 0.0), shape, &material)).unwrap()
    };
    let bars = [bar(0.5, 1.0), bar(1.5, 1.0), bar(1.5, 3.0)];
    let others = [bar(10.5, 1.0), bar(11.5, 1.0)];
    let ends = [([0, 1], [0.5, -0.5]), ([0, 2], [-0.5, -1.5]), ([1, 2], [0.5, 1.5])];
    let hold = joined_at::<G, L, A>(others, [0.5, -0.5]);
    world.join(hold).unwrap();
    let joints = ends.map(|(pair, points)| {
        let joint = joined_at::<G, L, A>(pair.map(|bar: usize| bars[bar]), points);
        world.join(joint).unwrap().index() as u32
    });
    world.settings.certify = true;
    for step in 0..20 {
        let jams = world.step(DT).unwrap().jams;
        let [jam] = &jams[..] else { panic!("{L}D, step {step}: {jams:?}") };
        assert_eq!(jam.bodies, indices(&bars), "{L}D, step {step}");
        assert_eq!(jam.joints, joints, "{L}D, step {step}");
        assert!(jam.contacts.is_empty() && jam.missing > 0.1, "{L}D, step {step}: {jam:?}");
    }
}

/// Bars in a loop that their lengths cannot close are reported as jammed, with their joints.
#[test]
fn bars_that_cannot_close_are_jammed() {
    for tolerance in [0.0, 1e-3] {
        open_loop::<Rigid2, 2, 1>(tolerance);
        open_loop::<Rigid3, 3, 3>(tolerance);
    }
}

/// Joints that pull against each other, or come together from afar, are not jammed: springs between
/// two anchors, a redundant four-bar linkage that turns, and a pendulum beside its anchor.
#[test]
fn joints_under_load_are_not_jammed() {
    let material = surface(0.3, 0.0);
    let mut world: World3 = world();
    let shape = || Rigid3::cuboid([0.5, 0.05, 0.05]);
    let held = world.add(dynamic([0.0; 3], shape(), &material)).unwrap();
    for x in [-2.0f32, 2.0] {
        let frames =
            [Rigid3::pose(Vector([0.0; 3]), &[]), Rigid3::pose(Vector([x, 0.0, 0.0]), &[])];
        let spring = Joint::spring([Some(held), None], Drive::spring(0.1, 1e5, 10.0));
        world.join(spring.in_bodies(frames)).unwrap();
    }
    let at = |x: f32, y: f32| [10.0 + x, y, 0.0];
    let mut upright = |x: f32| {
        let body = dynamic(at(x, 0.5), Rigid3::cuboid([0.05, 0.5, 0.05]), &material);
        world.add(moving(body, [2.0, 0.0, 0.0])).unwrap()
    };
    let [left, right] = [upright(0.0), upright(1.0)];
    let coupler = dynamic(at(0.5, 1.0), shape(), &material);
    let coupler = world.add(moving(coupler, [4.0, 0.0, 0.0])).unwrap();
    for (bodies, x, y) in [
        ([Some(left), None], 0.0, 0.0),
        ([Some(right), None], 1.0, 0.0),
        ([Some(coupler), Some(left)], 0.0, 1.0),
        ([Some(coupler), Some(right)], 1.0, 1.0),
    ] {
        world.join(Joint::hinge(bodies).at(at(x, y)).about([0.0, 0.0, 1.0])).unwrap();
    }
    let away = world.add(dynamic([20.0, 0.0, 0.0], shape(), &material)).unwrap();
    let frames = [-0.5f32, 19.0].map(|x| Rigid3::pose(Vector([x, 0.0, 0.0]), &[]));
    world.join(Joint::ball([Some(away), None]).in_bodies(frames)).unwrap();
    for tolerance in [0.0, 1e-3] {
        world.settings.tolerance = tolerance;
        assert_eq!(jammed(&mut world, 60), Vec::<u32>::new());
    }
}
