//! Checkpoint to continue from, read and verified before anything is started.
//!
//! Nothing in the checkpoint is trusted: the states must have the recorded hashes, the records before the step must
//! have the recorded digest, and plant and controller must be the binaries that saved the states. Faults injected
//! during the run are read from its recording.

use std::fs;
use std::path::{Path, PathBuf};

use hil_config::plan::{FaultEvent, Plan};
use hil_config::scenario::Scenario;
use hil_console::files::folder::refuse_odd;
use hil_console::terminal::exit::Failure;
use hil_recording::reader::{ReadError, RunReader};
use hil_recording::schema::column_of;
use shared_types::checkpoint::{Checkpoints, Resume};
use shared_types::describe::PROTOCOL;
use shared_types::record::{RecordLayout, is_on_request};
use shared_types::side::Side;
use shared_types::time::Step;

use super::branch::{self, Branch};
use super::{Checkpoint, FILE, SCHEMA, SavedSide, hash};
use crate::arguments::run::Changes;
use crate::programs::binaries::named::{Recorded, refuse_set};
use crate::programs::binaries::{Binaries, Binary};
use crate::programs::scenario;
use crate::results::faults::FaultLog;
use crate::results::restoration::Check;
use crate::results::resumed::Resumed;
use crate::tables::FORMATS;

/// Past that a run continues.
#[derive(Clone, Debug)]
pub struct Past {
    /// Folder of the checkpoint.
    folder: PathBuf,
    checkpoint: Checkpoint,
    recording: PathBuf,
    /// Effective scenario.
    scenario: String,
    /// Fault events before the step.
    log: FaultLog,
    /// Recorded inputs of instruments.
    taps: Vec<String>,
}

/// Records before a checkpoint, for the recorder.
#[derive(Clone, Debug)]
pub struct PastRecords {
    /// Path of the recording.
    pub recording: PathBuf,
    /// Number of the records.
    pub count: u64,
    /// Their digest.
    pub digest: String,
    /// Layout of the records.
    pub layout: RecordLayout,
}

impl Past {
    /// Reads a checkpoint for these binaries.
    ///
    /// # Errors
    /// If the folder is not a checkpoint, is damaged, or was made by other binaries.
    pub fn open(folder: &Path, binaries: &Binaries) -> Result<Self, Failure> {
        let folder = std::path::absolute(folder).map_err(Failure::usage)?;
        refuse_odd(&folder)?;
        let checkpoint = read(&folder)?;
        let sides = [
            (&checkpoint.plant, &binaries.plant),
            (&checkpoint.controller, &binaries.controller),
        ];
        for (saved, binary) in sides {
            same_binary(saved, binary)?;
            whole(&folder, saved)?;
        }
        let recording = folder.join(&checkpoint.recording.file);
        // Avoids the path through the checkpoint's folder, if there is a recording.
        let recording = fs::canonicalize(&recording).unwrap_or(recording);
        let (scenario, log, taps) = past(&recording, &checkpoint).map_err(|error| {
            let path_text = folder.display();
            Failure::usage(format!("cannot continue from {path_text}: {error}"))
        })?;
        Ok(Self {
            folder,
            checkpoint,
            recording,
            scenario,
            log,
            taps,
        })
    }

