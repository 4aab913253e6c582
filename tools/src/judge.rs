//! `hil judge`: metrics and requirements of a recorded run, by its own scenario or by another.
//!
//! Feeds the recorded rows to the same evaluation that the recorder fed while the run went on, so its
//! own requirements come out to the last bit as they did then. Runs nothing: what a scenario is
//! checked against travels in the recording.

use std::ops::Range;
use std::path::Path;

use hil_config::evaluation::Evaluation;
use hil_config::expression::{Columns, ExpressionError, Group};
use hil_config::plan::Plan;
use hil_config::scenario::read_regular;
use serde::Serialize;
use shared_types::describe::Description;
use shared_types::number::exact_in;
use shared_types::record::{Outcome, Validity};
use shared_types::table::Field;
use shared_types::time::Step;

use crate::account::Account;
use crate::cli::recordings::JudgeArguments;
use crate::exit::{Exit, Failure};
use crate::output;
use crate::repetition;
use crate::requirements::{self, Requirement};
use crate::run_reader::{ReadError, RunReader};
use crate::succession::Laws;
use crate::summary::{Metric, write_metrics};
use crate::validity;

/// What came of a recorded run.
#[derive(Clone, Debug, Serialize)]
pub struct Judgement {
    run: String,
    scenario: String,
    /// `aborted` if the run did not end by itself.
    verdict: &'static str,
    /// How the run ended, in one word; null if its recording broke off.
    outcome: Option<String>,
    /// Why, if it did not end by itself; null if nobody tells.
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
    output::write(&if arguments.json {
        let json = serde_json::to_string_pretty(&judgement).map_err(Failure::infrastructure)?;
        json + "\n"
    } else {
        judgement.told(&plan)
    })?;
    Ok(match judgement.verdict {
        "pass" => Exit::Pass,
        _ => Exit::Failed,
    })
}

