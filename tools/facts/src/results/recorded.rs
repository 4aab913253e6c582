//! Facts that a recorder, or a reader of its recording, has about a run at its end.

use std::collections::BTreeMap;

use crate::results::curve::Curve;
use hil_config::evaluation::MetricValue;
use hil_config::requirements::RequirementValue;
use shared_types::record::{ControllerChange, Mark, RunEnd, ValueChange};

use crate::results::ending::Answers;
use crate::results::faults::FaultLog;
use crate::results::latency::legs::LatencySummary;
use crate::results::restoration::Stretch;

/// Facts of the recorder at the end.
#[derive(Clone, Debug, Default)]
pub struct Recorded {
    /// End of the run as reported by the plant; `None` if the plant died before it.
    pub end: Option<RunEnd>,
    /// Fault events.
    pub faults: FaultLog,
    /// Changes of controllers.
    pub changes: Vec<ControllerChange>,
    /// Changes of values.
    pub values: Vec<ValueChange>,
    /// Marks of observers.
    pub marks: Vec<Mark>,
    /// Number of processed records, including those of the past.
    pub records: u64,
    /// Number of records in the recording.
    pub written: u64,
    /// Reason that the recording lacks the rest, if it could not be written.
    pub cut_short: Option<String>,
    /// Number of records that the run continued.
    pub past_records: u64,
    /// Number of items lost in the stream.
    pub lost: u64,
    /// Counts of controller commands in the records; `None` for an excerpt, which lacks some records.
    pub answers: Option<Answers>,
    /// Digest of all processed records; `None` if something was lost.
    pub digest: Option<String>,
    /// Digests after certain numbers of records, as far as they were requested and exist.
    pub partial_digests: BTreeMap<u64, String>,
    /// Records after each checkpoint, in the order of the steps.
    pub stretches: Vec<Stretch>,
    /// Metrics.
    pub metrics: Vec<MetricValue>,
    /// Requirements.
    pub requirements: Vec<RequirementValue>,
    /// Latency of the steps.
    pub latency: LatencySummary,
    /// Curve of a case whose campaign records curves.
    pub curve: Option<Curve>,
    /// Time from the first to the last record in s.
    pub wall_time_s: f64,
    /// Error that prevented the recording, or the contradiction in the plant's report.
    pub error: Option<String>,
}

impl Recorded {
    /// Creates the facts of a run before its first record.
    pub fn begun() -> Self {
        Self {
            answers: Some(Answers::default()),
            ..Self::default()
        }
    }
}
