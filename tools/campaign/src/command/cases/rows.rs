//! The table of results: its columns, and the row of each case.

use super::super::result::CaseResult;
use super::super::values;
use super::Cases;
use crate::table::{CLASS, Cell, Column, ColumnKind, Row};

impl Cases {
    /// Lists the columns of the table of results, given the result of a case.
    pub(in crate::command) fn columns(&self, result: &CaseResult) -> Vec<Column> {
        let mut columns = vec![
            Column::new("case", ColumnKind::Count),
            Column::new("draw", ColumnKind::Count),
            Column::new("variant", ColumnKind::Text),
            Column::new("seed", ColumnKind::Count),
        ];
        for (one, value) in self.study().varied.iter().zip(self.draws.values(0)) {
            let kind = match value.cell() {
                Cell::Number(_) => ColumnKind::Number,
                _ => ColumnKind::Text,
            };
            columns.push(Column::new(&one.name, kind));
        }
        columns.extend(result.columns());
        columns
    }

    /// Builds the row of a case.
    pub(in crate::command) fn row(&self, case: u64, result: &CaseResult) -> Row {
        let mut row = self.head(case);
        row.extend(result.cells());
        row
    }

    /// Builds the row of a case without a result, of this class.
    pub(in crate::command) fn unrun(
        &self,
        case: u64,
        columns: &[Column],
        class: &str,
        reason: &str,
    ) -> Row {
        let mut row = self.head(case);
        let rest = columns.get(row.len()..).unwrap_or_default();
        row.extend(
            rest.iter()
                .map(|column| match (&*column.name, column.kind) {
                    (CLASS, _) => Cell::Text(class.into()),
                    ("reason", _) => Cell::Text(reason.into()),
                    (_, ColumnKind::Count) => Cell::Count(0),
                    (_, ColumnKind::Number) => Cell::number(f64::NAN),
                    (_, ColumnKind::Text) => Cell::Text(String::new()),
                }),
        );
        row
    }

    /// Builds the cells of a case that are known before it runs.
    pub(in crate::command) fn head(&self, case: u64) -> Row {
        values::head(&self.draws, case)
    }
}
