//! Integer time: steps, and their only conversion to seconds.
//!
//! Used by everything that handles time. Seconds exist only inside equations and are always computed from a step, never
//! accumulated.

use crate::number::{exact, exact_in};
use serde::{Deserialize, Serialize};

/// Index of a step. Step `k` is the instant `k / rate_hz`.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
)]
#[serde(transparent)]
pub struct Step(pub u64);

impl Step {
    /// Returns the step after this one.
    #[must_use]
    pub const fn next(self) -> Self {
        Self(self.0 + 1)
    }
}

impl std::fmt::Display for Step {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

/// Exchange rate of a run, which converts steps into time and back.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct Rate {
    hz: f64,
}

impl Rate {
    /// Lowest accepted rate in Hz.
    pub const MIN_HZ: f64 = 1e-3;
    /// Highest accepted rate in Hz: a step of one microsecond.
    pub const MAX_HZ: f64 = 1e6;

    /// Creates a rate in Hz; `None` outside [`Rate::MIN_HZ`] to [`Rate::MAX_HZ`].
    #[must_use]
    pub fn new(hz: f64) -> Option<Self> {
        (Self::MIN_HZ..=Self::MAX_HZ)
            .contains(&hz)
            .then_some(Self { hz })
    }

    /// Returns the rate in Hz.
    #[must_use]
    pub const fn hz(self) -> f64 {
        self.hz
    }

    /// Returns the length of one step in seconds.
    #[must_use]
    pub fn period_s(self) -> f64 {
        1.0 / self.hz
    }

    /// Returns the simulated time of a step in seconds, `step / rate_hz`.
    #[must_use]
    #[inline]
    pub fn seconds(self, step: Step) -> f64 {
        step.0 as f64 / self.hz
    }

    /// Returns the simulated time of a step in nanoseconds, rounded to the nearest and saturating at the limit of 64
    /// bits, 584 years.
    #[must_use]
    #[inline]
    pub fn nanoseconds(self, step: Step) -> u64 {
        // Whole seconds and the rest apart: 2^40 steps of a microsecond exceed the 53 bits of a double.
        let whole = (self.seconds(step)) as u64;
        let rest_s = (step.0 as f64 - whole as f64 * self.hz) / self.hz;
        let rest_ns = rest_s * 1e9 + 0.5;
        let whole_ns = whole.saturating_mul(1_000_000_000);
        if rest_ns < 0.0 {
            whole_ns.saturating_sub((-rest_ns) as u64)
        } else {
            whole_ns.saturating_add(rest_ns as u64)
        }
    }

    /// Returns the first step whose time is not before `at_s`. Negative times give step 0, and times beyond the largest
    /// step give that step.
    #[must_use]
    pub fn step_at_or_after(self, at_s: f64) -> Step {
        if at_s > self.seconds(Step(u64::MAX)) {
            return Step(u64::MAX);
        }
        let mut step = Step((at_s * self.hz) as u64);
        while step.0 > 0 && self.seconds(Step(step.0 - 1)) >= at_s {
            step.0 -= 1;
        }
        while self.seconds(step) < at_s {
            step.0 += 1;
        }
        step
    }

    /// Returns the last step whose time is not after `at_s`; `None` for negative times.
    #[must_use]
    pub fn step_at_or_before(self, at_s: f64) -> Option<Step> {
        let after = self.step_at_or_after(at_s);
        if self.seconds(after) > at_s {
            after.0.checked_sub(1).map(Step)
        } else {
            Some(after)
        }
    }
}

/// Number that is not a valid rate.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{} is not a valid rate: expected {} to {}",
    exact_in(*.0, "Hz"),
    exact(Rate::MIN_HZ),
    exact_in(Rate::MAX_HZ, "Hz"))]
pub struct NoRate(pub f64);

impl TryFrom<f64> for Rate {
    type Error = NoRate;

    fn try_from(hz: f64) -> Result<Self, NoRate> {
        Self::new(hz).ok_or(NoRate(hz))
    }
}

