//! Measurement of wake-up latency: a thread sleeps at 1 kHz until absolute deadlines, with and without other work.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use hil_facts::results::latency::percentiles::Percentiles;
use hil_facts::results::latency::times::Times;
use hil_session::clock::monotonic_ns;
use rustix::io::Errno;
use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec};
use serde_json::json;

use super::{Class, ExactTimers, Pinned, jitter_grade, remark, shown};
use crate::cores::CoreList;
use crate::finding::{Check, Finding};
use crate::tree::Root;

/// Time between two deadlines, in ns.
const PERIOD_NS: u64 = 1_000_000;
/// Number of initial wake-ups that are discarded because the caches are still cold.
const WARM_UP: u32 = 20;
/// Number of words that the load writes to: more than a core's own cache holds.
const LOAD_WORDS: usize = 1 << 19;

/// Lateness of the wake-ups.
#[derive(Clone, Debug)]
pub(crate) struct WakeUps {
    lateness_ns: Times,
    /// Number of deadlines that passed during the delay of an earlier one; each delay counts once.
    missed: u64,
}

/// Sleeps until consecutive deadlines and measures the lateness.
///
/// # Errors
/// If the thread may not run on that core.
pub(crate) fn measure(core: u32, seconds: f64) -> io::Result<WakeUps> {
    let _pinned = Pinned::to(core)?;
    let _exact = ExactTimers::set()?;
    let mut wake_ups = WakeUps {
        lateness_ns: Times::default(),
        missed: 0,
    };
    let mut due_ns = monotonic_ns() + PERIOD_NS;
    let end_ns = due_ns + (seconds * 1e9) as u64;
    let mut count = 0;
    while due_ns < end_ns {
        sleep_until(due_ns)?;
        let now_ns = monotonic_ns();
        let late_ns = now_ns.saturating_sub(due_ns);
        let missed = late_ns / PERIOD_NS;
        due_ns += (missed + 1) * PERIOD_NS;
        wake_ups.missed += missed;
        count += 1;
        if count > WARM_UP {
            wake_ups.lateness_ns.record(late_ns);
        }
    }
    Ok(wake_ups)
}

fn sleep_until(due_ns: u64) -> io::Result<()> {
    let due = Timespec {
        tv_sec: (due_ns / 1_000_000_000).cast_signed(),
        tv_nsec: (due_ns % 1_000_000_000).cast_signed(),
    };
    loop {
        match clock_nanosleep_absolute(ClockId::Monotonic, &due) {
            Err(Errno::INTR) => {}
            other => return Ok(other?),
        }
    }
}

/// Grades the wake-ups by the latest one, because a single late step matters.
pub(crate) fn finding(
    check: Check,
    wake_ups: &WakeUps,
    core: u32,
    seconds: f64,
    class: Class,
) -> Finding {
    let figures = Percentiles::of(&wake_ups.lateness_ns);
    if figures.count == 0 {
        return check.unknown(format!("core {core} did not wake up within {seconds} s"));
    }
    let text = format!("{}{}", shown(&figures), remark(figures.max));
    (check.graded(jitter_grade(figures.max), text)).measured(json!({
        "core": core,
        "seconds": seconds,
        "class": class.to_string(),
        "rate_hz": 1_000_000_000 / PERIOD_NS,
        "timer_slack_ns": ExactTimers::SLACK_NS,
        "missed": wake_ups.missed,
        "lateness_ns": figures,
    }))
}

/// Ordinary work on every core, until this value is dropped.
#[derive(Debug)]
pub(crate) struct Load {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<Option<Class>>>,
}

