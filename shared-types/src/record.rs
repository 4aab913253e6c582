//! The record: everything about one step, as one row of 64-bit words.
//!
//! The plant publishes a record after each step; recorder, digest, metrics and viewers use only records and the
//! [`RecordLayout`]. The first part is identical in every repetition of a run and is covered by the
//! [digest](crate::digest); the second part consists of measured times.
//!
//! | words | content |
//! |---|---|
//! | 1 | step |
//! | one for each 64 sample signals, at least 1 | invalid bits of measured and reference |
//! | one for each 64 command signals, at least 1 | invalid bits of commands, as received by the plant, and of internals |
//! | truth, measured, reference, command, applied, internal, input | `f64` each |
//! | sensed, stimulus, parameter | `f64` each, outside the digest |
//! | sensor, actuator | `f64` each, outside the digest; on request |
//! | 14 | [`Timing`], outside the digest |
//!
//! `measured` and `reference` are the values that the controller received, including faults of signals and link;
//! `sensed` and `stimulus` are the same signals before any fault. `command` is as sent by the controller, and `applied`
//! as used by the plant. `input` holds the inputs of the plant that the scenario drives, as used by the plant; most runs
//! have none. `parameter` holds the effective values of the plant's faultable parameters. `sensor` and `actuator` hold the
//! inputs of instruments and of their stages, as far as they are requested.

mod event;

use std::ops::Range;

use serde::{Deserialize, Serialize};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::describe::PlantDescription;
use crate::frame::VALIDITY_WORDS;
use crate::layout::{SignalKind, SignalTable, difference};
use crate::table::Field;

pub use event::{
    BusCounts, ChangedValue, ControllerChange, ControllerFate, Event, FaultAccepted, FaultBegun,
    FaultEffectSize, FaultEnded, LONGEST_MARK, MOST_CHANGES, MOST_MARKS, Mark, Outcome, RunEnd,
    SaturatedSignal, ValueChange,
};

/// Version of records and of recordings.
pub const RECORD_VERSION: u32 = 4;

/// Signal groups of a record, in order; also the prefixes in expressions. The digest covers the first
/// [`HASHED_GROUPS`].
pub const GROUPS: [&str; 12] = [
    "truth",
    "measured",
    "reference",
    "command",
    "applied",
    "internal",
    "input",
    "sensed",
    "stimulus",
    "parameter",
    "sensor",
    "actuator",
];

/// Number of signal groups that the digest covers; the other groups follow from them and the scenario, and show the
/// values without faults, and inside instruments.
pub const HASHED_GROUPS: usize = 7;

/// Returns `true` if a signal of this full name, such as `sensor.angle_rad`, is in a record on request only.
#[must_use]
pub fn is_on_request(name: &str) -> bool {
    let group = name.split_once('.').map_or(name, |(group, _)| group);
    matches!(group, "sensor" | "actuator")
}

/// Layout of a record: its signals.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RecordLayout {
    /// True state of the plant at the step.
    pub truth: Vec<Field>,
    /// Signals sent to the controller as measured.
    pub measured: Vec<Field>,
    /// Signals sent to the controller as reference.
    pub reference: Vec<Field>,
    /// Commands of the plant, recorded twice: as sent by the controller and as applied.
    pub command: Vec<Field>,
    /// Internal signals that the controller exposed.
    pub internal: Vec<Field>,
    /// Inputs of the plant that the scenario drives.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub input: Vec<Field>,
    /// Number of commands and internals in a command frame, as counted by the validity bits; internals come last.
    pub command_signals: usize,
    /// Position of each of the plant's commands in a command frame.
    #[serde(default)]
    pub command_places: Vec<usize>,
    /// The plant's faultable parameters.
    pub parameter: Vec<Field>,
    /// Requested inputs of sensors and of their stages.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sensor: Vec<Field>,
    /// Requested inputs of actuators and of their stages.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub actuator: Vec<Field>,
}

