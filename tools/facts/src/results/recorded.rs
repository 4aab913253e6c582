//! Facts that a recorder, or a reader of its recording, has about a run at its end.

use std::collections::BTreeMap;

use crate::results::curve::Curve;
use hil_config::evaluation::MetricValue;
use hil_config::requirements::RequirementValue;
use shared_types::record::{ControllerChange, Mark, RunEnd, Timing, ValueChange};

use crate::results::faults::FaultLog;
use crate::results::held_commands::HeldCommand;
use crate::results::latency::legs::LatencySummary;

/// Maximum number of compared steps.
const STEPS: usize = 100;

/// Facts of the recorder at the end.
#[derive(Clone, Debug, Default)]
pub struct Recorded {
    /// End of the run as reported by the plant; `None` if the plant died earlier.
    pub end: Option<RunEnd>,
    /// Fault events.
    pub faults: FaultLog,
    /// Changes of controllers.
    pub changes: Vec<ControllerChange>,
    /// Changes of values.
    pub values: Vec<ValueChange>,
    /// Marks of observers.
    pub marks: Vec<Mark>,
    /// Number of processed records, including records of the past.
    pub records: u64,
    /// Number of records in the recording.
    pub written: u64,
    /// Reason why the recording lacks the rest, if it could not be written.
    pub cut_short: Option<String>,
    /// Number of records of the run that this run continues.
    pub past_records: u64,
    /// Number of items lost in the stream.
    pub lost: u64,
    /// Counts of controller commands in the records; `None` for an excerpt, which lacks some records.
    pub answers: Option<Answers>,
    /// Commands that the plant held without a valid new value.
    pub held_commands: Vec<HeldCommand>,
    /// Digest of all processed records; `None` if something was lost.
    pub digest: Option<String>,
    /// Digests after certain numbers of records, as far as requested and available.
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
    pub(crate) fn begun() -> Self {
        Self {
            answers: Some(Answers::default()),
            ..Self::default()
        }
    }
}

/// Counts of controller commands in the records of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Answers {
    /// Number of records with a controller's command.
    pub answered: u64,
    /// Number of records whose command is older than the one of their step.
    pub held: u64,
}

impl Answers {
    /// Counts the record of a step with a command.
    pub const fn take(&mut self, timing: &Timing) {
        self.answered += (timing.epoch > 0) as u64;
        self.held += (timing.held_steps > 0) as u64;
    }
}

/// Records of the steps after a checkpoint.
#[derive(Clone, Debug)]
pub struct Stretch {
    /// Step of the checkpoint.
    pub first: u64,
    /// Number of live faults accepted before the checkpoint.
    pub accepted: usize,
    /// Reproducible words of the records from that step on.
    pub(super) records: Vec<Vec<u64>>,
}

impl Stretch {
    /// Starts the records of a checkpoint.
    pub const fn new(first: u64, accepted: usize) -> Self {
        Self {
            first,
            accepted,
            records: Vec::new(),
        }
    }

    /// Adds the next record; returns `false` if enough records are stored.
    pub fn take(&mut self, hashed: &[u64]) -> bool {
        // The state after the last step is in the next record.
        let is_open = self.records.len() <= STEPS;
        if is_open {
            self.records.push(hashed.to_vec());
        }
        is_open
    }

    /// Returns the records up to the first live change, because the sides of a check receive no live changes.
    pub(super) fn untouched(&self, recorded: &Recorded) -> &[Vec<u64>] {
        let faults = &recorded.faults;
        let later = faults.accepted.get(self.accepted..).unwrap_or_default();
        let is_later = |id: u32| later.iter().any(|live| live.event.id == id);
        let begins = faults.begun.iter().filter(|begin| is_later(begin.id));
        let ends = faults.ended.iter().filter(|end| end.cleared);
        let changes = recorded.values.iter().filter(|change| change.live);
        let steps = (begins.map(|begin| begin.step))
            .chain(ends.map(|end| end.step))
            .chain(changes.map(|change| change.step))
            .chain(recorded.changes.iter().map(|change| change.step));
        let step = steps.filter(|step| *step >= self.first).min();
        let most = step.map_or(u64::MAX, |step| step - self.first);
        let count = usize::try_from(most).unwrap_or(usize::MAX);
        &self.records[..count.min(self.records.len())]
    }
}
