//! Parallel sweeps over the blocks of a packed system.
//!
//! All threads go through the colors together, each over its share of the blocks of a color, and
//! wait at a barrier after each color. The first thread does colors of few blocks alone. All shares
//! contain about as many blocks of long manifolds. A thread visits about the same bodies in every
//! color, if neighboring bodies have consecutive manifolds.
//!
//! No two blocks of a color write to the same body, and each block has its own points. So only one
//! thread accesses the data of a [`BlockVisit`], and results do not depend on the number of
//! threads.
#![allow(unsafe_code)]

mod prefetch;

use std::ops::Range;

use super::batch::{LaneBatch, View};
use super::block::{Block, CachedImpulse, choose};
use super::coloring::{BINS, Color, Coloring};
use super::number::{HALF, scatter};
use super::view::{view, view_all, view_all_mut};
use super::{KernelLanes, Lanes, Portable, WIDTH};
use crate::pgs::{self, BodyPair};
use crate::thread_pool::{DisjointSlice, ThreadPool, Worker};
use crate::{Contact, InverseMass, SurfaceEffects, Vector, Velocity, each_lane};

/// Size of the blocks from which on upcoming data is prefetched: far more than a level-2 cache
/// holds. For less, prefetching costs more than it saves. \[bytes\]
const LARGE: usize = 4 << 20;

/// A sweep over the blocks of a batch, with the velocities of its bodies.
pub(super) struct BlockSweep<'a, V: Lanes, const L: usize, const A: usize> {
    pub(super) blocks: &'a [Block<V, L, A>],
    /// Index of the first block.
    first: usize,
    /// Colors to sweep over.
    colors: &'a [Color],
    contacts: DisjointSlice<'a, Contact<V, L>>,
    velocities: DisjointSlice<'a, Velocity<f32, L, A>>,
    /// Other data of bodies that visits read.
    also: Option<DisjointSlice<'a, Velocity<f32, L, A>>>,
    /// True if blocks ahead are prefetched.
    large: bool,
    pool: &'a ThreadPool,
}

/// Iterator over the blocks that a worker visits, from the first color to the last.
pub(super) struct BlockIter<'a, V: Lanes, const L: usize, const A: usize> {
    ground: &'a BlockSweep<'a, V, L, A>,
    worker: &'a Worker<'a>,
    /// Number of colors begun.
    begun: usize,
    /// Number of bins begun of the last of these colors.
    bins: usize,
    share: Range<usize>,
}

/// A visit of a worker to a block.
pub(super) struct BlockVisit<'a, V: Lanes, const L: usize, const A: usize> {
    pub(super) index: usize,
    pub(super) block: &'a Block<V, L, A>,
    velocities: &'a DisjointSlice<'a, Velocity<f32, L, A>>,
    contacts: &'a DisjointSlice<'a, Contact<V, L>>,
    /// The sweep whose upcoming blocks to prefetch, if any.
    ahead: Option<&'a BlockSweep<'a, V, L, A>>,
    /// Lanes whose bodies it moves, as bits.
    lanes: u16,
}

impl<'g, V: Lanes, const L: usize, const A: usize> BlockSweep<'g, V, L, A> {
    pub(super) fn new(
        batch: &'g mut LaneBatch<'_, L, A>,
        velocities: &'g mut [Velocity<f32, L, A>],
    ) -> Self {
        let LaneBatch { bodies, colors, first_block: first, pool, .. } = batch;
        assert_eq!(velocities.len(), bodies.len(), "a velocity for each body of the batch");
        let contacts = DisjointSlice::new(batch.first_point, view_all_mut(batch.contacts));
        let velocities = DisjointSlice::new(bodies.start, velocities);
        let blocks = view_all(batch.blocks);
        let large = size_of_val(blocks) > LARGE;
        Self { blocks, first: *first, colors, contacts, velocities, also: None, large, pool }
    }

