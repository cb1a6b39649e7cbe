//! Which shapes are near each other: boxes in a tree that follows them as they move.

mod tree;

use drystone_solver::team::Team;
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
    /// none if it is not within. \[m\]
    pub(crate) fn room(&self, shape: usize, needed: &Bounds<L>) -> f32 {
        let stored = &self.boxes[shape];
        let sides =
            (0..L).map(|i| (needed.min[i] - stored.min[i]).min(stored.max[i] - needed.max[i]));
        sides.fold(f32::INFINITY, f32::min)
    }

    /// Adds a shape, the next in order.
    pub(crate) fn add(&mut self, needed: &Bounds<L>) {
        let shape = self.grow();
        self.update(shape, needed);
    }

    /// The number of the next shape, which has no box yet.
    fn grow(&mut self) -> u32 {
        self.boxes.push(Bounds::NOTHING);
        self.moves.push(false);
        self.boxes.len() as u32 - 1
    }

    /// Makes room for `needed` where it has grown out of its box.
    pub(crate) fn update(&mut self, shape: u32, needed: &Bounds<L>) {
        if self.room(shape as usize, needed) >= 0.0 {
            return;
        }
        let extent = needed.max - needed.min;
        let margin = extent * MARGIN;
        let stored = Bounds { min: needed.min - margin, max: needed.max + margin };
        self.store(shape, Some(&stored));
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
        self.boxes[shape as usize] = stored.copied().unwrap_or(Bounds::NOTHING);
        if !std::mem::replace(&mut self.moves[shape as usize], true) {
            self.moved.push(shape);
        }
    }

    /// Forgets a shape.
    pub(crate) fn remove(&mut self, shape: u32) {
        self.store(shape, None);
    }

    /// Drops the pairs whose boxes overlap no more, and returns those that have come to overlap since the last
    /// call, lower index first, sorted; none if no box has changed.
    pub(crate) fn follow<'a>(
        &'a mut self,
        pairs: &'a mut Vec<Pair>,
        team: &Team,
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
        let found = tree.overlaps(team);
        // To a tree that goes on all are new.
        let known = if std::mem::take(goes_on) { &pairs[..] } else { &[] };
        let is_new = |pair: &[u32; 2]| {
            known.is_empty() || known.binary_search_by(|of| of.colliders.cmp(pair)).is_err()
        };
        Some(found.iter().map(|&pair| [(pair >> 32) as u32, pair as u32]).filter(is_new))
    }
}
