//! Legs of a step, collected one by one: by the recorder during a run, by a measurement, or from a recording.
//!
//! A leg is an interval that the clocks of one step can measure separately. Plant and controller each measure their own
//! work; the rest of the round trip is the exchange, which combines both directions and the waiting.

use serde::Serialize;
use shared_types::number::counted;
use shared_types::record::Timing;

use super::grade::Graded;
use super::percentiles::Percentiles;
use super::spikes::{Order, Spike, Spikes};
use super::times::Times;

/// Legs of the steps so far, and the worst steps.
#[derive(Clone, Debug)]
pub struct Latency {
    /// `true` if samples were due at certain times, by the clock of the run.
    is_due: bool,
    round_trip: Times,
    plant: Times,
    controller: Times,
    exchange: Times,
    release: Times,
    without_command: u64,
    spikes: Spikes,
    late_releases: Spikes,
}

/// Percentiles of all legs of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Legs {
    /// From sending a sample to receiving its command.
    pub round_trip: Percentiles,
    /// The plant's integration from one step to the next; not part of the round trip.
    pub plant: Percentiles,
    /// The controller's work on a sample, by its own clock.
    pub controller: Percentiles,
    /// Round trip without the controller's work: the link in both directions, and the waiting.
    pub exchange: Percentiles,
    /// Delay of samples beyond their due time; `None` in lockstep, which has no due times.
    pub release: Option<Percentiles>,
    /// Number of steps that received neither their own command nor a late one, and so have no round trip.
    pub without_command: u64,
}

/// Percentiles, spikes and grade of a run's latency.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LatencySummary {
    /// Percentiles of each leg.
    pub legs: Legs,
    /// Worst round trips, longest first.
    pub spikes: Vec<Spike>,
    /// Latest releases, latest first; empty in lockstep.
    pub late_releases: Vec<Spike>,
    /// Grade of the latency; `None` if nothing was exchanged.
    pub grade: Option<Graded>,
}

/// Formats the number of steps without a command.
pub fn without_command(steps: u64) -> String {
    format!("{} without a command", counted(steps, "step"))
}

impl Default for Latency {
    fn default() -> Self {
        Self::new(false)
    }
}

impl Latency {
    /// Starts a run whose samples have due times or not.
    #[must_use]
    pub fn new(is_due: bool) -> Self {
        Self {
            is_due,
            round_trip: Times::default(),
            plant: Times::default(),
            controller: Times::default(),
            exchange: Times::default(),
            release: Times::default(),
            without_command: 0,
            spikes: Spikes::new(Order::RoundTrip),
            late_releases: Spikes::new(Order::Release),
        }
    }

    /// Adds the timing of a record. Every leg present in the record counts, even if others are missing.
    pub fn take(&mut self, step: u64, timing: &Timing) {
        // The first record of a run has no step before it; no integration takes 0 ns.
        if timing.plant_ns > 0 {
            self.plant.record(timing.plant_ns);
        }
        if timing.is_final() {
            return;
        }
        if timing.round_trip_ns > 0 {
            self.round_trip.record(timing.round_trip_ns);
            self.controller.record(timing.controller_ns);
            let exchange_ns = timing.round_trip_ns.saturating_sub(timing.controller_ns);
            self.exchange.record(exchange_ns);
        } else {
            self.without_command += 1;
        }
        // In recordings of older formats the clock is unknown: only late samples are known to have been due.
        if self.is_due || timing.late_ns > 0 {
            self.release.record(timing.late_ns);
            self.late_releases.take(step, timing);
        }
        self.spikes.take(step, timing);
    }

    /// Returns percentiles, worst steps and grade.
    #[must_use]
    pub fn summary(&self) -> LatencySummary {
        let release = self.is_paced().then(|| Percentiles::of(&self.release));
        let legs = Legs {
            round_trip: Percentiles::of(&self.round_trip),
            plant: Percentiles::of(&self.plant),
            controller: Percentiles::of(&self.controller),
            exchange: Percentiles::of(&self.exchange),
            release,
            without_command: self.without_command,
        };
        LatencySummary {
            legs,
            spikes: self.spikes.worst().to_vec(),
            late_releases: self.late_releases.worst().to_vec(),
            grade: Graded::of(&self.round_trip, self.without_command, &self.release),
        }
    }

