//! Reading a table from memory, one column at a time.

use bytes::Bytes;
use parquet::basic::{Encoding, Type as Physical};
use parquet::column::page::Page;
use parquet::file::metadata::KeyValue;
use parquet::file::reader::{FileReader, SerializedFileReader};

use super::{Column, ColumnKind, TableError, Values};

/// Table read into memory.
pub(crate) struct Table {
    /// Cells of the columns, all of the same length.
    pub columns: Vec<Values>,
    facts: Vec<KeyValue>,
}

impl Table {
    /// Returns a metadata entry of the table by its key.
    pub(crate) fn fact(&self, key: &str) -> Option<&str> {
        let entry = self.facts.iter().find(|fact| fact.key == key)?;
        entry.value.as_deref()
    }
}

/// Reads a table, which must have exactly these columns in this order.
///
/// # Errors
/// If the bytes are not a table, the columns differ, or the file was not written by [`Writer`](super::Writer).
pub(crate) fn read(bytes: Vec<u8>, columns: &[Column]) -> Result<Table, TableError> {
    let other = |what: &str| TableError::Other(what.into());
    let file = SerializedFileReader::new(Bytes::from(bytes))?;
    let about = file.metadata().file_metadata();
    let actual = about.schema_descr().columns().iter().map(|column| {
        let kind = match column.physical_type() {
            Physical::INT64 => Some(ColumnKind::Count),
            Physical::DOUBLE => Some(ColumnKind::Number),
            Physical::BYTE_ARRAY => Some(ColumnKind::Text),
            _ => None,
        };
        (column.name(), kind)
    });
    let expected = columns
        .iter()
        .map(|column| (&*column.name, Some(column.kind)));
    if !actual.eq(expected) {
        return Err(other("its columns differ"));
    }
    let mut all: Vec<Values> = (columns.iter())
        .map(|column| Values::new(column.kind))
        .collect();
    for number in 0..file.num_row_groups() {
        let group = file.get_row_group(number)?;
        for (place, values) in all.iter_mut().enumerate() {
            let mut pages = group.get_column_page_reader(place)?;
            while let Some(page) = pages.get_next_page()? {
                // Cells are never null, so the page has no levels before them.
                let decoded = match &page {
                    Page::DataPage {
                        buf,
                        num_values,
                        encoding: Encoding::PLAIN,
                        ..
                    } => values.decode(buf, usize::try_from(*num_values).unwrap_or(usize::MAX)),
                    _ => None,
                };
                decoded.ok_or_else(|| other("a column has another encoding"))?;
            }
        }
    }
    let rows = usize::try_from(about.num_rows()).unwrap_or_default();
    if all.iter().any(|values| values.rows() != rows) {
        return Err(other("a column has fewer cells than rows"));
    }
    Ok(Table {
        columns: all,
        facts: about.key_value_metadata().cloned().unwrap_or_default(),
    })
}
