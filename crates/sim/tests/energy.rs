//! Blows between several bodies, and the ledger that says where energy comes from and goes.

mod common;

use common::*;
use drystone::geometry::{Geometry, Rigid2, Rigid3, Spheres};
use drystone::scene::Motion;
use drystone::{BodyId, ImpactLaw, Ledger, StepSettings, World, World3};
use drystone_solver::{Vector, Velocity};

// Blows

/// Speeds of five balls, of which the first `coming` come in at 1 m/s, after the blow.
fn cradle<G: Round<L, A>, const L: usize, const A: usize>(
    coming: usize,
    law: ImpactLaw,
) -> [f32; 5] {
    let hard = surface(0.0, 1.0);
    let mut world = weightless::<G, L, A>();
    world.settings.impact_law = law;
    let balls: [BodyId; 5] = std::array::from_fn(|i| {
        let (ahead, speed) = if i < coming { (0.25, 1.0) } else { (0.0, 0.0) };
        // A power of two: the balls touch to the last bit.
        let (x, radius) = ((i as f32 - ahead) / 8.0, 1.0 / 16.0);
        let ball = dynamic(v(x, 0.0, 0.0), G::ball(radius), &hard);
        world.add(moving(ball, v(speed, 0.0, 0.0)))
    });
    run(&mut world, 1.0);
    balls.map(|ball| velocity(&world, ball).linear[0])
}

fn cradles<G: Round<L, A>, const L: usize, const A: usize>() {
    let cases = [(1, [0.0, 0.0, 0.0, 0.0, 1.0]), (2, [0.0, 0.0, 0.0, 1.0, 1.0])];
    for (coming, expected) in cases {
        let after = cradle::<G, L, A>(coming, ImpactLaw::Reflections);
        for (after, expected) in after.into_iter().zip(expected) {
            assert_below(&format!("({L},{A}), {coming}: error"), (after - expected).abs(), 1e-6);
        }
    }
    // Compressed together they share; so the law is what the settings say.
    let shared = cradle::<G, L, A>(1, ImpactLaw::Poisson);
    for (after, expected) in shared.into_iter().zip([-0.6, 0.4, 0.4, 0.4, 0.4]) {
        assert_below(&format!("({L},{A}): error of Poisson's"), (after - expected).abs(), 1e-4);
    }
}

#[test]
fn a_cradle_passes_on_as_many_balls_as_come() {
    cradles::<Spheres, 2, 0>();
    cradles::<Spheres, 3, 0>();
    cradles::<Rigid2, 2, 1>();
    cradles::<Rigid3, 3, 3>();
}

/// A cue ball into the tip of a triangle of 15: part of the energy that is left after half a second,
/// and how far velocities are from their mirror image, as a part of the cue's.
fn break_shot<G: Round<L, A>, const L: usize, const A: usize>() -> [f64; 2] {
    let hard = surface(0.0, 1.0);
    let mut world = weightless::<G, L, A>();
    world.settings.restitution_threshold = 1e-5;
    let cue = dynamic(v(-1.5, 0.0, 0.0), G::ball(0.5), &hard);
    world.add(moving(cue, v(8.0, 0.0, 0.0)));
    let mut rack = Vec::new();
    for column in 0..5 {
        for place in 0..=column {
            let along = 0.75f32.sqrt() * column as f32;
            let aside = place as f32 - 0.5 * column as f32;
            let ball = world.add(dynamic(v(along, aside, 0.0), G::ball(0.5), &hard));
            rack.push((column, place, ball));
        }
    }
    let before = energy(&world);
    run(&mut world, 0.5);
    let mut asymmetry = 0.0f64;
    for &(column, place, ball) in &rack {
        let twin = rack.iter().find(|other| (other.0, other.1) == (column, column - place));
        let [one, other] = [ball, twin.unwrap().2].map(|ball| velocity(&world, ball).linear);
        let apart = (one[0] - other[0]).abs().max((one[1] + other[1]).abs());
        asymmetry = asymmetry.max(f64::from(apart) / 8.0);
    }
    [energy(&world) / before, asymmetry]
}

fn breaks<G: Round<L, A>, const L: usize, const A: usize>() {
    let [kept, asymmetry] = break_shot::<G, L, A>();
    println!("({L},{A}): energy kept {kept}, asymmetry {asymmetry:e}");
    assert!((kept - 1.0).abs() < 1e-6, "({L},{A}): energy kept {kept}");
    assert!(asymmetry < 1e-5, "({L},{A}): asymmetry {asymmetry}");
}

#[test]
fn a_break_is_symmetric_and_keeps_its_energy() {
    breaks::<Spheres, 2, 0>();
    breaks::<Spheres, 3, 0>();
    breaks::<Rigid2, 2, 1>();
    breaks::<Rigid3, 3, 3>();
}

// The ledger

/// What the ledgers of a run come to.
#[derive(Debug, Default)]
struct Audit {
    total: Ledger,
    /// Largest kinetic and potential energy above the lowest, which numbers are small against. \[J\]
    turnover: f64,
    /// Largest part of a step's change that the items leave open. \[J\]
    unexplained: f64,
    /// Largest difference between the ledger and what was measured. \[J\]
    mismeasured: f64,
    /// Largest work of friction, and of collisions, in a step. \[J\]
    friction: f64,
    impacts: f64,
    /// Created by contacts in all steps. \[J\]
    created: f64,
    steps: usize,
}

