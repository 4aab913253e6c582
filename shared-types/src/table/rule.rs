//! Compile-time rules for the rows of [`table!`](crate::table!).
//!
//! Each rule is a trait with its compiler message, and a function that the macro calls with a part of the row, so that
//! the error points at the row. No rule is evaluated at run time.

/// Returns `true` unless the number before `..=` is above the number after it.
#[must_use]
pub const fn is_range(min: f64, max: f64) -> bool {
    min <= max
}

/// Returns `true` if a default is in its range, or if the range is invalid.
#[must_use]
pub const fn is_inside(min: f64, max: f64, default: f64) -> bool {
    !is_range(min, max) || (min <= default && default <= max)
}

/// Marker of a row that keeps or breaks a rule.
pub struct Kept<const KEPT: bool>;

macro_rules! rule {
    ($trait:ident, $check:ident, $message:literal, $label:literal, $note:literal) => {
        #[doc = $message]
        #[diagnostic::on_unimplemented(message = $message, label = $label, note = $note)]
        pub trait $trait {}

        impl Kept<true> {
            /// Accepts any part of the row.
            pub const fn $check<T: Copy>(_part: T) {}
        }

        impl Kept<false> {
            /// Accepts no type, because none implements the trait.
            pub const fn $check<T: $trait + Copy>(_part: T) {}
        }
    };
}

rule!(
    Described,
    described,
    "a row of a table has no description",
    "this row has no `///` line",
    "write `/// What it is.` above it: --describe and the documentation of the plant say it"
);
rule!(
    Measured,
    measured,
    "a row of a table has no unit",
    "the row below has no unit",
    "write `name: \"unit\"`, for example `mass_kg: \"kg\"`; a number without a unit has \"1\""
);
rule!(
    Parenthesised,
    parenthesised,
    "a negative number stands in parentheses",
    "this number is negative",
    "write `in (-1.0)..=1.0`"
);
rule!(
    Ordered,
    ordered,
    "the range of a row begins above its end",
    "the end is below the begin",
    "write `in min..=max`, the smaller number first"
);
rule!(
    Inside,
    inside,
    "the default of a row is outside its range",
    "outside the range behind it",
    "change the default or the range"
);
rule!(
    Settable,
    settable,
    "a parameter has no default",
    "this row has no default",
    "write `name: \"unit\" = default in min..=max`; signals have none and stand in a table of their own"
);
