//! Speed of a run and round-trip times over the last seconds.
//!
//! Fed with the timing of every record by the [model](super::model). Uses only the clock of the records, so that a
//! burst that arrives late does not count as speed.

use std::collections::VecDeque;

use hil_facts::results::latency::percentiles::Percentiles;
use hil_facts::results::latency::times::Times;
use shared_types::record::Timing;

/// Time window of the speed in ns.
const SPEED_NS: u64 = 2_000_000_000;
/// Interval between two stored samples in ns.
const KEPT_NS: u64 = 50_000_000;
/// Time window of the percentiles in s.
pub(crate) const SECONDS: u64 = 5;
/// Significant digits of the percentiles; few, because they are summed for each frame.
const DIGITS: u8 = 2;

/// Recent timing of a run.
pub(crate) struct Pace {
    /// Recent samples as pairs of time in ns and step.
    moments: VecDeque<(u64, u64)>,
    newest: Option<(u64, u64)>,
    /// Round trips of each of the last seconds, stored at the second modulo their count.
    seconds: Vec<(u64, Times)>,
    /// Number of observed steps whose command did not arrive in time.
    pub held: u64,
}

impl Default for Pace {
    fn default() -> Self {
        Self {
            moments: VecDeque::new(),
            newest: None,
            seconds: (0..SECONDS)
                .map(|_| (0, Times::with_digits(DIGITS)))
                .collect(),
            held: 0,
        }
    }
}

impl Pace {
    /// Adds the timing of a step.
    pub(crate) fn take(&mut self, step: u64, timing: &Timing) {
        let now_ns = timing.published_ns;
        self.newest = Some((now_ns, step));
        let last_ns = self.moments.back().map_or(0, |moment| moment.0);
        if now_ns.saturating_sub(last_ns) >= KEPT_NS {
            self.moments.push_back((now_ns, step));
            while (self.moments.front()).is_some_and(|first| first.0 + SPEED_NS < now_ns) {
                self.moments.pop_front();
            }
        }
        self.held += u64::from(timing.held_steps > 0);
        if timing.round_trip_ns == 0 {
            return; // no exchange in this step
        }
        let second = now_ns / 1_000_000_000;
        let (of, times) = &mut self.seconds[(second % SECONDS) as usize];
        if *of != second {
            *of = second;
            times.reset();
        }
        times.record(timing.round_trip_ns);
    }

    /// Returns the steps per second; 0 if the newest step is a second old, `None` before there are two samples.
    pub(crate) fn steps_per_s(&self, now_ns: u64) -> Option<f64> {
        let (first, newest) = (self.moments.front()?, self.newest?);
        if newest.0 + 1_000_000_000 < now_ns {
            return Some(0.0);
        }
        let spent_s = newest.0.checked_sub(first.0).filter(|ns| *ns > 0)? as f64 / 1e9;
        Some((newest.1 - first.1) as f64 / spent_s)
    }

    /// Returns percentiles of the round trips in the time window; `None` if there are none.
    pub(crate) fn round_trips(&self) -> Option<Percentiles> {
        let newest = self.seconds.iter().map(|(second, _)| *second).max()?;
        let mut all = Times::with_digits(DIGITS);
        for (second, times) in &self.seconds {
            if *second + SECONDS > newest {
                all.add(times);
            }
        }
        (!all.is_empty()).then(|| Percentiles::of(&all))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timing(published_ns: u64, round_trip_ns: u64) -> Timing {
        Timing {
            published_ns,
            round_trip_ns,
            ..Timing::default()
        }
    }

    #[test]
    fn speed_covers_the_last_two_seconds_by_the_records_clock() {
        let mut pace = Pace::default();
        assert_eq!(pace.steps_per_s(0), None);
        let begin_ns = 7_000_000_000;
        // 1 kHz for three seconds, then 10 kHz for three seconds.
        let mut now_ns = begin_ns;
        for step in 0..33_000 {
            pace.take(step, &timing(now_ns, 100));
            now_ns += if step < 3000 { 1_000_000 } else { 100_000 };
        }
        let speed = pace.steps_per_s(now_ns).expect("moments");
        assert!((speed - 10_000.0).abs() < 10.0, "{speed}");
        assert_eq!(pace.steps_per_s(now_ns + 1_100_000_000), Some(0.0));
    }

    #[test]
    fn percentiles_ignore_round_trips_older_than_five_seconds() {
        let mut pace = Pace::default();
        assert_eq!(pace.round_trips(), None);
        pace.take(0, &timing(1_000_000_000, 900));
        pace.take(1, &timing(4_000_000_000, 100));
        pace.take(2, &timing(5_500_000_000, 0));
        let both = pace.round_trips().expect("two");
        assert_eq!((both.count, both.p50, both.max), (2, 100, 900));
        pace.take(3, &timing(6_000_000_000, 100));
        let newer = pace.round_trips().expect("two");
        assert_eq!((newer.count, newer.max), (2, 100));
    }

    #[test]
    fn held_commands_are_counted() {
        let mut pace = Pace::default();
        let late = Timing {
            held_steps: 2,
            ..timing(1, 1)
        };
        pace.take(0, &timing(1, 1));
        pace.take(1, &late);
        assert_eq!(pace.held, 1);
    }
}
