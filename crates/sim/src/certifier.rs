//! Solving to a tolerance: islands, contact stiffness, certificates and jams.

use drystone_solver::certificate::CertificateScratch;
use drystone_solver::island::{self, Islands};
use drystone_solver::jam::{self, Jam};
use drystone_solver::ladder::{IslandSolver, SolveReport};
use drystone_solver::lanes::LaneSystem;
use drystone_solver::mechanism::Mechanisms;
use drystone_solver::solution::Goal;
use drystone_solver::{InverseMass, Manifold, System, Velocity};
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

use crate::settings::StepSettings;

/// A contact or a joint that misses its target by more than this may be jammed. Bodies at rest on
/// soft contacts miss theirs by less. \[m/s\]
pub(crate) const MISSED: f64 = 0.1;

/// Largest certified error, and largest number of iterations, where mechanisms are solved to a tolerance in a
/// world without one. \[m/s, 1\]
const BALANCED: f64 = 0.01;
const MOST_BALANCING: usize = 64;

/// Size of an iteration at which relaxing contacts and joints ends, as a part of the tolerance and at most, and
/// largest number of iterations. Bodies that stand would keep a velocity of many times that. \[1, m/s, 1\]
const RELAXED: f64 = 0.1;
const MOST_RELAXED: f64 = 2e-4;
const RELAX_ROUNDS: usize = 64;

/// Size of an iteration of relaxing beyond which it is a blow: what gravity gives in a substep, and at least
/// this. \[m/s\]
const LEAST_BLOW: f64 = 0.02;

/// Largest number of steps between searches for jams that find none.
const LONGEST_WAIT: u32 = 64;

/// Islands, and the solver that brings them within the tolerance.
#[derive(Default)]
pub(crate) struct Certifier<const L: usize, const A: usize> {
    /// Those that are solved to a tolerance; if they are only [some](Self::keep_islands), `all` has all.
    islands: Islands,
    all: Islands,
    are_some: bool,
    pub(crate) island_solver: IslandSolver<L, A>,
    loads: Vec<Load>,
    /// Compliances of [`Stiffness`].
    compliances: Vec<[f32; 2]>,
    pub(crate) jam_schedule: JamSchedule,
    /// Largest error of a substep of sweeps so far. To [name](Self::name_worst) its body costs more than a
    /// step, so only those beyond get a name. \[m/s\]
    pub(crate) worst_of_sweeps: f64,
    /// Two bodies with one contact manifold or joint, and memory for their residual.
    pair: System<f64, L, A>,
    scratch: CertificateScratch<L, A>,
}

/// Schedule of the searches for jams: the interval doubles each time that there are none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub(crate) struct JamSchedule {
    left: u32,
    whole: u32,
    /// Number of searches so far. Each begins with another island.
    searches: usize,
}

impl JamSchedule {
    /// Returns true if the interval is over. Counts a step.
    fn is_over(&mut self) -> bool {
        let over = self.left == 0;
        self.left = self.left.saturating_sub(1);
        over
    }

    /// Begins the interval after a search. `in_vain` is true if the search found no jam.
    fn begin(&mut self, in_vain: bool) {
        self.searches += 1;
        self.whole = if in_vain { (2 * self.whole).clamp(1, LONGEST_WAIT) } else { 0 };
        self.left = self.whole;
    }
}

/// Largest sag of an island, as a fraction of the thickness of its thinnest body. \[1\]
const SHALLOW: f32 = 1.0 / 64.0;

/// Weight and supports of an island.
#[derive(Clone, Copy)]
struct Load {
    /// Weight of its bodies. \[N\]
    weight: f32,
    /// Thickness of its thinnest body. \[m\]
    thickness: f32,
    /// Number of manifolds with fixed bodies.
    supports: f32,
}

impl Load {
    const NONE: Self = Self { weight: 0.0, thickness: f32::INFINITY, supports: 0.0 };
}

