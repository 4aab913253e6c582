//! List of numbers that effects of some kinds accept in addition, either in the scenario or in a file.

use std::path::Path;

use shared_types::describe::ListDescription;
use shared_types::number::exact as number;

use super::profile::MOST_POINTS;
use crate::check::csv;
use crate::document::{Node, Value};
use crate::keys::FILE;
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Maximum number of numbers in a list: the record stream carries a list in one piece, like a table.
const MOST_NUMBERS: usize = 2 * MOST_POINTS;

/// Returns the concatenated rows of the list; empty if there is none.
pub(super) fn check(
    reader: &mut Reader,
    section: &Section<'_>,
    folder: Option<&Path>,
    described: Option<&ListDescription>,
) -> Option<Vec<f64>> {
    let Some(described) = described else {
        return Some(Vec::new());
    };
    let Some(entry) = section.table.get(&described.key) else {
        return Some(Vec::new());
    };
    let path = section.path_of(&described.key);
    let numbers = match &entry.node.value {
        Value::Table(_) => file(reader, section, folder, described),
        Value::List(rows) if rows.is_empty() => {
            let message = format!("`{path}` is empty");
            reader
                .report(ProblemKind::OutOfRange, &path, &entry.node.place, message)
                .expected(expected(described));
            None
        }
        Value::List(_) if described.columns == 1 => reader.numbers(&path, &entry.node),
        Value::List(rows) => {
            let rows: Vec<Option<Vec<f64>>> = (rows.iter().enumerate())
                .map(|(index, row)| self::row(reader, &format!("{path}[{index}]"), row, described))
                .collect();
            let rows: Option<Vec<Vec<f64>>> = rows.into_iter().collect();
            Some(rows?.concat())
        }
        _ => {
            reader.wrong_type(&path, &entry.node, expected(described));
            None
        }
    }?;
    if numbers.len() > MOST_NUMBERS {
        let message = format!("`{path}` has {} numbers", numbers.len());
        reader
            .report(ProblemKind::OutOfRange, path, &entry.node.place, message)
            .expected(format!("at most {MOST_NUMBERS} numbers"));
        return None;
    }
    Some(numbers)
}

fn expected(described: &ListDescription) -> String {
    let rows = match described.columns {
        1 => "a list of numbers".into(),
        columns => format!("a list of rows of {columns} numbers each"),
    };
    format!("{rows}, or {{ file = \"x.csv\" }}")
}

fn row(
    reader: &mut Reader,
    path: &str,
    node: &Node,
    described: &ListDescription,
) -> Option<Vec<f64>> {
    let numbers = reader.numbers(path, node)?;
    if numbers.len() == described.columns {
        return Some(numbers);
    }
    let message = format!("`{path}` has {} numbers", numbers.len());
    reader
        .report(ProblemKind::WrongType, path, &node.place, message)
        .expected(format!("{} numbers", number(described.columns as f64)));
    None
}

fn file(
    reader: &mut Reader,
    section: &Section<'_>,
    folder: Option<&Path>,
    described: &ListDescription,
) -> Option<Vec<f64>> {
    let table = reader.table(section, &described.key)?.with_keys(FILE);
    reader.refuse_unknown(&table, &[]);
    let layout = csv::Layout {
        columns: described.columns,
        row: "row",
    };
    let mut rows = Vec::new();
    csv::read(reader, &table, folder, &layout, |row| {
        rows.extend_from_slice(row);
    })?;
    Some(rows)
}
