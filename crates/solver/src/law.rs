//! Laws of constraints: the impulse of a constraint as a function of the velocity along it.
//!
//! A constraint has a relative velocity u = J_i v of N components, a closed convex set K of
//! impulses that contains 0, and a value s(r) of impulses, concave and with s(0) = 0:
//!
//! ```text
//! s(r) = r . t - r . R r / 2        one target t of the velocity, compliance R = diag(epsilon, ..)
//! s(r) = min(r t-, r t+) - ..       a component with a slack between two targets t- <= t+
//! phi(u) = max of s(r) - r . u over r in K, attained by the response r(u)
//! ```
//!
//! phi is convex, and -r(u) is its gradient. So a system of constraints is the minimum of a convex
//! function of the velocities ([`newton`](crate::newton)). For any r in K the loss
//! phi(u) - s(r) + r . u is at least 0, and 0 exactly if r is the response;
//! [`certificate`](crate::certificate) rests on it.
//!
//! | Constraint | K | Targets | Law |
//! |---|---|---|---|
//! | contact with friction | friction cone | t | [`Cone`] |
//! | normal of a contact | r >= 0 | t, infinity | [`Interval`] |
//! | lock | all impulses | t, t | [`Interval`] |
//! | limit | all impulses | lower, upper | [`Interval`] |
//! | motor, spring, friction of a joint | -F h..F h | t, t | [`Interval`] |

mod cone;
mod interval;

pub use cone::{Cone, project};
pub use interval::Interval;

use crate::{Real, SymmetricMatrix, Vector};

/// The law of a constraint with impulses of `N` components. u is the relative velocity \[m/s, or
/// rad/s\], r an impulse \[N s, or N m s\].
pub trait Law<T: Real, const N: usize>: Copy {
    /// Returns t - u - R r: the velocity that is missing to the target if the impulse is r.
    fn missing(&self, u: Vector<T, N>, r: Vector<T, N>) -> Vector<T, N>;

    /// Returns R r.
    fn soften(&self, r: Vector<T, N>) -> Vector<T, N>;

    /// Returns the response to u: the impulse in K that maximizes s(r) - r . u.
    fn response(&self, u: Vector<T, N>) -> Vector<T, N>;

    /// Returns the response to u + `way` times `length`.
    #[inline(always)]
    fn response_along(&self, u: Vector<T, N>, way: Vector<T, N>, length: T) -> Vector<T, N> {
        self.response(u + way * length)
    }

    /// Returns an impulse in K, which is r if that is in K.
    fn clamp(&self, r: Vector<T, N>) -> Vector<T, N>;

    /// Returns phi(u) - s(r) + r . u for an r in K: at least 0, and 0 exactly if r is the response
    /// to u. \[J\]
    ///
    /// The form avoids cancellation. With d = response - r it is the sum of d . R d / 2 and
    /// d . missing(u, response). Neither is negative, since the response is optimal in a convex
    /// set.
    #[inline(always)]
    fn loss(&self, u: Vector<T, N>, r: Vector<T, N>) -> T {
        let best = self.response(u);
        let d = best - r;
        T::from_f64(0.5) * d.dot(self.soften(d)) + d.dot(self.missing(u, best)).max(T::ZERO)
    }

    /// Returns a positive number if s is a parabola between r and the response to u, else 0.
    #[inline(always)]
    fn is_parabola(&self, _u: Vector<T, N>, _r: Vector<T, N>) -> T {
        T::ONE
    }
}

/// A [`Law`] with a derivative.
pub trait SmoothLaw<const N: usize>: Law<f64, N> {
    /// Returns -dr/du of the response: symmetric, positive semidefinite. \[kg, or kg m^2\]
    fn slope(&self, u: Vector<f64, N>) -> SymmetricMatrix<f64, N>;
}
