//! Rotations in space, and bodies that turn freely. Written once over [`Real`]; [`Eight`] turns eight bodies at
//! once, since one alone waits for itself: each of its numbers needs the one before.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use drystone_solver::{Real, SymmetricMatrix, Vector, moment};
use wide::f32x8;

/// A unit quaternion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Quaternion<T: Real> {
    pub(super) axis: Vector<T, 3>,
    pub(super) w: T,
}

impl<T: Angle> Quaternion<T> {
    /// Turns by a rotation vector \[rad\].
    pub(super) fn versor(turn: Vector<T, 3>) -> Self {
        let squared = turn.dot(turn);
        Self { axis: turn * squared.half_sine_over_angle(), w: squared.half_cosine() }
    }

    fn inverse(self) -> Self {
        Self { axis: -self.axis, w: self.w }
    }

    fn normalized(self) -> Self {
        let scale = T::ONE / (self.axis.dot(self.axis) + self.w * self.w).sqrt();
        Self { axis: self.axis * scale, w: self.w * scale }
    }

    /// This rotation after another.
    pub(super) fn after(self, other: Self) -> Self {
        let across: Vector<T, 3> = moment(self.axis, other.axis);
        let axis = self.axis * other.w + other.axis * self.w + across;
        Self { axis, w: self.w * other.w - self.axis.dot(other.axis) }.normalized()
    }

    /// q v q^-1 - v.
    fn twist(self, v: Vector<T, 3>) -> Vector<T, 3> {
        let across: Vector<T, 3> = moment(self.axis, v) * T::from_f64(2.0);
        let back: Vector<T, 3> = moment(self.axis, across);
        across * self.w + back
    }

    fn turned(self, v: Vector<T, 3>) -> Vector<T, 3> {
        v + self.twist(v)
    }
}

/// [`Geometry::precess`](super::Geometry::precess).
#[inline]
pub(super) fn precess<T: Angle>(
    q: Quaternion<T>,
    [moments, inverse_moments]: [SymmetricMatrix<T, 3>; 2],
    omega: Vector<T, 3>,
    h: T,
) -> (Quaternion<T>, Vector<T, 3>) {
    // All as the body sees it, where I stays and L turns the other way; in differences, which keep what rounding
    // would take from sums.
    let seen = q.inverse().turned(omega);
    let momentum = moments * seen;
    let half = Quaternion::versor(seen * (T::from_f64(0.5) * h));
    let middle = half.turned(inverse_moments * half.inverse().turned(momentum));
    let turn = Quaternion::versor(middle * h);
    let own = inverse_moments * turn.inverse().twist(momentum);
    let end = inverse_moments * momentum + own;
    let change = q.turned(own + turn.twist(end));
    (q.after(turn), change)
}

/// The square of an angle t.
pub(super) trait Angle: Real {
    /// sin(t/2)/t.
    fn half_sine_over_angle(self) -> Self;

    /// cos(t/2).
    fn half_cosine(self) -> Self;
}

/// Squares of angles for which series will do: their error is below one rounding.
const SMALL: f32 = 0.25;

/// a - x (b - x (c - x d)).
fn series<T: Real>(x: T, [a, b, c, d]: [f64; 4]) -> T {
    T::from_f64(a) - x * (T::from_f64(b) - x * (T::from_f64(c) - x * T::from_f64(d)))
}

fn sine_series<T: Real>(squared: T) -> T {
    series(squared, [0.5, 1.0 / 48.0, 1.0 / 3840.0, 1.0 / 645_120.0])
}

fn cosine_series<T: Real>(squared: T) -> T {
    series(squared, [1.0, 1.0 / 8.0, 1.0 / 384.0, 1.0 / 46_080.0])
}

impl Angle for f32 {
    fn half_sine_over_angle(self) -> Self {
        if self < SMALL {
            return sine_series(self);
        }
        let angle = self.sqrt();
        libm::sinf(0.5 * angle) / angle
    }

    fn half_cosine(self) -> Self {
        if self < SMALL { cosine_series(self) } else { libm::cosf(0.5 * self.sqrt()) }
    }
}

/// An array with an item for each lane, written out, since a loop would go through memory.
macro_rules! each_eight {
    ($lane:ident => $of:expr) => {
        drystone_solver::each_lane!($lane => $of; 0 1 2 3 4 5 6 7)
    };
}
pub(super) use each_eight;

