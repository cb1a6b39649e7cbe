//! Gathers the velocities of a block's bodies into lanes.
#![allow(unsafe_code)]

use super::block::Block;
use super::number::gather;
use super::{KernelLanes, Lanes, Row, WIDTH};
use crate::thread_pool::DisjointSlice;
use crate::{Velocity, each_lane};

impl<V: Lanes, const L: usize, const A: usize> Block<V, L, A> {
    /// Returns the velocities, or other such data, of the bodies in each lane. `from` begins with
    /// body `first`.
    #[inline(always)]
    pub(super) fn gather_from(
        &self,
        first: usize,
        from: &[Velocity<f32, L, A>],
    ) -> [Velocity<V, L, A>; 2] {
        // SAFETY: the slice is borrowed, so nobody changes it.
        unsafe { self.gather(&DisjointSlice::reading(first, from)) }
    }

    /// Returns the velocities of the bodies in each lane.
    ///
    /// # Safety
    /// Nobody changes the velocities of its bodies at the same time.
    #[inline(always)]
    pub(super) unsafe fn gather<C: KernelLanes>(
        &self,
        from: &DisjointSlice<'_, Velocity<f32, L, A>>,
    ) -> [Velocity<C, L, A>; 2] {
        self.check(from);
        // SAFETY: just checked, and as the caller promises.
        unsafe { [self.gather_side(0, from), self.gather_side(1, from)] }
    }

    /// # Safety
    /// The conditions of `gather` hold, and the bodies have been checked.
    #[inline(always)]
    unsafe fn gather_side<C: KernelLanes>(
        &self,
        side: usize,
        from: &DisjointSlice<'_, Velocity<f32, L, A>>,
    ) -> Velocity<C, L, A> {
        let bodies = &self.bodies[side];
        let mut numbers = [C::ZERO; 8];
        let at = each_lane!(lane => from.place(bodies[lane]).cast::<f32>().cast_const());
        // SAFETY: as the caller promises. A velocity takes up whole rows, which are the fastest to
        // read.
        unsafe { gather(at, &mut numbers[..(L + A).max(4)]) };
        if self.away[side] != 0 {
            self.stop(side, &mut numbers[..L + A]);
        }
        let mut out = Velocity::ZERO;
        out.linear.0.copy_from_slice(&numbers[..L]);
        out.angular.0.copy_from_slice(&numbers[L..L + A]);
        out
    }

    /// Sets the velocities of bodies in other batches to zero; they are those of the other bodies
    /// of their manifolds.
    #[inline(always)]
    fn stop<C: KernelLanes>(&self, side: usize, numbers: &mut [C]) {
        let mut away = [0.0; WIDTH];
        for (lane, own) in away.iter_mut().enumerate() {
            *own = f32::from(self.away[side] >> lane & 1);
        }
        let away = C::from_array(away);
        for number in numbers {
            *number = away.choose(C::ZERO, *number);
        }
    }

    /// Checks that the bodies of the block are in a slice, since lanes are read and written
    /// unchecked.
    ///
    /// # Panics
    /// Some are not.
    #[inline(always)]
    pub(super) fn check(&self, of: &DisjointSlice<'_, Velocity<f32, L, A>>) {
        const { assert!(size_of::<Velocity<f32, L, A>>() >= size_of::<Row>() * (L + A).div_ceil(4)) };
        let [first, end] = self.reach.map(|body| body as usize);
        of.check(first..end);
    }
}