impl From<Rate> for f64 {
    fn from(rate: Rate) -> Self {
        rate.hz
    }
}

/// Exchange interval, from one step to the next, as seen by an integrator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Simulated time at the beginning of the interval in seconds.
    pub start_s: f64,
    /// Length of the interval in seconds.
    pub length_s: f64,
    /// Number of equal integration steps in the interval, at least 1.
    pub substeps: u32,
}

impl Interval {
    /// Returns the length of one integration step in seconds.
    #[must_use]
    pub fn substep_s(&self) -> f64 {
        self.length_s / f64::from(self.substeps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate(hz: f64) -> Rate {
        Rate::new(hz).expect("a valid rate")
    }

    #[test]
    fn a_time_on_the_grid_belongs_to_exactly_one_step() {
        for hz in [1.0, 3.0, 10.0, 1000.0, 10_000.0, 999_999.0] {
            for k in [0, 1, 2, 3, 7, 69_999, 70_000, 70_001, 1 << 40] {
                let at_s = rate(hz).seconds(Step(k));
                assert_eq!(
                    rate(hz).step_at_or_after(at_s),
                    Step(k),
                    "{hz} Hz, step {k}"
                );
            }
        }
    }

    #[test]
    fn times_beyond_every_step_saturate() {
        for hz in [Rate::MIN_HZ, 1000.0, Rate::MAX_HZ] {
            for at_s in [1e300, f64::MAX, f64::INFINITY] {
                assert_eq!(rate(hz).step_at_or_after(at_s), Step(u64::MAX));
            }
            assert_eq!(rate(hz).step_at_or_after(f64::NAN), Step(0));
        }
        assert_eq!(rate(1.0).nanoseconds(Step(u64::MAX)), u64::MAX);
        // 2^64 steps of a microsecond are 18,446,744,073,709.55 s.
        assert_eq!(rate(1e6).nanoseconds(Step(u64::MAX)), u64::MAX);
    }

    #[test]
    fn an_invalid_rate_is_refused_when_deserialised() {
        for text in ["0", "-1000", "1e-4", "1e308"] {
            let error = serde_json::from_str::<Rate>(text).expect_err(text);
            assert!(error.to_string().contains("not a valid rate"), "{error}");
        }
        let read: Rate = serde_json::from_str("1000").expect("a rate");
        assert_eq!(
            (
                read,
                serde_json::to_string(&read).expect("written").as_str()
            ),
            (rate(1000.0), "1000.0")
        );
    }

    #[test]
    fn a_time_between_steps_rounds_up() {
        assert_eq!(rate(10_000.0).step_at_or_after(7.000_01), Step(70_001));
        assert_eq!(rate(10_000.0).step_at_or_after(1e-12), Step(1));
        assert_eq!(rate(10_000.0).step_at_or_after(-1.0), Step(0));
    }

    #[test]
    fn the_last_step_before_a_time_is_at_it_or_one_earlier() {
        for (at_s, step) in [(7.000_01, 70_000), (7.0, 70_000), (1e-12, 0), (0.0, 0)] {
            assert_eq!(rate(10_000.0).step_at_or_before(at_s), Some(Step(step)));
        }
        assert_eq!(rate(10_000.0).step_at_or_before(-1.0), None);
    }

    #[test]
    fn nanoseconds_are_exact_over_days() {
        assert_eq!(rate(10_000.0).nanoseconds(Step(1)), 100_000);
        assert_eq!(
            rate(1e6).nanoseconds(Step((1 << 40) + 1)),
            ((1 << 40) + 1) * 1000
        );
        assert_eq!(rate(3.0).nanoseconds(Step(1)), 333_333_333);
        assert_eq!(
            rate(3.0).nanoseconds(Step(3_000_001)),
            1_000_000_333_333_333
        );
    }

    #[test]
    fn rates_outside_the_range_are_refused() {
        for hz in [0.0, -1.0, 1e7, f64::NAN, f64::INFINITY] {
            assert_eq!(Rate::new(hz), None, "{hz}");
        }
    }
}
