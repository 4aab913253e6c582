//! Values of the signals in a record: recorded ones, measured times and ages, and derived ones.
//!
//! Used to draw recorded runs. Judges nothing and reads no file.

use std::ops::Range;

use hil_config::plan::Derived;
use hil_facts::results::evaluation::RecordEvaluation;
use hil_recording::reader::Column;
use shared_types::record::Validity;

/// Words of measured time and age that are worth a plot.
const TIMES: [&str; 7] = [
    "round_trip_ns",
    "controller_ns",
    "plant_ns",
    "late_ns",
    "sample_age_steps",
    "command_age_steps",
    "held_steps",
];

/// Conversion of records to values.
pub(crate) struct Rows {
    columns: Vec<Column>,
    /// Number of columns that are recorded; derived ones follow.
    recorded: usize,
    /// Successive words that are signals: indices among the values, and of the first word.
    signals: Vec<(Range<usize>, usize)>,
    /// Times and ages: index among the values, and of the word.
    times: Vec<(usize, usize)>,
    derived: Option<RecordEvaluation>,
    validity: Option<Validity>,
    /// Index of the first signal among the words.
    first: usize,
    valid_words: Vec<u64>,
    values: Vec<f64>,
}

impl Rows {
    /// Prepares the conversion of records with these words.
    pub(super) fn new(
        words: &[Column],
        validity: Option<Validity>,
        derived: Option<(Vec<Derived>, RecordEvaluation)>,
    ) -> Self {
        let mut columns = Vec::new();
        let (mut runs, mut times) = (Vec::<(Range<usize>, usize)>::new(), Vec::new());
        for (place, word) in words.iter().enumerate() {
            let is_time = TIMES.contains(&word.name.as_str());
            if word.is_signal() || is_time {
                let unit = match (is_time, word.name.as_str()) {
                    (false, _) => word.unit.as_str(),
                    (true, name) if name.ends_with("_steps") => "steps",
                    (true, _) => "ns",
                };
                let value = columns.len();
                match runs.last_mut() {
                    _ if is_time => times.push((value, place)),
                    Some((values, first))
                        if (values.end, *first + values.len()) == (value, place) =>
                    {
                        values.end += 1;
                    }
                    _ => runs.push((value..value + 1, place)),
                }
                let (name, unit) = (word.name.clone(), unit.to_owned());
                columns.push(Column { name, unit });
            }
        }
        let recorded = columns.len();
        let (signals, derived) = derived.unzip();
        let signals = signals.into_iter().flatten();
        columns.extend(signals.map(|one: Derived| Column {
            name: one.name,
            unit: one.unit,
        }));
        let first = words.iter().position(Column::is_signal);
        Self {
            values: vec![f64::NAN; columns.len()],
            recorded,
            columns,
            signals: runs,
            times,
            derived,
            validity,
            first: first.unwrap_or(0),
            valid_words: Vec::new(),
        }
    }

    /// Returns name and unit of each value.
    pub(crate) fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Returns the values of a record; NaN for those that are missing or marked invalid.
    pub(crate) fn values<'a>(&'a mut self, mut words: &'a [u64]) -> &'a [f64] {
        let mut invalid = (self
            .validity
            .iter()
            .flat_map(|validity| validity.invalid(words)))
        .peekable();
        if invalid.peek().is_some() {
            self.valid_words.clear();
            self.valid_words.extend_from_slice(words);
            for place in invalid {
                self.valid_words[self.first + place] = f64::NAN.to_bits();
            }
            words = &self.valid_words;
        }
        let (recorded, computed) = self.values.split_at_mut(self.recorded);
        for (values, first) in &self.signals {
            let words = &words[*first..*first + values.len()];
            for (value, word) in recorded[values.clone()].iter_mut().zip(words) {
                *value = f64::from_bits(*word);
            }
        }
        for (value, place) in &self.times {
            recorded[*value] = match words[*place] {
                // No time and no age: nothing was exchanged or due.
                0 => f64::NAN,
                word => word as f64,
            };
        }
        if let Some(evaluation) = &mut self.derived {
            computed.copy_from_slice(evaluation.record(words));
        }
        &self.values
    }
}
