//! Accelerated projected gradient descent, APGD (Nesterov 1983): steps against the gradient w = J
//! v - t + epsilon gamma, projected onto the friction cones. Each step starts from a point
//! extrapolated beyond the last one.
//!
//! Norms use the effective masses as metric, so that heavy and light bodies count alike. A step is
//! gamma <- project(s - m_eff w / K), where K >= 1 bounds the change of w in a step. K is doubled
//! until it does, and lowered after every step. The momentum is dropped where it points against the
//! last step (O'Donoghue and Candes 2015). Coulomb's law: w_n is raised by mu |slip| of the current
//! point (De Saxce and Feng 1998).
//!
//! Cost of an iteration: two passes over the contacts, in any order. Use: where sweeps cannot run,
//! as on a device with thousands of lanes. It takes about 1 / sqrt(smallest eigenvalue) iterations,
//! like [`nncg`](crate::nncg), but without friction its convergence is proven.
//!
//! Contacts only: a system with joints is refused.
//!
//! Reference: Mazhar, Heyn, Negrut and Tasora, Using Nesterov's Method to Accelerate Multibody
//! Dynamics with Friction and Contact, 2015.

use crate::law::{Cone, Law};
use crate::solution::{self, Goal, Solution, Status, Track};
use crate::{Mass, System, Vector, Velocity};

/// Factor by which K is lowered after a step.
const EASE: f64 = 0.9;

/// Largest number of doublings of K within a step.
const DOUBLINGS: usize = 60;

/// Iterates until the certificate is good enough.
pub fn solve<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    goal: &Goal,
) -> Solution {
    let prospective = system.velocities.clone();
    if !system.joints.is_empty() {
        system.apply_impulses();
        return Track::start(system, &prospective, goal, 0).end(system, Status::BadInput);
    }
    let mut ahead: Option<State<L, A>> = None;
    let mut momentum = Momentum::default();
    let masses: Vec<_> = system.masses.iter().map(|mass| mass.mass()).collect();
    let mut bound = 1.0;
    solution::iterate(system, goal, |system| {
        let last = State::of(system);
        let from = ahead.take().unwrap_or_else(|| last.clone());
        from.put(system);
        let gradient = gradient(system);
        for _ in 0..DOUBLINGS {
            step(system, &from, &gradient, bound);
            system.velocities.clone_from(&prospective);
            system.apply_impulses();
            let (changed, length) = from.change(system, &masses);
            if changed <= bound * length * (1.0 + 1e-9) {
                break;
            }
            bound *= 2.0;
        }
        let part = momentum.next(from.turns_back(&last, system));
        ahead = Some(State::of(system).beyond(&last, part));
        bound = (EASE * bound).max(1e-3);
    })
}

/// Nesterov's momentum sequence.
struct Momentum {
    theta: f64,
}

impl Default for Momentum {
    fn default() -> Self {
        Self { theta: 1.0 }
    }
}

impl Momentum {
    /// Returns the extrapolation beyond the last step, as a fraction of it.
    fn next(&mut self, restart: bool) -> f64 {
        if restart {
            self.theta = 1.0;
            return 0.0;
        }
        let squared = self.theta * self.theta;
        let next = 0.5 * (squared * squared + 4.0 * squared).sqrt() - 0.5 * squared;
        let part = self.theta * (1.0 - self.theta) / (squared + next);
        self.theta = next;
        part
    }
}

/// Impulses and the velocities that go with them.
#[derive(Clone)]
struct State<const L: usize, const A: usize> {
    impulses: Vec<Vector<f64, L>>,
    velocities: Vec<Velocity<f64, L, A>>,
}

impl<const L: usize, const A: usize> State<L, A> {
    fn of(system: &System<f64, L, A>) -> Self {
        let impulses = system.contacts.iter().map(|contact| contact.impulse).collect();
        Self { impulses, velocities: system.velocities.clone() }
    }

    fn put(&self, system: &mut System<f64, L, A>) {
        for (contact, impulse) in system.contacts.iter_mut().zip(&self.impulses) {
            contact.impulse = *impulse;
        }
        system.velocities.clone_from(&self.velocities);
    }

    /// Extrapolates from `last` beyond this state; velocities are linear in impulses.
    fn beyond(mut self, last: &Self, part: f64) -> Self {
        for (own, last) in self.impulses.iter_mut().zip(&last.impulses) {
            *own += (*own - *last) * part;
        }
        for (own, last) in self.velocities.iter_mut().zip(&last.velocities) {
            *own += (*own - *last) * part;
        }
        self
    }

    /// Returns d . (A + R) d, and |d|^2 in the metric of the effective masses, for the difference d
    /// between the impulses of the system and of this state. \[J\]
    fn change(&self, system: &System<f64, L, A>, masses: &[Mass<L, A>]) -> (f64, f64) {
        let (mut changed, mut length) = (0.0, 0.0);
        for ((mass, v), own) in masses.iter().zip(&system.velocities).zip(&self.velocities) {
            changed += mass.squared(&(*v - *own));
        }
        for (manifold, index) in points(system) {
            let contact = &system.contacts[index];
            let d = contact.impulse - self.impulses[index];
            if contact.effective_mass > 0.0 {
                changed += d.dot(Cone::of(&system.manifolds[manifold], contact).soften(d));
                length += d.dot(d) / contact.effective_mass;
            }
        }
        (changed, length)
    }

    /// Returns true if the step from this state to the impulses of the system points against the
    /// step from `last` to them.
    fn turns_back(&self, last: &Self, system: &System<f64, L, A>) -> bool {
        let mut sum = 0.0;
        for ((contact, own), last) in system.contacts.iter().zip(&self.impulses).zip(&last.impulses)
        {
            if contact.effective_mass > 0.0 {
                let product = (*own - contact.impulse).dot(contact.impulse - *last);
                sum += product / contact.effective_mass;
            }
        }
        sum > 0.0
    }
}

/// Returns the manifold and the index of each contact.
fn points<const L: usize, const A: usize>(
    system: &System<f64, L, A>,
) -> impl Iterator<Item = (usize, usize)> {
    let manifolds = system.manifolds.iter().enumerate();
    manifolds.flat_map(|(index, manifold)| manifold.points().map(move |point| (index, point)))
}

/// Returns w of each contact, raised by mu |slip|. \[m/s\]
fn gradient<const L: usize, const A: usize>(system: &System<f64, L, A>) -> Vec<Vector<f64, L>> {
    let of_contact = |(manifold, index): (usize, usize)| {
        let (manifold, contact) = (&system.manifolds[manifold], &system.contacts[index]);
        let law = Cone::of(manifold, contact);
        let u = contact.relative_velocity(&system.twist_of(manifold));
        law.shifted(u, contact.impulse).missing(u, contact.impulse) * -1.0
    };
    points(system).map(of_contact).collect()
}

/// gamma <- project(s - m_eff w / K), where s are the impulses of `from`.
fn step<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    from: &State<L, A>,
    gradient: &[Vector<f64, L>],
    bound: f64,
) {
    for manifold in &system.manifolds {
        for index in manifold.points() {
            let contact = &mut system.contacts[index];
            if contact.effective_mass > 0.0 {
                let length = contact.effective_mass / bound;
                let law = Cone::of(manifold, contact);
                contact.impulse = law.nearest(from.impulses[index] - gradient[index] * length);
            }
        }
    }
}
