//! Times at which formulas of the command line hold: a section of the page, and marks in every plot.
//!
//! Evaluated at every step by the code that judges requirements, as the panel does. Changes no verdict.

use hil_console::terminal::exit::Failure;
use hil_recording::reader::SpanReader;
use maud::{Markup, html};
use serde::Serialize;
use shared_types::number::{counted, short};
use shared_types::time::{Rate, Step};

use super::occurrences::{Occurrences, Search};
use super::run::Run;
use super::side_by_side;
use super::tables::{seconds, swatch};

/// Maximum number of formulas: more rows of marks cannot be told apart.
const MOST_FORMULAS: usize = 8;

/// Formula with its occurrences in each run.
pub(super) struct Found {
    formula: String,
    runs: Vec<Occurrences>,
}

/// Formula for the script of the page.
#[derive(Debug, Serialize)]
pub(super) struct FoundData {
    formula: String,
    /// First time and end of each interval in s, of each run, as many as are listed.
    runs: Vec<Vec<[f64; 2]>>,
    /// Number of all intervals.
    count: u64,
}

/// Refuses more formulas than a page can show.
///
/// # Errors
/// If there are too many.
pub(super) fn refuse_many(formulas: &[String]) -> Result<(), Failure> {
    let number = formulas.len();
    if number <= MOST_FORMULAS {
        return Ok(());
    }
    Err(Failure::usage(format!(
        "{number} formulas are too many to tell apart in one plot; a report takes at most {MOST_FORMULAS} --where"
    )))
}

/// Finds the occurrences of all formulas in all runs.
///
/// # Errors
/// If a formula is invalid in any run, or a run cannot be searched.
pub(super) fn find(runs: &[Run], formulas: &[String]) -> Result<Vec<Found>, Failure> {
    let refusal = |formula: &String, run: &Run, error: String| {
        let of = match runs.len() {
            1 => String::new(),
            _ => format!(" of {}", run.label),
        };
        Failure::usage(format!("--where `{formula}`{of}: {error}"))
    };
    let Some(first) = formulas.first() else {
        return Ok(Vec::new());
    };
    let prepare = |run: &Run| {
        let search = Search::of(run)?;
        let spans = SpanReader::of(&run.outcome.reader).map_err(|error| error.to_string())?;
        Ok((search, spans, run.last))
    };
    let prepared: Result<Vec<_>, Failure> = (runs.iter())
        .map(|run| prepare(run).map_err(|error| refusal(first, run, error)))
        .collect();
    let prepared = prepared?;
    let pairs: Vec<_> = (formulas.iter())
        .flat_map(|formula| prepared.iter().map(move |one| (formula, one)))
        .collect();
    let results = side_by_side(&pairs, |(formula, (search, spans, last))| {
        Ok(search.occurrences(formula, spans, *last))
    })?;
    let of_runs = formulas
        .iter()
        .flat_map(|formula| runs.iter().map(move |run| (formula, run)));
    let all: Result<Vec<Occurrences>, Failure> = (results.into_iter().zip(of_runs))
        .map(|(result, (formula, run))| result.map_err(|error| refusal(formula, run, error)))
        .collect();
    let mut all = all?.into_iter();
    let of_formula = |formula: &String| Found {
        formula: formula.clone(),
        runs: all.by_ref().take(runs.len()).collect(),
    };
    Ok(formulas.iter().map(of_formula).collect())
}

impl Found {
    /// Returns the intervals for the script.
    pub(super) fn data(&self, runs: &[Run]) -> FoundData {
        let of_run = |(one, run): (&Occurrences, &Run)| {
            let intervals = one.intervals.iter();
            intervals.map(|ends| span_s(ends, run.rate)).collect()
        };
        FoundData {
            formula: self.formula.clone(),
            runs: self.runs.iter().zip(runs).map(of_run).collect(),
            count: self.runs.iter().map(|one| one.count).sum(),
        }
    }
}

/// Returns the first time of an interval and the end of its last step, in s.
fn span_s([first, last]: &[u64; 2], rate: Rate) -> [f64; 2] {
    [*first, *last + 1].map(|step| rate.seconds(Step(step)))
}

/// Renders the intervals of all formulas, each a button that zooms to it; nothing without a formula.
pub(super) fn section(found: &[Found], runs: &[Run]) -> Markup {
    html! {
        @if !found.is_empty() { section #where {
            h2 { "Where" }
            @for one in found {
                h3 { code { (one.formula) } }
                @for (number, (occurrences, run)) in one.runs.iter().zip(runs).enumerate() {
                    p { @if runs.len() > 1 { (swatch(number)) (run.label) ": " } (summary(occurrences)) }
                    @if !occurrences.intervals.is_empty() {
                        ol.intervals { @for ends in &occurrences.intervals { (interval(ends, run.rate)) } }
                    }
                }
            }
        } }
    }
}

fn interval(ends: &[u64; 2], rate: Rate) -> Markup {
    let [first, last] = *ends;
    let [from_s, until_s] = span_s(ends, rate);
    let last_s = rate.seconds(Step(last));
    let steps = last - first + 1;
    html! {
        li {
            button type="button" data-from=(from_s) data-until=(until_s) {
                (seconds(from_s)) " s" @if steps > 1 { " to " (seconds(last_s)) " s" }
            }
            " " span.hint { (counted(steps, "step")) }
        }
    }
}

fn summary(one: &Occurrences) -> String {
    let (count, judged) = (one.count, one.judged);
    if count == 0 {
        return format!("nowhere in {judged} steps");
    }
    let share = short(100.0 * one.steps as f64 / judged as f64);
    let listed = one.intervals.len();
    let rest = match listed as u64 == count {
        true => String::new(),
        false => format!("; the first {listed} are listed"),
    };
    format!(
        "{}, {share} % of {judged} steps{rest}",
        counted(count, "interval")
    )
}