    /// Returns the plan from the checkpoint on: the scenario with changes, as far as the past allows them.
    ///
    /// # Errors
    /// All problems of the scenario, and all contradictions with the past.
    pub fn plan(
        &self,
        changes: &Changes,
        binaries: &Binaries,
        json: bool,
    ) -> Result<(Plan, Branch), Failure> {
        refuse_set(&changes.set, |role| role.flag)?;
        let origin = format!("the scenario of {}", self.folder.display());
        let (plants, laws, kinds) = binaries.described();
        // The run's folder, which has its long tables wherever it was moved.
        let run = self.folder.parent().unwrap_or(&self.folder);
        let scenario = || {
            Scenario::parse(&self.scenario, &origin)
                .map(|scenario| scenario.beside(run).with_formats(FORMATS))
        };
        let then = scenario().and_then(|scenario| scenario.check(plants, laws, kinds))?;
        let mut now = scenario::check(scenario(), changes, binaries, json)?;
        for set in &changes.set {
            // Every key is written out, so a key for several of them at once would be overridden.
            let alone =
                scenario().and_then(|scenario| scenario.set(&[set]).check(plants, laws, kinds));
            if alone.is_ok_and(|alone| alone == then) {
                tell!(
                    "note: --set {set} changes nothing in {origin}, which has this value or a more specific key"
                );
            }
        }
        match branch::check(&then, &now, self.first(), &self.log) {
            Ok(branch) => {
                // The records of both parts have one layout.
                if let Some(plant) = now.plant_among(plants) {
                    now.tap(&plant, |name| self.taps.contains(&column_of(name)));
                }
                Ok((now, branch))
            }
            Err(reasons) => Err(Failure::usage(format!(
                "{} cannot continue with these changes:\n  {}",
                self.folder.display(),
                reasons.join("\n  ")
            ))),
        }
    }

    /// Returns the first step to exchange.
    #[must_use]
    pub const fn first(&self) -> Step {
        Step(self.checkpoint.step)
    }

    /// Prints a warning if a state does not restore exactly.
    pub fn tell(&self) {
        let check = self.checkpoint.check.as_ref();
        if let Some(warning) = check.and_then(Check::warning) {
            tell!("warning: {}: {warning}", self.folder.display());
        }
    }

    /// Returns the summary's entry for a run that continues from this checkpoint.
    pub fn resumed(&self, branch: Branch) -> Resumed {
        let checkpoint = &self.checkpoint;
        Resumed {
            checkpoint: self.folder.display().to_string(),
            session: checkpoint.session.clone(),
            step: checkpoint.step,
            time_s: checkpoint.time_s,
            digest: checkpoint.recording.digest.clone(),
            check: checkpoint.check.clone(),
            changed_faults: branch.changed_faults,
        }
    }

    /// Returns the faults injected and accepted before the step, in order.
    pub fn live_faults(&self) -> impl Iterator<Item = FaultEvent> {
        self.log.accepted.iter().map(|live| live.event.clone())
    }

    /// Returns the checkpoint settings for a side's job: `others`, and the saved state to restore.
    #[must_use]
    pub fn resume(&self, side: Side, others: &Checkpoints) -> Checkpoints {
        let saved = match side {
            Side::Plant => &self.checkpoint.plant,
            Side::Controller => &self.checkpoint.controller,
        };
        Checkpoints {
            resume: Some(Resume {
                step: self.first(),
                state: self.folder.join(&saved.file),
                memory: None,
            }),
            ..others.clone()
        }
    }

    /// Returns the records before the checkpoint, which have this layout.
    #[must_use]
    pub fn records(&self, layout: RecordLayout) -> PastRecords {
        PastRecords {
            recording: self.recording.clone(),
            count: self.checkpoint.recording.records,
            digest: self.checkpoint.recording.digest.clone(),
            layout,
        }
    }
}

/// Returns the programs of the run that made a checkpoint.
///
/// # Errors
/// If there is no such checkpoint or recording.
pub fn recorded(folder: &Path) -> Result<Recorded, Failure> {
    let checkpoint = read(folder)?;
    let recording = folder.join(&checkpoint.recording.file);
    let reader = RunReader::open(&recording).map_err(|error| {
        let path_text = folder.display();
        Failure::usage(format!("cannot continue from {path_text}: {error}"))
    })?;
    Ok(Recorded::of(&reader, folder))
}

