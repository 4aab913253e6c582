//! `hil run`: one scenario or several, once or repeatedly, from the command line to the verdicts.
//!
//! Every run has a session, a folder and processes of its own; so many of them go on at a time as
//! there are cores for. All scenarios are checked before the first run starts. What repeats a
//! scenario must have its digest: that is a verdict too.

mod junit;
mod markdown;
mod table;

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use hil_config::plan::{Clock, Plan};
use serde_json::json;

use crate::arguments::run::RunArguments;
use crate::arguments::tolerance::Tolerances;
use crate::checkpoint::past::{self, Past};
use crate::files::part_file;
use crate::programs::binaries::Choices;
use crate::programs::binaries::named::Named;
use crate::programs::scenario::Finder;
use crate::results::summary::Summary;
use crate::run::settings::Settings;
use crate::run::{self, Environment, Origin, RunResult};
use crate::terminal::exit::{Exit, Failure};
use crate::terminal::interruption::Interruption;
use crate::terminal::output;
use crate::verification::compare;

/// One run that is wanted.
struct Case {
    plan: Plan,
    environment: Environment,
    /// What it is called in tables and folders: the scenario, and its number if there are more.
    label: String,
    /// The law that runs.
    law: String,
    /// Where its scenario comes from.
    origin: String,
    /// The first case of the same scenario.
    first: usize,
}

/// One run as it came out.
struct Row {
    label: String,
    law: String,
    /// Where its scenario comes from.
    origin: String,
    exit: Exit,
    /// What is wrong with it that its summary does not say.
    failure: Option<String>,
    /// Nothing if it was never started.
    ran: Option<Kept>,
}

/// What is kept of a run that was started.
struct Kept {
    summary: Summary,
    /// The summary as a machine reads it.
    json: String,
    folder: PathBuf,
    recording: Option<PathBuf>,
}

impl Row {
    fn not_run(case: &Case, exit: Exit, failure: String) -> Self {
        Self {
            label: case.label.clone(),
            law: case.law.clone(),
            origin: case.origin.clone(),
            exit,
            failure: Some(failure),
            ran: None,
        }
    }

    fn of(case: &Case, ran: RunResult) -> Self {
        Self {
            label: case.label.clone(),
            law: case.law.clone(),
            origin: case.origin.clone(),
            exit: match ran.written {
                Ok(()) => ran.exit,
                Err(_) => Exit::Infrastructure,
            },
            failure: ran.written.err().map(|error| error.to_string()),
            ran: Some(Kept {
                summary: ran.summarised,
                json: ran.summary,
                folder: ran.folder,
                recording: ran.recording,
            }),
        }
    }

    /// In one word.
    fn verdict(&self) -> &'static str {
        match (self.exit, &self.ran) {
            (Exit::Pass, _) => "pass",
            (Exit::Failed, _) => "fail",
            (_, Some(_)) => "aborted",
            (_, None) => "not run",
        }
    }

    /// Why it is no pass, beside the requirements that failed.
    fn reasons(&self) -> impl Iterator<Item = &str> {
        let summary = self.ran.as_ref().map(|ran| &ran.summary);
        let reason = summary.and_then(|summary| summary.reason.as_deref());
        reason.into_iter().chain(self.failure.as_deref())
    }
}

/// Runs the command.
///
/// # Errors
/// If nothing could be started, or results not be written.
pub(crate) fn run(arguments: &RunArguments) -> Result<Exit, Failure> {
    let options = &arguments.options;
    let reports = [&arguments.junit, &arguments.markdown];
    for path in reports.into_iter().flatten() {
        refuse_unwritable(path)?;
    }
    let (settings, interruption) = run::begin(options)?;
    let mut cases = Vec::new();
    let mut origin = Origin::Scenario;
    if let Some(from) = &arguments.from.from {
        refuse_several(arguments)?;
        let recorded = interruption.at_once(|| past::recorded(from))??;
        let choices = Choices::of(&options.binaries, &Named::Recorded(&recorded))?;
        let binaries = choices.find(&interruption)?;
        binaries.tell();
        let environment = Environment::new(&settings, binaries, &interruption)?;
        let (past, (plan, branch)) = interruption.at_once(|| {
            let past = Past::open(from, &environment.binaries)?;
            let planned = past.plan(&options.changes, &environment.binaries, options.json)?;
            Ok::<_, Failure>((past, planned))
        })??;
        origin = Origin::Checkpoint(Box::new(past), branch);
        cases.push(Case {
            label: plan.name.clone(),
            law: plan.controller.law.clone(),
            origin: from.display().to_string(),
            first: 0,
            plan,
            environment,
        });
    } else {
        cases = self::cases(arguments, &settings, &interruption)?;
    }
    let rows = if let [case] = &cases[..] {
        let ran = run::execute(case.plan.clone(), case.environment.clone(), origin)?;
        let told = output::write(&if options.json {
            format!("{}\n", ran.summary)
        } else {
            ran.table.clone()
        });
        let row = Row::of(case, ran);
        if let Some(failure) = &row.failure {
            output::tell(&failure.to_string());
        }
        let written = write_reports(arguments, std::slice::from_ref(&row));
        told?;
        written?;
        return Ok(row.exit);
    } else {
        let jobs = jobs(arguments, &cases)?;
        refuse(&settings)?;
        all(&cases, jobs)
    };
    let told = output::write(&if options.json {
        let runs: Result<Vec<serde_json::Value>, _> = rows.iter().map(json_of).collect();
        let runs = runs.map_err(Failure::infrastructure)?;
        let verdict = match worst(&rows) {
            Exit::Pass => "pass",
            Exit::Failed => "fail",
            _ => "aborted",
        };
        let all = json!({ "schema": 1, "verdict": verdict, "runs": runs });
        format!("{all:#}\n")
    } else {
        table::of(&rows)
    });
    write_reports(arguments, &rows)?;
    told?;
    Ok(worst(&rows))
}

