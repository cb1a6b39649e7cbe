//! Every set of contacts that might push, one after the other: 2^n systems of equations.
//!
//! The definition as a method (Cottle, Pang and Stone 1992, chapter 1); costs up to 2^n n^3 / 3. It
//! finds a solution whenever one has a nonsingular basis, whatever the matrix, and is what the others
//! are held against. For small n only.

use super::Problem;
use super::lemke::solve_pushing;
use super::outcome::{Limits, Outcome, Progress, Status};

/// The most contacts.
pub const MOST: usize = 16;

/// Tries the sets in the order of binary numbers and ends at the first that solves. An iteration is
/// one set. `Stalled`: no set solves, so that solutions, if any, have singular bases. More than
/// [`MOST`] contacts, or friction, are `BadInput`.
pub fn solve(problem: &Problem, warm: Option<&[f64]>, limits: &Limits) -> Outcome {
    let (mut progress, _) = Progress::new(problem, warm, limits);
    let n = problem.unknowns();
    if problem.dimension() != 1 {
        return progress.end(Status::BadInput, "enumeration knows no friction");
    }
    if n > MOST {
        return progress.end(Status::BadInput, "too many contacts to enumerate");
    }
    if progress.converged() {
        return progress.end(Status::Converged, "the start is a solution");
    }
    for set in 0..1u32 << n {
        if progress.spent() {
            return progress.out_of_budget();
        }
        progress.iterations += 1;
        let pushing = (0..n).filter(|i| set >> i & 1 == 1).collect();
        let Some(z) = solve_pushing(problem, pushing) else {
            continue;
        };
        // Only what is better is worth a place in the history.
        if problem.residual(&z) < progress.residual() {
            progress.record(&z);
        }
        if progress.converged() {
            return progress.end(Status::Converged, "within the tolerance");
        }
    }
    progress.end(Status::Stalled, "no complementary basis solves the problem")
}

/// All solutions with a nonsingular basis, in the order of binary numbers, each once. For tests and
/// for teaching; none if there are more than [`MOST`] contacts or friction.
pub fn all(problem: &Problem, tolerance: f64) -> Vec<Vec<f64>> {
    let n = problem.unknowns();
    if problem.dimension() != 1 || n > MOST {
        return Vec::new();
    }
    let sets = (0..1u32 << n).map(|set| (0..n).filter(|i| set >> i & 1 == 1).collect());
    let mut found: Vec<Vec<f64>> = Vec::new();
    for z in sets.filter_map(|pushing| solve_pushing(problem, pushing)) {
        let size = z.iter().fold(0.0, |largest: f64, &z| largest.max(z));
        let same = |y: &Vec<f64>| y.iter().zip(&z).all(|(y, z)| (y - z).abs() <= 1e-9 * size);
        if problem.residual(&z) <= tolerance && !found.iter().any(same) {
            found.push(z);
        }
    }
    found
}
