//! [`Dimension`]: the four kinds of worlds, compiled in this crate.
//!
//! A generic method is compiled by the crate that calls it, at the optimization level of that
//! crate: the debug build of a game would take eight times as long for a step. So the methods with
//! all the work are called through a trait whose implementations are not generic.

use drystone_solver::Vector;

use crate::bodies::Body;
use crate::geometry::particles::Particles;
use crate::geometry::{Bounds, Geometry, Rigid2, Rigid3};
use crate::ids::{BodyId, ColliderId};
use crate::input::InputError;
use crate::queries::RayHit;
use crate::report::{Measure, StepReport};
use crate::world::{Checkpoint, CheckpointError, World};

/// A [`Geometry`] that worlds exist for: rigid bodies or particles, in the plane or in space.
pub trait Dimension<const L: usize, const A: usize>: Geometry<L, A> {
    /// [`World::add`].
    #[doc(hidden)]
    fn add(world: &mut World<Self, L, A>, body: Body<Self, L, A>) -> Result<BodyId, InputError>;

    /// [`World::remove`].
    #[doc(hidden)]
    fn remove(world: &mut World<Self, L, A>, id: BodyId) -> bool;

    /// [`World::step`].
    #[doc(hidden)]
    fn step(world: &mut World<Self, L, A>, dt: f32) -> Result<StepReport, InputError>;

    /// [`World::measure`].
    #[doc(hidden)]
    fn measure(world: &World<Self, L, A>) -> Measure;

    /// [`World::checkpoint`].
    #[doc(hidden)]
    fn checkpoint(world: &World<Self, L, A>) -> Checkpoint;

    /// [`World::restore`].
    #[doc(hidden)]
    fn restore(world: &mut World<Self, L, A>, from: &Checkpoint) -> Result<(), CheckpointError>;

    /// [`World::colliders_in_box`].
    #[doc(hidden)]
    fn colliders_in_box(
        world: &World<Self, L, A>,
        bounds: &Bounds<L>,
    ) -> Result<Vec<ColliderId>, InputError>;

    /// [`World::colliders_at`].
    #[doc(hidden)]
    fn colliders_at(
        world: &World<Self, L, A>,
        point: Vector<f32, L>,
    ) -> Result<Vec<ColliderId>, InputError>;

    /// [`World::cast_ray_where`].
    #[doc(hidden)]
    fn cast_ray_where(
        world: &World<Self, L, A>,
        origin: Vector<f32, L>,
        direction: Vector<f32, L>,
        max_distance: f32,
        accepts: &dyn Fn(ColliderId) -> bool,
    ) -> Result<Option<RayHit<L>>, InputError>;
}

/// Implements [`Dimension`] for one kind of world.
macro_rules! compiled {
    ($geometry:ty, $l:literal, $a:literal) => {
        impl Dimension<$l, $a> for $geometry {
            #[inline(never)]
            fn add(
                world: &mut World<Self, $l, $a>,
                body: Body<Self, $l, $a>,
            ) -> Result<BodyId, InputError> {
                world.insert(body)
            }

            #[inline(never)]
            fn remove(world: &mut World<Self, $l, $a>, id: BodyId) -> bool {
                world.take_out(id)
            }

            #[inline(never)]
            fn step(world: &mut World<Self, $l, $a>, dt: f32) -> Result<StepReport, InputError> {
                world.take_step(dt)
            }

            #[inline(never)]
            fn measure(world: &World<Self, $l, $a>) -> Measure {
                world.measured()
            }

            #[inline(never)]
            fn checkpoint(world: &World<Self, $l, $a>) -> Checkpoint {
                world.save_state()
            }

            #[inline(never)]
            fn restore(
                world: &mut World<Self, $l, $a>,
                from: &Checkpoint,
            ) -> Result<(), CheckpointError> {
                world.load_state(from)
            }

            #[inline(never)]
            fn colliders_in_box(
                world: &World<Self, $l, $a>,
                bounds: &Bounds<$l>,
            ) -> Result<Vec<ColliderId>, InputError> {
                world.find_in_box(bounds)
            }

            #[inline(never)]
            fn colliders_at(
                world: &World<Self, $l, $a>,
                point: Vector<f32, $l>,
            ) -> Result<Vec<ColliderId>, InputError> {
                world.find_at(point)
            }

            #[inline(never)]
            fn cast_ray_where(
                world: &World<Self, $l, $a>,
                origin: Vector<f32, $l>,
                direction: Vector<f32, $l>,
                max_distance: f32,
                accepts: &dyn Fn(ColliderId) -> bool,
            ) -> Result<Option<RayHit<$l>>, InputError> {
                world.first_hit(origin, direction, max_distance, accepts)
            }
        }
    };
}

