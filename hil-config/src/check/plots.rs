//! `[[plots]]`: existing signals.

use std::collections::BTreeSet;

use shared_types::describe::LawDescription;

use crate::expression::Columns;
use crate::plan::{Plot, Scale};
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Returns the valid plots and reports the others. Without columns, because plant, law or stimuli are faulty, names of
/// signals are not looked up.
pub(super) fn check(
    reader: &mut Reader,
    root: &Section<'_>,
    columns: Option<&Columns>,
    law: Option<&str>,
    all_laws: &[LawDescription],
) -> Vec<Plot> {
    let mut plots = Vec::new();
    for section in &reader.list(root, "plots") {
        reader.refuse_unknown(section, &[]);
        let title = reader.text(section, "title");
        let laws = laws(reader, section, all_laws);
        let scale = reader.text(section, "scale").map(|scale| match scale {
            "log" => Scale::Log,
            _ => Scale::Linear,
        });
        let lines = match section.table.get("lines") {
            Some(entry) => reader.numbers(&section.path_of("lines"), &entry.node),
            None => Some(Vec::new()),
        };
        let is_for = |law| laws.iter().flatten().any(|one| one == law);
        let is_shown =
            (laws.as_ref()).is_none_or(|laws| laws.is_empty() || law.is_some_and(is_for));
        let signals = signals(reader, section, columns.filter(|_| is_shown));
        if let (Some(title), Some(signals), Some(laws), Some(scale), Some(lines)) =
            (title, signals, laws, scale, lines)
        {
            plots.push(Plot {
                title: title.into(),
                signals,
                laws,
                scale,
                lines,
            });
        }
    }
    plots
}

fn signals(
    reader: &mut Reader,
    section: &Section<'_>,
    columns: Option<&Columns>,
) -> Option<Vec<String>> {
    let names = reader.texts(section, "signals")?;
    let mut are_known = true;
    for (path, place, name) in &names {
        let Some(columns) = columns.filter(|columns| columns.index_of(name).is_none()) else {
            continue;
        };
        are_known = false;
        let message = format!("`{path}` is `{name}`, which is not a signal of this run");
        let problem = reader.report(ProblemKind::UnknownName, path, place, message);
        problem.nearest = columns.nearest(name);
        if name.starts_with("internal.") {
            problem.help("if only some laws have it, name them in `laws`");
        }
    }
    let own = |name| columns.map_or(name, |columns| columns.own_name(name));
    let names = names.into_iter().map(|(_, _, name)| own(name).to_owned());
    are_known.then(|| names.collect())
}

fn laws(
    reader: &mut Reader,
    section: &Section<'_>,
    all_laws: &[LawDescription],
) -> Option<Vec<String>> {
    if section.table.get("laws").is_none() {
        return Some(Vec::new());
    }
    let names = reader.texts(section, "laws")?;
    // Two plants may each have a law of the same name.
    let law_names: BTreeSet<&str> = all_laws.iter().map(|law| law.name.as_str()).collect();
    let mut are_known = true;
    for (path, place, name) in &names {
        if law_names.contains(name) {
            continue;
        }
        are_known = false;
        let message = format!("`{path}` is `{name}`, which is not a law");
        reader
            .report(ProblemKind::UnknownName, path, place, message)
            .one_of(name, law_names.iter().copied());
    }
    let names = names.into_iter().map(|(_, _, name)| name.to_owned());
    are_known.then(|| names.collect())
}
