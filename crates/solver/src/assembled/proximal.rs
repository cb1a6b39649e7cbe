//! Proximal-point method with semismooth Newton steps, for exact Coulomb friction.
//!
//! W is singular wherever there are more contacts than velocities, which defeats Newton's method.
//! The proximal-point method solves a sequence of problems with W + alpha and q - alpha c instead,
//! where c is the previous solution (Rockafellar 1976; for friction Acary, Bremond and Huber 2018).
//! alpha is lowered as long as that succeeds; at the fixed point the shift has no effect.
//!
//! Each of these problems is solved by Newton's method on the equations of Alart and Curnier
//! (1991), with y = r - rho u:
//!
//! r_n = max(0, y_n), r_t = y_t projected onto the disc of radius mu max(0, y_n).
//!
//! Rows of joints have r = clamp(max(0, r - rho (u - t-)) + min(0, r - rho (u - t+)), lo, hi).
//! Each contact is in one of three cases: open, sticking, sliding. A line search on |F|^2 guards
//! the steps. Where it fails, Gauss-Seidel sweeps on the shifted problem provide a new start.
//!
//! An iteration is a Newton step: one sparse factorization with one block per coupled pair of
//! contacts. Near a solution convergence is fast and exact up to rounding, for singular and for
//! unsymmetric W. With friction there is no proof of global convergence, since a solution need not
//! exist. With one row per contact this is the primal-dual active set method for complementarity
//! problems.

use super::Problem;
use super::block_gauss_seidel::Sweeper;
use super::block_lu::{BlockLu, Structure};
use super::blocks::{Block, Blocks, joined, laws, split};
use super::outcome::{Limits, Outcome, Progress, Status};
use crate::law::Interval;

/// First, smallest and largest alpha, relative to the mean diagonal entry of W.
const SHIFT: (f64, f64, f64) = (1e-4, 1e-11, 1e2);
/// Largest number of Newton steps for one proximal point.
const STEPS: usize = 30;
/// The search for a point is given up if this many steps do not halve |F|^2.
const SPAN: usize = 8;
/// The line search compares with the largest |F|^2 of this many steps.
const RECENT: usize = 4;
/// Largest number of halvings in a line search.
const HALVINGS: usize = 14;
/// Sweeps for a new start.
const SWEEPS: usize = 60;
/// Consecutive points without progress after which the method counts as stalled.
const PATIENCE: usize = 20;

/// Takes Newton steps from `warm`, or from the result of a few sweeps if that is `None`. `Stalled`
/// means that no proximal points were found, or that they do not come nearer.
pub fn solve(problem: &Problem, warm: Option<&[f64]>, limits: &Limits) -> Outcome {
    solve_as(&structure(problem), problem, warm, limits)
}

/// Finds what several solves of a problem have in common.
pub(crate) fn structure(problem: &Problem) -> Structure {
    Structure::of(problem.matrix(), problem.dimension())
}

/// [Solves](solve) a problem of this structure.
pub(crate) fn solve_as(
    structure: &Structure,
    problem: &Problem,
    warm: Option<&[f64]>,
    limits: &Limits,
) -> Outcome {
    match problem.dimension() {
        1 => points::<1>(structure, problem, warm, limits),
        2 => points::<2>(structure, problem, warm, limits),
        _ => points::<3>(structure, problem, warm, limits),
    }
}

