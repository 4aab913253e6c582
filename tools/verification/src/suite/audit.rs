//! `hil run --audit`: checks that a scenario has one digest with these binaries, regardless of external conditions.
//!
//! The scenario is run as requested, then again under [conditions] that must not matter: other speeds, other cores,
//! busy cores, slow sides. Each of these is a case of the suite: a whole run of the same binaries in its own session,
//! folder and processes, so that addresses, process IDs and names differ as well. The first difference of each case is
//! reported.

mod conditions;

use std::slice;

use hil_config::plan::Clock;
use hil_console::files::part_file;
use hil_console::files::runs::SUMMARY;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_facts::arguments::run::LinkKind;
use hil_facts::results::restoration::{Check, Verdict};
use hil_run::{Origin, RunResult};
use serde::Serialize;

use super::case::{Case, Row};
use super::running::{self, EarlyResult};
use crate::arguments::run::RunArguments;
use crate::compare::Difference;

/// Usual causes of a difference.
const HINT: &str = "possible causes: a law or plant that reads a clock, its process ID, its environment or its cores; \
uninitialised memory; random numbers without the run's seed; threads; the order of a hash map";

/// Repetition as it appears in the summary.
#[derive(Serialize)]
struct Repetition<'a> {
    condition: &'a str,
    /// Reason why this machine cannot provide the condition; the other fields are null then.
    skipped: Option<&'a str>,
    agrees: Option<bool>,
    digest: Option<&'a str>,
    wall_time_s: Option<f64>,
    first_difference: Option<&'a Difference>,
    /// Check of the saved state; null unless the repetition saved one.
    check: Option<&'a Check>,
    /// Folder of the repetition, kept if it differs.
    run: Option<String>,
}

impl<'a> Repetition<'a> {
    fn of(row: &'a Row) -> Self {
        let disagreement = row.disagreement.as_ref();
        let folder = row.ran.as_ref().map(|ran| ran.folder.display().to_string());
        Self {
            condition: &row.label,
            skipped: row.skipped.as_deref(),
            agrees: row.ran.as_ref().map(|_| disagreement.is_none()),
            digest: row.digest(),
            wall_time_s: row.ran.as_ref().map(|ran| ran.summary.wall_time_s),
            first_difference: disagreement
                .and_then(|disagreement| disagreement.difference.as_ref()),
            check: row.ran.as_ref().and_then(RunResult::first_check),
            run: folder.filter(|_| disagreement.is_some()),
        }
    }
}

/// Refuses arguments that make sense only for other suites.
pub(super) fn refuse_arguments(arguments: &RunArguments) -> Result<(), Failure> {
    if arguments.scenarios.len() != 1 {
        return Err(Failure::usage("--audit requires a single scenario"));
    }
    if arguments.repeat > 1 || arguments.junit.is_some() || arguments.markdown.is_some() {
        return Err(Failure::usage(
            "--audit repeats the scenario itself and reports in summary.json; omit --repeat, --junit and --markdown",
        ));
    }
    Ok(())
}

/// Runs a case once, and again under every condition.
///
/// # Errors
/// If a run could not be started, or results cannot be written.
pub(super) fn audit(case: &Case, json: bool) -> Result<Exit, Failure> {
    refuse(case)?;
    let reference = case.row(Some(Ok(case.run(Origin::Scenario)?)));
    let cases = conditions::cases(case, &reference);
    let mut rows = vec![reference];
    if !cases.is_empty() {
        let count = cases.len();
        let begins = |number: usize, case: &Case| {
            tell!("audit {number} of {count}: {}", case.label);
            if let Some(why) = &case.skipped {
                tell!("  skipped: {why}");
            }
        };
        let cases = [slice::from_ref(case), &cases].concat();
        rows = match running::all(&cases, rows, 1, &begins, &|_, row| ended(row)) {
            Ok(rows) => rows,
            Err(early) => return early,
        };
    }
    let repetitions: Vec<Repetition> = rows[1..].iter().map(Repetition::of).collect();
    let differs = rows[1..].iter().any(|row| row.disagreement.is_some());
    let verdict = match differs {
        _ if repetitions.is_empty() => "aborted",
        true => "fail",
        false => "pass",
    };
    if let Some(ran) = &rows[0].ran {
        tell(ran, verdict, &repetitions, json)?;
    }
    let reference = rows.swap_remove(0);
    match reference.failure {
        Some(failure) => Err(failure),
        None if differs => Ok(Exit::Failed),
        None => Ok(reference.exit),
    }
}

