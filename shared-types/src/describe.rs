//! Description of a plant or controller binary, its answer to `--describe`.
//!
//! The launcher checks scenarios against this description, so that it can refuse an unknown key or an out-of-range
//! value even for an unfamiliar model. The description is JSON on standard output, and programs in any language can
//! write it.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::frame::MAX_SIGNALS;
use crate::layout::{MOST_FIELDS, Unusable, check_fields, check_title, is_line};
use crate::origin::{Build, Origin};
use crate::table::Field;

/// Version of the protocol between launcher, plant and controller: description, job file, control messages, frames and
/// records. Sides of different versions refuse each other.
pub const PROTOCOL: u32 = 8;

/// A binary's answer to `--describe`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// [`PROTOCOL`] of the binary.
    pub protocol: u32,
    /// Name of the program.
    pub program: String,
    /// Version of the program.
    pub version: String,
    /// Source that the binary was built from; `None` if its build recorded none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub build: Option<Build>,
    /// Plants that the program can simulate; empty for a controller.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub plants: Vec<PlantDescription>,
    /// Laws that the program can run; empty for a plant.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub laws: Vec<LawDescription>,
    /// Fault kinds shared by all plants of the program: those on signals, links and timing; empty for a controller.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<FaultKindDescription>,
    /// Facts about an imported model that the program runs, made by another tool.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub imported: Option<Box<Imported>>,
}

impl Description {
    /// Creates the description of a program with this origin, still without plants and laws.
    #[must_use]
    pub fn of_origin(program: &str, origin: Origin) -> Self {
        Self {
            build: origin.source.map(Into::into),
            ..Self::new(program, &origin.version)
        }
    }

    /// Creates a description still without plants and laws.
    #[must_use]
    pub fn new(program: &str, version: &str) -> Self {
        Self {
            protocol: PROTOCOL,
            program: program.into(),
            version: version.into(),
            build: None,
            plants: Vec::new(),
            laws: Vec::new(),
            faults: Vec::new(),
            imported: None,
        }
    }

    /// Checks that all names are unique and printable, and that no table exceeds its number of columns.
    ///
    /// # Errors
    /// The first violation.
    pub fn check(&self) -> Result<(), String> {
        let mut names = BTreeSet::new();
        for plant in &self.plants {
            let name = shown("plant", &plant.name)?;
            if !names.insert(&plant.name) {
                return Err(format!("{name} is defined twice"));
            }
            plant.check(&self.faults)?;
        }
        let mut kinds = BTreeSet::new();
        for fault in &self.faults {
            let kind = shown("fault", &fault.kind)?;
            if !kinds.insert(&fault.kind) {
                return Err(format!("{kind} is defined twice"));
            }
            check_tables(&kind, [("parameters", &fault.parameters, MOST_FIELDS)])?;
        }
        for (place, law) in self.laws.iter().enumerate() {
            let name = shown("law", &law.name)?;
            if self.laws[..place]
                .iter()
                .any(|before| before.is_for_one_with(law))
            {
                return Err(format!("{name} is defined twice for one plant"));
            }
            law.check()?;
        }
        Ok(())
    }
}

/// Returns the name prefixed with its category, provided that it is printable.
fn shown(what: &str, name: &str) -> Result<String, String> {
    check_title(name).map_err(|wrong| format!("the name of a {what}: {wrong}"))?;
    Ok(format!("{what} `{name}`"))
}

/// Checks tables, each against its own maximum number of columns.
fn check_tables<const N: usize>(
    whose: &str,
    tables: [(&str, &[Field], usize); N],
) -> Result<(), String> {
    for (table, fields, most) in tables {
        let describe = |wrong: Unusable| format!("{table} of {whose}: {wrong}");
        check_fields(fields, most).map_err(describe)?;
    }
    Ok(())
}

/// Plant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlantDescription {
    /// Name, the scenario's `plant.model`.
    pub name: String,
    /// One-sentence summary.
    pub summary: String,
    /// Parameters with defaults and ranges.
    pub parameters: Vec<Field>,
    /// True state and outputs, with the range beyond which a run ends as diverged.
    pub truth: Vec<Field>,
    /// Signals that the plant's sensors report.
    pub measured: Vec<Field>,
    /// Commands that the plant accepts.
    pub commands: Vec<Field>,
    /// Named faults, in addition to faults on single parameters.
    #[serde(default)]
    pub faults: Vec<FaultDescription>,
    /// `true` if the plant's state can be saved, so that a run can resume from a checkpoint.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub saves: bool,
    /// Facts about the port behind which the plant is; `None` for a simulated plant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub port: Option<PortPlant>,
    /// Named numbers of the state, on which trim and linearisation work; `None` if the state is bytes without names.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub state: Option<Vec<Field>>,
}

