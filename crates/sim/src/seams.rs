//! Which way bodies are held apart where they meet at a corner.
//!
//! Two solids that are apart along several axes are parted by each of them, and the axis with the most gap
//! (the one that [`Geometry::collide`] reports) may be the wrong one: a box that slides over the seam
//! between two flush boxes has room ahead of the next one's side, and none above its top. Two rules decide:
//!
//! 1. An axis holds bodies apart if they have a gap along it. An overlap counts as none that is no more than
//!    what a contact of one of them sags, where that contact holds it above a plane and the other does not
//!    stick out of that plane by more.
//! 2. Of these axes the one counts along which the bodies overlap least after the motion that lies ahead of
//!    them, what holds them taken into account.
//!
//! So nothing runs into the side of what does not stick out of the floor, and a step that does stops it.

use drystone_solver::wide::Reuse;
use drystone_solver::{Vector, Velocity};

use crate::bodies::Bodies;
use crate::cache::{CachedManifold, ManifoldCache, Pair, deepest_first};
use crate::geometry::{Curvature, Frame, Geometry, NormalCarrier};

/// A neighbor that sticks out of a plane by less than this part of the thinner shape is flush with it. \[1\]
const FLUSH: f32 = 5e-4;

/// Neighbors may differ by what they sag, too, and by what that adds to the one below: so many times the
/// overlap with the plane is allowed for. \[1\]
const SAGS: f32 = 3.0;

/// No more of an overlap than this part of the thinner shape is taken for sag. \[1\]
const MOST_SAG: f32 = 0.05;

/// Bodies may come so many times as far as they do at the velocities at the start: contacts that they all but reach
/// count, too. \[1\]
pub(crate) const AHEAD: f32 = 1.1;

/// Bodies that touch are at rest if they come closer by less than this part of the thinner shape until the next search.
/// \[1\]
pub(crate) const STILL: f32 = 2e-4;

/// The cosine of two axes that are one. \[1\]
const SAME: f32 = 1.0 - 1e-6;

/// A plane whose normal has a cosine of less than this with an axis holds nothing along that. \[1\]
const ACROSS: f32 = 0.7;

/// Planes that are compared for one manifold, at most.
const PLANES: usize = 32;

/// Where the points of turned manifolds are said to have been found: so far away that they are found again
/// in the next step. \[m\]
const NOWHERE: f32 = 1e9;

/// A manifold whose bodies come closer than its gap: the number of its pair, and which of its records it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Approaching {
    pub(crate) pair: u32,
    pub(crate) record: u32,
}

/// What decides how bodies meet.
pub(crate) struct SeamInput<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) shapes: &'a [G::Collider],
    /// Poses of the shapes, turned with their bodies but seen from their centers of mass.
    pub(crate) poses: &'a [G::Pose],
    pub(crate) bodies: &'a Bodies<G, L, A>,
    pub(crate) velocities: &'a [Velocity<f32, L, A>],
    /// The time to the next search. \[s\]
    pub(crate) dt: f32,
}

/// Memory for [`settle`](Self::settle).
#[derive(Default)]
pub(crate) struct SeamResolver<const L: usize> {
    /// By body: the first of its records, twice its number and 1 more for b's side.
    first: Vec<u32>,
    /// By record and side: the next one of the same body.
    next: Vec<u32>,
    turns: Vec<AxisChange<L>>,
}

/// A record has been turned to another axis than it was found with.
pub(crate) fn is_turned<const L: usize>(record: &CachedManifold<L>) -> bool {
    record.found_at.position[0] == NOWHERE
}

/// No further record.
const END: u32 = u32::MAX;

/// A manifold that is turned to another axis.
#[derive(Clone, Copy)]
struct AxisChange<const L: usize> {
    closing: Approaching,
    record: u32,
    /// The record of the plane that allows it; [`END`]: none.
    plane: u32,
    /// Whose points it keeps: of a body that is held, or else that another's face passes.
    side: usize,
    way: SeparatingAxis<L>,
}

/// An axis between two bodies.
#[derive(Clone, Copy)]
struct SeparatingAxis<const L: usize> {
    /// From b to a.
    axis: Vector<f32, L>,
    /// \[m\]
    gap: f32,
    /// How far b reaches along the axis, from the center of mass of b. \[m\]
    height: f32,
}

