//! The plan: a scenario after every check, in values that the processes can use as they are.
//!
//! Made by [`Scenario::check`](crate::scenario::Scenario::check); read by the launcher and, in parts, by the plant. Nothing here
//! can be out of range, unknown or unbound any more.

mod analysis;
mod plot;
mod records;
mod requirement;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use shared_types::describe::{Operation, Settings};
use shared_types::lockstep::OnLoss;
use shared_types::pacer::OverrunPolicy;
use shared_types::realtime;
use shared_types::table::{Field, derivative_of};
use shared_types::time::{Rate, Step};
use shared_types::wait::WaitStrategy;

use crate::expression::Expression;

pub use analysis::{
    Analysis, AnalysisKind, DetectionPlan, FrequencyResponsePlan, StepResponsePlan,
};
pub use plot::{Plot, Scale};
pub use requirement::Requirement;

/// A checked scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Its name.
    pub name: String,
    /// Description of what the scenario shows; may be empty.
    pub description: String,
    /// Duration, rate, clock.
    pub run: Run,
    /// Real-time settings that are asked of the system.
    pub realtime: Realtime,
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
    /// Analyses, whose figures are metrics too.
    pub analyses: Vec<Analysis>,
    /// Requirements that a run must meet to pass.
    pub requirements: Vec<Requirement>,
    /// Plots that a report begins with.
    pub plots: Vec<Plot>,
    /// Programs of its own.
    pub programs: Programs,
}

/// The programs that a scenario names, as absolute paths; a side without one has the program beside
/// `hil`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Programs {
    /// Program of the plant.
    pub plant: Option<PathBuf>,
    /// Program of the controller.
    pub controller: Option<ControllerProgram>,
}

/// The controller program of a scenario.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ControllerProgram {
    /// The same file on every machine.
    One(PathBuf),
    /// A file for each type of machine, by its name in `uname -m`.
    ByMachine(BTreeMap<String, PathBuf>),
}

impl ControllerProgram {
    /// The file for a type of machine, if there is one.
    #[must_use]
    pub fn for_machine(&self, machine: &str) -> Option<&Path> {
        match self {
            Self::One(file) => Some(file),
            Self::ByMachine(files) => files.get(machine).map(PathBuf::as_path),
        }
    }
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
    /// Clock that releases a step.
    pub clock: Clock,
    /// Policy for a step that is due before the step before it is done; not in lockstep.
    pub overrun: OverrunPolicy,
    /// In real time: share of its period within which the command of a step must be there.
    pub deadline: f64,
    /// Action of the plant when its controller is lost.
    #[serde(default)]
    pub on_controller_loss: OnLoss,
}

/// Kind of clock: what releases a step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Clock {
    /// The command of the step before: as fast as both sides can.
    Lockstep,
    /// The command of the step before and the monotonic clock, `factor` times as fast as real time.
    Paced {
        /// Simulated seconds per second.
        factor: f64,
    },
    /// The monotonic clock, which waits for nobody: a command that misses its deadline is replaced
    /// by the newest there is.
    Realtime,
}

impl Clock {
    /// As it is written in a scenario.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lockstep => "lockstep",
            Self::Paced { .. } => "paced",
            Self::Realtime => "realtime",
        }
    }
}

/// Real-time settings that plant, controller and recorder ask of the system. Before a run starts it
/// is not known if a core exists.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Realtime {
    /// The only core that the plant's loop may run on.
    pub plant_core: Option<u32>,
    /// The only core that the controller's loop may run on.
    pub controller_core: Option<u32>,
    /// The only core that the recorder may run on.
    pub recorder_core: Option<u32>,
    /// `SCHED_FIFO` priority of both loops; 0 for ordinary scheduling.
    pub priority: u32,
    /// True if memory that is there stays there.
    pub lock_memory: bool,
    /// True if memory is fetched before step 0.
    pub prefault: bool,
    /// Longest time in us that a core may need to wake up.
    pub dma_latency_us: Option<u32>,
    /// Strategy by which each side waits for the other.
    pub wait: WaitStrategy,
}

