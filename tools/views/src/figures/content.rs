//! Content of figures: the chart of each plot, from the runs that were read for it.
//!
//! Plots of several runs with the same title share a chart. Never reads a file.

mod frequency;

use hil_config::Response;
use hil_config::plan::{Plot, PlotKind, Scale};
use shared_types::extremes::{larger, smaller};

use super::axis::Quantity;
use super::chart::{Chart, Curve, Level, MOST_CURVES, Panel};
use super::reading::{Read, RunData, Values};
use super::table::Table;
use super::wording::{labels, title};
use crate::plots::signal::Signal;
use crate::plots::{self, Subject};

/// Open loops, each with its name.
pub(super) type Loops = [(String, Vec<Response>)];

/// Figure of a plot.
pub(super) struct Figure {
    pub(super) plot: Plot,
    /// Chart and the table of its values, or the reason why there is none.
    pub(super) chart: Result<(Chart, Table), String>,
}

/// Plot of one run.
struct Part<'a> {
    /// Label of the run; empty if it is the only one.
    label: &'a str,
    run: &'a RunData,
    reads: &'a [Read],
}

/// Returns the figures of some runs, in the order of their plots; only those for a law of a run.
pub(super) fn figures(runs: &[RunData], loops: Option<&Loops>) -> Vec<Figure> {
    let run_labels = run_labels(runs);
    let mut plots: Vec<(&Plot, Vec<Part<'_>>)> = Vec::new();
    for (run, label) in runs.iter().zip(&run_labels) {
        for (plot, reads) in &run.plots {
            if !run.laws.iter().any(|law| plot.is_for(law)) {
                continue;
            }
            let part = Part { label, run, reads };
            let is_same = |other: &Plot| other.title == plot.title && other.kind == plot.kind;
            match plots.iter_mut().find(|(other, _)| is_same(other)) {
                Some((_, parts)) => parts.push(part),
                None => plots.push((plot, vec![part])),
            }
        }
    }
    let figures = plots.into_iter().map(|(plot, parts)| Figure {
        chart: chart(plot, &parts, loops).and_then(checked),
        plot: plot.clone(),
    });
    figures.collect()
}

/// Refuses charts whose curves cannot be told apart.
fn checked((chart, table): (Chart, Table)) -> Result<(Chart, Table), String> {
    let curves = chart.panels.iter().map(|panel| panel.curves.len()).max();
    match curves.unwrap_or(0) {
        0 => Err("it has no values".into()),
        curves if curves > MOST_CURVES => Err(format!(
            "{curves} curves are too many to tell apart; a figure shows at most {MOST_CURVES}"
        )),
        _ => Ok((chart, table)),
    }
}

/// Returns a label for each of several runs: laws if they differ, else names of folders.
fn run_labels(runs: &[RunData]) -> Vec<String> {
    if runs.len() < 2 {
        return vec![String::new(); runs.len()];
    }
    let laws: Vec<String> = runs.iter().map(|run| run.laws.join(", ")).collect();
    let are_distinct = (laws.iter()).all(|law| laws.iter().filter(|one| *one == law).count() == 1);
    if are_distinct {
        return laws;
    }
    let name = |run: &RunData| {
        let folder = if run.path.is_file() {
            run.path.parent()
        } else {
            Some(&*run.path)
        };
        let name = folder.and_then(std::path::Path::file_name);
        name.map_or_else(
            || run.path.display().to_string(),
            |name| name.to_string_lossy().into(),
        )
    };
    runs.iter().map(name).collect()
}

fn chart(plot: &Plot, parts: &[Part<'_>], loops: Option<&Loops>) -> Result<(Chart, Table), String> {
    let missing = parts.iter().flat_map(|part| part.reads);
    let mut missing: Vec<&str> = missing
        .filter(|read| read.is_missing())
        .map(|read| read.name.as_str())
        .collect();
    missing.dedup();
    if !missing.is_empty() {
        let were = if missing.len() == 1 { "was" } else { "were" };
        return Err(format!("{} {were} not recorded", missing.join(", ")));
    }
    let mut chart = match &plot.kind {
        PlotKind::Time => time(plot, parts),
        PlotKind::Xy { x } => xy(x, plot, parts),
        PlotKind::Spectrum(settings) => frequency::spectra(settings, plot, parts),
        PlotKind::Bode { metric } => {
            frequency::responses(metric.as_deref(), parts, loops).map(|all| frequency::bode(&all))
        }
        PlotKind::Nichols { metric } => frequency::responses(metric.as_deref(), parts, loops)
            .map(|all| frequency::nichols(&all, metric.is_none())),
    }?;
    chart.0.title = plot.title.clone();
    Ok(chart)
}

fn signals<'a>(part: &Part<'a>, reads: &'a [Read]) -> Vec<Signal<'a>> {
    let signal = |read: &'a Read| {
        let unit = part.run.units.get(&read.name).map_or("", String::as_str);
        Signal::of_name(&read.name, unit)
    };
    reads.iter().map(signal).collect()
}

/// Returns the quantity that all signals of a part share.
fn quantity(part: &Part<'_>, reads: &[Read], is_log: bool) -> Quantity {
    let signals = signals(part, reads);
    Quantity {
        title: title(&signals, &part.run.descriptions),
        unit: signals
            .first()
            .map_or_else(String::new, |one| one.unit.to_owned()),
        is_log,
    }
}

/// Returns a label of each signal of a run, among those of several.
fn curve_labels(part: &Part<'_>, reads: &[Read]) -> Vec<String> {
    let labels = labels(&signals(part, reads)).into_iter();
    let full = labels.map(|label| match (label.as_str(), part.label) {
        (label, "") | ("", label) => label.to_owned(),
        (label, run) => format!("{label}, {run}"),
    });
    full.collect()
}

fn time(plot: &Plot, parts: &[Part<'_>]) -> Result<(Chart, Table), String> {
    let first = &parts[0];
    let mut quantity = quantity(first, first.reads, plot.scale == Scale::Log);
    let mut curves = Vec::new();
    for part in parts {
        for (read, label) in part.reads.iter().zip(curve_labels(part, part.reads)) {
            if let Values::Course(course) = &read.values {
                curves.push(Curve {
                    label,
                    parts: course.parts(),
                    is_free: false,
                });
            }
        }
    }
    let points = || curves.iter().flat_map(|curve| curve.parts.iter().flatten());
    if points().next().is_none() {
        return Err("its signals have no values in the time shown".into());
    }
    if quantity.is_log && points().any(|[_, value]| *value < 0.0) {
        quantity.title = format!("|{}|", quantity.title);
    }
    let end_s = parts.iter().map(|part| part.run.end_s).fold(0.0, larger);
    let span = [
        plot.span_s[0].unwrap_or(0.0),
        plot.span_s[1].unwrap_or(end_s),
    ];
    let mut levels: Vec<Level> = Vec::new();
    for part in parts {
        let mut limited = plots::Plot {
            signals: part.reads.iter().map(|read| read.name.clone()).collect(),
            ..plots::Plot::default()
        };
        let subject = Subject {
            bounds: part.run.bounds.clone(),
            ..Subject::default()
        };
        plots::limit(&mut limited, &[subject]);
        for limit in limited.limits {
            let level = Level {
                value: limit.level,
                span: [limit.from_s, limit.until_s],
                requirement: Some(limit.requirement),
            };
            let is_inside = level.span[0] <= span[1] && level.span[1] >= span[0];
            if is_inside && !levels.contains(&level) {
                levels.push(level);
            }
        }
    }
    levels.extend(plot.lines.iter().map(|value| Level {
        value: *value,
        span,
        requirement: None,
    }));
    let mut table = Table::new(&["curve", "least", "greatest", "last"], &quantity.unit);
    for curve in &curves {
        let values = || curve.parts.iter().flatten().map(|[_, value]| *value);
        let least = values().fold(f64::INFINITY, smaller);
        let greatest = values().fold(f64::NEG_INFINITY, larger);
        let last = values().next_back().unwrap_or(f64::NAN);
        let name = if curve.label.is_empty() {
            &quantity.title
        } else {
            &curve.label
        };
        table.row(name, &[least, greatest, last]);
    }
    let chart = Chart {
        x: time_quantity(),
        span: Some(span),
        marks: marks(parts, span),
        panels: vec![Panel {
            y: quantity,
            curves,
            levels,
            ..Panel::default()
        }],
        ..Chart::default()
    };
    Ok((chart, table))
}

fn time_quantity() -> Quantity {
    Quantity {
        title: "Time".into(),
        unit: "s".into(),
        is_log: false,
    }
}

/// Returns the beginnings of faults in the time shown; one that several runs share has one mark.
fn marks(parts: &[Part<'_>], [from_s, until_s]: [f64; 2]) -> Vec<(f64, String)> {
    let mut marks: Vec<(f64, String)> = Vec::new();
    let faults = parts.iter().flat_map(|part| &part.run.faults);
    for (at_s, kind) in faults.filter(|(at_s, _)| (from_s..=until_s).contains(at_s)) {
        let mark = (*at_s, kind.clone());
        if !marks.contains(&mark) {
            marks.push(mark);
        }
    }
    marks
}

fn xy(x: &str, plot: &Plot, parts: &[Part<'_>]) -> Result<(Chart, Table), String> {
    let first = &parts[0];
    let (x_read, y_reads) = first.reads.split_at(1);
    let quantities = [x_read, y_reads].map(|reads| quantity(first, reads, false));
    let [x_quantity, y_quantity] = quantities;
    let mut table = Table::new(&["curve", "least", "greatest"], &y_quantity.unit);
    let mut curves = Vec::new();
    for part in parts {
        let [over, reads @ ..] = part.reads else {
            continue;
        };
        let Values::All(over) = &over.values else {
            continue;
        };
        for (read, label) in reads.iter().zip(curve_labels(part, reads)) {
            let Values::All(values) = &read.values else {
                continue;
            };
            let pairs = over.iter().zip(values).map(|(x, y)| [*x, *y]);
            let points: Vec<[f64; 2]> = pairs.collect();
            let runs = points.split(|point| point.iter().any(|one| !one.is_finite()));
            let runs: Vec<Vec<[f64; 2]>> = runs
                .filter(|run| !run.is_empty())
                .map(<[[f64; 2]]>::to_vec)
                .collect();
            let finite = || runs.iter().flatten().map(|[_, y]| *y);
            let name = if label.is_empty() {
                &plot.title
            } else {
                &label
            };
            let least = finite().fold(f64::INFINITY, smaller);
            table.row(name, &[least, finite().fold(f64::NEG_INFINITY, larger)]);
            curves.push(Curve {
                label,
                parts: runs,
                is_free: true,
            });
        }
    }
    if curves.iter().all(|curve| curve.parts.is_empty()) {
        return Err(format!(
            "its signals have no values over {x} in the time shown"
        ));
    }
    let chart = Chart {
        x: x_quantity,
        panels: vec![Panel {
            y: y_quantity,
            curves,
            ..Panel::default()
        }],
        ..Chart::default()
    };
    Ok((chart, table))
}
