//! Tables: named columns of counts, numbers and texts, as Parquet.
//!
//! The rows of a shard, of a whole campaign and of its cases are such tables. Any reader of Parquet can read
//! them; [`Reader`] reads only what [`Writer`] wrote. Knows nothing of what the columns mean.

use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, Encoding, LogicalType, Repetition, Type as Physical};
use parquet::column::reader::ColumnReader;
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use serde::{Deserialize, Serialize};
use shared_types::table::canonical;

/// Column of the class of a case.
pub const CLASS: &str = "class";
/// Class of a case that was set aside.
pub const LOST: &str = "lost";

/// Type of the cells of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A whole number.
    Count,
    /// A number; one that does not exist is NaN.
    Number,
    /// A text; one that does not exist is empty.
    Text,
}

/// A column.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Column {
    /// Name.
    pub name: String,
    /// Type of its cells.
    pub kind: Kind,
    /// Unit of its numbers; empty if there is none.
    #[serde(default)]
    pub unit: String,
}

impl Column {
    /// Makes a column without a unit.
    #[must_use]
    pub fn new(name: &str, kind: Kind) -> Self {
        Self {
            name: name.into(),
            kind,
            unit: String::new(),
        }
    }
}

/// A value in a table.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Cell {
    /// A whole number.
    Count(u64),
    /// A number, as its bits in text: JSON has no NaN and no infinity.
    #[serde(with = "bits")]
    Number(f64),
    /// A text.
    Text(String),
}

/// Cells in the order of the columns.
pub type Row = Vec<Cell>;

impl Cell {
    /// Makes a number; any NaN is the same one, and zero has no sign.
    #[must_use]
    pub fn number(value: f64) -> Self {
        Self::Number(canonical(value))
    }

    /// Returns the number, if it is one.
    #[must_use]
    pub const fn as_number(&self) -> Option<f64> {
        match self {
            Self::Number(value) => Some(*value),
            Self::Count(_) | Self::Text(_) => None,
        }
    }

    /// Returns the text; empty if it is none.
    #[must_use]
    pub fn as_text(&self) -> &str {
        match self {
            Self::Text(text) => text,
            Self::Count(_) | Self::Number(_) => "",
        }
    }

    /// Returns the count; 0 if it is none.
    #[must_use]
    pub const fn as_count(&self) -> u64 {
        match self {
            Self::Count(count) => *count,
            Self::Number(_) | Self::Text(_) => 0,
        }
    }

    const fn kind(&self) -> Kind {
        match self {
            Self::Count(_) => Kind::Count,
            Self::Number(_) => Kind::Number,
            Self::Text(_) => Kind::Text,
        }
    }

    /// Takes it into a digest: counts and the bits of numbers as 8 bytes, little end first; texts after their
    /// length in bytes as such a count.
    pub fn feed(&self, hasher: &mut blake3::Hasher) {
        match self {
            Self::Count(count) => hasher.update(&count.to_le_bytes()),
            Self::Number(number) => hasher.update(&number.to_bits().to_le_bytes()),
            Self::Text(text) => {
                hasher.update(&(text.len() as u64).to_le_bytes());
                hasher.update(text.as_bytes())
            }
        };
    }
}

impl PartialEq for Cell {
    /// Compares bits: a number that does not exist is equal to itself.
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

/// Numbers in JSON: exact, with those that JSON does not know.
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

/// Reason for which a table cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// The system refused.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The file is no table, or another one.
    #[error("{0}")]
    Other(String),
}

impl From<ParquetError> for TableError {
    fn from(error: ParquetError) -> Self {
        match error {
            ParquetError::External(cause) => match cause.downcast::<io::Error>() {
                Ok(error) => Self::Io(*error),
                Err(cause) => Self::Other(cause.to_string()),
            },
            other => Self::Other(other.to_string()),
        }
    }
}

/// Rows of a group, which are in memory at once.
const GROUP: usize = 1 << 16;

/// A table being written, in bytes that depend on its rows alone.
pub struct Writer<W: Write + Send> {
    file: SerializedFileWriter<W>,
    columns: Vec<Pending>,
    rows: usize,
}

enum Pending {
    Counts(Vec<i64>),
    Numbers(Vec<f64>),
    Texts(Vec<ByteArray>),
}

