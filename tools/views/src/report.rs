//! `hil report`: one HTML file that shows recorded runs, for reading and as evidence.
//!
//! 1. Each `Run` is read for its results: verdict, requirements, faults, latency.
//! 2. A `Grid` of simulated time is derived from the results, finer around events.
//! 3. Each run is read again, its signals as envelopes over that grid.
//!    Behind them may be the band of a baseline, a `Background`.
//! 4. `plots` selects the plots, and `page` writes them.
//!
//! The page loads nothing: its script is vendored, its policy forbids connections, and all text from a recording is
//! escaped. Nothing is judged here: requirements are evaluated by the same code as in the run.

mod background;
mod data;
pub(crate) mod envelope;
mod first;
mod found;
pub(crate) mod grid;
mod label;
pub(crate) mod occurrences;
pub(crate) mod page;
pub(crate) mod plots;
pub(crate) mod reading;
pub(crate) mod rows;
pub(crate) mod run;
mod tables;

use std::path::Path;
use std::thread;
use std::time::Duration;

use glob::Pattern;
use hil_console::files::destination::{Destination, deliver};
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use serde::Serialize;
use shared_types::table::near;

use crate::arguments::report::ReportArguments;
use crate::figures;
use crate::plots::bounds::bounds;
use crate::plots::signal::own_names;
use background::Background;
use grid::Grid;
use plots::plots;
use reading::Signals;
use run::Run;

/// Polling interval for a signal.
const LOOK: Duration = Duration::from_millis(5);
/// Maximum number of runs in a report: more colours cannot be told apart.
const MOST_RUNS: usize = 8;

/// Summary of the written page.
#[derive(Debug, Serialize)]
struct Written {
    file: String,
    runs: Vec<String>,
    plots: usize,
    signals: usize,
    bytes: usize,
}

/// Runs the command.
///
/// # Errors
/// If a run cannot be read or lacks a requested signal, or the file cannot be written. If a run is damaged, the error
/// comes after the page has been written with all readable data.
pub fn report(arguments: &ReportArguments) -> Result<Exit, Failure> {
    if let Some(folder) = &arguments.figures {
        return figures::write(arguments, folder);
    }
    let path = Some(arguments.output.as_path()).filter(|path| *path != Path::new("-"));
    if arguments.json && path.is_none() {
        return Err(Failure::usage(
            "--json and the report would both go to standard output; name a file with -o",
        ));
    }
    let interruption = Interruption::listen()?;
    // Checked early: an unwritable file should fail before the work.
    let destination = Destination::open(path, arguments.force)?;
    let (text, mut written, damage) = made_unless(&interruption, arguments)?;
    deliver(&text, destination, path)?;
    written.file = arguments.output.display().to_string();
    if arguments.json {
        output::write(&output::pretty(&written)?)?;
    } else if path.is_some() {
        let Written {
            file,
            plots,
            signals,
            bytes,
            ..
        } = &written;
        let size = *bytes as f64 / 1e6;
        output::write(&format!(
            "{file}: {plots} plots, {signals} signals to choose from, {size:.1} MB\n"
        ))?;
    }
    // The page exists and shows everything that could be read of the run.
    damage.map_or(Ok(Exit::Pass), Err)
}

/// Returns the page and its summary, unless a signal arrives: then temporary files are removed at once, while the work
/// continues until the process ends.
fn made_unless(
    interruption: &Interruption,
    arguments: &ReportArguments,
) -> Result<(String, Written, Option<Failure>), Failure> {
    let arguments = arguments.clone();
    let work = thread::spawn(move || made(&arguments));
    while !work.is_finished() {
        interruption.check()?;
        thread::sleep(LOOK);
    }
    match work.join() {
        Ok(result) => result,
        Err(panic) => std::panic::resume_unwind(panic),
    }
}

