//! Requests to a running plant: what another terminal asks and what it is answered.
//!
//! Each is one line of JSON. Nothing here opens a socket.

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
    /// Asks to take these faults, all or none.
    Inject {
        /// `[[faults]]` as a scenario has them.
        toml: String,
    },
    /// Asks to end faults.
    Clear {
        /// Number of the fault; all if `None`.
        id: Option<u32>,
    },
    /// Asks for the faults of the run.
    Active,
    /// Asks for the faults that are possible.
    Possible,
    /// Asks where the run is.
    Status,
    /// Asks to hold before the next step.
    Pause,
    /// Asks to go on.
    Resume,
    /// Asks to go on for N steps, then hold.
    Advance {
        /// Number of steps, at least 1.
        steps: u64,
    },
    /// Asks for the newest record.
    Record,
    /// Asks to put a note before the next step.
    Mark {
        /// Text of the note, one line.
        text: String,
    },
    /// Asks to change values at one step, all or none.
    Set(ChangeRequest),
    /// Asks for everything that can be changed while the run goes on, with its value.
    Tunable,
}

/// Values to change while a run goes on, all at one step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChangeRequest {
    /// New values, by the keys that a scenario has: `controller.pid.proportional_n_per_m`,
    /// `plant.parameters.mass_kg`, `reference.position_m`. The last part of a parameter's name sets all
    /// that end so, as in a scenario.
    #[serde(default)]
    pub set: Vec<NewValue>,
    /// Reference signals that follow their stimulus again: `reference.position_m`.
    #[serde(default)]
    pub clear: Vec<String>,
    /// Simulated time in s at or after which the change begins; `None`: at the next step.
    #[serde(default)]
    pub at_s: Option<f64>,
    /// Time in s that the values take from what they are at the beginning; `None`: none.
    #[serde(default)]
    pub ramp_s: Option<f64>,
}

/// New value of a key.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NewValue {
    /// The key.
    pub key: String,
    /// The value, in the unit of the key.
    #[serde(with = "number")]
    pub value: f64,
}

/// Answer to a request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "response", rename_all = "kebab-case")]
pub enum Response {
    /// The faults were taken.
    Injected {
        /// Each, in the order asked.
        faults: Vec<Injected>,
    },
    /// Faults that ended.
    Cleared {
        /// Numbers of the faults.
        ids: Vec<u32>,
        /// The first step without them.
        step: u64,
    },
    /// The faults of the run.
    Active {
        /// Status of the run.
        status: Status,
        /// Each, in the order of their numbers.
        faults: Vec<FaultState>,
    },
    /// Faults that are possible.
    Possible(Box<Possible>),
    /// Status of the run.
    Status(Status),
    /// The newest record.
    Record {
        /// Layout of the record.
        layout: Box<RecordLayout>,
        /// Words of the record.
        words: Vec<u64>,
    },
    /// Note that was put.
    Marked {
        /// Step of the note.
        step: u64,
        /// Simulated time of that step in s.
        at_s: f64,
    },
    /// The change was taken.
    Changed(Changed),
    /// Everything that can be changed.
    Tunable(Box<Tunables>),
    /// No, and nothing was changed.
    Refused {
        /// Problems and what would be possible, one entry for each thing that is wrong.
        problems: Vec<Refusal>,
    },
}

/// A fault that was taken.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Injected {
    /// Number of the fault.
    pub id: u32,
    /// Kind of the fault.
    pub kind: String,
    /// The step at which it takes hold; `None` as long as that depends on the run.
    pub effective_step: Option<u64>,
    /// The simulated time of that step in s.
    pub effective_at_s: Option<f64>,
    /// Condition that the fault waits for, if the step is not known.
    pub waits_for: Option<String>,
}

/// A fault of the run, live or of the scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultState {
    /// Number of the fault.
    pub id: u32,
    /// Kind of the fault.
    pub kind: String,
    /// Source of the fault, the one who asked for it: `scenario` or `cli`.
    pub source: String,
    /// `waiting`, `active` or `ended`.
    pub state: String,
    /// Condition that the fault waits for, if it does.
    pub waits_for: Option<String>,
    /// Effects of the fault.
    pub effects: Vec<FaultEffectSize>,
}

