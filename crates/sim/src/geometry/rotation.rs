//! Rotations in 3D, and the free rotation of rigid bodies, generic over [`Real`]. [`Eight`] rotates
//! eight bodies at once: the computation for one body is a single chain of dependent operations.

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

impl Quaternion<f32> {
    /// Returns the rotation by a rotation vector \[rad\].
    pub(super) fn versor(turn: Vector<f32, 3>) -> Self {
        let squared = turn.dot(turn);
        Self { axis: turn * half_sine_over_angle(squared), w: half_cosine(squared) }
    }
}

impl<T: Real> Quaternion<T> {
    fn inverse(self) -> Self {
        Self { axis: -self.axis, w: self.w }
    }

    fn normalized(self) -> Self {
        let scale = T::ONE / (self.axis.dot(self.axis) + self.w * self.w).sqrt();
        Self { axis: self.axis * scale, w: self.w * scale }
    }

    /// Returns this rotation after another.
    pub(super) fn after(self, other: Self) -> Self {
        let across: Vector<T, 3> = moment(self.axis, other.axis);
        let axis = self.axis * other.w + other.axis * self.w + across;
        Self { axis, w: self.w * other.w - self.axis.dot(other.axis) }.normalized()
    }

    /// Returns q v q^-1 - v.
    fn twist(self, v: Vector<T, 3>) -> Vector<T, 3> {
        let across: Vector<T, 3> = moment(self.axis, v) * T::from_f64(2.0);
        let back: Vector<T, 3> = moment(self.axis, across);
        across * self.w + back
    }

    fn turned(self, v: Vector<T, 3>) -> Vector<T, 3> {
        v + self.twist(v)
    }
}

/// Iterations of the fixed point of [`middle`] at small angles; the error is of fifth order in the
/// angle.
const ROUNDS: usize = 3;

/// Iterations of the fixed point in [`precess_finely`], for angles up to [`FINE`]; the error is
/// below the rounding of `f64`.
const FINE_ROUNDS: usize = 9;

/// Largest angle of a substep in [`precess_finely`]. \[rad\]
const FINE: f64 = 1.0 / 16.0;

/// Fractions of h for three midpoint steps in sequence, which together are of fourth order: 1 /
/// (2 - c), -c / (2 - c) and 1 / (2 - c), with c the cube root of 2. Reference: Yoshida,
/// Construction of higher order symplectic integrators, 1990.
const FOURTH_ORDER: [f64; 3] =
    [1.351_207_191_959_657_8, -1.702_414_383_919_315_3, 1.351_207_191_959_657_8];

/// Largest number of substeps: a rotation of 32 rad. A faster body rotates no farther in a step.
const PARTS: usize = 512;

/// Returns the mean angular velocity omega_m of a free rotation for `h`, in body axes, and s h / 2.
/// It solves the implicit midpoint rule by fixed-point iteration,
///
/// Pi' - Pi = s h Pi_m x omega_m, with Pi_m = (Pi + Pi') / 2 and omega_m = I^-1 Pi_m.
///
/// The rule conserves |Pi| and the energy exactly, for any number s, since the change is
/// perpendicular to both Pi_m and omega_m. Pi' is Pi rotated back about omega_m by twice the arc
/// tangent of s h |omega_m| / 2, the Cayley map. s is chosen so that this angle is h |omega| for a
/// steady rotation, with a relative error of sixth order. References: Austin, Krishnaprasad and
/// Wang, Almost Poisson integration of rigid body systems, 1993; Simo and Wong, Unconditionally
/// stable algorithms for rigid body dynamics, 1991.
#[inline(always)]
fn middle<T: Real>(
    seen: Vector<T, 3>,
    momentum: Vector<T, 3>,
    inverse_moments: SymmetricMatrix<T, 3>,
    h: T,
    rounds: usize,
) -> (Vector<T, 3>, T) {
    let (angle, half) = (seen * h, T::from_f64(0.5) * h);
    let squared = angle.dot(angle);
    let fourth = T::from_f64(1.0 / 12.0) + squared * T::from_f64(1.0 / 120.0);
    let half = half + half * (squared * fourth);
    let (mut turning, mut turned) = (seen, momentum);
    for _ in 0..rounds {
        let change: Vector<T, 3> = moment(turned, turning);
        let change = change * half;
        (turning, turned) = (seen + inverse_moments * change, momentum + change);
    }
    (turning, half)
}

/// Returns q v q^-1 - v for q with this axis and w = 1, which need not be of unit length.
#[inline(always)]
fn cayley_twist<T: Real>(axis: Vector<T, 3>, v: Vector<T, 3>) -> Vector<T, 3> {
    let across: Vector<T, 3> = moment(axis, v);
    let back: Vector<T, 3> = moment(axis, across);
    (across + back) * (T::from_f64(2.0) / (T::ONE + axis.dot(axis)))
}

