//! From method to stronger method, island by island, until the certificate is good enough.
//!
//! Sweeps, warm-started, are enough for most islands in most steps, and cost least. Where they are not,
//! [`nncg`] comes next, then [`newton`], then, with the feature `assembled`, the proximal-point method.
//! Each method starts from the impulses of the one before, and has a budget that is small against the
//! cost of the next.

use std::time::Duration;

use crate::certificate::{Certificate, CertificateScratch};
use crate::island::Islands;
use crate::part::SubSystem;
use crate::solution::{Goal, Solution, Status};
use crate::wide::Wide;
use crate::{Clock, InverseMass, System, Velocity, newton, nncg, pgs};

/// A method of the ladder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Method {
    /// [`pgs`].
    Sweeps,
    /// [`nncg`].
    Nncg,
    /// [`newton`].
    Newton,
    /// [`proximal`](crate::proximal).
    #[cfg(feature = "assembled")]
    Proximal,
}

impl Method {
    /// From the first to the last.
    pub const ALL: &[Self] = &[
        Self::Sweeps,
        Self::Nncg,
        Self::Newton,
        #[cfg(feature = "assembled")]
        Self::Proximal,
    ];

    /// Those that are left when lanes have done what they can.
    const IN_MATRICES: &[Self] = Self::ALL.split_at(2).1;

    /// Its name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sweeps => "sweeps",
            Self::Nncg => "nncg",
            Self::Newton => "newton",
            #[cfg(feature = "assembled")]
            Self::Proximal => "proximal",
        }
    }

    /// Iterations before the next one is tried.
    const fn budget(self) -> usize {
        match self {
            Self::Sweeps => 8,
            Self::Nncg => 16,
            _ => usize::MAX,
        }
    }

    fn solve<const L: usize, const A: usize>(
        self,
        system: &mut System<f64, L, A>,
        goal: &Goal,
    ) -> Solution {
        match self {
            Self::Sweeps => pgs::solve(system, goal),
            Self::Nncg => nncg::solve(system, goal),
            Self::Newton => newton::solve(system, goal),
            #[cfg(feature = "assembled")]
            Self::Proximal => crate::proximal::solve(system, goal),
        }
    }
}

/// Solves a system whose velocities are the prospective ones and whose impulses are a guess, with the
/// first method that reaches the tolerance. `goal.budget` is what the last ones may use. On return
/// it holds the best velocities and impulses; the history is that of all methods.
pub fn solve<const L: usize, const A: usize>(
    system: &mut System<f64, L, A>,
    goal: &Goal,
) -> (Solution, Method) {
    solve_by(Method::ALL, system, goal)
}

fn solve_by<const L: usize, const A: usize>(
    methods: &[Method],
    system: &mut System<f64, L, A>,
    goal: &Goal,
) -> (Solution, Method) {
    let prospective = system.velocities.clone();
    let mut history = Vec::new();
    let mut best: Option<(Solution, Method, System<f64, L, A>)> = None;
    for &method in methods {
        let goal = Goal { budget: goal.budget.min(method.budget()), ..*goal };
        system.velocities.clone_from(&prospective);
        let solution = method.solve(system, &goal);
        history.extend_from_slice(&solution.history);
        let error = solution.certificate.error();
        let better = best.as_ref().is_none_or(|(best, ..)| error < best.certificate.error());
        let done = solution.status == Status::Converged;
        if better {
            best = Some((solution, method, system.clone()));
        }
        if done {
            break;
        }
    }
    match best {
        Some((solution, method, solved)) => {
            *system = solved;
            (Solution { history, ..solution }, method)
        }
        None => {
            let certificate = Certificate::NONE;
            (Solution { status: Status::BadInput, certificate, history }, Method::Sweeps)
        }
    }
}

