//! [`Geometry`]: everything that depends on the dimension. That is poses, shapes with bounds and
//! mass, and the contact points of two shapes. The rest of a world is written once for all
//! dimensions.

mod convex;
mod cylinders;
mod hull;
mod mesh;
pub mod particles;
mod polyhedra;
#[cfg(test)]
pub(crate) mod random;
mod rays;
mod rigid;
mod rotation;
mod rounds;
mod solid;

use std::fmt::Debug;

use drystone_solver::{Real, SymmetricMatrix, Vector};

pub use hull::{mass_within, shape as convex_shape};
pub use particles::Particles;
pub use rays::{Ray, SurfaceHit};
pub use rigid::{Pose2, Rigid2, Rigid3};

type Vec3 = Vector<f32, 3>;

/// A geometry with `L` linear and `A` angular degrees of freedom per body.
pub trait Geometry<const L: usize, const A: usize>: Clone + Send + Sync + 'static {
    /// Position and rotation.
    type Pose: Copy + Debug + PartialEq + Send + Sync;
    /// A convex shape, a half-space or a triangle mesh.
    type Shape: Clone + Send + Sync;
    /// A shape with the data that contact detection needs.
    type Prepared: Clone + Send + Sync;
    /// Scratch memory that [`collide`](Self::collide) reuses.
    type Scratch: Default + Send + Sync;

    /// Returns the pose with this position \[m\] and rotation. The rotation is empty (`A` = 0), an
    /// angle \[rad\], or a unit quaternion x, y, z, w.
    fn pose(position: Vector<f32, L>, rotation: &[f32]) -> Self::Pose;

    /// Returns the position of a pose and the world directions of its axes.
    fn frame(pose: &Self::Pose) -> Frame<L>;

    /// Returns the rotation of a pose as a quaternion x, y, z, w; in the plane, about z.
    fn rotation(pose: &Self::Pose) -> [f64; 4];

    /// Returns the pose translated by `by` \[m\] and rotated by the rotation vector `turn` \[rad\]
    /// about its position. The rotation is exact, not linearized.
    fn advance(pose: &Self::Pose, by: Vector<f32, L>, turn: Vector<f32, A>) -> Self::Pose;

    /// Rotates the first `count` of some bodies freely, without torque, for `h` \[s\]. Calls `end`
    /// with the index of each body, its new pose, its new angular velocity, and the rounding error
    /// left out of that velocity.
    ///
    /// Angular momentum and energy are conserved at any angle. The angular velocity changes in 3D
    /// only.
    fn precess(
        spins: &[Spin<'_, Self::Pose, A>; PRECESS_LANES],
        count: usize,
        h: f32,
        mut end: impl FnMut(usize, Self::Pose, [Vector<f32, A>; 2]),
    ) {
        for (index, spin) in spins[..count].iter().enumerate() {
            let pose = Self::advance(&spin.pose, Vector::ZERO, spin.omega * h);
            end(index, pose, [spin.omega, spin.remainder]);
        }
    }

    /// Returns the rotation vector \[rad\] that rotates `from` into `to`.
    fn turn_between(from: &Self::Pose, to: &Self::Pose) -> Vector<f32, A>;

    /// Returns the world pose of `local`, which is given in the frame of `pose`.
    fn compose(pose: &Self::Pose, local: &Self::Pose) -> Self::Pose;

    /// Appends position and rotation to `out`: in 3D px py pz qx qy qz qw, in 2D px py angle.
    fn write(pose: &Self::Pose, out: &mut Vec<f32>);

    /// Returns the pose that [`write`](Self::write) wrote, bit for bit. Missing numbers count as 0.
    fn read(numbers: &[f32]) -> Self::Pose;

    /// Returns the axis-aligned bounding box of a shape.
    fn bounds(shape: &Self::Shape, pose: &Self::Pose) -> Bounds<L>;

    /// Returns bounds on the distance of a shape from the origin.
    fn reach(shape: &Self::Shape, pose: &Self::Pose) -> Reach;

    /// Returns mass, center of mass and inertia of a shape of this density, in its own frame. They
    /// are zero for shapes without volume.
    fn mass(shape: &Self::Shape, density: f32) -> MassProperties<L, A>;

    /// Returns the kind of a shape of which no contacts are known, if it is one.
    fn unsupported(shape: &Self::Shape) -> Option<&'static str>;

    /// Returns the longest side of a shape's box, or none if the shape is unlimited. It is negative
    /// or NaN for a shape with a negative or NaN size. \[m\]
    fn extent(shape: &Self::Shape) -> Option<f32>;

    /// Prepares a shape for [`collide`](Self::collide).
    fn prepare(shape: Self::Shape) -> Self::Prepared;

    /// Returns a ball of no size, which fills the slot of a removed shape.
    fn placeholder() -> Self::Prepared;

    /// Returns the shape that a collider was made from.
    fn shape_of(collider: &Self::Prepared) -> &Self::Shape;

    /// True if the shape may have no interior, so that a body which has passed through it is not
    /// pushed back.
    fn is_open(collider: &Self::Prepared) -> bool;

    /// True if the shape is curved: other points of it touch as it rolls.
    fn is_curved(collider: &Self::Prepared) -> bool;

    /// True if the shape ends in each direction.
    fn is_bounded(_: &Self::Prepared) -> bool {
        false
    }

    /// True if the shape has edges that another shape may touch from the side.
    fn has_edges(_: &Self::Prepared) -> bool {
        false
    }

    /// Returns the radius by which the surface is rounded about its core, where it faces along
    /// `axis`. \[m\] It is 0 at flat faces and corners.
    fn rounding_radius(_: &Self::Prepared, _: &Self::Pose, _axis: Vector<f32, L>) -> f32 {
        0.0
    }

    /// Returns the farthest point of a convex shape along a unit vector. Of a mesh, only the center
    /// of the ball `around` counts, and the edge of the mesh above it. Returns `None` if there is
    /// none in the ball, and for unbounded shapes.
    fn support(
        _: &Self::Prepared,
        _: &Self::Pose,
        _direction: Vector<f32, L>,
        _around: Ball<L>,
    ) -> Option<Vector<f32, L>> {
        None
    }

    /// True if a convex solid with flat faces, or the surface of a mesh, reaches into a ball. False
    /// for all other shapes.
    fn reaches(_: &Self::Prepared, _: &Self::Pose, _: Ball<L>) -> bool {
        false
    }

    /// Returns the center and the collider of a ball inside a convex shape. However fast the shape
    /// rotates, it always covers this ball. Returns `None` for balls, unbounded shapes and shapes
    /// without interior.
    fn inner_ball(_: &Self::Prepared) -> Option<(Vector<f32, L>, Self::Prepared)> {
        None
    }

    /// Calls `face` with the outward normal of each flat face whose plane meets a ball, or of each
    /// triangle of a mesh that does.
    fn faces_at(
        _: &Self::Prepared,
        _: &Self::Pose,
        _ball: Ball<L>,
        _face: &mut dyn FnMut(Vector<f32, L>),
    ) {
    }

    /// Returns where a ray enters a shape. A triangle mesh has no interior: the ray meets it at its
    /// first triangle, from either side.
    fn cast_ray(
        collider: &Self::Prepared,
        pose: &Self::Pose,
        ray: &Ray<L>,
    ) -> Option<SurfaceHit<L>>;

    /// Returns the vertices of a triangle mesh, or `None` for other shapes. \[m\]
    fn vertices(_: &Self::Shape) -> Option<Vec<Vector<f32, L>>> {
        None
    }

    /// Returns a triangle mesh with the same triangles and other vertices \[m\], or `None` for other
    /// shapes and another number of vertices.
    fn with_vertices(_: &Self::Shape, _vertices: &[Vector<f32, L>]) -> Option<Self::Shape> {
        None
    }

    /// Returns the first triangle of a mesh without an area for these vertices. \[m\]
    fn flat_triangle(_: &Self::Shape, _vertices: &[Vector<f32, L>]) -> Option<usize> {
        None
    }

    /// Returns the place on a triangle mesh that is nearest to a point, or `None` for other shapes.
    fn nearest_on_mesh(_: &Self::Shape, _point: Vector<f32, L>) -> Option<MeshPlace> {
        None
    }

    /// Reports each manifold of points at which two shapes overlap or are within the distance of
    /// `ahead`.
    ///
    /// Returns a lower bound of the gap. \[m\] `before` is the feature of a contact point of the
    /// step before, whose features are tested first.
    fn collide(
        a: (&Self::Prepared, &Self::Pose),
        b: (&Self::Prepared, &Self::Pose),
        ahead: impl Into<LookAhead<L>>,
        before: Option<u64>,
        scratch: &mut Self::Scratch,
        report: &mut dyn FnMut(&ContactManifold<L>),
    ) -> f32;
}

