//! The answer of a search: scenarios in its folder, a table or JSON, and the exit code.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use hil_console::files::part_file::write_text;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_console::terminal::table::{Table, left, right};
use serde::Serialize;
use serde_json::{Map, Value, json};
use shared_types::number::{counted, short, short_in};

use super::super::answers::Margin;
use super::super::quoted;
use super::line::Edge;
use super::trials::{Trial, Trials};

/// Scenario that fails, its passing neighbour, and the worst case of a box.
const FILES: [&str; 3] = ["fails.toml", "passes.toml", "worst.toml"];
/// Largest number of trials that are listed for a person.
const MOST_LISTED: usize = 12;

/// Answer of a search.
pub(super) struct Answer {
    fails: Option<Trial>,
    passes: Option<Trial>,
    is_worst: bool,
    /// Reason for which there is no answer, or only a doubtful one.
    reason: Option<String>,
}

/// Answer as JSON.
#[derive(Serialize)]
struct Report<'a> {
    study: &'a str,
    /// Size, or distance of several values in units of their ranges, of the passing neighbour.
    passes: Option<f64>,
    /// The same of the failing case.
    fails: Option<f64>,
    runs: u64,
    scenario: Option<String>,
    requirement: Option<&'a str>,
    neighbour: Option<String>,
    margin: Option<Margin>,
    at: Option<Value>,
    neighbour_margin: Option<Margin>,
    neighbour_at: Option<Value>,
    reason: Option<&'a str>,
    tried: Vec<Value>,
}

impl Answer {
    /// Creates the answer of a search that found nothing.
    pub(super) const fn without(reason: String) -> Self {
        Self {
            fails: None,
            passes: None,
            is_worst: false,
            reason: Some(reason),
        }
    }

    /// Creates the answer of a search that found the edge of failure.
    pub(super) fn edge(trials: &Trials, edge: Edge) -> Self {
        let beyond = trials
            .all()
            .iter()
            .filter(|one| !one.is_failed && trials.distance(one) > trials.distance(&edge.fails));
        let passing = beyond.map(|one| trials.evaluator().describe(&one.evaluation.point));
        let search = &trials.evaluator().study().search;
        let unfinished = edge.too_far.map(|distance| {
            format!(
                "the {} allowed ended while the neighbours were {} % of the ranges apart, and `tolerance` is {} %: raise `runs` in [search]",
                counted(search.runs, "run"),
                short(100.0 * distance),
                short(100.0 * search.tolerance)
            )
        });
        let reason = (!edge.is_monotone).then(|| {
            format!(
                "not monotone: beyond the first failure, these pass again: {}; smaller sizes between the probes may fail, too: raise `probes` in [search], or narrow the range",
                passing.collect::<Vec<String>>().join("; ")
            )
        });
        Self {
            fails: Some(edge.fails),
            passes: Some(edge.passes),
            is_worst: false,
            reason: reason.or(unfinished),
        }
    }

    /// Creates the answer of a search for the worst case.
    pub(super) fn worst(worst: Trial) -> Self {
        let is_failed = worst.is_failed;
        let one = Some(worst);
        let (fails, passes) = if is_failed { (one, None) } else { (None, one) };
        Self {
            fails,
            passes,
            is_worst: true,
            reason: None,
        }
    }

    /// Returns the exit code.
    pub(super) const fn exit(&self) -> Exit {
        match (self.is_worst, &self.fails, &self.reason) {
            (true, None, None) | (false, Some(_), None) => Exit::Pass,
            _ => Exit::Failed,
        }
    }
}

/// Writes the scenarios and prints the answer.
///
/// # Errors
/// If a file or the output cannot be written.
pub(super) fn write(
    answer: &Answer,
    trials: &Trials,
    kind: &str,
    folder: &Path,
    json: bool,
) -> Result<(), Failure> {
    for name in FILES {
        let _ = fs::remove_file(folder.join(name)); // left by an earlier search, if there was one
    }
    let put = |trial: &Option<Trial>, name: &str| {
        let Some(trial) = trial else { return Ok(None) };
        let path = folder.join(name);
        let text = trials.evaluator().scenario(&trial.evaluation.point)?;
        write_text(&path, &text)?;
        Ok::<_, Failure>(Some(path))
    };
    let [fails, passes, worst] = FILES;
    let (scenario, neighbour) = if answer.is_worst {
        let one = answer.fails.clone().or_else(|| answer.passes.clone());
        (put(&one, worst)?, None)
    } else {
        (put(&answer.fails, fails)?, put(&answer.passes, passes)?)
    };
    let report = report(answer, trials, [scenario.as_ref(), neighbour.as_ref()]);
    output::result(json, &report, || {
        let paths = [scenario.as_deref(), neighbour.as_deref()];
        output::text(|text| table(text, answer, trials, kind, paths))
    })
}

