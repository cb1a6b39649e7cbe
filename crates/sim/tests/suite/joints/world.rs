//! Joints as parts of a world: momenta, order, sleep, collisions, removal and refusals.

use drystone::geometry::{Particles, Rigid2, Rigid3};
use drystone::{
    Breaking, Coordinate, Drive, InputError, Joint, JointAxis, JointFault, JointId, Material,
    Softness, World,
};
use drystone_solver::{Vector, Velocity};

use super::*;

type World3 = World<Rigid3, 3, 3>;

/// Adds a chain of boxes along x, joined by all kinds of joints in turn.
fn add_mechanism(world: &mut World3, order: &[usize], exchanged: bool) -> Vec<BodyId> {
    let mut random = Random(5);
    let ids: Vec<BodyId> = (0..7)
        .map(|i| {
            let mut body = ghost([0.4 * i as f64, 0.0, 0.0], block(1.0, [0.2, 0.1, 0.05]));
            body.velocity.linear = Vector(random.vector(1.0));
            body.velocity.angular = Vector(random.vector(3.0));
            world.add(body).unwrap()
        })
        .collect();
    for &i in order {
        let bodies = [Some(ids[i]), Some(ids[i + 1])];
        let bodies = if exchanged { [bodies[1], bodies[0]] } else { bodies };
        let joint = match i {
            0 => Joint::ball(bodies),
            1 => Joint::hinge(bodies),
            2 => Joint::slider(bodies),
            3 => Joint::piston(bodies),
            _ => Joint::fixed(bodies),
        };
        let axis = [[0.0, 1.0, 0.0], [0.6, 0.0, 0.8]][i % 2];
        world.join(joint.at([0.4 * i as f32 + 0.2, 0.0, 0.0]).about(axis)).unwrap();
    }
    ids
}

/// Returns linear and angular momentum about the origin.
fn momenta(world: &World3, ids: &[BodyId]) -> [Vector<f64, 3>; 2] {
    let inertia = block::<3, 3>(1.0, [0.2, 0.1, 0.05]);
    let mut sums = [Vector::ZERO; 2];
    for &id in ids {
        let at = place(world, id).cast::<f64>();
        let linear = velocity(world, id).linear.cast::<f64>();
        sums[0] += linear;
        let moment = [1, 2, 0].map(|y: usize| {
            let z = (y + 1) % 3;
            at[y] * linear[z] - at[z] * linear[y]
        });
        sums[1] += Vector(moment);
        sums[1] += angular_momentum(world, id, inertia.moments).cast::<f64>();
    }
    sums
}

/// Without gravity a mechanism keeps its linear and angular momentum and its energy.
#[test]
fn a_free_mechanism_keeps_its_momenta() {
    for preset in Preset::both() {
        let mut world = preset.weightless();
        let ids = add_mechanism(&mut world, &[0, 1, 2, 3, 4, 5], false);
        // The first step takes out the velocities that the joints do not allow.
        world.step(DT).unwrap();
        let ([linear, angular], start) = (momenta(&world, &ids), energy(&world));
        let (mut worst, mut drift, mut gap) = ([0.0f64; 2], 0.0f64, [0.0f64; 2]);
        for _ in 0..600 {
            let report = world.step(DT).unwrap();
            gap = [0, 1].map(|i: usize| gap[i].max(report.joint_gap[i]));
            let now = momenta(&world, &ids);
            worst[0] = worst[0].max((now[0] - linear).length());
            worst[1] = worst[1].max((now[1] - angular).length());
            drift = drift.max((energy(&world) - start).abs());
        }
        let scale = linear.length();
        preset.below("free mechanism: momentum", worst[0] / scale, 1e-4);
        preset.below("free mechanism: angular momentum", worst[1] / angular.length(), preset.part);
        preset.below("free mechanism: energy", drift / start, preset.part);
        preset.below("free mechanism: gap", gap[0], preset.gap);
        preset.below("free mechanism: angle", gap[1], 1e-3);
    }
}

/// Neither the order of joints nor which body is a changes the motion beyond rounding.
#[test]
fn order_and_sides_do_not_matter() {
    for preset in Preset::both() {
        let run = |order: &[usize], exchanged: bool| -> Vec<Vector<f32, 3>> {
            let mut world = preset.world();
            let ids = add_mechanism(&mut world, order, exchanged);
            run(&mut world, 1.0);
            ids.iter().map(|&id| place(&world, id)).collect()
        };
        let first = run(&[0, 1, 2, 3, 4, 5], false);
        for (name, other) in [
            ("reversed", run(&[5, 4, 3, 2, 1, 0], false)),
            ("mixed", run(&[3, 0, 5, 2, 4, 1], false)),
            ("exchanged", run(&[0, 1, 2, 3, 4, 5], true)),
        ] {
            let apart = first.iter().zip(&other).map(|(one, other)| (*one - *other).length());
            preset.below(&format!("{name} joints"), f64::from(apart.fold(0.0, f32::max)), 1e-3);
        }
    }
}

