//! Description of a recorded run in the messages that a page of a session receives.

use std::path::Path;

use hil_facts::checkpoint;
use hil_facts::results::requirements;
use hil_recording::reader::{Column, folder_of};
use serde_json::{Value, json};
use shared_types::time::{Rate, Step};

use crate::plots::arranged::signal_json;
use crate::plots::bounds::Bound;
use crate::report::plots::Plot;
use crate::report::run::Run;

/// Maximum number of checkpoints that a page offers.
const CHECKPOINTS: usize = 200;

/// Describes scenario, signals and plots.
pub(super) fn about(run: &Run, columns: &[Column], plots: &[Plot], bounds: &[Bound]) -> Value {
    let plan = run.plan();
    let place = |name: &String| columns.iter().position(|one| one.name == *name);
    let plots = plots.iter().map(|plot| {
        let chosen = &plot.chosen;
        json!({
            "section": chosen.section,
            "title": chosen.title,
            "unit": chosen.unit,
            "heading": plot.heading,
            "words": plot.words,
            "signals": chosen.signals.iter().filter_map(place).collect::<Vec<_>>(),
            "log": chosen.log,
            "lines": chosen.lines,
            "limits": chosen.limits,
        })
    });
    let signals = columns.iter().map(|one| signal_json(one, bounds));
    let end_s = run.end_s();
    json!({
        "tell": "about",
        "recorded": true,
        "session": run.path.display().to_string(),
        "scenario": plan.map_or_else(|| run.fact("scenario").to_owned(), |plan| plan.name.clone()),
        "description": plan.map_or("", |plan| &plan.description),
        "plant": plan.map_or("", |plan| &plan.plant.model),
        "clock": plan.map_or("", |plan| plan.run.clock.name()),
        "pace": null,
        "rate_hz": run.rate.hz(),
        "steps": run.last.0,
        "duration_s": end_s,
        "signals": signals.collect::<Vec<_>>(),
        "plots": plots.collect::<Vec<_>>(),
        "readings": null,
        "window_s": end_s,
        "buttons": [],
        "notes": run.notes,
        "over": null,
        "checkpoints": checkpoints(&run.path, run.rate),
    })
}

/// Describes verdict, requirements and faults.
pub(super) fn state(run: &Run) -> Value {
    let sizes = run.outcome.recorded.faults.sizes.as_deref();
    let faults = run.spans.iter().map(|span| {
        let step = run.rate.step_at_or_after(span.from_s).0;
        let ended = span.until_s.map(|until_s| run.rate.step_at_or_after(until_s).0);
        let own = sizes.unwrap_or_default().iter();
        let own = own.filter(|one| one.id == span.event && one.step.is_some());
        let mut effects: Vec<Value> = own.map(|one| json!(one)).collect();
        if effects.is_empty() {
            effects.push(json!({ "target": "", "step": step, "ended_step": ended, "max_effect": null, "unit": "" }));
        }
        json!({
            "id": span.event,
            "kind": span.kind,
            "source": "",
            "state": if ended.is_some() { "ended" } else { "active" },
            "waits_for": null,
            "effects": effects,
        })
    });
    let requirements = run.requirements.iter().map(|one| {
        json!({
            "name": one.name, "verdict": one.verdict, "robustness": one.robustness, "unit": one.unit,
            "at_least": null, "at_most": null, "decided_at_s": one.decided_at_s, "at_s": one.at_s,
            "formula": one.formula, "vacuous": one.vacuous,
        })
    });
    let last = run.last.0;
    let vacuous = run.requirements.iter().filter(|one| one.vacuous.is_some());
    let verdict = requirements::with_vacuous(
        requirements::in_words(&run.verdict, run.requirements.len()),
        vacuous.count(),
    );
    json!({
        "tell": "state",
        "state": "recorded",
        "step": last,
        "time_s": run.rate.seconds(Step(last)),
        "steps": last,
        "rate_hz": run.rate.hz(),
        "faults": faults.collect::<Vec<_>>(),
        "requirements": requirements.collect::<Vec<_>>(),
        "lost": 0,
        "hil_is_stopped": false,
        "ending": { "verdict": run.verdict, "verdict_in_words": verdict, "outcome": null, "reason": run.reason },
        "law": run.law(),
        "told": run.reason,
    })
}

/// Lists the checkpoints in the folder of a run, by their steps.
fn checkpoints(path: &Path, rate: Rate) -> Vec<Value> {
    let all = checkpoint::of_run(folder_of(path)).into_iter();
    let json = all.take(CHECKPOINTS).map(|(step, folder)| {
        json!({ "step": step.0, "time_s": rate.seconds(step), "folder": folder.display().to_string() })
    });
    json.collect()
}
