//! The manifest of a campaign: identifies the folder's content by names and hashes.
//!
//! `plan` and `grow` write it, and all other verbs read it. Everything derived from it is the same on every machine;
//! it contains no times, hosts or engines.
//!
//! The key `blake3` holds the hash of the whole file, computed with zeros in place of its digits: with a damaged
//! manifest a campaign would mistake its own results for those of another campaign. Manifests of earlier versions lack the
//! key.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

pub use hil_console::files::kind::MANIFEST;
use hil_facts::results::curve::Grid;
use serde::de::Error as _;
use serde::{Deserialize, Serialize};

use crate::table::Column;

/// Version of the folder format.
pub(crate) const SCHEMA: u32 = 1;
/// Version of the folder format for campaigns that grew.
pub(crate) const GROWN: u32 = 2;

/// A file of the folder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Copied {
    /// Path in the folder.
    pub path: String,
    /// Hash of its content.
    pub blake3: String,
}

/// Earlier extent of a campaign that grew.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stage {
    /// Identity of the campaign at this stage, carried by the parts written at that time.
    pub id: String,
    /// Number of cases up to and including this stage.
    pub cases: u64,
    /// Number of cases in each shard that this stage added.
    pub shard_cases: u64,
}

/// Faults of a campaign that tries some: what is left out, and what the check refuses.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FaultPlan {
    /// Kinds and targets that no case tries.
    pub untried: Vec<Untried>,
    /// Cases whose fault the check refuses, with the reason; they are not run.
    pub impossible: BTreeMap<u64, String>,
}

/// Kind of fault with the targets on which no case tries it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Untried {
    /// Kind.
    pub kind: String,
    /// Targets, at least one.
    pub targets: Vec<String>,
}

/// Content of a campaign's manifest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of the folder format.
    pub schema: u32,
    /// Name of the study.
    pub name: String,
    /// Number of cases.
    pub cases: u64,
    /// Number of cases per shard, of the last growth if the campaign grew; the last shard may have fewer.
    pub shard_cases: u64,
    /// Earlier extents, oldest first; their shards remain unchanged.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub grown: Vec<Stage>,
    /// The study.
    pub study: Copied,
    /// The scenario.
    pub scenario: Copied,
    /// Copies of the point tables to which the scenario and the study refer, by the names used there.
    pub tables: BTreeMap<String, Copied>,
    /// Copy of `hil`, which runs the cases.
    pub hil: Copied,
    /// Plant program; `None` for a plant that is built into `hil`.
    pub plant: Option<Copied>,
    /// Controller program; `None` for a law that is built into `hil`.
    pub controller: Option<Copied>,
    /// Plant and controller programs that can run a case of built-in plant and law in two processes; `None` if they
    /// were not next to `hil`. They never compute rows of the campaign.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pair: Option<[Copied; 2]>,
    /// Columns of the table of results.
    pub columns: Vec<Column>,
    /// Grid of the signals whose curves are recorded for the report.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub curves: Option<Grid>,
    /// Faults of a study that tries some.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub faults: Option<FaultPlan>,
    /// Duration of a case, measured during planning, in s; determines only the size of jobs.
    pub case_s: f64,
}

/// Manifest with its checksum, as stored in the file.
#[derive(Serialize)]
struct Sealed<'a> {
    #[serde(flatten)]
    manifest: &'a Manifest,
    blake3: &'a str,
}

/// Checksum of a manifest file.
#[derive(Deserialize)]
struct Seal {
    blake3: Option<String>,
}

/// Placeholder for the checksum while it is computed.
const NO_SUM: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// Error of reading a manifest.
#[derive(Debug, thiserror::Error)]
pub enum ManifestError {
    /// The file cannot be read.
    #[error("{0} is not a campaign folder: {1}; `hil campaign plan STUDY -o DIR` creates one")]
    Absent(String, std::io::Error),
    /// The file cannot be parsed.
    #[error("{0}/{MANIFEST} is invalid: {1}")]
    Broken(String, serde_json::Error),
    /// The checksum does not match the content.
    #[error(
        "{0}/{MANIFEST} is damaged: its checksum does not match its content; no result was changed; restore the file"
    )]
    Damaged(String),
    /// The format version is not supported.
    #[error("{0} has format version {1}; this hil supports the versions {SCHEMA} and {GROWN}")]
    Version(String, u32),
}

