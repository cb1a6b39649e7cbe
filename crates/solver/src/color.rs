//! Which manifolds share no body, and so can be visited side by side.

use std::cmp::Reverse;
use std::ops::Range;

use crate::batch::{Batch, Division, Outline, Sizes};
use crate::lanes::WIDTH;

/// Colors at most; what fits none of them comes after, one by one.
const COLORS: usize = 64;

/// Manifolds of one color are sorted by their number of points, up to this many.
const BINS: usize = 8;

/// Kinds of manifolds in a batch: their color and bin, or that they have no color.
const KINDS: usize = COLORS * BINS + 1;

/// The kind of what has no color.
const ALONE: usize = KINDS - 1;

/// No place; no manifold.
const NONE: u32 = u32::MAX;

/// The manifolds of a block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Members {
    /// How many.
    pub(crate) lanes: usize,
    /// By lane; those that are idle have the first one.
    pub(crate) manifolds: [u32; WIDTH],
    /// Whether they are others than before, in other lanes, or one of them has changed.
    pub(crate) changed: bool,
}

impl Members {
    const EMPTY: Self = Self { lanes: 0, manifolds: [0; WIDTH], changed: true };

    /// Whether there is room for a manifold.
    fn is_open(&self) -> bool {
        self.lanes < WIDTH
    }

    /// Puts a manifold into the next lane.
    fn push(&mut self, manifold: u32) {
        self.manifolds[self.lanes] = manifold;
        self.lanes += 1;
        self.changed = true;
    }

    /// Fills idle lanes.
    fn fill(&mut self) {
        let first = if self.lanes == 0 { 0 } else { self.manifolds[0] };
        self.manifolds[self.lanes..].fill(first);
    }
}

/// Places for manifolds in blocks of [`WIDTH`] lanes: no two of a block move the same body.
#[derive(Clone, Debug, Default)]
pub struct Coloring {
    /// The place of each manifold: its block times [`WIDTH`] plus its lane. A block is filled from
    /// lane 0 on. Where all are placed anew, blocks come batch after batch, color after color, in a color by
    /// number of points, then in the order of the manifolds.
    pub places: Vec<u32>,
    /// The blocks of each color of each batch; what fits in none has one of its own.
    pub colors: Vec<Range<u32>>,
    /// The colors of each batch.
    pub(crate) batches: Vec<Range<usize>>,
    pub(crate) division: Division,
    /// Points of the longest manifold of each block.
    pub points: Vec<u32>,
    /// For how many points each block has room.
    pub(crate) rooms: Vec<u32>,
    /// The manifolds of each block.
    pub(crate) members: Vec<Members>,
    /// How many points there are before those of each manifold, and of all.
    firsts: Vec<u32>,
    outlines: Vec<Outline>,
    /// Those of the call before, and their places.
    before: Vec<Outline>,
    places_before: Vec<u32>,
    /// The kind of each manifold.
    kinds: Vec<u32>,
    used: Vec<u64>,
    /// By batch and kind: how many, then the next place.
    next: Vec<u32>,
    /// Blocks of each color with idle lanes.
    open: Vec<Vec<u32>>,
}

impl Coloring {
    /// Colors manifolds, given by their bodies and number of points, greedily in their order: each
    /// takes the first color that neither of its bodies has. `moves` tells whether a body can be
    /// moved; the others may have many manifolds of a color. Depends on nothing but its arguments.
    pub fn assign(
        &mut self,
        bodies: usize,
        manifolds: impl Iterator<Item = ([u32; 2], u32)>,
        moves: impl Fn(u32) -> bool,
    ) {
        self.take(manifolds, &moves);
        self.division.update(bodies, &mut self.outlines, Sizes::NONE, moves);
        self.color(bodies);
        self.lay_out(false);
    }

    /// As [`assign`](Self::assign), but in batches, of what takes up these `sizes`: bodies that do not `join`
    /// can be in several. Manifolds that are `kept`, by the number that they had in the call before, stay in
    /// their places if they have the same color, and new ones get what places there are. Colors are what they
    /// would be without. Returns whether all are placed anew.
    pub(crate) fn update(
        &mut self,
        bodies: usize,
        manifolds: impl Iterator<Item = ([u32; 2], u32)>,
        moves: impl Fn(u32) -> bool,
        (sizes, joins): (Sizes, impl Fn(u32) -> bool),
        kept: impl Fn(u32) -> Option<u32>,
    ) -> bool {
        self.take(manifolds, moves);
        let divided = self.division.update(bodies, &mut self.outlines, sizes, joins);
        if !divided && self.outlines == self.before {
            for members in &mut self.members {
                let own = &members.manifolds[..members.lanes];
                members.changed = own.iter().any(|&manifold| kept(manifold) != Some(manifold));
            }
            return false;
        }
        self.color(bodies);
        // If one in eight has changed, there is one in almost every block.
        let all = self.outlines.len();
        let many = 8 * (0..all as u32).filter(|&own| kept(own).is_some()).count() > 7 * all;
        if many && !divided && self.stay(kept) {
            self.count_points();
            return false;
        }
        self.lay_out(many);
        true
    }

