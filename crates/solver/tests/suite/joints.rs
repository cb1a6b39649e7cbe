//! Tests of rows of joints in a system: analytic mechanisms, agreement of the methods, and the bound
//! of the certificate with joints and contacts together.

use drystone_solver::certificate::certify;
use drystone_solver::island::Islands;
use drystone_solver::ladder::IslandSolver;
use drystone_solver::lanes::LaneSystem;
use drystone_solver::law::Interval;
use drystone_solver::mechanism::Mechanisms;
use drystone_solver::solution::{Goal, Solution, Status};
use drystone_solver::{
    Axis, ConstraintFrame, Contact, InverseMass, Joint, System, Vector, Velocity, apgd,
    contact_frame, newton, nncg, pgs, psor, symmetric,
};

use crate::common::{Random, Recipe, Scene, assert_close, random_scene};

const EXACT: Goal = Goal { tolerance: 1e-11, budget: 300 };

/// Returns the unit wrench of component `i`: L of translation, then A of rotation.
fn component<const L: usize, const A: usize>(i: usize) -> Velocity<f64, L, A> {
    let mut w = Velocity::ZERO;
    if i < L {
        w.linear[i] = 1.0
    } else {
        w.angular[i - L] = 1.0
    }
    w
}

/// Returns the frame of a joint of the bodies at a point, with the axes of the world.
fn frame<const L: usize, const A: usize>(
    scene: &Scene<L, A>,
    bodies: [u32; 2],
    point: Vector<f64, L>,
) -> ConstraintFrame<f64, L> {
    let axes = std::array::from_fn(|i| Vector(std::array::from_fn(|j| f64::from(i == j))));
    ConstraintFrame { axes, arms: bodies.map(|body| point - scene.positions[body as usize]) }
}

/// Returns locks of these components with this compliance.
fn locks<const L: usize, const A: usize>(
    frame: &ConstraintFrame<f64, L>,
    components: std::ops::Range<usize>,
    compliance: f64,
) -> Vec<Axis<f64, L, A>> {
    let lock = |i| {
        let mut axis = Axis::lock(frame, &component(i));
        axis.law.compliance = compliance;
        axis
    };
    components.map(lock).collect()
}

/// Adds joints with rows of all kinds between random bodies.
fn join_randomly<const L: usize, const A: usize>(
    random: &mut Random,
    scene: &mut Scene<L, A>,
    count: usize,
) {
    let bodies = scene.system.velocities.len();
    for _ in 0..count {
        let a = random.below(bodies) as u32;
        let b = (a + 1 + random.below(bodies - 1) as u32) % bodies as u32;
        let mut own = frame(scene, [a, b], random.vector());
        own.axes = contact_frame(random.unit());
        let rows = 1 + random.below(L + A);
        let axes: Vec<_> = (0..rows).map(|i| random_axis(random, &own, i)).collect();
        scene.system.add_joint([a, b], &axes);
    }
}

/// Returns a lock, a limit, a motor, a spring or a slack along a direction.
fn random_axis<const L: usize, const A: usize>(
    random: &mut Random,
    frame: &ConstraintFrame<f64, L>,
    i: usize,
) -> Axis<f64, L, A> {
    let mut axis = Axis::lock(frame, &component(i));
    // Some rows drive the two bodies along directions of their own, as a gear does.
    if random.below(4) == 0 {
        axis.jacobian[1] = axis.jacobian[1] * random.within(-2.0, 2.0);
    }
    let target = random.within(-0.5, 0.5);
    let bound = random.within(0.01, 1.0);
    let (low, high) = (f64::NEG_INFINITY, f64::INFINITY);
    let (targets, bounds) = match random.below(5) {
        0 => ([target; 2], [low, high]),
        1 => ([low, target], [low, 0.0]),
        2 => ([target; 2], [-bound, bound]),
        3 => ([target, target + 0.3], [low, high]),
        _ => ([0.0; 2], [-bound, bound]),
    };
    axis.law = Interval { targets, bounds, compliance: random.within(0.05, 1.0) };
    axis
}

