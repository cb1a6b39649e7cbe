//! Narrow phase: contact manifolds from pairs of near shapes.

use std::ops::Range;

use drystone_solver::Vector;
use drystone_solver::lanes::{CachedImpulse, Reuse};
use drystone_solver::thread_pool::{ThreadPool, chunks_with_parts};

use crate::bodies::Bodies;
use crate::cache::{
    self, CachedManifold, CachedPoint, ManifoldCache, ManifoldCacheMut, ManifoldCacheView,
    ManifoldWriter, Pair,
};
use crate::colliders::Colliders;
use crate::geometry::{ContactManifold, Frame, Geometry, LookAhead};
use crate::seams::{self, AHEAD, Approaching, STILL};
use crate::travel::{MotionView, TravelBound};

/// Input of the narrow phase.
pub(crate) struct NarrowPhaseInput<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) shapes: &'a [G::Prepared],
    /// Poses of the shapes, rotated with their bodies, relative to the centers of mass of the
    /// bodies.
    pub(crate) poses: &'a [G::Pose],
    pub(crate) bodies: &'a Bodies<G, L, A>,
    /// Travel bounds by body.
    pub(crate) travel: &'a [TravelBound<L>],
    /// Motion of the bodies until the next contact search.
    pub(crate) moving: MotionView<'a, L, A>,
    /// True if the solver has updated the cached impulses since the manifolds were found. If false,
    /// the impulses are still in the frames of the `impulse_normal` of each manifold.
    pub(crate) impulses_updated: bool,
    /// Cached manifolds of sleeping pairs.
    pub(crate) sleeping: &'a ManifoldCache<L>,
    /// By body: true if it moves or can be moved.
    pub(crate) active: &'a [bool],
    pub(crate) prediction_distance: f32,
    /// Displacement by gravity until the next search, beyond that of the present velocities. \[m\]
    pub(crate) fall: f32,
    pub(crate) reuse_distance: f32,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> NarrowPhaseInput<'_, G, L, A> {
    /// Returns the normal in whose frame the cached impulses of a manifold are given.
    fn seen_from(&self, manifold: &CachedManifold<L>) -> Vector<f32, L> {
        if self.impulses_updated { manifold.normal } else { manifold.impulse_normal }
    }

    /// Returns the frames of two bodies relative to the center of mass of b, which keeps precision
    /// far from the origin.
    #[inline(always)]
    fn frames(&self, bodies: [u32; 2]) -> (Frame<L>, Frame<L>) {
        frames(self.bodies, bodies)
    }

    /// Returns the relative motion up to which the contact points of a pair are reused. \[m\]
    fn reuse_limit(&self, pair: &Pair) -> f32 {
        self.reuse_distance.min(OFF * pair.thickness)
    }

    /// Returns the query distances of a pair, or `None` if it has no cached manifolds and a larger
    /// gap.
    #[inline(always)]
    fn ahead(&self, pair: &Pair) -> Option<LookAhead<L>> {
        let [a, b] = pair.bodies.map(|body| &self.travel[body as usize]);
        // Limits the prediction, so that no feature is found through a thin body.
        let fall = if pair.is_open { self.fall } else { 0.0 };
        let near = self.prediction_distance.min(THIN * pair.thickness + fall)
            + a.neighbor_push.max(b.neighbor_push);
        let clearance = if pair.count == 0 { pair.clearance - near } else { f32::NEG_INFINITY };
        let [_, turning] = self.moving.relative_travel(self.travel, pair, || clearance)?;
        let motion = a.linear - b.linear;
        (turning >= clearance).then_some(LookAhead { prediction: near + turning, motion, turning })
    }

    /// Calls `found` with the manifolds of a pair whose bodies approach by more than the gap, if
    /// the shapes may touch at corners. Manifolds are counted from the first of the pair.
    #[inline(always)]
    fn closing(
        &self,
        pair: &Pair,
        view: ManifoldCacheView<'_, L>,
        numbers: Range<usize>,
        mut found: impl FnMut(u32),
    ) {
        if !pair.may_meet_at_corners {
            return;
        }
        let [a, b] = pair.bodies.map(|body| &self.travel[body as usize]);
        let (ahead, turning) = (a.linear - b.linear, a.angular + b.angular);
        for (manifold, number) in view.of(numbers).iter().zip(0..) {
            let gap = view.impulses_of(manifold)[0].gap[0];
            let comes = AHEAD * (turning - manifold.normal.dot(ahead));
            let least = if gap > 0.0 {
                // Moving bodies fall farther; those at rest are not asked.
                gap + NOWHERE * pair.thickness - self.fall.min(comes.max(0.0))
            } else {
                STILL * pair.thickness
            };
            if (comes > least || manifold.undecided)
                && !is_broad(view.points_of(manifold), manifold.normal, BROAD * pair.thickness)
            {
                found(number);
            }
        }
    }
}

