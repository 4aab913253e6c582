//! Tables in Parquet files of flat columns of numbers.

use std::fs::File;
use std::path::Path;

use hil_config::table_file::{ColumnName, Objection, Refusal, TableSource, TakeRow};
use parquet::basic::{Compression, LogicalType, TimeUnit, Type as Physical};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use parquet::schema::types::Type;

const EXPECTED: &str = "a Parquet file with flat columns of numbers";

/// Open file.
struct Table {
    reader: SerializedFileReader<File>,
    names: Vec<ColumnName>,
    /// Index of each column in the schema.
    columns: Vec<usize>,
}

/// Opens a file, whose columns of numbers are all listed; one of these columns with other content is refused.
pub(super) fn open(path: &Path, columns: &[&str]) -> Result<Box<dyn TableSource>, Refusal> {
    let refused = |error: &dyn std::fmt::Display| Refusal::new(error.to_string(), EXPECTED);
    let file = File::open(path).map_err(|error| refused(&error))?;
    let reader = SerializedFileReader::new(file).map_err(|error| refused(&error))?;
    let schema = reader.metadata().file_metadata().schema();
    let is_sought = |field: &Type| {
        let name = ColumnName::of(field.name());
        columns
            .iter()
            .any(|one| *one == name.name || *one == name.label)
    };
    for field in schema.get_fields().iter().filter(|one| is_sought(one)) {
        if let Some(content) = other_content(field) {
            let name = field.name();
            let message = format!("the column `{name}` contains {content}, not numbers");
            return Err(Refusal::new(message, EXPECTED));
        }
    }
    let fields = schema.get_fields().iter().enumerate();
    let numbers = fields.filter(|(_, field)| other_content(field).is_none());
    let (columns, names): (Vec<usize>, Vec<ColumnName>) = numbers
        .map(|(at, field)| (at, ColumnName::with_unit(field.name(), unit(field))))
        .unzip();
    if names.is_empty() {
        return Err(Refusal::new("the file has no column of numbers", EXPECTED));
    }
    Ok(Box::new(Table {
        reader,
        names,
        columns,
    }))
}

/// Describes the content of a column that has no numbers; `None` for one of numbers.
fn other_content(field: &Type) -> Option<&'static str> {
    if !field.is_primitive() {
        return Some("nested values");
    }
    let is_half = matches!(
        field.get_basic_info().logical_type_ref(),
        Some(LogicalType::Float16)
    );
    match field.get_physical_type() {
        Physical::INT32 | Physical::INT64 | Physical::FLOAT | Physical::DOUBLE => None,
        Physical::BOOLEAN => Some("Booleans"),
        Physical::INT96 => Some("dates of 96 bits"),
        Physical::BYTE_ARRAY => Some("texts"),
        Physical::FIXED_LEN_BYTE_ARRAY if is_half => Some("floats of 16 bits"),
        Physical::FIXED_LEN_BYTE_ARRAY => Some("bytes"),
    }
}

/// Returns the name of a compression that cannot be read.
fn unreadable(compression: Compression) -> Option<&'static str> {
    match compression {
        Compression::UNCOMPRESSED | Compression::SNAPPY => None,
        Compression::GZIP(_) => Some("gzip"),
        Compression::LZO => Some("LZO"),
        Compression::BROTLI(_) => Some("Brotli"),
        Compression::LZ4 | Compression::LZ4_RAW => Some("LZ4"),
        Compression::ZSTD(_) => Some("zstd"),
    }
}

/// Returns the unit of a column of dates; other columns have it in their names.
fn unit(field: &Type) -> &'static str {
    match field.get_basic_info().logical_type_ref() {
        Some(LogicalType::Timestamp(time)) => match time.unit {
            TimeUnit::MILLIS => "ms",
            TimeUnit::MICROS => "us",
            TimeUnit::NANOS => "ns",
        },
        _ => "",
    }
}

impl Table {
    /// Refuses a compression of these columns that cannot be read.
    fn refuse_compressed(&self, columns: &[usize]) -> Result<(), Refusal> {
        let metadata = self.reader.metadata();
        let fields = metadata.file_metadata().schema().get_fields();
        for chunk in (metadata.row_groups().iter()).flat_map(|group| group.columns()) {
            let path = chunk.column_path().parts();
            let name = path.first().map(String::as_str).unwrap_or_default();
            let is_chosen = columns.iter().any(|&at| fields[at].name() == name);
            if let Some(compression) = unreadable(chunk.compression()).filter(|_| is_chosen) {
                return Err(Refusal::new(
                    format!("the column `{name}` is compressed with {compression}"),
                    "Parquet compressed with Snappy, or without compression",
                ));
            }
        }
        Ok(())
    }
}

impl TableSource for Table {
    fn columns(&self) -> &[ColumnName] {
        &self.names
    }

    fn read(&mut self, chosen: &[usize], take: &mut TakeRow<'_>) -> Result<(), Refusal> {
        let schema = self.reader.metadata().file_metadata().schema();
        // A projection keeps the order of the file.
        let mut indices: Vec<usize> = chosen.iter().map(|&at| self.columns[at]).collect();
        indices.sort_unstable();
        indices.dedup();
        let fields = indices
            .iter()
            .map(|&at| schema.get_fields()[at].clone())
            .collect();
        self.refuse_compressed(&indices)?;
        let place = |at: &usize| {
            indices
                .iter()
                .position(|column| *column == self.columns[*at])
        };
        let places: Vec<usize> = chosen.iter().filter_map(place).collect();
        let refused =
            |error: parquet::errors::ParquetError| Refusal::new(error.to_string(), EXPECTED);
        let projection = Type::group_type_builder(schema.name())
            .with_fields(fields)
            .build();
        let projection = projection.map_err(refused)?;
        let rows = self
            .reader
            .get_row_iter(Some(projection))
            .map_err(refused)?;
        let mut numbers = vec![0.0; chosen.len()];
        for (row, cells) in rows.enumerate() {
            let cells = cells.map_err(refused)?.into_columns();
            for (number, &place) in numbers.iter_mut().zip(&places) {
                let (name, cell) = &cells[place];
                *number = value(cell).ok_or_else(|| {
                    Refusal::new(
                        format!("row {}: `{name}` is {cell}", row + 1),
                        "a finite number in every row",
                    )
                })?;
            }
            take(row + 1, &numbers).map_err(|Objection { message, expected }| {
                Refusal::new(format!("row {}: {message}", row + 1), expected)
            })?;
        }
        Ok(())
    }
}

/// Returns the number in a cell, if it is finite.
fn value(cell: &Field) -> Option<f64> {
    let value = match *cell {
        Field::Byte(value) => f64::from(value),
        Field::Short(value) => f64::from(value),
        Field::Int(value) => f64::from(value),
        Field::Long(value) | Field::TimestampMillis(value) | Field::TimestampMicros(value) => {
            value as f64
        }
        Field::UByte(value) => f64::from(value),
        Field::UShort(value) => f64::from(value),
        Field::UInt(value) => f64::from(value),
        Field::ULong(value) => value as f64,
        Field::Float(value) => f64::from(value),
        Field::Double(value) => value,
        _ => return None,
    };
    value.is_finite().then_some(value)
}
