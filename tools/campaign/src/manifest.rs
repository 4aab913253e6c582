//! The manifest of a campaign: the purpose of its folder, by names and hashes.
//!
//! Written once when a campaign is planned, read by everybody who works on it. What follows from it is the same
//! on every machine; times, hosts and engines never stand in it.
//!
//! A key `blake3` has the hash of the whole file, taken with zeros in the place of its digits: a campaign whose
//! manifest is damaged would take its own results for those of another one. A manifest of an earlier version has none.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

pub use hil_console::files::kind::MANIFEST;
use hil_facts::results::curve::Grid;
use serde::de::Error as _;
use serde::{Deserialize, Serialize};

use crate::table::Column;

/// Version of the folder's form.
pub const SCHEMA: u32 = 1;
/// Version of the form of a folder whose campaign grew.
pub const GROWN: u32 = 2;

/// A file of the folder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Copied {
    /// Path in the folder.
    pub path: String,
    /// Hash of its content.
    pub blake3: String,
}

/// An earlier extent of a campaign that grew.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stage {
    /// Identity of the campaign then, which its parts still have.
    pub id: String,
    /// Number of cases then.
    pub cases: u64,
    /// Number of cases in each shard that it added.
    pub shard_cases: u64,
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
    /// Number of cases in a shard, of a campaign that grew in those of its last growth; the last may have fewer.
    pub shard_cases: u64,
    /// Extents before it grew, the first one first. Their shards stay as they are.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub grown: Vec<Stage>,
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
    /// Plant and controller program that run a case of what is built into `hil` in two processes; none if they were
    /// not beside it. No row of the campaign comes from them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pair: Option<[Copied; 2]>,
    /// Columns of the table of results.
    pub columns: Vec<Column>,
    /// Signals whose curves are kept for the report.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub curves: Option<Grid>,
    /// Time in s that a case took when the campaign was planned; nothing but the size of jobs depends on it.
    pub case_s: f64,
}

/// A manifest as the file has it.
#[derive(Serialize)]
struct Sealed<'a> {
    #[serde(flatten)]
    manifest: &'a Manifest,
    blake3: &'a str,
}

/// The check sum of a manifest's file.
#[derive(Deserialize)]
struct Seal {
    blake3: Option<String>,
}

/// Digits that stand for the check sum while it is taken.
const NO_SUM: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// Reason for which a manifest is none.
#[derive(Debug, thiserror::Error)]
pub enum ManifestError {
    /// The file cannot be read.
    #[error("{0} is no folder of a campaign: {1}; `hil campaign plan STUDY -o DIR` makes one")]
    Absent(String, std::io::Error),
    /// The file cannot be understood.
    #[error("{0}/{MANIFEST} is broken: {1}")]
    Broken(String, serde_json::Error),
    /// The check sum is that of another content.
    #[error(
        "{0}/{MANIFEST} is damaged: its check sum is not that of its content; no result was touched, so put the file back as it was"
    )]
    Damaged(String),
    /// The folder has another form.
    #[error("{0} has form {1}, and this hil knows the forms {SCHEMA} and {GROWN}")]
    Version(String, u32),
}

impl Manifest {
    /// Reads the manifest of a folder.
    ///
    /// # Errors
    /// If there is none, or it cannot be understood.
    pub fn read(folder: &Path) -> Result<Self, ManifestError> {
        Self::read_sealed(folder).map(|(manifest, _)| manifest)
    }

    /// Reads the manifest of a folder; `true` beside it if it has a check sum, which is right.
    ///
    /// # Errors
    /// If there is none, or it cannot be understood, or its check sum is another.
    pub fn read_sealed(folder: &Path) -> Result<(Self, bool), ManifestError> {
        let shown = || folder.display().to_string();
        let text = std::fs::read(folder.join(MANIFEST))
            .map_err(|error| ManifestError::Absent(shown(), error))?;
        let broken = |error| ManifestError::Broken(shown(), error);
        let Seal { blake3: sum } = serde_json::from_slice(&text).map_err(broken)?;
        if let Some(sum) = &sum {
            let text = String::from_utf8_lossy(&text);
            let unsealed = text.replacen(sum.as_str(), NO_SUM, 1);
            if *blake3::hash(unsealed.as_bytes()).to_hex() != **sum {
                return Err(ManifestError::Damaged(shown()));
            }
        }
        let manifest: Self = serde_json::from_slice(&text).map_err(broken)?;
        if ![SCHEMA, GROWN].contains(&manifest.schema) {
            return Err(ManifestError::Version(shown(), manifest.schema));
        }
        let is_sound = |(cases, size): (Range<u64>, u64)| size > 0 && cases.start <= cases.end;
        if !manifest.extents().all(is_sound) {
            let error = serde_json::Error::custom("its shards cannot be counted");
            return Err(ManifestError::Broken(shown(), error));
        }
        Ok((manifest, sum.is_some()))
    }

    /// Writes the text of the file, with its check sum.
    ///
    /// # Errors
    /// If it cannot be written as JSON.
    pub fn sealed_text(&self) -> serde_json::Result<String> {
        let text = |blake3| {
            serde_json::to_string_pretty(&Sealed {
                manifest: self,
                blake3,
            })
        };
        text(&blake3::hash(text(NO_SUM)?.as_bytes()).to_hex())
    }

    /// Identity of the campaign: a hash over everything that its results follow from.
    #[must_use]
    pub fn id(&self) -> String {
        let same = Self {
            case_s: 0.0,
            pair: None,
            ..self.clone()
        };
        let text = serde_json::to_vec(&same).unwrap_or_default();
        blake3::hash(&text).to_hex().to_string()
    }

    /// Returns the place of a column of the results.
    #[must_use]
    pub fn place(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.name == name)
    }

    /// Cases of each extent, with the number of them in a shard.
    fn extents(&self) -> impl Iterator<Item = (Range<u64>, u64)> {
        let stages = self
            .grown
            .iter()
            .map(|stage| (stage.cases, stage.shard_cases));
        let ends = stages.chain([(self.cases, self.shard_cases)]);
        ends.scan(0, |start, (end, size)| {
            Some((std::mem::replace(start, end)..end, size))
        })
    }

    /// Number of shards.
    #[must_use]
    pub fn shards(&self) -> u64 {
        let extents = self.extents();
        extents.map(|(cases, size)| shards_of(&cases, size)).sum()
    }

    /// Cases of a shard; none of one that is not there.
    #[must_use]
    pub fn cases_of(&self, shard: u64) -> Range<u64> {
        let mut before = 0;
        for (cases, size) in self.extents() {
            let number = shard - before;
            let shards = shards_of(&cases, size);
            if number < shards {
                let start = cases.start + number * size;
                return start..cases.end.min(start + size);
            }
            before += shards;
        }
        self.cases..self.cases
    }

    /// Shard of a case.
    #[must_use]
    pub fn shard_of(&self, case: u64) -> u64 {
        let extents = self.extents().map(|(cases, size)| match case {
            case if case < cases.start => 0,
            case if case < cases.end => (case - cases.start) / size,
            _ => shards_of(&cases, size),
        });
        extents.sum()
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

    /// Plant and controller program of a case in two processes, if there are copies of them.
    #[must_use]
    pub fn both(&self) -> Option<[&Copied; 2]> {
        match (&self.plant, &self.controller, &self.pair) {
            (Some(plant), Some(controller), _) | (_, _, Some([plant, controller])) => {
                Some([plant, controller])
            }
            _ => None,
        }
    }
}

const fn shards_of(cases: &Range<u64>, size: u64) -> u64 {
    (cases.end - cases.start).div_ceil(size)
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
