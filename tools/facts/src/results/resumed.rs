//! Checkpoint from which a run continued and those that it made, as reported in its summary.

use std::path::Path;

use hil_recording::reader::RunReader;
use serde::Serialize;

use crate::results::restoration::Check;

/// Fact that lists the faults that began before a checkpoint and continued with different magnitudes.
pub const CHANGED_FAULTS: &str = "changed_faults";

/// Fact that states whether the state of the checkpoint restores exactly.
pub const CHECK: &str = "resumed_check";

/// Fact with the first step of a run that continued from a checkpoint.
const STEP: &str = "resumed_step";

/// Returns the first step of a recorded run; the records before it are copies of another run's.
pub fn first_step(reader: &RunReader) -> u64 {
    let step = reader.fact(STEP).and_then(|step| step.parse().ok());
    step.unwrap_or(0)
}

/// Checkpoint as reported in the summary of its run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MadeCheckpoint {
    /// Step before which the state was saved.
    pub step: u64,
    pub(crate) time_s: f64,
    /// Path of the checkpoint's folder, relative to the run's folder.
    pub folder: String,
    /// Check that the checkpoint's state restores exactly; null if none was made.
    pub check: Option<Check>,
}

impl MadeCheckpoint {
    /// Describes the checkpoint.
    #[must_use]
    pub fn describe(&self, run_dir: &Path) -> String {
        let (step, time_s) = (self.step, self.time_s);
        let folder = run_dir.join(&self.folder);
        let check = Check::words(self.check.as_ref());
        format!(
            "checkpoint before step {step} ({time_s} s) in {}: {check}",
            folder.display()
        )
    }
}

/// Checkpoint from which a run continued.
#[derive(Clone, Debug, Serialize)]
pub struct Resumed {
    /// Path of the checkpoint's folder.
    pub checkpoint: String,
    /// Session that made the checkpoint.
    pub session: String,
    /// First step of this run; earlier records belong to the other run.
    pub step: u64,
    /// Simulated time of that step.
    pub time_s: f64,
    /// Digest of the records before that step.
    pub digest: String,
    /// Check that the checkpoint's state restores exactly; null if none was made.
    pub check: Option<Check>,
    /// Faults that had begun and continued with other magnitudes.
    pub changed_faults: Vec<u32>,
}

impl Resumed {
    /// Returns the facts about the checkpoint for the recording.
    pub fn facts(&self) -> impl Iterator<Item = (String, String)> {
        let changed: Vec<String> = self.changed_faults.iter().map(u32::to_string).collect();
        let facts = [
            ("resumed_from", self.checkpoint.clone()),
            ("resumed_session", self.session.clone()),
            (STEP, self.step.to_string()),
            ("resumed_digest", self.digest.clone()),
            (CHECK, Check::words(self.check.as_ref()).to_owned()),
            (CHANGED_FAULTS, changed.join(", ")),
        ];
        let present = facts.into_iter().filter(|(_, value)| !value.is_empty());
        present.map(|(name, value)| (name.to_owned(), value))
    }

    /// Describes the origin.
    pub fn describe(&self) -> String {
        let Self {
            checkpoint,
            step,
            time_s,
            check,
            ..
        } = self;
        let check = Check::words(check.as_ref());
        format!("continued from step {step} ({time_s} s), {checkpoint}: {check}")
    }
}
