//! Changes of values during a run.

use serde::{Deserialize, Serialize};
use shared_types::describe::Settings;
use shared_types::record::ChangedValue;
use shared_types::time::Step;

/// Prefix of plant parameters in the keys of changes.
pub const PLANT_KEYS: &str = "plant.parameters.";
/// Prefix of reference signals in the keys of changes.
pub const REFERENCE_KEYS: &str = "reference.";

/// Returns the prefix of a law's parameters in the keys of changes.
#[must_use]
pub fn law_keys(law: &str) -> String {
    format!("controller.{law}.")
}

/// Values that change together at one step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Number in file order, from 1; a live change has the next free one.
    pub id: u32,
    /// First step of the change; `None`, for live changes only, means the next step to begin.
    pub step: Option<Step>,
    /// Steps until the values are reached; 0 means at once.
    #[serde(default)]
    pub ramp_steps: u64,
    /// `true` if the change was requested during the run.
    #[serde(default)]
    pub live: bool,
    /// New values by the full names of their keys, sorted by name.
    #[serde(default)]
    pub set: Vec<ChangedValue>,
    /// Keys of reference signals that return to their stimulus, in order.
    #[serde(default)]
    pub clear: Vec<String>,
}

/// Lists the successive settings of the parameters with this key prefix after each change.
#[must_use]
pub fn settings_after(changes: &[Change], prefix: &str, start: &Settings) -> Vec<Settings> {
    let mut in_order: Vec<&Change> = changes.iter().collect();
    in_order.sort_by_key(|change| (change.step, change.id));
    let mut present = start.clone();
    let mut after = Vec::new();
    for change in in_order {
        let own =
            (change.set.iter()).filter_map(|one| Some((one.key.strip_prefix(prefix)?, one.value)));
        let before = present.clone();
        own.for_each(|(name, value)| present.set(name, value));
        if present != before {
            after.push(present.clone());
        }
    }
    after
}
