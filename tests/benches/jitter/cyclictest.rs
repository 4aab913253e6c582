//! `cyclictest` of rt-tests, if the machine has it.

use std::process::Command;

use crate::{Class, Jitter, PRIORITY, Setting};

/// Maximum number of classes in a histogram; beyond it, classes are a microsecond wide instead of a nanosecond.
const MOST_CLASSES: u64 = 1_000_000;

/// The program.
pub(crate) struct Cyclictest;

impl Cyclictest {
    /// Returns the program, if it can be started.
    pub(crate) fn found() -> Option<Self> {
        let help = Command::new("cyclictest").arg("--help").output();
        help.is_ok().then_some(Self)
    }

    /// Measures how late the program wakes up.
    ///
    /// # Panics
    /// If it does not run to its end or says something else than a histogram.
    pub(crate) fn measure(&self, setting: &Setting) -> Jitter {
        let mut command = Command::new("cyclictest");
        // Quiet, with locked memory, one thread; its own tuning of idle states as it comes.
        command.args(["--quiet", "--mlockall", "--threads=1"]);
        let class_ns = if setting.hole_ns() > MOST_CLASSES {
            1000
        } else {
            command.arg("--nsecs");
            1
        };
        command.arg(format!("--affinity={}", setting.core));
        command.arg(format!("--interval={}", setting.period_ns() / 1000));
        command.arg(format!("--loops={}", setting.samples));
        command.arg(format!("--histogram={}", setting.hole_ns() / class_ns));
        match setting.class {
            // With a priority, even of 0, it would take the real-time class.
            Class::Other => command.arg("--policy=other"),
            Class::Fifo => command
                .arg("--policy=fifo")
                .arg(format!("--priority={PRIORITY}")),
        };
        let output = command.output().expect("cyclictest");
        assert!(output.status.success(), "{command:?}: {}", output.status);
        let text = String::from_utf8_lossy(&output.stdout);
        let scaled = |(late, count)| (late * class_ns, count);
        let histogram: Vec<(u64, u64)> = text.lines().filter_map(bucket).map(scaled).collect();
        let overflows = text
            .lines()
            .find_map(|line| line.strip_prefix("# Histogram Overflows:"));
        let holes: u64 = (overflows.and_then(|count| count.trim().parse().ok()))
            .unwrap_or_else(|| panic!("{command:?} tells no overflows"));
        Jitter {
            p50_ns: percentile(&histogram, 0.5),
            p99_ns: percentile(&histogram, 0.99),
            p999_ns: percentile(&histogram, 0.999),
            // It leaves out the releases that it slept through: each overflow is a hole.
            holes_hz: holes as f64 / setting.seconds(),
            removed: holes as f64 / setting.samples as f64,
        }
    }
}

/// A line of the histogram: a lateness and how often it occurred.
fn bucket(line: &str) -> Option<(u64, u64)> {
    let (late, count) = line.split_once(' ')?;
    Some((late.parse().ok()?, count.parse().ok()?))
}

/// Returns the smallest lateness that this share of the samples does not exceed.
fn percentile(histogram: &[(u64, u64)], share: f64) -> f64 {
    let all: u64 = histogram.iter().map(|(_, count)| count).sum();
    let wanted = (share * all as f64).ceil() as u64;
    let mut seen = 0;
    let reached = histogram.iter().find(|(_, count)| {
        seen += count;
        seen >= wanted
    });
    reached.map_or(f64::NAN, |(late_ns, _)| *late_ns as f64)
}