    /// Names other data of bodies that visits read, so that it is prefetched, too.
    pub(super) fn and(self, also: Option<&'g [Velocity<f32, L, A>]>) -> Self {
        Self { also: also.map(|also| self.velocities.beside(also)), ..self }
    }

    /// Calls `visit` for each block, on all threads of the pool if there are enough blocks.
    #[inline(always)]
    pub(super) fn each(&self, visit: impl Fn(BlockVisit<'_, V, L, A>) + Sync) {
        self.pool.run(self.pool.is_useful(self.blocks.len()), &|worker| {
            let walk = BlockIter { ground: self, worker, begun: 0, bins: BINS, share: 0..0 };
            V::run(
                #[inline(always)]
                || {
                    // `for_each` would be compiled separately, without the instructions of the
                    // lanes.
                    for at in walk {
                        visit(at);
                    }
                },
            );
        });
    }
}

impl<'a, V: Lanes, const L: usize, const A: usize> Iterator for BlockIter<'a, V, L, A> {
    type Item = BlockVisit<'a, V, L, A>;

    #[inline(always)]
    fn next(&mut self) -> Option<Self::Item> {
        loop {
            while self.share.is_empty() {
                let colors = self.ground.colors;
                let before = colors.get(self.begun.wrapping_sub(1));
                if let Some(color) = before.filter(|_| self.bins < BINS) {
                    self.share = color.share(self.worker, self.bins);
                    self.bins += 1;
                    continue;
                }
                let now = colors.get(self.begun);
                // Two consecutive colors that the first worker does alone need no barrier between
                // them.
                let alone = |of: &Color| !self.worker.shares(of.blocks.len());
                if before.is_some() && !(before.is_some_and(alone) && now.is_some_and(alone)) {
                    self.worker.barrier();
                }
                let color = now?;
                if !alone(color) {
                    self.bins = 0;
                } else if self.worker.is_first() {
                    self.share = color.blocks.start as usize..color.blocks.end as usize;
                }
                self.begun += 1;
            }
            let index = self.share.next()?;
            let BlockSweep { blocks, first, contacts, velocities, large, .. } = self.ground;
            let block = &blocks[index - first];
            // Blocks may be empty, as room for new manifolds.
            if block.used != 0 {
                let ahead = large.then_some(self.ground);
                let at = BlockVisit { index, block, velocities, contacts, ahead, lanes: u16::MAX };
                at.look_ahead(0);
                return Some(at);
            }
        }
    }
}

impl<'a, V: Lanes, const L: usize, const A: usize> BlockVisit<'a, V, L, A> {
    #[inline(always)]
    pub(super) fn points(&mut self) -> &'a mut [Contact<V, L>] {
        self.of_points(self.contacts)
    }

