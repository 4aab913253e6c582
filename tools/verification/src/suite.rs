//! `hil run`: runs one or more scenarios once, repeatedly or under the conditions of an audit, from the command line to
//! the verdicts.
//!
//! Every run has its own session, folder and processes or threads; as many runs as the cores allow are active at a
//! time. All scenarios are checked before the first run starts. All runs of a scenario must have the same digest: a
//! difference affects the verdict.

mod audit;
mod case;
pub(crate) mod junit;
pub mod lost;
mod markdown;
mod noise;
mod running;
mod table;

use std::path::Path;

use hil_config::plan::Clock;
use hil_console::files::part_file;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::arguments::run::LinkKind;
use hil_facts::checkpoint::past::{self, Past};
use hil_facts::programs::binaries::Choices;
use hil_facts::programs::binaries::named::Named;
use hil_facts::programs::binaries::reached::Reached;
use hil_facts::programs::scenario::Finder;
use hil_run::settings::Settings;
use hil_run::{Environment, Origin};
use serde_json::json;

use crate::arguments::run::RunArguments;
use case::{Case, Row};

/// Runs the command.
///
/// # Errors
/// If no run could be started, or results cannot be written.
pub fn run(arguments: &RunArguments) -> Result<Exit, Failure> {
    if arguments.audit {
        audit::refuse_arguments(arguments)?;
    }
    let reports = [&arguments.junit, &arguments.markdown];
    for path in reports.into_iter().flatten() {
        refuse_unwritable(path)?;
    }
    let (settings, interruption) = hil_run::begin(&arguments.options)?;
    if let (Some(flag), Some(_)) = (settings.by_hand.flag(), arguments.jobs) {
        return Err(Failure::usage(format!(
            "{flag} requires a single run; omit --jobs"
        )));
    }
    if let Some(from) = &arguments.from.from {
        let (case, origin) = resumed(arguments, from, &settings, &interruption)?;
        return single(arguments, &case, origin);
    }
    let cases = cases(arguments, &settings, &interruption)?;
    match &cases[..] {
        [case] if arguments.audit => audit::audit(case, arguments.options.json),
        [case] => single(arguments, case, Origin::Scenario),
        _ => several(arguments, cases),
    }
}

/// Runs one case and prints the summary of its run.
fn single(arguments: &RunArguments, case: &Case, origin: Origin) -> Result<Exit, Failure> {
    let row = case.row(Some(Ok(case.run(origin)?)));
    let result = row.ran.as_ref().map_or(Ok(()), |ran| {
        output::write(&if arguments.options.json {
            format!("{}\n", ran.json)
        } else {
            ran.table.clone()
        })
    });
    if let Some(failure) = &row.failure {
        output::tell(&failure.to_string());
    }
    let reports = write_reports(arguments, std::slice::from_ref(&row));
    result?;
    reports?;
    Ok(row.exit)
}

