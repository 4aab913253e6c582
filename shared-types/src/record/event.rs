//! Events of a run, recorded beside the records.

use serde::{Deserialize, Serialize};

use crate::ignored::Ignored;
use crate::lockstep::OnLoss;
use crate::number::exact_in;
use crate::pacer::Streaks;
use crate::table::number;
use crate::text;

/// Something that happened at a step, recorded beside the records. JSON in the stream.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum Event {
    /// A live fault was accepted; it may take hold later.
    Accepted(FaultAccepted),
    /// A fault took hold of one target.
    Fault(FaultBegun),
    /// A fault ended on one target.
    FaultEnded(FaultEnded),
    /// The controller changed while the run went on.
    Controller(ControllerChange),
    /// Values were changed while the run went on.
    Change(ValueChange),
    /// Somebody who watches the run put a note at a step.
    Mark(Mark),
    /// The run ended.
    End(RunEnd),
}

impl Event {
    /// Returns the step at which it happened; `None` for the end of the run.
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

    /// The note that the event is, if it is one.
    #[must_use]
    pub const fn mark(&self) -> Option<&Mark> {
        match self {
            Self::Mark(mark) => Some(mark),
            _ => None,
        }
    }
}

/// Most changes of values in a run.
pub const MOST_CHANGES: usize = 10_000;

/// Values that were changed while a run went on, all from one step on; part of the digest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ValueChange {
    /// Number of the change in the run, from 1; those of the scenario come first.
    pub id: u32,
    /// First step of the change.
    pub step: u64,
    /// Steps until the values are reached; 0: at once.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub ramp_steps: u64,
    /// True if it was asked for while the run went on, false if it is of the scenario.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub live: bool,
    /// Each key by its full name, in the order of the names.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub set: Vec<ChangedValue>,
    /// Reference signals that follow their stimulus again.
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
    /// Describes the new values, as `plant.parameters.mass_kg = 1.2 kg, over 300 steps`.
    #[must_use]
    pub fn described(&self) -> String {
        let set = self
            .set
            .iter()
            .map(|ChangedValue { key, unit, value }| format!("{key} = {}", exact_in(*value, unit)));
        let clear = (self.clear.iter()).map(|key| format!("{key} as its stimulus"));
        let mut told = set.chain(clear).collect::<Vec<_>>().join(", ");
        if self.ramp_steps > 0 {
            told += &format!(", over {} steps", self.ramp_steps);
        }
        told
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's contract")]
const fn is_zero(steps: &u64) -> bool {
    *steps == 0
}

/// Most marks in a run.
pub const MOST_MARKS: usize = 10_000;

/// Longest text of a mark, in characters.
pub const LONGEST_MARK: usize = 400;

/// Note at a step; not part of the digest.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mark {
    /// The next step when the note was put.
    pub step: u64,
    /// Text of the note, one line.
    #[serde(deserialize_with = "text::line_of")]
    pub text: String,
}

/// Change of a controller while the run went on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ControllerChange {
    /// Number of the controller in the session, from 1.
    pub epoch: u32,
    /// The first step without it, or with it, or the next one when it was refused.
    pub step: u64,
    /// Way in which the controller changed.
    #[serde(flatten)]
    pub change: ControllerFate,
}

/// Way in which a controller changed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "change", rename_all = "kebab-case")]
pub enum ControllerFate {
    /// Controller that is lost; the run goes on.
    Lost {
        /// Reason of the loss.
        #[serde(deserialize_with = "text::line_of")]
        reason: String,
        /// Policy by which the run goes on.
        policy: OnLoss,
    },
    /// Controller that took over.
    Joined {
        /// Law of the controller.
        #[serde(deserialize_with = "text::line_of")]
        law: String,
    },
    /// Controller that was announced and did not take over.
    Refused {
        /// Reason of the refusal.
        #[serde(deserialize_with = "text::line_of")]
        reason: String,
    },
}

/// A live fault that was accepted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultAccepted {
    /// Number of the fault event.
    pub id: u32,
    /// The next step when it was accepted.
    pub step: u64,
    /// The event as the scenario's checks made it (`hil_config::plan::FaultEvent`).
    pub fault: serde_json::Value,
}

