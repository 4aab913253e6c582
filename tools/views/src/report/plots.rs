//! Plots of a report: those that suit its runs, with the origins of requirement margins.

use glob::Pattern;
use serde::Serialize;

use super::envelope::Envelope;
use super::grid::Grid;
use super::reading::Signals;
use super::run::Run;
use crate::plots::bounds::{Bound, Other};
use crate::plots::words::Words;
use crate::plots::{self, Choice, Subject, Values};
use crate::prefix::ShownUnit;
use hil_recording::reader::Column;
use shared_types::extremes::larger;

/// Plot of a report.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Plot {
    #[serde(flatten)]
    pub(crate) chosen: plots::Plot,
    marks: Vec<Mark>,
    /// Heading in words, without the unit.
    pub(crate) heading: String,
    /// Name of each signal in words.
    pub(crate) words: Vec<String>,
    /// Unit of the axis.
    pub(super) shown: ShownUnit,
}

impl Plot {
    /// Returns `true` if the plot shows where the margin of a requirement of a run comes from.
    pub(super) fn decides(&self, run: usize, requirement: &str) -> bool {
        self.marks_of(run, requirement).next().is_some()
    }

    /// Returns `true` if the plot shows times and ages of the loop rather than signals.
    pub(super) fn is_of_loop(&self) -> bool {
        self.chosen.section == "Loop"
    }

    fn marks_of(&self, run: usize, requirement: &str) -> impl Iterator<Item = &Mark> {
        let marks = self.marks.iter();
        marks.filter(move |mark| mark.run == run && mark.requirement == requirement)
    }
}

/// Origin of a requirement's margin.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Mark {
    run: usize,
    requirement: String,
    signal: String,
    at_s: f64,
    /// Values of the two sides; `None` if no single comparison decides the margin.
    decisive: Option<[f64; 2]>,
    holds: bool,
    /// Constant other than 0 with which the signal is compared.
    #[serde(skip)]
    level: Option<f64>,
}

/// Returns the magnitude of the constant whose comparison decides a requirement of a run; `None` if that constant is 0,
/// or if no single constant decides.
pub(super) fn limit(plots: &[Plot], run: usize, requirement: &str) -> Option<f64> {
    let marks = plots
        .iter()
        .flat_map(|plot| plot.marks_of(run, requirement));
    let mut levels = marks.map(|mark| mark.level.map(f64::abs));
    let first = levels.next()??;
    levels.all(|level| level == Some(first)).then_some(first)
}

/// Returns the plots of some runs, for the comparisons in their requirements and the signals requested by the user.
pub(crate) fn plots(
    runs: &[Run],
    signals: &[Signals],
    bounds: Vec<Vec<Bound>>,
    grid: &Grid,
    patterns: &[Pattern],
) -> Vec<Plot> {
    let mut columns: Vec<Column> = Vec::new();
    for (name, unit, _) in signals.iter().flat_map(Signals::iter) {
        if columns.iter().all(|one| one.name != name) {
            let (name, unit) = (name.to_owned(), unit.to_owned());
            columns.push(Column { name, unit });
        }
    }
    let subjects: Vec<Subject<'_>> = (runs.iter().zip(bounds))
        .map(|(run, bounds)| Subject {
            plan: run.plan(),
            laws: run.laws.names().collect(),
            bounds,
        })
        .collect();
    let selected = plots::choose(&Choice {
        columns: &columns,
        subjects: &subjects,
        patterns,
        values: Some(&signals),
    });
    let of_runs = (0..).zip(runs.iter().zip(signals)).zip(&subjects);
    let marks: Vec<Mark> = of_runs
        .flat_map(|((number, (run, signals)), subject)| {
            marks(number, run, signals, &subject.bounds, grid)
        })
        .collect();
    let marked = |plot: plots::Plot| {
        let marks_of_plot = marks
            .iter()
            .filter(|one| plot.signals.contains(&one.signal));
        let marks = marks_of_plot.cloned().collect();
        let words = Words::of(&plot, |name| {
            let mut readers = runs.iter().map(|run| &run.outcome.reader);
            readers.find_map(|reader| reader.description(name))
        });
        let envelopes = signals.iter().flat_map(|signals| {
            let of_plot = plot.signals.iter();
            of_plot.filter_map(|name| signals.get(name))
        });
        let largest = envelopes.map(Envelope::largest).fold(0.0, larger);
        let shown = ShownUnit::of(&plot.unit, if plot.log { 1.0 } else { largest });
        Plot {
            chosen: plot,
            marks,
            heading: words.heading,
            words: words.signals,
            shown,
        }
    };
    selected.into_iter().map(marked).collect()
}

impl Values for &[Signals] {
    fn differ(&self, a: &str, b: &str) -> bool {
        self.iter().any(|signals| {
            let pair = signals.get(a).zip(signals.get(b));
            pair.is_some_and(|(a, b)| !a.is_same(b))
        })
    }

    fn changes(&self, name: &str) -> bool {
        let mut envelopes = self.iter().filter_map(|signals| signals.get(name));
        envelopes.any(|one| one.constant().is_none())
    }
}

/// Returns the origins of a run's margins: the comparisons that decide them, or all comparisons of a requirement if
/// none of them decides alone.
fn marks(number: usize, run: &Run, signals: &Signals, bounds: &[Bound], grid: &Grid) -> Vec<Mark> {
    let mut marks = Vec::new();
    for judged in &run.requirements {
        let Some(at_s) = judged.at_s else {
            continue;
        };
        let step = run.rate.step_at_or_after(at_s);
        let bucket = grid.bucket(0, run.rate.nanoseconds(step));
        let values = |name: &str| match signals.get(name) {
            Some(envelope) => envelope.ends(bucket).collect(),
            None => Vec::new(),
        };
        // An edge depends on the previous step, and times are rounded.
        let period_s = run.rate.period_s();
        let counts = |bound: &&Bound| {
            let [from_s, until_s] = bound.window_s;
            let near_s = from_s - 1.5 * period_s..=until_s + 0.5 * period_s;
            bound.requirement == judged.name && near_s.contains(&at_s)
        };
        let of_it = bounds.iter().filter(counts).map(|bound| Mark {
            run: number,
            requirement: judged.name.clone(),
            signal: bound.side.signal.clone(),
            at_s,
            decisive: (judged.robustness).and_then(|margin| bound.decisive(margin, values)),
            holds: judged.verdict == "pass",
            level: match bound.other {
                Other::Level(level) => Some(level).filter(|level| *level != 0.0),
                Other::Signal(_) => None,
            },
        });
        let of_it: Vec<Mark> = of_it.collect();
        let is_known = of_it.iter().any(|mark| mark.decisive.is_some());
        let of_it = of_it.into_iter();
        marks.extend(of_it.filter(|mark| mark.decisive.is_some() == is_known));
    }
    marks
}
