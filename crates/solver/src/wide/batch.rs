//! [`Batch`]: a part of a packed system that no manifold couples to the rest; and the [`Passes`]
//! over it.

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

/// Consecutive bodies that no manifold couples to others, with their manifolds, in their
/// [`Packed`](super::Packed) system. It can be solved through all substeps before the next batch,
/// or in parallel with other batches.
///
/// Velocities, displacements and other data of bodies are passed as slices over its own bodies
/// only.
#[derive(Debug)]
pub struct Batch<'a, V: Lanes, const L: usize, const A: usize> {
    /// One extent, or several consecutive ones.
    extents: &'a [BatchRange],
    pub(super) bodies: Range<usize>,
    pub(super) colors: &'a [Color],
    /// Indices of the first block and the first point.
    pub(super) first_block: usize,
    pub(super) first_point: usize,
    pub(super) blocks: &'a mut [Block<V, L, A>],
    pub(super) contacts: &'a mut [Contact<V, L>],
    pub(super) coloring: &'a Coloring,
    /// Cached impulses of all points of the system, if they are to be written.
    pub(super) traces: DisjointSlice<'a, CachedImpulse<L>>,
    /// Surface effects of all blocks of the system, if any.
    pub(super) surfaces: DisjointSlice<'a, SurfaceEffects<V, L, A>>,
    pub(super) pool: &'a ThreadPool,
    pub(super) passes: &'static dyn Passes<V, L, A>,
}

impl<'a, V: Lanes, const L: usize, const A: usize> Batch<'a, V, L, A> {
    /// Makes a batch of these extents. Its blocks and points are the first ones of the slices.
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

    /// Applies the impulses as [`System::apply_impulses`](crate::System::apply_impulses) does.
    pub fn apply_impulses(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.passes.apply_impulses(self, velocities);
    }

    /// Sweeps once as [`pgs::sweep`](crate::pgs::sweep) does.
    pub fn sweep(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.passes.sweep(self, velocities);
    }

    /// Sweeps once over the normals as [`pgs::sweep_coming`](crate::pgs::sweep_coming) does.
    pub fn sweep_normals(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.passes.sweep_normals(self, velocities, None);
    }

    /// Sets the targets as [`System::set_targets`](crate::System::set_targets) does and sweeps once
    /// over the normals ([`sweep_normals`](Self::sweep_normals)), in one pass. If bodies are
    /// `turning`, targets account for the curvature of their paths.
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

    /// Renews J where bodies rotate, after they have moved for `dt` \[s\]
    /// ([`kinematics`](crate::kinematics)). Effective masses are those of this `softness`. Returns
    /// whether any J has changed; that of a ball on a plane stays, however fast the ball rolls.
    pub fn renew(&mut self, bodies: MovedBodies<'_, L, A>, [dt, softness]: [f32; 2]) -> bool {
        self.passes.renew(self, bodies, [dt, softness])
    }

    /// Relaxes once as [`pgs::relax`](crate::pgs::relax) does. `renewed` says whether J has been
    /// [renewed](Self::renew) before. With a `landing`, bodies that have landed in the substep
    /// stop, unless they bounce.
    pub fn relax(
        &mut self,
        velocities: &mut [Velocity<f32, L, A>],
        renewed: bool,
        landing: Option<Landing<'_, L, A>>,
    ) {
        self.passes.relax(self, velocities, renewed, landing);
    }

    /// Returns whether any surface of the system runs or resists rolling
    /// ([`Packed::take_surfaces`]).
    ///
    /// [`Packed::take_surfaces`]: super::Packed::take_surfaces
    pub fn has_surfaces(&self) -> bool {
        self.surfaces.len() > 0
    }

    /// Adds the velocities of belts to targets that have just been set. The belts have run for
    /// `elapsed` \[s\] since gaps were measured. `hold` is that of [`Repair`].
    pub fn run_belts(&mut self, elapsed: f32, hold: f32) {
        self.passes.run_belts(self, [1.0 + hold * elapsed, 0.0]);
    }

    /// Adds the motion of belts that have run for `elapsed` \[s\] to the slips, before these are
    /// [traced](Batch::trace).
    pub fn carry_belts(&mut self, elapsed: f32) {
        self.passes.run_belts(self, [0.0, elapsed]);
    }

    /// Applies the accumulated torques of resistance to the velocities.
    pub fn apply_resistance(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.passes.apply_resistance(self, velocities);
    }

    /// Applies [`SurfaceEffects::resist`] to all manifolds.
    pub fn resist(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.passes.resist(self, velocities);
    }

    /// Updates gaps and slips after the bodies have moved by `displacements`. Writes the data that
    /// points pass to the next step, ordered by manifold, to the slice given to
    /// [`Packed::whole`](super::Packed::whole). `hold` is that of [`Repair`].
    pub fn trace(&mut self, displacements: &[Velocity<f32, L, A>], hold: f32) {
        self.passes.trace(self, displacements, hold);
    }
}

/// Other data of a system: its coloring, the cached impulses of all points, and the surface effects
/// of all blocks.
type Of<'a, V, const L: usize, const A: usize> =
    (&'a Coloring, DisjointSlice<'a, CachedImpulse<L>>, DisjointSlice<'a, SurfaceEffects<V, L, A>>);

/// Splits a batch into the extents of which it is made.
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

/// A packed system that is only read.
#[derive(Clone, Copy)]
pub(crate) struct View<'a, V: Lanes, const L: usize, const A: usize> {
    pub(super) blocks: &'a [Block<V, L, A>],
    pub(super) contacts: &'a [Contact<V, L>],
    pub(super) coloring: &'a Coloring,
    pub(super) pool: &'a ThreadPool,
}

pub(super) type Velocities<const L: usize, const A: usize> = [Velocity<f32, L, A>];

/// Passes over blocks, named as the methods of [`Batch`] and [`Packed`](super::Packed).
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

    /// `terms` are the length of the substep \[s\] and the softness.
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

    /// `parts` are the target \[1\] and the time \[s\] of [`SurfaceEffects::run`].
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

    /// `which` says whether to compute residuals and the line, as in
    /// [`Packed::certify`](super::Packed::certify).
    fn certify<'a>(
        &self,
        all: View<'_, V, L, A>,
        which: [bool; 2],
        velocities: [&Velocities<L, A>; 2],
        islands: &Islands,
        scratch: &'a mut CertificateScratch<L, A>,
    ) -> &'a [Certificate];

    /// Returns the residual of rigid contacts. \[m/s\]
    fn residual(&self, all: View<'_, V, L, A>, velocities: &Velocities<L, A>) -> f32;

    fn overlap(&self, all: View<'_, V, L, A>) -> f32;

    fn trace(&self, batch: &mut Batch<'_, V, L, A>, displacements: &Velocities<L, A>, hold: f32);
}
