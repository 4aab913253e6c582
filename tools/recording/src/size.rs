//! Estimate of a recording's maximum size before the run.

use shared_types::record::{RecordLayout, Timing};

use super::excerpt::Choice;

/// Size of a message apart from its words, in bytes: its head, its encapsulation and its index entry.
const BESIDES: u64 = 31 + 4 + 16;

/// Computes the maximum size of a run of `steps` steps without compression, in bytes. The rows around faults are not
/// included, because their number is unknown.
///
/// # Errors
/// If a pattern matches no signal of this run.
pub fn largest(layout: &RecordLayout, steps: u64, choice: &Choice) -> Result<u64, String> {
    let included = choice.selected(layout)?;
    let signals = included.iter().filter(|included| **included).count();
    let words = layout.values_start() + signals + Timing::WORDS;
    let records = match (choice.every, choice.around_s) {
        (Some(every), _) => steps / every + 2,
        (None, Some(_)) => 2,
        (None, None) => steps + 1,
    };
    Ok(records * (8 * words as u64 + BESIDES))
}

/// Formats a size for a person.
#[must_use]
pub fn shown(bytes: u64) -> String {
    match bytes {
        0..10_000 => format!("{bytes} B"),
        10_000..10_000_000 => format!("{:.0} kB", bytes as f64 / 1e3),
        10_000_000..10_000_000_000 => format!("{:.0} MB", bytes as f64 / 1e6),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}
