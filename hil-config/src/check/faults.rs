//! `[[faults]]`: events and their effects on faultable parameters.

use shared_types::describe::{
    FaultDescription, MoveBy, PlantDescription, ProfileDescription, Settings,
};
use shared_types::table::Field;
use shared_types::time::Step;

use super::run::Grid;
use crate::document::Value;
use crate::plan::{
    FaultAction, FaultEffect, FaultEnd, FaultEvent, FaultSource, Move, Profile, Trigger,
};
use crate::problem::{ProblemKind, listed};
use crate::quantity::{Quantity, number};
use crate::reader::{Reader, Section};

/// The events that are right; the others are reported.
pub(super) fn check(
    reader: &mut Reader,
    root: &Section<'_>,
    plant: Option<&PlantDescription>,
    nominal: Option<&Settings>,
    grid: Option<Grid>,
) -> Vec<FaultEvent> {
    let sections = reader.list(root, "faults");
    (1..)
        .zip(&sections)
        .filter_map(|(id, section)| event(reader, section, id, plant, nominal, grid))
        .collect()
}

fn event(
    reader: &mut Reader,
    section: &Section<'_>,
    id: u32,
    plant: Option<&PlantDescription>,
    nominal: Option<&Settings>,
    grid: Option<Grid>,
) -> Option<FaultEvent> {
    reader.refuse_unknown(section, &[]);
    let kind = reader.text(section, "kind");
    let at_s = reader.number(section, "at_s");
    let sections = reader.list(section, "effects");
    if let Some(entry) = section.table.get("effects")
        && matches!(&entry.node.value, Value::List(items) if items.is_empty())
    {
        let path = section.path_of("effects");
        let message = format!("`{path}` is empty: the fault would do nothing");
        reader
            .report(ProblemKind::MissingKey, path, &entry.node.place, message)
            .expected("at least one effect");
    }
    let step = at_s.and_then(|at_s| step_at(reader, section, "at_s", at_s, grid?));
    let plant = plant?;
    let fault = find(reader, section, kind?, plant)?;
    let effects: Vec<Option<FaultEffect>> = sections
        .iter()
        .map(|effect_section| {
            let effect = Effect {
                plant,
                fault,
                nominal,
            };
            effect.check(
                reader,
                effect_section,
                at_s.filter(|_| step.is_some()),
                step,
                grid,
            )
        })
        .collect();
    Some(FaultEvent {
        id,
        name: None,
        kind: fault.kind.clone(),
        source: FaultSource::Scenario,
        trigger: Trigger::Step {
            step: step?,
            at_s: at_s?,
        },
        end: FaultEnd::default(),
        effects: effects.into_iter().collect::<Option<_>>()?,
    })
}

fn find<'d>(
    reader: &mut Reader,
    section: &Section<'_>,
    kind: &str,
    plant: &'d PlantDescription,
) -> Option<&'d FaultDescription> {
    let found = plant.faults.iter().find(|fault| fault.kind == kind);
    if found.is_none() {
        let names = plant.faults.iter().map(|fault| fault.kind.as_str());
        let message = format!("plant `{}` has no fault `{kind}`", plant.name);
        let problem = reader.report(
            ProblemKind::UnknownName,
            section.path_of("kind"),
            section.place_of("kind"),
            message,
        );
        if plant.faults.is_empty() {
            problem.expected("no faults: this plant offers none");
        } else {
            problem
                .expected(format!("one of {}", listed(names.clone())))
                .nearest(kind, names);
        }
    }
    found
}

/// The step at which something takes hold, which must be one that is exchanged.
fn step_at(
    reader: &mut Reader,
    section: &Section<'_>,
    key: &str,
    at_s: f64,
    grid: Grid,
) -> Option<Step> {
    let last = Step(grid.steps - 1);
    // Compared in seconds first: a huge time has no step.
    let step = (at_s <= grid.rate.seconds(last)).then(|| grid.rate.step_at_or_after(at_s));
    if let Some(step) = step
        && step <= last
    {
        return Some(step);
    }
    let path = section.path_of(key);
    let message = format!("`{path}`: at {} s the run is over", number(at_s));
    reader
        .report(
            ProblemKind::OutOfRange,
            path,
            section.place_of(key),
            message,
        )
        .expected(format!(
            "a time from 0 to {} in s, the last step",
            number(grid.rate.seconds(last))
        ));
    None
}