/// What became of the islands of a system.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SolveReport {
    /// Islands.
    pub islands: usize,
    /// Iterations of [`nncg`] over the islands that needed them.
    pub iterations: usize,
    /// Islands that Newton's method was asked for.
    pub newton: usize,
    /// Time for certificates.
    pub certifying: Duration,
    /// The largest residual of Coulomb's law ([`Certificate::natural_residual`]), fastest approach beyond a
    /// target ([`Certificate::approach_error`]) and cone violation ([`Certificate::cone`]) of a contact in
    /// what was examined. \[m/s\]
    pub residuals: [f64; 3],
    /// Sum over the contacts in what was examined ([`Certificate::complementarity`]). \[J\]
    pub complementarity: f64,
    /// Islands that stayed beyond the tolerance.
    pub failed: usize,
    /// The largest certified error of an island. \[m/s\]
    pub error: f64,
    /// A body of that island.
    pub worst: Option<u32>,
}

impl SolveReport {
    /// The worse of two.
    pub fn join(&mut self, other: &Self) {
        self.islands = self.islands.max(other.islands);
        self.iterations += other.iterations;
        self.newton += other.newton;
        self.certifying += other.certifying;
        self.failed += other.failed;
        for (own, other) in self.residuals.iter_mut().zip(other.residuals) {
            *own = own.max(other);
        }
        self.complementarity = self.complementarity.max(other.complementarity);
        if other.error > self.error || self.worst.is_none() {
            (self.error, self.worst) = (other.error, other.worst);
        }
    }

    fn set_residuals(&mut self, certificates: &[Certificate]) {
        (self.residuals, self.complementarity) = ([0.0; 3], 0.0);
        for of in certificates {
            for (own, other) in
                self.residuals.iter_mut().zip([of.natural_residual, of.approach_error, of.cone])
            {
                *own = own.max(other);
            }
            self.complementarity += of.complementarity;
        }
    }

    fn set_worst(&mut self, errors: &[f64], islands: &Islands) {
        let worst = errors.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
        let Some((island, &error)) = worst else { return };
        self.error = error;
        let mut of_body = islands.of_body.iter();
        self.worst = of_body.position(|&of| of == island as u32).map(|body| body as u32);
    }
}

/// Iterations of [`nncg`] in lanes before Newton's method is tried, at least.
const IN_LANES: usize = 256;

/// Iterations that a large island may take for each of its bodies: a factor of its matrix takes longer than so many
/// sweeps over it. It is left alone for a quarter of them: bounds of many contacts come down in jerks.
const FOR_A_BODY: usize = 4;

/// The lanes go on to this part of the tolerance: what is left over moves the bodies, and the next
/// system begins with it.
const AIM: f64 = 1.0 / 7.0;

/// Or to this part of the speed of an island, within the tolerance: what moves does not see what is left over.
const OF_SPEED: f64 = 0.05;

/// Iterations from one certificate to the next, at most, or a quarter of those so far; more only while so many
/// halve what an iteration changes.
const LONGEST: usize = 16;

/// Iterations before their rate is trusted.
const TRIAL: usize = 12;

/// The next certificate is due where it is expected to prove this part of what is aimed at. \[1\]
const SURE: f64 = 0.9;

/// What a [`IslandSolver`] has learned from the systems so far: what it does with the next depends on it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SolverMemory {
    /// Certified error over the size of the iteration before it, sqrt(|g|^2 / m). \[1\]
    pub ratio: f64,
    /// Whether the impulses at hand were proof enough, without a better share of the load.
    pub direct: bool,
}

impl Default for SolverMemory {
    fn default() -> Self {
        Self { ratio: 5.0, direct: true }
    }
}

/// Climbs the ladder for one system after the other: those of the substeps of a simulation.
#[derive(Clone, Debug)]
pub struct IslandSolver<const L: usize, const A: usize> {
    /// How the next system is begun.
    pub memory: SolverMemory,
    /// What measures the time of certificates.
    pub clock: Clock,
    scratch: CertificateScratch<L, A>,
    done: Vec<bool>,
    errors: Vec<f64>,
    /// Of each island, the mass \[kg\] and the speed, root mean square by mass \[m/s\], when they were taken over.
    masses: Vec<f64>,
    speeds: Vec<f64>,
    /// Certified error of each island at which the lanes stop. \[m/s\]
    aims: Vec<f64>,
    /// Iterations in lanes that each island may take.
    limits: Vec<usize>,
}

