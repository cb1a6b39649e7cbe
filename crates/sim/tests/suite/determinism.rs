//! Tests that the same input gives the same bits: from run to run, on any number of threads, in any
//! build.

use crate::common::*;
use drystone::Dimension;
use drystone::geometry::{Geometry, Particles, Rigid2, Rigid3};
use drystone::{Drive, Joint, Motion, ParticleWorld3, StepSettings, World, World2, World3};
use drystone_solver::Vector;

/// Hashes of the poses of small scenes after 100 steps. A change of the method changes them: the
/// failing test prints the new ones.
const GOLDEN: [(&str, u64); 3] = [
    ("pyramid", 0x3785b7c33b7c1b9e),
    ("mixed pile", 0x8e4caf266c2804e2),
    ("particles", 0xf8b285445f56169d),
];

/// Returns the FNV-1a hash of all poses, bit by bit.
fn hash<G: Dimension<L, A>, const L: usize, const A: usize>(world: &World<G, L, A>) -> u64 {
    let mut poses = Vec::new();
    world.write_poses(&mut poses);
    assert!(poses.iter().all(|x| x.is_finite()));
    poses
        .iter()
        .flat_map(|x| x.to_bits().to_le_bytes())
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3)
        })
}

fn after_steps<G: Dimension<L, A>, const L: usize, const A: usize>(
    mut world: World<G, L, A>,
    threads: usize,
) -> u64 {
    world.set_threads(threads);
    for _ in 0..100 {
        world.step(DT).unwrap();
    }
    hash(&world)
}

/// Returns a pyramid of boxes with small gaps between them.
fn pyramid(rows: usize) -> World2 {
    let material = surface(0.5, 0.1);
    let mut world = world::<Rigid2, 2, 1>();
    add_floor(&mut world, &material);
    for row in 0..rows {
        for column in 0..rows - row {
            let position = [column as f32 * 1.1 + row as f32 * 0.55, 0.55 + row as f32 * 1.05];
            world.add(dynamic(position, Rigid2::cuboid([0.5; 2]), &material)).unwrap();
        }
    }
    world
}

/// Returns boxes, balls, capsules and hulls that fall onto each other.
fn mixed_pile(side: usize, layers: usize) -> World3 {
    let material = surface(0.5, 0.2);
    let mut world = world::<Rigid3, 3, 3>();
    add_floor(&mut world, &material);
    let mut random = Random(1);
    let hull = [
        [-0.3, -0.2, -0.2],
        [0.3, -0.2, -0.3],
        [0.0, -0.25, 0.3],
        [0.1, 0.3, 0.0],
        [-0.2, 0.2, 0.1],
    ];
    for index in 0..side * side * layers {
        let (x, z, y) = (index % side, index / side % side, index / (side * side));
        let offset: [f32; 3] = random.vector(0.1);
        let position = [x as f32 * 0.8, 0.6 + y as f32 * 0.8, z as f32 * 0.8];
        let position = std::array::from_fn(|i| position[i] + offset[i]);
        let shape = match index % 4 {
            0 => Rigid3::cuboid([0.3, 0.25, 0.2]),
            1 => Rigid3::ball(0.3),
            2 => Rigid3::capsule(0.2, 0.15),
            _ => Rigid3::hull(&hull),
        };
        let mut thrown = dynamic(position, shape, &material);
        thrown.pose = Rigid3::pose(Vector(position), &random.quaternion());
        world.add(thrown).unwrap();
    }
    world
}

fn particles(side: usize) -> ParticleWorld3 {
    let material = surface(0.0, 0.5);
    let mut world = world::<Particles, 3, 0>();
    add_floor(&mut world, &material);
    let mut random = Random(2);
    for index in 0..side * side * side {
        let cell = |axis: u32| (index / side.pow(axis) % side) as f32;
        let offset: [f32; 3] = random.vector(0.04);
        let position = [cell(0) + offset[0], cell(1) + 0.6 + offset[1], cell(2) + offset[2]];
        world.add(dynamic(position, Particles::ball(0.45), &material)).unwrap();
    }
    world
}

