//! `drystone solve`: reads a contact problem given as matrices and solves it.

mod plot;
mod read;
mod result;
mod run;

use std::fmt::Write as _;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::str::FromStr;

use drystone_scene::write_whole;
use drystone_solver::assembled::{Limits, Outcome, Problem, Status};
use serde_json::Value;

use crate::failure::Failure;
use crate::files::refuse_overwrite;
use crate::print;
pub(crate) use plot::escaped;
use run::{Choice, MethodRun};

/// Largest number of unknowns whose matrix is printed.
const SHOWN: usize = 6;

/// Solve contacts and joints, or a linear complementarity problem, given as matrices.
///
/// PROBLEM is JSON, and one of four kinds. A contact problem u = W r + q has `dim`, `mu`, `q` and
/// `W`; in global form, the bodies' `M`, `H`, `f` and `w`. A linear complementarity problem has `q`
/// and `M` or `M_rows`. A problem saved by `drystone bake --dump-step` has `M`, `J`, `v_star`, `t`,
/// `mu`, and optionally `eps`, the guess `gamma_0` and `joint_rows`. Sparse matrices are given by columns
/// (`rows`, `cols`, `colptr`, `rowidx`, `values`). Builds with the feature `fclib` read FCLIB's
/// .hdf5 files.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct SolveArguments {
    /// Problem to solve: .json, or .hdf5
    problem: PathBuf,

    /// Solve by this method: auto, gauss-seidel, proximal, newton, lemke, enumeration or
    /// interior-point; auto chooses by itself
    #[arg(long, value_name = "M", default_value = "auto", value_parser = Choice::from_str)]
    method: Choice,

    /// Stop at this residual, relative to the size of the problem
    #[arg(long, value_name = "X", default_value_t = 1e-9, value_parser = within(1e-16..=1.0))]
    tolerance: f64,

    /// Stop after so many iterations: sweeps, pivots or Newton steps
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=1_000_000_000))]
    budget: u32,

    /// Draw residuals over iterations and over time
    #[arg(long, value_name = "PLOT.svg")]
    history: Option<PathBuf>,

    /// Run all other methods as well, and draw their residuals
    #[arg(long)]
    compare: bool,

    /// Repeat the solution so many times, and report the median time
    #[arg(long, value_name = "N", default_value_t = 1)]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=10_000))]
    repeat: u32,

    /// Write the solution, its residuals and its method as JSON
    #[arg(short, long, value_name = "RESULT.json")]
    output: Option<PathBuf>,

    /// Print no text; warnings and errors remain
    #[arg(short, long)]
    quiet: bool,
}

const EXAMPLES: &str = "\
Examples:
  drystone solve stack.json -o result.json
      writes the impulses, with the method chosen automatically
  drystone solve capsules.json --compare --history plot.svg
      draws the residuals of all methods in one picture

Exit codes: 0 solved, 2 wrong input or usage, 3 not solved (also with a proof that there is no
solution; the result is written nevertheless), 4 a file cannot be read or written.";

fn within(range: RangeInclusive<f64>) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| match f64::from_str(text) {
        Ok(x) if range.contains(&x) => Ok(x),
        _ => Err(format!("accepted: a number from {:e} to {:e}", range.start(), range.end())),
    }
}

/// Runs the command.
pub(crate) fn run(arguments: &SolveArguments) -> Result<(), Failure> {
    for (flag, path, accepted) in
        [("--history", &arguments.history, "svg"), ("--output", &arguments.output, "json")]
    {
        if let Some(path) = path
            && !path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(accepted))
        {
            let path = path.display();
            return Err(Failure::Input(format!("{path}: {flag} writes .{accepted} files only")));
        }
        if let Some(path) = path {
            refuse_overwrite(path, [arguments.problem.as_path()])?;
        }
    }
    let named = read::read(&arguments.problem)?;
    let limits = Limits { tolerance: arguments.tolerance, budget: arguments.budget as usize };
    let run = |choice| {
        let run = MethodRun::new(&named, choice, &limits, arguments.repeat);
        if arguments.history.is_some() { run.with_history(&named, &limits) } else { run }
    };
    let mut runs = vec![run(arguments.method)];
    if arguments.compare {
        let others = Choice::all().filter(|&choice| choice != arguments.method);
        let others = others.map(run);
        // Methods that do not apply to this problem are not compared.
        runs.extend(others.filter(|run| run.solved.outcome.status != Status::BadInput));
    }
    let run = &runs[0];
    if let Some(path) = &arguments.output {
        let result = result::json(&named, run);
        write_json(path, &result)?;
    }
    if let Some(path) = &arguments.history {
        let picture = plot::svg(&named.name, &runs, limits.tolerance);
        write_whole(path, |out| out.write_all(picture.as_bytes()))
            .map_err(|error| Failure::cannot_write(path, &error))?;
    }
    if !arguments.quiet {
        print(&text(&named, &runs))?;
    }
    unless_solved(&named.name, run)
}

