//! [`Course`]: bodies and their contacts on their way through the substeps of a part of a step.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use drystone_solver::team::{Divide, Team};
use drystone_solver::wide::{Landing, Renewing, WideBatch};
use drystone_solver::{InverseMass, Repair, Vector, Velocity};

use crate::bodies::{Bodies, Given, InMotion, Turn};
use crate::geometry::Geometry;
use crate::report::{Clock, Stage};

/// After so many substeps contacts are asked again what they give to the velocities
/// ([`Course::push`]): what rounding adds to it would add up.
const ASK_AGAIN: u32 = 4;

/// What it takes to go through substeps.
#[derive(Clone, Copy)]
pub(crate) struct Terms<const L: usize> {
    /// Length of a substep. \[s\]
    pub(crate) h: f32,
    pub(crate) substeps: u32,
    /// Sweeps over all contacts per substep.
    pub(crate) iterations: u32,
    /// \[m/s^2\]
    pub(crate) gravity: Vector<f32, L>,
    pub(crate) repair: Repair<f32>,
    /// epsilon over A_ii + epsilon of contacts. \[1\]
    pub(crate) softness: f32,
}

/// The bodies of a batch, and their contacts.
pub(crate) struct Course<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) contacts: WideBatch<'a, L, A>,
    /// Of these bodies, as what follows.
    pub(crate) velocities: &'a mut [Velocity<f32, L, A>],
    /// Those of the substep without the impulses of its contacts.
    pub(crate) prospective: &'a mut [Velocity<f32, L, A>],
    /// What each has moved since the part began.
    pub(crate) displacements: &'a mut [Velocity<f32, L, A>],
    /// What contacts gave it in the last warm start.
    pub(crate) pushes: &'a mut [Velocity<f32, L, A>],
    pub(crate) poses: &'a mut [G::Pose],
    pub(crate) turns: &'a mut [Turn<A>],
    pub(crate) turned: &'a mut [bool],
    /// M^-1.
    pub(crate) masses: &'a mut [InverseMass<f32, L, A>],
    /// Of all bodies.
    pub(crate) given: Given<'a, L, A>,
    pub(crate) team: &'a Team,
}

