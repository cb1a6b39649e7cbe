//! [`JointBatch`]: what the stages of a substep do with the joints of a batch.
//!
//! | Stage | What happens |
//! |---|---|
//! | warm start | the impulses of the previous substep act; then each row gets its target |
//! | solve | all joints of a mechanism are solved together, after the contacts |
//! | advance | bodies with joints rotate; those of joints far apart are moved; coordinates and J are recomputed |
//! | relax | all joints of a mechanism are solved together, for velocities that the new J allows |
//!
//! About half of the impulse that keeps a body on its arc comes from the solve, half from the
//! relaxing. So bodies move as under the mean force, and end with velocities that J allows (RATTLE,
//! Andersen 1983).

use std::ops::Range;

use drystone_solver::mechanism::{MechanismBatch, MechanismPart, of_batch};
use drystone_solver::{InverseMass, Velocity};

use crate::balance::speed;
use crate::geometry::{Frame, Geometry};
use crate::joint::Breaking;
use crate::joint::linkage::{Aim, Linkage};
use crate::joint::rows::{Role, RowState};
use crate::joint::turning;
use crate::motion::{LEAST_GRAVITY, MOST_TURN, MovingBodies, SubstepParams};

/// Longest time over which a blow counts as a mean force. What breaks does not depend on the length of
/// steps, as far as two substeps are shorter. \[s\]
const BLOW: f64 = 1.0 / 240.0;

/// Largest miss of a joint at the end of a substep that is solved no more. \[m, or rad\]
const MOST_MISS: f64 = 1e-5;

/// Miss of a joint at which targets follow the path no more, in a solve to a tolerance. \[m, or rad\]
const LEAST_MISS: f64 = 1e-8;

/// Rotation of an arm of a joint in a substep beyond which it is taken back: twice that for which steps
/// are planned. \[rad\]
const WIDE_TURN: f64 = 0.2;

/// Largest acceleration by contacts that displaces a body of a touched mechanism, over that of gravity: as far
/// as joints allow it, and as far as they take it again. \[1\]
const MOST_ALLOWED: f32 = 40.0;
const MOST_TAKEN: f32 = 3.0;

/// Rotation of a body in a substep from which on what joints take counts in full. \[rad\]
const TURNING: f32 = 1e-4;

/// Velocity by which a solve of joints may move a body that touches another one, until its contacts are
/// solved again. \[m/s\]
const SETTLED: f64 = 0.1;

/// Time that a joint takes in a substep, over that of a block of contacts. \[1\]
const WORK: usize = 7;

/// The mechanisms of a batch. The bodies passed to its methods are those of the batch.
pub(crate) struct JointBatch<'a, const L: usize, const A: usize> {
    pub(crate) mechanisms: MechanismBatch<'a, L, A>,
    pub(crate) linkages: &'a mut [Linkage<L, A>],
}

