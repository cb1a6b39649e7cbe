//! [`Real`]: the number type of the kernels.
//!
//! The kernels are generic over `Real`: `f32` in worlds, `f64` in certificates and in methods that
//! factor matrices. There is no comparison that returns `bool`. Kernels choose with
//! [`max`](Real::max), [`min`](Real::min) and [`choose`](Real::choose), so that a type with several
//! numbers side by side can be a `Real` too.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// A number, or several numbers that undergo the same operations.
///
/// Every operation rounds once (IEEE 754). None is fused or approximate, so equal inputs give equal
/// bits on every machine.
pub trait Real:
    Copy
    + Debug
    + Default
    + PartialEq
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// -0, the start value of sums. x + -0 equals x bit for bit, so compilers drop the addition;
    /// x + 0 has other bits if x is -0.
    const NEG_ZERO: Self;

    /// Returns the nearest value of this type.
    fn from_f64(value: f64) -> Self;

    /// Returns the square root.
    fn sqrt(self) -> Self;

    /// Returns `self` if it is greater than `other`, else `other`.
    fn max(self, other: Self) -> Self;

    /// Returns `self` if it is less than `other`, else `other`.
    fn min(self, other: Self) -> Self;

    /// Returns `positive` if `self > 0`, else `otherwise`.
    fn choose(self, positive: Self, otherwise: Self) -> Self;
}

/// A single number, which can be compared and read.
pub trait Scalar: Real + PartialOrd {
    /// Distance from 1 to the next larger number.
    const EPSILON: f64;

    /// Returns the value as `f64`.
    fn to_f64(self) -> f64;
}

/// Conversion to the nearest value of another number type: of a scalar as a whole, of several
/// numbers side by side in parts.
pub trait Cast<U> {
    /// Number of parts.
    const PARTS: usize;

    /// Converts part `index`.
    fn part(&self, index: usize) -> U;
}

impl<T: Scalar, U: Real> Cast<U> for T {
    const PARTS: usize = 1;

    #[inline(always)]
    fn part(&self, _: usize) -> U {
        U::from_f64(self.to_f64())
    }
}

macro_rules! scalar {
    ($t:ty) => {
        impl Real for $t {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            const NEG_ZERO: Self = -0.0;

            #[inline(always)]
            fn from_f64(value: f64) -> Self {
                value as $t
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                <$t>::sqrt(self)
            }

            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if self > other { self } else { other }
            }

            #[inline(always)]
            fn min(self, other: Self) -> Self {
                if self < other { self } else { other }
            }

            #[inline(always)]
            fn choose(self, positive: Self, otherwise: Self) -> Self {
                if self > 0.0 { positive } else { otherwise }
            }
        }

        impl Scalar for $t {
            const EPSILON: f64 = <$t>::EPSILON as f64;

            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
        }
    };
}

scalar!(f32);
scalar!(f64);
