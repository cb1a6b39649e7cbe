//! Rigid bodies in 2D and 3D. Shapes, bounding boxes and masses come from parry, as do the contact
//! manifolds of pairs that this crate does not handle itself.

use std::sync::Arc;

use drystone_solver::{SymmetricMatrix, Vector};
use parry2d::shape::ConvexPolygon;

use super::cylinders::{self, Cylinder};
use super::hull::{self, Hull};
use super::mesh::{self, Gathered, MeshTopology};
use super::particles::balls;
use super::polyhedra::{
    Clipper, Crossing, Plane, PlaneSupport, between, between_boxes, collide, on_plane,
};
use super::rotation::{Eight, Quaternion, each_eight, precess, precess_finely};
use super::rounds::{RoundedCore, between_rounds, on_solid};
use super::solid::{Cuboid, Solid};
use super::{
    Ball, Bounds, ContactManifold, Curvature, Frame, Geometry, LookAhead, ManifoldPoint,
    MassProperties, MeshPlace, NormalCarrier, PRECESS_LANES, Precession, Ray, Reach, Spin,
    SurfaceHit, leading,
};

/// Largest absolute coordinate and reach of a shape, which stands for infinity. \[m\]
const UNBOUNDED: f32 = 1.0e5;

/// A cylinder lies on its side if the cosine between its axis and the contact normal is less than
/// this. \[1\]
const LYING: f32 = 0.1;

/// Up to this many bodies turn faster one by one than eight side by side.
const ALONE: usize = 2;

/// Largest rotation per substep for a single step in single precision; larger ones are split into
/// parts. \[rad\]
const COARSE: f32 = 1.0 / 128.0;

/// Largest ratio of the moments of inertia for steps in single precision. \[1\] Above it, the
/// rounding of `f32` shows in the energy of a body. The error grows with the square root of the
/// ratio.
const COMPACT: f32 = 100.0;

/// Rigid bodies in 2D: (L, A) = (2, 1).
#[derive(Clone, Copy, Debug)]
pub struct Rigid2;

/// Rigid bodies in 3D: (L, A) = (3, 3).
#[derive(Clone, Copy, Debug)]
pub struct Rigid3;

/// Position and angle in 2D. The angle counts full turns; its sine and cosine are stored with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose2 {
    position: parry2d::math::Vector,
    angle: f32,
    rotation: parry2d::math::Rotation,
}

impl Pose2 {
    /// Returns the pose at this position \[m\], rotated counter-clockwise by `angle` \[rad\].
    pub fn new(position: impl Into<parry2d::math::Vector>, angle: f32) -> Self {
        let (sin, cos) = libm::sincosf(angle);
        Self {
            position: position.into(),
            angle,
            rotation: parry2d::math::Rotation::from_cos_sin_unchecked(cos, sin),
        }
    }

    /// Returns the position. \[m\]
    pub fn position(&self) -> parry2d::math::Vector {
        self.position
    }

    /// Returns the angle, full turns included. \[rad\]
    pub fn angle(&self) -> f32 {
        self.angle
    }
}

impl From<parry2d::math::Pose> for Pose2 {
    fn from(pose: parry2d::math::Pose) -> Self {
        Self::new(pose.translation, libm::atan2f(pose.rotation.im, pose.rotation.re))
    }
}

impl From<Pose2> for parry2d::math::Pose {
    fn from(pose: Pose2) -> Self {
        Self::from_parts(pose.position, pose.rotation)
    }
}

