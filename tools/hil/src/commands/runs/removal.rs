//! `hil runs rm`: removes runs by a rule, or shows which runs the rule would remove.

use std::fs;
use std::io;
use std::path::Path;
use std::time::SystemTime;

use hil_console::files::part_file;
use hil_console::files::runs::{SCENARIO, SUMMARY};
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_console::terminal::table::{Table, left, right};
use hil_recording::size;
use serde::Serialize;
use shared_types::number::counted;
use shared_types::text::line;

use super::{Run, chosen, is_of_a_run};
use crate::arguments::runs::{Ending, RemovalArguments};

/// Decision about a run.
#[derive(Serialize)]
struct Decision {
    #[serde(flatten)]
    run: Run,
    /// Reason to keep the run; null if the run is removed.
    stays: Option<String>,
}

/// Removes runs, or lists those that would be removed.
///
/// # Errors
/// If there is no rule, or a run cannot be removed.
pub(super) fn remove(arguments: &RemovalArguments) -> Result<Exit, Failure> {
    let is_ruled = arguments.choice.is_a_rule()
        || arguments.older_than.is_some()
        || arguments.keep_last.is_some()
        || arguments.keep_failed;
    if !is_ruled {
        return Err(Failure::usage(
            "hil runs rm needs a rule, such as --keep-last 10, --keep-failed, --older-than 30d or --scenario NAME; use --keep-last 0 to remove all",
        ));
    }
    let decisions = decide(arguments)?;
    let (going, staying): (Vec<_>, Vec<_>) =
        (decisions.iter()).partition(|decision| decision.stays.is_none());
    let going: Vec<&Run> = going.into_iter().map(|decision| &decision.run).collect();
    let mut failures = Vec::new();
    let mut removed = Vec::new();
    for run in going {
        match arguments.yes.then(|| delete(&run.path)) {
            None | Some(Ok(())) => removed.push(run),
            Some(Err(error)) => {
                let run = line(&run.path.to_string_lossy());
                failures.push(format!("cannot remove {run}: {error}"));
            }
        }
    }
    let bytes: u64 = removed.iter().map(|run| run.bytes).sum();
    if arguments.json {
        let all = serde_json::json!({
            "is_dry_run": !arguments.yes, "removed": removed, "bytes": bytes, "stays": staying,
        });
        output::write(&format!("{all}\n"))?;
    } else {
        output::write(&text(arguments, &removed, &staying, bytes))?;
    }
    match failures.is_empty() {
        true => Ok(Exit::Pass),
        false => Err(Failure::infrastructure(failures.join("\n"))),
    }
}

/// Applies the rule to the selected runs.
fn decide(arguments: &RemovalArguments) -> Result<Vec<Decision>, Failure> {
    let mut runs = chosen(&arguments.choice)?;
    if let Some(age) = arguments.older_than {
        let since = SystemTime::now().checked_sub(age);
        runs.retain(|run| since.is_some_and(|since| run.started_utc < since));
    }
    let newest = arguments.keep_last.unwrap_or(0);
    let decide = |(place, run): (usize, Run)| {
        let stays = match run.verdict {
            Ending::Running => Some("it is still running".into()),
            _ if place < newest => Some(format!("it is one of the newest {newest}")),
            Ending::Fail | Ending::Aborted | Ending::Broken if arguments.keep_failed => {
                Some("it did not pass".into())
            }
            _ => foreign(&run.path),
        };
        Decision { run, stays }
    };
    Ok(runs.into_iter().enumerate().map(decide).collect())
}

/// Finds content of a run's folder that was not created by a run.
fn foreign(folder: &Path) -> Option<String> {
    part_file::sweep(folder);
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries.flatten(),
        Err(error) => return Some(format!("it cannot be read: {error}")),
    };
    let mut names = entries.map(|entry| entry.file_name());
    let name = names.find(|name| !is_of_a_run(name))?;
    Some(format!(
        "it contains {}, which no run created",
        line(&name.to_string_lossy())
    ))
}

/// Removes the folder of a run; until the folder is gone, an interrupted removal can be repeated.
fn delete(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name();
        if name == SCENARIO || name == SUMMARY {
            continue;
        }
        if entry.file_type()?.is_dir() {
            fs::remove_dir_all(entry.path())?;
        } else {
            fs::remove_file(entry.path())?;
        }
    }
    for name in [SUMMARY, SCENARIO] {
        match fs::remove_file(folder.join(name)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    fs::remove_dir(folder)
}

fn text(
    arguments: &RemovalArguments,
    removed: &[&Run],
    staying: &[&Decision],
    bytes: u64,
) -> String {
    let mut table = Table::new(2, [left(0), right(0), left(0)]);
    for run in removed {
        let path = line(&run.path.to_string_lossy());
        table.cells([run.verdict.name().into(), size::shown(run.bytes), path]);
    }
    let (runs, bytes) = (counted(removed.len() as u64, "run"), size::shown(bytes));
    let mut text = match arguments.yes {
        _ if removed.is_empty() => "nothing to remove\n".to_owned(),
        true => format!("removed {runs}, {bytes}\n"),
        false => format!("would remove {runs}, {bytes}; confirm with --yes\n"),
    };
    text += &table.to_string();
    for Decision { run, stays } in staying {
        let (path, stays) = (line(&run.path.to_string_lossy()), stays.as_deref());
        text += &format!("kept: {path}: {}\n", stays.unwrap_or_default());
    }
    text
}
