//! Waiting for the other side: fast when it is quick, kind to the machine when it is not, and
//! bounded always.
//!
//! | strategy | at first | after 2 ms | after 20 ms |
//! |---|---|---|---|
//! | `hybrid` | poll up to 512 times, then give the core away after each poll | naps of 0.1 ms | naps of 1 ms |
//! | `yield` | give the core away after each poll | the same | naps of 1 ms |
//! | `spin` | poll, never give the core away | the same | naps of 1 ms |
//!
//! When a core that was given away comes back late, somebody else needs it: then a hybrid wait polls
//! 64 times only, and twice as often after each wait, until it happens again.
//!
//! Where both sides share their only core, the other can answer only once this one gives the core
//! away: then nobody spins, whatever the strategy, as pure spinning costs two scheduler slices a step.
//! The clock is not read before the first yield, so a ready peer costs no system call.

use std::num::NonZero;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::clock::monotonic_ns;

/// Polls in a row that read no clock, as long as nobody else needs the core.
const SPINS: u32 = 512;
/// The same where somebody does.
const FEW_SPINS: u32 = 64;
/// A yield that takes so long gave the core to somebody else: to nobody it takes half a microsecond,
/// to the other side a step.
const TAKEN_NS: u64 = 20_000;
/// How long a hybrid wait yields before it naps.
const YIELD_NS: u64 = 2_000_000;
/// Length of a nap.
const NAP_NS: u64 = 100_000;
/// After so long without anything each strategy takes long naps: by then one costs a twentieth of
/// the wait at most, and a held run or a process of real-time priority no longer blocks its core.
const PATIENCE_NS: u64 = 20_000_000;
/// Length of a long nap.
const LONG_NAP_NS: u64 = 1_000_000;
/// A nap may end so much later than asked for on an ordinary machine.
const LATE_NS: u64 = 300_000;

/// What to do between two polls. It moves times and what is left to others, never a result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WaitStrategy {
    /// Poll a little, then give the core away, then nap.
    #[default]
    Hybrid,
    /// Never give the core away: for a core that nobody else needs.
    Spin,
    /// Give the core away after each poll: for cores that are shared.
    Yield,
}

impl WaitStrategy {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Hybrid, Self::Spin, Self::Yield];

    /// Its name in scenarios, on command lines and in summaries.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hybrid => "hybrid",
            Self::Spin => "spin",
            Self::Yield => "yield",
        }
    }
}

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
    strategy: WaitStrategy,
    /// Polls in a row that read no clock.
    spins: u32,
    polls: u32,
    /// When the core was given away last; 0 if it was not in this wait.
    yielded_ns: u64,
    /// When this wait began.
    since_ns: u64,
    /// Since when the limit counts.
    limited_ns: u64,
}

impl Waiter {
    /// A hybrid waiter for the cores that this process may run on.
    #[must_use]
    pub fn new(limit: WaitLimit) -> Self {
        let cores = std::thread::available_parallelism().map_or(1, NonZero::get);
        Self::with(limit, WaitStrategy::Hybrid, cores == 1)
    }

    /// A waiter of this strategy; `shares_core` if the other side can run on no other core.
    #[must_use]
    pub const fn with(limit: WaitLimit, strategy: WaitStrategy, shares_core: bool) -> Self {
        let strategy = if shares_core {
            WaitStrategy::Yield
        } else {
            strategy
        };
        Self {
            limit,
            strategy,
            spins: match strategy {
                WaitStrategy::Hybrid | WaitStrategy::Spin => SPINS,
                WaitStrategy::Yield => 0,
            },
            polls: 0,
            yielded_ns: 0,
            since_ns: 0,
            limited_ns: 0,
        }
    }

    /// How long the other side may take.
    #[must_use]
    pub const fn limit(&self) -> WaitLimit {
        self.limit
    }

    /// The same thing is still awaited, with the whole limit before it.
    #[inline]
    pub fn renew(&mut self) {
        self.limited_ns = monotonic_ns();
    }

    /// What was awaited came; the next wait begins.
    #[inline]
    pub fn done(&mut self) {
        self.polls = 0;
        self.since_ns = 0;
        if self.spins >= FEW_SPINS && self.spins < SPINS {
            self.spins *= 2;
        }
        if self.yielded_ns > 0 {
            // What is awaited may have come while somebody had the core, be it the other side.
            self.back_from_yield(monotonic_ns());
        }
    }

