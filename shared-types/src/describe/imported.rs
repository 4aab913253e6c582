//! Facts that a program gives of a model that another tool made, as an FMU, besides its tables.
//!
//! Made by the program that runs such a model, shown by `hil describe`. No run depends on it.

use serde::{Deserialize, Serialize};

use crate::table::number;

/// Facts of a model of another tool.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Imported {
    /// Standard and version, for example `FMI 3.0 co-simulation`.
    pub format: String,
    /// Tool that made it; empty if it is not told.
    #[serde(default)]
    pub tool: String,
    /// Step of its own solver in s, if that is fixed and told; a period must be a multiple.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub internal_step_s: Option<f64>,
    /// Outputs that depend directly on inputs.
    #[serde(default)]
    pub direct: Vec<DirectDependency>,
    /// Inner signals that are recorded on request alone.
    #[serde(default)]
    pub locals: Vec<String>,
    /// Variables whose initial values can be set, besides the inputs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub initial: Vec<String>,
    /// Units as the model defines them.
    #[serde(default)]
    pub units: Vec<DefinedUnit>,
    /// Variables that became neither signal nor parameter.
    #[serde(default)]
    pub left_out: Vec<LeftOut>,
    /// Attributes of the model that make no sense and are ignored.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Needs of its shared library, if that was loaded to find them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub library: Option<LibraryNeeds>,
}

/// Needs of a shared library, and those of them that this machine does not meet.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LibraryNeeds {
    /// Libraries that it names.
    #[serde(default)]
    pub needs: Vec<String>,
    /// Libraries that it names and that cannot be loaded.
    #[serde(default)]
    pub lacks_libraries: Vec<String>,
    /// Symbols that it must have from others and that nothing loaded here defines.
    #[serde(default)]
    pub lacks_symbols: Vec<String>,
    /// Reason for which it cannot be loaded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refusal: Option<String>,
}

/// An output that depends directly on inputs: it shows the command of the step before.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DirectDependency {
    /// Name of the output.
    pub output: String,
    /// Names of the inputs.
    pub inputs: Vec<String>,
}

/// A unit as a model defines it: a value `v` is `factor v + offset` in base units.
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

/// A variable that became neither signal nor parameter.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeftOut {
    /// Name in the model.
    pub name: String,
    /// Reason.
    pub reason: String,
}
