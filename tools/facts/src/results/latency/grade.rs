//! Latency grades, in the terms and limits common among LinuxCNC users.

use std::fmt;

use hil_console::terminal::duration::shown_ns;
use serde::Serialize;

use super::times::Times;

/// Limit in ns below which a loop is graded excellent and a machine's longest delay is graded good.
pub const EXCELLENT_BELOW_NS: u64 = 20_000;
/// Limit in ns below which a loop is graded good and a machine's longest delay is graded fair.
pub const GOOD_BELOW_NS: u64 = 50_000;
/// Limit in ns above which a machine is unfit for real time.
pub const UNFIT_NS: u64 = 500_000;

/// Grade of a loop by its latency.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Grade {
    /// Below 20 us.
    Excellent,
    /// Below 50 us.
    Good,
    /// Up to 500 us.
    Usable,
    /// Above 500 us: unfit for servo loops.
    Unfit,
}

impl Grade {
    /// Returns the grade of a latency.
    pub(crate) const fn of(ns: u64) -> Self {
        match ns {
            0..EXCELLENT_BELOW_NS => Self::Excellent,
            EXCELLENT_BELOW_NS..GOOD_BELOW_NS => Self::Good,
            GOOD_BELOW_NS..=UNFIT_NS => Self::Usable,
            _ => Self::Unfit,
        }
    }

    /// Returns the grade in words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Excellent => "excellent",
            Self::Good => "good",
            Self::Usable => "usable",
            Self::Unfit => "unfit for servo loops",
        }
    }
}

/// Grade with the figure behind it: the 99.99th percentile of the round trip or, if worse, of the release.
/// A step without a command ranks above all round trips, because it waited longer than any command that arrived in its
/// time.
/// The maximum is not used: it is a single step, grows with the length of a run, and is caused by the hypervisor on a
/// virtual machine. The 99th percentile is not used either, because it hides a hundred steps per second at 10 kHz.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Graded {
    /// Grade of the loop.
    pub grade: Grade,
    /// Leg that determined the grade.
    pub leg: Leg,
    /// 99.99th percentile in ns.
    pub p9999_ns: u64,
}

/// Leg that can determine the grade.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Leg {
    /// From sending a sample to receiving its command.
    RoundTrip,
    /// From the due time of a sample to its sending.
    Release,
}

impl Graded {
    /// Grades steps by their round trips, the number of steps without a command, and their releases; `None` if no
    /// command arrived.
    pub(crate) fn of(round_trip: &Times, without_command: u64, release: &Times) -> Option<Self> {
        const SHARE: f64 = 0.9999;
        let round_trip_ns = round_trip.at_quantile_with_longer(SHARE, without_command);
        let release_ns = release.at_quantile(SHARE);
        let (leg, p9999_ns) = match release_ns > round_trip_ns {
            true => (Leg::Release, release_ns),
            false => (Leg::RoundTrip, round_trip_ns),
        };
        (!round_trip.is_empty()).then(|| Self {
            grade: Grade::of(p9999_ns),
            leg,
            p9999_ns,
        })
    }
}

impl fmt::Display for Graded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let leg = match self.leg {
            Leg::RoundTrip => "round trip",
            Leg::Release => "release",
        };
        let (words, figure) = (self.grade.words(), shown_ns(self.p9999_ns));
        write!(f, "{words} (99.99 % of the {leg}: {figure})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(times_ns: impl IntoIterator<Item = u64>) -> Times {
        let mut all = Times::default();
        for ns in times_ns {
            all.record(ns);
        }
        all
    }

    #[test]
    fn the_limits_are_20_50_and_500_us() {
        for (ns, grade) in [
            (0, Grade::Excellent),
            (19_999, Grade::Excellent),
            (20_000, Grade::Good),
            (49_999, Grade::Good),
            (50_000, Grade::Usable),
            (500_000, Grade::Usable),
            (500_001, Grade::Unfit),
        ] {
            assert_eq!(Grade::of(ns), grade, "{ns} ns");
        }
    }

    #[test]
    fn the_worse_of_round_trip_and_release_decides() {
        let of = |round_trip_ns: u64, release_ns: Option<u64>| {
            let graded = Graded::of(&times([round_trip_ns]), 0, &times(release_ns));
            let graded = graded.expect("graded");
            (graded.grade, graded.leg)
        };
        assert_eq!(of(7_000, None), (Grade::Excellent, Leg::RoundTrip));
        assert_eq!(of(7_000, Some(60_000)), (Grade::Usable, Leg::Release));
        assert_eq!(of(30_000, Some(2_000)), (Grade::Good, Leg::RoundTrip));
        let text = Graded::of(&times([600_000]), 0, &times([]))
            .expect("graded")
            .to_string();
        assert_eq!(
            text,
            "unfit for servo loops (99.99 % of the round trip: 600 us)"
        );
    }

    #[test]
    fn one_step_in_ten_thousand_does_not_affect_the_grade_but_two_without_a_command_do() {
        // One of 20,000 commands arrived 40 ms late, after steps without one.
        let round_trips = times((1..20_000).map(|_| 1_000).chain([40_000_000]));
        let of = |without_command| {
            let graded = Graded::of(&round_trips, without_command, &times([]));
            graded.expect("graded").grade
        };
        assert_eq!((of(0), of(1)), (Grade::Excellent, Grade::Excellent));
        assert_eq!((of(2), of(39)), (Grade::Unfit, Grade::Unfit));
        assert_eq!(Graded::of(&times([]), 5, &times([1])), None);
    }
}
