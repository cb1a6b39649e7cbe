//! [`Linkage`]: one mechanism in a substep: where its bodies are, and what its rows aim at.
//!
//! Linkages share no body that moves. So each is prepared and solved on a thread of its own.

use std::array::from_fn;

use drystone_solver::law::Interval;
use drystone_solver::mechanism::{MechanismPart, of_batch};
use drystone_solver::{Axis, InverseMass, Vector, Velocity};

use super::coordinates::{Evaluated, JointPlaces, Place, Turn, Vec3, cross};
use super::places::{flattened, in_space};
use super::record::{JointRecord, WORLD};
use super::rows::{Motion, Role, RowParams, RowPlan, RowState};
use super::tension::{self, Pulls};
use crate::bodies::{BodyView, Inertia};
use crate::geometry::{Geometry, PRECESS_LANES, Spin};
use crate::ledger::JointRow;
use crate::motion::{MovingBodies, SMALL_TURN};

/// Fraction of the gap of a lock that a substep repairs. \[1\]
pub(super) const REPAIR: f64 = 0.25;

/// Speed of repair beyond which joints are far from their places, over the largest one. \[1\]
const FAR: f64 = 0.05;

/// Largest number of rounds in which targets follow the solution, for bodies that turn fast.
const MOST_AIMS: usize = 4;

/// Change of targets over the least one, at which they follow no more. \[1\]
const DIVERGED: f64 = 2.0;

/// Miss at which a substep is taken whose targets did not find their path. \[m, or rad\]
const FAR_MISS: f64 = 5e-5;

/// Rotation of a body per substep beyond which the targets follow the path that the joints leave.
/// \[rad\]
const FAST_TURN: f32 = 0.005;

/// Cosine of the rotation of a line in a substep from which on its row has the direction at the end: 0.5 rad.
/// Steps are planned for 0.1 rad, and that damps. \[1\]
const FAR_COSINE: f64 = 0.88;

/// Largest difference of an angle from a straight path in a substep. \[rad\]
const MOST_CURVE: f64 = 0.3;

/// Largest stretch of a lock over the size of its mechanism. \[1\]
const MOST_STRETCH: f64 = 1e-5;

/// Size up to which a mechanism is a point. \[m\]
const POINT: f64 = 1e-6;

/// Relative error of the velocity along a row: velocities are rounded to `f32`. \[1\]
const ROUNDING: f64 = 1.0 / (1 << 23) as f64;

/// Error of velocities by rounding beyond which locks of bodies that turn fast are not stiffer. \[m/s\]
const RESIDUAL: f64 = 1e-3;

/// Parameters of a row before J is computed.
const NO_PARAMS: RowParams = RowParams {
    h: 0.0,
    mobility: 0.0,
    unit: 0.0,
    arm: 0.0,
    lever: 0.0,
    compliance: 0.0,
    repair: [0.0; 2],
    strongest: 0.0,
    is_turned: false,
};

/// Force of a motor or damper without a bound over the weight of its mechanism: a force that locks and
/// limits bear. \[1\]
const STRONGEST: f64 = 1e4;