/// A fault that took hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultBegun {
    /// Number of the fault event it belongs to.
    pub id: u32,
    /// Index of the effect in the event, from 0.
    pub effect: u32,
    /// The step from which it acts.
    pub step: u64,
    /// Kind.
    #[serde(deserialize_with = "text::line_of")]
    pub kind: String,
    /// Target.
    #[serde(deserialize_with = "text::line_of")]
    pub target: String,
    /// Parameters or signal that it changes.
    #[serde(deserialize_with = "text::line_of")]
    pub parameter: String,
    /// Everything that decides its course, in one fixed form; part of the digest.
    pub canonical: String,
    /// True if the fault costs time and changes nothing else, so it is not part of the digest.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub wall_only: bool,
}

/// A fault that ended on one target, or that was cleared before it took hold.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FaultEnded {
    /// Number of the fault event.
    pub id: u32,
    /// Index of the effect in the event, from 0.
    pub effect: u32,
    /// The first step without it.
    pub step: u64,
    /// True if somebody cleared the fault.
    pub cleared: bool,
}

/// End of a run, as the plant saw it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunEnd {
    /// Steps that were executed.
    pub steps: u64,
    /// Way in which the run ended.
    pub outcome: Outcome,
    /// Reason, if not completed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(deserialize_with = "text::line_if_any")]
    pub reason: Option<String>,
    /// Frames that failed a check: of the controller, and those that a fault corrupted.
    pub rejected_frames: u64,
    /// Messages and frames of controllers that were passed over.
    #[serde(default, skip_serializing_if = "nothing_was_ignored")]
    pub ignored: Box<Ignored>,
    /// Results of all effects of all faults, also of those that never took hold.
    pub effects: Vec<FaultEffectSize>,
    /// Steps that were due before the step before them was done; none in lockstep.
    #[serde(default)]
    pub overruns: Streaks,
    /// Steps whose command missed its deadline, or did in the run that was repeated.
    #[serde(default)]
    pub missed_commands: Streaks,
}

fn nothing_was_ignored(ignored: &Ignored) -> bool {
    ignored.is_empty()
}

impl RunEnd {
    /// Makes the end of a run without faults in which nothing was late or refused.
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
    /// The step at which it took hold; `None`: it never did.
    pub step: Option<u64>,
    /// The first step without it, if it ended.
    pub ended_step: Option<u64>,
    /// Steps at which it changed something.
    pub acted_steps: u64,
    /// Largest magnitude of what it changed.
    pub max_effect: f64,
    /// Unit of that: the target's; `steps` for what comes late, `ns` for lost time.
    #[serde(deserialize_with = "text::line_of")]
    pub unit: String,
}

/// Way in which a run ended.
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

impl Outcome {
    /// The word for it in recordings and summaries.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Diverged => "diverged",
            Self::Stopped => "stopped",
            Self::Failed => "failed",
        }
    }

    /// The outcome of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let all = [Self::Completed, Self::Diverged, Self::Stopped, Self::Failed];
        all.into_iter().find(|outcome| outcome.name() == name)
    }

    /// Returns `true` if the run ended by itself: a repetition ends at the same step.
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
        let told = "plant.parameters.mass_kg = 1.25 kg, reference.position_m as its stimulus";
        assert_eq!(change.described(), told);
        change.clear.clear();
        change.ramp_steps = 300;
        let told = "plant.parameters.mass_kg = 1.25 kg, over 300 steps";
        assert_eq!(change.described(), told);
    }

    #[test]
    fn an_event_says_nothing_that_a_terminal_obeys() {
        let said = r#""a\u001b[2J\u009b1A\u001b]52;c;eA==\u0007b\nverdict pass""#;
        let clean = "a\u{fffd}[2J\u{fffd}1A\u{fffd}]52;c;eA==\u{fffd}b verdict pass";
        let texts = [
            format!(
                r#"{{"event":"end","steps":3,"outcome":"failed","reason":{said},"rejected_frames":0,"effects":[]}}"#
            ),
            format!(
                r#"{{"event":"controller","epoch":1,"step":7,"change":"lost","reason":{said},"policy":"hold"}}"#
            ),
            format!(
                r#"{{"event":"controller","epoch":1,"step":7,"change":"refused","reason":{said}}}"#
            ),
            format!(
                r#"{{"event":"controller","epoch":1,"step":7,"change":"joined","law":{said}}}"#
            ),
        ];
        for text in texts {
            let event: Event = serde_json::from_str(&text).expect("an event");
            let shown = match event {
                Event::End(end) => end.reason,
                Event::Controller(change) => match change.change {
                    ControllerFate::Lost { reason, .. } | ControllerFate::Refused { reason } => {
                        Some(reason)
                    }
                    ControllerFate::Joined { law } => Some(law),
                },
                _ => None,
            };
            assert_eq!(shown.as_deref(), Some(clean));
        }
    }
}
