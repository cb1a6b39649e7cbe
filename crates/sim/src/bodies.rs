//! The bodies of a world: poses, velocities, inertia and forces, one array per property.

use drystone_solver::mechanism::of_batch;
use drystone_solver::thread_pool::ThreadPool;
use drystone_solver::{InverseMass, Mass, SymmetricMatrix, System, Vector, Velocity};

use crate::balance::Balance;
use crate::body::{Filter, Material, Motion};
use crate::geometry::{Bounds, Frame, Geometry, MassProperties, Precession, Reach};
use crate::ids::{Slots, put};

/// Description of a body to be added to a world.
#[derive(Clone)]
pub struct Body<G: Geometry<L, A>, const L: usize, const A: usize> {
    /// Static, kinematic or dynamic.
    pub motion: Motion,
    /// Pose of its origin.
    pub pose: G::Pose,
    /// Velocity of its center of mass.
    pub velocity: Velocity<f32, L, A>,
    /// Mass and inertia. If absent, they are computed from its shapes.
    pub inertia: Option<Inertia<L, A>>,
    /// Factor of the world's gravity. \[1\]
    pub gravity_factor: f32,
    /// Decay rates d of its linear and angular velocity: dv/dt = -d v. \[1/s\]
    pub damping: [f32; 2],
    /// Surface velocity, in its frame. Colliders may have one of their own.
    pub surface_velocity: Option<SurfaceVelocity<L, A>>,
    /// Its shapes.
    pub colliders: Vec<Collider<G, L, A>>,
    /// Any number chosen by the caller, returned by [`World::user_data`](crate::World::user_data).
    pub user_data: u128,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Body<G, L, A> {
    /// Creates a body at rest at `position` \[m\], not rotated, with one shape of density 1000.
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

/// Description of a shape of a body.
#[derive(Clone)]
pub struct Collider<G: Geometry<L, A>, const L: usize, const A: usize> {
    /// Geometry.
    pub shape: G::Shape,
    /// Pose in the frame of the body.
    pub pose: G::Pose,
    /// Density: 3D \[kg/m^3\], 2D \[kg/m^2\].
    pub density: f32,
    /// Surface properties.
    pub material: Material,
    /// Surface velocity, in the frame of the shape. If absent, that of the body applies.
    pub surface_velocity: Option<SurfaceVelocity<L, A>>,
    /// Selection of the colliders that it can touch.
    pub filter: Filter,
    /// Any number chosen by the caller, returned by
    /// [`World::collider_user_data`](crate::World::collider_user_data).
    pub user_data: u128,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Collider<G, L, A> {
    /// Creates a collider at the body's origin, of density 1000, with the default material.
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

/// Velocity of a surface relative to its body, as of a conveyor belt or a turntable:
/// v = linear + angular x r. The arm r begins at the origin of the body or shape.
///
/// Contacts see only its tangential part: friction drives the other body towards it. It neither
/// lifts nor presses, and has no effect without friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceVelocity<const L: usize, const A: usize> {
    /// Linear velocity. \[m/s\]
    pub linear: Vector<f32, L>,
    /// Angular velocity. \[rad/s\]
    pub angular: Vector<f32, A>,
    /// True if its axes are those of the body or shape, and rotate with it. If false, they are
    /// those of the world.
    pub local: bool,
}

impl<const L: usize, const A: usize> SurfaceVelocity<L, A> {
    /// Creates a belt with this velocity \[m/s\] in the frame of its body.
    pub fn linear(linear: Vector<f32, L>) -> Self {
        Self { linear, angular: Vector::ZERO, local: true }
    }

    /// Creates a surface that rotates with this angular velocity \[rad/s\] about the origin of its
    /// body, in the body's frame.
    pub fn angular(angular: Vector<f32, A>) -> Self {
        Self { linear: Vector::ZERO, angular, local: true }
    }

    /// Returns the velocity at the origin of the coordinates in which `frame` is given. `frame` is
    /// that of the body or shape.
    pub(crate) fn seen_from(&self, frame: &Frame<L>) -> Velocity<f32, L, A> {
        let Self { mut linear, mut angular, local } = *self;
        if local {
            (linear, angular) = (frame.direction(linear), frame.turning(angular));
        }
        let at = Velocity { linear, angular };
        Velocity { linear: at.at(-frame.position), angular }
    }
}

/// Mass, center of mass and moments of inertia of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertia<const L: usize, const A: usize> {
    /// m; infinite if no force moves the body. \[kg\]
    pub mass: f32,
    /// Center of mass in the frame of the body. \[m\]
    pub center: Vector<f32, L>,
    /// I_0 about the center of mass, in the frame of the body. Infinite moments are stored as
    /// zero. \[kg m^2\]
    pub moments: SymmetricMatrix<f32, A>,
    /// I_0^-1; zero about axes about which no torque rotates the body. \[1/(kg m^2)\]
    pub inverse_moments: SymmetricMatrix<f32, A>,
}

impl<const L: usize, const A: usize> Inertia<L, A> {
    /// Inertia of a body that no force and no torque moves.
    pub const FIXED: Self = Self {
        mass: f32::INFINITY,
        center: Vector::ZERO,
        moments: SymmetricMatrix::ZERO,
        inverse_moments: SymmetricMatrix::ZERO,
    };

    /// Returns the inertia of a body of this mass \[kg\] that no torque rotates, such as a
    /// character or a lift.
    pub fn without_rotation(mass: f32) -> Self {
        Self { mass, ..Self::FIXED }
    }

    /// Returns the inertia of a solid.
    pub fn of(solid: &MassProperties<L, A>) -> Self {
        Self {
            mass: solid.mass,
            center: solid.center,
            moments: solid.inertia,
            inverse_moments: inverse(&solid.inertia),
        }
    }

    /// Returns m^-1, or 0 if m is 0. \[1/kg\]
    pub fn inverse_mass(&self) -> f32 {
        if self.mass > 0.0 { 1.0 / self.mass } else { 0.0 }
    }

    /// Returns true if torques rotate the body about every axis.
    pub(crate) fn turns_freely(&self) -> bool {
        // The trace of I I^-1 is the number of such axes.
        let mut axes = 0.0;
        for i in 0..A {
            for j in 0..A {
                axes += self.moments.entry(i, j) * self.inverse_moments.entry(j, i);
            }
        }
        axes > A as f32 - 0.5
    }

    /// Returns M at a pose, zero along infinite entries.
    fn mass_at<G: Geometry<L, A>>(&self, pose: &G::Pose) -> Mass<L, A> {
        Mass {
            linear: if self.mass.is_finite() { f64::from(self.mass) } else { 0.0 },
            angular: G::frame(pose).tensor(self.moments).cast(),
        }
    }

    /// Returns bounds on the precession of the body: none if its moments differ by less than
    /// 1e-4, or if one is infinite.
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
        // Positive definite for a body made of masses: no moment is larger than the sum of the
        // others.
        let half = (0..A).map(|i| 0.5005 * moments.0[i][i]).sum();
        let mut others = SymmetricMatrix::diagonal(Vector([half; A]));
        for (others, own) in others.0.iter_mut().zip(&moments.0) {
            *others -= *own;
        }
        let spread = (norm(&moments) * norm(&inverse)) as f32;
        Precession { rate: if others.inverse().is_some() { 1.0 } else { spread }, spread }
    }
}

/// Returns the Frobenius norm.
fn norm<const A: usize>(matrix: &SymmetricMatrix<f64, A>) -> f64 {
    matrix.0.iter().map(|row| row.dot(*row)).sum::<f64>().sqrt()
}

/// Returns the inverse of a symmetric positive definite matrix of size 0, 1 or 3; zero if singular.
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

/// Grain size for sharing bodies between threads.
pub(crate) const GRAIN: usize = 32;

/// Contacts and M^-1 are kept until bodies have moved by more than this fraction of their
/// size. \[1\]
const STRAY: f32 = 0.01;

/// Motion of a body since the last contact search.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SearchMotion<const L: usize> {
    /// Displacement of its center. \[m\]
    pub(crate) linear: Vector<f32, L>,
    /// Upper bound of the displacement of its surfaces by rotation ([`Reach::core`]). \[m\]
    pub(crate) turned: f32,
}

