//! [`nncg`](crate::nncg) on packed systems, island by island.

use super::Packed;
use crate::lanes::{Lanes, WIDTH};
use crate::pgs::visit;
use crate::{Vector, Velocity, nncg};

/// What conjugate gradients keep from iteration to iteration.
#[derive(Clone, Debug, Default)]
pub(super) struct Conjugate<V: Lanes, const L: usize> {
    /// Impulses before the sweeps, and directions.
    before: Vec<Vector<V, L>>,
    direction: Vec<Vector<V, L>>,
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

    /// One iteration over the islands that are not `done`.
    pub fn conjugate(&mut self, velocities: &mut [Velocity<f32, L, A>], done: &[bool]) {
        self.push(velocities, done);
        let Self { blocks, contacts, conjugate: state, .. } = self;
        state.sizes.fill(0.0);
        let last = state.sizes.len() - 1;
        V::run(
            #[inline(always)]
            || {
                let count = blocks.len();
                for (round, index) in (0..count).chain((0..count).rev()).enumerate() {
                    let block = &blocks[index];
                    if block.is_done(done) {
                        continue;
                    }
                    let manifold = &block.manifold;
                    let [mut a, mut b] = block.gather(velocities);
                    let points = &mut contacts[manifold.points()];
                    visit::<V, L, A, false, true>(block.parts(), points, &mut a, &mut b);
                    block.scatter([a, b], velocities);
                    if round < count {
                        continue;
                    }
                    let mut size = V::ZERO;
                    for (contact, before) in points.iter().zip(&state.before[manifold.points()]) {
                        size += nncg::size(contact, *before);
                    }
                    for lane in 0..block.lanes {
                        state.sizes[(block.islands[lane] as usize).min(last)] += size.get(lane);
                    }
                }
            },
        );
        let sizes = state.sizes.iter().zip(&mut state.sizes_before);
        for (beta, (&size, before)) in state.betas.iter_mut().zip(sizes) {
            *beta = nncg::beta_of(size, before);
        }
    }

    /// r <- r + beta p with p <- beta p - g, and the velocities that go with it.
    fn push(&mut self, velocities: &mut [Velocity<f32, L, A>], done: &[bool]) {
        let Self { blocks, contacts, conjugate: state, .. } = self;
        let last = state.betas.len() - 1;
        V::run(
            #[inline(always)]
            || {
                for block in blocks.iter().filter(|block| !block.is_done(done)) {
                    let manifold = &block.manifold;
                    let betas: [f32; WIDTH] = std::array::from_fn(|lane| {
                        state.betas[(block.islands[lane] as usize).min(last)]
                    });
                    let beta = V::from_array(betas);
                    let points = manifold.points();
                    let mut wrench = Velocity::ZERO;
                    let kept = state.before[points.clone()].iter_mut();
                    let kept = kept.zip(&mut state.direction[points.clone()]);
                    for (contact, (before, direction)) in contacts[points].iter_mut().zip(kept) {
                        *direction = nncg::next_direction(contact, *before, *direction, beta);
                        let change = *direction * beta;
                        contact.impulse += change;
                        contact.add_wrench(0..L, change, &mut wrench);
                        *before = contact.impulse;
                    }
                    let [mut a, mut b] = block.gather(velocities);
                    manifold.apply(&wrench, &block.masses, &mut a, &mut b);
                    block.scatter([a, b], velocities);
                }
            },
        );
    }
}
