//! [`Joints`]: the joints of a world. [`JointBatch`] has what the stages of a substep do with them.

use std::sync::Arc;

use drystone_solver::mechanism::Mechanisms;
use drystone_solver::thread_pool::ThreadPool;
use drystone_solver::{Axis, InverseMass, Joint as SolverJoint, Vector, Velocity};

use crate::bodies::{Bodies, BodyView};
use crate::geometry::Geometry;
use crate::ids::{Slots, sorted};
use crate::joint::coordinates::{RowCoordinate, Turn, Vec3};
use crate::joint::linkage::Linkage;
use crate::joint::places::in_space;
use crate::joint::record::{JointRecord, WORLD};
use crate::joint::rows::{Role, RowState};
use crate::joint::{Breaking, JointState, turning};
use crate::joint_batch::JointBatch;
use crate::ledger::JointRow;
use crate::motion::LEAST_GRAVITY;
use crate::report::BrokenJoint;

/// Time for which the largest rate of turning is held: pendulums swing faster. \[s\]
const HOLD: f64 = 4.0;

/// State of joints between two steps.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct SavedJoints {
    generations: Vec<u32>,
    broken: Vec<bool>,
    /// By joint: q and the impulses of each row, then the turns of each axis, its pulls and its load, and
    /// the frames from which a gear counts.
    pub(crate) numbers: Vec<f64>,
    last_step: f64,
    substep: f64,
    held: HeldRate,
}

/// The largest rate at which joints have turned of late. Substeps keep its length: with long ones into a fast
/// turn and short ones out of it mechanisms would lose energy.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct HeldRate {
    /// \[rad/s\]
    rate: f64,
    /// Time for which it is held still. \[s\]
    left: f64,
}

impl HeldRate {
    /// Takes the rate at the start of a step of `dt`, and returns the one that is held: `most` at most, so that
    /// a blow does not make all that follows slow. \[rad/s, s\]
    pub(crate) fn hold(&mut self, rate: f64, dt: f64, most: f64) -> f64 {
        self.left -= dt;
        let own = rate.min(most);
        if own >= self.rate || self.left <= 0.0 {
            *self = Self { rate: own, left: HOLD };
        }
        self.rate.min(most)
    }
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
    /// The sorted pairs of those whose bodies collide, in order.
    colliding: Vec<[u32; 2]>,
    /// Their rows, and the solver.
    pub(crate) mechanisms: Mechanisms<L, A>,
    /// The mechanisms in a substep.
    pub(crate) linkages: Vec<Linkage<L, A>>,
    /// Joints that this step has broken.
    snapped: Vec<u32>,
    /// Length of this step. \[s\]
    step: f64,
    /// Length of the substep, or of the last one. \[s\]
    substep: f64,
    /// True if the rows of the joints that act must be rebuilt.
    is_stale: bool,
    /// Length of the last step. \[s\]
    pub(crate) last_step: f64,
    pub(crate) held: HeldRate,
    /// Joints whose bodies do not collide.
    separated: JointPairs,
    /// Joints with locks whose bodies collide. Bodies that stand still are [`WORLD`].
    locked: JointPairs,
}

impl<const L: usize, const A: usize> Joints<L, A> {
    /// Returns true if there are joints, or have been.
    pub(crate) fn exist(&self) -> bool {
        !self.records.is_empty()
    }

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

    /// Returns the pairs of bodies of the joints that act.
    pub(crate) fn couplings(&self) -> &[[u32; 2]] {
        &self.pairs
    }

    /// Returns true if the joint of this index among those that act has a motor that runs.
    pub(crate) fn runs(&self, acting: usize) -> bool {
        let record = &self.records[self.acting[acting] as usize];
        record.rows.iter().any(|row| row.role.runs())
    }

