//! The facts that a recorder has of a run at its end, and a reader of its recording likewise.

use std::collections::BTreeMap;

use crate::results::curve::Curve;
use hil_config::evaluation::MetricValue;
use hil_config::requirements::RequirementValue;
use shared_types::record::{ControllerChange, Mark, RunEnd, ValueChange};

use crate::results::ending::Answers;
use crate::results::faults::FaultLog;
use crate::results::latency::legs::LatencySummary;
use crate::results::restoration::Stretch;

/// Facts that the recorder has at the end.
#[derive(Clone, Debug, Default)]
pub struct Recorded {
    /// End of the run as the plant saw it; `None` if the plant did not live to tell.
    pub end: Option<RunEnd>,
    /// Events of faults.
    pub faults: FaultLog,
    /// Changes of controllers.
    pub changes: Vec<ControllerChange>,
    /// Changes of values.
    pub values: Vec<ValueChange>,
    /// Notes of those who watched.
    pub marks: Vec<Mark>,
    /// Records taken, those of the past included.
    pub records: u64,
    /// Number of records that are in the recording.
    pub written: u64,
    /// Reason for which the recording lacks the rest, if the rest could not be written.
    pub cut_short: Option<String>,
    /// Number of records that the run went on from.
    pub past_records: u64,
    /// Items lost on the way.
    pub lost: u64,
    /// Counts of the controller's commands in the records; `None` of an excerpt, which lacks some records.
    pub answers: Option<Answers>,
    /// The digest of all records taken; `None` if something was lost.
    pub digest: Option<String>,
    /// The digests after the first records, by how many, as far as they were asked for and
    /// exist.
    pub partial_digests: BTreeMap<u64, String>,
    /// Records after each checkpoint, in the order of the steps.
    pub stretches: Vec<Stretch>,
    /// Metrics.
    pub metrics: Vec<MetricValue>,
    /// Requirements.
    pub requirements: Vec<RequirementValue>,
    /// Latency of the steps.
    pub latency: LatencySummary,
    /// Curve of a case whose campaign keeps curves.
    pub curve: Option<Curve>,
    /// From the first to the last record, in s.
    pub wall_time_s: f64,
    /// Error that kept the recorder from recording, or the statement of the plant that cannot be so.
    pub error: Option<String>,
}

impl Recorded {
    /// The facts of a run before its first record.
    pub fn begun() -> Self {
        Self {
            answers: Some(Answers::default()),
            ..Self::default()
        }
    }
}
