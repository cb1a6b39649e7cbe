//! [`ConstraintFrame`]: where a constraint acts on its two bodies.
//!
//! The components of a constraint see one relative motion of the two bodies: a twist, L + A numbers.
//! They act on the bodies by one wrench of the same size. A visit therefore converts the velocities
//! to a twist once, and applies the summed impulses once. In between it uses the
//! [`Mobility`](crate::Mobility), the response of the twist to a wrench. Twist and wrench:
//! Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 2.

use std::ops::Range;

use crate::body::{TwistAxes, all_axes};
use crate::{Cast, InverseMass, Real, SymmetricMatrix, Vector, Velocity, moment};

/// Frame of a constraint and its arms on both bodies.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct ConstraintFrame<T: Real, const L: usize> {
    /// Orthonormal and right-handed axes. Those of a contact: first the normal n, from b towards a,
    /// then the tangents.
    pub axes: [Vector<T, L>; L],
    /// Vectors from the centers of mass of a and b to the center of the constraint. \[m\]
    pub arms: [Vector<T, L>; 2],
}

impl<T: Real, const L: usize> Default for ConstraintFrame<T, L> {
    fn default() -> Self {
        Self { axes: [Vector::ZERO; L], arms: [Vector::ZERO; 2] }
    }
}

impl<T: Real, const L: usize> ConstraintFrame<T, L> {
    /// Converts one [part](Cast::part) to another number type.
    #[inline(always)]
    pub(crate) fn part<U: Real>(&self, index: usize) -> ConstraintFrame<U, L>
    where
        T: Cast<U>,
    {
        let mut axes = [Vector::ZERO; L];
        for (axis, own) in axes.iter_mut().zip(&self.axes) {
            *axis = own.part(index);
        }
        ConstraintFrame { axes, arms: [self.arms[0].part(index), self.arms[1].part(index)] }
    }

    /// Returns the components of a world vector along the axes.
    #[inline(always)]
    pub fn to_frame(&self, world: Vector<T, L>) -> Vector<T, L> {
        let mut components = Vector::ZERO;
        for i in 0..L {
            components[i] = self.axes[i].dot(world);
        }
        components
    }

    /// Returns the world vector with these components along the axes.
    #[inline(always)]
    pub fn to_world(&self, components: Vector<T, L>) -> Vector<T, L> {
        self.sum_along(0..L, components)
    }

    /// Returns the world vector of some of the components.
    #[inline(always)]
    fn sum_along(&self, axes: Range<usize>, components: Vector<T, L>) -> Vector<T, L> {
        let mut world = Vector::NEG_ZERO;
        for i in axes {
            world += self.axes[i] * components[i];
        }
        world
    }

    /// Converts a rotation vector or a moment from world axes to those of the frame.
    pub fn turning<const A: usize>(&self, world: Vector<T, A>) -> Vector<T, A> {
        if A != L {
            return world;
        }
        let mut out = Vector::ZERO;
        for i in 0..A {
            for j in 0..A {
                out[i] += self.axes[i][j] * world[j];
            }
        }
        out
    }

    /// Converts a rotation vector or a moment from the axes of the frame to world axes.
    pub fn turning_in_world<const A: usize>(&self, own: Vector<T, A>) -> Vector<T, A> {
        if A != L {
            return own;
        }
        let mut out = Vector::ZERO;
        for i in 0..A {
            for j in 0..A {
                out[i] += self.axes[j][i] * own[j];
            }
        }
        out
    }

    /// Converts an inverse inertia \[1/(kg m^2)\] from world axes to those of the frame.
    #[inline(always)]
    pub(crate) fn tensor<const A: usize>(
        &self,
        world: SymmetricMatrix<T, A>,
    ) -> SymmetricMatrix<T, A> {
        if A != L {
            return world;
        }
        let mut axes = [Vector::ZERO; A];
        for i in 0..A {
            for j in 0..A {
                axes[i][j] = self.axes[i][j];
            }
        }
        world.seen_from(&axes)
    }

