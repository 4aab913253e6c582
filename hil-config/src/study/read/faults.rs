//! Table of faults of a study: `[faults]`.

use super::super::faults::{APPENDED_FAULT, FaultKindTable, FaultTable, effect};
use super::super::{Sampling, Spread, Varied};
use super::Homes;
use crate::document::{Table, Value};
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};
use crate::source::Place;
use crate::study::FAULT;

/// Maximum number of faults of a study.
const MOST_FAULTS: usize = 100_000;
/// Keys of an effect that would move its onset.
const SKEWS: [&str; 2] = ["skew_s", "skew_steps"];
/// Expected form of a target.
const TARGET: &str = "the name of a target, or the key of a part, for example `actuator = 1`";
/// Expected form of a size.
const SIZE: &str = "keys of an effect as TOML, for example `bias = 0.01` or `factor = 0.7, profile = { kind = \"ramp\", duration_s = 0.2 }`, without target and file";
/// Expected form of a size with a skew.
const UNSKEWED: &str =
    "a size without `skew_s` and `skew_steps`: `onsets_s` has the time at which the effect begins";

/// Reads the table, if the study has one.
pub(super) fn faults(
    reader: &mut Reader,
    root: &Section<'_>,
    homes: &mut Homes,
) -> Option<FaultTable> {
    root.table.get("faults")?;
    if root.table.get("search").is_some() {
        let message = "the study has [search] beside [faults]";
        reader
            .report_at(root, "faults", ProblemKind::Mismatch, message)
            .expected("either one: a search chooses its own points");
    }
    let section = &reader.section(root, "faults")?;
    reader.refuse_unknown(section, &[]);
    homes.add(APPENDED_FAULT, section.place);
    homes.add("metrics[+]", section.place);
    let text = |reader: &mut Reader, key| reader.text(section, key).map(Into::into);
    let (detected, recovered) = (text(reader, "detected"), text(reader, "recovered"));
    let held_s = reader.number(section, "held_s")?;
    let onsets_s = match section.table.get("onsets_s") {
        Some(_) => Some(onsets(reader, section)?),
        None => None,
    };
    let mut table = FaultTable {
        detected,
        held_s,
        recovered,
        kinds: Vec::new(),
    };
    let mut places = Vec::new();
    for (number, own) in reader.list(section, "kinds").iter().enumerate() {
        homes.add(&format!("faults.kinds[{number}]"), own.place_of("kind"));
        if let Some((kind, places_of_kind)) = kind(reader, own, onsets_s.as_deref()) {
            table.kinds.push(kind);
            places.push(places_of_kind);
        }
    }
    if table.kinds.is_empty() && section.table.get("kinds").is_some() && reader.problems.is_empty()
    {
        let message = "the study tries no kind of fault";
        reader
            .report_at(section, "kinds", ProblemKind::OutOfRange, message)
            .expected("at least one table [[faults.kinds]]");
    }
    let count = |one: &FaultKindTable| {
        let targets = one.targets.as_ref().map_or(1, Vec::len);
        targets * one.sizes.len() * one.onsets_s.len()
    };
    let all: usize = table.kinds.iter().map(count).sum();
    if all > MOST_FAULTS {
        let message = format!("the study tries {all} faults");
        reader
            .report_at(section, "kinds", ProblemKind::OutOfRange, message)
            .expected(format!("at most {MOST_FAULTS}"));
        return None;
    }
    for fault in table.tried() {
        homes.add(&fault.flag(), &places[fault.place]);
    }
    Some(table)
}

/// Adds the varied value that chooses the fault, if all faults are known.
pub(super) fn chooses(table: &FaultTable) -> Option<Varied> {
    let tried = table.tried();
    (table.is_complete() && !tried.is_empty()).then(|| Varied {
        name: FAULT.into(),
        key: Some(APPENDED_FAULT.into()),
        spread: Spread::Choice(tried.iter().map(super::super::TriedFault::item).collect()),
        is_whole: false,
        nominal: None,
    })
}

/// Returns the sampling of a study with a table of faults, which tries every combination.
pub(super) fn sampling(reader: &mut Reader, root: &Section<'_>, own: Sampling) -> Sampling {
    if root.table.get("faults").is_none() || own == Sampling::Grid {
        return own;
    }
    if root.table.get("sampling").is_some() {
        let message = format!("[faults] with sampling = \"{}\"", own.name());
        reader
            .report_at(root, "sampling", ProblemKind::OutOfRange, message)
            .expected("grid, or no sampling: every fault is tried in every variant");
    }
    Sampling::Grid
}