fn audit<G: Geometry<L, A>, const L: usize, const A: usize>(
    world: &mut World<G, L, A>,
    seconds: f32,
    mut before_step: impl FnMut(&mut World<G, L, A>),
) -> Audit {
    world.settings.ledger = true;
    let mut audit =
        Audit { friction: f64::NEG_INFINITY, impacts: f64::NEG_INFINITY, ..Audit::default() };
    let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
    for _ in 0..(seconds / DT).round() as usize {
        before_step(world);
        let start = world.measure();
        let ledger = world.step(DT).energy.expect("a ledger was asked for");
        let end = world.measure();
        lowest = lowest.min(end.potential_energy);
        highest = highest.max(
            end.potential_energy.max(start.potential_energy)
                + end.kinetic_energy.max(start.kinetic_energy),
        );
        let kinetic = end.kinetic_energy - start.kinetic_energy - ledger.kinetic;
        let potential = end.potential_energy - start.potential_energy - ledger.potential;
        audit.mismeasured = audit.mismeasured.max(kinetic.abs()).max(potential.abs());
        audit.unexplained = audit.unexplained.max(ledger.unexplained().abs());
        audit.friction = audit.friction.max(ledger.friction);
        audit.impacts = audit.impacts.max(ledger.impacts);
        audit.created += ledger.created();
        audit.total.join(&ledger);
        audit.steps += 1;
    }
    audit.turnover = highest - lowest;
    println!("{L}D, {A}: {audit:#?}");
    audit
}

#[test]
fn look() {
    // bounce
    let material = surface(0.5, 0.8);
    let mut w = world::<Rigid3, 3, 3>();
    add_floor(&mut w, &material);
    w.add(moving(dynamic([0.0, 2.0, 0.0], Rigid3::ball(0.1), &material), [1.0, 0.0, 0.0]));
    println!("BOUNCE");
    audit(&mut w, 4.0, |_| ());
    // slope
    for angle in [20.0f32, 35.0] {
        println!("SLOPE {angle}");
        let (sin, cos) = angle.to_radians().sin_cos();
        let rough = surface(0.5, 0.0);
        let mut w = world::<Rigid3, 3, 3>();
        w.add(body(Motion::Static, [0.0; 3], Rigid3::halfspace([-sin, cos, 0.0]), &rough));
        let mut b = dynamic([0.0; 3], Rigid3::cuboid([0.5, 0.1, 0.5]), &rough);
        b.pose = Rigid3::turned([-0.1 * sin, 0.1 * cos, 0.0], angle.to_radians());
        w.add(b);
        audit(&mut w, 3.0, |_| ());
    }
    println!("STACK");
    let rough = surface(0.5, 0.0);
    let mut w = world::<Rigid3, 3, 3>();
    add_floor(&mut w, &rough);
    for i in 0..8 {
        w.add(dynamic([0.0, i as f32 + 0.5, 0.0], Rigid3::cuboid([0.5; 3]), &rough));
    }
    audit(&mut w, 3.0, |_| ());
    println!("PILE");
    let rough = surface(0.5, 0.3);
    let mut w = world::<Rigid3, 3, 3>();
    add_floor(&mut w, &rough);
    let mut random = Random(3);
    for i in 0..40 {
        let at = [random.between(-1.0, 1.0), 1.0 + 0.5 * i as f32, random.between(-1.0, 1.0)];
        let shape = if i % 2 == 0 { Rigid3::ball(0.25) } else { Rigid3::cuboid([0.3, 0.2, 0.1]) };
        let mut b = moving(dynamic(at, shape, &rough), random.vector(2.0));
        b.velocity.angular = Vector(random.vector(5.0));
        w.add(b);
    }
    audit(&mut w, 8.0, |_| ());
    println!("TURNTABLE");
    let mut w = world::<Rigid3, 3, 3>();
    let table =
        w.add(body(Motion::Kinematic, [0.0, -0.5, 0.0], Rigid3::cuboid([5.0, 0.5, 5.0]), &rough));
    w.set_velocity(table, Velocity { linear: Vector::ZERO, angular: Vector([0.0, 1.0, 0.0]) });
    w.add(dynamic([2.0, 0.2, 0.0], Rigid3::cuboid([0.2; 3]), &rough));
    audit(&mut w, 2.0, |_| ());
    println!("RACKET");
    let mut w: World3 = weightless();
    let mut b = dynamic([0.0; 3], Rigid3::cuboid([0.5, 0.3, 0.1]), &rough);
    b.velocity.angular = Vector([0.5, 8.0, 0.1]);
    w.add(b);
    audit(&mut w, 3.0, |_| ());
    println!("OVERLAP");
    let mut w = world::<Rigid3, 3, 3>();
    add_floor(&mut w, &rough);
    w.add(dynamic([0.0, 0.45, 0.0], Rigid3::cuboid([0.5; 3]), &rough));
    audit(&mut w, 1.0, |_| ());
    let _ = StepSettings::quality();
}
