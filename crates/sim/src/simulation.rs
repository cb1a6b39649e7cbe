//! From a scene to a world that runs: the one place where the four dimensions meet.

use std::array::from_fn;

use drystone_solver::{Manifold, SymmetricMatrix, Vector, Velocity};
use xxhash_rust::xxh3::xxh3_64;

use crate::bodies::{Body, BodyId, Collider, Inertia};
use crate::geometry::spheres::SphereShape;
use crate::geometry::{Frame, Geometry, MassProperties, Rigid2, Rigid3, Spheres};
use crate::report::{Measure, Nearby, StepReport};
use crate::scene::{self, BodiesAs, Motion, Rotation, Scene, ShapeKind, Track};
use crate::settings::StepSettings;
use crate::world::{CheckpointError, World};

/// A scene in motion, whatever its dimension.
pub trait Simulation: Send {
    /// Moves on by `dt` \[s\]; kinematic bodies follow their tracks.
    fn step(&mut self, dt: f64) -> StepReport;

    /// Appends the poses of all bodies of the scene, in its order: 3D px py pz qx qy qz qw,
    /// 2D px py angle. \[m, rad\]
    fn write_poses(&self, out: &mut Vec<f32>);

    /// XXH3 (64 bits) of the poses and then the velocities of all bodies, linear and angular, as
    /// little-endian `f32`.
    fn state_hash(&self) -> u64;

    /// Energies, deepest overlap and residual as the last step left them.
    fn measure(&self) -> Measure;

    /// The state between two steps as bytes ([`World::checkpoint`]).
    fn checkpoint(&self) -> Vec<u8>;

    /// Goes on from a state of the same scene under the same settings, with the same bits
    /// ([`World::restore`]).
    ///
    /// # Errors
    /// The bytes are no checkpoint of this scene.
    fn restore(&mut self, checkpoint: &[u8]) -> Result<(), CheckpointError>;

    /// Mass of each body; infinite for what nothing pushes. \[kg\]
    fn masses(&self) -> Vec<f64>;

    /// Bodies that were near each other at the start of the last search for contacts, one entry per
    /// manifold.
    fn nearby(&self) -> Vec<Nearby>;

    /// Uses `threads` threads; results do not depend on it.
    fn set_threads(&mut self, threads: usize);

    /// [`World::time_stages`].
    fn time_stages(&mut self, timing: bool);

    /// [`World::save_systems`].
    fn save_systems(&mut self, saving: bool);

    /// [`World::saved`] as matrices; `None` where nothing was saved. Feature `assembled`.
    ///
    /// # Errors
    /// A number of the system is not finite.
    #[cfg(feature = "assembled")]
    fn saved(
        &self,
    ) -> Option<Result<crate::SavedProblem, drystone_solver::assembled::ProblemError>>;

    /// The step settings.
    fn settings(&self) -> &StepSettings;
}

/// Why no world can be made of a scene.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("shape {shape} of {body}: {reason}")]
pub struct BuildError {
    /// The body's name, or its index.
    pub body: String,
    /// Index of the shape.
    pub shape: usize,
    /// What is wrong, and what would do.
    pub reason: &'static str,
}

/// Makes a world of a scene.
///
/// # Errors
/// A shape that its dimension cannot have, or that has no volume.
pub fn build(scene: &Scene, settings: StepSettings) -> Result<Box<dyn Simulation>, BuildError> {
    Ok(match (scene.dimension, scene.bodies_as) {
        (2, BodiesAs::Rigid) => Box::new(Run::<Rigid2, 2, 1>::new(scene, settings)?),
        (2, BodiesAs::Particles) => Box::new(Run::<Spheres, 2, 0>::new(scene, settings)?),
        (_, BodiesAs::Rigid) => Box::new(Run::<Rigid3, 3, 3>::new(scene, settings)?),
        (_, BodiesAs::Particles) => Box::new(Run::<Spheres, 3, 0>::new(scene, settings)?),
    })
}

/// What a scene's shape becomes in a dimension.
trait FromScene<const L: usize, const A: usize>: Geometry<L, A> {
    fn shape(kind: &ShapeKind) -> Result<Self::Shape, &'static str>;
}

fn floats<const L: usize>(of: &[f64]) -> [f32; L] {
    from_fn(|i| of.get(i).copied().unwrap_or(0.0) as f32)
}