    /// Returns the elements of the block's points in an array over all points.
    #[inline(always)]
    pub(super) fn of_points<T>(&self, all: &'a DisjointSlice<'a, T>) -> &'a mut [T] {
        // SAFETY: no other block has these points, and no other worker is at this block.
        unsafe { all.get_mut(self.block.manifold.points()) }
    }

    /// Returns the element of the block in an array over all blocks.
    #[inline(always)]
    pub(super) fn of_block<T>(&self, all: &'a DisjointSlice<'a, T>) -> &'a mut [T] {
        // SAFETY: no other worker is at this block.
        unsafe { all.get_mut(self.index..self.index + 1) }
    }

    /// Visits the manifolds of the block once ([`pgs`]), in half of the lanes if the other half is
    /// idle. If `lagging`, velocities first get the change of J^T gamma from a renewed J.
    #[inline(always)]
    pub(super) fn visit<const LAW: u8, const FRICTION: bool>(
        &self,
        points: &mut [Contact<V, L>],
        lagging: bool,
    ) {
        let Block { manifold, mobility, masses, lag, .. } = self.block;
        let lagging = lagging && self.block.renewed;
        macro_rules! visit_in {
            ($lanes:ty, $felt:tt) => {
                pgs::visit::<$lanes, L, A, $felt, LAW, FRICTION>(
                    (view(manifold), view(mobility), view(masses)),
                    view_all_mut(points),
                    &mut Lagging {
                        at: self,
                        lag: lagging.then_some(view(lag)),
                        masses: view(masses),
                    },
                )
            };
        }
        let whole = self.block.used >> HALF != 0;
        match (whole, self.block.center) {
            (true, true) => visit_in!(V, 0),
            (true, false) => visit_in!(V, A),
            (false, true) => visit_in!(V::Half, 0),
            (false, false) => visit_in!(V::Half, A),
        }
    }

    /// Visits the manifolds in these `lanes`, given as bits. The others do not change by a bit. `before` are the
    /// impulses of the points.
    #[inline(always)]
    pub(super) fn visit_lanes<const LAW: u8, const FRICTION: bool>(
        &mut self,
        (points, before): (&mut [Contact<V, L>], &[Vector<V, L>]),
        lanes: u16,
    ) {
        self.lanes = lanes;
        self.visit::<LAW, FRICTION>(points, false);
        if lanes & self.block.used != self.block.used {
            let due = V::from_array(std::array::from_fn(|lane| f32::from(lanes >> lane & 1)));
            for (contact, before) in points.iter_mut().zip(before) {
                contact.impulse = choose(due, contact.impulse, *before);
            }
        }
    }

    #[inline(always)]
    fn look_ahead(&self, part: usize) {
        if let Some(ground) = self.ahead {
            ground.look_ahead(self.index, part);
        }
    }

    /// Prefetches a part of the upcoming data. Call it between [`gather`](Self::gather) and
    /// [`scatter`](Self::scatter).
    #[inline(always)]
    pub(super) fn between(&self) {
        self.look_ahead(2);
    }

    /// Returns the velocities of the bodies in each lane.
    #[inline(always)]
    pub(super) fn gather<C: KernelLanes>(&self) -> [Velocity<C, L, A>; 2] {
        // SAFETY: bodies that are written to belong to one block of a color, and only its worker is
        // here.
        let velocities = unsafe { self.block.gather(self.velocities) };
        self.look_ahead(1);
        velocities
    }

    /// Sets the velocities of the bodies that can be moved, in the lanes of the visit.
    #[inline(always)]
    pub(super) fn scatter<C: KernelLanes>(&self, [a, b]: [Velocity<C, L, A>; 2]) {
        self.look_ahead(3);
        self.block.check(self.velocities);
        self.scatter_side(0, &a);
        self.scatter_side(1, &b);
    }

    #[inline(always)]
    fn scatter_side<C: KernelLanes>(&self, side: usize, velocity: &Velocity<C, L, A>) {
        let bodies = &self.block.bodies[side];
        let mut numbers = [C::ZERO; 8];
        numbers[..L].copy_from_slice(&velocity.linear.0);
        numbers[L..L + A].copy_from_slice(&velocity.angular.0);
        let to = each_lane!(lane => self.velocities.place(bodies[lane]).cast());
        // SAFETY: the bodies are checked above, and nobody else is at them, as in `gather`. A
        // velocity takes up whole rows.
        unsafe {
            scatter(&numbers[..L + A], to, self.block.moving[side] & self.lanes);
        }
    }
}

/// The bodies of a block, with the lag of J^T gamma to apply to them before a visit.
struct Lagging<'a, V: Lanes, C: KernelLanes, const L: usize, const A: usize> {
    at: &'a BlockVisit<'a, V, L, A>,
    lag: Option<&'a [Velocity<C, L, A>; 2]>,
    masses: &'a [InverseMass<C, L, A>; 2],
}

