//! `[plant]`: model, substeps, parameters, limits and the safe command.

use std::collections::BTreeMap;

use shared_types::describe::{PlantDescription, Settings};
use shared_types::table::Field;

use super::parameters::{self, Written};
use crate::document::Entry;
use crate::plan::{Limit, PlantPlan};
use crate::problem::ProblemKind;
use crate::quantity::Quantity;
use crate::reader::{Reader, Section};

/// Finds the description of the requested model.
pub(super) fn find<'d>(
    reader: &mut Reader,
    section: &Section<'_>,
    plants: &'d [PlantDescription],
    advice: &str,
) -> Option<&'d PlantDescription> {
    let model = reader.text(section, "model")?;
    let match_found = plants.iter().find(|plant| plant.name == model);
    if match_found.is_none() {
        let names = plants.iter().map(|plant| plant.name.as_str());
        reader
            .report_at(
                section,
                "model",
                ProblemKind::UnknownName,
                format!("unknown plant `{model}`"),
            )
            .one_of(model, names)
            .help(advice);
    }
    match_found
}

pub(super) fn check(
    reader: &mut Reader,
    section: &Section<'_>,
    plant: Option<&PlantDescription>,
    inputs: &Settings,
) -> Option<PlantPlan> {
    reader.refuse_unknown(section, &[]);
    let substeps = reader.integer(section, "substeps");
    let parameters_section = reader.section(section, "parameters");
    let limits_section = reader.section(section, "limits");
    let safe_section = reader.section(section, "safe_command");
    let plant = plant?;

    let values = parameters_section
        .as_ref()
        .map(|values| {
            let owner = format!("plant `{}`", plant.name);
            parameters::given(reader, values, &plant.parameters, &owner)
        })
        .unwrap_or_default();
    let absent = Section {
        path: section.path_of("parameters"),
        ..section.clone()
    };
    let whole = parameters_section.as_ref().unwrap_or(&absent);
    let parameters = parameters::complete(reader, whole, &plant.parameters, &values, |_| None);
    let limits = limits_section
        .map(|section| limits(reader, &section, plant))
        .unwrap_or_default();
    let safe_command = safe_command(reader, safe_section.as_ref(), plant);
    Some(PlantPlan {
        model: plant.name.clone(),
        substeps: u32::try_from(substeps?).ok()?,
        parameters,
        limits,
        safe_command,
        inputs: inputs.clone(),
    })
}

/// Returns every command of the plant: as given, else the safe value of the port in front of the plant, else 0.
fn safe_command(
    reader: &mut Reader,
    section: Option<&Section<'_>>,
    plant: &PlantDescription,
) -> Settings {
    let mut commands = Settings::default();
    for field in &plant.commands {
        // Commands of a port begin with their safe values.
        let safe = field.default.filter(|_| plant.port.is_some());
        commands.set(&field.name, safe.unwrap_or(0.0));
    }
    let mut values: BTreeMap<&str, Written> = BTreeMap::new();
    for (key, entry) in leaves(section, &plant.commands) {
        let path = format!("plant.safe_command.{key}");
        let names = || plant.commands.iter().map(|field| field.name.as_str());
        let Some(field) = (plant.commands.iter()).find(|field| field.is_called(&key)) else {
            let message = format!("plant `{}` takes no command `{key}`", plant.name);
            reader
                .report(ProblemKind::UnknownName, path, &entry.key_place, message)
                .one_of(&key, names());
            continue;
        };
        let finite = Quantity::finite(&field.unit);
        if let Some(value) = reader.quantity(&path, &entry.node, &finite) {
            let typed_value = Written::new(&key, true, value, &entry.node.place);
            match typed_value.beats(values.get(field.name.as_str())) {
                Ok(true) => {
                    values.insert(&field.name, typed_value);
                    commands.set(&field.name, value);
                }
                Ok(false) => {}
                Err(message) => {
                    reader.report(ProblemKind::Duplicate, path, &entry.node.place, message);
                }
            }
        }
    }
    commands
}

/// Returns the values of a section by the full names of signals, dotted, quoted or in nested tables.
fn leaves<'a>(section: Option<&Section<'a>>, fields: &[Field]) -> Vec<(String, &'a Entry)> {
    let mut leaves = Vec::new();
    if let Some(section) = section {
        parameters::collect(section.table, "", fields, &mut leaves);
    }
    leaves
}

fn limits(reader: &mut Reader, section: &Section<'_>, plant: &PlantDescription) -> Vec<Limit> {
    let mut limits = Vec::new();
    let limited = plant.limited();
    let kind = plant.port.as_ref().map_or("true", |_| "measured");
    for (key, entry) in leaves(Some(section), limited) {
        let path = section.path_of(&key);
        let Some(signal) = limited.iter().find(|field| field.is_called(&key)) else {
            let names = limited.iter().map(|field| field.name.as_str());
            let message = format!("plant `{}` has no {kind} signal `{key}`", plant.name);
            reader
                .report(ProblemKind::UnknownName, path, &entry.key_place, message)
                .one_of(&key, names);
            continue;
        };
        if let Some((min, max)) = reader.pair(&path, &entry.node, &signal.unit) {
            let is_other =
                |limit: &Limit| limit.signal == signal.name && (limit.min, limit.max) != (min, max);
            if limits.iter().any(is_other) {
                let message = format!("`{path}` sets a second limit for `{}`", signal.name);
                reader.report(ProblemKind::Duplicate, path, &entry.node.place, message);
                continue;
            }
            limits.push(Limit {
                signal: signal.name.clone(),
                min,
                max,
            });
        }
    }
    limits
}
