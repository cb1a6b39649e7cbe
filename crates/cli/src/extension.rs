//! What a file is, by its extension.

use std::path::Path;

use crate::failure::Failure;

/// In lower case; empty where there is none.
pub(crate) fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// The refusal of a path that is given for `flag`.
pub(crate) fn wrong_extension(flag: &str, path: &Path, accepted: &str) -> Failure {
    let value = match extension(path).as_str() {
        "" => "not named".to_owned(),
        other => format!("\".{other}\""),
    };
    let path = path.display();
    Failure::Input(format!("{path}: the format of {flag} is {value}; accepted: {accepted}"))
}
