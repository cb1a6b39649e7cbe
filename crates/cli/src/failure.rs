//! Failures of commands, with their exit codes.

use std::fmt;
use std::io;
use std::path::Path;

use drystone::InputError;
use drystone_scene::SceneError;

/// A failure, described in one line.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The input or the usage is wrong.
    Input(String),
    /// The simulation diverged.
    Diverged(String),
    /// A contact problem is not solved.
    Unsolved(String),
    /// A file cannot be read or written.
    File(String),
    /// The user interrupted the command.
    Interrupted(String),
}

impl Failure {
    /// Returns the exit code of the process.
    pub(crate) fn code(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Diverged(_) | Self::Unsolved(_) => 3,
            Self::File(_) => 4,
            Self::Interrupted(_) => 130,
        }
    }

    /// Returns the failure for a file that the system cannot read.
    pub(crate) fn cannot_read(path: &Path, error: &io::Error) -> Self {
        Self::File(format!("{}: cannot be read: {error}", path.display()))
    }

    /// Returns the failure for a file that the system cannot write.
    pub(crate) fn cannot_write(path: &Path, error: &io::Error) -> Self {
        Self::File(format!("{}: cannot be written: {error}", path.display()))
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input(text)
            | Self::Diverged(text)
            | Self::Unsolved(text)
            | Self::File(text)
            | Self::Interrupted(text) => f.write_str(text),
        }
    }
}

impl From<InputError> for Failure {
    fn from(error: InputError) -> Self {
        Self::Input(error.to_string())
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        if error.unreadable {
            Self::File(error.to_string())
        } else {
            Self::Input(error.to_string())
        }
    }
}
