//! A row on the receiving side: values with validity bits, ages and the result of each field.

use shared_types::frame::{MAX_SIGNALS, VALIDITY_WORDS};
use shared_types::quality::SignalSet;

use crate::frame::{CanId, Frame};

/// Result for one signal of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FieldResult {
    /// Nothing has arrived or been packed yet.
    Missing,
    /// The value, within half a resolution of the field.
    Value,
    /// The limit of the field, because the value is beyond its range.
    Saturated,
    /// No value: the sender itself has none.
    NotAvailable,
    /// The last accepted value, which is older than the field allows.
    Stale,
    /// The last accepted value, because a later one was refused.
    Refused(Refusal),
}

/// Reason why a frame or a field of it is refused. Fields are indices into the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refusal {
    /// No frame has this identifier.
    ForeignId(CanId),
    /// No frame has this length and these constants.
    Foreign {
        /// Number of bytes that arrived.
        bytes: usize,
    },
    /// Too few bytes.
    Truncated {
        /// Number of bytes that arrived.
        bytes: usize,
        /// Number of bytes of the frame.
        expected: usize,
    },
    /// Too many bytes.
    Oversized {
        /// Number of bytes that arrived.
        bytes: usize,
        /// Number of bytes of the frame.
        expected: usize,
    },
    /// A constant with another value.
    Constant {
        /// The field.
        field: usize,
    },
    /// A checksum that differs from that of the bytes.
    Checksum {
        /// The field.
        field: usize,
        /// Sum in the frame.
        sent: u64,
        /// Sum of the bytes that arrived.
        computed: u64,
    },
    /// The counter of the frame before.
    Repeated {
        /// The field.
        field: usize,
        /// Counter in the frame.
        counter: u64,
    },
    /// A counter beyond the accepted step.
    Jump {
        /// The field.
        field: usize,
        /// Next counter in order.
        expected: u64,
        /// Counter in the frame.
        sent: u64,
    },
    /// Text that is not JSON.
    NotJson {
        /// Byte at which reading ended.
        at: usize,
    },
    /// A field that the JSON text does not have.
    Absent {
        /// The field.
        field: usize,
    },
    /// A field of the JSON text that is not a number.
    NotANumber {
        /// The field.
        field: usize,
    },
    /// NaN or infinity.
    NotFinite {
        /// The field.
        field: usize,
    },
    /// A number beyond the range of its field.
    OutOfRange {
        /// The field.
        field: usize,
    },
}

impl Refusal {
    /// Describes the reason with the names of the frame.
    #[must_use]
    pub fn describe(&self, frame: &Frame) -> String {
        let name = &frame.name;
        let field_name = |field: usize| frame.field_name(field);
        match *self {
            Self::ForeignId(id) => format!("no frame has the id {id}"),
            Self::Foreign { bytes } => {
                format!("no frame matches these {bytes} bytes in length, constants and checksum")
            }
            Self::Truncated { bytes, expected } => {
                format!("frame `{name}` has {bytes} bytes and needs {expected}")
            }
            Self::Oversized { bytes, expected } => {
                format!("frame `{name}` has {bytes} bytes, more than its {expected}")
            }
            Self::Constant { field } => {
                let field = field_name(field);
                format!("the constant `{field}` of frame `{name}` has another value")
            }
            Self::Checksum {
                field,
                sent,
                computed,
            } => {
                let field = field_name(field);
                format!(
                    "the checksum `{field}` of frame `{name}` is {sent:#x}, and that of its bytes {computed:#x}"
                )
            }
            Self::Repeated { field, counter } => {
                let field = field_name(field);
                format!("frame `{name}` repeats the counter `{field}`, {counter}")
            }
            Self::Jump {
                field,
                expected,
                sent,
            } => {
                let field = field_name(field);
                format!(
                    "the counter `{field}` of frame `{name}` jumps to {sent} instead of {expected}"
                )
            }
            Self::NotJson { at } => format!("frame `{name}` is not JSON at byte {at}"),
            Self::Absent { field } => {
                let field = field_name(field);
                format!("frame `{name}` lacks the field `{field}`")
            }
            Self::NotANumber { field } => {
                let field = field_name(field);
                format!("field `{field}` of frame `{name}` is not a number")
            }
            Self::NotFinite { field } => {
                let field = field_name(field);
                format!("field `{field}` of frame `{name}` is NaN or infinite")
            }
            Self::OutOfRange { field } => {
                let field = field_name(field);
                format!("field `{field}` of frame `{name}` is out of range")
            }
        }
    }
}