impl<const L: usize, const A: usize> Default for IslandSolver<L, A> {
    fn default() -> Self {
        Self {
            memory: SolverMemory::default(),
            clock: Clock::system(),
            scratch: CertificateScratch::default(),
            done: Vec::new(),
            errors: Vec::new(),
            masses: Vec::new(),
            speeds: Vec::new(),
            aims: Vec::new(),
            limits: Vec::new(),
        }
    }
}

impl<const L: usize, const A: usize> IslandSolver<L, A> {
    /// Takes over the masses of the bodies, and how fast islands are.
    pub fn start(&mut self, system: &System<f32, L, A>, islands: &Islands) {
        self.scratch.set_masses(system);
        self.scratch.find_speeds(&system.velocities, islands, [&mut self.masses, &mut self.speeds]);
        self.limits.clear();
        self.limits.resize(islands.count, 0);
        for &island in &islands.of_body {
            if let Some(bodies) = self.limits.get_mut(island as usize) {
                *bodies += 1;
            }
        }
        self.limits.iter_mut().for_each(|limit| *limit = IN_LANES.max(FOR_A_BODY * *limit));
    }

    /// Takes over the masses of bodies that have turned.
    pub fn follow(&mut self, system: &System<f32, L, A>) {
        self.scratch.retake_masses(system);
    }

    /// Brings every island within the tolerance: [`nncg`] in lanes for all, Newton's method in `f64`
    /// for those that it does not bring home. `wide` holds the contacts, with the impulses that
    /// `system.velocities` hold too; `prospective` are the velocities without them. `RESIDUALS`: as well
    /// as errors.
    pub fn solve_islands<const RESIDUALS: bool>(
        &mut self,
        system: &mut System<f32, L, A>,
        wide: &mut Wide<L, A>,
        prospective: &[Velocity<f32, L, A>],
        islands: &Islands,
        goal: &Goal,
    ) -> SolveReport {
        let mut outcome = SolveReport { islands: islands.count, ..SolveReport::default() };
        let beyond = |error: &f64| error.total_cmp(&goal.tolerance).is_gt();
        let velocities = &mut system.velocities;
        self.in_lanes::<RESIDUALS>(velocities, wide, prospective, islands, goal, &mut outcome);
        if self.errors.iter().any(beyond) {
            wide.unpack(system);
            // Rounding to the numbers of the system must not take what was reached away.
            let finer = Goal { tolerance: AIM * goal.tolerance, ..*goal };
            for island in 0..islands.count {
                if beyond(&self.errors[island]) {
                    replace(system, prospective, islands, island as u32, &finer);
                    outcome.newton += 1;
                }
            }
            wide.take_impulses(system);
            let velocities = &system.velocities;
            self.certify::<RESIDUALS>(velocities, wide, prospective, islands, &mut outcome);
        }
        outcome.failed = self.errors.iter().filter(|error| beyond(error)).count();
        outcome.set_worst(&self.errors, islands);
        outcome
    }

    /// The certificate of a system as it is, with all its residuals.
    pub fn examine(
        &mut self,
        velocities: &[Velocity<f32, L, A>],
        wide: &Wide<L, A>,
        prospective: &[Velocity<f32, L, A>],
        islands: &Islands,
    ) -> SolveReport {
        let mut outcome = SolveReport { islands: islands.count, ..SolveReport::default() };
        self.certify_by::<true, true>(velocities, wide, prospective, islands, &mut outcome);
        outcome.set_worst(&self.errors, islands);
        outcome
    }

