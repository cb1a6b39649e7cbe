//! [`LaneBatch`]: a part of a packed system that no manifold couples to the rest.

use std::ops::Range;

use super::Portable;
use super::block::Block;
use super::coloring::{Color, Coloring};
use super::partition::BatchRange;
use super::passes::Passes;
use super::source::CachedImpulse;
use crate::thread_pool::{DisjointSlice, Divide, ThreadPool};
use crate::{Contact, SurfaceEffects};

/// Consecutive bodies that no manifold couples to others, with their manifolds, in their
/// [`LaneSystem`](super::LaneSystem) system. It can be solved through all substeps before the next batch,
/// or in parallel with other batches.
///
/// Velocities, displacements and other data of bodies are passed as slices over its own bodies
/// only.
#[derive(Debug)]
pub struct LaneBatch<'a, const L: usize, const A: usize> {
    /// One extent, or several consecutive ones.
    extents: &'a [BatchRange],
    pub(super) bodies: Range<usize>,
    pub(super) colors: &'a [Color],
    /// Indices of the first block and the first point.
    pub(super) first_block: usize,
    pub(super) first_point: usize,
    pub(super) blocks: &'a mut [Block<Portable, L, A>],
    pub(super) contacts: &'a mut [Contact<Portable, L>],
    pub(super) coloring: &'a Coloring,
    /// Cached impulses of all points of the system, if they are to be written.
    pub(super) traces: DisjointSlice<'a, CachedImpulse<L>>,
    /// Surface effects of all blocks of the system, if any.
    pub(super) surfaces: DisjointSlice<'a, SurfaceEffects<Portable, L, A>>,
    pub(super) pool: &'a ThreadPool,
    pub(super) passes: &'static dyn Passes<L, A>,
}

impl<'a, const L: usize, const A: usize> LaneBatch<'a, L, A> {
    /// Makes a batch of these extents. Its blocks and points are the first ones of the slices.
    pub(super) fn new(
        extents: &'a [BatchRange],
        blocks: &'a mut [Block<Portable, L, A>],
        contacts: &'a mut [Contact<Portable, L>],
        (coloring, traces, surfaces): Of<'a, L, A>,
        (pool, passes): (&'a ThreadPool, &'static dyn Passes<L, A>),
    ) -> Self {
        let none = BatchRange::default();
        let (first, last) = extents.first().zip(extents.last()).unwrap_or((&none, &none));
        let bodies = first.bodies.start..last.bodies.end;
        let colors = &coloring.colors[first.colors.start..last.colors.end];
        let (first_block, first_point) = (first.blocks.start, first.points.start);
        Self {
            extents,
            bodies,
            colors,
            first_block,
            first_point,
            blocks,
            contacts,
            coloring,
            traces,
            surfaces,
            pool,
            passes,
        }
    }

    /// Returns the range of its bodies.
    pub fn bodies(&self) -> Range<usize> {
        self.bodies.clone()
    }

    /// Returns the number of its blocks.
    pub fn size(&self) -> usize {
        self.blocks.len()
    }

    /// Returns the number of parts into which its thread pool should divide it: one for each
    /// thread. It is only one if there is too little work, or if the largest part would take much
    /// longer than its share.
    pub fn runs(&self) -> usize {
        let (all, threads) = (self.size(), self.pool.threads());
        let mut runs = self.extents.chunks(self.count().div_ceil(threads).max(1));
        let blocks = |run: &[BatchRange]| run.iter().map(|of| of.blocks.len()).sum::<usize>();
        let is_even = runs.all(|run| 4 * blocks(run) * threads <= 5 * all);
        if is_even && self.pool.is_useful(all) { threads } else { 1 }
    }
}

/// Other data of a system: its coloring, the cached impulses of all points, and the surface effects
/// of all blocks.
type Of<'a, const L: usize, const A: usize> = (
    &'a Coloring,
    DisjointSlice<'a, CachedImpulse<L>>,
    DisjointSlice<'a, SurfaceEffects<Portable, L, A>>,
);

/// Splits a batch into the extents of which it is made.
impl<const L: usize, const A: usize> Divide for LaneBatch<'_, L, A> {
    fn count(&self) -> usize {
        self.extents.len()
    }

    fn split_at(self, count: usize) -> (Self, Self) {
        let (first, others) = self.extents.split_at(count);
        let blocks = first.iter().map(|extent| extent.blocks.len()).sum();
        let points = first.iter().map(|extent| extent.points.len()).sum();
        let (blocks, later_blocks) = self.blocks.split_at_mut(blocks);
        let (contacts, later_contacts) = self.contacts.split_at_mut(points);
        let of = (self.coloring, self.traces, self.surfaces);
        let by = (self.pool, self.passes);
        let first = Self::new(first, blocks, contacts, of, by);
        (first, Self::new(others, later_blocks, later_contacts, of, by))
    }
}

/// A packed system that is only read.
#[derive(Clone, Copy)]
pub(crate) struct View<'a, const L: usize, const A: usize> {
    pub(super) blocks: &'a [Block<Portable, L, A>],
    pub(super) contacts: &'a [Contact<Portable, L>],
    pub(super) coloring: &'a Coloring,
    pub(super) pool: &'a ThreadPool,
}