/// A change that was taken.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Changed {
    /// Number of the change in the run, from 1; those of the scenario come first.
    pub id: u32,
    /// The step at which it takes hold.
    pub step: u64,
    /// Simulated time of that step in s.
    pub at_s: f64,
    /// Steps until the values are reached; 0: at once.
    pub ramp_steps: u64,
    /// Each key by its full name, in the order of the names.
    pub set: Vec<ChangedValue>,
    /// Reference signals that follow their stimulus again.
    pub clear: Vec<String>,
}

/// Everything that can be changed while a run goes on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tunables {
    /// Status of the run.
    pub status: Status,
    /// Parameters of the law, of the plant, then reference signals.
    pub values: Vec<Tunable>,
    /// Changes that were taken and have not begun, in the order in which they will.
    pub waiting: Vec<Changed>,
    /// Words of the active law on what it does when a parameter changes; empty without a law that can be
    /// tuned.
    pub law_does: String,
    /// Number of changes that the run can still take.
    pub left: u32,
}

impl Tunables {
    /// Keys under further names of their variables, each with the key itself.
    #[must_use]
    pub fn aliases(&self) -> Vec<(String, String)> {
        let pairs = self.values.iter().flat_map(|one| {
            let aliases = one.aliases.iter();
            aliases.map(|alias| (alias.clone(), one.key.clone()))
        });
        pairs.collect()
    }
}

/// A value that can be changed while a run goes on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tunable {
    /// Full name: `controller.pid.proportional_n_per_m`, `plant.parameters.mass_kg`,
    /// `reference.position_m`.
    pub key: String,
    /// Full names under further names of the variable.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub aliases: Vec<String>,
    /// Unit of the value.
    pub unit: String,
    /// Description in one sentence.
    pub description: String,
    /// Smallest legal value.
    #[serde(with = "number")]
    pub min: f64,
    /// Largest legal value.
    #[serde(with = "number")]
    pub max: f64,
    /// Value at the next step, before faults; during a ramp one on the way.
    #[serde(with = "number")]
    pub value: f64,
    /// Value that was reached, or will be at the end of a ramp; of a reference signal that follows its
    /// stimulus the same as `value`.
    #[serde(with = "number")]
    pub target: f64,
    /// Value without any change; of a reference signal that of its stimulus at the next step.
    #[serde(with = "number")]
    pub original: f64,
    /// First step at which a ramp under way has its target.
    #[serde(default)]
    pub until_step: Option<u64>,
    /// True if a change acts on it; a reference signal then does not follow its stimulus.
    pub is_changed: bool,
}

/// Status of a run: where it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// The next step.
    pub step: u64,
    /// Simulated time of the next step in s.
    pub time_s: f64,
    /// Steps of the whole run.
    pub steps: u64,
    /// True if the run holds before the next step.
    pub paused: bool,
}

/// Faults that are possible in a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Possible {
    /// Steps per second.
    pub rate: Rate,
    /// The plant with its own faults, its signals and parameters.
    pub plant: PlantDescription,
    /// The reference signals.
    pub reference: Vec<Field>,
    /// The kinds of faults on signals, links and timing.
    pub kinds: Vec<FaultKindDescription>,
}

/// Something that is wrong with a request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Refusal {
    /// The key that it is about, for example `faults[0].kind`; may be empty.
    pub key: String,
    /// Message that says what is wrong.
    pub message: String,
    /// Alternatives that are possible instead.
    pub expected: Option<String>,
    /// Names that exist and are closest to an unknown one.
    #[serde(default)]
    pub nearest: Vec<String>,
}

impl Refusal {
    /// Something wrong that is about no key.
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

/// Parameters of the plant or the active law that a change would make: do they go together?
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterQuestion {
    /// Number of the controller; 0 for the plant.
    pub epoch: u32,
    /// Values by name, of the parameters that were changed.
    pub parameters: Settings,
}

/// Answer to a [`ParameterQuestion`]: `None` if the parameters go together, else the objection.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ParameterAnswer {
    /// Objection of the plant or the law.
    pub objection: Option<String>,
}