    /// Returns the bodies of the mechanisms that [repair](crate::joint::repair) has moved last.
    pub(crate) fn repaired(&self) -> impl Iterator<Item = u32> + '_ {
        self.linkages.iter().filter(|of| of.repairs).flat_map(|of| of.members.iter().copied())
    }

    /// Returns true if joints are [far from their places](crate::joint::repair).
    pub(crate) fn are_apart(&self) -> bool {
        self.linkages.iter().any(|of| of.is_apart)
    }

    /// Adds the repair of joints far from their places to the targets of copies of all rows.
    pub(crate) fn ask_for_repair(&self, axes: &mut [Axis<f64, L, A>]) {
        let mut left = axes;
        for linkage in &self.linkages {
            let (own, later) = left.split_at_mut(linkage.params.len());
            left = later;
            linkage.ask_for_repair(own);
        }
    }

    /// Returns true if a joint keeps the shapes of two bodies from colliding.
    pub(crate) fn separates(&self, bodies: [u32; 2]) -> bool {
        !self.separated.between(bodies).is_empty()
    }

    /// Returns the joints with locks between two bodies that collide, with [`WORLD`] for bodies that
    /// stand still.
    pub(crate) fn locked_between(&self, bodies: [u32; 2]) -> &[([u32; 2], u32)] {
        self.locked.between(bodies)
    }

    /// Finds anew whether a joint separates the shapes of its bodies, and whether it holds contacts of
    /// theirs. Returns whether each of both has changed.
    pub(crate) fn pair(&mut self, slot: u32, is_static: impl Fn(u32) -> bool) -> [bool; 2] {
        let Self { slots, records, separated, locked, .. } = self;
        let record = &records[slot as usize];
        let acts = slots.is_taken(slot as usize) && record.enabled && !record.broken;
        let is_locked = || record.rows.iter().any(|row| row.role.is_rigid_lock());
        let before = !separated.between(record.bodies).is_empty();
        separated.set(record.bodies, slot, acts && !record.collide);
        let after = !separated.between(record.bodies).is_empty();
        let of = |body| if body != WORLD && is_static(body) { WORLD } else { body };
        let holds = acts && record.collide && is_locked();
        [before != after, locked.set(record.bodies.map(of), slot, holds)]
    }

    /// Returns true if joints hold contacts of a body ([`held_contacts`](crate::held_contacts)).
    pub(crate) fn has_locked(&self) -> bool {
        !self.locked.0.is_empty()
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
        let records = acting.iter().map(|&slot| &self.records[slot as usize]);
        let colliding = records.filter(|record| record.collide);
        self.colliding = colliding.map(|record| sorted(record.bodies)).collect();
        self.colliding.sort_unstable();
        self.acting = acting;
        self.connect(bodies, gravity);
        true
    }

    /// Sets the thread pool that works on the joints. Results do not depend on it.
    pub(crate) fn set_pool(&mut self, pool: Arc<ThreadPool>) {
        self.mechanisms.set_pool(pool);
    }

    /// Returns true if an acting joint joins these bodies, which collide.
    pub(crate) fn joins_colliding(&self, pair: [u32; 2]) -> bool {
        self.colliding.binary_search(&sorted(pair)).is_ok()
    }

    /// Finds the bodies that touch others, those of them that touch one to which they are not joined, and the
    /// mechanisms of which one touches another.
    pub(crate) fn find_touching(&mut self, touches: impl Fn(u32) -> [bool; 2]) {
        for linkage in &mut self.linkages {
            let marks = linkage.touched.iter_mut().zip(&mut linkage.loaded);
            for ((touched, loaded), &body) in marks.zip(&linkage.members) {
                [*touched, *loaded] = touches(body);
            }
            linkage.touches = linkage.touched.contains(&true);
        }
    }

    /// Returns true if a mechanism is solved to a tolerance with its contacts.
    pub(crate) fn any_exact(&self) -> bool {
        self.linkages.iter().any(|linkage| linkage.exact)
    }

    /// Returns the bodies of the mechanisms that are solved to a tolerance.
    pub(crate) fn exact_members(&self) -> impl Iterator<Item = u32> {
        let exact = self.linkages.iter().filter(|linkage| linkage.exact);
        exact.flat_map(|linkage| linkage.members.iter().copied())
    }

    /// Returns true if a body of a mechanism touches another one.
    pub(crate) fn touch(&self) -> bool {
        self.linkages.iter().any(|linkage| linkage.touches)
    }

    /// Returns the joints that act as one batch.
    pub(crate) fn batch(&mut self) -> JointBatch<'_, L, A> {
        JointBatch { mechanisms: self.mechanisms.batch(), linkages: &mut self.linkages }
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
        let mut left = acting.as_slice();
        for part in mechanisms.batch().parts() {
            let masses = part.bodies().iter().map(|&body| bodies.mass(body as usize).linear);
            let numbers = [masses.sum(), gravity.max(LEAST_GRAVITY)];
            let (slots, later) = left.split_at(part.joints.len());
            left = later;
            linkages.push(Linkage::new(&part, (slots, records), numbers));
        }
    }

    /// Begins a part with substeps of `h` \[s\]: the mechanisms take the states of their joints.
    pub(crate) fn begin_part(&mut self, h: f64) {
        let before = std::mem::replace(&mut self.substep, h);
        if before != h && before != 0.0 {
            self.records.iter_mut().for_each(|record| record.scale(h / before));
        }
        let Self { linkages, records, step, .. } = self;
        linkages.iter_mut().for_each(|linkage| linkage.load(records, [*step, h]));
    }

    /// Ends a part: the mechanisms give the states of their joints back.
    pub(crate) fn end_part(&mut self) {
        let Self { linkages, records, substep, snapped, .. } = self;
        for linkage in linkages {
            linkage.unload(records, *substep);
            snapped.append(&mut linkage.snapped);
        }
    }

    /// Returns the largest angle by which joints turn within `dt` \[s\]; any angle up to `least` if none
    /// is larger ([`turning`]). `gravity` is the length of its acceleration. \[rad, m/s^2\]
    pub(crate) fn largest_turn<G: Geometry<L, A>>(
        &self,
        at: &BodyView<'_, G, L, A>,
        [dt, least]: [f64; 2],
        gravity: f64,
    ) -> f64 {
        // Those that act are known to a world that has just been restored only later in the step.
        let acting = self.taken().filter(|(_, own)| own.enabled && !own.broken);
        let rate = |(_, record)| turning::rate(record, at, [Turn::NONE; 2], [dt, least], gravity);
        acting.map(rate).fold(0.0, f64::max) * dt
    }

    /// Returns true if a joint that acts may break.
    pub(crate) fn may_break(&self) -> bool {
        self.acting.iter().any(|&slot| self.records[slot as usize].breaking != Breaking::NEVER)
    }

    /// Returns the joints that earlier parts of the step have broken within substeps.
    pub(crate) fn broken_before(&self) -> &[u32] {
        &self.snapped
    }

    /// Returns the number of joints that the step has broken so far within substeps.
    pub(crate) fn snapped(&self) -> usize {
        self.snapped.len() + self.linkages.iter().map(|of| of.snapped.len()).sum::<usize>()
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
            let spins = record.counts_spin().then_some(record.origin.start);
            let spins = spins.into_iter().flatten().flat_map(|start| start.turn.0);
            states.chain(turns).chain(record.pulls).chain(load).chain(spins).collect::<Vec<_>>()
        };
        SavedJoints {
            generations: self.slots.generations().to_vec(),
            broken: self.taken().map(|(_, record)| record.broken).collect(),
            numbers: self.taken().flat_map(rows).collect(),
            last_step: self.last_step,
            substep: self.substep,
            held: self.held,
        }
    }

    /// Returns true if a state is one of these joints.
    pub(crate) fn fits(&self, from: &SavedJoints) -> bool {
        let numbers = |(_, record): (usize, &JointRecord)| {
            let spins = if record.counts_spin() { 8 } else { 0 };
            4 * record.states.len() + 2 * record.turns.len() + 14 + spins
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
            if record.counts_spin() {
                for start in &mut record.origin.start {
                    start.turn = Turn([next(), next(), next(), next()]);
                }
            }
        }
        (self.last_step, self.substep, self.held) = (from.last_step, from.substep, from.held);
        self.forget();
    }

    /// Returns the rows of the joints that act, with their present impulses.
    pub(crate) fn ledger_rows(&self) -> impl Iterator<Item = JointRow<L, A>> {
        self.acting.iter().zip(&self.mechanisms.joints).flat_map(|(&slot, joint)| {
            let rows = &self.records[slot as usize].rows;
            let axes = &self.mechanisms.axes[joint.axes()];
            rows.iter().zip(axes).map(move |(row, axis)| {
                let is_drive = matches!(row.role, Role::Drive(_));
                JointRow { bodies: joint.bodies, axis: *axis, is_drive }
            })
        })
    }

    /// Returns the rows of the springs that have stood in the substep, with what they give at its end.
    pub(crate) fn spring_rows(&self) -> impl Iterator<Item = JointRow<L, A>> {
        self.linkages.iter().flat_map(|of| of.springs.iter().flatten()).map(|(_, row)| row.clone())
    }

    /// Returns true if pulls have added inertia to a body in the substep.
    pub(crate) fn are_stiffened(&self) -> bool {
        self.linkages.iter().any(|of| !of.true_masses.is_empty())
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
        at: &BodyView<'_, G, L, A>,
        dt: f64,
    ) -> JointState {
        let record = &self.records[slot];
        let places = record.places(|body| at.of(body));
        let velocity = |side: usize| match record.bodies[side] {
            WORLD => Velocity::ZERO,
            body => {
                let Velocity { linear, angular } = at.velocity(body);
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
    pub(crate) fn worst<G: Geometry<L, A>>(&self, at: &BodyView<'_, G, L, A>) -> [f64; 2] {
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

/// Joints by their bodies, in ascending order.
#[derive(Clone, Debug, Default)]
struct JointPairs(Vec<([u32; 2], u32)>);

impl JointPairs {
    /// Returns the joints between two bodies.
    fn between(&self, [a, b]: [u32; 2]) -> &[([u32; 2], u32)] {
        let bodies = [a.min(b), a.max(b)];
        let first = self.0.partition_point(|(own, _)| *own < bodies);
        let count = self.0[first..].partition_point(|(own, _)| *own == bodies);
        &self.0[first..first + count]
    }

    /// Sets whether a joint is in the list. Returns true if that has changed.
    fn set(&mut self, [a, b]: [u32; 2], slot: u32, is_in: bool) -> bool {
        let entry = ([a.min(b), a.max(b)], slot);
        match self.0.binary_search(&entry) {
            Ok(at) if !is_in => {
                self.0.remove(at);
                true
            }
            Err(at) if is_in => {
                self.0.insert(at, entry);
                true
            }
            _ => false,
        }
    }
}

/// Returns the bodies of a joint for the solver: the only one twice if the other is the world.
fn pair(record: &JointRecord) -> [u32; 2] {
    match record.bodies {
        [WORLD, b] => [b, b],
        [a, WORLD] => [a, a],
        both => both,
    }
}
