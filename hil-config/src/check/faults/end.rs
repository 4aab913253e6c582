//! End of an event.

use shared_types::number::exact as number;
use shared_types::time::Step;

use super::span::{Given, Keys, Reported, refuse_alone};
use super::trigger::condition;
use super::{Event, EventContext};
use crate::plan::{FaultEffect, FaultEnd};
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

const DURATION: Keys = Keys {
    in_s: "duration_s",
    in_steps: "duration_steps",
};
const END: Keys = Keys {
    in_s: "end_s",
    in_steps: "end_step",
};

pub(super) fn check(
    reader: &mut Reader,
    section: &Section<'_>,
    context: &EventContext<'_>,
) -> Option<FaultEnd> {
    let after_steps = DURATION.length(reader, section, context.grid);
    let step = END.instant(reader, section, context.grid, |grid| Step(grid.steps));
    let occurrences = occurrences(reader, section);
    let alone = refuse_alone(reader, section, "until_for_s", "until");
    let condition = condition(reader, section, context, "until", "until_for_s");
    alone.ok()?;
    Some(FaultEnd {
        step: step.ok()?.map(|(step, _)| step),
        after_steps: after_steps.ok()?,
        occurrences: occurrences.ok()?,
        condition: condition.ok()?,
    })
}

fn occurrences(reader: &mut Reader, section: &Section<'_>) -> Given<u64> {
    if section.table.get("occurrences").is_none() {
        return Ok(None);
    }
    let count = reader.integer(section, "occurrences").ok_or(Reported)?;
    Ok(Some(count.unsigned_abs())) // its range begins at 1
}

/// Refuses an end before an effect could take effect.
pub(super) fn leaves_time(
    reader: &mut Reader,
    section: &Section<'_>,
    event: &Event<'_>,
    end: &FaultEnd,
    effects: &[FaultEffect],
) -> Result<(), Reported> {
    let (Some(end), Some(earliest)) = (end.step, event.earliest) else {
        return Ok(());
    };
    let rate = event.context.grid.ok_or(Reported)?.rate;
    let late = (effects.iter())
        .map(|effect| Step(earliest + effect.skew_steps))
        .find(|begin| *begin >= end);
    let Some(begin) = late else {
        return Ok(());
    };
    let key = END.given(reader, section)?.ok_or(Reported)?;
    let path = section.path_of(key);
    let message = format!(
        "`{path}`: the fault would end at {} s, but it takes effect at {} s",
        number(rate.seconds(end)),
        number(rate.seconds(begin))
    );
    reader
        .report_at(section, key, ProblemKind::Mismatch, message)
        .expected("an end after every effect has begun");
    Err(Reported)
}
