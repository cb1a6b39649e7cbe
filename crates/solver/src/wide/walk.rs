//! How a pool goes over the blocks of a packed system.
//!
//! All members walk through the colors side by side, each over its share of the blocks of a color, and
//! barrier after each; colors of few blocks are done by one. A share has as many blocks of long manifolds as any
//! other, and the same bodies in all colors, as far as neighbors follow each other. Within a color no two
//! blocks have a body in common that is written to, and each block has its own points. So what a worker
//! touches at a [`BlockVisit`] nobody else does, and nothing depends on how many members there are.
#![allow(unsafe_code)]

mod ahead;

use std::ops::Range;

use super::batch::{Batch, View};
use super::block::Block;
use super::rows::CachedImpulse;
use crate::color::{BINS, Color, Coloring};
use crate::lanes::{HALF, KernelLanes, Lanes, WIDTH, halved, halved_mut, scatter};
use crate::pgs::{Parts, visit};
use crate::thread_pool::{DisjointSlice, ThreadPool, Worker};
use crate::{Contact, SurfaceEffects, Velocity, each_lane};

/// Bytes of blocks from which on what comes next is asked for ahead: by far more than the second cache holds.
/// With less, asking takes longer than it saves.
const LARGE: usize = 4 << 20;

/// A batch and the velocities of its bodies.
pub(super) struct BlockSweep<'a, V: Lanes, const L: usize, const A: usize> {
    pub(super) blocks: &'a [Block<V, L, A>],
    /// The number of the first block.
    first: usize,
    /// The blocks of each color to walk over.
    colors: &'a [Color],
    contacts: DisjointSlice<'a, Contact<V, L>>,
    velocities: DisjointSlice<'a, Velocity<f32, L, A>>,
    /// What else visits read of bodies.
    also: Option<DisjointSlice<'a, Velocity<f32, L, A>>>,
    /// Whether to look ahead.
    large: bool,
    pool: &'a ThreadPool,
}

/// A worker's way over the blocks, from the first color to the last.
pub(super) struct BlockIter<'a, V: Lanes, const L: usize, const A: usize> {
    ground: &'a BlockSweep<'a, V, L, A>,
    worker: &'a Worker<'a>,
    /// Colors begun.
    begun: usize,
    /// Bins of the last one begun.
    bins: usize,
    share: Range<usize>,
}

/// A worker at a block.
pub(super) struct BlockVisit<'a, V: Lanes, const L: usize, const A: usize> {
    pub(super) index: usize,
    pub(super) block: &'a Block<V, L, A>,
    velocities: &'a DisjointSlice<'a, Velocity<f32, L, A>>,
    contacts: &'a DisjointSlice<'a, Contact<V, L>>,
    /// Where to look ahead.
    ahead: Option<&'a BlockSweep<'a, V, L, A>>,
}

impl<'g, V: Lanes, const L: usize, const A: usize> BlockSweep<'g, V, L, A> {
    pub(super) fn new(
        batch: &'g mut Batch<'_, V, L, A>,
        velocities: &'g mut [Velocity<f32, L, A>],
    ) -> Self {
        let Batch { bodies, colors, first_block: first, pool, .. } = batch;
        assert_eq!(velocities.len(), bodies.len(), "a velocity for each body of the batch");
        let contacts = DisjointSlice::new(batch.first_point, batch.contacts);
        let velocities = DisjointSlice::new(bodies.start, velocities);
        let blocks = &*batch.blocks;
        let large = size_of_val(blocks) > LARGE;
        Self { blocks, first: *first, colors, contacts, velocities, also: None, large, pool }
    }

    /// The same, where visits read something else of bodies, too.
    pub(super) fn and(self, also: Option<&'g [Velocity<f32, L, A>]>) -> Self {
        Self { also: also.map(|also| self.velocities.beside(also)), ..self }
    }

