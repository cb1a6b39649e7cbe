//! The bodies of a world: poses, inertia and what acts on them, one array per property.

use drystone_solver::thread_pool::ThreadPool;
use drystone_solver::{InverseMass, Mass, SymmetricMatrix, Vector, Velocity};

use crate::geometry::{Bounds, Frame, Geometry, MassProperties, Precession, Reach};
use crate::ids::{Slots, put};
use crate::scene::{Filter, Material, Motion};

/// A body to be added to a world.
#[derive(Clone)]
pub struct Body<G: Geometry<L, A>, const L: usize, const A: usize> {
    /// What moves it.
    pub motion: Motion,
    /// Pose of its origin.
    pub pose: G::Pose,
    /// Of its center of mass.
    pub velocity: Velocity<f32, L, A>,
    /// Mass and inertia; absent: those of its shapes.
    pub inertia: Option<Inertia<L, A>>,
    /// Part of the world's gravity that acts on it. \[1\]
    pub gravity_factor: f32,
    /// Rates at which its linear and angular velocity decay: dv/dt = -d v. \[1/s\]
    pub damping: [f32; 2],
    /// How its surface runs, in its frame; colliders may have it run otherwise.
    pub surface_velocity: Option<SurfaceMotion<L, A>>,
    /// Its shapes.
    pub colliders: Vec<Collider<G, L, A>>,
    /// Whatever the caller wants to find again by [`World::user_data`](crate::World::user_data).
    pub user_data: u128,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Body<G, L, A> {
    /// A body at rest at `position` \[m\], not turned, with one shape of density 1000.
    pub fn new(motion: Motion, position: [f32; L], shape: G::Shape) -> Self {
        Self {
            motion,
            pose: G::pose(Vector(position), &[]),
            velocity: Velocity::ZERO,
            inertia: None,
            gravity_factor: 1.0,
            damping: [0.0; 2],
            surface_velocity: None,
            colliders: vec![Collider::new(shape)],
            user_data: 0,
        }
    }
}

/// A shape on a body.
#[derive(Clone)]
pub struct Collider<G: Geometry<L, A>, const L: usize, const A: usize> {
    /// Its form.
    pub shape: G::Shape,
    /// In the frame of the body.
    pub pose: G::Pose,
    /// 3D \[kg/m^3\], 2D \[kg/m^2\].
    pub density: f32,
    /// Its surface.
    pub material: Material,
    /// How its surface runs, in the frame of the shape; absent: as that of the body.
    pub surface_velocity: Option<SurfaceMotion<L, A>>,
    /// What it collides with.
    pub filter: Filter,
    /// Whatever the caller wants to find again by
    /// [`World::collider_user_data`](crate::World::collider_user_data).
    pub user_data: u128,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Collider<G, L, A> {
    /// A shape at the body's origin, of density 1000, with the default surface.
    pub fn new(shape: G::Shape) -> Self {
        Self {
            shape,
            pose: G::pose(Vector::ZERO, &[]),
            density: 1000.0,
            material: Material::default(),
            surface_velocity: None,
            filter: Filter::default(),
            user_data: 0,
        }
    }
}

/// How a surface runs against its body, as a belt or a turntable does: v = linear + angular x r, with r from
/// the origin of the body or shape.
///
/// Contacts see what of it lies along them: friction drives the other body to it. It neither lifts nor
/// presses, and without friction does nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceMotion<const L: usize, const A: usize> {
    /// \[m/s\]
    pub linear: Vector<f32, L>,
    /// \[rad/s\]
    pub angular: Vector<f32, A>,
    /// Whether its axes are those of the body or shape, and turn with it; else those of the world.
    pub local: bool,
}

impl<const L: usize, const A: usize> SurfaceMotion<L, A> {
    /// A belt that runs at this velocity \[m/s\] in the frame of its body.
    pub fn linear(linear: Vector<f32, L>) -> Self {
        Self { linear, angular: Vector::ZERO, local: true }
    }

    /// A surface that turns like this \[rad/s\] about the origin of its body, in its frame.
    pub fn angular(angular: Vector<f32, A>) -> Self {
        Self { linear: Vector::ZERO, angular, local: true }
    }

