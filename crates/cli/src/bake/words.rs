//! Words of a summary.

/// Formats a number of things, of which `one` names one.
pub(super) fn counted(count: usize, one: &str) -> String {
    if count == 1 { format!("1 {one}") } else { format!("{count} {one}s") }
}
