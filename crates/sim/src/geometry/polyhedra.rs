//! Contact manifolds of boxes and hulls ([`Solid`]): the axis along which they have the largest gap
//! or the least overlap ([`Separation`]), and the contact points along it ([`collide`]).
//!
//! If two faces lie on each other, all axes near their normal are equally good to within
//! rounding. An axis that changes from step to step makes resting bodies jitter. So an edge must
//! win by more than [`PREFERENCE`], and so must b's face against a's. Where the solids overlap and
//! one of them leans, edges near the rims of both faces win by a little. Their single contact point
//! then tips the body back over. So an edge must win by [`FAVOR`] as well.
//!
//! If the axis is the normal of a face, the other solid's face is clipped against the sides of that
//! face. A contact point that changes from step to step also makes resting bodies jitter. So
//! clipping never removes a corner that lies on a side.

use drystone_solver::{Vector, moment};

use super::solid::{Corner, Cuboid, Solid};
use super::{ContactManifold, Curvature, Frame, ManifoldPoint, NormalCarrier};

/// Margin by which an axis must win, as a fraction of the prediction distance. \[1\]
pub(super) const PREFERENCE: f32 = 0.01;

/// Margin by which an edge must win, as a fraction of the overlap. \[1\]
const FAVOR: f32 = 0.25;

/// Returns the gap that an edge must exceed to win against a face with the gap `face`. \[m\]
pub(super) fn edge_beyond(face: f32, prediction: f32) -> f32 {
    prediction.min(face + PREFERENCE * prediction + FAVOR * (-face).max(0.0))
}

/// The axis along which two solids have the largest gap, or the least overlap.
pub(super) struct Separation<const L: usize> {
    /// Gap along the axis. \[m\]
    pub(super) gap: f32,
    pub(super) axis: Axis<L>,
}

#[derive(Clone, Copy)]
pub(super) enum Axis<const L: usize> {
    /// The normal of a face.
    Face(FaceOf),
    /// An axis across two edges.
    Edges(Crossing<L>),
}

/// A face of a or b.
#[derive(Clone, Copy)]
pub(super) struct FaceOf {
    pub(super) b: bool,
    pub(super) face: usize,
}

/// Two crossing edges: the axis across them, from a to b, and their nearest points, in the frame of
/// a.
#[derive(Clone, Copy)]
pub(super) struct Crossing<const L: usize> {
    pub(super) axis: Vector<f32, L>,
    pub(super) on_a: Vector<f32, L>,
    pub(super) on_b: Vector<f32, L>,
    /// Identifies the edges; 0 if unknown.
    pub(super) feature: u64,
}

/// Number of bits for the number of an edge.
const EDGE_BITS: u32 = 31;

impl FaceOf {
    /// Returns the feature of a corner that lies on the face.
    pub(super) fn feature(self, corner: u32) -> u64 {
        let side = if self.b { 1 } else { 2 };
        side << 62 | (self.face as u64) << 32 | u64::from(corner)
    }
}

/// Returns the feature of a pair of edges.
pub(super) fn edges_feature([a, b]: [usize; 2]) -> u64 {
    3 << 62 | (a as u64) << EDGE_BITS | b as u64
}

/// The touching parts of the solids, as far as the feature of a contact point tells.
pub(super) enum Known {
    Face(FaceOf),
    Edges([usize; 2]),
    Nothing,
}

impl Known {
    pub(super) fn of(feature: u64) -> Self {
        let face = (feature >> 32 & 0x3fff_ffff) as usize;
        let edge = |bits: u64| (bits & ((1 << EDGE_BITS) - 1)) as usize;
        match feature >> 62 {
            1 => Self::Face(FaceOf { b: true, face }),
            2 => Self::Face(FaceOf { b: false, face }),
            3 => Self::Edges([edge(feature >> EDGE_BITS), edge(feature)]),
            _ => Self::Nothing,
        }
    }
}

