//! [`nncg`](crate::nncg) on packed systems, island by island.

use super::Packed;
use super::block::splat;
use super::walk::Ground;
use crate::island::{Islands, NONE};
use crate::lanes::{Lanes, WIDTH};
use crate::team::Shared;
use crate::{Vector, Velocity, nncg};

/// Bodies that are worth as much as the least that is shared.
const PIECE: usize = 256;

/// What conjugate gradients keep from iteration to iteration.
#[derive(Clone, Debug, Default)]
pub(super) struct Conjugate<V: Lanes, const L: usize, const A: usize> {
    /// Of each point: impulses before the sweep, and directions.
    before: Vec<Vector<V, L>>,
    direction: Vec<Vector<V, L>>,
    /// Of each body: the velocities that go with them.
    velocities: Vec<Velocity<f32, L, A>>,
    ways: Vec<Velocity<f32, L, A>>,
    /// |g|^2 of each block.
    gradients: Vec<V>,
    /// The island of each body.
    of_body: Vec<u32>,
    /// Of each island: |g|^2 of this iteration and of the one before, and beta.
    sizes: Vec<f32>,
    sizes_before: Vec<f32>,
    betas: Vec<f32>,
}

impl<V: Lanes, const L: usize, const A: usize> Conjugate<V, L, A> {
    pub(super) fn set_islands(&mut self, islands: &Islands) {
        self.of_body.clone_from(&islands.of_body);
        // One more for what belongs to no island.
        for of_islands in [&mut self.sizes, &mut self.sizes_before, &mut self.betas] {
            of_islands.resize(islands.count + 1, 0.0);
        }
    }
}

impl<V: Lanes, const L: usize, const A: usize> Conjugate<V, L, A> {
    /// |g|^2 of each island.
    pub(super) fn sizes(&self) -> &[f32] {
        let islands = self.sizes.len().saturating_sub(1);
        &self.sizes[..islands]
    }
}

/// What there is of an island; the last belongs to none.
#[inline(always)]
fn of(island: u32, all: &[f32]) -> f32 {
    all[(island as usize).min(all.len() - 1)]
}

impl<V: Lanes, const L: usize, const A: usize> Packed<V, L, A> {
    /// Forgets the directions of the last system.
    pub fn begin_conjugate(&mut self) {
        let state = &mut self.conjugate;
        state.before.resize(self.contacts.len(), Vector::ZERO);
        state.direction.resize(self.contacts.len(), Vector::ZERO);
        state.gradients.resize(self.blocks.len(), V::ZERO);
        state.velocities.resize(state.of_body.len(), Velocity::ZERO);
        state.ways.resize(state.of_body.len(), Velocity::ZERO);
        state.sizes_before.fill(f32::INFINITY);
        // With which all directions begin at 0.
        state.betas.fill(0.0);
    }

    /// beta of each island, from the gradients of its blocks, always in the same order.
    #[inline(always)]
    fn find_betas(&mut self, done: &[bool]) {
        let state = &mut self.conjugate;
        state.sizes.fill(0.0);
        let last = state.sizes.len() - 1;
        // Blocks of one island that follow each other are summed side by side.
        let (mut island, mut sum) = (NONE, V::ZERO);
        let of = |island: u32| (island as usize).min(last);
        let total = |of: V| (0..WIDTH).map(|lane| of.get(lane)).sum::<f32>();
        for (block, size) in self.blocks.iter().zip(&state.gradients) {
            match block.island() {
                _ if block.is_done(done) => {}
                Some(own) if own == island => sum += *size,
                Some(own) => {
                    state.sizes[of(island)] += total(std::mem::replace(&mut sum, *size));
                    island = own;
                }
                None => {
                    for (lane, &own) in block.islands.iter().enumerate() {
                        state.sizes[of(own)] += size.get(lane);
                    }
                }
            }
        }
        state.sizes[of(island)] += total(sum);
        let sizes = state.sizes.iter().zip(&mut state.sizes_before);
        for (beta, (&size, before)) in state.betas.iter_mut().zip(sizes) {
            *beta = nncg::beta_of(size, before);
        }
        // What has no island has no direction.
        state.betas[last] = 0.0;
    }
}

/// One iteration over the islands that are not `done`.
pub(super) fn iterate<V: Lanes, const L: usize, const A: usize>(
    packed: &mut Packed<V, L, A>,
    velocities: &mut [Velocity<f32, L, A>],
    done: &[bool],
) {
    let mut state = std::mem::take(&mut packed.conjugate);
    // Bodies of what is done must not go on: most of its contacts do not.
    let of_done = state.betas.iter_mut().zip(done).filter(|(_, done)| **done);
    of_done.for_each(|(beta, _)| *beta = 0.0);
    let betas = &state.betas;
    let mut whole = packed.whole(&mut []);
    let team = whole.team;
    // v <- v + beta M^-1 J^T p, of what the bodies know of the last sweep.
    let (useful, share) = team.share(velocities.len(), PIECE);
    let bodies = velocities.chunks_mut(share).zip(state.of_body.chunks(share));
    let bodies = bodies.zip(state.velocities.chunks_mut(share).zip(state.ways.chunks_mut(share)));
    team.for_each(useful, bodies, |((velocities, islands), (before, ways))| {
        V::run(
            #[inline(always)]
            || {
                let known = before.iter_mut().zip(ways);
                for ((velocity, &island), (before, way)) in
                    velocities.iter_mut().zip(islands).zip(known)
                {
                    let beta = of(island, betas);
                    *way = nncg::next_way(velocity, before, way, beta);
                    // Not read back: memory written in parts and read as a whole is waited for.
                    let moved = *velocity + *way * beta;
                    (*velocity, *before) = (moved, moved);
                }
            },
        );
    });
    let useful = team.is_useful(whole.size());
    let ground = Ground::new(&mut whole, velocities);
    let before = Shared::new(0, &mut state.before);
    let direction = Shared::new(0, &mut state.direction);
    let gradients = Shared::new(0, &mut state.gradients);
    team.run(useful, &|member| {
        V::run(
            #[inline(always)]
            || {
                for mut at in ground.walk(member) {
                    let block = at.block;
                    if block.is_done(done) {
                        continue;
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
                    at.visit::<false, true>(points);
                    let mut size = V::ZERO;
                    for (contact, before) in points.iter().zip(before) {
                        size += nncg::size(contact, *before);
                    }
                    at.of_block(&gradients)[0] = size;
                }
            },
        );
    });
    packed.conjugate = state;
    V::run(
        #[inline(always)]
        || packed.find_betas(done),
    );
}
