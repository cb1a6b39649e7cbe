//! [`World`]: bodies, their contacts, and the step that moves both on.

mod checkpoint;

pub use checkpoint::{Checkpoint, CheckpointError};

use std::sync::{Arc, OnceLock};

use drystone_solver::restitution::{self, ImpactSettings, ImpactSolver};
use drystone_solver::thread_pool::ThreadPool;
use drystone_solver::wide::Wide;
use drystone_solver::{Clock, InverseMass, System, Vector, Velocity};

use crate::bodies::{Bodies, Body, GRAIN, Inertia, SpinState, SurfaceMotion};
use crate::broad_phase::BroadPhase;
use crate::cache::{self, ManifoldCache, Pair};
use crate::certifier::Certifier;
use crate::colliders::{Colliders, Definitions};
use crate::course::SubstepContext;
use crate::geometry::{Geometry, MassProperties};
use crate::ids::{self, BodyId, ColliderId, put};
use crate::input::{self, InputError};
use crate::ledger::LedgerBuilder;
use crate::motion::{self, Advanced, MovingBodies, SubstepParams};
use crate::narrow_phase::{NarrowPhaseInput, PairWorker, closing, manifolds};
use crate::patches::{Patches, Shapes};
use crate::report::{Measure, Stage, StageTimer, StepReport};
use crate::rows::CacheSource;
use crate::saved::SavedSystem;
use crate::scene::Motion;
use crate::seams::{SeamInput, SeamResolver};
use crate::settings::StepSettings;
use crate::sleep::Sleep;
use crate::surfaces::SurfaceStates;
use crate::travel::{MotionView, TravelBounds};
use crate::tuner::ThreadTuner;

/// Rounds of collisions within a substep: a blow passes through this many contacts against the
/// order of the contacts.
const COLLISION_ROUNDS: usize = 32;

/// Where a step has several searches, points are reused while bodies move less than this part of the prediction
/// distance: what was not among them was farther than all of it. \[1\]
const REUSE: f32 = 0.25;

/// In a substep no body falls by more than this part of its thickness: soft contacts sink in by about as much for each
/// body above them, and a tower of twenty stands. \[1\]
const SINKS: f32 = 1.0 / 1024.0;

/// Sweeps over what collides at once.
const COLLISION_SWEEPS: usize = 40;

/// Threads for each processor, at most.
const MOST_THREADS: usize = 4;

/// Bodies and their contacts, in the dimension of `G`.
pub struct World<G: Geometry<L, A>, const L: usize, const A: usize> {
    /// How steps are taken.
    pub settings: StepSettings,
    /// Acceleration of free fall. \[m/s^2\]
    pub gravity: Vector<f32, L>,
    /// Tells its identifiers from those of other worlds.
    id: u32,
    bodies: Bodies<G, L, A>,
    colliders: Colliders<G, L, A>,
    /// Bodies and colliders as they have been since the last change, for checkpoints.
    definitions: OnceLock<Arc<Definitions<G, L, A>>>,
    broad_phase: BroadPhase<L>,
    pairs: Vec<Pair>,
    fresh_pairs: Vec<Pair>,
    records: ManifoldCache<L>,
    old_records: ManifoldCache<L>,
    sleep: Sleep<L>,
    /// Whether each body moves or can be moved.
    active: Vec<bool>,
    /// Gravity in the last step: another wakes all.
    last_gravity: Vector<f32, L>,
    /// What points were reused for in the last search. \[m\]
    last_reuse: f32,
    /// Velocities and inverse masses of the bodies live here, where the solver works on them; contacts
    /// only as copies of those in `wide`, for whoever looks at them one by one.
    system: System<f32, L, A>,
    /// The contacts of the step, sixteen side by side.
    wide: Wide<L, A>,
    /// The velocities of a substep without the impulses of its contacts.
    prospective: Vec<Velocity<f32, L, A>>,
    surfaces: SurfaceStates<L, A>,
    certifier: Certifier<L, A>,
    impact_solver: ImpactSolver<L, A>,
    /// What forces give each body in a substep in which things may bounce. \[m/s, rad/s\]
    forced: Vec<Velocity<f32, L, A>>,
    books: LedgerBuilder<L, A>,
    /// What each body has moved since the step began.
    displacements: Vec<Velocity<f32, L, A>>,
    /// What contacts gave each in the last substep, as far as it was warm started.
    pushes: Vec<Velocity<f32, L, A>>,
    travel: TravelBounds<L>,
    workers: Vec<PairWorker<G, L, A>>,
    seams: SeamResolver<L>,
    patches: Patches<L>,
    pool: Arc<ThreadPool>,
    tuner: ThreadTuner,
    clock: Clock,
    /// Whether steps time their stages.
    timing: bool,
    /// Whether steps save their last contact system, and that of the last step.
    saving: bool,
    saved: Option<SavedSystem<L, A>>,
}