/// Two runs of a scene give the same bits after 100 steps.
#[test]
fn runs_repeat_bit_by_bit() {
    assert_eq!(after_steps(pyramid(10), 1), after_steps(pyramid(10), 1));
    assert_eq!(after_steps(mixed_pile(4, 4), 1), after_steps(mixed_pile(4, 4), 1));
    assert_eq!(after_steps(particles(6), 1), after_steps(particles(6), 1));
}

/// One, two and four threads give the same bits after 100 steps.
#[test]
fn bits_do_not_depend_on_the_threads() {
    // Enough pairs for several threads to share.
    let (mut flat, mut pile, mut balls) = (pyramid(24), mixed_pile(7, 6), particles(8));
    for _ in 0..50 {
        flat.step(DT).unwrap();
        pile.step(DT).unwrap();
        balls.step(DT).unwrap();
    }
    assert!(
        flat.step(DT)
            .unwrap()
            .pairs
            .min(pile.step(DT).unwrap().pairs)
            .min(balls.step(DT).unwrap().pairs)
            > 256
    );
    let one = [
        after_steps(pyramid(24), 1),
        after_steps(mixed_pile(7, 6), 1),
        after_steps(particles(8), 1),
    ];
    for threads in [2, 4] {
        let more = [
            after_steps(pyramid(24), threads),
            after_steps(mixed_pile(7, 6), threads),
            after_steps(particles(8), threads),
        ];
        assert_eq!(one, more, "1 and {threads} threads");
    }
}

/// Certified steps take the same sweeps and give the same certificates and poses, bit by bit, on
/// one to three threads.
#[test]
fn certified_steps_do_not_depend_on_the_threads() {
    let after = |threads: usize| {
        let mut world = mixed_pile(6, 5);
        world.settings = StepSettings::certified();
        world.set_threads(threads);
        let proven: Vec<_> = (0..60)
            .map(|_| {
                let report = world.step(DT).unwrap();
                let certified = report.certified.expect("a tolerance");
                (report.sweeps, certified.error.to_bits(), certified.residuals.map(f64::to_bits))
            })
            .collect();
        (hash(&world), proven)
    };
    let one = after(1);
    for threads in [2, 3] {
        assert_eq!(after(threads), one, "{threads} threads");
    }
}

/// Small scenes have the golden hashes after 100 steps on every platform and in every build.
#[test]
fn bits_are_the_same_everywhere() {
    let actual = [
        ("pyramid", after_steps(pyramid(5), 1)),
        ("mixed pile", after_steps(mixed_pile(3, 3), 1)),
        ("particles", after_steps(particles(4), 1)),
    ];
    let table: Vec<_> =
        actual.iter().map(|(name, hash)| format!("(\"{name}\", {hash:#018x})")).collect();
    assert!(actual == GOLDEN, "the hashes are now [{}]", table.join(", "));
}

/// Returns towers on a floor, some of them on moving belts, and some that lean and fall onto the
/// next.
fn towers() -> World3 {
    let material = surface(0.5, 0.0);
    let mut world = world::<Rigid3, 3, 3>();
    world.settings = StepSettings { sleep_delay: 0.0, ..StepSettings::realtime() };
    add_floor(&mut world, &material);
    let place = |tower: usize| ((tower % 20) as f32 * 1.4, (tower / 20) as f32 * 3.0);
    for tower in 0..240 {
        // Each belt is added long before the towers on it; no batch may end between the two.
        for ahead in [3, 10, 17].into_iter().filter(|_| tower % 24 == 0) {
            let ((x, z), slab) = (place(tower + ahead), Rigid3::cuboid([0.6, 0.2, 0.6]));
            let belt = body(Motion::Kinematic, [x, 0.0, z], slab, &material);
            world.add(moving(belt, [0.1, 0.05, 0.3])).unwrap();
        }
        let ((x, z), on_belt) = (place(tower), [3, 10, 17].contains(&(tower % 24)));
        let base = if on_belt { 0.2 } else { 0.0 };
        for level in 0..5 {
            let lean = if tower % 31 == 5 { 0.2 * level as f32 } else { 0.0 };
            let position = [x + lean, base + 0.26 + 0.505 * level as f32, z];
            world.add(dynamic(position, Rigid3::cuboid([0.25; 3]), &material)).unwrap();
        }
    }
    world
}