/// Eight numbers side by side; each goes through what a single one would.
#[derive(Clone, Copy, Default, PartialEq, Debug)]
pub(super) struct Eight(f32x8);

impl Eight {
    #[inline(always)]
    pub(super) fn new(numbers: [f32; 8]) -> Self {
        Self(f32x8::new(numbers))
    }

    /// A vector of each lane.
    #[inline(always)]
    pub(super) fn vector(of: [Vector<f32, 3>; 8]) -> Vector<Self, 3> {
        let along = |i: usize| Self::new(each_eight!(lane => of[lane][i]));
        Vector([along(0), along(1), along(2)])
    }

    #[inline(always)]
    pub(super) fn get(&self, lane: usize) -> f32 {
        self.0.as_array()[lane]
    }

    /// That of a lane.
    #[inline(always)]
    pub(super) fn of_lane(vector: &Vector<Self, 3>, lane: usize) -> Vector<f32, 3> {
        let [x, y, z] = &vector.0;
        Vector([x.get(lane), y.get(lane), z.get(lane)])
    }

    /// The same of all, but for large angles.
    fn unless_large(self, all: Self, one: fn(f32) -> f32) -> Self {
        if !self.0.simd_ge(f32x8::splat(SMALL)).any() {
            return all;
        }
        Self::new(self.0.to_array().map(one))
    }
}

impl Angle for Eight {
    fn half_sine_over_angle(self) -> Self {
        self.unless_large(sine_series(self), f32::half_sine_over_angle)
    }

    fn half_cosine(self) -> Self {
        self.unless_large(cosine_series(self), f32::half_cosine)
    }
}

macro_rules! operators {
    ($($trait:ident $name:ident),*) => {
        $(impl $trait for Eight {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Self(self.0.$name(other.0))
            }
        })*
    };
}

operators!(Add add, Sub sub, Mul mul, Div div);

impl Neg for Eight {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl AddAssign for Eight {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Eight {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl Real for Eight {
    const ZERO: Self = Self(f32x8::new([0.0; 8]));
    const ONE: Self = Self(f32x8::new([1.0; 8]));
    const NOTHING: Self = Self(f32x8::new([-0.0; 8]));

    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        Self(f32x8::splat(value as f32))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0.simd_gt(other.0).bitselect(self.0, other.0))
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.simd_lt(other.0).bitselect(self.0, other.0))
    }

    #[inline(always)]
    fn choose(self, positive: Self, otherwise: Self) -> Self {
        Self(self.0.simd_gt(f32x8::ZERO).bitselect(positive.0, otherwise.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::Random;

    #[test]
    fn eight_turn_as_one_does() {
        let mut random = Random(7);
        for speed in [1e-3, 1.0, 60.0, 3000.0] {
            let bodies: [_; 8] = std::array::from_fn(|_| {
                let q = Quaternion::versor(random.vector() * 2.0);
                let [x, y, z] = random.vector().0.map(|x| 1.5 + x);
                let diagonal = |of: [f32; 3]| {
                    SymmetricMatrix(std::array::from_fn(|i| {
                        Vector(std::array::from_fn(|j| if i == j { of[i] } else { 0.01 * of[2] }))
                    }))
                };
                let moments = [diagonal([x, y, z]), diagonal([1.0 / x, 1.0 / y, 1.0 / z])];
                (q, moments, random.vector() * speed)
            });
            let matrix = |which: usize| {
                let row =
                    |i: usize| Eight::vector(bodies.map(|(_, moments, _)| moments[which].0[i]));
                SymmetricMatrix([row(0), row(1), row(2)])
            };
            let axis = Eight::vector(bodies.map(|(q, ..)| q.axis));
            let q = Quaternion { axis, w: Eight::new(bodies.map(|(q, ..)| q.w)) };
            let omega = Eight::vector(bodies.map(|(.., omega)| omega));
            let h = 1.0 / 240.0;
            let (all, change) = precess(q, [0, 1].map(matrix), omega, Real::from_f64(h));
            for (lane, (q, moments, omega)) in bodies.into_iter().enumerate() {
                let one = precess(q, moments, omega, h as f32);
                let same = Quaternion { axis: Eight::of_lane(&all.axis, lane), w: all.w.get(lane) };
                assert_eq!((same, Eight::of_lane(&change, lane)), one, "{speed} rad/s");
            }
        }
    }
}
