//! Which shapes are near each other: boxes in a tree that follows them as they move.
//!
//! One tree serves all dimensions: in 2D, boxes of space with a fixed thickness.

use drystone_solver::Vector;
use parry3d::bounding_volume::Aabb;
use parry3d::partitioning::{Bvh, BvhWorkspace};

use crate::cache::Pair;
use crate::geometry::Bounds;

/// Boxes are stored larger than needed by this part of their size, so that a shape has to move
/// before the tree changes.
const MARGIN: f32 = 0.05;

/// The tree over the boxes of all shapes.
pub(crate) struct BroadPhase<const L: usize> {
    tree: Bvh,
    workspace: BvhWorkspace,
    /// The enlarged box of each shape; none for removed ones.
    boxes: Vec<Option<Bounds<L>>>,
    /// Which of them are others than when it was last asked what has parted.
    moved: Vec<bool>,
    /// Pairs, the lower index in the upper half: they sort as one number.
    found: Vec<u64>,
    changed: bool,
}

impl<const L: usize> BroadPhase<L> {
    pub(crate) fn new() -> Self {
        Self {
            tree: Bvh::new(),
            workspace: BvhWorkspace::default(),
            boxes: Vec::new(),
            moved: Vec::new(),
            found: Vec::new(),
            changed: false,
        }
    }

    /// How much more room a shape that needs this much has in its stored box, on each side; less than
    /// none if it is not within. \[m\]
    pub(crate) fn room(&self, shape: usize, needed: &Bounds<L>) -> f32 {
        let Some(stored) = self.boxes.get(shape).copied().flatten() else {
            return f32::NEG_INFINITY;
        };
        let sides =
            (0..L).map(|i| (needed.min[i] - stored.min[i]).min(stored.max[i] - needed.max[i]));
        sides.fold(f32::INFINITY, f32::min)
    }

    /// Makes room for `needed` where it has grown out of its box.
    pub(crate) fn update(&mut self, shape: u32, needed: &Bounds<L>) {
        let index = shape as usize;
        if self.boxes.len() <= index {
            self.boxes.resize(index + 1, None);
            self.moved.resize(index + 1, false);
        }
        if self.room(index, needed) >= 0.0 {
            return;
        }
        let extent = needed.max - needed.min;
        let margin = extent * MARGIN;
        self.store(shape, Bounds { min: needed.min - margin, max: needed.max + margin });
    }

    /// The boxes of all shapes as they are stored; none for removed ones.
    pub(crate) fn boxes(&self) -> &[Option<Bounds<L>>] {
        &self.boxes
    }

    /// A broad phase that goes on from boxes that another has stored.
    pub(crate) fn with_boxes(boxes: impl Iterator<Item = Option<Bounds<L>>>) -> Self {
        let mut out = Self::new();
        for (shape, stored) in boxes.enumerate() {
            out.boxes.push(None);
            out.moved.push(false);
            if let Some(stored) = stored {
                out.store(shape as u32, stored);
            }
        }
        out
    }

    fn store(&mut self, shape: u32, stored: Bounds<L>) {
        self.boxes[shape as usize] = Some(stored);
        self.moved[shape as usize] = true;
        // The tree reports a leaf as changed only when it is given a margin; ours is already in.
        self.tree.insert_or_update_partially(aabb(&stored), shape, f32::MIN_POSITIVE);
        self.changed = true;
    }

    /// Forgets a shape.
    pub(crate) fn remove(&mut self, shape: u32) {
        self.tree.remove(shape);
        self.boxes[shape as usize] = None;
        self.moved[shape as usize] = true;
        self.changed = true;
    }

    /// Whether the boxes of two shapes overlap.
    pub(crate) fn near(&self, pair: [u32; 2]) -> bool {
        let [a, b] = pair.map(|shape| self.boxes[shape as usize]);
        a.zip(b).is_some_and(|(a, b)| (0..L).all(|i| a.min[i] <= b.max[i] && b.min[i] <= a.max[i]))
    }

    /// Drops the pairs whose boxes have come to overlap no more since the last call.
    pub(crate) fn drop_parted(&mut self, pairs: &mut Vec<Pair>) {
        let moved = |shape: u32| self.moved[shape as usize];
        pairs.retain(|pair| {
            let [a, b] = pair.colliders;
            !(moved(a) || moved(b)) || self.near(pair.colliders)
        });
        self.moved.fill(false);
    }

    /// Pairs of shapes whose boxes have come to overlap, lower index first, sorted; none if no
    /// box has changed since the last call. Pairs found before may be among them.
    pub(crate) fn new_pairs(&mut self) -> Option<impl Iterator<Item = [u32; 2]>> {
        if !std::mem::take(&mut self.changed) {
            return None;
        }
        self.tree.refit(&mut self.workspace);
        let found = &mut self.found;
        found.clear();
        self.tree.traverse_bvtt_single_tree::<true>(&mut self.workspace, &mut |a, b| {
            found.push(u64::from(a.min(b)) << 32 | u64::from(a.max(b)));
        });
        // Only now: it marks parts of the tree as changed, which the traversal would skip.
        self.tree.optimize_incremental(&mut self.workspace);
        let found = &mut self.found;
        found.sort_unstable();
        found.dedup();
        Some(found.iter().map(|&pair| [(pair >> 32) as u32, pair as u32]))
    }
}

fn aabb<const L: usize>(bounds: &Bounds<L>) -> Aabb {
    let lift = |v: Vector<f32, L>, z: f32| {
        parry3d::math::Vector::from(std::array::from_fn(|i| if i < L { v[i] } else { z }))
    };
    Aabb::new(lift(bounds.min, -0.5), lift(bounds.max, 0.5))
}
