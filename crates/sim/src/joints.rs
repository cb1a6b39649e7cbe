//! [`Joints`]: the joints of a world, and what the stages of a substep do with them.
//!
//! | Stage | What happens |
//! |---|---|
//! | rows | joints of awake bodies are ordered by mechanism; J is computed at the poses |
//! | warm start | the impulses of the previous substep act; then each row gets its target |
//! | solve | all joints of a mechanism are solved together, after the contacts |
//! | advance | bodies with joints rotate; coordinates and J are recomputed |
//! | relax | all joints of a mechanism are solved together, for velocities that the new J allows |
//!
//! About half of the impulse that keeps a body on its arc comes from the solve, half from the
//! relaxing. So bodies move as under the mean force, and end with velocities that J allows (RATTLE,
//! Andersen 1983).

use std::sync::Arc;

use drystone_solver::mechanism::Mechanisms;
use drystone_solver::thread_pool::ThreadPool;
use drystone_solver::{Axis, InverseMass, Joint as SolverJoint, SymmetricMatrix, Vector, Velocity};

use crate::bodies::Bodies;
use crate::geometry::Geometry;
use crate::ids::Slots;
use crate::joint::coordinates::{RowCoordinate, Vec3};
use crate::joint::linkage::{ActingJoints, Aim, Linkage, Taming};
use crate::joint::places::{BodyPlaces, in_space};
use crate::joint::record::{JointRecord, WORLD};
use crate::joint::rows::{Role, RowState};
use crate::joint::turning::{FrameMotion, nutation, turn_of_inertia, turn_of_line};
use crate::joint::{Breaking, JointState};
use crate::ledger::JointRow;
use crate::report::BrokenJoint;

/// Longest time over which a blow counts as a mean force. What breaks does not depend on the length of
/// steps, as far as two substeps are shorter. \[s\]
const BLOW: f64 = 1.0 / 240.0;

/// Least acceleration for the weight of a mechanism, which it has without gravity. \[m/s^2\]
const LEAST_GRAVITY: f64 = 9.81;

/// Largest miss of a joint at the end of a substep that is solved no more. \[m, or rad\]
const MOST_MISS: f64 = 1e-5;

/// Miss of a joint at which targets follow the path no more, in a solve to a tolerance. \[m, or rad\]
const LEAST_MISS: f64 = 1e-8;

/// Speed of a body below which it counts as resting for its contacts. \[m/s\]
const RESTING: f32 = 0.05;

/// Largest rotation of a body by half of what a spring that stands gives it in a substep. \[rad\]
const MOST_TURNED: f64 = 0.01;

/// Largest acceleration by such a spring of a body that touches others. \[m/s^2\]
const MOST_PUSHED: f64 = 400.0;

/// Number of substeps in which a mechanism that falls gets so fast that its joints no longer relax before
/// contacts, in a solve to a tolerance. Without that, what rests on contacts has the velocity of one. \[1\]
const SETTLING: f32 = 10.0;

/// Part of the rotation of an arm in a substep that a rotation which is counted counts for: 0.1 rad of
/// an arm are 1.5 rad of it, and half a turn would be too much. \[1\]
const COUNTED: f64 = 1.0 / 15.0;

/// Part of the rotation of an arm in a substep that a nutation counts for. Joints act on a body at the ends
/// of substeps; in between a top nutates freely. With 1.1 rad of that it precesses 0.5 % too slowly. \[1\]
const NUTATING: f64 = 1.0 / 11.0;

/// State of joints between two steps.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct SavedJoints {
    generations: Vec<u32>,
    broken: Vec<bool>,
    /// By joint: q and the impulses of each row, then the turns of each axis, its pulls and its load.
    pub(crate) numbers: Vec<f64>,
    last_step: f64,
    substep: f64,
}

/// A joint that can act, and which of its bodies can move.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Candidate {
    slot: u32,
    moves: [bool; 2],
}

/// The joints of a world.
#[derive(Clone, Debug, Default)]
pub(crate) struct Joints<const L: usize, const A: usize> {
    pub(crate) slots: Slots,
    /// By slot.
    pub(crate) records: Vec<JointRecord>,
    /// Joints that can act in the last [choice](Self::choose), and in this one.
    candidates: [Vec<Candidate>; 2],
    /// Slots of the joints that act, mechanism by mechanism.
    acting: Vec<u32>,
    /// Their pairs of bodies.
    pairs: Vec<[u32; 2]>,
    /// Their rows, and the solver.
    pub(crate) mechanisms: Mechanisms<L, A>,
    /// The mechanisms in a substep.
    linkages: Vec<Linkage<L, A>>,
    /// Joints that this step has broken.
    snapped: Vec<u32>,
    /// Length of this step. \[s\]
    step: f64,
    /// Length of the substep, or of the last one. \[s\]
    substep: f64,
    /// Inertia that pulls add to bodies ([`tension`](crate::joint::tension)).
    pub(crate) surpluses: Vec<(u32, SymmetricMatrix<f64, A>)>,
    /// True if the rows of the joints that act must be rebuilt.
    is_stale: bool,
    /// Length of the last step. \[s\]
    pub(crate) last_step: f64,
    /// Pairs of bodies whose shapes do not collide, in ascending order.
    separated: Vec<[u32; 2]>,
    /// Joints with locks by their bodies, in ascending order. Bodies that stand still are [`WORLD`].
    locked: Vec<([u32; 2], u32)>,
}

