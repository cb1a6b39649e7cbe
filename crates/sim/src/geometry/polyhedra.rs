//! Contact between boxes and hulls: the axis along which they overlap least, faces before edges.
//!
//! Where two faces lie on each other, every axis near their normal is as good to within rounding,
//! and an axis that changes from step to step shakes what rests there. So an edge must win by
//! more than [`PREFERENCE`], and so must b's face against a's. Faces are tested exactly; the axis of
//! two edges comes from parry, and counts only for what it really separates.

/// By how much an axis must win, as part of the prediction distance.
const PREFERENCE: f32 = 0.01;

/// The same code over parry2d and parry3d: `$faces` lists the faces of a hull, `$edges` proposes an
/// axis that is no face's normal.
macro_rules! polyhedra {
    ($module:ident, $parry:ident, $hull:ident, $as_hull:ident, $faces:ident, $edges:ident) => {
        pub(super) mod $module {
            use $parry::math::{Pose, Vector};
            use $parry::query::ContactManifold;
            use $parry::shape::{Cuboid, PolygonalFeature, PolygonalFeatureMap, Shape, $hull};

            /// A solid with flat faces.
            #[derive(Clone, Copy)]
            pub(in super::super) enum Polyhedron<'a> {
                Box(&'a Cuboid),
                Hull(&'a $hull),
            }

            impl<'a> Polyhedron<'a> {
                fn of(shape: &'a dyn Shape) -> Option<Self> {
                    let hull = || shape.$as_hull().map(Self::Hull);
                    shape.as_cuboid().map(Self::Box).or_else(hull)
                }

                /// The farthest vertex along `direction`.
                pub(super) fn support(self, direction: Vector) -> Vector {
                    match self {
                        Self::Box(cuboid) => cuboid.half_extents.copysign(direction),
                        Self::Hull(hull) => {
                            let points = hull.points();
                            let mut best = (f32::NEG_INFINITY, 0);
                            for (i, point) in points.iter().enumerate() {
                                let along = point.dot(direction);
                                if along > best.0 {
                                    best = (along, i);
                                }
                            }
                            points[best.1]
                        }
                    }
                }

                fn features(&self) -> &dyn PolygonalFeatureMap {
                    match *self {
                        Self::Box(cuboid) => cuboid,
                        Self::Hull(hull) => hull,
                    }
                }

                /// The face that the other is farthest outside of (or least inside): distance and
                /// normal. `other` gives the other's farthest point along a direction.
                fn best_face(self, other: impl Fn(Vector) -> Vector) -> (f32, Vector) {
                    let mut best = (f32::NEG_INFINITY, Vector::ZERO);
                    let mut face = |normal: Vector, vertex: Vector| {
                        let separation = normal.dot(other(-normal) - vertex);
                        if separation > best.0 {
                            best = (separation, normal);
                        }
                    };
                    match self {
                        Self::Box(cuboid) => {
                            for axis in Vector::AXES {
                                let vertex = axis * cuboid.half_extents;
                                face(axis, vertex);
                                face(-axis, -vertex);
                            }
                        }
                        Self::Hull(hull) => super::$faces(hull, &mut face),
                    }
                    best
                }
            }

            /// Fills `manifold` if both shapes are boxes or hulls; returns whether they are.
            pub(in super::super) fn collide(
                from_b: &Pose,
                shape_a: &dyn Shape,
                shape_b: &dyn Shape,
                prediction: f32,
                manifold: &mut ContactManifold<(), ()>,
            ) -> bool {
                let (Some(a), Some(b)) = (Polyhedron::of(shape_a), Polyhedron::of(shape_b)) else {
                    return false;
                };
                let from_a = from_b.inverse();
                let of_a = a.best_face(|d| from_b * b.support(from_a.rotation * d));
                if of_a.0 > prediction {
                    return true;
                }
                let of_b = b.best_face(|d| from_a * a.support(from_b.rotation * d));
                if of_b.0 > prediction {
                    return true;
                }
                let margin = super::PREFERENCE * prediction;
                let mut best = of_a;
                if of_b.0 > of_a.0 + margin {
                    best = (of_b.0, from_b.rotation * -of_b.1);
                }
                let mut witness = None;
                if let Some((axis, points)) = super::$edges(from_b, a, b, prediction) {
                    let gap =
                        axis.dot(from_b * b.support(from_a.rotation * -axis) - a.support(axis));
                    if gap > prediction {
                        return true;
                    }
                    if gap > best.0 + margin {
                        best = (gap, axis);
                        witness = points;
                    }
                }
                let (n_a, n_b) = (best.1, from_a.rotation * -best.1);
                let mut feature_a = PolygonalFeature::default();
                let mut feature_b = PolygonalFeature::default();
                a.features().local_support_feature(n_a, &mut feature_a);
                b.features().local_support_feature(n_b, &mut feature_b);
                PolygonalFeature::contacts(
                    from_b, &from_a, n_a, n_b, &feature_a, &feature_b, manifold, false,
                );
                if let Some((on_a, on_b)) = witness {
                    let feature = $parry::shape::PackedFeatureId::UNKNOWN;
                    manifold.points.push($parry::query::TrackedContact::new(
                        on_a,
                        from_a * on_b,
                        feature,
                        feature,
                        n_a.dot(on_b - on_a),
                    ));
                }
                manifold.local_n1 = n_a;
                manifold.local_n2 = n_b;
                true
            }
        }
    };
}

polyhedra!(plane, parry2d, ConvexPolygon, as_convex_polygon, sides, no_edges);
polyhedra!(space, parry3d, ConvexPolyhedron, as_convex_polyhedron, faces, edges);

fn sides(
    hull: &parry2d::shape::ConvexPolygon,
    face: &mut dyn FnMut(parry2d::math::Vector, parry2d::math::Vector),
) {
    for (normal, vertex) in hull.normals().iter().zip(hull.points()) {
        face(*normal, *vertex);
    }
}

fn faces(
    hull: &parry3d::shape::ConvexPolyhedron,
    face: &mut dyn FnMut(parry3d::math::Vector, parry3d::math::Vector),
) {
    for side in hull.faces() {
        let vertex = hull.vertices_adj_to_face()[side.first_vertex_or_edge as usize];
        face(side.normal, hull.points()[vertex as usize]);
    }
}

/// An axis and, where they are known, the closest points on a and b, all in the frame of a.
type Axis<V> = Option<(V, Option<(V, V)>)>;

/// In the plane, faces are all the axes there are.
fn no_edges(
    _from_b: &parry2d::math::Pose,
    _a: plane::Polyhedron<'_>,
    _b: plane::Polyhedron<'_>,
    _prediction: f32,
) -> Axis<parry2d::math::Vector> {
    None
}

fn edges(
    from_b: &parry3d::math::Pose,
    a: space::Polyhedron<'_>,
    b: space::Polyhedron<'_>,
    prediction: f32,
) -> Axis<parry3d::math::Vector> {
    use parry3d::query::details::contact_support_map_support_map_with_params;
    use parry3d::query::gjk::{GJKResult, VoronoiSimplex};
    use parry3d::query::sat::cuboid_cuboid_find_local_separating_edge_twoway;
    use space::Polyhedron::{Box, Hull};

    let closest = |a: &dyn parry3d::shape::SupportMap, b: &dyn parry3d::shape::SupportMap| {
        let simplex = &mut VoronoiSimplex::new();
        match contact_support_map_support_map_with_params(from_b, a, b, prediction, simplex, None) {
            GJKResult::ClosestPoints(on_a, on_b, axis) => Some((axis, Some((on_a, on_b)))),
            GJKResult::NoIntersection(axis) => Some((axis, None)),
            _ => None,
        }
    };
    match (a, b) {
        (Box(a), Box(b)) => {
            let (_, axis) = cuboid_cuboid_find_local_separating_edge_twoway(a, b, from_b);
            (axis != parry3d::math::Vector::ZERO).then_some((axis, None))
        }
        (Box(a), Hull(b)) => closest(a, b),
        (Hull(a), Box(b)) => closest(a, b),
        (Hull(a), Hull(b)) => closest(a, b),
    }
}
