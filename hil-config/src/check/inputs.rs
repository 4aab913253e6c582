//! Inputs of the plant that the scenario drives instead of the law: `[plant.inputs]` and stimuli for `plant.X`.
//!
//! Read before anything that names commands: everything else sees the plant without these inputs.

use shared_types::describe::{LawDescription, PlantDescription, Settings};
use shared_types::number::exact as number;
use shared_types::table::Field;

use super::parameters;
use crate::document::{Entry, Value};
use crate::plan::{INPUT_KEYS, PLANT_TARGET, Stimulus};
use crate::problem::ProblemKind;
use crate::quantity::Quantity;
use crate::reader::{Reader, Section};
use crate::source::Place;

/// Text of a constant that stands for the start value of the plant's table.
const START: &str = "start";

/// Input of the plant with the key that drives it.
#[derive(Debug)]
pub(super) struct Driver<'a> {
    /// Name of the input.
    input: String,
    /// Full name of the key.
    key: String,
    place: &'a Place,
}

/// Inputs that the scenario drives.
#[derive(Debug, Default)]
pub(super) struct Inputs<'a> {
    /// Constant inputs.
    pub(super) constants: Settings,
    /// All inputs, constant or not.
    drivers: Vec<Driver<'a>>,
}

/// Returns the driven inputs and reports the faulty ones.
pub(super) fn check<'a>(
    reader: &mut Reader,
    root: &Section<'a>,
    section: Option<&Section<'a>>,
    plant: Option<&PlantDescription>,
) -> Inputs<'a> {
    let mut inputs = Inputs::default();
    let table = section.and_then(|section| reader.section(section, "inputs"));
    let Some(plant) = plant else {
        return inputs;
    };
    let mut leaves = Vec::new();
    if let Some(table) = &table {
        parameters::collect(table.table, "", &plant.commands, &mut leaves);
    }
    for (name, entry) in leaves {
        let key = format!("plant.inputs.{name}");
        let Some(field) = find(reader, plant, &name, &key, &entry.key_place) else {
            continue;
        };
        if inputs.add(reader, field, &key, &entry.key_place)
            && let Some(value) = constant(reader, plant, field, &key, entry)
        {
            inputs.constants.set(&field.name, value);
        }
    }
    let stimuli = root.table.get("stimuli").map(|entry| &entry.node.value);
    let Some(Value::List(stimuli)) = stimuli else {
        return inputs;
    };
    for (number, stimulus) in stimuli.iter().enumerate() {
        let Value::Table(table) = &stimulus.value else {
            continue;
        };
        let target = table.get("target").map(|entry| &entry.node);
        let Some((node, Value::Text(target))) = target.map(|node| (node, &node.value)) else {
            continue;
        };
        let key = format!("stimuli[{number}].target");
        if let Some(name) = target.strip_prefix(PLANT_TARGET)
            && let Some(field) = find(reader, plant, name, &key, &node.place)
        {
            inputs.add(reader, field, &key, &node.place);
        }
    }
    inputs
}

impl<'a> Inputs<'a> {
    /// Adds an input; reports one that is driven already and returns `false`.
    fn add(&mut self, reader: &mut Reader, field: &Field, key: &str, place: &'a Place) -> bool {
        let name = &field.name;
        if let Some(other) = self.driver_of(name) {
            let other = &other.key;
            let message = format!("`{key}` drives the input `{name}`, and so does `{other}`");
            reader
                .report(ProblemKind::Duplicate, key, place, message)
                .help("leave out one of them");
            return false;
        }
        self.drivers.push(Driver {
            input: name.clone(),
            key: key.into(),
            place,
        });
        true
    }

    fn driver_of(&self, input: &str) -> Option<&Driver<'a>> {
        self.drivers.iter().find(|driver| driver.input == input)
    }

    /// Returns the key that drives an input of the plant, named with or without an alias.
    pub(super) fn key_of(&self, plant: &PlantDescription, name: &str) -> Option<&str> {
        let mut commands = plant.commands.iter();
        let field = commands.find(|field| field.is_called(name))?;
        Some(&self.driver_of(&field.name)?.key)
    }

    /// Returns the plant without the driven inputs.
    pub(super) fn commanded(&self, plant: &PlantDescription) -> PlantDescription {
        let mut plant = plant.clone();
        (plant.commands).retain(|field| self.driver_of(&field.name).is_none());
        plant
    }

    /// Reports inputs that the law, as connected, commands as well; `plant` has all commands.
    pub(super) fn refuse_commanded(
        &self,
        reader: &mut Reader,
        law: &LawDescription,
        plant: &PlantDescription,
    ) {
        for command in law.commands.iter().flatten() {
            let mut inputs = plant.commands.iter();
            let Some(input) = inputs.find(|input| input.is_called(&command.name)) else {
                continue;
            };
            if let Some(Driver { input, key, place }) = self.driver_of(&input.name) {
                let message = format!(
                    "`{key}` drives the input `{input}`, and law `{}` of `controller.law` commands it as `command.{}`",
                    law.name, command.name
                );
                reader
                    .report(ProblemKind::Duplicate, key, place, message)
                    .help("leave one of them out: an input has one source");
            }
        }
    }
}

