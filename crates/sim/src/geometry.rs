//! What a dimension must supply: poses that advance, shapes with bounds and mass, and the points
//! where two shapes touch. Everything else in a world is written once for all of them.

mod convex;
mod cylinders;
mod hull;
mod mesh;
mod polyhedra;
#[cfg(test)]
pub(crate) mod random;
mod rigid;
mod rotation;
mod rounds;
mod separation;
mod solid;
pub mod spheres;

use std::fmt::Debug;

use drystone_solver::{Real, SymmetricMatrix, Vector};

pub(crate) use hull::{mass_within, shape as convex_shape};
pub use rigid::{Rigid2, Rigid3};
pub use spheres::Spheres;

/// A dimension: `L` linear and `A` angular degrees of freedom.
pub trait Geometry<const L: usize, const A: usize>: Clone + Send + Sync + 'static {
    /// Position and rotation.
    type Pose: Copy + Debug + PartialEq + Send + Sync;
    /// A convex shape, a half-space or a triangle mesh.
    type Shape: Clone + Send + Sync;
    /// A shape with what its contacts need at hand.
    type Collider: Clone + Send + Sync;
    /// Memory that [`collide`](Self::collide) reuses.
    type Scratch: Default + Send + Sync;

    /// A pose from a position \[m\] and a rotation: nothing (`A` = 0), an angle \[rad\], or a unit
    /// quaternion x, y, z, w.
    fn pose(position: Vector<f32, L>, rotation: &[f32]) -> Self::Pose;

    /// Position and the world directions of the pose's axes.
    fn frame(pose: &Self::Pose) -> Frame<L>;

    /// The pose translated by `by` \[m\] and turned by the rotation vector `turn` \[rad\] about its
    /// position, exactly.
    fn advance(pose: &Self::Pose, by: Vector<f32, L>, turn: Vector<f32, A>) -> Self::Pose;

    /// The first `count` of some bodies turn freely for `h` \[s\]: calls `end` with the number of each, its pose
    /// then, its angular velocity, and what rounding has left out of that. Keeps angular momentum and energy at any
    /// angle. Only bodies in space change their angular velocity.
    fn precess(
        spins: &[Spin<'_, Self::Pose, A>; TOGETHER],
        count: usize,
        h: f32,
        mut end: impl FnMut(usize, Self::Pose, [Vector<f32, A>; 2]),
    ) {
        for (index, spin) in spins[..count].iter().enumerate() {
            let pose = Self::advance(&spin.pose, Vector::ZERO, spin.omega * h);
            end(index, pose, [spin.omega, spin.remainder]);
        }
    }

    /// The rotation vector \[rad\] that turns `from` into `to`.
    fn turn_between(from: &Self::Pose, to: &Self::Pose) -> Vector<f32, A>;

    /// `local`, given in the frame of `pose`, in the world.
    fn compose(pose: &Self::Pose, local: &Self::Pose) -> Self::Pose;

    /// Appends position and rotation: 3D px py pz qx qy qz qw, 2D px py angle.
    fn write(pose: &Self::Pose, out: &mut Vec<f32>);

    /// The pose that [`write`](Self::write) wrote, to the last bit; a number that is missing is 0.
    fn read(numbers: &[f32]) -> Self::Pose;

    /// The axis-aligned box around a shape.
    fn bounds(shape: &Self::Shape, pose: &Self::Pose) -> Bounds<L>;

    /// How far a shape comes from the origin.
    fn reach(shape: &Self::Shape, pose: &Self::Pose) -> Reach;

    /// Mass, center and inertia of a shape of this density in its own frame; zero for what has
    /// no volume.
    fn mass(shape: &Self::Shape, density: f32) -> MassProperties<L, A>;

    /// A shape made ready for [`collide`](Self::collide).
    fn collider(shape: Self::Shape) -> Self::Collider;

    /// A ball of no size, which stands where a shape was removed.
    fn nothing() -> Self::Collider;

    /// The shape it is made of.
    fn shape_of(collider: &Self::Collider) -> &Self::Shape;

    /// Whether it may have no inside: what has passed it is lost.
    fn is_sheet(collider: &Self::Collider) -> bool;

    /// Whether it is curved: where it rolls, other points of it touch.
    fn rolls(collider: &Self::Collider) -> bool;

    /// The shape has a farthest point in each direction ([`farthest`](Self::farthest)).
    fn has_ends(_: &Self::Collider) -> bool {
        false
    }

    /// Whether it has edges that another shape may meet from the side.
    fn has_corners(_: &Self::Collider) -> bool {
        false
    }

    /// The radius by which a shape is round about its core, where its surface looks along `axis`; 0 of corners. \[m\]
    fn roundness(_: &Self::Collider, _: &Self::Pose, _axis: Vector<f32, L>) -> f32 {
        0.0
    }

    /// A point is inside of a box or a hull, or outside by no more than `near`. \[m\]
    fn holds(_: &Self::Collider, _: &Self::Pose, _point: Vector<f32, L>, _near: f32) -> bool {
        false
    }

    /// The point of a shape that is farthest along a direction; none of what has no end, and of meshes,
    /// whose neighbors are flush by their own topology.
    fn farthest(
        _: &Self::Collider,
        _: &Self::Pose,
        _direction: Vector<f32, L>,
    ) -> Option<Vector<f32, L>> {
        None
    }

    /// A ball that is within a convex shape, and where its center is: however fast the shape turns, there is always
    /// something of it. None of balls, and of what has no end or no inside.
    fn core(_: &Self::Collider) -> Option<(Vector<f32, L>, Self::Collider)> {
        None
    }

    /// Calls `face` with the outward normal of each flat face of a shape whose plane is within `near` \[m\] of a point.
    fn faces_at(
        _: &Self::Collider,
        _: &Self::Pose,
        _point: Vector<f32, L>,
        _near: f32,
        _face: &mut dyn FnMut(Vector<f32, L>),
    ) {
    }

    /// Reports each manifold of points at which two shapes overlap or are as near as contacts are looked for.
    /// Returns how far they are apart at least. \[m\] `before` is the feature of a point at which they
    /// touched a step ago: what is asked first.
    fn collide(
        a: (&Self::Collider, &Self::Pose),
        b: (&Self::Collider, &Self::Pose),
        ahead: impl Into<LookAhead<L>>,
        before: Option<u64>,
        scratch: &mut Self::Scratch,
        report: &mut dyn FnMut(&ContactManifold<L>),
    ) -> f32;
}

