//! A table being written: what a column holds, and which form the rows take.

use std::io;

use hil_console::files::destination::Destination;
use serde::Serialize;

use super::csv::Csv;
use super::parquet::Parquet;

/// A column.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Column {
    pub name: String,
    /// Empty for counts and flags.
    pub unit: String,
    pub kind: CellKind,
    /// A cell may be missing.
    #[serde(skip)]
    pub is_optional: bool,
}

/// Type of a column's cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum CellKind {
    /// A physical number.
    Number,
    /// Steps, nanoseconds, bits.
    Count,
    /// True or false.
    Flag,
}

/// Value of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Cell {
    Number(f64),
    Count(u64),
    Flag(bool),
    /// There is no such thing at that step.
    Missing,
}

/// The table in the form that was chosen.
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

    /// Writes what is left; `metadata` only where the form has a place for it.
    pub(super) fn finish(self, metadata: &[(String, String)]) -> io::Result<Destination> {
        match self {
            Self::Csv(table) => table.finish(),
            Self::Parquet(table) => table.finish(metadata),
        }
    }
}
