//! Tests of the formulas in the lecture notes, one test each and in the order of the notes. Tests
//! of the points that the notes leave out follow (`docs/notation.md` lists them), then identities
//! that hold for every system.
//!
//! Expected values come from plain arithmetic, not from the crate's own kernels.

use crate::common::{Random, Recipe, Scene, assert_all_close, assert_close, random_scene};
use drystone_solver::assembled::{
    Column, Matrix, compliance, contacts_of, equality, friction_impulses, friction_jacobian,
    gauss_seidel, impulses, inverse_mass, jacobian, pattern, rhs, soften, system_matrix, targets,
    velocities,
};
use drystone_solver::restitution::{ImpactLaw, ImpactSettings, ImpactSolver};
use drystone_solver::{Repair, System, Vector, Velocity, pgs, restitution};
use proptest::prelude::*;

const ROUNDING: f64 = 1e-12;

fn numbers(column: &Column) -> Vec<f64> {
    column.iter().copied().collect()
}

fn column(values: &[f64]) -> Column {
    Column::from_fn(values.len(), |i| values[i])
}

/// J^T gamma.
fn transposed_times(jacobian: &Matrix, gamma: &Column) -> Column {
    jacobian.transpose() * gamma
}

/// t = -c_r v_n, whatever its sign: the restitution hypothesis taken literally.
fn reflect<const L: usize, const A: usize>(scene: &mut Scene<L, A>, restitution: f64) {
    let v_n = jacobian(&scene.system) * velocities(&scene.system);
    for (i, contact) in scene.system.contacts.iter_mut().enumerate() {
        contact.target[0] = -restitution * v_n[i];
    }
}

fn set_impulses<const L: usize, const A: usize>(system: &mut System<f64, L, A>, gamma: &[f64]) {
    for (contact, &gamma) in system.contacts.iter_mut().zip(gamma) {
        contact.impulse[0] = gamma;
    }
}

fn unit<const L: usize>(angle: f64) -> Vector<f64, L> {
    Vector(std::array::from_fn(|i| match i {
        0 => angle.cos(),
        1 => angle.sin(),
        _ => 0.0,
    }))
}

/// Resolves collisions one by one by Newton's law. The bodies do not move and no forces act.
fn collide<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    threshold: f64,
    rounds: usize,
) -> usize {
    let mut moved = vec![Velocity::ZERO; system.velocities.len()];
    let how = ImpactSettings { law: ImpactLaw::Newton, dt: 0.0, threshold, rounds, sweeps: 400 };
    let forced = moved.clone();
    restitution::collide(system, &mut moved, &forced, &how, &mut ImpactSolver::default())
}

/// Returns a ball of 1 kg that touches fixed walls. The normals point towards the ball, at these
/// angles \[rad\].
fn ball_in_walls(angles: &[f64]) -> Scene<2, 0> {
    let mut scene = Scene::new();
    let ball = scene.ball(Vector::ZERO, 1.0);
    let wall = scene.wall();
    for &angle in angles {
        scene.push(ball, wall, unit(angle));
    }
    scene.system.prepare(0.0);
    scene
}

mod spherical_particles_without_friction {
    use super::*;

    #[test]
    fn normal_velocity_is_that_of_a_against_b_along_the_normal() {
        let mut scene = Scene::<2, 0>::new();
        let (a, b) = (scene.ball(Vector([0.0, 1.0]), 1.0), scene.ball(Vector::ZERO, 1.0));
        scene.push(a, b, Vector([0.0, 1.0]));
        scene.system.velocities[0].linear = Vector([7.0, 2.0]);
        scene.system.velocities[1].linear = Vector([5.0, -3.0]);
        let [va, vb] = scene.system.velocities_of(&scene.system.manifolds[0]);
        let v_n = scene.system.contacts[0]
            .normal_velocity(&scene.system.manifolds[0].frame.twist(&va, &vb));
        assert_eq!(v_n, 5.0, "positive: a leaves b upwards");
    }

    /// Equation (1): gamma = -(1 + c_r) m_eff v_1^-,
    /// v_a^+ = v_a^- + gamma n / m_a, v_b^+ = v_b^- - gamma n / m_b.
    fn isolated_collision<const L: usize, const A: usize>() {
        let (m_a, m_b, c_r) = (2.0, 3.0, 0.5);
        let mut scene = Scene::<L, A>::new();
        let n = unit::<L>(0.3);
        // The point of contact lies on the line between the centers, so the impulse has no moment.
        let (a, b) = (scene.ball(n, m_a), scene.ball(Vector::ZERO, m_b));
        scene.push(a, b, n);
        scene.system.manifolds[0].restitution = c_r;
        scene.system.prepare(0.0);
        scene.system.velocities[0].linear = unit::<L>(0.3 + std::f64::consts::PI) * 4.0;
        scene.system.velocities[1].linear = unit::<L>(0.3) * 2.0;
        let before = scene.system.velocities.clone();
        let v_1 = -6.0;
        let m_eff = 1.0 / (1.0 / m_a + 1.0 / m_b);
        let gamma = -(1.0 + c_r) * m_eff * v_1;

        let mut together = scene.system.clone();
        restitution::set_targets(&mut together, &before, 1.0);
        pgs::sweep_normals(&mut together);
        assert_close(together.contacts[0].impulse[0], gamma, ROUNDING);

        let mut alone = scene.system.clone();
        assert_eq!(collide(&mut alone, 1.0, 10), 1);
        assert_close(alone.contacts[0].impact, gamma, ROUNDING);

        for system in [together, alone] {
            let (v_a, v_b) = (system.velocities[0].linear, system.velocities[1].linear);
            assert_all_close(v_a.0, (before[0].linear + n * (gamma / m_a)).0, ROUNDING);
            assert_all_close(v_b.0, (before[1].linear - n * (gamma / m_b)).0, ROUNDING);
            assert_close(n.dot(v_a - v_b), -c_r * v_1, ROUNDING);
        }
    }

    #[test]
    fn equation_1_in_all_four_systems() {
        in_all_four!(isolated_collision);
    }

    /// A contact with a wall has one movable body: m_eff = m_a.
    #[test]
    fn a_wall_is_a_contact_with_one_moving_body() {
        let mut scene = Scene::<2, 0>::new();
        let (ball, wall) = (scene.ball(Vector::ZERO, 3.0), scene.wall());
        scene.push(ball, wall, Vector([0.0, 1.0]));
        scene.system.prepare(0.0);
        assert_close(scene.system.contacts[0].effective_mass, 3.0, ROUNDING);
        scene.system.velocities[0].linear = Vector([1.0, -2.0]);
        pgs::sweep_normals(&mut scene.system);
        assert_close(scene.system.contacts[0].impulse[0], 6.0, ROUNDING);
        assert_eq!(scene.system.velocities[0].linear, Vector([1.0, 0.0]));
        assert_eq!(scene.system.velocities[1], Velocity::ZERO);
    }

    #[test]
    fn a_contact_where_nothing_can_move_does_nothing() {
        let mut scene = Scene::<2, 1>::new();
        let walls = [scene.wall(), scene.wall()];
        scene.touch(walls, Vector([0.0, 1.0]), &[Vector::ZERO]);
        scene.system.prepare(0.2);
        scene.system.contacts[0].target[0] = 1.0;
        pgs::sweep(&mut scene.system);
        assert_eq!(scene.system.contacts[0].impulse, Vector::ZERO);
        assert_eq!(scene.system.residual(false), 0.0);
    }
}

mod a_collision_in_the_context_of_a_second {
    use super::*;