/// Runs several cases and prints a table of verdicts.
fn several(arguments: &RunArguments, mut cases: Vec<Case>) -> Result<Exit, Failure> {
    let jobs = jobs(arguments, &cases)?;
    for (number, case) in (1..).zip(&mut cases) {
        let settings = &mut case.environment.settings;
        if settings.pause_at_s.is_some() {
            return Err(Failure::usage(
                "--pause-at requires a single run; run one scenario, once",
            ));
        }
        if let Some(flag) = settings.by_hand.flag() {
            return Err(Failure::usage(format!(
                "{flag} requires a single run; run one scenario, once"
            )));
        }
        settings.is_one_of_many = true;
        settings.out = (settings.out.take()).map(|folder| folder.join(&case.label));
        settings.session = (settings.session.take()).map(|name| format!("{name}-{number}"));
    }
    let all = cases.len();
    let ended = |done: usize, row: &mut Row| {
        let reason = row.reasons().into_iter().next();
        let reason = reason.map_or_else(String::new, |reason| format!(": {reason}"));
        let (label, verdict) = (&row.label, row.verdict_in_words());
        tell!("[{done}/{all}] {label}: {verdict}{reason}");
        Ok(())
    };
    let rows = match running::all(&cases, Vec::new(), jobs, &|_, _| {}, &ended) {
        Ok(rows) => rows,
        Err(early) => return early,
    };
    let worst = worst(&rows);
    let result = output::write(&if arguments.options.json {
        let runs: Result<Vec<serde_json::Value>, _> = rows.iter().map(json_of).collect();
        let runs = runs.map_err(Failure::infrastructure)?;
        let verdict = match worst {
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
    result?;
    Ok(worst)
}

/// Loads the checkpoint from which a run resumes, and plans the rest of the run.
fn resumed(
    arguments: &RunArguments,
    from: &Path,
    settings: &Settings,
    interruption: &Interruption,
) -> Result<(Case, Origin), Failure> {
    if arguments.repeat > 1 {
        return Err(Failure::usage(
            "--repeat applies to scenarios; --from resumes a single run",
        ));
    }
    let options = &arguments.options;
    let recorded = interruption.at_once(|| past::recorded(from))??;
    let at = Reached::by(&options.target, settings.wait_limit_s, interruption)?;
    let choices = Choices::of(&options.binaries, &Named::Recorded(&recorded), at.as_ref())?;
    let binaries = choices.find(interruption)?;
    binaries.tell();
    let environment = Environment::new(settings, binaries, interruption)?;
    let (past, (plan, branch)) = interruption.at_once(|| {
        let past = Past::open(from, &environment.binaries)?;
        let planned = past.plan(&options.changes, &environment.binaries, options.json)?;
        Ok::<_, Failure>((past, planned))
    })??;
    past.tell();
    let case = Case::new(plan, environment, from.display().to_string());
    Ok((case, Origin::Checkpoint(Box::new(past), branch)))
}

/// Checks all scenarios and orders the runs: the first of each, then the second of each, and so on.
fn cases(
    arguments: &RunArguments,
    settings: &Settings,
    interruption: &Interruption,
) -> Result<Vec<Case>, Failure> {
    let options = &arguments.options;
    let mut plans = Vec::new();
    let mut problems = Vec::new();
    let at = Reached::by(&options.target, settings.wait_limit_s, interruption)?;
    let mut finder = Finder::new(&options.binaries, at.as_ref(), interruption);
    for scenario in &arguments.scenarios {
        match finder.read(scenario, &options.changes, options.json) {
            Ok((plan, binaries, file)) => {
                let mut environment = Environment::new(settings, binaries, interruption)?;
                environment.settings.scenario_file = Some(file);
                plans.push((plan, environment));
            }
            Err(Failure::Usage(problem)) => problems.push((scenario, problem)),
            Err(other) => return Err(other),
        }
    }
    if !problems.is_empty() {
        let rows: Vec<Row> = (problems.iter())
            .map(|(scenario, problem)| Row::refused(scenario, problem))
            .collect();
        if let Err(failure) = write_reports(arguments, &rows) {
            output::tell(&failure.to_string());
        }
        let problems: Vec<String> = problems.into_iter().map(|(_, problem)| problem).collect();
        return Err(Failure::Usage(problems.join("\n\n")));
    }
    let mut cases: Vec<Case> = Vec::new();
    for _ in 0..arguments.repeat {
        for (first, (plan, environment)) in plans.iter().enumerate() {
            let origin = arguments.scenarios[first].display().to_string();
            let mut case = Case::new(plan.clone(), environment.clone(), origin);
            let same = (plans.iter().filter(|(other, _)| other.name == plan.name)).count();
            if same > 1 || arguments.repeat > 1 {
                let earlier = cases.iter().filter(|case| case.plan.name == plan.name);
                let is_taken = |label: &String| {
                    (arguments.repeat == 1 && plans.iter().any(|(other, _)| other.name == *label))
                        || cases.iter().any(|case| case.label == *label)
                };
                case.label = (earlier.count() + 1..)
                    .map(|number| format!("{}-{number}", plan.name))
                    .find(|label| !is_taken(label))
                    .unwrap_or_default(); // numbers do not end
            }
            cases.push(Case { first, ..case });
        }
    }
    Ok(cases)
}

/// Returns the number of parallel runs.
fn jobs(arguments: &RunArguments, cases: &[Case]) -> Result<usize, Failure> {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let against_clock = cases
        .iter()
        .any(|case| case.plan.run.clock != Clock::Lockstep);
    let (each, wants) = match arguments.options.link {
        LinkKind::Iceoryx2 => (2, "two"),
        LinkKind::InProcess => (1, "one"),
    };
    match arguments.jobs.map(|jobs| jobs as usize) {
        Some(jobs) if jobs > cores => Err(Failure::usage(format!(
            "--jobs {jobs} exceeds the {cores} available cores; every run needs {wants}"
        ))),
        Some(2..) if arguments.options.target.serves_one() => Err(Failure::usage(
            "--jobs cannot be used here: a listening agent serves one session at a time; omit --jobs",
        )),
        Some(jobs) => Ok(jobs),
        None if against_clock || arguments.options.target.target.is_some() => Ok(1),
        None => Ok((cores / each).max(1)),
    }
}

/// Refuses a file whose folder does not exist, before hours of runs are wasted.
fn refuse_unwritable(path: &Path) -> Result<(), Failure> {
    let folder = path.parent().filter(|folder| *folder != Path::new(""));
    let is_there = folder.is_none_or(Path::is_dir);
    if is_there && !path.is_dir() {
        return Ok(());
    }
    let path_text = path.display();
    Err(Failure::usage(if is_there {
        format!("cannot write {path_text}: it is a folder")
    } else {
        format!("cannot write {path_text}: its folder does not exist")
    }))
}

/// Returns the exit code of the suite: an aborted run outranks a failed one.
fn worst(rows: &[Row]) -> Exit {
    let exits = rows.iter().map(|row| row.exit);
    exits.max_by_key(|exit| *exit as u8).unwrap_or(Exit::Pass)
}

/// Converts a run to JSON: its summary, label and folder, and errors beyond the summary.
fn json_of(row: &Row) -> serde_json::Result<serde_json::Value> {
    let mut value = match &row.ran {
        Some(ran) => serde_json::from_str(&ran.json)?,
        None => json!({}),
    };
    value["label"] = json!(row.label);
    value["verdict"] = json!(row.verdict());
    let failure = row.failure.as_ref().map(ToString::to_string);
    let disagreement = row.disagreement.as_ref().map(ToString::to_string);
    value["failure"] = json!(failure.or(disagreement));
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