pub(crate) fn random_system<const L: usize, const A: usize>(seed: u64) -> System<f64, L, A> {
    let random = &mut Random(seed);
    let recipe = Recipe {
        bodies: 3 + random.below(8),
        manifolds: 1 + random.below(8),
        points: 4,
        walls: true,
    };
    let mut scene = random_scene::<L, A>(random, recipe);
    for manifold in &mut scene.system.manifolds {
        manifold.friction = 0.0;
    }
    let joints = 1 + random.below(8);
    join_randomly(random, &mut scene, joints);
    scene.system.prepare(0.1);
    scene.system
}

/// Returns sqrt((v - w) . M (v - w) / m). \[m/s\]
pub(crate) fn apart<const L: usize, const A: usize>(
    system: &System<f64, L, A>,
    v: &[Velocity<f64, L, A>],
    w: &[Velocity<f64, L, A>],
) -> f64 {
    let (mut squared, mut total) = (0.0, 0.0);
    for ((inverse, v), w) in system.masses.iter().zip(v).zip(w) {
        squared += inverse.mass().squared(&(*v - *w));
        total += inverse.mass().linear;
    }
    (squared / total).sqrt()
}

type Solve<const L: usize, const A: usize> = fn(&mut System<f64, L, A>, &Goal) -> Solution;

fn methods_and_bound<const L: usize, const A: usize>(seed: u64) {
    let system = random_system::<L, A>(seed);
    let mut exact = system.clone();
    let solution = newton::solve(&mut exact, &EXACT);
    let residual = exact.residual(false);
    assert!(residual < 1e-7, "seed {seed} ({L},{A}): {residual} m/s after {solution:?}");
    let methods: [(&str, Solve<L, A>); 4] = [
        ("pgs", pgs::solve),
        ("symmetric", symmetric::solve),
        ("psor", psor::solve),
        ("nncg", nncg::solve),
    ];
    for (name, method) in methods {
        let mut solved = system.clone();
        let solution = method(&mut solved, &Goal { tolerance: 1e-7, budget: 20_000 });
        assert_eq!(solution.status, Status::Converged, "seed {seed} ({L},{A}) {name}");
        let error = apart(&system, &solved.velocities, &exact.velocities);
        assert!(error < 1e-6, "seed {seed} ({L},{A}) {name}: {error} m/s");
    }
    let mut sweeping = system.clone();
    sweeping.apply_impulses();
    let random = &mut Random(seed + 1000);
    for _ in 0..20 {
        pgs::sweep(&mut sweeping);
        let truth = apart(&system, &sweeping.velocities, &exact.velocities);
        let mut strayed = sweeping.clone();
        for (velocity, mass) in strayed.velocities.iter_mut().zip(&system.masses) {
            if *mass != InverseMass::FIXED {
                velocity.linear[0] += random.within(-3.0, 3.0) * truth;
            }
        }
        for of in [&sweeping, &strayed] {
            let truth = apart(&system, &of.velocities, &exact.velocities);
            let promised = certify(of, &system.velocities).error();
            assert!(promised >= truth * (1.0 - 1e-6) - 1e-9, "seed {seed}: {promised} for {truth}");
        }
    }
}

/// All methods reach the same velocities in 100 random systems of each kind with contacts, locks,
/// limits, motors, springs and slacks, and the certified bound is never below the error.
#[test]
fn methods_agree_on_joints_and_the_bound_holds() {
    for seed in 0..100 {
        in_all_four!(methods_and_bound, seed);
    }
}

/// Returns the joints of a system as mechanisms.
fn mechanisms_of<const L: usize, const A: usize>(
    system: &System<f64, L, A>,
    masses: &[InverseMass<f32, L, A>],
) -> Mechanisms<L, A> {
    let pairs: Vec<_> = system.joints.iter().map(|joint| joint.bodies).collect();
    let mut mechanisms = Mechanisms::<L, A>::default();
    for index in Mechanisms::order(&pairs, masses) {
        let joint = system.joints[index as usize];
        let first = mechanisms.axes.len() as u32;
        mechanisms.axes.extend_from_slice(&system.axes[joint.axes()]);
        mechanisms.joints.push(Joint { first, ..joint });
    }
    mechanisms.connect(masses);
    mechanisms.renew(masses);
    mechanisms
}

