//! Events of a run, recorded along with the records.

use serde::{Deserialize, Serialize};

use crate::ignored::Ignored;
use crate::lockstep::OnLoss;
use crate::number::exact_in;
use crate::pacer::Streaks;
use crate::table::number;
use crate::text;

/// Event at a step, recorded along with the records. JSON in the stream.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum Event {
    /// A live fault was accepted; it may take effect later.
    Accepted(FaultAccepted),
    /// A fault took effect on one target.
    Fault(FaultBegun),
    /// A fault ended on one target.
    FaultEnded(FaultEnded),
    /// The controller changed during the run.
    Controller(ControllerChange),
    /// Values were changed during the run.
    Change(ValueChange),
    /// An observer of the run added a note at a step.
    Mark(Mark),
    /// The run ended.
    End(RunEnd),
}

impl Event {
    /// Returns the step of the event; `None` for the end of the run.
    #[must_use]
    pub const fn step(&self) -> Option<u64> {
        match self {
            Self::Accepted(accepted) => Some(accepted.step),
            Self::Fault(begun) => Some(begun.step),
            Self::FaultEnded(ended) => Some(ended.step),
            Self::Controller(change) => Some(change.step),
            Self::Change(change) => Some(change.step),
            Self::Mark(mark) => Some(mark.step),
            Self::End(_) => None,
        }
    }

    /// Returns the note if the event is a mark.
    #[must_use]
    pub const fn mark(&self) -> Option<&Mark> {
        match self {
            Self::Mark(mark) => Some(mark),
            _ => None,
        }
    }
}

/// Maximum number of value changes in a run.
pub const MOST_CHANGES: usize = 10_000;

/// Values changed during a run, all from the same step on; part of the digest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ValueChange {
    /// Number of the change in the run, from 1; those of the scenario come first.
    pub id: u32,
    /// First step of the change.
    pub step: u64,
    /// Steps until the values are reached; 0 means at once.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub ramp_steps: u64,
    /// `true` if the change was requested during the run, `false` if the scenario contains it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub live: bool,
    /// Each key by its full name, sorted by name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub set: Vec<ChangedValue>,
    /// Reference signals that return to their stimulus.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[serde(deserialize_with = "text::lines_of")]
    pub clear: Vec<String>,
}

/// New value of a key.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChangedValue {
    /// Full name of the key.
    #[serde(deserialize_with = "text::line_of")]
    pub key: String,
    /// Unit of the value.
    #[serde(deserialize_with = "text::line_of")]
    pub unit: String,
    /// The value.
    #[serde(with = "number")]
    pub value: f64,
}

impl ValueChange {
    /// Formats the new values, as in `plant.parameters.mass_kg = 1.2 kg, over 300 steps`.
    #[must_use]
    pub fn described(&self) -> String {
        let set = self
            .set
            .iter()
            .map(|ChangedValue { key, unit, value }| format!("{key} = {}", exact_in(*value, unit)));
        let clear = (self.clear.iter()).map(|key| format!("{key} back to its stimulus"));
        let mut text = set.chain(clear).collect::<Vec<_>>().join(", ");
        if self.ramp_steps > 0 {
            text += &format!(", over {} steps", self.ramp_steps);
        }
        text
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's contract")]
const fn is_zero(steps: &u64) -> bool {
    *steps == 0
}

/// Maximum number of marks in a run.
pub const MOST_MARKS: usize = 10_000;

/// Maximum length of a mark's text, in characters.
pub const LONGEST_MARK: usize = 400;

/// Note at a step; not part of the digest.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mark {
    /// Next step at the time of the note.
    pub step: u64,
    /// Text of the note, one line.
    #[serde(deserialize_with = "text::line_of")]
    pub text: String,
}

/// Change of the controller during a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ControllerChange {
    /// Number of the controller in the session, from 1.
    pub epoch: u32,
    /// First step without or with the controller; for a refused controller, the next step at that time.
    pub step: u64,
    /// Kind of change.
    #[serde(flatten)]
    pub change: ControllerFate,
}

/// Kinds of controller change.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "change", rename_all = "kebab-case")]
pub enum ControllerFate {
    /// Lost controller; the run continues.
    Lost {
        /// Reason for the loss.
        #[serde(deserialize_with = "text::line_of")]
        reason: String,
        /// Policy by which the run continues.
        policy: OnLoss,
    },
    /// Controller that took over.
    Joined {
        /// Law of the controller.
        #[serde(deserialize_with = "text::line_of")]
        law: String,
    },
    /// Announced controller that did not take over.
    Refused {
        /// Reason for the refusal.
        #[serde(deserialize_with = "text::line_of")]
        reason: String,
    },
}

/// Accepted live fault.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultAccepted {
    /// Number of the fault event.
    pub id: u32,
    /// Next step at the time of acceptance.
    pub step: u64,
    /// Event as produced by the scenario's checks (`hil_config::plan::FaultEvent`).
    pub fault: serde_json::Value,
}