/// Implements the part of [`Geometry`] that is the same for parry2d and parry3d.
macro_rules! over_parry {
    (
        $parry:ident, $polyhedra:ident, $meshes:ident, $each:ident, $ask:ident, $on_other:ident,
        $near:ident, $hull:ident, $form:ident, $l:literal, $a:literal
    ) => {
        type Shape = $parry::shape::SharedShape;
        type Prepared = PreparedShape<Self::Shape, $hull, $l>;
        type Scratch = Scratch<$parry::query::ContactManifold<(), ()>, $parry::query::epa::EPA, $l>;

        fn bounds(shape: &Self::Shape, pose: &Self::Pose) -> Bounds<$l> {
            let aabb = shape.compute_aabb(&(*pose).into());
            let clamp = |v: $parry::math::Vector| {
                Vector(v.to_array().map(|x| x.clamp(-UNBOUNDED, UNBOUNDED)))
            };
            Bounds { min: clamp(aabb.mins), max: clamp(aabb.maxs) }
        }

        fn reach(shape: &Self::Shape, pose: &Self::Pose) -> Reach {
            use $parry::shape::TypedShape;
            let (sphere, bounds) =
                (shape.compute_bounding_sphere(&(*pose).into()), Self::bounds(shape, pose));
            // The sphere is the tighter bound for a ball at the origin, the box for a wall around
            // it.
            let all = (sphere.center.length() + sphere.radius).min(bounds.reach());
            let round = match shape.as_typed_shape() {
                TypedShape::Ball(ball) => ball.radius,
                TypedShape::Capsule(capsule) => capsule.radius,
                _ => 0.0,
            };
            Reach { all: all.min(UNBOUNDED), core: (all - round).clamp(0.0, UNBOUNDED) }
        }

        fn unsupported(shape: &Self::Shape) -> Option<&'static str> {
            use $parry::shape::TypedShape;
            match shape.as_typed_shape() {
                TypedShape::Ball(_) | TypedShape::HalfSpace(_) | TypedShape::TriMesh(_) => None,
                TypedShape::Compound(_) => Some("compound"),
                TypedShape::Voxels(_) => Some("voxel grid"),
                TypedShape::HeightField(_) => Some("height field"),
                TypedShape::Polyline(_) => Some("polyline"),
                _ if shape.as_polygonal_feature_map().is_some() => None,
                _ => Some("shape of another kind"),
            }
        }

        fn extent(shape: &Self::Shape) -> Option<f32> {
            if shape.as_halfspace().is_some() {
                return None;
            }
            let aabb = shape.compute_local_aabb();
            let sides = (aabb.maxs - aabb.mins).to_array();
            // A comparison would pass over NaN.
            let sum = sides.iter().sum::<f32>();
            Some(if sum.is_nan() { sum } else { sides.into_iter().fold(f32::MIN, f32::max) })
        }

        fn prepare(shape: Self::Shape) -> Self::Prepared {
            PreparedShape { form: $form(&shape), shape }
        }

        fn placeholder() -> Self::Prepared {
            Self::prepare($parry::shape::SharedShape::ball(0.0))
        }

        fn shape_of(collider: &Self::Prepared) -> &Self::Shape {
            &collider.shape
        }

        fn is_open(collider: &Self::Prepared) -> bool {
            matches!(collider.form, ContactShape::Mesh(_))
        }

        fn is_curved(collider: &Self::Prepared) -> bool {
            match collider.form {
                ContactShape::Ball(_) | ContactShape::Capsule(..) | ContactShape::Cylinder(_) => {
                    true
                }
                ContactShape::Cuboid(_)
                | ContactShape::Hull(_)
                | ContactShape::Halfspace(_)
                | ContactShape::Mesh(_) => false,
                ContactShape::Other => true,
            }
        }

        fn is_bounded(collider: &Self::Prepared) -> bool {
            !matches!(collider.form, ContactShape::Halfspace(_))
        }

        fn has_edges(collider: &Self::Prepared) -> bool {
            match collider.form {
                ContactShape::Cuboid(_)
                | ContactShape::Hull(_)
                | ContactShape::Cylinder(_)
                | ContactShape::Mesh(_)
                | ContactShape::Other => true,
                ContactShape::Ball(_) | ContactShape::Capsule(..) | ContactShape::Halfspace(_) => {
                    false
                }
            }
        }

        fn rounding_radius(
            collider: &Self::Prepared,
            pose: &Self::Pose,
            axis: Vector<f32, $l>,
        ) -> f32 {
            match collider.form {
                ContactShape::Ball(radius) | ContactShape::Capsule(_, radius) => radius,
                ContactShape::Cylinder(Cylinder { radius, .. }) => {
                    let up = <Self as Geometry<$l, $a>>::frame(pose).axes[1];
                    if up.dot(axis).abs() < LYING { radius } else { 0.0 }
                }
                _ => 0.0,
            }
        }

        fn support(
            collider: &Self::Prepared,
            pose: &Self::Pose,
            direction: Vector<f32, $l>,
            around: Ball<$l>,
        ) -> Option<Vector<f32, $l>> {
            let frame = <Self as Geometry<$l, $a>>::frame(pose);
            let local = frame.local_direction(direction);
            Some(frame.point(match &collider.form {
                ContactShape::Cuboid(solid) => solid.support(local),
                ContactShape::Hull(solid) => solid.support(local),
                ContactShape::Halfspace(_) => return None,
                ContactShape::Mesh(mesh) => {
                    let around = around.seen_from(&frame);
                    let near = $near(collider, around);
                    let top = mesh.top_within(near, Vector(leading(&local.0)), around.spatial())?;
                    Vector(leading(&top.0))
                }
                _ => {
                    let shape = collider.shape.as_support_map()?;
                    Vector(shape.local_support_point(local.0.into()).to_array())
                }
            }))
        }

        fn reaches(collider: &Self::Prepared, pose: &Self::Pose, ball: Ball<$l>) -> bool {
            let ball = ball.seen_from(&<Self as Geometry<$l, $a>>::frame(pose));
            match &collider.form {
                ContactShape::Cuboid(solid) => holds(solid, ball.center, ball.radius),
                ContactShape::Hull(solid) => holds(&**solid, ball.center, ball.radius),
                ContactShape::Mesh(mesh) => mesh.reaches($near(collider, ball), ball.spatial()),
                _ => false,
            }
        }

        fn inner_ball(collider: &Self::Prepared) -> Option<(Vector<f32, $l>, Self::Prepared)> {
            let (center, radius) = match &collider.form {
                ContactShape::Capsule([from, to], radius) => ((*from + *to) * 0.5, *radius),
                ContactShape::Cuboid(solid) => ball_within(solid),
                ContactShape::Hull(solid) => ball_within(&**solid),
                ContactShape::Cylinder(of) => (Vector::ZERO, of.radius.min(of.half_height)),
                ContactShape::Ball(_)
                | ContactShape::Halfspace(_)
                | ContactShape::Mesh(_)
                | ContactShape::Other => return None,
            };
            Some((center, Self::prepare($parry::shape::SharedShape::ball(radius))))
        }

        fn faces_at(
            collider: &Self::Prepared,
            pose: &Self::Pose,
            ball: Ball<$l>,
            face: &mut dyn FnMut(Vector<f32, $l>),
        ) {
            let frame = <Self as Geometry<$l, $a>>::frame(pose);
            let ball = ball.seen_from(&frame);
            let mut found = |normal| face(frame.direction(normal));
            match &collider.form {
                ContactShape::Cuboid(solid) => faces_at(solid, ball, &mut found),
                ContactShape::Hull(solid) => faces_at(&**solid, ball, &mut found),
                ContactShape::Mesh(mesh) => {
                    let found = |normal: Vector<f32, 3>| found(Vector(leading(&normal.0)));
                    mesh.normals_within($near(collider, ball), ball.spatial(), found);
                }
                _ => {}
            }
        }

        fn cast_ray(
            collider: &Self::Prepared,
            pose: &Self::Pose,
            ray: &Ray<$l>,
        ) -> Option<SurfaceHit<$l>> {
            let frame = <Self as Geometry<$l, $a>>::frame(pose);
            let ray = ray.seen_from(&frame);
            let hit = match &collider.form {
                ContactShape::Cuboid(solid) => ray.on_solid(solid),
                ContactShape::Hull(solid) => ray.on_solid(&**solid),
                ContactShape::Halfspace(normal) => ray.on_halfspace(*normal),
                form => match form.round() {
                    Some(round) => ray.on_capsule(round.ends, round.radius),
                    None => $on_other(collider, &ray),
                },
            };
            hit.map(|hit| SurfaceHit { normal: frame.direction(hit.normal), ..hit })
        }

        fn collide(
            a: (&Self::Prepared, &Self::Pose),
            b: (&Self::Prepared, &Self::Pose),
            ahead: impl Into<LookAhead<$l>>,
            before: Option<u64>,
            scratch: &mut Self::Scratch,
            report: &mut dyn FnMut(&ContactManifold<$l>),
        ) -> f32 {
            let ahead = ahead.into();
            let prediction = ahead.prediction;
            // Two balls skip the general path for round shapes below: they are most pairs in a heap
            // of balls.
            if let (ContactShape::Ball(radius_a), ContactShape::Ball(radius_b)) =
                (&a.0.form, &b.0.form)
            {
                let center = |pose| <Self as Geometry<$l, $a>>::frame(pose).position;
                let (centers, touch) = ([center(a.1), center(b.1)], &mut scratch.touch);
                return balls(centers, [*radius_a, *radius_b], prediction, touch, report);
            }
            let frames = [a.1, b.1].map(|pose| <Self as Geometry<$l, $a>>::frame(pose));
            if let Some(apart) = $meshes([a.0, b.0], &frames, (ahead, before), scratch, report) {
                return apart;
            }
            let query = Query { from_b: &frames[1].seen_from(&frames[0]), prediction, before };
            // Poses in parry's types, computed only if parry is needed.
            let poses = || [a.1, b.1].map(|pose| $parry::math::Pose::from(*pose));
            let posed = || {
                let [pose_a, pose_b] = poses();
                pose_a.inv_mul(&pose_b)
            };
            let Scratch { manifold, expansion, touch, clipper, .. } = scratch;
            let mut apart = f32::INFINITY;
            let all = $each([a.0, b.0], posed, prediction, |pieces, cones, part| {
                touch.points.clear();
                touch.part = part;
                let memory = (&mut *clipper, &mut *expansion);
                if let Some(gap) = $polyhedra(query, pieces, posed, memory, touch) {
                    apart = apart.min(gap);
                    touch.transform(&frames[0]);
                } else {
                    apart = apart.min(prediction);
                    touch.surfaces = Curvature::default();
                    $ask(pieces, cones, poses(), prediction, manifold, touch);
                }
                touch.report(report);
            });
            // Triangles outside the search box are farther apart than `prediction`.
            if all { apart } else { apart.min(prediction) }
        }
    };
}

/// A shape prepared for contact detection.
#[derive(Clone)]
pub struct PreparedShape<S, H, const L: usize> {
    shape: S,
    form: ContactShape<H, L>,
}

