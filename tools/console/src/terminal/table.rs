//! Tables for a person: rows of cells, each column as wide as its widest cell.
//!
//! Every room that lists something uses it. Nothing is cut, and no line ends with blanks.

use std::fmt::{self, Display};

/// A column.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    is_right: bool,
    least: usize,
    gap: usize,
}

/// A column of words, at least this wide.
#[must_use]
pub const fn left(least: usize) -> Column {
    Column {
        is_right: false,
        least,
        gap: 2,
    }
}

/// A column of numbers, at least this wide.
#[must_use]
pub const fn right(least: usize) -> Column {
    Column {
        is_right: true,
        ..left(least)
    }
}

impl Column {
    /// The same column, one blank after the one before: a unit after its number.
    #[must_use]
    pub const fn close(self) -> Self {
        Self { gap: 1, ..self }
    }
}

/// Rows under each other.
#[derive(Clone, Debug, Default)]
pub struct Table {
    indent: usize,
    columns: Vec<Column>,
    rows: Vec<Row>,
}

#[derive(Clone, Debug)]
enum Row {
    Cells(Vec<String>),
    Text(String),
}

impl Table {
    /// A table without rows, N blanks from the left.
    #[must_use]
    pub fn new(indent: usize, columns: impl Into<Vec<Column>>) -> Self {
        Self {
            indent,
            columns: columns.into(),
            rows: Vec::new(),
        }
    }

    /// Adds a row; columns at its end may be missing.
    pub fn row(&mut self, cells: &[&dyn Display]) {
        self.cells(cells.iter().map(ToString::to_string));
    }

    /// Adds a row of texts, as a heading.
    pub fn cells(&mut self, cells: impl IntoIterator<Item = impl Into<String>>) {
        let cells = cells.into_iter().map(Into::into);
        self.rows.push(Row::Cells(cells.collect()));
    }

    /// Adds a line that belongs to the row above and to no column.
    pub fn line(&mut self, text: impl Into<String>) {
        self.rows.push(Row::Text(text.into()));
    }

    fn width(&self, place: usize, column: Column) -> usize {
        let cells = self.rows.iter().filter_map(|row| match row {
            Row::Cells(cells) => cells.get(place),
            Row::Text(_) => None,
        });
        cells.map(|cell| width(cell)).fold(column.least, usize::max)
    }
}

impl Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let widths = self.columns.iter().enumerate();
        let widths: Vec<usize> = widths
            .map(|(place, column)| self.width(place, *column))
            .collect();
        for row in &self.rows {
            let mut line = " ".repeat(self.indent);
            match row {
                Row::Text(text) => line = text.clone(),
                Row::Cells(cells) => {
                    for (place, cell) in cells.iter().enumerate() {
                        let column = self.columns[place];
                        let gap = if place == 0 { 0 } else { column.gap };
                        let blanks = " ".repeat(widths[place] - width(cell));
                        line += &" ".repeat(gap);
                        line += &match column.is_right {
                            true => blanks + cell,
                            false => cell.clone() + &blanks,
                        };
                    }
                }
            }
            writeln!(f, "{}", line.trim_end())?;
        }
        Ok(())
    }
}

/// Places that a text takes, without the codes of colours.
fn width(text: &str) -> usize {
    let mut is_code = false;
    let is_shown = |character: &char| {
        let was_code = is_code;
        is_code = *character == '\u{1b}' || (is_code && *character != 'm');
        !was_code && !is_code
    };
    text.chars().filter(is_shown).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_their_widest_cell_and_lines_end_with_a_letter() {
        let mut table = Table::new(2, [left(6), right(0), left(4).close(), left(0)]);
        table.row(&[&"name", &"value", &"", &"note"]);
        table.row(&[&"a_long_name", &1.5, &"m", &"seen"]);
        table.line("    below");
        table.row(&[&"\u{1b}[32mb\u{1b}[0m", &"-"]);
        assert_eq!(
            table.to_string(),
            "  name         value       note\n  a_long_name    1.5 m     seen\n    below\n  \u{1b}[32mb\u{1b}[0m                -\n"
        );
    }
}
