//! Real-time settings of a loop: requested and granted.
//!
//! Each process applies its own settings to the thread that runs its loop, just before the loop, when its other threads
//! already exist: those keep ordinary scheduling on any core. A refused setting does not end a run: refusals are listed
//! in a [`Report`], which the launcher displays. Granted values are read back from the system.

mod memory;
mod scheduling;

use rustix::thread::{CpuSet, sched_getaffinity, set_current_timer_slack};

use crate::waiter::Waiter;
pub use scheduling::{only_core, pin};
use shared_types::realtime::{Granted, Report, Settings};
use shared_types::wait::{WaitLimit, WaitStrategy};

/// Applies all settings to the calling thread and its process, and reads the result back.
///
/// 1. Timers become exact: a short sleep lasts as long as requested.
/// 2. The thread moves to its core.
/// 3. Memory is locked and faulted in, which takes a while, still with ordinary scheduling.
/// 4. The priority comes last.
#[must_use]
pub fn apply(settings: &Settings) -> Report {
    let before = sched_getaffinity(None).ok();
    let _ = set_current_timer_slack(std::num::NonZeroU64::new(1)); // read back below
    let pinned = settings.core.map_or(Ok(()), pin);
    let result = memory::keep(settings.lock_memory, settings.prefault);
    let raised = match settings.priority {
        0 => Ok(()),
        priority => scheduling::run_at(priority),
    };

    let core = scheduling::only_core();
    let cores = cores(settings, before.as_ref(), core);
    let shares_core = cores <= 1;
    let wait = match settings.wait {
        WaitStrategy::Spin if shares_core => WaitStrategy::Hybrid,
        wait => wait,
    };
    Report {
        core: match settings.core {
            None => Granted::new(core, core, None),
            requested => Granted::new(requested, core, pinned.err().map(|e| e.to_string())),
        },
        priority: Granted::new(settings.priority, scheduling::priority(), raised.err()),
        lock_memory: Granted::new(
            settings.lock_memory,
            memory::is_locked(),
            (result.clone().err()).or_else(|| Some("locking loads it as well".into())),
        ),
        prefault: Granted::new(
            settings.prefault,
            settings.prefault && memory::is_at_hand(),
            result.err(),
        ),
        wait: Granted::new(
            settings.wait,
            wait,
            Some("plant and controller share their only core".into()),
        ),
        timer_slack_ns: rustix::thread::current_timer_slack().unwrap_or(u64::MAX),
        shares_core,
    }
}

/// Counts the cores that both sides may use together. A side without a core of its own may use the cores that this
/// process had `before`, because both were started in the same way.
fn cores(settings: &Settings, before: Option<&CpuSet>, core: Option<u32>) -> usize {
    let free = |set: &CpuSet| {
        (0..CpuSet::MAX_CPU)
            .filter(|core| set.is_set(*core))
            .collect()
    };
    let free: Vec<usize> = before.map(free).unwrap_or_default();
    let of = |core: Option<u32>| core.map_or_else(|| free.clone(), |core| vec![core as usize]);
    let mut cores = of(core);
    cores.extend(of(settings.peer_core));
    cores.sort_unstable();
    cores.dedup();
    cores.len()
}

/// Returns a waiter with the granted strategy.
#[must_use]
pub fn waiter(report: &Report, limit: WaitLimit) -> Waiter {
    let waiter = Waiter::with(limit, report.wait.granted, report.shares_core);
    waiter.of_a_loop(report.priority.granted > 0)
}

#[cfg(test)]
mod tests;
