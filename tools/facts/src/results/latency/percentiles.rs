//! Percentiles of measured times.

use hil_console::terminal::duration::shown_ns;
use serde::{Deserialize, Serialize};

use super::times::Times;

/// Percentiles of times in ns, to the three digits of their histogram; the maximum is exact.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Median.
    pub p50: u64,
    /// 90th percentile.
    pub p90: u64,
    /// 99th percentile.
    pub p99: u64,
    /// 99.9th percentile.
    pub p999: u64,
    /// 99.99th percentile; the maximum for fewer than 10 000 times.
    pub p9999: u64,
    /// Maximum.
    pub max: u64,
    /// Number of times.
    pub count: u64,
}

impl Percentiles {
    /// Formats all figures, from the median to the maximum.
    pub fn shown(&self) -> [String; 6] {
        [
            self.p50, self.p90, self.p99, self.p999, self.p9999, self.max,
        ]
        .map(shown_ns)
    }

    /// Returns the percentiles of times; all 0 if there are none.
    #[must_use]
    pub fn of(times: &Times) -> Self {
        Self {
            p50: times.at_quantile(0.5),
            p90: times.at_quantile(0.9),
            p99: times.at_quantile(0.99),
            p999: times.at_quantile(0.999),
            p9999: times.at_quantile(0.9999),
            max: times.max(),
            count: times.len(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_percentile_is_the_smallest_time_not_exceeded_by_its_share() {
        let mut times = Times::default();
        assert_eq!(Percentiles::of(&times), Percentiles::default());
        for ns in (1..=1000).cycle().take(100_000) {
            times.record(ns);
        }
        let expected = Percentiles {
            p50: 500,
            p90: 900,
            p99: 990,
            p999: 999,
            p9999: 1000,
            max: 1000,
            count: 100_000,
        };
        assert_eq!(Percentiles::of(&times), expected);
    }
}
