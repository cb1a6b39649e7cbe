//! [`Manifold`]: the contact points of two bodies, with their common frame and arms.

use crate::{Cast, ConstraintFrame, Real, Scalar, Vector, moment};

/// The quantities shared by the contact points of two bodies.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Manifold<T: Real, const L: usize> {
    /// Normal, tangents and arms. The center may be any point near the contact points.
    pub frame: ConstraintFrame<T, L>,
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
            frame: ConstraintFrame::default(),
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
        Manifold {
            bodies: self.bodies,
            frame: self.frame.part(index),
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
        self.frame.axes[0]
    }

    /// Returns the range of its points in the contacts of its system.
    #[inline(always)]
    pub fn points(&self) -> std::ops::Range<usize> {
        self.first as usize..(self.first + self.count) as usize
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
