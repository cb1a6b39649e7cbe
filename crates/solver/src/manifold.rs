//! [`Manifold`]: the contact points of two bodies, with their common frame and arms.
//!
//! The points see one relative motion of the two bodies: a twist, L + A numbers. They act on the
//! bodies by one wrench of the same size. A visit therefore converts the velocities to a twist
//! once, and applies the summed impulses once. In between it uses the
//! [`Mobility`](crate::Mobility), the response of the twist to a wrench. Twist and wrench:
//! Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 2.

use std::ops::Range;

use crate::body::{TwistAxes, all_axes};
use crate::{Cast, InverseMass, Real, Scalar, SymmetricMatrix, Vector, Velocity, moment};

/// Quantities shared by the points of a manifold.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Manifold<T: Real, const L: usize> {
    /// The contact frame, orthonormal and right-handed: first the normal n, from b towards a, then
    /// the tangents.
    pub frame: [Vector<T, L>; L],
    /// Vectors from the centers of mass of a and b to the manifold's center, which may be any point
    /// near its contact points. \[m\]
    pub arms: [Vector<T, L>; 2],
    /// Coulomb coefficient mu. \[1\]
    pub friction: T,
    /// Restitution c_r, 0..1. \[1\]
    pub restitution: T,
    /// Upper limit of epsilon of its points; infinite by default. \[1/kg\]
    pub compliance: T,
    /// Radii of curvature of the surfaces of a and b at the contact; 0 for a flat or sharp
    /// one. \[m\]
    pub radii: [T; 2],
    /// Fractions of the rotations of a and b that the normal follows. They are (1, 0) on a face of
    /// a, (0, 1) on a face of b, (1/2, 1/2) across two edges, and (0, 0) along the line through two
    /// centers of curvature. \[1\]
    pub normal_share: [T; 2],
    /// Bodies a and b, as indices into [`System::velocities`](crate::System::velocities).
    pub bodies: [u32; 2],
    /// Index of its first point in [`System::contacts`](crate::System::contacts).
    pub first: u32,
    /// Number of its points.
    pub count: u32,
}

impl<T: Real, const L: usize> Default for Manifold<T, L> {
    /// Returns a manifold without friction, restitution or points.
    fn default() -> Self {
        Self {
            bodies: [0, 0],
            frame: [Vector::ZERO; L],
            arms: [Vector::ZERO; 2],
            friction: T::ZERO,
            restitution: T::ZERO,
            compliance: T::from_f64(f64::INFINITY),
            radii: [T::ZERO; 2],
            normal_share: [T::from_f64(0.5); 2],
            first: 0,
            count: 0,
        }
    }
}

impl<T: Scalar, const L: usize> Manifold<T, L> {
    /// Converts to another number type.
    #[inline(always)]
    pub fn cast<U: Real>(&self) -> Manifold<U, L> {
        self.part(0)
    }
}

impl<T: Real, const L: usize> Manifold<T, L> {
    /// Converts one [part](Cast::part) to another number type.
    #[inline(always)]
    pub(crate) fn part<U: Real>(&self, index: usize) -> Manifold<U, L>
    where
        T: Cast<U>,
    {
        let mut frame = [Vector::ZERO; L];
        for (axis, own) in frame.iter_mut().zip(&self.frame) {
            *axis = own.part(index);
        }
        Manifold {
            bodies: self.bodies,
            frame,
            arms: [self.arms[0].part(index), self.arms[1].part(index)],
            friction: self.friction.part(index),
            restitution: self.restitution.part(index),
            compliance: self.compliance.part(index),
            radii: [self.radii[0].part(index), self.radii[1].part(index)],
            normal_share: [self.normal_share[0].part(index), self.normal_share[1].part(index)],
            first: self.first,
            count: self.count,
        }
    }

    /// Returns the unit normal n, from b towards a.
    #[inline(always)]
    pub fn normal(&self) -> Vector<T, L> {
        self.frame[0]
    }

    /// Returns the range of its points in the contacts of its system.
    #[inline(always)]
    pub fn points(&self) -> std::ops::Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }

    /// Returns the components of a world vector along the frame, normal first.
    #[inline(always)]
    pub fn to_frame(&self, world: Vector<T, L>) -> Vector<T, L> {
        let mut components = Vector::ZERO;
        for i in 0..L {
            components[i] = self.frame[i].dot(world);
        }
        components
    }

    /// Returns the world vector with these components along the frame.
    #[inline(always)]
    pub fn to_world(&self, components: Vector<T, L>) -> Vector<T, L> {
        self.sum_along(0..L, components)
    }

    /// Returns the world vector of some of the components.
    #[inline(always)]
    fn sum_along(&self, axes: Range<usize>, components: Vector<T, L>) -> Vector<T, L> {
        let mut world = Vector::NEG_ZERO;
        for i in axes {
            world += self.frame[i] * components[i];
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
                out[i] += self.frame[i][j] * world[j];
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
                out[i] += self.frame[j][i] * own[j];
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
                axes[i][j] = self.frame[i][j];
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
                    angular[i] += self.frame[i][j] * turning[j];
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
                    own[i] += self.frame[j][i] * wrench.angular[j];
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
