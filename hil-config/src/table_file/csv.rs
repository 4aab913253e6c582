//! CSV: one header line, then rows of numbers. Read line by line, so that memory does not grow with other columns.
//!
//! Accepted are byte-order marks (UTF-8 and UTF-16), quotes, a comma, semicolon or tab as separator, Excel's `sep=`
//! line, lines that end with a carriage return, blank lines and lines that begin with `#`. A column whose first cell is a
//! date has dates in every row, read as the seconds since the first row.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, ErrorKind, Read};
use std::path::Path;

use super::date::{self, Date};
use super::{ColumnName, Objection, Refusal, TableSource, TakeRow};

/// Longest line, in bytes.
const LONGEST_LINE: u64 = 1 << 20;
/// Largest file, in bytes; some files of the kernel are endless.
const LARGEST: u64 = 4 << 30;
/// Largest file in UTF-16, which is converted as a whole.
const LARGEST_UTF16: u64 = 256 << 20;
/// Most lines of a header whose quoted names have line ends.
const MOST_HEADER_LINES: usize = 10;

/// Open CSV file behind its header.
pub(crate) struct Csv {
    lines: Lines,
    separator: u8,
    columns: Vec<ColumnName>,
    /// Date in the first row of each column, if it is one.
    first_dates: Vec<Option<Date>>,
}

/// Lines of a file.
struct Lines {
    input: Box<dyn BufRead>,
    line: Vec<u8>,
    /// Number of the line, from 1.
    number: usize,
    /// `true` if the line is still to be read as a row.
    is_pending: bool,
}

/// Opens a file and reads its header.
///
/// # Errors
/// Of the file itself (outer), or if it has no header.
pub(crate) fn open(path: &Path) -> io::Result<Result<Csv, Refusal>> {
    let info = std::fs::metadata(path)?;
    // Reading a folder fails with an error of its own.
    let ends = info.is_dir() || (info.is_file() && info.len() <= LARGEST);
    if !ends {
        return Err(io::Error::other("not a regular file of at most 4 GiB"));
    }
    let mut input = BufReader::with_capacity(1 << 16, File::open(path)?.take(LARGEST));
    let start = input.fill_buf()?;
    let input: Box<dyn BufRead> = match start {
        [0xef, 0xbb, 0xbf, ..] => {
            input.consume(3);
            Box::new(input)
        }
        [0xff, 0xfe, ..] => Box::new(utf16(input, u16::from_le_bytes)?),
        [0xfe, 0xff, ..] => Box::new(utf16(input, u16::from_be_bytes)?),
        _ => Box::new(input),
    };
    let lines = Lines {
        input,
        line: Vec::new(),
        number: 0,
        is_pending: false,
    };
    header(lines)
}

