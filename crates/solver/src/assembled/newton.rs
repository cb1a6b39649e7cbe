//! Newton's method on the Fischer-Burmeister function, for any matrix without friction.
//!
//! phi(a, b) = a + b - sqrt(a^2 + b^2) is zero exactly where 0 <= a ⊥ b >= 0. The method solves
//! phi(z_i, w_i) = 0 with an element of its generalized Jacobian. Where Newton's direction is not a
//! descent direction it steps along the negative gradient of |phi|^2 / 2 (De Luca, Facchinei and
//! Kanzow 1996).
//!
//! Near a solution with a regular Jacobian convergence is quadratic. From afar it ends in a minimum
//! of |phi|, which for P_0-matrices is a solution. An iteration costs a dense factorization, 2/3
//! n^3. It finds solutions of games and circuits where Lemke's method ends on a ray.

use super::Problem;
use super::dense::Dense;
use super::outcome::{Limits, Outcome, Progress, Status};
use super::problem::{largest, transposed_product};

/// Largest problem; dense factorizations of larger ones take too long.
pub const MOST: usize = 1500;
/// Steps without a 1 % reduction of the residual after which the method counts as stalled.
const PATIENCE: usize = 100;

/// Takes Newton steps from `warm`, or from zero. Friction, or more than [`MOST`] contacts, are
/// `BadInput`.
pub fn solve(problem: &Problem, warm: Option<&[f64]>, limits: &Limits) -> Outcome {
    let (mut progress, mut z) = Progress::new(problem, warm, limits);
    if problem.dimension() != 1 {
        return progress.end(Status::BadInput, "this form of Newton's method knows no friction");
    }
    if !problem.rows().is_empty() {
        return progress
            .end(Status::BadInput, "this form of Newton's method knows no rows of joints");
    }
    if problem.unknowns() > MOST {
        return progress.end(Status::BadInput, "too large for dense factors");
    }
    // Scales w by 1 / max |M|, so that z and s w are comparable.
    let size = largest(problem.matrix().val());
    let s = if size > 0.0 { 1.0 / size } else { 1.0 };
    let mut map = Map::at(problem, s, &z);
    let (mut mark, mut marked_at) = (f64::INFINITY, 0);
    while !progress.converged() {
        if progress.spent() {
            return progress.out_of_budget();
        }
        if progress.residual() < 0.99 * mark {
            (mark, marked_at) = (progress.residual(), progress.iterations);
        } else if progress.iterations - marked_at >= PATIENCE {
            return progress.end(Status::Stalled, "the residual does not fall any more");
        }
        let Some(next) = map.step(problem, s, &z) else {
            return progress.end(Status::Stalled, "a minimum of the error that is no solution");
        };
        (z, map) = next;
        progress.iterations += 1;
        progress.record(&z);
    }
    progress.end(Status::Converged, "within the tolerance")
}

/// phi and its derivatives with respect to z and s w.
struct Map {
    value: Vec<f64>,
    by_z: Vec<f64>,
    by_w: Vec<f64>,
    /// |phi|^2 / 2
    merit: f64,
}

impl Map {
    fn at(problem: &Problem, s: f64, z: &[f64]) -> Self {
        let w = problem.velocities(z);
        let parts = |(&z, &w): (&f64, &f64)| {
            let (a, b) = (z, s * w);
            let length = a.hypot(b);
            if length > 0.0 {
                (a + b - length, 1.0 - a / length, 1.0 - b / length)
            } else {
                // Kink of phi: the element of the generalized derivative halfway between the two
                // sides.
                let part = 1.0 - std::f64::consts::FRAC_1_SQRT_2;
                (0.0, part, part)
            }
        };
        let (mut value, mut by_z, mut by_w) = (Vec::new(), Vec::new(), Vec::new());
        for (phi, dz, dw) in z.iter().zip(&w).map(parts) {
            value.push(phi);
            by_z.push(dz);
            by_w.push(dw);
        }
        let merit = 0.5 * value.iter().map(|x| x * x).sum::<f64>();
        Self { value, by_z, by_w, merit }
    }

    /// Returns the next iterate, or `None` if no direction leads down.
    fn step(&self, problem: &Problem, s: f64, z: &[f64]) -> Option<(Vec<f64>, Self)> {
        let n = z.len();
        let weighted: Vec<f64> = (0..n).map(|i| s * self.by_w[i] * self.value[i]).collect();
        let mut gradient = transposed_product(problem.matrix(), &weighted);
        for i in 0..n {
            gradient[i] += self.by_z[i] * self.value[i];
        }
        let squared: f64 = gradient.iter().map(|g| g * g).sum();
        let newton = self.direction(problem, s, 0.0);
        // Damping by a multiple of the identity, in case the Jacobian is singular.
        let damping = 1e-6 * self.merit.sqrt().clamp(1e-9, 1.0);
        let damped = || self.direction(problem, s, damping);
        let downhill = |d: &Vec<f64>| {
            let slope: f64 = d.iter().zip(&gradient).map(|(d, g)| d * g).sum();
            slope < -1e-12 * squared
        };
        let steepest: Vec<f64> = gradient.iter().map(|g| -g).collect();
        let candidates = [newton, damped(), Some(steepest)];
        candidates.into_iter().flatten().filter(downhill).find_map(|direction| {
            let slope: f64 = direction.iter().zip(&gradient).map(|(d, g)| d * g).sum();
            let mut length = 1.0;
            for _ in 0..40 {
                let trial: Vec<f64> =
                    z.iter().zip(&direction).map(|(z, d)| z + length * d).collect();
                let map = Map::at(problem, s, &trial);
                if map.merit <= self.merit + 1e-4 * length * slope {
                    return Some((trial, map));
                }
                length *= 0.5;
            }
            None
        })
    }

    /// Returns -H^-1 phi with H = diag(by_z + damping) + s diag(by_w) M.
    fn direction(&self, problem: &Problem, s: f64, damping: f64) -> Option<Vec<f64>> {
        let matrix = problem.matrix();
        let mut jacobian =
            Dense::from_fn(
                self.value.len(),
                |i, j| {
                    if i == j { self.by_z[i] + damping } else { 0.0 }
                },
            );
        for i in 0..self.value.len() {
            let by_w = s * self.by_w[i];
            let row = jacobian.row_mut(i);
            for (j, &m) in matrix.col_idx_of_row(i).zip(matrix.val_of_row(i)) {
                row[j] += by_w * m;
            }
        }
        let mut x: Vec<f64> = self.value.iter().map(|phi| -phi).collect();
        jacobian.factor()?.solve(&mut x);
        x.iter().all(|x| x.is_finite()).then_some(x)
    }
}
