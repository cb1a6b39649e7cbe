//! Substeps of a part of a step. They run in one of two ways with the same stages.
//!
//! [`SubstepContext::run_by_batch`] takes one batch of islands after the other through all
//! substeps, while the batch is in the CPU cache. [`World::take_substeps`] takes all bodies
//! together through one substep after the other. It does so for stages that need the whole system:
//! impacts, certificates, ledgers and saved systems.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use drystone_solver::Contact;
use drystone_solver::ladder::SolveReport;
use drystone_solver::lanes::{Landing, LaneBatch, Lead, MovedBodies};
use drystone_solver::restitution::{self, ImpactSettings};
use drystone_solver::thread_pool::Divide;

use crate::bodies::Bodies;
use crate::cache::Pair;
use crate::geometry::Geometry;
use crate::joint_batch::JointBatch;
use crate::ledger::LedgerBuilder;
use crate::motion::{Advanced, MovingBodies, SubstepParams};
use crate::report::{Stage, StageTimer, StepReport};
use crate::saved::SavedSystem;
use crate::solving::ConstraintSolver;
use crate::step_scratch::StepScratch;
use crate::world::World;

/// Plan for the substeps of a part of a step.
pub(crate) struct PartPlan<const L: usize> {
    pub(crate) params: SubstepParams<L>,
    /// True if each substep is solved to the tolerance.
    pub(crate) solving: bool,
    /// True if some mechanisms are solved to a tolerance with their contacts, and the rest by sweeps
    /// ([`balance`](crate::balance)).
    pub(crate) balancing: bool,
    /// Index of the substep that gets a certificate with all residuals.
    pub(crate) certified_substep: Option<u32>,
    /// True if each substep accounts for its energy.
    pub(crate) ledger: bool,
    /// Parameters of impacts, if any contact may bounce.
    pub(crate) collisions: Option<ImpactSettings<f32>>,
    /// True if all bodies go through one substep together before the next begins. If false, each
    /// batch goes through all substeps by itself.
    pub(crate) whole_system: bool,
    /// True if the part ends after a substep in which joints break: bodies that these kept from
    /// colliding need contacts.
    pub(crate) may_end: bool,
    /// True if a substep in which joints turn too far ends the part before it: those after it may be
    /// shorter. By batch, the part is then taken back, and all bodies take it together.
    pub(crate) may_shorten: bool,
    /// Rate at which joints turn in a substep that has been taken back. \[rad/s\]
    pub(crate) turn_rate: f64,
}

impl<const L: usize> PartPlan<L> {
    /// Returns true if all or some of the system is solved to a tolerance.
    pub(crate) fn refines(&self) -> bool {
        self.solving || self.balancing
    }
}

/// Number of substeps after which M^-1 J^T gamma is recomputed from the contacts
/// ([`MovingBodies::reapply_gains`]). In between it comes from the previous substep, and its
/// rounding errors add up.
const REFRESH_INTERVAL: u32 = 4;

/// Factor of [`Advanced::fastest`] that bounds the approach speed of two surfaces: 2^(3/2), plus a
/// margin for the curvature of their paths. \[1\]
const APPROACH: f32 = 3.5;

/// Largest number of rounds in which joints break within a substep: each loads others. \[1\]
const SNAP_ROUNDS: usize = 32;

/// Largest number of rounds in which contacts and joints take turns with a few sweeps.
const MOST_ROUNDS: usize = 32;

/// Largest number of times that an impact goes on through joints to other contacts.
const MOST_PASSES: usize = 16;

