use super::*;
use crate::geometry::solid::Cuboid;

/// Points on a sphere, spread evenly (a spiral).
fn on_sphere(count: usize, radius: f32) -> Vec<Vector<f32, 3>> {
    let turn = std::f32::consts::PI * (3.0 - 5.0f32.sqrt());
    (0..count)
        .map(|i| {
            let height = 1.0 - 2.0 * (i as f32 + 0.5) / count as f32;
            let (across, angle) = ((1.0 - height * height).sqrt(), turn * i as f32);
            Vector([across * angle.cos(), height, across * angle.sin()]) * radius
        })
        .collect()
}

fn hull(points: &[Vector<f32, 3>]) -> Hull {
    let points: Vec<_> = points.iter().map(|p| parry3d::math::Vector::from(p.0)).collect();
    Hull::of(&points).unwrap()
}

/// Its faces close a surface, and no point of it is outside of one or off the plane of its own.
fn check(hull: &Hull, size: f32) {
    let mut total = Vector::ZERO;
    let mut whole = 0.0;
    for face in 0..hull.faces() {
        let (normal, plane) = hull.face(face);
        let mut corners = Vec::new();
        hull.corners(face, &mut corners);
        let corners: Vec<_> = corners.iter().map(|corner| corner.position).collect();
        assert!((normal.length() - 1.0).abs() < 1e-6);
        for point in &hull.points {
            assert!(normal.dot(*point - plane) < 1e-6 * size, "face {face}: {point:?} is outside");
        }
        for corner in &corners {
            let behind = normal.dot(plane - *corner);
            assert!(behind < 3.0 * FLAT * size, "face {face}: a corner is {behind} m behind it");
        }
        total += area(&corners);
        whole += area(&corners).length();
    }
    assert!(total.length() < 1e-4 * whole, "{total:?} of {whole}");
}

#[test]
fn faces_are_flat_and_close_a_surface() {
    for count in [4, 5, 14, 60, 400, 3000] {
        check(&hull(&on_sphere(count, 0.5)), 1.0);
        let flattened: Vec<_> =
            on_sphere(count, 0.5).iter().map(|p| Vector([p[0], 0.01 * p[1], 3.0 * p[2]])).collect();
        check(&hull(&flattened), 3.0);
    }
}

/// Parry joins what turns by up to 1.5 degrees, so a fine sphere would become a few crooked faces.
#[test]
fn a_fine_surface_keeps_its_curvature() {
    let hull = hull(&on_sphere(3000, 0.5));
    let normals = (0..hull.faces()).map(|face| hull.face(face));
    let off = normals.map(|(normal, point)| (normal.dot(point) - 0.5).abs()).fold(0.0, f32::max);
    assert!(off < 1e-3, "{off}");
}

#[test]
fn a_box_has_six_faces_of_four_corners_also_after_rounding() {
    let axis = Vector([0.6, 0.0, 0.8]);
    for noise in [0.0, 2e-5] {
        let corners: Vec<_> = (0..8)
            .map(|i| {
                let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
                let across: Vector<f32, 3> = moment(axis, Vector([0.0, 1.0, 0.0]));
                let off = noise * (sign(0) * sign(1) + sign(2));
                axis * (sign(0) * 0.7)
                    + across * (sign(1) * 0.2)
                    + Vector([0.0, sign(2) * 0.4 + off, 0.0])
            })
            .collect();
        let hull = hull(&corners);
        assert_eq!(hull.faces(), 6, "noise {noise}");
        for face in 0..6 {
            let mut corners = Vec::new();
            hull.corners(face, &mut corners);
            assert_eq!(corners.len(), 4, "noise {noise}");
        }
        check(&hull, 1.4);
    }
}

/// Edges have both ends on the faces that they are around, which are two.
#[test]
fn each_edge_is_around_two_faces() {
    fn check(solid: &impl Solid<3>) {
        let mut faces = vec![0; solid.edges()];
        for face in 0..solid.faces() {
            let mut corners = Vec::new();
            solid.corners(face, &mut corners);
            let on_face = |end| corners.iter().any(|corner| corner.position == end);
            assert_eq!(solid.around(face).count(), corners.len());
            for edge in solid.around(face) {
                assert!(solid.edge(edge).into_iter().all(on_face), "face {face}, edge {edge}");
                faces[edge] += 1;
            }
        }
        assert!(faces.iter().all(|&faces| faces == 2), "{faces:?}");
    }
    check(&Cuboid(Vector([0.4, 0.3, 0.5])));
    for count in [4, 14, 60] {
        check(&hull(&on_sphere(count, 0.5)));
    }
}

#[test]
fn the_farthest_point_is_that_of_a_plain_search() {
    let points = on_sphere(101, 1.0);
    let hull = hull(&points);
    for direction in on_sphere(500, 1.0) {
        let most = hull.points.iter().map(|p| p.dot(direction)).fold(f32::NEG_INFINITY, f32::max);
        assert_eq!(hull.support(direction).dot(direction), most);
    }
}

/// A box far off, and the tetrahedron of the unit vectors, whose moments are 1/60 - m (1/4)^2 twice.
#[test]
fn mass_is_that_of_the_solid() {
    let solid = |corners: &[[f32; 3]]| {
        let points: Vec<_> = corners.iter().map(|&p| parry3d::math::Vector::from(p)).collect();
        let (points, triangles) = parry3d::transformation::try_convex_hull(&points).unwrap();
        mass(&points, &triangles, 2.0)
    };
    let near = |x: f32, expected: f32| assert!((x - expected).abs() < 1e-5, "{x}, not {expected}");
    let half = [0.7, 0.2, 0.4];
    let corner = |i: usize| {
        std::array::from_fn(|axis| 3.0 + half[axis] * if i >> axis & 1 == 1 { 1.0 } else { -1.0 })
    };
    let of = solid(&(0..8).map(corner).collect::<Vec<_>>());
    near(of.mass, 2.0 * 8.0 * 0.7 * 0.2 * 0.4);
    for i in 0..3 {
        near(of.center[i], 3.0);
        for j in 0..3 {
            let [p, q] = [half[(i + 1) % 3], half[(i + 2) % 3]];
            near(of.inertia.0[i][j], if i == j { of.mass / 3.0 * (p * p + q * q) } else { 0.0 });
        }
    }
    let of = solid(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    near(of.mass, 2.0 / 6.0);
    for i in 0..3 {
        near(of.center[i], 0.25);
        for j in 0..3 {
            // Integrals of x^2 and of x y over it: 1/60 and 1/120.
            let [square, product] = [1.0 / 60.0 - 1.0 / 96.0, 1.0 / 120.0 - 1.0 / 96.0];
            near(of.inertia.0[i][j], 2.0 * if i == j { 2.0 * square } else { -product });
        }
    }
}