/// Reads the description of a checkpoint.
pub(super) fn read(folder: &Path) -> Result<Checkpoint, Failure> {
    let path_text = folder.display();
    let path = folder.join(FILE);
    let text = fs::read_to_string(&path).map_err(|error| {
        let near = checkpoints_in(folder);
        let hint = if near.is_empty() {
            "hil run --checkpoint-at TIME makes one".to_owned()
        } else {
            format!("those of this run: {}", near.join(", "))
        };
        Failure::usage(format!(
            "{path_text} is not a checkpoint: {FILE}: {error}; {hint}"
        ))
    })?;
    let damaged =
        |what: &dyn std::fmt::Display| Failure::usage(format!("{}: {what}", path.display()));
    let checkpoint: Checkpoint = serde_json::from_str(&text).map_err(|error| damaged(&error))?;
    let Checkpoint {
        schema, protocol, ..
    } = checkpoint;
    if (schema, protocol) != (SCHEMA, PROTOCOL) {
        return Err(damaged(&format!(
            "the checkpoint has schema {schema} and protocol {protocol}, but this hil writes schema {SCHEMA} and protocol {PROTOCOL}"
        )));
    }
    Ok(checkpoint)
}

/// Lists the checkpoints in the folder of a run.
fn checkpoints_in(run: &Path) -> Vec<String> {
    let entries = fs::read_dir(run).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries
        .map(|entry| entry.path())
        .filter(|path| path.join(FILE).exists())
        .map(|path| path.display().to_string())
        .collect();
    names.sort();
    names
}

fn same_binary(saved: &SavedSide, binary: &Binary) -> Result<(), Failure> {
    if saved.binary_blake3 == binary.blake3 {
        return Ok(());
    }
    let (path, of) = (binary.path.display(), &saved.of);
    let (theirs, ours) = (&saved.binary_blake3, &binary.blake3);
    Err(Failure::usage(format!(
        "{path} is not the binary that saved the state of `{of}` and may misread it: its hash is {ours}, but the other has {theirs}"
    )))
}

fn whole(folder: &Path, saved: &SavedSide) -> Result<(), Failure> {
    let path = folder.join(&saved.file);
    let path_text = path.display();
    let content = fs::read(&path)
        .map_err(|error| Failure::usage(format!("cannot read {path_text}: {error}")))?;
    let actual = blake3::hash(&content).to_hex().to_string();
    if actual == saved.blake3 {
        return Ok(());
    }
    let expected = &saved.blake3;
    Err(Failure::usage(format!(
        "{path_text} is damaged: its hash is {actual}, but the saved state has {expected}"
    )))
}

/// Reads the past of a checkpoint: the scenario, the fault events and the recorded inputs of instruments.
fn past(
    recording: &Path,
    checkpoint: &Checkpoint,
) -> Result<(String, FaultLog, Vec<String>), String> {
    let in_words = |error: ReadError| error.to_string();
    let mut reader = RunReader::open(recording).map_err(in_words)?;
    reader.refuse_excerpt().map_err(in_words)?;
    let scenario = reader
        .attachment("scenario.toml")
        .map_err(in_words)?
        .to_owned();
    let path_text = recording.display();
    if hash(&scenario) != checkpoint.recording.scenario_blake3 {
        return Err(format!(
            "the scenario in {path_text} is not that of the checkpoint"
        ));
    }
    let mut log = FaultLog::default();
    let (expected, digest) = (checkpoint.recording.records, &checkpoint.recording.digest);
    while reader.records() < expected {
        if !reader.advance().map_err(in_words)? {
            let actual = reader.records();
            let torn = (reader.caveat()).map_or_else(String::new, |torn| format!("; {torn}"));
            return Err(format!(
                "{path_text} has {actual} records, but {expected} precede the checkpoint{torn}"
            ));
        }
        for event in reader.events() {
            log.take(event)
                .map_err(|error| format!("{path_text}: {error}"))?;
        }
    }
    let actual = reader.digest();
    if actual == *digest {
        let names = reader.columns().iter().map(|column| column.name.clone());
        let taps = names.filter(|name| is_on_request(name));
        Ok((scenario, log, taps.collect()))
    } else {
        Err(format!(
            "{path_text} was changed: the digest of the first {expected} records is {actual}, but {digest} was recorded"
        ))
    }
}
