//! Which manifolds share no body, and so can be visited side by side.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};

use crate::batch::{BatchRange, ConstraintKey, Partition, Sizes};
use crate::lanes::{WIDTH, lanes_of};
use crate::thread_pool::{ThreadPool, Worker};

/// What a manifold was when manifolds were last taken in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reuse {
    /// It was not there, or its number is not known.
    New,
    /// It had this number, and joined the same bodies.
    Changed(u32),
    /// It had this number, and is as it was then but for gaps and impulses, which are as they were
    /// [traced](crate::wide::Batch::trace). It need not be taken in again.
    Kept(u32),
}

impl Reuse {
    /// The same of one that is not kept.
    pub fn changed(self) -> Self {
        match self {
            Self::Kept(number) => Self::Changed(number),
            other => other,
        }
    }
}

/// Colors at most; what fits none of them comes after, one by one.
const COLORS: usize = 64;

/// Manifolds of one color are sorted by their number of points, up to this many.
pub(crate) const BINS: usize = 8;

/// Kinds of manifolds in a batch: their color and bin, or that they have no color.
const KINDS: usize = COLORS * BINS + 1;

/// The kind of what has no color.
const ALONE: usize = KINDS - 1;

/// Manifolds that are worth as much as the least that is shared.
const GRAIN: usize = 256;

/// No place; no manifold.
const NONE: u32 = u32::MAX;

/// What has been taken: how many manifolds that are kept, and points of all.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Intake {
    kept: usize,
    points: usize,
}

/// What has become of the places of manifolds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Placement {
    /// All manifolds are those of the time before, where they were.
    Same,
    /// Those that are not new have stayed.
    Stay,
    /// All have others.
    Anew,
}

/// The manifolds of a block. Lanes are bits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LaneMap {
    /// Lanes that have one.
    pub(crate) used: u16,
    /// Those that had another before, or whose manifold has changed.
    pub(crate) stale: u16,
    /// By lane; those that are idle have one of the others.
    pub(crate) manifolds: [u32; WIDTH],
}

impl LaneMap {
    const EMPTY: Self = Self { used: 0, stale: u16::MAX, manifolds: [0; WIDTH] };

    /// How a block with idle lanes ranks, its number in the lower half: the first choice for a new manifold is the
    /// last, so what changes often gathers where little stays as it is.
    fn rank(&self, block: u32) -> Option<u64> {
        let [changes, idle] =
            [u32::from(self.stale != 0 || self.used == 0), self.used.count_zeros()];
        self.is_open().then(|| u64::from(changes << 8 | idle) << 32 | u64::from(block))
    }

    /// Whether there is room for a manifold.
    fn is_open(&self) -> bool {
        self.used != u16::MAX
    }

    /// Puts a manifold into the first idle lane, and returns this.
    fn push(&mut self, manifold: u32) -> usize {
        if self.used == 0 {
            self.manifolds = [manifold; WIDTH];
        }
        let lane = self.used.trailing_ones() as usize;
        self.put(lane, manifold);
        self.stale |= 1 << lane;
        lane
    }

    fn put(&mut self, lane: usize, manifold: u32) {
        self.manifolds[lane] = manifold;
        self.used |= 1 << lane;
    }

    /// The manifolds, and their lanes.
    fn iter(&self) -> impl Iterator<Item = (usize, u32)> {
        lanes_of(self.used).map(|lane| (lane, self.manifolds[lane]))
    }

    /// The same, of which those are stale that have changed since they were here before.
    pub(crate) fn changed(&self, reuse: impl Fn(u32) -> Reuse) -> Self {
        let is_stale = |manifold| reuse(manifold) != Reuse::Kept(manifold);
        let bit = |(lane, manifold)| u16::from(is_stale(manifold)) << lane;
        Self { stale: self.iter().map(bit).fold(0, |all, own| all | own), ..*self }
    }

    /// Leaves those that are still there in their lanes, by their new numbers.
    fn follow(&mut self, now: &Renumbering) {
        let was = *self;
        // Whatever does not come back has left.
        (self.stale, self.used) = (was.used, 0);
        for (lane, old) in was.iter() {
            if let Some((manifold, changed)) = now.of(old) {
                self.put(lane, manifold);
                self.stale &= !(u16::from(!changed) << lane);
            }
        }
        self.fill();
    }