fn find<'p>(
    reader: &mut Reader,
    plant: &'p PlantDescription,
    name: &str,
    key: &str,
    place: &Place,
) -> Option<&'p Field> {
    let field = plant.commands.iter().find(|field| field.is_called(name));
    if field.is_none() {
        let message = format!("plant `{}` has no input `{name}`", plant.name);
        let names = plant.commands.iter().map(|field| field.name.as_str());
        reader
            .report(ProblemKind::UnknownName, key, place, message)
            .one_of(name, names);
    }
    field
}

/// Returns the value of a constant input: a number, or the start value of the plant's table.
fn constant(
    reader: &mut Reader,
    plant: &PlantDescription,
    field: &Field,
    key: &str,
    entry: &Entry,
) -> Option<f64> {
    let node = &entry.node;
    let quantity = finite(field);
    match &node.value {
        Value::Text(text) if text == START => {
            let start = field.default.filter(|start| quantity.admits(*start));
            if start.is_some() {
                return start;
            }
            let message = format!(
                "`{key}` is \"{START}\", but plant `{}` declares no start for `{}`",
                plant.name, field.name
            );
            reader
                .report(ProblemKind::Mismatch, key, &node.place, message)
                .expected(quantity.expected());
            None
        }
        Value::Text(_) => {
            let expected = format!("{}, or \"{START}\"", quantity.expected());
            reader.wrong_type(key, node, expected);
            None
        }
        _ => reader.quantity(key, node, &quantity),
    }
}

/// Returns the finite values that an input can have.
fn finite(field: &Field) -> Quantity<'_> {
    let quantity = Quantity::from(field);
    Quantity {
        min: field.min.clamp(f64::MIN, f64::MAX),
        max: field.max.clamp(f64::MIN, f64::MAX),
        ..quantity
    }
}

/// Inputs that the scenario drives, for advice on names that a change or a fault cannot use.
#[derive(Clone, Copy, Debug)]
pub(super) struct Advice<'a> {
    /// Reference signals, and inputs with a course.
    pub stimuli: &'a [Stimulus],
    /// Constant inputs.
    pub constants: &'a Settings,
}

impl Advice<'_> {
    /// Returns the input that a name means, with or without a group before it.
    fn input(name: &str) -> &str {
        let groups = [
            INPUT_KEYS,
            "plant.inputs.",
            "plant.parameters.",
            PLANT_TARGET,
        ];
        let stripped = groups
            .into_iter()
            .find_map(|group| name.strip_prefix(group));
        stripped.or(name.strip_prefix("command.")).unwrap_or(name)
    }

    /// Returns `true` if a name means a constant input, or a part of an instrument.
    pub(super) fn is_fixed(&self, name: &str) -> bool {
        self.constants.get(Self::input(name)).is_some() || instrument_group(name).is_some()
    }

    /// Describes how the input or the part of an instrument that a name means can be changed or faulted; `None` for
    /// another name.
    pub(super) fn on(&self, name: &str) -> Option<String> {
        if let Some(group) = instrument_group(name) {
            return Some(format!(
                "instruments stay as they are during a run; inject the same stage as a fault: \
                 hil inject KIND {group}.SIGNAL .., or change the scenario"
            ));
        }
        let input = Self::input(name);
        if let Some(value) = self.constants.get(input) {
            let value = number(value);
            return Some(format!(
                "the input `{input}` is a constant of this run; \
                 one with a course is changed and faulted as `{INPUT_KEYS}{input}`: in place of \
                 `{input}` under [plant.inputs] write\n[[stimuli]]\ntarget = \"{PLANT_TARGET}{input}\"\nkind = \"step\"\nafter = {value}"
            ));
        }
        let mut inputs = self.stimuli.iter().filter_map(Stimulus::input);
        let is_driven = inputs.any(|one| one == input) && !name.starts_with(INPUT_KEYS);
        is_driven.then(|| format!("during a run this input of the plant is `{INPUT_KEYS}{input}`"))
    }
}

/// Returns the group of signals that faults can take in place of the instrument which a name means; `None` for another
/// name.
fn instrument_group(name: &str) -> Option<&'static str> {
    let is_of = |starts: [&str; 3]| starts.into_iter().any(|start| name.starts_with(start));
    if is_of(["sensors[", "sensor.", "sensed."]) {
        return Some("measured");
    }
    is_of(["actuators[", "actuator.", "applied."]).then_some("command")
}

/// Describes how the scenario can drive inputs that no law commands; `has_table` if it has `[plant.inputs]`.
pub(super) fn remedy(fields: &[&Field], has_table: bool) -> Option<String> {
    let first = &fields.first()?.name;
    let lines = fields.iter().map(|field| {
        let value = match field.default {
            Some(_) => format!("\"{START}\""),
            None if field.min > 0.0 => number(field.min),
            None if field.max < 0.0 => number(field.max),
            None => "0.0".into(),
        };
        format!("{} = {value}\n", field.name)
    });
    let (table, lines) = match has_table {
        true => (" into [plant.inputs]", lines.collect::<String>()),
        false => ("", format!("[plant.inputs]\n{}", lines.collect::<String>())),
    };
    Some(format!(
        "the scenario can drive an input that no law commands: paste{table}\n{lines}or, for a course, [[stimuli]] with target = \"{PLANT_TARGET}{first}\""
    ))
}