impl<const L: usize> SearchMotion<L> {
    pub(crate) const NOWHERE: Self = Self { linear: Vector::ZERO, turned: 0.0 };
}

/// State of the rotation of a body that precesses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct SpinState<const A: usize> {
    /// Sum of the rotation vectors that the pose has already followed within the step. \[rad\]
    pub(crate) followed: Vector<f32, A>,
    /// Rounding error left out of the angular velocity. \[rad/s\]
    pub(crate) remainder: Vector<f32, A>,
    /// True if an impact has changed its velocity since its pose was last updated.
    pub(crate) had_impact: bool,
}

/// State and properties of all bodies.
#[derive(Clone)]
pub(crate) struct Bodies<G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) slots: Slots,
    /// `None` if the slot is free.
    pub(crate) motion: Vec<Option<Motion>>,
    /// True for dynamic bodies that are held: they move as kinematic ones.
    pub(crate) held: Vec<bool>,
    pub(crate) user_data: Vec<u128>,
    /// v.
    pub(crate) velocities: Vec<Velocity<f32, L, A>>,
    /// M^-1, zero while the body sleeps.
    pub(crate) inverse_masses: Vec<InverseMass<f32, L, A>>,
    /// M^-1 J^T gamma of the last warm start.
    pub(crate) contact_gains: Vec<Velocity<f32, L, A>>,
    /// How contacts and joints balance.
    pub(crate) balances: Vec<Balance<L, A>>,
    /// Poses of the centers of mass.
    pub(crate) poses: Vec<G::Pose>,
    pub(crate) frames: Vec<Frame<L>>,
    /// Rounding errors left out of the positions. \[m\]
    pub(crate) position_remainders: Vec<Vector<f32, L>>,
    /// Upper bound of the path length of its surfaces since it was added, summed over the steps
    /// ([`Reach::core`]). \[m\]
    pub(crate) path_lengths: Vec<f64>,
    pub(crate) since_search: Vec<SearchMotion<L>>,
    /// Part of this path since its contacts and M^-1 were last rebuilt. \[m\]
    pub(crate) moved_since_rebuild: Vec<f32>,
    /// True if its contacts and M^-1 are rebuilt in this search ([`Bodies::mark_moved`]).
    pub(crate) needs_rebuild: Vec<bool>,
    pub(crate) inertia: Vec<Inertia<L, A>>,
    pub(crate) precession: Vec<Precession>,
    pub(crate) spin_states: Vec<SpinState<A>>,
    /// True if it has rotated since the last contact search
    /// ([`kinematics`](drystone_solver::kinematics)).
    pub(crate) turned: Vec<bool>,
    pub(crate) gravity_factor: Vec<f32>,
    /// Linear and angular damping. The array may be shorter; further bodies have none. \[1/s\]
    pub(crate) damping: Vec<[f32; 2]>,
    /// Reach of its shapes from the center of mass.
    pub(crate) reach: Vec<Reach>,
    /// Smallest extent of all its shapes together; infinite if the body cannot be moved. \[m\]
    pub(crate) thickness: Vec<f32>,
    /// True if a joint acts on it: it rotates in each substep. The array may be shorter; further
    /// bodies have none.
    pub(crate) has_joint: Vec<bool>,
    /// By body: true if its joints are solved to a tolerance, if there are joints.
    pub(crate) is_exact: Vec<bool>,
    /// Force and torque in the next step. The array may be shorter; further bodies have
    /// none. \[N, N m\]
    pub(crate) forces: Vec<Velocity<f32, L, A>>,
    /// Largest speed of a vertex relative to the body, while a mesh of the body deforms. The array
    /// may be shorter; further bodies do not deform. \[m/s\]
    pub(crate) surface_speeds: Vec<f32>,
    /// Kinetic and potential energy that calls have given to held bodies since the last step. \[J\]
    pub(crate) led_energy: [f64; 2],
}