    /// Has the pool walk over the blocks, if they are worth it, and `visit` each.
    #[inline(always)]
    pub(super) fn each(&self, visit: impl Fn(BlockVisit<'_, V, L, A>) + Sync) {
        self.pool.run(self.pool.is_useful(self.blocks.len()), &|worker| {
            let walk = BlockIter { ground: self, worker, begun: 0, bins: BINS, share: 0..0 };
            V::run(
                #[inline(always)]
                || {
                    // `for_each` would be compiled apart, without the instructions of the lanes.
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
                // Between two colors that the first worker does alone there is nobody to wait for.
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
            // Some wait for manifolds to come.
            if block.used != 0 {
                let ahead = large.then_some(self.ground);
                let at = BlockVisit { index, block, velocities, contacts, ahead };
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

    /// What belongs to the points of the block, in an array over all points.
    #[inline(always)]
    pub(super) fn of_points<T>(&self, all: &'a DisjointSlice<'a, T>) -> &'a mut [T] {
        // SAFETY: no other block has these points, and no other worker is at this block.
        unsafe { all.get_mut(self.block.manifold.points()) }
    }

    /// What belongs to the block, in an array over all blocks.
    #[inline(always)]
    pub(super) fn of_block<T>(&self, all: &'a DisjointSlice<'a, T>) -> &'a mut [T] {
        // SAFETY: no other worker is at this block.
        unsafe { all.get_mut(self.index..self.index + 1) }
    }

    /// One visit to its manifolds ([`pgs`](crate::pgs)), in half of the lanes if they are all there; if
    /// `lagging`, after their impulses have followed a renewed J.
    #[inline(always)]
    pub(super) fn visit<const LAW: u8, const FRICTION: bool>(
        &self,
        points: &mut [Contact<V, L>],
        lagging: bool,
    ) {
        let Block { manifold, mobility, masses, .. } = self.block;
        let lag = if lagging && self.block.renewed { Some(&self.block.lag) } else { None };
        if self.block.used >> HALF != 0 {
            return self.visit_in::<V, LAW, FRICTION>((manifold, mobility, masses), points, lag);
        }
        // SAFETY: of what is made of lanes the layout is laid down.
        unsafe {
            let parts = (halved(manifold), halved(mobility), halved(masses));
            let lag = match lag {
                Some(lag) => Some(halved(lag)),
                None => None,
            };
            self.visit_in::<V::Half, LAW, FRICTION>(parts, halved_mut(points), lag);
        }
    }

    #[inline(always)]
    fn visit_in<C: KernelLanes, const LAW: u8, const FRICTION: bool>(
        &self,
        parts: Parts<'_, C, L, A>,
        points: &mut [Contact<C, L>],
        lag: Option<&[Velocity<C, L, A>; 2]>,
    ) {
        let [mut a, mut b] = self.gather();
        if let Some([to_a, from_b]) = lag {
            a += parts.2[0].velocity(to_a);
            b -= parts.2[1].velocity(from_b);
        }
        visit::<C, L, A, LAW, FRICTION>(
            parts,
            self.block.center,
            points,
            [&mut a, &mut b],
            #[inline(always)]
            || self.between(),
        );
        self.scatter([a, b]);
    }

    #[inline(always)]
    fn look_ahead(&self, part: usize) {
        if let Some(ground) = self.ahead {
            ground.look_ahead(self.index, part);
        }
    }

    /// To be called on the way from [`gather`](Self::gather) to [`scatter`](Self::scatter).
    #[inline(always)]
    pub(super) fn between(&self) {
        self.look_ahead(2);
    }

    /// The velocities of the bodies in each lane.
    #[inline(always)]
    pub(super) fn gather<C: KernelLanes>(&self) -> [Velocity<C, L, A>; 2] {
        // SAFETY: bodies that are written to belong to one block of a color; only its worker is here.
        let velocities = unsafe { self.block.gather(self.velocities) };
        self.look_ahead(1);
        velocities
    }

    /// Gives bodies that can be moved new velocities.
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
        // SAFETY: checked above; nobody else is at these bodies, as in `gather`. A velocity takes up whole
        // rows.
        unsafe {
            scatter(&numbers[..L + A], to, self.block.moving[side]);
        }
    }
}

/// A packed system and the velocities of its bodies, to be read on the way over its blocks.
pub(super) struct ReadSweep<'a, V: Lanes, const L: usize, const A: usize>(BlockSweep<'a, V, L, A>);

impl<'g, V: Lanes, const L: usize, const A: usize> ReadSweep<'g, V, L, A> {
    pub(super) fn new(all: View<'g, V, L, A>, velocities: &'g [Velocity<f32, L, A>]) -> Self {
        let View { blocks, contacts, coloring, pool } = all;
        Self(BlockSweep {
            blocks,
            first: 0,
            colors: &coloring.colors,
            contacts: DisjointSlice::reading(0, contacts),
            velocities: DisjointSlice::reading(0, velocities),
            also: None,
            large: size_of_val(blocks) > LARGE,
            pool,
        })
    }

    /// [`BlockSweep::each`].
    #[inline(always)]
    pub(super) fn each(&self, visit: impl Fn(BlockRead<'_, V, L, A>) + Sync) {
        self.0.each(
            #[inline(always)]
            |at| visit(BlockRead(at)),
        );
    }
}

/// A worker at a block that it only reads.
pub(super) struct BlockRead<'a, V: Lanes, const L: usize, const A: usize>(BlockVisit<'a, V, L, A>);

impl<'a, V: Lanes, const L: usize, const A: usize> BlockRead<'a, V, L, A> {
    pub(super) fn block(&self) -> &'a Block<V, L, A> {
        self.0.block
    }

    /// [`BlockVisit::gather`].
    #[inline(always)]
    pub(super) fn gather(&self) -> [Velocity<V, L, A>; 2] {
        let velocities = self.0.gather();
        self.0.between();
        self.0.look_ahead(3);
        velocities
    }

    /// What belongs to the lanes of the block, in an array over those of all blocks.
    #[inline(always)]
    pub(super) fn of_lanes<T>(&self, all: &'a DisjointSlice<'a, T>) -> &'a mut [T] {
        // SAFETY: no other worker is at this block.
        unsafe { all.get_mut(WIDTH * self.0.index..WIDTH * (self.0.index + 1)) }
    }

    /// What belongs to the body on a side of a lane, in an array over all bodies, if that can be moved.
    #[inline(always)]
    pub(super) fn of_body<'b, T>(
        &'b mut self,
        all: &'b DisjointSlice<'_, T>,
        side: usize,
        lane: usize,
    ) -> Option<&'b mut T> {
        let moves = self.0.block.moving[side] >> lane & 1 != 0;
        let body = self.0.block.bodies[side][lane] as usize;
        // SAFETY: bodies that can be moved belong to one block of a color; only its worker is here.
        moves.then(|| unsafe { &mut all.get_mut(body..body + 1)[0] })
    }
}

