//! Which signals are drawn together, in which order.
//!
//! Chosen once, when the signals of a session are known: by patterns as `hil export` takes them, or
//! by what any plant has: a reference beside its truth, what is derived, commands, the rest.

use glob::Pattern;
use hil_config::expression::Group;
use shared_types::table::near;

use crate::terminal::exit::Failure;

/// Most signals in one plot.
const TOGETHER: usize = 4;
/// Most signals that are kept at all: each costs time at every record.
const MOST: usize = 32;

/// A signal that could be drawn.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// Its group.
    pub group: Group,
    /// Its name in the group.
    pub name: String,
    /// Its unit.
    pub unit: String,
}

impl Column {
    /// The name in expressions.
    #[must_use]
    pub fn full_name(&self) -> String {
        match self.group {
            Group::Derived => self.name.clone(),
            group => format!("{}.{}", group.prefix(), self.name),
        }
    }

    /// The name in a recording, where only the group ends with a dot.
    fn recorded_name(&self) -> String {
        match self.group {
            Group::Derived => self.name.clone(),
            group => format!("{}.{}", group.prefix(), self.name.replace('.', "_")),
        }
    }
}

/// Signals of one unit that are drawn over each other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plot {
    /// What they have in common.
    pub title: String,
    /// Their unit.
    pub unit: String,
    /// What tells them apart.
    pub labels: Vec<String>,
    /// Their places among the columns.
    pub signals: Vec<usize>,
}

impl Plot {
    fn of(columns: &[Column], signals: Vec<usize>) -> Self {
        let first = &columns[signals[0]];
        let is_same = |part: fn(&Column) -> String| {
            (signals.iter()).all(|&signal| part(&columns[signal]) == part(first))
        };
        let name = |column: &Column| column.name.clone();
        let group = |column: &Column| column.group.prefix().to_owned();
        let label: fn(&Column) -> String = match (signals.len(), is_same(name), is_same(group)) {
            (1, ..) => |_| String::new(),
            (_, true, _) => |column| column.group.prefix().into(),
            (_, _, true) => |column| column.name.clone(),
            _ => Column::full_name,
        };
        let title = match (signals.len(), is_same(name), is_same(group)) {
            (1, ..) => first.full_name(),
            (_, true, _) => first.name.clone(),
            (_, _, true) => group(first),
            _ => String::new(),
        };
        Self {
            title,
            unit: first.unit.clone(),
            labels: signals
                .iter()
                .map(|&signal| label(&columns[signal]))
                .collect(),
            signals,
        }
    }
}

/// The plots of some patterns, one after the other; without any those that suit most plants.
///
/// # Errors
/// If a pattern is none, no signal matches it, or too many do.
pub fn chosen(columns: &[Column], patterns: &[String]) -> Result<Vec<Plot>, Failure> {
    if patterns.is_empty() {
        return Ok(defaults(columns));
    }
    let (mut plots, mut seen) = (Vec::new(), Vec::new());
    for text in patterns {
        let pattern = Pattern::new(text)
            .map_err(|error| Failure::usage(format!("--signal `{text}`: {error}")))?;
        let matching: Vec<usize> = (0..columns.len())
            .filter(|&at| {
                let column = &columns[at];
                pattern.matches(&column.full_name()) || pattern.matches(&column.recorded_name())
            })
            .collect();
        if matching.is_empty() {
            let names: Vec<String> = columns.iter().map(Column::full_name).collect();
            let near = near(text, names.iter().map(String::as_str));
            return Err(Failure::usage(format!(
                "the session has no signal `{text}`{near}"
            )));
        }
        plots.extend(by_unit(columns, &matching));
        seen.extend(matching);
    }
    seen.sort_unstable();
    seen.dedup();
    if seen.len() > MOST {
        return Err(Failure::usage(format!(
            "{} signals match --signal; {MOST} can be watched at a time",
            seen.len()
        )));
    }
    Ok(plots)
}

/// Signals of one unit together, up to as many as can be told apart.
fn by_unit(columns: &[Column], signals: &[usize]) -> Vec<Plot> {
    let mut plots: Vec<Vec<usize>> = Vec::new();
    for &signal in signals {
        let unit = &columns[signal].unit;
        let has_place =
            |plot: &&mut Vec<usize>| plot.len() < TOGETHER && columns[plot[0]].unit == *unit;
        match plots.iter_mut().find(has_place) {
            Some(plot) => plot.push(signal),
            None => plots.push(vec![signal]),
        }
    }
    plots
        .into_iter()
        .map(|signals| Plot::of(columns, signals))
        .collect()
}