    /// gamma_1 = m_eff (-(1 + c_r) v_1^- + m_b^-1 gamma_2 n_1 . n_2), where B is the second body of
    /// collision 1 and the first body of collision 2.
    #[test]
    fn two_coupled_collisions() {
        let (m_a, m_b, c_r, gamma_2) = (2.0, 3.0, 0.25, 0.7);
        let mut scene = Scene::<2, 0>::new();
        let a = scene.ball(Vector([0.0, 2.0]), m_a);
        let b = scene.ball(Vector([0.0, 1.0]), m_b);
        let c = scene.ball(Vector::ZERO, 5.0);
        let (n_1, n_2) = (unit(1.5), unit(0.9));
        scene.push(a, b, n_1);
        scene.push(b, c, n_2);
        scene.system.prepare(0.0);
        scene.system.velocities[0].linear = Vector([0.5, -4.0]);
        let v_1 = n_1.dot(scene.system.velocities[0].linear);
        reflect(&mut scene, c_r);
        set_impulses(&mut scene.system, &[0.0, gamma_2]);
        scene.system.apply_impulses();
        pgs::sweep_normals(&mut scene.system); // Collision 1 is visited first.

        let m_eff = 1.0 / (1.0 / m_a + 1.0 / m_b);
        let gamma_1 = m_eff * (-(1.0 + c_r) * v_1 + gamma_2 / m_b * n_1.dot(n_2));
        assert_close(scene.system.contacts[0].impulse[0], gamma_1, ROUNDING);
    }

    /// s_ix: +1 if X is the first body of contact i, -1 if it is the second, else 0.
    fn sign<const L: usize>(system: &System<f64, L, 0>, i: usize, body: u32) -> f64 {
        let [a, b] = system.manifolds[i].bodies;
        f64::from(u8::from(a == body)) - f64::from(u8::from(b == body))
    }

    /// gamma_ix: the sum of s_jx gamma_j n_j over all contacts j but i, which is their total
    /// impulse on body X.
    fn others<const L: usize>(
        system: &System<f64, L, 0>,
        gamma: &[f64],
        i: usize,
        body: u32,
    ) -> Vector<f64, L> {
        let mut sum = Vector::ZERO;
        for j in (0..gamma.len()).filter(|&j| j != i) {
            sum += system.manifolds[j].normal() * (sign(system, j, body) * gamma[j]);
        }
        sum
    }

    /// gamma_1 = max(0, m_eff (-(1 + c_r) v_1^- - m_a^-1 n_1 . gamma_1a + m_b^-1 n_1 . gamma_1b)).
    fn accumulated<const L: usize>(seed: u64) {
        let random = &mut Random(seed);
        let recipe = Recipe { bodies: 4, manifolds: 9, points: 1, walls: true };
        let mut scene = random_scene::<L, 0>(random, recipe);
        let c_r = 0.4;
        reflect(&mut scene, c_r);
        let v_n = numbers(&(jacobian(&scene.system) * velocities(&scene.system)));
        let gamma: Vec<f64> = (0..9).map(|_| random.within(0.0, 2.0)).collect();
        set_impulses(&mut scene.system, &gamma);
        let system = scene.system.clone();
        scene.system.apply_impulses();
        pgs::sweep_normals(&mut scene.system);

        let [a, b] = system.manifolds[0].bodies;
        let n = system.manifolds[0].normal();
        let [w_a, w_b] = [a, b].map(|body| 1.0 / scene.masses[body as usize]);
        let gamma_1a = n.dot(others(&system, &gamma, 0, a));
        let gamma_1b = n.dot(others(&system, &gamma, 0, b));
        let m_eff = 1.0 / (w_a + w_b);
        let gamma_1 = m_eff * (-(1.0 + c_r) * v_n[0] - w_a * gamma_1a + w_b * gamma_1b);
        assert_close(scene.system.contacts[0].impulse[0], gamma_1.max(0.0), 1e-10);

        // gamma_ix = gamma_x - s_ix gamma_i n_i, where gamma_x is the sum over all contacts.
        for body in [a, b] {
            let all = others(&system, &gamma, usize::MAX, body);
            let one = n * (sign(&system, 0, body) * gamma[0]);
            assert_all_close((all - one).0, others(&system, &gamma, 0, body).0, 1e-12);
        }
    }

    proptest! {
        #[test]
        fn the_impulses_of_all_other_contacts(seed in any::<u64>()) {
            accumulated::<2>(seed);
            accumulated::<3>(seed);
        }
    }

    /// The algorithm of the notes: start from the prospective velocities and zero impulses, and
    /// visit the contacts until they converge.
    #[test]
    fn the_iteration_converges_to_resting_weight() {
        let (g_dt, count) = (0.1, 5);
        let mut scene = Scene::<2, 0>::new();
        let mut below = scene.wall();
        for i in 1..=count {
            let ball = scene.ball(Vector([0.0, i as f64]), 1.0);
            scene.push(ball, below, Vector([0.0, 1.0]));
            scene.system.velocities[ball as usize].linear[1] = -g_dt;
            below = ball;
        }
        scene.system.prepare(0.0);
        let mut sweeps = 0;
        while scene.system.residual(false) > 1e-10 {
            pgs::sweep_normals(&mut scene.system);
            sweeps += 1;
            assert!(sweeps < 1000);
        }
        for (i, contact) in scene.system.contacts.iter().enumerate() {
            assert_close(contact.impulse[0], (count - i) as f64 * g_dt, 1e-8);
        }
    }
}

mod overlap_repair {
    use super::*;

    const REPAIR: Repair<f64> =
        Repair { dt: 0.01, rate: 0.2, slop: 0.0, max_repair_speed: 1e9, stick_rate: 0.0 };

    /// Returns a ball of 2 kg that overlaps the floor by `depth` \[m\].
    fn sunk(depth: f64) -> Scene<2, 0> {
        let mut scene = Scene::new();
        let (ball, wall) = (scene.ball(Vector::ZERO, 2.0), scene.wall());
        scene.push(ball, wall, Vector([0.0, 1.0]));
        scene.system.prepare(0.0);
        scene.system.contacts[0].gap[0] = -depth;
        scene
    }

    /// Moves the ball for one step: adds its velocity times the step to the gap.
    fn advance(scene: &mut Scene<2, 0>) {
        scene.system.contacts[0].gap[0] += REPAIR.dt * scene.system.velocities[0].linear[1];
    }

    /// Sets the targets from the overlap, then sweeps once from zero impulses.
    fn solve(scene: &mut Scene<2, 0>) {
        scene.system.contacts[0].impulse = Vector::ZERO;
        scene.system.set_targets(&[Velocity::ZERO; 2], &REPAIR);
        pgs::sweep_normals(&mut scene.system);
    }

    /// gamma = m_eff (-(1 + c_r) v^- + c_d d): the overlap adds the velocity c_d d, with c_d =
    /// rate / dt.
    #[test]
    fn a_nudge_in_proportion_to_the_overlap() {
        let mut scene = sunk(0.03);
        scene.system.velocities[0].linear[1] = -0.5;
        solve(&mut scene);
        let c_d = 0.2 / 0.01;
        assert_close(scene.system.contacts[0].impulse[0], 2.0 * (0.5 + c_d * 0.03), ROUNDING);
    }

    #[test]
    fn slop_is_left_alone_and_the_push_has_a_limit() {
        let target = |depth| {
            let mut scene = sunk(depth);
            let repair = Repair { slop: 0.01, max_repair_speed: 1.5, ..REPAIR };
            scene.system.set_targets(&[Velocity::ZERO; 2], &repair);
            scene.system.contacts[0].target[0]
        };
        assert_eq!(target(0.009), 0.0);
        assert_close(target(0.03), 20.0 * 0.02, ROUNDING);
        assert_eq!(target(0.5), 1.5);
    }

    /// The overlap decays as (1 - beta)^n if the relax pass removes the repair velocity after it
    /// has moved the bodies.
    #[test]
    fn overlap_decays_exponentially_when_relaxed() {
        let mut scene = sunk(0.1);
        for n in 1..=20 {
            solve(&mut scene);
            advance(&mut scene);
            pgs::relax(&mut scene.system);
            assert_close(scene.system.velocities[0].linear[1], 0.0, ROUNDING);
            let depth = -scene.system.contacts[0].gap[0];
            assert!((depth / (0.1 * 0.8f64.powi(n)) - 1.0).abs() < 1e-9, "step {n}: {depth}");
        }
    }

    /// Without the relax pass a free body keeps the speed c_d d_0, and its overlap shrinks
    /// linearly.
    #[test]
    fn repair_left_in_the_velocity_is_momentum() {
        let mut scene = sunk(0.1);
        for n in 1..=5 {
            solve(&mut scene);
            advance(&mut scene);
            assert_close(scene.system.velocities[0].linear[1], 20.0 * 0.1, ROUNDING);
            let depth = -scene.system.contacts[0].gap[0];
            assert_close(depth, 0.1 * (1.0 - 0.2 * f64::from(n)), ROUNDING);
        }
    }

