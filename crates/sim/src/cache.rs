//! Contact data that one step passes to the next: pairs, their manifolds, and the impulses and
//! slips of contact points, matched by feature.
//!
//! Manifolds that are found again are written in place where possible ([`ManifoldWriter`]).

use std::ops::Range;

use drystone_solver::Vector;
use drystone_solver::lanes::{CachedImpulse, Reuse};

use crate::bodies::SearchMotion;
use crate::geometry::{
    ContactManifold, Curvature, Frame, MAX_POINTS, ManifoldPoint, NormalCarrier,
};

/// Factor of a pair's room for each step. It accounts for displacements that are too small to
/// change the clearance in `f32`. \[1\]
const ROUNDED: f32 = 1.0 - 2.0 * f32::EPSILON;

/// Largest distance at which contact points are matched by position, if their features do not
/// match. \[m\]
const MATCH_DISTANCE: f32 = 0.02;

/// Contacts of a world between two steps.
#[derive(Default)]
pub(crate) struct ContactCache<const L: usize> {
    /// Pairs of shapes whose boxes overlap, sorted.
    pub(crate) pairs: Vec<Pair>,
    /// Manifolds of the awake pairs.
    pub(crate) cache: ManifoldCache<L>,
    /// Reuse distance of the last search. \[m\]
    pub(crate) last_reuse: f32,
}

/// Two shapes whose boxes overlap.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    /// Lower index first. Pairs are sorted by this field.
    pub(crate) colliders: [u32; 2],
    pub(crate) bodies: [u32; 2],
    pub(crate) friction: f32,
    pub(crate) restitution: f32,
    /// Smallest extent of the thinner shape. \[m\]
    pub(crate) thickness: f32,
    /// True if one shape may roll: then earlier contact points do not determine the current ones.
    pub(crate) is_curved: bool,
    /// True if one shape may have no interior, so that a body which has passed through it is not
    /// pushed back.
    pub(crate) is_open: bool,
    /// True if the shapes may touch at a corner: one has edges, and both have a farthest point in
    /// each direction.
    pub(crate) may_meet_at_corners: bool,
    /// True if it sleeps: neither body moves or can be moved.
    pub(crate) is_sleeping: bool,
    /// Lever of rotations ([`SearchMotion`](crate::bodies::SearchMotion)). A rotation that moves
    /// the surface of one body by 1 moves the points of a relative to b by at most this. \[1\]
    pub(crate) rotation_lever: f32,
    /// Without manifolds: lower bound of the distance of its shapes. With manifolds: relative
    /// motion after which its points are recomputed. \[m\]
    pub(crate) clearance: f32,
    /// First manifold and number of manifolds: in the cache of awake pairs, or in that of sleeping
    /// pairs.
    pub(crate) first: u32,
    pub(crate) count: u32,
}

impl Pair {
    /// Keeps its shapes from colliding: they count as infinitely far apart.
    pub(crate) fn separate(&mut self) {
        (self.count, self.clearance) = (0, f32::INFINITY);
    }

    /// Returns true if a joint keeps its shapes from colliding.
    pub(crate) fn is_separated(&self) -> bool {
        self.clearance == f32::INFINITY
    }

    pub(crate) fn manifolds(&self) -> Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }

    /// Returns a lower bound of the distance of its shapes, or 0 if it has manifolds. \[m\]
    pub(crate) fn gap<const L: usize>(&self, since_search: &[SearchMotion<L>]) -> f32 {
        if self.count > 0 { 0.0 } else { self.left(since_search) }
    }

    /// Returns the clearance that is left after the motion `since_search` of its bodies. \[m\]
    #[inline(always)]
    pub(crate) fn left<const L: usize>(&self, since_search: &[SearchMotion<L>]) -> f32 {
        let [a, b] = self.bodies.map(|body| &since_search[body as usize]);
        let rotation_lever = if self.count > 0 { self.rotation_lever } else { 1.0 };
        let gone = (a.linear - b.linear).length() + (a.turned + b.turned) * rotation_lever;
        self.clearance * ROUNDED - gone
    }
}

