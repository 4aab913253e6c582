//! Reductions: from the rows of a window to one number, in constant memory.

use shared_types::time::{Rate, Step};

use super::Program;

/// Kind of a reduction, which turns the rows of a window into one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReductionKind {
    /// Largest magnitude.
    MaxAbs,
    /// Largest value.
    Max,
    /// Smallest value.
    Min,
    /// Mean of the rows.
    Mean,
    /// Root mean square over the rows.
    Rms,
    /// Value in the first row.
    Initial,
    /// Value in the last row.
    Final,
    /// Integral over time by the trapezoidal rule, in the value's unit times seconds.
    Integral,
}

impl ReductionKind {
    /// Every reduction.
    pub const ALL: [Self; 8] = [
        Self::MaxAbs,
        Self::Max,
        Self::Min,
        Self::Mean,
        Self::Rms,
        Self::Initial,
        Self::Final,
        Self::Integral,
    ];

    /// Returns the name in expressions.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::MaxAbs => "max_abs",
            Self::Max => "max",
            Self::Min => "min",
            Self::Mean => "mean",
            Self::Rms => "rms",
            Self::Initial => "initial",
            Self::Final => "final",
            Self::Integral => "integral",
        }
    }

    pub(super) fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// Reduction bound to columns: its kind and its expression.
#[derive(Clone, Debug, PartialEq)]
pub struct Reduction {
    /// Kind of the reduction.
    pub kind: ReductionKind,
    /// Value of a row.
    pub program: Program,
}

/// Reduction in progress over one window.
#[derive(Clone, Copy, Debug)]
pub struct Accumulator {
    kind: ReductionKind,
    /// Intermediate result; for sums see [`Sum`].
    value: f64,
    sum: Sum,
    last: Option<(Step, f64)>,
    rows: u64,
    skipped: u64,
}

impl Accumulator {
    /// Creates a reduction before its first row.
    #[must_use]
    pub fn new(kind: ReductionKind) -> Self {
        Self {
            kind,
            value: f64::NAN,
            sum: Sum::default(),
            last: None,
            rows: 0,
            skipped: 0,
        }
    }

    /// Processes the value of the next row; NaN is skipped and counted.
    pub fn take(&mut self, step: Step, rate: Rate, value: f64) {
        if value.is_nan() {
            self.skipped += 1;
            return;
        }
        let first = self.rows == 0;
        match self.kind {
            ReductionKind::MaxAbs if first || value.abs() > self.value => self.value = value.abs(),
            ReductionKind::Max if first || value > self.value => self.value = value,
            ReductionKind::Min if first || value < self.value => self.value = value,
            ReductionKind::Initial if first => self.value = value,
            ReductionKind::Final => self.value = value,
            ReductionKind::Mean => self.sum.add(value),
            ReductionKind::Rms => self.sum.add(value * value),
            ReductionKind::Integral => {
                if let Some((last_step, last)) = self.last {
                    let length_s = (step.0 - last_step.0) as f64 / rate.hz();
                    self.sum.add(0.5 * (last + value) * length_s);
                }
            }
            _ => {}
        }
        self.last = Some((step, value));
        self.rows += 1;
    }

    /// Returns the result over the rows so far; NaN if there are none.
    #[must_use]
    pub fn result(&self) -> f64 {
        if self.rows == 0 {
            return f64::NAN;
        }
        match self.kind {
            ReductionKind::Mean => self.sum.total() / self.rows as f64,
            ReductionKind::Rms => (self.sum.total() / self.rows as f64).sqrt(),
            ReductionKind::Integral => self.sum.total(),
            _ => self.value,
        }
    }

    /// Returns the number of rows whose value was missing.
    #[must_use]
    pub const fn skipped(&self) -> u64 {
        self.skipped
    }
}

/// Compensated sum (Neumaier 1974): the mean of a day at 10 kHz is as accurate as the mean of a second.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    sum: f64,
    lost: f64,
}

impl Sum {
    fn add(&mut self, value: f64) {
        let sum = self.sum + value;
        self.lost += if self.sum.abs() >= value.abs() {
            (self.sum - sum) + value
        } else {
            (value - sum) + self.sum
        };
        self.sum = sum;
    }

    fn total(&self) -> f64 {
        // The compensation of an infinite sum is not a number.
        if self.sum.is_finite() {
            self.sum + self.lost
        } else {
            self.sum
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reduce(kind: ReductionKind, rows: &[f64]) -> f64 {
        let rate = Rate::new(10.0).expect("a rate");
        let mut accumulator = Accumulator::new(kind);
        for (step, value) in (5..).zip(rows) {
            accumulator.take(Step(step), rate, *value);
        }
        accumulator.result()
    }

    #[test]
    fn each_reduction_has_its_textbook_value() {
        let rows = [1.0, -4.0, f64::NAN, 3.0];
        let expected = [
            (ReductionKind::MaxAbs, 4.0),
            (ReductionKind::Max, 3.0),
            (ReductionKind::Min, -4.0),
            (ReductionKind::Mean, 0.0),
            (ReductionKind::Rms, (26.0_f64 / 3.0).sqrt()),
            (ReductionKind::Initial, 1.0),
            (ReductionKind::Final, 3.0),
            // -1.5 * 0.1, then a straight line over the missing row: -0.5 * 0.2.
            (ReductionKind::Integral, -0.25),
        ];
        for (kind, value) in expected {
            let actual = reduce(kind, &rows);
            assert!((actual - value).abs() < 1e-15, "{}: {actual}", kind.name());
        }
    }

    #[test]
    fn every_reduction_over_no_rows_is_missing() {
        for kind in ReductionKind::ALL {
            assert!(reduce(kind, &[]).is_nan());
            assert!(reduce(kind, &[f64::NAN]).is_nan());
        }
    }

    #[test]
    fn a_long_mean_stays_accurate() {
        let rate = Rate::new(10.0).expect("a rate");
        let mut mean = Accumulator::new(ReductionKind::Mean);
        mean.take(Step(0), rate, 1e16);
        for step in 1..1_000_000 {
            mean.take(Step(step), rate, 1.0);
        }
        mean.take(Step(1_000_000), rate, -1e16);
        assert_eq!(mean.result(), 999_999.0 / 1_000_001.0);
    }

    #[test]
    fn an_infinite_value_makes_an_infinite_mean() {
        assert_eq!(
            reduce(ReductionKind::Mean, &[1.0, f64::INFINITY]),
            f64::INFINITY
        );
    }
}
