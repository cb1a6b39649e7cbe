//! Proximal points, each found by a semismooth Newton method: exact Coulomb friction.
//!
//! W is singular wherever there are more contacts than velocities, which defeats Newton's method.
//! The proximal point method solves instead, again and again, the problem of W + alpha with q -
//! alpha c around the last answer c (Rockafellar 1976; for friction Acary, Bremond and Huber 2018),
//! with alpha going down as long as that succeeds; at its fixed point the shift has no effect. Each
//! of these problems is solved by Newton's method on the equations of Alart and Curnier (1991), with
//! y = r - rho u,
//!
//! r_n = max(0, y_n), r_t = y_t brought back to the disc of radius mu max(0, y_n),
//!
//! one of three linear laws for each contact: open, sticking, sliding. A line search over |F|^2
//! guards the steps, and sweeps of Gauss-Seidel on the shifted problem provide a new start where it
//! fails. An iteration is a Newton step: one sparse factorization with one block per coupled pair of
//! contacts. Convergence is fast and final near a solution, for singular and for unsymmetric W; there
//! is no proof of it from afar with friction, since not even the existence of a solution is certain.
//! With one row per contact this is the primal-dual active set method for complementarity problems.

use super::Problem;
use super::block_gauss_seidel::Sweeper;
use super::block_lu::BlockLu;
use super::blocks::{Block, Blocks, split};
use super::outcome::{Limits, Outcome, Progress, Status};

/// alpha over the mean diagonal of W: first, least, most.
const SHIFT: (f64, f64, f64) = (1e-4, 1e-11, 1e2);
/// Newton steps for one proximal point.
const STEPS: usize = 30;
/// Steps that must halve |F|^2 at least, or the point is given up.
const SPAN: usize = 8;
/// Steps whose highest |F|^2 is to be undercut.
const RECENT: usize = 4;
/// Halvings in a line search.
const HALVINGS: usize = 14;
/// Sweeps for a new start.
const SWEEPS: usize = 60;
/// Points in a row without progress after which no more is to be expected.
const PATIENCE: usize = 20;

/// Newton steps from `warm`, or from a few sweeps if that is `None`. `Stalled` says that points were
/// found that do not come nearer, or none.
pub fn solve(problem: &Problem, warm: Option<&[f64]>, limits: &Limits) -> Outcome {
    match problem.dimension() {
        1 => points::<1>(problem, warm, limits),
        2 => points::<2>(problem, warm, limits),
        _ => points::<3>(problem, warm, limits),
    }
}

fn points<const D: usize>(problem: &Problem, warm: Option<&[f64]>, limits: &Limits) -> Outcome {
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
    let friction = problem.friction();
    let mut sweeper = Sweeper::new(&blocks, &offset, friction);
    let mut newton =
        Newton { blocks: &blocks, offset: &offset, friction, lu: BlockLu::new(&blocks) };
    let mut r = split::<D>(&start);
    if let (None, Some(sweeper)) = (warm, &mut sweeper) {
        (0..SWEEPS).for_each(|_| _ = sweeper.sweep(&mut r, 0.0, &[]));
        progress.record(r.as_flattened());
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
            // Sweeps alone may bring it near enough; else with more shift, from the last point.
            again = !again;
            if again {
                shift.missed();
                r.clone_from(&center);
            }
            if let Some(sweeper) = &mut sweeper {
                (0..SWEEPS).for_each(|_| _ = sweeper.sweep(&mut r, shift.alpha * scale, &center));
                progress.record(r.as_flattened());
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

/// alpha over the mean diagonal of W: as small as Newton's method can take.
struct Shift {
    alpha: f64,
    least: f64,
}

impl Shift {
    /// Less, but not at once again what has failed.
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
    friction: &'a [f64],
    lu: BlockLu<D>,
}

/// The equations of Alart and Curnier at some r.
struct Equations<const D: usize> {
    /// C_i and E_i: the derivative is C_i (W + alpha)_i + E_i.
    rows: Vec<(Block<D>, Block<D>)>,
    /// What the step has to make of it.
    rhs: Vec<[f64; D]>,
    /// Sum of |F|^2 W_nn: an energy. \[J\]
    merit: f64,
}

impl<const D: usize> Newton<'_, D> {
    /// From r to the proximal point of c; whether it was found.
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
            // W (r + t d) = W r + t W d: a trial costs no product.
            let way = self.image(&direction);
            // Not always downhill: the highest of the last few is to be undercut.
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
            progress.record(r.as_flattened());
            if progress.converged() {
                return true;
            }
            // Near enough to the point, compared to the way from the center.
            let way: f64 = r
                .as_flattened()
                .iter()
                .zip(center.as_flattened())
                .map(|(r, c)| (alpha * (r - c)).powi(2))
                .sum::<f64>()
                / self.blocks.mean_diagonal().max(f64::MIN_POSITIVE);
            if equations.merit <= 1e-4 * way {
                return true;
            }
            let before = merits.len().checked_sub(1 + SPAN).map(|at| merits[at]);
            if before.is_some_and(|before| equations.merit > 0.5 * before) {
                return false;
            }
        }
        false
    }

    /// W r.
    fn image(&self, r: &[[f64; D]]) -> Vec<[f64; D]> {
        (0..r.len()).map(|i| self.blocks.product(i, r)).collect()
    }

    /// At r, with W r in `image`.
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
            let tangential: f64 =
                (1..D).map(|k| diagonal[k][k]).sum::<f64>() / (D - 1).max(1) as f64;
            let steps = [diagonal[0][0], tangential].map(|w| 1.0 / (w.max(0.0) + alpha));
            let (error, by, plus, wanted) = contact(&r[i], &u, self.friction[i], steps);
            let square: f64 = error.iter().map(|x| x * x).sum();
            merit += square / steps[0];
            rows.push((by, plus));
            rhs.push(wanted);
        }
        Equations { rows, rhs, merit }
    }

    /// The solution of the linear equations, refined once.
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
        // What open contacts do is known: their impulses end.
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

/// F of one contact, C and E of its derivative, and the right side of Newton's equations.
fn contact<const D: usize>(
    r: &[f64; D],
    u: &[f64; D],
    friction: f64,
    steps: [f64; 2],
) -> ([f64; D], Block<D>, Block<D>, [f64; D]) {
    let step = |k: usize| steps[k.min(1)];
    let y: [f64; D] = std::array::from_fn(|k| r[k] - step(k) * u[k]);
    let (mut by, mut plus) = ([[0.0; D]; D], [[0.0; D]; D]);
    if y[0] <= 0.0 {
        for k in 0..D {
            plus[k][k] = 1.0;
        }
        return (*r, by, plus, r.map(|r| -r));
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
        return (error, by, plus, wanted);
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
    (error, by, plus, wanted)
}
