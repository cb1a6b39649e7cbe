//! [`World`]: bodies, their contacts, and the functions that change and read them. The time step is
//! in [`step`](crate::step).

mod checkpoint;

pub use checkpoint::{Checkpoint, CheckpointError};

use std::sync::{Arc, OnceLock};

use drystone_solver::thread_pool::ThreadPool;
use drystone_solver::{Clock, InverseMass, System, Vector, Velocity};

use crate::balance::Balance;
use crate::bodies::{Bodies, Body, Inertia, SpinState, SurfaceVelocity};
use crate::body::Motion;
use crate::broad_phase::BroadPhase;
use crate::cache::ContactCache;
use crate::colliders::{Colliders, Definitions};
use crate::geometry::{Geometry, MassProperties};
use crate::ids::{self, BodyId, ColliderId, JointId, put};
use crate::input::{self, InputError};
use crate::joint::record::JointRecord;
use crate::report::Measure;
use crate::saved::SavedSystem;
use crate::settings::StepSettings;
use crate::sleep::Sleep;
use crate::solving::ConstraintSolver;
use crate::step_scratch::StepScratch;
use crate::tuner::ThreadTuner;

/// Largest number of threads per processor.
const MOST_THREADS: usize = 4;

/// Bodies and their contacts in the dimension of `G`.
///
/// [`World::pose`] and [`World::velocity`] return the state of a body, [`World::write_poses`] the
/// poses of all. [`World::move_to`] moves kinematic bodies. A force of [`World::add_force`] acts
/// for one step.
///
/// # Method
///
/// Each substep of length h computes the impulses γ of all contacts together:
///
/// ```text
/// v*  =  v + h (g + M⁻¹ f)                     forces                            Stage::Predict
/// 0 ≤ γ  ⊥  A γ + ε γ − b ≥ 0                  contacts push or separate         Stage::Solve
///     A = J M⁻¹ Jᵀ,   b = t − J v*
///     |γ_t| ≤ μ γ_n                            friction at each point
/// v⁺  =  v* + M⁻¹ Jᵀ γ                         velocities                        Stage::Solve
/// x⁺  =  x + h v⁺                              positions                         Stage::Advance
/// ```
///
/// J v are the velocities at the contacts. The targets t come from bounces, the repair of overlaps,
/// and gaps that may close. ε is the compliance. The crate [`drystone_solver`] solves this problem;
/// it knows no shapes and no time.
///
/// With a [`tolerance`](StepSettings::tolerance), each substep is solved until
///
/// ```text
/// √(G / m) ≤ tolerance,   (v − v_exact)ᵀ M (v − v_exact) ≤ G
/// ```
///
/// for each island, with its mass m. G is computed from v and γ alone.
/// [`drystone_solver::certificate`] proves this bound, and one for v that do not follow from γ.
/// With friction, v_exact is the exact solution for the current slips.
///
/// [`World::join`] adds joints. Their rows have bounds on both sides, lo ≤ γ ≤ hi. All joints that
/// connect bodies are solved as one block ([`drystone_solver::mechanism`], Stage::Joints).
///
/// # State
///
/// Checkpoints hold the state of `bodies`, `colliders`, `broad_phase`, `contacts`, `sleep` and
/// `solver`.
pub struct World<G: Geometry<L, A>, const L: usize, const A: usize> {
    /// Settings of the following steps.
    pub settings: StepSettings,
    /// Acceleration of gravity. \[m/s^2\]
    pub gravity: Vector<f32, L>,
    /// Number that distinguishes identifiers of this world from those of other worlds.
    id: u32,
    pub(crate) bodies: Bodies<G, L, A>,
    pub(crate) colliders: Colliders<G, L, A>,
    /// Copy of bodies, colliders and joints for checkpoints. Reset when either is added, removed or
    /// redefined.
    definitions: OnceLock<Arc<Definitions<G, L, A>>>,
    pub(crate) broad_phase: BroadPhase<L>,
    pub(crate) contacts: ContactCache<L>,
    pub(crate) sleep: Sleep<L>,
    pub(crate) solver: ConstraintSolver<L, A>,
    pub(crate) scratch: StepScratch<G, L, A>,
    pub(crate) execution: Execution<L, A>,
}

