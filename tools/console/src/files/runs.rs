//! Folders of runs below a folder, and the newest of them, for which `latest` stands.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use clap::builder::{OsStringValueParser, TypedValueParser};
use hil_recording::reader::RECORDING;
use serde_json::Value;

/// Default folder that contains runs.
pub const RUNS: &str = "runs";
/// Name that stands for the newest run.
pub const LATEST: &str = "latest";
/// File that exists in the folder of a run from its start.
pub const SCENARIO: &str = "scenario.toml";
/// File that exists in the folder of an ended run.
pub const SUMMARY: &str = "summary.json";
/// Files by which the folder of a run is recognised: the scenario, and at least one of the others.
pub const FILES: [&str; 4] = [SCENARIO, SUMMARY, RECORDING, "plant.log"];
/// Maximum depth of run folders below the searched one.
const DEEPEST: usize = 8;
/// Maximum size of a summary, in bytes.
const LARGEST: u64 = 16 << 20;

/// Folder of a run.
#[derive(Clone, Debug)]
pub struct RunFolder {
    /// Path of the folder.
    pub path: PathBuf,
    /// Time of the run's start.
    pub started: SystemTime,
    /// Content of `summary.json`, if readable.
    pub summary: Option<Value>,
}

/// Returns the runs below a folder, newest first. Links are not followed.
///
/// # Errors
/// If the folder cannot be read. Unreadable folders below it are skipped.
pub fn below(folder: &Path) -> io::Result<Vec<RunFolder>> {
    let mut runs = Vec::new();
    search(folder, DEEPEST, &mut runs)?;
    runs.sort_by(|a, b| (b.started, &b.path).cmp(&(a.started, &a.path)));
    Ok(runs)
}

/// Returns at most `most` of the newest runs below a folder, judging only by file times.
pub fn newest(folder: &Path, most: usize) -> Vec<PathBuf> {
    let mut runs = Vec::new();
    look(folder, DEEPEST, &mut runs);
    runs.sort_by(|a, b| b.cmp(a));
    runs.truncate(most);
    runs.into_iter().map(|(_, path)| path).collect()
}

/// Lists run folders with the modification times of their scenarios, which are written when a run starts.
fn look(folder: &Path, depth: usize, runs: &mut Vec<(SystemTime, PathBuf)>) {
    if let Ok(scenario) = fs::metadata(folder.join(SCENARIO)) {
        let started = scenario.modified().unwrap_or(SystemTime::UNIX_EPOCH);
        if FILES[1..].iter().any(|name| folder.join(name).is_file()) {
            runs.push((started, folder.to_owned()));
        }
        return;
    }
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        if depth > 0 && entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            look(&entry.path(), depth - 1, runs);
        }
    }
}

fn search(folder: &Path, depth: usize, runs: &mut Vec<RunFolder>) -> io::Result<()> {
    if let Some(run) = RunFolder::read(folder) {
        runs.push(run);
        return Ok(());
    }
    for entry in fs::read_dir(folder)? {
        let Ok(entry) = entry else { continue };
        if depth > 0 && entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            let _ = search(&entry.path(), depth - 1, runs);
        }
    }
    Ok(())
}

impl RunFolder {
    /// Reads a folder, if it is the folder of a run.
    fn read(path: &Path) -> Option<Self> {
        let scenario = fs::metadata(path.join(SCENARIO)).ok()?;
        (FILES[1..].iter().any(|name| path.join(name).is_file())).then_some(())?;
        let summary = summary(&path.join(SUMMARY));
        let started = summary.as_ref().and_then(|summary| {
            let text = summary.get("started_utc")?.as_str()?;
            humantime::parse_rfc3339(text).ok()
        });
        // The scenario is written when a run starts and never changed.
        let started = started.or_else(|| scenario.modified().ok())?;
        Some(Self {
            path: path.to_owned(),
            started,
            summary,
        })
    }
}

/// Reads a summary, if it exists and is valid.
pub fn summary(path: &Path) -> Option<Value> {
    let file = File::open(path).ok().filter(|file| {
        file.metadata()
            .is_ok_and(|file| file.is_file() && file.len() <= LARGEST)
    })?;
    let mut text = Vec::new();
    file.take(LARGEST).read_to_end(&mut text).ok()?;
    serde_json::from_slice(&text).ok().filter(Value::is_object)
}

/// Parses the path of a run or of a file in its folder; a leading `latest` stands for the newest run below `runs`.
///
/// # Errors
/// If `latest` is given and there is no run.
pub fn path(typed: OsString) -> Result<PathBuf, String> {
    named(typed.into(), Path::new(RUNS))
}

fn named(typed: PathBuf, folder: &Path) -> Result<PathBuf, String> {
    let Ok(rest) = typed.strip_prefix(LATEST) else {
        return Ok(typed);
    };
    let folder_text = folder.display();
    let runs = match below(folder) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            return Err(format!("cannot look for runs in {folder_text}: {error}"));
        }
        runs => runs.unwrap_or_default(),
    };
    match runs.into_iter().next() {
        Some(run) if rest == Path::new("") => Ok(run.path),
        Some(run) => Ok(run.path.join(rest)),
        None => Err(format!(
            "`{LATEST}` stands for the newest run below {folder_text}, but there is none; use ./{LATEST} for a file or folder of that name"
        )),
    }
}

/// Returns the value parser of an argument that names a run.
pub fn run_path() -> impl TypedValueParser<Value = PathBuf> {
    OsStringValueParser::new().try_map(path)
}
