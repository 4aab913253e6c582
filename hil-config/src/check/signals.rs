//! `[[derived]]` and `[[metrics]]`: names, expressions and windows.

use std::collections::HashSet;
use std::path::Path;

use shared_types::layout::is_name;
use shared_types::number::exact as number;
use shared_types::table::unit_of_name;

use super::run::Grid;
use super::tables;
use crate::document::{Node, Value};
use crate::expression::{Columns, Expression, ExpressionError, Group, Unit, is_reserved};
use crate::formula::is_operator;
use crate::keys::METRICS;
use crate::plan::{Derived, DerivedSource, Metric, Published, Window};
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Metric whose kind is an analysis, which is checked after stimuli and faults.
pub(super) struct Analysed<'a> {
    pub(super) name: &'a str,
    pub(super) kind: &'a str,
    /// Section, read according to the keys of its kind.
    pub(super) section: Section<'a>,
}

/// Returns the valid derived signals and metrics and reports the others. Without columns, because plant, law or stimuli
/// are faulty, names are not looked up. Every named derived signal becomes a column.
pub(super) fn check<'a>(
    reader: &mut Reader,
    root: &Section<'a>,
    columns: &mut Option<Columns>,
    grid: Option<Grid>,
    folder: &Path,
) -> (Vec<Derived>, Vec<Metric>, Vec<Analysed<'a>>) {
    let derived_sections = reader.list(root, "derived");
    let metric_sections = reader.list(root, "metrics");
    let mut names = HashSet::new();
    let later: HashSet<&str> = derived_sections
        .iter()
        .filter_map(|section| match &section.table.get("name")?.node.value {
            Value::Text(name) => Some(name.as_str()),
            _ => None,
        })
        .collect();

    let mut derived = Vec::new();
    for section in &derived_sections {
        reader.refuse_unknown(section, &[]);
        let name = name(reader, section, &mut names);
        let is_table = section.table.get("expression").is_none()
            && (TABLE_KEYS.iter()).any(|key| section.table.get(key).is_some());
        let (source, unit) = if is_table {
            table(reader, section, name, columns, (folder, grid)).unzip()
        } else {
            refuse_both(reader, section);
            computed(reader, section, name, columns, &later).unzip()
        };
        if let (Some(name), Some(unit), Some(source)) = (name, unit, source) {
            derived.push(Derived {
                name: name.into(),
                unit,
                source,
            });
        }
    }

    let (mut metrics, mut analysed) = (Vec::new(), Vec::new());
    for section in &metric_sections {
        let name = name(reader, section, &mut names);
        let kinds = METRICS.iter().map(|kind| (kind.name, kind.keys));
        let Some((kind, section)) = reader.of_kind(section, "metric", kinds) else {
            continue;
        };
        if kind != "expression" {
            analysed.extend(name.map(|name| Analysed {
                name,
                kind,
                section,
            }));
            continue;
        }
        let section = &section;
        let expression = expression(
            reader,
            section,
            "expression",
            columns.as_ref(),
            &HashSet::new(),
            Use::Metric,
        );
        let context = (expression.as_ref()).zip(columns.as_ref());
        let unit = name.and_then(|name| unit(reader, section, context, name));
        let windows = windows(reader, section, grid);
        let published = published(reader, section, windows.as_deref());
        let published_note = reader.text(section, "published_note").map(Into::into);
        if let (Some(name), Some(unit), Some(expression), Some(windows)) =
            (name, unit, expression, windows)
        {
            metrics.push(Metric {
                name: name.into(),
                unit,
                expression,
                windows,
                published,
                published_note,
            });
        }
    }
    (derived, metrics, analysed)
}

/// Keys of which one makes a derived signal a table.
const TABLE_KEYS: [&str; 3] = ["file", "time_s", "values"];

/// Refuses a derived signal that has both an expression and a table.
fn refuse_both(reader: &mut Reader, section: &Section<'_>) {
    let further = |key: &&crate::keys::Key| !matches!(key.name, "name" | "unit" | "expression");
    let mut keys = section.keys.iter().filter(further);
    if let Some(key) = keys.find(|key| section.table.get(key.name).is_some()) {
        let message = format!("`{}` beside an expression", section.path_of(key.name));
        reader
            .report_at(section, key.name, ProblemKind::Mismatch, message)
            .expected("either `expression`, or `file` and its keys");
    } else if section.table.get("expression").is_none() {
        let path = section.path_of("expression");
        reader.missing(section, &path, "an expression, or a `file`".into());
    }
}

