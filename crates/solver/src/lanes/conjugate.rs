//! Conjugate gradients ([`nncg`](crate::nncg)) on packed systems, island by island.

use super::block::Block;
use super::view::view_all;
use super::{Lanes, Portable, WIDTH};
use crate::island::{Islands, NONE};
use crate::{Real, Vector, Velocity, nncg};

/// State of conjugate gradients between iterations.
#[derive(Clone, Debug, Default)]
pub(super) struct Conjugate<const L: usize, const A: usize> {
    /// For each point, the impulse before the sweep, and the search direction p.
    pub(super) before: Vec<Vector<Portable, L>>,
    pub(super) direction: Vec<Vector<Portable, L>>,
    /// For each body, the velocity before the sweep, and M^-1 J^T p.
    pub(super) velocities: Vec<Velocity<f32, L, A>>,
    pub(super) ways: Vec<Velocity<f32, L, A>>,
    /// |g|^2 of each block. \[J\]
    pub(super) gradients: Vec<Portable>,
    /// Island of each body.
    pub(super) of_body: Vec<u32>,
    /// For each island, |g|^2 of this iteration and of the last one \[J\], and beta.
    sizes: Vec<f32>,
    sizes_before: Vec<f32>,
    pub(super) betas: Vec<f32>,
}

impl<const L: usize, const A: usize> Conjugate<L, A> {
    pub(super) fn set_islands(&mut self, islands: &Islands) {
        self.of_body.clone_from(&islands.of_body);
        // The last entry is for manifolds without an island.
        for of_islands in [&mut self.sizes, &mut self.sizes_before, &mut self.betas] {
            of_islands.resize(islands.count + 1, 0.0);
        }
    }

    /// Returns |g|^2 of each island. \[J\]
    pub(super) fn sizes(&self) -> &[f32] {
        let islands = self.sizes.len().saturating_sub(1);
        &self.sizes[..islands]
    }

    /// Forgets the search directions of the last system, and sizes the state for so many blocks and
    /// points.
    pub(super) fn begin(&mut self, blocks: usize, points: usize) {
        self.before.resize(points, Vector::ZERO);
        self.direction.resize(points, Vector::ZERO);
        self.gradients.resize(blocks, Portable::ZERO);
        self.velocities.resize(self.of_body.len(), Velocity::ZERO);
        self.ways.resize(self.of_body.len(), Velocity::ZERO);
        self.sizes_before.fill(f32::INFINITY);
        // With beta = 0, all search directions start at 0.
        self.betas.fill(0.0);
    }

    /// Computes beta of each island from the gradients of its blocks, always in the same order.
    #[inline(always)]
    pub(super) fn find_betas<V: Lanes>(&mut self, blocks: &[Block<Portable, L, A>], done: &[bool]) {
        self.sizes.fill(0.0);
        let last = self.sizes.len() - 1;
        // Consecutive blocks of one island are summed lane by lane.
        let (mut island, mut sum) = (NONE, V::ZERO);
        let of = |island: u32| (island as usize).min(last);
        let total = |of: V| (0..WIDTH).map(|lane| of.get(lane)).sum::<f32>();
        for (block, size) in blocks.iter().zip(view_all::<V, _>(&self.gradients)) {
            match block.island() {
                _ if block.due_lanes(done) == 0 => {}
                Some(own) if own == island => sum += *size,
                Some(own) => {
                    self.sizes[of(island)] += total(std::mem::replace(&mut sum, *size));
                    island = own;
                }
                None => {
                    for (lane, &own) in block.islands.iter().enumerate() {
                        self.sizes[of(own)] += size.get(lane);
                    }
                }
            }
        }
        self.sizes[of(island)] += total(sum);
        let sizes = self.sizes.iter().zip(&mut self.sizes_before);
        for (beta, (&size, before)) in self.betas.iter_mut().zip(sizes) {
            *beta = nncg::beta_of(size, before);
        }
        // Manifolds without an island have no search direction.
        self.betas[last] = 0.0;
    }
}

/// Returns the entry of an island; the last entry is for manifolds without an island.
#[inline(always)]
pub(super) fn of(island: u32, all: &[f32]) -> f32 {
    all[(island as usize).min(all.len() - 1)]
}
