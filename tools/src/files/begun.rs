//! List of the runs that this process has begun, for its guard to read after its death: a file in memory that both
//! hold open, so that nobody has to look for it and nothing of it is left.

use std::fs::File;
use std::io::{Read, Seek, Write};
use std::path::PathBuf;
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

/// List that this process writes, if it has a guard.
static LIST: OnceLock<File> = OnceLock::new();

/// A run that was begun: what its folder does not say by itself.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct BegunRun {
    pub(crate) folder: PathBuf,
    pub(crate) scenario: String,
    pub(crate) law: String,
    pub(crate) session: String,
    pub(crate) started_utc: String,
    pub(crate) set: Vec<String>,
    pub(crate) evidence: String,
    pub(crate) clock: String,
    pub(crate) rate_hz: f64,
    pub(crate) seed: u64,
}

/// Writes runs that are begun from now on into a list, which is opened to append.
pub(crate) fn write_to(list: File) {
    let _ = LIST.set(list); // a process has one guard
}

/// Notes a run that begins.
pub(crate) fn note(run: impl FnOnce() -> BegunRun) {
    let Some(mut list) = LIST.get() else { return };
    // Without its line the run has no summary if this process is killed, which is no reason to end it now.
    if let Ok(mut line) = serde_json::to_vec(&run()) {
        line.push(b'\n');
        let _ = list.write_all(&line);
    }
}

/// Reads the runs of a list, in the order in which they were begun.
pub(crate) fn read(mut list: &File) -> Vec<BegunRun> {
    let mut text = String::new();
    let _ = list.rewind().and_then(|()| list.read_to_string(&mut text)); // as far as it can be read
    let lines = text.lines();
    lines
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect()
}
