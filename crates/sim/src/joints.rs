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

use std::ops::Range;

use drystone_solver::mechanism::Mechanisms;
use drystone_solver::{Axis, InverseMass, Joint as SolverJoint, SymmetricMatrix, Vector, Velocity};

use crate::bodies::{Bodies, Inertia};
use crate::geometry::{Geometry, PRECESS_LANES, Spin};
use crate::ids::Slots;
use crate::joint::coordinates::{JointPlaces, Place, RowCoordinate, Turn, Vec3, cross};
use crate::joint::rows::{Motion, Role, RowParams, RowPlan};
use crate::joint::tension::{self, Tension};
use crate::joint::{Breaking, Coordinate, JointAxis, JointState};
use crate::ledger::JointRow;
use crate::motion::SMALL_TURN;
use crate::report::BrokenJoint;

/// Marks the world in the place of a body.
pub(crate) const WORLD: u32 = u32::MAX;

/// Least acceleration for the weight of a mechanism, which it has without gravity. \[m/s^2\]
const LEAST_GRAVITY: f64 = 9.81;

/// Fraction of the gap of a lock that a substep repairs. \[1\]
const REPAIR: f64 = 0.25;

/// Largest number of rounds in which targets follow the solution, for bodies that turn fast.
const MOST_AIMS: usize = 4;

/// Rotation of a body per substep beyond which the targets follow the path that the joints leave.
/// \[rad\]
const FAST_TURN: f32 = 0.005;

/// Largest miss of a joint at the end of a substep that is solved no more. \[m, or rad\]
const MOST_MISS: f64 = 1e-5;

/// Miss of a joint at which targets follow the path no more, in a solve to a tolerance. \[m, or rad\]
const LEAST_MISS: f64 = 1e-8;

/// Energy that the locks of a mechanism add in a substep, as a part of what it has, beyond which their
/// targets are wrong. \[1\]
const MOST_GAIN: f64 = 0.5;

/// Speed that locks may give a mechanism at rest. \[m/s\]
const LEAST_SPEED: f64 = 1.0;

/// Largest difference of an angle from a straight path in a substep. \[rad\]
const MOST_CURVE: f64 = 0.3;

/// Parameters of a row before J is computed.
const NO_PARAMS: RowParams = RowParams { h: 0.0, mobility: 0.0, compliance: 0.0, repair: [0.0; 2] };

/// A joint of a world.
#[derive(Clone, Debug)]
pub(crate) struct JointRecord {
    /// Slots of the bodies, or [`WORLD`].
    pub(crate) bodies: [u32; 2],
    /// Frames relative to the centers of mass, or in the world.
    pub(crate) frames: [Place; 2],
    /// Frames in the world when the bodies were joined.
    pub(crate) start: [Place; 2],
    pub(crate) axes: Vec<JointAxis>,
    pub(crate) rows: Vec<RowPlan>,
    pub(crate) states: Vec<RowState>,
    /// By axis: the angles of its coordinate with their turns. \[rad\]
    pub(crate) turns: Vec<[f64; 2]>,
    pub(crate) breaking: Breaking,
    pub(crate) collide: bool,
    pub(crate) enabled: bool,
    pub(crate) broken: bool,
    pub(crate) user_data: u128,
    /// (r . gamma)+ of both bodies in the last substep ([`tension`]). \[N m s\]
    pub(crate) pulls: [f64; 2],
    /// Impulse on a and its moment about the joint in this step, or in the last one.
    /// \[N s, N m s\]
    pub(crate) load: [Vec3; 2],
}

/// State of joints between two steps.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct SavedJoints {
    generations: Vec<u32>,
    broken: Vec<bool>,
    /// By joint: q and the impulses of each row, then the turns of each axis, its pulls and its load.
    pub(crate) numbers: Vec<f64>,
    last_step: f64,
}

