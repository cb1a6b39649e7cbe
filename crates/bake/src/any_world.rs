//! [`AnyWorld`]: a world of any kind, made from a scene or body by body, in numbers and slices.
//!
//! Only this module names all four kinds of worlds. A function that depends on the dimension is
//! generic and stands once.

mod guide;
mod slices;

use std::collections::BTreeMap;
use std::mem;
use std::sync::Arc;

use drystone::{
    BodyId, Checkpoint, CheckpointError, Clock, ContactPoints, Drive, InputError, JointId,
    JointState, Measure, Nearby, ParticleWorld2, ParticleWorld3, StepReport, StepSettings, World2,
    World3,
};
use drystone_scene::{Body, Motion, Scene, SurfaceVelocity};
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

pub use slices::{PairImpulses, TouchingPairs};

use crate::convert::{body_of, name, surface_motion};
use crate::decomposition::Decompositions;
use crate::error::BuildError;
use crate::input::{check_body, check_count, check_surface};
use crate::joints;
use crate::world_kind::WorldKind;
use guide::Guide;
use slices::{
    Place, by_body, impulses_of, pose_of, velocity_of, write_pose, write_touching, write_velocity,
};

/// The world itself.
enum Worlds {
    Rigid2(Box<World2>),
    Rigid3(Box<World3>),
    Particles2(Box<ParticleWorld2>),
    Particles3(Box<ParticleWorld3>),
}

/// Evaluates an expression with the world of whichever kind.
macro_rules! each {
    ($worlds:expr, $world:ident => $do:expr) => {
        match $worlds {
            Worlds::Rigid2($world) => $do,
            Worlds::Rigid3($world) => $do,
            Worlds::Particles2($world) => $do,
            Worlds::Particles3($world) => $do,
        }
    };
}

/// A step of a scene that simulates less than this leaves all bodies where they are. \[s\]
const STILL: f64 = 1e-9;

/// A world of any kind, which is chosen when the program runs.
///
/// Bodies are described as in scenes. Their state is read and set in slices of `f32`. A pose is in
/// 3D px py pz qx qy qz qw, in 2D px py angle. A velocity is in 3D vx vy vz wx wy wz, in 2D vx vy
/// w; a force is a force and a torque alike. Rotations of particles are the identity, and ignored
/// where given. \[m, rad, m/s, rad/s, N, N m\]
///
/// ```
/// use drystone::StepSettings;
/// use drystone_bake::{AnyWorld, WorldKind};
/// use drystone_scene::{Body, Motion, ShapeKind};
///
/// let mut world = AnyWorld::new(WorldKind::Rigid2, StepSettings::realtime());
/// world.set_gravity(&[0.0, -9.81])?;
/// let ground = ShapeKind::Halfspace { normal: vec![0.0, 1.0] };
/// world.add(&Body::new(Motion::Static, [0.0, 0.0], ground))?;
/// let disk = ShapeKind::Sphere { radius: 0.5 };
/// let disk = world.add(&Body::new(Motion::Dynamic, [0.0, 0.5], disk))?;
/// world.set_velocities(&[disk], &[1.0, 0.0, -2.0])?;
/// for _ in 0..60 {
///     world.step(1.0 / 60.0)?;
/// }
/// let pose = world.pose(disk).unwrap();
/// assert!((pose[0] - 1.0).abs() < 1e-3, "it rolls without slip");
/// # Ok::<(), drystone_bake::BuildError>(())
/// ```
pub struct AnyWorld {
    worlds: Worlds,
    /// Tracks and forces of bodies, by slot.
    guides: Arc<BTreeMap<usize, Guide>>,
    /// Time since the start. \[s\]
    time: f64,
    /// Decompositions of the meshes added so far.
    meshes: Decompositions,
}

/// Builds a world from a scene. Concave meshes of dynamic bodies are decomposed; equal meshes share
/// one decomposition.
///
/// # Errors
/// A shape does not exist in the scene's dimension, or has no volume; a number is out of range.
pub fn build(scene: &Scene, settings: StepSettings) -> Result<AnyWorld, BuildError> {
    build_with(scene, settings, &mut Decompositions::default())
}

