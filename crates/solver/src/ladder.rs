//! From method to stronger method, island by island, until the certificate is good enough.
//!
//! Sweeps, warm-started, are enough for most islands in most steps, and cost least. Where they are not,
//! [`nncg`] comes next, then [`newton`]. Each rung starts from the impulses of the one
//! before, and has a budget that is small against the cost of the next.

use crate::certificate::{Certificate, Memory, certify_islands};
use crate::island::Islands;
use crate::solution::{Goal, Solution, Status};
use crate::{Scalar, System, Velocity, newton, nncg, pgs};

/// A method of the ladder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rung {
    /// [`pgs`].
    Sweeps,
    /// [`nncg`].
    Nncg,
    /// [`newton`].
    Newton,
}

impl Rung {
    /// From the first to the last.
    pub const ALL: [Self; 3] = [Self::Sweeps, Self::Nncg, Self::Newton];

    /// Its name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sweeps => "sweeps",
            Self::Nncg => "nncg",
            Self::Newton => "newton",
        }
    }

    /// Iterations before the next one is tried.
    const fn budget(self) -> usize {
        match self {
            Self::Sweeps => 8,
            Self::Nncg => 16,
            Self::Newton => usize::MAX,
        }
    }
}

/// Solves a system whose velocities are the prospective ones and whose impulses are a guess, with the
/// first method that reaches the tolerance. `goal.budget` is what the last one may use. On return
/// it holds the best velocities and impulses; the history is that of all methods.
pub fn solve<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    goal: &Goal,
) -> (Solution, Rung) {
    let prospective = system.velocities.clone();
    let mut history = Vec::new();
    let mut best: Option<(Solution, Rung, System<f64, L, A>)> = None;
    for rung in Rung::ALL {
        let goal = Goal { budget: goal.budget.min(rung.budget()), ..*goal };
        system.velocities.clone_from(&prospective);
        let solution = match rung {
            Rung::Sweeps => pgs::solve(system, &goal),
            Rung::Nncg => nncg::solve(system, &goal),
            Rung::Newton => newton::solve(system, &goal),
        };
        history.extend_from_slice(&solution.history);
        let better = (best.as_ref())
            .is_none_or(|(best, ..)| solution.certificate.gap < best.certificate.gap);
        let done = solution.status == Status::Converged;
        if better {
            best = Some((solution, rung, system.clone()));
        }
        if done {
            break;
        }
    }
    match best {
        Some((solution, rung, solved)) => {
            *system = solved;
            (Solution { history, ..solution }, rung)
        }
        None => {
            let certificate = Certificate::NONE;
            (Solution { status: Status::BadInput, certificate, history }, Rung::Sweeps)
        }
    }
}

/// What became of the islands of a system.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Islands.
    pub islands: usize,
    /// Islands that were beyond the tolerance, by the rung that brought them home.
    pub climbed: [usize; Rung::ALL.len()],
    /// Islands that stayed beyond it.
    pub failed: usize,
    /// The largest certified error of an island. \[m/s\]
    pub error: f64,
    /// A body of that island.
    pub worst: Option<u32>,
}

impl Outcome {
    /// The worse of two.
    pub fn join(&mut self, other: &Self) {
        self.islands = self.islands.max(other.islands);
        self.failed += other.failed;
        for (own, other) in self.climbed.iter_mut().zip(other.climbed) {
            *own += other;
        }
        if other.error > self.error || self.worst.is_none() {
            (self.error, self.worst) = (other.error, other.worst);
        }
    }
}

/// Brings every island within the tolerance that is not. `system` holds velocities and impulses as
/// sweeps left them, `prospective` its velocities without impulses.
pub fn refine<T: Scalar, const L: usize, const A: usize>(
    system: &mut System<T, L, A>,
    prospective: &[Velocity<T, L, A>],
    islands: &Islands,
    goal: &Goal,
    memory: &mut Memory<L, A>,
    certificates: &mut Vec<Certificate>,
) -> Outcome {
    let of_body = &islands.of_body;
    certify_islands(system, prospective, of_body, islands.count, memory, certificates);
    let mut outcome = Outcome { islands: islands.count, ..Outcome::default() };
    let beyond = |certificate: &Certificate| certificate.error().total_cmp(&goal.tolerance).is_gt();
    if certificates.iter().any(beyond) {
        // Rounding to the numbers of the system must not take what was reached away.
        let finer = Goal { tolerance: 0.05 * goal.tolerance, ..*goal };
        for island in 0..islands.count {
            if beyond(&certificates[island]) {
                let (status, rung) = replace(system, prospective, islands, island as u32, &finer);
                if status == Status::Converged {
                    outcome.climbed[rung as usize] += 1;
                }
            }
        }
        certify_islands(system, prospective, of_body, islands.count, memory, certificates);
    }
    for (island, certificate) in certificates.iter().enumerate() {
        outcome.failed += usize::from(beyond(certificate));
        if outcome.worst.is_none() || certificate.error() > outcome.error {
            outcome.error = certificate.error();
            outcome.worst = of_body.iter().position(|&of| of == island as u32).map(|b| b as u32);
        }
    }
    outcome
}

/// Solves one island apart, in `f64`, and puts its velocities and impulses back.
fn replace<T: Scalar, const L: usize, const A: usize>(
    system: &mut System<T, L, A>,
    prospective: &[Velocity<T, L, A>],
    islands: &Islands,
    island: u32,
    goal: &Goal,
) -> (Status, Rung) {
    let mut part = System::<f64, L, A>::new();
    let mut inside = vec![u32::MAX; system.masses.len()];
    let mut bodies = Vec::new();
    let mut manifolds = Vec::new();
    for (index, manifold) in system.manifolds.iter().enumerate() {
        if islands.of_pair(manifold.bodies) != island {
            continue;
        }
        for body in manifold.bodies.map(|body| body as usize) {
            if inside[body] == u32::MAX {
                inside[body] = part.add_body(prospective[body].cast(), system.masses[body].cast());
                bodies.push(body);
            }
        }
        let mut own = manifold.cast();
        own.bodies = manifold.bodies.map(|body| inside[body as usize]);
        let points: Vec<_> =
            system.contacts[manifold.points()].iter().map(|contact| contact.cast()).collect();
        part.add_manifold(own, &points);
        manifolds.push(index);
    }
    let (solution, rung) = solve(&mut part, goal);
    if solution.status != Status::BadInput {
        for (&body, velocity) in bodies.iter().zip(&part.velocities) {
            if islands.of_body[body] == island {
                system.velocities[body] = velocity.cast();
            }
        }
        let mut solved = part.contacts.iter();
        for index in manifolds {
            let points = system.manifolds[index].points();
            for (contact, solved) in system.contacts[points].iter_mut().zip(&mut solved) {
                contact.impulse = solved.impulse.cast();
            }
        }
    }
    (solution.status, rung)
}
