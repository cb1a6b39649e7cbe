//! Joints that start apart: repair brings their bodies together, and gives them no velocity.

use drystone::geometry::{Geometry, Rigid3};
use drystone_solver::Vector;

use super::*;

type Join = fn([Option<BodyId>; 2]) -> Joint<Rigid3, 3, 3>;

/// Kinds of joints.
const KINDS: [(&str, Join); 5] = [
    ("ball", Joint::ball),
    ("fixed", Joint::fixed),
    ("hinge", Joint::hinge),
    ("universal", Joint::universal),
    ("slider", Joint::slider),
];

/// Bodies on the other side, with the acceleration of gravity there.
const PARTNERS: [(Option<Motion>, f32); 5] = [
    (None, 0.0),
    (None, -9.81),
    (Some(Motion::Static), 0.0),
    (Some(Motion::Kinematic), -9.81),
    (Some(Motion::Dynamic), 0.0),
];

/// Returns a rotation about an axis as a quaternion.
fn about(axis: [f64; 3], angle: f64) -> [f32; 4] {
    let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [x, y, z] = axis.map(|x| (x / length * (0.5 * angle).sin()) as f32);
    [x, y, z, (0.5 * angle).cos() as f32]
}

/// By how much the frames of a joint miss each other: an offset \[m\] and a rotation; and how far the frame
/// is from the center of its body. \[m\]
fn misses() -> impl Iterator<Item = ([f32; 3], [f32; 4], f32)> {
    let offsets = [[1.0, 2.0, 1.5], [5.0, 5.0, 5.0], [30.0, 40.0, -20.0], [50.0, 0.0, 0.0]];
    let turns = [([1.0, 0.0, 0.0], 0.0), ([1.0, -2.0, 0.7], 0.2), ([0.3, 1.0, 1.0], 1.5)];
    offsets.into_iter().flat_map(move |offset| {
        turns.into_iter().flat_map(move |(axis, angle)| {
            [0.0, 0.3].map(|arm| (offset.map(|x: f32| 0.01 * x), about(axis, angle), arm))
        })
    })
}

/// Bodies that start apart and turned, by little and by much, are together after 4 s, whatever holds them.
/// Without gravity they stand still then. Sleep waits for it.
#[test]
fn what_starts_apart_comes_together() {
    for mut preset in Preset::both() {
        let fastest = if preset.name == "bake" { 0.1 } else { 0.2 };
        preset.settings.sleep_delay = 0.25;
        let each = KINDS.into_iter().flat_map(|kind| PARTNERS.map(|partner| (kind, partner)));
        for ((kind, join), (partner, gravity)) in each {
            for (half, miss) in [[0.1; 3], [0.3, 0.05, 0.02]]
                .into_iter()
                .flat_map(|half| misses().map(move |miss| (half, miss)))
            {
                let (offset, turn, arm) = miss;
                let mut world: World<Rigid3, 3, 3> = preset.weightless();
                world.gravity = Vector([0.0, gravity, 0.0]);
                let mut add = |motion, half| {
                    world.add(Body::new(motion, [0.0; 3], Rigid3::cuboid(half))).unwrap()
                };
                let bodies =
                    [Some(add(Motion::Dynamic, half)), partner.map(|motion| add(motion, [0.1; 3]))];
                let frames = [
                    Rigid3::pose(Vector([arm, 0.0, 0.0]), &about([1.0, 0.0, 0.0], 0.0)),
                    Rigid3::pose(Vector(offset), &turn),
                ];
                world.join(join(bodies).in_bodies(frames)).unwrap();
                let reports = (0..240).map(|_| world.step(DT).unwrap());
                let [gap, angle] = reports.last().unwrap().joint_gap;
                let what = format!(
                    "{}, {kind}, {partner:?}, {gravity} m/s^2, {half:?}, {miss:?}",
                    preset.name
                );
                assert!(gap < 1e-4 && angle < 1e-3, "{what}: {gap} m and {angle} rad apart");
                let Velocity { linear, angular } = world.velocity(bodies[0].unwrap()).unwrap();
                let speed = linear.length().max(angular.length());
                assert!(speed < fastest || gravity != 0.0, "{what}: moves at {speed} m/s");
            }
        }
    }
}