/// Fault that took effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultBegun {
    /// Number of the fault event to which the effect belongs.
    pub id: u32,
    /// Index of the effect in the event, from 0.
    pub effect: u32,
    /// First step at which the fault acts.
    pub step: u64,
    /// Kind.
    #[serde(deserialize_with = "text::line_of")]
    pub kind: String,
    /// Target.
    #[serde(deserialize_with = "text::line_of")]
    pub target: String,
    /// Parameters or signal that the fault changes.
    #[serde(deserialize_with = "text::line_of")]
    pub parameter: String,
    /// Canonical form of all inputs that determine the fault's course; part of the digest.
    pub canonical: String,
    /// `true` if the fault costs time and changes nothing else, so that the digest excludes it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub wall_only: bool,
}

/// Fault that ended on one target, or that was cleared before it took effect.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FaultEnded {
    /// Number of the fault event.
    pub id: u32,
    /// Index of the effect in the event, from 0.
    pub effect: u32,
    /// First step without the fault.
    pub step: u64,
    /// `true` if the fault was cleared by request.
    pub cleared: bool,
}

/// End of a run, as seen by the plant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunEnd {
    /// Number of executed steps.
    pub steps: u64,
    /// Outcome of the run.
    pub outcome: Outcome,
    /// Reason, unless completed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(deserialize_with = "text::line_if_any")]
    pub reason: Option<String>,
    /// Number of frames that failed a check: frames from the controller and frames that a fault corrupted.
    pub rejected_frames: u64,
    /// Counts of ignored messages and frames of controllers.
    #[serde(default, skip_serializing_if = "nothing_was_ignored")]
    pub ignored: Box<Ignored>,
    /// Results of all effects of all faults, including those that never took effect.
    pub effects: Vec<FaultEffectSize>,
    /// Overruns; none in lockstep.
    #[serde(default)]
    pub overruns: Streaks,
    /// Steps whose command missed its deadline, in this run or in the run being repeated.
    #[serde(default)]
    pub missed_commands: Streaks,
    /// Keys of changed or faulted parameters whose values cannot be read back from the model.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[serde(deserialize_with = "text::lines_of")]
    pub unconfirmed: Vec<String>,
    /// Counts of each frame of the bus in simulation.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bus: Vec<BusCounts>,
}

/// Counts of one frame of the bus in simulation.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BusCounts {
    /// Name of the frame.
    #[serde(deserialize_with = "text::line_of")]
    pub frame: String,
    /// `sample` or `command`.
    #[serde(deserialize_with = "text::line_of")]
    pub carries: String,
    /// Frames sent.
    pub sent: u64,
    /// Frames accepted.
    pub accepted: u64,
    /// Frames refused by their own checks, as that of a counter.
    pub refused: u64,
    /// Frames refused by the check of a network.
    pub corrupted: u64,
    /// Frames out of order on one of two networks.
    pub out_of_order: u64,
    /// Second copies on two networks.
    pub redundant: u64,
    /// Signals that were beyond the range of their field.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub saturated: Vec<SaturatedSignal>,
}

impl BusCounts {
    /// Describes the counts, as in `bus: 100 frames motion (sample) sent, 98 accepted, 2 corrupted`.
    #[must_use]
    pub fn describe(&self) -> String {
        let Self { frame, carries, .. } = self;
        let mut text = format!(
            "bus: {} frames {frame} ({carries}) sent, {} accepted",
            self.sent, self.accepted
        );
        let counts = [
            (self.refused, "refused"),
            (self.corrupted, "corrupted"),
            (self.out_of_order, "out of order"),
            (self.redundant, "redundant"),
        ];
        for (count, what) in counts.iter().filter(|(count, _)| *count > 0) {
            text += &format!(", {count} {what}");
        }
        for SaturatedSignal { signal, count } in &self.saturated {
            text += &format!(", {signal} beyond its range in {count}");
        }
        text
    }
}

/// Signal beyond the range of its field.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SaturatedSignal {
    /// The signal.
    #[serde(deserialize_with = "text::line_of")]
    pub signal: String,
    /// Number of frames that carried the limit in place of its value.
    pub count: u64,
}

fn nothing_was_ignored(ignored: &Ignored) -> bool {
    ignored.is_empty()
}

impl RunEnd {
    /// Beginning of the reason of a run that ended with a command that is not finite or out of range.
    pub const INVALID_COMMAND: &str = "controller's command of step ";

    /// Returns `true` if the run ended with a command that is not finite or out of range, by the law's own doing.
    #[must_use]
    pub fn is_of_invalid_command(&self) -> bool {
        let reason = self.reason.as_deref().unwrap_or_default();
        self.outcome == Outcome::Failed && reason.starts_with(Self::INVALID_COMMAND)
    }

