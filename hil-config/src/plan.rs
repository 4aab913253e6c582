//! The plan: a fully checked scenario, in values that the processes can use directly.
//!
//! Produced by [`Scenario::check`](crate::scenario::Scenario::check); used by the launcher and, in parts, by the plant.
//! No value in a plan is out of range, unknown or unbound.

mod analysis;
mod bus;
mod change;
mod derived;
mod fault;
mod input;
mod instrument;
mod plot;
mod probe;
mod records;
mod requirement;
mod stimulus;
mod taps;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use shared_types::connection::Connection;
use shared_types::describe::{ModelSettings, Settings};
use shared_types::lockstep::OnLoss;
use shared_types::pacer::OverrunPolicy;
use shared_types::realtime;
use shared_types::time::{Rate, Step};
use shared_types::wait::WaitStrategy;

use crate::expression::Expression;

pub use crate::stimulus::{Sweep, Waveform};
pub use analysis::{
    Analysis, AnalysisKind, DetectionPlan, FrequencyResponsePlan, StepResponsePlan,
};
pub use bus::BusPlan;
pub use change::{Change, PLANT_KEYS, REFERENCE_KEYS, law_keys, settings_after};
pub(crate) use derived::BoundSource;
pub use derived::{Definition, DerivedSource};
pub use fault::{
    Condition, FaultAction, FaultEffect, FaultEnd, FaultEvent, FaultSource, Move, Profile, Trigger,
};
pub(crate) use input::PLANT_TARGET;
pub use input::driven;
pub use instrument::{Instrument, Stage};
pub use plot::{Panel, Plot, PlotKind, Scale, SpectralWindow, SpectrumPlan};
pub use probe::{Probe, Tone, cut_fields};
pub use requirement::{Requirement, Trace};
pub use stimulus::{INPUT_KEYS, Stimulus};
pub(crate) use taps::indistinguishable;
pub use taps::{tap_fields, taps_of};

/// Checked scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Name.
    pub name: String,
    /// Purpose of the scenario; may be empty.
    pub description: String,
    /// Duration, rate and clock.
    pub run: Run,
    /// Real-time settings requested from the system.
    pub realtime: Realtime,
    /// Plant.
    pub plant: PlantPlan,
    /// Controller.
    pub controller: ControllerPlan,
    /// Reference signals of the rig, and inputs of the plant with a course.
    pub stimuli: Vec<Stimulus>,
    /// Sensors, each of another measured signal.
    pub sensors: Vec<Instrument>,
    /// Actuators, each of another command.
    pub actuators: Vec<Instrument>,
    /// Bus in simulation; `None` if signals cross no frames.
    pub bus: Option<BusPlan>,
    /// Fault events in file order.
    pub faults: Vec<FaultEvent>,
    /// Changes of values in file order.
    pub changes: Vec<Change>,
    /// Derived signals, each using only signals and earlier derived signals.
    pub derived: Vec<Derived>,
    /// Metrics.
    pub metrics: Vec<Metric>,
    /// Analyses, whose figures are metrics too.
    pub analyses: Vec<Analysis>,
    /// Requirements that a run must meet to pass.
    pub requirements: Vec<Requirement>,
    /// First plots of a report.
    pub plots: Vec<Plot>,
    /// `true` if further plots, which follow from the signals, come behind them.
    pub further_plots: bool,
    /// Contents of the panel in addition to the plots.
    pub panel: Panel,
    /// Programs named by the scenario.
    pub programs: Programs,
    /// Probes that cut the loop, added by a measurement and never by a scenario.
    pub probes: Vec<Probe>,
}

impl Plan {
    /// Returns `true` if the run follows a clock or requests real-time settings: its latency then means more than the
    /// speed at which it happened to run.
    #[must_use]
    pub fn asks_for_timing(&self) -> bool {
        self.run.clock != Clock::Lockstep || self.realtime != Realtime::default()
    }
}

/// Programs that a scenario names, by absolute path; a side without such a program uses the one next to `hil`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Programs {
    /// Program of the plant.
    pub plant: Option<PathBuf>,
    /// Program of the controller.
    pub controller: Option<ControllerProgram>,
    /// Patterns of the plant's internal signals that are part of its truth, if it is an FMU.
    pub locals: Vec<String>,
    /// Permissions of the plant, if it is an FMU.
    pub plant_permissions: Permissions,
    /// Permissions of the controller, if it is an FMU.
    pub controller_permissions: Permissions,
    /// Settings of the plant, if it is an FMU.
    pub plant_settings: ModelSettings,
    /// Settings of the controller, if it is an FMU.
    pub controller_settings: ModelSettings,
}

/// Permissions granted to an FMU by a scenario.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Permissions {
    /// Permission to unpack to many times the archive's size.
    pub trust_archive: bool,
    /// Permission to use a tool installed on this machine.
    pub allow_execution_tool: bool,
}

impl Permissions {
    /// Names of the keys.
    pub const KEYS: [&str; 2] = ["trust_archive", "allow_execution_tool"];

    /// Returns the value of each key, in the order of [`Permissions::KEYS`].
    #[must_use]
    pub const fn values(self) -> [bool; 2] {
        [self.trust_archive, self.allow_execution_tool]
    }

    /// Creates the permissions for whose keys `is_given` returns `true`.
    pub fn of(mut is_given: impl FnMut(&'static str) -> bool) -> Self {
        let [trust_archive, allow_execution_tool] = Self::KEYS.map(&mut is_given);
        Self {
            trust_archive,
            allow_execution_tool,
        }
    }

    /// Lists the keys that are `true`.
    pub fn given(self) -> impl Iterator<Item = &'static str> {
        let all = Self::KEYS.into_iter().zip(self.values());
        all.filter_map(|(key, is_given)| is_given.then_some(key))
    }
}