fn points<const D: usize>(
    structure: &Structure,
    problem: &Problem,
    warm: Option<&[f64]>,
    limits: &Limits,
) -> Outcome {
    let blocks = Blocks::<D>::new(problem.matrix());
    let offset = split::<D>(problem.offset());
    let (mut progress, start) = Progress::new(problem, warm, limits);
    if progress.converged() {
        return progress.end(Status::Converged, "the start is a solution");
    }
    let mut scale = blocks.mean_diagonal();
    if !scale.is_finite() || scale <= 0.0 {
        scale = super::problem::largest(problem.matrix().val()).max(f64::MIN_POSITIVE);
    }
    let mut sweeper = Sweeper::new(&blocks, &offset, problem);
    let mut newton =
        Newton { blocks: &blocks, offset: &offset, problem, lu: BlockLu::new(structure) };
    let mut r = split::<D>(&start);
    if let (None, Some(sweeper)) = (warm, &mut sweeper) {
        (0..SWEEPS).for_each(|_| _ = sweeper.sweep(&mut r, 0.0, &[]));
        progress.record(joined(&r, problem));
    }
    let mut shift = Shift { alpha: SHIFT.0, least: SHIFT.1 };
    let (mut mark, mut idle) = (f64::INFINITY, 0);
    let mut center = r.clone();
    let mut again = true;
    while !progress.converged() {
        if progress.spent() {
            return progress.out_of_budget();
        }
        let alpha = shift.alpha * scale;
        if newton.point(&mut r, &center, alpha, &mut progress) {
            shift.found();
            center.clone_from(&r);
            again = true;
        } else {
            // The first failure is followed by sweeps from the current r alone; the second by a
            // larger shift and sweeps from the last proximal point.
            again = !again;
            if again {
                shift.missed();
                r.clone_from(&center);
            }
            if let Some(sweeper) = &mut sweeper {
                (0..SWEEPS).for_each(|_| _ = sweeper.sweep(&mut r, shift.alpha * scale, &center));
                progress.record(joined(&r, problem));
            }
        }
        idle += 1;
        if progress.residual() < 0.9 * mark {
            (mark, idle) = (progress.residual(), 0);
        } else if idle > PATIENCE {
            return progress.end(Status::Stalled, "the proximal points come no nearer");
        }
    }
    progress.end(Status::Converged, "within the tolerance")
}

/// alpha over the mean diagonal of W, as small as Newton's method can handle.
struct Shift {
    alpha: f64,
    least: f64,
}

impl Shift {
    /// Lowers the shift, but only slowly below a value that has failed.
    fn found(&mut self) {
        self.alpha = (0.1 * self.alpha).max(self.least);
        self.least = (0.5 * self.least).max(SHIFT.1);
    }

    fn missed(&mut self) {
        self.alpha = (10.0 * self.alpha).min(SHIFT.2);
        self.least = self.alpha;
    }
}

struct Newton<'a, const D: usize> {
    blocks: &'a Blocks<D>,
    offset: &'a [[f64; D]],
    problem: &'a Problem,
    lu: BlockLu<'a, D>,
}

/// The equations of a block at a given r.
struct Equation<const D: usize> {
    /// F.
    error: [f64; D],
    /// C and E, from the derivative C (W + alpha)_i + E.
    by: Block<D>,
    plus: Block<D>,
    /// Right-hand side of Newton's equations.
    wanted: [f64; D],
}

/// The equations of Alart and Curnier at a given r.
struct Equations<const D: usize> {
    /// C_i and E_i, from the derivative C_i (W + alpha)_i + E_i.
    rows: Vec<(Block<D>, Block<D>)>,
    /// Right-hand side of Newton's equations.
    rhs: Vec<[f64; D]>,
    /// Sum of |F|^2 W_nn: an energy. \[J\]
    merit: f64,
}

