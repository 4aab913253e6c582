//! Measurement of gaps in the time of a thread that never sleeps; any of them could have delayed a step.
//!
//! The thread reads the clock continuously. If two readings are far apart, something else used the core in between: an
//! interrupt, another thread, firmware or a hypervisor.

use std::io;

use hil_console::terminal::duration::shown_ns;
use hil_facts::results::latency::grade::{EXCELLENT_BELOW_NS, GOOD_BELOW_NS, UNFIT_NS};
use hil_session::clock::monotonic_ns;
use serde::Serialize;
use serde_json::json;

use crate::checks::GAPS;
use crate::finding::Finding;
use crate::measure::{Class, Pinned, jitter_grade, remark};
use crate::tree::{Root, Tree};

/// Lower limits of the classes of gaps; shorter gaps do not count. The three in the middle are the limits of the
/// grades.
pub const CLASSES_NS: [u64; 5] = [
    5_000,
    EXCELLENT_BELOW_NS,
    GOOD_BELOW_NS,
    UNFIT_NS,
    5_000_000,
];

/// Gaps on one core.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Gaps {
    /// Number of the core.
    pub core: u32,
    /// Observed time, in ns.
    pub watched_ns: u64,
    /// Mean duration of a clock reading without a gap, in ns.
    pub reading_ns: f64,
    /// Total length of the gaps, in ns.
    pub lost_ns: u64,
    /// Longest gap, in ns.
    pub longest_ns: u64,
    /// Number of gaps in each class of [`CLASSES_NS`].
    pub holes: [u64; CLASSES_NS.len()],
    /// Number of switches to other threads during the measurement, if the kernel reports it.
    pub switches: Option<u64>,
}

/// Measures the gaps on a core.
///
/// # Errors
/// If the thread may not run on that core.
pub fn measure(core: u32, seconds: f64) -> io::Result<Gaps> {
    let _pinned = Pinned::to(core)?;
    let switches_before = involuntary_switches();
    let watch_ns = (seconds * 1e9) as u64;
    let gaps = watch(core, watch_ns, monotonic_ns);
    let switches = involuntary_switches();
    Ok(Gaps {
        switches: (switches.zip(switches_before)).map(|(after, before)| after - before),
        ..gaps
    })
}

/// Collects the gaps between the readings of a clock.
fn watch(core: u32, watch_ns: u64, mut clock_ns: impl FnMut() -> u64) -> Gaps {
    let mut holes = [0; CLASSES_NS.len()];
    let (mut lost_ns, mut longest_ns, mut readings) = (0, 0, 0_u64);
    let start_ns = clock_ns();
    let mut last_ns = start_ns;
    while last_ns - start_ns < watch_ns {
        let now_ns = clock_ns();
        let step_ns = now_ns - last_ns;
        last_ns = now_ns;
        readings += 1;
        if step_ns >= CLASSES_NS[0] {
            let class = CLASSES_NS.iter().rposition(|from| step_ns >= *from);
            holes[class.unwrap_or_default()] += 1;
            lost_ns += step_ns;
            longest_ns = longest_ns.max(step_ns);
        }
    }
    let watched_ns = last_ns - start_ns;
    let whole = readings - holes.iter().sum::<u64>();
    Gaps {
        core,
        watched_ns,
        reading_ns: (watched_ns - lost_ns) as f64 / whole.max(1) as f64,
        lost_ns,
        longest_ns,
        holes,
        switches: None,
    }
}

fn involuntary_switches() -> Option<u64> {
    let status = Root::machine().read("proc/thread-self/status").ok()?;
    let count = (status.lines()).find_map(|l| l.strip_prefix("nonvoluntary_ctxt_switches:"))?;
    count.trim().parse().ok()
}

/// Grades the gaps by the longest one.
#[must_use]
pub fn finding(gaps: &[Gaps], seconds: f64, class: Class) -> Finding {
    let Some(longest_ns) = gaps.iter().map(|gaps| gaps.longest_ns).max() else {
        return GAPS.unknown("no core was watched");
    };
    let lost: u64 = gaps.iter().map(|gaps| gaps.lost_ns).sum();
    let watched: u64 = gaps.iter().map(|gaps| gaps.watched_ns).sum();
    let percent = 100.0 * lost as f64 / watched.max(1) as f64;
    let longest = shown_ns(longest_ns);
    let text = format!(
        "longest {longest}, {percent:.2} % of the time lost{}",
        remark(longest_ns)
    );
    (GAPS.graded(jitter_grade(longest_ns), text)).measured(json!({
        "seconds": seconds,
        "class": class.to_string(),
        "classes_from_ns": CLASSES_NS,
        "cores": gaps,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Grade;

    /// Creates a clock that advances 40 ns per reading, and additionally by the given times at the given readings.
    fn clock(holes: &[(u64, u64)]) -> impl FnMut() -> u64 {
        let holes = holes.to_vec();
        let (mut reading, mut now_ns) = (0, 0);
        move || {
            let hole = holes.iter().find(|(at, _)| *at == reading);
            now_ns += hole.map_or(40, |(_, ns)| *ns);
            reading += 1;
            now_ns
        }
    }

    #[test]
    fn every_hole_is_counted_in_its_class() {
        let holes = [
            (10, 4_999),
            (20, 5_000),
            (30, 19_999),
            (40, 20_000),
            (50, 60_000),
            (60, 500_000),
            (70, 13_000_000),
        ];
        let gaps = watch(3, 20_000_000, clock(&holes));
        assert_eq!(gaps.holes, [2, 1, 1, 1, 1]);
        assert_eq!(gaps.longest_ns, 13_000_000);
        assert_eq!(
            gaps.lost_ns,
            5_000 + 19_999 + 20_000 + 60_000 + 500_000 + 13_000_000
        );
        assert!((20_000_000..20_000_040).contains(&gaps.watched_ns));
        // One reading of 4999 ns among some 160 000 of 40 ns.
        assert!((gaps.reading_ns - 40.0).abs() < 0.1, "{}", gaps.reading_ns);
    }

    #[test]
    fn the_longest_hole_of_all_cores_decides() {
        let class = Class::of_this_thread(&Root::machine()).expect("told");
        for (longest_ns, grade, expected) in [
            (0, Grade::Good, "longest 0 ns, 0.00 % of the time lost"),
            (
                9_000,
                Grade::Good,
                "longest 9.00 us, 0.45 % of the time lost",
            ),
            (
                30_000,
                Grade::Fair,
                "longest 30.0 us, 1.48 % of the time lost",
            ),
            (
                2_000_000,
                Grade::Poor,
                "longest 2.00 ms, 50.00 % of the time lost: unfit for real time",
            ),
        ] {
            let quiet = watch(0, 1_000_000, clock(&[]));
            let holes = [(100, longest_ns)];
            let other = clock(if longest_ns > 0 { &holes } else { &[] });
            // A hole at the end of a millisecond extends the observation by its length.
            let gaps = [quiet, watch(1, 1_000_000 + longest_ns, other)];
            let finding = finding(&gaps, 0.001, class);
            assert_eq!((finding.grade, finding.found.as_str()), (grade, expected));
        }
        assert_eq!(finding(&[], 1.0, class).grade, Grade::Unknown);
    }
}