impl<V: Lanes, C: KernelLanes, const L: usize, const A: usize> BodyPair<C, L, A>
    for Lagging<'_, V, C, L, A>
{
    #[inline(always)]
    fn velocities(&self) -> [Velocity<C, L, A>; 2] {
        let [mut a, mut b] = self.at.gather();
        if let Some([to_a, from_b]) = self.lag {
            a += self.masses[0].velocity(to_a);
            b -= self.masses[1].velocity(from_b);
        }
        [a, b]
    }

    #[inline(always)]
    fn between(&self) {
        self.at.between();
    }

    #[inline(always)]
    fn set_velocities(&mut self, velocities: [Velocity<C, L, A>; 2]) {
        self.at.scatter(velocities);
    }
}

/// A sweep that only reads a packed system and the velocities of its bodies.
pub(super) struct ReadSweep<'a, V: Lanes, const L: usize, const A: usize>(BlockSweep<'a, V, L, A>);

impl<'g, V: Lanes, const L: usize, const A: usize> ReadSweep<'g, V, L, A> {
    pub(super) fn new(all: View<'g, L, A>, velocities: &'g [Velocity<f32, L, A>]) -> Self {
        let View { blocks, contacts, coloring, pool } = all;
        Self(BlockSweep {
            blocks: view_all(blocks),
            first: 0,
            colors: &coloring.colors,
            contacts: DisjointSlice::reading(0, view_all(contacts)),
            velocities: DisjointSlice::reading(0, velocities),
            also: None,
            large: size_of_val(blocks) > LARGE,
            pool,
        })
    }

    /// Calls `visit` for each block as [`BlockSweep::each`] does.
    #[inline(always)]
    pub(super) fn each(&self, visit: impl Fn(BlockRead<'_, V, L, A>) + Sync) {
        self.0.each(
            #[inline(always)]
            |at| visit(BlockRead(at)),
        );
    }
}

/// A visit of a worker to a block that it only reads.
pub(super) struct BlockRead<'a, V: Lanes, const L: usize, const A: usize>(BlockVisit<'a, V, L, A>);

impl<'a, V: Lanes, const L: usize, const A: usize> BlockRead<'a, V, L, A> {
    pub(super) fn block(&self) -> &'a Block<V, L, A> {
        self.0.block
    }

    /// Returns the velocities of the bodies in each lane as [`BlockVisit::gather`] does.
    #[inline(always)]
    pub(super) fn gather(&self) -> [Velocity<V, L, A>; 2] {
        let velocities = self.0.gather();
        self.0.between();
        self.0.look_ahead(3);
        velocities
    }

    /// Returns the elements of the block's lanes in an array over the lanes of all blocks.
    #[inline(always)]
    pub(super) fn of_lanes<T>(&self, all: &'a DisjointSlice<'a, T>) -> &'a mut [T] {
        // SAFETY: no other worker is at this block.
        unsafe { all.get_mut(WIDTH * self.0.index..WIDTH * (self.0.index + 1)) }
    }

    /// Returns the element of the body on a side of a lane in an array over all bodies, if that
    /// body can be moved.
    #[inline(always)]
    pub(super) fn of_body<'b, T>(
        &'b mut self,
        all: &'b DisjointSlice<'_, T>,
        side: usize,
        lane: usize,
    ) -> Option<&'b mut T> {
        let moves = self.0.block.moving[side] >> lane & 1 != 0;
        let body = self.0.block.bodies[side][lane] as usize;
        // SAFETY: bodies that can be moved belong to one block of a color, and only its worker is
        // here.
        moves.then(|| unsafe { &mut all.get_mut(body..body + 1)[0] })
    }
}

/// Blocks and their points, which are changed independently and in any order. Each worker takes the
/// blocks that it also sweeps over.
pub(super) struct BlocksMut<'a, V: Lanes, const L: usize, const A: usize> {
    blocks: DisjointSlice<'a, Block<V, L, A>>,
    contacts: DisjointSlice<'a, Contact<V, L>>,
    traces: DisjointSlice<'a, CachedImpulse<L>>,
    surfaces: DisjointSlice<'a, SurfaceEffects<Portable, L, A>>,
    coloring: &'a Coloring,
    colors: &'a [Color],
    pool: &'a ThreadPool,
}

