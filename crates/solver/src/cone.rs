//! The law of one contact: which impulse answers which velocity.
//!
//! With compliance R = diag(epsilon, epsilon_T, ...) > 0 the impulse r of a contact is a function of
//! what is missing to its target, y = t - u: the r of the friction cone
//!
//! K = { r_n >= 0, |r_T| <= mu (r_n + impact) }
//!
//! for which r . y - r . R r / 2 is largest. That maximum, phi(y), is convex in y, and r its gradient:
//! so a system of such contacts is the minimum of a convex function of the velocities
//! ([`newton`](crate::newton)), and how far any r is from the answer to y is a number that is
//! never negative ([`Law::loss`], on which [`certificate`](crate::certificate) rests).
//!
//! Coulomb's law is this one with y_n lowered by mu |slip| (De Saxce and Feng 1998): without, a
//! sliding contact would lift off at mu times its slip. [`Law::shift`] is that amount.

use crate::{Contact, Manifold, Real, SymmetricMatrix, Vector};

/// Friction and compliance of a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law<T: Real> {
    /// mu. \[1\]
    pub friction: T,
    /// Impulse of a collision in this step, which friction may lean on too. \[N s\]
    pub impact: T,
    /// epsilon. \[1/kg\]
    pub normal: T,
    /// epsilon_T. \[1/kg\]
    pub tangential: T,
}

impl<T: Real> Law<T> {
    /// The law of a prepared contact. Means nothing where nothing can move.
    #[inline(always)]
    pub fn of<const L: usize>(manifold: &Manifold<T, L>, contact: &Contact<T, L>) -> Self {
        Self {
            friction: manifold.friction,
            impact: contact.impact,
            normal: contact.compliance,
            tangential: contact.tangential_compliance,
        }
    }

    /// The slip that Coulomb's law looks at, u_T - t_T + epsilon_T r_T, times mu: what y_n is lowered
    /// by. \[m/s\]
    #[inline(always)]
    pub fn shift<const L: usize>(&self, y: Vector<T, L>, r: Vector<T, L>) -> T {
        let slip = r * self.tangential - y;
        self.friction * tangents(slip).length()
    }

    /// The impulse that answers `y`: argmax over K of r . y - r . R r / 2. \[N s\]
    #[inline(always)]
    pub fn response<const L: usize>(&self, y: Vector<T, L>) -> Vector<T, L> {
        let answer = self.respond(y);
        let mut r = y * answer.part;
        r[0] = answer.normal;
        r
    }

    #[inline(always)]
    fn respond<const L: usize>(&self, y: Vector<T, L>) -> Answer<T> {
        let mu = self.friction;
        let pull = tangents(y).length();
        // What sticks has r_n = y_n / epsilon and r_T = y_T / epsilon_T. Compared without dividing, and
        // for what is rigid as well.
        let held = self.tangential * mu;
        let free = pull - held * self.impact;
        let beyond = y[0].choose(self.normal * free - held * y[0], free);
        let missing = y[0] + mu * free;
        let [normal, stiff] =
            [beyond.choose(missing, y[0]), beyond.choose(self.normal + mu * held, self.normal)];
        let normal = (normal / stiff).max(T::ZERO);
        let [pushed, slip] = [
            beyond.choose(mu * (normal + self.impact), T::ONE),
            beyond.choose(pull, self.tangential),
        ];
        let part = pull.choose(pushed / slip, T::ZERO);
        Answer { normal, part, pull, beyond }
    }

    /// phi(y) + r . R r / 2 - r . y for an r of K: zero exactly if r answers y, else more. \[J\]
    ///
    /// Written so that nothing cancels: with d = response - r it is d . R d / 2 plus
    /// d . (y - R response), neither negative, since the response is best in a convex set.
    #[inline(always)]
    pub fn loss<const L: usize>(&self, y: Vector<T, L>, r: Vector<T, L>) -> T {
        let best = self.response(y);
        let d = best - r;
        T::from_f64(0.5) * d.dot(self.soften(d)) + d.dot(y - self.soften(best)).max(T::ZERO)
    }

    /// R r. \[m/s\]
    #[inline(always)]
    pub fn soften<const L: usize>(&self, r: Vector<T, L>) -> Vector<T, L> {
        let mut out = r * self.tangential;
        out[0] = r[0] * self.normal;
        out
    }

    /// The nearest impulse of K along the tangents. \[N s\]
    #[inline(always)]
    pub fn clamp<const L: usize>(&self, r: Vector<T, L>) -> Vector<T, L> {
        let normal = r[0].max(T::ZERO);
        let (radius, length) = (self.friction * (normal + self.impact), tangents(r).length());
        let mut out = r * (length - radius).choose(radius / length, T::ONE);
        out[0] = normal;
        out
    }
}

