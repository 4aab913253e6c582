//! Tables whose keys come from a description: parameters of plants and laws.
//!
//! A key is a full name, dotted, quoted or as nested tables, or its last part alone, which sets every
//! parameter that ends so unless one has exactly that name. The longer key wins, whatever the order.

use std::collections::BTreeMap;

use shared_types::describe::Settings;
use shared_types::table::Field;

use crate::document::{Entry, Table, Value};
use crate::problem::{ProblemKind, listed};
use crate::quantity::Quantity;
use crate::reader::{Reader, Section};

/// More names than this are not listed in a message.
pub(super) const LISTED: usize = 12;

/// The values that a section gives, by full name. `owner` is named in messages, for example
/// ``plant `drhas` ``.
pub(super) fn given(
    reader: &mut Reader,
    section: &Section<'_>,
    fields: &[Field],
    owner: &str,
) -> BTreeMap<String, f64> {
    let mut leaves = Vec::new();
    collect(section.table, "", fields, &mut leaves);
    // By full name: how many parts the key had, and the value.
    let mut values: BTreeMap<String, (usize, f64)> = BTreeMap::new();
    for (key, entry) in leaves {
        let node = &entry.node;
        let path = section.path_of(&key);
        let matching = named(fields, |field| &field.name, &key);
        if matching.is_empty() {
            unknown(reader, &path, &key, entry, fields, owner);
        }
        for field in matching {
            let parts = key.split('.').count();
            let earlier = values.get(&field.name).map(|(parts, _)| *parts);
            if earlier == Some(parts) {
                let message = format!("`{path}` is given twice");
                reader.report(ProblemKind::Duplicate, &path, &node.place, message);
                break;
            }
            let Some(value) = reader.quantity(&path, node, &Quantity::from(field)) else {
                break; // one message for one value
            };
            if earlier.is_none_or(|earlier| earlier < parts) {
                values.insert(field.name.clone(), (parts, value));
            }
        }
    }
    values
        .into_iter()
        .map(|(name, (_, value))| (name, value))
        .collect()
}

/// All values: given, else `fallback`, else the field's default. A field without any is reported.
pub(super) fn complete(
    reader: &mut Reader,
    section: &Section<'_>,
    fields: &[Field],
    given: &BTreeMap<String, f64>,
    fallback: impl Fn(&Field) -> Option<f64>,
) -> Settings {
    let mut settings = Settings::default();
    for field in fields {
        let quantity = Quantity::from(field);
        let path = section.path_of(&field.name);
        if let Some(value) = given.get(&field.name) {
            settings.set(&field.name, *value);
        } else if let Some(value) = fallback(field) {
            settings.set(&field.name, value);
        } else if let Some(value) = field.default {
            settings.set(&field.name, value);
        } else {
            reader.missing(section, &path, quantity.expected());
        }
    }
    settings
}

/// Returns what a key names: the one with exactly that name, or else all whose last parts it is.
pub(super) fn named<'a, T>(all: &'a [T], name: impl Fn(&T) -> &str, key: &str) -> Vec<&'a T> {
    let exact = all.iter().find(|one| name(one) == key);
    match exact {
        Some(one) => vec![one],
        None => all.iter().filter(|one| is_named(name(one), key)).collect(),
    }
}

/// Returns `true` if a key is the name itself or the name's last parts.
pub(super) fn is_named(name: &str, key: &str) -> bool {
    let rest = name.strip_suffix(key);
    rest.is_some_and(|rest| rest.is_empty() || rest.ends_with('.'))
}

/// Every value below a table with its dotted key. A table that is empty counts as a value unless a
/// field has its name in front.
pub(super) fn collect<'a>(
    table: &'a Table,
    prefix: &str,
    fields: &[Field],
    leaves: &mut Vec<(String, &'a Entry)>,
) {
    for entry in table.entries() {
        let key = format!("{prefix}{}", entry.key);
        let group = format!("{key}.");
        match &entry.node.value {
            Value::Table(inner) => {
                let known = fields.iter().any(|field| field.name.starts_with(&group));
                if inner.entries().is_empty() && !known {
                    leaves.push((key, entry));
                }
                collect(inner, &group, fields, leaves);
            }
            _ => leaves.push((key, entry)),
        }
    }
}

fn unknown(
    reader: &mut Reader,
    path: &str,
    key: &str,
    entry: &Entry,
    fields: &[Field],
    owner: &str,
) {
    let full = fields.iter().map(|field| field.name.as_str());
    let candidates: Vec<&str> = if key.contains('.') {
        full.collect()
    } else {
        let mut ends: Vec<&str> = full
            .map(|name| name.rsplit_once('.').map_or(name, |(_, end)| end))
            .collect();
        ends.sort_unstable();
        ends.dedup();
        ends
    };
    let expected = match candidates.len() {
        0 => "no parameter".into(),
        count if count <= LISTED => format!("one of {}", listed(candidates.iter().copied())),
        count => format!("one of {count} names, which `hil config schema` lists"),
    };
    let message = format!("{owner} has no parameter `{key}`");
    reader
        .report(ProblemKind::UnknownKey, path, &entry.key_place, message)
        .expected(expected)
        .nearest(key, candidates);
}
