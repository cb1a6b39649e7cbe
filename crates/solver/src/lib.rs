//! Contact solver for systems of bodies and contacts: velocities, masses, contacts; no shapes,
//! poses, files or clocks.
//!
//! # The problem
//!
//! Bodies have velocities **v** and inverse masses M^-1. At each of k contacts they touch, or
//! nearly touch, along a unit normal n that points from body b towards body a. Find impulses γ
//! (gamma) such that after the step every contact separates at its target velocity or faster. No
//! contact pulls, and none pushes if it separates faster than its target:
//!
//! ```text
//! 1.  v_n = J v                                relative velocity along each normal, positive
//!                                              when separating
//! 2.  v⁺ = v + M⁻¹ Jᵀ γ                        impulses change velocities
//! 3.  t = max(−c_r v_n⁻, c_d d)                target of v_n: restitution, or overlap repair
//! 4.  A γ = b,  A = J M⁻¹ Jᵀ,  b = t − J v     impulses that reach the target exactly
//! 5.  0 ≤ γ  ⊥  A γ − b ≥ 0                    contacts only push, and those that separate faster
//!                                              than their target do not push at all
//! 6.  γ_i ← max(0, γ_i + m_eff (t_i − v_i))    for each contact in turn, repeatedly
//!     v ← v + M⁻¹ J_iᵀ Δγ_i
//! ```
//!
//! Here v are the velocities without contacts (prospective), v⁻ those before the step's forces,
//! and m_eff = 1 / A_ii.
//!
//! | Equation | In code | Module |
//! |---|---|---|
//! | v_n = J_i v | [`ConstraintFrame::twist`], [`Contact::normal_velocity`] | constraint, contact |
//! | v += M^-1 J_i^T p | [`Contact::add_wrench`], [`ConstraintFrame::apply`] | contact, constraint |
//! | m_eff | [`Mobility::of`], [`Contact::prepare`] | constraint, contact |
//! | r x n, omega x r | [`moment`], [`spin`] | vector |
//! | t: overlap and gap | [`System::set_targets`] | system |
//! | t: restitution | [`restitution::set_targets`] | [`restitution`] |
//! | belts, rolling resistance | [`SurfaceEffects`] | surface |
//! | collisions, isolated as in (1) or together | [`restitution::collide`] | [`restitution`] |
//! | one Gauss-Seidel sweep, step 6 | [`pgs::sweep`] | [`pgs`] |
//! | v += M^-1 J^T gamma | [`System::apply_impulses`] | system |
//! | residual of 5 | [`System::residual`] | system |
//! | J, M^-1, A, b as matrices; A gamma = b, (2) | `assembled` (feature `assembled`) | assembled |
//!
//! `T` is the number type ([`Real`]), `L` and `A` are the linear and angular dimensions of a body:
//! (2, 0) and (3, 0) are particles, (2, 1) and (3, 3) rigid bodies. The same source serves all.
//!
//! # Example
//!
//! Two balls are stacked on a floor. Gravity acts for a step of 0.01 s; the contacts cancel the
//! velocity that it adds.
//!
//! ```
//! use drystone_solver::{
//!     ConstraintFrame, Contact, InverseMass, Manifold, Repair, System, Vector, Velocity, contact_frame, pgs,
//! };
//!
//! let (dt, gravity) = (0.01, -10.0);
//! let mut system = System::<f64, 2, 0>::new();
//! let floor = system.add_body(Velocity::ZERO, InverseMass::FIXED);
//! let ball = InverseMass { linear: 1.0 / 2.0, ..InverseMass::FIXED }; // 2 kg
//! let falling = Velocity { linear: Vector([0.0, gravity * dt]), ..Velocity::ZERO };
//! let lower = system.add_body(falling, ball);
//! let upper = system.add_body(falling, ball);
//!
//! // The normal points from the second body of each pair up to the first.
//! for bodies in [[lower, floor], [upper, lower]] {
//!     let axes = contact_frame(Vector([0.0, 1.0]));
//!     let frame = ConstraintFrame { axes, ..ConstraintFrame::default() };
//!     let manifold = Manifold { bodies, frame, friction: 0.5, ..Manifold::default() };
//!     system.add_manifold(manifold, &[Contact::default()]);
//! }
//! system.prepare(0.0); // effective masses; rigid
//! let repair = Repair { dt, rate: 0.2, slop: 0.005, max_repair_speed: 1.0, stick_rate: 0.0 };
//! system.set_targets(&[Velocity::ZERO; 3], &repair);
//!
//! let mut sweeps = 0;
//! while system.residual(false) > 1e-12 {
//!     pgs::sweep(&mut system);
//!     sweeps += 1;
//! }
//! // The lower contact carries both balls, the upper one ball: m g dt = 0.2 N s each.
//! assert!((system.contacts[0].impulse[0] - 0.4).abs() < 1e-9);
//! assert!((system.contacts[1].impulse[0] - 0.2).abs() < 1e-9);
//! assert!(sweeps < 100);
//! ```
//!
//! # Features
//!
//! `assembled` adds the module `assembled`: the same systems as sparse matrices, Gauss-Seidel on
//! their rows as a reference for the matrix-free sweep, and methods for contact problems given as
//! matrices. It depends on faer and clarabel.

pub mod apgd;
#[cfg(feature = "assembled")]
pub mod assembled;
mod body;
pub mod certificate;
mod cholesky;
mod clock;
mod constraint;
mod contact;
pub mod island;
pub mod jam;
pub mod kinematics;
pub mod ladder;
pub mod lanes;
pub mod law;
pub mod newton;
pub mod nncg;
mod part;
pub mod pgs;
#[cfg(feature = "assembled")]
pub mod proximal;
pub mod psor;
mod real;
pub mod restitution;
pub mod solution;
mod surface;
pub mod symmetric;
mod system;
pub mod thread_pool;
mod vector;

pub use body::{InverseMass, Mass, Velocity};
pub use clock::Clock;
pub use constraint::{ConstraintFrame, Mobility, contact_frame};
pub use contact::{Contact, Manifold, Repair};
pub use real::{Cast, Real, Scalar};
pub use surface::SurfaceEffects;
pub use system::System;
pub use vector::{SymmetricMatrix, Vector, moment, spin};