/// Properties of bodies that stay constant through the substeps of a part.
#[derive(Clone, Copy)]
pub(crate) struct BodyParams<'a, const L: usize, const A: usize> {
    /// Frames of the centers of mass when the part began.
    pub(crate) frames: &'a [Frame<L>],
    pub(crate) position_remainders: &'a [Vector<f32, L>],
    motion: &'a [Option<Motion>],
    held: &'a [bool],
    gravity_factor: &'a [f32],
    pub(crate) damping: &'a [[f32; 2]],
    forces: &'a [Velocity<f32, L, A>],
    has_joint: &'a [bool],
    is_exact: &'a [bool],
    pub(crate) inertia: &'a [Inertia<L, A>],
    pub(crate) precession: &'a [Precession],
    pub(crate) reach: &'a [Reach],
}

impl<const L: usize, const A: usize> BodyParams<'_, L, A> {
    pub(crate) fn is_dynamic(&self, body: usize) -> bool {
        self.motion[body] == Some(Motion::Dynamic) && !self.held[body]
    }

    /// Returns true if a joint acts on a body.
    #[inline]
    /// Returns true if the joints of the body are solved to a tolerance.
    pub(crate) fn is_exact(&self, body: usize) -> bool {
        self.is_exact.get(body) == Some(&true)
    }

    pub(crate) fn has_joint(&self, body: usize) -> bool {
        self.has_joint.get(body) == Some(&true)
    }

    /// Returns the force and torque on a body. \[N, N m\]
    pub(crate) fn force(&self, body: usize) -> Velocity<f32, L, A> {
        self.forces.get(body).copied().unwrap_or(Velocity::ZERO)
    }

    /// Returns M of a body at a pose. It is zero if the body is not dynamic, and zero along infinite
    /// entries.
    pub(crate) fn mass<G: Geometry<L, A>>(&self, body: usize, pose: &G::Pose) -> Mass<L, A> {
        if self.is_dynamic(body) { self.inertia[body].mass_at::<G>(pose) } else { Mass::ZERO }
    }

    /// Returns I^-1 of a body in its frame, 0 if it is not dynamic; none in the plane. \[1/(kg m^2)\]
    pub(crate) fn inverse_moments(&self, body: usize) -> Option<SymmetricMatrix<f64, 3>> {
        let mut inverse = SymmetricMatrix::ZERO;
        if self.is_dynamic(body) && A == 3 {
            let own = self.inertia[body].inverse_moments;
            (0..3).for_each(|i| (0..3).for_each(|j| inverse.0[i][j] = f64::from(own.entry(i, j))));
        }
        (A == 3).then_some(inverse)
    }

    /// Returns the acceleration of gravity of a body. \[m/s^2\]
    pub(crate) fn gravity_on(&self, body: usize, gravity: Vector<f32, L>) -> Vector<f32, L> {
        gravity * self.gravity_factor[body]
    }
}

