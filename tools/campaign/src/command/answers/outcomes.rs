//! The table of faults by outcomes: a row for each fault of a study in each variant, and one for what it never tries.

use std::io;

use serde::Serialize;
use shared_types::number::{short, short_in};

use crate::command::quoted;
use crate::folder::Folder;
use crate::manifest::Manifest;
use crate::shard::part::Part;
use crate::table::{CLASS, Cell, Column, ColumnKind, Row, Values};
use hil_config::study::{FAULT, Study, TriedFault};
use hil_facts::results::requirements::{VACUOUS, in_words};

use super::{Margin, margin};

/// Outcome of faults that the study does not try.
pub(in crate::command) const NOT_TRIED: &str = "not-tried";

/// Heads of the columns of [`OutcomeRow::shown`].
pub(in crate::command) const FAULT_COLUMNS: [&str; 9] = [
    "fault",
    "target",
    "size",
    "onset [s]",
    "variant",
    "outcome",
    "worst margin",
    "detected after [s]",
    "recovered after [s]",
];

/// Columns of the exported table; numbers are NaN where there is none.
const COLUMNS: [(&str, ColumnKind); 15] = [
    ("case", ColumnKind::Number),
    ("kind", ColumnKind::Text),
    ("target", ColumnKind::Text),
    ("size", ColumnKind::Text),
    ("onset_s", ColumnKind::Number),
    ("variant", ColumnKind::Text),
    ("varied", ColumnKind::Text),
    ("outcome", ColumnKind::Text),
    ("requirement", ColumnKind::Text),
    ("margin", ColumnKind::Number),
    ("unit", ColumnKind::Text),
    ("detected_after_s", ColumnKind::Number),
    ("recovered_after_s", ColumnKind::Number),
    ("reason", ColumnKind::Text),
    ("command", ColumnKind::Text),
];

/// Row of the table.
#[derive(Clone, Debug, Serialize)]
pub(in crate::command) struct OutcomeRow {
    /// Case; `None` for faults that are not tried.
    pub(in crate::command) case: Option<u64>,
    pub(in crate::command) kind: String,
    /// Target; of faults that are not tried the groups of their targets.
    pub(in crate::command) target: String,
    /// Targets that are not tried.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(in crate::command) targets: Vec<String>,
    pub(in crate::command) size: String,
    pub(in crate::command) onset_s: Option<f64>,
    pub(in crate::command) variant: String,
    /// Other varied values, as `name = value`.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub(in crate::command) varied: String,
    /// Class of the case, or [`NOT_TRIED`].
    pub(in crate::command) outcome: String,
    /// Requirement that fared worst.
    pub(in crate::command) requirement: String,
    pub(in crate::command) margin: Margin,
    pub(in crate::command) unit: String,
    /// Time from the onset to the alarm; `None` if there was none.
    pub(in crate::command) detected_after_s: Option<f64>,
    /// Time from the onset to the step from which the fault is overcome until the end; `None` if there is none.
    pub(in crate::command) recovered_after_s: Option<f64>,
    pub(in crate::command) reason: String,
    /// Command that repeats the case; empty for faults that are not tried.
    pub(in crate::command) command: String,
}

/// Rows of a campaign that tries faults, gathered while its parts are read.
pub(in crate::command) struct Outcomes<'a> {
    manifest: &'a Manifest,
    study: &'a Study,
    tried: Vec<TriedFault>,
    /// Command that repeats a case, without its number.
    command: String,
    rows: Vec<OutcomeRow>,
}

impl<'a> Outcomes<'a> {
    /// Creates the table without any cases; `None` for a campaign that tries no faults.
    pub(in crate::command) fn new(folder: &'a Folder, study: &'a Study) -> Option<Self> {
        let tried = study.faults.as_ref()?.tried();
        Some(Self {
            manifest: folder.manifest(),
            study,
            tried,
            command: format!("hil campaign case {}", quoted(folder.path())),
            rows: Vec::new(),
        })
    }

