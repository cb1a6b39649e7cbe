//! Command line of Drystone: one module per command.

mod bake;
mod check;
mod convert;
mod decompose;
mod extension;
mod failure;
#[cfg(feature = "fclib")]
mod fclib;
mod files;
mod frames;
mod matrix;
mod quantity;
mod schema;
mod solve;
mod verify;

use std::io::{self, Write as _};
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use failure::Failure;

/// Simulate rigid bodies in contact: read a scene, bake its motion, check and verify it.
#[derive(Parser)]
#[command(name = "drystone", version, after_help = CODES)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Bake(bake::BakeArguments),
    Check(check::CheckArguments),
    Convert(convert::ConvertArguments),
    Decompose(decompose::DecomposeArguments),
    Matrix(matrix::MatrixArguments),
    Schema(schema::SchemaArguments),
    Solve(solve::SolveArguments),
    Verify(verify::VerifyArguments),
}

const CODES: &str = "\
Exit codes: 0 done, 1 done and the answer is no (bakes differ, a check found something), 2 wrong
input or usage, 3 the simulation diverged or the problem is not solved, 4 a file cannot be read or
written, 130 interrupted.";

fn main() -> ExitCode {
    let result = match CommandLine::parse().command {
        Command::Bake(arguments) => bake::run(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Check(arguments) => check::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Decompose(arguments) => decompose::run(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Matrix(arguments) => matrix::run(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Schema(_) => schema::run().map(|()| ExitCode::SUCCESS),
        Command::Solve(arguments) => solve::run(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Verify(arguments) => verify::run(&arguments),
    };
    match result {
        Ok(code) => code,
        Err(failure) => {
            eprintln!("drystone: {failure}");
            ExitCode::from(failure.code())
        }
    }
}

/// Prints to standard output.
fn print(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        // A closed pipe is no failure: its reader has read enough.
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(Failure::File(format!("standard output: cannot be written: {error}")))
        }
        _ => Ok(()),
    }
}
