//! [`Batch`]: a part of a packed system that nothing joins to the rest; and the [`Passes`] over it.

use std::fmt::Debug;
use std::ops::Range;

use super::block::Block;
use super::conjugate::Conjugate;
use super::rows::CachedImpulse;
use super::targets::{Landing, MovedBodies, Targets};
use crate::batch::BatchRange;
use crate::certificate::{Certificate, CertificateScratch};
use crate::color::{Color, Coloring};
use crate::island::Islands;
use crate::lanes::Lanes;
use crate::thread_pool::{DisjointSlice, Divide, ThreadPool};
use crate::{Contact, Repair, SurfaceEffects, Velocity};

/// Bodies that follow each other and that no manifold joins to others, with their manifolds, in their
/// [`Packed`](super::Packed) system. It can be taken through all substeps before the next one is, or while
/// others are.
///
/// Velocities, displacements and whatever else there is of its bodies come as slices of only these.
#[derive(Debug)]
pub struct Batch<'a, V: Lanes, const L: usize, const A: usize> {
    /// It may be several, one after the other.
    extents: &'a [BatchRange],
    pub(super) bodies: Range<usize>,
    pub(super) colors: &'a [Color],
    /// The numbers of its first block and point.
    pub(super) first_block: usize,
    pub(super) first_point: usize,
    pub(super) blocks: &'a mut [Block<V, L, A>],
    pub(super) contacts: &'a mut [Contact<V, L>],
    pub(super) coloring: &'a Coloring,
    /// Where those of all points of the system go, if anywhere.
    pub(super) traces: DisjointSlice<'a, CachedImpulse<L>>,
    /// Of all blocks of the system, if any.
    pub(super) surfaces: DisjointSlice<'a, SurfaceEffects<V, L, A>>,
    pub(super) pool: &'a ThreadPool,
    pub(super) passes: &'static dyn Passes<V, L, A>,
}

impl<'a, V: Lanes, const L: usize, const A: usize> Batch<'a, V, L, A> {
    /// Of these extents, whose blocks and points come first of the ones given.
    pub(super) fn new(
        extents: &'a [BatchRange],
        blocks: &'a mut [Block<V, L, A>],
        contacts: &'a mut [Contact<V, L>],
        (coloring, traces, surfaces): Of<'a, V, L, A>,
        (pool, passes): (&'a ThreadPool, &'static dyn Passes<V, L, A>),
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

    /// Its bodies.
    pub fn bodies(&self) -> Range<usize> {
        self.bodies.clone()
    }

    /// How many blocks of manifolds it has.
    pub fn size(&self) -> usize {
        self.blocks.len()
    }

    /// In how many runs of as many batches its pool had better go over it: one for each member, or one for all
    /// together, if the largest would take much longer than its share.
    pub fn runs(&self) -> usize {
        let (all, threads) = (self.size(), self.pool.threads());
        let mut runs = self.extents.chunks(self.count().div_ceil(threads).max(1));
        let blocks = |run: &[BatchRange]| run.iter().map(|of| of.blocks.len()).sum::<usize>();
        let is_even = runs.all(|run| 4 * blocks(run) * threads <= 5 * all);
        if is_even && self.pool.is_useful(all) { threads } else { 1 }
    }

    /// [`System::apply_impulses`](crate::System::apply_impulses).
    pub fn apply_impulses(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.passes.apply_impulses(self, velocities);
    }

    /// [`pgs::sweep`](crate::pgs::sweep).
    pub fn sweep(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.passes.sweep(self, velocities);
    }

    /// [`pgs::sweep_normals`](crate::pgs::sweep_normals).
    pub fn sweep_normals(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.passes.sweep_normals(self, velocities, None);
    }

    /// [`System::set_targets`](crate::System::set_targets) and [`pgs::sweep_normals`](crate::pgs::sweep_normals)
    /// in one pass. Whether bodies turn: then targets know how their paths bend.
    pub fn sweep_normals_to_targets(
        &mut self,
        velocities: &mut [Velocity<f32, L, A>],
        displacements: &[Velocity<f32, L, A>],
        turning: bool,
        repair: &Repair<f32>,
    ) {
        let targets = Targets::new(self.bodies.start, displacements, turning, repair);
        self.passes.sweep_normals(self, velocities, Some(&targets));
    }

    /// Renews J where bodies turn, after they have moved for `dt` \[s\] ([`kinematics`](crate::kinematics)):
    /// effective masses are those of this `softness`. Returns whether any J is another: that of a ball on a plane
    /// stays, however fast it rolls.
    pub fn renew(&mut self, bodies: MovedBodies<'_, L, A>, [dt, softness]: [f32; 2]) -> bool {
        self.passes.renew(self, bodies, [dt, softness])
    }

    /// [`pgs::relax`](crate::pgs::relax); whether J has been [renewed](Self::renew) before.
    /// With a landing, bodies that have come down in the substep stop, unless they bounce.
    pub fn relax(
        &mut self,
        velocities: &mut [Velocity<f32, L, A>],
        renewed: bool,
        landing: Option<Landing<'_, L, A>>,
    ) {
        self.passes.relax(self, velocities, renewed, landing);
    }

    /// Whether any surface of the system runs or resists rolling ([`Packed::take_surfaces`]).
    ///
    /// [`Packed::take_surfaces`]: super::Packed::take_surfaces
    pub fn has_surfaces(&self) -> bool {
        self.surfaces.len() > 0
    }

    /// Adds belts to targets that have just been set, when they have run for `elapsed` \[s\] since gaps were
    /// measured: `hold` is that of [`Repair`].
    pub fn run_belts(&mut self, elapsed: f32, hold: f32) {
        self.passes.run_belts(self, [1.0 + hold * elapsed, 0.0]);
    }

    /// Moves slips on by belts that have run for `elapsed` \[s\], before they are [traced](Batch::trace).
    pub fn carry_belts(&mut self, elapsed: f32) {
        self.passes.run_belts(self, [0.0, elapsed]);
    }

    /// Adds the torques of resistance that are held to the velocities.
    pub fn apply_resistance(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.passes.apply_resistance(self, velocities);
    }

    /// [`SurfaceEffects::resist`] of all manifolds.
    pub fn resist(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.passes.resist(self, velocities);
    }

    /// Moves gaps and slips on, once bodies have moved by `displacements`, and gives what the points hand to
    /// the next step, one manifold's after the other's, to where the system was told to
    /// ([`Packed::whole`](super::Packed::whole)): `hold` is that of [`Repair`].
    pub fn trace(&mut self, displacements: &[Velocity<f32, L, A>], hold: f32) {
        self.passes.trace(self, displacements, hold);
    }
}

/// What a system has besides blocks and points: who is where, traces of all points, surfaces of all blocks.
type Of<'a, V, const L: usize, const A: usize> =
    (&'a Coloring, DisjointSlice<'a, CachedImpulse<L>>, DisjointSlice<'a, SurfaceEffects<V, L, A>>);

/// Into the batches it is made of.
impl<V: Lanes, const L: usize, const A: usize> Divide for Batch<'_, V, L, A> {
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

/// All of a packed system, to be read.
#[derive(Clone, Copy)]
pub(crate) struct View<'a, V: Lanes, const L: usize, const A: usize> {
    pub(super) blocks: &'a [Block<V, L, A>],
    pub(super) contacts: &'a [Contact<V, L>],
    pub(super) coloring: &'a Coloring,
    pub(super) pool: &'a ThreadPool,
}

pub(super) type Velocities<const L: usize, const A: usize> = [Velocity<f32, L, A>];

/// What is done to blocks, by the names of the methods of [`Batch`] and [`Packed`](super::Packed).
pub(crate) trait Passes<V: Lanes, const L: usize, const A: usize>: Debug + Sync {
    fn prepare(&self, block: &mut Block<V, L, A>, points: &mut [Contact<V, L>], softness: f32);