/// Finds the axis between two boxes, among their face normals and, in 3D, the axes across their
/// edges. `from_b` is the frame of b as seen from a.
///
/// Both boxes are symmetric about their centers. So the gap along an axis is the distance of the
/// centers along it, less the extents of both.
pub(super) fn between_boxes<const L: usize>(
    a: &Cuboid<L>,
    b: &Cuboid<L>,
    from_b: &Frame<L>,
    prediction: f32,
) -> Separation<L> {
    let (Cuboid(a), Cuboid(b)) = (a, b);
    let Frame { position, axes } = from_b;
    let facing = |axis: usize, ahead: bool| if ahead { axis } else { axis + L };
    let (mut of_a, mut of_b) = ((f32::NEG_INFINITY, 0), (f32::NEG_INFINITY, 0));
    for i in 0..L {
        let (mut gap_a, mut gap_b) = (position[i].abs() - a[i], -b[i]);
        for j in 0..L {
            gap_a -= axes[j][i].abs() * b[j];
            gap_b -= axes[i][j].abs() * a[j];
        }
        let along = axes[i].dot(*position);
        gap_b += along.abs();
        if gap_a > of_a.0 {
            of_a = (gap_a, facing(i, position[i] >= 0.0));
        }
        if gap_b > of_b.0 {
            of_b = (gap_b, facing(i, along < 0.0));
        }
    }
    let mut best = better_face([of_a, of_b], PREFERENCE * prediction);
    if L == 3 && best.gap <= prediction {
        let beyond = edge_beyond(best.gap, prediction);
        if let Some((gap, edges)) = best_edges(a, b, from_b, beyond) {
            // Farther into each other, edges say little of what touches.
            let within = gap > -prediction;
            let crossing = crossing(&Cuboid(*a), &Cuboid(*b), from_b, edges, within);
            best = Separation { gap, axis: Axis::Edges(crossing) };
        }
    }
    best
}

/// Returns a's face, unless b's gap is larger by more than `margin` \[m\]. Each is given with its
/// gap \[m\].
fn better_face<const L: usize>([a, b]: [(f32, usize); 2], margin: f32) -> Separation<L> {
    let of_b = b.0 > a.0 + margin;
    let face = if of_b { b.1 } else { a.1 };
    Separation { gap: a.0.max(b.0), axis: Axis::Face(FaceOf { b: of_b, face }) }
}

/// Finds the axis between two solids, not both of them boxes. `before` is the feature of a contact
/// point of the step before. `crossing` proposes an axis across two edges.
pub(super) fn between<const L: usize>(
    a: &impl Solid<L>,
    b: &impl Solid<L>,
    from_b: &Frame<L>,
    prediction: f32,
    before: Option<u64>,
    crossing: impl FnOnce() -> Option<Crossing<L>>,
) -> Separation<L> {
    let far_b = |d| from_b.point(b.support(from_b.local_direction(d)));
    let far_a = |d| from_b.local_point(a.support(from_b.direction(d)));
    let margin = PREFERENCE * prediction;
    // The axis of the step before usually wins again.
    let again = match before.map_or(Known::Nothing, Known::of) {
        Known::Nothing => None,
        Known::Face(of) => {
            let gap = if of.b {
                still(b, of.face, prediction, far_a)
            } else {
                still(a, of.face, prediction, far_b)
            };
            gap.map(|gap| Separation { gap, axis: Axis::Face(of) })
        }
        Known::Edges(edges) => still_across(a, b, from_b, prediction, edges),
    };
    if let Some(again) = again {
        return again;
    }
    let of_a = best_face(a, from_b.position, prediction, far_b);
    if of_a.gap > prediction {
        return better_face([(of_a.gap, of_a.face), (f32::NEG_INFINITY, 0)], margin);
    }
    let of_b = best_face(b, from_b.local_point(Vector::ZERO), prediction, far_a);
    let best = better_face([&of_a, &of_b].map(|of| (of.gap, of.face)), margin);
    // In 2D, the normals of the sides are all the axes there are.
    if L == 2 || of_b.gap > prediction || of_a.is_sure(a) || of_b.is_sure(b) {
        return best;
    }
    let Some(mut crossing) = crossing() else { return best };
    // Measure the gap along the axis, whoever proposed it.
    let gap = crossing.axis.dot(far_b(-crossing.axis) - a.support(crossing.axis));
    if gap > edge_beyond(best.gap, prediction) {
        let on_b = from_b.local_direction(-crossing.axis);
        crossing.feature = edges_feature([farthest_edge(a, crossing.axis), farthest_edge(b, on_b)]);
        return Separation { gap, axis: Axis::Edges(crossing) };
    }
    best
}

/// A face, the gap of the other solid along its normal, and the point of that solid closest to it.
pub(super) struct Best<const L: usize> {
    pub(super) gap: f32,
    pub(super) face: usize,
    pub(super) far: Vector<f32, L>,
}