/// A mechanism of a world, with all that its joints need in a substep.
#[derive(Clone, Debug)]
pub(crate) struct Linkage<const L: usize, const A: usize> {
    /// Slots of its joints, and copies of their records: their states are here during a part.
    pub(crate) slots: Vec<u32>,
    pub(crate) records: Vec<JointRecord>,
    /// Length of the step and of the substep. \[s\]
    pub(crate) step: f64,
    pub(crate) substep: f64,
    /// Slots of the joints that the part has broken within a substep.
    pub(crate) snapped: Vec<u32>,
    /// Its bodies, fixed ones included.
    pub(crate) members: Vec<u32>,
    /// By joint: its bodies, as indices of members.
    pub(crate) sides: Vec<[usize; 2]>,
    /// Its mass, 1 / weight and size. \[kg, 1/N, m\]
    pub(super) mass: f64,
    pub(super) compliance: f64,
    pub(super) size: f64,
    /// Places of the members, now and as they will be at the end of the substep.
    pub(super) here: Vec<Place>,
    ahead: Vec<Place>,
    /// Velocities of the members by which they will be there.
    pub(crate) expected: Vec<Velocity<f32, L, A>>,
    /// Members that precess on their way.
    spinning: Vec<usize>,
    /// By joint: the vectors from the centers of mass of its bodies to its frame in a. \[m\]
    pub(crate) arms: Vec<[Vec3; 2]>,
    /// By row.
    pub(crate) params: Vec<RowParams>,
    /// q of each row of a joint, and the angles with their turns of each axis. \[m, or rad\]
    values: Vec<f64>,
    turns: Vec<[f64; 2]>,
    /// True if it has springs, motors or friction. [Those that stand](super::rows) at the start of a substep
    /// and at its end, by the index of their joint; and by member the wrenches of springs. \[N s, N m s\]
    pub(crate) has_springs: bool,
    /// True if it has rows with a [line](RowPlan::has_line).
    has_lines: bool,
    pub(crate) springs: [Vec<(usize, JointRow<L, A>)>; 2],
    pub(crate) wrenches: Vec<Velocity<f64, L, A>>,
    /// Pulls: of each its member, its arm and the impulse \[m, N s\]; and those on each member.
    pulls: Vec<(usize, Vec3, Vec3)>,
    pulled: Vec<Pulls>,
    /// M^-1 of bodies to which pulls add inertia.
    pub(crate) true_masses: Vec<(u32, InverseMass<f32, L, A>)>,
    /// By member: true if it is dynamic and touches another body.
    pub(crate) touched: Vec<bool>,
    /// By member: true if it is dynamic and touches a body to which it is not joined.
    pub(crate) loaded: Vec<bool>,
    /// True if a body touches another one.
    pub(crate) touches: bool,
    /// True if a body moves when the part begins ([`MOVING`](crate::balance::MOVING)).
    pub(crate) moves: bool,
    /// True if it is solved to a tolerance together with its contacts.
    pub(crate) exact: bool,
    /// True if what its springs and motors give in a substep is bounded before joints bear it.
    pub(super) bounded: bool,
    /// True if the targets are to follow the path that the joints leave.
    pub(crate) aims: bool,
    /// True if joints are far from their places (`repair.rs`); and if repair moves bodies so far that they
    /// must not sleep. Laws and impulses of the rows meanwhile.
    pub(crate) is_apart: bool,
    pub(crate) repairs: bool,
    pub(super) kept: Vec<(Interval<f64>, f64)>,
    /// Largest change of a target when they were set last. \[m/s, or rad/s\]
    change: f64,
    /// Number of solves that targets have followed; targets of the last solve, those of the solve after
    /// which they changed least, and this change.
    followed: usize,
    targets: Vec<[f64; 2]>,
    best_targets: Vec<[f64; 2]>,
    least_change: f64,
    /// True if its locks [add energy](super::taming) in the substep.
    pub(crate) adds: bool,
}

/// The bodies that the targets of a linkage follow, and how far they may miss.
pub(crate) struct Aim<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) at: BodyView<'a, G, L, A>,
    /// Miss at the end of the substep at which targets follow no more. \[m, or rad\]
    pub(crate) least_miss: f64,
}

impl<const L: usize, const A: usize> Linkage<L, A> {
    /// Creates the linkage of a mechanism of this mass \[kg\] under `gravity` \[m/s^2\]. Its joints are in
    /// these `slots` among all `records`.
    pub(crate) fn new(
        part: &MechanismPart<'_, L, A>,
        (slots, records): (&[u32], &[JointRecord]),
        [mass, gravity]: [f64; 2],
    ) -> Self {
        let own = slots.iter().map(|&slot| records[slot as usize].clone());
        let (members, records) = (part.bodies().to_vec(), own.collect::<Vec<_>>());
        let (count, rows) = (members.len(), part.axes.len());
        Self {
            slots: slots.to_vec(),
            has_lines: records.iter().flat_map(|of| &of.rows).any(RowPlan::has_line),
            has_springs: records.iter().flat_map(|of| &of.rows).any(|row| row.role.may_stand()),
            records,
            step: 0.0,
            substep: 0.0,
            snapped: Vec::new(),
            members,
            sides: part.sides().collect(),
            mass,
            compliance: 1.0 / (mass * gravity),
            size: 0.0,
            here: vec![Place::ORIGIN; count],
            ahead: vec![Place::ORIGIN; count],
            expected: Vec::with_capacity(count),
            spinning: Vec::with_capacity(count),
            arms: Vec::with_capacity(part.joints.len()),
            params: vec![NO_PARAMS; rows],
            values: Vec::with_capacity(rows),
            turns: Vec::new(),
            pulls: Vec::with_capacity(2 * part.joints.len()),
            pulled: vec![Pulls::NONE; count],
            springs: [Vec::with_capacity(rows), Vec::with_capacity(rows)],
            wrenches: vec![Velocity::ZERO; count],
            true_masses: Vec::with_capacity(count),
            touched: vec![false; count],
            loaded: vec![false; count],
            touches: false,
            moves: false,
            exact: false,
            bounded: true,
            aims: false,
            is_apart: false,
            repairs: false,
            kept: Vec::with_capacity(rows),
            change: 0.0,
            followed: 0,
            targets: Vec::with_capacity(rows),
            best_targets: Vec::with_capacity(rows),
            least_change: f64::INFINITY,
            adds: false,
        }
    }

