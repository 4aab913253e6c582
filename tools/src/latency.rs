//! Latency of every step, as histograms and as the percentiles of a summary.

use hdrhistogram::Histogram;
use serde::Serialize;
use shared_types::record::Timing;

/// Longest latency that is told apart: a minute.
const LONGEST_NS: u64 = 60_000_000_000;
/// Significant decimal digits.
const DIGITS: u8 = 3;

/// Histograms of the legs of a step.
#[derive(Clone, Debug)]
pub struct Latency {
    round_trip: Histogram<u64>,
    plant: Histogram<u64>,
    controller: Histogram<u64>,
    exchange: Histogram<u64>,
}

/// Percentiles of one leg, in ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Percentiles {
    /// Median.
    pub p50: u64,
    /// 90 %.
    pub p90: u64,
    /// 99 %.
    pub p99: u64,
    /// 99.9 %.
    pub p999: u64,
    /// 99.99 %.
    pub p9999: u64,
    /// Largest.
    pub max: u64,
    /// Number of steps.
    pub count: u64,
}

/// Percentiles of all legs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct LatencySummary {
    /// From sending a sample to having its command.
    pub round_trip: Percentiles,
    /// The plant's integration of a step.
    pub plant: Percentiles,
    /// The controller's work on a sample.
    pub controller: Percentiles,
    /// The round trip without the controller's work: the link and the waiting.
    pub exchange: Percentiles,
}

impl Default for Latency {
    fn default() -> Self {
        let histogram =
            || Histogram::new_with_bounds(1, LONGEST_NS, DIGITS).expect("the bounds are legal");
        Self {
            round_trip: histogram(),
            plant: histogram(),
            controller: histogram(),
            exchange: histogram(),
        }
    }
}

impl Latency {
    /// Takes in the timing of a step.
    pub fn take(&mut self, timing: &Timing) {
        if timing.round_trip_ns == 0 {
            return; // the final record: nothing was exchanged
        }
        self.round_trip.saturating_record(timing.round_trip_ns);
        self.controller.saturating_record(timing.controller_ns);
        let exchange_ns = timing.round_trip_ns.saturating_sub(timing.controller_ns);
        self.exchange.saturating_record(exchange_ns);
        if timing.plant_ns > 0 {
            self.plant.saturating_record(timing.plant_ns);
        }
    }

    /// The percentiles.
    #[must_use]
    pub fn summary(&self) -> LatencySummary {
        let of = |histogram: &Histogram<u64>| Percentiles {
            p50: histogram.value_at_quantile(0.5),
            p90: histogram.value_at_quantile(0.9),
            p99: histogram.value_at_quantile(0.99),
            p999: histogram.value_at_quantile(0.999),
            p9999: histogram.value_at_quantile(0.9999),
            max: histogram.max(),
            count: histogram.len(),
        };
        LatencySummary {
            round_trip: of(&self.round_trip),
            plant: of(&self.plant),
            controller: of(&self.controller),
            exchange: of(&self.exchange),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exchange_is_the_round_trip_without_the_controller() {
        let mut latency = Latency::default();
        let timing = |round_trip_ns, controller_ns| Timing {
            round_trip_ns,
            controller_ns,
            plant_ns: 7,
            ..Timing::default()
        };
        for _ in 0..99 {
            latency.take(&timing(1000, 400));
        }
        latency.take(&timing(50_000, 400));
        latency.take(&Timing::default());
        let summary = latency.summary();
        assert_eq!((summary.exchange.p50, summary.exchange.count), (600, 100));
        assert_eq!((summary.round_trip.p99, summary.plant.max), (1000, 7));
        assert!(summary.round_trip.max.abs_diff(50_000) <= 50);
    }
}