/// A contact that holds one of two bodies above a plane.
#[derive(Clone, Copy)]
struct HoldingPlane<const L: usize> {
    record: u32,
    /// Whether a (0) or b (1) is held.
    side: usize,
    /// From b to a, whichever of them is held.
    axis: Vector<f32, L>,
    /// An overlap along the axis that is none. \[m\]
    allowed: f32,
    /// The body that holds it, and the gap to that. \[m\]
    holder: u32,
    gap: f32,
}

impl<const L: usize> HoldingPlane<L> {
    /// Towards the body that is held.
    fn outward(&self) -> Vector<f32, L> {
        self.axis * if self.side == 0 { 1.0 } else { -1.0 }
    }

    const NONE: Self =
        Self { record: END, side: 0, axis: Vector::ZERO, allowed: 0.0, holder: 0, gap: 0.0 };
}

/// A manifold with the frames and poses of its bodies, from the center of mass of b.
struct SeamPair<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    shapes: [&'a G::Collider; 2],
    poses: [G::Pose; 2],
    frames: [Frame<L>; 2],
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> SeamPair<'_, G, L, A> {
    /// How far the bodies are apart along an axis from b to a; `None` of what has no end.
    fn along(&self, axis: Vector<f32, L>) -> Option<SeparatingAxis<L>> {
        let farthest = |side: usize, direction: Vector<f32, L>| {
            let far = G::farthest(self.shapes[side], &self.poses[side], direction)?;
            Some(direction.dot(far))
        };
        let height = farthest(1, axis)?;
        Some(SeparatingAxis { axis, gap: -farthest(0, -axis)? - height, height })
    }

    /// By how much both are round about their cores where they face each other. \[m\]
    fn roundness(&self, normal: Vector<f32, L>) -> [f32; 2] {
        [0, 1].map(|side| G::roundness(self.shapes[side], &self.poses[side], normal))
    }
}

impl<const L: usize> SeamResolver<L> {
    /// Turns manifolds to the axes along which their bodies are held apart. They are decided one by one, by
    /// the manifolds as they were found, so their order does not matter.
    pub(crate) fn settle<G: Geometry<L, A>, const A: usize>(
        &mut self,
        meeting: &SeamInput<'_, G, L, A>,
        closing: impl Iterator<Item = Approaching>,
        pairs: &mut [Pair],
        records: &mut ManifoldCache<L>,
    ) {
        self.turns.clear();
        let mut linked = false;
        for closing in closing {
            if !std::mem::replace(&mut linked, true) {
                self.link(meeting.bodies, records);
            }
            let pair = &pairs[closing.pair as usize];
            let record = pair.first + closing.record;
            let turn = self.decide(meeting, (pair, closing), record, records);
            let Some(turn) = turn else { continue };
            // Two do not stand aside for each other.
            let mutual = self.turns.binary_search_by_key(&turn.plane, |other| other.record);
            if !mutual.is_ok_and(|at| self.turns[at].plane == record) {
                self.turns.push(turn);
            }
        }
        records.manifolds.iter_mut().for_each(|record| record.undecided = false);
        for turn in &self.turns {
            let pair = &mut pairs[turn.closing.pair as usize];
            meeting.turn(pair, turn, records);
        }
    }

    /// Links the records of each body that can be moved.
    fn link<G: Geometry<L, A>, const A: usize>(
        &mut self,
        bodies: &Bodies<G, L, A>,
        records: &ManifoldCache<L>,
    ) {
        self.first.clear();
        self.first.resize(bodies.poses.len(), END);
        self.next.clear();
        self.next.resize(2 * records.manifolds.len(), END);
        for (number, record) in records.manifolds.iter().enumerate().rev() {
            for (side, &body) in record.bodies.iter().enumerate() {
                if bodies.is_dynamic(body as usize) {
                    let own = 2 * number + side;
                    self.next[own] = std::mem::replace(&mut self.first[body as usize], own as u32);
                }
            }
        }
    }

    /// The records of a body, and whether it is their b.
    fn of(&self, body: u32) -> impl Iterator<Item = (u32, bool)> {
        let start = Some(self.first[body as usize]).filter(|&at| at != END);
        let after = |at: &u32| Some(self.next[*at as usize]).filter(|&at| at != END);
        std::iter::successors(start, after).map(|at| (at / 2, at % 2 == 1))
    }

