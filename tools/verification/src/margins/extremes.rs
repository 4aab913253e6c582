//! Ranges of numbers, of which a missing one (NaN) is skipped if it comes second.

pub(super) use shared_types::extremes::{larger, smaller};

/// Extends a range to a value.
pub(super) const fn extended([low, high]: [f64; 2], value: f64) -> [f64; 2] {
    [smaller(low, value), larger(high, value)]
}
