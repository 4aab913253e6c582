//! Waiting for the other side: fast if the answer comes soon, gentle on the machine if it does not, and always bounded.
//!
//! | strategy | at first | then |
//! |---|---|---|
//! | `hybrid` | poll | yield, and sleep after 4 ms; sleep at once beside others who need the core |
//! | `spin` | poll | the same, and sleep after 20 ms |
//! | `yield` | yield | the same, and sleep after 20 ms |
//! | `sleep` | sleep | the same |
//!
//! A sleeping side is woken by the other side's next send ([`Sleeper`]); where nothing can wake it, the side polls with
//! short sleeps.
//!
//! A hybrid wait learns three things from previous waits:
//!
//! - **Contention for the core.** A yielded core comes back within microseconds if only the other side took it, and
//!   after milliseconds if a third program did. If such slow returns take more than two fifths of the time, the side
//!   stops yielding for a while: the kernel prefers a woken sleeper to programs that compute. If both sides share one
//!   core, few quick returns may lie between the slow ones, because programs of another session take their share there
//!   in any case. A timed wait that ended late also indicates contention, and such waits are then slept through to the
//!   end. Where a sleep costs little, one lost time slice can be enough.
//! - **Expected duration.** A loop with real-time priority and a sleeper sleeps for as long as nothing is expected.
//! - **Benefit of polling.** Polling is useless if both sides share one core, because the other side runs only when
//!   this one lets it. After several consecutive waits that polling did not end, polling is skipped for a while.
//!
//! Without contention the side yields before it sleeps, for longer than a wake-up takes: a side that sleeps sooner
//! makes the other side sleep too, and neither recovers from that. The clock is not read until the polls are over, so
//! that an immediate answer costs no system call.

use std::time::Duration;

use rustix::thread::{CpuSet, sched_getaffinity};

use crate::clock::monotonic_ns;
use habits::{Company, Length, Polling};
use shared_types::wait::{Sleeper, WaitLimit, WaitStrategy};

mod habits;

/// Consecutive polls without reading the clock: some 12 us.
const SPINS: u32 = 512;
/// Time for which a hybrid wait yields before it sleeps. Longer than most work of the recorder: a side that sleeps
/// while the other waits behind the recorder frees a core for the recorder, and both sides then stay on one core.
const YIELD_NS: u64 = 4_000_000;
/// Fruitless waiting time after which each strategy sleeps, so that a held run or a process with real-time priority no
/// longer blocks its core.
const PATIENCE_NS: u64 = 20_000_000;
/// Longest sleep between checks of the limit; a frame, a message or a request from `hil` ends the sleep sooner.
const SLICE_NS: u64 = 100_000_000;
/// Length of a short sleep where nothing wakes a sleeper.
const NAP_NS: u64 = 100_000;
/// Length of such a sleep after `PATIENCE_NS`: by then at most a twentieth of the wait.
const LONG_NAP_NS: u64 = 1_000_000;
/// Delay by which a sleep may overshoot on an ordinary machine.
const LATE_NS: u64 = 300_000;

/// Time before a release at which a side stops sleeping, to allow for late wake-ups on an ordinary machine.
const EARLY_NS: u64 = 200_000;
/// Time for which a paced side under contention polls for the answer to its frame before it sleeps: each sleep can then
/// end a time slice too late.
const ANSWER_NS: u64 = 100_000;
/// Longest sleep before a target time, so that an interruption is noticed soon.
const LONGEST_NAP_NS: u64 = 20_000_000;

/// Performs consecutive waits.
#[derive(Debug)]
pub struct Waiter {
    limit: WaitLimit,
    strategy: WaitStrategy,
    sleeper: Option<Box<dyn Sleeper>>,
    /// Token of an announced sleep.
    announced: Option<u32>,
    polling: Polling,
    company: Company,
    /// Expected length of the next wait, if the waits are a loop's.
    length: Option<Length>,
    /// `true` if the previous wait was a timed one.
    follows_time: bool,
    /// `true` if this thread has priority over all ordinary threads.
    has_priority: bool,
    polls: u32,
    /// Time at which this wait outlasted its polls; 0 if the polls sufficed.
    since_ns: u64,
    /// Start time of the limit.
    limited_ns: u64,
}

/// Action until the next poll.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rest {
    Spin,
    Yield,
    /// Sleep for at most N ns.
    Sleep(u64),
}

impl Waiter {
    /// Creates a hybrid waiter for the cores on which this process may run.
    #[must_use]
    pub fn new(limit: WaitLimit) -> Self {
        let cores = sched_getaffinity(None).map_or(1, |cores: CpuSet| cores.count());
        Self::with(limit, WaitStrategy::Hybrid, cores == 1)
    }

