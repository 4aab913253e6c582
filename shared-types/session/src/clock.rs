//! The monotonic clock, read by waits and by the meters of engine and runner; never by a model or a law.

use rustix::time::{ClockId, clock_gettime};

/// Returns the machine's monotonic clock in nanoseconds, comparable between processes.
#[must_use]
#[inline]
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}
