//! Columns of a table, and the source of each in a record.

use std::collections::BTreeSet;

use glob::Pattern;
use hil_console::terminal::exit::Failure;
use hil_recording::reader::RunReader;
use shared_types::table::near;
use shared_types::time::Step;

use super::cell::{Cell, CellKind, Column};
use super::origin::{self, Derived};
use crate::plots::signal::own_names;

/// Columns selected for a table.
pub(super) struct Selection {
    /// Columns in order, beginning with `step` and `time_s`.
    pub(super) columns: Vec<Column>,
    sources: Vec<Source>,
    /// Derived signals, if at least one is selected.
    derived: Option<Derived>,
    /// Last step of the run, which has no command.
    last: Option<u64>,
}

/// Source of a column's cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    Step,
    Time,
    /// Word that holds a number.
    Number(usize),
    /// Word that holds a count.
    Count(usize),
    /// Measured time; 0 where nothing was measured.
    Measured(usize),
    /// Word of a sample-command exchange, which the last record of a run lacks.
    Exchanged(usize),
    /// Derived signal, by its index.
    Derived(usize),
    /// Bit that is set while a signal is invalid.
    Invalid {
        word: usize,
        bit: usize,
    },
}

/// Columns that a recording offers.
pub(super) struct Offer {
    /// Signals, then derived ones, then counts.
    pub(super) columns: Vec<Column>,
    sources: Vec<Source>,
    derived: Option<Derived>,
    /// Commands of a frame, in order.
    sent_commands: Option<Vec<String>>,
    /// Aliases of signals, each with the recorded name.
    aliases: Vec<(String, String)>,
    /// Reason for the absence of derived signals.
    why_not: Option<String>,
}

impl Offer {
    pub(super) fn of(reader: &RunReader) -> Self {
        let mut offer = Self {
            columns: Vec::new(),
            sources: Vec::new(),
            derived: None,
            sent_commands: None,
            aliases: Vec::new(),
            why_not: None,
        };
        let recorded = || reader.columns().iter().enumerate();
        for (word, column) in recorded().filter(|(_, column)| column.is_signal()) {
            offer.push(
                &column.name,
                &column.unit,
                CellKind::Number,
                Source::Number(word),
            );
        }
        let derived = origin::recorded_run(reader).and_then(|run| {
            offer.sent_commands = Some(run.sent_commands());
            offer.aliases = run.aliases();
            origin::derived(run, reader)
        });
        match derived {
            Ok(derived) => {
                for (number, signal) in derived.signals.iter().enumerate() {
                    let source = Source::Derived(number);
                    offer.push(&signal.name, &signal.unit, CellKind::Number, source);
                }
                offer.derived = Some(derived);
            }
            Err(why) => offer.why_not = Some(why),
        }
        // `step` is always present, and validity bits belong to their signals.
        let counts = recorded().filter(|(_, column)| {
            !column.is_signal() && column.name != "step" && !column.name.contains('[')
        });
        for (word, column) in counts {
            let source = match column.name.as_str() {
                "time_ns" | "epoch" => Source::Count(word),
                name if name.ends_with("_ns") => Source::Measured(word),
                _ => Source::Exchanged(word),
            };
            offer.push(&column.name, "", CellKind::Count, source);
        }
        offer
    }

    fn push(&mut self, name: &str, unit: &str, kind: CellKind, source: Source) {
        self.columns.push(Column {
            name: name.into(),
            unit: unit.into(),
            kind,
            is_optional: matches!(source, Source::Measured(_) | Source::Exchanged(_)),
        });
        self.sources.push(source);
    }

    /// Returns all columns, or the selected ones.
    ///
    /// # Errors
    /// If a pattern is invalid or matches nothing.
    pub(super) fn listed(
        &self,
        reader: &RunReader,
        patterns: &[String],
    ) -> Result<Vec<Column>, Failure> {
        if patterns.is_empty() {
            return Ok(self.columns.clone());
        }
        let indices = self.chosen(reader, patterns)?;
        Ok(indices
            .into_iter()
            .map(|index| self.columns[index].clone())
            .collect())
    }

