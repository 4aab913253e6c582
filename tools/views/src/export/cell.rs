//! Columns and cells of an exported table.

use serde::Serialize;

/// A column.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Column {
    pub name: String,
    /// Empty for counts and flags.
    pub unit: String,
    pub kind: CellKind,
    /// A cell may be missing.
    #[serde(skip)]
    pub is_optional: bool,
}

/// Type of a column's cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum CellKind {
    /// A physical number.
    Number,
    /// Steps, nanoseconds, bits.
    Count,
    /// True or false.
    Flag,
}

/// Value of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Cell {
    Number(f64),
    Count(u64),
    Flag(bool),
    /// There is no such thing at that step.
    Missing,
}
