//! Reports of a suite whose `hil` was killed: each run that had begun has the verdict from its folder, and all other
//! runs are listed as not run.

use std::path::PathBuf;

use hil_console::files::begun::BegunRun;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use serde_json::{Value, json};

use super::case::{Begun, Row};
use super::{table, write_reports};
use crate::arguments::run::RunArguments;

/// Run that had begun, and the summary from its folder.
pub type LostRun = (BegunRun, Value);

/// Writes the requested report files and the result of the command.
///
/// # Errors
/// If a file cannot be written.
pub fn report(arguments: &RunArguments, runs: &[LostRun], reason: &str) -> Result<(), Failure> {
    let planned = arguments.scenarios.len() * arguments.repeat as usize;
    // The first run of an audit is its reference and says nothing about the others.
    let is_single = planned <= 1 && !arguments.audit;
    let mut rows: Vec<Row> = runs.iter().map(row).collect();
    let missing = planned.saturating_sub(rows.len());
    rows.extend((0..missing).map(|_| unbegun(reason)));
    let result = match (is_single, arguments.options.json) {
        (true, true) => runs.first().map(|(_, summary)| format!("{summary:#}\n")),
        (true, false) => None,
        (false, true) => {
            let runs: Vec<Value> = runs.iter().map(json_of).collect();
            let all = json!({ "schema": 1, "verdict": "aborted", "reason": reason, "runs": runs });
            Some(format!("{all:#}\n"))
        }
        (false, false) => Some(table::of(&rows)),
    };
    let output_result = result.map_or(Ok(()), |text| output::write(&text));
    write_reports(arguments, &rows)?;
    output_result
}

/// Creates the row of a run from its summary.
fn row((run, summary): &LostRun) -> Row {
    let exit = match summary["verdict"].as_str() {
        Some("pass") => Exit::Pass,
        Some("fail") => Exit::Failed,
        _ => Exit::Infrastructure,
    };
    let reason = summary["reason"].as_str().map(Failure::infrastructure);
    Row {
        label: label(run),
        law: run.law.clone(),
        origin: run.scenario.clone(),
        exit,
        skipped: None,
        failure: reason.filter(|_| exit == Exit::Infrastructure),
        disagreement: None,
        ran: None,
        begun: Some(begun(run, summary)),
    }
}

fn begun(run: &BegunRun, summary: &Value) -> Begun {
    let requirements = summary["requirements"]
        .as_array()
        .map_or(&[][..], Vec::as_slice);
    let has_passed = |one: &&Value| one["verdict"] == "pass" && one["vacuous"].is_null();
    Begun {
        passed: requirements.iter().filter(has_passed).count(),
        requirements: requirements.len(),
        realtime_factor: summary["realtime_factor"].as_f64(),
        digest: summary["digest"].as_str().map(Into::into),
        folder: run.folder.clone(),
    }
}

/// Creates the row of a requested run that never began.
fn unbegun(reason: &str) -> Row {
    Row {
        label: "a run that did not start".into(),
        law: String::new(),
        origin: String::new(),
        exit: Exit::Infrastructure,
        skipped: None,
        failure: Some(Failure::infrastructure(reason)),
        disagreement: None,
        ran: None,
        begun: None,
    }
}

/// Labels a run by its folder, which is unique among runs of one scenario.
fn label(run: &BegunRun) -> String {
    let name = run.folder.file_name().map(PathBuf::from);
    name.map_or_else(|| run.scenario.clone(), |name| name.display().to_string())
}

fn json_of((run, summary): &LostRun) -> Value {
    let mut value = summary.clone();
    value["label"] = json!(label(run));
    value["folder"] = json!(run.folder);
    value
}