/// The form of a shape that contact detection distinguishes.
#[derive(Clone)]
enum ContactShape<H, const L: usize> {
    /// Its radius. \[m\]
    Ball(f32),
    /// The ends of its core segment, and its radius. \[m\]
    Capsule([Vector<f32, L>; 2], f32),
    Cuboid(Cuboid<L>),
    /// 3D only.
    Cylinder(Cylinder),
    /// Shared with checkpoints, and behind a pointer because it is the largest variant: colliders
    /// are read in random order.
    Hull(Arc<H>),
    /// Its outward normal.
    Halfspace(Vector<f32, L>),
    /// A triangle mesh, shared for the same reasons as hulls.
    Mesh(Arc<MeshTopology>),
    /// A shape that is left to parry.
    Other,
}

/// One side of a contact test: a shape, or one triangle of a mesh.
struct ConvexPart<'a, S: ?Sized, H, const L: usize> {
    shape: &'a S,
    form: &'a ContactShape<H, L>,
}

impl<S: ?Sized, H, const L: usize> Clone for ConvexPart<'_, S, H, L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<S: ?Sized, H, const L: usize> Copy for ConvexPart<'_, S, H, L> {}

type ConvexPart2<'a> = ConvexPart<'a, dyn parry2d::shape::Shape, ConvexPolygon, 2>;
type ConvexPart3<'a> = ConvexPart<'a, dyn parry3d::shape::Shape, Hull, 3>;

/// Scratch memory for the contact detection of one thread.
#[derive(Default)]
pub struct Scratch<M, E, const L: usize> {
    manifold: M,
    /// The polytope that EPA expands.
    expansion: E,
    touch: ContactManifold<L>,
    clipper: Clipper<L>,
    gathered: Gathered,
}

impl<H, const L: usize> ContactShape<H, L> {
    fn round(&self) -> Option<RoundedCore<L>> {
        match self {
            ContactShape::Ball(radius) => {
                Some(RoundedCore { ends: [Vector::ZERO; 2], radius: *radius })
            }
            ContactShape::Capsule(ends, radius) => {
                Some(RoundedCore { ends: *ends, radius: *radius })
            }
            _ => None,
        }
    }
}

/// Returns the center and the radius of a ball inside a solid. \[m\] The center is the mean of the
/// ends of all edges.
fn ball_within<const L: usize>(solid: &impl Solid<L>) -> (Vector<f32, L>, f32) {
    let mut sum = Vector::ZERO;
    for edge in 0..solid.edges() {
        let [from, to] = solid.edge(edge);
        sum += from + to;
    }
    let center = sum * (0.5 / solid.edges() as f32);
    let inside = |face| {
        let (normal, vertex) = solid.face(face);
        normal.dot(vertex - center)
    };
    (center, (0..solid.faces()).map(inside).fold(f32::INFINITY, f32::min))
}

/// True if a point is inside a solid, or outside by no more than `near`. \[m\]
fn holds<const L: usize>(solid: &impl Solid<L>, point: Vector<f32, L>, near: f32) -> bool {
    (0..solid.faces()).all(|face| {
        let (normal, vertex) = solid.face(face);
        normal.dot(point - vertex) <= near
    })
}

/// Calls `found` with the outward normal of each face whose plane meets a ball.
fn faces_at<const L: usize>(
    solid: &impl Solid<L>,
    ball: Ball<L>,
    found: &mut dyn FnMut(Vector<f32, L>),
) {
    for face in 0..solid.faces() {
        let (normal, vertex) = solid.face(face);
        if normal.dot(ball.center - vertex).abs() <= ball.radius {
            found(normal);
        }
    }
}

/// Finds the contact of a round shape or a half-space with another shape, in the frame of a.
///
/// Returns a lower bound of the gap. \[m\] Returns `None` for other pairs, and for a core that is
/// so deep in a solid that its nearest face is not certain.
fn round_or_plane<H: Solid<L>, const L: usize>(
    [a, b]: [&ContactShape<H, L>; 2],
    Query { from_b, prediction, before }: Query<'_, L>,
    clipper: &mut Clipper<L>,
    touch: &mut ContactManifold<L>,
) -> Option<f32> {
    match (a, b) {
        (ContactShape::Halfspace(_), ContactShape::Halfspace(_)) => return None,
        (_, ContactShape::Halfspace(normal)) => {
            let plane = Plane { point: from_b.position, normal: from_b.direction(*normal) };
            let plane_support = plane_support(a)?;
            let own = &Frame::IDENTITY;
            return Some(on_plane(&plane, &plane_support, own, true, prediction, clipper, touch));
        }
        (ContactShape::Halfspace(normal), _) => {
            let plane = Plane { point: Vector::ZERO, normal: *normal };
            let plane_support = plane_support(b)?;
            return Some(on_plane(
                &plane,
                &plane_support,
                from_b,
                false,
                prediction,
                clipper,
                touch,
            ));
        }
        _ => {}
    }
    let mut on = |round: &RoundedCore<L>, form: &ContactShape<H, L>| match form {
        ContactShape::Cuboid(solid) => on_solid(round, solid, prediction, before, clipper, touch),
        ContactShape::Hull(solid) => on_solid(round, &**solid, prediction, before, clipper, touch),
        _ => None,
    };
    match (a.round(), b.round()) {
        (Some(a), Some(b)) => Some(between_rounds(&a, &b.placed(from_b), prediction, touch)),
        (Some(round), None) => {
            let seen = round.placed(&Frame::IDENTITY.seen_from(from_b));
            let gap = on(&seen, b)?;
            touch.transform(from_b);
            Some(gap)
        }
        (None, Some(round)) => {
            let gap = on(&round.placed(from_b), a)?;
            touch.exchange();
            Some(gap)
        }
        (None, None) => None,
    }
}

/// Returns the part of a shape that can touch a plane, or `None` if [`on_plane`] does not handle
/// the shape.
fn plane_support<H, const L: usize>(form: &ContactShape<H, L>) -> Option<PlaneSupport<'_, H, L>> {
    Some(match form {
        ContactShape::Ball(radius) => PlaneSupport::RoundedCore(&[Vector::ZERO], *radius),
        ContactShape::Capsule(ends, radius) => PlaneSupport::RoundedCore(ends, *radius),
        ContactShape::Cuboid(cuboid) => PlaneSupport::Cuboid(cuboid),
        ContactShape::Hull(hull) => PlaneSupport::Hull(hull),
        ContactShape::Cylinder(_)
        | ContactShape::Halfspace(_)
        | ContactShape::Mesh(_)
        | ContactShape::Other => return None,
    })
}