    /// The methods in lanes. Leaves the certified errors of the islands.
    fn in_lanes<const RESIDUALS: bool>(
        &mut self,
        velocities: &mut [Velocity<f32, L, A>],
        wide: &mut Wide<L, A>,
        prospective: &[Velocity<f32, L, A>],
        islands: &Islands,
        goal: &Goal,
        outcome: &mut SolveReport,
    ) {
        self.done.clear();
        self.done.resize(islands.count, false);
        self.errors.clear();
        self.errors.resize(islands.count, f64::INFINITY);
        wide.begin_conjugate();
        let (least, most) = (AIM * goal.tolerance, goal.tolerance);
        self.aims.clear();
        self.aims.extend(self.speeds.iter().map(|speed| (OF_SPEED * speed).max(least).min(most)));
        let mut before = Vec::new();
        while self.done.contains(&false) {
            let longest = LONGEST.max(outcome.iterations / 4);
            let (due, size) = self.iterate(velocities, wide, longest);
            outcome.iterations += due;
            before.clone_from(&self.errors);
            self.certify::<RESIDUALS>(velocities, wide, prospective, islands, outcome);
            // How many times as large as it may be.
            let mut worst = 0.0f64;
            let errors = before.iter().zip(&self.errors).zip(self.aims.iter().zip(&self.limits));
            for (done, ((&before, &error), (&aim, &limit))) in self.done.iter_mut().zip(errors) {
                if !*done {
                    let made = [due, outcome.iterations];
                    worst = worst.max(error / aim);
                    *done = error <= aim || is_hopeless([before, error], made, limit, aim);
                }
            }
            let ratio = worst / size;
            if ratio.is_finite() {
                self.memory.ratio = ratio;
            }
        }
    }

    /// Iterates until what still changes promises that it is enough, or `longest` did not halve it; returns how
    /// often, and the [size](Self::largest) of the last.
    fn iterate(
        &self,
        velocities: &mut [Velocity<f32, L, A>],
        wide: &mut Wide<L, A>,
        longest: usize,
    ) -> (usize, f64) {
        let (mut made, mut size_before) = (0usize, 0.0);
        loop {
            wide.conjugate(velocities, &self.done);
            let size = self.largest(wide.gradients());
            made += 1;
            if self.memory.ratio * size <= SURE {
                return (made, size);
            }
            // Of an infinite mass it is infinite, or no number.
            if made == 1 || made.is_multiple_of(longest) && size < 0.5 * size_before {
                size_before = size;
            } else if made.is_multiple_of(longest) {
                return (made, size);
            }
        }
    }

    /// The largest sqrt(|g|^2 / m) of an island by these |g|^2 \[J\], in terms of its aim. \[1\]
    fn largest(&self, gradients: &[f32]) -> f64 {
        let islands = gradients.iter().zip(&self.masses).zip(&self.aims);
        let sizes = islands.map(|((&size, mass), aim)| f64::from(size) / (mass * aim * aim));
        sizes.fold(0.0, f64::max).sqrt()
    }

    /// The certified errors of the islands, and their residuals: of the impulses at hand, if they are
    /// within the aims, else of the best on the line.
    fn certify<const RESIDUALS: bool>(
        &mut self,
        velocities: &[Velocity<f32, L, A>],
        wide: &Wide<L, A>,
        prospective: &[Velocity<f32, L, A>],
        islands: &Islands,
        outcome: &mut SolveReport,
    ) {
        if self.memory.direct {
            self.certify_by::<RESIDUALS, false>(velocities, wide, prospective, islands, outcome);
            if is_within(self.errors.iter().copied(), &self.aims) {
                return;
            }
        }
        self.certify_by::<RESIDUALS, true>(velocities, wide, prospective, islands, outcome);
        self.memory.direct = is_within(self.scratch.errors_at_hand(), &self.aims);
    }

    /// The same of the best impulses on the `LINE`, or those at hand.
    fn certify_by<const RESIDUALS: bool, const LINE: bool>(
        &mut self,
        velocities: &[Velocity<f32, L, A>],
        wide: &Wide<L, A>,
        prospective: &[Velocity<f32, L, A>],
        islands: &Islands,
        outcome: &mut SolveReport,
    ) {
        let start = self.clock.now();
        let Self { scratch, errors, .. } = self;
        let certificates =
            wide.certify::<RESIDUALS, LINE>(velocities, prospective, islands, scratch);
        errors.clear();
        errors.extend(certificates.iter().map(Certificate::error));
        outcome.set_residuals(certificates);
        outcome.certifying += self.clock.since(start);
    }
}

fn is_within(mut errors: impl Iterator<Item = f64>, aims: &[f64]) -> bool {
    let mut aims = aims.iter();
    errors.all(|error| aims.next().is_some_and(|aim| error <= *aim))
}

