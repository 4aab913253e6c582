//! A table as Apache Parquet, for pandas, Polars, DuckDB and MATLAB.
//!
//! Undefined numbers are NaN, missing times and counts are null. Rows are buffered until a row group is complete,
//! the only memory that grows with the table. Units and provenance are key-value metadata of the file.

use std::io::{self, Write};
use std::sync::Arc;

use parquet::basic::{Compression, Encoding, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

use super::cell::{Cell, CellKind, Column};

/// Cells in a row group: 32 MiB of numbers.
const GROUP_CELLS: usize = 1 << 22;

/// A table being written.
pub(super) struct Parquet<W: Write + Send> {
    file: SerializedFileWriter<W>,
    /// Columns of the row group being filled.
    columns: Vec<Cells>,
    rows: usize,
    group_rows: usize,
}

/// Cells of a column in the type in which they are written.
enum Cells {
    Numbers(Vec<f64>),
    Counts(Vec<i64>),
    /// Counts that exist, and for each row 1 if it has a count, else 0.
    OptionalCounts(Vec<i64>, Vec<i16>),
    Flags(Vec<bool>),
}

impl<W: Write + Send> Parquet<W> {
    pub(super) fn new(to: W, columns: &[Column]) -> io::Result<Self> {
        let fields = columns.iter().map(|column| {
            let (physical, logical) = match column.kind {
                CellKind::Number => (Physical::DOUBLE, None),
                CellKind::Count => (Physical::INT64, Some(LogicalType::integer(64, false))),
                CellKind::Flag => (Physical::BOOLEAN, None),
            };
            let repetition = match column.is_optional {
                true => Repetition::OPTIONAL,
                false => Repetition::REQUIRED,
            };
            let field = Type::primitive_type_builder(&column.name, physical)
                .with_logical_type(logical)
                .with_repetition(repetition)
                .build();
            field.map(Arc::new)
        });
        let fields = fields.collect::<Result<_, _>>().map_err(io_error)?;
        let schema = Type::group_type_builder("run").with_fields(fields).build();
        let properties = WriterProperties::builder()
            .set_created_by(concat!("hil ", env!("CARGO_PKG_VERSION")).into())
            .set_compression(Compression::SNAPPY)
            // Numbers hardly ever repeat: dictionaries make files larger and slower to write.
            .set_dictionary_enabled(false)
            // `BYTE_STREAM_SPLIT` would save a fifth, but not every reader knows it.
            .set_encoding(Encoding::PLAIN)
            .set_statistics_enabled(EnabledStatistics::Chunk)
            .build();
        let schema = Arc::new(schema.map_err(io_error)?);
        let file = SerializedFileWriter::new(to, schema, Arc::new(properties)).map_err(io_error)?;
        let cells = |column: &Column| match column.kind {
            CellKind::Number => Cells::Numbers(Vec::new()),
            CellKind::Count if column.is_optional => Cells::OptionalCounts(Vec::new(), Vec::new()),
            CellKind::Count => Cells::Counts(Vec::new()),
            CellKind::Flag => Cells::Flags(Vec::new()),
        };
        Ok(Self {
            file,
            columns: columns.iter().map(cells).collect(),
            rows: 0,
            group_rows: GROUP_CELLS.div_ceil(columns.len()),
        })
    }

    pub(super) fn row(&mut self, cells: &[Cell]) -> io::Result<()> {
        for (column, cell) in self.columns.iter_mut().zip(cells) {
            match (column, *cell) {
                (Cells::Numbers(numbers), Cell::Number(value)) => numbers.push(value),
                // The column's logical type marks these bits as unsigned.
                (Cells::Counts(counts), Cell::Count(count)) => counts.push(count.cast_signed()),
                (Cells::OptionalCounts(counts, levels), Cell::Count(count)) => {
                    counts.push(count.cast_signed());
                    levels.push(1);
                }
                (Cells::OptionalCounts(_, levels), Cell::Missing) => levels.push(0),
                (Cells::Flags(flags), Cell::Flag(flag)) => flags.push(flag),
                _ => return Err(io::Error::other("a cell is not of its column's kind")),
            }
        }
        self.rows += 1;
        if self.rows == self.group_rows {
            self.write_group().map_err(io_error)?;
        }
        Ok(())
    }

    /// Writes the remaining rows and the metadata.
    pub(super) fn finish(mut self, metadata: &[(String, String)]) -> io::Result<W> {
        self.write_group().map_err(io_error)?;
        for (key, value) in metadata {
            let pair = KeyValue::new(key.clone(), value.clone());
            self.file.append_key_value_metadata(pair);
        }
        self.file.into_inner().map_err(io_error)
    }

    fn write_group(&mut self) -> Result<(), ParquetError> {
        if self.rows == 0 {
            return Ok(());
        }
        let mut group = self.file.next_row_group()?;
        for column in &mut self.columns {
            let Some(mut writer) = group.next_column()? else {
                break;
            };
            match column {
                Cells::Numbers(numbers) => {
                    writer
                        .typed::<DoubleType>()
                        .write_batch(numbers, None, None)?;
                    numbers.clear();
                }
                Cells::Counts(counts) => {
                    writer
                        .typed::<Int64Type>()
                        .write_batch(counts, None, None)?;
                    counts.clear();
                }
                Cells::OptionalCounts(counts, levels) => {
                    writer
                        .typed::<Int64Type>()
                        .write_batch(counts, Some(levels), None)?;
                    counts.clear();
                    levels.clear();
                }
                Cells::Flags(flags) => {
                    writer.typed::<BoolType>().write_batch(flags, None, None)?;
                    flags.clear();
                }
            }
            writer.close()?;
        }
        group.close()?;
        self.rows = 0;
        Ok(())
    }
}

/// Returns the I/O error behind a Parquet error, if there is one.
fn io_error(error: ParquetError) -> io::Error {
    match error {
        ParquetError::External(cause) => match cause.downcast::<io::Error>() {
            Ok(error) => *error,
            Err(cause) => io::Error::other(cause),
        },
        other => io::Error::other(other),
    }
}
