use super::*;
use crate::geometry::random::Random;
use crate::geometry::solid::Cuboid;

/// Returns points on a sphere, spread evenly along a spiral.
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

/// Checks that the faces close a surface, and that no point is outside a face or off the plane of
/// its own.
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

/// parry joins triangles at angles of up to 1.5 degrees, so a fine sphere would become a few
/// crooked faces.
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

/// Both ends of an edge are on the faces around which it runs, of which there are two.
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
fn the_support_point_is_that_of_a_linear_search() {
    let points = on_sphere(101, 1.0);
    let hull = hull(&points);
    for direction in on_sphere(500, 1.0) {
        let most = hull.points.iter().map(|p| p.dot(direction)).fold(f32::NEG_INFINITY, f32::max);
        assert_eq!(hull.support(direction).dot(direction), most);
    }
}

/// A box far from the origin, and the tetrahedron of the unit vectors. Its moments of inertia are
/// twice 1/60 - m (1/4)^2.
#[test]
fn mass_is_that_of_the_solid() {
    let solid = |corners: &[[f32; 3]]| {
        let points: Vec<_> = corners.iter().map(|&p| parry3d::math::Vector::from(p)).collect();
        mass(&points, 2.0)
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
            // Integrals of x^2 and of x y over the tetrahedron: 1/60 and 1/120.
            let [square, product] = [1.0 / 60.0 - 1.0 / 96.0, 1.0 / 120.0 - 1.0 / 96.0];
            near(of.inertia.0[i][j], 2.0 * if i == j { 2.0 * square } else { -product });
        }
    }
}

/// Returns the volume, the first moments, and the trace of the second moments about the first
/// point. They are sums over the tetrahedra on all triples of points that have no point above them.
/// Returns `None` if four points are coplanar there.
fn by_all_triples(points: &[Vector<f32, 3>]) -> Option<[f64; 5]> {
    let at = |i: usize| Vector(points[i].0.map(f64::from));
    let place = |i: usize| {
        let [x, y, z] = points[i].0;
        robust::Coord3D { x, y, z }
    };
    let mut sums = [0.0; 5];
    let count = points.len();
    for i in 0..count {
        for j in i + 1..count {
            for k in j + 1..count {
                let side = |p: usize| robust::orient3d(place(i), place(j), place(k), place(p));
                let others = || (0..count).filter(|p| ![i, j, k].contains(p)).map(side);
                let [below, above] = [others().all(|x| x > 0.0), others().all(|x| x < 0.0)];
                if !(below || above) {
                    if others().all(|x| x >= 0.0) || others().all(|x| x <= 0.0) {
                        return None;
                    }
                    continue;
                }
                let sign = if below { 1.0 } else { -1.0 };
                let [a, b, c] = [i, j, k].map(|p| at(p) - at(0));
                let area: Vector<f64, 3> = moment(b, c);
                let (own, sum) = (sign * a.dot(area) / 6.0, a + b + c);
                sums[0] += own;
                (0..3).for_each(|axis| sums[1 + axis] += own * sum[axis] / 4.0);
                let squares = a.dot(a) + b.dot(b) + c.dot(c) + sum.dot(sum);
                sums[4] += own / 20.0 * squares;
            }
        }
    }
    Some(sums)
}

