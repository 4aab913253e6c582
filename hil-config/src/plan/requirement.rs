//! Requirements: conditions under which a run passes.

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
}