    /// Under gravity, repair without a relax pass launches the body if d > g / c_d^2, and only
    /// then.
    #[test]
    fn repair_launches_a_body_from_deep_overlap() {
        let limit = 10.0 / (20.0 * 20.0);
        for (depth, launched) in [(0.9 * limit, false), (1.1 * limit, true)] {
            let mut scene = sunk(depth);
            for _ in 0..2 {
                scene.system.velocities[0].linear[1] -= 10.0 * REPAIR.dt;
                solve(&mut scene);
                advance(&mut scene);
            }
            assert_eq!(scene.system.contacts[0].impulse[0] == 0.0, launched);
        }
    }

    /// A contact with a gap s may close the gap within the step and no more: v_n >= -s / h.
    #[test]
    fn a_gap_may_close_within_the_step() {
        let mut scene = sunk(-0.02);
        scene.system.velocities[0].linear[1] = -3.0;
        solve(&mut scene);
        assert_close(scene.system.velocities[0].linear[1], -2.0, ROUNDING);
        advance(&mut scene);
        assert_close(scene.system.contacts[0].gap[0], 0.0, ROUNDING);

        let mut slower = sunk(-0.02);
        slower.system.velocities[0].linear[1] = -1.5;
        solve(&mut slower);
        assert_eq!(slower.system.contacts[0].impulse[0], 0.0);
    }

    /// The target uses the current gap: the measured gap plus the displacements of the bodies
    /// since.
    #[test]
    fn the_gap_follows_the_displacements() {
        let mut scene = sunk(0.1);
        let moved = Velocity { linear: Vector([0.0, 0.04]), ..Velocity::ZERO };
        scene.system.set_targets(&[moved, Velocity::ZERO], &REPAIR);
        assert_close(scene.system.contacts[0].target[0], 20.0 * 0.06, ROUNDING);
    }
}

mod restitution_targets {
    use super::*;

    /// Returns the target velocity of a ball above the floor, for a gap \[m\], a velocity before
    /// the step and a restitution threshold \[m/s\].
    fn target(gap: f64, before: f64, threshold: f64) -> f64 {
        let mut scene = ball_in_walls(&[std::f64::consts::FRAC_PI_2]);
        scene.system.manifolds[0].restitution = 0.5;
        scene.system.contacts[0].gap[0] = gap;
        let repair =
            Repair { dt: 0.01, rate: 0.2, slop: 0.0, max_repair_speed: 10.0, stick_rate: 0.0 };
        scene.system.set_targets(&[Velocity::ZERO; 2], &repair);
        // The prospective velocity must not affect the target.
        scene.system.velocities[0].linear[1] = before - 123.0;
        let before = Velocity { linear: Vector([0.0, before]), ..Velocity::ZERO };
        restitution::set_targets(&mut scene.system, &[before, Velocity::ZERO], threshold);
        scene.system.contacts[0].target[0]
    }

    #[test]
    fn from_the_velocity_before_the_step() {
        assert_close(target(0.0, -4.0, 1.0), 2.0, ROUNDING);
        assert_eq!(target(0.0, 0.0, 1.0), 0.0, "a resting contact does not bounce off gravity");
    }

    #[test]
    fn only_above_the_threshold() {
        assert_eq!(target(0.0, -0.99, 1.0), 0.0);
        assert_close(target(0.0, -1.01, 1.0), 0.505, ROUNDING);
    }

    #[test]
    fn separating_contacts_may_not_approach_again() {
        assert_eq!(target(0.0, 4.0, 0.0), 0.0);
    }

    #[test]
    fn the_larger_of_restitution_and_repair() {
        assert_close(target(-0.05, -4.0, 1.0), 2.0, ROUNDING);
        assert_close(target(-0.2, -4.0, 1.0), 4.0, ROUNDING);
    }

    #[test]
    fn an_open_contact_bounces_only_if_it_closes() {
        assert_close(target(0.05, -4.0, 1.0), -5.0, ROUNDING);
        assert_close(target(0.03, -4.0, 1.0), 2.0, ROUNDING);
        assert_close(target(0.05, 0.0, 1.0), -5.0, ROUNDING);
    }

    /// The target is -c_r v^-. The factor 1 + c_r belongs to the change of velocity, and so to b.
    #[test]
    fn one_plus_restitution_is_in_the_change() {
        let mut scene = ball_in_walls(&[std::f64::consts::FRAC_PI_2]);
        scene.system.velocities[0].linear[1] = -4.0;
        reflect(&mut scene, 0.5);
        assert_close(targets(&scene.system)[0], 2.0, ROUNDING);
        assert_close(rhs(&scene.system)[0], 6.0, ROUNDING);
    }
}

mod why_does_it_work {
    use super::*;

    /// v_1 = J_1 v, J_1 = (..., n, ..., -n, ...).
    #[test]
    fn a_row_of_the_jacobian() {
        let mut scene = Scene::<2, 0>::new();
        for i in 0..4 {
            scene.ball(Vector([f64::from(i), 0.0]), 1.0);
        }
        scene.push(3, 1, Vector([0.6, 0.8]));
        let row = jacobian(&scene.system).to_dense();
        let expected = [0.0, 0.0, -0.6, -0.8, 0.0, 0.0, 0.6, 0.8];
        assert_all_close(row.row(0).iter().copied(), expected, 0.0);
    }

    fn shapes<const L: usize, const A: usize>() {
        let recipe = Recipe { bodies: 5, manifolds: 7, points: 3, walls: true };
        let scene = random_scene::<L, A>(&mut Random(1), recipe);
        let (k, n) = (scene.system.contacts.len(), scene.system.velocities.len());
        let shape = |matrix: Matrix| (matrix.nrows(), matrix.ncols());
        assert_eq!(shape(jacobian(&scene.system)), (k, (L + A) * n));
        assert_eq!(shape(inverse_mass(&scene.system)), ((L + A) * n, (L + A) * n));
        assert_eq!(shape(system_matrix(&scene.system)), (k, k));
        assert_eq!(shape(friction_jacobian(&scene.system)), (k * L, (L + A) * n));
    }

    /// J is k x (L + A) N, not k x N, since each body has L + A velocity components.
    #[test]
    fn sizes_of_the_matrices() {
        in_all_four!(shapes);
    }

    /// M holds the mass of each body once per linear velocity component, then its inertia.
    #[test]
    fn the_mass_matrix() {
        let mut particles = Scene::<2, 0>::new();
        for mass in [2.0, 4.0] {
            particles.ball(Vector::ZERO, mass);
        }
        let diagonal = inverse_mass(&particles.system).to_dense();
        let expected = [0.5, 0.5, 0.25, 0.25];
        for (i, j) in (0..4).flat_map(|i| (0..4).map(move |j| (i, j))) {
            assert_eq!(diagonal[(i, j)], if i == j { expected[i] } else { 0.0 });
        }

        let recipe = Recipe { bodies: 2, manifolds: 1, points: 1, walls: false };
        let scene = random_scene::<3, 3>(&mut Random(2), recipe);
        let dense = inverse_mass(&scene.system).to_dense();
        for body in 0..2 {
            // M^-1 M = 1 for the block of the body.
            for (i, j) in (0..6).flat_map(|i| (0..6).map(move |j| (i, j))) {
                let mass = |l: usize, j: usize| match (l < 3, j < 3) {
                    (true, true) if l == j => scene.masses[body],
                    (false, false) => scene.inertias[body].0[l - 3][j - 3],
                    _ => 0.0,
                };
                let product: f64 =
                    (0..6).map(|l| dense[(6 * body + i, 6 * body + l)] * mass(l, j)).sum();
                assert_close(product, if i == j { 1.0 } else { 0.0 }, 1e-12);
            }
        }
        let wall = 2 * 6;
        assert!((0..6).all(|i| dense[(wall + i, wall + i)] == 0.0), "a wall has no inverse mass");
    }

