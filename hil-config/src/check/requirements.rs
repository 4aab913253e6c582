//! `[[requirements]]`: names and formulas.

use std::collections::HashSet;

use super::run::Grid;
use super::signals::report;
use crate::expression::Columns;
use crate::formula::Formula;
use crate::monitor::{FormulaContext, Monitors};
use crate::plan::{Derived, Requirement, Trace};
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};
use crate::title::{IDENTIFIER, TITLE, is_identifier, is_title};

/// Returns the valid requirements and reports the others. Without columns, because plant, law or stimuli are faulty,
/// names are not looked up, and without a grid windows are not checked.
pub(super) fn check(
    reader: &mut Reader,
    root: &Section<'_>,
    columns: Option<&Columns>,
    derived: &[Derived],
    grid: Option<Grid>,
) -> Vec<Requirement> {
    let sections = reader.list(root, "requirements");
    let context = (columns.zip(grid))
        .map(|(columns, grid)| FormulaContext::new(columns, derived, grid.rate, grid.steps));
    let mut names = HashSet::new();
    let mut ids = HashSet::new();
    let mut requirements = Vec::new();
    for section in &sections {
        reader.refuse_unknown(section, &[]);
        let name = name(reader, section, &mut names);
        let description = reader.text(section, "description").unwrap_or_default();
        let unit = reader.text(section, "unit");
        let trace = Trace {
            id: id(reader, section, &mut ids),
            verifies: verifies(reader, section),
        };
        let formula = formula(reader, section, columns, context.as_ref());
        if let (Some(name), Some(formula)) = (name, formula) {
            let implied = columns.and_then(|columns| formula.unit(columns).ok()?);
            requirements.push(Requirement {
                name: name.into(),
                description: description.into(),
                unit: unit.map_or_else(|| implied.unwrap_or_default(), Into::into),
                formula,
                trace,
            });
        }
    }
    requirements
}

/// Returns a valid identifier that no earlier requirement has.
fn id(reader: &mut Reader, section: &Section<'_>, ids: &mut HashSet<String>) -> Option<String> {
    let id = reader.text(section, "id")?;
    if !is_identifier(id) {
        reader.refuse(section, "id", id, IDENTIFIER);
        return None;
    }
    if !ids.insert(id.into()) {
        let message = format!("another requirement already has the id `{id}`");
        reader.report_at(section, "id", ProblemKind::Duplicate, message);
        return None;
    }
    Some(id.into())
}

/// Returns the valid identifiers of verified requirements, each once.
fn verifies(reader: &mut Reader, section: &Section<'_>) -> Vec<String> {
    let mut verifies: Vec<String> = Vec::new();
    for (path, place, id) in reader.texts(section, "verifies").unwrap_or_default() {
        if !is_identifier(id) {
            let message = format!("`{path}` is `{id}`");
            reader
                .report(ProblemKind::OutOfRange, &path, place, message)
                .expected(IDENTIFIER);
        } else if verifies.iter().any(|earlier| earlier == id) {
            let message = format!("`{id}` is listed twice");
            reader.report(ProblemKind::Duplicate, &path, place, message);
        } else {
            verifies.push(id.into());
        }
    }
    verifies
}

/// Returns a valid name that no earlier requirement has.
fn name<'a>(
    reader: &mut Reader,
    section: &Section<'a>,
    names: &mut HashSet<&'a str>,
) -> Option<&'a str> {
    let name = reader.text(section, "name")?;
    if !is_title(name) {
        reader.refuse(section, "name", name, TITLE);
        return None;
    }
    if !names.insert(name) {
        let message = format!("a requirement is already named `{name}`");
        reader.report_at(section, "name", ProblemKind::Duplicate, message);
        return None;
    }
    Some(name)
}

fn formula(
    reader: &mut Reader,
    section: &Section<'_>,
    columns: Option<&Columns>,
    context: Option<&FormulaContext<'_>>,
) -> Option<Formula> {
    let text = reader.text(section, "formula")?;
    let (formula, errors) = match Formula::parse(text) {
        Ok(formula) => {
            let mut errors =
                columns.map_or_else(Vec::new, |all_columns| formula.unknown_names(all_columns));
            if let (Some(all_columns), true) = (columns, errors.is_empty()) {
                errors.extend(formula.unit(all_columns).err());
            }
            if let (Some(context), true) = (context, errors.is_empty()) {
                errors.extend(Monitors::new([&formula], context).err());
            }
            (Some(formula), errors)
        }
        Err(error) => (None, vec![error]),
    };
    for error in &errors {
        report(reader, section, "formula", text, error, None);
    }
    let formula = formula.filter(|_| errors.is_empty())?;
    match columns {
        Some(columns) => formula.with_own_names(columns).ok(),
        None => Some(formula),
    }
}
