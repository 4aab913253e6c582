//! Tables: columns over time, and their values between and outside the rows.
//!
//! Made by the check of a scenario from a file or from lists, and evaluated at every step: by the plant as a reference
//! signal, by an [`Evaluation`](crate::evaluation::Evaluation) as a derived signal. Evaluation never allocates and
//! depends on time alone.

mod points;
mod spline;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub(crate) use points::list_key;
pub use points::{MOST_DERIVATIVES, PACKED, Points, Unpackable};

/// Time by which a row may come too early, in s: the time of a step and that of a row are rounded differently.
const SLACK_S: f64 = 1e-9;

/// Course between two rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interpolation {
    /// Value of the earlier row.
    Hold,
    /// Straight line.
    #[default]
    Linear,
    /// Cubic spline whose second derivative is continuous: zero at both ends, or the same where the table repeats.
    Cubic,
}

impl Interpolation {
    /// Every course.
    pub const ALL: [Self; 3] = [Self::Linear, Self::Hold, Self::Cubic];

    /// Returns the name in a scenario.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hold => "hold",
            Self::Linear => "linear",
            Self::Cubic => "cubic",
        }
    }

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// Course after the last row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AfterEnd {
    /// Value of the last row.
    #[default]
    Hold,
    /// Zero.
    Zero,
}

impl AfterEnd {
    /// Every course.
    pub const ALL: [Self; 2] = [Self::Hold, Self::Zero];

    /// Returns the name in a scenario.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hold => "hold",
            Self::Zero => "zero",
        }
    }

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// Columns over time with a value at any time; before the first row that of the first row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub struct Table {
    points: Points,
    interpolation: Interpolation,
    repeat: bool,
    end: AfterEnd,
    /// Second derivatives at the rows of a cubic table.
    curvatures: Arc<[f64]>,
}

/// Table as in the scenario and in the plant's job.
#[derive(Clone, Serialize, Deserialize)]
struct Written {
    #[serde(flatten)]
    points: Points,
    #[serde(default, skip_serializing_if = "Interpolation::is_default")]
    interpolation: Interpolation,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    repeat: bool,
    #[serde(default, skip_serializing_if = "AfterEnd::is_default")]
    end: AfterEnd,
}

impl From<Table> for Written {
    fn from(table: Table) -> Self {
        Self {
            points: table.points,
            interpolation: table.interpolation,
            repeat: table.repeat,
            end: table.end,
        }
    }
}

impl TryFrom<Written> for Table {
    type Error = &'static str;

    fn try_from(written: Written) -> Result<Self, Self::Error> {
        Self::new(
            written.points,
            written.interpolation,
            written.repeat,
            written.end,
        )
    }
}

