//! Contact manifolds of boxes and hulls. The reference face is on the axis of separation
//! ([`separation`](super::separation)); the other solid's face is clipped against its sides.
//!
//! A contact point that changes from step to step makes resting bodies jitter. So clipping never
//! removes a corner that lies on a side.

use drystone_solver::Vector;

use super::separation::{Axis, Crossing, FaceOf, Separation};
use super::solid::{Corner, Cuboid, Solid};
use super::{ContactManifold, Curvature, Frame, ManifoldPoint, NormalCarrier};

/// Polygons for clipping, with reused memory.
#[derive(Default)]
pub(super) struct Clipper<const L: usize> {
    /// Corners of a reference face.
    pub(super) reference: Vec<Corner<L>>,
    pub(super) incident: Vec<Corner<L>>,
    next: Vec<Corner<L>>,
}

/// Fills `touch`, in the frame of a, with the contact points of `a` and `b` along the axis of
/// `separation`, up to a gap of `prediction` \[m\]. Returns the gap. \[m\] `from_b` is the frame of
/// b as seen from a.
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
            touch.transform(from_b);
        }
    }
    gap
}

/// If the points over a face have less than this fraction of the overlap, most of the overlap is
/// beside the face. \[1\]
const BESIDE: f32 = 0.5;

/// Fills `touch` with the contact points of the other solid over a face of `solid`, up to a gap of
/// `prediction` \[m\]. They are given in the frame of `solid`, which is a. `gap` is the gap along
/// the normal. \[m\]
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
    // The farthest point replaces points that should be over the face. Without it, two hulls that
    // wedge would penetrate until another axis wins. This point may also be below a neighboring
    // face with almost the same normal.
    if touch.points.is_empty() || gap < 0.0 && least > BESIDE * gap && is_inside(far()) {
        touch.points.extend(near(&Corner::new(far(), 0xffff)));
    }
    touch.reduce();
}

/// The boundary plane of a half-space.
pub(super) struct Plane<const L: usize> {
    pub(super) point: Vector<f32, L>,
    /// Unit normal out of the half-space.
    pub(super) normal: Vector<f32, L>,
}

/// The part of a shape that can touch a plane.
pub(super) enum PlaneSupport<'a, H, const L: usize> {
    /// A face of a box or a hull.
    Cuboid(&'a Cuboid<L>),
    Hull(&'a H),
    /// Balls of this radius about these centers: a ball, or the ends of a capsule. \[m\]
    RoundedCore(&'a [Vector<f32, L>], f32),
}

/// Fills `touch` with the contact points of a shape and a half-space, up to a gap of `prediction`
/// \[m\]. Returns the gap. \[m\]
///
/// `from_shape` is the frame of the shape in the coordinates of `plane` and `touch`. The shape is a
/// if `above`, else b.
pub(super) fn on_plane<const L: usize>(
    plane: &Plane<L>,
    plane_support: &PlaneSupport<'_, impl Solid<L>, L>,
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
    let radius = match *plane_support {
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

/// Clips a convex polygon to the inner side of a plane (Sutherland-Hodgman). In 2D the polygon is a
/// segment.
fn cut<const L: usize>(
    [polygon, next]: [&mut Vec<Corner<L>>; 2],
    side: u32,
    point: Vector<f32, L>,
    outward: Vector<f32, L>,
) {
    // A corner on the plane counts as inside.
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
    // A segment is not closed.
    let mut before = if L > 2 { polygon.last() } else { None };
    for here in &*polygon {
        let inside = here.height <= tolerance;
        if let Some(from) = before.filter(|from| (from.height <= tolerance) != inside) {
            // If both corners are near the plane on the same side, the line through them crosses it
            // far away.
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
