//! The record: everything about one step, as one row of 64-bit words.
//!
//! The plant publishes a record after each step; recorder, digest, metrics and viewers read records
//! and the [`RecordLayout`] and nothing else. The first part is the same in every repetition of a
//! run and is what the [digest](crate::digest) covers; the second part is measured time.
//!
//! | words | content |
//! |---|---|
//! | 1 | step |
//! | one for each 64 sample signals, at least 1 | invalid bits of measured and reference |
//! | one for each 64 command signals, at least 1 | invalid bits of commands and internals |
//! | truth, measured, reference, command, applied, internal | `f64` each |
//! | 7 | [`Timing`], outside the digest |

use serde::{Deserialize, Serialize};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::frame::VALIDITY_WORDS;
use crate::table::Field;

/// Version of records and of the recording made of them.
pub const RECORD_VERSION: u32 = 1;

/// The groups of signals in a record, in order; also the prefixes in expressions.
pub const GROUPS: [&str; 6] = [
    "truth",
    "measured",
    "reference",
    "command",
    "applied",
    "internal",
];

/// Which signals a record holds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RecordLayout {
    /// True state of the plant at the step.
    pub truth: Vec<Field>,
    /// What was sent to the controller as measured.
    pub measured: Vec<Field>,
    /// What was sent to the controller as reference.
    pub reference: Vec<Field>,
    /// The commands of the plant: as the controller sent them and, again, as they were applied.
    pub command: Vec<Field>,
    /// What the controller showed of itself.
    pub internal: Vec<Field>,
    /// Commands and internals in a command frame, which the validity bits count.
    pub command_signals: usize,
}

/// Measured time and bookkeeping of one step; not part of the digest.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable, KnownLayout,
)]
#[repr(C)]
pub struct Timing {
    /// Simulated time in ns.
    pub time_ns: u64,
    /// Which controller answered.
    pub epoch: u64,
    /// Steps since the applied command was computed.
    pub command_age_steps: u64,
    /// Monotonic clock when the record was made, in ns.
    pub published_ns: u64,
    /// From sending the sample to having its command, in ns.
    pub round_trip_ns: u64,
    /// The controller's part of that, in ns by its own clock.
    pub controller_ns: u64,
    /// The plant's integration of the step before, in ns.
    pub plant_ns: u64,
}

impl Timing {
    /// Names of the words, in order.
    pub const NAMES: [&str; Self::WORDS] = [
        "time_ns",
        "epoch",
        "command_age_steps",
        "published_ns",
        "round_trip_ns",
        "controller_ns",
        "plant_ns",
    ];
    /// Number of words.
    pub const WORDS: usize = size_of::<Self>() / size_of::<u64>();
}

impl RecordLayout {
    /// The fields of each group, in the order of [`GROUPS`].
    #[must_use]
    pub fn groups(&self) -> [&[Field]; 6] {
        [
            &self.truth,
            &self.measured,
            &self.reference,
            &self.command,
            &self.command,
            &self.internal,
        ]
    }

    /// Words of validity bits of the sample frame.
    #[must_use]
    pub fn sample_validity_words(&self) -> usize {
        validity_words(self.measured.len() + self.reference.len())
    }

    /// Words of validity bits of the command frame.
    #[must_use]
    pub fn command_validity_words(&self) -> usize {
        validity_words(self.command_signals)
    }

    /// Number of signals.
    #[must_use]
    pub fn values(&self) -> usize {
        self.groups().iter().map(|group| group.len()).sum()
    }

    /// Where the signals begin.
    #[must_use]
    pub fn values_start(&self) -> usize {
        1 + self.sample_validity_words() + self.command_validity_words()
    }

    /// Words that the digest covers, from the first.
    #[must_use]
    pub fn hashed_words(&self) -> usize {
        self.values_start() + self.values()
    }

    /// Words of a record.
    #[must_use]
    pub fn words(&self) -> usize {
        self.hashed_words() + Timing::WORDS
    }

