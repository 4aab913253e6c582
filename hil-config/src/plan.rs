//! The plan: a scenario after every check, in values that the processes can use as they are.
//!
//! Made by [`Scenario::check`](crate::scenario::Scenario::check); read by the launcher and, in parts, by the plant. Nothing here
//! can be out of range, unknown or unbound any more.

use serde::{Deserialize, Serialize};
use shared_types::describe::Settings;
use shared_types::table::{Field, derivative_of};
use shared_types::time::{Rate, Step};

use crate::expression::Expression;

/// A checked scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Its name.
    pub name: String,
    /// What it shows; may be empty.
    pub description: String,
    /// Duration, rate, clock.
    pub run: Run,
    /// The plant.
    pub plant: PlantPlan,
    /// The controller.
    pub controller: ControllerPlan,
    /// Reference signals of the rig.
    pub stimuli: Vec<Stimulus>,
    /// Fault events in the order of the file.
    pub faults: Vec<FaultEvent>,
    /// Derived signals, each using only signals and earlier ones.
    pub derived: Vec<Derived>,
    /// Metrics.
    pub metrics: Vec<Metric>,
}

/// Duration, rate and clock of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Exchange rate.
    pub rate: Rate,
    /// Number of steps N: samples 0 to N - 1 are exchanged, record N holds the final truth.
    pub steps: u64,
    /// Seed of every random stream.
    pub seed: u64,
    /// What releases a step.
    pub clock: Clock,
}

/// What releases a step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Clock {
    /// The command of the step before: as fast as both sides can.
    Lockstep,
    /// The monotonic clock, `factor` times as fast as real time; nobody is ever late.
    Paced {
        /// Simulated seconds per second.
        factor: f64,
    },
}

/// The plant of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlantPlan {
    /// Name of the model.
    pub model: String,
    /// Integration steps in one exchange step.
    pub substeps: u32,
    /// Every parameter.
    pub parameters: Settings,
    /// Limits on truth signals that replace the model's own.
    pub limits: Vec<Limit>,
}

/// A range that a true signal must not leave.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Limit {
    /// Name of the truth signal.
    pub signal: String,
    /// Smallest legal value.
    #[serde(with = "shared_types::table::number")]
    pub min: f64,
    /// Largest legal value.
    #[serde(with = "shared_types::table::number")]
    pub max: f64,
}

/// The controller of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControllerPlan {
    /// Name of the law.
    pub law: String,
    /// Every parameter of the law.
    pub parameters: Settings,
    /// What the law believes of the plant.
    pub model: Settings,
    /// The law runs at every n-th sample and holds its command between, n at least 1.
    pub rate_divisor: u32,
    /// Steps between a sample and the command that answers it: 0, or 1 as on a real target.
    pub command_delay_steps: u32,
}

/// A reference signal with the derivatives its waveform has.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stimulus {
    /// Name of the reference signal.
    pub target: String,
    /// Its unit.
    pub unit: String,
    /// Its course.
    pub waveform: Waveform,
}

impl Stimulus {
    /// The reference signals it makes: the target and its derivatives in rising order.
    #[must_use]
    pub fn fields(&self) -> Vec<Field> {
        let mut fields = vec![Field::signal(
            &self.target,
            &self.unit,
            "Command of the rig.",
        )];
        for order in 1..=self.waveform.derivatives() {
            let (name, unit) = derivative_of(&self.target, &self.unit, order);
            let text = format!("Time derivative {order} of `{}`.", self.target);
            fields.push(Field::signal(&name, &unit, &text));
        }
        fields
    }
}

