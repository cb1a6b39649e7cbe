//! Enumeration of all sets of contacts that might push: 2^n systems of equations.
//!
//! The definition as a method (Cottle, Pang and Stone 1992, chapter 1). Costs up to 2^n n^3 / 3. It
//! finds a solution whenever one has a nonsingular basis, whatever the matrix, and is the reference
//! for the other methods. For small n only.

use super::Problem;
use super::lemke::solve_pushing;
use super::outcome::{Limits, Outcome, Progress, Status};

/// Largest number of contacts.
pub const MOST: usize = 16;

/// Tries the sets in the order of binary numbers, and ends at the first that solves the problem. An
/// iteration is one set. `Stalled` means that no set solves it, so any solutions have singular
/// bases. Problems with friction or more than [`MOST`] contacts are `BadInput`.
pub fn solve(problem: &Problem, warm: Option<&[f64]>, limits: &Limits) -> Outcome {
    let (mut progress, _) = Progress::new(problem, warm, limits);
    let n = problem.unknowns();
    if problem.dimension() != 1 {
        return progress.end(Status::BadInput, "enumeration knows no friction");
    }
    if !problem.rows().is_empty() {
        return progress.end(Status::BadInput, "enumeration knows no rows of joints");
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
        // The history holds improvements only.
        if problem.residual(&z) < progress.residual() {
            progress.record(&z);
        }
        if progress.converged() {
            return progress.end(Status::Converged, "within the tolerance");
        }
    }
    progress.end(Status::Stalled, "no complementary basis solves the problem")
}

/// Returns all solutions with a nonsingular basis, each once, in the order of binary numbers. For
/// tests and teaching. Returns none for problems with friction or more than [`MOST`] contacts.
pub fn all(problem: &Problem, tolerance: f64) -> Vec<Vec<f64>> {
    let n = problem.unknowns();
    if problem.dimension() != 1 || !problem.rows().is_empty() || n > MOST {
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