impl<const D: usize> Newton<'_, D> {
    /// Moves r to the proximal point of the center; returns true if it was found.
    fn point(
        &mut self,
        r: &mut Vec<[f64; D]>,
        center: &[[f64; D]],
        alpha: f64,
        progress: &mut Progress<'_>,
    ) -> bool {
        let mut image = self.image(r);
        let mut equations = self.equations(r, &image, center, alpha);
        let mut merits = vec![equations.merit];
        for _ in 0..STEPS {
            if progress.spent() || !equations.merit.is_finite() {
                return false;
            }
            let Some(direction) = self.direction(&equations, alpha) else {
                return false;
            };
            progress.iterations += 1;
            // W (r + t d) = W r + t W d: a trial needs no matrix product.
            let way = self.image(&direction);
            // Nonmonotone line search: a step must undercut the largest recent value.
            let recent = merits.iter().rev().take(RECENT);
            let highest = recent.fold(0.0, |highest: f64, &x| highest.max(x));
            let mut length = 1.0;
            let mut next = None;
            for _ in 0..HALVINGS {
                let trial = along(r, &direction, length);
                let moved = along(&image, &way, length);
                let at = self.equations(&trial, &moved, center, alpha);
                if at.merit <= (1.0 - 1e-3 * length) * highest {
                    next = Some((trial, moved, at));
                    break;
                }
                length *= 0.5;
            }
            let Some((trial, moved, at)) = next else {
                return false;
            };
            (*r, image, equations) = (trial, moved, at);
            merits.push(equations.merit);
            progress.record(joined(r, self.problem));
            if progress.converged() {
                return true;
            }
            // Accurate enough relative to the distance from the center.
            if equations.merit <= 1e-4 * self.shift_energy(r, center, alpha) {
                return true;
            }
            let before = merits.len().checked_sub(1 + SPAN).map(|at| merits[at]);
            if before.is_some_and(|before| equations.merit > 0.5 * before) {
                return false;
            }
        }
        false
    }

    /// Returns |alpha (r - c)|^2 over the mean diagonal of W. \[J\]
    fn shift_energy(&self, r: &[[f64; D]], center: &[[f64; D]], alpha: f64) -> f64 {
        let pairs = r.as_flattened().iter().zip(center.as_flattened());
        let squared = pairs.map(|(r, c)| (alpha * (r - c)).powi(2)).sum::<f64>();
        squared / self.blocks.mean_diagonal().max(f64::MIN_POSITIVE)
    }

    /// Returns W r.
    fn image(&self, r: &[[f64; D]]) -> Vec<[f64; D]> {
        (0..r.len()).map(|i| self.blocks.product(i, r)).collect()
    }

    /// Evaluates the equations at r, with W r in `image`.
    fn equations(
        &self,
        r: &[[f64; D]],
        image: &[[f64; D]],
        center: &[[f64; D]],
        alpha: f64,
    ) -> Equations<D> {
        let n = self.blocks.len();
        let (mut rows, mut rhs) = (Vec::with_capacity(n), Vec::with_capacity(n));
        let mut merit = 0.0;
        for i in 0..n {
            let mut u = image[i];
            for k in 0..D {
                u[k] += self.offset[i][k] + alpha * (r[i][k] - center[i][k]);
            }
            let diagonal = self.blocks.diagonal(i);
            let equation = if let Some(laws) = laws::<D>(self.problem, i) {
                let steps = std::array::from_fn(|k| 1.0 / (diagonal[k][k].max(0.0) + alpha));
                let equation = joint_rows(&r[i], &u, laws, steps);
                merit += equation.error.iter().zip(steps).map(|(x, s)| x * x / s).sum::<f64>();
                equation
            } else {
                let tangential: f64 =
                    (1..D).map(|k| diagonal[k][k]).sum::<f64>() / (D - 1).max(1) as f64;
                let steps = [diagonal[0][0], tangential].map(|w| 1.0 / (w.max(0.0) + alpha));
                let equation = contact(&r[i], &u, self.problem.friction()[i], steps);
                merit += equation.error.iter().map(|x| x * x).sum::<f64>() / steps[0];
                equation
            };
            rows.push((equation.by, equation.plus));
            rhs.push(equation.wanted);
        }
        Equations { rows, rhs, merit }
    }

    /// Solves the linear equations, with one step of refinement.
    fn direction(&mut self, equations: &Equations<D>, alpha: f64) -> Option<Vec<[f64; D]>> {
        // C (W + alpha) + E = C W + (alpha C + E).
        let shifted = |(by, plus): &(Block<D>, Block<D>)| {
            let mut plus = *plus;
            for k in 0..D {
                for l in 0..D {
                    plus[k][l] += alpha * by[k][l];
                }
            }
            (*by, plus)
        };
        let rows: Vec<_> = equations.rows.iter().map(shifted).collect();
        // The step of an open contact is known: it takes its impulse to 0.
        let open: Vec<bool> = rows.iter().map(|(by, _)| *by == [[0.0; D]; D]).collect();
        self.lu.factor(self.blocks, &rows, &open)?;
        let mut x = vec![[0.0; D]; rows.len()];
        for i in (0..rows.len()).filter(|&i| open[i]) {
            x[i] = equations.rhs[i];
        }
        for _ in 0..2 {
            let mut rest = equations.rhs.clone();
            for (i, (by, plus)) in rows.iter().enumerate() {
                let w_x = if open[i] { [0.0; D] } else { self.blocks.product(i, &x) };
                for k in 0..D {
                    for l in 0..D {
                        rest[i][k] -= by[k][l] * w_x[l] + plus[k][l] * x[i][l];
                    }
                }
            }
            self.lu.solve(&mut rest);
            x = along(&x, &rest, 1.0);
        }
        x.as_flattened().iter().all(|x| x.is_finite()).then_some(x)
    }
}

