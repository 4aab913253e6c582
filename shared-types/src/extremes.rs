//! Smaller and larger of two numbers.
//!
//! `f64::min` and `f64::max` may return either zero of different signs, depending on the build. If one number is NaN,
//! the first of the two is returned.

/// Returns the smaller of two numbers.
#[must_use]
pub const fn smaller(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}

/// Returns the larger of two numbers.
#[must_use]
pub const fn larger(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}