#[cfg(test)]
impl Pair {
    /// A pair without contacts, for tests.
    pub(crate) const APART: Self = Self {
        colliders: [0, 1],
        bodies: [0, 1],
        friction: 0.0,
        restitution: 0.0,
        thickness: 1.0,
        is_curved: false,
        is_open: false,
        may_meet_at_corners: false,
        is_sleeping: false,
        rotation_lever: 1.0,
        clearance: 0.0,
        first: 0,
        count: 0,
    };
}

/// Merges the sorted pairs `fresh` into the sorted `pairs`, from the end. If `pairs` is empty, the
/// two vectors are swapped, with their memory.
pub(crate) fn merge(pairs: &mut Vec<Pair>, fresh: &mut Vec<Pair>) {
    let mut old = pairs.len();
    if old == 0 {
        return std::mem::swap(pairs, fresh);
    }
    pairs.extend_from_slice(fresh);
    for (added, pair) in fresh.iter().enumerate().rev() {
        while old > 0 && pairs[old - 1].colliders > pair.colliders {
            pairs[old + added] = pairs[old - 1];
            old -= 1;
        }
        pairs[old + added] = *pair;
    }
}

/// Manifolds of a step. Their points are stored manifold by manifold, the deepest first.
#[derive(Clone, Debug, Default)]
pub(crate) struct ManifoldCache<const L: usize> {
    pub(crate) manifolds: Vec<CachedManifold<L>>,
    pub(crate) points: Vec<CachedPoint<L>>,
    /// Impulse, gap and slip of each point.
    pub(crate) impulses: Vec<CachedImpulse<L>>,
    /// Reuse of each manifold. A manifold is kept if neither body has moved far enough for a
    /// rebuild ([`Bodies::needs_rebuild`](crate::bodies::Bodies::needs_rebuild)).
    pub(crate) reuse: Vec<Reuse>,
}

/// A manifold that is kept from step to step, in the frames of its bodies.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CachedManifold<const L: usize> {
    pub(crate) bodies: [u32; 2],
    pub(crate) friction: f32,
    pub(crate) restitution: f32,
    pub(crate) part: u32,
    pub(crate) surfaces: Curvature,
    /// First point and number of points.
    pub(crate) first: u32,
    pub(crate) count: u32,
    /// Contact normal in world axes, from b towards a, as of the last update of the push points.
    pub(crate) normal: Vector<f32, L>,
    /// Normal of the frame in which the impulses and slips are given: that of the previous step.
    pub(crate) impulse_normal: Vector<f32, L>,
    /// Vector from the center of mass of b to that of a, as of the last update of the push
    /// points. \[m\]
    pub(crate) center_offset: Vector<f32, L>,
    /// Normal in the frame of the body that [carries](Self::carrier) it, and frame of a relative to
    /// b. Both are as of the search that found the points. Not used for shapes that roll.
    pub(crate) local_normal: Vector<f32, L>,
    pub(crate) found_at: Frame<L>,
    /// Largest distance of its points from the center of mass of a. \[m\]
    pub(crate) reach: f32,
    /// True if it is new, or if the previous search rotated it to another axis. Such a manifold may
    /// get another axis even at rest ([`seams`](crate::seams)), which resets this mark.
    pub(crate) undecided: bool,
}

/// A contact point of a cached manifold.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct CachedPoint<const L: usize> {
    /// Position on the surface of a, in the frame of a. \[m\]
    pub(crate) on_a: Vector<f32, L>,
    /// Position on the surface of b, in the frame of b. \[m\]
    pub(crate) on_b: Vector<f32, L>,
    /// Point at which the impulse acts on both bodies, so that the pair keeps its angular momentum
    /// ([`NormalCarrier::push_point`]). World axes, from the center of mass of b. \[m\]
    pub(crate) push_point: Vector<f32, L>,
    pub(crate) feature: u64,
}

impl<const L: usize> ManifoldCache<L> {
    pub(crate) fn clear(&mut self) {
        self.manifolds.clear();
        self.points.clear();
        self.impulses.clear();
        self.reuse.clear();
    }

    /// Returns the bodies of each manifold.
    pub(crate) fn pairs(&self) -> impl Iterator<Item = [u32; 2]> + Clone {
        self.manifolds.iter().map(|manifold| manifold.bodies)
    }

