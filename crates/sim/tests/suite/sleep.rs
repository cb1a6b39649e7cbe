//! Tests of sleep: bodies at rest sleep, wake when they must, and change nothing else.

use drystone::geometry::{Geometry, Rigid2, Rigid3};
use drystone::{BodyId, Motion, StepSettings, World};
use drystone_solver::{Vector, Velocity};

use crate::common::{
    DT, GRAVITY, Rigid, RoundShapes, add_floor, body, dynamic, moving, place, run, surface, v,
};

type World3 = World<Rigid3, 3, 3>;

fn dozing<G: Rigid<L, A>, const L: usize, const A: usize>() -> World<G, L, A> {
    let mut world = World::new(StepSettings::realtime());
    world.gravity = Vector(v(0.0, -GRAVITY, 0.0));
    add_floor(&mut world, &surface(0.6, 0.0));
    world
}

/// Adds a stack of boxes of half a meter at x.
fn stack<G: Rigid<L, A>, const L: usize, const A: usize>(
    world: &mut World<G, L, A>,
    x: f32,
    height: usize,
) -> Vec<BodyId> {
    let boxes = (0..height).map(|level| {
        let center = v(x, 0.25 + 0.5 * level as f32, 0.0);
        world.add(dynamic(center, G::cuboid(v(0.25, 0.25, 0.25)), &surface(0.6, 0.0))).unwrap()
    });
    boxes.collect()
}

fn numbers<G: Rigid<L, A>, const L: usize, const A: usize>(world: &World<G, L, A>) -> Vec<u32> {
    let mut poses = Vec::new();
    world.write_poses(&mut poses);
    poses.iter().map(|x| x.to_bits()).collect()
}

fn all_sleep<G: Rigid<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
    bodies: &[BodyId],
) -> bool {
    bodies.iter().all(|&id| world.is_sleeping(id))
}

fn none_sleeps<G: Rigid<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
    bodies: &[BodyId],
) -> bool {
    !bodies.iter().any(|&id| world.is_sleeping(id))
}

fn rests<G: Rigid<L, A>, const L: usize, const A: usize>() {
    let mut world = dozing::<G, L, A>();
    let boxes = stack(&mut world, 0.0, 5);
    run(&mut world, 0.4);
    assert!(none_sleeps(&world, &boxes), "before the delay");
    run(&mut world, 1.6);
    assert!(all_sleep(&world, &boxes));
    let (before, depth) = (numbers(&world), world.measure().deepest_penetration);
    let report = world.step(DT).unwrap();
    assert_eq!((report.asleep, report.manifolds, report.contacts), (5, 0, 0));
    run(&mut world, 1.0);
    assert_eq!(numbers(&world), before);
    assert!((world.measure().deepest_penetration - depth).abs() < 1e-4, "still measured");
}

/// A stack at rest sleeps after the delay and then keeps every bit. It has no contacts in a step,
/// and its overlap is still measured.
#[test]
fn bodies_at_rest_sleep_and_stay_in_place() {
    rests::<Rigid2, 2, 1>();
    rests::<Rigid3, 3, 3>();
}

/// An impact wakes the stack that it hits and no other. The stack ends within 2 cm of one that
/// never slept.
#[test]
fn an_impact_wakes_the_island_that_it_hits_and_no_other() {
    let after = |sleep: f32| {
        let mut world: World3 = dozing();
        world.settings.sleep_delay = sleep;
        let (hit, apart) = (stack(&mut world, 0.0, 4), stack(&mut world, 5.0, 4));
        run(&mut world, 2.0);
        assert_eq!(all_sleep(&world, &hit), sleep > 0.0);
        let ball = dynamic([-2.0, 1.75, 0.0], Rigid3::ball(0.3), &surface(0.6, 0.0));
        world.add(moving(ball, [12.0, 1.0, 0.0])).unwrap();
        run(&mut world, 0.3);
        assert!(none_sleeps(&world, &hit));
        assert_eq!(all_sleep(&world, &apart), sleep > 0.0);
        hit.iter().map(|&id| place(&world, id)).collect::<Vec<_>>()
    };
    let (slept, awake) = (after(0.5), after(0.0));
    assert!(awake[3][0] > 0.5, "the impact throws the uppermost box: {awake:?}");
    for (slept, awake) in slept.iter().zip(&awake) {
        assert!((*slept - *awake).length() < 0.02, "{slept:?} and {awake:?}");
    }
}

/// A stack that is put to sleep on a floor sleeps on, until a wall is placed into it.
#[test]
fn a_stack_is_put_to_sleep_where_it_stands() {
    for settings in [StepSettings::realtime(), StepSettings::certified()] {
        let mut world: World3 = World::new(settings);
        world.gravity = Vector([0.0, -GRAVITY, 0.0]);
        add_floor(&mut world, &surface(0.6, 0.0));
        let boxes = stack(&mut world, 0.0, 3);
        boxes.iter().for_each(|&id| world.put_to_sleep(id).unwrap());
        run(&mut world, 0.5);
        assert!(all_sleep(&world, &boxes));
        let wall = Rigid3::cuboid([0.1, 2.0, 1.0]);
        world.add(body(Motion::Static, [0.3, 2.0, 0.0], wall, &surface(0.6, 0.0))).unwrap();
        world.step(DT).unwrap();
        assert!(none_sleeps(&world, &boxes));
    }
}

