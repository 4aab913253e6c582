//! Tables: named columns of counts, numbers and texts, as Parquet.
//!
//! The rows of a shard, of a whole campaign and of its cases are such tables. Any reader of Parquet can read
//! them; [`read`] reads only what [`Writer`] wrote. Knows nothing of what the columns mean.

mod cell;
mod reader;
pub mod sealed;
mod values;
mod writer;

use std::io;

use parquet::errors::ParquetError;
use serde::{Deserialize, Serialize};

pub use cell::{Cell, Row, fits};
pub use reader::{Table, read};
pub use values::{Texts, Values};
pub use writer::Writer;

/// Column of the class of a case.
pub const CLASS: &str = "class";
/// Class of a case that was set aside.
pub const LOST: &str = "lost";

/// Type of the cells of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColumnKind {
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
    pub kind: ColumnKind,
    /// Unit of its numbers; empty if there is none.
    #[serde(default)]
    pub unit: String,
}

impl Column {
    /// Makes a column without a unit.
    #[must_use]
    pub fn new(name: &str, kind: ColumnKind) -> Self {
        Self {
            name: name.into(),
            kind,
            unit: String::new(),
        }
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
