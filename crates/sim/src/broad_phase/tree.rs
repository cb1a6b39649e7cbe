//! [`Tree`]: boxes that move, and which of them have come to overlap.
//!
//! Boxes lie along a curve that fills space, eight to a leaf, leaves eight to a node, and so on up. What is near on
//! the curve is near in space, and eight boxes are compared at once.

use drystone_solver::Vector;
use drystone_solver::team::Team;
use wide::f32x8;

use crate::geometry::Bounds;

/// Boxes of a node.
const WIDTH: usize = 8;

/// No place.
const NONE: u32 = u32::MAX;

/// The tree is built anew when its leaves have become so much larger, in the mean.
const WORN: f64 = 1.4;

/// Or when more than one in so many boxes has been added or taken out.
const LOOSE: usize = 4;

/// Boxes so many times as large as half of them are apart from the rest.
const LARGE: f32 = 4.0;

/// Leaves that are worth as much as the least that is shared.
const PIECE: usize = 2;

/// Bits of a cell of the curve along each axis.
const BITS: usize = 19;

/// Boxes, each with a number.
#[derive(Default)]
pub(super) struct Tree<const L: usize> {
    /// Leaves with the boxes; then nodes with the boxes around those of the level before, up to one.
    levels: Vec<Level<L>>,
    /// The leaves as they were when overlaps were last asked for.
    before: Vec<Node<L>>,
    /// The number of each box in the leaves, in their order; and where each number is.
    numbers: Vec<u32>,
    places: Vec<u32>,
    /// Boxes that were added or taken out since it was built.
    loose: usize,
    /// One over the extent of each leaf when it was built. \[1/m\]
    built: Vec<f32>,
    /// How many times as large the leaves are now, all together. \[1\]
    wear: f64,
    /// Leaves with boxes that have changed.
    changed: Vec<u32>,
    searches: Vec<Search>,
}

/// What a thread looks for.
#[derive(Default)]
struct Search {
    /// Nodes that are still to be looked at, each after its level.
    ahead: Vec<(usize, usize)>,
    /// Pairs that sort as one number.
    found: Vec<u64>,
}

/// What becomes of a box when the tree is built: they sort by their place on the curve.
type Entry = (u64, u32, bool);

#[derive(Default)]
struct Level<const L: usize> {
    nodes: Vec<Node<L>>,
    /// Which boxes of each have changed since overlaps were last asked for, as bits.
    changed: Vec<u8>,
}

/// Boxes side by side.
#[derive(Clone, Copy)]
struct Node<const L: usize> {
    min: [f32x8; L],
    max: [f32x8; L],
}

/// The sum of the sides. \[m\]
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

    /// The box around all.
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

    /// Which overlap a box, as bits.
    #[inline]
    fn overlapping(&self, other: &Bounds<L>) -> u8 {
        let along = |i: usize| {
            self.min[i].simd_le(f32x8::splat(other.max[i]))
                & self.max[i].simd_ge(f32x8::splat(other.min[i]))
        };
        (1..L).fold(along(0), |all, i| all & along(i)).to_bitmask() as u8
    }
}

/// The places of the bits.
fn lanes(mut bits: u8) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = (bits != 0).then(|| bits.trailing_zeros() as usize);
        bits &= bits.wrapping_sub(1);
        lane
    })
}

impl<const L: usize> Tree<L> {
    /// Changes the box of a number; none takes it out.
    pub(super) fn set(&mut self, number: u32, to: Option<&Bounds<L>>) {
        if self.places.len() <= number as usize {
            self.places.resize(number as usize + 1, NONE);
        }
        let place = self.places[number as usize];
        match to {
            Some(to) if place == NONE => {
                self.push(number, [&Bounds::NOTHING, to], true);
                self.loose += 1;
            }
            _ if place == NONE => {}
            to => {
                let (leaf, lane) = (place as usize / WIDTH, place as usize % WIDTH);
                self.levels[0].nodes[leaf].set(lane, to.unwrap_or(&Bounds::NOTHING));
                self.levels[0].changed[leaf] |= 1 << lane;
                if to.is_none() {
                    self.loose += 1;
                    self.places[number as usize] = NONE;
                    self.numbers[place as usize] = NONE;
                }
            }
        }
    }

