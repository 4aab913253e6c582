//! Smaller and larger of two numbers, of which a missing one (NaN) is skipped if it comes second.
//!
//! `f64::min` and `f64::max` may return either zero of different signs.

pub(super) const fn smaller(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}

pub(super) const fn larger(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// Extends a range to a value.
pub(super) const fn extended([low, high]: [f64; 2], value: f64) -> [f64; 2] {
    [smaller(low, value), larger(high, value)]
}
