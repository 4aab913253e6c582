//! Table of a figure's values, for readers that do not see and for those that want numbers. Never has all values.

use maud::{Markup, html};
use shared_types::number::short;

use super::unit::{printed, titled};

/// Table.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Table {
    head: Vec<String>,
    rows: Vec<(String, Vec<String>)>,
}

impl Table {
    /// Creates a table whose columns behind the first have this unit, unless they name their own.
    pub(super) fn new(head: &[&str], unit: &str) -> Self {
        let (first, others) = head.split_first().unwrap_or((&"", &[]));
        let others = others.iter().map(|title| match title.contains('[') {
            true => (*title).to_owned(),
            false => titled(title, &printed(unit)),
        });
        Self {
            head: std::iter::once((*first).to_owned()).chain(others).collect(),
            rows: Vec::new(),
        }
    }

    pub(super) fn row(&mut self, name: &str, values: &[f64]) {
        let values = values.iter().copied().map(short).collect();
        self.rows.push((name.to_owned(), values));
    }

    /// Renders the table as a part of a page.
    pub(super) fn markup(&self) -> Markup {
        html! {
            table {
                thead { tr { @for title in &self.head { th scope="col" { (title) } } } }
                tbody { @for (name, values) in &self.rows {
                    tr { th scope="row" { (name) } @for value in values { td { (value) } } }
                } }
            }
        }
    }
}
