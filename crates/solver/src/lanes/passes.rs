//! Passes over a packed system, block by block: the methods of [`LaneBatch`].
//!
//! They are most of the code to compile, and they are hard to optimize. So they are compiled once,
//! with this crate, for all [`Instructions`] and bodies, and called through [`Passes`].

use std::any::Any;
use std::marker::PhantomData;
use std::sync::atomic::{AtomicBool, Ordering};

use super::batch::{LaneBatch, Passes, Velocities, View};
use super::block::{Block, splat};
use super::conjugate::{Conjugate, of};
use super::motion::{Landing, MovedBodies, Targets, land, renew};
use super::sweep::{BlockSweep, BlocksMut, ReadSweep};
use super::view::{view_all, view_all_mut, view_mut};
use super::{Lanes, PART, Portable, WIDTH, lanes_of};
use crate::certificate::{Certificate, CertificateScratch, ManifoldTerms};
use crate::contact::{RIGID, RIGID_APART, SOFT};
use crate::island::{Islands, NONE};
use crate::thread_pool::DisjointSlice;
use crate::{Contact, Repair, SurfaceEffects, Vector, Velocity, nncg};

/// Points of a manifold that keep their impulses where it is not due; a manifold with more of them is swept
/// with its neighbors.
const MOST_POINTS: usize = 8;

/// Grain size of the pass over the bodies in a certificate.
const CERTIFICATE_GRAIN: usize = 16;

/// Grain size of the pass over the bodies in an iteration of conjugate gradients.
const CONJUGATE_GRAIN: usize = 256;

impl<const L: usize, const A: usize> LaneBatch<'_, L, A> {
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

    /// Sweeps once over the normals of those contacts which touch one of these `bodies` of the batch. The
    /// others do not change by a bit.
    pub fn sweep_normals_of(&mut self, velocities: &mut [Velocity<f32, L, A>], bodies: &[bool]) {
        self.passes.sweep_normals_of(self, velocities, bodies);
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
    /// ([`LaneSystem::take_surfaces`]).
    ///
    /// [`LaneSystem::take_surfaces`]: super::LaneSystem::take_surfaces
    pub fn has_surfaces(&self) -> bool {
        self.surfaces.len() > 0
    }

    /// Adds the velocities of belts to targets that have just been set. The belts have run for
    /// `elapsed` \[s\] since gaps were measured. `stick_rate` is that of [`Repair`].
    pub fn run_belts(&mut self, elapsed: f32, stick_rate: f32) {
        self.passes.run_belts(self, [1.0 + stick_rate * elapsed, 0.0]);
    }

    /// Adds the motion of belts that have run for `elapsed` \[s\] to the slips, before these are
    /// [traced](LaneBatch::trace).
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
    /// [`LaneSystem::whole`](super::LaneSystem::whole). `stick_rate` is that of [`Repair`].
    pub fn trace(&mut self, displacements: &[Velocity<f32, L, A>], stick_rate: f32) {
        self.passes.trace(self, displacements, stick_rate);
    }
}

/// Instructions with which passes compute. Results do not depend on them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Instructions {
    /// Instructions of any machine.
    Portable,
    /// AVX2, if the machine has it.
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Instructions {
    /// Returns the instructions of this machine, the fastest last.
    pub fn available() -> Vec<Self> {
        let all = [
            Some(Self::Portable),
            #[cfg(target_arch = "x86_64")]
            crate::registers::has_avx2().then_some(Self::Avx2),
        ];
        all.into_iter().flatten().collect()
    }
}

/// Evaluates an expression with `$lanes` as the type of lanes for these [`Instructions`].
macro_rules! in_lanes {
    ($instructions:expr, $lanes:ident => $do:expr) => {
        match $instructions {
            Instructions::Portable => {
                type $lanes = Portable;
                $do
            }
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => {
                type $lanes = super::Avx2;
                $do
            }
        }
    };
}

pub(super) use in_lanes;

