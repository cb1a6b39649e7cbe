//! [`Cone`]: the law of a contact with Coulomb friction.
//!
//! The impulse r of a contact lies in the friction cone
//!
//! K = { r_n >= 0, |r_T| <= mu (r_n + impact) },
//!
//! with compliance R = diag(epsilon, epsilon_T, ...) > 0. Coulomb's law is the law of K with the
//! target of the normal lowered by mu |slip| (De Saxce and Feng 1998). Without that
//! [shift](Cone::shift) a sliding contact would separate at mu times its slip velocity.

use super::{Law, SmoothLaw};
use crate::{Contact, Manifold, Real, SymmetricMatrix, Vector};

/// Friction, compliance and targets of a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone<T: Real, const L: usize> {
    /// Coefficient mu. \[1\]
    pub friction: T,
    /// Impulse of a collision in this step, which also bears friction. \[N s\]
    pub impact: T,
    /// Normal compliance epsilon. \[1/kg\]
    pub normal: T,
    /// Tangential compliance epsilon_T. \[1/kg\]
    pub tangential: T,
    /// Target t of the velocity. \[m/s\]
    pub target: Vector<T, L>,
    /// Shift of Coulomb's law, by which the target of the normal is lowered. \[m/s\]
    pub lowered: T,
}

impl<T: Real, const L: usize> Cone<T, L> {
    /// Returns the law of a prepared contact, without a shift; meaningless where nothing can move.
    #[inline(always)]
    pub fn of(manifold: &Manifold<T, L>, contact: &Contact<T, L>) -> Self {
        Self {
            friction: manifold.friction,
            impact: contact.impact,
            normal: contact.compliance,
            tangential: contact.tangential_compliance,
            target: contact.target,
            lowered: T::ZERO,
        }
    }

    /// Returns the shift of Coulomb's law: mu times the length of the slip u_T - t_T + epsilon_T
    /// r_T. \[m/s\]
    #[inline(always)]
    pub fn shift(&self, u: Vector<T, L>, r: Vector<T, L>) -> T {
        let slip = r * self.tangential - (self.target - u);
        self.friction * tangents(slip).length()
    }

    /// Returns Coulomb's law for this slip: with the [`shift`](Self::shift) of u and r.
    #[inline(always)]
    pub fn shifted(&self, u: Vector<T, L>, r: Vector<T, L>) -> Self {
        Self { lowered: self.shift(u, r), ..*self }
    }

    /// Returns t - u, lowered by the shift.
    #[inline(always)]
    fn pull(&self, u: Vector<T, L>) -> Vector<T, L> {
        let mut y = self.target - u;
        y[0] -= self.lowered;
        y
    }

    /// Returns the impulse that answers the missing velocity y.
    #[inline(always)]
    fn respond_to(&self, y: Vector<T, L>) -> Vector<T, L> {
        let answer = self.respond(y);
        let mut r = y * answer.part;
        r[0] = answer.normal;
        r
    }

    #[inline(always)]
    fn respond(&self, y: Vector<T, L>) -> Answer<T> {
        let mu = self.friction;
        let pull = tangents(y).length();
        // Sticking has r_n = y_n / epsilon and r_T = y_T / epsilon_T. The comparison avoids
        // division, so it also works for rigid contacts.
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
}

impl<T: Real, const L: usize> Law<T, L> for Cone<T, L> {
    #[inline(always)]
    fn missing(&self, u: Vector<T, L>, r: Vector<T, L>) -> Vector<T, L> {
        self.pull(u) - self.soften(r)
    }

    #[inline(always)]
    fn soften(&self, r: Vector<T, L>) -> Vector<T, L> {
        let mut out = r * self.tangential;
        out[0] = r[0] * self.normal;
        out
    }

    #[inline(always)]
    fn response(&self, u: Vector<T, L>) -> Vector<T, L> {
        self.respond_to(self.pull(u))
    }

    /// Subtracts the way from what is missing, so that u and its target cancel first.
    #[inline(always)]
    fn response_along(&self, u: Vector<T, L>, way: Vector<T, L>, length: T) -> Vector<T, L> {
        self.respond_to(self.pull(u) - way * length)
    }

    /// Projects onto K along the tangents, after the normal component.
    #[inline(always)]
    fn clamp(&self, r: Vector<T, L>) -> Vector<T, L> {
        let normal = r[0].max(T::ZERO);
        let (radius, length) = (self.friction * (normal + self.impact), tangents(r).length());
        let mut out = r * (length - radius).choose(radius / length, T::ONE);
        out[0] = normal;
        out
    }
}

impl<const L: usize> Cone<f64, L> {
    /// Returns the nearest impulse in K. \[N s\]
    pub fn nearest(&self, mut r: Vector<f64, L>) -> Vector<f64, L> {
        // K is a cone with its apex at r_n = -impact, cut off at r_n = 0.
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
}

impl<const L: usize> SmoothLaw<L> for Cone<f64, L> {
    fn slope(&self, u: Vector<f64, L>) -> SymmetricMatrix<f64, L> {
        let y = self.pull(u);
        let Answer { normal, part, pull, beyond } = self.respond(y);
        let mut slope = SymmetricMatrix::ZERO;
        let radius = self.friction * (normal + self.impact);
        if beyond <= 0.0 {
            // On the boundary y_n = 0 the contact counts as pressed: a resting contact without load
            // is about to get one.
            if y[0] >= 0.0 {
                slope.0[0][0] = 1.0 / self.normal;
            }
            // Without a disc nothing can stick.
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
            // Normal and tangential velocities both change r_n, and with it the disc.
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

/// Response to a velocity, in parts.
struct Answer<T> {
    /// r_n. \[N s\]
    normal: T,
    /// r_T / y_T. \[kg\]
    part: T,
    /// |y_T|. \[m/s\]
    pull: T,
    /// Positive if the contact slides.
    beyond: T,
}

/// Returns `v` without its normal component.
#[inline(always)]
fn tangents<T: Real, const L: usize>(mut v: Vector<T, L>) -> Vector<T, L> {
    v[0] = T::ZERO;
    v
}

/// Projects z = (z_n, z_t), normal first, onto the cone |z_t| <= mu z_n. Without tangents this is
/// max(0, z_n); without friction it also removes the tangents.
///
/// The three cases are those of Tasora and Anitescu 2011: inside the cone, inside the polar cone,
/// between them.
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
    // Without tangents the slip is zero, and this loop is empty.
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
        // (0, 3, 4) is projected to the edge of the cone with slope 1.
        let [n, a, b] = projected([0.0, 3.0, 4.0], 1.0);
        assert!((n - 2.5).abs() + (a - 1.5).abs() + (b - 2.0).abs() < 1e-15);
        assert_eq!(projected([1.0, 3.0, 4.0], 0.0), [1.0, 0.0, 0.0]);
        assert_eq!(projected([-1.0, 0.0, 0.0], 0.0), [0.0; 3]);
        let mut alone = [-2.0];
        project(&mut alone, 0.0);
        assert_eq!(alone, [0.0]);
    }
}