/// Everything that can move a sleeping stack wakes it in one step: a new pose, velocity, force,
/// gravity or setting, a moving support, and a removed body.
#[test]
fn anything_that_moves_a_sleeping_body_wakes_it() {
    let asleep = || {
        let mut world: World3 = dozing();
        let lift = world
            .add(body(
                Motion::Kinematic,
                [0.0, -0.25, 0.0],
                Rigid3::cuboid([1.0, 0.25, 1.0]),
                &surface(0.6, 0.0),
            ))
            .unwrap();
        let boxes = stack(&mut world, 0.0, 3);
        run(&mut world, 2.0);
        assert!(all_sleep(&world, &boxes));
        (world, boxes, lift)
    };
    let push = Velocity { linear: Vector([1.0, 0.0, 0.0]), angular: Vector::ZERO };
    type Deed = fn(&mut World3, &[BodyId], BodyId, Velocity<f32, 3, 3>);
    let deeds: [(&str, Deed); 7] = [
        ("throw", |world, boxes, _, _| {
            let target = Rigid3::pose(Vector([0.01, 1.25, 0.0]), &[]);
            world.move_to(boxes[2], &target, DT).unwrap();
        }),
        ("velocity", |world, boxes, _, push| world.set_velocity(boxes[2], push).unwrap()),
        ("force", |world, boxes, _, push| world.add_force(boxes[1], push * 10.0).unwrap()),
        ("lift", |world, _, lift, _| {
            let up = Velocity { linear: Vector([0.0, 0.5, 0.0]), angular: Vector::ZERO };
            world.set_velocity(lift, up).unwrap();
        }),
        ("gravity", |world, _, _, _| world.gravity = Vector([0.0, 1.0, 0.0])),
        ("removal", |world, boxes, _, _| assert!(world.remove(boxes[0]))),
        ("setting", |world, _, _, _| world.settings.sleep_delay = 0.0),
    ];
    for (name, deed) in deeds {
        let (mut world, boxes, lift) = asleep();
        deed(&mut world, &boxes, lift, push);
        let before = place(&world, boxes[2]);
        world.step(DT).unwrap();
        assert!(none_sleeps(&world, &boxes), "{name}");
        run(&mut world, 0.2);
        let moved = (place(&world, boxes[2]) - before).length();
        assert!(moved > 1e-3 || name == "setting" || name == "force", "{name}: {moved}");
    }
}

/// A body that a belt carries along at 2 mm/s does not sleep.
#[test]
fn bodies_carried_by_a_belt_do_not_sleep() {
    let mut world: World3 = dozing();
    let belt = Rigid3::cuboid([20.0, 0.25, 1.0]);
    let belt =
        world.add(body(Motion::Kinematic, [0.0, 0.25, 0.0], belt, &surface(0.9, 0.0))).unwrap();
    let slow = Velocity { linear: Vector([0.002, 0.0, 0.0]), angular: Vector::ZERO };
    world.set_velocity(belt, slow).unwrap();
    let load = Rigid3::cuboid([0.25, 0.25, 0.25]);
    let load = world.add(dynamic([0.0, 0.75, 0.0], load, &surface(0.9, 0.0))).unwrap();
    run(&mut world, 3.0);
    assert!(!world.is_sleeping(load));
    assert!(place(&world, load)[0] > 0.004);
}

/// A ball that rolls while other islands sleep moves as if nothing slept, bit by bit. One and two
/// threads give the same bits.
#[test]
fn sleep_changes_nothing_but_rest() {
    let run = |sleep: f32, threads: usize| {
        let mut world: World3 = dozing();
        world.settings.sleep_delay = sleep;
        world.set_threads(threads);
        for x in 0..30 {
            stack(&mut world, 3.0 + x as f32, 6);
        }
        let ball = dynamic([-100.0, 0.3, 0.0], Rigid3::ball(0.3), &surface(0.6, 0.0));
        let rolling = world.add(moving(ball, [3.0, 0.0, 0.5])).unwrap();
        let mut path = Vec::new();
        for _ in 0..180 {
            world.step(DT).unwrap();
            path.push(place(&world, rolling).0.map(f32::to_bits));
        }
        (path, numbers(&world))
    };
    let [one, two] = [1, 2].map(|threads| run(0.5, threads));
    assert_eq!(one, two, "threads");
    assert_eq!(one.0, run(0.0, 1).0, "the ball that rolls");
}

/// A heap of forty boxes that topple comes to rest and sleeps within 20 s.
#[test]
fn a_heap_sleeps_as_a_whole() {
    let mut world: World3 = dozing();
    let boxes: Vec<_> = (0..40)
        .map(|i| {
            let at = [0.1 * (i % 3) as f32, 0.5 + 0.6 * i as f32, 0.13 * (i % 4) as f32];
            world.add(dynamic(at, Rigid3::cuboid([0.25, 0.2, 0.3]), &surface(0.6, 0.0))).unwrap()
        })
        .collect();
    let mut fastest = f32::INFINITY;
    for _ in 0..1200 {
        world.step(DT).unwrap();
        let awake = boxes.iter().filter(|&&id| !world.is_sleeping(id));
        fastest = awake.map(|&id| world.velocity(id).unwrap().linear.length()).fold(0.0, f32::max);
    }
    assert!(all_sleep(&world, &boxes), "fastest: {fastest} m/s");
}
