//! Accumulates the deviation of one signal between two runs, step by step.
//!
//! `hil compare` and `hil replay` pass both values of each step. Values are equal if their bits are equal. Only sums
//! are stored, so memory does not depend on the length of the runs.

use hil_console::terminal::table::{Table, left, right};
use serde::Serialize;
use shared_types::number::{short, unit_shown};

/// Accumulator of a deviation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Deviation {
    tolerance: f64,
    /// Number of steps at which both values were finite.
    compared: u64,
    differing: u64,
    first_step: Option<u64>,
    first_beyond_step: Option<u64>,
    max: f64,
    at_step: Option<u64>,
    squares: f64,
    incomparable: u64,
}

/// Deviation of a signal.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct SignalDifference {
    pub(crate) name: String,
    pub(crate) unit: String,
    pub(crate) max_abs_difference: f64,
    /// Step of the largest difference; null if no step has two numbers.
    pub(crate) at_step: Option<u64>,
    pub(crate) rms_difference: f64,
    /// First step at which the values differ.
    pub(crate) first_step: Option<u64>,
    /// First step at which the difference exceeds the tolerance.
    pub(crate) first_beyond_step: Option<u64>,
    /// Number of steps at which the values differ.
    pub(crate) differing_steps: u64,
    /// Number of steps at which the values differ and at most one of them is finite.
    pub(crate) incomparable_steps: u64,
    /// Largest allowed difference.
    pub(crate) tolerance: f64,
}

/// Returns `true` if `a` and `b` have the same bits or are finite and differ by at most a nonzero `tolerance`.
pub(crate) fn is_near(a: f64, b: f64, tolerance: f64) -> bool {
    a.to_bits() == b.to_bits()
        || (tolerance > 0.0 && a.is_finite() && b.is_finite() && (a - b).abs() <= tolerance)
}

impl Deviation {
    /// Creates the accumulator for a signal with this tolerance.
    pub(crate) fn new(tolerance: f64) -> Self {
        Self {
            tolerance,
            ..Self::default()
        }
    }

    /// Adds one step; returns `true` if the difference exceeds the tolerance.
    pub(crate) fn take(&mut self, step: u64, a: f64, b: f64) -> bool {
        if a.to_bits() == b.to_bits() {
            self.compared += u64::from(a.is_finite());
            return false;
        }
        self.differing += 1;
        self.first_step.get_or_insert(step);
        if a.is_finite() && b.is_finite() {
            let difference = (a - b).abs();
            self.compared += 1;
            self.squares += difference * difference;
            if difference > self.max || self.at_step.is_none() {
                (self.max, self.at_step) = (difference, Some(step));
            }
        } else {
            self.incomparable += 1;
        }
        let is_beyond = !is_near(a, b, self.tolerance);
        if is_beyond {
            self.first_beyond_step.get_or_insert(step);
        }
        is_beyond
    }

    /// Returns `true` if any step differs.
    pub(crate) const fn is_any(&self) -> bool {
        self.differing > 0
    }

    /// Returns `true` if no difference exceeds the tolerance.
    pub(crate) const fn is_within(&self) -> bool {
        self.first_beyond_step.is_none()
    }

    /// Returns the accumulated deviation.
    pub(crate) fn of(&self, name: &str, unit: &str) -> SignalDifference {
        let rms = if self.compared > 0 {
            (self.squares / self.compared as f64).sqrt()
        } else {
            0.0
        };
        SignalDifference {
            name: name.into(),
            unit: unit.into(),
            max_abs_difference: self.max,
            at_step: self.at_step,
            rms_difference: rms,
            first_step: self.first_step,
            first_beyond_step: self.first_beyond_step,
            differing_steps: self.differing,
            incomparable_steps: self.incomparable,
            tolerance: self.tolerance,
        }
    }
}

