//! Binding: every signal that law and plant need must be provided, by name and unit.
//!
//! The processes repeat the same binding from their own tables; the check here precedes their start, so that the
//! message can name the line of the scenario and a way to provide the signal.

use shared_types::connection::Connection;
use shared_types::describe::{LawDescription, PlantDescription};
use shared_types::layout::SignalKind;
use shared_types::table::{Field, derivative_of};
use shared_types::units::Conversion;

use super::inputs;
use crate::keys::WAVEFORMS;
use crate::plan::{Stimulus, Waveform};
use crate::problem::{ProblemKind, listed};
use crate::reader::{Reader, Section};

/// Advice for signals that differ in name or unit alone.
const CONNECT: &str = "use [[connect]] to bind signals of different names and units";

/// Reports every signal that law or plant needs and that nothing provides.
pub(super) fn check(
    reader: &mut Reader,
    section: &Section<'_>,
    law: &LawDescription,
    plant: &PlantDescription,
    stimuli: Option<&[Stimulus]>,
    has_inputs: bool,
) {
    let asks = format!("law `{}` needs the measured signal", law.name);
    let gives = format!("plant `{}`", plant.name);
    for field in &law.measured {
        if !gives_field(&plant.measured, field) {
            unbound(reader, section, &asks, field, &gives, &plant.measured, None);
        }
    }
    if let Some(commands) = &law.commands {
        let asks = format!("plant `{}` needs the command", plant.name);
        let gives = format!("law `{}`", law.name);
        let is_missing = |field: &&Field| !gives_field(commands, field);
        let missing: Vec<&Field> = plant.commands.iter().filter(is_missing).collect();
        // The first one has the lines for all of them.
        let mut remedy = inputs::remedy(&missing, has_inputs);
        for field in missing {
            let help = remedy.take().map(|remedy| match commands.is_empty() {
                true => remedy,
                false => format!("{CONNECT}; {remedy}"),
            });
            unbound(reader, section, &asks, field, &gives, commands, help);
        }
    }
    if let Some(stimuli) = stimuli {
        bind_reference(reader, section, law, stimuli);
    }
}

/// Connects signals whose name on one side is an alias on the other, so that the processes bind them by column names.
/// Reports two commands of the law that name the same input of the plant.
pub(super) fn by_aliases(
    reader: &mut Reader,
    section: &Section<'_>,
    law: &LawDescription,
    plant: &PlantDescription,
    reference: &[Field],
    connections: &[Connection],
) -> Vec<Connection> {
    let commands = law.commands.as_deref().unwrap_or_default();
    let mut added: Vec<Connection> = Vec::new();
    for (kind, of_law, of_plant) in [
        (SignalKind::Measured, &law.measured[..], &plant.measured[..]),
        (SignalKind::Reference, &law.reference, reference),
        (SignalKind::Command, commands, &plant.commands),
    ] {
        let all = || connections.iter().filter(|one| one.kind == kind);
        let is_free = |own: &&Field| {
            let mut others = of_plant.iter();
            all().all(|one| one.law != own.name) && others.all(|one| one.name != own.name)
        };
        for own in of_law.iter().filter(is_free) {
            let is_one = |other: &&Field| {
                own.unit == other.unit && own.names().any(|name| other.is_called(name))
            };
            let Some(other) = of_plant.iter().find(is_one) else {
                continue;
            };
            if kind == SignalKind::Command {
                // A [[connect]] has chosen the sender of this input.
                if all().any(|one| one.plant == other.name) {
                    continue;
                }
                let is_input = |one: &&Connection| one.kind == kind && one.plant == other.name;
                let named = commands.iter().find(|one| one.name == other.name);
                let sender = (named.map(|one| &one.name))
                    .or_else(|| added.iter().find(is_input).map(|one| &one.law));
                if let Some(sender) = sender {
                    let (input, own) = (&other.name, &own.name);
                    let message = format!(
                        "`command.{sender}` and `command.{own}` of law `{}` are both names of the one input `{input}` of plant `{}`",
                        law.name, plant.name
                    );
                    reader
                        .report_at(section, "law", ProblemKind::Duplicate, message)
                        .help(format!(
                            "[[connect]] with plant = \"command.{input}\" chooses one of them"
                        ));
                    continue;
                }
            }
            added.push(Connection {
                kind,
                law: own.name.clone(),
                law_unit: own.unit.clone(),
                plant: other.name.clone(),
                plant_unit: other.unit.clone(),
                conversion: Conversion::IDENTITY,
                is_given: false,
            });
        }
    }
    added
}