/// Judges a run by its own scenario or by another; also the plan that it was judged by.
///
/// # Errors
/// If the run cannot be read, or the scenario does not fit it.
pub fn judged(run: &Path, by: Option<&Path>) -> Result<(Judgement, Plan), Failure> {
    let refused = |error: ReadError| Failure::usage(error);
    let account = Account::of(run, by).map_err(refused)?;
    account.reader.refuse_excerpt().map_err(refused)?;
    let (outcome, reason) = account.outcome(None);
    let Account {
        reader,
        recorded,
        damage,
        plan,
        ..
    } = account;
    let plan = plan?;
    if let Some(damage) = damage {
        return Err(refused(damage));
    }
    if let Some(torn) = reader.caveat() {
        tell!("note: {torn}");
    }
    // A plant that died told no end; who ended its recording did.
    let is_over = recorded.end.is_some() || reader.result("outcome").is_some();
    let requirements: Vec<Requirement> = (recorded.requirements.iter())
        .map(Requirement::from)
        .collect();
    let verdict = match outcome {
        Outcome::Completed => requirements::verdict(&requirements),
        _ => "aborted",
    };
    let judgement = Judgement {
        run: run.display().to_string(),
        scenario: plan.name.clone(),
        verdict,
        outcome: is_over.then(|| format!("{outcome:?}").to_lowercase()),
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

/// The plan of the run, with what is computed and judged by another scenario if one is given.
pub(crate) fn plan(
    reader: &RunReader,
    plant: &Description,
    run: &Path,
    by: Option<&Path>,
) -> Result<Plan, Failure> {
    let refused = |error: ReadError| Failure::usage(error);
    let controller: Description = reader
        .enclosed("controller-description.json")
        .map_err(refused)?;
    let text = reader.enclosure("scenario.toml").map_err(refused)?;
    let own = repetition::checked(text, run, plant, &controller)?;
    let Some(by) = by else {
        return Ok(own);
    };
    let shown = by.display();
    let text = read_regular(by)
        .map_err(|error| Failure::usage(format!("cannot read {shown}: {error}")))?;
    let other = repetition::checked(&text, by, plant, &controller)?;
    let (rate, others) = (own.run.rate, other.run.rate);
    if rate != others {
        let (rate, others) = (rate.hz(), others.hz());
        return Err(Failure::usage(format!(
            "{shown} is at {} and the run at {}: their steps are not the same times",
            exact_in(others, "Hz"),
            exact_in(rate, "Hz")
        )));
    }
    Ok(Plan {
        name: other.name,
        derived: other.derived,
        metrics: other.metrics,
        analyses: other.analyses,
        requirements: other.requirements,
        plots: other.plots,
        ..own
    })
}

/// An evaluation that is fed with the records of a recording.
pub(crate) struct RecordedEvaluation {
    pub(crate) evaluation: Evaluation,
    /// Where the signals are in a record.
    values: Range<usize>,
    validity: Validity,
    row: Vec<f64>,
}

impl RecordedEvaluation {
    /// That of a plan, for the records of a run, which have these columns there.
    ///
    /// # Errors
    /// If the plan does not fit the columns.
    pub(crate) fn new(
        reader: &RunReader,
        plan: &Plan,
        columns: &Columns,
        values: Range<usize>,
    ) -> Result<Self, ExpressionError> {
        Ok(Self {
            evaluation: Evaluation::new(plan, columns)?,
            validity: validity::of(reader, plan),
            row: vec![f64::NAN; columns.len()],
            values,
        })
    }

    /// Takes a record; the derived signals at its step.
    pub(crate) fn observe(&mut self, record: &[u64]) -> &[f64] {
        for (value, word) in self.row.iter_mut().zip(&record[self.values.clone()]) {
            *value = f64::from_bits(*word);
        }
        let invalid = self.validity.invalid(record);
        (self.evaluation).observe(Step(record[0]), &self.row, invalid);
        self.evaluation.derived()
    }
}

/// The columns of a recording that are signals, and where they are among the words of a record.
pub(crate) fn columns(
    reader: &RunReader,
    plant: &Description,
) -> Result<(Columns, Range<usize>), Failure> {
    let parameters = || plant.plants.iter().flat_map(|plant| &plant.parameters);
    let mut columns = Columns::default();
    let words = reader.columns();
    let first = words.iter().position(|word| word.is_signal()).unwrap_or(0);
    for word in words[first..].iter().take_while(|word| word.is_signal()) {
        let (prefix, name) = word.name.split_once('.').unwrap_or_default();
        let group = (Group::ALL
            .into_iter()
            .find(|group| group.prefix() == prefix))
        .ok_or_else(|| Failure::usage(format!("the recording has a group `{prefix}`")))?;
        // The schema of a recording has no word for the dots of parameters.
        let is_it =
            |field: &&Field| group == Group::Parameter && field.name.replace('.', "_") == name;
        columns.push(
            group,
            parameters().find(is_it).map_or(name, |field| &field.name),
        );
    }
    let values = first..first + columns.len();
    Ok((columns, values))
}

impl Judgement {
    /// The judgement as a person reads it.
    fn told(&self, plan: &Plan) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut text, plan);
        text
    }

    fn write(&self, text: &mut String, plan: &Plan) -> std::fmt::Result {
        use std::fmt::Write as _;
        let (scenario, verdict, run) = (&self.scenario, self.verdict, &self.run);
        writeln!(text, "{scenario}: {verdict}  ({run}, recorded)")?;
        match self.outcome.as_deref() {
            Some("completed") => {}
            Some(outcome) => writeln!(text, "  the run has {outcome}: no verdict can be pass")?,
            None => writeln!(text, "  the run was cut off: no verdict can be pass")?,
        }
        if let Some(reason) = &self.reason {
            writeln!(text, "  {reason}")?;
        }
        let steps = self.records.saturating_sub(1);
        write_metrics(text, &self.metrics, plan, &self.laws, steps)?;
        requirements::write(text, &self.requirements)
    }
}
