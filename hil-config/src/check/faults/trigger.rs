//! Trigger of an event.

use shared_types::number::exact as number;
use shared_types::time::Step;

use super::names::Names;
use super::span::{Given, Keys, Reported, refuse_alone};
use super::{EventContext, Origin};
use crate::check::signals;
use crate::keys::TRIGGERS;
use crate::plan::{Condition, Trigger};
use crate::problem::{ProblemKind, listed};
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
    context: &EventContext<'_>,
    names: &Names<'_>,
) -> Option<Trigger> {
    for (key, owner) in [
        ("for_s", "when"),
        (DELAY.in_s, "after"),
        (DELAY.in_steps, "after"),
    ] {
        refuse_alone(reader, section, key, owner).ok()?;
    }
    let triggers: Vec<&str> = (TRIGGERS.into_iter())
        .filter(|key| section.table.get(key).is_some())
        .collect();
    match triggers[..] {
        ["at_s" | "at_step"] => {
            let at = AT.instant(reader, section, context.grid, |grid| Step(grid.steps - 1));
            let (step, at_s) = at.ok()??;
            Some(Trigger::Step { step, at_s })
        }
        ["when"] => {
            let condition = condition(reader, section, context, "when", "for_s");
            condition.ok()?.map(Trigger::Condition)
        }
        ["after"] => {
            let event = names.find(reader, section);
            let delay = DELAY.length(reader, section, context.grid);
            Some(Trigger::After {
                event: event.ok()?,
                delay_steps: delay.ok()?.unwrap_or_default(),
            })
        }
        [] if matches!(context.origin, Origin::Live { .. }) => Some(Trigger::Now),
        [] => {
            let path = section.path_of(AT.in_s);
            let message = format!("`{}` has no trigger", section.path);
            reader
                .report(ProblemKind::MissingKey, path, section.place, message)
                .expected(format!("one of {}", listed(TRIGGERS)));
            None
        }
        [first, second, ..] => {
            let message = format!("`{}` has both `{first}` and `{second}`", section.path);
            reader
                .report_at(section, second, ProblemKind::Mismatch, message)
                .expected(format!("exactly one of {}", listed(TRIGGERS)));
            None
        }
        [_] => unreachable!("every trigger is read"),
    }
}

/// Reads a condition from the keys of its expression and of its hold time.
pub(super) fn condition(
    reader: &mut Reader,
    section: &Section<'_>,
    context: &EventContext<'_>,
    key: &'static str,
    length_key: &'static str,
) -> Given<Condition> {
    if section.table.get(key).is_none() {
        return Ok(None);
    }
    let expression = signals::signal(reader, section, key, context.columns);
    let for_s = reader.number(section, length_key).ok_or(Reported)?;
    let grid = context.grid.ok_or(Reported)?;
    let records = super::span::steps_of(grid.rate, for_s).max(1);
    if records >= grid.steps {
        let place = match section.table.get(length_key) {
            Some(_) => section.place_of(length_key),
            None => section.place_of(key),
        };
        let message = format!(
            "`{}` must hold for {records} consecutive records, but the run ends before the step after them",
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

/// Returns the first step at which each event could take effect. Reports events that wait for each other and so would
/// never begin, and events whose first step is beyond the last step of the run.
pub(super) fn earliest(
    reader: &mut Reader,
    sections: &[Section<'_>],
    triggers: &[Option<Trigger>],
    context: &EventContext<'_>,
    names: &Names<'_>,
) -> Vec<Option<u64>> {
    let first_id = context.origin.first_id();
    let begins = begins(triggers, first_id);
    (sections.iter().zip(begins))
        .map(|(section, begin)| match begin {
            Begin::From(step) => in_time(reader, section, context, step).ok(),
            Begin::Unknown => None,
            Begin::Circular(events) => {
                let ids = (events.iter()).map(|event| names.label(first_id + *event as u32));
                let ids: Vec<String> = ids.collect();
                let message = match ids.as_slice() {
                    [one] => format!("{one} waits for itself"),
                    several => format!("{} wait for each other", several.join(", ")),
                };
                reader
                    .report_at(section, "after", ProblemKind::Mismatch, message)
                    .expected("an event that takes effect by itself");
                None
            }
        })
        .collect()
}

fn in_time(
    reader: &mut Reader,
    section: &Section<'_>,
    context: &EventContext<'_>,
    step: u64,
) -> Result<u64, Reported> {
    let grid = context.grid.ok_or(Reported)?;
    if step < grid.steps {
        return Ok(step);
    }
    let key = DELAY.given(reader, section)?.unwrap_or("after");
    let path = section.path_of(key);
    let message = format!(
        "`{path}`: the run is already over at {} s, the earliest possible time",
        number(grid.rate.seconds(Step(step)))
    );
    reader
        .report_at(section, key, ProblemKind::OutOfRange, message)
        .expected(format!(
            "a fault that takes effect by {} s, step {}",
            number(grid.rate.seconds(Step(grid.steps - 1))),
            grid.steps - 1
        ));
    Err(Reported)
}

/// Earliest time at which an event can take effect.
#[derive(Clone, Debug, PartialEq)]
enum Begin {
    /// This step at the earliest.
    From(u64),
    /// Event in a circle of events that wait for each other; lists their indices from there on.
    Circular(Vec<usize>),
    /// Unknown: the event never begins, or its predecessor is itself faulty.
    Unknown,
}

/// Determines the earliest time of each event, visiting each event once however long the chains are.
fn begins(triggers: &[Option<Trigger>], first_id: u32) -> Vec<Begin> {
    let mut begins: Vec<Option<Begin>> = vec![None; triggers.len()];
    // Indices on the current chain; earlier chains are finished.
    let mut followed: Vec<Option<usize>> = vec![None; triggers.len()];
    for first in 0..triggers.len() {
        let mut chain: Vec<(usize, u64)> = Vec::new();
        let mut at = first;
        let (mut step, circle) = loop {
            match (&begins[at], followed[at]) {
                (Some(Begin::From(step)), _) => break (Some(*step), chain.len()),
                (Some(_), _) => break (None, chain.len()),
                (None, Some(place)) => break (None, place),
                (None, None) => {}
            }
            begins[at] = Some(match &triggers[at] {
                None => Begin::Unknown,
                Some(Trigger::Step { step, .. }) => Begin::From(step.0),
                Some(Trigger::Now) => Begin::From(0),
                Some(Trigger::Condition(condition)) => Begin::From(condition.records),
                Some(Trigger::After { event, delay_steps }) => {
                    match event.checked_sub(first_id) {
                        None => Begin::From(*delay_steps), // of the run already
                        Some(next) => {
                            followed[at] = Some(chain.len());
                            chain.push((at, *delay_steps));
                            at = next as usize;
                            continue;
                        }
                    }
                }
            });
        };
        let mut events: Vec<usize> = chain.drain(circle..).map(|(event, _)| event).collect();
        for event in &events {
            begins[*event] = Some(Begin::Unknown);
        }
        let least = (0..events.len()).min_by_key(|place| events[*place]);
        if let Some(place) = least {
            events.rotate_left(place);
            let first = events[0];
            begins[first] = Some(Begin::Circular(events));
        }
        for (event, delay_steps) in chain.into_iter().rev() {
            step = step.map(|step: u64| step.saturating_add(delay_steps));
            begins[event] = Some(step.map_or(Begin::Unknown, Begin::From));
        }
    }
    begins
        .into_iter()
        .map(|begin| begin.unwrap_or(Begin::Unknown))
        .collect()
}