/// How many substeps go by substeps_until_search contacts are searched for again, if in so many bodies have `passed` so many times
/// as much of each other as they may.
fn substeps_until_search(substeps: u32, passed: f32) -> u32 {
    ((substeps as f32 / passed) as u32).max(1)
}

/// Bodies as they move for `dt` \[s\].
fn moving<'a, G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &'a Bodies<G, L, A>,
    system: &'a System<f32, L, A>,
    dt: f32,
) -> MotionView<'a, L, A> {
    let Bodies { frames, reach, since_search, .. } = bodies;
    MotionView { velocities: &system.velocities, frames, reach, since_search, dt }
}

/// How the substeps of a part of a step are taken.
struct Plan<const L: usize> {
    params: SubstepParams<L>,
    /// Whether each is solved to the tolerance.
    solving: bool,
    /// The one that is certified with all residuals.
    examined: Option<u32>,
    ledger: bool,
    /// How blows are resolved, where anything bounces.
    collisions: Option<ImpactSettings<f32>>,
    /// Whether each substep is taken for everything at once, not for one batch after the other.
    together: bool,
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
            pairs: Vec::new(),
            fresh_pairs: Vec::new(),
            records: ManifoldCache::default(),
            old_records: ManifoldCache::default(),
            sleep: Sleep::default(),
            active: Vec::new(),
            last_gravity: Vector::ZERO,
            last_reuse: 0.0,
            system: System::new(),
            wide: Wide::new(),
            prospective: Vec::new(),
            surfaces: SurfaceStates::default(),
            certifier: Certifier::default(),
            impact_solver: ImpactSolver::default(),
            forced: Vec::new(),
            books: LedgerBuilder::default(),
            displacements: Vec::new(),
            pushes: Vec::new(),
            travel: TravelBounds::default(),
            workers: Vec::new(),
            seams: SeamResolver::default(),
            patches: Patches::default(),
            pool: Arc::default(),
            tuner: ThreadTuner::default(),
            clock: Clock::system(),
            timing: false,
            saving: false,
            saved: None,
        }
    }

    /// Uses `threads` threads; results do not depend on it. Keeps to one where no more can be had.
    pub fn set_threads(&mut self, threads: usize) {
        let most = MOST_THREADS * std::thread::available_parallelism().map_or(1, usize::from);
        let threads = threads.clamp(1, most);
        if threads != self.pool.threads() {
            self.pool = Arc::new(ThreadPool::new(threads));
            self.wide.set_pool(Arc::clone(&self.pool));
            self.tuner = ThreadTuner::default();
        }
    }

    /// Adds a body. Mass and inertia come from its shapes unless it brings its own; a dynamic
    /// body without either cannot be moved.
    pub fn add(&mut self, body: Body<G, L, A>) -> Result<BodyId, InputError> {
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
        put(&mut self.system.velocities, slot, velocity);
        put(&mut self.system.masses, slot, self.bodies.inverse_mass(slot));
        put(&mut self.displacements, slot, Velocity::ZERO);
        put(&mut self.pushes, slot, Velocity::ZERO);
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

    /// Removes a body with its colliders, and wakes all that was near it; returns whether it was there.
    pub fn remove(&mut self, id: BodyId) -> bool {
        let Some(slot) = self.index(id) else { return false };
        self.wake_neighbors(slot);
        self.sleep.placed.retain(|&placed| placed as usize != slot);
        self.colliders.remove(slot, &mut self.broad_phase);
        self.bodies.remove(slot);
        self.definitions = OnceLock::new();
        self.system.velocities[slot] = Velocity::ZERO;
        self.system.masses[slot] = InverseMass::FIXED;
        self.pushes[slot] = Velocity::ZERO;
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
        self.index(id).map(|index| self.system.velocities[index])
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
        self.system.velocities[slot] = velocity;
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
        &self.system.velocities
    }

    /// The contact system of the last substep, as the solver left it; its gaps are those after the step.
    pub fn system(&self) -> System<f32, L, A> {
        let (velocities, masses) = (self.system.velocities.clone(), self.system.masses.clone());
        let mut system = System { velocities, masses, ..System::new() };
        self.wide.unpack(&mut system);
        system
    }

    /// The same with gaps as they were when contacts were last searched for.
    pub(crate) fn searched(&self) -> System<f32, L, A> {
        let mut system = self.system();
        for manifold in &system.manifolds {
            let [a, b] = manifold.bodies.map(|body| &self.displacements[body as usize]);
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
        self.clock = clock;
        self.certifier.island_solver.clock = clock;
    }

    /// Whether steps report the time of their stages ([`StepReport::stages`]). By default they do not: where a step
    /// takes a few microseconds, reading the clock 26 times is a tenth of it.
    pub fn time_stages(&mut self, timing: bool) {
        self.timing = timing;
    }

    /// Whether steps save the contact system of their last substep. By default they do not.
    pub fn save_systems(&mut self, saving: bool) {
        self.saving = saving;
        self.saved = None;
    }

    /// The contact system of the last substep as it was before it was solved, if that was asked for.
    pub fn saved(&self) -> Option<&SavedSystem<L, A>> {
        self.saved.as_ref()
    }

    /// Moves the world on by `dt` \[s\]: 1/240 to 1/24 s for what people see. Nothing moves in a step of 0 s.
    ///
    /// # Errors
    /// The step is negative or not finite, as gravity may be, or a setting is out of its range
    /// ([`StepSettings::RANGES`]). The world is then as it was.
    pub fn step(&mut self, dt: f32) -> Result<StepReport, InputError> {
        input::check_time(dt)?;
        input::check_gravity(&self.gravity)?;
        self.settings.check()?;
        let mut report = StepReport::default();
        let mut clock = StageTimer::start(if self.timing { self.clock } else { Clock::NONE });
        let start = self.tuner.start(&self.pool, self.clock);
        if self.settings.sleep <= 0.0 || self.gravity != self.last_gravity {
            self.wake_all();
        }
        self.last_gravity = self.gravity;
        let most = self.settings.searches.max(1);
        let mut passed = self.plan_searches(dt);
        // Each search is for one substep at least.
        let asked = self.settings.substeps.max(self.fitting(dt));
        let substeps = asked.max(passed.ceil().min(most as f32) as u32);
        let h = dt / substeps as f32;
        let (mut left, mut due) = (substeps, substeps);
        for search in 0.. {
            let fitting = |due, passed| {
                substeps_until_search(due, passed).max(left.div_ceil(most - search)).min(left)
            };
            let planned = due;
            due = fitting(planned, passed);
            if due != planned {
                passed = self.plan_searches(h * due as f32);
            }
            // Falls grow as the square of the time: longer ahead, bodies pass more than in proportion.
            let longest = fitting(due, passed);
            if due > planned && longest < due {
                due = longest;
                self.plan_searches(h * due as f32);
            }
            left -= due;
            clock.lap(Stage::Pairs);
            let mut reuse = self.settings.reuse_distance;
            if due < substeps {
                reuse = reuse.max(REUSE * self.settings.prediction_distance);
            }
            let same = self.find_manifolds(reuse, h * due as f32);
            clock.lap(Stage::Manifolds);
            self.part(h, (due, left == 0), same, &mut clock, &mut report);
            if left == 0 {
                break;
            }
            due = due.min(left);
            passed = self.plan_searches(h * due as f32);
        }
        self.bodies.forces.clear();
        let delay = self.settings.sleep;
        if delay > 0.0 {
            let (sleep, system, touching) =
                (&mut self.sleep, &mut self.system, self.records.pairs());
            let runs = |manifold: usize| self.surfaces.runs(manifold);
            if sleep.fall_asleep(&self.bodies, system, (touching, runs), dt, delay) {
                self.update_masses();
                self.colliders.place(&self.bodies);
            }
        }
        report.stages = clock.stages;
        report.substeps = substeps;
        report.asleep = self.sleep.count();
        report.not_finite = self.not_finite();
        report.pairs = self.pairs.len();
        report.manifolds = self.records.manifolds.len();
        report.contacts = self.records.points.len();
        self.tuner.stop(self.clock.since(start), report.sweeps, report.contacts);
        Ok(report)
    }

    /// Substeps of a step that fit the thinnest body.
    fn fitting(&self, dt: f32) -> u32 {
        let (settings, gravity) = (&self.settings, self.gravity.length());
        let awake = |(body, thickness): (usize, &f32)| {
            if self.sleep.is_sleeping(body) { f32::INFINITY } else { *thickness }
        };
        let thickness = self.bodies.thickness.iter().enumerate().map(awake);
        let thinnest = thickness.fold(f32::INFINITY, f32::min);
        if settings.tolerance > 0.0 || gravity == 0.0 || thinnest == f32::INFINITY {
            return 1;
        }
        let longest = (2.0 * SINKS * thinnest / gravity).sqrt();
        let fitting = (dt / longest).ceil().min(settings.most_substeps as f32) as u32;
        fitting.max(1)
    }

    /// Bodies that are not at finite places with finite velocities.
    fn not_finite(&self) -> Vec<u32> {
        // A finite number times zero is zero, all else NaN: one pass without branches.
        let zero = |body: usize| {
            let (frame, velocity) = (&self.bodies.frames[body], &self.system.velocities[body]);
            let numbers = frame.position.0.iter().chain(&velocity.linear.0);
            numbers.chain(&velocity.angular.0).map(|x| x * 0.0).sum::<f32>()
        };
        let all = 0..self.len();
        if all.clone().map(zero).sum::<f32>() == 0.0 {
            return Vec::new();
        }
        all.filter(|&body| zero(body) != 0.0).map(|body| body as u32).collect()
    }

    /// Finds pairs for the next `dt` \[s\] and the blows of their bodies. Returns what near bodies pass of each other,
    /// the most, over what they may before contacts are searched for again. \[1\]
    fn plan_searches(&mut self, dt: f32) -> f32 {
        self.find_pairs(dt);
        let fall = self.gravity.length() * dt * dt;
        let moving = moving(&self.bodies, &self.system, dt);
        let margin = self.settings.prediction_distance;
        let masses = &self.system.masses;
        let worst = self.travel.pass(moving, masses, &self.pairs, [fall, margin], &self.pool);
        let passed = worst / self.settings.travel_per_search;
        if passed.is_finite() { passed } else { 0.0 }
    }

    /// A part of a step, from manifolds to new poses, in so many substeps; whether it is the last. Whether its
    /// manifolds are the `same` as before.
    fn part(
        &mut self,
        h: f32,
        (substeps, last): (u32, bool),
        same: bool,
        clock: &mut StageTimer,
        report: &mut StepReport,
    ) {
        let plan = self.plan(h, substeps, last);
        self.pack(&plan, h * substeps as f32, same);
        clock.lap(Stage::Rows);
        if plan.together {
            let mut renewed = false;
            for substep in 0..substeps {
                self.substep(&plan, substep, &mut renewed, clock, report);
            }
            self.course().trace(&plan.params);
            clock.lap(Stage::Remember);
        } else {
            self.course().run_by_batch(&plan.params, clock);
        }
        self.surfaces.take_back(&self.colliders, &self.pairs, &self.wide);
        let sweeps = if plan.solving { 1 } else { 1 + plan.params.iterations };
        report.sweeps += (substeps * sweeps) as usize;
        self.arrive(&plan, clock, report);
    }

    /// All bodies and their contacts, on their way through a part.
    fn course(&mut self) -> SubstepContext<'_, G, L, A> {
        let System { velocities, masses, .. } = &mut self.system;
        let contacts = self.wide.whole(&mut self.records.traces);
        let states = [velocities, &mut self.prospective, &mut self.displacements, &mut self.pushes];
        let states = states.map(Vec::as_mut_slice);
        SubstepContext {
            contacts,
            bodies: MovingBodies::new(&mut self.bodies, masses, states, &self.pool),
        }
    }

    fn plan(&self, h: f32, substeps: u32, last: bool) -> Plan<L> {
        let settings = &self.settings;
        let solving = settings.tolerance > 0.0;
        let examined = (last && settings.certify).then_some(substeps - 1);
        let mut pairs = self.pairs.iter();
        let bounces = |pair: &Pair| pair.restitution > 0.0 && pair.count > 0 && !pair.rests;
        let bouncing = self.colliders.bounce && pairs.any(bounces);
        let params = SubstepParams {
            h,
            substeps,
            iterations: settings.iterations.max(1),
            gravity: self.gravity,
            repair: settings.repair_in(h),
            softness: settings.softness,
        };
        Plan {
            params,
            solving,
            examined,
            ledger: settings.ledger,
            collisions: bouncing.then_some(ImpactSettings {
                law: settings.impact_law,
                dt: h,
                threshold: settings.restitution_threshold,
                rounds: COLLISION_ROUNDS,
                sweeps: COLLISION_SWEEPS,
            }),
            together: solving || examined.is_some() || settings.ledger || bouncing || self.saving,
        }
    }

    /// Makes the contacts of a part, which lasts `dt` \[s\], ready for its substeps; whether they are the
    /// `same` manifolds as before, with as many points.
    fn pack(&mut self, plan: &Plan<L>, dt: f32, same: bool) {
        self.displacements.fill(Velocity::ZERO);
        self.bodies.turned.fill(false);
        // The first substep asks the contacts, and sets them.
        self.prospective.resize(self.len(), Velocity::ZERO);
        let (system, wide, certifier) = (&mut self.system, &mut self.wide, &mut self.certifier);
        let (records, bodies, softness) = (&self.records, &self.bodies, self.settings.softness);
        let certifying = plan.solving || plan.examined.is_some();
        if certifying {
            certifier.find_islands(&system.masses, records.pairs());
        }
        let stiffness = if plan.solving {
            let of = |body| [bodies.weight(body, self.gravity), bodies.thickness[body]];
            certifier.stiffness(records.pairs(), of, &self.settings, plan.params.h)
        } else {
            certifier.no_stiffness()
        };
        let (velocities, together) = (&system.velocities, plan.together);
        let in_order = plan.solving || self.settings.certify;
        let rows = CacheSource { records, velocities, stiffness, same, together, in_order };
        wide.pack(&rows, &system.masses, softness);
        let of = (&self.colliders, &self.bodies);
        let moving = (system.velocities.as_slice(), dt);
        self.surfaces.give(of, &self.pairs, records.manifolds.len(), moving, wide);
        if certifying {
            certifier.start(system, wide);
        }
        if plan.ledger || plan.collisions.is_some() {
            wide.unpack(system);
        }
        if plan.ledger {
            self.books.open(&self.bodies, self.gravity, system);
        }
    }

    /// Forces, blows, contacts, motion, and contacts again as rigid ones: a substep of everything at once, with
    /// all that may go with it. Without, it is that of [`SubstepContext::run_by_batch`].
    fn substep(
        &mut self,
        plan: &Plan<L>,
        substep: u32,
        renewed: &mut bool,
        clock: &mut StageTimer,
        report: &mut StepReport,
    ) {
        let params = &plan.params;
        if plan.ledger {
            self.books.start(&self.system.velocities);
        }
        if plan.collisions.is_some() {
            self.follow_turns(plan.ledger);
        }
        if plan.collisions.is_some() {
            self.forced.clone_from(&self.system.velocities);
        }
        self.course().bodies.predict(params);
        clock.lap(Stage::Predict);
        if let Some(collisions) = &plan.collisions {
            if *renewed {
                self.wide.unpack(&mut self.system);
            }
            for (forced, velocity) in self.forced.iter_mut().zip(&self.system.velocities) {
                *forced = *velocity - *forced;
            }
            report.collisions += self.bounce(plan, collisions);
            clock.lap(Stage::Bounce);
        }
        let examined = plan.examined == Some(substep);
        let saving = self.saving && substep + 1 == params.substeps;
        let turning = self.course().warm_start(substep, *renewed, params);
        if plan.solving || saving {
            let velocities = turning.then_some(&self.system.velocities[..]);
            self.wide.set_targets(&self.displacements, velocities, &params.repair);
            self.course().run_belts(params, substep);
        }
        if saving {
            self.save(params.h);
        }
        clock.lap(Stage::WarmStart);
        let solved = if plan.solving {
            let (system, wide, certifier) = (&mut self.system, &mut self.wide, &mut self.certifier);
            let prospective = &self.prospective;
            let outcome = certifier.refine(system, wide, prospective, &self.settings, examined);
            report.sweeps += outcome.iterations;
            Some(outcome)
        } else {
            self.course().solve(params, substep, turning);
            clock.lap(Stage::Solve);
            let velocities = &self.system.velocities;
            let examine = || self.certifier.examine(velocities, &self.wide, &self.prospective);
            examined.then(examine)
        };
        if let Some(outcome) = solved {
            report.join(&outcome, clock);
        }
        if plan.ledger {
            self.wide.unpack(&mut self.system);
            self.books.depart(&self.system);
        }
        let Advanced { turned, fastest } = self.course().bodies.advance(params);
        clock.lap(Stage::Advance);
        if plan.ledger {
            self.books.arrive(&self.system.velocities);
        }
        *renewed = turned && self.course().renew(params);
        if turned && (plan.solving || plan.examined.is_some()) {
            self.certifier.island_solver.follow(&self.system);
        }
        self.course().relax(*renewed, fastest, params);
        if plan.ledger {
            self.wide.unpack(&mut self.system);
            self.surfaces.note(&self.wide);
            let surfaces = &self.surfaces.done;
            self.books.end(&self.bodies, self.gravity, (&self.system, surfaces), params.h);
        }
        clock.lap(Stage::Relax);
        if examined {
            let sinking = report.certified.map_or(0.0, |of| of.residuals[1]);
            report.jams = self.certifier.jams(&mut self.system, &self.wide, sinking);
            clock.lap(Stage::Certify);
        }
    }

    /// M^-1 of the bodies that precess, at their present poses. Slow turns do not update it, and an impact with that
    /// of an earlier pose would create energy.
    fn follow_turns(&mut self, ledger: bool) {
        let (bodies, masses) = (&self.bodies, &mut self.system.masses);
        for (body, mass) in masses.iter_mut().enumerate() {
            if bodies.turned[body] && bodies.precession[body].rate > 0.0 {
                let moments = bodies.inertia[body].inverse_moments;
                mass.angular = G::frame(&bodies.poses[body]).tensor(moments);
                if ledger {
                    self.books.turn(body, bodies.mass(body), mass);
                }
            }
        }
    }

    /// Collisions at the start of a substep; returns how many there were.
    fn bounce(&mut self, plan: &Plan<L>, collisions: &ImpactSettings<f32>) -> usize {
        let (system, books, moved) = (&mut self.system, &mut self.books, &mut self.displacements);
        if plan.ledger {
            books.strike(0, &system.velocities);
        }
        system.set_targets(moved, &plan.params.repair);
        let count =
            restitution::collide(system, moved, &self.forced, collisions, &mut self.impact_solver);
        self.wide.take_impacts(system);
        if count > 0 {
            for (body, turn) in self.bodies.turns.iter_mut().enumerate() {
                turn.struck |= self.impact_solver.is_struck(body);
            }
        }
        if plan.ledger {
            books.strike(1, &system.velocities);
        }
        count
    }

    /// Saves the contact system of a substep of `h` \[s\] before it is solved.
    fn save(&mut self, h: f32) {
        let mut system = self.system.clone();
        // Prospective: as the contacts find them.
        system.velocities.clone_from(&self.prospective);
        self.wide.unpack(&mut system);
        let positions = self.bodies.frames.iter().map(|frame| frame.position).collect();
        self.saved = Some(SavedSystem { system, positions, substep: h });
    }

    /// Gives poses back at the end of a part.
    fn arrive(&mut self, plan: &Plan<L>, clock: &mut StageTimer, report: &mut StepReport) {
        let velocities = &mut self.system.velocities;
        if plan.ledger {
            self.books.stop(velocities);
        }
        motion::arrive(&mut self.bodies, &self.pool, &self.displacements, velocities);
        if plan.ledger {
            let ledger = self.books.close(&self.bodies, self.gravity, &self.system.velocities);
            report.energy.get_or_insert_default().join(&ledger);
        }
        clock.lap(Stage::Advance);
    }

    /// M^-1 of all bodies that have moved far enough for a rebuild, at their present poses; nothing moves one that sleeps.
    fn update_masses(&mut self) {
        let (bodies, sleep) = (&self.bodies, &self.sleep);
        let (useful, share) = self.pool.share(bodies.poses.len(), GRAIN);
        let masses = self.system.masses.chunks_mut(share).enumerate();
        self.pool.for_each(useful, masses, |(part, masses)| {
            for (body, mass) in (share * part..).zip(masses) {
                if sleep.is_sleeping(body) {
                    *mass = InverseMass::FIXED;
                } else if bodies.needs_rebuild[body] || *mass == InverseMass::FIXED {
                    *mass = bodies.inverse_mass(body);
                }
            }
        });
    }

    /// Wakes a body, by its slot, and all that sleeps with it; returns whether it slept.
    fn wake_slot(&mut self, body: usize) -> bool {
        let (bodies, masses) = (&self.bodies, &mut self.system.masses);
        self.sleep.wake(body, |member| masses[member] = bodies.inverse_mass(member))
    }

    /// Wakes a body and all whose boxes overlap one of its own.
    fn wake_neighbors(&mut self, body: usize) {
        let Self { bodies, colliders, broad_phase, sleep, system, .. } = self;
        let mut wake = |body: usize| {
            sleep.wake(body, |member| system.masses[member] = bodies.inverse_mass(member));
        };
        wake(body);
        for collider in colliders.of_body(body) {
            broad_phase.overlapping(collider, |other| {
                if colliders.pair(bodies, [collider.min(other), collider.max(other)]).is_some() {
                    wake(colliders.body[other as usize] as usize);
                }
            });
        }
    }

    fn wake_all(&mut self) {
        if self.sleep.count() > 0 {
            for body in 0..self.len() {
                self.wake_slot(body);
            }
        }
    }

    /// Pairs of shapes whose boxes, enlarged by where they can get to in `dt`, overlap.
    fn find_pairs(&mut self, dt: f32) {
        let reach = self.settings.prediction_distance * 0.5;
        let bodies = &self.bodies;
        self.travel.find(moving(bodies, &self.system, dt), &self.pool);
        let (travel, sleep) = (&self.travel.own, &self.sleep);
        self.colliders.follow(&mut self.broad_phase, bodies, sleep, travel, reach, &self.pool);
        let Some(found) = self.broad_phase.follow(&mut self.pairs, &self.pool) else { return };
        let fresh = &mut self.fresh_pairs;
        fresh.clear();
        let (colliders, bodies) = (&self.colliders, &self.bodies);
        fresh.extend(found.filter_map(|pair| colliders.pair(bodies, pair)));
        let (fall, settings) = (self.gravity.length() * dt * dt, &self.settings);
        let moving = moving(bodies, &self.system, dt);
        if self.workers.is_empty() {
            self.workers.push(PairWorker::default());
        }
        for pair in fresh.iter_mut() {
            let passed = moving.passed(travel, pair, || 0.0).unwrap_or_default();
            let passed = passed[0] + passed[1] + fall;
            // It decides how often contacts are searched for, if it is as near as its box.
            if passed > settings.travel_per_search * pair.thickness {
                let prediction = passed + 2.0 * settings.prediction_distance;
                self.workers[0].measure_room(colliders, bodies, pair, prediction);
            }
        }
        cache::merge(&mut self.pairs, fresh);
        self.colliders.release();
    }

    /// Finds manifolds, of which points are reused while bodies move less than `reuse` \[m\]. Returns whether
    /// there are the same as before, with as many points.
    fn find_manifolds(&mut self, reuse: f32, dt: f32) -> bool {
        // Two bodies that need no rebuild have come half of what contacts are reused for, at most.
        let limit = 0.25 * reuse;
        self.bodies.mark_moved(limit, &self.system.velocities, &self.pool);
        self.update_masses();
        if reuse < std::mem::replace(&mut self.last_reuse, reuse) {
            // How long points last was found for more.
            self.pairs.iter_mut().filter(|pair| pair.count > 0).for_each(|pair| pair.room = 0.0);
        }
        std::mem::swap(&mut self.records, &mut self.old_records);
        self.update_active();
        if self.sleep.count() > 0 {
            let active = |body: u32| self.active[body as usize];
            self.sleep.rest_pairs(&mut self.pairs, &self.old_records, active);
        }
        let (mut traced, mut same) = (true, true);
        loop {
            if self.collide(traced, reuse, dt) {
                same = false;
            } else {
                std::mem::swap(&mut self.records, &mut self.old_records);
            }
            traced = false;
            // What is touched wakes, and may wake what it touches.
            if !self.wake_touched() {
                self.sleep.placed.clear();
                self.find_patches();
                self.settle_seams(dt);
                // A tolerance shares loads as it should.
                if self.settings.tolerance == 0.0 {
                    self.patches.join(&mut self.records);
                }
                return same;
            }
            self.update_active();
            std::mem::swap(&mut self.records, &mut self.old_records);
        }
    }

    fn update_active(&mut self) {
        let (bodies, velocities) = (&self.bodies, &self.system.velocities);
        let active = |body: usize| self.sleep.is_active(bodies, velocities, body);
        self.active.resize(bodies.poses.len(), false);
        let (useful, share) = self.pool.share(bodies.poses.len(), GRAIN);
        self.pool.for_each(useful, self.active.chunks_mut(share).enumerate(), |(part, own)| {
            (share * part..).zip(own).for_each(|(body, own)| *own = active(body));
        });
        self.sleep.placed.iter().for_each(|&body| self.active[body as usize] = true);
    }

    /// Wakes what something active touches; returns whether any slept.
    fn wake_touched(&mut self) -> bool {
        let mut any = false;
        if self.sleep.count() == 0 {
            return any;
        }
        for record in 0..self.records.manifolds.len() {
            for body in self.records.manifolds[record].bodies {
                any |= self.sleep.is_sleeping(body as usize) && self.wake_slot(body as usize);
            }
        }
        any
    }

    /// Finds the manifolds from those of before, which have been `traced` or only found. Returns whether there
    /// are others.
    fn collide(&mut self, traced: bool, reuse_distance: f32, dt: f32) -> bool {
        let around = NarrowPhaseInput::<G, L, A> {
            shapes: &self.colliders.shapes,
            poses: &self.colliders.poses,
            bodies: &self.bodies,
            travel: &self.travel.own,
            moving: moving(&self.bodies, &self.system, dt),
            traced,
            resting: &self.sleep.records,
            active: &self.active,
            prediction_distance: self.settings.prediction_distance,
            fall: self.gravity.length() * dt * dt,
            reuse_distance,
        };
        let records = (&mut self.old_records, &mut self.records);
        manifolds(&around, &mut self.pairs, &mut self.workers, &self.pool, records)
    }

    /// Turns manifolds at seams and corners to the axes along which their bodies are held apart.
    fn settle_seams(&mut self, dt: f32) {
        let meeting = SeamInput::<G, L, A> {
            shapes: &self.colliders.shapes,
            poses: &self.colliders.poses,
            bodies: &self.bodies,
            velocities: &self.system.velocities,
            dt,
        };
        let closing = closing(&self.workers, self.pairs.len(), &self.pool);
        self.seams.settle(&meeting, closing, &mut self.pairs, &mut self.records);
    }

    /// Finds contacts of compounds, and opens those between sides that another part covers.
    fn find_patches(&mut self) {
        let shapes = Shapes { colliders: &self.colliders, bodies: &self.bodies };
        self.patches.find(&self.pairs, &shapes, &mut self.records);
    }

    /// Energies, deepest overlap and residual as the last step left them.
    pub fn measure(&self) -> Measure {
        let mut out = Measure { finite: true, ..Measure::default() };
        for body in 0..self.len() {
            let frame = &self.bodies.frames[body];
            let velocity = &self.system.velocities[body];
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
        out.deepest_penetration = f64::from(self.wide.overlap());
        for pair in self.pairs.iter().filter(|pair| pair.rests) {
            let resting = self.sleep.records.view();
            for record in resting.of(pair.records()) {
                for trace in resting.traces_of(record) {
                    out.deepest_penetration = out.deepest_penetration.max(f64::from(-trace.gap[0]));
                }
            }
        }
        out.residual = f64::from(self.wide.residual(&self.system.velocities));
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

#[cfg(test)]
mod tests {
    use super::*;

    /// As many substeps as pass no more than they may, and one at least.
    #[test]
    fn searches_are_as_far_apart_as_they_may_be() {
        let of = |passed: [f32; 5], substeps| {
            passed.map(|passed| substeps_until_search(substeps, passed))
        };
        assert_eq!(of([1.0, 2.0, 3.1, 4.1, 99.0], 8), [8, 4, 2, 1, 1]);
        // What has become slower may go on for longer.
        assert_eq!(of([0.25, 0.5, 0.9, 1.0, 1.1], 2), [8, 4, 2, 2, 1]);
        assert_eq!(substeps_until_search(1, 0.0), u32::MAX);
    }
}
