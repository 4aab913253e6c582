//! Text tables: rows of cells, with each column as wide as its widest cell.
//!
//! Used by every package that prints lists. Nothing is cut, and lines have no trailing blanks.

use std::fmt::{self, Display};

/// Column of a table.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    is_right: bool,
    least: usize,
    gap: usize,
}

/// Creates a left-aligned column for words, with a minimum width.
#[must_use]
pub const fn left(least: usize) -> Column {
    Column {
        is_right: false,
        least,
        gap: 2,
    }
}

/// Creates a right-aligned column for numbers, with a minimum width.
#[must_use]
pub const fn right(least: usize) -> Column {
    Column {
        is_right: true,
        ..left(least)
    }
}

impl Column {
    /// Reduces the gap before the column to one blank, as for a unit after its number.
    #[must_use]
    pub const fn close(self) -> Self {
        Self { gap: 1, ..self }
    }
}

/// Table of rows.
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
    /// Creates an empty table, indented by `indent` blanks.
    #[must_use]
    pub fn new(indent: usize, columns: impl Into<Vec<Column>>) -> Self {
        Self {
            indent,
            columns: columns.into(),
            rows: Vec::new(),
        }
    }

    /// Adds a row; cells at its end may be missing.
    pub fn row(&mut self, cells: &[&dyn Display]) {
        self.cells(cells.iter().map(ToString::to_string));
    }

    /// Adds a row of texts, for example a heading.
    pub fn cells(&mut self, cells: impl IntoIterator<Item = impl Into<String>>) {
        let cells = cells.into_iter().map(Into::into);
        self.rows.push(Row::Cells(cells.collect()));
    }

    /// Adds a line below the previous row that spans all columns.
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

/// Returns the displayed width of a text, without colour codes.
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
    fn columns_fit_their_widest_cell_and_lines_have_no_trailing_blanks() {
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
