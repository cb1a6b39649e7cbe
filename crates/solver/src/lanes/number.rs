//! [`Lanes`]: sixteen numbers in SIMD lanes, which the kernels process as one [`Real`].
//!
//! There are sixteen lanes on every target, so layout and bits never depend on the machine. They are
//! stored as [`Portable`], an array. Passes view them in the registers of the machine, such as
//! [`Avx2`](super::Avx2). Each lane is an `f32` and rounds as one; no operation is fused or
//! approximate.
//!
//! Sixteen lanes suit a visit, which is a dependency chain: each point waits for the result of the
//! one before it. That wait is longer than the arithmetic of eight lanes, and the second register
//! fills it.
#![allow(unsafe_code)]

use std::ops::{Add, AddAssign, Div, Index, Mul, Neg, Sub, SubAssign};

use crate::{Cast, Real, Vector};

/// Number of lanes, on every target.
pub const WIDTH: usize = 16;

/// Half of the lanes.
pub(crate) const HALF: usize = WIDTH / 2;

/// Sixteen `f32` that go through the same operations.
pub trait Lanes: KernelLanes + Cast<Self::Doubles> + 'static {
    /// `f64` lanes for one part of these lanes ([`Cast::part`]): [`PART`] of them.
    type Doubles: Doubles;

    /// Lanes whose arithmetic changes only the first half of the numbers.
    type Half: KernelLanes;

    /// Sets the number in a lane.
    fn set(&mut self, lane: usize, number: f32);

    /// Returns the number in a lane.
    fn get(&self, lane: usize) -> f32;

    /// Runs `f` with the instructions that this type needs. Outside of `run`, arithmetic on the
    /// type is slow, and on [`Avx2`](super::Avx2) it is not allowed.
    fn run<R>(f: impl FnOnce() -> R) -> R;
}

/// [`Lanes`] or their [half](Lanes::Half): the number type of the kernels.
///
/// # Safety
/// The type has the layout of [`Portable`], and every bit pattern is valid.
pub unsafe trait KernelLanes: Real {
    /// Makes lanes of these numbers.
    fn from_array(numbers: [f32; WIDTH]) -> Self;

    /// Reads the first `count` numbers, up to four, of the row of each lane. Column i of the result
    /// holds number i of each lane; columns from `count` on are unspecified.
    ///
    /// # Safety
    /// `count` numbers can be read at each pointer.
    unsafe fn from_rows(rows: [*const f32; WIDTH], count: usize) -> [Self; 4];

    /// Returns the four numbers of each lane.
    fn to_rows(columns: [Self; 4]) -> [Row; WIDTH];
}

/// Four numbers of one lane.
pub type Row = [f32; 4];

/// Makes an array with a value for each lane. Its elements are written out, since a loop that is
/// not unrolled would go through memory.
#[macro_export]
macro_rules! each_lane {
    ($lane:ident => $of:expr) => {
        $crate::each_lane!($lane => $of; 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15)
    };
    ($name:ident => $of:expr; $($lane:literal)*) => {
        [$({ let $name = $lane; $of }),*]
    };
}

/// A single `f32`, or one in each lane. Code that gathers values is written once for both.
pub trait GatherLanes: Real {
    /// One value for each lane.
    type Each<T: Copy>: Copy + Index<usize, Output = T>;

    /// Returns the value of `of` for each lane, or for lane 0 if there is only one number.
    fn each<T: Copy>(of: impl Fn(usize) -> T) -> Self::Each<T>;

    /// Returns the number made of these numbers, one for each lane.
    fn gathered(numbers: Self::Each<f32>) -> Self;

    /// Returns the vector made of these vectors, one for each lane.
    fn gathered_vector<const N: usize>(of: Self::Each<&Vector<f32, N>>) -> Vector<Self, N>;
}

impl GatherLanes for f32 {
    type Each<T: Copy> = [T; 1];

    #[inline(always)]
    fn each<T: Copy>(of: impl Fn(usize) -> T) -> [T; 1] {
        [of(0)]
    }

    #[inline(always)]
    fn gathered([number]: [f32; 1]) -> Self {
        number
    }