impl<'a, V: Lanes, const L: usize, const A: usize> BlocksMut<'a, V, L, A> {
    pub(super) fn new(batch: &'a mut LaneBatch<'_, L, A>) -> Self {
        let LaneBatch { traces, surfaces, coloring, colors, pool, .. } = *batch;
        let blocks = DisjointSlice::new(batch.first_block, view_all_mut(batch.blocks));
        let contacts = DisjointSlice::new(batch.first_point, view_all_mut(batch.contacts));
        Self { blocks, contacts, traces, surfaces, coloring, colors, pool }
    }

    /// Calls `work` for each block and the points that it has room for, on all threads of the pool
    /// if there are enough blocks. Each worker goes over a strip of each color, then over the next
    /// strip of each. With many strips, consecutive manifolds are close in this order; with one,
    /// consecutive blocks are.
    #[inline(always)]
    pub(super) fn each(
        &self,
        strips: usize,
        work: impl Fn(usize, &mut Block<V, L, A>, &mut [Contact<V, L>]) + Sync,
    ) {
        self.pool.run(self.pool.is_useful(self.blocks.len()), &|worker| {
            V::run(
                #[inline(always)]
                || {
                    for strip in 0..strips {
                        for color in self.colors {
                            self.each_of(color, worker, [strip, strips], &work);
                        }
                    }
                },
            );
        });
    }

    /// Calls `work` for the blocks of a color that a worker takes, in one of these strips.
    #[inline(always)]
    fn each_of(
        &self,
        color: &Color,
        worker: &Worker<'_>,
        [strip, strips]: [usize; 2],
        work: &impl Fn(usize, &mut Block<V, L, A>, &mut [Contact<V, L>]),
    ) {
        for bin in 0..BINS {
            let share = color.share(worker, bin);
            let end = |strip: usize| share.start + share.len() * strip / strips;
            for index in end(strip)..end(strip + 1) {
                // SAFETY: shares have no block in common, and blocks have no points in common.
                unsafe {
                    let block = &mut self.blocks.get_mut(index..index + 1)[0];
                    let first = block.manifold.first as usize;
                    let room = self.coloring.rooms[index] as usize;
                    work(index, block, self.contacts.get_mut(first..first + room));
                }
            }
        }
    }

    /// Returns the surface effects of a block. The system must have surface effects.
    #[inline(always)]
    pub(super) fn surface(&self, index: usize) -> &SurfaceEffects<V, L, A> {
        // SAFETY: nobody changes surface effects during a pass over the blocks.
        unsafe { view(&self.surfaces.get_mut(index..index + 1)[0]) }
    }

    /// Writes the cached impulses of one point of each manifold of a block.
    #[inline(always)]
    pub(super) fn trace(&self, index: usize, point: usize, contact: &Contact<V, L>) {
        let members = &self.coloring.members[index];
        let (mut at, mut lanes) = ([0; WIDTH], 0);
        for (lane, &manifold) in members.manifolds.iter().enumerate() {
            let points = self.coloring.points_of(manifold);
            at[lane] = (points.start + point) as u32;
            let is_there = point < points.len() && points.end <= self.traces.len();
            lanes |= u16::from(is_there) << lane;
        }
        lanes &= members.used;
        let mut numbers = [V::ZERO; 8];
        numbers[..L].copy_from_slice(&contact.impulse.0);
        numbers[L..2 * L].copy_from_slice(&contact.gap.0);
        let to = each_lane!(lane => self.traces.place(at[lane]).cast());
        // SAFETY: the range was just checked, and no other block has these points. A cached impulse
        // is as many numbers.
        unsafe { scatter(&numbers[..2 * L], to, lanes) };
    }
}
