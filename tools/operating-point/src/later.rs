//! Faults and changes of a scenario that are still to come at a point, by which a run leaves its equilibrium. Judges no
//! stimulus.

use hil_config::plan::{Change, FaultEvent, Plan, Trigger};
use shared_types::number::exact_in;
use shared_types::record::FaultBegun;
use shared_types::time::Step;

use crate::acting::begin;

/// Lists in words what begins or ends at or after a step; `begun` are the effects that began before it.
pub(crate) fn events(plan: &Plan, step: Step, begun: &[FaultBegun]) -> Vec<String> {
    let seconds = |at: u64| exact_in(plan.run.rate.seconds(Step(at)), "s");
    let fault = |event: &FaultEvent| {
        let name = format!("fault {} ({})", event.id, event.kind);
        let Some(begin) = begin(plan, event, begun) else {
            let Trigger::Condition(condition) = &event.trigger else {
                return Some(format!(
                    "{name} begins after another fault with a condition"
                ));
            };
            return Some(format!("{name} begins when {}", condition.expression));
        };
        let skews = event.effects.iter().map(|effect| effect.skew_steps);
        let last = begin + skews.max().unwrap_or(0);
        if last >= step.0 {
            return Some(format!("{name} begins at {}", seconds(last)));
        }
        let by_length = event.end.after_steps.map(|steps| last + steps);
        let ends = [event.end.step.map(|end| end.0), by_length];
        let end = ends.into_iter().flatten().min()?;
        (end >= step.0).then(|| format!("{name} ends at {}", seconds(end)))
    };
    let change = |change: &Change| {
        let begin = change.step?.0;
        let keys = change.set.iter().map(|one| &one.key);
        let keys: Vec<&str> = { keys.chain(&change.clear) }.map(String::as_str).collect();
        (begin + change.ramp_steps >= step.0).then(|| {
            let (id, keys, at) = (change.id, keys.join(", "), seconds(begin));
            format!("change {id} of {keys} begins at {at}")
        })
    };
    let faults = plan.faults.iter().filter_map(fault);
    faults
        .chain(plan.changes.iter().filter_map(change))
        .collect()
}
