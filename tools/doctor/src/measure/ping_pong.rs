//! Ping-pong: the time that two cores take to exchange a number through memory, which is a lower bound for any
//! exchange between plant and controller.
//!
//! Two threads use two atomics on separate cache lines, and both spin: no link, process or payload of the project is
//! involved.

use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc;

use hil_facts::results::latency::percentiles::Percentiles;
use hil_facts::results::latency::times::Times;
use hil_session::clock::monotonic_ns;
use serde_json::json;

use super::{Class, Pinned, shown};
use crate::checks::PING_PONG;
use crate::finding::{Finding, Grade};

/// Number of discarded round trips, which find cold caches.
const WARM_UP: u64 = 1_000;
/// Number of polls between two checks of the clock while an answer is late.
const POLLS: u32 = 1_024;
/// Limit for an answer, in ns: the partner may lose its core for a while.
const GIVE_UP_NS: u64 = 5_000_000_000;
/// Number that stops the partner.
const END: u64 = u64::MAX;

/// Median in ns below which the cores share a cache.
const NEAR_NS: u64 = 500;
/// Median in ns below which the cores are at least in one package.
const FAR_NS: u64 = 1_000;

/// Number on its own cache line, padded because some processors fetch lines in pairs.
#[repr(align(128))]
#[derive(Default)]
struct Line(AtomicU64);

#[derive(Default)]
struct Pair {
    there: Line,
    back: Line,
}

/// Exchanges a number between two cores repeatedly; returns the round-trip times in ns.
///
/// # Errors
/// If a thread may not run on its core.
pub(crate) fn measure(cores: [u32; 2], seconds: f64) -> io::Result<Times> {
    let pair = Pair::default();
    std::thread::scope(|scope| {
        let (ready, is_ready) = mpsc::channel();
        let answers = &pair;
        scope.spawn(move || {
            let pinned = Pinned::to(cores[1]);
            let runs = pinned.is_ok();
            let _ = ready.send(pinned.as_ref().map(|_| ()).map_err(io::Error::kind));
            if runs {
                answer(answers);
            }
        });
        let Ok(Ok(())) = is_ready.recv() else {
            return Err(io::ErrorKind::InvalidInput.into());
        };
        let result = Pinned::to(cores[0]).map(|_pinned| ask(&pair, seconds));
        pair.there.0.store(END, Ordering::Release);
        result
    })
}

fn answer(pair: &Pair) {
    let mut last = 0;
    loop {
        let number = pair.there.0.load(Ordering::Acquire);
        if number == END {
            return;
        }
        if number != last {
            pair.back.0.store(number, Ordering::Release);
            last = number;
        }
        std::hint::spin_loop();
    }
}

fn ask(pair: &Pair, seconds: f64) -> Times {
    let mut trips_ns = Times::default();
    let mut asked_ns = monotonic_ns();
    let end_ns = asked_ns + (seconds * 1e9) as u64;
    for number in 1.. {
        pair.there.0.store(number, Ordering::Release);
        if !answered(pair, number) {
            break;
        }
        // Each trip starts at the end of the previous one, so each includes one reading of the clock.
        let now_ns = monotonic_ns();
        if number > WARM_UP {
            trips_ns.record(now_ns - asked_ns);
        }
        if now_ns >= end_ns {
            break;
        }
        asked_ns = now_ns;
    }
    trips_ns
}

fn answered(pair: &Pair, number: u64) -> bool {
    let mut since_ns = None;
    loop {
        for _ in 0..POLLS {
            if pair.back.0.load(Ordering::Acquire) == number {
                return true;
            }
            std::hint::spin_loop();
        }
        let now_ns = monotonic_ns();
        if now_ns - *since_ns.get_or_insert(now_ns) > GIVE_UP_NS {
            return false;
        }
    }
}

/// Grades the exchange by its median, which shows the distance of the cores.
pub(crate) fn finding(trips_ns: &Times, cores: [u32; 2], seconds: f64, class: Class) -> Finding {
    let figures = Percentiles::of(trips_ns);
    let grade = match figures.p50 {
        _ if figures.count == 0 => return PING_PONG.unknown("no answer came"),
        0..NEAR_NS => Grade::Good,
        NEAR_NS..FAR_NS => Grade::Fair,
        _ => Grade::Poor,
    };
    (PING_PONG.graded(grade, shown(&figures))).measured(json!({
        "cores": cores,
        "seconds": seconds,
        "class": class.to_string(),
        "exchange": "one atomic each way between two spinning threads",
        "round_trip_ns": figures,
    }))
}

/// Returns the finding for a machine with only one core.
pub(crate) fn impossible() -> Finding {
    PING_PONG.unknown("needs two cores")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tree::Root;

    #[test]
    fn the_median_trip_decides() {
        let class = Class::of_this_thread(&Root::machine()).expect("told");
        for (trips_ns, grade) in [
            ([150, 180, 9_000_000], Grade::Good),
            ([150, 700, 800], Grade::Fair),
            ([400, 1_500, 1_600], Grade::Poor),
        ] {
            let mut all = Times::default();
            for ns in trips_ns {
                all.record(ns);
            }
            let finding = finding(&all, [0, 1], 1.0, class);
            assert_eq!(finding.grade, grade, "{trips_ns:?}");
        }
        assert_eq!(
            finding(&Times::default(), [0, 1], 1.0, class).grade,
            Grade::Unknown
        );
    }

    #[test]
    fn every_number_comes_back() {
        let pair = Pair::default();
        std::thread::scope(|scope| {
            scope.spawn(|| answer(&pair));
            for number in 1..=100 {
                pair.there.0.store(number, Ordering::Release);
                assert!(answered(&pair, number));
            }
            pair.there.0.store(END, Ordering::Release);
        });
    }

    #[test]
    fn a_nonexistent_core_is_an_error_and_not_a_hang() {
        assert!(measure([0, u32::MAX], 0.1).is_err());
        assert!(measure([u32::MAX, 0], 0.1).is_err());
    }
}