    /// As a velocity at the place from which `frame` is seen.
    pub(crate) fn seen_from(&self, frame: &Frame<L>) -> Velocity<f32, L, A> {
        let Self { mut linear, mut angular, local } = *self;
        if local {
            (linear, angular) = (frame.direction(linear), frame.turning(angular));
        }
        let at = Velocity { linear, angular };
        Velocity { linear: at.at(-frame.position), angular }
    }
}

/// How hard a body is to move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertia<const L: usize, const A: usize> {
    /// m; infinite: no push moves it. \[kg\]
    pub mass: f32,
    /// Center of mass in the frame of the body. \[m\]
    pub center: Vector<f32, L>,
    /// I_0 about the center of mass, in the frame of the body; infinite moments as 0. \[kg m^2\]
    pub moments: SymmetricMatrix<f32, A>,
    /// I_0^-1; zero about axes that nothing turns it about. \[1/(kg m^2)\]
    pub inverse_moments: SymmetricMatrix<f32, A>,
}

impl<const L: usize, const A: usize> Inertia<L, A> {
    /// Of what nothing can move.
    pub const FIXED: Self = Self {
        mass: f32::INFINITY,
        center: Vector::ZERO,
        moments: SymmetricMatrix::ZERO,
        inverse_moments: SymmetricMatrix::ZERO,
    };

    /// Inertia of a body of this mass \[kg\] that no torque rotates: a character, or a lift.
    pub fn without_rotation(mass: f32) -> Self {
        Self { mass, ..Self::FIXED }
    }

    /// Of a solid.
    pub fn of(solid: &MassProperties<L, A>) -> Self {
        Self {
            mass: solid.mass,
            center: solid.center,
            moments: solid.inertia,
            inverse_moments: inverse(&solid.inertia),
        }
    }

    /// m^-1. \[1/kg\]
    pub fn inverse_mass(&self) -> f32 {
        if self.mass > 0.0 { 1.0 / self.mass } else { 0.0 }
    }

    /// How turning freely changes the angular velocity: not at all where the moments hardly differ.
    pub(crate) fn precession(&self) -> Precession {
        if A != 3 {
            return Precession::NONE;
        }
        let m = &self.moments.0;
        let scale = m[0][0].max(m[1][1]).max(m[2][2]) * 1e-4;
        let finite = (0..A).all(|i| m[i][i] > 0.0);
        let round = (0..A).all(|i| {
            (0..A).all(|j| {
                let expected = if i == j { m[0][0] } else { 0.0 };
                (m[i][j] - expected).abs() <= scale
            })
        });
        let moments: SymmetricMatrix<f64, A> = self.moments.cast();
        let Some(inverse) = moments.inverse().filter(|_| finite && !round) else {
            return Precession::NONE;
        };
        // I - I_max: positive for a body of masses, of which no moment is more than the others together.
        let half = (0..A).map(|i| 0.5005 * moments.0[i][i]).sum();
        let mut others = SymmetricMatrix::diagonal(Vector([half; A]));
        for (others, own) in others.0.iter_mut().zip(&moments.0) {
            *others -= *own;
        }
        let spread = (norm(&moments) * norm(&inverse)) as f32;
        Precession { rate: if others.inverse().is_some() { 1.0 } else { spread }, spread }
    }
}

/// The root of the sum of the squares of its entries.
fn norm<const A: usize>(matrix: &SymmetricMatrix<f64, A>) -> f64 {
    matrix.0.iter().map(|row| row.dot(*row)).sum::<f64>().sqrt()
}

/// The inverse of a symmetric positive definite matrix of size 0, 1 or 3; zero where singular.
fn inverse<const A: usize>(matrix: &SymmetricMatrix<f32, A>) -> SymmetricMatrix<f32, A> {
    let mut out = SymmetricMatrix::ZERO;
    let m = |i: usize, j: usize| f64::from(matrix.0[i][j]);
    match A {
        1 if m(0, 0) > 0.0 => out.0[0][0] = (1.0 / m(0, 0)) as f32,
        3 => {
            let cofactor = |i: usize, j: usize| {
                let (p, q) = ((i + 1) % 3, (i + 2) % 3);
                let (r, s) = ((j + 1) % 3, (j + 2) % 3);
                m(p, r) * m(q, s) - m(p, s) * m(q, r)
            };
            let determinant: f64 = (0..3).map(|j| m(0, j) * cofactor(0, j)).sum();
            if determinant > 0.0 {
                for i in 0..3 {
                    for j in 0..3 {
                        out.0[i][j] = (cofactor(i, j) / determinant) as f32;
                    }
                }
            }
        }
        _ => {}
    }
    out
}

