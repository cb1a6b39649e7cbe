//! A ladder of methods: solves each island by stronger and stronger methods until its certificate
//! is good enough.
//!
//! Warm-started sweeps suffice for most islands in most steps, and cost least. Then come [`nncg`],
//! [`newton`] and, with the feature `assembled`, the proximal-point method. Each method starts from
//! the impulses of the one before, and has a budget that is small compared with the cost of the
//! next.

use std::time::Duration;

use crate::certificate::{Certificate, CertificateScratch};
use crate::island::Islands;
use crate::lanes::LaneSystem;
use crate::mechanism::Mechanisms;
use crate::part::SubSystem;
use crate::real::ln;
use crate::solution::{Goal, Solution, Status};
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
    /// All methods, in the order in which they are tried.
    pub const ALL: &[Self] = &[
        Self::Sweeps,
        Self::Nncg,
        Self::Newton,
        #[cfg(feature = "assembled")]
        Self::Proximal,
    ];

    /// The methods that factor a matrix, tried after those in lanes.
    const IN_MATRICES: &[Self] = Self::ALL.split_at(2).1;

    /// Returns its name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sweeps => "sweeps",
            Self::Nncg => "nncg",
            Self::Newton => "newton",
            #[cfg(feature = "assembled")]
            Self::Proximal => "proximal",
        }
    }

    /// Returns the number of iterations after which the next method is tried.
    const fn budget(self) -> usize {
        match self {
            Self::Sweeps => 8,
            Self::Nncg => 16,
            _ => usize::MAX,
        }
    }

    /// Returns true if every iterate keeps locks. What misses them pulls joints apart, however near it is
    /// by energy.
    const fn keeps_locks(self) -> bool {
        matches!(self, Self::Sweeps | Self::Nncg | Self::Newton)
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
            Self::Proximal => crate::proximal::solve_within(system, goal, MOST_PRODUCTS),
        }
    }
}

/// Solves a system with the first method that reaches the tolerance. Its velocities are the
/// prospective ones, and its impulses a guess.
///
/// `goal.budget` bounds the iterations of each method; only the methods that factor a matrix can
/// use all of it. On return the system holds the best velocities and impulses. The history is that
/// of all methods.
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
        let counts = done || method.keeps_locks() || system.joints.is_empty();
        if better && counts {
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

/// Statistics and errors of a solved system.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SolveReport {
    /// Number of islands.
    pub islands: usize,
    /// Iterations of [`nncg`], each over all islands that still need it.
    pub iterations: usize,
    /// Number of islands given to Newton's method.
    pub newton: usize,
    /// Time spent on certificates.
    pub certifying: Duration,
    /// Maxima over the examined contacts: residual of Coulomb's law
    /// ([`Certificate::natural_residual`]), fastest approach beyond a target
    /// ([`Certificate::approach_error`]) and cone violation ([`Certificate::cone`]). \[m/s\]
    pub residuals: [f64; 3],
    /// Sum of [`Certificate::complementarity`] over the examined contacts. \[J\]
    pub complementarity: f64,
    /// Number of islands beyond the tolerance.
    pub failed: usize,
    /// Largest certified error of an island. \[m/s\]
    pub error: f64,
    /// A body of that island.
    pub worst: Option<u32>,
}

impl SolveReport {
    /// Merges another report: adds up the work, and keeps the larger errors.
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

/// Smallest limit of [`nncg`] iterations in lanes before Newton's method takes over an island.
const IN_LANES: usize = 256;

/// Limit of the iterations of a large island, per body: factoring its matrix takes longer than that
/// many sweeps. Convergence is not judged for a quarter of the iterations beyond [`IN_LANES`],
/// because the bound of many contacts decreases in jumps.
const FOR_A_BODY: usize = 4;

/// Fraction of the tolerance at which the lanes stop. The remaining error moves the bodies and
/// enters the next system. \[1\]
const AIM: f64 = 1.0 / 7.0;

/// Largest fraction of the tolerance at which the lanes stop where an island has joints. At a third,
/// blocks that hang close to their edges gained energy. \[1\]
const AIM_OF_JOINTS: f64 = 0.25;

/// Fraction of the tolerance at which the lanes stop where an island is at rest. What remains drives
/// the slow modes of an island: at [`AIM`] a wall of ten rows swayed by 0.08 mm without end. \[1\]
const AIM_AT_REST: f64 = 1.0 / 70.0;

/// Fraction of the speed of an island at which the lanes stop, if that is larger and within the
/// tolerance: a moving island hides the remaining error. \[1\]
const OF_SPEED: f64 = 0.05;

/// Iterations between certificates, or a quarter of those so far if that is more. The interval is
/// extended as long as this many iterations halve the size of an iteration.
const LONGEST: usize = 16;

/// Iterations before their convergence rate is trusted.
const TRIAL: usize = 12;

/// A certificate is due when the predicted error is at most this fraction of the aim. \[1\]
const SURE: f64 = 0.9;

/// Least number of iterations of relaxing. \[1\]
const LEAST_RELAXED: usize = 7;

/// Experience of an [`IslandSolver`] from the systems so far, which steers the next solve.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SolverMemory {
    /// Certified error divided by the size of the last iteration before it, sqrt(|g|^2 / m). \[1\]
    pub ratio: f64,
    /// True if the current impulses sufficed for the certificate, without a search along the line.
    pub direct: bool,
}

