//! Writing a table, by rows or by whole columns.

use std::borrow::Cow;
use std::io::Write;

use hil_views::table_file::{Cells, FieldKind, TableFile};

use super::{Cell, Column, ColumnKind, TableError, Values};

/// Number of rows of a row group, all of which are in memory at once.
const GROUP: usize = 1 << 16;

/// Table open for writing, whose bytes depend only on its rows.
pub(crate) struct Writer<W: Write + Send> {
    file: TableFile<W>,
    /// Rows of the next row group.
    columns: Vec<Values>,
}

impl<W: Write + Send> Writer<W> {
    /// Creates a table with these columns.
    ///
    /// # Errors
    /// If the output cannot be written.
    pub(crate) fn new(to: W, columns: &[Column]) -> Result<Self, TableError> {
        let fields = columns.iter().map(|column| {
            let kind = match column.kind {
                ColumnKind::Count => FieldKind::Count,
                ColumnKind::Number => FieldKind::Number,
                ColumnKind::Text => FieldKind::Text,
            };
            (column.name.as_str(), kind, false)
        });
        let values = columns.iter().map(|column| Values::new(column.kind));
        Ok(Self {
            file: TableFile::create(to, "campaign", fields)?,
            columns: values.collect(),
        })
    }

    /// Appends a row.
    ///
    /// # Errors
    /// If the row does not match the columns, or the output cannot be written.
    pub(crate) fn row<'a>(
        &mut self,
        row: impl IntoIterator<Item = &'a Cell>,
    ) -> Result<(), TableError> {
        let mut cells = row.into_iter();
        let mut columns = self.columns.iter_mut();
        let fits = columns.all(|column| cells.next().is_some_and(|cell| column.push(cell)));
        if !fits || cells.next().is_some() {
            return Err(TableError::Other("a row does not match the columns".into()));
        }
        if self.rows() == GROUP {
            self.group()?;
        }
        Ok(())
    }

    /// Appends rows given as whole columns.
    ///
    /// # Errors
    /// If the columns do not match those of the table, or the output cannot be written.
    pub(crate) fn extend(&mut self, columns: &[&Values]) -> Result<(), TableError> {
        let rows = columns.first().map_or(0, |column| column.rows());
        let actual = columns.iter().map(|column| (column.kind(), column.rows()));
        if !actual.eq(self.columns.iter().map(|column| (column.kind(), rows))) {
            return Err(TableError::Other(
                "columns do not match those of the table".into(),
            ));
        }
        let mut from = 0;
        while from < rows {
            let to = rows.min(from + GROUP - self.rows());
            for (column, more) in self.columns.iter_mut().zip(columns) {
                column.extend(more, from..to);
            }
            from = to;
            // Row groups have one size for any chunk size, so the bytes depend on the rows only.
            if self.rows() == GROUP {
                self.group()?;
            }
        }
        Ok(())
    }

    /// Writes the remaining rows and the metadata.
    ///
    /// # Errors
    /// If the output cannot be written.
    pub(crate) fn finish(mut self, facts: &[(&str, String)]) -> Result<W, TableError> {
        self.group()?;
        let facts = facts.iter().map(|(key, value)| (*key, value.as_str()));
        Ok(self.file.finish(facts)?)
    }

    fn rows(&self) -> usize {
        self.columns.first().map_or(0, Values::rows)
    }

    fn group(&mut self) -> Result<(), TableError> {
        if self.rows() == 0 {
            return Ok(());
        }
        self.file
            .group(self.columns.iter_mut().map(|column| match column {
                Values::Counts(values) => {
                    // Parquet stores unsigned integers as the bits of signed ones.
                    let counts = values.drain(..).map(u64::cast_signed).collect();
                    Cells::Counts(Cow::Owned(counts), None)
                }
                Values::Numbers(values) => Cells::Numbers(values),
                Values::Texts(values) => Cells::Texts(values.drain()),
            }))?;
        for column in &mut self.columns {
            if let Values::Numbers(values) = column {
                values.clear();
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::reader::Table;
    use super::super::{Row, read};
    use super::*;

    fn columns() -> [Column; 3] {
        [
            Column::new("case", ColumnKind::Count),
            Column::new("x", ColumnKind::Number),
            Column::new("name", ColumnKind::Text),
        ]
    }

    fn row(case: u64) -> Row {
        let x = match case % 3 {
            0 => f64::NAN,
            1 => -1.0 / case as f64,
            _ => case as f64,
        };
        let name = "\u{e4}x".repeat(usize::try_from(case % 4).expect("few"));
        vec![Cell::Count(case), Cell::number(x), Cell::Text(name)]
    }

    fn rows(table: &Table) -> impl Iterator<Item = Row> {
        let rows = 0..table.columns[0].rows();
        rows.map(|row| table.columns.iter().map(|one| one.cell(row)).collect())
    }

    #[test]
    fn bytes_depend_only_on_the_rows() {
        let count = GROUP as u64 + 5000;
        let mut by_rows = Writer::new(Vec::new(), &columns()).expect("a table");
        for case in 0..count {
            by_rows.row(&row(case)).expect("added");
        }
        let facts = [("fact", "value".to_owned())];
        let expected = by_rows.finish(&facts).expect("written");
        let table = read(expected.clone(), &columns()).expect("a table");
        assert_eq!(table.fact("fact"), Some("value"));
        assert!(rows(&table).eq((0..count).map(row)));
        for size in [1000, GROUP as u64, count] {
            let mut writer = Writer::new(Vec::new(), &columns()).expect("a table");
            for start in (0..count).step_by(usize::try_from(size).expect("small")) {
                let mut part = columns().map(|column| Values::new(column.kind));
                for case in start..count.min(start + size) {
                    let mut cells = part.iter_mut().zip(row(case));
                    assert!(cells.all(|(column, cell)| column.push(&cell)));
                }
                writer.extend(&part.each_ref()).expect("added");
            }
            assert!(
                writer.finish(&facts).expect("written") == expected,
                "{size} at a time"
            );
        }
    }

    #[test]
    fn rows_that_do_not_match_the_columns_are_refused() {
        let refused = |row: &[Cell]| {
            let mut writer = Writer::new(Vec::new(), &columns()).expect("a table");
            writer.row(row).is_err()
        };
        assert!(!refused(&row(1)));
        assert!(refused(&row(1)[..2]));
        assert!(refused(&[row(1), row(1)].concat()));
        assert!(refused(&[Cell::Count(1), Cell::Count(1), Cell::Count(1)]));
        let mut writer = Writer::new(Vec::new(), &columns()).expect("a table");
        let (mut one, two) = (
            Values::new(ColumnKind::Count),
            Values::new(ColumnKind::Number),
        );
        let text = Values::new(ColumnKind::Text);
        assert!(writer.extend(&[&one, &two, &text]).is_ok());
        assert!(writer.extend(&[&one, &two]).is_err());
        assert!(writer.extend(&[&two, &one, &text]).is_err());
        assert!(one.push(&Cell::Count(1)));
        assert!(writer.extend(&[&one, &two, &text]).is_err());
    }
}
