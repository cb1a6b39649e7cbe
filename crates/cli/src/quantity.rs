//! Parsers of arguments with units.

use std::ops::RangeInclusive;
use std::str::FromStr;

/// Returns a parser of finite numbers within a range.
pub(crate) fn real(range: RangeInclusive<f64>) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| match f64::from_str(text) {
        Ok(x) if range.contains(&x) => Ok(x),
        _ => Err(format!("accepted: a number from {} to {}", range.start(), range.end())),
    }
}

/// Parses a length in mm or m; a number without a unit is in m. \[m\]
pub(crate) fn length(text: &str) -> Option<f64> {
    let text = text.trim();
    let (number, unit) = match (text.strip_suffix("mm"), text.strip_suffix('m')) {
        (Some(number), _) => (number, 1e-3),
        (None, Some(number)) => (number, 1.0),
        (None, None) => (text, 1.0),
    };
    f64::from_str(number.trim_end()).ok().map(|number| number * unit)
}

/// Parses a speed; a number without a unit is in m/s. \[m/s\]
pub(crate) fn speed(text: &str) -> Result<f32, String> {
    let text = text.trim();
    let speed = match text.strip_suffix("/s").map(str::trim_end) {
        None => f64::from_str(text).ok(),
        Some(per) => length(per).filter(|_| per.ends_with('m')),
    };
    let accepted = "accepted: a speed from 0 to 1000 m/s, such as 1mm/s or 0.001m/s";
    let speed = speed.filter(|x| (0.0..=1e3).contains(x)).ok_or_else(|| accepted.to_owned())?;
    Ok(speed as f32)
}
