//! [`nncg`](crate::nncg) on packed systems, island by island.

use super::Packed;
use super::walk::Ground;
use crate::lanes::{Lanes, WIDTH, lanes_of};
use crate::pgs::visit;
use crate::team::Shared;
use crate::{Vector, Velocity, nncg};

/// What conjugate gradients keep from iteration to iteration.
#[derive(Clone, Debug, Default)]
pub(super) struct Conjugate<V: Lanes, const L: usize> {
    /// Impulses before the sweeps, and directions.
    before: Vec<Vector<V, L>>,
    direction: Vec<Vector<V, L>>,
    /// |g|^2 of each block.
    gradients: Vec<V>,
    /// Of each island: |g|^2 of this iteration and of the one before, and beta.
    sizes: Vec<f32>,
    sizes_before: Vec<f32>,
    betas: Vec<f32>,
}

impl<V: Lanes, const L: usize, const A: usize> Packed<V, L, A> {
    /// Forgets the directions of the last system.
    pub fn begin_conjugate(&mut self, islands: usize) {
        let state = &mut self.conjugate;
        state.before.resize(self.contacts.len(), Vector::ZERO);
        state.direction.resize(self.contacts.len(), Vector::ZERO);
        state.gradients.resize(self.blocks.len(), V::ZERO);
        for (sizes, value) in [
            (&mut state.sizes, 0.0),
            (&mut state.sizes_before, f32::INFINITY),
            (&mut state.betas, 0.0),
        ] {
            sizes.clear();
            sizes.resize(islands, value);
        }
        // Once more for what belongs to no island.
        state.betas.push(0.0);
        state.sizes.push(0.0);
        state.sizes_before.push(f32::INFINITY);
    }

    /// beta of each island, from the gradients of its blocks, always in the same order.
    fn find_betas(&mut self, done: &[bool]) {
        let state = &mut self.conjugate;
        state.sizes.fill(0.0);
        let last = state.sizes.len() - 1;
        for (block, size) in self.blocks.iter().zip(&state.gradients).rev() {
            if !block.is_done(done) {
                for lane in lanes_of(block.used) {
                    state.sizes[(block.islands[lane] as usize).min(last)] += size.get(lane);
                }
            }
        }
        let sizes = state.sizes.iter().zip(&mut state.sizes_before);
        for (beta, (&size, before)) in state.betas.iter_mut().zip(sizes) {
            *beta = nncg::beta_of(size, before);
        }
    }
}

/// One iteration over the islands that are not `done`.
pub(super) fn iterate<V: Lanes, const L: usize, const A: usize>(
    packed: &mut Packed<V, L, A>,
    velocities: &mut [Velocity<f32, L, A>],
    done: &[bool],
) {
    let mut state = std::mem::take(&mut packed.conjugate);
    let mut whole = packed.whole(&mut []);
    let (team, useful) = (whole.team, whole.team.is_useful(whole.size()));
    let ground = Ground::new(&mut whole, velocities);
    let before = Shared::new(0, &mut state.before);
    let direction = Shared::new(0, &mut state.direction);
    let gradients = Shared::new(0, &mut state.gradients);
    let betas = &state.betas;
    team.run(useful, &|member| {
        V::run(
            #[inline(always)]
            || {
                // r <- r + beta p with p <- beta p - g, and the velocities that go with it.
                for mut at in ground.walk(member) {
                    let (block, manifold) = (at.block, &at.block.manifold);
                    if block.is_done(done) {
                        continue;
                    }
                    let mut own = [0.0; WIDTH];
                    for (own, &island) in own.iter_mut().zip(&block.islands) {
                        *own = betas[(island as usize).min(betas.len() - 1)];
                    }
                    let beta = V::from_array(own);
                    let mut wrench = Velocity::ZERO;
                    let kept = at.of_points(&before).iter_mut().zip(at.of_points(&direction));
                    for (contact, (before, direction)) in at.points().iter_mut().zip(kept) {
                        *direction = nncg::next_direction(contact, *before, *direction, beta);
                        let change = *direction * beta;
                        contact.impulse += change;
                        contact.add_wrench(0..L, change, &mut wrench);
                        *before = contact.impulse;
                    }
                    let [mut a, mut b] = at.gather();
                    manifold.apply(&wrench, &block.masses, &mut a, &mut b);
                    at.scatter([a, b]);
                }
                for mut at in ground.walk(member) {
                    if !at.block.is_done(done) {
                        let [mut a, mut b] = at.gather();
                        let points = at.points();
                        visit::<V, L, A, false, true>(at.block.parts(), points, &mut a, &mut b);
                        at.scatter([a, b]);
                    }
                }
                for mut at in ground.walk_back(member) {
                    if at.block.is_done(done) {
                        continue;
                    }
                    let [mut a, mut b] = at.gather();
                    let points = at.points();
                    visit::<V, L, A, false, true>(at.block.parts(), points, &mut a, &mut b);
                    at.scatter([a, b]);
                    let mut size = V::ZERO;
                    for (contact, before) in points.iter().zip(at.of_points(&before)) {
                        size += nncg::size(contact, *before);
                    }
                    at.of_block(&gradients)[0] = size;
                }
            },
        );
    });
    packed.conjugate = state;
    packed.find_betas(done);
}
