//! Warnings of properties and extensions that the reader does not know.

use std::collections::BTreeMap;

use super::super::error::Warning;
use super::json::Cursor;

/// Warns of unknown properties and extensions of an object.
pub(super) fn warn_unknown(cursor: &Cursor<'_>, known: &[&str], warnings: &mut Vec<Warning>) {
    for key in cursor.unknown(known) {
        warnings.push(Warning {
            place: cursor.place(),
            message: format!("'{key}' is not a property of {}{IGNORED}", kind_of(cursor)),
        });
    }
    // Extensions inside an extension.
    if let Some(inner) = cursor.value.get("extensions").and_then(|inner| inner.as_object()) {
        for name in inner.keys() {
            let message = format!("the extension {name} of {}{IGNORED}", kind_of(cursor));
            warnings.push(Warning { place: cursor.place(), message });
        }
    }
}

/// End of every warning about an unknown property or extension.
pub(super) const IGNORED: &str = " here: it is ignored";

/// Returns the name of an object without its index in a list.
fn kind_of(cursor: &Cursor<'_>) -> String {
    let name = cursor.name();
    name.split_once('[').map_or(name.clone(), |(list, _)| list.to_owned())
}

/// Keeps each warning about an unknown property once, and appends its number of occurrences.
pub(super) fn count_unknown(warnings: &mut Vec<Warning>) {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    warnings.retain(|warning| {
        if !warning.message.ends_with(IGNORED) {
            return true;
        }
        let count = counts.entry(warning.message.clone()).or_insert(0);
        *count = count.saturating_add(1);
        *count == 1
    });
    for warning in warnings {
        if let Some(count) = counts.get(&warning.message).filter(|count| **count > 1) {
            warning.message.push_str(&format!(" ({count} times)"));
        }
    }
}
