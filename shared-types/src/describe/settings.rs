//! Settings of an imported model, such as an FMU, applied when an instance of it is created.
//!
//! Read from a scenario without knowledge of the model; the program that runs the model checks names and values.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::Invalid;

/// Settings of an imported model, for one side.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelSettings {
    /// Relative tolerance of the model's solver.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<f64>,
    /// Model time at step 0, in s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start_time_s: Option<f64>,
    /// Last time that will be requested of the model, in s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop_time_s: Option<f64>,
    /// Initial values by name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub initial: BTreeMap<String, f64>,
    /// Texts by name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub texts: BTreeMap<String, String>,
    /// Absolute file paths by name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub files: BTreeMap<String, String>,
    /// Structural parameters by name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub structural: BTreeMap<String, u64>,
}

impl ModelSettings {
    /// Parses an argument made by [`argument`](Self::argument).
    ///
    /// # Errors
    /// If the text has another form.
    pub fn parse(text: &str) -> Result<Self, Invalid> {
        serde_json::from_str(text).map_err(|error| Invalid(error.to_string()))
    }

    /// Formats the settings as a program argument; `None` if there are none.
    #[must_use]
    pub fn argument(&self) -> Option<String> {
        self.given().next()?;
        serde_json::to_string(self).ok()
    }

    /// Names of the keys that have a value.
    pub fn given(&self) -> impl Iterator<Item = &'static str> {
        let keys = [
            ("tolerance", self.tolerance.is_some()),
            ("start_time_s", self.start_time_s.is_some()),
            ("stop_time_s", self.stop_time_s.is_some()),
            ("initial", !self.initial.is_empty()),
            ("texts", !self.texts.is_empty()),
            ("files", !self.files.is_empty()),
            ("structural", !self.structural.is_empty()),
        ];
        (keys.into_iter()).filter_map(|(key, is_given)| is_given.then_some(key))
    }
}