impl PlantDescription {
    /// Returns the signals that `[plant.limits]` bounds: truth, or readings where there is no truth.
    #[must_use]
    pub fn limited(&self) -> &[Field] {
        match self.port {
            Some(_) => &self.measured,
            None => &self.truth,
        }
    }

    /// Checks names, units and texts of one plant, and its fault kinds against the shared ones.
    fn check(&self, shared: &[FaultKindDescription]) -> Result<(), String> {
        let name = shown("plant", &self.name)?;
        check_tables(
            &name,
            [
                ("parameters", &self.parameters, MOST_FIELDS),
                ("truth", &self.truth, MOST_FIELDS),
                ("measured", &self.measured, MAX_SIGNALS),
                ("commands", &self.commands, MAX_SIGNALS),
                (
                    "state",
                    self.state.as_deref().unwrap_or_default(),
                    MOST_FIELDS,
                ),
            ],
        )?;
        let mut kinds: BTreeSet<&str> = shared.iter().map(|f| f.kind.as_str()).collect();
        for fault in &self.faults {
            let kind = shown("fault", &fault.kind)?;
            if !kinds.insert(&fault.kind) {
                return Err(format!("{kind} of {name} is defined twice"));
            }
            check_tables(&kind, [("sizes", &fault.sizes, MOST_FIELDS)])?;
        }
        Ok(())
    }
}

/// Named fault of a plant: the faultable parameters that it moves, and the way it moves them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultDescription {
    /// Name, the scenario's `faults.kind`.
    pub kind: String,
    /// Summary in one sentence, with the equation's source.
    pub summary: String,
    /// Equation of the effect, in plain text.
    pub equation: String,
    /// Key of an effect that selects the target by number, for example `actuator`: `actuator = 1` selects the parameter
    /// group `actuator1`. `None` if the plant is the only target.
    #[serde(default)]
    pub selector: Option<String>,
    /// Keys, units and ranges of an effect's magnitudes; a magnitude with a default may be omitted.
    pub sizes: Vec<Field>,
    /// Parameters that the fault moves.
    pub moves: Vec<ParameterMove>,
    /// Profile by which the magnitudes set in unless the scenario states another.
    pub profile: ProfileDescription,
}

/// Parameter that a plant's fault moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterMove {
    /// Last part of the faultable parameter's name; the whole name if there is no selector.
    pub parameter: String,
    /// Operation that moves the parameter.
    pub operation: Operation,
    /// Amount by which the parameter is moved.
    pub by: MoveBy,
}

/// Operation that moves a value `v` by an amount `a` under profile `g`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Operation {
    /// `v + a g`.
    Add,
    /// `v (1 + (a - 1) g)`.
    Scale,
    /// `v + (a - v) g`.
    Set,
}

/// Amount by which a parameter is moved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MoveBy {
    /// Magnitude of the effect with this key.
    Size(String),
    /// A constant.
    Constant(f64),
}

/// Default profile by which a fault's magnitudes set in over time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum ProfileDescription {
    /// Immediately.
    Step,
    /// `1 - exp(-speed t)`, with the key and range of the speed.
    Exponential {
        /// Key, unit and range of the speed.
        speed: Field,
    },
}

/// Fault kind that acts on the surroundings of a plant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultKindDescription {
    /// Name, the scenario's `faults.kind`.
    pub kind: String,
    /// One-sentence summary.
    pub summary: String,
    /// Equation of the effect, in plain text.
    pub equation: String,
    /// Targets of this kind of fault.
    pub acts_on: ActsOn,
    /// Keys, units and ranges of an effect. The unit `target` stands for the unit of the target. A parameter with a
    /// default may be omitted.
    pub parameters: Vec<Field>,
    /// List of numbers that an effect may or must state in addition.
    #[serde(default)]
    pub list: Option<ListDescription>,
    /// `true` if the state of such a fault can be saved, so that a run can resume from a checkpoint.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub saves: bool,
}

/// Objects that a fault kind acts on, which determine the valid targets of its effects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ActsOn {
    /// Signals: `measured.x`, `reference.x` and `command.x`.
    Signals,
    /// Signals and every faultable parameter of the plant, `parameter.x`.
    Numbers,
    /// Frames on the link: `link.sample` (plant to controller) and `link.command` (controller to plant); with two networks
    /// also `link.sample.a` and so on.
    Links,
    /// Computing time of a side: `controller` and `plant`.
    Sides,
    /// Computing time of the controller: `controller`.
    Controller,
}

