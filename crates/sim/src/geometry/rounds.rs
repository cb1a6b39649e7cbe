//! Contact of balls and capsules with each other and with boxes and hulls.
//!
//! A round shape is a core, a point or a segment, with a radius about it. The nearest points of two
//! shapes are on the line through the nearest points of their cores.

use drystone_solver::Vector;

use super::particles::between_balls;
use super::polyhedra::{Clipper, FaceOf, Known, best_face, edges_feature, measure};
use super::solid::Solid;
use super::{ContactManifold, Curvature, Frame, ManifoldPoint, NormalCarrier};

/// A ball or a capsule: the ends of its core, which coincide for a ball, and its radius. \[m\]
#[derive(Clone, Copy, Debug)]
pub(super) struct RoundedCore<const L: usize> {
    pub(super) ends: [Vector<f32, L>; 2],
    pub(super) radius: f32,
}

/// Cores at an angle whose sine is less than this count as parallel. \[1\]
const PARALLEL: f32 = 0.1;

/// A point between the outer ones counts if it is deeper by this fraction of the prediction
/// distance. \[1\]
const DEEPER: f32 = 0.01;

/// A core over an edge counts as over the face if the squared cosine between its direction and the
/// face's normal is more than this. So a capsule across a box rests on both edges. \[1\]
const UPRIGHT: f32 = 0.999;

impl<const L: usize> RoundedCore<L> {
    /// Transforms it from `frame` to the coordinates in which `frame` is given.
    pub(super) fn placed(&self, frame: &Frame<L>) -> Self {
        Self { ends: self.ends.map(|end| frame.point(end)), ..*self }
    }

    fn along(&self) -> Vector<f32, L> {
        self.ends[1] - self.ends[0]
    }

    /// Returns the point at `part` of the core, from 0 to 1.
    pub(super) fn at(&self, part: f32) -> Vector<f32, L> {
        self.ends[0] + self.along() * part
    }

    /// Returns the end that is farther along a direction.
    fn farther(&self, direction: Vector<f32, L>) -> Vector<f32, L> {
        self.ends[usize::from(direction.dot(self.along()) > 0.0)]
    }