/// What reads the same for parry2d and parry3d.
macro_rules! parry_shape {
    ($parry:ident, $kind:expr, $l:literal, $box:expr, $rest:expr) => {{
        use $parry::math::Vector as V;
        use $parry::shape::SharedShape;
        match $kind {
            ShapeKind::Sphere { radius } => Ok(SharedShape::ball(*radius as f32)),
            ShapeKind::Box { half_extents } => Ok($box(floats::<$l>(half_extents))),
            ShapeKind::Capsule { radius, half_height } => {
                Ok(SharedShape::capsule_y(*half_height as f32, *radius as f32))
            }
            ShapeKind::Halfspace { normal } => {
                Ok(SharedShape::halfspace(V::from(floats::<$l>(normal)).normalize()))
            }
            ShapeKind::ConvexHull { points } => {
                let points: Vec<V> = points.iter().map(|p| V::from(floats::<$l>(p))).collect();
                SharedShape::convex_hull(&points)
                    .filter(|hull| hull.mass_properties(1.0).mass() > 0.0)
                    .ok_or("a hull of these points has no volume; give points that do not lie in one plane")
            }
            other => $rest(other),
        }
    }};
}

impl FromScene<2, 1> for Rigid2 {
    fn shape(kind: &ShapeKind) -> Result<Self::Shape, &'static str> {
        parry_shape!(
            parry2d,
            kind,
            2,
            |[x, y]: [f32; 2]| SharedShape::cuboid(x, y),
            |_: &ShapeKind| Err(
                "is not a shape of 2D; use sphere, box, capsule, convex_hull or halfspace"
            )
        )
    }
}

impl FromScene<3, 3> for Rigid3 {
    fn shape(kind: &ShapeKind) -> Result<Self::Shape, &'static str> {
        parry_shape!(
            parry3d,
            kind,
            3,
            |[x, y, z]: [f32; 3]| SharedShape::cuboid(x, y, z),
            |other: &ShapeKind| match other {
                ShapeKind::Cylinder { radius, half_height } => {
                    Ok(SharedShape::cylinder(*half_height as f32, *radius as f32))
                }
                ShapeKind::Trimesh { vertices, triangles } => {
                    use parry3d::shape::TriMeshFlags;
                    let vertices = vertices.iter().map(|v| V::from(floats::<3>(v))).collect();
                    // Without it, a body sliding over a flat mesh stumbles at inner edges.
                    let flags = TriMeshFlags::FIX_INTERNAL_EDGES
                        | TriMeshFlags::MERGE_DUPLICATE_VERTICES
                        | TriMeshFlags::DELETE_DEGENERATE_TRIANGLES;
                    SharedShape::trimesh_with_flags(vertices, triangles.clone(), flags)
                        .map_err(|_| "has no usable triangle")
                }
                _ => Err("is not a shape of 3D"),
            }
        )
    }
}

impl<const L: usize> FromScene<L, 0> for Spheres {
    fn shape(kind: &ShapeKind) -> Result<Self::Shape, &'static str> {
        match kind {
            ShapeKind::Sphere { radius } => Ok(SphereShape::Sphere { radius: *radius as f32 }),
            ShapeKind::Halfspace { normal } => {
                let normal = Vector(floats::<L>(normal));
                Ok(SphereShape::Halfspace { normal: normal * (1.0 / normal.length()) })
            }
            _ => Err("is not a particle; use sphere or halfspace"),
        }
    }
}

/// A world and the tracks of its kinematic bodies.
struct Run<G: Geometry<L, A>, const L: usize, const A: usize> {
    world: World<G, L, A>,
    tracks: Vec<(BodyId, Track)>,
    time: f64,
}

