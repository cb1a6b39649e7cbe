//! Contact patches of compounds: points that two bodies share in one plane form one patch, and
//! covered sides between parts have no contacts.
//!
//! 1. A contact with a side of a part is opened if another part of the same body covers that side.
//!    An open contact has such a large gap that it takes no impulse. So bricks of four parts that
//!    stand on each other do not push sideways at the seams between the parts.
//! 2. If the gaps of all points in a plane are those between two planes, the outermost points
//!    determine them. The inner points are opened.
//!
//! Each part of a body that lies on another body has a manifold of its own. Two bricks of five
//! parts share up to 36 points in one plane, where four are enough. Which of them carry the load is
//! not determined. Sweeps then shift the load between them, and a tower of such bricks creeps
//! sideways.

use drystone_solver::Vector;
use drystone_solver::lanes::{FAR, Reuse};

use crate::bodies::Bodies;
use crate::cache::{self, ManifoldCache, Pair, deepest_first};
use crate::colliders::Colliders;
use crate::geometry::{ContactManifold, Geometry, MAX_POINTS, ManifoldPoint};

/// Normals with a larger cosine between them count as equal. \[1\]
const SAME: f32 = 1.0 - 1e-4;

/// A point is in a plane if its distance is at most this fraction of the extent of the patch. \[1\]
const FLAT: f32 = 1e-4;

/// A part covers a side if its distance from it is at most this fraction of the thinner shape.
/// \[1\]
const FLUSH: f32 = 5e-4;

/// Distance in front of a side at which a cover is looked for, as a multiple of that tolerance.
/// \[1\]
const AHEAD: f32 = 4.0;

/// A patch has a width if it is more than this fraction of its length. \[1\]
const WIDE: f32 = 0.05;

/// Finds and reduces the contact patches of bodies with several shapes.
#[derive(Default)]
pub(crate) struct Patches<const L: usize> {
    /// Manifolds of compounds in this step, and those of bodies that have moved.
    all: Vec<Part>,
    parts: Vec<Part>,
    /// Manifolds to be opened.
    none: Vec<u32>,
    /// Points in a plane: all, and those that are kept. Their features are indices into `places`.
    plane: Vec<ManifoldPoint<L>>,
    touch: ContactManifold<L>,
    places: Vec<[usize; 2]>,
}

/// A manifold of two bodies of which one has several shapes.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Part {
    bodies: [u32; 2],
    record: u32,
    pair: u32,
    /// True if its surfaces have no surface velocity and no rolling resistance.
    plain: bool,
}

/// Shapes and bodies, by which positions are tested.
pub(crate) struct Shapes<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) colliders: &'a Colliders<G, L, A>,
    pub(crate) bodies: &'a Bodies<G, L, A>,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Shapes<'_, G, L, A> {
    /// True if a shape of a pair contains `place`, from the center of mass of b, or is within
    /// `near` of it. \[m\]
    fn hold(&self, pair: &Pair, side: usize, place: Vector<f32, L>, near: f32) -> bool {
        let shape = pair.colliders[side] as usize;
        let place = if side == 0 { place - self.bodies.apart(pair.bodies) } else { place };
        G::holds(&self.colliders.shapes[shape], &self.colliders.poses[shape], place, near)
    }
}

impl<const L: usize> Patches<L> {
    /// Finds the manifolds of compounds that have changed, and opens those between covered sides.
    pub(crate) fn find<G: Geometry<L, A>, const A: usize>(
        &mut self,
        pairs: &[Pair],
        shapes: &Shapes<'_, G, L, A>,
        records: &mut ManifoldCache<L>,
    ) {
        let Self { all, parts: stirred, none, .. } = self;
        all.clear();
        stirred.clear();
        if !shapes.colliders.has_compounds() {
            return;
        }
        let is_part = |body: &u32| shapes.colliders.is_compound(*body);
        for (pair, number) in pairs.iter().zip(0..) {
            let bodies = pair.bodies;
            if pair.count > 0 && !pair.rests && bodies.iter().any(is_part) {
                let plain = shapes.colliders.is_plain(pair.colliders);
                let part = |of: usize| Part { bodies, record: of as u32, pair: number, plain };
                all.extend(pair.records().map(part));
            }
        }
        all.sort_unstable();
        for parts in all.chunk_by(|a, b| a.bodies == b.bodies) {
            let kept = |part: &Part| matches!(records.reuse[part.record as usize], Reuse::Kept(_));
            if parts.len() > 1 && !parts.iter().all(kept) {
                stirred.extend_from_slice(parts);
                none.clear();
                covered((parts, pairs), shapes, records, none);
                for &record in &*none {
                    let own = records.manifolds[record as usize].points();
                    records.traces[own].fill(cache::open(FAR));
                    let reuse = &mut records.reuse[record as usize];
                    *reuse = reuse.changed();
                }
            }
        }
    }

    /// Opens the points that the changed patches do not need.
    pub(crate) fn join(&mut self, records: &mut ManifoldCache<L>) {
        let stirred = std::mem::take(&mut self.parts);
        for parts in stirred.chunk_by(|a, b| a.bodies == b.bodies) {
            self.join_all(parts, records);
        }
        self.parts = stirred;
    }