/// Writes the differences as a table with a line per signal.
///
/// # Errors
/// If the text cannot be written.
pub(crate) fn write_table(
    text: &mut impl std::fmt::Write,
    signals: &[SignalDifference],
    heading: &str,
) -> std::fmt::Result {
    let any_tolerance = signals.iter().any(|signal| signal.tolerance > 0.0);
    let widths = [12, 9, 12, 9, 9, 12, 11];
    let widths = &widths[..if any_tolerance { 7 } else { 5 }];
    let numbers = widths.iter().map(|width| right(*width));
    let columns: Vec<_> = [left(0)]
        .into_iter()
        .chain(numbers)
        .chain([left(0)])
        .collect();
    let mut table = Table::new(2, columns);
    let headings = [
        "signal",
        heading,
        "at step",
        "rms",
        "first",
        "steps",
        "of tolerance",
        "beyond from",
    ];
    table.cells(headings.into_iter().take(1 + widths.len()));
    let step = |step: Option<u64>| step.map_or_else(|| "-".into(), |step| step.to_string());
    for signal in signals {
        let max = signal.max_abs_difference;
        let mut cells = vec![
            signal.name.clone(),
            short(max),
            step(signal.at_step),
            short(signal.rms_difference),
            step(signal.first_step),
            signal.differing_steps.to_string(),
        ];
        if any_tolerance {
            cells.extend([share(max, signal.tolerance), step(signal.first_beyond_step)]);
        }
        let unit = unit_shown(&signal.unit);
        cells.push(match signal.incomparable_steps {
            0 => unit.to_owned(),
            steps => format!("{unit}, not both finite at {steps} steps"),
        });
        table.cells(cells);
    }
    write!(text, "\n{table}")
}

/// Formats a difference as a percentage of the tolerance.
pub(crate) fn share(difference: f64, tolerance: f64) -> String {
    if tolerance > 0.0 {
        format!("{:.3} %", 100.0 * difference / tolerance)
    } else {
        "-".into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(pairs: &[(f64, f64)]) -> SignalDifference {
        let mut deviation = Deviation::default();
        for (step, (a, b)) in (0..).zip(pairs) {
            deviation.take(step, *a, *b);
        }
        deviation.of("x_m", "m")
    }

    #[test]
    fn largest_first_and_mean_differences_are_determined() {
        let difference = of(&[(1.0, 1.0), (1.0, 4.0), (5.0, 1.0), (2.0, 2.0)]);
        assert_eq!(
            (difference.max_abs_difference, difference.at_step),
            (4.0, Some(2))
        );
        assert_eq!(
            (difference.first_step, difference.differing_steps),
            (Some(1), 2)
        );
        assert_eq!(difference.rms_difference, 2.5); // sqrt((9 + 16) / 4)
    }

    #[test]
    fn nan_equals_only_itself() {
        let nan = f64::NAN;
        let infinite = f64::INFINITY;
        let difference = of(&[
            (nan, nan),
            (nan, 1.0),
            (infinite, 1.0),
            (infinite, infinite),
        ]);
        assert_eq!(
            (difference.incomparable_steps, difference.differing_steps),
            (2, 2)
        );
        assert_eq!((difference.at_step, difference.rms_difference), (None, 0.0));
        for (a, b, tolerance, near) in [
            (nan, nan, 0.0, true),
            (nan, 1.0, infinite, false),
            (infinite, 1.0, infinite, false),
            (0.0, -0.0, 0.0, false),
            (0.0, -0.0, 1e-300, true),
            (1.0, 1.5, 0.5, true),
            (1.0, 1.5, 0.4999, false),
        ] {
            assert_eq!(is_near(a, b, tolerance), near, "{a} {b} {tolerance}");
            let mut deviation = Deviation::new(tolerance);
            let is_beyond = deviation.take(0, a, b);
            assert_eq!(
                (deviation.is_within(), is_beyond),
                (near, !near),
                "{a} {b} {tolerance}"
            );
        }
    }

    #[test]
    fn the_first_step_beyond_the_tolerance_may_follow_the_first_difference() {
        let mut deviation = Deviation::new(0.5);
        for (step, b) in (0..).zip([1.0, 1.25, 1.5, 1.75, 2.0]) {
            deviation.take(step, 1.0, b);
        }
        let difference = deviation.of("x_m", "m");
        assert_eq!(
            (difference.first_step, difference.first_beyond_step),
            (Some(1), Some(3))
        );
        assert_eq!(
            share(difference.max_abs_difference, difference.tolerance),
            "200.000 %"
        );
    }

    #[test]
    fn zeros_of_different_sign_differ_by_zero() {
        let difference = of(&[(0.0, -0.0)]);
        assert_eq!(
            (difference.differing_steps, difference.max_abs_difference),
            (1, 0.0)
        );
        assert_eq!(difference.at_step, Some(0));
    }
}
