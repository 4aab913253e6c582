//! A table in an Apache Parquet file: the form of all such files of `hil`, for runs and campaigns.
//!
//! Written in groups of rows, with each column of a group as a whole; facts accompany the table as key-value metadata.
//! The meaning of the columns is unknown here.

use std::borrow::Cow;
use std::io::{self, Write};
use std::sync::Arc;

use parquet::basic::{Compression, Encoding, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

/// Type of the cells of a column.
#[derive(Clone, Copy, Debug)]
pub enum FieldKind {
    /// Numbers.
    Number,
    /// Whole numbers, stored with the bits of unsigned numbers.
    Count,
    /// True or false.
    Flag,
    /// Texts.
    Text,
}

/// Cells of a column in a group of rows.
#[derive(Debug)]
pub enum Cells<'a> {
    /// Numbers, one a row.
    Numbers(&'a [f64]),
    /// Existing counts, and for each row 1 if it has a count, otherwise 0; without that list every row has a count.
    Counts(Cow<'a, [i64]>, Option<&'a [i16]>),
    /// Flags, one a row.
    Flags(&'a [bool]),
    /// Texts, one a row.
    Texts(Vec<ByteArray>),
}

/// A table being written, in bytes that depend only on its cells and groups.
pub struct TableFile<W: Write + Send>(SerializedFileWriter<W>);

impl<W: Write + Send> TableFile<W> {
    /// Begins a table of columns with their names and kinds, and `true` for cells that may be missing.
    ///
    /// # Errors
    /// If the beginning of the file cannot be written.
    pub fn create<'a>(
        to: W,
        name: &str,
        columns: impl IntoIterator<Item = (&'a str, FieldKind, bool)>,
    ) -> io::Result<Self> {
        let fields = columns.into_iter().map(|(name, kind, is_optional)| {
            let (physical, logical) = match kind {
                FieldKind::Number => (Physical::DOUBLE, None),
                FieldKind::Count => (Physical::INT64, Some(LogicalType::integer(64, false))),
                FieldKind::Flag => (Physical::BOOLEAN, None),
                FieldKind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            };
            let repetition = match is_optional {
                true => Repetition::OPTIONAL,
                false => Repetition::REQUIRED,
            };
            let field = Type::primitive_type_builder(name, physical)
                .with_logical_type(logical)
                .with_repetition(repetition)
                .build();
            field.map(Arc::new)
        });
        let fields = fields.collect::<Result<_, _>>().map_err(io_error)?;
        let schema = Type::group_type_builder(name).with_fields(fields).build();
        let properties = WriterProperties::builder()
            .set_created_by(concat!("hil ", env!("CARGO_PKG_VERSION")).into())
            .set_compression(Compression::SNAPPY)
            // Numbers hardly ever repeat: with a dictionary files are larger and take longer.
            .set_dictionary_enabled(false)
            // `BYTE_STREAM_SPLIT` would save a fifth, but not every reader knows it.
            .set_encoding(Encoding::PLAIN)
            .set_statistics_enabled(EnabledStatistics::Chunk)
            .build();
        let schema = Arc::new(schema.map_err(io_error)?);
        let file = SerializedFileWriter::new(to, schema, Arc::new(properties));
        file.map(Self).map_err(io_error)
    }

    /// Writes a group of rows.
    ///
    /// # Errors
    /// If the group cannot be written.
    pub fn group<'a>(&mut self, columns: impl IntoIterator<Item = Cells<'a>>) -> io::Result<()> {
        self.write_group(columns).map_err(io_error)
    }

    fn write_group<'a>(
        &mut self,
        columns: impl IntoIterator<Item = Cells<'a>>,
    ) -> Result<(), ParquetError> {
        let mut group = self.0.next_row_group()?;
        for cells in columns {
            let Some(mut writer) = group.next_column()? else {
                break;
            };
            match cells {
                Cells::Numbers(numbers) => writer
                    .typed::<DoubleType>()
                    .write_batch(numbers, None, None)?,
                Cells::Counts(counts, levels) => writer
                    .typed::<Int64Type>()
                    .write_batch(&counts, levels, None)?,
                Cells::Flags(flags) => writer.typed::<BoolType>().write_batch(flags, None, None)?,
                Cells::Texts(texts) => writer
                    .typed::<ByteArrayType>()
                    .write_batch(&texts, None, None)?,
            };
            writer.close()?;
        }
        group.close()?;
        Ok(())
    }

    /// Ends the file, with facts that accompany the table.
    ///
    /// # Errors
    /// If the end of the file cannot be written.
    pub fn finish<'a>(
        mut self,
        facts: impl IntoIterator<Item = (&'a str, &'a str)>,
    ) -> io::Result<W> {
        for (key, value) in facts {
            let pair = KeyValue::new(key.to_owned(), value.to_owned());
            self.0.append_key_value_metadata(pair);
        }
        self.0.into_inner().map_err(io_error)
    }
}

/// Returns the error of the file, if it is the cause.
fn io_error(error: ParquetError) -> io::Error {
    match error {
        ParquetError::External(cause) => match cause.downcast::<io::Error>() {
            Ok(error) => *error,
            Err(cause) => io::Error::other(cause),
        },
        other => io::Error::other(other),
    }
}
