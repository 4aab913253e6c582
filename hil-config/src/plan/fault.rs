//! Fault events: trigger, end and effects.

use serde::{Deserialize, Serialize};
use shared_types::describe::{Operation, Settings};
use shared_types::time::Step;

/// Event whose effects all take hold at the same step, apart from a wanted skew.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultEvent {
    /// Number in the order of the file, from 1; a live event's is the next free one.
    pub id: u32,
    /// The name that later events refer to, if it has one.
    #[serde(default)]
    pub name: Option<String>,
    /// Kind, for example `leakage`.
    pub kind: String,
    /// Source that asked for the fault.
    pub source: FaultSource,
    /// Trigger that makes the event take hold.
    pub trigger: Trigger,
    /// Ends of the event, of which the first counts.
    #[serde(default)]
    pub end: FaultEnd,
    /// Effects.
    pub effects: Vec<FaultEffect>,
}

/// Source that asked for a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FaultSource {
    /// The scenario.
    Scenario,
    /// A command line, while the run went on.
    Cli,
}

/// Trigger that makes an event take hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Trigger {
    /// At a step.
    Step {
        /// The step.
        step: Step,
        /// The time asked for in s, which the step is at or after.
        at_s: f64,
    },
    /// At the next step that begins; only live.
    Now,
    /// Condition: an expression has held for a while.
    Condition(Condition),
    /// Number of steps after another event took hold.
    After {
        /// The other event's number.
        event: u32,
        /// Number of steps.
        delay_steps: u64,
    },
}

/// An expression that must hold. The expression is computed from the last complete record, so its
/// value at step k acts at step k + 1.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Condition {
    /// The expression; it holds where it exists and is not 0.
    pub expression: String,
    /// For how many records in a row, at least 1.
    pub records: u64,
}

/// End of an event: the first of what is given; never, if nothing is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FaultEnd {
    /// At this step, which is healthy again.
    pub step: Option<Step>,
    /// Each effect after N steps of its own.
    pub after_steps: Option<u64>,
    /// Each effect after it acted N times: runs of steps at which it changed a number, single
    /// steps at which it struck a message or cost time.
    pub occurrences: Option<u64>,
    /// Condition: an expression has held for a while since the event took hold.
    pub condition: Option<Condition>,
}

/// Effect of an event.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultEffect {
    /// The target as scenarios name it: `actuator1`, `measured.surface_angle_rad`,
    /// `parameter.actuator1.bulk_modulus_pa`, `link.sample`, `controller`.
    pub target: String,
    /// Steps from the event's step to the one at which this effect takes hold.
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
        /// Sizes as they were written, by key: for showing them again.
        sizes: Settings,
        /// The parameters.
        moves: Vec<Move>,
    },
    /// Whatever the kind does to its target.
    Kind {
        /// Parameters by key.
        parameters: Settings,
        /// List, rows one after another; empty if it has none.
        list: Vec<f64>,
    },
}

/// Move of one parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Move {
    /// Full name of the parameter.
    pub parameter: String,
    /// Operation by which the parameter is moved.
    pub operation: Operation,
    /// By how much, in the parameter's unit unless it is a factor.
    pub by: f64,
}

/// The course of an effect's size: the factor g(t), t from the step at which it takes hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Profile {
    /// 1.
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
        /// The part, above 0 and at most 1.
        duty: f64,
    },
    /// `sin(2 pi f t + phase)`.
    Sine {
        /// f in Hz, above 0.
        frequency_hz: f64,
        /// Phase in rad.
        phase_rad: f64,
    },
    /// Straight lines between points, constant before the first and after the last.
    Table {
        /// Times in s, strictly rising.
        time_s: Vec<f64>,
        /// Values, as many as times.
        values: Vec<f64>,
    },
}
