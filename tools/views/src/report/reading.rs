//! Signals of a recorded run over a grid: the second reading of a report, and the overview of a recorded panel.
//!
//! All cores read a sound file, each some buckets of the grid from the chunks that contain them; a damaged or truncated
//! one is read in order as far as possible. The result is the same to the last bit.

use std::ops::Range;
use std::path::Path;
use std::thread;

use hil_config::plan;
use hil_facts::results::evaluation::RecordEvaluation;
use hil_facts::results::recorded_run::RecordedRun;
use hil_recording::reader::{ReadError, RunReader, SpanReader};
use shared_types::time::{Rate, Step};

use super::envelope::{Bucket, Envelope};
use super::grid::Grid;
use super::rows::Rows;

/// Maximum number of threads that read a run: more do not help, because memory is the limit.
const MOST_PARTS: usize = 4;

/// Inputs for reading the signals of a run.
pub(crate) struct Reading<'a> {
    pub(super) path: &'a Path,
    pub(super) rate: Rate,
    pub(super) last: Step,
    pub(super) run: Option<&'a RecordedRun>,
    /// Signals to compute in addition to those of the scenario.
    pub(super) extra: &'a [plan::Derived],
    /// Number of records of a file that was read to its end without any damage.
    pub(super) records: Option<u64>,
}

impl Reading<'_> {
    /// Reads the signals over a grid, including derived ones. A signal has no value where it is marked invalid.
    ///
    /// # Errors
    /// If the recording cannot be read any more.
    pub(crate) fn signals(&self, grid: &Grid) -> Result<Signals, ReadError> {
        let mut reader = RunReader::open(self.path)?.without_digest().patient();
        let in_parts = self
            .records
            .map(|records| self.in_parts(&reader, grid, records));
        let mut signals = match in_parts.transpose()?.flatten() {
            Some(signals) => signals,
            None => {
                let mut part = Part::new(self.rows(&reader), grid, self.rate, 0..grid.len());
                // If later records are damaged, shows those read so far.
                while let Ok(true) = reader.advance() {
                    part.take(reader.words());
                }
                part.signals().0
            }
        };
        signals.forget_missing();
        Ok(signals)
    }

    /// Reads the signals of a sound file by all cores, each a part of the buckets, so that every bucket gets its values
    /// in their order; `None` if some records are not in chunks.
    fn in_parts(
        &self,
        reader: &RunReader,
        grid: &Grid,
        records: u64,
    ) -> Result<Option<Signals>, ReadError> {
        let threads =
            thread::available_parallelism().map_or(1, |cores| cores.get().min(MOST_PARTS));
        let begin = |part: usize| match part == threads {
            true => grid.len(),
            false => {
                let step = Step(self.last.0 * part as u64 / threads as u64);
                grid.bucket(0, self.rate.nanoseconds(step))
            }
        };
        let spans = SpanReader::of(reader)?;
        let read = |part: usize, rows: Rows| {
            let buckets = begin(part)..begin(part + 1);
            let steps = grid.span(buckets.clone(), self.rate, self.last);
            let mut part = Part::new(rows, grid, self.rate, buckets.clone());
            spans.read(steps[0], steps[1], |words| part.take(words))?;
            Ok((part.signals(), buckets))
        };
        let parts: Vec<Result<_, ReadError>> = thread::scope(|scope| {
            let read = &read;
            let started = (0..threads).map(|part| {
                let rows = self.rows(reader);
                scope.spawn(move || read(part, rows))
            });
            let started: Vec<_> = started.collect();
            let ended = started.into_iter().map(|thread| match thread.join() {
                Ok(part) => part,
                Err(panic) => std::panic::resume_unwind(panic),
            });
            ended.collect()
        });
        let mut signals: Option<Signals> = None;
        let mut count = 0;
        for part in parts {
            let ((part, records), buckets) = part?;
            count += records;
            match &mut signals {
                None => signals = Some(part),
                Some(signals) => signals.insert(&part, &buckets),
            }
        }
        Ok(signals.filter(|_| count == records))
    }

    /// Prepares the conversion of records to values.
    pub(crate) fn rows(&self, reader: &RunReader) -> Rows {
        let validity = self.run.map(|run| run.validity(reader));
        Rows::new(reader.columns(), validity, self.derived(reader))
    }

    /// Returns the derived and the extra signals with their evaluation; `None` for an excerpt, which lacks their
    /// inputs.
    fn derived(&self, reader: &RunReader) -> Option<(Vec<plan::Derived>, RecordEvaluation)> {
        let run = self.run.filter(|_| !reader.is_excerpt())?;
        let (columns, _) = run.columns(reader).ok()?;
        let mut plan = run.plan.clone().without_judgement();
        let is_known = |name: &str| {
            columns.index_of(name).is_some() || plan.derived.iter().any(|one| one.name == name)
        };
        let can_be = |one: &&plan::Derived| {
            (one.source.expression()).is_none_or(|expression| expression.signals().all(is_known))
        };
        let extra: Vec<_> = self.extra.iter().filter(can_be).cloned().collect();
        plan.derived.extend(extra);
        let evaluation = run.evaluation(reader, &plan).ok()?;
        Some((plan.derived, evaluation))
    }
}