/// A chain that hangs still falls asleep, and wakes whole when one link is touched.
#[test]
fn a_sleeping_chain_wakes_whole() {
    let mut world: World3 = World::new(StepSettings::realtime());
    world.gravity = Vector([0.0, -GRAVITY, 0.0]);
    let mut before = None;
    let mut ids = Vec::new();
    for i in 0..10 {
        let top = -0.2 * f64::from(i);
        let id = world.add(bar([[0.0, top], [0.0, top - 0.2]], thin_rod(1.0, 0.2))).unwrap();
        world.join(Joint::ball([Some(id), before]).at([0.0, top as f32, 0.0])).unwrap();
        before = Some(id);
        ids.push(id);
    }
    run(&mut world, 3.0);
    let asleep = |world: &World3| ids.iter().filter(|&&id| world.is_sleeping(id)).count();
    assert_eq!(asleep(&world), 10, "the chain hangs still");
    let kick = Velocity { linear: Vector([1.0, 0.0, 0.0]), angular: Vector::ZERO };
    world.set_velocity(ids[9], kick).unwrap();
    world.step(DT).unwrap();
    assert_eq!(asleep(&world), 0, "one link has been pushed");
}

/// A row of blocks is joined and sleeps, and a ball of their mass hits the first. All wake in that
/// step, and take its momentum: a block that is joined to a sleeper would stand like a wall.
#[test]
fn a_sleeping_row_takes_the_momentum_of_a_ball() {
    for preset in Preset::both() {
        let mut world: World3 = preset.weightless();
        let mut add = |x: f32, shape, speed: f32| {
            let mut body = dynamic([x, 0.0, 0.0], shape, &Material::default());
            body.inertia = Some(inertia(1.0, [0.1; 3]));
            body.velocity.linear = Vector([speed, 0.0, 0.0]);
            world.add(body).unwrap()
        };
        let row = [0.0, 1.0, 2.0].map(|x| add(x, Rigid3::cuboid([0.25; 3]), 0.0));
        let ball = add(-1.0, Rigid3::ball(0.25), 4.0);
        // The last joint comes first: a pass over the joints wakes one block.
        for pair in [[row[2], row[1]], [row[1], row[0]]] {
            world.join(Joint::fixed(pair.map(Some))).unwrap();
        }
        row.iter().for_each(|&id| world.put_to_sleep(id).unwrap());
        let mut wakes = 0;
        for _ in 0..20 {
            world.step(DT).unwrap();
            let asleep = row.iter().filter(|&&id| world.is_sleeping(id)).count();
            assert!(asleep == 0 || asleep == 3, "{asleep} of 3 sleep");
            wakes += usize::from(asleep == 0);
        }
        assert!(wakes > 5);
        let speed = |id| f64::from(velocity(&world, id).linear[0]);
        for id in row {
            preset.check("speed after the impact", speed(id), 1.0);
        }
        // In real time repair of the overlap leaves the ball at 0.93 m/s.
        let momentum = row.map(speed).iter().sum::<f64>() + speed(ball);
        preset.check("momentum", momentum, 4.0);
    }
}

/// A motor keeps its bodies awake.
#[test]
fn a_motor_keeps_awake() {
    let mut world: World3 = World::new(StepSettings::realtime());
    let body = world.add(ghost([0.0; 3], inertia(1.0, [1.0; 3]))).unwrap();
    let motor = Drive::velocity(1e-3);
    let hinge = world.join(Joint::hinge([Some(body), None]).drive(motor)).unwrap();
    run(&mut world, 3.0);
    assert!(!world.is_sleeping(body));
    world.drive(hinge, Drive::velocity(0.0)).unwrap();
    run(&mut world, 3.0);
    assert!(world.is_sleeping(body));
    world.drive(hinge, Drive::velocity(1.0)).unwrap();
    run(&mut world, 1.0);
    assert!((value(&world, hinge) - 1.0).abs() < 0.02, "{}", value(&world, hinge));
}

