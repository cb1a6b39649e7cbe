//! `drystone schema`.

use std::io::{self, Write as _};

use drystone::scene;

use crate::failure::Failure;

/// Print the JSON Schema of scene files, for editors and other programs.
#[derive(clap::Args)]
pub(crate) struct Arguments {}

/// Prints the schema.
pub(crate) fn run() -> Result<(), Failure> {
    match writeln!(io::stdout(), "{:#}", scene::json_schema()) {
        // Whoever reads it has read enough.
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(Failure::File(format!("standard output: cannot be written: {error}")))
        }
        _ => Ok(()),
    }
}