    /// The planes above which contacts hold one of the bodies of a manifold that touch at these `places`, if the
    /// other does not stick out of them there; and how many they are.
    fn planes<G: Geometry<L, A>, const A: usize>(
        &self,
        bodies: &Bodies<G, L, A>,
        (pair, record): (&Pair, &CachedManifold<L>),
        (number, places): (u32, &[Vector<f32, L>; 2]),
        records: &ManifoldCache<L>,
    ) -> ([HoldingPlane<L>; PLANES], usize) {
        let (view, mut planes, mut count) = (records.view(), [HoldingPlane::NONE; PLANES], 0);
        for side in 0..2 {
            let others = self.of(record.bodies[side]).filter(|(other, _)| *other != number);
            for (other, is_b) in others.take(PLANES) {
                let holding = &records.manifolds[other as usize];
                let outward = holding.normal * if is_b { -1.0 } else { 1.0 };
                let axis = outward * if side == 0 { 1.0 } else { -1.0 };
                if axis.dot(record.normal) > SAME || count == PLANES {
                    continue;
                }
                let gap = view.traces_of(holding)[0].gap[0];
                let place = view.points_of(holding)[0].push_point
                    + bodies.apart([holding.bodies[1], record.bodies[1]]);
                let sag = (-gap).max(0.0);
                let allowed = (SAGS * sag + FLUSH * pair.thickness).min(MOST_SAG * pair.thickness);
                if outward.dot(places[1 - side] - place) <= allowed {
                    let holder = holding.bodies[usize::from(!is_b)];
                    planes[count] =
                        HoldingPlane { record: other, side, axis, allowed, holder, gap };
                    count += 1;
                }
            }
        }
        (planes, count)
    }