impl<G: FromScene<L, A>, const L: usize, const A: usize> Run<G, L, A> {
    fn new(scene: &Scene, settings: StepSettings) -> Result<Self, BuildError> {
        let mut world = World::new(settings);
        world.gravity = Vector(floats(&scene.gravity));
        let mut tracks = Vec::new();
        for (index, body) in scene.bodies.iter().enumerate() {
            let id = world.add(convert::<G, L, A>(body, index)?);
            if !body.track.times.is_empty() {
                tracks.push((id, body.track.clone()));
            }
        }
        Ok(Self { world, tracks, time: 0.0 })
    }
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Simulation for Run<G, L, A> {
    fn step(&mut self, dt: f64) -> StepReport {
        self.time += dt;
        for (id, track) in &self.tracks {
            let (position, rotation) = track.at(self.time);
            let target = place::<G, L, A>(&position, &rotation);
            self.world.move_to(*id, &target, dt as f32);
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
        // Into memory, from numbers alone: cannot fail.
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

fn place<G: Geometry<L, A>, const L: usize, const A: usize>(
    position: &[f64],
    rotation: &Rotation,
) -> G::Pose {
    match rotation {
        Rotation::Angle(angle) => G::pose(Vector(floats(position)), &[*angle as f32]),
        Rotation::Quaternion(q) => G::pose(Vector(floats(position)), &q.map(|x| x as f32)),
    }
}

fn convert<G: FromScene<L, A>, const L: usize, const A: usize>(
    body: &scene::Body,
    index: usize,
) -> Result<Body<G, L, A>, BuildError> {
    let density = body.mass.density.unwrap_or(1000.0) as f32;
    let mut colliders = Vec::with_capacity(body.shapes.len());
    for (number, shape) in body.shapes.iter().enumerate() {
        let form = G::shape(&shape.kind).map_err(|reason| BuildError {
            body: body.name.clone().unwrap_or_else(|| format!("body {index}")),
            shape: number,
            reason,
        })?;
        colliders.push(Collider {
            shape: form,
            pose: place::<G, L, A>(&shape.position, &shape.rotation),
            density,
            material: shape.material.clone(),
            filter: shape.filter,
        });
    }
    Ok(Body {
        motion: body.motion,
        pose: place::<G, L, A>(&body.position, &body.rotation),
        velocity: Velocity {
            linear: Vector(floats(&body.linear_velocity)),
            angular: Vector(floats(&body.angular_velocity)),
        },
        inertia: (body.motion == Motion::Dynamic).then(|| inertia::<G, L, A>(body, &colliders)),
        gravity_factor: body.gravity_factor as f32,
        colliders,
    })
}

/// Mass, center and moments of a body: its own where it states them, else those of its shapes,
/// scaled to its mass.
fn inertia<G: Geometry<L, A>, const L: usize, const A: usize>(
    body: &scene::Body,
    colliders: &[Collider<G, L, A>],
) -> Inertia<L, A> {
    let mut solid = colliders.iter().fold(MassProperties::ZERO, |sum, collider| {
        let own = G::mass(&collider.shape, collider.density);
        sum.joined(&own.placed(&G::frame(&collider.pose)))
    });
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

/// What says how heavy a shape is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Weight {
    /// \[kg/m^3\]
    Density(f64),
    /// \[kg\]
    Mass(f64),
}

/// Mass \[kg\], center \[m\] and inertia about it \[kg m^2\] of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Solid {
    pub(crate) mass: f64,
    pub(crate) center: [f64; 3],
    pub(crate) inertia: [[f64; 3]; 3],
}

/// A body in 3D of shapes that are not equally dense; none where they have no volume.
pub(crate) fn compound<'s>(
    parts: impl Iterator<Item = (&'s scene::Shape, Weight)>,
) -> Option<Solid> {
    let mut solid = MassProperties::<3, 3>::ZERO;
    for (shape, weight) in parts {
        let form = <Rigid3 as FromScene<3, 3>>::shape(&shape.kind).ok()?;
        let mut own = Rigid3::mass(&form, 1.0);
        let factor = match weight {
            Weight::Density(density) => density as f32,
            Weight::Mass(mass) => mass as f32 / own.mass,
        };
        own.mass *= factor;
        own.inertia.0 = own.inertia.0.map(|row| row * factor);
        let pose = place::<Rigid3, 3, 3>(&shape.position, &shape.rotation);
        solid = solid.joined(&own.placed(&Rigid3::frame(&pose)));
    }
    let sound = solid.mass > 0.0 && solid.mass.is_finite();
    sound.then(|| Solid {
        mass: f64::from(solid.mass),
        center: solid.center.0.map(f64::from),
        inertia: solid.inertia.0.map(|row| row.0.map(f64::from)),
    })
}

impl Track {
    /// Position and rotation at `time` \[s\]: linear between keys, held before the first and after
    /// the last.
    pub fn at(&self, time: f64) -> (Vec<f64>, Rotation) {
        let after = self.times.partition_point(|&key| key <= time);
        let i = after.saturating_sub(1);
        let j = after.min(self.times.len() - 1);
        let span = self.times[j] - self.times[i];
        let t = if span > 0.0 { (time - self.times[i]) / span } else { 0.0 };
        let position = self.positions[i]
            .iter()
            .zip(&self.positions[j])
            .map(|(p, q)| p + (q - p) * t)
            .collect();
        (position, self.rotations[i].towards(&self.rotations[j], t))
    }
}

impl Rotation {
    /// The rotation a part `t` (0..1) of the shorter way to `other`, at even speed.
    pub fn towards(&self, other: &Self, t: f64) -> Self {
        match (self, other) {
            (Self::Quaternion(p), Self::Quaternion(q)) => {
                let dot: f64 = p.iter().zip(q).map(|(x, y)| x * y).sum();
                let sign = if dot < 0.0 { -1.0 } else { 1.0 };
                let angle = libm::acos((dot * sign).min(1.0));
                let sine = libm::sin(angle);
                let (from, to) = if sine > 1e-6 {
                    (libm::sin((1.0 - t) * angle) / sine, libm::sin(t * angle) / sine)
                } else {
                    (1.0 - t, t)
                };
                let mixed: [f64; 4] = from_fn(|i| p[i] * from + q[i] * to * sign);
                let length = mixed.iter().map(|x| x * x).sum::<f64>().sqrt();
                Self::Quaternion(mixed.map(|x| x / length))
            }
            (Self::Angle(a), Self::Angle(b)) => Self::Angle(a + (b - a) * t),
            _ => *self,
        }
    }
}