/// Returns the source and the unit of a derived signal with an expression, and adds its column.
fn computed(
    reader: &mut Reader,
    section: &Section<'_>,
    name: Option<&str>,
    columns: &mut Option<Columns>,
    later: &HashSet<&str>,
) -> Option<(DerivedSource, String)> {
    let expression = (section.table.get("expression").is_some())
        .then(|| {
            let columns = columns.as_ref();
            expression(reader, section, "expression", columns, later, Use::Signal)
        })
        .flatten();
    let context = (expression.as_ref()).zip(columns.as_ref());
    let unit = name.and_then(|name| unit(reader, section, context, name));
    let is_converted = section.table.get("unit").is_none()
        && known_unit(context).is_some_and(|unit| unit.is_converted());
    if let (Some(name), Some(columns)) = (name, columns.as_mut()) {
        match unit.as_deref().unwrap_or_default() {
            "1" if is_converted => columns.push_converted(name),
            unit => columns.push_with_unit(Group::Derived, name, unit),
        }
    }
    Some((DerivedSource::Expression(expression?), unit?))
}

/// Returns the source and the unit of a derived signal that is a table, and adds its column.
fn table(
    reader: &mut Reader,
    section: &Section<'_>,
    name: Option<&str>,
    columns: &mut Option<Columns>,
    (folder, grid): (&Path, Option<Grid>),
) -> Option<(DerivedSource, String)> {
    let stated_unit = match section.table.get("unit") {
        Some(_) => reader.text(section, "unit"),
        None => name.and_then(unit_of_name),
    };
    let signal = tables::Signal {
        what: "a derived signal",
        name: name.unwrap_or_default(),
        unit: stated_unit,
    };
    let result = tables::check(reader, section, folder, grid, &signal);
    let unit = result.as_ref().and_then(|(_, unit)| unit.clone());
    let unit = unit
        .or(stated_unit.map(Into::into))
        .unwrap_or_else(|| "1".into());
    // A faulty file is reported once, not at each use of its signal.
    if let (Some(name), Some(columns)) = (name, columns.as_mut()) {
        columns.push_with_unit(Group::Derived, name, &unit);
    }
    Some((DerivedSource::Table(result?.0), unit))
}

/// Reads the expression over signals under a key of a section.
pub(super) fn signal(
    reader: &mut Reader,
    section: &Section<'_>,
    key: &'static str,
    columns: Option<&Columns>,
) -> Option<Expression> {
    let later = HashSet::new();
    expression(reader, section, key, columns, &later, Use::Signal)
}

/// Returns a valid name that nothing earlier has.
fn name<'a>(
    reader: &mut Reader,
    section: &Section<'a>,
    names: &mut HashSet<&'a str>,
) -> Option<&'a str> {
    let name = reader.text(section, "name")?;
    if !is_name(name) || is_reserved(name) || is_operator(name) {
        let expected =
            "a name of letters, digits and _ that is not a function, for example error_m";
        reader.refuse(section, "name", name, expected);
        return None;
    }
    if !names.insert(name) {
        let message = format!("a derived signal or metric is already named `{name}`");
        reader.report_at(section, "name", ProblemKind::Duplicate, message);
        return None;
    }
    Some(name)
}

/// Returns the unit under the key `unit`. Without that key, returns the unit of the expression among these columns, or
/// that of the name's suffix.
pub(super) fn unit(
    reader: &mut Reader,
    section: &Section<'_>,
    context: Option<(&Expression, &Columns)>,
    name: &str,
) -> Option<String> {
    if section.table.get("unit").is_some() {
        return reader.text(section, "unit").map(Into::into);
    }
    Some(implied_unit(context, name).unwrap_or_else(|| "1".into()))
}

/// Returns the unit implied by the expression or the name's suffix.
pub(super) fn implied_unit(context: Option<(&Expression, &Columns)>, name: &str) -> Option<String> {
    let unit = known_unit(context);
    let symbol = unit.as_ref().and_then(Unit::symbol);
    symbol.or_else(|| unit_of_name(name)).map(Into::into)
}

/// Returns the unit of an expression among these columns, as far as it is known.
fn known_unit<'a>(context: Option<(&'a Expression, &'a Columns)>) -> Option<Unit<'a>> {
    context.and_then(|(expression, columns)| expression.unit(columns).ok())
}

/// Purpose of an expression.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Use {
    /// A value at every step.
    Signal,
    /// A value for each window.
    Metric,
}

fn expression(
    reader: &mut Reader,
    section: &Section<'_>,
    key: &'static str,
    columns: Option<&Columns>,
    later: &HashSet<&str>,
    usage: Use,
) -> Option<Expression> {
    let text = reader.text(section, key)?;
    let expression = match Expression::parse(text) {
        Ok(expression) => expression,
        Err(error) => {
            report(reader, section, key, text, &error, None);
            return None;
        }
    };
    let no_columns = Columns::default();
    let all_columns = columns.unwrap_or(&no_columns);
    let mut errors = Vec::new();
    if columns.is_some() {
        errors = expression.unknown_names(all_columns);
        if errors.is_empty() {
            errors.extend(expression.unit(all_columns).err());
        }
    }
    // The kind of expression is known without columns.
    let misused = match usage {
        Use::Signal => expression.refuse_reduction(),
        Use::Metric => expression.refuse_signal(),
    };
    errors.extend(misused.err());
    let expression = match expression.with_own_names(all_columns) {
        Ok(expression) => Some(expression),
        Err(error) => {
            errors.push(ExpressionError::new(text, 0..text.len(), error.message));
            None
        }
    };
    for error in &errors {
        let name = &text[error.span.clone()];
        let is_later = later.contains(name);
        let help = is_later.then_some("a derived signal may use only those defined above it");
        report(reader, section, key, text, error, help);
    }
    expression.filter(|_| errors.is_empty())
}