/// Row of signals on the receiving side, in the order of a signal table.
///
/// A value is always finite: the last accepted one, or 0 before the first. The age of an invalid signal goes on from when it was valid, or from the
/// first step.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    values: Box<[f64]>,
    invalid: SignalSet,
    ages: Box<[u32]>,
    limits: Box<[u32]>,
    results: Box<[FieldResult]>,
}

impl Row {
    /// Creates a row in which nothing has arrived.
    ///
    /// # Panics
    /// If the row has more signals than a frame of the link can carry.
    #[must_use]
    pub fn new(signals: usize) -> Self {
        assert!(signals <= MAX_SIGNALS, "{signals} signals");
        Self {
            values: vec![0.0; signals].into(),
            invalid: SignalSet::from([u64::MAX; VALIDITY_WORDS]),
            ages: vec![0; signals].into(),
            limits: vec![u32::MAX; signals].into(),
            results: vec![FieldResult::Missing; signals].into(),
        }
    }

    /// Sets the age in steps above which a signal is stale.
    pub fn limit_age(&mut self, column: usize, steps: u32) {
        self.limits[column] = steps;
    }

    /// Returns the values.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Returns the invalid signals.
    #[must_use]
    pub const fn invalid(&self) -> &SignalSet {
        &self.invalid
    }

    /// Returns `true` if a signal is valid.
    #[must_use]
    pub fn is_valid(&self, column: usize) -> bool {
        !self.invalid.contains(column)
    }

    /// Returns the ages in steps.
    #[must_use]
    pub fn ages(&self) -> &[u32] {
        &self.ages
    }

    /// Returns the results.
    #[must_use]
    pub fn results(&self) -> &[FieldResult] {
        &self.results
    }

    /// Returns the state between two steps, for a checkpoint: value, age and validity of each signal.
    #[must_use]
    pub fn state(&self) -> Vec<u64> {
        let columns = 0..self.values.len();
        let state = columns.flat_map(|column| {
            let age = u64::from(self.ages[column]);
            let is_valid = u64::from(self.is_valid(column));
            [self.values[column].to_bits(), age, is_valid]
        });
        state.collect()
    }

    /// Restores a state; returns `false` if it is one of another row. The results of its invalid signals begin as
    /// missing.
    #[must_use]
    pub fn restore(&mut self, state: &[u64]) -> bool {
        let columns = state.chunks_exact(3);
        let is_whole = columns.remainder().is_empty() && columns.len() == self.values.len();
        if is_whole {
            for (column, state) in columns.enumerate() {
                match state[2] {
                    1 => self.accept(column, f64::from_bits(state[0])),
                    _ => self.mark(column, FieldResult::Missing),
                }
                self.values[column] = f64::from_bits(state[0]);
                self.ages[column] = u32::try_from(state[1]).unwrap_or(u32::MAX);
            }
        }
        is_whole
    }

    /// Begins a step: all values are one step older, and those beyond their age limit become stale.
    #[inline]
    pub fn advance(&mut self) {
        for column in 0..self.values.len() {
            let age = self.ages[column].saturating_add(1);
            self.ages[column] = age;
            if age > self.limits[column] && self.is_valid(column) {
                self.mark(column, FieldResult::Stale);
            }
        }
    }

    /// Stores a value that arrived.
    #[inline]
    pub(crate) fn accept(&mut self, column: usize, value: f64) {
        self.values[column] = value;
        self.ages[column] = 0;
        self.results[column] = FieldResult::Value;
        self.invalid.remove(column);
    }

    /// Marks a signal as invalid; its value stays.
    #[inline]
    pub(crate) fn mark(&mut self, column: usize, result: FieldResult) {
        self.results[column] = result;
        self.invalid.insert(column);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_becomes_stale_beyond_its_age_limit_and_stays_finite() {
        let mut row = Row::new(2);
        row.limit_age(0, 2);
        assert!(!row.is_valid(0));
        row.advance();
        assert_eq!(row.ages(), [1, 1]);
        assert_eq!(row.results()[0], FieldResult::Missing);
        row.accept(0, 3.0);
        row.accept(1, 4.0);
        for (age, is_valid) in [(1, true), (2, true), (3, false), (4, false)] {
            row.advance();
            assert_eq!((row.ages()[0], row.is_valid(0)), (age, is_valid));
        }
        assert_eq!(row.results(), [FieldResult::Stale, FieldResult::Value]);
        assert_eq!(row.values(), [3.0, 4.0]);
        row.accept(0, 5.0);
        assert!(row.is_valid(0));
    }
}