compiled!(Rigid2, 2, 1);
compiled!(Rigid3, 3, 3);
compiled!(Particles, 2, 0);
compiled!(Particles, 3, 0);

impl<G: Dimension<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Adds a body. Mass and inertia come from its shapes unless it brings its own.
    ///
    /// # Errors
    /// A number of the body is not finite or out of range, a dynamic body has no mass, or no
    /// contacts are known of a shape. The world is then as it was.
    pub fn add(&mut self, body: Body<G, L, A>) -> Result<BodyId, InputError> {
        G::add(self, body)
    }

    /// Removes a body with its colliders, and wakes the bodies near it. Returns true if it was
    /// there.
    pub fn remove(&mut self, id: BodyId) -> bool {
        G::remove(self, id)
    }

    /// Moves the world on by `dt` \[s\]: 1/240 to 1/24 s for motion that people watch. Nothing
    /// moves in a step of 0 s.
    ///
    /// # Errors
    /// The step is negative or not finite, as gravity may be, or a setting is out of its range
    /// ([`StepSettings::RANGES`](crate::StepSettings::RANGES)). The world is then as it was.
    pub fn step(&mut self, dt: f32) -> Result<StepReport, InputError> {
        G::step(self, dt)
    }

    /// Returns energies, deepest penetration and residual after the last step.
    pub fn measure(&self) -> Measure {
        G::measure(self)
    }

    /// Returns the state between two steps, with the bodies.
    ///
    /// Written as bytes, it is without the bodies, and only a world takes it that has them.
    pub fn checkpoint(&self) -> Checkpoint {
        G::checkpoint(self)
    }

    /// Restores a state. All further steps repeat those after the checkpoint bit by bit, with the
    /// same settings.
    ///
    /// Bodies that were added since are removed, and bodies that were removed come back with their
    /// identifiers. An identifier of a body that was added since may later name another body.
    ///
    /// # Errors
    /// It is of another world. This one is then as it was.
    pub fn restore(&mut self, from: &Checkpoint) -> Result<(), CheckpointError> {
        G::restore(self, from)
    }
    /// Returns the colliders whose bounding boxes overlap a box, in the order of their slots,
    /// sleeping bodies included.
    ///
    /// # Errors
    /// A corner of the box is NaN.
    pub fn colliders_in_box(&self, bounds: &Bounds<L>) -> Result<Vec<ColliderId>, InputError> {
        G::colliders_in_box(self, bounds)
    }

    /// Returns the colliders that contain a point \[m\], in the order of their slots. A triangle
    /// mesh contains none.
    ///
    /// # Errors
    /// The point is out of its range.
    pub fn colliders_at(
        &self,
        point: impl Into<Vector<f32, L>>,
    ) -> Result<Vec<ColliderId>, InputError> {
        G::colliders_at(self, point.into())
    }

    /// Returns the first collider on a ray: the nearest point in a collider at most `max_distance`
    /// \[m\] from `origin` \[m\] along `direction`, whose length does not count.
    ///
    /// A ray that begins in a collider hits it at distance 0. Triangle meshes have no interior, and
    /// are hit from both sides. Half-spaces end 100 km from their position.
    ///
    /// ```
    /// use drystone::{Body, Motion, StepSettings, World3};
    /// use parry3d::shape::SharedShape;
    ///
    /// let mut world = World3::new(StepSettings::realtime());
    /// let ball = Body::new(Motion::Dynamic, [0.0, 5.0, 0.0], SharedShape::ball(0.5));
    /// let ball = world.add(ball).unwrap();
    /// let hit = world.cast_ray([0.0; 3], [0.0, 2.0, 0.0], f32::INFINITY).unwrap().unwrap();
    /// assert_eq!((hit.body, hit.distance), (ball, 4.5));
    /// ```
    ///
    /// # Errors
    /// The origin is out of its range, the direction is zero, the distance is negative, or a number
    /// is NaN.
    pub fn cast_ray(
        &self,
        origin: impl Into<Vector<f32, L>>,
        direction: impl Into<Vector<f32, L>>,
        max_distance: f32,
    ) -> Result<Option<RayHit<L>>, InputError> {
        self.cast_ray_where(origin, direction, max_distance, |_| true)
    }

    /// Returns the first hit of a ray ([`World::cast_ray`]) among the colliders for which `accepts`
    /// returns true. The others do not stop the ray.
    ///
    /// # Errors
    /// Those of [`World::cast_ray`].
    pub fn cast_ray_where(
        &self,
        origin: impl Into<Vector<f32, L>>,
        direction: impl Into<Vector<f32, L>>,
        max_distance: f32,
        accepts: impl Fn(ColliderId) -> bool,
    ) -> Result<Option<RayHit<L>>, InputError> {
        G::cast_ray_where(self, origin.into(), direction.into(), max_distance, &accepts)
    }
}
