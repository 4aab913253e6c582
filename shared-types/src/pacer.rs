//! The pacer: the start time of each step, the deadline of its command, and the fate of the grid when the plant falls
//! behind.
//!
//! In lockstep a step begins at once. Otherwise each step begins on a grid of the monotonic clock that is computed from
//! the step number, so that no error accumulates. The engine passes the current time to the pacer, which never reads a
//! clock.

use serde::{Deserialize, Serialize};

use crate::time::{Rate, Step};

/// Policy for an overrun: a step that is due before the previous step is done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OverrunPolicy {
    /// Keep the grid. Late steps begin at once, one after the other, until none is late.
    #[default]
    CatchUp,
    /// Keep the grid; the late step begins at the next grid point. Simulated time loses whole periods, and every step
    /// gets a full period.
    Skip,
    /// Shift the grid: the late step begins at once, and simulated time loses the delay.
    Stretch,
    /// End the run.
    Abort,
}

impl OverrunPolicy {
    /// All policies.
    pub const ALL: [Self; 4] = [Self::CatchUp, Self::Skip, Self::Stretch, Self::Abort];

    /// Returns the name in a scenario.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::CatchUp => "catch-up",
            Self::Skip => "skip",
            Self::Stretch => "stretch",
            Self::Abort => "abort",
        }
    }
}

/// Counts of the steps at which some event occurred.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Streaks {
    /// Number of steps.
    pub count: u64,
    /// Longest unbroken sequence.
    pub longest: u64,
    /// First step.
    pub first_step: Option<u64>,
    /// Last step of a sequence, and the sequence's length up to that step.
    #[serde(skip)]
    last: Option<(u64, u64)>,
}

impl Streaks {
    /// Counts a step at which the event occurred; the steps must be in order.
    pub fn note(&mut self, step: Step) {
        let before = match self.last {
            Some((last, before)) if last + 1 == step.0 => before + 1,
            _ => 0,
        };
        self.last = Some((step.0, before));
        self.count += 1;
        if before >= self.longest {
            self.longest = before + 1;
        }
        self.first_step.get_or_insert(step.0);
    }
}

/// Computes the release time of every step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pacer {
    rate: Rate,
    policy: OverrunPolicy,
    /// `None` in lockstep.
    grid: Option<Grid>,
    /// Next step, if its release time was already requested and its overrun was handled.
    seen: Option<Step>,
    overruns: Streaks,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Grid {
    /// Time at which the first step on this grid may begin.
    start_ns: u64,
    first: Step,
    factor: f64,
}

impl Grid {
    /// Returns the time at which a step is due, even a step before the first one on this grid: a late answer may belong
    /// to one.
    fn due_ns(&self, rate: Rate, step: Step) -> u64 {
        let (step_ns, first_ns) = (rate.nanoseconds(step), rate.nanoseconds(self.first));
        let away_ns = (step_ns.abs_diff(first_ns) as f64 / self.factor + 0.5) as u64;
        if step_ns < first_ns {
            self.start_ns.saturating_sub(away_ns)
        } else {
            self.start_ns + away_ns
        }
    }
}

/// Overrun under the policy to end the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "step {step} was due {:.3} ms before the previous step was done, and the overrun policy is `abort`",
    *late_ns as f64 / 1e6
)]
pub struct Overrun {
    /// The step.
    pub step: Step,
    /// Delay of the step, in ns.
    pub late_ns: u64,
}

impl Pacer {
    /// Creates a pacer that releases every step at once.
    #[must_use]
    pub const fn lockstep(rate: Rate) -> Self {
        Self {
            rate,
            policy: OverrunPolicy::CatchUp,
            grid: None,
            seen: None,
            overruns: Streaks {
                count: 0,
                longest: 0,
                first_step: None,
                last: None,
            },
        }
    }

    /// Creates a pacer that releases step 0 at `start_ns` and runs simulated time `factor` times as fast as the clock.
    #[must_use]
    pub const fn paced(rate: Rate, start_ns: u64, factor: f64, policy: OverrunPolicy) -> Self {
        Self {
            policy,
            grid: Some(Grid {
                start_ns,
                first: Step(0),
                factor,
            }),
            ..Self::lockstep(rate)
        }
    }

    /// Re-anchors the grid such that `step` was due at `due_ns`.
    pub const fn anchor(&mut self, step: Step, due_ns: u64) {
        if let Some(grid) = &mut self.grid {
            grid.start_ns = due_ns;
            grid.first = step;
        }
    }