/// How far ahead contacts are looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LookAhead<const L: usize> {
    /// Shapes that are no farther apart touch. \[m\]
    pub prediction: f32,
    /// How a moves against b until contacts are searched again. \[m\]
    pub motion: Vector<f32, L>,
    /// How far their surfaces come by turning until then. \[m\]
    pub turning: f32,
}

impl<const L: usize> From<f32> for LookAhead<L> {
    /// Of shapes that hold still.
    fn from(prediction: f32) -> Self {
        Self { prediction, motion: Vector::ZERO, turning: 0.0 }
    }
}

/// How far shapes come from the center that they turn about.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reach {
    /// All of them. \[m\]
    pub all: f32,
    /// Without what is round about a core, as a ball is about its center: what a turn moves, since a ball that
    /// turns is where it was. \[m\]
    pub core: f32,
}

impl Reach {
    /// Of both.
    pub fn joined(&self, other: &Self) -> Self {
        Self { all: self.all.max(other.all), core: self.core.max(other.core) }
    }
}

/// A body that turns.
#[derive(Clone, Copy, Debug)]
pub struct Spin<'a, P, const A: usize> {
    /// Its pose.
    pub pose: P,
    /// I_0 and its inverse.
    pub moments: [&'a SymmetricMatrix<f32, A>; 2],
    /// How it precesses.
    pub precession: Precession,
    /// Angular velocity. \[rad/s\]
    pub omega: Vector<f32, A>,
    /// What rounding has left out of it. \[rad/s\]
    pub remainder: Vector<f32, A>,
}

/// How a body that turns freely changes its angular velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Precession {
    /// By how much of itself over the angle, at most: 0 for balls, 1 for all solids. \[1\]
    pub rate: f32,
    /// Its largest over its smallest moment of inertia, or more. \[1\]
    pub spread: f32,
}

impl Precession {
    /// It stays.
    pub const NONE: Self = Self { rate: 0.0, spread: 1.0 };
}

/// Bodies that [`Geometry::precess`] turns at once.
pub const TOGETHER: usize = 8;

/// Numbers that [`Geometry::write`] writes in `dimension` dimensions.
pub const fn pose_numbers(dimension: usize) -> usize {
    if dimension == 3 { 7 } else { 3 }
}

/// The first numbers, and 0 for those that are missing.
fn leading<const N: usize>(numbers: &[f32]) -> [f32; N] {
    std::array::from_fn(|i| numbers.get(i).copied().unwrap_or(0.0))
}

