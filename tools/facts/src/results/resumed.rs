//! The checkpoint that a run went on from and those that it made, as its summary tells of them.

use std::path::Path;

use hil_recording::reader::RunReader;
use serde::Serialize;

use crate::results::restoration::Check;

/// The fact that names faults which had begun before a checkpoint and went on with other sizes.
pub const CHANGED_FAULTS: &str = "changed_faults";

/// The fact that tells if the state of the checkpoint restores exactly.
pub const CHECK: &str = "resumed_check";

/// The fact that names the first step of a run that went on from a checkpoint.
const STEP: &str = "resumed_step";

/// Returns the first step of a recorded run; the records before it are copies of another run's.
pub fn first_step(reader: &RunReader) -> u64 {
    let step = reader.fact(STEP).and_then(|step| step.parse().ok());
    step.unwrap_or(0)
}

/// A checkpoint as the summary of its run tells it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MadeCheckpoint {
    pub step: u64,
    pub(crate) time_s: f64,
    /// Folder, from that of the run.
    pub folder: String,
    /// Check that its state restores exactly; null if there was none.
    pub check: Option<Check>,
}

impl MadeCheckpoint {
    /// Describes the checkpoint for a person.
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

/// The checkpoint that a run went on from.
#[derive(Clone, Debug, Serialize)]
pub struct Resumed {
    /// Folder of the run.
    pub checkpoint: String,
    /// The session that made it.
    pub session: String,
    /// The first step of this run; the records before it are those of the other.
    pub step: u64,
    pub time_s: f64,
    /// Digest of the records before it.
    pub digest: String,
    /// Check that its state restores exactly; null if the checkpoint has none.
    pub check: Option<Check>,
    /// Faults that had begun and went on with other sizes.
    pub changed_faults: Vec<u32>,
}

impl Resumed {
    /// Returns the facts that the recording holds of the checkpoint.
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
        let told = facts.into_iter().filter(|(_, value)| !value.is_empty());
        told.map(|(name, value)| (name.to_owned(), value))
    }

    /// Describes the origin for a person.
    pub fn describe(&self) -> String {
        let Self {
            checkpoint,
            step,
            time_s,
            check,
            ..
        } = self;
        let check = Check::words(check.as_ref());
        format!("went on from step {step} ({time_s} s), {checkpoint}: {check}")
    }
}
