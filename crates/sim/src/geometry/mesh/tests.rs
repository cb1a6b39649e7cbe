use parry3d::query;
use parry3d::shape::{SharedShape, TriMesh};

use drystone_solver::Vector;

use super::*;
use crate::geometry::random::Random;
use crate::geometry::{Geometry, Rigid3};

/// Returns a hilly sheet, and a closed lump.
fn meshes(random: &mut Random) -> [SharedShape; 2] {
    let (n, mut vertices, mut triangles) = (8u32, Vec::new(), Vec::new());
    for i in 0..=n {
        for j in 0..=n {
            let at = |k: u32| k as f32 * 0.25 - 1.0;
            vertices.push([at(i), 0.15 * random.number(), at(j)].into());
        }
    }
    for i in 0..n {
        for j in 0..n {
            let a = i * (n + 1) + j;
            triangles.extend([[a, a + 1, a + n + 1], [a + 1, a + n + 2, a + n + 1]]);
        }
    }
    let sheet = TriMesh::new(vertices, triangles).unwrap();
    let (vertices, triangles) = parry3d::shape::Ball::new(0.5).to_trimesh(9, 7);
    let bulge =
        |location: &parry3d::math::Vector| *location * (1.0 + 0.2 * libm::sinf(7.0 * location.x));
    let lump = TriMesh::new(vertices.iter().map(bulge).collect(), triangles).unwrap();
    [sheet, lump].map(SharedShape::new)
}

fn shapes(random: &mut Random) -> Vec<SharedShape> {
    let corners: Vec<_> = (0..20).map(|_| (random.vector() * 0.2).0.into()).collect();
    vec![
        SharedShape::ball(0.15),
        SharedShape::capsule_y(0.15, 0.08),
        SharedShape::cuboid(0.2, 0.1, 0.15),
        SharedShape::convex_hull(&corners).unwrap(),
        SharedShape::cylinder(0.15, 0.1),
        SharedShape::cylinder(0.02, 0.2),
    ]
}

/// Returns the distance of a mesh from a round shape along y, by points of its core: these are
/// exact, unlike the iterations for whole shapes. \[m\]
fn from_core(
    (half, radius): (f32, f32),
    own: &<Rigid3 as Geometry<3, 3>>::Pose,
    mesh: &SharedShape,
    other: &<Rigid3 as Geometry<3, 3>>::Pose,
) -> f32 {
    let parts = if half > 0.0 { 400 } else { 0 };
    let locations = (0..=parts).map(|k| half * (2.0 * k as f32 / parts.max(1) as f32 - 1.0));
    let distances = locations.map(|y| {
        mesh.distance_to_point(other, own * parry3d::math::Vector::new(0.0, y, 0.0), false)
    });
    distances.fold(f32::INFINITY, f32::min) - radius
}

