//! Tests on degenerate systems: copies of a contact, contacts between fixed bodies, extreme mass
//! ratios and contradictory targets. Every method must end with a status and finite numbers.

use crate::common::Scene;
use drystone_solver::assembled::ladder::{self, MatrixMethod};
use drystone_solver::assembled::{self, Assembly, Limits};
use drystone_solver::certificate::certify;
use drystone_solver::island::Islands;
use drystone_solver::solution::{Goal, Solution, Status};
use drystone_solver::{System, Vector, jam, newton, nncg, pgs, psor, symmetric};

type OnBodies<const L: usize, const A: usize> = fn(&mut System<f64, L, A>, &Goal) -> Solution;

/// Runs every method. Returns those that solved the system to 1e-6 m/s, or to a residual of 1e-9.
fn solved_by<const L: usize, const A: usize>(
    name: &str,
    system: &System<f64, L, A>,
) -> Vec<&'static str> {
    let mut solved = Vec::new();
    let methods: [(&'static str, OnBodies<L, A>); 5] = [
        ("pgs", pgs::solve),
        ("symmetric", symmetric::solve),
        ("psor", psor::solve),
        ("nncg", nncg::solve),
        ("newton", newton::solve),
    ];
    for (method, solve) in methods {
        let mut own = system.clone();
        let solution = solve(&mut own, &Goal { tolerance: 1e-6, budget: 2_000 });
        check(name, method, &own);
        assert!(!solution.certificate.duality_gap.is_nan(), "{name}, {method}: {solution:?}");
        let truly = certify(&own, &system.velocities).error() <= 1.01e-6;
        assert!(solution.status != Status::Converged || truly, "{name}, {method}: lies");
        if solution.status == Status::Converged {
            solved.push(method);
        }
    }
    let assembly = Assembly::of_system(system).unwrap();
    let problem = assembly.problem().unwrap();
    let limits = Limits { tolerance: 1e-9, budget: 5_000 };
    let by_ladder = ("ladder", ladder::solve(&problem, None, &limits).outcome);
    let alone =
        MatrixMethod::ALL.map(|method| (method.name(), method.solve(&problem, None, &limits)));
    for (method, outcome) in alone.into_iter().chain([by_ladder]) {
        assert!(!outcome.residual.is_nan(), "{name}, {method}: {outcome:?}");
        let mut own = system.clone();
        assembly.give_back(&outcome.impulses, &mut own);
        own.apply_impulses();
        check(name, method, &own);
        if outcome.status == assembled::Status::Converged {
            assert!(problem.residual(&outcome.impulses) <= 1e-9, "{name}, {method}: lies");
            solved.push(method);
        }
    }
    solved
}

/// Asserts that velocities and impulses are finite.
fn check<const L: usize, const A: usize>(name: &str, method: &str, system: &System<f64, L, A>) {
    for velocity in &system.velocities {
        let finite = velocity.dot(velocity).is_finite();
        assert!(finite, "{name}, {method}: {velocity:?}");
    }
    for contact in &system.contacts {
        let impulse = contact.impulse.dot(contact.impulse);
        assert!(impulse.is_finite(), "{name}, {method}: {contact:?}");
    }
}

/// Returns the axis along which the bodies move and touch.
fn up<const L: usize>() -> Vector<f64, L> {
    Vector(std::array::from_fn(|i| if i == 1 { 1.0 } else { 0.0 }))
}

/// Returns a ball that falls onto a floor, with `copies` of one contact.
fn fallen<const L: usize, const A: usize>(copies: usize) -> Scene<L, A> {
    let mut scene = Scene::new();
    let floor = scene.wall();
    let ball = scene.ball(up(), 1.0);
    scene.system.velocities[ball as usize].linear = up() * -1.0;
    scene.touch([ball, floor], up(), &vec![Vector::ZERO; copies]);
    scene
}