impl Default for SolverMemory {
    fn default() -> Self {
        Self { ratio: 5.0, direct: true }
    }
}

/// Runs the ladder on a sequence of systems, those of the substeps of a simulation.
#[derive(Clone, Debug)]
pub struct IslandSolver<const L: usize, const A: usize> {
    /// Experience for the next system.
    pub memory: SolverMemory,
    /// What measures the time of certificates.
    pub clock: Clock,
    scratch: CertificateScratch<L, A>,
    done: Vec<bool>,
    /// True for each island with joints.
    jointed: Vec<bool>,
    /// True for each island that a blow passes through while it is relaxed.
    struck: Vec<bool>,
    /// Island of each mechanism, and whether it is still open.
    of_mechanisms: Vec<u32>,
    due: Vec<bool>,
    /// For each row of a joint, the impulse before the sweep, and the search direction p.
    before: Vec<f64>,
    directions: Vec<f64>,
    errors: Vec<f64>,
    /// Those of the certificate before.
    errors_before: Vec<f64>,
    /// Mass \[kg\] and mass-weighted root-mean-square speed \[m/s\] of each island at the last
    /// [`start`](Self::start).
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
            jointed: Vec::new(),
            struck: Vec::new(),
            of_mechanisms: Vec::new(),
            due: Vec::new(),
            before: Vec::new(),
            directions: Vec::new(),
            errors: Vec::new(),
            errors_before: Vec::new(),
            masses: Vec::new(),
            speeds: Vec::new(),
            aims: Vec::new(),
            limits: Vec::new(),
        }
    }
}

impl<const L: usize, const A: usize> IslandSolver<L, A> {
    /// Stores the masses of the bodies, and finds the speeds and iteration limits of the islands.
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

    /// Updates the masses of bodies that have turned.
    pub fn follow(&mut self, system: &System<f32, L, A>) {
        self.scratch.retake_masses(system);
    }

    /// Brings every island within the tolerance: all by [`nncg`] in lanes, then the remaining ones
    /// by Newton's method in `f64`. Each iteration ends with a visit of the mechanisms.
    ///
    /// `lanes` holds the contacts and `joints` the joints; `system.velocities` include their
    /// impulses, `prospective` do not. With `RESIDUALS` the report has residuals as well as errors.
    pub fn solve_islands<const RESIDUALS: bool>(
        &mut self,
        system: &mut System<f32, L, A>,
        (lanes, joints): (&mut LaneSystem<L, A>, &mut Mechanisms<L, A>),
        prospective: &[Velocity<f32, L, A>],
        islands: &Islands,
        goal: &Goal,
    ) -> SolveReport {
        joints.solve(&mut system.velocities);
        let mut outcome = SolveReport { islands: islands.count, ..SolveReport::default() };
        let beyond = |error: &f64| error.total_cmp(&goal.tolerance).is_gt();
        let velocities = &mut system.velocities;
        let constraints = (&mut *lanes, &mut *joints);
        self.in_lanes::<RESIDUALS>(
            velocities,
            constraints,
            prospective,
            islands,
            (goal, usize::MAX),
            &mut outcome,
        );
        if self.errors.iter().any(beyond) {
            lanes.unpack(system);
            // Rounding to `f32` afterwards must not take the error beyond the tolerance again.
            let finer = Goal { tolerance: AIM * goal.tolerance, ..*goal };
            for island in 0..islands.count {
                if beyond(&self.errors[island]) {
                    let least = self.errors[island];
                    replace((system, joints), prospective, islands, (island as u32, least), &finer);
                    outcome.newton += 1;
                }
            }
            lanes.take_impulses(system);
            let velocities = &system.velocities;
            self.certify::<RESIDUALS>(
                velocities,
                (lanes, joints),
                prospective,
                islands,
                &mut outcome,
            );
        }
        outcome.failed = self.errors.iter().filter(|error| beyond(error)).count();
        outcome.set_worst(&self.errors, islands);
        outcome
    }