    /// Fills idle lanes.
    fn fill(&mut self) {
        let first = self.iter().next().map_or(0, |(_, manifold)| manifold);
        lanes_of(!self.used).for_each(|lane| self.manifolds[lane] = first);
    }
}

/// What has become of the manifolds of the call before: the new number of each, twice, and one more if it has
/// changed. Of no use after the call, so a clone has none.
#[derive(Debug, Default)]
struct Renumbering(Vec<AtomicU32>);

impl Clone for Renumbering {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Renumbering {
    /// Of so many nothing is known.
    fn forget(&mut self, count: usize) {
        self.0.clear();
        self.0.resize_with(count, || AtomicU32::new(NONE));
    }

    fn note(&self, old: usize, now: u32, changed: bool) {
        self.0[old].store(2 * now + u32::from(changed), Ordering::Relaxed);
    }

    fn of(&self, old: u32) -> Option<(u32, bool)> {
        let now = self.0[old as usize].load(Ordering::Relaxed);
        (now != NONE).then_some((now / 2, now % 2 == 1))
    }
}

/// Blocks of which no two move the same body.
#[derive(Clone, Debug)]
pub(crate) struct Color {
    pub(crate) blocks: Range<u32>,
    /// Where those end that were laid out for manifolds of 0 points, of one, and so on.
    ends: [u32; BINS],
}

impl Color {
    /// Those of a bin that a worker of a pool takes: its part of all, or all if they are too few to share.
    #[inline(always)]
    pub(crate) fn share(&self, worker: &Worker<'_>, bin: usize) -> Range<usize> {
        let start = if bin == 0 { self.blocks.start } else { self.ends[bin - 1] };
        let all = start as usize..self.ends[bin] as usize;
        if all.is_empty() {
            all
        } else if worker.shares(self.blocks.len()) {
            worker.part_after(all.start - self.blocks.start as usize, all)
        } else if worker.is_first() {
            all
        } else {
            0..0
        }
    }
}

/// The color of a manifold of this kind, among those that have blocks in these batches.
#[inline(always)]
fn color_of(kind: u32, of: &ConstraintKey, batches: &[Range<usize>]) -> Option<usize> {
    let colors = &batches[usize::from(of.batch)];
    // Colors have blocks in their order, but for those that none was of.
    let color = colors.start + kind as usize / BINS;
    (kind as usize != ALONE && colors.contains(&color)).then_some(color)
}

/// Places for manifolds in blocks of [`WIDTH`] lanes: no two of a block move the same body.
#[derive(Clone, Debug, Default)]
pub struct Coloring {
    /// The place of each manifold: its block times [`WIDTH`] plus its lane. Where all are placed anew, a block
    /// is filled from lane 0 on, and blocks come batch after batch, color after color, in a color by
    /// number of points, then in the order of the manifolds.
    pub places: Vec<u32>,
    /// Batch after batch; what fits in none has one of its own.
    pub(crate) colors: Vec<Color>,
    /// Which of them are those of each batch.
    pub(crate) batches: Vec<Range<usize>>,
    pub(crate) division: Partition,
    /// Points of the longest manifold of each block.
    pub points: Vec<u32>,
    /// For how many points each block has room.
    pub(crate) rooms: Vec<u32>,
    /// The manifolds of each block.
    pub(crate) members: Vec<LaneMap>,
    /// How many points there are before those of each manifold, and of all.
    firsts: Vec<u32>,
    keys: Vec<ConstraintKey>,
    /// Of each body, whether it moves and whether it joins.
    bodies: Vec<[bool; 2]>,
    /// The kind of each manifold.
    kinds: Vec<u32>,
    /// The keys of the call before, their kinds and places, and what has become of them.
    before: Vec<ConstraintKey>,
    kinds_before: Vec<u32>,
    places_before: Vec<u32>,
    now: Renumbering,
    used: Vec<u64>,
    /// By batch and kind: how many, then the next place.
    next: Vec<u32>,
    /// What a sweep did for nothing when all were placed anew.
    idle: u32,
    /// Blocks of each color with idle lanes, as they rank ([`LaneMap::rank`]).
    open: Vec<Vec<u64>>,
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
        let manifolds: Vec<_> = manifolds.collect();
        self.take_bodies((0..bodies as u32).map(|body| [moves(body); 2]));
        let (key, reuse) = (|manifold| manifolds[manifold as usize], |_| Reuse::New);
        let Intake { points, .. } = self.take(manifolds.len(), key, reuse, &ThreadPool::default());
        self.division.update(&self.bodies, &mut self.keys, points, Sizes::NONE);
        self.color();
        self.lay_out(false);
    }