/// What an effect is checked against.
struct Effect<'d> {
    plant: &'d PlantDescription,
    fault: &'d FaultDescription,
    nominal: Option<&'d Settings>,
}

impl<'d> Effect<'d> {
    fn check(
        &self,
        reader: &mut Reader,
        section: &Section<'_>,
        at_s: Option<f64>,
        event_step: Option<Step>,
        grid: Option<Grid>,
    ) -> Option<FaultEffect> {
        let fault = self.fault;
        let mut further: Vec<&str> = fault.selector.as_deref().into_iter().collect();
        further.extend(fault.sizes.iter().map(|size| size.name.as_str()));
        if let ProfileDescription::Exponential { speed } = &fault.profile {
            further.push(&speed.name);
        }
        reader.refuse_unknown(section, &further);
        let target = self.target(reader, section);
        let mut sizes = Settings::default();
        for size in &fault.sizes {
            let value = match size.default {
                Some(default) if section.table.get(&size.name).is_none() => Some(default),
                _ => reader.described_number(section, &Quantity::from(size)),
            };
            sizes.set(&size.name, value?);
        }
        let profile = match &fault.profile {
            ProfileDescription::Step => Some(Profile::Step),
            ProfileDescription::Exponential { speed } => reader
                .described_number(section, &Quantity::from(speed))
                .map(|speed_per_s| Profile::Exponential { speed_per_s }),
        };
        let skew_s = reader.number(section, "skew_s");
        let step = match (at_s, skew_s, grid) {
            (Some(at_s), Some(skew_s), Some(grid)) => {
                step_at(reader, section, "skew_s", at_s + skew_s, grid)
            }
            _ => None,
        };
        let (target, moves) = target?;
        let moves: Vec<Move> = fault
            .moves
            .iter()
            .zip(moves)
            .filter_map(|(described, parameter)| {
                let by = match &described.by {
                    MoveBy::Size(key) => sizes.get(key)?,
                    MoveBy::Constant(value) => *value,
                };
                Some(Move {
                    parameter: parameter.name.clone(),
                    operation: described.operation,
                    by,
                })
            })
            .collect();
        Some(FaultEffect {
            target,
            skew_steps: step?.0 - event_step?.0,
            profile: profile?,
            action: FaultAction::Move { sizes, moves },
        })
    }

    /// The group that the selector means and its parameters that are moved.
    fn target(
        &self,
        reader: &mut Reader,
        section: &Section<'_>,
    ) -> Option<(String, Vec<&'d Field>)> {
        let selector = self.fault.selector.as_deref()?;
        let path = section.path_of(selector);
        let numbers = listed(targets(self.plant, self.fault).map(|(number, _)| number));
        let expected = format!("one of {numbers}");
        let Some(entry) = section.table.get(selector) else {
            reader.missing(section, &path, expected);
            return None;
        };
        let Value::Integer(number) = entry.node.value else {
            reader.wrong_type(&path, &entry.node, expected);
            return None;
        };
        let number = number.to_string();
        let found = targets(self.plant, self.fault).find(|(target, _)| *target == number);
        if found.is_none() {
            let message = format!("plant `{}` has no {selector} {number}", self.plant.name);
            reader
                .report(ProblemKind::UnknownName, path, &entry.node.place, message)
                .expected(expected);
            return None;
        }
        let group = format!("{selector}{number}");
        let parameters = self.fault.moves.iter().filter_map(|described| {
            let name = format!("{group}.{}", described.parameter);
            (self.plant.parameters.iter()).find(|field| field.name == name)
        });
        let parameters = parameters.collect();
        Some((group, parameters))
    }
}

/// The numbers that a fault's selector may have, as text, and the parameter that each moves.
pub(crate) fn targets<'d>(
    plant: &'d PlantDescription,
    fault: &'d FaultDescription,
) -> impl Iterator<Item = (&'d str, &'d Field)> {
    plant.parameters.iter().filter_map(|field| {
        let (group, parameter) = field.name.split_once('.')?;
        let number = group.strip_prefix(fault.selector.as_deref()?)?;
        let is_number = !number.is_empty() && number.bytes().all(|c| c.is_ascii_digit());
        (is_number && parameter == fault.moves.first()?.parameter && field.faultable)
            .then_some((number, field))
    })
}