/// The course of a reference signal. Sizes are in the target's unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Waveform {
    /// `atan(a sin(2 pi f t)) (1 - exp(-c t^3))`, section 4 of the paper with a = 0.2, f = 1, c = 0.1.
    Paper {
        /// a.
        amplitude: f64,
        /// f in Hz.
        frequency_hz: f64,
        /// c in 1/s^3.
        onset_per_s3: f64,
    },
    /// `before` until `at_s`, then `after`.
    Step {
        /// Time of the step in s.
        at_s: f64,
        /// Value before.
        before: f64,
        /// Value from then on.
        after: f64,
    },
    /// `start` until `at_s`, then a constant slope until `end`, then `end`.
    Ramp {
        /// Begin in s.
        at_s: f64,
        /// Length in s, above 0.
        duration_s: f64,
        /// Value before.
        start: f64,
        /// Value after.
        end: f64,
    },
    /// `offset + amplitude sin(2 pi f t + phase)`.
    Sine {
        /// Amplitude.
        amplitude: f64,
        /// f in Hz.
        frequency_hz: f64,
        /// Phase in rad.
        phase_rad: f64,
        /// Offset.
        offset: f64,
    },
    /// `offset + amplitude sin(2 pi (f0 t + (f1 - f0) t^2 / (2 d)))`: linear sweep from f0 to f1 in
    /// `duration_s`, then on at f1 without a jump in phase.
    Chirp {
        /// Amplitude.
        amplitude: f64,
        /// f0 in Hz.
        start_hz: f64,
        /// f1 in Hz.
        end_hz: f64,
        /// d in s, above 0.
        duration_s: f64,
        /// Offset.
        offset: f64,
    },
    /// Straight lines between points, constant before the first and after the last.
    Table {
        /// Times in s, strictly rising.
        time_s: Vec<f64>,
        /// Values, as many as times.
        values: Vec<f64>,
    },
}

impl Waveform {
    /// How many time derivatives are sent with the signal: those that exist everywhere, and for
    /// straight lines the slope to the right.
    #[must_use]
    pub const fn derivatives(&self) -> usize {
        match self {
            Self::Paper { .. } | Self::Sine { .. } | Self::Chirp { .. } => 5,
            Self::Ramp { .. } | Self::Table { .. } => 1,
            Self::Step { .. } => 0,
        }
    }
}

/// One event: all its effects take hold at the same step, apart from a wanted skew.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultEvent {
    /// Number in the order of the file, from 1.
    pub id: u32,
    /// Kind, for example `leakage`.
    pub kind: String,
    /// The time asked for in s.
    pub at_s: f64,
    /// Its effects.
    pub effects: Vec<FaultEffect>,
}

/// One effect: a faultable parameter of the plant becomes its healthy value plus size times profile.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultEffect {
    /// The target, for example `actuator1`.
    pub target: String,
    /// Full name of the parameter.
    pub parameter: String,
    /// The step at which it takes hold.
    pub step: Step,
    /// Size in the parameter's unit.
    pub size: f64,
    /// Course of the size.
    pub profile: Profile,
}

/// How a size sets in, from the step at which it takes hold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Profile {
    /// All at once.
    Step,
    /// `1 - exp(-speed t)` (eq. 6).
    Exponential {
        /// Speed in 1/s.
        speed_per_s: f64,
    },
}

/// A derived signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Derived {
    /// Name.
    pub name: String,
    /// Unit: the one given, else the one that the name's ending stands for, else `1`.
    pub unit: String,
    /// Its value from signals and earlier derived ones.
    pub expression: Expression,
}

/// A metric: reductions of signals over windows.
#[derive(Clone, Debug, PartialEq)]
pub struct Metric {
    /// Name.
    pub name: String,
    /// Unit: the one given, else the one that the name's ending stands for, else `1`.
    pub unit: String,
    /// The reductions and what is made of them.
    pub expression: Expression,
    /// Windows; none means the whole run. Both ends belong to a window.
    pub windows: Vec<Window>,
    /// Values that others published.
    pub published: Vec<Published>,
    /// What a reader of the comparison should know.
    pub published_note: Option<String>,
}

/// A value of a metric that others published, to be shown beside the run's own.
#[derive(Clone, Debug, PartialEq)]
pub struct Published {
    /// The law that it was found with.
    pub law: String,
    /// The window in s.
    pub window_s: [f64; 2],
    /// The value in the metric's unit.
    pub value: f64,
    /// Where it stands.
    pub source: String,
}

/// A window of steps, both ends included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Begin as asked for, in s.
    pub start_s: f64,
    /// End as asked for, in s.
    pub end_s: f64,
    /// First step.
    pub first: Step,
    /// Last step.
    pub last: Step,
}