fn write_json(path: &std::path::Path, value: &Value) -> Result<(), Failure> {
    write_whole(path, |out| {
        serde_json::to_writer(&mut *out, value)?;
        out.write_all(b"\n")
    })
    .map_err(|error| Failure::cannot_write(path, &error))
}

/// Returns a failure if the problem is not solved; called after all outputs are written.
fn unless_solved(name: &str, run: &MethodRun) -> Result<(), Failure> {
    let Outcome { status, reason, residual, .. } = run.solved.outcome;
    match status {
        Status::Converged => Ok(()),
        Status::BadInput => {
            let method = run.choice.name();
            Err(Failure::Input(format!(
                "{name}: {method} does not apply to this problem: {reason}"
            )))
        }
        Status::Infeasible => Err(Failure::Unsolved(format!("{name}: {reason}"))),
        Status::Budget | Status::Stalled => {
            Err(Failure::Unsolved(format!("{name}: not solved, residual {residual:.1e}: {reason}")))
        }
    }
}

/// Formats W, q, the impulses and u = W r + q of a small problem.
fn numbers(problem: &Problem, r: &[f64]) -> String {
    let (n, matrix) = (problem.unknowns(), problem.matrix());
    let row = |i: usize| -> Vec<f64> {
        (0..n).map(|j| matrix.get(i, j).copied().unwrap_or(0.0)).collect()
    };
    let mut lines: Vec<(&str, Vec<f64>)> = (0..n).map(|i| ("", row(i))).collect();
    if let Some((name, _)) = lines.first_mut() {
        *name = "W";
    }
    lines.push(("q", problem.offset().to_vec()));
    lines.push((if problem.dimension() == 1 { "z" } else { "r" }, r.to_vec()));
    lines.push(("u", problem.velocities(r)));
    let mut text = String::new();
    for (name, values) in lines {
        let values = values.iter().map(|&x| format!("{:>9}", short(x, 5))).collect::<Vec<_>>();
        // Writing to a string does not fail.
        let _ = writeln!(text, "{name:12} {}", values.join(" "));
    }
    text
}

/// Formats a number with so many significant digits, without zeros at the end. Numbers that are too
/// large or too small for that have an exponent; rounding errors are 0.
pub(crate) fn short(x: f64, digits: i32) -> String {
    if x.abs() < 5e-13 {
        return "0".to_owned();
    }
    let before = x.abs().log10().floor() as i32 + 1;
    if !(-2..=5).contains(&before) {
        return format!("{x:.*e}", digits as usize - 1);
    }
    let text = format!("{x:.*}", (digits - before).max(0) as usize);
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

fn text(named: &read::Named, runs: &[MethodRun]) -> String {
    let (problem, run) = (&named.problem, &runs[0]);
    let mut text = String::new();
    let contacts = match problem.contacts() {
        1 => "1 contact".to_owned(),
        many => format!("{many} contacts"),
    };
    let kind = match problem.dimension() {
        1 => "without friction".to_owned(),
        dimension => format!("with friction in {dimension}D"),
    };
    let Outcome { status, reason, residual, iterations, .. } = &run.solved.outcome;
    let joints = match problem.rows().len() {
        0 => String::new(),
        1 => " and 1 row of a joint".to_owned(),
        many => format!(" and {many} rows of joints"),
    };
    // Writing to a string does not fail.
    let (name, unknowns) = (&named.name, problem.unknowns());
    let _ = writeln!(text, "{name}: {contacts} {kind}{joints}, {unknowns} unknowns");
    let _ = writeln!(text, "method       {}", run.solved.method.name());
    let _ = writeln!(text, "status       {} ({reason})", status.name());
    let _ = writeln!(text, "residual     {residual:.2e}, relative");
    let _ = writeln!(text, "certificate  {}", result::in_words(named, run));
    let _ = writeln!(text, "iterations   {iterations}");
    let _ = writeln!(text, "time         {:.2} ms", run.milliseconds());
    if problem.unknowns() <= SHOWN {
        text += &numbers(problem, &run.solved.outcome.impulses);
    }
    if let Some(stress) = &run.solved.outcome.certificate {
        let jammed = stress.weights.iter().filter(|&&y| y > 0.0).count();
        let _ =
            writeln!(text, "jammed       {jammed} of the contacts, which no impulses can satisfy");
        if stress.least_sum.is_finite() {
            let sum = stress.least_sum;
            let _ = writeln!(text, "             unless they sum to {sum:.1e} or more");
        }
    }
    if runs.len() > 1 {
        let _ = writeln!(text, "\nmethod          status      residual  iterations          ms");
        for run in runs {
            let Outcome { status, residual, iterations, .. } = run.solved.outcome;
            let (name, status, ms) = (run.choice.name(), status.name(), run.milliseconds());
            let _ = writeln!(
                text,
                "{name:14}  {status:10} {residual:9.1e}  {iterations:10}  {ms:10.2}"
            );
        }
    }
    text
}
