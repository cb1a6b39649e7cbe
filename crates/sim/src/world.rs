//! [`World`]: bodies, their contacts, and the step that moves both on.

mod checkpoint;

pub use checkpoint::{Checkpoint, CheckpointError};

use std::sync::{Arc, OnceLock};

use drystone_solver::thread_pool::ThreadPool;
use drystone_solver::{Clock, InverseMass, System, Vector, Velocity};

use crate::bodies::{Bodies, Body, Inertia, SpinState, SurfaceMotion};
use crate::broad_phase::BroadPhase;
use crate::cache::ContactCache;
use crate::colliders::{Colliders, Definitions};
use crate::geometry::{Geometry, MassProperties};
use crate::ids::{self, BodyId, ColliderId, put};
use crate::input::{self, InputError};
use crate::report::Measure;
use crate::saved::SavedSystem;
use crate::scene::Motion;
use crate::settings::StepSettings;
use crate::sleep::Sleep;
use crate::solving::ConstraintSolver;
use crate::step_scratch::StepScratch;
use crate::tuner::ThreadTuner;

/// Threads for each processor, at most.
const MOST_THREADS: usize = 4;

/// Bodies and their contacts, in the dimension of `G`.
///
/// The state that a checkpoint holds is in `bodies`, `colliders`, `broad_phase`, `contacts`, `sleep` and `solver`.
pub struct World<G: Geometry<L, A>, const L: usize, const A: usize> {
    /// Settings of each step.
    pub settings: StepSettings,
    /// Acceleration of free fall. \[m/s^2\]
    pub gravity: Vector<f32, L>,
    /// Number that tells identifiers of this world from those of others.
    id: u32,
    pub(crate) bodies: Bodies<G, L, A>,
    pub(crate) colliders: Colliders<G, L, A>,
    /// Bodies and colliders as they have been since the last change, for checkpoints.
    definitions: OnceLock<Arc<Definitions<G, L, A>>>,
    pub(crate) broad_phase: BroadPhase<L>,
    pub(crate) contacts: ContactCache<L>,
    pub(crate) sleep: Sleep<L>,
    pub(crate) solver: ConstraintSolver<L, A>,
    pub(crate) scratch: StepScratch<G, L, A>,
    pub(crate) execution: Execution<L, A>,
}

/// Where and how fast steps are taken, and what they keep for whoever looks on. Results do not depend on it.
pub(crate) struct Execution<const L: usize, const A: usize> {
    pub(crate) pool: Arc<ThreadPool>,
    pub(crate) tuner: ThreadTuner,
    pub(crate) clock: Clock,
    /// True if steps time their stages.
    pub(crate) timing: bool,
    /// True if steps save their last contact system.
    pub(crate) saving: bool,
    /// Contact system of the last step.
    pub(crate) saved: Option<SavedSystem<L, A>>,
}

impl<const L: usize, const A: usize> Default for Execution<L, A> {
    /// One thread and the clock of the system; nothing is timed or saved.
    fn default() -> Self {
        Self {
            pool: Arc::default(),
            tuner: ThreadTuner::default(),
            clock: Clock::system(),
            timing: false,
            saving: false,
            saved: None,
        }
    }
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// An empty world without gravity, on one thread.
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

    /// Uses `threads` threads; results do not depend on it. Keeps to one where no more can be had.
    pub fn set_threads(&mut self, threads: usize) {
        let most = MOST_THREADS * std::thread::available_parallelism().map_or(1, usize::from);
        let threads = threads.clamp(1, most);
        if threads != self.execution.pool.threads() {
            self.execution.pool = Arc::new(ThreadPool::new(threads));
            self.solver.lanes.set_pool(Arc::clone(&self.execution.pool));
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
        self.sleep.reset(slot);
        if body.motion != Motion::Dynamic {
            self.sleep.place(slot);
        }
        let to_center = G::pose(-inertia.center, &[]);
        for collider in body.colliders {
            let local = G::compose(&to_center, &collider.pose);
            self.colliders.add(slot, collider, local, &self.bodies, &mut self.broad_phase);
        }
        self.colliders.run(slot, body.surface_velocity, to_center);
        Ok(BodyId::new(&self.bodies.slots, slot, self.id))
    }

    /// Removes a body ([`World::remove`]).
    pub(crate) fn take_out(&mut self, id: BodyId) -> bool {
        let Some(slot) = self.index(id) else { return false };
        self.wake_neighbors(slot);
        self.sleep.placed.retain(|&placed| placed as usize != slot);
        self.colliders.remove(slot, &mut self.broad_phase);
        self.bodies.remove(slot);
        self.definitions = OnceLock::new();
        self.bodies.velocities[slot] = Velocity::ZERO;
        self.bodies.inverse_masses[slot] = InverseMass::FIXED;
        self.bodies.contact_gains[slot] = Velocity::ZERO;
        true
    }

    /// The slot of a body, if it is there.
    fn index(&self, id: BodyId) -> Option<usize> {
        id.slot(&self.bodies.slots, self.id)
    }

    /// The slot of a body.
    fn known(&self, id: BodyId) -> Result<usize, InputError> {
        self.index(id).ok_or(InputError::UnknownBody)
    }

    /// The slot of a body that can move.
    fn moving(&self, id: BodyId) -> Result<usize, InputError> {
        let slot = self.known(id)?;
        let is_static = self.bodies.motion[slot] == Some(Motion::Static);
        if is_static { Err(InputError::Static) } else { Ok(slot) }
    }

    /// The body in a slot, if there is one.
    pub fn body_at(&self, slot: usize) -> Option<BodyId> {
        let slots = &self.bodies.slots;
        let taken = slot < slots.len() && slots.is_taken(slot);
        taken.then(|| BodyId::new(slots, slot, self.id))
    }

    /// All bodies, slot by slot.
    pub fn bodies(&self) -> impl Iterator<Item = BodyId> + '_ {
        (0..self.len()).filter_map(|slot| self.body_at(slot))
    }