impl<const L: usize, const A: usize> Joints<L, A> {
    /// Returns true if no joint acts.
    pub(crate) fn is_idle(&self) -> bool {
        self.acting.is_empty()
    }

    /// Returns the slots of the joints that act, in the order of the mechanisms.
    pub(crate) fn acting(&self) -> &[u32] {
        &self.acting
    }

    /// Returns the pairs of bodies of the joints that act. A joint to the world has its body twice.
    pub(crate) fn pairs(&self) -> impl Iterator<Item = [u32; 2]> + Clone {
        self.pairs.iter().copied()
    }

    /// Returns true if the joint of this index among those that act has a motor that runs.
    pub(crate) fn runs(&self, acting: usize) -> bool {
        let record = &self.records[self.acting[acting] as usize];
        record.rows.iter().any(|row| row.role.runs())
    }

    /// Returns true if a joint keeps the shapes of two bodies from colliding.
    pub(crate) fn separates(&self, bodies: [u32; 2]) -> bool {
        self.separated.binary_search(&ascending(bodies)).is_ok()
    }

    /// Finds the pairs of bodies whose shapes do not collide. Returns true if there are others than
    /// before.
    pub(crate) fn find_separated(&mut self) -> bool {
        let mut separated: Vec<_> = self
            .taken()
            .filter(|(_, record)| !record.collide && record.enabled && !record.broken)
            .map(|(_, record)| ascending(record.bodies))
            .collect();
        separated.sort_unstable();
        separated.dedup();
        std::mem::replace(&mut self.separated, separated) != self.separated
    }

    /// Finds the joints with locks. Returns the slots of joints that hold other contacts than before.
    pub(crate) fn find_locked(&mut self, is_static: impl Fn(u32) -> bool) -> Vec<u32> {
        let of = |body| if body != WORLD && is_static(body) { WORLD } else { body };
        let mut locked: Vec<_> = self
            .taken()
            .filter(|(_, record)| record.collide && record.enabled && !record.broken)
            .filter(|(_, record)| record.rows.iter().any(|row| row.role.is_rigid_lock()))
            .map(|(slot, record)| (ascending(record.bodies.map(of)), slot as u32))
            .collect();
        locked.sort_unstable();
        let before = std::mem::replace(&mut self.locked, locked);
        let (gone, new) = (but_for(&before, &self.locked), but_for(&self.locked, &before));
        gone.chain(new).map(|(_, slot)| slot).collect()
    }

    /// Returns the joints with locks between two bodies that collide, with [`WORLD`] for bodies that
    /// stand still.
    pub(crate) fn locked_between(&self, bodies: [u32; 2]) -> &[([u32; 2], u32)] {
        let bodies = ascending(bodies);
        let first = self.locked.partition_point(|(own, _)| *own < bodies);
        let count = self.locked[first..].partition_point(|(own, _)| *own == bodies);
        &self.locked[first..first + count]
    }

    /// Returns true if joints hold contacts of a body ([`held_contacts`](crate::held_contacts)).
    pub(crate) fn has_locked(&self) -> bool {
        !self.locked.is_empty()
    }

    /// Returns the joints and their slots.
    pub(crate) fn taken(&self) -> impl Iterator<Item = (usize, &JointRecord)> {
        self.records.iter().enumerate().filter(|(slot, _)| self.slots.is_taken(*slot))
    }

