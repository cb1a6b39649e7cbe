use super::*;
use crate::geometry::hull::Hull;
use crate::geometry::random::Random;
use crate::geometry::{Geometry, Rigid3};

fn hull(random: &mut Random) -> Hull {
    loop {
        let points: Vec<_> = (0..14)
            .map(|_| {
                let point = random.vector();
                parry3d::math::Vector::from((point * (0.5 / point.length())).0)
            })
            .collect();
        if let Some(hull) = Hull::of(&points) {
            return hull;
        }
    }
}

/// Returns the gap along an axis from a to b.
fn gap(a: &impl Solid<3>, b: &impl Solid<3>, from_b: &Frame<3>, axis: Vector<f32, 3>) -> f32 {
    axis.dot(from_b.point(b.support(from_b.local_direction(-axis))) - a.support(axis))
}

/// Returns the edges of a solid as vectors.
fn edges(solid: &impl Solid<3>) -> Vec<Vector<f32, 3>> {
    let mut edges = Vec::new();
    for face in 0..solid.faces() {
        let mut corners = Vec::new();
        solid.corners(face, &mut corners);
        for i in 0..corners.len() {
            edges.push(corners[(i + 1) % corners.len()].position - corners[i].position);
        }
    }
    edges
}

/// Counts of pairs: those with a certain face, those where an edge wins, and those found again
/// without a search.
#[derive(Default)]
struct Seen {
    sure: usize,
    beaten: usize,
    known: [usize; 2],
}

const PREDICTION: f32 = 0.02;

/// Returns the axis with the largest gap among those across two edges.
fn across(a: &impl Solid<3>, b: &impl Solid<3>, from_b: &Frame<3>) -> Option<Crossing<3>> {
    let mut best = (f32::NEG_INFINITY, None);
    for edge in edges(a) {
        for other in edges(b) {
            let across: Vector<f32, 3> = moment(edge, from_b.direction(other));
            for sign in [-1.0, 1.0] {
                let axis = across * (sign / across.length());
                let gap = gap(a, b, from_b, axis);
                if gap > best.0 {
                    best = (gap, Some(axis));
                }
            }
        }
    }
    let (on_a, on_b) = (Vector::ZERO, Vector::ZERO);
    best.1.map(|axis| Crossing { axis, on_a, on_b, feature: 0 })
}

/// Repeats the query with the feature that was found.
fn again(a: &impl Solid<3>, b: &impl Solid<3>, from_b: &Frame<3>, any: f32, seen: &mut Seen) {
    let first = between(a, b, from_b, PREDICTION, None, || across(a, b, from_b));
    let (kind, feature) = match first.axis {
        _ if first.gap > PREDICTION => return,
        Axis::Face(of) => (0, of.feature(0)),
        Axis::Edges(crossing) => (1, crossing.feature),
    };
    let mut touch = ContactManifold::default();
    let apart = collide(a, b, from_b, PREDICTION, first, &mut Clipper::default(), &mut touch);
    let deepest = touch.points.iter().map(|point| point.gap).fold(f32::INFINITY, f32::min);
    assert!(deepest <= PREDICTION, "{apart} apart, and no point");
    let mut asked = false;
    let second = between(a, b, from_b, PREDICTION, Some(feature), || {
        asked = true;
        across(a, b, from_b)
    });
    let favored = |gap: f32| edge_beyond(gap, PREDICTION) + 1e-5;
    // A feature that did not win is not taken for the winner, and every near face has a contact
    // point.
    for edge in (0..a.edges().min(b.edges())).step_by(7) {
        let feature = edges_feature([edge, b.edges() - 1 - edge]);
        let other = between(a, b, from_b, PREDICTION, Some(feature), || across(a, b, from_b));
        assert!(any.min(PREDICTION) <= favored(other.gap), "{} is taken, not {any}", other.gap);
    }
    for face in 0..a.faces() {
        let (of, gap) = (FaceOf { b: false, face }, gap(a, b, from_b, a.face(face).0));
        let other = between(a, b, from_b, PREDICTION, Some(of.feature(0)), || across(a, b, from_b));
        assert!(any.min(PREDICTION) <= favored(other.gap), "{} is taken, not {any}", other.gap);
        let separation = Separation { gap, axis: Axis::Face(of) };
        let mut touch = ContactManifold::default();
        collide(a, b, from_b, PREDICTION, separation, &mut Clipper::default(), &mut touch);
        assert_eq!(touch.points.is_empty(), gap > PREDICTION, "face {face}, {gap} apart");
    }
    assert!(
        any.min(PREDICTION) <= favored(second.gap),
        "{} is kept, and an axis has {any}",
        second.gap
    );
    seen.known[kind] += usize::from(!asked);
}