    /// Returns r_a and r_b of a point at the offset `place` from the center: the vectors to it from
    /// the centers of mass. \[m\]
    pub fn anchors(&self, place: Vector<T, L>) -> [Vector<T, L>; 2] {
        self.arms.map(|arm| arm + self.to_world(place))
    }

    /// Returns the velocity of a relative to b at the center, in the frame. A point at the offset s
    /// has the relative velocity [`Velocity::at`] s.
    #[inline(always)]
    pub fn twist<const A: usize>(
        &self,
        a: &Velocity<T, L, A>,
        b: &Velocity<T, L, A>,
    ) -> Velocity<T, L, A> {
        self.twist_felt(a, b)
    }

    /// Returns the twist as far as its points depend on it. `B` is `A`, or 0 for a single point at
    /// the center, which does not depend on rotation.
    #[inline(always)]
    pub(crate) fn twist_felt<const A: usize, const B: usize>(
        &self,
        a: &Velocity<T, L, A>,
        b: &Velocity<T, L, A>,
    ) -> Velocity<T, L, B> {
        let turning = a.angular - b.angular;
        let mut angular = Vector::NEG_ZERO;
        for i in 0..B {
            if A == L {
                for j in 0..A {
                    angular[i] += self.axes[i][j] * turning[j];
                }
            } else {
                angular[i] = turning[i];
            }
        }
        Velocity { linear: self.to_frame(a.at(self.arms[0]) - b.at(self.arms[1])), angular }
    }

    /// Returns J^T of a wrench: the momenta that a gains and b loses. The wrench is the sum of the
    /// impulses and of their moments about the center, in the frame. \[N s, N m s\]
    #[inline(always)]
    pub fn momenta<const A: usize>(&self, wrench: &Velocity<T, L, A>) -> [Velocity<T, L, A>; 2] {
        self.momenta_of(&all_axes::<L, A>(), wrench)
    }

    /// Returns the momenta from some components of a wrench. It has `B` moments: `A`, or 0 for a
    /// single point at the center.
    #[inline(always)]
    fn momenta_of<const A: usize, const B: usize>(
        &self,
        from: &TwistAxes,
        wrench: &Velocity<T, L, B>,
    ) -> [Velocity<T, L, A>; 2] {
        let linear = self.sum_along(from.linear.clone(), wrench.linear);
        let mut own = Vector::NEG_ZERO;
        for i in 0..A {
            if A == L {
                for j in from.angular.clone() {
                    own[i] += self.axes[j][i] * wrench.angular[j];
                }
            } else if B == A {
                own[i] = wrench.angular[i];
            }
        }
        let [arm_a, arm_b] = self.arms;
        [
            Velocity { linear, angular: own + moment(arm_a, linear) },
            Velocity { linear, angular: own + moment(arm_b, linear) },
        ]
    }

    /// Applies a wrench to the velocities: v += M^-1 J^T wrench.
    #[inline(always)]
    pub fn apply<const A: usize>(
        &self,
        wrench: &Velocity<T, L, A>,
        masses: &[InverseMass<T, L, A>; 2],
        a: &mut Velocity<T, L, A>,
        b: &mut Velocity<T, L, A>,
    ) {
        self.apply_of(&all_axes::<L, A>(), wrench, masses, a, b);
    }

    /// Applies some components of a wrench to the velocities.
    #[inline(always)]
    pub(crate) fn apply_of<const A: usize, const B: usize>(
        &self,
        from: &TwistAxes,
        wrench: &Velocity<T, L, B>,
        masses: &[InverseMass<T, L, A>; 2],
        a: &mut Velocity<T, L, A>,
        b: &mut Velocity<T, L, A>,
    ) {
        let [to_a, from_b] = self.momenta_of(from, wrench);
        *a += masses[0].velocity(&to_a);
        *b -= masses[1].velocity(&from_b);
    }
}