/// Upper bounds on the compliance of contacts.
///
/// Contacts under an island penetrate by the setting `sag`, or by a fraction of its thinnest body
/// if that is less. The weight W \[N\] of the island on its n manifolds with fixed bodies gives the
/// stiffness k = W / (n sag). A spring in implicit form that repairs the fraction c of its depth
/// per substep h has epsilon = c / (h^2 k).
#[derive(Clone, Copy, Default)]
pub(crate) struct Stiffness<'a> {
    /// By body: largest epsilon of its contacts, in this part of the step and in the part before.
    /// If empty, there are no bounds. \[1/kg\]
    compliances: &'a [[f32; 2]],
}

impl Stiffness<'_> {
    fn of(&self, bodies: [u32; 2]) -> [f32; 2] {
        let of = |body: u32| self.compliances.get(body as usize).copied().unwrap_or(AS_THEY_COME);
        let [[a, a_before], [b, b_before]] = bodies.map(of);
        [a.min(b), a_before.min(b_before)]
    }

    /// Returns the largest epsilon of contacts between these bodies. \[1/kg\]
    pub(crate) fn compliance(&self, bodies: [u32; 2]) -> f32 {
        self.of(bodies)[0]
    }

    /// Returns true if any bound may differ from that of the part before.
    pub(crate) fn changes(&self) -> bool {
        !self.compliances.is_empty()
    }

    /// Returns true if the bound for these bodies differs from that of the part before.
    pub(crate) fn is_new(&self, bodies: [u32; 2]) -> bool {
        let [now, before] = self.of(bodies);
        now != before
    }
}

/// No bound, now and in the part before.
const AS_THEY_COME: [f32; 2] = [f32::INFINITY; 2];