    #[inline(always)]
    fn gathered_vector<const N: usize>([of]: [&Vector<f32, N>; 1]) -> Vector<Self, N> {
        *of
    }
}

impl<V: Lanes> GatherLanes for V {
    type Each<T: Copy> = [T; WIDTH];

    #[inline(always)]
    fn each<T: Copy>(of: impl Fn(usize) -> T) -> [T; WIDTH] {
        each_lane!(lane => of(lane))
    }

    #[inline(always)]
    fn gathered(numbers: [f32; WIDTH]) -> Self {
        V::from_array(numbers)
    }

    #[inline(always)]
    fn gathered_vector<const N: usize>(of: [&Vector<f32, N>; WIDTH]) -> Vector<Self, N> {
        let mut out = Vector::ZERO;
        // SAFETY: each vector is an array of `N` numbers.
        unsafe { gather(each_lane!(lane => of[lane].0.as_ptr()), &mut out.0) };
        out
    }
}

/// Returns the lanes in a set, which has one bit for each lane.
#[inline(always)]
pub(crate) fn lanes_of(mut set: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = set.trailing_zeros() as usize;
        set &= set.wrapping_sub(1);
        (lane < WIDTH).then_some(lane)
    })
}

/// Reads as many numbers for each lane as fit into `numbers`, up to eight. The numbers of a lane
/// are adjacent in memory.
///
/// # Safety
/// So many numbers can be read at each pointer.
#[inline(always)]
pub(crate) unsafe fn gather<V: KernelLanes>(from: [*const f32; WIDTH], numbers: &mut [V]) {
    let count = numbers.len();
    // SAFETY: as the caller promises. With more than four numbers, the last four overlap the first
    // four.
    unsafe {
        let first = V::from_rows(from, count);
        let row = count.min(4);
        numbers[..row].copy_from_slice(&first[..row]);
        if count > 4 {
            let last = V::from_rows(each_lane!(lane => from[lane].add(count - 4)), 4);
            numbers[4..].copy_from_slice(&last[8 - count..]);
        }
    }
}

/// Writes `numbers` to adjacent memory for each lane in the set `lanes`. There are up to eight
/// numbers; fewer than four are padded to four.
///
/// # Safety
/// So many numbers, and at least four, can be written at the pointer of each of these lanes.
#[inline(always)]
pub(crate) unsafe fn scatter<V: KernelLanes>(numbers: &[V], to: [*mut f32; WIDTH], lanes: u16) {
    let count = numbers.len();
    let after = count.saturating_sub(4);
    let mut columns = [[V::ZERO; 4]; 2];
    for i in 0..count {
        if i < 4 {
            columns[0][i] = numbers[i];
        }
        if i >= after {
            columns[1][i - after] = numbers[i];
        }
    }
    let (first, last) = (V::to_rows(columns[0]), V::to_rows(columns[1]));
    macro_rules! put {
        ($lane:expr) => {
            // SAFETY: as the caller promises.
            unsafe {
                to[$lane].cast::<Row>().write_unaligned(first[$lane]);
                if count > 4 {
                    to[$lane].add(after).cast::<Row>().write_unaligned(last[$lane]);
                }
            }
        };
    }
    if lanes == u16::MAX {
        each_lane!(lane => put!(lane));
    } else {
        each_lane!(lane => if lanes >> lane & 1 != 0 { put!(lane) });
    }
}

/// One or several `f64` that go through the same operations, within [`Lanes::run`].
pub trait Doubles: Real {
    /// Returns the number in a lane.
    fn get(&self, lane: usize) -> f64;
}

impl Doubles for f64 {
    #[inline(always)]
    fn get(&self, _: usize) -> f64 {
        *self
    }
}

/// Number of lanes in a part, which [`Lanes::Doubles`] holds.
pub const PART: usize = 8;

/// `N` numbers, or registers of numbers, of which operations change the first `USED`. The others
/// keep the value of the left operand. Every such type fills one cache line and is aligned to it.
///
/// The operations are loops: closures and `array::map` are not inlined into functions with other
/// target features.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct LaneArray<R, const N: usize, const USED: usize>(pub(super) [R; N]);

