//! Errors and warnings about input files. A message states file, position, item, value, accepted
//! range and help.

use std::fmt;
use std::path::PathBuf;

/// Position in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// The file as a whole.
    File,
    /// Line and column, from 1.
    Line {
        /// Line, from 1.
        line: usize,
        /// Column, from 1, in characters.
        column: usize,
    },
    /// JSON pointer (RFC 6901).
    Pointer(String),
    /// Offset from the start of the file. \[byte\]
    Byte(u64),
}

/// Reason why an input is refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneError {
    /// The file.
    pub file: PathBuf,
    /// Position in the file.
    pub place: Place,
    /// The faulty item: `radius of shape 0 of body 'ball'`.
    pub item: String,
    /// The offending value as written; empty if there is none.
    pub value: String,
    /// Accepted values, or advice.
    pub accepted: String,
    /// True if the file could not be read at all (exit code 4), false if its contents are wrong
    /// (2).
    pub unreadable: bool,
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        match &self.place {
            Place::File => {}
            Place::Line { line, column } => write!(f, ":{line}:{column}")?,
            Place::Pointer(pointer) => write!(f, " at {pointer}")?,
            Place::Byte(offset) => write!(f, " at byte {offset}")?,
        }
        write!(f, ": {}", self.item)?;
        if !self.value.is_empty() {
            write!(f, " is {}", self.value)?;
        }
        write!(f, "; {}", self.accepted)
    }
}

impl std::error::Error for SceneError {}

/// Input that was understood but has no effect, or another effect than one may expect.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Warning {
    /// Position in the file.
    pub place: Place,
    /// The input concerned, and what happens instead.
    pub message: String,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.place {
            Place::File => {}
            Place::Line { line, column } => write!(f, "{line}:{column}: ")?,
            Place::Pointer(pointer) => write!(f, "{pointer}: ")?,
            Place::Byte(offset) => write!(f, "byte {offset}: ")?,
        }
        write!(f, "{}", self.message)
    }
}