/// Rotates one body freely by a small angle; see [`Geometry::precess`](super::Geometry::precess).
/// Returns the new attitude, and the change of the angular velocity.
#[inline]
pub(super) fn precess<T: Real>(
    q: Quaternion<T>,
    [moments, inverse_moments]: [SymmetricMatrix<T, 3>; 2],
    omega: Vector<T, 3>,
    h: T,
) -> (Quaternion<T>, Vector<T, 3>) {
    // Compute in body axes, in which I is constant and L rotates the other way. Compute
    // differences, since sums would lose digits to rounding.
    let seen = q.inverse().turned(omega);
    let momentum = moments * seen;
    let (turning, half) = middle(seen, momentum, inverse_moments, h, ROUNDS);
    let axis = turning * half;
    let own = inverse_moments * cayley_twist(-axis, momentum);
    let change = q.turned(own + cayley_twist(axis, seen + own));
    (q.after(Quaternion { axis, w: T::ONE }), change)
}

/// State after a free rotation: the attitude, the angular velocity, and the rounding error left out
/// of that velocity.
pub(super) type Turned = (Quaternion<f32>, [Vector<f32, 3>; 2]);

/// Rotates one body freely by any angle. It computes in double precision for slender bodies: the
/// energy of their rotation about one axis is sensitive to rounding in the rotation about the
/// others. `omega` is the angular velocity, and the rounding error left out of it.
pub(super) fn precess_finely(
    q: Quaternion<f32>,
    moments: &SymmetricMatrix<f32, 3>,
    omega: [Vector<f32, 3>; 2],
    rate: f32,
    h: f32,
) -> Turned {
    let exact =
        |q: Quaternion<f32>| Quaternion { axis: q.axis.cast(), w: f64::from(q.w) }.normalized();
    let (from, moments) = (exact(q), moments.cast::<f64>());
    let inverse_moments = moments.inverse().unwrap_or(SymmetricMatrix::ZERO);
    let mut seen = from.inverse().turned(omega[0].cast::<f64>() + omega[1].cast());
    let (mut to, mut left) = (from, f64::from(h));
    for _ in 0..PARTS {
        let part = left.min(FINE / (f64::from(rate) * seen.length()));
        for stage in FOURTH_ORDER {
            let momentum = moments * seen;
            let (turning, half) =
                middle(seen, momentum, inverse_moments, stage * part, FINE_ROUNDS);
            let axis = turning * half;
            seen += inverse_moments * cayley_twist(-axis, momentum);
            to = to.after(Quaternion { axis, w: 1.0 });
        }
        left -= part;
        if left <= 0.0 {
            break;
        }
    }
    let to = Quaternion { axis: to.axis.cast(), w: to.w as f32 };
    // Use the rounded attitude: then rounding rotates the body, but changes neither its energy nor
    // |L|.
    let end = exact(to).turned(seen);
    let omega = end.cast();
    (to, [omega, (end - omega.cast()).cast()])
}

/// Squares of angles below this use series, whose error is less than one rounding. \[rad^2\]
const SMALL: f32 = 0.25;

/// Returns a - x (b - x (c - x d)).
fn series(x: f32, [a, b, c, d]: [f32; 4]) -> f32 {
    a - x * (b - x * (c - x * d))
}

fn sine_series(squared: f32) -> f32 {
    series(squared, [0.5, 1.0 / 48.0, 1.0 / 3840.0, 1.0 / 645_120.0])
}

fn cosine_series(squared: f32) -> f32 {
    series(squared, [1.0, 1.0 / 8.0, 1.0 / 384.0, 1.0 / 46_080.0])
}

/// Returns sin(t/2)/t from the square of the angle t.
fn half_sine_over_angle(squared: f32) -> f32 {
    if squared < SMALL {
        return sine_series(squared);
    }
    let angle = squared.sqrt();
    libm::sinf(0.5 * angle) / angle
}

/// Returns cos(t/2) from the square of the angle t.
fn half_cosine(squared: f32) -> f32 {
    if squared < SMALL { cosine_series(squared) } else { libm::cosf(0.5 * squared.sqrt()) }
}

/// Builds an array with one item per lane. It is unrolled, since a loop would go through memory.
macro_rules! each_eight {
    ($lane:ident => $of:expr) => {
        drystone_solver::each_lane!($lane => $of; 0 1 2 3 4 5 6 7)
    };
}
pub(super) use each_eight;

/// Eight numbers side by side. Each lane gets the result that it would get alone, bit for bit.
#[derive(Clone, Copy, Default, PartialEq, Debug)]
pub(super) struct Eight(f32x8);

impl Eight {
    #[inline(always)]
    pub(super) fn new(numbers: [f32; 8]) -> Self {
        Self(f32x8::new(numbers))
    }

    /// Packs one vector per lane.
    #[inline(always)]
    pub(super) fn vector(of: [Vector<f32, 3>; 8]) -> Vector<Self, 3> {
        let along = |i: usize| Self::new(each_eight!(lane => of[lane][i]));
        Vector([along(0), along(1), along(2)])
    }

    #[inline(always)]
    pub(super) fn get(&self, lane: usize) -> f32 {
        self.0.as_array()[lane]
    }

    /// Returns the vector of a lane.
    #[inline(always)]
    pub(super) fn of_lane(vector: &Vector<Self, 3>, lane: usize) -> Vector<f32, 3> {
        let [x, y, z] = &vector.0;
        Vector([x.get(lane), y.get(lane), z.get(lane)])
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
    const NEG_ZERO: Self = Self(f32x8::new([-0.0; 8]));

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
    fn eight_bodies_rotate_as_one_does() {
        let mut random = Random(7);
        // Faster bodies are rotated one by one, in substeps.
        for speed in [1e-3, 1.0, 7.0] {
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