/// Builds a world from a scene, with a cache of decompositions.
///
/// # Errors
/// Those of [`build`].
pub fn build_with(
    scene: &Scene,
    settings: StepSettings,
    known: &mut Decompositions,
) -> Result<AnyWorld, BuildError> {
    settings.check()?;
    let mut world = AnyWorld::new(WorldKind::of(scene), settings);
    let gravity: Vec<f32> = scene.gravity.iter().map(|x| *x as f32).collect();
    world.set_gravity(&gravity)?;
    let mut ids = Vec::with_capacity(scene.bodies.len());
    for body in &scene.bodies {
        ids.push(world.add_with(body, known)?);
    }
    for (index, joint) in scene.joints.iter().enumerate() {
        let refused = |error| BuildError::Joint { joint: joints::name(joint, index), error };
        world.join(joint, &ids).map_err(refused)?;
    }
    // A joint that is added wakes its bodies, and a static body those near it.
    for (_, &id) in scene.bodies.iter().zip(&ids).filter(|(body, _)| body.start_asleep) {
        world.put_to_sleep(id)?;
    }
    Ok(world)
}

/// Making a world, and its bodies.
impl AnyWorld {
    /// Creates an empty world without gravity, on one thread.
    pub fn new(kind: WorldKind, settings: StepSettings) -> Self {
        let worlds = match kind {
            WorldKind::Rigid2 => Worlds::Rigid2(Box::new(World2::new(settings))),
            WorldKind::Rigid3 => Worlds::Rigid3(Box::new(World3::new(settings))),
            WorldKind::Particles2 => Worlds::Particles2(Box::new(ParticleWorld2::new(settings))),
            WorldKind::Particles3 => Worlds::Particles3(Box::new(ParticleWorld3::new(settings))),
        };
        let (guides, meshes) = (Arc::default(), Decompositions::default());
        Self { worlds, guides, time: 0.0, meshes }
    }

    /// Returns the kind of the world.
    pub fn kind(&self) -> WorldKind {
        match self.worlds {
            Worlds::Rigid2(_) => WorldKind::Rigid2,
            Worlds::Rigid3(_) => WorldKind::Rigid3,
            Worlds::Particles2(_) => WorldKind::Particles2,
            Worlds::Particles3(_) => WorldKind::Particles3,
        }
    }

    /// Adds a body. A concave mesh of a dynamic body is decomposed; equal meshes of a world share
    /// one decomposition. Its track begins at the time 0 of the world.
    ///
    /// # Errors
    /// A shape does not exist in this kind of world, or has no volume. A list of numbers has the
    /// wrong length, or a number is out of range. The world is then as it was.
    pub fn add(&mut self, body: &Body) -> Result<BodyId, BuildError> {
        let mut known = mem::take(&mut self.meshes);
        let added = self.add_with(body, &mut known);
        self.meshes = known;
        added
    }

    /// Adds a body, with a cache of decompositions.
    ///
    /// # Errors
    /// Those of [`AnyWorld::add`].
    pub fn add_with(
        &mut self,
        body: &Body,
        known: &mut Decompositions,
    ) -> Result<BodyId, BuildError> {
        let index = self.len();
        check_body(body, index, self.kind())?;
        let refused = |error| BuildError::Body { body: name(body, index), error };
        let added = each!(&mut self.worlds, world => {
            let body = body_of(body, index, known)?;
            world.add(body)
        });
        let id = added.map_err(refused)?;
        self.guide(id, body).map_err(refused)?;
        Ok(id)
    }

    /// Prepares what a scene prescribes for a body that has just been added.
    fn guide(&mut self, id: BodyId, body: &Body) -> Result<(), InputError> {
        let is_dynamic = body.motion == Motion::Dynamic;
        let guide = Guide::of(body);
        if is_dynamic && guide.leads(self.time) {
            self.hold(id, true)?;
        }
        if body.start_asleep {
            self.put_to_sleep(id)?;
        }
        if self.time != 0.0 {
            self.place_meshes(id, &guide, Place::Anew)?;
        }
        if guide.follows() || !guide.meshes.is_empty() || is_dynamic && guide.pushes() {
            Arc::make_mut(&mut self.guides).insert(id.index(), guide);
        }
        Ok(())
    }

    /// Gives the meshes of a body that deform the vertices of the present time.
    fn place_meshes(&mut self, id: BodyId, guide: &Guide, place: Place) -> Result<(), InputError> {
        let time = self.time;
        for mesh in &guide.meshes {
            each!(&mut self.worlds, world => slices::place_mesh(world, id, mesh, (time, place)))?;
        }
        Ok(())
    }