    /// Puts a box at the end, as it was before and is now.
    fn push(&mut self, number: u32, [before, now]: [&Bounds<L>; 2], changed: bool) {
        let mut place = self.numbers.len();
        self.places[number as usize] = place as u32;
        self.numbers.push(number);
        // A place in each level, up to one with a single node.
        for level in 0.. {
            if level == self.levels.len() {
                self.levels.push(Level::default());
                if level > 0 {
                    self.fill(level);
                }
            }
            let Level { nodes, changed: marks } = &mut self.levels[level];
            let (node, lane) = (place / WIDTH, place % WIDTH);
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
            place = node;
        }
    }

    /// Finds the boxes of a level from the one before.
    fn fill(&mut self, level: usize) {
        let (below, above) = self.levels.split_at_mut(level);
        let Level { nodes, changed } = &mut above[0];
        let below = &below[level - 1].nodes;
        nodes.clear();
        nodes.resize(below.len().div_ceil(WIDTH), Node::EMPTY);
        changed.clear();
        changed.resize(nodes.len(), 0);
        for (index, node) in below.iter().enumerate() {
            nodes[index / WIDTH].set(index % WIDTH, &node.bounds());
        }
    }

    /// Each two numbers whose boxes have come to overlap since the last call: the lower in the upper half, sorted.
    pub(super) fn overlaps(&mut self, team: &Team) -> &[u64] {
        self.refit();
        if self.wear > WORN * self.built.len() as f64 || LOOSE * self.loose > self.numbers.len() {
            self.build();
        }
        let marks = self.levels.first().map_or(&[][..], |leaves| &leaves.changed);
        let changed = (0..).zip(marks).filter(|(_, bits)| **bits != 0).map(|(leaf, _)| leaf);
        self.changed.clear();
        self.changed.extend(changed);
        let (useful, share) = team.share(self.changed.len(), PIECE);
        let mut searches = std::mem::take(&mut self.searches);
        searches.resize_with(self.changed.len().div_ceil(share), Search::default);
        let parts = self.changed.chunks(share).zip(&mut searches);
        team.for_each(useful, parts, |(leaves, search)| {
            search.found.clear();
            leaves.iter().for_each(|&leaf| self.query(leaf as usize, search));
        });
        self.searches = searches;
        for leaf in self.changed.drain(..).map(|leaf| leaf as usize) {
            self.before[leaf] = self.levels[0].nodes[leaf];
        }
        self.levels.iter_mut().for_each(|level| level.changed.fill(0));
        let all = match &mut self.searches[..] {
            [] => &mut [],
            [first, others @ ..] => {
                others.iter().for_each(|other| first.found.extend_from_slice(&other.found));
                &mut first.found[..]
            }
        };
        all.sort_unstable();
        all
    }

    /// What has come to overlap the boxes of a leaf that have changed. Of two that have, the one in the earlier leaf
    /// finds the other.
    #[inline(never)]
    fn query(&self, leaf: usize, Search { ahead, found }: &mut Search) {
        let leaves = &self.levels[0];
        let (own, changed) = (&leaves.nodes[leaf], leaves.changed[leaf]);
        let all = lanes(changed).fold(Bounds::NOTHING, |all, lane| all.joined(&own.get(lane)));
        ahead.push((self.levels.len() - 1, 0));
        while let Some((level, node)) = ahead.pop() {
            if level == 0 && node < leaf && leaves.changed[node] == u8::MAX {
                continue;
            }
            let near = self.levels[level].nodes[node].overlapping(&all);
            if level > 0 {
                ahead.extend(lanes(near).map(|lane| (level - 1, node * WIDTH + lane)));
                continue;
            }
            let mut open = if node < leaf { near & !leaves.changed[node] } else { near };
            if open == 0 {
                continue;
            }
            let (other, before) = (&leaves.nodes[node], &self.before[node]);
            let bounds = match self.levels.get(1) {
                Some(above) => above.nodes[node / WIDTH].get(node % WIDTH),
                None => all,
            };
            for lane in lanes(changed & own.overlapping(&bounds)) {
                if node == leaf {
                    open = near & !(changed & ((2 << lane) - 1) as u8);
                }
                let mut come = open & other.overlapping(&own.get(lane));
                if come != 0 {
                    come &= !before.overlapping(&self.before[leaf].get(lane));
                }
                for with in lanes(come) {
                    let a = self.numbers[leaf * WIDTH + lane];
                    let b = self.numbers[node * WIDTH + with];
                    found.push(u64::from(a.min(b)) << 32 | u64::from(a.max(b)));
                }
            }
        }
    }

