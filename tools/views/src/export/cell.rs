//! Columns and cells of an exported table.

use serde::Serialize;

/// A column.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Column {
    pub name: String,
    /// Unit; empty for counts and flags.
    pub unit: String,
    pub kind: CellKind,
    /// `true` if cells may be missing.
    #[serde(skip)]
    pub is_optional: bool,
}

/// Type of a column's cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum CellKind {
    /// A physical number.
    Number,
    /// Integer: steps, nanoseconds or bits.
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
    /// No value at that step.
    Missing,
}