/// Where a pose is and how it is turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame<const L: usize> {
    /// \[m\]
    pub position: Vector<f32, L>,
    /// World directions of the local axes: the columns of R.
    pub axes: [Vector<f32, L>; L],
}

impl<const L: usize> Frame<L> {
    /// The frame that everything is seen from.
    pub const IDENTITY: Self = {
        let mut axes = [Vector([0.0; L]); L];
        let mut i = 0;
        while i < L {
            axes[i].0[i] = 1.0;
            i += 1;
        }
        Self { position: Vector([0.0; L]), axes }
    };

    /// R p + x.
    #[inline]
    pub fn point(&self, local: Vector<f32, L>) -> Vector<f32, L> {
        self.position + self.direction(local)
    }

    /// R d.
    #[inline]
    pub fn direction(&self, local: Vector<f32, L>) -> Vector<f32, L> {
        let mut world = Vector::ZERO;
        for i in 0..L {
            world += self.axes[i] * local[i];
        }
        world
    }

    /// R^T (p - x).
    #[inline]
    pub fn local_point(&self, world: Vector<f32, L>) -> Vector<f32, L> {
        self.local_direction(world - self.position)
    }

    /// R^T d.
    #[inline]
    pub fn local_direction(&self, world: Vector<f32, L>) -> Vector<f32, L> {
        Vector(std::array::from_fn(|i| self.axes[i].dot(world)))
    }

    /// The same frame, seen from another.
    pub fn seen_from(&self, other: &Self) -> Self {
        Self {
            position: other.local_point(self.position),
            axes: self.axes.map(|axis| other.local_direction(axis)),
        }
    }

    /// A rotation vector of the local frame in world axes (in 2D a number, in particles nothing).
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

    /// A tensor of the local frame in world axes: R D R^T (in 2D a number, in particles nothing).
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
    /// The box of nothing: it overlaps none, and adds nothing to what is around it.
    pub const EMPTY: Self =
        Self { min: Vector([f32::INFINITY; L]), max: Vector([f32::NEG_INFINITY; L]) };

    /// How far its farthest corner is from the origin. \[m\]
    pub fn reach(&self) -> f32 {
        let far = |i| self.max[i].max(-self.min[i]);
        Vector(std::array::from_fn::<f32, L, _>(far)).length()
    }

    /// Whether the boxes have a point in common.
    pub fn overlaps(&self, other: &Self) -> bool {
        (0..L).all(|i| self.min[i] <= other.max[i] && other.min[i] <= self.max[i])
    }

    /// The box around both.
    pub fn joined(&self, other: &Self) -> Self {
        Self {
            min: Vector(std::array::from_fn(|i| self.min[i].min(other.min[i]))),
            max: Vector(std::array::from_fn(|i| self.max[i].max(other.max[i]))),
        }
    }
}

/// Mass and its first two moments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassProperties<const L: usize, const A: usize> {
    /// \[kg\]
    pub mass: f32,
    /// Center of mass. \[m\]
    pub center: Vector<f32, L>,
    /// About the center of mass. \[kg m^2\]
    pub inertia: SymmetricMatrix<f32, A>,
}

impl<const L: usize, const A: usize> MassProperties<L, A> {
    /// Nothing.
    pub const ZERO: Self = Self { mass: 0.0, center: Vector::ZERO, inertia: SymmetricMatrix::ZERO };

    /// The same mass, given in a frame, in that frame's surroundings.
    pub fn placed(&self, frame: &Frame<L>) -> Self {
        Self {
            mass: self.mass,
            center: frame.point(self.center),
            inertia: frame.tensor(self.inertia),
        }
    }

    /// Both together (parallel axis theorem).
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

/// The most points of a manifold.
pub const MAX_POINTS: usize = 4;

/// Two shapes touching, or nearly: points that share a normal.
#[derive(Clone, Debug, Default)]
pub struct ContactManifold<const L: usize> {
    /// Which part of the shapes: the triangle of a mesh.
    pub part: u32,
    /// World unit normal, from b towards a.
    pub normal: Vector<f32, L>,
    /// What the surfaces are like where they touch.
    pub surfaces: Curvature,
    /// The points.
    pub points: Vec<ManifoldPoint<L>>,
}

/// How two surfaces are curved where they touch, and what their normal follows when bodies turn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Curvature {
    /// Radii of curvature of a and b; 0 for what is flat or sharp. \[m\]
    pub radii: [f32; 2],
    /// What the normal follows.
    pub normal: NormalCarrier,
}