/// Threads, clock and recorded data of steps. Results do not depend on them.
pub(crate) struct Execution<const L: usize, const A: usize> {
    pub(crate) pool: Arc<ThreadPool>,
    pub(crate) tuner: ThreadTuner,
    pub(crate) clock: Clock,
    /// True if steps measure the time of their stages.
    pub(crate) timing: bool,
    /// True if steps save the contacts and joints of their last substep.
    pub(crate) saving: bool,
    /// True if steps record the impulses of their contacts.
    pub(crate) recording: bool,
    /// Saved contacts and joints, as [`World::saved`] returns them.
    pub(crate) saved: Option<SavedSystem<L, A>>,
}

impl<const L: usize, const A: usize> Execution<L, A> {
    /// Keeps the system of an earlier part of the step if contacts bounced there and not since.
    pub(crate) fn keep_impacts(&mut self, earlier: Option<SavedSystem<L, A>>) {
        let bounced = self.saved.as_ref().is_some_and(SavedSystem::has_impacts);
        if let Some(earlier) = earlier.filter(|earlier| !bounced && earlier.has_impacts()) {
            self.saved = Some(earlier);
        }
    }
}

impl<const L: usize, const A: usize> Default for Execution<L, A> {
    /// One thread and the system clock; no times and no systems are recorded.
    fn default() -> Self {
        Self {
            pool: Arc::default(),
            tuner: ThreadTuner::default(),
            clock: Clock::system(),
            timing: false,
            saving: false,
            recording: false,
            saved: None,
        }
    }
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Creates an empty world without gravity, on one thread.
    pub fn new(settings: StepSettings) -> Self {
        Self {
            settings,
            gravity: Vector::ZERO,
            id: ids::new_world(),
            bodies: Bodies::new(),
            colliders: Colliders::new(),
            definitions: OnceLock::new(),
            broad_phase: BroadPhase::new(),
            contacts: ContactCache::default(),
            sleep: Sleep::default(),
            solver: ConstraintSolver::default(),
            scratch: StepScratch::default(),
            execution: Execution::default(),
        }
    }

    /// Sets the number of threads, at most four per processor. Uses fewer if the system grants
    /// fewer, and one without the feature `threads`. Results do not depend on it.
    pub fn set_threads(&mut self, threads: usize) {
        let most = MOST_THREADS * ThreadPool::processors();
        let threads = threads.clamp(1, most);
        if threads != self.execution.pool.threads() {
            self.execution.pool = Arc::new(ThreadPool::new(threads));
            self.solver.lanes.set_pool(Arc::clone(&self.execution.pool));
            self.solver.joints.set_pool(Arc::clone(&self.execution.pool));
            self.execution.tuner = ThreadTuner::default();
        }
    }

    /// Adds a body ([`World::add`]).
    pub(crate) fn insert(&mut self, body: Body<G, L, A>) -> Result<BodyId, InputError> {
        let inertia = match (body.motion, body.inertia) {
            (Motion::Dynamic, Some(inertia)) => inertia,
            (Motion::Dynamic, None) => {
                let solid = body.colliders.iter().fold(MassProperties::ZERO, |sum, collider| {
                    let own = G::mass(&collider.shape, collider.density);
                    sum.joined(&own.placed(&G::frame(&collider.pose)))
                });
                Inertia::of(&solid)
            }
            _ => Inertia::FIXED,
        };
        input::check_body(&body, &inertia)?;
        let slot = self.bodies.insert(&body, inertia);
        self.definitions = OnceLock::new();
        let moves = body.motion != Motion::Static;
        let velocity = if moves { body.velocity } else { Velocity::ZERO };
        put(&mut self.bodies.velocities, slot, velocity);
        let inverse_mass = self.bodies.inverse_mass(slot);
        put(&mut self.bodies.inverse_masses, slot, inverse_mass);
        put(&mut self.bodies.contact_gains, slot, Velocity::ZERO);
        put(&mut self.bodies.balances, slot, Balance::NEW);
        self.sleep.reset(slot);
        if body.motion != Motion::Dynamic {
            self.sleep.mark_placed(slot);
        }
        let to_center = G::pose(-inertia.center, &[]);
        for collider in body.colliders {
            let local = G::compose(&to_center, &collider.pose);
            self.colliders.add(slot, collider, local, &self.bodies, &mut self.broad_phase);
        }
        self.colliders.set_surface_velocity(slot, body.surface_velocity, to_center);
        Ok(BodyId::new(&self.bodies.slots, slot, self.id))
    }