/// Signals in some buckets of a grid, while records are read.
struct Part<'a> {
    rows: Rows,
    grid: &'a Grid,
    rate: Rate,
    buckets: Range<usize>,
    /// Bucket of the last record.
    bucket: usize,
    /// Values in that bucket so far.
    open: Bucket,
    /// Number of records in the buckets.
    records: u64,
    signals: Signals,
}

impl<'a> Part<'a> {
    fn new(rows: Rows, grid: &'a Grid, rate: Rate, buckets: Range<usize>) -> Self {
        let mut signals = Signals {
            records: vec![0; grid.len()],
            ..Signals::default()
        };
        for column in rows.columns() {
            signals.push(&column.name, &column.unit, grid);
        }
        Self {
            rows,
            grid,
            rate,
            // Records may begin before the first bucket.
            bucket: buckets.start.saturating_sub(1),
            records: 0,
            open: Bucket::new(signals.envelopes.len()),
            buckets,
            signals,
        }
    }

    /// Adds a record, unless it is outside of the buckets.
    fn take(&mut self, words: &[u64]) {
        let time_ns = self.rate.nanoseconds(Step(words[0]));
        let bucket = self.grid.bucket(self.bucket, time_ns);
        if bucket != self.bucket {
            self.close();
            self.bucket = bucket;
        }
        if !self.buckets.contains(&self.bucket) {
            return;
        }
        self.records += 1;
        self.signals.records[self.bucket] += 1;
        self.open.take(self.rows.values(words));
    }

    /// Ends the bucket of the last record.
    fn close(&mut self) {
        self.open.close(&mut self.signals.envelopes, self.bucket);
    }

    /// Returns the signals of all records, and their number.
    fn signals(mut self) -> (Signals, u64) {
        self.close();
        (self.signals, self.records)
    }
}

/// Signals of a run over a grid.
#[derive(Default)]
pub struct Signals {
    names: Vec<(String, String)>,
    envelopes: Vec<Envelope>,
    /// Number of records in each bucket.
    records: Vec<u32>,
}

impl Signals {
    fn push(&mut self, name: &str, unit: &str, grid: &Grid) {
        self.names.push((name.to_owned(), unit.to_owned()));
        self.envelopes.push(Envelope::new(grid.len()));
    }

    /// Takes over some buckets of the same signals.
    fn insert(&mut self, other: &Self, buckets: &Range<usize>) {
        for (own, other) in self.envelopes.iter_mut().zip(&other.envelopes) {
            own.insert(other, buckets.clone());
        }
        self.records[buckets.clone()].copy_from_slice(&other.records[buckets.clone()]);
    }

    /// Removes signals that never had a value.
    fn forget_missing(&mut self) {
        let names = std::mem::take(&mut self.names);
        let envelopes = std::mem::take(&mut self.envelopes);
        (self.names, self.envelopes) = (names.into_iter().zip(envelopes))
            .filter(|(_, envelope)| envelope.exists())
            .unzip();
    }

    /// Returns name, unit and envelope of each signal.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &str, &Envelope)> {
        let names = self.names.iter();
        (names.zip(&self.envelopes))
            .map(|((name, unit), envelope)| (name.as_str(), unit.as_str(), envelope))
    }

    /// Returns the number of records in each bucket.
    pub(super) fn records(&self) -> impl Iterator<Item = u32> {
        self.records.iter().copied()
    }

    /// Returns the envelope of a signal.
    pub fn get(&self, name: &str) -> Option<&Envelope> {
        self.iter()
            .find(|one| one.0 == name)
            .map(|(.., envelope)| envelope)
    }
}
