//! [`Mobility`]: response of the relative motion of two bodies to impulses at their manifold.

use crate::body::{TwistAxes, all_axes};
use crate::vector::{add_moment, spin};
use crate::{ConstraintFrame, InverseMass, Real, SymmetricMatrix, Vector, Velocity};

/// K = J M^-1 J^T at a manifold's center: maps a wrench to the twist that it produces
/// ([`ConstraintFrame::twist`]). Transformed to the offsets of the points it gives their blocks of A.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Mobility<T: Real, const L: usize, const A: usize> {
    /// Velocity of the center per impulse. \[1/kg\]
    pub(crate) linear: SymmetricMatrix<T, L>,
    /// Velocity of the center along an axis per moment; also rotation per impulse along that
    /// axis. \[1/(kg m)\]
    pub(crate) cross: CrossBlock<T, L, A>,
    /// Rotation per moment. \[1/(kg m^2)\]
    pub(crate) angular: SymmetricMatrix<T, A>,
}

/// An L x A matrix, stored by rows.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(transparent)]
pub(crate) struct CrossBlock<T, const L: usize, const A: usize>([Vector<T, A>; L]);

impl<T: Real, const L: usize, const A: usize> Default for CrossBlock<T, L, A> {
    fn default() -> Self {
        Self([Vector::ZERO; L])
    }
}

/// Normal mobilities below this fraction of trace(W) |arm|^2, summed over both bodies, count as
/// zero. For a ball of infinite mass the moment r x n is only rounding error. \[1\]
const ROUNDING: f64 = 1e-11;

impl<T: Real, const L: usize, const A: usize> Mobility<T, L, A> {
    /// Returns the mobility of a constraint between bodies of these inverse masses.
    #[inline(always)]
    pub fn of(frame: &ConstraintFrame<T, L>, masses: &[InverseMass<T, L, A>; 2]) -> Self {
        let mut mobility = Self::default();
        mobility.set_felt::<A>(frame, masses);
        mobility
    }

    /// Sets the part of the mobility that points need which depend on `B` components of rotation
    /// ([`ConstraintFrame::twist_felt`]). The other parts do not change.
    #[inline(always)]
    pub(crate) fn set_felt<const B: usize>(
        &mut self,
        frame: &ConstraintFrame<T, L>,
        masses: &[InverseMass<T, L, A>; 2],
    ) {
        self.linear = SymmetricMatrix::default();
        if B > 0 {
            (self.cross, self.angular) = (CrossBlock::default(), SymmetricMatrix::default());
        }
        let mut turning = T::ZERO;
        for (mass, arm) in masses.iter().zip(&frame.arms) {
            let (tensor, arm) = (frame.tensor(mass.angular), frame.to_frame(*arm));
            self.add_body::<B>(mass.linear, tensor, arm);
            for k in 0..A {
                turning += tensor.entry(k, k) * arm.dot(arm);
            }
        }
        let normal = &mut self.linear.0[0][0];
        *normal = (*normal - turning * T::from_f64(ROUNDING)).choose(*normal, T::ZERO);
    }

    /// Adds a body of this inverse mass and inertia, with the arm from its center of mass, in the
    /// frame.
    #[inline(always)]
    fn add_body<const B: usize>(
        &mut self,
        linear: T,
        angular: SymmetricMatrix<T, A>,
        arm: Vector<T, L>,
    ) {
        // A moment about axis k gives the rotation W e_k, which moves the center at W e_k x arm.
        let mut cross = [Vector::<T, A>::ZERO; L];
        for k in 0..A {
            let mut turned = Vector::<T, A>::ZERO;
            for m in 0..A {
                turned[m] = angular.entry(k, m);
            }
            let moved: Vector<T, L> = spin(turned, arm);
            for i in 0..L {
                cross[i][k] = moved[i];
            }
            for m in k..B {
                self.angular.0[k][m] += angular.entry(k, m);
            }
        }
        for i in 0..L {
            if B > 0 {
                self.cross.0[i] += cross[i];
            }
            self.linear.0[i][i] += linear;
            // An impulse along axis i has the moment arm x e_i.
            let mut lever = Vector::ZERO;
            add_moment(arm, i, T::ONE, &mut lever);
            for j in i..L {
                self.linear.0[i][j] += cross[j].dot(lever);
            }
        }
    }

    /// Returns the twist that a wrench produces.
    #[inline(always)]
    pub fn twist(&self, wrench: &Velocity<T, L, A>) -> Velocity<T, L, A> {
        let mut twist = Velocity::NEG_ZERO;
        self.add(&all_axes::<L, A>(), wrench, &all_axes::<L, A>(), &mut twist);
        twist
    }

    /// Adds to the components `to` of a twist the response to the components `from` of a wrench.
    /// Both have `B` angular components ([`ConstraintFrame::twist_felt`]).
    #[inline(always)]
    pub(crate) fn add<const B: usize>(
        &self,
        from: &TwistAxes,
        wrench: &Velocity<T, L, B>,
        to: &TwistAxes,
        twist: &mut Velocity<T, L, B>,
    ) {
        for i in to.linear.clone() {
            for j in from.linear.clone() {
                twist.linear[i] += self.linear.entry(i, j) * wrench.linear[j];
            }
            for k in from.angular.clone() {
                twist.linear[i] += self.cross.0[i][k] * wrench.angular[k];
            }
        }
        for k in to.angular.clone() {
            for j in from.linear.clone() {
                twist.angular[k] += self.cross.0[j][k] * wrench.linear[j];
            }
            for m in from.angular.clone() {
                twist.angular[k] += self.angular.entry(k, m) * wrench.angular[m];
            }
        }
    }
}