/// Measured time and bookkeeping of one step; not part of the digest.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable, KnownLayout,
)]
#[repr(C)]
pub struct Timing {
    /// Simulated time in ns.
    pub time_ns: u64,
    /// Number of the controller that answered.
    pub epoch: u64,
    /// Age in steps of the sample that the controller received.
    pub sample_age_steps: u64,
    /// Steps since the applied command was computed.
    pub command_age_steps: u64,
    /// Monotonic clock at publication, in ns.
    pub published_ns: u64,
    /// Time from sending the sample to receiving its command, in ns. For a late command, the time is counted from the
    /// due time of its sample and recorded at the step of its arrival. 0 without a command.
    pub round_trip_ns: u64,
    /// The controller's share of the round trip, in ns of its own clock.
    pub controller_ns: u64,
    /// Duration of the plant's previous integration step, in ns.
    pub plant_ns: u64,
    /// Delay of the sample beyond its due time, in ns; 0 in lockstep.
    pub late_ns: u64,
    /// Steps since the step for which the applied command was sent: 0 unless the command of this step was missed.
    pub held_steps: u64,
    /// Samples that were answered before the applied command ([`Answered`](crate::directive::Answered)).
    pub answered: u64,
    /// Statistics of the plant's thread ([`ThreadStatistics`](crate::thread::ThreadStatistics)).
    pub plant_surroundings: u64,
    /// Statistics of the controller's thread.
    pub controller_surroundings: u64,
    /// Directive that the controller's runner received with the sample ([`Directive`](crate::directive::Directive)).
    pub directive: u64,
}

impl Timing {
    /// Names of the words, in order.
    pub const NAMES: [&str; Self::WORDS] = [
        "time_ns",
        "epoch",
        "sample_age_steps",
        "command_age_steps",
        "published_ns",
        "round_trip_ns",
        "controller_ns",
        "plant_ns",
        "late_ns",
        "held_steps",
        "answered",
        "plant_surroundings",
        "controller_surroundings",
        "directive",
    ];
    /// Number of words.
    pub const WORDS: usize = size_of::<Self>() / size_of::<u64>();

    /// Returns `true` for the record after the last step, which has neither sample nor command.
    ///
    /// Every other record has the round trip of its command, or holds an older command, or belongs to the step at which
    /// a plant without a controller applies its safe command.
    #[must_use]
    pub const fn is_final(&self) -> bool {
        self.round_trip_ns == 0 && self.held_steps == 0 && self.epoch > 0
    }
}

impl RecordLayout {
    /// Creates the layout for a plant with these reference signals and a controller with these command frames.
    #[must_use]
    pub fn of(plant: &PlantDescription, reference: Vec<Field>, command: &SignalTable) -> Self {
        Self {
            truth: plant.truth.clone(),
            measured: plant.measured.clone(),
            reference,
            command: plant.commands.clone(),
            internal: command.fields(SignalKind::Internal),
            input: Vec::new(),
            command_signals: command.len(),
            // A controller that does not send them all is refused at hello.
            command_places: (command.bind(SignalKind::Command, &plant.commands))
                .unwrap_or_default(),
            parameter: (plant.parameters.iter())
                .filter(|field| field.faultable)
                .cloned()
                .collect(),
            sensor: Vec::new(),
            actuator: Vec::new(),
        }
    }

    /// Adds the inputs of the plant that the scenario drives.
    #[must_use]
    pub fn with_inputs(self, input: Vec<Field>) -> Self {
        Self { input, ..self }
    }

