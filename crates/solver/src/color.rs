//! Which manifolds share no body, and so can be visited side by side.

use std::ops::Range;

use crate::lanes::WIDTH;

/// Colors at most; what fits none of them comes after, one by one.
const COLORS: usize = 64;

/// Manifolds of one color are sorted by their number of points, up to this many.
const BINS: usize = 8;

/// A manifold as colors see it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Outline {
    pub(crate) bodies: [u32; 2],
    /// Whether they can be moved: the others may have many manifolds of a color.
    pub(crate) moving: [bool; 2],
    points: u32,
}

/// The manifolds of a block.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Members {
    /// How many.
    pub(crate) lanes: usize,
    /// By lane; those that are idle have the first one.
    pub(crate) manifolds: [u32; WIDTH],
}

/// Places for manifolds in blocks of [`WIDTH`] lanes: no two of a block move the same body.
#[derive(Clone, Debug, Default)]
pub struct Coloring {
    /// The place of each manifold: its block times [`WIDTH`] plus its lane. A block is filled from
    /// lane 0 on; blocks come color after color, in a color by number of points, then in the order
    /// of the manifolds.
    pub places: Vec<u32>,
    /// The blocks of each color; what fits in none has one of its own.
    pub colors: Vec<Range<u32>>,
    /// Points of the longest manifold of each block.
    pub points: Vec<u32>,
    /// The manifolds of each block.
    pub(crate) members: Vec<Members>,
    /// How many points there are before those of each manifold, and of all.
    firsts: Vec<u32>,
    outlines: Vec<Outline>,
    /// Those of the call before.
    before: Vec<Outline>,
    used: Vec<u64>,
}

impl Coloring {
    /// Colors manifolds, given by their bodies and number of points, greedily in their order: each
    /// takes the first color that neither of its bodies has. `moves` tells whether a body can be
    /// moved; the others may have many manifolds of a color. Depends on nothing but its arguments.
    /// Returns whether anything is other than after the last call.
    pub fn assign(
        &mut self,
        bodies: usize,
        manifolds: impl Iterator<Item = ([u32; 2], u32)>,
        moves: impl Fn(u32) -> bool,
    ) -> bool {
        std::mem::swap(&mut self.outlines, &mut self.before);
        self.outlines.clear();
        self.outlines.extend(manifolds.map(|(bodies, points)| Outline {
            bodies,
            moving: bodies.map(&moves),
            points,
        }));
        // What rests keeps its places.
        if self.outlines == self.before {
            return false;
        }
        self.used.clear();
        self.used.resize(bodies, 0);
        self.places.clear();
        let mut counts = [0u32; COLORS * BINS];
        let mut alone = 0;
        // First the kind of each manifold: its color and bin.
        for &Outline { bodies, moving, points } in &self.outlines {
            let used =
                |side: usize| if moving[side] { self.used[bodies[side] as usize] } else { 0 };
            let (a, b) = (used(0), used(1));
            let color = (a | b).trailing_ones() as usize;
            if color == COLORS {
                self.places.push((COLORS * BINS + alone) as u32);
                alone += 1;
                continue;
            }
            for (body, _) in bodies.into_iter().zip(moving).filter(|(_, moving)| *moving) {
                self.used[body as usize] |= 1 << color;
            }
            let kind = color * BINS + (points as usize).min(BINS - 1);
            counts[kind] += 1;
            self.places.push(kind as u32);
        }
        // Then where each kind begins, a new color in a new block.
        let mut next = [0u32; COLORS * BINS];
        let mut end = 0;
        self.colors.clear();
        for (next, counts) in next.chunks_mut(BINS).zip(counts.chunks(BINS)) {
            let first = end / WIDTH as u32;
            for (next, count) in next.iter_mut().zip(counts) {
                *next = end;
                end += count;
            }
            end = end.next_multiple_of(WIDTH as u32);
            if end / WIDTH as u32 > first {
                self.colors.push(first..end / WIDTH as u32);
            }
        }
        let after = end / WIDTH as u32;
        self.colors.extend((0..alone as u32).map(|i| after + i..after + i + 1));
        let blocks = end as usize / WIDTH + alone;
        self.points.clear();
        self.points.resize(blocks, 0);
        self.members.clear();
        self.members.resize(blocks, Members::default());
        self.firsts.clear();
        let mut before = 0;
        for (index, (place, &Outline { points, .. })) in
            self.places.iter_mut().zip(&self.outlines).enumerate()
        {
            self.firsts.push(before);
            before += points;
            let kind = *place as usize;
            *place = match next.get_mut(kind) {
                Some(next) => {
                    *next += 1;
                    *next - 1
                }
                None => end + ((kind - COLORS * BINS) * WIDTH) as u32,
            };
            let (block, lane) = (*place as usize / WIDTH, *place as usize % WIDTH);
            self.points[block] = points.max(self.points[block]);
            let members = &mut self.members[block];
            members.lanes += 1;
            members.manifolds[lane] = index as u32;
        }
        for Members { lanes, manifolds } in &mut self.members {
            let first = manifolds[0];
            manifolds[*lanes..].fill(first);
        }
        self.firsts.push(before);
        true
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
