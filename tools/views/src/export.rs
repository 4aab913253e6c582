//! `hil export`: signals of a recorded run as a table for other programs.
//!
//! Reads the recording once and holds only a block of rows, so memory does not grow with the length of the run. The
//! output file appears complete or not at all. Values are the recorded ones, bit for bit; derived signals are
//! recomputed by the code that computed them during the run.

mod cell;
mod csv;
mod origin;
mod parquet;
mod selection;
mod table;

use std::io::{ErrorKind, IsTerminal};
use std::path::Path;

use hil_console::files::destination::{Destination, not_written};
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_console::terminal::progress::Progress;
use hil_facts::results::summary::{self, MarkAt};
use hil_recording::reader::RunReader;
use hil_verification::evidence::{self, Request};
use serde::Serialize;
use shared_types::number::{exact, unit_shown};
use shared_types::record::Event;
use shared_types::time::{Rate, Step};

use crate::arguments::export::{ExportArguments, ExportFormat};
use cell::Column;
use selection::{Offer, Selection};
use table::Table;

/// Number of records between two checks for Ctrl-C, at which progress is also updated.
const LOOK_RECORDS: u64 = 1024;

/// Runs the command.
///
/// # Errors
/// If the run cannot be read or lacks a requested signal or time, or if the file cannot be written.
pub fn export(arguments: &ExportArguments) -> Result<Exit, Failure> {
    let exported = match &arguments.evidence {
        Some(folder) => evidence(arguments, folder).map(Some),
        None => table(arguments, Interruption::listen()?),
    }?;
    if let Some(message) = exported {
        output::write(&message)?;
    }
    Ok(Exit::Pass)
}

/// Writes evidence of the runs and returns the message for the user.
fn evidence(arguments: &ExportArguments, folder: &Path) -> Result<String, Failure> {
    let evidence = evidence::write(&Request {
        runs: &arguments.runs,
        folder,
        needs: arguments.needs.as_deref(),
        may_replace: arguments.force,
    })?;
    if arguments.json {
        output::pretty(&evidence)
    } else {
        Ok(evidence.describe())
    }
}

/// Writes the requested table or list and returns the message for the user; `None` if interrupted.
///
/// # Errors
/// As [`export`].
pub fn table(
    arguments: &ExportArguments,
    interruption: Interruption,
) -> Result<Option<String>, Failure> {
    let [run] = &*arguments.runs else {
        return Err(Failure::usage(
            "a table is of one run; --evidence takes several",
        ));
    };
    let (from_s, until_s) = (arguments.from, arguments.until);
    if let (Some(from_s), Some(until_s)) = (from_s, until_s)
        && from_s > until_s
    {
        return Err(Failure::usage(format!(
            "--from {} is after --until {}",
            exact(from_s),
            exact(until_s)
        )));
    }
    let open = || RunReader::open(run);
    let mut reader = interruption.at_once(open)?.map_err(Failure::usage)?;
    let offer = Offer::of(&reader);
    if arguments.list {
        // Provenance is read before the first record.
        reader.advance().map_err(Failure::usage)?;
        let listed = offer.listed(&reader, &arguments.signal)?;
        return listing(&listed, arguments.json).map(Some);
    }
    let selection = Selection::new(&reader, offer, &arguments.signal, arguments.validity)?;
    let path = (arguments.output.as_deref()).filter(|path| *path != Path::new("-"));
    let format = format(arguments.format, path)?;
    if arguments.json && path.is_none() {
        return Err(Failure::usage(
            "--json and the table would both go to standard output; name a file with -o",
        ));
    }
    let destination = Destination::open(path, arguments.force)?;
    let picking = Picking {
        rate: reader.rate().map_err(Failure::usage)?,
        from_s: from_s.unwrap_or(0.0),
        until_s: until_s.unwrap_or(f64::INFINITY),
        every: arguments.every,
        first: None,
    };
    let columns = selection.columns.clone();
    let work = ExportPass {
        table: match format {
            ExportFormat::Csv => Table::Csv(csv::Csv::new(destination, &columns)),
            ExportFormat::Parquet => parquet::Parquet::new(destination, &columns)
                .map(Table::Parquet)
                .map_err(|error| not_written(path, &error))?,
        },
        reader,
        selection,
        picking,
        interruption,
    };
    let Some(exported) = work.run(path)? else {
        return Ok(None);
    };
    let exported = Exported {
        format: format.name(),
        every: arguments.every,
        columns,
        ..exported
    };
    if arguments.json {
        return output::pretty(&exported).map(Some);
    }
    Ok(path.is_some().then(|| exported.describe()))
}

/// Returns the format of the table: the requested format, or else the one that the file's extension implies.
fn format(choice: Option<ExportFormat>, path: Option<&Path>) -> Result<ExportFormat, Failure> {
    let (None, Some(path)) = (choice, path) else {
        return Ok(choice.unwrap_or(ExportFormat::Csv));
    };
    let ending = path.extension().and_then(|ending| ending.to_str());
    let formats = [ExportFormat::Csv, ExportFormat::Parquet];
    let named = formats
        .into_iter()
        .find(|format| ending.is_some_and(|ending| ending.eq_ignore_ascii_case(format.name())));
    named.ok_or_else(|| {
        let path = path.display();
        Failure::usage(format!(
            "{path} ends neither with .csv nor with .parquet; choose a format with --format"
        ))
    })
}

/// Renders the list of signals as a table or as JSON.
fn listing(signals: &[Column], as_json: bool) -> Result<String, Failure> {
    if as_json {
        #[derive(Serialize)]
        struct Listing<'a> {
            signals: &'a [Column],
        }
        return output::pretty(&Listing { signals });
    }
    use hil_console::terminal::table::{Table, left};
    let mut table = Table::new(0, [left(0); 2]);
    for Column { name, unit, .. } in signals {
        table.row(&[&name, &unit_shown(unit)]);
    }
    Ok(table.to_string())
}