    /// Returns a view of all manifolds.
    pub(crate) fn view(&self) -> ManifoldCacheView<'_, L> {
        let Self { manifolds, points, impulses, .. } = self;
        ManifoldCacheView { manifolds, points, impulses, before: [0; 2] }
    }

    /// Returns a mutable view of all manifolds.
    pub(crate) fn view_mut(&mut self) -> ManifoldCacheMut<'_, L> {
        let Self { manifolds, points, impulses, reuse } = self;
        ManifoldCacheMut { manifolds, points, impulses, reuse, before: [0; 2] }
    }

    /// Appends a manifold with `count` points, which the caller sets.
    pub(crate) fn add(
        &mut self,
        count: usize,
    ) -> (&mut CachedManifold<L>, &mut [CachedPoint<L>], &mut [CachedImpulse<L>]) {
        let first = self.points.len();
        self.points.resize(first + count, CachedPoint::OPEN);
        self.impulses.resize(first + count, CachedImpulse::default());
        let manifold =
            CachedManifold { first: first as u32, count: count as u32, ..CachedManifold::NONE };
        self.reuse.push(Reuse::New);
        let manifold = self.manifolds.push_mut(manifold);
        (manifold, &mut self.points[first..], &mut self.impulses[first..])
    }

    /// Appends the manifolds `numbers` of another cache.
    pub(crate) fn extend(&mut self, from: ManifoldCacheView<'_, L>, numbers: Range<usize>) {
        for manifold in from.of(numbers) {
            let first = self.points.len() as u32;
            self.points.extend_from_slice(from.points_of(manifold));
            self.impulses.extend_from_slice(from.impulses_of(manifold));
            self.manifolds.push(CachedManifold { first, ..*manifold });
        }
        self.reuse.resize(self.manifolds.len(), Reuse::New);
    }

    /// Appends the manifolds that a pair has in `from`, and assigns the copies to the pair. The
    /// solver must have updated their impulses.
    pub(crate) fn take_pair(&mut self, pair: &mut Pair, from: &Self) {
        let first = self.manifolds.len();
        self.extend(from.view(), pair.manifolds());
        pair.first = first as u32;
        for manifold in &mut self.manifolds[first..] {
            manifold.impulse_normal = manifold.normal;
        }
    }
}

/// A range of manifolds.
#[derive(Clone, Copy)]
pub(crate) struct ManifoldCacheView<'a, const L: usize> {
    manifolds: &'a [CachedManifold<L>],
    points: &'a [CachedPoint<L>],
    impulses: &'a [CachedImpulse<L>],
    /// Number of manifolds and number of points before the range.
    before: [usize; 2],
}

/// A range of manifolds that can be changed.
#[derive(Default)]
pub(crate) struct ManifoldCacheMut<'a, const L: usize> {
    manifolds: &'a mut [CachedManifold<L>],
    points: &'a mut [CachedPoint<L>],
    impulses: &'a mut [CachedImpulse<L>],
    reuse: &'a mut [Reuse],
    before: [usize; 2],
}

/// Returns a range with `before` subtracted.
fn after(range: Range<usize>, before: usize) -> Range<usize> {
    range.start - before..range.end - before
}

impl<'a, const L: usize> ManifoldCacheView<'a, L> {
    /// Returns the manifolds with these indices.
    pub(crate) fn of(self, numbers: Range<usize>) -> &'a [CachedManifold<L>] {
        if numbers.is_empty() { &[] } else { &self.manifolds[after(numbers, self.before[0])] }
    }

    /// Returns the points of a manifold of the range.
    pub(crate) fn points_of(self, manifold: &CachedManifold<L>) -> &'a [CachedPoint<L>] {
        &self.points[after(manifold.points(), self.before[1])]
    }

    /// Returns the impulses, gaps and slips of the points of a manifold.
    pub(crate) fn impulses_of(self, manifold: &CachedManifold<L>) -> &'a [CachedImpulse<L>] {
        &self.impulses[after(manifold.points(), self.before[1])]
    }
}