    /// Notes when a core that was given away came back, if it was.
    fn back_from_yield(&mut self, now_ns: u64) {
        let yielded_ns = std::mem::take(&mut self.yielded_ns);
        if self.strategy == WaitStrategy::Hybrid && yielded_ns > 0 && now_ns - yielded_ns > TAKEN_NS
        {
            self.spins = FEW_SPINS;
        }
    }

    /// Waits a moment before the next poll; true when the limit is over.
    #[must_use]
    pub fn pause(&mut self) -> bool {
        self.pause_until(u64::MAX)
    }

    /// Waits a moment before the next poll, but never sleeps past a time of the monotonic clock
    /// that must not be missed; true when the limit is over. Whether that time came is for the
    /// caller to see.
    #[must_use]
    pub fn pause_until(&mut self, deadline_ns: u64) -> bool {
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
        self.back_from_yield(now_ns);
        let nap_ns = self.nap_ns(now_ns, deadline_ns);
        if nap_ns > 0 {
            std::thread::sleep(Duration::from_nanos(nap_ns));
        } else if self.strategy == WaitStrategy::Spin {
            self.polls = 0; // the clock again after as many polls
        } else {
            self.yielded_ns = now_ns;
            std::thread::yield_now();
        }
        false
    }

    /// How long to sleep now; 0 for not at all.
    const fn nap_ns(&self, now_ns: u64, deadline_ns: u64) -> u64 {
        let nap_ns = match (self.strategy, now_ns - self.since_ns) {
            (_, PATIENCE_NS..) => LONG_NAP_NS,
            (WaitStrategy::Hybrid, YIELD_NS..) => NAP_NS,
            _ => 0,
        };
        let left_ns = deadline_ns.saturating_sub(now_ns).saturating_sub(LATE_NS);
        if nap_ns < left_ns { nap_ns } else { left_ns }
    }

    /// Sleeps for a moment, for what is awaited from somebody who needs the core more; true when the
    /// limit is over.
    #[must_use]
    pub fn nap(&mut self) -> bool {
        let now_ns = monotonic_ns();
        if self.since_ns == 0 {
            (self.since_ns, self.limited_ns) = (now_ns, now_ns);
        }
        std::thread::sleep(Duration::from_nanos(NAP_NS));
        now_ns - self.limited_ns >= self.limit.ns
    }

    /// Waits for a time of the monotonic clock: naps until close to it, then as the strategy says.
    /// `interrupted` is asked between naps and ends the wait early.
    pub fn until_ns(&self, target_ns: u64, interrupted: impl Fn() -> bool) {
        until_ns(self.strategy, target_ns, interrupted);
    }
}

