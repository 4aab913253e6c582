//! Real-time settings of a loop: requested and granted.
//!
//! Each process applies its own settings to the thread that runs its loop, just before the loop, when its other threads
//! already exist: those keep ordinary scheduling on any core. Nothing here ends a run: refusals are listed in a
//! [`Report`], which the launcher displays. Granted values were read back from the system.

mod memory;
mod scheduling;

use rustix::thread::{CpuSet, sched_getaffinity, set_current_timer_slack};
use serde::{Deserialize, Serialize};

use crate::wait::{WaitLimit, WaitStrategy, Waiter};
pub use scheduling::{only_core, pin};

/// File in the session's folder with the plant's report.
pub const PLANT_FILE: &str = "plant-realtime.json";
/// File in the session's folder with the controller's report.
pub const CONTROLLER_FILE: &str = "controller-realtime.json";

/// Requested settings of one side's loop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Only core that it may run on.
    pub core: Option<u32>,
    /// Only core that the other side may run on.
    pub peer_core: Option<u32>,
    /// `SCHED_FIFO` priority; 0 for ordinary scheduling.
    pub priority: u32,
    /// Lock all present and future memory of the process.
    pub lock_memory: bool,
    /// Fault in all present and future memory of the process before use.
    pub prefault: bool,
    /// Strategy for waiting.
    pub wait: WaitStrategy,
}

/// Setting as requested and as granted.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Granted<T> {
    /// Requested value.
    pub asked: T,
    /// Value in force.
    pub granted: T,
    /// Reason why the value differs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

impl<T: PartialEq> Granted<T> {
    /// Records the requested value and the one in force, with a reason if they differ.
    pub fn new(requested: T, granted: T, refusal: Option<String>) -> Self {
        let differs = requested != granted;
        Self {
            reason: differs
                .then(|| refusal.unwrap_or_else(|| "the system set another value".into())),
            asked: requested,
            granted,
        }
    }

    /// Returns the reason why less is in force than requested; `None` if `asked` is `unasked`, the value that means no
    /// request.
    pub fn refusal(&self, unasked: &T) -> Option<&str> {
        let reason = self.reason.as_deref()?;
        (self.asked != *unasked).then_some(reason)
    }
}

/// Settings in force for one side's loop.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Report {
    /// Only core that it may run on; null for several.
    pub core: Granted<Option<u32>>,
    /// `SCHED_FIFO` priority; 0 for ordinary scheduling.
    pub priority: Granted<u32>,
    /// `true` if the memory of the process is locked.
    pub lock_memory: Granted<bool>,
    /// `true` if new memory is faulted in before use.
    pub prefault: Granted<bool>,
    /// Strategy for waiting.
    pub wait: Granted<WaitStrategy>,
    /// Timer slack of the loop's thread, that is the delay that its timers may have, in ns. 1 is always requested. The
    /// kernel reports 0 for `SCHED_FIFO`.
    pub timer_slack_ns: u64,
    /// `true` if both sides share one core. Only the process itself needs it.
    #[serde(skip)]
    pub shares_core: bool,
}

impl Settings {
    /// Applies all settings to the calling thread and its process, and reads the result back.
    ///
    /// 1. Timers become exact: a nap lasts as long as requested.
    /// 2. The thread moves to its core.
    /// 3. Memory is locked and faulted in, which takes a while, still with ordinary scheduling.
    /// 4. The priority comes last.
    #[must_use]
    pub fn apply(&self) -> Report {
        let before = sched_getaffinity(None).ok();
        let _ = set_current_timer_slack(std::num::NonZeroU64::new(1)); // read back below
        let pinned = self.core.map_or(Ok(()), pin);
        let result = memory::keep(self.lock_memory, self.prefault);
        let raised = match self.priority {
            0 => Ok(()),
            priority => scheduling::run_at(priority),
        };

        let core = scheduling::only_core();
        let cores = self.cores(before.as_ref(), core);
        let shares_core = cores <= 1;
        let wait = match self.wait {
            WaitStrategy::Spin if shares_core => WaitStrategy::Hybrid,
            wait => wait,
        };
        Report {
            core: match self.core {
                None => Granted::new(core, core, None),
                requested => Granted::new(requested, core, pinned.err().map(|e| e.to_string())),
            },
            priority: Granted::new(self.priority, scheduling::priority(), raised.err()),
            lock_memory: Granted::new(
                self.lock_memory,
                memory::is_locked(),
                (result.clone().err()).or_else(|| Some("locking loads it as well".into())),
            ),
            prefault: Granted::new(
                self.prefault,
                self.prefault && memory::is_at_hand(),
                result.err(),
            ),
            wait: Granted::new(
                self.wait,
                wait,
                Some("plant and controller share their only core".into()),
            ),
            timer_slack_ns: rustix::thread::current_timer_slack().unwrap_or(u64::MAX),
            shares_core,
        }
    }

    /// Counts the cores that both sides may use together. A side without a core of its own has those that this process
    /// had `before`, as both were started in the same way.
    fn cores(&self, before: Option<&CpuSet>, core: Option<u32>) -> usize {
        let free = |set: &CpuSet| {
            (0..CpuSet::MAX_CPU)
                .filter(|core| set.is_set(*core))
                .collect()
        };
        let free: Vec<usize> = before.map(free).unwrap_or_default();
        let of = |core: Option<u32>| core.map_or_else(|| free.clone(), |core| vec![core as usize]);
        let mut cores = of(core);
        cores.extend(of(self.peer_core));
        cores.sort_unstable();
        cores.dedup();
        cores.len()
    }
}

impl Report {
    /// Creates a waiter with the granted strategy.
    #[must_use]
    pub fn waiter(&self, limit: WaitLimit) -> Waiter {
        let waiter = Waiter::with(limit, self.wait.granted, self.shares_core);
        waiter.of_a_loop(self.priority.granted > 0)
    }
}

#[cfg(test)]
mod tests;
