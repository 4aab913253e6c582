//! Plots that are drawn live: those that every view of the run has, or those of patterns as `hil export`
//! takes them, with the places of their signals.

use glob::Pattern;
use hil_config::plan::Plan;
use hil_console::terminal::exit::Failure;
use serde::Serialize;

use crate::plots::bounds::Bound;
use crate::plots::signal::{labels, recorded_name};
use crate::plots::{self, Choice, Limit, Subject, by_unit, choose};
use hil_recording::reader::Column;
use shared_types::table::near;

/// Most signals that are kept at all: each costs time at every record.
const MOST: usize = 32;

/// Signals that are drawn over each other.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plot {
    /// Heading.
    pub title: String,
    /// Unit of the signals.
    pub unit: String,
    /// Label of each signal; empty if the heading says it.
    pub labels: Vec<String>,
    /// Places of the signals among the columns.
    pub signals: Vec<usize>,
    /// Logarithmic vertical axis, for magnitudes.
    pub log: bool,
    /// Level lines.
    pub lines: Vec<f64>,
    /// Levels of requirements.
    pub limits: Vec<Limit>,
}

impl Plot {
    /// A plot of these columns, by their recorded names.
    fn of(columns: &[Column], plot: &plots::Plot) -> Self {
        let place = |name: &String| columns.iter().position(|one| one.name == *name);
        Self {
            title: plot.title.clone(),
            unit: plot.unit.clone(),
            labels: labels(plot),
            signals: plot.signals.iter().filter_map(place).collect(),
            log: plot.log,
            lines: plot.lines.clone(),
            limits: plot.limits.clone(),
        }
    }
}

/// The plots of some patterns, one after the other; without any the first ones of the run, whose
/// requirements have these bounds.
///
/// # Errors
/// If a pattern is none, no signal matches it, or too many do.
pub(crate) fn chosen(
    columns: &[Column],
    plan: &Plan,
    bounds: Vec<Bound>,
    patterns: &[String],
) -> Result<Vec<Plot>, Failure> {
    let recorded = columns.iter().map(|one| Column {
        name: recorded_name(&one.name),
        unit: one.unit.clone(),
    });
    let recorded: Vec<Column> = recorded.collect();
    let mut plots = Vec::new();
    for text in patterns {
        let pattern = Pattern::new(text)
            .map_err(|error| Failure::usage(format!("--signal `{text}`: {error}")))?;
        let both = columns.iter().zip(&recorded);
        let matching = both.filter(|(one, recorded)| {
            pattern.matches(&one.name) || pattern.matches(&recorded.name)
        });
        let matching: Vec<Column> = matching.map(|(_, recorded)| recorded.clone()).collect();
        if matching.is_empty() {
            let near = near(text, columns.iter().map(|one| one.name.as_str()));
            return Err(Failure::usage(format!(
                "the session has no signal `{text}`{near}"
            )));
        }
        plots.extend(by_unit(&matching));
    }
    if patterns.is_empty() {
        let subject = Subject {
            bounds,
            ..Subject::of(plan)
        };
        plots = choose(&Choice {
            columns: &recorded,
            subjects: &[subject],
            asked: &[],
            values: None,
        });
    }
    let mut plots: Vec<Plot> = plots.iter().map(|plot| Plot::of(&recorded, plot)).collect();
    let mut kept: Vec<usize> = Vec::new();
    let mut fits = |plot: &Plot| {
        kept.extend(&plot.signals);
        kept.sort_unstable();
        kept.dedup();
        kept.len() <= MOST
    };
    let fitting = plots.iter().take_while(|plot| fits(plot)).count();
    if fitting < plots.len() && !patterns.is_empty() {
        let mut all: Vec<usize> = plots.into_iter().flat_map(|plot| plot.signals).collect();
        all.sort_unstable();
        all.dedup();
        let number = all.len();
        return Err(Failure::usage(format!(
            "{number} signals match --signal; {MOST} can be watched at a time"
        )));
    }
    plots.truncate(fitting);
    Ok(plots)
}

