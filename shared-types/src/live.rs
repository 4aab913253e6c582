//! Requests to a running plant from another terminal, and their responses.
//!
//! The plant listens on a socket in the session's private folder, on its own thread; `hil` sends requests. Each request
//! and response is one line of JSON. The loop only reads one atomic.

use serde::{Deserialize, Serialize};

use crate::describe::{FaultKindDescription, PlantDescription, Settings};
use crate::record::{FaultEffectSize, RecordLayout};
use crate::table::{Field, number};
use crate::time::Rate;

pub use crate::record::ChangedValue;

/// Request to the plant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "request", rename_all = "kebab-case")]
pub enum Request {
    /// Requests these faults, all or none.
    Inject {
        /// `[[faults]]` as in a scenario.
        toml: String,
    },
    /// Ends faults.
    Clear {
        /// Number of the fault; `None` for all.
        id: Option<u32>,
    },
    /// Lists the faults of the run.
    Active,
    /// Lists the faults that are possible.
    Possible,
    /// Requests the status of the run.
    Status,
    /// Pauses the run before the next step.
    Pause,
    /// Resumes a paused run.
    Resume,
    /// Runs N more steps, then pauses.
    Advance {
        /// Number of steps, at least 1.
        steps: u64,
    },
    /// Requests the latest record.
    Record,
    /// Adds a note at the next step.
    Mark {
        /// Text of the note, one line.
        text: String,
    },
    /// Changes values at one step, all or none.
    Set(ChangeRequest),
    /// Lists everything that can be changed during the run, with its current value.
    Tunable,
}

/// Values to change during a run, all at one step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChangeRequest {
    /// New values by scenario key: `controller.pid.proportional_n_per_m`, `plant.parameters.mass_kg`,
    /// `reference.position_m`. The last part of a parameter's name sets every parameter with that ending, as in a
    /// scenario.
    #[serde(default)]
    pub set: Vec<NewValue>,
    /// Reference signals that return to their stimulus: `reference.position_m`.
    #[serde(default)]
    pub clear: Vec<String>,
    /// Simulated time in s at or after which the change begins; `None` means at the next step.
    #[serde(default)]
    pub at_s: Option<f64>,
    /// Duration in s of the ramp from the current values; `None` means an immediate change.
    #[serde(default)]
    pub ramp_s: Option<f64>,
}

/// New value of a key.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NewValue {
    /// Scenario key.
    pub key: String,
    /// Value, in the unit of the key.
    #[serde(with = "number")]
    pub value: f64,
}

/// Response to a request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "response", rename_all = "kebab-case")]
pub enum Response {
    /// Faults were accepted.
    Injected {
        /// Accepted faults, in the order requested.
        faults: Vec<Injected>,
    },
    /// Faults that ended.
    Cleared {
        /// Numbers of the faults.
        ids: Vec<u32>,
        /// First step without the faults.
        step: u64,
    },
    /// Faults of the run.
    Active {
        /// Status of the run.
        status: Status,
        /// Faults in the order of their numbers.
        faults: Vec<FaultState>,
    },
    /// Faults that are possible.
    Possible(Box<Possible>),
    /// Status of the run.
    Status(Status),
    /// The latest record.
    Record {
        /// Layout of the record.
        layout: Box<RecordLayout>,
        /// Words of the record.
        words: Vec<u64>,
    },
    /// Note was added.
    Marked {
        /// Step of the note.
        step: u64,
        /// Simulated time of that step in s.
        at_s: f64,
    },
    /// Change was accepted.
    Changed(Changed),
    /// Everything that can be changed.
    Tunable(Box<Tunables>),
    /// Request was refused; nothing changed.
    Refused {
        /// Problems and possible alternatives, one entry per problem.
        problems: Vec<Refusal>,
    },
}

/// Accepted fault.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Injected {
    /// Number of the fault.
    pub id: u32,
    /// Kind of the fault.
    pub kind: String,
    /// Step at which the fault takes effect; `None` while that depends on the run.
    pub effective_step: Option<u64>,
    /// Simulated time of that step in s.
    pub effective_at_s: Option<f64>,
    /// Condition that the fault waits for, if the step is not known.
    pub waits_for: Option<String>,
}

/// Fault of the run, from a live request or from the scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultState {
    /// Number of the fault.
    pub id: u32,
    /// Kind of the fault.
    pub kind: String,
    /// Origin of the fault: `scenario` or `cli`.
    pub source: String,
    /// `waiting`, `active` or `ended`.
    pub state: String,
    /// Condition that the fault waits for, if any.
    pub waits_for: Option<String>,
    /// Effects of the fault.
    pub effects: Vec<FaultEffectSize>,
}