    /// Delays all further steps by the duration of the hold.
    pub const fn delay(&mut self, held_ns: u64) {
        if let Some(grid) = &mut self.grid {
            grid.start_ns += held_ns;
        }
    }

    /// Returns the time at which a step may begin, in ns of the monotonic clock; 0 for at once. Call it when the
    /// previous step is done: a step that is already due is an overrun.
    ///
    /// # Errors
    /// If the step is an overrun and the policy is to end the run.
    #[inline]
    pub fn release_ns(&mut self, step: Step, now_ns: u64) -> Result<u64, Overrun> {
        let Some(grid) = self.grid else {
            return Ok(0);
        };
        let due_ns = grid.due_ns(self.rate, step);
        if self.seen.replace(step) == Some(step) || now_ns <= due_ns {
            return Ok(due_ns);
        }
        self.overruns.note(step);
        let late_ns = now_ns - due_ns;
        match self.policy {
            OverrunPolicy::CatchUp => {}
            OverrunPolicy::Stretch => self.anchor(step, now_ns),
            OverrunPolicy::Skip => {
                let period_ns = 1e9 * self.rate.period_s() / grid.factor;
                let periods = libm::ceil(late_ns as f64 / period_ns);
                self.anchor(step, due_ns + (periods * period_ns + 0.5) as u64);
            }
            OverrunPolicy::Abort => return Err(Overrun { step, late_ns }),
        }
        Ok(self.due_ns(step))
    }

    /// Returns the time at which a step is due; 0 in lockstep.
    #[must_use]
    #[inline]
    pub fn due_ns(&self, step: Step) -> u64 {
        self.grid.map_or(0, |grid| grid.due_ns(self.rate, step))
    }

    /// Returns the end of a given share of a step's period; never in lockstep.
    #[must_use]
    #[inline]
    pub fn deadline_ns(&self, step: Step, share: f64) -> u64 {
        let Some(grid) = self.grid else {
            return u64::MAX;
        };
        let period_ns = 1e9 * self.rate.period_s() / grid.factor;
        grid.due_ns(self.rate, step) + (share * period_ns + 0.5) as u64
    }