/// True if contact points span a patch that is wider than `least` \[m\] in all directions. Both
/// bodies extend over the patch, so they overlap by as much along any axis across the normal. So
/// only the normal can separate them.
fn is_broad<const L: usize>(points: &[CachedPoint<L>], normal: Vector<f32, L>, least: f32) -> bool {
    let [first, others @ ..] = points else { return false };
    // In 2D, the side of a polygon can be as wide as its top.
    if L == 2 || points.len() < L {
        return false;
    }
    let level = |point: &CachedPoint<L>| {
        let arm = point.push_point - first.push_point;
        arm - normal * normal.dot(arm)
    };
    let longer = |most: Vector<f32, L>, own: Vector<f32, L>| {
        if own.dot(own) > most.dot(most) { own } else { most }
    };
    let along = others.iter().map(level).fold(Vector::ZERO, longer);
    let squared = along.dot(along);
    let aside = |point: &CachedPoint<L>| {
        let arm = level(point);
        arm - along * (along.dot(arm) / squared.max(f32::MIN_POSITIVE))
    };
    let width = others.iter().map(aside).fold(Vector::ZERO, longer);
    width.dot(width) > least * least
}

/// Returns the frames of two bodies relative to the center of mass of b.
#[inline(always)]
fn frames<G: Geometry<L, A>, const L: usize, const A: usize>(
    bodies: &Bodies<G, L, A>,
    [a, b]: [u32; 2],
) -> (Frame<L>, Frame<L>) {
    let (apart, frames) = (bodies.relative_position([a, b]), &bodies.frames);
    let a = Frame { position: apart, ..frames[a as usize] };
    (a, Frame { position: Vector::ZERO, ..frames[b as usize] })
}

/// The prediction distance is at most this fraction of the thinner shape. \[1\]
const THIN: f32 = 0.25;

/// Contact points are reused while the relative motion is at most this fraction of the thinner
/// shape, which bounds the error of their positions. \[1\]
const OFF: f32 = 1.0 / 32.0;

/// Rounding error of gaps, relative to themselves and to the distance between the bodies. \[1\]
const ROUNDING: f32 = 1e-5;

/// Approach by less than this fraction of the thinner shape beyond the gap is ignored. \[1\]
const NOWHERE: f32 = 1e-6;

/// A patch wider than this fraction of the thinner shape is not a corner. \[1\]
const BROAD: f32 = 0.1;

/// Grain size for sharing pairs between threads.
const GRAIN: usize = 16;

/// Scratch memory and results of one worker for its pairs.
pub(crate) struct PairWorker<G: Geometry<L, A>, const L: usize, const A: usize> {
    scratch: G::Scratch,
    core: Option<InnerBall<G, L, A>>,
    /// Range of its pairs' manifolds in the cache of the step before.
    known: Range<usize>,
    /// Newly found manifolds.
    cache: ManifoldCache<L>,
    /// The manifolds of all its pairs, in their order.
    runs: Vec<CacheRun>,
    /// Number of manifolds and points in `runs`.
    counts: [usize; 2],
    /// Manifolds whose bodies approach by more than the gap. Pairs are counted from the worker's
    /// first.
    closing: Vec<Approaching>,
}

/// A ball inside a shape ([`Geometry::inner_ball`]), for shapes that approach by more than the
/// thickness of a pair. A slender body rotates so far in the substep after an impact that the
/// contacts of its corners let it through. The ball cannot rotate out of the way.
struct InnerBall<G: Geometry<L, A>, const L: usize, const A: usize> {
    /// Number of the shape.
    shape: u32,
    center: Vector<f32, L>,
    ball: G::Prepared,
}

/// A contact of a core counts if the cosine between its normal and that of the shape's contact is
/// more than this. \[1\]
const ALIKE: f32 = 0.99;

/// Bits in a part number that mark contacts of a core, by the side of the core.
const CORES: [u32; 2] = [1 << 29, 1 << 28];