    /// Adds a joint. Its bodies are indices into `bodies`.
    ///
    /// # Errors
    /// Those of [`World::join`](drystone::World::join).
    pub fn join(
        &mut self,
        joint: &drystone_scene::Joint,
        bodies: &[BodyId],
    ) -> Result<JointId, InputError> {
        if let Some(unknown) = joint.bodies.into_iter().flatten().find(|&at| at >= bodies.len()) {
            let most = bodies.len() as f64 - 1.0;
            return Err(InputError::OutOfRange {
                item: "the body of the joint".to_owned(),
                value: unknown as f64,
                accepted: [0.0, most],
            });
        }
        each!(&mut self.worlds, world => {
            world.join(joints::joint_of(joint, |index| bodies.get(index).copied()))
        })
    }

    /// Removes a joint. Returns true if it was there.
    pub fn unjoin(&mut self, id: JointId) -> bool {
        each!(&mut self.worlds, world => world.unjoin(id))
    }

    /// Returns what a joint does, or `None` if it is unknown.
    pub fn joint(&self, id: JointId) -> Option<JointState> {
        each!(&self.worlds, world => world.joint(id))
    }

    /// Sets the drive of a joint ([`World::drive`](drystone::World::drive)).
    ///
    /// # Errors
    /// Those of [`World::drive`](drystone::World::drive).
    pub fn drive(&mut self, id: JointId, drive: Drive) -> Result<(), InputError> {
        each!(&mut self.worlds, world => world.drive(id, drive))
    }

    /// Returns the joints in the order of their slots.
    pub fn joints(&self) -> Vec<JointId> {
        each!(&self.worlds, world => world.joints().collect())
    }

    /// Removes a body, and wakes the bodies near it. Returns true if it was there.
    pub fn remove(&mut self, id: BodyId) -> bool {
        let is_there = each!(&mut self.worlds, world => world.remove(id));
        if is_there && self.guides.contains_key(&id.index()) {
            Arc::make_mut(&mut self.guides).remove(&id.index());
        }
        is_there
    }

    /// Returns the number of slots of bodies, free ones included.
    pub fn len(&self) -> usize {
        each!(&self.worlds, world => world.len())
    }

    /// Returns true if the world has never had a body.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the body in a slot, if any.
    pub fn body_at(&self, slot: usize) -> Option<BodyId> {
        each!(&self.worlds, world => world.body_at(slot))
    }

    /// Returns all bodies in the order of their slots.
    pub fn bodies(&self) -> impl Iterator<Item = BodyId> + '_ {
        (0..self.len()).filter_map(|slot| self.body_at(slot))
    }
}

/// Steps, their settings and their reports.
impl AnyWorld {
    /// Advances the world by `dt` \[s\]. Bodies with a track follow it, and so do the vertices of
    /// meshes with one. A dynamic body is released before the step that would lead beyond the end of
    /// its track.
    ///
    /// # Errors
    /// The step or a setting is out of range, or a track leads too far or too fast.
    pub fn step(&mut self, dt: f64) -> Result<StepReport, InputError> {
        self.advance(dt, dt)
    }

    /// Takes a step of a scene, counted from 0, at the speed and with the gravity that it has then. The
    /// [time](Self::time) passes by the time step of the scene.
    ///
    /// # Errors
    /// Those of [`step`](Self::step).
    pub fn step_scene(&mut self, scene: &Scene, step: usize) -> Result<StepReport, InputError> {
        let (dt, gravity) = scene.terms_of(step);
        if !scene.track.times.is_empty() {
            let gravity: Vec<f32> = gravity.iter().map(|x| *x as f32).collect();
            self.set_gravity(&gravity)?;
        }
        if dt < STILL {
            self.time += scene.time_step;
            return Ok(StepReport::default());
        }
        self.advance(scene.time_step, dt)
    }

    /// Advances the world by `dt` while so much `passing` time of its tracks passes. \[s\]
    fn advance(&mut self, passing: f64, dt: f64) -> Result<StepReport, InputError> {
        let time = self.time + passing;
        let (worlds, guides) = (&mut self.worlds, Arc::clone(&self.guides));
        for (&slot, guide) in guides.iter() {
            each!(worlds, world => slices::guide(world, slot, guide, [time, passing, dt]))?;
        }
        let report = each!(worlds, world => world.step(dt as f32))?;
        self.time = time;
        Ok(report)
    }

