use std::cell::RefCell;
use std::rc::Rc;

use super::*;

fn limit() -> WaitLimit {
    WaitLimit::from_seconds(5.0)
}

/// Reads the number of times that the calling thread has slept.
fn sleeps() -> u64 {
    let status = std::fs::read_to_string("/proc/thread-self/status").expect("reads");
    let line = (status.lines()).find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"));
    line.and_then(|count| count.trim().parse().ok())
        .expect("a count")
}

const MS: u64 = 1_000_000;

/// Bell that logs its calls.
#[derive(Clone, Debug, Default)]
struct Log(Rc<RefCell<Vec<String>>>);

impl Sleeper for Log {
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
fn a_sleep_is_announced_before_the_last_poll() {
    let log = Log::default();
    let mut waiter = Waiter::with(limit(), WaitStrategy::Sleep, false);
    waiter.sleep_on(Some(Box::new(log.clone())));
    assert!(!waiter.pause()); // then one looks
    assert!(!waiter.pause());
    assert!(!waiter.pause());
    waiter.done(); // it came at the last look
    let expected = ["announce", "sleep 7 100", "retire", "announce", "retire"];
    assert_eq!(*log.0.borrow(), expected);
    // Too close to a deadline for the announced sleep.
    assert!(!waiter.pause_until(monotonic_ns() + 1000 * MS));
    assert!(!waiter.pause_until(0));
    assert_eq!(log.0.borrow()[5..], ["announce", "retire"]);
}

#[test]
fn a_wait_ends_at_its_limit_and_only_a_long_one_sleeps() {
    for strategy in WaitStrategy::ALL {
        let limit = WaitLimit::from_seconds(0.01);
        let mut waiter = Waiter::with(limit, strategy, false);
        let (before_ns, slept) = (monotonic_ns(), sleeps());
        while !waiter.pause() {}
        assert!(monotonic_ns() - before_ns >= limit.ns());
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
    const SLICE: Rest = Rest::Sleep(SLICE_NS);
    for (strategy, waited_ns, left_ns, naps, sleeps) in [
        (Hybrid, 4 * MS - 1, u64::MAX, Rest::Yield, Rest::Yield),
        (Hybrid, 4 * MS, u64::MAX, NAP, SLICE),
        (Hybrid, 19 * MS, 4 * MS, NAP, Rest::Sleep(3_700_000)),
        (
            Hybrid,
            19 * MS,
            350_000,
            Rest::Sleep(50_000),
            Rest::Sleep(50_000),
        ),
        (Hybrid, 19 * MS, 300_000, Rest::Yield, Rest::Yield),
        (Hybrid, 20 * MS, 140 * MS, LONG_NAP, Rest::Sleep(50 * MS)),
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
        let case = (strategy.name(), waited_ns, left_ns);
        assert_eq!(waiter.rest(now_ns, deadline_ns), naps, "{case:?}");
        waiter.sleep_on(Some(Box::new(Log::default())));
        assert_eq!(waiter.rest(now_ns, deadline_ns), sleeps, "{case:?}");
    }
}

#[test]
fn a_hybrid_wait_under_contention_sleeps_at_once_if_it_can_be_woken() {
    let mut waiter = Waiter::with(limit(), WaitStrategy::Hybrid, false);
    (waiter.since_ns, waiter.limited_ns) = (1, 1);
    waiter.company.until_ns = MS;
    assert_eq!(waiter.rest(1, u64::MAX), Rest::Yield);
    waiter.sleep_on(Some(Box::new(Log::default())));
    assert_eq!(waiter.rest(1, u64::MAX), Rest::Sleep(SLICE_NS));
    assert_eq!(waiter.rest(MS, u64::MAX), Rest::Yield);
    // After a release the answer is polled for, unless both sides share one core.
    waiter.follows_time = true;
    assert_eq!(waiter.rest(100_000, u64::MAX), Rest::Spin);
    assert_eq!(waiter.rest(100_001, u64::MAX), Rest::Sleep(SLICE_NS));
    waiter.polling = Polling::new(true);
    assert_eq!(waiter.rest(100_000, u64::MAX), Rest::Sleep(SLICE_NS));
}

#[test]
fn a_hybrid_wait_with_priority_sleeps_until_shortly_before_its_likely_end() {
    let waiter = |has_priority: bool| {
        let mut waiter = Waiter::with(limit(), WaitStrategy::Hybrid, false).of_a_loop(has_priority);
        (waiter.since_ns, waiter.limited_ns) = (1, 1);
        waiter.sleep_on(Some(Box::new(Log::default())));
        waiter
    };
    let rest = |waiter: &Waiter, waited_us: u64| waiter.rest(1 + 1000 * waited_us, u64::MAX);
    let waited = |waiter: &mut Waiter, ns| {
        (0..4).for_each(|_| waiter.length.as_mut().expect("a loop's").waited(ns));
    };
    let (mut with, mut without) = (waiter(true), waiter(false));
    for waiter in [&mut with, &mut without] {
        assert_eq!(rest(waiter, 0), Rest::Yield);
        waited(waiter, 10 * MS);
    }
    assert_eq!(rest(&with, 0), Rest::Sleep(9_800_000));
    assert_eq!(rest(&with, 9_000), Rest::Sleep(800_000));
    assert_eq!(with.rest(1, 1 + MS), Rest::Sleep(700_000), "a deadline");
    // Awake for 4 ms from then on, as ordinary loops are from the beginning.
    assert_eq!(rest(&with, 9_800), Rest::Yield);
    assert_eq!(rest(&with, 13_799), Rest::Yield);
    assert_eq!(rest(&with, 13_800), Rest::Sleep(SLICE_NS));
    assert_eq!(rest(&without, 3_999), Rest::Yield);
    assert_eq!(rest(&without, 4_000), Rest::Sleep(SLICE_NS));
    // No contention.
    for waiter in [&mut with, &mut without] {
        waiter.company.until_ns = u64::MAX;
    }
    assert_eq!(rest(&with, 9_800), Rest::Yield);
    assert_eq!(with.early_ns(1), EARLY_NS);
    assert_eq!(rest(&without, 0), Rest::Sleep(SLICE_NS));
    // A sleep without a timer would be too long.
    waited(&mut with, 150 * MS);
    assert_eq!(rest(&with, 0), Rest::Sleep(50 * MS));
    with.sleep_on(None);
    assert_eq!(rest(&with, 0), Rest::Yield, "nothing could wake it");
}

#[test]
fn a_loop_learns_from_each_wait() {
    let mut waiter = Waiter::with(limit(), WaitStrategy::Hybrid, false).of_a_loop(false);
    let long_wait = |waiter: &mut Waiter| {
        let begin_ns = monotonic_ns();
        while monotonic_ns() < begin_ns + MS {
            assert!(!waiter.pause());
        }
        waiter.done();
    };
    for _ in 0..4 {
        assert!(!waiter.sleep_is_cheap());
        long_wait(&mut waiter);
    }
    assert!(waiter.sleep_is_cheap());
    // A wait that polls end.
    waiter.polling = Polling::new(false);
    assert!(!waiter.pause());
    waiter.done();
    assert!(!waiter.sleep_is_cheap());
    // A timed wait makes a sleep cheap in the next wait, and only there, even after one for the recorder.
    let has_waited = (0..100).any(|_| {
        assert!(!waiter.sleep());
        waiter.until_ns(monotonic_ns() + MS, || false);
        waiter.follows_time
    });
    assert!(has_waited);
    waiter.done();
    assert!(waiter.sleep_is_cheap());
    assert!(!waiter.pause());
    waiter.done();
    assert!(!waiter.sleep_is_cheap());
}

#[test]
fn a_release_is_awaited_awake_except_by_a_hybrid_wait_under_contention() {
    use WaitStrategy::{Hybrid, Sleep, Spin, Yield};
    for (strategy, alone_ns, in_company_ns) in [
        (Hybrid, 200_000, 0),
        (Yield, 200_000, 200_000),
        (Sleep, 200_000, 200_000),
        (Spin, 20 * MS, 20 * MS),
    ] {
        let mut waiter = Waiter::with(limit(), strategy, false);
        assert_eq!(waiter.early_ns(1), alone_ns);
        waiter.company.until_ns = 2;
        assert_eq!(waiter.early_ns(1), in_company_ns);
    }
}

#[test]
fn no_side_polls_if_both_share_one_core() {
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
fn a_timed_wait_does_not_end_early() {
    for strategy in WaitStrategy::ALL {
        let target_ns = monotonic_ns() + 1_000_000;
        let mut waiter = Waiter::with(limit(), strategy, false);
        waiter.until_ns(target_ns, || false);
        assert!(monotonic_ns() >= target_ns);
        waiter.until_ns(u64::MAX, || true);
    }
}