/// A run of consecutive manifolds in one cache.
struct CacheRun {
    /// True if they are kept in the cache of the step before; false if the worker has found them.
    old: bool,
    manifolds: Range<usize>,
}

impl CacheRun {
    fn points<const L: usize>(&self, of: ManifoldCacheView<'_, L>) -> Range<usize> {
        match of.of(self.manifolds.clone()) {
            [] => 0..0,
            [first, .., last] => first.points().start..last.points().end,
            [only] => only.points(),
        }
    }
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Default for PairWorker<G, L, A> {
    fn default() -> Self {
        let (scratch, cache) = (G::Scratch::default(), ManifoldCache::default());
        let (runs, closing) = (Vec::new(), Vec::new());
        Self { scratch, core: None, known: 0..0, cache, runs, counts: [0; 2], closing }
    }
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> PairWorker<G, L, A> {
    /// Measures the clearance of a pair that has just come near, up to `prediction` \[m\]. Its
    /// bounding boxes do not tell: the box of a half-space or of an oblique wall also contains
    /// distant points.
    pub(crate) fn measure_clearance(
        &mut self,
        colliders: &Colliders<G, L, A>,
        bodies: &Bodies<G, L, A>,
        pair: &mut Pair,
        prediction: f32,
    ) {
        let (a, _) = frames(bodies, pair.bodies);
        let [a_shape, b_shape] = pair.colliders.map(|shape| shape as usize);
        let pose_a = G::advance(&colliders.poses[a_shape], a.position, Vector::ZERO);
        let shape_a = (&colliders.shapes[a_shape], &pose_a);
        let shape_b = (&colliders.shapes[b_shape], &colliders.poses[b_shape]);
        let gap =
            G::collide(shape_a, shape_b, prediction, None, &mut self.scratch, &mut |_: &_| ());
        pair.clearance = 0.0;
        // `Pair::left` will subtract all motion since the last search, but this gap was measured
        // after it.
        pair.clearance = known_to(gap, a.position) - pair.left(&bodies.since_search);
    }

    /// Finds the manifolds of these pairs and sets the range of each pair. `own` holds those of the
    /// step before.
    fn find(
        &mut self,
        input: &NarrowPhaseInput<'_, G, L, A>,
        pairs: &mut [Pair],
        mut own: ManifoldCacheMut<'_, L>,
    ) {
        let Self { scratch, core, cache, runs, counts, closing, .. } = self;
        cache.clear();
        runs.clear();
        closing.clear();
        *counts = [0; 2];
        for (pair, number) in pairs.iter_mut().zip(0..) {
            let (was_sleeping, known) = (pair.is_sleeping, pair.manifolds());
            let first = cache.manifolds.len();
            let needs_rebuild =
                || pair.bodies.iter().any(|&body| input.bodies.needs_rebuild[body as usize]);
            let kept = !(was_sleeping
                || known.is_empty()
                || input.reuse_distance == 0.0
                || needs_rebuild());
            if kept {
                own.keep(known.clone(), input.impulses_updated);
                // The motion of its bodies is not tracked while its manifolds are kept.
                pair.clearance = 0.0;
            }
            let old = kept || collide(input, pair, &mut own, (scratch, core), cache);
            if pair.is_sleeping {
                continue;
            }
            let manifolds = if old { known } else { first..cache.manifolds.len() };
            let found = if old { own.view() } else { cache.view() };
            input.closing(pair, found, manifolds.clone(), |manifold| {
                closing.push(Approaching { pair: number, manifold });
            });
            pair.first = counts[0] as u32;
            counts[0] += manifolds.len();
            match runs.last_mut() {
                _ if manifolds.is_empty() => {}
                Some(run) if run.old == old && run.manifolds.end == manifolds.start => {
                    run.manifolds.end = manifolds.end;
                }
                _ => runs.push(CacheRun { old, manifolds }),
            }
        }
        let old = own.view();
        let points = |run: &CacheRun| run.points(if run.old { old } else { cache.view() }).len();
        counts[1] = runs.iter().map(points).sum();
    }

    /// Copies its runs to a joint cache, in which `offset` points come before.
    fn copy(
        &self,
        old: &ManifoldCache<L>,
        (mut manifolds, mut reuse): (&mut [CachedManifold<L>], &mut [Reuse]),
        (points, impulses): (&mut [CachedPoint<L>], &mut [CachedImpulse<L>]),
        offset: usize,
    ) {
        let mut first = 0;
        for run in &self.runs {
            let from = if run.old { old } else { &self.cache };
            let (own, range) = (run.manifolds.clone(), run.points(from.view()));
            let to = first..first + range.len();
            points[to.clone()].copy_from_slice(&from.points[range.clone()]);
            impulses[to.clone()].copy_from_slice(&from.impulses[range.clone()]);
            let moved = ((offset + first) as u32).wrapping_sub(range.start as u32);
            let into = reuse.split_off_mut(..own.len()).unwrap_or_default();
            into.copy_from_slice(&from.reuse[own.clone()]);
            let cache = manifolds.split_off_mut(..own.len()).unwrap_or_default();
            for ((into, reuse), manifold) in cache.iter_mut().zip(into).zip(&from.manifolds[own]) {
                // The impulses of kept manifolds are given in the frame of their present normal.
                let kept = matches!(reuse, Reuse::Kept(_));
                let impulse_normal = if kept { manifold.normal } else { manifold.impulse_normal };
                *into = CachedManifold {
                    impulse_normal,
                    first: manifold.first.wrapping_add(moved),
                    ..*manifold
                };
            }
            first = to.end;
        }
    }
}

/// Returns the manifolds that the last search found to be closing, in the order of their pairs.
pub(crate) fn closing<G: Geometry<L, A>, const L: usize, const A: usize>(
    workers: &[PairWorker<G, L, A>],
    pairs: usize,
    pool: &ThreadPool,
) -> impl Iterator<Item = Approaching> {
    let (_, share) = pool.share(pairs, GRAIN);
    let workers = workers[..pairs.div_ceil(share)].iter().enumerate();
    workers.flat_map(move |(chunk, worker)| {
        let first = (chunk * share) as u32;
        worker.closing.iter().map(move |own| Approaching { pair: first + own.pair, ..*own })
    })
}

/// Finds the manifolds of all pairs and sets the range of each pair. The order is that of the
/// pairs, whatever the number of threads. Sleeping pairs keep their manifolds.
///
/// `old` holds the manifolds of the step before; some of them are updated in place. Returns true if
/// the set of manifolds has changed: then `cache` holds the new set.
pub(crate) fn manifolds<G: Geometry<L, A>, const L: usize, const A: usize>(
    input: &NarrowPhaseInput<'_, G, L, A>,
    pairs: &mut [Pair],
    workers: &mut Vec<PairWorker<G, L, A>>,
    pool: &ThreadPool,
    (old, cache): (&mut ManifoldCache<L>, &mut ManifoldCache<L>),
) -> bool {
    let (useful, share) = pool.share(pairs.len(), GRAIN);
    let chunks = pairs.len().div_ceil(share);
    if workers.len() < chunks {
        workers.resize_with(chunks, PairWorker::default);
    }
    let workers = &mut workers[..chunks];
    // The range of a chunk starts at the first manifold of its pairs and ends where the next
    // chunk's starts.
    let mut end = old.manifolds.len();
    for (pairs, worker) in pairs.chunks(share).zip(&mut *workers).rev() {
        let first = pairs.iter().find(|pair| !pair.is_sleeping && pair.count > 0);
        let start = first.map_or(end, |pair| pair.first as usize);
        worker.known = start..std::mem::replace(&mut end, start);
    }
    let mut later = old.view_mut();
    let parts = pairs.chunks_mut(share).zip(workers.iter_mut()).map(|(pairs, worker)| {
        let own = later.split_off(worker.known.clone());
        (pairs, worker, own)
    });
    pool.for_each(useful, parts, |(pairs, worker, own)| worker.find(input, pairs, own));
    let mut first = 0;
    let parts = pairs.chunks_mut(share).zip(workers.iter()).map(|(pairs, worker)| {
        first += worker.counts[0];
        (pairs, first - worker.counts[0])
    });
    pool.for_each(useful, parts.filter(|(_, first)| *first > 0), |(pairs, first)| {
        for pair in pairs.iter_mut().filter(|pair| !pair.is_sleeping) {
            pair.first += first as u32;
        }
    });
    let mut runs = workers.iter().flat_map(|worker| &worker.runs);
    let same =
        |end, run: &CacheRun| (run.old && run.manifolds.start == end).then_some(run.manifolds.end);
    if runs.try_fold(0, same) == Some(old.manifolds.len()) {
        return false;
    }
    if let [worker] = workers
        && worker.runs.iter().all(|run| !run.old)
    {
        std::mem::swap(cache, &mut worker.cache);
        return true;
    }
    join(old, workers, pool, useful, cache);
    true
}

/// Joins the results of the workers.
fn join<G: Geometry<L, A>, const L: usize, const A: usize>(
    old: &ManifoldCache<L>,
    workers: &[PairWorker<G, L, A>],
    pool: &ThreadPool,
    useful: bool,
    cache: &mut ManifoldCache<L>,
) {
    let [manifolds, points] = [0, 1].map(|i| workers.iter().map(|of| of.counts[i]).sum());
    cache.manifolds.resize(manifolds, CachedManifold::NONE);
    cache.reuse.resize(manifolds, Reuse::New);
    cache.points.resize(points, CachedPoint::default());
    cache.impulses.resize(points, CachedImpulse::default());
    let [manifolds, points] =
        [0, 1].map(|i| move |of: &PairWorker<G, L, A>| -> usize { of.counts[i] });
    let mut first = 0;
    let own = chunks_with_parts(workers, 1, &mut cache.manifolds, manifolds)
        .zip(chunks_with_parts(workers, 1, &mut cache.reuse, manifolds))
        .zip(chunks_with_parts(workers, 1, &mut cache.points, points))
        .zip(chunks_with_parts(workers, 1, &mut cache.impulses, points))
        .map(|(((manifolds, reuse), points), impulses)| {
            first += points.1.len();
            let offset = first - points.1.len();
            (&manifolds.0[0], (manifolds.1, reuse.1), (points.1, impulses.1), offset)
        });
    pool.for_each(useful, own, |(worker, manifolds, points, offset)| {
        worker.copy(old, manifolds, points, offset);
    });
}

/// Finds the manifolds of a pair. Returns true if all of them are updated in place; otherwise they
/// are appended to `cache`.
fn collide<G: Geometry<L, A>, const L: usize, const A: usize>(
    input: &NarrowPhaseInput<'_, G, L, A>,
    pair: &mut Pair,
    own: &mut ManifoldCacheMut<'_, L>,
    (scratch, core): (&mut G::Scratch, &mut Option<InnerBall<G, L, A>>),
    cache: &mut ManifoldCache<L>,
) -> bool {
    if pair.is_sleeping && !input.bodies.may_meet(pair.bodies, input.active) {
        return false;
    }
    let was_sleeping = std::mem::replace(&mut pair.is_sleeping, false);
    if was_sleeping {
        pair.clearance = 0.0;
    }
    pair.clearance = pair.left(input.moving.since_search);
    let known = pair.count > 0;
    let ahead = if known { None } else { input.ahead(pair) };
    if !known && ahead.is_none() {
        return false;
    }
    let (a, b) = &input.frames(pair.bodies);
    if known && reuse(input, pair, (a, b), own, cache, was_sleeping) {
        return !was_sleeping;
    }
    // A pair with cached manifolds has not been tested for its gap.
    let Some(ahead) = ahead.or_else(|| input.ahead(pair)) else { return false };
    let [a_shape, b_shape] = pair.colliders;
    let pose_a = G::advance(&input.poses[a_shape as usize], a.position, Vector::ZERO);
    let old = if was_sleeping { input.sleeping.view() } else { own.view() };
    let before =
        old.of(pair.manifolds()).first().map(|manifold| old.points_of(manifold)[0].feature);
    let mut writer =
        ManifoldWriter::new(own, pair.manifolds(), was_sleeping.then_some(input.sleeping), cache);
    let of = &*pair;
    let mut keep = |touch: &ContactManifold<L>, part: u32| {
        input.store(of, (touch, part), (a, b), &mut writer);
    };
    let shape_a = (&input.shapes[a_shape as usize], &pose_a);
    let shape_b = (&input.shapes[b_shape as usize], &input.poses[b_shape as usize]);
    // Normal along which a body may pass through the thinner shape.
    let mut tunneling_normal = None;
    let approach = |normal: Vector<f32, L>| -normal.dot(ahead.motion);
    let mut all = |touch: &ContactManifold<L>| {
        if approach(touch.normal) > pair.thickness {
            tunneling_normal = Some(touch.normal);
        }
        keep(touch, touch.part);
    };
    let gap = G::collide(shape_a, shape_b, ahead, before, scratch, &mut all);
    if let Some(normal) = tunneling_normal {
        let tunneling = Tunneling { shapes: [shape_a, shape_b], normal, ahead, before };
        tunneling.collide_cores::<G, A>(pair.colliders, scratch, core, &mut keep);
    }
    let (count, again) = writer.finish(input.impulses_updated);
    pair.count = count;
    pair.clearance = known_to(if count > 0 { input.reuse_limit(pair) } else { gap }, a.position);
    again
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> NarrowPhaseInput<'_, G, L, A> {
    /// Writes a manifold of a pair, whose bodies have the frames `a` and `b`, as that of a `part`.
    #[inline(always)]
    fn store(
        &self,
        pair: &Pair,
        (touch, part): (&ContactManifold<L>, u32),
        (a, b): (&Frame<L>, &Frame<L>),
        writer: &mut ManifoldWriter<'_, '_, L>,
    ) {
        let before = writer.before(part);
        let impulse_normal = before.map_or(touch.normal, |before| self.seen_from(before));
        let fresh = before.is_none_or(seams::is_turned);
        let (manifold, points) = writer.next(touch, part, a, b);
        *manifold = CachedManifold {
            bodies: pair.bodies,
            friction: pair.friction,
            restitution: pair.restitution,
            part,
            surfaces: touch.surfaces,
            normal: touch.normal,
            impulse_normal,
            center_offset: a.position,
            undecided: fresh,
            found_at: Frame::IDENTITY,
            ..*manifold
        };
        if !pair.is_curved {
            manifold.local_normal = manifold.carrier(a, b).local_direction(touch.normal);
            manifold.found_at = a.seen_from(b);
            manifold.reach = cache::reach(points);
        }
    }
}

/// Two shapes of which one may pass through the other in the step.
struct Tunneling<'a, C, P, const L: usize> {
    shapes: [(&'a C, &'a P); 2],
    /// Direction in which it passes.
    normal: Vector<f32, L>,
    ahead: LookAhead<L>,
    before: Option<u64>,
}

impl<C, P, const L: usize> Tunneling<'_, C, P, L> {
    /// Finds the contacts of the core of each shape with the other shape, where they are along the
    /// way.
    fn collide_cores<G: Geometry<L, A, Prepared = C, Pose = P>, const A: usize>(
        &self,
        colliders: [u32; 2],
        scratch: &mut G::Scratch,
        core: &mut Option<InnerBall<G, L, A>>,
        keep: &mut impl FnMut(&ContactManifold<L>, u32),
    ) {
        for side in 0..2 {
            let (shape, pose) = self.shapes[side];
            let number = colliders[side];
            if core.as_ref().is_none_or(|of| of.shape != number) {
                *core = G::inner_ball(shape).map(|(center, ball)| InnerBall {
                    shape: number,
                    center,
                    ball,
                });
            }
            let Some(InnerBall { center, ball, .. }) = &*core else { continue };
            let pose = G::pose(G::frame(pose).point(*center), &[]);
            let mut pair = self.shapes;
            pair[side] = (ball, &pose);
            let mut tunneling = |touch: &ContactManifold<L>| {
                let gaps = touch.points.iter().map(|point| point.gap);
                let gap = gaps.fold(f32::INFINITY, f32::min);
                let approach = -touch.normal.dot(self.ahead.motion);
                if touch.normal.dot(self.normal) > ALIKE && approach > gap {
                    keep(touch, touch.part ^ CORES[side]);
                }
            };
            G::collide(pair[0], pair[1], self.ahead, self.before, scratch, &mut tunneling);
        }
    }
}