    /// Returns the time since the start: of its tracks, or the sum of all steps. \[s\]
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Returns the settings of steps.
    pub fn settings(&self) -> &StepSettings {
        each!(&self.worlds, world => &world.settings)
    }

    /// Returns the settings of the following steps, to be changed.
    pub fn settings_mut(&mut self) -> &mut StepSettings {
        each!(&mut self.worlds, world => &mut world.settings)
    }

    /// Returns the acceleration of gravity. \[m/s^2\]
    pub fn gravity(&self) -> &[f32] {
        each!(&self.worlds, world => &world.gravity.0[..])
    }

    /// Sets the acceleration of gravity. \[m/s^2\] The next step checks its range.
    ///
    /// # Errors
    /// It has not as many numbers as the world has dimensions.
    pub fn set_gravity(&mut self, gravity: &[f32]) -> Result<(), InputError> {
        check_count("gravity", gravity.len(), self.kind().dimension())?;
        each!(&mut self.worlds, world => for (own, new) in world.gravity.0.iter_mut().zip(gravity) {
            *own = *new;
        });
        Ok(())
    }

    /// Sets the number of threads; results do not depend on it. Without the feature `threads` there
    /// is one.
    pub fn set_threads(&mut self, threads: usize) {
        each!(&mut self.worlds, world => world.set_threads(threads));
    }

    /// Sets the clock ([`World::set_clock`](drystone::World::set_clock)).
    pub fn set_clock(&mut self, clock: Clock) {
        each!(&mut self.worlds, world => world.set_clock(clock));
    }

    /// Turns the timing of stages on or off
    /// ([`World::time_stages`](drystone::World::time_stages)).
    pub fn time_stages(&mut self, timing: bool) {
        each!(&mut self.worlds, world => world.time_stages(timing));
    }

    /// Turns the recording of impulses on or off
    /// ([`World::record_impulses`](drystone::World::record_impulses)).
    pub fn record_impulses(&mut self, recording: bool) {
        each!(&mut self.worlds, world => world.record_impulses(recording));
    }

    /// Turns the saving of contacts and joints on or off
    /// ([`World::save_systems`](drystone::World::save_systems)).
    pub fn save_systems(&mut self, saving: bool) {
        each!(&mut self.worlds, world => world.save_systems(saving));
    }

    /// Returns the saved contacts and joints as matrices ([`World::saved`](drystone::World::saved));
    /// `None` if nothing was saved. Feature `assembled`.
    ///
    /// # Errors
    /// The system has a number that is NaN or infinite.
    #[cfg(feature = "assembled")]
    pub fn saved(
        &self,
    ) -> Option<Result<drystone::SavedProblem, drystone_solver::assembled::ProblemError>> {
        each!(&self.worlds, world => world.saved().map(drystone::SavedSystem::problem))
    }

    /// Returns energies, deepest penetration and residual after the last step.
    pub fn measure(&self) -> Measure {
        each!(&self.worlds, world => world.measure())
    }

    /// Returns the pairs of bodies near each other at the last search for contacts, one entry per
    /// manifold.
    pub fn nearby(&self) -> Vec<Nearby> {
        each!(&self.worlds, world => world.nearby())
    }

    /// Returns the contact points of the last substep, one entry per point, without those of bodies
    /// that sleep.
    pub fn contact_points(&self) -> ContactPoints {
        each!(&self.worlds, world => world.contact_points())
    }

    /// Replaces `pairs` by the colliders that touched in the last step
    /// ([`World::touching`](drystone::World::touching)).
    pub fn write_touching(&self, pairs: &mut TouchingPairs) {
        each!(&self.worlds, world => write_touching(world, pairs));
    }

    /// Returns the impulses between colliders in the last step, if they are recorded
    /// ([`World::impulses`](drystone::World::impulses)).
    pub fn impulses(&self) -> PairImpulses {
        each!(&self.worlds, world => impulses_of(world))
    }
}

/// State of bodies.
impl AnyWorld {
    /// Returns the pose of a body's origin.
    pub fn pose(&self, id: BodyId) -> Option<Vec<f32>> {
        each!(&self.worlds, world => world.pose(id).map(|pose| write_pose(world, &pose)))
    }