    /// Creates the end of a run without faults, overruns, missed commands or rejected frames.
    #[must_use]
    pub fn new(steps: u64, outcome: Outcome) -> Self {
        Self {
            steps,
            outcome,
            reason: None,
            rejected_frames: 0,
            ignored: Box::default(),
            effects: Vec::new(),
            overruns: Streaks::default(),
            missed_commands: Streaks::default(),
            unconfirmed: Vec::new(),
            bus: Vec::new(),
        }
    }
}

/// Result of one effect of a fault.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultEffectSize {
    /// Number of the fault event.
    pub id: u32,
    /// Index of the effect in the event, from 0.
    pub effect: u32,
    /// Kind.
    #[serde(deserialize_with = "text::line_of")]
    pub kind: String,
    /// Target.
    #[serde(deserialize_with = "text::line_of")]
    pub target: String,
    /// Parameters or signal.
    #[serde(deserialize_with = "text::line_of")]
    pub parameter: String,
    /// Step at which the effect began; `None` if it never did.
    pub step: Option<u64>,
    /// First step after the effect, if it ended.
    pub ended_step: Option<u64>,
    /// Number of steps at which the effect changed a value.
    pub acted_steps: u64,
    /// Largest magnitude of the change.
    pub max_effect: f64,
    /// Unit of that magnitude: the target's unit; `steps` for a delay, `ns` for lost time.
    #[serde(deserialize_with = "text::line_of")]
    pub unit: String,
}

/// Outcome of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// All steps completed, confirmed by both sides.
    Completed,
    /// The plant left its range of validity or a signal became NaN.
    Diverged,
    /// A stop request ended the run.
    Stopped,
    /// Any other end: a death, a timeout, a broken protocol.
    Failed,
}

impl Outcome {
    /// Returns the outcome's name in recordings and summaries.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Diverged => "diverged",
            Self::Stopped => "stopped",
            Self::Failed => "failed",
        }
    }

    /// Returns the outcome of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let all = [Self::Completed, Self::Diverged, Self::Stopped, Self::Failed];
        all.into_iter().find(|outcome| outcome.name() == name)
    }

    /// Returns `true` if the run ended by itself, so that a repetition ends at the same step.
    #[must_use]
    pub const fn is_own_end(self) -> bool {
        matches!(self, Self::Completed | Self::Diverged)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_survive_json() {
        let event = Event::End(RunEnd::new(3, Outcome::Completed));
        let lost = Event::Controller(ControllerChange {
            epoch: 1,
            step: 7,
            change: ControllerFate::Lost {
                reason: "gone".into(),
                policy: OnLoss::Hold,
            },
        });
        for event in [event, lost] {
            let text = serde_json::to_string(&event).expect("serialises");
            assert_eq!(serde_json::from_str::<Event>(&text).expect("parses"), event);
        }
    }

    #[test]
    fn a_change_is_described_with_its_values_and_its_ramp() {
        let set = vec![ChangedValue {
            key: "plant.parameters.mass_kg".into(),
            unit: "kg".into(),
            value: 1.25,
        }];
        let mut change = ValueChange {
            id: 1,
            step: 7,
            ramp_steps: 0,
            live: true,
            set,
            clear: vec!["reference.position_m".into()],
        };
        let text = "plant.parameters.mass_kg = 1.25 kg, reference.position_m back to its stimulus";
        assert_eq!(change.described(), text);
        change.clear.clear();
        change.ramp_steps = 300;
        let text = "plant.parameters.mass_kg = 1.25 kg, over 300 steps";
        assert_eq!(change.described(), text);
    }

    #[test]
    fn an_event_contains_no_terminal_control_sequences() {
        let hostile = r#""a\u001b[2J\u009b1A\u001b]52;c;eA==\u0007b\nverdict pass""#;
        let clean = "a\u{fffd}[2J\u{fffd}1A\u{fffd}]52;c;eA==\u{fffd}b verdict pass";
        let texts = [
            format!(
                r#"{{"event":"end","steps":3,"outcome":"failed","reason":{hostile},"rejected_frames":0,"effects":[]}}"#
            ),
            format!(
                r#"{{"event":"controller","epoch":1,"step":7,"change":"lost","reason":{hostile},"policy":"hold"}}"#
            ),
            format!(
                r#"{{"event":"controller","epoch":1,"step":7,"change":"refused","reason":{hostile}}}"#
            ),
            format!(
                r#"{{"event":"controller","epoch":1,"step":7,"change":"joined","law":{hostile}}}"#
            ),
        ];
        for text in texts {
            let event: Event = serde_json::from_str(&text).expect("an event");
            let displayed = match event {
                Event::End(end) => end.reason,
                Event::Controller(change) => match change.change {
                    ControllerFate::Lost { reason, .. } | ControllerFate::Refused { reason } => {
                        Some(reason)
                    }
                    ControllerFate::Joined { law } => Some(law),
                },
                _ => None,
            };
            assert_eq!(displayed.as_deref(), Some(clean));
        }
    }
}