impl<'a, G: Geometry<L, A>, const L: usize, const A: usize> Course<'a, G, L, A> {
    pub(crate) fn new(
        bodies: &'a mut Bodies<G, L, A>,
        masses: &'a mut [InverseMass<f32, L, A>],
        [velocities, prospective, displacements, pushes]: [&'a mut [Velocity<f32, L, A>]; 4],
        contacts: WideBatch<'a, L, A>,
        team: &'a Team,
    ) -> Self {
        let InMotion { given, poses, turns, turned } = bodies.in_motion();
        Self {
            contacts,
            velocities,
            prospective,
            displacements,
            pushes,
            poses,
            turns,
            turned,
            masses,
            given,
            team,
        }
    }

    /// The bodies.
    pub(crate) fn bodies(&self) -> Range<usize> {
        self.contacts.bodies()
    }

    /// v += M^-1 J^T gamma of the substep before, from v*, which it keeps. Contacts are asked, too, if J
    /// has been `renewed` since. To v* belong the torques of resistance. Returns whether anything turns.
    pub(crate) fn warm_start(&mut self, substep: u32, renewed: bool, terms: &Terms<L>) -> bool {
        let resists = self.contacts.has_surfaces();
        if resists {
            self.contacts.apply_resistance(self.velocities);
        }
        if renewed || resists || substep.is_multiple_of(ASK_AGAIN) {
            self.prospective.copy_from_slice(self.velocities);
            self.contacts.apply_impulses(self.velocities);
        } else {
            self.push();
        }
        self.lead(terms)
    }

    /// Sweeps towards the targets; whether bodies turn.
    pub(crate) fn solve(&mut self, terms: &Terms<L>, substep: u32, turning: bool) {
        let Self { contacts, velocities, displacements, .. } = self;
        contacts.sweep_normals_to_targets(velocities, displacements, turning, &terms.repair);
        for _ in 1..terms.iterations {
            contacts.sweep_normals(velocities);
        }
        self.run_belts(terms, substep);
    }

    /// Adds belts to targets that have just been set.
    pub(crate) fn run_belts(&mut self, terms: &Terms<L>, substep: u32) {
        if self.contacts.has_surfaces() {
            self.contacts.run_belts(terms.h * substep as f32, terms.repair.hold);
        }
    }

    /// Renews J where bodies have turned; whether any is another.
    pub(crate) fn renew(&mut self, terms: &Terms<L>) -> bool {
        let Self { contacts, velocities, displacements, masses, turned, .. } = self;
        let bodies = Renewing { velocities, displacements, masses, turned };
        contacts.renew(bodies, [terms.h, terms.softness])
    }

    /// A sweep of rigid contacts: takes the velocity of overlap repair out again, and stops what has landed.
    pub(crate) fn relax(&mut self, renewed: bool, terms: &Terms<L>) {
        let landing = Landing { displacements: self.displacements, dt: terms.h };
        self.contacts.relax(self.velocities, renewed, Some(landing));
        if self.contacts.has_surfaces() {
            self.contacts.resist(self.velocities);
        }
    }

    /// What contacts hand to the next step.
    pub(crate) fn trace(&mut self, terms: &Terms<L>) {
        if self.contacts.has_surfaces() {
            self.contacts.carry_belts(terms.h * terms.substeps as f32);
        }
        self.contacts.trace(self.displacements, terms.repair.hold);
    }

    /// Through all substeps.
    fn run(&mut self, terms: &Terms<L>, clock: &mut Clock) {
        let mut renewed = false;
        for substep in 0..terms.substeps {
            self.predict(terms);
            clock.lap(Stage::Predict);
            let turning = self.warm_start(substep, renewed, terms);
            clock.lap(Stage::WarmStart);
            self.solve(terms, substep, turning);
            clock.lap(Stage::Solve);
            let turned = self.advance(terms);
            clock.lap(Stage::Advance);
            renewed = turned && self.renew(terms);
            self.relax(renewed, terms);
            clock.lap(Stage::Relax);
        }
        self.trace(terms);
        clock.lap(Stage::Remember);
    }

    /// Batch after batch through all substeps; each by one member of the team, if none is much of the whole.
    pub(crate) fn run_by_batch(self, terms: &Terms<L>, clock: &mut Clock) {
        let (team, runs) = (self.team, self.contacts.runs());
        let all = Mutex::new(clock.another());
        team.for_each(runs > 1, self.divide(runs), |run| {
            let (mut own, batches) = (clock.another(), run.count());
            run.divide(batches).for_each(|mut batch| batch.run(terms, &mut own));
            all.lock().unwrap_or_else(PoisonError::into_inner).join(&own);
        });
        clock.lap_as(&all.into_inner().unwrap_or_else(PoisonError::into_inner));
    }
}

/// Into batches.
impl<G: Geometry<L, A>, const L: usize, const A: usize> Divide for Course<'_, G, L, A> {
    fn count(&self) -> usize {
        self.contacts.count()
    }

    fn split_at(self, count: usize) -> (Self, Self) {
        let (contacts, later_contacts) = self.contacts.split_at(count);
        let count = contacts.bodies().len();
        let (velocities, later_velocities) = self.velocities.split_at_mut(count);
        let (prospective, later_prospective) = self.prospective.split_at_mut(count);
        let (displacements, later_displacements) = self.displacements.split_at_mut(count);
        let (poses, later_poses) = self.poses.split_at_mut(count);
        let (turns, later_turns) = self.turns.split_at_mut(count);
        let (turned, later_turned) = self.turned.split_at_mut(count);
        let (pushes, later_pushes) = self.pushes.split_at_mut(count);
        let (masses, later_masses) = self.masses.split_at_mut(count);
        let first = Self {
            contacts,
            velocities,
            prospective,
            displacements,
            pushes,
            poses,
            turns,
            turned,
            masses,
            ..self
        };
        let others = Self {
            contacts: later_contacts,
            velocities: later_velocities,
            prospective: later_prospective,
            displacements: later_displacements,
            poses: later_poses,
            turns: later_turns,
            turned: later_turned,
            pushes: later_pushes,
            masses: later_masses,
            ..self
        };
        (first, others)
    }
}
