//! [`Tree`]: a bounding volume hierarchy of moving boxes, which finds the pairs that have started
//! to overlap.
//!
//! A leaf holds eight boxes, a node eight leaves, and so on up. Boxes near each other in space are
//! adjacent in memory, and eight boxes are compared at once.

use drystone_solver::Vector;
use drystone_solver::thread_pool::ThreadPool;
use wide::f32x8;

use crate::geometry::{Bounds, Ray};

/// Number of boxes of a node.
const WIDTH: usize = 8;

/// No position.
const NONE: u32 = u32::MAX;

/// The tree is rebuilt when its leaves have grown by this factor on average. \[1\]
const DEGRADED: f64 = 1.4;

/// The tree is also rebuilt when more than one in this many boxes has been added or removed.
const LOOSE: usize = 4;

/// Boxes more than this many times as large as the median are separated from the rest. \[1\]
const LARGE: f32 = 4.0;

/// A ray may miss a box by this fraction of the distance, which allows for rounding. \[1\]
const LOOSENED: f32 = 1.0 + 1e-5;

/// Grain size for sharing overlaps above the leaves between threads.
const GRAIN: usize = 1;

/// A tree of numbered boxes.
#[derive(Default)]
pub(super) struct Tree<const L: usize> {
    /// Leaves with the boxes, then nodes with the boxes around those of the level below, up to one
    /// node.
    levels: Vec<Level<L>>,
    /// The leaves at the last query for overlaps.
    before: Vec<Node<L>>,
    /// The number of each box in the leaves, and the position of each number.
    numbers: Vec<u32>,
    positions: Vec<u32>,
    /// Number of boxes added or removed since the tree was built.
    loose: usize,
    /// Inverse of the extent of each leaf when the tree was built. \[1/m\]
    built: Vec<f32>,
    /// Sum of the growth factors of all leaves since then. \[1\]
    degradation: f64,
    /// Overlapping nodes that are still to be tested, in a level and in the one below.
    ahead: [Vec<Both>; 2],
    /// Pairs found by each thread, as sortable numbers.
    found: Vec<Vec<u64>>,
}

/// Two nodes of a level, the earlier first, or one node twice.
type Both = [usize; 2];

/// A box while the tree is built.
struct Entry<const L: usize> {
    /// Center. \[m\]
    center: Vector<f32, L>,
    /// Sum of the sides. \[m\]
    extent: f32,
    number: u32,
    changed: bool,
}

#[derive(Default)]
struct Level<const L: usize> {
    nodes: Vec<Node<L>>,
    /// Boxes of each node that have changed since the last query, as bits.
    changed: Vec<u8>,
}

/// Eight boxes side by side.
#[derive(Clone, Copy)]
struct Node<const L: usize> {
    min: [f32x8; L],
    max: [f32x8; L],
}

/// Returns the sum of the sides. \[m\]
fn extent<const L: usize>(of: &Bounds<L>) -> f32 {
    (0..L).map(|i| (of.max[i] - of.min[i]).max(0.0)).sum()
}

impl<const L: usize> Node<L> {
    const EMPTY: Self = Self {
        min: [f32x8::new([f32::INFINITY; WIDTH]); L],
        max: [f32x8::new([f32::NEG_INFINITY; WIDTH]); L],
    };

    fn get(&self, lane: usize) -> Bounds<L> {
        let at = |of: &[f32x8; L]| Vector(std::array::from_fn(|i| of[i].as_array()[lane]));
        Bounds { min: at(&self.min), max: at(&self.max) }
    }

    fn set(&mut self, lane: usize, to: &Bounds<L>) {
        for i in 0..L {
            self.min[i].as_mut_array()[lane] = to.min[i];
            self.max[i].as_mut_array()[lane] = to.max[i];
        }
    }

    /// Returns the box around all.
    fn bounds(&self) -> Bounds<L> {
        let fold = |of: [f32x8; L], pick: fn(f32, f32) -> f32| {
            Vector(of.map(|of| {
                let [a, b, c, d, e, f, g, h] = of.to_array();
                pick(pick(pick(a, b), pick(c, d)), pick(pick(e, f), pick(g, h)))
            }))
        };
        let (least, most) = (|a, b| if a < b { a } else { b }, |a, b| if a > b { a } else { b });
        Bounds { min: fold(self.min, least), max: fold(self.max, most) }
    }

