//! Recorded run as a panel shows it: described once, then read again wherever a page looks closer.
//!
//! 1. Opening reads the whole recording twice, as a report does: for its results and for the signals over an even grid.
//! 2. A wide part of the run is answered from that grid; a narrower one is read from the chunks that contain it.
//! 3. Figures between two cursors are computed from every step in between.
//!
//! Changes nothing, and never starts a program.

mod description;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use hil_console::terminal::exit::Failure;
use hil_facts::session::happening::Happening;
use hil_facts::session::writing::refuse_live;
use hil_recording::reader::{Column, FileEnd, RECORDING, ReadError, RunReader, SpanReader};
use serde_json::{Value, json};
use shared_types::time::{Rate, Step};
use tungstenite::Message;

use super::live_search::refusal;
use super::message::{ClientMessage, MOST_STRETCHES};
use super::reading::{Measured, Reading, Sums, widen};
use crate::plots::bounds::bounds;
use crate::plots::signal::own_names;
use crate::report::grid::Grid;
use crate::report::occurrences::Search;
use crate::report::plots::plots;
use crate::report::reading::Signals;
use crate::report::rows::Rows;
use crate::report::run::Run;

/// Recorded run.
pub(crate) struct Archive {
    path: PathBuf,
    rate: Rate,
    last: Step,
    /// Descriptions of the run and of its end, for pages.
    about: Value,
    state: Value,
    /// Signals that have values, in the order in which pages know them.
    columns: Vec<Column>,
    /// Index of each among the values of a record.
    places: Vec<usize>,
    /// All signals over even buckets of `even` steps.
    overview: Signals,
    even: u64,
    spans: SpanReader,
    rows: Mutex<Rows>,
    log: Vec<Happening>,
    /// Digest of the records.
    digest: Option<String>,
    /// Search by a formula, or the reason why there is none.
    search: Result<Search, String>,
}

impl Archive {
    /// Reads a run, given its folder or its recording, with plots of the signals that match some patterns.
    ///
    /// # Errors
    /// If there is no complete recording, a session still writes it, or no signal matches a pattern.
    pub(crate) fn open(path: &Path, patterns: &[String]) -> Result<Self, Failure> {
        let file = match path.is_dir() {
            true => path.join(RECORDING),
            false => path.to_owned(),
        };
        if file.exists() {
            refuse_live(&file).map_err(|failure| {
                let reason = failure.reason();
                Failure::usage(format!("{reason}; `hil panel` without RUN shows a session"))
            })?;
        }
        let run = Run::of(path, None)?;
        let reader = &run.outcome.reader;
        if let Some(damage) = &run.outcome.damage {
            return Err(Failure::usage(damage));
        }
        if let (Some(FileEnd::Torn(_)), Some(caveat)) = (reader.end().0, reader.caveat()) {
            return Err(Failure::usage(caveat));
        }
        let compared = run.plan().map(|plan| bounds(plan, run.end_s()));
        let (bounds, computed) = compared.unwrap_or_default();
        let grid = Grid::new(run.rate, run.last, &[]);
        let reading = run.reading(&computed);
        let overview = reading.signals(&grid).map_err(Failure::usage)?;
        let rows = reading.rows(reader);
        let is_there = |one: &Column| overview.get(&one.name).is_some();
        let known = rows.columns().iter().enumerate();
        let (places, columns): (Vec<usize>, Vec<Column>) = known
            .filter(|(_, one)| is_there(one))
            .map(|(place, one)| (place, one.clone()))
            .unzip();
        let names = columns.iter().map(|one| one.name.as_str());
        let patterns = crate::report::patterns(&own_names(patterns, names, &run.aliases()))?;
        let overviews = [overview];
        crate::report::refuse_unknown(&patterns, &overviews)?;
        let runs = [run];
        let plots = plots(&runs, &overviews, vec![bounds.clone()], &grid, &patterns);
        let ([run], [overview]) = (runs, overviews);
        Ok(Self {
            about: description::about(&run, &columns, &plots, &bounds),
            state: description::state(&run),
            search: Search::of(&run),
            spans: SpanReader::of(&run.outcome.reader).map_err(Failure::usage)?,
            log: account(&run).map_err(Failure::usage)?,
            even: Grid::even(run.last),
            digest: run.outcome.recorded.digest,
            rows: Mutex::new(rows),
            rate: run.rate,
            last: run.last,
            path: run.path,
            columns,
            places,
            overview,
        })
    }

    /// Names the run for a page that lays it over another.
    pub(super) fn label(&self) -> String {
        self.path.display().to_string()
    }

    /// Returns the digest of the records, unless the recording is an excerpt.
    pub(super) fn digest(&self) -> Option<&str> {
        self.digest.as_deref()
    }

    /// Returns the signals that have values.
    pub(super) fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Returns the events of the run.
    pub(super) fn log(&self) -> &[Happening] {
        &self.log
    }

    /// Answers a page whose signals have these names; `None` if there is nothing to answer.
    pub(super) fn answer(&self, message: &ClientMessage, names: &[String]) -> Option<Message> {
        let last = self.last.0;
        // Indices of the page, with those of this run.
        let known = |signals: &[usize]| -> Vec<(usize, usize)> {
            let own = |index: &usize| {
                let name = names.get(*index)?;
                let own = self.columns.iter().position(|one| one.name == *name);
                own.map(|own| (*index, own))
            };
            signals.iter().filter_map(own).collect()
        };
        Some(match message {
            ClientMessage::Read {
                number,
                from,
                to,
                most,
                signals,
                over,
            } => match self.read([*from.min(&last), *to.min(&last)], *most, &known(signals)) {
                Ok(reading) => reading.encode(*number, *over).into(),
                Err(error) => unreadable(&error),
            },
            ClientMessage::Measure {
                number,
                from,
                to,
                signals,
                over,
            } => match self.measure([*from.min(&last), *to.min(&last)], &known(signals)) {
                Ok(measured) => measured.json(*number, *over).to_string().into(),
                Err(error) => unreadable(&error),
            },
            ClientMessage::Where { number, formula } => {
                self.search(*number, formula).to_string().into()
            }
            _ => return None,
        })
    }