    fn take(
        &mut self,
        manifolds: impl Iterator<Item = ([u32; 2], u32)>,
        moves: impl Fn(u32) -> bool,
    ) {
        std::mem::swap(&mut self.outlines, &mut self.before);
        self.outlines.clear();
        self.outlines.extend(manifolds.map(|(bodies, points)| Outline {
            bodies,
            moving: bodies.map(&moves),
            batch: 0,
            points,
        }));
    }

    /// Finds the kind of each manifold.
    fn color(&mut self, bodies: usize) {
        self.used.clear();
        self.used.resize(bodies, 0);
        self.kinds.clear();
        for &Outline { bodies, moving, points, .. } in &self.outlines {
            let used =
                |side: usize| if moving[side] { self.used[bodies[side] as usize] } else { 0 };
            let (a, b) = (used(0), used(1));
            let color = (a | b).trailing_ones() as usize;
            if color == COLORS {
                self.kinds.push(ALONE as u32);
                continue;
            }
            for (body, _) in bodies.into_iter().zip(moving).filter(|(_, moving)| *moving) {
                self.used[body as usize] |= 1 << color;
            }
            self.kinds.push((color * BINS + (points as usize).min(BINS - 1)) as u32);
        }
    }

    /// Gives all manifolds places by their kinds, a new color in a new block. With a block to `spare` for
    /// each color that has any.
    fn lay_out(&mut self, spare: bool) {
        self.next.clear();
        self.next.resize(self.division.len() * KINDS, 0);
        let of = |kind: u32, outline: &Outline| usize::from(outline.batch) * KINDS + kind as usize;
        for (&kind, outline) in self.kinds.iter().zip(&self.outlines) {
            self.next[of(kind, outline)] += 1;
        }
        let width = WIDTH as u32;
        let mut end = 0;
        self.colors.clear();
        self.batches.clear();
        for own in self.next.chunks_mut(KINDS) {
            let first = self.colors.len();
            let (colored, alone) = own.split_at_mut(ALONE);
            for bins in colored.chunks_mut(BINS) {
                let first = end / width;
                for next in bins {
                    end += std::mem::replace(next, end);
                }
                end = end.next_multiple_of(width);
                if end / width > first {
                    end += if spare { width } else { 0 };
                    self.colors.push(first..end / width);
                }
            }
            for next in alone {
                let blocks = end / width..end / width + *next;
                *next = end;
                end = blocks.end * width;
                self.colors.extend(blocks.map(|block| block..block + 1));
            }
            self.batches.push(first..self.colors.len());
        }
        let blocks = (end / width) as usize;
        self.points.clear();
        self.points.resize(blocks, 0);
        self.members.clear();
        self.members.resize(blocks, Members::EMPTY);
        self.places.clear();
        for (index, (&kind, outline)) in self.kinds.iter().zip(&self.outlines).enumerate() {
            let next = &mut self.next[of(kind, outline)];
            let place = *next;
            *next += if kind as usize == ALONE { width } else { 1 };
            self.places.push(place);
            let (block, lane) = (place as usize / WIDTH, place as usize % WIDTH);
            self.points[block] = outline.points.max(self.points[block]);
            // Kinds of a block are filled side by side.
            self.members[block].manifolds[lane] = index as u32;
            self.members[block].lanes += 1;
        }
        self.members.iter_mut().for_each(Members::fill);
        self.rooms.clone_from(&self.points);
        if spare {
            let longest = self.points.iter().copied().max().unwrap_or(0);
            self.rooms.fill(longest);
        }
        self.count_points();
    }

    fn count_points(&mut self) {
        self.firsts.clear();
        let mut before = 0;
        for outline in &self.outlines {
            self.firsts.push(before);
            before += outline.points;
        }
        self.firsts.push(before);
    }