/// Updates the gaps of a pair's cached manifolds if their points are still valid. Returns whether
/// they are. The manifolds of a pair that was asleep are appended to `cache`.
#[inline(always)]
fn reuse<G: Geometry<L, A>, const L: usize, const A: usize>(
    input: &NarrowPhaseInput<'_, G, L, A>,
    pair: &mut Pair,
    (a, b): (&Frame<L>, &Frame<L>),
    own: &mut ManifoldCacheMut<'_, L>,
    cache: &mut ManifoldCache<L>,
    was_sleeping: bool,
) -> bool {
    let most = input.reuse_limit(pair);
    // The points on a mesh that deforms move relative to its body.
    let deforms = |body: &u32| input.bodies.surface_speed(*body as usize) > 0.0;
    if pair.is_curved || most <= 0.0 || pair.bodies.iter().any(deforms) {
        return false;
    }
    if pair.clearance <= 0.0 {
        let old = if was_sleeping { input.sleeping.view() } else { own.view() };
        let left = most - moved(&old.of(pair.manifolds())[0], &a.seen_from(b));
        if left <= 0.0 {
            return false;
        }
        pair.clearance = known_to(left, a.position);
    }
    let turned = pair.bodies.iter().any(|&body| input.bodies.turned[body as usize]);
    if was_sleeping {
        cache.take_pair(pair, input.sleeping);
        let mut woken = cache.view_mut();
        // They were not in the step before, and `take_pair` has already set their `impulse_normal`.
        woken.measure(pair.manifolds(), [a, b], (most, turned), false);
    } else {
        own.measure(pair.manifolds(), [a, b], (most, turned), input.impulses_updated);
    }
    true
}

