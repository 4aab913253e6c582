//! `hil runs`: what was run here, by what each run's folder says of it.

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
/// If the folder cannot be read, or what was asked for cannot be removed.
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

/// Run as it is listed.
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
    /// Requirement with the least robustness.
    margin: Option<Margin>,
    steps: Option<u64>,
    digest: Option<String>,
    /// Bytes of the folder.
    bytes: u64,
}

/// Facts read of a summary; where it says something else, nothing.
#[derive(Default, Deserialize)]
struct Told {
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
}

/// Margin by which a requirement holds.
#[derive(Debug, Serialize)]
struct Margin {
    requirement: String,
    robustness: f64,
    unit: String,
}

/// The runs that are meant, the newest first.
fn chosen(choice: &RunChoice) -> Result<Vec<Run>, Failure> {
    // Before and after, so that one that ends or begins meanwhile goes on.
    let mut live = going_on()?;
    let found = match runs::below(&choice.folder) {
        Err(error) if error.kind() == ErrorKind::NotFound && choice.folder == Path::new(RUNS) => {
            Vec::new()
        }
        found => found.map_err(|error| {
            let folder = choice.folder.display();
            Failure::usage(format!("cannot look for runs in {folder}: {error}"))
        })?,
    };
    live.extend(going_on()?);
    let mut runs: Vec<Run> = found
        .into_iter()
        .map(|found| Run::of(found, &live))
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

/// Folders of the runs that go on.
fn going_on() -> Result<Vec<PathBuf>, Failure> {
    let live = session::list().map_err(Failure::infrastructure)?;
    let folders = live
        .into_iter()
        .filter_map(|session| session.run_dir?.canonicalize().ok());
    Ok(folders.collect())
}

impl Run {
    fn of(found: RunFolder, live: &[PathBuf]) -> Self {
        let is_live = (found.path.canonicalize()).is_ok_and(|path| live.contains(&path));
        let summary = found.summary.map(serde_json::from_value::<Told>);
        let told = summary.and_then(Result::ok);
        let verdict = match told.as_ref().map(|told| told.verdict.as_str()) {
            _ if is_live => Ending::Running,
            Some("pass") => Ending::Pass,
            Some("fail") => Ending::Fail,
            Some("aborted") => Ending::Aborted,
            _ => Ending::Broken,
        };
        let told = told.unwrap_or_else(|| Told {
            scenario: written_name(&found.path).unwrap_or_default(),
            ..Told::default()
        });
        let requirements = told.requirements.len();
        let margins = told.requirements.into_iter().filter_map(|one| {
            Some(Margin {
                requirement: one.name,
                robustness: one.robustness?,
                unit: one.unit,
            })
        });
        Self {
            started_utc: found.started,
            scenario: told.scenario,
            set: told.set,
            verdict,
            requirements,
            reason: told.reason,
            margin: margins.min_by(|a, b| a.robustness.total_cmp(&b.robustness)),
            steps: told.steps,
            digest: told.digest,
            bytes: bytes(&found.path),
            path: found.path,
        }
    }
}

/// Name of the scenario in a folder that has no summary.
fn written_name(folder: &Path) -> Option<String> {
    let text = fs::read_to_string(folder.join(SCENARIO)).ok()?;
    let scenario: DocumentMut = text.parse().ok()?;
    scenario.get("name")?.as_str().map(Into::into)
}

/// Bytes of all files of a folder; links are not followed.
fn bytes(path: &Path) -> u64 {
    let Ok(found) = fs::symlink_metadata(path) else {
        return 0;
    };
    if !found.is_dir() {
        return found.len();
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
            requirements::in_words(run.verdict.name(), run.requirements).into(),
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

/// A time as a person reads it.
fn begun(time: SystemTime) -> String {
    let text = humantime::format_rfc3339_seconds(time).to_string();
    text.replace('T', " ").replace('Z', "")
}

fn rfc3339<S: serde::Serializer>(time: &SystemTime, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&humantime::format_rfc3339_millis(*time))
}

/// Checks that a run put something into its folder.
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
    fn what_is_only_named_as_if_a_run_had_written_it_is_not_of_a_run() {
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