/// Checks all scenarios and puts the runs in order: the first of each, then the second, and so on.
fn cases(
    arguments: &RunArguments,
    settings: &Settings,
    interruption: &Interruption,
) -> Result<Vec<Case>, Failure> {
    let options = &arguments.options;
    let mut plans = Vec::new();
    let mut problems = Vec::new();
    let mut finder = Finder::new(&options.binaries, interruption);
    for scenario in &arguments.scenarios {
        match finder.read(scenario, &options.changes, options.json) {
            Ok((plan, binaries)) => {
                plans.push((plan, Environment::new(settings, binaries, interruption)?))
            }
            Err(Failure::Usage(problem)) => problems.push(problem),
            Err(other) => return Err(other),
        }
    }
    if !problems.is_empty() {
        return Err(Failure::Usage(problems.join("\n\n")));
    }
    let mut cases: Vec<Case> = Vec::new();
    for _ in 0..arguments.repeat {
        for (first, (plan, environment)) in plans.iter().enumerate() {
            let earlier = cases.iter().filter(|case| case.plan.name == plan.name);
            let number = earlier.count() + 1;
            let same = (plans.iter().filter(|(other, _)| other.name == plan.name)).count();
            cases.push(Case {
                plan: plan.clone(),
                environment: environment.clone(),
                label: if same > 1 || arguments.repeat > 1 {
                    format!("{}-{number}", plan.name)
                } else {
                    plan.name.clone()
                },
                law: plan.controller.law.clone(),
                origin: arguments.scenarios[first].display().to_string(),
                first,
            });
        }
    }
    Ok(cases)
}

/// How many runs go on at a time.
fn jobs(arguments: &RunArguments, cases: &[Case]) -> Result<usize, Failure> {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let against_clock = cases
        .iter()
        .any(|case| case.plan.run.clock != Clock::Lockstep);
    match arguments.jobs.map(|jobs| jobs as usize) {
        Some(jobs) if jobs > cores => Err(Failure::usage(format!(
            "--jobs {jobs} is more than the {cores} cores there are; every run wants two"
        ))),
        Some(jobs) => Ok(jobs),
        None if against_clock => Ok(1),
        None => Ok((cores / 2).max(1)),
    }
}

/// Refuses what cannot go with a checkpoint.
fn refuse_several(arguments: &RunArguments) -> Result<(), Failure> {
    if arguments.repeat > 1 {
        return Err(Failure::usage(
            "--repeat is for scenarios; --from goes on once",
        ));
    }
    Ok(())
}

/// Refuses what can be meant for one run only.
fn refuse(settings: &Settings) -> Result<(), Failure> {
    if settings.pause_at_s.is_some() {
        return Err(Failure::usage(
            "--pause-at is for a single run; several run by themselves",
        ));
    }
    Ok(())
}

/// Refuses a file whose folder is not there, before hours of runs.
fn refuse_unwritable(path: &Path) -> Result<(), Failure> {
    let folder = path.parent().filter(|folder| *folder != Path::new(""));
    let is_there = folder.is_none_or(Path::is_dir);
    if is_there && !path.is_dir() {
        return Ok(());
    }
    let shown = path.display();
    Err(Failure::usage(if is_there {
        format!("cannot write {shown}: it is a folder")
    } else {
        format!("cannot write {shown}: there is no such folder")
    }))
}

