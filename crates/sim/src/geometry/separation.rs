//! How far two solids are apart, or how little they overlap, and along which axis.
//!
//! Where two faces lie on each other, every axis near their normal is as good to within rounding,
//! and an axis that changes from step to step shakes what rests there. So an edge must win by more
//! than [`PREFERENCE`], and b's face likewise against a's. Where they overlap, those near the rims of
//! both faces win by a little as soon as one leans, each with a single point that tips it back over: so an edge must
//! win by [`FAVOR`] as well.

use drystone_solver::{Vector, moment};

use super::Frame;
use super::solid::{Cuboid, Solid};

/// By how much an axis must win, as part of the prediction distance.
pub(super) const PREFERENCE: f32 = 0.01;

/// By how much of the overlap an edge must win. \[1\]
const FAVOR: f32 = 0.25;

/// The gap that an edge must have more of than a face with this one. \[m\]
pub(super) fn edge_beyond(face: f32, prediction: f32) -> f32 {
    prediction.min(face + PREFERENCE * prediction + FAVOR * (-face).max(0.0))
}

/// The axis along which two solids are farthest apart, or overlap least.
pub(super) struct Separation<const L: usize> {
    /// How far they are apart along it. \[m\]
    pub(super) gap: f32,
    pub(super) axis: Axis<L>,
}

#[derive(Clone, Copy)]
pub(super) enum Axis<const L: usize> {
    /// The normal of a face.
    Face(FaceOf),
    /// Across two edges.
    Edges(Crossing<L>),
}

/// A face of a or of b.
#[derive(Clone, Copy)]
pub(super) struct FaceOf {
    pub(super) b: bool,
    pub(super) face: usize,
}

/// Two edges that cross: the axis between them, from a to b, and the nearest points, in the frame
/// of a.
#[derive(Clone, Copy)]
pub(super) struct Crossing<const L: usize> {
    pub(super) axis: Vector<f32, L>,
    pub(super) on_a: Vector<f32, L>,
    pub(super) on_b: Vector<f32, L>,
    /// Names the edges; 0: nothing does.
    pub(super) feature: u64,
}

/// Bits for the number of an edge.
const EDGE_BITS: u32 = 31;

impl FaceOf {
    /// Names a corner of what lies on it.
    pub(super) fn feature(self, corner: u32) -> u64 {
        let side = if self.b { 1 } else { 2 };
        side << 62 | (self.face as u64) << 32 | u64::from(corner)
    }
}

/// Names an edge of each.
pub(super) fn edges_feature([a, b]: [usize; 2]) -> u64 {
    3 << 62 | (a as u64) << EDGE_BITS | b as u64
}

/// What the name of a point tells of where the solids touched.
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

/// The axis between two boxes: of their faces, and in space of their edges. `from_b` is the frame of b as seen
/// from a. Along an axis that both are symmetric about, a gap is the distance of the centers less how far
/// each reaches.
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
            best = Separation {
                gap,
                axis: Axis::Edges(crossing(&Cuboid(*a), &Cuboid(*b), from_b, edges)),
            };
        }
    }
    best
}

/// a's face, unless b's is better by a `margin` \[m\]; each with its gap \[m\].
fn better_face<const L: usize>([a, b]: [(f32, usize); 2], margin: f32) -> Separation<L> {
    let of_b = b.0 > a.0 + margin;
    let face = if of_b { b.1 } else { a.1 };
    Separation { gap: a.0.max(b.0), axis: Axis::Face(FaceOf { b: of_b, face }) }
}

/// The axis between two solids of which one is no box. `before` is the feature of a point where they touched a
/// step ago; `crossing` proposes an axis that is no face's normal.
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
    // What has won a step ago mostly wins again.
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
    // In the plane, sides are all the axes there are.
    if L == 2 || of_b.gap > prediction || of_a.is_sure(a) || of_b.is_sure(b) {
        return best;
    }
    let Some(mut crossing) = crossing() else { return best };
    // What the axis really separates, whoever proposed it.
    let gap = crossing.axis.dot(far_b(-crossing.axis) - a.support(crossing.axis));
    if gap > edge_beyond(best.gap, prediction) {
        let on_b = from_b.local_direction(-crossing.axis);
        crossing.feature = edges_feature([farthest_edge(a, crossing.axis), farthest_edge(b, on_b)]);
        return Separation { gap, axis: Axis::Edges(crossing) };
    }
    best
}

/// A face, how far the other solid is outside of it, and that one's point which is the least far.
pub(super) struct Best<const L: usize> {
    pub(super) gap: f32,
    pub(super) face: usize,
    pub(super) far: Vector<f32, L>,
}

