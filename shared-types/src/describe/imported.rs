//! Facts about an imported model, such as an FMU made by another tool, in addition to its tables.
//!
//! Collected by the program that runs the model and shown by `hil describe`. No run depends on it.

use serde::{Deserialize, Serialize};

use crate::table::number;

/// Facts about an imported model.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Imported {
    /// Standard and version, for example `FMI 3.0 co-simulation`.
    pub format: String,
    /// Tool that made the model; empty if not stated.
    #[serde(default)]
    pub tool: String,
    /// Fixed step of the model's internal solver in s, if stated; every period must be a multiple of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub internal_step_s: Option<f64>,
    /// Outputs with direct feedthrough from inputs.
    #[serde(default)]
    pub direct: Vec<DirectDependency>,
    /// Internal signals that are recorded only on request.
    #[serde(default)]
    pub locals: Vec<String>,
    /// Variables with settable initial values, in addition to the inputs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub initial: Vec<String>,
    /// Continuous states by which the model differentiates its equations itself.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub continuous_states: Vec<String>,
    /// Units as the model defines them.
    #[serde(default)]
    pub units: Vec<DefinedUnit>,
    /// Variables exposed neither as signal nor as parameter.
    #[serde(default)]
    pub left_out: Vec<LeftOut>,
    /// Nonsensical attributes of the model, which are ignored.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Requirements of the model's shared library, if the library was loaded to find them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub library: Option<LibraryNeeds>,
}

/// Requirements of a shared library, and the ones that this machine does not meet.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LibraryNeeds {
    /// Libraries that the shared library links to.
    #[serde(default)]
    pub needs: Vec<String>,
    /// Linked libraries that cannot be loaded.
    #[serde(default)]
    pub lacks_libraries: Vec<String>,
    /// Required symbols that no loaded library defines.
    #[serde(default)]
    pub lacks_symbols: Vec<String>,
    /// Reason why the shared library cannot be loaded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refusal: Option<String>,
}

/// Output with direct feedthrough from inputs: its value reflects the command of the previous step.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DirectDependency {
    /// Name of the output.
    pub output: String,
    /// Names of the inputs.
    pub inputs: Vec<String>,
}

/// Unit as defined by a model: a value `v` is `factor v + offset` in base units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DefinedUnit {
    /// Name.
    pub name: String,
    /// Product of base units, for example `kg m2/s2`.
    pub base: String,
    /// Factor.
    #[serde(with = "number")]
    pub factor: f64,
    /// Offset.
    #[serde(with = "number")]
    pub offset: f64,
}

/// Variable exposed neither as signal nor as parameter.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeftOut {
    /// Name in the model.
    pub name: String,
    /// Reason.
    pub reason: String,
}