impl<const L: usize> Best<L> {
    /// True if no axis can have a larger gap than this face of `solid`. The test uses the room
    /// about the foot F of the far point on the face.
    ///
    /// Without overlap, F within the face is sufficient: the gap is at most the distance from F to
    /// the far point. With overlap, let the far point be d below F. Let the solid contain the disc
    /// of radius 1.5 d in the face about F, and the point 4 d below F. Consider an axis at angle t
    /// to the normal. The gap along it is at most that between the far point and any of these
    /// points: -d (cos t + 1.5 sin t) and 3 d cos t. The first is at most -d up to 112 degrees, the
    /// second from 110 degrees on.
    pub(super) fn is_sure(&self, solid: &impl Solid<L>) -> bool {
        let (normal, _) = solid.face(self.face);
        let foot = self.far - normal * self.gap;
        let deep = (-self.gap).max(0.0);
        let (around, below) = (1.5 * deep, 4.0 * deep);
        (0..solid.faces()).filter(|&face| face != self.face).all(|face| {
            let (other, vertex) = solid.face(face);
            let (inside, along) = (other.dot(vertex - foot), other.dot(normal));
            let across = (1.0 - along * along).max(0.0);
            inside >= 0.0
                && inside * inside >= around * around * across
                && inside + below * along >= 0.0
        })
    }
}

/// Measures a face of `solid` against the other solid, whose farthest point along a direction is
/// `other`.
pub(super) fn measure<const L: usize>(
    solid: &impl Solid<L>,
    face: usize,
    other: impl Fn(Vector<f32, L>) -> Vector<f32, L>,
) -> Best<L> {
    let (normal, vertex) = solid.face(face);
    let far = other(-normal);
    Best { gap: normal.dot(far - vertex), face, far }
}

/// Returns the gap along a face's normal if it is more than `enough`, or if no axis can have a
/// larger one. \[m\]
fn still<const L: usize>(
    solid: &impl Solid<L>,
    face: usize,
    enough: f32,
    other: impl Fn(Vector<f32, L>) -> Vector<f32, L>,
) -> Option<f32> {
    let found = (face < solid.faces()).then(|| measure(solid, face, other))?;
    (found.gap > enough || found.is_sure(solid)).then_some(found.gap)
}

/// Returns the face with the largest gap, or any face with a gap of more than `enough`. `center` is
/// within the other solid or near it. All arguments are in the frame of `solid`.
pub(super) fn best_face<const L: usize>(
    solid: &impl Solid<L>,
    center: Vector<f32, L>,
    enough: f32,
    other: impl Fn(Vector<f32, L>) -> Vector<f32, L>,
) -> Best<L> {
    let towards = |face: usize| {
        let (normal, vertex) = solid.face(face);
        normal.dot(center - vertex)
    };
    let likely = (1..solid.faces()).fold((towards(0), 0), |best, face| {
        let along = towards(face);
        if along > best.0 { (along, face) } else { best }
    });
    let mut best = measure(solid, likely.1, &other);
    for face in 0..solid.faces() {
        if best.gap > enough {
            break;
        }
        let (normal, vertex) = solid.face(face);
        // The farthest point bounds the gap of a face from above: for most faces, one such test is
        // sufficient.
        if face == best.face || normal.dot(best.far - vertex) < best.gap {
            continue;
        }
        let own = measure(solid, face, &other);
        if own.gap > best.gap || own.gap == best.gap && face < best.face {
            best = own;
        }
    }
    best
}

/// Returns the largest gap along an axis across an edge of each box, and the axis numbers of both
/// edges. Returns `None` if it is not more than `least` \[m\].
fn best_edges<const L: usize>(
    a: &Vector<f32, L>,
    b: &Vector<f32, L>,
    from_b: &Frame<L>,
    least: f32,
) -> Option<(f32, [usize; 2])> {
    let Frame { position, axes } = from_b;
    let mut best = None;
    let mut beat = least * least.abs();
    for i in 0..L {
        let (j, k) = ((i + 1) % L, (i + 2) % L);
        for n in 0..L {
            let (p, q) = ((n + 1) % L, (n + 2) % L);
            // The axis e_i x b_n is not of unit length, so gaps are compared as squares that keep
            // their sign.
            let [x, y] = [-axes[n][k], axes[n][j]];
            let squared = x * x + y * y;
            let apart = (x * position[j] + y * position[k]).abs();
            let reach_a = a[j] * x.abs() + a[k] * y.abs();
            let reach_b = b[p] * axes[q][i].abs() + b[q] * axes[p][i].abs();
            let gap = apart - reach_a - reach_b;
            // Skip parallel edges, for which a face normal is as good.
            if squared >= 1e-6 && gap * gap.abs() > beat * squared {
                let gap = gap / squared.sqrt();
                beat = gap * gap.abs();
                best = Some((gap, [i, n]));
            }
        }
    }
    best
}

