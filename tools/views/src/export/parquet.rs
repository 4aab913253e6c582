//! A table as Apache Parquet, for pandas, Polars, DuckDB and MATLAB.
//!
//! Undefined numbers are NaN, and missing times and counts are null. Rows are buffered until a row group is complete,
//! which is the only memory that grows with the table. Units and provenance are key-value metadata of the file.

use std::borrow::Cow;
use std::io::{self, Write};

use super::cell::{Cell, CellKind, Column};
use crate::table_file::{Cells, FieldKind, TableFile};

/// Cells in a row group: 32 MiB of numbers.
const GROUP_CELLS: usize = 1 << 22;

/// A table being written.
pub(super) struct Parquet<W: Write + Send> {
    file: TableFile<W>,
    /// Columns of the row group being filled.
    columns: Vec<Held>,
    rows: usize,
    group_rows: usize,
}

/// Cells of a column in the type in which they are written.
enum Held {
    Numbers(Vec<f64>),
    /// Existing counts; if counts may be missing, also 1 or 0 for each row, depending on whether it has a count.
    Counts(Vec<i64>, Option<Vec<i16>>),
    Flags(Vec<bool>),
}

impl Held {
    fn cells(&self) -> Cells<'_> {
        match self {
            Self::Numbers(numbers) => Cells::Numbers(numbers),
            Self::Counts(counts, levels) => Cells::Counts(Cow::from(counts), levels.as_deref()),
            Self::Flags(flags) => Cells::Flags(flags),
        }
    }

    fn clear(&mut self) {
        match self {
            Self::Numbers(numbers) => numbers.clear(),
            Self::Counts(counts, levels) => {
                counts.clear();
                levels.iter_mut().for_each(Vec::clear);
            }
            Self::Flags(flags) => flags.clear(),
        }
    }
}

impl<W: Write + Send> Parquet<W> {
    pub(super) fn new(to: W, columns: &[Column]) -> io::Result<Self> {
        let fields = columns.iter().map(|column| {
            let kind = match column.kind {
                CellKind::Number => FieldKind::Number,
                CellKind::Count => FieldKind::Count,
                CellKind::Flag => FieldKind::Flag,
            };
            (column.name.as_str(), kind, column.is_optional)
        });
        let held = |column: &Column| match column.kind {
            CellKind::Number => Held::Numbers(Vec::new()),
            CellKind::Count => Held::Counts(Vec::new(), column.is_optional.then(Vec::new)),
            CellKind::Flag => Held::Flags(Vec::new()),
        };
        Ok(Self {
            file: TableFile::create(to, "run", fields)?,
            columns: columns.iter().map(held).collect(),
            rows: 0,
            group_rows: GROUP_CELLS.div_ceil(columns.len()),
        })
    }

    pub(super) fn row(&mut self, cells: &[Cell]) -> io::Result<()> {
        for (column, cell) in self.columns.iter_mut().zip(cells) {
            match (column, *cell) {
                (Held::Numbers(numbers), Cell::Number(value)) => numbers.push(value),
                // The column's logical type marks these bits as unsigned.
                (Held::Counts(counts, levels), Cell::Count(count)) => {
                    counts.push(count.cast_signed());
                    levels.iter_mut().for_each(|levels| levels.push(1));
                }
                (Held::Counts(_, Some(levels)), Cell::Missing) => levels.push(0),
                (Held::Flags(flags), Cell::Flag(flag)) => flags.push(flag),
                _ => return Err(io::Error::other("a cell is not of its column's kind")),
            }
        }
        self.rows += 1;
        if self.rows == self.group_rows {
            self.write_group()?;
        }
        Ok(())
    }

    /// Writes the remaining rows and the metadata.
    pub(super) fn finish(mut self, metadata: &[(String, String)]) -> io::Result<W> {
        self.write_group()?;
        let facts = metadata.iter();
        self.file
            .finish(facts.map(|(key, value)| (key.as_str(), value.as_str())))
    }

    fn write_group(&mut self) -> io::Result<()> {
        if self.rows > 0 {
            self.file.group(self.columns.iter().map(Held::cells))?;
            self.columns.iter_mut().for_each(Held::clear);
            self.rows = 0;
        }
        Ok(())
    }
}
