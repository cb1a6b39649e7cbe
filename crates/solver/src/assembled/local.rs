//! Exact solution of one contact: u = A r + b with Signorini's condition and Coulomb's law.

use super::blocks::Block;
use crate::law::Interval;

/// Relative error of the sliding equation that counts as solved. \[1\]
const TOLERANCE: f64 = 1e-14;
/// Relative error from which one Newton step is enough. \[1\]
const ALMOST: f64 = 1e-8;
/// Largest number of Newton steps, or of bisections where Newton's method fails.
const STEPS: usize = 60;

/// Returns r of one contact with A_nn > 0.
///
/// There are three cases. The contact separates: b_n >= 0, r = 0. It sticks: u = 0 with r in the
/// cone. It slides: u_n = 0 and u_t = -lambda r_t with lambda > 0 such that |r_t| = mu r_n.
///
/// With r_n eliminated, S = A_tt - A_tn A_nt / A_nn and c = b_t - A_tn b_n / A_nn, sliding means
/// r_t = -(S + lambda)^-1 c: one equation for lambda (as a polynomial of degree four: Bonnefon and
/// Daviet 2011). If A is positive semidefinite it has a root whenever the contact does not stick.
/// |r_t| is too large at lambda = 0 and vanishes at infinity.
///
/// `lambda` is the initial guess, and receives the result. \[1/kg\]
pub(super) fn solve<const D: usize>(
    a: &Block<D>,
    b: &[f64; D],
    friction: f64,
    lambda: &mut f64,
) -> [f64; D] {
    let mut r = [0.0; D];
    if b[0] >= 0.0 {
        return r;
    }
    if D == 1 || friction == 0.0 {
        r[0] = -b[0] / a[0][0];
        return r;
    }
    let slide = if D == 2 { line(a, b, friction) } else { disc(a, b, friction, lambda) };
    if let Some((normal, tangents)) = slide
        && normal.is_finite()
        && normal > 0.0
    {
        r[0] = normal;
        r[1..].copy_from_slice(&tangents[..D - 1]);
    } else {
        // A is not positive semidefinite: the frictionless response always exists.
        r[0] = -b[0] / a[0][0];
    }
    r
}

/// Returns r of a block of rows of joints: each visited once, in order. A_kk > 0 for each.
pub(super) fn visit_rows<const D: usize>(
    a: &Block<D>,
    b: &[f64; D],
    laws: &[Interval<f64>],
    mut r: [f64; D],
) -> [f64; D] {
    for (k, law) in laws.iter().enumerate() {
        let u = b[k] + (0..D).map(|l| a[k][l] * r[l]).sum::<f64>();
        r[k] = law.visit(1.0 / a[k][k], u, r[k]);
    }
    r
}

/// Solves a contact with one tangent. There r_t has the sign of -c for every lambda.
fn line<const D: usize>(a: &Block<D>, b: &[f64; D], friction: f64) -> Option<(f64, [f64; 2])> {
    let coupling = a[0][1] / a[0][0];
    let s = a[1][1] - a[1][0] * coupling;
    let c = b[1] - a[1][0] * b[0] / a[0][0];
    let stick = -c / s;
    let normal = -b[0] / a[0][0] - coupling * stick;
    if stick.is_finite() && stick.abs() <= friction * normal {
        return Some((normal, [stick, 0.0]));
    }
    let side = if c > 0.0 { -friction } else { friction };
    let normal = -b[0] / (a[0][0] + side * a[0][1]);
    Some((normal, [side * normal, 0.0]))
}

/// Solves a contact with two tangents: it sticks, or it slides at the root of [`Sliding::error`].
fn disc<const D: usize>(
    a: &Block<D>,
    b: &[f64; D],
    friction: f64,
    lambda: &mut f64,
) -> Option<(f64, [f64; 2])> {
    let sliding = Sliding::of(a, b, friction);
    if sliding.determinant() > 1e-14 * sliding.size().powi(2) {
        let t = sliding.tangents(0.0);
        if length(t) <= friction * sliding.normal(t) {
            *lambda = 0.0;
            return Some((sliding.normal(t), t));
        }
    }
    if length(sliding.c) == 0.0 {
        return Some((sliding.free, [0.0; 2]));
    }
    let scale = 0.5 * sliding.size() + a[0][0] * f64::EPSILON;
    let start = if *lambda > 0.0 && lambda.is_finite() { *lambda } else { 0.1 * scale };
    *lambda = sliding.root(start);
    let t = sliding.tangents(*lambda);
    // Projects exactly onto the cone despite the rounding of lambda.
    let n = sliding.normal(t);
    let shrink = (friction * n / length(t)).min(1.0);
    Some((n, [shrink * t[0], shrink * t[1]]))
}

fn length(t: [f64; 2]) -> f64 {
    (t[0] * t[0] + t[1] * t[1]).sqrt()
}

/// Returns the product of a matrix and a vector.
fn times(m: [[f64; 2]; 2], x: [f64; 2]) -> [f64; 2] {
    m.map(|row| row[0] * x[0] + row[1] * x[1])
}

/// The sliding equation of a contact with two tangents, r_n eliminated.
struct Sliding {
    /// S, row by row.
    s: [[f64; 2]; 2],
    c: [f64; 2],
    /// -b_n / A_nn: r_n without tangential impulses.
    free: f64,
    /// A_nt, and 1 / A_nn.
    coupling: [f64; 2],
    inverse: f64,
    /// mu.
    friction: f64,
}

