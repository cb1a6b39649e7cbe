//! The theorem of the certificate, for impulses in any closed convex sets: contacts are one of
//! them, and locks, limits, motors, springs, friction and breaking rows others.
//!
//! Let K_i be closed and convex, s_i(r) = min(r . t-, r . t+) - epsilon |r|^2 / 2, and phi_i(u) the
//! maximum of s_i(r) - r . u over K_i. P(v) = |v - v*|^2 / 2 + sum phi_i(J_i v) has one minimum
//! v_exact. For any v and any r in the sets let d = v - v* - M^-1 J^T r and G = |d|^2 / 2 + sum
//! (phi_i(J_i v) - s_i(r_i) + r_i . J_i v), with |x|^2 = x . M x. Then G >= 0 and
//! |v - v_exact| <= |d| / 2 + sqrt(G - |d|^2 / 4).
//!
//! Proof: `certificate.rs`; it uses of the cones only that they are closed and convex.

use drystone_solver::Vector;
use drystone_solver::law::{Cone, Interval, Law, SmoothLaw};

use crate::common::Random;

/// Components of an impulse.
const N: usize = 3;

type Impulse = [f64; N];

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn minus(a: Impulse, b: Impulse) -> Impulse {
    std::array::from_fn(|i| a[i] - b[i])
}

/// The nearest point to `r` on all of these planes a . r = b; none if they have no point or one of
/// them is superfluous.
fn on_planes(mut r: Impulse, planes: impl Iterator<Item = (Impulse, f64)>) -> Option<Impulse> {
    let mut basis: Vec<Impulse> = Vec::new();
    let mut at = [0.0; N];
    for (normal, offset) in planes {
        // A direction in the plane of the others, and how far along it this plane is.
        let mut direction = normal;
        for axis in &basis {
            let along = dot(axis, &normal);
            direction = std::array::from_fn(|i| direction[i] - along * axis[i]);
        }
        let length = dot(&direction, &direction).sqrt();
        if length < 1e-6 {
            return None;
        }
        let axis = direction.map(|x| x / length);
        let way = (offset - dot(&normal, &at)) / length;
        at = std::array::from_fn(|i| at[i] + way * axis[i]);
        let along = dot(&axis, &r);
        r = std::array::from_fn(|i| r[i] - along * axis[i]);
        basis.push(axis);
    }
    Some(std::array::from_fn(|i| r[i] + at[i]))
}

/// A closed convex set of impulses.
#[derive(Clone, Debug)]
enum Set {
    /// Coulomb's cone of this friction: a contact.
    Cone(f64),
    /// Bounds of each component: a lock (infinite), a limit (from 0), a motor.
    Box([[f64; 2]; N]),
    /// A ball: friction of a joint, or a lock that breaks.
    Ball(f64),
    /// An intersection of half-spaces a . r <= b: a polytope, or what is left of space.
    Halfspaces(Vec<(Impulse, f64)>),
}

impl Set {
    /// The nearest impulse of the set.
    fn nearest(&self, r: Impulse) -> Impulse {
        match self {
            Self::Cone(mu) => {
                let pull = r[1].hypot(r[2]);
                if pull <= mu * r[0] {
                    r
                } else if mu * pull <= -r[0] {
                    [0.0; N]
                } else {
                    let normal = (r[0] + mu * pull) / (1.0 + mu * mu);
                    [normal, mu * normal * r[1] / pull, mu * normal * r[2] / pull]
                }
            }
            Self::Box(bounds) => std::array::from_fn(|i| r[i].clamp(bounds[i][0], bounds[i][1])),
            Self::Ball(radius) => {
                let scale = (radius / dot(&r, &r).sqrt()).min(1.0);
                r.map(|x| x * scale)
            }
            // The nearest impulse lies on some of the planes: the nearest of all such points that
            // are in the set.
            Self::Halfspaces(all) => {
                let within = |at: &Impulse| all.iter().all(|(a, b)| dot(a, at) <= b + 1e-12);
                let corners = (0..1 << all.len()).filter_map(|planes: usize| {
                    let chosen = (0..all.len()).filter(|plane| planes >> plane & 1 == 1);
                    on_planes(r, chosen.map(|plane| all[plane]))
                });
                let far = |at: &Impulse| dot(&minus(*at, r), &minus(*at, r));
                let inside = corners.filter(within);
                inside.min_by(|a, b| far(a).total_cmp(&far(b))).expect("0 is in the set")
            }
        }
    }
}