    /// Finds the joints that act: those of awake dynamic bodies. Returns true if there are others
    /// than before. `gravity` is the length of its acceleration. \[m/s^2\]
    pub(crate) fn choose<G: Geometry<L, A>>(
        &mut self,
        bodies: &Bodies<G, L, A>,
        gravity: f64,
    ) -> bool {
        if self.records.is_empty() {
            return false;
        }
        let is_stale = std::mem::take(&mut self.is_stale);
        let masses = &bodies.inverse_masses;
        let moves = |body: &u32| *body != WORLD && masses[*body as usize] != InverseMass::FIXED;
        let [before, mut candidates] = std::mem::take(&mut self.candidates);
        candidates.clear();
        candidates.extend(self.taken().filter_map(|(slot, record)| {
            let moves = [0, 1].map(|side| moves(&record.bodies[side]));
            let acts = record.enabled && !record.broken && moves.contains(&true);
            acts.then_some(Candidate { slot: slot as u32, moves })
        }));
        let is_same = before == candidates;
        self.candidates = [candidates, before];
        if is_same && !is_stale {
            return false;
        }
        let acting: Vec<u32> = self.candidates[0].iter().map(|of| of.slot).collect();
        let pairs: Vec<_> = acting.iter().map(|&slot| pair(&self.records[slot as usize])).collect();
        let order = Mechanisms::<L, A>::order(&pairs, masses);
        let acting: Vec<u32> = order.iter().map(|&index| acting[index as usize]).collect();
        self.pairs = order.iter().map(|&index| pairs[index as usize]).collect();
        self.acting = acting;
        self.connect(bodies, gravity);
        true
    }

    /// Sets the thread pool that works on the joints. Results do not depend on it.
    pub(crate) fn set_pool(&mut self, pool: Arc<ThreadPool>) {
        self.mechanisms.set_pool(pool);
    }

    /// Finds the mechanisms of which a body touches another one, and those of which it touches one
    /// without joints.
    pub(crate) fn find_touching(&mut self, touches: impl Fn(u32) -> [bool; 2]) {
        for linkage in &mut self.linkages {
            linkage.touches = linkage.members.iter().any(|&body| touches(body)[0]);
            linkage.meets = linkage.members.iter().any(|&body| touches(body)[1]);
        }
    }

    /// Returns true if a body of a mechanism touches another one.
    pub(crate) fn touch(&self) -> bool {
        self.linkages.iter().any(|linkage| linkage.touches)
    }

    /// Prepares for the joints that act.
    fn connect<G: Geometry<L, A>>(&mut self, bodies: &Bodies<G, L, A>, gravity: f64) {
        let Self { mechanisms, records, acting, pairs, linkages, .. } = self;
        mechanisms.joints.clear();
        mechanisms.axes.clear();
        for (&slot, &bodies) in acting.iter().zip(&*pairs) {
            let first = mechanisms.axes.len() as u32;
            let rows = &records[slot as usize].rows;
            mechanisms.axes.extend(rows.iter().map(|_| Axis::IDLE));
            mechanisms.joints.push(SolverJoint { bodies, first, count: rows.len() as u32 });
        }
        mechanisms.connect(&bodies.inverse_masses);
        linkages.clear();
        let mut first = 0;
        for part in mechanisms.parts() {
            let masses = part.bodies().iter().map(|&body| bodies.mass(body as usize).linear);
            let numbers = [masses.sum(), gravity.max(LEAST_GRAVITY)];
            linkages.push(Linkage::new(&part, first, numbers));
            first += part.joints.len();
        }
    }

    /// Computes J, the coordinates and the compliances at the places of the bodies, for substeps of
    /// `h` \[s\]. A lock that carries the weight of its mechanism yields by `stretch` \[m\]. Repair
    /// is at most as fast as `speed`. \[m/s\]
    pub(crate) fn renew<G: Geometry<L, A>>(
        &mut self,
        at: &BodyPlaces<'_, G, L, A>,
        [h, stretch, speed]: [f64; 3],
    ) {
        self.take_substep(h);
        let Self { mechanisms, records, acting, linkages, .. } = self;
        let joints = ActingJoints { records, acting };
        mechanisms.for_each(linkages.iter_mut(), |mut part, linkage| {
            linkage.renew(at, joints, &mut part, [h, stretch, speed]);
        });
        linkages.iter().for_each(|linkage| linkage.pass_on(records, acting));
    }

    /// Sets the length of the substep \[s\], and scales the impulses of the last one to it: forces last.
    fn take_substep(&mut self, h: f64) {
        let before = std::mem::replace(&mut self.substep, h);
        if before == h || before == 0.0 {
            return;
        }
        for record in &mut self.records {
            for RowState { solved, relaxed, solved_before, .. } in &mut record.states {
                [solved, relaxed, solved_before].into_iter().for_each(|own| *own *= h / before);
            }
            record.pulls.iter_mut().for_each(|own| *own *= h / before);
        }
    }

    /// Sets the impulses of the rows to those that the last solve lets expect.
    fn recall(&mut self) {
        let Self { mechanisms, records, acting, .. } = self;
        for (&slot, joint) in acting.iter().zip(&mechanisms.joints) {
            let states = &records[slot as usize].states;
            for (axis, state) in mechanisms.axes[joint.axes()].iter_mut().zip(states) {
                axis.impulse = state.lasting();
            }
        }
    }

