//! Tables of an FMU: the mapping of variables to signals and parameters with their names, and the variables that are
//! left out.
//!
//! The tables follow only from the model description, so an FMU can be described without loading its library.
//! Variables keep their order; an array has one column per element, and is included or left out as a whole.

use std::collections::BTreeSet;

use glob::Pattern;
use shared_types::describe::{DirectDependency, Imported, Invalid, LeftOut};
use shared_types::frame::MAX_SIGNALS;
use shared_types::layout::{MOST_FIELDS, is_line};
use shared_types::spelling::{spelled, spelled_all};
use shared_types::table::Field;

use super::description::{
    Causality, ContinuousState, ModelDescription, Variable, VariableType, Version,
};
use super::settable::{is_settable_text, with_initial_value};
use aliases::Aliases;
use units::Units;

mod aliases;
mod units;

/// Maximum length of a column's description.
const LONGEST_TEXT: usize = 500;
/// Prefixes of the names of inputs that are reference signals of a controller.
const REFERENCE: [&str; 2] = ["reference.", "reference_"];

/// Column of a table: one element of a variable.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Name, unit and range.
    pub field: Field,
    /// Index of the variable in the model description.
    pub(super) variable: usize,
    /// Index of the element in the variable.
    pub(super) element: usize,
}

/// Columns of an FMU, by role.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tables {
    /// Parameters, of which the tunable ones can be faulted.
    pub parameters: Vec<Column>,
    /// Inputs.
    pub inputs: Vec<Column>,
    /// Outputs.
    pub outputs: Vec<Column>,
    /// Requested local signals.
    pub locals: Vec<Column>,
    /// Continuous states, if the FMU differentiates its equations by them; no run uses these.
    pub states: Vec<Column>,
    /// Further facts about the import.
    pub imported: Imported,
}

impl Tables {
    /// Builds the tables of a model, including the local signals whose names, in the model or here, match a pattern.
    ///
    /// # Errors
    /// If two names conflict, or a pattern matches nothing.
    pub fn of(model: &ModelDescription, patterns: &[Pattern]) -> Result<Self, Invalid> {
        let units = Units::of(model);
        let mut tables = Self {
            imported: imported(model, &units),
            ..Self::default()
        };
        let mut matched = vec![false; patterns.len()];
        let aliases = Aliases::of(model);
        for (place, variable) in model.variables.iter().enumerate() {
            if aliases.is_alias(place) {
                // A pattern for this variable requests the signal, which may be available as an output.
                is_requested(&aliases.names_of_inner(place), patterns, &mut matched);
                let reason = unsupported(variable, variable.causality == Causality::Parameter);
                if let Some(reason) = reason.filter(|_| !aliases.is_usable(place)) {
                    tables.leave_out(variable, reason);
                }
                continue;
            }
            if let Some(other) = aliases.set_by(place) {
                let name = &model.variables[other].name;
                tables.leave_out(
                    variable,
                    format!("it is an alias of {name:?} in another unit or size; set that one"),
                );
                continue;
            }
            let is_parameter = variable.causality == Causality::Parameter;
            let reason = match variable.causality {
                Causality::Independent => continue,
                Causality::StructuralParameter => {
                    Some("it determines array sizes; set it in `structural`".into())
                }
                _ => unsupported(variable, is_parameter),
            };
            let elements = 0..variable.elements();
            let columns = elements.map(|element| column(variable, place, element, &units));
            let columns: Result<Vec<Column>, _> = match reason {
                Some(reason) => Err(Invalid(reason)),
                None => columns.collect(),
            };
            let columns = match columns {
                Ok(columns) => columns,
                Err(Invalid(reason)) => {
                    tables.leave_out(variable, reason);
                    continue;
                }
            };
            let (table, most) = match variable.causality {
                Causality::Parameter => (&mut tables.parameters, MOST_FIELDS),
                Causality::Input => (&mut tables.inputs, MAX_SIGNALS),
                Causality::Output => (&mut tables.outputs, MAX_SIGNALS),
                _ => {
                    let names = columns.iter().map(|column| &column.field.name);
                    (tables.imported.locals).extend(names.cloned());
                    let is_selected =
                        is_requested(&aliases.names_of_inner(place), patterns, &mut matched);
                    if !is_selected {
                        continue;
                    }
                    (&mut tables.locals, MOST_FIELDS - MAX_SIGNALS)
                }
            };
            if table.len() + columns.len() > most {
                tables.leave_out(
                    variable,
                    format!("it exceeds the limit of {most} of its kind"),
                );
            } else {
                table.extend(columns);
            }
        }
        // "All signals" may be none.
        let is_all = |pattern: &Pattern| pattern.as_str().chars().all(|c| c == '*');
        let is_without = |(pattern, matched): (&Pattern, &bool)| !matched && !is_all(pattern);
        if let Some(place) = patterns.iter().zip(&matched).position(is_without) {
            let pattern = patterns[place].as_str();
            return Err(Invalid(format!(
                "no inner signal of the FMU matches {pattern:?}; list them with `hil describe`"
            )));
        }
        tables.states = states(model, &units);
        let names = tables.states.iter().map(|column| &column.field.name);
        tables.imported.continuous_states = names.cloned().collect();
        tables.check_names(model)?;
        aliases.give_to(&mut tables);
        tables.imported.direct = tables.direct(model);
        Ok(tables)
    }