impl<W: Write + Send> Writer<W> {
    /// Begins a table of these columns.
    ///
    /// # Errors
    /// If nothing can be written.
    pub fn new(to: W, columns: &[Column]) -> Result<Self, TableError> {
        let fields = columns.iter().map(|column| {
            let (physical, logical) = match column.kind {
                Kind::Count => (Physical::INT64, Some(LogicalType::integer(64, false))),
                Kind::Number => (Physical::DOUBLE, None),
                Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            };
            let field = Type::primitive_type_builder(&column.name, physical)
                .with_logical_type(logical)
                .with_repetition(Repetition::REQUIRED)
                .build();
            field.map(Arc::new)
        });
        let fields = fields.collect::<Result<_, _>>()?;
        let schema = Type::group_type_builder("campaign").with_fields(fields);
        let properties = WriterProperties::builder()
            .set_created_by(concat!("hil ", env!("CARGO_PKG_VERSION")).into())
            .set_compression(Compression::SNAPPY)
            .set_dictionary_enabled(false)
            .set_encoding(Encoding::PLAIN)
            .set_statistics_enabled(EnabledStatistics::Chunk)
            .build();
        let schema = Arc::new(schema.build()?);
        let values = |column: &Column| match column.kind {
            Kind::Count => Pending::Counts(Vec::new()),
            Kind::Number => Pending::Numbers(Vec::new()),
            Kind::Text => Pending::Texts(Vec::new()),
        };
        Ok(Self {
            file: SerializedFileWriter::new(to, schema, Arc::new(properties))?,
            columns: columns.iter().map(values).collect(),
            rows: 0,
        })
    }

    /// Adds a row.
    ///
    /// # Errors
    /// If it is not of the columns, or cannot be written.
    pub fn row<'a>(&mut self, row: impl IntoIterator<Item = &'a Cell>) -> Result<(), TableError> {
        let mut cells = row.into_iter();
        for column in &mut self.columns {
            match (column, cells.next()) {
                // The bits of an unsigned number, as the logical type says.
                (Pending::Counts(to), Some(Cell::Count(count))) => to.push(count.cast_signed()),
                (Pending::Numbers(to), Some(Cell::Number(number))) => to.push(*number),
                (Pending::Texts(to), Some(Cell::Text(text))) => to.push(text.as_str().into()),
                _ => return Err(TableError::Other("a cell is not of its column".into())),
            }
        }
        if cells.next().is_some() {
            return Err(TableError::Other(
                "a row has more cells than columns".into(),
            ));
        }
        self.rows += 1;
        if self.rows == GROUP {
            self.group()?;
        }
        Ok(())
    }

    /// Writes what is left, with facts that stand beside the table.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(mut self, facts: &[(&str, String)]) -> Result<W, TableError> {
        self.group()?;
        for (key, value) in facts {
            let pair = KeyValue::new((*key).to_owned(), value.clone());
            self.file.append_key_value_metadata(pair);
        }
        Ok(self.file.into_inner()?)
    }

    fn group(&mut self) -> Result<(), TableError> {
        if self.rows == 0 {
            return Ok(());
        }
        let mut group = self.file.next_row_group()?;
        for column in &mut self.columns {
            let Some(mut writer) = group.next_column()? else {
                break;
            };
            match column {
                Pending::Counts(values) => {
                    writer
                        .typed::<Int64Type>()
                        .write_batch(values, None, None)?;
                    values.clear();
                }
                Pending::Numbers(values) => {
                    writer
                        .typed::<DoubleType>()
                        .write_batch(values, None, None)?;
                    values.clear();
                }
                Pending::Texts(values) => {
                    writer
                        .typed::<ByteArrayType>()
                        .write_batch(values, None, None)?;
                    values.clear();
                }
            }
            writer.close()?;
        }
        group.close()?;
        self.rows = 0;
        Ok(())
    }
}

/// Cells of one column.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Of counts.
    Counts(Vec<u64>),
    /// Of numbers.
    Numbers(Vec<f64>),
    /// Of texts.
    Texts(Vec<String>),
}

/// A table that is read a group of rows at a time.
pub struct Reader {
    file: Box<dyn FileReader>,
    columns: Vec<Column>,
    groups: std::ops::Range<usize>,
}

impl Values {
    /// Counts its cells.
    #[must_use]
    #[expect(clippy::len_without_is_empty, reason = "no group of rows is empty")]
    pub fn len(&self) -> usize {
        match self {
            Self::Counts(values) => values.len(),
            Self::Numbers(values) => values.len(),
            Self::Texts(values) => values.len(),
        }
    }

    /// Takes the cell of a row out of it.
    ///
    /// # Panics
    /// If there is no such row.
    #[must_use]
    pub fn take(&mut self, row: usize) -> Cell {
        match self {
            Self::Counts(values) => Cell::Count(values[row]),
            Self::Numbers(values) => Cell::Number(values[row]),
            Self::Texts(values) => Cell::Text(std::mem::take(&mut values[row])),
        }
    }
}

