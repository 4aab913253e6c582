//! Real-time settings of a run, as requested and as granted, for its summary.

use serde::Serialize;
use shared_types::realtime::{Granted, Report};
use shared_types::wait::WaitStrategy;

/// Real-time settings requested and granted, as stored in `summary.json`.
#[derive(Clone, Debug, Serialize)]
pub struct Realtime {
    /// Strategy with which the sides waited for each other.
    pub wait: WaitStrategy,
    /// The plant's loop, or the common loop of a run in one process. Null if it never began.
    pub plant: Option<Report>,
    /// The controller's loop; null if it never began, or if the controller has none of its own.
    pub controller: Option<Report>,
    /// The recorder.
    pub recorder: Recorder,
    /// Limit of the wake-up time of a core in us; null if hil set no limit.
    pub dma_latency_us: Granted<Option<u32>>,
}

/// Settings of the recorder's thread.
#[derive(Clone, Debug, Serialize)]
pub struct Recorder {
    /// Only core that the thread may use; null if there are several.
    pub core: Granted<Option<u32>>,
}

impl Realtime {
    /// Describes the settings.
    #[must_use]
    pub fn describe(&self) -> String {
        let mut text = format!("{} waits", self.wait.name());
        for (side, report) in [("plant", &self.plant), ("controller", &self.controller)] {
            let Some(report) = report else { continue };
            let core = report.core.granted.map(|core| format!("core {core}"));
            let priority = report.priority.granted;
            let fifo = (priority > 0).then(|| format!("FIFO {priority}"));
            let locked = (report.lock_memory.granted).then(|| "memory locked".to_owned());
            let fetched = report.prefault.granted.then(|| "prefaulted".to_owned());
            let all: Vec<String> = [core, fifo, locked, fetched]
                .into_iter()
                .flatten()
                .collect();
            if !all.is_empty() {
                text += &format!("; {side}: {}", all.join(", "));
            }
        }
        text
    }
}