    /// Returns which boxes overlap `other`, as bits.
    #[inline]
    fn overlapping(&self, other: &Bounds<L>) -> u8 {
        let along = |i: usize| {
            self.min[i].simd_le(f32x8::splat(other.max[i]))
                & self.max[i].simd_ge(f32x8::splat(other.min[i]))
        };
        (1..L).fold(along(0), |all, i| all & along(i)).to_bitmask() as u8
    }

    /// Returns the distance at which a ray enters each box, or infinity if it does not. \[m\]
    fn entries(&self, Cast { ray, inverse }: &Cast<'_, L>) -> [f32; WIDTH] {
        let (mut enter, mut leave) = (f32x8::splat(0.0), f32x8::splat(ray.length));
        for i in 0..L {
            let along =
                |side: f32x8| (side - f32x8::splat(ray.origin[i])) * f32x8::splat(inverse[i]);
            let (near, far) = if inverse[i] < 0.0 {
                (self.max[i], self.min[i])
            } else {
                (self.min[i], self.max[i])
            };
            (enter, leave) = (enter.max(along(near)), leave.min(along(far)));
        }
        let crossed = enter.simd_le(leave * f32x8::splat(LOOSENED));
        crossed.select(enter, f32x8::splat(f32::INFINITY)).to_array()
    }
}

/// A ray in the form in which boxes are tested.
struct Cast<'a, const L: usize> {
    /// It may be shortened while it is cast.
    ray: &'a mut Ray<L>,
    /// Inverse of the components of the direction, clamped to finite numbers.
    inverse: Vector<f32, L>,
}

impl<'a, const L: usize> Cast<'a, L> {
    fn new(ray: &'a mut Ray<L>) -> Self {
        let inverse = Vector(ray.direction.0.map(|x| (1.0 / x).clamp(f32::MIN, f32::MAX)));
        Self { ray, inverse }
    }
}

/// Returns the positions of the bits that are set.
fn lanes(mut bits: u8) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = (bits != 0).then(|| bits.trailing_zeros() as usize);
        bits &= bits.wrapping_sub(1);
        lane
    })
}

impl<const L: usize> Tree<L> {
    /// Sets the box of a number; `None` removes it.
    pub(super) fn set(&mut self, number: u32, to: Option<&Bounds<L>>) {
        if self.positions.len() <= number as usize {
            self.positions.resize(number as usize + 1, NONE);
        }
        let position = self.positions[number as usize];
        match to {
            Some(to) if position == NONE => {
                self.push(number, [&Bounds::EMPTY, to], true);
                self.loose += 1;
            }
            _ if position == NONE => {}
            to => {
                let (leaf, lane) = (position as usize / WIDTH, position as usize % WIDTH);
                self.levels[0].nodes[leaf].set(lane, to.unwrap_or(&Bounds::EMPTY));
                self.levels[0].changed[leaf] |= 1 << lane;
                if to.is_none() {
                    self.loose += 1;
                    self.positions[number as usize] = NONE;
                    self.numbers[position as usize] = NONE;
                }
            }
        }
    }

    /// Appends a box, with its state at the last query and now.
    fn push(&mut self, number: u32, [before, now]: [&Bounds<L>; 2], changed: bool) {
        let mut position = self.numbers.len();
        self.positions[number as usize] = position as u32;
        self.numbers.push(number);
        // It gets a position in each level, up to one with a single node.
        for level in 0.. {
            if level == self.levels.len() {
                self.levels.push(Level::default());
                if level > 0 {
                    self.fill(level);
                }
            }
            let Level { nodes, changed: marks } = &mut self.levels[level];
            let (node, lane) = (position / WIDTH, position % WIDTH);
            if node == nodes.len() {
                nodes.push(Node::EMPTY);
                marks.push(0);
            }
            if level == 0 {
                self.before.resize(nodes.len(), Node::EMPTY);
                self.before[node].set(lane, before);
                nodes[node].set(lane, now);
                marks[node] |= u8::from(changed) << lane;
            }
            if nodes.len() == 1 {
                break;
            }
            position = node;
        }
    }