impl<const L: usize, const A: usize> Certifier<L, A> {
    /// Returns bounds on the compliance of the contacts of these body `pairs` in substeps of
    /// `h` \[s\], by the weights of their islands. It is for contacts that are solved to a
    /// tolerance. `of` returns the weight \[N\] and the thickness \[m\] of a body.
    pub(crate) fn stiffness(
        &mut self,
        pairs: impl Iterator<Item = [u32; 2]>,
        of: impl Fn(usize) -> [f32; 2],
        settings: &StepSettings,
        h: f32,
    ) -> Stiffness<'_> {
        let Self { islands, loads, compliances, .. } = self;
        let of_body = &islands.of_body;
        loads.clear();
        loads.resize(islands.count, Load::NONE);
        for (body, &island) in of_body.iter().enumerate() {
            if let Some(load) = loads.get_mut(island as usize) {
                let [weight, thickness] = of(body);
                load.weight += weight;
                load.thickness = load.thickness.min(thickness);
            }
        }
        for bodies in pairs {
            if bodies.iter().any(|&body| of_body[body as usize] == island::NONE)
                && let Some(load) = loads.get_mut(islands.of_pair(bodies) as usize)
            {
                load.supports += 1.0;
            }
        }
        // c / h^2.
        let give = settings.repair / (h * h);
        compliances.resize(of_body.len(), AS_THEY_COME);
        for (own, &island) in compliances.iter_mut().zip(of_body) {
            let load = loads.get(island as usize);
            let now = load.map(|load| {
                let sag = settings.sag.min(SHALLOW * load.thickness);
                give * sag / (load.weight / load.supports.max(1.0))
            });
            *own = [now.unwrap_or(f32::INFINITY), own[0]];
        }
        Stiffness { compliances }
    }

    /// Returns no bounds, for contacts that are not solved to a tolerance.
    pub(crate) fn no_stiffness(&mut self) -> Stiffness<'_> {
        self.compliances.iter_mut().for_each(|own| *own = [f32::INFINITY, own[0]]);
        if self.compliances.iter().all(|own| *own == AS_THEY_COME) {
            self.compliances.clear();
        }
        Stiffness { compliances: &self.compliances }
    }

    /// Returns the contacts whose targets no velocities can meet. After a search that finds none,
    /// it skips some steps. `approach_error` is the largest speed by which a contact missed its
    /// target. \[m/s\]
    pub(crate) fn jams(
        &mut self,
        system: &mut System<f32, L, A>,
        lanes: &LaneSystem<L, A>,
        approach_error: f64,
    ) -> Vec<Jam> {
        if approach_error <= MISSED || !self.jam_schedule.is_over() {
            return Vec::new();
        }
        lanes.unpack(system);
        // Relaxing needs the islands of the part.
        let mut islands = Islands::default();
        let jams = jam::find(system, &mut islands, MISSED, self.jam_schedule.searches);
        self.jam_schedule.begin(jams.is_empty());
        jams
    }

    /// Returns the contacts and joints whose targets no velocities can meet, in a system that is not
    /// relaxed yet. After a search that finds none, it skips some steps.
    pub(crate) fn joint_jams(&mut self, system: &System<f64, L, A>) -> Vec<Jam> {
        if !self.jam_schedule.is_over() {
            return Vec::new();
        }
        // The certificates need the islands of the part.
        let mut islands = Islands::default();
        let jams = jam::find(system, &mut islands, MISSED, self.jam_schedule.searches);
        self.jam_schedule.begin(jams.is_empty());
        jams
    }

    /// Finds the islands of a part of a step, from the pairs of bodies that touch.
    pub(crate) fn find_islands(
        &mut self,
        masses: &[InverseMass<f32, L, A>],
        pairs: impl Iterator<Item = [u32; 2]>,
    ) {
        self.are_some = false;
        self.islands.join(masses, pairs);
    }

    /// Keeps the islands of these bodies. Others are not solved to a tolerance.
    pub(crate) fn keep_islands(&mut self, bodies: impl Iterator<Item = u32>) {
        self.all.clone_from(&self.islands);
        self.are_some = true;
        self.islands.keep(bodies);
    }

    /// Prepares the solver for all substeps of a part of a step. The system has been packed before.
    pub(crate) fn start(&mut self, system: &System<f32, L, A>, lanes: &mut LaneSystem<L, A>) {
        lanes.set_islands(&self.islands);
        self.island_solver.start(system, &self.islands);
    }

    /// Solves a substep to the tolerance, from the impulses of the previous substep. If
    /// `with_residuals`, the report includes all residuals.
    pub(crate) fn refine(
        &mut self,
        system: &mut System<f32, L, A>,
        constraints: (&mut LaneSystem<L, A>, &mut Mechanisms<L, A>),
        prospective: &[Velocity<f32, L, A>],
        settings: &StepSettings,
        with_residuals: bool,
    ) -> SolveReport {
        let goal = Goal {
            tolerance: f64::from(settings.tolerance),
            budget: settings.newton_iterations as usize,
        };
        let islands = &self.islands;
        if with_residuals {
            self.island_solver.solve_islands::<true>(
                system,
                constraints,
                prospective,
                islands,
                &goal,
            )
        } else {
            self.island_solver.solve_islands::<false>(
                system,
                constraints,
                prospective,
                islands,
                &goal,
            )
        }
    }

    /// Solves the islands that are kept to [`BALANCED`], with at most [`MOST_BALANCING`] iterations. Returns
    /// their number.
    pub(crate) fn balance(
        &mut self,
        system: &mut System<f32, L, A>,
        constraints: (&mut LaneSystem<L, A>, &mut Mechanisms<L, A>),
        prospective: &[Velocity<f32, L, A>],
    ) -> usize {
        let goal = Goal { tolerance: BALANCED, budget: MOST_BALANCING };
        self.island_solver.iterate_islands(system, constraints, prospective, &self.islands, &goal)
    }

    /// Relaxes the islands with joints, of those that are solved to a tolerance, to [`RELAXED`] times it.
    /// `fall` is what gravity gives in a substep. \[m/s\]
    pub(crate) fn relax(
        &mut self,
        system: &mut System<f32, L, A>,
        constraints: (&mut LaneSystem<L, A>, &mut Mechanisms<L, A>),
        settings: &StepSettings,
        fall: f32,
    ) {
        let tolerance = if self.are_some { BALANCED } else { settings.tolerance.into() };
        let tolerance = (RELAXED * tolerance).min(MOST_RELAXED);
        let goal = Goal { tolerance, budget: RELAX_ROUNDS };
        let until = (&goal, LEAST_BLOW.max(fall.into()));
        self.island_solver.relax(&mut system.velocities, constraints, &self.islands, until);
    }

    /// Finds the body that a report on the worst island should name: one at the contact or joint
    /// of that island with the largest residual. The solver names the first body of the island.
    ///
    /// `system` holds the contacts as they were solved. Of two movable bodies it takes the lighter.
    pub(crate) fn name_worst(
        &mut self,
        outcome: &mut SolveReport,
        system: &System<f32, L, A>,
        joints: &Mechanisms<L, A>,
    ) {
        let Self { islands, all, are_some, pair, scratch, .. } = self;
        let islands = if *are_some { all } else { islands };
        let of_body = |body: u32| islands.of_body.get(body as usize).copied();
        let Some(island) = outcome.worst.and_then(of_body) else { return };
        let mut largest = 0.0f64;
        let mut keep = |residual: f64, bodies: [u32; 2]| {
            if residual.total_cmp(&largest).is_gt() {
                largest = residual;
                let own = bodies.into_iter().filter(|&body| of_body(body) == Some(island));
                let mass = |body: u32| system.masses[body as usize].linear;
                let lighter = own.reduce(|a, b| if mass(b) > mass(a) { b } else { a });
                outcome.worst = lighter.or(outcome.worst);
            }
        };
        for manifold in &system.manifolds {
            let bodies = manifold.bodies;
            if islands.of_pair(bodies) == island {
                take_pair(pair, system, bodies);
                let contacts = &system.contacts[manifold.points()];
                pair.contacts.extend(contacts.iter().map(|contact| contact.cast()));
                pair.manifolds.push(Manifold { bodies: [0, 1], first: 0, ..manifold.cast() });
                keep(residual(pair, scratch), bodies);
            }
        }
        for joint in &joints.joints {
            if islands.of_pair(joint.bodies) == island {
                take_pair(pair, system, joint.bodies);
                pair.add_joint([0, 1], &joints.axes[joint.axes()]);
                keep(residual(pair, scratch), joint.bodies);
            }
        }
    }

    /// Returns the certificate of a substep, with its present velocities and impulses.
    pub(crate) fn certify_sweeps(
        &mut self,
        velocities: &[Velocity<f32, L, A>],
        (lanes, joints): (&mut LaneSystem<L, A>, &Mechanisms<L, A>),
        prospective: &[Velocity<f32, L, A>],
    ) -> SolveReport {
        let Self { islands, all, island_solver, .. } = self;
        if !self.are_some {
            return island_solver.examine(velocities, (lanes, joints), prospective, islands);
        }
        lanes.set_islands(all);
        let report = island_solver.examine(velocities, (lanes, joints), prospective, all);
        lanes.set_islands(islands);
        report
    }
}