    /// Brings islands within the tolerance by [`nncg`] in lanes alone, or as near as `goal.budget` iterations
    /// do. Returns their number. Arguments are those of [`solve_islands`](Self::solve_islands).
    pub fn iterate_islands(
        &mut self,
        system: &mut System<f32, L, A>,
        (lanes, joints): (&mut LaneSystem<L, A>, &mut Mechanisms<L, A>),
        prospective: &[Velocity<f32, L, A>],
        islands: &Islands,
        goal: &Goal,
    ) -> usize {
        let mut outcome = SolveReport::default();
        let (velocities, constraints) = (&mut system.velocities, (lanes, joints));
        let goal = (goal, goal.budget);
        self.in_lanes::<false>(velocities, constraints, prospective, islands, goal, &mut outcome);
        outcome.iterations
    }

    /// Relaxes the islands with joints by [`nncg`] with rigid contacts, until the size of an iteration,
    /// sqrt(|g|^2 / m), is within the tolerance, or for `goal.budget` iterations. Each ends with a visit of
    /// the mechanisms. The contacts have been [relaxed](crate::lanes::LaneBatch::relax) once. An
    /// island whose first iteration is larger than `blow` \[m/s\] is relaxed by a few sweeps alone: conjugate
    /// directions would load contacts with impulses that joints bear, and throw bodies when these break.
    pub fn relax(
        &mut self,
        velocities: &mut [Velocity<f32, L, A>],
        (lanes, joints): (&mut LaneSystem<L, A>, &mut Mechanisms<L, A>),
        islands: &Islands,
        (goal, blow): (&Goal, f64),
    ) {
        self.begin_lanes(joints, islands, goal);
        lanes.begin_conjugate();
        self.done.iter_mut().zip(&self.jointed).for_each(|(done, jointed)| *done = !jointed);
        self.struck.clear();
        self.struck.resize(islands.count, false);
        self.find_due();
        joints.batch().solve_those(self.due.iter().copied(), velocities);
        for made in 1..=goal.budget {
            if !self.done.contains(&false) {
                break;
            }
            self.extrapolate(joints, islands, lanes.betas());
            lanes.conjugate_rigid(velocities, &self.done);
            self.find_due();
            joints.batch().solve_those(self.due.iter().copied(), velocities);
            let sizes = lanes.gradients().iter().zip(&self.masses);
            let islands = self.done.iter_mut().zip(&mut self.struck);
            for ((done, struck), (&size, mass)) in islands.zip(sizes) {
                let size = f64::from(size);
                *struck |= made == 1 && size > mass * blow * blow;
                let is_small = size <= mass * goal.tolerance * goal.tolerance;
                *done |= made >= LEAST_RELAXED && (is_small || *struck);
            }
            lanes.forget_directions(&self.struck);
        }
    }

    /// Certifies a system as it is, with all residuals.
    pub fn examine(
        &mut self,
        velocities: &[Velocity<f32, L, A>],
        constraints: (&LaneSystem<L, A>, &Mechanisms<L, A>),
        prospective: &[Velocity<f32, L, A>],
        islands: &Islands,
    ) -> SolveReport {
        let mut outcome = SolveReport { islands: islands.count, ..SolveReport::default() };
        self.certify_by::<true, true>(velocities, constraints, prospective, islands, &mut outcome);
        outcome.set_worst(&self.errors, islands);
        outcome
    }

    /// Prepares for the methods in lanes: no island is done, and each has its aim.
    fn begin_lanes(&mut self, joints: &Mechanisms<L, A>, islands: &Islands, goal: &Goal) {
        self.done.clear();
        self.done.resize(islands.count, false);
        self.jointed.clear();
        self.jointed.resize(islands.count, false);
        for joint in &joints.joints {
            if let Some(jointed) = self.jointed.get_mut(islands.of_pair(joint.bodies) as usize) {
                *jointed = true;
            }
        }
        let pairs = joints.pairs();
        self.of_mechanisms.clear();
        self.of_mechanisms.extend(pairs.map(|bodies| islands.of_pair(bodies)));
        for of_rows in [&mut self.before, &mut self.directions] {
            of_rows.clear();
            of_rows.resize(joints.axes.len(), 0.0);
        }
        self.errors.clear();
        self.errors.resize(islands.count, f64::INFINITY);
        let most = goal.tolerance;
        self.aims.clear();
        let islands_of = self.speeds.iter().zip(&self.jointed);
        // The error of a light limb is many times that of its island, and opens its joints.
        self.aims.extend(islands_of.map(|(speed, &jointed)| {
            let largest = if jointed { AIM_OF_JOINTS * most } else { most };
            (OF_SPEED * speed).max(AIM_AT_REST * most).min(largest)
        }));
    }

