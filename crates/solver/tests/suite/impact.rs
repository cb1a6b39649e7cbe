//! Tests of the laws of impact, which say how contacts respond that collide at once.

use crate::common::{Random, Recipe, Scene, assert_all_close, assert_close, random_scene};
use drystone_solver::restitution::{ImpactLaw, ImpactSettings, ImpactSolver, collide};
use drystone_solver::{System, Vector, Velocity};
use proptest::prelude::*;

const LAWS: [ImpactLaw; 3] = [ImpactLaw::Newton, ImpactLaw::Poisson, ImpactLaw::Reflections];

/// Resolves collisions, with at most 400 sweeps per impact. The bodies do not move and no forces
/// act.
fn resolve<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    law: ImpactLaw,
    threshold: f64,
    rounds: usize,
) -> usize {
    sweeping(system, law, threshold, rounds, 400)
}

/// Resolves collisions like [`resolve`], with at most this many sweeps per impact.
fn sweeping<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    law: ImpactLaw,
    threshold: f64,
    rounds: usize,
    sweeps: usize,
) -> usize {
    let mut moved = vec![Velocity::ZERO; system.velocities.len()];
    let how = ImpactSettings { law, dt: 0.0, threshold, rounds, sweeps };
    let forced = moved.clone();
    collide(system, &mut moved, &forced, &how, &mut ImpactSolver::default())
}

fn along<const L: usize>(x: f64) -> Vector<f64, L> {
    Vector(std::array::from_fn(|i| if i == 0 { x } else { 0.0 }))
}

/// Returns a row of touching balls with these masses, and with these speeds along the row.
fn row<const L: usize, const A: usize>(
    masses: &[f64],
    speeds: &[f64],
    restitution: f64,
) -> Scene<L, A> {
    let mut scene = Scene::new();
    for (i, (&mass, &speed)) in masses.iter().zip(speeds).enumerate() {
        let ball = scene.ball(along(i as f64), mass);
        scene.system.velocities[ball as usize].linear = along(speed);
        if ball > 0 {
            scene.push(ball, ball - 1, along(1.0));
        }
    }
    for manifold in &mut scene.system.manifolds {
        manifold.restitution = restitution;
    }
    scene
}

fn speeds<const L: usize, const A: usize>(scene: &Scene<L, A>) -> Vec<f64> {
    scene.system.velocities.iter().map(|velocity| velocity.linear[0]).collect()
}

/// Checks the speeds of five equal balls in a row after their collisions.
fn cradle<const L: usize, const A: usize>(
    law: ImpactLaw,
    restitution: f64,
    before: [f64; 5],
    after: [f64; 5],
) {
    let mut scene = row::<L, A>(&[1.0; 5], &before, restitution);
    resolve(&mut scene.system, law, 1e-9, 1000);
    assert_all_close(speeds(&scene), after, 1e-10);
}

#[test]
fn a_cradle_passes_on_as_many_balls_as_come() {
    use ImpactLaw::{Newton, Poisson, Reflections};
    for law in [Newton, Reflections] {
        in_all_four!(cradle, law, 1.0, [1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 1.0]);
        in_all_four!(cradle, law, 1.0, [1.0, 1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, 1.0]);
        in_all_four!(cradle, law, 1.0, [1.0, 1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0, 1.0]);
        in_all_four!(cradle, law, 1.0, [1.0, 0.0, 0.0, 0.0, -1.0], [-1.0, 0.0, 0.0, 0.0, 1.0]);
    }
    // Compression brings all five balls to a common speed. Expansion then repeats the compression
    // impulses times the restitution.
    in_all_four!(cradle, Poisson, 1.0, [1.0, 0.0, 0.0, 0.0, 0.0], [-0.6, 0.4, 0.4, 0.4, 0.4]);
    in_all_four!(cradle, Poisson, 0.5, [1.0, 0.0, 0.0, 0.0, 0.0], [-0.2, 0.3, 0.3, 0.3, 0.3]);
}

/// Counts the collisions of a light ball between a wall and an approaching ball `ratio` times as
/// heavy (G. Galperin, "Playing pool with pi", 2003).
fn collisions_with_wall<const L: usize, const A: usize>(ratio: f64, law: ImpactLaw) -> usize {
    let mut scene = Scene::<L, A>::new();
    let wall = scene.wall();
    let light = scene.ball(along(1.0), 1.0);
    let heavy = scene.ball(along(2.0), ratio);
    scene.push(light, wall, along(1.0));
    scene.push(heavy, light, along(1.0));
    for manifold in &mut scene.system.manifolds {
        manifold.restitution = 1.0;
    }
    scene.system.velocities[heavy as usize].linear = along(-1.0);
    resolve(&mut scene.system, law, 0.0, 10_000)
}

/// Collisions with the wall and between the balls alternate, so velocities alone determine their
/// order.
fn digits_of_pi<const L: usize, const A: usize>() {
    for law in [ImpactLaw::Newton, ImpactLaw::Reflections] {
        for (ratio, count) in [(1.0, 3), (1e2, 31), (1e4, 314), (1e6, 3141)] {
            assert_eq!(collisions_with_wall::<L, A>(ratio, law), count, "{law:?}, {ratio}");
        }
    }
}

