//! Effect of an event: its target, its sizes or parameters, its profile and its skew.

use shared_types::describe::{FaultDescription, MoveBy, Settings};
use shared_types::number::exact as number;
use shared_types::table::Field;
use shared_types::time::Step;

use super::span::{Keys, Reported, steps_of};
use super::{Event, FaultKind, list, moves, profile, target};
use crate::keys::TARGET;
use crate::plan::{FaultAction, FaultEffect, Move, Trigger};
use crate::problem::ProblemKind;
use crate::quantity::Quantity;
use crate::reader::{Reader, Section};

const SKEW: Keys = Keys {
    in_s: "skew_s",
    in_steps: "skew_steps",
};

impl Event<'_> {
    pub(super) fn effect(
        &self,
        reader: &mut Reader,
        section: &Section<'_>,
        kind: FaultKind<'_>,
    ) -> Option<FaultEffect> {
        reader.refuse_unknown(section, &kind.keys());
        let skew_steps = self.skew_steps(reader, section);
        let folder = self.context.origin.folder();
        let left_s = self.left_s(skew_steps.as_ref().map_or(0, |steps| *steps));
        match kind {
            FaultKind::Own(fault) => {
                let profile = profile::check(reader, section, folder, Some(&fault.profile), left_s);
                let sizes = settings(reader, section, &fault.sizes, None);
                let plant = self.context.plant?;
                let (target, moved) = target::of_plant(reader, section, plant, fault)?;
                let (profile, sizes) = (profile?, sizes?);
                let moves = moves(fault, &moved, &sizes)?;
                if let Some(healthy) = self.context.healthy {
                    let each = fault.moves.iter().zip(&moved).zip(&moves);
                    for ((described, field), one) in each {
                        let key = match &described.by {
                            MoveBy::Size(key) => key,
                            MoveBy::Constant(_) => "",
                        };
                        moves::stays_in_range(reader, section, key, field, healthy, one, &profile)
                            .ok()?;
                    }
                }
                Some(FaultEffect {
                    target,
                    skew_steps: skew_steps.ok()?,
                    profile,
                    action: FaultAction::Move { sizes, moves },
                })
            }
            FaultKind::Shared(kind) => {
                let profile = profile::check(reader, section, folder, None, left_s);
                let named = reader.text(&section.with_keys(TARGET), "target");
                let target = named
                    .and_then(|named| target::of_kind(reader, section, self.context, kind, named));
                let unit = target.as_ref().map(|target| target.unit.as_str());
                let parameters = settings(reader, section, &kind.parameters, unit);
                let list = list::check(reader, section, folder, kind.list.as_ref());
                Some(FaultEffect {
                    target: target?.name,
                    skew_steps: skew_steps.ok()?,
                    profile: profile?,
                    action: FaultAction::Kind {
                        parameters: parameters?,
                        list: list?,
                    },
                })
            }
        }
    }

    /// Returns the time from the first step at which an effect could take effect to the end of the run.
    fn left_s(&self, skew_steps: u64) -> f64 {
        match (self.context.grid, self.earliest) {
            (Some(grid), Some(earliest)) => {
                grid.end_s() - grid.rate.seconds(Step(earliest + skew_steps))
            }
            _ => f64::INFINITY,
        }
    }

    /// Steps from the event to the effect, which must begin before the end of the run.
    fn skew_steps(&self, reader: &mut Reader, section: &Section<'_>) -> Result<u64, Reported> {
        let Some(key) = SKEW.given(reader, section)? else {
            return Ok(0);
        };
        let grid = self.context.grid;
        let (steps, begin_s) = match (key == SKEW.in_s, self.trigger) {
            // From the requested time, not from the step that it was rounded to.
            (true, Some(Trigger::Step { step, at_s })) => {
                let skew_s = reader.number(section, key).ok_or(Reported)?;
                let rate = grid.ok_or(Reported)?.rate;
                let begin_s = at_s + skew_s;
                (steps_of(rate, begin_s) - step.0, Some(begin_s))
            }
            _ => {
                let length = SKEW.length(reader, section, grid)?;
                (length.ok_or(Reported)?, None)
            }
        };
        let (grid, earliest) = (grid.ok_or(Reported)?, self.earliest.ok_or(Reported)?);
        let last = Step(grid.steps - 1);
        if earliest + steps <= last.0 {
            return Ok(steps);
        }
        let begin_s = begin_s.unwrap_or_else(|| grid.rate.seconds(Step(earliest + steps)));
        let path = section.path_of(key);
        let message = format!("`{path}`: the run is already over at {} s", number(begin_s));
        let last_s = number(grid.rate.seconds(last));
        reader
            .report_at(section, key, ProblemKind::OutOfRange, message)
            .expected(format!("a skew to at most {last_s} s, step {last}"));
        Err(Reported)
    }
}

/// Reads numbers according to a description; a number with a default may be omitted. `unit` is the target's unit.
fn settings(
    reader: &mut Reader,
    section: &Section<'_>,
    fields: &[Field],
    unit: Option<&str>,
) -> Option<Settings> {
    let mut settings = Settings::default();
    let mut complete = true;
    for field in fields {
        let unit = unit_of(field, unit);
        let quantity = Quantity {
            unit: &unit,
            ..Quantity::from(field)
        };
        let value = match field.default {
            Some(default) if section.table.get(&field.name).is_none() => Some(default),
            _ => reader.described_number(section, &quantity),
        };
        match value {
            Some(value) => settings.set(&field.name, value),
            None => complete = false,
        }
    }
    complete.then_some(settings)
}

/// Substitutes the target's unit in a parameter's unit, for example `rad/s` for `target/s`.
pub(crate) fn unit_of(field: &Field, target: Option<&str>) -> String {
    match target {
        Some("" | "1") => field.unit.replace("target", "1"),
        Some(unit) => field.unit.replace("target", unit),
        None => field.unit.replace("target", "the target's unit"),
    }
}

/// Returns the moves of a plant fault with the magnitudes of one effect.
fn moves(fault: &FaultDescription, moved: &[&Field], sizes: &Settings) -> Option<Vec<Move>> {
    (fault.moves.iter().zip(moved))
        .map(|(described, parameter)| {
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
        .collect()
}