/// Runs every case, so many at a time; rows in the order of the cases.
fn all(cases: &[Case], jobs: usize) -> Vec<Row> {
    let next = AtomicUsize::new(0);
    let rows: Mutex<Vec<Option<Row>>> = Mutex::new(cases.iter().map(|_| None).collect());
    let work = || {
        while let Some((index, case)) = {
            let index = next.fetch_add(1, Ordering::Relaxed);
            cases.get(index).map(|case| (index, case))
        } {
            let row = one(case, index);
            let mut rows = rows
                .lock()
                .unwrap_or_else(std::sync::PoisonError::into_inner);
            rows[index] = Some(row);
            tell(&mut rows, cases, index);
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..jobs {
            scope.spawn(work);
        }
    });
    let rows = rows.into_inner();
    let rows = rows.unwrap_or_else(std::sync::PoisonError::into_inner);
    rows.into_iter().flatten().collect()
}

/// One of several runs.
fn one(case: &Case, index: usize) -> Row {
    let mut environment = case.environment.clone();
    if environment.interruption.came() {
        return Row::not_run(case, Exit::Interrupted, "interrupted".into());
    }
    let (number, settings) = (index + 1, &mut environment.settings);
    settings.is_one_of_many = true;
    settings.out = (settings.out.take()).map(|folder| folder.join(&case.label));
    settings.session = (settings.session.take()).map(|name| format!("{name}-{number}"));
    match run::execute(case.plan.clone(), environment, Origin::Scenario) {
        Ok(ran) => Row::of(case, ran),
        Err(failure) => Row::not_run(case, failure.exit(), failure.to_string()),
    }
}

/// Compares the digest of a run that has just ended with that of the first of its scenario, whichever
/// of them came later, and tells how it went.
fn tell(rows: &mut [Option<Row>], cases: &[Case], index: usize) {
    let first = cases[index].first;
    let (done, all) = (rows.iter().flatten().count(), cases.len());
    let compared: Vec<usize> = if index == first {
        (first + 1..cases.len())
            .filter(|other| cases[*other].first == first)
            .collect()
    } else {
        vec![index]
    };
    for other in compared {
        if cases[other].plan.run.clock == Clock::Realtime {
            continue; // depends on what comes too late
        }
        let found = match (&rows[first], &rows[other]) {
            (Some(a), Some(b)) => another_digest(a, b),
            _ => None,
        };
        if let (Some(found), Some(row)) = (found, &mut rows[other]) {
            row.failure = Some(found);
            row.exit = Exit::Failed;
        }
    }
    let Some(row) = &rows[index] else { return };
    let reason: String = row
        .reasons()
        .take(1)
        .map(|told| format!(": {told}"))
        .collect();
    output::tell(&format!(
        "[{done}/{all}] {}: {}{reason}",
        row.label,
        row.verdict()
    ));
}

/// What is to say if two runs that ended by themselves differ.
fn another_digest(first: &Row, other: &Row) -> Option<String> {
    let (a, b) = (first.ran.as_ref()?, other.ran.as_ref()?);
    let is_over = |row: &Row| matches!(row.exit, Exit::Pass | Exit::Failed);
    let differ = is_over(first) && is_over(other) && a.summary.digest != b.summary.digest;
    if !differ {
        return None;
    }
    let difference = (a.recording.as_ref().zip(b.recording.as_ref()))
        .and_then(|(a, b)| compare::compare(a, b, &[], &Tolerances::default()).ok());
    let difference = (difference.as_ref())
        .and_then(compare::Comparison::first_difference)
        .map_or_else(String::new, |found| format!(": {found}"));
    Some(format!("another digest than {}{difference}", first.label))
}

/// The exit code that stands for all: a run that could not end says more than one that failed.
fn worst(rows: &[Row]) -> Exit {
    let severity = |exit: &Exit| match exit {
        Exit::Pass => 0,
        Exit::Failed => 1,
        Exit::Usage => 2,
        Exit::Infrastructure => 3,
        Exit::Interrupted => 4,
    };
    let exits = rows.iter().map(|row| row.exit);
    exits.max_by_key(severity).unwrap_or(Exit::Pass)
}

/// A run as a machine reads it: its summary, its label and folder, and what else is wrong with it.
fn json_of(row: &Row) -> serde_json::Result<serde_json::Value> {
    let mut value = match &row.ran {
        Some(ran) => serde_json::from_str(&ran.json)?,
        None => json!({}),
    };
    value["label"] = json!(row.label);
    value["verdict"] = json!(row.verdict());
    value["failure"] = json!(row.failure);
    value["origin"] = json!(row.origin);
    let folder = row.ran.as_ref().map(|ran| ran.folder.display().to_string());
    value["folder"] = json!(folder);
    Ok(value)
}

fn write_reports(arguments: &RunArguments, rows: &[Row]) -> Result<(), Failure> {
    if let Some(path) = &arguments.junit {
        part_file::write_text(path, &junit::of(rows)?)?;
    }
    if let Some(path) = &arguments.markdown {
        part_file::write_text(path, &markdown::of(rows))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
