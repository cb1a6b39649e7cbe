//! Time step of a world: its stages in order ([`World::step`]), and the contact searches within a
//! step.
//!
//! | Stage | From | To |
//! |---|---|---|
//! | pairs | bounding boxes and travel bounds of bodies | pairs of colliders that may touch |
//! | manifolds | pairs, shapes and poses | cached manifolds with gaps and impulses |
//! | rows | manifolds, masses, settings | contacts in lanes, ready to be solved |
//! | predict to relax | velocities, contacts | velocities, impulses, displacements |
//! | remember | impulses | cached manifolds |
//! | advance | displacements | poses |
//!
//! The stages from predict to relax run in each substep ([`substep`](crate::substep)).
//!
//! A step with fast bodies has several contact searches. Each search is for a part of the step: one
//! or more of its substeps.

use drystone_solver::restitution::ImpactSettings;
use drystone_solver::{Clock, Velocity};

use crate::bodies::{Bodies, GRAIN};
use crate::cache::{self, Pair};
use crate::geometry::Geometry;
use crate::input::{self, InputError};
use crate::motion::{self, SubstepParams};
use crate::narrow_phase::{NarrowPhaseInput, PairWorker, closing, manifolds};
use crate::patches::Shapes;
use crate::report::{Stage, StageTimer, StepReport};
use crate::rows::CacheSource;
use crate::seams::SeamInput;
use crate::settings::StepSettings;
use crate::solving::ConstraintSolver;
use crate::step_scratch::StepScratch;
use crate::substep::PartPlan;
use crate::travel::MotionView;
use crate::world::World;

/// Largest number of rounds of impacts per substep. An impact can propagate through this many
/// contacts against the order of the contacts.
const IMPACT_ROUNDS: usize = 32;

/// Largest number of sweeps over the contacts of an impact.
const IMPACT_SWEEPS: usize = 40;

/// In a step with several searches, contact points are reused while bodies move less than this
/// fraction of the prediction distance. Shapes farther apart than that distance had no
/// points. \[1\]
const REUSE: f32 = 0.25;

/// In a substep no body falls by more than this fraction of its thickness, as far as the setting
/// `max_substeps` allows. A soft contact penetrates by about this distance for each body above it.
/// At this fraction a tower of twenty bodies stands. \[1\]
const MOST_FALL: f32 = 1.0 / 1024.0;

/// In a substep no arm of a joint turns by more than this angle, as far as the setting `max_substeps`
/// allows. \[rad\]
const MOST_TURN: f64 = 0.1;

/// Substeps that are held when joints turn slowly again, over the least number. \[1\]
const MOST_HELD: f64 = 2.0;

/// A contact search and its part of the step.
#[derive(Clone, Copy, Debug)]
struct Search {
    /// Length of a substep of this part, and of the whole step. \[s\]
    h: f32,
    dt: f32,
    /// Number of substeps before this part, of this part, and of those after it.
    taken: u32,
    due: u32,
    left: u32,
    /// Number of searches before this one, and largest number of searches in the step.
    number: u32,
    most: u32,
    /// Rate at which joints turn in a substep that has been taken back. \[rad/s\]
    turn_rate: f64,
}

impl Search {
    /// Returns the length of the part. \[s\]
    fn duration(&self) -> f32 {
        self.h * self.due as f32
    }

    /// Returns the part of the step that has passed before this part, and that after it. \[1\]
    fn passed_before(&self) -> f32 {
        (1.0 - (self.left + self.due) as f32 * self.h / self.dt).max(0.0)
    }

    fn passed(&self) -> f32 {
        1.0 - self.left as f32 * self.h / self.dt
    }

    /// Ends the part after this number of substeps; later parts take the others.
    fn end_after(&mut self, substeps: u32) {
        self.left += self.due - substeps;
        self.due = substeps;
    }

    /// Returns the distance up to which contact points are reused. \[m\]
    fn reuse(&self, settings: &StepSettings) -> f32 {
        let several = self.taken + self.left > 0;
        let least = if several { REUSE * settings.prediction_distance } else { 0.0 };
        settings.reuse_distance.max(least)
    }
}

