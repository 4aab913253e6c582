//! Facts of a run from its summary.

use std::path::{Path, PathBuf};

use hil_console::files::runs::{self, SUMMARY};
use hil_console::terminal::exit::Failure;
use hil_facts::results::requirements::VACUOUS;
use hil_recording::reader::RECORDING;
use serde::Deserialize;
use shared_types::text::{line_if_any, line_of, lines_of};

/// Run with the results of its requirements.
#[derive(Debug, Deserialize)]
pub(super) struct RecordedRun {
    /// Folder as given by the user.
    #[serde(skip)]
    pub(super) folder: PathBuf,
    #[serde(deserialize_with = "line_of")]
    pub(super) scenario: String,
    #[serde(default, deserialize_with = "lines_of")]
    pub(super) set: Vec<String>,
    #[serde(default, deserialize_with = "line_if_any")]
    pub(super) started_utc: Option<String>,
    /// Name of the session.
    #[serde(default, deserialize_with = "line_of")]
    session: String,
    /// Level of evidence, such as `sil`.
    #[serde(default, deserialize_with = "line_of")]
    pub(super) evidence: String,
    /// Verdict of the run.
    #[serde(deserialize_with = "line_of")]
    pub(super) verdict: String,
    #[serde(default, deserialize_with = "line_if_any")]
    pub(super) reason: Option<String>,
    #[serde(default, deserialize_with = "line_if_any")]
    pub(super) digest: Option<String>,
    pub(super) wall_time_s: f64,
    pub(super) requirements: Vec<Test>,
    pub(super) plant: Program,
    pub(super) controller: Program,
}

/// Requirement of a scenario with its result.
#[derive(Debug, Deserialize)]
pub(super) struct Test {
    #[serde(deserialize_with = "line_of")]
    pub(super) name: String,
    #[serde(deserialize_with = "line_of")]
    pub(super) formula: String,
    #[serde(deserialize_with = "line_of")]
    pub(super) verdict: String,
    pub(super) robustness: Option<f64>,
    #[serde(deserialize_with = "line_of")]
    pub(super) unit: String,
    pub(super) at_s: Option<f64>,
    pub(super) decided_at_s: Option<f64>,
    /// Premise that never called for its conclusion, of a requirement that passed.
    #[serde(default, deserialize_with = "line_if_any")]
    pub(super) vacuous: Option<String>,
    #[serde(default, deserialize_with = "line_if_any")]
    pub(super) id: Option<String>,
    #[serde(default, deserialize_with = "lines_of")]
    pub(super) verifies: Vec<String>,
}

impl Test {
    /// Returns the verdict, or `vacuous` for a pass that shows nothing.
    pub(super) fn outcome(&self) -> &str {
        match self.vacuous {
            Some(_) => VACUOUS,
            None => &self.verdict,
        }
    }
}

/// Program of a side.
#[derive(Debug, Deserialize)]
pub(super) struct Program {
    #[serde(deserialize_with = "line_of")]
    pub(super) binary: String,
    #[serde(deserialize_with = "line_of")]
    pub(super) blake3: String,
}

/// Facts that two summaries share only if they are of the same run.
#[derive(Debug, PartialEq, Eq, Hash)]
pub(super) struct Identity {
    session: String,
    started_utc: String,
    digest: Option<String>,
    scenario: String,
    set: Vec<String>,
    wall_time_bits: u64,
}

impl RecordedRun {
    /// Returns the identity; `None` without a start time.
    pub(super) fn identity(&self) -> Option<Identity> {
        Some(Identity {
            session: self.session.clone(),
            started_utc: self.started_utc.clone()?,
            digest: self.digest.clone(),
            scenario: self.scenario.clone(),
            set: self.set.clone(),
            wall_time_bits: self.wall_time_s.to_bits(),
        })
    }

    /// Reads the summary in the folder of a run, or beside its recording.
    pub(super) fn read(path: &Path) -> Result<Self, Failure> {
        let folder = match path.parent() {
            Some(folder) if path.is_file() => folder,
            _ => path,
        };
        let file = folder.join(SUMMARY);
        let file_text = file.display();
        let summary = runs::summary(&file).ok_or_else(|| {
            let path_text = path.display();
            Failure::usage(if !path.exists() {
                format!("there is no run {path_text}; `hil runs` lists those made here")
            } else if file.exists() {
                format!("cannot read {file_text}: it is not JSON, or too large")
            } else if folder.join(RECORDING).exists() {
                format!(
                    "{file_text} is missing; `hil recover {}` makes it from the recording",
                    folder.display()
                )
            } else {
                format!("{path_text} is no run: it has neither a summary nor a recording")
            })
        })?;
        let run: Self = serde_json::from_value(summary)
            .map_err(|error| Failure::usage(format!("{file_text} is not a summary: {error}")))?;
        Ok(Self {
            folder: folder.to_owned(),
            ..run
        })
    }
}
