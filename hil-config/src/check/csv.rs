//! CSV files of lists beside a scenario: rows of numbers separated by commas, names in the first line or not at all;
//! blank lines and lines that begin with `#` are skipped.
//!
//! Used for the lists of faults, which interpret the numbers. Tables over time are read by
//! [`table_file`](crate::table_file).

use std::io::ErrorKind;
use std::path::Path;

use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};
use crate::scenario::{advice_on_missing, read_regular};
use crate::source::Place;

/// Required layout of a file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    /// Numbers per row.
    pub columns: usize,
    /// Word for a row in messages; its plural ends in `s`.
    pub row: &'static str,
}

impl Layout {
    fn expected(&self) -> String {
        format!("lines of {}", self.numbers())
    }

    fn numbers(&self) -> String {
        match self.columns {
            1 => "one number".into(),
            columns => format!("{columns} numbers separated by commas"),
        }
    }
}

/// Reads the file named by a section's `file`, row by row. Reading stops at the first bad line, because a file of
/// another kind would give thousands of messages. Without a folder, files are refused.
pub(super) fn read(
    reader: &mut Reader,
    section: &Section<'_>,
    folder: Option<&Path>,
    layout: &Layout,
    take: impl FnMut(&[f64]),
) -> Option<()> {
    let name = reader.text(section, "file")?;
    let key = section.path_of("file");
    let Some(folder) = folder else {
        let message = format!("`{key}`: a running plant reads no files");
        reader
            .report_at(section, "file", ProblemKind::Unreadable, message)
            .expected("the numbers themselves");
        return None;
    };
    let path = folder.join(name);
    let text = match read_regular(&path) {
        Ok(text) => text,
        Err(error) => {
            let (reason, help) = match error.kind() {
                ErrorKind::NotFound => (
                    "it does not exist".into(),
                    advice_on_missing(folder, name, "scenario"),
                ),
                _ => (error.to_string(), String::new()),
            };
            let message = format!("`{}` cannot be read: {reason}", path.display());
            reader
                .report_at(section, "file", ProblemKind::Unreadable, message)
                .expected(format!("a CSV file: {}", layout.expected()))
                .help(help);
            return None;
        }
    };
    let result = rows(&text, layout, take);
    let source = reader.sources.add(path.display().to_string(), text);
    let Err(bad) = result else {
        return Some(());
    };
    let place = Place {
        source,
        span: bad.start..bad.start + bad.length,
    };
    reader
        .report(ProblemKind::Syntax, key, &place, bad.message)
        .expected(bad.expected);
    None
}

/// Error in a line, with the line's position.
struct BadLine {
    start: usize,
    length: usize,
    message: String,
    expected: String,
}

fn rows(text: &str, layout: &Layout, mut take: impl FnMut(&[f64])) -> Result<(), BadLine> {
    let mut is_first = true;
    let mut count = 0;
    let mut start = 0;
    for line in text.split_inclusive('\n') {
        let content = line.trim();
        let bad = |message: String, expected: String| BadLine {
            start,
            length: line.trim_end().len(),
            message,
            expected,
        };
        if !content.is_empty() && !content.starts_with('#') {
            let cells: Vec<&str> = content.split(',').map(str::trim).collect();
            let numbers: Vec<f64> = cells.iter().filter_map(|cell| finite(cell)).collect();
            let is_header = is_first && numbers.is_empty();
            is_first = false;
            if !is_header {
                if numbers.len() != layout.columns || cells.len() != layout.columns {
                    let expected = format!("{}, each finite", layout.numbers());
                    return Err(bad(format!("not a {}", layout.row), expected));
                }
                take(&numbers);
                count += 1;
            }
        }
        start += line.len();
    }
    if count == 0 {
        return Err(BadLine {
            start,
            length: 0,
            message: format!("the file has no {}s", layout.row),
            expected: layout.expected(),
        });
    }
    Ok(())
}

fn finite(text: &str) -> Option<f64> {
    text.parse().ok().filter(|value: &f64| value.is_finite())
}
