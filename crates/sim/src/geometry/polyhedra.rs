//! Contact between boxes and hulls: the axis along which they overlap least, and the points where
//! the face there meets the other's face.
//!
//! Where two faces lie on each other, every axis near their normal is as good to within rounding,
//! and an axis or a point that changes from step to step shakes what rests there. So an edge must
//! win by more than [`PREFERENCE`], b's face likewise against a's, and clipping never loses a
//! corner that lies on a side.

use drystone_solver::{Vector, moment};

use super::{Frame, Touch, TouchPoint};

/// By how much an axis must win, as part of the prediction distance.
const PREFERENCE: f32 = 0.01;

/// A convex solid with flat faces, in its own frame.
pub(super) trait Solid<const L: usize> {
    /// The farthest vertex along `direction`.
    fn support(&self, direction: Vector<f32, L>) -> Vector<f32, L>;

    /// Number of faces (2D: sides).
    fn faces(&self) -> usize;

    /// Outward unit normal of a face, and one of its vertices.
    fn face(&self, index: usize) -> (Vector<f32, L>, Vector<f32, L>);

    /// Appends the vertices of a face, in order around it.
    fn corners(&self, face: usize, out: &mut Vec<Corner<L>>);
}

/// A vertex of a polygon that is being clipped.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner<const L: usize> {
    pub(super) position: Vector<f32, L>,
    /// What it comes from: a vertex, or an edge cut by a side.
    pub(super) feature: u32,
}

/// Two edges that cross: the axis between them, from a to b, and the nearest points, in the frame
/// of a.
pub(super) struct Crossing<const L: usize> {
    pub(super) axis: Vector<f32, L>,
    pub(super) on_a: Vector<f32, L>,
    pub(super) on_b: Vector<f32, L>,
}

/// Polygons that are reused.
#[derive(Default)]
pub(super) struct Clipper<const L: usize> {
    reference: Vec<Corner<L>>,
    incident: Vec<Corner<L>>,
    next: Vec<Corner<L>>,
}

/// Fills `touch`, in the frame of a, with where `a` and `b` overlap or are within `prediction` \[m\];
/// returns how far they are apart at least, along the best axis that was looked at. \[m\] `from_b` is the frame of b as seen from a; `crossing` proposes an axis that is no face's normal.
pub(super) fn collide<const L: usize>(
    a: &impl Solid<L>,
    b: &impl Solid<L>,
    from_b: &Frame<L>,
    prediction: f32,
    crossing: impl FnOnce(&Rival<L>) -> Option<Crossing<L>>,
    clipper: &mut Clipper<L>,
    touch: &mut Touch<L>,
) -> f32 {
    let margin = PREFERENCE * prediction;
    let far_b = |d| from_b.point(b.support(from_b.local_direction(d)));
    let best_a = best_face(a, from_b.position, prediction, far_b);
    if best_a.gap > prediction {
        return best_a.gap;
    }
    let far_a = |d| from_b.local_point(a.support(from_b.direction(d)));
    let best_b = best_face(b, from_b.local_point(Vector::ZERO), prediction, far_a);
    if best_b.gap > prediction {
        return best_b.gap;
    }
    let ([gap_a, gap_b], [face_a, face_b]) = ([best_a.gap, best_b.gap], [best_a.face, best_b.face]);
    let rival = Rival {
        gap: prediction.min(gap_a.max(gap_b) + margin),
        apart: best_a.far - from_b.point(best_b.far),
        faces: [best_a, best_b],
    };
    if let Some(Crossing { axis, on_a, on_b }) = crossing(&rival) {
        // What the axis really separates, whoever proposed it.
        let far_b = from_b.point(b.support(from_b.local_direction(-axis)));
        let gap = axis.dot(far_b - a.support(axis));
        if gap > prediction {
            return gap;
        }
        if gap > gap_a.max(gap_b) + margin {
            touch.normal = -axis;
            touch.points.push(TouchPoint { on_a, on_b, gap: axis.dot(on_b - on_a), feature: 0 });
            return gap;
        }
    }
    if gap_b > gap_a + margin {
        let from_a = Frame {
            position: from_b.local_point(Vector::ZERO),
            axes: std::array::from_fn(|i| Vector(std::array::from_fn(|j| from_b.axes[j][i]))),
        };
        let normal = clip(b, face_b, a, &from_a, clipper);
        touch.normal = from_b.direction(normal);
        let plane = b.face(face_b).1;
        for corner in &clipper.incident {
            let gap = normal.dot(corner.position - plane);
            touch.points.push(TouchPoint {
                on_a: from_b.point(corner.position),
                on_b: from_b.point(corner.position - normal * gap),
                gap,
                feature: name(1, face_b, corner),
            });
        }
    } else {
        let normal = clip(a, face_a, b, from_b, clipper);
        touch.normal = -normal;
        let plane = a.face(face_a).1;
        for corner in &clipper.incident {
            let gap = normal.dot(corner.position - plane);
            touch.points.push(TouchPoint {
                on_a: corner.position - normal * gap,
                on_b: corner.position,
                gap,
                feature: name(2, face_a, corner),
            });
        }
    }
    touch.points.retain(|point| point.gap <= prediction);
    gap_a.max(gap_b)
}