/// Returns the residual of the only manifold or joint of a system.
fn residual<const L: usize, const A: usize>(
    pair: &System<f64, L, A>,
    scratch: &mut CertificateScratch<L, A>,
) -> f64 {
    scratch.set_masses(pair);
    scratch.certify(pair, &pair.velocities).natural_residual
}

/// Makes `pair` a system of two bodies of another, without contacts and joints.
fn take_pair<const L: usize, const A: usize>(
    pair: &mut System<f64, L, A>,
    of: &System<f32, L, A>,
    bodies: [u32; 2],
) {
    let bodies = bodies.map(|body| body as usize);
    pair.velocities.clear();
    pair.velocities.extend(bodies.map(|body| of.velocities[body].cast()));
    pair.masses.clear();
    pair.masses.extend(bodies.map(|body| of.masses[body].cast()));
    pair.manifolds.clear();
    pair.contacts.clear();
    pair.joints.clear();
    pair.axes.clear();
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Searches follow after 1, 2, 4 steps and so on, up to the longest interval. While there are
    /// jams, each step has a search.
    #[test]
    fn searches_without_jams_become_rare() {
        let mut jam_schedule = JamSchedule::default();
        let mut searches = Vec::new();
        for step in 0..400 {
            if jam_schedule.is_over() {
                searches.push(step);
                jam_schedule.begin(true);
            }
        }
        assert_eq!(searches[..8], [0, 2, 5, 10, 19, 36, 69, 134]);
        let mut jam_schedule = JamSchedule::default();
        jam_schedule.begin(true);
        jam_schedule.begin(true);
        assert_eq!([0; 4].map(|_| jam_schedule.is_over()), [false, false, true, true]);
        jam_schedule.begin(false);
        assert_eq!([0; 2].map(|_| jam_schedule.is_over()), [true, true]);
    }
}