/// Shapes of joined bodies pass through each other unless the joint says that they collide, and
/// collide again when it is gone.
#[test]
fn joined_shapes_collide_only_if_they_are_told() {
    for preset in Preset::both() {
        let run_apart = |collide: bool, freed: Option<bool>| -> f32 {
            let mut world: World3 = preset.weightless();
            let bodies = [0.0, 0.15].map(|x| {
                let shape = Rigid3::cuboid([0.1; 3]);
                world.add(dynamic([x, 0.0, 0.0], shape, &Material::default())).unwrap()
            });
            let axis = JointAxis::free(Coordinate::Linear(0));
            let slider = Joint::general(bodies.map(Some), vec![axis]);
            let slider = Joint { collide, ..slider };
            let slider = world.join(slider).unwrap();
            run(&mut world, 1.0);
            match freed {
                Some(true) => assert!(world.unjoin(slider)),
                Some(false) => world.enable_joint(slider, false).unwrap(),
                None => {}
            }
            run(&mut world, 1.0);
            place(&world, bodies[1])[0] - place(&world, bodies[0])[0]
        };
        let apart = [(false, None), (true, None), (false, Some(true)), (false, Some(false))]
            .map(|(collide, freed)| run_apart(collide, freed));
        assert!((apart[0] - 0.15).abs() < 1e-6, "{apart:?}");
        assert!(apart[1..].iter().all(|apart| *apart > 0.195), "{apart:?}");
    }
}

/// A joint that is removed lets go, one of a removed body goes with it, and stale identifiers are
/// refused.
#[test]
fn removed_joints_let_go_and_stale_identifiers_are_refused() {
    for preset in Preset::both() {
        let mut world: World<Particles, 3, 0> = preset.world();
        let [a, b, c] = [1.0, 2.0, 3.0]
            .map(|depth| world.add(ghost([0.0, -depth, 0.0], inertia(1.0, [1.0; 3]))).unwrap());
        let still = [Vector::ZERO; 2].map(|at| Particles::pose(at, &[]));
        let rope = |bodies: [Option<BodyId>; 2]| Joint::rope(bodies, 1.0).in_bodies(still);
        let joints = [[Some(a), None], [Some(b), Some(a)], [Some(c), Some(b)]]
            .map(|bodies| world.join(rope(bodies)).unwrap());
        run(&mut world, 1.0);
        let force = |world: &World<Particles, 3, 0>, id| world.joint(id).unwrap().force;
        preset.check("rope of three", force(&world, joints[0]), 3.0 * ACCELERATION);
        assert_eq!(world.joints().collect::<Vec<_>>(), joints);
        assert_eq!(world.bodies_of(joints[1]), Some([Some(b), Some(a)]));
        assert!(world.remove(c));
        assert_eq!(world.joints().collect::<Vec<_>>(), joints[..2]);
        refused(&mut world, joints[2]);
        run(&mut world, 1.0);
        preset.check("rope of two", force(&world, joints[0]), 2.0 * ACCELERATION);
        assert!(world.unjoin(joints[1]));
        refused(&mut world, joints[1]);
        run(&mut world, 1.0);
        preset.check("rope of one", force(&world, joints[0]), ACCELERATION);
        let way = f64::from(place(&world, b)[1]) + 2.0;
        preset.check("free fall", way, -0.5 * ACCELERATION);
        let again = world.join(rope([Some(b), Some(a)])).unwrap();
        assert_ne!(again, joints[1], "the slot has another generation");
        refused(&mut world, joints[1]);
        world.enable_joint(joints[0], false).unwrap();
        run(&mut world, 1.0);
        assert!(place(&world, a)[1] < -2.0, "the joint is switched off");
        let mut other: World<Particles, 3, 0> = preset.world();
        refused(&mut other, joints[0]);
    }
}

fn refused(world: &mut World<Particles, 3, 0>, id: JointId) {
    let unknown = Err(InputError::Joint(JointFault::Unknown));
    assert_eq!(world.joint(id), None);
    assert_eq!(world.joint_axes(id), None);
    assert_eq!(world.bodies_of(id), None);
    assert_eq!(world.set_joint_axes(id, Vec::new()), unknown);
    assert_eq!(world.drive(id, Drive::velocity(1.0)), unknown);
    assert_eq!(world.enable_joint(id, true), unknown);
    assert!(!world.unjoin(id));
}

