//! Files of tables as other programs write them: columns with a header, one of them the time.
//!
//! CSV and packed points are read here; readers of further formats are passed in as [`Format`]s, because they need
//! packages above this one. All of them are a [`TableSource`], and `read` alone chooses the columns and checks the
//! time base.

mod csv;
mod date;
mod header;
mod series;

use std::io;
use std::path::Path;

pub use header::ColumnName;
pub(crate) use series::{Choice, Series, read};

/// Reader of a further format.
#[derive(Clone, Copy, Debug)]
pub struct Format {
    /// Ending of the file's name, without the dot.
    pub ending: &'static str,
    /// Opens a file in which these columns are looked for.
    pub open: OpenTable,
}

/// Function that opens a file in which some columns are looked for.
pub type OpenTable = fn(&Path, &[&str]) -> Result<Box<dyn TableSource>, Refusal>;

/// Open file of a table.
pub trait TableSource {
    /// Lists the columns, in order.
    fn columns(&self) -> &[ColumnName];

    /// Reads the chosen columns, row by row.
    ///
    /// # Errors
    /// At the first row that cannot be read, or to which the receiver objects.
    fn read(&mut self, chosen: &[usize], take: &mut TakeRow<'_>) -> Result<(), Refusal>;

    /// Returns the word for the number of a row: `line` in a text, else `row`.
    fn unit(&self) -> &'static str {
        "row"
    }
}

/// Opens a file by its ending: one of these formats, or else CSV.
///
/// # Errors
/// Of the file itself (outer), or if its content is no table.
pub(crate) fn open(
    path: &Path,
    columns: &[&str],
    formats: &[Format],
) -> io::Result<Result<Box<dyn TableSource>, Refusal>> {
    let ending = path
        .extension()
        .and_then(|ending| ending.to_str())
        .unwrap_or_default();
    let format = formats
        .iter()
        .find(|one| one.ending.eq_ignore_ascii_case(ending));
    Ok(match format {
        Some(format) if path.is_file() => (format.open)(path, columns),
        _ => csv::open(path)?.map(|csv| Box::new(csv) as Box<dyn TableSource>),
    })
}

/// Reads a file of points: times in s, strictly ascending, and the values of the only other column.
///
/// # Errors
/// If the file cannot be read, or has other content.
pub fn points(path: &Path, formats: &[Format]) -> Result<(Vec<f64>, Vec<f64>), Refusal> {
    let opened = open(path, &[], formats)
        .unwrap_or_else(|error| Err(Refusal::new(error.to_string(), EXPECTED)));
    let mut series = read(&mut *opened?, &Choice::default())?;
    Ok((series.time_s, series.columns.swap_remove(0)))
}

/// Possible content of a file that cannot be read.
pub(crate) const EXPECTED: &str = "a table of a time and one or more columns";

/// Receiver of rows: the row's number in the file, from 1, and its numbers.
pub type TakeRow<'a> = dyn FnMut(usize, &[f64]) -> Result<(), Objection> + 'a;

/// Error in a row, and the content that is possible.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Objection {
    /// Description of the error.
    pub message: String,
    /// Possible content.
    pub expected: String,
}

/// Reason why a file is no table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Number of the line, from 1, and its text; `None` if the whole file is meant.
    pub line: Option<(usize, String)>,
    /// Description of the error.
    pub message: String,
    /// Possible content.
    pub expected: String,
    /// Existing names that are closest to an unknown one.
    pub nearest: Vec<String>,
    /// Key of the scenario that is at fault, if not the file.
    pub key: Option<&'static str>,
}

impl Objection {
    /// Creates an objection.
    pub fn new(message: impl Into<String>, expected: impl Into<String>) -> Self {
        Self {
            message: message.into(),
            expected: expected.into(),
        }
    }

    /// Locates the objection in a line of text.
    #[must_use]
    pub fn in_line(self, number: usize, text: impl Into<String>) -> Refusal {
        Refusal {
            line: Some((number, text.into())),
            ..self.into()
        }
    }
}

impl From<Objection> for Refusal {
    fn from(objection: Objection) -> Self {
        Self {
            line: None,
            message: objection.message,
            expected: objection.expected,
            nearest: Vec::new(),
            key: None,
        }
    }
}

impl Refusal {
    /// Creates the refusal of a whole file.
    pub fn new(message: impl Into<String>, expected: impl Into<String>) -> Self {
        Objection::new(message, expected).into()
    }
}
