//! Tables over time: of a stimulus, or a derived signal that is a column of a file.

use std::path::Path;

use shared_types::number::exact as number;
use shared_types::table::derivative_of;
use shared_types::time::Step;
use shared_types::units::{Conversion, Unit};

use super::points::{self, Span};
use super::run::Grid;
use crate::keys::TABLE_FILE;
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};
use crate::scenario::advice_on_missing;
use crate::source::Place;
use crate::table::{AfterEnd, Interpolation, MOST_DERIVATIVES, PACKED, Points, Table};
use crate::table_file::{self, Choice, ColumnName, Refusal, Series};

/// Returns the points of a profile. Without a folder files are refused.
pub(super) fn of_profile(
    reader: &mut Reader,
    section: &Section<'_>,
    folder: Option<&Path>,
    what: &str,
) -> Option<points::Points> {
    let is_file = section.table.get("file").is_some();
    if !is_file
        || ["time_s", "values"]
            .iter()
            .any(|key| section.table.get(key).is_some())
    {
        return points::lists(reader, section, what);
    }
    let Some(folder) = folder else {
        let key = section.path_of("file");
        let message = format!("`{key}`: a running plant reads no files");
        reader
            .report_at(section, "file", ProblemKind::Unreadable, message)
            .expected("the numbers themselves");
        return None;
    };
    let mut series = series(reader, section, folder, &Choice::default())?;
    Some((series.time_s, series.columns.swap_remove(0)))
}

/// Signal that a table gives.
pub(super) struct Signal<'a> {
    /// Description of the table for messages, for example `a stimulus`.
    pub what: &'a str,
    /// Name.
    pub name: &'a str,
    /// Unit; `None` if it is that of the column.
    pub unit: Option<&'a str>,
}

/// Rows as written, before they are moved and scaled.
struct Rows {
    points: Points,
    /// Names of the columns in a file.
    names: Vec<ColumnName>,
    /// Last row for messages, if the end of the file needs a decision of the scenario.
    last: Option<String>,
    /// Time in s that is still to be subtracted.
    start_s: f64,
}

/// Returns the table of a section and the unit of its values, if known.
pub(super) fn check(
    reader: &mut Reader,
    section: &Section<'_>,
    folder: &Path,
    grid: Option<Grid>,
    signal: &Signal<'_>,
) -> Option<(Table, Option<String>)> {
    let interpolation = reader.text(section, "interpolation");
    let end = reader.text(section, "end");
    let repeat = reader.boolean(section, "repeat");
    let numbers = ["scale", "offset", "start_s"].map(|key| reader.number(section, key));
    let start_s = numbers[2].unwrap_or_default();
    let rows = match section.table.get("file") {
        Some(_) if !has_lists(section) => file(reader, section, folder, start_s),
        _ => lists(reader, section, signal.what, start_s),
    };
    let [Some(scale), Some(offset), Some(_)] = numbers else {
        return None;
    };
    let interpolation = Interpolation::ALL
        .into_iter()
        .find(|one| Some(one.name()) == interpolation)?;
    let end = AfterEnd::ALL
        .into_iter()
        .find(|one| Some(one.name()) == end)?;
    let (repeat, rows) = (repeat?, rows?);
    if repeat && section.table.get("end").is_some() {
        let message = "a table that repeats has no end";
        reader
            .report_at(section, "end", ProblemKind::Mismatch, message)
            .expected("`repeat` or `end`");
        return None;
    }
    let (conversions, unit) = conversions(reader, section, signal, &rows)?;
    let points = moved(&rows.points, &conversions, [scale, offset, rows.start_s])?;
    refuse_outside(reader, section, points.time_s(), start_s, repeat, grid)?;
    if let Some(last) = rows.last
        && !repeat
        && section.table.get("end").is_none()
    {
        refuse_early_end(reader, section, points.time_s(), &last, grid)?;
    }
    match Table::new(points, interpolation, repeat, end) {
        Ok(table) => Some((table, unit)),
        Err(message) => {
            reader
                .report_at(section, "interpolation", ProblemKind::Mismatch, message)
                .expected("another `interpolation` or `repeat`, or other rows");
            None
        }
    }
}

fn has_lists(section: &Section<'_>) -> bool {
    ["time_s", "values"]
        .iter()
        .any(|key| section.table.get(key).is_some())
}

/// Returns rows that stand in the scenario.
fn lists(reader: &mut Reader, section: &Section<'_>, what: &str, start_s: f64) -> Option<Rows> {
    let (time_s, values) = points::lists(reader, section, what)?;
    let mut is_legal = true;
    for key in TABLE_FILE.iter().filter(|key| key.name != "file") {
        if section.table.get(key.name).is_some() {
            let message = format!("`{}` without a file", section.path_of(key.name));
            reader
                .report_at(section, key.name, ProblemKind::Mismatch, message)
                .expected("`file`, or lists without it");
            is_legal = false;
        }
    }
    let mut columns = vec![values];
    for order in 1..=MOST_DERIVATIVES {
        let key = crate::table::list_key(order);
        let Some(entry) = section.table.get(&key) else {
            continue;
        };
        let path = section.path_of(&key);
        let list = reader.numbers(&path, &entry.node)?;
        if columns.len() != order || list.len() != time_s.len() {
            let message = format!("`{path}` has {} numbers", list.len());
            reader
                .report_at(section, &key, ProblemKind::Mismatch, message)
                .expected("as many numbers as times, and the derivatives of lower order too");
            return None;
        }
        columns.push(list);
    }
    Some(Rows {
        points: Points::new(time_s, columns).filter(|_| is_legal)?,
        names: Vec::new(),
        last: None,
        start_s,
    })
}