    /// Runs the methods in lanes on each island, with at most `most` iterations, and leaves the certified errors of the islands in `errors`.
    fn in_lanes<const RESIDUALS: bool>(
        &mut self,
        velocities: &mut [Velocity<f32, L, A>],
        (lanes, joints): (&mut LaneSystem<L, A>, &mut Mechanisms<L, A>),
        prospective: &[Velocity<f32, L, A>],
        islands: &Islands,
        (goal, most): (&Goal, usize),
        outcome: &mut SolveReport,
    ) {
        self.begin_lanes(joints, islands, goal);
        lanes.begin_conjugate();
        while self.done.contains(&false) {
            let longest = LONGEST.max(outcome.iterations / 4).min(most);
            let (due, size) = self.iterate(velocities, (lanes, joints), islands, longest);
            outcome.iterations += due;
            self.errors_before.clone_from(&self.errors);
            self.certify::<RESIDUALS>(velocities, (lanes, joints), prospective, islands, outcome);
            // The largest ratio of an error to its aim.
            let mut worst = 0.0f64;
            let errors =
                self.errors_before.iter().zip(&self.errors).zip(self.aims.iter().zip(&self.limits));
            let gradients = lanes.gradients().iter().chain(std::iter::repeat(&0.0));
            let open = self.done.iter_mut().zip(self.jointed.iter().zip(gradients));
            for ((done, (&jointed, &size)), ((&before, &error), (&aim, &limit))) in open.zip(errors)
            {
                if !*done {
                    let made = [due, outcome.iterations];
                    worst = worst.max(error / aim);
                    // Joints without contacts are solved by their one visit.
                    let stands = jointed && size == 0.0;
                    let hopeless =
                        made[1] >= most || is_hopeless([before, error], made, limit, aim);
                    *done = error <= aim || stands || hopeless;
                }
            }
            let ratio = worst / size;
            if ratio.is_finite() {
                self.memory.ratio = ratio;
            }
        }
    }

    /// Iterates until the size of an iteration predicts an error within the aims, or until
    /// `longest` iterations fail to halve that size. Returns the number of iterations, and the
    /// [size](Self::largest) of the last.
    fn iterate(
        &mut self,
        velocities: &mut [Velocity<f32, L, A>],
        (lanes, joints): (&mut LaneSystem<L, A>, &mut Mechanisms<L, A>),
        islands: &Islands,
        longest: usize,
    ) -> (usize, f64) {
        let (mut made, mut size_before) = (0usize, 0.0);
        self.find_due();
        let has_joints = self.due.contains(&true);
        loop {
            if has_joints {
                self.extrapolate(joints, islands, lanes.betas());
            }
            lanes.conjugate(velocities, &self.done);
            if has_joints {
                joints.batch().solve_those(self.due.iter().copied(), velocities);
            }
            let size = self.largest(lanes.gradients());
            made += 1;
            if self.memory.ratio * size <= SURE {
                return (made, size);
            }
            // For a body of infinite mass `size` is infinite or NaN, and the comparison fails.
            if made == 1 || made.is_multiple_of(longest) && size < 0.5 * size_before {
                size_before = size;
            } else if made.is_multiple_of(longest) {
                return (made, size);
            }
        }
    }

    /// Finds the mechanisms of islands that are not done.
    fn find_due(&mut self) {
        let open = |island: &u32| self.done.get(*island as usize).is_some_and(|done| !done);
        self.due.clear();
        self.due.extend(self.of_mechanisms.iter().map(open));
    }

    /// Moves the impulses of the rows along their search directions: r <- r + beta p. The velocities
    /// follow in [`LaneSystem::conjugate`]: a visit of the mechanisms is part of the sweep before it.
    fn extrapolate(&mut self, joints: &mut Mechanisms<L, A>, islands: &Islands, betas: &[f32]) {
        let mut rows = joints.axes.iter_mut().zip(self.before.iter_mut().zip(&mut self.directions));
        for joint in &joints.joints {
            let island = islands.of_pair(joint.bodies) as usize;
            let beta = match self.done.get(island) {
                Some(false) => f64::from(betas[island]),
                _ => 0.0,
            };
            for (axis, (before, p)) in rows.by_ref().take(joint.count as usize) {
                *p = nncg::next_row_direction(axis.impulse, *before, *p, beta);
                axis.impulse += *p * beta;
                *before = axis.impulse;
            }
        }
    }