/// State of a row between substeps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct RowState {
    /// q, with its turns. \[m, or rad\]
    pub(crate) value: f64,
    /// Impulses of the last solve and of the sweep that relaxed it. \[N s, or N m s\]
    pub(crate) solved: f64,
    pub(crate) relaxed: f64,
    /// Impulse of the solve before the last. \[N s, or N m s\]
    pub(crate) solved_before: f64,
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
    /// By acting joint: 1 / weight of its mechanism. \[1/N\]
    compliances: Vec<f64>,
    /// By acting joint: the vector from the center of mass of its first body to its frame in a. \[m\]
    arms: Vec<Vec3>,
    /// Joints that this step has broken.
    snapped: Vec<u32>,
    /// Length of this step. \[s\]
    step: f64,
    /// Parameters of each row of the mechanisms.
    params: Vec<RowParams>,
    /// Bodies of the joints that act, and the index of each body among them.
    members: Vec<u32>,
    indices: Vec<u32>,
    /// Their places, now and as they will be at the end of a substep.
    here: Vec<Place>,
    ahead: Vec<Place>,
    /// Velocities with the lasting impulses of the joints, without those of contacts.
    paths: Vec<Velocity<f32, L, A>>,
    /// By mechanism: its joints, among those that act.
    groups: Vec<Range<usize>>,
    /// By mechanism: whether a body touches another one.
    touches: Vec<bool>,
    /// By mechanism: whether its targets are to follow the path that its joints leave, and the
    /// largest change of its targets. \[m/s, or rad/s\]
    aims: Vec<bool>,
    changes: Vec<f64>,
    last_changes: Vec<f64>,
    /// Bodies that precess while targets look ahead.
    spinning: Vec<u32>,
    /// Pulls on each body ([`tension`]), and the inertia that they add to bodies.
    tensions: Vec<Tension>,
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

/// Where the bodies are: poses, and displacements since the search.
#[derive(Clone, Copy)]
pub(crate) struct BodyPlaces<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) bodies: &'a Bodies<G, L, A>,
    pub(crate) displacements: &'a [Velocity<f32, L, A>],
}

fn in_space<const N: usize>(vector: Vector<f32, N>) -> Vec3 {
    let mut out = Vec3::ZERO;
    for i in 0..N {
        // In the plane, rotation is about z.
        out[if N == 1 { 2 } else { i }] = f64::from(vector[i]);
    }
    out
}

/// Returns a pose as a place.
pub(crate) fn place<G: Geometry<L, A>, const L: usize, const A: usize>(pose: &G::Pose) -> Place {
    Place { position: in_space(G::frame(pose).position), turn: Turn::normalized(G::rotation(pose)) }
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> BodyPlaces<'_, G, L, A> {
    /// Returns the place of a center of mass and the axes of its body, or that of the world.
    pub(crate) fn of(&self, body: u32) -> Place {
        if body == WORLD {
            return Place::ORIGIN;
        }
        let (bodies, body) = (self.bodies, body as usize);
        let mut position = in_space(bodies.frames[body].position);
        position += in_space(bodies.position_remainders[body]);
        let mut turned = Vec3::ZERO;
        if let Some(moved) = self.displacements.get(body) {
            position += in_space(moved.linear);
            turned = in_space(moved.angular) - in_space(bodies.spin_states[body].followed);
        }
        let pose = Turn::normalized(G::rotation(&bodies.poses[body]));
        Place { position, turn: Turn::by(turned).of(&pose) }
    }
}

/// Returns the place of a body among these of members with these indices, or that of the world.
fn place_of(body: u32, places: &[Place], indices: &[u32]) -> Place {
    let index = indices.get(body as usize);
    index.map_or(Place::ORIGIN, |&index| places[index as usize])
}