/// One constraint on a velocity: J, K, t- <= t+ and epsilon.
#[derive(Clone, Debug)]
struct Row {
    jacobian: Vec<Vec<f64>>,
    set: Set,
    /// Equal but for rows of one component, which may have a slack between two targets.
    targets: [Impulse; 2],
    compliance: f64,
}

impl Row {
    fn velocity(&self, v: &[f64]) -> Impulse {
        std::array::from_fn(|i| dot(&self.jacobian[i], v))
    }

    /// s(r). \[J\]
    fn value(&self, r: &Impulse) -> f64 {
        let by_component = |i: usize| (r[i] * self.targets[0][i]).min(r[i] * self.targets[1][i]);
        (0..N).map(by_component).sum::<f64>() - 0.5 * self.compliance * dot(r, r)
    }

    /// The impulse that attains phi(u): for one target it is the nearest one to (t - u) / epsilon,
    /// for a slack that of the target that is missed. A box, where a slack may be, has independent
    /// components.
    fn response(&self, u: &Impulse) -> Impulse {
        let missed = |i: usize| {
            let [low, high] = self.targets.map(|target| target[i]);
            let missed = if u[i] < low { low - u[i] } else { high.min(u[i]) - u[i] };
            missed / self.compliance
        };
        self.set.nearest(std::array::from_fn(missed))
    }

    /// phi(u). \[J\]
    fn phi(&self, u: &Impulse) -> f64 {
        let best = self.response(u);
        self.value(&best) - dot(&best, u)
    }
}

/// Bodies as a vector of velocities with a diagonal mass, and constraints on it.
struct Problem {
    mass: Vec<f64>,
    start: Vec<f64>,
    rows: Vec<Row>,
}

impl Problem {
    fn random(random: &mut Random) -> Self {
        let size = 3 + random.below(6);
        let mut between = |low: f64, high: f64| random.within(low, high);
        let mass: Vec<f64> = (0..size).map(|_| 10f64.powf(between(-0.3, 1.7))).collect();
        let start = (0..size).map(|_| between(-3.0, 3.0)).collect();
        let count = 1 + between(0.0, 4.0) as usize;
        let rows = (0..count).map(|_| {
            let jacobian =
                (0..N).map(|_| (0..size).map(|_| between(-1.0, 1.0)).collect()).collect();
            let mut targets = [std::array::from_fn(|_| between(-1.0, 1.0)); 2];
            let set = match between(0.0, 4.0) as usize {
                0 => Set::Cone(between(0.0, 1.5)),
                1 => {
                    for i in 0..N {
                        targets[1][i] += between(0.0, 1.0);
                    }
                    let mut bound = || match between(-1.0, 3.0) {
                        at if at < 0.0 => f64::INFINITY,
                        at => at,
                    };
                    Set::Box(std::array::from_fn(|_| [-bound(), bound()]))
                }
                2 => Set::Ball(between(0.1, 3.0)),
                _ => Set::Halfspaces(
                    (0..4)
                        .map(|_| (std::array::from_fn(|_| between(-1.0, 1.0)), between(0.0, 1.0)))
                        .collect(),
                ),
            };
            Row { jacobian, set, targets, compliance: 10f64.powf(between(-1.0, 0.0)) }
        });
        let rows = rows.collect();
        Self { mass, start, rows }
    }

    /// v* + M^-1 J^T r.
    fn velocities(&self, impulses: &[Impulse]) -> Vec<f64> {
        let mut v = self.start.clone();
        for (row, r) in self.rows.iter().zip(impulses) {
            for (jacobian, r) in row.jacobian.iter().zip(r) {
                for (body, own) in v.iter_mut().enumerate() {
                    *own += jacobian[body] * r / self.mass[body];
                }
            }
        }
        v
    }

    fn squared(&self, v: &[f64]) -> f64 {
        v.iter().zip(&self.mass).map(|(v, mass)| mass * v * v).sum()
    }

    /// v_exact, by proximal steps on the impulses: each takes the constraint that a row's response
    /// to a velocity is its impulse, and halves the way there by the stiffness of all.
    fn exact(&self) -> Vec<f64> {
        let stiffness: f64 = self
            .rows
            .iter()
            .flat_map(|row| &row.jacobian)
            .map(|jacobian| {
                jacobian.iter().zip(&self.mass).map(|(j, mass)| j * j / mass).sum::<f64>()
            })
            .sum();
        let mut impulses = vec![[0.0; N]; self.rows.len()];
        for _ in 0..100_000 {
            let v = self.velocities(&impulses);
            let mut change = 0.0_f64;
            for (row, r) in self.rows.iter().zip(&mut impulses) {
                // max over r' of s(r') - r' . u - stiffness |r' - r|^2 / 2.
                let u = row.velocity(&v);
                let near = Row { compliance: row.compliance + stiffness, ..row.clone() };
                let shifted = std::array::from_fn(|i| u[i] - stiffness * r[i]);
                let next = near.response(&shifted);
                change = change.max(minus(next, *r).iter().fold(0.0, |most, x| most.max(x.abs())));
                *r = next;
            }
            if change < 1e-14 {
                break;
            }
        }
        self.velocities(&impulses)
    }

