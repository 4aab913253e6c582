//! The legs of a step, taken in one by one: the recorder's during a run, a measurement's and a
//! recording's.
//!
//! A leg is what the clocks of one step honestly tell apart. Plant and controller each measure their
//! own work; what the round trip took besides is the exchange, both ways and the waiting in one.

use hdrhistogram::Histogram;
use serde::Serialize;
use shared_types::record::Timing;

use super::grade::Graded;
use super::histogram;
use super::percentiles::Percentiles;
use super::spikes::{Spike, Spikes};

/// The legs of the steps so far and the worst of them.
#[derive(Clone, Debug)]
pub struct Latency {
    round_trip: Histogram<u64>,
    plant: Histogram<u64>,
    controller: Histogram<u64>,
    exchange: Histogram<u64>,
    release: Histogram<u64>,
    spikes: Spikes,
}

/// Percentiles of all legs of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Legs {
    /// From sending a sample to having its command.
    pub round_trip: Percentiles,
    /// The plant's integration from one step to the next; not in the round trip.
    pub plant: Percentiles,
    /// The controller's work on a sample, by its own clock.
    pub controller: Percentiles,
    /// The round trip without the controller's work: the link both ways and the waiting.
    pub exchange: Percentiles,
    /// Delay of sent samples after the time at which they were due; `None` in lockstep, where nothing is due.
    pub release: Option<Percentiles>,
}

/// Percentiles, spikes and grade of a run's latency.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LatencySummary {
    /// Percentiles of each leg.
    pub legs: Legs,
    /// The worst round trips, the longest first.
    pub spikes: Vec<Spike>,
    /// Grade of the latency; `None` if nothing was exchanged.
    pub grade: Option<Graded>,
}

impl Default for Latency {
    fn default() -> Self {
        Self {
            round_trip: histogram(),
            plant: histogram(),
            controller: histogram(),
            exchange: histogram(),
            release: histogram(),
            spikes: Spikes::default(),
        }
    }
}

impl Latency {
    /// Takes in the timing of a step.
    pub fn take(&mut self, step: u64, timing: &Timing) {
        if timing.round_trip_ns == 0 {
            return; // nothing was exchanged: the final record, or no command came
        }
        self.round_trip.saturating_record(timing.round_trip_ns);
        self.controller.saturating_record(timing.controller_ns);
        let exchange_ns = timing.round_trip_ns.saturating_sub(timing.controller_ns);
        self.exchange.saturating_record(exchange_ns);
        if timing.plant_ns > 0 {
            self.plant.saturating_record(timing.plant_ns);
        }
        if timing.late_ns > 0 {
            self.release.saturating_record(timing.late_ns);
        }
        self.spikes.take(step, timing);
    }

    /// Percentiles, worst steps and grade.
    #[must_use]
    pub fn summary(&self) -> LatencySummary {
        let release = self.is_paced().then(|| Percentiles::of(&self.release));
        let legs = Legs {
            round_trip: Percentiles::of(&self.round_trip),
            plant: Percentiles::of(&self.plant),
            controller: Percentiles::of(&self.controller),
            exchange: Percentiles::of(&self.exchange),
            release,
        };
        LatencySummary {
            legs,
            spikes: self.spikes.worst().to_vec(),
            grade: Graded::of(&legs),
        }
    }

    /// Steps so far that were answered.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.round_trip.len()
    }

    /// Returns true if samples were due at some time.
    #[must_use]
    pub fn is_paced(&self) -> bool {
        !self.release.is_empty()
    }

    /// The histograms of the legs, by name.
    #[must_use]
    pub fn histograms(&self) -> [(&'static str, &Histogram<u64>); 5] {
        [
            ("round_trip", &self.round_trip),
            ("plant", &self.plant),
            ("controller", &self.controller),
            ("exchange", &self.exchange),
            ("release", &self.release),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timing(round_trip_ns: u64, controller_ns: u64, late_ns: u64) -> Timing {
        Timing {
            round_trip_ns,
            controller_ns,
            late_ns,
            plant_ns: 7,
            ..Timing::default()
        }
    }

    #[test]
    fn the_exchange_is_the_round_trip_without_the_controller() {
        let mut latency = Latency::default();
        for step in 0..99 {
            latency.take(step, &timing(1000, 400, 0));
        }
        latency.take(99, &timing(50_000, 400, 0));
        latency.take(100, &Timing::default());
        let LatencySummary { legs, spikes, .. } = latency.summary();
        assert_eq!((legs.exchange.p50, legs.exchange.count), (600, 100));
        assert_eq!((legs.round_trip.p99, legs.plant.max), (1000, 7));
        assert!(legs.round_trip.max.abs_diff(50_000) <= 50);
        assert_eq!((spikes[0].step, spikes[0].round_trip_ns), (99, 50_000));
    }

    #[test]
    fn a_release_is_late_only_where_it_was_due() {
        let mut lockstep = Latency::default();
        let mut paced = Latency::default();
        for step in 1..=100 {
            lockstep.take(step, &timing(1000, 400, 0));
            paced.take(step, &timing(1000, 400, 10 * step));
        }
        assert_eq!(lockstep.summary().legs.release, None);
        let release = paced.summary().legs.release.expect("paced");
        assert_eq!((release.p50, release.p90, release.max), (500, 900, 1000));
        assert_eq!(release.count, 100);
    }

    #[test]
    fn without_an_exchange_there_is_no_grade() {
        let summary = Latency::default().summary();
        assert_eq!((summary.grade, summary.spikes.len()), (None, 0));
        assert_eq!(summary.legs.round_trip, Percentiles::default());
    }
}