/// A place on a triangle mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshPlace {
    /// Vertices of its triangle.
    pub corners: [u32; 3],
    /// Its barycentric coordinates. \[1\]
    pub weights: [f32; 3],
}

/// Distances that a contact query looks ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LookAhead<const L: usize> {
    /// Prediction distance: shapes with no larger gap are in contact. \[m\]
    pub prediction: f32,
    /// Displacement of a relative to b until the next contact search. \[m\]
    pub motion: Vector<f32, L>,
    /// Largest displacement of their surfaces by rotation until then. \[m\]
    pub turning: f32,
}

impl<const L: usize> From<f32> for LookAhead<L> {
    /// Returns the query for shapes that do not move.
    fn from(prediction: f32) -> Self {
        Self { prediction, motion: Vector::ZERO, turning: 0.0 }
    }
}

/// Bounds on the distance of shapes from the center that they rotate about.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reach {
    /// Largest distance of any point of the shapes. \[m\]
    pub all: f32,
    /// Largest distance of the cores of the shapes. \[m\] A shape rounded about a core counts with
    /// its core only: a ball with its center, since a ball that rotates about its center does not
    /// move. This is the lever by which a rotation moves surfaces.
    pub core: f32,
}

impl Reach {
    /// Returns the reach of two sets of shapes together.
    pub fn joined(&self, other: &Self) -> Self {
        Self { all: self.all.max(other.all), core: self.core.max(other.core) }
    }
}