/// The bodies, contacts and joints of a batch.
pub(crate) struct SubstepContext<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) contacts: LaneBatch<'a, L, A>,
    pub(crate) joints: JointBatch<'a, L, A>,
    pub(crate) bodies: MovingBodies<'a, G, L, A>,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> SubstepContext<'_, G, L, A> {
    /// Adds v += M^-1 J^T gamma with the impulses of the previous substep, and keeps v*. Recomputes
    /// J^T gamma from the contacts if J has been `renewed` since, if surfaces resist, if there are joints,
    /// and every [`REFRESH_INTERVAL`] substeps. The old J^T gamma has the rounding errors of joints, too; a
    /// solve to a tolerance takes them out. v* includes the torques of resistance. Returns true if any
    /// body rotates.
    pub(crate) fn warm_start(&mut self, substep: u32, renewed: bool, plan: &PartPlan<L>) -> bool {
        let resists = self.contacts.has_surfaces();
        if resists {
            self.contacts.apply_resistance(self.bodies.velocities);
        }
        let again = renewed || resists || !plan.solving && !self.joints.is_idle();
        if again || substep.is_multiple_of(REFRESH_INTERVAL) {
            self.bodies.prospective.copy_from_slice(self.bodies.velocities);
            self.contacts.apply_impulses(self.bodies.velocities);
        } else {
            self.bodies.reapply_gains();
        }
        let params = &plan.params;
        let turning = self.bodies.offset_displacements(params);
        self.joints.offset_displacements(&mut self.bodies, params);
        turning
    }

    /// Sweeps over the normals towards the targets. `turning` is true if any body rotates.
    pub(crate) fn solve(&mut self, params: &SubstepParams<L>, substep: u32, turning: bool) {
        let Self { contacts, bodies: MovingBodies { velocities, displacements, .. }, .. } = self;
        contacts.sweep_normals_to_targets(velocities, displacements, turning, &params.repair);
        for _ in 1..params.iterations {
            contacts.sweep_normals(velocities);
        }
        self.run_belts(params, substep);
    }

    /// Adds the velocities of belts to targets that have just been set.
    pub(crate) fn run_belts(&mut self, params: &SubstepParams<L>, substep: u32) {
        if self.contacts.has_surfaces() {
            self.contacts.run_belts(params.h * substep as f32, params.repair.stick_rate);
        }
    }

    /// Updates J for bodies that have rotated. Returns true if any J has changed.
    pub(crate) fn renew(&mut self, params: &SubstepParams<L>) -> bool {
        let Self { contacts, bodies, .. } = self;
        let MovingBodies { velocities, displacements, masses, turned, .. } = bodies;
        let bodies = MovedBodies { velocities, displacements, masses, turned };
        contacts.renew(bodies, [params.h, params.softness])
    }

    /// Solves the joints after the sweeps over contacts. They take turns where much hangs on a body that
    /// strikes another one: contacts would bear it later, and throw it back.
    fn solve_joints(&mut self, h: f32) {
        self.sweep_and_snap(false);
        for _ in 0..MOST_ROUNDS {
            if !self.joints.mark_unsettled(&mut self.bodies) {
                break;
            }
            let MovingBodies { velocities, unsettled, .. } = &mut self.bodies;
            self.contacts.sweep_normals_of(velocities, unsettled);
            self.joints.solve_changed(velocities);
        }
        self.joints.note_sinking(&mut self.bodies, h);
    }

    /// Sets the targets of joints again for the paths that contacts leave, and tames locks that add energy.
    fn end_solve(&mut self, may_shorten: bool) {
        self.joints.aim_again(&mut self.bodies, true);
        if self.joints.tame(&self.bodies, may_shorten) {
            self.joints.solve_aiming(self.bodies.velocities);
        }
    }

    /// Solves the joints, and again with the contacts as long as joints break. Begins with the
    /// contacts if they are not `swept`.
    fn sweep_and_snap(&mut self, mut sweeps: bool) {
        for _ in 0..=SNAP_ROUNDS {
            if sweeps {
                self.contacts.sweep_normals(self.bodies.velocities);
            }
            self.joints.solve(self.bodies.velocities);
            sweeps = self.joints.snap(&mut self.bodies, false);
            if !sweeps {
                break;
            }
        }
    }

    /// Takes out the velocities of repair, of contacts and of joints, and stops bodies that have landed:
    /// sweeps over rigid contacts.
    fn relax(
        &mut self,
        (renewed, fastest): (bool, f32),
        params: &SubstepParams<L>,
        timer: &mut StageTimer,
    ) {
        self.joints.end_springs(&mut self.bodies);
        self.joints.begin_relaxing();
        // Contacts see bodies that joints have stopped.
        self.joints.solve_touching(self.bodies.velocities);
        timer.lap(Stage::Joints);
        let MovingBodies { velocities, displacements, .. } = &mut self.bodies;
        let landing = Landing { displacements, dt: params.h, approach: APPROACH * fastest };
        self.contacts.relax(velocities, renewed, Some(landing));
        if self.contacts.has_surfaces() {
            self.contacts.resist(velocities);
        }
        timer.lap(Stage::Relax);
    }

    /// Ends the relaxing with the joints, which may break.
    fn end_relaxing(&mut self, timer: &mut StageTimer) {
        if !self.joints.is_idle() {
            for _ in 0..=SNAP_ROUNDS {
                self.joints.solve(self.bodies.velocities);
                if !self.joints.snap(&mut self.bodies, true) {
                    break;
                }
            }
            self.joints.keep_relaxed(&mut self.bodies);
        }
        timer.lap(Stage::Joints);
    }

    /// Writes the data that contacts pass to the next step to the cache.
    pub(crate) fn store_impulses(&mut self, params: &SubstepParams<L>) {
        if self.contacts.has_surfaces() {
            self.contacts.carry_belts(params.h * params.substeps as f32);
        }
        self.contacts.trace(self.bodies.displacements, params.repair.stick_rate);
    }

    /// Takes the batch through all substeps, unless one is `taken_back` in it or in another batch.
    fn run(&mut self, plan: &PartPlan<L>, taken_back: &AtomicBool, clock: &mut StageTimer) {
        let mut renewed = false;
        for substep in 0..plan.params.substeps {
            if !self.substep(plan, (substep, &mut renewed), clock) {
                taken_back.store(true, Ordering::Relaxed);
            }
            if plan.may_shorten && taken_back.load(Ordering::Relaxed) {
                return;
            }
        }
        // Otherwise the part may still be taken back.
        if !plan.may_shorten {
            self.store_impulses(&plan.params);
            clock.lap(Stage::Remember);
        }
    }

    /// Takes the batch through one substep. Returns false if joints would turn too far: the substep is to
    /// be taken back.
    fn substep(
        &mut self,
        plan: &PartPlan<L>,
        (substep, renewed): (u32, &mut bool),
        clock: &mut StageTimer,
    ) -> bool {
        let params = &plan.params;
        self.bodies.predict(params);
        clock.lap(Stage::Predict);
        self.joints.begin_springs(&mut self.bodies);
        let turning = self.warm_start(substep, *renewed, plan);
        clock.lap(Stage::WarmStart);
        self.joints.warm_start(&mut self.bodies);
        clock.lap(Stage::Joints);
        self.solve(params, substep, turning);
        clock.lap(Stage::Solve);
        if !self.joints.is_idle() {
            self.solve_joints(plan.params.h);
            self.end_solve(plan.may_shorten);
            if plan.may_shorten && self.joints.turn_rate(&self.bodies, params).is_some() {
                return false;
            }
            self.joints.keep_solved(&mut self.bodies);
            clock.lap(Stage::Joints);
        }
        let Advanced { mut turned, fastest } = self.bodies.advance(params);
        turned |= self.joints.repair(&mut self.bodies, params).is_some();
        clock.lap(Stage::Advance);
        *renewed = turned && self.renew(params);
        self.joints.renew(&mut self.bodies, params);
        self.relax((*renewed, fastest), params, clock);
        self.end_relaxing(clock);
        true
    }

    /// Takes each batch through all substeps. Each thread takes a run of batches, unless one thread
    /// solves all ([`LaneBatch::runs`]). Returns false if the part is to be taken back.
    fn run_by_batch(self, plan: &PartPlan<L>, clock: &mut StageTimer) -> bool {
        let (pool, joints) = (self.bodies.pool, &self.joints);
        let runs = self.contacts.runs(|bodies| joints.work(bodies));
        let (all, taken_back) = (Mutex::new(clock.another()), AtomicBool::new(false));
        pool.for_each(runs > 1, self.divide(runs), |run| {
            let (mut own, batches) = (clock.another(), run.count());
            run.divide(batches).for_each(|mut batch| batch.run(plan, &taken_back, &mut own));
            all.lock().unwrap_or_else(PoisonError::into_inner).join(&own);
        });
        clock.lap_as(&all.into_inner().unwrap_or_else(PoisonError::into_inner));
        !taken_back.into_inner()
    }
}

