//! [`LaneSystem`]: a contact system packed into lanes.

use std::sync::Arc;

use super::batch::{LaneBatch, Passes, View};
use super::block::{Block, CachedImpulse, ManifoldSource, contact_in, set};
use super::coloring::{Coloring, Placement, Reuse};
use super::conjugate::Conjugate;
use super::motion::{Lead, Targets};
use super::partition::{BatchRange, Sizes};
use super::passes::{Instructions, in_lanes, passes};
use super::sweep::BlocksMut;
use super::view::{view_all, view_all_mut, view_mut};
use super::{Lanes, Portable, WIDTH};
use crate::certificate::{Certificate, CertificateScratch};
use crate::island::Islands;
use crate::thread_pool::{DisjointSlice, Divide, ThreadPool, chunks_with_parts};
use crate::{Contact, InverseMass, Manifold, Repair, SurfaceEffects, System, Vector, Velocity};

/// Least number of blocks in a strip; a strip also has at least one block of each color. Blocks are
/// packed strip by strip, so that the data read for them stays in the level-1 cache.
const STRIP: usize = 32;

/// Memory that the rows of a joint take, with the places and masses of a body. \[bytes\]
const JOINT: usize = 4096;

/// A system of `f32` contacts, packed into lanes.
#[derive(Clone, Debug)]
pub struct LaneSystem<const L: usize, const A: usize> {
    blocks: Vec<Block<Portable, L, A>>,
    contacts: Vec<Contact<Portable, L>>,
    /// Surface effects of each block; empty if no surface runs or resists rolling.
    surfaces: Vec<SurfaceEffects<Portable, L, A>>,
    coloring: Coloring,
    extents: Vec<BatchRange>,
    conjugate: Conjugate<L, A>,
    /// Change of the target of each point ([`LaneSystem::lead`]).
    shifts: Vec<Vector<Portable, L>>,
    /// Softness of the points; `None` if all manifolds have to be read again.
    softness: Option<f32>,
    pool: Arc<ThreadPool>,
    instructions: Instructions,
    passes: &'static dyn Passes<L, A>,
}

impl<const L: usize, const A: usize> Default for LaneSystem<L, A> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const L: usize, const A: usize> LaneSystem<L, A> {
    /// Returns an empty system for the fastest instructions of this machine.
    pub fn new() -> Self {
        let best = Instructions::available().pop();
        Self::with(best.unwrap_or(Instructions::Portable))
    }

    /// Returns an empty system for these instructions.
    ///
    /// # Panics
    /// Passes panic if the machine lacks them.
    pub fn with(instructions: Instructions) -> Self {
        Self {
            blocks: Vec::new(),
            contacts: Vec::new(),
            surfaces: Vec::new(),
            coloring: Coloring::default(),
            extents: Vec::new(),
            conjugate: Conjugate::default(),
            shifts: Vec::new(),
            softness: None,
            pool: Arc::default(),
            instructions,
            passes: passes(instructions),
        }
    }

    /// Sets the thread pool that works on the system. Results do not depend on it.
    pub fn set_pool(&mut self, pool: Arc<ThreadPool>) {
        self.pool = pool;
    }

    /// Packs manifolds between bodies of these masses, and computes the effective masses of their
    /// points ([`Contact::prepare`]). Manifolds that are [kept](Reuse::Kept) are not read again,
    /// unless the softness has changed.
    pub fn pack<R: ManifoldSource<L>>(
        &mut self,
        rows: &R,
        masses: &[InverseMass<f32, L, A>],
        softness: f32,
    ) {
        let moves = |body: u32| masses[body as usize] != InverseMass::FIXED;
        let joins = |body: u32| moves(body) || !rows.stands(body);
        let again = self.softness.replace(softness) == Some(softness);
        let Self { blocks, contacts, coloring, extents, pool, .. } = self;
        let of_batches = Sizes {
            body: 8 * size_of::<Velocity<f32, L, A>>(),
            manifold: size_of::<Block<Portable, L, A>>() / WIDTH,
            point: size_of::<Contact<Portable, L>>() / WIDTH,
            joint: JOINT,
        };
        let sizes = if rows.is_whole() { Sizes::NONE } else { of_batches };
        let bodies = (0..masses.len() as u32).map(|body| [moves(body), joins(body)]);
        let reuse = |of| if again { rows.reuse(of) } else { Reuse::New };
        let same_bodies = coloring.take_bodies(bodies);
        let placed = if again && rows.same_keys() && same_bodies && coloring.division.rests() {
            Placement::Same
        } else {
            let taken = coloring.take(rows.count(), |of| rows.key(of), reuse, pool);
            coloring.update((rows.couplings(), sizes), reuse, taken, pool)
        };
        if placed == Placement::Anew {
            blocks.resize_with(coloring.points.len(), Block::empty);
            let mut first = 0;
            for (block, &room) in blocks.iter_mut().zip(&coloring.rooms) {
                block.manifold.first = first;
                first += room;
            }
            contacts.resize_with(first as usize, Contact::default);
            coloring.extents(extents);
        }
        in_lanes!(self.instructions, V => {
            self.take_blocks::<V, R>(rows, masses, placed, reuse);
        });
    }

