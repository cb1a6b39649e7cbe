//! State and mass of a body in the solver: [`Velocity`], [`Mass`] and [`InverseMass`].

use std::ops::{Add, AddAssign, Mul, Range, Sub, SubAssign};

use crate::vector::spin;
use crate::{Cast, Real, Scalar, SymmetricMatrix, Vector, moment};

/// Linear and angular velocity of a body: one block of the notes' column v. It also serves as a
/// displacement (velocity times time), since J maps both alike.
///
/// The layout lets the numbers of a body be loaded into registers of four
/// ([`Lanes`](crate::lanes::Lanes)).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(16))]
pub struct Velocity<T: Real, const L: usize, const A: usize> {
    /// Velocity of the center of mass. \[m/s\]
    pub linear: Vector<T, L>,
    /// Angular velocity in world axes. \[rad/s\]
    pub angular: Vector<T, A>,
}

impl<T: Real, const L: usize, const A: usize> Velocity<T, L, A> {
    /// Zero velocity.
    pub const ZERO: Self = Self { linear: Vector::ZERO, angular: Vector::ZERO };
    /// Start value of sums ([`Real::NEG_ZERO`]).
    pub(crate) const NEG_ZERO: Self = Self { linear: Vector::NEG_ZERO, angular: Vector::NEG_ZERO };

    /// Returns v . p, the product of a velocity and a momentum. \[J\]
    #[inline(always)]
    pub fn dot(&self, other: &Self) -> T {
        self.linear.dot(other.linear) + self.angular.dot(other.angular)
    }

    /// Converts one [part](Cast::part) to another number type.
    #[inline(always)]
    pub(crate) fn part<U: Real>(&self, index: usize) -> Velocity<U, L, A>
    where
        T: Cast<U>,
    {
        Velocity { linear: self.linear.part(index), angular: self.angular.part(index) }
    }

    /// Returns the velocity \[m/s\] of the point at the lever arm `r` \[m\]: v + omega x r.
    #[inline(always)]
    pub fn at(&self, r: Vector<T, L>) -> Vector<T, L> {
        if A == 0 { self.linear } else { self.linear + spin(self.angular, r) }
    }
}

impl<T: Scalar, const L: usize, const A: usize> Velocity<T, L, A> {
    /// Converts to another number type.
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

/// A subset of the components of a twist or a wrench.
#[derive(Clone, Debug)]
pub(crate) struct TwistAxes {
    pub(crate) linear: Range<usize>,
    pub(crate) angular: Range<usize>,
}

/// Returns all components.
pub(crate) const fn all_axes<const L: usize, const A: usize>() -> TwistAxes {
    TwistAxes { linear: 0..L, angular: 0..A }
}

/// Returns the components that normal impulses cause and depend on: the velocity along the normal,
/// and rotation that tilts the normal.
pub(crate) const fn along_normals<const A: usize>() -> TwistAxes {
    TwistAxes { linear: 0..1, angular: A / 3..A }
}

/// Returns the components that friction impulses cause and depend on: the others.
pub(crate) const fn along_tangents<const L: usize, const A: usize>() -> TwistAxes {
    TwistAxes { linear: 1..L, angular: 0..A / 3 }
}

/// One block of M: (m, I), with I in world axes. Zero for a fixed body, and along locked
/// directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mass<const L: usize, const A: usize> {
    /// m. \[kg\]
    pub linear: f64,
    /// I = R I_0 R^T. \[kg m^2\]
    pub angular: SymmetricMatrix<f64, A>,
}

impl<const L: usize, const A: usize> Mass<L, A> {
    /// Mass of a fixed body.
    pub const ZERO: Self = Self { linear: 0.0, angular: SymmetricMatrix::ZERO };

    /// Returns M v: the momentum of a body at this velocity. \[N s, N m s\]
    #[inline(always)]
    pub fn momentum(&self, v: &Velocity<f64, L, A>) -> Velocity<f64, L, A> {
        Velocity { linear: v.linear * self.linear, angular: self.angular * v.angular }
    }

    /// Adds to the weight by which the error of an island is averaged: the mass \[kg\].
    ///
    /// While no body with a finite mass has been added, it is minus the sum of the moments of
    /// inertia \[kg m^2\] of bodies that only rotate.
    #[inline(always)]
    pub(crate) fn add_measure(&self, measure: &mut f64) {
        if self.linear > 0.0 {
            *measure = measure.max(0.0) + self.linear;
        } else if *measure <= 0.0 {
            *measure -= (0..A).map(|i| self.angular.0[i][i]).sum::<f64>();
        }
    }

    /// Returns v . M v: twice the kinetic energy. \[J\]
    #[inline(always)]
    pub fn squared(&self, v: &Velocity<f64, L, A>) -> f64 {
        v.dot(&self.momentum(v))
    }
}

/// One block of M^-1: (m^-1, I^-1), with I^-1 in world axes. Zero for a fixed body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct InverseMass<T: Real, const L: usize, const A: usize> {
    /// m^-1. \[1/kg\]
    pub linear: T,
    /// W = R I_0^-1 R^T. \[1/(kg m^2)\]
    pub angular: SymmetricMatrix<T, A>,
}

impl<T: Real, const L: usize, const A: usize> InverseMass<T, L, A> {
    /// Inverse mass of a fixed body.
    pub const FIXED: Self = Self { linear: T::ZERO, angular: SymmetricMatrix::ZERO };

    /// Returns M^-1 p: the velocity that a momentum produces. \[m/s, rad/s\]
    #[inline(always)]
    pub fn velocity(&self, momentum: &Velocity<T, L, A>) -> Velocity<T, L, A> {
        Velocity { linear: momentum.linear * self.linear, angular: self.angular * momentum.angular }
    }

    /// Returns M^-1 (p, r x p): the change of velocity from an impulse `p` \[N s\] at the lever arm
    /// `r` \[m\].
    #[inline(always)]
    pub fn response(&self, r: Vector<T, L>, p: Vector<T, L>) -> Velocity<T, L, A> {
        Velocity { linear: p * self.linear, angular: self.angular * moment(r, p) }
    }
}

impl<T: Scalar, const L: usize, const A: usize> InverseMass<T, L, A> {
    /// Converts to another number type.
    #[inline(always)]
    pub fn cast<U: Real>(&self) -> InverseMass<U, L, A> {
        InverseMass { linear: U::from_f64(self.linear.to_f64()), angular: self.angular.cast() }
    }

    /// Returns M of the same body.
    pub fn mass(&self) -> Mass<L, A> {
        let linear = self.linear.to_f64();
        let angular: SymmetricMatrix<f64, A> = self.angular.cast();
        Mass {
            linear: if linear > 0.0 { 1.0 / linear } else { 0.0 },
            // A locked axis that is not a coordinate axis makes the matrix singular.
            angular: angular.inverse().unwrap_or_else(|| angular.pseudo_inverse()),
        }
    }
}
