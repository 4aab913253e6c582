//! End of a run as reported by its plant, checked against the plan and the records.
//!
//! Used by the recorder at the end of a run, and by all readers of recorded outcomes. A plant is another process: its
//! report is trusted only if it is consistent with the plan and the records.

use std::collections::{BTreeMap, BTreeSet};

use hil_config::plan::{Clock, Plan};
use shared_types::pacer::Streaks;
use shared_types::record::{ControllerChange, ControllerFate, Outcome, RunEnd};

use crate::results::recorded::Recorded;

/// Returns the first contradiction in the plant's report of its end.
#[must_use]
pub fn contradiction(plan: &Plan, recorded: &Recorded) -> Option<String> {
    let end = recorded.end.as_ref()?;
    (steps(plan, end))
        .or_else(|| records(plan, end, recorded))
        .or_else(|| answers(end, recorded))
        .or_else(|| counts(plan, end, recorded))
        .or_else(|| effects(plan, end, recorded))
}

fn steps(plan: &Plan, end: &RunEnd) -> Option<String> {
    let (actual, planned) = (end.steps, plan.run.steps);
    match end.outcome {
        _ if actual > planned => Some(format!(
            "the plant reports {actual} executed steps, but the run has {planned}"
        )),
        Outcome::Completed if actual < planned => Some(format!(
            "the plant reports a completed run after {actual} steps, but the run has {planned}"
        )),
        _ => None,
    }
}

/// Checks the number of records: one for each step, and one of the state after the last step, which an aborted run may
/// lack. In real time some records may be lost, and are counted.
fn records(plan: &Plan, end: &RunEnd, recorded: &Recorded) -> Option<String> {
    let (steps, came, lost) = (end.steps, recorded.records, recorded.lost);
    let missing = match plan.run.clock {
        Clock::Realtime => lost,
        Clock::Lockstep | Clock::Paced { .. } => 0,
    };
    let (least, due) = match end.outcome {
        Outcome::Completed => (steps + 1, format!("{} records", steps + 1)),
        _ => (steps, format!("{steps} records or one more")),
    };
    let is_sound = came <= steps + 1 && came.saturating_add(missing) >= least;
    (!is_sound).then(|| {
        let lost = match lost {
            0 => String::new(),
            lost => format!(" and {lost} were lost"),
        };
        format!("the plant reports {steps} executed steps, which require {due}, but {came} arrived{lost}")
    })
}

/// Checks that there are answers: only a controller lost at the first step of the run, before its first answer, leaves
/// none.
fn answers(end: &RunEnd, recorded: &Recorded) -> Option<String> {
    let is_alone = recorded
        .answers
        .is_some_and(|answers| answers.answered == 0);
    let is_lost = |change: &ControllerChange| {
        matches!(change.change, ControllerFate::Lost { .. }) && change.step <= recorded.past_records
    };
    let is_known = recorded.changes.iter().any(is_lost);
    // The last record has no command.
    let is_due = end.outcome == Outcome::Completed && recorded.records > 1;
    (is_due && is_alone && !is_known).then(|| {
        "the plant reports a completed run, but no record has a controller's answer".into()
    })
}

fn counts(plan: &Plan, end: &RunEnd, recorded: &Recorded) -> Option<String> {
    let (overran, missed) = ("steps overran", "commands missed their deadline");
    for (streaks, what) in [(end.overruns, overran), (end.missed_commands, missed)] {
        let Streaks {
            count,
            longest,
            first_step,
            ..
        } = streaks;
        let is_sound = match first_step {
            None => (count, longest) == (0, 0),
            Some(first) => {
                (1..=count).contains(&longest) && first.saturating_add(count) <= end.steps + 1
            }
        };
        if !is_sound {
            let first = first_step.map_or_else(|| "none".into(), |step| step.to_string());
            let steps = end.steps;
            return Some(format!(
                "the plant reports that {count} {what}, at most {longest} in a row, the first at step {first}, which is impossible in a run of {steps} steps"
            ));
        }
    }
    if plan.run.clock == Clock::Lockstep && end.overruns.count > 0 {
        let count = end.overruns.count;
        return Some(format!(
            "the plant reports that {count} {overran}, which is impossible in lockstep, where steps have no due time"
        ));
    }
    let (actual, held) = (end.missed_commands.count, recorded.answers?.held);
    let is_exact = end.outcome == Outcome::Completed && recorded.changes.is_empty();
    let is_sound = match recorded.lost {
        0 if is_exact => actual == held,
        // The step at which a run ends may have no record.
        lost => actual <= held.saturating_add(lost).saturating_add(1),
    };
    (!is_sound).then(|| {
        format!(
            "the plant reports that {actual} {missed}, but {held} records contain an older command"
        )
    })
}

/// Checks that every reported effect belongs to a fault of the run, and is reported only once.
fn effects(plan: &Plan, end: &RunEnd, recorded: &Recorded) -> Option<String> {
    let log = &recorded.faults;
    let live = log.accepted.iter().map(|live| &live.event);
    let counts: BTreeMap<u32, usize> = (plan.faults.iter().chain(live))
        .map(|event| (event.id, event.effects.len()))
        .collect();
    let mut reported = BTreeSet::new();
    for effect in &end.effects {
        let (id, number) = (effect.id, effect.effect);
        let mut steps = [effect.step, effect.ended_step].into_iter().flatten();
        if steps.any(|step| step > plan.run.steps) || effect.acted_steps > end.steps + 1 {
            let steps = end.steps;
            return Some(format!(
                "the plant reports effect {number} of fault {id} after the end of a run of {steps} steps"
            ));
        }
        if !reported.insert((id, number)) {
            return Some(format!(
                "the plant reports effect {number} of fault {id} twice"
            ));
        }
    }
    let begun = log.begun.iter().map(|begun| (begun.id, begun.effect));
    let ended = log.ended.iter().map(|ended| (ended.id, ended.effect));
    let is_made_up = |(id, number): &(u32, u32)| {
        let effects = counts.get(id).copied().unwrap_or(0);
        usize::try_from(*number).is_ok_and(|number| number >= effects)
    };
    // In real time the event of an accepted live fault may be lost.
    let made_up = (reported.into_iter().chain(begun).chain(ended)).find(is_made_up);
    made_up.filter(|_| recorded.lost == 0).map(|(id, number)| {
        format!("the plant reports effect {number} of fault {id}, but there is no such fault")
    })
}

#[cfg(test)]
mod tests;