/// The bodies of a batch, to be read.
pub(crate) struct BodyView<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    /// Index of the first body.
    pub(crate) first: usize,
    pub(crate) poses: &'a [G::Pose],
    pub(crate) velocities: &'a [Velocity<f32, L, A>],
    /// M^-1.
    pub(crate) masses: &'a [InverseMass<f32, L, A>],
    pub(crate) spin_states: &'a [SpinState<A>],
    /// Displacements since the search. Without them bodies are where it found them.
    pub(crate) displacements: &'a [Velocity<f32, L, A>],
    /// Properties of all bodies.
    pub(crate) properties: BodyParams<'a, L, A>,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Clone for BodyView<'_, G, L, A> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Copy for BodyView<'_, G, L, A> {}

impl<G: Geometry<L, A>, const L: usize, const A: usize> BodyView<'_, G, L, A> {
    /// Returns the index of a body in the batch. Bodies outside of it stand still.
    pub(crate) fn index(&self, body: u32) -> Option<usize> {
        let index = (body as usize).wrapping_sub(self.first);
        (index < self.poses.len()).then_some(index)
    }

    /// Returns the velocity of a body.
    #[inline(always)]
    pub(crate) fn velocity(&self, body: u32) -> Velocity<f32, L, A> {
        of_batch(self.velocities, self.first, body)
    }

    /// Returns M^-1 of a body.
    #[inline(always)]
    pub(crate) fn inverse_mass(&self, body: u32) -> InverseMass<f32, L, A> {
        of_batch(self.masses, self.first, body)
    }

    /// Returns M of a body of the batch at its present pose. It is zero if the body is not dynamic, and
    /// zero along infinite entries.
    pub(crate) fn mass(&self, body: u32) -> Mass<L, A> {
        self.properties.mass::<G>(body as usize, &self.poses[body as usize - self.first])
    }
}

/// The [`BodyParams`] of [`Bodies`], which stay free to lend their other fields.
macro_rules! params_of {
    ($bodies:ident) => {
        BodyParams {
            frames: &$bodies.frames,
            position_remainders: &$bodies.position_remainders,
            motion: &$bodies.motion,
            held: &$bodies.held,
            gravity_factor: &$bodies.gravity_factor,
            damping: &$bodies.damping,
            forces: &$bodies.forces,
            has_joint: &$bodies.has_joint,
            is_exact: &$bodies.is_exact,
            inertia: &$bodies.inertia,
            precession: &$bodies.precession,
            reach: &$bodies.reach,
        }
    };
}