    /// Reads the stale manifolds of all blocks, and computes the effective masses of their points.
    fn take_blocks<V: Lanes, R: ManifoldSource<L>>(
        &mut self,
        rows: &R,
        masses: &[InverseMass<f32, L, A>],
        placed: Placement,
        reuse: impl Fn(u32) -> Reuse + Copy + Sync,
    ) {
        let softness = self.softness.unwrap_or_default();
        let whole = self.whole(&mut []);
        let (pool, runs) = (whole.pool, whole.runs(|_| 0));
        pool.for_each(runs > 1, whole.divide(runs), |mut run| {
            let LaneBatch { coloring, passes, .. } = run;
            // Several batches need no strips, since each fits into the cache.
            let blocks = if run.count() > 1 { 0 } else { run.size() };
            let strips = (blocks / STRIP.max(coloring.colors.len())).max(1);
            BlocksMut::<V, L, A>::new(&mut run).each(
                strips,
                #[inline(always)]
                |index, block, points| {
                    let mut members = &coloring.members[index];
                    let changed;
                    if placed == Placement::Same {
                        changed = members.changed(reuse);
                        members = &changed;
                    }
                    if members.stale != 0 {
                        let points = &mut points[..coloring.points[index] as usize];
                        block.seat(members, coloring);
                        block.take(members, coloring, rows, masses, points);
                        passes.prepare(view_mut(block), view_all_mut(points), softness);
                    }
                },
            );
        });
    }

    /// Returns all bodies and manifolds as one batch. It can be split into batches that are solved
    /// one after the other, each through all substeps ([`ManifoldSource::stands`]).
    ///
    /// [`LaneBatch::trace`] writes to `traces`, which has one element for each point. Without `trace`,
    /// it may be empty.
    pub fn whole<'a>(&'a mut self, traces: &'a mut [CachedImpulse<L>]) -> LaneBatch<'a, L, A> {
        let Self { extents, blocks, contacts, surfaces, coloring, pool, passes, .. } = self;
        let (traces, surfaces) = (DisjointSlice::new(0, traces), DisjointSlice::new(0, surfaces));
        LaneBatch::new(extents, blocks, contacts, (coloring, traces, surfaces), (pool, *passes))
    }

    /// Sets the surface effects of each manifold. The function gets the index of the manifold, and
    /// the manifold without its points. With `None` there are no surface effects until the next
    /// call.
    pub fn take_surfaces(
        &mut self,
        surfaces: Option<impl FnMut(usize, &Manifold<f32, L>) -> SurfaceEffects<f32, L, A>>,
    ) {
        let Self { blocks, surfaces: all, coloring, .. } = self;
        all.clear();
        let Some(mut surface) = surfaces else { return };
        all.resize(blocks.len(), SurfaceEffects::NONE);
        for (index, ([block, lane], manifold)) in seats(coloring, blocks).enumerate() {
            all[block].set(lane, &surface(index, &manifold));
        }
    }

    /// Passes each manifold without its points, and the current effects of its surfaces, to a
    /// function. Does nothing if there are no surface effects.
    pub fn give_surfaces(&self, mut to: impl FnMut(&Manifold<f32, L>, &SurfaceEffects<f32, L, A>)) {
        if !self.surfaces.is_empty() {
            for ([block, lane], manifold) in seats(&self.coloring, &self.blocks) {
                to(&manifold, &self.surfaces[block].get(lane));
            }
        }
    }