fn visits<const L: usize, const A: usize>(seed: u64) {
    let mut system = random_system::<L, A>(seed);
    system.manifolds.clear();
    system.contacts.clear();
    let random = &mut Random(seed + 2000);
    let masses: Vec<InverseMass<f32, L, A>> = system.masses.iter().map(|own| own.cast()).collect();
    // Both start at the same numbers.
    system.masses = masses.iter().map(|own| own.cast()).collect();
    let mut mechanisms = mechanisms_of(&system, &masses);
    let mut velocities: Vec<Velocity<f32, L, A>> =
        system.velocities.iter().map(|own| own.cast()).collect();
    for visit in 0..5 {
        // Others than joints change the velocities between two visits.
        for (velocity, mass) in velocities.iter_mut().zip(&masses) {
            if *mass != InverseMass::FIXED {
                velocity.linear[0] += random.within(-1.0, 1.0) as f32;
            }
        }
        system.joints.clone_from(&mechanisms.joints);
        system.axes.clone_from(&mechanisms.axes);
        system.velocities = velocities.iter().map(|own| own.cast()).collect();
        let opposite: Vec<_> = system.axes.iter().map(|axis| -axis.impulse).collect();
        for (axis, impulse) in system.axes.iter_mut().zip(opposite) {
            axis.impulse = impulse;
        }
        system.apply_impulses();
        for (axis, own) in system.axes.iter_mut().zip(&mechanisms.axes) {
            axis.impulse = own.impulse;
        }
        newton::solve(&mut system, &EXACT);
        mechanisms.solve(&mut velocities);
        let found: Vec<_> = velocities.iter().map(|own| own.cast()).collect();
        let error = apart(&system, &system.velocities, &found);
        assert!(error < 1e-5, "seed {seed} ({L},{A}) visit {visit}: {error} m/s");
        for (own, other) in mechanisms.axes.iter().zip(&system.axes) {
            let apart = (own.impulse - other.impulse).abs();
            assert!(apart < 1e-5, "seed {seed} ({L},{A}) visit {visit}: {apart} N s");
        }
    }
}

/// One visit of a mechanism is the exact solution, in 100 random systems of each kind, whatever has
/// changed the velocities since the last visit.
#[test]
fn a_visit_of_a_mechanism_is_exact() {
    for seed in 0..100 {
        visits::<2, 0>(seed);
        visits::<2, 1>(seed);
        visits::<3, 0>(seed);
        visits::<3, 3>(seed);
    }
}

/// A column of 40 pairs of locked bodies, on a wall and on each other by contacts, in a step of gravity.
/// Conjugate directions that include the rows of the joints solve it without a matrix; without them
/// two and a half times as many iterations are needed.
fn column_of_pairs<const L: usize, const A: usize>() {
    let mut scene = Scene::<L, A>::new();
    let mut below = scene.wall();
    let (mut up, mut down) = (Vector::ZERO, Vector::ZERO);
    (up[1], down[1]) = (1.0, -0.1);
    for pair in 0..40 {
        let [low, high] =
            [1.0, 1.5].map(|height| scene.ball(up * (2.0 * f64::from(pair) + height), 1.0));
        for ball in [low, high] {
            scene.system.velocities[ball as usize].linear = down;
        }
        let own = frame(&scene, [high, low], up * (2.0 * f64::from(pair) + 1.25));
        scene.system.add_joint([high, low], &locks(&own, 0..L + A, 1e-6));
        scene.push(low, below, up);
        below = high;
    }
    scene.system.prepare(0.0);
    let mut system: System<f32, L, A> = scene.system.cast();
    let mut mechanisms = mechanisms_of(&scene.system, &system.masses);
    let mut islands = Islands::default();
    islands.find(&system);
    let prospective = system.velocities.clone();
    let mut lanes = LaneSystem::new();
    lanes.pack(&system, &system.masses, 0.1);
    let mut solver = IslandSolver::default();
    lanes.set_islands(&islands);
    solver.start(&system, &islands);
    let goal = Goal { tolerance: 1e-4, budget: 40 };
    let both = (&mut lanes, &mut mechanisms);
    let report = solver.solve_islands::<false>(&mut system, both, &prospective, &islands, &goal);
    assert!(report.error <= 1e-4 && report.newton == 0, "({L},{A}): {report:?}");
    assert!(report.iterations < 40, "({L},{A}): {} iterations", report.iterations);
}