/// Hulls of random points have the exact mass to one part in a million, also if points lie nearly
/// in planes, on edges, or on a ball.
#[test]
fn hulls_have_their_exact_mass() {
    let (mut random, mut checked) = (Random(4), 0);
    for round in 0..400 {
        let size = [1e-3, 0.05, 1.0, 30.0][round % 4];
        let near = [0.0, 1e-6, 1e-4, 1e-2][round / 4 % 4];
        let points: Vec<Vector<f32, 3>> = (0..14)
            .map(|i| {
                let mut point = random.vector();
                match round % 3 {
                    0 => point = point * (1.0 / point.length()),
                    1 => point[i % 3] = if point[i % 3] > 0.0 { 1.0 } else { -1.0 },
                    _ => {}
                }
                (point + random.vector() * near + Vector([0.3, 0.2, 0.1])) * size
            })
            .collect();
        let Some(exact) = by_all_triples(&points) else { continue };
        checked += 1;
        let parry: Vec<_> = points.iter().map(|p| parry3d::math::Vector::from(p.0)).collect();
        let found = mass(&parry, 1.0);
        let off = (f64::from(found.mass) / exact[0] - 1.0).abs();
        assert!(off < 1e-6, "{round}: {off} of the mass");
        let mut squared = 0.0;
        for axis in 0..3 {
            let arm = exact[1 + axis] / exact[0];
            squared += arm * arm;
            let expected = arm + f64::from(points[0][axis]);
            let off = (f64::from(found.center[axis]) - expected).abs() / f64::from(size);
            assert!(off < 1e-6, "{round}: {off} of the center");
        }
        let trace: f32 = (0..3).map(|axis| found.inertia.0[axis][axis]).sum();
        let expected = 2.0 * (exact[4] - exact[0] * squared);
        let off = (f64::from(trace) / expected - 1.0).abs();
        assert!(off < 1e-6, "{round}: {off} of the inertia");
    }
    assert!(checked > 300, "{checked}");
}

/// Points on the edges and faces of a box, and inside it, add nothing.
#[test]
fn a_grid_of_points_is_a_box() {
    let at = |i: u32| i as f32 * 0.25 - 0.5;
    let points: Vec<_> = (0..125)
        .map(|i| parry3d::math::Vector::from([at(i % 5), at(i / 5 % 5), 2.0 * at(i / 25)]))
        .collect();
    let of = mass(&points, 1.0);
    assert!((of.mass - 2.0).abs() < 1e-6 && of.center.length() < 1e-6, "{of:?}");
    let hull = Hull::of(&points).unwrap();
    assert_eq!(hull.faces(), 6);
}

/// A needle or a plate of any aspect ratio is either a closed solid or refused.
#[test]
fn hulls_of_any_ratio_are_right_or_refused() {
    let mut random = Random(5);
    let (mut refused, mut taken) = (0, 0);
    for ratio in [1.0, 1e2, 1e3, 5e3, 2e4, 5e4, 1e6, 1e9, 1e30] {
        for round in 0..40 {
            let mut points: Vec<_> = (0..12).map(|_| random.vector() * 0.15).collect();
            match round % 3 {
                0 => points[7][0] = 0.15 * ratio,
                1 => points.iter_mut().for_each(|point| point[1] *= 1.0 / ratio),
                _ => points.iter_mut().for_each(|point| point[round % 2] *= ratio),
            }
            let parry: Vec<_> = points.iter().map(|p| parry3d::math::Vector::from(p.0)).collect();
            match shape(&parry) {
                Err(reason) => {
                    assert!(ratio > 1e3 && [NO_VOLUME, TOO_THIN].contains(&reason), "{ratio}");
                    refused += 1;
                }
                Ok(_) => {
                    let hull = Hull::of(&parry).unwrap();
                    assert!(ratio < 1e5 && hull.faces() >= 4, "{ratio}");
                    for face in 0..hull.faces() {
                        let (normal, plane) = hull.face(face);
                        assert!((normal.length() - 1.0).abs() < 1e-5, "{ratio}: {normal:?}");
                        let out = hull.points.iter().map(|p| normal.dot(*p - plane));
                        assert!(out.fold(0.0, f32::max) < 1e-6 * 0.3 * ratio.max(1.0), "{ratio}");
                    }
                    taken += 1;
                }
            }
            // It never panics, however the shape was made.
            let _ = Hull::of(&parry);
        }
    }
    assert!(refused > 100 && taken > 100, "{refused} refused, {taken} taken");
}
