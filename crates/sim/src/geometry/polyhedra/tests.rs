use super::*;
use crate::geometry::hull::Hull;
use crate::geometry::{Geometry, Rigid3};

/// Numbers within -1..1 (splitmix64).
struct Random(u64);

impl Random {
    fn number(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }

    fn vector(&mut self) -> Vector<f32, 3> {
        Vector([self.number(), self.number(), self.number()])
    }
}

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

/// The gap along an axis from a to b.
fn gap(a: &impl Solid<3>, b: &impl Solid<3>, from_b: &Frame<3>, axis: Vector<f32, 3>) -> f32 {
    axis.dot(from_b.point(b.support(from_b.local_direction(-axis))) - a.support(axis))
}

/// Edges of a solid, as ways along them.
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

/// What became of the pairs: sure of a face, and an edge wins.
#[derive(Default)]
struct Seen {
    sure: usize,
    beaten: usize,
}

/// Brings b against a face of a, with this gap, and looks.
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
    seen.sure += usize::from(sure);
    seen.beaten += usize::from(any > best.gap + 1e-3);
}

/// Against all faces, and all axes across two edges: no others can have the most gap while solids
/// overlap.
#[test]
fn a_face_that_is_sure_is_beaten_by_no_axis() {
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
}