#[test]
fn joints_take_part_in_conjugate_directions() {
    column_of_pairs::<2, 0>();
    column_of_pairs::<2, 1>();
    column_of_pairs::<3, 0>();
    column_of_pairs::<3, 3>();
}

/// A chain of `count` balls of 1 kg hangs from a wall by locks of their centers of mass: in a step
/// of gravity each lock bears the weights below it.
fn hanging_chain<const L: usize, const A: usize>(count: usize) {
    let mut scene = Scene::<L, A>::new();
    let mut above = scene.wall();
    let mut down = Vector::ZERO;
    down[1] = -0.0981;
    for link in 0..count {
        let mut place = Vector::ZERO;
        place[1] = -(link as f64);
        let ball = scene.ball(place, 1.0);
        scene.system.velocities[ball as usize].linear = down;
        let own = frame(&scene, [ball, above], place);
        scene.system.add_joint([ball, above], &locks(&own, 0..L, 1e-9));
        above = ball;
    }
    scene.system.prepare(0.0);
    let solution = newton::solve(&mut scene.system, &EXACT);
    assert_eq!(solution.status, Status::Converged, "{solution:?}");
    for (link, joint) in scene.system.joints.iter().enumerate() {
        let axes = &scene.system.axes[joint.axes()];
        assert_close(axes[1].impulse, 0.0981 * (count - link) as f64, 1e-6);
    }
}

#[test]
fn a_lock_bears_what_hangs_from_it() {
    in_all_four!(hanging_chain, 20);
}

/// A joint transmits no velocity along its axes: after sweeps, the anchors of a ball joint move
/// alike, a hinge leaves rotation about its axis free, and momenta are conserved.
#[test]
fn locks_hold_anchors_and_conserve_momenta() {
    let random = &mut Random(3);
    for _ in 0..50 {
        let mut scene = Scene::<3, 3>::new();
        for _ in 0..2 {
            let mass = random.within(0.5, 2.0);
            let moments = Vector(std::array::from_fn(|_| mass * random.within(0.1, 0.9)));
            let axes = contact_frame(random.unit());
            let body = scene.body(random.vector(), mass, moments, &axes);
            scene.system.velocities[body as usize] =
                Velocity { linear: random.vector(), angular: random.vector() };
        }
        let mut hinge = frame(&scene, [0, 1], random.vector());
        hinge.axes = contact_frame(random.unit());
        let [locked, free] = [0..3, 4..6].map(|components| locks(&hinge, components, 0.0));
        scene.system.add_joint([0, 1], &[locked, free].concat());
        scene.system.prepare(0.0);
        let before = (scene.momentum(), scene.angular_momentum());
        let spin = |scene: &Scene<3, 3>| {
            let [a, b] = [0, 1].map(|body: usize| scene.system.velocities[body]);
            let twist = hinge.twist(&a, &b);
            (twist.linear.length(), twist.angular)
        };
        for _ in 0..2000 {
            pgs::sweep(&mut scene.system);
        }
        let (apart, turning) = spin(&scene);
        assert!(apart < 1e-9, "anchors part at {apart} m/s");
        assert!(turning[1].abs().max(turning[2].abs()) < 1e-9 && turning[0].abs() > 1e-3);
        assert!((scene.momentum() - before.0).length() < 1e-12);
        for (now, then) in scene.angular_momentum().iter().zip(&before.1) {
            assert_close(*now, *then, 1e-10);
        }
    }
}