/// Returns the number of substeps until the next search. In `substeps` substeps, near bodies move
/// `travel_ratio` times as far relative to each other as one search allows.
fn substeps_until_search(substeps: u32, travel_ratio: f32) -> u32 {
    ((substeps as f32 / travel_ratio) as u32).max(1)
}

/// Returns the motion of the bodies over `dt` \[s\].
fn moving<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &Bodies<G, L, A>,
    dt: f32,
) -> MotionView<'_, L, A> {
    let Bodies { velocities, frames, reach, since_search, surface_speeds, .. } = bodies;
    MotionView { velocities, frames, reach, since_search, surface_speeds, dt }
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Takes a step ([`World::step`]): the stages in their order.
    pub(crate) fn take_step(&mut self, dt: f32) -> Result<StepReport, InputError> {
        input::check_time(dt)?;
        input::check_gravity(&self.gravity)?;
        self.settings.check()?;
        self.check_mesh_motions(dt)?;
        let execution = &self.execution;
        let start = execution.tuner.start(&execution.pool, execution.clock);
        let mut timer =
            StageTimer::start(if execution.timing { execution.clock } else { Clock::NONE });
        let mut report = StepReport::default();
        let held_energy = self.open_held();
        self.wake_if_changed();
        self.begin_deforming(dt);
        self.begin_joints(dt);
        self.begin_record();
        self.execution.saved = None;
        let mut search = self.first_search(dt);
        loop {
            timer.lap(Stage::Pairs);
            let same = self.find_manifolds(&search);
            let carried = self.attach_carriers(search.passed_before());
            timer.lap(Stage::Manifolds);
            let mut plan = self.build_rows(&search, same && !carried);
            timer.lap(Stage::Rows);
            let earlier = self.execution.saved.take();
            if !self.take_substeps(&mut plan, &mut timer, &mut report) {
                self.take_part_back();
                plan = PartPlan { whole_system: true, ..self.build_rows(&search, false) };
                self.take_substeps(&mut plan, &mut timer, &mut report);
            }
            search.end_after(plan.params.substeps);
            search.turn_rate = plan.turn_rate;
            self.execution.keep_impacts(earlier);
            self.integrate_poses(&plan, &mut report);
            self.detach_carriers();
            self.deform_meshes(search.passed(), search.duration());
            timer.lap(Stage::Advance);
            if !self.next_search(&mut search) {
                break;
            }
        }
        report.substeps = search.taken + search.due;
        self.close_held(held_energy, &mut report);
        self.end_joints(dt, &mut report);
        self.bodies.forces.clear();
        self.scratch.impulses.join();
        self.fall_asleep(dt);
        self.end_deforming(&mut report);
        report.stages = timer.stages;
        report.asleep = self.sleep.count();
        report.not_finite = self.bodies.not_finite();
        report.pairs = self.contacts.pairs.len();
        report.manifolds = self.contacts.cache.manifolds.len();
        report.contacts = self.contacts.cache.points.len();
        let time = self.execution.clock.since(start);
        self.execution.tuner.stop(time, report.sweeps, report.contacts);
        Ok(report)
    }

    /// Begins the record of impulses, if there is to be one.
    fn begin_record(&mut self) {
        let impulses = &mut self.scratch.impulses;
        impulses.pairs.clear();
        if self.execution.recording {
            impulses.before.clone_from(&self.bodies.velocities);
        }
    }

    /// Wakes all bodies if sleep is turned off or gravity has changed.
    fn wake_if_changed(&mut self) {
        let delay = self.settings.sleep_delay;
        let is_off = delay <= 0.0 && self.sleep.last_delay > 0.0;
        let is_other = self.gravity != self.sleep.last_gravity;
        (self.sleep.last_delay, self.sleep.last_gravity) = (delay, self.gravity);
        if self.sleep.count() > 0 && (is_off || is_other) {
            for body in 0..self.bodies.poses.len() {
                self.wake_slot(body);
            }
        }
    }

    /// Begins the first search of a step. It is for all substeps, or for as many as the motion of
    /// the bodies allows.
    fn first_search(&mut self, dt: f32) -> Search {
        let most = self.settings.max_searches;
        let travel_ratio = self.plan_searches(dt);
        // Each search is for at least one substep.
        let asked = self.settings.substeps.max(self.substeps_of_thinnest(dt));
        let least = dt / self.settings.max_substeps as f32;
        let rate = self.held_rate(dt);
        let asked = asked.max(self.substeps_of_joints(rate, [dt, least]));
        let substeps = asked.max(travel_ratio.ceil().min(most as f32) as u32);
        let h = dt / substeps as f32;
        let mut search = Search {
            h,
            dt,
            taken: 0,
            due: substeps,
            left: substeps,
            number: 0,
            most,
            turn_rate: rate,
        };
        self.fit(&mut search, travel_ratio);
        search
    }

    /// Returns the rate at which joints turn, or have turned of late, in a solve to a tolerance. \[rad/s\]
    fn held_rate(&mut self, dt: f32) -> f64 {
        // Those that act are not yet known to a world that has just been restored.
        if self.settings.tolerance <= 0.0 || !self.solver.joints.exist() {
            return 0.0;
        }
        let (time, gravity) = (f64::from(dt), f64::from(self.gravity.length()));
        let turn = self.solver.joints.largest_turn(&self.body_places(), [time, MOST_TURN], gravity);
        let most = MOST_HELD * MOST_TURN * f64::from(self.settings.substeps) / time;
        self.solver.joints.held.hold(turn / time, time, most)
    }

    /// Begins the next search. Returns false if all substeps have been taken.
    fn next_search(&mut self, search: &mut Search) -> bool {
        if search.left == 0 {
            return false;
        }
        for index in 0..self.solver.joints.broken_before().len() {
            self.pair_again(self.solver.joints.broken_before()[index]);
        }
        search.number += 1;
        search.taken += search.due;
        let rest = search.left as f32 * search.h;
        let least = search.dt / self.settings.max_substeps as f32;
        let asked = self.substeps_of_joints(search.turn_rate, [rest, least]);
        if asked > search.left {
            (search.left, search.h) = (asked, rest / asked as f32);
        }
        search.due = search.due.clamp(1, search.left);
        let travel_ratio = self.plan_searches(search.duration());
        self.fit(search, travel_ratio);
        true
    }

    /// Returns the number of substeps that joints require in the next `dt` \[s\], none shorter than
    /// `least` \[s\], if they turn at `rate` or as they do now. \[rad/s\]
    fn substeps_of_joints(&self, rate: f64, [dt, least]: [f32; 2]) -> u32 {
        let (joints, time) = (&self.solver.joints, f64::from(dt));
        let gravity = f64::from(self.gravity.length());
        let turn = joints.largest_turn(&self.body_places(), [time, MOST_TURN], gravity);
        let most = f64::from((dt / least).max(1.0));
        (turn.max(rate * time) / MOST_TURN).ceil().min(most) as u32
    }

    /// Sets the number of substeps of a search to that which the motion of the bodies allows.
    /// `travel_ratio` is their relative motion in the substeps that are due, as returned by
    /// `plan_searches`.
    fn fit(&mut self, search: &mut Search, travel_ratio: f32) {
        let Search { left, due: planned, most, number, .. } = *search;
        let fitting = |due, travel_ratio| {
            substeps_until_search(due, travel_ratio).max(left.div_ceil(most - number)).min(left)
        };
        let mut travel_ratio = travel_ratio;
        search.due = fitting(planned, travel_ratio);
        if search.due != planned {
            travel_ratio = self.plan_searches(search.duration());
        }
        // Falls grow with the square of the time: in a longer part bodies move more than in
        // proportion.
        let longest = fitting(search.due, travel_ratio);
        if search.due > planned && longest < search.due {
            search.due = longest;
            self.plan_searches(search.duration());
        }
        search.left -= search.due;
    }

    /// Finds the pairs for the next `dt` \[s\] and the relative motion of their bodies. Returns the
    /// largest relative motion of near bodies, as a multiple of the motion that requires another
    /// search. \[1\]
    fn plan_searches(&mut self, dt: f32) -> f32 {
        self.find_pairs(dt);
        let fall = self.gravity.length() * dt * dt;
        let moving = moving(&self.bodies, dt);
        let margin = self.settings.prediction_distance;
        let masses = &self.bodies.inverse_masses;
        let worst = self.scratch.travel.find_pushes(
            moving,
            masses,
            &self.contacts.pairs,
            [fall, margin],
            &self.execution.pool,
        );
        let travel_ratio = worst / self.settings.travel_per_search;
        if travel_ratio.is_finite() { travel_ratio } else { 0.0 }
    }

    /// Returns the number of substeps required by the thinnest awake body ([`MOST_FALL`]).
    fn substeps_of_thinnest(&self, dt: f32) -> u32 {
        let (settings, gravity) = (&self.settings, self.gravity.length());
        let awake = |(body, thickness): (usize, &f32)| {
            if self.sleep.is_sleeping(body) { f32::INFINITY } else { *thickness }
        };
        let thickness = self.bodies.thickness.iter().enumerate().map(awake);
        let thinnest = thickness.fold(f32::INFINITY, f32::min);
        if settings.tolerance > 0.0 || gravity == 0.0 || thinnest == f32::INFINITY {
            return 1;
        }
        let longest = (2.0 * MOST_FALL * thinnest / gravity).sqrt();
        let fitting = (dt / longest).ceil().min(settings.max_substeps as f32) as u32;
        fitting.max(1)
    }

    /// Updates the pairs of shapes whose bounding boxes, enlarged by their motion in `dt` \[s\],
    /// overlap.
    fn find_pairs(&mut self, dt: f32) {
        let reach = self.settings.prediction_distance * 0.5;
        let bodies = &self.bodies;
        self.scratch.travel.find(moving(bodies, dt), &self.execution.pool);
        let (travel, sleep) = (&self.scratch.travel.own, &self.sleep);
        self.colliders.follow(
            &mut self.broad_phase,
            bodies,
            sleep,
            travel,
            reach,
            &self.execution.pool,
        );
        let Some(found) = self.broad_phase.follow(&mut self.contacts.pairs, &self.execution.pool)
        else {
            return;
        };
        let fresh = &mut self.scratch.fresh_pairs;
        fresh.clear();
        let (colliders, bodies) = (&self.colliders, &self.bodies);
        fresh.extend(found.filter_map(|pair| colliders.pair(bodies, pair)));
        let (fall, settings) = (self.gravity.length() * dt * dt, &self.settings);
        let moving = moving(bodies, dt);
        if self.scratch.workers.is_empty() {
            self.scratch.workers.push(PairWorker::default());
        }
        for pair in fresh.iter_mut() {
            if self.solver.joints.separates(pair.bodies) {
                pair.separate();
                continue;
            }
            let relative = moving.relative_travel(travel, pair, || 0.0).unwrap_or_default();
            let relative = relative[0] + relative[1] + fall;
            // The pair would determine how often contacts are searched, if it were as near as its
            // boxes. So the distance of its shapes is measured.
            if relative > settings.travel_per_search * pair.thickness {
                let prediction = relative + 2.0 * settings.prediction_distance;
                self.scratch.workers[0].measure_clearance(colliders, bodies, pair, prediction);
            }
        }
        cache::merge(&mut self.contacts.pairs, fresh);
        self.colliders.release();
    }

    /// Finds the manifolds of the pairs. Returns true if the manifolds, with their numbers of
    /// points, are the same as before.
    fn find_manifolds(&mut self, search: &Search) -> bool {
        let (reuse, dt) = (search.reuse(&self.settings), search.duration());
        // Two bodies that need no rebuild have moved by at most half of the reuse distance
        // together.
        let limit = 0.25 * reuse;
        self.bodies.mark_moved(limit, &self.execution.pool);
        self.update_inverse_masses();
        if reuse < std::mem::replace(&mut self.contacts.last_reuse, reuse) {
            // The reuse distance shrank, so the points found for the larger one are no longer
            // valid.
            self.contacts
                .pairs
                .iter_mut()
                .filter(|pair| pair.count > 0)
                .for_each(|pair| pair.clearance = 0.0);
        }
        std::mem::swap(&mut self.contacts.cache, &mut self.scratch.old_cache);
        self.update_active();
        if self.sleep.count() > 0 {
            let (bodies, active) = (&self.bodies, &self.scratch.active);
            let are_active = |pair| bodies.may_meet(pair, active);
            self.sleep.put_to_sleep(&mut self.contacts.pairs, &self.scratch.old_cache, are_active);
        }
        let (mut impulses_updated, mut same) = (true, true);
        loop {
            if self.collide(impulses_updated, reuse, dt) {
                same = false;
            } else {
                std::mem::swap(&mut self.contacts.cache, &mut self.scratch.old_cache);
            }
            impulses_updated = false;
            // A sleeping body that is touched wakes, and may wake the bodies that it touches.
            if !self.wake_touched() {
                self.sleep.placed.clear();
                self.find_patches();
                self.open_held_contacts();
                self.resolve_seams(dt);
                // A solve to a tolerance distributes the load correctly, so it needs no reduced
                // patches.
                if self.settings.tolerance == 0.0 {
                    self.scratch.patches.join(&mut self.contacts.cache);
                }
                return same;
            }
            self.update_active();
            std::mem::swap(&mut self.contacts.cache, &mut self.scratch.old_cache);
        }
    }

    /// Updates the list of bodies that may touch something new.
    fn update_active(&mut self) {
        let (bodies, sleep) = (&self.bodies, &self.sleep);
        let active = |body: usize| sleep.is_active(bodies, body);
        self.scratch.active.resize(bodies.poses.len(), false);
        let (useful, share) = self.execution.pool.share(bodies.poses.len(), GRAIN);
        self.execution.pool.for_each(
            useful,
            self.scratch.active.chunks_mut(share).enumerate(),
            |(part, own)| {
                (share * part..).zip(own).for_each(|(body, own)| *own = active(body));
            },
        );
        self.sleep.placed.iter().for_each(|&body| self.scratch.active[body as usize] = true);
    }

    /// Wakes sleeping bodies that an active body touches, and those that are joined to them. Returns
    /// true if there were any.
    fn wake_touched(&mut self) -> bool {
        let mut any = false;
        if self.sleep.count() == 0 {
            return any;
        }
        for manifold in 0..self.contacts.cache.manifolds.len() {
            for body in self.contacts.cache.manifolds[manifold].bodies {
                any |= self.sleep.is_sleeping(body as usize) && self.wake_slot(body as usize);
            }
        }
        if any {
            self.wake_along_joints();
        }
        any
    }

    /// Runs the narrow phase on the old manifolds. `impulses_updated` is true if the solver has
    /// updated their impulses since they were found. Returns true if the manifolds differ from
    /// before.
    fn collide(&mut self, impulses_updated: bool, reuse_distance: f32, dt: f32) -> bool {
        let around = NarrowPhaseInput::<G, L, A> {
            shapes: &self.colliders.shapes,
            poses: &self.colliders.poses,
            bodies: &self.bodies,
            travel: &self.scratch.travel.own,
            moving: moving(&self.bodies, dt),
            impulses_updated,
            sleeping: &self.sleep.cache,
            active: &self.scratch.active,
            prediction_distance: self.settings.prediction_distance,
            fall: self.gravity.length() * dt * dt,
            reuse_distance,
        };
        let cache = (&mut self.scratch.old_cache, &mut self.contacts.cache);
        manifolds(
            &around,
            &mut self.contacts.pairs,
            &mut self.scratch.workers,
            &self.execution.pool,
            cache,
        )
    }

    /// Rotates the normals of manifolds at seams and corners to the axes along which the bodies are
    /// held apart.
    fn resolve_seams(&mut self, dt: f32) {
        let meeting = SeamInput::<G, L, A> {
            shapes: &self.colliders.shapes,
            poses: &self.colliders.poses,
            bodies: &self.bodies,
            velocities: &self.bodies.velocities,
            gravity: self.gravity,
            dt,
        };
        let closing =
            closing(&self.scratch.workers, self.contacts.pairs.len(), &self.execution.pool);
        self.scratch.seams.resolve(
            &meeting,
            closing,
            &mut self.contacts.pairs,
            &mut self.contacts.cache,
        );
    }

    /// Finds the contact patches of compounds, and opens contacts with sides that another part
    /// covers.
    fn find_patches(&mut self) {
        let shapes = Shapes { colliders: &self.colliders, bodies: &self.bodies };
        self.scratch.patches.find(&self.contacts.pairs, &shapes, &mut self.contacts.cache);
    }

    /// Returns the plan for the substeps of a part.
    fn plan(&self, search: &Search) -> PartPlan<L> {
        let Search { h, dt, due: substeps, left, number, most, .. } = *search;
        let settings = &self.settings;
        let solving = settings.tolerance > 0.0;
        let certified_substep = (left == 0 && settings.certify).then_some(substeps - 1);
        let mut pairs = self.contacts.pairs.iter();
        let bounces = |pair: &Pair| pair.restitution > 0.0 && pair.count > 0 && !pair.is_sleeping;
        let bouncing = self.colliders.has_restitution && pairs.any(bounces);
        let params = SubstepParams {
            h,
            substeps,
            iterations: settings.iterations,
            gravity: self.gravity,
            repair: settings.repair_in(h),
            softness: settings.softness,
            stretch: settings.stretch,
        };
        let joints = &self.solver.joints;
        PartPlan {
            params,
            solving,
            balancing: !solving && joints.any_exact(),
            certified_substep,
            ledger: settings.ledger,
            collisions: bouncing.then_some(ImpactSettings {
                law: settings.impact_law,
                dt: h,
                threshold: settings.restitution_threshold,
                rounds: IMPACT_ROUNDS,
                sweeps: IMPACT_SWEEPS,
            }),
            whole_system: solving
                || joints.any_exact()
                || certified_substep.is_some()
                || settings.ledger
                || bouncing
                || self.execution.saving
                || self.execution.recording
                || joints.may_break(),
            may_end: number + 1 < most,
            may_shorten: number + 1 < most
                && h > 1.01 * dt / settings.max_substeps as f32
                && !joints.is_idle(),
            turn_rate: 0.0,
        }
    }

    /// Makes room for what a part sums by body, and clears the displacements.
    fn clear_sums(&mut self) {
        let all = self.bodies.poses.len();
        let StepScratch { displacements, prospective, .. } = &mut self.scratch;
        displacements.clear();
        displacements.resize(all, Velocity::ZERO);
        self.bodies.turned.fill(false);
        // The first substep overwrites these: it computes J^T gamma from the contacts.
        prospective.resize(all, Velocity::ZERO);
        let joined = if self.solver.joints.is_idle() { 0 } else { all };
        self.scratch.unsettled.resize(joined, false);
        let StepScratch { standing_gains, start, .. } = &mut self.scratch;
        for own in start.iter_mut().chain([standing_gains]) {
            own.resize(joined, Velocity::ZERO);
        }
    }

    /// Builds the rows of the contacts of a part from its manifolds. `same` is true if these are
    /// the same as before.
    fn build_rows(&mut self, search: &Search, same: bool) -> PartPlan<L> {
        let rejoined = self.choose_joints();
        let (plan, dt) = (self.plan(search), search.duration());
        self.clear_sums();
        self.solver.joints.begin_part(f64::from(plan.params.h));
        self.renew_joints(&plan.params);
        self.find_renewed();
        let ConstraintSolver { lanes, joints, certifier, surfaces, carriers, .. } =
            &mut self.solver;
        let (cache, bodies) = (&self.contacts.cache, &self.bodies);
        let certifying = plan.refines() || plan.certified_substep.is_some();
        if certifying {
            certifier.find_islands(&bodies.inverse_masses, cache.pairs().chain(joints.pairs()));
        }
        if plan.balancing {
            certifier.keep_islands(joints.exact_members());
        }
        let stiffness = if plan.refines() {
            let of = |body| [bodies.weight(body, self.gravity), bodies.thickness[body]];
            certifier.stiffness(cache.pairs(), of, &self.settings, plan.params.h)
        } else {
            certifier.no_stiffness()
        };
        let (velocities, whole_system) = (&bodies.velocities, plan.whole_system);
        let in_order = plan.refines() || self.settings.certify;
        let (same, couplings) = (same && !rejoined, joints.couplings());
        let renewed = &self.scratch.renewed;
        let rows = CacheSource {
            cache,
            velocities,
            stiffness,
            couplings,
            renewed,
            same,
            whole_system,
            in_order,
        };
        lanes.pack(&rows, &bodies.inverse_masses, self.settings.softness);
        let (of, moving) =
            ((&self.colliders, bodies, &*carriers), (bodies.velocities.as_slice(), dt));
        surfaces.give(of, &self.contacts.pairs, cache.manifolds.len(), moving, lanes);
        let (ledger, gravity) = (&mut self.scratch.ledger, self.gravity);
        self.solver.with_system(&mut self.bodies, |solver, bodies| {
            let ConstraintSolver { lanes, certifier, system, .. } = solver;
            if certifying {
                certifier.start(system, lanes);
            }
            if plan.ledger || plan.collisions.is_some() {
                lanes.unpack(system);
            }
            if plan.ledger {
                ledger.open(bodies, gravity, system);
            }
        });
        plan
    }

    /// Moves the poses by the displacements of a part, and closes its ledger.
    fn integrate_poses(&mut self, plan: &PartPlan<L>, report: &mut StepReport) {
        if plan.ledger {
            self.scratch.ledger.stop(&self.bodies.velocities);
        }
        motion::integrate_poses(
            &mut self.bodies,
            &self.execution.pool,
            &self.scratch.displacements,
        );
        if plan.ledger {
            let (bodies, gravity) = (&self.bodies, self.gravity);
            let ledger = self.scratch.ledger.close(bodies, gravity, &bodies.velocities);
            report.energy.get_or_insert_default().join(&ledger);
        }
    }

    /// Returns the kinetic and potential energy of the held bodies before the last calls that have
    /// moved them, if the step has a ledger. \[J\]
    fn open_held(&mut self) -> Option<[f64; 2]> {
        let led = std::mem::take(&mut self.bodies.led_energy);
        let [kinetic, potential] =
            self.settings.ledger.then(|| self.bodies.held_energy(self.gravity))?;
        Some([kinetic - led[0], potential - led[1]])
    }

    /// Adds the work on held bodies to the ledger of the step: all that changes their energy comes
    /// from outside.
    fn close_held(&mut self, before: Option<[f64; 2]>, report: &mut StepReport) {
        let (Some(before), Some(ledger)) = (before, &mut report.energy) else { return };
        let after = self.bodies.held_energy(self.gravity);
        let [kinetic, potential] = [after[0] - before[0], after[1] - before[1]];
        ledger.kinetic += kinetic;
        ledger.potential += potential;
        ledger.gravity -= potential;
        ledger.driven += kinetic + potential;
    }

    /// Recomputes M^-1 of the bodies that need a rebuild.
    fn update_inverse_masses(&mut self) {
        let sleep = &self.sleep;
        self.bodies.update_inverse_masses(|body| sleep.is_sleeping(body), &self.execution.pool);
    }

    /// Puts islands to sleep that have held still long enough.
    fn fall_asleep(&mut self, dt: f32) {
        let delay = self.settings.sleep_delay;
        if delay <= 0.0 {
            return;
        }
        let ConstraintSolver { surfaces, joints, .. } = &self.solver;
        // Repair moves bodies without a velocity.
        for body in joints.repaired() {
            if let Some(still) = self.sleep.still.get_mut(body as usize) {
                *still = 0.0;
            }
        }
        let manifolds = self.contacts.cache.manifolds.len();
        let touching = self.contacts.cache.pairs().chain(joints.pairs());
        let runs = |constraint: usize| match constraint.checked_sub(manifolds) {
            None => surfaces.runs(constraint),
            Some(joint) => joints.runs(joint),
        };
        if self.sleep.fall_asleep(&mut self.bodies, (touching, runs), dt, delay) {
            self.update_inverse_masses();
            self.colliders.update_poses(&self.bodies);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The interval has as many substeps as the relative motion allows, and at least one.
    #[test]
    fn searches_are_as_rare_as_travel_bounds_allow() {
        let of = |travel_ratio: [f32; 5], substeps| {
            travel_ratio.map(|travel_ratio| substeps_until_search(substeps, travel_ratio))
        };
        assert_eq!(of([1.0, 2.0, 3.1, 4.1, 99.0], 8), [8, 4, 2, 1, 1]);
        // Bodies that have slowed down need fewer searches.
        assert_eq!(of([0.25, 0.5, 0.9, 1.0, 1.1], 2), [8, 4, 2, 2, 1]);
        assert_eq!(substeps_until_search(1, 0.0), u32::MAX);
    }
}
