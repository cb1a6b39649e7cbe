//! Where near shapes touch: from pairs to the manifolds of this step.

use std::ops::Range;

use drystone_solver::Vector;
use drystone_solver::team::{Team, chunks_with_parts};
use drystone_solver::wide::Trace;

use crate::bodies::Bodies;
use crate::cache::{self, Pair, Point, Record, Records, inherit};
use crate::geometry::{Frame, Geometry, Touch};

/// What the narrow phase reads.
pub(crate) struct Surroundings<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) shapes: &'a [G::Collider],
    /// Poses of the shapes, turned with their bodies but seen from their centers of mass.
    pub(crate) poses: &'a [G::Pose],
    pub(crate) bodies: &'a Bodies<G, L, A>,
    /// How far a body can move against another within the step, by body. \[m\]
    pub(crate) travel: &'a [Travel<L>],
    /// Records of the step before, and of what rests.
    pub(crate) old: &'a Records<L>,
    pub(crate) resting: &'a Records<L>,
    /// Whether a body moves or can be moved.
    pub(crate) active: &'a [bool],
    pub(crate) prediction_distance: f32,
    pub(crate) reuse_distance: f32,
}

/// How a body moves within a step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Travel<const L: usize> {
    /// dt v. \[m\]
    pub(crate) linear: Vector<f32, L>,
    /// dt |omega| times the reach of its shapes. \[m\]
    pub(crate) angular: f32,
    /// dt |v - v of a neighbor|, the largest: how far it can move against another neighbor, should
    /// this one push it within the step. \[m\]
    pub(crate) blow: f32,
}

/// Points are matched by place within this distance, where features do not match. \[m\]
const MATCH_DISTANCE: f32 = 0.02;

/// The prediction distance is at most this part of the thinner shape. \[1\]
const THIN: f32 = 0.25;

/// Gaps are known to this part of themselves and of the distance between the bodies. \[1\]
const ROUNDING: f32 = 1e-5;

/// Pairs per unit of parallel work.
const CHUNK: usize = 128;