/// A body that rotates freely.
#[derive(Clone, Copy, Debug)]
pub struct Spin<'a, P, const A: usize> {
    /// Its pose at the start.
    pub pose: P,
    /// I_0 and its inverse, in the frame of the body.
    pub moments: [&'a SymmetricMatrix<f32, A>; 2],
    /// Bounds on its precession.
    pub precession: Precession,
    /// Angular velocity. \[rad/s\]
    pub omega: Vector<f32, A>,
    /// Rounding error left out of `omega`. \[rad/s\]
    pub remainder: Vector<f32, A>,
}

/// Bounds on the change of the angular velocity of a body that rotates freely.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Precession {
    /// Largest relative change of the angular velocity per angle of rotation: 0 for balls, 1 for
    /// all solids. \[1\]
    pub rate: f32,
    /// Upper bound of the ratio of the largest moment of inertia to the smallest. \[1\]
    pub spread: f32,
}

impl Precession {
    /// No precession: the angular velocity stays constant.
    pub const NONE: Self = Self { rate: 0.0, spread: 1.0 };
}

/// Number of bodies that [`Geometry::precess`] rotates at once.
pub const PRECESS_LANES: usize = 8;

/// Returns how many numbers [`Geometry::write`] appends in `dimension` dimensions.
pub const fn pose_numbers(dimension: usize) -> usize {
    if dimension == 3 { 7 } else { 3 }
}

/// Returns the first `N` numbers, with 0 for missing ones.
fn leading<const N: usize>(numbers: &[f32]) -> [f32; N] {
    std::array::from_fn(|i| numbers.get(i).copied().unwrap_or(0.0))
}

/// A ball in space.
#[derive(Clone, Copy, Debug)]
pub struct Ball<const L: usize> {
    /// Center. \[m\]
    pub center: Vector<f32, L>,
    /// Radius. \[m\]
    pub radius: f32,
}

impl<const L: usize> Ball<L> {
    /// Returns the ball in the coordinates of a frame.
    pub fn seen_from(&self, frame: &Frame<L>) -> Self {
        Self { center: frame.local_point(self.center), ..*self }
    }