    /// Tells each level what has changed in the one before.
    fn refit(&mut self) {
        for level in 1..self.levels.len() {
            let (below, above) = self.levels.split_at_mut(level);
            let (below, above) = (&below[level - 1], &mut above[0]);
            let nodes = below.nodes.iter().zip(&below.changed).enumerate();
            for (index, (node, _)) in nodes.filter(|(_, (_, changed))| **changed != 0) {
                let (parent, lane) = (index / WIDTH, index % WIDTH);
                let bounds = node.bounds();
                if let (1, Some(built)) = (level, self.built.get(index)) {
                    let grown = extent(&bounds) - extent(&above.nodes[parent].get(lane));
                    self.wear += f64::from(grown * built);
                }
                above.nodes[parent].set(lane, &bounds);
                above.changed[parent] |= 1 << lane;
            }
        }
    }

    /// Puts all boxes in order.
    fn build(&mut self) {
        let order = self.sort();
        let leaves = self.levels.drain(..).next().unwrap_or_default().nodes;
        let before = std::mem::take(&mut self.before);
        self.numbers.clear();
        for (_, number, changed) in order {
            let place = self.places[number as usize] as usize;
            let [before, now] = [&before, &leaves].map(|of| of[place / WIDTH].get(place % WIDTH));
            self.push(number, [&before, &now], changed);
        }
        for level in 1..self.levels.len() {
            self.fill(level);
        }
        let leaves = self.levels.first().map_or(&[][..], |leaves| &leaves.nodes);
        self.built.clear();
        self.built
            .extend(leaves.iter().map(|leaf| 1.0 / extent(&leaf.bounds()).max(f32::MIN_POSITIVE)));
        self.wear = self.built.len() as f64;
        self.loose = 0;
    }

    /// Puts all boxes in order along the curve, and large ones after it: among small ones they would make a leaf
    /// large.
    fn sort(&self) -> Vec<Entry> {
        let Some(leaves) = self.levels.first() else { return Vec::new() };
        let boxes = leaves.nodes.iter().zip(&leaves.changed).flat_map(|(&leaf, &changed)| {
            (0..WIDTH).map(move |lane| (leaf.get(lane), changed >> lane & 1 == 1))
        });
        let boxes = self.numbers.iter().zip(boxes).filter(|(number, _)| **number != NONE);
        let mut sizes: Vec<f32> = boxes.clone().map(|(_, (own, _))| extent(&own)).collect();
        if sizes.is_empty() {
            return Vec::new();
        }
        let half = sizes.len() / 2;
        let large = LARGE * *sizes.select_nth_unstable_by(half, f32::total_cmp).1;
        let center = |of: &Bounds<L>| (of.min + of.max) * 0.5;
        let centers = boxes.clone().map(|(_, (own, _))| center(&own));
        let all = centers.fold(Bounds::NOTHING, |all, at| all.joined(&Bounds { min: at, max: at }));
        let cells: [f32; L] = std::array::from_fn(|i| {
            (1 << BITS) as f32 / (all.max[i] - all.min[i]).max(f32::MIN_POSITIVE)
        });
        let entries = boxes.map(|(&number, (own, changed))| {
            let at = center(&own) - all.min;
            let cell: [u64; L] = std::array::from_fn(|i| (at[i] * cells[i]) as u64);
            let large = u64::from(extent(&own) > large);
            (large << 63 | along_curve(cell), number, changed)
        });
        let mut order: Vec<Entry> = entries.collect();
        order.sort_unstable();
        order
    }
}

/// The place of a cell on the curve: the bits of its numbers in turn (Morton).
fn along_curve<const L: usize>(cell: [u64; L]) -> u64 {
    let mut out = 0;
    for bit in (0..BITS).rev() {
        for number in cell {
            out = out << 1 | number.min((1 << BITS) - 1) >> bit & 1;
        }
    }
    out
}

#[cfg(test)]
mod tests;