impl ActsOn {
    /// Returns the class of the fault kind.
    #[must_use]
    pub const fn class(self) -> &'static str {
        match self {
            Self::Signals | Self::Numbers => "signal",
            Self::Links => "communication",
            Self::Sides | Self::Controller => "timing",
        }
    }
}

/// List of numbers of an effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ListDescription {
    /// Key of the list.
    pub key: String,
    /// One-sentence description.
    pub description: String,
    /// Numbers per row of the list: 1 for plain numbers, 2 for pairs.
    pub columns: usize,
}

/// Control law.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LawDescription {
    /// Name, the scenario's `controller.law`.
    pub name: String,
    /// One-sentence summary.
    pub summary: String,
    /// Plants that the law is made for; empty means any.
    #[serde(default)]
    pub plants: Vec<String>,
    /// Parameters of the law, the scenario's `[controller.<law>]`.
    pub parameters: Vec<Field>,
    /// The law's model of the plant, the scenario's `[controller.model]`. A missing value defaults to the plant
    /// parameter of the same name in the scenario.
    #[serde(default)]
    pub model: Vec<Field>,
    /// Measured signals that the law needs.
    pub measured: Vec<Field>,
    /// Reference signals that the law needs.
    pub reference: Vec<Field>,
    /// Commands that the law sends; `None` means the commands that the plant accepts.
    pub commands: Option<Vec<Field>>,
    /// Internal signals that the law exposes.
    #[serde(default)]
    pub internals: Vec<Field>,
    /// `true` if the law's state can be saved, so that a run can resume from a checkpoint.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub saves: bool,
    /// Named numbers of the state, on which trim and linearisation work; `None` if the state is bytes without names.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub state: Option<Vec<Field>>,
    /// Sentence on the law's behaviour when a tunable parameter changes during a run; empty if none is tunable.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub tuning: String,
}

impl LawDescription {
    /// Lists the parameters that can be changed while the law runs.
    pub fn tunable(&self) -> impl Iterator<Item = &Field> {
        (self.parameters.iter()).filter(|field| field.tunable)
    }

    /// Returns `true` if the law is made for a plant of this name.
    #[must_use]
    pub fn suits(&self, plant: &str) -> bool {
        self.plants.is_empty() || self.plants.iter().any(|name| name == plant)
    }

    /// Lists the commands in the law's frames for a plant, in order.
    #[must_use]
    pub fn sent_commands<'d>(&'d self, plant: &'d PlantDescription) -> &'d [Field] {
        self.commands.as_deref().unwrap_or(&plant.commands)
    }

    /// Checks names, units and texts of one law.
    fn check(&self) -> Result<(), String> {
        let name = shown("law", &self.name)?;
        if !is_line(&self.tuning) {
            return Err(format!(
                "{name} describes its tuning on more than one line; use one line"
            ));
        }
        if self.tunable().next().is_some() == self.tuning.is_empty() {
            return Err(format!(
                "{name} must describe its tuning if and only if it has tunable parameters"
            ));
        }
        let commands = self.commands.as_deref().unwrap_or_default();
        let (commanded, inner) = (commands.len(), self.internals.len());
        if commanded <= MAX_SIGNALS && commanded + inner > MAX_SIGNALS {
            return Err(format!(
                "{name} has {commanded} commands and {inner} internals; a frame carries at most {MAX_SIGNALS} of both together"
            ));
        }
        check_tables(
            &name,
            [
                ("parameters", &self.parameters, MOST_FIELDS),
                ("model", &self.model, MOST_FIELDS),
                ("measured", &self.measured, MAX_SIGNALS),
                ("reference", &self.reference, MAX_SIGNALS),
                ("commands", commands, MAX_SIGNALS),
                ("internals", &self.internals, MAX_SIGNALS),
                (
                    "state",
                    self.state.as_deref().unwrap_or_default(),
                    MOST_FIELDS,
                ),
            ],
        )
    }

    /// Returns `true` if a scenario could mean either of the two laws.
    fn is_for_one_with(&self, other: &Self) -> bool {
        let is_shared = self.plants.iter().any(|plant| other.plants.contains(plant));
        let is_for_any = self.plants.is_empty() || other.plants.is_empty();
        self.name == other.name && (is_for_any || is_shared)
    }
}

/// Combination of parameters that a model or law rejects at its start.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Invalid(pub String);

mod imported;
mod port;
mod rows;
mod settings;

pub use imported::{
    DefinedUnit, DirectDependency, Imported, ImportedModule, LeftOut, LibraryNeeds,
};
pub use port::PortPlant;
pub use settings::{MissingSetting, ModelSettings, Setting, Settings};

#[cfg(test)]
mod tests;
