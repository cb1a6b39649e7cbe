//! [`LaneBatch`]: a part of a packed system that no manifold couples to the rest; and the
//! [`Passes`] over it.

use std::fmt::Debug;
use std::ops::Range;

use super::Portable;
use super::block::{Block, CachedImpulse};
use super::coloring::{Color, Coloring};
use super::conjugate::Conjugate;
use super::motion::{Landing, MovedBodies, Targets};
use super::partition::BatchRange;
use crate::certificate::{Certificate, CertificateScratch};
use crate::island::Islands;
use crate::thread_pool::{DisjointSlice, Divide, ThreadPool};
use crate::{Contact, SurfaceEffects, Velocity};

/// Consecutive bodies that no manifold couples to others, with their manifolds, in their
/// [`LaneSystem`](super::LaneSystem) system. It can be solved through all substeps before the next
/// batch, or in parallel with other batches.
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
    /// thread; one for each batch if these parts are uneven; only one if there is too little work, or
    /// if the largest batch would take much longer than the share of a thread. `more` returns how much
    /// a range of bodies takes besides its blocks, which count 1.
    pub fn runs(&self, more: impl Fn(Range<usize>) -> usize) -> usize {
        let threads = self.pool.threads();
        let work = |of: &BatchRange| of.blocks.len() + more(of.bodies.clone());
        let sum = |run: &[BatchRange]| run.iter().map(work).sum::<usize>();
        let all = sum(self.extents);
        let are_even =
            |size: usize| self.extents.chunks(size).all(|run| 4 * sum(run) * threads <= 5 * all);
        match () {
            () if !self.pool.is_useful(all) => 1,
            () if are_even(self.count().div_ceil(threads).max(1)) => threads,
            () if are_even(1) => self.count(),
            () => 1,
        }
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

pub(super) type Velocities<const L: usize, const A: usize> = [Velocity<f32, L, A>];

/// Passes over blocks, named as the methods of [`LaneBatch`] and [`LaneSystem`](super::LaneSystem).
pub(crate) trait Passes<const L: usize, const A: usize>: Debug + Sync {
    fn prepare(
        &self,
        block: &mut Block<Portable, L, A>,
        points: &mut [Contact<Portable, L>],
        softness: f32,
    );

    fn apply_impulses(&self, batch: &mut LaneBatch<'_, L, A>, velocities: &mut Velocities<L, A>);

    fn set_targets(
        &self,
        batch: &mut LaneBatch<'_, L, A>,
        targets: &Targets<'_, f32, L, A>,
        velocities: &Velocities<L, A>,
    );

    fn sweep_normals(
        &self,
        batch: &mut LaneBatch<'_, L, A>,
        velocities: &mut Velocities<L, A>,
        targets: Option<&Targets<'_, f32, L, A>>,
    );

    fn sweep_normals_of(
        &self,
        batch: &mut LaneBatch<'_, L, A>,
        velocities: &mut Velocities<L, A>,
        bodies: &[bool],
    );

    fn sweep(&self, batch: &mut LaneBatch<'_, L, A>, velocities: &mut Velocities<L, A>);

    /// `terms` are the length of the substep \[s\] and the softness.
    fn renew(
        &self,
        batch: &mut LaneBatch<'_, L, A>,
        bodies: MovedBodies<'_, L, A>,
        terms: [f32; 2],
    ) -> bool;

    fn relax(
        &self,
        batch: &mut LaneBatch<'_, L, A>,
        velocities: &mut Velocities<L, A>,
        renewed: bool,
        landing: Option<Landing<'_, L, A>>,
    );

    /// `parts` are the target \[1\] and the time \[s\] of [`SurfaceEffects::run`].
    fn run_belts(&self, batch: &mut LaneBatch<'_, L, A>, parts: [f32; 2]);

    fn apply_resistance(&self, batch: &mut LaneBatch<'_, L, A>, velocities: &mut Velocities<L, A>);

    fn resist(&self, batch: &mut LaneBatch<'_, L, A>, velocities: &mut Velocities<L, A>);

    /// `on` says which islands are done, and whether contacts are rigid.
    fn conjugate(
        &self,
        state: &mut Conjugate<L, A>,
        batch: &mut LaneBatch<'_, L, A>,
        velocities: &mut Velocities<L, A>,
        on: (&[bool], bool),
    );

    /// `which` says whether to compute residuals and the line, as in
    /// [`LaneSystem::certify`](super::LaneSystem::certify).
    fn certify<'a>(
        &self,
        all: View<'_, L, A>,
        which: [bool; 2],
        velocities: [&Velocities<L, A>; 2],
        islands: &Islands,
        scratch: &'a mut CertificateScratch<L, A>,
    ) -> &'a [Certificate];

    /// Returns the residual of rigid contacts. \[m/s\]
    fn residual(&self, all: View<'_, L, A>, velocities: &Velocities<L, A>) -> f32;

    fn overlap(&self, all: View<'_, L, A>) -> f32;

    fn trace(
        &self,
        batch: &mut LaneBatch<'_, L, A>,
        displacements: &Velocities<L, A>,
        stick_rate: f32,
    );
}