/// Finds the contact of two shapes in 2D. Returns a lower bound of the gap \[m\], or `None` for
/// pairs that are left to parry.
fn polygons(
    query: Query<'_, 2>,
    [a, b]: [ConvexPart2<'_>; 2],
    _: impl Fn() -> parry2d::math::Pose,
    (clipper, _): (&mut Clipper<2>, &mut parry2d::query::epa::EPA),
    touch: &mut ContactManifold<2>,
) -> Option<f32> {
    use ContactShape::{Cuboid, Hull};
    Some(match (a.form, b.form) {
        (Cuboid(a), Cuboid(b)) => boxes([a, b], query, clipper, touch),
        (Cuboid(a), Hull(b)) => meet(a, &**b, query, || None, clipper, touch),
        (Hull(a), Cuboid(b)) => meet(&**a, b, query, || None, clipper, touch),
        (Hull(a), Hull(b)) => meet(&**a, &**b, query, || None, clipper, touch),
        (a, b) => return round_or_plane([a, b], query, clipper, touch),
    })
}

/// Finds contacts in 3D as [`polygons`] does in 2D. `posed` returns the pose of b in the frame of
/// a; parry uses it to propose an axis between solids.
fn solids(
    query: Query<'_, 3>,
    [a, b]: [ConvexPart3<'_>; 2],
    posed: impl Fn() -> parry3d::math::Pose,
    (clipper, expansion): (&mut Clipper<3>, &mut parry3d::query::epa::EPA),
    touch: &mut ContactManifold<3>,
) -> Option<f32> {
    use ContactShape::{Cuboid, Hull};
    let nearest = || closest(&posed(), a.shape, b.shape, query.prediction, expansion);
    Some(match (a.form, b.form) {
        (Cuboid(a), Cuboid(b)) => boxes([a, b], query, clipper, touch),
        (Cuboid(a), Hull(b)) => meet(a, &**b, query, nearest, clipper, touch),
        (Hull(a), Cuboid(b)) => meet(&**a, b, query, nearest, clipper, touch),
        (Hull(a), Hull(b)) => meet(&**a, &**b, query, nearest, clipper, touch),
        (ContactShape::Cylinder(cylinder), _) => {
            let own = cylinder.placed(&Frame::IDENTITY.seen_from(query.from_b));
            let gap = on_cylinder(&own, b.form, query, clipper, touch)?;
            touch.surfaces = cylinder_on(&own, b.form, touch.normal);
            touch.transform(query.from_b);
            gap
        }
        (_, ContactShape::Cylinder(cylinder)) => {
            let own = cylinder.placed(query.from_b);
            let gap = on_cylinder(&own, a.form, query, clipper, touch)?;
            touch.surfaces = cylinder_on(&own, a.form, touch.normal);
            touch.exchange();
            gap
        }
        (a, b) => return round_or_plane([a, b], query, clipper, touch),
    })
}

/// Finds the contact of a cylinder, as a, with a shape, as b, in the frame of the shape. Returns a
/// lower bound of the gap \[m\], or `None` if the shape is left to parry.
fn on_cylinder(
    cylinder: &cylinders::PosedCylinder,
    form: &ContactShape<Hull, 3>,
    Query { prediction, before, .. }: Query<'_, 3>,
    clipper: &mut Clipper<3>,
    touch: &mut ContactManifold<3>,
) -> Option<f32> {
    Some(match form {
        ContactShape::Ball(_) | ContactShape::Capsule(..) => {
            cylinders::on_round(cylinder, &form.round()?, prediction, touch)
        }
        ContactShape::Cuboid(solid) => {
            cylinders::on_solid(cylinder, solid, prediction, before, clipper, touch)
        }
        ContactShape::Hull(solid) => {
            cylinders::on_solid(cylinder, &**solid, prediction, before, clipper, touch)
        }
        ContactShape::Cylinder(other) => {
            let other = other.placed(&Frame::IDENTITY);
            cylinders::between(cylinder, &other, prediction, before, touch)
        }
        ContactShape::Halfspace(normal) => {
            let plane = Plane { point: Vector::ZERO, normal: *normal };
            cylinders::on_plane(cylinder, &plane, prediction, before, touch)
        }
        ContactShape::Mesh(_) | ContactShape::Other => return None,
    })
}

/// Returns the curvature of a cylinder, as a, and of a shape, as b, at a contact with this normal.
fn cylinder_on(
    cylinder: &cylinders::PosedCylinder,
    form: &ContactShape<Hull, 3>,
    normal: Vector<f32, 3>,
) -> Curvature {
    let radius = |of: &cylinders::PosedCylinder| of.rounding_radius(normal);
    let is = |other: Vector<f32, 3>| other.dot(normal) > SAME;
    let has =
        |solid: &dyn Fn(usize) -> Vector<f32, 3>, faces: usize| (0..faces).any(|f| is(solid(f)));
    let (other, face) = match form {
        ContactShape::Ball(radius) | ContactShape::Capsule(_, radius) => (*radius, false),
        ContactShape::Cylinder(other) => {
            let other = other.placed(&Frame::IDENTITY);
            (radius(&other), radius(&other) == 0.0 && other.is_on_cap(normal))
        }
        ContactShape::Cuboid(solid) => (0.0, has(&|face| solid.face(face).0, solid.faces())),
        ContactShape::Hull(solid) => (0.0, has(&|face| solid.face(face).0, solid.faces())),
        ContactShape::Halfspace(_) | ContactShape::Mesh(_) | ContactShape::Other => (0.0, true),
    };
    let own = radius(cylinder);
    let normal = if face {
        NormalCarrier::FaceOfB
    } else if cylinder.is_on_cap(normal) {
        NormalCarrier::FaceOfA
    } else if own + other > 0.0 {
        NormalCarrier::Centers
    } else {
        NormalCarrier::Edges
    };
    Curvature { radii: [own, other], normal }
}

/// Directions with a larger cosine between them count as equal. \[1\]
const SAME: f32 = 1.0 - 1e-6;

/// Returns `None`: in 2D, meshes are left to parry, triangle by triangle.
fn no_meshes<S>(
    _: [&PreparedShape<S, ConvexPolygon, 2>; 2],
    _: &[Frame<2>; 2],
    _: (LookAhead<2>, Option<u64>),
    _: &mut Scratch<impl Sized, impl Sized, 2>,
    _: &mut dyn FnMut(&ContactManifold<2>),
) -> Option<f32> {
    None
}

/// Finds the contact of a mesh with a shape. Returns a lower bound of the gap \[m\], or `None` for
/// other pairs. Two meshes never touch.
fn on_meshes(
    both: [&PreparedShape<parry3d::shape::SharedShape, Hull, 3>; 2],
    frames: &[Frame<3>; 2],
    (ahead, before): (LookAhead<3>, Option<u64>),
    scratch: &mut Scratch<impl Sized, impl Sized, 3>,
    report: &mut dyn FnMut(&ContactManifold<3>),
) -> Option<f32> {
    let forms = both.map(|of| &of.form);
    let (side, surface) = match forms {
        [ContactShape::Mesh(surface), _] => (0, surface),
        [_, ContactShape::Mesh(surface)] => (1, surface),
        _ => return None,
    };
    let tree = both[side].shape.as_trimesh()?.bvh();
    let (own, other) = (&frames[side], forms[1 - side]);
    let seen = &frames[1 - side].seen_from(own);
    let motion = own.local_direction(ahead.motion) * if side == 1 { 1.0 } else { -1.0 };
    let faced = before.and_then(mesh::Faced::of);
    let LookAhead { prediction, turning, .. } = ahead;
    let ahead = mesh::MeshQuery { surface, prediction, motion, turning, faced };
    let gathered = &mut scratch.gathered;
    let apart = match other {
        ContactShape::Cuboid(cuboid) => mesh::polyhedron(ahead, cuboid, seen, tree, gathered),
        ContactShape::Hull(hull) => mesh::polyhedron(ahead, &**hull, seen, tree, gathered),
        ContactShape::Ball(_) | ContactShape::Capsule(..) => {
            mesh::round(ahead, &other.round()?.placed(seen), tree, gathered)
        }
        ContactShape::Halfspace(normal) => {
            let plane = (seen.position, seen.direction(*normal));
            let touch = &mut scratch.touch;
            let apart = mesh::on_plane(surface, plane, ahead.prediction, touch);
            touch.transform(own);
            if side == 1 {
                touch.exchange();
            }
            touch.report(report);
            return Some(apart);
        }
        ContactShape::Cylinder(cylinder) => {
            mesh::cylinder(ahead, cylinder.placed(seen), before, tree, gathered)
        }
        ContactShape::Mesh(_) => return Some(ahead.prediction),
        ContactShape::Other => return None,
    };
    gathered.report(own, side == 0, report);
    Some(apart)
}

/// A contact query for two shapes: the frame of b as seen from a, the prediction distance \[m\],
/// and the feature of a contact point of the step before.
#[derive(Clone, Copy)]
struct Query<'a, const L: usize> {
    from_b: &'a Frame<L>,
    prediction: f32,
    before: Option<u64>,
}

/// Finds the contact of two boxes. Returns the gap. \[m\]
fn boxes<const L: usize>(
    [a, b]: [&Cuboid<L>; 2],
    Query { from_b, prediction, .. }: Query<'_, L>,
    clipper: &mut Clipper<L>,
    touch: &mut ContactManifold<L>,
) -> f32 {
    let separation = between_boxes(a, b, from_b, prediction);
    collide(a, b, from_b, prediction, separation, clipper, touch)
}

/// Finds the contact of two solids, not both of them boxes. Returns the gap. \[m\] `crossing`
/// proposes an axis across two edges.
fn meet<const L: usize>(
    a: &impl Solid<L>,
    b: &impl Solid<L>,
    Query { from_b, prediction, before }: Query<'_, L>,
    crossing: impl FnOnce() -> Option<Crossing<L>>,
    clipper: &mut Clipper<L>,
    touch: &mut ContactManifold<L>,
) -> f32 {
    let separation = between(a, b, from_b, prediction, before, crossing);
    collide(a, b, from_b, prediction, separation, clipper, touch)
}

/// A support map scaled by a factor.
struct Enlarged<'a> {
    shape: &'a dyn parry3d::shape::SupportMap,
    factor: f32,
}

