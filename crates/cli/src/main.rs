//! The command line of Drystone: one module per command.

mod bake;
mod failure;
#[cfg(feature = "fclib")]
mod fclib;
mod schema;
mod solve;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Contact simulation for animation: reads a scene, lets it happen, writes the motion.
#[derive(Parser)]
#[command(name = "drystone", version, after_help = CODES)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Bake(bake::Arguments),
    Schema(schema::Arguments),
    Solve(solve::Arguments),
}

const CODES: &str = "Exit codes: 0 done, 2 wrong input or usage, 3 the simulation diverged or \
                     the problem is not solved, 4 a file cannot be read or written, 130 \
                     interrupted.";

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Bake(arguments) => bake::run(&arguments),
        Command::Schema(_) => schema::run(),
        Command::Solve(arguments) => solve::run(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("drystone: {failure}");
            ExitCode::from(failure.code())
        }
    }
}