    fn apply_impulses(&self, batch: &mut Batch<'_, V, L, A>, velocities: &mut Velocities<L, A>);

    fn set_targets(
        &self,
        batch: &mut Batch<'_, V, L, A>,
        targets: &Targets<'_, V, L, A>,
        velocities: &Velocities<L, A>,
    );

    fn sweep_normals(
        &self,
        batch: &mut Batch<'_, V, L, A>,
        velocities: &mut Velocities<L, A>,
        targets: Option<&Targets<'_, V, L, A>>,
    );

    fn sweep(&self, batch: &mut Batch<'_, V, L, A>, velocities: &mut Velocities<L, A>);

    /// Length of the substep and softness.
    fn renew(
        &self,
        batch: &mut Batch<'_, V, L, A>,
        bodies: MovedBodies<'_, L, A>,
        terms: [f32; 2],
    ) -> bool;

    fn relax(
        &self,
        batch: &mut Batch<'_, V, L, A>,
        velocities: &mut Velocities<L, A>,
        renewed: bool,
        landing: Option<Landing<'_, L, A>>,
    );

    /// Target and time of [`SurfaceEffects::run`].
    fn run_belts(&self, batch: &mut Batch<'_, V, L, A>, parts: [f32; 2]);

    fn apply_resistance(&self, batch: &mut Batch<'_, V, L, A>, velocities: &mut Velocities<L, A>);

    fn resist(&self, batch: &mut Batch<'_, V, L, A>, velocities: &mut Velocities<L, A>);

    fn conjugate(
        &self,
        state: &mut Conjugate<V, L, A>,
        batch: &mut Batch<'_, V, L, A>,
        velocities: &mut Velocities<L, A>,
        done: &[bool],
    );

    /// With residuals, for the line: both as in [`Packed::certify`](super::Packed::certify).
    fn certify<'a>(
        &self,
        all: View<'_, V, L, A>,
        which: [bool; 2],
        velocities: [&Velocities<L, A>; 2],
        islands: &Islands,
        scratch: &'a mut CertificateScratch<L, A>,
    ) -> &'a [Certificate];

    /// Of rigid contacts.
    fn residual(&self, all: View<'_, V, L, A>, velocities: &Velocities<L, A>) -> f32;

    fn overlap(&self, all: View<'_, V, L, A>) -> f32;

    fn trace(&self, batch: &mut Batch<'_, V, L, A>, displacements: &Velocities<L, A>, hold: f32);
}