impl parry3d::shape::SupportMap for Enlarged<'_> {
    fn local_support_point(&self, direction: parry3d::math::Vector) -> parry3d::math::Vector {
        self.shape.local_support_point(direction) * self.factor
    }
}

/// Returns the power of two that scales a length \[m\] to about 1. Such a scale is free of
/// rounding.
fn to_unit(length: f32) -> f32 {
    let exponent = (length.to_bits() >> 23 & 0xff).clamp(64, 190);
    f32::from_bits((254 - exponent) << 23)
}

/// Finds the nearest points of two solids by GJK, or those of the least overlap by EPA. Close to
/// touching, their axis may be wrong, so the caller measures the gap along it. The tolerances of
/// both algorithms are lengths, so both shapes are scaled to a size of about 1.
fn closest(
    from_b: &parry3d::math::Pose,
    a: &dyn parry3d::shape::Shape,
    b: &dyn parry3d::shape::Shape,
    prediction: f32,
    expansion: &mut parry3d::query::epa::EPA,
) -> Option<Crossing<3>> {
    use parry3d::query::gjk::{CsoPoint, GJKResult, VoronoiSimplex, closest_points};
    let (a, b) = (a.as_support_map()?, b.as_support_map()?);
    // Largest extent of each shape along an axis; the smaller shape sets the scale.
    let sizes = [a, b].map(|shape| {
        use parry3d::math::Vector as Vec3;
        [Vec3::X, Vec3::Y, Vec3::Z]
            .map(|axis| {
                (shape.local_support_point(axis) - shape.local_support_point(-axis)).dot(axis)
            })
            .into_iter()
            .fold(0.0, f32::max)
    });
    let factor = to_unit(sizes[0].min(sizes[1]));
    let [a, b] = [a, b].map(|shape| Enlarged { shape, factor });
    let from_b = &parry3d::math::Pose { translation: from_b.translation * factor, ..*from_b };
    let start = from_b.translation.try_normalize().unwrap_or(parry3d::math::Vector::X);
    let mut simplex = VoronoiSimplex::new();
    simplex.reset(CsoPoint::from_shapes(from_b, &a, &b, start));
    let most = prediction * factor;
    let found = match closest_points(from_b, &a, &b, most, true, &mut simplex) {
        GJKResult::ClosestPoints(on_a, on_b, axis) => (on_a, on_b, axis),
        GJKResult::NoIntersection(axis) => {
            use parry3d::shape::SupportMap;
            let back = from_b.rotation.inverse() * -axis;
            (a.local_support_point(axis), from_b * b.local_support_point(back), axis)
        }
        GJKResult::Intersection => expansion.closest_points(from_b, &a, &b, &simplex)?,
        GJKResult::Proximity(_) => return None,
    };
    let (on_a, on_b, axis) = found;
    let [on_a, on_b] = [on_a, on_b].map(|v| Vector((v * (1.0 / factor)).to_array()));
    Some(Crossing { axis: Vector(axis.to_array()), on_a, on_b, feature: 0 })
}