impl<'a, const L: usize> ManifoldCacheMut<'a, L> {
    pub(crate) fn view(&self) -> ManifoldCacheView<'_, L> {
        let Self { manifolds, points, impulses, before, .. } = self;
        ManifoldCacheView { manifolds, points, impulses, before: *before }
    }

    /// Splits off the manifolds with these indices and returns them. `self` keeps those after them.
    pub(crate) fn split_off(&mut self, numbers: Range<usize>) -> Self {
        let [manifolds, points] = self.before;
        let first =
            |number: usize| self.manifolds.get(number - manifolds).map(|of| of.first as usize);
        let all = points + self.points.len();
        let to = [numbers.start, numbers.end].map(|number| [number, first(number).unwrap_or(all)]);
        self.cut(to[0]);
        self.cut(to[1])
    }

    /// Splits off everything before these indices of manifold and point, and returns it.
    fn cut(&mut self, to: [usize; 2]) -> Self {
        let [manifolds, points] = [0, 1].map(|i| to[i] - self.before[i]);
        Self {
            manifolds: self.manifolds.split_off_mut(..manifolds).unwrap_or_default(),
            points: self.points.split_off_mut(..points).unwrap_or_default(),
            impulses: self.impulses.split_off_mut(..points).unwrap_or_default(),
            reuse: self.reuse.split_off_mut(..manifolds).unwrap_or_default(),
            before: std::mem::replace(&mut self.before, to),
        }
    }

    /// Marks manifolds as kept if the solver has updated them (`impulses_updated`); otherwise their
    /// marks stay. Returns the marks.
    pub(crate) fn keep(&mut self, numbers: Range<usize>, impulses_updated: bool) -> &mut [Reuse] {
        let reuse = &mut self.reuse[after(numbers.clone(), self.before[0])];
        if impulses_updated {
            reuse.iter_mut().zip(numbers).for_each(|(reuse, own)| *reuse = Reuse::Kept(own as u32));
        }
        reuse
    }

    /// Marks manifolds as changed, in the same way.
    fn change(&mut self, numbers: Range<usize>, impulses_updated: bool) {
        let reuse = self.keep(numbers, impulses_updated);
        reuse.iter_mut().for_each(|reuse| *reuse = reuse.changed());
    }

    /// Returns a manifold, its points and their impulses, to be overwritten.
    pub(crate) fn slot_mut(
        &mut self,
        number: usize,
    ) -> (&mut CachedManifold<L>, &mut [CachedPoint<L>], &mut [CachedImpulse<L>]) {
        let manifold = &mut self.manifolds[number - self.before[0]];
        let points = after(manifold.points(), self.before[1]);
        (manifold, &mut self.points[points.clone()], &mut self.impulses[points])
    }

    /// Recomputes the gaps of manifolds whose bodies are at these frames.
    ///
    /// Push points stay while the bodies have not rotated and no push point has moved relative to a
    /// body by more than `most` \[m\]. So a tower that leans because it sags remains standing.
    /// `impulses_updated` is true if the solver has updated the manifolds since their gaps were
    /// last computed.
    pub(crate) fn measure(
        &mut self,
        numbers: Range<usize>,
        [a, b]: [&Frame<L>; 2],
        (most, turned): (f32, bool),
        impulses_updated: bool,
    ) {
        let own = after(numbers.clone(), self.before[0]);
        self.change(numbers, impulses_updated);
        for manifold in &mut self.manifolds[own] {
            let normal = manifold.carrier(a, b).direction(manifold.local_normal);
            let points = after(manifold.points(), self.before[1]);
            let (points, impulses) = (&mut self.points[points.clone()], &mut self.impulses[points]);
            let passed = a.position - manifold.center_offset;
            let mut moved = 0.0f32;
            for (point, cached) in points.iter().zip(&mut *impulses) {
                cached.gap[0] = normal.dot(a.point(point.on_a) - b.point(point.on_b));
                let positions = [a.point(point.on_a), b.point(point.on_b)];
                let from_b = manifold.surfaces.normal.push_point(positions) - point.push_point;
                let from_a = from_b - passed;
                moved = moved.max(from_b.dot(from_b)).max(from_a.dot(from_a));
            }
            if impulses_updated {
                manifold.impulse_normal = manifold.normal;
            }
            if !turned && moved <= most * most {
                continue;
            }
            deepest_first(points, impulses);
            for point in points {
                let positions = [a.point(point.on_a), b.point(point.on_b)];
                point.push_point = manifold.surfaces.normal.push_point(positions);
            }
            (manifold.normal, manifold.center_offset) = (normal, a.position);
        }
    }
}

