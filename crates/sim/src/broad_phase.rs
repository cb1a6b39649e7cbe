//! Broad phase: pairs of near shapes, by a tree of bounding boxes that follows the shapes.

mod tree;

use drystone_solver::Vector;
use drystone_solver::thread_pool::ThreadPool;
use tree::Tree;

use crate::cache::Pair;
use crate::geometry::Bounds;

/// Margin of stored boxes as a fraction of their size: a shape has to leave its box before the tree
/// changes. \[1\]
const MARGIN: f32 = 0.05;

/// The tree over the bounding boxes of all shapes.
pub(crate) struct BroadPhase<const L: usize> {
    tree: Tree<L>,
    /// Enlarged box of each shape.
    boxes: Vec<Bounds<L>>,
    /// Shapes whose boxes have changed since the last query, and a flag for each shape.
    moved: Vec<u32>,
    moves: Vec<bool>,
    /// True if it started with the boxes of another broad phase, whose pairs may be known.
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

    /// Returns the margin of a shape's stored box around `needed`, the smallest of all sides. \[m\]
    /// It is negative if `needed` is not within the stored box, and negative infinity if `needed`
    /// contains a NaN.
    pub(crate) fn room(&self, shape: usize, needed: &Bounds<L>) -> f32 {
        let stored = &self.boxes[shape];
        let sides =
            (0..L).map(|i| (needed.min[i] - stored.min[i]).min(stored.max[i] - needed.max[i]));
        // The minimum of a number and NaN is the number, but their sum is NaN.
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

    /// Returns the number of the next shape, which has no box yet.
    fn grow(&mut self) -> u32 {
        self.boxes.push(Bounds::EMPTY);
        self.moves.push(false);
        self.boxes.len() as u32 - 1
    }

    /// Enlarges the box of a shape if `needed` is not within it. A shape whose box contains a NaN
    /// is near no other until the box is finite again. Infinite boxes are clamped to the largest
    /// number, since the tree uses infinity for empty boxes.
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

    /// Returns the stored boxes of all shapes.
    pub(crate) fn boxes(&self) -> &[Bounds<L>] {
        &self.boxes
    }

    /// Returns a broad phase with boxes that another one has stored; removed shapes have none.
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

    /// Removes a shape.
    pub(crate) fn remove(&mut self, shape: u32) {
        self.store(shape, None);
    }

    /// Calls `found` with each shape whose stored box overlaps that of `shape`, which is one of
    /// them.
    pub(crate) fn overlapping(&mut self, shape: u32, mut found: impl FnMut(u32)) {
        let Self { tree, boxes, .. } = self;
        tree.visit(&boxes[shape as usize], &mut found);
    }

    /// Drops the pairs whose boxes no longer overlap. Returns the pairs that have started to
    /// overlap since the last call, lower index first, sorted, or `None` if no box has changed.
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
        // To a tree that starts with stored boxes, all pairs are new.
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
            // Moves it onto a neighbor.
            phase.update(3, &at(8.2));
            let found = pairs(&mut phase, &mut known);
            assert!(found.is_empty() || found == [[3, 4]], "{wrong}: {found:?}");
        }
    }
}