impl Table {
    /// Creates a table.
    ///
    /// # Errors
    /// If the combination has no meaning; the reason.
    pub fn new(
        points: Points,
        interpolation: Interpolation,
        repeat: bool,
        end: AfterEnd,
    ) -> Result<Self, &'static str> {
        let (time_s, values) = (points.time_s(), points.column(0));
        let is_cubic = interpolation == Interpolation::Cubic;
        if is_cubic && points.derivatives() > 0 {
            return Err("a cubic table computes its derivatives and takes no columns for them");
        }
        if repeat && time_s.len() < 2 {
            return Err("a table with a single row cannot repeat");
        }
        if is_cubic && repeat && values.first() != values.last() {
            return Err(
                "a cubic table that repeats must end with its first value, because its last row is the first row of the next pass",
            );
        }
        let curvatures = match (is_cubic, repeat) {
            (false, _) => Vec::new(),
            (true, false) => spline::natural(time_s, values),
            (true, true) => spline::periodic(time_s, values),
        };
        Ok(Self {
            curvatures: curvatures.into(),
            points,
            interpolation,
            repeat,
            end,
        })
    }

    /// Creates a table of straight lines that is constant outside its points.
    #[must_use]
    pub fn linear(points: Points) -> Self {
        Self {
            points,
            interpolation: Interpolation::Linear,
            repeat: false,
            end: AfterEnd::Hold,
            curvatures: Arc::default(),
        }
    }

    /// Returns the rows.
    #[must_use]
    pub const fn points(&self) -> &Points {
        &self.points
    }

    /// Returns the rows.
    pub const fn points_mut(&mut self) -> &mut Points {
        &mut self.points
    }

    /// Returns the number of time derivatives that the table has: those of its columns, or else of its interpolation.
    #[must_use]
    pub fn derivatives(&self) -> usize {
        match (self.points.derivatives(), self.interpolation) {
            (0, Interpolation::Hold) => 0,
            (0, Interpolation::Linear) => 1,
            (0, Interpolation::Cubic) => MOST_DERIVATIVES,
            (columns, _) => columns,
        }
    }

    /// Returns the value alone.
    #[must_use]
    pub fn value(&self, time_s: f64) -> f64 {
        let mut row = [0.0; 1 + MOST_DERIVATIVES];
        self.evaluate(time_s, &mut row[..=self.derivatives()]);
        row[0]
    }

    /// Writes the value and the time derivatives in ascending order; where a derivative jumps, its value to the right.
    ///
    /// # Panics
    /// If the row does not have `1 + derivatives()` numbers.
    pub fn evaluate(&self, time_s: f64, row: &mut [f64]) {
        assert_eq!(row.len(), 1 + self.derivatives(), "a row of the table");
        let times_s = self.points.time_s();
        let (first_s, last_s) = (times_s[0], times_s[times_s.len() - 1]);
        let time_s = self.within(time_s, [first_s, last_s]);
        let slack_s = match self.interpolation {
            Interpolation::Hold => SLACK_S,
            Interpolation::Linear | Interpolation::Cubic => 0.0,
        };
        let after = times_s.partition_point(|&row_s| row_s <= time_s + slack_s);
        if after == 0 {
            self.hold(0, row);
        } else if after < times_s.len() {
            self.between(after - 1, time_s, row);
        } else if self.end == AfterEnd::Zero && time_s > last_s {
            row.fill(0.0);
        } else {
            self.hold(after - 1, row);
            if time_s <= last_s {
                self.copy_derivatives(after - 1, row);
            }
        }
    }

    /// Returns the time in the first pass of a table that repeats; a time that misses an end by its rounding becomes
    /// the time of that row.
    fn within(&self, time_s: f64, [first_s, last_s]: [f64; 2]) -> f64 {
        if time_s < first_s {
            return if time_s >= first_s - SLACK_S {
                first_s
            } else {
                time_s
            };
        }
        if !self.repeat {
            let is_end = (last_s..=last_s + SLACK_S).contains(&time_s);
            return if is_end { last_s } else { time_s };
        }
        if time_s < last_s - SLACK_S {
            return time_s;
        }
        // The last row is the first one of the next pass.
        match first_s + (time_s - first_s).rem_euclid(last_s - first_s) {
            time_s if time_s >= last_s - SLACK_S => first_s,
            time_s => time_s,
        }
    }

    /// Writes the value of a row, which stays.
    fn hold(&self, at: usize, row: &mut [f64]) {
        row.fill(0.0);
        row[0] = self.points.column(0)[at];
    }

    fn copy_derivatives(&self, at: usize, row: &mut [f64]) {
        for (order, derivative) in (1..=self.points.derivatives()).zip(&mut row[1..]) {
            *derivative = self.points.column(order)[at];
        }
    }

    /// Interpolates between the points `at` and `at + 1` and writes the value and its derivatives to `row`.
    fn between(&self, at: usize, time_s: f64, row: &mut [f64]) {
        let times_s = self.points.time_s();
        let since_s = time_s - times_s[at];
        let length_s = times_s[at + 1] - times_s[at];
        match self.interpolation {
            Interpolation::Hold => {
                self.hold(at, row);
                self.copy_derivatives(at, row);
            }
            Interpolation::Cubic => {
                let (y, m) = (self.points.column(0), &self.curvatures);
                let ends = [[y[at], m[at]], [y[at + 1], m[at + 1]]];
                row.copy_from_slice(&spline::evaluate(ends, length_s, since_s));
            }
            Interpolation::Linear => {
                let line = |column: &[f64]| {
                    let slope = (column[at + 1] - column[at]) / length_s;
                    // A row is reproduced bit by bit, a negative zero included.
                    let value = match since_s {
                        0.0 => column[at],
                        _ => column[at] + slope * since_s,
                    };
                    [value, slope]
                };
                match self.points.derivatives() {
                    0 => row.copy_from_slice(&line(self.points.column(0))),
                    orders => {
                        for (order, value) in (0..=orders).zip(row) {
                            *value = line(self.points.column(order))[0];
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
