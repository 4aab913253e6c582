//! Cells and rows of a table, in the form that is also used in journals.

use serde::{Deserialize, Serialize};
use shared_types::table::canonical;

use super::{Column, ColumnKind};

/// A value in a table.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Cell {
    /// Unsigned integer.
    Count(u64),
    /// Floating-point number, serialised as its bits because JSON has no NaN and no infinity.
    #[serde(with = "bits")]
    Number(f64),
    /// Text.
    Text(String),
}

/// Cells in the order of the columns.
pub type Row = Vec<Cell>;

impl Cell {
    /// Creates a number cell; all NaN become one bit pattern, and zero loses its sign.
    #[must_use]
    pub fn number(value: f64) -> Self {
        Self::Number(canonical(value))
    }

    /// Returns the number, or `None` for other kinds.
    pub(crate) const fn as_number(&self) -> Option<f64> {
        match self {
            Self::Number(value) => Some(*value),
            Self::Count(_) | Self::Text(_) => None,
        }
    }

    /// Returns the text; empty for other kinds.
    pub(crate) fn as_text(&self) -> &str {
        match self {
            Self::Text(text) => text,
            Self::Count(_) | Self::Number(_) => "",
        }
    }

    /// Returns the count; 0 for other kinds.
    pub(crate) const fn as_count(&self) -> u64 {
        match self {
            Self::Count(count) => *count,
            Self::Number(_) | Self::Text(_) => 0,
        }
    }

    const fn kind(&self) -> ColumnKind {
        match self {
            Self::Count(_) => ColumnKind::Count,
            Self::Number(_) => ColumnKind::Number,
            Self::Text(_) => ColumnKind::Text,
        }
    }
}

impl PartialEq for Cell {
    /// Compares numbers by their bits, so that NaN equals itself.
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Count(one), Self::Count(other)) => one == other,
            (Self::Number(one), Self::Number(other)) => one.to_bits() == other.to_bits(),
            (Self::Text(one), Self::Text(other)) => one == other,
            _ => false,
        }
    }
}

impl std::fmt::Display for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Count(count) => count.fmt(f),
            Self::Number(number) => shared_types::number::exact(*number).fmt(f),
            Self::Text(text) => text.fmt(f),
        }
    }
}

/// Serialisation of numbers in JSON: exact, including values that JSON lacks.
mod bits {
    use serde::{Deserialize, Deserializer, Serializer};

    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Bits {
        n: u64,
    }

    pub(super) fn serialize<S: Serializer>(value: &f64, to: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeMap;
        let mut map = to.serialize_map(Some(1))?;
        map.serialize_entry("n", &value.to_bits())?;
        map.end()
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
        Bits::deserialize(from).map(|bits| f64::from_bits(bits.n))
    }
}

/// Returns `true` if the cells have the kinds of these columns.
pub(crate) fn fits(row: &[Cell], columns: &[Column]) -> bool {
    row.iter()
        .map(Cell::kind)
        .eq(columns.iter().map(|column| column.kind))
}
