//! A table being written, in the selected format.

use std::io;

use hil_console::files::destination::Destination;

use super::cell::Cell;
use super::csv::Csv;
use super::parquet::Parquet;

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