    /// Creates a waiter of this strategy; `shares_core` if the other side may have no other core to run on. Such a
    /// waiter never polls, whatever the strategy: each poll would take time from the other side.
    #[must_use]
    pub const fn with(limit: WaitLimit, strategy: WaitStrategy, shares_core: bool) -> Self {
        let strategy = match strategy {
            WaitStrategy::Spin if shares_core => WaitStrategy::Hybrid,
            strategy => strategy,
        };
        let polls = matches!(strategy, WaitStrategy::Hybrid | WaitStrategy::Spin);
        Self {
            limit,
            strategy,
            sleeper: None,
            announced: None,
            polling: Polling::new(shares_core || !polls),
            company: Company::none(shares_core),
            length: None,
            follows_time: false,
            has_priority: false,
            polls: 0,
            since_ns: 0,
            limited_ns: 0,
        }
    }

    /// Assumes several cores, but fewer cores than loops.
    #[must_use]
    pub fn with_several_cores(mut self) -> Self {
        self.company = Company::none(false);
        self
    }

    /// Assumes that the waits are those of a loop for the other side, similar from step to step. If a thread that
    /// `has_priority` never sleeps and others need its core, the kernel stops it for 50 ms of each second; hybrid waits
    /// of such a thread therefore sleep for as long as nothing is expected.
    #[must_use]
    pub fn of_a_loop(mut self, has_priority: bool) -> Self {
        self.length = Some(Length::default());
        self.has_priority = has_priority;
        self
    }

    /// Sleeps on this sleeper from now on, if there is one.
    pub fn sleep_on(&mut self, sleeper: Option<Box<dyn Sleeper>>) {
        self.sleeper = sleeper;
    }

    /// Returns the time limit of the other side.
    #[must_use]
    #[inline]
    pub const fn limit(&self) -> WaitLimit {
        self.limit
    }

    /// Restarts the limit of the current wait.
    #[inline]
    pub fn renew(&mut self) {
        self.limited_ns = monotonic_ns();
    }

    /// Ends a wait successfully.
    #[inline]
    pub fn done(&mut self) {
        if self.since_ns > 0 {
            self.outlasted();
        } else if self.polls > 0 {
            self.polling.helped();
            if let Some(length) = &mut self.length {
                length.waited(0);
            }
            self.follows_time = false;
        }
        self.polls = 0;
    }

    /// Learns from a wait that outlasted its polls.
    fn outlasted(&mut self) {
        self.retire();
        if self.strategy == WaitStrategy::Hybrid {
            self.polling.missed();
            let now_ns = monotonic_ns();
            if self.sleep_is_cheap() {
                self.company.ended(now_ns);
            }
            if let Some(length) = &mut self.length {
                length.waited(now_ns - self.since_ns);
            }
        }
        (self.since_ns, self.follows_time) = (0, false);
    }

    /// Cancels an announced sleep.
    fn retire(&mut self) {
        if self.announced.take().is_some()
            && let Some(sleeper) = &self.sleeper
        {
            sleeper.retire();
        }
    }

    /// Returns `true` if a sleep in this wait costs little, because there is time until the next release or the wait
    /// will most likely be long.
    fn sleep_is_cheap(&self) -> bool {
        self.follows_time || self.idle_ns() > 0
    }

    /// Returns the initial part of this wait in which nothing is expected.
    fn idle_ns(&self) -> u64 {
        self.length.as_ref().map_or(0, Length::idle_ns)
    }

    /// Waits briefly before the next poll; returns `true` once the limit is reached.
    #[must_use]
    pub fn pause(&mut self) -> bool {
        self.pause_until(u64::MAX)
    }

    /// Waits briefly before the next poll, but never sleeps past a deadline on the monotonic clock; returns `true` once
    /// the limit is reached. The caller checks the deadline.
    #[must_use]
    #[inline]
    pub fn pause_until(&mut self, deadline_ns: u64) -> bool {
        if self.polls < self.polling.polls {
            self.polls += 1;
            std::hint::spin_loop();
            return false;
        }
        self.rest_until(deadline_ns)
    }

    fn rest_until(&mut self, deadline_ns: u64) -> bool {
        let now_ns = monotonic_ns();
        if self.since_ns == 0 {
            (self.since_ns, self.limited_ns) = (now_ns, now_ns);
        }
        if self.limit_ns(now_ns) == 0 {
            return true;
        }
        match self.rest(now_ns, deadline_ns) {
            Rest::Spin => {
                self.retire();
                self.polls = 0; // the clock again after as many polls
            }
            Rest::Yield => {
                self.retire();
                std::thread::yield_now();
                let back_ns = monotonic_ns();
                let is_cheap = self.sleep_is_cheap();
                self.company.came_back(back_ns, back_ns - now_ns, is_cheap);
            }
            Rest::Sleep(ns) => self.sleep_for(ns),
        }
        false
    }

