//! Builds a running world from a scene. Only this module instantiates all four dimensions: rigid
//! bodies and particles, in 2D and 3D.

use drystone::geometry::{Geometry, Particles, Rigid2, Rigid3};
use drystone::{
    BodyId, CheckpointError, Dimension, InputError, Measure, Nearby, StepReport, StepSettings,
    Vector, World,
};
use drystone_scene::{BodiesAs, Scene, Track};
use xxhash_rust::xxh3::xxh3_64;

use crate::convert::{body_of, name};
use crate::decomposition::Decompositions;
use crate::error::BuildError;
use crate::forms::{FromScene, floats, place};

/// A running scene of any dimension.
pub trait Simulation: Send {
    /// Advances the simulation by `dt` \[s\]; kinematic bodies follow their tracks.
    ///
    /// # Errors
    /// [`World::step`] and [`World::move_to`] refuse the step.
    fn step(&mut self, dt: f64) -> Result<StepReport, InputError>;

    /// Appends the poses of all bodies in scene order: 3D px py pz qx qy qz qw, 2D px py angle.
    /// \[m, rad\]
    fn write_poses(&self, out: &mut Vec<f32>);

    /// Returns the XXH3 hash (64 bits) of the poses, followed by the linear and angular velocities,
    /// of all bodies as little-endian `f32`.
    fn state_hash(&self) -> u64;

    /// Returns energies, deepest penetration and residual after the last step.
    fn measure(&self) -> Measure;

    /// Returns the state between two steps as bytes ([`World::checkpoint`]).
    fn checkpoint(&self) -> Vec<u8>;

    /// Restores a state of the same scene with the same settings ([`World::restore`]). All further
    /// steps are bitwise equal to those of the original run.
    ///
    /// # Errors
    /// The bytes are no checkpoint of this scene.
    fn restore(&mut self, checkpoint: &[u8]) -> Result<(), CheckpointError>;

    /// Returns the mass of each body; infinite for static and kinematic bodies. \[kg\]
    fn masses(&self) -> Vec<f64>;

    /// Returns the pairs of bodies near each other at the last search for contacts, one entry per
    /// manifold.
    fn nearby(&self) -> Vec<Nearby>;

    /// Sets the number of threads; results do not depend on it.
    fn set_threads(&mut self, threads: usize);

    /// Turns the timing of stages on or off ([`World::time_stages`]).
    fn time_stages(&mut self, timing: bool);

    /// Turns the saving of contact systems on or off ([`World::save_systems`]).
    fn save_systems(&mut self, saving: bool);

    /// Returns [`World::saved`] as matrices; `None` if nothing was saved. Feature `assembled`.
    ///
    /// # Errors
    /// The system has a number that is NaN or infinite.
    #[cfg(feature = "assembled")]
    fn saved(
        &self,
    ) -> Option<Result<drystone::SavedProblem, drystone_solver::assembled::ProblemError>>;

    /// Returns the step settings.
    fn settings(&self) -> &StepSettings;
}

/// Builds a world from a scene. Concave meshes of dynamic bodies are decomposed; equal meshes share
/// one decomposition.
///
/// # Errors
/// A shape does not exist in the scene's dimension, or has no volume.
pub fn build(scene: &Scene, settings: StepSettings) -> Result<Box<dyn Simulation>, BuildError> {
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
) -> Result<Box<dyn Simulation>, BuildError> {
    Ok(match (scene.dimension, scene.bodies_as) {
        (2, BodiesAs::Rigid) => Box::new(Run::<Rigid2, 2, 1>::new(scene, settings, known)?),
        (2, BodiesAs::Particles) => Box::new(Run::<Particles, 2, 0>::new(scene, settings, known)?),
        (_, BodiesAs::Rigid) => Box::new(Run::<Rigid3, 3, 3>::new(scene, settings, known)?),
        (_, BodiesAs::Particles) => Box::new(Run::<Particles, 3, 0>::new(scene, settings, known)?),
    })
}

/// A world and the tracks of its kinematic bodies.
struct Run<G: Geometry<L, A>, const L: usize, const A: usize> {
    world: World<G, L, A>,
    tracks: Vec<(BodyId, Track)>,
    time: f64,
}

impl<G: FromScene<L, A>, const L: usize, const A: usize> Run<G, L, A> {
    fn new(
        scene: &Scene,
        settings: StepSettings,
        known: &mut Decompositions,
    ) -> Result<Self, BuildError> {
        settings.check()?;
        let mut world = World::new(settings);
        world.gravity = Vector(floats(&scene.gravity));
        let mut tracks = Vec::new();
        for (index, body) in scene.bodies.iter().enumerate() {
            let added = world.add(body_of::<G, L, A>(body, index, known)?);
            let refused = |error| BuildError::Body { body: name(body, index), error };
            let id = added.map_err(refused)?;
            if !body.track.times.is_empty() {
                tracks.push((id, body.track.clone()));
            }
        }
        Ok(Self { world, tracks, time: 0.0 })
    }
}

impl<G: Dimension<L, A>, const L: usize, const A: usize> Simulation for Run<G, L, A> {
    fn step(&mut self, dt: f64) -> Result<StepReport, InputError> {
        self.time += dt;
        for (id, track) in &self.tracks {
            let (position, rotation) = track.at(self.time);
            let target = place::<G, L, A>(&position, &rotation);
            self.world.move_to(*id, &target, dt as f32)?;
        }
        self.world.step(dt as f32)
    }

    fn write_poses(&self, out: &mut Vec<f32>) {
        self.world.write_poses(out);
    }

    fn state_hash(&self) -> u64 {
        let mut numbers = Vec::new();
        self.world.write_poses(&mut numbers);
        for velocity in self.world.velocities() {
            numbers.extend(velocity.linear.0.iter().chain(&velocity.angular.0));
        }
        let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        xxh3_64(&bytes)
    }

    fn measure(&self) -> Measure {
        self.world.measure()
    }

    fn checkpoint(&self) -> Vec<u8> {
        // Writing plain numbers to memory cannot fail.
        postcard::to_stdvec(&(self.time, self.world.checkpoint())).unwrap_or_default()
    }

    fn restore(&mut self, checkpoint: &[u8]) -> Result<(), CheckpointError> {
        let (time, world) = postcard::from_bytes(checkpoint)
            .map_err(|error| CheckpointError::Unreadable(error.to_string()))?;
        self.world.restore(&world)?;
        self.time = time;
        Ok(())
    }

    fn masses(&self) -> Vec<f64> {
        self.world.masses()
    }

    fn nearby(&self) -> Vec<Nearby> {
        self.world.nearby()
    }

    fn set_threads(&mut self, threads: usize) {
        self.world.set_threads(threads);
    }

    fn time_stages(&mut self, timing: bool) {
        self.world.time_stages(timing);
    }

    fn save_systems(&mut self, saving: bool) {
        self.world.save_systems(saving);
    }

    #[cfg(feature = "assembled")]
    fn saved(
        &self,
    ) -> Option<Result<drystone::SavedProblem, drystone_solver::assembled::ProblemError>> {
        self.world.saved().map(drystone::SavedSystem::problem)
    }

    fn settings(&self) -> &StepSettings {
        &self.world.settings
    }
}