/// Returns rows of a file.
fn file(reader: &mut Reader, section: &Section<'_>, folder: &Path, start_s: f64) -> Option<Rows> {
    let name = reader.text(section, "file")?;
    let column = optional(reader, section, "column")?;
    let time = optional(reader, section, "time_column")?;
    let gap_s = reader.optional_number(section, "gap_s")?;
    let derivatives = match section.table.get("derivatives") {
        Some(_) => reader.texts(section, "derivatives")?,
        None => Vec::new(),
    };
    if derivatives.len() > MOST_DERIVATIVES {
        let message = format!("{} derivatives", derivatives.len());
        reader
            .report_at(section, "derivatives", ProblemKind::OutOfRange, message)
            .expected(format!(
                "the columns of {MOST_DERIVATIVES} derivatives at most"
            ));
        return None;
    }
    if Path::new(name)
        .extension()
        .is_some_and(|ending| ending == PACKED)
    {
        let points = packed(reader, section, folder, name)?;
        return Some(Rows {
            points,
            names: Vec::new(),
            last: None,
            start_s,
        });
    }
    let choice = Choice {
        column,
        derivatives: derivatives.iter().map(|(_, _, name)| *name).collect(),
        time,
        gap_s,
        start_s,
    };
    let series = series(reader, section, folder, &choice)?;
    Some(Rows {
        points: Points::new(series.time_s, series.columns)?,
        names: series.names,
        last: column.map(|_| format!("{} of {name}", series.last)),
        start_s: 0.0,
    })
}

/// Returns an optional text; the outer `None` for a faulty one.
fn optional<'a>(
    reader: &mut Reader,
    section: &Section<'a>,
    key: &'static str,
) -> Option<Option<&'a str>> {
    match section.table.get(key) {
        Some(_) => reader.text(section, key).map(Some),
        None => Some(None),
    }
}

/// Reads a packed file, as kept in the folder of a run. A run that was moved has it beside its scenario.
fn packed(reader: &mut Reader, section: &Section<'_>, folder: &Path, name: &str) -> Option<Points> {
    let path = folder.join(name);
    let beside = path
        .file_name()
        .map(|name| folder.join("tables").join(name));
    let path = match beside {
        Some(beside) if !path.exists() && beside.exists() => beside,
        _ => path,
    };
    // The plan may become a text in another folder.
    let path = std::path::absolute(&path).unwrap_or(path);
    match Points::read(&path) {
        Ok(points) => Some(points),
        Err(error) => {
            let message = format!("`{}`: {error}", path.display());
            reader
                .report_at(section, "file", ProblemKind::Unreadable, message)
                .expected("the points file that the run saved")
                .help("a run saves long tables in its folder `tables`; copy or move the whole folder of the run");
            None
        }
    }
}

/// Reads the rows of the file under the key `file` of a section.
pub(super) fn series(
    reader: &mut Reader,
    section: &Section<'_>,
    folder: &Path,
    choice: &Choice<'_>,
) -> Option<Series> {
    let name = reader.text(section, "file")?;
    let path = folder.join(name);
    let columns: Vec<&str> = choice
        .column
        .into_iter()
        .chain(choice.derivatives.iter().copied())
        .collect();
    let opened = table_file::open(&path, &columns, reader.formats);
    let result = match opened {
        Ok(opened) => opened.and_then(|mut source| table_file::read(&mut *source, choice)),
        Err(error) => {
            let (reason, help) = match error.kind() {
                std::io::ErrorKind::NotFound => (
                    "it does not exist".into(),
                    advice_on_missing(folder, name, "scenario"),
                ),
                _ => (error.to_string(), String::new()),
            };
            let message = format!("`{}` cannot be read: {reason}", path.display());
            reader
                .report_at(section, "file", ProblemKind::Unreadable, message)
                .expected(table_file::EXPECTED)
                .help(help);
            return None;
        }
    };
    result
        .map_err(|refusal| refuse(reader, section, &path, refusal))
        .ok()
}

/// Reports a file that is no table: at its line, or else at the key that names the file or a column.
fn refuse(reader: &mut Reader, section: &Section<'_>, path: &Path, refusal: Refusal) {
    let Refusal {
        line,
        message,
        expected,
        nearest,
        key,
    } = refusal;
    let name = path.display().to_string();
    let problem = match line {
        Some((number, text)) => {
            let span = 0..text.len();
            let source = reader.sources.add_line(name, text, number);
            let key = section.path_of("file");
            reader.report(ProblemKind::Syntax, key, &Place { source, span }, message)
        }
        None => {
            let kind = match key {
                Some(_) => ProblemKind::UnknownName,
                None => ProblemKind::Syntax,
            };
            let message = format!("`{name}`: {message}");
            reader.report_at(section, key.unwrap_or("file"), kind, message)
        }
    };
    problem.expected(expected).nearest = nearest;
}