impl Reader {
    /// Opens a table that must have these columns, in this order, at its begin.
    ///
    /// # Errors
    /// If it cannot be read or has others.
    pub fn open(path: &Path, columns: &[Column]) -> Result<Self, TableError> {
        let file = SerializedFileReader::new(std::fs::File::open(path)?)?;
        Self::new(Box::new(file), columns)
    }

    /// Reads a table from memory; nothing else is as in [`open`](Self::open).
    ///
    /// # Errors
    /// As of [`open`](Self::open).
    pub fn of(bytes: Vec<u8>, columns: &[Column]) -> Result<Self, TableError> {
        let file = SerializedFileReader::new(bytes::Bytes::from(bytes))?;
        Self::new(Box::new(file), columns)
    }

    fn new(file: Box<dyn FileReader>, columns: &[Column]) -> Result<Self, TableError> {
        let schema = file.metadata().file_metadata().schema_descr();
        let found = schema.columns().iter().map(|column| {
            let kind = match column.physical_type() {
                Physical::INT64 => Some(Kind::Count),
                Physical::DOUBLE => Some(Kind::Number),
                Physical::BYTE_ARRAY => Some(Kind::Text),
                _ => None,
            };
            (column.name().to_owned(), kind)
        });
        let found: Vec<(String, Option<Kind>)> = found.collect();
        let wanted = |column: &Column| (column.name.clone(), Some(column.kind));
        if found.len() < columns.len()
            || !columns
                .iter()
                .map(wanted)
                .eq(found[..columns.len()].iter().cloned())
        {
            return Err(TableError::Other("it has other columns".into()));
        }
        let groups = 0..file.num_row_groups();
        Ok(Self {
            file,
            columns: columns.to_vec(),
            groups,
        })
    }

    /// Returns a fact that stands beside the table.
    #[must_use]
    pub fn fact(&self, key: &str) -> Option<&str> {
        let facts = self.file.metadata().file_metadata().key_value_metadata()?;
        let found = facts.iter().find(|fact| fact.key == key)?;
        found.value.as_deref()
    }

    /// Returns the number of its rows.
    #[must_use]
    pub fn rows(&self) -> u64 {
        let rows = self.file.metadata().file_metadata().num_rows();
        u64::try_from(rows).unwrap_or_default()
    }

    /// Reads the rows that are left.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn all(&mut self) -> Result<Vec<Row>, TableError> {
        let mut rows = Vec::new();
        while let Some(mut values) = self.group(|_| true)? {
            let count = values.first().map_or(0, Values::len);
            let row = |row| values.iter_mut().map(|one| one.take(row)).collect::<Row>();
            rows.extend((0..count).map(row));
        }
        Ok(rows)
    }

    /// Reads the next group of rows, by the columns that are wanted, in their order; none after the last.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn group(
        &mut self,
        is_wanted: impl Fn(&Column) -> bool,
    ) -> Result<Option<Vec<Values>>, TableError> {
        let Some(number) = self.groups.next() else {
            return Ok(None);
        };
        let group = self.file.get_row_group(number)?;
        let rows = usize::try_from(group.metadata().num_rows()).unwrap_or_default();
        let mut all = Vec::new();
        for (place, column) in self.columns.iter().enumerate() {
            if !is_wanted(column) {
                continue;
            }
            let values = match group.get_column_reader(place)? {
                ColumnReader::Int64ColumnReader(mut reader) => {
                    let mut values = Vec::with_capacity(rows);
                    reader.read_records(rows, None, None, &mut values)?;
                    Values::Counts(values.into_iter().map(i64::cast_unsigned).collect())
                }
                ColumnReader::DoubleColumnReader(mut reader) => {
                    let mut values = Vec::with_capacity(rows);
                    reader.read_records(rows, None, None, &mut values)?;
                    Values::Numbers(values)
                }
                ColumnReader::ByteArrayColumnReader(mut reader) => {
                    let mut values: Vec<ByteArray> = Vec::with_capacity(rows);
                    reader.read_records(rows, None, None, &mut values)?;
                    let text = |value: ByteArray| {
                        let text = value.as_utf8().map(str::to_owned);
                        text.map_err(|_| TableError::Other("a text is no UTF-8".into()))
                    };
                    Values::Texts(values.into_iter().map(text).collect::<Result<_, _>>()?)
                }
                _ => return Err(TableError::Other("it has other columns".into())),
            };
            if values.len() != rows {
                return Err(TableError::Other(
                    "a column has fewer cells than rows".into(),
                ));
            }
            all.push(values);
        }
        Ok(Some(all))
    }
}

/// Checks that cells are of these columns.
#[must_use]
pub fn fits(row: &[Cell], columns: &[Column]) -> bool {
    row.iter()
        .map(Cell::kind)
        .eq(columns.iter().map(|column| column.kind))
}
