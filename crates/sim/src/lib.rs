//! Physics engine for rigid bodies and particles in contact, in 2D and 3D, with certified errors.
//!
//! Create a [`World`] with [`StepSettings`], set its gravity, add bodies, and call [`World::step`].
//! Shapes of rigid bodies come from the crates `parry2d` and `parry3d`. Units are SI, and any axis
//! may point up.
//!
//! ```
//! use drystone::{Body, Motion, StepSettings, World3};
//! use parry3d::shape::SharedShape;
//!
//! let mut world = World3::new(StepSettings::certified());
//! world.gravity = [0.0, -9.81, 0.0].into();
//! let ground = SharedShape::cuboid(5.0, 0.5, 5.0);
//! world.add(Body::new(Motion::Static, [0.0, -0.5, 0.0], ground)).unwrap();
//! let crates = [0.5, 1.5].map(|height| {
//!     let shape = SharedShape::cuboid(0.5, 0.5, 0.5);
//!     world.add(Body::new(Motion::Dynamic, [0.0, height, 0.0], shape)).unwrap()
//! });
//! for _ in 0..60 {
//!     let report = world.step(1.0 / 60.0).unwrap();
//!     assert!(report.certified.is_some_and(|of| of.error <= 1e-3)); // m/s
//! }
//! // The upper crate has moved by less than 0.1 mm.
//! assert!(world.pose(crates[1]).is_some_and(|pose| (pose.translation.y - 1.5).abs() < 1e-4));
//! ```
//!
//! [`World::pose`] and [`World::velocity`] return the state of a body, [`World::write_poses`] the
//! poses of all. [`World::move_to`] moves kinematic bodies. A force of [`World::add_force`] acts
//! for one step. Settings come as presets: [`StepSettings::realtime`] for games,
//! [`StepSettings::quality`] for baking, and [`StepSettings::certified`] for baking with a proven
//! error bound. Scenes from files, checks and recordings are in `drystone-bake`.
//!
//! # Method
//!
//! Each substep of length h computes the impulses γ of all contacts together:
//!
//! ```text
//! v*  =  v + h (g + M⁻¹ f)                     forces                            Stage::Predict
//! 0 ≤ γ  ⊥  A γ + ε γ − b ≥ 0                  contacts push or separate         Stage::Solve
//!     A = J M⁻¹ Jᵀ,   b = t − J v*
//!     |γ_t| ≤ μ γ_n                            friction at each point
//! v⁺  =  v* + M⁻¹ Jᵀ γ                         velocities                        Stage::Solve
//! x⁺  =  x + h v⁺                              positions                         Stage::Advance
//! ```
//!
//! J v are the velocities at the contacts. The targets t come from bounces, the repair of overlaps,
//! and gaps that may close. ε is the compliance. The crate [`drystone_solver`] solves this problem;
//! it knows no shapes and no time.
//!
//! With a [`tolerance`](StepSettings::tolerance), each substep is solved until
//!
//! ```text
//! √(G / m) ≤ tolerance,   (v − v_exact)ᵀ M (v − v_exact) ≤ G
//! ```
//!
//! for each island, with its mass m. G is computed from v and γ alone.
//! [`drystone_solver::certificate`] proves this bound, and one for v that do not follow from γ.
//! With friction, v_exact is the exact solution for the current slips.
//!
//! # Features
//!
//! - `serde`: [`StepSettings`], reports and [`Checkpoint`] are written and read by serde.
//! - `assembled`: a [`SavedSystem`] as matrices.
//!
//! # Where to look
//!
//! | For | Look at |
//! |---|---|
//! | the four kinds of world | [`World2`], [`World3`], [`ParticleWorld2`], [`ParticleWorld3`] |
//! | descriptions of bodies | [`Body`], [`Collider`], [`Inertia`] |
//! | settings of steps | [`StepSettings`] |
//! | reports of steps | [`StepReport`], [`Measure`], [`Ledger`] |
//! | contacts and impulses | [`World::touching`], [`World::system`] |
//! | rays, points and boxes | [`World::cast_ray`], [`World::colliders_in_box`] |

mod bodies;
mod body;
mod broad_phase;
mod cache;
mod certifier;
mod colliders;
mod compiled;
mod events;
pub mod geometry;
mod ids;
mod input;
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
pub use events::Touching;
pub use ids::{BodyId, ColliderId};
pub use input::InputError;
pub use ledger::Ledger;
pub use queries::RayHit;
pub use report::{Measure, Nearby, Stage, StepReport};
pub use saved::SavedSystem;
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

/// Rigid bodies in the plane.
pub type World2 = World<geometry::Rigid2, 2, 1>;
/// Rigid bodies in space.
pub type World3 = World<geometry::Rigid3, 3, 3>;
/// Particles in the plane.
pub type ParticleWorld2 = World<geometry::Particles, 2, 0>;
/// Particles in space.
pub type ParticleWorld3 = World<geometry::Particles, 3, 0>;