    /// G and the bound on the error of v.
    fn bound(&self, v: &[f64], impulses: &[Impulse]) -> [f64; 2] {
        let produced = self.velocities(impulses);
        let d: Vec<f64> = v.iter().zip(&produced).map(|(v, own)| v - own).collect();
        let squared = self.squared(&d);
        let losses = self.rows.iter().zip(impulses).map(|(row, r)| {
            let u = row.velocity(v);
            row.phi(&u) - row.value(r) + dot(r, &u)
        });
        let gap = 0.5 * squared + losses.sum::<f64>();
        [gap, 0.5 * squared.sqrt() + (gap - 0.25 * squared).max(0.0).sqrt()]
    }
}

/// In 300 random problems with cones, boxes (some with slack), balls and polytopes: G is never
/// negative, the bound is never below the error, it is 0 at the solution, and in some cases it is
/// attained to 1 %.
#[test]
fn the_bound_holds_for_any_closed_convex_sets() {
    let (mut tightest, mut checked) = (f64::INFINITY, 0);
    for seed in 0..300 {
        let mut random = Random(seed);
        let problem = Problem::random(&mut random);
        let exact = problem.exact();
        let respond = |v: &[f64]| -> Vec<Impulse> {
            problem.rows.iter().map(|row| row.response(&row.velocity(v))).collect()
        };
        let [gap, at_solution] = problem.bound(&exact, &respond(&exact));
        assert!(gap.abs() < 1e-6 && at_solution < 1e-3, "{seed}: {gap} J at the solution");
        for scale in [1e-2, 0.1, 1.0] {
            let mut off = |x: f64| x + scale * random.within(-1.0, 1.0);
            let v: Vec<f64> = exact.iter().map(|&x| off(x)).collect();
            let answers = respond(&v);
            let others: Vec<Impulse> = problem
                .rows
                .iter()
                .zip(&answers)
                .map(|(row, r)| row.set.nearest(r.map(&mut off)))
                .collect();
            for impulses in [answers, others] {
                // Velocities as they are, and those that the impulses produce.
                for v in [v.clone(), problem.velocities(&impulses)] {
                    let [gap, bound] = problem.bound(&v, &impulses);
                    let error: Vec<f64> = v.iter().zip(&exact).map(|(v, own)| v - own).collect();
                    let error = problem.squared(&error).sqrt();
                    assert!(gap > -1e-9, "{seed}: gap {gap}");
                    assert!(error <= bound * (1.0 + 1e-6) + 1e-5, "{seed}: {error} above {bound}");
                    if error > 1e-3 {
                        (tightest, checked) = (tightest.min(bound / error), checked + 1);
                    }
                }
            }
        }
    }
    assert!(checked > 1000 && tightest < 1.01, "{checked} checked, the tightest {tightest}");
}

