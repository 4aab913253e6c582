//! List of the runs that this process has begun, for its guard to read after its death: a file in memory that both
//! hold open, so that nobody has to look for it and nothing of it is left.

use std::fs::File;
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

/// List that this process writes, if it has a guard.
static LIST: OnceLock<File> = OnceLock::new();

/// A run that was begun: what its folder does not say by itself.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct BegunRun {
    pub folder: PathBuf,
    pub scenario: String,
    pub law: String,
    pub session: String,
    pub started_utc: String,
    pub set: Vec<String>,
    pub evidence: String,
    pub clock: String,
    pub rate_hz: f64,
    pub seed: u64,
    /// The folder is known to be that of the run, and not one that was there before.
    #[serde(skip)]
    pub has_folder: bool,
}

/// Line of the list.
#[derive(Serialize, Deserialize)]
enum Line {
    /// A run begins: its folder is made next.
    Run(BegunRun),
    /// The run with this folder has made it.
    Folder(PathBuf),
}

/// Writes runs that are begun from now on into a list, which is opened to append.
pub fn write_to(list: File) {
    let _ = LIST.set(list); // a process has one guard
}

/// Notes a run that begins, before its folder is made: so there is no moment at which a folder is left that nobody knows.
pub fn note(run: impl FnOnce() -> BegunRun) {
    write(|| Line::Run(run()));
}

/// Notes that the folder of a run was made.
pub fn note_folder(folder: &Path) {
    write(|| Line::Folder(folder.to_owned()));
}

fn write(line: impl FnOnce() -> Line) {
    let Some(mut list) = LIST.get() else { return };
    // Without its line the run has no summary if this process is killed, which is no reason to end it now.
    if let Ok(mut line) = serde_json::to_vec(&line()) {
        line.push(b'\n');
        let _ = list.write_all(&line);
    }
}

/// Reads the runs of a list, in the order in which they were begun.
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
    fn a_list_tells_which_runs_made_their_folders_also_if_its_last_line_broke_off() {
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
