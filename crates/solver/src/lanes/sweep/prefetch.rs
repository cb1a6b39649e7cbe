//! Software prefetching for sweeps over blocks.
//!
//! Consecutive blocks are some pages apart, and hardware prefetching ends at a page.

use std::ops::Range;

use super::BlockSweep;
use crate::lanes::block::Block;
use crate::lanes::{Lanes, WIDTH};
use crate::{Manifold, SymmetricMatrix};

/// Number of parts into which a visit divides its prefetches: at its start, and before, between and
/// after its normals and friction. A visit would stall on prefetches issued all at once.
const PARTS: usize = 4;

impl<V: Lanes, const L: usize, const A: usize> BlockSweep<'_, V, L, A> {
    /// Prefetch distance in blocks; longer for small blocks.
    const AHEAD: usize = 1 + 8192 / size_of::<Block<V, L, A>>();

    /// Prefetches a part of the data of two upcoming blocks. At distance `AHEAD` these are the
    /// points and velocities of a block that itself was prefetched earlier. At twice this distance
    /// it is the block itself.
    #[inline(always)]
    pub(super) fn look_ahead(&self, index: usize, part: usize) {
        let own = index - self.first;
        if let Some(block) = self.blocks.get(own + 2 * Self::AHEAD) {
            // Most blocks have the same `center` as the ones before; that of this one is not known
            // yet.
            block.fetch(self.blocks[own].center, part);
        }
        if let Some(block) = self.blocks.get(own + Self::AHEAD) {
            let Manifold { first, count, .. } = block.manifold;
            fetch_part(self.contacts.place(first), count as usize, part);
            for bodies in &block.bodies {
                for &body in &bodies[WIDTH / PARTS * part..][..WIDTH / PARTS] {
                    fetch(self.velocities.place(body), 1);
                    if let Some(also) = &self.also {
                        fetch(also.place(body), 1);
                    }
                }
            }
        }
    }
}

impl<V: Lanes, const L: usize, const A: usize> Block<V, L, A> {
    /// Prefetches a part of the data that a visit reads, which is less for points in the `center`.
    #[inline(always)]
    fn fetch(&self, center: bool, part: usize) {
        if A < 3 {
            // In small blocks, too little data is unread for skipping it to pay off.
            return fetch_part(self, 1, part);
        }
        let Self { bodies, moving, masses, mobility, manifold, .. } = self;
        match part {
            0 => {
                fetch(bodies, 1);
                fetch(moving, 1);
                fetch(&masses[0].linear, 1);
                fetch_matrix(&masses[0].angular);
            }
            1 => {
                fetch(&masses[1].linear, 1);
                fetch_matrix(&masses[1].angular);
                fetch_matrix(&mobility.linear);
            }
            2 if center => {}
            2 => {
                fetch(&mobility.cross, 1);
                fetch_matrix(&mobility.angular);
            }
            _ => {
                fetch(&manifold.frame, 1);
                fetch(&manifold.friction, 1);
                fetch(&manifold.count, 1);
            }
        }
    }
}

/// Prefetches memory into the level-2 cache, since the path to level 1 has room for few cache lines
/// at a time. Any address is allowed.
#[inline(always)]
fn fetch<T>(first: *const T, count: usize) {
    fetch_bytes(first.cast(), 0..count * size_of::<T>());
}

/// Prefetches one part of this memory.
#[inline(always)]
fn fetch_part<T>(first: *const T, count: usize, part: usize) {
    let size = (count * size_of::<T>()).div_ceil(PARTS);
    fetch_bytes(first.cast(), size * part..size * (part + 1));
}

#[inline(always)]
fn fetch_bytes(first: *const u8, bytes: Range<usize>) {
    #[cfg(target_arch = "x86_64")]
    for line in bytes.step_by(64) {
        use std::arch::x86_64::{_MM_HINT_T1, _mm_prefetch};
        // SAFETY: a prefetch reads nothing.
        unsafe { _mm_prefetch::<_MM_HINT_T1>(first.wrapping_add(line).cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (first, bytes);
}

/// Prefetches the entries of a matrix that products read.
#[inline(always)]
fn fetch_matrix<T, const N: usize>(matrix: &SymmetricMatrix<T, N>) {
    for (i, row) in matrix.0.iter().enumerate() {
        fetch(&row.0[i], N - i);
    }
}