impl Law<f64> {
    /// The nearest impulse of K.
    pub fn nearest<const L: usize>(&self, mut r: Vector<f64, L>) -> Vector<f64, L> {
        // K is a cone with its apex at -impact, cut off where r_n is 0.
        let mut onto = r;
        onto[0] += self.impact;
        project(&mut onto.0, self.friction);
        onto[0] -= self.impact;
        if onto[0] >= 0.0 {
            return onto;
        }
        r[0] = 0.0;
        self.clamp(r)
    }

    /// The derivative of the response: how fast r follows y. Symmetric, never negative. \[kg\]
    pub fn slope<const L: usize>(&self, y: Vector<f64, L>) -> SymmetricMatrix<f64, L> {
        let Answer { normal, part, pull, beyond } = self.respond(y);
        let mut slope = SymmetricMatrix::ZERO;
        let radius = self.friction * (normal + self.impact);
        if beyond <= 0.0 {
            // On the edge it presses: what rests unpressed is about to be.
            if y[0] >= 0.0 {
                slope.0[0][0] = 1.0 / self.normal;
            }
            // Without a disc there is nothing to stick in.
            for i in 1..L {
                slope.0[i][i] = if radius > 0.0 { 1.0 / self.tangential } else { 0.0 };
            }
            return slope;
        }
        let along = tangents(y) * (1.0 / pull);
        for i in 1..L {
            slope.0[i][i] = part;
            for j in 1..L {
                slope.0[i][j] -= part * along[i] * along[j];
            }
        }
        if normal > 0.0 {
            // Pressing and pulling both change r_n, and with it the disc.
            let mut ray = along * self.friction;
            ray[0] = 1.0;
            let stiff = self.normal + self.friction * self.friction * self.tangential;
            for i in 0..L {
                for j in 0..L {
                    slope.0[i][j] += ray[i] * ray[j] / stiff;
                }
            }
        }
        slope
    }
}

/// What answers a velocity.
struct Answer<T> {
    /// r_n. \[N s\]
    normal: T,
    /// r_T over y_T. \[kg\]
    part: T,
    /// |y_T|. \[m/s\]
    pull: T,
    /// Positive where the contact slides.
    beyond: T,
}

/// `v` without its component along the normal.
#[inline(always)]
pub(crate) fn tangents<T: Real, const L: usize>(mut v: Vector<T, L>) -> Vector<T, L> {
    v[0] = T::ZERO;
    v
}

/// Moves z to the nearest point of the cone |z_t| <= mu z_n: z = (z_n, z_t), normal first. Without
/// tangents this is max(0, z_n); without friction it also removes the tangents.
///
/// The three cases are those of Tasora and Anitescu 2011: inside, below the polar cone, between.
pub fn project(z: &mut [f64], friction: f64) {
    let Some((normal, tangents)) = z.split_first_mut() else {
        return;
    };
    let slip = tangents.iter().map(|t| t * t).sum::<f64>().sqrt();
    if *normal >= 0.0 && slip <= friction * *normal {
        return;
    }
    if friction * slip <= -*normal {
        *normal = 0.0;
        tangents.fill(0.0);
        return;
    }
    *normal = (*normal + friction * slip) / (1.0 + friction * friction);
    // Where there are no tangents the length is zero, and nothing is scaled.
    for t in tangents {
        *t *= friction * *normal / slip;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn projected(mut z: [f64; 3], friction: f64) -> [f64; 3] {
        project(&mut z, friction);
        z
    }

    #[test]
    fn each_case_of_the_projection() {
        assert_eq!(projected([2.0, 0.5, 0.0], 0.5), [2.0, 0.5, 0.0]);
        assert_eq!(projected([-1.0, 0.0, 1.5], 0.5), [0.0; 3]);
        // (0, 3, 4) onto the edge of the cone with slope 1.
        let [n, a, b] = projected([0.0, 3.0, 4.0], 1.0);
        assert!((n - 2.5).abs() + (a - 1.5).abs() + (b - 2.0).abs() < 1e-15);
        assert_eq!(projected([1.0, 3.0, 4.0], 0.0), [1.0, 0.0, 0.0]);
        assert_eq!(projected([-1.0, 0.0, 0.0], 0.0), [0.0; 3]);
        let mut alone = [-2.0];
        project(&mut alone, 0.0);
        assert_eq!(alone, [0.0]);
    }
}