fn utf16(input: impl Read, word: fn([u8; 2]) -> u16) -> io::Result<Cursor<Vec<u8>>> {
    let mut bytes = Vec::new();
    input.take(LARGEST_UTF16 + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > LARGEST_UTF16 {
        return Err(io::Error::other(
            "UTF-16 text of more than 256 MiB; save the file as UTF-8",
        ));
    }
    let words = bytes
        .as_chunks::<2>()
        .0
        .iter()
        .skip(1)
        .map(|pair| word(*pair));
    let text = char::decode_utf16(words).collect::<Result<String, _>>();
    text.map(|text| Cursor::new(text.into_bytes()))
        .map_err(|_| io::Error::new(ErrorKind::InvalidData, "not UTF-16 text"))
}

impl Lines {
    /// Reads the next line; returns `false` at the end.
    fn advance(&mut self) -> io::Result<bool> {
        self.line.clear();
        self.number += 1;
        let count = (&mut self.input)
            .take(LONGEST_LINE)
            .read_until(b'\n', &mut self.line)?;
        if count as u64 == LONGEST_LINE && self.line.last() != Some(&b'\n') {
            return Err(io::Error::other(format!(
                "line {} is longer than 1 MiB",
                self.number
            )));
        }
        Ok(count > 0)
    }

    /// Reads the next line with content; returns `false` at the end.
    fn advance_to_content(&mut self) -> io::Result<bool> {
        if std::mem::take(&mut self.is_pending) {
            return Ok(true);
        }
        while self.advance()? {
            let content = self.line.trim_ascii();
            if !content.is_empty() && content[0] != b'#' {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn text(&self) -> String {
        String::from_utf8_lossy(self.line.trim_ascii_end()).into_owned()
    }

    fn refuse(&self, objection: Objection) -> Refusal {
        objection.in_line(self.number, self.text())
    }
}

const HEADER: &str =
    "one line of names, as in `time_s,value` or `time [ms];angle [deg]`, and rows of numbers";

fn header(mut lines: Lines) -> io::Result<Result<Csv, Refusal>> {
    let mut separator = None;
    let is_empty = !lines.advance_to_content()?;
    if let Some([byte]) = lines.line.trim_ascii().strip_prefix(b"sep=") {
        separator = Some(*byte);
        lines.advance_to_content()?;
    }
    if is_empty || lines.line.trim_ascii().is_empty() {
        let message = "the file has no points";
        return Ok(Err(lines.refuse(Objection::new(message, HEADER))));
    }
    let mut text = lines.text();
    let first = lines.number;
    while text.matches('"').count() % 2 == 1 && lines.number < first + MOST_HEADER_LINES {
        if !lines.advance()? {
            break;
        }
        text = format!("{text} {}", lines.text());
    }
    let separator = separator.unwrap_or_else(|| separator_of(text.as_bytes()));
    let cells: Vec<String> = cells(text.as_bytes(), separator)
        .map(|cell| String::from_utf8_lossy(cell).replace("\"\"", "\""))
        .collect();
    if let Some(cell) = cells.iter().find(|cell| cell.parse::<f64>().is_ok()) {
        let message = format!("not the header of a table: `{cell}` is a number, not a name");
        return Ok(Err(lines.refuse(Objection::new(message, HEADER))));
    }
    if cells.len() < 2 {
        let message = "not the header of a table: it has one column";
        let expected =
            "a time and at least one more column, with a comma, a semicolon or a tab between";
        return Ok(Err(lines.refuse(Objection::new(message, expected))));
    }
    let mut columns: Vec<ColumnName> = cells.iter().map(|cell| ColumnName::of(cell)).collect();
    let first_dates = first_dates(&mut lines, separator, columns.len())?;
    for (column, date) in columns.iter_mut().zip(&first_dates) {
        column.is_date = date.is_some();
        if column.is_date {
            column.unit = Some("s".into());
        }
    }
    Ok(Ok(Csv {
        lines,
        separator,
        columns,
        first_dates,
    }))
}

/// Returns the dates of the first row, which stays to be read.
fn first_dates(lines: &mut Lines, separator: u8, columns: usize) -> io::Result<Vec<Option<Date>>> {
    let header = lines.number;
    lines.is_pending = lines.advance_to_content()?;
    if !lines.is_pending {
        lines.number = header;
    }
    let mut dates: Vec<_> = cells(&lines.line, separator).map(Date::parse).collect();
    dates.resize(columns, None);
    Ok(dates)
}

/// Returns the separator of a header: the first of these that stands outside of quotes.
fn separator_of(text: &[u8]) -> u8 {
    let outside = |separator: &u8| {
        let mut is_quoted = false;
        text.iter().any(|byte| {
            is_quoted ^= *byte == b'"';
            !is_quoted && byte == separator
        })
    };
    [b'\t', b';', b',']
        .into_iter()
        .find(outside)
        .unwrap_or(b',')
}

/// Splits a line into its cells, without the quotes around them.
fn cells(line: &[u8], separator: u8) -> impl Iterator<Item = &[u8]> {
    let mut is_quoted = false;
    let cells = line.split(move |byte| {
        is_quoted ^= *byte == b'"';
        !is_quoted && *byte == separator
    });
    cells.map(|cell| {
        let cell = cell.trim_ascii();
        let inner = cell
            .strip_prefix(b"\"")
            .and_then(|rest| rest.strip_suffix(b"\""));
        inner.map_or(cell, <[u8]>::trim_ascii)
    })
}

impl TableSource for Csv {
    fn columns(&self) -> &[ColumnName] {
        &self.columns
    }

    fn unit(&self) -> &'static str {
        "line"
    }

    fn read(&mut self, chosen: &[usize], take: &mut TakeRow<'_>) -> Result<(), Refusal> {
        let mut numbers = vec![0.0; chosen.len()];
        // Places of each column among the chosen ones; a column may be chosen more than once.
        let places: Vec<Vec<usize>> = (0..self.columns.len())
            .map(|column| {
                (0..chosen.len())
                    .filter(|&at| chosen[at] == column)
                    .collect()
            })
            .collect();
        let mut is_first = true;
        let mut has_rows = false;
        loop {
            match self.lines.advance_to_content() {
                Ok(true) => {}
                Ok(false) if has_rows => return Ok(()),
                Ok(false) => {
                    let message = "the file has no points";
                    return Err(self.lines.refuse(Objection::new(message, HEADER)));
                }
                Err(error) => {
                    return Err(Refusal::new(
                        format!("the file cannot be read: {error}"),
                        HEADER,
                    ));
                }
            }
            let mut count = 0;
            let mut wrong = None;
            for cell in cells(&self.lines.line, self.separator) {
                for &place in places.get(count).into_iter().flatten() {
                    let value = match self.first_dates[count] {
                        Some(first) => first.seconds_to(cell, &self.columns[count].name),
                        None => finite(cell).ok_or_else(|| self.wrong_cell(count, cell, is_first)),
                    };
                    match value {
                        Ok(value) => numbers[place] = value,
                        Err(objection) => wrong = wrong.or(Some(objection)),
                    }
                }
                count += 1;
            }
            if let Some(objection) = self.wrong_count(count).or(wrong) {
                return Err(self.lines.refuse(objection));
            }
            is_first = false;
            has_rows = true;
            take(self.lines.number, &numbers).map_err(|objection| self.lines.refuse(objection))?;
        }
    }
}

impl Csv {
    fn wrong_count(&self, count: usize) -> Option<Objection> {
        let columns = self.columns.len();
        let objection = |message: String, expected: String| Some(Objection::new(message, expected));
        match count {
            _ if count == columns => None,
            _ if self.separator == b',' && count == 2 * columns => objection(
                format!("not a point: {count} numbers below {columns} names, as if each had a decimal comma"),
                "a decimal point in every number; where commas are decimal, programs can export a table with tabs and points instead".into(),
            ),
            _ => objection(
                format!("not a point: {count} numbers below {columns} names"),
                format!("{columns} numbers, each finite"),
            ),
        }
    }

    fn wrong_cell(&self, column: usize, cell: &[u8], is_first: bool) -> Objection {
        let name = &self.columns[column].name;
        let text = String::from_utf8_lossy(cell);
        let is_decimal_comma = text.replacen(',', ".", 1).parse::<f64>().is_ok();
        if text.is_empty() {
            return Objection::new(
                format!("not a point: the cell of `{name}` is empty"),
                "a finite number in every row; leave out rows without one",
            );
        }
        if text.contains(',') && is_decimal_comma {
            return Objection::new(
                format!("not a point: `{text}` in `{name}` has a decimal comma"),
                "a decimal point in every number",
            );
        }
        if Date::parse(cell).is_some() {
            return Objection::new(
                format!(
                    "not a point: `{text}` in `{name}` is a date, and the first row has a number"
                ),
                "a date in every row or a number in every row",
            );
        }
        if date::resembles_date(&text) {
            return Objection::new(
                format!(
                    "not a point: `{text}` in `{name}` is neither a number nor a date with a time of day"
                ),
                format!("numbers, or {}", date::FORMS),
            );
        }
        if is_first && text.parse::<f64>().is_err() {
            return Objection::new(
                format!(
                    "not a point: `{text}` in `{name}` is not a number; a header in two lines?"
                ),
                "one line of names, units in it as in `angle [deg]`; a # before any other line above the numbers",
            );
        }
        Objection::new(
            format!("not a point: `{text}` in `{name}` is not a finite number"),
            "numbers in every row, each finite",
        )
    }
}

fn finite(cell: &[u8]) -> Option<f64> {
    let text = std::str::from_utf8(cell).ok()?;
    text.parse().ok().filter(|value: &f64| value.is_finite())
}
