//! The latency of a loop: the recorder, or a reader of its recording, puts each step into [`Latency`](legs::Latency); its
//! [`legs`] become [`percentiles`], the ten worst [`spikes`] and a [`grade`] in the summary.

pub(crate) mod grade;
pub(crate) mod legs;
pub(crate) mod percentiles;
pub(crate) mod places;
pub(crate) mod spikes;

use hdrhistogram::Histogram;

/// Longest latency that is told apart: a minute.
const LONGEST_NS: u64 = 60_000_000_000;
/// Significant decimal digits.
const DIGITS: u8 = 3;

/// An empty histogram of latencies.
pub(crate) fn histogram() -> Histogram<u64> {
    Histogram::new_with_bounds(1, LONGEST_NS, DIGITS).expect("the bounds are legal")
}
