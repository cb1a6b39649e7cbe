//! Block Gauss-Seidel: solves one contact, or row of a joint, at a time exactly, the others fixed.
//!
//! With one row per contact this is projected Gauss-Seidel (Cryer 1971), with friction the
//! nonsmooth Gauss-Seidel of Jean and Moreau (Moreau 1994, Jean 1999). A sweep costs one product
//! with W and a local solve per contact. Without friction it converges for symmetric positive
//! definite W, more slowly with longer chains and larger mass ratios. For other matrices it may
//! cycle, which is detected. It has the cheapest iterations, so it is tried first, and it provides
//! new starts for other methods.

use super::blocks::{Blocks, joined, laws, split};
use super::outcome::{Limits, Outcome, Progress, Status};
use super::problem::{largest, norm};
use super::{Problem, jam, local};

/// Sweeps between evaluations of the residual, which cost as much as a sweep. Before the first of
/// these, the sweeps numbered by powers of two are evaluated.
const LOOK: usize = 10;
/// Sweeps without a 1 % reduction of the best residual after which the method counts as stalled.
const PATIENCE: usize = 1000;

/// Sweeps until the residual is within the tolerance. Starts from `warm`, or from zero if `None`.
///
/// Needs W_nn > 0 at each contact and row; otherwise the status is `BadInput`. `Stalled` means that the
/// iterates diverge, repeat or do not improve.
pub fn solve(problem: &Problem, warm: Option<&[f64]>, limits: &Limits) -> Outcome {
    match problem.dimension() {
        1 => sweeps::<1>(problem, warm, limits),
        2 => sweeps::<2>(problem, warm, limits),
        _ => sweeps::<3>(problem, warm, limits),
    }
}

/// State of sweeps for the problem with W + alpha and q - alpha c.
pub(super) struct Sweeper<'a, const D: usize> {
    blocks: &'a Blocks<D>,
    offset: &'a [[f64; D]],
    problem: &'a Problem,
    lambda: Vec<f64>,
}

impl<'a, const D: usize> Sweeper<'a, D> {
    /// Creates the state; `None` if a contact or a row has no positive W_nn.
    pub(super) fn new(
        blocks: &'a Blocks<D>,
        offset: &'a [[f64; D]],
        problem: &'a Problem,
    ) -> Option<Self> {
        let usable = (0..blocks.len()).all(|i| {
            let own = laws::<D>(problem, i).map_or(1, <[_]>::len);
            (0..own).all(|k| blocks.diagonal(i)[k][k] > 0.0)
        });
        usable.then(|| Self { blocks, offset, problem, lambda: vec![0.0; blocks.len()] })
    }

    /// Solves every contact and row once, in order. Returns the norm of all changes of r, each multiplied
    /// by its W_ii: the current rate of change of the velocities. \[m/s\]
    pub(super) fn sweep(&mut self, r: &mut [[f64; D]], shift: f64, center: &[[f64; D]]) -> f64 {
        let mut changed = 0.0;
        for i in 0..self.blocks.len() {
            let mut a = *self.blocks.diagonal(i);
            let mut b = self.blocks.product(i, r);
            for k in 0..D {
                b[k] += self.offset[i][k];
                for l in 0..D {
                    b[k] -= a[k][l] * r[i][l];
                }
            }
            if shift > 0.0 {
                for k in 0..D {
                    a[k][k] += shift;
                    b[k] -= shift * center[i][k];
                }
            }
            let new = match laws::<D>(self.problem, i) {
                Some(laws) => local::visit_rows(&a, &b, laws, r[i]),
                None => local::solve(&a, &b, self.problem.friction()[i], &mut self.lambda[i]),
            };
            for k in 0..D {
                changed += (a[k][k] * (new[k] - r[i][k])).powi(2);
            }
            r[i] = new;
        }
        changed.sqrt()
    }
}

fn sweeps<const D: usize>(problem: &Problem, warm: Option<&[f64]>, limits: &Limits) -> Outcome {
    let blocks = Blocks::<D>::new(problem.matrix());
    let offset = split::<D>(problem.offset());
    let (mut progress, start) = Progress::new(problem, warm, limits);
    if progress.converged() {
        return progress.end(Status::Converged, "the start is a solution");
    }
    let Some(mut sweeper) = Sweeper::new(&blocks, &offset, problem) else {
        return progress.end(Status::BadInput, "a diagonal entry of W is not positive");
    };
    let mut r = split::<D>(&start);
    let size = norm(problem.offset());
    // Brent's cycle detection compares the iterates with an earlier one.
    let (mut anchor, mut since, mut period) = (r.clone(), 0, 1);
    let (mut mark, mut marked_at) = (f64::INFINITY, 0);
    while !progress.spent() {
        let changed = sweeper.sweep(&mut r, 0.0, &[]);
        progress.iterations += 1;
        let near = changed <= progress.limits.tolerance * size;
        let done = progress.iterations;
        let early = done < LOOK && done.is_power_of_two();
        if near || early || done.is_multiple_of(LOOK) {
            progress.record(joined(&r, problem));
            if progress.converged() {
                return progress.end(Status::Converged, "within the tolerance");
            }
        }
        if !changed.is_finite() || largest(r.as_flattened()) > f64::MAX.sqrt() {
            return progress.end(Status::Stalled, "the impulses grow without bound");
        }
        since += 1;
        if r == anchor {
            progress.record(joined(&r, problem));
            return progress.end(Status::Stalled, "the sweeps go round in a circle");
        }
        if since == period {
            if let Some(stress) = growth(problem, &anchor, &r) {
                return progress.infeasible(stress);
            }
            anchor.copy_from_slice(&r);
            (since, period) = (0, 2 * period);
        }
        if progress.residual() < 0.99 * mark {
            (mark, marked_at) = (progress.residual(), progress.iterations);
        } else if progress.iterations - marked_at >= PATIENCE {
            return progress.end(Status::Stalled, "the residual does not fall any more");
        }
    }
    progress.out_of_budget()
}

/// Returns a proof if the growth of the impulses is one: in a jam they grow along its self-stress.
fn growth<const D: usize>(
    problem: &Problem,
    before: &[[f64; D]],
    now: &[[f64; D]],
) -> Option<jam::SelfStress> {
    if D > 1 || !problem.rows().is_empty() {
        return None;
    }
    let change = now.iter().zip(before).map(|(r, b)| r[0] - b[0]).collect();
    jam::proof(problem, change)
}