    /// Returns the number of steps so far.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.round_trip.len() + self.without_command
    }

    /// Returns `true` if samples were due at certain times.
    #[must_use]
    pub fn is_paced(&self) -> bool {
        !self.release.is_empty()
    }

    /// Returns the times of the legs by name.
    #[must_use]
    pub fn times(&self) -> [(&'static str, &Times); 5] {
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
    use crate::results::latency::grade::Leg;

    fn timing(round_trip_ns: u64, controller_ns: u64, late_ns: u64) -> Timing {
        Timing {
            epoch: 1,
            round_trip_ns,
            controller_ns,
            late_ns,
            plant_ns: 7,
            ..Timing::default()
        }
    }

    #[test]
    fn the_exchange_is_the_round_trip_without_the_controller() {
        let mut latency = Latency::new(false);
        for step in 0..99 {
            latency.take(step, &timing(1000, 400, 0));
        }
        latency.take(99, &timing(50_000, 400, 0));
        let after_it = Timing {
            epoch: 1,
            ..Timing::default()
        };
        latency.take(100, &after_it);
        let LatencySummary { legs, spikes, .. } = latency.summary();
        assert_eq!((legs.exchange.p50, legs.exchange.count), (600, 100));
        assert_eq!((legs.round_trip.p99, legs.plant.max), (1000, 7));
        assert_eq!((legs.round_trip.max, legs.without_command), (50_000, 0));
        assert_eq!((spikes[0].step, spikes[0].round_trip_ns), (99, 50_000));
    }

    #[test]
    fn a_release_can_be_late_only_if_it_was_due() {
        let mut lockstep = Latency::new(false);
        let mut paced = Latency::new(true);
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
    fn a_release_that_was_exactly_on_time_counts() {
        let mut paced = Latency::new(true);
        for step in 0..100 {
            paced.take(step, &timing(1000, 400, 5 * (step % 2)));
        }
        let release = paced.summary().legs.release.expect("paced");
        assert_eq!((release.count, release.p50, release.max), (100, 0, 5));
    }

    #[test]
    fn a_step_without_a_command_keeps_its_release_and_its_integration() {
        let mut paced = Latency::new(true);
        for step in 0..990 {
            paced.take(step, &timing(1000, 400, 20));
        }
        // The ten worst: late, after a long integration, and without a command in time.
        for step in 990..1000 {
            let missed = Timing {
                held_steps: step - 989,
                plant_ns: 6_000_001,
                ..timing(0, 0, 7_000_003)
            };
            paced.take(step, &missed);
        }
        let LatencySummary {
            legs,
            spikes,
            late_releases,
            grade,
        } = paced.summary();
        assert_eq!((legs.round_trip.count, legs.without_command), (990, 10));
        assert_eq!((legs.plant.count, legs.plant.max), (1000, 6_000_001));
        let release = legs.release.expect("paced");
        assert_eq!((release.count, release.max), (1000, 7_000_003));
        assert_eq!((release.p99, release.p999), (20, 7_000_003));
        assert_eq!(spikes[0].round_trip_ns, 1000);
        assert_eq!((late_releases[0].step, late_releases.len()), (990, 10));
        let grade = grade.expect("steps were exchanged");
        assert_eq!((grade.leg, grade.p9999_ns), (Leg::Release, 7_000_003));
        assert_eq!(paced.steps(), 1000);
    }

    #[test]
    fn without_an_exchange_there_is_no_grade() {
        let summary = Latency::new(true).summary();
        assert_eq!((summary.grade, summary.spikes.len()), (None, 0));
        assert_eq!(summary.legs.round_trip, Percentiles::default());
    }
}