    /// Returns the velocity of a body's center of mass.
    pub fn velocity(&self, id: BodyId) -> Option<Vec<f32>> {
        let mut out = Vec::with_capacity(self.kind().velocity_numbers());
        each!(&self.worlds, world => write_velocity(world.velocity(id)?, &mut out));
        Some(out)
    }

    /// Appends the poses of all slots in order.
    pub fn write_poses(&self, out: &mut Vec<f32>) {
        each!(&self.worlds, world => world.write_poses(out));
    }

    /// Appends the velocities of all slots in order.
    pub fn write_velocities(&self, out: &mut Vec<f32>) {
        each!(&self.worlds, world => {
            world.velocities().iter().for_each(|velocity| write_velocity(*velocity, out));
        });
    }

    /// Returns the mass of each slot; infinite for static and kinematic bodies. \[kg\]
    pub fn masses(&self) -> Vec<f64> {
        each!(&self.worlds, world => world.masses())
    }

    /// Teleports bodies ([`World::set_pose`](drystone::World::set_pose)).
    ///
    /// # Errors
    /// There are not as many numbers as the bodies need; a body is unknown, or its pose is out of
    /// range. No body is then changed.
    pub fn set_poses(&mut self, bodies: &[BodyId], poses: &[f32]) -> Result<(), InputError> {
        let mut all = by_body(bodies, poses, self.kind().pose_numbers())?;
        each!(&mut self.worlds, world => {
            all.clone().try_for_each(|(id, pose)| world.check_set_pose(id, &pose_of(world, pose)))?;
            all.try_for_each(|(id, pose)| {
                let pose = pose_of(world, pose);
                world.set_pose(id, &pose)
            })
        })
    }

    /// Sets the velocities of dynamic or kinematic bodies
    /// ([`World::set_velocity`](drystone::World::set_velocity)).
    ///
    /// # Errors
    /// There are not as many numbers as the bodies need; a body is unknown or static, or its
    /// velocity is out of range. No body is then changed.
    pub fn set_velocities(
        &mut self,
        bodies: &[BodyId],
        velocities: &[f32],
    ) -> Result<(), InputError> {
        let mut all = by_body(bodies, velocities, self.kind().velocity_numbers())?;
        each!(&mut self.worlds, world => {
            all.clone().try_for_each(|(id, of)| world.check_set_velocity(id, &velocity_of(of)))?;
            all.try_for_each(|(id, of)| world.set_velocity(id, velocity_of(of)))
        })
    }

    /// Sets the velocities with which bodies reach poses after `dt` \[s\]
    /// ([`World::move_to`](drystone::World::move_to)).
    ///
    /// # Errors
    /// There are not as many numbers as the bodies need; a body is unknown or static, or a number
    /// is out of range. No body is then changed.
    pub fn move_to(&mut self, bodies: &[BodyId], poses: &[f32], dt: f64) -> Result<(), InputError> {
        let (mut all, dt) = (by_body(bodies, poses, self.kind().pose_numbers())?, dt as f32);
        each!(&mut self.worlds, world => {
            all.clone().try_for_each(|(id, pose)| {
                world.check_move_to(id, &pose_of(world, pose), dt)
            })?;
            all.try_for_each(|(id, pose)| {
                let pose = pose_of(world, pose);
                world.move_to(id, &pose, dt)
            })
        })
    }

    /// Adds forces and torques that act during the next step
    /// ([`World::add_force`](drystone::World::add_force)).
    ///
    /// # Errors
    /// There are not as many numbers as the bodies need; a body is unknown, or its force is out of
    /// range. No force is then added.
    pub fn add_forces(&mut self, bodies: &[BodyId], forces: &[f32]) -> Result<(), InputError> {
        let mut all = by_body(bodies, forces, self.kind().velocity_numbers())?;
        each!(&mut self.worlds, world => {
            all.clone().try_for_each(|(id, of)| world.check_add_force(id, &velocity_of(of)))?;
            all.try_for_each(|(id, of)| world.add_force(id, velocity_of(of)))
        })
    }

    /// Sets or removes the surface velocity of a body
    /// ([`World::set_surface_velocity`](drystone::World::set_surface_velocity)).
    ///
    /// # Errors
    /// The body is unknown, or the velocity has a wrong number of components or is out of range.
    pub fn set_surface_velocity(
        &mut self,
        id: BodyId,
        velocity: Option<&SurfaceVelocity>,
    ) -> Result<(), InputError> {
        velocity.map_or(Ok(()), |velocity| check_surface(velocity, self.kind().dimension()))?;
        each!(&mut self.worlds, world => {
            world.set_surface_velocity(id, velocity.map(surface_motion))
        })
    }

