//! Builds a running world from a scene. Only this module instantiates all four dimensions: rigid
//! bodies and particles, in 2D and 3D.

use std::array::from_fn;

use drystone_solver::{Manifold, SymmetricMatrix, Vector, Velocity};
use xxhash_rust::xxh3::xxh3_64;

use crate::bodies::{Body, Collider, Inertia, SurfaceMotion};
use crate::compiled::Dimension;
use crate::decomposition::Decompositions;
use crate::forms::{FromScene, Pieces, floats, place, times};
use crate::geometry::{Frame, Geometry, MassProperties, Rigid2, Rigid3, Spheres};
use crate::ids::BodyId;
use crate::input::InputError;
use crate::report::{Measure, Nearby, StepReport};
use crate::scene::{self, BodiesAs, Motion, Rotation, Scene, Track};
use crate::settings::StepSettings;
use crate::world::{CheckpointError, World};

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
    ) -> Option<Result<crate::SavedProblem, drystone_solver::assembled::ProblemError>>;

    /// Returns the step settings.
    fn settings(&self) -> &StepSettings;
}

/// Error: a world cannot be built from a scene.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BuildError {
    /// A shape does not exist in the scene's dimension, or has no volume.
    #[error("shape {shape} of {body}: {reason}")]
    Shape {
        /// Name of the body, or its index.
        body: String,
        /// Index of the shape.
        shape: usize,
        /// The problem, and what is accepted.
        reason: &'static str,
    },
    /// The world refuses a body.
    #[error("{body}: {error}")]
    Body {
        /// Name of the body, or its index.
        body: String,
        /// The problem, and what is accepted.
        error: InputError,
    },
    /// The world refuses a step.
    #[error("{0}")]
    Step(#[from] InputError),
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
        (2, BodiesAs::Particles) => Box::new(Run::<Spheres, 2, 0>::new(scene, settings, known)?),
        (_, BodiesAs::Rigid) => Box::new(Run::<Rigid3, 3, 3>::new(scene, settings, known)?),
        (_, BodiesAs::Particles) => Box::new(Run::<Spheres, 3, 0>::new(scene, settings, known)?),
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
            let added = world.add(convert::<G, L, A>(body, index, known)?);
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
        (0..self.world.len()).map(|body| self.world.mass(body)).collect()
    }

    fn nearby(&self) -> Vec<Nearby> {
        let system = self.world.searched();
        let of = |manifold: &Manifold<f32, L>| {
            let contacts = system.contacts[manifold.points()].iter();
            Nearby {
                bodies: manifold.bodies.map(|body| body as usize),
                normal: manifold.normal().0.map(f64::from).to_vec(),
                gap: contacts
                    .map(|contact| f64::from(contact.gap[0]))
                    .fold(f64::INFINITY, f64::min),
                friction: f64::from(manifold.friction),
            }
        };
        system.manifolds.iter().map(of).collect()
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
    ) -> Option<Result<crate::SavedProblem, drystone_solver::assembled::ProblemError>> {
        self.world.saved().map(crate::SavedSystem::problem)
    }

    fn settings(&self) -> &StepSettings {
        &self.world.settings
    }
}

/// Name of a body, or its index.
fn name(body: &scene::Body, index: usize) -> String {
    body.name.clone().unwrap_or_else(|| format!("body {index}"))
}

fn convert<G: FromScene<L, A>, const L: usize, const A: usize>(
    body: &scene::Body,
    index: usize,
    known: &mut Decompositions,
) -> Result<Body<G, L, A>, BuildError> {
    let density = body.mass.density.unwrap_or(1000.0) as f32;
    let mut colliders = Vec::with_capacity(body.shapes.len());
    let mut solid = MassProperties::ZERO;
    for (number, shape) in body.shapes.iter().enumerate() {
        let wrong = |reason| BuildError::Shape { body: name(body, index), shape: number, reason };
        let pose = place::<G, L, A>(&shape.position, &shape.rotation);
        let dynamic = body.motion == Motion::Dynamic;
        let pieces = if dynamic { G::pieces(&shape.kind, known).map_err(wrong)? } else { None };
        let (forms, pose, own) = match pieces {
            Some(Pieces { shapes, center, solid }) => {
                let middle = G::pose(Vector(floats(&center)), &[]);
                let own = times(solid, density).placed(&G::frame(&pose));
                (shapes, G::compose(&pose, &middle), own)
            }
            None => {
                let form = G::shape(&shape.kind).map_err(wrong)?;
                let own = G::mass(&form, density).placed(&G::frame(&pose));
                (vec![form], pose, own)
            }
        };
        solid = solid.joined(&own);
        colliders.extend(forms.into_iter().map(|form| Collider {
            shape: form,
            pose,
            density,
            material: shape.material.clone(),
            surface_velocity: shape.surface_velocity.as_ref().map(surface_motion),
            filter: shape.filter,
            user_data: 0,
        }));
    }
    Ok(Body {
        motion: body.motion,
        pose: place::<G, L, A>(&body.position, &body.rotation),
        velocity: Velocity {
            linear: Vector(floats(&body.linear_velocity)),
            angular: Vector(floats(&body.angular_velocity)),
        },
        inertia: (body.motion == Motion::Dynamic).then(|| inertia::<G, L, A>(body, solid)),
        gravity_factor: body.gravity_factor as f32,
        damping: [body.linear_damping as f32, body.angular_damping as f32],
        surface_velocity: body.surface_velocity.as_ref().map(surface_motion),
        colliders,
        user_data: 0,
    })
}

fn surface_motion<const L: usize, const A: usize>(
    motion: &scene::SurfaceVelocity,
) -> SurfaceMotion<L, A> {
    SurfaceMotion {
        linear: Vector(floats(&motion.linear)),
        angular: Vector(floats(&motion.angular)),
        local: motion.local,
    }
}

/// Returns mass, center and moments of a body. Values that the body does not state are those of its
/// shapes; their moments are scaled to a stated mass.
fn inertia<G: Geometry<L, A>, const L: usize, const A: usize>(
    body: &scene::Body,
    mut solid: MassProperties<L, A>,
) -> Inertia<L, A> {
    if let Some(mass) = body.mass.mass.filter(|mass| mass.is_finite()) {
        let scale = if solid.mass > 0.0 { mass as f32 / solid.mass } else { 0.0 };
        solid.mass = mass as f32;
        for row in &mut solid.inertia.0 {
            *row = *row * scale;
        }
    }
    if let Some(center) = &body.mass.center {
        solid.center = Vector(floats(center));
    }
    let mut inertia = Inertia::of(&solid);
    if body.mass.mass.is_some_and(f64::is_infinite) {
        inertia = Inertia { center: solid.center, ..Inertia::FIXED };
    }
    if let Some(moments) = &body.mass.inertia {
        let principal = |f: fn(f64) -> f64| {
            let diagonal = Vector(from_fn(|i| f(moments.get(i).copied().unwrap_or(0.0)) as f32));
            let rotation = body.mass.inertia_rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
            let frame: Frame<L> = G::frame(&place::<G, L, A>(&[], &Rotation::Quaternion(rotation)));
            frame.tensor(SymmetricMatrix::diagonal(diagonal))
        };
        inertia.moments = principal(|moment| if moment.is_finite() { moment } else { 0.0 });
        inertia.inverse_moments =
            principal(|moment| if moment.is_finite() && moment > 0.0 { 1.0 / moment } else { 0.0 });
    }
    inertia
}
