//! Functions that every bench needs: medians, percentiles, cores, and the load of the machine by other programs.

use std::fs;

use hil_facts::results::company::ProcessorTime;
use rustix::thread::{CpuSet, sched_getaffinity};
use serde_json::{Value, json};

/// Returns the median of some values.
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

/// Returns the cores on which this process may run.
pub(crate) fn cores() -> Vec<usize> {
    let allowed = sched_getaffinity(None).expect("Linux tells the cores of a process");
    (0..CpuSet::MAX_CPU)
        .filter(|&core| allowed.is_set(core))
        .collect()
}

/// Describes the machine on which a bench was measured.
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

/// Measures how much of the cores other programs use.
pub(crate) struct Bystanders(ProcessorTime);

impl Bystanders {
    /// Begins to measure.
    pub(crate) fn watch() -> Self {
        Self(ProcessorTime::now())
    }

    /// Returns the share of the cores used by other programs since the start, 0 to 1.
    pub(crate) fn share(&self) -> f64 {
        ProcessorTime::now().others_share(&self.0)
    }
}