    /// Takes bodies: of each, whether it moves, and whether it joins; those that do not can be in several batches.
    /// Returns whether they are those of the call before.
    pub(crate) fn take_bodies(&mut self, bodies: impl Iterator<Item = [bool; 2]> + Clone) -> bool {
        let same = self.bodies.iter().copied().eq(bodies.clone());
        if !same {
            self.bodies.clear();
            self.bodies.extend(bodies);
        }
        same
    }

    /// Takes manifolds, given by their bodies and number of points.
    pub(crate) fn take(
        &mut self,
        count: usize,
        key: impl Fn(u32) -> ([u32; 2], u32) + Sync,
        reuse: impl Fn(u32) -> Reuse + Sync,
        pool: &ThreadPool,
    ) -> Intake {
        std::mem::swap(&mut self.keys, &mut self.before);
        let Self { keys, bodies: of_bodies, .. } = self;
        keys.resize(count, ConstraintKey::default());
        let (useful, share) = pool.share(count, GRAIN);
        let [all_kept, all_points] = [const { AtomicUsize::new(0) }; 2];
        pool.for_each(useful, keys.chunks_mut(share).enumerate(), |(part, keys)| {
            let [mut kept, mut all] = [0; 2];
            for (index, own) in (share * part..).zip(keys) {
                let (bodies, points) = key(index as u32);
                let moving = bodies.map(|body| of_bodies[body as usize][0]);
                *own = ConstraintKey { bodies, moving, batch: 0, points };
                kept += usize::from(matches!(reuse(index as u32), Reuse::Kept(_)));
                all += points as usize;
            }
            all_kept.fetch_add(kept, Ordering::Relaxed);
            all_points.fetch_add(all, Ordering::Relaxed);
        });
        Intake { kept: all_kept.into_inner(), points: all_points.into_inner() }
    }

    /// Places what has been `taken` as [`assign`](Self::assign) does, but in batches, of what takes up these
    /// `sizes`. Manifolds that are not new stay in their places if they have the same color and many of them are
    /// kept, and new ones get what places there are. Colors are what they would be without.
    pub(crate) fn update(
        &mut self,
        sizes: Sizes,
        reuse: impl Fn(u32) -> Reuse + Sync,
        taken: Intake,
        pool: &ThreadPool,
    ) -> Placement {
        let divided = self.division.update(&self.bodies, &mut self.keys, taken.points, sizes);
        if !divided && self.keys == self.before {
            return Placement::Same;
        }
        self.color();
        // If one in eight has changed, there is one in almost every block.
        let many = 8 * taken.kept > 7 * self.keys.len();
        if many && !divided && self.stay(reuse, pool) {
            return Placement::Stay;
        }
        self.lay_out(many);
        Placement::Anew
    }

    /// Finds the kind of each manifold, and how many points come before it.
    fn color(&mut self) {
        let mask = |moves: bool| u64::from(moves).wrapping_neg();
        self.used.clear();
        self.used.resize(self.bodies.len(), 0);
        std::mem::swap(&mut self.kinds, &mut self.kinds_before);
        self.kinds.clear();
        self.firsts.clear();
        let mut before = 0;
        for &ConstraintKey { bodies, moving, points, .. } in &self.keys {
            self.firsts.push(before);
            before += points;
            let used = |side: usize| self.used[bodies[side] as usize] & mask(moving[side]);
            let color = (used(0) | used(1)).trailing_ones() as usize;
            if color == COLORS {
                self.kinds.push(ALONE as u32);
                continue;
            }
            for side in 0..2 {
                self.used[bodies[side] as usize] |= mask(moving[side]) & 1 << color;
            }
            self.kinds.push((color * BINS + (points as usize).min(BINS - 1)) as u32);
        }
        self.firsts.push(before);
    }

