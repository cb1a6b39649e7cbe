//! [`Counting`]: a number type that counts the operations of an algorithm while it runs.

use std::cell::Cell;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use drystone_solver::Real;

thread_local! {
    static OPERATIONS: Cell<u64> = const { Cell::new(0) };
}

/// A number that counts the operations on it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Counting(pub f64);

impl Counting {
    fn new(value: f64) -> Self {
        OPERATIONS.set(OPERATIONS.get() + 1);
        Self(value)
    }

    /// Returns the number of operations of some work.
    pub(crate) fn during(work: impl FnOnce()) -> u64 {
        let before = OPERATIONS.get();
        work();
        OPERATIONS.get() - before
    }
}

macro_rules! counting {
    ($($operator:ident $method:ident),*) => {$(
        impl $operator for Counting {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                Self::new(self.0.$method(other.0))
            }
        }
    )*};
}

counting!(Sub sub, Mul mul, Div div);

/// Adding `NEG_ZERO`, the value of an empty sum, is not counted.
impl Add for Counting {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        match (self, other) {
            (Self::NEG_ZERO, number) | (number, Self::NEG_ZERO) => number,
            _ => Self::new(self.0 + other.0),
        }
    }
}

impl Neg for Counting {
    type Output = Self;
    fn neg(self) -> Self {
        Self::new(-self.0)
    }
}

impl AddAssign for Counting {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Counting {
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl Real for Counting {
    const ZERO: Self = Self(0.0);
    const ONE: Self = Self(1.0);
    /// Too small to change a sum, and not a result of counted operations.
    const NEG_ZERO: Self = Self(-5e-324);

    fn from_f64(value: f64) -> Self {
        Self(value)
    }

    fn sqrt(self) -> Self {
        Self::new(self.0.sqrt())
    }

    fn max(self, other: Self) -> Self {
        Self::new(Real::max(self.0, other.0))
    }

    fn min(self, other: Self) -> Self {
        Self::new(Real::min(self.0, other.0))
    }

    fn choose(self, positive: Self, otherwise: Self) -> Self {
        Self::new(self.0.choose(positive.0, otherwise.0))
    }
}
