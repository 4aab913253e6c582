//! End of a run and its controllers, as reported in the summary.

use shared_types::record::Outcome;

use crate::programs::binaries::Binary;
use crate::results::recorded::Recorded;

/// End of a run.
pub struct EndedRun {
    /// Events and counts of the run.
    pub recorded: Recorded,
    /// Outcome of the run, combining the plant's report and the supervisor's observations.
    pub outcome: Outcome,
    /// Reason, if the run was not completed.
    pub reason: Option<String>,
    /// Controller processes in order.
    pub controllers: Vec<Started>,
}

impl EndedRun {
    /// Creates the end of a run without information about controller processes.
    pub const fn new(recorded: Recorded, outcome: Outcome, reason: Option<String>) -> Self {
        Self {
            recorded,
            outcome,
            reason,
            controllers: Vec::new(),
        }
    }
}

/// Controller as reported in the summary and the recording.
#[derive(Clone, Debug)]
pub struct Started {
    /// Number of the controller in the session, from 1.
    pub epoch: u32,
    /// Program of the controller.
    pub binary: Binary,
    /// Name of its control law.
    pub law: String,
    /// Values of the scenario changed for the controller.
    pub set: Vec<String>,
    /// End of the controller's process, if notable.
    pub fate: Option<String>,
}

impl Started {
    /// Returns the facts about the controller for a recording.
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
