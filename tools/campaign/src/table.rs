//! Tables: named columns of counts, numbers and texts, as Parquet.
//!
//! A shard's rows, a campaign's results and their circumstances are stored as such tables. Any Parquet reader can
//! read them; [`read`] accepts only files that [`Writer`] wrote. The module does not interpret the columns.

mod cell;
mod reader;
pub(crate) mod sealed;
mod values;
mod writer;

use std::io;

use parquet::errors::ParquetError;
use serde::{Deserialize, Serialize};

pub(crate) use cell::fits;
pub use cell::{Cell, Row};
pub(crate) use reader::read;
pub(crate) use values::Values;
pub(crate) use writer::Writer;

/// Column of the class of a case.
pub(crate) const CLASS: &str = "class";
/// Class of a case that was set aside.
pub(crate) const LOST: &str = "lost";
/// Class of a case whose fault the check refuses, so that it was not run.
pub(crate) const NOT_POSSIBLE: &str = "not-possible";

/// Type of the cells of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColumnKind {
    /// Unsigned integer.
    Count,
    /// Floating-point number; NaN if there is none.
    Number,
    /// Text; empty if there is none.
    Text,
}

/// Description of a column.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Column {
    /// Name.
    pub name: String,
    /// Type of its cells.
    pub kind: ColumnKind,
    /// Unit of its numbers; empty if they have none.
    #[serde(default)]
    pub unit: String,
}

impl Column {
    /// Creates a column without a unit.
    pub(crate) fn new(name: &str, kind: ColumnKind) -> Self {
        Self {
            name: name.into(),
            kind,
            unit: String::new(),
        }
    }
}

/// Error of reading or writing a table.
#[derive(Debug, thiserror::Error)]
pub(crate) enum TableError {
    /// An I/O operation failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The file is not a table, or not the expected table.
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