    /// Reads a record.
    ///
    /// # Panics
    /// If it does not have [`RecordLayout::words`] words.
    #[must_use]
    pub fn view<'a>(&self, words: &'a [u64]) -> RecordView<'a> {
        let (hashed, timing) = words.split_at(self.hashed_words());
        let (head, values) = hashed.split_at(self.values_start());
        RecordView {
            step: head[0],
            values: <[f64]>::ref_from_bytes(values.as_bytes()).expect("same size and alignment"),
            hashed,
            timing: Timing::read_from_bytes(timing.as_bytes()).expect("a whole record"),
        }
    }
}

fn validity_words(signals: usize) -> usize {
    signals.div_ceil(64).clamp(1, VALIDITY_WORDS)
}

/// A record, taken apart.
#[derive(Clone, Copy, Debug)]
pub struct RecordView<'a> {
    /// The step.
    pub step: u64,
    /// All signals in the order of [`GROUPS`].
    pub values: &'a [f64],
    /// What the digest covers.
    pub hashed: &'a [u64],
    /// Measured time.
    pub timing: Timing,
}

/// Something that happened at a step, recorded beside the records. JSON in the stream.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum Event {
    /// A fault took hold of one target.
    Fault(FaultTaken),
    /// The run ended.
    End(RunEnd),
}

/// A fault that took hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultTaken {
    /// Number of the fault event it belongs to.
    pub id: u32,
    /// The step from which it acts.
    pub step: u64,
    /// Kind.
    pub kind: String,
    /// Target.
    pub target: String,
    /// Parameter or signal that it changes.
    pub parameter: String,
    /// Everything that decides its course, in one fixed form; part of the digest.
    pub canonical: String,
}

/// How a run ended, as the plant saw it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunEnd {
    /// Steps that were executed.
    pub steps: u64,
    /// In which way.
    pub outcome: Outcome,
    /// Why, if not completed.
    pub reason: Option<String>,
    /// Frames of the controller that failed a check.
    pub rejected_frames: u64,
    /// The largest effect of each fault on its parameter, by fault id and parameter.
    pub effects: Vec<FaultEffectSize>,
}

/// The largest effect that a fault had.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultEffectSize {
    /// Number of the fault event.
    pub id: u32,
    /// Target.
    pub target: String,
    /// Parameter.
    pub parameter: String,
    /// Largest magnitude of the change of the parameter, in its unit.
    pub max_effect: f64,
    /// Unit.
    pub unit: String,
}

/// In which way a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// All steps, confirmed by both sides.
    Completed,
    /// The plant left its range of validity or a number stopped being one.
    Diverged,
    /// Asked to stop.
    Stopped,
    /// Anything else: a death, a timeout, a broken protocol.
    Failed,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout() -> RecordLayout {
        let fields = |n: usize| {
            (0..n)
                .map(|i| Field::signal(&format!("s{i}_m"), "m", "x"))
                .collect()
        };
        RecordLayout {
            truth: fields(3),
            measured: fields(60),
            reference: fields(5),
            command: fields(2),
            internal: fields(1),
            command_signals: 3,
        }
    }

    #[test]
    fn a_record_is_as_long_as_its_parts() {
        let layout = layout();
        assert_eq!(layout.values_start(), 1 + 2 + 1);
        assert_eq!(layout.values(), 3 + 60 + 5 + 2 + 2 + 1);
        assert_eq!(layout.words(), 4 + 73 + 7);
    }

    #[test]
    fn a_view_finds_step_values_and_timing() {
        let layout = layout();
        let mut words = vec![0; layout.words()];
        words[0] = 42;
        words[4] = 1.5_f64.to_bits();
        *words.last_mut().expect("long enough") = 99;
        let view = layout.view(&words);
        assert_eq!(
            (view.step, view.values[0], view.timing.plant_ns),
            (42, 1.5, 99)
        );
        assert_eq!(view.hashed.len(), layout.words() - Timing::WORDS);
    }

    #[test]
    fn events_survive_json() {
        let event = Event::End(RunEnd {
            steps: 3,
            outcome: Outcome::Completed,
            reason: None,
            rejected_frames: 0,
            effects: vec![],
        });
        let text = serde_json::to_string(&event).expect("serialises");
        assert_eq!(serde_json::from_str::<Event>(&text).expect("parses"), event);
    }
}
