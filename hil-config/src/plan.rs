//! The plan: a scenario after every check, in values that the processes can use as they are.
//!
//! Made by [`Scenario::check`](crate::scenario::Scenario::check); read by the launcher and, in parts, by the plant. Nothing here
//! can be out of range, unknown or unbound any more.

mod analysis;
mod change;
mod fault;
mod instrument;
mod plot;
mod records;
mod requirement;
mod stimulus;

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

pub use analysis::{
    Analysis, AnalysisKind, DetectionPlan, FrequencyResponsePlan, StepResponsePlan,
};
pub use change::{Change, PLANT_KEYS, REFERENCE_KEYS, law_keys, settings_after};
pub use fault::{
    Condition, FaultAction, FaultEffect, FaultEnd, FaultEvent, FaultSource, Move, Profile, Trigger,
};
pub use instrument::{Instrument, Stage};
pub use plot::{Panel, Plot, Scale};
pub use requirement::Requirement;
pub use stimulus::{Stimulus, Sweep, Waveform};

/// A checked scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Name.
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
    /// Sensors, each of another measured signal.
    pub sensors: Vec<Instrument>,
    /// Actuators, each of another command.
    pub actuators: Vec<Instrument>,
    /// Fault events in the order of the file.
    pub faults: Vec<FaultEvent>,
    /// Changes of values in the order of the file.
    pub changes: Vec<Change>,
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
    /// Contents of the panel beside the plots.
    pub panel: Panel,
    /// Programs of its own.
    pub programs: Programs,
}

impl Plan {
    /// Returns `true` if the run follows a clock, or asks the system for real-time settings: its latency is then more
    /// than the speed at which it happened to run.
    #[must_use]
    pub fn asks_for_timing(&self) -> bool {
        self.run.clock != Clock::Lockstep || self.realtime != Realtime::default()
    }
}

/// The programs that a scenario names, as absolute paths; a side without one has the program beside
/// `hil`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Programs {
    /// Program of the plant.
    pub plant: Option<PathBuf>,
    /// Program of the controller.
    pub controller: Option<ControllerProgram>,
    /// Patterns of the plant's inner signals that are part of its truth, if it is an FMU.
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

/// Permissions that a scenario gives to an FMU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Permissions {
    /// Permission to unpack to many times the archive's size.
    pub trust_archive: bool,
    /// Permission to use a tool that is installed on this machine.
    pub allow_execution_tool: bool,
}

impl Permissions {
    /// Names of the keys.
    pub const KEYS: [&str; 2] = ["trust_archive", "allow_execution_tool"];

    /// The value of each key, in the order of [`Permissions::KEYS`].
    #[must_use]
    pub const fn values(self) -> [bool; 2] {
        [self.trust_archive, self.allow_execution_tool]
    }

    /// The permissions of which `is_given` returns true for the name of the key.
    pub fn of(mut is_given: impl FnMut(&'static str) -> bool) -> Self {
        let [trust_archive, allow_execution_tool] = Self::KEYS.map(&mut is_given);
        Self {
            trust_archive,
            allow_execution_tool,
        }
    }

    /// Names of the keys that are true.
    pub fn given(self) -> impl Iterator<Item = &'static str> {
        let all = Self::KEYS.into_iter().zip(self.values());
        all.filter_map(|(key, is_given)| is_given.then_some(key))
    }
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
    /// Plant that the law is made for, which chooses among laws of one name: that of the plan, unless the
    /// scenario says another.
    pub made_for: String,
    /// Signals of the law that are bound under other names and units.
    pub connections: Vec<Connection>,
    /// Every parameter of the law.
    pub parameters: Settings,
    /// Parameters that the law believes the plant to have.
    pub model: Settings,
    /// The law runs at every n-th sample and holds its command between, n at least 1.
    pub rate_divisor: u32,
    /// Steps between a sample and the command that answers it: 0, or 1 as on a real target.
    pub command_delay_steps: u32,
}

/// A derived signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Derived {
    /// Name.
    pub name: String,
    /// Unit: the one given, else that of the expression, else that of the name's ending, else `1`.
    pub unit: String,
    /// Value from signals and earlier derived ones.
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