    /// Gives all manifolds places by their kinds, a new color in a new block. With a block to `spare` for
    /// each color that has any.
    fn lay_out(&mut self, spare: bool) {
        self.next.clear();
        self.next.resize(self.division.len() * KINDS, 0);
        let of = |kind: u32, key: &ConstraintKey| usize::from(key.batch) * KINDS + kind as usize;
        for (&kind, key) in self.kinds.iter().zip(&self.keys) {
            self.next[of(kind, key)] += 1;
        }
        let width = WIDTH as u32;
        let mut end = 0;
        self.colors.clear();
        self.batches.clear();
        for own in self.next.chunks_mut(KINDS) {
            let first = self.colors.len();
            let (colored, alone) = own.split_at_mut(ALONE);
            for bins in colored.chunks_mut(BINS) {
                let (first, mut ends) = (end / width, [0; BINS]);
                for (next, last) in bins.iter_mut().zip(&mut ends) {
                    end += std::mem::replace(next, end);
                    *last = end.div_ceil(width);
                }
                end = end.next_multiple_of(width);
                if end / width > first {
                    end += if spare { width } else { 0 };
                    ends[BINS - 1] = end / width;
                    self.colors.push(Color { blocks: first..end / width, ends });
                }
            }
            for next in alone {
                let blocks = end / width..end / width + *next;
                *next = end;
                end = blocks.end * width;
                let alone = |block| Color { blocks: block..block + 1, ends: [block + 1; BINS] };
                self.colors.extend(blocks.map(alone));
            }
            self.batches.push(first..self.colors.len());
        }
        let blocks = (end / width) as usize;
        self.points.clear();
        self.points.resize(blocks, 0);
        self.members.clear();
        self.members.resize(blocks, LaneMap::EMPTY);
        self.places.clear();
        for (index, (&kind, key)) in self.kinds.iter().zip(&self.keys).enumerate() {
            let next = &mut self.next[of(kind, key)];
            let place = *next;
            *next += if kind as usize == ALONE { width } else { 1 };
            self.places.push(place);
            let (block, lane) = (place as usize / WIDTH, place as usize % WIDTH);
            self.points[block] = key.points.max(self.points[block]);
            self.members[block].put(lane, index as u32);
        }
        self.members.iter_mut().for_each(LaneMap::fill);
        self.rooms.clone_from(&self.points);
        if spare {
            let longest = self.points.iter().copied().max().unwrap_or(0);
            self.rooms.fill(longest);
        }
        [self.idle, _] = self.sweep();
        self.make_room();
    }

    /// Takes the memory that manifolds may need to come and go in these blocks: then it is not taken in a scene that
    /// has come to rest.
    fn make_room(&mut self) {
        let most = WIDTH * self.members.len();
        self.now.0.reserve(most.saturating_sub(self.now.0.len()));
        for numbers in
            [&mut self.places, &mut self.places_before, &mut self.kinds, &mut self.kinds_before]
        {
            numbers.reserve(most.saturating_sub(numbers.len()));
        }
        if self.open.len() < self.colors.len() {
            self.open.resize_with(self.colors.len(), Vec::new);
        }
        for (open, Color { blocks, .. }) in self.open.iter_mut().zip(&self.colors) {
            open.clear();
            open.reserve(blocks.len());
        }
    }