/// Controller program of a scenario.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ControllerProgram {
    /// The same file on every machine.
    One(PathBuf),
    /// File for each machine type, as printed by `uname -m`.
    ByMachine(BTreeMap<String, PathBuf>),
}

impl ControllerProgram {
    /// Returns the file for a machine type, if there is one.
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
    /// Policy for an overrun; not in lockstep.
    pub overrun: OverrunPolicy,
    /// In real time, the share of its period within which the command of a step must arrive.
    pub deadline: f64,
    /// Reaction of the plant to the loss of its controller.
    #[serde(default)]
    pub on_controller_loss: OnLoss,
}

/// Kind of clock, which releases the steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Clock {
    /// The previous step's command: steps as fast as both sides can.
    Lockstep,
    /// The previous step's command and the monotonic clock, `factor` times as fast as real time.
    Paced {
        /// Returns the simulated seconds per wall-clock second.
        factor: f64,
    },
    /// The monotonic clock alone: a command that misses its deadline is replaced by the latest available command.
    Realtime,
}

impl Clock {
    /// Returns the name in a scenario.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lockstep => "lockstep",
            Self::Paced { .. } => "paced",
            Self::Realtime => "realtime",
        }
    }
}

/// Real-time settings of plant, controller and recorder. The existence of the cores is not checked before a run starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Realtime {
    /// Only core on which the plant's loop may run.
    pub plant_core: Option<u32>,
    /// Only core on which the controller's loop may run.
    pub controller_core: Option<u32>,
    /// Only core on which the recorder may run.
    pub recorder_core: Option<u32>,
    /// `SCHED_FIFO` priority of both loops; 0 for ordinary scheduling.
    pub priority: u32,
    /// `true` to lock memory once it is in use.
    pub lock_memory: bool,
    /// `true` to fault in memory before step 0.
    pub prefault: bool,
    /// Longest allowed wake-up time of a core in us.
    pub dma_latency_us: Option<u32>,
    /// Waiting strategy of both sides.
    pub wait: WaitStrategy,
}

impl Realtime {
    /// Returns the plant's settings.
    #[must_use]
    pub const fn plant(&self) -> realtime::Settings {
        self.side(self.plant_core, self.controller_core)
    }

    /// Returns the controller's settings.
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

/// Plant of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlantPlan {
    /// Name of the model.
    pub model: String,
    /// Integration steps per exchange step.
    pub substeps: u32,
    /// Every parameter.
    pub parameters: Settings,
    /// Limits on truth signals that replace the model's own.
    pub limits: Vec<Limit>,
    /// Value of every command, as applied under the policy `safe-command`.
    #[serde(default)]
    pub safe_command: Settings,
    /// Constant inputs, which no law commands.
    #[serde(default, skip_serializing_if = "Settings::is_empty")]
    pub inputs: Settings,
}

/// Range that a true signal must not leave.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Limit {
    /// Name of the truth signal.
    pub signal: String,
    /// Smallest valid value.
    #[serde(with = "shared_types::table::number")]
    pub min: f64,
    /// Largest valid value.
    #[serde(with = "shared_types::table::number")]
    pub max: f64,
}

/// Controller of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControllerPlan {
    /// Name of the law.
    pub law: String,
    /// Plant that the law is made for, which selects among laws of the same name: the plant of the plan, unless the
    /// scenario names another.
    pub made_for: String,
    /// Signals of the law bound to other names and units.
    pub connections: Vec<Connection>,
    /// Every parameter of the law.
    pub parameters: Settings,
    /// Plant parameters that the law assumes.
    pub model: Settings,
    /// Ratio n of the law's period to the exchange period: the law runs at every n-th sample and holds its command in
    /// between, n at least 1.
    pub rate_divisor: u32,
    /// Steps between a sample and the command that answers it: 0, or 1 as on a real target.
    pub command_delay_steps: u32,
}

/// Derived signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Derived {
    /// Name.
    pub name: String,
    /// Unit: as given, or else that of the expression or the column, or of the name's suffix, or `1`.
    pub unit: String,
    /// Source of the values.
    pub source: DerivedSource,
}

/// Metric: reductions of signals over windows.
#[derive(Clone, Debug, PartialEq)]
pub struct Metric {
    /// Name.
    pub name: String,
    /// Unit: as given, or else the unit of the expression, or of the name's suffix, or `1`.
    pub unit: String,
    /// Reductions and the computation on their results.
    pub expression: Expression,
    /// Windows; none means the whole run. Both ends are included.
    pub windows: Vec<Window>,
    /// Values published by others.
    pub published: Vec<Published>,
    /// Note for readers of the comparison.
    pub published_note: Option<String>,
}

/// Value of a metric published by others, shown next to the run's own value.
#[derive(Clone, Debug, PartialEq)]
pub struct Published {
    /// Law with which the value was obtained.
    pub law: String,
    /// Window in s.
    pub window_s: [f64; 2],
    /// Value in the metric's unit.
    pub value: f64,
    /// Source of the value.
    pub source: String,
}

/// Window of steps, both ends included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Requested beginning in s.
    pub start_s: f64,
    /// Requested end in s.
    pub end_s: f64,
    /// First step.
    pub first: Step,
    /// Last step.
    pub last: Step,
}