    /// Returns the ball in space; one in the plane is at z = 0.
    fn spatial(&self) -> Ball<3> {
        Ball { center: Vector(leading(&self.center.0)), radius: self.radius }
    }
}

/// Position and orientation of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame<const L: usize> {
    /// Origin. \[m\]
    pub position: Vector<f32, L>,
    /// World directions of the local axes: the columns of R.
    pub axes: [Vector<f32, L>; L],
}

impl<const L: usize> Frame<L> {
    /// The world frame.
    pub const IDENTITY: Self = {
        let mut axes = [Vector([0.0; L]); L];
        let mut i = 0;
        while i < L {
            axes[i].0[i] = 1.0;
            i += 1;
        }
        Self { position: Vector([0.0; L]), axes }
    };

    /// Transforms a point to the world: R p + x.
    #[inline]
    pub fn point(&self, local: Vector<f32, L>) -> Vector<f32, L> {
        self.position + self.direction(local)
    }

    /// Rotates a direction to the world: R d.
    #[inline]
    pub fn direction(&self, local: Vector<f32, L>) -> Vector<f32, L> {
        let mut world = Vector::ZERO;
        for i in 0..L {
            world += self.axes[i] * local[i];
        }
        world
    }

    /// Transforms a world point to this frame: R^T (p - x).
    #[inline]
    pub fn local_point(&self, world: Vector<f32, L>) -> Vector<f32, L> {
        self.local_direction(world - self.position)
    }

    /// Rotates a world direction to this frame: R^T d.
    #[inline]
    pub fn local_direction(&self, world: Vector<f32, L>) -> Vector<f32, L> {
        Vector(std::array::from_fn(|i| self.axes[i].dot(world)))
    }

    /// Returns this frame in the coordinates of another one.
    pub fn seen_from(&self, other: &Self) -> Self {
        Self {
            position: other.local_point(self.position),
            axes: self.axes.map(|axis| other.local_direction(axis)),
        }
    }

    /// Rotates a rotation vector of this frame to world axes. In 2D it is a scalar, which does not
    /// change.
    pub fn turning<const A: usize>(&self, local: Vector<f32, A>) -> Vector<f32, A> {
        if A != L {
            return local;
        }
        let mut world = Vector::ZERO;
        for (axis, component) in self.axes.iter().zip(local.0) {
            for i in 0..A {
                world[i] += axis[i] * component;
            }
        }
        world
    }

    /// Rotates a rotation vector of world axes to this frame. In 2D it is a scalar, which does not
    /// change.
    pub fn local_turning<const A: usize>(&self, world: Vector<f32, A>) -> Vector<f32, A> {
        if A != L {
            return world;
        }
        let mut local = Vector::ZERO;
        for (component, axis) in local.0.iter_mut().zip(&self.axes) {
            for i in 0..A {
                *component += axis[i] * world[i];
            }
        }
        local
    }

    /// Rotates a tensor of this frame to world axes: R D R^T. In 2D it is a scalar, which does not
    /// change.
    pub fn tensor<const A: usize>(
        &self,
        local: SymmetricMatrix<f32, A>,
    ) -> SymmetricMatrix<f32, A> {
        if A != L {
            return local;
        }
        local.rotated(&std::array::from_fn(|i| Vector(std::array::from_fn(|j| self.axes[i][j]))))
    }
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds<const L: usize> {
    /// Lowest corner. \[m\]
    pub min: Vector<f32, L>,
    /// Highest corner. \[m\]
    pub max: Vector<f32, L>,
}

impl<const L: usize> Bounds<L> {
    /// The empty box: it overlaps no box, and joining it changes nothing.
    pub const EMPTY: Self =
        Self { min: Vector([f32::INFINITY; L]), max: Vector([f32::NEG_INFINITY; L]) };

    /// Returns the distance of the farthest corner from the origin. \[m\]
    pub fn reach(&self) -> f32 {
        let far = |i| self.max[i].max(-self.min[i]);
        Vector(std::array::from_fn::<f32, L, _>(far)).length()
    }

    /// True if the boxes have a point in common.
    pub fn overlaps(&self, other: &Self) -> bool {
        (0..L).all(|i| self.min[i] <= other.max[i] && other.min[i] <= self.max[i])
    }