    /// Writes the manifolds and contacts to `system` as they are now.
    pub fn unpack(&self, system: &mut System<f32, L, A>) {
        let System { manifolds, contacts, .. } = system;
        manifolds.clear();
        let mut last = 0;
        for (index, &place) in self.coloring.places.iter().enumerate() {
            let (block, lane) = (place as usize / WIDTH, place as usize % WIDTH);
            let points = self.coloring.points_of(index as u32);
            last = points.end;
            let (first, count) = (points.start as u32, points.len() as u32);
            let bodies = self.coloring.key(index as u32).bodies;
            let manifold = self.blocks[block].manifold_in(lane, bodies);
            manifolds.push(Manifold { first, count, ..manifold });
        }
        contacts.resize_with(last, Contact::default);
        let (useful, share) = self.pool.share(manifolds.len(), WIDTH);
        let parts = chunks_with_parts(manifolds, share, contacts, |of| of.count as usize);
        let parts = parts.zip(self.coloring.places.chunks(share));
        self.pool.for_each(useful, parts, |((manifolds, contacts), places)| {
            let mut later = contacts.iter_mut();
            for (manifold, &place) in manifolds.iter().zip(places) {
                let (block, lane) = (place as usize / WIDTH, place as usize % WIDTH);
                let wide = &self.contacts[self.blocks[block].manifold.points()];
                for (wide, contact) in wide.iter().zip(later.by_ref().take(manifold.count as usize))
                {
                    *contact = contact_in(wide, lane);
                }
            }
        });
    }

    /// Sets the targets of all contacts as [`System::set_targets`] does. `turning` are the
    /// velocities at which the substep will move the bodies, if any rotates
    /// ([`kinematics`](crate::kinematics)).
    pub fn set_targets(
        &mut self,
        displacements: &[Velocity<f32, L, A>],
        turning: Option<&[Velocity<f32, L, A>]>,
        repair: &Repair<f32>,
    ) {
        let targets = Targets::new(0, displacements, turning.is_some(), repair);
        let velocities = turning.unwrap_or_default();
        self.passes.set_targets(&mut self.whole(&mut []), &targets, velocities);
    }

    /// Takes offsets out of the targets, which have just been set ([`Lead`]).
    pub fn lead(&mut self, lead: &Lead<'_, L, A>) {
        in_lanes!(self.instructions, V => {
            let Self { blocks, contacts, shifts, .. } = self;
            shifts.resize(contacts.len(), Vector::ZERO);
            let contacts = view_all_mut::<V, _>(contacts);
            let shifts = view_all_mut::<V, _>(shifts);
            V::run(
                #[inline(always)]
                || {
                    for block in view_all::<V, _>(blocks).iter().filter(|block| block.used != 0) {
                        let points = block.manifold.points();
                        lead.shift(block, &mut contacts[points.clone()], &mut shifts[points]);
                    }
                },
            );
        });
    }

    /// Undoes [`lead`](Self::lead).
    pub fn follow(&mut self) {
        in_lanes!(self.instructions, V => {
            let Self { blocks, contacts, shifts, .. } = self;
            let contacts = view_all_mut::<V, _>(contacts);
            let shifts = view_all::<V, _>(shifts);
            for block in view_all::<V, _>(blocks).iter().filter(|block| block.used != 0) {
                let points = block.manifold.points();
                for (contact, shift) in contacts[points.clone()].iter_mut().zip(&shifts[points]) {
                    contact.target += *shift;
                }
            }
        });
    }