    /// Takes the states of its joints from the records of the world, for substeps of `h` in a step of
    /// `dt`. \[s\]
    pub(crate) fn load(&mut self, from: &[JointRecord], [dt, h]: [f64; 2]) {
        (self.step, self.substep) = (dt, h);
        for (own, &slot) in self.records.iter_mut().zip(&self.slots) {
            own.take_state(&from[slot as usize]);
        }
    }

    /// Gives the states back, for substeps of `h` \[s\].
    pub(crate) fn unload(&mut self, to: &mut [JointRecord], h: f64) {
        self.take_substep(h);
        for (own, &slot) in self.records.iter().zip(&self.slots) {
            to[slot as usize].take_state(own);
        }
    }

    /// Sets the length of the substep \[s\], and scales the impulses of the last one to it: forces last.
    pub(crate) fn take_substep(&mut self, h: f64) {
        let before = std::mem::replace(&mut self.substep, h);
        if before != h {
            self.records.iter_mut().for_each(|record| record.scale(h / before));
        }
    }

    /// Returns the states of its rows.
    pub(crate) fn states(&self) -> impl Iterator<Item = &RowState> {
        self.records.iter().flat_map(|record| &record.states)
    }

    /// Computes J, the coordinates and the compliances at the places of the bodies. A lock that carries
    /// the weight of the mechanism, or the largest force of its drives or turns if that is more, yields
    /// by `stretch` \[m\]. Repair is at most as fast as `speed`. \[m/s\]
    pub(crate) fn renew<G: Geometry<L, A>>(
        &mut self,
        at: &BodyView<'_, G, L, A>,
        part: &mut MechanismPart<'_, L, A>,
        [stretch, speed]: [f64; 2],
    ) {
        self.look(at);
        let Self { records, sides, here, arms, values, turns, .. } = self;
        arms.clear();
        let mut first = 0;
        for ((record, joint), &sides) in records.iter_mut().zip(part.joints).zip(&*sides) {
            let axes = &mut part.axes[first..first + joint.count as usize];
            first += axes.len();
            let places = places_of(record, sides, here);
            arms.push(places.centers.map(|center| places.frames[0].position - center));
            let frame = places.axes();
            values.clear();
            turns.clone_from(&record.turns);
            for (axis, plan) in axes.iter_mut().zip(&record.rows) {
                let found = places.evaluate(&plan.coordinate, &frame);
                let (value, turned) = found.reading.turned(&record.turns[plan.axis]);
                values.push(value);
                turns[plan.axis] = turned;
                axis.jacobian = row_of(record, &found);
            }
            record.count_turns(&places, turns);
            let unspun = record.counts_spin().then(|| places.unspun());
            record.states.iter_mut().zip(&*values).for_each(|(own, q)| own.value = *q);
            record.turns.copy_from_slice(turns);
            for (start, turn) in record.origin.start.iter_mut().zip(unspun.into_iter().flatten()) {
                start.turn = turn;
            }
        }
        self.soften(at, part, [self.substep, stretch, speed]);
        part.renew_prepared(at.masses);
    }

