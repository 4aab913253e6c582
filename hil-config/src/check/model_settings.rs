//! Settings of an FMU: tolerance, times, initial values, texts and sizes of arrays.
//!
//! Read before the FMU is known: `hil-fmu` checks names and values.

use std::collections::BTreeMap;
use std::path::Path;

use shared_types::describe::ModelSettings;

use super::files::file;
use crate::document::{Node, Table, Value};
use crate::problem::ProblemKind;
use crate::quantity::Quantity;
use crate::reader::{Reader, Section};

/// Returns the settings in `[plant]` or `[controller]`.
pub(super) fn check(reader: &mut Reader, section: &Section<'_>, folder: &Path) -> ModelSettings {
    let initial = values(reader, section, "initial", initial_value);
    let texts = values(reader, section, "texts", |reader, path, node| {
        reader.printable(path, node, "text").map(str::to_owned)
    });
    let files = values(reader, section, "files", |reader, path, node| {
        let file = file(reader, folder, path, node)?;
        file.to_str().map(str::to_owned)
    });
    let structural = values(reader, section, "structural", |reader, path, node| {
        let size = match &node.value {
            Value::Integer(value) => u64::try_from(*value).ok(),
            Value::Boolean(value) => Some(u64::from(*value)),
            _ => None,
        };
        if size.is_none() {
            reader.wrong_type(path, node, "a whole number from 0 on, or true or false");
        }
        size
    });
    let mut number = |key| reader.optional_number(section, key).flatten();
    ModelSettings {
        tolerance: number("tolerance"),
        start_time_s: number("start_time_s"),
        stop_time_s: number("stop_time_s"),
        initial,
        texts,
        files,
        structural,
    }
}

fn initial_value(reader: &mut Reader, path: &str, node: &Node) -> Option<f64> {
    match node.value {
        Value::Boolean(value) => Some(f64::from(u8::from(value))),
        _ => reader.quantity(path, node, &Quantity::finite("")),
    }
}

/// Returns the values of a table by the full names of variables, dotted, quoted or in nested tables.
fn values<T>(
    reader: &mut Reader,
    section: &Section<'_>,
    key: &str,
    read: impl Fn(&mut Reader, &str, &Node) -> Option<T>,
) -> BTreeMap<String, T> {
    let Some(table) = reader.table(section, key) else {
        return BTreeMap::new();
    };
    let mut leaves = Vec::new();
    collect(table.table, "", &mut leaves);
    let mut values = BTreeMap::new();
    for (name, node) in leaves {
        let path = table.path_of(&name);
        let Some(value) = read(reader, &path, node) else {
            continue;
        };
        if values.insert(name, value).is_some() {
            let message = format!("`{path}` is given twice");
            reader.report(ProblemKind::Duplicate, path, &node.place, message);
        }
    }
    values
}

fn collect<'a>(table: &'a Table, before: &str, leaves: &mut Vec<(String, &'a Node)>) {
    for entry in table.entries() {
        let name = match before {
            "" => entry.key.clone(),
            before => format!("{before}.{}", entry.key),
        };
        match &entry.node.value {
            Value::Table(table) => collect(table, &name, leaves),
            _ => leaves.push((name, &entry.node)),
        }
    }
}