/// Refuses settings that leave nothing to audit.
fn refuse(case: &Case) -> Result<(), Failure> {
    let settings = &case.environment.settings;
    let why = if settings.recording.is_none() {
        "--audit needs the recordings to find the differences; omit --no-record"
    } else if settings.link == LinkKind::InProcess {
        "--audit varies the scheduling of two processes, but --link in-process has one; omit it"
    } else if settings.by_hand.flag().is_some() {
        "--audit starts both sides repeatedly; omit --controller external and --plant external"
    } else if settings.pause_at_s.is_some() {
        "--audit runs unattended; omit --pause-at"
    } else if !settings.checkpoints_at_s.is_empty() {
        "--audit keeps no checkpoints; omit --checkpoint-at"
    } else if case.is_behind_port() {
        "--audit repeats a run, and a plant behind a port does not repeat; compare runs with `hil compare --tolerance`"
    } else if case.plan.run.clock == Clock::Realtime {
        "a real-time run depends on late commands; audit it with --clock lockstep"
    } else if !case.environment.binaries.controller.is_repeatable() {
        "the far end of the port keeps a clock of its own (`repeatable = false`), so equal runs differ and there is nothing to audit"
    } else {
        return Ok(());
    };
    Err(Failure::usage(why))
}

/// Reports the outcome of a repetition, and keeps its folder if the digest differs.
fn ended(row: &mut Row) -> Result<(), EarlyResult> {
    let Some(ran) = &row.ran else {
        let failure = row.failure.take();
        return failure.map_or(Ok(()), |failure| Err(Err(failure)));
    };
    let folder = ran.folder.display();
    if !row.is_over() || row.digest().is_none() {
        output::tell(&ran.table);
        let message = format!("the audit ended during {}", row.label);
        tell!("{message}; its files are in {folder}");
        return Err(Ok(row.exit));
    }
    if row.disagreement.is_some() {
        tell!("  different digest");
        return Ok(());
    }
    std::fs::remove_dir_all(&ran.folder).map_err(|error| {
        let message = format!("cannot remove {folder}: {error}");
        Err(Failure::infrastructure(message))
    })
}

/// Prints the summary of the run with the result of the audit, and adds the result to `summary.json`.
fn tell(
    reference: &RunResult,
    verdict: &str,
    repetitions: &[Repetition<'_>],
    json: bool,
) -> Result<(), Failure> {
    let mut summary: serde_json::Value =
        serde_json::from_str(&reference.json).map_err(Failure::infrastructure)?;
    summary["audit"] = serde_json::json!({ "verdict": verdict, "repetitions": repetitions });
    let text = format!("{summary:#}\n");
    if reference.recording.is_some() {
        part_file::write_text(&reference.folder.join(SUMMARY), &text)?;
    }
    output::write(&if json {
        text
    } else {
        format!("{}{}", reference.table, describe(repetitions))
    })
}

fn describe(repetitions: &[Repetition<'_>]) -> String {
    let mut text = String::from("\n");
    for one in repetitions {
        let condition = one.condition;
        text += &match (&one.skipped, &one.first_difference, &one.run) {
            (Some(why), ..) => format!("  -     {condition}: {why}\n"),
            (_, Some(difference), Some(run)) => {
                format!("  DIFF  {condition}: {difference}\n        kept in {run}\n")
            }
            (_, _, Some(run)) => format!("  DIFF  {condition}: see {run}\n"),
            _ => format!("  same  {condition}\n"),
        };
        if let Some(check) = one.check {
            let mark = match check.verdict {
                Verdict::Exact => "same",
                Verdict::Unchecked => "-   ",
                _ => "NOT ",
            };
            text += &format!("  {mark}  its restored state: {}\n", check.text);
        }
    }
    let ran = repetitions
        .iter()
        .filter(|one| one.agrees.is_some())
        .count();
    let differ = (repetitions.iter().filter(|one| one.agrees == Some(false))).count();
    match (ran, differ) {
        (0, _) => {}
        (_, 0) => text += &format!("  one digest in {} runs\n", ran + 1),
        _ => {
            text += &format!("  NOT deterministic: {differ} of {ran} repetitions differ; {HINT}\n")
        }
    }
    text
}