    /// Decides on the next action.
    fn rest(&self, now_ns: u64, deadline_ns: u64) -> Rest {
        let has_bell = self.sleeper.is_some();
        let idle_ns = match self.has_priority && has_bell {
            true => self.idle_ns(),
            false => 0,
        };
        let waited_ns = now_ns - self.since_ns;
        let left_idle_ns = idle_ns.saturating_sub(waited_ns);
        let awake_ns = waited_ns.saturating_sub(idle_ns);
        let sleeps = left_idle_ns > 0
            || awake_ns >= PATIENCE_NS
            || match self.strategy {
                WaitStrategy::Spin | WaitStrategy::Yield => false,
                WaitStrategy::Sleep => true,
                WaitStrategy::Hybrid => {
                    awake_ns >= YIELD_NS || (has_bell && self.has_company(now_ns))
                }
            };
        let longest_ns = match has_bell {
            _ if !sleeps => 0,
            true if left_idle_ns > 0 => left_idle_ns.min(SLICE_NS / 2), // by a timer
            true if deadline_ns < u64::MAX => SLICE_NS / 2,             // the same
            true => SLICE_NS,
            false if awake_ns >= PATIENCE_NS => LONG_NAP_NS,
            false => NAP_NS,
        };
        let left_ns = deadline_ns.saturating_sub(now_ns).saturating_sub(LATE_NS);
        let ns = longest_ns.min(left_ns).min(self.limit_ns(now_ns));
        match self.strategy {
            WaitStrategy::Hybrid
                if self.follows_time
                    && waited_ns < ANSWER_NS
                    && self.has_company(now_ns)
                    && !self.polling.never =>
            {
                Rest::Spin
            }
            _ if ns > 0 => Rest::Sleep(ns),
            WaitStrategy::Spin => Rest::Spin,
            _ => Rest::Yield,
        }
    }

    /// Returns `true` if contention for the core is assumed.
    const fn has_company(&self, now_ns: u64) -> bool {
        !self.has_priority && self.company.is_there(now_ns)
    }

    /// Returns the time until the limit.
    const fn limit_ns(&self, now_ns: u64) -> u64 {
        self.limit.ns().saturating_sub(now_ns - self.limited_ns)
    }

    /// Sleeps, or announces a sleep first.
    fn sleep_for(&mut self, ns: u64) {
        let Some(sleeper) = &self.sleeper else {
            std::thread::sleep(Duration::from_nanos(ns));
            return;
        };
        match self.announced.take() {
            None => self.announced = Some(sleeper.announce()),
            Some(announced) => {
                sleeper.sleep(announced, ns);
                sleeper.retire();
            }
        }
    }

    /// Sleeps briefly to leave the core to others; returns `true` once the limit is reached.
    #[must_use]
    pub fn sleep(&mut self) -> bool {
        let now_ns = monotonic_ns();
        if self.since_ns == 0 {
            (self.since_ns, self.limited_ns) = (now_ns, now_ns);
        }
        let longest_ns = if self.sleeper.is_some() {
            SLICE_NS
        } else {
            NAP_NS
        };
        self.sleep_for(longest_ns.min(self.limit_ns(now_ns)));
        self.limit_ns(now_ns) == 0
    }

    /// Waits for a time on the monotonic clock: sleeps until close to that time, then spins or yields as the strategy
    /// requires. `interrupted` is checked between sleeps and ends the wait early. Ends any previous wait, such as one
    /// for the recorder.
    pub fn until_ns(&mut self, target_ns: u64, interrupted: impl Fn() -> bool) {
        self.done();
        let mut has_waited = false;
        loop {
            let now_ns = monotonic_ns();
            let left_ns = target_ns.saturating_sub(now_ns);
            if left_ns == 0 {
                // A time already past at the call is late by the caller's own work.
                if has_waited {
                    self.company.woke(now_ns, now_ns - target_ns);
                }
                self.follows_time = has_waited;
                return;
            }
            has_waited = true;
            if interrupted() {
                return;
            }
            let nap_ns = left_ns
                .saturating_sub(self.early_ns(now_ns))
                .min(LONGEST_NAP_NS);
            if nap_ns > 0 {
                std::thread::sleep(Duration::from_nanos(nap_ns));
            } else if self.strategy == WaitStrategy::Yield {
                std::thread::yield_now();
            } else {
                std::hint::spin_loop();
            }
        }
    }

    /// Returns how long before the target time the waiter stays awake.
    const fn early_ns(&self, now_ns: u64) -> u64 {
        match self.strategy {
            WaitStrategy::Spin => PATIENCE_NS,
            // A side that computes before each release soon exhausts its share of the core, and then waits for a time
            // slice of the others.
            WaitStrategy::Hybrid if self.has_company(now_ns) => 0,
            WaitStrategy::Hybrid | WaitStrategy::Yield | WaitStrategy::Sleep => EARLY_NS,
        }
    }
}

#[cfg(test)]
mod tests;