    /// Returns the position of the point nearest to `point` on the core, from 0 to 1.
    fn nearest(&self, point: Vector<f32, L>) -> f32 {
        let along = self.along();
        let squared = along.dot(along);
        if squared > 0.0 {
            (along.dot(point - self.ends[0]) / squared).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }
}

/// Returns the positions of the nearest points on two cores, from 0 to 1.
pub(super) fn nearest<const L: usize>(a: &RoundedCore<L>, b: &RoundedCore<L>) -> [f32; 2] {
    let (along_a, along_b, between) = (a.along(), b.along(), a.ends[0] - b.ends[0]);
    let (squared_a, squared_b) = (along_a.dot(along_a), along_b.dot(along_b));
    let both = along_a.dot(along_b);
    // Squared sine of the angle, times both squared lengths.
    let sine = squared_a * squared_b - both * both;
    let refined = |s: f32| {
        let t = b.nearest(a.at(s));
        [a.nearest(b.at(t)), t]
    };
    if sine > 1e-7 * squared_a * squared_b {
        let line = both * along_b.dot(between) - squared_b * along_a.dot(between);
        return refined((line / sine).clamp(0.0, 1.0));
    }
    // The cores are parallel: rounding decides which end is nearer.
    let apart = |&[s, t]: &[f32; 2]| {
        let apart = a.at(s) - b.at(t);
        apart.dot(apart)
    };
    let ends = [refined(0.0), refined(1.0)];
    if apart(&ends[1]) < apart(&ends[0]) { ends[1] } else { ends[0] }
}

/// Fills `touch` with the contact points of two round shapes in one frame, up to a gap of
/// `prediction` \[m\]. Returns the gap. \[m\]
pub(super) fn between_rounds<const L: usize>(
    a: &RoundedCore<L>,
    b: &RoundedCore<L>,
    prediction: f32,
    touch: &mut ContactManifold<L>,
) -> f32 {
    let [s, t] = nearest(a, b);
    let (normal, gap) = between_balls(a.at(s) - b.at(t), [a.radius, b.radius]);
    if gap > prediction {
        return gap;
    }
    touch.normal = normal;
    touch.surfaces = Curvature { radii: [a.radius, b.radius], normal: NormalCarrier::Centers };
    let point = |s: f32, t: f32, feature: u64| {
        let (on_a, on_b) = (a.at(s) - normal * a.radius, b.at(t) + normal * b.radius);
        ManifoldPoint { on_a, on_b, gap: normal.dot(on_a - on_b), feature }
    };
    let (along_a, along_b) = (a.along(), b.along());
    let most = along_a.dot(along_a) * along_b.dot(along_b);
    let across = most - along_a.dot(along_b) * along_a.dot(along_b);
    if across < PARALLEL * PARALLEL * most {
        let parts = b.ends.map(|end| a.nearest(end));
        let outer = [parts[0].min(parts[1]), parts[0].max(parts[1])];
        let outer = [(outer[0], 1), (outer[1], 2)];
        let outer = outer.map(|(s, feature)| point(s, b.nearest(a.at(s)), feature));
        if outer[0].on_a != outer[1].on_a {
            touch.points.extend(outer.iter().filter(|outer| outer.gap <= prediction));
            if outer.iter().all(|outer| outer.gap > gap + DEEPER * prediction) {
                touch.points.push(point(s, t, 0));
            }
            return gap;
        }
    }
    touch.points.push(point(s, t, 0));
    gap
}

/// Fills `touch` with the contact points of a round shape, as a, and a solid, as b, in the frame of
/// the solid. Points count up to a gap of `prediction` \[m\].
///
/// Returns a lower bound of the gap \[m\], or `None` if the core is in the solid and no face is
/// certain to be the nearest. `before` is the feature of a contact point of the step before.
pub(super) fn on_solid<const L: usize>(
    round: &RoundedCore<L>,
    solid: &impl Solid<L>,
    prediction: f32,
    before: Option<u64>,
    clipper: &mut Clipper<L>,
    touch: &mut ContactManifold<L>,
) -> Option<f32> {
    let reach = prediction + round.radius;
    let farther = |direction| round.farther(direction);
    // The feature of the step before usually touches again.
    let mut known = None;
    match before.map_or(Known::Nothing, Known::of) {
        Known::Face(FaceOf { face, .. }) if face < solid.faces() => {
            known = Some(measure(solid, face, farther))
                .filter(|known| known.gap > reach || known.is_sure(solid));
        }
        Known::Edges([_, edge]) if edge < solid.edges() => {
            let own = NearestOnEdge::of(round, solid, edge);
            if own.is_nearest(solid) && (0..solid.faces()).all(|face| !own.is_upright(solid, face))
            {
                return Some(own.touch(round, prediction, touch));
            }
        }
        _ => {}
    }
    let sure = known.is_some();
    let best = known.unwrap_or_else(|| best_face(solid, round.at(0.5), reach, farther));
    let gap = best.gap - round.radius;
    if best.gap > reach {
        return Some(gap);
    }
    if sure || best.is_sure(solid) {
        let lowest = round.nearest(best.far);
        on_face(round, lowest, solid, best.face, prediction, clipper, touch);
        return Some(gap);
    }
    if best.gap <= 0.0 && enters(round, solid) {
        return None;
    }
    // The nearest feature is an edge, usually of that face.
    let around = NearestOnEdge::among(solid.around(best.face), round, solid);
    let nearest = match around.filter(|own| own.is_nearest(solid)) {
        Some(nearest) => nearest,
        None => NearestOnEdge::among(0..solid.edges(), round, solid)?,
    };
    if best.gap > 0.0 && nearest.is_upright(solid, best.face) {
        on_face(round, nearest.part, solid, best.face, prediction, clipper, touch);
        return Some(gap);
    }
    Some(nearest.touch(round, prediction, touch))
}

/// The nearest points of an edge of a solid and a core.
struct NearestOnEdge<const L: usize> {
    number: usize,
    edge: RoundedCore<L>,
    /// Position on the core, from 0 to 1.
    part: f32,
    /// Point on the edge. \[m\]
    point: Vector<f32, L>,
    /// From the edge to the core. \[m\]
    apart: Vector<f32, L>,
}

impl<const L: usize> NearestOnEdge<L> {
    /// Returns the nearest of some edges.
    fn among(
        edges: impl Iterator<Item = usize>,
        round: &RoundedCore<L>,
        solid: &impl Solid<L>,
    ) -> Option<Self> {
        let edges = edges.map(|edge| Self::of(round, solid, edge));
        edges.min_by(|a, b| a.squared().total_cmp(&b.squared()))
    }

