//! [`Avx2`]: lanes in two registers of eight numbers.
#![allow(unsafe_code)]

use std::arch::x86_64::*;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use super::number::{Doubles, KernelLanes, LaneArray, Lanes, PART, Row, WIDTH};
use crate::registers::{has_avx2, with_avx2};
use crate::{Cast, Real};

/// Lanes in AVX2 registers. Values can be created and moved anywhere; arithmetic must happen
/// within [`Lanes::run`].
pub type Avx2 = LaneArray<Floats, 2, 2>;

impl Lanes for Avx2 {
    type Doubles = LaneArray<Floats64, 2, 2>;
    type Half = LaneArray<Floats, 2, 1>;

    #[inline(always)]
    fn set(&mut self, lane: usize, number: f32) {
        // SAFETY: the registers occupy the memory of `WIDTH` numbers; the index is checked.
        unsafe { (*std::ptr::from_mut(self).cast::<[f32; WIDTH]>())[lane] = number }
    }

    #[inline(always)]
    fn get(&self, lane: usize) -> f32 {
        // SAFETY: the registers occupy the memory of `WIDTH` numbers; the index is checked.
        unsafe { (*std::ptr::from_ref(self).cast::<[f32; WIDTH]>())[lane] }
    }

    #[inline(always)]
    fn run<R>(f: impl FnOnce() -> R) -> R {
        assert!(has_avx2(), "Avx2 lanes need a machine with AVX2");
        // SAFETY: the machine has AVX2, as just asserted.
        unsafe { with_avx2(f) }
    }
}

// SAFETY: two registers of eight `f32`, aligned as `Portable`.
unsafe impl<const USED: usize> KernelLanes for LaneArray<Floats, 2, USED> {
    #[inline(always)]
    fn from_array(numbers: [f32; WIDTH]) -> Self {
        // SAFETY: both types are the same number of bytes of plain numbers.
        unsafe { std::mem::transmute(numbers) }
    }

    #[inline(always)]
    unsafe fn from_rows(rows: [*const f32; WIDTH], count: usize) -> [Self; 4] {
        let mut columns = [Self::ZERO; 4];
        for half in 0..USED {
            let at = 8 * half;
            // SAFETY: within `run`, the machine has AVX2; the rows are as the caller promises.
            let own = unsafe {
                transposed([
                    two_rows(rows[at], rows[at + 4], count),
                    two_rows(rows[at + 1], rows[at + 5], count),
                    two_rows(rows[at + 2], rows[at + 6], count),
                    two_rows(rows[at + 3], rows[at + 7], count),
                ])
            };
            for i in 0..4 {
                columns[i].0[half] = Floats(own[i]);
            }
        }
        columns
    }

    #[inline(always)]
    fn to_rows(columns: [Self; 4]) -> [Row; WIDTH] {
        let mut rows = [[0.0; 4]; WIDTH];
        for half in 0..USED {
            let [a, b, c, d] = columns;
            // SAFETY: within `run`, the machine has AVX2; a row is four numbers.
            unsafe {
                let pairs = transposed([a.0[half].0, b.0[half].0, c.0[half].0, d.0[half].0]);
                for i in 0..4 {
                    let [low, high] = [8 * half + i, 8 * half + i + 4];
                    _mm_storeu_ps(rows[low].as_mut_ptr(), _mm256_castps256_ps128(pairs[i]));
                    let upper = _mm256_extractf128_ps::<1>(pairs[i]);
                    _mm_storeu_ps(rows[high].as_mut_ptr(), upper);
                }
            }
        }
        rows
    }
}

impl Doubles for LaneArray<Floats64, 2, 2> {
    #[inline(always)]
    fn get(&self, lane: usize) -> f64 {
        // SAFETY: the registers occupy the memory of `PART` numbers; the index is checked.
        unsafe { (*std::ptr::from_ref(self).cast::<[f64; PART]>())[lane] }
    }
}

impl Cast<LaneArray<Floats64, 2, 2>> for Avx2 {
    const PARTS: usize = WIDTH / PART;

    #[inline(always)]
    fn part(&self, index: usize) -> LaneArray<Floats64, 2, 2> {
        assert!(index < Self::PARTS);
        // SAFETY: within `run`, the machine has AVX2. The index is checked.
        unsafe {
            let numbers = std::ptr::from_ref(self).cast::<f32>().add(PART * index);
            let half = |numbers| Floats64(_mm256_cvtps_pd(_mm_loadu_ps(numbers)));
            LaneArray([half(numbers), half(numbers.add(4))])
        }
    }
}

