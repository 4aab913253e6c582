//! Real-time settings of a loop: what is asked for, and what the system granted.
//!
//! Each process applies its own to the thread that runs its loop, just before the loop, when its
//! other threads are there already: those keep ordinary scheduling on any core. Nothing here ends a
//! run: what is refused is told in a [`Report`], which the launcher makes known. What the report says
//! was granted was read back from the system.

mod memory;
mod scheduling;

use rustix::thread::{CpuSet, sched_getaffinity, set_current_timer_slack};
use serde::{Deserialize, Serialize};

use crate::wait::{WaitLimit, WaitStrategy, Waiter};
pub use scheduling::{only_core, pin};

/// The file of the session's folder in which the plant reports.
pub const PLANT_FILE: &str = "plant-realtime.json";
/// The file of the session's folder in which the controller reports.
pub const CONTROLLER_FILE: &str = "controller-realtime.json";

/// Settings that one side's loop is asked to run with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// The only core that it may run on.
    pub core: Option<u32>,
    /// The only core that the other side may run on.
    pub peer_core: Option<u32>,
    /// `SCHED_FIFO` priority; 0 for ordinary scheduling.
    pub priority: u32,
    /// Keep all memory of the process, also what comes later, from being taken away again.
    pub lock_memory: bool,
    /// Have all memory of the process, also what comes later, at hand before it is used.
    pub prefault: bool,
    /// Strategy for waiting.
    pub wait: WaitStrategy,
}

/// A setting as it was asked for and as it is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Granted<T> {
    /// Value that was asked for.
    pub asked: T,
    /// Value that is in force.
    pub granted: T,
    /// Reason for which another value is in force.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

impl<T: PartialEq> Granted<T> {
    /// Keeps what was asked for and what is in force, with a reason if they differ.
    pub fn new(asked: T, granted: T, refused: Option<String>) -> Self {
        let differs = asked != granted;
        Self {
            reason: differs.then(|| refused.unwrap_or_else(|| "the system keeps it so".into())),
            asked,
            granted,
        }
    }

    /// Returns the reason for which less is in force than was asked for; none if `asked` is `unasked`, the
    /// value that nobody asks for.
    pub fn refusal(&self, unasked: &T) -> Option<&str> {
        let reason = self.reason.as_deref()?;
        (self.asked != *unasked).then_some(reason)
    }
}

/// Settings that one side's loop runs with.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Report {
    /// The only core that it may run on; null for several.
    pub core: Granted<Option<u32>>,
    /// `SCHED_FIFO` priority; 0 for ordinary scheduling.
    pub priority: Granted<u32>,
    /// True if the memory of the process is locked.
    pub lock_memory: Granted<bool>,
    /// True if new memory is at hand before it is used.
    pub prefault: Granted<bool>,
    /// Strategy for waiting.
    pub wait: Granted<WaitStrategy>,
    /// Slack of the loop's timers: time by which they may be late, in ns. Always asked for: 1. The kernel
    /// counts 0 for `SCHED_FIFO`.
    pub timer_slack_ns: u64,
    /// True if both sides have one core together. Only the process itself needs to know.
    #[serde(skip)]
    pub shares_core: bool,
}

impl Settings {
    /// Applies all of it, to the calling thread and its process, and looks at what came of it.
    ///
    /// 1. Timers become exact: a nap is as long as it is asked to be.
    /// 2. The thread moves to its core.
    /// 3. Memory is locked and fetched, which takes a while, still with ordinary scheduling.
    /// 4. The priority comes last.
    #[must_use]
    pub fn apply(&self) -> Report {
        let before = sched_getaffinity(None).ok();
        let _ = set_current_timer_slack(std::num::NonZeroU64::new(1)); // read back below
        let pinned = self.core.map_or(Ok(()), pin);
        let kept = memory::keep(self.lock_memory, self.prefault);
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
                asked => Granted::new(asked, core, pinned.err().map(|e| e.to_string())),
            },
            priority: Granted::new(self.priority, scheduling::priority(), raised.err()),
            lock_memory: Granted::new(
                self.lock_memory,
                memory::is_locked(),
                (kept.clone().err()).or_else(|| Some("locking is what brings it in".into())),
            ),
            prefault: Granted::new(
                self.prefault,
                self.prefault && memory::is_at_hand(),
                kept.err(),
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

    /// Counts the cores that both sides have together. A side that was given no core has those that this
    /// process had `before`, as both were started in the same way.
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
    /// A waiter of the strategy that was granted.
    #[must_use]
    pub fn waiter(&self, limit: WaitLimit) -> Waiter {
        let waiter = Waiter::with(limit, self.wait.granted, self.shares_core);
        waiter.of_a_loop(self.priority.granted > 0)
    }
}

#[cfg(test)]
mod tests;