/// Writes the manifolds of a pair over those of the step before, as long as they belong to the same
/// parts and have as many points. From the first one that does not, all are appended to `cache`,
/// those already written included.
pub(crate) struct ManifoldWriter<'a, 'b, const L: usize> {
    own: &'a mut ManifoldCacheMut<'b, L>,
    /// Range of the manifolds of the step before.
    known: Range<usize>,
    /// Cache that holds that range, if the pair was asleep.
    sleeping: Option<&'a ManifoldCache<L>>,
    /// Number of manifolds written in place.
    again: usize,
    cache: &'a mut ManifoldCache<L>,
    /// Index of the first one appended.
    first: usize,
}

impl<'a, 'b, const L: usize> ManifoldWriter<'a, 'b, L> {
    pub(crate) fn new(
        own: &'a mut ManifoldCacheMut<'b, L>,
        known: Range<usize>,
        sleeping: Option<&'a ManifoldCache<L>>,
        cache: &'a mut ManifoldCache<L>,
    ) -> Self {
        let first = cache.manifolds.len();
        Self { own, known, sleeping, again: 0, cache, first }
    }

    fn old(&self) -> ManifoldCacheView<'_, L> {
        self.sleeping.map_or_else(|| self.own.view(), ManifoldCache::view)
    }

    /// Returns the cached manifold of a part.
    pub(crate) fn before(&self, part: u32) -> Option<&CachedManifold<L>> {
        self.old().of(self.known.clone()).iter().find(|known| known.part == part)
    }

    /// Returns the slot of the next manifold, and its points, which inherit the impulses of those
    /// before.
    pub(crate) fn next(
        &mut self,
        touch: &ContactManifold<L>,
        part: u32,
        a: &Frame<L>,
        b: &Frame<L>,
    ) -> (&mut CachedManifold<L>, &[CachedPoint<L>]) {
        // Copy the old points: the slot may be the one they are in.
        let (mut old_points, mut old_impulses) =
            ([CachedPoint::OPEN; MAX_POINTS], [CachedImpulse::default(); MAX_POINTS]);
        let mut count = 0;
        let old = self.old();
        if let Some(known) = self.before(part) {
            count = known.count as usize;
            old_points[..count].copy_from_slice(old.points_of(known));
            old_impulses[..count].copy_from_slice(old.impulses_of(known));
        }
        let next = self.known.start + self.again;
        let same = |next: &CachedManifold<L>| next.part == part && count == touch.points.len();
        let stays = self.sleeping.is_none() && self.cache.manifolds.len() == self.first;
        let (manifold, points, impulses) =
            if stays && next < self.known.end && old.of(next..next + 1).iter().all(same) {
                self.again += 1;
                self.own.slot_mut(next)
            } else {
                self.leave();
                self.cache.add(touch.points.len())
            };
        for ((found, point), cached) in touch.points.iter().zip(&mut *points).zip(&mut *impulses) {
            let normal = touch.surfaces.normal;
            (*point, *cached) = (CachedPoint::new(found, normal, a, b), open(found.gap));
        }
        inherit(points, impulses, (&old_points[..count], &old_impulses[..count]), MATCH_DISTANCE);
        deepest_first(points, impulses);
        (manifold, points)
    }

    /// Appends the manifolds that were written in place.
    fn leave(&mut self) {
        let found = self.known.start..self.known.start + std::mem::take(&mut self.again);
        self.cache.extend(self.own.view(), found);
    }

    /// Returns the number of manifolds, and whether all of them are written in place, with none
    /// left over.
    pub(crate) fn finish(mut self, impulses_updated: bool) -> (u32, bool) {
        let stays = self.sleeping.is_none() && self.cache.manifolds.len() == self.first;
        if stays && self.again > 0 && self.again == self.known.len() {
            self.own.change(self.known.clone(), impulses_updated);
            return (self.again as u32, true);
        }
        self.leave();
        ((self.cache.manifolds.len() - self.first) as u32, false)
    }
}