    /// Returns the indices of the selected columns in the order of the patterns, or of all signals if there are no
    /// patterns.
    fn chosen(&self, reader: &RunReader, patterns: &[String]) -> Result<Vec<usize>, Failure> {
        let all = 0..self.columns.len();
        if patterns.is_empty() {
            if let Some(why) = &self.why_not {
                tell!("note: derived signals are left out: {why}");
            }
            return Ok(all
                .filter(|&index| self.columns[index].kind == CellKind::Number)
                .collect());
        }
        let (mut indices, mut listed) = (Vec::new(), BTreeSet::new());
        let names = self.columns.iter().map(|column| column.name.as_str());
        for text in &own_names(patterns, names, &self.aliases) {
            let pattern = Pattern::new(text)
                .map_err(|error| Failure::usage(format!("--signal `{text}`: {error}")))?;
            let mut matching = (all.clone())
                .filter(|&index| pattern.matches(&self.columns[index].name))
                .peekable();
            if matching.peek().is_none() {
                return Err(self.unknown(reader, text));
            }
            indices.extend(matching.filter(|index| listed.insert(*index)));
        }
        Ok(indices)
    }

    fn unknown(&self, reader: &RunReader, text: &str) -> Failure {
        let near = near(text, self.columns.iter().map(|column| column.name.as_str()));
        let mut message = format!("{} has no signal `{text}`{near}", reader.path().display());
        if let Some(why) = &self.why_not {
            message += &format!("\n  its derived signals are unknown: {why}");
        }
        Failure::usage(message + "\n  `hil export RUN --list` shows all")
    }

    /// Finds the bit that marks a signal as invalid; `None` if the signal has no such bit.
    fn invalid(&self, reader: &RunReader, name: &str) -> Result<Option<Source>, Failure> {
        let is_answer = name.starts_with("command.") || name.starts_with("internal.");
        let sent = match &self.sent_commands {
            None if is_answer => {
                let why = self.why_not.as_deref().unwrap_or_default();
                return Err(Failure::usage(format!(
                    "the validity bit of `{name}` is unknown: {why}"
                )));
            }
            sent => sent.as_deref().unwrap_or_default(),
        };
        let place = reader.invalid_bit(name, sent);
        Ok(place.map(|(first, bit)| Source::Invalid {
            word: first + bit / 64,
            bit: bit % 64,
        }))
    }
}

impl Selection {
    /// Selects columns from those that a recording offers.
    pub(super) fn new(
        reader: &RunReader,
        offer: Offer,
        patterns: &[String],
        validity: bool,
    ) -> Result<Self, Failure> {
        let column = |name: &str, unit: &str, kind| Column {
            name: name.into(),
            unit: unit.into(),
            kind,
            is_optional: false,
        };
        let mut columns = vec![
            column("step", "", CellKind::Count),
            column("time_s", "s", CellKind::Number),
        ];
        let mut sources = vec![Source::Step, Source::Time];
        for index in offer.chosen(reader, patterns)? {
            let offered = &offer.columns[index];
            columns.push(offered.clone());
            sources.push(offer.sources[index]);
            if validity && let Some(invalid) = offer.invalid(reader, &offered.name)? {
                columns.push(column(
                    &format!("{}.valid", offered.name),
                    "",
                    CellKind::Flag,
                ));
                sources.push(invalid);
            }
        }
        let needs_derived = sources
            .iter()
            .any(|source| matches!(source, Source::Derived(_)));
        Ok(Self {
            columns,
            sources,
            derived: offer.derived.filter(|_| needs_derived),
            last: reader.fact("steps").and_then(|steps| steps.parse().ok()),
        })
    }

    /// Fills the row of a record.
    pub(super) fn row(&mut self, step: Step, time_s: f64, words: &[u64], cells: &mut Vec<Cell>) {
        let derived = match &mut self.derived {
            Some(derived) => derived.of(words),
            None => &[],
        };
        cells.extend(self.sources.iter().map(|source| match *source {
            Source::Step => Cell::Count(step.0),
            Source::Time => Cell::Number(time_s),
            Source::Number(word) => Cell::Number(f64::from_bits(words[word])),
            Source::Measured(word) if words[word] == 0 => Cell::Missing,
            Source::Exchanged(_) if self.last == Some(step.0) => Cell::Missing,
            Source::Count(word) | Source::Measured(word) | Source::Exchanged(word) => {
                Cell::Count(words[word])
            }
            Source::Derived(number) => Cell::Number(derived[number]),
            Source::Invalid { word, bit } => Cell::Flag(words[word] >> bit & 1 == 0),
        }));
    }
}