    /// Returns the names of the signals in the order in which pages know them.
    pub(super) fn names(&self) -> Vec<String> {
        self.columns.iter().map(|one| one.name.clone()).collect()
    }

    /// Reads signals from one step to another, in at most so many stretches.
    fn read(
        &self,
        [from, to]: [u64; 2],
        most: u64,
        signals: &[(usize, usize)],
    ) -> Result<Reading, ReadError> {
        let steps = to - from + 1;
        let mut length = steps.div_ceil(most.min(MOST_STRETCHES));
        let is_wide = length >= self.even && self.even > 1;
        if is_wide {
            length = length.next_multiple_of(self.even);
        }
        let first = from / length * length;
        let count = ((to - first) / length + 1) as usize;
        let mut ranges = vec![vec![[f64::NAN; 2]; count]; signals.len()];
        if is_wide {
            for (ranges, (_, own)) in ranges.iter_mut().zip(signals) {
                let envelope = self.overview.get(&self.columns[*own].name);
                let per_stretch = (length / self.even) as usize;
                let begin = (first / self.even) as usize;
                for (stretch, range) in ranges.iter_mut().enumerate() {
                    let buckets =
                        begin + stretch * per_stretch..begin + (stretch + 1) * per_stretch;
                    let values = buckets.filter_map(|bucket| envelope?.range(bucket));
                    values.flatten().for_each(|value| widen(range, value));
                }
            }
        } else {
            let mut rows = self.rows.lock().unwrap_or_else(PoisonError::into_inner);
            let (first_step, last_step) = (Step(first), Step(to));
            self.spans.read(first_step, last_step, |words| {
                let stretch = ((words[0] - first) / length) as usize;
                let values = rows.values(words);
                for (ranges, (_, own)) in ranges.iter_mut().zip(signals) {
                    widen(&mut ranges[stretch], values[self.places[*own]]);
                }
            })?;
        }
        let indices = signals.iter().map(|(index, _)| *index);
        Ok(Reading {
            first,
            length,
            count,
            signals: indices.zip(ranges).collect(),
        })
    }

    /// Computes the figures of signals from one step to another.
    fn measure(
        &self,
        [from, to]: [u64; 2],
        signals: &[(usize, usize)],
    ) -> Result<Measured, ReadError> {
        let mut sums = vec![Sums::default(); signals.len()];
        let mut rows = self.rows.lock().unwrap_or_else(PoisonError::into_inner);
        self.spans.read(Step(from), Step(to), |words| {
            let at = [words[0] == from, words[0] == to];
            let values = rows.values(words);
            for (sums, (_, own)) in sums.iter_mut().zip(signals) {
                sums.take(values[self.places[*own]], at);
            }
        })?;
        let figures = sums.iter().zip(signals);
        Ok(Measured {
            from,
            to,
            length: 1,
            signals: figures
                .map(|(sums, (index, _))| sums.figures(*index))
                .collect(),
        })
    }

    /// Describes the run for a page; `window_s` is the initial width of its time axis if it is not the whole run.
    pub(super) fn about(&self, window_s: Option<f64>) -> Value {
        let mut about = self.about.clone();
        if let Some(window_s) = window_s {
            about["window_s"] = window_s.into();
        }
        about
    }

    /// Describes the end of the run for a page.
    pub(super) const fn state(&self) -> &Value {
        &self.state
    }

    /// Answers a search: the intervals in which a formula holds, or the reason why there are none.
    fn search(&self, number: u32, formula: &str) -> Value {
        let search = self.search.as_ref().map_err(Clone::clone);
        match search.and_then(|search| search.occurrences(formula, &self.spans, self.last)) {
            Ok(result) => json!({
                "tell": "where", "number": number, "formula": formula, "intervals": result.intervals,
                "count": result.count, "steps": result.steps, "judged": result.judged,
            }),
            Err(error) => refusal(number, formula, &error),
        }
    }

    /// Refuses a run that cannot be laid over another of this rate.
    ///
    /// # Errors
    /// If the rates differ.
    pub(super) fn refuse_rate(&self, hz: f64) -> Result<(), Failure> {
        let own = self.rate.hz();
        if own == hz {
            return Ok(());
        }
        let label = self.label();
        Err(Failure::usage(format!(
            "--over {label} was recorded at {own} Hz, but the other run has {hz} Hz, so their steps differ in time"
        )))
    }

    /// Returns the rate in Hz.
    pub(super) fn hz(&self) -> f64 {
        self.rate.hz()
    }
}

/// Encodes the failure to read a recording.
fn unreadable(error: &ReadError) -> Message {
    let text = format!("the recording cannot be read any more: {error}");
    json!({ "tell": "unreadable", "text": text })
        .to_string()
        .into()
}

/// Reads the events of a run.
fn account(run: &Run) -> Result<Vec<Happening>, ReadError> {
    let mut reader = RunReader::open(&run.path)?.without_digest();
    let mut account = Vec::new();
    loop {
        let is_there = reader.advance()?;
        let events = reader.events().iter();
        account.extend(events.filter_map(|event| Happening::of(event, run.rate)));
        if !is_there {
            return Ok(account);
        }
    }
}
