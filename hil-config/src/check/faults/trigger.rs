//! When an event takes hold.

use shared_types::time::Step;

use super::names::Names;
use super::span::{Given, Keys, Reported, refuse_alone};
use super::{Ground, Origin};
use crate::check::signals;
use crate::keys::TRIGGERS;
use crate::plan::{Condition, Trigger};
use crate::problem::{ProblemKind, listed};
use crate::quantity::number;
use crate::reader::{Reader, Section};

const AT: Keys = Keys {
    in_s: "at_s",
    in_steps: "at_step",
};
const DELAY: Keys = Keys {
    in_s: "delay_s",
    in_steps: "delay_steps",
};

pub(super) fn check(
    reader: &mut Reader,
    section: &Section<'_>,
    ground: &Ground<'_>,
    names: &Names<'_>,
) -> Option<Trigger> {
    for (key, owner) in [
        ("for_s", "when"),
        (DELAY.in_s, "after"),
        (DELAY.in_steps, "after"),
    ] {
        refuse_alone(reader, section, key, owner).ok()?;
    }
    let given: Vec<&str> = (TRIGGERS.into_iter())
        .filter(|key| section.table.get(key).is_some())
        .collect();
    match given[..] {
        ["at_s" | "at_step"] => {
            let at = AT.instant(reader, section, ground.grid, |grid| Step(grid.steps - 1));
            let (step, at_s) = at.ok()??;
            Some(Trigger::Step { step, at_s })
        }
        ["when"] => {
            let condition = condition(reader, section, ground, "when", "for_s");
            condition.ok()?.map(Trigger::Condition)
        }
        ["after"] => {
            let event = names.find(reader, section);
            let delay = DELAY.length(reader, section, ground.grid);
            Some(Trigger::After {
                event: event.ok()?,
                delay_steps: delay.ok()?.unwrap_or_default(),
            })
        }
        [] if matches!(ground.origin, Origin::Live { .. }) => Some(Trigger::Now),
        [] => {
            let path = section.path_of(AT.in_s);
            let message = format!("`{}` does not say when it takes hold", section.path);
            reader
                .report(ProblemKind::MissingKey, path, section.place, message)
                .expected(format!("one of {}", listed(TRIGGERS)));
            None
        }
        [first, second, ..] => {
            let message = format!("`{}` has both `{first}` and `{second}`", section.path);
            let path = section.path_of(second);
            reader
                .report(
                    ProblemKind::Mismatch,
                    path,
                    section.place_of(second),
                    message,
                )
                .expected(format!("exactly one of {}", listed(TRIGGERS)));
            None
        }
        [_] => unreachable!("every trigger is read"),
    }
}

/// A condition under the keys of its expression and of the time for which it must hold.
pub(super) fn condition(
    reader: &mut Reader,
    section: &Section<'_>,
    ground: &Ground<'_>,
    key: &'static str,
    length_key: &'static str,
) -> Given<Condition> {
    if section.table.get(key).is_none() {
        return Ok(None);
    }
    let expression = signals::signal(reader, section, key, ground.columns);
    let for_s = reader.number(section, length_key).ok_or(Reported)?;
    let grid = ground.grid.ok_or(Reported)?;
    let records = super::span::steps_of(grid.rate, for_s).max(1);
    if records >= grid.steps {
        let place = match section.table.get(length_key) {
            Some(_) => section.place_of(length_key),
            None => section.place_of(key),
        };
        let message = format!(
            "`{}` must hold for {records} records in a row, and the run is over before a step follows them",
            section.path_of(key)
        );
        reader
            .report(
                ProblemKind::OutOfRange,
                section.path_of(length_key),
                place,
                message,
            )
            .expected(format!(
                "a time below {} in s, that of the last step",
                number(grid.end_s())
            ));
        return Err(Reported);
    }
    Ok(Some(Condition {
        expression: expression.ok_or(Reported)?.to_string(),
        records,
    }))
}

/// The first step at which each event could take hold; events that wait for each other and so never
/// would, and those whose first step lies behind the last one, are reported.
pub(super) fn earliest(
    reader: &mut Reader,
    sections: &[Section<'_>],
    triggers: &[Option<Trigger>],
    ground: &Ground<'_>,
    names: &Names<'_>,
) -> Vec<Option<u64>> {
    (0..sections.len())
        .map(|index| {
            let section = &sections[index];
            let first_id = ground.origin.first_id();
            match follow(index, triggers, first_id) {
                Chain::From(step) => in_time(reader, section, ground, step).ok(),
                Chain::Unknown => None,
                Chain::Circular(events) => {
                    // Once for a circle, at its first event.
                    if events.iter().all(|event| *event >= index) {
                        let ids = events
                            .iter()
                            .map(|event| names.label(first_id + *event as u32));
                        let ids: Vec<String> = ids.collect();
                        let message = match ids.as_slice() {
                            [one] => format!("{one} waits for itself"),
                            several => format!("{} wait for each other", several.join(", ")),
                        };
                        reader
                            .report(
                                ProblemKind::Mismatch,
                                section.path_of("after"),
                                section.place_of("after"),
                                message,
                            )
                            .expected("an event that takes hold by itself");
                    }
                    None
                }
            }
        })
        .collect()
}

fn in_time(
    reader: &mut Reader,
    section: &Section<'_>,
    ground: &Ground<'_>,
    step: u64,
) -> Result<u64, Reported> {
    let grid = ground.grid.ok_or(Reported)?;
    if step < grid.steps {
        return Ok(step);
    }
    let key = DELAY.given(reader, section)?.unwrap_or("after");
    let path = section.path_of(key);
    let message = format!(
        "`{path}`: at {} s, the first time that this could be, the run is over",
        number(grid.rate.seconds(Step(step)))
    );
    reader
        .report(
            ProblemKind::OutOfRange,
            path,
            section.place_of(key),
            message,
        )
        .expected(format!(
            "that the fault takes hold by {} s, step {}",
            number(grid.rate.seconds(Step(grid.steps - 1))),
            grid.steps - 1
        ));
    Err(Reported)
}

/// Where the events that wait for each other begin.
enum Chain {
    /// At this step at the earliest.
    From(u64),
    /// Nowhere: these events, by place, the first one first.
    Circular(Vec<usize>),
    /// One of them is not right itself, or leads into a circle.
    Unknown,
}

fn follow(index: usize, triggers: &[Option<Trigger>], first_id: u32) -> Chain {
    let mut path = vec![index];
    let mut delay = 0;
    loop {
        let last = path[path.len() - 1];
        match &triggers[last] {
            None => return Chain::Unknown,
            Some(Trigger::Step { step, .. }) => return Chain::From(step.0 + delay),
            Some(Trigger::Now) => return Chain::From(delay),
            Some(Trigger::Condition(condition)) => return Chain::From(condition.records + delay),
            Some(Trigger::After { event, delay_steps }) => {
                delay += delay_steps;
                let Some(next) = event.checked_sub(first_id) else {
                    return Chain::From(delay); // of the run already
                };
                let next = next as usize;
                if next == index {
                    return Chain::Circular(path);
                }
                if path.contains(&next) {
                    return Chain::Unknown;
                }
                path.push(next);
            }
        }
    }
}