/// Accepted change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Changed {
    /// Number of the change in the run, from 1; those of the scenario come first.
    pub id: u32,
    /// Step at which the change takes effect.
    pub step: u64,
    /// Simulated time of that step in s.
    pub at_s: f64,
    /// Steps until the values are reached; 0 means at once.
    pub ramp_steps: u64,
    /// Each key by its full name, sorted by name.
    pub set: Vec<ChangedValue>,
    /// Reference signals that return to their stimulus.
    pub clear: Vec<String>,
}

/// Everything that can be changed during a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tunables {
    /// Status of the run.
    pub status: Status,
    /// Parameters of the law, parameters of the plant, then reference signals.
    pub values: Vec<Tunable>,
    /// Accepted changes that have not begun, in the order in which they will begin.
    pub waiting: Vec<Changed>,
    /// Sentence on the active law's behaviour when a parameter changes; empty if the law has no tunable parameters.
    pub law_does: String,
    /// Number of further changes that the run accepts.
    pub left: u32,
}

impl Tunables {
    /// Returns each alias of a variable with its key.
    #[must_use]
    pub fn aliases(&self) -> Vec<(String, String)> {
        let pairs = self.values.iter().flat_map(|one| {
            let aliases = one.aliases.iter();
            aliases.map(|alias| (alias.clone(), one.key.clone()))
        });
        pairs.collect()
    }
}

/// Value that can be changed during a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tunable {
    /// Full name: `controller.pid.proportional_n_per_m`, `plant.parameters.mass_kg`,
    /// `reference.position_m`.
    pub key: String,
    /// Full names built from the variable's aliases.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub aliases: Vec<String>,
    /// Unit of the value.
    pub unit: String,
    /// One-sentence description.
    pub description: String,
    /// Smallest valid value.
    #[serde(with = "number")]
    pub min: f64,
    /// Largest valid value.
    #[serde(with = "number")]
    pub max: f64,
    /// Value at the next step, before faults; during a ramp the intermediate value.
    #[serde(with = "number")]
    pub value: f64,
    /// Value reached, or to be reached at the end of a ramp; equals `value` for a reference signal that follows its
    /// stimulus.
    #[serde(with = "number")]
    pub target: f64,
    /// Value without any change: for a reference signal, the value of its stimulus at the next step.
    #[serde(with = "number")]
    pub original: f64,
    /// First step at which the current ramp has reached its target.
    #[serde(default)]
    pub until_step: Option<u64>,
    /// `true` while a change acts on the value; a reference signal then does not follow its stimulus.
    pub is_changed: bool,
}

/// Status of a run: its position in time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// The next step.
    pub step: u64,
    /// Simulated time of the next step in s.
    pub time_s: f64,
    /// Steps of the whole run.
    pub steps: u64,
    /// `true` if the run is paused before the next step.
    pub paused: bool,
}

/// Faults that are possible in a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Possible {
    /// Steps per second.
    pub rate: Rate,
    /// Plant with its own faults, its signals and parameters.
    pub plant: PlantDescription,
    /// Reference signals.
    pub reference: Vec<Field>,
    /// Inputs of the plant that the scenario drives.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub inputs: Vec<Field>,
    /// Fault kinds on signals, links and timing.
    pub kinds: Vec<FaultKindDescription>,
    /// Number of networks of the link.
    #[serde(default = "one_network", skip_serializing_if = "is_one_network")]
    pub networks: u8,
}

const fn one_network() -> u8 {
    1
}

/// Returns `true` for a link without redundancy.
const fn is_one_network(networks: &u8) -> bool {
    *networks == 1
}

/// Problem with a request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Refusal {
    /// Key concerned, for example `faults[0].kind`; may be empty.
    pub key: String,
    /// Description of the problem.
    pub message: String,
    /// Valid alternatives.
    pub expected: Option<String>,
    /// Existing names closest to an unknown one.
    #[serde(default)]
    pub nearest: Vec<String>,
}

impl Refusal {
    /// Creates a problem that concerns no key.
    #[must_use]
    pub fn new(message: impl Into<String>) -> Self {
        Self {
            key: String::new(),
            message: message.into(),
            expected: None,
            nearest: Vec::new(),
        }
    }
}

/// Parameters of the plant or the active law after a proposed change, to be validated together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterQuestion {
    /// Number of the controller; 0 for the plant.
    pub epoch: u32,
    /// Values of the changed parameters by name.
    pub parameters: Settings,
}

/// Answer to a [`ParameterQuestion`]: `None` if the combination is valid, otherwise the objection.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ParameterAnswer {
    /// Objection of the plant or the law.
    pub objection: Option<String>,
}
