//! Result of a solve as JSON, for other programs.

use drystone_solver::assembled::ladder::Attempt;
use drystone_solver::assembled::{Problem, Sample};
use serde_json::{Value, json};

use super::read::Named;
use super::run::MethodRun;

/// Returns the solution, its certificate and the history of the solve. Infinite numbers become
/// null.
pub(super) fn json(named: &Named, run: &MethodRun) -> Value {
    let problem = &named.problem;
    let outcome = &run.solved.outcome;
    let impulses = if problem.dimension() == 1 { "z" } else { "r" };
    let attempt = |attempt: &Attempt| {
        json!({
            "method": attempt.method.name(),
            "status": attempt.status.name(),
            "iterations": attempt.iterations,
            "residual": attempt.residual,
        })
    };
    let samples = |of: fn(&Sample) -> Value| outcome.history.iter().map(of).collect::<Value>();
    let mut result = json!({
        "name": named.name,
        "version": env!("CARGO_PKG_VERSION"),
        "units": {
            "approach": "m/s", "complementarity": "J", "cone_violation": "N s",
            "fastest_approach": "m/s", "gap": "J", "least_sum": "N s", "natural_map": "1",
            "residual": "1", "row_miss": "m/s, rad/s", "scaled_natural_map": "1",
            "time_ms": "ms", "u": "m/s", "weights": "1", impulses: "N s",
        },
        "status": outcome.status.name(),
        "reason": outcome.reason,
        "method": run.solved.method.name(),
        "u": problem.velocities(&outcome.impulses),
        "residual": outcome.residual,
        "certificate": certificate(named, run),
        "iterations": outcome.iterations,
        "time_ms": run.milliseconds(),
        "history": {
            "iteration": samples(|sample| json!(sample.iteration)),
            "time_ms": samples(|sample| json!(sample.elapsed.as_secs_f64() * 1e3)),
            "residual": samples(|sample| json!(sample.residual)),
        },
        "attempts": run.solved.attempts.iter().map(attempt).collect::<Vec<_>>(),
    });
    result[impulses] = json!(outcome.impulses);
    result
}

/// Formats the certificate in a line.
pub(super) fn in_words(named: &Named, run: &MethodRun) -> String {
    let certificate = certificate(named, run);
    let number = |key: &str| certificate[key].as_f64().unwrap_or(f64::INFINITY);
    let gap = match certificate["gap"].as_f64() {
        Some(gap) => format!("gap {gap:.1e} J, "),
        None => String::new(),
    };
    let rows = match certificate["row_miss"].as_f64() {
        Some(miss) => format!(", rows of joints miss {miss:.1e} m/s"),
        None => String::new(),
    };
    format!(
        "{gap}natural map {:.1e} (scaled {:.1e}), approach {:.1e} m/s, outside the cones {:.1e} N \
         s{rows}",
        number("natural_map"),
        number("scaled_natural_map"),
        number("fastest_approach"),
        number("cone_violation"),
    )
}

/// Returns the certificate, which anyone can check: how far the impulses violate the contact laws,
/// or why no solution exists.
fn certificate(named: &Named, run: &MethodRun) -> Value {
    let problem = &named.problem;
    let outcome = &run.solved.outcome;
    let (r, d) = (&outcome.impulses, problem.dimension());
    let u = problem.velocities(r);
    let length = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
    let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
    let pairs = || r.chunks_exact(d).zip(u.chunks_exact(d)).zip(problem.friction());
    let outside = |((r, _), mu): ((&[f64], &[f64]), &f64)| length(&r[1..]) - mu * r[0];
    let work = |((r, u), mu): ((&[f64], &[f64]), &f64)| {
        let dot: f64 = r.iter().zip(u).map(|(r, u)| r * u).sum();
        (dot + mu * length(&u[1..]) * r[0]).abs()
    };
    let mut certificate = json!({
        "natural_map": problem.natural_map(r),
        "scaled_natural_map": problem.scaled_natural_map(r),
        "fastest_approach": most(&mut pairs().map(|((_, u), _)| -u[0])),
        "cone_violation": most(&mut pairs().map(outside)),
        "complementarity": most(&mut pairs().map(work)),
    });
    if !problem.rows().is_empty() {
        certificate["row_miss"] = json!(row_miss(problem, r, &u));
    }
    if let Some(assembly) = &named.assembly {
        // Without compliance the gap is infinite as soon as rounding misses a target.
        let gap = assembly.gap(r);
        certificate["gap"] = json!(gap.is_finite().then_some(gap));
    }
    if let Some(stress) = &outcome.certificate {
        certificate["self_stress"] = json!({
            "weights": stress.weights,
            "approach": stress.approach,
            "least_sum": stress.least_sum,
        });
    }
    certificate
}

/// Returns the largest velocity by which a row of a joint misses its law. \[m/s, rad/s\]
fn row_miss(problem: &Problem, r: &[f64], u: &[f64]) -> f64 {
    let (contacts, r) = problem.split_rows(r);
    let (first, (_, u)) = (contacts.len(), problem.split_rows(u));
    let rows = r.iter().zip(u).zip(problem.rows()).enumerate();
    let misses = rows.map(|(i, ((&r, &u), law))| {
        let w = problem.matrix().get(first + i, first + i).copied().unwrap_or(0.0);
        if w > 0.0 { (law.visit(1.0 / w, u, r) - r).abs() * w } else { 0.0 }
    });
    misses.fold(0.0, f64::max)
}