fn gives_field(fields: &[Field], needed_field: &Field) -> bool {
    fields
        .iter()
        .any(|field| field.name == needed_field.name && field.unit == needed_field.unit)
}

fn bind_reference(
    reader: &mut Reader,
    section: &Section<'_>,
    law: &LawDescription,
    stimuli: &[Stimulus],
) {
    let reference_fields: Vec<Field> = stimuli.iter().flat_map(Stimulus::fields).collect();
    let missing: Vec<&Field> = law
        .reference
        .iter()
        .filter(|field| !gives_field(&reference_fields, field))
        .collect();
    let asks = format!("law `{}` needs the reference signal", law.name);
    let mut reported: Vec<&str> = Vec::new();
    for field in missing {
        let (target, _) = target_of(field, &law.reference);
        // One message per target: its derivatives come with it.
        if reported.contains(&target.name.as_str()) {
            continue;
        }
        reported.push(&target.name);
        let highest = law
            .reference
            .iter()
            .map(|field| target_of(field, &law.reference))
            .filter(|(of, _)| of.name == target.name)
            .map(|(_, order)| order)
            .max()
            .unwrap_or_default();
        let kinds = WAVEFORMS
            .iter()
            .filter(|kind| kind.derivatives >= highest)
            .map(|kind| kind.name);
        let needs = match highest {
            0 => String::new(),
            1 => " with its first derivative".into(),
            order => format!(" with its first {order} derivatives"),
        };
        let of_table = match highest {
            0 | 1 => "",
            _ => {
                "; a table has them with interpolation = \"cubic\" or with columns under `derivatives`"
            }
        };
        let help = format!(
            "add a [[stimuli]] with target = \"{}\" and a kind of {}, which provides it{needs}{of_table}",
            target.name,
            listed(kinds)
        );
        // A sequence says itself why it has no more.
        let own = stimuli.iter().find(|one| one.target == target.name);
        let help = match own.map(|one| &one.waveform) {
            Some(Waveform::Sequence(sequence)) if sequence.derivatives() < highest => format!(
                "the sequence of `{}` has {} of {highest} derivatives: {}",
                target.name,
                sequence.derivatives(),
                sequence.limit().1
            ),
            _ => help,
        };
        unbound(
            reader,
            section,
            &asks,
            field,
            "a stimulus",
            &reference_fields,
            Some(help),
        );
    }
}

/// Returns the signal from which a reference signal is derived, and the order of the derivative; for a signal that is
/// not a derivative, the signal itself with order 0.
fn target_of<'f>(field: &'f Field, all: &'f [Field]) -> (&'f Field, usize) {
    for order in 1..=5 {
        let is_target = |target: &&Field| {
            derivative_of(&target.name, &target.unit, order)
                == (field.name.clone(), field.unit.clone())
        };
        if let Some(target) = all.iter().find(is_target) {
            return (target, order);
        }
    }
    (field, 0)
}

fn unbound(
    reader: &mut Reader,
    section: &Section<'_>,
    asks: &str,
    field: &Field,
    gives: &str,
    fields: &[Field],
    help: Option<String>,
) {
    let Field { name, unit, .. } = field;
    let other_unit = fields.iter().find(|field| field.name == *name);
    let message = match other_unit {
        Some(other) => {
            let other = &other.unit;
            format!("{asks} `{name}` in {unit}, but {gives} provides it in {other}")
        }
        None if gives == "a stimulus" => {
            format!("{asks} `{name}` in {unit}, which no stimulus provides")
        }
        None => format!("{asks} `{name}` in {unit}, which {gives} does not provide"),
    };
    let problem = reader.report_at(section, "law", ProblemKind::Unbound, message);
    if other_unit.is_none() {
        problem.nearest(name, fields.iter().map(|field| field.name.as_str()));
    }
    problem.help = help.or_else(|| (!fields.is_empty()).then(|| CONNECT.into()));
}
