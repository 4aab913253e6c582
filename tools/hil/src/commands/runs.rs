//! `hil runs`: lists recorded runs from the contents of their folders.

mod removal;

use std::ffi::OsStr;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use glob::Pattern;
use hil_console::files::runs::{self, RUNS, RunFolder, SCENARIO};
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_console::terminal::table::{Table, left, right};
use hil_facts::results::requirements;
use hil_session::session;
use serde::{Deserialize, Serialize};
use shared_types::number::short_in;
use shared_types::text::line;
use toml_edit::DocumentMut;

use crate::arguments::runs::{Ending, Order, RunChoice, RunsAction, RunsArguments};
use hil_recording::size;

/// Runs the command.
///
/// # Errors
/// If the folder cannot be read, or a run cannot be removed.
pub(crate) fn runs(arguments: &RunsArguments) -> Result<Exit, Failure> {
    if let Some(RunsAction::Rm(arguments)) = &arguments.action {
        return removal::remove(arguments);
    }
    let mut runs = chosen(&arguments.choice)?;
    match arguments.sort {
        Order::Time => {}
        Order::Scenario => runs.sort_by(|a, b| a.scenario.cmp(&b.scenario)),
        Order::Verdict => runs.sort_by_key(|run| run.verdict),
        Order::Margin => runs.sort_by(|a, b| {
            let margin = |run: &Run| {
                run.margin
                    .as_ref()
                    .map_or(f64::INFINITY, |one| one.robustness)
            };
            margin(a).total_cmp(&margin(b))
        }),
        Order::Size => runs.sort_by_key(|run| std::cmp::Reverse(run.bytes)),
    }
    if arguments.reverse {
        runs.reverse();
    }
    runs.truncate(arguments.last.unwrap_or(usize::MAX));
    if arguments.json {
        let all = serde_json::json!({ "runs": runs });
        output::write(&format!("{all}\n"))?;
    } else if runs.is_empty() {
        let folder = arguments.choice.folder.display();
        let such = if arguments.choice.is_a_rule() {
            "no such run"
        } else {
            "no run"
        };
        output::write(&format!("{such} below {folder}\n"))?;
    } else {
        output::write(&table(&runs).to_string())?;
    }
    Ok(Exit::Pass)
}

/// Listed run.
#[derive(Debug, Serialize)]
struct Run {
    #[serde(rename = "run")]
    path: PathBuf,
    #[serde(serialize_with = "rfc3339")]
    started_utc: SystemTime,
    scenario: String,
    set: Vec<String>,
    verdict: Ending,
    reason: Option<String>,
    #[serde(skip)]
    requirements: usize,
    /// Number of requirements that passed although a conclusion was never called for.
    vacuous: usize,
    /// Requirement with the smallest robustness among those that are not vacuous.
    margin: Option<Margin>,
    steps: Option<u64>,
    digest: Option<String>,
    /// Size of the folder in bytes.
    bytes: u64,
}

/// Facts from a summary; missing or malformed facts are empty.
#[derive(Default, Deserialize)]
struct SummaryFacts {
    scenario: String,
    #[serde(default)]
    set: Vec<String>,
    verdict: String,
    reason: Option<String>,
    requirements: Vec<Requirement>,
    steps: Option<u64>,
    digest: Option<String>,
}

#[derive(Deserialize)]
struct Requirement {
    name: String,
    robustness: Option<f64>,
    unit: String,
    vacuous: Option<String>,
}

/// Margin of a requirement.
#[derive(Debug, Serialize)]
struct Margin {
    requirement: String,
    robustness: f64,
    unit: String,
}

/// Returns the selected runs, newest first.
fn chosen(choice: &RunChoice) -> Result<Vec<Run>, Failure> {
    // Checked before and after, so that a run that ends or begins meanwhile counts as running.
    let mut live = going_on()?;
    let folders = match runs::below(&choice.folder) {
        Err(error) if error.kind() == ErrorKind::NotFound && choice.folder == Path::new(RUNS) => {
            Vec::new()
        }
        result => result.map_err(|error| {
            let folder = choice.folder.display();
            Failure::usage(format!("cannot list runs in {folder}: {error}"))
        })?,
    };
    live.extend(going_on()?);
    let mut runs: Vec<Run> = folders
        .into_iter()
        .map(|folder| Run::of(folder, &live))
        .collect();
    let is_meant = |pattern: &Pattern, run: &Run| pattern.matches(&run.scenario);
    runs.retain(|run| {
        choice
            .scenario
            .as_ref()
            .is_none_or(|pattern| is_meant(pattern, run))
            && (choice.verdict.is_empty() || choice.verdict.contains(&run.verdict))
            && choice.since.is_none_or(|since| run.started_utc >= since)
    });
    Ok(runs)
}

/// Returns the folders of the runs in progress.
fn going_on() -> Result<Vec<PathBuf>, Failure> {
    let live = session::list().map_err(Failure::infrastructure)?;
    let folders = live
        .into_iter()
        .filter_map(|session| session.run_dir?.canonicalize().ok());
    Ok(folders.collect())
}

