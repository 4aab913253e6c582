//! One-line or JSON summary of the session: for scripts, and for the terminal after the view has closed.

use hil_console::terminal::duration::shown_ns;
use hil_facts::results::requirements::{self, VACUOUS};
use serde_json::{Map, Value, json};

use super::model::{Ending, Judged, Model};

/// Describes the end of the session, with the folder of its run.
pub(crate) fn ended(model: &Model, ending: &Ending) -> String {
    let mut text = format!("{} ended: ", model.plan().name);
    text += &match (&ending.verdict, ending.outcome) {
        (Some(_), _) => in_words(model, ending).unwrap_or_default(),
        (None, _) if ending.is_abandoned => "hil is gone without a summary".into(),
        (None, Some(outcome)) => outcome.name().into(),
        (None, None) if ending.is_gone => "without an outcome".into(),
        (None, None) => "the record stream ended".into(),
    };
    if let Some(steps) = ending.steps {
        text += &format!(", {steps} steps");
    }
    if let Some(reason) = &ending.reason {
        text += &format!(", {reason}");
    }
    if let Some(folder) = &model.run_dir {
        let folder = folder.display();
        text += &match ending.is_recoverable {
            true => format!(", `hil recover {folder}` completes its recording"),
            false => format!(", {folder}"),
        };
    }
    text
}

/// Returns the verdict in words for the user, if there is one.
fn in_words(model: &Model, ending: &Ending) -> Option<String> {
    let verdict = ending.verdict.as_deref()?;
    let words = requirements::in_words(verdict, model.plan().requirements.len());
    let vacuous = match model.judged() {
        Judged::Known(standings) => standings.iter().filter(|one| one.vacuous.is_some()).count(),
        Judged::Unknown | Judged::Silent => 0,
    };
    Some(requirements::with_vacuous(words, vacuous))
}

/// Describes the state of the session in one line.
pub(crate) fn text(model: &Model, now_ns: u64) -> String {
    if let Some(ending) = model.ending() {
        return ended(model, ending);
    }
    let mut parts = vec![format!("{}: {}", model.plan().name, model.state())];
    if let Some(step) = model.step() {
        let (time_s, total_s) = (model.seconds(step), model.seconds(model.plan().run.steps));
        parts.push(format!("step {step}, {time_s} of {total_s} s"));
    }
    if model.is_owner_stopped {
        parts.push("hil is stopped".into());
    } else if let Some(speed) = model.speed(now_ns) {
        parts.push(format!("{speed:.2}x real time"));
    }
    if let Some(trips) = model.pace().round_trips() {
        let (p50, p99) = (shown_ns(trips.p50), shown_ns(trips.p99));
        parts.push(format!("round trip {p50} p50, {p99} p99"));
    }
    if let Judged::Known(standings) = model.judged() {
        let counts = [
            ("fail", "FAIL"),
            ("undecided", "open"),
            (VACUOUS, VACUOUS),
            ("pass", "pass"),
        ];
        for (verdict, word) in counts {
            match standings
                .iter()
                .filter(|one| one.outcome() == verdict)
                .count()
            {
                0 => {}
                count => parts.push(format!("{count} {word}")),
            }
        }
    }
    let active = model.faults().iter().filter(|one| one.state == "active");
    match active.count() {
        0 => {}
        1 => parts.push("1 fault active".into()),
        count => parts.push(format!("{count} faults active")),
    }
    if model.lost > 0 {
        parts.push(format!("{} records not seen", model.lost));
    }
    parts.join(", ")
}

/// Returns the complete state as JSON. NaN and infinity become null.
pub(crate) fn json(model: &Model, now_ns: u64) -> Value {
    let signals: Map<String, Value> = (model.values())
        .map(|(name, value)| (name, json!(value)))
        .collect();
    let requirements = match model.judged() {
        Judged::Known(standings) => json!(standings),
        Judged::Unknown | Judged::Silent => Value::Null,
    };
    json!({
        "schema": 1,
        "session": model.session,
        "scenario": model.plan().name,
        "state": model.state(),
        "step": model.step(),
        "time_s": model.step().map(|step| model.seconds(step)),
        "steps": model.plan().run.steps,
        "rate_hz": model.rate().hz(),
        "clock": model.plan().run.clock.name(),
        "realtime_factor": model.speed(now_ns),
        "round_trip_ns": model.pace().round_trips(),
        "signals": signals,
        "faults": model.faults(),
        "requirements": requirements,
        "first_step_seen": model.joined_late().or(model.seen().map(|_| 0)),
        "lost": model.lost,
        "hil_is_stopped": model.is_owner_stopped,
        "ending": model.ending().map(|ending| json!({
            "verdict": ending.verdict,
            "verdict_in_words": in_words(model, ending),
            "is_without_summary": ending.is_abandoned,
            "outcome": ending.outcome,
            "reason": ending.reason,
            "steps": ending.steps,
        })),
        "run_dir": model.run_dir,
    })
}