    /// Removes a body ([`World::remove`]).
    pub(crate) fn take_out(&mut self, id: BodyId) -> bool {
        let Some(slot) = self.index(id) else { return false };
        self.wake_neighbors(slot);
        self.drop_joints_of(slot);
        self.sleep.placed.retain(|&placed| placed as usize != slot);
        self.colliders.remove(slot, &mut self.broad_phase);
        self.bodies.remove(slot);
        self.definitions = OnceLock::new();
        self.bodies.velocities[slot] = Velocity::ZERO;
        self.bodies.inverse_masses[slot] = InverseMass::FIXED;
        self.bodies.contact_gains[slot] = Velocity::ZERO;
        true
    }

    /// Returns the number that identifiers of this world have.
    pub(crate) fn id(&self) -> u32 {
        self.id
    }

    /// Makes the next checkpoint copy bodies and colliders again.
    pub(crate) fn definitions_changed(&mut self) {
        self.definitions = OnceLock::new();
    }

    /// Returns the slot of a body, or `None` if the body is unknown.
    fn index(&self, id: BodyId) -> Option<usize> {
        id.slot(&self.bodies.slots, self.id)
    }

    /// Returns the slot of a body, or an error if the body is unknown.
    pub(crate) fn known(&self, id: BodyId) -> Result<usize, InputError> {
        self.index(id).ok_or(InputError::UnknownBody)
    }

    /// Returns the slot of a body that is not static.
    fn moving(&self, id: BodyId) -> Result<usize, InputError> {
        let slot = self.known(id)?;
        let is_static = self.bodies.motion[slot] == Some(Motion::Static);
        if is_static { Err(InputError::Static) } else { Ok(slot) }
    }

    /// Returns the body in a slot, if any.
    pub fn body_at(&self, slot: usize) -> Option<BodyId> {
        let slots = &self.bodies.slots;
        let taken = slot < slots.len() && slots.is_taken(slot);
        taken.then(|| BodyId::new(slots, slot, self.id))
    }

