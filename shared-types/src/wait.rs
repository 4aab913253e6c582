//! Waiting for the other side: fast when it is quick, kind to the machine when it is not, and
//! bounded always.
//!
//! | strategy | at first | then |
//! |---|---|---|
//! | `hybrid` | poll | yield, and sleep after 2 ms; sleep at once beside others who need the core |
//! | `spin` | poll | the same, and sleep after 20 ms |
//! | `yield` | yield | the same, and sleep after 20 ms |
//! | `sleep` | sleep | the same |
//!
//! Whoever sleeps is woken by the other side's next send ([`Sleeper`]); where nothing can wake it, it naps.
//!
//! A hybrid wait learns two things from the waits before:
//!
//! - **Whether others need the core.** A core that was given away comes back within microseconds if only the
//!   other side took it, and after a slice of milliseconds if a third did. Then it is not given away any more
//!   for a while: a sleeper that is woken goes before those who compute.
//! - **Whether polling helps.** It does not where both sides are on one core, as the other runs only when
//!   this one lets it. After some waits in a row that polls did not end, there are none for a while.
//!
//! Beside nobody it yields before it sleeps, for longer than a wake-up takes: who sleeps sooner makes the
//! other side sleep too, and neither gets out of it.
//! The clock is not read before the polls are over, so a ready peer costs no system call.

use std::fmt;
use std::time::Duration;

use rustix::thread::{CpuSet, sched_getaffinity};
use serde::{Deserialize, Serialize};

use crate::clock::monotonic_ns;

/// Polls in a row that read no clock: some 12 us.
const SPINS: u32 = 512;
/// How long a hybrid wait yields before it sleeps.
const YIELD_NS: u64 = 2_000_000;
/// After so long without anything each strategy sleeps: a held run or a process of real-time priority then
/// no longer blocks its core.
const PATIENCE_NS: u64 = 20_000_000;
/// Longest sleep before the limit is looked at.
const SLICE_NS: u64 = 5_000_000;
/// Length of a nap where nothing wakes a sleeper.
const NAP_NS: u64 = 100_000;
/// The same after `PATIENCE_NS`: by then it costs a twentieth of the wait at most.
const LONG_NAP_NS: u64 = 1_000_000;
/// A sleep may end so much later than asked for on an ordinary machine.
const LATE_NS: u64 = 300_000;

/// What to do between two polls. It moves times and what is left to others, never a result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WaitStrategy {
    /// Poll, then give the core away or sleep, by what the waits before have shown.
    #[default]
    Hybrid,
    /// Never give the core away: for a core that nobody else needs.
    Spin,
    /// Give the core away after each poll: for a core that both sides have to themselves.
    Yield,
    /// Sleep until the other side sends: for more runs at a time than cores.
    Sleep,
}

impl WaitStrategy {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Hybrid, Self::Spin, Self::Yield, Self::Sleep];

    /// Its name in scenarios, on command lines and in summaries.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hybrid => "hybrid",
            Self::Spin => "spin",
            Self::Yield => "yield",
            Self::Sleep => "sleep",
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

/// What a waiter sleeps on and what the other side's send wakes.
pub trait Sleeper: fmt::Debug {
    /// Says that this side is about to sleep: a send after this ends the sleep or keeps it from beginning.
    /// What was sent before does not, so whoever waits looks once more in between. Gives what `sleep` wants.
    fn announce(&self) -> u32;

    /// Sleeps until the other side sends, `ns` at most. It may end for no reason.
    fn sleep(&self, announced: u32, ns: u64);

    /// Says that this side is awake.
    fn retire(&self);
}

/// One wait after another.
#[derive(Debug)]
pub struct Waiter {
    limit: WaitLimit,
    strategy: WaitStrategy,
    sleeper: Option<Box<dyn Sleeper>>,
    /// What the sleeper gave, if a sleep was announced.
    announced: Option<u32>,
    polling: Polling,
    company: Company,
    polls: u32,
    /// When this wait outlasted its polls; 0 if it did not.
    since_ns: u64,
    /// Since when the limit counts.
    limited_ns: u64,
}

/// How often to poll before anything else, learned from the waits before.
#[derive(Debug)]
struct Polling {
    /// Polls in this wait.
    polls: u32,
    /// Whether both sides have one core, or polling is not asked for: there are no polls at all.
    never: bool,
    /// Waits in a row that polls did not end.
    misses: u32,
    /// Waits before the next one with polls.
    without: u32,
    /// The same after the next miss.
    backoff: u32,
}

impl Polling {
    /// So many misses in a row show that polling does not help.
    const MISSES: u32 = 4;
    /// Most waits without polls.
    const LONGEST: u32 = 256;

