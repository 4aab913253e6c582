//! Waiting for the other side: fast when it is quick, kind to the machine when it is not, and
//! bounded always.
//!
//! | strategy | at first | then |
//! |---|---|---|
//! | `hybrid` | poll | yield, and sleep after 4 ms; sleep at once beside others who need the core |
//! | `spin` | poll | the same, and sleep after 20 ms |
//! | `yield` | yield | the same, and sleep after 20 ms |
//! | `sleep` | sleep | the same |
//!
//! Whoever sleeps is woken by the other side's next send ([`Sleeper`]); where nothing can wake it, it naps.
//!
//! A hybrid wait learns three things from the waits before:
//!
//! - **Whether others need the core.** A core that was given away comes back within microseconds if only the
//!   other side took it, and after milliseconds if a third did. If such returns take more than two fifths of the
//!   time, it is not given away any more for a while: a sleeper that is woken goes before those who compute. Where
//!   both sides have one core, few quick returns may be between them: others of another session take their share
//!   there in any case. A wait for a time that ended late shows the same, and such a wait is slept to its end then.
//!   Where a sleep costs little, one lost slice can be enough.
//! - **How long it will last.** A loop with real-time priority that can be woken sleeps as long as nothing is expected.
//! - **Whether polling helps.** It does not where both sides are on one core, as the other runs only when
//!   this one lets it. After some waits in a row that polls did not end, there are none for a while.
//!
//! Beside nobody it yields before it sleeps, for longer than a wake-up takes: who sleeps sooner makes the
//! other side sleep too, and neither gets out of it.
//! The clock is not read before the polls are over, so a ready peer costs no system call.

use std::time::Duration;

use rustix::thread::{CpuSet, sched_getaffinity};

use crate::clock::monotonic_ns;
use habits::{Company, Length, Polling};
use shared_types::wait::{Sleeper, WaitLimit, WaitStrategy};

mod habits;

/// Polls in a row that read no clock: some 12 us.
const SPINS: u32 = 512;
/// Time for which a hybrid wait yields before it sleeps. Longer than the recorder mostly takes at a time: a side
/// that sleeps while the other waits behind the recorder leaves a core to it, and both stay on that core.
const YIELD_NS: u64 = 4_000_000;
/// Time without news after which each strategy sleeps: a held run or a process of real-time priority then
/// no longer blocks its core.
const PATIENCE_NS: u64 = 20_000_000;
/// Longest sleep before the limit is looked at; a frame, a message and a word of `hil` end it sooner.
const SLICE_NS: u64 = 100_000_000;
/// Length of a nap where nothing wakes a sleeper.
const NAP_NS: u64 = 100_000;
/// Length of a nap after `PATIENCE_NS`: by then it costs a twentieth of the wait at most.
const LONG_NAP_NS: u64 = 1_000_000;
/// Time by which a sleep may end later than asked for on an ordinary machine.
const LATE_NS: u64 = 300_000;

/// Time before a release at which a side stops sleeping, as wake-ups come this late on an ordinary machine.
const EARLY_NS: u64 = 200_000;
/// Time for which a side that keeps pace beside others looks for the answer to its frame before it sleeps: each sleep
/// there can end a slice too late.
const ANSWER_NS: u64 = 100_000;
/// Longest nap before a time, so that an interruption is seen soon.
const LONGEST_NAP_NS: u64 = 20_000_000;

/// Waits, one after another.
#[derive(Debug)]
pub struct Waiter {
    limit: WaitLimit,
    strategy: WaitStrategy,
    sleeper: Option<Box<dyn Sleeper>>,
    /// Answer of the sleeper to an announced sleep.
    announced: Option<u32>,
    polling: Polling,
    company: Company,
    /// Length of the next wait, if waits are a loop's.
    length: Option<Length>,
    /// True if the wait before was one for a time.
    follows_time: bool,
    /// True if this thread goes before all ordinary ones.
    has_priority: bool,
    polls: u32,
    /// Time at which this wait outlasted its polls; 0 if it did not.
    since_ns: u64,
    /// Time from which the limit counts.
    limited_ns: u64,
}

/// Rest until the next poll.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rest {
    Spin,
    Yield,
    /// For N ns at most.
    Sleep(u64),
}