#[test]
fn two_balls_and_a_wall_count_the_digits_of_pi() {
    in_all_four!(digits_of_pi);
}

/// Returns a cue ball that moves along x into the tip of a triangle of 15 touching balls.
fn break_shot(restitution: f64) -> Scene<2, 0> {
    let mut scene = Scene::new();
    let half = 0.5f64;
    let depth = 3f64.sqrt() * half;
    let cue = scene.ball(Vector([-1.0, 0.0]), 1.0);
    scene.system.velocities[cue as usize].linear = Vector([10.0, 0.0]);
    for column in 0..5 {
        for place in 0..=column {
            let aside = f64::from(place) - half * f64::from(column);
            scene.ball(Vector([depth * f64::from(column), aside]), 1.0);
        }
    }
    for a in 0..scene.positions.len() {
        for b in 0..a {
            let apart = scene.positions[a] - scene.positions[b];
            if apart.length() < 1.0 + 1e-9 {
                scene.push(a as u32, b as u32, apart * (1.0 / apart.length()));
            }
        }
    }
    for manifold in &mut scene.system.manifolds {
        manifold.restitution = restitution;
    }
    scene
}

/// Returns the largest difference between the velocities and their mirror image across the x axis.
/// \[m/s\]
fn asymmetry(scene: &Scene<2, 0>) -> f64 {
    let mut worst = 0.0f64;
    for (i, p) in scene.positions.iter().enumerate() {
        let mirrored = |q: &Vector<f64, 2>| (q[0] - p[0]).abs() + (q[1] + p[1]).abs() < 1e-9;
        let twin = scene.positions.iter().position(mirrored).unwrap();
        let [v, w] = [i, twin].map(|body| scene.system.velocities[body].linear);
        worst = worst.max((v[0] - w[0]).abs()).max((v[1] + w[1]).abs());
    }
    worst
}

#[test]
fn a_break_is_symmetric_and_keeps_its_energy() {
    let mut scene = break_shot(1.0);
    let (energy, momentum) = (scene.kinetic_energy(), scene.momentum());
    let collisions = resolve(&mut scene.system, ImpactLaw::Reflections, 1e-9, 1000);
    println!("{collisions} collisions, asymmetry {:.1e} m/s", asymmetry(&scene));
    assert!(collisions > 20, "{collisions} collisions");
    assert!(asymmetry(&scene) < 1e-9, "asymmetry {} m/s", asymmetry(&scene));
    assert_close(scene.kinetic_energy() / energy, 1.0, 1e-12);
    assert_all_close(scene.momentum().0, momentum.0, 1e-12);
    // No touching balls approach each other any more.
    assert_eq!(resolve(&mut scene.system, ImpactLaw::Reflections, 1e-9, 1), 0);

    let mut poisson = break_shot(1.0);
    resolve(&mut poisson.system, ImpactLaw::Poisson, 1e-9, 1000);
    assert!(asymmetry(&poisson) < 1e-9, "asymmetry {} m/s", asymmetry(&poisson));

    // Newton's law resolves one collision after the other, so the first neighbor of a ball receives
    // momentum that belongs to the second.
    let mut newton = break_shot(1.0);
    resolve(&mut newton.system, ImpactLaw::Newton, 1e-9, 1000);
    assert!(asymmetry(&newton) > 0.1, "asymmetry {} m/s", asymmetry(&newton));
}

/// At a single contact all laws give u+ = -e u-.
fn one_contact<const L: usize, const A: usize>(law: ImpactLaw, restitution: f64) {
    let mut scene = row::<L, A>(&[2.0, 3.0], &[1.0, -2.0], restitution);
    assert_eq!(resolve(&mut scene.system, law, 0.0, 1), 1);
    let after = speeds(&scene);
    assert_close(after[1] - after[0], 3.0 * restitution, 1e-12);
}

#[test]
fn one_contact_returns_its_part_of_the_approach() {
    for law in LAWS {
        for restitution in [0.1, 0.5, 1.0] {
            in_all_four!(one_contact, law, restitution);
        }
    }
}

/// A square lands flat on its two lower corners.
#[test]
fn a_flat_landing_bounces_straight_up() {
    for law in LAWS {
        let mut scene = Scene::<2, 1>::new();
        let square = scene.body(Vector([0.0, 1.0]), 1.0, Vector([2.0 / 3.0]), &[Vector([1.0])]);
        let floor = scene.wall();
        scene.touch(
            [square, floor],
            Vector([0.0, 1.0]),
            &[Vector([-1.0, 0.0]), Vector([1.0, 0.0])],
        );
        scene.system.manifolds[0].restitution = 0.5;
        scene.system.velocities[0].linear = Vector([0.0, -4.0]);
        resolve(&mut scene.system, law, 0.1, 10);
        assert_close(scene.system.velocities[0].linear[1], 2.0, 1e-12);
        assert_close(scene.system.velocities[0].angular[0], 0.0, 1e-12);
    }
}

