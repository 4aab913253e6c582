//! Waiting for the other side: fast when it is quick, kind to the machine when it is not, and
//! bounded always.
//!
//! Poll 64 times, then give the core away after each poll (at once if there is only one core, where
//! pure spinning costs a scheduler slice a step), then sleep in naps, longer ones the longer nothing
//! came. The clock is read only from the first yield on, so a ready peer costs no system call.

use std::num::NonZero;
use std::time::Duration;

use crate::clock::monotonic_ns;

/// Polls before the first yield when there is more than one core.
const SPINS: u32 = 64;
/// How long to yield before napping.
const YIELD_NS: u64 = 2_000_000;
/// Length of a nap.
const NAP: Duration = Duration::from_micros(100);
/// How long to wait before naps become long: by then one costs a twentieth of the wait at most.
const NAP_NS: u64 = 20_000_000;
/// Length of a long nap.
const LONG_NAP: Duration = Duration::from_millis(1);

/// How long a peer that lives may take, the scenario's and command line's `wait_limit`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaitLimit {
    ns: u64,
}

impl WaitLimit {
    /// A limit in seconds; infinity for no limit.
    #[must_use]
    pub fn from_seconds(limit_s: f64) -> Self {
        // The cast saturates: beyond 584 years is for ever.
        Self {
            ns: (limit_s * 1e9) as u64,
        }
    }

    /// The limit in ns.
    #[must_use]
    pub const fn ns(self) -> u64 {
        self.ns
    }

    /// The limit in ms.
    #[must_use]
    pub const fn ms(self) -> u64 {
        self.ns / 1_000_000
    }
}

/// One wait after another.
#[derive(Debug)]
pub struct Waiter {
    limit: WaitLimit,
    spins: u32,
    polls: u32,
    /// When this wait began.
    since_ns: u64,
    /// Since when the limit counts.
    limited_ns: u64,
}

impl Waiter {
    /// A waiter for the cores that this process may run on.
    #[must_use]
    pub fn new(limit: WaitLimit) -> Self {
        let cores = std::thread::available_parallelism().map_or(1, NonZero::get);
        let spins = if cores > 1 { SPINS } else { 0 };
        Self {
            limit,
            spins,
            polls: 0,
            since_ns: 0,
            limited_ns: 0,
        }
    }

    /// The same thing is still awaited, with the whole limit before it.
    pub fn renew(&mut self) {
        self.limited_ns = monotonic_ns();
    }

    /// What was awaited came; the next wait begins.
    pub const fn done(&mut self) {
        self.polls = 0;
        self.since_ns = 0;
    }

    /// Waits a moment before the next poll; true when the limit is over.
    #[must_use]
    pub fn pause(&mut self) -> bool {
        if self.polls < self.spins {
            self.polls += 1;
            std::hint::spin_loop();
            return false;
        }
        let now_ns = monotonic_ns();
        if self.since_ns == 0 {
            (self.since_ns, self.limited_ns) = (now_ns, now_ns);
        }
        if now_ns - self.limited_ns >= self.limit.ns {
            return true;
        }
        match now_ns - self.since_ns {
            0..YIELD_NS => std::thread::yield_now(),
            YIELD_NS..NAP_NS => std::thread::sleep(NAP),
            _ => std::thread::sleep(LONG_NAP),
        }
        false
    }
}

impl Waiter {
    /// Waits a moment before the next poll, never beyond this time of the monotonic clock.
    pub fn pause_until(&mut self, deadline_ns: u64) {
        if self.polls < self.spins {
            self.polls += 1;
            std::hint::spin_loop();
        } else if monotonic_ns() < deadline_ns {
            std::thread::yield_now();
        }
    }
}

/// Waits for a time of the monotonic clock: naps until close to it, then spins. `interrupted` is
/// asked between naps and ends the wait early.
pub fn until_ns(target_ns: u64, interrupted: impl Fn() -> bool) {
    /// Wake-ups come this late on an ordinary machine; what is left is spun.
    const EARLY_NS: u64 = 200_000;
    /// No nap is longer, so that an interruption is seen soon.
    const LONGEST_NS: u64 = 20_000_000;
    loop {
        let left_ns = target_ns.saturating_sub(monotonic_ns());
        if left_ns == 0 || interrupted() {
            return;
        }
        if left_ns > EARLY_NS {
            let nap_ns = (left_ns - EARLY_NS).min(LONGEST_NS);
            std::thread::sleep(Duration::from_nanos(nap_ns));
        } else {
            std::hint::spin_loop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wait_ends_at_its_limit() {
        let mut waiter = Waiter::new(WaitLimit::from_seconds(0.01));
        let before_ns = monotonic_ns();
        while !waiter.pause() {}
        assert!(monotonic_ns() - before_ns >= 10_000_000);
    }

    #[test]
    fn an_infinite_limit_does_not_end() {
        let mut waiter = Waiter::new(WaitLimit::from_seconds(f64::INFINITY));
        assert!((0..1000).all(|_| !waiter.pause()));
    }

    #[test]
    fn each_wait_has_the_whole_limit() {
        let mut waiter = Waiter::new(WaitLimit::from_seconds(0.005));
        while !waiter.pause() {}
        waiter.done();
        assert!(!waiter.pause());
    }

    #[test]
    fn a_renewed_wait_has_the_whole_limit_again() {
        let mut waiter = Waiter::new(WaitLimit::from_seconds(0.05));
        while !waiter.pause() {}
        let before_ns = monotonic_ns();
        waiter.renew();
        while !waiter.pause() {}
        assert!(monotonic_ns() - before_ns >= 50_000_000);
    }

    #[test]
    fn a_wait_for_a_time_ends_not_before_it() {
        let target_ns = monotonic_ns() + 1_000_000;
        until_ns(target_ns, || false);
        assert!(monotonic_ns() >= target_ns);
        until_ns(u64::MAX, || true);
    }
}