impl Run {
    fn of(folder: RunFolder, live: &[PathBuf]) -> Self {
        let is_live = (folder.path.canonicalize()).is_ok_and(|path| live.contains(&path));
        let summary = folder.summary.map(serde_json::from_value::<SummaryFacts>);
        let facts = summary.and_then(Result::ok);
        let verdict = match facts.as_ref().map(|facts| facts.verdict.as_str()) {
            _ if is_live => Ending::Running,
            Some("pass") => Ending::Pass,
            Some("fail") => Ending::Fail,
            Some("aborted") => Ending::Aborted,
            _ => Ending::Broken,
        };
        let facts = facts.unwrap_or_else(|| SummaryFacts {
            scenario: written_name(&folder.path).unwrap_or_default(),
            ..SummaryFacts::default()
        });
        let requirements = facts.requirements.len();
        let all = facts.requirements.into_iter();
        let (vacuous, judged): (Vec<_>, Vec<_>) = all.partition(|one| one.vacuous.is_some());
        let margins = judged.into_iter().filter_map(|one| {
            Some(Margin {
                requirement: one.name,
                robustness: one.robustness?,
                unit: one.unit,
            })
        });
        Self {
            started_utc: folder.started,
            scenario: facts.scenario,
            set: facts.set,
            verdict,
            requirements,
            vacuous: vacuous.len(),
            reason: facts.reason,
            margin: margins.min_by(|a, b| a.robustness.total_cmp(&b.robustness)),
            steps: facts.steps,
            digest: facts.digest,
            bytes: bytes(&folder.path),
            path: folder.path,
        }
    }
}

/// Returns the name of the scenario in a folder without a summary.
fn written_name(folder: &Path) -> Option<String> {
    let text = fs::read_to_string(folder.join(SCENARIO)).ok()?;
    let scenario: DocumentMut = text.parse().ok()?;
    scenario.get("name")?.as_str().map(Into::into)
}

/// Returns the size of all files in a folder in bytes; links are not followed.
fn bytes(path: &Path) -> u64 {
    let Ok(metadata) = fs::symlink_metadata(path) else {
        return 0;
    };
    if !metadata.is_dir() {
        return metadata.len();
    }
    let entries = fs::read_dir(path).into_iter().flatten().flatten();
    entries.map(|entry| bytes(&entry.path())).sum()
}

fn table(runs: &[Run]) -> Table {
    let columns = [
        left(0),
        left(0),
        left(0),
        right(0),
        left(0),
        right(0),
        left(0),
    ];
    let mut table = Table::new(0, columns);
    table.cells([
        "BEGUN (UTC)",
        "SCENARIO",
        "VERDICT",
        "MARGIN",
        "OF",
        "SIZE",
        "RUN",
    ]);
    for run in runs {
        let (margin, of) = run
            .margin
            .as_ref()
            .map_or(("-".into(), "-".into()), |margin| {
                let unit = line(&margin.unit);
                (
                    short_in(margin.robustness, &unit),
                    line(&margin.requirement),
                )
            });
        table.cells([
            begun(run.started_utc),
            line(&run.scenario),
            verdict(run),
            margin,
            of,
            size::shown(run.bytes),
            line(&run.path.to_string_lossy()),
        ]);
        if !run.set.is_empty() {
            table.line(format!("  --set {}", line(&run.set.join(" --set "))));
        }
    }
    table
}

/// Returns the verdict in words, with the number of vacuous requirements.
fn verdict(run: &Run) -> String {
    let words = requirements::in_words(run.verdict.name(), run.requirements);
    requirements::with_vacuous(words, run.vacuous)
}

/// Formats a time for the user.
fn begun(time: SystemTime) -> String {
    let text = humantime::format_rfc3339_seconds(time).to_string();
    text.replace('T', " ").replace('Z', "")
}

fn rfc3339<S: serde::Serializer>(time: &SystemTime, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&humantime::format_rfc3339_millis(*time))
}

/// Returns `true` if a run created a file of this name in its folder.
fn is_of_a_run(name: &OsStr) -> bool {
    let name = name.to_string_lossy();
    let is_numbered = |before: &str, after: &str| {
        let rest = name.strip_prefix(before);
        let number = rest.and_then(|rest| rest.strip_suffix(after));
        number.is_some_and(|number| number.parse::<u64>().is_ok())
    };
    runs::FILES.contains(&&*name)
        || name == "controller.log"
        || is_numbered("controller-", ".log")
        || is_numbered("checkpoint-", "")
        || is_numbered("audit-", "")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn similarly_named_files_do_not_count_as_files_of_a_run() {
        for name in [
            "scenario.toml",
            "plant.log",
            "controller.log",
            "controller-2.log",
            "checkpoint-2000",
            "audit-3",
        ] {
            assert!(is_of_a_run(OsStr::new(name)), "{name}");
        }
        for name in [
            "notes.txt",
            "controller-.log",
            "controller-old.log",
            "controller-2.txt",
            "checkpoint-",
            "checkpoint-notes.txt",
            "audit-plan",
            "audit-3.md",
        ] {
            assert!(!is_of_a_run(OsStr::new(name)), "{name}");
        }
    }
}
