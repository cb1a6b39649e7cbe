//! Contact between boxes and hulls: the points where the face along which they are held against each
//! other ([`separation`](super::separation)) meets the other's face.
//!
//! A point that changes from step to step shakes what rests there, so clipping never loses a corner that
//! lies on a side.

use drystone_solver::Vector;

use super::separation::{Axis, Crossing, FaceOf, Separation};
use super::solid::{Corner, Cuboid, Solid};
use super::{ContactManifold, Curvature, Frame, ManifoldPoint, NormalCarrier};

/// Polygons that are reused.
#[derive(Default)]
pub(super) struct Clipper<const L: usize> {
    /// For the corners of a reference face.
    pub(super) reference: Vec<Corner<L>>,
    pub(super) incident: Vec<Corner<L>>,
    next: Vec<Corner<L>>,
}

/// Fills `touch`, in the frame of a, with where `a` and `b` overlap or are within `prediction` \[m\]
/// along the axis between them; returns the gap. \[m\] `from_b` is the frame of b as seen from a.
pub(super) fn collide<const L: usize>(
    a: &impl Solid<L>,
    b: &impl Solid<L>,
    from_b: &Frame<L>,
    prediction: f32,
    Separation { gap, axis }: Separation<L>,
    clipper: &mut Clipper<L>,
    touch: &mut ContactManifold<L>,
) -> f32 {
    let near = |gap: &f32| *gap <= prediction;
    match axis {
        _ if gap > prediction => {}
        Axis::Edges(Crossing { axis, on_a, on_b, feature }) => {
            touch.normal = -axis;
            touch.surfaces = Curvature::default();
            let gap = Some(axis.dot(on_b - on_a)).filter(near);
            touch.points.extend(gap.map(|gap| ManifoldPoint { on_a, on_b, gap, feature }));
        }
        Axis::Face(of @ FaceOf { b: false, .. }) => {
            on_face((a, of), (b, from_b), gap, prediction, clipper, touch);
        }
        Axis::Face(of @ FaceOf { b: true, .. }) => {
            let from_a = &Frame::IDENTITY.seen_from(from_b);
            on_face((b, of), (a, from_a), gap, prediction, clipper, touch);
            touch.exchange();
            touch.place(from_b);
        }
    }
    gap
}

/// If what is over a face has less than this part of the overlap, most of it is beside the face. \[1\]
const BESIDE: f32 = 0.5;

/// Fills `touch` with where the other solid is over a face of one, and within `prediction` \[m\] of it, in the
/// frame of the one with the face, which is a. Along the normal they are `gap` \[m\] apart.
fn on_face<const L: usize>(
    (solid, of): (&impl Solid<L>, FaceOf),
    (other, from_other): (&impl Solid<L>, &Frame<L>),
    gap: f32,
    prediction: f32,
    clipper: &mut Clipper<L>,
    touch: &mut ContactManifold<L>,
) {
    let (normal, vertex) = solid.face(of.face);
    let Clipper { reference: memory, incident: left, next } = clipper;
    left.clear();
    let against = from_other.local_direction(-normal);
    other.corners(other.facing(against), left);
    for corner in left.iter_mut() {
        corner.position = from_other.point(corner.position);
    }
    let mut number = 0;
    solid.sides(of.face, memory, |point, outward| {
        cut([left, next], number, point, outward);
        number += 1;
    });
    let near = |corner: &Corner<L>| {
        let on_b = corner.position;
        let gap = Some(normal.dot(on_b - vertex)).filter(|gap| *gap <= prediction)?;
        Some(ManifoldPoint {
            on_a: on_b - normal * gap,
            on_b,
            gap,
            feature: of.feature(corner.feature),
        })
    };
    touch.normal = -normal;
    touch.surfaces = Curvature { radii: [0.0; 2], normal: NormalCarrier::FaceOfA };
    touch.points.extend(left.iter().filter_map(near));
    let least = touch.points.iter().map(|point| point.gap).fold(f32::INFINITY, f32::min);
    let far = || from_other.point(other.support(against));
    let is_inside = |point: Vector<f32, L>| {
        (0..solid.faces()).map(|face| solid.face(face)).all(|(n, on)| n.dot(point - on) <= 0.0)
    };
    // The farthest point stands for what would be over the face: two hulls that wedge would sink in until
    // another axis wins. Or it is under a neighbor of the face, in much the same direction.
    if touch.points.is_empty() || gap < 0.0 && least > BESIDE * gap && is_inside(far()) {
        touch.points.extend(near(&Corner::new(far(), 0xffff)));
    }
    touch.reduce();
}

