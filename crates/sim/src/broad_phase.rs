//! Which shapes are near each other: boxes in a tree that follows them as they move.

mod tree;

use drystone_solver::Vector;
use drystone_solver::thread_pool::ThreadPool;
use tree::Tree;

use crate::cache::Pair;
use crate::geometry::Bounds;

/// Boxes are stored larger than needed by this part of their size, so that a shape has to move
/// before the tree changes.
const MARGIN: f32 = 0.05;

/// The tree over the boxes of all shapes.
pub(crate) struct BroadPhase<const L: usize> {
    tree: Tree<L>,
    /// The enlarged box of each shape.
    boxes: Vec<Bounds<L>>,
    /// Which have changed since pairs were last asked for, and for each whether it has.
    moved: Vec<u32>,
    moves: Vec<bool>,
    /// Whether it goes on from the boxes of another, whose pairs may be known.
    goes_on: bool,
}

impl<const L: usize> BroadPhase<L> {
    pub(crate) fn new() -> Self {
        Self {
            tree: Tree::default(),
            boxes: Vec::new(),
            moved: Vec::new(),
            moves: Vec::new(),
            goes_on: false,
        }
    }

    /// How much more room a shape that needs this much has in its stored box, on each side; less than
    /// none if it is not within, and so for a box that has a NaN. \[m\]
    pub(crate) fn room(&self, shape: usize, needed: &Bounds<L>) -> f32 {
        let stored = &self.boxes[shape];
        let sides =
            (0..L).map(|i| (needed.min[i] - stored.min[i]).min(stored.max[i] - needed.max[i]));
        // The smaller of a number and NaN is the number, but their sum is NaN.
        let (least, sum) = sides
            .fold((f32::INFINITY, 0.0), |(least, sum), side| (f32::min(least, side), sum + side));
        if sum.is_nan() { f32::NEG_INFINITY } else { least }
    }

    /// Adds a shape: one that was removed, or the next in order.
    pub(crate) fn insert(&mut self, shape: u32, needed: &Bounds<L>) {
        if shape as usize == self.boxes.len() {
            self.grow();
        }
        self.update(shape, needed);
    }

    /// The number of the next shape, which has no box yet.
    fn grow(&mut self) -> u32 {
        self.boxes.push(Bounds::EMPTY);
        self.moves.push(false);
        self.boxes.len() as u32 - 1
    }

    /// Makes room for `needed` where it has grown out of its box. A box that has a NaN is near nothing until it
    /// has none; one that is infinite ends at the largest number, since the tree takes infinity for no box.
    pub(crate) fn update(&mut self, shape: u32, needed: &Bounds<L>) {
        if self.room(shape as usize, needed) >= 0.0 {
            return;
        }
        let extent = needed.max - needed.min;
        let margin = extent * MARGIN;
        let stored = Bounds { min: needed.min - margin, max: needed.max + margin };
        let sides = stored.min.0.iter().chain(&stored.max.0);
        if sides.clone().any(|x| x.is_nan()) {
            return self.remove(shape);
        }
        let within = |side: Vector<f32, L>| Vector(side.0.map(|x| x.clamp(f32::MIN, f32::MAX)));
        self.store(shape, Some(&Bounds { min: within(stored.min), max: within(stored.max) }));
    }

    /// The boxes of all shapes as they are stored.
    pub(crate) fn boxes(&self) -> &[Bounds<L>] {
        &self.boxes
    }

    /// A broad phase that goes on from boxes that another has stored; none for removed shapes.
    pub(crate) fn with_boxes(boxes: impl Iterator<Item = Option<Bounds<L>>>) -> Self {
        let mut out = Self { goes_on: true, ..Self::new() };
        for stored in boxes {
            let shape = out.grow();
            out.store(shape, stored.as_ref());
        }
        out
    }

    fn store(&mut self, shape: u32, stored: Option<&Bounds<L>>) {
        self.tree.set(shape, stored);
        self.boxes[shape as usize] = stored.copied().unwrap_or(Bounds::EMPTY);
        if !std::mem::replace(&mut self.moves[shape as usize], true) {
            self.moved.push(shape);
        }
    }

    /// Forgets a shape.
    pub(crate) fn remove(&mut self, shape: u32) {
        self.store(shape, None);
    }

    /// Calls `found` with each shape whose stored box overlaps that of `shape`, which is one of them.
    pub(crate) fn overlapping(&mut self, shape: u32, mut found: impl FnMut(u32)) {
        let Self { tree, boxes, .. } = self;
        tree.visit(&boxes[shape as usize], &mut found);
    }

    /// Drops the pairs whose boxes overlap no more, and returns those that have come to overlap since the last
    /// call, lower index first, sorted; none if no box has changed.
    pub(crate) fn follow<'a>(
        &'a mut self,
        pairs: &'a mut Vec<Pair>,
        pool: &ThreadPool,
    ) -> Option<impl Iterator<Item = [u32; 2]> + use<'a, L>> {
        let Self { tree, boxes, moved, moves, goes_on } = self;
        if moved.is_empty() {
            return None;
        }
        pairs.retain(|pair| {
            let [a, b] = pair.colliders;
            let (a, b) = (a as usize, b as usize);
            !(moves[a] || moves[b]) || boxes[a].overlaps(&boxes[b])
        });
        moved.drain(..).for_each(|shape| moves[shape as usize] = false);
        let found = tree.overlaps(pool);
        // To a tree that goes on all are new.
        let known = if std::mem::take(goes_on) { &pairs[..] } else { &[] };
        let is_new = |pair: &[u32; 2]| {
            known.is_empty() || known.binary_search_by(|of| of.colliders.cmp(pair)).is_err()
        };
        Some(found.iter().map(|&pair| [(pair >> 32) as u32, pair as u32]).filter(is_new))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f32) -> Bounds<3> {
        Bounds { min: Vector([x - 0.5, -0.5, -0.5]), max: Vector([x + 0.5, 0.5, 0.5]) }
    }

    fn pairs(of: &mut BroadPhase<3>, known: &mut Vec<Pair>) -> Vec<[u32; 2]> {
        of.follow(known, &ThreadPool::default()).map_or(Vec::new(), Iterator::collect)
    }

    #[test]
    fn boxes_that_are_not_finite_are_near_nothing_and_come_back() {
        for wrong in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX] {
            let mut phase = BroadPhase::new();
            (0..20).for_each(|i| phase.insert(i, &at(2.0 * i as f32)));
            let mut known = Vec::new();
            assert!(pairs(&mut phase, &mut known).is_empty());
            for needed in [at(wrong), Bounds { min: Vector([wrong; 3]), ..at(0.0) }] {
                phase.update(3, &needed);
                for found in pairs(&mut phase, &mut known) {
                    assert!(found.contains(&3) && found[1] < 20, "{wrong}: {found:?}");
                }
            }
            // To a neighbor's place.
            phase.update(3, &at(8.2));
            let found = pairs(&mut phase, &mut known);
            assert!(found.is_empty() || found == [[3, 4]], "{wrong}: {found:?}");
        }
    }
}