/// Splits into batches.
impl<G: Geometry<L, A>, const L: usize, const A: usize> Divide for SubstepContext<'_, G, L, A> {
    fn count(&self) -> usize {
        self.contacts.count()
    }

    fn split_at(self, count: usize) -> (Self, Self) {
        let (contacts, later_contacts) = self.contacts.split_at(count);
        let (bodies, later_bodies) = self.bodies.split_at(contacts.bodies().len());
        let (joints, later_joints) = self.joints.split_at(later_bodies.first);
        let first = Self { contacts, joints, bodies };
        (first, Self { contacts: later_contacts, joints: later_joints, bodies: later_bodies })
    }
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Takes the substeps of a part, and writes the data of contacts for the next step to the
    /// cache. Where joints break the part may end early: the plan then has fewer substeps. Returns false
    /// if bodies must take the part together, and none is taken.
    pub(crate) fn take_substeps(
        &mut self,
        plan: &mut PartPlan<L>,
        timer: &mut StageTimer,
        report: &mut StepReport,
    ) -> bool {
        if plan.whole_system {
            let (mut renewed, mut substep) = (false, 0);
            while substep < plan.params.substeps {
                self.substep(plan, substep, &mut renewed, timer, report);
                substep += 1;
            }
            self.context().store_impulses(&plan.params);
            if self.execution.recording {
                self.record(|contact| contact.impact);
            }
            self.record_pairs();
            timer.lap(Stage::Remember);
        } else {
            if plan.may_shorten {
                self.keep_part();
            }
            if !self.context().run_by_batch(plan, timer) {
                return false;
            }
            if plan.may_shorten {
                self.context().store_impulses(&plan.params);
                timer.lap(Stage::Remember);
            }
        }
        self.solver.joints.end_part();
        let params = &plan.params;
        let ConstraintSolver { lanes, surfaces, .. } = &mut self.solver;
        surfaces.take_back(&self.colliders, &self.contacts.pairs, lanes);
        let sweeps = if plan.solving { 1 } else { 1 + params.iterations };
        report.sweeps += (params.substeps * sweeps) as usize;
        true
    }

    /// Returns all bodies and their contacts as one context.
    pub(crate) fn context(&mut self) -> SubstepContext<'_, G, L, A> {
        let StepScratch { prospective, displacements, standing_gains, start, unsettled, .. } =
            &mut self.scratch;
        let ConstraintSolver { lanes, joints, .. } = &mut self.solver;
        let contacts = lanes.whole(&mut self.contacts.cache.impulses);
        let of_bodies = [prospective, displacements, standing_gains].map(Vec::as_mut_slice);
        let start = start.each_mut().map(Vec::as_mut_slice);
        let pool = &self.execution.pool;
        let bodies = MovingBodies::new(&mut self.bodies, of_bodies, (start, unsettled), pool);
        SubstepContext { contacts, joints: joints.batch(), bodies }
    }

    /// Computes J of the joints at the places of the bodies, for substeps with these parameters.
    pub(crate) fn renew_joints(&mut self, params: &SubstepParams<L>) {
        let SubstepContext { mut joints, mut bodies, .. } = self.context();
        joints.renew(&mut bodies, params);
    }

    /// Takes all bodies through one substep: forces, impacts, contacts, motion, and the relaxing
    /// sweep over rigid contacts. Includes all options of the plan. Without any it equals a substep
    /// of [`SubstepContext::run_by_batch`].
    fn substep(
        &mut self,
        plan: &mut PartPlan<L>,
        substep: u32,
        renewed: &mut bool,
        timer: &mut StageTimer,
        report: &mut StepReport,
    ) {
        if !self.begin_substep(plan, substep, *renewed, timer, report) {
            return;
        }
        let with_residuals = plan.certified_substep == Some(substep);
        let params = &plan.params;
        if with_residuals {
            if !self.find_joint_jams(report) {
                self.find_jams(report);
            }
            timer.lap(Stage::Certify);
        }
        if plan.ledger {
            self.account(|ledger, solver, _| ledger.record_solution(&solver.system));
            self.scratch.ledger.record_joints(self.solver.joints.ledger_rows());
        }
        let mut context = self.context();
        context.joints.keep_solved(&mut context.bodies);
        let Advanced { mut turned, fastest } = context.bodies.advance(params);
        let lifted = context.joints.repair(&mut context.bodies, params);
        turned |= lifted.is_some();
        timer.lap(Stage::Advance);
        if plan.ledger {
            self.scratch.ledger.record_motion(&self.bodies.velocities);
            self.scratch.ledger.record_repair(lifted.unwrap_or(0.0));
        }
        *renewed = turned && self.context().renew(params);
        self.renew_joints(params);
        if (turned || !self.solver.joints.is_idle())
            && (plan.refines() || plan.certified_substep.is_some())
        {
            self.follow_masses();
        }
        if plan.refines() && self.solver.joints.touch() {
            self.solver.lanes.follow();
        }
        self.context().relax((*renewed, fastest), params, timer);
        self.relax_exactly(plan, timer);
        self.context().end_relaxing(timer);
        if plan.ledger {
            self.end_ledger(params.h);
        }
        if self.execution.recording {
            self.record(|contact| contact.impulse[0]);
        }
        timer.lap(Stage::Relax);
    }

    /// Relaxes contacts and joints in turn, where these are solved to a tolerance.
    fn relax_exactly(&mut self, plan: &PartPlan<L>, timer: &mut StageTimer) {
        if plan.refines() && self.solver.joints.touch() {
            let (settings, fall) = (&self.settings, plan.params.gravity.length() * plan.params.h);
            self.solver.with_system(&mut self.bodies, |solver, _| {
                let ConstraintSolver { lanes, joints, certifier, system, .. } = solver;
                certifier.relax(system, (lanes, &mut joints.mechanisms), settings, fall);
            });
            timer.lap(Stage::Relax);
        }
    }

    /// Ends the ledger of a substep of `h` \[s\].
    fn end_ledger(&mut self, h: f32) {
        let (joints, gravity) = (&self.solver.joints, self.gravity);
        self.scratch.ledger.record_joints(joints.spring_rows().chain(joints.ledger_rows()));
        self.account(|ledger, solver, bodies| {
            let ConstraintSolver { lanes, surfaces, system, .. } = solver;
            surfaces.note(lanes);
            ledger.end(bodies, gravity, (system, &surfaces.done), h);
        });
    }

    /// Begins a substep: forces, impacts and the solve. Returns false if it has been taken back
    /// ([`JointBatch::turn_rate`]).
    fn begin_substep(
        &mut self,
        plan: &mut PartPlan<L>,
        substep: u32,
        renewed: bool,
        timer: &mut StageTimer,
        report: &mut StepReport,
    ) -> bool {
        if plan.may_shorten {
            self.context().bodies.keep_start();
        }
        let (collisions, broken) = (report.collisions, self.solver.joints.snapped());
        let leads = plan.refines() && self.solver.joints.touch();
        if leads {
            let StepScratch { displacements, offsets, before, .. } = &mut self.scratch;
            offsets.clone_from(displacements);
            before.clone_from(&self.bodies.velocities);
        }
        self.accelerate(plan, renewed, timer, report);
        let mut context = self.context();
        context.joints.begin_springs(&mut context.bodies);
        let turning = context.warm_start(substep, renewed, plan);
        if leads {
            let StepScratch { displacements, offsets, .. } = &mut self.scratch;
            offsets.iter_mut().zip(displacements).for_each(|(own, now)| *own = *now - *own);
        }
        timer.lap(Stage::WarmStart);
        let SubstepContext { mut joints, mut bodies, .. } = self.context();
        joints.warm_start(&mut bodies);
        if self.solver.joints.are_stiffened() {
            self.follow_masses();
        }
        timer.lap(Stage::Joints);
        self.set_targets(plan, substep, turning);
        timer.lap(Stage::WarmStart);
        let with_residuals = plan.certified_substep == Some(substep);
        self.solve(plan, (substep, turning), with_residuals, timer, report);
        // Bounces and breaks are not undone.
        if self.solver.joints.snapped() > broken {
            if plan.may_end {
                plan.params.substeps = substep + 1;
            }
        } else if plan.may_shorten
            && report.collisions == collisions
            && let SubstepContext { mut joints, mut bodies, .. } = self.context()
            && let Some(rate) = joints.turn_rate(&bodies, &plan.params)
        {
            joints.unstiffen(&mut bodies);
            bodies.restore_start();
            (plan.turn_rate, plan.params.substeps) = (rate, substep);
            return false;
        }
        true
    }

    /// Solves contacts and joints, by sweeps or to the tolerance. `turning` is true if any body
    /// rotates.
    fn solve(
        &mut self,
        plan: &PartPlan<L>,
        (substep, turning): (u32, bool),
        with_residuals: bool,
        timer: &mut StageTimer,
        report: &mut StepReport,
    ) {
        if !plan.solving {
            if plan.balancing {
                // Their targets have been set.
                let SubstepContext { mut contacts, bodies, .. } = self.context();
                for _ in 0..plan.params.iterations {
                    contacts.sweep_normals(bodies.velocities);
                }
            } else {
                self.context().solve(&plan.params, substep, turning);
            }
            timer.lap(Stage::Solve);
            self.context().solve_joints(plan.params.h);
            timer.lap(Stage::Joints);
            if plan.balancing {
                report.sweeps += self.balance(timer);
            }
            self.context().end_solve(plan.may_shorten);
            timer.lap(Stage::Joints);
            if with_residuals {
                self.certify_sweeps(timer, report);
            }
            return;
        }
        if plan.solving && self.solver.joints.may_break() {
            self.context().sweep_and_snap(true);
            timer.lap(Stage::Joints);
        }
        loop {
            self.refine(with_residuals, timer, report);
            let SubstepContext { mut joints, mut bodies, .. } = self.context();
            if !joints.aim_again(&mut bodies, false) {
                break;
            }
        }
        let SubstepContext { mut joints, bodies, .. } = self.context();
        if joints.tame(&bodies, plan.may_shorten) {
            self.refine(with_residuals, timer, report);
        }
    }

    /// Changes the velocities by forces and impacts.
    fn accelerate(
        &mut self,
        plan: &PartPlan<L>,
        renewed: bool,
        timer: &mut StageTimer,
        report: &mut StepReport,
    ) {
        if plan.ledger {
            self.scratch.ledger.start(&self.bodies.velocities);
        }
        if plan.collisions.is_some() {
            self.update_rotated_masses(plan.ledger);
            self.scratch.force_gains.clone_from(&self.bodies.velocities);
        }
        self.context().bodies.predict(&plan.params);
        timer.lap(Stage::Predict);
        if let Some(collisions) = &plan.collisions {
            if renewed {
                self.unpack();
            }
            report.collisions += self.resolve_impacts(plan, collisions);
            timer.lap(Stage::Impact);
        }
    }

    /// Sets the targets of the contacts where the sweep does not: for a tolerance, or for a system
    /// that is saved here.
    fn set_targets(&mut self, plan: &PartPlan<L>, substep: u32, turning: bool) {
        let params = &plan.params;
        let saving = self.execution.saving && substep + 1 == params.substeps;
        if plan.refines() || saving {
            let velocities = turning.then_some(&self.bodies.velocities[..]);
            self.solver.lanes.set_targets(&self.scratch.displacements, velocities, &params.repair);
            self.context().run_belts(params, substep);
        }
        if plan.refines() && self.solver.joints.touch() {
            let StepScratch { displacements, offsets, before: velocities, .. } = &self.scratch;
            let (joined, repair) = (&self.bodies.is_exact, params.repair);
            self.solver.lanes.lead(&Lead { displacements, offsets, velocities, joined, repair });
        }
        if saving {
            self.save(params.h);
        }
    }

    /// Solves the contacts to the tolerance; with all residuals if `with_residuals`.
    fn refine(&mut self, with_residuals: bool, timer: &mut StageTimer, report: &mut StepReport) {
        let (settings, prospective) = (&self.settings, &self.scratch.prospective);
        let outcome = self.solver.with_system(&mut self.bodies, |solver, _| {
            let ConstraintSolver { lanes, joints, certifier, system, .. } = solver;
            let constraints = (lanes, &mut joints.mechanisms);
            certifier.refine(system, constraints, prospective, settings, with_residuals)
        });
        report.sweeps += outcome.iterations;
        let failed = outcome.failed > 0;
        self.report_solve(outcome, failed, timer, report);
    }

    /// Solves the mechanisms that sink, with their contacts. Returns the number of sweeps.
    fn balance(&mut self, timer: &mut StageTimer) -> usize {
        let prospective = &self.scratch.prospective;
        let sweeps = self.solver.with_system(&mut self.bodies, |solver, _| {
            let ConstraintSolver { lanes, joints, certifier, system, .. } = solver;
            certifier.balance(system, (lanes, &mut joints.mechanisms), prospective)
        });
        timer.lap(Stage::Solve);
        sweeps
    }

    /// Certifies the velocities as the sweeps left them.
    fn certify_sweeps(&mut self, timer: &mut StageTimer, report: &mut StepReport) {
        let ConstraintSolver { lanes, joints, certifier, .. } = &mut self.solver;
        let (prospective, constraints) = (&self.scratch.prospective, (lanes, &joints.mechanisms));
        let outcome = certifier.certify_sweeps(&self.bodies.velocities, constraints, prospective);
        let known = &mut certifier.worst_of_sweeps;
        let is_worst = outcome.error.total_cmp(known).is_gt();
        if outcome.error.is_finite() {
            *known = known.max(outcome.error);
        }
        self.report_solve(outcome, is_worst, timer, report);
    }

    /// Adds the outcome of a substep to the report. It names the body at fault if the substep may be
    /// out of tolerance and is the worst so far.
    fn report_solve(
        &mut self,
        mut outcome: SolveReport,
        may_be_off: bool,
        timer: &mut StageTimer,
        report: &mut StepReport,
    ) {
        let known = report.certified.map_or(0.0, |of| of.error);
        if may_be_off && outcome.error.total_cmp(&known).is_gt() {
            self.solver.with_system(&mut self.bodies, |solver, _| {
                let ConstraintSolver { lanes, joints, certifier, system, .. } = solver;
                lanes.unpack(system);
                certifier.name_worst(&mut outcome, system, &joints.mechanisms);
            });
        }
        report.join(&outcome, timer);
    }

    /// Looks for contacts that are jammed, if the certificate of the substep gives a reason.
    fn find_jams(&mut self, report: &mut StepReport) {
        let approach_error = report.certified.map_or(0.0, |of| of.residuals[1]);
        report.jams = self.solver.with_system(&mut self.bodies, |solver, _| {
            let ConstraintSolver { lanes, certifier, system, .. } = solver;
            certifier.jams(system, lanes, approach_error)
        });
    }

    /// Books energies in the ledger, with the contacts as they are in the lanes.
    fn account(
        &mut self,
        book: impl FnOnce(&mut LedgerBuilder<L, A>, &mut ConstraintSolver<L, A>, &Bodies<G, L, A>),
    ) {
        self.unpack();
        let ledger = &mut self.scratch.ledger;
        self.solver.with_system(&mut self.bodies, |solver, bodies| book(ledger, solver, bodies));
    }

    /// Resolves the impacts at the start of a substep. Returns their number.
    fn resolve_impacts(&mut self, plan: &PartPlan<L>, collisions: &ImpactSettings<f32>) -> usize {
        let StepScratch { ledger, displacements, force_gains, .. } = &mut self.scratch;
        for (gain, velocity) in force_gains.iter_mut().zip(&self.bodies.velocities) {
            *gain = *velocity - *gain;
        }
        let count = self.solver.with_system(&mut self.bodies, |solver, _| {
            let ConstraintSolver { lanes, joints, impacts, system, .. } = solver;
            if plan.ledger {
                ledger.record_impacts(0, &system.velocities);
            }
            system.set_targets(displacements, &plan.params.repair);
            let mut count = 0;
            for _ in 0..MOST_PASSES {
                let own =
                    restitution::collide(system, displacements, force_gains, collisions, impacts);
                count += own;
                if own == 0 || joints.is_idle() {
                    break;
                }
                joints.batch().pass_impact(&mut system.velocities);
            }
            lanes.take_impacts(system);
            if plan.ledger {
                ledger.record_impacts(1, &system.velocities);
            }
            count
        });
        if count > 0 {
            for (body, spin) in self.bodies.spin_states.iter_mut().enumerate() {
                spin.had_impact |= self.solver.impacts.is_struck(body);
            }
        }
        count
    }

    /// Adds impulses of the contacts to those of the part: of a substep, or of the impacts. \[N s\]
    fn record(&mut self, of: impl Fn(&Contact<f32, L>) -> f32) {
        self.unpack();
        self.scratch.impulses.add(&self.solver.system, of);
    }

    /// Adds the recorded impulses of a part to those of the pairs.
    fn record_pairs(&mut self) {
        let StepScratch { impulses, displacements, .. } = &mut self.scratch;
        if impulses.manifolds.is_empty() {
            return;
        }
        let (view, frames) = (self.contacts.cache.view(), &self.bodies.frames);
        let touching = |pair: &&Pair| !pair.is_sleeping && pair.count > 0;
        for pair in self.contacts.pairs.iter().filter(touching) {
            // A body that bounces has left the place; the one that moved less is nearer to it.
            let [moved_a, moved_b] = pair.bodies.map(|body| displacements[body as usize].linear);
            let is_a = moved_a.length() < moved_b.length();
            let (body, moved) = if is_a { (0, moved_a) } else { (1, moved_b) };
            let frame = &frames[pair.bodies[body] as usize];
            let points = view.of(pair.manifolds()).iter().flat_map(|manifold| {
                let points = manifold.points().zip(view.points_of(manifold));
                points.map(|(index, point)| {
                    (index, frame.point(if is_a { point.on_a } else { point.on_b }) + moved)
                })
            });
            impulses.add_pair([pair.colliders, pair.bodies], pair.manifolds(), points);
        }
        impulses.manifolds.clear();
        impulses.contacts.clear();
    }

    /// Updates M^-1 of the bodies that precess to their present poses. Slow rotations do not update
    /// it, and an impact with that of an earlier pose would create energy.
    fn update_rotated_masses(&mut self, ledger: bool) {
        let bodies = &mut self.bodies;
        for body in 0..bodies.poses.len() {
            if bodies.turned[body] && bodies.precession[body].rate > 0.0 {
                let moments = bodies.inertia[body].inverse_moments;
                bodies.inverse_masses[body].angular = G::frame(&bodies.poses[body]).tensor(moments);
                if ledger {
                    let (mass, inverse) = (bodies.mass(body), &bodies.inverse_masses[body]);
                    self.scratch.ledger.update_mass(body, mass, inverse);
                }
            }
        }
    }

    /// Copies the contacts from the lanes to the system.
    fn unpack(&mut self) {
        self.solver.with_system(&mut self.bodies, |solver, _| {
            solver.lanes.unpack(&mut solver.system);
        });
    }

    /// Saves the contacts and joints of a substep of `h` \[s\] before it is solved.
    fn save(&mut self, h: f32) {
        let mut contacts = self.bodies.without_contacts();
        // The prospective velocities are those before the impulses of contacts and joints.
        contacts.velocities.clone_from(&self.scratch.prospective);
        self.solver.lanes.unpack(&mut contacts);
        let displacements = &self.scratch.displacements;
        let at = self.bodies.view(displacements);
        self.execution.saved = Some(SavedSystem::new(&contacts, &self.solver.joints, &at, h));
    }
}