    /// Sets the parameters and compliances of the rows, whose J is known.
    fn soften<G: Geometry<L, A>>(
        &mut self,
        at: &BodyView<'_, G, L, A>,
        part: &mut MechanismPart<'_, L, A>,
        [h, stretch, speed]: [f64; 3],
    ) {
        self.params.clear();
        let ([low, high], has_loops) = (self.extent(at), self.has_loops(at));
        let mut axes = part.axes.iter();
        let places = self.sides.iter().zip(&self.arms);
        for ((joint, record), (sides, arms)) in part.joints.iter().zip(&self.records).zip(places) {
            let first = record.first_side();
            let anchor = self.here[sides[first]].position + arms[first];
            let reach = from_fn(|i| (anchor[i] - low[i]).max(high[i] - anchor[i]).max(0.0));
            let reach = Vector::<f64, 3>(reach).length();
            let own = joint.bodies.map(|body| at.inverse_mass(body).cast());
            let units: f64 = own.iter().map(|mass: &InverseMass<f64, L, A>| mass.linear).sum();
            let inverse = |body: u32| at.properties.inverse_moments(body as usize);
            self.params.extend(record.rows.iter().zip(&mut axes).map(|(plan, axis)| {
                let mobility = axis.mobility(&own);
                let unit = record.mobility_at_zero(plan, inverse).unwrap_or(mobility);
                let is_turn = axis.is_turn() && units > 0.0;
                let arm = if is_turn { (units / mobility).sqrt() } else { 1.0 };
                let lever = if is_turn && !has_loops { arm.max(reach) } else { arm };
                let repair = [REPAIR, speed / arm];
                let strongest = STRONGEST * h * arm / self.compliance;
                let mobilities = RowParams { h, mobility, unit, ..NO_PARAMS };
                RowParams { arm, lever, repair, strongest, ..mobilities }
            }));
        }
        debug_assert_eq!(self.params.len(), part.axes.len());
        self.is_apart = self.is_far([h, speed]);
        if self.is_apart {
            self.params.iter_mut().for_each(|params| params.repair[0] = 0.0);
        }
        self.size = self.size_with(at, high - low);
        let most = if self.size > POINT { MOST_STRETCH * self.size } else { stretch };
        let stretch = stretch.min(most);
        let loaded = self.drive_force().max(1.0 / self.compliance);
        let [turning, fastest] = self.turning(at);
        let rounding = (ROUNDING * fastest / RESIDUAL).powi(2);
        let roles = self.records.iter().flat_map(|record| &record.rows).map(|row| &row.role);
        for ((axis, params), role) in part.axes.iter_mut().zip(&mut self.params).zip(roles) {
            let under = |force: f64| REPAIR * stretch / (force * (h * params.lever).powi(2));
            let turning = under(turning).max(params.mobility * rounding);
            params.compliance = under(loaded).min(turning);
            axis.law.compliance = role.compliance(params);
            axis.prepare_for(params.mobility);
        }
    }

    /// Returns true if locks or limits are far from their places, for substeps of `h`, where repair is at
    /// most as fast as `speed`. \[s, m/s\]
    fn is_far(&self, [h, speed]: [f64; 2]) -> bool {
        let far =
            |((record, plan, state), params): ((&JointRecord, &RowPlan, &RowState), &RowParams)| {
                let miss = plan.role.miss(state.value);
                !record.broken
                    && params.mobility > 0.0
                    && miss * REPAIR / h > FAR * speed / params.arm
            };
        self.rows().zip(&self.params).any(far)
    }

    /// Gives each row the [law](Role::bearing_law) by which it bears what bodies gain in each substep.
    pub(crate) fn begin_bearing(&self, part: &mut MechanismPart<'_, L, A>) {
        let mut rows = part.axes.iter_mut().zip(&self.params);
        for record in &self.records {
            for (plan, state) in record.rows.iter().zip(&record.states) {
                let Some((axis, params)) = rows.next() else { break };
                axis.law = plan.role.bearing_law(state, params, record.broken);
                axis.impulse = 0.0;
            }
        }
    }

    /// Returns the rows, with their joints and states.
    pub(super) fn rows(&self) -> impl Iterator<Item = (&JointRecord, &RowPlan, &RowState)> {
        self.records.iter().flat_map(|record| {
            let own = record.rows.iter().zip(&record.states);
            own.map(move |(plan, state)| (record, plan, state))
        })
    }

    /// Returns true if joints make loops. Then loads depend on the compliances of locks.
    pub(super) fn has_loops<G: Geometry<L, A>>(&self, at: &BodyView<'_, G, L, A>) -> bool {
        let moving = self.members.iter().filter(|body| at.inverse_mass(**body).linear > 0.0);
        self.sides.len() > moving.count()
    }

    /// Returns the corners of the box around the centers of mass of its bodies that move. \[m\]
    pub(super) fn extent<G: Geometry<L, A>>(&self, at: &BodyView<'_, G, L, A>) -> [Vec3; 2] {
        let infinite = Vector([f64::INFINITY; 3]);
        let moving = self.members.iter().zip(&self.here);
        let moving = moving.filter(|(body, _)| at.inverse_mass(**body).linear > 0.0);
        moving.fold([infinite, -infinite], |[low, high], (_, Place { position, .. })| {
            let low = from_fn(|i| low[i].min(position[i]));
            [Vector(low), Vector(from_fn(|i| high[i].max(position[i])))]
        })
    }