/// Waits for a time of the monotonic clock: naps until close to it, then spins or yields, as the
/// strategy says. `interrupted` is asked between naps and ends the wait early.
fn until_ns(strategy: WaitStrategy, target_ns: u64, interrupted: impl Fn() -> bool) {
    /// Wake-ups come this late on an ordinary machine; what is left is waited for awake.
    const EARLY_NS: u64 = 200_000;
    /// No nap is longer, so that an interruption is seen soon.
    const LONGEST_NS: u64 = 20_000_000;
    let early_ns = match strategy {
        WaitStrategy::Hybrid | WaitStrategy::Yield => EARLY_NS,
        WaitStrategy::Spin => PATIENCE_NS,
    };
    loop {
        let left_ns = target_ns.saturating_sub(monotonic_ns());
        if left_ns == 0 || interrupted() {
            return;
        }
        if left_ns > early_ns {
            let nap_ns = (left_ns - early_ns).min(LONGEST_NS);
            std::thread::sleep(Duration::from_nanos(nap_ns));
        } else if strategy == WaitStrategy::Yield {
            std::thread::yield_now();
        } else {
            std::hint::spin_loop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limit() -> WaitLimit {
        WaitLimit::from_seconds(5.0)
    }

    /// How often the calling thread has slept.
    fn sleeps() -> u64 {
        let status = std::fs::read_to_string("/proc/thread-self/status").expect("reads");
        let line = (status.lines()).find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"));
        line.and_then(|count| count.trim().parse().ok())
            .expect("a count")
    }

    #[test]
    fn a_core_that_somebody_needs_is_spun_on_less_until_nobody_does() {
        let mut waiter = Waiter::with(limit(), WaitStrategy::Hybrid, false);
        while waiter.yielded_ns == 0 {
            assert!(!waiter.pause());
        }
        assert_eq!(waiter.polls, SPINS);
        std::thread::sleep(Duration::from_millis(1)); // as if the core had come back late
        assert!(!waiter.pause());
        assert_eq!(waiter.spins, FEW_SPINS);
        waiter.yielded_ns = 0; // the next wait ends while it spins
        waiter.done();
        assert_eq!(waiter.spins, 2 * FEW_SPINS);
        for _ in 0..10 {
            waiter.done();
        }
        assert_eq!(waiter.spins, SPINS);
    }

    #[test]
    fn a_wait_ends_at_its_limit_and_only_a_long_one_sleeps() {
        for strategy in WaitStrategy::ALL {
            let limit = WaitLimit::from_seconds(0.01);
            let mut waiter = Waiter::with(limit, strategy, false);
            let (before_ns, slept) = (monotonic_ns(), sleeps());
            while !waiter.pause() {}
            assert!(monotonic_ns() - before_ns >= limit.ns);
            // On a busy machine a single yield may take all of the time: a hybrid wait may sleep.
            let may_sleep = strategy == WaitStrategy::Hybrid;
            assert!(sleeps() == slept || may_sleep, "{}", strategy.name());

            let mut waiter = Waiter::with(WaitLimit::from_seconds(60.0), strategy, false);
            let slept = sleeps();
            while sleeps() == slept {
                assert!(!waiter.pause(), "{} never sleeps", strategy.name());
            }
        }
    }

    #[test]
    fn no_nap_reaches_into_the_time_before_a_deadline() {
        const MS: u64 = 1_000_000;
        let (hybrid, spin, yields) = (
            WaitStrategy::Hybrid,
            WaitStrategy::Spin,
            WaitStrategy::Yield,
        );
        for (strategy, waited_ns, left_ns, nap_ns) in [
            (hybrid, MS, u64::MAX, 0),
            (hybrid, 2 * MS, u64::MAX, 100_000),
            (hybrid, 19 * MS, 10 * MS, 100_000),
            (hybrid, 19 * MS, 350_000, 50_000),
            (hybrid, 19 * MS, 300_000, 0),
            (hybrid, 20 * MS, 10 * MS, MS),
            (hybrid, 20 * MS, MS, 700_000),
            (hybrid, 20 * MS, 0, 0),
            (yields, 19 * MS, u64::MAX, 0),
            (yields, 20 * MS, u64::MAX, MS),
            (spin, 19 * MS, u64::MAX, 0),
            (spin, 20 * MS, 1_200_000, 900_000),
        ] {
            let mut waiter = Waiter::with(limit(), strategy, false);
            waiter.since_ns = 1;
            let now_ns = 1 + waited_ns;
            let deadline_ns = now_ns.saturating_add(left_ns);
            let asked = (strategy.name(), waited_ns, left_ns);
            assert_eq!(waiter.nap_ns(now_ns, deadline_ns), nap_ns, "{asked:?}");
        }
    }

    #[test]
    fn who_shares_its_only_core_yields_after_each_poll() {
        for strategy in WaitStrategy::ALL {
            let waiter = Waiter::with(limit(), strategy, true);
            assert_eq!((waiter.strategy, waiter.spins), (WaitStrategy::Yield, 0));
        }
    }

    #[test]
    fn a_nap_counts_towards_the_limit() {
        let mut waiter = Waiter::new(WaitLimit::from_seconds(0.002));
        let before_ns = monotonic_ns();
        while !waiter.nap() {}
        assert!(monotonic_ns() - before_ns >= 2_000_000);
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
        for strategy in WaitStrategy::ALL {
            let target_ns = monotonic_ns() + 1_000_000;
            let waiter = Waiter::with(limit(), strategy, false);
            waiter.until_ns(target_ns, || false);
            assert!(monotonic_ns() >= target_ns);
            waiter.until_ns(u64::MAX, || true);
        }
    }
}
