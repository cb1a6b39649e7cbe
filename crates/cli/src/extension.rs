//! File formats by extension.

use std::path::Path;

use crate::failure::Failure;

/// Returns the extension in lower case; empty if there is none.
pub(crate) fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// Returns the failure for a path given for `flag` with an extension that is not accepted.
pub(crate) fn wrong_extension(flag: &str, path: &Path, accepted: &str) -> Failure {
    let value = match extension(path).as_str() {
        "" => "not named".to_owned(),
        other => format!("\".{other}\""),
    };
    let path = path.display();
    Failure::Input(format!("{path}: the format of {flag} is {value}; accepted: {accepted}"))
}
