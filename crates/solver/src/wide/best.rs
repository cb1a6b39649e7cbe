//! [`Wide`]: a packed system on the best lanes of this machine, chosen at run time.

use std::ops::Range;
use std::sync::Arc;

use super::batch::Batch;
use super::packed::Packed;
use super::rows::{CachedImpulse, ManifoldSource};
use super::{Landing, MovedBodies};
use crate::certificate::{Certificate, CertificateScratch};
use crate::island::Islands;
use crate::lanes::Portable;
#[cfg(target_arch = "x86_64")]
use crate::lanes::{Avx2, avx2_available};
use crate::thread_pool::{Divide, ThreadPool};
use crate::{InverseMass, Manifold, Repair, SurfaceEffects, System, Velocity};

/// A packed system of `f32` contacts on the best lanes of this machine.
#[derive(Clone, Debug)]
pub enum Wide<const L: usize, const A: usize> {
    /// Lanes for any machine.
    Portable(Packed<Portable, L, A>),
    /// Lanes for a machine with AVX2.
    #[cfg(target_arch = "x86_64")]
    Avx2(Packed<Avx2, L, A>),
}

/// A [`Batch`] of a [`Wide`] system.
#[derive(Debug)]
pub enum WideBatch<'a, const L: usize, const A: usize> {
    /// Lanes for any machine.
    Portable(Batch<'a, Portable, L, A>),
    /// Lanes for a machine with AVX2.
    #[cfg(target_arch = "x86_64")]
    Avx2(Batch<'a, Avx2, L, A>),
}

/// Evaluates the same expression on whichever lanes there are.
macro_rules! on_lanes {
    ($of:expr, $own:ident => $do:expr) => {
        match $of {
            Self::Portable($own) => $do,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2($own) => $do,
        }
    };
}

impl<const L: usize, const A: usize> Wide<L, A> {
    /// Returns an empty system on the best lanes of this machine.
    pub fn new() -> Self {
        #[cfg(target_arch = "x86_64")]
        if avx2_available() {
            return Self::Avx2(Packed::new());
        }
        Self::Portable(Packed::new())
    }

    /// Calls [`Packed::set_pool`].
    pub fn set_pool(&mut self, pool: Arc<ThreadPool>) {
        on_lanes!(self, packed => packed.set_pool(pool));
    }

    /// Calls [`Packed::pack`].
    pub fn pack(
        &mut self,
        rows: &impl ManifoldSource<L>,
        masses: &[InverseMass<f32, L, A>],
        softness: f32,
    ) {
        on_lanes!(self, packed => packed.pack(rows, masses, softness));
    }

    /// Calls [`Packed::forget`].
    pub fn forget(&mut self) {
        on_lanes!(self, packed => packed.forget());
    }

    /// Calls [`Packed::unpack`].
    pub fn unpack(&self, system: &mut System<f32, L, A>) {
        on_lanes!(self, packed => packed.unpack(system));
    }

    /// Calls [`Packed::take_surfaces`].
    pub fn take_surfaces(
        &mut self,
        surfaces: Option<impl FnMut(usize, &Manifold<f32, L>) -> SurfaceEffects<f32, L, A>>,
    ) {
        on_lanes!(self, packed => packed.take_surfaces(surfaces));
    }

    /// Calls [`Packed::give_surfaces`].
    pub fn give_surfaces(&self, to: impl FnMut(&Manifold<f32, L>, &SurfaceEffects<f32, L, A>)) {
        on_lanes!(self, packed => packed.give_surfaces(to));
    }

    /// Calls [`Packed::take_impacts`].
    pub fn take_impacts(&mut self, system: &System<f32, L, A>) {
        on_lanes!(self, packed => packed.take_impacts(system));
    }

    /// Calls [`Packed::take_impulses`].
    pub fn take_impulses(&mut self, system: &System<f32, L, A>) {
        on_lanes!(self, packed => packed.take_impulses(system));
    }

    /// Calls [`Packed::set_targets`].
    pub fn set_targets(
        &mut self,
        displacements: &[Velocity<f32, L, A>],
        turning: Option<&[Velocity<f32, L, A>]>,
        repair: &Repair<f32>,
    ) {
        on_lanes!(self, packed => packed.set_targets(displacements, turning, repair));
    }

    /// Calls [`Packed::set_islands`].
    pub fn set_islands(&mut self, islands: &Islands) {
        on_lanes!(self, packed => packed.set_islands(islands));
    }

    /// Calls [`Packed::gradients`].
    pub fn gradients(&self) -> &[f32] {
        on_lanes!(self, packed => packed.gradients())
    }

    /// Calls [`Packed::certify`].
    pub fn certify<'a, const RESIDUALS: bool, const LINE: bool>(
        &self,
        velocities: &[Velocity<f32, L, A>],
        prospective: &[Velocity<f32, L, A>],
        islands: &Islands,
        scratch: &'a mut CertificateScratch<L, A>,
    ) -> &'a [Certificate] {
        on_lanes!(self, packed => {
            packed.certify::<RESIDUALS, LINE>(velocities, prospective, islands, scratch)
        })
    }

    /// Calls [`Packed::residual`].
    pub fn residual(&self, velocities: &[Velocity<f32, L, A>]) -> f32 {
        on_lanes!(self, packed => packed.residual(velocities))
    }

    /// Calls [`Packed::overlap`].
    pub fn overlap(&self) -> f32 {
        on_lanes!(self, packed => packed.overlap())
    }

    /// Calls [`Packed::begin_conjugate`].
    pub fn begin_conjugate(&mut self) {
        on_lanes!(self, packed => packed.begin_conjugate());
    }

    /// Calls [`Packed::conjugate`].
    pub fn conjugate(&mut self, velocities: &mut [Velocity<f32, L, A>], done: &[bool]) {
        on_lanes!(self, packed => packed.conjugate(velocities, done));
    }

    /// Calls [`Packed::whole`].
    pub fn whole<'a>(&'a mut self, traces: &'a mut [CachedImpulse<L>]) -> WideBatch<'a, L, A> {
        match self {
            Self::Portable(packed) => WideBatch::Portable(packed.whole(traces)),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(packed) => WideBatch::Avx2(packed.whole(traces)),
        }
    }
}