    /// Recomputes the boxes of a level from the level below, and which have changed.
    fn fill(&mut self, level: usize) {
        let (below, above) = self.levels.split_at_mut(level);
        let Level { nodes, changed } = &mut above[0];
        let below = &below[level - 1];
        nodes.clear();
        nodes.resize(below.nodes.len().div_ceil(WIDTH), Node::EMPTY);
        changed.clear();
        changed.resize(nodes.len(), 0);
        for (index, (node, bits)) in below.nodes.iter().zip(&below.changed).enumerate() {
            let (parent, lane) = (index / WIDTH, index % WIDTH);
            nodes[parent].set(lane, &node.bounds());
            changed[parent] |= u8::from(*bits != 0) << lane;
        }
    }

    /// Returns a tree over these boxes.
    pub(super) fn of(boxes: impl IntoIterator<Item = (u32, Bounds<L>)>) -> Self {
        let mut out = Self::default();
        boxes.into_iter().for_each(|(number, bounds)| out.set(number, Some(&bounds)));
        out.build();
        out
    }

    /// True if it has a box of this number.
    pub(super) fn has(&self, number: u32) -> bool {
        self.positions.get(number as usize).is_some_and(|position| *position != NONE)
    }

    /// Calls `found` with the number of each box that a ray crosses, the nearest of a node first.
    /// `found` may shorten the ray. Boxes are those of the last [refit](Self::refit).
    pub(super) fn cast(&self, ray: &mut Ray<L>, found: &mut impl FnMut(u32, &mut Ray<L>)) {
        if let Some(top) = self.levels.len().checked_sub(1) {
            self.cast_node(top, 0, &mut Cast::new(ray), found);
        }
    }

    fn cast_node(
        &self,
        level: usize,
        node: usize,
        cast: &mut Cast<'_, L>,
        found: &mut impl FnMut(u32, &mut Ray<L>),
    ) {
        let mut entries = self.levels[level].nodes[node].entries(cast);
        loop {
            let lane = (1..WIDTH).fold(0, |a, b| if entries[b] < entries[a] { b } else { a });
            let entry = std::mem::replace(&mut entries[lane], f32::INFINITY);
            if entry == f32::INFINITY || entry > cast.ray.length * LOOSENED {
                return;
            }
            let index = WIDTH * node + lane;
            match level {
                0 => found(self.numbers[index], cast.ray),
                _ => self.cast_node(level - 1, index, cast, found),
            }
        }
    }

    /// Calls `found` with the number of each box that overlaps this one. Boxes are those of the
    /// last [refit](Self::refit).
    pub(super) fn visit(&self, bounds: &Bounds<L>, found: &mut impl FnMut(u32)) {
        if let Some(top) = self.levels.len().checked_sub(1) {
            self.visit_node(top, 0, bounds, found);
        }
    }

    fn visit_node(
        &self,
        level: usize,
        node: usize,
        bounds: &Bounds<L>,
        found: &mut impl FnMut(u32),
    ) {
        for lane in lanes(self.levels[level].nodes[node].overlapping(bounds)) {
            let index = WIDTH * node + lane;
            match level {
                0 => found(self.numbers[index]),
                _ => self.visit_node(level - 1, index, bounds, found),
            }
        }
    }