/// The boundary of a half-space.
pub(super) struct Plane<const L: usize> {
    pub(super) point: Vector<f32, L>,
    /// Out of the half-space.
    pub(super) normal: Vector<f32, L>,
}

/// What of a shape can lie on a plane.
pub(super) enum Footing<'a, H, const L: usize> {
    /// A face.
    Cuboid(&'a Cuboid<L>),
    Hull(&'a H),
    /// Balls of this radius around these centers: a ball, the ends of a capsule.
    Round(&'a [Vector<f32, L>], f32),
}

/// Fills `touch` with where a shape overlaps a half-space or is within `prediction` \[m\] of it; returns how
/// far they are apart \[m\].
/// `from_shape` is the frame of the shape as seen from where `plane` and `touch` are given; the
/// shape is a if `above`, else b.
pub(super) fn on_plane<const L: usize>(
    plane: &Plane<L>,
    footing: &Footing<'_, impl Solid<L>, L>,
    from_shape: &Frame<L>,
    above: bool,
    prediction: f32,
    clipper: &mut Clipper<L>,
    touch: &mut Touch<L>,
) -> f32 {
    let normal = plane.normal;
    let corners = &mut clipper.incident;
    corners.clear();
    let down = from_shape.local_direction(-normal);
    let radius = match *footing {
        Footing::Cuboid(cuboid) => {
            cuboid.corners(facing(cuboid, down), corners);
            0.0
        }
        Footing::Hull(hull) => {
            hull.corners(facing(hull, down), corners);
            0.0
        }
        Footing::Round(centers, radius) => {
            for (feature, &position) in centers.iter().enumerate() {
                corners.push(Corner { position, feature: feature as u32 });
            }
            radius
        }
    };
    touch.normal = if above { normal } else { -normal };
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
        touch.points.push(TouchPoint { on_a, on_b, gap, feature });
    }
    apart
}

fn name<const L: usize>(side: u64, face: usize, corner: &Corner<L>) -> u64 {
    side << 62 | (face as u64) << 32 | u64::from(corner.feature)
}

/// What an axis that is no face's normal has to beat.
pub(super) struct Rival<const L: usize> {
    /// The gap along it. \[m\]
    pub(super) gap: f32,
    /// From a point of a to one of b, in the frame of a: along any axis, the gap is at most this far.
    pub(super) apart: Vector<f32, L>,
    /// The best of a, and of b.
    faces: [Best<L>; 2],
}

impl<const L: usize> Rival<L> {
    /// Whether it is certain that no axis beats it.
    pub(super) fn is_sure(&self, a: &impl Solid<L>, b: &impl Solid<L>) -> bool {
        self.faces[0].is_sure(a) || self.faces[1].is_sure(b)
    }
}

/// A face, how far the other solid is outside of it, and that one's point which is the least far.
struct Best<const L: usize> {
    gap: f32,
    face: usize,
    far: Vector<f32, L>,
}

impl<const L: usize> Best<L> {
    /// Whether no axis can have more gap than this face of `solid`, as it has room about the foot F of
    /// the far point on the face.
    ///
    /// With no overlap, F within the face is enough: the solids are no farther apart than F and the far
    /// point. Let that one be d below F, let the solid hold the disc of radius 3 d in the face about F,
    /// and the point 3 d below F. The gap along an axis at angle t to the normal is at most that between
    /// the far point and any of these: -d (cos t + 3 sin t) and 2 d cos t. One of the two is at most -d.
    fn is_sure(&self, solid: &impl Solid<L>) -> bool {
        let (normal, _) = solid.face(self.face);
        let foot = self.far - normal * self.gap;
        let room = 3.0 * (-self.gap).max(0.0);
        (0..solid.faces()).filter(|&face| face != self.face).all(|face| {
            let (other, vertex) = solid.face(face);
            let (inside, along) = (other.dot(vertex - foot), other.dot(normal));
            let across = (1.0 - along * along).max(0.0);
            inside >= 0.0 && inside * inside >= room * room * across && inside + room * along >= 0.0
        })
    }
}

/// The face that the other solid is farthest outside of (or least inside), or any that it is outside
/// of by more than `enough`. `center` is within the other solid or near it; all in the frame of
/// `solid`.
fn best_face<const L: usize>(
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
    let measure = |face: usize| {
        let (normal, vertex) = solid.face(face);
        let far = other(-normal);
        Best { gap: normal.dot(far - vertex), face, far }
    };
    let mut best = measure(likely.1);
    for face in 0..solid.faces() {
        if best.gap > enough {
            break;
        }
        let (normal, vertex) = solid.face(face);
        // No point of the other solid is less far out than its farthest: most faces lose by one.
        if face == best.face || normal.dot(best.far - vertex) < best.gap {
            continue;
        }
        let own = measure(face);
        if own.gap > best.gap || own.gap == best.gap && face < best.face {
            best = own;
        }
    }
    best
}

/// The face that looks most along `direction`, of those around the farthest vertex: on a hull with a
/// sharp corner, another may look that way more and lie behind.
fn facing<const L: usize>(solid: &impl Solid<L>, direction: Vector<f32, L>) -> usize {
    let farthest = solid.support(direction);
    let mut best = (f32::NEG_INFINITY, 0);
    for index in 0..solid.faces() {
        let (normal, vertex) = solid.face(index);
        let along = normal.dot(direction);
        let arm = farthest - vertex;
        if along > best.0 && normal.dot(arm) >= -1e-4 * arm.length() {
            best = (along, index);
        }
    }
    best.1
}

/// Leaves in `clipper.incident` the part of the incident solid's facing face that lies over the
/// reference face, in the reference solid's frame; returns the reference normal.
fn clip<const L: usize>(
    reference: &impl Solid<L>,
    face: usize,
    incident: &impl Solid<L>,
    from_incident: &Frame<L>,
    clipper: &mut Clipper<L>,
) -> Vector<f32, L> {
    let (normal, _) = reference.face(face);
    clipper.reference.clear();
    clipper.incident.clear();
    reference.corners(face, &mut clipper.reference);
    let against = from_incident.local_direction(-normal);
    incident.corners(facing(incident, against), &mut clipper.incident);
    for corner in &mut clipper.incident {
        corner.position = from_incident.point(corner.position);
    }
    let count = clipper.reference.len();
    for side in 0..count {
        let start = clipper.reference[side].position;
        let end = clipper.reference[(side + 1) % count].position;
        // In the plane, the sides of a side are its ends.
        let outward = if L == 2 { start - end } else { moment(end - start, normal) };
        cut(clipper, side as u32, start, outward);
    }
    normal
}

/// Keeps the part of the incident polygon behind a plane (Sutherland-Hodgman).
fn cut<const L: usize>(
    clipper: &mut Clipper<L>,
    side: u32,
    point: Vector<f32, L>,
    outward: Vector<f32, L>,
) {
    // A corner that lies on the plane is inside.
    let tolerance = 1e-4 * outward.dot(outward);
    let height = |corner: &Corner<L>| outward.dot(corner.position - point);
    clipper.next.clear();
    let count = clipper.incident.len();
    for i in 0..count {
        let (here, there) = (clipper.incident[i], clipper.incident[(i + 1) % count]);
        let (h, t) = (height(&here), height(&there));
        if h <= tolerance {
            clipper.next.push(here);
        }
        if (h <= tolerance) != (t <= tolerance) {
            // Where both are near the plane on the same side of it, its line meets it far away.
            let part = (h / (h - t)).clamp(0.0, 1.0);
            clipper.next.push(Corner {
                position: here.position + (there.position - here.position) * part,
                feature: 1 << 31 | side << 16 | (here.feature.min(there.feature) & 0xffff),
            });
        }
    }
    std::mem::swap(&mut clipper.incident, &mut clipper.next);
}

/// A box of any dimension, by its half extents.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cuboid<const L: usize>(pub(super) Vector<f32, L>);

impl<const L: usize> Solid<L> for Cuboid<L> {
    fn support(&self, direction: Vector<f32, L>) -> Vector<f32, L> {
        Vector(std::array::from_fn(|i| self.0[i].copysign(direction[i])))
    }

    fn faces(&self) -> usize {
        2 * L
    }

    fn face(&self, index: usize) -> (Vector<f32, L>, Vector<f32, L>) {
        let sign = if index < L { 1.0 } else { -1.0 };
        let mut normal = Vector::ZERO;
        normal[index % L] = sign;
        (normal, self.0 * sign)
    }

    fn corners(&self, face: usize, out: &mut Vec<Corner<L>>) {
        let axis = face % L;
        let sign = if face < L { 1.0 } else { -1.0 };
        let (u, v) = ((axis + 1) % L, (axis + 2) % L);
        // Counter-clockwise seen from outside, as clip's sides need them.
        let around: &[(f32, f32)] = match (L, sign > 0.0) {
            (2, true) => &[(-1.0, 0.0), (1.0, 0.0)],
            (2, false) => &[(1.0, 0.0), (-1.0, 0.0)],
            (_, true) => &[(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)],
            (_, false) => &[(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)],
        };
        for &(s, t) in around {
            let mut position = self.0;
            position[axis] *= sign;
            position[u] = s * self.0[u];
            if L > 2 {
                position[v] = t * self.0[v];
            }
            let mut feature = 0;
            for i in 0..L {
                feature |= u32::from(position[i] > 0.0) << i;
            }
            out.push(Corner { position, feature });
        }
    }
}

impl Solid<2> for parry2d::shape::ConvexPolygon {
    fn support(&self, direction: Vector<f32, 2>) -> Vector<f32, 2> {
        farthest(self.points(), direction.0.into(), |p, d| p.dot(d)).to_array().into()
    }

    fn faces(&self) -> usize {
        self.points().len()
    }

    fn face(&self, index: usize) -> (Vector<f32, 2>, Vector<f32, 2>) {
        (self.normals()[index].to_array().into(), self.points()[index].to_array().into())
    }

    fn corners(&self, face: usize, out: &mut Vec<Corner<2>>) {
        for index in [face, (face + 1) % self.points().len()] {
            let position = self.points()[index].to_array().into();
            out.push(Corner { position, feature: index as u32 });
        }
    }
}

fn farthest<V: Copy>(points: &[V], direction: V, dot: impl Fn(V, V) -> f32) -> V {
    let mut best = (f32::NEG_INFINITY, 0);
    for (i, point) in points.iter().enumerate() {
        let along = dot(*point, direction);
        if along > best.0 {
            best = (along, i);
        }
    }
    points[best.1]
}

/// The axis across two edges, one of each box, that separates them most and more than the rival, with
/// the points where the edges are nearest.
pub(super) fn box_edges(
    a: &Cuboid<3>,
    b: &Cuboid<3>,
    from_b: &Frame<3>,
    rival: &Rival<3>,
) -> Option<Crossing<3>> {
    let mut best: Option<(f32, Crossing<3>)> = None;
    let least = rival.gap * rival.gap.abs();
    for i in 0..3 {
        let mut edge_a = Vector::ZERO;
        edge_a[i] = 1.0;
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        for edge_b in from_b.axes {
            let mut across = Vector::ZERO;
            (across[j], across[k]) = (-edge_b[k], edge_b[j]);
            let squared = across.dot(across);
            // Parallel edges: a face's normal is as good.
            if squared < 1e-6 {
                continue;
            }
            let outward = if across.dot(from_b.position) < 0.0 { -1.0 } else { 1.0 };
            // At most this gap, times the length; compared as squares that keep their sign.
            let most = outward * across.dot(rival.apart);
            if most * most.abs() <= least * squared {
                continue;
            }
            let axis = across * (outward / squared.sqrt());
            let far_a = a.support(axis);
            let far_b = from_b.point(b.support(from_b.local_direction(-axis)));
            let gap = axis.dot(far_b - far_a);
            if best.as_ref().is_none_or(|(most, _)| gap > *most) {
                // Nearest points of the lines far_a + s edge_a and far_b + t edge_b.
                let between = far_b - far_a;
                let skew = edge_a.dot(edge_b);
                let (p, q) = (between.dot(edge_a), between.dot(edge_b));
                let squared = 1.0 - skew * skew;
                let (s, t) = ((p - skew * q) / squared, (skew * p - q) / squared);
                let crossing =
                    Crossing { axis, on_a: far_a + edge_a * s, on_b: far_b + edge_b * t };
                best = Some((gap, crossing));
            }
        }
    }
    best.map(|(_, crossing)| crossing)
}

#[cfg(test)]
mod tests;