/// A motor of 2 N m on 0.5 kg m^2 adds 4 rad/s in each second until it reaches 10 rad/s, and then
/// holds it. A rigid motor is certified although it has no compliance.
#[test]
fn a_motor_gives_no_more_than_its_torque() {
    let mut scene = Scene::<2, 1>::new();
    let axes = [Vector([1.0])];
    let wheel = scene.body(Vector::ZERO, 1.0, Vector([0.5]), &axes);
    let wall = scene.wall();
    let (h, torque) = (0.01, 2.0);
    let own = frame(&scene, [wheel, wall], Vector::ZERO);
    let mut motor = Axis::lock(&own, &component(2));
    motor.law = Interval { targets: [10.0; 2], bounds: [-torque * h, torque * h], compliance: 0.0 };
    scene.system.add_joint([wheel, wall], &[motor]);
    scene.system.prepare(0.0);
    for step in 1..=300 {
        scene.system.axes[0].impulse = 0.0;
        let solution = newton::solve(&mut scene.system, &EXACT);
        assert_eq!(solution.status, Status::Converged, "{step}: {solution:?}");
        let speed = scene.system.velocities[0].angular[0];
        assert_close(speed, (4.0 * h * f64::from(step)).min(10.0), 1e-9);
    }
    // It starts to slow the wheel at once.
    scene.system.axes[0].law.targets = [0.0; 2];
    scene.system.axes[0].impulse = 0.0;
    newton::solve(&mut scene.system, &EXACT);
    assert_close(scene.system.velocities[0].angular[0], 10.0 - 4.0 * h, 1e-9);
}

/// A row along which nothing can move takes no part, and a rigid lock that nothing bounds is not
/// certified while it misses its target.
#[test]
fn rows_that_nothing_moves_take_no_part_and_rigid_locks_prove_nothing() {
    let mut scene = Scene::<3, 3>::new();
    let [wall, other] = [scene.wall(), scene.wall()];
    let own = frame(&scene, [wall, other], Vector::ZERO);
    scene.system.add_joint([wall, other], &locks(&own, 0..6, 1e-3));
    let ball = scene.ball(Vector([1.0, 0.0, 0.0]), 1.0);
    scene.system.velocities[ball as usize].linear = Vector([1.0, 0.0, 0.0]);
    let own = frame(&scene, [ball, wall], Vector([1.0, 0.0, 0.0]));
    scene.system.add_joint([ball, wall], &locks(&own, 0..1, 0.0));
    scene.system.prepare(0.0);
    assert!(scene.system.axes[..6].iter().all(|axis| axis.effective_mass == 0.0));
    let before = scene.system.velocities.clone();
    assert_eq!(certify(&scene.system, &before).error(), f64::INFINITY);
    pgs::sweep(&mut scene.system);
    assert_eq!(scene.system.velocities[ball as usize].linear, Vector::ZERO);
    assert!(scene.system.axes[..6].iter().all(|axis| axis.impulse == 0.0));
    assert!(certify(&scene.system, &before).error() < 1e-9);
}

/// The relaxing sweep takes the bias out: a lock that repairs its position moves the bodies at its
/// target, and leaves them at rest. A contact's target is its bias and the rest.
#[test]
fn relaxing_takes_out_the_bias() {
    let mut scene = Scene::<2, 1>::new();
    let ball = scene.ball(Vector::ZERO, 2.0);
    let wall = scene.wall();
    let own = frame(&scene, [ball, wall], Vector::ZERO);
    let mut axes = locks(&own, 0..2, 0.0);
    (axes[0].law.targets, axes[0].bias) = ([0.25; 2], 0.25);
    scene.system.add_joint([ball, wall], &axes);
    scene.system.prepare(0.0);
    pgs::sweep(&mut scene.system);
    assert_close(scene.system.velocities[0].linear[0], 0.25, 1e-12);
    pgs::relax(&mut scene.system);
    assert!(scene.system.velocities[0].linear.length() < 1e-12);
    for target in [-0.3, 0.0, 0.2] {
        let contact = Contact { target: Vector([target, 0.0]), ..Contact::default() };
        assert_eq!(contact.bias() + contact.unbiased_target(), target);
        assert!(contact.bias() >= 0.0 && contact.unbiased_target() <= 0.0);
    }
}

/// A method that does not know joints refuses them.
#[test]
fn a_method_without_joints_refuses_them() {
    let mut system = random_system::<3, 3>(5);
    let goal = Goal { tolerance: 1e-6, budget: 10 };
    assert_eq!(apgd::solve(&mut system, &goal).status, Status::BadInput);
}