fn along<const D: usize>(r: &[[f64; D]], by: &[[f64; D]], length: f64) -> Vec<[f64; D]> {
    let one = |(r, d): (&[f64; D], &[f64; D])| std::array::from_fn(|k| r[k] + length * d[k]);
    r.iter().zip(by).map(one).collect()
}

/// Returns the equations of a block of rows of joints. Unknowns that fill up the block stay 0.
fn joint_rows<const D: usize>(
    r: &[f64; D],
    u: &[f64; D],
    laws: &[Interval<f64>],
    steps: [f64; D],
) -> Equation<D> {
    let (mut error, mut by, mut plus) = (*r, [[0.0; D]; D], [[0.0; D]; D]);
    for k in 0..D {
        let Some(law) = laws.get(k) else {
            plus[k][k] = 1.0;
            continue;
        };
        let (next, [lo, hi]) = (law.visit(steps[k], u[k], r[k]), law.bounds);
        error[k] = r[k] - next;
        // In the slack between two targets, and at a bound, the impulse does not follow u.
        let in_slack = next == 0.0 && law.targets[0] < law.targets[1];
        if lo < next && next < hi && !in_slack {
            by[k][k] = steps[k];
        } else {
            plus[k][k] = 1.0;
        }
    }
    Equation { error, by, plus, wanted: error.map(|x| -x) }
}

/// Returns the equations of a contact.
fn contact<const D: usize>(
    r: &[f64; D],
    u: &[f64; D],
    friction: f64,
    steps: [f64; 2],
) -> Equation<D> {
    let step = |k: usize| steps[k.min(1)];
    let y: [f64; D] = std::array::from_fn(|k| r[k] - step(k) * u[k]);
    let (mut by, mut plus) = ([[0.0; D]; D], [[0.0; D]; D]);
    if y[0] <= 0.0 {
        for k in 0..D {
            plus[k][k] = 1.0;
        }
        return Equation { error: *r, by, plus, wanted: r.map(|r| -r) };
    }
    by[0][0] = steps[0];
    let mut error: [f64; D] = std::array::from_fn(|k| step(k) * u[k]);
    let mut wanted = error.map(|x| -x);
    let radius = friction * y[0];
    let length = y[1..].iter().map(|y| y * y).sum::<f64>().sqrt();
    if length <= radius && friction > 0.0 {
        for k in 1..D {
            by[k][k] = steps[1];
        }
        return Equation { error, by, plus, wanted };
    }
    for k in 1..D {
        let direction = |k: usize| if length > 0.0 { y[k] / length } else { 0.0 };
        let d = direction(k);
        error[k] = r[k] - radius * d;
        wanted[k] = -error[k] + friction * d * steps[0] * u[0];
        plus[k][0] = -friction * d;
        plus[k][k] = 1.0;
        for l in 1..D {
            let turn = if length > 0.0 { radius / length } else { 0.0 };
            let turn = turn * (f64::from(u8::from(k == l)) - d * direction(l));
            plus[k][l] -= turn;
            by[k][l] = steps[1] * turn;
        }
    }
    Equation { error, by, plus, wanted }
}
