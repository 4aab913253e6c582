//! Changes of values while a run goes on.

use serde::{Deserialize, Serialize};
use shared_types::describe::Settings;
use shared_types::record::ChangedValue;
use shared_types::time::Step;

/// Prefix of the plant's parameters among the keys of changes.
pub const PLANT_KEYS: &str = "plant.parameters.";
/// Prefix of reference signals among the keys of changes.
pub const REFERENCE_KEYS: &str = "reference.";

/// Prefix of the parameters of a law among the keys of changes.
#[must_use]
pub fn law_keys(law: &str) -> String {
    format!("controller.{law}.")
}

/// Values that change at one step, all together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Number in the order of the file, from 1; a live change's is the next free one.
    pub id: u32,
    /// First step of the change; `None`: the next that begins, only live.
    pub step: Option<Step>,
    /// Steps until the values are reached; 0: at once.
    #[serde(default)]
    pub ramp_steps: u64,
    /// True if it was asked for while the run went on.
    #[serde(default)]
    pub live: bool,
    /// New values by the full names of their keys, in the order of the names.
    #[serde(default)]
    pub set: Vec<ChangedValue>,
    /// Keys of reference signals that follow their stimulus again, in order.
    #[serde(default)]
    pub clear: Vec<String>,
}

/// Lists the settings that changes make of others, one after the other: of the parameters whose keys have a
/// prefix.
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
