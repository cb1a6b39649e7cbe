//! [`Packed`]: a system in lanes.

use std::sync::Arc;

use super::batch::{Batch, Passes, View};
use super::block::{Block, contact_in, set};
use super::conjugate::Conjugate;
use super::passes::passes;
use super::rows::{CachedImpulse, ManifoldSource};
use super::targets::Targets;
use super::walk::BlocksMut;
use crate::batch::{BatchRange, Sizes};
use crate::certificate::{Certificate, CertificateScratch};
use crate::color::{Coloring, Placement, Reuse};
use crate::island::Islands;
use crate::lanes::{Lanes, WIDTH};
use crate::thread_pool::{DisjointSlice, Divide, ThreadPool, chunks_with_parts};
use crate::{Contact, InverseMass, Manifold, Repair, SurfaceEffects, System, Velocity};

/// Blocks of a strip that are taken in one after the other, at least, and one of each color: what is read for
/// them stays in the first cache.
const STRIP: usize = 32;

/// A system of `f32` contacts, packed into lanes of type `V`.
#[derive(Clone, Debug)]
pub struct Packed<V: Lanes, const L: usize, const A: usize> {
    blocks: Vec<Block<V, L, A>>,
    contacts: Vec<Contact<V, L>>,
    /// Of each block; none where no surface runs or resists rolling.
    surfaces: Vec<SurfaceEffects<V, L, A>>,
    coloring: Coloring,
    extents: Vec<BatchRange>,
    conjugate: Conjugate<V, L, A>,
    /// The softness of its points; `None` if they have to be taken in anew.
    softness: Option<f32>,
    pool: Arc<ThreadPool>,
    passes: &'static dyn Passes<V, L, A>,
}

impl<V: Lanes, const L: usize, const A: usize> Default for Packed<V, L, A> {
    fn default() -> Self {
        Self::new()
    }
}

impl<V: Lanes, const L: usize, const A: usize> Packed<V, L, A> {
    /// An empty one.
    pub fn new() -> Self {
        Self {
            blocks: Vec::new(),
            contacts: Vec::new(),
            surfaces: Vec::new(),
            coloring: Coloring::default(),
            extents: Vec::new(),
            conjugate: Conjugate::default(),
            softness: None,
            pool: Arc::default(),
            passes: passes(),
        }
    }

    /// Lets a pool work on it; results do not depend on it.
    pub fn set_pool(&mut self, pool: Arc<ThreadPool>) {
        self.pool = pool;
    }