/// Returns the crossing of two edges, which run along axis i of box a and axis n of box b. `within`
/// asks for points of the edges, and not of their lines.
fn crossing<const L: usize>(
    a: &Cuboid<L>,
    b: &Cuboid<L>,
    from_b: &Frame<L>,
    [i, n]: [usize; 2],
    within: bool,
) -> Crossing<L> {
    let mut edge_a = Vector::ZERO;
    edge_a[i] = 1.0;
    let edge_b = from_b.axes[n];
    let across: Vector<f32, L> = moment(edge_a, edge_b);
    let outward = if across.dot(from_b.position) < 0.0 { -1.0 } else { 1.0 };
    let axis = across * (outward / across.length());
    let (far_a, far_b) = (a.support(axis), b.support(from_b.local_direction(-axis)));
    // Each edge goes from its corner to the opposite one.
    let way = |corner: f32| -corner.signum();
    let (edge_a, edge_b) = (edge_a * way(far_a[i]), edge_b * way(far_b[n]));
    let lengths = [2.0 * far_a[i].abs(), 2.0 * far_b[n].abs()];
    let far_b = from_b.point(far_b);
    let lines = [[far_a, edge_a], [far_b, edge_b]];
    let [s, t] = if within { nearest_within(lines, lengths) } else { nearest(lines) };
    Crossing { axis, on_a: far_a + edge_a * s, on_b: far_b + edge_b * t, feature: 0 }
}

/// Returns what [`nearest`] does for the first `lengths` of two lines. \[m\] Lines that are almost
/// parallel may be nearest far beyond them.
fn nearest_within<const L: usize>(
    [[from_a, along_a], [from_b, along_b]]: [[Vector<f32, L>; 2]; 2],
    lengths: [f32; 2],
) -> [f32; 2] {
    let [s, _] = nearest([[from_a, along_a], [from_b, along_b]]);
    let on_a = from_a + along_a * s.clamp(0.0, lengths[0]);
    let t = along_b.dot(on_a - from_b).clamp(0.0, lengths[1]);
    let on_b = from_b + along_b * t;
    [along_a.dot(on_b - from_a).clamp(0.0, lengths[0]), t]
}

/// Returns the distances along two lines to their nearest points. \[m\] A line is a point and a
/// unit direction.
fn nearest<const L: usize>(
    [[from_a, along_a], [from_b, along_b]]: [[Vector<f32, L>; 2]; 2],
) -> [f32; 2] {
    let between = from_b - from_a;
    let skew = along_a.dot(along_b);
    let (p, q) = (between.dot(along_a), between.dot(along_b));
    let squared = 1.0 - skew * skew;
    [(p - skew * q) / squared, (skew * p - q) / squared]
}

/// Returns the edge that is farthest along a direction.
fn farthest_edge<const L: usize>(solid: &impl Solid<L>, direction: Vector<f32, L>) -> usize {
    let along = |edge: usize| {
        let [from, to] = solid.edge(edge);
        direction.dot(from + to)
    };
    let first = (f32::NEG_INFINITY, 0);
    let farther = |best: (f32, usize), edge| {
        let along = along(edge);
        if along > best.0 { (along, edge) } else { best }
    };
    (0..solid.edges()).fold(first, farther).1
}