    /// Returns the size of the mechanism whose centers of mass have this `extent`, with its longest arm and its
    /// largest body. \[m\]
    fn size_with<G: Geometry<L, A>>(&self, at: &BodyView<'_, G, L, A>, extent: Vec3) -> f64 {
        let mut size = extent.length();
        for (sides, arms) in self.sides.iter().zip(&self.arms) {
            for (&side, arm) in sides.iter().zip(arms) {
                let body = self.members[side];
                if at.inverse_mass(body).linear > 0.0 {
                    let reach = f64::from(at.properties.reach[body as usize].core);
                    size = size.max(arm.length()).max(reach);
                }
            }
        }
        size
    }

    /// Returns the largest force of a drive in the last substep. \[N\]
    ///
    /// Loads of locks would not do: those of a loop that its lengths cannot close grow with stiffness.
    fn drive_force(&self) -> f64 {
        let rows = self.records.iter().flat_map(|record| record.rows.iter().zip(&record.states));
        let drives =
            rows.zip(&self.params).filter(|((row, _), _)| matches!(row.role, Role::Drive(_)));
        let force = |((_, state), params): ((_, &RowState), &RowParams)| {
            state.solved.abs() / (params.h * params.arm)
        };
        drives.map(force).fold(0.0, f64::max)
    }

    /// Returns the largest force that keeps a body on its arc, m (|omega x (omega x r)| + |omega x v|)
    /// \[N\], and the largest speed \[m/s\]. r is the arm of a joint, v the velocity relative to the
    /// mechanism.
    fn turning<G: Geometry<L, A>>(&self, at: &BodyView<'_, G, L, A>) -> [f64; 2] {
        let moving = |body: u32| {
            let inverse = f64::from(at.inverse_mass(body).linear);
            (inverse > 0.0).then(|| (1.0 / inverse, at.velocity(body)))
        };
        let mut mean = Vec3::ZERO;
        for (mass, velocity) in self.members.iter().filter_map(|&body| moving(body)) {
            mean += in_space(velocity.linear) * (mass / self.mass);
        }
        let (mut largest, mut fastest) = (0.0f64, 0.0f64);
        for (sides, arms) in self.sides.iter().zip(&self.arms) {
            for (&side, arm) in sides.iter().zip(arms) {
                let Some((mass, velocity)) = moving(self.members[side]) else { continue };
                let omega = in_space(velocity.angular);
                let of_arm = cross(omega, cross(omega, *arm)).length();
                let of_path = cross(omega, in_space(velocity.linear) - mean).length();
                largest = largest.max(mass * (of_arm + of_path));
                let speed = in_space(velocity.linear).length() + omega.length() * arm.length();
                fastest = fastest.max(speed);
            }
        }
        [largest, fastest]
    }

    /// Returns the rotations of the bodies of a joint.
    pub(crate) fn turns_of(&self, joint: usize) -> [Turn; 2] {
        self.sides[joint].map(|side| self.here[side].turn)
    }

    /// Finds the places of the bodies. Those outside of the batch stay where they are.
    pub(crate) fn look<G: Geometry<L, A>>(&mut self, at: &BodyView<'_, G, L, A>) {
        for (place, &body) in self.here.iter_mut().zip(&self.members) {
            if at.index(body).is_some() {
                *place = at.of(body);
            }
        }
    }