impl<const L: usize, const A: usize> JointBatch<'_, L, A> {
    /// Splits at a body: into the mechanisms of bodies before it, and the others.
    pub(crate) fn split_at(self, body: usize) -> (Self, Self) {
        let (mechanisms, later_mechanisms) = self.mechanisms.split_at(body);
        let (linkages, later_linkages) = self.linkages.split_at_mut(mechanisms.count());
        let others = Self { mechanisms: later_mechanisms, linkages: later_linkages };
        (Self { mechanisms, linkages }, others)
    }

    /// Returns how long the joints of a range of bodies take, over a block of contacts. \[1\]
    pub(crate) fn work(&self, bodies: Range<usize>) -> usize {
        WORK * self.mechanisms.count_in(bodies)
    }

    /// Returns true if there are no joints.
    pub(crate) fn is_idle(&self) -> bool {
        self.linkages.is_empty()
    }

    /// Returns true if a body of a mechanism touches another one.
    pub(crate) fn touch(&self) -> bool {
        self.linkages.iter().any(|linkage| linkage.touches)
    }

    /// Computes J, the coordinates and the compliances at the places of the bodies, for substeps with
    /// these parameters.
    pub(crate) fn renew<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
        params: &SubstepParams<L>,
    ) {
        if self.is_idle() {
            return;
        }
        for index in 0..bodies.masses.len() {
            let body = bodies.first + index;
            let properties = &bodies.properties;
            let moves = bodies.masses[index].linear > 0.0 || properties.is_dynamic(body);
            if A == 3 && properties.has_joint(body) && moves {
                let moments = properties.inertia[body].inverse_moments;
                let frame: Frame<L> = G::frame(&bodies.poses[index]);
                bodies.masses[index].angular = frame.tensor(moments);
            }
        }
        let [h, stretch, speed] =
            [params.h, params.stretch, params.repair.max_repair_speed].map(f64::from);
        let at = &bodies.view();
        self.mechanisms.for_each(self.linkages.iter_mut(), |mut part, linkage| {
            linkage.take_substep(h);
            linkage.renew(at, &mut part, [stretch, speed]);
        });
    }

    /// Finds the springs that stand at the start of a substep, in an `exact` solve or another, and the
    /// velocities that they give to bodies.
    pub(crate) fn begin_springs<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
    ) {
        bodies.standing_gains.fill(Velocity::ZERO);
        self.sprung().for_each(|(part, linkage)| linkage.begin_springs(bodies, &part));
    }

    /// Ends the springs that stood at the start of the substep, and those that stand now.
    pub(crate) fn end_springs<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
    ) {
        self.sprung().for_each(|(part, linkage)| linkage.end_springs(bodies, &part));
    }

    /// Returns the mechanisms with springs.
    fn sprung(&mut self) -> impl Iterator<Item = (MechanismPart<'_, L, A>, &mut Linkage<L, A>)> {
        let all = self.mechanisms.parts().zip(self.linkages.iter_mut());
        all.filter(|(_, linkage)| linkage.has_springs)
    }

    /// Subtracts h p / 2 from the displacements of bodies with joints. p is what contacts and springs give
    /// them in each substep, in an `exact` solve as far as joints [bear](Self::bear) it.
    pub(crate) fn offset_displacements<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
        params: &SubstepParams<L>,
    ) {
        self.bear(bodies, params);
        for (moved, gain) in bodies.displacements.iter_mut().zip(&*bodies.standing_gains) {
            *moved -= *gain * (0.5 * params.h);
        }
    }

    /// Splits what bodies of touched mechanisms gain in each substep into what joints allow,
    /// p + M^-1 J^T lambda, and what they take of it again. lambda is as in a solve of the joints with all
    /// targets 0. Both are bounded: a light body between a heavy one and the floor gains thousands of
    /// times its weight. What joints take counts only where a mechanism turns. There it makes half of
    /// their reaction act at the end of the substep, as that to gravity does.
    fn bear<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
        params: &SubstepParams<L>,
    ) {
        let seen = &*bodies.standing_gains;
        self.mechanisms.for_each(self.linkages.iter_mut(), |mut part, linkage| {
            if linkage.exact && linkage.touches {
                linkage.begin_bearing(&mut part);
                part.load(seen);
                part.solve();
            }
        });
        let h = params.h;
        let parts = self.mechanisms.parts().zip(&*self.linkages);
        for (part, linkage) in parts.filter(|(_, linkage)| linkage.exact && linkage.touches) {
            let turn = linkage.turn(|body| of_batch(bodies.prospective, bodies.first, body));
            let counts = if A == 0 { 1.0 } else { (turn / TURNING).min(1.0) };
            for (index, &body) in linkage.members.iter().enumerate() {
                let own = (body as usize).wrapping_sub(bodies.first);
                if bodies.masses.get(own).is_none_or(|of| *of == InverseMass::FIXED) {
                    continue;
                }
                let fall = bodies.properties.gravity_on(body as usize, params.gravity).length();
                let weight = fall.max(LEAST_GRAVITY as f32) * h;
                let (gain, allowed) = (&mut bodies.standing_gains[own], part.velocity(index));
                let taken = *gain - allowed;
                *gain = allowed * part_within(&allowed, [MOST_ALLOWED * weight, MOST_TURN / h]);
                *gain +=
                    taken * (counts * part_within(&taken, [MOST_TAKEN * weight, MOST_TURN / h]));
            }
        }
    }

    /// Adds the impulses of the last solve to the velocities, and sets the targets of the rows.
    /// The bodies are expected to move at their prospective velocities, with the lasting impulses of
    /// the joints. If `exact`, the targets of bodies that touch others follow their paths, too, which
    /// contacts then [change](Self::aim_again).
    pub(crate) fn warm_start<G: Geometry<L, A>>(&mut self, bodies: &mut MovingBodies<'_, G, L, A>) {
        if self.is_idle() {
            return;
        }
        for (mut part, linkage) in self.mechanisms.parts().zip(self.linkages.iter_mut()) {
            linkage.stiffen(bodies, &mut part);
            for (axis, state) in part.axes.iter_mut().zip(linkage.states()) {
                axis.impulse = state.lasting();
            }
        }
        let seen = (&bodies.view(), &*bodies.prospective);
        self.mechanisms.for_each(self.linkages.iter_mut(), |mut part, linkage| {
            linkage.turn_lines(seen, &mut part);
        });
        self.mechanisms.apply(bodies.velocities, bodies.masses);
        let prospective = &*bodies.prospective;
        self.mechanisms.for_each(self.linkages.iter_mut(), |mut part, linkage| {
            let least_miss = if linkage.exact { LEAST_MISS } else { MOST_MISS };
            let aim = Aim { at: bodies.view(), least_miss };
            let at = &aim.at;
            // Displacements have changed since J was computed.
            linkage.look(at);
            linkage.expect(at.first, prospective);
            // Where contacts act, too, joints alone do not tell the path.
            if !linkage.touches {
                part.apply(&mut linkage.expected, at.masses);
            }
            linkage.set_targets(&aim, &mut part);
            linkage.begin_aims();
            linkage.aims = linkage.is_fast(at) && (linkage.exact || !linkage.touches);
            if linkage.aims {
                part.load(at.velocities);
                linkage.follow(&aim, &mut part);
            }
        });
        self.mechanisms.store(self.linkages.iter().map(|of| of.aims), bodies.velocities);
    }

    /// Solves all mechanisms for the targets of the substep.
    pub(crate) fn solve(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.mechanisms.solve_those(std::iter::repeat(true), velocities);
    }

    /// Solves the mechanisms whose targets follow their paths.
    pub(crate) fn solve_aiming(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.mechanisms.solve_those(self.linkages.iter().map(|of| of.aims), velocities);
    }

    /// Solves the mechanisms of which a body touches another one.
    pub(crate) fn solve_touching(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.mechanisms
            .solve_those(self.linkages.iter().map(|of| of.touches && !of.exact), velocities);
    }

    /// Marks the bodies of the mechanisms of which the last solve has moved one that touches another body by
    /// more than [`SETTLED`]: its contacts did not see what hangs on it. Returns true if there are any.
    pub(crate) fn mark_unsettled<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
    ) -> bool {
        let mut any = false;
        bodies.unsettled.fill(false);
        for (part, linkage) in self.mechanisms.parts().zip(&*self.linkages) {
            let mut touched = linkage.members.iter().zip(&linkage.touched).enumerate();
            let is_unsettled = linkage.touches
                && !linkage.exact
                && touched.any(|(index, (&body, &is_touched))| {
                    let reach = f64::from(bodies.properties.reach[body as usize].core);
                    is_touched && speed(&part.change(index), reach) > SETTLED
                });
            if is_unsettled {
                any = true;
                for &body in &linkage.members {
                    let own = (body as usize).wrapping_sub(bodies.first);
                    if bodies.masses.get(own).is_some_and(|of| *of != InverseMass::FIXED) {
                        bodies.unsettled[own] = true;
                    }
                }
            }
        }
        any
    }

    /// Notes what the solve of joints has given to bodies that touch others, in a substep of `h` \[s\].
    pub(crate) fn note_sinking<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
        h: f32,
    ) {
        let MovingBodies { masses, balances, properties, first, .. } = bodies;
        let own = |body: u32| {
            let own = (body as usize).wrapping_sub(*first);
            masses.get(own).is_some_and(|of| *of != InverseMass::FIXED).then_some(own)
        };
        for (part, linkage) in self.mechanisms.parts().zip(&*self.linkages) {
            if !linkage.touches {
                continue;
            }
            let members = || linkage.members.iter().filter_map(|&body| own(body));
            members().for_each(|own| balances[own].pass(linkage.moves, h));
            let mut sinks = false;
            // Contacts between joined bodies may bear against their joints.
            let loaded = linkage.members.iter().zip(&linkage.loaded).enumerate();
            for (index, (&body, _)) in loaded.filter(|(_, (_, loaded))| **loaded) {
                if let Some(own) = own(body) {
                    let reach = properties.reach[body as usize].core;
                    sinks |= balances[own].note(&part.change(index).cast(), reach, h);
                }
            }
            if sinks {
                members().for_each(|own| balances[own].since = 0.0);
            }
        }
    }

    /// Solves the mechanisms whose bodies have other velocities than the last solve has left.
    pub(crate) fn solve_changed(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        let seen = &*velocities;
        self.mechanisms.for_each(self.linkages.iter_mut(), |mut part, linkage| {
            linkage.aims = linkage.touches && !linkage.exact && !part.has(seen);
            if linkage.aims {
                part.load(seen);
                part.solve();
            }
        });
        self.mechanisms.store(self.linkages.iter().map(|of| of.aims), velocities);
    }

    /// Sets the targets again where contacts have changed the paths of bodies that turn fast. Returns
    /// true if joints would then miss their places by more than [`MOST_MISS`]. If the joints are solved
    /// `alone`, the targets follow further.
    pub(crate) fn aim_again<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
        alone: bool,
    ) -> bool {
        if !self.touch() {
            return false;
        }
        let aim = Aim { at: bodies.view(), least_miss: MOST_MISS };
        let at = &aim.at;
        self.mechanisms.for_each(self.linkages.iter_mut(), |mut part, linkage| {
            linkage.aims = linkage.touches && linkage.is_fast(at) && {
                linkage.expect(at.first, at.velocities);
                if alone {
                    linkage.set_targets(&aim, &mut part)
                } else {
                    linkage.aim(&aim, &mut part)
                }
            };
            if linkage.aims && alone {
                part.load(at.velocities);
                linkage.follow(&aim, &mut part);
            }
        });
        let aims = self.linkages.iter().map(|of| of.aims);
        if alone {
            self.mechanisms.store(aims.clone(), bodies.velocities);
        }
        aims.clone().any(|aims| aims)
    }

    /// Finds the mechanisms whose locks [add energy](crate::joint::taming) to bodies that would move at their
    /// prospective velocities, in an `exact` solve or another. If the substep `may_shorten`, it is to be [taken back](Self::turn_rate) for
    /// them. Otherwise their locks leave out curve and repair, and the mechanisms that aim are to be solved
    /// again if this returns true.
    pub(crate) fn tame<G: Geometry<L, A>>(
        &mut self,
        bodies: &MovingBodies<'_, G, L, A>,
        may_shorten: bool,
    ) -> bool {
        let (at, prospective) = (&bodies.view(), &*bodies.prospective);
        self.mechanisms.for_each(self.linkages.iter_mut(), |mut part, linkage| {
            linkage.adds = linkage.adds_energy(&part, at, prospective);
            linkage.aims = linkage.adds && !may_shorten;
            if linkage.aims {
                linkage.stop_locks(&mut part);
            }
        });
        self.linkages.iter().any(|of| of.aims)
    }

    /// Breaks the joints that the solve of a substep loads by more than their strength in [`BLOW`], or in
    /// two substeps; while `relaxing`, those that both load so. Returns true if there were any; then it is
    /// to be solved again. Their load of the step becomes the one that broke them, as a mean over the
    /// time that it is judged by.
    pub(crate) fn snap<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
        relaxing: bool,
    ) -> bool {
        let mut any = false;
        for (part, linkage) in self.mechanisms.parts().zip(self.linkages.iter_mut()) {
            let mut left = part.axes;
            for (index, joint) in part.joints.iter().enumerate() {
                let (axes, later) = std::mem::take(&mut left).split_at_mut(joint.count as usize);
                left = later;
                let turns = linkage.turns_of(index);
                let Linkage { records, arms, step, substep, slots, snapped, .. } = linkage;
                let record = &mut records[index];
                if record.broken || record.breaking == Breaking::NEVER || joint.count == 0 {
                    continue;
                }
                let before =
                    record.states.iter().map(|own| if relaxing { own.solved } else { 0.0 });
                let impulses = axes.iter().zip(before).map(|(axis, solved)| axis.impulse + solved);
                let load = record.load_by(axes, impulses, &arms[index]);
                // The solve may bear up to twice the load of its substep, and relaxing takes it back.
                let time = step.min(BLOW).max(2.0 * *substep);
                if record.strain(load.map(|own| own.length()), time) <= 1.0 {
                    continue;
                }
                record.load = Default::default();
                record.bear(load.map(|own| own * (*step / time)), turns);
                record.broken = true;
                // Its load is counted, and must not count again when relaxing ends.
                record.states.iter_mut().for_each(|own| own.solved = 0.0);
                snapped.push(slots[index]);
                any = true;
                for axis in axes {
                    for (&body, jacobian) in joint.bodies.iter().zip(&axis.jacobian) {
                        let Some(at) = bodies.view().index(body) else { continue };
                        let inverse: InverseMass<f64, L, A> = bodies.masses[at].cast();
                        bodies.velocities[at] -=
                            inverse.velocity(&(*jacobian * axis.impulse)).cast();
                    }
                    (axis.impulse, axis.law.bounds) = (0.0, [0.0; 2]);
                }
            }
        }
        any
    }

    /// Returns the rate at which joints would turn in a substep that has been solved \[rad/s\], if that is
    /// too far: the substep is to be taken back.
    ///
    /// A blow can turn a light body fast within one substep: a rope that becomes taut, a limit that stops
    /// a heavy load. How fast it turns is known only when the substep has been solved.
    pub(crate) fn turn_rate<G: Geometry<L, A>>(
        &self,
        bodies: &MovingBodies<'_, G, L, A>,
        params: &SubstepParams<L>,
    ) -> Option<f64> {
        let turn = self.largest_turn(bodies, params, WIDE_TURN);
        // Half of the substep is due where targets are lost.
        let is_lost = self.linkages.iter().any(|linkage| linkage.is_lost());
        (turn > WIDE_TURN || is_lost).then(|| turn.max(WIDE_TURN) / f64::from(params.h))
    }

    /// Returns the largest angle by which joints turn in a substep; any up to `least` if none is larger
    /// ([`turning`]). \[rad\]
    fn largest_turn<G: Geometry<L, A>>(
        &self,
        bodies: &MovingBodies<'_, G, L, A>,
        params: &SubstepParams<L>,
        least: f64,
    ) -> f64 {
        let (dt, gravity) = (f64::from(params.h), f64::from(params.gravity.length()));
        let at = &bodies.view();
        let mut fastest = 0.0f64;
        for linkage in self.linkages.iter().filter(|linkage| !linkage.adds) {
            for (index, record) in linkage.records.iter().enumerate().filter(|(_, of)| !of.broken) {
                let there = linkage.turns_of(index);
                let rate = turning::rate(record, at, there, [dt, least], gravity);
                fastest = fastest.max(rate);
            }
        }
        fastest * dt
    }

    /// Stores the impulses of the solve. From then on the velocities without contacts include them.
    pub(crate) fn keep_solved<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
    ) {
        self.keep(|state, impulse| {
            state.solved_before = std::mem::replace(&mut state.solved, impulse);
        });
        self.mechanisms.apply(bodies.prospective, bodies.masses);
        self.unstiffen(bodies);
    }

    /// Restores the inertia of the bodies to which pulls have added some.
    pub(crate) fn unstiffen<G: Geometry<L, A>>(&mut self, bodies: &mut MovingBodies<'_, G, L, A>) {
        self.linkages.iter_mut().for_each(|linkage| linkage.unstiffen(bodies));
    }

    /// Moves the bodies of joints that are [far from their places](crate::joint::repair) towards these.
    /// Returns the energy by which it lifts them, if it moves any. \[J\]
    pub(crate) fn repair<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
        params: &SubstepParams<L>,
    ) -> Option<f64> {
        let all = self.mechanisms.parts().zip(self.linkages.iter_mut());
        let lifted =
            all.filter_map(|(mut part, linkage)| linkage.repair(bodies, &mut part, params.gravity));
        lifted.reduce(|all, own| all + own)
    }

    /// Begins the relaxing: each row gets its law for the end of the substep, and no impulse. So every
    /// visit of joints and contacts in turn takes energy away. From the impulses of the last relaxing
    /// contacts would bear what joints then take back, and throw bodies whose contacts and joints bear
    /// against each other. J has been [renewed](Self::renew).
    pub(crate) fn begin_relaxing(&mut self) {
        for (part, linkage) in self.mechanisms.parts().zip(self.linkages.iter_mut()) {
            let mut axes = part.axes.iter_mut();
            for record in &linkage.records {
                let when = (linkage.substep, record.breaking != Breaking::NEVER);
                for (plan, state) in record.rows.iter().zip(&record.states) {
                    let Some(axis) = axes.next() else { break };
                    axis.law = plan.role.relaxing_law(&axis.law, state, when);
                    if record.broken {
                        axis.law.bounds = [0.0; 2];
                    }
                    axis.impulse = 0.0;
                }
            }
        }
    }

    /// Ends the relaxing: velocities without contacts include its impulses, and joints bear them.
    pub(crate) fn keep_relaxed<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
    ) {
        self.mechanisms.apply(bodies.prospective, bodies.masses);
        self.keep(|state, impulse| state.relaxed = impulse);
        for (part, linkage) in self.mechanisms.parts().zip(self.linkages.iter_mut()) {
            let mut left = &*part.axes;
            for (index, joint) in part.joints.iter().enumerate() {
                let (axes, later) = left.split_at(joint.count as usize);
                left = later;
                let (turns, arms) = (linkage.turns_of(index), linkage.arms[index]);
                let record = &mut linkage.records[index];
                let impulses = record.states.iter().map(|state| state.solved + state.relaxed);
                let load = record.load_by(axes, impulses, &arms);
                record.bear(load, turns);
            }
        }
    }

    fn keep(&mut self, to: impl Fn(&mut RowState, f64)) {
        for (part, linkage) in self.mechanisms.parts().zip(self.linkages.iter_mut()) {
            let states = linkage.records.iter_mut().flat_map(|record| &mut record.states);
            for (axis, state) in part.axes.iter().zip(states) {
                to(state, axis.impulse);
            }
        }
    }

    /// Passes an impact on through the locks: the bodies that it has struck pull those joined to them.
    /// Locks take energy, and never add any.
    pub(crate) fn pass_impact(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        for (part, linkage) in self.mechanisms.parts().zip(self.linkages.iter_mut()) {
            let mut axes = part.axes.iter_mut();
            for record in &linkage.records {
                let holds = record.breaking == Breaking::NEVER;
                for row in &record.rows {
                    let Some(axis) = axes.next() else { break };
                    axis.impulse = 0.0;
                    axis.law.targets = [0.0; 2];
                    axis.law.bounds = match row.role {
                        Role::Lock(_, None) if holds => [f64::NEG_INFINITY, f64::INFINITY],
                        _ => [0.0; 2],
                    };
                }
            }
        }
        self.solve(velocities);
    }
}

/// Returns the part of a velocity that is within these bounds. \[m/s, rad/s\]
fn part_within<const L: usize, const A: usize>(
    of: &Velocity<f32, L, A>,
    [linear, angular]: [f32; 2],
) -> f32 {
    let part = |own: f32, most: f32| if own > most { most / own } else { 1.0 };
    part(of.linear.length(), linear).min(part(of.angular.length(), angular))
}