impl<const L: usize, const A: usize> Default for Wide<L, A> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const L: usize, const A: usize> WideBatch<'_, L, A> {
    /// Calls [`Batch::bodies`].
    pub fn bodies(&self) -> Range<usize> {
        on_lanes!(self, batch => batch.bodies())
    }

    /// Calls [`Batch::runs`].
    pub fn runs(&self) -> usize {
        on_lanes!(self, batch => batch.runs())
    }

    /// Calls [`Batch::apply_impulses`].
    pub fn apply_impulses(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        on_lanes!(self, batch => batch.apply_impulses(velocities));
    }

    /// Calls [`Batch::sweep`].
    pub fn sweep(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        on_lanes!(self, batch => batch.sweep(velocities));
    }

    /// Calls [`Batch::sweep_normals`].
    pub fn sweep_normals(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        on_lanes!(self, batch => batch.sweep_normals(velocities));
    }

    /// Calls [`Batch::sweep_normals_to_targets`].
    pub fn sweep_normals_to_targets(
        &mut self,
        velocities: &mut [Velocity<f32, L, A>],
        displacements: &[Velocity<f32, L, A>],
        turning: bool,
        repair: &Repair<f32>,
    ) {
        on_lanes!(self, batch => {
            batch.sweep_normals_to_targets(velocities, displacements, turning, repair)
        });
    }

    /// Calls [`Batch::renew`].
    pub fn renew(&mut self, bodies: MovedBodies<'_, L, A>, terms: [f32; 2]) -> bool {
        on_lanes!(self, batch => batch.renew(bodies, terms))
    }

    /// Calls [`Batch::relax`].
    pub fn relax(
        &mut self,
        velocities: &mut [Velocity<f32, L, A>],
        renewed: bool,
        landing: Option<Landing<'_, L, A>>,
    ) {
        on_lanes!(self, batch => batch.relax(velocities, renewed, landing));
    }

    /// Calls [`Batch::has_surfaces`].
    pub fn has_surfaces(&self) -> bool {
        on_lanes!(self, batch => batch.has_surfaces())
    }

    /// Calls [`Batch::run_belts`].
    pub fn run_belts(&mut self, elapsed: f32, hold: f32) {
        on_lanes!(self, batch => batch.run_belts(elapsed, hold));
    }

    /// Calls [`Batch::carry_belts`].
    pub fn carry_belts(&mut self, elapsed: f32) {
        on_lanes!(self, batch => batch.carry_belts(elapsed));
    }

    /// Calls [`Batch::apply_resistance`].
    pub fn apply_resistance(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        on_lanes!(self, batch => batch.apply_resistance(velocities));
    }

    /// Calls [`Batch::resist`].
    pub fn resist(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        on_lanes!(self, batch => batch.resist(velocities));
    }

    /// Calls [`Batch::trace`].
    pub fn trace(&mut self, displacements: &[Velocity<f32, L, A>], hold: f32) {
        on_lanes!(self, batch => batch.trace(displacements, hold));
    }
}

impl<const L: usize, const A: usize> Divide for WideBatch<'_, L, A> {
    fn count(&self) -> usize {
        on_lanes!(self, batch => batch.count())
    }

    fn split_at(self, count: usize) -> (Self, Self) {
        match self {
            Self::Portable(batch) => {
                let (first, others) = batch.split_at(count);
                (Self::Portable(first), Self::Portable(others))
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(batch) => {
                let (first, others) = batch.split_at(count);
                (Self::Avx2(first), Self::Avx2(others))
            }
        }
    }
}