/// Stepping one batch of islands after the other gives the same bits as stepping all together, as a
/// ledger demands, on one to three threads.
#[test]
fn bits_do_not_depend_on_batches() {
    let after = |ledger: bool, threads: usize| {
        let mut world = towers();
        world.settings.ledger = ledger;
        after_steps(world, threads)
    };
    let together = after(true, 1);
    for threads in 1..=3 {
        assert_eq!(after(false, threads), together, "{threads} threads");
    }
}

/// Returns chains and pendulums above a floor, let go level, or at rest if they are `calm`. Some hang on
/// kinematic carriers that were added long before. Bars fall into ropes, which then turn them.
fn machines(calm: bool) -> World3 {
    let material = surface(0.5, 0.0);
    let mut world = world::<Rigid3, 3, 3>();
    world.settings = StepSettings { sleep_delay: 0.0, ..StepSettings::realtime() };
    add_floor(&mut world, &material);
    let place = |machine: usize| [(machine % 12) as f32 * 1.5, (machine / 12) as f32 * 2.5];
    let along = if calm { [0.0, -0.4] } else { [0.4, 0.0] };
    let mut carriers = Vec::new();
    for machine in 0..96 {
        let [x, z] = place(machine);
        // Crates that slide bear on the floor while parts are taken back.
        let sliding = dynamic([x, 0.15, z + 1.0], Rigid3::cuboid([0.15; 3]), &material);
        world.add(moving(sliding, [0.5, 0.0, 0.2])).unwrap();
        if machine % 24 == 0 {
            let (there, rail) = (place(machine + 11), Rigid3::cuboid([0.1; 3]));
            let rail = body(Motion::Kinematic, [there[0], 3.0, there[1]], rail, &material);
            carriers.push(Some(world.add(moving(rail, [0.3, 0.0, 0.1])).unwrap()));
        }
        if machine % 7 == 3 {
            let end = [x, 3.0, z];
            let bar = dynamic([x + 0.05, 3.0, z], Rigid3::cuboid([0.05, 0.03, 0.03]), &material);
            let bar = Some(world.add(bar).unwrap());
            let length = 1.5 + 0.003 * machine as f64;
            world.join(Joint::rope([bar, None], length).at(end)).unwrap();
            continue;
        }
        let mut above = if machine % 24 == 11 { carriers[machine / 24] } else { None };
        for link in 0..5 {
            let way = [0.0, 0.5].map(|part| link as f32 + part);
            let [at, center] = way.map(|way| [x + along[0] * way, 3.0 + along[1] * way, z]);
            let thick = 0.02 + 0.005 * (machine % 5) as f32;
            let half = if calm { [thick, 0.17, 0.03] } else { [0.17, thick, 0.03] };
            let bar = Some(world.add(dynamic(center, Rigid3::cuboid(half), &material)).unwrap());
            let hinge = Joint::hinge([bar, above]).at(at).about([0.0, 0.3, 1.0]);
            let joint = match (machine + link) % 4 {
                0 => Joint::ball([bar, above]).at(at),
                1 => hinge.limits(-0.9..=0.7),
                2 => hinge.drive(Drive::spring(0.2, 3.0, 0.01)),
                _ => hinge,
            };
            world.join(joint).unwrap();
            above = bar;
        }
    }
    world
}

/// So do joints, with the same numbers of substeps. A part in which a batch turns too far is taken back,
/// and bodies take it together.
#[test]
fn bits_of_joints_do_not_depend_on_batches() {
    for (calm, steps) in [(false, 40), (true, 40)] {
        let after = |ledger: bool, threads: usize| {
            let mut world = machines(calm);
            world.settings.ledger = ledger;
            world.set_threads(threads);
            let substeps: Vec<_> = (0..steps).map(|_| world.step(DT).unwrap().substeps).collect();
            (hash(&world), substeps)
        };
        let together = after(true, 1);
        let [least, most] = [together.1.iter().min(), together.1.iter().max()];
        assert!(least < most, "joints turn slowly: {least:?} substeps");
        for threads in 1..=3 {
            assert_eq!(after(false, threads), together, "{threads} threads");
        }
    }
}
