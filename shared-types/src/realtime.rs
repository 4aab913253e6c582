//! Real-time settings of a loop: what is asked for, and what the system granted. Data alone; nothing here asks the
//! system.

use serde::{Deserialize, Serialize};

use crate::wait::WaitStrategy;

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
