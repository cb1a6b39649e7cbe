//! Passes over a packed system, block by block.
//!
//! They are most of the code to compile, and they are hard to optimize. So they are compiled once,
//! with this crate, for all lanes and bodies. Users of a packed system call them through
//! [`Passes`].

use std::any::Any;
use std::sync::atomic::{AtomicBool, Ordering};

use super::batch::{Batch, Passes, Velocities, View};
use super::block::{Block, splat};
use super::conjugate::{Conjugate, of};
use super::targets::{Landing, MovedBodies, Targets, land, renew};
use super::walk::{BlockSweep, BlocksMut, ReadSweep};
use crate::certificate::{Certificate, CertificateScratch, ManifoldTerms};
use crate::contact::{RIGID, RIGID_APART, SOFT};
use crate::island::Islands;
#[cfg(target_arch = "x86_64")]
use crate::lanes::Avx2;
use crate::lanes::{Lanes, PART, Portable, WIDTH, lanes_of};
use crate::thread_pool::DisjointSlice;
use crate::{Contact, SurfaceEffects, Velocity, nncg};

/// Grain size of the pass over the bodies in a certificate.
const CERTIFICATE_GRAIN: usize = 16;

/// Grain size of the pass over the bodies in an iteration of conjugate gradients.
const CONJUGATE_GRAIN: usize = 256;