    /// Returns all bodies in the order of their slots.
    pub fn bodies(&self) -> impl Iterator<Item = BodyId> + '_ {
        (0..self.len()).filter_map(|slot| self.body_at(slot))
    }

    /// Returns the collider in a slot, if there is one.
    pub fn collider_at(&self, slot: usize) -> Option<ColliderId> {
        let slots = &self.colliders.slots;
        let taken = slot < slots.len() && slots.is_taken(slot);
        taken.then(|| ColliderId::new(slots, slot, self.id))
    }

    /// Returns the colliders of a body in reverse order of addition.
    pub fn colliders(&self, id: BodyId) -> impl Iterator<Item = ColliderId> + '_ {
        let colliders = self.index(id).map(|slot| self.colliders.of_body(slot));
        colliders
            .into_iter()
            .flatten()
            .map(|slot| ColliderId::new(&self.colliders.slots, slot as usize, self.id))
    }

    /// Returns the body of a collider.
    pub fn body_of(&self, id: ColliderId) -> Option<BodyId> {
        let slot = id.slot(&self.colliders.slots, self.id)?;
        self.body_at(self.colliders.body[slot] as usize)
    }

    /// Returns the [`Body::user_data`] of a body.
    pub fn user_data(&self, id: BodyId) -> Option<u128> {
        self.index(id).map(|slot| self.bodies.user_data[slot])
    }

    /// Returns the [`Collider::user_data`](crate::Collider::user_data) of a collider.
    pub fn collider_user_data(&self, id: ColliderId) -> Option<u128> {
        id.slot(&self.colliders.slots, self.id).map(|slot| self.colliders.user_data[slot])
    }

    /// Returns the number of body slots, free ones included. Body indices are less than this
    /// number.
    pub fn len(&self) -> usize {
        self.bodies.poses.len()
    }

    /// Returns true if the world has never had a body.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the pose of a body's origin.
    pub fn pose(&self, id: BodyId) -> Option<G::Pose> {
        self.index(id).map(|index| self.bodies.origin(index))
    }

    /// Appends the poses of all slots in order, as numbers ([`Geometry::write`]).
    pub fn write_poses(&self, out: &mut Vec<f32>) {
        for body in 0..self.len() {
            G::write(&self.bodies.origin(body), out);
        }
    }

    /// Returns the velocity of a body's center of mass.
    pub fn velocity(&self, id: BodyId) -> Option<Velocity<f32, L, A>> {
        self.index(id).map(|index| self.bodies.velocities[index])
    }

    /// Returns true if a body sleeps. A body falls asleep after its whole island has held still for
    /// a while ([`StepSettings::sleep_delay`]). Steps leave it out until something touches or moves
    /// it.
    pub fn is_sleeping(&self, id: BodyId) -> bool {
        self.index(id).is_some_and(|index| self.sleep.is_sleeping(index))
    }

    /// Wakes a body and all bodies that fell asleep with it.
    pub fn wake(&mut self, id: BodyId) {
        if let Some(index) = self.index(id) {
            self.wake_slot(index);
        }
    }

    /// Puts a dynamic body to sleep where it is. Nothing moves it until an awake body touches it, or
    /// moves what it is joined to; then all sleeping bodies wake that touch each other. It needs no
    /// support. Set gravity before: a change wakes all bodies.
    ///
    /// # Errors
    /// The body is unknown, not dynamic or held.
    pub fn put_to_sleep(&mut self, id: BodyId) -> Result<(), InputError> {
        let slot = self.known(id)?;
        if !self.bodies.is_dynamic(slot) {
            return Err(InputError::NotDynamic);
        }
        (self.sleep.last_gravity, self.sleep.last_delay) =
            (self.gravity, self.settings.sleep_delay);
        // Bodies that have been placed so far wake the sleepers near them, but not this one.
        for placed in std::mem::take(&mut self.sleep.placed) {
            self.wake_neighbors(placed as usize);
        }
        self.sleep.enter_alone(slot);
        self.bodies.velocities[slot] = Velocity::ZERO;
        Ok(())
    }

    /// Holds a dynamic body, or releases it. While it is held it moves as a kinematic body, by
    /// [`World::set_velocity`] and [`World::move_to`]: it pushes others and is never pushed. Once
    /// released it goes on with its velocity.
    ///
    /// # Errors
    /// The body is unknown, or not dynamic.
    pub fn hold(&mut self, id: BodyId, held: bool) -> Result<(), InputError> {
        let slot = self.known(id)?;
        if !self.bodies.can_be_moved(slot) {
            return Err(InputError::NotDynamic);
        }
        if self.bodies.held[slot] != held {
            self.wake_neighbors(slot);
            self.bodies.set_held(slot, held);
            self.solver.joints.forget();
            self.definitions = OnceLock::new();
        }
        Ok(())
    }

    /// Sets the velocity of a dynamic or kinematic body, and wakes it.
    ///
    /// # Errors
    /// The body is unknown or static, or the velocity is out of its range.
    pub fn set_velocity(
        &mut self,
        id: BodyId,
        velocity: Velocity<f32, L, A>,
    ) -> Result<(), InputError> {
        let slot = self.moving(id)?;
        input::check_velocity(&velocity)?;
        self.wake_slot(slot);
        self.lead(slot, |world| {
            world.bodies.spin_states[slot] = SpinState::default();
            world.bodies.velocities[slot] = velocity;
        });
        Ok(())
    }

    /// Sets the velocity with which a body reaches `target` after `dt` \[s\], and wakes the body. A
    /// kinematic body keeps this velocity until it gets another; a dynamic body is thrown.
    /// [`World::set_pose`] teleports a body instead.
    ///
    /// # Errors
    /// The body is unknown or static, the pose or the time is out of range, or the velocity is too
    /// large.
    pub fn move_to(&mut self, id: BodyId, target: &G::Pose, dt: f32) -> Result<(), InputError> {
        let slot = self.moving(id)?;
        input::check_pose::<G, L, A>(target)?;
        input::check_time(dt)?;
        let from = self.bodies.origin(slot);
        let apart = G::frame(target).position - G::frame(&from).position;
        let velocity = Velocity {
            linear: apart * (1.0 / dt),
            angular: G::turn_between(&from, target) * (1.0 / dt),
        };
        self.set_velocity(id, velocity)
    }

    /// Teleports a body; its velocity stays. Wakes the body and all bodies near its old pose.
    /// Bodies near its new pose wake when it touches them.
    ///
    /// # Errors
    /// The body is unknown, or the pose is out of its range.
    pub fn set_pose(&mut self, id: BodyId, pose: &G::Pose) -> Result<(), InputError> {
        let slot = self.known(id)?;
        input::check_pose::<G, L, A>(pose)?;
        self.wake_neighbors(slot);
        self.lead(slot, |world| world.bodies.set_origin(slot, pose));
        let Self { bodies, colliders, broad_phase, .. } = self;
        colliders.update_body(slot, bodies, broad_phase);
        if !bodies.is_dynamic(slot) {
            self.sleep.mark_placed(slot);
        }
        Ok(())
    }

    /// Changes the state of a body. The ledger of the next step books the change of its energy as
    /// work from outside, if the body is held.
    fn lead(&mut self, slot: usize, change: impl FnOnce(&mut Self)) {
        let before = self.bodies.energy_if_held(slot, self.gravity);
        change(self);
        let after = self.bodies.energy_if_held(slot, self.gravity);
        for (led, (after, before)) in
            self.bodies.led_energy.iter_mut().zip(after.into_iter().zip(before))
        {
            *led += after - before;
        }
    }

    /// Sets or removes the surface velocity of a body, and wakes the body and all bodies near it.
    /// Colliders with a surface velocity of their own keep it.
    ///
    /// # Errors
    /// The body is unknown, or the velocity is out of its range.
    pub fn set_surface_velocity(
        &mut self,
        id: BodyId,
        motion: Option<SurfaceVelocity<L, A>>,
    ) -> Result<(), InputError> {
        let slot = self.known(id)?;
        input::check_surface(motion.as_ref())?;
        self.definitions = OnceLock::new();
        self.wake_neighbors(slot);
        let to_center = G::pose(-self.bodies.inertia[slot].center, &[]);
        self.colliders.set_surface_velocity(slot, motion, to_center);
        Ok(())
    }

    /// Sets the rates at which the linear and angular velocity of a body decay, and wakes the
    /// body. \[1/s\]
    ///
    /// # Errors
    /// The body is unknown, or a rate is out of its range.
    pub fn set_damping(&mut self, id: BodyId, damping: [f32; 2]) -> Result<(), InputError> {
        let slot = self.known(id)?;
        input::check_damping(damping)?;
        self.definitions = OnceLock::new();
        self.wake_slot(slot);
        self.bodies.set_damping(slot, damping);
        Ok(())
    }

    /// Adds a force \[N\] and torque \[N m\] that act during the next step, and wakes the body.
    ///
    /// # Errors
    /// The body is unknown, or the force is out of its range.
    pub fn add_force(&mut self, id: BodyId, force: Velocity<f32, L, A>) -> Result<(), InputError> {
        let slot = self.known(id)?;
        input::check_force(&force)?;
        self.wake_slot(slot);
        let (all, forces) = (self.len(), &mut self.bodies.forces);
        forces.resize(all, Velocity::ZERO);
        forces[slot] += force;
        Ok(())
    }

    /// Returns the velocities of all slots in order.
    pub fn velocities(&self) -> &[Velocity<f32, L, A>] {
        &self.bodies.velocities
    }

    /// Returns the contact system of the last substep after solving. Its gaps are those after the
    /// step. Where meshes deform ([`World::move_vertices`]), further bodies stand for their
    /// surfaces at the contacts.
    pub fn system(&self) -> System<f32, L, A> {
        let Some(mut system) = self.with_carriers() else { return self.bodies.without_contacts() };
        self.solver.lanes.unpack(&mut system);
        system
    }

    /// Returns a system with the velocities and masses of the bodies and carriers, without contacts.
    /// `None` if bodies were added since the last step had carriers.
    fn with_carriers(&self) -> Option<System<f32, L, A>> {
        let mut system = self.bodies.without_contacts();
        let carriers = &self.solver.carriers;
        if carriers.own.is_empty() {
            return Some(system);
        }
        for carrier in &carriers.own {
            system.add_body(carrier.velocity, InverseMass::FIXED);
        }
        (carriers.first + carriers.own.len() == system.velocities.len()).then_some(system)
    }

    /// Returns [`World::system`] with the gaps measured by the last contact search.
    pub(crate) fn system_at_search(&self) -> System<f32, L, A> {
        let mut system = self.system();
        for manifold in &system.manifolds {
            let [a, b] = manifold.bodies.map(|body| &self.scratch.displacements[body as usize]);
            let moved = manifold.frame.twist(a, b);
            for contact in &mut system.contacts[manifold.points()] {
                contact.gap[0] -= contact.normal_velocity(&moved);
            }
        }
        system
    }

    /// Sets the clock. The default is the system clock. Without a clock ([`Clock::NONE`]) all times
    /// are zero, and the number of threads is not tuned. Results do not change.
    pub fn set_clock(&mut self, clock: Clock) {
        self.execution.clock = clock;
        self.solver.certifier.island_solver.clock = clock;
    }

    /// Sets whether steps measure the time of their stages
    /// ([`StepReport::stages`](crate::StepReport::stages)). The default is no: in a step of a few
    /// microseconds, reading the clock 26 times takes a tenth of the time.
    pub fn time_stages(&mut self, timing: bool) {
        self.execution.timing = timing;
    }

    /// Sets whether steps save the contacts and joints of their last substep. The default is no.
    pub fn save_systems(&mut self, saving: bool) {
        self.execution.saving = saving;
        self.execution.saved = None;
    }

    /// Returns the contacts and joints of the last substep before solving, if they were saved
    /// ([`World::save_systems`]). If contacts bounced in the step, the substep is the last one
    /// before the next contact search.
    pub fn saved(&self) -> Option<&SavedSystem<L, A>> {
        self.execution.saved.as_ref()
    }

    /// Wakes the body in a slot and all bodies that fell asleep with it. Returns true if it slept.
    pub(crate) fn wake_slot(&mut self, body: usize) -> bool {
        let bodies = &mut self.bodies;
        self.sleep.wake(body, |member| bodies.set_inverse_mass(member))
    }

    /// Wakes a body and all bodies with a collider whose stored box overlaps one of its own, if the
    /// two colliders can collide.
    pub(crate) fn wake_neighbors(&mut self, body: usize) {
        self.wake_slot(body);
        let Self { bodies, colliders, broad_phase, .. } = self;
        let mut near = Vec::new();
        for collider in colliders.of_body(body) {
            broad_phase.overlapping(collider, |other| {
                if colliders.pair(bodies, [collider.min(other), collider.max(other)]).is_some() {
                    near.push(colliders.body[other as usize] as usize);
                }
            });
        }
        near.into_iter().for_each(|body| {
            self.wake_slot(body);
        });
    }

    /// Returns the slot of a joint, or `None` if the joint is unknown.
    pub(crate) fn joint_slot(&self, id: JointId) -> Option<usize> {
        id.slot(&self.solver.joints.slots, self.id())
    }

    /// Wakes the bodies of the joint in a slot.
    pub(crate) fn wake_joined(&mut self, slot: usize) {
        let members: Vec<u32> = self.solver.joints.records[slot].members().collect();
        for body in members {
            self.wake_slot(body as usize);
        }
    }

    /// Removes the joint in a slot.
    pub(crate) fn drop_joint(&mut self, slot: usize) {
        let joints = &mut self.solver.joints;
        joints.slots.vacate(slot);
        joints.slots.release(slot);
        joints.forget();
        self.definitions_changed();
        self.pair_again(slot as u32);
    }

    /// Removes the joints of a body that is removed.
    pub(crate) fn drop_joints_of(&mut self, body: usize) {
        let joints = &self.solver.joints;
        let own = |record: &JointRecord| record.members().any(|member| member as usize == body);
        let slots: Vec<usize> =
            joints.taken().filter(|(_, record)| own(record)).map(|(slot, _)| slot).collect();
        for slot in slots {
            self.wake_joined(slot);
            self.drop_joint(slot);
        }
    }

    /// Recomputes whether a joint keeps the shapes of its bodies from colliding, and holds their contacts.
    pub(crate) fn pair_again(&mut self, slot: u32) {
        let Self { bodies, solver, contacts, .. } = self;
        let [separates, holds] = solver.joints.pair(slot, |body| bodies.is_static(body));
        let record = &solver.joints.records[slot as usize];
        if holds {
            record.members().for_each(|body| bodies.rebuild_contacts(body as usize));
        }
        let [a, b] = record.bodies;
        for pair in contacts.pairs.iter_mut().filter(|_| separates) {
            if pair.bodies == [a, b] || pair.bodies == [b, a] {
                if solver.joints.separates(pair.bodies) {
                    pair.separate();
                } else if pair.is_separated() {
                    pair.clearance = 0.0;
                }
            }
        }
    }

    /// Measures the state after the last step ([`World::measure`]).
    pub(crate) fn measured(&self) -> Measure {
        let mut out = Measure { finite: true, ..Measure::default() };
        for body in 0..self.len() {
            let frame = &self.bodies.frames[body];
            let velocity = &self.bodies.velocities[body];
            let sums = [frame.position.dot(frame.position), velocity.linear.dot(velocity.linear)];
            out.finite &= sums.iter().all(|x| x.is_finite())
                && velocity.angular.dot(velocity.angular).is_finite();
            if !self.bodies.is_dynamic(body) {
                continue;
            }
            out.fastest = out.fastest.max(f64::from(velocity.linear.length()));
            out.kinetic_energy += 0.5 * self.bodies.mass(body).squared(&velocity.cast());
        }
        let [kinetic, potential] = self.bodies.held_energy(self.gravity);
        out.kinetic_energy += kinetic;
        out.potential_energy = self.bodies.potential_energy(self.gravity) + potential;
        out.deepest_penetration = f64::from(self.solver.lanes.overlap());
        for pair in self.contacts.pairs.iter().filter(|pair| pair.is_sleeping) {
            let sleeping = self.sleep.cache.view();
            for manifold in sleeping.of(pair.manifolds()) {
                for cached in sleeping.impulses_of(manifold) {
                    out.deepest_penetration =
                        out.deepest_penetration.max(f64::from(-cached.gap[0]));
                }
            }
        }
        let residual = if self.solver.carriers.own.is_empty() {
            self.solver.lanes.residual(&self.bodies.velocities)
        } else {
            let system = self.with_carriers();
            system.map_or(0.0, |system| self.solver.lanes.residual(&system.velocities))
        };
        out.residual = f64::from(residual);
        out
    }

    /// Returns the mass of the body in a slot, or infinity if the body is not dynamic. \[kg\]
    pub(crate) fn mass(&self, body: usize) -> f64 {
        if self.bodies.is_dynamic(body) {
            f64::from(self.bodies.inertia[body].mass)
        } else {
            f64::INFINITY
        }
    }
}
