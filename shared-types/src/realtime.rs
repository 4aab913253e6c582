//! Real-time settings of a loop: requested and granted.
//!
//! `hil-session` applies the settings and reads the granted values back from the system. A refused setting does not end
//! a run; refusals are listed in a [`Report`], which the launcher displays.

use serde::{Deserialize, Serialize};

use crate::wait::WaitStrategy;

/// File in the session's folder with the plant's report.
pub const PLANT_FILE: &str = "plant-realtime.json";
/// File in the session's folder with the controller's report.
pub const CONTROLLER_FILE: &str = "controller-realtime.json";

/// Requested settings of one side's loop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Only core on which the side may run.
    pub core: Option<u32>,
    /// Only core on which the other side may run.
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

    /// Returns the reason why less is in force than requested; `None` if `asked` equals `unasked`, the value that means
    /// no request.
    pub fn refusal(&self, unasked: &T) -> Option<&str> {
        let reason = self.reason.as_deref()?;
        (self.asked != *unasked).then_some(reason)
    }
}

/// Settings in force for one side's loop.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Report {
    /// Only core on which the side may run; null if there are several.
    pub core: Granted<Option<u32>>,
    /// `SCHED_FIFO` priority; 0 for ordinary scheduling.
    pub priority: Granted<u32>,
    /// `true` if the memory of the process is locked.
    pub lock_memory: Granted<bool>,
    /// `true` if new memory is faulted in before use.
    pub prefault: Granted<bool>,
    /// Strategy for waiting.
    pub wait: Granted<WaitStrategy>,
    /// Timer slack of the loop's thread in ns: the delay that its timers may have. The requested value is always 1. The
    /// kernel reports 0 for `SCHED_FIFO`.
    pub timer_slack_ns: u64,
    /// `true` if both sides share one core. Only used within the process.
    #[serde(skip)]
    pub shares_core: bool,
}