/// A chain whose joints all start apart comes together, and hangs.
#[test]
fn a_chain_that_starts_apart_comes_together() {
    for preset in Preset::both() {
        let mut world: World<Rigid3, 3, 3> = preset.world();
        let (mut above, mut ids) = (None, Vec::new());
        for link in 0..10u8 {
            let at = [0.0, -0.3 * f32::from(link) - 0.1, 0.05 * f32::from(link)];
            let id = world.add(Body::new(Motion::Dynamic, at, Rigid3::cuboid([0.02, 0.1, 0.02])));
            let id = id.unwrap();
            let end = |y: f32| Rigid3::pose(Vector([0.0, y, 0.0]), &[0.0, 0.0, 0.0, 1.0]);
            let top = if above.is_some() { -0.1 } else { 0.0 };
            world.join(Joint::ball([Some(id), above]).in_bodies([end(0.1), end(top)])).unwrap();
            above = Some(id);
            ids.push(id);
        }
        let gaps: Vec<f64> = (0..600).map(|_| world.step(DT).unwrap().joint_gap[0]).collect();
        preset.below("gap in the end", gaps[300..].iter().copied().fold(0.0, f64::max), 1e-4);
        let speeds = ids.iter().map(|id| world.velocity(*id).unwrap().linear.length());
        preset.below("speed on the way", f64::from(speeds.fold(0.0, f32::max)), 10.0);
    }
}

/// The ledger counts what repair lifts: m g times the height, and explains all of the energy.
#[test]
fn the_ledger_tells_what_repair_lifts() {
    for mut preset in Preset::both() {
        preset.settings.ledger = true;
        let mut world: World<Rigid3, 3, 3> = preset.world();
        let mut body = Body::new(Motion::Dynamic, [0.0; 3], Rigid3::cuboid([0.1; 3]));
        body.inertia = Some(inertia(2.0, [0.1; 3]));
        let id = world.add(body).unwrap();
        let pose = |y: f32| Rigid3::pose(Vector([0.0, y, 0.0]), &[0.0, 0.0, 0.0, 1.0]);
        world.join(Joint::fixed([Some(id), None]).in_bodies([pose(0.0), pose(0.3)])).unwrap();
        let (mut repair, mut created) = (0.0, 0.0);
        for _ in 0..120 {
            let ledger = world.step(DT).unwrap().energy.unwrap();
            repair += ledger.repair;
            created += ledger.created();
            assert!(ledger.unexplained().abs() < 1e-6, "{ledger:?}");
        }
        preset.check("what repair lifts", repair, 2.0 * ACCELERATION * 0.3);
        preset.check("what is created", created, 2.0 * ACCELERATION * 0.3);
    }
}

/// A body that repair moves does not fall asleep on its way, and does when it is there.
#[test]
fn sleep_waits_for_repair() {
    for mut preset in Preset::both() {
        preset.settings.sleep_delay = 0.1;
        let mut world: World<Rigid3, 3, 3> = preset.weightless();
        let body = Body::new(Motion::Dynamic, [0.0; 3], Rigid3::cuboid([0.1; 3]));
        let id = world.add(body).unwrap();
        let pose = |y: f32| Rigid3::pose(Vector([0.0, y, 0.0]), &[0.0, 0.0, 0.0, 1.0]);
        world.join(Joint::fixed([Some(id), None]).in_bodies([pose(0.0), pose(0.8)])).unwrap();
        run(&mut world, 2.0);
        preset.below("way left", f64::from((place(&world, id)[1] - 0.8).abs()), 1e-4);
        assert!(world.is_sleeping(id), "{}: awake", preset.name);
    }
}