/// Lists the columns that names and patterns of the panel's readings mean; a pattern may mean none.
///
/// # Errors
/// If one is no pattern, or they mean too many.
pub(crate) fn readings(columns: &[Column], patterns: &[String]) -> Result<Vec<usize>, Failure> {
    let mut found = Vec::new();
    for text in patterns {
        let pattern = Pattern::new(text)
            .map_err(|error| Failure::usage(format!("panel.readings `{text}`: {error}")))?;
        let matches = |column: &Column| {
            pattern.matches(&column.name) || pattern.matches(&recorded_name(&column.name))
        };
        found.extend(
            (0..columns.len())
                .filter(|place| matches(&columns[*place]) && !found.contains(place))
                .collect::<Vec<_>>(),
        );
    }
    match found.len() {
        ..=MOST => Ok(found),
        number => Err(Failure::usage(format!(
            "{number} signals match panel.readings; {MOST} can be watched at a time"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::monitor::model::tests::plan;

    fn columns() -> Vec<Column> {
        let column = |(name, unit): (&str, &str)| Column {
            name: name.into(),
            unit: unit.into(),
        };
        let columns = [
            ("truth.position_m", "m"),
            ("truth.velocity_mps", "m/s"),
            ("measured.position_m", "m"),
            ("reference.position_m", "m"),
            ("parameter.actuator1.leak", "1"),
            ("error_m", "m"),
        ];
        columns.map(column).into()
    }

    fn of(columns: &[Column], patterns: &[&str]) -> Result<Vec<Plot>, Failure> {
        let patterns: Vec<String> = patterns.iter().map(|&text| text.into()).collect();
        chosen(columns, &plan(), Vec::new(), &patterns)
    }

    #[test]
    fn a_pattern_chooses_as_for_an_export_and_units_are_not_mixed() {
        let plots = of(&columns(), &["*position_m", "truth.*"]).expect("some");
        let shown = plots
            .iter()
            .map(|plot| (plot.title.as_str(), plot.labels.join(",")));
        let shown: Vec<_> = shown.collect();
        assert_eq!(
            shown,
            [
                ("position_m", "truth,measured,reference".to_owned()),
                ("truth.position_m", String::new()),
                ("truth.velocity_mps", String::new()),
            ]
        );
        for name in ["parameter.actuator1.leak", "parameter.actuator1_leak"] {
            assert_eq!(of(&columns(), &[name]).expect("one").len(), 1, "{name}");
        }
        let unknown = of(&columns(), &["eror_m"])
            .expect_err("no such signal")
            .to_string();
        assert!(unknown.contains("nearest: `error_m`"), "{unknown}");
    }

    #[test]
    fn readings_stand_in_the_order_in_which_they_are_named() {
        let of = |texts: &[&str]| {
            let texts: Vec<String> = texts.iter().map(|&text| text.into()).collect();
            readings(&columns(), &texts)
        };
        let found = of(&["error_m", "*.position_m", "internal.*", "error_m"]).expect("right");
        assert_eq!(found, [5, 0, 2, 3]);
        let wrong = of(&["truth.[x"]).expect_err("no pattern").to_string();
        assert!(wrong.contains("panel.readings `truth.[x`"), "{wrong}");
    }

    #[test]
    fn more_signals_than_can_be_watched_are_refused_or_by_default_left_out() {
        let many = (0..40).map(|number| Column {
            name: format!("truth.x{number}_m"),
            unit: "m".into(),
        });
        let many: Vec<Column> = many.collect();
        let refused = of(&many, &["*"]).expect_err("too many");
        assert!(refused.to_string().contains("40 signals"), "{refused}");
        let kept = of(&many, &[]).expect("the first ones");
        assert_eq!(
            kept.iter().map(|plot| plot.signals.len()).sum::<usize>(),
            32
        );
    }
}
