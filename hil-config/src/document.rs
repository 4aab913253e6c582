//! Document: the scenario as a tree of values with their places in the text.
//!
//! Parsed from TOML text; `--set` values are added to the same tree. The meaning of the keys is unknown here.

use std::collections::HashMap;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::source::Place;

/// Value and its place.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    /// The value.
    pub value: Value,
    /// Place; for a table under a header, the header's name.
    pub place: Place,
}

/// Value as written.
#[derive(Clone, Debug)]
pub(crate) enum Value {
    /// Text.
    Text(String),
    /// A whole number.
    Integer(i64),
    /// Any other number.
    Float(f64),
    /// A number in valid TOML that exceeds 64 bits.
    TooLarge,
    /// `true` or `false`.
    Boolean(bool),
    /// A date or time.
    Date,
    /// A list.
    List(Vec<Node>),
    /// A table.
    Table(Table),
}

impl Value {
    /// Returns the name of the type in messages.
    pub(crate) const fn type_name(&self) -> &'static str {
        match self {
            Self::Text(_) => "text",
            Self::Integer(_) | Self::Float(_) => "a number",
            Self::TooLarge => "a number that is too large",
            Self::Boolean(_) => "true or false",
            Self::Date => "a date",
            Self::List(_) => "a list",
            Self::Table(_) => "a table",
        }
    }
}

/// Table in the order of the text.
#[derive(Clone, Debug, Default)]
pub(crate) struct Table {
    entries: Vec<Entry>,
    /// Index of each key.
    places: HashMap<String, usize>,
}

/// Key and its value.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    /// The key.
    pub key: String,
    /// Place of the key in the text.
    pub key_place: Place,
    /// Value.
    pub node: Node,
}

impl Table {
    /// Returns the entry of a key.
    pub(crate) fn get(&self, key: &str) -> Option<&Entry> {
        self.places.get(key).map(|place| &self.entries[*place])
    }

    pub(crate) fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Returns the entry of a key, which is created if needed.
    pub(crate) fn entry(&mut self, key: &str, new: impl FnOnce() -> Entry) -> &mut Entry {
        let place = match self.places.get(key) {
            Some(place) => *place,
            None => self.push(new()),
        };
        &mut self.entries[place]
    }

    fn push(&mut self, entry: Entry) -> usize {
        let place = self.entries.len();
        self.places.insert(entry.key.clone(), place);
        self.entries.push(entry);
        place
    }

    /// Parses a document. The errors are those of the TOML syntax.
    pub(crate) fn parse(text: &str, source: usize) -> Result<Self, Vec<toml::de::Error>> {
        let (document, errors) = DeTable::parse_recoverable(text);
        if errors.is_empty() {
            Ok(table(document.into_inner(), source))
        } else {
            Err(errors)
        }
    }
}

impl Value {
    /// Parses a single TOML value.
    pub(crate) fn parse(text: &str, place: &Place) -> Option<Self> {
        let value = DeValue::parse(text).ok()?;
        let mut node = node(value, place.source, None);
        shift(&mut node, place.span.start);
        Some(node.value)
    }
}

fn table(table: DeTable<'_>, source: usize) -> Table {
    let mut entries: Vec<Entry> = table
        .into_iter()
        .map(|(key, value)| {
            let key_place = Place {
                source,
                span: key.span(),
            };
            Entry {
                key: key.into_inner().into_owned(),
                node: node(value, source, Some(&key_place)),
                key_place,
            }
        })
        .collect();
    // The parser's map is sorted by name; users expect their own order.
    entries.sort_by_key(|entry| entry.key_place.span.start);
    let mut table = Table::default();
    for entry in entries {
        table.push(entry);
    }
    table
}

fn node(value: Spanned<DeValue<'_>>, source: usize, key_place: Option<&Place>) -> Node {
    let span = value.span();
    let mut place = Place { source, span };
    let value = match value.into_inner() {
        DeValue::String(text) => Value::Text(text.into_owned()),
        DeValue::Integer(number) => i64::from_str_radix(number.as_str(), number.radix())
            .map_or(Value::TooLarge, Value::Integer),
        DeValue::Float(number) => match number.as_str().parse::<f64>() {
            Ok(value) if value.is_finite() || number.as_str().contains(['n', 'i']) => {
                Value::Float(value)
            }
            _ => Value::TooLarge,
        },
        DeValue::Boolean(value) => Value::Boolean(value),
        DeValue::Datetime(_) => Value::Date,
        DeValue::Array(items) => Value::List(
            items
                .into_iter()
                .map(|item| node(item, source, None))
                .collect(),
        ),
        DeValue::Table(entries) => {
            // A table under a key takes the key's place; in a list it has only its own header.
            if let Some(key_place) = key_place {
                place = key_place.clone();
            }
            Value::Table(table(entries, source))
        }
    };
    Node { value, place }
}

/// Shifts the places of a separately parsed value to its position in the source.
fn shift(node: &mut Node, by: usize) {
    let moved = |place: &mut Place| {
        place.span.start += by;
        place.span.end += by;
    };
    moved(&mut node.place);
    match &mut node.value {
        Value::List(items) => items.iter_mut().for_each(|item| shift(item, by)),
        Value::Table(table) => {
            for entry in &mut table.entries {
                moved(&mut entry.key_place);
                shift(&mut entry.node, by);
            }
        }
        _ => {}
    }
}
