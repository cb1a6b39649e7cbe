//! [`SubstepContext`]: bodies and their contacts on their way through the substeps of a part of a step.

use std::sync::{Mutex, PoisonError};

use drystone_solver::thread_pool::Divide;
use drystone_solver::wide::{Landing, MovedBodies, WideBatch};

use crate::geometry::Geometry;
use crate::motion::{Advanced, MovingBodies, SubstepParams};
use crate::report::{Stage, StageTimer};

/// After so many substeps contacts are asked again what they give to the velocities
/// ([`MovingBodies::push`]): what rounding adds to it would add up.
const REFRESH_INTERVAL: u32 = 4;

/// Surfaces approach each other at this many times [`Advanced::fastest`] at most: 2^(3/2), and some for the
/// bend of their paths. \[1\]
const APPROACH: f32 = 3.5;

/// The bodies of a batch, and their contacts.
pub(crate) struct SubstepContext<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) contacts: WideBatch<'a, L, A>,
    pub(crate) bodies: MovingBodies<'a, G, L, A>,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> SubstepContext<'_, G, L, A> {
    /// v += M^-1 J^T gamma of the substep before, from v*, which it keeps. Contacts are asked, too, if J
    /// has been `renewed` since. To v* belong the torques of resistance. Returns whether anything turns.
    pub(crate) fn warm_start(
        &mut self,
        substep: u32,
        renewed: bool,
        params: &SubstepParams<L>,
    ) -> bool {
        let resists = self.contacts.has_surfaces();
        if resists {
            self.contacts.apply_resistance(self.bodies.velocities);
        }
        if renewed || resists || substep.is_multiple_of(REFRESH_INTERVAL) {
            self.bodies.prospective.copy_from_slice(self.bodies.velocities);
            self.contacts.apply_impulses(self.bodies.velocities);
        } else {
            self.bodies.push();
        }
        self.bodies.lead(params)
    }

    /// Sweeps towards the targets; whether bodies turn.
    pub(crate) fn solve(&mut self, params: &SubstepParams<L>, substep: u32, turning: bool) {
        let Self { contacts, bodies: MovingBodies { velocities, displacements, .. } } = self;
        contacts.sweep_normals_to_targets(velocities, displacements, turning, &params.repair);
        for _ in 1..params.iterations {
            contacts.sweep_normals(velocities);
        }
        self.run_belts(params, substep);
    }

    /// Adds belts to targets that have just been set.
    pub(crate) fn run_belts(&mut self, params: &SubstepParams<L>, substep: u32) {
        if self.contacts.has_surfaces() {
            self.contacts.run_belts(params.h * substep as f32, params.repair.hold);
        }
    }

    /// Renews J where bodies have turned; whether any is another.
    pub(crate) fn renew(&mut self, params: &SubstepParams<L>) -> bool {
        let Self { contacts, bodies } = self;
        let MovingBodies { velocities, displacements, masses, turned, .. } = bodies;
        let bodies = MovedBodies { velocities, displacements, masses, turned };
        contacts.renew(bodies, [params.h, params.softness])
    }

    /// A sweep of rigid contacts: takes the velocity of overlap repair out again, and stops what has landed.
    pub(crate) fn relax(&mut self, renewed: bool, fastest: f32, params: &SubstepParams<L>) {
        let MovingBodies { velocities, displacements, .. } = &mut self.bodies;
        let landing = Landing { displacements, dt: params.h, approach: APPROACH * fastest };
        self.contacts.relax(velocities, renewed, Some(landing));
        if self.contacts.has_surfaces() {
            self.contacts.resist(velocities);
        }
    }

    /// What contacts hand to the next step.
    pub(crate) fn trace(&mut self, params: &SubstepParams<L>) {
        if self.contacts.has_surfaces() {
            self.contacts.carry_belts(params.h * params.substeps as f32);
        }
        self.contacts.trace(self.bodies.displacements, params.repair.hold);
    }

    /// Through all substeps.
    fn run(&mut self, params: &SubstepParams<L>, clock: &mut StageTimer) {
        let mut renewed = false;
        for substep in 0..params.substeps {
            self.bodies.predict(params);
            clock.lap(Stage::Predict);
            let turning = self.warm_start(substep, renewed, params);
            clock.lap(Stage::WarmStart);
            self.solve(params, substep, turning);
            clock.lap(Stage::Solve);
            let Advanced { turned, fastest } = self.bodies.advance(params);
            clock.lap(Stage::Advance);
            renewed = turned && self.renew(params);
            self.relax(renewed, fastest, params);
            clock.lap(Stage::Relax);
        }
        self.trace(params);
        clock.lap(Stage::Remember);
    }

    /// Batch after batch through all substeps; each by one member of the pool, if none is much of the whole.
    pub(crate) fn run_by_batch(self, params: &SubstepParams<L>, clock: &mut StageTimer) {
        let (pool, runs) = (self.bodies.pool, self.contacts.runs());
        let all = Mutex::new(clock.another());
        pool.for_each(runs > 1, self.divide(runs), |run| {
            let (mut own, batches) = (clock.another(), run.count());
            run.divide(batches).for_each(|mut batch| batch.run(params, &mut own));
            all.lock().unwrap_or_else(PoisonError::into_inner).join(&own);
        });
        clock.lap_as(&all.into_inner().unwrap_or_else(PoisonError::into_inner));
    }
}

/// Into batches.
impl<G: Geometry<L, A>, const L: usize, const A: usize> Divide for SubstepContext<'_, G, L, A> {
    fn count(&self) -> usize {
        self.contacts.count()
    }

    fn split_at(self, count: usize) -> (Self, Self) {
        let (contacts, later_contacts) = self.contacts.split_at(count);
        let (bodies, later_bodies) = self.bodies.split_at(contacts.bodies().len());
        let first = Self { contacts, bodies };
        (first, Self { contacts: later_contacts, bodies: later_bodies })
    }
}