    fn view(&self) -> View<'_, L, A> {
        let Self { blocks, contacts, coloring, pool, .. } = self;
        View { blocks, contacts, coloring, pool }
    }

    /// Makes [`LaneSystem::conjugate`] start again, without search directions.
    pub fn begin_conjugate(&mut self) {
        self.conjugate.begin(self.blocks.len(), self.contacts.len());
    }

    /// Runs one iteration of [`nncg`](crate::nncg) over the islands that are not `done`.
    pub fn conjugate(&mut self, velocities: &mut [Velocity<f32, L, A>], done: &[bool]) {
        self.conjugate_by(velocities, (done, false));
    }

    /// Does the same with rigid contacts that repair nothing, as [`LaneBatch::relax`] does.
    pub fn conjugate_rigid(&mut self, velocities: &mut [Velocity<f32, L, A>], done: &[bool]) {
        self.conjugate_by(velocities, (done, true));
    }

    fn conjugate_by(&mut self, velocities: &mut [Velocity<f32, L, A>], on: (&[bool], bool)) {
        let mut state = std::mem::take(&mut self.conjugate);
        let passes = self.passes;
        passes.conjugate(&mut state, &mut self.whole(&mut []), velocities, on);
        self.conjugate = state;
    }

    /// Lets these islands go on without search directions.
    pub fn forget_directions(&mut self, islands: &[bool]) {
        let betas = self.conjugate.betas.iter_mut().zip(islands);
        betas.filter(|(_, forgets)| **forgets).for_each(|(beta, _)| *beta = 0.0);
    }

    /// Returns beta of each island for the next iteration. \[1\]
    pub fn betas(&self) -> &[f32] {
        &self.conjugate.betas
    }

    /// Returns |g|^2 of each island in the last iteration, or 0 if the island was done. \[J\]
    pub fn gradients(&self) -> &[f32] {
        self.conjugate.sizes()
    }

    /// Returns the certificate of each island ([`certificate`](crate::certificate)), computed in
    /// `f64` with the masses of `scratch`.
    ///
    /// With `RESIDUALS` it has all residuals, otherwise none. With `LINE` it is for the best
    /// impulses on the line, otherwise for the current ones.
    pub fn certify<'a, const RESIDUALS: bool, const LINE: bool>(
        &self,
        velocities: &[Velocity<f32, L, A>],
        prospective: &[Velocity<f32, L, A>],
        islands: &Islands,
        scratch: &'a mut CertificateScratch<L, A>,
    ) -> &'a [Certificate] {
        self.passes.certify(
            self.view(),
            [RESIDUALS, LINE],
            [velocities, prospective],
            islands,
            scratch,
        )
    }

    /// Makes the next [`LaneSystem::pack`] read all manifolds again.
    pub fn forget(&mut self) {
        self.softness = None;
    }

    /// Copies the impulses of collisions from the contacts of `system`. The next [`LaneSystem::pack`]
    /// reads all manifolds again.
    pub fn take_impacts(&mut self, system: &System<f32, L, A>) {
        self.forget();
        self.copy_in(system, |wide, lane, contact| wide.impact.set(lane, contact.impact));
    }

    /// Copies the impulses from the contacts of `system`.
    pub fn take_impulses(&mut self, system: &System<f32, L, A>) {
        self.copy_in(system, |wide, lane, contact| set(&mut wide.impulse, lane, &contact.impulse));
    }

    /// Calls `copy` for each contact of `system`, with the wide contact and its lane.
    fn copy_in(
        &mut self,
        system: &System<f32, L, A>,
        copy: impl Fn(&mut Contact<Portable, L>, usize, &Contact<f32, L>),
    ) {
        for (manifold, &place) in system.manifolds.iter().zip(&self.coloring.places) {
            let (block, lane) = (place as usize / WIDTH, place as usize % WIDTH);
            let wide = &mut self.contacts[self.blocks[block].manifold.points()];
            for (contact, wide) in system.contacts[manifold.points()].iter().zip(wide) {
                copy(wide, lane, contact);
            }
        }
    }

    /// Returns [`System::residual`] of rigid contacts for these velocities. \[m/s\]
    pub fn residual(&self, velocities: &[Velocity<f32, L, A>]) -> f32 {
        self.passes.residual(self.view(), velocities)
    }

    /// Returns the deepest overlap of a contact, or 0 if none overlaps. \[m\]
    pub fn overlap(&self) -> f32 {
        self.passes.overlap(self.view())
    }

    /// Sets the island of each manifold.
    pub fn set_islands(&mut self, islands: &Islands) {
        self.conjugate.set_islands(islands);
        for block in self.blocks.iter_mut().filter(|block| block.used != 0) {
            block.islands = block.pairs().map(|bodies| islands.of_pair(bodies));
        }
    }
}

/// Returns the block and lane of each manifold, and the manifold without its points.
fn seats<'a, const L: usize, const A: usize>(
    coloring: &'a Coloring,
    blocks: &'a [Block<Portable, L, A>],
) -> impl Iterator<Item = ([usize; 2], Manifold<f32, L>)> + 'a {
    coloring.places.iter().enumerate().map(|(index, &place)| {
        let (block, lane) = (place as usize / WIDTH, place as usize % WIDTH);
        let bodies = coloring.key(index as u32).bodies;
        ([block, lane], blocks[block].manifold_in(lane, bodies))
    })
}
