//! Broad phase: pairs of near shapes, by a tree of bounding boxes that follows the shapes.

mod tree;

use std::sync::OnceLock;

use drystone_solver::Vector;
use drystone_solver::thread_pool::ThreadPool;
use tree::Tree;

use crate::cache::Pair;
use crate::geometry::{Bounds, Ray};

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
    is_restored: bool,
    /// Current boxes of the shapes that queries do not find in `tree`; reset by each method that
    /// changes it.
    outside: OnceLock<Tree<L>>,
}

/// The current boxes of all shapes, for queries. A box may be larger than its shape needs.
pub(crate) struct BoxIndex<'a, const L: usize> {
    tree: &'a Tree<L>,
    outside: &'a Tree<L>,
}

impl<const L: usize> BoxIndex<'_, L> {
    /// Calls `found` with each shape whose box overlaps this one, none if it has a NaN.
    pub(crate) fn visit(&self, bounds: &Bounds<L>, mut found: impl FnMut(u32)) {
        let Some(bounds) = clamped(bounds) else { return };
        self.outside.visit(&bounds, &mut found);
        self.tree.visit(&bounds, &mut |shape| {
            if !self.outside.has(shape) {
                found(shape);
            }
        });
    }

    /// Calls `found` with each shape whose box a ray crosses. `found` may shorten the ray.
    pub(crate) fn cast(&self, ray: &mut Ray<L>, mut found: impl FnMut(u32, &mut Ray<L>)) {
        self.outside.cast(ray, &mut found);
        self.tree.cast(ray, &mut |shape, ray| {
            if !self.outside.has(shape) {
                found(shape, ray);
            }
        });
    }
}

/// Returns a box with infinite sides clamped to the largest number, since the tree uses infinity
/// for empty boxes; none if a side is NaN.
fn clamped<const L: usize>(bounds: &Bounds<L>) -> Option<Bounds<L>> {
    let has_nan = bounds.min.0.iter().chain(&bounds.max.0).any(|x| x.is_nan());
    let within = |side: Vector<f32, L>| Vector(side.0.map(|x| x.clamp(f32::MIN, f32::MAX)));
    (!has_nan).then(|| Bounds { min: within(bounds.min), max: within(bounds.max) })
}

impl<const L: usize> BroadPhase<L> {
    pub(crate) fn new() -> Self {
        Self {
            tree: Tree::default(),
            boxes: Vec::new(),
            moved: Vec::new(),
            moves: Vec::new(),
            is_restored: false,
            outside: OnceLock::new(),
        }
    }

    /// Returns the margin of a shape's stored box around `needed`, the smallest of all sides. \[m\]
    /// It is negative if `needed` is not within the stored box, and negative infinity if `needed`
    /// contains a NaN.
    pub(crate) fn margin(&self, shape: usize, needed: &Bounds<L>) -> f32 {
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
    /// is near no other until the box is finite again.
    pub(crate) fn update(&mut self, shape: u32, needed: &Bounds<L>) {
        self.outside = OnceLock::new();
        if self.margin(shape as usize, needed) >= 0.0 {
            return;
        }
        let extent = needed.max - needed.min;
        let margin = extent * MARGIN;
        let stored = Bounds { min: needed.min - margin, max: needed.max + margin };
        self.store(shape, clamped(&stored).as_ref());
    }

    /// True if the tree finds the stored box of a shape: the box has not changed since the last
    /// query for pairs.
    pub(crate) fn is_settled(&self, shape: usize) -> bool {
        !self.moves[shape]
    }

    /// Returns the boxes of all shapes for queries. `outside` returns the current boxes of those
    /// that are not settled or not within their stored boxes. It is called once after each change.
    pub(crate) fn index(&self, outside: impl FnOnce() -> Vec<(u32, Bounds<L>)>) -> BoxIndex<'_, L> {
        let boxes = || outside().into_iter();
        let tree =
            || Tree::of(boxes().filter_map(|(shape, bounds)| Some((shape, clamped(&bounds)?))));
        BoxIndex { tree: &self.tree, outside: self.outside.get_or_init(tree) }
    }

    /// Returns the stored boxes of all shapes.
    pub(crate) fn boxes(&self) -> &[Bounds<L>] {
        &self.boxes
    }

    /// Returns a broad phase with boxes that another one has stored; removed shapes have none.
    pub(crate) fn with_boxes(boxes: impl Iterator<Item = Option<Bounds<L>>>) -> Self {
        let mut out = Self { is_restored: true, ..Self::new() };
        for stored in boxes {
            let shape = out.grow();
            out.store(shape, stored.as_ref());
        }
        out
    }

    fn store(&mut self, shape: u32, stored: Option<&Bounds<L>>) {
        self.outside = OnceLock::new();
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
        tree.refit();
        tree.visit(&boxes[shape as usize], &mut found);
    }

    /// Drops the pairs whose boxes no longer overlap. Returns the pairs that have started to
    /// overlap since the last call, lower index first, sorted, or `None` if no box has changed.
    pub(crate) fn follow<'a>(
        &'a mut self,
        pairs: &'a mut Vec<Pair>,
        pool: &ThreadPool,
    ) -> Option<impl Iterator<Item = [u32; 2]> + use<'a, L>> {
        let Self { tree, boxes, moved, moves, is_restored, outside } = self;
        *outside = OnceLock::new();
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
        let known = if std::mem::take(is_restored) { &pairs[..] } else { &[] };
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