/// Applies an operation to each of the first `USED` members.
macro_rules! each {
    ($a:ident $(, $b:ident)*; $result:expr) => {{
        let mut out = $a;
        for i in 0..USED {
            let ($a, $($b),*) = ($a.0[i], $($b.0[i]),*);
            out.0[i] = $result;
        }
        out
    }};
}

macro_rules! operator {
    ($trait:ident $method:ident $operator:tt) => {
        impl<R: Real, const N: usize, const USED: usize> $trait for LaneArray<R, N, USED> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let a = self;
                each!(a, other; a $operator other)
            }
        }
    };
}

operator!(Add add +);
operator!(Sub sub -);
operator!(Mul mul *);
operator!(Div div /);

impl<R: Real, const N: usize, const USED: usize> AddAssign for LaneArray<R, N, USED> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<R: Real, const N: usize, const USED: usize> SubAssign for LaneArray<R, N, USED> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<R: Real, const N: usize, const USED: usize> Neg for LaneArray<R, N, USED> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        let a = self;
        each!(a; -a)
    }
}

impl<R: Real, const N: usize, const USED: usize> Default for LaneArray<R, N, USED> {
    fn default() -> Self {
        Self::ZERO
    }
}

impl<R: Real, const N: usize, const USED: usize> Real for LaneArray<R, N, USED> {
    const ZERO: Self = Self([R::ZERO; N]);
    const ONE: Self = Self([R::ONE; N]);
    const NEG_ZERO: Self = Self([R::NEG_ZERO; N]);

    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        Self([R::from_f64(value); N])
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        let a = self;
        each!(a; a.sqrt())
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        let a = self;
        each!(a, other; a.max(other))
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        let a = self;
        each!(a, other; a.min(other))
    }

    #[inline(always)]
    fn choose(self, positive: Self, otherwise: Self) -> Self {
        let a = self;
        each!(a, positive, otherwise; a.choose(positive, otherwise))
    }
}

/// Lanes that need no special instructions.
pub type Portable = LaneArray<f32, WIDTH, WIDTH>;

impl Cast<LaneArray<f64, PART, PART>> for Portable {
    const PARTS: usize = WIDTH / PART;

    #[inline(always)]
    fn part(&self, index: usize) -> LaneArray<f64, PART, PART> {
        let mut out = LaneArray::ZERO;
        for lane in 0..PART {
            out.0[lane] = f64::from(self.0[PART * index + lane]);
        }
        out
    }
}

impl Doubles for LaneArray<f64, PART, PART> {
    #[inline(always)]
    fn get(&self, lane: usize) -> f64 {
        self.0[lane]
    }
}

impl Lanes for Portable {
    type Doubles = LaneArray<f64, PART, PART>;
    type Half = LaneArray<f32, WIDTH, HALF>;

    #[inline(always)]
    fn set(&mut self, lane: usize, number: f32) {
        self.0[lane] = number;
    }

    #[inline(always)]
    fn get(&self, lane: usize) -> f32 {
        self.0[lane]
    }

    #[inline(always)]
    fn run<R>(f: impl FnOnce() -> R) -> R {
        f()
    }
}

// SAFETY: an array of sixteen `f32`.
unsafe impl<const USED: usize> KernelLanes for LaneArray<f32, WIDTH, USED> {
    #[inline(always)]
    fn from_array(numbers: [f32; WIDTH]) -> Self {
        Self(numbers)
    }

    #[inline(always)]
    unsafe fn from_rows(rows: [*const f32; WIDTH], count: usize) -> [Self; 4] {
        let mut columns = [Self::ZERO; 4];
        for (i, column) in columns.iter_mut().enumerate().take(count) {
            for (number, row) in column.0.iter_mut().zip(&rows).take(USED) {
                // SAFETY: as the caller promises.
                *number = unsafe { *row.add(i) };
            }
        }
        columns
    }

    #[inline(always)]
    fn to_rows(columns: [Self; 4]) -> [Row; WIDTH] {
        let mut rows = [[0.0; 4]; WIDTH];
        for (i, column) in columns.iter().enumerate() {
            for (row, number) in rows.iter_mut().zip(column.0).take(USED) {
                row[i] = number;
            }
        }
        rows
    }
}