    /// Gives rows whose [lines](RowPlan::has_line) turn [far](FAR_COSINE) in a substep the direction
    /// that they will have at its end, for bodies at the `prospective` velocities. A rope of 0.1 mm, or a cone of
    /// a milliradian, turns all around in a substep; so does what a body has passed. From where it was, a
    /// row would push aside what it is to hold: with h^2 F / (m l) > 4 that grows without end.
    pub(crate) fn turn_lines<G: Geometry<L, A>>(
        &mut self,
        (at, prospective): (&BodyView<'_, G, L, A>, &[Velocity<f32, L, A>]),
        part: &mut MechanismPart<'_, L, A>,
    ) {
        if !self.has_lines {
            return;
        }
        let rows = self.records.iter().flat_map(|of| of.rows.iter().zip(&of.states));
        for (axis, (plan, state)) in part.axes.iter_mut().zip(rows) {
            axis.impulse = if plan.has_line() { 0.0 } else { state.lasting() };
        }
        self.look(at);
        self.expect(at.first, prospective);
        part.apply(&mut self.expected, at.masses);
        self.look_ahead(at);
        let (mut axes, mut params) = (part.axes.iter_mut(), self.params.iter_mut());
        let mut turned = false;
        for ((record, joint), &sides) in self.records.iter().zip(part.joints).zip(&self.sides) {
            let own = joint.bodies.map(|body| at.inverse_mass(body).cast());
            let rows = record.rows.iter().zip(&record.states);
            for ((plan, state), (axis, params)) in rows.zip(axes.by_ref().zip(&mut params)) {
                axis.impulse = state.lasting();
                params.is_turned = false;
                if !plan.has_line() {
                    continue;
                }
                let then = places_of(record, sides, &self.ahead);
                let row = row_of(record, &then.evaluate(&plan.coordinate, &then.axes()));
                if !turns_far(&axis.jacobian, &row) {
                    continue;
                }
                axis.jacobian = row;
                (params.is_turned, turned) = (true, true);
                params.mobility = axis.mobility(&own);
                axis.law.compliance = plan.role.compliance(params);
                axis.prepare_for(params.mobility);
            }
        }
        if turned {
            part.renew_prepared(at.masses);
        }
    }

    /// Expects the bodies to move at these velocities of the bodies of a batch.
    pub(crate) fn expect(&mut self, first: usize, velocities: &[Velocity<f32, L, A>]) {
        self.expected.clear();
        self.expected.extend(self.members.iter().map(|&body| of_batch(velocities, first, body)));
    }

    /// Finds whether a body turns by more than [`FAST_TURN`] in a substep.
    pub(crate) fn is_fast<G: Geometry<L, A>>(&self, at: &BodyView<'_, G, L, A>) -> bool {
        self.turn(|body| at.velocity(body)) > FAST_TURN
    }

    /// Returns the largest rotation of its bodies in a substep at these velocities. \[rad\]
    pub(crate) fn turn(&self, velocity: impl Fn(u32) -> Velocity<f32, L, A>) -> f32 {
        let speeds = self.members.iter().map(|&body| velocity(body).angular.length());
        speeds.fold(0.0, f32::max) * self.substep as f32
    }

    /// Sets the targets of the rows for the expected velocities. Returns true if joints would miss
    /// their places with the targets before.
    pub(crate) fn set_targets<G: Geometry<L, A>>(
        &mut self,
        aim: &Aim<'_, G, L, A>,
        part: &mut MechanismPart<'_, L, A>,
    ) -> bool {
        self.look_ahead(&aim.at);
        self.change = 0.0;
        let mut first = 0;
        for ((record, joint), &sides) in self.records.iter().zip(part.joints).zip(&self.sides) {
            let rows = first..first + joint.count as usize;
            first = rows.end;
            let then = places_of(record, sides, &self.ahead);
            let velocities = sides.map(|side| self.expected[side].cast());
            let axes = &mut part.axes[rows.clone()];
            let change = set_targets(record, axes, &self.params[rows], (&then, &velocities));
            self.change = self.change.max(change);
        }
        self.change * self.substep > aim.least_miss
    }

    /// Solves the mechanism and lets the targets follow the path that it leaves ([`aim`](Self::aim)).
    pub(crate) fn follow<G: Geometry<L, A>>(
        &mut self,
        aim: &Aim<'_, G, L, A>,
        part: &mut MechanismPart<'_, L, A>,
    ) {
        loop {
            part.solve();
            self.expected.clear();
            self.expected.extend((0..self.members.len()).map(|index| part.velocity(index)));
            if !self.aim(aim, part) {
                break;
            }
        }
        self.begin_aims();
    }

    /// Returns true if the substep is too long: locks add energy, or bodies touch others and miss their places,
    /// since targets did not find the path that the joints leave.
    pub(crate) fn is_lost(&self) -> bool {
        let missed = self.least_change.is_finite() && self.least_change * self.substep > FAR_MISS;
        self.adds || self.touches && self.followed > MOST_AIMS && missed
    }

    /// Begins to [aim](Self::aim): the next solve is the first that targets follow.
    pub(crate) fn begin_aims(&mut self) {
        (self.followed, self.least_change) = (0, f64::INFINITY);
    }

    /// Lets the targets follow the path of a solve, for the velocities that it has found. Returns true if
    /// the mechanism is to be solved again. A light body that turns far within the substep may turn farther
    /// with each solve: then the last is for the targets that changed least.
    pub(crate) fn aim<G: Geometry<L, A>>(
        &mut self,
        aim: &Aim<'_, G, L, A>,
        part: &mut MechanismPart<'_, L, A>,
    ) -> bool {
        if self.followed > MOST_AIMS {
            return false;
        }
        self.followed += 1;
        self.targets.clear();
        self.targets.extend(part.axes.iter().map(|axis| axis.law.targets));
        if !self.set_targets(aim, part) {
            return false;
        }
        let is_best = self.change < self.least_change;
        if is_best {
            self.least_change = self.change;
            std::mem::swap(&mut self.targets, &mut self.best_targets);
        }
        if self.change < DIVERGED * self.least_change && self.followed <= MOST_AIMS {
            return true;
        }
        self.followed = MOST_AIMS + 1;
        if !is_best {
            for (axis, targets) in part.axes.iter_mut().zip(&self.best_targets) {
                axis.law.targets = *targets;
            }
        }
        true
    }

    /// Sets the places of the bodies after the substep at the expected velocities, rotating freely: as
    /// they will [advance](crate::motion::MovingBodies::advance) from `here`.
    fn look_ahead<G: Geometry<L, A>>(&mut self, at: &BodyView<'_, G, L, A>) {
        let Self { members, here, ahead, expected, spinning, substep, .. } = self;
        let (h, bodies) = (*substep, &at.properties);
        spinning.clear();
        for (index, &body) in members.iter().enumerate() {
            let (velocity, place) = (&expected[index], &mut ahead[index]);
            place.position = here[index].position + in_space(velocity.linear) * h;
            let turn = velocity.angular * h as f32;
            let precesses = bodies.precession[body as usize].rate > 0.0;
            if A == 3 && precesses && turn.dot(turn) > SMALL_TURN * SMALL_TURN {
                spinning.push(index);
            } else {
                place.turn = Turn::by(in_space(velocity.angular) * h).of(&here[index].turn);
            }
        }
        let rotation = |pose: &G::Pose| Turn::normalized(G::rotation(pose));
        let spin = |index: usize| {
            let body = members[index] as usize;
            let Inertia { moments, inverse_moments, .. } = &bodies.inertia[body];
            Spin {
                pose: at.poses[body - at.first],
                moments: [moments, inverse_moments],
                precession: bodies.precession[body],
                omega: expected[index].angular,
                remainder: at.spin_states[body - at.first].remainder,
            }
        };
        for spinning in spinning.chunks(PRECESS_LANES) {
            let all = std::array::from_fn(|lane| spin(spinning[lane.min(spinning.len() - 1)]));
            G::precess(&all, spinning.len(), h as f32, |lane, pose, _| {
                let index = spinning[lane];
                let back = rotation(&at.poses[members[index] as usize - at.first]).inverse();
                ahead[index].turn = rotation(&pose).of(&back).of(&here[index].turn);
            });
        }
    }

    /// Gives bodies that hang in pulling joints the inertia with which they follow the pull ([`tension`]),
    /// for the solve of the substep.
    pub(crate) fn stiffen<G: Geometry<L, A>>(
        &mut self,
        bodies: &mut MovingBodies<'_, G, L, A>,
        part: &mut MechanismPart<'_, L, A>,
    ) {
        self.find_pulls(&bodies.view(), part.axes);
        self.true_masses.clear();
        for (&body, pulled) in self.members.iter().zip(&self.pulled) {
            // A locked axis has no inertia to add to.
            if !bodies.properties.inertia[body as usize].turns_freely() {
                continue;
            }
            let Some(of) = pulled.stiffness() else { continue };
            let mass = bodies.view().mass(body).angular;
            let Some(surplus) = tension::surplus(&of, &mass, self.substep) else { continue };
            let mut stiffened = mass;
            for (own, more) in stiffened.0.iter_mut().zip(&surplus.0) {
                *own += *more;
            }
            let Some(inverse) = stiffened.inverse() else { continue };
            let index = body as usize - bodies.first;
            let masses = &mut bodies.masses[index];
            self.true_masses.push((body, *masses));
            masses.angular = inverse.cast();
            for velocity in [&mut bodies.velocities[index], &mut bodies.prospective[index]] {
                velocity.angular = (inverse * (mass * velocity.angular.cast())).cast();
            }
        }
        if !self.true_masses.is_empty() {
            part.renew(bodies.masses);
        }
    }

    /// Restores the inertia of the bodies that [`stiffen`](Self::stiffen) has changed.
    pub(crate) fn unstiffen<G: Geometry<L, A>>(&mut self, bodies: &mut MovingBodies<'_, G, L, A>) {
        for (body, masses) in self.true_masses.drain(..) {
            bodies.masses[body as usize - bodies.first] = masses;
        }
    }

    /// Finds the pulls of the joints on their bodies.
    fn find_pulls<G: Geometry<L, A>>(
        &mut self,
        at: &BodyView<'_, G, L, A>,
        axes: &[Axis<f64, L, A>],
    ) {
        self.pulls.clear();
        let mut axes = axes.iter();
        for ((record, sides), arms) in self.records.iter_mut().zip(&self.sides).zip(&self.arms) {
            let mut impulses = [Vec3::ZERO; 2];
            for (state, axis) in record.states.iter().zip(&mut axes) {
                let impulse = state.solved + state.relaxed;
                for (sum, jacobian) in impulses.iter_mut().zip(&axis.jacobian) {
                    (0..L).for_each(|i| sum[i] += jacobian.linear[i] * impulse);
                }
            }
            if record.bodies[0] == WORLD {
                impulses.swap(0, 1);
            }
            for (side, impulse) in impulses.into_iter().enumerate() {
                // An impact in one substep is no tension.
                let now = impulse.length();
                let before = std::mem::replace(&mut record.pulls[side], now);
                let lasting = if now > before { impulse * (before / now) } else { impulse };
                // No pull turns a body that cannot move.
                let body = record.bodies[side];
                if body != WORLD && at.inverse_mass(body) != InverseMass::FIXED {
                    self.pulls.push((sides[side], arms[side], lasting));
                }
            }
        }
        tension::find(&mut self.pulled, self.pulls.iter().copied());
    }
}

/// Returns the places of a joint whose bodies have these places.
#[inline(always)]
fn places_of<'a>(
    record: &'a JointRecord,
    sides: [usize; 2],
    of_members: &[Place],
) -> JointPlaces<'a> {
    let [a, b] = [0, 1].map(|side: usize| match record.bodies[side] {
        WORLD => Place::ORIGIN,
        _ => of_members[sides[side]],
    });
    record.places_at([a, b])
}