/// Selection of the exported steps.
struct Picking {
    rate: Rate,
    from_s: f64,
    until_s: f64,
    every: u64,
    /// First exported step.
    first: Option<u64>,
}

impl Picking {
    /// Returns the time of a step if it is exported.
    fn time_s(&mut self, step: u64) -> Option<f64> {
        let time_s = self.rate.seconds(Step(step));
        if time_s < self.from_s || time_s > self.until_s {
            return None;
        }
        let first = *self.first.get_or_insert(step);
        // Counts steps, not rows, so that the spacing is kept across lost records.
        (step - first).is_multiple_of(self.every).then_some(time_s)
    }
}

/// Result of an export.
#[derive(Debug, Default, Serialize)]
struct Exported {
    file: Option<String>,
    format: &'static str,
    rows: u64,
    columns: Vec<Column>,
    first_step: u64,
    last_step: u64,
    from_s: f64,
    until_s: f64,
    every: u64,
    /// Name of the scenario.
    scenario: Option<String>,
    /// Digest of all readable records, whatever was selected from them.
    digest: String,
    /// `true` if the recording was finished.
    whole: bool,
    /// Marks set by observers.
    marks: Vec<MarkAt>,
}

impl Exported {
    fn describe(&self) -> String {
        let Self {
            rows,
            from_s,
            until_s,
            ..
        } = self;
        let (file, columns) = (self.file.as_deref().unwrap_or("-"), self.columns.len());
        format!("{file}: {rows} rows of {columns} columns, {from_s} to {until_s} s\n")
    }
}

/// Export in progress.
struct ExportPass {
    reader: RunReader,
    selection: Selection,
    picking: Picking,
    table: Table,
    interruption: Interruption,
}

impl ExportPass {
    /// Writes the table; `None` if the reader of standard output closed the pipe.
    fn run(mut self, path: Option<&Path>) -> Result<Option<Exported>, Failure> {
        let mut exported = Exported {
            file: path.map(|path| path.display().to_string()),
            ..Exported::default()
        };
        match self.rows(&mut exported) {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return unless_gone(path, &error),
            Err(failure) => return Err(failure),
        }
        let run = self.reader.path().display();
        if exported.rows == 0 {
            let (records, rate) = (self.reader.records(), self.picking.rate);
            return Err(Failure::usage(if records == 0 {
                format!("{run} has no steps")
            } else {
                let end_s = rate.seconds(Step(self.reader.step()));
                format!("no step of {run} lies in that window; the run ends at {end_s} s")
            }));
        }
        exported.scenario = self.reader.fact("scenario").map(str::to_owned);
        exported.digest = self.reader.digest();
        exported.whole = self.reader.is_whole();
        if let Some(torn) = self.reader.caveat() {
            let (step, rate) = (self.reader.step(), self.picking.rate);
            let time_s = rate.seconds(Step(step));
            tell!("note: {torn}; exported up to step {step} at {time_s} s");
        }
        if let Some(lost @ 1..) = self
            .reader
            .result("lost")
            .and_then(|n| n.parse::<u64>().ok())
        {
            tell!(
                "note: {lost} records were lost while {run} was written; their steps are missing"
            );
        }
        let metadata = origin::metadata(&self.reader, &self.selection.columns, &exported.marks);
        let written = (self.table.finish(&metadata)).and_then(Destination::complete);
        match written {
            Ok(()) => Ok(Some(exported)),
            Err(error) => unless_gone(path, &error),
        }
    }

    /// Writes the rows.
    fn rows(&mut self, exported: &mut Exported) -> Result<std::io::Result<()>, Failure> {
        let steps = self.reader.fact("steps").and_then(|n| n.parse().ok());
        // A progress bar would garble a table on the same terminal.
        let is_in_the_way = exported.file.is_none() && std::io::stdout().is_terminal();
        let mut progress =
            (!is_in_the_way).then(|| Progress::new(steps.unwrap_or(0), self.picking.rate, true));
        let mut cells = Vec::with_capacity(self.selection.columns.len());
        let mut marks = Vec::new();
        while self.reader.advance().map_err(Failure::usage)? {
            let step = self.reader.step();
            marks.extend(self.reader.events().iter().filter_map(Event::mark).cloned());
            if self.reader.records().is_multiple_of(LOOK_RECORDS) {
                self.interruption.check()?;
                if let Some(progress) = &mut progress {
                    progress.set(step);
                }
            }
            let Some(time_s) = self.picking.time_s(step) else {
                continue;
            };
            cells.clear();
            (self.selection).row(Step(step), time_s, self.reader.words(), &mut cells);
            if let Err(error) = self.table.row(&cells) {
                return Ok(Err(error));
            }
            if exported.rows == 0 {
                (exported.first_step, exported.from_s) = (step, time_s);
            }
            (exported.last_step, exported.until_s) = (step, time_s);
            exported.rows += 1;
        }
        // Marks set after the last record follow it in the file.
        marks.extend(self.reader.events().iter().filter_map(Event::mark).cloned());
        exported.marks = summary::marks(&marks, self.picking.rate);
        Ok(Ok(()))
    }
}

/// Maps a closed pipe, which is not a failure, to `None`, and any other write error to a failure.
fn unless_gone(path: Option<&Path>, error: &std::io::Error) -> Result<Option<Exported>, Failure> {
    match error.kind() {
        ErrorKind::BrokenPipe => Ok(None),
        _ => Err(not_written(path, error)),
    }
}

#[cfg(test)]
mod tests;