    const fn new(never: bool) -> Self {
        Self {
            polls: if never { 0 } else { SPINS },
            never,
            misses: 0,
            without: 0,
            backoff: Self::MISSES,
        }
    }

    /// Polls ended a wait.
    const fn helped(&mut self) {
        if self.misses > 0 {
            self.misses = 0;
            self.backoff = Self::MISSES;
        }
    }

    /// A wait outlasted its polls.
    const fn missed(&mut self) {
        if self.never {
            return;
        }
        if self.without > 0 {
            self.without -= 1;
        } else {
            self.misses += 1;
            if self.misses >= Self::MISSES {
                // The next that misses is enough.
                self.misses = Self::MISSES - 1;
                self.without = self.backoff;
                self.backoff *= 2;
                if self.backoff > Self::LONGEST {
                    self.backoff = Self::LONGEST;
                }
            }
        }
        self.polls = if self.without > 0 { 0 } else { SPINS };
    }
}

/// Whether others need the core, learned from how long it was away when it was given away.
#[derive(Debug)]
struct Company {
    /// Moving average of how long it was away.
    away_ns: u64,
    /// Until when others are taken for granted.
    until_ns: u64,
    /// How long they are the next time.
    backoff_ns: u64,
}

impl Company {
    /// Returns that the average is made of. One that took a slice of the scheduler brings it near the limit,
    /// and the recorder's short work between many quick ones does not.
    const RETURNS: u64 = 128;
    /// The average with which others are in company.
    const LIMIT_NS: u64 = 20_000;
    const SHORTEST_NS: u64 = 10_000_000;
    const LONGEST_NS: u64 = 1_000_000_000;

    const NONE: Self = Self {
        away_ns: 0,
        until_ns: 0,
        backoff_ns: Self::SHORTEST_NS,
    };

    /// The core came back.
    const fn came_back(&mut self, now_ns: u64, took_ns: u64) {
        self.away_ns = self.away_ns - self.away_ns / Self::RETURNS + took_ns / Self::RETURNS;
        if self.away_ns > Self::LIMIT_NS {
            // One late return is enough the next time.
            self.away_ns = Self::LIMIT_NS - Self::LIMIT_NS / 4;
            self.until_ns = now_ns + self.backoff_ns;
            self.backoff_ns *= 2;
            if self.backoff_ns > Self::LONGEST_NS {
                self.backoff_ns = Self::LONGEST_NS;
            }
        } else if self.away_ns < Self::LIMIT_NS / 2 {
            self.backoff_ns = Self::SHORTEST_NS;
        }
    }

    const fn is_there(&self, now_ns: u64) -> bool {
        now_ns < self.until_ns
    }
}

/// What to do until the next poll.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rest {
    Spin,
    Yield,
    /// For so many ns at most.
    Sleep(u64),
}

impl Waiter {
    /// A hybrid waiter for the cores that this process may run on.
    #[must_use]
    pub fn new(limit: WaitLimit) -> Self {
        let cores = sched_getaffinity(None).map_or(1, |cores: CpuSet| cores.count());
        Self::with(limit, WaitStrategy::Hybrid, cores == 1)
    }

    /// A waiter of this strategy; `shares_core` if the other side can run on no other core. Then nobody
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
            company: Company::NONE,
            polls: 0,
            since_ns: 0,
            limited_ns: 0,
        }
    }

    /// Sleeps on this from now on, if there is one.
    pub fn sleep_on(&mut self, sleeper: Option<Box<dyn Sleeper>>) {
        self.sleeper = sleeper;
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
        if self.since_ns > 0 {
            self.outlasted();
        } else if self.polls > 0 {
            self.polling.helped();
        }
        self.polls = 0;
    }

    /// Learns from a wait that outlasted its polls.
    fn outlasted(&mut self) {
        self.since_ns = 0;
        if self.announced.take().is_some()
            && let Some(sleeper) = &self.sleeper
        {
            sleeper.retire();
        }
        if self.strategy == WaitStrategy::Hybrid {
            self.polling.missed();
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
            Rest::Spin => self.polls = 0, // the clock again after as many polls
            Rest::Yield => {
                std::thread::yield_now();
                let back_ns = monotonic_ns();
                self.company.came_back(back_ns, back_ns - now_ns);
            }
            Rest::Sleep(ns) => self.sleep_for(ns),
        }
        false
    }

    /// Decides what to do now.
    const fn rest(&self, now_ns: u64, deadline_ns: u64) -> Rest {
        let waited_ns = now_ns - self.since_ns;
        let has_bell = self.sleeper.is_some();
        let longest_ns = match self.strategy {
            _ if waited_ns >= PATIENCE_NS && has_bell => SLICE_NS,
            _ if waited_ns >= PATIENCE_NS => LONG_NAP_NS,
            WaitStrategy::Sleep => SLICE_NS,
            WaitStrategy::Hybrid if has_bell && self.company.is_there(now_ns) => SLICE_NS,
            WaitStrategy::Hybrid if waited_ns >= YIELD_NS => SLICE_NS,
            _ => 0,
        };
        let longest_ns = match has_bell {
            false if longest_ns == SLICE_NS => NAP_NS,
            _ => longest_ns,
        };
        let left_ns = deadline_ns.saturating_sub(now_ns).saturating_sub(LATE_NS);
        let ns = shorter(shorter(longest_ns, left_ns), self.limit_ns(now_ns));
        match self.strategy {
            _ if ns > 0 => Rest::Sleep(ns),
            WaitStrategy::Spin => Rest::Spin,
            _ => Rest::Yield,
        }
    }

    /// Returns the time until the limit.
    const fn limit_ns(&self, now_ns: u64) -> u64 {
        self.limit.ns.saturating_sub(now_ns - self.limited_ns)
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
        self.sleep_for(shorter(longest_ns, self.limit_ns(now_ns)));
        self.limit_ns(now_ns) == 0
    }

    /// Waits for a time of the monotonic clock: naps until close to it, then as the strategy says.
    /// `interrupted` is asked between naps and ends the wait early.
    pub fn until_ns(&self, target_ns: u64, interrupted: impl Fn() -> bool) {
        until_ns(self.strategy, target_ns, interrupted);
    }
}