/// A driven wall moves towards a fixed wall and pushes a ball. The contact between the walls is not
/// a collision.
#[test]
fn fixed_bodies_do_not_collide() {
    for law in LAWS {
        let mut scene = Scene::<2, 0>::new();
        let (left, right) = (scene.wall(), scene.wall());
        let ball = scene.ball(Vector::ZERO, 1.0);
        scene.system.velocities[left as usize].linear = Vector([1.0, 0.0]);
        scene.push(right, left, Vector([1.0, 0.0]));
        scene.push(ball, left, Vector([1.0, 0.0]));
        scene.system.manifolds.iter_mut().for_each(|manifold| manifold.restitution = 1.0);
        assert_eq!(resolve(&mut scene.system, law, 0.0, 10), 1);
        assert_close(scene.system.velocities[ball as usize].linear[0], 2.0, 1e-12);
        assert_close(scene.system.velocities[left as usize].linear[0], 1.0, 1e-12);
    }
}

fn any_scene<const L: usize, const A: usize>(random: &mut Random, walls: bool) -> Scene<L, A> {
    let (bodies, manifolds) = (2 + random.below(6), 1 + random.below(9));
    let mut scene = random_scene(random, Recipe { bodies, manifolds, points: 4, walls });
    for contact in &mut scene.system.contacts {
        contact.target[0] = 0.0;
    }
    if random.below(3) == 0 {
        let one = random.within(0.0, 1.0);
        scene.system.manifolds.iter_mut().for_each(|manifold| manifold.restitution = one);
    }
    scene
}

/// Collisions never add kinetic energy, contacts never pull, and without walls momentum is
/// conserved.
fn passive<const L: usize, const A: usize>(seed: u64) {
    for law in LAWS {
        let random = &mut Random(seed);
        let mut scene = any_scene::<L, A>(random, random.0.is_multiple_of(2));
        let walls = scene.system.manifolds.iter().any(|manifold| {
            manifold.bodies.iter().any(|&body| !scene.masses[body as usize].is_finite())
        });
        // A mass of 0 leaves the wall out of the sums, which stay finite.
        *scene.masses.last_mut().unwrap() = 0.0;
        let (linear, angular) = (scene.momentum(), scene.angular_momentum());
        let mut energy = scene.kinetic_energy();
        for _ in 0..4 {
            resolve(&mut scene.system, law, 0.01, 1);
            let now = scene.kinetic_energy();
            assert!(now <= energy * (1.0 + 1e-5), "{law:?}: {energy} J to {now} J");
            energy = now;
        }
        assert!(scene.system.contacts.iter().all(|contact| contact.impact >= 0.0));
        if !walls {
            // Contacts that push against each other have impulses much larger than the momenta.
            assert_all_close(scene.momentum().0, linear.0, 1e-5);
            assert_all_close(scene.angular_momentum(), angular, 1e-5);
        }
    }
}

/// Elastic reflections conserve kinetic energy for any arrangement of contacts.
fn elastic<const L: usize, const A: usize>(seed: u64) {
    let mut scene = any_scene::<L, A>(&mut Random(seed), seed.is_multiple_of(2));
    scene.system.manifolds.iter_mut().for_each(|manifold| manifold.restitution = 1.0);
    let before = scene.kinetic_energy();
    resolve(&mut scene.system, ImpactLaw::Reflections, 1e-3, 50);
    assert_close(scene.kinetic_energy() / before, 1.0, 1e-12);
}

/// The order of contacts does not affect laws that solve all contacts together with one
/// restitution. With several restitutions it does where contacts are redundant, since any of them
/// may take the impact. Contacts with nearly parallel rows of J need this many sweeps.
fn any_order<const L: usize, const A: usize>(seed: u64) {
    for law in [ImpactLaw::Poisson, ImpactLaw::Reflections] {
        let recipe = Recipe { bodies: 6, manifolds: 4, points: 1, walls: true };
        let mut scene = random_scene::<L, A>(&mut Random(seed), recipe);
        scene.system.contacts.iter_mut().for_each(|contact| contact.target[0] = 0.0);
        scene.system.manifolds.iter_mut().for_each(|manifold| manifold.restitution = 0.7);
        let mut reversed = scene.clone();
        reversed.system.manifolds.reverse();
        sweeping(&mut scene.system, law, 0.01, 1, 100_000);
        sweeping(&mut reversed.system, law, 0.01, 1, 100_000);
        let flat = |scene: &Scene<L, A>| -> Vec<f64> {
            let velocities = scene.system.velocities.iter();
            velocities.flat_map(|v| v.linear.0.into_iter().chain(v.angular.0)).collect()
        };
        assert_all_close(flat(&scene), flat(&reversed), 1e-6);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn impacts_are_passive(seed in any::<u64>()) {
        in_all_four!(passive, seed);
    }

    #[test]
    fn elastic_reflections_keep_the_energy(seed in any::<u64>()) {
        in_all_four!(elastic, seed);
    }
}

#[test]
fn the_order_of_contacts_has_no_effect() {
    for seed in 0..500 {
        in_all_four!(any_order, seed);
    }
}