/// Blocks and their points, each by itself: to be changed in any order, by the members that sweep over them.
pub(super) struct BlocksMut<'a, V: Lanes, const L: usize, const A: usize> {
    blocks: DisjointSlice<'a, Block<V, L, A>>,
    contacts: DisjointSlice<'a, Contact<V, L>>,
    traces: DisjointSlice<'a, CachedImpulse<L>>,
    surfaces: DisjointSlice<'a, SurfaceEffects<V, L, A>>,
    coloring: &'a Coloring,
    colors: &'a [Color],
    pool: &'a ThreadPool,
}

impl<'a, V: Lanes, const L: usize, const A: usize> BlocksMut<'a, V, L, A> {
    pub(super) fn new(batch: &'a mut Batch<'_, V, L, A>) -> Self {
        let Batch { traces, surfaces, coloring, colors, pool, .. } = *batch;
        let blocks = DisjointSlice::new(batch.first_block, &mut *batch.blocks);
        let contacts = DisjointSlice::new(batch.first_point, batch.contacts);
        Self { blocks, contacts, traces, surfaces, coloring, colors, pool }
    }

    /// Has the pool do some `work` on each block and the points that it has room for, if they are worth it: on a
    /// strip of each color, then the next of each. In many strips manifolds that follow each other are together, in
    /// one blocks are.
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

    /// Those of a color that a worker takes, in one of so many strips.
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

    /// What the surfaces of a block do; there must be some.
    #[inline(always)]
    pub(super) fn surface(&self, index: usize) -> &SurfaceEffects<V, L, A> {
        // SAFETY: nobody changes them on the way over a field.
        unsafe { &self.surfaces.get_mut(index..index + 1)[0] }
    }

    /// Puts the traces of one point of each manifold of a block where they belong.
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
        // SAFETY: just checked; no other block has these points. A trace is so many numbers.
        unsafe { scatter(&numbers[..2 * L], to, lanes) };
    }
}