/// One worker's memory.
pub(crate) struct Worker<G: Geometry<L, A>, const L: usize, const A: usize> {
    scratch: G::Scratch,
    records: Records<L>,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Default for Worker<G, L, A> {
    fn default() -> Self {
        Self { scratch: G::Scratch::default(), records: Records::default() }
    }
}

/// Fills `records` with the manifolds of all pairs, in the order of the pairs whatever the number
/// of threads, and gives each pair its range; pairs that rest keep theirs.
pub(crate) fn manifolds<G: Geometry<L, A>, const L: usize, const A: usize>(
    around: &Surroundings<'_, G, L, A>,
    pairs: &mut [Pair],
    workers: &mut Vec<Worker<G, L, A>>,
    team: &Team,
    records: &mut Records<L>,
) {
    if team.members() == 1 || pairs.len() < 2 * CHUNK {
        records.clear();
        if workers.is_empty() {
            workers.push(Worker::default());
        }
        find(around, pairs, &mut workers[0].scratch, records);
        return;
    }
    let chunks = pairs.len().div_ceil(CHUNK);
    if workers.len() < chunks {
        workers.resize_with(chunks, Worker::default);
    }
    let parts = pairs.chunks_mut(CHUNK).zip(workers.iter_mut());
    team.for_each(true, parts, |(pairs, worker)| {
        worker.records.clear();
        find(around, pairs, &mut worker.scratch, &mut worker.records);
    });
    let workers = &workers[..chunks];
    let manifolds = |of: &Worker<G, L, A>| of.records.manifolds.len();
    let points = |of: &Worker<G, L, A>| of.records.points.len();
    records.manifolds.resize(workers.iter().map(manifolds).sum(), Record::NONE);
    records.kept.clear();
    records.kept.extend(workers.iter().flat_map(|worker| &worker.records.kept));
    let count = workers.iter().map(points).sum();
    records.points.resize(count, Point::default());
    records.traces.resize(count, Trace::default());
    let found = chunks_with_parts(workers, 1, &mut records.manifolds, manifolds);
    let traces = chunks_with_parts(workers, 1, &mut records.traces, points);
    let points = chunks_with_parts(workers, 1, &mut records.points, points);
    let found = found.zip(points.zip(traces));
    let (mut first, mut first_point) = (0, 0);
    let parts =
        pairs.chunks_mut(CHUNK).zip(found).map(|(pairs, ((from, manifolds), (points, traces)))| {
            let (points, traces) = (points.1, traces.1);
            let offsets = [first, first_point];
            first += manifolds.len() as u32;
            first_point += points.len() as u32;
            (pairs, &from[0].records, manifolds, points, traces, offsets)
        });
    team.for_each(
        true,
        parts,
        |(pairs, found, manifolds, points, traces, [first, first_point])| {
            for pair in pairs.iter_mut().filter(|pair| !pair.rests) {
                pair.first += first;
            }
            points.copy_from_slice(&found.points);
            traces.copy_from_slice(&found.traces);
            for (to, from) in manifolds.iter_mut().zip(&found.manifolds) {
                *to = Record { first: from.first + first_point, ..*from };
            }
        },
    );
}

/// Appends the manifolds of these pairs to `records`.
fn find<G: Geometry<L, A>, const L: usize, const A: usize>(
    around: &Surroundings<'_, G, L, A>,
    pairs: &mut [Pair],
    scratch: &mut G::Scratch,
    records: &mut Records<L>,
) {
    let mut run = 0..0;
    for pair in pairs {
        let own = pair.records();
        let stirred = || pair.bodies.iter().any(|&body| around.bodies.stirred[body as usize]);
        if pair.rests || own.is_empty() || around.reuse_distance == 0.0 || stirred() {
            collide(around, pair, scratch, records, &mut run);
            continue;
        }
        if own.start != run.end {
            keep(around.old, &mut run, records);
            run = own.start..own.start;
        }
        pair.first = (records.manifolds.len() + run.len()) as u32;
        run.end = own.end;
    }
    keep(around.old, &mut run, records);
}

/// Appends a run of old records as they are, and ends it.
fn keep<const L: usize>(old: &Records<L>, run: &mut Range<usize>, records: &mut Records<L>) {
    let known = &old.manifolds[std::mem::take(run)];
    let (Some(first), Some(last)) = (known.first(), known.last()) else { return };
    let points = first.points().start..last.points().end;
    let [from, to] = [points.start as u32, records.points.len() as u32];
    records.points.extend_from_slice(&old.points[points.clone()]);
    records.traces.extend_from_slice(&old.traces[points]);
    let moved = |record: &Record<L>| Record { first: record.first - from + to, ..*record };
    records.manifolds.extend(known.iter().map(moved));
    records.kept.resize(records.manifolds.len(), true);
}

fn collide<G: Geometry<L, A>, const L: usize, const A: usize>(
    around: &Surroundings<'_, G, L, A>,
    pair: &mut Pair,
    scratch: &mut G::Scratch,
    records: &mut Records<L>,
    run: &mut Range<usize>,
) {
    if pair.rests && !pair.bodies.iter().any(|&body| around.active[body as usize]) {
        return;
    }
    let old = if pair.rests { around.resting } else { around.old };
    pair.rests = false;
    let known = &old.manifolds[pair.records()];
    pair.first = (records.manifolds.len() + run.len()) as u32;
    let [travel_a, travel_b] = pair.bodies.map(|body| &around.travel[body as usize]);
    // Never through a thin body to what is behind it.
    let prediction = around.prediction_distance.min(THIN * pair.thickness)
        + travel_a.blow.max(travel_b.blow)
        + travel_a.angular
        + travel_b.angular;
    let paths: f64 = pair.bodies.iter().map(|&body| around.bodies.paths[body as usize]).sum();
    if known.is_empty() && paths + f64::from(prediction) < pair.until {
        return;
    }
    keep(around.old, run, records);
    // Everything is seen from the center of mass of b: so it does not matter how far the pair is
    // from the origin.
    let apart = around.bodies.apart(pair.bodies);
    let [axes_a, axes_b] = pair.bodies.map(|body| around.bodies.frames[body as usize].axes);
    let a = &Frame { position: apart, axes: axes_a };
    let b = &Frame { position: Vector::ZERO, axes: axes_b };
    let reusable = !known.is_empty() && around.reuse_distance > 0.0 && !pair.rolls;
    if reusable && paths < pair.until {
        return reuse(pair, known, old, [a, b], records);
    }
    let seen = a.seen_from(b);
    let left = |record: &Record<L>| around.reuse_distance - moved(record, &seen);
    let known_to = |gap: f32| f64::from(gap - ROUNDING * (gap.abs() + apart.length()));
    if let Some(left) = known.first().map(left).filter(|&left| reusable && left > 0.0) {
        pair.until = paths + known_to(left / pair.lever);
        return reuse(pair, known, old, [a, b], records);
    }
    let [shape_a, shape_b] = pair.colliders.map(|c| &around.shapes[c as usize]);
    let [pose_a, pose_b] = pair.colliders.map(|c| &around.poses[c as usize]);
    let pose_a = G::advance(pose_a, apart, Vector::ZERO);
    let mut report = |touch: &Touch<L>| {
        let first = records.points.len();
        records.points.extend(touch.points.iter().map(|found| Point::new(found, a, b)));
        records.traces.extend(touch.points.iter().map(|found| cache::open(found.gap)));
        let points = &records.points[first..];
        let before = known.iter().find(|known| known.part == touch.part);
        if let Some(before) = before {
            let before = (old.points_of(before), old.traces_of(before));
            inherit(points, &mut records.traces[first..], before, MATCH_DISTANCE);
        }
        let reach = cache::reach(points);
        records.manifolds.push(Record {
            bodies: pair.bodies,
            friction: pair.friction,
            restitution: pair.restitution,
            part: touch.part,
            first: first as u32,
            count: touch.points.len() as u32,
            share: 1.0 / touch.points.len() as f32,
            normal: touch.normal,
            traced: before.map_or(touch.normal, |before| before.normal),
            apart,
            local_normal: b.local_direction(touch.normal),
            found_at: seen,
            reach,
        });
        records.kept.push(false);
    };
    let (a, b) = ((shape_a, &pose_a), (shape_b, pose_b));
    let gap = G::collide(a, b, prediction, scratch, &mut report);
    pair.count = records.manifolds.len() as u32 - pair.first;
    let lasts = if pair.count > 0 { around.reuse_distance / pair.lever } else { gap };
    pair.until = paths + known_to(lasts);
}

/// How far a has moved against b, as seen from it, since the record's points were found. \[m\]
fn moved<const L: usize>(record: &Record<L>, seen: &Frame<L>) -> f32 {
    let moved = (seen.position - record.found_at.position).length();
    let mut turned = 0.0f32;
    for (now, then) in seen.axes.iter().zip(&record.found_at.axes) {
        turned = turned.max((*now - *then).length());
    }
    moved + turned * record.reach
}

/// Gives a pair the records that it has had, with their gaps measured anew.
fn reuse<const L: usize>(
    pair: &mut Pair,
    known: &[Record<L>],
    old: &Records<L>,
    [a, b]: [&Frame<L>; 2],
    records: &mut Records<L>,
) {
    pair.count = known.len() as u32;
    for record in known {
        let normal = b.direction(record.local_normal);
        let first = records.points.len() as u32;
        for (point, trace) in old.points_of(record).iter().zip(old.traces_of(record)) {
            let [on_a, on_b] = [a.point(point.on_a), b.point(point.on_b)];
            records.points.push(Point { middle: (on_a + on_b) * 0.5, ..*point });
            let mut trace = *trace;
            trace.gap[0] = normal.dot(on_a - on_b);
            records.traces.push(trace);
        }
        let (traced, apart) = (record.normal, a.position);
        records.manifolds.push(Record { normal, traced, apart, first, ..*record });
        records.kept.push(false);
    }
}