/// References to `&dyn Passes<V, L, A>`, one for each kind of bodies.
type Table = [&'static dyn Any; 4];

/// Makes the [`Table`] of a type of lanes. The function that contains it must be neither generic
/// nor inlined, since the passes are compiled there.
macro_rules! table {
    ($lanes:ty) => {
        [
            &(&Compiled as &'static dyn Passes<$lanes, 2, 0>),
            &(&Compiled as &'static dyn Passes<$lanes, 3, 0>),
            &(&Compiled as &'static dyn Passes<$lanes, 2, 1>),
            &(&Compiled as &'static dyn Passes<$lanes, 3, 3>),
        ]
    };
}

#[inline(never)]
fn portable() -> Table {
    table!(Portable)
}

#[cfg(target_arch = "x86_64")]
#[inline(never)]
fn avx2() -> Table {
    table!(Avx2)
}

/// Returns the passes for these lanes and bodies.
///
/// # Panics
/// The lanes are unknown, or the bodies are neither particles nor rigid bodies in two or three
/// dimensions.
pub(super) fn passes<V: Lanes, const L: usize, const A: usize>() -> &'static dyn Passes<V, L, A> {
    let tables = [
        portable(),
        #[cfg(target_arch = "x86_64")]
        avx2(),
    ];
    let mut all = tables.into_iter().flatten();
    let own = all.find_map(|of| of.downcast_ref::<&dyn Passes<V, L, A>>());
    *own.expect("particles or rigid bodies, of two dimensions or three")
}

#[derive(Debug)]
struct Compiled;

impl<V: Lanes, const L: usize, const A: usize> Passes<V, L, A> for Compiled {
    fn prepare(&self, block: &mut Block<V, L, A>, points: &mut [Contact<V, L>], softness: f32) {
        V::run(
            #[inline(always)]
            || block.prepare(points, splat(softness)),
        );
    }

    fn apply_impulses(&self, batch: &mut Batch<'_, V, L, A>, velocities: &mut Velocities<L, A>) {
        BlockSweep::new(batch, velocities).each(
            #[inline(always)]
            |mut at| {
                let mut wrench = Velocity::ZERO;
                for contact in at.points() {
                    contact.add_wrench(0..L, contact.impulse, &mut wrench);
                }
                let [mut a, mut b] = at.gather();
                at.between();
                at.block.manifold.apply(&wrench, &at.block.masses, &mut a, &mut b);
                at.scatter([a, b]);
            },
        );
    }

    fn set_targets(
        &self,
        batch: &mut Batch<'_, V, L, A>,
        targets: &Targets<'_, V, L, A>,
        velocities: &Velocities<L, A>,
    ) {
        let first = batch.bodies.start;
        BlocksMut::new(batch).each(
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
        batch: &mut Batch<'_, V, L, A>,
        velocities: &mut Velocities<L, A>,
        targets: Option<&Targets<'_, V, L, A>>,
    ) {
        visit_all::<V, L, A, RIGID_APART, false>(batch, velocities, targets);
    }

    fn sweep(&self, batch: &mut Batch<'_, V, L, A>, velocities: &mut Velocities<L, A>) {
        visit_all::<V, L, A, SOFT, true>(batch, velocities, None);
    }

    fn relax(
        &self,
        batch: &mut Batch<'_, V, L, A>,
        velocities: &mut Velocities<L, A>,
        renewed: bool,
        landing: Option<Landing<'_, L, A>>,
    ) {
        let first = batch.bodies.start;
        BlockSweep::new(batch, velocities).each(
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
        batch: &mut Batch<'_, V, L, A>,
        bodies: MovedBodies<'_, L, A>,
        terms: [f32; 2],
    ) -> bool {
        let first = batch.bodies.start;
        let any = AtomicBool::new(false);
        BlocksMut::new(batch).each(
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

    fn run_belts(&self, batch: &mut Batch<'_, V, L, A>, [target, time]: [f32; 2]) {
        let field = BlocksMut::new(batch);
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

    fn apply_resistance(&self, batch: &mut Batch<'_, V, L, A>, velocities: &mut Velocities<L, A>) {
        let surfaces = batch.surfaces;
        BlockSweep::new(batch, velocities).each(
            #[inline(always)]
            |at| {
                let wrench = SurfaceEffects::wrench(at.of_block(&surfaces)[0].torque);
                let [mut a, mut b] = at.gather();
                at.between();
                at.block.manifold.apply(&wrench, &at.block.masses, &mut a, &mut b);
                at.scatter([a, b]);
            },
        );
    }

    fn resist(&self, batch: &mut Batch<'_, V, L, A>, velocities: &mut Velocities<L, A>) {
        let surfaces = batch.surfaces;
        BlockSweep::new(batch, velocities).each(
            #[inline(always)]
            |mut at| {
                let mut pressed = V::ZERO;
                for contact in at.points() {
                    pressed += contact.impulse[0];
                }
                let [mut a, mut b] = at.gather();
                at.between();
                let (surface, block) = (&mut at.of_block(&surfaces)[0], at.block);
                surface.resist(&block.manifold, &block.masses, pressed, [&mut a, &mut b]);
                at.scatter([a, b]);
            },
        );
    }

    fn conjugate(
        &self,
        state: &mut Conjugate<V, L, A>,
        batch: &mut Batch<'_, V, L, A>,
        velocities: &mut Velocities<L, A>,
        done: &[bool],
    ) {
        iterate(state, batch, velocities, done);
    }

    fn certify<'a>(
        &self,
        all: View<'_, V, L, A>,
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

    fn residual(&self, all: View<'_, V, L, A>, velocities: &Velocities<L, A>) -> f32 {
        worst(
            all,
            #[inline(always)]
            |block, points| {
                let [a, b] = block.gather_from(0, velocities);
                let twist = block.manifold.twist(&a, &b);
                let own = points.iter().map(
                    #[inline(always)]
                    |point| point.residual::<A, RIGID>(block.manifold.friction, &twist),
                );
                own.fold(V::ZERO, |worst, own| own.max(worst))
            },
        )
    }

    fn overlap(&self, all: View<'_, V, L, A>) -> f32 {
        worst(
            all,
            #[inline(always)]
            |_, points| {
                let own = points.iter().map(|point| -point.gap[0]);
                own.fold(V::ZERO, |worst, own| own.max(worst))
            },
        )
    }

    fn trace(&self, batch: &mut Batch<'_, V, L, A>, displacements: &Velocities<L, A>, hold: f32) {
        let first = batch.bodies.start;
        assert_eq!(batch.traces.len(), batch.coloring.all_points(), "a trace for each point");
        let field = BlocksMut::new(batch);
        field.each(
            1,
            #[inline(always)]
            |index, block, points| {
                if block.used == 0 {
                    return;
                }
                let manifold = &block.manifold;
                let [moved_a, moved_b] = block.gather_from(first, displacements);
                let moved = manifold.twist(&moved_a, &moved_b);
                let points = points[..manifold.count as usize].iter_mut();
                for (point, contact) in points.enumerate() {
                    let gap = contact.gap + contact.relative_velocity(&moved);
                    contact.gap = contact.held_slip(manifold.friction, splat(hold), gap);
                    field.trace(index, point, contact);
                }
            },
        );
    }
}

/// Returns the largest value of any block. Absent points do not count.
#[inline(always)]
fn worst<V: Lanes, const L: usize, const A: usize>(
    all: View<'_, V, L, A>,
    of: impl Fn(&Block<V, L, A>, &[Contact<V, L>]) -> V,
) -> f32 {
    let mut worst = V::ZERO;
    V::run(
        #[inline(always)]
        || {
            for block in all.blocks.iter().filter(|block| block.used != 0) {
                // With the arguments in this order, NaN is ignored.
                worst = of(block, &all.contacts[block.manifold.points()]).max(worst);
            }
        },
    );
    (0..WIDTH).map(|lane| worst.get(lane)).fold(0.0, f32::max)
}

fn visit_all<V: Lanes, const L: usize, const A: usize, const LAW: u8, const FRICTION: bool>(
    batch: &mut Batch<'_, V, L, A>,
    velocities: &mut Velocities<L, A>,
    targets: Option<&Targets<'_, V, L, A>>,
) {
    let ground =
        BlockSweep::new(batch, velocities).and(targets.map(|targets| targets.displacements));
    ground.each(
        #[inline(always)]
        |mut at| {
            let points = at.points();
            if let Some(targets) = targets {
                let moving = if targets.turning { Some(at.gather()) } else { None };
                targets.set(at.block, points, moving);
            }
            at.visit::<LAW, FRICTION>(points, false);
        },
    );
}

/// Runs one iteration over the islands that are not `done`.
fn iterate<V: Lanes, const L: usize, const A: usize>(
    state: &mut Conjugate<V, L, A>,
    batch: &mut Batch<'_, V, L, A>,
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
    let before = DisjointSlice::new(0, &mut state.before);
    let direction = DisjointSlice::new(0, &mut state.direction);
    let gradients = DisjointSlice::new(0, &mut state.gradients);
    BlockSweep::new(batch, velocities).each(
        #[inline(always)]
        |mut at| {
            let block = at.block;
            if block.is_done(done) {
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
            at.visit::<SOFT, true>(points, false);
            let mut size = V::ZERO;
            for (contact, before) in points.iter().zip(before) {
                size += nncg::size(contact, *before);
            }
            at.of_block(&gradients)[0] = size;
        },
    );
    V::run(
        #[inline(always)]
        || state.find_betas(batch.blocks, done),
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
    all: View<'_, V, L, A>,
    [velocities, prospective]: [&Velocities<L, A>; 2],
    islands: &Islands,
    scratch: &'a mut CertificateScratch<L, A>,
) -> &'a [Certificate] {
    let View { blocks, pool, .. } = all;
    let (momenta, residuals_of) = scratch.start(islands.count, WIDTH * blocks.len());
    let (momenta, residuals_of) =
        (DisjointSlice::new(0, momenta), DisjointSlice::new(0, residuals_of));
    ReadSweep::new(all, velocities).each(
        #[inline(always)]
        |mut at| {
            let (block, moving, residuals_of) =
                (at.block(), at.gather(), at.of_lanes(&residuals_of));
            let points = &all.contacts[block.manifold.points()];
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