    /// Returns the counts of overruns.
    #[must_use]
    pub const fn overruns(&self) -> Streaks {
        self.overruns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate(hz: f64) -> Rate {
        Rate::new(hz).expect("legal")
    }

    fn paced(hz: f64, start_ns: u64, policy: OverrunPolicy) -> Pacer {
        Pacer::paced(rate(hz), start_ns, 1.0, policy)
    }

    #[test]
    fn lockstep_never_delays_a_step() {
        let mut pacer = Pacer::lockstep(rate(10.0));
        assert_eq!(pacer.release_ns(Step(1_000_000), 5), Ok(0));
        assert_eq!(pacer.deadline_ns(Step(7), 0.5), u64::MAX);
        assert_eq!(pacer.overruns(), Streaks::default());
    }

    #[test]
    fn a_step_before_the_grid_moved_keeps_its_distance() {
        for policy in [OverrunPolicy::Skip, OverrunPolicy::Stretch] {
            let mut pacer = paced(1000.0, 10_000_000, policy);
            assert_eq!(pacer.release_ns(Step(3), 16_000_000), Ok(16_000_000));
            assert_eq!(pacer.due_ns(Step(1)), 14_000_000);
        }
        let early = paced(1000.0, 500, OverrunPolicy::CatchUp);
        let moved = Pacer {
            grid: early.grid.map(|grid| Grid {
                first: Step(7),
                ..grid
            }),
            ..early
        };
        assert_eq!(moved.due_ns(Step(1)), 0);
    }

    #[test]
    fn the_grid_does_not_drift_in_an_hour() {
        let pacer = paced(10_000.0, 77, OverrunPolicy::CatchUp);
        for step in [0, 1, 2, 9_999, 36_000_000] {
            assert_eq!(pacer.due_ns(Step(step)), 77 + step * 100_000);
        }
        let third = paced(3.0, 0, OverrunPolicy::CatchUp);
        assert_eq!(third.due_ns(Step(3 * 3600)), 3_600_000_000_000);
    }

    /// An hour at 1 kHz on a simulated clock: each step wakes up late, works for a while, and occasionally takes far
    /// too long. Step n of N begins where the grid puts it, regardless of earlier delays.
    #[test]
    fn an_hour_of_late_wake_ups_and_long_steps_leaves_the_grid_where_it_was() {
        let (mut pacer, mut now_ns) = (paced(1000.0, 500, OverrunPolicy::CatchUp), 500);
        let mut seed = 1_u64;
        let mut random = |below: u64| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 33) % below
        };
        let (mut late_sum_ns, mut catching_up) = (0, 0);
        for step in 0..3_600_000 {
            let due_ns = 500 + step * 1_000_000;
            assert_eq!(pacer.release_ns(Step(step), now_ns), Ok(due_ns));
            catching_up += u64::from(now_ns > due_ns);
            now_ns = if now_ns > due_ns {
                now_ns
            } else {
                due_ns + random(80_000)
            };
            late_sum_ns += now_ns - due_ns;
            now_ns += if random(10_000) == 0 {
                7_300_000
            } else {
                random(600_000)
            };
        }
        assert!(now_ns >= 500 + 3_599_999 * 1_000_000);
        assert!(late_sum_ns / 3_600_000 < 100_000, "it is not late for ever");
        assert_eq!(pacer.overruns().count, catching_up);
        assert!(pacer.overruns().longest >= 7);
    }

    #[test]
    fn each_policy_handles_a_late_step_as_documented() {
        // Steps of 1 ms; step 1 is done at 5.25 ms, so that step 2 is 3.25 ms late.
        let table = [
            (OverrunPolicy::CatchUp, Ok(2_000_000), 3_000_000),
            (OverrunPolicy::Skip, Ok(6_000_000), 7_000_000),
            (OverrunPolicy::Stretch, Ok(5_250_000), 6_250_000),
            (
                OverrunPolicy::Abort,
                Err(Overrun {
                    step: Step(2),
                    late_ns: 3_250_000,
                }),
                3_000_000,
            ),
        ];
        for (policy, release_ns, next_ns) in table {
            let mut pacer = paced(1000.0, 0, policy);
            assert_eq!(pacer.release_ns(Step(1), 900_000), Ok(1_000_000));
            assert_eq!(
                pacer.release_ns(Step(2), 5_250_000),
                release_ns,
                "{policy:?}"
            );
            assert_eq!(pacer.due_ns(Step(3)), next_ns, "{policy:?}");
            let overruns = pacer.overruns();
            assert_eq!((overruns.count, overruns.first_step), (1, Some(2)));
        }
    }

    #[test]
    fn a_step_that_is_requested_again_counts_as_late_once() {
        let mut pacer = paced(1000.0, 0, OverrunPolicy::Stretch);
        assert_eq!(pacer.release_ns(Step(1), 900_000), Ok(1_000_000));
        // The wait for it ended late: it begins late, which is no overrun.
        assert_eq!(pacer.release_ns(Step(1), 1_200_000), Ok(1_000_000));
        assert_eq!(pacer.overruns().count, 0);
    }

    #[test]
    fn streaks_are_counted() {
        let mut streaks = Streaks::default();
        for step in [3, 4, 9, 10, 11, 12, 20] {
            streaks.note(Step(step));
        }
        let Streaks {
            count,
            longest,
            first_step,
            ..
        } = streaks;
        assert_eq!((count, longest, first_step), (7, 4, Some(3)));
    }

    #[test]
    fn a_run_resumes_its_pace_after_a_hold() {
        let mut pacer = Pacer::paced(rate(1000.0), 7, 2.0, OverrunPolicy::Abort);
        // Step 100 is due at 50 ms; it is held from 49.9 ms to 60 ms, with 0.1 ms left to wait.
        assert_eq!(pacer.release_ns(Step(100), 49_900_007), Ok(50_000_007));
        pacer.delay(10_100_000);
        assert_eq!(pacer.release_ns(Step(100), 60_000_007), Ok(60_100_007));
        assert_eq!(pacer.release_ns(Step(101), 60_100_008), Ok(60_600_007));
        assert_eq!(pacer.deadline_ns(Step(101), 0.8), 61_000_007);
        assert_eq!(pacer.overruns().count, 0);
        let mut lockstep = Pacer::lockstep(rate(1000.0));
        lockstep.delay(5_000);
        assert_eq!(lockstep.release_ns(Step(110), 9), Ok(0));
    }

    #[test]
    fn a_factor_stretches_or_shrinks_the_grid() {
        let due_ns =
            |factor| Pacer::paced(rate(1000.0), 0, factor, OverrunPolicy::CatchUp).due_ns(Step(10));
        assert_eq!((due_ns(2.0), due_ns(0.5)), (5_000_000, 20_000_000));
    }
}
