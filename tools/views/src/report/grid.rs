//! Grid of simulated time shared by all envelopes of a report.
//!
//! Buckets are equally long where nothing happens and become shorter towards a time of interest, down to one step:
//! zooming in on a fault shows every step, and the file remains small. Times are nanoseconds, so runs of different
//! rates share one grid.

use std::ops::Range;

use shared_types::time::{Rate, Step};

/// Number of evenly spaced buckets of a run.
const EVEN: u64 = 2000;
/// Additional buckets for all times of interest together.
const NEAR: u64 = 6000;
/// Maximum number of times of interest with additional buckets.
const MOST_TIMES: usize = 64;

/// Buckets of simulated time; each begins at an edge and ends before the next one.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Grid {
    /// Edges in ns, increasing.
    edges_ns: Vec<u64>,
}

impl Grid {
    /// Returns the number of steps in an evenly spaced bucket of a run that ends at step `last`.
    pub(crate) const fn even(last: Step) -> u64 {
        (last.0 + 1).div_ceil(EVEN)
    }

    /// Creates the grid for runs of which the longest ends at step `last`, with times of interest, the most
    /// interesting first.
    pub(crate) fn new(rate: Rate, last: Step, times_ns: &[u64]) -> Self {
        let steps = last.0 + 1;
        let longest = Self::even(last);
        let mut near: Vec<u64> = Vec::new();
        for time_ns in times_ns {
            let step = rate.step_at_or_after(*time_ns as f64 / 1e9).0;
            if near.len() < MOST_TIMES && step <= last.0 && !near.contains(&step) {
                near.push(step);
            }
        }
        near.sort_unstable();
        // A bucket at distance d has d / fineness steps, so there are fineness (1 + ln longest) on each side.
        let per_side = 1.0 + libm::log(longest as f64);
        let fineness = NEAR as f64 / (2.0 * near.len().max(1) as f64 * per_side);
        let fineness = (fineness as u64).clamp(4, 400);
        let mut edges_ns = Vec::new();
        let (mut step, mut next) = (0, 0);
        while step < steps {
            edges_ns.push(rate.nanoseconds(Step(step)));
            while near.get(next).is_some_and(|time| *time < step) {
                next += 1;
            }
            let before = next.checked_sub(1).map(|last| step - near[last]);
            let after = near.get(next).map(|time| time - step);
            let distance = before.into_iter().chain(after).min();
            let length =
                distance.map_or(longest, |distance| (distance / fineness).clamp(1, longest));
            // Every time of interest starts a bucket.
            let until = after.filter(|after| *after > 0).unwrap_or(length);
            step += until.min(length);
        }
        Self { edges_ns }
    }

    /// Returns the number of buckets.
    pub(crate) fn len(&self) -> usize {
        self.edges_ns.len()
    }

    /// Returns the bucket of a time, searching from bucket `from` on.
    pub(crate) fn bucket(&self, from: usize, time_ns: u64) -> usize {
        let mut bucket = from;
        while (self.edges_ns.get(bucket + 1)).is_some_and(|edge| *edge <= time_ns) {
            bucket += 1;
        }
        bucket
    }

    /// Returns a first and a last step between which all steps of some buckets are, in a run that ends at step `last`.
    pub(crate) fn span(&self, buckets: Range<usize>, rate: Rate, last: Step) -> [Step; 2] {
        let step = |bucket: usize| match self.edges_ns.get(bucket) {
            Some(ns) => rate.step_at_or_after(*ns as f64 / 1e9),
            None => last,
        };
        // Nanoseconds are rounded.
        let before = step(buckets.start).0.saturating_sub(1);
        [Step(before), Step((step(buckets.end).0 + 1).min(last.0))]
    }

    /// Returns the starts of the buckets in s.
    pub(crate) fn starts_s(&self) -> Vec<f64> {
        self.edges_ns.iter().map(|ns| *ns as f64 / 1e9).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate() -> Rate {
        Rate::new(10_000.0).expect("a rate")
    }

    #[test]
    fn every_step_has_one_bucket_and_there_are_not_too_many() {
        for times in [
            vec![],
            vec![7_000_000_000],
            (0..100).map(|i| i * 190_000_000).collect(),
        ] {
            let grid = Grid::new(rate(), Step(200_000), &times);
            assert!(grid.len() <= (EVEN + 2 * NEAR) as usize, "{}", grid.len());
            assert!(grid.edges_ns.is_sorted_by(|a, b| a < b));
            let mut bucket = 0;
            for step in 0..=200_000 {
                let time_ns = rate().nanoseconds(Step(step));
                bucket = grid.bucket(bucket, time_ns);
                assert!(grid.edges_ns[bucket] <= time_ns);
                assert!(
                    grid.edges_ns
                        .get(bucket + 1)
                        .is_none_or(|edge| time_ns < *edge)
                );
            }
            assert_eq!(bucket, grid.len() - 1);
        }
    }

    #[test]
    fn near_a_fault_every_step_is_a_bucket() {
        let grid = Grid::new(rate(), Step(200_000), &[7_000_000_000]);
        for step in 69_600..=70_400 {
            let time_ns = rate().nanoseconds(Step(step));
            assert!(grid.edges_ns.contains(&time_ns), "step {step}");
        }
        let far = grid
            .edges_ns
            .iter()
            .filter(|edge| **edge > 15_000_000_000)
            .count();
        // 200,001 steps in at most 2000 buckets are 101 to each.
        assert_eq!(far, 50_000 / 101);
    }

    #[test]
    fn a_short_run_is_shown_step_by_step() {
        let grid = Grid::new(rate(), Step(1500), &[]);
        assert_eq!(grid.len(), 1501);
        assert_eq!(Grid::new(rate(), Step(0), &[0]).starts_s(), [0.0]);
    }
}