impl<const L: usize> CachedManifold<L> {
    /// An empty manifold.
    pub(crate) const NONE: Self = Self {
        bodies: [0; 2],
        friction: 0.0,
        restitution: 0.0,
        part: 0,
        surfaces: Curvature { radii: [0.0; 2], normal: NormalCarrier::Edges },
        first: 0,
        count: 0,
        normal: Vector::ZERO,
        impulse_normal: Vector::ZERO,
        center_offset: Vector::ZERO,
        local_normal: Vector::ZERO,
        found_at: Frame::IDENTITY,
        reach: 0.0,
        undecided: false,
    };

    pub(crate) fn points(&self) -> Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }

    /// Returns the frame in which its local normal is constant: that of the body with the face.
    pub(crate) fn carrier<'a>(&self, a: &'a Frame<L>, b: &'a Frame<L>) -> &'a Frame<L> {
        if self.surfaces.normal == NormalCarrier::FaceOfA { a } else { b }
    }
}

/// Returns the data of a new point: no impulse, no slip, and this gap \[m\].
pub(crate) const fn open<const L: usize>(gap: f32) -> CachedImpulse<L> {
    let mut gaps = [0.0; L];
    gaps[0] = gap;
    CachedImpulse { impulse: Vector([0.0; L]), gap: Vector(gaps) }
}

/// Moves the deepest point to the front: its plane is that of the manifold.
#[inline]
pub(crate) fn deepest_first<const L: usize>(
    points: &mut [CachedPoint<L>],
    impulses: &mut [CachedImpulse<L>],
) {
    if impulses.len() < 2 {
        return;
    }
    let gap = |of: usize| impulses[of].gap[0];
    let deepest =
        (1..impulses.len()).fold(0, |most, of| if gap(of) < gap(most) { of } else { most });
    points.swap(0, deepest);
    impulses.swap(0, deepest);
}

/// Returns the largest distance of points from the center of mass of a. \[m\]
pub(crate) fn reach<const L: usize>(points: &[CachedPoint<L>]) -> f32 {
    points.iter().map(|point| point.on_a.dot(point.on_a)).fold(0.0, f32::max).sqrt()
}

/// Copies impulses and slips from the old points of the same manifold. Each point takes those of
/// the point with the same feature, or else of a point within `match_distance` \[m\] on a.
fn inherit<const L: usize>(
    points: &[CachedPoint<L>],
    impulses: &mut [CachedImpulse<L>],
    (old, old_impulses): (&[CachedPoint<L>], &[CachedImpulse<L>]),
    match_distance: f32,
) {
    let mut taken = [false; MAX_POINTS];
    let mut matched = [false; MAX_POINTS];
    let squared = match_distance * match_distance;
    for by_feature in [true, false] {
        for ((point, cached), done) in points.iter().zip(&mut *impulses).zip(&mut matched) {
            if *done {
                continue;
            }
            let found = old.iter().enumerate().position(|(i, candidate)| {
                let apart = candidate.on_a - point.on_a;
                !taken[i]
                    && if by_feature {
                        candidate.feature == point.feature
                    } else {
                        apart.dot(apart) < squared
                    }
            });
            if let Some(i) = found {
                taken[i] = true;
                *done = true;
                let gap = cached.gap[0];
                *cached = old_impulses[i];
                cached.gap[0] = gap;
            }
        }
    }
}

impl<const L: usize> CachedPoint<L> {
    /// An absent point.
    pub(crate) const OPEN: Self =
        Self { on_a: Vector::ZERO, on_b: Vector::ZERO, push_point: Vector::ZERO, feature: 0 };

    fn new(touch: &ManifoldPoint<L>, normal: NormalCarrier, a: &Frame<L>, b: &Frame<L>) -> Self {
        Self {
            on_a: a.local_point(touch.on_a),
            on_b: b.local_point(touch.on_b),
            push_point: normal.push_point([touch.on_a, touch.on_b]),
            feature: touch.feature,
        }
    }
}

#[cfg(test)]
mod tests;
