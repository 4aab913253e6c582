//! Changes of a run relative to a baseline: identifying texts and figures.
//!
//! A judgement checks the changes against the tolerances; an update shows the changes that it will write.

use std::fmt::Write as _;

use hil_console::terminal::table::{Table, left, right};
use serde::Serialize;
use shared_types::number::{exact, unit_shown};

use super::figures::{Figures, STATISTICS};
use super::file::Baseline;
use crate::compare::{is_near, share};

/// Identifying text that differs between baseline and run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct TextChange {
    what: &'static str,
    baseline: String,
    run: String,
}

/// Figure that differs between baseline and run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Change {
    pub(super) name: String,
    unit: String,
    /// Value in the baseline; null if only the run has the figure.
    baseline: Option<f64>,
    /// Value in the run; null if only the baseline has the figure.
    run: Option<f64>,
    tolerance: f64,
    pub(super) within: bool,
}

/// Returns the identifying texts that differ.
pub(super) fn identity_changes(baseline: &Baseline, figures: &Figures) -> Vec<TextChange> {
    let number = |value: &dyn std::fmt::Display| value.to_string();
    let pairs = [
        (
            "scenario",
            baseline.scenario.clone(),
            figures.scenario.clone(),
        ),
        ("digest", baseline.digest.clone(), figures.digest.clone()),
        (
            "records",
            number(&baseline.records),
            number(&figures.records),
        ),
        (
            "rate_hz",
            number(&baseline.rate_hz),
            number(&figures.rate_hz),
        ),
        (
            "scenario_blake3",
            baseline.scenario_blake3.clone(),
            figures.scenario_blake3.clone(),
        ),
        (
            "hil_version",
            baseline.hil_version.clone(),
            figures.hil_version.clone(),
        ),
        (
            "plant_blake3",
            baseline.plant_blake3.clone(),
            figures.plant_blake3.clone(),
        ),
        (
            "controller_blake3",
            baseline.controller_blake3.clone(),
            figures.controller_blake3.clone(),
        ),
    ];
    let differing = pairs
        .into_iter()
        .filter(|(_, baseline, run)| baseline != run);
    differing
        .map(|(what, baseline, run)| TextChange {
            what,
            baseline,
            run,
        })
        .collect()
}

/// Returns a figure if it differs.
fn change(
    name: String,
    unit: &str,
    (baseline, run): (Option<f64>, Option<f64>),
    tolerance: f64,
) -> Option<Change> {
    let (is_same, within) = match (baseline, run) {
        (Some(baseline), Some(run)) => {
            let is_same =
                baseline.to_bits() == run.to_bits() || (baseline.is_nan() && run.is_nan());
            (is_same, is_same || is_near(baseline, run, tolerance))
        }
        _ => (false, false),
    };
    (!is_same).then(|| Change {
        name,
        unit: unit.into(),
        baseline,
        run,
        tolerance,
        within,
    })
}

pub(super) fn metric_changes(baseline: &Baseline, figures: &Figures) -> Vec<Change> {
    let mut changes = Vec::new();
    for metric in &figures.metrics {
        let before = baseline.metrics.get(&metric.name);
        let same_unit = before.filter(|before| before.unit == metric.unit);
        let values = (same_unit.map(|before| before.value), Some(metric.value));
        let tolerance = before.map_or(0.0, |before| before.tolerance);
        changes.extend(change(metric.name.clone(), &metric.unit, values, tolerance));
    }
    for (name, before) in &baseline.metrics {
        if figures.metrics.iter().all(|metric| metric.name != *name) {
            let values = (Some(before.value), None);
            changes.extend(change(name.clone(), &before.unit, values, before.tolerance));
        }
    }
    changes
}

pub(super) fn signal_changes(baseline: &Baseline, figures: &Figures) -> Vec<Change> {
    let mut changes = Vec::new();
    for signal in &figures.signals {
        let before = baseline.signals.get(&signal.name);
        let tolerance = before.map_or(0.0, |before| before.tolerance);
        let same_unit = before.filter(|before| before.unit == signal.unit);
        for (place, statistic) in STATISTICS.into_iter().enumerate() {
            let before = same_unit.map(|before| before.values()[place]);
            let name = format!("{} {statistic}", signal.name);
            let values = (before, Some(signal.values[place]));
            changes.extend(change(name, &signal.unit, values, tolerance));
        }
    }
    for (name, before) in &baseline.signals {
        if figures.signals.iter().all(|signal| signal.name != *name) {
            for (statistic, value) in STATISTICS.into_iter().zip(before.values()) {
                let name = format!("{name} {statistic}");
                let values = (Some(value), None);
                changes.extend(change(name, &before.unit, values, before.tolerance));
            }
        }
    }
    changes
}

pub(super) fn write_identity(text: &mut String, changes: &[TextChange]) -> std::fmt::Result {
    for TextChange {
        what,
        baseline,
        run,
    } in changes
    {
        let baseline = if baseline.is_empty() { "-" } else { baseline };
        writeln!(text, "  {what}: {baseline} -> {run}")?;
    }
    Ok(())
}

pub(super) fn write_changes(text: &mut String, changes: &[Change]) -> std::fmt::Result {
    if changes.is_empty() {
        return Ok(());
    }
    let close = left(0).close();
    let columns = [
        left(0),
        right(24),
        close,
        right(24).close(),
        right(0),
        close,
    ];
    let mut table = Table::new(2, columns);
    table.row(&[&"figure", &"baseline", &"  ", &"run", &"of tolerance"]);
    for change in changes {
        let value = |value: Option<f64>| value.map_or_else(|| "-".into(), exact);
        let (baseline, run) = (value(change.baseline), value(change.run));
        let difference = change.baseline.zip(change.run).map(|(a, b)| (a - b).abs());
        let share = difference.map_or_else(|| "-".into(), |size| share(size, change.tolerance));
        let unit = unit_shown(&change.unit);
        table.row(&[&change.name, &baseline, &"->", &run, &share, &unit]);
    }
    write!(text, "\n{table}")
}
