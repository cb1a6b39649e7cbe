//! `drystone schema`: prints the JSON Schema of scene files.

use crate::failure::Failure;
use crate::print;

/// Print the JSON Schema of scene files, for editors and other programs.
#[derive(clap::Args)]
pub(crate) struct SchemaArguments {}

/// Runs the command.
pub(crate) fn run() -> Result<(), Failure> {
    print(&format!("{:#}\n", drystone_scene::json_schema()))
}
