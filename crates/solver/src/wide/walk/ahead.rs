//! What a walk asks memory for before it comes there.
//!
//! A block is some pages away from the next, where what a processor fetches by itself ends.

use std::ops::Range;

use super::BlockSweep;
use crate::lanes::{Lanes, WIDTH};
use crate::wide::block::Block;
use crate::{Manifold, SymmetricMatrix};

/// Parts in which a visit asks for what comes next, at its start, before, between and after its normals and
/// friction: what is asked for at once, it waits for.
const PARTS: usize = 4;

impl<V: Lanes, const L: usize, const A: usize> BlockSweep<'_, V, L, A> {
    /// How many blocks ahead: more of them where they are small.
    const AHEAD: usize = 1 + 8192 / size_of::<Block<V, L, A>>();

    /// Asks for a part of what the next blocks on the way need: of one that is soon reached, and was asked for
    /// before, points and velocities; and another one as far behind it.
    #[inline(always)]
    pub(super) fn look_ahead(&self, index: usize, part: usize) {
        let own = index - self.first;
        if let Some(block) = self.blocks.get(own + 2 * Self::AHEAD) {
            // Most follow others of their kind, and their own is not known yet.
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
    /// Asks for a part of what a visit reads, of points in the `center` less.
    #[inline(always)]
    fn fetch(&self, center: bool, part: usize) {
        if A < 3 {
            // Too little is not read for gaps to be worth the while.
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
                fetch(&manifold.arms, 1);
                fetch(&manifold.friction, 1);
                fetch(&manifold.count, 1);
            }
        }
    }
}

/// Asks for memory that is soon read, wherever it is, to come into the second cache: the way to the first has
/// room for few lines at a time.
#[inline(always)]
fn fetch<T>(first: *const T, count: usize) {
    fetch_bytes(first.cast(), 0..count * size_of::<T>());
}

/// The same of a part of it.
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
        // SAFETY: nothing is read.
        unsafe { _mm_prefetch::<_MM_HINT_T1>(first.wrapping_add(line).cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (first, bytes);
}

/// The same of what products read.
#[inline(always)]
fn fetch_matrix<T, const N: usize>(matrix: &SymmetricMatrix<T, N>) {
    for (i, row) in matrix.0.iter().enumerate() {
        fetch(&row.0[i], N - i);
    }
}