impl Load {
    /// Starts one thread per core, each of which computes and writes to memory continuously.
    pub(crate) fn on(cores: &CoreList) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let start = |core| {
            let stop = Arc::clone(&stop);
            std::thread::spawn(move || {
                // If pinning is not allowed the kernel places the thread; the core is busy in either case.
                let _pinned = Pinned::to(core);
                let class = Class::of_this_thread(&Root::machine()).ok();
                if class.is_some_and(|class| !class.is_real_time()) {
                    work(&stop);
                }
                class
            })
        };
        let threads = cores.iter().map(start).collect();
        Self { stop, threads }
    }

    /// Ends the load; returns `true` if all of it ran at ordinary priority. Threads with real-time priority do no work,
    /// because they would block the measuring thread.
    #[must_use]
    pub(crate) fn end(self) -> bool {
        self.stop.store(true, Ordering::Relaxed);
        let ordinary = |thread: JoinHandle<Option<Class>>| {
            let class = thread.join().ok().flatten();
            class.is_some_and(|class| !class.is_real_time())
        };
        // All threads are joined, even after one that was not ordinary.
        let all: Vec<bool> = self.threads.into_iter().map(ordinary).collect();
        all.into_iter().all(|ordinary| ordinary)
    }
}

fn work(stop: &AtomicBool) {
    let mut words = vec![1_u64; LOAD_WORDS];
    let mut sum = 0_u64;
    while !stop.load(Ordering::Relaxed) {
        // Short enough to react to a stop request soon.
        for word in &mut words {
            sum = sum
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(*word);
            *word = sum;
        }
        std::hint::black_box(sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checks::WAKE_UP_IDLE;
    use crate::finding::Grade;
    use rustix::thread::sched_getaffinity;

    fn class() -> Class {
        Class::of_this_thread(&Root::machine()).expect("told")
    }

    fn wake_ups(lateness_ns: &[u64]) -> WakeUps {
        let mut all = Times::default();
        for ns in lateness_ns {
            all.record(*ns);
        }
        WakeUps {
            lateness_ns: all,
            missed: 0,
        }
    }

    #[test]
    fn the_latest_wake_up_decides() {
        for (latest_ns, grade, expected) in [
            (19_000, Grade::Good, "p50 3.00 us, p99 3.00 us, max 19"),
            (45_000, Grade::Fair, "max 45"),
            (300_000, Grade::Poor, "max 300 us"),
            (24_000_000, Grade::Poor, "ms: unfit for real time"),
        ] {
            let mut all = vec![3_000; 999];
            all.push(latest_ns);
            let finding = finding(WAKE_UP_IDLE, &wake_ups(&all), 1, 1.0, class());
            assert_eq!(finding.grade, grade, "{latest_ns}");
            assert!(finding.found.contains(expected), "{}", finding.found);
            let figures = &finding.measured.expect("measured")["lateness_ns"];
            assert_eq!(
                (&figures["count"], &figures["max"]),
                (&1000.into(), &latest_ns.into())
            );
        }
    }

    #[test]
    fn without_wake_ups_there_is_no_grade() {
        let finding = finding(WAKE_UP_IDLE, &wake_ups(&[]), 1, 1.0, class());
        assert_eq!(finding.grade, Grade::Unknown);
    }

    #[test]
    fn every_deadline_is_met_or_counted_as_missed() {
        let mask = sched_getaffinity(None).expect("told");
        let core = (0..64).find(|core| mask.is_set(*core)).expect("a core") as u32;
        let wake_ups = measure(core, 0.2).expect("measured");
        let (woken, missed) = (wake_ups.lateness_ns.len(), wake_ups.missed);
        // 200 deadlines; the last delay may extend beyond the end.
        assert!(
            woken + missed + u64::from(WARM_UP) >= 200,
            "{woken} {missed}"
        );
        assert!(woken <= 180, "{woken}");
    }

    #[test]
    fn a_load_runs_until_its_end() {
        let before_ns = monotonic_ns();
        let load = Load::on(&CoreList::parse("0"));
        assert_eq!(load.threads.len(), 1);
        let ordinary = load.end();
        assert_eq!(ordinary, !class().is_real_time());
        assert!(monotonic_ns() > before_ns);
    }
}
