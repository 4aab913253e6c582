//! Plots of a report: those that suit its runs, with the origins of requirement margins.

use glob::Pattern;
use serde::Serialize;

use super::grid::Grid;
use super::run::{Run, Signals};
use crate::plots::bounds::Bound;
use crate::plots::{self, Choice, Subject, Values};
use hil_recording::reader::Column;

/// Plot of a report.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Plot {
    #[serde(flatten)]
    pub(crate) chosen: plots::Plot,
    marks: Vec<Mark>,
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
        Plot {
            chosen: plot,
            marks,
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
        });
        let of_it: Vec<Mark> = of_it.collect();
        let is_known = of_it.iter().any(|mark| mark.decisive.is_some());
        let of_it = of_it.into_iter();
        marks.extend(of_it.filter(|mark| mark.decisive.is_some() == is_known));
    }
    marks
}