    /// v_n^+ = J v^- + A gamma and v^+ = v^- + M^-1 J^T gamma, for any gamma.
    fn three_steps<const L: usize, const A: usize>(seed: u64) {
        let random = &mut Random(seed);
        let recipe = Recipe { bodies: 4, manifolds: 5, points: 2, walls: true };
        let mut scene = random_scene::<L, A>(random, recipe);
        let system = scene.system.clone();
        let gamma: Vec<f64> = system.contacts.iter().map(|_| random.within(-1.0, 1.0)).collect();
        set_impulses(&mut scene.system, &gamma);
        scene.system.apply_impulses();

        let (j, a, gamma) = (jacobian(&system), system_matrix(&system), column(&gamma));
        let v_plus = velocities(&system) + inverse_mass(&system) * transposed_times(&j, &gamma);
        assert_all_close(numbers(&velocities(&scene.system)), numbers(&v_plus), 1e-11);
        let v_n = &j * velocities(&system) + &a * &gamma;
        assert_all_close(numbers(&(&j * v_plus)), numbers(&v_n), 1e-11);
        for manifold in &scene.system.manifolds {
            let [v_a, v_b] = scene.system.velocities_of(manifold);
            for i in manifold.points() {
                let kernel =
                    scene.system.contacts[i].normal_velocity(&manifold.frame.twist(&v_a, &v_b));
                assert_close(kernel, v_n[i], 1e-11);
            }
        }
    }

    /// A is symmetric, its diagonal is 1 / m_eff, and gamma^T A gamma is never negative.
    fn system_matrix_facts<const L: usize, const A: usize>(seed: u64) {
        let random = &mut Random(seed);
        let recipe = Recipe { bodies: 3, manifolds: 6, points: 3, walls: true };
        let scene = random_scene::<L, A>(random, recipe);
        let a = system_matrix(&scene.system).to_dense();
        for i in 0..a.nrows() {
            assert_close(a[(i, i)], 1.0 / scene.system.contacts[i].effective_mass, 1e-12);
            for j in 0..i {
                assert_close(a[(i, j)], a[(j, i)], 1e-13);
            }
        }
        let gamma = Column::from_fn(a.nrows(), |_| random.within(-1.0, 1.0));
        let energy = gamma.transpose() * (&a * &gamma);
        assert!(energy >= -1e-12 * gamma.norm_l2(), "{energy}");
        // The smallest eigenvalue is 0 if contacts are redundant, as when they outnumber the
        // velocities.
        let smallest = a.self_adjoint_eigenvalues(faer::Side::Lower).unwrap()[0];
        assert!(smallest > -1e-11, "{smallest}");
    }

    /// Equation (2): A gamma = b gives v_n^+ = -c_r v_n^-.
    fn equation_2<const L: usize, const A: usize>(seed: u64) {
        let recipe = Recipe { bodies: 4, manifolds: 3, points: 2, walls: true };
        let mut scene = random_scene::<L, A>(&mut Random(seed), recipe);
        let c_r = 0.6;
        reflect(&mut scene, c_r);
        let system = &scene.system;
        let v_n = jacobian(system) * velocities(system);
        // b = -(1 + c_r) J v^-.
        assert_all_close(numbers(&rhs(system)), v_n.iter().map(|v| -(1.0 + c_r) * v), 1e-13);
        let solved = equality::solve(&system_matrix(system), &rhs(system)).unwrap();
        let mut after = system.clone();
        set_impulses(&mut after, &numbers(&solved.impulses));
        after.apply_impulses();
        let v_plus = jacobian(&after) * velocities(&after);
        assert_all_close(numbers(&v_plus), v_n.iter().map(|v| -c_r * v), 1e-7);
    }

    proptest! {
        #[test]
        fn velocities_from_impulses(seed in any::<u64>()) {
            in_all_four!(three_steps, seed);
        }

        #[test]
        fn the_system_matrix_is_symmetric_and_semidefinite(seed in any::<u64>()) {
            in_all_four!(system_matrix_facts, seed);
        }

        #[test]
        fn equation_2_reverses_the_normal_velocities(seed in any::<u64>()) {
            in_all_four!(equation_2, seed);
        }
    }

    /// Two pairs collide independently: J is 2 x 8, A is diagonal, and (2) reduces to (1) for each
    /// pair.
    #[test]
    fn two_independent_pairs() {
        let mut scene = Scene::<2, 0>::new();
        let masses = [1.0, 2.0, 3.0, 4.0];
        for (i, mass) in masses.into_iter().enumerate() {
            scene.ball(Vector([i as f64, 0.0]), mass);
            scene.system.velocities[i].linear = Vector([-(i as f64).powi(2), 0.3 * i as f64]);
        }
        let (n_1, n_2) = (unit(0.2), unit(2.5));
        scene.push(0, 1, n_1);
        scene.push(2, 3, n_2);
        scene.system.prepare(0.0);
        let c_r = 0.5;
        reflect(&mut scene, c_r);
        let (j, a) = (jacobian(&scene.system), system_matrix(&scene.system));
        assert_eq!((j.nrows(), j.ncols()), (2, 8));
        assert_eq!(pattern(&j), "####....\n....####\n");
        assert_eq!(pattern(&a), "#.\n.#\n");
        let solved = equality::solve(&a, &rhs(&scene.system)).unwrap();
        assert!(!solved.is_singular());
        let v: Vec<_> = scene.system.velocities.iter().map(|v| v.linear).collect();
        let gamma_1 = -(1.0 + c_r) * n_1.dot(v[0] - v[1]) / (1.0 / masses[0] + 1.0 / masses[1]);
        let gamma_2 = -(1.0 + c_r) * n_2.dot(v[2] - v[3]) / (1.0 / masses[2] + 1.0 / masses[3]);
        assert_all_close(numbers(&solved.impulses), [gamma_1, gamma_2], 1e-12);
    }

    /// Sparsity pattern of A for seven balls piled between a floor (7) and a wall (8).
    #[test]
    fn seven_bodies_and_walls() {
        let mut scene = Scene::<2, 0>::new();
        for i in 0..7 {
            scene.ball(Vector([f64::from(i), 0.0]), 1.0);
        }
        let (floor, side) = (scene.wall(), scene.wall());
        let contacts = [
            [0, floor],
            [1, floor],
            [2, floor],
            [3, 0],
            [3, 1],
            [4, 1],
            [4, 2],
            [5, 3],
            [5, 4],
            [6, 5],
            [0, side],
        ];
        for (i, [a, b]) in contacts.into_iter().enumerate() {
            scene.push(a, b, unit(i as f64));
        }
        let a = system_matrix(&scene.system);
        let expected = "\
            #..#......#\n\
            .#..##.....\n\
            ..#...#....\n\
            #..##..#..#\n\
            .#.###.#...\n\
            .#..###.#..\n\
            ..#..##.#..\n\
            ...##..###.\n\
            .....#####.\n\
            .......###.\n\
            #..#......#\n";
        assert_eq!(pattern(&a), expected);
        assert_eq!(pattern(&jacobian(&scene.system)).lines().next(), Some("##............##.."));
        // A body with n contacts fills the n^2 entries between them.
        for body in 0..7 {
            let own = contacts_of(&scene.system, body);
            assert!(own.iter().all(|&i| own.iter().all(|&j| a.get(i, j).is_some())));
        }
        assert_eq!(contacts_of(&scene.system, 3), [3, 4, 7]);
        assert_eq!(contacts_of(&scene.system, 6), [9]);
        // The floor is fixed, so it does not couple its contacts: their entries of A are zero.
        assert_eq!(contacts_of(&scene.system, floor), [0, 1, 2]);
        assert!(a.get(0, 1).is_none() && a.get(1, 2).is_none());
    }

    /// a_ij is the sum of s_xi s_xj m_x^-1 n_i . n_j over the bodies x that contacts i and j share.
    #[test]
    fn entries_of_the_system_matrix() {
        let mut scene = Scene::<2, 0>::new();
        let (a, b) = (scene.ball(Vector::ZERO, 2.0), scene.ball(Vector::ZERO, 4.0));
        let wall = scene.wall();
        let (n_0, n_1) = (unit(0.4), unit(1.1));
        scene.push(a, b, n_0);
        scene.push(b, wall, n_1);
        let matrix = system_matrix(&scene.system).to_dense();
        assert_close(matrix[(0, 0)], 0.5 + 0.25, ROUNDING);
        assert_close(matrix[(1, 1)], 0.25, ROUNDING);
        assert_close(matrix[(0, 1)], -0.25 * n_0.dot(n_1), ROUNDING);
    }