/// Returns the conversion of each column into the unit of its signal, and that of the values.
fn conversions(
    reader: &mut Reader,
    section: &Section<'_>,
    signal: &Signal<'_>,
    rows: &Rows,
) -> Option<(Vec<Conversion>, Option<String>)> {
    let unit = signal.unit.map(str::to_owned);
    let unit = unit.or_else(|| rows.names.first()?.unit.clone());
    let mut all = vec![Conversion::IDENTITY; 1 + rows.points.derivatives()];
    for (order, column) in rows.names.iter().enumerate() {
        let (Some(from), Some(unit)) = (&column.unit, &unit) else {
            continue;
        };
        let to = match order {
            0 => unit.clone(),
            order => derivative_of(signal.name, unit, order).1,
        };
        // A unit without a conversion is converted by the scenario's own factor.
        let is_known = Unit::parse(from).is_ok();
        if *from == to || (!is_known && section.table.get("scale").is_some()) {
            continue;
        }
        let both = Unit::parse(from).ok().zip(Unit::parse(&to).ok());
        let Some(conversion) = both.and_then(|(from, to)| from.conversion_to(&to)) else {
            let name = &column.name;
            let message =
                format!("the column `{name}` is in {from}, which does not convert to {to}");
            let expected = match is_known {
                true => format!("a column in a unit of the dimension of {to}"),
                false => format!(
                    "a unit that converts to {to}, or `scale`, which converts the column as it is"
                ),
            };
            let key = match section.table.get("column") {
                Some(_) => "column",
                None => "file",
            };
            reader
                .report_at(section, key, ProblemKind::Mismatch, message)
                .expected(expected);
            return None;
        };
        all[order] = conversion;
    }
    Some((all, unit))
}

/// Returns the rows in the signal's unit, scaled, with an offset, and with the time at which the run begins as 0. Rows
/// that do not change share their numbers and their file.
fn moved(
    points: &Points,
    conversions: &[Conversion],
    [scale, offset, start_s]: [f64; 3],
) -> Option<Points> {
    let is_same = conversions.iter().all(Conversion::is_identity);
    if is_same && scale == 1.0 && offset == 0.0 && start_s == 0.0 {
        return Some(points.clone());
    }
    let time_s: Vec<f64> = match start_s {
        0.0 => points.time_s().to_vec(),
        start_s => points
            .time_s()
            .iter()
            .map(|time_s| time_s - start_s)
            .collect(),
    };
    let columns = conversions.iter().enumerate().map(|(order, conversion)| {
        let own = Conversion {
            factor: scale,
            offset: if order == 0 { offset } else { 0.0 },
        };
        let column = points.column(order).iter();
        column
            .map(|value| own.apply(conversion.apply(*value)))
            .collect()
    });
    Points::new(time_s, columns.collect())
}

/// Refuses a table that would be a constant during the run.
fn refuse_outside(
    reader: &mut Reader,
    section: &Section<'_>,
    time_s: &[f64],
    start_s: f64,
    repeat: bool,
    grid: Option<Grid>,
) -> Option<()> {
    let span = Span::of_run(grid.map_or(f64::INFINITY, |grid| grid.end_s()));
    // Passes follow the first one for ever.
    let is_outside = time_s.first()? > &grid.map_or(f64::INFINITY, |grid| grid.end_s());
    if repeat && !is_outside {
        return Some(());
    }
    let fits = points::refuse_outside(reader, section, time_s, &span);
    if fits.is_none()
        && let Some(problem) = reader.problems.last_mut()
    {
        let first_s = number(start_s + time_s[0]);
        problem.help(format!(
            "start_s = {first_s} begins the run with the first row"
        ));
    }
    fits
}

/// Refuses a file of chosen columns that ends before the last sample of the run: what follows is the scenario's to say.
/// The last row counts for as long as the one before it.
fn refuse_early_end(
    reader: &mut Reader,
    section: &Section<'_>,
    time_s: &[f64],
    last: &str,
    grid: Option<Grid>,
) -> Option<()> {
    let grid = grid?;
    let end_s = *time_s.last()?;
    let interval_s = match time_s {
        [.., before, last] => last - before,
        _ => 0.0,
    };
    let last_sample_s = grid.rate.seconds(Step(grid.steps.saturating_sub(1)));
    if (end_s + interval_s) * (1.0 + 1e-9) >= last_sample_s {
        return Some(());
    }
    let message = format!(
        "the table ends at {} s with {last}, but the run ends at {} s",
        number(end_s),
        number(grid.end_s())
    );
    reader
        .report_at(section, "file", ProblemKind::OutOfRange, message)
        .expected(format!(
            "end = \"hold\" (the last value stays) or \"zero\", repeat = true, or run.duration_s of at most {}",
            number(end_s)
        ));
    None
}