/// Reads a kind with its targets, sizes and onsets; also returns its place.
fn kind(
    reader: &mut Reader,
    section: &Section<'_>,
    common_s: Option<&[f64]>,
) -> Option<(FaultKindTable, Place)> {
    reader.refuse_unknown(section, &[]);
    let kind = reader.text(section, "kind");
    let targets = match section.table.get("targets") {
        Some(_) => Some(texts(reader, section, "targets", |target| {
            let is_valid = target.is_empty() || !target.contains('=') || is_effect(target, "");
            (!is_valid).then_some(TARGET)
        })?),
        None => None,
    };
    let sizes = match section.table.get("sizes") {
        Some(_) => texts(reader, section, "sizes", |size| match is_effect("", size) {
            false => Some(SIZE),
            true => effect_table("", size)
                .is_some_and(|table| SKEWS.iter().any(|key| table.get(key).is_some()))
                .then_some(UNSKEWED),
        })?,
        None => vec![String::new()],
    };
    let onsets_s = match section.table.get("onsets_s") {
        Some(_) => onsets(reader, section)?,
        None => match common_s {
            Some(times_s) => times_s.to_vec(),
            None => onsets(reader, section)?, // reports that they are missing
        },
    };
    let duration_s = match section.table.get("duration_s") {
        Some(_) => Some(reader.number(section, "duration_s")?),
        None => None,
    };
    let kind = FaultKindTable {
        kind: kind?.into(),
        targets,
        sizes,
        onsets_s,
        duration_s,
    };
    Some((kind, section.place_of("kind").clone()))
}

/// Reads texts that no other one equals; `refusal` returns what is expected in place of an invalid one.
fn texts(
    reader: &mut Reader,
    section: &Section<'_>,
    key: &'static str,
    refusal: impl Fn(&str) -> Option<&'static str>,
) -> Option<Vec<String>> {
    let mut all: Vec<String> = Vec::new();
    let mut are_valid = true;
    for (path, place, text) in reader.texts(section, key)? {
        let text = text.trim();
        if let Some(expected) = refusal(text) {
            are_valid = false;
            let message = format!("`{path}` is `{text}`");
            reader
                .report(ProblemKind::Syntax, path, place, message)
                .expected(expected);
        } else if all.iter().any(|earlier| earlier == text) {
            are_valid = false;
            let message = format!("`{path}` is listed twice");
            reader.report(ProblemKind::Duplicate, path, place, message);
        } else {
            all.push(text.into());
        }
    }
    are_valid.then_some(all)
}

/// Returns `true` if target and size make an effect without a file, and the size no target.
fn is_effect(target: &str, size: &str) -> bool {
    effect_table(target, size)
        .is_some_and(|table| !names(&table, "file") && table.get("target").is_none())
}

/// Parses the effect of a target and a size.
fn effect_table(target: &str, size: &str) -> Option<Table> {
    let nowhere = Place {
        source: 0,
        span: 0..0,
    };
    match Value::parse(&format!("{{ {} }}", effect(target, size)), &nowhere) {
        Some(Value::Table(table)) => Some(table),
        _ => None,
    }
}

/// Returns `true` if a table or one inside it has a key.
fn names(table: &Table, key: &str) -> bool {
    table.entries().iter().any(|entry| {
        entry.key == key || matches!(&entry.node.value, Value::Table(inner) if names(inner, key))
    })
}

/// Reads times, each once.
fn onsets(reader: &mut Reader, section: &Section<'_>) -> Option<Vec<f64>> {
    let Some(entry) = section.table.get("onsets_s") else {
        reader.missing(section, &section.path_of("onsets_s"), "times in s".into());
        return None;
    };
    let path = section.path_of("onsets_s");
    let times_s = reader.numbers(&path, &entry.node)?;
    let is_wrong = |(place, time_s): (usize, &f64)| {
        *time_s < 0.0 || !time_s.is_finite() || times_s[..place].contains(time_s)
    };
    if times_s.is_empty() || times_s.iter().enumerate().any(is_wrong) {
        let message = format!("`{path}` is empty, or has a time below 0 or twice");
        reader
            .report(ProblemKind::OutOfRange, path, &entry.node.place, message)
            .expected("different times in s, at least one");
        return None;
    }
    Some(times_s)
}