    /// Leaves manifolds that are not new in their places, and finds some for the others. Returns whether there
    /// are any.
    fn stay(&mut self, reuse: impl Fn(u32) -> Reuse + Sync, pool: &ThreadPool) -> bool {
        std::mem::swap(&mut self.places, &mut self.places_before);
        self.places.resize(self.keys.len(), NONE);
        self.now.forget(self.before.len());
        let Self { keys, kinds, before, kinds_before, places_before, now, .. } = self;
        let (useful, share) = pool.share(keys.len(), GRAIN);
        let places = self.places.chunks_mut(share).enumerate();
        pool.for_each(useful, places, |(part, places)| {
            for (index, place) in (share * part..).zip(places) {
                *place = NONE;
                let (old, changed) = match reuse(index as u32) {
                    Reuse::New => continue,
                    Reuse::Changed(old) => (old as usize, true),
                    Reuse::Kept(old) => (old as usize, false),
                };
                // What is of the same kind has the same color.
                let kind = kinds[index];
                let same = keys[index] == before[old] && kind == kinds_before[old];
                if same && kind as usize != ALONE {
                    *place = places_before[old];
                    now.note(old, index as u32, changed);
                }
            }
        });
        let (useful, share) = pool.share(self.members.len(), GRAIN / WIDTH);
        let blocks = self.members.chunks_mut(share).zip(self.points.chunks_mut(share));
        pool.for_each(useful, blocks, |(members, longest)| {
            for (members, longest) in members.iter_mut().zip(longest) {
                members.follow(now);
                if members.stale & !members.used != 0 {
                    let points = |(_, manifold): (_, u32)| keys[manifold as usize].points;
                    *longest = members.iter().map(points).max().unwrap_or(0);
                }
            }
        });
        self.settle()
    }

    /// What a sweep does for nothing and for something, about: a manifold is as much as one of its points, and
    /// blocks do for all lanes what the longest one needs.
    fn sweep(&self) -> [u32; 2] {
        let used = (self.keys.len() + self.all_points()) as u32;
        let all: u32 = self.points.iter().filter(|&&points| points > 0).map(|of| 1 + of).sum();
        [WIDTH as u32 * all - used, used]
    }

    /// Finds places for the manifolds that have none; returns whether there are any, and whether a sweep does
    /// not much more for nothing than where all were placed anew.
    fn settle(&mut self) -> bool {
        for (open, Color { blocks, .. }) in self.open.iter_mut().zip(&self.colors) {
            open.clear();
            open.extend(
                blocks.clone().filter_map(|block| self.members[block as usize].rank(block)),
            );
            open.sort_unstable();
        }
        for index in 0..self.keys.len() {
            if self.places[index] != NONE {
                continue;
            }
            let key = &self.keys[index];
            let color = color_of(self.kinds[index], key, &self.batches);
            let (Some(color), points) = (color, key.points) else { return false };
            let open = &mut self.open[color];
            let find = |fits: &dyn Fn(usize) -> bool| {
                open.iter().rposition(|&rank| fits(rank as u32 as usize))
            };
            let at = find(&|block| self.points[block] == points)
                .or_else(|| find(&|block| self.points[block] >= points))
                .or_else(|| {
                    find(&|block| self.members[block].used == 0 && self.rooms[block] >= points)
                });
            let Some(at) = at else { return false };
            let block = open[at] as u32;
            self.points[block as usize] = points.max(self.points[block as usize]);
            let members = &mut self.members[block as usize];
            self.places[index] = block * WIDTH as u32 + members.push(index as u32) as u32;
            if !members.is_open() {
                open.remove(at);
            }
        }
        let [idle, used] = self.sweep();
        idle <= self.idle + used / 32
    }

    /// The batches as they were laid out, one after the other.
    pub(crate) fn extents(&self, out: &mut Vec<BatchRange>) {
        out.clear();
        let (mut block, mut point) = (0, 0);
        for (batch, colors) in self.batches.iter().enumerate() {
            let last = self.colors[colors.clone()].last();
            let blocks = block..last.map_or(block, |color| color.blocks.end as usize);
            let room: u32 = self.rooms[blocks.clone()].iter().sum();
            let points = point..point + room as usize;
            (block, point) = (blocks.end, points.end);
            let bodies = self.division.bodies(batch);
            out.push(BatchRange { bodies, colors: colors.clone(), blocks, points });
        }
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
    pub(crate) fn key(&self, manifold: u32) -> &ConstraintKey {
        &self.keys[manifold as usize]
    }
}