/// Returns a row in the dimension of a world.
pub(crate) fn flattened<const L: usize, const A: usize>(
    row: &Velocity<f64, 3, 3>,
) -> Velocity<f64, L, A> {
    Velocity {
        linear: Vector(std::array::from_fn(|i| row.linear[i])),
        angular: Vector(std::array::from_fn(|i| row.angular[if A == 1 { 2 } else { i }])),
    }
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

    /// Finds the mechanisms of which a body touches another one.
    pub(crate) fn find_touching(&mut self, touches: impl Fn(u32) -> bool) {
        let groups = self.mechanisms.groups();
        self.touches.clear();
        self.touches.extend(groups.map(|(_, members)| members.iter().any(|&body| touches(body))));
    }

    /// Returns true if a body of a mechanism touches another one.
    pub(crate) fn touch(&self) -> bool {
        self.touches.contains(&true) && !self.is_idle()
    }

    /// Prepares for the joints that act.
    fn connect<G: Geometry<L, A>>(&mut self, bodies: &Bodies<G, L, A>, gravity: f64) {
        let Self { mechanisms, records, acting, pairs, compliances, params, .. } = self;
        let Self { members, indices, here, ahead, .. } = self;
        mechanisms.joints.clear();
        mechanisms.axes.clear();
        for (&slot, &bodies) in acting.iter().zip(&*pairs) {
            let first = mechanisms.axes.len() as u32;
            let rows = &records[slot as usize].rows;
            mechanisms.axes.extend(rows.iter().map(|_| Axis::IDLE));
            mechanisms.joints.push(SolverJoint { bodies, first, count: rows.len() as u32 });
        }
        mechanisms.connect(&bodies.inverse_masses);
        members.clear();
        members.extend(pairs.iter().flatten());
        members.sort_unstable();
        members.dedup();
        indices.clear();
        indices.resize(bodies.poses.len(), 0);
        (0..).zip(&*members).for_each(|(index, &body)| indices[body as usize] = index);
        here.resize(members.len(), Place::ORIGIN);
        ahead.resize(members.len(), Place::ORIGIN);
        params.clear();
        params.resize(mechanisms.axes.len(), NO_PARAMS);
        compliances.clear();
        self.groups.clear();
        self.groups.extend(mechanisms.groups().map(|(joints, _)| joints));
        for (joints, members) in mechanisms.groups() {
            let mass: f64 = members.iter().map(|&body| bodies.mass(body as usize).linear).sum();
            let weight = mass * gravity.max(LEAST_GRAVITY);
            compliances.extend(joints.map(|_| 1.0 / weight));
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
        self.look(at);
        let Self { mechanisms, records, acting, compliances, params, arms, .. } = self;
        let (here, indices) = (&self.here, &self.indices);
        let masses = &at.bodies.inverse_masses;
        arms.clear();
        for ((&slot, joint), softness) in acting.iter().zip(&mechanisms.joints).zip(compliances) {
            let record = &mut records[slot as usize];
            let places = record.places(|body| place_of(body, here, indices));
            let own = joint.bodies.map(|body| masses[body as usize].cast());
            let axes = &mut mechanisms.axes[joint.axes()];
            for (index, axis) in axes.iter_mut().enumerate() {
                let (plan, state) = (&record.rows[index], &mut record.states[index]);
                let found = places.evaluate(&plan.coordinate);
                (state.value, record.turns[plan.axis]) = found.turned(&record.turns[plan.axis]);
                axis.jacobian = [0, 1].map(|side| match record.bodies[side] {
                    WORLD => Velocity::ZERO,
                    _ => flattened(&found.rows[side]),
                });
                if record.bodies[0] == WORLD {
                    axis.jacobian.swap(0, 1);
                }
            }
            record.count_turns(&places);
            let side = usize::from(record.bodies[0] == WORLD);
            arms.push(places.frames[side].position - places.centers[side]);
            let unit: f64 = own.iter().map(|mass: &InverseMass<f64, L, A>| mass.linear).sum();
            for (axis, params) in axes.iter_mut().zip(&mut params[joint.axes()]) {
                let mobility = axis.mobility(&own);
                let scale = if axis.is_turn() && unit > 0.0 { mobility / unit } else { 1.0 };
                let compliance = REPAIR * stretch * *softness * scale / (h * h);
                let repair = [REPAIR, speed * scale.sqrt()];
                *params = RowParams { h, mobility, compliance, repair };
            }
            for ((axis, params), plan) in
                axes.iter_mut().zip(&params[joint.axes()]).zip(&record.rows)
            {
                axis.law.compliance = plan.role.compliance(params);
            }
        }
        mechanisms.renew(masses);
    }

    /// Sets the places of the bodies.
    fn look<G: Geometry<L, A>>(&mut self, at: &BodyPlaces<'_, G, L, A>) {
        for (place, &body) in self.here.iter_mut().zip(&self.members) {
            *place = at.of(body);
        }
    }

    /// Sets the places of the bodies after `h` \[s\] at these velocities, rotating freely: as they
    /// will [advance](crate::motion::MovingBodies::advance) from `here`. Leaves out mechanisms whose
    /// targets stay.
    fn look_ahead<G: Geometry<L, A>>(
        &mut self,
        at: &BodyPlaces<'_, G, L, A>,
        velocities: &[Velocity<f32, L, A>],
        h: f64,
    ) {
        let Self { mechanisms, indices, here, ahead, aims, spinning, .. } = self;
        let bodies = at.bodies;
        spinning.clear();
        let due = mechanisms.groups().zip(&*aims).filter(|(_, aims)| **aims);
        for &body in due.flat_map(|((_, members), _)| members) {
            let slot = body;
            let (body, index) = (body as usize, indices[body as usize] as usize);
            let (velocity, place) = (&velocities[body], &mut ahead[index]);
            place.position = here[index].position + in_space(velocity.linear) * h;
            let turn = velocity.angular * h as f32;
            let precesses = bodies.precession[body].rate > 0.0;
            if A == 3 && precesses && turn.dot(turn) > SMALL_TURN * SMALL_TURN {
                spinning.push(slot);
            } else {
                place.turn = Turn::by(in_space(velocity.angular) * h).of(&here[index].turn);
            }
        }
        let rotation = |pose: &G::Pose| Turn::normalized(G::rotation(pose));
        let spin = |body: u32| {
            let body = body as usize;
            let Inertia { moments, inverse_moments, .. } = &bodies.inertia[body];
            Spin {
                pose: bodies.poses[body],
                moments: [moments, inverse_moments],
                precession: bodies.precession[body],
                omega: velocities[body].angular,
                remainder: bodies.spin_states[body].remainder,
            }
        };
        for spinning in spinning.chunks(PRECESS_LANES) {
            let all = std::array::from_fn(|lane| spin(spinning[lane.min(spinning.len() - 1)]));
            G::precess(&all, spinning.len(), h as f32, |lane, pose, _| {
                let body = spinning[lane] as usize;
                let index = indices[body] as usize;
                let back = rotation(&bodies.poses[body]).inverse();
                ahead[index].turn = rotation(&pose).of(&back).of(&here[index].turn);
            });
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

    /// Computes (h S - I)+ / 2 of the bodies for which it is not zero ([`tension`]), for substeps of
    /// `h` \[s\].
    pub(crate) fn find_surpluses<G: Geometry<L, A>>(
        &mut self,
        at: &BodyPlaces<'_, G, L, A>,
        h: f64,
    ) {
        self.look(at);
        let Self { mechanisms, records, acting, tensions, here, indices, surpluses, .. } = self;
        let masses = &at.bodies.inverse_masses;
        tensions.clear();
        tensions.resize(at.bodies.poses.len(), Tension::default());
        for (&slot, joint) in acting.iter().zip(&mechanisms.joints) {
            let record = &mut records[slot as usize];
            let places = record.places(|body| place_of(body, here, indices));
            for (side, body) in record.bodies.into_iter().enumerate() {
                // No pull turns a body that cannot move.
                if body == WORLD || masses[body as usize] == InverseMass::FIXED {
                    continue;
                }
                let own = if record.bodies[0] == WORLD { 0 } else { side };
                let mut pull = Vec3::ZERO;
                for (axis, state) in mechanisms.axes[joint.axes()].iter().zip(&record.states) {
                    let impulse = state.solved + state.relaxed;
                    (0..L).for_each(|i| pull[i] += axis.jacobian[own].linear[i] * impulse);
                }
                let arm = places.frames[0].position - places.centers[side];
                // An impact in one substep is no tension.
                let now = arm.dot(pull).max(0.0);
                let before = std::mem::replace(&mut record.pulls[side], now);
                if now > 0.0 {
                    let lasting = pull * (now.min(before) / now);
                    tensions[body as usize].add(arm, lasting);
                }
            }
        }
        surpluses.clear();
        for (body, tension) in (0..).zip(&*tensions) {
            let Some(of) = tension.balanced() else { continue };
            let inertia = at.bodies.mass(body as usize).angular;
            surpluses.extend(tension::surplus(&of, &inertia, h).map(|own| (body, own)));
        }
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
        if self.is_idle() {
            return;
        }
        self.recall();
        self.mechanisms.apply(&mut bodies.velocities, &bodies.inverse_masses);
        let mut paths = std::mem::take(&mut self.paths);
        paths.clear();
        paths.extend_from_slice(prospective);
        self.mechanisms.apply(&mut paths, &bodies.inverse_masses);
        // Where contacts act, too, joints alone do not tell the path.
        for ((_, members), _) in
            self.mechanisms.groups().zip(&self.touches).filter(|(_, touches)| **touches)
        {
            members.iter().for_each(|&body| paths[body as usize] = prospective[body as usize]);
        }
        self.aims.clear();
        self.aims.resize(self.mechanisms.groups().count(), true);
        self.set_targets(&BodyPlaces { bodies, displacements }, &paths);
        self.paths = paths;
        self.find_fast(bodies);
        let least_miss = if exact { LEAST_MISS } else { MOST_MISS };
        if !exact {
            self.aims.iter_mut().zip(&self.touches).for_each(|(aims, touches)| *aims &= !touches);
        }
        let h = self.substep();
        self.last_changes.clear();
        self.last_changes.resize(self.aims.len(), f64::INFINITY);
        for _ in 0..MOST_AIMS {
            if !self.aims.contains(&true) {
                return;
            }
            // The path curves with the velocities that the joints leave.
            self.solve_aiming(&mut bodies.velocities);
            self.set_targets(&BodyPlaces { bodies, displacements }, &bodies.velocities);
            let misses = self.changes.iter().zip(&mut self.last_changes).map(|(change, before)| {
                *change < std::mem::replace(before, *change) && change * h > least_miss
            });
            self.aims.iter_mut().zip(misses).for_each(|(aims, misses)| *aims &= misses);
        }
    }

    /// Solves the mechanisms whose targets follow their paths.
    pub(crate) fn solve_aiming(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        let Self { mechanisms, aims, .. } = self;
        mechanisms.solve_those(|index| aims[index], velocities);
    }

    /// Sets the targets again where contacts have changed the paths of bodies that turn fast. Returns
    /// true if joints would then miss their places by more than [`MOST_MISS`].
    pub(crate) fn aim_again<G: Geometry<L, A>>(
        &mut self,
        bodies: &Bodies<G, L, A>,
        displacements: &[Velocity<f32, L, A>],
    ) -> bool {
        if !self.touches.contains(&true) {
            return false;
        }
        self.find_fast(bodies);
        self.aims.iter_mut().zip(&self.touches).for_each(|(aims, touches)| *aims &= touches);
        if self.aims.contains(&true) {
            self.set_targets(&BodyPlaces { bodies, displacements }, &bodies.velocities);
        }
        let h = self.substep();
        let misses = self.changes.iter().map(|change| change * h > MOST_MISS);
        self.aims.iter_mut().zip(misses).for_each(|(aims, misses)| *aims &= misses);
        self.aims.contains(&true)
    }

    /// Takes curve and repair out of the targets of mechanisms whose locks add energy to bodies that
    /// would move at the `prospective` velocities. Returns true if there are any.
    ///
    /// Rows of a net in one plane are nearly dependent: its links would need any speed to end on
    /// their places. Targets of zero add no energy.
    pub(crate) fn tame(
        &mut self,
        velocities: &[Velocity<f32, L, A>],
        prospective: &[Velocity<f32, L, A>],
        masses: &[InverseMass<f32, L, A>],
    ) -> bool {
        let mut aims = std::mem::take(&mut self.aims);
        aims.clear();
        aims.extend(self.mechanisms.groups().map(|(joints, members)| {
            let (mut energy, mut gain, mut mass) = (0.0, 0.0, 0.0);
            for &body in members {
                let own = masses[body as usize].cast::<f64>().mass();
                let [before, after] = [prospective, velocities]
                    .map(|all| 0.5 * own.squared(&all[body as usize].cast()));
                energy += before;
                gain += after - before;
                mass += own.linear;
            }
            let most = |speed: f64| MOST_GAIN * energy + 0.5 * mass * speed * speed;
            gain > most(LEAST_SPEED) && {
                let [work, speed] = self.work(joints, members, [prospective, velocities], masses);
                work.min(gain) > most(speed.max(LEAST_SPEED))
            }
        }));
        let Self { mechanisms, records, acting, groups, .. } = self;
        for joint in groups.iter().zip(&aims).filter(|(_, aims)| **aims).flat_map(|of| of.0.clone())
        {
            let rows = &records[acting[joint] as usize].rows;
            let axes = &mut mechanisms.axes[mechanisms.joints[joint].axes()];
            for (axis, _) in axes.iter_mut().zip(rows).filter(|(_, row)| row.role.is_rigid_lock()) {
                axis.law.targets = [0.0; 2];
            }
        }
        self.aims = aims;
        self.aims.contains(&true)
    }

    /// Returns the work of the rigid locks of these joints in the substep, gamma J (v + v') / 2 \[J\],
    /// and the greatest speed that a repair among them asks for. An angle turns all `members` about the
    /// joint. \[m/s\]
    fn work(
        &self,
        joints: Range<usize>,
        members: &[u32],
        [before, after]: [&[Velocity<f32, L, A>]; 2],
        masses: &[InverseMass<f32, L, A>],
    ) -> [f64; 2] {
        let (mut work, mut fastest) = (0.0, 0.0f64);
        let place = |body: u32| place_of(body, &self.here, &self.indices).position;
        for joint in joints {
            let record = &self.records[self.acting[joint] as usize];
            let of = &self.mechanisms.joints[joint];
            let [u, v] = [before, after].map(|all| of.bodies.map(|body| all[body as usize].cast()));
            let unit: f64 =
                of.bodies.map(|body| f64::from(masses[body as usize].linear)).iter().sum();
            for ((row, plan), state) in of.axes().zip(&record.rows).zip(&record.states) {
                let Role::Lock(value, None) = plan.role else { continue };
                let axis = &self.mechanisms.axes[row];
                work += 0.5
                    * axis.impulse
                    * (axis.velocity(&u[0], &u[1]) + axis.velocity(&v[0], &v[1]));
                let RowParams { h, mobility, repair: [share, most], .. } = self.params[row];
                let repaired = (share * (state.value - value) / h).abs().min(most);
                if mobility > 0.0 && repaired > 0.0 {
                    let mut reach = (unit / mobility).sqrt();
                    if axis.is_turn() {
                        let anchor = place(of.bodies[0]) + self.arms[joint];
                        let distances = members.iter().map(|&body| (place(body) - anchor).length());
                        reach += distances.fold(0.0, f64::max);
                    }
                    fastest = fastest.max(repaired * reach);
                }
            }
        }
        [work, fastest]
    }

    /// Returns the length of the substep. \[s\]
    fn substep(&self) -> f64 {
        self.params.first().map_or(0.0, |params| params.h)
    }

    /// Returns the largest angle by which an arm or an axis of a joint turns within `dt`
    /// \[s\]. \[rad\]
    pub(crate) fn largest_turn<G: Geometry<L, A>>(&self, bodies: &Bodies<G, L, A>, dt: f64) -> f64 {
        let mut fastest = 0.0f64;
        // Those that act are known to a world that has just been restored only later in the step.
        for (_, record) in self.taken().filter(|(_, own)| own.enabled && !own.broken) {
            let holds = record.rows.iter().any(|row| row.turns_with_axis());
            for (side, body) in record.bodies.into_iter().enumerate() {
                if body == WORLD {
                    continue;
                }
                let turn = Turn::normalized(G::rotation(&bodies.poses[body as usize]));
                let omega = in_space(bodies.velocities[body as usize].angular);
                let frame = &record.frames[side];
                let arm = turn.rotate(frame.position);
                let length = arm.length();
                if length > 0.0 {
                    fastest = fastest.max(cross(omega, arm).length() / length);
                }
                if holds {
                    let axis = turn.of(&frame.turn).rotate(Vector([1.0, 0.0, 0.0]));
                    fastest = fastest.max(cross(omega, axis).length());
                }
            }
        }
        fastest * dt
    }

    /// Lets the targets of mechanisms follow their paths if a body turns by more than [`FAST_TURN`]
    /// in a substep.
    fn find_fast<G: Geometry<L, A>>(&mut self, bodies: &Bodies<G, L, A>) {
        let h = self.substep() as f32;
        let is_fast = |body: &u32| {
            let omega = bodies.velocities[*body as usize].angular;
            omega.dot(omega) * h * h > FAST_TURN * FAST_TURN
        };
        let groups = self.mechanisms.groups();
        self.aims.clear();
        self.aims.extend(groups.map(|(_, members)| members.iter().any(is_fast)));
    }

    /// Sets the targets of the rows of mechanisms for a substep, where `aims` says so, and their
    /// `changes`.
    fn set_targets<G: Geometry<L, A>>(
        &mut self,
        at: &BodyPlaces<'_, G, L, A>,
        velocities: &[Velocity<f32, L, A>],
    ) {
        let h = self.substep();
        self.look_ahead(at, velocities, h);
        let Self { mechanisms, records, acting, params, indices, ahead, .. } = self;
        self.changes.clear();
        for (joints, &aims) in self.groups.iter().zip(&self.aims) {
            let mut change = 0.0f64;
            for index in joints.clone().filter(|_| aims) {
                let (record, joint) =
                    (&mut records[acting[index] as usize], mechanisms.joints[index]);
                let then = record.places(|body| place_of(body, ahead, indices));
                let velocities = joint.bodies.map(|body| velocities[body as usize].cast());
                let axes = &mut mechanisms.axes[joint.axes()];
                let own = record.set_targets(axes, &params[joint.axes()], (&then, &velocities));
                change = change.max(own);
            }
            self.changes.push(change);
        }
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

    /// Returns true if a joint that acts may break.
    pub(crate) fn may_break(&self) -> bool {
        self.acting.iter().any(|&slot| self.records[slot as usize].breaking != Breaking::NEVER)
    }

    /// Breaks the joints that the solve of a substep loads by more than their strength in the step.
    /// Returns true if there were any; then the substep is to be solved again.
    pub(crate) fn snap(
        &mut self,
        velocities: &mut [Velocity<f32, L, A>],
        masses: &[InverseMass<f32, L, A>],
    ) -> bool {
        let Self { mechanisms, records, acting, params, arms, snapped, step, .. } = self;
        let before = snapped.len();
        for ((&slot, joint), arm) in acting.iter().zip(&mechanisms.joints).zip(arms) {
            let record = &mut records[slot as usize];
            if record.broken || record.breaking == Breaking::NEVER || joint.count == 0 {
                continue;
            }
            let axes = &mut mechanisms.axes[joint.axes()];
            let load = record.load_by(axes, axes.iter().map(|axis| axis.impulse), *arm);
            // The solve may bear up to twice the load of its substep, and relaxing takes it back.
            let time = step.max(2.0 * params[joint.first as usize].h);
            if record.breaking.share(load, time) <= 1.0 {
                continue;
            }
            record.bear(load);
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

    /// Stores the impulses of the solve.
    pub(crate) fn keep_solved(&mut self) {
        self.keep(|state, impulse| {
            state.solved_before = std::mem::replace(&mut state.solved, impulse);
        });
    }

    /// Begins the relaxing: each row gets its law for the end of the substep, and no impulse. So every
    /// visit of joints and contacts in turn takes energy away. From the impulses of the last relaxing
    /// contacts would bear what joints then take back, and throw bodies whose contacts and joints bear
    /// against each other. J has been [renewed](Self::renew).
    pub(crate) fn begin_relaxing(&mut self) {
        let Self { mechanisms, records, acting, params, .. } = self;
        for (&slot, joint) in acting.iter().zip(&mechanisms.joints) {
            let record = &records[slot as usize];
            for (index, row) in joint.axes().enumerate() {
                let (plan, state) = (&record.rows[index], &record.states[index]);
                let (axis, h) = (&mut mechanisms.axes[row], params[row].h);
                axis.law = plan.role.relaxing_law(&axis.law, state.solved, state.value, h);
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
        let Self { mechanisms, records, acting, arms, .. } = self;
        for ((&slot, joint), arm) in acting.iter().zip(&mechanisms.joints).zip(arms) {
            let record = &mut records[slot as usize];
            let impulses = record.states.iter().map(|state| state.solved + state.relaxed);
            let load = record.load_by(&mechanisms.axes[joint.axes()], impulses, *arm);
            record.bear(load);
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
            let load = record.load.into_iter().flat_map(|of| of.0);
            let states = record.states.iter().flat_map(of);
            let turns = record.turns.iter().flatten().copied();
            states.chain(turns).chain(record.pulls).chain(load).collect::<Vec<_>>()
        };
        SavedJoints {
            generations: self.slots.generations().to_vec(),
            broken: self.taken().map(|(_, record)| record.broken).collect(),
            numbers: self.taken().flat_map(rows).collect(),
            last_step: self.last_step,
        }
    }

    /// Returns true if a state is one of these joints.
    pub(crate) fn fits(&self, from: &SavedJoints) -> bool {
        let numbers = |(_, record): (usize, &JointRecord)| {
            4 * record.states.len() + 2 * record.turns.len() + 8
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
            record.load = [0, 1].map(|_| Vector([next(), next(), next()]));
        }
        self.last_step = from.last_step;
        self.forget();
        self.find_separated();
    }

    /// Returns the rows of the joints that act, with their present impulses.
    pub(crate) fn ledger_rows(&self) -> impl Iterator<Item = JointRow<L, A>> {
        self.acting.iter().zip(&self.mechanisms.joints).flat_map(|(&slot, joint)| {
            let rows = &self.records[slot as usize].rows;
            let axes = &self.mechanisms.axes[joint.axes()];
            rows.iter().zip(axes).map(|(row, axis)| {
                let is_drive = matches!(row.role, Role::Drive(_));
                JointRow { bodies: joint.bodies, axis: *axis, is_drive }
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
                record.load = [Vec3::ZERO; 2];
            }
        }
    }

    /// Breaks the joints whose load in the step has reached their [`Breaking`]. Returns them, with
    /// those that the step has [snapped](Self::snap).
    pub(crate) fn break_overloaded(&mut self) -> Vec<BrokenJoint> {
        let Self { records, acting, snapped, step, .. } = self;
        for &slot in acting.iter() {
            let record = &mut records[slot as usize];
            if !record.broken && record.breaking.share(record.load, *step) >= 1.0 {
                record.broken = true;
                snapped.push(slot);
            }
        }
        let of = |joint: u32| {
            let [force, torque] = records[joint as usize].load.map(|load| load.length() / *step);
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
        let mut state = JointState { broken: record.broken, ..JointState::default() };
        for (index, axis) in record.axes.iter().enumerate() {
            let coordinate = RowCoordinate::Of(axis.coordinate);
            let found = places.evaluate(&coordinate);
            state.values.push(found.turned(&record.turns[index]).0);
            let speeds = found.rows.iter().zip(&velocities).map(|(row, v)| row.dot(v));
            state.speeds.push(speeds.sum());
        }
        [state.gap, state.angle] = record.misses(&places);
        if dt > 0.0 {
            [state.force, state.torque] = record.load.map(|load| load.length() / dt);
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

impl Breaking {
    /// Returns an impulse on a joint and its moment in a step of `dt` \[s\] over those that break
    /// it. \[1\]
    fn share(&self, [pull, turn]: [Vec3; 2], dt: f64) -> f64 {
        let pull = (pull.length() / (self.force * dt)).max(pull.length() / self.impulse);
        pull.max(turn.length() / (self.torque * dt))
    }
}

impl RowState {
    /// Returns the impulse of the last solve, as far as it is at most twice that of the one before.
    /// The impulse of an impact does not last. \[N s, or N m s\]
    fn lasting(&self) -> f64 {
        let most = 2.0 * self.solved_before.abs();
        self.solved.clamp(-most, most)
    }
}

impl JointRecord {
    /// Sets the targets of its rows for bodies at these velocities, which will be at the places
    /// `then`. Returns the largest change of a finite target. \[m/s, or rad/s\]
    fn set_targets<const L: usize, const A: usize>(
        &self,
        axes: &mut [Axis<f64, L, A>],
        params: &[RowParams],
        (then, [a, b]): (&JointPlaces, &[Velocity<f64, L, A>; 2]),
    ) -> f64 {
        let mut change = 0.0f64;
        for (index, (axis, params)) in axes.iter_mut().zip(params).enumerate() {
            let (plan, value) = (&self.rows[index], self.states[index].value);
            let (end, _) = then.evaluate(&plan.coordinate).turned(&self.turns[plan.axis]);
            let rate = axis.velocity(a, b);
            let straight = value + params.h * rate;
            // Beyond, an angle has passed a place where it is not defined.
            let is_lost = plan.coordinate.is_angle() && (end - straight).abs() > MOST_CURVE;
            let motion = Motion { value, end: if is_lost { straight } else { end }, rate };
            let law = plan.role.law(&motion, params);
            for (new, old) in law.targets.iter().zip(axis.law.targets) {
                let own = (new - old).abs();
                change = if own.is_finite() { change.max(own) } else { change };
            }
            axis.law = law;
            if self.broken {
                axis.law.bounds = [0.0; 2];
            }
        }
        change
    }

    /// Returns its places, where `of` returns those of its bodies.
    pub(crate) fn places(&self, of: impl Fn(u32) -> Place) -> JointPlaces {
        let [a, b] = self.bodies.map(of);
        JointPlaces {
            frames: [a.of(&self.frames[0]), b.of(&self.frames[1])],
            start: self.start,
            centers: [a.position, b.position],
        }
    }

    /// Counts the turns of axes without rows.
    fn count_turns(&mut self, places: &JointPlaces) {
        for (index, axis) in self.axes.iter().enumerate() {
            let has_row = || self.rows.iter().any(|row| row.axis == index);
            if axis.coordinate.counts_turns() && !has_row() {
                let found = places.evaluate(&RowCoordinate::Of(axis.coordinate));
                self.turns[index] = found.turned(&self.turns[index]).1;
            }
        }
    }

    /// Returns by how much its positions \[m\] and rotations \[rad\] miss their locks and limits.
    fn misses(&self, places: &JointPlaces) -> [f64; 2] {
        let mut out = [0.0f64; 2];
        let mut apart = 0.0;
        for plan in &self.rows {
            let found = places.evaluate(&plan.coordinate);
            let miss = plan.role.miss(found.turned(&self.turns[plan.axis]).0);
            match plan.coordinate {
                // Positions along three axes make one distance.
                RowCoordinate::Of(Coordinate::Linear(_)) => apart += miss * miss,
                RowCoordinate::Of(of) if !of.is_angle() => out[0] = out[0].max(miss),
                _ => out[1] = out[1].max(miss),
            }
        }
        [out[0].max(apart.sqrt()), out[1]]
    }

    /// Adds to its load in this step.
    fn bear(&mut self, load: [Vec3; 2]) {
        self.load.iter_mut().zip(load).for_each(|(sum, own)| *sum += own);
    }

    /// Returns its load by these impulses of its rows, at this arm from the center of mass of its
    /// first body. \[N s, N m s\]
    fn load_by<const L: usize, const A: usize>(
        &self,
        axes: &[Axis<f64, L, A>],
        impulses: impl Iterator<Item = f64>,
        arm: Vec3,
    ) -> [Vec3; 2] {
        let [mut pull, mut turn] = [Vec3::ZERO; 2];
        for (axis, impulse) in axes.iter().zip(impulses) {
            let Velocity { linear, angular } = axis.jacobian[0] * impulse;
            (0..L).for_each(|i| pull[i] += linear[i]);
            (0..A).for_each(|i| turn[if A == 1 { 2 } else { i }] += angular[i]);
        }
        let sign = if self.bodies[0] == WORLD { -1.0 } else { 1.0 };
        [pull * sign, (turn - cross(arm, pull)) * sign]
    }

    /// Returns its bodies, without the world.
    pub(crate) fn members(&self) -> impl Iterator<Item = u32> + '_ {
        self.bodies.iter().copied().filter(|body| *body != WORLD)
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
