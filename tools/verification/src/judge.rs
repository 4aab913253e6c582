//! `hil judge`: evaluates metrics and requirements of a recorded run, by its own scenario or by another.
//!
//! The recorded rows pass through the evaluation that the recorder uses during a run, so the run's own requirements
//! give bit-identical results. No program is started: the recording contains everything against which a scenario is
//! checked.

use std::path::Path;

use hil_config::plan::Plan;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_facts::results::handover::Laws;
use hil_facts::results::outcome::RecordedOutcome;
use hil_facts::results::requirements::{self, Requirement, RunVerdict};
use hil_facts::results::summary::{Metric, write_metrics};
use hil_recording::reader::ReadError;
use serde::Serialize;
use shared_types::record::Outcome;

use crate::arguments::recordings::JudgeArguments;

/// Judgement of a recorded run.
#[derive(Clone, Debug, Serialize)]
pub struct Judgement {
    run: String,
    scenario: String,
    /// `aborted` if the run did not end by itself.
    verdict: RunVerdict,
    /// Outcome of the run, in one word; null if its recording is truncated.
    outcome: Option<Outcome>,
    /// Reason why the run ended early; null if it did not, or if the reason is unknown.
    reason: Option<String>,
    records: u64,
    metrics: Vec<Metric>,
    requirements: Vec<Requirement>,
    #[serde(skip)]
    laws: Laws,
}

/// Runs the command.
///
/// # Errors
/// If the run cannot be read, or the scenario does not fit it.
pub fn judge(arguments: &JudgeArguments) -> Result<Exit, Failure> {
    let (judgement, plan) = judged(&arguments.run, arguments.requirements.as_deref())?;
    output::result(arguments.json, &judgement, || {
        output::text(|text| judgement.write(text, &plan))
    })?;
    Ok(judgement.verdict.exit())
}

/// Judges a run by its own scenario or by another; also returns the plan used.
///
/// # Errors
/// If the run cannot be read, or the scenario does not fit it.
pub fn judged(run: &Path, by: Option<&Path>) -> Result<(Judgement, Plan), Failure> {
    let refused = |error: ReadError| Failure::usage(error);
    let outcome_of_run = RecordedOutcome::of(run, by).map_err(refused)?;
    outcome_of_run.reader.refuse_excerpt().map_err(refused)?;
    let (outcome, reason) = outcome_of_run.outcome(None);
    let RecordedOutcome {
        reader,
        recorded,
        damage,
        run: recorded_run,
        ..
    } = outcome_of_run;
    let plan = recorded_run?.plan;
    if let Some(damage) = damage {
        return Err(refused(damage));
    }
    if let Some(torn) = reader.caveat() {
        tell!("note: {torn}");
    }
    // A plant that died recorded no end, but the program that finished the recording did.
    let is_over = recorded.end.is_some() || reader.result("outcome").is_some();
    let requirements: Vec<Requirement> = (recorded.requirements.iter())
        .map(Requirement::from)
        .collect();
    let verdict = RunVerdict::of(outcome, &requirements);
    let judgement = Judgement {
        run: run.display().to_string(),
        scenario: plan.name.clone(),
        verdict,
        outcome: is_over.then_some(outcome),
        reason,
        records: reader.records(),
        metrics: recorded.metrics.iter().map(Metric::from).collect(),
        requirements,
        laws: Laws::of(&plan.controller.law, &recorded.changes, |name| {
            reader.fact(name).map(Into::into)
        }),
    };
    Ok((judgement, plan))
}

impl Judgement {
    /// Formats the judgement for a person.
    fn write(&self, text: &mut String, plan: &Plan) -> std::fmt::Result {
        use std::fmt::Write as _;
        let (scenario, run) = (&self.scenario, &self.run);
        let verdict = requirements::in_words(self.verdict.name(), self.requirements.len());
        writeln!(text, "{scenario}: {verdict}  ({run}, recorded)")?;
        match self.outcome {
            Some(Outcome::Completed) => {}
            Some(outcome) => {
                let outcome = outcome.name();
                writeln!(text, "  the run has {outcome}, so no verdict can be pass")?;
            }
            None => writeln!(
                text,
                "  the recording was cut off, so no verdict can be pass"
            )?,
        }
        if let Some(reason) = &self.reason {
            writeln!(text, "  {reason}")?;
        }
        let steps = self.records.saturating_sub(1);
        write_metrics(text, &self.metrics, plan, &self.laws, steps)?;
        requirements::write(text, &self.requirements)
    }
}
