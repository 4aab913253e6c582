//! Faults that act between plant and law at a point, which neither side's map has. Judges no fault of the plant itself.

use hil_config::plan::{FaultEffect, FaultEvent, Plan, Trigger};
use shared_types::record::FaultBegun;
use shared_types::time::Step;

/// Targets between plant and law, by their beginnings.
const BETWEEN: [&str; 3] = ["measured.", "command.", "link."];

/// Returns in words the first fault that acts, or may act, between plant and law at a step. A condition that has not
/// begun in `begun` may begin there.
pub(crate) fn between(plan: &Plan, step: Step, begun: &[FaultBegun]) -> Option<String> {
    plan.faults.iter().find_map(|event| {
        let begin = begin(plan, event, begun);
        let may_act = |effect: &&FaultEffect| {
            let first = begin.map(|begin| begin + effect.skew_steps);
            let length = first.zip(event.end.after_steps);
            let by_length = length.map(|(first, steps)| first + steps);
            let ends = [event.end.step.map(|end| end.0), by_length];
            let is_over = ends.iter().flatten().any(|end| *end <= step.0);
            is_between(event, effect) && first.is_none_or(|first| first <= step.0) && !is_over
        };
        let target = &event.effects.iter().find(may_act)?.target;
        let verb = if begin.is_some() { "acts" } else { "may act" };
        let (id, kind) = (event.id, &event.kind);
        Some(format!(
            "fault {id} ({kind}) {verb} on {target}, between plant and law"
        ))
    })
}

/// Returns `true` if an effect changes what one side gets from the other. A side that is `late` costs time only, of
/// which a run to a point has none.
fn is_between(event: &FaultEvent, effect: &FaultEffect) -> bool {
    let target = &effect.target;
    BETWEEN.iter().any(|prefix| target.starts_with(prefix))
        || (target == "controller" && event.kind == "skip")
}

/// Returns the step at which an event begins; `None` if a condition decides that has not held yet.
pub(crate) fn begin(plan: &Plan, event: &FaultEvent, begun: &[FaultBegun]) -> Option<u64> {
    match &event.trigger {
        Trigger::Step { step, .. } => Some(step.0),
        Trigger::Now | Trigger::Condition(_) => {
            let own = begun.iter().filter(|one| one.id == event.id);
            let begins = own.map(|one| {
                let effect = event.effects.get(one.effect as usize);
                one.step - effect.map_or(0, |effect| effect.skew_steps)
            });
            begins.min()
        }
        Trigger::After { event, delay_steps } => {
            let other = plan.faults.iter().find(|other| other.id == *event)?;
            Some(begin(plan, other, begun)? + delay_steps)
        }
    }
}
