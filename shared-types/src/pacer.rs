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
    start_ns: u64,
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
            grid: Some(Grid { start_ns, factor }),
        }
    }

    /// When a step may begin, in ns of the monotonic clock; 0 for at once.
    #[must_use]
    pub fn release_ns(&self, step: Step) -> u64 {
        match self.grid {
            None => 0,
            Some(Grid { start_ns, factor }) => {
                start_ns + (self.rate.nanoseconds(step) as f64 / factor + 0.5) as u64
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