    /// Computes (h S - I)+ / 2 of the bodies for which it is not zero
    /// ([`tension`](crate::joint::tension)), for substeps of `h` \[s\].
    pub(crate) fn find_surpluses<G: Geometry<L, A>>(
        &mut self,
        at: &BodyPlaces<'_, G, L, A>,
        h: f64,
    ) {
        let Self { mechanisms, records, acting, linkages, surpluses, .. } = self;
        surpluses.clear();
        for (linkage, part) in linkages.iter_mut().zip(mechanisms.parts()) {
            linkage.find_surpluses(at, (records, acting), part.axes, h, |body, surplus| {
                surpluses.push((body, surplus));
            });
        }
    }

    /// Takes the present masses of the bodies that have [surpluses](Self::find_surpluses).
    pub(crate) fn stiffen(&mut self, masses: &[InverseMass<f32, L, A>]) {
        self.mechanisms.for_each(self.linkages.iter(), |mut part, linkage| {
            if linkage.is_stiffened {
                part.renew(masses);
            }
        });
    }

    /// Adds the impulses of the last solve to the velocities, and sets the targets of the rows.
    /// The bodies are expected to move at the `prospective` velocities, with the lasting impulses of
    /// the joints. If `exact`, the targets of bodies that touch others follow their paths, too, which
    /// contacts then [change](Self::aim_again).
    pub(crate) fn warm_start<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut Bodies<G, L, A>,
        displacements: &[Velocity<f32, L, A>],
        prospective: &[Velocity<f32, L, A>],
        exact: bool,
    ) {
        self.recall();
        self.mechanisms.apply(&mut bodies.velocities, &bodies.inverse_masses);
        let least_miss = if exact { LEAST_MISS } else { MOST_MISS };
        let Self { mechanisms, records, acting, linkages, substep: h, .. } = self;
        let at = BodyPlaces { bodies, displacements };
        let aim = Aim { joints: ActingJoints { records, acting }, at, h: *h, least_miss };
        mechanisms.for_each(linkages.iter_mut(), |mut part, linkage| {
            // Displacements have changed since J was computed.
            linkage.look(&aim.at);
            linkage.expect(prospective);
            // Where contacts act, too, joints alone do not tell the path.
            if !linkage.touches {
                part.apply(&mut linkage.expected, &aim.at.bodies.inverse_masses);
            }
            linkage.set_targets(&aim, &mut part);
            let velocities = &aim.at.bodies.velocities;
            linkage.aims = linkage.is_fast(velocities, aim.h) && (exact || !linkage.touches);
            if linkage.aims {
                part.load(velocities);
                linkage.follow(&aim, &mut part);
            }
        });
        mechanisms.store(linkages.iter().map(|linkage| linkage.aims), &mut bodies.velocities);
    }

    /// Solves the mechanisms whose targets follow their paths.
    pub(crate) fn solve_aiming(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        let Self { mechanisms, linkages, .. } = self;
        mechanisms.solve_those(linkages.iter().map(|linkage| linkage.aims), velocities);
    }

    /// Sets the targets again where contacts have changed the paths of bodies that turn fast. Returns
    /// true if joints would then miss their places by more than [`MOST_MISS`]. If the joints are solved
    /// `alone`, the targets follow further.
    pub(crate) fn aim_again<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut Bodies<G, L, A>,
        displacements: &[Velocity<f32, L, A>],
        alone: bool,
    ) -> bool {
        if !self.touch() {
            return false;
        }
        let Self { mechanisms, records, acting, linkages, substep: h, .. } = self;
        let at = BodyPlaces { bodies, displacements };
        let aim =
            Aim { joints: ActingJoints { records, acting }, at, h: *h, least_miss: MOST_MISS };
        mechanisms.for_each(linkages.iter_mut(), |mut part, linkage| {
            let velocities = &aim.at.bodies.velocities;
            linkage.aims = linkage.touches && linkage.is_fast(velocities, aim.h) && {
                linkage.expect(velocities);
                linkage.set_targets(&aim, &mut part)
            };
            if linkage.aims && alone {
                part.load(velocities);
                linkage.follow(&aim, &mut part);
            }
        });
        let aims = linkages.iter().map(|linkage| linkage.aims);
        if alone {
            mechanisms.store(aims.clone(), &mut bodies.velocities);
        }
        aims.clone().any(|aims| aims)
    }

    /// Tames the mechanisms whose locks add energy to bodies that
    /// would move at the `prospective` velocities. Returns true if there are any.
    pub(crate) fn tame(
        &mut self,
        taming: Taming,
        velocities: &[Velocity<f32, L, A>],
        prospective: &[Velocity<f32, L, A>],
        masses: &[InverseMass<f32, L, A>],
    ) -> bool {
        let Self { mechanisms, records, acting, linkages, .. } = self;
        let joints = ActingJoints { records, acting };
        mechanisms.for_each(linkages.iter_mut(), |mut part, linkage| {
            let may_be = taming == Taming::Soften || linkage.aims;
            linkage.aims = may_be
                && linkage.tame((joints, taming), &mut part, [prospective, velocities], masses);
        });
        linkages.iter().any(|linkage| linkage.aims)
    }

    /// Returns the largest angle by which an arm, an axis or the line of a joint, or the inertia of a
    /// body that it holds, turns within `dt` \[s\]; any angle up to `least` if none is larger. `gravity`
    /// is the length of its acceleration. \[rad, m/s^2\]
    pub(crate) fn largest_turn<G: Geometry<L, A>>(
        &self,
        bodies: &Bodies<G, L, A>,
        [dt, least]: [f64; 2],
        gravity: f64,
    ) -> f64 {
        // An inertia turns at twice the rate of its body at most.
        let slow = 0.5 * least / dt;
        let omega = |body: u32| match body {
            WORLD => 0.0,
            body => f64::from(bodies.velocities[body as usize].angular.length()),
        };
        let mut fastest = 0.0f64;
        // Those that act are known to a world that has just been restored only later in the step.
        for (_, record) in self.taken().filter(|(_, own)| own.enabled && !own.broken) {
            let turns = record.bodies.iter().any(|&body| omega(body) > slow);
            if !turns && !record.has_line() {
                continue;
            }
            let holds = record.rows.iter().any(|row| row.turns_with_axis());
            let motions = [0, 1].map(|side| FrameMotion::of(record, side, bodies));
            for (motion, &body) in motions.iter().zip(&record.bodies) {
                fastest = fastest.max(motion.turn_of(motion.arm));
                if body == WORLD {
                    continue;
                }
                if !(holds && record.bodies.contains(&WORLD)) {
                    fastest = fastest.max(nutation(bodies, body as usize) * NUTATING);
                }
                if holds {
                    let axis = motion.turn.rotate(Vector([1.0, 0.0, 0.0]));
                    fastest = fastest.max(motion.turn_of(axis));
                    fastest = fastest.max(turn_of_inertia(bodies, body as usize));
                }
            }
            fastest = fastest.max(turn_of_line(record, &motions, gravity * dt));
            if record.axes.iter().any(|axis| axis.coordinate.counts_turns()) {
                let spin = (motions[0].omega - motions[1].omega).length();
                fastest = fastest.max(spin * COUNTED);
            }
        }
        fastest * dt
    }

    /// Passes an impact on through the locks: the bodies that it has struck pull those joined to them.
    /// Locks take energy, and never add any.
    pub(crate) fn pass_impact(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        let Self { mechanisms, records, acting, .. } = self;
        for (&slot, joint) in acting.iter().zip(&mechanisms.joints) {
            let record = &records[slot as usize];
            let holds = record.breaking == Breaking::NEVER;
            for (axis, row) in mechanisms.axes[joint.axes()].iter_mut().zip(&record.rows) {
                axis.impulse = 0.0;
                axis.law.targets = [0.0; 2];
                axis.law.bounds = match row.role {
                    Role::Lock(_, None) if holds => [f64::NEG_INFINITY, f64::INFINITY],
                    _ => [0.0; 2],
                };
            }
        }
        mechanisms.solve(velocities);
    }

    /// Solves all mechanisms for the targets of the substep.
    pub(crate) fn solve(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.mechanisms.solve(velocities);
    }

    /// Finds for each body with joints whether it rests, with all that are joined to it; and which
    /// mechanisms lead, for substeps in which bodies gain the speed `gain` by gravity. \[m/s\]
    pub(crate) fn find_resting<G: Geometry<L, A>>(
        &mut self,
        bodies: &Bodies<G, L, A>,
        gain: f32,
        rests: &mut Vec<Option<bool>>,
    ) {
        rests.clear();
        rests.resize(bodies.velocities.len(), None);
        let squared_speed = |&body: &u32| {
            let (velocity, reach) =
                (&bodies.velocities[body as usize], bodies.reach[body as usize].core);
            let turn = velocity.angular.dot(velocity.angular) * reach * reach;
            velocity.linear.dot(velocity.linear) + turn
        };
        let slow = RESTING + SETTLING * gain;
        for linkage in &mut self.linkages {
            let fastest = linkage.members.iter().map(squared_speed).fold(0.0, f32::max);
            linkage.leads = linkage.meets && fastest <= slow * slow;
            let all_rest = fastest <= RESTING * RESTING;
            for body in linkage.members.iter().map(|&body| body as usize) {
                rests[body] = Some(all_rest && bodies.inverse_masses[body] != InverseMass::FIXED);
            }
        }
    }

    /// Solves the mechanisms of which a body touches another one; of an `exact` solve only those that
    /// rest ([`Lead`](drystone_solver::lanes::Lead)).
    pub(crate) fn solve_touching(&mut self, velocities: &mut [Velocity<f32, L, A>], exact: bool) {
        let Self { mechanisms, linkages, .. } = self;
        let is_due = |of: &Linkage<L, A>| if exact { of.leads } else { of.touches };
        mechanisms.solve_those(linkages.iter().map(is_due), velocities);
    }

    /// Returns true if a joint that acts may break.
    pub(crate) fn may_break(&self) -> bool {
        self.acting.iter().any(|&slot| self.records[slot as usize].breaking != Breaking::NEVER)
    }

    /// Breaks the joints that the solve of a substep loads by more than their strength in [`BLOW`], or in
    /// two substeps.
    /// Returns true if there were any; then the substep is to be solved again.
    pub(crate) fn snap(
        &mut self,
        velocities: &mut [Velocity<f32, L, A>],
        masses: &[InverseMass<f32, L, A>],
    ) -> bool {
        let Self { mechanisms, records, acting, linkages, substep, snapped, step, .. } = self;
        let before = snapped.len();
        let arms = linkages.iter().flat_map(|linkage| linkage.arms.iter().zip(linkage.turns()));
        for ((&slot, joint), (arms, turns)) in acting.iter().zip(&mechanisms.joints).zip(arms) {
            let record = &mut records[slot as usize];
            if record.broken || record.breaking == Breaking::NEVER || joint.count == 0 {
                continue;
            }
            let axes = &mut mechanisms.axes[joint.axes()];
            let load = record.load_by(axes, axes.iter().map(|axis| axis.impulse), arms);
            // The solve may bear up to twice the load of its substep, and relaxing takes it back.
            let time = step.min(BLOW).max(2.0 * *substep);
            if record.strain(load.map(|own| own.length()), time) <= 1.0 {
                continue;
            }
            record.bear(load, turns);
            record.broken = true;
            snapped.push(slot);
            for axis in axes {
                for (body, jacobian) in joint.bodies.into_iter().zip(&axis.jacobian) {
                    let inverse: InverseMass<f64, L, A> = masses[body as usize].cast();
                    velocities[body as usize] -=
                        inverse.velocity(&(*jacobian * axis.impulse)).cast();
                }
                (axis.impulse, axis.law.bounds) = (0.0, [0.0; 2]);
            }
        }
        snapped.len() > before
    }

    /// Returns the number of joints that the step has [snapped](Self::snap) so far.
    pub(crate) fn snapped(&self) -> usize {
        self.snapped.len()
    }

    /// Stores the impulses of the solve.
    pub(crate) fn keep_solved(&mut self) {
        self.keep(|state, impulse| {
            state.solved_before = std::mem::replace(&mut state.solved, impulse);
        });
    }

    /// Finds the springs that stand, with their impulses where the bodies are.
    ///
    /// One that turns a body is counted up to [`MOST_TURNED`], one that pushes a body which is `touched` by
    /// others up to [`MOST_PUSHED`]. One that a limit holds does not count: a servo that presses on it does
    /// not move.
    pub(crate) fn find_standing(
        &self,
        masses: &[InverseMass<f32, L, A>],
        touched: &[bool],
        found: &mut Vec<JointRow<L, A>>,
    ) {
        found.clear();
        let Self { mechanisms, records, acting, linkages, .. } = self;
        let mut params = linkages.iter().flat_map(|linkage| &linkage.params);
        for (&slot, joint) in acting.iter().zip(&mechanisms.joints) {
            let record = &records[slot as usize];
            let rows = record.rows.iter().zip(&record.states).zip(&mut params);
            for (((plan, state), params), axis) in rows.zip(&mechanisms.axes[joint.axes()]) {
                if record.broken || !plan.role.is_spring() {
                    continue;
                }
                let impulse = plan.role.standing(state.value, state.solved, params);
                let held = record.rows.iter().zip(&record.states).any(|(other, state)| {
                    other.axis == plan.axis
                        && matches!(other.role, Role::Limit(_, None))
                        && state.solved * impulse < 0.0
                });
                if impulse == 0.0 || held {
                    continue;
                }
                // Parts of the largest gains that count, per impulse.
                let parts = joint.bodies.into_iter().zip(&axis.jacobian).map(|(body, jacobian)| {
                    let inverse: InverseMass<f64, L, A> = masses[body as usize].cast();
                    let gain = inverse.velocity(jacobian);
                    let pushed = if touched[body as usize] { gain.linear.length() } else { 0.0 };
                    let turned = 0.5 * params.h * gain.angular.length() / MOST_TURNED;
                    turned.max(pushed / (params.h * MOST_PUSHED))
                });
                let part = parts.fold(0.0, f64::max) * impulse.abs();
                let share = if part > 1.0 { 1.0 / part } else { 1.0 };
                let axis = Axis { impulse: impulse * share, ..*axis };
                let is_drive = matches!(plan.role, Role::Drive(_));
                found.push(JointRow { slot, bodies: joint.bodies, axis, is_drive });
            }
        }
    }

    /// Begins the relaxing: each row gets its law for the end of the substep, and no impulse. So every
    /// visit of joints and contacts in turn takes energy away. From the impulses of the last relaxing
    /// contacts would bear what joints then take back, and throw bodies whose contacts and joints bear
    /// against each other. J has been [renewed](Self::renew).
    pub(crate) fn begin_relaxing(&mut self) {
        let Self { mechanisms, records, acting, substep, .. } = self;
        for (&slot, joint) in acting.iter().zip(&mechanisms.joints) {
            let record = &records[slot as usize];
            let rows = record.rows.iter().zip(&record.states);
            for ((plan, state), axis) in rows.zip(&mut mechanisms.axes[joint.axes()]) {
                axis.law = plan.role.relaxing_law(&axis.law, state, *substep);
                if record.broken {
                    axis.law.bounds = [0.0; 2];
                }
                axis.impulse = 0.0;
            }
        }
    }

    /// Stores the impulses of the relaxing, and sums the loads of the joints.
    pub(crate) fn keep_relaxed(&mut self) {
        self.keep(|state, impulse| state.relaxed = impulse);
        let Self { mechanisms, records, acting, linkages, .. } = self;
        let arms = linkages.iter().flat_map(|linkage| linkage.arms.iter().zip(linkage.turns()));
        for ((&slot, joint), (arms, turns)) in acting.iter().zip(&mechanisms.joints).zip(arms) {
            let record = &mut records[slot as usize];
            let impulses = record.states.iter().map(|state| state.solved + state.relaxed);
            let load = record.load_by(&mechanisms.axes[joint.axes()], impulses, arms);
            record.bear(load, turns);
        }
    }

    fn keep(&mut self, to: impl Fn(&mut RowState, f64)) {
        let Self { mechanisms, records, acting, .. } = self;
        for (&slot, joint) in acting.iter().zip(&mechanisms.joints) {
            let states = &mut records[slot as usize].states;
            for (axis, state) in mechanisms.axes[joint.axes()].iter().zip(states) {
                to(state, axis.impulse);
            }
        }
    }

    /// Makes the next [choice](Self::choose) rebuild the rows.
    pub(crate) fn forget(&mut self) {
        self.is_stale = true;
    }

    /// Returns the state of all joints between two steps.
    pub(crate) fn save(&self) -> SavedJoints {
        let rows = |(_, record): (usize, &JointRecord)| {
            let of =
                |state: &RowState| [state.value, state.solved, state.relaxed, state.solved_before];
            let load = record.load.iter().flatten().flat_map(|of| of.0);
            let states = record.states.iter().flat_map(of);
            let turns = record.turns.iter().flatten().copied();
            states.chain(turns).chain(record.pulls).chain(load).collect::<Vec<_>>()
        };
        SavedJoints {
            generations: self.slots.generations().to_vec(),
            broken: self.taken().map(|(_, record)| record.broken).collect(),
            numbers: self.taken().flat_map(rows).collect(),
            last_step: self.last_step,
            substep: self.substep,
        }
    }

    /// Returns true if a state is one of these joints.
    pub(crate) fn fits(&self, from: &SavedJoints) -> bool {
        let numbers = |(_, record): (usize, &JointRecord)| {
            4 * record.states.len() + 2 * record.turns.len() + 14
        };
        self.slots.generations() == from.generations
            && self.taken().count() == from.broken.len()
            && self.taken().map(numbers).sum::<usize>() == from.numbers.len()
    }

    /// Takes a state that [fits](Self::fits).
    pub(crate) fn load(&mut self, from: &SavedJoints) {
        let Self { slots, records, .. } = self;
        let (mut numbers, mut broken) = (from.numbers.iter().copied(), from.broken.iter());
        let mut next = || numbers.next().unwrap_or_default();
        for (slot, record) in records.iter_mut().enumerate() {
            if !slots.is_taken(slot) {
                continue;
            }
            record.broken = broken.next() == Some(&true);
            for state in &mut record.states {
                *state = RowState {
                    value: next(),
                    solved: next(),
                    relaxed: next(),
                    solved_before: next(),
                };
            }
            record.turns.iter_mut().for_each(|turns| *turns = [next(), next()]);
            record.pulls = [next(), next()];
            record.load = [0, 1].map(|_| [0, 1].map(|_| Vector([next(), next(), next()])));
        }
        (self.last_step, self.substep) = (from.last_step, from.substep);
        self.forget();
        self.find_separated();
    }

    /// Returns the rows of the joints that act, with their present impulses.
    pub(crate) fn ledger_rows(&self) -> impl Iterator<Item = JointRow<L, A>> {
        self.acting.iter().zip(&self.mechanisms.joints).flat_map(|(&slot, joint)| {
            let rows = &self.records[slot as usize].rows;
            let axes = &self.mechanisms.axes[joint.axes()];
            rows.iter().zip(axes).map(move |(row, axis)| {
                let is_drive = matches!(row.role, Role::Drive(_));
                JointRow { slot, bodies: joint.bodies, axis: *axis, is_drive }
            })
        })
    }

    /// Begins a step of `dt` \[s\]: clears the loads of joints of bodies that move. Those of sleeping
    /// bodies stay.
    pub(crate) fn begin_step(&mut self, masses: &[InverseMass<f32, L, A>], dt: f64) {
        self.step = dt;
        for record in &mut self.records {
            let moves = |body: u32| masses[body as usize] != InverseMass::FIXED;
            if record.members().any(moves) {
                record.load = [[Vec3::ZERO; 2]; 2];
            }
        }
    }

    /// Breaks the joints whose load in the step has reached their [`Breaking`]. Returns them, with
    /// those that the step has [snapped](Self::snap).
    pub(crate) fn break_overloaded(&mut self) -> Vec<BrokenJoint> {
        let Self { records, acting, snapped, step, .. } = self;
        for &slot in acting.iter() {
            let record = &mut records[slot as usize];
            if !record.broken && record.strain(record.largest_load(), *step) >= 1.0 {
                record.broken = true;
                snapped.push(slot);
            }
        }
        let of = |joint: u32| {
            let load = records[joint as usize].largest_load();
            let [force, torque] = load.map(|own| own / *step);
            BrokenJoint { joint, force, torque }
        };
        snapped.drain(..).map(of).collect()
    }

    /// Returns the state of a joint after a step of `dt` \[s\].
    pub(crate) fn state<G: Geometry<L, A>>(
        &self,
        slot: usize,
        at: &BodyPlaces<'_, G, L, A>,
        dt: f64,
    ) -> JointState {
        let record = &self.records[slot];
        let places = record.places(|body| at.of(body));
        let velocity = |side: usize| match record.bodies[side] {
            WORLD => Velocity::ZERO,
            body => {
                let Velocity { linear, angular } = at.bodies.velocities[body as usize];
                Velocity { linear: in_space(linear), angular: in_space(angular) }
            }
        };
        let velocities = [velocity(0), velocity(1)];
        let frame = places.axes();
        let mut state = JointState { broken: record.broken, ..JointState::default() };
        for (index, axis) in record.axes.iter().enumerate() {
            let coordinate = RowCoordinate::Of(axis.coordinate);
            let found = places.evaluate(&coordinate, &frame);
            state.values.push(found.reading.turned(&record.turns[index]).0);
            let speeds = found.rows.iter().zip(&velocities).map(|(row, v)| row.dot(v));
            state.speeds.push(speeds.sum());
        }
        [state.gap, state.angle] = record.misses(&places);
        if dt > 0.0 {
            [state.force, state.torque] = record.largest_load().map(|own| own / dt);
        }
        state
    }

    /// Returns the largest miss of a position \[m\] and of a rotation \[rad\] over the joints that
    /// act.
    pub(crate) fn worst<G: Geometry<L, A>>(&self, at: &BodyPlaces<'_, G, L, A>) -> [f64; 2] {
        let mut worst = [0.0; 2];
        let acting = self.acting.iter().map(|&slot| &self.records[slot as usize]);
        for record in acting.filter(|record| !record.broken) {
            let places = record.places(|body| at.of(body));
            for (worst, own) in worst.iter_mut().zip(record.misses(&places)) {
                *worst = f64::max(*worst, own);
            }
        }
        worst
    }
}

/// Returns the members of a sorted list that another one lacks.
fn but_for<'a, T: Copy + Ord>(of: &'a [T], other: &'a [T]) -> impl Iterator<Item = T> + 'a {
    of.iter().copied().filter(|own| other.binary_search(own).is_err())
}

fn ascending([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Returns the bodies of a joint for the solver: the only one twice if the other is the world.
fn pair(record: &JointRecord) -> [u32; 2] {
    match record.bodies {
        [WORLD, b] => [b, b],
        [a, WORLD] => [a, a],
        both => both,
    }
}
