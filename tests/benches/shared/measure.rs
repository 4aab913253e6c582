//! What every bench needs: medians, percentiles, cores, and how busy the machine was otherwise.

use std::fs;

use rustix::thread::{CpuSet, sched_getaffinity};
use serde_json::{Value, json};

/// The middle of some values.
///
/// # Panics
/// If there are none.
pub(crate) fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    if values.len() % 2 == 1 {
        values[middle]
    } else {
        0.5 * (values[middle - 1] + values[middle])
    }
}

/// The cores that this process may run on.
pub(crate) fn cores() -> Vec<usize> {
    let allowed = sched_getaffinity(None).expect("Linux tells the cores of a process");
    (0..CpuSet::MAX_CPU)
        .filter(|&core| allowed.is_set(core))
        .collect()
}

/// What the numbers of a bench were measured on.
pub(crate) fn machine() -> Value {
    let cpu = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = (cpu.lines().find(|line| line.starts_with("model name")))
        .and_then(|line| line.split_once(": "))
        .map_or("unknown", |(_, model)| model);
    let kernel = rustix::system::uname();
    json!({
        "cpu": model,
        "cores": cores().len(),
        "kernel": kernel.release().to_string_lossy(),
        "machine": kernel.machine().to_string_lossy(),
    })
}

/// Processor time of this machine so far.
pub(crate) struct Bystanders {
    busy_ticks: u64,
    own_ticks: u64,
    all_ticks: u64,
}

impl Bystanders {
    /// Begins to watch.
    pub(crate) fn watch() -> Self {
        let stat = fs::read_to_string("/proc/stat").unwrap_or_default();
        let first = stat.lines().next().unwrap_or_default();
        // cpu user nice system idle iowait irq softirq steal
        let ticks: Vec<u64> = (first.split_ascii_whitespace().skip(1).take(8))
            .filter_map(|word| word.parse().ok())
            .collect();
        let all_ticks: u64 = ticks.iter().sum();
        let idle_ticks: u64 = ticks.iter().skip(3).take(2).sum();
        let own = fs::read_to_string("/proc/self/stat").unwrap_or_default();
        let (_, own) = own.rsplit_once(')').unwrap_or_default();
        // user and system time of this process, then of the children that it waited for
        let own_ticks = (own.split_ascii_whitespace().skip(11).take(4))
            .filter_map(|word| word.parse::<u64>().ok())
            .sum();
        Self {
            busy_ticks: all_ticks - idle_ticks,
            own_ticks,
            all_ticks,
        }
    }

    /// The share of all cores that other programs took since then, 0 to 1.
    pub(crate) fn share(&self) -> f64 {
        let now = Self::watch();
        let others = (now.busy_ticks - self.busy_ticks) as f64
            - now.own_ticks.saturating_sub(self.own_ticks) as f64;
        let all = (now.all_ticks - self.all_ticks) as f64;
        if others > 0.0 && all > 0.0 {
            others / all
        } else {
            0.0
        }
    }
}