/// Returns the axis across an edge of each solid if its gap is more than `prediction` \[m\], or if
/// no axis can have a larger one.
///
/// Without overlap, it is sufficient that the nearest points of the lines are on the edges: the gap
/// is at most their distance. With overlap, let the nearest points be d past each other and at
/// least r from the ends, and the edges at angle s. The gap along an axis at angle t to this one is
/// at most that between points r along the edges, in the better of both ways: -d cos t - r sin s
/// sin t. It is at most -d up to 112 degrees if r sin s is 1.5 d. From 110 degrees on, a point of a
/// that is 4 d below the nearest one is sufficient, as in [`Best::is_sure`].
fn still_across<const L: usize>(
    a: &impl Solid<L>,
    b: &impl Solid<L>,
    from_b: &Frame<L>,
    prediction: f32,
    edges: [usize; 2],
) -> Option<Separation<L>> {
    if edges[0] >= a.edges() || edges[1] >= b.edges() {
        return None;
    }
    let edge_b = b.edge(edges[1]).map(|end| from_b.point(end));
    let lengths = [a.edge(edges[0]), edge_b].map(|[from, to]| (to - from).length());
    let [line_a, line_b] = [(a.edge(edges[0]), lengths[0]), (edge_b, lengths[1])]
        .map(|([from, to], length)| [from, (to - from) * (1.0 / length)]);
    let across: Vector<f32, L> = moment(line_a[1], line_b[1]);
    let sine = across.length();
    if sine < 1e-2 {
        return None;
    }
    let along = nearest([line_a, line_b]);
    let rooms = [0, 1].map(|i| along[i].min(lengths[i] - along[i]));
    let room = rooms[0].min(rooms[1]);
    let on_a = line_a[0] + line_a[1] * along[0];
    let on_b = line_b[0] + line_b[1] * along[1];
    let outward = if across.dot(from_b.position) < 0.0 { -1.0 } else { 1.0 };
    let axis = across * (outward / sine);
    let far_b = from_b.point(b.support(from_b.local_direction(-axis)));
    let gap = axis.dot(far_b - a.support(axis));
    let found = Separation {
        gap,
        axis: Axis::Edges(Crossing { axis, on_a, on_b, feature: edges_feature(edges) }),
    };
    if gap > prediction {
        return Some(found);
    }
    // With this much overlap, a face may be preferred.
    if FAVOR * -gap > PREFERENCE * prediction {
        return None;
    }
    // Both edges must be the farthest features of their solids.
    let edges_apart = axis.dot(on_b - on_a);
    if room < 0.0 || gap < edges_apart - 0.1 * PREFERENCE * prediction {
        return None;
    }
    let deep = (-edges_apart).max(0.0);
    let deep_enough = |face: usize| {
        let (normal, vertex) = a.face(face);
        normal.dot(vertex - on_a) + 4.0 * deep * normal.dot(axis) >= 0.0
    };
    let sure = deep == 0.0 || room * sine >= 1.5 * deep && (0..a.faces()).all(deep_enough);
    sure.then_some(found)
}

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
    let (mut number, mut is_beside) = (0, false);
    solid.sides(of.face, memory, |point, outward| {
        is_beside |= !cut([left, next], number, point, outward);
        number += 1;
    });
    // Beside a face, only solids that are apart are known to be nearest at its rim.
    let at_rim = is_beside && gap >= 0.0;
    if at_rim {
        retain_nearest(left, |each| solid.sides(of.face, memory, each));
    } else if is_beside {
        left.clear();
    }
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
    if at_rim {
        to_rim((solid, of.face), memory, &mut touch.points);
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

/// Retains the corners nearest to a face beside which they are. `sides` calls its argument with each
/// plane through a side of the face, as [`Solid::sides`] does.
fn retain_nearest<const L: usize>(
    corners: &mut Vec<Corner<L>>,
    sides: impl FnOnce(&mut dyn FnMut(Vector<f32, L>, Vector<f32, L>)),
) {
    corners.iter_mut().for_each(|corner| corner.height = 0.0);
    let mut size = 0.0f32;
    sides(&mut |point, outward| {
        let length = outward.length();
        size = size.max(length);
        for corner in corners.iter_mut() {
            let beyond = outward.dot(corner.position - point) / length;
            corner.height = corner.height.max(beyond);
        }
    });
    let least = corners.iter().map(|corner| corner.height).fold(f32::INFINITY, f32::min);
    corners.retain(|corner| corner.height <= least + 1e-4 * size);
}

/// Moves points on the plane of a face, beside the face, to its rim.
fn to_rim<const L: usize>(
    (solid, face): (&impl Solid<L>, usize),
    memory: &mut Vec<Corner<L>>,
    points: &mut [ManifoldPoint<L>],
) {
    solid.sides(face, memory, |on, outward| {
        for point in points.iter_mut() {
            let beyond = outward.dot(point.on_a - on) / outward.dot(outward);
            point.on_a -= outward * beyond.max(0.0);
        }
    });
}

/// Clips a convex polygon to the inner side of a plane (Sutherland-Hodgman). In 2D the polygon is a
/// segment. If all of it is on the outer side, it is left as it is, and the result is false.
fn cut<const L: usize>(
    [polygon, next]: [&mut Vec<Corner<L>>; 2],
    side: u32,
    point: Vector<f32, L>,
    outward: Vector<f32, L>,
) -> bool {
    // A corner on the plane counts as inside.
    let tolerance = 1e-4 * outward.dot(outward);
    let (mut all_inside, mut all_outside) = (true, true);
    for corner in polygon.iter_mut() {
        corner.height = outward.dot(corner.position - point);
        let inside = corner.height <= tolerance;
        (all_inside, all_outside) = (all_inside & inside, all_outside & !inside);
    }
    if all_inside || all_outside {
        return all_inside;
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
    true
}

#[cfg(test)]
mod tests;
