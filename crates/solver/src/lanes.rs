//! [`Lanes`]: eight numbers side by side, which go through the kernels as one [`Real`].
//!
//! Eight on every target, so that layout and bits never depend on the machine: [`Avx2`] holds them in
//! one register, [`Halves`] in whatever the compiler makes of two times four. Each lane is an `f32` of
//! its own and rounds as one; nothing is fused or approximate.
//!
//! This module and its entry point [`Lanes::run`] are the only unsafe code of the project.
#![allow(unsafe_code)]

use std::array::from_fn;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use crate::{Cast, Real};

/// Number of lanes, on every target.
pub const WIDTH: usize = 8;

/// Eight `f32` that are computed together.
pub trait Lanes: Real {
    /// Eight numbers that hold these exactly.
    type Doubles: Doubles;

    /// The numbers.
    fn to_array(self) -> [f32; WIDTH];

    /// Eight numbers.
    fn from_array(numbers: [f32; WIDTH]) -> Self;

    /// Changes one of them.
    fn set(&mut self, lane: usize, number: f32);

    /// One of them.
    fn get(&self, lane: usize) -> f32;

    /// Runs `f` with the instructions that this type needs. Arithmetic on the type is only fast, and
    /// on [`Avx2`] only allowed, within.
    fn run<R>(f: impl FnOnce() -> R) -> R;
}

/// Eight `f64` that are computed together, within [`Lanes::run`].
pub trait Doubles: Real {
    /// One of them.
    fn get(&self, lane: usize) -> f64;
}

/// Eight numbers as two times four, for every target.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(32))]
pub struct Halves<T = f32>([[T; 4]; 2]);

impl<T: Real> Halves<T> {
    #[inline(always)]
    fn each(self, other: Self, f: impl Fn(T, T) -> T) -> Self {
        Self(from_fn(|half| from_fn(|i| f(self.0[half][i], other.0[half][i]))))
    }
}

impl Doubles for Halves<f64> {
    #[inline(always)]
    fn get(&self, lane: usize) -> f64 {
        self.0[lane / 4][lane % 4]
    }
}

impl Cast<Halves<f64>> for Halves {
    #[inline(always)]
    fn cast(self) -> Halves<f64> {
        Halves(from_fn(|half| from_fn(|i| f64::from(self.0[half][i]))))
    }
}

impl Lanes for Halves {
    type Doubles = Halves<f64>;

    #[inline(always)]
    fn to_array(self) -> [f32; WIDTH] {
        from_fn(|i| self.0[i / 4][i % 4])
    }

    #[inline(always)]
    fn from_array(numbers: [f32; WIDTH]) -> Self {
        Self(from_fn(|half| from_fn(|i| numbers[4 * half + i])))
    }

    #[inline(always)]
    fn set(&mut self, lane: usize, number: f32) {
        self.0[lane / 4][lane % 4] = number;
    }

    #[inline(always)]
    fn get(&self, lane: usize) -> f32 {
        self.0[lane / 4][lane % 4]
    }

    #[inline(always)]
    fn run<R>(f: impl FnOnce() -> R) -> R {
        f()
    }
}

/// The four operations of a lanes type, from one function for each.
macro_rules! operators {
    ($type:ty, $($trait:ident $method:ident $f:expr;)*) => {
        $(
            impl $trait for $type {
                type Output = Self;
                #[inline(always)]
                fn $method(self, other: Self) -> Self {
                    $f(self, other)
                }
            }
        )*
        impl AddAssign for $type {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }
        impl SubAssign for $type {
            #[inline(always)]
            fn sub_assign(&mut self, other: Self) {
                *self = *self - other;
            }
        }
    };
}

macro_rules! halves {
    ($t:ty) => {
        impl Neg for Halves<$t> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                self.each(self, |x, _| -x)
            }
        }

        impl Real for Halves<$t> {
            const ZERO: Self = Self([[0.0; 4]; 2]);
            const ONE: Self = Self([[1.0; 4]; 2]);

            #[inline(always)]
            fn from_f64(value: f64) -> Self {
                Self([[value as $t; 4]; 2])
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                self.each(self, |x, _| x.sqrt())
            }

            #[inline(always)]
            fn max(self, other: Self) -> Self {
                self.each(other, Real::max)
            }

            #[inline(always)]
            fn min(self, other: Self) -> Self {
                self.each(other, Real::min)
            }

            #[inline(always)]
            fn choose(self, positive: Self, otherwise: Self) -> Self {
                Self(from_fn(|half| {
                    from_fn(|i| self.0[half][i].choose(positive.0[half][i], otherwise.0[half][i]))
                }))
            }
        }

        operators! { Halves<$t>,
            Add add |a: Self, b| a.each(b, |x, y| x + y);
            Sub sub |a: Self, b| a.each(b, |x, y| x - y);
            Mul mul |a: Self, b| a.each(b, |x, y| x * y);
            Div div |a: Self, b| a.each(b, |x, y| x / y);
        }
    };
}