    /// Returns the pairs of numbers whose boxes have started to overlap since the last call. The
    /// lower number is in the upper half; the pairs are sorted.
    pub(super) fn overlaps(&mut self, pool: &ThreadPool) -> &[u64] {
        self.refit();
        if self.degradation > DEGRADED * self.built.len() as f64
            || LOOSE * self.loose > self.numbers.len()
        {
            self.build();
        }
        let level = self.descend();
        let ahead = &self.ahead[0];
        let (useful, share) = pool.share(ahead.len(), GRAIN);
        let mut found = std::mem::take(&mut self.found);
        found.resize_with(ahead.len().div_ceil(share).max(1), Vec::new);
        found.iter_mut().for_each(Vec::clear);
        let parts = ahead.chunks(share).zip(&mut found);
        pool.for_each(useful, parts, |(ahead, found)| {
            ahead.iter().for_each(|&both| self.search(level, both, found));
        });
        self.found = found;
        if let Some(Level { nodes, changed }) = self.levels.first() {
            let leaves = self.before.iter_mut().zip(nodes).zip(changed);
            leaves.filter(|(_, bits)| **bits != 0).for_each(|((before, now), _)| *before = *now);
        }
        self.levels.iter_mut().for_each(|level| level.changed.fill(0));
        let [all, others @ ..] = &mut self.found[..] else { return &[] };
        others.iter().for_each(|other| all.extend_from_slice(other));
        all.sort_unstable();
        all
    }

    /// Descends to the overlapping nodes above the leaves. Returns their level.
    fn descend(&mut self) -> usize {
        let [mut ahead, mut below] = std::mem::take(&mut self.ahead);
        ahead.clear();
        let top = self.levels.len().saturating_sub(1);
        if self.levels.last().is_some_and(|top| top.changed[0] != 0) {
            ahead.push([0, 0]);
        }
        for level in (2..=top).rev() {
            below.clear();
            ahead
                .iter()
                .for_each(|&both| self.overlap_children(level, both, |next| below.push(next)));
            std::mem::swap(&mut ahead, &mut below);
        }
        self.ahead = [ahead, below];
        top.min(1)
    }

    /// Finds the boxes of two nodes that have started to overlap.
    #[inline(never)]
    fn search(&self, level: usize, both: Both, found: &mut Vec<u64>) {
        match level {
            0 => self.compare(both, found),
            _ => self.overlap_children(level, both, |leaves| self.compare(leaves, found)),
        }
    }

    /// Reports the pairs of overlapping nodes below two nodes.
    #[inline(always)]
    fn overlap_children(&self, level: usize, [a, b]: Both, mut report: impl FnMut(Both)) {
        self.cross(level, [a, b], |lane, with| {
            lanes(with).for_each(|other| report([a * WIDTH + lane, b * WIDTH + other]));
        });
    }

    /// Finds the boxes of two leaves that have started to overlap.
    #[inline(always)]
    fn compare(&self, [a, b]: Both, found: &mut Vec<u64>) {
        self.cross(0, [a, b], |lane, mut with| {
            if a == b {
                with &= !(1 << lane);
            }
            if with != 0 {
                with &= !self.before[b].overlapping(&self.before[a].get(lane));
            }
            for other in lanes(with) {
                let [a, b] = [a * WIDTH + lane, b * WIDTH + other].map(|at| self.numbers[at]);
                found.push(u64::from(a.min(b)) << 32 | u64::from(a.max(b)));
            }
        });
    }

    /// Reports the overlaps between the boxes of two nodes: a box of the first node, and boxes of
    /// the second as bits. One of the two boxes must have changed. Each pair is reported once. In a
    /// node with itself, each box overlaps itself.
    #[inline(always)]
    fn cross(&self, level: usize, [a, b]: Both, mut report: impl FnMut(usize, u8)) {
        let Level { nodes, changed } = &self.levels[level];
        let (own, other) = (&nodes[a], &nodes[b]);
        let mut near = if changed[b] == 0 { changed[a] } else { u8::MAX };
        if a != b {
            let around = self.levels[level + 1].nodes[b / WIDTH].get(b % WIDTH);
            near &= own.overlapping(&around);
        }
        for lane in lanes(near) {
            let mut with = if changed[a] >> lane & 1 == 1 { u8::MAX } else { changed[b] };
            if a == b {
                with &= u8::MAX << lane;
            }
            if with != 0 {
                with &= other.overlapping(&own.get(lane));
            }
            if with != 0 {
                report(lane, with);
            }
        }
    }

