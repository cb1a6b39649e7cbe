//! [`Lanes`]: sixteen numbers in SIMD lanes, which the kernels process as one [`Real`].
//!
//! There are sixteen lanes on every target, so layout and bits never depend on the machine.
//! [`Avx2`] holds them in two registers, [`Portable`] in an array that the compiler vectorizes as
//! it can. Each lane is an `f32` and rounds as one; no operation is fused or approximate.
//!
//! Sixteen lanes suit a visit, which is a dependency chain: each point waits for the result of the
//! one before it. That wait is longer than the arithmetic of eight lanes, and the second register
//! fills it.
//!
//! Unsafe code is confined to this module with its entry point [`Lanes::run`], to
//! [`thread_pool`](crate::thread_pool), and to `wide/walk.rs` and `wide/gather.rs`.
#![allow(unsafe_code)]

use std::ops::{Add, AddAssign, Div, Index, Mul, Neg, Sub, SubAssign};

use crate::{Cast, Real, Vector};

/// Number of lanes, on every target.
pub const WIDTH: usize = 16;

/// Half of the lanes.
pub(crate) const HALF: usize = WIDTH / 2;

/// Sixteen `f32` that go through the same operations.
///
/// # Safety
/// [`Half`](Self::Half) has the layout of this type, and every bit pattern that is valid for one of
/// them is valid for the other.
pub unsafe trait Lanes: KernelLanes + Cast<Self::Doubles> + 'static {
    /// `f64` lanes for one part of these lanes ([`Cast::part`]): [`PART`] of them.
    type Doubles: Doubles;

    /// A type of the same layout, whose arithmetic changes only the first half of the lanes.
    type Half: KernelLanes;

    /// Sets the number in a lane.
    fn set(&mut self, lane: usize, number: f32);

    /// Returns the number in a lane.
    fn get(&self, lane: usize) -> f32;

    /// Runs `f` with the instructions that this type needs. Outside of `run`, arithmetic on the
    /// type is slow, and on [`Avx2`] it is not allowed.
    fn run<R>(f: impl FnOnce() -> R) -> R;
}

/// [`Lanes`] or their [half](Lanes::Half): the number type of the kernels.
pub trait KernelLanes: Real {
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

/// Views a value made of lanes as one made of [half](Lanes::Half) lanes.
///
/// # Safety
/// The two types differ only in their lanes, and their layout is fixed (`repr(C)`).
#[inline(always)]
pub(crate) unsafe fn halved<T, U>(of: &T) -> &U {
    const { assert!(size_of::<T>() == size_of::<U>() && align_of::<T>() == align_of::<U>()) };
    // SAFETY: both types have the same bytes, as the caller promises.
    unsafe { &*std::ptr::from_ref(of).cast() }
}

/// Views a slice as [`halved`] does.
///
/// # Safety
/// The conditions of [`halved`] hold.
#[inline(always)]
pub(crate) unsafe fn halved_mut<T, U>(of: &mut [T]) -> &mut [U] {
    const { assert!(size_of::<T>() == size_of::<U>() && align_of::<T>() == align_of::<U>()) };
    // SAFETY: both types have the same bytes, as the caller promises.
    unsafe { std::slice::from_raw_parts_mut(of.as_mut_ptr().cast(), of.len()) }
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
pub struct LaneArray<R, const N: usize, const USED: usize>([R; N]);

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

// SAFETY: both types are arrays of sixteen `f32`.
unsafe impl Lanes for Portable {
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

impl<const USED: usize> KernelLanes for LaneArray<f32, WIDTH, USED> {
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

#[cfg(target_arch = "x86_64")]
pub use avx2::{Avx2, available as avx2_available};

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;
    use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

    use super::{Doubles, KernelLanes, LaneArray, Lanes, PART, Row, WIDTH};
    use crate::{Cast, Real};

    /// Lanes in AVX2 registers. Values can be created and moved anywhere; arithmetic must happen
    /// within [`Lanes::run`].
    pub type Avx2 = LaneArray<Floats, 2, 2>;

    /// Returns whether this machine has AVX2.
    pub fn available() -> bool {
        std::arch::is_x86_feature_detected!("avx2")
    }

    #[target_feature(enable = "avx2")]
    fn enter<R>(f: impl FnOnce() -> R) -> R {
        f()
    }

    // SAFETY: both types are two registers.
    unsafe impl Lanes for Avx2 {
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
            assert!(available(), "Avx2 lanes need a machine with AVX2");
            // SAFETY: the machine has AVX2, as just asserted.
            unsafe { enter(f) }
        }
    }

    impl<const USED: usize> KernelLanes for LaneArray<Floats, 2, USED> {
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
}
