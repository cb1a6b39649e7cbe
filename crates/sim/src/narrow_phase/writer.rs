//! Storage of the manifolds that are found for a pair, in place where possible.

use std::ops::Range;

use drystone_solver::lanes::CachedImpulse;

use crate::cache::{
    self, CachedManifold, CachedPoint, ManifoldCache, ManifoldCacheMut, ManifoldCacheView, inherit,
};
use crate::geometry::{ContactManifold, Frame, MAX_POINTS};

/// Largest distance at which contact points are matched by position, if their features do not
/// match. \[m\]
const MATCH_DISTANCE: f32 = 0.02;

/// Writes the manifolds of a pair over those of the step before, as long as they belong to the same
/// parts and have as many points. From the first one that does not, all are appended to `cache`,
/// those already written included.
pub(super) struct ManifoldWriter<'a, 'b, const L: usize> {
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
    pub(super) fn new(
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
    pub(super) fn before(&self, part: u32) -> Option<&CachedManifold<L>> {
        self.old().of(self.known.clone()).iter().find(|known| known.part == part)
    }

    /// Returns the slot of the next manifold, and its points, which inherit the impulses of those
    /// before.
    pub(super) fn next(
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
            (*point, *cached) = (CachedPoint::new(found, normal, a, b), cache::open(found.gap));
        }
        inherit(points, impulses, (&old_points[..count], &old_impulses[..count]), MATCH_DISTANCE);
        cache::deepest_first(points, impulses);
        (manifold, points)
    }

    /// Appends the manifolds that were written in place.
    fn leave(&mut self) {
        let found = self.known.start..self.known.start + std::mem::take(&mut self.again);
        self.cache.extend(self.own.view(), found);
    }

    /// Returns the number of manifolds, and whether all of them are written in place, with none
    /// left over.
    pub(super) fn finish(mut self, impulses_updated: bool) -> (u32, bool) {
        let stays = self.sleeping.is_none() && self.cache.manifolds.len() == self.first;
        if stays && self.again > 0 && self.again == self.known.len() {
            self.own.change(self.known.clone(), impulses_updated);
            return (self.again as u32, true);
        }
        self.leave();
        ((self.cache.manifolds.len() - self.first) as u32, false)
    }
}

#[cfg(test)]
mod tests {
    use drystone_solver::Vector;

    use super::*;
    use crate::geometry::ManifoldPoint;
    use crate::geometry::random::Random;

    /// Manifolds written in place and appended ones are equal. The parts are the same, fewer, more,
    /// or others, with as many points or others.
    #[test]
    fn manifolds_in_place_equal_appended_ones() {
        let mut random = Random(3);
        let (mut again, mut elsewhere) = (0, 0);
        for _ in 0..500 {
            let mut old = ManifoldCache::default();
            let first = random.touches();
            // Another pair comes before.
            find(&mut ManifoldCacheMut::default(), 0..0, None, &mut old, &random.touches());
            let known = old.manifolds.len();
            find(&mut ManifoldCacheMut::default(), 0..0, None, &mut old, &first);
            let known = known..old.manifolds.len();
            for (cached, number) in old.impulses.iter_mut().zip(1..) {
                cached.impulse[0] = number as f32;
            }
            let then = random.touches_like(&first);
            let was_sleeping = old.clone();
            let mut appended = ManifoldCache::default();
            let (count, stays) = find(
                &mut ManifoldCacheMut::default(),
                known.clone(),
                Some(&was_sleeping),
                &mut appended,
                &then,
            );
            assert!(!stays && count as usize == then.len());
            let mut cache = ManifoldCache::default();
            let found = find(&mut old.view_mut(), known.clone(), None, &mut cache, &then);
            assert_eq!(found.0, count);
            let (view, numbers) = if found.1 {
                again += 1;
                (old.view(), known)
            } else {
                elsewhere += 1;
                (cache.view(), 0..count as usize)
            };
            assert_eq!(view.of(numbers.clone()).len(), then.len());
            for (own, other) in view.of(numbers).iter().zip(&appended.manifolds) {
                assert_eq!((own.part, own.count), (other.part, other.count));
                let all = appended.view();
                assert_eq!(view.points_of(own), all.points_of(other));
                assert_eq!(view.impulses_of(own), all.impulses_of(other));
            }
        }
        assert!(again > 50 && elsewhere > 50, "{again} and {elsewhere}");
    }

    fn find(
        own: &mut ManifoldCacheMut<'_, 2>,
        known: Range<usize>,
        sleeping: Option<&ManifoldCache<2>>,
        cache: &mut ManifoldCache<2>,
        touches: &[ContactManifold<2>],
    ) -> (u32, bool) {
        let mut places = ManifoldWriter::new(own, known, sleeping, cache);
        for touch in touches {
            let (manifold, _) = places.next(touch, touch.part, &Frame::IDENTITY, &Frame::IDENTITY);
            manifold.part = touch.part;
        }
        places.finish(true)
    }

    impl Random {
        fn below(&mut self, most: u32) -> u32 {
            ((0.5 + 0.5 * self.number()) * most as f32) as u32
        }

        fn touches(&mut self) -> Vec<ContactManifold<2>> {
            (0..self.below(4)).map(|part| self.touch(part)).collect()
        }

        fn touch(&mut self, part: u32) -> ContactManifold<2> {
            let points = (0..1 + self.below(2)).map(|corner| {
                let at = Vector([self.number(), self.number()]);
                let feature = u64::from(corner + self.below(2));
                ManifoldPoint { on_a: at, on_b: at, gap: self.number(), feature }
            });
            let points = points.collect();
            ContactManifold {
                part,
                normal: Vector([0.0, 1.0]),
                points,
                ..ContactManifold::default()
            }
        }

        /// Returns manifolds mostly of the same parts, with as many points.
        fn touches_like(&mut self, known: &[ContactManifold<2>]) -> Vec<ContactManifold<2>> {
            let mut out = known.to_vec();
            for touch in &mut out {
                if self.below(6) == 0 {
                    let other = 5 * self.below(2);
                    *touch = self.touch(touch.part + other);
                }
            }
            match self.below(8) {
                0 => drop(out.pop()),
                1 => out.push(self.touch(9)),
                2 => drop(out.drain(..out.len().min(1))),
                _ => {}
            }
            out
        }
    }
}