/// Constant properties and mutable state of bodies, for substeps.
pub(crate) struct BodiesInMotion<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) properties: BodyParams<'a, L, A>,
    pub(crate) poses: &'a mut [G::Pose],
    pub(crate) spin_states: &'a mut [SpinState<A>],
    pub(crate) turned: &'a mut [bool],
    pub(crate) velocities: &'a mut [Velocity<f32, L, A>],
    pub(crate) inverse_masses: &'a mut [InverseMass<f32, L, A>],
    pub(crate) contact_gains: &'a mut [Velocity<f32, L, A>],
    pub(crate) balances: &'a mut [Balance<L, A>],
}

/// Returns the change by damping \[1/s\] of a velocity that gains `change` within `h` \[s\].
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
        // The quotient loses precision for small arguments, so a series replaces it.
        let late = if passed > 1e-3 { -decay / passed - 1.0 } else { passed * -0.5 };
        [decay, late]
    };
    let ([decay, late], [unwinding, later]) = (parts(linear), parts(angular));
    Velocity {
        linear: velocity.linear * decay + change.linear * late,
        angular: velocity.angular * unwinding + change.angular * later,
    }
}

/// Returns the bounding box of a solid in its own frame, or at a pose; `None` if it has no volume.
pub(crate) fn extent<G: Geometry<L, A>, const L: usize, const A: usize>(
    shape: &G::Shape,
    pose: Option<&G::Pose>,
) -> Option<Bounds<L>> {
    let own = || G::pose(Vector::ZERO, &[]);
    let has_volume = G::mass(shape, 1.0).mass > 0.0;
    has_volume.then(|| G::bounds(shape, pose.unwrap_or(&own())))
}

/// Returns the smallest extent of a box, or infinity if there is none. \[m\]
pub(crate) fn smallest<const L: usize>(bounds: &Option<Bounds<L>>) -> f32 {
    let extents = bounds.as_ref().map(|bounds| (bounds.max - bounds.min).0);
    extents.into_iter().flatten().fold(f32::INFINITY, f32::min)
}