    /// Leaves kept manifolds in their places, and finds some for the others. Returns whether there are any.
    fn stay(&mut self, kept: impl Fn(u32) -> Option<u32>) -> bool {
        std::mem::swap(&mut self.places, &mut self.places_before);
        self.places.clear();
        self.places.resize(self.outlines.len(), NONE);
        for members in &mut self.members {
            members.manifolds = [NONE; WIDTH];
            members.changed = false;
        }
        for index in 0..self.outlines.len() {
            let Some(color) = self.color_of(index) else { return false };
            let Some(old) = kept(index as u32).map(|old| old as usize) else { continue };
            let (now, before) = (self.places_before[old], self.before[old]);
            let blocks = &self.colors[color];
            if self.outlines[index] == before && blocks.contains(&(now / WIDTH as u32)) {
                self.places[index] = now;
                self.members[now as usize / WIDTH].manifolds[now as usize % WIDTH] = index as u32;
            }
        }
        // Those that stay move up where others have gone.
        for (block, members) in self.members.iter_mut().enumerate() {
            let lanes = std::mem::take(&mut members.lanes);
            for lane in 0..lanes {
                let manifold = members.manifolds[lane];
                if manifold == NONE {
                    members.changed = true;
                    continue;
                }
                members.manifolds[members.lanes] = manifold;
                self.places[manifold as usize] = (block * WIDTH + members.lanes) as u32;
                members.lanes += 1;
            }
            if members.changed {
                let own = members.manifolds[..members.lanes].iter();
                let points = own.map(|&manifold| self.outlines[manifold as usize].points);
                self.points[block] = points.max().unwrap_or(0);
            }
        }
        self.settle()
    }

    /// The color of a manifold, among those that have blocks.
    fn color_of(&self, index: usize) -> Option<usize> {
        let kind = self.kinds[index] as usize;
        let colors = &self.batches[usize::from(self.outlines[index].batch)];
        // Colors have blocks in their order, but for those that none was of.
        let color = colors.start + kind / BINS;
        (kind != ALONE && colors.contains(&color)).then_some(color)
    }

    /// Finds places for the manifolds that have none; returns whether there are any.
    fn settle(&mut self) -> bool {
        if self.open.len() < self.colors.len() {
            self.open.resize_with(self.colors.len(), Vec::new);
        }
        for (open, blocks) in self.open.iter_mut().zip(&self.colors) {
            open.clear();
            let has_room = |block: &u32| self.members[*block as usize].is_open();
            open.extend(blocks.clone().filter(has_room));
            // The last is taken first: what changes often gathers where little stays as it is.
            open.sort_unstable_by_key(|&block| {
                let Members { lanes, changed, .. } = self.members[block as usize];
                (changed || lanes == 0, Reverse(lanes), block)
            });
        }
        for index in 0..self.outlines.len() {
            if self.places[index] != NONE {
                continue;
            }
            let Some(color) = self.color_of(index) else { return false };
            let points = self.outlines[index].points;
            let open = &mut self.open[color];
            let fits = |of: &[u32]| open.iter().rposition(|block| of[*block as usize] >= points);
            let Some(at) = fits(&self.points).or_else(|| fits(&self.rooms)) else { return false };
            let block = open[at];
            self.points[block as usize] = points.max(self.points[block as usize]);
            let members = &mut self.members[block as usize];
            self.places[index] = block * WIDTH as u32 + members.lanes as u32;
            members.push(index as u32);
            if !members.is_open() {
                open.remove(at);
            }
        }
        self.members.iter_mut().for_each(Members::fill);
        // Not too many idle lanes.
        let blocks = self.members.iter().filter(|members| members.lanes > 0).count();
        blocks * WIDTH <= self.outlines.len() * 5 / 4 + 2 * self.colors.len() * WIDTH
    }

    /// The bodies, colors and blocks of a batch.
    pub(crate) fn batch(&self, batch: usize) -> Batch {
        let colors = self.batches[batch].clone();
        let blocks = match &self.colors[colors.clone()] {
            [] => 0..0,
            [first, .., last] => first.start as usize..last.end as usize,
            [only] => only.start as usize..only.end as usize,
        };
        Batch { bodies: self.division.bodies(batch), colors, blocks }
    }

    /// Where the points of a manifold are among those of all, one manifold's after the other's.
    pub(crate) fn points_of(&self, manifold: u32) -> Range<usize> {
        let manifold = manifold as usize;
        self.firsts[manifold] as usize..self.firsts[manifold + 1] as usize
    }

    /// How many points all manifolds have.
    pub(crate) fn all_points(&self) -> usize {
        self.firsts.last().map_or(0, |&all| all as usize)
    }

    /// A manifold as it was given.
    pub(crate) fn outline(&self, manifold: u32) -> &Outline {
        &self.outlines[manifold as usize]
    }
}
