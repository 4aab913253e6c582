//! Summary of a run whose `hil` was killed: the facts known at its start, and the reason why it ended.
//!
//! Written by the guard, which has neither plan nor records. `hil recover` replaces it by the contents of the
//! recording.

use std::fs::read_dir;
use std::path::Path;

use hil_console::files::begun::BegunRun;
use hil_console::files::part_file;
use hil_console::files::runs::{SCENARIO, SUMMARY, summary};
use hil_console::terminal::exit::Failure;
use serde_json::{Value, json};

use hil_recording::reader::RECORDING;

/// Key of a summary that the guard wrote.
const LOST: &str = "lost";

/// End of the `hil` process of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Exit: `hil` removed the folders of runs that had not started.
    Exit,
    /// Signal, between any two instructions.
    Signal,
}

/// Returns the summary of a run that was begun; writes the summary first if the run ended with `hil`. `None` for a run
/// that left no folder of its own.
///
/// # Errors
/// If the output cannot be written.
pub fn summarise(run: &BegunRun, reason: &str, end: End) -> Result<Option<Value>, Failure> {
    if !is_left(run, end) {
        return Ok(None);
    }
    let path = run.folder.join(SUMMARY);
    if let Some(summary) = summary(&path) {
        return Ok(Some(summary));
    }
    let is_recorded = run.folder.join(RECORDING).exists();
    let hint = format!(
        "; run `hil recover {}` to determine how far it got",
        run.folder.display()
    );
    let hint = if is_recorded { hint } else { String::new() };
    let summary = json!({
        "schema": 1,
        "scenario": run.scenario,
        "set": run.set,
        "started_utc": run.started_utc,
        "session": run.session,
        "evidence": run.evidence,
        "verdict": "aborted",
        "reason": format!("{reason}{hint}"),
        LOST: reason,
        "clock": run.clock,
        "rate_hz": run.rate_hz,
        "steps": null,
        "sim_time_s": null,
        "wall_time_s": null,
        "realtime_factor": null,
        "digest": null,
        "metrics": [],
        "requirements": [],
        "faults": [],
        "recording": { "file": is_recorded.then_some(RECORDING), "records": null, "lost": null },
        "seed": run.seed,
    });
    part_file::write_text(&path, &format!("{summary:#}"))?;
    Ok(Some(summary))
}

/// Returns `true` if a run left a folder of its own.
fn is_left(run: &BegunRun, end: End) -> bool {
    match (run.has_folder, end) {
        (true, End::Exit) => run.folder.join(SCENARIO).exists(),
        (true, End::Signal) => run.folder.is_dir(),
        // The folder was refused and belongs to another run.
        (false, End::Exit) => false,
        // Killed before it could note the creation of the folder, which is empty.
        (false, End::Signal) => {
            read_dir(&run.folder).is_ok_and(|mut inside| inside.next().is_none())
        }
    }
}

/// Returns the reason in a summary file that the guard wrote; the recording of such a run contains more.
pub fn reason_in(path: &Path) -> Option<String> {
    reason_of(&summary(path)?).map(str::to_owned)
}

/// Returns the reason in a summary that the guard wrote.
pub fn reason_of(summary: &Value) -> Option<&str> {
    summary.get(LOST)?.as_str()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use tempfile::TempDir;

    use super::*;

    fn begun(folder: &Path, has_folder: bool) -> BegunRun {
        BegunRun {
            folder: folder.to_owned(),
            scenario: "small".into(),
            law: "hold".into(),
            session: "s".into(),
            started_utc: "2026-01-01T00:00:00.000Z".into(),
            set: Vec::new(),
            evidence: "sil".into(),
            clock: "lockstep".into(),
            rate_hz: 1000.0,
            seed: 1,
            has_folder,
        }
    }

    fn is_summarised(folder: &Path, has_folder: bool, end: End) -> bool {
        let summary = summarise(&begun(folder, has_folder), "killed", end).expect("written");
        assert_eq!(summary.is_some(), folder.join(SUMMARY).exists());
        summary.is_some()
    }

    #[test]
    fn a_run_killed_at_any_moment_leaves_no_folder_without_a_summary() {
        let place = TempDir::new().expect("a folder");
        let folder = |name: &str| {
            let folder = place.path().join(name);
            fs::create_dir(&folder).expect("a folder");
            folder
        };
        assert!(!is_summarised(
            &place.path().join("none"),
            false,
            End::Signal
        ));
        assert!(is_summarised(&folder("unknown"), false, End::Signal));
        assert!(is_summarised(&folder("known"), true, End::Signal));
        let begun = folder("begun");
        fs::write(begun.join(SCENARIO), "").expect("written");
        assert!(is_summarised(&begun, true, End::Exit));
        // `hil` itself removes the folder of a run that was not begun, unless it existed before.
        assert!(!is_summarised(&folder("kept"), true, End::Exit));
    }

    #[test]
    fn the_folder_of_another_run_is_left_alone() {
        let place = TempDir::new().expect("a folder");
        fs::write(place.path().join(SCENARIO), "").expect("written");
        for end in [End::Exit, End::Signal] {
            assert!(!is_summarised(place.path(), false, end), "{end:?}");
        }
    }
}
