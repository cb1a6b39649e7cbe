use super::*;
use crate::geometry::hull::Hull;
use crate::geometry::random::Random;
use crate::geometry::solid::Cuboid;
use crate::geometry::{Geometry, Rigid3};

/// Returns the distance of a core from a surface or a line. It is convex along the core, and
/// parry's distance from a point is exact.
fn distance(core: &RoundedCore<3>, from: &dyn parry3d::shape::Shape) -> f32 {
    let at = |part: f32| from.distance_to_local_point(core.at(part).0.into(), false);
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let third = (high - low) / 3.0;
        if at(low + third) < at(high - third) {
            high -= third;
        } else {
            low += third;
        }
    }
    at(low).min(at(0.0)).min(at(1.0))
}

/// True if a point of a core is in a solid.
fn overlap(core: &RoundedCore<3>, solid: &impl Solid<3>) -> bool {
    (0..=100).any(|part| {
        let point = core.at(part as f32 / 100.0);
        (0..solid.faces()).all(|face| {
            let (normal, vertex) = solid.face(face);
            normal.dot(point - vertex) < 0.0
        })
    })
}

/// The deepest contact point is as deep as the shapes overlap: balls and capsules on all sides of
/// boxes, of hulls and of each other.
#[test]
fn the_deepest_point_is_as_deep_as_the_shapes_are() {
    const PREDICTION: f32 = 0.1;
    let mut random = Random(7);
    let mut clipper = Clipper::default();
    let (mut near, mut two, mut left) = (0, 0, 0);
    for turn in 0..9000 {
        let half = if turn % 2 == 0 { 0.0 } else { 0.3 };
        let ends = [Vector([0.0, -half, 0.0]), Vector([0.0, half, 0.0])];
        let turned = [random.number(), random.number(), random.number(), random.number()];
        let pose = Rigid3::pose(random.vector() * 0.9, &turned);
        let round = RoundedCore { ends, radius: 0.2 }.placed(&Rigid3::frame(&pose));
        let mut touch = ContactManifold::default();
        let (gap, apart, overlap) = match turn % 3 {
            0 => {
                let cuboid = Cuboid(Vector([0.4, 0.3, 0.5]));
                let surface = parry3d::shape::Cuboid::new(cuboid.0.0.into());
                let gap = on_solid(&round, &cuboid, PREDICTION, None, &mut clipper, &mut touch);
                (gap, distance(&round, &surface) - 0.2, overlap(&round, &cuboid))
            }
            1 => {
                let mut point = || parry3d::math::Vector::from((random.vector() * 0.5).0);
                let points: Vec<_> = (0..12).map(|_| point()).collect();
                let hull = Hull::of(&points).unwrap();
                let solid = parry3d::shape::ConvexPolyhedron::from_convex_hull(&points).unwrap();
                let (points, triangles) = solid.to_trimesh();
                let surface = parry3d::shape::TriMesh::new(points, triangles).unwrap();
                let gap = on_solid(&round, &hull, PREDICTION, None, &mut clipper, &mut touch);
                (gap, distance(&round, &surface) - 0.2, overlap(&round, &hull))
            }
            _ => {
                let ends = [Vector::ZERO, Vector([0.3, 0.1, 0.0])];
                let line = parry3d::shape::Segment::new(ends[0].0.into(), ends[1].0.into());
                let other = RoundedCore { ends, radius: 0.1 };
                let gap = between_rounds(&round, &other, PREDICTION, &mut touch);
                (Some(gap), distance(&round, &line) - 0.3, false)
            }
        };
        let Some(gap) = gap else {
            assert!(overlap, "{turn}: {round:?} is not in the solid");
            left += 1;
            continue;
        };
        assert!((touch.normal.length() - 1.0).abs() < 1e-5 || touch.points.is_empty());
        for point in &touch.points {
            let gap = touch.normal.dot(point.on_a - point.on_b);
            assert!((gap - point.gap).abs() < 1e-5, "{turn}: {gap} and {point:?}");
        }
        if overlap {
            continue;
        }
        // A feature that was not the nearest is not taken for the nearest.
        for number in 0..12 {
            let face = FaceOf { b: true, face: number % 6 }.feature(0);
            for before in [face, edges_feature([0, number])].map(Some) {
                let mut other = ContactManifold::default();
                let cuboid = Cuboid(Vector([0.4, 0.3, 0.5]));
                if turn % 3 == 0 {
                    on_solid(&round, &cuboid, PREDICTION, before, &mut clipper, &mut other);
                    let [own, other] = [&touch, &other].map(|touch| {
                        touch.points.iter().map(|point| point.gap).fold(PREDICTION, f32::min)
                    });
                    assert!(
                        (own - other).abs() < 1.1e-3,
                        "{turn}: {other} with {before:x?}, {own}"
                    );
                }
            }
        }
        // A direction between an edge and a face counts as over the face, up to a thousandth of the
        // distance.
        assert!(gap <= apart + 2e-4, "{turn}: {gap} apart, and {apart}");
        if apart > PREDICTION {
            assert!(touch.points.is_empty() || apart < PREDICTION + 2e-4, "{turn}: {touch:?}");
            continue;
        }
        near += 1;
        two += usize::from(touch.points.len() > 1);
        let deepest = touch.points.iter().map(|point| point.gap).fold(f32::INFINITY, f32::min);
        assert!((deepest - apart).abs() < 1.1e-3, "{turn}: {deepest}, not {apart}");
    }
    assert!(near > 1000 && two > 100 && left > 10, "{near} near, {two} with two points, {left}");
}