    /// How to turn a manifold, if it is to be turned.
    fn decide<G: Geometry<L, A>, const A: usize>(
        &self,
        meeting: &SeamInput<'_, G, L, A>,
        (pair, closing): (&Pair, Approaching),
        number: u32,
        records: &ManifoldCache<L>,
    ) -> Option<AxisChange<L>> {
        let (view, bodies) = (records.view(), meeting.bodies);
        let record = &records.manifolds[number as usize];
        let corner = meeting.corner(pair);
        let (normal, gap) = (record.normal, view.traces_of(record)[0].gap[0]);
        let point = &view.points_of(record)[0];
        let places = [corner.frames[0].point(point.on_a), corner.frames[1].point(point.on_b)];
        let (planes, count) = self.planes(bodies, (pair, record), (number, &places), records);
        let planes = &planes[..count];
        // A contact that touches, and that no plane holds, is no side of a neighbor. So are nearly all of a heap.
        if gap <= 0.0 && planes.is_empty() {
            return None;
        }
        let velocity = |body: u32, place: Vector<f32, L>| {
            let center = bodies.apart([body, record.bodies[1]]);
            meeting.velocities[body as usize].at(place - center)
        };
        // What is round goes where its core goes, however it turns.
        let round = corner.roundness(normal);
        let cores = [places[0] + normal * round[0], places[1] - normal * round[1]];
        let mut velocities = [0, 1].map(|side| velocity(record.bodies[side], cores[side]));
        for plane in planes {
            // The holder leaves the body no more than this gap to move by.
            let outward = plane.outward();
            if outward.dot(normal).abs() < ACROSS {
                let by = velocity(plane.holder, cores[plane.side]);
                let towards = outward.dot(velocities[plane.side] - by);
                let least = -plane.gap.max(0.0) / meeting.dt;
                velocities[plane.side] += outward * (least - towards).max(0.0);
            }
        }
        let mut ahead = (velocities[0] - velocities[1]) * (AHEAD * meeting.dt);
        // Bodies that touch and hardly move stay as they were: else rest would tremble.
        if gap <= 0.0 && normal.dot(ahead).abs() <= STILL * pair.thickness {
            if !record.undecided {
                return None;
            }
            ahead = Vector::ZERO;
        }
        let mut most = gap + normal.dot(ahead);
        if most >= gap.max(0.0) {
            return None;
        }
        let mut best = None;
        let mut ask = |axis: Vector<f32, L>, allowed: f32, plane: u32, side: usize| {
            let Some(way) = corner.along(axis).filter(|way| way.gap >= -allowed) else { return };
            let then = way.gap.max(0.0) + axis.dot(ahead);
            // Where nothing holds it, it must pass.
            if then > most && (plane != END || then >= 0.0) {
                most = then;
                best = Some(AxisChange { closing, record: number, plane, side, way });
            }
        };
        for plane in planes {
            ask(plane.axis, plane.allowed, plane.record, plane.side);
        }
        // A body on a plane touches the other's side below its edge: by what it sags, and by what it still climbs on its
        // way there.
        let until = gap.max(0.0) / -normal.dot(ahead).min(-f32::MIN_POSITIVE);
        let near = planes.iter().fold(FLUSH * pair.thickness, |most, plane| {
            let up = plane.axis - normal * plane.axis.dot(normal);
            let climbs = up.dot(ahead).abs() / up.length() * until.min(1.0);
            most.max(plane.allowed + climbs)
        });
        for side in 0..2 {
            let mut face = |outward: Vector<f32, L>| {
                let axis = outward * if side == 0 { -1.0 } else { 1.0 };
                if axis.dot(normal) > SAME {
                    return;
                }
                let alike = |plane: &&HoldingPlane<L>| plane.axis.dot(axis) >= ACROSS;
                let held = planes
                    .iter()
                    .filter(alike)
                    .max_by(|p, q| p.allowed.total_cmp(&q.allowed).then(q.record.cmp(&p.record)));
                match held {
                    Some(held) => ask(axis, held.allowed, held.record, held.side),
                    None => ask(axis, 0.0, END, 1 - side),
                }
            };
            let (shape, pose) = (corner.shapes[side], &corner.poses[side]);
            G::faces_at(shape, pose, places[side], near, &mut face);
        }
        best
    }
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> SeamInput<'_, G, L, A> {
    fn corner(&self, pair: &Pair) -> SeamPair<'_, G, L, A> {
        let [a, b] = pair.bodies.map(|body| body as usize);
        let [shape_a, shape_b] = pair.colliders.map(|shape| shape as usize);
        let apart = self.bodies.apart(pair.bodies);
        let frames = &self.bodies.frames;
        SeamPair {
            shapes: [&self.shapes[shape_a], &self.shapes[shape_b]],
            poses: [G::advance(&self.poses[shape_a], apart, Vector::ZERO), self.poses[shape_b]],
            frames: [
                Frame { position: apart, ..frames[a] },
                Frame { position: Vector::ZERO, ..frames[b] },
            ],
        }
    }

    /// Turns a manifold. Its points stay where they are on one of the bodies; one that is round is touched where it
    /// is nearest along the new axis.
    fn turn(&self, pair: &mut Pair, turn: &AxisChange<L>, records: &mut ManifoldCache<L>) {
        let SeparatingAxis { axis, gap, height } = turn.way;
        let reuse = &mut records.reuse[turn.record as usize];
        let kept = matches!(reuse, Reuse::Kept(_));
        *reuse = reuse.changed();
        let mut all = records.view_mut();
        let (record, points, traces) = all.place(turn.record as usize);
        if kept {
            record.traced = record.normal;
        }
        let corner = self.corner(pair);
        let [a, b] = &corner.frames;
        let of_a = turn.side == 0;
        let around = corner.roundness(record.normal)[turn.side];
        let moved = (record.normal - axis) * if of_a { around } else { -around };
        for (point, trace) in points.iter_mut().zip(&mut *traces) {
            let own = if of_a { a.point(point.on_a) } else { b.point(point.on_b) } + moved;
            let along = axis.dot(own);
            let gap = if of_a { along - height } else { gap + height - along };
            let [on_a, on_b] = if of_a { [own, own - axis * gap] } else { [own + axis * gap, own] };
            (point.on_a, point.on_b) = (a.local_point(on_a), b.local_point(on_b));
            point.push_point = if of_a { on_a } else { on_b };
            trace.gap[0] = gap;
        }
        deepest_first(points, traces);
        record.normal = axis;
        // The plane that the points lie on carries the normal.
        record.surfaces = if of_a {
            Curvature { radii: [around, 0.0], normal: NormalCarrier::FaceOfB }
        } else {
            Curvature { radii: [0.0, around], normal: NormalCarrier::FaceOfA }
        };
        record.local_normal = record.carrier(a, b).local_direction(axis);
        record.found_at.position = Vector([NOWHERE; L]);
        pair.room = 0.0;
    }
}