    /// Adds the cases of a part.
    pub(in crate::command) fn take(&mut self, part: &Part) {
        let table = part.results();
        let place = |name: &str| self.manifest.place(name);
        let number = |name: &str, row: usize| {
            let value = place(name).map(|place| table[place].number(row));
            value.filter(|value| value.is_finite())
        };
        let text = |name: &str, row: usize| place(name).map_or("", |place| table[place].text(row));
        let variants = self.study.variants.len() as u64;
        // The fault is the first varied value, and the last one changes fastest.
        let of_each = self.study.draws / self.tried.len().max(1) as u64;
        let mut rows = Vec::new();
        for (row, case) in part.cases().iter().enumerate() {
            let fault = usize::try_from(case / variants / of_each.max(1)).unwrap_or_default();
            let Some(fault) = self.tried.get(fault) else {
                continue;
            };
            let class = text(CLASS, row);
            let worst = worst(self.manifest, |name| {
                let verdict = text(&format!("verdict.{name}"), row);
                let robustness = place(&format!("robustness.{name}"));
                let robustness = robustness.map_or(f64::NAN, |place| table[place].number(row));
                (verdict, margin(verdict, class, robustness))
            });
            let (requirement, unit, margin) =
                worst.unwrap_or((String::new(), String::new(), f64::NAN));
            rows.push(OutcomeRow {
                case: Some(*case),
                kind: fault.kind.clone(),
                target: part_of_plant(&fault.target).into(),
                targets: Vec::new(),
                size: fault.size.clone(),
                onset_s: Some(fault.onset_s),
                variant: text("variant", row).into(),
                varied: self.varied(table, row),
                outcome: class.into(),
                requirement,
                margin: Margin(margin),
                unit,
                detected_after_s: number(&format!("{FAULT}.time_to_detect_s"), row),
                recovered_after_s: number(&format!("{FAULT}.time_to_recover_s"), row),
                reason: text("reason", row).into(),
                command: format!("{} {case}", self.command),
            });
        }
        self.rows.extend(rows);
    }

    /// Lists the varied values of a case beside its fault.
    fn varied(&self, table: &[Values], row: usize) -> String {
        let others = self.study.varied.iter().skip(1);
        let values = others.filter_map(|one| {
            let values = &table[self.manifest.place(&one.name)?];
            let value = match values {
                Values::Numbers(numbers) => short(numbers[row]),
                _ => values.text(row).to_owned(),
            };
            Some(format!("{} = {value}", one.name))
        });
        values.collect::<Vec<_>>().join(", ")
    }

    /// Returns the rows in the order of the cases, then those of the faults that the study does not try.
    pub(in crate::command) fn rows(self) -> Vec<OutcomeRow> {
        let faults = self.manifest.faults.as_ref();
        let untried = faults.into_iter().flat_map(|faults| &faults.untried);
        let untried = untried.map(|one| OutcomeRow {
            case: None,
            kind: one.kind.clone(),
            target: described(&one.targets),
            targets: one.targets.clone(),
            size: String::new(),
            onset_s: None,
            variant: String::new(),
            varied: String::new(),
            outcome: NOT_TRIED.into(),
            requirement: String::new(),
            margin: Margin(f64::NAN),
            unit: String::new(),
            detected_after_s: None,
            recovered_after_s: None,
            reason: String::new(),
            command: String::new(),
        });
        self.rows.into_iter().chain(untried).collect()
    }
}

impl OutcomeRow {
    /// Returns the outcome for display.
    pub(in crate::command) fn in_words(&self, requirements: usize) -> String {
        in_words(&self.outcome, requirements).replace('-', " ")
    }

    /// Returns the margin for display, with its requirement.
    pub(in crate::command) fn worst(&self) -> String {
        match self.margin.0 {
            _ if self.requirement.is_empty() => "-".into(),
            margin if margin.is_nan() => self.requirement.clone(),
            margin if margin.is_infinite() => format!("{} {margin}", self.requirement),
            margin => format!("{} {}", self.requirement, short_in(margin, &self.unit)),
        }
    }

    /// Returns the cells of a display: fault, target, size, onset, variant, outcome, worst margin, detection, recovery.
    pub(in crate::command) fn shown(&self, requirements: usize) -> [String; 9] {
        let dash = |text: &str| if text.is_empty() { "-" } else { text }.to_owned();
        let time = |time_s: Option<f64>| time_s.map_or_else(|| "-".into(), short);
        [
            self.kind.clone(),
            dash(&self.target),
            dash(&self.size),
            time(self.onset_s),
            match &*self.varied {
                "" => dash(&self.variant),
                varied => format!("{}, {varied}", self.variant),
            },
            self.in_words(requirements),
            self.worst(),
            time(self.detected_after_s),
            time(self.recovered_after_s),
        ]
    }

