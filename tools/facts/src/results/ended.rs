//! The end of a run and the controllers that it had, as the summary tells of them.

use shared_types::record::Outcome;

use crate::programs::binaries::Binary;
use crate::results::recorded::Recorded;

/// End of a run.
pub struct EndedRun {
    pub recorded: Recorded,
    /// Outcome of the run, with what the supervisor knows besides what the plant saw.
    pub outcome: Outcome,
    /// Reason, if the run was not completed.
    pub reason: Option<String>,
    /// The controller processes, in order.
    pub controllers: Vec<Started>,
}

impl EndedRun {
    /// The end of a run that told of no controller process.
    pub const fn new(recorded: Recorded, outcome: Outcome, reason: Option<String>) -> Self {
        Self {
            recorded,
            outcome,
            reason,
            controllers: Vec::new(),
        }
    }
}

/// A controller as the summary and the recording tell of it.
#[derive(Clone, Debug)]
pub struct Started {
    /// Number of the controller in the session, from 1.
    pub epoch: u32,
    pub binary: Binary,
    pub law: String,
    /// Values of the scenario that were changed for it.
    pub set: Vec<String>,
    /// End of the controller's process, if there is something to say about it.
    pub fate: Option<String>,
}

impl Started {
    /// Returns the facts that a recording holds of the controller.
    pub fn facts(&self) -> Vec<(String, String)> {
        let name = |what: &str| format!("controller_{}_{what}", self.epoch);
        let mut facts = vec![
            (name("binary"), self.binary.path.display().to_string()),
            (name("blake3"), self.binary.blake3.clone()),
            (name("law"), self.law.clone()),
        ];
        if !self.set.is_empty() {
            facts.push((name("set"), serde_json::json!(self.set).to_string()));
        }
        facts
    }
}