/// Reports an error of an expression at its place in the file.
pub(super) fn report(
    reader: &mut Reader,
    section: &Section<'_>,
    key: &str,
    text: &str,
    error: &ExpressionError,
    help: Option<&str>,
) {
    let whole = section.place_of(key);
    let place = reader.sources.inside(whole, text, error.span.clone());
    let problem = reader.report(
        ProblemKind::Expression,
        section.path_of(key),
        &place,
        error.to_string(),
    );
    problem.nearest.clone_from(&error.nearest);
    problem.help = help.map(Into::into);
}

fn windows(reader: &mut Reader, section: &Section<'_>, grid: Option<Grid>) -> Option<Vec<Window>> {
    let Some(entry) = section.table.get("windows_s") else {
        return Some(Vec::new());
    };
    let path = section.path_of("windows_s");
    let Value::List(items) = &entry.node.value else {
        reader.wrong_type(
            &path,
            &entry.node,
            "a list of windows [[begin, end], ..] in s",
        );
        return None;
    };
    if items.is_empty() {
        let message = format!("`{path}` is empty");
        reader
            .report(ProblemKind::OutOfRange, &path, &entry.node.place, message)
            .expected("at least one window [begin, end], or no `windows_s` for the whole run");
        return None;
    }
    let windows: Vec<Option<Window>> = items
        .iter()
        .enumerate()
        .map(|(index, item)| window(reader, &format!("{path}[{index}]"), item, grid))
        .collect();
    windows.into_iter().collect()
}

/// Returns the valid published values; each must belong to a window of its metric.
fn published(
    reader: &mut Reader,
    section: &Section<'_>,
    windows: Option<&[Window]>,
) -> Vec<Published> {
    let mut published = Vec::new();
    for entry in reader.list(section, "published") {
        reader.refuse_unknown(&entry, &[]);
        let law = reader.text(&entry, "law");
        let value = reader.number(&entry, "value");
        let source = reader.text(&entry, "source");
        let window_s = window_s(reader, &entry, windows);
        if let (Some(law), Some(value), Some(source), Some(window_s)) =
            (law, value, source, window_s)
        {
            let (law, source) = (law.into(), source.into());
            published.push(Published {
                law,
                window_s,
                value,
                source,
            });
        }
    }
    published
}

fn window_s(
    reader: &mut Reader,
    entry: &Section<'_>,
    windows: Option<&[Window]>,
) -> Option<[f64; 2]> {
    let path = entry.path_of("window_s");
    let Some(node) = entry.table.get("window_s") else {
        reader.missing(entry, &path, "two numbers [begin, end] in s".into());
        return None;
    };
    let (start_s, end_s) = reader.pair(&path, &node.node, "s")?;
    let is_one = |window: &Window| window.start_s == start_s && window.end_s == end_s;
    if !windows?.iter().any(is_one) {
        let message = format!("`{path}` is not one of the metric's windows");
        reader
            .report(ProblemKind::OutOfRange, &path, &node.node.place, message)
            .expected("one of `windows_s`");
        return None;
    }
    Some([start_s, end_s])
}

fn window(reader: &mut Reader, path: &str, node: &Node, grid: Option<Grid>) -> Option<Window> {
    let (start_s, end_s) = reader.pair(path, node, "s")?;
    let (rate, run_end_s) = (grid?.rate, grid?.end_s());
    if !(start_s >= 0.0 && end_s <= run_end_s) {
        let message = format!(
            "`{path}` is [{}, {}], which is not inside the run",
            number(start_s),
            number(end_s)
        );
        reader
            .report(ProblemKind::OutOfRange, path, &node.place, message)
            .expected(format!("times from 0 to {} in s", number(run_end_s)));
        return None;
    }
    let first = rate.step_at_or_after(start_s);
    let Some(last) = (rate.step_at_or_before(end_s)).filter(|last| *last >= first) else {
        let message = format!("no step lies in `{path}`");
        reader
            .report(ProblemKind::OutOfRange, path, &node.place, message)
            .expected(format!(
                "a window that holds at least one step; steps are {} s apart",
                number(rate.period_s())
            ));
        return None;
    };
    Some(Window {
        start_s,
        end_s,
        first,
        last,
    })
}
