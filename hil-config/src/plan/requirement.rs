//! Requirements: conditions under which a run passes.

use serde::Serialize;

use crate::formula::Formula;

/// Requirement.
#[derive(Clone, Debug, PartialEq)]
pub struct Requirement {
    /// Name.
    pub name: String,
    /// Description of the requirement; may be empty.
    pub description: String,
    /// Formula that must hold at step 0.
    pub formula: Formula,
    /// Unit of the robustness: as given, or else the common unit of all signals by their names, or empty.
    pub unit: String,
    /// Identifiers by which other documents know the requirement.
    pub trace: Trace,
}

/// Identifiers that link a requirement of a scenario to the documents it comes from.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Trace {
    /// Identifier of this requirement as a test, if it has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// Identifiers of the requirements in other documents that this one verifies.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub verifies: Vec<String>,
}