const fn shorter(a: u64, b: u64) -> u64 {
    if a < b { a } else { b }
}

/// Waits for a time of the monotonic clock: naps until close to it, then spins or yields, as the
/// strategy says. `interrupted` is asked between naps and ends the wait early.
fn until_ns(strategy: WaitStrategy, target_ns: u64, interrupted: impl Fn() -> bool) {
    /// Wake-ups come this late on an ordinary machine; what is left is waited for awake.
    const EARLY_NS: u64 = 200_000;
    /// No nap is longer, so that an interruption is seen soon.
    const LONGEST_NS: u64 = 20_000_000;
    let early_ns = match strategy {
        WaitStrategy::Hybrid | WaitStrategy::Yield | WaitStrategy::Sleep => EARLY_NS,
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
    use std::cell::RefCell;
    use std::rc::Rc;

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

    const MS: u64 = 1_000_000;

    /// A bell that notes what is done with it.
    #[derive(Debug, Default)]
    struct Log(RefCell<Vec<String>>);

    impl Sleeper for Rc<Log> {
        fn announce(&self) -> u32 {
            self.0.borrow_mut().push("announce".into());
            7
        }

        fn sleep(&self, announced: u32, ns: u64) {
            (self.0.borrow_mut()).push(format!("sleep {announced} {}", ns / MS));
        }

        fn retire(&self) {
            self.0.borrow_mut().push("retire".into());
        }
    }

    #[test]
    fn a_slice_for_others_is_company_and_a_recorders_work_is_not() {
        let mut company = Company::NONE;
        for step in 0..100_000 {
            // 4 ms of yields to the other side, then half a millisecond for the recorder.
            company.came_back(step, if step % 1000 == 0 { 500_000 } else { 4_000 });
            assert!(!company.is_there(step));
        }
        company.came_back(0, 3 * MS);
        assert!(company.is_there(0) && company.is_there(10 * MS - 1) && !company.is_there(10 * MS));
        // Still there: each time for twice as long, up to a second.
        for ms in [20, 40, 80, 160, 320, 640, 1000, 1000] {
            company.came_back(0, MS);
            assert!(
                company.is_there(ms * MS - 1) && !company.is_there(ms * MS),
                "{ms}"
            );
        }
        // It went; when it comes again, it is for a short time at first.
        (0..1000).for_each(|_| company.came_back(0, 500));
        while company.until_ns == 1000 * MS {
            company.came_back(0, 3 * MS);
        }
        assert_eq!(company.until_ns, 10 * MS);
    }

    #[test]
    fn polls_that_do_not_help_are_left_out_more_and_more() {
        let mut polling = Polling::new(false);
        let waits_without = |polling: &mut Polling| {
            let mut waits = 0;
            loop {
                polling.missed();
                if polling.polls > 0 {
                    return waits;
                }
                waits += 1;
            }
        };
        assert_eq!([(); 3].map(|()| waits_without(&mut polling)), [0, 0, 0]);
        for waits in [4, 8, 16, 32, 64, 128, 256, 256] {
            assert_eq!(waits_without(&mut polling), waits);
        }
        polling.helped();
        assert_eq!([(); 3].map(|()| waits_without(&mut polling)), [0, 0, 0]);
        assert_eq!(waits_without(&mut polling), 4);
    }

    #[test]
    fn a_sleep_is_announced_before_the_last_look() {
        let log = Rc::new(Log::default());
        let mut waiter = Waiter::with(limit(), WaitStrategy::Sleep, false);
        waiter.sleep_on(Some(Box::new(Rc::clone(&log))));
        assert!(!waiter.pause()); // then one looks
        assert!(!waiter.pause());
        assert!(!waiter.pause());
        waiter.done(); // it came at the last look
        let expected = ["announce", "sleep 7 5", "retire", "announce", "retire"];
        assert_eq!(*log.0.borrow(), expected);
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
            let may_sleep = matches!(strategy, WaitStrategy::Hybrid | WaitStrategy::Sleep);
            assert!(sleeps() == slept || may_sleep, "{}", strategy.name());

            let mut waiter = Waiter::with(WaitLimit::from_seconds(60.0), strategy, false);
            let slept = sleeps();
            while sleeps() == slept {
                assert!(!waiter.pause(), "{} never sleeps", strategy.name());
            }
        }
    }

    #[test]
    fn no_sleep_reaches_into_the_time_before_a_deadline() {
        use WaitStrategy::{Hybrid, Sleep, Spin, Yield};
        const NAP: Rest = Rest::Sleep(100_000);
        const LONG_NAP: Rest = Rest::Sleep(MS);
        const SLICE: Rest = Rest::Sleep(5 * MS);
        for (strategy, waited_ns, left_ns, naps, sleeps) in [
            (Hybrid, MS, u64::MAX, Rest::Yield, Rest::Yield),
            (Hybrid, 2 * MS, u64::MAX, NAP, SLICE),
            (Hybrid, 19 * MS, 4 * MS, NAP, Rest::Sleep(3_700_000)),
            (
                Hybrid,
                19 * MS,
                350_000,
                Rest::Sleep(50_000),
                Rest::Sleep(50_000),
            ),
            (Hybrid, 19 * MS, 300_000, Rest::Yield, Rest::Yield),
            (Hybrid, 20 * MS, 40 * MS, LONG_NAP, SLICE),
            (Hybrid, 20 * MS, 0, Rest::Yield, Rest::Yield),
            (Yield, 19 * MS, u64::MAX, Rest::Yield, Rest::Yield),
            (Yield, 20 * MS, u64::MAX, LONG_NAP, SLICE),
            (Spin, 19 * MS, u64::MAX, Rest::Spin, Rest::Spin),
            (
                Spin,
                20 * MS,
                1_200_000,
                Rest::Sleep(900_000),
                Rest::Sleep(900_000),
            ),
            (Sleep, 0, u64::MAX, NAP, SLICE),
            (Sleep, 0, 0, Rest::Yield, Rest::Yield),
        ] {
            let mut waiter = Waiter::with(limit(), strategy, false);
            (waiter.since_ns, waiter.limited_ns) = (1, 1);
            let now_ns = 1 + waited_ns;
            let deadline_ns = now_ns.saturating_add(left_ns);
            let asked = (strategy.name(), waited_ns, left_ns);
            assert_eq!(waiter.rest(now_ns, deadline_ns), naps, "{asked:?}");
            waiter.sleep_on(Some(Box::new(Rc::new(Log::default()))));
            assert_eq!(waiter.rest(now_ns, deadline_ns), sleeps, "{asked:?}");
        }
    }

    #[test]
    fn a_hybrid_wait_in_company_sleeps_at_once_if_it_can_be_woken() {
        let mut waiter = Waiter::with(limit(), WaitStrategy::Hybrid, false);
        (waiter.since_ns, waiter.limited_ns) = (1, 1);
        waiter.company.until_ns = MS;
        assert_eq!(waiter.rest(1, u64::MAX), Rest::Yield);
        waiter.sleep_on(Some(Box::new(Rc::new(Log::default()))));
        assert_eq!(waiter.rest(1, u64::MAX), Rest::Sleep(SLICE_NS));
        assert_eq!(waiter.rest(MS, u64::MAX), Rest::Yield);
    }

    #[test]
    fn nobody_polls_where_both_sides_have_one_core() {
        for strategy in WaitStrategy::ALL {
            let waiter = Waiter::with(limit(), strategy, true);
            assert_eq!(waiter.polling.polls, 0);
            assert_ne!(waiter.strategy, WaitStrategy::Spin);
        }
    }

    #[test]
    fn a_sleep_counts_towards_the_limit() {
        let mut waiter = Waiter::new(WaitLimit::from_seconds(0.002));
        let before_ns = monotonic_ns();
        while !waiter.sleep() {}
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