impl Manifest {
    /// Reads the manifest of a folder.
    ///
    /// # Errors
    /// If the file is missing or invalid.
    pub fn read(folder: &Path) -> Result<Self, ManifestError> {
        Self::read_sealed(folder).map(|(manifest, _)| manifest)
    }

    /// Reads the manifest of a folder; also returns `true` if the manifest has a checksum, which then matches.
    ///
    /// # Errors
    /// If the file is missing or invalid, or its checksum does not match.
    pub(crate) fn read_sealed(folder: &Path) -> Result<(Self, bool), ManifestError> {
        let folder_text = || folder.display().to_string();
        let text = std::fs::read(folder.join(MANIFEST))
            .map_err(|error| ManifestError::Absent(folder_text(), error))?;
        let broken = |error| ManifestError::Broken(folder_text(), error);
        let Seal { blake3: sum } = serde_json::from_slice(&text).map_err(broken)?;
        if let Some(sum) = &sum {
            let text = String::from_utf8_lossy(&text);
            let unsealed = text.replacen(sum.as_str(), NO_SUM, 1);
            if *blake3::hash(unsealed.as_bytes()).to_hex() != **sum {
                return Err(ManifestError::Damaged(folder_text()));
            }
        }
        let manifest: Self = serde_json::from_slice(&text).map_err(broken)?;
        if ![SCHEMA, GROWN].contains(&manifest.schema) {
            return Err(ManifestError::Version(folder_text(), manifest.schema));
        }
        let is_sound = |(cases, size): (Range<u64>, u64)| size > 0 && cases.start <= cases.end;
        if !manifest.extents().all(is_sound) {
            let error = serde_json::Error::custom("its shards are inconsistent");
            return Err(ManifestError::Broken(folder_text(), error));
        }
        Ok((manifest, sum.is_some()))
    }

    /// Formats the manifest as the text of the file, with its checksum.
    ///
    /// # Errors
    /// If the manifest cannot be serialised.
    pub(crate) fn sealed_text(&self) -> serde_json::Result<String> {
        let text = |blake3| {
            serde_json::to_string_pretty(&Sealed {
                manifest: self,
                blake3,
            })
        };
        text(&blake3::hash(text(NO_SUM)?.as_bytes()).to_hex())
    }

    /// Returns the identity of the campaign: a hash over everything that determines its results.
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

    /// Returns the index of a column of results.
    pub(crate) fn place(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.name == name)
    }

    /// Iterates over the extents: the cases of each and their number per shard.
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

    /// Returns the number of shards.
    pub(crate) fn shards(&self) -> u64 {
        let extents = self.extents();
        extents.map(|(cases, size)| shards_of(&cases, size)).sum()
    }

    /// Returns the cases of a shard; empty for a shard that does not exist.
    pub(crate) fn cases_of(&self, shard: u64) -> Range<u64> {
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

    /// Returns the shard of a case.
    pub(crate) fn shard_of(&self, case: u64) -> u64 {
        let extents = self.extents().map(|(cases, size)| match case {
            case if case < cases.start => 0,
            case if case < cases.end => (case - cases.start) / size,
            _ => shards_of(&cases, size),
        });
        extents.sum()
    }

    /// Counts the cases of the given shards.
    pub(crate) fn count(&self, shards: &[u64]) -> u64 {
        let cases = shards.iter().map(|shard| self.cases_of(*shard));
        cases.map(|cases| cases.end - cases.start).sum()
    }

    /// Iterates over the files that determine the cases, with their hashes. `hil` is not among them: a worker checks
    /// its own executable.
    pub fn files(&self) -> impl Iterator<Item = &Copied> {
        [&self.study, &self.scenario]
            .into_iter()
            .chain(self.tables.values())
            .chain(&self.plant)
            .chain(&self.controller)
    }

    /// Returns the copies of plant and controller program for a case in two processes, if they exist.
    pub(crate) fn both(&self) -> Option<[&Copied; 2]> {
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

/// Describes the differences between two manifests for a person.
pub(crate) fn differences(one: &Manifest, other: &Manifest) -> Vec<String> {
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
    let mut differences: Vec<String> = (pairs.into_iter())
        .map(|(what, one, other)| (what, copied(one), copied(other)))
        .filter(|(_, one, other)| one != other)
        .map(|(what, one, other)| format!("{what}: {} and {}", short(&one), short(&other)))
        .collect();
    if one.tables != other.tables {
        differences.push("tables of points".into());
    }
    differences
}

/// First digits of a hash.
fn short(hash: &str) -> &str {
    hash.get(..12).unwrap_or(hash)
}
