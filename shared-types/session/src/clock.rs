//! The monotonic clock, read by the engine's and runner's meters and by waits; never by a model or
//! a law.

use rustix::time::{ClockId, clock_gettime};

/// Nanoseconds of the machine's monotonic clock; comparable between processes.
#[must_use]
#[inline]
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}