impl Waiter {
    /// A hybrid waiter for the cores that this process may run on.
    #[must_use]
    pub fn new(limit: WaitLimit) -> Self {
        let cores = sched_getaffinity(None).map_or(1, |cores: CpuSet| cores.count());
        Self::with(limit, WaitStrategy::Hybrid, cores == 1)
    }

    /// A waiter of this strategy; `shares_core` if the other side may have no other core to run on. Then nobody
    /// polls, whatever the strategy: each poll would cost the other side's time.
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

    /// Takes it that there are several cores, though fewer than loops.
    #[must_use]
    pub fn with_several_cores(mut self) -> Self {
        self.company = Company::none(false);
        self
    }

    /// Assumes that the waits are those of a loop for the other side, much alike from step to step. The kernel stops
    /// one that `has_priority` for 50 ms of each second if it never sleeps and others need its core; its hybrid waits
    /// sleep as long as nothing is expected.
    #[must_use]
    pub fn of_a_loop(mut self, has_priority: bool) -> Self {
        self.length = Some(Length::default());
        self.has_priority = has_priority;
        self
    }

    /// Sleeps on this from now on, if there is one.
    pub fn sleep_on(&mut self, sleeper: Option<Box<dyn Sleeper>>) {
        self.sleeper = sleeper;
    }

    /// Returns the time that the other side may take.
    #[must_use]
    #[inline]
    pub const fn limit(&self) -> WaitLimit {
        self.limit
    }

    /// Begins the limit anew for the same thing.
    #[inline]
    pub fn renew(&mut self) {
        self.limited_ns = monotonic_ns();
    }

    /// Ends a wait: the awaited thing came.
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

    /// Takes an announced sleep back.
    fn retire(&mut self) {
        if self.announced.take().is_some()
            && let Some(sleeper) = &self.sleeper
        {
            sleeper.retire();
        }
    }

    /// Tells if a sleep in this wait costs little, because there is time until the next release or the wait will most
    /// likely be long.
    fn sleep_is_cheap(&self) -> bool {
        self.follows_time || self.idle_ns() > 0
    }

    /// Returns the part of this wait in which nothing is expected.
    fn idle_ns(&self) -> u64 {
        self.length.as_ref().map_or(0, Length::idle_ns)
    }

    /// Waits a moment before the next poll; true when the limit is over.
    #[must_use]
    pub fn pause(&mut self) -> bool {
        self.pause_until(u64::MAX)
    }

    /// Waits a moment before the next poll, but never sleeps past a time of the monotonic clock
    /// that must not be missed; true when the limit is over. The caller looks whether that time came.
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

    /// Decides what to do now.
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

    /// Tells if others are taken for granted who take the core from this side.
    const fn has_company(&self, now_ns: u64) -> bool {
        !self.has_priority && self.company.is_there(now_ns)
    }

    /// Returns the time until the limit.
    const fn limit_ns(&self, now_ns: u64) -> u64 {
        self.limit.ns().saturating_sub(now_ns - self.limited_ns)
    }

    /// Sleeps, or says first that it will.
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

    /// Sleeps for a moment, for what is awaited from somebody who needs the core more; true when the
    /// limit is over.
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

    /// Waits for a time of the monotonic clock: naps until close to it, then spins or yields as the strategy
    /// says. `interrupted` is asked between naps and ends the wait early. A wait before it, as for the recorder, is
    /// over.
    pub fn until_ns(&mut self, target_ns: u64, interrupted: impl Fn() -> bool) {
        self.done();
        let mut has_waited = false;
        loop {
            let now_ns = monotonic_ns();
            let left_ns = target_ns.saturating_sub(now_ns);
            if left_ns == 0 {
                // What was past at once is late by the caller's own work.
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

    /// Returns the time before an awaited one that is waited for awake.
    const fn early_ns(&self, now_ns: u64) -> u64 {
        match self.strategy {
            WaitStrategy::Spin => PATIENCE_NS,
            // Who computes before each release soon had as much of the core as is due, and then waits for a
            // slice of the others.
            WaitStrategy::Hybrid if self.has_company(now_ns) => 0,
            WaitStrategy::Hybrid | WaitStrategy::Yield | WaitStrategy::Sleep => EARLY_NS,
        }
    }
}

#[cfg(test)]
mod tests;