fn defaults(columns: &[Column]) -> Vec<Plot> {
    let of = |group: Group| -> Vec<usize> {
        (0..columns.len())
            .filter(|&at| columns[at].group == group)
            .collect()
    };
    // What is followed: the truth, or what is measured of it, with its reference.
    let pairs: Vec<Plot> = of(Group::Reference)
        .into_iter()
        .filter_map(|reference| {
            let partner = [Group::Truth, Group::Measured]
                .into_iter()
                .find_map(|group| {
                    let mut signals = of(group).into_iter();
                    signals.find(|&at| columns[at].name == columns[reference].name)
                })?;
            Some(Plot::of(columns, vec![partner, reference]))
        })
        .collect();
    let derived = of(Group::Derived)
        .into_iter()
        .map(|signal| Plot::of(columns, vec![signal]));
    let (first, others) = pairs.split_at(pairs.len().min(1));
    let mut plots = first.to_vec();
    plots.extend(derived);
    plots.extend_from_slice(others);
    plots.extend(by_unit(columns, &of(Group::Command)));
    let is_shown = |at: &usize| plots.iter().any(|plot| plot.signals.contains(at));
    let rest: Vec<usize> = (of(Group::Truth).into_iter())
        .filter(|at| !is_shown(at))
        .collect();
    plots.extend(by_unit(columns, &rest));
    let mut kept = 0;
    plots.retain(|plot| {
        kept += plot.signals.len();
        kept <= MOST
    });
    plots
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) fn columns() -> Vec<Column> {
        let column = |group, name: &str, unit: &str| Column {
            group,
            name: name.into(),
            unit: unit.into(),
        };
        vec![
            column(Group::Truth, "position_m", "m"),
            column(Group::Truth, "velocity_mps", "m/s"),
            column(Group::Measured, "position_m", "m"),
            column(Group::Reference, "position_m", "m"),
            column(Group::Command, "force_n", "N"),
            column(Group::Command, "brake_n", "N"),
            column(Group::Parameter, "actuator1.leak", "1"),
            column(Group::Derived, "error_m", "m"),
        ]
    }

    fn told(plots: &[Plot]) -> Vec<String> {
        let told = plots.iter().map(|plot| {
            let labels = plot.labels.join(",");
            format!("{} [{}] {labels}", plot.title, plot.unit)
        });
        told.collect()
    }

    #[test]
    fn by_default_what_is_followed_comes_first_and_nothing_twice() {
        let plots = chosen(&columns(), &[]).expect("plots");
        assert_eq!(
            told(&plots),
            [
                "position_m [m] truth,reference",
                "error_m [m] ",
                "command [N] force_n,brake_n",
                "truth.velocity_mps [m/s] ",
            ]
        );
    }

    #[test]
    fn a_pattern_chooses_as_for_an_export_and_units_are_not_mixed() {
        let of = |patterns: &[&str]| {
            let patterns: Vec<String> = patterns.iter().map(|&text| text.into()).collect();
            chosen(&columns(), &patterns)
        };
        assert_eq!(
            told(&of(&["*position_m", "truth.*"]).expect("some")),
            [
                "position_m [m] truth,measured,reference",
                "truth.position_m [m] ",
                "truth.velocity_mps [m/s] ",
            ]
        );
        for name in ["parameter.actuator1.leak", "parameter.actuator1_leak"] {
            assert_eq!(of(&[name]).expect("one").len(), 1, "{name}");
        }
        let unknown = of(&["eror_m"]).expect_err("no such signal").to_string();
        assert!(unknown.contains("nearest: `error_m`"), "{unknown}");
    }

    #[test]
    fn more_signals_than_can_be_watched_are_refused() {
        let many: Vec<Column> = (0..40)
            .map(|number| Column {
                group: Group::Truth,
                name: format!("x{number}_m"),
                unit: "m".into(),
            })
            .collect();
        let refused = chosen(&many, &["*".into()]).expect_err("too many");
        assert!(refused.to_string().contains("40 signals"), "{refused}");
        assert_eq!(
            defaults(&many)
                .iter()
                .map(|p| p.signals.len())
                .sum::<usize>(),
            32
        );
    }
}