/// The response, the loss and the slope of a law are those of its set and value: phi by its
/// definition, and the slope by differences.
fn check_law<const M: usize>(
    law: &(impl Law<f64, M> + SmoothLaw<M>),
    row: &Row,
    u: &Impulse,
    guess: &Impulse,
) {
    let cut = |x: &Impulse| Vector(std::array::from_fn::<f64, M, _>(|i| x[i]));
    let pad = |x: Vector<f64, M>| std::array::from_fn(|i| if i < M { x[i] } else { 0.0 });
    let r = law.clamp(cut(guess));
    let inside = pad(r);
    assert!(minus(row.set.nearest(inside), inside).iter().all(|x| x.abs() < 1e-12), "{row:?}");
    let (best, expected) = (pad(law.response(cut(u))), row.response(u));
    assert!(minus(best, expected).iter().all(|x| x.abs() < 1e-9), "{row:?}: {best:?} {expected:?}");
    let loss = row.phi(u) - row.value(&inside) + dot(&inside, u);
    assert!(
        (law.loss(cut(u), r) - loss).abs() < 1e-9 * (1.0 + loss),
        "{row:?} {u:?} {r:?}: {loss}"
    );
    assert!(law.loss(cut(u), r) >= 0.0 && law.loss(cut(u), law.response(cut(u))) < 1e-12);
    // s is a parabola on the way to the response, where the law says so.
    if law.is_parabola(cut(u), r) > 0.0 {
        let way = law.response(cut(u)) - r;
        let middle = law.loss(cut(u), r + way * 0.5);
        let slope = -way.dot(law.missing(cut(u), r));
        let parabola = law.loss(cut(u), r) + 0.5 * slope + 0.125 * way.dot(law.soften(way));
        assert!((middle - parabola).abs() < 1e-9 * (1.0 + loss), "{row:?}: {middle} {parabola}");
    }
    let (slope, step) = (law.slope(cut(u)), 1e-6);
    for j in 0..M {
        let moved = |by: f64| {
            let mut u = cut(u);
            u[j] += by;
            law.response(u)
        };
        let (before, after, at) = (moved(-step), moved(step), moved(0.0));
        for i in 0..M {
            let [left, right] = [(at[i] - before[i]) / step, (after[i] - at[i]) / step];
            // At a kink there is no derivative.
            if (left - right).abs() < 1e-3 {
                let own = slope.entry(i, j);
                assert!((own + right).abs() < 1e-3, "{row:?} {u:?}: {own} and {}", -right);
            }
        }
    }
}

/// The laws of the crate agree with the sets of the theorem, in 2000 cases each.
#[test]
fn laws_are_those_of_the_theorem() {
    let mut random = Random(7);
    for _ in 0..2000 {
        let mut vector = |size: f64| std::array::from_fn(|_| random.within(-size, size));
        let (u, guess, low): (Impulse, Impulse, Impulse) = (vector(2.0), vector(3.0), vector(1.0));
        let [friction, compliance] = [random.within(0.0, 1.5), random.within(0.1, 1.0)];
        let contact =
            Row { jacobian: Vec::new(), set: Set::Cone(friction), targets: [low; 2], compliance };
        let cone = Cone {
            friction,
            impact: 0.0,
            normal: compliance,
            tangential: compliance,
            target: Vector(low),
            lowered: 0.0,
        };
        check_law(&cone, &contact, &u, &guess);
        let slack = random.within(-0.5, 1.0).max(0.0);
        let bounds = [-1.0, 1.0].map(|sign| match random.within(-1.0, 2.0) {
            at if at < 0.0 => sign * f64::INFINITY,
            at => sign * at,
        });
        let targets = [[low[0], 0.0, 0.0], [low[0] + slack, 0.0, 0.0]];
        let set = Set::Box([bounds, [0.0; 2], [0.0; 2]]);
        let row = Row { jacobian: Vec::new(), set, targets, compliance };
        let interval = Interval { targets: [low[0], low[0] + slack], bounds, compliance };
        check_law(&interval, &row, &[u[0], 0.0, 0.0], &guess);
    }
}

/// Visits of Gauss-Seidel to one row end at the response to the velocity that includes it, also
/// where the row is rigid: a lock reaches its target, a limit is met and no more.
#[test]
fn a_visit_solves_its_row() {
    let mut random = Random(8);
    for _ in 0..2000 {
        let [low, start, inverse_mass] =
            [random.within(-1.0, 1.0), random.within(-3.0, 3.0), random.within(0.2, 2.0)];
        let slack = random.within(-0.5, 1.0).max(0.0);
        let compliance = random.within(-0.5, 1.0).max(0.0);
        let bound = random.within(0.0, 3.0);
        let row = Interval { targets: [low, low + slack], bounds: [-bound, bound], compliance };
        let (guess, mass) = (random.within(-bound, bound), 1.0 / (inverse_mass + compliance));
        let r = row.visit(mass, start + inverse_mass * guess, guess);
        let again = row.visit(mass, start + inverse_mass * r, r);
        assert!((r - again).abs() < 1e-12, "one visit is enough: {r}, {again}");
        assert!(r.abs() <= bound, "{row:?}: {r} N s is out of bounds");
        let (u, inside) = (start + inverse_mass * r, r.abs() < bound - 1e-12);
        let missing = row.missing(Vector([u]), Vector([r]))[0];
        assert!(!inside || missing.abs() < 1e-12, "{row:?}: {r} N s misses {missing} m/s");
        assert!(inside || missing * r >= -1e-12, "{row:?}: {r} N s pushes on, {missing} m/s");
    }
}