/// What the normal of a contact follows when bodies turn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NormalCarrier {
    /// Both bodies alike: two edges cross.
    #[default]
    Edges,
    /// The face of a.
    FaceOfA,
    /// The face of b.
    FaceOfB,
    /// The line of the centers of curvature.
    Centers,
}

impl NormalCarrier {
    /// The parts of the rotations of a and b
    /// ([`Manifold::carries`](drystone_solver::Manifold::carries)). \[1\]
    pub(crate) fn shares(self) -> [f32; 2] {
        match self {
            Self::Edges => [0.5; 2],
            Self::FaceOfA => [1.0, 0.0],
            Self::FaceOfB => [0.0, 1.0],
            Self::Centers => [0.0; 2],
        }
    }

    /// The carrier with these parts.
    pub(crate) fn of(shares: [f32; 2]) -> Self {
        let all = [Self::FaceOfA, Self::FaceOfB, Self::Centers];
        all.into_iter().find(|carrier| carrier.shares() == shares).unwrap_or(Self::Edges)
    }

    /// Where bodies are pushed, of a point on the surface of each: on the one that moves with the points
    /// ([`drystone_solver::kinematics`]).
    pub(crate) fn place<const L: usize>(self, [on_a, on_b]: [Vector<f32, L>; 2]) -> Vector<f32, L> {
        match self {
            Self::FaceOfA => on_b,
            Self::FaceOfB | Self::Centers => on_a,
            Self::Edges => (on_a + on_b) * 0.5,
        }
    }

    /// The same with a and b exchanged.
    fn exchanged(self) -> Self {
        match self {
            Self::FaceOfA => Self::FaceOfB,
            Self::FaceOfB => Self::FaceOfA,
            same => same,
        }
    }
}

/// A point where two shapes touch.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ManifoldPoint<const L: usize> {
    /// On the surface of a, world. \[m\]
    pub on_a: Vector<f32, L>,
    /// On the surface of b, world. \[m\]
    pub on_b: Vector<f32, L>,
    /// Distance along the normal, negative when overlapping. \[m\]
    pub gap: f32,
    /// Names the features of both shapes that meet here; equal from step to step.
    pub feature: u64,
}

impl<const L: usize> ContactManifold<L> {
    /// From the coordinates of `frame` to those around it.
    fn place(&mut self, frame: &Frame<L>) {
        self.normal = frame.direction(self.normal);
        for point in &mut self.points {
            point.on_a = frame.point(point.on_a);
            point.on_b = frame.point(point.on_b);
        }
    }

    /// The same, of b and a.
    fn exchange(&mut self) {
        self.normal = -self.normal;
        let Curvature { radii: [a, b], normal } = self.surfaces;
        self.surfaces = Curvature { radii: [b, a], normal: normal.exchanged() };
        for point in &mut self.points {
            std::mem::swap(&mut point.on_a, &mut point.on_b);
        }
    }

    /// Keeps at most as many points as the dimension needs (2D: 2, 3D: 4): the deepest, then those
    /// that span the most area with it.
    ///
    /// Points that are equally deep to within `FLAT` do not count as the deepest. Then the choice
    /// depends on places alone, and a patch at rest keeps its points from step to step.
    pub fn reduce(&mut self) {
        let most = if L == 2 { 2 } else { MAX_POINTS };
        let points = &mut self.points;
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
        }
        points.truncate(most);
    }
}

/// Depths that differ by less than this part of a patch's extent count as equal. \[1\]
const FLAT: f32 = 1e-5;

/// Values that differ by less than this part count as equal when points are chosen. \[1\]
const ALIKE: f32 = 1e-3;

/// Points nearer than this part of a patch's extent are one: rounding has made two of it. A patch as
/// slender as one to a thousand keeps its width. \[1\]
const SAME: f32 = 1e-4;

/// Coordinates are known to this part of themselves. \[1\]
const ROUNDING: f32 = 3e-7;

fn squared<const L: usize>(v: Vector<f32, L>) -> f32 {
    v.dot(v)
}

/// (edge x arm) . normal: twice the area that a point adds to one side of an edge.
fn across<const L: usize>(edge: Vector<f32, L>, arm: Vector<f32, L>, n: Vector<f32, L>) -> f32 {
    let area: Vector<f32, L> = drystone_solver::moment(edge, arm);
    area.dot(n)
}

/// The point from `from` on with the largest value; the first of those that are [`ALIKE`].
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

/// Drops points that lie on an earlier, deeper one: two points in one place share its load
/// without holding anything.
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
