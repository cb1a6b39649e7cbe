//! The tree finds the same overlaps as comparing all pairs of boxes.

use super::*;
use crate::geometry::random::Random;
use std::collections::BTreeSet;

/// Returns a random box in a room of this size; one in sixteen is large.
fn some<const L: usize>(random: &mut Random, room: f32) -> Bounds<L> {
    let center: [f32; L] = std::array::from_fn(|_| room * random.number());
    let large = if random.number() > 0.875 { 0.5 * room } else { 0.5 };
    let half: [f32; L] = std::array::from_fn(|_| large * random.number().abs());
    Bounds { min: Vector(center) - Vector(half), max: Vector(center) + Vector(half) }
}

fn finds_what_overlaps<const L: usize>(seed: u64, count: usize, steps: usize) {
    let pool = ThreadPool::new(1 + seed as usize % 3);
    let mut random = Random(seed);
    let room = 0.5 * (count as f32).powf(1.0 / L as f32);
    let mut tree = Tree::<L>::default();
    let mut boxes: Vec<Option<Bounds<L>>> = vec![None; count];
    for step in 0..steps {
        let before = boxes.clone();
        for number in 0..count {
            let chance = random.number();
            let to = match boxes[number] {
                // Fewer and fewer boxes move, until all move at once.
                _ if step > 0 && step % 8 != 7 && chance > 2.0 / step as f32 - 1.0 => continue,
                Some(_) if chance < -0.98 => None,
                Some(own) if chance < 0.0 => {
                    let by = Vector(std::array::from_fn(|_| random.number()));
                    Some(Bounds { min: own.min + by, max: own.max + by })
                }
                _ => Some(some(&mut random, room)),
            };
            tree.set(number as u32, to.as_ref());
            boxes[number] = to;
        }
        let mut expected = BTreeSet::new();
        for a in 0..count as u32 {
            for b in a + 1..count as u32 {
                let near = |boxes: &[Option<Bounds<L>>]| {
                    let both = boxes[a as usize].zip(boxes[b as usize]);
                    both.is_some_and(|(a, b)| a.overlaps(&b))
                };
                if near(&boxes) && !near(&before) {
                    expected.insert((a, b));
                }
            }
        }
        let pair = |both: &u64| ((both >> 32) as u32, *both as u32);
        let found: Vec<_> = tree.overlaps(&pool).iter().map(pair).collect();
        assert_eq!(found, Vec::from_iter(expected), "{count} boxes, step {step}");
    }
    assert!(tree.overlaps(&pool).is_empty(), "nothing has changed");
}

#[test]
fn finds_each_overlap_once() {
    for (seed, count) in [0, 1, 2, 7, 8, 9, 63, 64, 65, 100, 520].into_iter().enumerate() {
        finds_what_overlaps::<2>(seed as u64, count, 40);
        finds_what_overlaps::<3>(seed as u64, count, 40);
    }
}

#[test]
fn is_rebuilt_only_where_it_has_degraded() {
    let mut tree = Tree::<2>::default();
    let at = |x: f32, y: f32| {
        let (center, half) = (Vector([x, y]), Vector([0.4; 2]));
        Bounds { min: center - half, max: center + half }
    };
    let mut built = 0;
    for step in 0..30 {
        for number in 0..1024u32 {
            // Rows of boxes move past each other.
            let (x, y) = ((number % 32) as f32, (number / 32) as f32);
            tree.set(number, Some(&at(x + 0.1 * y * step as f32, y)));
        }
        let before = tree.built.clone();
        tree.overlaps(&ThreadPool::default());
        built += usize::from(tree.built != before);
        assert!(tree.degradation <= DEGRADED * 128.0, "step {step}: {}", tree.degradation / 128.0);
    }
    assert!((2..=15).contains(&built), "built {built} times in 30 steps");
}