/// Loads two rows, one into each half of the register.
///
/// # Safety
/// The conditions of [`Lanes::from_rows`] hold.
#[target_feature(enable = "avx2")]
#[inline]
unsafe fn two_rows(low: *const f32, high: *const f32, count: usize) -> __m256 {
    // SAFETY: as the caller promises; numbers beyond `count` are masked out and not read.
    unsafe {
        if count >= 4 {
            return _mm256_loadu2_m128(high, low);
        }
        let on = |i| if count > i { -1 } else { 0 };
        let mask = _mm_set_epi32(0, on(2), on(1), on(0));
        _mm256_set_m128(_mm_maskload_ps(high, mask), _mm_maskload_ps(low, mask))
    }
}

/// Transposes four rows of four numbers into four columns, in each half.
#[target_feature(enable = "avx2")]
#[inline]
fn transposed([a, b, c, d]: [__m256; 4]) -> [__m256; 4] {
    let (low, high) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
    let (lower, higher) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
    [
        _mm256_shuffle_ps::<0x44>(low, lower),
        _mm256_shuffle_ps::<0xee>(low, lower),
        _mm256_shuffle_ps::<0x44>(high, higher),
        _mm256_shuffle_ps::<0xee>(high, higher),
    ]
}

macro_rules! register {
    (
        $(#[$doc:meta])* $name:ident, $register:ty, $number:ty, $count:expr,
        $set:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $sqrt:ident, $max:ident,
        $min:ident, $xor:ident, $compare:ident, $blend:ident
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        #[repr(transparent)]
        pub struct $name($register);

        impl $name {
            const fn all(value: $number) -> Self {
                // SAFETY: both are 32 bytes of plain numbers.
                Self(unsafe { std::mem::transmute::<[$number; $count], $register>([value; $count]) })
            }
        }

        impl Default for $name {
            fn default() -> Self {
                Self::ZERO
            }
        }

        impl PartialEq for $name {
            fn eq(&self, other: &Self) -> bool {
                // SAFETY: both are 32 bytes of plain numbers.
                let numbers = |of: &Self| unsafe {
                    std::mem::transmute::<$register, [$number; $count]>(of.0)
                };
                numbers(self) == numbers(other)
            }
        }

        register!($name, Add add $add);
        register!($name, Sub sub $sub);
        register!($name, Mul mul $mul);
        register!($name, Div div $div);

        impl AddAssign for $name {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }

        impl SubAssign for $name {
            #[inline(always)]
            fn sub_assign(&mut self, other: Self) {
                *self = *self - other;
            }
        }

        impl Neg for $name {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                // SAFETY: within `run`, the machine has AVX2. Flips the sign bit, as the scalar
                // does.
                unsafe { Self($xor(self.0, $set(-0.0))) }
            }
        }

        impl Real for $name {
            const ZERO: Self = Self::all(0.0);
            const ONE: Self = Self::all(1.0);
            const NEG_ZERO: Self = Self::all(-0.0);

            #[inline(always)]
            fn from_f64(value: f64) -> Self {
                Self::all(value as $number)
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                // SAFETY: as above.
                unsafe { Self($sqrt(self.0)) }
            }

            #[inline(always)]
            fn max(self, other: Self) -> Self {
                // SAFETY: as above. Computes `self > other ? self : other`, as the scalar does.
                unsafe { Self($max(self.0, other.0)) }
            }

            #[inline(always)]
            fn min(self, other: Self) -> Self {
                // SAFETY: as above. Computes `self < other ? self : other`, as the scalar does.
                unsafe { Self($min(self.0, other.0)) }
            }

            #[inline(always)]
            fn choose(self, positive: Self, otherwise: Self) -> Self {
                // SAFETY: as above.
                unsafe {
                    let mask = $compare::<_CMP_GT_OQ>(self.0, $set(0.0));
                    Self($blend(otherwise.0, positive.0, mask))
                }
            }
        }
    };
    ($name:ident, $trait:ident $method:ident $instruction:ident) => {
        impl $trait for $name {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: within `run`, the machine has AVX2.
                unsafe { Self($instruction(self.0, other.0)) }
            }
        }
    };
}

register!(
    /// Eight `f32` in a register, under the rules of [`Avx2`].
    Floats, __m256, f32, 8,
    _mm256_set1_ps, _mm256_add_ps, _mm256_sub_ps, _mm256_mul_ps, _mm256_div_ps, _mm256_sqrt_ps,
    _mm256_max_ps, _mm256_min_ps, _mm256_xor_ps, _mm256_cmp_ps, _mm256_blendv_ps
);

register!(
    /// Four `f64` in a register, under the rules of [`Avx2`].
    Floats64, __m256d, f64, 4,
    _mm256_set1_pd, _mm256_add_pd, _mm256_sub_pd, _mm256_mul_pd, _mm256_div_pd, _mm256_sqrt_pd,
    _mm256_max_pd, _mm256_min_pd, _mm256_xor_pd, _mm256_cmp_pd, _mm256_blendv_pd
);