/// Bodies that are worth as much as the least that threads share.
pub(crate) const GRAIN: usize = 32;

/// Contacts are kept as long as bodies have moved by less than this part of their size. \[1\]
const STRAY: f32 = 0.01;

/// How far a body has come since contacts were last searched for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SearchMotion<const L: usize> {
    /// Its center. \[m\]
    pub(crate) linear: Vector<f32, L>,
    /// The surface of its shapes about it, by turning, at most ([`Reach::core`]). \[m\]
    pub(crate) turned: f32,
}

impl<const L: usize> SearchMotion<L> {
    pub(crate) const NOWHERE: Self = Self { linear: Vector::ZERO, turned: 0.0 };
}

/// What a body that precesses keeps of its turning.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct SpinState<const A: usize> {
    /// Rotation vector that the pose has followed before the end of the step. \[rad\]
    pub(crate) followed: Vector<f32, A>,
    /// What rounding has left out of the angular velocity. \[rad/s\]
    pub(crate) remainder: Vector<f32, A>,
    /// Whether a collision has changed its velocity since its pose last followed.
    pub(crate) struck: bool,
}

/// The state of all bodies, except velocities and world inverse masses, which the contact system
/// holds.
#[derive(Clone)]
pub(crate) struct Bodies<G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) slots: Slots,
    /// None: the slot is free.
    pub(crate) motion: Vec<Option<Motion>>,
    pub(crate) user_data: Vec<u128>,
    /// At the center of mass.
    pub(crate) poses: Vec<G::Pose>,
    pub(crate) frames: Vec<Frame<L>>,
    /// What rounding has left out of the positions. \[m\]
    pub(crate) remainders: Vec<Vector<f32, L>>,
    /// How far the surface of its shapes can have come, step by step, since it was added ([`Reach::core`]). \[m\]
    pub(crate) paths: Vec<f64>,
    pub(crate) since_search: Vec<SearchMotion<L>>,
    /// How much of it since its contacts and its M^-1 were last found anew. \[m\]
    pub(crate) moved_since_rebuild: Vec<f32>,
    /// Whether that was more than what they are kept for: they are found anew in this step.
    pub(crate) needs_rebuild: Vec<bool>,
    pub(crate) inertia: Vec<Inertia<L, A>>,
    pub(crate) precession: Vec<Precession>,
    pub(crate) turns: Vec<SpinState<A>>,
    /// Whether it has turned since contacts were last searched for
    /// ([`kinematics`](drystone_solver::kinematics)).
    pub(crate) turned: Vec<bool>,
    pub(crate) gravity_factor: Vec<f32>,
    /// Linear and angular; of none where there are no more. \[1/s\]
    pub(crate) damping: Vec<[f32; 2]>,
    /// Of its shapes from the center of mass.
    pub(crate) reach: Vec<Reach>,
    /// The smallest extent of all its shapes together; unlimited of what cannot be moved. \[m\]
    pub(crate) thickness: Vec<f32>,
    /// Force and torque until the end of the next step; of none where there are no more. \[N, N m\]
    pub(crate) forces: Vec<Velocity<f32, L, A>>,
}

/// What of the bodies does not change through the substeps of a step.
#[derive(Clone, Copy)]
pub(crate) struct BodyParams<'a, const L: usize, const A: usize> {
    motion: &'a [Option<Motion>],
    gravity_factor: &'a [f32],
    pub(crate) damping: &'a [[f32; 2]],
    forces: &'a [Velocity<f32, L, A>],
    pub(crate) inertia: &'a [Inertia<L, A>],
    pub(crate) precession: &'a [Precession],
    pub(crate) reach: &'a [Reach],
}

