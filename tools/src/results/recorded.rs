//! The facts that a recorder has of a run at its end, and a reader of its recording likewise.

use std::collections::BTreeMap;

use hil_config::evaluation::MetricValue;
use hil_config::requirements::RequirementValue;
use shared_types::record::{ControllerChange, RunEnd};

use crate::results::ending::Answers;
use crate::results::faults::FaultLog;
use crate::results::latency::legs::LatencySummary;

/// What the recorder has at the end.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// How the plant saw the end, if it lived to tell.
    pub end: Option<RunEnd>,
    /// What happened to faults.
    pub faults: FaultLog,
    /// What became of controllers.
    pub changes: Vec<ControllerChange>,
    /// Records taken, those of the past included.
    pub records: u64,
    /// How many of them are in the recording.
    pub written: u64,
    /// Why the recording lacks the rest, if it could not be written.
    pub cut_short: Option<String>,
    /// How many of them are those that the run went on from.
    pub past_records: u64,
    /// Items lost on the way.
    pub lost: u64,
    /// What they say of the controller; `None` of an excerpt, which has not all of them.
    pub answers: Option<Answers>,
    /// The digest of all records taken; `None` if something was lost.
    pub digest: Option<String>,
    /// The digests after the first records, by how many, as far as they were asked for and there
    /// were so many.
    pub partial_digests: BTreeMap<u64, String>,
    /// Metrics.
    pub metrics: Vec<MetricValue>,
    /// Requirements.
    pub requirements: Vec<RequirementValue>,
    /// Latency of the steps.
    pub latency: LatencySummary,
    /// From the first to the last record, in s.
    pub wall_time_s: f64,
    /// What kept it from recording, or what of all that the plant said cannot be so.
    pub error: Option<String>,
}

impl Recorded {
    /// The facts of a run before its first record; `latency` are the figures of no step.
    pub(crate) fn begun(latency: LatencySummary) -> Self {
        Self {
            end: None,
            faults: FaultLog::default(),
            changes: Vec::new(),
            records: 0,
            written: 0,
            cut_short: None,
            past_records: 0,
            lost: 0,
            answers: Some(Answers::default()),
            digest: None,
            partial_digests: BTreeMap::new(),
            metrics: Vec::new(),
            requirements: Vec::new(),
            latency,
            wall_time_s: 0.0,
            error: None,
        }
    }
}
