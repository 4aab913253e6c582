//! Termination of a run in two processes: outcome and cause, derived from the plant's report and the fates of the
//! processes.

use hil_facts::results::ended::EndedRun;
use hil_facts::results::recorded::Recorded;
use shared_types::record::Outcome;

use super::controllers::Controllers;
use super::prepared::PreparedRun;
use super::side::SideProcess;

/// Returns the end of the run, from the plant's report and the fates of the processes.
pub(super) fn termination(
    prepared: &PreparedRun,
    recorded: Recorded,
    (plant, controllers): (&SideProcess, &Controllers),
    first: &'static str,
) -> EndedRun {
    let controller = controllers.latest();
    let interrupted = prepared.interruption.came();
    let reported = recorded.end.as_ref();
    let outcome = reported.map_or(Outcome::Failed, |end| end.outcome);
    let unknown = controllers.unknown();
    if outcome == Outcome::Completed && recorded.error.is_none() && unknown.is_none() {
        // Both confirmed the last step; an abnormal end after it is still reported.
        let disorder = plant.fate().or_else(|| controllers.in_office()?.fate());
        let outcome = if disorder.is_some() {
            Outcome::Failed
        } else {
            outcome
        };
        return EndedRun::new(recorded, outcome, disorder);
    }
    let mut parts: Vec<String> = Vec::new();
    parts.extend(recorded.error.clone());
    parts.extend(unknown);
    if interrupted {
        parts.push("interrupted".into());
    }
    parts.extend(reported.and_then(|end| end.reason.clone()));
    parts.extend(controllers.exhausted());
    if reported.is_none() && recorded.error.is_some() {
        // hil had stopped listening, so an unheard end is neither side's fault.
        parts.extend([plant.fate(), controller.fate()].into_iter().flatten());
        parts.push(format!("{} steps were recorded", recorded.records));
    } else if reported.is_none() {
        parts.extend(unseen_end(plant, controller, first, recorded.records));
    } else {
        // Its exit code adds nothing to the plant's report; a signal or a kill does.
        let told_why = |fate: &String| !fate.contains("exit code");
        parts.extend(
            [plant.fate(), controller.fate()]
                .into_iter()
                .flatten()
                .filter(told_why),
        );
    }
    let outcome = match outcome {
        Outcome::Completed => Outcome::Failed,
        Outcome::Failed if interrupted => Outcome::Stopped,
        other => other,
    };
    EndedRun::new(recorded, outcome, Some(parts.join("; ")))
}

/// Explains the end of a run that its plant could not report, beginning with the cause.
fn unseen_end(
    plant: &SideProcess,
    controller: &SideProcess,
    first: &str,
    records: u64,
) -> Vec<String> {
    let (cause, other) = if plant.killed.is_some() || first == "plant" {
        (plant, controller)
    } else {
        (controller, plant)
    };
    let early = || format!("{} ended before the run was over", cause.name);
    let mut parts = vec![cause.fate().unwrap_or_else(early)];
    // A stopped or stuck process has reported nothing; the other side's observation is more informative.
    let words = [cause.last_word(), other.last_word()].into_iter().flatten();
    parts.extend(words.take(1));
    parts.extend(other.fate());
    parts.dedup(); // the last message of a bridge is its fate
    parts.push(format!("{records} steps were recorded"));
    parts
}