impl<const L: usize> Best<L> {
    /// Whether no axis can have more gap than this face of `solid`, as it has room about the foot F of
    /// the far point on the face.
    ///
    /// With no overlap, F within the face is enough: the solids are no farther apart than F and the far
    /// point. Let that one be d below F, let the solid hold the disc of radius 1.5 d in the face about F,
    /// and the point 4 d below F. The gap along an axis at angle t to the normal is at most that between
    /// the far point and any of these: -d (cos t + 1.5 sin t) and 3 d cos t. The first is at most -d up to
    /// 112 degrees, the second from 110 on.
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

/// A face of `solid` against the other one, whose farthest point along a direction is `other`.
pub(super) fn measure<const L: usize>(
    solid: &impl Solid<L>,
    face: usize,
    other: impl Fn(Vector<f32, L>) -> Vector<f32, L>,
) -> Best<L> {
    let (normal, vertex) = solid.face(face);
    let far = other(-normal);
    Best { gap: normal.dot(far - vertex), face, far }
}

/// The gap along a face's normal, if it is more than `enough` or no axis can have more. \[m\]
fn still<const L: usize>(
    solid: &impl Solid<L>,
    face: usize,
    enough: f32,
    other: impl Fn(Vector<f32, L>) -> Vector<f32, L>,
) -> Option<f32> {
    let found = (face < solid.faces()).then(|| measure(solid, face, other))?;
    (found.gap > enough || found.is_sure(solid)).then_some(found.gap)
}

/// The face that the other solid is farthest outside of (or least inside), or any that it is outside
/// of by more than `enough`. `center` is within the other solid or near it; all in the frame of
/// `solid`.
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
        // No point of the other solid is less far out than its farthest: most faces lose by one.
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

/// The axis across an edge of each box with the most gap, if that is more than `least` \[m\]: the gap, and the
/// number of each edge.
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
            // The axis is e_i x b_n: not of unit length, so gaps are compared as squares that keep their sign.
            let [x, y] = [-axes[n][k], axes[n][j]];
            let squared = x * x + y * y;
            let apart = (x * position[j] + y * position[k]).abs();
            let reach_a = a[j] * x.abs() + a[k] * y.abs();
            let reach_b = b[p] * axes[q][i].abs() + b[q] * axes[p][i].abs();
            let gap = apart - reach_a - reach_b;
            // Parallel edges: a face's normal is as good.
            if squared >= 1e-6 && gap * gap.abs() > beat * squared {
                let gap = gap / squared.sqrt();
                beat = gap * gap.abs();
                best = Some((gap, [i, n]));
            }
        }
    }
    best
}

/// Where edges of two boxes cross.
fn crossing<const L: usize>(
    a: &Cuboid<L>,
    b: &Cuboid<L>,
    from_b: &Frame<L>,
    [i, n]: [usize; 2],
) -> Crossing<L> {
    let mut edge_a = Vector::ZERO;
    edge_a[i] = 1.0;
    let edge_b = from_b.axes[n];
    let across: Vector<f32, L> = moment(edge_a, edge_b);
    let outward = if across.dot(from_b.position) < 0.0 { -1.0 } else { 1.0 };
    let axis = across * (outward / across.length());
    let far_a = a.support(axis);
    let far_b = from_b.point(b.support(from_b.local_direction(-axis)));
    let [s, t] = nearest([far_a, edge_a], [far_b, edge_b]);
    Crossing { axis, on_a: far_a + edge_a * s, on_b: far_b + edge_b * t, feature: 0 }
}

/// Where two lines, each a point and a unit direction, are nearest: how far along each. \[m\]
fn nearest<const L: usize>(
    [from_a, along_a]: [Vector<f32, L>; 2],
    [from_b, along_b]: [Vector<f32, L>; 2],
) -> [f32; 2] {
    let between = from_b - from_a;
    let skew = along_a.dot(along_b);
    let (p, q) = (between.dot(along_a), between.dot(along_b));
    let squared = 1.0 - skew * skew;
    [(p - skew * q) / squared, (skew * p - q) / squared]
}

/// The edge that is farthest along a direction.
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

/// The axis across an edge of each solid, if its gap is more than `prediction` \[m\] or no axis can have more.
///
/// With no overlap it is enough that the nearest points of the lines are on the edges: the solids are no
/// farther apart. Else let them be d past each other, at least r from the ends, and the edges at angle s.
/// The gap along an axis at angle t to this one is at most that between points r along the edges, the
/// better of either way: -d cos t - r sin s sin t, which is at most -d up to 112 degrees if r sin s is 1.5 d.
/// From 110 on a point of a that is 4 d below the nearest one is enough, as in [`Best::is_sure`].
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
    let along = nearest(line_a, line_b);
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
    // A face may be favored.
    if FAVOR * -gap > PREFERENCE * prediction {
        return None;
    }
    // Both edges must be the farthest of their solids.
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

#[cfg(test)]
mod tests;
