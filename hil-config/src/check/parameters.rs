//! Tables whose keys come from a description: parameters of plants and laws.
//!
//! A key is a full name (dotted, quoted or as nested tables) or only its last part, which sets every parameter with
//! that ending, unless a parameter has exactly that name. The longer key wins, whatever the order.

use std::collections::BTreeMap;

use shared_types::describe::Settings;
use shared_types::number::exact as number;
use shared_types::table::Field;

use crate::document::{Entry, Table, Value};
use crate::problem::{ProblemKind, listed};
use crate::quantity::Quantity;
use crate::reader::{Reader, Section};
use crate::source::{Place, Sources};

/// Maximum number of names that a message lists.
pub(super) const LISTED: usize = 12;

/// Returns the values in a section, by full name. `owner` is named in messages, for example ``plant `drhas` ``.
pub(super) fn given(
    reader: &mut Reader,
    section: &Section<'_>,
    fields: &[Field],
    owner: &str,
) -> BTreeMap<String, f64> {
    let mut leaves = Vec::new();
    collect(section.table, "", fields, &mut leaves);
    let mut values: BTreeMap<String, Written> = BTreeMap::new();
    for (key, entry) in leaves {
        let node = &entry.node;
        let path = section.path_of(&key);
        let matching = named(fields, Field::names, &key);
        if matching.is_empty() {
            unknown(reader, &path, &key, entry, fields, owner);
        }
        for field in matching {
            let earlier = values.get(&field.name);
            if earlier.is_some_and(|earlier| earlier.key == key) {
                let message = format!("`{path}` is given twice");
                reader.report(ProblemKind::Duplicate, &path, &node.place, message);
                break;
            }
            let Some(value) = reader.quantity(&path, node, &Quantity::from(field)) else {
                break; // one message for one value
            };
            let typed_value = Written::new(&key, field.is_called(&key), value, &node.place);
            match typed_value.beats(earlier) {
                Ok(true) => {
                    values.insert(field.name.clone(), typed_value);
                }
                Ok(false) => {}
                Err(message) => {
                    reader.report(ProblemKind::Duplicate, &path, &node.place, message);
                    break;
                }
            }
        }
    }
    values
        .into_iter()
        .map(|(name, typed_value)| (name, typed_value.value))
        .collect()
}

/// Value of a variable, with its key.
pub(super) struct Written {
    key: String,
    /// Number of parts of the key; a full name counts more than any part.
    parts: usize,
    value: f64,
    /// `true` if a flag gave the value, which then overrides the file.
    is_flag: bool,
}

impl Written {
    pub(super) fn new(key: &str, is_full: bool, value: f64, place: &Place) -> Self {
        Self {
            key: key.into(),
            parts: if is_full {
                usize::MAX
            } else {
                key.split('.').count()
            },
            value,
            is_flag: place.source != Sources::SCENARIO,
        }
    }

    /// Returns `true` if this value overrides the earlier one: a longer key overrides a shorter key, and a flag
    /// overrides the file.
    ///
    /// # Errors
    /// If two names of one variable give it two values.
    pub(super) fn beats(&self, earlier: Option<&Self>) -> Result<bool, String> {
        let Some(earlier) = earlier else {
            return Ok(true);
        };
        if earlier.parts == self.parts && earlier.is_flag != self.is_flag {
            return Ok(self.is_flag);
        }
        if earlier.parts == self.parts && earlier.value != self.value {
            let (this, other) = (number(self.value), number(earlier.value));
            return Err(format!(
                "`{}` is {this} but `{}` is {other}, although both are names of one variable; keep only one of them",
                self.key, earlier.key
            ));
        }
        Ok(earlier.parts < self.parts)
    }
}

/// Returns all values: as given, else from `fallback`, else the field's default. A field without a value is reported.
pub(super) fn complete(
    reader: &mut Reader,
    section: &Section<'_>,
    fields: &[Field],
    values: &BTreeMap<String, f64>,
    fallback: impl Fn(&Field) -> Option<f64>,
) -> Settings {
    let mut settings = Settings::default();
    for field in fields {
        let quantity = Quantity::from(field);
        let path = section.path_of(&field.name);
        if let Some(value) = values.get(&field.name) {
            settings.set(&field.name, *value);
        } else if let Some(value) = fallback(field) {
            settings.set(&field.name, value);
        } else if field.is_optional {
            // Left out, which is more than any default says.
        } else if let Some(value) = field.default {
            settings.set(&field.name, value);
        } else {
            reader.missing(section, &path, quantity.expected());
        }
    }
    settings
}

/// Returns the items that a key names: the item of exactly that name, or else all items with that ending.
pub(super) fn named<'a, T, N: Iterator<Item = &'a str>>(
    all: &'a [T],
    names: impl Fn(&'a T) -> N,
    key: &str,
) -> Vec<&'a T> {
    let exact = all.iter().find(|one| names(one).any(|name| name == key));
    match exact {
        Some(one) => vec![one],
        None => {
            let ends_so = |one: &&'a T| names(one).any(|name| is_named(name, key));
            all.iter().filter(ends_so).collect()
        }
    }
}

/// Returns `true` if a key is the name itself or the name's last parts.
pub(super) fn is_named(name: &str, key: &str) -> bool {
    let rest = name.strip_suffix(key);
    rest.is_some_and(|rest| rest.is_empty() || rest.ends_with('.'))
}

/// Collects every value below a table with its dotted key. An empty table counts as a value unless it is the group of a
/// field.
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
                let mut names = fields.iter().flat_map(Field::names);
                let is_group = names.any(|name| name.starts_with(&group));
                if inner.entries().is_empty() && !is_group {
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
