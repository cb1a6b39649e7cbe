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

use crate::{Contact, Manifold, Scalar, SymmetricMatrix, Vector};

/// Friction and compliance of a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    /// mu. \[1\]
    pub friction: f64,
    /// Impulse of a collision in this step, which friction may lean on too. \[N s\]
    pub impact: f64,
    /// epsilon. \[1/kg\]
    pub normal: f64,
    /// epsilon_T. \[1/kg\]
    pub tangential: f64,
}

impl Law {
    /// The law of a prepared contact; `None` where nothing can move.
    pub fn of<T: Scalar, const L: usize>(
        manifold: &Manifold<T, L>,
        contact: &Contact<T, L>,
    ) -> Option<Self> {
        (contact.effective_mass.to_f64() > 0.0).then(|| Self {
            friction: manifold.friction.to_f64(),
            impact: contact.impact.to_f64(),
            normal: contact.compliance.to_f64(),
            tangential: contact.tangential_compliance().to_f64(),
        })
    }

    /// The slip that Coulomb's law looks at, u_T - t_T + epsilon_T r_T, times mu: what y_n is lowered
    /// by. \[m/s\]
    pub fn shift<const L: usize>(&self, y: Vector<f64, L>, r: Vector<f64, L>) -> f64 {
        let mut squared = 0.0;
        for i in 1..L {
            let slip = self.tangential * r[i] - y[i];
            squared += slip * slip;
        }
        self.friction * squared.sqrt()
    }

    /// The impulse that answers `y`: argmax over K of r . y - r . R r / 2. \[N s\]
    pub fn response<const L: usize>(&self, y: Vector<f64, L>) -> Vector<f64, L> {
        let (normal, part) = self.respond(y);
        let mut r = y * part;
        r[0] = normal;
        r
    }

    /// r_n, and r_T as a part of y_T.
    fn respond<const L: usize>(&self, y: Vector<f64, L>) -> (f64, f64) {
        let pull = tangents(y).length();
        let sticking = (y[0] / self.normal).max(0.0);
        if pull <= self.tangential * self.friction * (sticking + self.impact) {
            return (sticking, if pull > 0.0 { 1.0 / self.tangential } else { 0.0 });
        }
        let mu = self.friction;
        let stiff = self.normal + mu * mu * self.tangential;
        let sliding = y[0] + mu * (pull - mu * self.tangential * self.impact);
        let normal = (sliding / stiff).max(0.0);
        (normal, mu * (normal + self.impact) / pull)
    }

    /// The derivative of the response: how fast r follows y. Symmetric, never negative. \[kg\]
    pub fn slope<const L: usize>(&self, y: Vector<f64, L>) -> SymmetricMatrix<f64, L> {
        let (normal, part) = self.respond(y);
        let across = tangents(y);
        let pull = across.length();
        let mut slope = SymmetricMatrix::ZERO;
        let radius = self.friction * (normal + self.impact);
        if pull <= self.tangential * radius {
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
        let along = across * (1.0 / pull);
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

    /// phi(y) + r . R r / 2 - r . y for an r of K: zero exactly if r answers y, else more. \[J\]
    ///
    /// Written so that nothing cancels: with d = response - r it is d . R d / 2 plus
    /// d . (y - R response), neither negative, since the response is best in a convex set.
    pub fn loss<const L: usize>(&self, y: Vector<f64, L>, r: Vector<f64, L>) -> f64 {
        let best = self.response(y);
        let d = best - r;
        0.5 * d.dot(self.soften(d)) + d.dot(y - self.soften(best)).max(0.0)
    }

    /// R r. \[m/s\]
    pub fn soften<const L: usize>(&self, r: Vector<f64, L>) -> Vector<f64, L> {
        let mut out = r * self.tangential;
        out[0] = r[0] * self.normal;
        out
    }

    /// The nearest impulse of K along the tangents. \[N s\]
    pub fn clamp<const L: usize>(&self, r: Vector<f64, L>) -> Vector<f64, L> {
        let normal = r[0].max(0.0);
        let (radius, length) = (self.friction * (normal + self.impact), tangents(r).length());
        let mut out = if length > radius { r * (radius / length) } else { r };
        out[0] = normal;
        out
    }
}

/// `v` without its component along the normal.
pub(crate) fn tangents<const L: usize>(mut v: Vector<f64, L>) -> Vector<f64, L> {
    v[0] = 0.0;
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