    /// Returns the inputs as a controller has them: measured signals, and reference signals under the names of
    /// stimuli.
    #[must_use]
    pub fn split_inputs(&self) -> (Vec<Field>, Vec<Field>) {
        let (mut measured, mut reference) = (Vec::new(), Vec::new());
        for column in &self.inputs {
            match reference_name(&column.field.name) {
                Some(name) => reference.push(Field {
                    name: name.into(),
                    aliases: (column.field.aliases.iter())
                        .map(|alias| reference_name(alias).unwrap_or(alias).to_owned())
                        .filter(|alias| alias != name)
                        .collect(),
                    ..column.field.clone()
                }),
                None => measured.push(column.field.clone()),
            }
        }
        (measured, reference)
    }

    fn leave_out(&mut self, variable: &Variable, reason: String) {
        let name = line(&variable.name, LONGEST_TEXT);
        self.imported.left_out.push(LeftOut { name, reason });
    }

    /// Checks that the names in each table are distinct, here and in a recording.
    fn check_names(&self, model: &ModelDescription) -> Result<(), Invalid> {
        let truth = self.outputs.iter().chain(&self.locals);
        let tables: [Vec<&Column>; 3] = [
            self.parameters.iter().collect(),
            self.inputs.iter().collect(),
            truth.collect(),
        ];
        for table in tables {
            let foreign =
                |column: &&Column| model.variables[column.variable].element_name(column.element);
            let names: Vec<String> = table.iter().map(foreign).collect();
            spelled_all(&names).map_err(|error| Invalid(error.to_string()))?;
        }
        Ok(())
    }

    /// Returns the outputs that depend directly on inputs, as far as both have columns.
    fn direct(&self, model: &ModelDescription) -> Vec<DirectDependency> {
        let mut direct = Vec::new();
        for output in self.outputs.iter().filter(|output| output.element == 0) {
            let variable = &model.variables[output.variable];
            let dependency = model.dependencies.iter();
            let dependency =
                { dependency }.find(|dependency| dependency.output == variable.reference);
            // Without a declaration, it may depend on all of them.
            let on: Option<BTreeSet<u32>> = dependency
                .and_then(|dependency| dependency.on.as_ref())
                .map(|on| on.iter().copied().collect());
            let is_one = |input: &&Column| {
                let input = &model.variables[input.variable];
                on.as_ref().is_none_or(|on| on.contains(&input.reference))
            };
            let inputs = self.inputs.iter().filter(is_one);
            let inputs: Vec<String> = inputs.map(|input| input.field.name.clone()).collect();
            if inputs.is_empty() {
                continue;
            }
            for element in self
                .outputs
                .iter()
                .filter(|one| one.variable == output.variable)
            {
                direct.push(DirectDependency {
                    output: element.field.name.clone(),
                    inputs: inputs.clone(),
                });
            }
        }
        direct
    }
}

/// Strips the prefix that marks a reference signal of a controller; `None` for other names.
pub(super) fn reference_name(name: &str) -> Option<&str> {
    let rests = REFERENCE
        .iter()
        .filter_map(|begin| name.strip_prefix(begin));
    { rests }.find(|rest| !rest.is_empty())
}

/// Returns the reason why a variable cannot have a column, if there is one.
fn unsupported(variable: &Variable, is_parameter: bool) -> Option<String> {
    let kind = variable.kind.name();
    if variable.unusable.is_some() {
        return variable.unusable.clone();
    }
    if variable.kind.range().is_none() {
        return Some(match variable.causality {
            _ if variable.kind == VariableType::String && is_settable_text(variable) => {
                format!("it is a {kind}; set it in `texts` or `files`")
            }
            Causality::Input | Causality::Parameter => {
                format!("it is a {kind} and keeps its start value")
            }
            _ => format!("it is a {kind}"),
        });
    }
    if variable.is_clocked {
        return Some("it has a clock".into());
    }
    if is_parameter && variable.is_constant {
        return Some("it is constant and keeps its start value".into());
    }
    (variable.lacks_start())
        .then(|| "it is a parameter without a start value; `initial` sets it".into())
}

/// Returns `true` if a local signal with these names is requested, and marks the matching patterns.
fn is_requested(names: &[String], patterns: &[Pattern], matched: &mut [bool]) -> bool {
    let mut is_selected = false;
    for (pattern, matched) in patterns.iter().zip(matched) {
        if names.iter().any(|name| pattern.matches(name)) {
            (*matched, is_selected) = (true, true);
        }
    }
    is_selected
}

