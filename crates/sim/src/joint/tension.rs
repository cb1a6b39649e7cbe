//! Tension: the implicit term that keeps bodies which hang in pulling joints from oscillating.
//!
//! The moment of a joint's impulse changes while its body turns. For a link of length l between two
//! pulls T, that is a spring of stiffness T l. Explicit steps follow it only while
//! h < 2 sqrt(I / (T l)). At the end of a substep the moment is smaller by S omega h, with
//!
//! ```text
//! S = sum over the joints of (r . gamma)+ (1 - r r^T / r^2)        r: arm, gamma: impulse
//! ```
//!
//! Where h S exceeds the inertia, the solve sees I + (h S - I)+ / 2 instead of I. Elsewhere nothing
//! changes.

use drystone_solver::SymmetricMatrix;

use super::coordinates::Vec3;

/// The pulls on a body, summed up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Tension {
    /// S. \[N m s\]
    stiffness: SymmetricMatrix<f64, 3>,
    /// Sum of (r . gamma)+, and its largest term. \[N m s\]
    pulls: [f64; 2],
}

impl Tension {
    /// Adds the impulse of a joint at an arm.
    pub(crate) fn add(&mut self, arm: Vec3, impulse: Vec3) {
        let (pull, squared) = (arm.dot(impulse), arm.dot(arm));
        if pull > 0.0 {
            for i in 0..3 {
                for j in 0..3 {
                    let one = f64::from(u8::from(i == j));
                    self.stiffness.0[i][j] += pull * (one - arm[i] * arm[j] / squared);
                }
            }
            self.pulls = [self.pulls[0] + pull, self.pulls[1].max(pull)];
        }
    }

    /// Returns the part of S from pulls that others balance. A body that one joint alone pulls turns
    /// about that joint, with all of its mass.
    pub(crate) fn balanced(&self) -> Option<SymmetricMatrix<f64, 3>> {
        let [sum, largest] = self.pulls;
        let share = if sum > 0.0 { (2.0 * (sum - largest) / sum).min(1.0) } else { 0.0 };
        (share > 0.0).then(|| SymmetricMatrix(self.stiffness.0.map(|row| row * share)))
    }
}

/// Returns (h S - I)+ / 2, or none if it is zero. \[kg m^2\]
pub(crate) fn surplus<const A: usize>(
    stiffness: &SymmetricMatrix<f64, 3>,
    inertia: &SymmetricMatrix<f64, A>,
    h: f64,
) -> Option<SymmetricMatrix<f64, A>> {
    let mut excess = SymmetricMatrix::<f64, A>::ZERO;
    for i in 0..A {
        for j in 0..A {
            let own = if A == 1 { stiffness.entry(2, 2) } else { stiffness.entry(i, j) };
            excess.0[i][j] = h * own - inertia.entry(i, j);
        }
    }
    let bound = |i: usize| (0..A).map(|j| excess.entry(i, j).abs()).sum::<f64>();
    // All eigenvalues are below the largest diagonal entry plus the rest of its row.
    if (0..A).all(|i| excess.entry(i, i) + bound(i) - excess.entry(i, i).abs() <= 0.0) {
        return None;
    }
    let surplus = excess.spectral(|value| 0.5 * value.max(0.0));
    (surplus != SymmetricMatrix::ZERO).then_some(surplus)
}

#[cfg(test)]
mod tests {
    use drystone_solver::Vector;

    use super::*;

    /// The positive part of a matrix has its eigenvectors, and the rest of it has no positive
    /// eigenvalue.
    #[test]
    fn the_surplus_is_half_of_the_positive_part() {
        let mut tension = Tension::default();
        tension.add(Vector([0.3, -0.4, 0.0]), Vector([2.0, -1.0, 5.0]));
        assert_eq!(tension.balanced(), None, "one joint alone");
        tension.add(Vector([0.0, 0.2, 0.1]), Vector([0.0, 5.0, 0.0]));
        tension.add(Vector([0.0, 1.0, 0.0]), Vector([0.0, -9.0, 0.0]));
        let stiffness = tension.balanced().expect("two pulls");
        let inertia = SymmetricMatrix::diagonal(Vector([0.5, 1.1, 0.2]));
        let surplus = surplus(&stiffness, &inertia, 1.0).expect("h S exceeds I");
        let mut rest = SymmetricMatrix::<f64, 3>::ZERO;
        for i in 0..3 {
            for j in 0..3 {
                rest.0[i][j] = stiffness.entry(i, j) - inertia.entry(i, j);
                rest.0[i][j] -= 2.0 * surplus.entry(i, j);
            }
        }
        let (least, most) = (rest.eigen().0.0, surplus.eigen().0.0);
        assert!(least.iter().all(|value| *value < 1e-12), "{least:?}");
        assert!(most.iter().all(|value| *value > -1e-12) && most.iter().any(|v| *v > 0.1));
        assert!(super::surplus(&stiffness, &inertia, 1e-3).is_none());
        let plane = SymmetricMatrix::diagonal(Vector([0.25]));
        let of_plane = super::surplus(&stiffness, &plane, 1.0).map(|of| of.entry(0, 0));
        assert_eq!(of_plane, Some(0.5 * (stiffness.entry(2, 2) - 0.25)));
    }
}
