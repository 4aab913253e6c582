//! Settings in a job: named values, and those of an imported model, such as an FMU, which are applied when an instance
//! of it is created.
//!
//! Those of a model are read from a scenario without knowledge of the model; the program that runs the model checks
//! names and values.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::Invalid;
use crate::table::{Field, Table, number};

/// Named values in a job file: parameters, safe commands or fault magnitudes. Settings of a process's loop are
/// [`realtime::Settings`](crate::realtime::Settings).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Settings(pub BTreeMap<String, Setting>);

/// Value in a job file; infinities are written as text.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Setting(#[serde(with = "number")] pub f64);

/// Missing setting of a table's row.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("parameter `{key}` is missing from the job; a scenario sets it under this key")]
pub struct MissingSetting {
    /// Key in the scenario.
    pub key: String,
}

impl From<MissingSetting> for Invalid {
    fn from(missing: MissingSetting) -> Self {
        Self(missing.to_string())
    }
}

impl Settings {
    /// Sets a value.
    pub fn set(&mut self, name: &str, value: f64) {
        self.0.insert(name.into(), Setting(value));
    }

    /// Returns `true` if nothing is set.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns the value of a name, if set.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<f64> {
        self.0.get(name).map(|setting| setting.0)
    }

    /// Returns the settings of a table's row.
    #[must_use]
    pub fn of<T: Table>(table: &T) -> Self {
        let mut settings = Self::default();
        for (field, value) in T::fields().iter().zip(table.row()) {
            settings.set(&field.name, *value);
        }
        settings
    }

    /// Builds the row of a table from the settings in the scenario's `section`, for example `plant.parameters`.
    ///
    /// # Errors
    /// If a column of the table has no setting.
    pub fn to_table<T: Table>(&self, section: &str) -> Result<T, MissingSetting> {
        Ok(T::from_row(&self.row(&T::fields(), section)?))
    }

    /// Builds a row of these columns, like [`to_table`](Self::to_table).
    ///
    /// # Errors
    /// If a column has no setting.
    pub fn row(&self, fields: &[Field], section: &str) -> Result<Vec<f64>, MissingSetting> {
        let missing = |name: &str| MissingSetting {
            key: format!("{section}.{name}"),
        };
        let value = |field: &Field| self.get(&field.name).ok_or_else(|| missing(&field.name));
        fields.iter().map(value).collect()
    }
}

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