/// The boundary of a half-space.
pub(super) struct Plane<const L: usize> {
    pub(super) point: Vector<f32, L>,
    /// Out of the half-space.
    pub(super) normal: Vector<f32, L>,
}

/// What of a shape can lie on a plane.
pub(super) enum PlaneSupport<'a, H, const L: usize> {
    /// A face.
    Cuboid(&'a Cuboid<L>),
    Hull(&'a H),
    /// Balls of this radius around these centers: a ball, the ends of a capsule.
    RoundedCore(&'a [Vector<f32, L>], f32),
}

/// Fills `touch` with where a shape overlaps a half-space or is within `prediction` \[m\] of it; returns how
/// far they are apart \[m\].
/// `from_shape` is the frame of the shape as seen from where `plane` and `touch` are given; the
/// shape is a if `above`, else b.
pub(super) fn on_plane<const L: usize>(
    plane: &Plane<L>,
    footing: &PlaneSupport<'_, impl Solid<L>, L>,
    from_shape: &Frame<L>,
    above: bool,
    prediction: f32,
    clipper: &mut Clipper<L>,
    touch: &mut ContactManifold<L>,
) -> f32 {
    let normal = plane.normal;
    let corners = &mut clipper.incident;
    corners.clear();
    let down = from_shape.local_direction(-normal);
    let radius = match *footing {
        PlaneSupport::Cuboid(cuboid) => {
            cuboid.corners(cuboid.facing(down), corners);
            0.0
        }
        PlaneSupport::Hull(hull) => {
            hull.corners(hull.facing(down), corners);
            0.0
        }
        PlaneSupport::RoundedCore(centers, radius) => {
            for (feature, &position) in centers.iter().enumerate() {
                corners.push(Corner::new(position, feature as u32));
            }
            radius
        }
    };
    touch.normal = if above { normal } else { -normal };
    touch.surfaces = if above {
        Curvature { radii: [radius, 0.0], normal: NormalCarrier::FaceOfB }
    } else {
        Curvature { radii: [0.0, radius], normal: NormalCarrier::FaceOfA }
    };
    let mut apart = f32::INFINITY;
    for corner in corners {
        let lowest = from_shape.point(corner.position) - normal * radius;
        let gap = normal.dot(lowest - plane.point);
        apart = apart.min(gap);
        if gap > prediction {
            continue;
        }
        let below = lowest - normal * gap;
        let (on_a, on_b) = if above { (lowest, below) } else { (below, lowest) };
        let feature = u64::from(corner.feature);
        touch.points.push(ManifoldPoint { on_a, on_b, gap, feature });
    }
    touch.reduce();
    apart
}

/// Keeps the part of a polygon, in the plane of a line, behind a plane (Sutherland-Hodgman).
fn cut<const L: usize>(
    [polygon, next]: [&mut Vec<Corner<L>>; 2],
    side: u32,
    point: Vector<f32, L>,
    outward: Vector<f32, L>,
) {
    // A corner that lies on the plane is inside.
    let tolerance = 1e-4 * outward.dot(outward);
    let mut all_inside = true;
    for corner in polygon.iter_mut() {
        corner.height = outward.dot(corner.position - point);
        all_inside &= corner.height <= tolerance;
    }
    if all_inside {
        return;
    }
    next.clear();
    // The ends of a line do not meet.
    let mut before = if L > 2 { polygon.last() } else { None };
    for here in &*polygon {
        let inside = here.height <= tolerance;
        if let Some(from) = before.filter(|from| (from.height <= tolerance) != inside) {
            // Where both are near the plane on the same side of it, its line meets it far away.
            let part = (from.height / (from.height - here.height)).clamp(0.0, 1.0);
            let position = from.position + (here.position - from.position) * part;
            let features = from.feature.min(here.feature) & 0xffff;
            next.push(Corner::new(position, 1 << 31 | side << 16 | features));
        }
        if inside {
            next.push(*here);
        }
        before = Some(here);
    }
    std::mem::swap(polygon, next);
}