/// Returns J of a row of a joint for the bodies of its mechanism.
#[inline(always)]
fn row_of<const L: usize, const A: usize>(
    record: &JointRecord,
    found: &Evaluated,
) -> [Velocity<f64, L, A>; 2] {
    let mut row = [0, 1].map(|side: usize| match record.bodies[side] {
        WORLD => Velocity::ZERO,
        _ => flattened(&found.rows[side]),
    });
    if record.bodies[0] == WORLD {
        row.swap(0, 1);
    }
    row
}

/// Returns true if a row has turned [far](FAR_COSINE): the force of a length, the moment of an angle.
fn turns_far<const L: usize, const A: usize>(
    [from, _]: &[Velocity<f64, L, A>; 2],
    [to, _]: &[Velocity<f64, L, A>; 2],
) -> bool {
    let far = |product: f64, squares: f64| product < FAR_COSINE * squares.sqrt();
    if from.linear == Vector::ZERO && to.linear == Vector::ZERO {
        let squares = from.angular.dot(from.angular) * to.angular.dot(to.angular);
        return far(from.angular.dot(to.angular), squares);
    }
    far(from.linear.dot(to.linear), from.linear.dot(from.linear) * to.linear.dot(to.linear))
}

/// Sets the targets of the rows of a joint for bodies at these velocities, which will be at the places
/// `then`. Returns the largest change of a finite target. \[m/s, or rad/s\]
fn set_targets<const L: usize, const A: usize>(
    record: &JointRecord,
    axes: &mut [Axis<f64, L, A>],
    params: &[RowParams],
    (then, [a, b]): (&JointPlaces<'_>, &[Velocity<f64, L, A>; 2]),
) -> f64 {
    let mut change = 0.0f64;
    for (index, (axis, params)) in axes.iter_mut().zip(params).enumerate() {
        let (plan, value) = (&record.rows[index], record.states[index].value);
        let (end, _) = then.read(&plan.coordinate).turned(&record.turns[plan.axis]);
        let rate = axis.velocity(a, b);
        let straight = value + params.h * rate;
        // Beyond, an angle has passed a place where it is not defined.
        let is_lost =
            plan.coordinate.is_angle() && !params.is_turned && (end - straight).abs() > MOST_CURVE;
        let motion = Motion { value, end: if is_lost { straight } else { end }, rate };
        let law = plan.role.law(&motion, params);
        for (new, old) in law.targets.iter().zip(axis.law.targets) {
            let own = (new - old).abs();
            change = if own.is_finite() { change.max(own) } else { change };
        }
        axis.law = law;
        if record.broken {
            axis.law.bounds = [0.0; 2];
        }
    }
    change
}