impl Realtime {
    /// The plant's part.
    #[must_use]
    pub const fn plant(&self) -> realtime::Settings {
        self.side(self.plant_core, self.controller_core)
    }

    /// The controller's part.
    #[must_use]
    pub const fn controller(&self) -> realtime::Settings {
        self.side(self.controller_core, self.plant_core)
    }

    const fn side(&self, core: Option<u32>, peer_core: Option<u32>) -> realtime::Settings {
        realtime::Settings {
            core,
            peer_core,
            priority: self.priority,
            lock_memory: self.lock_memory,
            prefault: self.prefault,
            wait: self.wait,
        }
    }
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
    /// Every command as it is while the policy `safe-command` acts.
    #[serde(default)]
    pub safe_command: Settings,
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
    /// Parameters that the law believes the plant to have.
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
    /// `offset + amplitude sin(2 pi n(t))`: a sweep from f0 to f1 in `duration_s`, then on at f1 without
    /// a jump in phase. [`Sweep`] has the turns n.
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
        /// Course of the frequency from f0 to f1.
        #[serde(default, skip_serializing_if = "Sweep::is_linear")]
        sweep: Sweep,
    },
    /// Straight lines between points, constant before the first and after the last.
    Table {
        /// Times in s, strictly rising.
        time_s: Vec<f64>,
        /// Values, as many as times.
        values: Vec<f64>,
    },
}

/// Course of a chirp's frequency from f0 to f1 in d, and the turns that the chirp has made at t.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sweep {
    /// `f0 + (f1 - f0) t / d`; `n = f0 t + (f1 - f0) t^2 / (2 d)`.
    #[default]
    Linear,
    /// `f0 e^(k t)` with `k = ln(f1 / f0) / d`; `n = f0 (e^(k t) - 1) / k`. Both frequencies are above 0
    /// and differ.
    Logarithmic,
}

impl Sweep {
    /// Every sweep.
    pub const ALL: [Self; 2] = [Self::Linear, Self::Logarithmic];

    /// Its name in a scenario.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Logarithmic => "logarithmic",
        }
    }

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
    fn is_linear(&self) -> bool {
        *self == Self::Linear
    }
}

impl Waveform {
    /// Returns the number of time derivatives that are sent with the signal: those that exist
    /// everywhere, and for straight lines the slope to the right.
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
    /// Its effects.
    pub effects: Vec<FaultEffect>,
}

/// Source that asked for a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FaultSource {
    /// The scenario.
    Scenario,
    /// Somebody at a command line, while the run went on.
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
    /// So many steps after another event took hold.
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
    /// Each effect after so many steps of its own.
    pub after_steps: Option<u64>,
    /// Each effect after it acted so many times: runs of steps at which it changed a number, single
    /// steps at which it struck a message or cost time.
    pub occurrences: Option<u64>,
    /// Condition: an expression has held for a while since the event took hold.
    pub condition: Option<Condition>,
}

/// One effect of an event.
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
        /// Its parameters by key.
        parameters: Settings,
        /// Its list, rows one after another; empty if it has none.
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

/// A derived signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Derived {
    /// Name.
    pub name: String,
    /// Unit: the one given, else that of the expression, else that of the name's ending, else `1`.
    pub unit: String,
    /// Its value from signals and earlier derived ones.
    pub expression: Expression,
}

/// A metric: reductions of signals over windows.
#[derive(Clone, Debug, PartialEq)]
pub struct Metric {
    /// Name.
    pub name: String,
    /// Unit: the one given, else that of the expression, else that of the name's ending, else `1`.
    pub unit: String,
    /// The reductions and what is made of them.
    pub expression: Expression,
    /// Windows; none means the whole run. Both ends belong to a window.
    pub windows: Vec<Window>,
    /// Values that others published.
    pub published: Vec<Published>,
    /// Note for a reader of the comparison.
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
    /// Source in which the value stands.
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
