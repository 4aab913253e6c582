//! The manifest of a campaign: the purpose of its folder, by names and hashes.
//!
//! Written once when a campaign is planned, read by everybody who works on it. What follows from it is the same
//! on every machine; times, hosts and engines never stand in it.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::curve::Grid;
use crate::table::Column;

/// Version of the folder's form.
pub const SCHEMA: u32 = 1;
/// Name of the file in the folder.
pub const MANIFEST: &str = "manifest.json";

/// A file of the folder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Copied {
    /// Its path in the folder.
    pub path: String,
    /// Hash of its content.
    pub blake3: String,
}

/// Purpose of a folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of the folder's form.
    pub schema: u32,
    /// Name of the study.
    pub name: String,
    /// Number of cases.
    pub cases: u64,
    /// Number of cases in a shard; the last may have fewer.
    pub shard_cases: u64,
    /// The study.
    pub study: Copied,
    /// The scenario.
    pub scenario: Copied,
    /// Copies of the tables of points that scenario and study name, by their names there.
    pub tables: BTreeMap<String, Copied>,
    /// The program that works on it.
    pub hil: Copied,
    /// Plant program; none for a plant that is built into `hil`.
    pub plant: Option<Copied>,
    /// Controller program; none for a law that is built into `hil`.
    pub controller: Option<Copied>,
    /// Columns of the table of results.
    pub columns: Vec<Column>,
    /// Signals whose curves are kept for the report.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub curves: Option<Grid>,
    /// Time in s that a case took when the campaign was planned; nothing but the size of jobs depends on it.
    pub case_s: f64,
}

/// Reason for which a manifest is none.
#[derive(Debug, thiserror::Error)]
pub enum ManifestError {
    /// The file cannot be read.
    #[error("{0} is no folder of a campaign: {1}; `hil campaign plan STUDY -o DIR` makes one")]
    Absent(String, std::io::Error),
    /// The file cannot be understood.
    #[error("{0}/{MANIFEST} is broken: {1}")]
    Broken(String, serde_json::Error),
    /// The folder has another form.
    #[error("{0} has form {1}, and this hil knows form {SCHEMA}")]
    Version(String, u32),
}

impl Manifest {
    /// Reads the manifest of a folder.
    ///
    /// # Errors
    /// If there is none, or it cannot be understood.
    pub fn read(folder: &Path) -> Result<Self, ManifestError> {
        let shown = || folder.display().to_string();
        let text = std::fs::read(folder.join(MANIFEST))
            .map_err(|error| ManifestError::Absent(shown(), error))?;
        let manifest: Self =
            serde_json::from_slice(&text).map_err(|error| ManifestError::Broken(shown(), error))?;
        match manifest.schema {
            SCHEMA => Ok(manifest),
            other => Err(ManifestError::Version(shown(), other)),
        }
    }

    /// Identity of the campaign: a hash over everything that its results follow from.
    #[must_use]
    pub fn id(&self) -> String {
        let same = Self {
            case_s: 0.0,
            ..self.clone()
        };
        let text = serde_json::to_vec(&same).unwrap_or_default();
        blake3::hash(&text).to_hex().to_string()
    }

    /// Number of shards.
    #[must_use]
    pub const fn shards(&self) -> u64 {
        self.cases.div_ceil(self.shard_cases)
    }

    /// Cases of a shard.
    #[must_use]
    pub const fn cases_of(&self, shard: u64) -> Range<u64> {
        let end = (shard + 1) * self.shard_cases;
        let end = if end < self.cases { end } else { self.cases };
        shard * self.shard_cases..end
    }

    /// Number of cases of some shards.
    #[must_use]
    pub fn count(&self, shards: &[u64]) -> u64 {
        let cases = shards.iter().map(|shard| self.cases_of(*shard));
        cases.map(|cases| cases.end - cases.start).sum()
    }

    /// Files that cases are made of, with their hashes. `hil` is not among them: a worker looks at itself.
    pub fn files(&self) -> impl Iterator<Item = &Copied> {
        [&self.study, &self.scenario]
            .into_iter()
            .chain(self.tables.values())
            .chain(&self.plant)
            .chain(&self.controller)
    }
}

/// Names of the differences between two manifests, for a person.
#[must_use]
pub fn differences(one: &Manifest, other: &Manifest) -> Vec<String> {
    let copied = |file: Option<&Copied>| file.map_or("none".into(), |file| file.blake3.clone());
    let pairs = [
        ("study", Some(&one.study), Some(&other.study)),
        ("scenario", Some(&one.scenario), Some(&other.scenario)),
        ("hil", Some(&one.hil), Some(&other.hil)),
        ("plant program", one.plant.as_ref(), other.plant.as_ref()),
        (
            "controller program",
            one.controller.as_ref(),
            other.controller.as_ref(),
        ),
    ];
    let mut found: Vec<String> = (pairs.into_iter())
        .map(|(what, one, other)| (what, copied(one), copied(other)))
        .filter(|(_, one, other)| one != other)
        .map(|(what, one, other)| format!("{what}: {} and {}", short(&one), short(&other)))
        .collect();
    if one.tables != other.tables {
        found.push("tables of points".into());
    }
    found
}

/// First digits of a hash.
fn short(hash: &str) -> &str {
    hash.get(..12).unwrap_or(hash)
}