/// Joints that cannot be are refused with their reason, and the world stays as it is.
#[test]
fn bad_joints_are_refused_by_name() {
    let mut world: World<Rigid2, 2, 1> = weightless();
    let body = world.add(ghost([0.0; 3], inertia(1.0, [1.0; 3]))).unwrap();
    let shape = Rigid2::ball(1.0);
    let fixed = |motion| Body::new(motion, [9.0, 0.0], shape.clone());
    let floor = world.add(fixed(Motion::Static)).unwrap();
    let lift = world.add(fixed(Motion::Kinematic)).unwrap();
    let gone = world.add(fixed(Motion::Static)).unwrap();
    assert!(world.remove(gone));
    let at = [Some(body), None];
    let of = |axis: JointAxis| Joint::general(at, vec![axis]);
    let distance = Coordinate::Distance;
    let fault = |fault: JointFault| InputError::Joint(fault);
    for (joint, expected) in [
        (Joint::ball([Some(gone), None]), InputError::UnknownBody),
        (Joint::ball([Some(body), Some(body)]), fault(JointFault::SameBody)),
        (Joint::ball([None, None]), fault(JointFault::NothingMoves)),
        (Joint::ball([Some(floor), None]), fault(JointFault::NothingMoves)),
        (Joint::ball([Some(floor), Some(lift)]), fault(JointFault::NothingMoves)),
        (
            of(JointAxis::free(Coordinate::Twist)),
            fault(JointFault::NoSuchCoordinate(Coordinate::Twist)),
        ),
        (
            of(JointAxis::locked(Coordinate::Linear(2), 0.0)),
            fault(JointFault::NoSuchCoordinate(Coordinate::Linear(2))),
        ),
        (
            Joint::general(at, vec![JointAxis::free(distance); 2]),
            fault(JointFault::Twice(distance)),
        ),
        (of(JointAxis::limited(distance, [2.0, 1.0])), fault(JointFault::Limits([2.0, 1.0]))),
    ] {
        assert_eq!(world.join(joint).unwrap_err(), expected);
    }
    assert_eq!(world.joints().count(), 0);
    let locked = world.join(Joint::ball(at)).unwrap();
    let error = world.drive(locked, Drive::velocity(1.0)).unwrap_err();
    assert_eq!(error, fault(JointFault::Locked));
}

/// Numbers of joints that are negative, infinite or NaN where they must not are refused.
#[test]
fn bad_numbers_of_joints_are_refused() {
    let mut world: World<Rigid2, 2, 1> = weightless();
    let body = world.add(ghost([0.0; 3], inertia(1.0, [1.0; 3]))).unwrap();
    let (at, distance) = ([Some(body), None], Coordinate::Distance);
    let of = |axis: JointAxis| Joint::general(at, vec![axis]);
    let drive = |drive: Drive| of(JointAxis { drives: vec![drive], ..JointAxis::free(distance) });
    let soft = |stiffness: f64| {
        let softness = Some(Softness { stiffness, damping: 0.0 });
        of(JointAxis { softness, ..JointAxis::locked(distance, 1.0) })
    };
    for joint in [
        of(JointAxis::limited(distance, [f64::NAN, 1.0])),
        of(JointAxis { friction: -1.0, ..JointAxis::free(distance) }),
        of(JointAxis { friction: f64::NAN, ..JointAxis::free(distance) }),
        drive(Drive::spring(0.0, -1.0, 0.0)),
        drive(Drive::spring(f64::INFINITY, 1.0, 0.0)),
        drive(Drive::velocity(f64::NAN)),
        drive(Drive::velocity(1.0).at_most(-1.0)),
        soft(0.0),
        soft(-1.0),
        of(JointAxis::locked(Coordinate::Gear { ratio: f64::NAN }, 0.0)),
        of(JointAxis::locked(Coordinate::Pulley { points: [[f64::NAN; 3]; 2], ratio: 1.0 }, 0.0)),
        of(JointAxis::locked(Coordinate::Pulley { points: [[0.0; 3]; 2], ratio: f64::NAN }, 0.0)),
        of(JointAxis::locked(distance, f64::INFINITY)),
        Joint::ball(at).at([f32::NAN, 0.0]),
        Joint::ball(at).breaking(Breaking { force: f64::NAN, ..Breaking::NEVER }),
        Joint::ball(at).breaking(Breaking { force: -1.0, ..Breaking::NEVER }),
    ] {
        let text = format!("{:?} {:?}", joint.axes, joint.breaking);
        assert!(world.join(joint).is_err(), "{text}");
    }
    assert_eq!(world.joints().count(), 0);
}

/// A plank that a motor turns slowly on the floor keeps its manifolds for some steps, while its mass
/// matrix turns with it. A world that is restored builds them anew, and moves with the same bits.
#[test]
fn a_plank_that_turns_slowly_is_restored() {
    for preset in Preset::both() {
        let start = || {
            let mut world: World3 = preset.world();
            let floor = Rigid3::halfspace([0.0, 1.0, 0.0]);
            world.add(Body::new(Motion::Static, [0.0; 3], floor)).unwrap();
            let shape = Rigid3::cuboid([0.5, 0.05, 0.1]);
            let plank = world.add(Body::new(Motion::Dynamic, [0.0, 0.05, 0.0], shape)).unwrap();
            let hinge = Joint::hinge([Some(plank), None]).about([0.0, 1.0, 0.0]);
            world.join(hinge.drive(Drive::velocity(0.003))).unwrap();
            world
        };
        let mut world = start();
        for step in 0..60 {
            world.step(DT).unwrap();
            let mut other = start();
            other.restore(&world.checkpoint()).unwrap();
            world.step(DT).unwrap();
            other.step(DT).unwrap();
            assert!(world.checkpoint() == other.checkpoint(), "{}, step {step}", preset.name);
        }
    }
}
