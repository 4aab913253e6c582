//! Table writer: column types, cells and output format.

use std::io;

use hil_console::files::destination::Destination;
use serde::Serialize;

use super::csv::Csv;
use super::parquet::Parquet;

/// Column of a table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Column {
    pub name: String,
    /// Unit; empty for counts and flags.
    pub unit: String,
    pub kind: CellKind,
    /// `true` if cells may be missing.
    #[serde(skip)]
    pub is_optional: bool,
}

/// Type of a column's cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum CellKind {
    /// A physical number.
    Number,
    /// Integer: steps, nanoseconds or bits.
    Count,
    /// Boolean.
    Flag,
}

/// Value of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Cell {
    Number(f64),
    Count(u64),
    Flag(bool),
    /// No value at that step.
    Missing,
}

/// Table in the selected format.
pub(super) enum Table {
    Csv(Csv<Destination>),
    Parquet(Parquet<Destination>),
}

impl Table {
    /// Adds a row, one cell for each column.
    pub(super) fn row(&mut self, cells: &[Cell]) -> io::Result<()> {
        match self {
            Self::Csv(table) => table.row(cells),
            Self::Parquet(table) => table.row(cells),
        }
    }

    /// Writes the remaining rows; `metadata` is written if the format supports it.
    pub(super) fn finish(self, metadata: &[(String, String)]) -> io::Result<Destination> {
        match self {
            Self::Csv(table) => table.finish(),
            Self::Parquet(table) => table.finish(metadata),
        }
    }
}