    fn cells(&self) -> Row {
        let text = |text: &str| Cell::Text(text.into());
        let number = |value: Option<f64>| Cell::number(value.unwrap_or(f64::NAN));
        vec![
            number(self.case.map(|case| case as f64)),
            text(&self.kind),
            text(&self.target),
            text(&self.size),
            number(self.onset_s),
            text(&self.variant),
            text(&self.varied),
            text(&self.outcome),
            text(&self.requirement),
            number(Some(self.margin.0)),
            text(&self.unit),
            number(self.detected_after_s),
            number(self.recovered_after_s),
            text(&self.reason),
            text(&self.command),
        ]
    }
}

/// Returns the columns and rows of the exported table.
pub(in crate::command) fn exported(rows: &[OutcomeRow]) -> (Vec<Column>, Vec<Row>) {
    let columns = COLUMNS.map(|(name, kind)| Column::new(name, kind));
    (columns.into(), rows.iter().map(OutcomeRow::cells).collect())
}

/// Formats a table as CSV (RFC 4180); a NaN is an empty cell.
///
/// # Errors
/// If a row has another number of cells than columns.
pub(in crate::command) fn csv(columns: &[Column], rows: &[Row]) -> io::Result<Vec<u8>> {
    let text = |cell: &Cell| match cell {
        Cell::Count(count) => count.to_string(),
        Cell::Number(value) if value.is_nan() => String::new(),
        Cell::Number(value) => value.to_string(),
        Cell::Text(text) => text.clone(),
    };
    let mut writer = csv::WriterBuilder::new()
        .terminator(csv::Terminator::CRLF)
        .from_writer(Vec::new());
    writer.write_record(columns.iter().map(|column| &column.name))?;
    for row in rows {
        writer.write_record(row.iter().map(text))?;
    }
    writer.into_inner().map_err(csv::IntoInnerError::into_error)
}

/// Returns the name, unit and margin of the requirement that fared worst: the least margin among the worst verdicts.
fn worst<'a>(
    manifest: &Manifest,
    judged: impl Fn(&str) -> (&'a str, f64),
) -> Option<(String, String, f64)> {
    let rank = |verdict: &str| match verdict {
        "fail" => 0,
        "undecided" => 1,
        VACUOUS => 2,
        _ => 3,
    };
    let requirements = manifest.columns.iter().filter_map(|column| {
        let name = column.name.strip_prefix("robustness.")?;
        let (verdict, margin) = judged(name);
        (!verdict.is_empty()).then_some((rank(verdict), margin, name, &column.unit))
    });
    let worst = requirements.min_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)))?;
    Some((worst.2.to_owned(), worst.3.clone(), worst.1))
}

/// Names the target of a fault of the plant itself.
fn part_of_plant(target: &str) -> &str {
    if target.is_empty() { "plant" } else { target }
}

/// Describes targets by their groups: those of a group with several by their number.
fn described(targets: &[String]) -> String {
    let group = |target: &str| {
        let group = target.split(['.', '=']).next();
        group.unwrap_or_default().trim().to_owned()
    };
    let mut groups: Vec<(String, usize, &str)> = Vec::new();
    for target in targets {
        let name = group(target);
        match groups.iter_mut().find(|(known, ..)| *known == name) {
            Some((_, count, _)) => *count += 1,
            None => groups.push((name, 1, part_of_plant(target))),
        }
    }
    let texts = groups.into_iter().map(|(name, count, one)| match count {
        1 => one.to_owned(),
        count => format!("{count} of {name}"),
    });
    texts.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_with_quotes_and_commas_is_csv() {
        let (columns, _) = exported(&[]);
        let row: Row = vec![
            Cell::Count(3),
            Cell::Text("a, \"b\"".into()),
            Cell::number(f64::NAN),
            Cell::number(0.5),
        ];
        let text = csv(&columns[..4], &[row]).expect("a table");
        assert_eq!(
            text,
            b"case,kind,target,size\r\n3,\"a, \"\"b\"\"\",,0.5\r\n"
        );
    }

    #[test]
    fn untried_targets_are_described_by_their_group() {
        let described = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(ToString::to_string).collect();
            described(&names)
        };
        let several = ["measured.a", "measured.b", "command.c"];
        assert_eq!(described(&several), "2 of measured, command.c");
        assert_eq!(
            described(&["actuator = 1", "actuator = 2"]),
            "2 of actuator"
        );
        assert_eq!(described(&["link.sample", ""]), "link.sample, plant");
    }
}
