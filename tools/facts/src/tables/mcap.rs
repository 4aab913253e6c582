//! Tables in MCAP files: the signals of a recorded run, or fields of ROS 2 messages.

use std::path::Path;

use hil_config::table_file::{ColumnName, Objection, Refusal, TableSource, TakeRow};
use hil_recording::reader::{ReadError, RunReader};
use hil_recording::ros::{RosError, RosFile};
use shared_types::time::{Rate, Step};

const EXPECTED: &str = "a recording of hil, or ROS 2 messages in MCAP (CDR with ros2msg)";

/// Opens a file in which these columns are looked for.
pub(super) fn open(path: &Path, columns: &[&str]) -> Result<Box<dyn TableSource>, Refusal> {
    match RunReader::open(path) {
        Ok(reader) => Ok(Box::new(Recording::of(reader.without_digest())?)),
        Err(ReadError::Foreign { .. }) => Ok(Box::new(Messages::open(path, columns)?)),
        Err(error) => Err(refused(&error)),
    }
}

fn refused(error: &impl ToString) -> Refusal {
    Refusal::new(error.to_string(), EXPECTED)
}

/// Signals of a recorded run. The time of a record is that of its step, as in the run.
struct Recording {
    reader: RunReader,
    rate: Rate,
    names: Vec<ColumnName>,
    /// Word of each column in a record; the first column is the time.
    words: Vec<usize>,
}

impl Recording {
    fn of(reader: RunReader) -> Result<Self, Refusal> {
        let rate = reader.rate().map_err(|error| refused(&error))?;
        let signals = || {
            reader
                .columns()
                .iter()
                .enumerate()
                .filter(|(_, column)| column.is_signal())
        };
        let named = signals().map(|(_, column)| ColumnName::with_unit(&column.name, &column.unit));
        let names = std::iter::once(ColumnName::of("time_s"))
            .chain(named)
            .collect();
        let words = std::iter::once(0)
            .chain(signals().map(|(word, _)| word))
            .collect();
        Ok(Self {
            names,
            words,
            rate,
            reader,
        })
    }
}

impl TableSource for Recording {
    fn columns(&self) -> &[ColumnName] {
        &self.names
    }

    fn read(&mut self, chosen: &[usize], take: &mut TakeRow<'_>) -> Result<(), Refusal> {
        let mut numbers = vec![0.0; chosen.len()];
        // The last record of a run has no command: a missing value counts only before other rows.
        let mut missing: Option<Objection> = None;
        while self.reader.advance().map_err(|error| refused(&error))? {
            let step = self.reader.step();
            let words = self.reader.words();
            for (number, &column) in numbers.iter_mut().zip(chosen) {
                *number = match column {
                    0 => self.rate.seconds(Step(step)),
                    column => f64::from_bits(words[self.words[column]]),
                };
            }
            if let Some(objection) = missing.take() {
                return Err(objection.into());
            }
            let wrong = numbers.iter().position(|number| !number.is_finite());
            if let Some(at) = wrong {
                let name = &self.names[chosen[at]].name;
                missing = Some(Objection::new(
                    format!("`{name}` has no value at step {step}"),
                    "a signal with a value at every step",
                ));
                continue;
            }
            take(self.reader.records() as usize, &numbers)?;
        }
        Ok(())
    }
}

/// Fields of ROS 2 messages.
struct Messages {
    file: RosFile,
    names: Vec<ColumnName>,
}

impl Messages {
    fn open(path: &Path, columns: &[&str]) -> Result<Self, Refusal> {
        let file = RosFile::open(path, columns).map_err(|error| refused(&error))?;
        let named = file.fields().iter().map(|field| ColumnName::of(field));
        let names = std::iter::once(ColumnName::of("log_time [s]"))
            .chain(named)
            .collect();
        Ok(Self { file, names })
    }
}

impl TableSource for Messages {
    fn columns(&self) -> &[ColumnName] {
        &self.names
    }

    fn read(&mut self, chosen: &[usize], take: &mut TakeRow<'_>) -> Result<(), Refusal> {
        let fields: Vec<usize> = chosen
            .iter()
            .filter_map(|column| column.checked_sub(1))
            .collect();
        let mut row = Vec::new();
        let mut count = 0;
        let mut first_ns = None;
        let result = self.file.read(&fields, |time_ns, values| {
            count += 1;
            let since_ns = time_ns
                .wrapping_sub(*first_ns.get_or_insert(time_ns))
                .cast_signed();
            let mut values = values.iter();
            row.clear();
            row.extend(chosen.iter().map(|column| match column {
                0 => since_ns as f64 / 1e9,
                _ => values.next().copied().unwrap_or(f64::NAN),
            }));
            match row.iter().all(|number| number.is_finite()) {
                true => take(count, &row),
                false => Err(Objection::new(
                    format!("message {count} has a value that is not finite"),
                    "fields with a finite number in every message",
                )),
            }
        });
        result.map_err(|error| match error {
            RosError::Stopped(objection) => objection.into(),
            error => refused(&error),
        })
    }
}
