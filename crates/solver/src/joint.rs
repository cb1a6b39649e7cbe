//! [`Joint`] and [`Axis`]: rows between two bodies that are not contacts.
//!
//! A joint has one frame, and an axis for each row: a lock, a limit, a motor, a spring or dry
//! friction. From the center of the joint, in its frame, the row of J is a unit wrench w of L + A
//! numbers: u = w . twist is the velocity along the axis, and an impulse gamma acts as the wrench
//! w gamma. So rows of joints are visited, certified and factored like contacts
//! ([`ConstraintFrame`], [`Interval`]):
//!
//! ```text
//! row              t-, t+                              epsilon      lo, hi
//! lock             t, t                                small        -infinity, infinity
//! limits           (low - q) / h, (high - q) / h       small        -infinity, infinity
//! motor            wanted velocity, twice              0            -F h, F h
//! spring           to the rest position, twice         softness     -F h, F h
//! friction         0, 0                                0            -F h, F h
//! ```

use crate::law::{Interval, Law};
use crate::{Cast, ConstraintFrame, Mobility, Real, Scalar, Vector, Velocity};

/// The rows of two bodies in one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Joint<T: Real, const L: usize> {
    /// Axes of the joint, and arms to its center.
    pub frame: ConstraintFrame<T, L>,
    /// Bodies a and b, as indices into [`System::velocities`](crate::System::velocities).
    pub bodies: [u32; 2],
    /// Index of its first axis in [`System::axes`](crate::System::axes).
    pub first: u32,
    /// Number of its axes.
    pub count: u32,
}

/// A row of a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Axis<T: Real, const L: usize, const A: usize> {
    /// w: the unit wrench of the row in the frame of the joint. A lock of translation is a unit
    /// vector in `linear`, one of rotation a unit vector in `angular`.
    pub direction: Velocity<T, L, A>,
    /// Targets, bounds and compliance.
    pub law: Interval<T>,
    /// Part of the targets that repairs a position; the relaxing sweep takes it out. \[m/s, or
    /// rad/s\]
    pub bias: T,
    /// gamma: the accumulated impulse. \[N s, or N m s\]
    pub impulse: T,
    /// m_eff = 1 / (A_ii + epsilon); 0 if nothing moves along the axis. \[kg, or kg m^2\]
    pub effective_mass: T,
}

impl<T: Real, const L: usize> Joint<T, L> {
    /// Returns the range of its axes in its system.
    #[inline(always)]
    pub fn axes(&self) -> std::ops::Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }
}

impl<T: Scalar, const L: usize> Joint<T, L> {
    /// Converts to another number type.
    pub fn cast<U: Real>(&self) -> Joint<U, L> {
        let Self { frame, bodies, first, count } = *self;
        Joint { frame: frame.part(0), bodies, first, count }
    }
}

/// Fraction of |w|^2 trace(M^-1) below which A_ii counts as zero. \[1\]
const ROUNDING: f64 = 1e-11;

impl<T: Real, const L: usize, const A: usize> Axis<T, L, A> {
    /// Returns a rigid lock along a unit wrench.
    pub fn lock(direction: Velocity<T, L, A>) -> Self {
        let infinite = T::from_f64(f64::INFINITY);
        let law =
            Interval { targets: [T::ZERO; 2], bounds: [-infinite, infinite], compliance: T::ZERO };
        Self { direction, law, bias: T::ZERO, impulse: T::ZERO, effective_mass: T::ZERO }
    }

    /// Returns u = w . twist: the velocity of a relative to b along the axis. \[m/s, or rad/s\]
    #[inline(always)]
    pub fn velocity(&self, twist: &Velocity<T, L, A>) -> T {
        self.direction.dot(twist)
    }

    /// Returns its law without the [`bias`](Self::bias).
    #[inline(always)]
    pub fn unbiased_law(&self) -> Interval<T> {
        Interval { targets: self.law.targets.map(|target| target - self.bias), ..self.law }
    }

    /// Sets the effective mass from the mobility of the joint. A row along which nothing can move
    /// gets none, and takes no part.
    #[inline(always)]
    pub fn prepare(&mut self, mobility: &Mobility<T, L, A>) {
        let response = mobility.of_wrench(&self.direction);
        let a_ii = self.direction.dot(&response);
        let least = mobility.trace() * T::from_f64(ROUNDING);
        let mass = T::ONE / (a_ii + self.law.compliance);
        self.effective_mass = (a_ii - least).choose(mass, T::ZERO);
    }

    /// Visits the row once: brings the velocity along it to its target. Returns the change of the
    /// impulse.
    #[inline(always)]
    pub(crate) fn visit<const RELAX: bool>(&mut self, twist: &Velocity<T, L, A>) -> T {
        let law = if RELAX { self.unbiased_law() } else { self.law };
        let next = law.visit(self.effective_mass, self.velocity(twist), self.impulse);
        let next = self.effective_mass.choose(next, self.impulse);
        let change = next - self.impulse;
        self.impulse = next;
        change
    }

    /// Returns the velocity error of the row: by how much a visit would change it. \[m/s, or rad/s\]
    #[inline(always)]
    pub(crate) fn residual<const RELAX: bool>(&self, twist: &Velocity<T, L, A>) -> T {
        let change = Self { ..*self }.visit::<RELAX>(twist);
        let error = change.max(-change) / self.effective_mass;
        self.effective_mass.choose(error, T::ZERO)
    }

    /// Returns the impulse within its bounds.
    #[inline(always)]
    pub(crate) fn inside(&self) -> Vector<T, 1> {
        self.law.clamp(Vector([self.impulse]))
    }

    /// Converts one [part](Cast::part) to another number type.
    #[inline(always)]
    pub(crate) fn part<U: Real>(&self, index: usize) -> Axis<U, L, A>
    where
        T: Cast<U>,
    {
        let Interval { targets, bounds, compliance } = &self.law;
        let law = Interval {
            targets: [targets[0].part(index), targets[1].part(index)],
            bounds: [bounds[0].part(index), bounds[1].part(index)],
            compliance: compliance.part(index),
        };
        Axis {
            direction: self.direction.part(index),
            law,
            bias: self.bias.part(index),
            impulse: self.impulse.part(index),
            effective_mass: self.effective_mass.part(index),
        }
    }
}

impl<T: Scalar, const L: usize, const A: usize> Axis<T, L, A> {
    /// Converts to another number type.
    pub fn cast<U: Real>(&self) -> Axis<U, L, A> {
        self.part(0)
    }
}