/// Whether the last `due` of `made` iterations, which took an error from `before` to `error`, leave no hope
/// that at most `limit` more would take it below the tolerance.
fn is_hopeless(
    [before, error]: [f64; 2],
    [due, made]: [usize; 2],
    limit: usize,
    tolerance: f64,
) -> bool {
    if !error.is_finite() || made >= limit {
        return true;
    }
    let patience = (limit - IN_LANES) / 4;
    if made < TRIAL.max(patience) || before.is_infinite() {
        return false;
    }
    let rate = (error / before).ln() / due as f64;
    let missing = (tolerance / error).ln();
    let stuck = (4 * TRIAL).max(limit / 4);
    rate >= 0.0 && made > stuck || rate < 0.0 && missing / rate > limit as f64
}

/// Contacts on one body, at most, of a system that is written as matrices: each two of them make a block of W, so
/// the factor costs the cube of their number. Of a step of 28 s, with a body of 95 m in a heap, it was most.
const CROWD: usize = 128;

/// Whether a body that can be moved has more contacts than that.
fn is_crowded<const L: usize, const A: usize>(system: &System<f64, L, A>) -> bool {
    let mut counts = vec![0; system.velocities.len()];
    for manifold in &system.manifolds {
        for body in manifold.bodies {
            counts[body as usize] += manifold.points().len();
        }
    }
    let bodies = counts.iter().zip(&system.masses);
    bodies.into_iter().any(|(count, mass)| *count > CROWD && *mass != InverseMass::FIXED)
}

/// Solves an island by the last methods, apart and in `f64`, and puts its velocities and impulses back.
fn replace<const L: usize, const A: usize>(
    system: &mut System<f32, L, A>,
    prospective: &[Velocity<f32, L, A>],
    islands: &Islands,
    island: u32,
    goal: &Goal,
) {
    let mut part = SubSystem::default();
    part.clear(system);
    part.add_island(system, islands, island);
    for (velocity, &body) in part.system.velocities.iter_mut().zip(&part.bodies) {
        *velocity = prospective[body as usize].cast();
    }
    let methods = Method::IN_MATRICES;
    let methods = if is_crowded(&part.system) { &methods[..1] } else { methods };
    let (solution, _) = solve_by(methods, &mut part.system, goal);
    if solution.status == Status::BadInput {
        return;
    }
    for (velocity, &body) in part.system.velocities.iter().zip(&part.bodies) {
        if islands.of_body[body as usize] == island {
            system.velocities[body as usize] = velocity.cast();
        }
    }
    for (solved, index) in
        part.system.contacts.iter().zip(part.contacts(system).collect::<Vec<_>>())
    {
        system.contacts[index].impulse = solved.impulse.cast();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is on its way at this rate needs a thousand iterations: too many for a small island, not for a large
    /// one. What does not get nearer, or too slowly, is given up, by a large one later.
    #[test]
    fn a_large_island_may_take_more_iterations() {
        let slow = |made, limit| is_hopeless([1.0, 0.9], [16, made], limit, 1e-3);
        assert!(slow(60, 256) && !slow(60, 2000) && !slow(501, 2000));
        let slower = |made, limit| is_hopeless([1.0, 0.999], [16, made], limit, 1e-3);
        assert!(!slower(435, 2000) && slower(436, 2000));
        assert!(slow(2000, 2000) && !slow(1999, 2000));
        let stuck = |made, limit| is_hopeless([1.0, 1.0], [16, made], limit, 1e-3);
        assert!(!stuck(60, 256) && stuck(65, 256) && !stuck(65, 2000) && stuck(501, 2000));
        assert!(is_hopeless([1.0, f64::NAN], [1, 1], 2000, 1e-3));
    }

    /// The limit of an island is by the number of its bodies, if that is more than what any may take.
    #[test]
    fn islands_have_limits_by_their_bodies() {
        let mut system: System<f32, 2, 0> = System::new();
        let mut islands = Islands::default();
        for island in [0, 1] {
            for _ in 0..[3, 900][island] {
                system.add_body(Velocity::ZERO, crate::InverseMass::FIXED);
                islands.of_body.push(island as u32);
            }
        }
        islands.count = 2;
        let mut island_solver = IslandSolver::default();
        island_solver.start(&system, &islands);
        assert_eq!(island_solver.limits, [IN_LANES, 3600]);
    }
}