fn column(
    variable: &Variable,
    place: usize,
    element: usize,
    units: &Units<'_>,
) -> Result<Column, Invalid> {
    let is_parameter = variable.causality == Causality::Parameter;
    let foreign = variable.element_name(element);
    let name = spelled(&foreign).map_err(|error| match variable.causality {
        Causality::Input | Causality::Parameter => {
            Invalid(format!("{error}, so it keeps its start value"))
        }
        _ => Invalid(error.to_string()),
    })?;
    let (low, high) = variable
        .kind
        .range()
        .unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
    // A range with its ends in the wrong order is ignored.
    let is_range = (variable.min.zip(variable.max)).is_none_or(|(min, max)| min <= max);
    let is_above = |bound: &f64| is_range && *bound > low;
    let is_below = |bound: &f64| is_range && *bound < high;
    let min = variable.min.filter(is_above).unwrap_or(low);
    let max = variable.max.filter(is_below).unwrap_or(high);
    let start = variable.start.get(element).copied();
    let is_input = variable.causality == Causality::Input;
    let start = start.filter(|_| is_parameter || is_input);
    let is_legal = |start: &f64| {
        let is_item = variable.items.is_empty() || variable.items.contains(start);
        (min..=max).contains(start) && is_item
    };
    let mut text = line(&variable.description, LONGEST_TEXT);
    if text.is_empty() {
        text = undescribed(variable);
    }
    if !text.ends_with('.') {
        text.push('.');
    }
    if name != foreign {
        text = format!("{text} `{}` in the FMU.", line(&foreign, LONGEST_TEXT));
    }
    if let Some(start) = start.filter(|start| is_parameter && !is_legal(start)) {
        text = format!("{text} Must be set: its start value in the FMU, {start}, is not allowed.");
    }
    if !variable.items.is_empty() {
        let items = Variable::items_text(&variable.items);
        text = format!("{text} One of {}.", line(&items, LONGEST_TEXT));
    }
    let unit = variable.unit.as_deref().unwrap_or("1");
    let field = Field {
        default: start.filter(is_legal),
        min,
        max,
        faultable: is_parameter && variable.is_tunable,
        is_difference: variable.is_difference,
        is_discrete: matches!(
            variable.kind,
            VariableType::Enumeration | VariableType::Boolean
        ),
        is_whole: variable.kind.is_whole(),
        ..Field::signal(&name, &units.text(unit), &text)
    };
    Ok(Column {
        field,
        variable: place,
        element,
    })
}

/// Returns the columns of the continuous states. Arrays, and names that are none here, leave the FMU without any.
fn states(model: &ModelDescription, units: &Units<'_>) -> Vec<Column> {
    let of_state = |state: &ContinuousState| {
        let variable = &model.variables[state.variable];
        let is_number = variable.kind == VariableType::Float64 && variable.dimensions.is_empty();
        let column = column(variable, state.variable, 0, units).ok();
        column.filter(|_| is_number)
    };
    let all: Option<Vec<Column>> = model.states.iter().map(of_state).collect();
    all.unwrap_or_default()
}

/// Describes a variable without a description in the FMU by its role and type.
fn undescribed(variable: &Variable) -> String {
    let role = match variable.causality {
        Causality::Parameter if variable.is_tunable => "Tunable parameter",
        Causality::Parameter => "Parameter",
        Causality::CalculatedParameter => "Calculated parameter",
        Causality::Input => "Input",
        Causality::Output => "Output",
        _ => "Inner signal",
    };
    match variable.kind {
        VariableType::Float64 => format!("{role}, not described in the FMU"),
        kind => format!("{role} ({}), not described in the FMU", kind.name()),
    }
}

/// Converts a text to one line of limited length, without runs of separator characters.
fn line(text: &str, most: usize) -> String {
    let words = text.split(|c: char| c.is_whitespace() || !is_line(c.encode_utf8(&mut [0; 4])));
    let words = words.filter(|word| !word.is_empty() && !word.contains("========"));
    let mut line = words.collect::<Vec<_>>().join(" ");
    while line.len() > most {
        line.pop();
    }
    line
}

fn imported(model: &ModelDescription, units: &Units<'_>) -> Imported {
    Imported {
        format: format!("{} co-simulation", model.version),
        tool: line(&model.tool, LONGEST_TEXT),
        internal_step_s: model.internal_step_s,
        notes: model.notes.clone(),
        units: units.defined(model),
        initial: (with_initial_value(model))
            .map(|variable| line(&variable.name, LONGEST_TEXT))
            .collect(),
        ..Imported::default()
    }
}

/// Lists the types of variables that have a column.
pub(super) fn kinds(model: &ModelDescription, columns: &[&[Column]]) -> Vec<VariableType> {
    let all = columns.iter().flat_map(|columns| columns.iter());
    let kinds: BTreeSet<VariableType> = all
        .map(|column| model.variables[column.variable].kind)
        .collect();
    kinds.into_iter().collect()
}

/// Returns the folder of this machine's libraries, as each version of the standard names it.
pub(super) const fn platform(version: Version) -> &'static str {
    match version {
        Version::Two if cfg!(target_arch = "x86_64") => "linux64",
        Version::Two => "aarch64-linux",
        Version::Three if cfg!(target_arch = "x86_64") => "x86_64-linux",
        Version::Three => "aarch64-linux",
    }
}

#[cfg(test)]
mod tests;