    /// Returns the largest sqrt(|g|^2 / m) of an island for these |g|^2 \[J\], relative to its
    /// aim. \[1\]
    fn largest(&self, gradients: &[f32]) -> f64 {
        let islands = gradients.iter().zip(&self.masses).zip(&self.aims);
        let sizes = islands.map(|((&size, mass), aim)| f64::from(size) / (mass * aim * aim));
        sizes.fold(0.0, f64::max).sqrt()
    }

    /// Computes the certified errors and residuals of the islands: for the current impulses if that
    /// puts them within the aims, else for the best impulses on the line.
    fn certify<const RESIDUALS: bool>(
        &mut self,
        velocities: &[Velocity<f32, L, A>],
        constraints: (&LaneSystem<L, A>, &Mechanisms<L, A>),
        prospective: &[Velocity<f32, L, A>],
        islands: &Islands,
        outcome: &mut SolveReport,
    ) {
        if self.memory.direct {
            self.certify_by::<RESIDUALS, false>(
                velocities,
                constraints,
                prospective,
                islands,
                outcome,
            );
            if is_within(self.errors.iter().copied(), &self.aims) {
                return;
            }
        }
        self.certify_by::<RESIDUALS, true>(velocities, constraints, prospective, islands, outcome);
        self.memory.direct = is_within(self.scratch.errors_at_hand(), &self.aims);
    }

    /// Computes the certificates for the best impulses on the line (`LINE`), or for the current
    /// ones.
    fn certify_by<const RESIDUALS: bool, const LINE: bool>(
        &mut self,
        velocities: &[Velocity<f32, L, A>],
        (lanes, joints): (&LaneSystem<L, A>, &Mechanisms<L, A>),
        prospective: &[Velocity<f32, L, A>],
        islands: &Islands,
        outcome: &mut SolveReport,
    ) {
        let start = self.clock.now();
        let Self { scratch, errors, .. } = self;
        scratch.add_joints::<LINE>(joints, velocities, islands);
        let certificates =
            lanes.certify::<RESIDUALS, LINE>(velocities, prospective, islands, scratch);
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

/// Returns true if at most `limit` further iterations are not expected to take the error below the
/// tolerance. The last `due` of `made` iterations took it from `before` to `error`.
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
    let rate = ln(error / before) / due as f64;
    let missing = ln(tolerance / error);
    let stuck = (4 * TRIAL).max(limit / 4);
    rate >= 0.0 && made > stuck || rate < 0.0 && missing / rate > limit as f64
}

/// Largest number of products of blocks in a factorization of the proximal-point method. It takes some
/// dozens of these, a thousand products take 30 us.
#[cfg(feature = "assembled")]
const MOST_PRODUCTS: f64 = 1e8;

/// Largest number of contacts on one body for which the proximal-point method is tried. Each pair
/// of them makes a block of W, so its factorization costs the cube of their number: with a body of
/// 95 m in a heap it took most of a step of 28 s.
const CROWD: usize = 128;

/// Returns true if a movable body has more than [`CROWD`] contacts.
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

/// Solves one island in `f64` by the methods that factor a matrix. Copies its velocities and
/// impulses back if their error is below that of the present ones, which it has with its index.
fn replace<const L: usize, const A: usize>(
    (system, joints): (&mut System<f32, L, A>, &mut Mechanisms<L, A>),
    prospective: &[Velocity<f32, L, A>],
    islands: &Islands,
    (island, present): (u32, f64),
    goal: &Goal,
) {
    let mut part = SubSystem::default();
    part.clear(system);
    part.add_island(system, islands, island);
    part.add_mechanisms(system, joints, islands, island);
    for (velocity, &body) in part.system.velocities.iter_mut().zip(&part.bodies) {
        *velocity = prospective[body as usize].cast();
    }
    let methods = Method::IN_MATRICES;
    let newton_only = is_crowded(&part.system);
    let methods = if newton_only { &methods[..1] } else { methods };
    let (solution, _) = solve_by(methods, &mut part.system, goal);
    // Newton's method may stall far from the solution. NaN is never below.
    let is_better = solution.certificate.error() < present;
    if solution.status == Status::BadInput || !is_better {
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
    let Mechanisms { joints, axes, .. } = joints;
    for (solved, index) in part.system.axes.iter().zip(part.axes(joints)) {
        axes[index].impulse = solved.impulse;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks the limits by rate. At rates that need a thousand iterations a small island is given
    /// up, a large one is not. An island without progress, or with too little, is given up; a large
    /// one later.
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

    /// Checks that an island's limit grows with its bodies, and is at least [`IN_LANES`].
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