/// Returns the page, its summary, and the damage of its runs.
fn made(arguments: &ReportArguments) -> Result<(String, Written, Option<Failure>), Failure> {
    let number = arguments.runs.len();
    if number > MOST_RUNS {
        return Err(Failure::usage(format!(
            "{number} runs are too many to tell apart in one plot; a report shows at most {MOST_RUNS}"
        )));
    }
    // Checked before anything is read.
    patterns(&arguments.signal)?;
    found::refuse_many(&arguments.formulas)?;
    let by = arguments.scenario.as_deref();
    let mut runs = side_by_side(&arguments.runs, |path| Run::of(path, by))?;
    label::label(&mut runs);
    let searches = found::find(&runs, &arguments.formulas)?;
    let (mut all_bounds, mut extra) = (Vec::new(), Vec::new());
    for run in &runs {
        let compared = run.plan().map(|plan| bounds(plan, run.end_s()));
        let (bounds, computed) = compared.unwrap_or_default();
        all_bounds.push(bounds);
        extra.push(computed);
    }
    let background = Background::open(&arguments.behind, &runs)?;
    let behind = background.as_ref().and_then(|one| one.run.as_ref());
    let grid = grid(&runs.iter().chain(behind).collect::<Vec<_>>());
    let readings = (runs.iter().zip(&extra)).map(|(run, extra)| run.reading(extra));
    let readings: Vec<_> = readings.chain(behind.map(|run| run.reading(&[]))).collect();
    let mut signals = side_by_side(&readings, |reading| {
        reading.signals(&grid).map_err(Failure::usage)
    })?;
    let course = signals.split_off(runs.len()).pop();
    let names = signals.iter().flat_map(Signals::iter);
    let names: Vec<&str> = names.map(|(name, ..)| name).collect();
    let aliases: Vec<_> = runs.iter().flat_map(Run::aliases).collect();
    let patterns = patterns(&own_names(
        &arguments.signal,
        names.iter().copied(),
        &aliases,
    ))?;
    refuse_unknown(&patterns, &signals)?;
    let plots = plots(&runs, &signals, all_bounds, &grid, &patterns);
    let band = background.as_ref();
    let band = band.map(|one| one.data(&signals, course.as_ref(), &plots));
    let data = data::Data::new(&runs, &signals, &grid, &plots, &searches, band);
    let written = Written {
        file: String::new(),
        runs: runs
            .iter()
            .map(|run| run.path.display().to_string())
            .collect(),
        plots: plots.len(),
        signals: data.signals(),
        bytes: 0,
    };
    let figures = figures::for_page(arguments)?;
    let text = page::page(&runs, &plots, &searches, &figures::markup(&figures), &data)?;
    let bytes = text.len();
    let read = runs.iter().filter(|run| run.outcome.damage.is_none());
    let caveats = read.filter_map(|run| run.outcome.reader.caveat());
    caveats.for_each(|caveat| tell!("note: {caveat}"));
    let damages = runs.iter().filter_map(|run| run.outcome.damage.as_ref());
    let damages: Vec<String> = damages.map(ToString::to_string).collect();
    let damage = (!damages.is_empty()).then(|| Failure::usage(damages.join("\nerror: ")));
    Ok((text, Written { bytes, ..written }, damage))
}

pub(crate) fn patterns(texts: &[String]) -> Result<Vec<Pattern>, Failure> {
    let pattern = |text: &String| {
        Pattern::new(text).map_err(|error| Failure::usage(format!("--signal `{text}`: {error}")))
    };
    texts.iter().map(pattern).collect()
}

/// Returns the grid that suits all runs: as long as the longest run, at the highest rate, and fine near the events of
/// any run.
fn grid(runs: &[&Run]) -> Grid {
    let by_rate = |a: &&&Run, b: &&&Run| a.rate.hz().total_cmp(&b.rate.hz());
    let by_end = |a: &&&Run, b: &&&Run| a.end_s().total_cmp(&b.end_s());
    let fastest = runs.iter().max_by(by_rate).expect("at least one run");
    let longest = runs.iter().max_by(by_end).expect("at least one run");
    // Takes the most interesting time of each run before the second of any.
    let mut lists: Vec<_> = runs.iter().map(|run| run.times_ns().into_iter()).collect();
    let mut times_ns = Vec::new();
    loop {
        let round: Vec<u64> = lists.iter_mut().filter_map(Iterator::next).collect();
        if round.is_empty() {
            break;
        }
        times_ns.extend(round);
    }
    let last = fastest.rate.step_at_or_after(longest.end_s());
    Grid::new(fastest.rate, last, &times_ns)
}

/// Refuses patterns that match no signal of any run.
pub(crate) fn refuse_unknown(patterns: &[Pattern], signals: &[Signals]) -> Result<(), Failure> {
    let names = || {
        signals
            .iter()
            .flat_map(Signals::iter)
            .map(|(name, ..)| name)
    };
    for pattern in patterns {
        if !names().any(|name| pattern.matches(name)) {
            let near = near(pattern.as_str(), names());
            return Err(Failure::usage(format!(
                "no run has a signal `{pattern}`{near}\n  `hil export RUN --list` shows all"
            )));
        }
    }
    Ok(())
}

/// Applies a function to all elements in parallel; returns the first failure.
fn side_by_side<T: Sync, U: Send>(
    items: &[T],
    work: impl Fn(&T) -> Result<U, Failure> + Sync,
) -> Result<Vec<U>, Failure> {
    thread::scope(|scope| {
        let threads: Vec<_> = (items.iter())
            .map(|item| scope.spawn(|| work(item)))
            .collect();
        let results = threads.into_iter().map(|thread| match thread.join() {
            Ok(result) => result,
            Err(panic) => std::panic::resume_unwind(panic),
        });
        results.collect()
    })
}