    /// Returns the smallest box around both.
    pub fn joined(&self, other: &Self) -> Self {
        Self {
            min: Vector(std::array::from_fn(|i| self.min[i].min(other.min[i]))),
            max: Vector(std::array::from_fn(|i| self.max[i].max(other.max[i]))),
        }
    }
}

/// Mass, center of mass and inertia.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassProperties<const L: usize, const A: usize> {
    /// Mass. \[kg\]
    pub mass: f32,
    /// Center of mass. \[m\]
    pub center: Vector<f32, L>,
    /// Inertia about the center of mass. \[kg m^2\]
    pub inertia: SymmetricMatrix<f32, A>,
}

impl<const L: usize, const A: usize> MassProperties<L, A> {
    /// A massless body.
    pub const ZERO: Self = Self { mass: 0.0, center: Vector::ZERO, inertia: SymmetricMatrix::ZERO };

    /// Transforms mass properties from a frame to the coordinates in which the frame is given.
    pub fn placed(&self, frame: &Frame<L>) -> Self {
        Self {
            mass: self.mass,
            center: frame.point(self.center),
            inertia: frame.tensor(self.inertia),
        }
    }

    /// Returns the mass properties of both bodies together, by the parallel axis theorem.
    pub fn joined(&self, other: &Self) -> Self {
        let mass = self.mass + other.mass;
        if mass <= 0.0 {
            return Self::ZERO;
        }
        let center = (self.center * self.mass + other.center * other.mass) * (1.0 / mass);
        let mut inertia = SymmetricMatrix::ZERO;
        for part in [self, other] {
            let d = part.center - center;
            let squared = d.dot(d);
            for i in 0..A {
                for j in 0..A {
                    let steiner = match (A, i == j) {
                        (3, true) => squared - d[i] * d[j],
                        (3, false) => -d[i] * d[j],
                        _ => squared,
                    };
                    inertia.0[i][j] += part.inertia.0[i][j] + part.mass * steiner;
                }
            }
        }
        Self { mass, center, inertia }
    }
}

/// Largest number of points of a manifold.
pub const MAX_POINTS: usize = 4;

/// A contact manifold: contact points of two shapes that share a normal.
#[derive(Clone, Debug, Default)]
pub struct ContactManifold<const L: usize> {
    /// Number of the part of the shapes that touches, as a triangle or facet of a mesh.
    pub part: u32,
    /// World unit normal, from b towards a.
    pub normal: Vector<f32, L>,
    /// Curvature of the surfaces at the contact.
    pub surfaces: Curvature,
    /// Contact points.
    pub points: Vec<ManifoldPoint<L>>,
    /// Points that [`reduce`](Self::reduce) has spared for a manifold of their own.
    pub spare: Vec<ManifoldPoint<L>>,
}

/// Curvature of two surfaces at a contact, and the motion of their normal as the bodies rotate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Curvature {
    /// Radii of curvature of a and b; 0 for flat faces and sharp edges. \[m\]
    pub radii: [f32; 2],
    /// The feature that the normal follows.
    pub normal: NormalCarrier,
}

/// The feature that a contact normal follows when the bodies rotate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NormalCarrier {
    /// Two crossing edges: the normal follows both bodies alike.
    #[default]
    Edges,
    /// The face of a.
    FaceOfA,
    /// The face of b.
    FaceOfB,
    /// The line between the centers of curvature.
    Centers,
}

impl NormalCarrier {
    /// Returns the fractions of the rotations of a and b that the normal follows
    /// ([`Manifold::normal_share`](drystone_solver::Manifold::normal_share)). \[1\]
    pub(crate) fn shares(self) -> [f32; 2] {
        match self {
            Self::Edges => [0.5; 2],
            Self::FaceOfA => [1.0, 0.0],
            Self::FaceOfB => [0.0, 1.0],
            Self::Centers => [0.0; 2],
        }
    }

    /// Returns the carrier with these shares; [`Self::Edges`] if none has them.
    pub(crate) fn of(shares: [f32; 2]) -> Self {
        let all = [Self::FaceOfA, Self::FaceOfB, Self::Centers];
        all.into_iter().find(|carrier| carrier.shares() == shares).unwrap_or(Self::Edges)
    }