/// Places b against a face of a with this gap, and compares.
fn compare(
    a: &impl Solid<3>,
    b: &impl Solid<3>,
    mut from_b: Frame<3>,
    wanted: f32,
    seen: &mut Seen,
) {
    let normal = a.face(0).0;
    from_b.position += normal * (wanted - gap(a, b, &from_b, normal));
    let from_b = &from_b;
    let far = |d| from_b.point(b.support(from_b.local_direction(d)));
    let best = best_face(a, from_b.position, f32::INFINITY, far);
    let faces = (0..a.faces()).map(|face| gap(a, b, from_b, a.face(face).0));
    let most = faces.fold(f32::NEG_INFINITY, f32::max);
    assert!((best.gap - most).abs() < 1e-5, "{} and {most}", best.gap);

    let other: Vec<_> = edges(b).into_iter().map(|edge| from_b.direction(edge)).collect();
    let mut any = (0..b.faces())
        .map(|face| from_b.direction(-b.face(face).0))
        .fold(f32::NEG_INFINITY, |any, axis| any.max(gap(a, b, from_b, axis)));
    for edge in edges(a) {
        for other in &other {
            let across: Vector<f32, 3> = moment(edge, *other);
            let length = across.length();
            if length > 1e-3 * edge.length() * other.length() {
                let axis = across * (1.0 / length);
                any = any.max(gap(a, b, from_b, axis)).max(gap(a, b, from_b, -axis));
            }
        }
    }
    let sure = best.is_sure(a);
    assert!(!sure || any <= best.gap + 1e-5, "sure of {}, and an axis has {any}", best.gap);
    again(a, b, from_b, any, seen);
    seen.sure += usize::from(sure);
    seen.beaten += usize::from(any > best.gap + 1e-3);
}

/// Compares with all faces, and with all axes across two edges: while solids overlap, only these
/// can have the largest gap.
#[test]
fn no_axis_beats_a_certain_face() {
    let mut random = Random(1);
    let mut seen = Seen::default();
    for round in 0..1500 {
        let turn = [random.number(), random.number(), random.number(), random.number()];
        let frame = Rigid3::frame(&Rigid3::pose(random.vector() * 0.2, &turn));
        let wanted = -0.03 + 0.04 * random.number();
        let cuboid = Cuboid(Vector([0.4, 0.3, 0.5]));
        match round % 3 {
            0 => compare(&hull(&mut random), &hull(&mut random), frame, wanted, &mut seen),
            1 => compare(&cuboid, &hull(&mut random), frame, wanted, &mut seen),
            _ => compare(&hull(&mut random), &cuboid, frame, wanted, &mut seen),
        }
    }
    assert!(seen.sure > 100 && seen.beaten > 100, "{} sure, {} beaten", seen.sure, seen.beaten);
    assert!(seen.known.iter().all(|known| *known > 50), "{:?} found again", seen.known);
}

/// Compares with all faces and edges of two boxes.
#[test]
fn boxes_are_separated_along_the_best_axis() {
    let mut random = Random(2);
    let mut edges_won = 0;
    for _ in 0..3000 {
        let size = |random: &mut Random| Vector(random.vector().0.map(|x| 0.1 + 0.5 * x.abs()));
        let (a, b) = (Cuboid(size(&mut random)), Cuboid(size(&mut random)));
        let turn = [random.number(), random.number(), random.number(), random.number()];
        let from_b = Rigid3::frame(&Rigid3::pose(random.vector() * 0.8, &turn));
        let found = between_boxes(&a, &b, &from_b, PREDICTION);
        let faces = (0..6).map(|face| gap(&a, &b, &from_b, a.face(face).0));
        let others = (0..6).map(|face| gap(&a, &b, &from_b, from_b.direction(-b.face(face).0)));
        let edges = across(&a, &b, &from_b).map(|best| gap(&a, &b, &from_b, best.axis));
        let most = faces.chain(others).chain(edges).fold(f32::NEG_INFINITY, f32::max);
        assert!(found.gap <= most + 1e-5, "{} of {most}", found.gap);
        assert!(
            most.min(PREDICTION) <= edge_beyond(found.gap, PREDICTION) + 1e-5,
            "{} of {most}",
            found.gap
        );
        if let Axis::Edges(Crossing { axis, on_a, on_b, .. }) = found.axis {
            assert!((gap(&a, &b, &from_b, axis) - found.gap).abs() < 1e-5);
            assert!((axis.dot(on_b - on_a) - found.gap).abs() < 1e-5);
            edges_won += 1;
        }
    }
    assert!(edges_won > 300, "{edges_won}");
}

/// Nearest points of edges are on the boxes, also of edges that are almost parallel, whose lines are
/// nearest somewhere else.
#[test]
fn edges_touch_within_their_length() {
    let (mut random, mut parallel) = (Random(4), 0);
    for _ in 0..20000 {
        let [a, b] = [0; 2].map(|_| Cuboid(Vector(random.vector().0.map(|x| 0.1 + 0.5 * x.abs()))));
        let turn = random.vector() * 0.02;
        let from_b =
            Rigid3::frame(&Rigid3::pose(random.vector(), &[turn[0], turn[1], turn[2], 1.0]));
        let found = between_boxes(&a, &b, &from_b, PREDICTION);
        let Axis::Edges(Crossing { axis, on_a, on_b, .. }) = found.axis else { continue };
        if found.gap <= -PREDICTION {
            continue;
        }
        parallel += 1;
        let on_b_own = from_b.local_point(on_b);
        for i in 0..3 {
            assert!(on_a[i].abs() <= a.0[i] + 1e-5, "{on_a:?} of {:?}", a.0);
            assert!(on_b_own[i].abs() <= b.0[i] + 1e-5, "{on_b_own:?} of {:?}", b.0);
        }
        assert!((axis.dot(on_b - on_a) - found.gap).abs() < 1e-5);
    }
    assert!(parallel > 100, "{parallel}");
}

