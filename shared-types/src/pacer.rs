//! The pacer: when a step may begin.
//!
//! A pure function of the step; the engine compares it with the monotonic clock. In lockstep a step
//! begins at once. Paced, it begins on a fixed grid of the monotonic clock: a late step does not
//! move the grid, the following ones catch up, and nothing is skipped.

use crate::time::{Rate, Step};

/// Makes the release time of every step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pacer {
    rate: Rate,
    grid: Option<Grid>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Grid {
    /// When the first step on this grid may begin.
    start_ns: u64,
    first: Step,
    factor: f64,
}

impl Pacer {
    /// Every step is released at once.
    #[must_use]
    pub const fn lockstep(rate: Rate) -> Self {
        Self { rate, grid: None }
    }

    /// Step 0 is released at `start_ns` and simulated time runs `factor` times as fast as the clock.
    #[must_use]
    pub const fn paced(rate: Rate, start_ns: u64, factor: f64) -> Self {
        Self {
            rate,
            grid: Some(Grid {
                start_ns,
                first: Step(0),
                factor,
            }),
        }
    }

    /// The same pace from a step on that may begin at `now_ns`: what was held is not caught up.
    #[must_use]
    pub fn resumed(self, step: Step, now_ns: u64) -> Self {
        let from_here = |grid: Grid| Grid {
            start_ns: now_ns,
            first: step,
            ..grid
        };
        Self {
            grid: self.grid.map(from_here),
            ..self
        }
    }

    /// When a step may begin, in ns of the monotonic clock; 0 for at once.
    #[must_use]
    pub fn release_ns(&self, step: Step) -> u64 {
        match self.grid {
            None => 0,
            Some(grid) => {
                let since_ns = self.rate.nanoseconds(step) - self.rate.nanoseconds(grid.first);
                grid.start_ns + (since_ns as f64 / grid.factor + 0.5) as u64
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate(hz: f64) -> Rate {
        Rate::new(hz).expect("legal")
    }

    #[test]
    fn lockstep_never_holds_a_step_back() {
        assert_eq!(Pacer::lockstep(rate(10.0)).release_ns(Step(1_000_000)), 0);
    }

    #[test]
    fn the_grid_does_not_drift_in_an_hour() {
        let pacer = Pacer::paced(rate(10_000.0), 77, 1.0);
        for step in [0, 1, 2, 9_999, 36_000_000] {
            assert_eq!(pacer.release_ns(Step(step)), 77 + step * 100_000);
        }
        let third = Pacer::paced(rate(3.0), 0, 1.0);
        assert_eq!(third.release_ns(Step(3 * 3600)), 3_600_000_000_000);
    }

    #[test]
    fn a_resumed_run_goes_on_at_its_pace_from_where_it_was_held() {
        let pacer = Pacer::paced(rate(1000.0), 7, 2.0).resumed(Step(100), 5_000);
        assert_eq!(pacer.release_ns(Step(100)), 5_000);
        assert_eq!(pacer.release_ns(Step(110)), 5_005_000);
        let lockstep = Pacer::lockstep(rate(1000.0)).resumed(Step(100), 5_000);
        assert_eq!(lockstep.release_ns(Step(110)), 0);
    }

    #[test]
    fn a_factor_stretches_or_shrinks_the_grid() {
        assert_eq!(
            Pacer::paced(rate(1000.0), 0, 2.0).release_ns(Step(10)),
            5_000_000
        );
        assert_eq!(
            Pacer::paced(rate(1000.0), 0, 0.5).release_ns(Step(10)),
            20_000_000
        );
    }
}