    fn of(round: &RoundedCore<L>, solid: &impl Solid<L>, number: usize) -> Self {
        let edge = RoundedCore { ends: solid.edge(number), radius: 0.0 };
        let [part, t] = nearest(round, &edge);
        let point = edge.at(t);
        Self { number, edge, part, point, apart: round.at(part) - point }
    }

    fn squared(&self) -> f32 {
        self.apart.dot(self.apart)
    }

    /// True if no feature of the solid is nearer, to within rounding: no point of the solid is
    /// farther along the direction to the core.
    fn is_nearest(&self, solid: &impl Solid<L>) -> bool {
        let farther = solid.support(self.apart) - self.point;
        self.apart.dot(farther) < 1e-4 * self.squared()
    }

    /// True if the direction to the core is nearly the normal of a face.
    fn is_upright(&self, solid: &impl Solid<L>, face: usize) -> bool {
        let upright = solid.face(face).0.dot(self.apart);
        upright > 0.0 && upright * upright >= UPRIGHT * self.squared()
    }

    fn touch(
        &self,
        round: &RoundedCore<L>,
        prediction: f32,
        touch: &mut ContactManifold<L>,
    ) -> f32 {
        let gap = between_rounds(round, &self.edge, prediction, touch);
        for point in &mut touch.points {
            point.feature = edges_feature([point.feature as usize, self.number]);
        }
        gap
    }
}

/// True if part of a core is inside a solid.
fn enters<const L: usize>(round: &RoundedCore<L>, solid: &impl Solid<L>) -> bool {
    let mut within = [0.0, 1.0];
    for face in 0..solid.faces() {
        let (normal, vertex) = solid.face(face);
        behind(&mut within, normal.dot(round.ends[0] - vertex), normal.dot(round.along()));
    }
    within[0] <= within[1]
}

/// Restricts a range of a core to the part behind a plane. `height` is the height of the core's
/// start above the plane, `rise` the height of its end above its start.
fn behind(range: &mut [f32; 2], height: f32, rise: f32) {
    if rise > 0.0 {
        range[1] = range[1].min(-height / rise);
    } else if rise < 0.0 {
        range[0] = range[0].max(-height / rise);
    } else if height > 0.0 {
        *range = [1.0, 0.0];
    }
}

/// Adds the contact points of a core with a face: the ends of the part over the face, extended to
/// the `lowest` point.
fn on_face<const L: usize>(
    round: &RoundedCore<L>,
    lowest: f32,
    solid: &impl Solid<L>,
    face: usize,
    prediction: f32,
    clipper: &mut Clipper<L>,
    touch: &mut ContactManifold<L>,
) {
    let (normal, vertex) = solid.face(face);
    let along = round.along();
    let mut over = [0.0, 1.0];
    solid.sides(face, &mut clipper.reference, |point, outward| {
        behind(&mut over, outward.dot(round.ends[0] - point), outward.dot(along));
    });
    touch.normal = normal;
    touch.surfaces = Curvature { radii: [round.radius, 0.0], normal: NormalCarrier::FaceOfB };
    let parts = if over[0] < over[1] {
        [over[0].min(lowest), over[1].max(lowest)]
    } else {
        [lowest, lowest]
    };
    let count = if parts[0] == parts[1] || along == Vector::ZERO { 1 } else { 2 };
    for (end, part) in (0..).zip(&parts[..count]) {
        let on_a = round.at(*part) - normal * round.radius;
        let gap = normal.dot(on_a - vertex);
        if gap <= prediction {
            let feature = FaceOf { b: true, face }.feature(end);
            touch.points.push(ManifoldPoint { on_a, on_b: on_a - normal * gap, gap, feature });
        }
    }
}

#[cfg(test)]
mod tests;