/// Returns a unit quaternion: a rotation about an axis by an angle \[rad\].
fn about(axis: [f32; 3], angle: f32) -> [f32; 4] {
    let (sin, cos) = (0.5 * angle).sin_cos();
    [axis[0] * sin, axis[1] * sin, axis[2] * sin, cos]
}

/// Boxes that lie on each other, rotated, overlapping and leaning, are separated along a face
/// normal. Axes across the rims of both faces have slightly less overlap, and one point each.
/// Crossed beams on edge are separated across their edges.
#[test]
fn leaning_boxes_are_separated_along_a_face() {
    let (a, b) = (Cuboid(Vector([0.24, 0.2, 0.25])), Cuboid(Vector([0.24, 0.18, 0.24])));
    for deep in [0.005, 0.02, 0.08] {
        for round in 0..200 {
            let (turn, way) = ((20 + round % 50) as f32, round as f32);
            let yaw = Rigid3::pose(Vector::ZERO, &about([0.0, 1.0, 0.0], turn.to_radians()));
            let lean = Vector([way.cos(), 0.0, way.sin()]) * 1f32.to_radians();
            let place = Vector([0.02, 0.38 - deep, 0.03]);
            let from_b = Rigid3::frame(&Rigid3::advance(&yaw, place, lean));
            let found = between_boxes(&a, &b, &from_b, PREDICTION);
            assert!(matches!(found.axis, Axis::Face(_)), "{deep} deep, turned by {turn} degrees");
        }
    }
    let beam = Cuboid(Vector([1.0, 0.1, 0.1]));
    let eighth = std::f32::consts::FRAC_PI_4;
    let on_edge = Rigid3::pose(Vector::ZERO, &about([1.0, 0.0, 0.0], eighth));
    let across = Rigid3::advance(&on_edge, Vector::ZERO, Vector([0.0, 2.0 * eighth, 0.0]));
    for deep in [0.001, 0.01, 0.03] {
        let place = Vector([0.0, 0.2 * 2f32.sqrt() - deep, 0.0]);
        let upper = Rigid3::frame(&Rigid3::advance(&across, place, Vector::ZERO));
        let from_b = upper.seen_from(&Rigid3::frame(&on_edge));
        let found = between_boxes(&beam, &beam, &from_b, PREDICTION);
        assert!(matches!(found.axis, Axis::Edges(_)), "{deep} deep");
        assert!((found.gap + deep).abs() < 1e-5);
    }
}

/// Returns the depth of a point in a solid: its distance to the nearest face. \[m\]
fn depth(solid: &impl Solid<3>, point: Vector<f32, 3>) -> f32 {
    let ways = (0..solid.faces()).map(|face| solid.face(face)).map(|(n, on)| n.dot(on - point));
    ways.fold(f32::INFINITY, f32::min)
}

/// If the vertex farthest over the winning face is inside the other hull, some contact point is at
/// least half as deep. This holds also if the vertex is below a neighbor of the face.
#[test]
fn points_beside_a_face_are_found() {
    let (mut random, mut inside, mut beside) = (Random(3), 0, 0);
    for _ in 0..3000 {
        let turn = [random.number(), random.number(), random.number(), random.number()];
        let (a, b) = (hull(&mut random), hull(&mut random));
        let mut from_b = Rigid3::frame(&Rigid3::pose(random.vector(), &turn));
        let apart = (0.85 + 0.1 * random.number()) / from_b.position.length();
        from_b.position = from_b.position * apart;
        let separation = between(&a, &b, &from_b, PREDICTION, None, || across(&a, &b, &from_b));
        let Axis::Face(FaceOf { face, b: false }) = separation.axis else { continue };
        let ((normal, on), gap) = (a.face(face), separation.gap);
        let vertex = from_b.point(b.support(from_b.local_direction(-normal)));
        let deep = depth(&a, vertex);
        if gap > -1e-3 || deep < 1e-3 {
            continue;
        }
        let mut touch = ContactManifold::default();
        collide(&a, &b, &from_b, PREDICTION, separation, &mut Clipper::default(), &mut touch);
        let least = touch.points.iter().map(|point| point.gap).fold(f32::INFINITY, f32::min);
        assert!(least <= 0.5 * gap, "{least} of {gap}");
        let over = |point: &&crate::geometry::ManifoldPoint<3>| point.feature & 0xffff == 0xffff;
        inside += 1;
        beside += touch.points.iter().filter(over).count();
        assert!((normal.dot(vertex - on) - gap).abs() < 1e-5);
    }
    assert!(inside > 100 && beside > 0, "{inside} inside, {beside} beside");
}