/// Defines the loop over the convex pieces of two shapes, the call to parry for a pair of pieces,
/// and the call to parry for a ray.
macro_rules! pieces {
    (
        $each:ident, $ask:ident, $cast:ident, $near:ident, $piece:ident, $parry:ident, $hull:ident, $l:literal
    ) => {
        /// Calls `pair` with the convex pieces of two shapes that may be within `prediction` \[m\].
        /// Pieces are the shapes themselves, or each triangle of a mesh that is near the other
        /// shape, with its admissible normals and its number. Returns true if all pieces were
        /// visited.
        fn $each(
            both: [&PreparedShape<$parry::shape::SharedShape, $hull, $l>; 2],
            posed: impl Fn() -> $parry::math::Pose,
            prediction: f32,
            mut pair: impl FnMut(
                [$piece<'_>; 2],
                [Option<&dyn $parry::query::details::NormalConstraints>; 2],
                u32,
            ),
        ) -> bool {
            use $parry::bounding_volume::BoundingVolume;
            let whole = both.map(|of| ConvexPart { shape: &*of.shape.0, form: &of.form });
            let is_mesh = |side: &usize| {
                matches!(both[*side].form, ContactShape::Mesh(_) | ContactShape::Other)
            };
            let mesh = |side: usize| Some((side, both[side].shape.as_trimesh()?));
            let Some((side, mesh)) = [0, 1].into_iter().filter(is_mesh).find_map(mesh) else {
                pair(whole, [None, None], 0);
                return true;
            };
            let other = if side == 0 { posed() } else { posed().inverse() };
            let near = both[1 - side].shape.compute_aabb(&other).loosened(prediction);
            for index in mesh.bvh().intersect_aabb(&near) {
                let (triangle, cone) =
                    (mesh.triangle(index), mesh.triangle_normal_constraints(index));
                let (mut pieces, mut cones) = (whole, [None, None]);
                pieces[side] = ConvexPart { shape: &triangle, form: &ContactShape::Other };
                cones[side] =
                    cone.as_ref().map(|of| of as &dyn $parry::query::details::NormalConstraints);
                pair(pieces, cones, index);
            }
            false
        }

        /// Fills `touch` with the manifold that parry finds between two pieces with these poses.
        fn $ask(
            [a, b]: [$piece<'_>; 2],
            cones: [Option<&dyn $parry::query::details::NormalConstraints>; 2],
            [pose_a, pose_b]: [$parry::math::Pose; 2],
            prediction: f32,
            manifold: &mut $parry::query::ContactManifold<(), ()>,
            touch: &mut ContactManifold<$l>,
        ) {
            use $parry::query::{DefaultQueryDispatcher, PersistentQueryDispatcher};
            manifold.points.clear();
            manifold.local_n1 = $parry::math::Vector::ZERO;
            manifold.local_n2 = $parry::math::Vector::ZERO;
            let posed = pose_a.inv_mul(&pose_b);
            let [cone_a, cone_b] = cones;
            // The only error is an unsupported pair: a half-space against a half-space.
            let _ = DefaultQueryDispatcher.contact_manifold_convex_convex(
                &posed, a.shape, b.shape, cone_a, cone_b, prediction, manifold,
            );
            // parry's normal points from its first shape to its second; ours from b to a.
            let normal = -(pose_a.rotation * manifold.local_n1);
            touch.normal = normal.to_array().into();
            for point in manifold.points.iter().filter(|point| point.dist <= prediction) {
                let on_b = pose_b * point.local_p2;
                touch.points.push(ManifoldPoint {
                    on_a: (on_b + normal * point.dist).to_array().into(),
                    on_b: on_b.to_array().into(),
                    gap: point.dist,
                    feature: u64::from(point.fid1.0) << 32 | u64::from(point.fid2.0),
                });
            }
            touch.reduce();
        }

        /// Returns the triangles of a mesh that are near a ball, in the frame of the mesh.
        fn $near(
            collider: &PreparedShape<$parry::shape::SharedShape, $hull, $l>,
            ball: Ball<$l>,
        ) -> impl Iterator<Item = u32> + '_ {
            let reach = Vector([ball.radius; $l]);
            let corners = [ball.center - reach, ball.center + reach].map(|corner| corner.0.into());
            let bounds = $parry::bounding_volume::Aabb::new(corners[0], corners[1]);
            let query = $parry::partitioning::BvhNode::leaf(bounds, 0);
            let mesh = collider.shape.as_trimesh().into_iter();
            mesh.flat_map(move |mesh| mesh.bvh().leaves(move |node| node.intersects(&query)))
        }

        /// Returns where parry finds that a ray enters a shape, in the frame of the shape.
        fn $cast(
            collider: &PreparedShape<$parry::shape::SharedShape, $hull, $l>,
            ray: &Ray<$l>,
        ) -> Option<SurfaceHit<$l>> {
            let cast = $parry::query::Ray::new(ray.origin.0.into(), ray.direction.0.into());
            let most = ray.length.min(f32::MAX);
            let hit = collider.shape.cast_local_ray_and_get_normal(&cast, most, true)?;
            let normal = Vector::<f32, $l>(hit.normal.to_array());
            // The normal is zero inside, and may be that of the back of a triangle.
            let faces = normal.dot(ray.direction);
            if hit.time_of_impact == 0.0 || faces == 0.0 {
                return Some(SurfaceHit { distance: hit.time_of_impact, ..ray.start() });
            }
            let normal = normal * (-faces.signum() / normal.length());
            Some(SurfaceHit { distance: hit.time_of_impact, normal })
        }
    };
}

pieces!(
    each_piece_2,
    ask_parry_2,
    cast_parry_2,
    triangles_near_2,
    ConvexPart2,
    parry2d,
    ConvexPolygon,
    2
);
pieces!(each_piece_3, ask_parry_3, cast_parry_3, triangles_near_3, ConvexPart3, parry3d, Hull, 3);

/// Returns where a ray enters a cylinder or a shape that is left to parry, in the frame of the
/// shape.
fn cast_cylinder_or_parry(
    collider: &PreparedShape<parry3d::shape::SharedShape, Hull, 3>,
    ray: &Ray<3>,
) -> Option<SurfaceHit<3>> {
    match &collider.form {
        ContactShape::Cylinder(Cylinder { radius, half_height }) => {
            let top = Vector([0.0, *half_height, 0.0]);
            ray.on_tube([-top, top], *radius)
        }
        _ => cast_parry_3(collider, ray),
    }
}

/// Defines the conversion of a parry shape to its `ContactShape`.
macro_rules! form {
    ($name:ident, $parry:ident, $hull:ident, $l:literal, $($hulls:pat => $found:expr),+) => {
        fn $name(shape: &$parry::shape::SharedShape) -> ContactShape<$hull, $l> {
            use $parry::shape::TypedShape;
            match shape.as_typed_shape() {
                TypedShape::Ball(ball) => ContactShape::Ball(ball.radius),
                TypedShape::Capsule(capsule) => {
                    let ends = [capsule.segment.a, capsule.segment.b];
                    ContactShape::Capsule(ends.map(|end| Vector(end.to_array())), capsule.radius)
                }
                TypedShape::Cuboid(cuboid) => {
                    ContactShape::Cuboid(Cuboid(cuboid.half_extents.to_array().into()))
                }
                TypedShape::HalfSpace(plane) => ContactShape::Halfspace(plane.normal.to_array().into()),
                $($hulls => $found,)+
                _ => ContactShape::Other,
            }
        }
    };
}

form!(form_2, parry2d, ConvexPolygon, 2,
    TypedShape::ConvexPolygon(polygon) => ContactShape::Hull(Arc::new(polygon.clone())));
form!(form_3, parry3d, Hull, 3,
    TypedShape::ConvexPolyhedron(hull) => Hull::of(hull.points()).map_or(ContactShape::Other, |hull| ContactShape::Hull(Arc::new(hull))),
    TypedShape::Cylinder(of) =>
        ContactShape::Cylinder(Cylinder { radius: of.radius, half_height: of.half_height }),
    TypedShape::TriMesh(mesh) => ContactShape::Mesh(Arc::new(MeshTopology::of(mesh))));

impl Geometry<2, 1> for Rigid2 {
    type Pose = Pose2;

    fn pose(position: Vector<f32, 2>, rotation: &[f32]) -> Pose2 {
        let angle = rotation.first().copied().unwrap_or(0.0);
        Pose2::new(position.0, angle)
    }

    fn frame(pose: &Pose2) -> Frame<2> {
        let (c, s) = (pose.rotation.cos(), pose.rotation.sin());
        Frame {
            position: Vector(pose.position.to_array()),
            axes: [Vector([c, s]), Vector([-s, c])],
        }
    }

    fn advance(pose: &Pose2, by: Vector<f32, 2>, turn: Vector<f32, 1>) -> Pose2 {
        let position = pose.position + parry2d::math::Vector::from(by.0);
        if turn[0] == 0.0 {
            return Pose2 { position, ..*pose };
        }
        Pose2::new(position, pose.angle + turn[0])
    }

    fn rotation(pose: &Pose2) -> [f64; 4] {
        let half = 0.5 * f64::from(pose.angle);
        [0.0, 0.0, libm::sin(half), libm::cos(half)]
    }

    fn turn_between(from: &Pose2, to: &Pose2) -> Vector<f32, 1> {
        Vector([to.angle - from.angle])
    }

    fn compose(pose: &Pose2, local: &Pose2) -> Pose2 {
        Pose2 {
            position: pose.position + pose.rotation * local.position,
            angle: pose.angle + local.angle,
            rotation: pose.rotation * local.rotation,
        }
    }

    fn write(pose: &Pose2, out: &mut Vec<f32>) {
        out.extend([pose.position.x, pose.position.y, pose.angle]);
    }

    fn read(numbers: &[f32]) -> Pose2 {
        let [x, y, angle] = leading(numbers);
        Pose2::new([x, y], angle)
    }

    fn mass(shape: &Self::Shape, density: f32) -> MassProperties<2, 1> {
        if shape.as_trimesh().is_some() {
            return MassProperties::ZERO;
        }
        let of = shape.mass_properties(density);
        MassProperties {
            mass: of.mass(),
            center: Vector(of.local_com.to_array()),
            inertia: SymmetricMatrix([Vector([of.principal_inertia()])]),
        }
    }

    over_parry!(
        parry2d,
        polygons,
        no_meshes,
        each_piece_2,
        ask_parry_2,
        cast_parry_2,
        triangles_near_2,
        ConvexPolygon,
        form_2,
        2,
        1
    );
}

impl Geometry<3, 3> for Rigid3 {
    type Pose = parry3d::math::Pose;

    fn pose(position: Vector<f32, 3>, rotation: &[f32]) -> Self::Pose {
        let rotation = match rotation {
            &[x, y, z, w] => parry3d::math::Rotation::from_xyzw(x, y, z, w).normalize(),
            _ => parry3d::math::Rotation::IDENTITY,
        };
        parry3d::math::Pose::from_parts(position.0.into(), rotation)
    }

    fn frame(pose: &Self::Pose) -> Frame<3> {
        let axes = parry3d::math::Matrix::from_quat(pose.rotation);
        Frame {
            position: Vector(pose.translation.to_array()),
            // Column by column: a temporary array is not always optimized away.
            axes: [
                Vector(axes.x_axis.to_array()),
                Vector(axes.y_axis.to_array()),
                Vector(axes.z_axis.to_array()),
            ],
        }
    }

    fn advance(pose: &Self::Pose, by: Vector<f32, 3>, turn: Vector<f32, 3>) -> Self::Pose {
        let translation = pose.translation + parry3d::math::Vector::from(by.0);
        if turn == Vector::ZERO {
            return parry3d::math::Pose { translation, ..*pose };
        }
        let rotation = (rotation(Quaternion::versor(turn)) * pose.rotation).normalize();
        parry3d::math::Pose { translation, rotation, ..*pose }
    }

    #[inline]
    fn precess(
        spins: &[Spin<'_, Self::Pose, 3>; PRECESS_LANES],
        count: usize,
        h: f32,
        mut end: impl FnMut(usize, Self::Pose, [Vector<f32, 3>; 2]),
    ) {
        let posed = |index: usize, to: Quaternion<f32>| parry3d::math::Pose {
            rotation: rotation(to),
            ..spins[index].pose
        };
        let mut turn = |index: usize, to: Quaternion<f32>, change| {
            let Spin { omega, remainder, .. } = spins[index];
            end(index, posed(index, to), [omega + change, remainder]);
        };
        let (mut own, mut coarse) = ([0; PRECESS_LANES], 0);
        for (index, spin) in spins[..count].iter().enumerate() {
            if is_coarse(spin, h) {
                own[coarse] = index;
                coarse += 1;
            }
        }
        if coarse <= ALONE {
            for &index in &own[..coarse] {
                let Spin { pose, moments, omega, .. } = &spins[index];
                let (to, change) = precess(quaternion(pose), moments.map(|of| *of), *omega, h);
                turn(index, to, change);
            }
        } else {
            let matrix = |which: usize| {
                let row =
                    |i: usize| Eight::vector(each_eight!(lane => spins[lane].moments[which].0[i]));
                SymmetricMatrix([row(0), row(1), row(2)])
            };
            let moments = [matrix(0), matrix(1)];
            let each = each_eight!(lane => quaternion(&spins[lane].pose));
            let axis = Eight::vector(each_eight!(lane => each[lane].axis));
            let q = Quaternion { axis, w: Eight::new(each_eight!(lane => each[lane].w)) };
            let omega = Eight::vector(each_eight!(lane => spins[lane].omega));
            let (to, changes) = precess(q, moments, omega, Eight::new([h; PRECESS_LANES]));
            for &lane in &own[..coarse] {
                let own = Quaternion { axis: Eight::of_lane(&to.axis, lane), w: to.w.get(lane) };
                turn(lane, own, Eight::of_lane(&changes, lane));
            }
        }
        if coarse < count {
            for (index, spin) in spins[..count].iter().enumerate() {
                if !is_coarse(spin, h) {
                    let Spin { pose, moments: [moments, _], omega, remainder, precession } = spin;
                    let (q, omega) = (quaternion(pose), [*omega, *remainder]);
                    let (to, omega) = precess_finely(q, moments, omega, precession.rate, h);
                    end(index, posed(index, to), omega);
                }
            }
        }
    }

    fn rotation(pose: &Self::Pose) -> [f64; 4] {
        pose.rotation.to_array().map(f64::from)
    }

    fn turn_between(from: &Self::Pose, to: &Self::Pose) -> Vector<f32, 3> {
        let turn = to.rotation * from.rotation.inverse();
        let [x, y, z, w] = turn.to_array();
        // q and -q are one rotation; this takes the smaller angle.
        let sign = if w < 0.0 { -1.0 } else { 1.0 };
        let sine = Vector([x, y, z]) * sign;
        let length = sine.length();
        let scale = if length > 1e-6 { 2.0 * libm::atan2f(length, w * sign) / length } else { 2.0 };
        sine * scale
    }

    fn compose(pose: &Self::Pose, local: &Self::Pose) -> Self::Pose {
        *pose * *local
    }

    fn write(pose: &Self::Pose, out: &mut Vec<f32>) {
        out.extend(pose.translation.to_array());
        out.extend(pose.rotation.to_array());
    }

    fn read(numbers: &[f32]) -> Self::Pose {
        let [x, y, z, a, b, c, w] = leading(numbers);
        let rotation = parry3d::math::Rotation::from_xyzw(a, b, c, w);
        parry3d::math::Pose::from_parts([x, y, z].into(), rotation)
    }

    fn mass(shape: &Self::Shape, density: f32) -> MassProperties<3, 3> {
        if shape.as_trimesh().is_some() {
            return MassProperties::ZERO;
        }
        if let Some(polyhedron) = shape.as_convex_polyhedron() {
            return hull::mass(polyhedron.points(), density);
        }
        let of = shape.mass_properties(density);
        let inertia = of.reconstruct_inertia_matrix().to_cols_array_2d();
        MassProperties {
            mass: of.mass(),
            center: Vector(of.local_com.to_array()),
            inertia: SymmetricMatrix(inertia.map(Vector)),
        }
    }

    fn vertices(shape: &Self::Shape) -> Option<Vec<Vector<f32, 3>>> {
        let mesh = shape.as_trimesh()?;
        Some(mesh.vertices().iter().map(|vertex| Vector(vertex.to_array())).collect())
    }

    fn with_vertices(shape: &Self::Shape, vertices: &[Vector<f32, 3>]) -> Option<Self::Shape> {
        let mesh = shape.as_trimesh().filter(|mesh| mesh.vertices().len() == vertices.len())?;
        let mut moved = mesh.clone();
        // The tree is refit, and keeps its order: it depends on these vertices alone.
        moved.update_vertices(|own| {
            own.iter_mut().zip(vertices).for_each(|(own, new)| *own = new.0.into());
        });
        Some(parry3d::shape::SharedShape::new(moved))
    }

    fn flat_triangle(shape: &Self::Shape, vertices: &[Vector<f32, 3>]) -> Option<usize> {
        let mut triangles = shape.as_trimesh()?.indices().iter();
        triangles.position(|corners| {
            let [a, b, c] = corners.map(|corner| {
                vertices.get(corner as usize).map_or(Vector::ZERO, |vertex| vertex.cast::<f64>())
            });
            let across: Vector<f64, 3> = drystone_solver::moment(b - a, c - a);
            across.dot(across) <= 0.0
        })
    }

    fn nearest_on_mesh(shape: &Self::Shape, point: Vector<f32, 3>) -> Option<MeshPlace> {
        use parry3d::shape::CompositeShapeRef;
        let mesh = shape.as_trimesh()?;
        let found = CompositeShapeRef(mesh).project_local_point_and_get_location(
            point.0.into(),
            f32::MAX,
            false,
        );
        let (triangle, _, location) = found?;
        let corners = *mesh.indices().get(triangle as usize)?;
        Some(MeshPlace { corners, weights: location.barycentric_coordinates()? })
    }

    over_parry!(
        parry3d,
        solids,
        on_meshes,
        each_piece_3,
        ask_parry_3,
        cast_cylinder_or_parry,
        triangles_near_3,
        Hull,
        form_3,
        3,
        3
    );
}

/// True if a body turns so little in `h` \[s\], and is so compact, that one step in single
/// precision is exact enough.
#[inline(always)]
fn is_coarse<P>(spin: &Spin<'_, P, 3>, h: f32) -> bool {
    let Precession { rate, spread } = spin.precession;
    let angle = spin.omega * (rate * h);
    angle.dot(angle) <= COARSE * COARSE && spread <= COMPACT
}

fn quaternion(pose: &parry3d::math::Pose) -> Quaternion<f32> {
    let [x, y, z, w] = pose.rotation.to_array();
    Quaternion { axis: Vector([x, y, z]), w }
}

fn rotation(of: Quaternion<f32>) -> parry3d::math::Rotation {
    let [x, y, z] = of.axis.0;
    parry3d::math::Rotation::from_xyzw(x, y, z, of.w)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::Random;

    /// All points of a shape stay within `Reach::all` of the origin. A rotation by theta moves no
    /// side of its bounding box by more than `Reach::core` times theta; a ball at the origin does
    /// not move.
    #[test]
    fn reach_bounds_rotating_shapes() {
        let mut random = Random(11);
        let corners: Vec<_> = (0..9).map(|_| random.vector().0.into()).collect();
        let shapes = [
            parry3d::shape::SharedShape::ball(0.7),
            parry3d::shape::SharedShape::capsule_y(0.6, 0.3),
            parry3d::shape::SharedShape::cuboid(0.2, 0.5, 0.9),
            parry3d::shape::SharedShape::convex_hull(&corners).unwrap(),
        ];
        for at in 0..400 {
            let shape = &shapes[at % shapes.len()];
            let place = random.vector() * if at < 40 { 0.0 } else { 1.0 };
            let pose =
                Rigid3::advance(&Rigid3::pose(place, &[]), Vector::ZERO, random.vector() * 3.0);
            let turn = random.vector() * 0.5;
            let center = Rigid3::pose(Vector::ZERO, &[]);
            let turned = Rigid3::compose(&Rigid3::advance(&center, Vector::ZERO, turn), &pose);
            let Reach { all, core } = Rigid3::reach(shape, &pose);
            let [before, after] = [pose, turned].map(|pose| Rigid3::bounds(shape, &pose));
            for i in 0..3 {
                assert!(-before.min[i] <= all + 1e-5 && before.max[i] <= all + 1e-5, "{at}: {all}");
                for [before, after] in [[before.min, after.min], [before.max, after.max]] {
                    let came = (after[i] - before[i]).abs();
                    assert!(came <= core * turn.length() + 1e-5, "{at}: {came} by {core}");
                }
            }
        }
        let ball = Rigid3::reach(&shapes[0], &Rigid3::pose(Vector::ZERO, &[]));
        assert_eq!(ball, Reach { all: 0.7, core: 0.0 });
    }

    /// Returns the pose at which a shape that comes from far away is `apart` \[m\] from another one.
    fn approach(
        shapes: [&parry3d::shape::SharedShape; 2],
        [from, to]: [&parry3d::math::Pose; 2],
        way: Vector<f32, 3>,
        apart: f32,
    ) -> parry3d::math::Pose {
        let mut at = 4.0;
        let pose = |at: f32| Rigid3::advance(to, way * at, Vector::ZERO);
        for _ in 0..60 {
            let now = parry3d::query::distance(from, &**shapes[0], &pose(at), &**shapes[1]);
            at -= now.unwrap().distance - apart;
        }
        pose(at)
    }

    /// The points of a contact are on both shapes, and near each other, also where the shapes pass
    /// each other beside a face. Round shapes have tolerances close to upright normals.
    #[test]
    fn contact_points_are_on_both_shapes() {
        use parry3d::shape::SharedShape;
        const PREDICTION: f32 = 0.02;
        let mut random = Random(17);
        let corners: Vec<_> = (0..12).map(|_| random.vector().0.into()).collect();
        let shapes = [
            SharedShape::cuboid(0.2, 0.5, 0.9),
            SharedShape::cuboid(0.6, 0.6, 0.6),
            SharedShape::convex_hull(&corners).unwrap(),
            SharedShape::cylinder(0.5, 0.4),
            SharedShape::ball(0.7),
            SharedShape::capsule_y(0.6, 0.3),
        ];
        let mut scratch = Default::default();
        for (a, b) in (0..36).map(|pair| (pair / 6, pair % 6)) {
            let [most, farthest] =
                if a.max(b) < 3 { [0.2, 1.5] } else { [1.2, 3.0] }.map(|of: f32| of * PREDICTION);
            let pair = [&shapes[a], &shapes[b]];
            for turn in 0..400 {
                let tilt = [0.0, 1e-4, 1e-2, 3.0][turn % 4];
                let mut turned = || {
                    let center = Rigid3::pose(Vector::ZERO, &[]);
                    Rigid3::advance(&center, Vector::ZERO, random.vector() * tilt)
                };
                let (from, to) = (turned(), turned());
                let way = random.vector();
                let way = way * (1.0 / way.length());
                let apart = 0.5 * PREDICTION * (1.0 + random.number());
                let poses = [from, approach(pair, [&from, &to], way, apart)];
                let [one, other] = pair.map(|shape| Rigid3::prepare(shape.clone()));
                let mut found = |touch: &ContactManifold<3>| {
                    for point in &touch.points {
                        let across = (point.on_a - point.on_b).length();
                        assert!(across < farthest, "{a} and {b}, tilted by {tilt}: {across} m");
                    }
                    for (side, at) in touch.points.iter().flat_map(|p| [(0, p.on_a), (1, p.on_b)]) {
                        let off = pair[side].distance_to_point(&poses[side], at.0.into(), true);
                        assert!(off < most, "{a} and {b}, tilted by {tilt}: {off} m off");
                    }
                };
                let (one, other) = ((&one, &poses[0]), (&other, &poses[1]));
                Rigid3::collide(one, other, PREDICTION, None, &mut scratch, &mut found);
            }
        }
    }
}
