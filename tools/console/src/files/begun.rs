//! List of the runs that this process has started, which its guard reads after the process's death. The list is an
//! anonymous file in memory that both hold open, so it needs no name and leaves nothing behind.

use std::fs::File;
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

/// List of this process, if it has a guard.
static LIST: OnceLock<File> = OnceLock::new();

/// Started run, with the data that its folder may lack.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct BegunRun {
    /// Folder of the run.
    pub folder: PathBuf,
    /// Name of the scenario.
    pub scenario: String,
    /// Name of the control law.
    pub law: String,
    /// Name of the session.
    pub session: String,
    /// Start time.
    pub started_utc: String,
    /// Values of the scenario changed on the command line, as `KEY=VALUE`.
    pub set: Vec<String>,
    /// Level of evidence.
    pub evidence: String,
    /// Clock that releases the steps.
    pub clock: String,
    /// Steps per second of simulated time.
    pub rate_hz: f64,
    /// Seed of every random stream.
    pub seed: u64,
    /// Set if the folder belongs to the run and did not exist before it.
    #[serde(skip)]
    pub has_folder: bool,
}

/// Line of the list.
#[derive(Serialize, Deserialize)]
enum Line {
    /// A run starts; its folder is created next.
    Run(BegunRun),
    /// The run with this folder has created it.
    Folder(PathBuf),
}

/// Sets the list for the runs that start from now on; the file must be opened for appending.
pub fn write_to(list: File) {
    let _ = LIST.set(list); // already set only if called twice
}

/// Records the start of a run before its folder is created, so that no folder can be left without an entry.
pub fn note(run: impl FnOnce() -> BegunRun) {
    write(|| Line::Run(run()));
}

/// Records that the folder of a run was created.
pub fn note_folder(folder: &Path) {
    write(|| Line::Folder(folder.to_owned()));
}

fn write(line: impl FnOnce() -> Line) {
    let Some(mut list) = LIST.get() else { return };
    // Without the entry, a run lacks a summary if this process is killed, which does not justify ending it now.
    if let Ok(mut line) = serde_json::to_vec(&line()) {
        line.push(b'\n');
        let _ = list.write_all(&line);
    }
}

/// Reads the runs of a list, in the order of their start.
pub fn read(mut list: &File) -> Vec<BegunRun> {
    let mut text = String::new();
    let _ = list.rewind().and_then(|()| list.read_to_string(&mut text)); // as far as it can be read
    let mut runs: Vec<BegunRun> = Vec::new();
    for line in text.lines() {
        match serde_json::from_str(line) {
            Ok(Line::Run(run)) => runs.push(run),
            Ok(Line::Folder(folder)) => {
                if let Some(run) = runs.iter_mut().rfind(|run| run.folder == folder) {
                    run.has_folder = true;
                }
            }
            Err(_) => {} // the last one, broken off
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_with_a_truncated_last_line_still_tells_which_runs_created_their_folders() {
        let run = |folder: &str| {
            let run = serde_json::json!({
                "folder": folder, "scenario": "a", "law": "b", "session": "c", "started_utc": "d", "set": [],
                "evidence": "e", "clock": "f", "rate_hz": 1.0, "seed": 1
            });
            Line::Run(serde_json::from_value(run).expect("a run"))
        };
        let lines = [run("/a"), Line::Folder("/a".into()), run("/b")];
        let mut list = tempfile::tempfile().expect("a file");
        for line in &lines {
            let line = serde_json::to_string(line).expect("JSON");
            writeln!(list, "{line}").expect("written");
        }
        write!(list, "{{\"Folder\":\"/b").expect("written");
        let runs = read(&list);
        let runs: Vec<_> = (runs.iter().map(|run| (run.folder.to_str(), run.has_folder))).collect();
        assert_eq!(runs, [(Some("/a"), true), (Some("/b"), false)]);
    }
}
