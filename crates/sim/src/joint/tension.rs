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

use drystone_solver::{SymmetricMatrix, Vector};

use super::coordinates::Vec3;

/// Adds the term of an impulse at an arm to S, if it pulls away from the center. \[N m s\]
pub(crate) fn add(sum: &mut SymmetricMatrix<f64, 3>, arm: Vec3, impulse: Vec3) {
    let (pull, squared) = (arm.dot(impulse), arm.dot(arm));
    if pull > 0.0 {
        for i in 0..3 {
            for j in i..3 {
                let one = f64::from(u8::from(i == j));
                sum.0[i][j] += pull * (one - arm[i] * arm[j] / squared);
            }
        }
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
        for j in i..A {
            let own = if A == 1 { stiffness.entry(2, 2) } else { stiffness.entry(i, j) };
            excess.0[i][j] = h * own - inertia.entry(i, j);
        }
    }
    if (0..A).all(|i| excess.entry(i, i) <= 0.0) {
        return None;
    }
    let (values, axes) = eigen(excess);
    let mut out = SymmetricMatrix::<f64, A>::ZERO;
    for (value, axis) in values.iter().zip(&axes).filter(|(value, _)| **value > 0.0) {
        for i in 0..A {
            for j in i..A {
                out.0[i][j] += 0.5 * value * axis[i] * axis[j];
            }
        }
    }
    Some(out)
}

/// Returns the eigenvalues and eigenvectors of a symmetric matrix, by Jacobi rotations.
fn eigen<const A: usize>(matrix: SymmetricMatrix<f64, A>) -> ([f64; A], [Vector<f64, A>; A]) {
    let mut a: [[f64; A]; A] = std::array::from_fn(|i| std::array::from_fn(|j| matrix.entry(i, j)));
    let mut axes: [Vector<f64, A>; A] =
        std::array::from_fn(|i| Vector(std::array::from_fn(|j| f64::from(u8::from(i == j)))));
    for _ in 0..8 {
        for p in 0..A {
            for q in p + 1..A {
                if a[p][q] == 0.0 {
                    continue;
                }
                // The rotation in the plane of p and q that makes a[p][q] zero.
                let ratio = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let tangent =
                    1.0_f64.copysign(ratio) / (ratio.abs() + (ratio * ratio + 1.0).sqrt());
                let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
                let sine = tangent * cosine;
                for k in 0..A {
                    let (x, y) = (a[k][p], a[k][q]);
                    (a[k][p], a[k][q]) = (cosine * x - sine * y, sine * x + cosine * y);
                }
                for k in 0..A {
                    let (x, y) = (a[p][k], a[q][k]);
                    (a[p][k], a[q][k]) = (cosine * x - sine * y, sine * x + cosine * y);
                }
                let (x, y) = (axes[p], axes[q]);
                axes[p] = x * cosine - y * sine;
                axes[q] = x * sine + y * cosine;
            }
        }
    }
    (std::array::from_fn(|i| a[i][i]), axes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The positive part of a matrix has its eigenvectors, and the rest of it has no positive
    /// eigenvalue.
    #[test]
    fn the_surplus_is_half_of_the_positive_part() {
        let mut stiffness = SymmetricMatrix::ZERO;
        add(&mut stiffness, Vector([0.3, -0.4, 0.0]), Vector([2.0, -1.0, 5.0]));
        add(&mut stiffness, Vector([0.0, 0.2, 0.1]), Vector([0.0, 3.0, 0.0]));
        add(&mut stiffness, Vector([0.0, 1.0, 0.0]), Vector([0.0, -9.0, 0.0]));
        let inertia = SymmetricMatrix::diagonal(Vector([0.5, 1.1, 0.2]));
        let surplus = surplus(&stiffness, &inertia, 1.0).expect("h S exceeds I");
        let mut rest = SymmetricMatrix::<f64, 3>::ZERO;
        for i in 0..3 {
            for j in i..3 {
                rest.0[i][j] = stiffness.entry(i, j) - inertia.entry(i, j);
                rest.0[i][j] -= 2.0 * surplus.entry(i, j);
            }
        }
        let (least, most) = (eigen(rest).0, eigen(surplus).0);
        assert!(least.iter().all(|value| *value < 1e-12), "{least:?}");
        assert!(most.iter().all(|value| *value > -1e-12) && most.iter().any(|v| *v > 0.1));
        assert!(super::surplus(&stiffness, &inertia, 1e-3).is_none());
        let plane = SymmetricMatrix::diagonal(Vector([0.25]));
        let of_plane = super::surplus(&stiffness, &plane, 1.0).map(|of| of.entry(0, 0));
        assert_eq!(of_plane, Some(0.5 * (stiffness.entry(2, 2) - 0.25)));
    }
}