impl<const L: usize, const A: usize> BodyParams<'_, L, A> {
    pub(crate) fn is_dynamic(&self, body: usize) -> bool {
        self.motion[body] == Some(Motion::Dynamic)
    }

    /// Force and torque on a body. \[N, N m\]
    pub(crate) fn force(&self, body: usize) -> Velocity<f32, L, A> {
        self.forces.get(body).copied().unwrap_or(Velocity::ZERO)
    }

    /// The acceleration of gravity on a body. \[m/s^2\]
    pub(crate) fn pull(&self, body: usize, gravity: Vector<f32, L>) -> Vector<f32, L> {
        gravity * self.gravity_factor[body]
    }
}

/// Bodies in motion.
pub(crate) struct BodiesInMotion<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) given: BodyParams<'a, L, A>,
    pub(crate) poses: &'a mut [G::Pose],
    pub(crate) turns: &'a mut [SpinState<A>],
    pub(crate) turned: &'a mut [bool],
}

/// What damping \[1/s\] takes from a velocity that gains `change` within `h` \[s\].
///
/// Exact for dv/dt = a - d v: v (exp(-d h) - 1) + a h ((1 - exp(-d h)) / (d h) - 1).
pub(crate) fn damped<const L: usize, const A: usize>(
    [linear, angular]: [f32; 2],
    velocity: &Velocity<f32, L, A>,
    change: &Velocity<f32, L, A>,
    h: f32,
) -> Velocity<f32, L, A> {
    let parts = |damping: f32| {
        let passed = damping * h;
        let decay = libm::expm1f(-passed);
        // As a series, where the quotient is rounding.
        let late = if passed > 1e-3 { -decay / passed - 1.0 } else { passed * -0.5 };
        [decay, late]
    };
    let ([decay, late], [unwinding, later]) = (parts(linear), parts(angular));
    Velocity {
        linear: velocity.linear * decay + change.linear * late,
        angular: velocity.angular * unwinding + change.angular * later,
    }
}

/// The box around a solid in its own frame, or at a pose; none around what has no volume.
pub(crate) fn extent<G: Geometry<L, A>, const L: usize, const A: usize>(
    shape: &G::Shape,
    pose: Option<&G::Pose>,
) -> Option<Bounds<L>> {
    let own = || G::pose(Vector::ZERO, &[]);
    let has_volume = G::mass(shape, 1.0).mass > 0.0;
    has_volume.then(|| G::bounds(shape, pose.unwrap_or(&own())))
}

/// The smallest extent of a box; unlimited of none. \[m\]
pub(crate) fn smallest<const L: usize>(bounds: &Option<Bounds<L>>) -> f32 {
    let extents = bounds.as_ref().map(|bounds| (bounds.max - bounds.min).0);
    extents.into_iter().flatten().fold(f32::INFINITY, f32::min)
}

