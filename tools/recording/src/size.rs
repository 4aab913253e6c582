//! Size that a recording can reach, estimated before the run.

use shared_types::record::{RecordLayout, Timing};

use super::excerpt::Choice;

/// Bytes of a message besides its words: its head, its encapsulation and its entry in the index.
const BESIDES: u64 = 31 + 4 + 16;

/// Computes the largest size of a run of N steps in bytes without compression; without what
/// happens around faults, whose number is not known.
///
/// # Errors
/// If the choice names no signal of this run.
pub fn largest(layout: &RecordLayout, steps: u64, choice: &Choice) -> Result<u64, String> {
    let kept = choice.kept(layout)?;
    let signals = kept.iter().filter(|kept| **kept).count();
    let words = layout.values_start() + signals + Timing::WORDS;
    let records = match (choice.every, choice.around_s) {
        (Some(every), _) => steps / every + 2,
        (None, Some(_)) => 2,
        (None, None) => steps + 1,
    };
    Ok(records * (8 * words as u64 + BESIDES))
}

/// A size as a person reads it.
#[must_use]
pub fn shown(bytes: u64) -> String {
    match bytes {
        0..10_000 => format!("{bytes} B"),
        10_000..10_000_000 => format!("{:.0} kB", bytes as f64 / 1e3),
        10_000_000..10_000_000_000 => format!("{:.0} MB", bytes as f64 / 1e6),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}
