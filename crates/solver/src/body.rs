//! What the solver knows of a body: how fast it moves, and how hard it is to move.

use std::ops::{Add, AddAssign, Mul, Range, Sub, SubAssign};

use crate::vector::spin;
use crate::{Cast, Real, Scalar, SymmetricMatrix, Vector, moment};

/// Linear and angular velocity of a body: one block of the notes' column v.
///
/// The same pair serves as a displacement (velocity times time), since J maps both alike. Laid out so that
/// the numbers of a body come into registers of four in one go ([`Lanes`](crate::lanes::Lanes)).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(16))]
pub struct Velocity<T: Real, const L: usize, const A: usize> {
    /// Of the center of mass. \[m/s\]
    pub linear: Vector<T, L>,
    /// About the center of mass, world axes. \[rad/s\]
    pub angular: Vector<T, A>,
}

impl<T: Real, const L: usize, const A: usize> Velocity<T, L, A> {
    /// At rest.
    pub const ZERO: Self = Self { linear: Vector::ZERO, angular: Vector::ZERO };
    /// Where sums begin ([`Real::NEG_ZERO`]).
    pub(crate) const NEG_ZERO: Self = Self { linear: Vector::NEG_ZERO, angular: Vector::NEG_ZERO };

    /// v . p: of a velocity and a momentum, a power times a time. \[J\]
    #[inline(always)]
    pub fn dot(&self, other: &Self) -> T {
        self.linear.dot(other.linear) + self.angular.dot(other.angular)
    }

    /// A part of it in another number.
    #[inline(always)]
    pub(crate) fn part<U: Real>(&self, index: usize) -> Velocity<U, L, A>
    where
        T: Cast<U>,
    {
        Velocity { linear: self.linear.part(index), angular: self.angular.part(index) }
    }

    /// Velocity \[m/s\] of the point at the lever arm `r` \[m\]: v + omega x r.
    #[inline(always)]
    pub fn at(&self, r: Vector<T, L>) -> Vector<T, L> {
        if A == 0 { self.linear } else { self.linear + spin(self.angular, r) }
    }
}

impl<T: Scalar, const L: usize, const A: usize> Velocity<T, L, A> {
    /// The same in another number.
    #[inline(always)]
    pub fn cast<U: Real>(&self) -> Velocity<U, L, A> {
        self.part(0)
    }
}

impl<T: Real, const L: usize, const A: usize> Add for Velocity<T, L, A> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { linear: self.linear + other.linear, angular: self.angular + other.angular }
    }
}

impl<T: Real, const L: usize, const A: usize> Sub for Velocity<T, L, A> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { linear: self.linear - other.linear, angular: self.angular - other.angular }
    }
}

impl<T: Real, const L: usize, const A: usize> Mul<T> for Velocity<T, L, A> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, scale: T) -> Self {
        Self { linear: self.linear * scale, angular: self.angular * scale }
    }
}

impl<T: Real, const L: usize, const A: usize> AddAssign for Velocity<T, L, A> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<T: Real, const L: usize, const A: usize> SubAssign for Velocity<T, L, A> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

/// Some components of a twist or a wrench.
#[derive(Clone, Debug)]
pub(crate) struct TwistAxes {
    pub(crate) linear: Range<usize>,
    pub(crate) angular: Range<usize>,
}

/// All of them.
pub(crate) const fn all_axes<const L: usize, const A: usize>() -> TwistAxes {
    TwistAxes { linear: 0..L, angular: 0..A }
}

/// What impulses along normals do and feel: the velocity along the normal, and turning that tilts it.
pub(crate) const fn along_normals<const A: usize>() -> TwistAxes {
    TwistAxes { linear: 0..1, angular: A / 3..A }
}

/// What impulses of friction do and feel: the rest.
pub(crate) const fn along_tangents<const L: usize, const A: usize>() -> TwistAxes {
    TwistAxes { linear: 1..L, angular: 0..A / 3 }
}

/// One block of M: (m, I), the latter in world axes. Zero for what nothing can move, and along what is
/// locked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mass<const L: usize, const A: usize> {
    /// m. \[kg\]
    pub linear: f64,
    /// I = R I_0 R^T. \[kg m^2\]
    pub angular: SymmetricMatrix<f64, A>,
}

impl<const L: usize, const A: usize> Mass<L, A> {
    /// Of what nothing can move.
    pub const ZERO: Self = Self { linear: 0.0, angular: SymmetricMatrix::ZERO };

    /// M v: the momentum of a body at this velocity. \[N s, N m s\]
    #[inline(always)]
    pub fn momentum(&self, v: &Velocity<f64, L, A>) -> Velocity<f64, L, A> {
        Velocity { linear: v.linear * self.linear, angular: self.angular * v.angular }
    }

    /// Adds to what the error of an island is measured by: mass \[kg\], or, less than 0 as long as there is none, moments
    /// of inertia of bodies that only turn \[kg m^2\].
    #[inline(always)]
    pub(crate) fn add_measure(&self, measure: &mut f64) {
        if self.linear > 0.0 {
            *measure = measure.max(0.0) + self.linear;
        } else if *measure <= 0.0 {
            *measure -= (0..A).map(|i| self.angular.0[i][i]).sum::<f64>();
        }
    }

    /// v . M v: twice the kinetic energy. \[J\]
    #[inline(always)]
    pub fn squared(&self, v: &Velocity<f64, L, A>) -> f64 {
        v.dot(&self.momentum(v))
    }
}

/// One block of M^-1: (m^-1, I^-1), the latter in world axes. Zero for what nothing can move.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct InverseMass<T: Real, const L: usize, const A: usize> {
    /// m^-1. \[1/kg\]
    pub linear: T,
    /// W = R I_0^-1 R^T. \[1/(kg m^2)\]
    pub angular: SymmetricMatrix<T, A>,
}

impl<T: Real, const L: usize, const A: usize> InverseMass<T, L, A> {
    /// Of a body that nothing can move.
    pub const FIXED: Self = Self { linear: T::ZERO, angular: SymmetricMatrix::ZERO };

    /// M^-1 p: the velocity that a momentum gives. \[m/s, rad/s\]
    #[inline(always)]
    pub fn velocity(&self, momentum: &Velocity<T, L, A>) -> Velocity<T, L, A> {
        Velocity { linear: momentum.linear * self.linear, angular: self.angular * momentum.angular }
    }

    /// M^-1 (p, r x p): the change of velocity from an impulse `p` \[N s\] at the lever arm `r` \[m\].
    #[inline(always)]
    pub fn response(&self, r: Vector<T, L>, p: Vector<T, L>) -> Velocity<T, L, A> {
        Velocity { linear: p * self.linear, angular: self.angular * moment(r, p) }
    }
}

impl<T: Scalar, const L: usize, const A: usize> InverseMass<T, L, A> {
    /// The same in another number.
    pub fn cast<U: Real>(&self) -> InverseMass<U, L, A> {
        InverseMass { linear: U::from_f64(self.linear.to_f64()), angular: self.angular.cast() }
    }

    /// M of the same body.
    pub fn mass(&self) -> Mass<L, A> {
        let linear = self.linear.to_f64();
        let angular: SymmetricMatrix<f64, A> = self.angular.cast();
        Mass {
            linear: if linear > 0.0 { 1.0 / linear } else { 0.0 },
            // Turned, what is locked about some axis is singular.
            angular: angular.inverse().unwrap_or_else(|| angular.pseudo_inverse()),
        }
    }
}
