//! Tension: the implicit term that keeps bodies which hang in pulling joints from oscillating.
//!
//! The moment of a joint's impulse changes while its body turns. For a link of length l between two
//! pulls T, that is a spring of stiffness T l. Explicit steps follow it only while
//! h < 2 sqrt(I / (T l)). At the end of a substep the moment is smaller by S omega h, with
//!
//! ```text
//! S = sum over the joints of (d . gamma)+ (1 - d d^T / d^2)    d: from the center of rotation to the
//!                                                              joint, gamma: impulse on the body
//! ```
//!
//! A body turns about one of its joints: the one about which it is pulled least. So a pendulum, which
//! one joint holds, has no S, and of two joints that pull against each other one holds the other's
//! lever. Where h S exceeds the inertia, the solve sees I + (h S - I)+ / 2 instead of I. Elsewhere
//! nothing changes.

use drystone_solver::SymmetricMatrix;

use super::coordinates::Vec3;

/// The pulls of joints on a body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pulls {
    /// Sums of r . gamma and of gamma over the joints. r: from the center of mass. \[N m s, N s\]
    levers: f64,
    impulse: Vec3,
    /// Joint about which the body is pulled least, and that pull. \[m, N m s\]
    center: Option<(Vec3, f64)>,
    /// S with pulls alone, and their sum. \[N m s\]
    stiffness: SymmetricMatrix<f64, 3>,
    sum: f64,
}

impl Pulls {
    pub(crate) const NONE: Self = Self {
        levers: 0.0,
        impulse: Vec3::ZERO,
        center: None,
        stiffness: SymmetricMatrix::ZERO,
        sum: 0.0,
    };

    /// Adds the impulse of a joint at an arm.
    pub(crate) fn add(&mut self, arm: Vec3, impulse: Vec3) {
        self.levers += arm.dot(impulse);
        self.impulse += impulse;
    }

    /// Takes the joint at this arm as the center of rotation if the body is pulled least about it.
    /// All impulses have been added.
    pub(crate) fn turn_about(&mut self, arm: Vec3) {
        let pull = self.levers - arm.dot(self.impulse);
        if self.center.is_none_or(|(_, least)| pull < least) {
            self.center = Some((arm, pull));
        }
    }

    /// Adds the joint at an arm to S. The center of rotation is known.
    pub(crate) fn stiffen(&mut self, arm: Vec3, impulse: Vec3) {
        let Some((center, whole)) = self.center else { return };
        let lever = arm - center;
        let (pull, squared) = (lever.dot(impulse), lever.dot(lever));
        if whole <= 0.0 || pull <= 0.0 {
            return;
        }
        for i in 0..3 {
            for j in 0..3 {
                let one = f64::from(u8::from(i == j));
                self.stiffness.0[i][j] += pull * (one - lever[i] * lever[j] / squared);
            }
        }
        self.sum += pull;
    }

    /// Returns S, or none if it is zero. Joints that push take from it. \[N m s\]
    pub(crate) fn stiffness(&self) -> Option<SymmetricMatrix<f64, 3>> {
        let (_, whole) = self.center?;
        let share = whole.min(self.sum) / self.sum;
        (self.sum > 0.0).then(|| SymmetricMatrix(self.stiffness.0.map(|row| row * share)))
    }
}

/// Finds S of bodies from the pulls on them: of each the index of its body, the arm and the impulse.
pub(crate) fn find(of: &mut [Pulls], pulls: impl Iterator<Item = (usize, Vec3, Vec3)> + Clone) {
    of.fill(Pulls::NONE);
    pulls.clone().for_each(|(body, arm, impulse)| of[body].add(arm, impulse));
    pulls.clone().for_each(|(body, arm, _)| of[body].turn_about(arm));
    pulls.for_each(|(body, arm, impulse)| of[body].stiffen(arm, impulse));
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
        let pulls = [
            (0, Vector([0.3, -0.4, 0.0]), Vector([2.0, -6.0, 5.0])),
            (0, Vector([0.0, 0.2, 0.1]), Vector([0.0, 5.0, 0.0])),
        ];
        let mut of = [Pulls::NONE];
        find(&mut of, pulls[..1].iter().copied());
        assert!(of[0].stiffness().is_none(), "one joint alone");
        find(&mut of, pulls.iter().copied());
        let stiffness = of[0].stiffness().expect("two pulls");
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

    /// S does not depend on the point about which arms are given, where the impulses balance.
    #[test]
    fn a_body_between_two_pulls_has_their_distance_as_its_lever() {
        for offset in [0.0, 0.3, -0.7, 1.0] {
            let (up, down) = (Vector([0.0, 0.5 + offset, 0.0]), Vector([0.0, offset - 0.5, 0.0]));
            let pull = Vector([0.0, 4.0, 0.0]);
            let mut of = [Pulls::NONE];
            find(&mut of, [(0, up, pull), (0, down, pull * -1.0)].into_iter());
            let stiffness = of[0].stiffness().expect("two pulls");
            assert_eq!(stiffness, SymmetricMatrix::diagonal(Vector([4.0, 0.0, 4.0])), "{offset}");
            find(&mut of, [(0, up, pull * -1.0), (0, down, pull)].into_iter());
            assert!(of[0].stiffness().is_none(), "pushes");
        }
    }
}