    /// The colliders of a body, the last that was added first.
    pub fn colliders(&self, id: BodyId) -> impl Iterator<Item = ColliderId> + '_ {
        let colliders = self.index(id).map(|slot| self.colliders.of_body(slot));
        colliders
            .into_iter()
            .flatten()
            .map(|slot| ColliderId::new(&self.colliders.slots, slot as usize, self.id))
    }

    /// The body of a collider.
    pub fn body_of(&self, id: ColliderId) -> Option<BodyId> {
        let slot = id.slot(&self.colliders.slots, self.id)?;
        self.body_at(self.colliders.body[slot] as usize)
    }

    /// [`Body::user_data`] of a body.
    pub fn user_data(&self, id: BodyId) -> Option<u128> {
        self.index(id).map(|slot| self.bodies.user_data[slot])
    }

    /// [`Collider::user_data`](crate::Collider::user_data) of a collider.
    pub fn collider_user_data(&self, id: ColliderId) -> Option<u128> {
        id.slot(&self.colliders.slots, self.id).map(|slot| self.colliders.user_data[slot])
    }

    /// Slots for bodies, removed ones included: what indices run over.
    pub fn len(&self) -> usize {
        self.bodies.poses.len()
    }

    /// Whether the world never had a body.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Pose of a body's origin.
    pub fn pose(&self, id: BodyId) -> Option<G::Pose> {
        self.index(id).map(|index| self.bodies.origin(index))
    }

    /// Appends the poses of all slots, in order, as numbers ([`Geometry::write`]).
    pub fn write_poses(&self, out: &mut Vec<f32>) {
        for body in 0..self.len() {
            G::write(&self.bodies.origin(body), out);
        }
    }

    /// Velocity of a body's center of mass.
    pub fn velocity(&self, id: BodyId) -> Option<Velocity<f32, L, A>> {
        self.index(id).map(|index| self.bodies.velocities[index])
    }

    /// Whether a body sleeps: it and all that it touches have held still for a while
    /// ([`StepSettings::sleep`]), and steps leave it out substeps_until_search something touches or moves it.
    pub fn is_sleeping(&self, id: BodyId) -> bool {
        self.index(id).is_some_and(|index| self.sleep.is_sleeping(index))
    }

    /// Wakes a body and all that sleeps with it.
    pub fn wake(&mut self, id: BodyId) {
        if let Some(index) = self.index(id) {
            self.wake_slot(index);
        }
    }

    /// Sets the velocity of a dynamic or kinematic body, and wakes it.
    ///
    /// # Errors
    /// The body is unknown or static, or the velocity is not finite.
    pub fn set_velocity(
        &mut self,
        id: BodyId,
        velocity: Velocity<f32, L, A>,
    ) -> Result<(), InputError> {
        let slot = self.moving(id)?;
        input::check_velocity(&velocity)?;
        self.wake_slot(slot);
        self.bodies.turns[slot] = SpinState::default();
        self.bodies.velocities[slot] = velocity;
        Ok(())
    }

    /// Gives a kinematic body the velocity that takes it to `target` within `dt` \[s\]. A dynamic body
    /// wakes, and is thrown there. [`World::set_pose`] puts any body elsewhere at once.
    ///
    /// # Errors
    /// The body is unknown or static, the pose is not finite, or the way is too fast.
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

    /// Puts a body elsewhere at once, whatever is in between; its velocity stays. It wakes, with all
    /// bodies near its old place. Bodies near its new place wake when they touch it.
    ///
    /// # Errors
    /// The body is unknown, or the pose is not finite.
    pub fn set_pose(&mut self, id: BodyId, pose: &G::Pose) -> Result<(), InputError> {
        let slot = self.known(id)?;
        input::check_pose::<G, L, A>(pose)?;
        self.wake_neighbors(slot);
        self.bodies.set_origin(slot, pose);
        let Self { bodies, colliders, broad_phase, .. } = self;
        colliders.place_body(slot, bodies, broad_phase);
        if bodies.motion[slot] != Some(Motion::Dynamic) {
            self.sleep.place(slot);
        }
        Ok(())
    }

    /// Has the surface of a body run, or stand, and wakes all bodies near it. Colliders with a surface
    /// velocity of their own keep it.
    ///
    /// # Errors
    /// The body is unknown, or the velocity is not finite.
    pub fn set_surface_velocity(
        &mut self,
        id: BodyId,
        motion: Option<SurfaceMotion<L, A>>,
    ) -> Result<(), InputError> {
        let slot = self.known(id)?;
        input::check_surface(motion.as_ref())?;
        self.definitions = OnceLock::new();
        self.wake_neighbors(slot);
        let to_center = G::pose(-self.bodies.inertia[slot].center, &[]);
        self.colliders.run(slot, motion, to_center);
        Ok(())
    }

    /// Sets the rates at which the linear and angular velocity of a body decay, and wakes it. \[1/s\]
    ///
    /// # Errors
    /// The body is unknown, or a rate is negative or not finite.
    pub fn set_damping(&mut self, id: BodyId, damping: [f32; 2]) -> Result<(), InputError> {
        let slot = self.known(id)?;
        input::check_damping(damping)?;
        self.definitions = OnceLock::new();
        self.wake_slot(slot);
        self.bodies.set_damping(slot, damping);
        Ok(())
    }

    /// Adds a force \[N\] and torque \[N m\] that act through the next step, and wakes the body.
    ///
    /// # Errors
    /// The body is unknown, or the force is not finite.
    pub fn add_force(&mut self, id: BodyId, force: Velocity<f32, L, A>) -> Result<(), InputError> {
        let slot = self.known(id)?;
        input::check_force(&force)?;
        self.wake_slot(slot);
        let (all, forces) = (self.len(), &mut self.bodies.forces);
        forces.resize(all, Velocity::ZERO);
        forces[slot] += force;
        Ok(())
    }

    /// Velocities of all slots, in order.
    pub fn velocities(&self) -> &[Velocity<f32, L, A>] {
        &self.bodies.velocities
    }

    /// The contact system of the last substep, as the solver left it; its gaps are those after the step.
    pub fn system(&self) -> System<f32, L, A> {
        let mut system = self.bodies.without_contacts();
        self.solver.lanes.unpack(&mut system);
        system
    }

    /// The same with gaps as they were when contacts were last searched for.
    pub(crate) fn searched(&self) -> System<f32, L, A> {
        let mut system = self.system();
        for manifold in &system.manifolds {
            let [a, b] = manifold.bodies.map(|body| &self.scratch.displacements[body as usize]);
            let moved = manifold.twist(a, b);
            for contact in &mut system.contacts[manifold.points()] {
                contact.gap[0] -= contact.normal_velocity(&moved);
            }
        }
        system
    }

    /// Takes the time from this clock: by default that of the system. Without one no stage takes any time, and no number
    /// of threads is found to be faster than another; results stay the same.
    pub fn set_clock(&mut self, clock: Clock) {
        self.execution.clock = clock;
        self.solver.certifier.island_solver.clock = clock;
    }

    /// Whether steps report the time of their stages ([`StepReport::stages`]). By default they do not: where a step
    /// takes a few microseconds, reading the clock 26 times is a tenth of it.
    pub fn time_stages(&mut self, timing: bool) {
        self.execution.timing = timing;
    }

    /// Whether steps save the contact system of their last substep. By default they do not.
    pub fn save_systems(&mut self, saving: bool) {
        self.execution.saving = saving;
        self.execution.saved = None;
    }

    /// The contact system of the last substep as it was before it was solved, if that was asked for.
    pub fn saved(&self) -> Option<&SavedSystem<L, A>> {
        self.execution.saved.as_ref()
    }

    /// Wakes a body, by its slot, with all that sleep with it. Returns true if it slept.
    pub(crate) fn wake_slot(&mut self, body: usize) -> bool {
        let bodies = &mut self.bodies;
        self.sleep.wake(body, |member| bodies.set_inverse_mass(member))
    }

    /// Wakes a body and all bodies whose boxes overlap one of its own.
    fn wake_neighbors(&mut self, body: usize) {
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
        out.potential_energy = self.bodies.potential_energy(self.gravity);
        out.deepest_penetration = f64::from(self.solver.lanes.overlap());
        for pair in self.contacts.pairs.iter().filter(|pair| pair.rests) {
            let resting = self.sleep.records.view();
            for record in resting.of(pair.records()) {
                for trace in resting.traces_of(record) {
                    out.deepest_penetration = out.deepest_penetration.max(f64::from(-trace.gap[0]));
                }
            }
        }
        out.residual = f64::from(self.solver.lanes.residual(&self.bodies.velocities));
        out
    }

    /// m of a body, by its slot; infinite for what no push moves. \[kg\]
    pub(crate) fn mass(&self, body: usize) -> f64 {
        if self.bodies.is_dynamic(body) {
            f64::from(self.bodies.inertia[body].mass)
        } else {
            f64::INFINITY
        }
    }
}