    /// Takes manifolds in between bodies of these masses, and finds the effective masses of their
    /// points ([`Contact::prepare`]). Leaves those alone that are [kept](Reuse::Kept).
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
        let sizes = Sizes {
            body: 8 * size_of::<Velocity<f32, L, A>>(),
            manifold: size_of::<Block<V, L, A>>() / WIDTH,
            point: size_of::<Contact<V, L>>() / WIDTH,
        };
        let bodies = (0..masses.len() as u32).map(|body| [moves(body), joins(body)]);
        let reuse = |of| if again { rows.reuse(of) } else { Reuse::New };
        let same_bodies = coloring.take_bodies(bodies);
        let placed = if again && rows.same_keys() && same_bodies && coloring.division.rests() {
            Placement::Same
        } else {
            let taken = coloring.take(rows.count(), |of| rows.key(of), reuse, pool);
            coloring.update(sizes, reuse, taken, pool)
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
        let whole = self.whole(&mut []);
        let (pool, runs) = (whole.pool, whole.runs());
        pool.for_each(runs > 1, whole.divide(runs), |mut run| {
            let Batch { coloring, passes, .. } = run;
            // A batch stays in the cache as it is.
            let blocks = if run.count() > 1 { 0 } else { run.size() };
            let strips = (blocks / STRIP.max(coloring.colors.len())).max(1);
            BlocksMut::new(&mut run).each(
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
                        passes.prepare(block, points, softness);
                    }
                },
            );
        });
    }

    /// All bodies and manifolds as one, to be split into what can be solved through all substeps, one after
    /// the other ([`ManifoldSource::stands`]). [`Batch::trace`] writes to `traces`, as many as there are points; without
    /// it they can be none.
    pub fn whole<'a>(&'a mut self, traces: &'a mut [CachedImpulse<L>]) -> Batch<'a, V, L, A> {
        let Self { extents, blocks, contacts, surfaces, coloring, pool, passes, .. } = self;
        let (traces, surfaces) = (DisjointSlice::new(0, traces), DisjointSlice::new(0, surfaces));
        Batch::new(extents, blocks, contacts, (coloring, traces, surfaces), (pool, *passes))
    }

    /// Takes in what the surfaces of each manifold do, by its number and itself without its points. Nothing, until
    /// this is called again, where there are none.
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

    /// Gives each manifold without its points, and what its surfaces have come to; nothing where none do anything.
    pub fn give_surfaces(&self, mut to: impl FnMut(&Manifold<f32, L>, &SurfaceEffects<f32, L, A>)) {
        if !self.surfaces.is_empty() {
            for ([block, lane], manifold) in seats(&self.coloring, &self.blocks) {
                to(&manifold, &self.surfaces[block].get(lane));
            }
        }
    }

    /// Gives `system` the manifolds and contacts as they are now.
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

    /// [`System::set_targets`]; `turning` are the velocities at which the substep will move bodies, if
    /// any turns ([`kinematics`](crate::kinematics)).
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

    fn view(&self) -> View<'_, V, L, A> {
        let Self { blocks, contacts, coloring, pool, .. } = self;
        View { blocks, contacts, coloring, pool }
    }

    /// Has [`Packed::conjugate`] begin anew, without directions.
    pub fn begin_conjugate(&mut self) {
        self.conjugate.begin(self.blocks.len(), self.contacts.len());
    }

    /// One iteration of [`nncg`](crate::nncg) over the islands that are not `done`.
    pub fn conjugate(&mut self, velocities: &mut [Velocity<f32, L, A>], done: &[bool]) {
        let mut state = std::mem::take(&mut self.conjugate);
        let passes = self.passes;
        passes.conjugate(&mut state, &mut self.whole(&mut []), velocities, done);
        self.conjugate = state;
    }

    /// |g|^2 of each island in the last iteration; 0 where it was done. \[J\]
    pub fn gradients(&self) -> &[f32] {
        self.conjugate.sizes()
    }

    /// The certificate of each island ([`certificate`](crate::certificate)), in `f64`, with the
    /// masses that `scratch` was given; with `RESIDUALS` or G alone, for the best impulses on the `LINE`
    /// or those at hand.
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

    /// Has all be taken in anew by the next [`Packed::pack`].
    pub fn forget(&mut self) {
        self.softness = None;
    }

    /// Takes over the impulses of collisions from the contacts of `system`. The next [`Packed::pack`] takes
    /// all in anew.
    pub fn take_impacts(&mut self, system: &System<f32, L, A>) {
        self.forget();
        self.copy_in(system, |wide, lane, contact| wide.impact.set(lane, contact.impact));
    }

    /// Takes over the impulses from the contacts of `system`.
    pub fn take_impulses(&mut self, system: &System<f32, L, A>) {
        self.copy_in(system, |wide, lane, contact| set(&mut wide.impulse, lane, &contact.impulse));
    }

    /// `copy` for each contact of `system` and its lane.
    fn copy_in(
        &mut self,
        system: &System<f32, L, A>,
        copy: impl Fn(&mut Contact<V, L>, usize, &Contact<f32, L>),
    ) {
        for (manifold, &place) in system.manifolds.iter().zip(&self.coloring.places) {
            let (block, lane) = (place as usize / WIDTH, place as usize % WIDTH);
            let wide = &mut self.contacts[self.blocks[block].manifold.points()];
            for (contact, wide) in system.contacts[manifold.points()].iter().zip(wide) {
                copy(wide, lane, contact);
            }
        }
    }

    /// [`System::residual`] of rigid contacts between bodies that move so. \[m/s\]
    pub fn residual(&self, velocities: &[Velocity<f32, L, A>]) -> f32 {
        self.passes.residual(self.view(), velocities)
    }

    /// How far the deepest contact overlaps; 0 if none does. \[m\]
    pub fn overlap(&self) -> f32 {
        self.passes.overlap(self.view())
    }

    /// Tells each manifold which island it belongs to.
    pub fn set_islands(&mut self, islands: &Islands) {
        self.conjugate.set_islands(islands);
        for block in self.blocks.iter_mut().filter(|block| block.used != 0) {
            block.islands = block.pairs().map(|bodies| islands.of_pair(bodies));
        }
    }
}

/// Block and lane of each manifold, and itself without its points.
fn seats<'a, V: Lanes, const L: usize, const A: usize>(
    coloring: &'a Coloring,
    blocks: &'a [Block<V, L, A>],
) -> impl Iterator<Item = ([usize; 2], Manifold<f32, L>)> + 'a {
    coloring.places.iter().enumerate().map(|(index, &place)| {
        let (block, lane) = (place as usize / WIDTH, place as usize % WIDTH);
        let bodies = coloring.key(index as u32).bodies;
        ([block, lane], blocks[block].manifold_in(lane, bodies))
    })
}