    /// Sets the rates at which the linear and angular velocity of a body decay. \[1/s\]
    ///
    /// # Errors
    /// The body is unknown, or a rate is out of range.
    pub fn set_damping(&mut self, id: BodyId, damping: [f32; 2]) -> Result<(), InputError> {
        each!(&mut self.worlds, world => world.set_damping(id, damping))
    }

    /// Returns true if a body sleeps ([`World::is_sleeping`](drystone::World::is_sleeping)).
    pub fn is_sleeping(&self, id: BodyId) -> bool {
        each!(&self.worlds, world => world.is_sleeping(id))
    }

    /// Puts a dynamic body to sleep ([`World::put_to_sleep`](drystone::World::put_to_sleep)).
    ///
    /// # Errors
    /// The body is unknown, not dynamic or held.
    pub fn put_to_sleep(&mut self, id: BodyId) -> Result<(), InputError> {
        each!(&mut self.worlds, world => world.put_to_sleep(id))
    }

    /// Holds a dynamic body, or releases it ([`World::hold`](drystone::World::hold)).
    ///
    /// # Errors
    /// The body is unknown, or not dynamic.
    pub fn hold(&mut self, id: BodyId, held: bool) -> Result<(), InputError> {
        each!(&mut self.worlds, world => world.hold(id, held))
    }

    /// Wakes a body and all bodies that fell asleep with it.
    pub fn wake(&mut self, id: BodyId) {
        each!(&mut self.worlds, world => world.wake(id));
    }
}

/// State of the whole world.
impl AnyWorld {
    /// Returns the XXH3 hash (64 bits) of the poses, followed by the linear and angular velocities,
    /// of all bodies as little-endian `f32`. Particles have no angular velocities.
    pub fn state_hash(&self) -> u64 {
        let mut numbers = Vec::new();
        each!(&self.worlds, world => {
            world.write_poses(&mut numbers);
            for velocity in world.velocities() {
                numbers.extend(velocity.linear.0.iter().chain(&velocity.angular.0));
            }
        });
        let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        xxh3_64(&bytes)
    }

    /// Returns the state between two steps, with the bodies
    /// ([`World::checkpoint`](drystone::World::checkpoint)).
    pub fn checkpoint(&self) -> AnyCheckpoint {
        let world = each!(&self.worlds, world => world.checkpoint());
        AnyCheckpoint { time: self.time, world, guides: Some(Arc::clone(&self.guides)) }
    }

    /// Restores a state ([`World::restore`](drystone::World::restore)). With the same settings, all
    /// further steps are bitwise equal to those after the checkpoint.
    ///
    /// # Errors
    /// The checkpoint is of another world, or was read from bytes, and bodies were added or removed
    /// since it was taken. The world is then as it was.
    pub fn restore(&mut self, from: &AnyCheckpoint) -> Result<(), CheckpointError> {
        each!(&mut self.worlds, world => world.restore(&from.world))?;
        self.time = from.time;
        if let Some(guides) = &from.guides {
            self.guides = Arc::clone(guides);
        }
        // The time determines the vertices, which checkpoints as bytes do not have.
        for (&slot, guide) in Arc::clone(&self.guides).iter() {
            if let Some(id) = self.body_at(slot) {
                // They are those of a step that was taken, so nothing is refused.
                let _ = self.place_meshes(id, guide, Place::Restored);
            }
        }
        Ok(())
    }
}

/// State of an [`AnyWorld`] between two steps. As bytes it is without the bodies, and only a world
/// with the same bodies takes it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct AnyCheckpoint {
    time: f64,
    world: Checkpoint,
    /// `None` if it was read from bytes.
    #[serde(skip)]
    guides: Option<Arc<BTreeMap<usize, Guide>>>,
}

impl AnyCheckpoint {
    /// Returns the state as bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        // Writing plain numbers to memory cannot fail.
        postcard::to_stdvec(self).unwrap_or_default()
    }

    /// Reads a state from bytes.
    ///
    /// # Errors
    /// The bytes are no checkpoint.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, CheckpointError> {
        postcard::from_bytes(bytes).map_err(|error| CheckpointError::Unreadable(error.to_string()))
    }
}