    /// Returns the point at which impulses act on both bodies, given the contact point on the
    /// surface of each. It is on the surface that moves with the contact points
    /// ([`drystone_solver::kinematics`]), and midway between edges.
    pub(crate) fn push_point<const L: usize>(
        self,
        [on_a, on_b]: [Vector<f32, L>; 2],
    ) -> Vector<f32, L> {
        match self {
            Self::FaceOfA => on_b,
            Self::FaceOfB | Self::Centers => on_a,
            Self::Edges => (on_a + on_b) * 0.5,
        }
    }

    /// Returns the carrier after an exchange of a and b.
    fn exchanged(self) -> Self {
        match self {
            Self::FaceOfA => Self::FaceOfB,
            Self::FaceOfB => Self::FaceOfA,
            same => same,
        }
    }
}

/// A contact point of two shapes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ManifoldPoint<const L: usize> {
    /// Point on the surface of a, in the world. \[m\]
    pub on_a: Vector<f32, L>,
    /// Point on the surface of b, in the world. \[m\]
    pub on_b: Vector<f32, L>,
    /// Gap along the normal, negative if the shapes overlap. \[m\]
    pub gap: f32,
    /// Identifies the features of both shapes that touch here; stable from step to step.
    pub feature: u64,
}

impl<const L: usize> ContactManifold<L> {
    /// Transforms the manifold from the coordinates of `frame` to those in which `frame` is given.
    fn transform(&mut self, frame: &Frame<L>) {
        self.normal = frame.direction(self.normal);
        for point in self.points.iter_mut().chain(&mut self.spare) {
            point.on_a = frame.point(point.on_a);
            point.on_b = frame.point(point.on_b);
        }
    }

    /// Exchanges a and b.
    fn exchange(&mut self) {
        self.normal = -self.normal;
        let Curvature { radii: [a, b], normal } = self.surfaces;
        self.surfaces = Curvature { radii: [b, a], normal: normal.exchanged() };
        for point in self.points.iter_mut().chain(&mut self.spare) {
            std::mem::swap(&mut point.on_a, &mut point.on_b);
        }
    }

    /// Calls `report` with the manifold, and with one of the points that [`reduce`](Self::reduce)
    /// has spared.
    fn report(&mut self, report: &mut dyn FnMut(&Self)) {
        if self.points.is_empty() {
            self.spare.clear();
            return;
        }
        report(self);
        if !self.spare.is_empty() {
            std::mem::swap(&mut self.points, &mut self.spare);
            self.part ^= SPARE;
            report(self);
            self.part ^= SPARE;
            std::mem::swap(&mut self.points, &mut self.spare);
            self.spare.clear();
        }
    }

    /// Reduces the points to as many as the dimension needs (2D: 2, 3D: 4). It keeps the deepest
    /// point, then those that span the largest area with it.
    ///
    /// On a patch that leans, other points nearly as deep as the deepest are spared for a manifold
    /// of their own: a body that wobbles comes down on them before the next search.
    ///
    /// Depths that are equal to within `FLAT` do not decide which point is the deepest. Then the
    /// choice depends on positions alone, and a resting patch keeps its points from step to step.
    pub fn reduce(&mut self) {
        let most = if L == 2 { 2 } else { MAX_POINTS };
        let points = &mut self.points;
        self.spare.clear();
        merge_duplicates(points);
        if points.len() <= most {
            return;
        }
        let from = points[0].on_a;
        let corner = best(points, 0, |p| squared(p.on_a - from));
        let tolerance = FLAT * (points[corner].on_a - from).length();
        let deeper = |best: usize, i: usize| {
            if points[i].gap < points[best].gap - tolerance { i } else { best }
        };
        let first = (0..points.len()).fold(corner, deeper);
        points.swap(0, first);
        let first = points[0].on_a;
        let farthest = best(points, 1, |p| squared(p.on_a - first));
        points.swap(1, farthest);
        if most > 2 {
            let normal = self.normal;
            let second = points[1].on_a;
            let side = |p: Vector<f32, L>| across(second - first, p - first, normal);
            let third = best(points, 2, |p| side(p.on_a).abs());
            points.swap(2, third);
            let third = points[2].on_a;
            let outward = if side(third) > 0.0 { -1.0 } else { 1.0 };
            let edges = [[first, second], [second, third], [third, first]];
            let added = |p: &ManifoldPoint<L>| {
                let beyond = |[from, to]: [Vector<f32, L>; 2]| {
                    outward * across(to - from, p.on_a - from, normal)
                };
                edges.map(beyond).into_iter().fold(f32::NEG_INFINITY, f32::max)
            };
            let fourth = best(points, 3, added);
            points.swap(3, fourth);
            let extent = (points[1].on_a - first).length();
            let [low, high] = range(points.iter().map(|point| point.gap));
            if high - low > (LEANING * extent).max(LIFTED) {
                let near = |point: &&ManifoldPoint<L>| point.gap < low + NEARLY * (high - low);
                self.spare.extend(points[most..].iter().filter(near));
                self.spare.sort_by(|p, q| p.gap.total_cmp(&q.gap));
                self.spare.truncate(most);
            }
        }
        points.truncate(most);
    }
}

