//! [`Joint`] and [`Axis`]: rows between two bodies that are not contacts.
//!
//! An axis is one row of J: the velocity along it is u = J_a v_a + J_b v_b, and its impulse gamma
//! changes the velocities by M^-1 J^T gamma. All rows have one law ([`Interval`]):
//!
//! ```text
//! row              t-, t+                              epsilon      lo, hi
//! lock             t, t                                small        -infinity, infinity
//! limits           (low - q) / h, (high - q) / h       small        -infinity, infinity
//! motor            wanted velocity, twice              0            -F h, F h
//! spring           to the rest position, twice         softness     -F h, F h
//! friction         0, 0                                0            -F h, F h
//! ```
//!
//! J_a and J_b are independent. Those of a gear turn about different axes.

use crate::law::{Interval, Law};
use crate::{Cast, ConstraintFrame, InverseMass, Real, Scalar, Vector, Velocity};

/// The rows of two bodies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Joint {
    /// Bodies a and b, as indices into [`System::velocities`](crate::System::velocities). A joint
    /// between a body and the world has this body twice, and J_b = 0.
    pub bodies: [u32; 2],
    /// Index of its first axis in [`System::axes`](crate::System::axes).
    pub first: u32,
    /// Number of its axes.
    pub count: u32,
}

impl Joint {
    /// Returns the range of its axes in its system.
    #[inline(always)]
    pub fn axes(&self) -> std::ops::Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }
}

/// A row of a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis<T: Real, const L: usize, const A: usize> {
    /// J_a and J_b: the change of the velocity u by the velocities of each body. \[1, or m\]
    pub jacobian: [Velocity<T, L, A>; 2],
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

/// Fraction of |J|^2 trace(M^-1) below which A_ii counts as zero. A locked axis of rotation that is no
/// coordinate axis leaves some 4e-7 in M^-1, in `f32`. \[1\]
const ROUNDING: f64 = 1e-6;

impl<T: Real, const L: usize, const A: usize> Axis<T, L, A> {
    /// Returns a rigid lock along a unit wrench in a frame. Along a unit vector of `linear` it
    /// locks translation, along one of `angular` rotation.
    pub fn lock(frame: &ConstraintFrame<T, L>, direction: &Velocity<T, L, A>) -> Self {
        let infinite = T::from_f64(f64::INFINITY);
        let law =
            Interval { targets: [T::ZERO; 2], bounds: [-infinite, infinite], compliance: T::ZERO };
        let [to_a, from_b] = frame.momenta(direction);
        let jacobian = [to_a, from_b * -T::ONE];
        Self { jacobian, law, bias: T::ZERO, impulse: T::ZERO, effective_mass: T::ZERO }
    }

    /// Returns u = J_a v_a + J_b v_b. \[m/s, or rad/s\]
    #[inline(always)]
    pub fn velocity(&self, a: &Velocity<T, L, A>, b: &Velocity<T, L, A>) -> T {
        self.jacobian[0].dot(a) + self.jacobian[1].dot(b)
    }

    /// Returns true if it concerns rotations alone.
    #[inline(always)]
    pub fn is_turn(&self) -> bool
    where
        T: PartialEq,
    {
        self.jacobian.iter().all(|own| own.linear == Vector::ZERO)
    }

    /// Returns its law without the [`bias`](Self::bias).
    #[inline(always)]
    pub fn unbiased_law(&self) -> Interval<T> {
        Interval { targets: self.law.targets.map(|target| target - self.bias), ..self.law }
    }

    /// Returns M^-1 J^T: the velocity that each body gains per unit of impulse.
    #[inline(always)]
    pub(crate) fn response(&self, masses: &[InverseMass<T, L, A>; 2]) -> [Velocity<T, L, A>; 2] {
        let [a, b] = &self.jacobian;
        [masses[0].velocity(a), masses[1].velocity(b)]
    }

    /// Returns A_ii = J M^-1 J^T; 0 if it is no more than rounding errors. \[1/kg, or 1/(kg m^2)\]
    #[inline(always)]
    pub fn mobility(&self, masses: &[InverseMass<T, L, A>; 2]) -> T {
        let (response, mut least) = (self.response(masses), T::ZERO);
        for (jacobian, mass) in self.jacobian.iter().zip(masses) {
            let trace = (0..A).fold(T::ZERO, |sum, i| sum + mass.angular.entry(i, i));
            least += jacobian.linear.dot(jacobian.linear) * mass.linear;
            least += jacobian.angular.dot(jacobian.angular) * trace;
        }
        let a_ii = self.jacobian[0].dot(&response[0]) + self.jacobian[1].dot(&response[1]);
        (a_ii - least * T::from_f64(ROUNDING)).choose(a_ii, T::ZERO)
    }

    /// Sets the effective mass. A row along which nothing can move gets none, and takes no part.
    #[inline(always)]
    pub fn prepare(&mut self, masses: &[InverseMass<T, L, A>; 2]) {
        self.prepare_for(self.mobility(masses));
    }

    /// Sets the effective mass for this A_ii.
    #[inline(always)]
    pub fn prepare_for(&mut self, a_ii: T) {
        self.effective_mass = a_ii.choose(T::ONE / (a_ii + self.law.compliance), T::ZERO);
    }

    /// Visits the row once at this velocity along it: brings it to its target. Returns the change
    /// of the impulse.
    #[inline(always)]
    pub(crate) fn visit<const RELAX: bool>(&mut self, velocity: T) -> T {
        let law = if RELAX { self.unbiased_law() } else { self.law };
        let next = law.visit(self.effective_mass, velocity, self.impulse);
        let next = self.effective_mass.choose(next, self.impulse);
        let change = next - self.impulse;
        self.impulse = next;
        change
    }

    /// Returns the velocity error of the row: by how much a visit would change it.
    /// \[m/s, or rad/s\]
    #[inline(always)]
    pub(crate) fn residual<const RELAX: bool>(&self, velocity: T) -> T {
        let change = Self { ..*self }.visit::<RELAX>(velocity);
        let error = change.max(-change) / self.effective_mass;
        self.effective_mass.choose(error, T::ZERO)
    }

    /// Returns the impulse, clamped to its bounds.
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
        let Interval { targets: [low, high], bounds: [lo, hi], compliance } = &self.law;
        let law = Interval {
            targets: [low.part(index), high.part(index)],
            bounds: [lo.part(index), hi.part(index)],
            compliance: compliance.part(index),
        };
        let [a, b] = &self.jacobian;
        Axis {
            jacobian: [a.part(index), b.part(index)],
            law,
            bias: self.bias.part(index),
            impulse: self.impulse.part(index),
            effective_mass: self.effective_mass.part(index),
        }
    }
}

impl<const L: usize, const A: usize> Axis<f64, L, A> {
    /// A row that does nothing.
    pub const IDLE: Self = Self {
        jacobian: [Velocity::ZERO; 2],
        law: Interval { targets: [0.0; 2], bounds: [0.0; 2], compliance: 0.0 },
        bias: 0.0,
        impulse: 0.0,
        effective_mass: 0.0,
    };
}

impl<T: Scalar, const L: usize, const A: usize> Axis<T, L, A> {
    /// Converts to another number type.
    pub fn cast<U: Real>(&self) -> Axis<U, L, A> {
        self.part(0)
    }
}