/// Returns a gap, or the rest of a reuse distance, less its rounding error at this distance of
/// the bodies. \[m\]
fn known_to<const L: usize>(gap: f32, apart: Vector<f32, L>) -> f32 {
    gap - ROUNDING * (gap.abs() + apart.length())
}

/// Returns how far a has moved relative to b, in the frame of b, since the contact points were
/// found. \[m\]
fn moved<const L: usize>(manifold: &CachedManifold<L>, seen: &Frame<L>) -> f32 {
    let moved = (seen.position - manifold.found_at.position).length();
    let mut turned = 0.0f32;
    for (now, then) in seen.axes.iter().zip(&manifold.found_at.axes) {
        turned = turned.max((*now - *then).length());
    }
    moved + turned * manifold.reach
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::SearchMotion;
    use crate::colliders::rotation_lever;
    use crate::geometry::random::Random;

    /// Particles, which do not rotate, use up their clearance by translation alone.
    #[test]
    fn particles_use_up_clearance_by_translation_alone() {
        let pair = Pair {
            rotation_lever: rotation_lever([0.0; 2]),
            clearance: 1.0,
            count: 1,
            ..Pair::APART
        };
        let since_search = SearchMotion { linear: Vector([0.25, 0.0]), ..SearchMotion::NOWHERE };
        let left = pair.left(&[since_search, SearchMotion::NOWHERE]);
        assert!((left - 0.75).abs() < 1e-6, "{left} m");
    }

    /// While a pair has clearance, the motion of a in the frame of b is less than the reuse
    /// distance.
    #[test]
    fn points_are_reused_while_clearance_is_left() {
        let (mut random, most, mut worst) = (Random(8), 0.01, 0.0f32);
        for _ in 0..300 {
            let reach = [0, 1].map(|_| 0.55 + 0.45 * random.number());
            // They touch, or nearly do.
            let mut positions = [Vector([0.0, 0.0]), Vector([reach[0] + 1.4 * reach[1], 0.0])];
            let mut angles = [3.0 * random.number(), 3.0 * random.number()];
            let frames = |positions: &[Vector<f32, 2>; 2], angles: &[f32; 2]| {
                [0, 1].map(|i| {
                    let (sin, cos) = angles[i].sin_cos();
                    Frame {
                        position: positions[i],
                        axes: [Vector([cos, sin]), Vector([-sin, cos])],
                    }
                })
            };
            let [a, b] = frames(&positions, &angles);
            let found = CachedManifold {
                found_at: a.seen_from(&b),
                reach: reach[0],
                ..CachedManifold::NONE
            };
            let mut pair = Pair {
                rotation_lever: rotation_lever(reach),
                clearance: most,
                count: 1,
                ..Pair::APART
            };
            let (drift, turns) = (random.number(), [random.number(), random.number()]);
            loop {
                let mut since_search = [SearchMotion::NOWHERE; 2];
                for i in 0..2 {
                    since_search[i].linear = Vector([0.1, 1e-3 * drift * i as f32]);
                    let turn = 1e-3 * turns[i];
                    since_search[i].turned = turn.abs() * reach[i];
                    positions[i] += since_search[i].linear;
                    angles[i] += turn;
                }
                pair.clearance = pair.left(&since_search);
                if pair.clearance <= 0.0 {
                    break;
                }
                let [a, b] = frames(&positions, &angles);
                let moved = moved(&found, &a.seen_from(&b));
                assert!(moved <= most + 2e-5, "{moved} m, with {} m left", pair.clearance);
                worst = worst.max(moved);
            }
        }
        assert!(worst > 0.5 * most, "{worst} m at most");
    }
}
