//! Measured times: their distribution as a histogram, with exact extremes.

use hdrhistogram::Histogram;

/// Longest time resolved by the histogram: a minute.
const LONGEST_NS: u64 = 60_000_000_000;
/// Significant decimal digits of a percentile.
const DIGITS: u8 = 3;

/// Measured times in ns.
///
/// The histogram rounds each time to its bucket. The minimum and maximum are stored exactly, and no percentile lies
/// outside them.
#[derive(Clone, Debug)]
pub struct Times {
    histogram: Histogram<u64>,
    /// Minimum and maximum; `None` before the first time.
    extremes: Option<(u64, u64)>,
}

impl Default for Times {
    fn default() -> Self {
        Self::with_digits(DIGITS)
    }
}

impl Times {
    /// Creates an empty distribution whose percentiles have this number of decimal digits.
    pub fn with_digits(digits: u8) -> Self {
        let histogram = Histogram::new_with_bounds(1, LONGEST_NS, digits);
        Self {
            histogram: histogram.expect("the bounds are legal"),
            extremes: None,
        }
    }

    /// Adds a time.
    pub fn record(&mut self, ns: u64) {
        self.histogram.saturating_record(ns);
        self.widen(ns, ns);
    }

    /// Adds all times of another distribution.
    pub fn add(&mut self, other: &Self) {
        let added = self.histogram.add(&other.histogram);
        added.expect("all histograms of times have the same bounds");
        if let Some((min, max)) = other.extremes {
            self.widen(min, max);
        }
    }

    /// Removes all times.
    pub fn reset(&mut self) {
        self.histogram.reset();
        self.extremes = None;
    }

    fn widen(&mut self, min: u64, max: u64) {
        let (least, most) = self.extremes.unwrap_or((min, max));
        self.extremes = Some((least.min(min), most.max(max)));
    }

    /// Returns the number of times.
    #[must_use]
    pub fn len(&self) -> u64 {
        self.histogram.len()
    }

    /// Returns `true` if there are no times.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.histogram.is_empty()
    }

    /// Returns the minimum; 0 if there are no times.
    #[must_use]
    pub fn min(&self) -> u64 {
        self.extremes.unwrap_or_default().0
    }

    /// Returns the maximum; 0 if there are no times.
    #[must_use]
    pub fn max(&self) -> u64 {
        self.extremes.unwrap_or_default().1
    }

    /// Returns the smallest time not exceeded by this share of all times, to the digits of the histogram.
    #[must_use]
    pub fn at_quantile(&self, quantile: f64) -> u64 {
        match self.histogram.value_at_quantile(quantile) {
            LONGEST_NS.. => self.max(),
            ns => ns.clamp(self.min(), self.max()),
        }
    }

    /// Returns the same quantile on the assumption that `longer` more times exist, all above the measured ones: the
    /// maximum, if the quantile falls among them.
    pub(crate) fn at_quantile_with_longer(&self, quantile: f64, longer: u64) -> u64 {
        let count = self.len();
        let rank = (quantile * (count + longer) as f64).ceil() as u64;
        if rank >= count {
            return self.max();
        }
        // Subtracts half a rank: the histogram rounds up.
        self.at_quantile((rank as f64 - 0.5) / count as f64)
    }

    /// Returns the non-empty buckets in order: `from <= t < to` and the number of times.
    pub fn buckets(&self) -> impl Iterator<Item = (u64, u64, u64)> {
        self.histogram.iter_recorded().map(|cell| {
            let from_ns = self.histogram.lowest_equivalent(cell.value_iterated_to());
            let to_ns = self.histogram.next_non_equivalent(from_ns);
            (from_ns, to_ns, cell.count_at_value())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(times: impl IntoIterator<Item = u64>) -> Times {
        let mut all = Times::default();
        for ns in times {
            all.record(ns);
        }
        all
    }

    #[test]
    fn the_extremes_are_exact_and_not_bucket_bounds() {
        // 7,000,001 ns lies in a bucket of 4,096 ns.
        let times = of([3_000_001, 5_000_000, 7_000_001]);
        assert_eq!((times.min(), times.max()), (3_000_001, 7_000_001));
        assert_eq!(times.at_quantile(1.0), 7_000_001);
        assert!(times.at_quantile(0.0) >= 3_000_001);
        // Outside the resolution of the histogram, and 0.
        let times = of([0, 90_000_000_001]);
        assert_eq!((times.min(), times.max()), (0, 90_000_000_001));
        assert_eq!(times.at_quantile(1.0), 90_000_000_001);
        assert_eq!((Times::default().min(), Times::default().max()), (0, 0));
    }

    #[test]
    fn adding_times_includes_their_extremes() {
        let mut times = of([5_000_001]);
        times.add(&of([1_000_003, 9_000_007]));
        times.add(&Times::default());
        assert_eq!(
            (times.min(), times.max(), times.len()),
            (1_000_003, 9_000_007, 3)
        );
        times.reset();
        assert!(times.is_empty());
        assert_eq!(times.max(), 0);
    }

    #[test]
    fn times_that_never_ended_rank_above_all_others() {
        let times = of(1..=1000);
        assert_eq!(times.at_quantile_with_longer(0.99, 0), 990);
        // Rank 999 of 1009, and of 1010 rank 1000, which is the last that ended.
        assert_eq!(times.at_quantile_with_longer(0.99, 9), 999);
        assert_eq!(times.at_quantile_with_longer(0.99, 10), 1000);
        assert_eq!(times.at_quantile_with_longer(0.99, 5000), 1000);
        assert_eq!(Times::default().at_quantile_with_longer(0.99, 5), 0);
    }
}
