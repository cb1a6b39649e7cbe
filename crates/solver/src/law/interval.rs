//! [`Interval`]: the law of one component, with bounds of its impulse and a slack between two
//! targets.

use super::{Law, SmoothLaw};
use crate::{Real, SymmetricMatrix, Vector};

/// Bounds, compliance and targets of one component of a constraint.
///
/// The impulse is r = clamp((max(0, t- - u) + min(0, t+ - u)) / epsilon, lo, hi).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval<T: Real> {
    /// t- and t+, t- <= t+: within them no impulse acts. An absent target is infinite. \[m/s, or
    /// rad/s\]
    pub targets: [T; 2],
    /// lo <= 0 and hi >= 0. \[N s, or N m s\]
    pub bounds: [T; 2],
    /// epsilon. \[1/kg, or 1/(kg m^2)\]
    pub compliance: T,
}

impl<T: Real> Interval<T> {
    /// Returns the impulse after a visit of Gauss-Seidel: it brings u, which includes the impulse
    /// r, to the target. m_eff = 1 / (A_ii + epsilon).
    #[inline(always)]
    pub fn visit(&self, effective_mass: T, u: T, r: T) -> T {
        let [low, high] = self.targets;
        let w = u + self.compliance * r;
        let push = (r - effective_mass * (w - low)).max(T::ZERO);
        let pull = (r - effective_mass * (w - high)).min(T::ZERO);
        (push + pull).max(self.bounds[0]).min(self.bounds[1])
    }

    /// Returns max(0, t- - u) + min(0, t+ - u): the velocity missing to the slack.
    #[inline(always)]
    fn outside(&self, u: T) -> T {
        (self.targets[0] - u).max(T::ZERO) + (self.targets[1] - u).min(T::ZERO)
    }

    /// Returns t - u for the target towards which an impulse r acts.
    #[inline(always)]
    fn missing_by(&self, u: T, r: T) -> T {
        let to = self.targets.map(|target| target - u);
        r.choose(to[0], (-r).choose(to[1], self.outside(u)))
    }
}

impl<T: Real> Law<T, 1> for Interval<T> {
    #[inline(always)]
    fn missing(&self, u: Vector<T, 1>, r: Vector<T, 1>) -> Vector<T, 1> {
        Vector([self.missing_by(u[0], r[0])]) - self.soften(r)
    }

    #[inline(always)]
    fn soften(&self, r: Vector<T, 1>) -> Vector<T, 1> {
        Vector([self.compliance.choose(r[0] * self.compliance, T::ZERO)])
    }

    #[inline(always)]
    fn response(&self, u: Vector<T, 1>) -> Vector<T, 1> {
        let y = self.outside(u[0]);
        let answer = y / self.compliance;
        // A rigid row that misses nothing would divide 0 by 0.
        self.clamp(Vector([y.choose(answer, (-y).choose(answer, T::ZERO))]))
    }

    #[inline(always)]
    fn clamp(&self, r: Vector<T, 1>) -> Vector<T, 1> {
        Vector([r[0].max(self.bounds[0]).min(self.bounds[1])])
    }

    /// Where r and the response do not act in the same direction, the loss is that of each against
    /// no impulse; both are at least 0.
    #[inline(always)]
    fn loss(&self, u: Vector<T, 1>, r: Vector<T, 1>) -> T {
        let (half, best) = (T::from_f64(0.5), self.response(u));
        // A rigid row without a bound has an infinite response, and loses infinitely much.
        let spring =
            |r: Vector<T, 1>| self.compliance.choose(half * r.dot(self.soften(r)), T::ZERO);
        let d = best - r;
        let between = spring(d) + d.dot(self.missing(u, best)).max(T::ZERO);
        let gain = |r: Vector<T, 1>| r[0] * self.missing_by(u[0], r[0]) - spring(r);
        (best[0] * r[0]).choose(between, gain(best) - gain(r))
    }

    #[inline(always)]
    fn is_parabola(&self, u: Vector<T, 1>, r: Vector<T, 1>) -> T {
        let [low, high] = self.targets;
        let opposed = -(self.response(u)[0] * r[0]);
        opposed.choose((high - low).choose(T::ZERO, T::ONE), T::ONE)
    }
}

impl SmoothLaw<1> for Interval<f64> {
    #[inline(always)]
    fn slope(&self, u: Vector<f64, 1>) -> SymmetricMatrix<f64, 1> {
        let mut slope = SymmetricMatrix::ZERO;
        let y = self.outside(u[0]);
        let is_free = if y == 0.0 {
            // On the boundary of the slack the row counts as loaded, as a resting contact does.
            u[0] <= self.targets[0] || u[0] >= self.targets[1]
        } else {
            // At a bound, which may be 0, the impulse stays.
            let answer = y / self.compliance;
            self.bounds[0] < answer && answer < self.bounds[1]
        };
        if is_free {
            slope.0[0][0] = 1.0 / self.compliance;
        }
        slope
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A motor that has given all it can is not loaded, also where the rest of its range ends at 0.
    #[test]
    fn a_row_at_a_bound_of_zero_is_not_loaded() {
        let slope = |bounds: [f64; 2], u: f64| {
            let law = Interval { targets: [10.0; 2], bounds, compliance: 1e-3 };
            law.slope(Vector([u])).0[0][0]
        };
        assert_eq!(slope([-2.0, 0.0], 9.0), 0.0);
        assert_eq!(slope([-1.0, 1.0], 9.0), 0.0);
        assert_eq!(slope([0.0, 2.0], 11.0), 0.0);
        assert_eq!(slope([-2.0, 0.0], 10.001), 1e3);
        assert_eq!(slope([-2.0, 0.0], 10.0), 1e3);
    }
}
