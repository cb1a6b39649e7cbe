//! Graph coloring of manifolds. Manifolds of one color move no body in common, so lanes and threads
//! can visit them in parallel.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};

use super::partition::{BatchRange, ConstraintKey, Partition, Sizes};
use super::{WIDTH, lanes_of};
use crate::thread_pool::{ThreadPool, Worker};

/// State of a manifold relative to the last time that manifolds were packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reuse {
    /// The manifold is new, or its former index is unknown.
    New,
    /// The manifold had this index and joined the same bodies.
    Changed(u32),
    /// The manifold had this index and is unchanged, except for gaps and impulses, which are as
    /// [traced](super::LaneBatch::trace). It need not be read again.
    Kept(u32),
}

impl Reuse {
    /// Returns `Changed` in place of `Kept`.
    pub fn changed(self) -> Self {
        match self {
            Self::Kept(number) => Self::Changed(number),
            other => other,
        }
    }
}

/// Largest number of colors. Manifolds that fit no color come last, each in a block of its own.
const COLORS: usize = 64;

/// Number of bins: the manifolds of a color are sorted by their number of points. The last bin also
/// holds all longer manifolds.
pub(crate) const BINS: usize = 8;

/// Number of kinds of manifolds in a batch: a color and a bin, or no color.
const KINDS: usize = COLORS * BINS + 1;

/// Kind of a manifold without a color.
const ALONE: usize = KINDS - 1;

/// Grain size: the number of manifolds in the smallest unit of parallel work.
const GRAIN: usize = 256;

/// No lane, or no manifold.
const NONE: u32 = u32::MAX;

/// Counts of the manifolds that were read: those that are kept, and the points of all.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Intake {
    kept: usize,
    points: usize,
}

/// Outcome of an update: whether manifolds keep their lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Placement {
    /// All manifolds are those of the last call and keep their lanes.
    Same,
    /// Manifolds whose bodies, points and color are unchanged have kept their lanes.
    Stay,
    /// All manifolds have been assigned to lanes again.
    Anew,
}

/// The manifolds of a block. Sets of lanes are bit masks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LaneMap {
    /// Lanes that hold a manifold.
    pub(crate) used: u16,
    /// Lanes whose manifold is new or changed, or has left.
    pub(crate) stale: u16,
    /// Manifold of each lane. Idle lanes repeat one of the others.
    pub(crate) manifolds: [u32; WIDTH],
}

impl LaneMap {
    const EMPTY: Self = Self { used: 0, stale: u16::MAX, manifolds: [0; WIDTH] };

    /// Returns the rank of a block with idle lanes, with the block index in the lower half. A new
    /// manifold takes the fitting block of the highest rank. Blocks with changes, and empty ones,
    /// rank highest, so that changes collect in few blocks.
    fn rank(&self, block: u32) -> Option<u64> {
        let [changes, idle] =
            [u32::from(self.stale != 0 || self.used == 0), self.used.count_zeros()];
        self.is_open().then(|| u64::from(changes << 8 | idle) << 32 | u64::from(block))
    }

    /// Returns whether a lane is idle.
    fn is_open(&self) -> bool {
        self.used != u16::MAX
    }

    /// Puts a manifold into the first idle lane and returns this lane.
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

    /// Returns the used lanes and their manifolds.
    fn iter(&self) -> impl Iterator<Item = (usize, u32)> {
        lanes_of(self.used).map(|lane| (lane, self.manifolds[lane]))
    }

    /// Returns the map with those lanes stale whose manifold is not kept under its index.
    pub(crate) fn changed(&self, reuse: impl Fn(u32) -> Reuse) -> Self {
        let is_stale = |manifold| reuse(manifold) != Reuse::Kept(manifold);
        let bit = |(lane, manifold)| u16::from(is_stale(manifold)) << lane;
        Self { stale: self.iter().map(bit).fold(0, |all, own| all | own), ..*self }
    }

    /// Renumbers the manifolds that still exist, in their lanes, and removes the others.
    fn follow(&mut self, now: &Renumbering) {
        let was = *self;
        // Lanes whose manifold does not return stay stale.
        (self.stale, self.used) = (was.used, 0);
        for (lane, old) in was.iter() {
            if let Some((manifold, changed)) = now.of(old) {
                self.put(lane, manifold);
                self.stale &= !(u16::from(!changed) << lane);
            }
        }
        self.fill();
    }

    /// Lets idle lanes repeat the first manifold.
    fn fill(&mut self) {
        let first = self.iter().next().map_or(0, |(_, manifold)| manifold);
        lanes_of(!self.used).for_each(|lane| self.manifolds[lane] = first);
    }
}

/// New index of each manifold of the last call: twice the index, plus one if the manifold has
/// changed. It is valid only during a call, so a clone is empty.
#[derive(Debug, Default)]
struct Renumbering(Vec<AtomicU32>);