/// The smallest extent of all shapes of a body together, in its frame; of a single shape in its own. \[m\]
fn thickness<G: Geometry<L, A>, const L: usize, const A: usize>(
    colliders: &[Collider<G, L, A>],
) -> f32 {
    let pose = |collider: &Collider<G, L, A>| (colliders.len() > 1).then_some(collider.pose);
    let each = colliders.iter();
    let each = each.filter_map(|of| extent::<G, L, A>(&of.shape, pose(of).as_ref()));
    smallest(&each.reduce(|all, own| Bounds {
        min: Vector(std::array::from_fn(|i| all.min[i].min(own.min[i]))),
        max: Vector(std::array::from_fn(|i| all.max[i].max(own.max[i]))),
    }))
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Bodies<G, L, A> {
    pub(crate) fn new() -> Self {
        Self {
            slots: Slots::default(),
            motion: Vec::new(),
            user_data: Vec::new(),
            poses: Vec::new(),
            frames: Vec::new(),
            remainders: Vec::new(),
            paths: Vec::new(),
            since_search: Vec::new(),
            moved_since_rebuild: Vec::new(),
            needs_rebuild: Vec::new(),
            inertia: Vec::new(),
            precession: Vec::new(),
            turns: Vec::new(),
            turned: Vec::new(),
            gravity_factor: Vec::new(),
            damping: Vec::new(),
            reach: Vec::new(),
            thickness: Vec::new(),
            forces: Vec::new(),
        }
    }

    /// Puts a body into the lowest free slot, without its colliders, and returns the slot.
    pub(crate) fn insert(&mut self, body: &Body<G, L, A>, inertia: Inertia<L, A>) -> usize {
        let slot = self.slots.take();
        let moved = body.motion == Motion::Dynamic;
        let to_center = G::pose(-inertia.center, &[]);
        let pose = G::compose(&body.pose, &G::pose(inertia.center, &[]));
        let reach = body.colliders.iter().fold(Reach::default(), |all, collider| {
            all.joined(&G::reach(&collider.shape, &G::compose(&to_center, &collider.pose)))
        });
        let precession = if moved { inertia.precession() } else { Precession::NONE };
        let thickness = if moved { thickness::<G, L, A>(&body.colliders) } else { f32::INFINITY };
        put(&mut self.motion, slot, Some(body.motion));
        put(&mut self.user_data, slot, body.user_data);
        put(&mut self.poses, slot, pose);
        put(&mut self.frames, slot, G::frame(&pose));
        put(&mut self.remainders, slot, Vector::ZERO);
        put(&mut self.paths, slot, 0.0);
        put(&mut self.since_search, slot, SearchMotion::NOWHERE);
        put(&mut self.moved_since_rebuild, slot, f32::MAX);
        put(&mut self.needs_rebuild, slot, true);
        put(&mut self.inertia, slot, inertia);
        put(&mut self.precession, slot, precession);
        put(&mut self.turns, slot, SpinState::default());
        put(&mut self.turned, slot, false);
        put(&mut self.gravity_factor, slot, body.gravity_factor);
        put(&mut self.reach, slot, reach);
        put(&mut self.thickness, slot, thickness);
        self.set_damping(slot, body.damping);
        if let Some(force) = self.forces.get_mut(slot) {
            *force = Velocity::ZERO;
        }
        slot
    }

    /// Takes a body out of its slot.
    pub(crate) fn remove(&mut self, slot: usize) {
        self.slots.vacate(slot);
        self.slots.release(slot);
        self.motion[slot] = None;
        self.inertia[slot] = Inertia::FIXED;
        self.thickness[slot] = f32::INFINITY;
        self.set_damping(slot, [0.0; 2]);
        if let Some(force) = self.forces.get_mut(slot) {
            *force = Velocity::ZERO;
        }
    }

    /// Puts the origin of a body at a pose: a way that contacts have to follow as any other.
    pub(crate) fn set_origin(&mut self, body: usize, origin: &G::Pose) {
        let pose = G::compose(origin, &G::pose(self.inertia[body].center, &[]));
        let (before, frame) = (self.frames[body], G::frame(&pose));
        let way = frame.position - before.position;
        let turned = 2.0 * self.reach[body].core;
        let turned = if turned.is_finite() { turned } else { f32::MAX };
        self.poses[body] = pose;
        self.frames[body] = frame;
        self.remainders[body] = Vector::ZERO;
        self.turns[body] = SpinState::default();
        self.paths[body] += f64::from(way.length() + turned);
        self.since_search[body].linear += way;
        self.since_search[body].turned += turned;
        self.moved_since_rebuild[body] = f32::MAX;
    }

    /// Notes which bodies have moved by more than `limit` \[m\], or than a small part of their size, have
    /// turned, or move whatever they touch.
    pub(crate) fn mark_moved(
        &mut self,
        limit: f32,
        velocities: &[Velocity<f32, L, A>],
        pool: &ThreadPool,
    ) {
        let Self { needs_rebuild, moved_since_rebuild, turned, inertia, reach, .. } = self;
        let (useful, share) = pool.share(velocities.len(), GRAIN);
        let parts = needs_rebuild.chunks_mut(share).zip(moved_since_rebuild.chunks_mut(share));
        let parts = parts.zip(turned.chunks_mut(share)).enumerate();
        pool.for_each(useful, parts, |(part, ((needs_rebuild, moved_since_rebuild), turned))| {
            let own = needs_rebuild.iter_mut().zip(moved_since_rebuild).zip(&*turned);
            for (body, ((needs_rebuild, moved_since_rebuild), turned)) in (share * part..).zip(own)
            {
                let leads = inertia[body].inverse_mass() == 0.0;
                *needs_rebuild = leads && velocities[body] != Velocity::ZERO
                    || *moved_since_rebuild > limit.min(STRAY * reach[body].all)
                    // Its contacts have been renewed in the lanes, and not in the records.
                    || *turned;
                if *needs_rebuild {
                    *moved_since_rebuild = 0.0;
                }
            }
        });
    }

    /// What does not change in motion, and what does.
    pub(crate) fn in_motion(&mut self) -> BodiesInMotion<'_, G, L, A> {
        let Self { motion, gravity_factor, damping, forces, inertia, precession, reach, .. } = self;
        let given =
            BodyParams { motion, gravity_factor, damping, forces, inertia, precession, reach };
        BodiesInMotion {
            given,
            poses: &mut self.poses,
            turns: &mut self.turns,
            turned: &mut self.turned,
        }
    }

    fn given(&self) -> BodyParams<'_, L, A> {
        let Self { motion, gravity_factor, damping, forces, inertia, precession, reach, .. } = self;
        BodyParams { motion, gravity_factor, damping, forces, inertia, precession, reach }
    }

    /// Sets the damping of a body: linear and angular. \[1/s\]
    pub(crate) fn set_damping(&mut self, body: usize, damping: [f32; 2]) {
        if self.damping.len() <= body && damping != [0.0; 2] {
            self.damping.resize(body + 1, [0.0; 2]);
        }
        if let Some(own) = self.damping.get_mut(body) {
            *own = damping;
        }
    }

    pub(crate) fn is_dynamic(&self, body: usize) -> bool {
        self.given().is_dynamic(body)
    }

    /// x_a - x_b, as exact as if the positions were: far from the origin an `f32` is coarser than
    /// what contacts feel. \[m\]
    pub(crate) fn apart(&self, [a, b]: [u32; 2]) -> Vector<f32, L> {
        let (a, b) = (a as usize, b as usize);
        (self.frames[a].position - self.frames[b].position)
            + (self.remainders[a] - self.remainders[b])
    }

    /// M of a body at its present pose; zero for what is not dynamic, and along what is infinite.
    pub(crate) fn mass(&self, body: usize) -> Mass<L, A> {
        let inertia = &self.inertia[body];
        if !self.is_dynamic(body) {
            return Mass::ZERO;
        }
        Mass {
            linear: if inertia.mass.is_finite() { f64::from(inertia.mass) } else { 0.0 },
            angular: G::frame(&self.poses[body]).tensor(inertia.moments).cast(),
        }
    }

    /// M^-1 of a body at its present pose.
    pub(crate) fn inverse_mass(&self, body: usize) -> InverseMass<f32, L, A> {
        let inertia = &self.inertia[body];
        if !self.is_dynamic(body) {
            return InverseMass::FIXED;
        }
        InverseMass {
            linear: inertia.inverse_mass(),
            angular: self.frames[body].tensor(inertia.inverse_moments),
        }
    }

    /// Force and torque on a body. \[N, N m\]
    pub(crate) fn force(&self, body: usize) -> Velocity<f32, L, A> {
        self.given().force(body)
    }

    /// The acceleration of gravity on a body. \[m/s^2\]
    pub(crate) fn pull(&self, body: usize, gravity: Vector<f32, L>) -> Vector<f32, L> {
        self.given().pull(body, gravity)
    }

    /// m |g| of a body that moves freely; an infinite mass does not fall. \[N\]
    pub(crate) fn weight(&self, body: usize, gravity: Vector<f32, L>) -> f32 {
        let mass = self.inertia[body].mass;
        if self.is_dynamic(body) && mass.is_finite() {
            mass * self.pull(body, gravity).length()
        } else {
            0.0
        }
    }

    /// -m g . x of all bodies. \[J\]
    pub(crate) fn potential_energy(&self, gravity: Vector<f32, L>) -> f64 {
        let of = |(body, frame): (usize, &Frame<L>)| {
            let mass = self.inertia[body].mass;
            if !self.is_dynamic(body) || !mass.is_finite() {
                return 0.0;
            }
            let fall = self.pull(body, gravity).cast::<f64>().dot(frame.position.cast());
            -f64::from(mass) * fall
        };
        self.frames.iter().enumerate().map(of).sum()
    }

    /// Pose of the body's origin.
    pub(crate) fn origin(&self, body: usize) -> G::Pose {
        let center = self.inertia[body].center;
        if center == Vector::ZERO {
            return self.poses[body];
        }
        G::compose(&self.poses[body], &G::pose(-center, &[]))
    }
}
