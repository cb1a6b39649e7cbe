use super::*;
use crate::geometry::random::Random;

/// The deepest point comes first, together with its data. Of equal points the first one stays
/// first.
#[test]
fn the_deepest_point_comes_first() {
    for (gaps, first) in [([0.1, -0.2, 0.3], 1), ([0.0, 0.0, 0.0], 0), ([0.2, 0.1, -0.1], 2)] {
        let mut points = [0, 1, 2].map(|feature| CachedPoint::<2> { feature, ..CachedPoint::OPEN });
        let mut impulses = gaps.map(open::<2>);
        deepest_first(&mut points, &mut impulses);
        assert_eq!(points[0].feature, first, "{gaps:?}");
        for (point, cached) in points.iter().zip(&impulses) {
            assert_eq!(cached.gap[0], gaps[point.feature as usize], "{gaps:?}");
        }
    }
}

/// Two clouds of points translate and rotate. Their distance is never less than the remaining
/// clearance.
#[test]
fn remaining_clearance_bounds_the_distance() {
    let mut random = Random(3);
    let mut crowd = || -> Vec<Vector<f32, 2>> {
        (0..20).map(|_| Vector([random.number(), random.number()])).collect()
    };
    let crowds = [crowd(), crowd()];
    let cores = crowds.each_ref().map(|of| of.iter().map(|p| p.length()).fold(0.0, f32::max));
    let (mut positions, mut angles) = ([Vector([0.0, 0.0]), Vector([5.0, 0.0])], [0.0f32; 2]);
    let apart = |positions: &[Vector<f32, 2>; 2], angles: &[f32; 2]| {
        let [a, b] = [0, 1].map(|i| {
            let (sin, cos) = angles[i].sin_cos();
            let axes = [Vector([cos, sin]), Vector([-sin, cos])];
            let frame = Frame { position: positions[i], axes };
            crowds[i].iter().map(|p| frame.point(*p)).collect::<Vec<_>>()
        });
        let all = a.iter().flat_map(|p| b.iter().map(|q| (*p - *q).length()));
        all.fold(f32::INFINITY, f32::min)
    };
    let mut pair = Pair { bodies: [0, 1], clearance: apart(&positions, &angles), ..Pair::APART };
    let mut steps = 0;
    while pair.clearance > 0.0 {
        let mut since_search = [SearchMotion::NOWHERE; 2];
        for i in 0..2 {
            let towards = if i == 0 { 0.02 } else { -0.02 };
            since_search[i].linear = Vector([towards + 0.05, 0.05 * random.number()]);
            let turn = 0.05 * random.number();
            since_search[i].turned = turn.abs() * cores[i];
            positions[i] += since_search[i].linear;
            angles[i] += turn;
        }
        pair.clearance = pair.left(&since_search);
        let distance = apart(&positions, &angles);
        assert!(pair.clearance <= distance + 1e-5, "{} m left of {distance} m", pair.clearance);
        steps += 1;
    }
    // They move together much faster than they approach.
    assert!(steps > 20, "{steps}");
}

/// A displacement below the rounding error is subtracted, too.
#[test]
fn slow_motion_uses_up_clearance() {
    let mut pair = Pair { bodies: [0, 1], clearance: 1.0, ..Pair::APART };
    let creeping = SearchMotion { linear: Vector([1e-8, 0.0]), turned: 0.0 };
    for _ in 0..100_000 {
        pair.clearance = pair.left(&[creeping, SearchMotion::NOWHERE]);
    }
    assert!(pair.clearance < 1.0 - 1e-3 && pair.clearance > 0.9, "{}", pair.clearance);
}

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
    let mut writer = ManifoldWriter::new(own, known, sleeping, cache);
    for touch in touches {
        let (manifold, _) = writer.next(touch, touch.part, &Frame::IDENTITY, &Frame::IDENTITY);
        manifold.part = touch.part;
    }
    writer.finish(true)
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
        ContactManifold { part, normal: Vector([0.0, 1.0]), points, ..ContactManifold::default() }
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