    /// Opens the inner points of each plane in which two bodies touch.
    fn join_all(&mut self, parts: &[Part], records: &mut ManifoldCache<L>) {
        for (at, first) in parts.iter().enumerate() {
            let record = records.manifolds[first.record as usize];
            let is_alike = |part: &&Part| {
                let other = &records.manifolds[part.record as usize];
                part.plain
                    && other.normal.dot(record.normal) > SAME
                    && other.friction == record.friction
                    && other.restitution == record.restitution
            };
            // Skip it if it was joined with an earlier one.
            if !first.plain || parts[..at].iter().any(|part| is_alike(&part)) {
                continue;
            }
            self.places.clear();
            self.touch.points.clear();
            self.touch.normal = record.normal;
            let view = records.view();
            for part in parts[at..].iter().filter(is_alike) {
                let own = &records.manifolds[part.record as usize];
                let points = view.points_of(own).iter().zip(view.traces_of(own)).enumerate();
                for (point, (place, trace)) in points.filter(|(_, (_, of))| of.gap[0] < FAR) {
                    self.touch.points.push(ManifoldPoint {
                        on_a: place.push_point,
                        on_b: place.push_point,
                        gap: trace.gap[0],
                        feature: self.places.len() as u64,
                    });
                    self.places.push([part.record as usize, point]);
                }
            }
            self.open_inner(records);
        }
    }

    /// Opens the points of a plane that lie within others, if these determine their depths.
    fn open_inner(&mut self, records: &mut ManifoldCache<L>) {
        let all = self.touch.points.len();
        if all <= if L == 2 { 2 } else { MAX_POINTS } {
            return;
        }
        self.plane.clear();
        self.plane.extend_from_slice(&self.touch.points);
        self.touch.reduce();
        let Some(depth) = Depth::of(&self.touch.points, self.touch.normal) else { return };
        if !self.plane.iter().all(|point| depth.tells(point)) {
            return;
        }
        for (number, &[record, point]) in self.places.iter().enumerate() {
            if self.touch.points.iter().any(|of| of.feature == number as u64) {
                continue;
            }
            let own = records.manifolds[record].points();
            records.traces[own.start + point] = cache::open(FAR);
            records.reuse[record] = records.reuse[record].changed();
        }
        for &[record, _] in &self.places {
            let own = records.manifolds[record].points();
            deepest_first(&mut records.points[own.clone()], &mut records.traces[own]);
        }
    }
}

/// Appends to `none` the manifolds all of whose points are on a side that another part of the same
/// body covers.
fn covered<G: Geometry<L, A>, const L: usize, const A: usize>(
    (parts, pairs): (&[Part], &[Pair]),
    shapes: &Shapes<'_, G, L, A>,
    records: &ManifoldCache<L>,
    none: &mut Vec<u32>,
) {
    let normal = |part: &Part| records.manifolds[part.record as usize].normal;
    let first = normal(&parts[0]);
    if parts.iter().all(|part| normal(part).dot(first) > SAME) {
        return;
    }
    let is_covered = |part: &Part, side: usize, place: Vector<f32, L>| {
        let own = &pairs[part.pair as usize];
        let near = FLUSH * own.thickness;
        let outward = normal(part) * if side == 0 { -1.0 } else { 1.0 };
        let place = place + outward * (AHEAD * near);
        parts.iter().any(|other| {
            let other = &pairs[other.pair as usize];
            other.colliders[side] != own.colliders[side] && shapes.hold(other, side, place, near)
        })
    };
    let is_none = |part: &&Part| {
        let points = records.view().points_of(&records.manifolds[part.record as usize]);
        (0..2).any(|side| points.iter().all(|point| is_covered(part, side, point.push_point)))
    };
    none.extend(parts.iter().filter(is_none).map(|part| part.record));
}

/// The gap between two planes: a linear function of the position.
struct Depth<const L: usize> {
    from: Vector<f32, L>,
    gap: f32,
    slope: Vector<f32, L>,
    tolerance: f32,
}

impl<const L: usize> Depth<L> {
    /// Returns the function through the corners of a patch, or `None` if the patch has no width.
    fn of(corners: &[ManifoldPoint<L>], normal: Vector<f32, L>) -> Option<Self> {
        let [first, second, rest @ ..] = corners else { return None };
        let level = |v: Vector<f32, L>| v - normal * normal.dot(v);
        let along = level(second.on_a - first.on_a);
        let length = along.length();
        let along = along * (1.0 / length);
        let mut slope = along * ((second.gap - first.gap) / length);
        if L > 2 {
            let aside = |point: &ManifoldPoint<L>| {
                let arm = level(point.on_a - first.on_a);
                arm - along * along.dot(arm)
            };
            let widest = |a: &&ManifoldPoint<L>, b: &&ManifoldPoint<L>| {
                aside(a).length().total_cmp(&aside(b).length())
            };
            let third = rest.iter().max_by(widest)?;
            let width = aside(third).length();
            if width < WIDE * length {
                return None;
            }
            let rise = third.gap - first.gap - slope.dot(third.on_a - first.on_a);
            slope += aside(third) * (rise / (width * width));
        }
        let (from, gap, tolerance) = (first.on_a, first.gap, FLAT * length);
        (length > 0.0).then_some(Self { from, gap, slope, tolerance })
    }

    /// True if the gap of a point agrees with the function.
    fn tells(&self, point: &ManifoldPoint<L>) -> bool {
        let gap = self.gap + self.slope.dot(point.on_a - self.from);
        (point.gap - gap).abs() <= self.tolerance
    }
}