/// Returns the smallest and the largest of some numbers.
fn range(numbers: impl Iterator<Item = f32>) -> [f32; 2] {
    numbers.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
}

/// A bit of the part of a manifold of spare points.
const SPARE: u32 = 1 << 27;

/// Patches whose depths differ by more than this fraction of their extent lean. \[1\]
const LEANING: f32 = 1e-3;

/// Smaller differences are errors of velocities within a step: a coin of millimeters leans by them
/// at rest. \[m\]
const LIFTED: f32 = 3e-5;

/// Points that differ in depth from the deepest by less than this fraction of all depths are nearly
/// as deep. \[1\]
const NEARLY: f32 = 0.05;

/// Depths that differ by less than this fraction of a patch's extent count as equal. \[1\]
const FLAT: f32 = 1e-5;

/// Scores of candidate points that differ by less than this fraction count as equal. \[1\]
const ALIKE: f32 = 1e-3;

/// Points closer than this fraction of a patch's extent are one point that rounding has split. It
/// is small enough that a patch of aspect ratio 1:1000 keeps its width. \[1\]
const SAME: f32 = 1e-4;

/// Relative rounding error of coordinates. \[1\]
const ROUNDING: f32 = 3e-7;

fn squared<const L: usize>(v: Vector<f32, L>) -> f32 {
    v.dot(v)
}

/// Returns (edge x arm) . normal: twice the area that a point adds on one side of an edge.
fn across<const L: usize>(edge: Vector<f32, L>, arm: Vector<f32, L>, n: Vector<f32, L>) -> f32 {
    let area: Vector<f32, L> = drystone_solver::moment(edge, arm);
    area.dot(n)
}

/// Returns the index of the point with the largest value, from `from` on; the first one if several
/// are within [`ALIKE`].
fn best<P>(points: &[P], from: usize, value: impl Fn(&P) -> f32) -> usize {
    let (mut index, mut most) = (from, value(&points[from]));
    for (i, point) in points.iter().enumerate().skip(from + 1) {
        let own = value(point);
        if own > most.max(most * (1.0 + ALIKE)) {
            (index, most) = (i, own);
        }
    }
    index
}

/// Merges points at one position into one point with the smallest gap. Two points at one position
/// share a load without supporting any moment.
fn merge_duplicates<const L: usize>(points: &mut Vec<ManifoldPoint<L>>) {
    if points.len() < 2 {
        return;
    }
    let first = points[0].on_a;
    let extent = points.iter().map(|p| squared(p.on_a - first)).fold(0.0f32, Real::max);
    let near = extent * (SAME * SAME) + squared(first) * (ROUNDING * ROUNDING);
    let mut i = 1;
    while i < points.len() {
        match (0..i).find(|&j| squared(points[i].on_a - points[j].on_a) <= near) {
            Some(j) => {
                if points[i].gap < points[j].gap {
                    points[j].gap = points[i].gap;
                    points[j].on_a = points[i].on_a;
                    points[j].on_b = points[i].on_b;
                }
                points.remove(i);
            }
            None => i += 1,
        }
    }
}

#[cfg(test)]
mod tests;
