//! [`ConstraintFrame`] and [`Mobility`]: where a constraint acts on its two bodies, and how easily they
//! yield.
//!
//! The components of a constraint see one relative motion of the two bodies: a twist, L + A numbers.
//! They act on the bodies by one wrench of the same size. A visit therefore converts the velocities
//! to a twist once, and applies the summed impulses once. In between it uses the
//! [`Mobility`], the response of the twist to a wrench. Twist and wrench:
//! Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 2.

use std::ops::Range;

use crate::body::{TwistAxes, all_axes};
use crate::vector::{add_moment, spin};
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

/// Returns an orthonormal frame with `normal` first; equal normals give equal frames.
#[inline(always)]
pub fn contact_frame<T: Real, const L: usize>(normal: Vector<T, L>) -> [Vector<T, L>; L] {
    let mut frame = [normal; L];
    match L {
        2 => {
            frame[1][0] = -normal[1];
            frame[1][1] = normal[0];
        }
        3 => {
            // Start from the axis least aligned with the normal, and make it orthogonal to the
            // normal.
            let (mut axis, mut least) = (Vector::ZERO, normal[0] * normal[0]);
            axis[0] = T::ONE;
            for i in 1..L {
                let along = normal[i] * normal[i];
                let less = least - along;
                for j in 0..L {
                    axis[j] = less.choose(if i == j { T::ONE } else { T::ZERO }, axis[j]);
                }
                least = less.choose(along, least);
            }
            let across = axis - normal * normal.dot(axis);
            frame[1] = across * (T::ONE / across.length());
            frame[2] = moment(frame[0], frame[1]);
        }
        _ => {}
    }
    frame
}

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
