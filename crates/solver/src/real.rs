//! [`Real`]: the number type of the kernels.
//!
//! The kernels are generic over `Real`: `f32` in worlds, `f64` in certificates and in methods that
//! factor matrices. There is no comparison that returns `bool`. Kernels choose with
//! [`max`](Real::max), [`min`](Real::min) and [`choose`](Real::choose), so that a type with several
//! numbers side by side can be a `Real` too.

use std::f64::consts::{LN_2, SQRT_2};
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

/// Returns the natural logarithm from IEEE operations alone, to within 2 units in the last place.
///
/// The standard library's differs between platforms in the last bit, and predictions of
/// iterations decide about methods.
pub(crate) fn ln(x: f64) -> f64 {
    if x == 0.0 || x == f64::INFINITY {
        return if x == 0.0 { f64::NEG_INFINITY } else { x };
    }
    if x.is_nan() || x < 0.0 {
        return f64::NAN;
    }
    // x = m 2^e with m between sqrt(1/2) and sqrt(2). Subnormal numbers are scaled first.
    let shift = if x < f64::MIN_POSITIVE { 54 } else { 0 };
    let bits = (x * (1u64 << shift) as f64).to_bits();
    let mut exponent = (bits >> 52) as i32 - 1023 - shift;
    let mut mantissa = f64::from_bits(bits & ((1 << 52) - 1) | 1.0f64.to_bits());
    if mantissa > SQRT_2 {
        mantissa *= 0.5;
        exponent += 1;
    }
    // ln m = 2 artanh s = 2 (s + s^3 / 3 + s^5 / 5 + ...), where s = (m - 1) / (m + 1) is at most
    // 0.172. The first term left out is below 1e-19 of the sum.
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let tail = (1..12).rev().fold(0.0, |sum, k| (sum + 1.0 / f64::from(2 * k + 1)) * s * s);
    f64::from(exponent) * LN_2 + (2.0 * s + 2.0 * s * tail)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The logarithm is that of the standard library to within rounding, subnormal numbers
    /// included.
    #[test]
    fn logarithms_are_those_of_the_standard_library() {
        let check = |x: f64| {
            let (own, other) = (ln(x), f64::ln(x));
            assert!((own - other).abs() <= 4.0 * f64::EPSILON * other.abs(), "{own} of {x:e}");
        };
        let mut x = 5e-324;
        while x < f64::MAX {
            check(x);
            x *= if x < 1e-300 { 1.9 } else { 1.003 };
        }
        [1.0 - 1e-10, 1.0 + 1e-10, 1.0 + f64::EPSILON].into_iter().for_each(check);
        assert_eq!((ln(0.0), ln(1.0)), (f64::NEG_INFINITY, 0.0));
        assert_eq!(ln(f64::INFINITY), f64::INFINITY);
        assert!(ln(f64::NAN).is_nan() && ln(-1.0).is_nan());
    }
}