/// Returns the size of a trial: its value, or its distance from the nominal point.
fn size(trials: &Trials, trial: &Trial) -> f64 {
    match trial.evaluation.point[..] {
        [value] => value,
        _ => trials.distance(trial),
    }
}

fn at(trials: &Trials, trial: &Trial) -> Value {
    let dimensions = trials.evaluator().dimensions().iter();
    let values = dimensions.zip(&trial.evaluation.point);
    let values = values.map(|(one, value)| (one.name.clone(), json!(value)));
    Value::Object(values.collect::<Map<String, Value>>())
}

fn report<'a>(
    answer: &'a Answer,
    trials: &'a Trials,
    [scenario, neighbour]: [Option<&PathBuf>; 2],
) -> Report<'a> {
    let path = |path: Option<&PathBuf>| path.map(|path| path.display().to_string());
    let main = match answer.is_worst {
        true => answer.fails.as_ref().or(answer.passes.as_ref()),
        false => answer.fails.as_ref(),
    };
    let beside = answer.passes.as_ref().filter(|_| !answer.is_worst);
    let tried = trials.all().iter().map(|one| {
        let (name, _) = trials.requirement(one);
        json!({
            "at": at(trials, one),
            "class": one.evaluation.class,
            "requirement": name,
            "margin": Margin(Trials::margin(one)),
            "digest": one.evaluation.digest,
        })
    });
    Report {
        study: &trials.evaluator().study().name,
        passes: answer.passes.as_ref().map(|one| size(trials, one)),
        fails: answer.fails.as_ref().map(|one| size(trials, one)),
        runs: trials.runs(),
        scenario: path(scenario),
        requirement: main.map(|one| trials.requirement(one).0),
        neighbour: path(neighbour),
        margin: main.map(|one| Margin(Trials::margin(one))),
        at: main.map(|one| at(trials, one)),
        neighbour_margin: beside.map(|one| Margin(Trials::margin(one))),
        neighbour_at: beside.map(|one| at(trials, one)),
        reason: answer.reason.as_deref(),
        tried: tried.collect(),
    }
}

fn table(
    text: &mut String,
    answer: &Answer,
    trials: &Trials,
    kind: &str,
    paths: [Option<&Path>; 2],
) -> std::fmt::Result {
    let name = &trials.evaluator().study().name;
    let runs = counted(trials.runs(), "run");
    let describe = |one: &Trial| trials.evaluator().describe(&one.evaluation.point);
    match (&answer.fails, &answer.passes) {
        (Some(fails), Some(passes)) => {
            let (requirement, _) = trials.requirement(fails);
            writeln!(
                text,
                "{name}: {} breaks {requirement}, {} does not ({runs})",
                describe(fails),
                describe(passes)
            )?;
        }
        (Some(worst), None) => writeln!(
            text,
            "{name}: {} is the worst tried and fails ({runs})",
            describe(worst)
        )?,
        (None, Some(worst)) => writeln!(
            text,
            "{name}: {} is the worst tried and passes ({runs})",
            describe(worst)
        )?,
        (None, None) => writeln!(text, "{name}: no {kind} case found ({runs})")?,
    }
    if let Some(reason) = &answer.reason {
        writeln!(text, "  {reason}")?;
    }
    writeln!(text)?;
    let dimensions = trials.evaluator().dimensions();
    let columns = [left(0)].into_iter();
    let columns = columns.chain(dimensions.iter().map(|_| right(8)));
    let columns = columns.chain([left(0), left(0), right(0), right(6)]);
    let mut lines = Table::new(2, columns.collect::<Vec<_>>());
    let names = dimensions.iter().map(|one| one.name.clone());
    let head = ["".into()].into_iter().chain(names);
    lines.cells(head.chain(["", "least margin", "", "share"].map(String::from)));
    let mut listed: Vec<(&str, &Trial)> = Vec::new();
    listed.extend(answer.fails.iter().map(|one| ("fails", one)));
    listed.extend(answer.passes.iter().map(|one| ("passes", one)));
    if answer.reason.is_some() {
        let mut others: Vec<&Trial> = trials.all().iter().collect();
        others.sort_by(|a, b| a.share.total_cmp(&b.share));
        listed.extend(
            others
                .into_iter()
                .take(MOST_LISTED)
                .map(|one| ("tried", one)),
        );
    }
    for (word, one) in listed {
        let (requirement, unit) = trials.requirement(one);
        let values = one.evaluation.point.iter().map(|value| short(*value));
        let cells = [word.to_owned()].into_iter().chain(values);
        let margin = Trials::margin(one);
        lines.cells(cells.chain([
            one.evaluation.class.clone(),
            requirement.to_owned(),
            short_in(margin, unit),
            match one.share.is_finite() {
                true => format!("{} %", short(100.0 * one.share)),
                false => "-".into(),
            },
        ]));
    }
    write!(text, "{lines}")?;
    for path in paths.into_iter().flatten() {
        writeln!(text, "  hil run {}", quoted(path))?;
    }
    Ok(())
}