/// The reported gap is never more than the distance. For balls and capsules that do not touch it is
/// exact, along the direction of the nearest points. Both orders of the shapes agree.
#[test]
fn gaps_are_those_of_the_nearest_points() {
    let mut random = Random(7);
    let (meshes, shapes) = (meshes(&mut random), shapes(&mut random));
    let mut memory = <Rigid3 as Geometry<3, 3>>::Scratch::default();
    let (kinds, mut found) = (shapes.len(), [0; 6]);
    for round in 0..1500 * kinds {
        let (kind, mesh) = (round % kinds, &meshes[round / kinds % 2]);
        let location = |random: &mut Random, far: f32| {
            let location = Rigid3::pose(random.vector() * far, &[]);
            Rigid3::advance(&location, Vector::ZERO, random.vector() * 3.0)
        };
        let (own, other) = (location(&mut random, 0.9), location(&mut random, 0.1));
        let (a, b) = (&shapes[kind], mesh);
        let distance = query::distance(&own, &*a.0, &other, &*b.0).unwrap().distance;
        let sides = [a, b].map(|shape| Rigid3::prepare(shape.clone()));
        let prediction = 0.1;
        let mut touches = [Vec::new(), Vec::new()];
        let apart = [0, 1].map(|order| {
            let mut pair = [(&sides[0], &own), (&sides[1], &other)];
            pair.rotate_left(order);
            let mut report = |touch: &ContactManifold<3>| touches[order].push(touch.clone());
            Rigid3::collide(pair[0], pair[1], prediction, None, &mut memory, &mut report)
        });
        let [touches, turned] = touches;
        assert_eq!(touches.len(), turned.len());
        assert!((apart[0] - apart[1]).abs() < 1e-5, "{apart:?}");
        for (touch, other) in touches.iter().zip(&turned) {
            assert!((touch.normal + other.normal).length() < 1e-5);
        }
        if distance <= 0.0 {
            continue;
        }
        assert!(apart[0] <= distance + 1e-4, "{round}: {} of {distance}", apart[0]);
        let points = touches.iter().flat_map(|touch| &touch.points);
        let least = points.map(|point| point.gap).fold(f32::INFINITY, f32::min);
        // Inside the lump, its surface is not the nearest feature.
        let inside =
            round / kinds % 2 == 1 && (own.translation - other.translation).length() < 0.65;
        if kind < 2 && !inside && distance < prediction {
            let distance = from_core([(0.0, 0.15), (0.15, 0.08)][kind], &own, mesh, &other);
            assert!((least - distance).abs() < 2e-3 * prediction, "{round}: {least} of {distance}");
            found[kind] += 1;
        }
        for touch in &touches {
            for point in &touch.points {
                let along = touch.normal.dot(point.on_a - point.on_b);
                assert!((along - point.gap).abs() < 1e-4, "{along} and {}", point.gap);
            }
        }
    }
    assert!(found[0] > 100 && found[1] > 100, "{found:?}");
}

/// On a plane of many triangles, a shape has the same contact as on a plane of two, at any
/// position.
#[test]
fn planes_are_one_facet() {
    let plane = |n: u32| {
        let at = |k: u32| 2.0 * k as f32 / n as f32 - 1.0;
        let vertices = (0..=n).flat_map(|i| (0..=n).map(move |j| [at(i), 0.0, at(j)].into()));
        let cell = |i: u32, j: u32| {
            let a = i * (n + 1) + j;
            [[a, a + 1, a + n + 1], [a + 1, a + n + 2, a + n + 1]]
        };
        let triangles = (0..n).flat_map(|i| (0..n).flat_map(move |j| cell(i, j)));
        SharedShape::new(TriMesh::new(vertices.collect(), triangles.collect()).unwrap())
    };
    let mut random = Random(3);
    let (shapes, planes) = (shapes(&mut random), [1, 2, 13].map(plane));
    let mut memory = <Rigid3 as Geometry<3, 3>>::Scratch::default();
    let planes = planes.map(Rigid3::prepare);
    let ground = Rigid3::pose(Vector::ZERO, &[]);
    for round in 0..100 * shapes.len() {
        let shape = Rigid3::prepare(shapes[round % shapes.len()].clone());
        let mut location = random.vector() * 0.4;
        location[1] *= 0.2;
        let pose = Rigid3::pose(location, &[]);
        let pose = Rigid3::advance(&pose, Vector::ZERO, random.vector() * 3.0);
        let [one, two, many] = planes.each_ref().map(|plane| {
            let mut touches = Vec::new();
            let mut report = |touch: &ContactManifold<3>| touches.push(touch.clone());
            Rigid3::collide(
                (&shape, &pose),
                (plane, &ground),
                0.05,
                None,
                &mut memory,
                &mut report,
            );
            touches
        });
        for other in [two, many] {
            assert_eq!(one.len(), other.len());
            for (one, other) in one.iter().zip(&other) {
                assert_eq!(one.normal, other.normal);
                assert_eq!(one.points.len(), other.points.len());
                for point in &one.points {
                    let near = |other: &ManifoldPoint<3>| {
                        (other.on_a - point.on_a).length() < 1e-5
                            && (other.gap - point.gap).abs() < 1e-5
                    };
                    assert!(other.points.iter().any(near), "{point:?} not in {other:?}");
                }
            }
        }
    }
}