    /// A moves away from B. The equality A gamma = b pulls B along; the contact law lets the
    /// contact open.
    #[test]
    fn contacts_do_not_pull() {
        let mut scene = Scene::<2, 0>::new();
        let (a, b) = (scene.ball(Vector([0.0, 1.0]), 1.0), scene.ball(Vector::ZERO, 1.0));
        scene.push(a, b, Vector([0.0, 1.0]));
        scene.system.prepare(0.0);
        scene.system.velocities[0].linear[1] = 2.0;
        let glued = equality::solve(&system_matrix(&scene.system), &rhs(&scene.system)).unwrap();
        assert_close(glued.impulses[0], -1.0, ROUNDING);
        pgs::sweep_normals(&mut scene.system);
        assert_eq!(scene.system.contacts[0].impulse[0], 0.0);
        assert_eq!(scene.system.velocities[1], Velocity::ZERO);
    }

    /// With two contacts of which one would pull, clamping its impulse after solving leaves the
    /// other impulse wrong. The clamp has to be part of the problem.
    #[test]
    fn clamping_after_solving_is_wrong() {
        // A = [[1, 1/2], [1/2, 1]], b = (1, 0.2).
        let mut scene = ball_in_walls(&[0.0, std::f64::consts::FRAC_PI_3]);
        scene.system.contacts[0].target[0] = 1.0;
        scene.system.contacts[1].target[0] = 0.2;
        let (a, b) = (system_matrix(&scene.system), rhs(&scene.system));
        let equal = equality::solve(&a, &b).unwrap().impulses;
        assert_all_close(numbers(&equal), [1.2, -0.4], 1e-12);
        let clamped = column(&[1.2, 0.0]);
        let w = gauss_seidel::residual(&a, &b, &clamped);
        assert_close(w[0], 0.2, 1e-12); // Contact 0 pushes, yet separates faster than it should.
        assert!(gauss_seidel::complementarity(&a, &b, &clamped) > 0.1);

        let gamma = gauss_seidel::solve(&a, &b, 60);
        assert_all_close(numbers(&gamma), [1.0, 0.0], 1e-12);
        assert!(gauss_seidel::complementarity(&a, &b, &gamma) < 1e-12);
        for _ in 0..60 {
            pgs::sweep_normals(&mut scene.system);
        }
        assert_all_close(numbers(&impulses(&scene.system)), [1.0, 0.0], 1e-12);
        assert!(scene.system.residual(false) < 1e-12);
    }

    /// gamma >= 0, w = A gamma - b >= 0 and gamma . w = 0: each contact either pushes or separates.
    fn complementarity<const L: usize, const A: usize>(seed: u64) {
        let recipe = Recipe { bodies: 5, manifolds: 5, points: 2, walls: true };
        let mut scene = random_scene::<L, A>(&mut Random(seed), recipe);
        scene.system.manifolds.iter_mut().for_each(|manifold| manifold.friction = 0.0);
        scene.system.prepare(0.2); // Soft, so that a solution exists and is found soon.
        let a = soften(&system_matrix(&scene.system), &compliance(&scene.system));
        let b = rhs(&scene.system);
        for _ in 0..2000 {
            pgs::sweep_normals(&mut scene.system);
        }
        let gamma = impulses(&scene.system);
        let w = gauss_seidel::residual(&a, &b, &gamma);
        for i in 0..w.nrows() {
            assert!(gamma[i] >= 0.0 && w[i] > -1e-9);
            assert!(gamma[i] * w[i] < 1e-9, "both {} and {}", gamma[i], w[i]);
        }
        assert!((gamma.transpose() * &w).abs() < 1e-8);
        // `System::residual` agrees.
        assert_close(
            scene.system.residual(false),
            gauss_seidel::complementarity(&a, &b, &gamma),
            1e-9,
        );
    }

    proptest! {
        #[test]
        fn the_complementarity_conditions(seed in any::<u64>()) {
            in_all_four!(complementarity, seed);
        }
    }

    /// x_i = (b_i - sum_{j<i} a_ij x_j - sum_{j>i} a_ij x_j) / a_ii.
    #[test]
    fn a_row_of_gauss_seidel() {
        let scene = ball_in_walls(&[0.0, 0.7, 1.9]);
        let a = system_matrix(&scene.system);
        let (b, x) = (column(&[1.0, -2.0, 3.0]), column(&[0.3, 0.5, 0.8]));
        let dense = a.to_dense();
        for i in 0..3 {
            let below: f64 = (0..i).map(|j| dense[(i, j)] * x[j]).sum();
            let above: f64 = (i + 1..3).map(|j| dense[(i, j)] * x[j]).sum();
            let x_i = (b[i] - below - above) / dense[(i, i)];
            assert_close(gauss_seidel::solve_row(&a, &b, &x, i), x_i, ROUNDING);
        }
    }

    /// Gauss-Seidel without the clamp solves equation (2).
    #[test]
    fn gauss_seidel_solves_the_equality() {
        let scene = ball_in_walls(&[0.0, 0.9]);
        let (a, b) = (system_matrix(&scene.system), column(&[1.0, 0.2]));
        let mut x = Column::zeros(2);
        for _ in 0..200 {
            gauss_seidel::sweep(&a, &b, &mut x);
        }
        let exact = equality::solve(&a, &b).unwrap();
        assert!(exact.impulses[1] < 0.0);
        assert_all_close(numbers(&x), numbers(&exact.impulses), 1e-12);
    }

    /// For particles, the expanded row of A is the formula of the notes' second section:
    /// gamma_i = m_eff (-(1 + c_r) v_i^- - m_a^-1 sum s_ak gamma_k n_k . n_i +
    /// m_b^-1 sum s_bk gamma_k n_k . n_i).
    #[test]
    fn gauss_seidel_expanded_is_one_visit() {
        let recipe = Recipe { bodies: 4, manifolds: 8, points: 1, walls: true };
        let random = &mut Random(11);
        let mut scene = random_scene::<3, 0>(random, recipe);
        let c_r = 0.3;
        reflect(&mut scene, c_r);
        let system = &scene.system;
        let v_n = jacobian(system) * velocities(system);
        let (a, b) = (system_matrix(system), rhs(system));
        let gamma = Column::from_fn(8, |_| random.within(0.0, 1.0));
        for i in 0..8 {
            let [body_a, body_b] = system.manifolds[i].bodies;
            let n_i = system.manifolds[i].normal();
            let sum = |body: u32| -> f64 {
                let others = (0..8).filter(|&k| k != i);
                let terms = others.map(|k| {
                    let [first, second] = system.manifolds[k].bodies;
                    let n = system.manifolds[k].normal().dot(n_i);
                    if first == body {
                        gamma[k] * n
                    } else if second == body {
                        -gamma[k] * n
                    } else {
                        0.0
                    }
                });
                terms.sum()
            };
            let [w_a, w_b] = [body_a, body_b].map(|body| 1.0 / scene.masses[body as usize]);
            let expanded =
                (-(1.0 + c_r) * v_n[i] - w_a * sum(body_a) + w_b * sum(body_b)) / (w_a + w_b);
            assert_close(gauss_seidel::solve_row(&a, &b, &gamma, i), expanded, 1e-11);
        }
    }