/// Returns the smallest extent of all shapes of a body together, in the frame of the body. A single
/// shape is measured in its own frame. \[m\]
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
            held: Vec::new(),
            user_data: Vec::new(),
            velocities: Vec::new(),
            inverse_masses: Vec::new(),
            contact_gains: Vec::new(),
            balances: Vec::new(),
            poses: Vec::new(),
            frames: Vec::new(),
            position_remainders: Vec::new(),
            path_lengths: Vec::new(),
            since_search: Vec::new(),
            moved_since_rebuild: Vec::new(),
            needs_rebuild: Vec::new(),
            inertia: Vec::new(),
            precession: Vec::new(),
            spin_states: Vec::new(),
            turned: Vec::new(),
            gravity_factor: Vec::new(),
            damping: Vec::new(),
            reach: Vec::new(),
            thickness: Vec::new(),
            has_joint: Vec::new(),
            is_exact: Vec::new(),
            forces: Vec::new(),
            surface_speeds: Vec::new(),
            led_energy: [0.0; 2],
        }
    }

    /// Puts a body, without its colliders, into the lowest free slot. Returns the slot.
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
        put(&mut self.held, slot, false);
        put(&mut self.user_data, slot, body.user_data);
        put(&mut self.poses, slot, pose);
        put(&mut self.frames, slot, G::frame(&pose));
        put(&mut self.position_remainders, slot, Vector::ZERO);
        put(&mut self.path_lengths, slot, 0.0);
        put(&mut self.since_search, slot, SearchMotion::NOWHERE);
        put(&mut self.moved_since_rebuild, slot, f32::MAX);
        put(&mut self.needs_rebuild, slot, true);
        put(&mut self.inertia, slot, inertia);
        put(&mut self.precession, slot, precession);
        put(&mut self.spin_states, slot, SpinState::default());
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

    /// Removes the body in a slot.
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

    /// Sets the pose of a body's origin. The displacement counts as motion, so contacts of the body
    /// are searched again.
    pub(crate) fn set_origin(&mut self, body: usize, origin: &G::Pose) {
        let pose = G::compose(origin, &G::pose(self.inertia[body].center, &[]));
        let (before, frame) = (self.frames[body], G::frame(&pose));
        let travel = frame.position - before.position;
        let turned = 2.0 * self.reach[body].core;
        let turned = if turned.is_finite() { turned } else { f32::MAX };
        self.poses[body] = pose;
        self.frames[body] = frame;
        self.position_remainders[body] = Vector::ZERO;
        self.spin_states[body] = SpinState::default();
        self.path_lengths[body] += f64::from(travel.length() + turned);
        self.since_search[body].linear += travel;
        self.since_search[body].turned += turned;
        self.moved_since_rebuild[body] = f32::MAX;
    }

    /// Recomputes M^-1 of a body at its current pose.
    pub(crate) fn set_inverse_mass(&mut self, body: usize) {
        self.inverse_masses[body] = self.inverse_mass(body);
    }

    /// Recomputes M^-1 of the bodies that need a rebuild, at their current poses. Sleeping bodies
    /// get zero: nothing moves them.
    pub(crate) fn update_inverse_masses(
        &mut self,
        is_sleeping: impl Fn(usize) -> bool + Sync,
        pool: &ThreadPool,
    ) {
        let mut all = std::mem::take(&mut self.inverse_masses);
        let (useful, share) = pool.share(all.len(), GRAIN);
        pool.for_each(useful, all.chunks_mut(share).enumerate(), |(part, masses)| {
            for (body, mass) in (share * part..).zip(masses) {
                if is_sleeping(body) {
                    *mass = InverseMass::FIXED;
                } else if self.needs_rebuild[body] || *mass == InverseMass::FIXED {
                    *mass = self.inverse_mass(body);
                }
            }
        });
        self.inverse_masses = all;
    }

    /// Returns a system with the velocities and masses of the bodies, without contacts.
    pub(crate) fn without_contacts(&self) -> System<f32, L, A> {
        let (velocities, masses) = (self.velocities.clone(), self.inverse_masses.clone());
        System { velocities, masses, ..System::new() }
    }

    /// Returns the bodies with a position or velocity that is not finite.
    pub(crate) fn not_finite(&self) -> Vec<u32> {
        // A finite number times zero is zero, any other is NaN. So one pass needs no branches.
        let zero = |body: usize| {
            let (frame, velocity) = (&self.frames[body], &self.velocities[body]);
            let numbers = frame.position.0.iter().chain(&velocity.linear.0);
            numbers.chain(&velocity.angular.0).map(|x| x * 0.0).sum::<f32>()
        };
        let all = 0..self.poses.len();
        if all.clone().map(zero).sum::<f32>() == 0.0 {
            return Vec::new();
        }
        all.filter(|&body| zero(body) != 0.0).map(|body| body as u32).collect()
    }

    /// Marks the bodies whose contacts and M^-1 are to be rebuilt. These bodies have moved by more
    /// than `limit` \[m\] or by more than a small fraction of their size, or have rotated. Bodies
    /// of infinite mass are marked whenever they move.
    pub(crate) fn mark_moved(&mut self, limit: f32, pool: &ThreadPool) {
        let Self { needs_rebuild, moved_since_rebuild, turned, inertia, reach, velocities, .. } =
            self;
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
                    // Its contacts have been updated in the lanes, not in the cache.
                    || *turned;
                if *needs_rebuild {
                    *moved_since_rebuild = 0.0;
                }
            }
        });
    }

    /// Appends a body of no shape that stands for the surface of another at a place `arm` \[m\]
    /// from its center of mass, until the next [`truncate`](Self::truncate). It moves at `velocity`
    /// there.
    /// `lever` is the largest distance of its contact points from the place. \[m\]
    pub(crate) fn push_carrier(
        &mut self,
        of: usize,
        arm: Vector<f32, L>,
        velocity: Velocity<f32, L, A>,
        lever: f32,
    ) {
        self.motion.push(Some(Motion::Kinematic));
        self.held.push(false);
        self.user_data.push(0);
        self.velocities.push(velocity);
        self.inverse_masses.push(InverseMass::FIXED);
        self.contact_gains.push(Velocity::ZERO);
        self.balances.push(Balance::NEW);
        let frame = self.frames[of];
        self.poses.push(G::advance(&self.poses[of], arm, Vector::ZERO));
        self.frames.push(Frame { position: frame.position + arm, ..frame });
        self.position_remainders.push(self.position_remainders[of]);
        self.path_lengths.push(0.0);
        self.since_search.push(SearchMotion::NOWHERE);
        self.moved_since_rebuild.push(f32::MAX);
        self.needs_rebuild.push(true);
        self.inertia.push(Inertia::FIXED);
        self.precession.push(Precession::NONE);
        self.spin_states.push(SpinState::default());
        self.turned.push(false);
        self.gravity_factor.push(0.0);
        self.reach.push(Reach { all: lever, core: lever });
        self.thickness.push(f32::INFINITY);
    }

    /// Removes the carriers after the first `bodies` bodies.
    pub(crate) fn truncate(&mut self, bodies: usize) {
        self.motion.truncate(bodies);
        self.held.truncate(bodies);
        self.user_data.truncate(bodies);
        self.velocities.truncate(bodies);
        self.inverse_masses.truncate(bodies);
        self.contact_gains.truncate(bodies);
        self.balances.truncate(bodies);
        self.poses.truncate(bodies);
        self.frames.truncate(bodies);
        self.position_remainders.truncate(bodies);
        self.path_lengths.truncate(bodies);
        self.since_search.truncate(bodies);
        self.moved_since_rebuild.truncate(bodies);
        self.needs_rebuild.truncate(bodies);
        self.inertia.truncate(bodies);
        self.precession.truncate(bodies);
        self.spin_states.truncate(bodies);
        self.turned.truncate(bodies);
        self.gravity_factor.truncate(bodies);
        self.reach.truncate(bodies);
        self.thickness.truncate(bodies);
    }

    /// Returns the largest speed of a vertex of a body that deforms, else 0. \[m/s\]
    pub(crate) fn surface_speed(&self, body: usize) -> f32 {
        self.surface_speeds.get(body).copied().unwrap_or(0.0)
    }

    /// Adds the motion of the surfaces of bodies that deform for `dt` \[s\] to their paths, so that
    /// their contacts are searched again.
    pub(crate) fn deform(&mut self, dt: f32) {
        for body in 0..self.surface_speeds.len() {
            let moved = self.surface_speeds[body] * dt;
            if moved > 0.0 {
                self.path_lengths[body] += f64::from(moved);
                self.since_search[body].turned += moved;
                self.moved_since_rebuild[body] = f32::MAX;
            }
        }
    }

    /// Makes the next step rebuild the contacts of a body.
    pub(crate) fn rebuild_contacts(&mut self, body: usize) {
        self.moved_since_rebuild[body] = f32::MAX;
    }

    /// Holds a dynamic body, which then moves as a kinematic one, or releases it.
    pub(crate) fn set_held(&mut self, body: usize, held: bool) {
        self.held[body] = held;
        let inertia = &self.inertia[body];
        self.precession[body] = if held { Precession::NONE } else { inertia.precession() };
        self.set_inverse_mass(body);
        self.rebuild_contacts(body);
    }

    /// Returns true if two bodies may touch anew: one of them is `active`, and one dynamic.
    pub(crate) fn may_meet(&self, pair: [u32; 2], active: &[bool]) -> bool {
        pair.iter().any(|&body| active[body as usize])
            && pair.iter().any(|&body| self.is_dynamic(body as usize))
    }

    /// Returns true if forces move a body, or will once it is no longer held.
    pub(crate) fn can_be_moved(&self, body: usize) -> bool {
        self.motion[body] == Some(Motion::Dynamic)
    }

    /// Returns the constant properties and the mutable state of the bodies.
    pub(crate) fn in_motion(&mut self) -> BodiesInMotion<'_, G, L, A> {
        BodiesInMotion {
            properties: params_of!(self),
            poses: &mut self.poses,
            spin_states: &mut self.spin_states,
            turned: &mut self.turned,
            velocities: &mut self.velocities,
            inverse_masses: &mut self.inverse_masses,
            contact_gains: &mut self.contact_gains,
            balances: &mut self.balances,
        }
    }

    /// Returns the bodies as joints see them, with these displacements since the search, if any.
    pub(crate) fn view<'a>(
        &'a self,
        displacements: &'a [Velocity<f32, L, A>],
    ) -> BodyView<'a, G, L, A> {
        BodyView {
            first: 0,
            poses: &self.poses,
            velocities: &self.velocities,
            masses: &self.inverse_masses,
            spin_states: &self.spin_states,
            displacements,
            properties: self.properties(),
        }
    }

    fn properties(&self) -> BodyParams<'_, L, A> {
        params_of!(self)
    }

    /// Sets the linear and angular damping of a body. \[1/s\]
    pub(crate) fn set_damping(&mut self, body: usize, damping: [f32; 2]) {
        if self.damping.len() <= body && damping != [0.0; 2] {
            self.damping.resize(body + 1, [0.0; 2]);
        }
        if let Some(own) = self.damping.get_mut(body) {
            *own = damping;
        }
    }

    pub(crate) fn is_dynamic(&self, body: usize) -> bool {
        self.properties().is_dynamic(body)
    }

    /// Returns true if nothing moves a body.
    pub(crate) fn is_static(&self, body: u32) -> bool {
        self.motion[body as usize] == Some(Motion::Static)
    }

    /// Returns x_a - x_b, including the rounding errors left out of the positions. Far from the
    /// origin an `f32` position is coarser than the gaps of contacts. \[m\]
    pub(crate) fn relative_position(&self, [a, b]: [u32; 2]) -> Vector<f32, L> {
        let (a, b) = (a as usize, b as usize);
        (self.frames[a].position - self.frames[b].position)
            + (self.position_remainders[a] - self.position_remainders[b])
    }

    /// Returns M of a body at its current pose. It is zero if the body is not dynamic, and zero
    /// along infinite entries.
    pub(crate) fn mass(&self, body: usize) -> Mass<L, A> {
        if self.is_dynamic(body) { self.own_mass(body) } else { Mass::ZERO }
    }

    /// Returns M of a dynamic body at its current pose, whether it is held or not.
    fn own_mass(&self, body: usize) -> Mass<L, A> {
        self.inertia[body].mass_at::<G>(&self.poses[body])
    }

    /// Returns M^-1 of a body at its current pose.
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

    /// Returns the force and torque on a body. \[N, N m\]
    pub(crate) fn force(&self, body: usize) -> Velocity<f32, L, A> {
        self.properties().force(body)
    }

    /// Returns the acceleration of gravity of a body. \[m/s^2\]
    pub(crate) fn gravity_on(&self, body: usize, gravity: Vector<f32, L>) -> Vector<f32, L> {
        self.properties().gravity_on(body, gravity)
    }

    /// Returns m |g| of a dynamic body, or 0 if its mass is infinite. \[N\]
    pub(crate) fn weight(&self, body: usize, gravity: Vector<f32, L>) -> f32 {
        let mass = self.inertia[body].mass;
        if self.is_dynamic(body) && mass.is_finite() {
            mass * self.gravity_on(body, gravity).length()
        } else {
            0.0
        }
    }

    /// Returns -m g . x, summed over the dynamic bodies of finite mass that are not held. \[J\]
    pub(crate) fn potential_energy(&self, gravity: Vector<f32, L>) -> f64 {
        let of = |body| if self.is_dynamic(body) { self.height_energy(body, gravity) } else { 0.0 };
        (0..self.frames.len()).map(of).sum()
    }

    /// Returns -m g . x of a dynamic body, or 0 if its mass is infinite. \[J\]
    fn height_energy(&self, body: usize, gravity: Vector<f32, L>) -> f64 {
        let mass = self.inertia[body].mass;
        if !mass.is_finite() {
            return 0.0;
        }
        let position = self.frames[body].position.cast::<f64>();
        -f64::from(mass) * self.gravity_on(body, gravity).cast::<f64>().dot(position)
    }

    /// Returns the kinetic and the potential energy of a body that is held; zero of others. \[J\]
    pub(crate) fn energy_if_held(&self, body: usize, gravity: Vector<f32, L>) -> [f64; 2] {
        if !self.held[body] {
            return [0.0; 2];
        }
        let kinetic = 0.5 * self.own_mass(body).squared(&self.velocities[body].cast());
        [kinetic, self.height_energy(body, gravity)]
    }

    /// Returns the kinetic and the potential energy of all bodies that are held. \[J\]
    pub(crate) fn held_energy(&self, gravity: Vector<f32, L>) -> [f64; 2] {
        let of = |body| self.energy_if_held(body, gravity);
        (0..self.held.len()).map(of).fold([0.0; 2], |sum, own| [sum[0] + own[0], sum[1] + own[1]])
    }

    /// Returns the pose of the body's origin.
    pub(crate) fn origin(&self, body: usize) -> G::Pose {
        let center = self.inertia[body].center;
        if center == Vector::ZERO {
            return self.poses[body];
        }
        G::compose(&self.poses[body], &G::pose(-center, &[]))
    }

    /// Returns the velocity at which the body's origin reaches `target` after `dt` \[s\].
    pub(crate) fn velocity_to(
        &self,
        body: usize,
        target: &G::Pose,
        dt: f32,
    ) -> Velocity<f32, L, A> {
        let from = self.origin(body);
        let apart = G::frame(target).position - G::frame(&from).position;
        Velocity {
            linear: apart * (1.0 / dt),
            angular: G::turn_between(&from, target) * (1.0 / dt),
        }
    }
}