impl Clone for Renumbering {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Renumbering {
    /// Clears the map and sizes it for `count` manifolds.
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
    /// End of each bin: the blocks laid out for manifolds of 0 points, of 1 point, and so on.
    ends: [u32; BINS],
}

impl Color {
    /// Returns the blocks of a bin that a worker takes: its part of them. If the color has too few
    /// blocks to share, the first worker takes them all.
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

/// Returns the color of a manifold of this kind in its batch, if that color has blocks.
#[inline(always)]
fn color_of(kind: u32, of: &ConstraintKey, batches: &[Range<usize>]) -> Option<usize> {
    let colors = &batches[usize::from(of.batch)];
    // The colors of a batch follow each other without gaps; only the last ones can be missing.
    let color = colors.start + kind as usize / BINS;
    (kind as usize != ALONE && colors.contains(&color)).then_some(color)
}

/// Assignment of manifolds to blocks of [`WIDTH`] lanes. No two manifolds of a block move the same
/// body.
#[derive(Clone, Debug, Default)]
pub struct Coloring {
    /// Lane of each manifold: the index of its block times [`WIDTH`], plus the lane in the block.
    ///
    /// After a full layout, blocks are filled from lane 0 on. They are ordered by batch, then
    /// color, then number of points, then the order of the manifolds.
    pub places: Vec<u32>,
    /// Colors, batch after batch. A manifold that fits no color gets a color of its own.
    pub(crate) colors: Vec<Color>,
    /// Range of `colors` of each batch.
    pub(crate) batches: Vec<Range<usize>>,
    pub(crate) division: Partition,
    /// Number of points of the longest manifold in each block.
    pub points: Vec<u32>,
    /// Number of points for which each block has room.
    pub(crate) rooms: Vec<u32>,
    /// Manifolds of each block.
    pub(crate) members: Vec<LaneMap>,
    /// Number of points before those of each manifold, then the number of all points.
    firsts: Vec<u32>,
    keys: Vec<ConstraintKey>,
    /// For each body, whether it can be moved and whether it couples its manifolds.
    bodies: Vec<[bool; 2]>,
    /// Kind of each manifold.
    kinds: Vec<u32>,
    /// Keys, kinds and lanes of the last call, and the new indices of its manifolds.
    before: Vec<ConstraintKey>,
    kinds_before: Vec<u32>,
    places_before: Vec<u32>,
    now: Renumbering,
    used: Vec<u64>,
    /// For each batch and kind, the number of manifolds, then the next free lane.
    next: Vec<u32>,
    /// Wasted work of a sweep (`sweep`) after the last full layout.
    idle: u32,
    /// Blocks of each color with idle lanes, in the order of [`LaneMap::rank`].
    open: Vec<Vec<u64>>,
}

impl Coloring {
    /// Colors manifolds greedily in their order, each given by its bodies and its number of points.
    /// A manifold takes the first color that neither of its bodies has.
    ///
    /// `moves` says whether a body can be moved; other bodies may have many manifolds of one color.
    /// The result depends only on the arguments.
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
        self.division.update(&self.bodies, &mut self.keys, points, (&[], Sizes::NONE));
        self.color();
        self.lay_out(false);
    }

    /// Sets the bodies, each given by whether it can be moved and whether it couples its manifolds.
    /// Manifolds on a body that does not couple them can be in several batches. Returns whether the
    /// bodies are those of the last call.
    pub(crate) fn take_bodies(&mut self, bodies: impl Iterator<Item = [bool; 2]> + Clone) -> bool {
        let same = self.bodies.iter().copied().eq(bodies.clone());
        if !same {
            self.bodies.clear();
            self.bodies.extend(bodies);
        }
        same
    }

    /// Reads the manifolds, each given by its bodies and its number of points.
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

    /// Assigns the manifolds that have been `taken` to lanes, as [`assign`](Self::assign) does, but
    /// in batches. `couplings` are the bodies of joints, and the sizes of all.
    ///
    /// If many manifolds are kept, manifolds that are not new and have their old color keep their
    /// lanes, and new manifolds take idle lanes. Colors are those of a full layout in any case.
    pub(crate) fn update(
        &mut self,
        couplings: (&[[u32; 2]], Sizes),
        reuse: impl Fn(u32) -> Reuse + Sync,
        taken: Intake,
        pool: &ThreadPool,
    ) -> Placement {
        let divided = self.division.update(&self.bodies, &mut self.keys, taken.points, couplings);
        if !divided && self.keys == self.before {
            return Placement::Same;
        }
        self.color();
        // If one manifold in eight has changed, almost every block contains one.
        let many = 8 * taken.kept > 7 * self.keys.len();
        if many && !divided && self.stay(reuse, pool) {
            return Placement::Stay;
        }
        self.lay_out(many);
        Placement::Anew
    }

    /// Finds the kind of each manifold, and the number of points before it.
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

    /// Assigns all manifolds to lanes by their kinds, each color to blocks of its own. With
    /// `spare`, every color that has blocks gets one more.
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

    /// Reserves the memory that manifolds may need to come and go in these blocks, so that a
    /// settled scene allocates nothing.
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

    /// Leaves manifolds in their lanes if they are not new, and finds lanes for the others. Returns
    /// whether the layout is good enough (`settle`).
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
                // Manifolds of the same kind have the same color.
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

    /// Estimates the wasted and the useful work of a sweep. A manifold costs as much as one of its
    /// points. A block does for all lanes the work that its longest manifold needs.
    fn sweep(&self) -> [u32; 2] {
        let used = (self.keys.len() + self.all_points()) as u32;
        let all: u32 = self.points.iter().filter(|&&points| points > 0).map(|of| 1 + of).sum();
        [WIDTH as u32 * all - used, used]
    }

    /// Finds lanes for the manifolds that have none. Returns whether all have got one, and whether
    /// a sweep wastes little more work than after the last full layout.
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

    /// Writes the extents of the batches, one after the other.
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

    /// Returns the range of a manifold's points among all points, which are ordered by manifold.
    pub(crate) fn points_of(&self, manifold: u32) -> Range<usize> {
        let manifold = manifold as usize;
        self.firsts[manifold] as usize..self.firsts[manifold + 1] as usize
    }

    /// Returns the number of points of all manifolds.
    pub(crate) fn all_points(&self) -> usize {
        self.firsts.last().map_or(0, |&all| all as usize)
    }

    /// Returns the key of a manifold.
    pub(crate) fn key(&self, manifold: u32) -> &ConstraintKey {
        &self.keys[manifold as usize]
    }
}