    /// Describes the first difference between this layout, which follows from the description, and one received at
    /// hello.
    #[must_use]
    pub fn difference(&self, other: &Self) -> Option<String> {
        let both = [
            ("truth", &other.truth, &self.truth),
            ("measured", &other.measured, &self.measured),
            ("reference", &other.reference, &self.reference),
            ("command", &other.command, &self.command),
            ("internal", &other.internal, &self.internal),
            ("input", &other.input, &self.input),
            ("parameter", &other.parameter, &self.parameter),
            ("sensor", &other.sensor, &self.sensor),
            ("actuator", &other.actuator, &self.actuator),
        ];
        let mut differences =
            (both.into_iter()).filter_map(|(what, other, ours)| difference(what, other, ours));
        differences.next().or_else(|| {
            let of = |layout: &Self| (layout.command_signals, layout.command_places.clone());
            let ((signals, places), (our_signals, our_places)) = (of(other), of(self));
            if signals != our_signals {
                return Some(format!(
                    "{signals} signals in command frames; its --describe says {our_signals}"
                ));
            }
            (places != our_places).then(|| {
                format!(
                    "commands at positions {places:?} of command frames; its --describe says {our_places:?}"
                )
            })
        })
    }

    /// Returns the fields of each group, in the order of [`GROUPS`].
    #[must_use]
    pub fn groups(&self) -> [&[Field]; GROUPS.len()] {
        [
            &self.truth,
            &self.measured,
            &self.reference,
            &self.command,
            &self.command,
            &self.internal,
            &self.input,
            &self.measured,
            &self.reference,
            &self.parameter,
            &self.sensor,
            &self.actuator,
        ]
    }

    /// Returns the number of validity words of the sample frame.
    #[must_use]
    pub fn sample_validity_words(&self) -> usize {
        validity_words(self.measured.len() + self.reference.len())
    }

    /// Returns the number of validity words of the command frame.
    #[must_use]
    pub fn command_validity_words(&self) -> usize {
        validity_words(self.command_signals)
    }

    /// Returns the number of signal values.
    #[must_use]
    #[inline]
    pub fn values(&self) -> usize {
        self.groups().iter().map(|group| group.len()).sum()
    }

    /// Returns the index of the first word with a signal.
    #[must_use]
    #[inline]
    pub fn values_start(&self) -> usize {
        1 + self.sample_validity_words() + self.command_validity_words()
    }

    /// Returns the validity bit of each signal, by the signal's index among the [values](RecordView::values).
    #[must_use]
    pub fn validity(&self) -> Validity {
        let [truth, measured, reference, command, applied, internal, ..] =
            self.groups().map(<[Field]>::len);
        let sample = 1;
        let answer = sample + self.sample_validity_words();
        let marks = |first: usize, bits: Range<usize>, value: usize| {
            (bits.zip(value..)).map(move |(bit, value)| (first, bit, value))
        };
        let commands = self
            .command_places
            .iter()
            .zip(truth + measured + reference..);
        let internals = self.command_signals.saturating_sub(internal)..self.command_signals;
        let first_internal = truth + measured + reference + command + applied;
        let all = marks(sample, 0..measured + reference, truth)
            .chain(commands.map(|(bit, value)| (answer, *bit, value)))
            .chain(marks(answer, internals, first_internal));
        // A layout from another process may have bits that no record has.
        Validity::new(all.filter(|(first, bit, _)| first + bit / 64 < self.values_start()))
    }

    /// Returns the number of leading words that the digest covers.
    #[must_use]
    #[inline]
    pub fn hashed_words(&self) -> usize {
        let hashed = &self.groups()[..HASHED_GROUPS];
        self.values_start() + hashed.iter().map(|group| group.len()).sum::<usize>()
    }

    /// Returns the number of words of a record.
    #[must_use]
    #[inline]
    pub fn words(&self) -> usize {
        self.values_start() + self.values() + Timing::WORDS
    }