halves!(f32);
halves!(f64);

#[cfg(target_arch = "x86_64")]
pub use avx2::{Avx2, available as avx2_available};

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;
    use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

    use super::{Doubles, Lanes, WIDTH};
    use crate::{Cast, Real};

    /// Eight numbers in a register of AVX2. Values can be made and moved anywhere; arithmetic must
    /// happen within [`Lanes::run`].
    #[derive(Clone, Copy, Debug)]
    #[repr(transparent)]
    pub struct Avx2(__m256);

    /// Whether this machine has the instructions.
    pub fn available() -> bool {
        std::arch::is_x86_feature_detected!("avx2")
    }

    /// An array has the size and, aligned, the bits of the register.
    #[repr(align(32))]
    #[derive(Clone, Copy)]
    struct Aligned(#[allow(dead_code)] [f32; WIDTH]);

    const fn constant(value: f32) -> Avx2 {
        // SAFETY: both are 32 bytes of plain numbers.
        unsafe { std::mem::transmute(Aligned([value; WIDTH])) }
    }

    impl Default for Avx2 {
        fn default() -> Self {
            constant(0.0)
        }
    }

    impl PartialEq for Avx2 {
        fn eq(&self, other: &Self) -> bool {
            self.to_array() == other.to_array()
        }
    }

    impl Lanes for Avx2 {
        type Doubles = Avx2Doubles;

        #[inline(always)]
        fn to_array(self) -> [f32; WIDTH] {
            // SAFETY: both are 32 bytes of plain numbers.
            unsafe { std::mem::transmute(self) }
        }

        #[inline(always)]
        fn from_array(numbers: [f32; WIDTH]) -> Self {
            // SAFETY: both are 32 bytes of plain numbers.
            unsafe { std::mem::transmute(Aligned(numbers)) }
        }

        #[inline(always)]
        fn set(&mut self, lane: usize, number: f32) {
            // SAFETY: a register in memory is eight numbers; the index is checked.
            unsafe { (*std::ptr::from_mut(self).cast::<[f32; WIDTH]>())[lane] = number }
        }

        #[inline(always)]
        fn get(&self, lane: usize) -> f32 {
            // SAFETY: a register in memory is eight numbers; the index is checked.
            unsafe { (*std::ptr::from_ref(self).cast::<[f32; WIDTH]>())[lane] }
        }

        #[inline(always)]
        fn run<R>(f: impl FnOnce() -> R) -> R {
            assert!(available(), "Avx2 lanes need a machine with AVX2");
            // SAFETY: the machine has AVX2, as just asserted.
            unsafe { enter(f) }
        }
    }

    #[target_feature(enable = "avx2")]
    fn enter<R>(f: impl FnOnce() -> R) -> R {
        f()
    }

    impl Neg for Avx2 {
        type Output = Self;
        #[inline(always)]
        fn neg(self) -> Self {
            // SAFETY: within `run`, the machine has AVX2. Flips the sign bit, as scalar negation.
            unsafe { Self(_mm256_xor_ps(self.0, _mm256_set1_ps(-0.0))) }
        }
    }

    // SAFETY of each: within `run`, the machine has AVX2.
    operators! { Avx2,
        Add add |a: Avx2, b: Avx2| unsafe { Avx2(_mm256_add_ps(a.0, b.0)) };
        Sub sub |a: Avx2, b: Avx2| unsafe { Avx2(_mm256_sub_ps(a.0, b.0)) };
        Mul mul |a: Avx2, b: Avx2| unsafe { Avx2(_mm256_mul_ps(a.0, b.0)) };
        Div div |a: Avx2, b: Avx2| unsafe { Avx2(_mm256_div_ps(a.0, b.0)) };
    }

    impl Real for Avx2 {
        const ZERO: Self = constant(0.0);
        const ONE: Self = constant(1.0);

        #[inline(always)]
        fn from_f64(value: f64) -> Self {
            constant(value as f32)
        }

        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: as above.
            unsafe { Self(_mm256_sqrt_ps(self.0)) }
        }

        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: as above. The instruction is `self > other ? self : other`, as the scalar.
            unsafe { Self(_mm256_max_ps(self.0, other.0)) }
        }

        #[inline(always)]
        fn min(self, other: Self) -> Self {
            // SAFETY: as above. The instruction is `self < other ? self : other`, as the scalar.
            unsafe { Self(_mm256_min_ps(self.0, other.0)) }
        }

        #[inline(always)]
        fn choose(self, positive: Self, otherwise: Self) -> Self {
            // SAFETY: as above.
            unsafe {
                let mask = _mm256_cmp_ps::<_CMP_GT_OQ>(self.0, _mm256_setzero_ps());
                Self(_mm256_blendv_ps(otherwise.0, positive.0, mask))
            }
        }
    }

    /// Eight `f64` in two registers of AVX2, under the terms of [`Avx2`].
    #[derive(Clone, Copy, Debug)]
    #[repr(transparent)]
    pub struct Avx2Doubles([__m256d; 2]);

    /// An array has the size and, aligned, the bits of the registers.
    #[repr(align(32))]
    #[derive(Clone, Copy)]
    struct AlignedDoubles(#[allow(dead_code)] [f64; WIDTH]);

    const fn doubles(value: f64) -> Avx2Doubles {
        // SAFETY: both are 64 bytes of plain numbers.
        unsafe { std::mem::transmute(AlignedDoubles([value; WIDTH])) }
    }

    impl Cast<Avx2Doubles> for Avx2 {
        #[inline(always)]
        fn cast(self) -> Avx2Doubles {
            // SAFETY: within `run`, the machine has AVX2.
            unsafe {
                let low = _mm256_cvtps_pd(_mm256_castps256_ps128(self.0));
                let high = _mm256_cvtps_pd(_mm256_extractf128_ps::<1>(self.0));
                Avx2Doubles([low, high])
            }
        }
    }

    impl Default for Avx2Doubles {
        fn default() -> Self {
            doubles(0.0)
        }
    }

    impl PartialEq for Avx2Doubles {
        fn eq(&self, other: &Self) -> bool {
            (0..WIDTH).all(|lane| self.get(lane) == other.get(lane))
        }
    }

    impl Doubles for Avx2Doubles {
        #[inline(always)]
        fn get(&self, lane: usize) -> f64 {
            // SAFETY: registers in memory are eight numbers; the index is checked.
            unsafe { (*std::ptr::from_ref(self).cast::<[f64; WIDTH]>())[lane] }
        }
    }

    impl Neg for Avx2Doubles {
        type Output = Self;
        #[inline(always)]
        fn neg(self) -> Self {
            // SAFETY: as above.
            unsafe {
                let sign = _mm256_set1_pd(-0.0);
                Self([_mm256_xor_pd(self.0[0], sign), _mm256_xor_pd(self.0[1], sign)])
            }
        }
    }

    /// An instruction on both registers. A closure would keep it from being inlined.
    macro_rules! both {
        ($instruction:ident, $a:expr, $b:expr) => {
            // SAFETY: within `run`, the machine has AVX2.
            unsafe { Avx2Doubles([$instruction($a.0[0], $b.0[0]), $instruction($a.0[1], $b.0[1])]) }
        };
    }

    operators! { Avx2Doubles,
        Add add |a: Self, b: Self| both!(_mm256_add_pd, a, b);
        Sub sub |a: Self, b: Self| both!(_mm256_sub_pd, a, b);
        Mul mul |a: Self, b: Self| both!(_mm256_mul_pd, a, b);
        Div div |a: Self, b: Self| both!(_mm256_div_pd, a, b);
    }

    impl Real for Avx2Doubles {
        const ZERO: Self = doubles(0.0);
        const ONE: Self = doubles(1.0);

        #[inline(always)]
        fn from_f64(value: f64) -> Self {
            doubles(value)
        }

        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: as above.
            unsafe { Self([_mm256_sqrt_pd(self.0[0]), _mm256_sqrt_pd(self.0[1])]) }
        }

        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: as above.
            both!(_mm256_max_pd, self, other)
        }

        #[inline(always)]
        fn min(self, other: Self) -> Self {
            // SAFETY: as above.
            both!(_mm256_min_pd, self, other)
        }

        #[inline(always)]
        fn choose(self, positive: Self, otherwise: Self) -> Self {
            // SAFETY: as above.
            unsafe {
                let zero = _mm256_setzero_pd();
                let mask = [
                    _mm256_cmp_pd::<_CMP_GT_OQ>(self.0[0], zero),
                    _mm256_cmp_pd::<_CMP_GT_OQ>(self.0[1], zero),
                ];
                Self([
                    _mm256_blendv_pd(otherwise.0[0], positive.0[0], mask[0]),
                    _mm256_blendv_pd(otherwise.0[1], positive.0[1], mask[1]),
                ])
            }
        }
    }
}
