//! Physics engine for rigid bodies and particles in contact, in 2D and 3D, with certified errors.
//!
//! ```
//! use drystone::{Body, Motion, StepSettings, World3};
//! use parry3d::shape::SharedShape;
//!
//! let mut world = World3::new(StepSettings::certified());
//! world.gravity = [0.0, -9.81, 0.0].into();
//! let ground = SharedShape::cuboid(5.0, 0.5, 5.0);
//! world.add(Body::new(Motion::Static, [0.0, -0.5, 0.0], ground))?;
//! let shape = SharedShape::cuboid(0.5, 0.5, 0.5);
//! let lower = world.add(Body::new(Motion::Dynamic, [0.0, 0.5, 0.0], shape.clone()))?;
//! let upper = world.add(Body::new(Motion::Dynamic, [0.0, 1.5, 0.0], shape))?;
//! for _ in 0..60 {
//!     let report = world.step(1.0 / 60.0)?;
//!     assert!(report.certified.is_some_and(|of| of.error <= 1e-3)); // m/s
//! }
//! // The upper crate has moved by less than 0.1 mm.
//! assert!(world.pose(upper).is_some_and(|pose| (pose.translation.y - 1.5).abs() < 1e-4));
//! world.remove(lower);
//! # Ok::<(), drystone::InputError>(())
//! ```
//!
//! Shapes are those of `parry2d` and `parry3d`. Units are SI, and any axis may point up. [`World`]
//! says what a step computes. Its kinds are [`World2`], [`World3`], [`ParticleWorld2`] and
//! [`ParticleWorld3`]. Presets of [`StepSettings`] are for games, baking, and baking with proof.
//! [`World::join`] adds a [`Joint`]. [`StepReport`], [`Measure`] and [`World::touching`] tell what
//! happened, [`World::cast_ray`] what a ray hits. Scenes from files are in `drystone-bake`.
//! Features: `threads` (default), `serde`, and `assembled`: systems as matrices.

mod balance;
mod bodies;
mod body;
mod broad_phase;
mod cache;
mod carriers;
mod certifier;
mod checks;
mod colliders;
mod compiled;
mod deforming;
mod events;
pub mod geometry;
mod held_contacts;
mod ids;
mod impulses;
mod input;
mod joining;
mod joint;
mod joint_batch;
mod joint_jams;
mod joint_stages;
mod joints;
mod ledger;
mod motion;
mod narrow_phase;
mod nearby;
mod patches;
mod queries;
mod report;
mod rows;
mod saved;
mod seams;
mod settings;
mod sleep;
mod solving;
mod step;
mod step_scratch;
mod substep;
mod surfaces;
mod travel;
mod tuner;
mod world;

pub use bodies::{Body, Collider, Inertia, SurfaceVelocity};
pub use body::{Combine, Filter, Material, Motion};
pub use compiled::Dimension;
pub use drystone_solver::jam::Jam;
pub use drystone_solver::ladder::{Method, SolveReport};
pub use drystone_solver::restitution::ImpactLaw;
pub use drystone_solver::{Clock, Vector, Velocity};
pub use events::{PairImpulse, Touching};
pub use ids::{BodyId, ColliderId, JointId};
pub use input::{InputError, JointFault, MeshFault};
pub use joint::{Breaking, Coordinate, Drive, Joint, JointAxis, JointFrames, JointState, Softness};
pub use ledger::Ledger;
pub use queries::RayHit;
pub use report::{BrokenJoint, ContactPoints, Measure, Nearby, Stage, StepReport};
pub use saved::{RowKind, SavedJoint, SavedRow, SavedSystem};
#[cfg(feature = "assembled")]
pub use saved::{SavedContact, SavedProblem};
pub use settings::StepSettings;
pub use world::{Checkpoint, CheckpointError, World};

pub use geometry::Pose2;

/// A rigid body in the plane, to be added to a [`World2`].
pub type Body2 = Body<geometry::Rigid2, 2, 1>;
/// A rigid body in space, to be added to a [`World3`].
pub type Body3 = Body<geometry::Rigid3, 3, 3>;
/// A shape of a [`Body2`].
pub type Collider2 = Collider<geometry::Rigid2, 2, 1>;
/// A shape of a [`Body3`].
pub type Collider3 = Collider<geometry::Rigid3, 3, 3>;

/// A joint in the plane, to be added to a [`World2`].
pub type Joint2 = Joint<geometry::Rigid2, 2, 1>;
/// A joint in space, to be added to a [`World3`].
pub type Joint3 = Joint<geometry::Rigid3, 3, 3>;

/// Rigid bodies in the plane.
pub type World2 = World<geometry::Rigid2, 2, 1>;
/// Rigid bodies in space.
pub type World3 = World<geometry::Rigid3, 3, 3>;
/// Particles in the plane.
pub type ParticleWorld2 = World<geometry::Particles, 2, 0>;
/// Particles in space.
pub type ParticleWorld3 = World<geometry::Particles, 3, 0>;
