//! Paths: comparison of files, and protection of inputs from being overwritten.

use std::fs;
use std::path::{Path, PathBuf};

use crate::failure::Failure;

/// Returns a canonical path, which is equal for all paths to the same file.
pub(crate) fn place(path: &Path) -> PathBuf {
    fs::canonicalize(path).unwrap_or_else(|_| {
        let folder = fs::canonicalize(folder(path)).unwrap_or_else(|_| folder(path).to_owned());
        folder.join(path.file_name().unwrap_or_default())
    })
}

/// Returns the folder of a path.
pub(crate) fn folder(path: &Path) -> &Path {
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty());
    parent.unwrap_or(Path::new("."))
}

/// Refuses an output that is one of the inputs. Overwriting it would lose what the other format
/// leaves out, such as comments.
pub(crate) fn refuse_overwrite<'a>(
    output: &Path,
    inputs: impl IntoIterator<Item = &'a Path>,
) -> Result<(), Failure> {
    match inputs.into_iter().find(|input| place(input) == place(output)) {
        None => Ok(()),
        Some(input) => {
            let (output, input) = (output.display(), input.display());
            Err(Failure::Input(format!(
                "{output}: the output is the input {input} itself; give it another name"
            )))
        }
    }
}