/// Returns references to `&dyn Passes<L, A>`, one for each kind of bodies.
#[inline(never)]
fn compiled(instructions: Instructions) -> [&'static dyn Any; 4] {
    in_lanes!(instructions, V => [
        &(&Compiled::<V>(PhantomData) as &'static dyn Passes<2, 0>),
        &(&Compiled::<V>(PhantomData) as &'static dyn Passes<3, 0>),
        &(&Compiled::<V>(PhantomData) as &'static dyn Passes<2, 1>),
        &(&Compiled::<V>(PhantomData) as &'static dyn Passes<3, 3>),
    ])
}

/// Returns the passes for these bodies.
///
/// # Panics
/// The bodies are neither particles nor rigid bodies in two or three dimensions.
pub(super) fn passes<const L: usize, const A: usize>(
    instructions: Instructions,
) -> &'static dyn Passes<L, A> {
    let mut all = compiled(instructions).into_iter();
    let own = all.find_map(|of| of.downcast_ref::<&dyn Passes<L, A>>());
    *own.expect("particles or rigid bodies, of two dimensions or three")
}

/// Passes in lanes of type `V`.
#[derive(Debug)]
struct Compiled<V>(PhantomData<V>);

impl<V: Lanes, const L: usize, const A: usize> Passes<L, A> for Compiled<V> {
    fn prepare(
        &self,
        block: &mut Block<Portable, L, A>,
        points: &mut [Contact<Portable, L>],
        softness: f32,
    ) {
        V::run(
            #[inline(always)]
            || view_mut::<V, _>(block).prepare(view_all_mut(points), splat(softness)),
        );
    }

    fn apply_impulses(&self, batch: &mut LaneBatch<'_, L, A>, velocities: &mut Velocities<L, A>) {
        BlockSweep::<V, L, A>::new(batch, velocities).each(
            #[inline(always)]
            |mut at| {
                let mut wrench = Velocity::ZERO;
                for contact in at.points() {
                    contact.add_wrench(0..L, contact.impulse, &mut wrench);
                }
                let [mut a, mut b] = at.gather();
                at.between();
                at.block.manifold.frame.apply(&wrench, &at.block.masses, &mut a, &mut b);
                at.scatter([a, b]);
            },
        );
    }

    fn set_targets(
        &self,
        batch: &mut LaneBatch<'_, L, A>,
        targets: &Targets<'_, f32, L, A>,
        velocities: &Velocities<L, A>,
    ) {
        let (first, targets) = (batch.bodies.start, targets.in_lanes::<V>());
        BlocksMut::<V, L, A>::new(batch).each(
            1,
            #[inline(always)]
            |_, block, points| {
                let moving =
                    if targets.turning { Some(block.gather_from(first, velocities)) } else { None };
                targets.set(block, &mut points[..block.manifold.count as usize], moving);
            },
        );
    }

    fn sweep_normals(
        &self,
        batch: &mut LaneBatch<'_, L, A>,
        velocities: &mut Velocities<L, A>,
        targets: Option<&Targets<'_, f32, L, A>>,
    ) {
        let targets = targets.map(Targets::in_lanes::<V>);
        let also = targets.as_ref().map(|targets| targets.displacements);
        BlockSweep::<V, L, A>::new(batch, velocities).and(also).each(
            #[inline(always)]
            |mut at| {
                let points = at.points();
                if let Some(targets) = &targets {
                    let moving = if targets.turning { Some(at.gather()) } else { None };
                    targets.set(at.block, points, moving);
                }
                at.visit::<RIGID_APART, false>(points, false);
            },
        );
    }

    fn sweep_normals_of(
        &self,
        batch: &mut LaneBatch<'_, L, A>,
        velocities: &mut Velocities<L, A>,
        bodies: &[bool],
    ) {
        let first = batch.bodies.start;
        let is_due = |body: u32| bodies.get((body as usize).wrapping_sub(first)) == Some(&true);
        BlockSweep::<V, L, A>::new(batch, velocities).each(
            #[inline(always)]
            |mut at| {
                let [a, b] = at.block.bodies;
                let is_due = |lane: usize| is_due(a[lane]) || is_due(b[lane]);
                let due = (0..WIDTH).fold(0, |all, lane| all | u16::from(is_due(lane)) << lane);
                if due == 0 {
                    return;
                }
                let points = at.points();
                let due = if points.len() > MOST_POINTS { u16::MAX } else { due };
                let mut before = [Vector::ZERO; MOST_POINTS];
                for (kept, contact) in before.iter_mut().zip(&*points) {
                    *kept = contact.impulse;
                }
                at.visit_lanes::<RIGID_APART, false>((points, &before), due);
            },
        );
    }

    fn sweep(&self, batch: &mut LaneBatch<'_, L, A>, velocities: &mut Velocities<L, A>) {
        BlockSweep::<V, L, A>::new(batch, velocities).each(
            #[inline(always)]
            |mut at| {
                let points = at.points();
                at.visit::<SOFT, true>(points, false);
            },
        );
    }

    fn relax(
        &self,
        batch: &mut LaneBatch<'_, L, A>,
        velocities: &mut Velocities<L, A>,
        renewed: bool,
        landing: Option<Landing<'_, L, A>>,
    ) {
        let first = batch.bodies.start;
        BlockSweep::<V, L, A>::new(batch, velocities).each(
            #[inline(always)]
            |mut at| {
                let points = at.points();
                if let Some(landing) = &landing {
                    land(at.block, points, first, landing);
                }
                at.visit::<RIGID, true>(points, renewed);
            },
        );
    }

    fn renew(
        &self,
        batch: &mut LaneBatch<'_, L, A>,
        bodies: MovedBodies<'_, L, A>,
        terms: [f32; 2],
    ) -> bool {
        let first = batch.bodies.start;
        let any = AtomicBool::new(false);
        BlocksMut::<V, L, A>::new(batch).each(
            1,
            #[inline(always)]
            |_, block, points| {
                let count = block.manifold.count as usize;
                renew(block, &mut points[..count], first, bodies, terms.map(splat));
                if block.renewed {
                    any.store(true, Ordering::Relaxed);
                }
            },
        );
        any.into_inner()
    }

    fn run_belts(&self, batch: &mut LaneBatch<'_, L, A>, [target, time]: [f32; 2]) {
        let field = BlocksMut::<V, L, A>::new(batch);
        field.each(
            1,
            #[inline(always)]
            |index, block, points| {
                if block.used == 0 {
                    return;
                }
                let surface = field.surface(index);
                for contact in &mut points[..block.manifold.count as usize] {
                    surface.run(contact, splat(target), splat(time));
                }
            },
        );
    }

    fn apply_resistance(&self, batch: &mut LaneBatch<'_, L, A>, velocities: &mut Velocities<L, A>) {
        let surfaces = batch.surfaces;
        BlockSweep::<V, L, A>::new(batch, velocities).each(
            #[inline(always)]
            |at| {
                let surface = &view_all::<V, _>(at.of_block(&surfaces))[0];
                let wrench = SurfaceEffects::wrench(surface.torque);
                let [mut a, mut b] = at.gather();
                at.between();
                at.block.manifold.frame.apply(&wrench, &at.block.masses, &mut a, &mut b);
                at.scatter([a, b]);
            },
        );
    }

    fn resist(&self, batch: &mut LaneBatch<'_, L, A>, velocities: &mut Velocities<L, A>) {
        let surfaces = batch.surfaces;
        BlockSweep::<V, L, A>::new(batch, velocities).each(
            #[inline(always)]
            |mut at| {
                let mut pressed = V::ZERO;
                for contact in at.points() {
                    pressed += contact.impulse[0];
                }
                let [mut a, mut b] = at.gather();
                at.between();
                let block = at.block;
                let surface = &mut view_all_mut::<V, _>(at.of_block(&surfaces))[0];
                surface.resist(&block.manifold.frame, &block.masses, pressed, [&mut a, &mut b]);
                at.scatter([a, b]);
            },
        );
    }

    fn conjugate(
        &self,
        state: &mut Conjugate<L, A>,
        batch: &mut LaneBatch<'_, L, A>,
        velocities: &mut Velocities<L, A>,
        (done, rigid): (&[bool], bool),
    ) {
        if rigid {
            iterate::<V, L, A, RIGID>(state, batch, velocities, done);
        } else {
            iterate::<V, L, A, SOFT>(state, batch, velocities, done);
        }
    }

    fn certify<'a>(
        &self,
        all: View<'_, L, A>,
        which: [bool; 2],
        velocities: [&Velocities<L, A>; 2],
        islands: &Islands,
        scratch: &'a mut CertificateScratch<L, A>,
    ) -> &'a [Certificate] {
        match which {
            [false, false] => certify::<V, L, A, false, false>(all, velocities, islands, scratch),
            [false, true] => certify::<V, L, A, false, true>(all, velocities, islands, scratch),
            [true, false] => certify::<V, L, A, true, false>(all, velocities, islands, scratch),
            [true, true] => certify::<V, L, A, true, true>(all, velocities, islands, scratch),
        }
    }

    fn residual(&self, all: View<'_, L, A>, velocities: &Velocities<L, A>) -> f32 {
        worst::<V, L, A>(
            all,
            #[inline(always)]
            |block, points| {
                let [a, b] = block.gather_from(0, velocities);
                let twist = block.manifold.frame.twist(&a, &b);
                let own = points.iter().map(
                    #[inline(always)]
                    |point| point.residual::<A, RIGID>(block.manifold.friction, &twist),
                );
                own.fold(V::ZERO, |worst, own| own.max(worst))
            },
        )
    }

    fn overlap(&self, all: View<'_, L, A>) -> f32 {
        worst::<V, L, A>(
            all,
            #[inline(always)]
            |_, points| {
                let own = points.iter().map(|point| -point.gap[0]);
                own.fold(V::ZERO, |worst, own| own.max(worst))
            },
        )
    }

    fn trace(
        &self,
        batch: &mut LaneBatch<'_, L, A>,
        displacements: &Velocities<L, A>,
        stick_rate: f32,
    ) {
        let first = batch.bodies.start;
        assert_eq!(batch.traces.len(), batch.coloring.all_points(), "a trace for each point");
        let field = BlocksMut::<V, L, A>::new(batch);
        field.each(
            1,
            #[inline(always)]
            |index, block, points| {
                if block.used == 0 {
                    return;
                }
                let manifold = &block.manifold;
                let [moved_a, moved_b] = block.gather_from(first, displacements);
                let moved = manifold.frame.twist(&moved_a, &moved_b);
                let points = points[..manifold.count as usize].iter_mut();
                for (point, contact) in points.enumerate() {
                    let gap = contact.gap + contact.relative_velocity(&moved);
                    contact.gap = contact.held_slip(manifold.friction, splat(stick_rate), gap);
                    field.trace(index, point, contact);
                }
            },
        );
    }
}

/// Returns the largest value of any block. Absent points do not count.
#[inline(always)]
fn worst<V: Lanes, const L: usize, const A: usize>(
    all: View<'_, L, A>,
    of: impl Fn(&Block<V, L, A>, &[Contact<V, L>]) -> V,
) -> f32 {
    let mut worst = V::ZERO;
    V::run(
        #[inline(always)]
        || {
            let (blocks, contacts) = (view_all(all.blocks), view_all(all.contacts));
            for block in blocks.iter().filter(|block: &&Block<V, L, A>| block.used != 0) {
                // With the arguments in this order, NaN is ignored.
                worst = of(block, &contacts[block.manifold.points()]).max(worst);
            }
        },
    );
    (0..WIDTH).map(|lane| worst.get(lane)).fold(0.0, f32::max)
}

/// Runs one iteration over the islands that are not `done`.
fn iterate<V: Lanes, const L: usize, const A: usize, const LAW: u8>(
    state: &mut Conjugate<L, A>,
    batch: &mut LaneBatch<'_, L, A>,
    velocities: &mut [Velocity<f32, L, A>],
    done: &[bool],
) {
    // Bodies of islands that are done must stop, as most of their contacts do.
    let of_done = state.betas.iter_mut().zip(done).filter(|(_, done)| **done);
    of_done.for_each(|(beta, _)| *beta = 0.0);
    let betas = &state.betas;
    let pool = batch.pool;
    // v <- v + beta M^-1 J^T p, from the changes of the velocities in the last sweep.
    let (useful, share) = pool.share(velocities.len(), CONJUGATE_GRAIN);
    let bodies = velocities.chunks_mut(share).zip(state.of_body.chunks(share));
    let bodies = bodies.zip(state.velocities.chunks_mut(share).zip(state.ways.chunks_mut(share)));
    pool.for_each(useful, bodies, |((velocities, islands), (before, ways))| {
        V::run(
            #[inline(always)]
            || {
                let known = before.iter_mut().zip(ways);
                for ((velocity, &island), (before, way)) in
                    velocities.iter_mut().zip(islands).zip(known)
                {
                    let beta = of(island, betas);
                    *way = nncg::next_way(velocity, before, way, beta);
                    // The velocity is not read back: a wide load after narrower stores would stall.
                    let moved = *velocity + *way * beta;
                    (*velocity, *before) = (moved, moved);
                }
            },
        );
    });
    let before = DisjointSlice::new(0, view_all_mut::<V, _>(&mut state.before));
    let direction = DisjointSlice::new(0, view_all_mut::<V, _>(&mut state.direction));
    let gradients = DisjointSlice::new(0, view_all_mut::<V, _>(&mut state.gradients));
    BlockSweep::<V, L, A>::new(batch, velocities).each(
        #[inline(always)]
        |mut at| {
            let block = at.block;
            let due = block.due_lanes(done);
            if due == 0 {
                return;
            }
            let beta = match block.island() {
                Some(island) => splat(of(island, betas)),
                None => V::from_array(block.islands.map(|island| of(island, betas))),
            };
            // r <- r + beta p.
            let (points, before) = (at.points(), at.of_points(&before));
            let kept = before.iter_mut().zip(at.of_points(&direction));
            for (contact, (before, direction)) in points.iter_mut().zip(kept) {
                *direction = nncg::next_direction(contact, *before, *direction, beta);
                contact.impulse += *direction * beta;
                *before = contact.impulse;
            }
            at.visit_lanes::<LAW, true>((points, before), due);
            let mut size = V::ZERO;
            for (contact, before) in points.iter().zip(before) {
                size += nncg::size(contact, *before);
            }
            at.of_block(&gradients)[0] = size;
        },
    );
    V::run(
        #[inline(always)]
        || state.find_betas::<V>(batch.blocks, done),
    );
}

fn certify<
    'a,
    V: Lanes,
    const L: usize,
    const A: usize,
    const RESIDUALS: bool,
    const LINE: bool,
>(
    all: View<'_, L, A>,
    [velocities, prospective]: [&Velocities<L, A>; 2],
    islands: &Islands,
    scratch: &'a mut CertificateScratch<L, A>,
) -> &'a [Certificate] {
    let View { blocks, pool, .. } = all;
    let (momenta, residuals_of) = scratch.start(islands.count, WIDTH * blocks.len());
    let (momenta, residuals_of) =
        (DisjointSlice::new(0, momenta), DisjointSlice::new(0, residuals_of));
    ReadSweep::<V, L, A>::new(all, velocities).each(
        #[inline(always)]
        |mut at| {
            if at.block().islands.iter().all(|island| *island == NONE) {
                return;
            }
            let (block, moving, residuals_of) =
                (at.block(), at.gather(), at.of_lanes(&residuals_of));
            let points = &view_all(all.contacts)[block.manifold.points()];
            for part in 0..WIDTH / PART {
                let used = block.used >> (PART * part) & ((1 << PART) - 1);
                if used == 0 {
                    continue;
                }
                let terms: ManifoldTerms<V::Doubles, L, A> =
                    ManifoldTerms::of::<V, RESIDUALS, LINE>(part, &block.manifold, points, &moving);
                for lane in lanes_of(used << (PART * part)) {
                    let own = lane % PART;
                    terms.tell::<RESIDUALS, LINE>(own, &mut residuals_of[lane]);
                    for side in 0..2 {
                        if let Some(body) = at.of_body(&momenta, side, lane) {
                            terms.add_momenta::<LINE>(side, own, body);
                        }
                    }
                }
            }
        },
    );
    for (index, block) in blocks.iter().enumerate() {
        for lane in lanes_of(block.used) {
            scratch.add::<RESIDUALS, LINE>(block.islands[lane], WIDTH * index + lane);
        }
    }
    let (useful, share) = pool.share(velocities.len(), CERTIFICATE_GRAIN);
    pool.for_each(useful, scratch.bodies(share), |bodies| {
        V::run(
            #[inline(always)]
            || bodies.share::<f32, LINE>(velocities, prospective),
        );
    });
    scratch.finish::<LINE>(|body| islands.of_body[body])
}