    /// With one contact repeated three times, A is singular. Many impulses solve the problem, but
    /// v^+ is unique.
    #[test]
    fn redundant_contacts_share_a_unique_velocity() {
        let up = std::f64::consts::FRAC_PI_2;
        let solve = |start: [f64; 3]| {
            let mut scene = ball_in_walls(&[up; 3]);
            reflect(&mut scene, 0.5);
            scene.system.velocities[0].linear[1] = -2.0;
            set_impulses(&mut scene.system, &start);
            scene.system.apply_impulses();
            for _ in 0..100 {
                pgs::sweep_normals(&mut scene.system);
            }
            (numbers(&impulses(&scene.system)), scene.system.velocities[0].linear)
        };
        let (from_zero, v_zero) = solve([0.0; 3]);
        let (from_warm, v_warm) = solve([0.1, 0.6, 0.2]);
        assert!((from_zero[1] - from_warm[1]).abs() > 0.1);
        assert_all_close(v_zero.0, v_warm.0, ROUNDING);

        let mut scene = ball_in_walls(&[up; 3]);
        scene.system.velocities[0].linear[1] = -2.0;
        let a = system_matrix(&scene.system);
        let solved = equality::solve(&a, &rhs(&scene.system)).unwrap();
        assert!(solved.is_singular() && solved.rank == 1 && solved.error < 1e-12);
        assert_all_close(numbers(&solved.impulses), [2.0 / 3.0; 3], 1e-12);

        // With a different target at each of the three, the equality has no solution, but the
        // contact law has one.
        for (contact, t) in scene.system.contacts.iter_mut().zip([0.0, 1.0, 2.0]) {
            contact.target[0] = t;
        }
        let b = rhs(&scene.system);
        assert!(equality::solve(&a, &b).unwrap().error > 0.1);
        let gamma = gauss_seidel::solve(&a, &b, 200);
        assert!(gauss_seidel::complementarity(&a, &b, &gamma) < 1e-12);
        assert_close((&a * gamma)[0] - 2.0, 2.0, 1e-12);
    }

    /// A ball is wedged between two walls that both push. No impulses satisfy both, and
    /// Gauss-Seidel diverges: (1, 2), (3, 4), (5, 6), ... A small compliance makes the problem
    /// solvable.
    #[test]
    fn jammed_contacts_run_away_and_compliance_holds_them() {
        let mut scene = ball_in_walls(&[0.0, std::f64::consts::PI]);
        for contact in &mut scene.system.contacts {
            contact.target[0] = 1.0;
        }
        let (a, b) = (system_matrix(&scene.system), rhs(&scene.system));
        let rounded = a.to_dense();
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            assert_close(rounded[(i, j)], if i == j { 1.0 } else { -1.0 }, ROUNDING);
        }
        let start = scene.system.clone();
        for n in 0..50 {
            pgs::sweep_normals(&mut scene.system);
            let expected = [f64::from(2 * n + 1), f64::from(2 * n + 2)];
            assert_all_close(numbers(&impulses(&scene.system)), expected, 1e-12);
            assert_all_close(
                numbers(&gauss_seidel::solve(&a, &b, n as usize + 1)),
                expected,
                1e-12,
            );
            assert!(scene.system.residual(false) > 0.5);
        }
        let mut soft = start;
        soft.prepare(0.1);
        for _ in 0..500 {
            pgs::sweep_normals(&mut soft);
        }
        assert!(soft.residual(false) < 1e-12);
        // By symmetry each contact yields by epsilon gamma = 1.
        assert_close(soft.contacts[0].impulse[0] * soft.contacts[0].compliance, 1.0, 1e-9);
    }
}

mod rigid_bodies {
    use super::*;

    fn cross(r: [f64; 3], f: [f64; 3]) -> [f64; 3] {
        [r[1] * f[2] - r[2] * f[1], r[2] * f[0] - r[0] * f[2], r[0] * f[1] - r[1] * f[0]]
    }

    fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    }

    fn times(m: [[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
        m.map(|row| dot(row, v))
    }

    /// Returns two touching bars of 2 kg and 1.5 kg. Their principal moments of inertia differ
    /// widely, about axes that are not the world's.
    fn two_bars() -> Scene<3, 3> {
        let mut scene = Scene::new();
        let mut random = Random(3);
        for (i, mass) in [(0, 2.0), (1, 1.5)] {
            let axes = drystone_solver::contact_frame(random.unit::<3>());
            let moments = Vector([0.02, 0.9, 1.0]);
            let place = Vector([0.0, 0.0, if i == 0 { 1.0 } else { -0.4 }]);
            scene.body(place, mass, moments, &axes);
            scene.system.velocities[i] =
                Velocity { linear: random.vector(), angular: random.vector() };
        }
        scene.touch([0, 1], Vector([0.48, 0.6, 0.64]), &[Vector([0.7, -0.5, 0.3])]);
        scene.system.prepare(0.0);
        scene
    }

    struct Row {
        n: [f64; 3],
        anchors: [[f64; 3]; 2],
        inverse_inertias: [[[f64; 3]; 3]; 2],
        inverse_masses: [f64; 2],
    }

    fn row(scene: &Scene<3, 3>) -> Row {
        let manifold = &scene.system.manifolds[0];
        let masses = scene.system.masses_of(manifold);
        Row {
            n: manifold.normal().0,
            anchors: manifold.frame.anchors(scene.system.contacts[0].offset).map(|anchor| anchor.0),
            inverse_inertias: masses.map(|mass| mass.angular.0.map(|row| row.0)),
            inverse_masses: masses.map(|mass| mass.linear),
        }
    }

    /// v_i = n . (v_a - v_b + omega_a x r_a - omega_b x r_b).
    #[test]
    fn normal_velocity() {
        let scene = two_bars();
        let Row { n, anchors, .. } = row(&scene);
        let [a, b] = scene.system.velocities_of(&scene.system.manifolds[0]);
        let v_n = dot(n, a.linear.0) - dot(n, b.linear.0) + dot(n, cross(a.angular.0, anchors[0]))
            - dot(n, cross(b.angular.0, anchors[1]));
        assert_close((jacobian(&scene.system) * velocities(&scene.system))[0], v_n, ROUNDING);
        let contact = scene.system.contacts[0];
        let kernel = contact.normal_velocity(&scene.system.manifolds[0].frame.twist(&a, &b));
        assert_close(kernel, v_n, ROUNDING);
    }

    /// Delta v_a = gamma n / m_a, Delta omega_a = I_a^-1 (r_a x gamma n); opposite for b.
    #[test]
    fn velocity_changes() {
        let mut scene = two_bars();
        let Row { n, anchors, inverse_inertias, inverse_masses } = row(&scene);
        let before = scene.system.velocities.clone();
        let gamma = 0.8;
        set_impulses(&mut scene.system, &[gamma]);
        scene.system.apply_impulses();
        for (body, sign) in [(0, 1.0), (1, -1.0)] {
            let delta = scene.system.velocities[body] - before[body];
            let linear = n.map(|x| sign * inverse_masses[body] * gamma * x);
            let angular = times(inverse_inertias[body], cross(anchors[body], n));
            assert_all_close(delta.linear.0, linear, ROUNDING);
            assert_all_close(delta.angular.0, angular.map(|x| sign * gamma * x), ROUNDING);
        }
    }

    /// 1 / m_eff = m_a^-1 + m_b^-1 + (r_a x n) . I_a^-1 (r_a x n) + (r_b x n) . I_b^-1 (r_b x n).
    #[test]
    fn effective_mass() {
        let scene = two_bars();
        let Row { n, anchors, inverse_inertias, inverse_masses } = row(&scene);
        let mut right = inverse_masses[0] + inverse_masses[1];
        let mut other_form = right;
        let mut misplaced = right;
        for body in 0..2 {
            let (r, w) = (anchors[body], inverse_inertias[body]);
            let alpha = cross(r, n);
            right += dot(alpha, times(w, alpha));
            other_form += dot(n, cross(times(w, alpha), r));
            // The formula as the notes print it: I^-1 applied to n instead of r x n.
            misplaced += dot(times(w, n), cross(alpha, r));
        }
        let m_eff = scene.system.contacts[0].effective_mass;
        assert_close(m_eff, 1.0 / right, ROUNDING);
        assert_close(m_eff, 1.0 / other_form, ROUNDING);
        assert!((1.0 / misplaced / m_eff - 1.0).abs() > 0.1, "{misplaced} {right}");
    }

    /// For a ball, I^-1 is a scalar, so its position in the formula does not matter.
    #[test]
    fn effective_mass_of_a_ball() {
        let mut scene = Scene::<3, 3>::new();
        let (ball, wall) = (scene.ball(Vector::ZERO, 2.0), scene.wall());
        let (n, r) = ([0.48, 0.6, 0.64], [0.7, -0.5, 0.3]);
        scene.touch([ball, wall], Vector(n), &[Vector(r)]);
        scene.system.prepare(0.0);
        let misplaced = 0.5 + dot(n.map(|x| 0.5 * x), cross(cross(r, n), r));
        assert_close(scene.system.contacts[0].effective_mass, 1.0 / misplaced, ROUNDING);
    }

    /// In the plane, r x n is the scalar r_x n_y - r_y n_x.
    #[test]
    fn effective_mass_in_the_plane() {
        let mut scene = Scene::<2, 1>::new();
        let body = scene.body(Vector::ZERO, 2.0, Vector([0.3]), &[Vector([1.0])]);
        let wall = scene.wall();
        scene.touch([body, wall], Vector([0.6, 0.8]), &[Vector([0.5, -1.0])]);
        scene.system.prepare(0.0);
        let alpha = 0.5 * 0.8 + 1.0 * 0.6;
        let expected = 1.0 / (1.0 / 2.0 + alpha * alpha / 0.3);
        assert_close(scene.system.contacts[0].effective_mass, expected, ROUNDING);
    }

    /// gamma_i = -m_eff [(1 + c_r) v_i^- - c_d d + n . Delta u], with
    /// Delta u = Delta v_a - Delta v_b + Delta omega_a x r_a - Delta omega_b x r_b.
    /// The changes Delta come from all contacts j but i, each with its sign s_jx.
    #[test]
    fn in_the_context_of_other_collisions() {
        let random = &mut Random(5);
        let recipe = Recipe { bodies: 3, manifolds: 6, points: 2, walls: true };
        for _ in 0..50 {
            let mut scene = random_scene::<3, 3>(random, recipe);
            let system = scene.system.clone();
            let gamma: Vec<f64> = system.contacts.iter().map(|_| random.within(0.0, 1.0)).collect();
            let [a, b] = system.manifolds[0].bodies;
            let (mut dv, mut dw) = ([[0.0; 3]; 2], [[0.0; 3]; 2]);
            for manifold in &system.manifolds {
                for j in manifold.points().filter(|&j| j != 0) {
                    for (x, body) in [a, b].into_iter().enumerate() {
                        let mass = &system.masses[body as usize];
                        let anchors = manifold.frame.anchors(system.contacts[j].offset);
                        let (s, anchor) = match manifold.bodies.iter().position(|&y| y == body) {
                            Some(0) => (1.0, anchors[0].0),
                            Some(_) => (-1.0, anchors[1].0),
                            None => continue,
                        };
                        let p = manifold.normal().0.map(|n| s * gamma[j] * n);
                        let turn = times(mass.angular.0.map(|row| row.0), cross(anchor, p));
                        for axis in 0..3 {
                            dv[x][axis] += mass.linear * p[axis];
                            dw[x][axis] += turn[axis];
                        }
                    }
                }
            }
            let contact = system.contacts[0];
            let n = system.manifolds[0].normal().0;
            let [r_a, r_b] = system.manifolds[0].frame.anchors(contact.offset);
            let other = dot(n, dv[0]) - dot(n, dv[1]) + dot(n, cross(dw[0], r_a.0))
                - dot(n, cross(dw[1], r_b.0));
            let v_n = (jacobian(&system) * velocities(&system))[0];
            // With t = -c_r v^- or c_d d, -(v^- - t) is the bracket without the other contacts.
            let expected = -contact.effective_mass * (v_n - contact.target[0] + other);

            set_impulses(&mut scene.system, &gamma);
            scene.system.apply_impulses();
            pgs::sweep_normals(&mut scene.system);
            let got = scene.system.contacts[0].impulse[0];
            assert_close(got, expected.max(0.0), 1e-10);
        }
    }
}

mod a_bit_about_implementation {
    use super::*;

    /// Delta gamma_i = m_eff (b_i - n_i . (m_a^-1 gamma_a - m_b^-1 gamma_b)), where the sums
    /// gamma_a and gamma_b include contact i. The new impulse equals the one from sums that leave
    /// contact i out.
    #[test]
    fn a_change_from_sums_that_include_the_contact_itself() {
        let scene = ball_in_walls(&[0.0, 0.7, 1.9]);
        let a = system_matrix(&scene.system);
        let (b, gamma) = (column(&[1.0, -2.0, 3.0]), column(&[0.3, 0.5, 0.8]));
        let dense = a.to_dense();
        for i in 0..3 {
            let all: f64 = (0..3).map(|j| dense[(i, j)] * gamma[j]).sum();
            let without = all - dense[(i, i)] * gamma[i];
            let change = (b[i] - all) / dense[(i, i)];
            assert_close(gamma[i] + change, (b[i] - without) / dense[(i, i)], ROUNDING);
            assert_close(gauss_seidel::solve_row(&a, &b, &gamma, i), gamma[i] + change, ROUNDING);
        }
    }

    /// With P_x = sum s gamma n and T_x = sum s (r x gamma n), the velocities that sweeps update in
    /// place are v* + P / m and omega* + I^-1 T.
    fn accumulators<const L: usize, const A: usize>(seed: u64) {
        let recipe = Recipe { bodies: 4, manifolds: 6, points: 3, walls: true };
        let mut scene = random_scene::<L, A>(&mut Random(seed), recipe);
        let start = scene.system.clone();
        for _ in 0..7 {
            pgs::sweep(&mut scene.system);
        }
        let count = start.velocities.len();
        let mut linear = vec![Vector::<f64, L>::ZERO; count];
        let mut angular = vec![Vector::<f64, A>::ZERO; count];
        for manifold in &scene.system.manifolds {
            let [a, b] = manifold.bodies.map(|body| body as usize);
            for contact in &scene.system.contacts[manifold.points()] {
                let p = manifold.frame.to_world(contact.impulse);
                linear[a] += p;
                linear[b] -= p;
                let [r_a, r_b] = manifold.frame.anchors(contact.offset);
                angular[a] += drystone_solver::moment(r_a, p);
                angular[b] -= drystone_solver::moment(r_b, p);
            }
        }
        for body in 0..count {
            let (v, before) = (scene.system.velocities[body], start.velocities[body]);
            let mass = start.masses[body];
            let expected = before.linear + linear[body] * mass.linear;
            assert_all_close(v.linear.0, expected.0, 1e-10);
            assert_all_close(v.angular.0, (before.angular + mass.angular * angular[body]).0, 1e-10);
        }
    }

    proptest! {
        #[test]
        fn sums_per_body_are_the_velocities_in_place(seed in any::<u64>()) {
            in_all_four!(accumulators, seed);
        }
    }

    /// The accumulated impulse is clamped, not its change: an impulse that an early visit makes too
    /// large must be able to shrink.
    #[test]
    fn the_accumulated_impulse_is_clamped_not_the_change() {
        let mut scene = ball_in_walls(&[0.0, std::f64::consts::FRAC_PI_3]);
        scene.system.contacts[0].target[0] = 1.0;
        scene.system.contacts[1].target[0] = 1.0;
        let (a, b) = (system_matrix(&scene.system), rhs(&scene.system));
        let mut wrong = Column::zeros(2);
        for _ in 0..60 {
            for i in 0..2 {
                let change = gauss_seidel::solve_row(&a, &b, &wrong, i) - wrong[i];
                wrong[i] += change.max(0.0);
            }
            pgs::sweep_normals(&mut scene.system);
        }
        assert_all_close(numbers(&impulses(&scene.system)), [2.0 / 3.0; 2], 1e-12);
        assert_all_close(numbers(&wrong), [1.0, 0.5], 1e-12);
        assert!(gauss_seidel::complementarity(&a, &b, &wrong) > 0.2);
    }
}

mod identities {
    use super::*;

    fn any_scene<const L: usize, const A: usize>(random: &mut Random, walls: bool) -> Scene<L, A> {
        let recipe = Recipe {
            bodies: 2 + random.below(5),
            manifolds: 1 + random.below(7),
            points: 4,
            walls,
        };
        random_scene(random, recipe)
    }

    /// Delta T = -(1 - e) / (2 (1 + e)) gamma^T A gamma, if (2) holds with one restitution e for
    /// all.
    fn energy_of_the_equality<const L: usize, const A: usize>(seed: u64) {
        let random = &mut Random(seed);
        let mut scene = any_scene::<L, A>(random, true);
        let e = [0.0, random.within(0.0, 1.0), 1.0][random.below(3)];
        reflect(&mut scene, e);
        let before = scene.kinetic_energy();
        let a = system_matrix(&scene.system);
        let gamma = equality::solve(&a, &rhs(&scene.system)).unwrap().impulses;
        set_impulses(&mut scene.system, &numbers(&gamma));
        scene.system.apply_impulses();
        let quadratic = gamma.transpose() * (&a * &gamma);
        let expected = -(1.0 - e) / (2.0 * (1.0 + e)) * quadratic;
        // Nearly redundant contacts have large impulses, and rounding errors in proportion.
        let error = scene.kinetic_energy() - before - expected;
        assert!(error.abs() < 1e-9 * (1.0 + gamma.squared_norm_l2()), "{error} {expected}");
    }

    /// Delta T = 1/2 gamma . (u^- + u^+) for any impulses, including tangential ones.
    fn energy_of_any_impulses<const L: usize, const A: usize>(seed: u64) {
        let random = &mut Random(seed);
        let mut scene = any_scene::<L, A>(random, true);
        let before = scene.kinetic_energy();
        for contact in &mut scene.system.contacts {
            contact.impulse = random.vector();
        }
        let j = friction_jacobian(&scene.system);
        let u_before = &j * velocities(&scene.system);
        scene.system.apply_impulses();
        let u_after = &j * velocities(&scene.system);
        let work = friction_impulses(&scene.system).transpose() * (u_before + u_after);
        assert_close(scene.kinetic_energy() - before, 0.5 * work, 1e-10);
    }

    /// After any number of sweeps, v = v* + M^-1 J^T gamma, J v - t = A gamma - b, gamma >= 0, and
    /// friction is at most mu gamma.
    fn invariants_of_a_sweep<const L: usize, const A: usize>(seed: u64) {
        let random = &mut Random(seed);
        let mut scene = any_scene::<L, A>(random, true);
        let start = scene.system.clone();
        let (j, w) = (friction_jacobian(&start), inverse_mass(&start));
        let (a, b) = (system_matrix(&start), rhs(&start));
        let mut normals = start.clone();
        for _ in 0..1 + random.below(6) {
            pgs::sweep(&mut scene.system);
            pgs::sweep_normals(&mut normals);
            let gamma = friction_impulses(&scene.system);
            let expected = velocities(&start) + &w * transposed_times(&j, &gamma);
            let v = velocities(&scene.system);
            assert_all_close(numbers(&v), numbers(&expected), 1e-9);

            let excess = jacobian(&normals) * velocities(&normals) - targets(&normals);
            let residual = gauss_seidel::residual(&a, &b, &impulses(&normals));
            assert_all_close(numbers(&excess), numbers(&residual), 1e-9);
        }
        for manifold in &scene.system.manifolds {
            for contact in &scene.system.contacts[manifold.points()] {
                let normal = contact.impulse[0];
                let mut tangential = contact.impulse;
                tangential[0] = 0.0;
                assert!(normal >= 0.0);
                assert!(tangential.length() <= manifold.friction * normal * (1.0 + 1e-12));
            }
        }
    }

    /// Contacts conserve linear and angular momentum, since both bodies are pushed at one point.
    /// Friction between particles, which have no rotation, conserves only linear momentum.
    fn momentum<const L: usize, const A: usize>(seed: u64) {
        let random = &mut Random(seed);
        let mut scene = any_scene::<L, A>(random, false);
        // The wall touches nothing in this scene. A mass of 0 leaves it out of the sums.
        *scene.masses.last_mut().unwrap() = 0.0;
        let (linear, angular) = (scene.momentum(), scene.angular_momentum());
        let mut pushed = scene.clone();
        for _ in 0..4 {
            pgs::sweep_normals(&mut pushed.system);
        }
        collide(&mut pushed.system, 0.1, 4);
        // Contacts that push against each other have impulses much larger than the momenta.
        assert_all_close(pushed.momentum().0, linear.0, 1e-5);
        assert_all_close(pushed.angular_momentum(), angular.iter().copied(), 1e-5);

        for _ in 0..4 {
            pgs::sweep(&mut scene.system);
        }
        pgs::relax(&mut scene.system);
        assert_all_close(scene.momentum().0, linear.0, 1e-9);
        if A > 0 {
            assert_all_close(scene.angular_momentum(), angular, 1e-9);
        }
    }

    /// Collisions never add kinetic energy, for any restitutions.
    fn collisions_lose_energy<const L: usize, const A: usize>(seed: u64) {
        let random = &mut Random(seed);
        let mut scene = any_scene::<L, A>(random, true);
        for contact in &mut scene.system.contacts {
            contact.target[0] = 0.0;
        }
        for manifold in &mut scene.system.manifolds {
            if random.below(2) == 0 {
                manifold.restitution = 1.0;
            }
        }
        let mut energy = scene.kinetic_energy();
        for _ in 0..5 {
            collide(&mut scene.system, 0.01, 1);
            let now = scene.kinetic_energy();
            assert!(now <= energy * (1.0 + 1e-5), "{energy} to {now}");
            energy = now;
        }
        assert!(scene.system.contacts.iter().all(|contact| contact.impact >= 0.0));
    }

    proptest! {
        #[test]
        fn kinetic_energy_with_one_restitution(seed in any::<u64>()) {
            in_all_four!(energy_of_the_equality, seed);
        }

        #[test]
        fn kinetic_energy_of_any_impulses(seed in any::<u64>()) {
            in_all_four!(energy_of_any_impulses, seed);
        }

        #[test]
        fn velocities_are_prospective_plus_impulses_at_any_time(seed in any::<u64>()) {
            in_all_four!(invariants_of_a_sweep, seed);
        }

        #[test]
        fn momentum_is_conserved(seed in any::<u64>()) {
            in_all_four!(momentum, seed);
        }

        #[test]
        fn collisions_never_add_energy(seed in any::<u64>()) {
            in_all_four!(collisions_lose_energy, seed);
        }
    }

    /// One end of a rod moves down while the other moves up. A full bounce of the first end would
    /// press the second end against the floor, and stopping that end would add energy. So the
    /// impact is scaled down.
    #[test]
    fn an_impact_that_would_add_energy_is_scaled_down() {
        let mut scene = Scene::<2, 1>::new();
        let rod = scene.body(Vector::ZERO, 1.0, Vector([0.3]), &[Vector([1.0])]);
        let floor = scene.wall();
        let ends = [Vector([-1.0, 0.0]), Vector([1.0, 0.0])];
        scene.touch([rod, floor], Vector([0.0, 1.0]), &ends);
        scene.system.manifolds[0].restitution = 1.0;
        scene.system.prepare(0.0);
        // The ends move at -1 and 0.2 m/s.
        scene.system.velocities[0] =
            Velocity { linear: Vector([0.0, -0.4]), angular: Vector([0.6]) };
        let before = scene.kinetic_energy();

        let mut whole = scene.clone();
        whole.system.contacts[0].target[0] = 1.0;
        for _ in 0..200 {
            pgs::sweep_normals(&mut whole.system);
        }
        assert!(whole.kinetic_energy() > 1.1 * before);

        assert_eq!(collide(&mut scene.system, 0.0, 1), 1);
        assert!(scene.system.contacts[0].impact > 0.0);
        assert_close(scene.kinetic_energy(), before, 1e-12);
    }

    /// A single collision with restitution 1 conserves kinetic energy.
    #[test]
    fn an_elastic_collision_keeps_its_energy() {
        let recipe = Recipe { bodies: 2, manifolds: 1, points: 1, walls: false };
        for seed in 0..100 {
            let mut scene = random_scene::<3, 3>(&mut Random(seed), recipe);
            scene.system.manifolds[0].restitution = 1.0;
            scene.system.contacts[0].target[0] = 0.0;
            let before = scene.kinetic_energy();
            collide(&mut scene.system, 0.0, 1);
            assert_close(scene.kinetic_energy(), before, 1e-12);
        }
    }
}