fn copies<const L: usize, const A: usize>(softness: f64, friction: f64) {
    let mut system = fallen::<L, A>(100).system;
    for velocity in &mut system.velocities[1..] {
        velocity.linear[0] = 0.3;
    }
    system.manifolds[0].friction = friction;
    system.prepare(softness);
    let name = format!("100 copies, softness {softness}, friction {friction} ({L},{A})");
    let solved = solved_by(&name, &system);
    assert!(solved.contains(&"ladder"), "{name}: {solved:?}");
    if softness > 0.0 && friction == 0.0 {
        assert!(solved.contains(&"newton"), "{name}: {solved:?}");
    }
}

fn nothing_moves<const L: usize, const A: usize>() {
    let mut scene = fallen::<L, A>(1);
    let walls = [scene.wall(), scene.wall()];
    scene.system.velocities[walls[0] as usize].linear = up() * -3.0;
    scene.push(walls[0], walls[1], up());
    for friction in [0.0, 0.5] {
        for manifold in &mut scene.system.manifolds {
            manifold.friction = friction;
        }
        scene.system.prepare(0.05);
        let solved = solved_by("two walls", &scene.system);
        assert!(solved.contains(&"newton") && solved.contains(&"ladder"), "({L},{A}): {solved:?}");
        // Contacts between walls cannot jam.
        assert_eq!(jam::find(&scene.system, &mut Islands::default(), 0.1, 0), []);
    }
}

fn masses<const L: usize, const A: usize>(ratio: f64) {
    let mut scene = fallen::<L, A>(1);
    let heavy = scene.ball(up() * 3.0, ratio);
    scene.system.velocities[heavy as usize].linear = up() * -1.0;
    scene.push(heavy, 1, up());
    scene.system.prepare(1e-3);
    let name = format!("masses 1 : {ratio:e} ({L},{A})");
    let solved = solved_by(&name, &scene.system);
    println!("{name}: {solved:?}");
    assert!(solved.contains(&"newton"), "{name}: {solved:?}");
}

/// A ball is squeezed between two walls, and both contacts have a target of 1 m/s.
fn contradiction<const L: usize, const A: usize>(softness: f64) {
    let mut scene = Scene::<L, A>::new();
    let ball = scene.ball(Vector::ZERO, 1.0);
    for side in [1.0, -1.0] {
        let wall = scene.wall();
        scene.push(ball, wall, up::<L>() * side);
    }
    for contact in &mut scene.system.contacts {
        contact.target[0] = 1.0;
    }
    scene.system.prepare(softness);
    let name = format!("contradiction, softness {softness} ({L},{A})");
    let solved = solved_by(&name, &scene.system);
    if softness == 0.0 {
        assert_eq!(solved, [] as [&str; 0], "{name}");
    } else {
        assert!(solved.contains(&"newton") && solved.contains(&"ladder"), "{name}: {solved:?}");
    }
    let mut own = scene.system.clone();
    pgs::solve(&mut own, &Goal { tolerance: 1e-9, budget: 100 });
    let jams = jam::find(&own, &mut Islands::default(), 0.1, 0);
    assert_eq!(jams.len(), 1, "{name}");
    assert_eq!((&jams[0].contacts[..], &jams[0].bodies[..]), (&[0, 1][..], &[0, 1, 2][..]));
    // Each contact misses 1 m/s; the velocity of the ball cancels in the mean.
    assert!((jams[0].missing - 1.0).abs() < 1e-6, "{name}: {jams:?}");
}

#[test]
fn copies_of_a_contact() {
    for (softness, friction) in [(0.1, 0.0), (0.1, 0.5), (0.0, 0.0), (0.0, 0.5)] {
        in_all_four!(copies, softness, friction);
    }
}

#[test]
fn contacts_between_fixed_bodies() {
    in_all_four!(nothing_moves);
}

#[test]
fn masses_far_apart() {
    for ratio in [1e3, 1e6, 1e9, 1e-9] {
        in_all_four!(masses, ratio);
    }
}

#[test]
fn targets_that_contradict_each_other() {
    for softness in [0.0, 0.1] {
        in_all_four!(contradiction, softness);
    }
}
