//! What became of controllers in a run, for the summary and for who watches.

use std::fmt::Write as _;

use serde::Serialize;
use shared_types::record::{Change, ControllerChange};
use shared_types::time::{Rate, Step};

use crate::run::Started;

/// A controller of a run that had several, or lost its only one.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Tenure {
    epoch: u32,
    /// Null where only a recording tells of it, as is the hash.
    binary: Option<String>,
    blake3: Option<String>,
    law: Option<String>,
    /// The first step that it answered; null if it never came into office.
    from_step: Option<u64>,
    /// The first step without it; null if it was there to the end.
    until_step: Option<u64>,
    until_s: Option<f64>,
    /// `lost`, `replaced` or `refused`.
    end: Option<&'static str>,
    reason: Option<String>,
    /// How the run went on without it.
    then: Option<&'static str>,
}

/// The controllers of a run; empty if it kept the one it began with.
pub(crate) fn tenures(
    started: &[Started],
    changes: &[ControllerChange],
    rate: Rate,
) -> Vec<Tenure> {
    if changes.is_empty() {
        return Vec::new();
    }
    let last = started.iter().map(|one| one.epoch);
    let last = last.chain(changes.iter().map(|change| change.epoch)).max();
    let mut tenures: Vec<Tenure> = (1..=last.unwrap_or(0))
        .map(|epoch| {
            let started = started.iter().find(|one| one.epoch == epoch);
            Tenure {
                epoch,
                binary: started.map(|one| one.binary.path.display().to_string()),
                blake3: started.map(|one| one.binary.blake3.clone()),
                law: started.map(|one| one.law.clone()),
                from_step: (epoch == 1).then_some(0),
                until_step: None,
                until_s: None,
                end: None,
                reason: None,
                then: None,
            }
        })
        .collect();
    for ControllerChange {
        epoch,
        step,
        change,
    } in changes
    {
        for tenure in &mut tenures {
            let is_meant = tenure.epoch == *epoch;
            let (end, reason, then) = match change {
                Change::Joined { law } if is_meant => {
                    tenure.from_step = Some(*step);
                    tenure.law = Some(law.clone());
                    continue;
                }
                Change::Joined { .. } if tenure.from_step.is_some() && tenure.end.is_none() => {
                    ("replaced", None, None)
                }
                Change::Lost { reason, policy } if is_meant => {
                    // What the plant saw, and what became of the process.
                    let started = started.iter().find(|one| one.epoch == *epoch);
                    let fate = started.and_then(|one| one.fate.as_deref());
                    let fate = fate.map_or_else(String::new, |fate| format!("; {fate}"));
                    ("lost", Some(format!("{reason}{fate}")), Some(policy.name()))
                }
                Change::Refused { reason } if is_meant => ("refused", Some(reason.clone()), None),
                _ => continue,
            };
            tenure.until_step = Some(*step);
            tenure.until_s = Some(rate.seconds(Step(*step)));
            tenure.end = Some(end);
            tenure.reason = reason;
            tenure.then = then;
        }
    }
    tenures
}

impl Tenure {
    /// As a person reads it.
    pub(crate) fn told(&self) -> String {
        let Self { epoch, law, .. } = self;
        let mut text = format!("controller {epoch}");
        if let Some(law) = law {
            text += &format!(" ({law})");
        }
        // Writing to a string cannot fail.
        if let Some(from) = self.from_step.filter(|from| *from > 0) {
            let _ = write!(text, " took over at step {from}");
        }
        if let (Some(until), Some(end)) = (self.until_step, self.end) {
            let comma = if self.from_step.is_some_and(|from| from > 0) {
                ","
            } else {
                ""
            };
            let _ = write!(text, "{comma} {end} at step {until}");
        }
        if let Some(reason) = &self.reason {
            let _ = write!(text, ": {reason}");
        }
        if let Some(then) = self.then {
            let _ = write!(text, "; {then}");
        }
        text
    }
}

/// A change as it is told while the run goes on.
pub(crate) fn told(change: &ControllerChange) -> String {
    let ControllerChange {
        epoch,
        step,
        change,
    } = change;
    match change {
        Change::Lost { reason, policy } => {
            format!(
                "controller {epoch} lost at step {step}: {reason}; {}",
                policy.name()
            )
        }
        Change::Joined { law } => format!("controller {epoch} ({law}) took over at step {step}"),
        Change::Refused { reason } => {
            format!("controller {epoch} refused at step {step}: {reason}")
        }
    }
}