    /// Updates each level where the level below has changed.
    pub(super) fn refit(&mut self) {
        for level in 1..self.levels.len() {
            let (below, above) = self.levels.split_at_mut(level);
            let (below, above) = (&below[level - 1], &mut above[0]);
            let nodes = below.nodes.iter().zip(&below.changed).enumerate();
            for (index, (node, _)) in nodes.filter(|(_, (_, changed))| **changed != 0) {
                let (parent, lane) = (index / WIDTH, index % WIDTH);
                let bounds = node.bounds();
                if let (1, Some(built)) = (level, self.built.get(index)) {
                    let grown = extent(&bounds) - extent(&above.nodes[parent].get(lane));
                    self.degradation += f64::from(grown * built);
                }
                above.nodes[parent].set(lane, &bounds);
                above.changed[parent] |= 1 << lane;
            }
        }
    }

    /// Rebuilds the tree with all boxes in spatial order.
    fn build(&mut self) {
        let order = self.order();
        let leaves = self.levels.drain(..).next().unwrap_or_default().nodes;
        let before = std::mem::take(&mut self.before);
        self.numbers.clear();
        for Entry { number, changed, .. } in order {
            let position = self.positions[number as usize] as usize;
            let [before, now] =
                [&before, &leaves].map(|of| of[position / WIDTH].get(position % WIDTH));
            self.push(number, [&before, &now], changed);
        }
        for level in 1..self.levels.len() {
            self.fill(level);
        }
        let leaves = self.levels.first().map_or(&[][..], |leaves| &leaves.nodes);
        self.built.clear();
        self.built
            .extend(leaves.iter().map(|leaf| 1.0 / extent(&leaf.bounds()).max(f32::MIN_POSITIVE)));
        self.degradation = self.built.len() as f64;
        self.loose = 0;
    }

    /// Returns the boxes in spatial order, with large ones at the end: among small boxes they would
    /// enlarge a leaf.
    fn order(&self) -> Vec<Entry<L>> {
        let Some(leaves) = self.levels.first() else { return Vec::new() };
        let boxes = leaves.nodes.iter().zip(&leaves.changed).flat_map(|(&leaf, &changed)| {
            (0..WIDTH).map(move |lane| (leaf.get(lane), changed >> lane & 1 == 1))
        });
        let boxes = self.numbers.iter().zip(boxes).filter(|(number, _)| **number != NONE);
        let entries = boxes.map(|(&number, (own, changed))| {
            let center = (own.min + own.max) * 0.5;
            Entry { center, extent: extent(&own), number, changed }
        });
        let mut entries: Vec<Entry<L>> = entries.collect();
        if !entries.is_empty() {
            let half = entries.len() / 2;
            let by_extent = |a: &Entry<L>, b: &Entry<L>| a.extent.total_cmp(&b.extent);
            let most = LARGE * entries.select_nth_unstable_by(half, by_extent).1.extent;
            entries.sort_by_key(|entry| entry.extent > most);
            let small = entries.partition_point(|entry| entry.extent <= most);
            let (small, large) = entries.split_at_mut(small);
            halve(small);
            halve(large);
        }
        entries
    }
}

/// Sorts boxes recursively by halves along the longest side of the box around their centers. All
/// halves but the last fill their nodes.
fn halve<const L: usize>(entries: &mut [Entry<L>]) {
    if entries.len() <= WIDTH {
        return;
    }
    let mut node = WIDTH;
    while node * WIDTH < entries.len() {
        node *= WIDTH;
    }
    let half = entries.len().div_ceil(node).div_ceil(2) * node;
    let around = |all: Bounds<L>, Entry { center, .. }: &Entry<L>| {
        all.joined(&Bounds { min: *center, max: *center })
    };
    let all = entries.iter().fold(Bounds::EMPTY, around);
    let sides = all.max - all.min;
    let axis = (1..L).fold(0, |most, axis| if sides[axis] > sides[most] { axis } else { most });
    entries.select_nth_unstable_by(half, |a, b| a.center[axis].total_cmp(&b.center[axis]));
    let (first, second) = entries.split_at_mut(half);
    halve(first);
    halve(second);
}

#[cfg(test)]
mod tests;