    /// Reads a record.
    ///
    /// # Panics
    /// If it does not have [`RecordLayout::words`] words.
    #[must_use]
    #[inline]
    pub fn view<'a>(&self, words: &'a [u64]) -> RecordView<'a> {
        let (content, timing) = words.split_at(self.values_start() + self.values());
        let (head, values) = content.split_at(self.values_start());
        RecordView {
            step: head[0],
            values: <[f64]>::ref_from_bytes(values.as_bytes()).expect("same size and alignment"),
            hashed: &content[..self.hashed_words()],
            timing: Timing::read_from_bytes(timing.as_bytes()).expect("a whole record"),
        }
    }
}

fn validity_words(signals: usize) -> usize {
    signals.div_ceil(64).clamp(1, VALIDITY_WORDS)
}

/// Bits of a record that mark signals as invalid: a signal that did not arrive has an older value or none.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Validity {
    bits: Vec<Bit>,
    /// Range of words that contain these bits.
    words: Range<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Bit {
    word: usize,
    bit: usize,
    value: usize,
}

impl Validity {
    /// Collects for each signal the position of its validity bit (word and bit) and the index of its value among the
    /// checked ones.
    pub fn new(bits: impl Iterator<Item = (usize, usize, usize)>) -> Self {
        let bits: Vec<Bit> = bits
            .map(|(first, bit, value)| Bit {
                word: first + bit / 64,
                bit: bit % 64,
                value,
            })
            .collect();
        let words = || bits.iter().map(|bit| bit.word);
        Self {
            words: words().min().unwrap_or(0)..words().max().map_or(0, |last| last + 1),
            bits,
        }
    }

    /// Returns the indices of the signals that a record marks as invalid; usually empty.
    ///
    /// # Panics
    /// If the record is too short for the validity words.
    pub fn invalid<'a>(&'a self, record: &'a [u64]) -> impl Iterator<Item = usize> + 'a {
        let is_any = record[self.words.clone()].iter().any(|bits| *bits != 0);
        let bits = if is_any { &self.bits[..] } else { &[] };
        let is_invalid = |bit: &&Bit| record[bit.word] >> bit.bit & 1 == 1;
        bits.iter().filter(is_invalid).map(|bit| bit.value)
    }
}

/// Decoded record.
#[derive(Clone, Copy, Debug)]
pub struct RecordView<'a> {
    /// The step.
    pub step: u64,
    /// All signals in the order of [`GROUPS`].
    pub values: &'a [f64],
    /// Words that the digest covers.
    pub hashed: &'a [u64],
    /// Measured time.
    pub timing: Timing,
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
            input: fields(2),
            command_signals: 4,
            command_places: vec![2, 0],
            parameter: fields(4),
            sensor: fields(2),
            actuator: fields(1),
        }
    }

    #[test]
    fn the_signals_that_a_record_marks_as_invalid_are_found() {
        let layout = layout();
        let (validity, mut words) = (layout.validity(), vec![0; layout.words()]);
        let places = |words: &[u64]| validity.invalid(words).collect::<Vec<usize>>();
        assert!(places(&words).is_empty());
        // Truth is 0 to 2, measured 3 to 62, reference 63 to 67, command 68 and 69, applied 70 and 71.
        words[1] = 1 << 63 | 0b1;
        words[2] = 0b100;
        words[3] = 0b1110;
        assert_eq!(places(&words), [3, 66, 68, 72]);
        words[2] = 0b1;
        words[3] = 0b0001;
        assert_eq!(places(&words), [3, 66, 67, 69]);
    }

    #[test]
    fn the_length_of_a_record_is_the_sum_of_its_parts() {
        let layout = layout();
        assert_eq!(layout.values_start(), 1 + 2 + 1);
        assert_eq!(layout.values(), 3 + 60 + 5 + 2 + 2 + 1 + 2 + 60 + 5 + 4 + 3);
        assert_eq!(layout.hashed_words(), 4 + 75);
        assert_eq!(layout.words(), 4 + 147 + 14);
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
            (view.step, view.values[0], view.timing.directive),
            (42, 1.5, 99)
        );
        assert_eq!(view.hashed.len(), layout.hashed_words());
    }
}
