//! Fault events: trigger, end and effects.

use serde::{Deserialize, Serialize};
use shared_types::describe::{Operation, Settings};
use shared_types::time::Step;

/// Event whose effects all take effect at the same step, apart from an intended skew.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultEvent {
    /// Number in file order, from 1; a live event has the next free one.
    pub id: u32,
    /// Name to which later events refer, if any.
    #[serde(default)]
    pub name: Option<String>,
    /// Kind, for example `leakage`.
    pub kind: String,
    /// Origin of the fault.
    pub source: FaultSource,
    /// Trigger of the event.
    pub trigger: Trigger,
    /// Ends of the event, of which the first to occur counts.
    #[serde(default)]
    pub end: FaultEnd,
    /// Effects.
    pub effects: Vec<FaultEffect>,
}

/// Origin of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FaultSource {
    /// The scenario.
    Scenario,
    /// A command line, during the run.
    Cli,
}

/// Trigger of an event.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Trigger {
    /// At a step.
    Step {
        /// The step.
        step: Step,
        /// Requested time in s; the step is the first not before it.
        at_s: f64,
    },
    /// At the next step to begin; live only.
    Now,
    /// Condition: an expression has held for the required time.
    Condition(Condition),
    /// Number of steps after another event took effect.
    After {
        /// The other event's number.
        event: u32,
        /// Number of steps.
        delay_steps: u64,
    },
}

/// Expression that must hold. The last complete record determines its value, so its value at step k acts at step k + 1.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Condition {
    /// Expression; it holds where its value exists and is not 0.
    pub expression: String,
    /// Number of consecutive records, at least 1.
    pub records: u64,
}

/// End of an event: the first of these ends to occur; never, if there are none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FaultEnd {
    /// First step without the fault.
    pub step: Option<Step>,
    /// N steps after the beginning of each effect.
    pub after_steps: Option<u64>,
    /// N actions of each effect: sequences of steps at which the effect changed a number, or single steps at which it
    /// affected a message or cost time.
    pub occurrences: Option<u64>,
    /// Condition: an expression has held for the required time since the event took effect.
    pub condition: Option<Condition>,
}

/// Effect of an event.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultEffect {
    /// Target as named in scenarios: `actuator1`, `measured.surface_angle_rad`, `parameter.actuator1.bulk_modulus_pa`,
    /// `link.sample`, `controller`.
    pub target: String,
    /// Steps between the event and the beginning of this effect.
    pub skew_steps: u64,
    /// Course of the size.
    pub profile: Profile,
    /// Action of the effect.
    pub action: FaultAction,
}

/// Action of an effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum FaultAction {
    /// Moves parameters of the plant: one of the plant's own faults.
    Move {
        /// Magnitudes as given, by key, for display.
        sizes: Settings,
        /// Moves of the parameters.
        moves: Vec<Move>,
    },
    /// Action specific to the fault kind.
    Kind {
        /// Parameters by key.
        parameters: Settings,
        /// Concatenated rows of the list; empty if there is none.
        list: Vec<f64>,
    },
}

/// Move of one parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Move {
    /// Full name of the parameter.
    pub parameter: String,
    /// Operation that moves the parameter.
    pub operation: Operation,
    /// Amount, in the parameter's unit unless it is a factor.
    pub by: f64,
}

/// Course of an effect's size: the factor g(t), where t counts from the beginning of the effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Profile {
    /// Constant 1.
    Step,
    /// `t / d`, at most 1.
    Ramp {
        /// d in s, above 0.
        duration_s: f64,
    },
    /// `1 - exp(-speed t)` (eq. 6).
    Exponential {
        /// Speed in 1/s.
        speed_per_s: f64,
    },
    /// 1 for t < d, then 0.
    Pulse {
        /// d in s, above 0.
        duration_s: f64,
    },
    /// 1 in the first part of every period, 0 in the rest.
    Intermittent {
        /// Period in s, above 0.
        period_s: f64,
        /// Active share of the period, above 0 and at most 1.
        duty: f64,
    },
    /// `sin(2 pi f t + phase)`.
    Sine {
        /// f in Hz, above 0.
        frequency_hz: f64,
        /// Phase in rad.
        phase_rad: f64,
    },
    /// Linear interpolation between points, constant before the first and after the last.
    Table {
        /// Times in s, strictly ascending.
        time_s: Vec<f64>,
        /// Values, as many as times.
        values: Vec<f64>,
    },
}