impl Sliding {
    fn of<const D: usize>(a: &Block<D>, b: &[f64; D], friction: f64) -> Self {
        let inverse = 1.0 / a[0][0];
        let s = |i: usize, j: usize| a[i][j] - a[i][0] * a[0][j] * inverse;
        Self {
            s: [[s(1, 1), s(1, 2)], [s(2, 1), s(2, 2)]],
            c: [b[1] - a[1][0] * b[0] * inverse, b[2] - a[2][0] * b[0] * inverse],
            free: -b[0] * inverse,
            coupling: [a[0][1], a[0][2]],
            inverse,
            friction,
        }
    }

    /// Returns the determinant of S.
    fn determinant(&self) -> f64 {
        let [[s11, s12], [s21, s22]] = self.s;
        s11 * s22 - s12 * s21
    }

    /// Returns the sum of the absolute diagonal entries of S.
    fn size(&self) -> f64 {
        self.s[0][0].abs() + self.s[1][1].abs()
    }

    /// Returns -(S + lambda)^-1.
    fn inverted(&self, lambda: f64) -> [[f64; 2]; 2] {
        let [[s11, s12], [s21, s22]] = self.s;
        let (p, q) = (s11 + lambda, s22 + lambda);
        let scale = 1.0 / (p * q - s12 * s21);
        [[-q * scale, s12 * scale], [s21 * scale, -p * scale]]
    }

    /// Returns r_t for this lambda.
    fn tangents(&self, lambda: f64) -> [f64; 2] {
        times(self.inverted(lambda), self.c)
    }

    /// Returns r_n for this r_t.
    fn normal(&self, t: [f64; 2]) -> f64 {
        self.free - (self.coupling[0] * t[0] + self.coupling[1] * t[1]) * self.inverse
    }

    /// Returns mu r_n / |r_t| - 1 at this lambda, which is nearly linear in lambda, and the next
    /// lambda of Newton's method.
    fn error(&self, lambda: f64) -> (f64, f64) {
        let solve = self.inverted(lambda);
        let t = times(solve, self.c);
        let (n, squared) = (self.normal(t), t[0] * t[0] + t[1] * t[1]);
        let part = self.friction / squared.sqrt();
        let error = part * n - 1.0;
        // d r_t / d lambda = -(S + lambda)^-1 r_t.
        let dt = times(solve, t);
        let dn = -(self.coupling[0] * dt[0] + self.coupling[1] * dt[1]) * self.inverse;
        let along = t[0] * dt[0] + t[1] * dt[1];
        (error, lambda - error * squared / (part * (dn * squared - n * along)))
    }

    /// Returns the root of the error, by Newton's method from `start` and bisection where that
    /// leaves the bracket.
    fn root(&self, start: f64) -> f64 {
        let (mut low, mut high, mut at) = (0.0, f64::INFINITY, start);
        for _ in 0..STEPS {
            let (error, newton) = self.error(at);
            if error.abs() <= TOLERANCE {
                break;
            }
            if error < 0.0 {
                low = at;
            } else {
                high = at;
            }
            let next = if newton > low && newton < high {
                newton
            } else if high.is_finite() {
                0.5 * (low + high)
            } else {
                4.0 * at
            };
            // Convergence is quadratic here, so a further step would only change rounding.
            let last = error.abs() <= ALMOST || (next - at).abs() <= f64::EPSILON * at;
            at = next;
            if last {
                break;
            }
        }
        at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the next number of a fixed pseudorandom sequence, in -1..1.
    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (*state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Checks Signorini's condition and Coulomb's law separately.
    fn check<const D: usize>(a: &Block<D>, b: &[f64; D], friction: f64, r: [f64; D]) {
        let u: [f64; D] =
            std::array::from_fn(|i| b[i] + (0..D).map(|j| a[i][j] * r[j]).sum::<f64>());
        let length = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
        let scale = length(b);
        let small = 1e-10 * scale;
        assert!(
            r[0] >= 0.0 && u[0] >= -small && (r[0] * u[0]).abs() <= 1e-9 * scale * (1.0 + r[0])
        );
        let (held, slip) = (length(&r[1..]), length(&u[1..]));
        assert!(held <= friction * r[0] * (1.0 + 1e-12) + 1e-14);
        if slip > 1e-8 * scale && r[0] > 0.0 {
            let power: f64 = (1..D).map(|i| r[i] * u[i]).sum();
            let most = friction * r[0] * slip;
            assert!((power + most).abs() <= 1e-8 * most.max(scale * r[0]), "{power} {most}");
        }
    }

    fn many<const D: usize>() {
        let state = &mut 7;
        for k in 0..2000 {
            let g: Block<D> = std::array::from_fn(|_| std::array::from_fn(|_| random(state)));
            let shift = if k % 3 == 0 { 1e-6 } else { 0.3 };
            let a: Block<D> = std::array::from_fn(|i| {
                std::array::from_fn(|j| {
                    let product: f64 = (0..D).map(|l| g[i][l] * g[j][l]).sum();
                    product + if i == j { shift } else { 0.0 }
                })
            });
            let b: [f64; D] = std::array::from_fn(|_| random(state));
            let friction = if k % 5 == 0 { 0.0 } else { random(state).abs() * 1.5 };
            let mut lambda = if k % 2 == 0 { 0.0 } else { random(state).abs() };
            let r = solve(&a, &b, friction, &mut lambda);
            check(&a, &b, friction, r);
        }
    }

    #[test]
    fn signorini_and_coulomb_hold_at_one_contact() {
        many::<1>();
        many::<2>();
        many::<3>();
    }
}
