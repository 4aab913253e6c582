//! Live plots: those common to every view of the run, or those selected by patterns as in `hil export`, with the
//! column indices of their signals.

use std::collections::BTreeMap;

use glob::Pattern;
use hil_config::plan::Plan;
use hil_console::terminal::exit::Failure;
use serde::Serialize;

use crate::plots::bounds::Bound;
use crate::plots::signal::{labels, recorded_name};
use crate::plots::words::Words;
use crate::plots::{self, Choice, Limit, Subject, by_unit, choose};
use hil_recording::reader::Column;
use shared_types::table::near;

/// Maximum number of retained signals: each costs time at every record.
const MOST: usize = 32;

/// Signals drawn in one plot.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Plot {
    /// Heading of the section in which a report has this plot.
    pub section: &'static str,
    /// Heading.
    pub title: String,
    /// Heading in words.
    pub heading: String,
    /// Each signal in words.
    pub words: Vec<String>,
    /// Unit of the signals.
    pub unit: String,
    /// Label of each signal; empty if the heading names it.
    pub labels: Vec<String>,
    /// Column indices of the signals.
    pub signals: Vec<usize>,
    /// `true` for a logarithmic vertical axis, used for magnitudes.
    pub log: bool,
    /// Level lines.
    pub lines: Vec<f64>,
    /// Limits set by requirements.
    pub limits: Vec<Limit>,
}

impl Plot {
    /// Creates a plot of these columns, matched by their recorded names, of which some have descriptions.
    fn of(columns: &[Column], plot: &plots::Plot, descriptions: &BTreeMap<String, String>) -> Self {
        let words = Words::of(plot, |name| descriptions.get(name).map(String::as_str));
        let place = |name: &String| columns.iter().position(|one| one.name == *name);
        Self {
            section: plot.section,
            title: plot.title.clone(),
            heading: words.heading,
            words: words.signals,
            unit: plot.unit.clone(),
            labels: labels(plot),
            signals: plot.signals.iter().filter_map(place).collect(),
            log: plot.log,
            lines: plot.lines.clone(),
            limits: plot.limits.clone(),
        }
    }
}

/// Returns the plots of some patterns in order; without patterns, the first plots of the run, whose requirements have
/// these bounds. `descriptions` has those of signals by their recorded names.
///
/// # Errors
/// If a pattern is invalid, no signal matches it, or too many do.
pub(crate) fn chosen(
    columns: &[Column],
    plan: &Plan,
    bounds: Vec<Bound>,
    patterns: &[String],
    descriptions: &BTreeMap<String, String>,
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
            patterns: &[],
            values: None,
        });
    }
    let mut plots: Vec<Plot> = (plots.iter())
        .map(|plot| Plot::of(&recorded, plot, descriptions))
        .collect();
    let mut retained: Vec<usize> = Vec::new();
    let mut fits = |plot: &Plot| {
        retained.extend(&plot.signals);
        retained.sort_unstable();
        retained.dedup();
        retained.len() <= MOST
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

/// Returns the columns that the panel's readings select; a pattern may match none.
///
/// # Errors
/// If a pattern is invalid, or the patterns select too many signals.
pub(crate) fn readings(columns: &[Column], patterns: &[String]) -> Result<Vec<usize>, Failure> {
    let mut indices = Vec::new();
    for text in patterns {
        let pattern = Pattern::new(text)
            .map_err(|error| Failure::usage(format!("panel.readings `{text}`: {error}")))?;
        let matches = |column: &Column| {
            pattern.matches(&column.name) || pattern.matches(&recorded_name(&column.name))
        };
        indices.extend(
            (0..columns.len())
                .filter(|place| matches(&columns[*place]) && !indices.contains(place))
                .collect::<Vec<_>>(),
        );
    }
    match indices.len() {
        ..=MOST => Ok(indices),
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
        chosen(columns, &plan(), Vec::new(), &patterns, &BTreeMap::new())
    }

    #[test]
    fn patterns_select_as_in_an_export_and_units_are_not_mixed() {
        let plots = of(&columns(), &["*position_m", "truth.*"]).expect("some");
        let summaries = plots
            .iter()
            .map(|plot| (plot.title.as_str(), plot.labels.join(",")));
        let summaries: Vec<_> = summaries.collect();
        assert_eq!(
            summaries,
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
    fn readings_keep_the_order_of_their_names() {
        let of = |texts: &[&str]| {
            let texts: Vec<String> = texts.iter().map(|&text| text.into()).collect();
            readings(&columns(), &texts)
        };
        let indices = of(&["error_m", "*.position_m", "internal.*", "error_m"]).expect("right");
        assert_eq!(indices, [5, 0, 2, 3]);
        let wrong = of(&["truth.[x"]).expect_err("no pattern").to_string();
        assert!(wrong.contains("panel.readings `truth.[x`"), "{wrong}");
    }

    #[test]
    fn too_many_signals_are_refused_when_selected_and_dropped_by_default() {
        let many = (0..40).map(|number| Column {
            name: format!("truth.x{number}_m"),
            unit: "m".into(),
        });
        let many: Vec<Column> = many.collect();
        let error = of(&many, &["*"]).expect_err("too many");
        assert!(error.to_string().contains("40 signals"), "{error}");
        let retained = of(&many, &[]).expect("the first ones");
        assert_eq!(
            retained
                .iter()
                .map(|plot| plot.signals.len())
                .sum::<usize>(),
            32
        );
    }
}
