//! The summary of a run whose `hil` was killed: what was known when it began, and why it ended.
//!
//! Written by the guard, which has neither plan nor records. `hil recover` replaces it by what the recording says.

use std::path::Path;

use serde_json::{Value, json};

use crate::files::begun::BegunRun;
use crate::files::part_file;
use crate::files::runs::{SCENARIO, SUMMARY, summary};
use crate::terminal::exit::Failure;
use hil_recording::reader::RECORDING;

/// Key of a summary that the guard wrote.
const LOST: &str = "lost";

/// Gives the summary of a run that was begun; writes it first if the run ended with `hil`. `None` of a run that
/// left no folder.
///
/// # Errors
/// If it cannot be written.
pub(crate) fn summarise(run: &BegunRun, reason: &str) -> Result<Option<Value>, Failure> {
    if !run.folder.join(SCENARIO).exists() {
        return Ok(None);
    }
    let path = run.folder.join(SUMMARY);
    if let Some(summary) = summary(&path) {
        return Ok(Some(summary));
    }
    let is_recorded = run.folder.join(RECORDING).exists();
    let hint = format!(
        "; hil recover {} tells how far it came",
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

/// Returns the reason in a summary that the guard wrote: that of a run whose recording says more.
pub(crate) fn reason_in(path: &Path) -> Option<String> {
    reason_of(&summary(path)?).map(str::to_owned)
}

/// Returns the reason of a summary that the guard wrote.
pub(crate) fn reason_of(summary: &Value) -> Option<&str> {
    summary.get(LOST)?.as_str()
}
